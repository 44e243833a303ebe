//! A quantity of both clouds: figures of its distribution, and differences due to chance.

use super::chance::{Halves, SPLITS};
use super::histogram::Histogram;
use super::statistic::{Statistic, largest_distance};
use rayon::prelude::*;
use serde::Serialize;

/// Ratio of errors of values between two neighbours to those of values at one of them: variances of 1 + 2/3
/// and 1 + 1/2, where neighbours are interpolated at any and at the middle place, and a little more for
/// rounding.
const ERROR_RATIO: f64 = 1.06;

/// Maximum number of values of each cloud that count. The fraction of the values below one is that of so many
/// within 0.07 %, two standard deviations by chance where half as many remain.
pub(super) const MAX_VALUES: usize = 1 << 22;

/// At most `most` of some values, evenly chosen: all, every second, every fourth, and so on.
pub(super) fn evenly<T>(values: impl IntoIterator<Item = T>, most: usize) -> Vec<T> {
    let (mut kept, mut step) = (Vec::new(), 1_usize);
    for (number, value) in values.into_iter().enumerate() {
        if number & (step - 1) != 0 {
            continue;
        }
        if kept.len() >= most.max(1) {
            let mut place = 0_usize;
            kept.retain(|_| {
                place += 1;
                place & 1 == 1
            });
            step *= 2;
            if number & (step - 1) != 0 {
                continue;
            }
        }
        kept.push(value);
    }
    kept
}

/// A number of both clouds.
#[derive(Clone, Debug, Serialize)]
pub struct Figure {
    /// Its name within its quantity.
    pub name: String,
    /// Its unit; empty for plain numbers.
    pub unit: &'static str,
    /// Of the first cloud.
    pub first: f64,
    /// Of the second cloud.
    pub second: f64,
    /// Second minus first.
    pub difference: f64,
    /// The largest difference between random halves of the first cloud; at least what the values resolve.
    pub chance: Option<f64>,
    /// True if the difference is within that bound.
    pub is_within_chance: Option<bool>,
}

/// The largest distance of the cumulative distributions of both clouds (Kolmogorov and Smirnov).
#[derive(Clone, Debug, Serialize)]
pub struct DistributionDistance {
    /// 0 for equal distributions, 1 for such without a common value.
    pub largest: f64,
    /// The largest one between random halves of the first cloud.
    pub chance: Option<f64>,
    /// True if the distance is within that bound.
    pub is_within_chance: Option<bool>,
}

/// A quantity that points, pulses, scan lines or cells of both clouds have.
#[derive(Clone, Debug, Serialize)]
pub struct Quantity {
    /// The subject it belongs to.
    pub group: &'static str,
    /// Its name.
    pub name: String,
    /// Unit of its values.
    pub unit: &'static str,
    /// Unit of observation with one value: point, pulse, scan line, cell.
    pub per: &'static str,
    /// Meaning, in a sentence.
    pub meaning: String,
    /// Number of values of each cloud that count: at most about four million, evenly chosen.
    pub counts: [usize; 2],
    /// Figures of its distribution.
    pub figures: Vec<Figure>,
    /// The distance of both distributions.
    pub distribution: DistributionDistance,
    /// Both distributions.
    pub histogram: Histogram,
}

/// Definition of a quantity, before it is measured.
pub(super) struct Definition {
    pub group: &'static str,
    pub name: String,
    pub unit: &'static str,
    pub per: &'static str,
    pub meaning: String,
    /// True if values are whole numbers.
    pub is_whole: bool,
    /// If values are differences from the first cloud: the errors of its own values, with their blocks.
    /// Values are within chance if they are not larger.
    pub errors: Option<Vec<(f64, u32)>>,
    pub statistics: Vec<Statistic>,
}

