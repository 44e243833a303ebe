//! The groups of options.

use super::choice::choice;
use super::outputs::OutputKeys;
use super::precedence::group;
use super::switch::Switch;
use super::trajectory::TrajectoryOptions;
use super::values::{
    Bytes, ChunkSize, ColumnList, Count, Crs, GpsStart, MaxOrder, NavigationError, NotNegative, Positive,
    Seed, WarehouseFactor, number, whole,
};
use clap::ArgAction::SetTrue;
use clap::Args;
use serde::{Deserialize, Deserializer};
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_base::error::{Error, Result};
use vlscan_lidar::pulse::{Corrections, PhysicsProfile};
use vlscan_scene::Sharing;
use vlscan_session::output::{ExtraDimensions, PacketPlace, PointFormat};
use vlscan_survey::SceneRecipe;
use vlscan_trace::Builder;
use vlscan_warehouse::PolicyKind;

group! {
/// All options of a run.
#[derive(Clone, Debug, Default, Args)]
pub struct Options {
    /// Points and what is written beside them.
    #[command(flatten)]
    pub output: OutputOptions,
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
    /// Departures from the reference's physics and kinematics.
    #[command(flatten)]
    pub profile: ProfileOptions,
    /// Detection of echoes.
    #[command(flatten)]
    pub echoes: EchoOptions,
    /// The tree over the scene.
    #[command(flatten)]
    pub tree: TreeOptions,
    /// Write the platform's poses as often as the survey's trajectoryTimeInterval_s asks for (CSV, as
    /// --trajectory reads it).
    #[arg(long, value_name = "PATH", help_heading = "Output")]
    pub trajectory_out: Option<PathBuf>,
    /// Write a table of the scene's parts as CSV: number of the object in the points, id, name, class,
    /// materials, position, height and number of points.
    #[arg(long = "parts", value_name = "PATH", help_heading = "Output")]
    pub part_table: Option<PathBuf>,
    /// True if pulses of a stream are traced instead of a flight.
    #[arg(skip)]
    pub is_traced: bool,
    /// A scene in memory, which replaces that of the survey.
    #[arg(skip)]
    pub scene: Option<Arc<SceneRecipe>>,
    /// Trajectories in memory by the names that legs in XML give as their files.
    #[arg(skip)]
    pub named_trajectories: Vec<(String, Arc<[u8]>)>,
    /// Outputs of a pipeline file, which those of the command line replace.
    #[arg(skip)]
    pub outputs: Vec<OutputKeys>,
    /// True if a pipeline file describes a flight of its own, whose kinematics are always the corrected ones.
    #[arg(skip)]
    pub has_own_flight: bool,
}
}

/// Heading of the options that say how files of points are written; a run that writes none takes none of
/// them.
pub const FILES: &str = "Output files";

