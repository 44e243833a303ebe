//! Summary of the written outputs.

use std::path::PathBuf;
use vlscan_geom::{Aabb, DVec3};

/// State recorded in the metadata of a complete output.
pub(super) const COMPLETE: &str = "complete";
/// State recorded in the metadata of an output of a run that was interrupted or failed.
pub(super) const PARTIAL: &str = "partial: the run ended early";

/// Summary of the outputs of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Every file, in order of completion.
    pub files: Vec<FileSummary>,
    /// Run directories of [`Target::Helios`](super::Target::Helios), one per epoch.
    pub directories: Vec<PathBuf>,
    /// Points in the first point cloud requested.
    pub points: u64,
    /// Points by part of the scene, if they are counted; parts beyond the last one that was hit are missing.
    pub points_of_part: Vec<u64>,
    /// Points of divided folders that are in no file: far beside all tiles, or of no part of the scene.
    pub left_out: u64,
}

/// Kind of the records in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// Points.
    Points,
    /// Poses of the platform.
    Trajectory,
    /// Waveforms.
    Waveforms,
    /// Pulses.
    Pulses,
    /// Waveform packets that LAS points refer to.
    Packets,
    /// A shard of a run; its records are echoes.
    Shard,
}

/// One completed file.
#[derive(Clone, Debug, PartialEq)]
pub struct FileSummary {
    /// Path; `None` for standard output and for tables in memory.
    pub path: Option<PathBuf>,
    /// Whether the run ended before the file was complete.
    pub partial: bool,
    /// The complete file of an earlier run that this partial file did not replace.
    pub beside: Option<PathBuf>,
    /// Kind of its records.
    pub kind: FileKind,
    /// Number of points, poses, waveforms or pulses.
    pub records: u64,
    /// Size in bytes.
    pub bytes: u64,
    /// Box around the points as written, world coordinates, m.
    pub bounds: Aabb,
    /// Points by return number: first returns at index 0, the fifteenth and later returns at index 14.
    pub by_return: [u64; 15],
    /// Points left out because the format cannot represent them: coordinates that are not finite or exceed the 32
    /// bits of LAS.
    pub left_out: u64,
}

/// Counts of the records in a file or a piece; the counts of pieces add up.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tally {
    pub records: u64,
    pub left_out: u64,
    pub by_return: [u64; 15],
    /// Box around the coordinates as stored: metres, or integers of LAS.
    pub bounds: Aabb,
}

impl Tally {
    pub const EMPTY: Tally = Tally { records: 0, left_out: 0, by_return: [0; 15], bounds: Aabb::EMPTY };

    pub fn count_point(&mut self, stored: DVec3, return_number: u32) {
        self.records += 1;
        // A missed pulse has return number 0.
        if let Some(nth) = return_number.min(15).checked_sub(1) {
            self.by_return[nth as usize] += 1;
        }
        self.bounds = self.bounds.with(stored);
    }

    pub fn add(&mut self, other: &Tally) {
        self.records += other.records;
        self.left_out += other.left_out;
        for (mine, theirs) in self.by_return.iter_mut().zip(&other.by_return) {
            *mine += theirs;
        }
        self.bounds = self.bounds.union(other.bounds);
    }
}
