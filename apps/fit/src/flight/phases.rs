//! Straight lines through values, and rates and phases of what recurs.

use libm::{atan2, cos, hypot, sin};
use std::f64::consts::TAU;

/// Seconds over which phases are compared to find a rate.
const COMPARED: f64 = 4.0;
/// Maximum number of rates on either side of the first guess.
const MAX_TRIALS: f64 = 20_000.0;

/// Maximum error of the rough agreement of phases, as a share of the number of samples.
const SIZE_ERROR: f64 = 1e-6;

/// Straight line y = start + slope · x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StraightLine {
    /// Change of y per unit of x.
    pub slope: f64,
    /// y at x = 0.
    pub start: f64,
}

impl StraightLine {
    /// Line through values by least squares; NaN if all x are equal.
    pub fn through(x: &[f64], y: &[f64]) -> StraightLine {
        StraightLine::through_points(x.iter().copied().zip(y.iter().copied()))
    }

    /// Line through points (x, y) by least squares, which are computed several times; NaN if all x are equal.
    pub fn through_points(points: impl Iterator<Item = (f64, f64)> + Clone) -> StraightLine {
        let count = points.clone().count() as f64;
        let mx = points.clone().map(|(x, _)| x).sum::<f64>() / count;
        let my = points.clone().map(|(_, y)| y).sum::<f64>() / count;
        let (mut xx, mut xy) = (0.0, 0.0);
        for (x, y) in points {
            xx += (x - mx) * (x - mx);
            xy += (x - mx) * (y - my);
        }
        let slope = xy / xx;
        StraightLine { slope, start: my - slope * mx }
    }

    /// y at x.
    pub fn at(&self, x: f64) -> f64 {
        self.start + self.slope * x
    }
}

/// Something that recurs: its rate per second, and its phase at time 0, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recurrence {
    /// 1/s.
    pub rate: f64,
    /// rad.
    pub phase: f64,
}

/// Phase at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseSample {
    /// s.
    pub time: f64,
    /// rad.
    pub phase: f64,
}

impl PhaseSample {
    /// Samples of the phase 0 at these times.
    pub fn zeros(times: &[f64]) -> Vec<PhaseSample> {
        times.iter().map(|time| PhaseSample { time: *time, phase: 0.0 }).collect()
    }
}

/// Agreement of the phases of samples at a rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coherence {
    /// Length of the sum of the unit vectors of all phases: from 0 to the number of samples.
    pub size: f64,
    /// Mean phase at time 0, rad.
    pub phase: f64,
}

/// Agreement of the phases of samples at a rate.
pub fn coherence(samples: &[PhaseSample], rate: f64) -> Coherence {
    let (mut re, mut im) = (0.0, 0.0);
    for PhaseSample { time, phase } in samples {
        let angle = phase - TAU * rate * time;
        (re, im) = (re + cos(angle), im + sin(angle));
    }
    Coherence { size: hypot(re, im), phase: atan2(im, re) }
}

/// The rate within a share of `coarse` at which the phases of samples agree best, and their phase at time 0.
/// Of samples with the phase 0 the result is the phase of the rate at time 0, reversed.
pub fn coherent_rate(samples: &[PhaseSample], coarse: f64, share: f64) -> Recurrence {
    let first = samples.iter().map(|sample| sample.time).fold(f64::INFINITY, f64::min);
    let last = samples.iter().map(|sample| sample.time).fold(f64::NEG_INFINITY, f64::max);
    let until = (last - first).clamp(0.0, COMPARED);
    let samples: Vec<PhaseSample> =
        samples.iter().filter(|sample| sample.time - first <= until).copied().collect();
    let size = |rate: f64| coherence(&samples, rate).size;
    let step = 0.2 / until.max(0.1);
    let count = (coarse.abs() * share / step).ceil().min(MAX_TRIALS) as i64;
    let rough = sizes_of_rates(&samples, coarse - count as f64 * step, step, 2 * count as usize + 1);
    let least = rough.iter().copied().fold(f64::NEG_INFINITY, f64::max) - SIZE_ERROR * samples.len() as f64;
    let (mut largest, mut best) = (f64::NEG_INFINITY, coarse);
    for (k, _) in (-count..=count).zip(rough).filter(|(_, size)| *size >= least) {
        let rate = coarse + k as f64 * step;
        let size = size(rate);
        if size > largest {
            (largest, best) = (size, rate);
        }
    }
    // Finer, in thirds.
    let (mut low, mut high) = (best - step, best + step);
    for _ in 0..40 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if size(a) < size(b) { low = a } else { high = b }
    }
    let rate = 0.5 * (low + high);
    Recurrence { rate, phase: coherence(&samples, rate).phase }
}

