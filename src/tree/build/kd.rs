//! The recursion that all kd builders share (spec §1.3), on one or several threads.

use super::ledger::{Ledger, Proposal, Sums};
use super::prim::Prim;
use super::split::{Cell, Search, Split, count, partition};
use super::{Arena, KdArena};
use crate::tree::Geometry;
use crate::tree::block::append_leaf;
use crate::tree::frame::Frame;
use crate::tree::node::KdNode;
use crate::tree::options::{Accounting, Axes, BuildOptions, Builder, Statistics};

/// Builds a kd-tree over `prims`. The tree is the same for any number of threads.
pub(crate) fn build_kd(
    geometry: &Geometry,
    frame: Frame,
    prims: Vec<Prim>,
    options: &BuildOptions,
) -> (KdArena, Statistics) {
    let (count, root) = (prims.len(), Cell::around(&prims));
    let build = Build { search: Search { geometry, frame, options }, max_depth: depth_cap(options, count) };
    let mut arena = Arena { nodes: vec![KdNode::leaf(0, 0)], slots: Vec::new() };
    let mut ledger = match options.accounting {
        Accounting::Local => Ledger::Local,
        Accounting::Global => Ledger::global(options, root.area, count),
    };
    let sums = build.node(&mut ledger, prims, root, 0, &mut arena, 0);
    let square_metres = root.area / frame.scale / frame.scale;
    (arena, sums.statistics(options, count, root.area, square_metres))
}

/// Levels below the root that any tree may have; traversal stacks rely on it.
pub(crate) const DEEPEST: u32 = 64;

fn depth_cap(options: &BuildOptions, count: usize) -> u32 {
    let auto = 8 + (1.3 * libm::log2(count.max(1) as f64)) as u32;
    options.max_depth.unwrap_or(auto).min(DEEPEST)
}

struct Build<'a> {
    search: Search<'a>,
    max_depth: u32,
}

impl Build<'_> {
    /// Builds the node at `slot` of the arena and everything below it.
    fn node(
        &self,
        ledger: &mut Ledger,
        prims: Vec<Prim>,
        cell: Cell,
        depth: u32,
        arena: &mut KdArena,
        slot: usize,
    ) -> Sums {
        let Some((split, [left, right])) = self.accepted_split(ledger, &prims, &cell, depth) else {
            return self.leaf(&prims, &cell, depth, arena, slot);
        };
        drop(prims);
        let child = arena.nodes.len();
        arena.nodes[slot] = KdNode::interior(split.axis, split.position as f32, child);
        arena.nodes.extend([KdNode::leaf(0, 0); 2]);
        let [l, r] = cell.cut(&split);
        let parallel = matches!(ledger, Ledger::Local) && left.len().min(right.len()) >= self.grain();
        let (a, b) = if parallel {
            let ((one, a), (two, b)) =
                rayon::join(|| self.apart(left, l, depth + 1), || self.apart(right, r, depth + 1));
            attach(arena, child, one);
            attach(arena, child + 1, two);
            (a, b)
        } else {
            let a = self.node(ledger, left, l, depth + 1, arena, child);
            (a, self.node(ledger, right, r, depth + 1, arena, child + 1))
        };
        Sums::interior(cell.area, a, b)
    }

    /// Smallest part worth an own arena.
    fn grain(&self) -> usize {
        self.search.options.delegate.max(32)
    }

    /// The same in an arena of its own.
    fn apart(&self, prims: Vec<Prim>, cell: Cell, depth: u32) -> (KdArena, Sums) {
        let mut arena = Arena { nodes: vec![KdNode::leaf(0, 0)], slots: Vec::new() };
        let sums = self.node(&mut Ledger::Local, prims, cell, depth, &mut arena, 0);
        (arena, sums)
    }

    fn leaf(&self, prims: &[Prim], cell: &Cell, depth: u32, arena: &mut KdArena, slot: usize) -> Sums {
        if prims.is_empty() {
            return Sums::NOTHING;
        }
        let first = arena.slots.len() / crate::tree::block::LANES;
        let triangles = self.search.geometry.triangles.len();
        let blocks = append_leaf(&mut arena.slots, triangles, prims.iter().map(|p| p.id));
        arena.nodes[slot] = KdNode::leaf(first, blocks);
        Sums::leaf(cell.area, prims.len(), depth)
    }

    /// The split of this node and its two sides, if there is one worth making.
    fn accepted_split(
        &self,
        ledger: &mut Ledger,
        prims: &[Prim],
        cell: &Cell,
        depth: u32,
    ) -> Option<(Split, [Vec<Prim>; 2])> {
        let options = self.search.options;
        if prims.len() < options.min_primitives.max(2) || depth >= self.max_depth {
            return None;
        }
        let turn = depth as usize;
        let worth_making = |split: Split| {
            let counts = count(prims, split.axis, split.position);
            self.accepts(ledger, cell, &split, prims.len(), counts)
                .then(|| (split, partition(prims, &split, counts)))
        };
        let on = |axis: usize| self.search.on_axis(prims, cell, axis % 3);
        match options.axes {
            _ if options.builder == Builder::AxisSah => {
                self.search.on_best_axis(prims, cell).and_then(worth_making)
            }
            Axes::Best => self.search.on_best_axis(prims, cell).and_then(worth_making),
            Axes::Turn => on(turn).and_then(worth_making),
            Axes::TurnThenNext => (turn..turn + 3).filter_map(on).find_map(worth_making),
        }
    }

    fn accepts(
        &self,
        ledger: &mut Ledger,
        cell: &Cell,
        split: &Split,
        n: usize,
        [nl, nr]: [usize; 2],
    ) -> bool {
        if self.search.options.builder == Builder::Median {
            return nl != n && nr != n;
        }
        let chances = self.search.chances(cell, split.axis, split.r);
        ledger.accepts(self.search.options, &Proposal { area: cell.area, chances, counts: [n, nl, nr] })
    }
}

/// Puts a part, whose root is its node 0, in the place of node `slot`.
fn attach(arena: &mut KdArena, slot: usize, part: KdArena) {
    // The part's node 1 becomes the next node here.
    let (nodes, blocks) = (arena.nodes.len() - 1, arena.slots.len() / crate::tree::block::LANES);
    arena.nodes[slot] = part.nodes[0].moved(nodes, blocks);
    arena.nodes.extend(part.nodes[1..].iter().map(|n| n.moved(nodes, blocks)));
    arena.slots.extend(part.slots);
}
