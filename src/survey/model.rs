//! What a survey says, after every template, default and unit has been resolved. Angles are radians, lengths metres,
//! frequencies hertz, positions world coordinates.

use super::Formula;
use crate::diag::Place;
use crate::geom::{DVec3, Rotation};
use std::path::PathBuf;

/// A whole survey: the instrument, what carries it, where it goes and what it looks at.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Names the output folder.
    pub name: String,
    /// The file that was read.
    pub path: PathBuf,
    /// The seed that the survey itself asks for.
    pub seed: Option<u64>,
    /// What carries the scanner.
    pub platform: Platform,
    /// The instrument.
    pub scanner: Scanner,
    /// What is scanned; not loaded yet.
    pub scene: SceneRecipe,
    /// Legs in document order, inactive ones included.
    pub legs: Vec<Leg>,
    /// Mean and standard deviation (m) of a random vector added to each leg's position.
    pub leg_offset: Option<(f64, f64)>,
    /// Coordinate reference system of the world coordinates as WKT, when the input names one.
    pub crs_wkt: Option<String>,
}

/// Position and attitude of one frame within another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// Offset, m. The reference adds it in world axes, see spec kinematics §3.
    pub offset: DVec3,
    /// Rotation.
    pub rotation: Rotation,
}

impl Mount {
    /// No offset, no rotation.
    pub const IDENTITY: Mount = Mount { offset: DVec3::ZERO, rotation: Rotation::IDENTITY };
}

/// A platform (spec input-formats §7, kinematics §2).
#[derive(Clone, Debug)]
pub struct Platform {
    /// Asset id.
    pub id: String,
    /// How it moves.
    pub kind: PlatformKind,
    /// The scanner's pose on it.
    pub mount: Mount,
    /// Noise of its pose; a survey's elements have already replaced the platform's.
    pub noise: PlatformNoise,
}

/// The closed list of platforms.
#[derive(Clone, Debug)]
pub enum PlatformKind {
    /// Stands still at each leg.
    Static,
    /// Flies straight from waypoint to waypoint.
    LinearPath,
    /// Steers and accelerates towards waypoints on the ground.
    GroundVehicle {
        /// Drag coefficient per step.
        drag: f64,
    },
    /// Pitches, yaws and accelerates towards waypoints in the air.
    Multicopter(Multicopter),
    /// Follows recorded poses read from files, see [`TrajectoryFile`].
    Interpolated(Interpolated),
    /// Follows a stream of poses as they arrive; [`Survey::legs`] then has exactly one leg.
    Stream(PoseStream),
}

/// Parameters of a multicopter (spec kinematics §2.5.1).
#[derive(Clone, Debug, PartialEq)]
pub struct Multicopter {
    /// Drag coefficient per step.
    pub drag: f64,
    /// Horizontal engine force limit.
    pub engine_max_force: f64,
    /// Acceleration factor, 1/s.
    pub speedup: f64,
    /// Braking factor, 1/s.
    pub slowdown: f64,
    /// Pitch at rest, rad.
    pub base_pitch: f64,
    /// Pitch rate, rad/s.
    pub pitch_speed: f64,
    /// Roll rate, rad/s.
    pub roll_speed: f64,
    /// Yaw rate, rad/s.
    pub yaw_speed: f64,
    /// Largest deviation from the base pitch, rad.
    pub pitch_offset: f64,
    /// Largest roll, rad.
    pub roll_offset: f64,
}

/// How attitude angles of a trajectory compose (spec kinematics §2.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RotationSpec {
    /// `Rz(−yaw)∘Ry(roll)∘Rx(pitch)`: heading clockwise from north.
    Arinc705,
    /// `Rx(roll)∘Ry(pitch)∘Rz(yaw)`.
    Canonical,
}

/// Settings of an interpolated platform.
#[derive(Clone, Debug)]
pub struct Interpolated {
    /// Composition of the angles.
    pub rotation_spec: RotationSpec,
    /// Use positions only; the attitude stays identity.
    pub position_only: bool,
    /// The files' angles are degrees.
    pub degrees: bool,
    /// Start the GPS clock at the trajectory's time.
    pub sync_gps_time: bool,
    /// The distinct files in the order of first mention.
    pub files: Vec<TrajectoryFile>,
}