group! {
/// Points and what is written beside them.
#[derive(Clone, Debug, Default, Args, Deserialize)]
#[command(next_help_heading = "Output")]
#[serde(default)]
pub struct OutputOptions with opposites {
    /// Output: a file, a folder (one file per leg), or - for stdout.
    ///
    /// The extension of a file determines its format; all legs and epochs go into one file. May be given more
    /// than once.
    #[arg(short = 'o', long = "out", value_name = "PATH")]
    #[serde(skip)]
    pub out: Vec<PathBuf>,
    /// Format of the points where the extension does not determine it.
    #[arg(long, value_name = "FORMAT", help_heading = FILES, value_parser = choice::<PointFormat>())]
    #[serde(skip)]
    pub format: Option<PointFormat>,
    /// Write as HELIOS++ does: DIR/SURVEY/TIME/leg000_points.xyz and so on. [default without -o: output]
    #[arg(long, value_name = "DIR", conflicts_with = "out")]
    #[serde(skip)]
    pub output: Option<PathBuf>,
    /// Replace existing files once the new ones are complete.
    ///
    /// If the run fails or is interrupted, existing files are kept, and partial results go to
    /// NAME.partial.EXT. Also write binary data to a terminal.
    #[arg(long, action = SetTrue, help_heading = FILES)]
    pub force: Switch,
    /// Write every digitised waveform, beside the first output that is a file or folder.
    #[arg(long, action = SetTrue)]
    pub waveforms: Switch,
    /// Write every emitted pulse, beside the first output that is a file or folder.
    #[arg(long, action = SetTrue)]
    pub pulses: Switch,
    /// Columns of csv, arrow, parquet and geoparquet, and of xyz (which then gets a header), such as
    /// X,Y,Z,Intensity,GpsTime. With Red, Green or Blue, las, laz, ply, pcd, e57 and mcap have colours, too.
    /// docs/outputs.md lists all columns, as does the message for an unknown name.
    #[arg(long, value_name = "NAMES")]
    pub columns: Option<ColumnList>,
    /// Also write part, primitive and true range to las, laz and ply; csv, arrow, parquet and geoparquet
    /// always have them.
    #[arg(long, action = SetTrue, help_heading = FILES)]
    pub labels: Switch,
    /// Also write positions without navigation errors (TrueX, TrueY, TrueZ) to las and laz; for csv, arrow
    /// and parquet use --columns.
    #[arg(long, action = SetTrue)]
    pub true_positions: Switch,
    /// Write the height above ground (HeightAboveGround), also to las, laz and ply. Ground is every surface
    /// whose material is ground (helios_isGround), or the lowest surfaces if the scene has no such material.
    #[arg(long, action = SetTrue)]
    pub height_above_ground: Switch,
    /// Duration of the frames of mcap. [default: a revolution of a spinning scanner, 0.1 for others]
    #[arg(long, value_name = "SECONDS", help_heading = FILES)]
    pub frame_s: Option<Positive>,
    /// Coordinate frame of mcap in which the scanner moves. [default: map]
    #[arg(long, value_name = "NAME", help_heading = FILES)]
    pub world_frame: Option<String>,
    /// Coordinate frame of the scanner in mcap. [default: lidar]
    #[arg(long, value_name = "NAME", help_heading = FILES)]
    pub sensor_frame: Option<String>,
    /// Divide the points of a folder (-o DIR) into square tiles with this edge length in metres, tile_X_Y,
    /// instead of legs.
    #[arg(long, value_name = "METRES", conflicts_with = "per_object", help_heading = FILES)]
    pub tile: Option<Positive>,
    /// Divide the points of a folder (-o DIR) by the object that was hit, object_N, instead of legs.
    #[arg(long, action = SetTrue, help_heading = FILES)]
    pub per_object: Switch,
    /// Write what each subray hit instead of points, at its position on the surface, with the number of the
    /// return that it contributes to (0 = none): for leaf area and machine learning. --columns selects
    /// Subray, SurfaceX, NormalX, FootprintFraction and so on, with or without this option.
    #[arg(long, action = SetTrue)]
    pub subrays: Switch,
    /// Also write pulses without echoes: 0 returns, at the beam's origin, with the beam's direction.
    #[arg(long, action = SetTrue)]
    pub misses: Switch,
    /// Stream LAS to a pipe without a temporary file, with N as the number of points in its header (250k,
    /// 1G). Most readers accept fewer points; more are an error.
    #[arg(long, value_name = "N", help_heading = FILES)]
    pub las_at_most: Option<Count<1>>,
    /// Write waveforms as packets that the points of LAS and LAZ refer to (LAS 1.4, point format 9), inside
    /// that file or beside it as .wdp.
    #[arg(long, value_name = "WHERE", help_heading = FILES, value_parser = choice::<PacketPlace>())]
    pub wave_packets: Option<PacketPlace>,
    /// One point file per device of a multi-channel scanner.
    #[arg(long, action = SetTrue, help_heading = FILES)]
    pub split_by_channel: Switch,
    /// Coordinate reference system of the scene: EPSG:25832, WKT, or a file that holds either.
    ///
    /// It goes into LAS, LAZ, PLY, Arrow, Parquet and GeoParquet. [default: that of the scene's GeoTIFF or
    /// .prj files, else the UTM zone of a projected flight]
    #[arg(long, value_name = "EPSG:N|WKT|FILE")]
    pub crs: Option<Crs>,
    /// With --output: LAS 1.4 instead of text.
    #[arg(long, action = SetTrue, help_heading = FILES)]
    pub las_output: Switch,
    /// LAS 1.0 instead of 1.4; with --output also instead of text.
    #[arg(long, action = SetTrue, help_heading = FILES)]
    pub las10: Switch,
    /// Waveforms and pulses as compressed text (.bin); with --output also LAZ instead of LAS, and compressed
    /// text instead of text.
    #[arg(long, action = SetTrue, help_heading = FILES)]
    pub zip_output: Switch,
    /// Resolution of LAS coordinates in metres. [default: 0.0001, coarser if the scene is too wide for it]
    #[arg(long, value_name = "METRES", help_heading = FILES, value_parser = number)]
    pub las_scale: Option<f64>,
    /// Extra bytes of the points of LAS and LAZ: all, the four of HELIOS++, or none, for programs that reject
    /// them. [default: all]
    #[arg(long, value_name = "WHICH", help_heading = FILES, value_parser = choice::<ExtraDimensions>())]
    pub las_extra: Option<ExtraDimensions>,
}
}

