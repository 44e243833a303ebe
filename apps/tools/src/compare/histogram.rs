//! Histograms of both clouds with the same classes.

use super::statistic::quantile;
use crate::chart::label::round_below;
use serde::Serialize;

/// Numbers of classes that a histogram has at least and at most, if its values are not whole numbers.
const CLASSES: [f64; 2] = [12.0, 80.0];
/// Fractions at both ends that are left out at first, and increasingly while there would be too many classes.
const TAILS: [f64; 5] = [0.002, 0.005, 0.01, 0.025, 0.05];

/// A histogram of both clouds with the same classes.
#[derive(Clone, Debug, Serialize)]
pub struct Histogram {
    /// Lower end of the first class.
    pub from: f64,
    /// Upper end of the last class.
    pub to: f64,
    /// Fractions of the values of each cloud in classes of equal width.
    pub fractions: [Vec<f64>; 2],
    /// Fractions of each cloud's values below the first class.
    pub below: [f64; 2],
    /// Fractions of each cloud's values above the last class.
    pub above: [f64; 2],
    /// The common area of both histograms, 0 to 1, with what lies beyond the classes.
    pub overlap: f64,
}

impl Histogram {
    /// Of ascending values, none of them empty. The width of classes follows the rule of Freedman and
    /// Diaconis (1981), rounded down to 1, 2 or 5 × 10ⁿ; where a few values lie far off, the range is that of
    /// the others.
    pub(super) fn of(sorted: [&[f64]; 2], is_whole: bool) -> Histogram {
        let (from, width, count) = match is_whole {
            true => whole_classes(sorted),
            false => classes(sorted),
        };
        let to = from + width * count as f64;
        let fractions_of = |values: &[f64]| {
            let mut counts = vec![0.0; count];
            let (mut below, mut above) = (0.0, 0.0);
            let share = 1.0 / values.len() as f64;
            for value in values {
                match ((value - from) / width).floor() {
                    class if class < 0.0 => below += share,
                    class if class < count as f64 => counts[class as usize] += share,
                    _ => above += share,
                }
            }
            (counts, below, above)
        };
        let (of_first, of_second) = rayon::join(|| fractions_of(sorted[0]), || fractions_of(sorted[1]));
        let ((a, below_a, above_a), (b, below_b, above_b)) = (of_first, of_second);
        let common = a.iter().zip(&b).map(|(a, b)| a.min(*b)).sum::<f64>();
        let overlap = common + below_a.min(below_b) + above_a.min(above_b);
        Histogram {
            from,
            to,
            fractions: [a, b],
            below: [below_a, below_b],
            above: [above_a, above_b],
            overlap,
        }
    }
}

/// Classes about whole numbers: lower end, width and number.
fn whole_classes(sorted: [&[f64]; 2]) -> (f64, f64, usize) {
    let low = sorted[0][0].min(sorted[1][0]);
    let high = sorted.map(|values| quantile(values, 1.0 - TAILS[0] / 10.0)).into_iter().fold(low, f64::max);
    (low - 0.5, 1.0, ((high - low).ceil() + 1.0).min(256.0) as usize)
}

