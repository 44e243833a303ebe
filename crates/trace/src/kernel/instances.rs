//! Tracing of instances by packets: a packet traverses the tree over their boxes once, and then, nearest
//! first, the trees of the models whose instances it hits. In these trees the rays are those of the model's
//! frame, and so are all decisions in single precision; undecided cases and all distances are computed from
//! the corners in the scene, as if they were stored.

use super::instance_frame::{InstanceFrame, InstanceVisit};
use super::lanes::PACKET_SIZE;
use super::packet::{PacketFrustum, count_neighbours};
use super::spread::OriginLanes;
use super::traversal::{PacketScratch, PacketTraversal};
use crate::index::InstanceTree;
use crate::instances::Instance;
use crate::simd::{Level, Simd, dispatch};
use crate::{Geometry, Hits, RayGroup};
use std::ops::Range;

/// Memory of traversals of both levels, for one thread.
#[derive(Default)]
pub struct InstanceScratch {
    top: PacketScratch,
    model: PacketScratch,
    visits: Vec<InstanceVisit>,
    /// Hits of a group on the geometry itself.
    own_hits: Hits,
}

impl InstanceTree {
    /// Merges the hits of the instances into the hits of a group that was traced without them.
    pub(crate) fn trace_group(
        &self,
        level: Level,
        geometry: &Geometry,
        group: &RayGroup,
        hits: &mut Hits,
        scratch: &mut InstanceScratch,
    ) {
        // Instances first win all equal distances, with the lowest number among all instances. If that one
        // does not come before the geometry's primitive, no other does.
        scratch.own_hits.clone_from(hits);
        hits.primitive.fill(Hits::MISS);
        dispatch!(level, simd => trace_packets(simd, self, geometry, group, hits, scratch));
        let own = scratch.own_hits.t.iter().zip(&scratch.own_hits.primitive);
        for ((t, id), (own_t, own)) in hits.t.iter().zip(&mut hits.primitive).zip(own) {
            let is_equal = *own != Hits::MISS && t == own_t;
            if *id == Hits::MISS || (is_equal && !self.comes_before(*id, *own)) {
                *id = *own;
            }
        }
    }

    /// True if triangle `new` of an instance comes before primitive `own` of the geometry.
    fn comes_before(&self, new: u32, own: u32) -> bool {
        let place = self.instances.locate(new).map(|(instance, _)| self.instances.all[instance].before);
        place.is_some_and(|before| self.instances.comes_first(new, before, own))
    }
}

/// Finds the hits of a group on the instances that are not farther than the given `hits`.
#[inline(always)]
fn trace_packets<S: Simd>(
    simd: S,
    tree: &InstanceTree,
    geometry: &Geometry,
    rays: &RayGroup,
    hits: &mut Hits,
    scratch: &mut InstanceScratch,
) {
    scratch.top.resize_for(rays);
    scratch.model.resize_for(rays);
    let mut first = 0;
    while first < rays.len() {
        let mut count = count_neighbours(rays, first);
        loop {
            if trace_packet(simd, tree, geometry, rays, first..first + count, hits, scratch) {
                break;
            }
            if count == 1 {
                tree.trace_pulse(rays, first, hits);
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
    tree: &InstanceTree,
    geometry: &Geometry,
    rays: &RayGroup,
    pulses: Range<usize>,
    hits: &mut Hits,
    scratch: &mut InstanceScratch,
) -> bool {
    let InstanceScratch { top, model, visits, .. } = scratch;
    let out = (&mut top.deviations[..], &mut [][..]);
    let frame = &tree.top.frame;
    let Some(frustum) = PacketFrustum::around(simd, frame, rays, pulses.clone(), out, 0.0) else {
        return false;
    };
    let mut origins = OriginLanes([[0.0; PACKET_SIZE]; 3]);
    pulses.clone().enumerate().for_each(|(lane, pulse)| origins.set(lane, rays.origin(pulse)));
    visits.clear();
    let all = (1u32 << pulses.len()) - 1;
    let mut packet = PacketTraversal::of(geometry, rays, pulses.start, hits.registers(), frustum, top);
    packet.visits = Some(visits);
    packet.lower_limits(all);
    packet.walk(&tree.top, all);
    let Some(visits) = packet.visits.take() else { return true };
    visits.sort_unstable_by(|a, b| a.enter.total_cmp(&b.enter));
    for InstanceVisit { enter, pulses, instance } in visits.iter() {
        let pulses = pulses & packet.within_limit(*enter);
        if pulses != 0 {
            packet.visit_instance(tree, *instance, pulses, &origins, model);
            packet.lower_limits(pulses);
        }
    }
    true
}

impl<S: Simd> PacketTraversal<'_, S> {
    /// Merges the hits of an instance into the hits of the `pulses`.
    #[inline(always)]
    fn visit_instance(
        &mut self,
        tree: &InstanceTree,
        number: u32,
        pulses: u32,
        origins: &OriginLanes,
        scratch: &mut PacketScratch,
    ) {
        let instance = &tree.instances.all[number as usize];
        if self.walk_model(tree, instance, pulses, origins, scratch) {
            return;
        }
        let mut rest = pulses;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            // A pulse alone may have a dominant axis.
            if self.walk_model(tree, instance, 1 << lane, origins, scratch) {
                continue;
            }
            let pulse = self.first + lane;
            let row = pulse * self.registers..(pulse + 1) * self.registers;
            let (t, ids) = (self.t[row.clone()].as_flattened_mut(), self.ids[row].as_flattened_mut());
            tree.visit_pulse(instance, self.rays, pulse, t, ids);
        }
    }

    /// Traverses the model's tree with the `pulses`. Returns false if they cannot form a packet in its frame.
    #[inline(always)]
    fn walk_model(
        &mut self,
        tree: &InstanceTree,
        instance: &Instance,
        pulses: u32,
        origins: &OriginLanes,
        scratch: &mut PacketScratch,
    ) -> bool {
        let simd = self.simd;
        simd.outlined(
            #[inline(always)]
            || self.walk_in_model(tree, instance, pulses, origins, scratch),
        )
    }

    #[inline(always)]
    fn walk_in_model(
        &mut self,
        tree: &InstanceTree,
        instance: &Instance,
        pulses: u32,
        origins: &OriginLanes,
        scratch: &mut PacketScratch,
    ) -> bool {
        let Some(way) = tree.instances.world_to_instance(instance) else { return false };
        let model = &tree.models[instance.model as usize];
        let Some(frustum) = self.frustum.in_model(&model.frame, &way, origins, pulses) else { return false };
        let geometry = &tree.instances.model(instance).geometry;
        let hits = (&mut *self.t, &mut *self.ids);
        let mut packet = PacketTraversal::of(geometry, self.rays, self.first, hits, frustum, scratch);
        packet.instance = Some(InstanceFrame {
            instance,
            vertices: &geometry.vertices,
            shift: tree.instances.shift,
            matrix: way.matrix(),
            spread: 0,
            axis: self.frustum.axes[0],
            forward: f64::from(self.frustum.forward),
            origins,
            max_along: &self.frustum.max_along,
        });
        packet.lower_limits(pulses);
        packet.walk(model, pulses);
        true
    }
}