/// One trajectory file of an interpolated platform.
#[derive(Clone, Debug)]
pub struct TrajectoryFile {
    /// The file, already found.
    pub path: PathBuf,
    /// Zero-based columns of t, roll, pitch, yaw, x, y, z when the survey gives them; otherwise the file's header or order.
    pub columns: Option<[usize; 7]>,
    /// Column separator; `None` when the survey names none (a comma then, or blanks where no comma stands).
    pub separator: Option<char>,
    /// Slope filter threshold, 0 = off. Only the first file of a survey is filtered.
    pub slope_filter: f64,
}

/// Poses read from a stream (`--trajectory`).
#[derive(Clone, Debug)]
pub struct PoseStream {
    /// Where the poses come from; `-` is standard input.
    pub path: PathBuf,
    /// Composition of the angles.
    pub rotation_spec: RotationSpec,
    /// Angles are degrees.
    pub degrees: bool,
    /// Column names in order, when neither a header line nor the default order time,x,y,z,roll,pitch,yaw is meant.
    pub columns: Option<Vec<String>>,
    /// Column separator; `None` guesses from the first line.
    pub separator: Option<char>,
}

/// Noise of the platform's pose, per pulse (spec input-formats §2.10).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlatformNoise {
    /// Position x, y, z in metres, world axes.
    pub position: [Option<Noise>; 3],
    /// Attitude about the beam frame's x, y, z in radians.
    pub attitude: [Option<Noise>; 3],
}

/// One source of noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// Distribution.
    pub kind: NoiseKind,
    /// Limits to clamp to.
    pub clip: Option<(f64, f64)>,
    /// How many consecutive uses one drawn value serves; 0 = one unclipped value for ever.
    pub lifespan: u32,
}

/// Distribution of a noise source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoiseKind {
    /// Normal.
    Normal {
        /// Mean.
        mean: f64,
        /// Standard deviation.
        stdev: f64,
    },
    /// Uniform.
    Uniform {
        /// Lower end.
        min: f64,
        /// Upper end.
        max: f64,
    },
}

/// One leg as the survey lists it.
#[derive(Clone, Debug)]
pub struct Leg {
    /// Position among the survey's legs, from 0.
    pub number: u32,
    /// Legs with the same strip share their output files.
    pub strip: Option<String>,
    /// Where and how the platform goes.
    pub platform: PlatformSettings,
    /// What the scanner does.
    pub scanner: ScannerSettings,
    /// Where the leg stands in its file, for messages.
    pub place: Option<Place>,
}

/// Resolved platform settings of a leg (spec input-formats §2.4).
#[derive(Clone, Debug)]
pub struct PlatformSettings {
    /// World position of the leg's start.
    pub position: DVec3,
    /// Replace z by the ground height.
    pub on_ground: bool,
    /// Speed, m/s.
    pub speed: f64,
    /// Multicopter: stop and turn at the waypoint.
    pub stop_and_turn: bool,
    /// Multicopter: curve through the waypoint.
    pub smooth_turn: bool,
    /// Multicopter: brake before the waypoint.
    pub slowdown: bool,
    /// Multicopter with stop-and-turn: yaw to adopt, rad.
    pub yaw_at_departure: Option<f64>,
    /// Interpolated platforms: which part of which file.
    pub trajectory: Option<LegTrajectory>,
}

/// The part of a trajectory that a leg flies.
#[derive(Clone, Debug)]
pub struct LegTrajectory {
    /// Index into [`Interpolated::files`].
    pub file: usize,
    /// Start in the file's own time, s; `None` = first sample.
    pub start: Option<f64>,
    /// End in the file's own time, s; `None` = last sample.
    pub end: Option<f64>,
    /// Jump to the start instead of travelling there.
    pub teleport: bool,
}

