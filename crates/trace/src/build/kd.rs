//! The recursion shared by all kd builders (spec tree-and-schedule §1.3), on one or several threads.

use super::cost::{CostAccount, Proposal, Sums};
use super::prim::Prim;
use super::split::{Cell, Search, Split, count, partition};
use super::{KdArena, MIN_TEAM_PRIMITIVES};
use crate::Geometry;
use crate::block::{BLOCK_SIZE, append_leaf};
use crate::frame::Frame;
use crate::node::KdNode;
use crate::options::{Accounting, Axes, BuildOptions, Builder, Statistics};

/// Builds a kd-tree over `prims`. The result does not depend on the number of threads; with
/// [`Accounting::Global`] it does in rare cases.
pub(crate) fn build_kd(
    geometry: &Geometry,
    frame: Frame,
    prims: Vec<Prim>,
    options: &BuildOptions,
) -> (KdArena, Statistics) {
    let geometry_jobs = match options.geometry_jobs {
        0 => rayon::current_num_threads(),
        n => n,
    };
    let (count, root) =
        (prims.len(), Cell::around(threads_for(prims.len(), Position::ROOT, geometry_jobs), &prims));
    let build = Build {
        search: Search { geometry, frame, options },
        max_depth: depth_cap(options, count),
        shared_depth: shared_depth(options),
        account: match options.accounting {
            // The cost is relative to the area of the root, which is zero for a flat root.
            Accounting::Global if root.area > 0.0 && options.builder != Builder::Median => {
                CostAccount::global(options, root.area, count)
            }
            _ => CostAccount::Local,
        },
        geometry_jobs,
    };
    let mut arena = KdArena { nodes: vec![KdNode::leaf(0, 0)], slots: Vec::new() };
    let sums = build.build_node(prims, root, Position::ROOT, &mut arena, 0);
    let square_metres = root.area / frame.scale / frame.scale;
    let mut statistics = sums.statistics(options, count, root.area, square_metres);
    statistics.booked_cost = build.account.total();
    (arena, statistics)
}

/// Maximum depth of any tree; traversal stacks rely on it.
pub(crate) const MAX_DEPTH: u32 = 64;

fn depth_cap(options: &BuildOptions, count: usize) -> u32 {
    let auto = 8 + (1.3 * libm::log2(count.max(1) as f64)) as u32;
    options.max_depth.unwrap_or(auto).min(MAX_DEPTH)
}

/// Depth down to which threads steal nodes from one another: enough for some hundred parts per thread.
/// Further down, handing a node over would only copy the part once more.
fn shared_depth(options: &BuildOptions) -> u32 {
    match options.jobs {
        0 => rayon::current_num_threads().ilog2() + 8,
        1 => 0,
        n => n.ilog2() + 8,
    }
}

/// Position of a node: its depth, and its number from the left among the 2^depth possible nodes of that
/// depth.
#[derive(Clone, Copy)]
struct Position {
    depth: u32,
    number: u128,
}

impl Position {
    const ROOT: Position = Position { depth: 0, number: 0 };

    fn below(self) -> [Position; 2] {
        [0, 1].map(|side| Position { depth: self.depth + 1, number: 2 * self.number + side })
    }

    /// Returns how many of `threads` are assigned to the node. They are divided evenly among the nodes of a
    /// level, and the right-most node gets the remainder; below level ⌊log2 threads⌋ every node has one (spec
    /// tree-and-schedule §2.3).
    fn share_of(self, threads: usize) -> usize {
        let (nodes, threads) = (1u128 << self.depth, threads as u128);
        let (each, rest) = (threads / nodes, threads % nodes);
        let surplus = u128::from(self.number >= nodes - rest);
        ((each + surplus) as usize).max(1)
    }
}

/// Returns how many of `threads` work together on a node of `count` primitives.
fn threads_for(count: usize, position: Position, threads: usize) -> usize {
    if count < MIN_TEAM_PRIMITIVES { 1 } else { position.share_of(threads) }
}

struct Build<'a> {
    search: Search<'a>,
    max_depth: u32,
    /// Nodes below this depth are built by the thread that reaches them.
    shared_depth: u32,
    account: CostAccount,
    geometry_jobs: usize,
}

