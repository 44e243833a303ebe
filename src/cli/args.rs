//! The command line as typed: nothing here touches the world.

pub use super::pose_args::PoseArgs;
pub use super::stage_args::{PulsesArgs, SurveyArgs, TraceArgs, TrajectoryArgs};
use super::{LogTo, Verbosity};
use clap::{ArgAction, Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Virtual laser scanning for Unix pipes.
///
/// Flies a LiDAR instrument over a virtual scene and emits the point cloud that it would have measured. Points go to files
/// or stdout, messages and progress to stderr.
#[derive(Debug, Parser)]
#[command(name = "vlscan", version, propagate_version = true, max_term_width = 110)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Say what each stage does and how long it takes.
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub verbose: u8,
    /// Say nothing but errors.
    #[arg(short, long, global = true)]
    pub quiet: bool,
    /// Say nothing at all.
    #[arg(long, global = true, hide = true)]
    pub silent: bool,
    /// Say how long each stage takes, and errors.
    #[arg(long, global = true, hide = true)]
    pub times: bool,
    /// Write all messages to helios_TIME.log in the working folder, too.
    #[arg(long, global = true, hide = true)]
    pub log_file: bool,
    /// Write all messages to helios_TIME.log in the working folder and none to stderr.
    #[arg(long, global = true, hide = true)]
    pub log_file_only: bool,
}

impl Cli {
    /// The verbosity that the flags ask for.
    pub fn verbosity(&self) -> Verbosity {
        match (self.silent, self.quiet, self.verbose, self.times) {
            (true, ..) => Verbosity::Silent,
            (_, true, ..) => Verbosity::Errors,
            (_, _, 0 | 1, true) => Verbosity::Times,
            (_, _, 0, _) => Verbosity::Normal,
            _ => Verbosity::Verbose,
        }
    }

    /// Where messages go.
    pub fn log(&self) -> LogTo {
        match (self.log_file, self.log_file_only) {
            (_, true) => LogTo::File,
            (true, _) => LogTo::Both,
            _ => LogTo::Stderr,
        }
    }
}

/// Subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Fly a HELIOS++ survey (.xml) or a pipeline (.toml) and write its point cloud.
    Run(Box<RunArgs>),
    /// Compare trees, schedules, chunk sizes and numbers of threads on a survey.
    Bench(Box<BenchArgs>),
    /// Fly a survey or pipeline and write the platform's poses to stdout.
    Trajectory(Box<TrajectoryArgs>),
    /// Fly a survey or pipeline and write every pulse to stdout instead of tracing it.
    Pulses(Box<PulsesArgs>),
    /// Read pulses, trace them through a scene and write the echoes.
    Trace(Box<TraceArgs>),
    /// Make scenes to try things with.
    Scene(SceneArgs),
    /// List the scanners and platforms that ship.
    Catalogue(CatalogueArgs),
    /// Expand compressed text (.bin) to the text that it holds.
    Unzip(UnzipArgs),
    /// Draw a point cloud: a picture from above and from the side, or a page to turn around.
    Preview(PreviewArgs),
    /// Write what a shell needs to complete this command line to stdout.
    Completions(CompletionsArgs),
    /// Write the manual pages.
    #[command(hide = true)]
    Man(ManArgs),
}

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

/// `vlscan run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// The survey (.xml) or pipeline (.toml).
    pub file: PathBuf,
    /// Points and what is written beside them.
    #[command(flatten)]
    pub output: OutputArgs,
    /// Where the platform is.
    #[command(flatten)]
    pub flight: FlightArgs,
    /// What is read.
    #[command(flatten)]
    pub input: InputArgs,
    /// What everything depends on.
    #[command(flatten)]
    pub origin: OriginArgs,
    /// How echoes are computed.
    #[command(flatten)]
    pub physics: PhysicsArgs,
    /// How the work is done.
    #[command(flatten)]
    pub schedule: ScheduleArgs,
    /// How the scene is kept.
    #[command(flatten)]
    pub tree: TreeArgs,
    /// Write the platform's poses as often as the survey's trajectoryTimeInterval_s asks for (CSV, as --trajectory reads
    /// it).
    #[arg(long, value_name = "PATH", help_heading = "Output")]
    pub trajectory_out: Option<PathBuf>,
}