group! {
/// Input files.
#[derive(Clone, Debug, Default, Args, Deserialize)]
#[command(next_help_heading = "Input")]
#[serde(default)]
pub struct InputOptions with opposites {
    /// Replace the scene: a packed scene (.vlscene), file.xml#id, or a geometry file.
    #[arg(long, value_name = "SCENE")]
    #[serde(skip)]
    pub scene: Option<String>,
    /// Leave out OBJ faces with more than four corners, as HELIOS++ does.
    #[arg(long, action = SetTrue)]
    pub drop_polygons: Switch,
    /// Folder to look for scenes, scanners, platforms, geometry and spectra in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// Treat every warning about the input as an error.
    #[arg(long, action = SetTrue)]
    pub strict: Switch,
}
}

group! {
/// Errors of navigation.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Simulation")]
pub struct NavigationOptions {
    /// Add navigation errors: the reported pose, with which points are georeferenced, differs from the true
    /// one. A key of [navigation_errors] of pipeline files with one number or three, such as
    /// position_m=0.02,0.02,0.05, attitude_deg=0.004, boresight_deg=0,0.01,0; may be given more than once.
    #[arg(long = "navigation-error", value_name = "KEY=NUMBERS")]
    pub errors: Vec<NavigationError>,
}
}

group! {
/// Noise of platform and legs.
#[derive(Clone, Debug, Default, Args, Deserialize)]
#[command(next_help_heading = "Simulation")]
#[serde(default)]
pub struct NoiseOptions with opposites {
    /// Ignore the platform's position and attitude noise.
    #[arg(id = "platform_noise", long = "no-platform-noise", action = SetTrue)]
    #[serde(rename = "platform_noise", deserialize_with = "negated")]
    pub no_platform_noise: Switch,
    /// Ignore the survey's random leg offsets.
    #[arg(id = "leg_noise", long = "no-leg-noise", action = SetTrue)]
    #[serde(rename = "leg_noise", deserialize_with = "negated")]
    pub no_leg_noise: Switch,
}
}

/// Keys say that a noise is on, options that it is off.
fn negated<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Switch, D::Error> {
    Switch::deserialize(deserializer).map(Switch::negated)
}

group! {
/// Seed of the random draws and start of the clock.
#[derive(Clone, Debug, Default, Args, Deserialize)]
#[command(next_help_heading = "Simulation")]
#[serde(default)]
pub struct OriginOptions {
    /// Seed of all noise: an integer, a decimal number or "YYYY-MM-DD hh:mm:ss". [default: the survey's, else
    /// 0]
    #[arg(long, value_name = "SEED")]
    pub seed: Option<Seed>,
    /// Start of the GPS clock: "YYYY-MM-DD hh:mm:ss" (UTC), POSIX seconds, or "now". [default: 2024-01-01
    /// 00:00:00]
    #[arg(long, value_name = "TIME")]
    pub gps_start: Option<GpsStart>,
}
}

group! {
/// Departures from the physics and kinematics of HELIOS++.
#[derive(Clone, Debug, Default, Args, Deserialize)]
#[command(next_help_heading = "Simulation")]
#[serde(default)]
pub struct ProfileOptions {
    /// Reproduce HELIOS++, or correct its known weaknesses. [default: helios for XML surveys, refined for
    /// pipeline files]
    #[arg(
        id = "profile",
        long = "physics",
        value_name = "PROFILE",
        value_parser = choice::<PhysicsProfile>(),
    )]
    #[serde(alias = "physics")]
    pub profile: Option<PhysicsProfile>,
    /// Switch single corrections on (sum-equal-ranges) or off (no-sum-equal-ranges). They are listed at the
    /// end of --help.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    pub correct: Vec<String>,
}
}

impl ProfileOptions {
    /// The corrections of the profile, of XML surveys unless one is chosen, with those that are on in any
    /// profile, and then what is switched by name.
    ///
    /// # Errors
    /// A name that no correction has.
    pub fn corrections(&self, in_any: Corrections) -> Result<Corrections> {
        let mut corrections = self.profile.unwrap_or(PhysicsProfile::OF_SURVEYS).corrections().or(in_any);
        for name in &self.correct {
            corrections.switch(name).map_err(|e| Error::input(format!("--correct: {e}")))?;
        }
        Ok(corrections)
    }
}

