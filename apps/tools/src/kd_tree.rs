//! The points of a cloud that are nearest to a place, wherever its points lie.
//!
//! A tree holds the indices of points, which are stored elsewhere. Splits of a sample divide the points into
//! buckets, and medians divide the buckets, so that most of the work is done on few points that are near each
//! other in memory.

use rayon::prelude::*;

/// Maximum number of points of a leaf, unless all are at one place: halves of a bucket five times over, which
/// scatter about 32.
const MAX_LEAF_POINTS: usize = 48;
/// Number of points of a bucket, about.
const BUCKET_POINTS: usize = if cfg!(test) { 64 } else { 1024 };
/// Number of points of a bucket that are in the sample.
const SAMPLE_POINTS: usize = 8;
/// Maximum number of times that the buckets are halved.
const MAX_LEVELS: u32 = 16;
/// Number of points whose buckets one task finds.
const TASK_POINTS: usize = 1 << 14;

/// Points by their index.
pub(crate) trait Places: Sync {
    /// Number of points, at most 2³².
    fn count(&self) -> usize;

    /// Position of a point.
    fn at(&self, index: u32) -> [f64; 3];

    /// Releases the memory of places in temporary files, which is taken again when they are used.
    fn release(&self) {}
}

impl Places for [[f64; 3]] {
    fn count(&self) -> usize {
        self.len()
    }

    fn at(&self, index: u32) -> [f64; 3] {
        self[index as usize]
    }
}

/// A k-d tree. Its depth does not depend on the positions of the points. Searches take the points of which
/// the tree was made; their results do not depend on the order of the tree.
pub(crate) struct KdTree {
    /// Indices of the points, leaf by leaf.
    order: Vec<u32>,
    nodes: Vec<Node>,
    /// `None` without points.
    root: Option<u32>,
}

/// The box around some points.
#[derive(Clone, Copy)]
struct Node {
    low: [f64; 3],
    high: [f64; 3],
    content: Content,
}

#[derive(Clone, Copy)]
enum Content {
    /// A range of the order. Indices ascend if all points are at one place.
    Leaf { start: u32, end: u32, is_one_place: bool },
    /// Two nodes.
    Inner { left: u32, right: u32 },
}

impl Node {
    /// The square of the distance from a place: not more than that of any point of the node, as computed.
    fn distance(&self, p: &[f64; 3]) -> f64 {
        squared([0, 1, 2].map(|axis| (self.low[axis] - p[axis]).max(p[axis] - self.high[axis]).max(0.0)))
    }

    /// The node after `by` others.
    fn moved(self, by: u32) -> Node {
        let content = match self.content {
            Content::Inner { left, right } => Content::Inner { left: left + by, right: right + by },
            leaf @ Content::Leaf { .. } => leaf,
        };
        Node { content, ..self }
    }
}

impl KdTree {
    /// A tree of points.
    pub fn new(places: &(impl Places + ?Sized)) -> KdTree {
        let (mut order, ends) = buckets(places);
        let (mut parts, mut rest, mut start) = (Vec::with_capacity(ends.len()), &mut order[..], 0);
        for end in ends {
            let (part, more) = std::mem::take(&mut rest).split_at_mut(end - start);
            parts.push((start, part));
            (rest, start) = (more, end);
        }
        let trees: Vec<Vec<Node>> = parts
            .into_par_iter()
            .map(|(start, part)| {
                let mut points: Vec<([f64; 3], u32)> = part.iter().map(|i| (places.at(*i), *i)).collect();
                let mut nodes = Vec::new();
                if !points.is_empty() {
                    arrange(&mut points, start as u32, &mut nodes);
                }
                part.iter_mut().zip(&points).for_each(|(index, point)| *index = point.1);
                nodes
            })
            .collect();
        let mut nodes = Vec::with_capacity(trees.iter().map(Vec::len).sum::<usize>() + trees.len());
        let root = join(&trees, &mut nodes);
        KdTree { order, nodes, root }
    }

    /// The square of the distance to the nearest point.
    pub fn nearest(&self, places: &(impl Places + ?Sized), p: &[f64; 3]) -> f64 {
        let found = self.nearest_few(places, p, 1, |_| true);
        found.first().map_or(f64::INFINITY, |(distance, _)| *distance)
    }

    /// True if a point lies within `radius` of a place.
    pub fn is_near(&self, places: &(impl Places + ?Sized), p: &[f64; 3], radius: f64) -> bool {
        !self.nearest_within(places, p, 1, radius * radius, |_| true).is_empty()
    }

    /// The squares of the distances to the `count` nearest points whose index is accepted, ascending, with
    /// the indices; of equal distances in the order of indices.
    pub fn nearest_few(
        &self,
        places: &(impl Places + ?Sized),
        p: &[f64; 3],
        count: usize,
        accepts: impl Fn(u32) -> bool,
    ) -> Vec<(f64, u32)> {
        self.nearest_within(places, p, count, f64::INFINITY, accepts)
    }

