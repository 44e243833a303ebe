//! Receivers that are not ideal: noise, saturation, range walk, and ranging between bins.
//!
//! Amplitudes are received power in nanowatts. Light is summed up first ([`super::waveform`]), then noise is
//! added to the samples, then echoes are detected. Saturation is a function of the momentary power that grows
//! with it, so that maxima stay where they are: ranges are read as by an instrument that is calibrated for
//! its own response, from the samples before saturation. Amplitudes, recorded waveforms and the widths of
//! echoes are those after it.

use super::detector_settings::{DetectorSettings, Return};
use super::energy::NANO;
use super::lanes::LANES;
use super::noise::{FalseAlarm, PulseDraws, ReceiverNoise, matched_bandwidth, shot_variance};
use super::ranging::RangeReader;
use super::receiver_error::ReceiverError;
use super::shape::PulseShape;
use super::waveform::{MAX_RECORD_SAMPLES, Waveform};
use libm::sqrt;
use vlscan_base::rng::{Purpose, Stream};
use vlscan_survey::{AmplifierNoise, Receiver, ReferenceTarget};

/// Maximum number of false alarms per pulse, on average.
const MAX_ALARMS: f64 = 10_000.0;
/// Maximum length of a waveform with noise on all bins; longer ones have noise where light is stored.
const MAX_FILLED_BINS: u64 = 4096;

/// Noise of a receiver in nanowatts; `None` for an ideal one. `amplitude_of` computes the peak of a target's
/// echo, nW.
pub(super) fn receiver_noise(
    receiver: &Receiver,
    shape: &PulseShape,
    amplitude_of: impl Fn(&ReferenceTarget) -> f64,
) -> Option<ReceiverNoise> {
    let amplifier = match receiver.noise {
        None => 0.0,
        Some(AmplifierNoise::Power(power)) => power * NANO,
        Some(AmplifierNoise::Ratio { target, value }) => amplitude_of(&target) / value,
    };
    let bandwidth = receiver.bandwidth.unwrap_or(matched_bandwidth(shape.width()) * 1e9);
    // W² per W to nW² per nW.
    let per_light = receiver.shot.map_or(0.0, |s| shot_variance(bandwidth, s.responsivity) * NANO);
    let background = receiver.shot.map_or(0.0, |s| s.background * NANO);
    let dark = amplifier * amplifier + per_light * background;
    (dark > 0.0 || per_light > 0.0).then(|| ReceiverNoise::new(dark, per_light, bandwidth * 1e-9, shape.bin))
}

/// Output of a receiver that saturates at `limit`: v/√(1 + (v/limit)²), linear below and never above (Rapp
/// 1991, "Effects of HPA-nonlinearity on a 4-DPSK/OFDM-signal for a digital sound broadcasting system", with
/// the smoothness 1). The order of amplitudes stays, so that a peak stays a peak.
fn saturated(value: f64, limit: f64) -> f64 {
    let ratio = value / limit;
    if ratio > 0.0 { value / sqrt(1.0 + ratio * ratio) } else { value }
}

/// Power at which the output of a receiver that saturates at `limit` is `value`; infinite from `limit` on.
fn unsaturated(value: f64, limit: f64) -> f64 {
    let ratio = value / limit;
    if ratio < 1.0 { value / sqrt((1.0 - ratio) * (1.0 + ratio)) } else { f64::INFINITY }
}

/// Shift of a measured range by the amplitude, m: a timer that stops where a linearly rising edge crosses the
/// threshold stops the later the weaker the echo is, in proportion to threshold over amplitude (Amann et al.
/// 2001, "Laser ranging: a critical review of usual techniques for distance measurement", Optical Engineering
/// 40(1), walk error). `walk` is the shift of an echo right at the threshold.
pub(super) fn range_walk(walk: f64, threshold: f64, amplitude: f64) -> f64 {
    if amplitude > threshold { walk * threshold / amplitude } else { walk }
}

