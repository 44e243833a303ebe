//! Vertical rays up and down from positions of a flight.

use super::boxes::heights;
use super::finding::Finding;
use vlscan_base::quantity::metres;
use vlscan_geom::{Aabb, DVec3};
use vlscan_scene::Scene;
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

/// Maximum number of positions that are looked at over a scene of tiles, each of which may have to be loaded.
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

/// Finds scanner positions (scene frame) below the terrain, and flights on its surface. The scanner is
/// `mount` metres above its platform.
pub(super) fn check(who: &str, scene: &Scene, tree: &Tree, places: &[DVec3], mount: f64) -> Option<Finding> {
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
    let around = (0..RING).map(|i| {
        let (sin, cos) = (i as f64 * std::f64::consts::TAU / RING as f64).sin_cos();
        place + DVec3::new(cos, sin, 0.0) * radius
    });
    let roofed = |p: DVec3| !within(p) || cast(p, DVec3::Z).is_some() && cast(p, -DVec3::Z).is_none();
    let agreeing = around.filter(|&p| roofed(p)).count();
    if agreeing >= MIN_AGREEING { Side::Below(depth) } else { Side::Elsewhere }
}
