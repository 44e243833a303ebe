//! The wide bounding volume hierarchy: sixteen children per node, exactly one block per leaf, no primitive
//! twice.
//!
//! A node starts as one range of primitives and repeatedly splits the range of largest surface that does not
//! fit into a block, until there are sixteen. A split is the best of 32 bins of centroids per axis. The cost
//! is the number of blocks, not of primitives, so blocks are nearly full.

use super::cost::Sums;
use super::fold;
use super::prim::Prim;
use crate::block::BLOCK_SIZE;
use crate::frame::Frame;
use crate::node::{WideChild, WideNode};
use crate::options::{BuildOptions, Statistics};
use rayon::prelude::*;

/// Nodes below this depth are split in the middle, which bounds the depth by [`MAX_WIDE_DEPTH`].
const MAX_FREE_DEPTH: u32 = 24;

/// Maximum depth of any tree: after [`MAX_FREE_DEPTH`], 16^8 primitives.
pub(crate) const MAX_WIDE_DEPTH: u32 = MAX_FREE_DEPTH + 8;

/// Nodes of fewer primitives are built by one thread.
const MIN_SHARED_PRIMITIVES: usize = 4096;

const MAX_BINS: usize = 32;

/// A hierarchy whose blocks divide its primitives in their order.
pub(crate) struct WideTree {
    pub nodes: Vec<WideNode>,
    /// Number of primitives of each block.
    pub sizes: Vec<u8>,
}

/// Builds the hierarchy over `prims` and puts them into the order of its blocks. The result does not depend
/// on the number of threads.
pub(crate) fn build_wide(
    triangles: usize,
    frame: &Frame,
    prims: &mut [Prim],
    options: &BuildOptions,
) -> (WideTree, Statistics) {
    // A block holds one kind only, so the root separates the kinds; triangles come first.
    let kinds = prims.iter().position(|p| p.id as usize >= triangles).unwrap_or(prims.len());
    let (one, other) = prims.split_at_mut(kinds);
    let ranges = [one, other].into_iter().filter(|r| !r.is_empty()).map(Range::of).collect();
    let mut part = Part::default();
    let Built { sums, bounds } = build_node(ranges, 0, options.delegate, &mut part);
    let (area, metres) = (f64::from(bounds.area()), 1.0 / frame.scale);
    let square_metres = 2.0 * area * metres * metres;
    let statistics = sums.statistics(options, sums.references(), area, square_metres);
    (WideTree::of(&part), statistics)
}

/// A box in the tree's frame.
#[derive(Clone, Copy)]
struct Bounds {
    lo: [f32; 3],
    hi: [f32; 3],
}

impl Bounds {
    const EMPTY: Bounds = Bounds { lo: [f32::INFINITY; 3], hi: [f32::NEG_INFINITY; 3] };

    #[inline(always)]
    fn union(&self, other: &Bounds) -> Bounds {
        let least = |a: f32, b: f32| if a < b { a } else { b };
        let greatest = |a: f32, b: f32| if a > b { a } else { b };
        Bounds {
            lo: [
                least(self.lo[0], other.lo[0]),
                least(self.lo[1], other.lo[1]),
                least(self.lo[2], other.lo[2]),
            ],
            hi: [
                greatest(self.hi[0], other.hi[0]),
                greatest(self.hi[1], other.hi[1]),
                greatest(self.hi[2], other.hi[2]),
            ],
        }
    }

    /// Half the surface; 0 for an empty box.
    fn area(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|a| (self.hi[a] - self.lo[a]).max(0.0));
        x * y + x * z + y * z
    }
}

/// Primitives that no split has separated yet.
struct Range<'a> {
    prims: &'a mut [Prim],
    bounds: Bounds,
    /// Box of the sums of both corners, which are twice the centroids.
    centroids: Bounds,
}