/// Threshold crossings that noise causes between the echoes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FalseAlarms {
    /// Mean number per pulse, over the range gate (Rice 1945, see [`super::noise`]).
    pub per_pulse: f64,
    /// Standard deviation of the noise without an echo, W.
    pub sigma: f64,
    /// Detection threshold, W.
    pub threshold: f64,
}

/// Mean number of threshold crossings of noise within `gate` (ns).
fn expected_alarms(noise: &ReceiverNoise, threshold: f64, gate: (f64, f64)) -> f64 {
    noise.alarm_rate(threshold) * (gate.1 - gate.0)
}

/// The receiver of a device that is not ideal.
#[derive(Clone, Debug)]
pub(super) struct ReceiverModel {
    noise: Option<ReceiverNoise>,
    /// Amplitude at which it saturates.
    limit: f64,
    /// Shift of the range of an echo at the threshold, m.
    walk: f64,
    /// Power at which the output reaches the detection threshold.
    threshold: f64,
    /// Travel times between which it detects echoes, ns.
    gate: (f64, f64),
    reader: Option<RangeReader>,
    /// Time from the largest sample of a pulse that starts with a bin to its maximum, bins.
    top_offset: f64,
    samples: Stream,
    alarms: Stream,
}

impl ReceiverModel {
    /// The model of a receiver; `None` if it is ideal. `gate` are the travel times between which echoes
    /// count, ns.
    ///
    /// # Errors
    /// If the threshold is so low that noise causes more than [`MAX_ALARMS`] echoes per pulse, or
    /// so high that the saturated output never reaches it.
    pub fn new(
        receiver: &Receiver,
        noise: Option<ReceiverNoise>,
        shape: &PulseShape,
        threshold: f64,
        gate: (f64, f64),
        seed: u64,
    ) -> Result<Option<ReceiverModel>, ReceiverError> {
        let reader = calibrated_reader(receiver, shape);
        let limit = receiver.saturation.map_or(f64::INFINITY, |power| power * NANO);
        if noise.is_none() && limit == f64::INFINITY && receiver.range_walk == 0.0 && reader.is_none() {
            return Ok(None);
        }
        let power = unsaturated(threshold, limit);
        if power == f64::INFINITY {
            return Err(ReceiverError::Saturation { threshold: threshold / NANO, saturation: limit / NANO });
        }
        if let Some(noise) = &noise {
            let expected = expected_alarms(noise, power, gate);
            if expected > MAX_ALARMS {
                return Err(ReceiverError::FalseAlarms {
                    threshold: threshold / NANO,
                    noise: noise.dark_sigma() / NANO,
                    alarms: expected,
                    max: MAX_ALARMS,
                });
            }
        }
        Ok(Some(ReceiverModel {
            noise,
            limit,
            walk: receiver.range_walk,
            threshold: power,
            gate,
            reader,
            top_offset: shape.top_time / shape.bin - shape.peak as f64,
            samples: Stream::new(seed, Purpose::ReceiverNoise),
            alarms: Stream::new(seed, Purpose::FalseAlarm),
        }))
    }

    /// Threshold crossings of the noise alone that a pulse has on average; `None` without noise.
    pub fn false_alarms(&self) -> Option<FalseAlarms> {
        let noise = self.noise.as_ref()?;
        Some(FalseAlarms {
            per_pulse: expected_alarms(noise, self.threshold, self.gate),
            sigma: noise.dark_sigma() / NANO,
            threshold: self.threshold / NANO,
        })
    }

    /// True if pulses may have echoes without reflections.
    pub fn has_false_alarms(&self) -> bool {
        self.noise.as_ref().is_some_and(|noise| noise.alarm_rate(self.threshold) > 0.0)
    }

    /// Power of a sample that reaches the detection threshold after saturation.
    pub fn threshold(&self) -> f64 {
        self.threshold
    }

