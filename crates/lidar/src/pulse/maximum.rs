//! The maximum of an echo from its largest sample and the two adjacent ones.
//!
//! A parabola through the three samples has its vertex near the maximum of any smooth echo, but neither
//! exactly at its time nor at its height: a pulse is lopsided. So the instrument's own pulse corrects the
//! reading by its difference from the pulse's parabola: an echo of the very shape of the pulse is read
//! exactly, in bins of any width that leave three samples of it. The flatter an echo is than the pulse, which
//! is stretched by a slope or merged of several, the more the parabola alone counts for its height.

use super::sampled;
use libm::{atan, atan2, exp, sincos};
use std::f64::consts::TAU;
use vlscan_survey::PulseSamples;

/// The maximum of an echo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Maximum {
    /// Time from the largest sample, bins.
    pub offset: f64,
    pub amplitude: f64,
}

/// The parabola through three samples, in units of the middle one.
#[derive(Clone, Copy, Debug, Default)]
struct Parabola {
    /// Time of the vertex from the middle sample, bins.
    offset: f64,
    /// Height of the vertex above the middle sample.
    rise: f64,
    /// Second difference, positive at a maximum.
    curvature: f64,
}

impl Parabola {
    /// The parabola through samples 1 bin before and after one of height 1; flat unless that one is the
    /// largest.
    #[inline(always)]
    fn through(before: f64, after: f64) -> Parabola {
        let (slope, curvature) = (0.5 * (after - before), (1.0 - before) + (1.0 - after));
        // False for NaN, too.
        if !(curvature > 0.0 && 2.0 * slope.abs() <= curvature) {
            return Parabola::default();
        }
        let offset = slope / curvature;
        Parabola { offset, rise: 0.5 * slope * offset, curvature }
    }
}

/// Difference of an echo of the pulse's own shape from the parabola through its samples.
#[derive(Clone, Copy, Debug, Default)]
struct PulseReading {
    /// Time of its maximum from the vertex, bins.
    offset: f64,
    /// Height of its maximum above the vertex, in units of the largest sample.
    rise: f64,
    /// Second difference of its samples.
    curvature: f64,
}

impl PulseReading {
    #[inline(always)]
    fn correct(&self, found: Parabola, top: f64) -> Maximum {
        let likeness = if found.curvature < self.curvature { found.curvature / self.curvature } else { 1.0 };
        Maximum {
            offset: found.offset + self.offset,
            amplitude: top * (1.0 + found.rise + likeness * self.rise),
        }
    }
}

/// The maximum of an echo of the gamma-like pulse (t/τ)²·e^(−t/τ) in bins of x·τ, `growth` = e^x, from its
/// samples `[before, top, after]`.
///
/// The ratio of two samples gives the start of the pulse: √(F·e^(t/τ)) grows linearly from its start. With a
/// start u·τ before the largest sample, g = √(F₊/F₋)·e^x = (u + x)/(u − x); where the sample before it is
/// dark, √(F₊/F₀)·e^(x/2) = (u + x)/u. The maximum is 2τ after the start, and (2/u)²·e^(u−2) times as high as
/// the largest sample.
#[inline(always)]
pub(super) fn of_gamma([before, top, after]: [f64; 3], x: f64, growth: f64) -> Maximum {
    let (relative_before, relative_after) = (before / top, after / top);
    let found = Parabola::through(relative_before, relative_after);
    let u = if before > 0.0 {
        x + 2.0 * x / ((after / before).sqrt() * growth - 1.0)
    } else {
        x / ((relative_after * growth).sqrt() - 1.0)
    };
    let offset = (2.0 - u) / x;
    // Echoes of other shapes, and NaN.
    if !(offset.abs() <= 1.0 && u > 0.0) {
        return PulseReading::default().correct(found, top);
    }
    let (later, earlier) = ((u + x) / u, ((u - x) / u).max(0.0));
    let own = Parabola::through(earlier * earlier * growth, later * later / growth);
    if own.curvature == 0.0 {
        return PulseReading::default().correct(found, top);
    }
    let gain = (4.0 / (u * u)) * exp(u - 2.0);
    // The ratio gives the time of the pulse with less noise than the vertex, whose second difference is
    // noisy, but not that of an echo which is much flatter.
    let likeness = (MIN_LIKENESS_INVERTED * found.curvature / own.curvature).clamp(0.0, 1.0);
    let offset = likeness * (offset - found.offset);
    PulseReading { offset, rise: gain - 1.0 - own.rise, curvature: own.curvature }.correct(found, top)
}

