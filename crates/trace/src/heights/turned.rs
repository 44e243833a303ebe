//! Height fields that are rotated or scaled: the box around their triangles, and the triangles at a place.

use super::pyramid::CHILDREN;
use super::{FieldNode, FieldView, HeightField, HeightGrid, LEAF_VERTICES};
use crate::Hits;
use crate::block::Block;
use crate::frame::{Frame, above, below};
use vlscan_geom::{Aabb, DVec3, Rotation};

impl HeightField {
    /// The box around all triangles after the transform, neither raised nor shifted: exactly that of their
    /// corners.
    pub(super) fn find_transformed_bounds(&mut self) -> Aabb {
        let Some(by) = self.grid.transform.filter(|_| !self.bounds.is_empty()) else { return self.bounds };
        if by.rotation == Rotation::IDENTITY && by.scale > 0.0 {
            // Keeps the order of vertices along every axis.
            return Aabb { min: by.apply(self.bounds.min), max: by.apply(self.bounds.max) };
        }
        let [min, max] = [self.bounds.min, self.bounds.max];
        let corners = (0..8).map(|i| {
            let of = |axis: usize| if i >> axis & 1 == 0 { min[axis] } else { max[axis] };
            by.apply(DVec3::new(of(0), of(1), of(2)))
        });
        // Around all that the pyramid has, until the box is known.
        let around = Aabb::around(corners);
        let slack = 1e-9 * (around.min.abs().max(around.max.abs()).max_element() + f64::MIN_POSITIVE);
        self.transformed = Aabb { min: around.min - slack, max: around.max + slack };
        let grid = self.grid;
        self.grid = HeightGrid { raise: -0.0, shift: DVec3::ZERO, ..grid };
        let found = self.box_of_corners();
        self.grid = grid;
        found
    }

    /// The box around the corners of all triangles. Leaves whose boxes cannot extend it are skipped.
    fn box_of_corners(&self) -> Aabb {
        let frame = Frame::around(&self.transformed);
        let mut found = Aabb::EMPTY;
        self.visit_leaves(
            &frame,
            |found, [low, high]| {
                let is_inside = |axis: usize| low[axis] >= found[0][axis] && high[axis] <= found[1][axis];
                !(0..3).all(is_inside)
            },
            |view, leaf| {
                let (mut block, mut vertices) = (Block::EMPTY, [DVec3::ZERO; LEAF_VERTICES]);
                if view.fill(leaf, 0, &mut block, &mut vertices) {
                    let lanes = (0..block.id.len()).filter(|lane| block.id[*lane] != Hits::MISS);
                    let corners = lanes.flat_map(|lane| block.vertex.map(|corner| corner[lane] as usize));
                    found = corners.fold(found, |all, corner| all.with(vertices[corner]));
                }
                // Rounded inward, as boxes are wider than their triangles by more than that.
                let (min, max) = (frame.local(found.min), frame.local(found.max));
                [min.to_array().map(above), max.to_array().map(below)]
            },
        );
        found
    }

    /// The numbers of triangles above and below a place, and of some next to it.
    pub(super) fn turned_triangles_near(&self, x: f64, y: f64) -> Vec<usize> {
        let frame = Frame::around(&self.bounds());
        let place = frame.local(DVec3::new(x, y, 0.0));
        let mut near = Vec::new();
        self.visit_leaves(
            &frame,
            |_: &[[f32; 3]; 2], [low, high]| {
                // Where a place of double precision is rounded to does not matter: boxes are wider.
                (0..2).all(|axis| low[axis] <= place[axis] as f32 && place[axis] as f32 <= high[axis])
            },
            |view, leaf| {
                let (mut block, mut vertices) = (Block::EMPTY, [DVec3::ZERO; LEAF_VERTICES]);
                if view.fill(leaf, 0, &mut block, &mut vertices) {
                    let there = block.id.iter().filter(|id| **id != Hits::MISS);
                    near.extend(there.map(|id| (id - self.first) as usize));
                }
                [[0.0; 3]; 2]
            },
        );
        near
    }

    /// Visits the leaves whose boxes, and the boxes of the nodes above them, pass `overlaps`. Its arguments
    /// are the result of the last visit and the lower and upper corner of the box, in the frame.
    fn visit_leaves(
        &self,
        frame: &Frame,
        overlaps: impl Fn(&[[f32; 3]; 2], [[f32; 3]; 2]) -> bool,
        mut visit: impl FnMut(&FieldView, FieldNode) -> [[f32; 3]; 2],
    ) {
        let view = FieldView::new(self, frame);
        let mut last = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        let mut pending: Vec<(FieldNode, [[f32; 3]; 2])> = view
            .root()
            .map(|root| (root, [[f32::NEG_INFINITY; 3], [f32::INFINITY; 3]]))
            .into_iter()
            .collect();
        while let Some((node, around)) = pending.pop() {
            if !overlaps(&last, around) {
                continue;
            }
            if node.level == 0 {
                last = visit(&view, node);
                continue;
            }
            let boxes = view.boxes(node);
            for lane in (0..CHILDREN).filter(|lane| boxes[0][2][*lane] <= boxes[1][2][*lane]) {
                let corner = |side: usize| [0, 1, 2].map(|axis| boxes[side][axis][lane]);
                pending.push((node.child(lane), [corner(0), corner(1)]));
            }
        }
    }
}