/// Points and what is written beside them.
#[derive(Clone, Debug, Default, Args)]
pub struct OutputArgs {
    /// Where the points go: a file (format from its extension; all legs in one), a folder (one file per leg), or - for
    /// stdout. May be given more than once.
    #[arg(short = 'o', long = "out", value_name = "PATH", help_heading = "Output")]
    pub out: Vec<PathBuf>,
    /// Format of the points, where no extension tells it.
    #[arg(long, value_name = "FORMAT", value_parser = ["xyz", "csv", "bin", "las", "laz", "ply", "ply-ascii", "arrow", "parquet"], help_heading = "Output")]
    pub format: Option<String>,
    /// Write as HELIOS++ does: DIR/SURVEY/TIME/leg000_points.xyz and so on. [default without -o: output]
    #[arg(long, value_name = "DIR", help_heading = "Output", conflicts_with = "out")]
    pub output: Option<PathBuf>,
    /// Overwrite files that exist, and write binary data to a terminal.
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
    /// Replace the platform by a recorded trajectory: text (time,x,y,z,roll,pitch,yaw), SBET or TerraScan .trj; - or STDIN
    /// reads it from stdin as it arrives.
    #[arg(long, value_name = "PATH", help_heading = "Input")]
    pub trajectory: Option<PathBuf>,
    /// How the trajectory is read.
    #[command(flatten)]
    pub poses: PoseArgs,
    /// How long, in seconds, points of a live trajectory may wait for others to be computed together. [default: 0.25]
    #[arg(long, value_name = "SECONDS", help_heading = "Trajectory")]
    pub latency: Option<f64>,
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

/// How echoes are computed.
#[derive(Clone, Debug, Default, Args)]
pub struct PhysicsArgs {
    /// Reproduce the reference program, or switch its known weaknesses off. [default: helios]
    #[arg(long, value_name = "PROFILE", help_heading = "Simulation")]
    pub physics: Option<PhysicsProfile>,
    /// Switch single corrections on, by name with hyphens, e.g. sum-equal-ranges; a name after no- switches one off. An
    /// unknown name lists them all.
    #[arg(long, value_name = "NAME", value_delimiter = ',', help_heading = "Simulation")]
    pub correct: Vec<String>,
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

/// Whether legs wait for one another in a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Barriers {
    /// They do not.
    Off,
    /// They do.
    On,
    /// Once and once.
    Both,
}

impl Barriers {
    /// The settings to compare.
    pub fn values(self) -> &'static [bool] {
        match self {
            Barriers::Off => &[false],
            Barriers::On => &[true],
            Barriers::Both => &[false, true],
        }
    }
}

