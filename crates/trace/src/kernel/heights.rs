//! Height fields in a packet's traversal: nodes of the pyramid like those of the wide tree, and leaves whose
//! triangles are computed as blocks when they are visited.

use super::candidates::MAX_PENDING_BLOCKS;
use super::lanes::PACKET_SIZE;
use super::traversal::{PacketTraversal, Visit};
use crate::block::Block;
use crate::frame::Frame;
use crate::heights::{BoxNode, FieldBoxes, FieldView, HeightField, LEAF_VERTICES};
use crate::simd::Simd;
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

impl<S: Simd> PacketTraversal<'_, S> {
    /// Traverses the height fields whose boxes the pulses in a mask hit, the nearest first.
    #[inline(always)]
    pub(super) fn walk_fields(&mut self, boxes: &FieldBoxes, frame: &Frame, pulses: u32) {
        let Some(root) = boxes.root() else { return };
        let simd = self.simd;
        simd.outlined(
            #[inline(always)]
            || self.walk_boxes(boxes, root, frame, pulses),
        );
    }

    #[inline(always)]
    fn walk_boxes(&mut self, boxes: &FieldBoxes, root: BoxNode, frame: &Frame, pulses: u32) {
        self.stacks.boxes[0] = Visit::root(root, pulses);
        let mut height = 1;
        while let Some(visit) = self.pop_visit(|stacks| &stacks.boxes, &mut height) {
            let Visit { node, pulses, .. } = visit;
            if let Some(field) = node.field() {
                if let Some(field) = self.geometry.fields.get(field) {
                    self.walk_field(field, frame, pulses);
                }
                continue;
            }
            let children = boxes.children(node);
            height = self.push_children(
                |stacks| &mut stacks.boxes,
                (height, pulses),
                (&children.lower, &children.upper, !0),
                |lane| node.child(lane),
            );
        }
    }

    /// Traverses a height field with the pulses in a mask, front to back.
    #[inline(always)]
    fn walk_field(&mut self, field: &HeightField, frame: &Frame, pulses: u32) {
        let view = FieldView::new(field, frame);
        let Some(node) = view.root() else { return };
        self.is_field = true;
        self.stacks.field[0] = Visit::root(node, pulses);
        let mut height = 1;
        while let Some(visit) = self.pop_visit(|stacks| &stacks.field, &mut height) {
            let Visit { node, enter, pulses } = visit;
            if node.level > 0 {
                let [lower, upper] = view.boxes(node);
                height = self.push_children(
                    |stacks| &mut stacks.field,
                    (height, pulses),
                    (&lower, &upper, !0),
                    |lane| node.child(lane),
                );
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
}
