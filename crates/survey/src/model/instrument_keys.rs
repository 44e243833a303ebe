//! Which physics makes use of which key of an instrument: the one list of all keys of `[scanner]`, `<scanner>`, `<channel>`
//! and `<detectorSettings>`. A key that the chosen physics passes over is warned of where it was written.

use vlscan_base::diag::{Diagnostics, Place};

/// When a key has an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyUse {
    /// In all physics.
    Always,
    /// Only with the correction of that name, which is part of the refined physics.
    With(&'static str),
    /// Only without the correction of that name.
    Without(&'static str),
    /// In the scanner and its first channel always, in later channels only with the correction of that name.
    InLaterChannelsWith(&'static str),
    /// Unless the device has another key and the correction of that name is on.
    UnlessBeside {
        /// The TOML name of the other key.
        key: &'static str,
        /// The correction by which that key has its effect.
        correction: &'static str,
    },
}

/// A key of an instrument.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstrumentKey {
    /// Its name in pipeline files; empty if they have none.
    pub key: &'static str,
    /// Its XML attribute or child element; empty if it has none.
    pub attribute: &'static str,
    /// When it has an effect.
    pub used: KeyUse,
}

const fn key(key: &'static str, attribute: &'static str, used: KeyUse) -> InstrumentKey {
    InstrumentKey { key, attribute, used }
}

use KeyUse::{Always, InLaterChannelsWith, UnlessBeside, With, Without};

/// All keys of an instrument.
pub const INSTRUMENT_KEYS: &[InstrumentKey] = &[
    key("catalogue", "", Always),
    key("id", "id", Always),
    key("name", "name", Always),
    key("channel", "channels", Always),
    // Motion of the beam.
    key("optics", "optics", Always),
    key("pulse_freqs_hz", "pulseFreqs_Hz", Always),
    key("scan_angle_max_deg", "scanAngleMax_deg", Always),
    key("scan_angle_effective_max_deg", "scanAngleEffectiveMax_deg", Always),
    key("facet_tilts_deg", "facetTilts_deg", Always),
    key("scan_angle_along_max_deg", "scanAngleAlongMax_deg", Always),
    key("scan_freq_min_hz", "scanFreqMin_Hz", Always),
    key("scan_freq_max_hz", "scanFreqMax_Hz", Always),
    key("scan_product_deg_hz", "scanProduct", Always),
    key("fibres", "numFibers", Always),
    key("prisms", "", Always),
    key("", "rotorFreq1_Hz", Always),
    key("", "rotorFreq2_Hz", Always),
    key("", "rotorFreq3_Hz", Always),
    key("", "angle1_deg", Always),
    key("", "angle2_deg", Always),
    key("", "angle3_deg", Always),
    key("", "refrIndex1", Always),
    key("", "refrIndex2", Always),
    key("", "refrIndex3", Always),
    key("air_index", "refrIndex_air", Always),
    key("incident_beam", "incidentBeam", Always),
    key("head_axis", "headRotateAxis", Always),
    key("head_rate_max_deg_per_s", "headRotatePerSecMax_deg", Always),
    key("beam_origin", "beamOrigin", Always),
    key("firing_offset_us", "firingOffset_us", With("firing_offsets")),
    key("", "firingOffsets_us", With("firing_offsets")),
    key("", "elevations_deg", Always),
    key("range_error_m", "rangeError", Always),
    key("deflection_error_rad", "deflectionError", Always),
    key("head_error_rad", "headError", Always),
    // Beam and pulse.
    key("beam_divergence_rad", "beamDivergence_rad", Always),
    key("beam_divergence_y_rad", "beamDivergenceY_rad", With("equal_energy")),
    key("beam_profile", "beamProfile", With("equal_energy")),
    key("exit_aperture_m", "exitAperture_m", With("equal_energy")),
    key("pulse_length_ns", "pulseLength_ns", UnlessBeside { key: "pulse_shape", correction: "receiver" }),
    key("pulse_fwhm_ns", "pulseFwhm_ns", UnlessBeside { key: "pulse_shape", correction: "receiver" }),
    key("pulse_shape", "pulseShape", With("receiver")),
    key("pulse_energy_uj", "pulseEnergy_uJ", With("radiometry")),
    key(
        "average_power_w",
        "averagePower_w",
        UnlessBeside { key: "pulse_energy_uj", correction: "radiometry" },
    ),
    key("wavelength_nm", "wavelength_nm", Always),
    key("beam_quality", "beamQualityFactor", Without("radiometry")),
    key("optical_efficiency", "opticalEfficiency", Always),
    key("receiver_diameter_m", "receiverDiameter_m", Always),
    key("visibility_km", "atmosphericVisibility_km", Always),
    // Receiver.
    key("accuracy_m", "accuracy_m", InLaterChannelsWith("own_accuracy")),
    key("range_min_m", "rangeMin_m", Always),
    key("range_max_m", "rangeMax_m", Always),
    key("max_returns", "maxNOR", Always),
    key("received_energy_min_w", "receivedEnergyMin_W", Always),
    key("max_range", "maxRange", With("receiver")),
    key("nep_w", "nep_W", With("receiver")),
    key("snr", "snr", With("receiver")),
    key("background_w", "background_W", With("receiver")),
    key("responsivity_a_per_w", "responsivity_A_per_W", With("receiver")),
    key("bandwidth_hz", "bandwidth_Hz", With("receiver")),
    key("saturation_w", "saturation_W", With("receiver")),
    key("range_walk_m", "rangeWalk_m", With("receiver")),
    key("digitiser_clock", "digitiserClock", With("receiver")),
    key("detector", "detector", With("receiver")),
    key("", "distanceMeasurementError", Always),
    key("", "FWFSettings", Always),
];

/// The key of that name in pipeline files.
pub fn key_named(name: &str) -> Option<&'static InstrumentKey> {
    INSTRUMENT_KEYS.iter().find(|known| !name.is_empty() && known.key == name)
}

