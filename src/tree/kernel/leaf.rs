//! A leaf against a group: which pulse meets which primitive, which ray, and where.
//!
//! Each step fills a flat list for the next one without branching on what it finds.

use super::Kernel;
use super::edges::{Corners, Edges};
use super::filter::{Seen, boxes_in_beam};
use super::lanes::{BeamSide, GROUP};
use super::verdict::{Plane, Rays, Rows, hit_cube};
use crate::tree::block::{Block, LANES};
use crate::tree::simd::{Simd, prefetch};

/// Rays that are looked at together.
const SPAN: usize = 32;

/// Most pairs of a block.
const PAIRS: usize = GROUP * LANES;

/// The lists of a block.
pub(super) struct Lists {
    /// `pulse · 16 + lane`, of which the first `count` are meant. Writers may go one register beyond.
    pairs: [u32; PAIRS + LANES],
    count: usize,
    /// Lanes of the block in any pair, and their corners.
    lanes: u32,
    /// Pulses in any pair.
    pulses: u32,
    corners: [Corners; LANES],
    /// Of each pair, one place more than there can be.
    edges: [Edges; PAIRS + 1],
    /// Pairs of which rays are inside, one place more than there can be.
    inside: [Inside; PAIRS + 1],
}

/// The rays of a span that pass within a triangle.
#[derive(Clone, Copy)]
struct Inside {
    pair: u32,
    strictly: u32,
    maybe: u32,
}

impl Lists {
    pub const EMPTY: Lists = Lists {
        pairs: [0; PAIRS + LANES],
        count: 0,
        lanes: 0,
        pulses: 0,
        corners: [[[0.0; 4]; 3]; LANES],
        edges: [Edges::NONE; PAIRS + 1],
        inside: [Inside { pair: 0, strictly: 0, maybe: 0 }; PAIRS + 1],
    };

    #[inline(always)]
    fn clear(&mut self) {
        (self.count, self.lanes, self.pulses) = (0, 0, 0);
    }

    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn pair<S: Simd>(&mut self, pulse: usize, lanes: u32) {
        if let Some(room) = self.pairs[self.count..].first_chunk_mut() {
            // SAFETY: the caller vouches for the instruction set.
            unsafe { S::compress(lanes, (pulse * LANES) as u32, room) };
        }
        self.count += lanes.count_ones() as usize;
        self.lanes |= lanes;
        self.pulses |= u32::from(lanes != 0) << pulse;
    }
}

