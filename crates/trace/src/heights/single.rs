//! Tracing of single rays among the triangles of a field.

use super::pyramid::MAX_FIELD_STACK;
use super::{FieldNode, FieldView, HeightField, LEAF_VERTICES};
use crate::block::Block;
use crate::frame::Frame;
use crate::frustum::Frustum;
use crate::intersect::triangle;
use crate::stack::{pop_within, push_children};
use vlscan_geom::DVec3;

impl HeightField {
    /// Visits the triangles that a ray of the frustum might hit, nearest leaves first, up to the depth
    /// `limit`. `visit` takes number and corners of a triangle and returns the new limit.
    pub(crate) fn walk(
        &self,
        frame: &Frame,
        frustum: &Frustum,
        mut limit: f32,
        mut visit: impl FnMut(u32, [DVec3; 3]) -> f32,
    ) {
        let view = FieldView::new(self, frame);
        let Some(root) = view.root() else { return };
        let mut stack = [(FieldNode::NONE, 0.0f32); MAX_FIELD_STACK];
        stack[0].0 = root;
        let mut height = 1;
        let (mut block, mut vertices) = (Block::EMPTY, [DVec3::ZERO; LEAF_VERTICES]);
        while let Some(node) = pop_within(&stack, &mut height, limit) {
            if node.level == 0 {
                if !view.fill(node, 0, &mut block, &mut vertices) {
                    continue;
                }
                let mut mask = frustum.candidates(&block, [0.0, limit]);
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize;
                    let corners = block.vertex.map(|corner| vertices[corner[lane] as usize]);
                    limit = visit(block.id[lane], corners);
                    mask &= mask - 1;
                }
                continue;
            }
            let [lower, upper] = view.boxes(node);
            let (met, depths) = frustum.boxes(&lower, &upper, limit);
            push_children(&mut stack, &mut height, (met, &depths), |lane| node.child(lane));
        }
    }

    /// Applies the exact test to a ray and all triangles; `visit` takes the number and the distance of those
    /// that it hits.
    pub(crate) fn test_all(&self, origin: DVec3, direction: DVec3, mut visit: impl FnMut(u32, f64)) {
        for i in 0..self.len() {
            if let Some(t) = self.triangle(i).and_then(|corners| triangle(origin, direction, corners)) {
                visit(self.first + i as u32, t);
            }
        }
    }
}