impl<'a> Range<'a> {
    fn of(prims: &'a mut [Prim]) -> Range<'a> {
        let add = |b: &mut (Bounds, Bounds), p: &Prim| {
            let c = centroid(p);
            b.0 = b.0.union(&Bounds { lo: p.lo, hi: p.hi });
            b.1 = b.1.union(&Bounds { lo: c, hi: c });
        };
        let nothing = || (Bounds::EMPTY, Bounds::EMPTY);
        let (bounds, centroids) = fold(prims, nothing, add, |a, b| (a.0.union(&b.0), a.1.union(&b.1)));
        Range { prims, bounds, centroids }
    }

    fn is_too_large(&self) -> bool {
        self.prims.len() > BLOCK_SIZE
    }

    fn split(self, free: bool) -> [Range<'a>; 2] {
        let middle = self.prims.len() / 2;
        let best = if free { self.best_split() } else { None };
        let at = match best {
            Some(split) => partition(self.prims, |p| split.bin_of(p) < split.bin),
            None if !free => {
                let axis = self.longest_axis();
                self.prims.select_nth_unstable_by(middle, |p, q| {
                    centroid(p)[axis].total_cmp(&centroid(q)[axis]).then(p.id.cmp(&q.id))
                });
                middle
            }
            // All centroids are equal, so any split is equally good.
            None => middle,
        };
        let (left, right) = self.prims.split_at_mut(at);
        [Range::of(left), Range::of(right)]
    }

    fn longest_axis(&self) -> usize {
        let side = |a: &usize| self.centroids.hi[*a] - self.centroids.lo[*a];
        (0..3).max_by(|a, b| side(a).total_cmp(&side(b))).unwrap_or(0)
    }

    fn best_split(&self) -> Option<BinSplit> {
        let bins = if self.prims.len() < 64 { MAX_BINS / 2 } else { MAX_BINS };
        let axes = [0, 1, 2].map(|axis| BinSplit {
            axis,
            origin: self.centroids.lo[axis],
            scale: bins as f32 * 0.999_99 / (self.centroids.hi[axis] - self.centroids.lo[axis]),
            bin: 0,
            last: bins - 1,
        });
        let histogram = Histogram::of(self.prims, &axes);
        let mut best: Option<(f32, BinSplit)> = None;
        for split in axes.into_iter().filter(|s| s.scale.is_finite()) {
            if let Some((cost, bin)) = histogram.best_bin(split.axis, bins)
                && best.is_none_or(|(c, _)| cost < c)
            {
                best = Some((cost, BinSplit { bin, ..split }));
            }
        }
        best.map(|(_, split)| split)
    }
}

#[inline(always)]
fn centroid(p: &Prim) -> [f32; 3] {
    [p.lo[0] + p.hi[0], p.lo[1] + p.hi[1], p.lo[2] + p.hi[2]]
}

/// A split by bins: those below `bin` on one side, the others on the other.
#[derive(Clone, Copy)]
struct BinSplit {
    axis: usize,
    origin: f32,
    scale: f32,
    bin: usize,
    last: usize,
}

impl BinSplit {
    #[inline(always)]
    fn bin_of(&self, p: &Prim) -> usize {
        (((p.lo[self.axis] + p.hi[self.axis] - self.origin) * self.scale) as usize).min(self.last)
    }
}

struct Histogram([[(u32, Bounds); MAX_BINS]; 3]);

impl Histogram {
    fn of(prims: &[Prim], axes: &[BinSplit; 3]) -> Box<Histogram> {
        let add = |h: &mut Box<Histogram>, p: &Prim| {
            let b = Bounds { lo: p.lo, hi: p.hi };
            for (bins, split) in h.0.iter_mut().zip(axes) {
                let bin = &mut bins[split.bin_of(p)];
                *bin = (bin.0 + 1, bin.1.union(&b));
            }
        };
        let plus = |mut a: Box<Histogram>, b: Box<Histogram>| {
            for (a, b) in a.0.as_flattened_mut().iter_mut().zip(b.0.as_flattened()) {
                *a = (a.0 + b.0, a.1.union(&b.1));
            }
            a
        };
        fold(prims, || Box::new(Histogram([[(0, Bounds::EMPTY); MAX_BINS]; 3])), add, plus)
    }