impl<'a, S: Simd> Kernel<'a, S> {
    /// Asks the pulses in `mask`, each within its range of depths, about a block. The answers come with the next block:
    /// until then the corners of the triangles are on their way from memory.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub(super) unsafe fn block(&mut self, block: &'a Block, mask: u32, lo: &[f32; GROUP], hi: &[f32; GROUP]) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            self.next.clear();
            if block.holds_cubes() {
                self.pair_cubes(block, mask, hi);
            } else {
                self.pair_triangles(block, mask, lo, hi);
                self.order_corners(block);
            }
            self.settle();
        }
        self.pending = Some(block);
        std::mem::swap(&mut self.next, &mut self.lists);
    }

    /// Finds the hits of the pairs of the block before.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub(super) unsafe fn settle(&mut self) {
        let Some(block) = self.pending.take() else { return };
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            if block.holds_cubes() {
                self.hit_cubes(block);
            } else {
                self.fetch_corners(block);
                self.find_edges();
                for span in 0..self.spans {
                    let count = self.find_inside(span);
                    self.hit_triangles(block, span, count);
                }
            }
            let mut touched = self.lists.pulses;
            while touched != 0 {
                self.lower_limit(touched.trailing_zeros() as usize);
                touched &= touched - 1;
            }
        }
    }

    /// Asks for the corners of the triangles of all new pairs.
    #[inline(always)]
    fn order_corners(&self, block: &Block) {
        let mut lanes = self.next.lanes;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            for corner in &block.vertex {
                prefetch(&self.geometry.vertices[corner[lane] as usize]);
            }
            lanes &= lanes - 1;
        }
    }

    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn pair_triangles(&mut self, block: &Block, mut mask: u32, lo: &[f32; GROUP], hi: &[f32; GROUP]) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let seen = Seen::from(&self.lanes, block);
            while mask != 0 {
                let p = mask.trailing_zeros() as usize;
                let met = seen.by(&self.lanes, p, [lo[p], hi[p]]);
                self.next.pair::<S>(p, met);
                mask &= mask - 1;
            }
        }
    }

    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn pair_cubes(&mut self, block: &Block, mut mask: u32, hi: &[f32; GROUP]) {
        while mask != 0 {
            let p = mask.trailing_zeros() as usize;
            let beam = self.lanes.sides.each_ref().map(|sides| {
                sides.each_ref().map(|s| BeamSide { from: s.from.0[p], inverse: s.inverse.0[p] })
            });
            // SAFETY: the caller vouches for the instruction set.
            unsafe {
                let (met, _) = boxes_in_beam::<S>(&beam, &block.corner[0], &block.corner[1], hi[p]);
                self.next.pair::<S>(p, met);
            }
            mask &= mask - 1;
        }
    }

    /// Gets the triangles of all pairs at once, so that they come from memory side by side.
    #[inline(always)]
    fn fetch_corners(&mut self, block: &Block) {
        let mut lanes = self.lists.lanes;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            let vertex = |corner: usize| self.geometry.vertices[block.vertex[corner][lane] as usize];
            let (a, b, c) = (vertex(0), vertex(1), vertex(2));
            self.lists.corners[lane] = [[a.x, b.x, c.x, 0.0], [a.y, b.y, c.y, 0.0], [a.z, b.z, c.z, 0.0]];
            lanes &= lanes - 1;
        }
    }

    /// Computes the edges of all pairs; drops the pairs of pulses that pass beside their triangle.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn find_edges(&mut self) {
        let mut count = 0;
        for n in 0..self.lists.count {
            let pair = self.lists.pairs[n];
            let (pulse, lane) = (pair as usize / LANES, pair as usize % LANES);
            let (eye, corners) = (&self.lanes.eyes[pulse], &self.lists.corners[lane]);
            // SAFETY: the caller vouches for the instruction set.
            let may_hit =
                unsafe { Edges::of::<S>(&mut self.lists.edges[count], self.lanes.axes, eye, corners) };
            self.lists.pairs[count] = pair;
            count += usize::from(may_hit);
        }
        self.lists.count = count;
    }

    /// Finds the rays of a span that pass within the triangles of the pairs; returns how many pairs have any.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn find_inside(&mut self, span: usize) -> usize {
        let (first, wide) = (2 * span, self.wide);
        // Lanes that repeat the last ray count, or no limit would ever be lowered.
        let lanes = (self.rays.stride() - span * SPAN).min(SPAN);
        let valid = if lanes == SPAN { !0 } else { (1u32 << lanes) - 1 };
        let mut count = 0;
        for n in 0..self.lists.count {
            let pair = self.lists.pairs[n];
            let (edges, row) = (&self.lists.edges[n], pair as usize / LANES * wide + first);
            // SAFETY: the caller vouches for the instruction set.
            let (mut strictly, mut maybe) = unsafe { edges.inside::<S>(&self.deviations[row]) };
            if first + 1 < wide {
                // SAFETY: as above.
                let (s, m) = unsafe { edges.inside::<S>(&self.deviations[row + 1]) };
                (strictly, maybe) = (strictly | s << 16, maybe | m << 16);
            }
            (strictly, maybe) = (strictly & valid, maybe & valid);
            self.lists.inside[count] = Inside { pair, strictly, maybe };
            count += usize::from(maybe != 0);
        }
        count
    }

    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn hit_triangles(&mut self, block: &Block, span: usize, count: usize) {
        let (k, forward) = (self.lanes.axes[0], f64::from(self.lanes.forward));
        // The same number of registers for every pair, so that no branch depends on who hits what.
        let registers = (self.registers - span * SPAN / 8).min(SPAN / 8);
        for n in 0..count {
            let Inside { pair, strictly, maybe } = self.lists.inside[n];
            let (pulse, lane) = (pair as usize / LANES, pair as usize % LANES);
            let corners = &self.lists.corners[lane];
            let origin = &self.lanes.eyes[pulse].origin;
            let plane = Plane::of(block.id[lane], corners, origin, k, forward);
            let first = (self.first + pulse) * self.registers + span * SPAN / 8;
            let row = first..first + registers;
            let d = &self.directions;
            let rays = Rows {
                directions: [&d[0][row.clone()], &d[1][row.clone()], &d[2][row.clone()]],
                t: &mut self.t[row.clone()],
                id: &mut self.ids[row],
            };
            // SAFETY: the caller vouches for the instruction set.
            unsafe { plane.hit::<S>(k, strictly, maybe, rays, corners, origin) };
        }
    }

    #[inline(always)]
    fn hit_cubes(&mut self, block: &Block) {
        for n in 0..self.lists.count {
            let pair = self.lists.pairs[n] as usize;
            let (pulse, id) = (self.first + pair / LANES, block.id[pair % LANES]);
            let cube = self.geometry.cubes[id as usize - self.geometry.triangles.len()];
            for register in pulse * self.registers..(pulse + 1) * self.registers {
                hit_cube(id, cube, self.rays.origin(pulse), &mut self.rays_of(register));
            }
        }
    }

    #[inline(always)]
    fn rays_of(&mut self, register: usize) -> Rays<'_> {
        let d = &self.directions;
        Rays {
            directions: [&d[0][register], &d[1][register], &d[2][register]],
            t: &mut self.t[register],
            id: &mut self.ids[register],
        }
    }

    /// Once all rays of a pulse have hit something, what lies behind the farthest of these hits is of no interest.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn lower_limit(&mut self, pulse: usize) {
        let first = (self.first + pulse) * self.registers;
        // SAFETY: the caller vouches for the instruction set.
        let farthest = unsafe {
            let mut farthest = S::dsplat(0.0);
            for t in &self.t[first..first + self.registers] {
                farthest = S::dmax(farthest, S::dload(t));
            }
            S::dgreatest(farthest)
        };
        let depth = farthest * self.lanes.steepness[pulse] + f64::from(self.lanes.start.0[pulse]);
        self.limit.0[pulse] = (depth * 1.000_000_4) as f32;
    }
}
