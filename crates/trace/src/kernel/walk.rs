//! A packet's traversal of the nodes.

use super::filter::{box_in_pulses, boxes_in_frustum, cut};
use super::lanes::{PACKET_SIZE, PerPulse};
use super::traversal::{KdVisit, PacketTraversal, Stacks, Visit};
use crate::Tree;
use crate::block::Block;
use crate::frustum::DEPTH_MARGIN;
use crate::index::Nodes;
use crate::node::{KdNode, WideChild, WideNode};
use crate::simd::{F32Ops, MaskOps, Simd, each_of, prefetch};
use crate::stack::insert_by_depth;

/// Maximum number of blocks that wait for their memory.
const MAX_AHEAD: usize = 4;

/// Corners of boxes by axis and lane.
type BoxCorners = [[f32; PACKET_SIZE]; 3];

impl<'a, S: Simd> PacketTraversal<'a, S> {
    /// Traverses the tree with the pulses in a mask, front to back.
    #[inline(always)]
    pub(super) fn walk(&mut self, tree: &'a Tree, pulses: u32) {
        let simd = self.simd;
        // One copy for the trees of scenes, instances and models.
        match &tree.nodes {
            Nodes::Kd(nodes) => simd.outlined(
                #[inline(always)]
                || self.walk_kd(tree, nodes, pulses),
            ),
            Nodes::Wide(nodes) => simd.outlined(
                #[inline(always)]
                || self.walk_wide(tree, nodes, pulses),
            ),
        }
        self.flush_candidates();
    }

    #[inline(always)]
    fn walk_kd(&mut self, tree: &'a Tree, nodes: &[KdNode], pulses: u32) {
        let simd = self.simd;
        let [lower, upper] = tree.bounds;
        let pulses = pulses & box_in_pulses(&self.frustum, lower, upper, &self.limit);
        let mut range = [simd.splat(0.0), simd.splat(f32::INFINITY)];
        for a in 0..3 {
            range = cut(&self.frustum, a, upper[a], range)[0];
            range = cut(&self.frustum, a, lower[a], range)[1];
        }
        let [lo, hi] = range;
        self.stacks.kd[0] = KdVisit { pulses, ..KdVisit::ROOT };
        lo.store(&mut self.stacks.kd[0].lo.0);
        hi.store(&mut self.stacks.kd[0].hi.0);
        let mut height = 1;
        let margin = simd.splat(DEPTH_MARGIN);
        while height > 0 {
            height -= 1;
            let visit = &self.stacks.kd[height];
            let (mut number, mut pulses) = (visit.node as usize, visit.pulses);
            let (mut lo, mut hi) = (simd.load(&visit.lo.0), simd.load(&visit.hi.0));
            let limit = simd.load(&self.limit.0) * margin;
            pulses &= lo.le(limit).bits();
            while pulses != 0 {
                let node = nodes[number];
                let Some(axis) = node.axis() else {
                    let (mut from, mut to) = (PerPulse::ZERO, PerPulse::ZERO);
                    lo.store(&mut from.0);
                    for block in &tree.blocks[node.blocks()] {
                        hi.min(simd.load(&self.limit.0)).store(&mut to.0);
                        let enter = from.0[pulses.trailing_zeros() as usize % PACKET_SIZE];
                        self.visit_block(block, pulses, enter, &from.0, &to.0);
                    }
                    break;
                };
                let [lower, upper] = cut(&self.frustum, axis, node.position(), [lo, hi]);
                let [in_lower, in_upper] = each_of!([0, 1], n => {
                    let [lo, hi] = [lower, upper][n];
                    pulses & (lo.le(hi * margin) & lo.le(limit)).bits()
                });
                let child = node.child();
                let [above, below] = &self.frustum.hull[axis];
                let (near, far) = if above.inverse > 0.0 && below.inverse > 0.0 {
                    ((child, in_lower, lower), (child + 1, in_upper, upper))
                } else {
                    ((child + 1, in_upper, upper), (child, in_lower, lower))
                };
                let next = if near.1 == 0 {
                    far
                } else {
                    if far.1 != 0 {
                        let visit = &mut self.stacks.kd[height];
                        visit.node = far.0 as u32;
                        visit.pulses = far.1;
                        far.2[0].store(&mut visit.lo.0);
                        far.2[1].store(&mut visit.hi.0);
                        height += 1;
                    }
                    near
                };
                (number, pulses, [lo, hi]) = next;
            }
        }
    }

