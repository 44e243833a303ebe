//! Vertical rays up and down from positions of a flight.

use super::boxes::heights;
use super::finding::Finding;
use vlscan_base::quantity::metres;
use vlscan_geom::{Aabb, DVec3};
use vlscan_scene::{Material, OpticsKind, Scene};
use vlscan_trace::Tree;

/// Maximum fraction of positions over the scene that may be below the ground, as in a valley of a coarse
/// terrain.
const MAX_SHARE_BELOW: f64 = 0.1;
/// Minimum fraction of positions on a surface at which the flight is taken to be on the surface.
const MIN_SHARE_ON: f64 = 0.9;
/// Distance from a surface below which a scanner is taken to be on it, m.
const ON_SURFACE: f64 = 0.05;
/// Number of rays around a position that distinguish a terrain from a tree crown or a bridge, and the number
/// that must agree.
const RING: usize = 8;
const MIN_AGREEING: usize = 7;
/// Number of horizontal directions in which the nearest surface must be a wall if a position is taken to be
/// beside or within a house, below its roof.
const MIN_WALLS: usize = 2;
/// Largest sine of the angle between a wall and the vertical.
const MAX_LEAN: f64 = 0.3;

/// Minimum fraction of positions in water at which a flight is taken to be in it.
const MIN_SHARE_IN_WATER: f64 = 0.1;

/// Maximum number of positions that are checked over a scene of tiles, each of which may have to be loaded.
const MAX_PLACES_OVER_TILES: usize = 8;

/// Location of a position relative to the surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Side {
    /// There is a surface below.
    Above,
    /// On a surface.
    On,
    /// Distance in metres below a surface that continues around the position, with no surface underneath.
    Below(f64),
    /// No surface above or below, or the surface above is not terrain.
    Elsewhere,
}

/// Finds scanner positions (scene frame) in water or below the terrain, and flights on its surface. The
/// scanner is `mount` metres above its platform.
pub(super) fn check(who: &str, scene: &Scene, tree: &Tree, places: &[DVec3], mount: f64) -> Option<Finding> {
    if let Some(finding) = in_water(who, scene, tree, places) {
        return Some(finding);
    }
    let step = if scene.tiles.is_some() { places.len().div_ceil(MAX_PLACES_OVER_TILES) } else { 1 };
    let sides: Vec<Side> =
        places.iter().step_by(step.max(1)).map(|&place| side(scene, tree, place)).collect();
    let over = sides.iter().filter(|side| **side != Side::Elsewhere).count() as f64;
    let mut depths: Vec<f64> = sides
        .iter()
        .filter_map(|side| if let Side::Below(depth) = side { Some(*depth) } else { None })
        .collect();
    let flight = Aabb::around(places.iter().map(|&place| scene.to_world(place)));
    let platform = flight.translated(DVec3::Z * -mount);
    if !depths.is_empty() && depths.len() as f64 > MAX_SHARE_BELOW * over {
        depths.sort_by(f64::total_cmp);
        let depth = depths[depths.len() / 2];
        let where_ = match places.len() {
            1 => format!("{who} is {} below the terrain, with nothing beneath it", metres(depth)),
            _ => {
                let n = sides.len();
                format!("{who} is below the terrain at {} of {n} places, by {}", depths.len(), metres(depth))
            }
        };
        let message =
            format!("{where_}: its height is {:.1}, the ground's {:.1}", flight.max.z, flight.max.z + depth);
        return Some(Finding::new(message, heights(&platform, depth)));
    }
    let on = sides.iter().filter(|side| **side == Side::On).count() as f64;
    let moves = flight.size().x.hypot(flight.size().y) > 1.0;
    (moves && over > 0.0 && on >= MIN_SHARE_ON * over).then(|| {
        let message = format!(
            "{who} runs on the surface of the scene, at height {:.1}: nothing is below it",
            flight.min.z
        );
        Finding::new(message, heights(&platform, 0.0))
    })
}

/// Finds scanner positions under the surface of water, where light is taken to be in air.
fn in_water(who: &str, scene: &Scene, tree: &Tree, places: &[DVec3]) -> Option<Finding> {
    let is_water = |material: &Material| {
        material.optics.is_some_and(|optics| matches!(optics.kind, OpticsKind::Water(_)))
    };
    // Materials of tiles are not looked up.
    if scene.tiles.is_some() || !scene.materials.iter().any(is_water) {
        return None;
    }
    let level_above = |place: &DVec3| {
        let hit = scene.nearest_where(tree, *place, DVec3::Z, |_, _| true)?;
        is_water(scene.material_of(hit.primitive)).then_some(*place + DVec3::Z * hit.t)
    };
    let levels: Vec<(DVec3, DVec3)> = places
        .iter()
        .filter(|place| place.is_finite())
        .filter_map(|place| Some((*place, level_above(place)?)))
        .collect();
    let (place, level) = levels.first().copied()?;
    (levels.len() as f64 > MIN_SHARE_IN_WATER * places.len() as f64).then(|| {
        let [height, level] = [place, level].map(|point| scene.to_world(point).z);
        let message = format!("{who} is in water: its height is {height:.1}, the water's {level:.1}");
        let help = "light is simulated as if the scanner were in air: raise it above the water, or lower the \
                    level of the water";
        Finding::new(message, help)
    })
}

