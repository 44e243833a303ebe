//! Options that several commands take, each group with one heading or two.

use super::PoseArgs;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Which corrections of the reference's physics are on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PhysicsProfile {
    /// Reproduce the reference program.
    Helios,
    /// Switch on all corrections.
    Refined,
}

/// Which tree traces the rays; the points are the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TreeKind {
    /// Wide hierarchy of boxes: the fastest and smallest.
    Bvh,
    /// kd-tree by min/max histograms of the surface area heuristic; 4 in the reference program.
    #[value(alias = "4")]
    Fsah,
    /// kd-tree by the surface area heuristic on the best axis; 3 in the reference program.
    #[value(alias = "3")]
    AxisSah,
    /// kd-tree by the surface area heuristic; 2 in the reference program.
    #[value(alias = "2")]
    Sah,
    /// kd-tree by the median; 1 in the reference program.
    #[value(alias = "1")]
    Median,
}

/// How pulses are handed out to threads; the points are the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ScheduleKind {
    /// Chunks wait in a bounded queue; while it is full the producer works off a chunk itself.
    Warehouse,
    /// Chunks go to free workers, and grow or shrink with the workers' idle times.
    Dynamic,
    /// Chunks of one size go to free workers; while all are busy the producer computes single pulses.
    Static,
    /// Pulses go to free workers one by one; the producer computes none.
    Single,
}

/// Points and what is written beside them.
#[derive(Clone, Debug, Default, Args)]
pub struct OutputArgs {
    /// Where the points go: a file (format from its extension; all legs in one), a folder (one file per leg), or - for
    /// stdout. May be given more than once.
    #[arg(short = 'o', long = "out", value_name = "PATH", help_heading = "Output")]
    pub out: Vec<PathBuf>,
    /// Format of the points, where no extension tells it; copc is NAME.copc.laz, an octree in LAZ.
    #[arg(long, value_name = "FORMAT", value_parser = ["xyz", "csv", "bin", "las", "laz", "copc", "ply", "ply-ascii", "arrow", "parquet"], help_heading = "Output")]
    pub format: Option<String>,
    /// Write as HELIOS++ does: DIR/SURVEY/TIME/leg000_points.xyz and so on. [default without -o: output]
    #[arg(long, value_name = "DIR", help_heading = "Output", conflicts_with = "out")]
    pub output: Option<PathBuf>,
    /// Replace files that exist, once their successors are complete: a run that is interrupted or fails leaves them, and what
    /// it measured as NAME.partial.laz beside them. Also write binary data to a terminal.
    #[arg(long, help_heading = "Output")]
    pub force: bool,
    /// Write every digitised waveform.
    #[arg(long, help_heading = "Output")]
    pub waveforms: bool,
    /// Write every emitted pulse.
    #[arg(long, help_heading = "Output")]
    pub pulses: bool,
    /// Columns of csv, arrow and parquet, and of xyz, which gets a header then: X,Y,Z,Intensity,GpsTime and so on. An
    /// unknown name lists them all.
    #[arg(long, value_name = "NAMES", help_heading = "Output")]
    pub columns: Option<String>,
    /// Write part, primitive and true range into las, laz and ply, too; csv, arrow and parquet have them anyway.
    #[arg(long, help_heading = "Output")]
    pub labels: bool,
    /// Write positions without errors of navigation (TrueX, TrueY, TrueZ) into las and laz, too; the columns of csv, arrow and
    /// parquet are chosen with --columns.
    #[arg(long, help_heading = "Output")]
    pub true_positions: bool,
    /// Write what each subray met instead of points, at its place on the surface, with the number of the return that it is part
    /// of (0 = none): for leaf area and machine learning. The columns Subray, SurfaceX, NormalX, FootprintFraction and their
    /// like are chosen with --columns, with and without this.
    #[arg(long, help_heading = "Output")]
    pub subrays: bool,
    /// Write pulses without echoes, too: 0 returns, at the beam's origin, with the beam's direction.
    #[arg(long, help_heading = "Output")]
    pub misses: bool,
    /// Let LAS leave through a pipe at once, with N as the number of points in its header (250k, 1G); readers bear fewer
    /// points, more are an error. Without it LAS is completed in a temporary file first.
    #[arg(long, value_name = "N", help_heading = "Output")]
    pub las_at_most: Option<String>,
    /// Write waveforms as packets that the points of LAS and LAZ refer to (LAS 1.4, point format 9), inside that file or
    /// beside it as .wdp.
    #[arg(long, value_name = "WHERE", value_parser = ["inside", "beside"], help_heading = "Output")]
    pub wave_packets: Option<String>,
    /// One point file per device of a multi-channel scanner.
    #[arg(long, help_heading = "Output")]
    pub split_by_channel: bool,
    /// Coordinate reference system of the scene as WKT, or a file that holds it; goes into LAS and LAZ headers.
    #[arg(long, value_name = "WKT|FILE", help_heading = "Output")]
    pub crs: Option<String>,
    /// With --output: LAS 1.4 instead of text.
    #[arg(long, help_heading = "Output")]
    pub las_output: bool,
    /// With --output: LAS 1.0 instead of text.
    #[arg(long, help_heading = "Output")]
    pub las10: bool,
    /// With --output: LAZ instead of LAS, and compressed text (.bin) instead of text; waveforms and pulses, too.
    #[arg(long, help_heading = "Output")]
    pub zip_output: bool,
    /// Resolution of LAS coordinates in metres. [default: 0.0001, coarser where the scene is too wide for it]
    #[arg(long, value_name = "METRES", help_heading = "Output")]
    pub las_scale: Option<f64>,
}

