//! The ground that a flight covers, as cells of a grid over the scene.

use super::sample::Stratum;
use vlscan_geom::{Aabb, DVec3, is_inside};
use vlscan_lidar::flight::FlightPlan;

/// Cells along the longer side of the scene's box.
const CELLS_PER_SIDE: f64 = 400.0;
/// Maximum number of positions of a leg, and of all legs.
const MAX_PLACES_PER_LEG: u32 = 17;
const MAX_PLACES: u32 = 20_000;

/// A strip or sector of ground: four corners in order, scene frame, m.
pub type Quad = [DVec3; 4];

/// Covered ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Covered area within the scene's box, m².
    pub covered: f64,
    /// Area of the scene's box, m².
    pub scene: f64,
}

/// The swaths of legs, or the sectors around static positions.
pub fn swaths(flight: &FlightPlan, strata: &[Stratum]) -> Vec<(u32, Quad)> {
    let seen = |s: &&Stratum| s.hits > 0.0;
    if strata.iter().filter(seen).all(|s| s.view.right == DVec3::ZERO) {
        return sectors(strata);
    }
    let across = |leg: Option<u32>| {
        let of_leg = strata.iter().filter(seen).filter(|s| leg.is_none_or(|leg| s.leg == leg));
        let fold = |a: ([f64; 2], u32), s: &Stratum| {
            let [left, right] = s.view.across;
            ([a.0[0].min(left), a.0[1].max(right)], a.1 + 1)
        };
        of_leg.fold(([0.0, 0.0], 0), fold)
    };
    let everywhere = across(None).0;
    let legs = flight.leg_count().max(1) as u32;
    let mut places: Vec<(u32, DVec3)> = flight
        .planned_positions(MAX_PLACES_PER_LEG.min(MAX_PLACES / legs))
        .into_iter()
        .map(|place| (place.leg, place.position))
        .collect();
    if places.is_empty() {
        places = strata.iter().filter(seen).map(|s| (s.leg, s.view.origin)).collect();
    }
    let mut quads = Vec::new();
    let mut cached = None;
    for pair in places.windows(2) {
        let ((leg, from), (next, to)) = (pair[0], pair[1]);
        let way = to - from;
        let way = DVec3::new(way.x, way.y, 0.0).normalize_or_zero();
        if leg != next || way == DVec3::ZERO {
            continue;
        }
        let [left, right] = match cached {
            Some((of, sides)) if of == leg => sides,
            _ => {
                // A few strata see the whole scan line.
                let (own, count) = across(Some(leg));
                let sides = if count >= 4 { own } else { everywhere };
                cached = Some((leg, sides));
                sides
            }
        };
        let side = DVec3::new(way.y, -way.x, 0.0);
        quads.push((leg, [from + side * left, from + side * right, to + side * right, to + side * left]));
    }
    quads
}

/// Sectors between the directions of successive strata of one position.
fn sectors(strata: &[Stratum]) -> Vec<(u32, Quad)> {
    let pairs = strata.windows(2).filter(|pair| pair[0].leg == pair[1].leg);
    let both = pairs.filter(|pair| pair[0].hits > 0.0 && pair[1].hits > 0.0);
    both.map(|pair| {
        let (a, b) = (pair[0].view, pair[1].view);
        (pair[0].leg, [a.origin, a.farthest, b.farthest, b.origin])
    })
    .collect()
}

/// The area that quads cover within the box of the scene.
pub fn coverage(quads: &[(u32, Quad)], scene: &Aabb) -> Coverage {
    let size = scene.size();
    let cell = size.x.max(size.y) / CELLS_PER_SIDE;
    if !(cell.is_finite() && cell > 0.0) {
        return Coverage::default();
    }
    let columns = ((size.x / cell).ceil() as usize).max(1);
    let rows = ((size.y / cell).ceil() as usize).max(1);
    let mut covered = vec![false; columns * rows];
    for (_, quad) in quads {
        let corners = quad.map(|p| [(p.x - scene.min.x) / cell, (p.y - scene.min.y) / cell]);
        let range = |values: [f64; 4], most: usize| {
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            (low.floor().max(0.0) as usize)..((high.ceil().max(0.0) as usize).min(most))
        };
        let columns_of_quad = range(corners.map(|c| c[0]), columns);
        for row in range(corners.map(|c| c[1]), rows) {
            for column in columns_of_quad.clone() {
                if is_inside(&corners, [column as f64 + 0.5, row as f64 + 0.5]) {
                    covered[row * columns + column] = true;
                }
            }
        }
    }
    let count = covered.iter().filter(|c| **c).count() as f64;
    // Cells at the far edges reach beyond the box.
    let all = (size.x * size.y).max(0.0);
    Coverage { covered: all * count / covered.len() as f64, scene: all }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlapping_strips_count_once() {
        let bounds = Aabb { min: DVec3::new(0.0, 0.0, 0.0), max: DVec3::new(100.0, 50.0, 10.0) };
        let strip = |from: f64, to: f64| {
            let p = |x: f64, y: f64| DVec3::new(x, y, 30.0);
            (0, [p(-50.0, from), p(-50.0, to), p(200.0, to), p(200.0, from)])
        };
        let found = coverage(&[strip(0.0, 20.0), strip(10.0, 30.0)], &bounds);
        assert!((found.covered - 3000.0).abs() < 50.0 && (found.scene - 5000.0).abs() < 1e-9, "{found:?}");
        assert_eq!(coverage(&[], &bounds).covered, 0.0);
        assert_eq!(coverage(&[strip(0.0, 20.0)], &Aabb::EMPTY), Coverage::default());
    }
}
