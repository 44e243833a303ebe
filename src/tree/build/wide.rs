//! The wide bounding volume hierarchy: sixteen children per node, exactly one block per leaf, no primitive twice.
//!
//! A node starts as one range of primitives and splits the range of largest surface, as long as there are fewer than
//! sixteen and one does not fit into a block. Splits are the best of 32 bins of centroids per axis; what counts is the
//! number of blocks, not of primitives, so blocks come out nearly full.

use super::prim::Prim;
use super::{Arena, fold};
use crate::tree::block::LANES;
use crate::tree::frame::Frame;
use crate::tree::node::{WideChild, WideNode};
use crate::tree::options::{BuildOptions, Statistics};
use rayon::prelude::*;

/// Nodes below this depth split in the middle, so that no tree gets deeper than [`DEEPEST_WIDE`].
const FREE_DEPTH: u32 = 24;

/// Levels below the root that any tree may have: after [`FREE_DEPTH`], 16^8 primitives.
pub(crate) const DEEPEST_WIDE: u32 = FREE_DEPTH + 8;

/// Nodes of fewer primitives are built by one thread.
const FEW: usize = 4096;

const BINS: usize = 32;

/// Builds the hierarchy over `prims`. The tree is the same for any number of threads.
pub(crate) fn build_wide(
    triangles: usize,
    frame: &Frame,
    mut prims: Vec<Prim>,
    options: &BuildOptions,
) -> (Arena<WideNode>, Statistics) {
    // Blocks hold one kind only, so the kinds part at the root; they come in this order.
    let kinds = prims.iter().position(|p| p.id as usize >= triangles).unwrap_or(prims.len());
    let (one, other) = prims.split_at_mut(kinds);
    let ranges = [one, other].into_iter().filter(|r| !r.is_empty()).map(Range::of).collect();
    let whole = Bounds::of(&[]);
    let mut part = build_node(ranges, 0, options.delegate);
    let root = part.sums.bounds.unwrap_or(whole);
    let count = part.sums.primitives;
    let area = f64::from(root.area());
    let metres = 1.0 / frame.scale;
    let s = &part.sums;
    let cost = options.cost_interior * s.area_interior
        + options.cost_leaf * s.area_leaves
        + options.cost_primitive * s.area_primitives;
    let statistics = Statistics {
        primitives: count,
        references: count,
        interior: s.interior,
        leaves: s.leaves,
        max_depth: s.depth,
        max_leaf: s.max_leaf,
        min_leaf: s.min_leaf,
        root_area: 2.0 * area * metres * metres,
        cost: if area > 0.0 {
            cost / area
        } else {
            options.cost_leaf + options.cost_primitive * count as f64
        },
        booked_cost: None,
    };
    if part.arena.nodes.is_empty() {
        part.arena.nodes.push(WideNode::EMPTY);
    }
    (part.arena, statistics)
}

/// A box in the tree's frame.
#[derive(Clone, Copy)]
struct Bounds {
    lo: [f32; 3],
    hi: [f32; 3],
}

impl Bounds {
    const NOTHING: Bounds = Bounds { lo: [f32::INFINITY; 3], hi: [f32::NEG_INFINITY; 3] };

    fn of(prims: &[Prim]) -> Bounds {
        prims.iter().fold(Bounds::NOTHING, |b, p| b.union(&Bounds { lo: p.lo, hi: p.hi }))
    }

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

    /// Half the surface; 0 for nothing.
    fn area(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|a| (self.hi[a] - self.lo[a]).max(0.0));
        x * y + x * z + y * z
    }
}

/// Primitives that belong together so far.
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
        let nothing = || (Bounds::NOTHING, Bounds::NOTHING);
        let (bounds, centroids) = fold(prims, nothing, add, |a, b| (a.0.union(&b.0), a.1.union(&b.1)));
        Range { prims, bounds, centroids }
    }

    fn is_full(&self) -> bool {
        self.prims.len() > LANES
    }

    /// Both parts of the best split.
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
            // All centroids are equal: any split is as good.
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
        let bins = if self.prims.len() < 64 { BINS / 2 } else { BINS };
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

/// Twice the centroid.
#[inline(always)]
fn centroid(p: &Prim) -> [f32; 3] {
    [p.lo[0] + p.hi[0], p.lo[1] + p.hi[1], p.lo[2] + p.hi[2]]
}

/// Bins below `bin` on one side, the others on the other.
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

