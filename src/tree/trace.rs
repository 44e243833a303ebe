//! Single rays.

use super::beam::{Beam, LOOSE};
use super::block::{Block, LANES};
use super::build::{DEEPEST, DEEPEST_WIDE};
use super::index::Nodes;
use super::intersect::{cube, triangle};
use super::node::{KdNode, WideChild, WideNode};
use super::{Geometry, Hit, Hits, Tree};
use crate::geom::DVec3;

impl Tree {
    /// First hit of the ray `origin + t·direction` among the primitives whose number `accept` approves, t > 0 in units of
    /// `direction`. For all primitives [`Tree::nearest`] is faster.
    pub fn nearest_where(
        &self,
        geometry: &Geometry,
        origin: DVec3,
        direction: DVec3,
        accept: impl Fn(u32) -> bool,
    ) -> Option<Hit> {
        let ray_is_sound = origin.is_finite() && direction.is_finite();
        if !ray_is_sound {
            return None;
        }
        let mut best: Option<Hit> = None;
        let mut test = |id: u32| {
            if accept(id)
                && let Some(t) = verdict(geometry, origin, direction, id)
                && best.is_none_or(|b| t < b.t || (t == b.t && id < b.primitive))
            {
                best = Some(Hit { t, primitive: id });
            }
            best.map_or(f64::INFINITY, |b| b.t)
        };
        match Beam::of(&self.frame, origin, std::iter::once(direction)) {
            Some(beam) => {
                let steepness = direction[beam.axes[0]].abs() * self.frame.scale;
                self.walk(&beam, f32::INFINITY, |block, mut mask, limit| {
                    while mask != 0 {
                        let t = test(block.id[mask.trailing_zeros() as usize]);
                        *limit = depth_limit(t * steepness);
                        mask &= mask - 1;
                    }
                });
            }
            // Out of reach of single precision: ask for every verdict.
            None => self.blocks.iter().flat_map(|b| b.id).filter(|&id| id != Hits::MISS).for_each(|id| {
                test(id);
            }),
        }
        match &self.placed {
            Some(placed) => placed.nearest(origin, direction, best, &accept),
            None => best,
        }
    }

    /// Walks through the leaves that the beam meets, nearest first, up to the depth `limit` that `visit` may lower, and
    /// shows it the blocks with the lanes that rays of the beam might hit.
    #[inline(always)]
    pub(super) fn walk(&self, beam: &Beam, limit: f32, visit: impl FnMut(&Block, u32, &mut f32)) {
        match &self.nodes {
            Nodes::Kd(nodes) => self.walk_kd(nodes, beam, limit, visit),
            Nodes::Wide(nodes) => self.walk_wide(nodes, beam, limit, visit),
        }
    }

    #[inline(always)]
    fn walk_kd(
        &self,
        nodes: &[KdNode],
        beam: &Beam,
        mut limit: f32,
        mut visit: impl FnMut(&Block, u32, &mut f32),
    ) {
        let mut stack = [(0u32, [0.0f32; 2]); DEEPEST as usize + 1];
        stack[0] = (0, beam.within(&self.bounds[0], &self.bounds[1]));
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (mut number, mut range) = stack[height];
            while is_met(range, limit) {
                let node = nodes[number as usize];
                let Some(axis) = node.axis() else {
                    for block in &self.blocks[node.blocks()] {
                        let mask = candidates(beam, block, [range[0], range[1].min(limit)]);
                        if mask != 0 {
                            visit(block, mask, &mut limit);
                        }
                    }
                    break;
                };
                let [lower, upper] = beam.cut(axis, node.position(), range);
                let child = node.child() as u32;
                let (near, far) = if beam.ascends(axis) {
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
        beam: &Beam,
        mut limit: f32,
        mut visit: impl FnMut(&Block, u32, &mut f32),
    ) {
        let mut stack = [(WideChild::ROOT, 0.0f32); WIDE_STACK];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (child, enter) = stack[height];
            if enter > limit * LOOSE {
                continue;
            }
            match child.number() {
                Ok(number) => {
                    let node = &nodes[number];
                    let (mut met, depths) = beam.boxes(&node.lower, &node.upper, limit);
                    let floor = height;
                    while met != 0 {
                        let lane = met.trailing_zeros() as usize;
                        let mut at = height;
                        while at > floor && stack[at - 1].1 < depths[lane] {
                            stack[at] = stack[at - 1];
                            at -= 1;
                        }
                        stack[at] = (node.child[lane], depths[lane]);
                        height += 1;
                        met &= met - 1;
                    }
                }
                Err(number) => {
                    let block = &self.blocks[number];
                    let mask = candidates(beam, block, [0.0, limit]);
                    if mask != 0 {
                        visit(block, mask, &mut limit);
                    }
                }
            }
        }
    }
}

/// Visits that may wait at a time in the wide tree: every level leaves up to fifteen.
pub(super) const WIDE_STACK: usize = DEEPEST_WIDE as usize * (LANES - 1) + LANES;

/// Whether a beam can be anywhere within a range of depths up to the limit.
#[inline(always)]
fn is_met([lo, hi]: [f32; 2], limit: f32) -> bool {
    lo <= hi.min(limit) * LOOSE
}

#[inline(always)]
fn candidates(beam: &Beam, block: &Block, range: [f32; 2]) -> u32 {
    if block.holds_cubes() {
        beam.boxes(&block.corner[0], &block.corner[1], range[1]).0
    } else {
        beam.triangles(block, range)
    }
}

/// A depth beyond which nothing can be nearer than `depth`.
#[inline(always)]
pub(super) fn depth_limit(depth: f64) -> f32 {
    (depth * 1.000_000_2) as f32
}

/// The distance at which a ray hits a primitive.
pub(super) fn verdict(geometry: &Geometry, origin: DVec3, direction: DVec3, id: u32) -> Option<f64> {
    let (i, triangles) = (id as usize, geometry.triangles.len());
    if i < triangles {
        triangle(origin, direction, geometry.triangle(i))
    } else {
        cube(origin, direction, geometry.cubes[i - triangles])
    }
}