/// Rough agreement of the phases of samples at `count` rates from `first` in steps of `step`. Unit vectors
/// are turned from rate to rate, which takes a small part of the time of sines and cosines.
fn sizes_of_rates(samples: &[PhaseSample], first: f64, step: f64, count: usize) -> Vec<f64> {
    let vector = |angle: f64| (cos(angle), sin(angle));
    let mut vectors: Vec<(f64, f64)> =
        samples.iter().map(|sample| vector(sample.phase - TAU * first * sample.time)).collect();
    let turns: Vec<(f64, f64)> = samples.iter().map(|sample| vector(-TAU * step * sample.time)).collect();
    let size = |_: usize| {
        let (mut re, mut im) = (0.0, 0.0);
        for ((x, y), (cos, sin)) in vectors.iter_mut().zip(&turns) {
            (re, im) = (re + *x, im + *y);
            (*x, *y) = (*x * cos - *y * sin, *x * sin + *y * cos);
        }
        hypot(re, im)
    };
    (0..count).map(size).collect()
}

/// Rate and phase at time 0 of lines that pass the angle 0 at these times, near `multiple` times the rate of
/// their intervals.
pub fn line_rate(crossings: &[f64], multiple: f64) -> Option<Recurrence> {
    let mut times = crossings.to_vec();
    times.sort_by(f64::total_cmp);
    let coarse = multiple / period(&times)?;
    Some(coherent_rate(&PhaseSample::zeros(&times), coarse, 0.05))
}

/// Period of lines at these ascending times, of which some may be missing and some cut to parts; `None` for
/// too few.
pub fn period(times: &[f64]) -> Option<f64> {
    let mut gaps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_by(f64::total_cmp);
    // Parts of one line have nearly the same time.
    let large = *gaps.get(gaps.len() * 3 / 4)?;
    gaps.retain(|gap| *gap > 0.3 * large);
    // Where lines are missing, gaps are multiples of the period.
    gaps.get(gaps.len() / 10).copied().filter(|period| *period > 0.0)
}

/// Removes jumps of whole turns between successive phases.
pub fn unwrap(phases: &mut [f64]) {
    for i in 1..phases.len() {
        let turns = ((phases[i] - phases[i - 1]) / TAU).round();
        phases[i] -= turns * TAU;
    }
}

/// An angle from −π to π.
pub fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_goes_through_its_points() {
        let line = StraightLine::through(&[1.0, 2.0, 4.0], &[5.0, 7.0, 11.0]);
        assert!((line.slope - 2.0).abs() < 1e-12 && (line.start - 3.0).abs() < 1e-12, "{line:?}");
        assert!((line.at(10.0) - 23.0).abs() < 1e-12);
        assert!(StraightLine::through(&[1.0, 1.0], &[0.0, 1.0]).slope.is_nan());
    }

    /// Phases at 90.03 turns per second, of which those of every third moment are missing.
    fn samples() -> Vec<PhaseSample> {
        let times = (0..600).filter(|k| k % 3 != 1).map(|k| 0.005 * f64::from(k));
        times.map(|time| PhaseSample { time, phase: wrapped(TAU * 90.03 * time + 0.7) }).collect()
    }

    #[test]
    fn the_rate_of_phases_is_found_near_a_coarse_rate() {
        let found = coherent_rate(&samples(), 87.0, 0.1);
        assert!((found.rate - 90.03).abs() < 1e-6 && (found.phase - 0.7).abs() < 1e-4, "{found:?}");
        let Coherence { size, phase } = coherence(&samples(), 90.03);
        assert!((size - 400.0).abs() < 1e-6 && (phase - 0.7).abs() < 1e-6, "{size} {phase}");
        assert!(coherence(&samples(), 91.0).size < 100.0);
    }

    #[test]
    fn rough_agreements_are_close_to_exact_ones_at_high_rates() {
        let (first, step, count) = (400_000.0, 0.05, 40_001);
        let rough = sizes_of_rates(&samples(), first, step, count);
        assert_eq!(rough.len(), count);
        for k in (0..count).step_by(1000) {
            let exact = coherence(&samples(), first + k as f64 * step).size;
            assert!((rough[k] - exact).abs() < 0.1 * SIZE_ERROR * 400.0, "{k}: {} is not {exact}", rough[k]);
        }
    }

    #[test]
    fn lines_that_are_missing_or_cut_do_not_change_the_rate() {
        // Line 18 is cut to two parts.
        let numbers = (0..200).filter(|k| k % 7 != 3).map(|k| 0.3 + f64::from(k));
        let mut times: Vec<f64> = numbers.map(|number| number / 60.0).collect();
        times.push(18.3 / 60.0 + 1e-4);
        let found = line_rate(&times, 1.0).unwrap();
        assert!((found.rate - 60.0).abs() < 0.01, "{found:?}");
        assert!((wrapped(found.phase + TAU * 0.3)).abs() < 0.01, "{found:?}");
        assert_eq!(line_rate(&[1.0], 1.0), None);
    }

    #[test]
    fn phases_are_unwrapped_and_wrapped() {
        let mut phases = [3.0, -3.0, -2.0, 2.5];
        unwrap(&mut phases);
        let expected = [3.0, TAU - 3.0, TAU - 2.0, 2.5];
        assert!(phases.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{phases:?}");
        assert!((wrapped(7.0) - (7.0 - TAU)).abs() < 1e-12);
    }
}
