//! Height fields in a packet's traversal: nodes of the pyramid like those of the wide tree, and leaves whose triangles are
//! computed as blocks when they are visited.

use super::candidates::MAX_PENDING_BLOCKS;
use super::filter::{box_in_pulses, boxes_in_frustum};
use super::lanes::PACKET_SIZE;
use super::traversal::PacketTraversal;
use crate::block::Block;
use crate::frame::Frame;
use crate::heights::{FieldNode, FieldView, HeightField, LEAF_VERTICES};
use crate::simd::{F32Ops, Simd};
use vlscan_geom::DVec3;

/// Memory of the pending leaves of a field: their triangles and vertices.
pub(super) struct FieldLeaves {
    pub blocks: [Block; MAX_PENDING_BLOCKS],
    pub vertices: [DVec3; MAX_PENDING_BLOCKS * LEAF_VERTICES],
}

impl FieldLeaves {
    pub const EMPTY: FieldLeaves = FieldLeaves {
        blocks: [Block::EMPTY; MAX_PENDING_BLOCKS],
        vertices: [DVec3::ZERO; MAX_PENDING_BLOCKS * LEAF_VERTICES],
    };
}

/// A pending node of a field: the pulses that hit it, and the minimum depth of entry.
#[derive(Clone, Copy)]
pub(super) struct FieldVisit {
    pub node: FieldNode,
    pub enter: f32,
    pub pulses: u32,
}

impl FieldVisit {
    pub const NONE: FieldVisit = FieldVisit { node: FieldNode::NONE, enter: 0.0, pulses: 0 };
}

impl<S: Simd> PacketTraversal<'_, S> {
    /// Traverses a height field with the pulses in a mask, front to back.
    #[inline(always)]
    pub(super) fn walk_field(&mut self, field: &HeightField, frame: &Frame, pulses: u32) {
        let view = FieldView::new(field, frame);
        let Some(node) = view.root() else { return };
        self.is_field = true;
        self.stacks.field[0] = FieldVisit { node, enter: 0.0, pulses };
        let (is_single, mut height) = (pulses == 1, 1);
        while height > 0 {
            height -= 1;
            let FieldVisit { node, enter, pulses } = self.stacks.field[height];
            let pulses = pulses & self.within_limit(enter);
            if pulses == 0 {
                continue;
            }
            if node.level > 0 {
                height = self.push_field_children(&view, node, pulses, is_single, height);
                continue;
            }
            let slot = self.blocks.count % MAX_PENDING_BLOCKS;
            let base = slot * LEAF_VERTICES;
            if view.fill(node, base as u32, &mut self.leaves.blocks[slot], &mut self.leaves.vertices[base..])
            {
                let limit = self.limit.0;
                self.pair_triangles(None, pulses, enter, &[0.0; PACKET_SIZE], &limit);
            }
        }
        self.flush_candidates();
        self.is_field = false;
    }

    /// Pushes the children of a node that the pulses hit on the stack, the nearest on top. Returns the new height of
    /// the stack.
    #[inline(always)]
    fn push_field_children(
        &mut self,
        view: &FieldView,
        node: FieldNode,
        pulses: u32,
        is_single: bool,
        floor: usize,
    ) -> usize {
        let [lower, upper] = view.boxes(node);
        let (mut depths, mut height) = ([0.0; PACKET_SIZE], floor);
        let limit = self.simd.load(&self.limit.0).max_lane();
        let (mut met, enter) = boxes_in_frustum(self.simd, &self.frustum.hull, &lower, &upper, limit);
        enter.store(&mut depths);
        while met != 0 {
            let lane = met.trailing_zeros() as usize;
            met &= met - 1;
            let corner =
                |corners: &[[f32; PACKET_SIZE]; 3]| [corners[0][lane], corners[1][lane], corners[2][lane]];
            // The hull of a single pulse is that pulse.
            let meeting = match is_single {
                true => pulses,
                false => pulses & box_in_pulses(&self.frustum, corner(&lower), corner(&upper), &self.limit),
            };
            if meeting == 0 {
                continue;
            }
            let stack = &mut self.stacks.field;
            let mut at = height;
            while at > floor && stack[at - 1].enter < depths[lane] {
                stack[at] = stack[at - 1];
                at -= 1;
            }
            stack[at] = FieldVisit { node: node.child(lane), enter: depths[lane], pulses: meeting };
            height += 1;
        }
        height
    }
}
