//! Scanners: deflectors and heads, beams, detection.

use super::pattern::PatternTable;
use super::platform::Mount;
use super::pulse_times::PulseTimes;
use super::receiver::{BeamProfile, Overlap, Receiver, pulse_length_of_width};
use super::scan_motion::ScanMotion;
use crate::{Formula, WrittenKey};
use std::sync::Arc;
use vlscan_base::diag::Place;
use vlscan_geom::DVec3;

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
    /// Title and edition; [`FigureSource::NOT_VERIFIED`] and a remark for figures without one.
    pub name: String,
}

impl FigureSource {
    /// Beginning of the name of a source that is none.
    pub const NOT_VERIFIED: &str = "not verified";
    /// Name of the source of a pulse length that an entry of the built-in catalogue leaves out.
    pub const DEFAULT_PULSE_LENGTH: &str = "not verified: default of the catalogue, 4 ns, in no data sheet";

    /// True if the name is that of a source.
    pub fn is_verified(&self) -> bool {
        !self.name.starts_with(Self::NOT_VERIFIED)
    }
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
