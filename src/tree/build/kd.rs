//! The recursion that all kd builders share (spec §1.3), on one or several threads.

use super::ledger::{Ledger, Proposal, Sums};
use super::prim::Prim;
use super::split::{Cell, Search, Split, count, partition};
use super::{Arena, KdArena, crew};
use crate::tree::Geometry;
use crate::tree::block::append_leaf;
use crate::tree::frame::Frame;
use crate::tree::node::KdNode;
use crate::tree::options::{Accounting, Axes, BuildOptions, Builder, Statistics};

/// Builds a kd-tree over `prims`. The tree is the same for any number of threads, and with [`Accounting::Global`] nearly.
pub(crate) fn build_kd(
    geometry: &Geometry,
    frame: Frame,
    prims: Vec<Prim>,
    options: &BuildOptions,
) -> (KdArena, Statistics) {
    let (count, root) = (prims.len(), Cell::around(&prims));
    let build = Build {
        search: Search { geometry, frame, options },
        max_depth: depth_cap(options, count),
        ledger: match options.accounting {
            // A flat root has no cost to book.
            Accounting::Global if root.area > 0.0 && options.builder != Builder::Median => {
                Ledger::global(options, root.area, count)
            }
            _ => Ledger::Local,
        },
        geometry_jobs: match options.geometry_jobs {
            0 => rayon::current_num_threads(),
            n => n,
        },
    };
    let mut arena = Arena { nodes: vec![KdNode::leaf(0, 0)], slots: Vec::new() };
    let sums = build.node(prims, root, 0, &mut arena, 0);
    let square_metres = root.area / frame.scale / frame.scale;
    let mut statistics = sums.statistics(options, count, root.area, square_metres);
    statistics.booked_cost = build.ledger.total();
    (arena, statistics)
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
    ledger: Ledger,
    geometry_jobs: usize,
}

impl Build<'_> {
    /// Builds the node at `slot` of the arena and everything below it.
    fn node(&self, prims: Vec<Prim>, cell: Cell, depth: u32, arena: &mut KdArena, slot: usize) -> Sums {
        let Some((split, [left, right])) = self.accepted_split(&prims, &cell, depth) else {
            return self.leaf(&prims, &cell, depth, arena, slot);
        };
        drop(prims);
        let child = arena.nodes.len();
        arena.nodes[slot] = KdNode::interior(split.axis, split.position as f32, child);
        arena.nodes.extend([KdNode::leaf(0, 0); 2]);
        let [l, r] = cell.cut(&split);
        let (a, b) = if left.len().min(right.len()) >= self.grain() {
            // Parts of their own also where one thread builds them one after the other, so that nodes are numbered alike.
            let left = || self.apart(left, l, depth + 1);
            let right = || self.apart(right, r, depth + 1);
            let ((one, a), (two, b)) =
                if self.search.options.jobs == 1 { (left(), right()) } else { rayon::join(left, right) };
            attach(arena, child, one);
            attach(arena, child + 1, two);
            (a, b)
        } else {
            let a = self.node(left, l, depth + 1, arena, child);
            (a, self.node(right, r, depth + 1, arena, child + 1))
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
        let sums = self.node(prims, cell, depth, &mut arena, 0);
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
    fn accepted_split(&self, prims: &[Prim], cell: &Cell, depth: u32) -> Option<(Split, [Vec<Prim>; 2])> {
        let options = self.search.options;
        if prims.len() < options.min_primitives.max(2) || depth >= self.max_depth {
            return None;
        }
        let turn = depth as usize;
        let crew = crew(prims, self.geometry_jobs.checked_shr(depth).unwrap_or(0));
        let worth_making = |split: Split| {
            let counts = count(crew, prims, split.axis, split.position);
            self.accepts(cell, &split, prims.len(), counts)
                .then(|| (split, partition(crew, prims, &split, counts)))
        };
        let on = |axis: usize| self.search.on_axis(crew, prims, cell, axis % 3);
        match options.axes {
            _ if options.builder == Builder::AxisSah => {
                self.search.on_best_axis(crew, prims, cell).and_then(worth_making)
            }
            Axes::Best => self.search.on_best_axis(crew, prims, cell).and_then(worth_making),
            Axes::Turn => on(turn).and_then(worth_making),
            Axes::TurnThenNext => (turn..turn + 3).filter_map(on).find_map(worth_making),
        }
    }

    fn accepts(&self, cell: &Cell, split: &Split, n: usize, [nl, nr]: [usize; 2]) -> bool {
        if self.search.options.builder == Builder::Median {
            return nl != n && nr != n;
        }
        let chances = self.search.chances(cell, split.axis, split.r);
        self.ledger.accepts(self.search.options, &Proposal { area: cell.area, chances, counts: [n, nl, nr] })
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
