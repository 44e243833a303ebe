//! Distances from the points of one cloud to the nearest points of another.

use rayon::prelude::*;
use serde::Serialize;
use std::collections::HashMap;

/// Mean number of points per cell of the search grid.
const PER_CELL: f64 = 4.0;

/// Distances to the other cloud, m.
#[derive(Clone, Debug, Serialize)]
pub struct Distances {
    /// Points whose distance was measured.
    pub points: usize,
    pub mean_m: f64,
    pub rms_m: f64,
    pub median_m: f64,
    pub percentile_95_m: f64,
    pub max_m: f64,
}

/// Distances from at most `most` points of `from`, evenly chosen, to the nearest of `to`; neither is empty.
pub(super) fn distances(from: &[[f32; 3]], to: &[[f32; 3]], most: usize) -> Distances {
    let grid = SearchGrid::new(to);
    let step = from.len().div_ceil(most.max(1)).max(1);
    let mut found: Vec<f64> =
        from.par_iter().step_by(step).map(|point| f64::from(grid.nearest(to, point)).sqrt()).collect();
    found.par_sort_unstable_by(f64::total_cmp);
    let count = found.len() as f64;
    let at = |fraction: f64| found[((count - 1.0) * fraction).round() as usize];
    Distances {
        points: found.len(),
        mean_m: found.iter().sum::<f64>() / count,
        rms_m: (found.iter().map(|d| d * d).sum::<f64>() / count).sqrt(),
        median_m: at(0.5),
        percentile_95_m: at(0.95),
        max_m: at(1.0),
    }
}

/// Points sorted into cubes.
struct SearchGrid {
    side: f32,
    low: [f32; 3],
    /// Number of cubes along each axis.
    counts: [i32; 3],
    cells: HashMap<[i32; 3], Vec<u32>>,
}

impl SearchGrid {
    fn new(points: &[[f32; 3]]) -> SearchGrid {
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for p in points {
            for axis in 0..3 {
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
        }
        let extent = [0, 1, 2].map(|axis| f64::from(high[axis] - low[axis]));
        // Points lie on surfaces: their number grows with the square of the extent.
        let mut sorted = extent;
        sorted.sort_by(f64::total_cmp);
        let side = (sorted[2] * sorted[1].max(1e-3) * PER_CELL / points.len() as f64).sqrt();
        let side = side.max(sorted[2] * 1e-5).max(1e-4) as f32;
        let counts = extent.map(|e| (e / f64::from(side)) as i32 + 1);
        let mut grid = SearchGrid { side, low, counts, cells: HashMap::new() };
        for (i, p) in points.iter().enumerate() {
            grid.cells.entry(grid.cell(p)).or_default().push(i as u32);
        }
        grid
    }

    fn cell(&self, p: &[f32; 3]) -> [i32; 3] {
        [0, 1, 2].map(|axis| {
            (((p[axis] - self.low[axis]) / self.side).floor() as i32).clamp(0, self.counts[axis] - 1)
        })
    }

    /// The square of the distance to the nearest point. Shells of cubes around the point's cube are visited until no nearer
    /// point is possible.
    fn nearest(&self, points: &[[f32; 3]], p: &[f32; 3]) -> f32 {
        let centre = self.cell(p);
        let furthest = [0, 1, 2].map(|axis| centre[axis].max(self.counts[axis] - 1 - centre[axis]));
        let last = furthest.into_iter().max().unwrap_or(0);
        // How far p is outside of the box that the cubes cover; the shells begin at its nearest cube.
        let mut best = f32::INFINITY;
        for shell in 0..=last {
            let reach = (shell - 1).max(0) as f32 * self.side;
            if best <= reach * reach {
                break;
            }
            self.visit(centre, shell, |cell| {
                for &i in self.cells.get(&cell).into_iter().flatten() {
                    let q = points[i as usize];
                    let d = (0..3).map(|axis| (q[axis] - p[axis]) * (q[axis] - p[axis])).sum::<f32>();
                    best = best.min(d);
                }
            });
        }
        best
    }

    /// Calls `found` for the cubes at that distance, in cubes, from `centre`.
    fn visit(&self, centre: [i32; 3], shell: i32, mut found: impl FnMut([i32; 3])) {
        let range =
            |axis: usize| (centre[axis] - shell).max(0)..=(centre[axis] + shell).min(self.counts[axis] - 1);
        for z in range(2) {
            for y in range(1) {
                let is_face = (z - centre[2]).abs() == shell || (y - centre[1]).abs() == shell;
                if is_face {
                    range(0).for_each(|x| found([x, y, z]));
                    continue;
                }
                for x in [centre[0] - shell, centre[0] + shell] {
                    if range(0).contains(&x) {
                        found([x, y, z]);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Purpose, Stream};

    #[test]
    fn distances_are_those_of_brute_force() {
        let stream = Stream::new(5, Purpose::SceneMaking);
        let draw = |n: u64, axis: u32| stream.uniform(0, n, axis) as f32;
        for scale in [[10.0, 10.0, 10.0], [100.0, 100.0, 0.0], [50.0, 0.0, 0.0]] {
            let cloud = |seed: u64, count: u64, shift: f32| -> Vec<[f32; 3]> {
                (0..count).map(|i| [0, 1, 2].map(|a| draw(seed + i, a as u32) * scale[a] + shift)).collect()
            };
            let (from, to) = (cloud(0, 200, 3.0), cloud(1000, 300, 0.0));
            let grid = SearchGrid::new(&to);
            for p in &from {
                let distance = |q: &[f32; 3]| (0..3).map(|a| (q[a] - p[a]) * (q[a] - p[a])).sum::<f32>();
                let expected = to.iter().map(distance).fold(f32::INFINITY, f32::min);
                assert_eq!(grid.nearest(&to, p), expected, "{p:?} {scale:?}");
            }
        }
    }
}
