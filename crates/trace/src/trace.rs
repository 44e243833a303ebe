//! Tracing of single rays.

use super::block::{BLOCK_SIZE, Block};
use super::build::{MAX_DEPTH, MAX_WIDE_DEPTH};
use super::frustum::{DEPTH_MARGIN, Frustum};
use super::index::Nodes;
use super::intersect::{cube, triangle};
use super::node::{KdNode, WideChild, WideNode};
use super::stack::{pop_within, push_children};
use super::{Geometry, Hit, Hits, Tree};
use vlscan_geom::DVec3;

/// A choice among primitives by number. It is called through a pointer, so that each caller's choice does
/// not make a copy of the traversal.
pub(super) type Accept<'a> = &'a dyn Fn(u32) -> bool;

impl Tree {
    /// First hit of the ray `origin + t·direction` among the primitives whose number `accept` accepts, with
    /// t > 0 in units of `direction`. Directions should be of about unit length; one shorter than 1e-100 hits
    /// nothing. For many rays [`Tree::trace_rays`] and [`Tree::trace_group`] are several times faster.
    pub fn nearest_where(
        &self,
        geometry: &Geometry,
        origin: DVec3,
        direction: DVec3,
        accept: impl Fn(u32) -> bool,
    ) -> Option<Hit> {
        let best = self.nearest_primitive(geometry, origin, direction, &accept);
        match &self.instances {
            Some(instances) if origin.is_finite() && direction.is_finite() => {
                instances.nearest(origin, direction, best, &accept)
            }
            _ => best,
        }
    }

    /// [`Tree::nearest_where`] without instances.
    pub(super) fn nearest_primitive(
        &self,
        geometry: &Geometry,
        origin: DVec3,
        direction: DVec3,
        accept: Accept,
    ) -> Option<Hit> {
        if !(origin.is_finite() && direction.is_finite()) {
            return None;
        }
        let mut best: Option<Hit> = None;
        let mut keep_nearest = |id: u32, found: Option<f64>| {
            if let Some(t) = found
                && best.is_none_or(|b| t < b.t || (t == b.t && id < b.primitive))
            {
                best = Some(Hit { t, primitive: id });
            }
            best.map_or(f64::INFINITY, |b| b.t)
        };
        let first_cube = geometry.triangle_count();
        let mut grids: Vec<usize> = Vec::new();
        let mut test = |id: u32| {
            if !geometry.grids.is_empty()
                && let Some(index) = (id as usize).checked_sub(first_cube)
                && let (Some(grid), _) = geometry.locate_cube(index)
            {
                if !grids.contains(&grid) {
                    grids.push(grid);
                }
                return keep_nearest(Hits::MISS, None);
            }
            let found = if accept(id) { intersect_exact(geometry, origin, direction, id) } else { None };
            keep_nearest(id, found)
        };
        let frustum = Frustum::around(&self.frame, origin, std::iter::once(direction));
        match &frustum {
            Some(frustum) => self.walk(frustum, f32::INFINITY, |block, mut mask, limit| {
                while mask != 0 {
                    let t = test(block.id[mask.trailing_zeros() as usize]);
                    *limit = frustum.limit(t);
                    mask &= mask - 1;
                }
            }),
            // Out of range of single precision: test all primitives.
            None => self.blocks.iter().flat_map(|b| b.id).filter(|&id| id != Hits::MISS).for_each(|id| {
                test(id);
            }),
        }
        match &frustum {
            Some(frustum) => {
                let limit = frustum.limit(keep_nearest(Hits::MISS, None));
                self.fields.walk(frustum, limit, |field, mut limit| {
                    let Some(field) = geometry.fields.get(field) else { return limit };
                    field.walk(&self.frame, frustum, limit, |id, corners| {
                        let found = if accept(id) { triangle(origin, direction, corners) } else { None };
                        limit = frustum.limit(keep_nearest(id, found));
                        limit
                    });
                    limit
                });
            }
            None => geometry.fields.iter().for_each(|field| {
                field.test_all(origin, direction, |id, t| {
                    keep_nearest(id, accept(id).then_some(t));
                });
            }),
        }
        let first_cube = first_cube as u32;
        for grid in grids.into_iter().map(|grid| &geometry.grids[grid]) {
            match &frustum {
                Some(frustum) => {
                    let limit = frustum.limit(keep_nearest(Hits::MISS, None));
                    grid.walk(&self.frame, frustum, limit, |index, own| {
                        let id = first_cube + index;
                        let found = if accept(id) { cube(origin, direction, own) } else { None };
                        frustum.limit(keep_nearest(id, found))
                    });
                }
                None => grid.test_all(origin, direction, |index, t| {
                    keep_nearest(first_cube + index, accept(first_cube + index).then_some(t));
                }),
            }
        }
        best
    }

