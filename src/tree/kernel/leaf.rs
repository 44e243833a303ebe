//! A leaf against a group: which pulse meets which primitive, which ray, and where.
//!
//! Each step fills a flat list for the next one without branching on what it finds.

use super::Kernel;
use super::edges::{Edges, by_axis};
use super::filter::{Seen, boxes_in_beam};
use super::lanes::{BeamSide, GROUP};
use super::sides::Sides;
use super::verdict::{Plane, Rays, Rows, hit_cube};
use crate::geom::DVec3;
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
    /// The edges of sixteen pairs each.
    sides: [Sides; PAIRS / LANES],
    /// Places in `pairs` of those of which any ray may be inside; the first `kept_count` are meant.
    kept: [u32; PAIRS + LANES],
    kept_count: usize,
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
        sides: [Sides::NONE; PAIRS / LANES],
        kept: [0; PAIRS + LANES],
        kept_count: 0,
        inside: [Inside { pair: 0, strictly: 0, maybe: 0 }; PAIRS + 1],
    };

    #[inline(always)]
    fn clear(&mut self) {
        (self.count, self.kept_count) = (0, 0);
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
                self.find_sides(block);
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
        let mut touched = 0;
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            if block.holds_cubes() {
                touched = self.hit_cubes(block);
            } else {
                for span in 0..self.spans {
                    let count = self.find_inside(span);
                    touched |= self.hit_triangles(block, span, count);
                }
            }
            while touched != 0 {
                self.lower_limit(touched.trailing_zeros() as usize);
                touched &= touched - 1;
            }
        }
    }

    /// Asks for the corners of the triangles of all new pairs that may have rays inside.
    #[inline(always)]
    fn order_corners(&self, block: &Block) {
        let mut lanes = 0u32;
        for n in &self.next.kept[..self.next.kept_count] {
            lanes |= 1 << (self.next.pairs[*n as usize] % LANES as u32);
        }
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

    /// Computes the edges of all new pairs; keeps the pairs whose pulse does not pass beside the triangle.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn find_sides(&mut self, block: &Block) {
        let lists = &mut *self.next;
        let batches = lists.count.div_ceil(LANES);
        let all = lists.pairs.as_chunks::<LANES>().0;
        for ((batch, pairs), sides) in (0..batches).zip(all).zip(&mut lists.sides) {
            let meant = lists.count - batch * LANES;
            let meant = if meant < LANES { (1u32 << meant) - 1 } else { 0xffff };
            // SAFETY: the caller vouches for the instruction set.
            unsafe {
                let kept = meant & Sides::of::<S>(sides, &self.lanes, block, pairs);
                if let Some(room) = lists.kept[lists.kept_count..].first_chunk_mut() {
                    S::compress(kept, (batch * LANES) as u32, room);
                }
                lists.kept_count += kept.count_ones() as usize;
            }
        }
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
        for n in 0..self.lists.kept_count {
            let n = self.lists.kept[n] as usize;
            let pair = self.lists.pairs[n];
            let (sides, row) = (&self.lists.sides[n / LANES], pair as usize / LANES * wide + first);
            // SAFETY: the caller vouches for the instruction set.
            let (mut strictly, mut maybe) = unsafe { sides.inside::<S>(n % LANES, &self.deviations[row]) };
            if first + 1 < wide {
                // SAFETY: as above.
                let (s, m) = unsafe { sides.inside::<S>(n % LANES, &self.deviations[row + 1]) };
                (strictly, maybe) = (strictly | s << 16, maybe | m << 16);
            }
            (strictly, maybe) = (strictly & valid, maybe & valid);
            self.lists.inside[count] = Inside { pair, strictly, maybe };
            count += usize::from(maybe != 0);
        }
        count
    }

    /// Finds the hits of the pairs in `inside`; returns the pulses that have any.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn hit_triangles(&mut self, block: &Block, span: usize, count: usize) -> u32 {
        let (k, forward) = (self.lanes.axes[0], f64::from(self.lanes.forward));
        // The same number of registers for every pair, so that no branch depends on who hits what.
        let registers = (self.registers - span * SPAN / 8).min(SPAN / 8);
        let mut touched = 0;
        for n in 0..count {
            let Inside { pair, mut strictly, mut maybe } = self.lists.inside[n];
            let (pulse, lane) = (pair as usize / LANES, pair as usize % LANES);
            let geometry = self.geometry;
            let corners = [0, 1, 2].map(|c| &geometry.vertices[block.vertex[c][lane] as usize]);
            if strictly != maybe {
                // SAFETY: the caller vouches for the instruction set.
                (strictly, maybe) =
                    unsafe { self.look_closely(span, pulse, corners.map(|c| *c), strictly, maybe) };
            }
            touched |= 1 << pulse;
            let corners = corners.map(|c| c.as_ref());
            let origin = &self.lanes.eyes[pulse].origin;
            let first = (self.first + pulse) * self.registers + span * SPAN / 8;
            let row = first..first + registers;
            let d = &self.directions;
            let rays = Rows {
                directions: [&d[0][row.clone()], &d[1][row.clone()], &d[2][row.clone()]],
                t: &mut self.t[row.clone()],
                id: &mut self.ids[row],
            };
            // SAFETY: the caller vouches for the instruction set.
            unsafe {
                let plane = Plane::of::<S>(block.id[lane], corners, origin, k, forward);
                plane.hit::<S>(k, strictly, maybe, rays, corners, origin);
            }
        }
        touched
    }

    /// Decides from double precision about rays that single precision leaves undecided.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn look_closely(
        &self,
        span: usize,
        pulse: usize,
        corners: [DVec3; 3],
        strictly: u32,
        maybe: u32,
    ) -> (u32, u32) {
        let (eye, row) = (&self.lanes.eyes[pulse], pulse * self.wide + 2 * span);
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let edges = Edges::of::<S>(self.lanes.axes, eye, &by_axis(corners));
            let (mut s, mut m) = edges.inside::<S>(&self.deviations[row]);
            if 2 * span + 1 < self.wide {
                let (s1, m1) = edges.inside::<S>(&self.deviations[row + 1]);
                (s, m) = (s | s1 << 16, m | m1 << 16);
            }
            ((strictly | s) & maybe, maybe & m)
        }
    }

    /// Asks all pairs of a block of cubes; returns the pulses that are in any.
    #[inline(always)]
    fn hit_cubes(&mut self, block: &Block) -> u32 {
        let mut touched = 0;
        for n in 0..self.lists.count {
            let pair = self.lists.pairs[n] as usize;
            touched |= 1 << (pair / LANES);
            let (pulse, id) = (self.first + pair / LANES, block.id[pair % LANES]);
            let cube = self.geometry.cubes[id as usize - self.geometry.triangles.len()];
            for register in pulse * self.registers..(pulse + 1) * self.registers {
                hit_cube(id, cube, self.rays.origin(pulse), &mut self.rays_of(register));
            }
        }
        touched
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