impl Build<'_> {
    /// Builds the node at `slot` of the arena and its descendants.
    fn build_node(
        &self,
        prims: Vec<Prim>,
        cell: Cell,
        position: Position,
        arena: &mut KdArena,
        slot: usize,
    ) -> Sums {
        let Some((split, [left, right])) = self.accepted_split(&prims, &cell, position) else {
            return self.leaf(&prims, &cell, position.depth, arena, slot);
        };
        drop(prims);
        let child = arena.nodes.len();
        arena.nodes[slot] = KdNode::interior(split.axis, split.position as f32, child);
        arena.nodes.extend([KdNode::leaf(0, 0); 2]);
        let ([l, r], [to_left, to_right]) = (cell.cut(&split), position.below());
        let is_shared =
            position.depth < self.shared_depth && left.len().min(right.len()) >= self.min_detached();
        let (a, b) = if is_shared {
            let lower = || self.build_node(left, l, to_left, arena, child);
            let upper = || self.build_detached(right, r, to_right);
            let (a, (part, b)) = rayon::join(lower, upper);
            attach(arena, child + 1, part);
            (a, b)
        } else {
            let a = self.build_node(left, l, to_left, arena, child);
            (a, self.build_node(right, r, to_right, arena, child + 1))
        };
        Sums::interior(cell.area).plus(a).plus(b)
    }

    /// Minimum number of primitives of a part that another thread builds in a separate arena.
    fn min_detached(&self) -> usize {
        self.search.options.delegate.max(32)
    }

    /// Builds a node and its descendants in a separate arena. After [`attach`] its nodes have the numbers
    /// that they would have had in the common arena.
    fn build_detached(&self, prims: Vec<Prim>, cell: Cell, position: Position) -> (KdArena, Sums) {
        let mut arena = KdArena { nodes: vec![KdNode::leaf(0, 0)], slots: Vec::new() };
        let sums = self.build_node(prims, cell, position, &mut arena, 0);
        (arena, sums)
    }

    fn leaf(&self, prims: &[Prim], cell: &Cell, depth: u32, arena: &mut KdArena, slot: usize) -> Sums {
        if prims.is_empty() {
            return Sums::ZERO;
        }
        let first = arena.slots.len() / BLOCK_SIZE;
        let triangles = self.search.geometry.triangle_count();
        let blocks = append_leaf(&mut arena.slots, triangles, prims.iter().map(|p| p.id));
        arena.nodes[slot] = KdNode::leaf(first, blocks);
        Sums::leaf(cell.area, prims.len(), depth)
    }

    /// Returns the split of this node and its two sides, if a split makes the tree cheaper.
    fn accepted_split(
        &self,
        prims: &[Prim],
        cell: &Cell,
        position: Position,
    ) -> Option<(Split, [Vec<Prim>; 2])> {
        let options = self.search.options;
        if prims.len() < options.min_primitives.max(2) || position.depth >= self.max_depth {
            return None;
        }
        let turn = position.depth as usize;
        let threads = threads_for(prims.len(), position, self.geometry_jobs);
        let try_split = |split: Split| {
            let counts = count(threads, prims, split.axis, split.position);
            self.is_accepted(cell, &split, prims.len(), counts)
                .then(|| (split, partition(threads, prims, &split, counts)))
        };
        let on = |axis: usize| self.search.on_axis(threads, prims, cell, axis % 3);
        match options.axes {
            _ if options.builder == Builder::AxisSah => {
                self.search.on_best_axis(threads, prims, cell).and_then(try_split)
            }
            Axes::Best => self.search.on_best_axis(threads, prims, cell).and_then(try_split),
            Axes::Turn => on(turn).and_then(try_split),
            Axes::TurnThenNext => (turn..turn + 3).filter_map(on).find_map(try_split),
        }
    }

    fn is_accepted(&self, cell: &Cell, split: &Split, n: usize, [nl, nr]: [usize; 2]) -> bool {
        if self.search.options.builder == Builder::Median {
            return nl != n && nr != n;
        }
        let chances = self.search.chances(cell, split.axis, split.r);
        self.account
            .try_split(self.search.options, &Proposal { area: cell.area, chances, counts: [n, nl, nr] })
    }
}

