//! `onGround` of parts (spec input-formats §3.4): moves a part up or down onto a plane fitted to the ground
//! below it.

use super::builder::{Extent, SceneBuilder, bounds_of_points};
use super::{instances, plane};
use rayon::prelude::*;
use vlscan_base::diag::Place;
use vlscan_geom::{Aabb, DVec3};
use vlscan_trace::{Cube, Geometry, HeightField, VoxelGrid};

/// A loaded and transformed part.
pub(super) struct LoadedPart {
    pub id: String,
    pub body: Body,
    pub on_ground: i64,
    /// Position in the scene's file.
    pub place: Option<Place>,
}

/// The geometry of a part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Body {
    /// Its primitives are stored in the scene.
    Stored(Extent),
    /// Index of an instance of a shared mesh.
    Instance(usize),
}

/// Drops all parts with `onGround` to the ground, in their order.
pub(super) fn drop_to_ground(scene: &mut SceneBuilder, parts: &[LoadedPart]) {
    let mut gaps = Gaps::default();
    for part in parts.iter().filter(|p| p.on_ground != 0) {
        let corners = || corners(scene, &part.body);
        let Some(lowest) = min_by_value(corners(), |p| p.z) else { continue };
        let Some(ground) = parts.iter().find(|g| is_ground(scene, &g.body) && covers(scene, &g.body, lowest))
        else {
            let message = format!("part \"{}\" is not moved: no ground part lies below it", part.id);
            scene
                .diagnostics
                .warn(part.place.clone(), message)
                .help("a part is ground when its first material has helios_isGround true");
            continue;
        };
        let Some(plane) = plane::fit(|| corners_of_ground(scene, &ground.body)) else { continue };
        if plane.normal.z.abs() < 1e-9 {
            let message =
                format!("part \"{}\" is not moved: ground part \"{}\" is vertical", part.id, ground.id);
            scene.diagnostics.warn(part.place.clone(), message);
            continue;
        }
        let (o, v) = (plane.centre, plane.normal);
        let height = |q: DVec3| q.z - (v.dot(o) - v.x * q.x - v.y * q.y) / v.z;
        let anchor = match part.on_ground {
            -1 => min_by_value(corners(), height),
            k if k > 1 => min_by_value(sampled(corners, k), height),
            _ => Some(lowest),
        };
        if let Some(q) = anchor {
            raise(scene, &part.body, -height(q));
            let foot = DVec3::new(q.x, q.y, q.z - height(q));
            if let Some(below) = ground_below(scene, &ground.body, foot) {
                gaps.add(part, &ground.id, foot.z - below);
            }
        }
    }
    gaps.report(scene);
}

/// Distance between a part and the ground under it from which it is reported, m.
const MIN_REPORTED_GAP: f64 = 0.5;

/// Parts that a plane through the whole of the ground has left above or below the ground under them.
#[derive(Default)]
struct Gaps {
    count: usize,
    /// Position, id, ground and gap of the part with the largest gap.
    largest: Option<(Option<Place>, String, String, f64)>,
}

impl Gaps {
    fn add(&mut self, part: &LoadedPart, ground: &str, gap: f64) {
        if gap.abs() < MIN_REPORTED_GAP {
            return;
        }
        self.count += 1;
        if self.largest.as_ref().is_none_or(|(.., largest)| gap.abs() > largest.abs()) {
            self.largest = Some((part.place.clone(), part.id.clone(), ground.to_owned(), gap));
        }
    }

    fn report(self, scene: &mut SceneBuilder) {
        let Some((place, id, ground, gap)) = self.largest else { return };
        let side = if gap > 0.0 { "above" } else { "below" };
        let others = match self.count - 1 {
            0 => String::new(),
            n => format!(", and {n} others at smaller distances"),
        };
        let message = format!(
            "part \"{id}\" stands {:.1} m {side} the ground under it{others}: onGround puts parts on a plane \
             through the whole of part \"{ground}\", as HELIOS++ does",
            gap.abs()
        );
        scene.diagnostics.warn(place, message).help(
            "leave out onGround and give the height in the offset, or divide the ground into smaller parts",
        );
    }
}