/// `vlscan bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// The survey (.xml) or pipeline (.toml).
    pub survey: PathBuf,
    /// Trees to compare.
    #[arg(long, value_name = "TREE,…", value_delimiter = ',', default_value = "median,sah,fsah,bvh")]
    pub tree: Vec<TreeKind>,
    /// Build the kd-trees by the paper's rules: unit costs, 5 primitives, axes in turn.
    #[arg(long)]
    pub tree_strict: bool,
    /// Schedules to compare.
    #[arg(
        long,
        value_name = "SCHEDULE,…",
        value_delimiter = ',',
        default_value = "single,static,dynamic,warehouse"
    )]
    pub schedule: Vec<ScheduleKind>,
    /// Pulses per chunk; single pulses and sequential runs aside.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "32")]
    pub chunk_size: Vec<u32>,
    /// Chunks per worker that may wait in the warehouse.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "4")]
    pub warehouse_factor: Vec<usize>,
    /// Threads that build and compute; one thread is always among them. [default: 1, 2, 4, … to all]
    #[arg(short = 'j', long, value_name = "N,…", value_delimiter = ',')]
    pub threads: Vec<usize>,
    /// Whether a leg begins only when everything of the one before is done, as in the paper.
    #[arg(long, value_name = "WHEN", default_value = "off")]
    pub leg_barrier: Barriers,
    /// Dynamic chunks: idle times shorter than this mean nothing, in milliseconds. [default: 0.1]
    #[arg(long, value_name = "MS")]
    pub idle_threshold: Option<f64>,
    /// How often everything is measured; the least time counts.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub repetitions: usize,
    /// How often everything is run before that.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub warm_up: usize,
    /// What the points are written as, to a temporary file.
    #[arg(long, value_name = "FORMAT", default_value = "las", value_parser = ["none", "xyz", "las", "laz"])]
    pub format: String,
    /// Replay measured task times on machines with so many threads, too.
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    pub simulate_threads: Vec<usize>,
    /// Print the paper's own tables, too.
    #[arg(long)]
    pub paper: bool,
    /// Write everything as JSON; - for stdout, where the table goes to stderr.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Draw times, speedups and chunk sizes as SVG.
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// Overwrite files that exist.
    #[arg(long)]
    pub force: bool,
    /// Folder to look for scenes, scanners, platforms, geometry and spectra in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// Options of vlscan run that change what is simulated, such as --physics refined.
    #[arg(last = true, value_name = "RUN OPTIONS")]
    pub run: Vec<std::ffi::OsString>,
}

/// `vlscan catalogue`.
#[derive(Debug, Args)]
pub struct CatalogueArgs {
    /// Only what has this in its reference or name.
    pub filter: Option<String>,
    /// JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// `vlscan unzip`.
#[derive(Debug, Args)]
pub struct UnzipArgs {
    /// The compressed text; - for stdin.
    pub file: PathBuf,
    /// The text; - for stdout.
    #[arg(default_value = "-")]
    pub out: PathBuf,
    /// Overwrite a file that exists.
    #[arg(long)]
    pub force: bool,
}

/// `vlscan scene`.
#[derive(Debug, Args)]
pub struct SceneArgs {
    /// What to do with scenes.
    #[command(subcommand)]
    pub command: SceneCommand,
}

/// Subcommands of `vlscan scene`.
#[derive(Debug, Subcommand)]
pub enum SceneCommand {
    /// Make a procedural scene with a survey that scans it: OBJ, MTL, scene.xml, survey.xml.
    Make(MakeArgs),
    /// Tell what a scene holds and costs: parts, primitives, bounds, materials, memory, faults.
    Info(InfoArgs),
    /// Compile a scene and its tree to one file that is open in milliseconds, whatever its size.
    Pack(PackArgs),
}

/// `vlscan scene pack`.
#[derive(Debug, Args)]
pub struct PackArgs {
    /// A scene (file.xml#id), a survey (.xml) or pipeline (.toml), whose scanner's wavelength counts, or a file of geometry.
    pub scene: String,
    /// The packed scene. [default: beside the scene's file, .vlscene]
    #[arg(short = 'o', long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    /// Folder to look for files in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// Wavelength at which spectra are evaluated. [default: that of the survey's scanner, else 1064]
    #[arg(long, value_name = "NM")]
    pub wavelength: Option<f64>,
    /// Seed of random materials and voxel places. [default: the survey's, else 0]
    #[arg(long, value_name = "SEED")]
    pub seed: Option<String>,
    /// The physics that it will be scanned with; decides about specular shares. [default: helios]
    #[arg(long, value_name = "PROFILE")]
    pub physics: Option<PhysicsProfile>,
    /// The tree to pack. [default: bvh]
    #[arg(long, value_name = "TREE")]
    pub tree: Option<TreeKind>,
    /// Whether parts of one mesh file share it; the points are the same.
    #[arg(long, value_name = "WHEN", hide = true, value_parser = ["auto", "always", "never"])]
    pub instances: Option<String>,
    /// Overwrite a file that exists.
    #[arg(long)]
    pub force: bool,
}

/// `vlscan scene info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// A scene (file.xml#id), a survey (.xml), a pipeline (.toml), a mesh (.obj), raster (.tif), voxels (.vox), a table of
    /// instances (.csv), or a packed scene (.vlscene).
    pub scene: String,
    /// Of a packed scene: read all of it and compare the checksums.
    #[arg(long)]
    pub verify: bool,
    /// Folder to look for files in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// As JSON.
    #[arg(long)]
    pub json: bool,
}

