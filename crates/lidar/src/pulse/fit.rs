//! Echo widths by fitting a Gaussian (spec pulse-physics §4.5).

use super::waveform::Waveform;
use libm::exp;
use vlscan_geom::solve_by_elimination;

/// Maximum number of iterations of the reference's fit.
const MAX_ITERATIONS: u32 = 10_000;
/// Reduction of the squared error, nW², below which a step ends the reference's fit.
const MIN_GAIN: f64 = 1e-4;
/// Maximum number of iterations of a local fit.
const MAX_LOCAL_ITERATIONS: u32 = 100;
/// Relative change of height and width, and change of the centre by widths, below which a step ends a local
/// fit.
const MIN_STEP: f64 = 1e-5;
/// Damping above which no step of a local fit lessens the error.
const MAX_DAMPING: f64 = 1e12;
/// Largest distance of a fitted bin from the peak: 5 km of 0.25 ns bins on either side.
const MAX_REACH: u64 = 1 << 16;
/// e^(−x) is exactly zero from here on.
const UNDERFLOW: f64 = 746.0;

/// Width of the Gaussian that the reference fits to all bins within [`MAX_REACH`] of a peak of height `top`
/// in bin `peak`: half width at 1/e, in bins. May be negative, absurd or NaN.
pub(super) fn width(waveform: &Waveform, peak: u64, top: f64) -> f64 {
    reference_fit(waveform, window_around(waveform, peak, MAX_REACH), [0.0, top, peak as f64, 1.0]).0[3]
}

/// Width of the Gaussian that fits the bins at most `reach` bins from a peak: half width at 1/e, in bins.
pub(super) fn local_width(waveform: &Waveform, peak: u64, reach: u64) -> f64 {
    fit_gaussian(waveform, peak, reach)[3]
}

/// The Gaussian on a pedestal that fits the bins at most `reach` bins from a peak in the sense of least
/// squares: pedestal, height above it, centre and half width at 1/e, in bins; NaN where the samples do not
/// resemble one.
pub(super) fn fit_gaussian(waveform: &Waveform, peak: u64, reach: u64) -> [f64; 4] {
    let window = window_around(waveform, peak, reach.min(MAX_REACH));
    let start = [0.0, waveform.at(peak), peak as f64, width_at_peak(waveform, peak, window)];
    let [pedestal, height, centre, width] = levenberg_marquardt(waveform, window, start).0;
    [pedestal, height, centre, width.abs()]
}

fn window_around(waveform: &Waveform, peak: u64, reach: u64) -> (u64, u64) {
    (peak.saturating_sub(reach), peak.saturating_add(reach + 1).min(waveform.bins))
}

/// Distance of a peak from the nearer bin on either side in which 1/e of its height is left.
fn width_at_peak(waveform: &Waveform, peak: u64, (from, to): (u64, u64)) -> f64 {
    let level = waveform.at(peak) * exp(-1.0);
    let is_inside = |bin: u64| bin >= from && bin < to && waveform.at(bin) > level;
    let above =
        (1..=to - from).take_while(|k| is_inside(peak + k) && peak.checked_sub(*k).is_some_and(is_inside));
    above.count() as f64 + 0.5
}

