//! Summary of the written outputs.

use std::path::PathBuf;
use vlscan_formats::Tally;
use vlscan_geom::Aabb;

/// Summary of the outputs of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OutputSummary {
    /// Every file, in order of completion.
    pub files: Vec<FileSummary>,
    /// Run directories of [`Target::Helios`](super::Target::Helios), one per epoch.
    pub directories: Vec<PathBuf>,
    /// Points in the first requested point cloud whose reader has not closed it.
    pub points: u64,
    /// Points by part of the scene, if they are counted; parts beyond the last one that was hit are missing.
    pub points_of_part: Vec<u64>,
    /// Points of divided folders that are in no file: far outside all tiles, or without a part of the scene.
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
    /// True if the run ended before the file was complete.
    pub partial: bool,
    /// The complete file of an earlier run that this partial file did not replace.
    pub earlier: Option<PathBuf>,
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
    /// Points left out because the format cannot represent them: coordinates that are not finite or exceed
    /// the 32 bits of LAS.
    pub left_out: u64,
}

impl FileSummary {
    /// The summary of a complete output without name, with these counts and this box around its points.
    pub(super) fn of(kind: FileKind, tally: &Tally, bounds: Aabb) -> FileSummary {
        let Tally { records, left_out, by_return, .. } = *tally;
        let (path, partial, earlier, bytes) = (None, false, None, 0);
        FileSummary { path, partial, earlier, kind, records, bytes, bounds, by_return, left_out }
    }
}
