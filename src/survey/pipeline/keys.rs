//! Every key of a pipeline file. Unknown keys are errors; keys that are not given keep the default named here.

use serde::Deserialize;
use std::path::PathBuf;
use toml::Spanned;

/// A key that may be missing, with its place.
pub type Key<T> = Option<Spanned<T>>;

/// A pipeline file.
///
/// A run starts either from `survey`, or from `scene` with `[scanner]` and a way to move: `[trajectory]`, or `[platform]`
/// with `[[leg]]` tables. Tables that stand beside `survey` replace or change what the survey says. Paths of input files
/// are relative to the pipeline file (then the asset folders are searched); paths of outputs are relative to the working
/// directory.
///
/// ```toml
/// scene = "forest.xml#forest"
///
/// [trajectory]
/// path = "-"
///
/// [scanner]
/// catalogue = "data/scanners_als.xml#riegl_vux-1uav"
///
/// [settings]
/// scan_freq_hz = 100
///
/// [[output]]
/// path = "points.laz"
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PipelineKeys {
    /// Survey XML file to start from.
    pub survey: Key<String>,
    /// What is scanned: `file.xml#id`, `file.xml` (its first scene), a geometry file (.obj, .tif, .vox), a table of
    /// instances (.csv) or a packed scene (.vlscene).
    pub scene: Key<String>,
    /// Name of the run; it names the output folder. Default: the file's name without extension.
    pub name: Option<String>,
    /// Seed of all random numbers: a whole number, or a text in any form that `--seed` takes.
    pub seed: Key<toml::Value>,
    /// Coordinate reference system of the scene: WKT text, or the path of a `.wkt` or `.prj` file.
    pub crs: Key<String>,
    /// GPS time of the first pulse, `YYYY-MM-DD hh:mm:ss` (UTC) or POSIX seconds.
    pub gps_start: Option<String>,
    /// Warnings are errors. Default: false.
    pub strict: Option<bool>,
    /// Write every digitised waveform beside the first output that is a file or folder. Default: false.
    pub waveforms: Option<bool>,
    /// Write every emitted pulse beside the first output that is a file or folder. Default: false.
    pub pulses: Option<bool>,
    /// Columns of csv, arrow, parquet and (then with a header) xyz: a list of names, or a text with commas.
    pub columns: Key<toml::Value>,
    /// Part, primitive and true range in las, laz and ply, too. Default: false.
    pub labels: Option<bool>,
    /// Positions without errors of navigation (TrueX, TrueY, TrueZ) as extra bytes of las and laz. Default: false.
    pub true_positions: Option<bool>,
    /// What each subray met instead of points. Default: false.
    pub subrays: Option<bool>,
    /// Pulses without echoes, too: 0 returns, at the beam's origin. Default: false.
    pub misses: Option<bool>,
    /// LAS leaves through a pipe at once, with this number of points in its header: a whole number, or a text such as
    /// `250M`.
    pub las_at_most: Key<toml::Value>,
    /// Resolution of LAS coordinates, m. Default: 0.0001, coarser where the scene is too wide for it.
    pub las_scale: Option<f64>,
    /// LAS 1.0 instead of 1.4. Default: false.
    pub las10: Option<bool>,
    /// Waveforms as packets of LAS and LAZ: `inside` the file, or `beside` it as .wdp.
    pub wave_packets: Key<String>,
    /// One point file per device of a multi-channel scanner. Default: false.
    pub split_by_channel: Option<bool>,
    /// Waveforms and pulses as compressed text (.bin). Default: false.
    pub zip_output: Option<bool>,
    /// Overwrite files that exist. Default: false.
    pub force: Option<bool>,
    /// More folders in which input files are looked for.
    pub assets: Vec<PathBuf>,
    /// What carries the scanner.
    pub platform: Option<Spanned<PlatformKeys>>,
    /// A stream of poses to fly along.
    pub trajectory: Option<TrajectoryKeys>,
    /// What the navigation system gets wrong: the beam is traced from the true pose, points are georeferenced with the
    /// reported one.
    pub navigation_errors: Option<NavigationKeys>,
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
    /// How echoes are computed.
    pub physics: Option<PhysicsKeys>,
    /// How the work is done; has no effect on the result.
    pub schedule: Option<ScheduleKeys>,
    /// What is written. Points go to standard output when nothing is said.
    pub output: Vec<OutputKeys>,
}

