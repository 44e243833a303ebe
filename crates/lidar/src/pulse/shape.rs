//! The outgoing pulse, digitised (spec pulse-physics §4.1).

use super::lanes::{Block, LANES};
use super::maximum::{self, CosineMaximum, Maximum, MeasuredMaximum};
use super::sampled;
use libm::{cos, exp, sincos};
use std::f64::consts::TAU;
use vlscan_base::corrections::Corrections;
use vlscan_survey::{PulseSamples, WaveformSettings, pulse_length_of_width, width_of_pulse_length};

/// Samples of the pulse's power over time: a gamma-like curve `(t/τ)²·exp(−t/τ)` with τ = τp/7, cut at t =
/// τp, a raised cosine, or a pulse of measured shape.
#[derive(Clone, Debug)]
pub(super) struct PulseShape {
    /// One sample per bin, from the start of the pulse.
    pub samples: Vec<f64>,
    /// Bin of the largest sample.
    pub peak: usize,
    /// ns.
    pub bin: f64,
    /// Bins per nanosecond if that is exact, so that times can be multiplied by it instead of divided by
    /// `bin`.
    pub bins_per_ns: Option<f64>,
    /// Pulse length τp, ns; for a measured shape, the length of the gamma-like curve of equal width at half
    /// maximum.
    pub length: f64,
    /// Duration of the samples, ns.
    pub duration: f64,
    /// Largest power between the samples.
    pub top: f64,
    /// Time from the start of the pulse to its largest power, ns.
    pub top_time: f64,
    /// Integral of the power, ns.
    integral: f64,
    /// Bins per τ, inverted: x = Δ/τ; 0 for other shapes.
    decay: f64,
    growth: f64,
    /// Coefficients of late starts, see [`PulseShape::late`]: −2kx²e^(−kx) and x²e^(−kx), 0 in bin 0; see
    /// [`sampled::digitise`] for other shapes.
    pub lateness: [Vec<f64>; 2],
    /// Time from the peak within which the pulse is concave on both sides, bins; 0 if that is not known.
    concave: f64,
    curve: Curve,
}

/// The curve of a pulse.
#[derive(Clone, Debug)]
enum Curve {
    Gamma,
    Cosine(CosineMaximum),
    Measured(MeasuredMaximum),
}

/// Maxima that are this close behind a sample, by rounding, count as on it, bins.
const ROUNDING: f64 = 1e-9;

/// Pulse length over the integral of the gamma-like curve, which is 2τ.
const LENGTH_OVER_INTEGRAL: f64 = 3.5;

impl PulseShape {
    /// The shape of a pulse of `length` ns, cut there or, if `whole`, where 3e-4 of its peak are left.
    pub fn new(length: f64, whole: bool, waveform: &WaveformSettings) -> PulseShape {
        let bin = waveform.bin;
        let duration = duration(length, whole);
        let tau = length / 7.0;
        let decay = bin / tau;
        let count = sample_count(duration, bin);
        let samples: Vec<f64> = (0..count)
            .map(|k| {
                let x = k as f64 * bin / tau;
                x * x * exp(-x)
            })
            .collect();
        let peak = index_of_max(&samples);
        let late = |weight: fn(f64) -> f64| {
            let of_bin = |k: usize| weight(k as f64) * decay * decay * exp(-(k as f64) * decay);
            (0..count).map(|k| if k == 0 { 0.0 } else { of_bin(k) }).collect()
        };
        let lateness = [late(|k| -2.0 * k), late(|_| 1.0)];
        PulseShape {
            samples,
            peak,
            bin,
            bins_per_ns: exact_inverse(bin),
            length,
            duration,
            top: 4.0 * exp(-2.0),
            top_time: 2.0 * tau,
            integral: length / LENGTH_OVER_INTEGRAL,
            decay,
            growth: exp(decay),
            lateness,
            // Concave for t from (2 − √2)τ to (2 + √2)τ, around its peak at 2τ.
            concave: std::f64::consts::SQRT_2 / decay,
            curve: Curve::Gamma,
        }
    }

    /// A raised cosine, ½ − ½cos(2πt/T) for t from 0 to T, that is as wide at half maximum, T/2, as the
    /// gamma-like curve of `length` ns. Sums of pulses shifted by less than T are a constant and a cosine
    /// again, whose maximum is known exactly: the echo of a slope has it at the mean range, as no lopsided
    /// pulse has.
    pub fn raised_cosine(length: f64, bin: f64) -> PulseShape {
        let duration = 2.0 * width_of_pulse_length(length);
        let bins = duration / bin;
        let omega = TAU / bins;
        // The last sample is within the pulse only if it starts late.
        let last = bins.ceil() as usize;
        let mut samples = vec![0.0; last + 1];
        let mut lateness = [vec![0.0; last + 1], vec![0.0; last + 1]];
        for k in 1..=last {
            let (sin, cos) = sincos(k as f64 * omega);
            samples[k] = 0.5 - 0.5 * cos;
            (lateness[0][k], lateness[1][k]) = (0.5 * cos, -0.5 * sin);
        }
        if last as f64 > bins {
            let dark = last as f64 - bins;
            samples[last] = 0.0;
            [lateness[0][last], lateness[1][last]] = end_of_cosine(omega, dark);
        }
        PulseShape {
            peak: index_of_max(&samples),
            samples,
            bin,
            bins_per_ns: exact_inverse(bin),
            length,
            duration,
            top: 1.0,
            top_time: 0.5 * duration,
            integral: 0.5 * duration,
            decay: 0.0,
            growth: 1.0,
            lateness,
            concave: 0.25 * bins,
            curve: Curve::Cosine(CosineMaximum::new(omega)),
        }
    }

