//! A leaf against a group: which pulse meets which primitive, then the verdicts.

use super::Kernel;
use super::filter::{Seen, boxes_in_beam};
use super::lanes::{BeamSide, GROUP};
use super::verdict::{Rays, Triangle, hit_cube};
use crate::tree::block::{Block, LANES};
use crate::tree::simd::Simd;

/// Pairs of a pulse and a lane of the block, `pulse · 16 + lane`, of which the first `count` are meant.
pub(super) struct Pairs {
    pair: [u32; GROUP * LANES + LANES],
    count: usize,
    /// Lanes in any pair.
    lanes: u32,
}

impl Pairs {
    pub const NONE: Pairs = Pairs { pair: [0; GROUP * LANES + LANES], count: 0, lanes: 0 };

    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn extend<S: Simd>(&mut self, pulse: usize, lanes: u32) {
        if let Some(room) = self.pair[self.count..].first_chunk_mut() {
            // SAFETY: the caller vouches for the instruction set.
            unsafe { S::compress(lanes, (pulse * LANES) as u32, room) };
        }
        self.count += lanes.count_ones() as usize;
        self.lanes |= lanes;
    }
}

impl<S: Simd> Kernel<'_, S> {
    /// Asks the pulses in `mask`, each within its range of depths, about a block.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub(super) unsafe fn block(&mut self, block: &Block, mask: u32, lo: &[f32; GROUP], hi: &[f32; GROUP]) {
        self.scratch.pairs.count = 0;
        self.scratch.pairs.lanes = 0;
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            if block.holds_cubes() {
                self.pair_cubes(block, mask, hi);
            } else {
                let seen = Seen::from(&self.lanes, block);
                let mut rest = mask;
                while rest != 0 {
                    let p = rest.trailing_zeros() as usize;
                    self.scratch.pairs.extend::<S>(p, seen.by(&self.lanes, p, [lo[p], hi[p]]));
                    rest &= rest - 1;
                }
            }
            let mut lanes = self.scratch.pairs.lanes;
            // All at once, so that they come from memory side by side.
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                let number = block.id[lane] as usize;
                if number < self.geometry.triangles.len() {
                    self.scratch.corners[lane] = self.geometry.triangle(number);
                }
            }
            let mut touched = 0u32;
            for n in 0..self.scratch.pairs.count {
                let pair = self.scratch.pairs.pair[n];
                let (pulse, lane) = (pair as usize / LANES, pair as usize % LANES);
                self.verdict(pulse, block.id[lane], lane);
                touched |= 1 << pulse;
            }
            while touched != 0 {
                self.lower_limit(touched.trailing_zeros() as usize);
                touched &= touched - 1;
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
                self.scratch.pairs.extend::<S>(p, met);
            }
            mask &= mask - 1;
        }
    }

    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn verdict(&mut self, pulse: usize, id: u32, lane: usize) {
        let (number, triangles) = (id as usize, self.geometry.triangles.len());
        let origin = self.rays.origin(self.first + pulse);
        let first = (self.first + pulse) * self.registers;
        let [k, ..] = self.lanes.axes;
        if number >= triangles {
            let cube = self.geometry.cubes[number - triangles];
            (first..first + self.registers).for_each(|r| hit_cube(id, cube, origin, &mut self.rays_of(r)));
            return;
        }
        let triangle = Triangle::new(id, self.scratch.corners[lane], origin);
        let (axes, forward) = (self.lanes.axes, f64::from(self.lanes.forward));
        let plane = triangle.plane(k, forward);
        for r in first..first + self.registers {
            let mut rays = self.rays_of(r);
            // SAFETY: the caller vouches for the instruction set.
            unsafe {
                let (strictly, maybe) = triangle.inside::<S>(axes, &rays);
                if maybe != 0 {
                    triangle.hit::<S>(&plane, k, strictly, maybe, &mut rays);
                }
            }
        }
    }

    #[inline(always)]
    fn rays_of(&mut self, register: usize) -> Rays<'_> {
        let [x, y, z] = self.directions.map(|d| &d[register]);
        Rays { x, y, z, t: &mut self.t[register], id: &mut self.ids[register] }
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
