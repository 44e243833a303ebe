//! The split of a node: the four searches of spec tree-and-schedule §1.8 to §1.11.

use super::prim::Prim;
use super::{fold_by, pieces};
use crate::Geometry;
use crate::frame::Frame;
use crate::options::{Areas, BuildOptions, Builder};
use rayon::prelude::*;

const MAX_BINS: usize = 1024;

/// A node's box and its area by the proportional rule of spec tree-and-schedule §1.4.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cell {
    pub lo: [f64; 3],
    pub hi: [f64; 3],
    pub area: f64,
}

impl Cell {
    /// Returns the cell of the root, computed by several `threads`.
    pub fn around(threads: usize, prims: &[Prim]) -> Cell {
        let union = |(a, b): ([f32; 3], [f32; 3]), (c, d): ([f32; 3], [f32; 3])| {
            ([0, 1, 2].map(|i| a[i].min(c[i])), [0, 1, 2].map(|i| b[i].max(d[i])))
        };
        let nothing = || ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let (lo, hi) = fold_by(threads, prims, nothing, |b, p| *b = union(*b, (p.lo, p.hi)), union);
        let (mut lo, mut hi) = (lo.map(f64::from), hi.map(f64::from));
        if prims.is_empty() {
            (lo, hi) = ([0.0; 3], [0.0; 3]);
        }
        let [x, y, z] = [hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]];
        Cell { lo, hi, area: 2.0 * (x * y + x * z + y * z) }
    }

    pub fn cut(&self, split: &Split) -> [Cell; 2] {
        let (mut left, mut right) = (*self, *self);
        let (a, b) = (self.lo[split.axis], self.hi[split.axis]);
        let position = a + split.r * (b - a);
        left.hi[split.axis] = position;
        right.lo[split.axis] = position;
        left.area = split.r * self.area;
        right.area = (1.0 - split.r) * self.area;
        [left, right]
    }
}

/// A split plane; `r` is the fraction of the cell on its lower side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Split {
    pub axis: usize,
    pub position: f64,
    pub r: f64,
    pub loss: f64,
}

/// The scene and the settings of a search.
pub(crate) struct Search<'a> {
    pub geometry: &'a Geometry,
    pub frame: Frame,
    pub options: &'a BuildOptions,
}

