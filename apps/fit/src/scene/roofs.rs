//! Roofs with walls: square cells of planes, and vertical faces where neighbours do not meet.
//!
//! A recording from the air shows surfaces under the open sky. Each cell of a building has the plane of the
//! points around it; where the planes of neighbouring cells meet within a step they share their corners,
//! elsewhere a wall closes the gap: between two roofs, or down to the terrain.

use super::terrain::Terrain;
use rayon::prelude::*;
use std::collections::BTreeMap;
use vlscan_geom::{DVec3, median};
use vlscan_tools::neighbours::{Neighbours, plane_at};

/// Difference in height that is a step between two roofs and no slope, m.
const MIN_STEP: f64 = 0.5;
/// Distance of points from the plane of a cell within which they count for it, m.
const PLANE_REACH: f64 = 0.4;
/// How far walls reach below the terrain, m.
const WALL_FOOT: f64 = 0.5;
/// Steepest roof: rise per metre.
const MAX_SLOPE: f64 = 3.0;

/// Quadrilaterals of roofs and walls.
#[derive(Clone, Debug, Default)]
pub struct Roofs {
    /// Edge of the cells, m.
    pub cell: f64,
    /// Corners in their order, m, and the class of the points.
    pub faces: Vec<([DVec3; 4], u8)>,
    /// How many of them are roof.
    pub cells: usize,
}

/// A cell: height of the plane at its centre and its slopes.
#[derive(Clone, Copy)]
struct Cell {
    height: f64,
    slope: [f64; 2],
    class: u8,
}

/// The roofs through `points` of buildings with their `classes`.
pub(super) fn roofs(points: &[DVec3], classes: &[u8], cell: f64, terrain: &Terrain) -> Roofs {
    if points.is_empty() {
        return Roofs { cell, ..Roofs::default() };
    }
    let at = |v: f64| (v / cell).floor() as i64;
    let mut members: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
    for (i, p) in points.iter().enumerate() {
        members.entry((at(p.y), at(p.x))).or_default().push(i);
    }
    close_gaps(&mut members);
    let neighbours = Neighbours::of(points.to_vec());
    let fitted = |(&(j, i), own): (&(i64, i64), &Vec<usize>)| {
        let centre = [(i as f64 + 0.5) * cell, (j as f64 + 0.5) * cell];
        ((j, i), plane(points, classes, own, &neighbours, centre, cell))
    };
    let all: Vec<((i64, i64), &Vec<usize>)> = members.iter().map(|(k, v)| (*k, v)).collect();
    let cells: BTreeMap<(i64, i64), Cell> = all.par_iter().map(|(k, own)| fitted((k, own))).collect();
    let mut out = Roofs { cell, faces: Vec::new(), cells: cells.len() };
    for (&place, this) in &cells {
        add_cell(&cells, place, this, cell, terrain, &mut out.faces);
    }
    out
}

/// Cells without points that roofs surround are roof.
fn close_gaps(members: &mut BTreeMap<(i64, i64), Vec<usize>>) {
    let around = |(j, i): (i64, i64)| {
        (-1..=1).flat_map(move |dj| (-1..=1).map(move |di| (j + dj, i + di))).filter(move |k| *k != (j, i))
    };
    let gaps: std::collections::BTreeSet<(i64, i64)> =
        members.keys().flat_map(|k| around(*k)).filter(|k| !members.contains_key(k)).collect();
    let closed: Vec<(i64, i64)> =
        gaps.into_iter().filter(|k| around(*k).filter(|n| members.contains_key(n)).count() >= 5).collect();
    members.extend(closed.into_iter().map(|k| (k, Vec::new())));
}

/// The plane of a cell: through the points around that lie near those in its upper part.
fn plane(
    points: &[DVec3],
    classes: &[u8],
    own: &[usize],
    neighbours: &Neighbours,
    centre: [f64; 2],
    cell: f64,
) -> Cell {
    let near = neighbours.nearest(centre[0], centre[1], 16, None);
    let reach = 1.5 * cell * 1.5 * cell;
    let mut near: Vec<(f64, usize)> =
        near.iter().enumerate().filter(|(rank, n)| *rank < 4 || n.0 <= reach).map(|(_, n)| *n).collect();
    let class = classes[*own.first().unwrap_or(&near[0].1)];
    // In a cell with a wall and a roof, the roof is visible from above: the middle of the points
    // near the highest ones.
    let mut heights: Vec<f64> = match own.is_empty() {
        true => near.iter().map(|n| points[n.1].z).collect(),
        false => own.iter().map(|i| points[*i].z).collect(),
    };
    heights.sort_by(f64::total_cmp);
    let high = heights[(heights.len() - 1) * 4 / 5];
    let top = heights.into_iter().filter(|z| (z - high).abs() < 1.0);
    let mut height = median(top).unwrap_or(high);
    let mut slope = [0.0; 2];
    for _ in 0..3 {
        let is_near = |n: &&(f64, usize)| {
            let p = points[n.1];
            let expected = height + slope[0] * (p.x - centre[0]) + slope[1] * (p.y - centre[1]);
            (p.z - expected).abs() < PLANE_REACH + 0.5 * n.0.sqrt()
        };
        let kept: Vec<(f64, usize)> = near.iter().filter(is_near).copied().collect();
        if kept.len() < 4 {
            break;
        }
        near = kept;
        height = plane_at(points, &near, centre);
        let h = 0.5 * cell;
        slope = [[h, 0.0], [0.0, h]].map(|[dx, dy]| {
            let step = [1.0, -1.0].map(|s| {
                plane_at(
                    points,
                    &shifted(points, &near, centre, [s * dx, s * dy]),
                    [centre[0] + s * dx, centre[1] + s * dy],
                )
            });
            ((step[0] - step[1]) / cell).clamp(-MAX_SLOPE, MAX_SLOPE)
        });
    }
    Cell { height, slope, class }
}

