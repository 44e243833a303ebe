//! The keys of a pipeline file that describe the survey; keys that are also options of a run are in `options`.
//! Unknown keys are errors; omitted keys have the default that their documentation states.

use super::super::{BeamProfile, Ranging, UpAxis};
use serde::Deserialize;
use toml::Spanned;

/// The documentation of a table of a pipeline file.
#[derive(Clone, Copy, Debug)]
pub struct KeyTable {
    /// Its header; empty for the keys at the top of the file.
    pub name: &'static str,
    /// Name of the type that it is read into.
    pub type_name: &'static str,
    /// What it describes.
    pub about: &'static str,
    /// Names and meanings of its keys.
    pub keys: &'static [(&'static str, &'static str)],
}

/// Defines a table of a pipeline file: the struct, and its documentation as a constant.
#[macro_export]
macro_rules! key_table {
    (
        $(#[doc = $about:literal])+
        #[derive($($derive:ident),*)]
        #[serde($($serde:tt)*)]
        pub struct $name:ident = $table:literal {
            $($(#[doc = $doc:literal])+ $(#[serde($($attribute:tt)*)])? pub $field:ident: $type:ty,)*
        }
    ) => {
        $(#[doc = $about])+
        #[derive($($derive),*)]
        #[serde($($serde)*)]
        pub struct $name {
            $($(#[doc = $doc])+ $(#[serde($($attribute)*)])? pub $field: $type,)*
        }

        impl $name {
            /// Names and meanings of the keys.
            pub const TABLE: $crate::KeyTable = $crate::KeyTable {
                name: $table,
                type_name: stringify!($name),
                about: concat!($($about, "\n"),+),
                keys: &[$((stringify!($field), concat!($($doc, "\n"),+))),*],
            };
        }
    };
}
/// Documentation of all tables of a pipeline file that describe the survey.
pub const SURVEY_TABLES: [KeyTable; 14] = [
    SurveyKeys::TABLE,
    PartKeys::TABLE,
    MaterialKeys::TABLE,
    PlatformKeys::TABLE,
    InstrumentKeys::TABLE,
    PrismKeys::TABLE,
    TargetKeys::TABLE,
    RatioKeys::TABLE,
    SettingsKeys::TABLE,
    LegKeys::TABLE,
    WaveformKeys::TABLE,
    DetectorKeys::TABLE,
    PoseKeys::TABLE,
    AxisKeys::TABLE,
];

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Optics {
    /// Polygon mirror.
    Rotating,
    /// Oscillating mirror.
    Oscillating,
    /// Mirror on a slanted axis.
    Conic,
    /// Array of fibres.
    Line,
    /// Rotating wedge prisms.
    Risley,
}

/// Kinds of motion of a platform.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Movement {
    /// Stationary.
    Static,
    /// Flies straight from leg to leg.
    LinearPath,
}

/// An optional key with its place in the file.
pub type Key<T> = Option<Spanned<T>>;

key_table! {
/// A pipeline file.
///
/// A run starts either from `survey`, or from `scene` with `[scanner]` and a way to move: `[trajectory]`, or `[platform]`
/// with `[[leg]]` tables. Tables that stand beside `survey` replace or change what the survey says. Paths of input files
/// are relative to the pipeline file (then the asset folders are searched); paths of outputs are relative to the working
/// directory.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SurveyKeys = "" {
    /// Survey XML file to start from.
    pub survey: Key<String>,
    /// What is scanned: `file.xml#id`, `file.xml` (its first scene), a geometry file (.obj, .tif, .vox), a table of
    /// instances (.csv) or a packed scene (.vlscene).
    pub scene: Key<String>,
    /// Parts of the scene, instead of `scene`.
    pub part: Vec<Spanned<PartKeys>>,
    /// Name of the run; it names the output folder. Default: the file's name without extension.
    pub name: Option<String>,
    /// What carries the scanner.
    pub platform: Option<Spanned<PlatformKeys>>,
    /// The instrument.
    pub scanner: Option<Spanned<InstrumentKeys>>,
    /// What the scanner does; with `[[leg]]` tables, what holds for all of them.
    pub settings: Option<Spanned<SettingsKeys>>,
    /// Waypoints of a platform that does not follow a trajectory.
    pub leg: Vec<Spanned<LegKeys>>,
    /// Waveform digitisation, for all channels.
    pub waveform: Option<WaveformKeys>,
    /// Detection, for all channels.
    pub detector: Option<DetectorKeys>,
}
}

key_table! {
/// `[[part]]`: a geometry file and where it stands. A point goes to `scale` times the rotated point plus `position_m`. Parts
/// that name the same mesh share it.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PartKeys = "[[part]]" {
    /// Geometry file: a mesh (.obj, .ply, .stl, .gltf, .glb), a terrain raster (.tif) or vegetation voxels (.vox).
    pub file: Key<String>,
    /// What points report as the id of the object. Default: the number of the part, from 0.
    pub id: Option<String>,
    /// Axis of a mesh that points up, `z` or `y`. Default: `y` for glTF, `z` for other meshes.
    pub up: Key<UpAxis>,
    /// Unit of the coordinates of a mesh: `m`, `cm`, `mm`, `km`, `ft`, `us-ft`, `in`, or a number of metres. Default: `m`.
    pub unit: Key<String>,
    /// Table of the materials of a mesh by name. Default: `materials.csv` beside it, if it is no OBJ file.
    pub materials: Key<String>,
    /// Scale. Default: 1.
    pub scale: Key<f64>,
    /// Rotations in degrees, one axis each: `[{ z = 90 }]`. Default: none.
    pub rotate_deg: Vec<Spanned<AxisKeys>>,
    /// World position x, y, z of the file's origin in metres. Default: 0.
    pub position_m: Key<[f64; 3]>,
    /// Lower or lift the part to the ground below it. Default: false.
    pub on_ground: bool,
    /// Materials that replace those of the file: tables `[[part.material]]`, in this order.
    pub material: Vec<Spanned<MaterialKeys>>,
}
}

key_table! {
/// `[[part.material]]`: a material instead of those of a part's file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MaterialKeys = "[[part.material]]" {
    /// Name of the material that is replaced. Default: all of the part.
    pub of: Option<String>,
    /// Numbers of the faces (then voxels) of the part whose material is replaced, from 0, as its file has them, instead of `of`.
    pub primitives: Vec<u32>,
    /// Its name. Default: `of`, else `material`.
    pub name: Option<String>,
    /// Reflectance, 0 to 1. Default: that of `spectrum`, else 0.5, or 50 with `--physics helios`.
    pub reflectance: Key<f64>,
    /// Name of a spectrum in a `spectra` folder of the assets.
    pub spectrum: Option<String>,
    /// Class of the points. Default: 0.
    pub classification: Key<i32>,
    /// Whether legs and parts stand on it. Default: false.
    pub is_ground: bool,
    /// Roughness of the surface, degrees; refined physics. Default: 0.
    pub roughness_deg: Key<f64>,
}
}

key_table! {
/// `[platform]`: a catalogue entry, changed by the other keys.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlatformKeys = "[platform]" {
    /// The id of a platform that ships (`vlscan catalogue`), for example `sr22`, or `file.xml#id`.
    pub catalogue: Key<String>,
    /// `static` or `linear_path`. Default: that of the catalogue entry, else `static`.
    pub kind: Option<Movement>,
    /// Pose of the scanner on the platform. Default: that of the catalogue entry, else none.
    pub mount: Option<PoseKeys>,
}
}

key_table! {
/// A position and attitude within another frame (x right, y forward, z up).
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PoseKeys = "poses" {
    /// Offset x, y, z in metres. Default: 0.
    pub offset_m: Key<[f64; 3]>,
    /// Rotations in degrees, one axis each: `[{ x = -90 }, { z = 90 }]`. Default: none.
    pub rotate_deg: Vec<Spanned<AxisKeys>>,
    /// Each rotation is about the axes as turned by those before it, instead of the fixed ones. Default: false.
    pub local: bool,
}
}

key_table! {
/// One rotation about one axis, right-handed, in degrees.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AxisKeys = "rotations" {
    /// About x (right): nose up.
    pub x: Option<f64>,
    /// About y (forward).
    pub y: Option<f64>,
    /// About z (up): to the left.
    pub z: Option<f64>,
}
}

