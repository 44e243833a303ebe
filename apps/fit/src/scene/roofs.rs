//! Roofs with walls: square cells of planes, cut along the outlines, and vertical faces where neighbours do
//! not meet.
//!
//! A recording from the air shows surfaces under the open sky. Each cell of a building has the plane of the
//! points around it; where the planes of neighbouring cells meet within a step they share their corners,
//! elsewhere a wall closes the gap: between two roofs, or down to the terrain.

use super::outline::{Binned, Corner, Place, Votes};
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
    /// Cells with a roof.
    pub cells: usize,
    /// Area of the roofs seen from above, m².
    pub area: f64,
}

/// A cell: height of the plane at its centre and its slopes.
#[derive(Clone, Copy)]
struct Cell {
    height: f64,
    slope: [f64; 2],
    class: u8,
}

/// The roofs through `points` of buildings with their `classes`. `others` are the points of other things.
pub(super) fn roofs(
    points: &[DVec3],
    classes: &[u8],
    others: impl ParallelIterator<Item = DVec3>,
    cell: f64,
    terrain: &Terrain,
) -> Roofs {
    let mut out = Roofs { cell, ..Roofs::default() };
    if points.is_empty() {
        return out;
    }
    let (points, classes) = seen_from_above(points, classes, 0.5 * cell);
    let (points, classes) = (&points[..], &classes[..]);
    let binned = Binned::new(points, cell);
    let others: Vec<DVec3> = others.filter(|p| binned.is_near(*p)).collect();
    let votes = Votes::of(&binned, &Binned::new(&others, cell), MIN_STEP);
    let neighbours = Neighbours::of(points.to_vec());
    let fitted = |place: Place| {
        let (j, i) = place;
        let centre = [(i as f64 + 0.5) * cell, (j as f64 + 0.5) * cell];
        (place, plane(points, classes, binned.in_row(j, i, i), &neighbours, centre, cell))
    };
    let cells: BTreeMap<Place, Cell> = votes.cells().into_par_iter().map(fitted).collect();
    out.cells = cells.len();
    for (&place, this) in &cells {
        add_cell(&cells, place, this, &votes.polygon(place), terrain, &mut out);
    }
    out
}

