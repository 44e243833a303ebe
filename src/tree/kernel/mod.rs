//! Tracing many pulses: up to sixteen neighbours, a packet, walk the tree together.
//!
//! A pulse alone is a handful of nodes and triangles, so that most of its time goes into mispredicted branches and
//! waiting for memory. A packet shares every decision among some hundred rays: lanes are the children of a node, then the
//! pulses, then the triangles of a block, then pairs of a pulse and a triangle, and at last the rays of one pulse for one
//! triangle, where distances are computed. So that pulses of few rays fill those last lanes, too, neighbours are merged:
//! sixteen rays, each with its own origin, are traced like one pulse.
//!
//! | file | what it does |
//! |---|---|
//! | `lanes`, `packet`, `spread` | the frustums of sixteen pulses side by side, and how the rays of a pulse spread |
//! | `traversal` | a packet on its way through a tree |
//! | `walk`, `filter` | nodes and boxes against them |
//! | `leaf` | which pulse may meet which triangle of a block: pairs |
//! | `candidates` | what becomes of the pairs, step by step |
//! | `sides`, `edges` | which rays are inside: from single precision, and from double where that leaves it open |
//! | `distance` | distances |
//! | `instances`, `instance_frame` | which instances a packet meets, and their triangles in the frame of the model |

mod candidates;
mod distance;
mod edges;
mod filter;
mod instance_frame;
mod instances;
mod lanes;
mod leaf;
mod packet;
mod sides;
mod spread;
mod traversal;
mod walk;

use super::rays::{Hits, RayGroup};
use super::simd::{Level, Simd, dispatch};
use super::{Geometry, Tree};
use instances::InstanceScratch;
use packet::{PacketFrustum, count_neighbours};
use std::ops::Range;
use traversal::{PacketScratch, PacketTraversal};

/// Memory of traversals, for one thread; what it holds from one to the next means nothing.
#[derive(Default)]
pub struct TraceScratch {
    packet: Box<PacketScratch>,
    instances: Option<Box<InstanceScratch>>,
    /// Merged pulses, their hits, and where these belong.
    merged: (RayGroup, Hits, Vec<u32>),
}

impl Tree {
    /// First hits of all rays of many pulses. Ray `r` of pulse `p` has its hit at `p · rays.stride() + r`; what stands between
    /// the rows means nothing. `hits` is resized and overwritten.
    ///
    /// Runs of neighbouring pulses are traced together, by the widest instructions that the machine has. Bit for bit, the
    /// hits are what [`Tree::nearest_where`] finds for each ray.
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
            dispatch!(level, simd => trace_packets(simd, self, geometry, rays, hits, packet));
            return;
        }
        merged.merge_pulses(rays, places);
        merged_hits.resize(merged.len() * merged.stride());
        dispatch!(level, simd => trace_packets(simd, self, geometry, merged, merged_hits, packet));
        hits.take_merged(merged_hits, places);
    }
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
            // Perhaps the first alone has a dominant axis.
            count = 1;
        }
        first += count;
    }
}

/// Traces some pulses together; returns false if they make no packet.
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
    packet.walk(tree, (1 << pulses.len()) - 1);
    true
}

/// Traces one pulse ray by ray.
#[cold]
fn trace_single_rays(tree: &Tree, geometry: &Geometry, rays: &RayGroup, pulse: usize, hits: &mut Hits) {
    for r in 0..rays.rays() {
        let (origin, direction) = (rays.origin_of(pulse, r), rays.direction(pulse, r));
        if let Some(hit) = tree.nearest_primitive(geometry, origin, direction, |_| true) {
            let at = pulse * rays.stride() + r;
            (hits.t[at], hits.primitive[at]) = (hit.t, hit.primitive);
        }
    }
}