group! {
/// Detection of echoes.
#[derive(Clone, Debug, Default, Args, Deserialize)]
#[command(next_help_heading = "Simulation")]
#[serde(default)]
pub struct EchoOptions with opposites {
    /// Fit a Gaussian to every echo and report its width; echoes narrower than 0.1 ns are dropped.
    #[arg(long, action = SetTrue)]
    pub echo_width: Switch,
    /// Add noise to the written waveforms.
    #[arg(long, action = SetTrue)]
    pub waveform_noise: Switch,
    /// Treat every surface as hit at right angles.
    #[arg(long, action = SetTrue)]
    pub fixed_incidence: Switch,
    /// Compute echo strengths with the older energy model.
    #[arg(long, action = SetTrue)]
    pub legacy_energy: Switch,
    /// Maximum number of mirrors, panes and surfaces of water on the way of light, 0 to 64; with 0 they are
    /// opaque. [default: 4]
    #[arg(long, value_name = "N")]
    pub max_order: Option<MaxOrder>,
}
}

group! {
/// Threads and chunks; the points are the same.
#[derive(Clone, Debug, Default, Args, Deserialize)]
#[command(next_help_heading = "Speed")]
#[serde(default)]
pub struct ScheduleOptions with opposites {
    /// Number of threads; 0 = all, the default. Does not change the points.
    #[arg(short = 'j', long, value_name = "N", value_parser = whole::<usize>)]
    pub threads: Option<usize>,
    /// Pulses per chunk. [default: 1024]
    #[arg(long, value_name = "N")]
    pub chunk_size: Option<ChunkSize>,
    /// Chunks per worker that may wait in the queue. [default: 4]
    #[arg(long, value_name = "N")]
    pub warehouse_factor: Option<WarehouseFactor>,
    /// How pulses are handed out to the threads; the points are the same. [default: warehouse]
    #[arg(id = "policy", long = "schedule", value_name = "SCHEDULE", value_parser = choice::<PolicyKind>())]
    #[serde(alias = "schedule")]
    pub policy: Option<PolicyKind>,
    /// Dynamic chunks: idle times shorter than this are ignored, in milliseconds. [default: 0.1]
    #[arg(id = "idle_threshold_ms", long = "idle-threshold", value_name = "MS")]
    #[serde(rename = "idle_threshold_ms", alias = "idle_threshold")]
    pub idle_threshold: Option<NotNegative>,
    /// Begin a leg only when the previous one is finished, as in the paper; slower.
    #[arg(long, action = SetTrue)]
    pub leg_barrier: Switch,
    /// Write what the schedule did as JSON: idle times, queue depths, chunk sizes, leg ends. --force replaces
    /// an existing file.
    #[arg(long, value_name = "FILE")]
    pub schedule_log: Option<PathBuf>,
    /// Reject scenes that need more memory than this, e.g. 4G. [default: the memory of the machine]
    #[arg(long, value_name = "SIZE")]
    pub max_memory: Option<Bytes>,
    /// Load the parts of the scene when rays come near, and drop them when they need more memory than this
    /// together with their trees, e.g. 2G; does not change the points. [default: the scene is loaded whole]
    #[arg(long, value_name = "SIZE")]
    pub scene_memory: Option<Bytes>,
    /// Show progress as plain lines if stderr is not a terminal.
    #[arg(long, action = SetTrue, help_heading = "Messages")]
    #[serde(skip)]
    pub progress: Switch,
}
}

group! {
/// The tree over the scene; the points are the same.
#[derive(Clone, Debug, Default, Args, Deserialize)]
#[command(next_help_heading = "Speed")]
#[serde(default)]
pub struct TreeOptions {
    /// Acceleration structure for tracing; does not change the points. [default: bvh]
    #[arg(long, value_name = "TREE", value_parser = choice::<Builder>())]
    pub tree: Option<Builder>,
    /// Threads that build the tree; 0 = as --threads, the default.
    #[arg(long, value_name = "N", value_parser = whole::<usize>)]
    pub tree_jobs: Option<usize>,
    /// Share triangles among parts of the same mesh file; does not change the points. [default: auto]
    #[arg(long, value_name = "WHEN", value_parser = choice::<Sharing>())]
    pub instances: Option<Sharing>,
}
}