/// The key of that XML attribute or child element.
pub fn key_of_attribute(name: &str) -> Option<&'static InstrumentKey> {
    INSTRUMENT_KEYS.iter().find(|known| !name.is_empty() && known.attribute == name)
}

/// A key as the user wrote it.
#[derive(Clone, Debug)]
pub struct WrittenKey {
    /// What it is.
    pub key: &'static InstrumentKey,
    /// Its name as written.
    pub name: &'static str,
    /// Where it was written.
    pub place: Place,
    /// The channel that it belongs to; `None` if it belongs to all.
    pub channel: Option<usize>,
}

/// Warns of the keys that the physics with these corrections passes over. `is_on` tells whether a correction is on.
pub fn warn_of_unused_keys(written: &[WrittenKey], is_on: impl Fn(&str) -> bool, problems: &mut Diagnostics) {
    for WrittenKey { key, name, place, channel } in written {
        let (message, help) = match key.used {
            With(correction) if !is_on(correction) => {
                let flag = correction.replace('_', "-");
                (
                    format!("`{name}` has no effect without the correction {flag} of the physics"),
                    format!(
                        "`--physics refined` makes use of it, as does `--correct {flag}`; or leave it out"
                    ),
                )
            }
            InLaterChannelsWith(correction) if channel.is_some_and(|i| i > 0) && !is_on(correction) => (
                format!(
                    "`{name}` of a channel has no effect: in the physics of HELIOS++ all have the first one's"
                ),
                "`--physics refined` makes use of it; or leave it out".to_owned(),
            ),
            Without(correction) if is_on(correction) => {
                let flag = correction.replace('_', "-");
                (
                    format!(
                        "`{name}` has no effect with the correction {flag}, which is part of the refined physics"
                    ),
                    "leave it out; `--physics helios` makes use of it".to_owned(),
                )
            }
            UnlessBeside { key: other, correction } if is_on(correction) => {
                let holds = |w: &&WrittenKey| {
                    w.key.key == other
                        && w.place.path == place.path
                        && (w.channel.is_none() || w.channel == *channel)
                };
                let Some(beside) = written.iter().find(holds) else { continue };
                (
                    format!("`{name}` has no effect beside `{}`, which replaces it", beside.name),
                    "leave one of them out".to_owned(),
                )
            }
            _ => continue,
        };
        problems.warn(Some(place.clone()), message).help(help);
    }
}
