//! Echo widths by fitting a Gaussian (spec pulse-physics §4.5).

use super::waveform::Waveform;
use libm::exp;

const MAX_ITERATIONS: u32 = 10_000;
/// Reduction of the squared error below which a step ends the fit.
const MIN_GAIN: f64 = 1e-4;
/// Largest distance of a fitted bin from the peak: 5 km of 0.25 ns bins on either side.
const MAX_REACH: u64 = 1 << 16;
/// e^(−x) is exactly zero from here on.
const UNDERFLOW: f64 = 746.0;

/// Half width at 1/e, in bins, of the Gaussian on a pedestal that fits `waveform` around its peak of height `top` in
/// bin `peak`. `reach` limits the fit to bins at most that far from the peak. The width may be negative, absurd or NaN.
pub(super) fn width(waveform: &Waveform, peak: u64, top: f64, reach: Option<u64>) -> f64 {
    fit_gaussian(waveform, peak, top, reach)[3]
}

/// The Gaussian of [`width`]: pedestal, height above it, centre and half width at 1/e, in bins.
pub(super) fn fit_gaussian(waveform: &Waveform, peak: u64, top: f64, reach: Option<u64>) -> [f64; 4] {
    let reach = reach.unwrap_or(MAX_REACH).min(MAX_REACH);
    let window = (peak.saturating_sub(reach), peak.saturating_add(reach + 1).min(waveform.bins));
    marquardt(waveform, window, [0.0, top, peak as f64, 1.0]).0
}

/// Levenberg–Marquardt fit and its number of iterations.
fn marquardt(waveform: &Waveform, window: (u64, u64), start: [f64; 4]) -> ([f64; 4], u32) {
    let mut at = start;
    let mut sums = NormalEquations::over(waveform, window, &at);
    let mut mu = 0.01;
    for iteration in 1..=MAX_ITERATIONS {
        let Some(step) = sums.step(mu) else { return (at, iteration) };
        let tried = std::array::from_fn(|k| at[k] + step[k]);
        let there = NormalEquations::over(waveform, window, &tried);
        let gain = sums.error - there.error;
        if gain < 0.0 {
            mu *= 10.0;
            continue;
        }
        (at, sums) = (tried, there);
        // NaN propagates: the fit cannot change any more.
        if (0.0..MIN_GAIN).contains(&gain) || at[3].is_nan() {
            return (at, iteration);
        }
    }
    (at, MAX_ITERATIONS)
}

/// The normal equations of a step, summed over the bins.
#[derive(Clone, Copy, Debug, Default)]
struct NormalEquations {
    /// JᵀJ, lower triangle.
    normal: [[f64; 4]; 4],
    /// Jᵀr.
    gradient: [f64; 4],
    /// Σr².
    error: f64,
}

impl NormalEquations {
    fn over(waveform: &Waveform, (from, to): (u64, u64), p: &[f64; 4]) -> NormalEquations {
        let mut sums = NormalEquations::default();
        let gaussian = Gaussian::new(p);
        let mut done = from;
        for (first, bins) in waveform.segments() {
            let (start, end) = (first.clamp(done, to), (first + bins.len() as u64).clamp(done, to));
            sums.add_empty(done, start, &gaussian);
            sums.add_run(start, end, |i| bins[(i - first) as usize], &gaussian);
            done = end.max(start);
        }
        sums.add_empty(done, to, &gaussian);
        sums
    }

    /// Adds bins `start` up to `end` with the heights `f`. The Gaussian is computed by recurrence from the bin nearest
    /// to its centre outwards in both directions, so that rounding errors do not grow.
    fn add_run(&mut self, start: u64, end: u64, f: impl Fn(u64) -> f64, gaussian: &Gaussian) {
        if start >= end {
            return;
        }
        let top = (gaussian.centre.round().max(0.0) as u64).clamp(start, end - 1);
        let height = gaussian.at(top);
        let (mut b, mut ratio) = (height, gaussian.ratio(top, 1.0));
        for i in top..end {
            self.add(i, f(i), b, gaussian);
            b *= ratio;
            ratio *= gaussian.curvature;
        }
        let (mut b, mut ratio) = (height, gaussian.ratio(top, -1.0));
        for i in (start..top).rev() {
            b *= ratio;
            ratio *= gaussian.curvature;
            self.add(i, f(i), b, gaussian);
        }
    }

