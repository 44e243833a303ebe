//! Leaves in a packet's traversal: finds the primitives that each pulse may hit.

use super::candidates::{
    Batch, CandidateLists, MAX_BLOCK_PAIRS, MAX_PENDING_BLOCKS, MIN_PENDING_PAIRS, Occlusion, RayRegisters,
    SPAN, StepInput, find_distances, find_inside, find_merged_distances, find_planes, find_sides,
    refine_inside,
};
use super::distance::Rays;
use super::filter::{BlockSlopes, DepthRange, boxes_in_frustum};
use super::instance_frame::{InstanceFrame, hit_instance, record_instances};
use super::lanes::PACKET_SIZE;
use super::model_frame::set_deviations;
use super::traversal::PacketTraversal;
use crate::Cube;
use crate::block::{BLOCK_SIZE, Block};
use crate::simd::{F32Ops, F64Ops, MaskOps, Simd};

impl<'a, S: Simd> PacketTraversal<'a, S> {
    /// Tests the pulses in `mask`, each within its range of depths, against a block. Its hits may be found
    /// together with those of a later block. `enter` is the approximate minimum depth of the block.
    #[inline(always)]
    pub(super) fn visit_block(
        &mut self,
        block: &'a Block,
        mask: u32,
        enter: f32,
        lo: &[f32; PACKET_SIZE],
        hi: &[f32; PACKET_SIZE],
    ) {
        if block.holds_cubes() {
            self.flush_candidates();
            self.hit_cubes(block, mask, hi);
            return;
        }
        self.pair_triangles(Some(block), mask, enter, lo, hi);
    }

    /// Finds the hits of the pending pairs if there are enough of them.
    #[inline(always)]
    fn flush_full(&mut self) {
        if self.blocks.count == MAX_PENDING_BLOCKS || self.lists.batch_count * BLOCK_SIZE >= MIN_PENDING_PAIRS
        {
            self.flush_candidates();
        }
    }

    #[inline(always)]
    pub(super) fn flush_candidates(&mut self) {
        let simd = self.simd;
        if self.blocks.count > 0 {
            simd.outlined(
                #[inline(always)]
                || self.flush_pending(),
            );
        }
    }

    #[inline(always)]
    fn flush_pending(&mut self) {
        let touched = if self.offsets.is_empty() { self.flush_pulses() } else { self.flush_merged() };
        self.lower_limits(touched);
        self.blocks.count = 0;
        self.lists.clear();
    }

    /// Finds the hits of all pending pairs, span by span. Returns a mask of the pulses that may have hit
    /// something.
    #[inline(always)]
    fn flush_pulses(&mut self) -> u32 {
        let simd = self.simd;
        let Step { lists, input, .. } = self.step(0);
        simd.outlined(
            #[inline(always)]
            move || find_sides::<S, false>(simd, lists, input),
        );
        self.spread_pulses();
        let mut touched = 0;
        for span in 0..self.spans {
            let count = self.find_inside::<false>(span);
            let stride = self.registers;
            let first = self.first * stride + span * SPAN / 8;
            if self.instance.is_some() {
                let Step { lists, input, instance, rays, .. } = self.step(span);
                touched |= simd.outlined(
                    #[inline(always)]
                    move || hit_instance(simd, lists, input, instance, rays, count, (first, stride)),
                );
                continue;
            }
            let Step { lists, input, .. } = self.step(span);
            let (count, pulses) = simd.outlined(
                #[inline(always)]
                move || find_planes(simd, lists, input, count, (first, stride)),
            );
            touched |= pulses;
            let axis = self.frustum.axes[0];
            let Step { lists, rays, .. } = self.step(span);
            let open = simd.outlined(
                #[inline(always)]
                move || find_distances(simd, lists, rays, axis, count),
            );
            (0..open).for_each(|n| self.intersect_open(n));
        }
        touched
    }

    /// In the tree of a model, computes the deviations of the rays of all pulses that are partly inside a
    /// triangle.
    #[inline(always)]
    fn spread_pulses(&mut self) {
        let Some(frame) = &mut self.instance else { return };
        let mut new = self.lists.partial_pulses() & !frame.spread;
        frame.spread |= new;
        let (simd, frustum) = (self.simd, &self.frustum);
        while new != 0 {
            let lane = new.trailing_zeros() as usize % PACKET_SIZE;
            new &= new - 1;
            let row = (self.first + lane) * self.registers..(self.first + lane + 1) * self.registers;
            let directions = self.directions.map(|d| &d[row.clone()]);
            let slope = frustum.lane_shears.slope.map(|side| side.0[lane]);
            let deviations = &mut self.deviations[lane * self.wide..(lane + 1) * self.wide];
            set_deviations(simd, directions, &frame.matrix, frustum.axes, slope, deviations);
        }
    }