    /// Returns cost and number of the bin before which to split; `None` when all primitives are in one bin.
    fn best_bin(&self, axis: usize, bins: usize) -> Option<(f32, usize)> {
        let bin = &self.0[axis];
        let blocks = |n: u32| n.next_multiple_of(BLOCK_SIZE as u32) as f32;
        let mut above = [(0u32, 0.0f32); MAX_BINS];
        let (mut count, mut bounds) = (0, Bounds::EMPTY);
        for i in (1..bins).rev() {
            (count, bounds) = (count + bin[i].0, bounds.union(&bin[i].1));
            above[i] = (count, bounds.area());
        }
        let (mut count, mut bounds) = (0, Bounds::EMPTY);
        let mut best = None;
        for i in 1..bins {
            (count, bounds) = (count + bin[i - 1].0, bounds.union(&bin[i - 1].1));
            let cost = bounds.area() * blocks(count) + above[i].1 * blocks(above[i].0);
            if count > 0 && above[i].0 > 0 && best.is_none_or(|(c, _)| cost < c) {
                best = Some((cost, i));
            }
        }
        best
    }
}

/// Moves the primitives that `is_left` selects to the front and returns their number.
fn partition(prims: &mut [Prim], is_left: impl Fn(&Prim) -> bool) -> usize {
    let mut left = 0;
    for i in 0..prims.len() {
        if is_left(&prims[i]) {
            prims.swap(left, i);
            left += 1;
        }
    }
    left
}

/// A child of a node.
#[derive(Clone, Copy)]
struct Child {
    bounds: Bounds,
    /// Number of primitives of a block; 0 for a node.
    size: u32,
}

/// A node and everything below it. Until all is known a node takes 28 bytes per child, a [`WideNode`] 448;
/// what threads have allocated stays in their heaps after it is freed.
#[derive(Default)]
struct Part {
    /// Number of children of each node, every node before those below it.
    counts: Vec<u8>,
    /// The children of all nodes, in the same order.
    children: Vec<Child>,
    /// The nodes below the first one, if threads have built them separately.
    separate: Vec<Part>,
}

/// Facts about a finished part.
struct Built {
    /// Areas are half surfaces.
    sums: Sums,
    bounds: Bounds,
}

/// Appends the node over these ranges and its descendants to a part.
fn build_node(mut ranges: Vec<Range>, depth: u32, delegate: usize, part: &mut Part) -> Built {
    while ranges.len() < BLOCK_SIZE
        && let Some(widest) = widest(&ranges)
    {
        let parts = ranges.remove(widest).split(depth < MAX_FREE_DEPTH);
        ranges.splice(widest..widest, parts);
    }
    let count: usize = ranges.iter().map(|r| r.prims.len()).sum();
    let bounds = ranges.iter().fold(Bounds::EMPTY, |b, r| b.union(&r.bounds));
    part.counts.push(ranges.len() as u8);
    part.children.extend(
        ranges.iter().map(|r| Child {
            bounds: r.bounds,
            size: if r.is_too_large() { 0 } else { r.prims.len() as u32 },
        }),
    );
    let mut sums = Sums::ZERO;
    if count >= delegate.max(MIN_SHARED_PRIMITIVES) {
        let build = |r: Range| {
            if !r.is_too_large() {
                return (leaf(&r, depth + 1), None);
            }
            let mut separate = Part::default();
            let built = build_node(vec![r], depth + 1, delegate, &mut separate);
            separate.counts.shrink_to_fit();
            separate.children.shrink_to_fit();
            (built.sums, Some(separate))
        };
        let below: Vec<(Sums, Option<Part>)> = ranges.into_par_iter().map(build).collect();
        for (of_child, separate) in below {
            sums = sums.plus(of_child);
            part.separate.extend(separate);
        }
    } else {
        for range in ranges {
            sums = sums.plus(match range.is_too_large() {
                true => build_node(vec![range], depth + 1, delegate, part).sums,
                false => leaf(&range, depth + 1),
            });
        }
    }
    if count > 0 {
        sums = sums.plus(Sums::interior(f64::from(bounds.area())));
    }
    Built { sums, bounds }
}

/// Returns the index of the range of largest surface among those that do not fit into a block.
fn widest(ranges: &[Range]) -> Option<usize> {
    let candidates = ranges.iter().enumerate().filter(|(_, r)| r.is_too_large());
    candidates.max_by(|a, b| a.1.bounds.area().total_cmp(&b.1.bounds.area())).map(|(i, _)| i)
}

/// Returns the sums of a block.
fn leaf(range: &Range, depth: u32) -> Sums {
    Sums::leaf(f64::from(range.bounds.area()), range.prims.len(), depth)
}

impl Part {
    /// Numbers of nodes and of blocks.
    fn size(&self) -> [usize; 2] {
        let own = [self.counts.len(), self.children.iter().filter(|child| child.size > 0).count()];
        self.separate.iter().map(Part::size).fold(own, |[a, b], [c, d]| [a + c, b + d])
    }
}

/// The nodes of a part that have not been visited.
struct Rest<'p> {
    counts: std::slice::Iter<'p, u8>,
    children: &'p [Child],
    separate: std::slice::Iter<'p, Part>,
}

