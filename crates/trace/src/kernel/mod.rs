//! Tracing of many pulses: up to sixteen neighbours, a packet, traverse the tree together.
//!
//! A single pulse visits a handful of nodes and triangles, so that most of its time is spent on mispredicted
//! branches and waiting for memory. A packet shares every decision among some hundred rays: lanes are the
//! children of a node, then the pulses, then the triangles of a block, then pairs of a pulse and a triangle,
//! and finally the rays of one pulse for one triangle, where distances are computed. To fill those last lanes
//! with pulses of few rays, too, neighbours are merged: sixteen rays, each with its own origin, are traced
//! like one pulse.
//!
//! | file | contents |
//! |---|---|
//! | `lanes`, `packet`, `spread` | the frustums of sixteen pulses side by side, and the spread of a pulse's rays |
//! | `traversal` | the state of a packet's traversal |
//! | `walk`, `filter` | traversal of the nodes; tests of boxes |
//! | `leaf` | pairs of a pulse and a triangle of a block that it may hit |
//! | `candidates` | processing of the pairs, step by step |
//! | `sides`, `edges` | the rays inside a triangle: in single precision, and in double precision where that is
//! undecided |
//! | `distance` | distances |
//! | `heights` | traversal of height fields, whose leaves become blocks when they are visited |
//! | `instances`, `model_frame` | the instances that a packet hits; the packet in the frame of a model |
//! | `instance_frame` | triangles of an instance in the scene |
//! | `voxels` | traversal of grids of voxels |

mod candidates;
mod distance;
mod edges;
mod filter;
mod heights;
mod instance_frame;
mod instances;
mod lanes;
mod leaf;
mod model_frame;
mod packet;
mod sides;
mod spread;
mod traversal;
mod voxels;
mod walk;

use super::rays::{Hits, RayGroup};
use super::simd::{Level, Simd, dispatch};
use super::{Geometry, Tree};
use instances::InstanceScratch;
use packet::{PacketFrustum, count_neighbours};
use std::ops::Range;
use traversal::{PacketScratch, PacketTraversal};

/// Memory of traversals, for one thread; carries no state from one call to the next.
#[derive(Default)]
pub struct TraceScratch {
    packet: Box<PacketScratch>,
    instances: Option<Box<InstanceScratch>>,
    /// Merged pulses, their hits, and the indices of these hits in the group.
    merged: (RayGroup, Hits, Vec<u32>),
}

impl Tree {
    /// First hits of all rays of many pulses. The hit of ray `r` of pulse `p` is at `p · rays.stride() + r`;
    /// entries between the rows are unspecified. `hits` is resized and overwritten.
    ///
    /// Runs of neighbouring pulses are traced together, with the widest instructions of the machine. The hits
    /// equal those of [`Tree::nearest_where`] for each ray, bit for bit.
    pub fn trace_group(
        &self,
        geometry: &Geometry,
        rays: &RayGroup,
        hits: &mut Hits,
        scratch: &mut TraceScratch,
    ) {
        self.trace_group_on(Level::best(), geometry, rays, hits, scratch);
    }

    /// [`Tree::trace_group`] on a given instruction set.
    pub(super) fn trace_group_on(
        &self,
        level: Level,
        geometry: &Geometry,
        rays: &RayGroup,
        hits: &mut Hits,
        scratch: &mut TraceScratch,
    ) {
        self.trace_primitives(level, geometry, rays, hits, scratch);
        if let Some(instances) = &self.instances {
            let scratch = scratch.instances.get_or_insert_default();
            instances.trace_group(level, geometry, rays, hits, scratch);
        }
    }

    /// First hits among the primitives that are not part of an instance.
    fn trace_primitives(
        &self,
        level: Level,
        geometry: &Geometry,
        rays: &RayGroup,
        hits: &mut Hits,
        scratch: &mut TraceScratch,
    ) {
        hits.resize(rays.len() * rays.stride());
        if rays.rays() == 0 {
            return;
        }
        let TraceScratch { packet, merged: (merged, merged_hits, places), .. } = scratch;
        if rays.rays() > RayGroup::MAX_MERGEABLE_RAYS {
            trace_packets_on(level, self, geometry, rays, hits, packet);
            return;
        }
        merged.merge_pulses(rays, places);
        merged_hits.resize(merged.len() * merged.stride());
        trace_packets_on(level, self, geometry, merged, merged_hits, packet);
        hits.take_merged(merged_hits, places);
    }
}

fn trace_packets_on(
    level: Level,
    tree: &Tree,
    geometry: &Geometry,
    rays: &RayGroup,
    hits: &mut Hits,
    scratch: &mut PacketScratch,
) {
    dispatch!(level, simd => trace_packets(simd, tree, geometry, rays, hits, scratch));
}

#[inline(always)]
fn trace_packets<S: Simd>(
    simd: S,
    tree: &Tree,
    geometry: &Geometry,
    rays: &RayGroup,
    hits: &mut Hits,
    scratch: &mut PacketScratch,
) {
    scratch.resize_for(rays);
    let mut first = 0;
    while first < rays.len() {
        let mut count = count_neighbours(rays, first);
        hits.clear(first * rays.stride()..(first + count) * rays.stride());
        loop {
            if trace_packet(simd, tree, geometry, rays, first..first + count, hits, scratch) {
                break;
            }
            if count == 1 {
                trace_single_rays(tree, geometry, rays, first, hits);
                break;
            }
            // The first pulse alone may have a dominant axis.
            count = 1;
        }
        first += count;
    }
}

/// Traces some pulses together. Returns false if they cannot form a packet.
#[inline(always)]
fn trace_packet<S: Simd>(
    simd: S,
    tree: &Tree,
    geometry: &Geometry,
    rays: &RayGroup,
    pulses: Range<usize>,
    hits: &mut Hits,
    scratch: &mut PacketScratch,
) -> bool {
    let out = (&mut scratch.deviations[..], &mut scratch.offsets[..]);
    let Some(frustum) = PacketFrustum::around(simd, &tree.frame, rays, pulses.clone(), out, 0.0) else {
        return false;
    };
    let mut packet = PacketTraversal::of(geometry, rays, pulses.start, hits.registers(), frustum, scratch);
    packet.limit.0[..pulses.len()].fill(f32::INFINITY);
    let all = (1 << pulses.len()) - 1;
    packet.walk(tree, all);
    packet.walk_fields(&tree.fields, &tree.frame, all);
    packet.walk_grids(&tree.frame);
    true
}

#[cold]
fn trace_single_rays(tree: &Tree, geometry: &Geometry, rays: &RayGroup, pulse: usize, hits: &mut Hits) {
    for r in 0..rays.rays() {
        let (origin, direction) = (rays.origin_of(pulse, r), rays.direction(pulse, r));
        if let Some(hit) = tree.nearest_primitive(geometry, origin, direction, &|_| true) {
            let at = pulse * rays.stride() + r;
            (hits.t[at], hits.primitive[at]) = (hit.t, hit.primitive);
        }
    }
}