    /// A pulse of measured shape.
    pub fn measured(pulse: &PulseSamples, bin: f64) -> PulseShape {
        let (samples, lateness) = sampled::digitise(pulse, bin);
        let top_time = maximum::time_of_measured(pulse);
        let mut shape = PulseShape {
            peak: index_of_max(&samples),
            samples,
            bin,
            bins_per_ns: exact_inverse(bin),
            length: pulse_length_of_width(sampled::width(pulse)),
            duration: sampled::duration(pulse),
            top: 1.0,
            top_time,
            integral: sampled::integral(pulse),
            decay: 0.0,
            growth: 1.0,
            lateness,
            concave: 0.0,
            curve: Curve::Measured(MeasuredMaximum::default()),
        };
        let late = |k: usize, by: f64| shape.late_sample(k, &shape.late(&[by; LANES]).map(|f| f[0]));
        shape.curve = Curve::Measured(MeasuredMaximum::new(top_time / bin, shape.samples.len(), late));
        shape
    }

    /// Time from the start of a pulse to the point that its range refers to, ns: its maximum where pulses may
    /// start between bins, otherwise its largest sample.
    pub fn lead(&self, between_bins: bool) -> f64 {
        if between_bins { self.top_time } else { self.peak as f64 * self.bin }
    }

    /// Full width at half maximum, ns.
    pub fn width(&self) -> f64 {
        width_of_pulse_length(self.length)
    }

    /// Length of the gamma-like curve that has the integral of this pulse, ns.
    pub fn length_of_equal_energy(&self) -> f64 {
        self.integral * LENGTH_OVER_INTEGRAL
    }

    /// Factor on the average power, of which the energy of pulses follows whose instrument does not state it:
    /// the default pulse has the peak power of the gamma-like curve of that length.
    pub fn power_factor(&self) -> f64 {
        match self.curve {
            Curve::Cosine(_) => 4.0 * exp(-2.0) * self.length_of_equal_energy() / self.length,
            Curve::Gamma | Curve::Measured(_) => 1.0,
        }
    }

    /// Factors of `samples` and of both `lateness` whose sum is the pulse that starts `by` bins (0 to 1)
    /// late: ((k−φ)x)²e^(−(k−φ)x) = e^(φx)·(k² − 2kφ + φ²)·x²e^(−kx), and cos(ω(k−φ)) = cos ωk − (1 − cos
    /// ωφ)·cos ωk + sin ωφ·sin ωk.
    #[inline(always)]
    pub fn late(&self, by: &Block) -> [Block; 3] {
        let mut late = [[0.0; LANES]; 3];
        if let Curve::Cosine(curve) = &self.curve {
            late[0] = [1.0; LANES];
            if curve.omega < MAX_SERIES_ARGUMENT {
                for i in 0..LANES {
                    (late[1][i], late[2][i]) = cosine_series(by[i] * curve.omega);
                }
            } else {
                for i in 0..LANES {
                    let (sin, cos) = sincos(by[i] * curve.omega);
                    (late[1][i], late[2][i]) = (1.0 - cos, sin);
                }
            }
            return late;
        }
        let is_short = self.decay < MAX_SERIES_ARGUMENT;
        for i in 0..LANES {
            late[0][i] = if is_short { exp_series(by[i] * self.decay) } else { 0.0 };
        }
        if !is_short {
            late[0] = by.map(|by| exp(by * self.decay));
        }
        for i in 0..LANES {
            late[1][i] = late[0][i] * by[i];
            late[2][i] = late[1][i] * by[i];
        }
        late
    }

    /// Sample `k` of pulses that start late in their bin, of which `late` are the summed factors.
    #[inline(always)]
    pub fn late_sample(&self, k: usize, late: &[f64; 3]) -> f64 {
        self.samples[k] * late[0] + self.lateness[0][k] * late[1] + self.lateness[1][k] * late[2]
    }

    /// Adds all samples of pulses that start late in their bin, of which `late` are the summed factors.
    #[inline(always)]
    pub fn add_late(&self, late: &[f64; 3], to: &mut [f64]) {
        let pulse = self.samples.iter().zip(&self.lateness[0]).zip(&self.lateness[1]);
        for (to, ((sample, first), second)) in to.iter_mut().zip(pulse) {
            *to += sample * late[0] + first * late[1] + second * late[2];
        }
    }

    /// Maximum distance between pulses, bins, with which their sum has a single peak: all of them must be
    /// concave between the first peak and the last.
    pub fn concave_reach(&self) -> f64 {
        self.concave
    }

