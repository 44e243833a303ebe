//! The hierarchy over the boxes of height fields, by which rays find the fields that they may hit: nodes with
//! sixteen children, as in the tree over stored primitives.

use super::HeightField;
use crate::block::BLOCK_SIZE;
use crate::frame::Frame;
use crate::frustum::Frustum;
use crate::memory::vec_bytes;
use crate::stack::{pop_within, push_children};

/// Maximum number of levels: fields have different numbers of 32 bits.
const MAX_LEVELS: usize = (u32::BITS / BLOCK_SIZE.ilog2()) as usize;

/// Maximum number of pending visits: every level leaves up to fifteen.
pub(crate) const MAX_BOX_STACK: usize = MAX_LEVELS * (BLOCK_SIZE - 1) + BLOCK_SIZE;

/// Lower and upper corner of a box in the tree's frame.
type Corners = ([f32; 3], [f32; 3]);

/// Boxes around the height fields of a geometry, around each sixteen of these boxes, and so on.
#[derive(Clone, Debug, Default)]
pub(crate) struct FieldBoxes {
    /// Number of fields.
    count: usize,
    /// The boxes of fields, then those around the children of a node; empty for a single field, which rays
    /// test at once.
    levels: Vec<Vec<ChildBoxes>>,
}

/// The boxes of the children of a node, by axis and lane; inside out where there is no child.
#[derive(Clone, Debug)]
pub(crate) struct ChildBoxes {
    pub lower: [[f32; BLOCK_SIZE]; 3],
    pub upper: [[f32; BLOCK_SIZE]; 3],
}

/// A node of the hierarchy: its level and its index there; at level 0 the index of a field.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BoxNode {
    level: u32,
    index: u32,
}

impl BoxNode {
    pub const NONE: BoxNode = BoxNode { level: 0, index: 0 };

    /// Index of the field if the node is one.
    #[inline(always)]
    pub fn field(self) -> Option<usize> {
        (self.level == 0).then_some(self.index as usize)
    }

    /// The child in a lane of the node's boxes.
    #[inline(always)]
    pub fn child(self, lane: usize) -> BoxNode {
        BoxNode { level: self.level - 1, index: self.index * BLOCK_SIZE as u32 + lane as u32 }
    }
}

impl ChildBoxes {
    fn of(boxes: &[Corners]) -> ChildBoxes {
        let mut of = ChildBoxes {
            lower: [[f32::INFINITY; BLOCK_SIZE]; 3],
            upper: [[f32::NEG_INFINITY; BLOCK_SIZE]; 3],
        };
        for (lane, (lower, upper)) in boxes.iter().enumerate() {
            of.lower.iter_mut().zip(lower).for_each(|(lanes, x)| lanes[lane] = *x);
            of.upper.iter_mut().zip(upper).for_each(|(lanes, x)| lanes[lane] = *x);
        }
        of
    }

    /// The box around all children.
    fn around(&self) -> Corners {
        let lower = self.lower.map(|lanes| lanes.into_iter().fold(f32::INFINITY, f32::min));
        let upper = self.upper.map(|lanes| lanes.into_iter().fold(f32::NEG_INFINITY, f32::max));
        (lower, upper)
    }
}

impl FieldBoxes {
    /// The hierarchy over the boxes of `fields` in a tree's frame, rounded outward.
    pub fn over(fields: &[HeightField], frame: &Frame) -> FieldBoxes {
        let mut boxes: Vec<Corners> = fields.iter().map(|field| box_of(field, frame)).collect();
        let mut levels = Vec::new();
        while boxes.len() > 1 {
            let nodes: Vec<ChildBoxes> = boxes.chunks(BLOCK_SIZE).map(ChildBoxes::of).collect();
            boxes = nodes.iter().map(ChildBoxes::around).collect();
            levels.push(nodes);
        }
        FieldBoxes { count: fields.len(), levels }
    }

    /// The root; `None` without fields.
    #[inline(always)]
    pub fn root(&self) -> Option<BoxNode> {
        (self.count > 0).then_some(BoxNode { level: self.levels.len() as u32, index: 0 })
    }

    /// The boxes of the children of a node above level 0.
    #[inline(always)]
    pub fn children(&self, node: BoxNode) -> &ChildBoxes {
        &self.levels[node.level as usize - 1][node.index as usize]
    }