/// Counts and boxes by axis and bin.
struct Histogram([[(u32, Bounds); BINS]; 3]);

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
        fold(prims, || Box::new(Histogram([[(0, Bounds::NOTHING); BINS]; 3])), add, plus)
    }

    /// Cost and number of the bin before which to split; `None` when all primitives are in one bin.
    fn best_bin(&self, axis: usize, bins: usize) -> Option<(f32, usize)> {
        let bin = &self.0[axis];
        let blocks = |n: u32| n.next_multiple_of(LANES as u32) as f32;
        let mut above = [(0u32, 0.0f32); BINS];
        let (mut count, mut bounds) = (0, Bounds::NOTHING);
        for i in (1..bins).rev() {
            (count, bounds) = (count + bin[i].0, bounds.union(&bin[i].1));
            above[i] = (count, bounds.area());
        }
        let (mut count, mut bounds) = (0, Bounds::NOTHING);
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

/// Brings the primitives that `is_left` chooses to the front and returns their number.
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

/// A finished part of the tree; its root is the arena's first node.
struct Part {
    arena: Arena<WideNode>,
    sums: Sums,
}

/// Sums over a part; areas are half surfaces.
#[derive(Clone, Copy)]
struct Sums {
    bounds: Option<Bounds>,
    area_interior: f64,
    area_leaves: f64,
    area_primitives: f64,
    primitives: usize,
    interior: usize,
    leaves: usize,
    depth: u32,
    max_leaf: usize,
    min_leaf: usize,
}

/// Builds the node over these ranges and all below it.
fn build_node(mut ranges: Vec<Range>, depth: u32, delegate: usize) -> Part {
    while ranges.len() < LANES
        && let Some(widest) = widest(&ranges)
    {
        let parts = ranges.remove(widest).split(depth < FREE_DEPTH);
        ranges.splice(widest..widest, parts);
    }
    let count: usize = ranges.iter().map(|r| r.prims.len()).sum();
    let bounds = ranges.iter().fold(Bounds::NOTHING, |b, r| b.union(&r.bounds));
    let boxes: Vec<Bounds> = ranges.iter().map(|r| r.bounds).collect();
    let build =
        |r: Range| if r.is_full() { build_node(vec![r], depth + 1, delegate) } else { leaf(&r, depth + 1) };
    let parts: Vec<Part> = if count >= delegate.max(FEW) {
        ranges.into_par_iter().map(build).collect()
    } else {
        ranges.into_iter().map(build).collect()
    };
    let mut sums = Sums::NOTHING;
    let mut arena = Arena { nodes: vec![WideNode::EMPTY], slots: Vec::new() };
    for (lane, (part, b)) in parts.into_iter().zip(boxes).enumerate() {
        let (nodes, blocks) = (arena.nodes.len(), arena.slots.len() / LANES);
        let child =
            if part.arena.nodes.is_empty() { WideChild::block(blocks) } else { WideChild::node(nodes) };
        arena.nodes[0].set(lane, b.lo, b.hi, child);
        arena.nodes.extend(part.arena.nodes.into_iter().map(|n| moved(n, nodes, blocks)));
        arena.slots.extend(part.arena.slots);
        sums = sums.with(&part.sums);
    }
    if count > 0 {
        sums.interior += 1;
        sums.area_interior += f64::from(bounds.area());
        sums.bounds = Some(bounds);
    }
    Part { arena, sums }
}

/// The range of largest surface among those that do not fit into a block.
fn widest(ranges: &[Range]) -> Option<usize> {
    let candidates = ranges.iter().enumerate().filter(|(_, r)| r.is_full());
    candidates.max_by(|a, b| a.1.bounds.area().total_cmp(&b.1.bounds.area())).map(|(i, _)| i)
}

/// A block; it has no node of its own.
fn leaf(range: &Range, depth: u32) -> Part {
    let mut slots: Vec<u32> = range.prims.iter().map(|p| p.id).collect();
    let count = slots.len();
    slots.resize(LANES, crate::tree::Hits::MISS);
    let area = f64::from(range.bounds.area());
    let sums = Sums {
        bounds: Some(range.bounds),
        area_leaves: area,
        area_primitives: area * count as f64,
        primitives: count,
        leaves: 1,
        depth,
        max_leaf: count,
        min_leaf: count,
        ..Sums::NOTHING
    };
    Part { arena: Arena { nodes: Vec::new(), slots }, sums }
}

fn moved(mut node: WideNode, nodes: usize, blocks: usize) -> WideNode {
    node.child = node.child.map(|c| c.moved(nodes, blocks));
    node
}

impl Sums {
    const NOTHING: Sums = Sums {
        bounds: None,
        area_interior: 0.0,
        area_leaves: 0.0,
        area_primitives: 0.0,
        primitives: 0,
        interior: 0,
        leaves: 0,
        depth: 0,
        max_leaf: 0,
        min_leaf: 0,
    };

    fn with(self, part: &Sums) -> Sums {
        Sums {
            bounds: None,
            area_interior: self.area_interior + part.area_interior,
            area_leaves: self.area_leaves + part.area_leaves,
            area_primitives: self.area_primitives + part.area_primitives,
            primitives: self.primitives + part.primitives,
            interior: self.interior + part.interior,
            leaves: self.leaves + part.leaves,
            depth: self.depth.max(part.depth),
            max_leaf: self.max_leaf.max(part.max_leaf),
            min_leaf: if self.leaves == 0 { part.min_leaf } else { self.min_leaf.min(part.min_leaf) },
        }
    }
}