/// `[platform]`: a catalogue entry, changed by the other keys.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlatformKeys {
    /// `file.xml#id` of a platform, for example `data/platforms.xml#sr22`.
    pub catalogue: Key<String>,
    /// `static` or `linear_path`. Default: that of the catalogue entry, else `static`.
    pub kind: Key<String>,
    /// Pose of the scanner on the platform. Default: that of the catalogue entry, else none.
    pub mount: Option<PoseKeys>,
}

/// A position and attitude within another frame (x right, y forward, z up).
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PoseKeys {
    /// Offset x, y, z in metres. Default: 0.
    pub offset_m: Key<[f64; 3]>,
    /// Rotations in degrees, one axis each: `[{ x = -90 }, { z = 90 }]`. Default: none.
    pub rotate_deg: Vec<Spanned<AxisKeys>>,
    /// Each rotation is about the axes as turned by those before it, instead of the fixed ones. Default: false.
    pub local: bool,
}

/// One rotation about one axis, right-handed, in degrees.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AxisKeys {
    /// About x (right): nose up.
    pub x: Option<f64>,
    /// About y (forward).
    pub y: Option<f64>,
    /// About z (up): to the left.
    pub z: Option<f64>,
}

/// `[trajectory]`: poses that are flown along as they arrive.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrajectoryKeys {
    /// The file; `-` is standard input.
    pub path: Key<String>,
    /// `text`, `helios`, `sbet` or `terrascan`. Default: found out from the content.
    pub format: Key<String>,
    /// Names of the columns in their order, from time, x, y, z, roll, pitch, yaw, lat, lon; any other name is skipped. Or
    /// names with numbers from 1, such as `time=1`. Default: the header line, or time, x, y, z, roll, pitch, yaw.
    pub columns: Option<Spanned<Vec<String>>>,
    /// The character between columns. Default: found out from the first line.
    pub separator: Key<String>,
    /// Unit of angles behind whose names none stands: `deg` (the default) or `rad`.
    pub angles: Key<String>,
    /// Angles are degrees: true is the same as `angles = "deg"`, false as `angles = "rad"`.
    pub degrees: Option<bool>,
    /// What the angles of text are: `heading` or `arinc705` (clockwise from north, nose up, roll innermost), `yaw`
    /// (counter-clockwise from east, otherwise the same), `ros` (as `yaw`, nose down), `helios` (as `heading`, but pitch
    /// innermost) or `canonical` (about x, y, z). Default: `helios` for files as HELIOS++ reads and writes them, else
    /// `heading`.
    pub rotation: Key<String>,
    /// UTM zone to which latitudes and longitudes are projected, such as `32N`. Default: that of the scene's `crs`, else
    /// that of the first pose.
    pub utm_zone: Key<String>,
    /// Added to all heights, m: ellipsoidal heights to those of the scene. Default: 0.
    pub height_offset_m: Key<f64>,
    /// Lever arm: where the platform's frame is in the recorded body: right, forward, up in metres. It turns with the
    /// attitude, not with the boresight. Default: 0.
    pub lever_arm_m: Key<[f64; 3]>,
    /// Boresight: how the platform's frame is turned in the recorded body: roll (right side down), pitch (nose up), heading
    /// (clockwise from above) in degrees, roll innermost. Default: 0.
    pub boresight_deg: Key<[f64; 3]>,
    /// Nothing is fired between poses that are farther apart, s. Default: no limit.
    pub max_gap_s: Key<f64>,
    /// How long points of a live trajectory may wait for others to be computed together, s. Default: 0.25.
    pub latency_s: Key<f64>,
}

