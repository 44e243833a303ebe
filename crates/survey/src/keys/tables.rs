//! The keys of each table of a pipeline file: meaning, XML name, bounds, physics that makes use of it.
//! Unknown keys are errors; omitted keys have the default that their documentation states. Keys that are also
//! options of a run are in the program's `options`.

use super::{Key, KeyTable, KeyUse};
use KeyUse::{InLaterChannelsWith, UnlessBeside, With, Without};
use vlscan_base::quantity::*;

/// The first of two values, if it is given.
macro_rules! or {
    (; $default:expr) => {
        $default
    };
    ($given:expr; $default:expr) => {
        $given
    };
}

/// Defines the keys of a table, each with its meaning: `key = "xmlName" in BOUNDS, use;`. Without bounds a
/// number is any number, without a use the key always has an effect.
macro_rules! keys {
    (
        $(#[doc = $about:literal])+
        $name:ident = $table:literal {
            $($(#[doc = $doc:literal])+ $key:ident $(= $xml:literal)? $(in $bounds:ident)? $(, $used:expr)?;)*
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Copy, Debug)]
        #[allow(dead_code, reason = "tables may share keys, which one of them then names")]
        pub(crate) struct $name {
            $($(#[doc = $doc])+ pub $key: Key,)*
        }

        impl $name {
            /// The keys by name.
            pub const KEYS: $name = $name {
                $($key: Key {
                    key: stringify!($key),
                    attribute: or!($($xml)?; ""),
                    bounds: &or!($($bounds)?; NUMBER),
                    used: or!($($used)?; KeyUse::Always),
                },)*
            };
            /// The keys in the order of the documentation.
            #[allow(dead_code, reason = "of use for some tables")]
            pub const ALL: &'static [Key] = &[$($name::KEYS.$key),*];
            /// Names and meanings of the keys.
            pub const TABLE: KeyTable = KeyTable {
                name: $table,
                about: concat!($($about, "\n"),+),
                keys: &[$((stringify!($key), concat!($($doc, "\n"),+))),*],
            };
        }
    };
}

keys! {
    /// A pipeline file.
    ///
    /// A run starts either from `survey`, or from `scene` with `[scanner]` and a way to move: `[trajectory]`,
    /// or `[platform]` with `[[leg]]` tables. Tables that stand beside `survey` replace or change what the
    /// survey says. Paths of input files are relative to the pipeline file (then the asset folders are
    /// searched); paths of outputs are relative to the working directory.
    SurveyKeys = "" {
        /// Survey XML file to start from.
        survey;
        /// The scene: `file.xml#id`, `file.xml` (its first scene), a geometry file (.obj, .tif, .vrt,
        /// .vox), a folder of tiles of a raster, a table of instances (.csv) or a packed scene (.vlscene).
        scene;
        /// Parts of the scene, instead of `scene`.
        part;
        /// Name of the run; it names the output folder. Default: the file's name without extension.
        name;
        /// The carrier of the scanner.
        platform;
        /// The instrument; a list of tables for several instruments on one platform.
        scanner;
        /// Settings of the scanner; with `[[leg]]` tables, those that hold for all of them.
        settings;
        /// Waypoints of a platform that does not follow a trajectory.
        leg;
        /// Waveform digitisation, for all channels.
        waveform;
        /// Detection, for all channels.
        detector;
    }
}

keys! {
    /// `[[part]]`: a geometry file and where it stands. A point goes to `scale` times the rotated point plus
    /// `position_m`. Parts that name the same mesh share it.
    PartKeys = "[[part]]" {
        /// Geometry file: a mesh (.obj, .ply, .stl, .off, .gltf, .glb), a terrain raster (.tif, .asc, .vrt)
        /// or vegetation voxels (.vox); or a folder or a pattern (`dem/*.tif`) of tiles of a raster.
        file;
        /// Id of the object that points report. Default: the number of the part, from 0.
        id;
        /// Axis of a mesh that points up, `z` or `y`. Default: `y` for glTF, `z` for other meshes.
        up;
        /// Unit of the coordinates of a mesh: `m`, `cm`, `mm`, `km`, `ft`, `us-ft`, `in`, or a number of
        /// metres. Default: `m`.
        unit;
        /// Table of the materials of a mesh by name. Default: `materials.csv` beside it, if it is no OBJ
        /// file.
        materials;
        /// Height of a level surface of water, m, instead of `file`; `[[part.material]]` has its properties.
        water_level_m in WATER_LEVEL;
        /// Area of that water: x and y of two corners, m.
        water_area_m;
        /// Scale. Default: 1.
        scale in SCALE;
        /// Rotations in degrees, one axis each: `[{ z = 90 }]`. Default: none.
        rotate_deg;
        /// World position x, y, z of the file's origin in metres. Default: 0.
        position_m;
        /// Lower or lift the part to the ground below it. Default: false.
        on_ground;
        /// Materials that replace those of the file: tables `[[part.material]]`, in this order.
        material;
    }
}

keys! {
    /// `[[part.material]]`: a material instead of those of a part's file.
    MaterialKeys = "[[part.material]]" {
        /// Name of the material that is replaced. Default: all of the part.
        of;
        /// Numbers of the faces (then voxels) of the part whose material is replaced, from 0, as its file has
        /// them, instead of `of`.
        primitives;
        /// Its name. Default: `of`, else `material`.
        name;
        /// Reflectance, 0 to 1. Default: that of `spectrum`, else 0.5, or 50 with `--physics helios`.
        reflectance in REFLECTANCE;
        /// Name of a spectrum in a `spectra` folder of the assets.
        spectrum;
        /// Class of the points. Default: 0.
        classification;
        /// True if legs and parts stand on it. Default: false.
        is_ground;
        /// True if it is leaves, whose area counts as leaf area. Default: by its name (leaf, needle, foliage,
        /// Laub, Blatt, Nadel).
        is_leaf;
        /// Roughness of the surface, degrees; refined physics. Default: 0.
        roughness_deg in ROUGHNESS;
        /// Size of the elements of foliage (shoots, clusters of leaves) that intercept light as a whole, m;
        /// refined physics. Default: 0, leaves much smaller than a footprint.
        element_size_m in ELEMENT_SIZE;
        /// Share of the light that the surface mirrors, 0 to 1. Default: it is not a mirror.
        mirror in MIRROR;
        /// Refractive index, 1 to 5, of a pane. Default: 1.5 if another key of a pane is given, else the
        /// surface is not a pane.
        pane_index in PANE_INDEX;
        /// Thickness of each sheet of a pane, m. Default: 0.004.
        pane_thickness_m in PANE_THICKNESS;
        /// Absorption within a pane, per metre. Default: 0.
        pane_absorption in PANE_ABSORPTION;
        /// Number of sheets of a pane, 1 or 2. Default: 1.
        pane_sheets in PANE_SHEETS;
        /// Coefficient R_A of a retro-reflector, cd/(lx·m²). Default: it is not a retro-reflector.
        retro in RETRO;
        /// Refractive index of water, 1 to 5. Default: 1.335 if another key of water is given, else the
        /// surface is not water.
        water_index in PANE_INDEX;
        /// Group index of water, 1 to 5, by which light is slower there. Default: 1.357, or 0.022 above
        /// `water_index`.
        water_group_index in PANE_INDEX;
        /// Diffuse attenuation K of light in water, per metre. Default: 0.1.
        water_attenuation in WATER_ATTENUATION;
        /// Secchi depth of water, m, instead of `water_attenuation`, which is 1.7 over it.
        water_secchi_m in SECCHI_DEPTH;
        /// Attenuation c of a narrow beam in water, per metre, at least K; a receiver whose field of view is
        /// narrow sees more of it. Default: K.
        water_beam_attenuation in WATER_ATTENUATION;
        /// Light that water scatters straight back (volume scattering function at 180 degrees), per metre
        /// and sr. Default: 0.00019, pure water at 532 nm.
        water_backscatter in WATER_BACKSCATTER;
        /// Wind speed at 12.5 m, m/s, which makes the slopes of the water's surface; 0: flat water. Default:
        /// 5.
        water_wind_m_s in WIND_SPEED;
        /// Direction of the wind, degrees clockwise from north. Default: slopes are equal in all directions.
        water_wind_deg in WIND_DIRECTION;
    }
}

keys! {
    /// `[platform]`: a catalogue entry, changed by the other keys.
    PlatformKeys = "[platform]" {
        /// The id of a platform that ships (`vlscan catalogue`), for example `sr22`, or `file.xml#id`.
        catalogue;
        /// `static` or `linear_path`. Default: that of the catalogue entry, else `static`.
        kind = "type";
        /// Pose of the scanner on the platform. Default: that of the catalogue entry, else none.
        mount = "scannerMount";
    }
}

keys! {
    /// A position and attitude within another frame (x right, y forward, z up).
    PoseKeys = "poses" {
        /// Offset x, y, z in metres. Default: 0.
        offset_m;
        /// Rotations in degrees, one axis each: `[{ x = -90 }, { z = 90 }]`. Default: none.
        rotate_deg;
        /// Each rotation is about the axes as turned by those before it, instead of the fixed ones. Default:
        /// false.
        local;
    }
}

keys! {
    /// One rotation about one axis, right-handed, in degrees.
    AxisKeys = "rotations" {
        /// About x (right): nose up.
        x;
        /// About y (forward).
        y;
        /// About z (up): to the left.
        z;
    }
}

keys! {
    /// `[scanner]` and `[[scanner.channel]]`: a catalogue entry, changed by the other keys, or a custom
    /// instrument. A channel starts from the scanner and changes what it names.
    InstrumentKeys = "[scanner]" {
        /// The id of a scanner that ships (`vlscan catalogue`), for example `riegl_vz400`, `file.xml#id`, or
        /// the calibration file of an Ouster sensor (.json). Not in channels.
        catalogue;
        /// Name that outputs report. Default: that of the catalogue entry; channels are numbered from 0.
        id = "id";
        /// Name for people. Not in channels.
        name = "name";
        /// Beam deflector: `rotating` (polygon mirror), `oscillating`, `conic`, `line` (fibres), `risley`
        /// (prisms) or `pattern` (a table of directions; not in channels).
        optics = "optics";
        /// Pulse frequencies in Hz; the first is the default of a leg. Not in channels.
        pulse_freqs_hz = "pulseFreqs_Hz";
        /// Largest mechanical half angle, degrees.
        scan_angle_max_deg = "scanAngleMax_deg" in HALF_ANGLE_LIMIT;
        /// Largest usable half angle, degrees; `rotating` only. Default: the mechanical one.
        scan_angle_effective_max_deg = "scanAngleEffectiveMax_deg" in HALF_ANGLE_LIMIT;
        /// Angles in degrees by which the facets of the mirror turn the beam towards +x, along its axis, in
        /// the order in which they come into the beam: each line is a cone around the axis; `rotating` only.
        /// Default: all lines are plane.
        facet_tilts_deg = "facetTilts_deg";
        /// Largest half angle of an elliptic cone along the flight, degrees; `conic` only. Default: a
        /// circular cone.
        scan_angle_along_max_deg = "scanAngleAlongMax_deg" in HALF_ANGLE_LIMIT;
        /// The deflector turns, swings or steps the other way. Default: false.
        scan_reverse = "scanReverse";
        /// Place of the deflector in its revolution or period at the first pulse of a leg, where it restarts,
        /// degrees from 0 to 360 of a revolution (`conic`), a facet (`rotating`), a period (`oscillating`), a
        /// sequence of fibres (`line`) or a turn of the first prism (`risley`, a step before that pulse).
        /// Default: 0.
        scan_phase_deg = "scanPhase_deg" in ANGLE;
        /// Tilt of the deflector's axis, degrees: angles about the emitter's x axis and then about its z axis
        /// by which the deflected beam is turned. Default: `[0, 0]`.
        scan_axis_tilt_deg = "scanAxisTilt_deg";
        /// Deviation of the deflector from even motion, in the degrees of `scan_phase_deg`: a file of two
        /// columns, seconds from the start of the leg and the angle, linear in between; or `{ amplitude_deg =
        /// 0.2, freq_hz = 3, phase_deg = 0 }`, a sine. Not `line`. Default: none.
        scan_wander = "scanWander";
        /// `even` (the default) or `sine`: motion of the mirror between its reversals; `oscillating` only.
        mirror_motion = "mirrorMotion";
        /// Share of the time of each sweep in which the mirror reverses, half of it at each end;
        /// `oscillating` with even motion only. Default: 50 pulses at each end.
        turning_part = "turningPart" in TURNING_PART;
        /// Lowest scan frequency, Hz. Default: 0.
        scan_freq_min_hz = "scanFreqMin_Hz" in SCAN_FREQ;
        /// Highest scan frequency, Hz; 0 is no limit, the default.
        scan_freq_max_hz = "scanFreqMax_Hz" in SCAN_FREQ;
        /// Upper limit of half angle (degrees) times scan frequency (Hz); `oscillating` only. Default: 1 000
        /// 000.
        scan_product_deg_hz = "scanProduct" in POSITIVE;
        /// Number of fibres; `line` only. Default: 1.
        fibres = "numFibers" in COUNT_ABOVE_0;
        /// Prisms in the order in which the beam meets them; `risley` only.
        prisms;
        /// Refractive index of air; `risley` only. Default: 1.
        air_index = "refrIndex_air" in REFRACTIVE_INDEX;
        /// Direction of the beam that enters the prisms; `risley` only. Default: forward, 0 1 0.
        incident_beam = "incidentBeam";
        /// Table of the directions of a `pattern`, one row per pulse (.csv, .parquet, .npy): `azimuth_deg`
        /// and `elevation_deg` or `zenith_deg`, by `time_s` or `index` if there is one, by `channel` if there
        /// are several, with `origin_x_m`, `origin_y_m`, `origin_z_m` and `divergence_rad` if they differ; or
        /// its rows in brackets, `[[0, 10], [1, 10]]`. Times are those of the pulses unless `pulse_freqs_hz`
        /// is there. Not in channels.
        pattern;
        /// The `pattern` starts again after its last row. Default: true; else no more pulses leave in the
        /// leg.
        pattern_repeat;
        /// Sense of the azimuths of a `pattern` seen from above, `clockwise` or `counterclockwise`, from the
        /// emitter's y axis. Default: `clockwise`; `counterclockwise` in tables with `zenith_deg`, as those
        /// of Livox.
        pattern_azimuth;
        /// Axis of the head's rotation. Default: up, 0 0 1.
        head_axis = "headRotateAxis";
        /// Highest speed of the head, degrees per second. Default: 0, the head cannot turn.
        head_rate_max_deg_per_s = "headRotatePerSecMax_deg" in HEAD_RATE;
        /// Pose of the emitter on the head. Default: none.
        beam_origin = "beamOrigin";
        /// Time from the start of a firing cycle, which is a pulse period, to the pulse of the channel, µs.
        /// Default: 0, all channels fire at once.
        firing_offset_us = "firingOffset_us" in FIRING_OFFSET_US, With("firing_offsets");
        /// Beam divergence, rad, at 1/e²; of an elliptical beam the one along the emitter's x axis. Default:
        /// 0.0003.
        beam_divergence_rad = "beamDivergence_rad" in DIVERGENCE;
        /// Beam divergence along the emitter's z axis, rad; refined physics. Default: the beam is round.
        beam_divergence_y_rad = "beamDivergenceY_rad" in DIVERGENCE, With("equal_energy");
        /// `gaussian` (the default) or `top_hat`: even within the divergence; refined physics.
        beam_profile = "beamProfile", With("equal_energy");
        /// Diameter of the beam where it leaves the instrument, m; refined physics. Default: 0, as small as
        /// diffraction allows.
        exit_aperture_m = "exitAperture_m" in APERTURE, With("equal_energy");
        /// Pulse length, ns. Default: 4.
        pulse_length_ns = "pulseLength_ns" in PULSE_LENGTH_NS, UnlessBeside { key: "pulse_shape", correction: "receiver" };
        /// Full width of the pulse at half maximum, ns, instead of `pulse_length_ns`, of which it is 0.485.
        pulse_fwhm_ns = "pulseFwhm_ns" in PULSE_LENGTH_NS, UnlessBeside { key: "pulse_shape", correction: "receiver" };
        /// File of the pulse's power over time: two columns, ns and power in any unit; refined physics.
        /// Default: a raised cosine of the width at half maximum.
        pulse_shape = "pulseShape", With("receiver");
        /// Energy of a pulse, µJ; refined physics. Default: by the average power.
        pulse_energy_uj = "pulseEnergy_uJ" in PULSE_ENERGY_UJ, With("radiometry");
        /// Wavelength, nm. Default: 1064.
        wavelength_nm = "wavelength_nm" in WAVELENGTH_NM;
        /// Average power, W. Default: 4.
        average_power_w = "averagePower_w" in AVERAGE_POWER_W, UnlessBeside { key: "pulse_energy_uj", correction: "radiometry" };
        /// Beam quality factor M². Default: 1.
        beam_quality = "beamQualityFactor" in BEAM_QUALITY, Without("radiometry");
        /// Optical efficiency. Default: 0.99.
        optical_efficiency = "opticalEfficiency" in EFFICIENCY;
        /// Receiver diameter, m. Default: 0.15.
        receiver_diameter_m = "receiverDiameter_m" in RECEIVER_DIAMETER;
        /// Light of near targets that misses the detector: `{ field_of_view_rad = 0.001, baseline_m = 0.05,
        /// focus_m = 50 }`; refined physics. Default: all light reaches it.
        overlap = "overlap", With("radiometry");
        /// Atmospheric visibility, km. Default: 23.
        visibility_km = "atmosphericVisibility_km" in VISIBILITY;
        /// Standard deviation of the range noise, m. Default: 0.
        accuracy_m = "accuracy_m" in ACCURACY, InLaterChannelsWith("own_accuracy");
        /// Nearest range, m. Default: 0.
        range_min_m = "rangeMin_m" in MIN_RANGE;
        /// Farthest range, m. Default: unlimited.
        range_max_m = "rangeMax_m" in MAX_RANGE;
        /// Maximum number of returns per pulse; 0 = unlimited, the default.
        max_returns = "maxNOR" in COUNT;
        /// Detection threshold, W. Default: 0.0001.
        received_energy_min_w = "receivedEnergyMin_W" in NOT_NEGATIVE;
        /// Target whose echo just reaches the threshold, instead of `received_energy_min_w`: `{ range_m =
        /// 600, reflectance = 0.9, pulse_freq_hz = 100000 }`; refined physics.
        max_range = "maxRange", With("receiver");
        /// Noise of detector and amplifier: standard deviation of a sample, W (noise equivalent power);
        /// refined physics. Default: no noise.
        nep_w = "nep_W" in NOISE_POWER_W, With("receiver");
        /// The same noise by a target and the ratio of its echo's peak to it: `{ range_m = 100, reflectance =
        /// 0.2, value = 20 }`; refined physics.
        snr = "snr", With("receiver");
        /// Mean power of background light on the detector, W, of which there is shot noise; refined physics.
        /// Default: 0.
        background_w = "background_W" in NOT_NEGATIVE, With("receiver");
        /// Photocurrent per optical power, A/W; makes shot noise of background light and echoes; refined
        /// physics. Default: no shot noise.
        responsivity_a_per_w = "responsivity_A_per_W" in RESPONSIVITY, With("receiver");
        /// Electrical bandwidth of the receiver, Hz; refined physics. Default: 0.44 over the pulse's width at
        /// half maximum.
        bandwidth_hz = "bandwidth_Hz" in BANDWIDTH, With("receiver");
        /// Amplitude at which the receiver saturates, W; refined physics. Default: never.
        saturation_w = "saturation_W" in POSITIVE, With("receiver");
        /// Range that an echo right at the threshold is measured too far, m; stronger ones in proportion to
        /// threshold over amplitude; refined physics. Default: 0.
        range_walk_m = "rangeWalk_m" in RANGE_WALK, With("receiver");
        /// Samples lie on a grid of bins counted from the emission, instead of beginning with the first
        /// return; refined physics. Default: false.
        digitiser_clock = "digitiserClock", With("receiver");
        /// How the range of an echo is read from the waveform: `peak` (the default), `centroid` or `gaussian`
        /// (fit); or `photons`: every photoelectron is a return of its own; refined physics.
        detector = "detector", With("receiver");
        /// Standard deviation of the range by the strength of the echo, instead of `accuracy_m`: `{
        /// constant_m = 0.005, shot_m = 0.02, amplifier_m = 0.01 }`; refined physics.
        range_noise = "rangeNoise", With("receiver");
        /// Photoelectrons of an echo right at the threshold, a whole number: strengths have the Poisson
        /// statistics of photons, so that echoes near the threshold are detected now and then; refined
        /// physics. Default: strengths do not vary.
        threshold_photons = "thresholdPhotons" in THRESHOLD_PHOTONS, With("receiver");
        /// Share of the echoes that are lost whatever their strength; refined physics. Default: 0.
        dropout_rate = "dropoutRate" in DROPOUT_RATE, With("receiver");
        /// Time after an echo during which the receiver detects no other one, ns; refined physics. Default:
        /// 0.
        dead_time_ns = "deadTime_ns" in DEAD_TIME_NS, With("receiver");
        /// Ranges are reported in multiples of it, m; refined physics. Default: 0, any range.
        range_step_m = "rangeStep_m" in ACCURACY, With("receiver");
        /// Field of view of the receiver, full angle, rad: how much light that water has scattered forward
        /// it receives (`water_beam_attenuation`); refined physics. Default: all of it.
        receiver_fov_rad = "receiverFov_rad" in FIELD_OF_VIEW, With("receiver");
        /// Points below water are where the light was, bent and slowed down by the water's mean surface,
        /// instead of on the axis of the beam; refined physics. Default: false.
        refraction_corrected = "refractionCorrected", With("receiver");
        /// Frequency-modulated continuous wave: `{ bandwidth_hz = 1e9, chirp_s = 1e-5 }`; the range
        /// resolution is c over twice the bandwidth, velocities fold and strengths have speckle; refined
        /// physics. Default: pulses.
        fmcw, With("receiver");
        /// Pixels that share the light, each with a dead time; `detector = "photons"`, refined physics.
        /// Default: 1.
        pixels in PIXELS, With("receiver");
        /// Standard deviation of the times of photons, ns; `detector = "photons"`, refined physics. Default:
        /// 0.
        photon_jitter_ns in DEAD_TIME_NS, With("receiver");
        /// Photoelectrons of a pixel per second without light; `detector = "photons"`, refined physics.
        /// Default: 0.
        dark_counts_hz in DARK_COUNTS, With("receiver");
        /// Photoelectrons that earlier ones cause: `{ probability = 0.01, delay_ns = 10 }`; `detector =
        /// "photons"`, refined physics. Default: none.
        afterpulse, With("receiver");
        /// Metres added to each range, a formula of the deflection angle THETA in radians. Default: none.
        range_error_m = "rangeError";
        /// Radians added to the deflection angle, a formula of THETA; `rotating` only. Default: none.
        deflection_error_rad = "deflectionError";
        /// Radians added to the head angle, a formula of THETA; `rotating` only. Default: none.
        head_error_rad = "headError";
        /// Elevations of the beams of channels, degrees, from channel 0 on, instead of `[[scanner.channel]]`
        /// tables. Not in channels.
        elevations_deg in ANGLE;
        /// Azimuths of the beams of these channels, degrees, clockwise seen from above. Not in channels.
        /// Default: 0.
        azimuths_deg in ANGLE;
        /// Distance of the origin of these beams from that of the emitter, towards azimuth 0, m: one number
        /// in brackets, or one for each channel. Not in channels. Default: 0.
        origin_radii_m in NUMBER;
        /// File of the angles of these channels, instead of `elevations_deg`: an angle correction file of
        /// Hesai (.csv: channel, elevation, azimuth, perhaps firing time) or the beam intrinsics of an Ouster
        /// sensor (.json). Not in channels.
        corrections;
        /// File of the firing times of these channels, as those of Hesai (.csv: channel, fire time in µs).
        /// Not in channels.
        firing_times;
        /// Channels that fire at the same time. Default: none, the scanner is one device.
        channel = "channels";
    }
}

keys! {
    /// `[[scanner]]`: one of several scanners on one platform, with the keys of `[scanner]` and these. All
    /// scanners share the flight, the scene and all other tables.
    RigKeys = "[[scanner]]" {
        /// Name of the scanner, unique in the file: letters, digits, `-`, `_` and `.`. Required.
        name;
        /// Pose of this scanner on the platform. Default: `mount` of `[platform]`.
        mount;
        /// Output of this scanner, instead of `[[output]]` tables: a path, a list of paths, or tables
        /// `[[scanner.output]]` with the keys of `[[output]]`. Required. Scanners that name the same MCAP
        /// file share it, with a topic each.
        output;
        /// Settings of this scanner, which override those of `[settings]`.
        settings;
    }
}

keys! {
    /// A target that faces the instrument and fills its beam, as data sheets state figures for.
    TargetKeys = "max_range" {
        /// Range, m.
        range_m = "range_m" in POSITIVE;
        /// Reflectance, 0 to 1.
        reflectance = "reflectance" in FRACTION;
        /// Pulse rate, Hz. Default: the scanner's first.
        pulse_freq_hz = "pulseFreq_Hz" in POSITIVE;
    }
}

keys! {
    /// A target and the signal-to-noise ratio of its echo.
    RatioKeys = "snr" {
        /// Range, m.
        range_m = "range_m" in POSITIVE;
        /// Reflectance, 0 to 1.
        reflectance = "reflectance" in FRACTION;
        /// Pulse rate, Hz. Default: the scanner's first.
        pulse_freq_hz = "pulseFreq_Hz" in POSITIVE;
        /// Peak amplitude over the noise's standard deviation.
        value = "value" in POSITIVE;
    }
}

keys! {
    /// Share of the light of near targets that reaches the detector.
    OverlapKeys = "overlap" {
        /// Full field of view of the receiver, rad.
        field_of_view_rad = "fieldOfView_rad" in DIVERGENCE;
        /// Distance between the axes of transmitter and receiver, m. Default: 0, they have one axis.
        baseline_m = "baseline_m" in APERTURE;
        /// Range at which the receiver is focused and its axis meets that of the transmitter, m. Default: far
        /// away.
        focus_m = "focus_m" in POSITIVE;
    }
}

keys! {
    /// Frequency-modulated continuous wave.
    FmcwKeys = "fmcw" {
        /// Bandwidth of a chirp, Hz.
        bandwidth_hz in BANDWIDTH;
        /// Duration of a chirp, up or down, s.
        chirp_s in CHIRP_S;
        /// Sampling rate of the beat, Hz: higher frequencies fold. Default: all are measured.
        sample_rate_hz in BANDWIDTH;
        /// The receiver has both quadratures and measures the sign of frequencies. Default: false, a real
        /// receiver, which confuses range and velocity of fast targets at short range.
        quadrature;
        /// Probability of a false alarm that the threshold has; strengths have the statistics of a single
        /// speckle. Default: strengths do not vary.
        false_alarm in FALSE_ALARM;
    }
}

keys! {
    /// Afterpulses of a photon counter.
    AfterpulseKeys = "afterpulse" {
        /// Probability that a photoelectron causes another one.
        probability in AFTERPULSE;
        /// Mean delay after the dead time, ns.
        delay_ns in POSITIVE;
    }
}

keys! {
    /// Standard deviations of a range by the strength of its echo, independent of each other.
    RangeNoiseKeys = "range_noise" {
        /// Of echoes of any strength, m. Default: 0.
        constant_m = "constant_m" in ACCURACY;
        /// By photon noise, of an echo right at the threshold, m: falls with the root of the strength.
        /// Default: 0.
        shot_m = "shot_m" in ACCURACY;
        /// By noise of the amplifier, of an echo right at the threshold, m: falls with the strength. Default:
        /// 0.
        amplifier_m = "amplifier_m" in ACCURACY;
        /// By the texture of surfaces within the footprint, over the standard deviation of the depths within
        /// the footprint, which grows with the angle of incidence. Default: 0.
        footprint = "footprint" in NOT_NEGATIVE;
    }
}

keys! {
    /// A rotating wedge prism.
    PrismKeys = "prisms" {
        /// Turns per second; the sign is the sense.
        rotor_freq_hz in ROTOR_FREQ;
        /// Wedge angle, degrees; positive: inclined face towards the incoming beam.
        wedge_deg in WEDGE;
        /// Refractive index.
        index in REFRACTIVE_INDEX;
    }
}

keys! {
    /// A sine that is added to the phase of a deflector.
    WanderKeys = "scan_wander" {
        /// Largest deviation, in the degrees of `scan_phase_deg`.
        amplitude_deg in ANGLE;
        /// Periods of the deviation per second.
        freq_hz in POSITIVE;
        /// Phase of the sine at the start of the leg, degrees. Default: 0.
        phase_deg in ANGLE;
    }
}

keys! {
    /// `[settings]` and `leg.settings`: what the scanner does.
    SettingsKeys = "[settings]" {
        /// Pulses per second. Default: the scanner's first frequency.
        pulse_freq_hz = "pulseFreq_hz" in PULSE_FREQ;
        /// File of the times at which pulses leave, in place of `pulse_freq_hz`: one per line, s from the
        /// start of the leg, ascending. After the last one the leg goes on without pulses. Platforms that
        /// stand, fly straight or follow a trajectory.
        pulse_times;
        /// Intervals between pulses in µs that repeat, in place of `pulse_freq_hz`: `[0.54, 0.66, 0.84]`.
        pulse_intervals_us;
        /// Lines (`rotating`) or periods (`oscillating`) per second. Default: 0.
        scan_freq_hz = "scanFreq_hz" in SCAN_FREQ;
        /// Half opening angle of the swath, degrees. Default: the scanner's maximum.
        scan_angle_deg = "scanAngle_deg" in HALF_ANGLE;
        /// Lowest deflection angle that fires, degrees. Default: from `scan_angle_deg`.
        vertical_angle_min_deg = "verticalAngleMin_deg" in ANGLE;
        /// Highest deflection angle that fires, degrees. Default: from `scan_angle_deg`.
        vertical_angle_max_deg = "verticalAngleMax_deg" in ANGLE;
        /// Speed of the head, degrees per second, signed. Default: 0.
        head_rate_deg_per_s = "headRotatePerSec_deg" in HEAD_RATE;
        /// Angle at which the head starts, degrees. Default: 0.
        head_start_deg = "headRotateStart_deg" in ANGLE;
        /// Angle at which the head stops, degrees; the leg lasts at least until then. Default: 0. A head that
        /// stops at the angle of its start turns until the platform arrives.
        head_stop_deg = "headRotateStop_deg" in ANGLE;
        /// Spacing of lines along the mirror's sweep, degrees: with the horizontal one it replaces scan
        /// frequency and head speed (`rotating` only).
        vertical_resolution_deg = "verticalResolution_deg" in ANGLE;
        /// Spacing of lines along the head's rotation, degrees.
        horizontal_resolution_deg = "horizontalResolution_deg" in ANGLE;
        /// Beam divergence of the first channel, rad. Default: the scanner's.
        beam_divergence_rad = "beamDivergence_rad" in DIVERGENCE;
        /// Spacing of trajectory samples, s; 0 writes none, the default.
        trajectory_interval_s = "trajectoryTimeInterval_s" in SAMPLE_INTERVAL;
        /// Ends the leg after that time, s. Default: no limit.
        max_duration_s = "maxDuration_s";
        /// The optics move that long before the first pulse, s. Default: 0.
        warmup_s = "opticsWarmupPhase_s" in WARMUP;
        /// Fog, rain, snow and dust between the instrument and the surfaces: `{ mor_m = 100, rain_mm_h = 10
        /// }`; a table of a leg changes the keys that it names; refined physics. Default: none of them.
        weather;
    }
}

keys! {
    /// Weather along the beam.
    WeatherKeys = "weather" {
        /// Meteorological optical range of fog, m: contrast falls to 5 % there. Replaces the haze of the
        /// scanner's `visibility_km`. Default: no fog.
        mor_m in OPTICAL_RANGE;
        /// Visibility in haze by Kruse's formula, km, instead of that of the scanner. Haze extinguishes
        /// light and returns none.
        visibility_km in VISIBILITY;
        /// Rainfall, mm/h. Default: 0.
        rain_mm_h in RAIN_RATE;
        /// Snowfall, mm/h of melted water. Default: 0.
        snow_mm_h in SNOW_RATE;
        /// Extinction by dust, per metre. Default: 0.
        dust in DUST;
        /// Extinction over backscatter of fog, snow and dust, sr. Default: 18.5, fog at 905 nm.
        lidar_ratio_sr in LIDAR_RATIO;
        /// Factor on the light that raindrops return. Default: 1, reflections at the front and the rear of
        /// the drop.
        drop_factor in DROP_FACTOR;
        /// File of the weather over time, instead of constant numbers: lines of GPS time (as points have it),
        /// s, `mor_m` (0: no fog), `rain_mm_h`, `snow_mm_h` and `dust`, linear in between.
        over_time;
    }
}

keys! {
    /// `[[leg]]`: a waypoint and the way to the next one. The last leg of a moving platform is where it
    /// arrives.
    LegKeys = "[[leg]]" {
        /// World position x, y, z in metres.
        position_m = "x";
        /// Take z from the ground. Default: false.
        on_ground = "onGround";
        /// Speed, m/s. Default: 70.
        speed_m_per_s = "movePerSec_m" in SPEED;
        /// True if the scanner fires. Default: true.
        active = "active";
        /// The id of a platform that ships, or `file.xml#id`, of one that carries the scanner in this leg,
        /// with its mount; it has to be of the kind of `[platform]`. Default: `[platform]`.
        platform = "platform";
        /// Mount of the scanner in this leg. Default: that of the leg's `platform`, or of `[platform]`.
        mount = "scannerMount";
        /// Legs with the same strip share their output. Default: none.
        strip = "stripId";
        /// Settings that differ from `[settings]`.
        settings;
    }
}

keys! {
    /// `[waveform]`.
    WaveformKeys = "[waveform]" {
        /// Width of a bin, ns. Default: 0.25.
        bin_ns = "binSize_ns" in BIN_NS;
        /// Peak search window, ns. Default: 1.
        window_ns = "winSize_ns" in BIN_NS;
        /// Number of concentric rings of subrays. Default: 3.
        quality = "beamSampleQuality" in QUALITY;
        /// Longest waveform, ns; 0 is unlimited, the default.
        max_range_ns = "maxFullwaveRange_ns" in NOT_NEGATIVE;
    }
}

keys! {
    /// `[detector]`: replaces the scanner's values.
    DetectorKeys = "[detector]" {
        /// Standard deviation of the range noise, m.
        accuracy_m = "accuracy_m" in ACCURACY;
        /// Nearest range, m.
        range_min_m = "rangeMin_m" in MIN_RANGE;
        /// Farthest range, m.
        range_max_m = "rangeMax_m" in MAX_RANGE;
        /// Maximum number of returns per pulse; 0 = unlimited.
        max_returns = "maxNOR" in COUNT;
        /// Factor on the range noise, a formula of the range t in metres.
        distance_error = "distanceMeasurementError";
    }
}
