//! Statistics of values, and the distance of two distributions.

/// A statistic of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Statistic {
    /// Arithmetic mean.
    Mean,
    /// The value below which this fraction lies.
    Quantile(f64),
    /// Half the distance of the quantiles at 15.87 and 84.13 %: the standard deviation of a normal
    /// distribution, which a few outliers do not change.
    Spread,
    /// Percentage of the values from the first number to below the second.
    Share(f64, f64),
    /// This number over the mean.
    Frequency(f64),
}

impl Statistic {
    /// Of ascending values, of which there is at least one.
    pub fn of(self, sorted: &[f64]) -> f64 {
        let mean = || sorted.iter().sum::<f64>() / sorted.len() as f64;
        match self {
            Statistic::Mean => mean(),
            Statistic::Quantile(fraction) => quantile(sorted, fraction),
            Statistic::Spread => 0.5 * (quantile(sorted, 0.8413) - quantile(sorted, 0.1587)),
            Statistic::Share(from, to) => {
                let below = |limit: f64| sorted.partition_point(|value| *value < limit);
                100.0 * (below(to) - below(from)) as f64 / sorted.len() as f64
            }
            Statistic::Frequency(per) => per / mean(),
        }
    }

    /// Resolution of ascending values: of a quantile the step of the values there; of a share the number of
    /// values that are not met once with a probability of 1 in 40 (ln 40, by Poisson's law); 0 of other
    /// statistics.
    pub fn resolution(self, sorted: &[f64]) -> f64 {
        let fraction = match self {
            Statistic::Quantile(fraction) => fraction,
            Statistic::Share(..) => return 100.0 * 3.689 / sorted.len() as f64,
            _ => return 0.0,
        };
        let value = quantile(sorted, fraction);
        // Equal values differ by rounding.
        let alike = 1e-6 * (sorted[sorted.len() - 1] - sorted[0]);
        let below = sorted[..sorted.partition_point(|v| *v < value - alike)].last();
        let above = sorted.get(sorted.partition_point(|v| *v <= value + alike));
        let steps = [below.map(|v| value - v), above.map(|v| v - value)].into_iter().flatten();
        steps.min_by(f64::total_cmp).unwrap_or(0.0)
    }

    /// Its name, of a quantity whose values are whole numbers or not.
    pub fn name(self, is_whole: bool) -> String {
        match self {
            Statistic::Mean => "mean".to_owned(),
            Statistic::Quantile(0.5) => "median".to_owned(),
            Statistic::Quantile(fraction) => format!("{} %", 100.0 * fraction),
            Statistic::Spread => "robust spread".to_owned(),
            Statistic::Share(from, to) if is_whole && to == from + 1.0 => format!("share of {from}"),
            Statistic::Share(from, to) if is_whole && to.is_infinite() => format!("share of {from} and more"),
            Statistic::Share(from, to) if from.is_infinite() => format!("share below {to}"),
            Statistic::Share(from, to) if to.is_infinite() => format!("share above {from}"),
            Statistic::Share(from, to) => format!("share from {from} to {to}"),
            Statistic::Frequency(_) => "rate".to_owned(),
        }
    }

    /// Its unit, of values in `unit`.
    pub fn unit(self, unit: &'static str) -> &'static str {
        match self {
            Statistic::Share(..) => "%",
            Statistic::Frequency(_) => "1/s",
            _ => unit,
        }
    }
}

/// The value below which a fraction of ascending values lies, between two of them by linear interpolation.
pub(super) fn quantile(sorted: &[f64], fraction: f64) -> f64 {
    let place = fraction * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
    low + place.fract() * (high - low)
}

/// The largest distance of the cumulative distributions of ascending values (Kolmogorov and Smirnov), 0 to 1.
/// Neither is empty.
pub(super) fn largest_distance(a: &[f64], b: &[f64]) -> f64 {
    let (mut i, mut j, mut largest) = (0, 0, 0.0_f64);
    while i < a.len() && j < b.len() {
        let value = a[i].min(b[j]);
        // All equal values are one step.
        i += a[i..].iter().take_while(|v| **v == value).count();
        j += b[j..].iter().take_while(|v| **v == value).count();
        largest = largest.max((i as f64 / a.len() as f64 - j as f64 / b.len() as f64).abs());
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_are_those_of_the_textbook() {
        let values: Vec<f64> = (0..=100).map(f64::from).collect();
        assert_eq!(Statistic::Mean.of(&values), 50.0);
        assert_eq!(Statistic::Quantile(0.25).of(&values), 25.0);
        assert!((Statistic::Spread.of(&values) - 34.13).abs() < 1e-9);
        assert!((Statistic::Share(10.0, 20.0).of(&values) - 1000.0 / 101.0).abs() < 1e-9);
        assert_eq!(Statistic::Frequency(1e3).of(&[4.0, 6.0]), 200.0);
        assert_eq!(quantile(&[1.0, 2.0], 0.25), 1.25);
        let resolution = |statistic: Statistic, values: &[f64]| statistic.resolution(values);
        assert_eq!(resolution(Statistic::Quantile(0.5), &[1.0, 3.0, 3.0, 3.0, 7.0]), 2.0);
        assert_eq!(resolution(Statistic::Quantile(0.5), &[1.0; 4]), 0.0);
        assert_eq!(resolution(Statistic::Mean, &[1.0, 2.0]), 0.0);
        assert!((resolution(Statistic::Share(1.0, 2.0), &values) - 368.9 / 101.0).abs() < 1e-9);
        assert_eq!(Statistic::Share(3.0, 4.0).name(true), "share of 3");
    }

    #[test]
    fn the_largest_distance_counts_ties_once() {
        assert_eq!(largest_distance(&[1.0, 1.0, 2.0], &[1.0, 1.0, 2.0]), 0.0);
        assert_eq!(largest_distance(&[1.0, 2.0], &[3.0, 4.0]), 1.0);
        // Below 1.5 lie three quarters of the first and a quarter of the second.
        assert_eq!(largest_distance(&[1.0, 1.0, 1.0, 2.0], &[1.0, 2.0, 2.0, 2.0]), 0.5);
        // Uniform on 0 to 1 and on 0.1 to 1.1: 0.1.
        let uniform = |shift: f64| (0..1000).map(|i| f64::from(i) / 1000.0 + shift).collect::<Vec<f64>>();
        assert!((largest_distance(&uniform(0.0), &uniform(0.1)) - 0.1).abs() < 2e-3);
    }
}