key_table! {
/// `[scanner]` and `[[scanner.channel]]`: a catalogue entry, changed by the other keys, or an instrument of one's own. A
/// channel starts from the scanner and changes what it names.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct InstrumentKeys = "[scanner]" {
    /// The id of a scanner that ships (`vlscan catalogue`), for example `riegl_vz400`, or `file.xml#id`. Not in channels.
    pub catalogue: Key<String>,
    /// Name that outputs report. Default: that of the catalogue entry; channels are numbered from 0.
    pub id: Option<String>,
    /// Name for people. Not in channels.
    pub name: Option<String>,
    /// Beam deflector: `rotating` (polygon mirror), `oscillating`, `conic`, `line` (fibres) or `risley` (prisms).
    pub optics: Option<Optics>,
    /// Pulse frequencies in Hz; the first is the default of a leg. Not in channels.
    pub pulse_freqs_hz: Key<Vec<u32>>,
    /// Largest mechanical half angle, degrees.
    pub scan_angle_max_deg: Key<f64>,
    /// Largest usable half angle, degrees; `rotating` only. Default: the mechanical one.
    pub scan_angle_effective_max_deg: Key<f64>,
    /// Angles in degrees by which the facets of the mirror turn the beam towards +x, along its axis, in the order in which they
    /// come into the beam: each line is a cone around the axis; `rotating` only. Default: all lines are plane.
    pub facet_tilts_deg: Key<Vec<f64>>,
    /// Largest half angle of an elliptic cone along the flight, degrees; `conic` only. Default: a circular cone.
    pub scan_angle_along_max_deg: Key<f64>,
    /// Lowest scan frequency, Hz. Default: 0.
    pub scan_freq_min_hz: Key<f64>,
    /// Highest scan frequency, Hz; 0 is no limit, the default.
    pub scan_freq_max_hz: Key<f64>,
    /// Upper limit of half angle (degrees) times scan frequency (Hz); `oscillating` only. Default: 1 000 000.
    pub scan_product_deg_hz: Key<f64>,
    /// Number of fibres; `line` only. Default: 1.
    pub fibres: Key<u32>,
    /// Prisms in the order in which the beam meets them; `risley` only.
    pub prisms: Option<Spanned<Vec<PrismKeys>>>,
    /// Refractive index of air; `risley` only. Default: 1.
    pub air_index: Key<f64>,
    /// Direction of the beam that enters the prisms; `risley` only. Default: forward, 0 1 0.
    pub incident_beam: Key<[f64; 3]>,
    /// Axis of the head's rotation. Default: up, 0 0 1.
    pub head_axis: Key<[f64; 3]>,
    /// Highest speed of the head, degrees per second. Default: 0, the head cannot turn.
    pub head_rate_max_deg_per_s: Key<f64>,
    /// Pose of the emitter on the head. Default: none.
    pub beam_origin: Option<PoseKeys>,
    /// Time from the start of a firing cycle, which is a pulse period, to the pulse of the channel, µs. Default: 0, all channels
    /// fire at once.
    pub firing_offset_us: Key<f64>,
    /// Beam divergence, rad, at 1/e²; of an elliptical beam the one along the emitter's x axis. Default: 0.0003.
    pub beam_divergence_rad: Key<f64>,
    /// Beam divergence along the emitter's z axis, rad; refined physics. Default: the beam is round.
    pub beam_divergence_y_rad: Key<f64>,
    /// `gaussian` (the default) or `top_hat`: even within the divergence; refined physics.
    pub beam_profile: Option<BeamProfile>,
    /// Diameter of the beam where it leaves the instrument, m; refined physics. Default: 0, as small as diffraction allows.
    pub exit_aperture_m: Key<f64>,
    /// Pulse length, ns. Default: 4.
    pub pulse_length_ns: Key<f64>,
    /// Full width of the pulse at half maximum, ns, instead of `pulse_length_ns`, of which it is 0.485.
    pub pulse_fwhm_ns: Key<f64>,
    /// File of the pulse's power over time: two columns, ns and power in any unit; refined physics. Default: a gamma-like
    /// curve of the pulse length.
    pub pulse_shape: Key<String>,
    /// Energy of a pulse, µJ; refined physics. Default: by the average power.
    pub pulse_energy_uj: Key<f64>,
    /// Wavelength, nm. Default: 1064.
    pub wavelength_nm: Key<u32>,
    /// Average power, W. Default: 4.
    pub average_power_w: Key<f64>,
    /// Beam quality factor M². Default: 1.
    pub beam_quality: Key<f64>,
    /// Optical efficiency. Default: 0.99.
    pub optical_efficiency: Key<f64>,
    /// Receiver diameter, m. Default: 0.15.
    pub receiver_diameter_m: Key<f64>,
    /// Atmospheric visibility, km. Default: 23.
    pub visibility_km: Key<f64>,
    /// Standard deviation of the range noise, m. Default: 0.
    pub accuracy_m: Key<f64>,
    /// Nearest range, m. Default: 0.
    pub range_min_m: Key<f64>,
    /// Farthest range, m. Default: unlimited.
    pub range_max_m: Key<f64>,
    /// Most returns per pulse; 0 is unlimited, the default.
    pub max_returns: Key<u32>,
    /// Detection threshold, W. Default: 0.0001.
    pub received_energy_min_w: Key<f64>,
    /// Target whose echo just reaches the threshold, instead of `received_energy_min_w`: `{ range_m = 600, reflectance =
    /// 0.9, pulse_freq_hz = 100000 }`; refined physics.
    pub max_range: Option<Spanned<TargetKeys>>,
    /// Noise of detector and amplifier: standard deviation of a sample, W (noise equivalent power); refined physics.
    /// Default: no noise.
    pub nep_w: Key<f64>,
    /// The same noise by a target and the ratio of its echo's peak to it: `{ range_m = 100, reflectance = 0.2, value = 20
    /// }`; refined physics.
    pub snr: Option<Spanned<RatioKeys>>,
    /// Mean power of background light on the detector, W, of which there is shot noise; refined physics. Default: 0.
    pub background_w: Key<f64>,
    /// Photocurrent per optical power, A/W; makes shot noise of background light and echoes; refined physics. Default: no
    /// shot noise.
    pub responsivity_a_per_w: Key<f64>,
    /// Electrical bandwidth of the receiver, Hz; refined physics. Default: 0.44 over the pulse's width at half maximum.
    pub bandwidth_hz: Key<f64>,
    /// Amplitude at which the receiver saturates, W; refined physics. Default: never.
    pub saturation_w: Key<f64>,
    /// Range that an echo right at the threshold is measured too far, m; stronger ones in proportion to threshold over
    /// amplitude; refined physics. Default: 0.
    pub range_walk_m: Key<f64>,
    /// Samples lie on a grid of bins counted from the emission, instead of beginning with the first return; refined
    /// physics. Default: false.
    pub digitiser_clock: Option<bool>,
    /// How the range of an echo is read from the waveform: `peak` (the default), `centroid` or `gaussian` (fit); refined
    /// physics.
    pub detector: Option<Ranging>,
    /// Metres added to each range, a formula of the deflection angle THETA in radians. Default: none.
    pub range_error_m: Key<String>,
    /// Radians added to the deflection angle, a formula of THETA; `rotating` only. Default: none.
    pub deflection_error_rad: Key<String>,
    /// Radians added to the head angle, a formula of THETA; `rotating` only. Default: none.
    pub head_error_rad: Key<String>,
    /// Channels that fire at the same time. Default: none, the scanner is one device.
    pub channel: Vec<Spanned<InstrumentKeys>>,
}
}

