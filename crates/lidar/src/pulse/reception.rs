//! How a device detects echoes: its threshold, its receiver and the selection of its returns.

use super::detector_settings::PeakRule;
use super::energy::NANO;
use super::noise::ReceiverNoise;
use super::options::PhysicsOptions;
use super::photon_counter::PhotonCounter;
use super::receiver::{ReceiverModel, receiver_noise};
use super::receiver_error::ReceiverError;
use super::selection::ReturnSelection;
use super::shape::PulseShape;
use vlscan_base::corrections::Corrections;
use vlscan_geom::LIGHT_SPEED;
use vlscan_survey::{Device, Ranging, Receiver, ReferenceTarget};

/// Threshold of instruments that state none, nW. As 1e-4 W it would hide every echo, so it counts as not
/// given and is in nanowatts with and without the correction of the unit.
const DEFAULT_THRESHOLD: f64 = 1e-4;
/// Longest travel time of photons that count, 150,000 km.
const MAX_WINDOW_NS: f64 = 1e9;

/// Detection of a device.
pub(super) struct Reception {
    /// Detection threshold of the device, nW.
    pub threshold: f64,
    /// Conditions for peaks. Their threshold is that of the weakest echo with a chance to be detected.
    pub rule: PeakRule,
    /// Selection of the reported returns; `None` for all.
    pub selection: Option<ReturnSelection>,
    /// The receiver, if it is not ideal.
    pub model: Option<ReceiverModel>,
    /// The receiver, if it counts photons.
    pub counter: Option<PhotonCounter>,
    /// True if the samples of waveforms have noise.
    pub has_noise: bool,
}

impl Reception {
    /// The detection of `device` with `receiver`, which is its own or an ideal one. `amplitude_of` computes
    /// the peak of a target's echo, nW; ranges grow by `light_speed` metres per nanosecond of travel time;
    /// `frequency` is the pulse rate, Hz.
    ///
    /// # Errors
    /// The errors of [`ReceiverModel::new`] and [`PhotonCounter::new`].
    pub fn new(
        device: &Device,
        receiver: &Receiver,
        shape: &PulseShape,
        amplitude_of: impl Fn(&ReferenceTarget) -> f64,
        (light_speed, frequency): (f64, f64),
        options: &PhysicsOptions,
    ) -> Result<Reception, ReceiverError> {
        let counts_photons = receiver.ranging == Ranging::Photons;
        let noise = if counts_photons { None } else { receiver_noise(receiver, shape, &amplitude_of) };
        let has_noise = noise.is_some();
        let rule = peak_rule(device, &options.corrections);
        let threshold = stated_threshold(device, receiver, noise.as_ref(), &rule, &amplitude_of);
        let max_returns = device.detector.max_returns;
        // A counter has both itself.
        let without = || Receiver { threshold_photons: None, dead_time: 0.0, ..receiver.clone() };
        let of_returns = counts_photons.then(without);
        let of_returns = of_returns.as_ref().unwrap_or(receiver);
        let selection = ReturnSelection::new(of_returns, threshold, max_returns, options.seed);
        let lowest = selection.as_ref().map_or(1.0, ReturnSelection::lowest_share);
        // Echoes count until the next pulse.
        let farthest = device.detector.range_max.min(LIGHT_SPEED * 0.5e9 / frequency);
        let gate = (device.detector.range_min / light_speed, farthest / light_speed);
        let model = ReceiverModel::new(receiver, noise, shape, threshold, gate, options.seed)?;
        // Instruments with a stated window assign photons to their pulses.
        let limit = device.detector.range_max / light_speed;
        let window = (gate.0, if limit < MAX_WINDOW_NS { limit } else { gate.1 }.max(gate.0));
        let counter = PhotonCounter::new(receiver, shape, threshold, (window, max_returns), options.seed)?;
        let at_output = model.as_ref().map_or(threshold, ReceiverModel::threshold);
        let rule = PeakRule { threshold: at_output * lowest, ..rule };
        Ok(Reception { threshold, rule, selection, model, counter, has_noise })
    }
}

/// Conditions for peaks, with the threshold that the device states.
pub(super) fn peak_rule(device: &Device, c: &Corrections) -> PeakRule {
    let bins = device.waveform.window / device.waveform.bin;
    PeakRule {
        threshold: match &device.detector {
            d if c.threshold_in_watts && d.threshold_given && d.threshold != DEFAULT_THRESHOLD => {
                d.threshold * NANO
            }
            d => d.threshold,
        },
        // The allowance lifts quotients that rounding left just below a whole number.
        window: if c.peak_neighbours { ((bins + 1e-9) as u64).max(2) } else { bins as u64 },
        weak_neighbours: c.weak_neighbours,
        first_bin: c.clip_dead_zone,
    }
}

/// Detection threshold, nW: the peak of an echo at the instrument's maximum range, if it states one; a
/// multiple of its noise, if it has noise and states no threshold; otherwise the threshold of `rule`.
/// `amplitude_of` computes the peak of a target's echo, nW.
fn stated_threshold(
    device: &Device,
    receiver: &Receiver,
    noise: Option<&ReceiverNoise>,
    rule: &PeakRule,
    amplitude_of: impl Fn(&ReferenceTarget) -> f64,
) -> f64 {
    match (&receiver.max_range, noise) {
        (Some(target), _) => amplitude_of(target),
        (None, Some(noise)) if !device.detector.threshold_given => noise.default_threshold(),
        _ => rule.threshold,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::testkit::tls_device;

    #[test]
    fn windows_are_truncated_as_the_reference_does_it_unless_corrected() {
        let mut device = tls_device(5.0);
        (device.waveform.window, device.waveform.bin) = (0.3, 0.1);
        let mut c = Corrections::NONE;
        assert_eq!(peak_rule(&device, &c).window, 2);
        c.peak_neighbours = true;
        assert_eq!(peak_rule(&device, &c).window, 3);
        device.waveform.window = 0.05;
        assert_eq!(peak_rule(&device, &c).window, 2);
    }
}