/// Kinds of procedural scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SceneKind {
    /// Trees on rolling ground, scanned from an aeroplane.
    Forest,
    /// Hills, scanned from an aeroplane.
    Terrain,
    /// A furnished room, scanned from two tripod positions.
    Room,
}

/// `vlscan scene make`.
#[derive(Debug, Args)]
pub struct MakeArgs {
    /// What to make.
    pub kind: SceneKind,
    /// The folder that gets the files.
    #[arg(short = 'o', long, value_name = "DIR")]
    pub out: PathBuf,
    /// Number of triangles, met within about one per cent; 250k and 10M are understood.
    #[arg(short = 'n', long, value_name = "N", default_value = "100k")]
    pub triangles: String,
    /// Another seed makes another scene.
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub seed: u64,
    /// Edge length of the scene in metres.
    #[arg(long, value_name = "METRES")]
    pub extent: Option<f64>,
    /// Roughly how many pulses the survey emits.
    #[arg(long, value_name = "N")]
    pub pulses: Option<String>,
    /// Forest: every tree is a part of its own, so that echoes carry the tree's number.
    #[arg(long)]
    pub separate_trees: bool,
    /// Forest: make so many trees and let each stand in --copies places; a forest of a billion triangles is
    /// -n 1G --models 50 --copies 1000.
    #[arg(long, value_name = "N", conflicts_with = "separate_trees")]
    pub models: Option<u64>,
    /// Forest: so many opaque voxels of 0.25 m in the crowns, besides the triangles.
    #[arg(long, value_name = "N", conflicts_with = "models")]
    pub voxels: Option<String>,
    /// Forest with --models: places of each tree. [default: 100]
    #[arg(long, value_name = "N", requires = "models")]
    pub copies: Option<u64>,
    /// Overwrite files that exist.
    #[arg(long)]
    pub force: bool,
}

/// What colours a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Colour {
    /// Height.
    Height,
    /// Class of the surface.
    Class,
    /// Echo strength.
    Intensity,
    /// Part that was hit.
    Object,
    /// Number of the return.
    Return,
}

/// `vlscan preview`.
#[derive(Debug, Args)]
pub struct PreviewArgs {
    /// The points: .xyz, .las, .laz, .ply, or - for text on stdin; with --pulse waveforms (*_fullwave.txt, also .gz or
    /// .bin).
    pub points: PathBuf,
    /// A picture (.png), or a page to turn the points around in a browser (.html); - for stdout, which gets the picture.
    #[arg(short = 'o', long, value_name = "PATH")]
    pub out: PathBuf,
    /// Plot the waveform of this pulse, its echoes marked with their fitted widths; the number is the eighth column of
    /// point files.
    #[arg(long, value_name = "N")]
    pub pulse: Option<u64>,
    /// What colours the points.
    #[arg(long, value_enum, default_value = "height")]
    pub colour: Colour,
    /// Width of the picture in pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 1600)]
    pub width: u32,
    /// Height of the picture in pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 1000)]
    pub height: u32,
    /// Points that a page shows at most; of more, an even sample is taken. 500k is understood.
    #[arg(long, value_name = "N", default_value = "5M")]
    pub most_points: String,
    /// Overwrite a file that exists, and write a picture to a terminal.
    #[arg(long)]
    pub force: bool,
}

/// `vlscan completions`.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell.
    pub shell: clap_complete::Shell,
}

/// `vlscan man`.
#[derive(Debug, Args)]
pub struct ManArgs {
    /// The folder that gets the pages; pages of the same names are replaced.
    pub dir: PathBuf,
}