    /// Visits the fields whose boxes a ray of the frustum might hit, the nearest first, up to the depth
    /// `limit`. `visit` takes the index of a field and the limit, and returns the new limit.
    pub fn walk(&self, frustum: &Frustum, mut limit: f32, mut visit: impl FnMut(usize, f32) -> f32) {
        let Some(root) = self.root() else { return };
        if let Some(field) = root.field() {
            visit(field, limit);
            return;
        }
        let mut stack = [(BoxNode::NONE, 0.0f32); MAX_BOX_STACK];
        stack[0].0 = root;
        let mut height = 1;
        while let Some(node) = pop_within(&stack, &mut height, limit) {
            if let Some(field) = node.field() {
                limit = visit(field, limit);
                continue;
            }
            let children = self.children(node);
            let (met, depths) = frustum.boxes(&children.lower, &children.upper, limit);
            push_children(&mut stack, &mut height, (met, &depths), |lane| node.child(lane));
        }
    }

    /// Memory, bytes.
    pub fn memory(&self) -> usize {
        self.levels.iter().map(vec_bytes).sum()
    }
}

/// The box of a field in a tree's frame. Boxes with coordinates that are not finite become unbounded, so that
/// rays test the field.
fn box_of(field: &HeightField, frame: &Frame) -> Corners {
    let bounds = field.bounds();
    match bounds.is_empty() || (bounds.min.is_finite() && bounds.max.is_finite()) {
        true => frame.local_box(&bounds),
        false => ([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Geometry, HeightGrid, Heights};
    use vlscan_geom::DVec3;

    /// Flat fields of 10 m by 10 m side by side, `side` along either axis.
    fn mosaic(side: usize) -> Vec<HeightField> {
        let field = |i: usize| {
            let mut heights = Heights::single(11 * 11).unwrap();
            heights.set(0, &[0.0; 11 * 11]).unwrap();
            let grid = HeightGrid { first: [i % side * 10, i / side * 10], ..HeightGrid::new(11, 11) };
            HeightField::new(grid, heights, i * 200).unwrap()
        };
        (0..side * side).map(field).collect()
    }

    /// The fields that a ray visits without a limit.
    fn visited(boxes: &FieldBoxes, frame: &Frame, origin: DVec3, direction: DVec3) -> Vec<usize> {
        let frustum = Frustum::around(frame, origin, std::iter::once(direction)).unwrap();
        let mut all = Vec::new();
        boxes.walk(&frustum, f32::INFINITY, |field, limit| {
            all.push(field);
            limit
        });
        all
    }

    fn frame_of(fields: &[HeightField]) -> Frame {
        Frame::around(&Geometry { fields: fields.to_vec(), ..Geometry::default() }.bounds())
    }

    #[test]
    fn a_ray_visits_the_fields_on_its_way_and_no_others() {
        let side = 20;
        let fields = mosaic(side);
        let frame = frame_of(&fields);
        let boxes = FieldBoxes::over(&fields, &frame);
        for i in 0..side * side {
            let middle = DVec3::new((i % side) as f64 * 10.0 + 5.0, (i / side) as f64 * 10.0 + 5.0, 7.0);
            assert_eq!(visited(&boxes, &frame, middle, -DVec3::Z), [i]);
            assert!(visited(&boxes, &frame, middle, DVec3::Z).is_empty(), "{i} is below");
        }
        let mut along = visited(&boxes, &frame, DVec3::new(-5.0, 15.0, 0.0), DVec3::X);
        along.sort_unstable();
        assert_eq!(along, (side..2 * side).collect::<Vec<_>>());
        assert!(FieldBoxes::over(&[], &frame).root().is_none());
    }

    #[test]
    fn the_nearest_field_is_first_and_the_limit_ends_the_visit() {
        let fields = mosaic(4);
        let frame = frame_of(&fields);
        let boxes = FieldBoxes::over(&fields, &frame);
        let (from, to) = (DVec3::new(45.0, 15.0, 0.0), -DVec3::X);
        assert_eq!(visited(&boxes, &frame, from, to), [7, 6, 5, 4]);
        let frustum = Frustum::around(&frame, from, std::iter::once(to)).unwrap();
        let mut all = Vec::new();
        boxes.walk(&frustum, f32::INFINITY, |field, _| {
            all.push(field);
            // A hit 8 m from the origin, in the first field.
            frustum.limit(8.0)
        });
        assert_eq!(all, [7]);
    }

    #[test]
    fn fields_with_infinite_heights_are_visited_and_empty_ones_are_not() {
        let mut fields = mosaic(5);
        let infinite = HeightGrid { scale: 1e300, ..HeightGrid::new(2, 2) };
        fields.push(HeightField::new(infinite, Heights::Double(vec![1e300; 4]), 5000).unwrap());
        fields.push(HeightField::new(HeightGrid::new(2, 2), Heights::single(4).unwrap(), 5002).unwrap());
        let frame = Frame { origin: DVec3::ZERO, scale: 1.0 / 64.0 };
        let boxes = FieldBoxes::over(&fields, &frame);
        let mut found = visited(&boxes, &frame, DVec3::new(15.0, 5.0, 7.0), -DVec3::Z);
        found.sort_unstable();
        assert_eq!(found, [1, 25]);
    }
}