    /// Adds noise to the samples of a pulse. Recorded and short waveforms have noise on all bins, others on
    /// the stored bins only.
    pub fn add_noise(&self, waveform: &mut Waveform, is_recorded: bool, (device, pulse): (u32, u64)) {
        let Some(noise) = &self.noise else { return };
        waveform.store_gaps(if is_recorded { MAX_RECORD_SAMPLES } else { MAX_FILLED_BINS });
        let (draws, mut white) = (self.draws(device, pulse), Vec::new());
        waveform.change_segments(|first, samples| noise.add(samples, first, &draws, &mut white));
    }

    pub fn can_saturate(&self) -> bool {
        self.limit < f64::INFINITY
    }

    /// Replaces `out` by the output of the receiver for that waveform.
    pub fn saturate(&self, waveform: &Waveform, out: &mut Waveform) {
        out.clone_from(waveform);
        out.change_segments(|_, samples| {
            samples.iter_mut().for_each(|sample| *sample = saturated(*sample, self.limit));
        });
    }

    /// Output of the receiver at that power.
    pub fn output(&self, power: f64) -> f64 {
        saturated(power, self.limit)
    }

    /// Position of the maximum of an echo relative to bin `peak` by this receiver's method, bins; `None` for
    /// the default method.
    pub fn offset(&self, waveform: &Waveform, peak: u64) -> Option<f64> {
        let reader = self.reader.as_ref()?;
        let shift = reader.offset(|k| peak.checked_add_signed(k).map_or(0.0, |bin| waveform.at(bin)));
        Some(shift + self.top_offset)
    }

    /// Shift of the range of an echo of that power before saturation, m.
    pub fn walk(&self, power: f64) -> f64 {
        if self.walk == 0.0 { 0.0 } else { range_walk(self.walk, self.threshold, power) }
    }

    /// Inserts the false alarms of a pulse into its returns, sorted by range, and truncates to the detector's
    /// maximum.
    #[inline(never)]
    pub fn add_false_alarms(
        &self,
        waveform: &Waveform,
        detector: &DetectorSettings,
        (device, pulse): (u32, u64),
        returns: &mut Vec<Return>,
    ) {
        let Some(noise) = &self.noise else { return };
        let time = |at: u64| waveform.start + at as f64 * detector.shape.bin;
        let lit = waveform.segments().map(|(first, bins)| (time(first), time(first + bins.len() as u64)));
        let mut alarms = Vec::new();
        noise.add_alarms(self.threshold, self.gate, lit, &self.draws(device, pulse), &mut alarms);
        if alarms.is_empty() {
            return;
        }
        let echo = |alarm: FalseAlarm| {
            let amplitude = self.output(alarm.amplitude);
            let range = detector.light_speed * alarm.time + self.walk(alarm.amplitude);
            Return { range, amplitude, width: noise.alarm_width(), is_noise: true }
        };
        returns.extend(alarms.into_iter().map(echo));
        returns.sort_by(|a, b| a.range.total_cmp(&b.range));
        if detector.max_returns > 0 {
            returns.truncate(detector.max_returns as usize);
        }
    }

    fn draws(&self, device: u32, pulse: u64) -> PulseDraws {
        PulseDraws { samples: self.samples, alarms: self.alarms, device, pulse }
    }
}

/// The reader that is calibrated for the pulse; `None` for the peak, which the shape of the pulse reads
/// itself.
fn calibrated_reader(receiver: &Receiver, shape: &PulseShape) -> Option<RangeReader> {
    let pulse = |k: i64, by: f64| {
        let at = shape.peak.checked_add_signed(k as isize).filter(|at| *at < shape.samples.len());
        at.map_or(0.0, |at| shape.late_sample(at, &shape.late(&[by; LANES]).map(|factor| factor[0])))
    };
    RangeReader::new(receiver.ranging, shape.width() / shape.bin, pulse)
}