impl Definition {
    /// The quantity of values of the first cloud with their blocks, and of values of the second, at most
    /// [`MAX_VALUES`] of each; `None` if either has none.
    pub fn measure(
        mut self,
        first: impl IntoIterator<Item = (f64, u32)>,
        second: Vec<f64>,
        halves: Option<&Halves>,
    ) -> Option<Quantity> {
        let mut errors = self.errors.take();
        let Some(halves) = halves else {
            let errors = errors.map(|errors| {
                let mut errors: Vec<f64> = errors.into_iter().map(|(value, _)| value).collect();
                errors.par_sort_unstable_by(f64::total_cmp);
                errors
            });
            // Without blocks, which would take as much memory as the values.
            let first = first.into_iter().map(|(value, _)| value).collect();
            return self.compare(first, second, errors, None);
        };
        let mut first: Vec<(f64, u32)> = first.into_iter().collect();
        for values in [Some(&mut first), errors.as_mut()].into_iter().flatten() {
            values.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        }
        let of_split = |split: usize| halves.of_values(split, errors.as_ref().unwrap_or(&first));
        let values = |of: &Vec<(f64, u32)>| of.iter().map(|(value, _)| *value).collect::<Vec<f64>>();
        self.compare(values(&first), second, errors.as_ref().map(values), Some(&of_split))
    }

    /// The quantity of values of both clouds, where `errors` are ascending errors of the first cloud's
    /// values, and `of_split` are values of the halves in a split; `None` if either cloud has none.
    pub fn compare(
        self,
        mut first: Vec<f64>,
        mut second: Vec<f64>,
        errors: Option<Vec<f64>>,
        of_split: Option<&(dyn Fn(usize) -> [Vec<f64>; 2] + Sync)>,
    ) -> Option<Quantity> {
        if first.is_empty() || second.is_empty() {
            return None;
        }
        [&mut first, &mut second].into_iter().for_each(|values| values.par_sort_unstable_by(f64::total_cmp));
        let mut bounds = of_split.and_then(|of| self.bounds(of));
        let errors = errors.filter(|errors| !errors.is_empty());
        for (bound, statistic) in bounds.iter_mut().flatten().zip(&self.statistics) {
            *bound = bound.max(statistic.resolution(errors.as_ref().unwrap_or(&first)));
            if let Some(errors) = &errors {
                *bound += ERROR_RATIO * statistic.of(errors).abs();
            }
        }
        let chance = |i: usize| bounds.as_ref().map(|bounds| bounds[i]);
        // A bound of 0 is that of steps of the recording; a difference by rounding alone does not exceed it.
        let is_within = |difference: f64, size: f64, i: usize| {
            chance(i).map(|bound| difference.abs() <= bound + 1e-9 * size.abs())
        };
        let figure = |(i, statistic): (usize, &Statistic)| {
            let [a, b] = [&first, &second].map(|values| statistic.of(values));
            Figure {
                name: statistic.name(self.is_whole),
                unit: statistic.unit(self.unit),
                first: a,
                second: b,
                difference: b - a,
                chance: chance(i),
                is_within_chance: is_within(b - a, a, i),
            }
        };
        let figures: Vec<Figure> = self.statistics.iter().enumerate().map(figure).collect();
        let largest = largest_distance(&first, &second);
        let last = figures.len();
        Some(Quantity {
            group: self.group,
            name: self.name,
            unit: self.unit,
            per: self.per,
            meaning: self.meaning,
            counts: [first.len(), second.len()],
            figures,
            distribution: DistributionDistance {
                largest,
                chance: chance(last),
                is_within_chance: is_within(largest, 1.0, last).filter(|_| errors.is_none()),
            },
            histogram: Histogram::of([&first, &second], self.is_whole),
        })
    }

