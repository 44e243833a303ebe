//! The survey model: a survey after every template, default and unit has been resolved. Angles are radians,
//! lengths metres, frequencies hertz, positions world coordinates.
//!
//! | file | what it does |
//! |---|---|
//! | `scene`, `mesh`, `raster` | parts of a scene: loaders, transforms, motions, swaps; meshes in memory; files of rasters |
//! | `identity` | identities of values in memory |
//! | `poses` | recorded trajectories |
//! | `navigation` | errors of navigation |
//! | `scan_motion` | sense, phase, tilt, wander and swing of deflectors |
//! | `pattern` | scan patterns of tables |
//! | `pulse_times` | times at which pulses leave, in place of a constant rate |
//! | `receiver` | pulse shape, noise and detector of a receiver |
//! | `weather` | fog, rain, snow and dust along the beam |

mod identity;
mod mesh;
mod navigation;
mod pattern;
mod poses;
mod pulse_times;
mod raster;
mod receiver;
mod scan_motion;
mod scene;
mod weather;

use super::{Formula, WrittenKey};
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_base::diag::Place;
use vlscan_geom::{DVec3, Rotation, radians};

pub use identity::{Identity, MaterialChanges};
pub use mesh::{
    ColourDefinition, MaterialChange, MaterialDefinition, Mesh, MeshColours, OpticsDefinition, Replaced,
    TextureDefinition, TextureImage, TextureWrap, UnusedOptics, WaterDefinition,
};
pub use navigation::{NavigationErrors, NavigationKeyError, NavigationProblem};
pub use pattern::{PatternBeam, PatternTable};
pub use poses::*;
pub use pulse_times::PulseTimes;
pub use raster::{PixelType, RasterFiles, VirtualRaster, VirtualSource};
pub use receiver::*;
pub use scan_motion::{AngleTable, ScanMotion, Swing, Wander};
pub use scene::*;
pub use weather::{AirState, Weather};

/// A complete survey: scanner, platform, legs and scene.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Name of the survey and of its output folder.
    pub name: String,
    /// The file that was read.
    pub path: PathBuf,
    /// The seed in the survey file, if there is one.
    pub seed: Option<u64>,
    /// The platform that carries the scanner.
    pub platform: Platform,
    /// The instrument.
    pub scanner: Scanner,
    /// The scanned scene; not loaded yet.
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
    /// Rotation from the axes of this frame to the axes of the frame that carries it.
    pub rotation: Rotation,
}

impl Mount {
    /// No offset and no rotation: both frames coincide.
    pub const IDENTITY: Mount = Mount { offset: DVec3::ZERO, rotation: Rotation::IDENTITY };
}

/// A platform (spec input-formats §7, kinematics §2).
#[derive(Clone, Debug)]
pub struct Platform {
    /// Id of the platform in its document, for messages.
    pub id: String,
    /// How the platform moves.
    pub kind: PlatformKind,
    /// Pose of the scanner on the platform.
    pub mount: Mount,
    /// Noise of the platform's pose. Noise elements of the survey have already replaced those of the
    /// platform.
    pub noise: PlatformNoise,
}

/// Kinds of platforms; no others exist.
#[derive(Clone, Debug)]
pub enum PlatformKind {
    /// Stationary at each leg.
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
    /// Follows recorded poses of files, see [`TrajectoryFile`].
    Interpolated(Interpolated),
    /// Follows a stream of poses while they arrive; [`Survey::legs`] then has exactly one leg.
    Stream(PoseStream),
}