    /// As [`nearest_few`](KdTree::nearest_few), of all indices that are accepted and whose squared distance
    /// is at most `square`.
    pub fn nearest_within(
        &self,
        places: &(impl Places + ?Sized),
        p: &[f64; 3],
        count: usize,
        square: f64,
        accepts: impl Fn(u32) -> bool,
    ) -> Vec<(f64, u32)> {
        let mut search = Search { p, count, square, accepts, found: Vec::with_capacity(count + 1) };
        if let Some(root) = self.root {
            self.search(places, (self.nodes[root as usize].distance(p), root), &mut search);
        }
        search.found
    }

    /// Searches a node at a squared distance.
    fn search(
        &self,
        places: &(impl Places + ?Sized),
        (distance, node): (f64, u32),
        search: &mut Search<impl Fn(u32) -> bool>,
    ) {
        // At an equal distance there may be a point of a lower index.
        if distance > search.reach() {
            return;
        }
        match self.nodes[node as usize].content {
            Content::Leaf { start, end, is_one_place } => {
                for index in &self.order[start as usize..end as usize] {
                    let is_near = search.meet(&(places.at(*index), *index));
                    // Where one is too far, so are those behind it.
                    if is_one_place && !is_near {
                        return;
                    }
                }
            }
            Content::Inner { left, right } => {
                let [left, right] =
                    [left, right].map(|node| (self.nodes[node as usize].distance(search.p), node));
                let (near, far) = if left.0 <= right.0 { (left, right) } else { (right, left) };
                self.search(places, near, search);
                self.search(places, far, search);
            }
        }
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

/// A split of a sample: points of at least the value along the axis are behind it. A value of NaN has none
/// behind it.
#[derive(Clone, Copy)]
struct Split {
    axis: usize,
    value: f64,
}

/// The indices of the points by bucket, with the end of each bucket. Neighbouring buckets are siblings in a
/// binary tree.
fn buckets(places: &(impl Places + ?Sized)) -> (Vec<u32>, Vec<usize>) {
    let count = places.count();
    let levels = (count / BUCKET_POINTS).max(1).ilog2().min(MAX_LEVELS);
    if levels == 0 {
        return ((0..count as u32).collect(), vec![count]);
    }
    let number = 1_usize << levels;
    let step = (count / (SAMPLE_POINTS * number)).max(1);
    let mut sample: Vec<[f64; 3]> = (0..count).step_by(step).map(|i| places.at(i as u32)).collect();
    let mut splits = vec![Split { axis: 0, value: f64::NAN }; number - 1];
    divide(&mut sample, 0, &mut splits);
    let mut bucket_of_points = vec![0_u16; count];
    bucket_of_points
        .par_chunks_mut(TASK_POINTS)
        .enumerate()
        .for_each(|(task, buckets)| find_buckets(places, task * TASK_POINTS, &splits, buckets));
    let mut places_of_next = vec![0; number];
    bucket_of_points.iter().for_each(|bucket| places_of_next[usize::from(*bucket)] += 1);
    let mut sum = 0;
    for next in &mut places_of_next {
        let points = *next;
        *next = sum;
        sum += points;
    }
    let mut order = vec![0; count];
    for (index, bucket) in (0..).zip(&bucket_of_points) {
        let next = &mut places_of_next[usize::from(*bucket)];
        order[*next] = index;
        *next += 1;
    }
    (order, places_of_next)
}

/// Finds the buckets of points from the index `start` on. Some points are followed at a time: each step of
/// one waits for the step before, and the steps of the others are done meanwhile.
fn find_buckets(places: &(impl Places + ?Sized), start: usize, splits: &[Split], buckets: &mut [u16]) {
    const TOGETHER: usize = 8;
    for (group, buckets) in buckets.chunks_mut(TOGETHER).enumerate() {
        let first = start + group * TOGETHER;
        let mut points = [[0.0; 3]; TOGETHER];
        (first..).zip(&mut points[..buckets.len()]).for_each(|(i, point)| *point = places.at(i as u32));
        let mut at = [0; TOGETHER];
        // All ways to the buckets have the same number of splits.
        while at[0] < splits.len() {
            for (at, point) in at.iter_mut().zip(&points) {
                let Split { axis, value } = splits[*at];
                *at = 2 * *at + 1 + usize::from(point[axis] >= value);
            }
        }
        buckets.iter_mut().zip(at).for_each(|(bucket, at)| *bucket = (at - splits.len()) as u16);
    }
}

/// Finds the splits of a sample: that of number `at`, and those on both sides of it.
fn divide(sample: &mut [[f64; 3]], at: usize, splits: &mut [Split]) {
    if at >= splits.len() || sample.is_empty() {
        return;
    }
    let (low, high) = bounds(sample.iter());
    let axis = widest(low, high);
    if high[axis] == low[axis] {
        return;
    }
    let middle = sample.len() / 2;
    sample.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
    splits[at] = Split { axis, value: sample[middle][axis] };
    let (before, behind) = sample.split_at_mut(middle);
    divide(before, 2 * at + 1, splits);
    divide(behind, 2 * at + 2, splits);
}

/// Divides points whose first one is at `start` of the order, of which there is at least one, and appends
/// their nodes; returns the number of the outermost node.
fn arrange(points: &mut [([f64; 3], u32)], start: u32, nodes: &mut Vec<Node>) -> u32 {
    let (low, high) = bounds(points.iter().map(|(p, _)| p));
    let axis = widest(low, high);
    let is_one_place = high[axis] == low[axis];
    let number = nodes.len();
    let content = Content::Leaf { start, end: start + points.len() as u32, is_one_place };
    nodes.push(Node { low, high, content });
    if is_one_place {
        points.sort_unstable_by_key(|(_, index)| *index);
    } else if points.len() > MAX_LEAF_POINTS {
        let middle = points.len() / 2;
        points.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]));
        let (before, behind) = points.split_at_mut(middle);
        let left = arrange(before, start, nodes);
        let right = arrange(behind, start + middle as u32, nodes);
        nodes[number].content = Content::Inner { left, right };
    }
    number as u32
}

