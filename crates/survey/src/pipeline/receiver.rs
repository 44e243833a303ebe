//! Keys of `[scanner]` and its channels that describe pulse and receiver.

use super::super::pulse_file::read_pulse_file;
use super::super::{AmplifierNoise, Device, Receiver, ReferenceTarget, ShotNoise, pulse_length_of_width};
use super::keys::{InstrumentKeys, Key};
use super::values::Values;
use toml::Spanned;
use vlscan_base::quantity::{self, DIVERGENCE, FRACTION};

/// Applies pulse energy, width, shape, profile and aperture to the device, after pulse length and divergence.
pub(super) fn change_emission(values: &Values, device: &mut Device, keys: &InstrumentKeys) {
    let beam = &mut device.beam;
    if let Some(key) = &keys.pulse_fwhm_ns {
        if keys.pulse_length_ns.is_some() {
            values.refuse(key, "either `pulse_length_ns` or `pulse_fwhm_ns`");
        }
        let mut width = 1.0;
        values.set(&mut width, &keys.pulse_fwhm_ns, &quantity::PULSE_LENGTH_NS);
        (beam.pulse_length, beam.stated_width) = (pulse_length_of_width(width), None);
    }
    if keys.pulse_energy_uj.is_some() {
        let mut energy_uj = 1.0;
        values.set(&mut energy_uj, &keys.pulse_energy_uj, &quantity::PULSE_ENERGY_UJ);
        beam.pulse_energy = Some(energy_uj * 1e-6);
    }
    if keys.beam_divergence_y_rad.is_some() {
        values.set(beam.divergence_y.insert(beam.divergence), &keys.beam_divergence_y_rad, &DIVERGENCE);
    }
    values.set(&mut beam.aperture, &keys.exit_aperture_m, &quantity::APERTURE);
    beam.profile = keys.beam_profile.unwrap_or(beam.profile);
    if let Some(key) = &keys.pulse_shape {
        let place = values.source.place(key.span());
        let samples = read_pulse_file(values.context, key.get_ref(), values.source.folder(), place);
        device.receiver.pulse_shape = samples.or(device.receiver.pulse_shape.take());
    }
}

/// Applies noise, threshold, saturation, digitiser and detector to the device.
pub(super) fn change_receiver(values: &Values, device: &mut Device, keys: &InstrumentKeys) {
    if keys.received_energy_min_w.is_some() {
        device.detector.threshold_given = true;
        device.receiver.max_range = None;
    }
    let receiver = &mut device.receiver;
    if let Some(table) = &keys.max_range {
        if let Some(key) = &keys.received_energy_min_w {
            values.refuse(key, "either `received_energy_min_w` or `max_range`");
        }
        let target = table.get_ref();
        receiver.max_range =
            Some(read_target(values, &target.range_m, &target.reflectance, &target.pulse_freq_hz));
    }
    if let Some(power) = positive(values, &keys.nep_w) {
        receiver.noise = Some(AmplifierNoise::Power(power));
    }
    if let Some(table) = &keys.snr {
        if let Some(key) = &keys.nep_w {
            values.refuse(key, "either `nep_w` or `snr`");
        }
        let ratio = table.get_ref();
        let target = read_target(values, &ratio.range_m, &ratio.reflectance, &ratio.pulse_freq_hz);
        let value = positive(values, &Some(ratio.value.clone())).unwrap_or(1.0);
        receiver.noise = Some(AmplifierNoise::Ratio { target, value });
    }
    change_shot(values, receiver, keys);
    if let Some(power) = positive(values, &keys.saturation_w) {
        receiver.saturation = Some(power);
    }
    values.number(&mut receiver.range_walk, &keys.range_walk_m);
    receiver.digitiser_clock = keys.digitiser_clock.unwrap_or(receiver.digitiser_clock);
    receiver.ranging = keys.detector.unwrap_or(receiver.ranging);
}

fn change_shot(values: &Values, receiver: &mut Receiver, keys: &InstrumentKeys) {
    receiver.bandwidth = positive(values, &keys.bandwidth_hz).or(receiver.bandwidth);
    let given = [&keys.background_w, &keys.responsivity_a_per_w];
    let Some(first) = given.into_iter().flatten().next() else { return };
    let mut shot = receiver.shot.unwrap_or(ShotNoise { background: 0.0, responsivity: 0.0 });
    values.not_negative(&mut shot.background, &keys.background_w);
    values.positive(&mut shot.responsivity, &keys.responsivity_a_per_w);
    if shot.responsivity == 0.0 {
        let message = "background light needs `responsivity_a_per_w`, from which its shot noise follows";
        values.context.error(values.source.place(first.span()), message);
        return;
    }
    receiver.shot = Some(shot);
}

fn read_target(
    values: &Values,
    range: &Spanned<f64>,
    reflectance: &Spanned<f64>,
    pulse_freq: &Key<f64>,
) -> ReferenceTarget {
    let mut target = ReferenceTarget { range: 1.0, reflectance: 1.0, pulse_freq: None };
    values.positive(&mut target.range, &Some(range.clone()));
    let fraction = Some(reflectance.clone());
    values.set(&mut target.reflectance, &fraction, &FRACTION);
    target.pulse_freq = positive(values, pulse_freq);
    target
}

/// The value of a key, which must be above 0; `None` if the key is missing.
fn positive(values: &Values, key: &Key<f64>) -> Option<f64> {
    let mut value = f64::NAN;
    values.positive(&mut value, key);
    (!value.is_nan()).then_some(value)
}