    /// Finds the hits of all pending pairs of merged pulses, which have one span. Returns a mask of the
    /// pulses that may have hit something.
    #[inline(always)]
    fn flush_merged(&mut self) -> u32 {
        let simd = self.simd;
        let Step { lists, input, .. } = self.step(0);
        simd.outlined(
            #[inline(always)]
            move || find_sides::<S, true>(simd, lists, input),
        );
        let count = self.find_inside::<true>(0);
        let (first, group) = (self.first * self.registers, self.rays);
        let Step { lists, input, rays, .. } = self.step(0);
        let origins = [0, 1, 2].map(|a| group.origin_lanes(a));
        let (open, touched) = simd.outlined(
            #[inline(always)]
            move || find_merged_distances(simd, lists, input, (rays, origins), (first, count)),
        );
        (0..open).for_each(|n| self.intersect_open(n));
        touched
    }

    /// Finds the rays of a span inside of triangles. Returns the number of pairs with such rays.
    #[inline(always)]
    fn find_inside<const MERGED: bool>(&mut self, span: usize) -> usize {
        let simd = self.simd;
        let rays = (self.rays.stride() - span * SPAN).min(SPAN);
        let valid = if rays == SPAN { !0 } else { (1u32 << rays) - 1 };
        let Step { lists, input, occlusion, .. } = self.step(span);
        let (count, open) = simd.outlined(
            #[inline(always)]
            move || find_inside::<S, MERGED>(simd, lists, input, occlusion, valid),
        );
        if open != 0 && self.instance.is_none() {
            let Step { lists, input, .. } = self.step(span);
            simd.outlined(
                #[inline(always)]
                move || refine_inside::<S, MERGED>(simd, lists, input, open),
            );
        }
        count
    }

    /// Borrows the parts of the traversal that a step needs.
    #[inline(always)]
    fn step(&mut self, span: usize) -> Step<'_, 'a, S> {
        let [first, second] = &self.leaves.blocks;
        Step {
            lists: &mut *self.lists,
            input: StepInput {
                blocks: if self.is_field { [Some(first), Some(second)] } else { self.blocks.blocks },
                pending: &self.blocks,
                frustum: &self.frustum,
                vertices: if self.is_field { &self.leaves.vertices } else { &self.geometry.vertices },
                deviations: &*self.deviations,
                offsets: self.offsets,
                wide: self.wide,
                span,
            },
            occlusion: &mut self.occlusion,
            rays: RayRegisters { directions: self.directions, t: &mut *self.t, ids: &mut *self.ids },
            instance: self.instance.as_ref(),
        }
    }

    #[inline(always)]
    pub(super) fn lower_limits(&mut self, mut touched: u32) {
        while touched != 0 {
            self.lower_limit(touched.trailing_zeros() as usize);
            touched &= touched - 1;
        }
    }

    /// Lowers the depth limit of a pulse: once all of its rays have hit something, objects behind the
    /// farthest of these hits are occluded.
    #[inline(always)]
    pub(super) fn lower_limit(&mut self, pulse: usize) {
        let first = (self.first + pulse) * self.registers;
        let mut farthest = self.simd.splat_f64(0.0);
        for t in &self.t[first..first + self.registers] {
            farthest = farthest.max(self.simd.load_f64(t));
        }
        let start = f64::from(self.frustum.start.0[pulse]);
        let depth = farthest.max_lane() * self.frustum.depth_per_t[pulse] + start;
        self.limit.0[pulse] = (depth * 1.000_000_4) as f32;
    }