impl PlatformKind {
    /// The type of the platform in XML.
    pub fn name(&self) -> &'static str {
        match self {
            PlatformKind::Static => "static",
            PlatformKind::LinearPath => "linearpath",
            PlatformKind::GroundVehicle { .. } => "groundvehicle",
            PlatformKind::Multicopter(_) => "multicopter",
            PlatformKind::Interpolated(_) => "interpolated",
            PlatformKind::Stream(_) => "stream",
        }
    }

    /// True if a platform of this kind can carry the scanner in a leg of a survey whose platform is `other`:
    /// it moves in the same way, or `other` follows poses, along which any platform can move.
    pub(super) fn can_fly_for(&self, other: &PlatformKind) -> bool {
        match (self, other) {
            (_, PlatformKind::Interpolated(_) | PlatformKind::Stream(_)) => true,
            (PlatformKind::Static, PlatformKind::Static) => true,
            (PlatformKind::LinearPath, PlatformKind::LinearPath) => true,
            (PlatformKind::GroundVehicle { drag: a }, PlatformKind::GroundVehicle { drag: b }) => a == b,
            (PlatformKind::Multicopter(a), PlatformKind::Multicopter(b)) => a == b,
            _ => false,
        }
    }
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
    /// Maximum deviation from the base pitch, rad.
    pub pitch_offset: f64,
    /// Maximum roll, rad.
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
    /// Composition of the attitude angles in the files.
    pub rotation_spec: RotationSpec,
    /// True if only positions are used and the attitude is the identity.
    pub position_only: bool,
    /// True if angles in the files are degrees.
    pub degrees: bool,
    /// True if the GPS clock starts at the trajectory's time.
    pub sync_gps_time: bool,
    /// The distinct files in the order of their first reference.
    pub files: Vec<TrajectoryFile>,
    /// The grid on which latitudes and longitudes are projected.
    pub grid: ProjectionGrid,
}

/// A trajectory file and how to read it.
#[derive(Clone, Debug)]
pub struct TrajectoryFile {
    /// Path of the file.
    pub path: PathBuf,
    /// Zero-based columns of t, roll, pitch, yaw, x, y, z. `None`: by the file's header or in the default
    /// order.
    pub columns: Option<[usize; 7]>,
    /// Column separator. `None` when the survey names none: a comma, or blanks in lines without a comma.
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

/// Random noise of one quantity, in the unit of that quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// Distribution of the values.
    pub kind: NoiseKind,
    /// Limits to which a value is clamped.
    pub clip: Option<(f64, f64)>,
    /// Number of consecutive uses of one drawn value; 0 = one unclipped value throughout.
    pub lifespan: u32,
}

/// Probability distributions of noise, in the unit of the noisy quantity.
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
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
    },
}

/// A leg of a survey: a waypoint or standpoint, with the settings from there on.
#[derive(Clone, Debug)]
pub struct Leg {
    /// Index among the survey's legs, from 0.
    pub number: u32,
    /// Legs with the same strip share their output files.
    pub strip: Option<String>,
    /// Settings of the platform.
    pub platform: PlatformSettings,
    /// Settings of the scanner.
    pub scanner: ScannerSettings,
    /// Place of the leg in its file, for messages.
    pub place: Option<Place>,
}

/// Resolved platform settings of a leg (spec input-formats §2.4).
#[derive(Clone, Debug)]
pub struct PlatformSettings {
    /// World position of the leg's start, m.
    pub position: DVec3,
    /// True if z is replaced by the ground height.
    pub on_ground: bool,
    /// Speed, m/s.
    pub speed: f64,
    /// True if the speed is written, and not the default.
    pub has_speed: bool,
    /// Multicopter: stop and turn at the waypoint.
    pub stop_and_turn: bool,
    /// Multicopter: curve through the waypoint.
    pub smooth_turn: bool,
    /// Multicopter: brake before the waypoint.
    pub slowdown: bool,
    /// Multicopter with stop-and-turn: yaw to adopt, rad.
    pub yaw_at_departure: Option<f64>,
    /// Interpolated platforms: the flown part of a trajectory file.
    pub trajectory: Option<LegTrajectory>,
    /// Mount of the scanner in this leg; `None`: the platform's.
    pub mount: Option<Mount>,
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
    /// True if the platform jumps to the start instead of travelling to it.
    pub teleport: bool,
}

