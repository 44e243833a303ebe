//! The command line of `vlscan run` and of its stages: `vlscan trajectory`, `vlscan pulses`, `vlscan trace`.

use clap::{Args, ValueEnum};
use std::path::PathBuf;
use vlscan_options::values::whole;
use vlscan_options::{
    Count, Divergence, EchoOptions, InputOptions, NavigationOptions, NoiseOptions, NotNegative, OneOf,
    Options, OriginOptions, OutputOptions, Positive, ProfileOptions, ScheduleOptions, TrajectoryOptions,
    TreeOptions,
};

/// The survey, and where, when and how it is flown.
#[derive(Clone, Debug, Args)]
pub struct SurveyArgs {
    /// The survey (.xml) or pipeline (.toml).
    pub file: PathBuf,
    /// Scanner of a pipeline with several [[scanner]] tables, by its name.
    #[arg(long, value_name = "NAME", help_heading = "Input")]
    pub scanner: Option<String>,
    /// A recorded trajectory.
    #[command(flatten)]
    pub trajectory: TrajectoryOptions,
    /// Errors of navigation.
    #[command(flatten)]
    pub navigation: NavigationOptions,
    /// Noise of platform and legs.
    #[command(flatten)]
    pub noise: NoiseOptions,
    /// Input files.
    #[command(flatten)]
    pub input: InputOptions,
    /// Seed and clock.
    #[command(flatten)]
    pub origin: OriginOptions,
    /// Threads and chunks.
    #[command(flatten)]
    pub schedule: ScheduleOptions,
    /// Corrections to the kinematics of the reference.
    #[command(flatten)]
    pub profile: ProfileOptions,
}

impl SurveyArgs {
    /// The options of a run without points.
    pub fn options(&self) -> Options {
        let SurveyArgs { trajectory, navigation, noise, input, origin, schedule, profile, .. } = self.clone();
        Options { trajectory, navigation, noise, input, origin, schedule, profile, ..Options::default() }
    }
}

/// `vlscan run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// The survey (.xml) or pipeline (.toml).
    pub file: PathBuf,
    /// All options.
    #[command(flatten)]
    pub options: Options,
    /// Write the boxes, poses and velocities of the moving parts of the scene as CSV: a row for each part
    /// before the first pulse and after each of its moves. vlscan frames --objects reads it. With several
    /// scanners each has a file, objects_NAME.csv for objects.csv.
    #[arg(
        long,
        value_name = "PATH",
        help_heading = "Output",
        conflicts_with = "shard",
        value_parser = super::besides_points()
    )]
    pub objects: Option<PathBuf>,
    /// Shards.
    #[command(flatten)]
    pub shards: ShardArgs,
    /// Dry run.
    #[command(flatten)]
    pub dry: DryRunArgs,
}

/// A forecast instead of a run.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Dry run")]
pub struct DryRunArgs {
    /// Write no points; forecast the run: legs, duration, pulses, points, density, footprint, spacing, sizes
    /// of the outputs, memory and time on this machine, and what the scan would miss.
    ///
    /// Legs and pulses are counted or, of long flights, computed. The rest comes from a sample that is
    /// measured and written to a temporary folder, with twice its standard error as uncertainty.
    #[arg(long, alias = "dryrun", conflicts_with_all = ["shard", "resume"])]
    pub dry_run: bool,
    /// Print the forecast as JSON.
    #[arg(long, requires = "dry_run")]
    pub json: bool,
    /// Also write the coverage of the survey, as a GeoTIFF of six bands (.tif) or as a picture of them
    /// (.png); may be given more than once.
    ///
    /// The bands are pulses with a return per m², returns per m², the number of strips, the share of the cell
    /// without returns, the mean angle of incidence in degrees, and the share of the pulses aimed at the
    /// ground that have no echo from it. With several scanners the file has their coverage together, and each
    /// has another one, coverage_NAME.tif for coverage.tif.
    #[arg(long, value_name = "FILE", requires = "dry_run")]
    pub coverage: Vec<PathBuf>,
    /// Side of a cell of the coverage in metres. [default: 10]
    #[arg(long, value_name = "METRES", requires = "coverage")]
    pub coverage_cell: Option<Positive>,
}

