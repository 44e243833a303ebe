//! A group's walk through the nodes.

use super::Kernel;
use super::filter::{box_in_lanes, boxes_in_beam, cut};
use super::lanes::{GROUP, PerPulse};
use crate::tree::Tree;
use crate::tree::beam::LOOSE;
use crate::tree::block::Block;
use crate::tree::build::DEEPEST;
use crate::tree::index::Nodes;
use crate::tree::node::{KdNode, WideChild, WideNode};
use crate::tree::simd::{Simd, each_of, prefetch};
use crate::tree::trace::WIDE_STACK;

/// A node to visit: the pulses that meet it, and at which depths.
#[derive(Clone, Copy)]
struct Visit {
    node: u32,
    pulses: u32,
    lo: PerPulse,
    hi: PerPulse,
}

impl Visit {
    const NOWHERE: Visit =
        Visit { node: 0, pulses: 0, lo: PerPulse([0.0; GROUP]), hi: PerPulse([0.0; GROUP]) };
}

/// Visits that wait.
pub(super) struct Stacks {
    kd: [Visit; DEEPEST as usize + 1],
    wide: [WideVisit; WIDE_STACK],
}

impl Stacks {
    pub const EMPTY: Stacks =
        Stacks { kd: [Visit::NOWHERE; DEEPEST as usize + 1], wide: [WideVisit::NOWHERE; WIDE_STACK] };
}