    /// Bins from the start of a waveform to the maximum of its first pulse, which so lies on a sample, and
    /// how many bins that pulse starts late.
    pub fn first_start(&self) -> (f64, f64) {
        let lead = self.top_time / self.bin;
        let bins = (lead - ROUNDING).ceil();
        (bins, bins - lead)
    }

    /// The maximum of an echo from its largest sample and the samples before and after it.
    #[inline(always)]
    pub fn maximum(&self, samples: [f64; 3]) -> Maximum {
        match &self.curve {
            Curve::Gamma => maximum::of_gamma(samples, self.decay, self.growth),
            Curve::Cosine(curve) => curve.read(samples),
            Curve::Measured(readings) => readings.read(samples),
        }
    }
}

/// Index of the largest sample, the first of equal ones.
fn index_of_max(samples: &[f64]) -> usize {
    let mut peak = 0;
    for (k, s) in samples.iter().enumerate() {
        if *s > samples[peak] {
            peak = k;
        }
    }
    peak
}

/// Arguments up to which [`exp_series`] is exact enough.
const MAX_SERIES_ARGUMENT: f64 = 1.0;

/// e^x for x from 0 to [`MAX_SERIES_ARGUMENT`]: a Taylor series of 12 terms, whose remainder is below 3e-9,
/// and below 2e-12 up to 0.5, so that ranges move by nanometres.
#[inline(always)]
fn exp_series(x: f64) -> f64 {
    const C: [f64; 12] = {
        let mut c = [1.0; 12];
        let mut k = 1;
        while k < 12 {
            c[k] = c[k - 1] / k as f64;
            k += 1;
        }
        c
    };
    let x2 = x * x;
    let x4 = x2 * x2;
    let low = (C[0] + C[1] * x) + x2 * (C[2] + C[3] * x);
    let middle = (C[4] + C[5] * x) + x2 * (C[6] + C[7] * x);
    let high = (C[8] + C[9] * x) + x2 * (C[10] + C[11] * x);
    low + x4 * (middle + x4 * high)
}

/// 1 − cos x and sin x for x from 0 to [`MAX_SERIES_ARGUMENT`]: Taylor series whose remainders are below
/// 1e-12.
#[inline(always)]
fn cosine_series(x: f64) -> (f64, f64) {
    const C: [f64; 15] = {
        let mut c = [1.0; 15];
        let mut k = 1;
        while k < 15 {
            c[k] = c[k - 1] / k as f64;
            k += 1;
        }
        c
    };
    let y = x * x;
    let versine = C[2] - y * (C[4] - y * (C[6] - y * (C[8] - y * (C[10] - y * (C[12] - y * C[14])))));
    let sine = C[1] - y * (C[3] - y * (C[5] - y * (C[7] - y * (C[9] - y * (C[11] - y * C[13])))));
    (y * versine, x * sine)
}

/// Coefficients of 1 − cos ωφ and sin ωφ for the sample that a raised cosine reaches if it starts φ > `dark`
/// bins late. Next to the peak, where the pulse has few samples, they are right for φ = 1 and halfway there;
/// else for φ = 1, and never negative.
fn end_of_cosine(omega: f64, dark: f64) -> [f64; 2] {
    let power = |late: f64| 0.5 - 0.5 * cos(omega * (late - dark));
    let (sin_1, cos_1) = sincos(omega);
    if omega <= maximum::MAX_OMEGA {
        return [power(1.0) / (1.0 - cos_1), 0.0];
    }
    let half = 0.5 * (1.0 + dark);
    let (sin_half, cos_half) = sincos(omega * half);
    let determinant = (1.0 - cos_1) * sin_half - (1.0 - cos_half) * sin_1;
    let [one, other] = [power(1.0), power(half)];
    [
        (one * sin_half - other * sin_1) / determinant,
        (other * (1.0 - cos_1) - one * (1.0 - cos_half)) / determinant,
    ]
}

/// 1/x if every product with it rounds like the quotient with x: if x is a power of two.
fn exact_inverse(x: f64) -> Option<f64> {
    let is_power_of_two = x.is_normal() && x.to_bits() & ((1 << (f64::MANTISSA_DIGITS - 1)) - 1) == 0;
    (is_power_of_two && (1.0 / x).is_normal()).then_some(1.0 / x)
}

/// End of a gamma-like pulse of `length` ns, ns: there or, if `whole`, where 3e-4 of its peak are left.
fn duration(length: f64, whole: bool) -> f64 {
    if whole { 2.0 * length } else { length }
}

/// Duration of the pulse of `length` ns by these corrections, ns.
pub(super) fn duration_of(length: f64, corrections: &Corrections) -> f64 {
    match corrections.symmetric_pulse {
        true => 2.0 * width_of_pulse_length(length),
        false => duration(length, corrections.whole_pulse),
    }
}

/// Number of samples of a pulse that lasts `duration` ns: the whole bins that fit.
pub(super) fn sample_count(duration: f64, bin: f64) -> usize {
    (duration / bin) as usize
}

#[cfg(test)]
mod tests;