impl Search<'_> {
    /// Returns the split of the selected builder on `axis`, computed by several `threads`; `None` when the
    /// cell has no extent there.
    pub fn on_axis(&self, threads: usize, prims: &[Prim], cell: &Cell, axis: usize) -> Option<Split> {
        match self.options.builder {
            Builder::Median => self.median_split(threads, prims, cell, axis),
            Builder::Sah | Builder::AxisSah => self.sah_split(threads, prims, cell, axis),
            Builder::Fsah | Builder::Bvh => self.fsah_split(threads, prims, cell, axis),
        }
    }

    /// Returns the split of minimum loss over all axes, the first of equals.
    pub fn on_best_axis(&self, threads: usize, prims: &[Prim], cell: &Cell) -> Option<Split> {
        (0..3)
            .filter_map(|a| self.on_axis(threads, prims, cell, a))
            .reduce(|best, s| if s.loss < best.loss { s } else { best })
    }

    /// Expected number of tests after a split: each side's count, rounded up to the grain, times the
    /// probability that it is hit.
    pub fn loss(&self, chances: [f64; 2], counts: [usize; 2]) -> f64 {
        let [l, r] = counts.map(|n| n.next_multiple_of(self.options.grain.max(1)) as f64);
        chances[0] * l + chances[1] * r
    }

    fn median_split(&self, threads: usize, prims: &[Prim], cell: &Cell, axis: usize) -> Option<Split> {
        let p = self.object_median(threads, prims, axis);
        let r = share(cell, axis, p)?;
        // Of the medians on three axes, the one on the longest side is best.
        Some(Split { axis, position: p, r, loss: cell.lo[axis] - cell.hi[axis] })
    }

    fn sah_split(&self, threads: usize, prims: &[Prim], cell: &Cell, axis: usize) -> Option<Split> {
        let (a, b) = (cell.lo[axis], cell.hi[axis]);
        let middle = (a + b) / 2.0;
        let median = self.object_median(threads, prims, axis).max(a).min(b);
        let n = self.options.candidates.max(2);
        let (start, step) = (middle.min(median), (middle - median).abs() / (n - 1) as f64);
        let planes: Vec<f64> = (0..n).map(|i| start + i as f64 * step).collect();
        let Histograms { starts, ends } = between(threads, prims, axis, &planes);
        let (mut below, mut above) = (0, prims.len());
        let mut best: Option<Split> = None;
        for (i, &p) in planes.iter().enumerate() {
            below += starts[i] as usize;
            above -= ends[i] as usize;
            let r = share(cell, axis, p)?;
            let loss = self.loss(self.chances(cell, axis, r), [below, above]);
            if best.is_none_or(|s| loss < s.loss) {
                best = Some(Split { axis, position: p, r, loss });
            }
        }
        best
    }

    /// Returns the best boundary of min/max histograms (spec tree-and-schedule §1.11), with bins clamped at
    /// both ends.
    fn fsah_split(&self, threads: usize, prims: &[Prim], cell: &Cell, axis: usize) -> Option<Split> {
        let (a, b) = (cell.lo[axis], cell.hi[axis]);
        if b <= a {
            return None;
        }
        let bins = self.options.bins.clamp(2, MAX_BINS);
        let (width, m) = (b - a, bins as f64);
        // A float to integer cast saturates, which is the lower clamp.
        let bin = |v: f32| (((f64::from(v) - a) / width * m) as usize).min(bins - 1);
        let add = |h: &mut Histograms, o: &Prim| {
            h.starts[bin(o.lo[axis])] += 1;
            h.ends[bin(o.hi[axis])] += 1;
        };
        let Histograms { starts, ends } =
            fold_by(threads, prims, || Histograms::empty(bins), add, Histograms::plus);
        let (mut below, mut above) = (0, prims.len());
        let (mut best, mut loss) = (0, self.loss([0.0, 1.0], [0, above]));
        for i in 1..=bins {
            below += starts[i - 1] as usize;
            above -= ends[i - 1] as usize;
            let here = self.loss(self.chances(cell, axis, i as f64 / m), [below, above]);
            if here < loss {
                (best, loss) = (i, here);
            }
        }
        let r = best as f64 / m;
        let position = if best == bins { b } else { a + r * width };
        Some(Split { axis, position, r, loss })
    }

    /// Probabilities that a ray that hits the cell hits the lower and the upper side of a split.
    pub fn chances(&self, cell: &Cell, axis: usize, r: f64) -> [f64; 2] {
        match self.options.areas {
            Areas::Proportional => [r, 1.0 - r],
            Areas::Surface => {
                let side = |a: usize| cell.hi[a] - cell.lo[a];
                let (along, u, v) = (side(axis), side((axis + 1) % 3), side((axis + 2) % 3));
                let area = |length: f64| length * (u + v) + u * v;
                let whole = area(along);
                if whole > 0.0 {
                    [area(r * along) / whole, area((1.0 - r) * along) / whole]
                } else {
                    [r, 1.0 - r]
                }
            }
        }
    }

    /// Returns the centroid at index ⌊N/2⌋ in descending order.
    fn object_median(&self, threads: usize, prims: &[Prim], axis: usize) -> f64 {
        let centroid = |p: &Prim| self.centroid(p.id, axis);
        let mut centroids: Vec<f64> = if threads < 2 {
            prims.iter().map(centroid).collect()
        } else {
            prims.par_iter().with_min_len(prims.len().div_ceil(threads)).map(centroid).collect()
        };
        *centroids.select_nth_unstable_by(prims.len() / 2, |x, y| y.total_cmp(x)).1
    }

    fn centroid(&self, id: u32, axis: usize) -> f64 {
        let id = id as usize;
        if id < self.geometry.triangle_count() {
            let [a, b, c] = self.geometry.triangle(id).map(|p| self.frame.local(p)[axis]);
            return (a + b + c) / 3.0;
        }
        let centre = match self.geometry.locate_cube(id - self.geometry.triangle_count()) {
            (Some(grid), _) => self.geometry.grids[grid].bounds().centre(),
            (None, cube) => self.geometry.cubes[cube].centre,
        };
        self.frame.local(centre)[axis]
    }
}

/// Numbers of primitives that start and end in each bin.
struct Histograms {
    starts: Vec<u32>,
    ends: Vec<u32>,
}

impl Histograms {
    fn empty(bins: usize) -> Histograms {
        Histograms { starts: vec![0; bins], ends: vec![0; bins] }
    }

    fn plus(mut self, other: Histograms) -> Histograms {
        self.starts.iter_mut().zip(other.starts).for_each(|(a, b)| *a += b);
        self.ends.iter_mut().zip(other.ends).for_each(|(a, b)| *a += b);
        self
    }
}