/// Shards of a run.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Shards")]
pub struct ShardArgs {
    /// Compute shard K of N, with K from 0 to N-1, and write it into the folder -o instead of points; vlscan
    /// merge turns all shards into the outputs of one run. --waveforms, --pulses, --misses, --subrays and
    /// --columns determine what shards contain in addition to echoes and poses. With --resume a complete
    /// shard is kept.
    #[arg(long, alias = "part", value_name = "K/N")]
    pub shard: Option<OneOf>,
    /// Without effect: any output can be made of a shard.
    #[arg(long, hide = true, value_name = "KIND", value_parser = ["echoes", "las"], requires = "shard")]
    pub part_points: Option<String>,
    /// Continue where the same command was interrupted, even by kill -9 or a power cut: shards of this many
    /// pulses are kept in OUT.shards until the outputs are complete. [default: 1M pulses]
    #[arg(long, value_name = "PULSES", num_args = 0..=1, require_equals = true, default_missing_value = "1M")]
    pub resume: Option<Count<1>>,
}

/// `vlscan index-shards`.
#[derive(Debug, Args)]
pub struct IndexShardsArgs {
    /// The survey (.xml) or pipeline (.toml).
    pub file: PathBuf,
    /// All options of vlscan run; -o is the folder of the shards.
    #[command(flatten)]
    pub options: Options,
}

/// `vlscan merge`.
#[derive(Debug, Args)]
pub struct MergeArgs {
    /// The folder of the shards.
    pub folder: PathBuf,
    /// Points and what is written beside them.
    #[command(flatten)]
    pub output: OutputOptions,
    /// Write the platform's poses as often as the survey's trajectoryTimeInterval_s asks for (CSV, as
    /// --trajectory reads it).
    #[arg(long, value_name = "PATH", help_heading = "Output")]
    pub trajectory_out: Option<PathBuf>,
    /// Write the outputs that this pipeline file or survey names, as vlscan run would; options take
    /// precedence over the file.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub pipeline: Option<PathBuf>,
    /// Verify the checksums of all shards, and write nothing.
    #[arg(long, conflicts_with_all = ["out", "output", "trajectory_out", "pipeline"])]
    pub check: bool,
    /// Write only segment K of M of the points, to OUT.segments/, so that many processes can share the merge
    /// of one LAS or LAZ file. K counts from 0.
    #[arg(long, alias = "part", value_name = "K/M", conflicts_with = "check")]
    pub segment: Option<OneOf>,
    /// Join the segments that --segment has written; other options must be the same.
    #[arg(long, conflicts_with_all = ["check", "segment"])]
    pub join: bool,
    /// Threads that encode; 0 = all, the default. Does not change the bytes.
    #[arg(short = 'j', long, value_name = "N", help_heading = "Speed", value_parser = whole::<usize>)]
    pub threads: Option<usize>,
    /// Show progress as plain lines if stderr is not a terminal.
    #[arg(long, help_heading = "Messages")]
    pub progress: bool,
}

/// How poses and pulses are written.
#[derive(Clone, Debug, Default, Args)]
pub struct EmitArgs {
    /// Lines of comma-separated values, or an Arrow IPC stream with the same columns.
    #[arg(long, value_name = "FORMAT", value_enum, default_value = "csv", help_heading = "Output")]
    pub format: EmitFormat,
    /// Write Arrow to a terminal.
    #[arg(long, help_heading = "Output")]
    pub force: bool,
}

/// Format of what stages hand to one another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum EmitFormat {
    /// Comma-separated values after a line of names and units.
    #[default]
    Csv,
    /// Arrow IPC stream; each column's unit is in its metadata.
    Arrow,
}

/// `vlscan trajectory`.
#[derive(Debug, Args)]
pub struct TrajectoryArgs {
    /// Flight and its settings.
    #[command(flatten)]
    pub survey: SurveyArgs,
    /// Seconds from pose to pose. [default: the survey's trajectoryTimeInterval_s, else 0.05]
    #[arg(long, value_name = "SECONDS", help_heading = "Output")]
    pub interval: Option<Positive>,
    /// Write true poses, without the errors of --navigation-error or [navigation_errors].
    #[arg(long = "true", help_heading = "Output")]
    pub flown: bool,
    /// How poses are written.
    #[command(flatten)]
    pub emit: EmitArgs,
}