/// Second difference of the pulse over that of the flattest echo whose time is read as that of the pulse.
const MIN_LIKENESS_INVERTED: f64 = 2.0;

/// The maximum of echoes of pulses a + A·cos ωk, k in bins, of which sums of shifted ones are of the same
/// form.
#[derive(Clone, Copy, Debug)]
pub(super) struct CosineMaximum {
    /// rad per bin.
    pub omega: f64,
    /// 1/(2(1 − cos ω)), 1/(2 sin ω).
    inverted: [f64; 2],
    /// Sine and cosine of ω/2.
    half: (f64, f64),
}

/// Bins, rad, up to which the largest sample of an echo has neighbours that lie completely within the pulse:
/// five in a period.
pub(super) const MAX_OMEGA: f64 = TAU / 5.0;

impl CosineMaximum {
    /// For pulses of `omega` rad per bin.
    pub fn new(omega: f64) -> CosineMaximum {
        let (sin, cos) = sincos(omega);
        CosineMaximum { omega, inverted: [0.5 / (1.0 - cos), 0.5 / sin], half: sincos(0.5 * omega) }
    }

    /// The maximum from the samples `[before, top, after]`, `offset` m bins after the largest: the second
    /// difference 2F₀ − F₊ − F₋ = 2A(1 − cos ω)·cos ωm and F₊ − F₋ = 2A sin ω·sin ωm. In wider bins from the
    /// larger neighbour, if it is that of a single pulse, a = A: √(F₊/F₀) = cos(ω/2) + sin(ω/2)·tan(ωm/2).
    #[inline(always)]
    pub fn read(&self, [before, top, after]: [f64; 3]) -> Maximum {
        if self.omega > MAX_OMEGA {
            return self.read_two([before, top, after]);
        }
        let (second, first) = ((top - before) + (top - after), after - before);
        let (cosine, sine) = (second * self.inverted[0], first * self.inverted[1]);
        let offset = atan2(sine, cosine) / self.omega;
        // Plateaus, echoes of other shapes, and NaN.
        if !(second > 0.0 && offset.abs() <= 1.0) {
            return PulseReading::default().correct(Parabola::through(before / top, after / top), top);
        }
        Maximum { offset, amplitude: top + ((cosine * cosine + sine * sine).sqrt() - cosine) }
    }

    fn read_two(&self, [before, top, after]: [f64; 3]) -> Maximum {
        let (other, sign) = if after >= before { (after, 1.0) } else { (before, -1.0) };
        let tangent = ((other.max(0.0) / top).sqrt() - self.half.1) / self.half.0;
        let (half_angle, cosine) = (atan(tangent), 1.0 / (1.0 + tangent * tangent).sqrt());
        let offset = 2.0 * half_angle / self.omega;
        if offset.is_nan() || offset.abs() > 1.0 {
            return PulseReading::default().correct(Parabola::through(before / top, after / top), top);
        }
        // F₀ = 2A·cos²(ωm/2).
        Maximum { offset: sign * offset, amplitude: top / (cosine * cosine) }
    }
}

/// Steps per bin of [`MeasuredMaximum`].
const STEPS_PER_BIN: usize = 64;

