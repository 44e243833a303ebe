//! The recursion that all kd builders share (spec §1.3), on one or several threads.

use super::ledger::{Ledger, Proposal, Sums};
use super::prim::Prim;
use super::split::{Cell, Search, Split, count, partition};
use super::{Arena, KdArena, MANY};
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
    let geometry_jobs = match options.geometry_jobs {
        0 => rayon::current_num_threads(),
        n => n,
    };
    let (count, root) = (prims.len(), Cell::around(crew(prims.len(), Place::ROOT, geometry_jobs), &prims));
    let build = Build {
        search: Search { geometry, frame, options },
        max_depth: depth_cap(options, count),
        shared_depth: shared_depth(options),
        ledger: match options.accounting {
            // A flat root has no cost to book.
            Accounting::Global if root.area > 0.0 && options.builder != Builder::Median => {
                Ledger::global(options, root.area, count)
            }
            _ => Ledger::Local,
        },
        geometry_jobs,
    };
    let mut arena = Arena { nodes: vec![KdNode::leaf(0, 0)], slots: Vec::new() };
    let sums = build.node(prims, root, Place::ROOT, &mut arena, 0);
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

/// Levels whose nodes several threads take from one another: so many that each thread has some hundred parts to choose from.
/// Further down every hand-over would only copy the part once more.
fn shared_depth(options: &BuildOptions) -> u32 {
    match options.jobs {
        0 => rayon::current_num_threads().ilog2() + 8,
        1 => 0,
        n => n.ilog2() + 8,
    }
}

/// Where a node is: its depth, and its number from the left among the 2^depth nodes that may be there.
#[derive(Clone, Copy)]
struct Place {
    depth: u32,
    number: u128,
}

impl Place {
    const ROOT: Place = Place { depth: 0, number: 0 };

    /// The places of the two children.
    fn below(self) -> [Place; 2] {
        [0, 1].map(|side| Place { depth: self.depth + 1, number: 2 * self.number + side })
    }

    /// How many of `threads` belong to the node here. They are shared evenly among the nodes of a level, and what is left
    /// over goes to the right-most; below level ⌊log2 threads⌋ every node has one (spec §2.3).
    fn share_of(self, threads: usize) -> usize {
        let (nodes, threads) = (1u128 << self.depth, threads as u128);
        let (each, rest) = (threads / nodes, threads % nodes);
        let surplus = u128::from(self.number >= nodes - rest);
        ((each + surplus) as usize).max(1)
    }
}

/// How many of `threads` work together on a node of `count` primitives.
fn crew(count: usize, place: Place, threads: usize) -> usize {
    if count < MANY { 1 } else { place.share_of(threads) }
}

struct Build<'a> {
    search: Search<'a>,
    max_depth: u32,
    /// Nodes below this depth are built by the thread that comes to them.
    shared_depth: u32,
    ledger: Ledger,
    geometry_jobs: usize,
}

impl Build<'_> {
    /// Builds the node at `slot` of the arena and everything below it.
    fn node(&self, prims: Vec<Prim>, cell: Cell, place: Place, arena: &mut KdArena, slot: usize) -> Sums {
        let Some((split, [left, right])) = self.accepted_split(&prims, &cell, place) else {
            return self.leaf(&prims, &cell, place.depth, arena, slot);
        };
        drop(prims);
        let child = arena.nodes.len();
        arena.nodes[slot] = KdNode::interior(split.axis, split.position as f32, child);
        arena.nodes.extend([KdNode::leaf(0, 0); 2]);
        let ([l, r], [to_left, to_right]) = (cell.cut(&split), place.below());
        let is_shared = place.depth < self.shared_depth && left.len().min(right.len()) >= self.grain();
        let (a, b) = if is_shared {
            let lower = || self.node(left, l, to_left, arena, child);
            let upper = || self.apart(right, r, to_right);
            let (a, (part, b)) = rayon::join(lower, upper);
            attach(arena, child + 1, part);
            (a, b)
        } else {
            let a = self.node(left, l, to_left, arena, child);
            (a, self.node(right, r, to_right, arena, child + 1))
        };
        Sums::interior(cell.area, a, b)
    }

    /// Smallest part worth an own arena, which another thread may fill.
    fn grain(&self) -> usize {
        self.search.options.delegate.max(32)
    }

    /// The same in an arena of its own; put back with [`attach`] its nodes have the numbers that they would have had.
    fn apart(&self, prims: Vec<Prim>, cell: Cell, place: Place) -> (KdArena, Sums) {
        let mut arena = Arena { nodes: vec![KdNode::leaf(0, 0)], slots: Vec::new() };
        let sums = self.node(prims, cell, place, &mut arena, 0);
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
    fn accepted_split(&self, prims: &[Prim], cell: &Cell, place: Place) -> Option<(Split, [Vec<Prim>; 2])> {
        let options = self.search.options;
        if prims.len() < options.min_primitives.max(2) || place.depth >= self.max_depth {
            return None;
        }
        let turn = place.depth as usize;
        let crew = crew(prims.len(), place, self.geometry_jobs);
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

#[cfg(test)]
mod tests {
    use super::super::{collect, frame_of};
    use super::*;
    use crate::geom::DVec3;

    /// The thread numbers a_i to b_i of spec §2.3.
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
                    let place = Place { depth, number: i as u128 };
                    assert_eq!(
                        (first, place.share_of(threads)),
                        (next, last + 1 - first),
                        "{threads} {depth} {i}"
                    );
                    next = last + 1;
                }
                assert_eq!(next, threads);
            }
            let [_, deeper] = Place { depth: 63, number: u128::from(u64::MAX >> 1) }.below();
            assert_eq!(deeper.share_of(threads), 1);
        }
        assert_eq!([MANY - 1, MANY].map(|n| crew(n, Place::ROOT, 5)), [1, 5]);
    }

    /// A rough sheet of two triangles per cell.
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

    /// So many primitives that the root and its children are each worked on by several threads: by five, and by two and
    /// three; the tree is that of one thread.
    #[test]
    fn threads_that_share_nodes_build_the_same_tree() {
        let g = sheet(288);
        let frame = frame_of(&g);
        let prims = collect(&g, &frame, |_| true);
        assert!(prims.len() > 5 * MANY / 2);
        let children = Place::ROOT.below().map(|place| crew(prims.len() / 2, place, 5));
        assert_eq!((crew(prims.len(), Place::ROOT, 5), children), (5, [2, 3]));
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