fn side(scene: &Scene, tree: &Tree, place: DVec3) -> Side {
    let bounds = &scene.bounds;
    let within = |p: DVec3| {
        (bounds.min.x..=bounds.max.x).contains(&p.x) && (bounds.min.y..=bounds.max.y).contains(&p.y)
    };
    if !within(place) || !place.is_finite() {
        return Side::Elsewhere;
    }
    let cast = |from: DVec3, way: DVec3| scene.nearest_where(tree, from, way, |_, _| true).map(|hit| hit.t);
    if let Some(below) = cast(place + DVec3::Z * 2.0 * ON_SURFACE, -DVec3::Z) {
        return if below < 3.0 * ON_SURFACE { Side::On } else { Side::Above };
    }
    let Some(depth) = cast(place, DVec3::Z) else { return Side::Elsewhere };
    let radius = 0.02 * bounds.size().x.hypot(bounds.size().y);
    let roofed = |p: DVec3| !within(p) || cast(p, DVec3::Z).is_some() && cast(p, -DVec3::Z).is_none();
    let agreeing = directions().filter(|&way| roofed(place + way * radius)).count();
    let is_by_wall = |way: &DVec3| {
        let nearest = cast(place, *way);
        nearest.is_some() && nearest == scene.nearest_where(tree, place, *way, is_wall).map(|hit| hit.t)
    };
    let is_below = agreeing >= MIN_AGREEING && directions().filter(is_by_wall).count() < MIN_WALLS;
    if is_below { Side::Below(depth) } else { Side::Elsewhere }
}

/// Horizontal directions.
fn directions() -> impl Iterator<Item = DVec3> {
    (0..RING).map(|i| {
        let (sin, cos) = (i as f64 * std::f64::consts::TAU / RING as f64).sin_cos();
        DVec3::new(cos, sin, 0.0)
    })
}

/// True for a triangle that is almost vertical.
fn is_wall(scene: &Scene, primitive: u32) -> bool {
    scene.triangle(primitive).is_some_and(|[a, b, c]| {
        let normal = (b - a).cross(c - a);
        normal.z.abs() < MAX_LEAN * normal.length()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_trace::{BuildOptions, Builder, Geometry};

    /// Horizontal squares from `-half` to `half` at heights, and walls up to height 3 around a square of 8 m.
    fn found(squares: &[(f64, f64)], has_walls: bool, place: [f64; 3]) -> bool {
        let mut geometry = Geometry::default();
        let mut add = |corners: [[f64; 3]; 4]| {
            let first = geometry.vertices.len() as u32;
            geometry.vertices.extend(corners.map(DVec3::from));
            geometry.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        };
        for &(half, z) in squares {
            add([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]);
        }
        let sides = if has_walls { 4 } else { 0 };
        let ends = [[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]];
        for side in 0..sides {
            let ([x, y], [u, v]) = (ends[side], ends[(side + 1) % 4]);
            add([[x, y, 0.0], [u, v, 0.0], [u, v, 3.0], [x, y, 3.0]]);
        }
        let scene = Scene { bounds: geometry.bounds(), geometry, ..Scene::default() };
        let tree = scene.tree(&BuildOptions::of(Builder::Bvh));
        check("leg 0", &scene, &tree, &[DVec3::from(place)], 0.0).is_some()
    }

    #[test]
    fn a_tripod_under_the_eaves_is_not_below_the_terrain() {
        let roof = (5.0, 3.0);
        for place in [[4.5, 0.0, 1.5], [0.0, -4.5, 1.5], [-4.5, 3.0, 1.5], [0.0, 0.0, 1.5]] {
            assert!(!found(&[roof], true, place), "{place:?}");
            assert!(found(&[roof], false, place), "{place:?}: a terrain above");
        }
        // A house that stands on the terrain does not hide a scanner below it.
        for place in [[0.0, 0.0, -2.0], [4.5, 0.0, -2.0], [40.0, 0.0, -2.0]] {
            assert!(found(&[roof, (50.0, 0.0)], true, place), "{place:?}");
        }
    }
}