/// Points near a centre with their squared distances from a nearby place.
fn shifted(points: &[DVec3], near: &[(f64, usize)], centre: [f64; 2], by: [f64; 2]) -> Vec<(f64, usize)> {
    let place = [centre[0] + by[0], centre[1] + by[1]];
    let mut found: Vec<(f64, usize)> = near
        .iter()
        .map(|n| ((points[n.1].x - place[0]).powi(2) + (points[n.1].y - place[1]).powi(2), n.1))
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found
}

/// Adds the roof of a cell, and walls along its edges where a neighbour is lower or absent.
fn add_cell(
    cells: &BTreeMap<(i64, i64), Cell>,
    (j, i): (i64, i64),
    this: &Cell,
    cell: f64,
    terrain: &Terrain,
    faces: &mut Vec<([DVec3; 4], u8)>,
) {
    let corner = |dj: i64, di: i64| {
        let (x, y) = ((i + di) as f64 * cell, (j + dj) as f64 * cell);
        DVec3::new(x, y, corner_height(cells, (j, i), (j + dj, i + di), cell))
    };
    let corners = [corner(0, 0), corner(0, 1), corner(1, 1), corner(1, 0)];
    faces.push((corners, this.class));
    let beside = [(j - 1, i), (j, i + 1), (j + 1, i), (j, i - 1)];
    for (edge, neighbour) in beside.into_iter().enumerate() {
        let (a, b) = (corners[edge], corners[(edge + 1) % 4]);
        let is_roof = cells.contains_key(&neighbour);
        let foot = |p: DVec3| {
            let place = ((p.y / cell).round() as i64, (p.x / cell).round() as i64);
            match is_roof {
                true => corner_height(cells, neighbour, place, cell),
                false => terrain.height(p.x, p.y) - WALL_FOOT,
            }
        };
        let (low_a, low_b) = (foot(a), foot(b));
        if a.z - low_a > 1e-6 || b.z - low_b > 1e-6 {
            let (a2, b2) = (DVec3::new(a.x, a.y, low_a.min(a.z)), DVec3::new(b.x, b.y, low_b.min(b.z)));
            faces.push(([a, a2, b2, b], this.class));
        }
    }
}

/// Height of a corner for a cell: the mean of the planes of the cells around the corner that are within a
/// step of the cell's plane.
fn corner_height(cells: &BTreeMap<(i64, i64), Cell>, own: (i64, i64), corner: (i64, i64), cell: f64) -> f64 {
    let height = |place: (i64, i64), c: &Cell| {
        let dx = (corner.1 as f64 - place.1 as f64 - 0.5) * cell;
        let dy = (corner.0 as f64 - place.0 as f64 - 0.5) * cell;
        c.height + c.slope[0] * dx + c.slope[1] * dy
    };
    let reference = height(own, &cells[&own]);
    let around = [(-1, -1), (-1, 0), (0, -1), (0, 0)].map(|(dj, di)| (corner.0 + dj, corner.1 + di));
    let meeting = around.iter().filter_map(|k| Some(height(*k, cells.get(k)?)));
    let (sum, n) = meeting
        .filter(|h| (h - reference).abs() < MIN_STEP)
        .fold((0.0, 0.0), |(sum, n), h| (sum + h, n + 1.0));
    sum / f64::max(n, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::terrain::terrain;
    use vlscan_geom::Aabb;

    /// A gable roof of 8 m by 6 m with its ridge along x at 6 m, on flat land: ridge, eaves and walls.
    #[test]
    fn a_gable_has_its_ridge_and_walls() {
        let ground: Vec<DVec3> =
            (0..900).map(|i| DVec3::new(f64::from(i % 30) * 0.7, f64::from(i / 30) * 0.7, 0.0)).collect();
        let bounds = ground.iter().fold(Aabb::EMPTY, |b, p| b.with(*p));
        let terrain = terrain(ground.clone(), &vec![2; ground.len()], bounds);
        let roof = |y: f64| 6.0 - 0.8 * (y - 10.0).abs();
        let points: Vec<DVec3> = (0..40 * 30)
            .map(|i| (6.1 + f64::from(i % 40) * 0.2, 7.1 + f64::from(i / 40) * 0.2))
            .map(|(x, y)| DVec3::new(x, y, roof(y)))
            .collect();
        let found = roofs(&points, &vec![6; points.len()], 0.5, &terrain);
        assert_eq!(found.cells, 16 * 12);
        let is_wall = |f: &&([DVec3; 4], u8)| (f.0[0] - f.0[1]).truncate().length() < 1e-9;
        let walls = found.faces.iter().filter(is_wall).count();
        assert!((56..80).contains(&walls), "around the house: {walls}");
        for (corners, _) in found.faces.iter().filter(|f| !is_wall(f)) {
            for c in corners {
                assert!((c.z - roof(c.y)).abs() < 0.25, "{c}");
            }
        }
        assert!(roofs(&[], &[], 0.5, &terrain).faces.is_empty());
    }
}