/// `[scanner]` and `[[scanner.channel]]`: a catalogue entry, changed by the other keys, or an instrument of one's own. A
/// channel starts from the scanner and changes what it names.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct InstrumentKeys {
    /// `file.xml#id` of a scanner, for example `data/scanners_tls.xml#riegl_vz400`. Not in channels.
    pub catalogue: Key<String>,
    /// Name that outputs report. Default: that of the catalogue entry; channels are numbered from 0.
    pub id: Option<String>,
    /// Name for people. Not in channels.
    pub name: Option<String>,
    /// Beam deflector: `rotating` (polygon mirror), `oscillating`, `conic`, `line` (fibres) or `risley` (prisms).
    pub optics: Key<String>,
    /// Pulse frequencies in Hz; the first is the default of a leg. Not in channels.
    pub pulse_freqs_hz: Key<Vec<u32>>,
    /// Largest mechanical half angle, degrees.
    pub scan_angle_max_deg: Key<f64>,
    /// Largest usable half angle, degrees; `rotating` only. Default: the mechanical one.
    pub scan_angle_effective_max_deg: Key<f64>,
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
    /// Beam divergence, rad, at 1/e²; of an elliptical beam the one along the emitter's x axis. Default: 0.0003.
    pub beam_divergence_rad: Key<f64>,
    /// Beam divergence along the emitter's z axis, rad; refined physics. Default: the beam is round.
    pub beam_divergence_y_rad: Key<f64>,
    /// `gaussian` (the default) or `top_hat`: even within the divergence; refined physics.
    pub beam_profile: Key<String>,
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
    pub detector: Key<String>,
    /// Metres added to each range, a formula of the deflection angle THETA in radians. Default: none.
    pub range_error_m: Key<String>,
    /// Radians added to the deflection angle, a formula of THETA; `rotating` only. Default: none.
    pub deflection_error_rad: Key<String>,
    /// Radians added to the head angle, a formula of THETA; `rotating` only. Default: none.
    pub head_error_rad: Key<String>,
    /// Channels that fire at the same time. Default: none, the scanner is one device.
    pub channel: Vec<Spanned<InstrumentKeys>>,
}

/// A target that faces the instrument and fills its beam, as data sheets state figures for.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetKeys {
    /// Range, m.
    pub range_m: Spanned<f64>,
    /// Reflectance, 0 to 1.
    pub reflectance: Spanned<f64>,
    /// Pulse rate, Hz. Default: the scanner's first.
    pub pulse_freq_hz: Key<f64>,
}

/// A target and the signal-to-noise ratio of its echo.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RatioKeys {
    /// Range, m.
    pub range_m: Spanned<f64>,
    /// Reflectance, 0 to 1.
    pub reflectance: Spanned<f64>,
    /// Pulse rate, Hz. Default: the scanner's first.
    pub pulse_freq_hz: Key<f64>,
    /// Peak amplitude over the noise's standard deviation.
    pub value: Spanned<f64>,
}

/// A rotating wedge prism.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PrismKeys {
    /// Turns per second; the sign is the sense.
    pub rotor_freq_hz: f64,
    /// Wedge angle, degrees; positive: inclined face towards the incoming beam.
    pub wedge_deg: f64,
    /// Refractive index.
    pub index: f64,
}

/// `[settings]` and `leg.settings`: what the scanner does.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SettingsKeys {
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

/// `[[leg]]`: a waypoint and the way to the next one. The last leg of a moving platform is where it arrives.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LegKeys {
    /// World position x, y, z in metres.
    pub position_m: Key<[f64; 3]>,
    /// Take z from the ground. Default: false.
    pub on_ground: bool,
    /// Speed, m/s. Default: 70.
    pub speed_m_per_s: Key<f64>,
    /// Whether the scanner fires. Default: true.
    pub active: Option<bool>,
    /// Legs with the same strip share their output. Default: none.
    pub strip: Option<String>,
    /// What differs from `[settings]`.
    pub settings: Option<SettingsKeys>,
}

/// `[waveform]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WaveformKeys {
    /// Width of a bin, ns. Default: 0.25.
    pub bin_ns: Key<f64>,
    /// Peak search window, ns. Default: 1.
    pub window_ns: Key<f64>,
    /// Number of concentric rings of subrays. Default: 3.
    pub quality: Key<u32>,
    /// Longest waveform, ns; 0 is unlimited, the default.
    pub max_range_ns: Key<f64>,
}

/// `[detector]`: replaces the scanner's values.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DetectorKeys {
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

/// `[physics]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhysicsKeys {
    /// `helios` (the default) or `refined`.
    pub profile: Key<String>,
    /// The older energy model. Default: false.
    pub legacy_energy: Option<bool>,
    /// Every surface is hit at a right angle. Default: false.
    pub fixed_incidence: Option<bool>,
    /// Fit the width of every echo. Default: false.
    pub echo_width: Option<bool>,
    /// Noise on written waveforms. Default: false.
    pub waveform_noise: Option<bool>,
    /// Noise of the platform's pose. Default: true.
    pub platform_noise: Option<bool>,
    /// Random offsets of legs. Default: true.
    pub leg_noise: Option<bool>,
}

