//! Single rays.

use super::beam::{Beam, LOOSE};
use super::block::Block;
use super::build::DEEPEST;
use super::intersect::{cube, triangle};
use super::{Geometry, Hit, Hits, Tree};
use crate::geom::DVec3;

impl Tree {
    /// First hit of the ray `origin + t·direction`, t > 0 in units of `direction`.
    pub fn nearest(&self, geometry: &Geometry, origin: DVec3, direction: DVec3) -> Option<Hit> {
        self.nearest_where(geometry, origin, direction, |_| true)
    }

    /// First hit among the primitives whose number `accept` approves.
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
                self.walk(&beam, |block, mut mask, limit| {
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
        best
    }

    /// Walks front to back through the leaves that the beam meets, up to the depth `limit` that `visit` may lower, and
    /// shows it the blocks with the lanes that rays of the beam might hit.
    #[inline(always)]
    fn walk(&self, beam: &Beam, mut visit: impl FnMut(&Block, u32, &mut f32)) {
        let mut limit = f32::INFINITY;
        let mut stack = [(0u32, [0.0f32; 2]); DEEPEST as usize + 1];
        stack[0] = (0, beam.within(&self.bounds[0], &self.bounds[1]));
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (mut number, mut range) = stack[height];
            if !(range[0] <= range[1].min(limit) * LOOSE) {
                continue;
            }
            let mut node = self.nodes[number as usize];
            while let Some(axis) = node.axis() {
                let [lower, upper] = beam.cut(axis, node.position(), range);
                let child = node.child() as u32;
                let (near, far) = if beam.ascends(axis) {
                    ((child, lower), (child + 1, upper))
                } else {
                    ((child + 1, upper), (child, lower))
                };
                let takes = |r: [f32; 2]| r[0] <= r[1].min(limit) * LOOSE;
                match (takes(near.1), takes(far.1)) {
                    (true, true) => {
                        stack[height] = far;
                        height += 1;
                        (number, range) = near;
                    }
                    (true, false) => (number, range) = near,
                    (false, true) => (number, range) = far,
                    (false, false) => break,
                }
                node = self.nodes[number as usize];
            }
            if node.axis().is_none() {
                for block in &self.blocks[node.blocks()] {
                    let mask = self.candidates(beam, block, [range[0], range[1].min(limit)]);
                    if mask != 0 {
                        visit(block, mask, &mut limit);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn candidates(&self, beam: &Beam, block: &Block, range: [f32; 2]) -> u32 {
        if block.holds_cubes() {
            beam.boxes(&block.corner[0], &block.corner[1], range[1]).0
        } else {
            beam.triangles(block, range)
        }
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
