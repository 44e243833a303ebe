//! Distances from the points of one cloud to the nearest points of another.

use rayon::prelude::*;
use serde::Serialize;
use std::ops::Range;

/// Maximum number of points of a range that is searched without being divided.
const MAX_LEAF_POINTS: usize = 8;

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
pub(super) fn distances(from: &[[f64; 3]], to: &[[f64; 3]], most: usize) -> Distances {
    let tree = KdTree::new(to);
    let step = from.len().div_ceil(most.max(1)).max(1);
    let mut found: Vec<f64> = from.par_iter().step_by(step).map(|point| tree.nearest(point).sqrt()).collect();
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

/// A k-d tree: points in an order in which the middle one of a range separates those before it from those behind it along an
/// axis, and each half likewise. Where the points lie makes no difference to its depth.
pub(super) struct KdTree {
    /// With their indices before they were ordered.
    points: Vec<([f64; 3], u32)>,
    /// The axis along which the point of this index separates.
    axes: Vec<u8>,
    low: [f64; 3],
    high: [f64; 3],
}

impl KdTree {
    /// A tree of points, of which there are at most 2³².
    pub fn new(points: &[[f64; 3]]) -> KdTree {
        let points: Vec<([f64; 3], u32)> = points.iter().copied().zip(0..).collect();
        let (low, high) = bounds(&points);
        let mut tree = KdTree { axes: vec![0; points.len()], points, low, high };
        arrange(&mut tree.points, &mut tree.axes);
        tree
    }

    /// The square of the distance to the nearest point.
    fn nearest(&self, p: &[f64; 3]) -> f64 {
        self.nearest_few(p, 1, |_| true).first().map_or(f64::INFINITY, |(distance, _)| *distance)
    }

    /// The squares of the distances to the `count` nearest points whose index is accepted, ascending, with the indices.
    pub fn nearest_few(&self, p: &[f64; 3], count: usize, accepts: impl Fn(u32) -> bool) -> Vec<(f64, u32)> {
        let offsets =
            [0, 1, 2].map(|axis| (self.low[axis] - p[axis]).max(p[axis] - self.high[axis]).max(0.0));
        let mut search = Search { p, count, accepts, found: Vec::with_capacity(count + 1) };
        self.search(0..self.points.len(), offsets, &mut search);
        search.found
    }

    /// Searches a range of the points, which lie in a box that is `offsets` away along the axes.
    fn search(&self, range: Range<usize>, offsets: [f64; 3], search: &mut Search<impl Fn(u32) -> bool>) {
        if squared(offsets) >= search.reach() {
            return;
        }
        if range.len() <= MAX_LEAF_POINTS {
            self.points[range].iter().for_each(|q| search.meet(q));
            return;
        }
        let middle = range.start + range.len() / 2;
        let axis = usize::from(self.axes[middle]);
        let (before, behind) = (range.start..middle, middle + 1..range.end);
        let separator = &self.points[middle];
        search.meet(separator);
        let beyond = separator.0[axis] - search.p[axis];
        let (near, far) = if beyond > 0.0 { (before, behind) } else { (behind, before) };
        self.search(near, offsets, search);
        let mut far_offsets = offsets;
        far_offsets[axis] = beyond.abs();
        self.search(far, far_offsets, search);
    }
}

/// A search for the nearest points to a place.
struct Search<'p, A> {
    p: &'p [f64; 3],
    count: usize,
    accepts: A,
    /// Squares of distances, ascending, with indices of points.
    found: Vec<(f64, u32)>,
}

impl<A: Fn(u32) -> bool> Search<'_, A> {
    /// The square of the distance that a point must be nearer than to be found.
    fn reach(&self) -> f64 {
        if self.found.len() < self.count { f64::INFINITY } else { self.found[self.count - 1].0 }
    }

    fn meet(&mut self, (q, index): &([f64; 3], u32)) {
        let distance = squared([0, 1, 2].map(|axis| q[axis] - self.p[axis]));
        if distance < self.reach() && (self.accepts)(*index) {
            let place = self.found.partition_point(|(other, _)| *other <= distance);
            self.found.insert(place, (distance, *index));
            self.found.truncate(self.count);
        }
    }
}

/// Brings points into the order of a [`KdTree`].
fn arrange(points: &mut [([f64; 3], u32)], axes: &mut [u8]) {
    if points.len() <= MAX_LEAF_POINTS {
        return;
    }
    let (low, high) = bounds(points);
    let extent = |axis: usize| high[axis] - low[axis];
    let axis = if extent(0) >= extent(1).max(extent(2)) { 0 } else { 1 + usize::from(extent(2) > extent(1)) };
    let middle = points.len() / 2;
    points.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]));
    axes[middle] = axis as u8;
    let (before, behind) = points.split_at_mut(middle);
    let (axes_before, axes_behind) = axes.split_at_mut(middle);
    rayon::join(|| arrange(before, axes_before), || arrange(&mut behind[1..], &mut axes_behind[1..]));
}

fn bounds(points: &[([f64; 3], u32)]) -> ([f64; 3], [f64; 3]) {
    let none = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    points.iter().fold(none, |(low, high), (p, _)| {
        ([0, 1, 2].map(|axis| low[axis].min(p[axis])), [0, 1, 2].map(|axis| high[axis].max(p[axis])))
    })
}

fn squared(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum()
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
            let tree = KdTree::new(&to);
            for p in &from {
                let distance = |q: &[f64; 3]| (0..3).map(|a| (q[a] - p[a]) * (q[a] - p[a])).sum::<f64>();
                let expected = to.iter().map(distance).fold(f64::INFINITY, f64::min);
                assert_eq!(tree.nearest(p), expected, "{p:?} {scale:?}");
                let mut all: Vec<(f64, u32)> =
                    to.iter().map(distance).zip(0..).filter(|(_, i)| i % 3 == 0).collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0));
                let few = tree.nearest_few(p, 5, |i| i % 3 == 0);
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
        let found = distances(&from, &to, usize::MAX);
        assert!((found.mean_m - 999.0).abs() < 2.0 && found.points == 2000, "{found:?}");
    }
}