    /// Finds, for each pulse in `mask`, the triangles whose slopes overlap those of the pulse, in a block of
    /// a tree, or in the next one of [`PacketTraversal::leaves`]. Their hits may be found together with those
    /// of a later block. `enter` is the approximate minimum depth of the block.
    #[inline(always)]
    pub(super) fn pair_triangles(
        &mut self,
        block: Option<&'a Block>,
        mut mask: u32,
        enter: f32,
        lo: &[f32; PACKET_SIZE],
        hi: &[f32; PACKET_SIZE],
    ) {
        let simd = self.simd;
        let (slot, lists) = (self.blocks.count % MAX_PENDING_BLOCKS, &mut *self.lists);
        let of_block = block.unwrap_or(&self.leaves.blocks[slot]);
        let mut count = lists.batch_count * BLOCK_SIZE;
        let range = if mask.is_power_of_two() && self.offsets.is_empty() {
            let p = mask.trailing_zeros() as usize % PACKET_SIZE;
            let range = DepthRange::of(&self.frustum, of_block);
            let within = range.overlaps(simd, [lo[p], hi[p]]).bits();
            if !lists.pair_pulse(&self.frustum, of_block, (slot, p), within) {
                return;
            }
            range
        } else {
            let cover_offsets = enter >= self.frustum.small_offsets_from;
            let slopes = BlockSlopes::of(&self.frustum, of_block, cover_offsets);
            while mask != 0 {
                let p = mask.trailing_zeros() as usize % PACKET_SIZE;
                let met = slopes.overlapping(&self.frustum, p, [lo[p], hi[p]]);
                if let Some(free) = lists.pairs[count..].first_chunk_mut() {
                    simd.write_lanes(met, (slot * MAX_BLOCK_PAIRS + p * BLOCK_SIZE) as u32, free);
                }
                count += met.count_ones() as usize;
                mask &= mask - 1;
            }
            if count == lists.batch_count * BLOCK_SIZE {
                return;
            }
            slopes.range
        };
        range.near.store(&mut self.blocks.near[slot]);
        range.far.store(&mut self.blocks.far[slot]);
        self.blocks.blocks[slot] = block;
        self.blocks.count += 1;
        while lists.batch_count * BLOCK_SIZE < count {
            let used = count - lists.batch_count * BLOCK_SIZE;
            let used = if used < BLOCK_SIZE { (1u32 << used) - 1 } else { 0xffff };
            lists.batches[lists.batch_count] = Batch { block: slot as u32, used, has_sides: false };
            lists.batch_count += 1;
        }
        self.flush_full();
    }

    /// Tests the pulses in `mask` against a block of cubes, or of boxes of instances.
    #[inline(always)]
    fn hit_cubes(&mut self, block: &Block, mask: u32, hi: &[f32; PACKET_SIZE]) {
        let (mut rest, mut touched) = (mask, 0);
        while rest != 0 {
            let p = rest.trailing_zeros() as usize % PACKET_SIZE;
            let planes = &self.frustum.pulse_planes(p);
            let (mut met, enter) =
                boxes_in_frustum(self.simd, planes, &block.corner[0], &block.corner[1], hi[p]);
            if let Some(visits) = &mut self.visits {
                record_instances(visits, block, p, met, enter);
                met = 0;
            }
            touched |= u32::from(met != 0) << p;
            while met != 0 {
                let id = block.id[met.trailing_zeros() as usize % BLOCK_SIZE];
                match self.geometry.locate_cube(id as usize - self.first_cube) {
                    (Some(grid), _) => self.record_grid(grid, p),
                    (None, cube) => self.hit_cube(self.first + p, id, self.geometry.cubes[cube]),
                }
                met &= met - 1;
            }
            rest &= rest - 1;
        }
        self.lower_limits(touched);
    }

    /// Tests all rays of a pulse, counted from that of the group, against a cube.
    #[inline(always)]
    pub(super) fn hit_cube(&mut self, pulse: usize, id: u32, cube: Cube) {
        let simd = self.simd;
        for register in pulse * self.registers..(pulse + 1) * self.registers {
            let (rays, first) = (self.rays, 8 * (register - pulse * self.registers));
            let mut lanes = self.rays_of(register);
            simd.outlined(
                #[inline(always)]
                move || lanes.intersect_cube(id, cube, |r| rays.origin_of(pulse, first + r)),
            );
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

    /// Applies the exact test to the rays of the `n`-th open register. Rays for which the fast distance is
    /// valid obtain the same result again.
    #[cold]
    #[inline(never)]
    fn intersect_open(&mut self, n: usize) {
        let candidates = self.lists.candidates[self.lists.open[n] as usize];
        let plane = &self.lists.planes[candidates.plane()];
        let (id, pulse) = (plane.id, self.first + plane.pulse as usize);
        let vertices = if self.is_field { &self.leaves.vertices[..] } else { &self.geometry.vertices };
        let corners = plane.vertex.map(|v| vertices[v as usize]);
        let register = candidates.register();
        let (rays, first) = (self.rays, 8 * (register - pulse * self.registers));
        let origin = |r| rays.origin_of(pulse, first + r);
        self.rays_of(register).intersect_exact(candidates.maybe(), id, corners, origin);
    }
}

struct Step<'k, 'a, S: Simd> {
    lists: &'k mut CandidateLists,
    input: StepInput<'k, S>,
    occlusion: &'k mut Occlusion,
    rays: RayRegisters<'k>,
    instance: Option<&'k InstanceFrame<'a>>,
}
