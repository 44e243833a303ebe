//! A device of an instrument: what the keys of `[scanner]`, `<scanner>`, channels, `[detector]`,
//! `<detectorSettings>` and waveform settings change of it (spec input-formats §2.11–2.12, §6).

use super::deflector::{change_deflector, refuse_unused};
use super::fields::Fields;
use super::keys::{DetectorKeys, InstrumentKeys, Key, WaveformKeys};
use super::receiver::{change_emission, change_pulse_shape, change_receiver};
use super::scan_motion::change_scan_motion;
use super::{
    Beam, BeamProfile, Deflector, Detector, Device, Formula, Head, MechanicalErrors, Mount, Receiver,
    ScanMotion, StatedFigures, WaveformPlace, WaveformSettings,
};
use vlscan_base::quantity::{NOT_NEGATIVE, number};
use vlscan_geom::{DVec3, degrees};

const K: InstrumentKeys = InstrumentKeys::KEYS;

/// The pulse length that the waveform settings of a multi-channel scanner assume, ns (spec input-formats
/// §2.11).
pub(super) const MULTI_CHANNEL_PULSE_LENGTH: f64 = 4.0;

pub(super) const WAVEFORM: WaveformSettings =
    WaveformSettings { bin: 0.25, window: 1.0, quality: 3, max_range: 0.0 };

pub(super) const DETECTOR: Detector = Detector {
    accuracy: 0.0,
    range_min: 0.0,
    range_max: f64::MAX,
    max_returns: 0,
    threshold: 0.0001,
    threshold_given: false,
    distance_error: None,
};

pub(super) const DEVICE_BEAM: Beam = Beam {
    divergence: 0.0003,
    divergence_y: None,
    profile: BeamProfile::Gaussian,
    aperture: 0.0,
    pulse_length: 4.0,
    wavelength: 1064.0,
    atmosphere_wavelength: 1064.0,
    stated_width: None,
    average_power: 4.0,
    pulse_energy: None,
    quality: 1.0,
    efficiency: 0.99,
    receiver_diameter: 0.15,
    overlap: None,
    visibility: 23.0,
};

impl Device {
    /// A device with this deflector on a head that does not turn, and otherwise the defaults of `[scanner]`
    /// in pipeline files: 1064 nm, 0.3 mrad, pulses of 4 ns, any range, no noise.
    pub fn new(deflector: Deflector) -> Device {
        Device {
            id: String::new(),
            deflector,
            scan_motion: ScanMotion::default(),
            scan_angle_max: 0.0,
            scan_freq: (0.0, 0.0),
            head: Head { axis: DVec3::Z, max_rate: 0.0 },
            beam_origin: Mount::IDENTITY,
            firing_offset: 0.0,
            beam: DEVICE_BEAM,
            detector: DETECTOR,
            receiver: Receiver::default(),
            waveform: WAVEFORM,
            waveform_place: None,
            errors: MechanicalErrors::default(),
            stated: StatedFigures::default(),
        }
    }
}

/// Applies the keys of a scanner or a channel to a device. `None` for unknown optics.
pub(super) fn change_device(fields: &mut Fields, device: &mut Device, in_channel: bool) -> Option<()> {
    let deflector = change_deflector(fields, device, in_channel);
    change_scan_motion(fields, device);
    if let Some(axis) = fields.xyz(K.head_axis) {
        match axis.length() > 0.1 {
            true => device.head.axis = axis,
            false if fields.is_toml() => fields.refuse(K.head_axis, "an axis longer than 0.1"),
            false => {
                let DVec3 { x, y, z } = device.head.axis;
                let message = format!("the head axis is shorter than 0.1; {x} {y} {z} is used");
                fields.context.warn(fields.place(K.head_axis), message);
            }
        }
    }
    fields.set_angle(K.head_rate_max_deg_per_s, &mut device.head.max_rate);
    if device.head.max_rate < 0.0 {
        device.head.max_rate = -device.head.max_rate;
        let used = number(degrees(device.head.max_rate));
        fields.warn(K.head_rate_max_deg_per_s, &format!("is below 0; its amount, {used} °/s, is the limit"));
    }
    device.beam_origin = fields.pose(K.beam_origin).unwrap_or(device.beam_origin);
    if fields.is_toml() || in_channel {
        device.firing_offset =
            fields.optional(K.firing_offset_us).map_or(device.firing_offset, |us| us * 1e-6);
    }
    change_beam(fields, &mut device.beam, in_channel);
    change_emission(fields, &mut device.beam);
    change_pulse_shape(fields, &mut device.receiver);
    let detector = &mut device.detector;
    change_ranges(fields, detector);
    detector.max_returns = fields.count(K.max_returns, detector.max_returns);
    fields.set(K.received_energy_min_w, &mut detector.threshold);
    if fields.has(K.received_energy_min_w) {
        detector.threshold_given = true;
        device.receiver.max_range = None;
    }
    change_receiver(fields, &mut device.receiver);
    if fields.is_toml() || !in_channel {
        change_errors(fields, device);
    }
    if !matches!(device.deflector, Deflector::Polygon { .. }) {
        (device.errors.deflection, device.errors.head) = (None, None);
    }
    deflector
}

