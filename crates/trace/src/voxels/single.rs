//! Tracing of single rays among the voxels of a grid.

use super::hierarchy::{COMMON_LEVELS, COMMON_STACK, MAX_GRID_STACK};
use super::{GridNode, GridView, VoxelGrid};
use crate::Cube;
use crate::frame::Frame;
use crate::frustum::{DEPTH_MARGIN, Frustum};
use crate::intersect::cube;
use crate::simd::{Level, Simd, dispatch};
use crate::stack::{pop_within, push_children};
use vlscan_geom::DVec3;

impl VoxelGrid {
    /// Visits the cubes that a ray of the frustum might hit, nearest rows first, up to the depth `limit`.
    /// `visit` takes the index among the cubes of the geometry and the cube, and returns the new limit.
    pub(crate) fn walk(
        &self,
        frame: &Frame,
        frustum: &Frustum,
        limit: f32,
        visit: impl FnMut(u32, Cube) -> f32,
    ) {
        let best = Level::best();
        // A shorter stack is made faster.
        match self.hierarchy.root().level as usize <= COMMON_LEVELS {
            true => {
                dispatch!(best, simd => self.walk_on::<_, COMMON_STACK>(simd, frame, frustum, limit, visit))
            }
            false => {
                dispatch!(best, simd => self.walk_on::<_, MAX_GRID_STACK>(simd, frame, frustum, limit, visit))
            }
        }
    }

    #[inline(always)]
    fn walk_on<S: Simd, const STACK: usize>(
        &self,
        simd: S,
        frame: &Frame,
        frustum: &Frustum,
        mut limit: f32,
        mut visit: impl FnMut(u32, Cube) -> f32,
    ) {
        let view = GridView::new(self, frame);
        let mut stack = [(GridNode::NONE, 0.0f32); STACK];
        stack[0].0 = view.root();
        let mut height = 1;
        while let Some(node) = pop_within(&stack, &mut height, limit) {
            if node.level == 0 {
                let row = view.row(node);
                let (met, depths) = frustum.boxes_on(simd, &row.lower, &row.upper, limit);
                let mut met = met & row.mask();
                while met != 0 {
                    let lane = match frustum.is_ascending(row.axis()) {
                        true => met.trailing_zeros() as usize,
                        false => met.ilog2() as usize,
                    };
                    met &= !(1 << lane);
                    if depths[lane] > limit * DEPTH_MARGIN {
                        continue;
                    }
                    limit = visit(self.first + (row.first + lane) as u32, row.cube(self, lane));
                }
                continue;
            }
            let children = view.children(node);
            let (met, depths) = frustum.boxes_on(simd, &children.lower, &children.upper, limit);
            let met = met & children.mask();
            push_children(&mut stack, &mut height, (met, &depths), |lane| children.child(lane));
        }
    }

    /// Applies the exact test to a ray and all cubes; `visit` takes the index among the cubes of the geometry
    /// and the distance of those that it hits.
    pub(crate) fn test_all(&self, origin: DVec3, direction: DVec3, mut visit: impl FnMut(u32, f64)) {
        for (i, own) in (self.first..).zip(self.cubes()) {
            if let Some(t) = cube(origin, direction, own) {
                visit(i, t);
            }
        }
    }
}
