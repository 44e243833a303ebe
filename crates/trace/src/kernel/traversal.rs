//! The state of a packet's traversal of a tree, and the memory that it borrows.

use super::candidates::{CandidateLists, Occlusion, PendingBlocks};
use super::heights::FieldLeaves;
use super::instance_frame::{InstanceFrame, InstanceVisit};
use super::lanes::{PACKET_SIZE, PerPulse};
use super::packet::PacketFrustum;
use super::spread::{Deviations, OriginOffsets};
use crate::build::MAX_DEPTH;
use crate::heights::{BoxNode, FieldNode, MAX_BOX_STACK, MAX_FIELD_STACK};
use crate::node::WideChild;
use crate::simd::Simd;
use crate::trace::MAX_WIDE_STACK;
use crate::voxels::{GridNode, MAX_GRID_STACK};
use crate::{Geometry, RayGroup};

pub(super) struct PacketTraversal<'a, S: Simd> {
    pub simd: S,
    pub geometry: &'a Geometry,
    /// Number of the first cube.
    pub first_cube: usize,
    pub rays: &'a RayGroup,
    pub directions: [&'a [[f64; 8]]; 3],
    pub t: &'a mut [[f64; 8]],
    pub ids: &'a mut [[u32; 8]],
    /// Registers of eight rays per pulse.
    pub registers: usize,
    /// Registers of sixteen rays per pulse.
    pub wide: usize,
    /// Spans of 32 rays per pulse.
    pub spans: usize,
    pub first: usize,
    pub frustum: PacketFrustum<S>,
    /// In the tree of a model they are computed when a pulse comes upon a triangle.
    pub deviations: &'a mut [Deviations],
    /// Origins of the rays of merged pulses; empty for others.
    pub offsets: &'a [OriginOffsets],
    /// Depth beyond which nothing can be nearer than the hits of each pulse.
    pub limit: PerPulse,
    pub occlusion: Occlusion,
    pub stacks: &'a mut Stacks,
    pub blocks: PendingBlocks<'a>,
    pub lists: &'a mut CandidateLists,
    /// In a height field: the pending blocks, which are not those of a tree.
    pub leaves: &'a mut FieldLeaves,
    pub is_field: bool,
    /// The grids of voxels that were met, and the pulses that hit their boxes.
    pub grids: &'a mut Vec<(usize, u32)>,
    /// In a tree over instances: the instances hit.
    pub visits: Option<&'a mut Vec<InstanceVisit>>,
    /// In the tree of a model: the instance.
    pub instance: Option<InstanceFrame<'a>>,
}

impl<'a, S: Simd> PacketTraversal<'a, S> {
    /// Creates a traversal by the pulses from `first` on, which `frustum` encloses. Their initial limits
    /// exclude every hit.
    #[inline(always)]
    pub fn of(
        geometry: &'a Geometry,
        rays: &'a RayGroup,
        first: usize,
        (t, ids): (&'a mut [[f64; 8]], &'a mut [[u32; 8]]),
        frustum: PacketFrustum<S>,
        scratch: &'a mut PacketScratch,
    ) -> PacketTraversal<'a, S> {
        PacketTraversal {
            simd: frustum.simd,
            geometry,
            first_cube: geometry.triangle_count(),
            rays,
            directions: [0, 1, 2].map(|a| rays.lanes(a)),
            t,
            ids,
            registers: rays.stride() / RayGroup::WIDTH,
            wide: rays.stride().div_ceil(16),
            spans: rays.stride().div_ceil(32),
            first,
            frustum,
            deviations: &mut scratch.deviations,
            offsets: &scratch.offsets,
            limit: PerPulse([f32::NEG_INFINITY; PACKET_SIZE]),
            occlusion: Occlusion::NONE,
            stacks: &mut scratch.stacks,
            blocks: PendingBlocks::NONE,
            lists: &mut scratch.lists,
            leaves: &mut scratch.leaves,
            is_field: false,
            grids: &mut scratch.grids,
            visits: None,
            instance: None,
        }
    }
}

/// A pending node of the kd-tree: the pulses that hit it, and the depths at which they do.
#[derive(Clone, Copy)]
pub(super) struct KdVisit {
    pub node: u32,
    pub pulses: u32,
    pub lo: PerPulse,
    pub hi: PerPulse,
}

impl KdVisit {
    pub const ROOT: KdVisit = KdVisit { node: 0, pulses: 0, lo: PerPulse::ZERO, hi: PerPulse::ZERO };
}

/// A pending node or leaf: the pulses that hit it, and the minimum depth of entry.
#[derive(Clone, Copy)]
pub(super) struct Visit<N> {
    pub node: N,
    pub enter: f32,
    pub pulses: u32,
}

impl<N> Visit<N> {
    /// A root.
    pub const fn root(node: N, pulses: u32) -> Visit<N> {
        Visit { node, enter: 0.0, pulses }
    }
}

pub(super) struct Stacks {
    pub kd: [KdVisit; MAX_DEPTH as usize + 1],
    pub wide: [Visit<WideChild>; MAX_WIDE_STACK],
    /// Nodes over the boxes of height fields.
    pub boxes: [Visit<BoxNode>; MAX_BOX_STACK],
    pub field: [Visit<FieldNode>; MAX_FIELD_STACK],
    pub grid: [Visit<GridNode>; MAX_GRID_STACK],
}

impl Stacks {
    const EMPTY: Stacks = Stacks {
        kd: [KdVisit::ROOT; MAX_DEPTH as usize + 1],
        wide: [Visit::root(WideChild::ROOT, 0); MAX_WIDE_STACK],
        boxes: [Visit::root(BoxNode::NONE, 0); MAX_BOX_STACK],
        field: [Visit::root(FieldNode::NONE, 0); MAX_FIELD_STACK],
        grid: [Visit::root(GridNode::NONE, 0); MAX_GRID_STACK],
    };
}

/// Memory of the traversal of one tree.
pub(super) struct PacketScratch {
    pub deviations: Vec<Deviations>,
    pub offsets: Vec<OriginOffsets>,
    pub stacks: Stacks,
    pub lists: CandidateLists,
    pub leaves: FieldLeaves,
    pub grids: Vec<(usize, u32)>,
}

impl Default for PacketScratch {
    fn default() -> PacketScratch {
        PacketScratch {
            deviations: Vec::new(),
            offsets: Vec::new(),
            stacks: Stacks::EMPTY,
            lists: CandidateLists::EMPTY,
            leaves: FieldLeaves::EMPTY,
            grids: Vec::new(),
        }
    }
}

impl PacketScratch {
    pub fn resize_for(&mut self, rays: &RayGroup) {
        let registers = PACKET_SIZE * rays.stride().div_ceil(16);
        self.deviations.resize(registers, [[0.0; 16]; 2]);
        self.offsets.resize(if rays.is_merged() { registers } else { 0 }, [[0.0; 16]; 3]);
    }
}