/// Resolved scanner settings of a leg (spec input-formats §2.5–2.6): templates, the scanner's default values
/// and the resolution settings have been applied.
#[derive(Clone)]
pub struct ScannerSettings {
    /// True if the scanner fires; inactive legs emit no pulses.
    pub active: bool,
    /// Pulses per second; the rounded mean if `pulse_times` is given.
    pub pulse_freq: u32,
    /// Times at which pulses leave, in place of the constant rate.
    pub pulse_times: Option<PulseTimes>,
    /// Lines (rotating) or periods (oscillating) per second.
    pub scan_freq: f64,
    /// Half opening angle, rad; 0 = the device's maximum (rotating, conic, fibres).
    pub scan_angle: f64,
    /// Lower limit of the deflection angles that fire, rad.
    pub vertical_min: Option<f64>,
    /// Upper limit of the deflection angles that fire, rad.
    pub vertical_max: Option<f64>,
    /// Head speed, rad/s, signed, not yet limited by the device.
    pub head_rate: f64,
    /// Head start angle, rad.
    pub head_start: f64,
    /// Head stop angle, rad.
    pub head_stop: f64,
    /// Beam divergence of device 0, rad.
    pub beam_divergence: f64,
    /// Divergence that the leg specifies, rad, where the reference treats its value (0.003) as "not given".
    pub written_divergence: Option<f64>,
    /// Spacing of trajectory samples, s; 0 = none.
    pub trajectory_interval: f64,
    /// Simulated time after which the leg ends, s.
    pub max_duration: Option<f64>,
    /// Time for which head and deflector move before the first pulse, s.
    pub warmup: f64,
    /// Fog, rain, snow and dust along the beam.
    pub weather: Weather,
}

impl ScannerSettings {
    /// Sets the speed of the head, degrees per second, and the angles at which it starts and stops, degrees.
    pub fn set_head_turn_deg(&mut self, rate: f64, start: f64, stop: f64) {
        (self.head_rate, self.head_start, self.head_stop) = (radians(rate), radians(start), radians(stop));
    }

    /// Sets the half opening angle, degrees.
    pub fn set_scan_angle_deg(&mut self, angle: f64) {
        self.scan_angle = radians(angle);
    }

    /// Sets the deflection angles between which the scanner fires, degrees.
    pub fn set_vertical_limits_deg(&mut self, min: f64, max: f64) {
        (self.vertical_min, self.vertical_max) = (Some(radians(min)), Some(radians(max)));
    }

    /// Mean number of pulses per second.
    pub fn pulse_rate(&self) -> f64 {
        self.pulse_times.as_ref().map_or(f64::from(self.pulse_freq), PulseTimes::mean_rate)
    }
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
    /// True if the devices come from `<channels>`. Such scanners never use the legacy energy model (spec
    /// pulse-physics §0.4).
    pub multi_channel: bool,
    /// Keys in the user's files that some physics ignores.
    pub written: Vec<WrittenKey>,
    /// Sources of the instrument's figures.
    pub sources: Vec<FigureSource>,
    /// Rotation of the head in legs that do not set it; `None` if the head does not turn.
    pub turn: Option<HeadTurn>,
    /// Times at which pulses leave in legs that do not set them; `None`: at the first pulse rate.
    pub pulse_times: Option<PulseTimes>,
}

/// A turn of a head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadTurn {
    /// Speed, rad/s; negative is clockwise seen from above.
    pub rate: f64,
    /// Angle at which it starts, rad.
    pub start: f64,
    /// Angle at which it stops, rad.
    pub stop: f64,
}

/// The source of some figures of an instrument.
#[derive(Clone, Debug, PartialEq)]
pub struct FigureSource {
    /// Names of the attributes and children of its element that hold the figures.
    pub figures: Vec<String>,
    /// Title and edition.
    pub name: String,
}