/// Resolved scanner settings of a leg (spec input-formats §2.5–2.6; templates, the scanner's own values and the
/// resolution settings have been applied).
#[derive(Clone, Debug)]
pub struct ScannerSettings {
    /// Inactive legs emit nothing.
    pub active: bool,
    /// Pulses per second.
    pub pulse_freq: u32,
    /// Lines (rotating) or periods (oscillating) per second.
    pub scan_freq: f64,
    /// Half opening angle, rad; 0 = the device's maximum (rotating, conic, fibres).
    pub scan_angle: f64,
    /// Lower limit of deflection angles that fire, rad.
    pub vertical_min: Option<f64>,
    /// Upper limit.
    pub vertical_max: Option<f64>,
    /// Head speed, rad/s, signed, not yet limited by the device.
    pub head_rate: f64,
    /// Head start angle, rad.
    pub head_start: f64,
    /// Head stop angle, rad.
    pub head_stop: f64,
    /// Beam divergence of device 0, rad.
    pub beam_divergence: f64,
    /// Spacing of trajectory samples, s; 0 = none.
    pub trajectory_interval: f64,
    /// Ends the leg after that simulated time, s.
    pub max_duration: Option<f64>,
    /// Head and deflector advance that long before the first pulse, s.
    pub warmup: f64,
}

/// The instrument: one or more devices on one body.
#[derive(Clone, Debug)]
pub struct Scanner {
    /// Asset id.
    pub id: String,
    /// Display name.
    pub name: String,
    /// Supported pulse rates; the first is the default.
    pub pulse_freqs: Vec<u32>,
    /// Devices in firing order; at least one.
    pub devices: Vec<Device>,
    /// Whether the devices come from `<channels>` (such scanners never use the legacy energy model, spec pulse-physics §0.4).
    pub multi_channel: bool,
}

/// One device: deflector, head, optics, detector.
#[derive(Clone, Debug)]
pub struct Device {
    /// Reported id.
    pub id: String,
    /// Beam deflector.
    pub deflector: Deflector,
    /// Mechanical scan angle limit (half angle), rad.
    pub scan_angle_max: f64,
    /// Scan frequency limits, Hz; a maximum of 0 is no limit.
    pub scan_freq: (f64, f64),
    /// Scanner head.
    pub head: Head,
    /// The emitter's pose on the head.
    pub beam_origin: Mount,
    /// The laser.
    pub beam: Beam,
    /// The receiver.
    pub detector: Detector,
    /// Waveform digitisation.
    pub waveform: WaveformSettings,
    /// Calibration errors.
    pub errors: MechanicalErrors,
}

/// The closed list of deflectors (spec kinematics §4).
#[derive(Clone, Debug)]
pub enum Deflector {
    /// `rotating`: polygon mirror.
    Polygon {
        /// Usable half angle, rad.
        effective_max: f64,
    },
    /// `oscillating` mirror.
    Oscillating {
        /// Upper limit of half angle (degrees) × frequency (Hz).
        scan_product: f64,
    },
    /// `conic`: Palmer scanner.
    Conic,
    /// `line`: fibre array.
    Fibres {
        /// Number of fibres.
        count: u32,
    },
    /// `risley` prisms.
    Risley {
        /// Prisms in the order the beam meets them; those without a wedge are left out.
        prisms: Vec<Prism>,
        /// Refractive index of air.
        air: f64,
        /// Incoming beam, unit vector in the emitter frame.
        incident: DVec3,
    },
}

/// A rotating wedge prism.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prism {
    /// Turns per second, signed.
    pub rotor_freq: f64,
    /// Wedge angle, rad; positive: inclined face towards the incoming beam.
    pub angle: f64,
    /// Refractive index.
    pub index: f64,
}

/// A rotating head (spec kinematics §5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Head {
    /// Axis, any length.
    pub axis: DVec3,
    /// Largest speed, rad/s; 0 = cannot turn.
    pub max_rate: f64,
}

/// Emission (spec pulse-physics §0.1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Divergence, rad.
    pub divergence: f64,
    /// Pulse length, ns.
    pub pulse_length: f64,
    /// Wavelength, nm.
    pub wavelength: f64,
    /// Wavelength that the atmosphere was computed for, nm (a channel's override does not change it).
    pub atmosphere_wavelength: f64,
    /// Average power, W.
    pub average_power: f64,
    /// M².
    pub quality: f64,
    /// Optical efficiency.
    pub efficiency: f64,
    /// Receiver diameter, m.
    pub receiver_diameter: f64,
    /// Visibility, km.
    pub visibility: f64,
}

