//! Specification of the outputs of a run.

use super::{CloudFacts, Division, Ring};
use crate::shards::Records;
use ::arrow_array::RecordBatch;
use std::fmt::Debug;
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_formats::{CloudSettings, Column, FrameNames, LasSettings, Needs, PointFormat};
use vlscan_lidar::flight::DEFAULT_DAY;

/// Format of a trajectory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TrajectoryFormat {
    /// `x y z time roll pitch yaw` as HELIOS++ writes it (spec outputs §5).
    #[default]
    Helios,
    /// `time,x,y,z,roll,pitch,yaw` with a header line, seconds, metres (6 decimals) and degrees (9 decimals):
    /// what `--trajectory` reads.
    Csv,
}

/// Destination of an output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// Standard output.
    Stdout,
    /// One file for all legs. A path that is a pipe or a device is written as a stream.
    File(PathBuf),
    /// One file per active leg or strip, `legNNN_points.EXT`; created when missing.
    Directory(PathBuf),
    /// The layout of HELIOS++ (spec outputs §1): `DIR/<survey>/<YYYY-MM-DD_HH-MM-SS>[_N]/legNNN_points.EXT`,
    /// with `legNNN_trajectory.txt` beside it. A new run directory for every
    /// [`OutputPlan::open`](super::OutputPlan::open).
    Helios(PathBuf),
}

/// The file of a shard of a run, see the module `shards`.
#[derive(Clone, Debug, PartialEq)]
pub struct ShardOutput {
    /// The file; it is replaced if it exists.
    pub path: PathBuf,
    /// Its head, as `ShardHead::bytes` returns it.
    pub head: Vec<u8>,
}

/// Kind of the rows of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TableContent {
    /// Points, with the columns of [`OutputRequest::table_columns`] or [`CloudSettings::columns`].
    Points,
    /// Poses of the platform: time (s), x, y, z (m), roll, pitch, yaw (deg, of a heading as `--trajectory`
    /// reads them), and the angles in the platform's own convention.
    Trajectory,
    /// Emitted pulses: time (s), x, y, z (m), dx, dy, dz, pulse, device, scan_angle (deg).
    Pulses,
    /// Digitised waveforms: time (s), pulse, device, x, y, z (m), dx, dy, dz, one-way travel time of the
    /// first and the last sample (ns), and the list of samples.
    Waveforms,
}

/// A table that a run passes to its caller.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct TableRequest {
    /// Kind of its rows.
    pub content: TableContent,
    /// Rows per batch; the last batch has the remaining rows.
    pub batch_rows: usize,
    /// True if a batch ends with its leg, too.
    pub batch_per_leg: bool,
    /// Of points with the column `GpsTime`: whether a batch ends at every multiple of this many seconds, too.
    pub batch_seconds: Option<f64>,
    /// Receiver of the batches.
    pub sink: Arc<dyn TableSink>,
}

impl TableRequest {
    /// A table in a single batch.
    pub fn new(content: TableContent, sink: Arc<dyn TableSink>) -> TableRequest {
        TableRequest { content, batch_rows: usize::MAX, batch_per_leg: false, batch_seconds: None, sink }
    }
}

/// Takes the batches of a table. At least one batch is passed, in the thread that collects the results of a
/// run.
pub trait TableSink: Debug + Send + Sync {
    /// Takes facts about the points of a table in addition to their columns, before the first batch.
    fn begin(&self, _facts: CloudFacts) {}

    /// Takes the next batch; the run waits meanwhile.
    ///
    /// # Errors
    /// [`Error::ClosedPipe`](vlscan_base::error::Error::ClosedPipe) when no further batches are accepted.
    fn take(&self, batch: RecordBatch) -> Result<()>;
}