/// One device: deflector, head, optics, detector.
#[derive(Clone, Debug)]
pub struct Device {
    /// Id in outputs.
    pub id: String,
    /// Deflector, which turns the beam within the head.
    pub deflector: Deflector,
    /// Sense, phase, tilt and wander of the deflector.
    pub scan_motion: ScanMotion,
    /// Mechanical scan angle limit (half angle), rad.
    pub scan_angle_max: f64,
    /// Scan frequency limits, Hz; a maximum of 0 means no limit.
    pub scan_freq: (f64, f64),
    /// Rotating head that carries the deflector.
    pub head: Head,
    /// The emitter's pose on the head.
    pub beam_origin: Mount,
    /// Time from the start of a firing cycle, which is a pulse period, to the pulse of this channel, s.
    pub firing_offset: f64,
    /// Emitted beam and its pulses.
    pub beam: Beam,
    /// Detection thresholds, range limits and range noise.
    pub detector: Detector,
    /// Pulse shape, noise and ranging of the receiver, for refined physics.
    pub receiver: Receiver,
    /// Digitisation of the received waveform.
    pub waveform: WaveformSettings,
    /// Place of the waveform's bins or window in the file.
    pub waveform_place: Option<WaveformPlace>,
    /// Calibration errors of range and angles.
    pub errors: MechanicalErrors,
    /// Figures of data sheets that pipelines use instead of those of HELIOS++'s catalogue.
    pub stated: StatedFigures,
}

/// Figures of an instrument of the built-in catalogue that differ from those of HELIOS++'s catalogue. XML
/// surveys keep the latter, so that their output does not change; pipelines use these
/// ([`Device::take_stated_figures`]).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StatedFigures {
    /// True for an instrument of the built-in catalogue.
    pub is_built_in: bool,
    /// Wavelength, nm.
    pub wavelength: Option<f64>,
    /// Full width of the pulse at half maximum, ns.
    pub pulse_width: Option<f64>,
    /// Minimum range, m.
    pub range_min: Option<f64>,
    /// Time after an echo during which no other one is detected, ns.
    pub dead_time: Option<f64>,
    /// Standard deviation of ranges, m.
    pub accuracy: Option<f64>,
    /// Beam divergence, rad; for an elliptical beam along the emitter's x axis.
    pub divergence: Option<f64>,
    /// The sources of these figures.
    pub sources: Vec<FigureSource>,
}