    /// The largest difference between halves of each statistic, and the largest distance of their
    /// distributions; `None` if a half is empty.
    fn bounds(&self, of_split: &(dyn Fn(usize) -> [Vec<f64>; 2] + Sync)) -> Option<Vec<f64>> {
        let differences = |split: usize| {
            let [mut a, mut b] = of_split(split);
            if a.is_empty() || b.is_empty() {
                return None;
            }
            [&mut a, &mut b].into_iter().for_each(|values| {
                if !values.is_sorted() {
                    values.sort_unstable_by(f64::total_cmp);
                }
            });
            let of_statistic = |statistic: &Statistic| (statistic.of(&b) - statistic.of(&a)).abs();
            let mut all: Vec<f64> = self.statistics.iter().map(of_statistic).collect();
            all.push(largest_distance(&a, &b));
            Some(all)
        };
        let all: Option<Vec<Vec<f64>>> = (0..SPLITS as usize).into_par_iter().map(differences).collect();
        all?.into_iter().reduce(|a, b| a.iter().zip(b).map(|(a, b)| a.max(b)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::rng::{Purpose, Stream};

    fn definition(statistics: Vec<Statistic>) -> Definition {
        let (name, meaning) = ("height".to_owned(), String::new());
        Definition {
            group: "Heights",
            name,
            unit: "m",
            per: "point",
            meaning,
            is_whole: false,
            errors: None,
            statistics,
        }
    }

    /// 200 blocks of 50 values that share an error of their block.
    fn blocks(seed: u64, shift: f64, common: f64) -> Vec<(f64, u32)> {
        let stream = Stream::new(seed, Purpose::SceneMaking);
        let value = |i: u32| {
            let of_block = stream.normal(1, u64::from(i / 50), 0);
            let own = stream.normal(2, u64::from(i), 0);
            (shift + common * of_block + own, i / 50)
        };
        (0..10_000).map(value).collect()
    }

    fn values(blocks: &[(f64, u32)]) -> Vec<f64> {
        blocks.iter().map(|(value, _)| *value).collect()
    }

    #[test]
    fn what_is_alike_lies_within_chance_and_what_is_not_beyond() {
        let halves = Halves::new(200);
        let statistics = || vec![Statistic::Mean, Statistic::Quantile(0.5), Statistic::Spread];
        let measure = |second: &[(f64, u32)]| {
            definition(statistics()).measure(blocks(1, 0.0, 0.0), values(second), Some(&halves)).unwrap()
        };
        let alike = measure(&blocks(2, 0.0, 0.0));
        assert!(alike.figures.iter().all(|figure| figure.is_within_chance == Some(true)), "{alike:?}");
        assert_eq!(alike.distribution.is_within_chance, Some(true));
        // The mean of 5000 values differs from that of 5000 others by 0.02; the largest of 39 is two to three
        // times that.
        let bound = alike.figures[0].chance.unwrap();
        assert!((0.03..0.08).contains(&bound), "{bound}");
        let shifted = measure(&blocks(2, 0.2, 0.0));
        assert_eq!(shifted.figures[0].is_within_chance, Some(false), "{shifted:?}");
        assert_eq!(shifted.distribution.is_within_chance, Some(false));
    }

    #[test]
    fn errors_that_blocks_share_widen_the_bound() {
        let halves = Halves::new(200);
        let bound = |common: f64| {
            let first = blocks(1, 0.0, common);
            let second = values(&blocks(2, 0.0, common));
            let quantity = definition(vec![Statistic::Mean]).measure(first, second, Some(&halves)).unwrap();
            assert_eq!(quantity.figures[0].is_within_chance, Some(true), "{quantity:?}");
            quantity.figures[0].chance.unwrap()
        };
        // The mean of 100 blocks varies by 0.1, that of 5000 independent values by 0.014.
        assert!(bound(1.0) > 4.0 * bound(0.0), "{} {}", bound(1.0), bound(0.0));
    }

    #[test]
    fn many_values_are_thinned_evenly_and_few_are_all_kept() {
        assert_eq!(evenly(0..10, 10), (0..10).collect::<Vec<_>>());
        assert_eq!(evenly(0..11, 10), [0, 2, 4, 6, 8, 10]);
        assert_eq!(evenly(0..21, 10), [0, 4, 8, 12, 16, 20]);
        assert_eq!(evenly(0..1000, 1), [0]);
        let kept = evenly(0..100_000, 1000);
        assert!((500..=1000).contains(&kept.len()) && kept.windows(2).all(|pair| pair[1] - pair[0] == 128));
        assert!(evenly(0..0, 10).is_empty());
    }

    #[test]
    fn a_quantity_that_a_cloud_lacks_is_none() {
        assert!(definition(vec![Statistic::Mean]).measure(Vec::new(), vec![1.0], None).is_none());
    }
}
