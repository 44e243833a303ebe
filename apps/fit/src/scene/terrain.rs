//! The terrain: heights on a grid, by planes through the nearest points of the ground.
//!
//! A plane by weighted least squares, rather than a triangulation, averages the noise of ranges and follows
//! slopes. The scatter of points about it (noise of ranges, grass, stones) is estimated from each point and
//! the plane of its neighbours without it.

use rayon::prelude::*;
use vlscan_geom::{Aabb, DVec3, median};
use vlscan_tools::neighbours::{Neighbours, plane_at};

/// Points through which the plane at a node goes.
const POINTS_OF_PLANE: usize = 12;
/// Nodes per point of the ground along each axis.
const MIN_SPACING: f64 = 0.25;
/// Maximum number of nodes: a minimum for few points, and more for each point; larger places have wider
/// grids.
const MAX_NODES: f64 = 16e6;
const MIN_NODES: f64 = 65_536.0;
const NODES_PER_POINT: f64 = 64.0;
/// Points by which the spread is estimated.
const MAX_SAMPLES: usize = 20_000;
/// Width of the border around the points, m, which oblique beams meet.
const BORDER: f64 = 2.0;

/// Heights on a square grid.
#[derive(Clone, Debug)]
pub struct Terrain {
    /// x and y of the first node, m.
    pub min: [f64; 2],
    /// Distance between nodes, m.
    pub spacing: f64,
    /// Nodes along x and y.
    pub nodes: [usize; 2],
    /// Heights, m, by rows of ascending y.
    pub heights: Vec<f64>,
    /// Robust standard deviation of the points about the plane of their neighbours, m: 1.4826 × their median
    /// distance.
    pub spread: f64,
    /// Class of each node: that of the nearest point.
    pub(super) classes: Vec<u8>,
}

/// The terrain through `points` of the ground with their `classes`, over `bounds`.
pub(super) fn terrain(points: Vec<DVec3>, classes: &[u8], bounds: Aabb) -> Terrain {
    let neighbours = Neighbours::of(points);
    let points = neighbours.points();
    let (min, max) = (bounds.min - BORDER, bounds.max + BORDER);
    let area = (max.x - min.x) * (max.y - min.y);
    let most = (MIN_NODES + NODES_PER_POINT * points.len() as f64).min(MAX_NODES);
    let (wide, long) = (max.x - min.x, max.y - min.y);
    // In a narrow place the rows at the borders count, too.
    let least = (area / most).sqrt().max(wide.max(long) / most * 4.0);
    let spacing = spacing(points, &neighbours).max(MIN_SPACING).max(least);
    let nodes = [max.x - min.x, max.y - min.y].map(|d| (d / spacing).ceil() as usize + 1);
    let fitted = |i: usize| {
        let x = min.x + (i % nodes[0]) as f64 * spacing;
        let y = min.y + (i / nodes[0]) as f64 * spacing;
        let near = neighbours.nearest(x, y, POINTS_OF_PLANE, None);
        (plane_at(points, &near, [x, y]), near.first().map_or(2, |n| classes[n.1]))
    };
    let (heights, node_classes): (Vec<f64>, Vec<u8>) =
        (0..nodes[0] * nodes[1]).into_par_iter().map(fitted).unzip();
    // Water is flatter than land.
    let is_land = |i: usize| matches!(classes[i], 2 | 8);
    let spread = spread(points, &neighbours, is_land);
    Terrain { min: [min.x, min.y], spacing, nodes, heights, spread, classes: node_classes }
}

/// Median distance of points to their nearest neighbour but two, which is that of a square grid of the same
/// density, nearly.
fn spacing(points: &[DVec3], neighbours: &Neighbours) -> f64 {
    let step = points.len().div_ceil(MAX_SAMPLES);
    let distance = |i: usize| Some(neighbours.nearest(points[i].x, points[i].y, 3, Some(i)).last()?.0.sqrt());
    median((0..points.len()).step_by(step).filter_map(distance)).unwrap_or(1.0)
}

/// Distances of the points that count from the plane of their neighbours, as a robust standard deviation.
fn spread(points: &[DVec3], neighbours: &Neighbours, counts: impl Fn(usize) -> bool + Sync) -> f64 {
    let step = points.len().div_ceil(MAX_SAMPLES);
    let residuals: Vec<f64> = (0..points.len())
        .into_par_iter()
        .step_by(step)
        .filter(|i| counts(*i))
        .map(|i| {
            let p = points[i];
            let near = neighbours.nearest(p.x, p.y, POINTS_OF_PLANE, Some(i));
            (p.z - plane_at(points, &near, [p.x, p.y])).abs()
        })
        .collect();
    1.4826 * median(residuals).unwrap_or(0.0)
}

impl Terrain {
    /// Height at x, y, m, between the four nodes around; beyond the grid that of its border.
    pub fn height(&self, x: f64, y: f64) -> f64 {
        let at = |value: f64, axis: usize| {
            let u = ((value - self.min[axis]) / self.spacing).clamp(0.0, (self.nodes[axis] - 1) as f64);
            let i = (u as usize).min(self.nodes[axis].saturating_sub(2));
            (i, u - i as f64)
        };
        let ((i, u), (j, v)) = (at(x, 0), at(y, 1));
        let node = |i: usize, j: usize| {
            self.heights[j.min(self.nodes[1] - 1) * self.nodes[0] + i.min(self.nodes[0] - 1)]
        };
        let (low, high) = (
            node(i, j) * (1.0 - u) + node(i + 1, j) * u,
            node(i, j + 1) * (1.0 - u) + node(i + 1, j + 1) * u,
        );
        low * (1.0 - v) + high * v
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::rng::{Purpose, Stream};

    /// Points of a plane with noise of 0.03 m: heights within a third of it, and the spread that was put in.
    #[test]
    fn a_noisy_plane_is_found_with_its_spread() {
        let draws = Stream::new(5, Purpose::Material);
        let points: Vec<DVec3> = (0..6000u64)
            .map(|i| {
                let (x, y) = (40.0 * draws.uniform(0, i, 0), 30.0 * draws.uniform(0, i, 1));
                DVec3::new(x, y, 100.0 + 0.2 * x - 0.1 * y + 0.03 * draws.normal(1, i, 0))
            })
            .collect();
        let bounds = points.iter().fold(Aabb::EMPTY, |b, p| b.with(*p));
        let found = terrain(points.clone(), &vec![2; points.len()], bounds);
        assert!((found.spread / 0.03 - 1.0).abs() < 0.1, "{}", found.spread);
        let (mut sum, mut n) = (0.0, 0.0);
        for (x, y) in (1..39).flat_map(|x| (1..29).map(move |y| (f64::from(x), f64::from(y)))) {
            let error: f64 = found.height(x, y) - (100.0 + 0.2 * x - 0.1 * y);
            assert!(error.abs() < 0.06, "{x} {y}: {error}");
            (sum, n) = (sum + error, n + 1.0);
        }
        assert!((sum / n).abs() < 0.002, "no bias: {}", sum / n);
    }
}
