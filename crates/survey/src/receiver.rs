//! Beam and receiver of a device in more detail than HELIOS++, which ignores these attributes.

use super::fields::Fields;
use super::keys::{
    AfterpulseKeys, FmcwKeys, InstrumentKeys, OverlapKeys, RangeNoiseKeys, RatioKeys, TargetKeys,
};
use super::pulse_file::read_pulse_file;
use super::{
    AmplifierNoise, Beam, BeamProfile, Fmcw, Overlap, RangeNoise, Ranging, Receiver, ReferenceTarget,
    ShotNoise, pulse_length_of_width,
};

const K: InstrumentKeys = InstrumentKeys::KEYS;

/// Applies pulse energy, width, profile and aperture, after pulse length and divergence.
pub(super) fn change_emission(fields: &mut Fields, beam: &mut Beam) {
    fields.either(K.pulse_fwhm_ns, K.pulse_length_ns);
    if let Some(width) = fields.optional(K.pulse_fwhm_ns) {
        (beam.pulse_length, beam.stated_width) = (pulse_length_of_width(width), None);
    }
    if let Some(energy_uj) = fields.optional(K.pulse_energy_uj) {
        beam.pulse_energy = Some(energy_uj * 1e-6);
    }
    let profiles = [("gaussian", BeamProfile::Gaussian), ("top_hat", BeamProfile::TopHat)];
    beam.profile = fields.choice(K.beam_profile, &profiles, None).unwrap_or(beam.profile);
    beam.divergence_y = fields.optional(K.beam_divergence_y_rad).or(beam.divergence_y);
    fields.set(K.exit_aperture_m, &mut beam.aperture);
    if let Some(mut table) = fields.child(K.overlap, &OverlapKeys::TABLE) {
        let keys = OverlapKeys::KEYS;
        let field_of_view = table.exact_number(keys.field_of_view_rad);
        let baseline = table.number(keys.baseline_m, 0.0);
        let focus = table.optional(keys.focus_m).map_or(0.0, f64::recip);
        table.done(&[]);
        beam.overlap =
            field_of_view.map(|field_of_view| Overlap { field_of_view, baseline, focus }).or(beam.overlap);
    }
}

/// Applies the file of the pulse's shape.
pub(super) fn change_pulse_shape(fields: &mut Fields, receiver: &mut Receiver) {
    if let Some(name) = fields.text(K.pulse_shape) {
        let samples = read_pulse_file(fields.context, &name, fields.folder(), fields.place(K.pulse_shape));
        receiver.pulse_shape = samples.or(receiver.pulse_shape.take());
    }
}

/// Applies noise, saturation, digitiser and detector, and the target whose echo just reaches the threshold.
pub(super) fn change_receiver(fields: &mut Fields, receiver: &mut Receiver) {
    fields.either(K.received_energy_min_w, K.max_range);
    fields.either(K.nep_w, K.snr);
    if let Some(mut target) = fields.child(K.max_range, &TargetKeys::TABLE) {
        receiver.max_range = read_target(&mut target);
        target.done(&[]);
    }
    if let Some(mut ratio) = fields.child(K.snr, &RatioKeys::TABLE) {
        let (target, value) = (read_target(&mut ratio), ratio.exact_number(RatioKeys::KEYS.value));
        ratio.done(&[]);
        if let Some((target, value)) = target.zip(value) {
            receiver.noise = Some(AmplifierNoise::Ratio { target, value });
        }
    }
    if let Some(power) = fields.optional(K.nep_w) {
        receiver.noise = Some(AmplifierNoise::Power(power));
    }
    change_shot(fields, receiver);
    receiver.bandwidth = fields.optional(K.bandwidth_hz).or(receiver.bandwidth);
    receiver.saturation = fields.optional(K.saturation_w).or(receiver.saturation);
    fields.set(K.range_walk_m, &mut receiver.range_walk);
    receiver.digitiser_clock = fields.flag(K.digitiser_clock, receiver.digitiser_clock);
    let detectors = [
        ("peak", Ranging::Peak),
        ("centroid", Ranging::Centroid),
        ("gaussian", Ranging::Gaussian),
        ("photons", Ranging::Photons),
    ];
    receiver.ranging = fields.choice(K.detector, &detectors, None).unwrap_or(receiver.ranging);
    change_range_noise(fields, receiver);
    if fields.has(K.threshold_photons) {
        receiver.threshold_photons =
            Some(fields.count(K.threshold_photons, 0)).filter(|photons| *photons > 0);
    }
    fields.set(K.dropout_rate, &mut receiver.dropout_rate);
    fields.set(K.dead_time_ns, &mut receiver.dead_time);
    fields.set(K.range_step_m, &mut receiver.range_step);
    receiver.field_of_view = fields.optional(K.receiver_fov_rad).or(receiver.field_of_view);
    receiver.corrects_refraction = fields.flag(K.refraction_corrected, receiver.corrects_refraction);
    change_fmcw(fields, receiver);
    change_pixels(fields, receiver);
    check_counter(fields, receiver);
    warn_of_bandwidth(fields, receiver);
}

/// Warns of a bandwidth without noise, whose spectrum it limits. Channels may have noise of their own.
fn warn_of_bandwidth(fields: &Fields, receiver: &Receiver) {
    let has_noise = receiver.noise.is_some() || receiver.shot.is_some();
    let has_amplifier = receiver.ranging != Ranging::Photons;
    if fields.has(K.bandwidth_hz) && has_amplifier && !has_noise && !fields.has(K.channel) {
        let [nep, snr, shot] = [K.nep_w, K.snr, K.responsivity_a_per_w].map(|key| fields.name(key));
        fields.warn_of_effect(K.bandwidth_hz, &format!("without noise: `{nep}`, `{snr}` or `{shot}`"));
    }
}