/// The points of buildings, with their classes, that have none more than a step above them within `reach` m:
/// those on the sides of buildings, at any height, are no roof beside it.
fn seen_from_above(points: &[DVec3], classes: &[u8], reach: f64) -> (Vec<DVec3>, Vec<u8>) {
    const MOST: usize = 12;
    let neighbours = Neighbours::of(points.to_vec());
    let is_above = |i: usize| {
        let p = points[i];
        let near = neighbours.nearest_within(p.x, p.y, MOST, reach);
        !near.iter().any(|n| points[n.1].z > p.z + 2.0 * MIN_STEP)
    };
    (0..points.len()).into_par_iter().filter(|i| is_above(*i)).map(|i| (points[i], classes[i])).unzip()
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

/// Adds the roof of a cell, and walls along its outline and where a neighbour is lower.
fn add_cell(
    cells: &BTreeMap<Place, Cell>,
    (j, i): Place,
    this: &Cell,
    polygon: &[Corner],
    terrain: &Terrain,
    out: &mut Roofs,
) {
    const OFFSETS: [(i64, i64); 4] = [(0, 0), (0, 1), (1, 1), (1, 0)];
    let cell = out.cell;
    // The place of a corner by the plane of `own`.
    let at = |own: Place, corner: &Corner| {
        let [a, b] = [corner.edge, (corner.edge + 1) % 4].map(|k| {
            let node = (j + OFFSETS[k].0, i + OFFSETS[k].1);
            let z = corner_height(cells, own, node, cell);
            DVec3::new(node.1 as f64 * cell, node.0 as f64 * cell, z)
        });
        a.lerp(b, corner.along)
    };
    let corners: Vec<DVec3> = polygon.iter().map(|corner| at((j, i), corner)).collect();
    // A fan of quadrilaterals, of which the last one may be a triangle.
    for k in (1..corners.len().saturating_sub(1)).step_by(2) {
        let last = corners[usize::min(k + 2, corners.len() - 1)];
        out.faces.push(([corners[0], corners[k], corners[k + 1], last], this.class));
    }
    out.area += area(&corners);
    let beside = [(j - 1, i), (j, i + 1), (j + 1, i), (j, i - 1)];
    for (k, from) in polygon.iter().enumerate() {
        let next = (k + 1) % polygon.len();
        let (to, a, b) = (&polygon[next], corners[k], corners[next]);
        let is_outline = from.is_cut && to.is_cut;
        let foot = |p: DVec3, corner: &Corner| match is_outline {
            true => terrain.height(p.x, p.y) - WALL_FOOT,
            false => at(beside[from.edge], corner).z,
        };
        let (low_a, low_b) = (foot(a, from), foot(b, to));
        if a.z - low_a > 1e-6 || b.z - low_b > 1e-6 {
            let (a2, b2) = (DVec3::new(a.x, a.y, low_a.min(a.z)), DVec3::new(b.x, b.y, low_b.min(b.z)));
            out.faces.push(([a, a2, b2, b], this.class));
        }
    }
}

/// The area of a polygon seen from above, m².
fn area(corners: &[DVec3]) -> f64 {
    let next = corners.iter().cycle().skip(1);
    0.5 * corners.iter().zip(next).map(|(a, b)| a.x * b.y - a.y * b.x).sum::<f64>().abs()
}

/// Height of a corner for a cell: the mean of the planes of the cells around the corner that are within a
/// step of the cell's plane.
fn corner_height(cells: &BTreeMap<Place, Cell>, own: Place, corner: Place, cell: f64) -> f64 {
    let height = |place: Place, c: &Cell| {
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
    use vlscan_base::rng::{Purpose, Stream};
    use vlscan_geom::Aabb;

    /// Edge of the land around a house, m.
    const LAND: f64 = 21.0;

    /// Points spread as a scanner does, as many per square metre, of a house with this roof, if there is one
    /// at x, y, on flat land; the roofs through them with cells of 0.5 m.
    fn found(per_m2: f64, roof: impl Fn(f64, f64) -> Option<f64>) -> Roofs {
        let draws = Stream::new(3, Purpose::Material);
        let rows = (LAND * per_m2.sqrt()) as u64;
        let place = |i: u64| {
            let at = |row: u64, axis: u32| (row as f64 + draws.uniform(0, i, axis)) * LAND / rows as f64;
            [at(i % rows, 0), at(i / rows, 1)]
        };
        let all: Vec<[f64; 2]> = (0..rows * rows).map(place).collect();
        let points: Vec<DVec3> =
            all.iter().filter_map(|[x, y]| Some(DVec3::new(*x, *y, roof(*x, *y)?))).collect();
        let ground: Vec<DVec3> = all
            .iter()
            .filter(|[x, y]| roof(*x, *y).is_none())
            .map(|[x, y]| DVec3::new(*x, *y, 0.0))
            .collect();
        let bounds = ground.iter().fold(Aabb::EMPTY, |b, p| b.with(*p));
        let terrain = terrain(ground.clone(), &vec![2; ground.len()], bounds);
        roofs(&points, &vec![6; points.len()], ground.into_par_iter(), 0.5, &terrain)
    }

    fn is_wall(face: &&([DVec3; 4], u8)) -> bool {
        (face.0[0] - face.0[1]).truncate().length() < 1e-9
    }

    /// Length of the walls that are at least that high, m.
    fn walls(roofs: &Roofs, height: f64) -> f64 {
        let high = roofs.faces.iter().filter(is_wall).filter(|f| f.0[0].z - f.0[1].z > height);
        high.map(|f| (f.0[0] - f.0[3]).truncate().length()).sum()
    }

    /// A gable roof of 8 m by 6 m with its ridge along x at 6 m, on flat land: ridge, eaves and walls.
    #[test]
    fn a_gable_has_its_ridge_and_walls() {
        let height = |y: f64| 6.0 - 0.8 * (y - 10.0).abs();
        let is_house = |x: f64, y: f64| (6.0..14.0).contains(&x) && (7.0..13.0).contains(&y);
        let found = found(25.0, |x, y| is_house(x, y).then(|| height(y)));
        assert!((found.area / 48.0 - 1.0).abs() < 0.03, "{}", found.area);
        let around = walls(&found, 2.0);
        assert!((around / 28.0 - 1.0).abs() < 0.05, "{around} m around the house");
        assert!(walls(&found, 0.0) < around + 0.5, "no walls within");
        for (corners, _) in found.faces.iter().filter(|f| !is_wall(f)) {
            for c in corners {
                assert!((c.z - height(c.y)).abs() < 0.3, "{c}");
            }
        }
    }

    /// Walls in steps along the grid would be 4/π as long on average.
    #[test]
    fn a_turned_house_has_its_area_and_the_length_of_its_outline() {
        for degrees in [0.0, 10.0, 30.0, 45.0f64] {
            let (sin, cos) = libm::sincos(degrees.to_radians());
            let is_house = |x: f64, y: f64| {
                let (x, y) = (x - 10.4, y - 10.3);
                (cos * x + sin * y).abs() < 5.0 && (cos * y - sin * x).abs() < 4.0
            };
            let found = found(9.0, |x, y| is_house(x, y).then_some(5.0));
            assert!((found.area / 80.0 - 1.0).abs() < 0.03, "{degrees}°: {} m²", found.area);
            let around = walls(&found, 2.0);
            assert!((around / 36.0 - 1.0).abs() < 0.05, "{degrees}°: {around} m around the house");
        }
    }

    /// Second returns at edges, and points that are a building's by mistake, are few among the ground.
    #[test]
    fn single_points_of_a_building_among_the_ground_are_no_roof() {
        let is_point = |x: f64, y: f64| x.rem_euclid(4.0) < 0.3 && y.rem_euclid(4.0) < 0.3;
        let area = found(20.0, |x, y| is_point(x, y).then_some(3.0)).area;
        assert!(area < 3.0, "{area} m²");
        assert!(found(20.0, |_, _| None).faces.is_empty(), "no building, no roof");
    }
}