/// Height of the highest triangle of the ground above or below a point; `None` where there is none.
fn ground_below(scene: &SceneBuilder, ground: &Body, p: DVec3) -> Option<f64> {
    let Body::Stored(extent) = ground else { return None };
    let height = |[a, b, c]: [DVec3; 3]| {
        let across = |a: DVec3, b: DVec3| (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
        let weights = [across(b, c), across(c, a), across(a, b)];
        let area: f64 = weights.iter().sum();
        let is_inside = weights.iter().all(|w| *w >= 0.0) || weights.iter().all(|w| *w <= 0.0);
        (is_inside && area != 0.0).then(|| (weights[0] * a.z + weights[1] * b.z + weights[2] * c.z) / area)
    };
    let geometry = &scene.geometry;
    let stored = extent.triangles.clone().into_par_iter().map(|i| geometry.stored_triangle(i));
    let in_field = |field: &HeightField| {
        let near = field.triangles_near(p.x, p.y).filter_map(|i| field.triangle(i));
        near.filter_map(height).reduce(f64::max)
    };
    let in_fields = geometry.fields[extent.fields.clone()].iter().filter_map(in_field).reduce(f64::max);
    stored.filter_map(height).reduce_with(f64::max).into_iter().chain(in_fields).reduce(f64::max)
}

/// Every ⌊n / min(k, n)⌋-th of the first min(k, n) of n corners, the sample of the reference's approximate
/// search.
fn sampled<I: Iterator<Item = DVec3>>(corners: impl Fn() -> I, k: i64) -> impl Iterator<Item = DVec3> {
    let count = corners().count();
    let first = usize::try_from(k).unwrap_or(usize::MAX).min(count);
    corners().take(first).step_by(count.checked_div(first).unwrap_or(1).max(1))
}

/// The first point with the smallest `value`.
fn min_by_value(points: impl Iterator<Item = DVec3>, value: impl Fn(DVec3) -> f64) -> Option<DVec3> {
    points.map(|p| (value(p), p)).reduce(|best, p| if p.0 < best.0 { p } else { best }).map(|(_, p)| p)
}

/// The corners of all triangles, in order, and the lower corner of each cube.
fn corners<'a>(scene: &'a SceneBuilder, body: &Body) -> impl Iterator<Item = DVec3> + use<'a> {
    points(scene, body, |c| c.bounds().min)
}

/// The points to which the ground plane is fitted. Cubes contribute their centres, so that the heights of
/// their corners do not tilt the plane.
fn corners_of_ground<'a>(scene: &'a SceneBuilder, body: &Body) -> impl Iterator<Item = DVec3> + use<'a> {
    points(scene, body, |c| c.centre)
}

fn points<'a>(
    scene: &'a SceneBuilder,
    body: &Body,
    of_cube: fn(&Cube) -> DVec3,
) -> impl Iterator<Item = DVec3> + use<'a> {
    let geometry = &scene.geometry;
    let (instance, extent) = match body {
        Body::Instance(i) => (Some(*i), scene.end()),
        Body::Stored(extent) => (None, extent.clone()),
    };
    let triangles = extent.triangles.flat_map(|i| geometry.stored_triangle(i));
    let of_field = |field: &'a HeightField| (0..field.len()).filter_map(|i| field.triangle(i)).flatten();
    let of_instance = instance.into_iter().flat_map(|i| scene.meshes.corners(i));
    of_instance
        .chain(triangles)
        .chain(geometry.fields[extent.fields].iter().flat_map(of_field))
        .chain(geometry.cubes_in(extent.cubes, extent.grids).map(move |cube| of_cube(&cube)))
}