/// `[schedule]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ScheduleKeys {
    /// Number of threads; 0 is one per core, the default.
    pub threads: Option<usize>,
    /// How pulses are handed out: `warehouse` (the default), `dynamic`, `static` or `single`.
    pub policy: Key<String>,
    /// A leg begins only when the one before is done. Default: false.
    pub leg_barrier: Option<bool>,
    /// Pulses per chunk.
    pub chunk_size: Key<usize>,
    /// Capacity of the warehouse in chunks per thread.
    pub warehouse_factor: Key<usize>,
    /// Search tree: `fsah`, `sah`, `axis-sah`, `median` or `bvh`.
    pub tree: Key<String>,
    /// Refuse scenes that need more: bytes, or a text such as `8G`.
    pub max_memory: Key<toml::Value>,
}

/// `[[output]]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OutputKeys {
    /// The file, or `-` for standard output; a folder with `per_leg`.
    pub path: Key<PathBuf>,
    /// `points` (the default) or `trajectory`: the platform's poses as CSV, in the layout that `--trajectory` reads.
    pub content: Key<String>,
    /// `xyz`, `csv`, `bin`, `las`, `laz`, `copc`, `ply`, `ply-ascii`, `arrow` or `parquet`. Default: from the extension,
    /// else `xyz`.
    pub format: Key<String>,
    /// One file for each leg or strip. Default: false.
    pub per_leg: Option<bool>,
    /// The folder gets HELIOS++'s layout, `PATH/SURVEY/TIME/leg000_points.xyz` and so on. Default: false.
    pub helios: Option<bool>,
}

/// The `[navigation_errors]` table: errors of what is reported of the platform's pose. Standard deviations belong to
/// first-order Gauss–Markov processes, whose correlation falls by a factor e in the correlation time. Every key but the
/// correlation times takes one number for all three components, or three. Default: no errors.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NavigationKeys {
    /// Standard deviation of the position to the east, north and up, m.
    pub position_m: Key<toml::Value>,
    /// Correlation time of the position's errors, s. Default: 300.
    pub position_correlation_s: Key<toml::Value>,
    /// Constant error of the position to the east, north and up, m.
    pub position_bias_m: Key<toml::Value>,
    /// Standard deviation of roll, pitch and heading, degrees.
    pub attitude_deg: Key<toml::Value>,
    /// Correlation time of the attitude's errors, s. Default: 60.
    pub attitude_correlation_s: Key<toml::Value>,
    /// Constant error of roll, pitch and heading, degrees.
    pub attitude_bias_deg: Key<toml::Value>,
    /// Growth of the error of roll, pitch and heading from the flight's start, degrees per hour.
    pub attitude_drift_deg_per_h: Key<toml::Value>,
    /// Error of the boresight, degrees: roll, pitch, heading.
    pub boresight_deg: Key<toml::Value>,
    /// Standard deviation of a boresight error that is drawn once for the run, degrees.
    pub boresight_sigma_deg: Key<toml::Value>,
    /// Error of the lever arm to the right, forward and up, m.
    pub lever_arm_m: Key<toml::Value>,
    /// Standard deviation of a lever arm error that is drawn once for the run, m.
    pub lever_arm_sigma_m: Key<toml::Value>,
}

impl NavigationKeys {
    /// All keys by name.
    pub fn entries(&self) -> [(&'static str, &Key<toml::Value>); 11] {
        [
            ("position_m", &self.position_m),
            ("position_correlation_s", &self.position_correlation_s),
            ("position_bias_m", &self.position_bias_m),
            ("attitude_deg", &self.attitude_deg),
            ("attitude_correlation_s", &self.attitude_correlation_s),
            ("attitude_bias_deg", &self.attitude_bias_deg),
            ("attitude_drift_deg_per_h", &self.attitude_drift_deg_per_h),
            ("boresight_deg", &self.boresight_deg),
            ("boresight_sigma_deg", &self.boresight_sigma_deg),
            ("lever_arm_m", &self.lever_arm_m),
            ("lever_arm_sigma_m", &self.lever_arm_sigma_m),
        ]
    }
}