impl WideTree {
    /// Numbers the nodes and blocks of a part: a node before its children, and each child with everything
    /// below it before the next.
    fn of(part: &Part) -> WideTree {
        let [nodes, blocks] = part.size();
        let mut tree = WideTree { nodes: Vec::with_capacity(nodes), sizes: Vec::with_capacity(blocks) };
        tree.add_part(part);
        tree
    }

    fn add_part(&mut self, part: &Part) {
        self.add_node(&mut Rest {
            counts: part.counts.iter(),
            children: &part.children,
            separate: part.separate.iter(),
        });
    }

    /// Adds the next node of a part and everything below it.
    fn add_node(&mut self, rest: &mut Rest) {
        let count = rest.counts.next().copied().map_or(0, usize::from);
        let (children, others) = rest.children.split_at(count);
        rest.children = others;
        let number = self.nodes.len();
        self.nodes.push(WideNode::EMPTY);
        for (lane, Child { bounds, size }) in children.iter().enumerate() {
            let child = match size {
                0 => WideChild::node(self.nodes.len()),
                _ => WideChild::block(self.sizes.len()),
            };
            self.nodes[number].set(lane, bounds.lo, bounds.hi, child);
            if *size > 0 {
                self.sizes.push(*size as u8);
            } else if let Some(part) = rest.separate.next() {
                self.add_part(part);
            } else {
                self.add_node(rest);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::Builder;
    use vlscan_geom::{Aabb, DVec3};

    /// Boxes of different sizes at places that repeat after 4099.
    fn prims(count: u32) -> Vec<Prim> {
        let prim = |id: u32| {
            let lo = [7919, 104_729, 1_299_709].map(|step| (id.wrapping_mul(step) % 4099) as f32);
            Prim { lo, id, hi: lo.map(|x| x + (id % 5) as f32) }
        };
        (0..count).map(prim).collect()
    }

    #[test]
    fn blocks_divide_the_primitives_in_their_order_for_any_number_of_threads() {
        let frame = Frame::around(&Aabb { min: DVec3::ZERO, max: DVec3::splat(5000.0) });
        for count in [0, 1, 16, 17, 1000, 40_000] {
            let built = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let (mut all, options) = (prims(count), BuildOptions::of(Builder::Bvh));
                let (tree, _) = pool.install(|| build_wide(count as usize, &frame, &mut all, &options));
                (tree, all)
            };
            let ((tree, all), (other, same)) = (built(1), built(3));
            assert!(tree.nodes == other.nodes && tree.sizes == other.sizes, "{count}");
            assert!(all.iter().zip(&same).all(|(a, b)| a.id == b.id), "{count}");
            let ends = tree.sizes.iter().scan(0, |end, size| {
                *end += usize::from(*size);
                Some(*end)
            });
            let ends: Vec<usize> = ends.collect();
            assert_eq!(ends.last().copied().unwrap_or(0), count as usize);
            let mut seen = 0;
            for (node, lane) in tree.nodes.iter().flat_map(|node| (0..BLOCK_SIZE).map(move |l| (node, l))) {
                let Err(block) = node.child[lane].number() else { continue };
                let own = &all[ends[block] - usize::from(tree.sizes[block])..ends[block]];
                let is_within = |p: &Prim| {
                    (0..3).all(|a| node.lower[a][lane] <= p.lo[a] && p.hi[a] <= node.upper[a][lane])
                };
                assert!(own.iter().all(is_within), "{count}: block {block}");
                seen += 1;
            }
            assert_eq!(seen, tree.sizes.len(), "{count}");
        }
    }
}
