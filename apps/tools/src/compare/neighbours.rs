//! Distances from the points of one cloud to the nearest points of another.

use crate::kd_tree::{KdTree, Places};
use rayon::prelude::*;
use serde::Serialize;

/// Distances to the other cloud, m.
#[derive(Clone, Debug, Serialize)]
pub struct Distances {
    /// Points whose distance was measured.
    pub points: usize,
    /// Mean, m.
    pub mean_m: f64,
    /// Root mean square, m.
    pub rms_m: f64,
    /// Median, m.
    pub median_m: f64,
    /// 95th percentile, m.
    pub percentile_95_m: f64,
    /// Largest, m.
    pub max_m: f64,
}

/// Distances from at most `most` points of `from`, evenly chosen, to the nearest of `to`; neither is empty.
pub(super) fn distances(
    from: &(impl Places + ?Sized),
    to: &(impl Places + ?Sized),
    most: usize,
) -> Distances {
    let step = from.count().div_ceil(most.max(1)).max(1);
    let places: Vec<[f64; 3]> = (0..from.count()).step_by(step).map(|i| from.at(i as u32)).collect();
    from.release();
    let tree = KdTree::new(to);
    let mut found: Vec<f64> = places.par_iter().map(|place| tree.nearest(to, place).sqrt()).collect();
    to.release();
    found.par_sort_unstable_by(f64::total_cmp);
    let count = found.len() as f64;
    let at = |fraction: f64| found[((count - 1.0) * fraction).round() as usize];
    Distances {
        points: found.len(),
        mean_m: found.iter().sum::<f64>() / count,
        rms_m: (found.iter().map(|d| d * d).sum::<f64>() / count).sqrt(),
        median_m: at(0.5),
        percentile_95_m: at(0.95),
        max_m: at(1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::rng::{Purpose, Stream};

    #[test]
    fn distances_are_those_of_brute_force() {
        let stream = Stream::new(5, Purpose::SceneMaking);
        let draw = |n: u64, axis: u32| stream.uniform(0, n, axis);
        for scale in [[10.0, 10.0, 10.0], [100.0, 100.0, 0.0], [50.0, 0.0, 0.0]] {
            let cloud = |seed: u64, count: u64, shift: f64| -> Vec<[f64; 3]> {
                (0..count).map(|i| [0, 1, 2].map(|a| draw(seed + i, a as u32) * scale[a] + shift)).collect()
            };
            let (from, to) = (cloud(0, 200, 3.0), cloud(1000, 300, 0.0));
            let tree = KdTree::new(&to[..]);
            for p in &from {
                let distance = |q: &[f64; 3]| (0..3).map(|a| (q[a] - p[a]) * (q[a] - p[a])).sum::<f64>();
                let expected = to.iter().map(distance).fold(f64::INFINITY, f64::min);
                assert_eq!(tree.nearest(&to[..], p), expected, "{p:?} {scale:?}");
                let mut all: Vec<(f64, u32)> =
                    to.iter().map(distance).zip(0..).filter(|(_, i)| i % 3 == 0).collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0));
                let few = tree.nearest_few(&to[..], p, 5, |i| i % 3 == 0);
                assert_eq!(
                    few.iter().map(|(d, _)| *d).collect::<Vec<_>>(),
                    all[..5].iter().map(|(d, _)| *d).collect::<Vec<_>>()
                );
            }
        }
    }

    #[test]
    fn clusters_far_apart_are_searched_as_fast_as_others() {
        let stream = Stream::new(5, Purpose::SceneMaking);
        let draw = |n: u64, axis: u32| stream.uniform(0, n, axis);
        // Two clusters in opposite corners of a box, and places in a third one.
        let to: Vec<[f64; 3]> =
            (0..100_000).map(|i| [0, 1, 2].map(|a| draw(i, a) + (i % 2) as f64 * 1000.0)).collect();
        let from: Vec<[f64; 3]> = (0..2000).map(|i| [draw(i, 3), draw(i, 4) + 1000.0, draw(i, 5)]).collect();
        let found = distances(&from[..], &to[..], usize::MAX);
        assert!((found.mean_m - 999.0).abs() < 2.0 && found.points == 2000, "{found:?}");
    }
}