/// Counts the primitives that start and end in each bin between evenly ascending planes: at or before plane
/// `i` and after plane `i − 1`; coordinates beyond the last plane count in the last bin. One pass over the
/// primitives finds the counts that [`count`] finds for each plane.
fn between(threads: usize, prims: &[Prim], axis: usize, planes: &[f64]) -> Histograms {
    let (start, last) = (planes[0], planes.len() - 1);
    let per_length = last as f64 / (planes[last] - start);
    let bin = |v: f32| {
        let v = f64::from(v);
        // Rounding may yield a neighbouring bin. If all planes are equal, the value is NaN, which becomes 0.
        let mut i = (((v - start) * per_length) as usize).min(last);
        while i > 0 && planes[i - 1] >= v {
            i -= 1;
        }
        while i <= last && planes[i] < v {
            i += 1;
        }
        i
    };
    let add = |h: &mut Histograms, o: &Prim| {
        h.starts[bin(o.lo[axis])] += 1;
        h.ends[bin(o.hi[axis])] += 1;
    };
    fold_by(threads, prims, || Histograms::empty(planes.len() + 1), add, Histograms::plus)
}

/// Returns (p − a)/(b − a); `None` when the cell is flat on this axis.
fn share(cell: &Cell, axis: usize, p: f64) -> Option<f64> {
    let (a, b) = (cell.lo[axis], cell.hi[axis]);
    (b > a).then(|| (p - a) / (b - a))
}

/// Counts the primitives of the lower and of the upper side (spec tree-and-schedule §1.5).
pub(crate) fn count(threads: usize, prims: &[Prim], axis: usize, p: f64) -> [usize; 2] {
    let add = |n: &mut [usize; 2], o: &Prim| {
        n[0] += usize::from(f64::from(o.lo[axis]) <= p);
        n[1] += usize::from(f64::from(o.hi[axis]) > p);
    };
    fold_by(threads, prims, || [0, 0], add, |a, b| [a[0] + b[0], a[1] + b[1]])
}

/// Returns the primitives of either side in order; those that straddle the plane are in both.
pub(crate) fn partition(
    threads: usize,
    prims: &[Prim],
    split: &Split,
    [nl, nr]: [usize; 2],
) -> [Vec<Prim>; 2] {
    let is_left = |o: &&Prim| f64::from(o.lo[split.axis]) <= split.position;
    let is_right = |o: &&Prim| f64::from(o.hi[split.axis]) > split.position;
    let (mut left, mut right) = (Vec::with_capacity(nl), Vec::with_capacity(nr));
    if threads < 2 {
        left.extend(prims.iter().filter(is_left));
        right.extend(prims.iter().filter(is_right));
        return [left, right];
    }
    let sides = |piece: &[Prim]| -> [Vec<Prim>; 2] {
        [piece.iter().filter(is_left).copied().collect(), piece.iter().filter(is_right).copied().collect()]
    };
    let parts: Vec<[Vec<Prim>; 2]> = pieces(threads, prims).map(sides).collect();
    for [l, r] in parts {
        left.extend(l);
        right.extend(r);
    }
    [left, right]
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::rng::{Purpose, Stream};

    #[test]
    fn one_pass_counts_what_every_plane_counts() {
        let random = Stream::new(3, Purpose::Range);
        let at = |i: u64, k: u32| (40.0 * random.uniform(k, i, 0)).floor() as f32 / 16.0;
        let prims: Vec<Prim> = (0..500)
            .map(|id| {
                let lo = at(u64::from(id), 0);
                Prim { lo: [lo; 3], id, hi: [lo + at(u64::from(id), 1) / 4.0; 3] }
            })
            .collect();
        // Many corners are in the planes; in the last two cases all planes are equal or beyond the corners.
        for (start, step) in [(0.0, 0.125), (0.3, 1e-3), (-4.0, 0.7), (1.25, 0.0), (9.0, 1.0)] {
            let planes: Vec<f64> = (0..21).map(|i| start + f64::from(i) * step).collect();
            let Histograms { starts, ends } = between(1, &prims, 1, &planes);
            let (mut below, mut above) = (0, prims.len());
            for (i, &p) in planes.iter().enumerate() {
                below += starts[i] as usize;
                above -= ends[i] as usize;
                assert_eq!([below, above], count(1, &prims, 1, p), "{start} + {i}·{step}");
            }
        }
    }
}
