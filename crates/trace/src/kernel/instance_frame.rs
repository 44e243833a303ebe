//! Instances in a packet's traversal: the instances hit, and the triangles of an instance in the scene.

use super::candidates::{CandidateLists, Inside, RayRegisters, SPAN, StepInput, block_of, lane_of, pulse_of};
use super::distance::{Heading, Rays};
use super::lanes::PACKET_SIZE;
use super::spread::OriginLanes;
use crate::block::{BLOCK_SIZE, Block};
use crate::instances::Instance;
use crate::simd::{F32Ops, Simd};
use glam::DMat3;
use vlscan_geom::DVec3;

/// An instance whose box is hit by pulses of a packet, and the minimum depth of entry.
#[derive(Clone, Copy)]
pub(super) struct InstanceVisit {
    pub enter: f32,
    pub pulses: u32,
    pub instance: u32,
}

/// An instance whose model a packet traverses, and facts about the rays in the scene's frame.
pub(super) struct InstanceFrame<'a> {
    pub instance: &'a Instance,
    pub vertices: &'a [DVec3],
    /// Subtracted from every placed point, m.
    pub shift: DVec3,
    /// The matrix of directions into the model's frame.
    pub matrix: DMat3,
    /// The pulses whose deviations are known in the model's frame.
    pub spread: u32,
    /// Dominant axis of the rays in the scene.
    pub axis: usize,
    pub forward: f64,
    pub origins: &'a OriginLanes,
    pub max_along: &'a [f64; PACKET_SIZE],
}

/// Computes the distances of the first `count` pairs in `inside`. `first` is the first register of eight rays
/// of the first pulse's span, `stride` the number of registers per pulse. Returns a mask of the pulses among
/// the pairs.
#[inline(always)]
pub(super) fn hit_instance<S: Simd>(
    simd: S,
    lists: &mut CandidateLists,
    input: StepInput<S>,
    frame: Option<&InstanceFrame>,
    rays: RayRegisters,
    count: usize,
    (first, stride): (usize, usize),
) -> u32 {
    let Some(frame) = frame else { return 0 };
    let InstanceFrame { instance, vertices, shift, axis, forward, .. } = *frame;
    let (blocks, RayRegisters { directions, t, ids }) = (input.blocks, rays);
    let CandidateLists { inside, planes, .. } = lists;
    let plane = &mut planes[0];
    let mut touched = 0;
    for Inside { pair, strictly, maybe } in &inside[..count] {
        let (pulse, lane) = (pulse_of(*pair), lane_of(*pair));
        let Some(block) = blocks[block_of(*pair)] else { continue };
        touched |= 1 << pulse;
        let origin = frame.origins.get(pulse);
        let vertex = |c: usize| vertices[block.vertex[c][lane] as usize];
        let corners = [vertex(0), vertex(1), vertex(2)].map(|v| instance.placement.place(v, shift));
        let [a, b, c] = &corners;
        plane.id = instance.first + block.id[lane];
        let heading = Heading { axis, forward, max_along: frame.max_along[pulse] };
        plane.set(simd, [a.as_ref(), b.as_ref(), c.as_ref()], origin.as_ref(), heading);
        for n in 0..SPAN / 8 {
            let [sure, any] = [strictly, maybe].map(|m| m >> (8 * n) & 255);
            let register = first + pulse * stride + n;
            if any == 0 || register >= t.len() {
                continue;
            }
            let directions = directions.map(|d| &d[register]);
            let (t, id) = (&mut t[register], &mut ids[register]);
            let sound = plane.hit(simd, sure, directions, directions[axis], (t, id));
            let open = any & !sound;
            if open != 0 {
                Rays { directions, t, id }.intersect_exact(open, plane.id, corners, |_| origin);
            }
        }
    }
    touched
}

/// Records the instances in a block that pulse `p` hits: `met` are their lanes and `enter` the depths of
/// entry.
#[inline(always)]
pub(super) fn record_instances(
    visits: &mut Vec<InstanceVisit>,
    block: &Block,
    p: usize,
    mut met: u32,
    enter: impl F32Ops,
) {
    let mut depths = [0.0; BLOCK_SIZE];
    enter.store(&mut depths);
    while met != 0 {
        let lane = met.trailing_zeros() as usize % BLOCK_SIZE;
        let (instance, enter) = (block.id[lane], depths[lane]);
        // All pulses visit a block one after the other, so a recorded instance is among the last ones.
        let known = visits.iter_mut().rev().take(BLOCK_SIZE).find(|m| m.instance == instance);
        match known {
            Some(known) => {
                known.pulses |= 1 << p;
                known.enter = known.enter.min(enter);
            }
            None => visits.push(InstanceVisit { enter, pulses: 1 << p, instance }),
        }
        met &= met - 1;
    }
}