/// What is read.
#[derive(Clone, Debug, Default, Args)]
pub struct InputArgs {
    /// Replace the scene: a packed one (.vlscene), file.xml#id, or a file of geometry.
    #[arg(long, value_name = "SCENE", help_heading = "Input")]
    pub scene: Option<String>,
    /// Leave out OBJ faces with more than four corners, as HELIOS++ does.
    #[arg(long, help_heading = "Input")]
    pub drop_polygons: bool,
    /// Folder to look for scenes, scanners, platforms, geometry and spectra in; may be given more than once.
    #[arg(long, value_name = "DIR", help_heading = "Input")]
    pub assets: Vec<PathBuf>,
    /// Treat every warning about the input as an error.
    #[arg(long, help_heading = "Input")]
    pub strict: bool,
    /// Accepted for compatibility: there is no scene cache to be ignored.
    #[arg(long, hide = true)]
    pub rebuild_scene: bool,
    /// Accepted for compatibility: no scene cache is written.
    #[arg(long, hide = true)]
    pub no_scene_writing: bool,
}

/// Where the platform is.
#[derive(Clone, Debug, Default, Args)]
pub struct FlightArgs {
    /// Replace the platform by a recorded trajectory: text (time,x,y,z,roll,pitch,yaw), an Arrow stream with such columns,
    /// SBET or TerraScan .trj; - or STDIN reads it from stdin as it arrives.
    #[arg(long, value_name = "PATH", help_heading = "Input")]
    pub trajectory: Option<PathBuf>,
    /// How the trajectory is read.
    #[command(flatten)]
    pub poses: PoseArgs,
    /// How long, in seconds, points of a live trajectory may wait for others to be computed together. [default: 0.25]
    #[arg(long, value_name = "SECONDS", help_heading = "Trajectory")]
    pub latency: Option<f64>,
    /// Let what is reported of the platform's pose differ from what was flown, so that points move: a key of
    /// [navigation_errors] in pipeline files and one number or three, such as position_m=0.02,0.02,0.05, attitude_deg=0.004,
    /// boresight_deg=0,0.01,0; may be given more than once.
    #[arg(long, value_name = "KEY=NUMBERS", help_heading = "Simulation")]
    pub navigation_error: Vec<String>,
    /// Ignore the platform's position and attitude noise.
    #[arg(long, help_heading = "Simulation")]
    pub no_platform_noise: bool,
    /// Ignore the survey's random leg offsets.
    #[arg(long, help_heading = "Simulation")]
    pub no_leg_noise: bool,
}