fn is_ground(scene: &SceneBuilder, body: &Body) -> bool {
    let material = match body {
        Body::Instance(i) => scene.meshes.materials[scene.meshes.placements[*i].0 as usize].first().copied(),
        Body::Stored(extent) => {
            let first = match (extent.triangles.is_empty(), extent.fields.is_empty()) {
                (false, _) => scene.triangle_surfaces.get(extent.triangles.start),
                (true, false) => scene.field_surfaces.get(extent.fields.start),
                (true, true) => None,
            };
            let first = first.copied().or_else(|| first_surface_of_cubes(scene, extent));
            first.map(|s| scene.surfaces[s as usize].material)
        }
    };
    material.is_some_and(|m| scene.library.materials[m as usize].is_ground)
}

/// The surface of the first cube of a part.
fn first_surface_of_cubes(scene: &SceneBuilder, extent: &Extent) -> Option<u32> {
    let geometry = &scene.geometry;
    let stored = (!extent.cubes.is_empty()).then(|| geometry.index_of_stored_cube(extent.cubes.start));
    let in_grid = (!extent.grids.is_empty()).then(|| geometry.grids[extent.grids.start].first() as usize);
    match [stored, in_grid].into_iter().flatten().min() {
        first if first == in_grid => scene.grid_voxels.get(extent.grids.start)?.surfaces.get(0),
        _ => scene.cube_surfaces.get(extent.cubes.start).copied(),
    }
}

fn covers(scene: &SceneBuilder, body: &Body, p: DVec3) -> bool {
    let b = bounds_of(scene, body);
    (b.min.x..=b.max.x).contains(&p.x) && (b.min.y..=b.max.y).contains(&p.y)
}

pub(super) fn bounds_of(scene: &SceneBuilder, body: &Body) -> Aabb {
    match body {
        Body::Stored(extent) => bounds(&scene.geometry, extent),
        Body::Instance(i) => instances::bounds(&scene.meshes, *i),
    }
}

/// The bounding box of an extent whose vertices are all in use.
pub(super) fn bounds(geometry: &Geometry, extent: &Extent) -> Aabb {
    let vertices = bounds_of_points(&geometry.vertices[extent.vertices.clone()], |v| v);
    let cubes =
        geometry.cubes[extent.cubes.clone()].par_iter().map(Cube::bounds).reduce(|| Aabb::EMPTY, Aabb::union);
    let fields = geometry.fields[extent.fields.clone()].iter().map(HeightField::bounds);
    let grids = geometry.grids[extent.grids.clone()].iter().map(VoxelGrid::bounds);
    fields.chain(grids).fold(vertices.union(cubes), Aabb::union)
}

/// Moves a part vertically, m.
fn raise(scene: &mut SceneBuilder, body: &Body, by: f64) {
    match body {
        Body::Instance(i) => scene.meshes.placements[*i].2.raise = by,
        Body::Stored(extent) => {
            let geometry = &mut scene.geometry;
            geometry.vertices[extent.vertices.clone()].par_iter_mut().for_each(|v| v.z += by);
            geometry.cubes[extent.cubes.clone()].par_iter_mut().for_each(|c| c.centre.z += by);
            geometry.fields[extent.fields.clone()].iter_mut().for_each(|field| field.raise(by));
            geometry.grids[extent.grids.clone()].iter_mut().for_each(|grid| grid.place_mut().raise = by);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_approximate_search_looks_at_few_corners() {
        let corners: Vec<DVec3> = (0..10).map(|i| DVec3::X * f64::from(i)).collect();
        let seen = |k| sampled(|| corners.iter().copied(), k).map(|p| p.x as i32).collect::<Vec<_>>();
        assert_eq!(seen(4), [0, 2]);
        assert_eq!(seen(7), [0, 1, 2, 3, 4, 5, 6]);
        assert_eq!(seen(1000), (0..10).collect::<Vec<_>>());
        assert_eq!(sampled(std::iter::empty, 5).count(), 0);
    }
}