/// Inserts a part, whose root is its node 0, as node `slot`.
fn attach(arena: &mut KdArena, slot: usize, part: KdArena) {
    // The part's node 1 becomes the next node here.
    let (nodes, blocks) = (arena.nodes.len() - 1, arena.slots.len() / BLOCK_SIZE);
    arena.nodes[slot] = part.nodes[0].moved(nodes, blocks);
    arena.nodes.extend(part.nodes[1..].iter().map(|n| n.moved(nodes, blocks)));
    arena.slots.extend(part.slots);
}

#[cfg(test)]
mod tests {
    use super::super::{collect, frame_of};
    use super::*;
    use vlscan_geom::DVec3;

    /// The thread numbers a_i to b_i of spec tree-and-schedule §2.3.
    #[test]
    fn upper_nodes_share_the_threads_as_published() {
        for threads in 1..=40usize {
            for depth in 0..=threads.ilog2() {
                let nodes = 1usize << depth;
                let (alpha, beta) = (threads / nodes, threads % nodes);
                let mut next = 0;
                for i in 0..nodes {
                    let (first, last) = if i < nodes - beta {
                        (i * alpha, (i + 1) * alpha - 1)
                    } else {
                        (i * (alpha + 1) + beta - nodes, i * (alpha + 1) + beta - nodes + alpha)
                    };
                    let position = Position { depth, number: i as u128 };
                    assert_eq!(
                        (first, position.share_of(threads)),
                        (next, last + 1 - first),
                        "{threads} {depth} {i}"
                    );
                    next = last + 1;
                }
                assert_eq!(next, threads);
            }
            let [_, deeper] = Position { depth: 63, number: u128::from(u64::MAX >> 1) }.below();
            assert_eq!(deeper.share_of(threads), 1);
        }
        assert_eq!(
            [MIN_TEAM_PRIMITIVES - 1, MIN_TEAM_PRIMITIVES].map(|n| threads_for(n, Position::ROOT, 5)),
            [1, 5]
        );
    }

    /// Returns a rough sheet of two triangles per cell.
    fn sheet(cells: u32) -> Geometry {
        let mut g = Geometry::default();
        for i in 0..=cells {
            for j in 0..=cells {
                let h = (7 * i * i + 13 * j + i * j) % 97;
                g.vertices.push(DVec3::new(f64::from(i), 1.1 * f64::from(j), 0.3 * f64::from(h)));
            }
        }
        for i in 0..cells {
            for j in 0..cells {
                let a = i * (cells + 1) + j;
                let (b, c, d) = (a + cells + 1, a + 1, a + cells + 2);
                g.triangles.extend([[a, b, d], [a, d, c]]);
            }
        }
        g
    }

    /// With this number of primitives the root is built by five threads together, its children by two and
    /// three; the tree equals that of one thread.
    #[test]
    fn threads_that_share_nodes_build_the_same_tree() {
        let g = sheet(288);
        let frame = frame_of(&g);
        let prims = collect(&g, &frame, |_| true);
        assert!(prims.len() > 5 * MIN_TEAM_PRIMITIVES / 2);
        let children = Position::ROOT.below().map(|position| threads_for(prims.len() / 2, position, 5));
        assert_eq!((threads_for(prims.len(), Position::ROOT, 5), children), (5, [2, 3]));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(5).build().unwrap();
        for builder in [Builder::Median, Builder::Sah, Builder::AxisSah, Builder::Fsah] {
            for strict in [true, false] {
                let base = if strict { BuildOptions::strict(builder) } else { BuildOptions::of(builder) };
                let build = |jobs, geometry_jobs| {
                    let accounting = Accounting::Local;
                    let o = BuildOptions {
                        jobs,
                        geometry_jobs,
                        accounting,
                        candidates: 3,
                        max_depth: Some(4),
                        ..base.clone()
                    };
                    pool.install(|| build_kd(&g, frame, prims.clone(), &o))
                };
                let (alone, statistics) = build(1, 1);
                assert!(statistics.max_depth == 4 && statistics.interior == 15, "{statistics:?}");
                for (jobs, geometry_jobs) in [(1, 5), (5, 1), (5, 5)] {
                    let (tree, s) = build(jobs, geometry_jobs);
                    assert!(tree == alone, "{builder:?}: {jobs} and {geometry_jobs} threads");
                    assert_eq!(s, statistics);
                }
            }
        }
    }
}