key_table! {
/// A target that faces the instrument and fills its beam, as data sheets state figures for.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetKeys = "max_range" {
    /// Range, m.
    pub range_m: Spanned<f64>,
    /// Reflectance, 0 to 1.
    pub reflectance: Spanned<f64>,
    /// Pulse rate, Hz. Default: the scanner's first.
    pub pulse_freq_hz: Key<f64>,
}
}

key_table! {
/// A target and the signal-to-noise ratio of its echo.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RatioKeys = "snr" {
    /// Range, m.
    pub range_m: Spanned<f64>,
    /// Reflectance, 0 to 1.
    pub reflectance: Spanned<f64>,
    /// Pulse rate, Hz. Default: the scanner's first.
    pub pulse_freq_hz: Key<f64>,
    /// Peak amplitude over the noise's standard deviation.
    pub value: Spanned<f64>,
}
}

key_table! {
/// A rotating wedge prism.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PrismKeys = "prisms" {
    /// Turns per second; the sign is the sense.
    pub rotor_freq_hz: Spanned<f64>,
    /// Wedge angle, degrees; positive: inclined face towards the incoming beam.
    pub wedge_deg: Spanned<f64>,
    /// Refractive index.
    pub index: Spanned<f64>,
}
}

key_table! {
/// `[settings]` and `leg.settings`: what the scanner does.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SettingsKeys = "[settings]" {
    /// Pulses per second. Default: the scanner's first frequency.
    pub pulse_freq_hz: Key<u32>,
    /// Lines (`rotating`) or periods (`oscillating`) per second. Default: 0.
    pub scan_freq_hz: Key<f64>,
    /// Half opening angle of the swath, degrees. Default: the scanner's maximum.
    pub scan_angle_deg: Key<f64>,
    /// Lowest deflection angle that fires, degrees. Default: from `scan_angle_deg`.
    pub vertical_angle_min_deg: Key<f64>,
    /// Highest deflection angle that fires, degrees. Default: from `scan_angle_deg`.
    pub vertical_angle_max_deg: Key<f64>,
    /// Speed of the head, degrees per second, signed. Default: 0.
    pub head_rate_deg_per_s: Key<f64>,
    /// Angle at which the head starts, degrees. Default: 0.
    pub head_start_deg: Key<f64>,
    /// Angle at which the head stops, degrees. Default: 0.
    pub head_stop_deg: Key<f64>,
    /// Spacing of lines along the mirror's sweep, degrees: with the horizontal one it replaces scan frequency and head
    /// speed (`rotating` only).
    pub vertical_resolution_deg: Key<f64>,
    /// Spacing of lines along the head's rotation, degrees.
    pub horizontal_resolution_deg: Key<f64>,
    /// Beam divergence of the first channel, rad. Default: the scanner's.
    pub beam_divergence_rad: Key<f64>,
    /// Spacing of trajectory samples, s; 0 writes none, the default.
    pub trajectory_interval_s: Key<f64>,
    /// Ends the leg after that time, s. Default: no limit.
    pub max_duration_s: Key<f64>,
    /// The optics move that long before the first pulse, s. Default: 0.
    pub warmup_s: Key<f64>,
}
}