/// Applies chirps, which have no pulse and no photons.
fn change_fmcw(fields: &mut Fields, receiver: &mut Receiver) {
    for other in [K.pulse_length_ns, K.pulse_fwhm_ns, K.pulse_shape, K.threshold_photons] {
        fields.either(K.fmcw, other);
    }
    let Some(mut table) = fields.child(K.fmcw, &FmcwKeys::TABLE) else { return };
    let keys = FmcwKeys::KEYS;
    let (bandwidth, chirp) = (table.exact_number(keys.bandwidth_hz), table.exact_number(keys.chirp_s));
    let sample_rate = table.optional(keys.sample_rate_hz);
    let has_quadrature = table.flag(keys.quadrature, false);
    let false_alarm = table.optional(keys.false_alarm);
    table.done(&[]);
    if receiver.ranging == Ranging::Photons {
        let detector = fields.name(K.detector);
        fields.error(K.fmcw, &format!("is not for `{detector}` \"photons\""));
    }
    if let Some((bandwidth, chirp)) = bandwidth.zip(chirp) {
        receiver.fmcw = Some(Fmcw { bandwidth, chirp, sample_rate, has_quadrature, false_alarm });
    }
}

/// Applies the pixels of a photon counter and their imperfections.
fn change_pixels(fields: &mut Fields, receiver: &mut Receiver) {
    let pixels = &mut receiver.pixels;
    pixels.count = fields.count(K.pixels, pixels.count);
    fields.set(K.photon_jitter_ns, &mut pixels.jitter);
    fields.set(K.dark_counts_hz, &mut pixels.dark_counts);
    if let Some(mut table) = fields.child(K.afterpulse, &AfterpulseKeys::TABLE) {
        let keys = AfterpulseKeys::KEYS;
        let probability = table.exact_number(keys.probability);
        let delay = table.exact_number(keys.delay_ns);
        table.done(&[]);
        pixels.afterpulse = probability.zip(delay).or(pixels.afterpulse);
    }
    if receiver.ranging != Ranging::Photons {
        for key in [K.pixels, K.photon_jitter_ns, K.dark_counts_hz, K.afterpulse] {
            if fields.has(key) {
                let detector = fields.name(K.detector);
                fields.warn_of_effect(key, &format!("without `{detector}` \"photons\""));
            }
        }
    }
}

/// Checks the needs of a receiver that counts photons, and warns of keys that it does not have.
fn check_counter(fields: &Fields, receiver: &Receiver) {
    if receiver.ranging != Ranging::Photons {
        return;
    }
    if receiver.threshold_photons.is_none() && fields.has(K.detector) {
        let needed = fields.name(K.threshold_photons);
        fields.error(
            K.detector,
            &format!("\"photons\" needs `{needed}`, the photoelectrons of an echo at the threshold"),
        );
    }
    for key in [K.nep_w, K.snr, K.bandwidth_hz, K.saturation_w, K.range_walk_m] {
        if fields.has(key) {
            fields.warn_of_effect(key, "with detector \"photons\": such a receiver has no amplifier");
        }
    }
}

/// Noise of ranges by strength; an accuracy that is stated instead replaces that of an inherited scanner.
fn change_range_noise(fields: &mut Fields, receiver: &mut Receiver) {
    // In XML the accuracy is for the physics of HELIOS++, in addition to it.
    if fields.is_toml() {
        fields.either(K.accuracy_m, K.range_noise);
    }
    if fields.has(K.accuracy_m) {
        receiver.range_noise = None;
    }
    if let Some(mut table) = fields.child(K.range_noise, &RangeNoiseKeys::TABLE) {
        let keys = RangeNoiseKeys::KEYS;
        receiver.range_noise = Some(RangeNoise {
            constant: table.number(keys.constant_m, 0.0),
            shot: table.number(keys.shot_m, 0.0),
            amplifier: table.number(keys.amplifier_m, 0.0),
            footprint: table.number(keys.footprint, 0.0),
        });
        table.done(&[]);
    }
}

/// Shot noise, which requires a responsivity; background light requires it, too.
fn change_shot(fields: &mut Fields, receiver: &mut Receiver) {
    let is_given = fields.has(K.background_w) || fields.has(K.responsivity_a_per_w);
    let mut shot = receiver.shot.unwrap_or(ShotNoise { background: 0.0, responsivity: 0.0 });
    fields.set(K.background_w, &mut shot.background);
    fields.set(K.responsivity_a_per_w, &mut shot.responsivity);
    if is_given && shot.responsivity == 0.0 {
        let needed = fields.name(K.responsivity_a_per_w);
        fields.error(K.background_w, &format!("needs `{needed}`, from which its shot noise follows"));
    } else if is_given {
        receiver.shot = Some(shot);
    }
}

/// Range, reflectance and pulse rate of a figure in a data sheet.
fn read_target(fields: &mut Fields) -> Option<ReferenceTarget> {
    let keys = TargetKeys::KEYS;
    let (range, reflectance) = (fields.exact_number(keys.range_m), fields.exact_number(keys.reflectance));
    let pulse_freq = fields.optional(keys.pulse_freq_hz);
    Some(ReferenceTarget { range: range?, reflectance: reflectance?, pulse_freq })
}