/// Appends the nodes of some trees, of which there is at least one, and those that join them; returns the
/// number of the outermost node.
fn join(trees: &[Vec<Node>], nodes: &mut Vec<Node>) -> Option<u32> {
    let first = nodes.len() as u32;
    if let [tree] = trees {
        nodes.extend(tree.iter().map(|node| node.moved(first)));
        return (!tree.is_empty()).then_some(first);
    }
    let (before, behind) = trees.split_at(trees.len() / 2);
    let (left, right) = (join(before, nodes), join(behind, nodes));
    let (Some(left), Some(right)) = (left, right) else { return left.or(right) };
    let [a, b] = [left, right].map(|node| nodes[node as usize]);
    let (low, high) = bounds([&a.low, &a.high, &b.low, &b.high].into_iter());
    nodes.push(Node { low, high, content: Content::Inner { left, right } });
    Some(nodes.len() as u32 - 1)
}

/// The axis along which a box is longest.
fn widest(low: [f64; 3], high: [f64; 3]) -> usize {
    let extent = |axis: usize| high[axis] - low[axis];
    if extent(0) >= extent(1).max(extent(2)) { 0 } else { 1 + usize::from(extent(2) > extent(1)) }
}

fn bounds<'p>(points: impl Iterator<Item = &'p [f64; 3]>) -> ([f64; 3], [f64; 3]) {
    let none = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    points.fold(none, |(low, high), p| {
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
        let tree = KdTree::new(&points[..]);
        for i in 0..20_000 {
            let place = [0.001 * f64::from(i % 100), 3.0, 0.0];
            let found = tree.nearest_few(&points[..], &place, 3, |i| i != 2);
            assert_eq!(found.iter().map(|(_, i)| *i).collect::<Vec<_>>(), [0, 4, 6]);
        }
        assert!(tree.is_near(&points[..], &[5.0, 1.0, 0.0], 0.0));
        assert!(!tree.is_near(&points[..], &[2.5, 1.0, 0.0], 2.4));
        let none: [[f64; 3]; 0] = [];
        assert!(KdTree::new(&none[..]).nearest_few(&none[..], &[0.0; 3], 2, |_| true).is_empty());
    }

    #[test]
    fn neighbours_of_clustered_points_are_those_of_brute_force() {
        // Half of them at a few places, the others on a grid, so that many distances are equal.
        let points: Vec<[f64; 3]> = (0..5000_u32)
            .map(|i| match i % 2 {
                0 => [f64::from(i % 3), 2.0, 1.0],
                _ => [f64::from(i * 7 % 40), f64::from(i * 13 % 30), f64::from(i % 5)],
            })
            .collect();
        let tree = KdTree::new(&points[..]);
        for place in [[0.0, 2.0, 1.0], [20.5, 14.5, 2.0], [-30.0, 7.0, 9.0], [1e6, 0.0, 0.0]] {
            let distance = |q: &[f64; 3]| squared([0, 1, 2].map(|axis| q[axis] - place[axis]));
            let mut all: Vec<(f64, u32)> = points.iter().map(distance).zip(0..).collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            assert_eq!(tree.nearest_few(&points[..], &place, 40, |_| true), all[..40], "{place:?}");
            let accepted: Vec<(f64, u32)> = all.iter().copied().filter(|(_, i)| i % 7 == 3).collect();
            assert_eq!(tree.nearest_few(&points[..], &place, 9, |i| i % 7 == 3), accepted[..9], "{place:?}");
            let within = all.iter().filter(|(square, _)| *square <= all[60].0).count();
            let found = tree.nearest_within(&points[..], &place, 5000, all[60].0, |_| true);
            assert_eq!(found, all[..within], "{place:?}");
        }
    }
}