/// What all random draws and time stamps depend on.
#[derive(Clone, Debug, Default, Args)]
pub struct OriginArgs {
    /// Seed of all noise: an integer, a decimal number or "YYYY-MM-DD hh:mm:ss". [default: the survey's, else 0]
    #[arg(long, value_name = "SEED", help_heading = "Simulation")]
    pub seed: Option<String>,
    /// Start of the GPS clock: "YYYY-MM-DD hh:mm:ss" (UTC), POSIX seconds, or "now". [default: 2024-01-01 00:00:00]
    #[arg(long, value_name = "TIME", help_heading = "Simulation")]
    pub gps_start: Option<String>,
}

/// Where physics and kinematics depart from the reference's.
#[derive(Clone, Debug, Default, Args)]
pub struct ProfileArgs {
    /// Reproduce the reference program, or switch its known weaknesses off. [default: helios]
    #[arg(long, value_name = "PROFILE", help_heading = "Simulation")]
    pub physics: Option<PhysicsProfile>,
    /// Switch single corrections on, by name with hyphens, e.g. sum-equal-ranges; a name after no- switches one off. They
    /// are listed at the end of --help.
    #[arg(long, value_name = "NAME", value_delimiter = ',', help_heading = "Simulation")]
    pub correct: Vec<String>,
}

/// How echoes are computed.
#[derive(Clone, Debug, Default, Args)]
pub struct PhysicsArgs {
    /// Where it departs from the reference's.
    #[command(flatten)]
    pub profile: ProfileArgs,
    /// Fit a Gaussian to every echo and report its width; echoes narrower than 0.1 ns are dropped.
    #[arg(long, help_heading = "Simulation")]
    pub echo_width: bool,
    /// Add noise to the written waveforms.
    #[arg(long, help_heading = "Simulation")]
    pub waveform_noise: bool,
    /// Take every surface as hit at right angles.
    #[arg(long, help_heading = "Simulation")]
    pub fixed_incidence: bool,
    /// Echo strengths by the older energy model.
    #[arg(long, help_heading = "Simulation")]
    pub legacy_energy: bool,
}

/// How the work is done; the points are the same.
#[derive(Clone, Debug, Default, Args)]
pub struct ScheduleArgs {
    /// Threads that compute; 0 or nothing = all. The points are the same for any number.
    #[arg(short = 'j', long, value_name = "N", help_heading = "Speed")]
    pub threads: Option<usize>,
    /// Pulses per chunk. [default: 1024]
    #[arg(long, value_name = "N", allow_hyphen_values = true, help_heading = "Speed")]
    pub chunk_size: Option<i64>,
    /// Chunks per worker that may wait. [default: 4]
    #[arg(long, value_name = "N", help_heading = "Speed")]
    pub warehouse_factor: Option<usize>,
    /// How pulses are handed out to the threads; the points are the same. [default: warehouse]
    #[arg(long, value_name = "SCHEDULE", help_heading = "Speed")]
    pub schedule: Option<ScheduleKind>,
    /// The reference program's schedules: 0 is static, dynamic with a negative --chunk-size; 1 is warehouse.
    #[arg(long, hide = true, value_parser = ["0", "1"], conflicts_with = "schedule")]
    pub parallelization: Option<String>,
    /// Dynamic chunks: idle times shorter than this mean nothing, in milliseconds. [default: 0.1]
    #[arg(long, value_name = "MS", help_heading = "Speed")]
    pub idle_threshold: Option<f64>,
    /// Begin a leg only when everything of the one before is done, as in the paper; slower.
    #[arg(long, help_heading = "Speed")]
    pub leg_barrier: bool,
    /// Write what the schedule did as JSON: idle times, queue depths, chunk sizes, leg ends.
    #[arg(long, value_name = "FILE", help_heading = "Speed")]
    pub schedule_log: Option<PathBuf>,
    /// Refuse scenes that need more memory than this, e.g. 4G.
    #[arg(long, value_name = "SIZE", help_heading = "Speed")]
    pub max_memory: Option<String>,

