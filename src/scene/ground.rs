//! `onGround` of parts (spec input-formats §3.4): a part is moved up or down onto the plane through the ground below it.

use super::assembly::{Assembly, Extent};
use super::plane;
use crate::diag::Place;
use crate::geom::{Aabb, DVec3};
use crate::tree::Geometry;
use rayon::prelude::*;

/// A part that is loaded and transformed.
pub(super) struct PlacedPart {
    /// Reported id.
    pub id: String,
    /// Its primitives.
    pub extent: Extent,
    /// Its `onGround` mode.
    pub on_ground: i64,
    /// Where it stands in the scene's file.
    pub place: Option<Place>,
}

/// Grounds all parts that ask for it, in their order.
pub(super) fn settle(scene: &mut Assembly, parts: &[PlacedPart]) {
    for part in parts.iter().filter(|p| p.on_ground != 0) {
        let corners = corners(&scene.geometry, &part.extent);
        let Some(lowest) = least(corners.iter().copied(), |p| p.z) else { continue };
        let Some(ground) =
            parts.iter().find(|g| is_ground(scene, &g.extent) && covers(scene, &g.extent, lowest))
        else {
            let message = format!("part \"{}\" stays where it is: no ground part lies below it", part.id);
            scene
                .diagnostics
                .warn(part.place.clone(), message)
                .help("a part is ground when its first material has helios_isGround true");
            continue;
        };
        let Some(plane) = plane::fit(&corners_of_ground(scene, &ground.extent)) else { continue };
        if plane.normal.z.abs() < 1e-9 {
            let message =
                format!("part \"{}\" stays where it is: ground part \"{}\" is vertical", part.id, ground.id);
            scene.diagnostics.warn(part.place.clone(), message);
            continue;
        }
        let (o, v) = (plane.centre, plane.normal);
        let height = |q: DVec3| q.z - (v.dot(o) - v.x * q.x - v.y * q.y) / v.z;
        let anchor = match part.on_ground {
            -1 => least(corners.iter().copied(), height),
            k if k > 1 => least(sampled(&corners, k).copied(), height),
            _ => Some(lowest),
        };
        if let Some(q) = anchor {
            raise(&mut scene.geometry, &part.extent, -height(q));
        }
    }
}

/// Among the first min(k, n) corners every ⌊n / min(k, n)⌋-th.
fn sampled(corners: &[DVec3], k: i64) -> impl Iterator<Item = &DVec3> {
    let first = usize::try_from(k).unwrap_or(usize::MAX).min(corners.len());
    corners[..first].iter().step_by(corners.len().checked_div(first).unwrap_or(1).max(1))
}

/// The first point with the smallest `value`.
fn least(points: impl Iterator<Item = DVec3>, value: impl Fn(DVec3) -> f64) -> Option<DVec3> {
    points.map(|p| (value(p), p)).reduce(|best, p| if p.0 < best.0 { p } else { best }).map(|(_, p)| p)
}

/// The corners of all triangles, one after the other, and the lower corner of each cube.
fn corners(geometry: &Geometry, extent: &Extent) -> Vec<DVec3> {
    let triangles = extent.triangles.clone().flat_map(|i| geometry.triangle(i));
    let cubes = geometry.cubes[extent.cubes.clone()].iter().map(|c| c.centre - DVec3::splat(c.half));
    triangles.chain(cubes).collect()
}

/// The points that the ground's plane is fitted to. The centre of a cube stands for it, lest its height tilt the plane.
fn corners_of_ground(scene: &Assembly, extent: &Extent) -> Vec<DVec3> {
    let triangles = extent.triangles.clone().flat_map(|i| scene.geometry.triangle(i));
    triangles.chain(scene.geometry.cubes[extent.cubes.clone()].iter().map(|c| c.centre)).collect()
}

fn is_ground(scene: &Assembly, extent: &Extent) -> bool {
    let first = match (extent.triangles.is_empty(), extent.cubes.is_empty()) {
        (false, _) => scene.triangle_surfaces[extent.triangles.start],
        (true, false) => scene.cube_surfaces[extent.cubes.start],
        (true, true) => return false,
    };
    scene.library.materials[scene.surfaces[first as usize].material as usize].is_ground
}

fn covers(scene: &Assembly, extent: &Extent, p: DVec3) -> bool {
    let b = bounds(&scene.geometry, extent);
    (b.min.x..=b.max.x).contains(&p.x) && (b.min.y..=b.max.y).contains(&p.y)
}

/// The box around the primitives of a part, all of whose vertices are used.
pub(super) fn bounds(geometry: &Geometry, extent: &Extent) -> Aabb {
    let vertices = geometry.vertices[extent.vertices.clone()]
        .par_iter()
        .fold(|| Aabb::EMPTY, |b, &v| b.with(v))
        .reduce(|| Aabb::EMPTY, Aabb::union);
    let cubes = geometry.cubes[extent.cubes.clone()]
        .par_iter()
        .map(|c| Aabb { min: c.centre - DVec3::splat(c.half), max: c.centre + DVec3::splat(c.half) })
        .reduce(|| Aabb::EMPTY, Aabb::union);
    vertices.union(cubes)
}

fn raise(geometry: &mut Geometry, extent: &Extent, by: f64) {
    geometry.vertices[extent.vertices.clone()].par_iter_mut().for_each(|v| v.z += by);
    geometry.cubes[extent.cubes.clone()].par_iter_mut().for_each(|c| c.centre.z += by);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_approximate_search_looks_at_few_corners() {
        let corners: Vec<DVec3> = (0..10).map(|i| DVec3::X * f64::from(i)).collect();
        let seen = |k| sampled(&corners, k).map(|p| p.x as i32).collect::<Vec<_>>();
        assert_eq!(seen(4), [0, 2]);
        assert_eq!(seen(7), [0, 1, 2, 3, 4, 5, 6]);
        assert_eq!(seen(1000), (0..10).collect::<Vec<_>>());
        assert_eq!(sampled(&[], 5).count(), 0);
    }
}
