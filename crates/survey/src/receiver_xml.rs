//! Attributes of scanners, channels and `<detectorSettings>` that describe beam and receiver in more detail than
//! HELIOS++, which ignores them.

use super::context::Context;
use super::fields::Fields;
use super::pulse_file::read_pulse_file;
use super::{
    AmplifierNoise, Beam, BeamProfile, Detector, Ranging, Receiver, ReferenceTarget, ShotNoise,
    pulse_length_of_width,
};
use vlscan_base::quantity::{APERTURE, DIVERGENCE, PULSE_ENERGY_UJ, PULSE_LENGTH_NS};

/// `base` with the element's pulse energy, width, profile and aperture applied. The pulse length has been read
/// before.
pub(super) fn read_emission(fields: &mut Fields, base: Beam) -> Beam {
    let mut beam = base;
    if fields.has("pulseFwhm_ns") {
        if fields.has("pulseLength_ns") {
            fields.refuse("pulseFwhm_ns", "given without pulseLength_ns, which it replaces");
        }
        beam.pulse_length = pulse_length_of_width(fields.within("pulseFwhm_ns", 2.0, &PULSE_LENGTH_NS));
        beam.stated_width = None;
    }
    if fields.has("pulseEnergy_uJ") {
        beam.pulse_energy = Some(1e-6 * fields.within("pulseEnergy_uJ", 1.0, &PULSE_ENERGY_UJ));
    }
    match fields.text("beamProfile") {
        None => {}
        Some("gaussian") => beam.profile = BeamProfile::Gaussian,
        Some("top_hat") => beam.profile = BeamProfile::TopHat,
        Some(_) => fields.refuse("beamProfile", "gaussian or top_hat"),
    }
    if fields.has("beamDivergenceY_rad") {
        beam.divergence_y = Some(fields.within("beamDivergenceY_rad", beam.divergence, &DIVERGENCE));
    }
    beam.aperture = fields.within("exitAperture_m", beam.aperture, &APERTURE);
    // Marks the names as known where the attributes are missing.
    fields.ignore(&["pulseFwhm_ns", "pulseEnergy_uJ", "beamDivergenceY_rad"]);
    beam
}

/// `base` with the pulse shape file of the element applied.
pub(super) fn read_pulse_shape(context: &Context, fields: &mut Fields, base: &Receiver) -> Receiver {
    let mut receiver = base.clone();
    if let Some(name) = fields.text("pulseShape") {
        let place = fields.element.value_place("pulseShape");
        if let Some(samples) = read_pulse_file(context, name, fields.element.folder(), place) {
            receiver.pulse_shape = Some(samples);
        }
    }
    receiver
}

/// `base` with the receiver settings of the element and of its children `<snr>` and `<maxRange>` applied. A
/// threshold in the element replaces the maximum range of `base`.
pub(super) fn read_receiver(
    context: &Context,
    fields: &mut Fields,
    base: Receiver,
    detector: &Detector,
) -> Receiver {
    let mut receiver = base;
    let element = fields.element;
    let ratio = element.child("snr").and_then(|child| {
        let mut fields = Fields::new(context, &child);
        let value = fields.required("value").is_some().then(|| fields.positive("value", 1.0));
        let target = read_target(&mut fields);
        fields.done(&[]);
        Some(AmplifierNoise::Ratio { target: target?, value: value? })
    });
    if ratio.is_some() {
        receiver.noise = ratio;
    }
    if fields.has("nep_W") {
        if ratio.is_some() {
            fields.refuse("nep_W", "given without <snr>: each sets the noise");
        }
        receiver.noise = Some(AmplifierNoise::Power(fields.positive("nep_W", 1e-9)));
    }
    if let Some(child) = element.child("maxRange") {
        let mut inner = Fields::new(context, &child);
        receiver.max_range = read_target(&mut inner);
        inner.done(&[]);
        if fields.has("receivedEnergyMin_W") {
            fields.refuse("receivedEnergyMin_W", "given without <maxRange>: each sets the threshold");
        }
    } else if detector.threshold_given && fields.has("receivedEnergyMin_W") {
        receiver.max_range = None;
    }
    receiver.shot = read_shot(context, fields, receiver.shot);
    if fields.has("bandwidth_Hz") {
        receiver.bandwidth = Some(fields.positive("bandwidth_Hz", 1e8));
    }
    if fields.has("saturation_W") {
        receiver.saturation = Some(fields.positive("saturation_W", 1.0));
    }
    receiver.range_walk = fields.number("rangeWalk_m", receiver.range_walk);
    receiver.digitiser_clock = fields.flag("digitiserClock", receiver.digitiser_clock);
    match fields.text("detector") {
        None => {}
        Some("peak") => receiver.ranging = Ranging::Peak,
        Some("centroid") => receiver.ranging = Ranging::Centroid,
        Some("gaussian") => receiver.ranging = Ranging::Gaussian,
        Some(_) => fields.refuse("detector", "peak, centroid or gaussian"),
    }
    fields.ignore(&["nep_W", "saturation_W", "bandwidth_Hz"]);
    receiver
}

/// Shot noise, which requires a responsivity; background light requires it, too.
fn read_shot(context: &Context, fields: &mut Fields, base: Option<ShotNoise>) -> Option<ShotNoise> {
    let names = ["background_W", "responsivity_A_per_W"];
    if !names.iter().any(|name| fields.has(name)) {
        fields.ignore(&names);
        return base;
    }
    let shot = ShotNoise {
        background: fields.not_negative(names[0], base.map_or(0.0, |s| s.background)),
        responsivity: fields.positive(names[1], base.map_or(0.0, |s| s.responsivity)),
    };
    if shot.responsivity == 0.0 {
        let message = "`background_W` needs `responsivity_A_per_W`, from which its shot noise follows";
        context.error(fields.element.name_place(names[0]), message);
        return None;
    }
    Some(shot)
}

/// Range, reflectance and pulse rate of a figure in a data sheet.
fn read_target(fields: &mut Fields) -> Option<ReferenceTarget> {
    let given = [fields.required("range_m"), fields.required("reflectance")];
    let reflectance = fields.positive("reflectance", 1.0);
    if reflectance > 1.0 {
        fields.refuse("reflectance", "a fraction, at most 1");
    }
    let target = ReferenceTarget {
        range: fields.positive("range_m", 1.0),
        reflectance,
        pulse_freq: fields.text("pulseFreq_Hz").is_some().then(|| fields.positive("pulseFreq_Hz", 1.0)),
    };
    given.iter().all(Option::is_some).then_some(target)
}