/// Place of the bins and the window of a waveform.
#[derive(Clone, Debug, PartialEq)]
pub struct WaveformPlace {
    /// File and position of the keys.
    pub place: Place,
    /// Names of the keys of bin and window in that file.
    pub keys: [&'static str; 2],
}

/// Kinds of deflectors (spec kinematics §4), and user-defined patterns.
#[derive(Clone, Debug)]
pub enum Deflector {
    /// `rotating`: polygon mirror.
    Polygon {
        /// Usable half angle, rad.
        effective_max: f64,
        /// Angles, rad, by which the facets turn the beam towards +x, along the mirror's axis, in the order
        /// in which they come into the beam: each line is a cone around the axis. Empty: all lines are plane.
        facet_tilts: Vec<f64>,
    },
    /// `oscillating` mirror.
    Oscillating {
        /// Upper limit of half angle (degrees) × frequency (Hz).
        scan_product: f64,
    },
    /// `conic`: Palmer scanner.
    Conic,
    /// `conic` with `scanAngleAlongMax_deg`: the cone is elliptic.
    EllipticConic {
        /// Largest half angle at right angles to the scan angle, rad.
        along_max: f64,
    },
    /// `line`: fibre array.
    Fibres {
        /// Number of fibres, scanned one after the other; 0 is taken as 1.
        count: u32,
    },
    /// `risley` prisms.
    Risley {
        /// Prisms in the order in which the beam passes them; flat ones without a wedge are left out.
        prisms: Vec<Prism>,
        /// Refractive index of air.
        air: f64,
        /// Incoming beam, unit vector in the emitter frame.
        incident: DVec3,
    },
    /// A pattern that a program defines. Files cannot describe it.
    Custom(Arc<dyn ScanPattern>),
    /// `pattern`: the beams of a table, one per step.
    Pattern(Arc<PatternTable>),
}

/// User-defined scan pattern: the direction of the beam as a function of time.
///
/// The pattern is evaluated repeatedly for equal times, by many threads and in any order, so it must be a
/// function of time alone: random numbers must follow from the time. Runs are deterministic then, as with
/// every other deflector.
///
/// `Debug` must distinguish different patterns: earlier results of a run are reused only for equal surveys.
///
/// ```
/// use vlscan_geom::DVec3;
/// use vlscan_survey::ScanPattern;
///
/// /// A spiral that opens to 20 degrees within a second, 50 turns per second.
/// #[derive(Debug)]
/// struct Spiral;
///
/// impl ScanPattern for Spiral {
///     fn direction(&self, time: f64) -> DVec3 {
///         let (turn, opening) = (std::f64::consts::TAU * 50.0 * time, time.fract() * 20f64.to_radians());
///         DVec3::new(opening.sin() * turn.cos(), opening.cos(), opening.sin() * turn.sin())
///     }
/// }
/// ```
pub trait ScanPattern: std::fmt::Debug + Send + Sync {
    /// The direction of the beam, of any length above 0, in the frame of the emitter: x to the right, y
    /// forward, z up. `time` is the time since the first step of the leg, s.
    ///
    /// A direction that is 0 or not finite ends the run with the error of [`ScanPattern::error`] if the beam
    /// fires at that time.
    fn direction(&self, time: f64) -> DVec3;

    /// Reason why the pattern has no direction at that time; without one, the error of the run describes the
    /// direction.
    fn error(&self, time: f64) -> Option<Box<dyn std::error::Error + Send + Sync>> {
        let _ = time;
        None
    }

    /// True if a pulse is emitted at that time.
    fn is_firing(&self, time: f64) -> bool {
        let _ = time;
        true
    }
}

/// A rotating wedge prism of a Risley deflector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prism {
    /// Turns per second, signed.
    pub rotor_freq: f64,
    /// Wedge angle, rad; positive: inclined face towards the incoming beam.
    pub angle: f64,
    /// Refractive index of the glass.
    pub index: f64,
}

/// A rotating head (spec kinematics §5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Head {
    /// Axis, of any length.
    pub axis: DVec3,
    /// Maximum speed, rad/s; 0 = cannot turn.
    pub max_rate: f64,
}

/// Emission (spec pulse-physics §0.1).
#[derive(Clone, Copy, PartialEq)]
pub struct Beam {
    /// Divergence, rad; for an elliptical beam along the emitter's x axis.
    pub divergence: f64,
    /// Divergence along the emitter's z axis, rad; `None` = round.
    pub divergence_y: Option<f64>,
    /// Distribution of the intensity across the beam, in refined physics.
    pub profile: BeamProfile,
    /// Beam diameter at the exit of the instrument, m; 0 = diffraction-limited.
    pub aperture: f64,
    /// Pulse length, ns, in the reference's measure.
    pub pulse_length: f64,
    /// Full width of the pulse at half maximum as stated in the data sheet of a built-in instrument, ns; the
    /// reference takes the same number as `pulse_length`, whose pulses are half as wide.
    pub stated_width: Option<f64>,
    /// Wavelength, nm.
    pub wavelength: f64,
    /// Wavelength for which the atmosphere is computed, nm (a channel's override does not change it).
    pub atmosphere_wavelength: f64,
    /// Average power, W.
    pub average_power: f64,
    /// Energy of a pulse, J; `None` = derived from the average power.
    pub pulse_energy: Option<f64>,
    /// M².
    pub quality: f64,
    /// Optical efficiency, a factor of the received power.
    pub efficiency: f64,
    /// Receiver diameter, m.
    pub receiver_diameter: f64,
    /// Overlap of transmitter and receiver near by; `None` = all light reaches the detector.
    pub overlap: Option<Overlap>,
    /// Visibility, km.
    pub visibility: f64,
}