impl<'a, S: Simd> Kernel<'a, S> {
    /// Walks the `pulses`, a bit each, through the tree, front to back.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub(super) unsafe fn walk(&mut self, tree: &'a Tree, pulses: u32) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            match &tree.nodes {
                Nodes::Kd(nodes) => self.walk_kd(tree, nodes, pulses),
                Nodes::Wide(nodes) => self.walk_wide(tree, nodes, pulses),
            }
            self.settle();
        }
    }

    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn walk_kd(&mut self, tree: &'a Tree, nodes: &[KdNode], pulses: u32) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let [lower, upper] = tree.bounds;
            let pulses = pulses & box_in_lanes(&self.lanes, lower, upper, &self.limit);
            let mut range = [S::splat(0.0), S::splat(f32::INFINITY)];
            for a in 0..3 {
                range = cut(&self.lanes, a, upper[a], range)[0];
                range = cut(&self.lanes, a, lower[a], range)[1];
            }
            let [lo, hi] = range;
            self.stacks.kd[0] = Visit { pulses, ..Visit::NOWHERE };
            S::store(&mut self.stacks.kd[0].lo.0, lo);
            S::store(&mut self.stacks.kd[0].hi.0, hi);
            let mut height = 1;
            let loose = S::splat(LOOSE);
            while height > 0 {
                height -= 1;
                let visit = &self.stacks.kd[height];
                let (mut number, mut pulses) = (visit.node as usize, visit.pulses);
                let (mut lo, mut hi) = (S::load(&visit.lo.0), S::load(&visit.hi.0));
                let limit = S::mul(S::load(&self.limit.0), loose);
                pulses &= S::bits(S::le(lo, limit));
                while pulses != 0 {
                    let node = nodes[number];
                    let Some(axis) = node.axis() else {
                        let (mut from, mut to) = (PerPulse([0.0; GROUP]), PerPulse([0.0; GROUP]));
                        S::store(&mut from.0, lo);
                        for block in &tree.blocks[node.blocks()] {
                            S::store(&mut to.0, S::min(hi, S::load(&self.limit.0)));
                            let enter = from.0[pulses.trailing_zeros() as usize % GROUP];
                            self.block(block, pulses, enter, &from.0, &to.0);
                        }
                        break;
                    };
                    let [lower, upper] = cut(&self.lanes, axis, node.position(), [lo, hi]);
                    let [in_lower, in_upper] = each_of!([0, 1], n => {
                        let [lo, hi] = [lower, upper][n];
                        pulses & S::bits(S::and(S::le(lo, S::mul(hi, loose)), S::le(lo, limit)))
                    });
                    let child = node.child();
                    let ascends =
                        self.lanes.beam[axis][0].inverse > 0.0 && self.lanes.beam[axis][1].inverse > 0.0;
                    let (near, far) = if ascends {
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
                            S::store(&mut visit.lo.0, far.2[0]);
                            S::store(&mut visit.hi.0, far.2[1]);
                            height += 1;
                        }
                        near
                    };
                    (number, pulses, [lo, hi]) = next;
                }
            }
        }
    }

    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn walk_wide(&mut self, tree: &'a Tree, nodes: &[WideNode], pulses: u32) {
        self.stacks.wide[0] = WideVisit { pulses, ..WideVisit::NOWHERE };
        let (single, mut height) = (pulses == 1, 1);
        // The block that comes next is on its way from memory until another one has been found.
        let mut waiting: Option<(&'a Block, f32)> = None;
        let mut waiting_pulses = 0;
        loop {
            let mut found = None;
            let mut found_pulses = 0;
            if height > 0 {
                height -= 1;
                let WideVisit { child, enter, pulses } = self.stacks.wide[height];
                // SAFETY: the caller vouches for the instruction set.
                let pulses = unsafe { pulses & self.within_limit(enter) };
                if pulses == 0 {
                    continue;
                }
                match child.number() {
                    Ok(number) => {
                        // SAFETY: as above.
                        height = unsafe { self.meet_children(tree, nodes, number, pulses, single, height) };
                        continue;
                    }
                    Err(number) => (found, found_pulses) = (Some((&tree.blocks[number], enter)), pulses),
                }
            } else if waiting.is_none() {
                break;
            }
            if let Some((block, enter)) = waiting {
                let limit = self.limit.0;
                // SAFETY: as above.
                unsafe {
                    let pulses = waiting_pulses & self.within_limit(enter);
                    self.block(block, pulses, enter, &[0.0; GROUP], &limit);
                }
            }
            (waiting, waiting_pulses) = (found, found_pulses);
        }
    }

    /// The pulses that have not hit anything nearer than this depth with all of their rays.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub(super) unsafe fn within_limit(&self, enter: f32) -> u32 {
        // SAFETY: the caller vouches for the instruction set.
        unsafe { S::bits(S::le(S::splat(enter), S::mul(S::load(&self.limit.0), S::splat(LOOSE)))) }
    }

    /// Puts the children of a node that the pulses meet on the stack, the nearest on top; returns its new height.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn meet_children(
        &mut self,
        tree: &Tree,
        nodes: &[WideNode],
        number: usize,
        pulses: u32,
        single: bool,
        floor: usize,
    ) -> usize {
        let node = &nodes[number];
        let (mut depths, mut height) = ([0.0; GROUP], floor);
        // SAFETY: the caller vouches for the instruction set.
        let mut met = unsafe {
            let limit = S::greatest(S::load(&self.limit.0));
            let (met, enter) = boxes_in_beam::<S>(&self.lanes.beam, &node.lower, &node.upper, limit);
            S::store(&mut depths, enter);
            met
        };
        while met != 0 {
            let lane = met.trailing_zeros() as usize;
            met &= met - 1;
            let lower = [node.lower[0][lane], node.lower[1][lane], node.lower[2][lane]];
            let upper = [node.upper[0][lane], node.upper[1][lane], node.upper[2][lane]];
            // SAFETY: as above.
            let meeting = unsafe { box_in_lanes(&self.lanes, lower, upper, &self.limit) };
            // The beam around a single pulse is that pulse.
            let meeting = if single { !0 } else { meeting };
            let pulses = pulses & meeting;
            if pulses == 0 {
                continue;
            }
            match node.child[lane].number() {
                Ok(number) => prefetch(&nodes[number]),
                Err(number) => prefetch(&tree.blocks[number]),
            }
            let stack = &mut self.stacks.wide;
            let mut at = height;
            while at > floor && stack[at - 1].enter < depths[lane] {
                stack[at] = stack[at - 1];
                at -= 1;
            }
            stack[at] = WideVisit { child: node.child[lane], enter: depths[lane], pulses };
            height += 1;
        }
        height
    }
}

/// A child in the wide tree to visit: the pulses that meet it, and the least depth of that.
#[derive(Clone, Copy)]
struct WideVisit {
    child: WideChild,
    enter: f32,
    pulses: u32,
}

impl WideVisit {
    const NOWHERE: WideVisit = WideVisit { child: WideChild::ROOT, enter: 0.0, pulses: 0 };
}