/// Readings of the maximum of a pulse of measured shape, tabulated for starts within a bin.
#[derive(Clone, Debug, Default)]
pub(super) struct MeasuredMaximum {
    /// Vertex of the parabola and what the pulse differs from it, by ascending vertex.
    readings: Vec<(f64, PulseReading)>,
}

impl MeasuredMaximum {
    /// The readings of a pulse whose sample k, where it starts `by` bins (0 to 1) late, is `sample(k, by)` of
    /// its maximum `top_bin` bins after its start.
    pub fn new(top_bin: f64, count: usize, sample: impl Fn(usize, f64) -> f64) -> MeasuredMaximum {
        let mut readings: Vec<(f64, PulseReading)> = Vec::new();
        for step in 0..STEPS_PER_BIN {
            let by = step as f64 / STEPS_PER_BIN as f64;
            let samples: Vec<f64> = (0..count).map(|k| sample(k, by)).collect();
            let Some(k) = (0..count).max_by(|a, b| samples[*a].total_cmp(&samples[*b])) else { continue };
            let (before, after) = (k.checked_sub(1).map_or(0.0, |k| samples[k]), samples.get(k + 1).copied());
            let own = Parabola::through(before / samples[k], after.unwrap_or(0.0) / samples[k]);
            let offset = top_bin + by - k as f64 - own.offset;
            let rise = 1.0 / samples[k] - 1.0 - own.rise;
            if own.curvature > 0.0 && offset.is_finite() && rise.is_finite() {
                readings.push((own.offset, PulseReading { offset, rise, curvature: own.curvature }));
            }
        }
        readings.sort_by(|a, b| a.0.total_cmp(&b.0));
        MeasuredMaximum { readings }
    }

    pub fn read(&self, [before, top, after]: [f64; 3]) -> Maximum {
        let found = Parabola::through(before / top, after / top);
        self.reading_at(found.offset).correct(found, top)
    }

    /// The reading of a pulse whose parabola has its vertex at `offset`.
    fn reading_at(&self, offset: f64) -> PulseReading {
        let above = self.readings.partition_point(|r| r.0 < offset);
        let (Some(low), Some(high)) = (
            self.readings.get(above.saturating_sub(1)),
            self.readings.get(above.min(self.readings.len().saturating_sub(1))),
        ) else {
            return PulseReading::default();
        };
        let width = high.0 - low.0;
        let part = if width > 0.0 { ((offset - low.0) / width).clamp(0.0, 1.0) } else { 0.0 };
        let between = |a: f64, b: f64| a + (b - a) * part;
        PulseReading {
            offset: between(low.1.offset, high.1.offset),
            rise: between(low.1.rise, high.1.rise),
            curvature: between(low.1.curvature, high.1.curvature),
        }
    }
}