    /// Adds bin `i` of height `f`, where the Gaussian is `b` high.
    fn add(&mut self, i: u64, f: f64, b: f64, gaussian: &Gaussian) {
        let distance = i as f64 - gaussian.centre;
        let slope = gaussian.steepness * distance * b;
        let j = [1.0, b, slope, slope * (distance * gaussian.inverse_width)];
        self.accumulate(j, f - (gaussian.pedestal + gaussian.height * b));
    }

    fn accumulate(&mut self, j: [f64; 4], r: f64) {
        for a in 0..4 {
            for b in 0..=a {
                self.normal[a][b] += j[a] * j[b];
            }
            self.gradient[a] += j[a] * r;
        }
        self.error += r * r;
    }

    /// Adds empty bins. Where the Gaussian underflows only the pedestal matters, and all such bins are alike.
    fn add_empty(&mut self, from: u64, to: u64, gaussian: &Gaussian) {
        if from >= to {
            return;
        }
        let near = |x: f64| if x.is_nan() { from } else { (x.max(0.0) as u64).clamp(from, to) };
        let foot = gaussian.inverse_width.abs().recip() * UNDERFLOW.sqrt();
        let (start, end) = (near(gaussian.centre - foot), near(gaussian.centre + foot + 1.0));
        self.add_run(start, end, |_| 0.0, gaussian);
        let alike = (to - from - end.saturating_sub(start)) as f64;
        if alike > 0.0 {
            self.normal[0][0] += alike;
            self.gradient[0] -= alike * gaussian.pedestal;
            self.error += alike * (gaussian.pedestal * gaussian.pedestal);
        }
    }

    /// The step with damping `mu`, by LU decomposition with partial pivoting. `None` if a pivot is exactly zero.
    fn step(&self, mu: f64) -> Option<[f64; 4]> {
        let mut m: [[f64; 5]; 4] = std::array::from_fn(|a| {
            std::array::from_fn(|b| match b {
                4 => self.gradient[a],
                _ if a == b => self.normal[a][a] * (1.0 + mu),
                _ => self.normal[a.max(b)][a.min(b)],
            })
        });
        for column in 0..4 {
            let mut pivot = column;
            for row in column + 1..4 {
                if m[row][column].abs() > m[pivot][column].abs() {
                    pivot = row;
                }
            }
            if m[pivot][column] == 0.0 {
                return None;
            }
            m.swap(column, pivot);
            for row in column + 1..4 {
                let factor = m[row][column] / m[column][column];
                let pivot_row = m[column];
                for (value, above) in m[row].iter_mut().zip(pivot_row).skip(column) {
                    *value -= factor * above;
                }
            }
        }
        let mut step = [0.0; 4];
        for row in (0..4).rev() {
            let known: f64 = (row + 1..4).map(|k| m[row][k] * step[k]).sum();
            step[row] = (m[row][4] - known) / m[row][row];
        }
        Some(step)
    }
}

#[derive(Clone, Copy, Debug)]
struct Gaussian {
    pedestal: f64,
    height: f64,
    centre: f64,
    inverse_width: f64,
    /// 1/width².
    narrowness: f64,
    /// 2·height/width².
    steepness: f64,
    /// Ratio of successive ratios between neighbouring bins.
    curvature: f64,
}

impl Gaussian {
    fn new(p: &[f64; 4]) -> Gaussian {
        let narrowness = 1.0 / (p[3] * p[3]);
        Gaussian {
            pedestal: p[0],
            height: p[1],
            centre: p[2],
            inverse_width: 1.0 / p[3],
            narrowness,
            steepness: 2.0 * p[1] * narrowness,
            curvature: exp(-2.0 * narrowness),
        }
    }

    /// Relative height in bin `i`.
    fn at(&self, i: u64) -> f64 {
        let distance = i as f64 - self.centre;
        exp(-(distance * distance * self.narrowness))
    }