/// Detection (spec pulse-physics §0.1, §5.2).
#[derive(Clone, Debug)]
pub struct Detector {
    /// 1σ range noise, m.
    pub accuracy: f64,
    /// Nearest range, m.
    pub range_min: f64,
    /// Farthest range, m.
    pub range_max: f64,
    /// Most returns per pulse, 0 = unlimited.
    pub max_returns: u32,
    /// Detection threshold on the waveform.
    pub threshold: f64,
    /// Factor on the range noise as a function of the range in metres.
    pub distance_error: Option<Formula>,
}

/// Waveform digitisation (spec input-formats §2.11).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveformSettings {
    /// Bin width, ns.
    pub bin: f64,
    /// Peak search window, ns.
    pub window: f64,
    /// Number of concentric rings of subrays.
    pub quality: u32,
    /// Longest waveform, ns; 0 = unlimited.
    pub max_range: f64,
}

/// Calibration errors (spec input-formats §6.2).
#[derive(Clone, Debug, Default)]
pub struct MechanicalErrors {
    /// Metres added to every range, as a function of the exact deflection angle.
    pub range: Option<Formula>,
    /// Radians added to the deflection angle, polygon only.
    pub deflection: Option<Formula>,
    /// Radians added to the head angle, and the distance kept from multiples of π (rad), polygon only.
    pub head: Option<(Formula, f64)>,
}

impl MechanicalErrors {
    /// Whether any error is present; points are then reported along the exact direction.
    pub fn any(&self) -> bool {
        self.range.is_some() || self.deflection.is_some() || self.head.is_some()
    }
}

/// A scene as its file describes it; geometry is not loaded yet.
#[derive(Clone, Debug)]
pub struct SceneRecipe {
    /// Asset id.
    pub id: String,
    /// The file that holds it.
    pub path: PathBuf,
    /// Parts in document order.
    pub parts: Vec<PartRecipe>,
    /// Moving scenes: update every n-th pulse period.
    pub dyn_step: u32,
    /// The same in seconds, overrides all steps.
    pub dyn_time_step: Option<f64>,
    /// Folders that may hold a `spectra` folder, in search order.
    pub asset_folders: Vec<PathBuf>,
}

/// One part of a scene.
#[derive(Clone, Debug)]
pub struct PartRecipe {
    /// Explicit id, if any; otherwise parts are numbered.
    pub id: Option<String>,
    /// Running number of the part element in its scene, from 0 (a skipped part keeps its number).
    pub number: u32,
    /// What is loaded.
    pub loader: Loader,
    /// How it is placed.
    pub transform: Transform,
    /// Rigid motions; empty for a still part.
    pub motions: Vec<MotionSequence>,
    /// Motion timing.
    pub timing: MotionTiming,
    /// Geometry swaps between plays; empty for most parts.
    pub swaps: Vec<Swap>,
    /// Where the part stands in its file.
    pub place: Option<Place>,
}

/// `p′ = scale · R · p + offset`, then grounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// Accumulated rotation.
    pub rotation: Rotation,
    /// Last non-zero scale.
    pub scale: f64,
    /// Last offset, m.
    pub offset: DVec3,
    /// `onGround` mode of the translate filter (spec input-formats §3.4).
    pub on_ground: i64,
}

impl Transform {
    /// Leaves everything where it is.
    pub const IDENTITY: Transform =
        Transform { rotation: Rotation::IDENTITY, scale: 1.0, offset: DVec3::ZERO, on_ground: 0 };

    /// The image of `p`.
    pub fn apply(&self, p: DVec3) -> DVec3 {
        self.rotation.apply(p) * self.scale + self.offset
    }
}

/// Which axis of an OBJ file points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// z, nothing changes.
    Z,
    /// y: (x, y, z) is read as (x, −z, y).
    Y,
}

/// Materials of loaders that have none in their files (spec input-formats §3.5).
#[derive(Clone, Debug, Default)]
pub struct MaterialChoice {
    /// MTL file, already found.
    pub file: Option<PathBuf>,
    /// Material name; the alphabetically first one otherwise.
    pub name: Option<String>,
    /// Number of randomised variants.
    pub random_variants: u32,
    /// Range of the variation.
    pub random_range: f64,
}