/// Specification of all outputs of a run.
///
/// ```
/// use vlscan_session::output::{OutputRequest, PointFormat, Target};
///
/// let mut outputs = OutputRequest::default();
/// outputs.sinks = vec![(Target::File("points.laz".into()), PointFormat::Laz)];
/// outputs.cloud.misses = true;
/// assert!(outputs.records().pulses);
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct OutputRequest {
    /// Point clouds.
    pub sinks: Vec<(Target, PointFormat)>,
    /// Choices for the points of all clouds and tables: columns, misses, labels, coordinate reference system,
    /// settings of LAS. Facts about survey and scene, such as [`CloudSettings::origin`] and
    /// [`CloudSettings::parts`], are replaced by those of the [`OutputContext`](super::OutputContext).
    ///
    /// With [`CloudSettings::misses`], pulses without echoes are written among the points in order of
    /// emission: as records with 0 returns at the beam's origin. Without [`CloudSettings::crs`], the
    /// coordinate reference system is that of the survey.
    pub cloud: CloudSettings,
    /// If set, waveforms are written beside the first point cloud that is not a stream (spec outputs §6):
    /// `legNNN_fullwave.txt` in directories, `STEM_fullwave.txt` beside single files.
    pub waveforms: bool,
    /// If set, pulses are written beside the first point cloud that is not a stream (spec outputs §7):
    /// `legNNN_pulse.txt`, `STEM_pulse.txt`.
    pub pulses: bool,
    /// True if waveforms and pulses are compressed text, `.bin` instead of `.txt`.
    pub zip: bool,
    /// A trajectory in addition to those of [`Target::Helios`].
    pub trajectory: Option<(Target, TrajectoryFormat)>,
    /// True if each device of a scanner with several gets its own point file: `_dev<id>` before the
    /// extension.
    pub split_by_channel: bool,
    /// Duration of the frames of MCAP, s; a revolution of the scanner if `None`.
    pub frame_s: Option<f64>,
    /// How the points of folders are divided among files, instead of by leg.
    pub division: Option<Division>,
    /// Area in which points are kept; everywhere if `None`.
    pub clip: Option<Ring>,
    /// True if poses arrive during the run, so that Arrow streams must not wait for full batches.
    pub live: bool,
    /// If set, existing files are replaced, and binary data may go to a terminal.
    pub force: bool,
    /// If set, the run resumes an interrupted one: an existing output with the same bytes is kept.
    pub is_resuming: bool,
    /// Files that the run reads; no output may replace them.
    pub inputs: Vec<PathBuf>,
    /// Files that the caller writes besides the outputs, which are checked with them.
    pub companions: Vec<PathBuf>,
    /// True if points are counted by part of the scene, see [`OutputSummary`](super::OutputSummary).
    pub counts_parts: bool,
    /// Name of run directories; `None` for the local time of their creation.
    pub run_stamp: Option<String>,
    /// A shard of a run, which is then the only output.
    pub shard: Option<ShardOutput>,
    /// Tables in memory.
    pub tables: Vec<TableRequest>,
    /// Columns of points in tables; those of `cloud` if `None`.
    pub table_columns: Option<Vec<Column>>,
    /// Number of epochs (spec input-formats §3.8); see [`Writer::next_epoch`](super::Writer::next_epoch).
    pub epochs: u32,
}

impl Default for OutputRequest {
    fn default() -> OutputRequest {
        let mut cloud = CloudSettings::default();
        cloud.creation = DEFAULT_DAY;
        OutputRequest {
            sinks: Vec::new(),
            cloud,
            waveforms: false,
            pulses: false,
            zip: false,
            trajectory: None,
            split_by_channel: false,
            frame_s: None,
            division: None,
            clip: None,
            live: false,
            force: false,
            is_resuming: false,
            inputs: Vec::new(),
            companions: Vec::new(),
            counts_parts: false,
            run_stamp: None,
            shard: None,
            tables: Vec::new(),
            table_columns: None,
            epochs: 1,
        }
    }
}

impl OutputRequest {
    /// True if points need their height above the ground.
    pub fn wants_heights(&self) -> bool {
        self.cloud.heights || self.chosen_columns().any(|column| column == Column::HeightAboveGround)
    }

    /// The columns that are chosen for clouds or tables.
    fn chosen_columns(&self) -> impl Iterator<Item = Column> {
        self.cloud.columns.iter().chain(&self.table_columns).flatten().copied()
    }

    /// True if points are collected in tables.
    pub(super) fn has_point_table(&self) -> bool {
        self.tables.iter().any(|table| table.content == TableContent::Points)
    }

    /// True if an output has exactly the chosen columns.
    pub(super) fn uses_all_columns(&self) -> bool {
        let has_table = self.has_point_table() && self.table_columns.is_none();
        has_table || self.sinks.iter().any(|(_, format)| format.has_columns())
    }

    /// True if the choice of columns has an effect on an output.
    pub(super) fn uses_columns(&self) -> bool {
        let has = |of: fn(PointFormat) -> bool| self.sinks.iter().any(|(_, format)| of(*format));
        self.uses_all_columns()
            || self.cloud.has_colours() && has(PointFormat::has_colours)
            || self.cloud.has_velocities() && has(PointFormat::has_velocities)
            || self.cloud.has_light_labels() && has(PointFormat::has_light_labels)
    }