/// Lower end, width and number of classes.
fn classes(sorted: [&[f64]; 2]) -> (f64, f64, usize) {
    let range = |tail: f64| {
        let low = sorted.map(|values| quantile(values, tail)).into_iter().fold(f64::INFINITY, f64::min);
        let high = sorted.map(|v| quantile(v, 1.0 - tail)).into_iter().fold(f64::NEG_INFINITY, f64::max);
        (low, high)
    };
    let width_of = |values: &[f64]| {
        let quartiles = quantile(values, 0.75) - quantile(values, 0.25);
        2.0 * quartiles / libm::cbrt(values.len() as f64)
    };
    let ideal = sorted.map(width_of).into_iter().fold(0.0, f64::max);
    let is_fine = |tail: &f64| {
        let (low, high) = range(*tail);
        high - low <= 2.0 * CLASSES[1] * ideal
    };
    let (low, high) = range(TAILS.into_iter().find(is_fine).unwrap_or(TAILS[TAILS.len() - 1]));
    let extent = high - low;
    if extent <= 0.0 {
        // All values are equal.
        let width = round_below((1e-3 * low.abs()).max(1e-6));
        return ((low / width).floor() * width, width, 1);
    }
    let mut width = round_below(ideal.clamp(extent / CLASSES[1], extent / CLASSES[0]));
    while extent / width > CLASSES[1] {
        width *= 2.0;
    }
    // Classes of values in steps hold as many steps each, and begin between two of them.
    let step = sorted.map(|values| step_of(values, extent)).into_iter().flatten().reduce(f64::min);
    let begin = match step {
        Some(step) => {
            width = step * (width / step).round().max(1.0);
            low - 0.5 * step
        }
        None => (low / width).floor() * width,
    };
    (begin, width, ((high - begin) / width).floor() as usize + 1)
}

/// The step of values that are multiples of one coarser than a thousandth of their extent; `None` of others.
fn step_of(values: &[f64], extent: f64) -> Option<f64> {
    let gaps = values.windows(2).map(|pair| pair[1] - pair[0]).filter(|gap| *gap > 1e-6 * extent);
    let step = gaps.min_by(f64::total_cmp)?;
    let is_multiple = |value: &f64| {
        let steps = (value - values[0]) / step;
        (steps - steps.round()).abs() < 0.05
    };
    (1e3 * step > extent && values.iter().all(is_multiple)).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_land_with_a_few_trees_has_more_than_two_bars() {
        // Heights of flat ground within 10 cm, and one in thirty points up to 20 m.
        let mut heights: Vec<f64> = (0..9000).map(|i| f64::from(i % 100) * 1e-3).collect();
        heights.extend((0..300).map(|i| f64::from(i) / 15.0));
        heights.sort_by(f64::total_cmp);
        let histogram = Histogram::of([&heights, &heights], false);
        let bars = histogram.fractions[0].iter().filter(|f| **f > 0.01).count();
        assert!(bars >= 10, "{histogram:?}");
        assert!((histogram.overlap - 1.0).abs() < 1e-9 && histogram.above[0] > 0.01, "{histogram:?}");
        let sum: f64 = histogram.fractions[1].iter().sum::<f64>() + histogram.below[1] + histogram.above[1];
        assert!((sum - 1.0).abs() < 1e-9);
    }

    #[test]
    fn whole_numbers_have_a_class_each() {
        let (a, b) = ([1.0, 1.0, 1.0, 2.0], [1.0, 2.0, 2.0, 3.0]);
        let histogram = Histogram::of([&a, &b], true);
        assert_eq!((histogram.from, histogram.to), (0.5, 3.5));
        assert_eq!(histogram.fractions, [vec![0.75, 0.25, 0.0], vec![0.25, 0.5, 0.25]]);
        assert_eq!(histogram.overlap, 0.5);
    }

    #[test]
    fn classes_of_values_in_steps_hold_equally_many_of_them() {
        let values: Vec<f64> = (0..3000).map(|i| 0.0596 * f64::from(i % 30)).collect();
        let mut sorted = values.clone();
        sorted.sort_by(f64::total_cmp);
        let histogram = Histogram::of([&sorted, &sorted], false);
        let classes = &histogram.fractions[0];
        assert!(classes[1..classes.len() - 1].iter().all(|f| (f - classes[1]).abs() < 1e-9), "{histogram:?}");
    }

    #[test]
    fn equal_values_and_vast_ranges_have_classes() {
        let equal = Histogram::of([&[7.0; 5], &[7.0; 3]], false);
        assert_eq!((equal.overlap, equal.fractions[0].len()), (1.0, 1));
        for values in [[0.0, 1e-12, 1.0, 1e9], [-1e9, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1e-9]] {
            let histogram = Histogram::of([&values, &values], false);
            assert!((1..=161).contains(&histogram.fractions[0].len()), "{histogram:?}");
        }
    }
}
