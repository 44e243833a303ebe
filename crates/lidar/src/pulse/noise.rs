//! Noise of the receiver: normal, limited to its bandwidth, a function of device, pulse and sample.
//!
//! A receiver with the Gaussian response |H(f)|² = 2^(−(f/B)²) turns white noise into noise of
//! autocorrelation exp(−t²/(4σ_h²)), where σ_h = √(ln 2)/(2πB) is the width of its impulse response. Samples
//! are therefore white draws under a Gaussian window of that width: neighbouring samples share most of their
//! noise, as behind a real amplifier, and an echo is one crossing of the threshold and not a cluster of
//! crossings.
//!
//! Between the echoes only noise crosses the threshold T. A stationary normal process of standard deviation σ
//! does so ν = √(−ρ''(0))/(2π)·exp(−T²/(2σ²)) times per unit of time (Rice 1945, "Mathematical analysis of
//! random noise", eq. 3.3-14), here with −ρ''(0) = 1/(2σ_h²); crossings of a high threshold form a Poisson
//! process whose peaks x have the tail exp(−(x² − T²)/(2σ²)) (Cramér & Leadbetter 1967, ch. 12). So they are
//! drawn one after the other, not sample by sample.

use libm::{erfc, exp, log, sqrt};
use std::f64::consts::{LN_2, PI, SQRT_2};
use vlscan_base::rng::{self, Stream};

/// Elementary charge, C.
const ELECTRON: f64 = 1.602_176_634e-19;
/// Half width of the window of draws, in units of σ_h.
const HALF_WINDOW: f64 = 4.0;
/// Maximum number of draws on either side of a sample that contribute to its noise.
const MAX_TAPS: usize = 1024;
/// Threshold over noise of instruments that state none: at most one false alarm in ten thousand pulses.
const THRESHOLD_OVER_NOISE: f64 = 6.0;
/// Bandwidth of a matched receiver times the full width at half maximum of its Gaussian pulse: 2·ln 2/π.
const MATCHED_BANDWIDTH_WIDTH: f64 = 2.0 * LN_2 / PI;

/// Bandwidth (GHz) of the receiver matched to a pulse of `fwhm` ns: its noise is correlated over the pulse
/// length.
pub(super) fn matched_bandwidth(fwhm: f64) -> f64 {
    MATCHED_BANDWIDTH_WIDTH / fwhm
}

/// Variance of shot noise in W² per watt of light: 2qB/responsivity (Schottky 1918), with the bandwidth in Hz
/// and the responsivity in A/W.
pub(super) fn shot_variance(bandwidth: f64, responsivity: f64) -> f64 {
    2.0 * ELECTRON * bandwidth / responsivity
}

/// Signal-to-noise ratio at which a pulse of `depth` m at half maximum has a range noise of `sigma` m: σ_p/σ,
/// the Cramér–Rao bound of a Gaussian pulse of standard deviation σ_p behind a matched receiver.
pub(super) fn signal_to_noise(depth: f64, sigma: f64) -> f64 {
    depth / (sqrt(8.0 * LN_2) * sigma)
}

/// Noise of a receiver, in the unit of amplitudes.
#[derive(Clone, Debug)]
pub(super) struct ReceiverNoise {
    /// Variance without an echo: amplifier and background light.
    dark_variance: f64,
    /// Variance per amplitude: shot noise of the echo itself.
    signal_variance: f64,
    /// σ_h, ns.
    response: f64,
    /// Weights of the draws around a sample; the sum of their squares is 1.
    taps: Vec<f64>,
    /// Width of a bin, ns.
    bin: f64,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct PulseDraws {
    pub samples: Stream,
    pub alarms: Stream,
    pub device: u32,
    pub pulse: u64,
}

/// A threshold crossing where no light is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FalseAlarm {
    /// Travel time of its peak, ns.
    pub time: f64,
    /// Amplitude of its peak.
    pub amplitude: f64,
}