    #[inline(always)]
    fn walk_wide(&mut self, tree: &'a Tree, nodes: &[WideNode], pulses: u32) {
        self.stacks.wide[0] = Visit::root(WideChild::ROOT, pulses);
        let mut height = 1;
        // Blocks are prefetched until some others have been found. Few pulses meet each block of a model,
        // which is seldom in the cache.
        let ahead = if self.instance.is_some() { MAX_AHEAD } else { 1 };
        let mut waiting: [Option<(&'a Block, f32, u32)>; MAX_AHEAD] = [None; MAX_AHEAD];
        let (mut first, mut count) = (0, 0);
        loop {
            let mut found = None;
            if height > 0 {
                height -= 1;
                let Visit { node: child, enter, pulses } = self.stacks.wide[height];
                let pulses = pulses & self.within_limit(enter);
                if pulses == 0 {
                    continue;
                }
                match child.number() {
                    Ok(number) => {
                        let (node, is_instance) = (&nodes[number], self.instance.is_some());
                        let child = |lane: usize| {
                            match node.child[lane].number() {
                                Ok(number) => prefetch(&nodes[number]),
                                Err(number) if !is_instance => prefetch(&tree.blocks[number]),
                                Err(_) => {}
                            }
                            node.child[lane]
                        };
                        height = self.push_children(
                            |stacks| &mut stacks.wide,
                            (height, pulses),
                            (&node.lower, &node.upper, !0),
                            child,
                        );
                        continue;
                    }
                    Err(number) => found = Some((&tree.blocks[number], enter, pulses)),
                }
            } else if count == 0 {
                break;
            }
            if count == ahead || found.is_none() {
                if let Some((block, enter, pulses)) = waiting[first % MAX_AHEAD] {
                    let limit = self.limit.0;
                    let pulses = pulses & self.within_limit(enter);
                    if pulses != 0 {
                        self.visit_block(block, pulses, enter, &[0.0; PACKET_SIZE], &limit);
                    }
                }
                (first, count) = (first + 1, count - 1);
            }
            if let Some((block, ..)) = found {
                if self.instance.is_some() {
                    prefetch(&block.corner);
                }
                waiting[(first + count) % MAX_AHEAD] = found;
                count += 1;
            }
        }
    }

    /// Returns a mask of the pulses for which not all rays have hit something nearer than this depth.
    #[inline(always)]
    pub(super) fn within_limit(&self, enter: f32) -> u32 {
        let simd = self.simd;
        simd.splat(enter).le(simd.load(&self.limit.0) * simd.splat(DEPTH_MARGIN)).bits()
    }

    /// Removes visits from a stack until one has pulses that may still hit something nearer than their hits.
    /// Returns the visit with these pulses.
    #[inline(always)]
    pub(super) fn pop_visit<N: Copy>(
        &self,
        stack: impl Fn(&Stacks) -> &[Visit<N>],
        height: &mut usize,
    ) -> Option<Visit<N>> {
        while *height > 0 {
            *height -= 1;
            let visit = stack(self.stacks)[*height];
            let pulses = visit.pulses & self.within_limit(visit.enter);
            if pulses != 0 {
                return Some(Visit { pulses, ..visit });
            }
        }
        None
    }

    /// Pushes the children of a node that the pulses hit on a stack of height `floor`, the nearest on top.
    /// The children are given by the corners of their boxes and the mask of those that exist; `child` is
    /// called for those that are pushed. Returns the new height.
    #[inline(always)]
    pub(super) fn push_children<N: Copy>(
        &mut self,
        stack: impl Fn(&mut Stacks) -> &mut [Visit<N>],
        (floor, pulses): (usize, u32),
        (lower, upper, mask): (&BoxCorners, &BoxCorners, u32),
        child: impl Fn(usize) -> N,
    ) -> usize {
        let (mut depths, mut height) = ([0.0; PACKET_SIZE], floor);
        let is_single = pulses.is_power_of_two();
        let (planes, limit) = if is_single {
            let p = pulses.trailing_zeros() as usize % PACKET_SIZE;
            (&self.frustum.pulse_planes(p), self.limit.0[p])
        } else {
            (&self.frustum.hull, self.simd.load(&self.limit.0).max_lane())
        };
        let (met, enter) = boxes_in_frustum(self.simd, planes, lower, upper, limit);
        let mut met = met & mask;
        enter.store(&mut depths);
        while met != 0 {
            let lane = met.trailing_zeros() as usize;
            met &= met - 1;
            let mut pulses = pulses;
            if !is_single {
                let corner = |corners: &BoxCorners| [corners[0][lane], corners[1][lane], corners[2][lane]];
                pulses &= box_in_pulses(&self.frustum, corner(lower), corner(upper), &self.limit);
                if pulses == 0 {
                    continue;
                }
            }
            let visit = Visit { node: child(lane), enter: depths[lane], pulses };
            height = insert_by_depth(stack(self.stacks), (floor, height), visit, |visit| visit.enter);
        }
        height
    }
}
