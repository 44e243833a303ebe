//! What a survey says, after every template, default and unit has been resolved. Angles are radians, lengths metres,
//! frequencies hertz, positions world coordinates.
//!
//! | file | what it does |
//! |---|---|
//! | `scene` | parts of a scene: loaders, transforms, motions, swaps |
//! | `poses` | recorded trajectories |
//! | `navigation`, `kinematics` | errors of navigation; departures from the reference's kinematics |
//! | `receiver` | pulse shape, noise and detector of a receiver |

mod kinematics;
mod navigation;
mod poses;
mod receiver;
mod scene;

use super::Formula;
use crate::diag::Place;
use crate::geom::{DVec3, Rotation};
use std::path::PathBuf;

pub use kinematics::Kinematics;
pub use navigation::NavigationErrors;
pub use poses::*;
pub use receiver::*;
pub use scene::*;

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
    /// The grid to which latitudes and longitudes are projected.
    pub grid: Grid,
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
    /// How many consecutive uses one drawn value serves; 0 = one unclipped value throughout.
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
    /// Divergence that the leg asks for, rad, where the reference takes its value for "not given" (0.003).
    pub written_divergence: Option<f64>,
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
    /// Detection.
    pub detector: Detector,
    /// The receiver.
    pub receiver: Receiver,
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
    /// Divergence, rad; of an elliptical beam the one along the emitter's x axis.
    pub divergence: f64,
    /// Divergence along the emitter's z axis, rad; `None` = round.
    pub divergence_y: Option<f64>,
    /// Profile.
    pub profile: BeamProfile,
    /// Diameter where the beam leaves the instrument, m; 0 = as small as diffraction allows.
    pub aperture: f64,
    /// Pulse length, ns.
    pub pulse_length: f64,
    /// Wavelength, nm.
    pub wavelength: f64,
    /// Wavelength that the atmosphere was computed for, nm (a channel's override does not change it).
    pub atmosphere_wavelength: f64,
    /// Average power, W.
    pub average_power: f64,
    /// Energy of a pulse, J; `None` = by the average power.
    pub pulse_energy: Option<f64>,
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
    /// Detection threshold on the waveform, W.
    pub threshold: f64,
    /// Whether the instrument names its threshold; else it is a default that the reference compares with nanowatts.
    pub threshold_given: bool,
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