/// The closed list of loaders (spec input-formats §4). Files are already found; several files come from `efilepath`.
#[derive(Clone, Debug)]
pub enum Loader {
    /// Wavefront OBJ.
    Obj {
        /// Files.
        files: Vec<PathBuf>,
        /// Up axis.
        up: UpAxis,
    },
    /// Terrain raster.
    GeoTiff {
        /// File.
        file: PathBuf,
        /// Material.
        material: MaterialChoice,
    },
    /// Point cloud to voxels.
    Xyz(Box<XyzLoader>),
    /// AMAPVox voxels.
    DetailedVoxels(Box<VoxelLoader>),
}

/// Settings of the point cloud loader (spec input-formats §4.4).
#[derive(Clone, Debug)]
pub struct XyzLoader {
    /// Files, each voxelised separately.
    pub files: Vec<PathBuf>,
    /// Every character separates columns; empty means blanks.
    pub separator: String,
    /// Edge length of a voxel, m.
    pub voxel_size: f64,
    /// Divisor of colours.
    pub max_color_value: f64,
    /// Normal of points without one.
    pub default_normal: Option<DVec3>,
    /// Colour columns.
    pub rgb_columns: Option<[usize; 3]>,
    /// Normal columns.
    pub normal_columns: Option<[usize; 3]>,
    /// Voxel normal is that of the point nearest to the centre.
    pub snap_neighbor_normal: bool,
    /// 0: none, 1: plane per voxel, 2 and more: the same in batches.
    pub estimate_normals: u32,
    /// Material.
    pub material: MaterialChoice,
}

/// How rays meet detailed voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VoxelMode {
    /// Exponential free path.
    Transmittive,
    /// Opaque cubes.
    Fixed,
    /// Opaque cubes scaled by density to this exponent.
    Scaled(f64),
}

/// Settings of the AMAPVox loader (spec input-formats §4.5).
#[derive(Clone, Debug)]
pub struct VoxelLoader {
    /// Files.
    pub files: Vec<PathBuf>,
    /// Interaction.
    pub mode: VoxelMode,
    /// Whether voxels without density are dropped (the mode was not spelled out).
    pub drop_empty: bool,
    /// `scaled`: random displacement within the original cell.
    pub random_shift: bool,
    /// Leaf angle table.
    pub lad_table: Option<PathBuf>,
    /// Material.
    pub material: MaterialChoice,
}

/// A sequence of rigid motions (spec input-formats §3.7).
#[derive(Clone, Debug)]
pub struct MotionSequence {
    /// Id within the part.
    pub id: String,
    /// Repetitions; 0 = for ever.
    pub loops: u32,
    /// Index of the sequence that follows.
    pub next: Option<usize>,
    /// Motions applied in this order at each step.
    pub motions: Vec<Motion>,
}

/// One rigid motion per update step.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// What it does.
    pub kind: MotionKind,
    /// About the part's own centroid instead of the scene origin.
    pub about_self: bool,
    /// Share of the scene shift to apply to centres and vectors.
    pub auto_crs: f64,
}

/// The closed list of motions; axes and normals are unit vectors, angles radians.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs)] // the fields are the motions' own mathematical names
pub enum MotionKind {
    Identity,
    Translation { by: DVec3 },
    Rotation { axis: DVec3, angle: f64, centre: Option<DVec3> },
    Reflection { normal: DVec3 },
    GlidePlane { normal: DVec3, shift: DVec3 },
    Helical { axis: DVec3, angle: f64, glide: f64 },
    RotaryReflection { axis: DVec3, angle: f64, centre: Option<DVec3> },
}

/// When a moving part moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionTiming {
    /// Move every n-th scene update.
    pub dyn_step: u32,
    /// Rebuild the tree every n-th move.
    pub tree_step: u32,
    /// `dyn_step` in seconds.
    pub dyn_time_step: Option<f64>,
    /// `tree_step` in seconds.
    pub tree_time_step: Option<f64>,
}

/// One state of a part between plays (spec input-formats §3.8).
#[derive(Clone, Debug)]
pub struct Swap {
    /// Number of plays it lasts.
    pub plays: u32,
    /// Keep the scene shift of the first play.
    pub keep_crs: bool,
    /// The part disappears.
    pub vanish: bool,
    /// New geometry, if the first filter is a loader.
    pub loader: Option<Loader>,
    /// New scale, if given.
    pub scale: Option<f64>,
    /// New offset and grounding mode, if given.
    pub offset: Option<(DVec3, i64)>,
}