    /// True if an output has frames.
    pub(super) fn has_frames(&self) -> bool {
        self.sinks.iter().any(|(_, format)| format.has_frames())
    }

    /// True if an output has records of LAS.
    fn has_las(&self) -> bool {
        self.sinks.iter().any(|(_, format)| format.is_las())
    }

    /// True if an output is a folder, whose points can be divided.
    pub(super) fn has_folder(&self) -> bool {
        self.sinks.iter().any(|(target, _)| matches!(target, Target::Directory(_)))
    }

    /// Records in addition to echoes and poses that all outputs need: the only place where formats, columns
    /// and tables state their needs. A run records it, a merge rejects shards without it.
    pub fn records(&self) -> Records {
        let has_table = |content| self.tables.iter().any(|table| table.content == content);
        let own = Records {
            waveforms: self.waveforms
                || self.cloud.las.packets.is_some()
                || has_table(TableContent::Waveforms),
            pulses: self.pulses || self.cloud.misses || has_table(TableContent::Pulses),
            ..Records::default()
        };
        let needs = self.needs();
        // Colours and velocities are a part of the causes.
        let truth = needs.cause || needs.colour || needs.velocity;
        let (colours, velocities) = (needs.colour, needs.velocity);
        Records { truth, colours, velocities, scanner_axes: needs.in_scanner, ..own }
    }

    /// Needs of formats and columns.
    pub(super) fn needs(&self) -> Needs {
        let CloudSettings { true_positions, heights, .. } = &self.cloud;
        let own = Needs { true_position: *true_positions, height: *heights, ..Needs::default() };
        let formats = self.sinks.iter().map(|(_, format)| format.needs());
        let columns = self.chosen_columns().map(Column::needs);
        formats.chain(columns).fold(own, Needs::union)
    }
}

/// Leaves out the options of each of several runs that apply to outputs of the others only: columns, frames
/// and their names, the division of folders, settings of LAS. Options that apply to no run stay, and are
/// errors or warnings.
pub fn leave_options_to_others(runs: &mut [&mut OutputRequest]) {
    let uses: [fn(&OutputRequest) -> bool; 4] = [
        OutputRequest::uses_columns,
        OutputRequest::has_frames,
        OutputRequest::has_folder,
        OutputRequest::has_las,
    ];
    let is_used = uses.map(|is_of| runs.iter().any(|run| is_of(run)));
    for run in runs {
        let [columns, frames, division, las] = [0, 1, 2, 3].map(|i| is_used[i] && !uses[i](run));
        if columns {
            run.cloud.columns = None;
        }
        if frames {
            (run.frame_s, run.cloud.frame_names) = (None, FrameNames::default());
        }
        if division {
            run.division = None;
        }
        if las {
            run.cloud.las = LasSettings::default();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_keep_the_options_that_apply_to_their_outputs() {
        let run = |formats: &[PointFormat]| {
            let sink = |format: &PointFormat| (Target::File("a".into()), *format);
            let mut request = OutputRequest { frame_s: Some(0.1), ..OutputRequest::default() };
            request.sinks = formats.iter().map(sink).collect();
            request.cloud.columns = Some(vec![Column::GpsTime]);
            request.cloud.frame_names.world = "street".to_owned();
            request.cloud.las.scale = Some(0.001);
            request
        };
        let mut runs = [&[PointFormat::Laz][..], &[PointFormat::Mcap], &[PointFormat::Xyz]].map(run);
        leave_options_to_others(&mut runs.each_mut());
        assert_eq!(runs.each_ref().map(|run| run.frame_s), [None, Some(0.1), None]);
        assert_eq!(runs.each_ref().map(|run| run.cloud.columns.is_some()), [false, false, true]);
        assert_eq!(runs[1].cloud.frame_names.world, "street");
        assert_eq!(runs.each_ref().map(|run| run.cloud.las.scale), [Some(0.001), None, None]);
        assert_eq!(runs[0].cloud.frame_names, FrameNames::default());
        // No run has a use for them.
        let mut runs = [&[PointFormat::Laz][..], &[PointFormat::Las]].map(run);
        leave_options_to_others(&mut runs.each_mut());
        assert!(runs.iter().all(|run| run.frame_s.is_some() && run.cloud.columns.is_some()));
    }
}
