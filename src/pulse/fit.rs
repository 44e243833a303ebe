//! Echo widths by fitting a Gaussian (spec pulse-physics §4.5).

use super::waveform::Waveform;
use libm::exp;

/// Most iterations of a fit.
const MOST_ITERATIONS: u32 = 10_000;
/// A step that gains less than this ends the fit.
const LEAST_GAIN: f64 = 1e-4;
/// Largest distance of a fitted bin from the peak; 5 km of 0.25 ns bins on either side.
const REACH: u64 = 1 << 16;
/// e^(−x) is exactly zero from here on.
const UNDERFLOW: f64 = 746.0;

/// Half width at 1/e, in bins, of the Gaussian on a pedestal that fits `waveform` around its peak of height `top` in bin
/// `peak`. Bins up to `reach` away take part, or all of them. May come out negative, absurd or NaN.
pub(super) fn width(waveform: &Waveform, peak: u64, top: f64, reach: Option<u64>) -> f64 {
    let reach = reach.unwrap_or(REACH).min(REACH);
    let window = (peak.saturating_sub(reach), peak.saturating_add(reach + 1).min(waveform.bins));
    marquardt(waveform, window, [0.0, top, peak as f64, 1.0]).0
}

/// Fits and says how many iterations that took.
fn marquardt(waveform: &Waveform, window: (u64, u64), start: [f64; 4]) -> (f64, u32) {
    let mut at = start;
    let mut sums = Sums::over(waveform, window, &at);
    let mut mu = 0.01;
    for iteration in 1..=MOST_ITERATIONS {
        let Some(step) = sums.step(mu) else { return (at[3], iteration) };
        let tried = std::array::from_fn(|k| at[k] + step[k]);
        let there = Sums::over(waveform, window, &tried);
        let gain = sums.error - there.error;
        if gain < 0.0 {
            mu *= 10.0;
            continue;
        }
        (at, sums) = (tried, there);
        // NaN begets NaN: nothing can change any more.
        if (0.0..LEAST_GAIN).contains(&gain) || at[3].is_nan() {
            return (at[3], iteration);
        }
    }
    (at[3], MOST_ITERATIONS)
}

/// What a step of the fit needs, summed over the bins.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// JᵀJ, lower triangle.
    normal: [[f64; 4]; 4],
    /// Jᵀr.
    gradient: [f64; 4],
    /// Σr².
    error: f64,
}

impl Sums {
    fn over(waveform: &Waveform, (from, to): (u64, u64), p: &[f64; 4]) -> Sums {
        let mut sums = Sums::default();
        let mut done = from;
        for (first, bins) in waveform.segments() {
            let (start, end) = (first.clamp(done, to), (first + bins.len() as u64).clamp(done, to));
            sums.add_dark(done, start, p);
            for i in start..end {
                sums.add(i as f64, bins[(i - first) as usize], p);
            }
            done = end.max(start);
        }
        sums.add_dark(done, to, p);
        sums
    }

    /// A bin `x` of height `f`.
    fn add(&mut self, x: f64, f: f64, p: &[f64; 4]) {
        let distance = x - p[2];
        let u = distance / p[3];
        let bell = exp(-(u * u));
        let slope = 2.0 * p[1] / (p[3] * p[3]) * distance * bell;
        self.accumulate([1.0, bell, slope, slope * u], f - (p[0] + p[1] * bell));
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

    /// Empty bins. Where the bell has vanished only the pedestal matters, and all such bins are alike.
    fn add_dark(&mut self, from: u64, to: u64, p: &[f64; 4]) {
        let foot = p[3].abs() * UNDERFLOW.sqrt();
        let near = |x: f64| if x.is_nan() { from } else { (x.max(0.0) as u64).clamp(from, to.max(from)) };
        let (start, end) =
            if foot.is_nan() { (from, from) } else { (near(p[2] - foot), near(p[2] + foot + 1.0)) };
        for i in start..end {
            self.add(i as f64, 0.0, p);
        }
        let alike = (to.saturating_sub(from) - (end - start)) as f64;
        if alike > 0.0 {
            self.normal[0][0] += alike;
            self.gradient[0] -= alike * p[0];
            self.error += alike * (p[0] * p[0]);
        }
    }

    /// The step of a damping `mu`: LU decomposition with partial pivoting. `None` when a pivot is exactly zero.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::testkit::{received, tls_instrument};

    fn fitted(pulse_length: f64, returns: &[(f64, f64)], peak: u64) -> (f64, u32) {
        let waveform = received(returns, &tls_instrument(pulse_length));
        let top = waveform.at(peak);
        let (p3, iterations) = marquardt(&waveform, (0, waveform.bins), [0.0, top, peak as f64, 1.0]);
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
    fn a_second_echo_gets_the_reference_s_absurd_width() {
        // spec pulse-physics §4.12 (e)
        let returns = [(50.0, 2.0), (50.1, 1.0), (53.0, 0.5)];
        let (first, _) = fitted(4.0, &returns, 5);
        assert!((first - 1.135613).abs() < 1e-6, "{first}");
        let (second, iterations) = fitted(4.0, &returns, 45);
        assert!((second - 11.823276).abs() < 1e-3, "{second}");
        assert!((4000..6000).contains(&iterations), "{iterations}");
        let waveform = received(&returns, &tls_instrument(4.0));
        let local = width(&waveform, 45, waveform.at(45), Some(16)) * 0.25;
        assert!((0.9..1.2).contains(&local), "a fit near the peak gives {local}");
    }

    #[test]
    fn a_fit_without_numbers_ends_at_once_and_stays_nan() {
        let waveform = received(&[(100.0, f64::NAN)], &tls_instrument(5.0));
        let (p3, iterations) = marquardt(&waveform, (0, waveform.bins), [0.0, f64::NAN, 6.0, 1.0]);
        assert!(p3.is_nan() && iterations == 1);
    }

    #[test]
    fn empty_bins_count_alike_whether_stored_or_not() {
        let p = [0.3, 2.0, 5.0, 1.5];
        let mut by_one = Sums::default();
        for i in 0..1000 {
            by_one.add(f64::from(i), 0.0, &p);
        }
        let mut at_once = Sums::default();
        at_once.add_dark(0, 1000, &p);
        assert!((by_one.error - at_once.error).abs() < 1e-9);
        assert_eq!(by_one.normal, at_once.normal);
    }
}