    /// Height in the next bin (`step` 1) or the previous one (−1), relative to bin `i`.
    fn ratio(&self, i: u64, step: f64) -> f64 {
        exp(-((2.0 * step * (i as f64 - self.centre) + 1.0) * self.narrowness))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::testkit::{received, tls_detector};

    fn fitted(pulse_length: f64, returns: &[(f64, f64)], peak: u64) -> (f64, u32) {
        let waveform = received(returns, &tls_detector(pulse_length));
        let top = waveform.at(peak);
        let ([.., p3], iterations) = marquardt(&waveform, (0, waveform.bins), [0.0, top, peak as f64, 1.0]);
        assert_eq!(p3.to_bits(), width(&waveform, peak, top, None).to_bits());
        (p3 * 0.25, iterations)
    }

    #[test]
    fn widths_and_iterations_of_the_worked_example() {
        // spec pulse-physics §4.12 (f)
        let table = [
            (5.0, 1e-3, 0.404133, Some(1)),
            (5.0, 1e-2, 0.891792, Some(2)),
            (5.0, 0.1, 1.291195, Some(5)),
            (5.0, 1.0, 1.299846, Some(6)),
            (5.0, 1e3, 1.308551, Some(14)),
            (4.0, 1e-3, 0.405113, None),
            (4.0, 1.0, 1.051232, None),
            (4.0, 1e3, 1.054668, None),
        ];
        for (length, intensity, expected, count) in table {
            let (ns, iterations) = fitted(length, &[(100.0, intensity)], if length == 5.0 { 6 } else { 5 });
            assert!((ns - expected).abs() < 1e-6, "τp {length}, I {intensity}: {ns} is not {expected}");
            if let Some(count) = count {
                assert_eq!(iterations, count, "τp {length}, I {intensity}");
            }
        }
    }

    #[test]
    fn a_second_echo_has_the_absurd_width_of_the_reference() {
        // spec pulse-physics §4.12 (e)
        let returns = [(50.0, 2.0), (50.1, 1.0), (53.0, 0.5)];
        let (first, _) = fitted(4.0, &returns, 5);
        assert!((first - 1.135613).abs() < 1e-6, "{first}");
        let (second, iterations) = fitted(4.0, &returns, 45);
        assert!((second - 11.823276).abs() < 1e-3, "{second}");
        assert!((4000..6000).contains(&iterations), "{iterations}");
        let waveform = received(&returns, &tls_detector(4.0));
        let local = width(&waveform, 45, waveform.at(45), Some(16)) * 0.25;
        assert!((0.9..1.2).contains(&local), "a fit near the peak gives {local}");
    }

    #[test]
    fn a_fit_without_numbers_ends_at_once_and_stays_nan() {
        let waveform = received(&[(100.0, f64::NAN)], &tls_detector(5.0));
        let ([.., p3], iterations) = marquardt(&waveform, (0, waveform.bins), [0.0, f64::NAN, 6.0, 1.0]);
        assert!(p3.is_nan() && iterations == 1);
    }

    #[test]
    fn empty_bins_count_alike_whether_stored_or_not() {
        let gaussian = Gaussian::new(&[0.3, 2.0, 5.0, 1.5]);
        let (mut by_one, mut at_once) = (NormalEquations::default(), NormalEquations::default());
        by_one.add_run(0, 1000, |_| 0.0, &gaussian);
        at_once.add_empty(0, 1000, &gaussian);
        assert!((by_one.error - at_once.error).abs() < 1e-9);
        assert_eq!(by_one.normal, at_once.normal);
    }

    #[test]
    fn the_recurrence_reproduces_the_gaussian() {
        for (centre, width) in [(40.3, 5.0), (-3.0, 20.0), (90.0, 0.7), (33.5, 1e9), (200.0, 90.0)] {
            let gaussian = Gaussian::new(&[0.0, 1.0, centre, width]);
            let mut followed = NormalEquations::default();
            followed.add_run(0, 80, |_| 0.0, &gaussian);
            let sum: f64 = (0..80).map(|i| gaussian.at(i)).sum();
            assert!((followed.normal[1][0] - sum).abs() <= 1e-11 * sum, "{centre} {width}");
        }
    }
}
