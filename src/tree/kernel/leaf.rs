//! A leaf against a group: which pulse may meet which primitive.

use super::Kernel;
use super::filter::{Seen, boxes_in_beam};
use super::lanes::{BeamSide, GROUP};
use super::placed::{HitPlaced, meet};
use super::rows::{
    Asked, Batch, ENOUGH, FindDistances, FindFromPackets, FindInside, FindPlanes, FindSides, LookClosely,
    PAIRS, SPAN, TOGETHER,
};
use super::verdict::{Rays, ask, hit_cube};
use crate::tree::block::{Block, LANES};
use crate::tree::simd::Simd;

/// The lists of some blocks.
pub(super) struct Lists<'a> {
    pub blocks: [Option<&'a Block>; TOGETHER],
    /// Least and greatest depths of their triangles.
    pub near: [[f32; LANES]; TOGETHER],
    pub far: [[f32; LANES]; TOGETHER],
    count: usize,
}

impl Lists<'_> {
    pub const EMPTY: Self = Lists {
        blocks: [None; TOGETHER],
        near: [[0.0; LANES]; TOGETHER],
        far: [[0.0; LANES]; TOGETHER],
        count: 0,
    };
}

impl<'a, S: Simd> Kernel<'a, S> {
    /// Asks the pulses in `mask`, each within its range of depths, about a block; the answers may come with one of the
    /// next. `enter` is about the least depth of the block.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub(super) unsafe fn block(
        &mut self,
        block: &'a Block,
        mask: u32,
        enter: f32,
        lo: &[f32; GROUP],
        hi: &[f32; GROUP],
    ) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            if block.holds_cubes() {
                self.settle();
                self.hit_cubes(block, mask, hi);
                return;
            }
            self.pair_triangles(block, mask, enter, lo, hi);
            if self.lists.count == TOGETHER || self.rows.batch_count * LANES >= ENOUGH {
                self.settle();
            }
        }
    }

    /// Finds the hits of all pairs.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub(super) unsafe fn settle(&mut self) {
        if self.lists.count == 0 {
            return;
        }
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let touched = if self.asides.is_empty() { self.settle_pulses() } else { self.settle_packets() };
            self.lower_limits(touched);
        }
        (self.lists.count, self.rows.batch_count) = (0, 0);
    }

    /// The same; returns the pulses that may have hit something.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn settle_pulses(&mut self) -> u32 {
        let (lists, lanes, geometry) = (&self.lists, &self.lanes, self.geometry);
        let mut touched = 0;
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let vertices = &geometry.vertices;
            S::apart(FindSides::<_, false> { rows: self.rows, lists, lanes, vertices });
            for span in 0..self.spans {
                let count = self.find_inside::<false>(span);
                let (lists, lanes) = (&self.lists, &self.lanes);
                if let Some(standing) = &self.standing {
                    let (rows, t, ids) = (&mut *self.rows, &mut *self.t, &mut *self.ids);
                    touched |= S::apart(HitPlaced { rows, lists, standing, t, ids, span, count });
                    continue;
                }
                let (rows, stride) = (&mut *self.rows, self.registers);
                let first = self.first * stride + span * SPAN / 8;
                let (count, pulses) =
                    S::apart(FindPlanes { rows, lists, lanes, geometry, count, first, stride });
                touched |= pulses;
                let (rows, directions, along) =
                    (&mut *self.rows, self.directions, self.directions[lanes.axes[0]]);
                let (t, ids) = (&mut *self.t, &mut *self.ids);
                let unsure = S::apart(FindDistances { rows, directions, along, t, ids, count });
                for n in 0..unsure {
                    self.ask_again(n);
                }
            }
        }
        touched
    }

    /// The same of packets, which have one span.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn settle_packets(&mut self) -> u32 {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let (lists, lanes, vertices) = (&self.lists, &self.lanes, &self.geometry.vertices);
            S::apart(FindSides::<_, true> { rows: self.rows, lists, lanes, vertices });
            let count = self.find_inside::<true>(0);
            let (lists, lanes, geometry) = (&self.lists, &self.lanes, self.geometry);
            let (rows, t, ids) = (&mut *self.rows, &mut *self.t, &mut *self.ids);
            let (directions, origins) = (self.directions, [0, 1, 2].map(|a| self.rays.origin_lanes(a)));
            let first = self.first * self.registers;
            let step =
                FindFromPackets { rows, lists, lanes, geometry, directions, origins, t, ids, count, first };
            let (unsure, touched) = S::apart(step);
            for n in 0..unsure {
                self.ask_again(n);
            }
            touched
        }
    }

    /// Finds the rays of a span inside of triangles; returns of how many pairs there are any.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn find_inside<const PACKED: bool>(&mut self, span: usize) -> usize {
        let (lists, lanes, wide) = (&self.lists, &self.lanes, self.wide);
        let (deviations, asides, geometry) = (self.deviations, self.asides, self.geometry);
        let rays = (self.rays.stride() - span * SPAN).min(SPAN);
        let valid = if rays == SPAN { !0 } else { (1u32 << rays) - 1 };
        let (rows, settled) = (&mut *self.rows, &mut self.settled);
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let (count, unsure) = S::apart(FindInside::<_, PACKED> {
                rows,
                lists,
                lanes,
                deviations,
                asides,
                settled,
                span,
                wide,
                valid,
            });
            if unsure != 0 && self.standing.is_none() {
                let rows = &mut *self.rows;
                S::apart(LookClosely::<_, PACKED> {
                    rows,
                    lists,
                    lanes,
                    deviations,
                    asides,
                    geometry,
                    span,
                    wide,
                    unsure,
                });
            }
            count
        }
    }

    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub(super) unsafe fn lower_limits(&mut self, mut touched: u32) {
        while touched != 0 {
            // SAFETY: the caller vouches for the instruction set.
            unsafe { self.lower_limit(touched.trailing_zeros() as usize) };
            touched &= touched - 1;
        }
    }

    /// Finds the triangles whose slopes overlap those of a pulse. `enter` is about the least depth of the block.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn pair_triangles(
        &mut self,
        block: &'a Block,
        mut mask: u32,
        enter: f32,
        lo: &[f32; GROUP],
        hi: &[f32; GROUP],
    ) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let still = enter >= self.lanes.still_from;
            let seen = Seen::from(&self.lanes, block, still);
            let (slot, rows) = (self.lists.count % TOGETHER, &mut *self.rows);
            seen.depths(&mut self.lists.near[slot], &mut self.lists.far[slot]);
            self.lists.blocks[slot] = Some(block);
            self.lists.count += 1;
            let mut count = rows.batch_count * LANES;
            while mask != 0 {
                let p = mask.trailing_zeros() as usize % GROUP;
                let met = seen.by(&self.lanes, p, [lo[p], hi[p]], still);
                if let Some(room) = rows.pairs[count..].first_chunk_mut() {
                    S::compress(met, (slot * PAIRS + p * LANES) as u32, room);
                }
                count += met.count_ones() as usize;
                mask &= mask - 1;
            }
            while rows.batch_count * LANES < count {
                let meant = count - rows.batch_count * LANES;
                let meant = if meant < LANES { (1u32 << meant) - 1 } else { 0xffff };
                rows.batches[rows.batch_count] = Batch { block: slot as u32, meant };
                rows.batch_count += 1;
            }
        }
    }

    /// Asks the pulses in `mask` about a block of cubes.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn hit_cubes(&mut self, block: &Block, mask: u32, hi: &[f32; GROUP]) {
        let (mut rest, mut touched) = (mask, 0);
        while rest != 0 {
            let p = rest.trailing_zeros() as usize % GROUP;
            let beam = self.lanes.sides.each_ref().map(|sides| {
                sides.each_ref().map(|s| BeamSide { from: s.from.0[p], inverse: s.inverse.0[p] })
            });
            // SAFETY: the caller vouches for the instruction set.
            let (mut met, enter) =
                unsafe { boxes_in_beam::<S>(&beam, &block.corner[0], &block.corner[1], hi[p]) };
            if let Some(list) = &mut self.met {
                // SAFETY: as above.
                unsafe { meet::<S>(list, block, p, met, enter) };
                met = 0;
            }
            touched |= u32::from(met != 0) << p;
            while met != 0 {
                self.hit_cube(self.first + p, block.id[met.trailing_zeros() as usize % LANES]);
                met &= met - 1;
            }
            rest &= rest - 1;
        }
        // SAFETY: as above.
        unsafe { self.lower_limits(touched) };
    }

    #[inline(always)]
    fn hit_cube(&mut self, pulse: usize, id: u32) {
        let cube = self.geometry.cubes[id as usize - self.geometry.triangles.len()];
        for register in pulse * self.registers..(pulse + 1) * self.registers {
            let (rays, first) = (self.rays, 8 * (register - pulse * self.registers));
            hit_cube(id, cube, |r| rays.origin_of(pulse, first + r), &mut self.rays_of(register));
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
    pub(super) unsafe fn lower_limit(&mut self, pulse: usize) {
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
    /// Asks for the full verdict on the rays of the `n`-th register that is open. Those that the quick distance was good for
    /// get the same again.
    #[cold]
    #[inline(never)]
    fn ask_again(&mut self, n: usize) {
        let Asked(asked) = self.rows.asked[self.rows.unsure[n] as usize];
        let plane = &self.rows.planes[(asked >> 32) as u16 as usize];
        let (id, pulse) = (plane.id, self.first + plane.pulse as usize);
        let corners = plane.vertex.map(|v| self.geometry.vertices[v as usize]);
        let register = asked as u32 as usize;
        let (rays, first) = (self.rays, 8 * (register - pulse * self.registers));
        let origin = |r| rays.origin_of(pulse, first + r);
        ask((asked >> 56) as u32, id, &mut self.rays_of(register), corners, origin);
    }
}