/// Time of the maximum of a measured pulse after its first sample, ns: the middle of its largest power.
pub(super) fn time_of_measured(pulse: &PulseSamples) -> f64 {
    let top = pulse.powers.iter().copied().fold(0.0, f64::max);
    let first = pulse.powers.iter().position(|p| *p == top).unwrap_or(0);
    let last = first + pulse.powers[first..].iter().take_while(|p| **p == top).count().max(1) - 1;
    let time = |i: usize| pulse.times.get(i).copied().unwrap_or_else(|| sampled::duration(pulse));
    0.5 * (time(first) + time(last))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of (t/τ)²·e^(−t/τ) in bins of `x`·τ, which starts `by` bins after sample 0, and its largest
    /// three.
    fn gamma(x: f64, by: f64) -> (usize, [f64; 3]) {
        let at = |k: usize| {
            let t = ((k as f64 - by) * x).max(0.0);
            t * t * exp(-t)
        };
        let samples: Vec<f64> = (0..64).map(at).collect();
        let k = (0..64).max_by(|a, b| samples[*a].total_cmp(&samples[*b])).unwrap();
        (k, [samples[k - 1], samples[k], samples[k + 1]])
    }

    #[test]
    fn the_gamma_pulse_is_read_exactly_in_bins_up_to_its_width() {
        // 3.3947 τ is the width at half maximum.
        for x in [0.1, 0.4375, 0.875, 1.697, 3.3947] {
            for i in 0..200 {
                let by = f64::from(i) / 200.0;
                let (k, samples) = gamma(x, by);
                let found = of_gamma(samples, x, exp(x));
                let time = k as f64 + found.offset - by;
                assert!((time * x - 2.0).abs() < 1e-8, "bins of {x} τ, {by} late: {}", time * x);
                assert!((found.amplitude / (4.0 * exp(-2.0)) - 1.0).abs() < 1e-8, "{x} {by}: {found:?}");
            }
        }
    }

    #[test]
    fn the_raised_cosine_is_read_exactly_in_bins_up_to_its_width() {
        // Half a period is the width at half maximum.
        for bins in [40.0, 16.3, 8.0, 5.0, 4.0, 3.0, 2.5, 2.05, 2.0] {
            let omega = TAU / bins;
            for i in 0..200 {
                let by = f64::from(i) / 200.0;
                let at = |k: usize| {
                    let t = k as f64 - by;
                    if (0.0..bins).contains(&t) { 3.5 * (1.0 - libm::cos(omega * t)) } else { 0.0 }
                };
                let samples: Vec<f64> = (0..64).map(at).collect();
                let k = (0..64).max_by(|a, b| samples[*a].total_cmp(&samples[*b])).unwrap();
                let found = CosineMaximum::new(omega).read([samples[k - 1], samples[k], samples[k + 1]]);
                let time = k as f64 + found.offset - by - 0.5 * bins;
                assert!(time.abs() < 1e-8, "{bins} bins, {by} late: {time}");
                assert!((found.amplitude / 7.0 - 1.0).abs() < 1e-8, "{bins} {by}: {found:?}");
            }
        }
    }

    #[test]
    fn a_broad_echo_is_read_by_its_own_parabola() {
        // A Gaussian of 6 τ, far flatter than the pulse.
        for (x, time, height) in [(0.4375, 0.03, 5e-4), (1.697, 0.25, 6e-3)] {
            for i in 0..50 {
                let off = f64::from(i) / 50.0 - 0.5;
                let at = |k: f64| exp(-0.5 * ((k - off) * x / 6.0).powi(2));
                let found = of_gamma([at(-1.0), at(0.0), at(1.0)], x, exp(x));
                assert!((found.offset - off).abs() * x < time, "{x} {off}: {found:?}");
                assert!((found.amplitude - 1.0).abs() < height, "{x} {off}: {found:?}");
            }
        }
    }

    #[test]
    fn what_is_no_echo_stays_at_its_largest_sample() {
        for samples in [[f64::NAN; 3], [0.0, f64::INFINITY, 0.0], [1.0, 1.0, 1.0], [-1.0, 0.0, 2.0]] {
            let found = of_gamma(samples, 0.4375, exp(0.4375));
            assert!(found.offset.is_nan() || found.offset.abs() <= 1.0, "{samples:?}: {found:?}");
        }
        assert_eq!(of_gamma([0.0, 1.0, 0.0], 0.4375, exp(0.4375)).amplitude, 1.0);
    }

    #[test]
    fn the_maximum_of_a_measured_pulse_is_the_middle_of_its_plateau() {
        let pulse =
            |powers: [f64; 4]| PulseSamples { times: vec![0.0, 1.0, 3.0, 4.0], powers: powers.to_vec() };
        assert_eq!(time_of_measured(&pulse([0.0, 1.0, 1.0, 0.0])), 2.0);
        assert_eq!(time_of_measured(&pulse([0.0, 0.5, 1.0, 0.0])), 3.0);
        assert_eq!(time_of_measured(&pulse([1.0, 0.5, 0.2, 0.0])), 0.0);
    }
}
