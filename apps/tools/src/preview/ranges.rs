//! Ranges and ranks of values, which colours show.

/// Number of quantiles by which values are ranked.
const QUANTILES: usize = 129;
/// Maximum number of values that quantiles are taken from: an even sample of more.
const MAX_RANKED: usize = 1 << 20;

/// Quantiles of the finite ones of `count` values from 0 to 1, ascending; of no values, of 0 and 1.
pub(super) fn quantiles(values: impl Iterator<Item = f32>, count: usize) -> Vec<f32> {
    let step = count.div_ceil(MAX_RANKED).max(1);
    let mut sorted: Vec<f32> = values.step_by(step).filter(|v| v.is_finite()).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    if sorted.is_empty() {
        return vec![0.0, 1.0];
    }
    (0..QUANTILES).map(|i| sorted[i * (sorted.len() - 1) / (QUANTILES - 1)]).collect()
}

/// Rank of a value among quantiles, 0–1; the middle of the ranks of equal quantiles.
pub(super) fn rank(quantiles: &[f32], value: f32) -> f32 {
    let last = (quantiles.len() - 1) as f32;
    let below = quantiles.partition_point(|q| *q < value);
    let up_to = quantiles.partition_point(|q| *q <= value);
    if up_to > below {
        return 0.5 * (below + up_to - 1) as f32 / last;
    }
    match (below.checked_sub(1).map(|i| quantiles[i]), quantiles.get(below)) {
        (Some(low), Some(high)) => ((below - 1) as f32 + (value - low) / (high - low)) / last,
        (None, _) => 0.0,
        (_, None) => 1.0,
    }
}

/// The range of the values without the lowest and the highest half per cent.
pub(super) fn inner_range(values: impl Iterator<Item = f32> + Clone) -> (f32, f32) {
    const BINS: usize = 4096;
    let finite = values.filter(|v| v.is_finite());
    let (low, high) =
        finite.clone().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low >= high || !(high - low).is_finite() {
        return if low.is_finite() { (low, low + 1.0) } else { (0.0, 1.0) };
    }
    let mut bins = vec![0u64; BINS];
    let mut total = 0;
    for v in finite {
        bins[(((v - low) / (high - low) * BINS as f32) as usize).min(BINS - 1)] += 1;
        total += 1;
    }
    let cut = total / 200;
    let skip = |bins: &mut dyn Iterator<Item = &u64>| {
        let mut seen = 0;
        bins.take_while(|n| {
            seen += **n;
            seen <= cut
        })
        .count()
    };
    let (below, above) = (skip(&mut bins.iter()), skip(&mut bins.iter().rev()));
    let step = (high - low) / BINS as f32;
    (low + below as f32 * step, high - above as f32 * step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_spread_skewed_values_over_the_colours() {
        let values: Vec<f32> = (0..10_000).map(|i| (i as f32 / 1000.0).exp()).collect();
        let quantiles = quantiles(values.iter().copied(), values.len());
        for (share, i) in [(0.0, 0), (0.25, 2500), (0.5, 5000), (1.0, 9999)] {
            assert!((rank(&quantiles, values[i]) - share).abs() < 0.01, "{share}");
        }
        assert_eq!((rank(&quantiles, -1.0), rank(&quantiles, 1e9)), (0.0, 1.0));
        assert_eq!(rank(&super::quantiles([7.0; 9].into_iter(), 9), 7.0), 0.5);
        assert_eq!(super::quantiles([f32::NAN].into_iter(), 1), [0.0, 1.0]);
    }

    #[test]
    fn a_few_outliers_do_not_stretch_the_range() {
        let values = (0..10_000).map(|i| if i < 10 { 1e4 } else { (i % 100) as f32 });
        let (low, high) = inner_range(values);
        assert!(low == 0.0 && (95.0..110.0).contains(&high), "{low} {high}");
        assert_eq!(inner_range([5.0f32; 3].into_iter()), (5.0, 6.0));
        assert_eq!(inner_range(std::iter::empty()), (0.0, 1.0));
    }
}
