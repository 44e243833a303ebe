//! Patterns that repeat: intervals that recur after some pulses (dither), rates that recur after some lines.

use std::collections::BTreeMap;

/// Maximum length of a pattern of intervals, pulses.
const MAX_PULSES: usize = 64;
/// Maximum length of a pattern of lines.
const MAX_LINES: usize = 200;
/// Minimum number of pairs of intervals.
const MIN_PAIRS: f64 = 1000.0;
/// Minimum share of the variance of intervals that a pattern explains, and minimum negative covariance within
/// the pattern, as a share of that at its length.
const MIN_EXPLAINED: f64 = 0.25;
const MIN_REVERSAL: f64 = 0.3;
/// The shortest pattern is used that explains at least this share of what the best pattern explains.
const AS_GOOD: f64 = 0.85;
/// Maximum squared residual of a pattern of lines, as a share of that of their mean or their neighbours.
const MAX_LEFT: f64 = 0.6;
const ROUNDS: usize = 4;

/// Passes runs of intervals between neighbouring pulses of a line, `None` where a pulse is missing, to a
/// function: the same runs in each call.
pub type Runs<'r> = dyn Fn(&mut dyn FnMut(&[Option<f64>])) + 'r;

/// Relative deviations of intervals from their mean that recur after some pulses, as factors with the mean 1;
/// empty if they do not recur.
///
/// The place in the pattern at which a run begins is not known beforehand.
pub fn interval_pattern(each_run: &Runs) -> Vec<f64> {
    let Covariances { of_lag, longest_run } = Covariances::of(each_run);
    let largest = of_lag[2..].iter().filter(|lag| lag.1 >= MIN_PAIRS).map(|lag| lag.0).fold(0.0, f64::max);
    let smallest_before = |lag: usize| of_lag[1..lag].iter().map(|lag| lag.0).fold(f64::INFINITY, f64::min);
    let is_period = |lag: &usize| {
        of_lag[*lag].1 >= MIN_PAIRS
            && of_lag[*lag].0 >= AS_GOOD * largest
            && smallest_before(*lag) < -MIN_REVERSAL * largest
    };
    if largest <= MIN_EXPLAINED * of_lag[0].0 {
        return Vec::new();
    }
    let Some(period) = (2..=MAX_PULSES).find(is_period) else { return Vec::new() };
    // Sums and counts by place in the pattern; short runs have fewer places.
    let mut lines: Vec<Vec<(f64, f64)>> = Vec::new();
    each_run(&mut |values| {
        let mut sums = vec![(0.0, 0.0); period.min(values.len())];
        for (k, value) in values.iter().enumerate() {
            if let Some(value) = value {
                sums[k % period].0 += value;
                sums[k % period].1 += 1.0;
            }
        }
        lines.push(sums);
    });
    let at = |line: &[(f64, f64)], k: usize| line.get(k % period).copied().unwrap_or((0.0, 0.0));
    let means = |line: &[(f64, f64)]| -> Vec<f64> {
        (0..period).map(|k| at(line, k)).map(|(sum, n)| sum / f64::max(n, 1.0)).collect()
    };
    let Some(longest) = lines.get(longest_run) else { return Vec::new() };
    let mut pattern = means(longest);
    for _ in 0..ROUNDS {
        let mut sums = vec![(0.0, 0.0); period];
        for line in &lines {
            let agreement =
                |shift: usize| (0..period).map(|k| at(line, k + shift).0 * pattern[k]).sum::<f64>();
            let shift = (0..period).max_by(|a, b| agreement(*a).total_cmp(&agreement(*b))).unwrap_or(0);
            for (k, sum) in sums.iter_mut().enumerate() {
                let (value, count) = at(line, k + shift);
                *sum = (sum.0 + value, sum.1 + count);
            }
        }
        pattern = means(&sums);
    }
    let mean = pattern.iter().sum::<f64>() / period as f64;
    pattern.iter().map(|deviation| 1.0 + deviation - mean).collect()
}

/// Covariances of intervals with those some pulses later.
struct Covariances {
    /// Covariance and number of pairs by the number of pulses.
    of_lag: Vec<(f64, f64)>,
    /// Number of the longest run, the last one of several.
    longest_run: usize,
}