impl Beam {
    /// Pulse length, ns, in the reference's measure: from the stated width, if there is one and `by_width` is
    /// set.
    pub fn length(&self, by_width: bool) -> f64 {
        let stated = self.stated_width.filter(|_| by_width);
        stated.map_or(self.pulse_length, pulse_length_of_width)
    }

    /// Takes the stated width, if there is one, as the width of the pulse in every physics.
    pub fn take_stated_width(&mut self) {
        self.pulse_length = self.length(true);
        self.stated_width = None;
    }
}

impl StatedFigures {
    /// True if stated figures have not been applied yet, so that those of HELIOS++'s catalogue apply.
    pub fn are_left(&self) -> bool {
        let times = [self.pulse_width, self.dead_time];
        let others = [self.wavelength, self.range_min, self.accuracy, self.divergence];
        times.iter().chain(&others).any(Option::is_some)
    }
}

impl Device {
    /// Applies the stated figures of an instrument of the built-in catalogue, in every physics.
    pub fn take_stated_figures(&mut self) {
        let (is_built_in, sources) = (self.stated.is_built_in, self.stated.sources.clone());
        let taken = StatedFigures { is_built_in, sources, ..StatedFigures::default() };
        let stated = std::mem::replace(&mut self.stated, taken);
        if let Some(wavelength) = stated.wavelength {
            (self.beam.wavelength, self.beam.atmosphere_wavelength) = (wavelength, wavelength);
        }
        self.beam.stated_width = stated.pulse_width.or(self.beam.stated_width);
        self.beam.take_stated_width();
        self.beam.divergence = stated.divergence.unwrap_or(self.beam.divergence);
        self.detector.accuracy = stated.accuracy.unwrap_or(self.detector.accuracy);
        self.detector.range_min = stated.range_min.unwrap_or(self.detector.range_min);
        self.receiver.dead_time = stated.dead_time.unwrap_or(self.receiver.dead_time);
    }
}

/// Diameter (m) of a beam at a range (m): sqrt(d² + (R·γ)²) with the diameter d at the exit of the instrument
/// (m) and the full divergence γ (rad), the far field of a Gaussian beam.
pub fn footprint(aperture: f64, divergence: f64, range: f64) -> f64 {
    libm::hypot(aperture, range * divergence)
}

/// Detection (spec pulse-physics §0.1, §5.2).
#[derive(Clone, Debug)]
pub struct Detector {
    /// 1σ range noise, m.
    pub accuracy: f64,
    /// Minimum range, m.
    pub range_min: f64,
    /// Maximum range, m.
    pub range_max: f64,
    /// Maximum number of returns per pulse, 0 = unlimited.
    pub max_returns: u32,
    /// Detection threshold on the waveform, W.
    pub threshold: f64,
    /// True if the instrument specifies its threshold. Otherwise it is a default, which the reference
    /// compares with nanowatts.
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
    /// Maximum length of a waveform, ns; 0 = unlimited.
    pub max_range: f64,
}

/// Calibration errors (spec input-formats §6.2).
#[derive(Clone, Debug, Default)]
pub struct MechanicalErrors {
    /// Metres added to every range, as a function of the deflection angle without errors.
    pub range: Option<Formula>,
    /// Radians added to the deflection angle, polygon only.
    pub deflection: Option<Formula>,
    /// Radians added to the head angle, and the minimum distance from multiples of π (rad), polygon only.
    pub head: Option<(Formula, f64)>,
}

impl MechanicalErrors {
    /// True if any error is present; points are then reported along the direction without errors.
    pub fn any(&self) -> bool {
        self.range.is_some() || self.deflection.is_some() || self.head.is_some()
    }
}
