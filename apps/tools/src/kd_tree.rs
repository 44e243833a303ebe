//! The points of a cloud that are nearest to a place, wherever its points lie.

use std::ops::Range;

/// Maximum number of points of a range that is searched without being divided.
const MAX_LEAF_POINTS: usize = 8;
/// In place of an axis: all points of a range are at one place, and in the order of indices.
const ONE_PLACE: u8 = 3;

/// A k-d tree: points in an order in which the middle one of a range separates those before it from those
/// behind it along an axis, and each half likewise. Where the points lie makes no difference to its depth.
pub(crate) struct KdTree {
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
    pub fn nearest(&self, p: &[f64; 3]) -> f64 {
        self.nearest_few(p, 1, |_| true).first().map_or(f64::INFINITY, |(distance, _)| *distance)
    }

    /// True if a point lies within `radius` of a place.
    pub fn is_near(&self, p: &[f64; 3], radius: f64) -> bool {
        !self.nearest_within(p, 1, radius * radius, |_| true).is_empty()
    }

    /// The squares of the distances to the `count` nearest points whose index is accepted, ascending, with
    /// the indices; of equal distances in the order of indices.
    pub fn nearest_few(&self, p: &[f64; 3], count: usize, accepts: impl Fn(u32) -> bool) -> Vec<(f64, u32)> {
        self.nearest_within(p, count, f64::INFINITY, accepts)
    }

    /// As [`nearest_few`](KdTree::nearest_few), of all indices that are accepted and whose squared distance
    /// is at most `square`.
    pub fn nearest_within(
        &self,
        p: &[f64; 3],
        count: usize,
        square: f64,
        accepts: impl Fn(u32) -> bool,
    ) -> Vec<(f64, u32)> {
        let offsets =
            [0, 1, 2].map(|axis| (self.low[axis] - p[axis]).max(p[axis] - self.high[axis]).max(0.0));
        let mut search = Search { p, count, square, accepts, found: Vec::with_capacity(count + 1) };
        self.search(0..self.points.len(), offsets, &mut search);
        search.found
    }

    /// Searches a range of the points, which lie in a box that is `offsets` away along the axes.
    fn search(&self, range: Range<usize>, offsets: [f64; 3], search: &mut Search<impl Fn(u32) -> bool>) {
        // At an equal distance there may be a point of a lower index.
        if squared(offsets) > search.reach() {
            return;
        }
        if range.len() <= MAX_LEAF_POINTS {
            self.points[range].iter().for_each(|q| {
                search.meet(q);
            });
            return;
        }
        let middle = range.start + range.len() / 2;
        if self.axes[middle] == ONE_PLACE {
            // Where one is too far, so are those behind it.
            let _ = self.points[range].iter().try_for_each(|q| search.meet(q).then_some(()));
            return;
        }
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
    /// Largest square of a distance.
    square: f64,
    accepts: A,
    /// Squares of distances, ascending, with indices of points.
    found: Vec<(f64, u32)>,
}

impl<A: Fn(u32) -> bool> Search<'_, A> {
    /// The square of the distance beyond which no point is found.
    fn reach(&self) -> f64 {
        if self.found.len() < self.count { self.square } else { self.found[self.count - 1].0 }
    }

    /// Adds a point if it is near enough and accepted; returns whether it is near enough.
    fn meet(&mut self, (q, index): &([f64; 3], u32)) -> bool {
        let distance = squared([0, 1, 2].map(|axis| q[axis] - self.p[axis]));
        let is_before = |other: &(f64, u32)| *other < (distance, *index);
        let is_full = self.found.len() >= self.count;
        // Also false of a place that is not finite.
        let is_near = distance <= self.reach() && !(is_full && self.found.last().is_some_and(is_before));
        if is_near && (self.accepts)(*index) {
            let place = self.found.partition_point(is_before);
            self.found.insert(place, (distance, *index));
            self.found.truncate(self.count);
        }
        is_near
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
    if extent(axis) == 0.0 {
        points.sort_unstable_by_key(|(_, index)| *index);
        axes[middle] = ONE_PLACE;
        return;
    }
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

    #[test]
    fn many_points_at_one_place_are_searched_as_fast_as_others() {
        // A hundred thousand at each of two places: with a look at all of them this test would take minutes.
        let points: Vec<[f64; 3]> = (0..200_000).map(|i| [f64::from(i % 2) * 5.0, 1.0, 0.0]).collect();
        let tree = KdTree::new(&points);
        for i in 0..20_000 {
            let found = tree.nearest_few(&[0.001 * f64::from(i % 100), 3.0, 0.0], 3, |i| i != 2);
            assert_eq!(found.iter().map(|(_, i)| *i).collect::<Vec<_>>(), [0, 4, 6]);
        }
        assert!(tree.is_near(&[5.0, 1.0, 0.0], 0.0) && !tree.is_near(&[2.5, 1.0, 0.0], 2.4));
        assert!(KdTree::new(&[]).nearest_few(&[0.0; 3], 2, |_| true).is_empty());
    }
}