impl ReceiverNoise {
    /// Units: `dark_variance` squared amplitude, `signal_variance` squared amplitude per amplitude of an
    /// echo, `bandwidth` GHz, `bin` ns.
    pub fn new(dark_variance: f64, signal_variance: f64, bandwidth: f64, bin: f64) -> ReceiverNoise {
        let response = sqrt(LN_2) / (2.0 * PI * bandwidth);
        let width = response / bin;
        let reach = ((HALF_WINDOW * width).ceil() as usize).min(MAX_TAPS);
        let weight = |k: usize| {
            let x = (k as f64 - reach as f64) / width;
            exp(-0.5 * x * x)
        };
        let weights: Vec<f64> = (0..=2 * reach).map(weight).collect();
        let norm = sqrt(weights.iter().map(|w| w * w).sum());
        let taps = weights.iter().map(|w| w / norm).collect();
        ReceiverNoise { dark_variance, signal_variance, response, taps, bin }
    }

    pub fn dark_sigma(&self) -> f64 {
        sqrt(self.dark_variance)
    }

    pub fn default_threshold(&self) -> f64 {
        THRESHOLD_OVER_NOISE * self.dark_sigma()
    }

    /// Half width at 1/e of a false alarm, ns: a high peak of the noise has the shape of its autocorrelation.
    pub fn alarm_width(&self) -> f64 {
        2.0 * self.response
    }

    /// Adds noise to samples, the first of which is number `first` of its waveform. `white` is scratch.
    pub fn add(&self, samples: &mut [f64], first: u64, draws: &PulseDraws, white: &mut Vec<f64>) {
        let reach = (self.taps.len() / 2) as u32;
        draw_white(samples.len() + 2 * reach as usize, (first as u32).wrapping_sub(reach), draws, white);
        for (sample, white) in samples.iter_mut().zip(white.windows(self.taps.len())) {
            let sigma = sqrt(self.dark_variance + self.signal_variance * sample.max(0.0));
            let noise: f64 = white.iter().zip(&self.taps).map(|(draw, tap)| draw * tap).sum();
            *sample += sigma * noise;
        }
    }

    /// False alarms per nanosecond at a threshold. Samples farther apart than the noise is correlated cross
    /// it with the tail probability of the normal distribution, which bounds the rate of the continuous
    /// process.
    pub fn alarm_rate(&self, threshold: f64) -> f64 {
        let level = threshold / self.dark_sigma();
        let crossings = exp(-0.5 * level * level) / (2.0 * PI * SQRT_2 * self.response);
        let tail = 0.5 * erfc(level / SQRT_2) / self.bin;
        crossings.min(tail)
    }

    /// Appends the false alarms in `gate` (ns) outside of the `lit` intervals (ns, ascending, disjoint),
    /// sorted by time.
    pub fn add_alarms(
        &self,
        threshold: f64,
        gate: (f64, f64),
        lit: impl IntoIterator<Item = (f64, f64)>,
        draws: &PulseDraws,
        out: &mut Vec<FalseAlarm>,
    ) {
        let rate = self.alarm_rate(threshold);
        let (mut time, end) = gate;
        let mut lit = lit.into_iter().peekable();
        let mut drawn = 0;
        while time < end {
            let [a, b, c, d] = draws.alarms.bits(draws.device, draws.pulse, drawn);
            drawn = drawn.wrapping_add(1);
            time -= log(rng::open_unit(a, b)) / rate;
            // The process has no memory: it restarts after each lit interval.
            while lit.next_if(|interval| interval.1 <= time).is_some() {}
            if let Some((_, until)) = lit.next_if(|interval| interval.0 <= time) {
                time = until;
                continue;
            }
            if time < end {
                let square = threshold * threshold - 2.0 * self.dark_variance * log(rng::open_unit(c, d));
                out.push(FalseAlarm { time, amplitude: sqrt(square) });
            }
        }
    }
}