impl Covariances {
    fn of(each_run: &Runs) -> Covariances {
        let mut of_lag = vec![(0.0, 0.0); MAX_PULSES + 1];
        let (mut runs, mut longest, mut longest_run) = (0, 0, 0);
        each_run(&mut |values| {
            for (lag, (sum, count)) in of_lag.iter_mut().enumerate() {
                for (a, b) in values.iter().zip(values.iter().skip(lag)) {
                    if let (Some(a), Some(b)) = (a, b) {
                        (*sum, *count) = (*sum + a * b, *count + 1.0);
                    }
                }
            }
            if values.len() >= longest {
                (longest, longest_run) = (values.len(), runs);
            }
            runs += 1;
        });
        of_lag.iter_mut().for_each(|(sum, count)| *sum /= f64::max(*count, 1.0));
        Covariances { of_lag, longest_run }
    }
}

/// Values of lines by their place in a pattern that repeats after some lines.
#[derive(Clone, Debug)]
pub struct LinePattern {
    /// Lines after which it repeats.
    pub period: usize,
    /// Mean value of the lines at each place; `None` where none was recorded.
    pub values: Vec<Option<f64>>,
}

impl LinePattern {
    /// The pattern of the values of lines by their number, if it predicts the values of lines that are left
    /// out better than their mean and their neighbours do.
    pub fn of(lines: &BTreeMap<i64, f64>) -> Option<LinePattern> {
        let (first, last) = (*lines.first_key_value()?.0, *lines.last_key_value()?.0);
        let longest = MAX_LINES.min((last - first) as usize / 4).min(lines.len() / 3);
        let mean = lines.values().sum::<f64>() / lines.len() as f64;
        let trials: Vec<(usize, f64)> = (2..=longest)
            .filter_map(|period| {
                let folded = fold(lines, period);
                let (mut left, mut count) = (0.0, 0usize);
                for (number, value) in lines {
                    let (sum, of_class) = folded[number.rem_euclid(period as i64) as usize];
                    if of_class >= 2.0 {
                        left += (value - (sum - value) / (of_class - 1.0)).powi(2);
                        count += 1;
                    }
                }
                (count * 2 > lines.len()).then(|| (period, left / count as f64))
            })
            .collect();
        let least = trials.iter().map(|trial| trial.1).fold(f64::INFINITY, f64::min);
        // Of a period and its multiples the shortest.
        let (period, left) = trials.into_iter().find(|trial| trial.1 * AS_GOOD <= least)?;
        let by_mean = lines.values().map(|value| (value - mean).powi(2)).sum::<f64>() / lines.len() as f64;
        let pairs = lines.values().zip(lines.values().skip(1));
        let by_neighbour = pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>() / lines.len() as f64;
        let folded = fold(lines, period);
        (left < MAX_LEFT * by_mean.min(by_neighbour)).then(|| LinePattern {
            period,
            values: folded.iter().map(|(sum, count)| (*count > 0.0).then(|| sum / count)).collect(),
        })
    }

    /// The value of a line by its number.
    pub fn value(&self, number: i64) -> Option<f64> {
        self.values[number.rem_euclid(self.period as i64) as usize]
    }
}

/// Sums and counts of values by their place in a pattern.
fn fold(lines: &BTreeMap<i64, f64>, period: usize) -> Vec<(f64, f64)> {
    let mut sums = vec![(0.0, 0.0); period];
    for (number, value) in lines {
        let sum = &mut sums[number.rem_euclid(period as i64) as usize];
        *sum = (sum.0 + value, sum.1 + 1.0);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviations_that_recur_are_found_in_runs_of_any_length() {
        let factors = [0.05, 0.02, -0.03, -0.06, -0.02, 0.01, 0.03];
        let deviation = |k: usize| (k % 50 != 9).then(|| factors[k % 7]);
        let all: Vec<Option<f64>> = (0..6000).map(deviation).collect();
        for length in [6000, 400, 20, 5] {
            let each_run = |visit: &mut dyn FnMut(&[Option<f64>])| all.chunks(length).for_each(visit);
            let found = interval_pattern(&each_run);
            if length == 5 {
                assert!(found.is_empty(), "{found:?}");
                continue;
            }
            let differs = |shift: usize| {
                let pairs = found.iter().enumerate();
                pairs.map(|(k, factor)| (factor - 1.0 - factors[(k + shift) % 7]).abs()).fold(0.0, f64::max)
            };
            let difference = (0..7).map(differs).fold(f64::INFINITY, f64::min);
            assert!(found.len() == 7 && difference < 1e-9, "{length}: {found:?}");
        }
        assert!(interval_pattern(&|_| ()).is_empty());
    }
}