fn change_beam(fields: &mut Fields, beam: &mut Beam, in_channel: bool) {
    let of_scanner: [(Key, &mut f64); 5] = [
        (K.average_power_w, &mut beam.average_power),
        (K.beam_quality, &mut beam.quality),
        (K.optical_efficiency, &mut beam.efficiency),
        (K.receiver_diameter_m, &mut beam.receiver_diameter),
        (K.visibility_km, &mut beam.visibility),
    ];
    for (key, target) in of_scanner {
        match in_channel && !fields.is_toml() {
            true => {
                fields.without_effect(&[key], "in a <channel>; that of the scanner applies to all channels")
            }
            false => fields.set(key, target),
        }
    }
    fields.set(K.beam_divergence_rad, &mut beam.divergence);
    fields.set(K.pulse_length_ns, &mut beam.pulse_length);
    beam.stated_width = match fields.is_built_in() {
        true => Some(beam.pulse_length),
        false => beam.stated_width.filter(|_| !fields.has(K.pulse_length_ns)),
    };
    beam.wavelength = f64::from(fields.count(K.wavelength_nm, beam.wavelength as u32));
    if fields.has(K.wavelength_nm) && !in_channel {
        beam.atmosphere_wavelength = beam.wavelength;
    }
}

/// Applies the accuracy and the range limits.
pub(super) fn change_ranges(fields: &mut Fields, detector: &mut Detector) {
    fields.set(K.accuracy_m, &mut detector.accuracy);
    fields.set(K.range_min_m, &mut detector.range_min);
    match fields.is_infinite(K.range_max_m) {
        true => detector.range_max = f64::MAX,
        false => fields.set(K.range_max_m, &mut detector.range_max),
    }
    fields.in_order((detector.range_min, detector.range_max), [K.range_min_m, K.range_max_m], "");
}

fn change_errors(fields: &mut Fields, device: &mut Device) {
    let is_rotating = matches!(device.deflector, Deflector::Polygon { .. });
    let rotating_only = [K.deflection_error_rad, K.head_error_rad];
    if !is_rotating {
        for key in rotating_only.iter().filter(|key| !fields.is_toml() && fields.has(**key)) {
            let message = format!("<{}> needs rotating optics", fields.name(*key));
            fields.context.error(fields.place(*key), message);
        }
        if fields.is_toml() {
            refuse_unused(fields, &rotating_only, "rotating", "");
        }
        fields.ignore(&rotating_only);
    }
    // Channels may have heads of their own.
    let has_no_head = device.head.max_rate == 0.0 && !fields.has(K.channel);
    if is_rotating && has_no_head && fields.has(K.head_error_rad) {
        fields.warn_of_effect(K.head_error_rad, "because the head does not turn");
    }
    let mut formula = |key: Key| -> Option<(Formula, f64)> {
        if fields.is_toml() {
            return fields.formula(key).map(|formula| (formula, 0.0));
        }
        let mut child = fields.element_child(key)?;
        if !child.has("expr") {
            child.missing("expr");
        }
        let formula = child.formula("expr");
        let mut threshold = 0.0;
        if key == K.head_error_rad {
            child.set_angle(Key::attribute("zeroSinThreshold_deg", &NOT_NEGATIVE), &mut threshold);
        }
        child.done(&[]);
        Some((formula?, threshold))
    };
    let errors = &mut device.errors;
    errors.range = formula(K.range_error_m).map(|f| f.0).or(errors.range.take());
    if is_rotating {
        errors.deflection = formula(K.deflection_error_rad).map(|f| f.0).or(errors.deflection.take());
        errors.head = formula(K.head_error_rad).or(errors.head.take());
    }
}

/// Applies `[waveform]` or `<FWFSettings>`.
pub(super) fn change_waveform(fields: &mut Fields, waveform: &mut WaveformSettings) {
    let keys = WaveformKeys::KEYS;
    fields.set(keys.bin_ns, &mut waveform.bin);
    fields.set(keys.window_ns, &mut waveform.window);
    waveform.quality = fields.count(keys.quality, waveform.quality);
    fields.set(keys.max_range_ns, &mut waveform.max_range);
}

/// Place of the bins and the window of a waveform.
pub(super) fn waveform_place(fields: &Fields) -> Option<WaveformPlace> {
    let keys = [WaveformKeys::KEYS.bin_ns, WaveformKeys::KEYS.window_ns];
    let written = keys.into_iter().rev().find_map(|key| fields.place_if_written(key));
    // In XML the element itself resets the window.
    let place = written.or_else(|| (!fields.is_toml()).then(|| fields.own_place()))?;
    Some(WaveformPlace { place, keys: keys.map(|key| fields.name(key)) })
}

/// Applies the `<FWFSettings>` of an element. Whenever there is one, the window is reset to a quarter of the
/// pulse length (ns) (spec input-formats §2.11).
pub(super) fn change_waveform_of(fields: &mut Fields, device: &mut Device, pulse_length: f64) {
    let Some(mut child) = fields.element_child("FWFSettings") else { return };
    device.waveform.window = pulse_length / 4.0;
    change_waveform(&mut child, &mut device.waveform);
    if !child.is_built_in() {
        device.waveform_place = waveform_place(&child);
    }
    let why = "here, as in HELIOS++; `receiverDiameter_m` of the scanner has";
    child.without_effect(&["apertureDiameter_m"], why);
    child.done(&[]);
}

/// Applies `[detector]` or the ranges of `<detectorSettings>`.
pub(super) fn change_detector(fields: &mut Fields, device: &mut Device) {
    let detector = &mut device.detector;
    change_ranges(fields, detector);
    if fields.has(DetectorKeys::KEYS.accuracy_m) {
        device.receiver.range_noise = None;
    }
    if let Some(formula) = fields.formula(DetectorKeys::KEYS.distance_error) {
        detector.distance_error = Some(formula);
    }
}