/// Replaces `out` by the standard normal draws of `count` samples from number `first` (modulo 2³²) on.
fn draw_white(count: usize, first: u32, draws: &PulseDraws, out: &mut Vec<f64>) {
    const LANES: usize = rng::NORMALS_PER_BLOCK;
    out.clear();
    let (device, pulse) = ([draws.device; LANES], [draws.pulse; LANES]);
    for block in 0..count.div_ceil(LANES) {
        let counter = std::array::from_fn(|i| first.wrapping_add((block * LANES + i) as u32));
        out.extend(draws.samples.normals(&device, &pulse, &counter));
    }
    out.truncate(count);
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::rng::Purpose;

    fn draws(pulse: u64) -> PulseDraws {
        PulseDraws {
            samples: Stream::new(5, Purpose::ReceiverNoise),
            alarms: Stream::new(5, Purpose::FalseAlarm),
            device: 0,
            pulse,
        }
    }

    /// Noise of σ 2 behind 0.2 GHz in bins of 0.25 ns.
    fn noise() -> ReceiverNoise {
        ReceiverNoise::new(4.0, 0.0, 0.2, 0.25)
    }

    fn sampled(noise: &ReceiverNoise, count: usize, pulse: u64) -> Vec<f64> {
        let mut samples = vec![0.0; count];
        noise.add(&mut samples, 0, &draws(pulse), &mut Vec::new());
        samples
    }

    #[test]
    fn samples_have_the_variance_and_the_correlation_of_the_bandwidth() {
        let noise = noise();
        let response = LN_2.sqrt() / (2.0 * PI * 0.2);
        let (n, mut products) = (1 << 18, [0.0; 13]);
        let samples = sampled(&noise, n, 1);
        for (lag, product) in products.iter_mut().enumerate() {
            *product = samples.iter().zip(&samples[lag..]).map(|(a, b)| a * b).sum::<f64>() / n as f64;
        }
        for (lag, product) in products.iter().enumerate() {
            let t = lag as f64 * 0.25 / (2.0 * response);
            let expected = 4.0 * (-t * t).exp();
            assert!((product - expected).abs() < 0.06, "lag {lag}: {product} is not {expected}");
        }
    }

    #[test]
    fn shot_noise_grows_with_the_root_of_the_light() {
        let noise = ReceiverNoise::new(4.0, 0.5, 0.2, 0.25);
        for light in [0.0, 10.0, 1000.0] {
            let mut samples = vec![light; 1 << 17];
            noise.add(&mut samples, 0, &draws(3), &mut Vec::new());
            let variance =
                samples.iter().map(|s| (s - light) * (s - light)).sum::<f64>() / samples.len() as f64;
            assert!((variance / (4.0 + 0.5 * light) - 1.0).abs() < 0.03, "{light}: {variance}");
        }
        // 1 mA through 1 Hz: 2q·1e-3 A²; at 0.5 A/W a milliampere is 2 mW.
        assert!((shot_variance(1.0, 0.5) * 2e-3 * 0.25 - 2.0 * ELECTRON * 1e-3).abs() < 1e-27);
    }

    #[test]
    fn a_sample_has_the_same_noise_in_any_run_of_samples() {
        let noise = noise();
        let whole = sampled(&noise, 300, 9);
        let mut part = vec![0.0; 50];
        noise.add(&mut part, 77, &draws(9), &mut Vec::new());
        assert_eq!(part, whole[77..127]);
        assert_ne!(sampled(&noise, 300, 10), whole);
        // Bin numbers above 32 bits continue the sequence.
        let mut far = vec![0.0; 8];
        noise.add(&mut far, (1 << 32) + 77, &draws(9), &mut Vec::new());
        assert_eq!(far, whole[77..85]);
    }

    #[test]
    fn echoes_are_detected_with_the_probability_of_the_tail() {
        // One sample of amplitude A crosses T with the probability Q((T − A)/σ).
        let noise = noise();
        for (amplitude, threshold) in [(10.0, 10.0), (10.0, 8.0), (10.0, 13.0), (0.0, 3.0)] {
            let n = 40_000;
            let seen = (0..n)
                .filter(|pulse| {
                    let mut sample = [amplitude];
                    noise.add(&mut sample, 0, &draws(*pulse), &mut Vec::new());
                    sample[0] >= threshold
                })
                .count() as f64;
            let expected = 0.5 * erfc((threshold - amplitude) / 2.0 / SQRT_2);
            let sigma = (expected * (1.0 - expected) / n as f64).sqrt();
            assert!((seen / n as f64 - expected).abs() < 4.0 * sigma, "{amplitude} over {threshold}");
        }
    }

    #[test]
    fn false_alarms_are_as_many_and_as_strong_as_the_samples_say() {
        let noise = noise();
        let (threshold, n) = (6.0, 1 << 21);
        // Upward crossings of all samples.
        let samples = sampled(&noise, n, 1);
        let crossings = samples.windows(2).filter(|w| w[0] < threshold && w[1] >= threshold).count() as f64;
        let mut alarms = Vec::new();
        let span = n as f64 * 0.25;
        noise.add_alarms(threshold, (0.0, span), [], &draws(1), &mut alarms);
        let expected = noise.alarm_rate(threshold) * span;
        assert!(
            (alarms.len() as f64 - expected).abs() < 4.0 * expected.sqrt(),
            "{} for {expected}",
            alarms.len()
        );
        assert!((crossings / expected - 1.0).abs() < 0.1, "{crossings} crossings, {expected} expected");
        // Mean excess of the peaks: the tail exp(−(x² − T²)/(2σ²)) is half used up where x² = T² + 2σ²·ln 2.
        let median = (threshold * threshold + 8.0 * LN_2).sqrt();
        let above = alarms.iter().filter(|a| a.amplitude > median).count() as f64;
        assert!((above / alarms.len() as f64 - 0.5).abs() < 2.0 / expected.sqrt());
        assert!(alarms.iter().all(|a| a.amplitude >= threshold && a.time >= 0.0 && a.time < span));
        assert!(alarms.windows(2).all(|w| w[0].time <= w[1].time));
    }

    #[test]
    fn independent_samples_cross_with_the_tail_probability() {
        // A bandwidth far above the sampling rate.
        let noise = ReceiverNoise::new(1.0, 0.0, 1e3, 0.25);
        assert!((noise.alarm_rate(4.0) * 0.25 / 3.167_124_183e-5 - 1.0).abs() < 1e-9);
        let samples = sampled(&noise, 4096, 1);
        let next = samples.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / 4096.0;
        assert!(next.abs() < 0.06, "{next}");
    }

    #[test]
    fn no_false_alarm_where_light_is() {
        let noise = noise();
        let lit = [(100.0, 400.0), (500.0, 900.0)];
        let mut alarms = Vec::new();
        for pulse in 0..200 {
            noise.add_alarms(4.0, (50.0, 1000.0), lit, &draws(pulse), &mut alarms);
        }
        let dark = |t: f64| lit.iter().all(|(from, to)| t < *from || t >= *to);
        assert!(alarms.iter().all(|a| dark(a.time) && (50.0..1000.0).contains(&a.time)));
        let expected = noise.alarm_rate(4.0) * 200.0 * 250.0;
        assert!(
            (alarms.len() as f64 - expected).abs() < 4.0 * expected.sqrt(),
            "{} for {expected}",
            alarms.len()
        );
    }

    #[test]
    fn a_matched_receiver_correlates_noise_as_long_as_the_pulse() {
        let fwhm = 2.0;
        let noise = ReceiverNoise::new(1.0, 0.0, matched_bandwidth(fwhm), 0.25);
        // Autocorrelation exp(−t²/(4σ_h²)) and pulse exp(−t²/(2σ_p²)) with σ_p = fwhm/√(8·ln 2).
        let sigma = fwhm / (8.0 * LN_2).sqrt();
        assert!((SQRT_2 * noise.response / sigma - 1.0).abs() < 1e-12);
    }
}