    /// Visits the leaves that the frustum hits, nearest first, up to the depth `limit`, which `visit` may
    /// lower. `visit` takes a block with a mask of the lanes that rays of the frustum might hit.
    #[inline(always)]
    pub(super) fn walk(&self, frustum: &Frustum, limit: f32, visit: impl FnMut(&Block, u32, &mut f32)) {
        match &self.nodes {
            Nodes::Kd(nodes) => self.walk_kd(nodes, frustum, limit, visit),
            Nodes::Wide(nodes) => self.walk_wide(nodes, frustum, limit, visit),
        }
    }

    #[inline(always)]
    fn walk_kd(
        &self,
        nodes: &[KdNode],
        frustum: &Frustum,
        mut limit: f32,
        mut visit: impl FnMut(&Block, u32, &mut f32),
    ) {
        let mut stack = [(0u32, [0.0f32; 2]); MAX_DEPTH as usize + 1];
        stack[0] = (0, frustum.depths_within(&self.bounds[0], &self.bounds[1]));
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (mut number, mut range) = stack[height];
            while is_met(range, limit) {
                let node = nodes[number as usize];
                let Some(axis) = node.axis() else {
                    for block in &self.blocks[node.blocks()] {
                        let mask = frustum.candidates(block, [range[0], range[1].min(limit)]);
                        if mask != 0 {
                            visit(block, mask, &mut limit);
                        }
                    }
                    break;
                };
                let [lower, upper] = frustum.cut(axis, node.position(), range);
                let child = node.child() as u32;
                let (near, far) = if frustum.is_ascending(axis) {
                    ((child, lower), (child + 1, upper))
                } else {
                    ((child + 1, upper), (child, lower))
                };
                if is_met(near.1, limit) {
                    if is_met(far.1, limit) {
                        stack[height] = far;
                        height += 1;
                    }
                    (number, range) = near;
                } else {
                    (number, range) = far;
                }
            }
        }
    }

    #[inline(always)]
    fn walk_wide(
        &self,
        nodes: &[WideNode],
        frustum: &Frustum,
        mut limit: f32,
        mut visit: impl FnMut(&Block, u32, &mut f32),
    ) {
        let mut stack = [(WideChild::ROOT, 0.0f32); MAX_WIDE_STACK];
        let mut height = 1;
        while let Some(child) = pop_within(&stack, &mut height, limit) {
            match child.number() {
                Ok(number) => {
                    let node = &nodes[number];
                    let (met, depths) = frustum.boxes(&node.lower, &node.upper, limit);
                    push_children(&mut stack, &mut height, (met, &depths), |lane| node.child[lane]);
                }
                Err(number) => {
                    let block = &self.blocks[number];
                    let mask = frustum.candidates(block, [0.0, limit]);
                    if mask != 0 {
                        visit(block, mask, &mut limit);
                    }
                }
            }
        }
    }
}

/// Maximum number of pending visits in the wide tree: every level leaves up to fifteen.
pub(super) const MAX_WIDE_STACK: usize = MAX_WIDE_DEPTH as usize * (BLOCK_SIZE - 1) + BLOCK_SIZE;

/// True if a range of depths is not empty and begins before the limit.
#[inline(always)]
fn is_met([lo, hi]: [f32; 2], limit: f32) -> bool {
    lo <= hi.min(limit) * DEPTH_MARGIN
}

/// Distance at which a ray hits a stored primitive, by the exact test.
fn intersect_exact(geometry: &Geometry, origin: DVec3, direction: DVec3, id: u32) -> Option<f64> {
    let (i, triangles) = (id as usize, geometry.triangle_count());
    if i < triangles {
        triangle(origin, direction, geometry.triangle(i))
    } else {
        cube(origin, direction, geometry.cube(i - triangles)?)
    }
}