    /// Show the progress as plain lines when stderr is no terminal.
    #[arg(long, help_heading = "Messages")]
    pub progress: bool,
}

/// How the scene is kept; the points are the same.
#[derive(Clone, Debug, Default, Args)]
pub struct TreeArgs {
    /// The tree that traces the rays; the points are the same. [default: bvh]
    #[arg(long, value_name = "TREE", help_heading = "Speed")]
    pub tree: Option<TreeKind>,
    /// Histogram bins (fsah) or candidates (sah, axis-sah) of the tree builder. [default: 32, 21]
    #[arg(long, value_name = "N", help_heading = "Speed")]
    pub tree_bins: Option<usize>,
    /// Threads that build the tree; 0 or nothing = as --threads.
    #[arg(long, value_name = "N", help_heading = "Speed")]
    pub tree_jobs: Option<usize>,
    /// Threads that work together on a kd-tree's large upper nodes; 1 = none help, 0 or nothing = as --tree-jobs.
    #[arg(long, value_name = "N", help_heading = "Speed")]
    pub tree_geom_jobs: Option<usize>,
    /// kd-trees: cost of visiting an interior node, visiting a leaf and testing a primitive. [default: 8,1,1]
    #[arg(long, value_name = "CI,CL,CO", value_delimiter = ',', help_heading = "Speed")]
    pub tree_costs: Vec<f64>,
    /// kd-trees: smallest number of primitives that may be split. [default: 17]
    #[arg(long, value_name = "N", help_heading = "Speed")]
    pub tree_min_primitives: Option<usize>,
    /// kd-trees: deepest level, at most 64. [default: 8 + 1.3 log2 of the primitives]
    #[arg(long, value_name = "N", help_heading = "Speed")]
    pub tree_depth: Option<u32>,
    /// kd-trees by the paper's rules: unit costs, 5 primitives, axes in turn, every split booked in the cost of the whole
    /// tree; the other --tree options change single rules.
    #[arg(long, help_heading = "Speed")]
    pub tree_strict: bool,
    /// Whether parts of one mesh file share it; the points are the same.
    #[arg(long, value_name = "WHEN", hide = true, value_parser = ["auto", "always", "never"])]
    pub instances: Option<String>,
}

/// Changes of the instrument, for all of its devices.
#[derive(Clone, Debug, Default, Args)]
pub struct InstrumentArgs {
    /// Divergence of the beam in rad, whatever the stream says. [default: the stream's, else the scanner's]
    #[arg(long, value_name = "RAD", help_heading = "Instrument")]
    pub divergence: Option<f64>,
    /// Length of the outgoing pulse in ns.
    #[arg(long, value_name = "NS", help_heading = "Instrument")]
    pub pulse_length: Option<f64>,
    /// Pulses per second: moving scenes whose steps are given in seconds go by it. [default: the scanner's first]
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Instrument")]
    pub pulse_rate: Option<u32>,
    /// Concentric rings of subrays per pulse (beamSampleQuality).
    #[arg(long, value_name = "RINGS", value_parser = clap::value_parser!(u32).range(1..=512), help_heading = "Instrument")]
    pub beam_quality: Option<u32>,
    /// Width of the waveform's bins in ns (binSize_ns).
    #[arg(long, value_name = "NS", help_heading = "Instrument")]
    pub bin: Option<f64>,
    /// Peak search window in ns (winSize_ns).
    #[arg(long, value_name = "NS", help_heading = "Instrument")]
    pub window: Option<f64>,
    /// Standard deviation of the range noise in metres.
    #[arg(long, value_name = "METRES", help_heading = "Instrument")]
    pub accuracy: Option<f64>,
    /// Nearest range in metres.
    #[arg(long, value_name = "METRES", help_heading = "Instrument")]
    pub range_min: Option<f64>,
    /// Farthest range in metres.
    #[arg(long, value_name = "METRES", help_heading = "Instrument")]
    pub range_max: Option<f64>,
    /// Most returns per pulse; 0 is unlimited.
    #[arg(long, value_name = "N", help_heading = "Instrument")]
    pub max_returns: Option<u32>,
}