/// The fit of the reference: its damping never falls, and it ends where the squared error, in nW², hardly
/// does. Returns the number of iterations, too.
fn reference_fit(waveform: &Waveform, window: (u64, u64), start: [f64; 4]) -> ([f64; 4], u32) {
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

/// The fit by Levenberg's and Marquardt's method (Marquardt 1963, "An algorithm for least-squares estimation
/// of nonlinear parameters"), and its number of iterations. It ends where a step changes the curve by less
/// than [`MIN_STEP`] of itself, for any height and noise.
fn levenberg_marquardt(waveform: &Waveform, window: (u64, u64), start: [f64; 4]) -> ([f64; 4], u32) {
    let mut at = start;
    let mut sums = NormalEquations::over(waveform, window, &at);
    let mut mu = 1e-3;
    for iteration in 1..=MAX_LOCAL_ITERATIONS {
        let Some(step) = sums.step(mu) else { return (at, iteration) };
        let tried: [f64; 4] = std::array::from_fn(|k| at[k] + step[k]);
        let there = NormalEquations::over(waveform, window, &tried);
        let [height, width] = [tried[1].abs(), tried[3].abs()];
        let is_small = step[0].abs().max(step[1].abs()) <= MIN_STEP * height
            && step[2].abs().max(step[3].abs()) <= MIN_STEP * width;
        if there.error <= sums.error {
            (at, sums) = (tried, there);
            mu *= 0.1;
        } else if mu > MAX_DAMPING || tried[3].is_nan() {
            return (at, iteration);
        } else {
            mu *= 10.0;
        }
        if is_small {
            return (at, iteration);
        }
    }
    (at, MAX_LOCAL_ITERATIONS)
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

    /// Adds bins `start` up to `end` with the heights `f`. The Gaussian is computed by recurrence from the
    /// bin nearest to its centre outwards in both directions, so that rounding errors do not grow.
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

    /// Step with damping `mu`. `None` if a pivot is exactly zero.
    fn step(&self, mu: f64) -> Option<[f64; 4]> {
        let damped: [[f64; 4]; 4] = std::array::from_fn(|a| {
            std::array::from_fn(|b| match a == b {
                true => self.normal[a][a] * (1.0 + mu),
                false => self.normal[a.max(b)][a.min(b)],
            })
        });
        solve_by_elimination(damped, self.gradient)
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
        let ([.., p3], iterations) =
            reference_fit(&waveform, (0, waveform.bins), [0.0, top, peak as f64, 1.0]);
        assert_eq!(p3.to_bits(), width(&waveform, peak, top).to_bits());
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
        let local = local_width(&waveform, 45, 16) * 0.25;
        assert!((0.9..1.2).contains(&local), "a fit near the peak gives {local}");
    }

    #[test]
    fn local_widths_are_the_same_at_any_amplitude() {
        // (t/τ)²·e^(−t/τ) of 4 ns, τ = 4/7 ns, in bins of 0.25 ns: least squares give 1.0548 ns.
        let of = |intensity: f64| {
            let waveform = received(&[(100.0, intensity)], &tls_detector(4.0));
            let window = window_around(&waveform, 5, 16);
            let start = [0.0, waveform.at(5), 5.0, width_at_peak(&waveform, 5, window)];
            let ([.., width], iterations) = levenberg_marquardt(&waveform, window, start);
            assert!(iterations < 20, "{intensity}: {iterations} iterations");
            assert_eq!(local_width(&waveform, 5, 16), width.abs());
            width.abs() * 0.25
        };
        let widths = [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e9].map(of);
        for width in widths {
            assert!((width / 1.054668 - 1.0).abs() < 1e-4, "{width}");
        }
    }

    #[test]
    fn noise_costs_a_fit_few_iterations() {
        // Gaussians of 4 bins with pseudorandom noise of a fifth of their height.
        let mut state = 1u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let mut sum = 0.0;
        for _ in 0..200 {
            let samples: Vec<f64> = (0..41)
                .map(|k| 500.0 * exp(-((f64::from(k) - 20.0) / 4.0).powi(2)) + 200.0 * noise())
                .collect();
            let waveform = Waveform::of_samples(&samples);
            let window = window_around(&waveform, 20, 16);
            let start = [0.0, samples[20], 20.0, width_at_peak(&waveform, 20, window)];
            let ([.., width], iterations) = levenberg_marquardt(&waveform, window, start);
            assert!(iterations <= MAX_LOCAL_ITERATIONS / 2, "{iterations} iterations");
            sum += width.abs();
        }
        assert!((sum / 200.0 / 4.0 - 1.0).abs() < 0.05, "{}", sum / 200.0);
    }

    #[test]
    fn a_fit_without_numbers_ends_at_once_and_stays_nan() {
        let waveform = received(&[(100.0, f64::NAN)], &tls_detector(5.0));
        let ([.., p3], iterations) = reference_fit(&waveform, (0, waveform.bins), [0.0, f64::NAN, 6.0, 1.0]);
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
