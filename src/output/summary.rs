//! What was written.

use crate::geom::{Aabb, DVec3};
use std::path::PathBuf;

/// State of an output that is complete, in its metadata.
pub(super) const COMPLETE: &str = "complete";
/// State of an output of an interrupted run.
pub(super) const PARTIAL: &str = "partial: the run was interrupted";

/// What a run has written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Every file, in the order in which they were completed.
    pub files: Vec<FileSummary>,
    /// Run directories of [`Target::Helios`](super::Target::Helios), one per play.
    pub directories: Vec<PathBuf>,
    /// Points of the first point cloud asked for.
    pub points: u64,
}

/// What kind of records a file holds.
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
}

/// One complete file.
#[derive(Clone, Debug, PartialEq)]
pub struct FileSummary {
    /// Its name; `None` is standard output.
    pub path: Option<PathBuf>,
    /// The complete file of an earlier run that this partial one did not replace.
    pub beside: Option<PathBuf>,
    /// What it holds.
    pub kind: FileKind,
    /// Points, poses, waveforms or pulses in it.
    pub records: u64,
    /// Size.
    pub bytes: u64,
    /// Box around the points as written, world coordinates.
    pub bounds: Aabb,
    /// Points by return number: first returns at index 0, the fifteenth and later ones at index 14.
    pub by_return: [u64; 15],
    /// Points that the format cannot hold and that were left out: coordinates that are no numbers or beyond the
    /// 32 bits of LAS.
    pub left_out: u64,
}

/// Counts of the records of one file, or of a piece of it; pieces add up.
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

    /// Counts a point that was written with these coordinates.
    pub fn count_point(&mut self, stored: DVec3, return_number: u32) {
        self.records += 1;
        // A missed pulse has return number 0.
        if let Some(nth) = return_number.min(15).checked_sub(1) {
            self.by_return[nth as usize] += 1;
        }
        self.bounds = self.bounds.with(stored);
    }

    /// Adds another piece.
    pub fn add(&mut self, other: &Tally) {
        self.records += other.records;
        self.left_out += other.left_out;
        for (mine, theirs) in self.by_return.iter_mut().zip(&other.by_return) {
            *mine += theirs;
        }
        self.bounds = self.bounds.union(other.bounds);
    }
}