/// `vlscan pulses`.
#[derive(Debug, Args)]
pub struct PulsesArgs {
    /// Flight and its settings.
    #[command(flatten)]
    pub survey: SurveyArgs,
    /// How pulses are written.
    #[command(flatten)]
    pub emit: EmitArgs,
}

/// `vlscan trace`.
#[derive(Debug, Args)]
pub struct TraceArgs {
    /// The pulses; - for stdin.
    #[arg(value_name = "PULSES", default_value = "-")]
    pub stream: PathBuf,
    /// The receiver: the id of a built-in scanner (see vlscan catalogue), file.xml#id, or a survey (.xml) or
    /// pipeline (.toml) with all its settings.
    #[arg(long, value_name = "SCANNER")]
    pub scanner: String,
    /// Changes of the instrument.
    #[command(flatten)]
    pub instrument: InstrumentArgs,
    /// Points and what is written beside them.
    #[command(flatten)]
    pub output: OutputOptions,
    /// Input files.
    #[command(flatten)]
    pub input: InputOptions,
    /// Seed and clock.
    #[command(flatten)]
    pub origin: OriginOptions,
    /// Threads and chunks.
    #[command(flatten)]
    pub schedule: ScheduleOptions,
    /// Departures from the reference's physics and kinematics.
    #[command(flatten)]
    pub profile: ProfileOptions,
    /// Detection of echoes.
    #[command(flatten)]
    pub echoes: EchoOptions,
    /// The tree over the scene.
    #[command(flatten)]
    pub tree: TreeOptions,
    /// Refused with a reason: what is traced is a stream.
    #[arg(long, alias = "part", hide = true, num_args = 0..=1)]
    pub shard: Option<Option<String>>,
    /// Refused with a reason, as --shard.
    #[arg(long, hide = true, num_args = 0..=1, require_equals = true)]
    pub resume: Option<Option<String>>,
}

impl TraceArgs {
    /// The options of a run; points go to stdout unless the command line says otherwise.
    pub fn options(&self) -> Options {
        let mut options = Options {
            output: self.output.clone(),
            input: self.input.clone(),
            origin: self.origin.clone(),
            schedule: self.schedule.clone(),
            profile: self.profile.clone(),
            echoes: self.echoes.clone(),
            tree: self.tree.clone(),
            ..Options::default()
        };
        if options.output.out.is_empty() && options.output.output.is_none() {
            options.output.out.push(PathBuf::from("-"));
        }
        options
    }
}

/// Changes of the instrument, for all of its devices.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Instrument")]
pub struct InstrumentArgs {
    /// Divergence of the beam in rad; overrides the stream. [default: the stream's, else the scanner's]
    #[arg(long, value_name = "RAD")]
    pub divergence: Option<Divergence>,
    /// Length of the outgoing pulse in ns.
    #[arg(long, value_name = "NS")]
    pub pulse_length: Option<NotNegative>,
    /// Pulses per second; needed by moving scenes whose time steps are in seconds. [default: the scanner's
    /// first]
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(1..))]
    pub pulse_rate: Option<u32>,
    /// Concentric rings of subrays per pulse (beamSampleQuality).
    #[arg(long, value_name = "RINGS", value_parser = clap::value_parser!(u32).range(1..=512))]
    pub beam_quality: Option<u32>,
    /// Width of the waveform's bins in ns (binSize_ns).
    #[arg(long, value_name = "NS")]
    pub bin: Option<NotNegative>,
    /// Peak search window in ns (winSize_ns).
    #[arg(long, value_name = "NS")]
    pub window: Option<NotNegative>,
    /// Standard deviation of the range noise in metres.
    #[arg(long, value_name = "METRES")]
    pub accuracy: Option<NotNegative>,
    /// Nearest range in metres.
    #[arg(long, value_name = "METRES")]
    pub range_min: Option<NotNegative>,
    /// Farthest range in metres.
    #[arg(long, value_name = "METRES")]
    pub range_max: Option<NotNegative>,
    /// Maximum number of returns per pulse; 0 = unlimited.
    #[arg(long, value_name = "N", value_parser = whole::<u32>)]
    pub max_returns: Option<u32>,
}