key_table! {
/// `[[leg]]`: a waypoint and the way to the next one. The last leg of a moving platform is where it arrives.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LegKeys = "[[leg]]" {
    /// World position x, y, z in metres.
    pub position_m: Key<[f64; 3]>,
    /// Take z from the ground. Default: false.
    pub on_ground: bool,
    /// Speed, m/s. Default: 70.
    pub speed_m_per_s: Key<f64>,
    /// Whether the scanner fires. Default: true.
    pub active: Option<bool>,
    /// The id of a platform that ships, or `file.xml#id`, of one that carries the scanner in this leg, with its mount; it has to be of the kind of
    /// `[platform]`. Default: `[platform]`.
    pub platform: Key<String>,
    /// Mount of the scanner in this leg. Default: that of the leg's `platform`, or of `[platform]`.
    pub mount: Option<PoseKeys>,
    /// Legs with the same strip share their output. Default: none.
    pub strip: Option<String>,
    /// What differs from `[settings]`.
    pub settings: Option<SettingsKeys>,
}
}

key_table! {
/// `[waveform]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WaveformKeys = "[waveform]" {
    /// Width of a bin, ns. Default: 0.25.
    pub bin_ns: Key<f64>,
    /// Peak search window, ns. Default: 1.
    pub window_ns: Key<f64>,
    /// Number of concentric rings of subrays. Default: 3.
    pub quality: Key<u32>,
    /// Longest waveform, ns; 0 is unlimited, the default.
    pub max_range_ns: Key<f64>,
}
}

key_table! {
/// `[detector]`: replaces the scanner's values.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DetectorKeys = "[detector]" {
    /// Standard deviation of the range noise, m.
    pub accuracy_m: Key<f64>,
    /// Nearest range, m.
    pub range_min_m: Key<f64>,
    /// Farthest range, m.
    pub range_max_m: Key<f64>,
    /// Most returns per pulse; 0 is unlimited.
    pub max_returns: Key<u32>,
    /// Factor on the range noise, a formula of the range t in metres.
    pub distance_error: Key<String>,
}
}
