//! The points that are nearest to a place, seen from above, and the plane through them.

use vlscan_geom::DVec3;

/// Mean number of points in a cell.
const POINTS_PER_CELL: f64 = 4.0;

/// Points by square cells of the plane.
pub struct Neighbours {
    points: Vec<DVec3>,
    min: [f64; 2],
    size: f64,
    cells: [usize; 2],
    /// Where the points of each cell begin in `order`, with the end of the last one.
    starts: Vec<u32>,
    order: Vec<u32>,
}

impl Neighbours {
    /// Sorts points into cells.
    pub fn of(points: Vec<DVec3>) -> Neighbours {
        let min = points.iter().fold(DVec3::INFINITY, |a, p| a.min(*p));
        let max = points.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p));
        let area = ((max.x - min.x) * (max.y - min.y)).max(1e-6);
        let size = (area * POINTS_PER_CELL / points.len().max(1) as f64).sqrt().max(1e-3);
        // Points along a line have an area of nearly 0: cells are limited in number.
        let limit = (points.len() + 16) as f64;
        let size = size.max((max.x - min.x).max(max.y - min.y) / limit).max(1e-3);
        let cells = [max.x - min.x, max.y - min.y].map(|d| (d.max(0.0) / size) as usize + 1);
        let mut all =
            Neighbours { points, min: [min.x, min.y], size, cells, starts: Vec::new(), order: Vec::new() };
        let cell_of: Vec<usize> = all.points.iter().map(|p| all.cell(p.x, p.y)).collect();
        let mut starts = vec![0u32; cells[0] * cells[1] + 1];
        cell_of.iter().for_each(|cell| starts[cell + 1] += 1);
        (1..starts.len()).for_each(|i| starts[i] += starts[i - 1]);
        let mut next = starts.clone();
        all.order = vec![0; all.points.len()];
        for (point, cell) in cell_of.iter().enumerate() {
            all.order[next[*cell] as usize] = point as u32;
            next[*cell] += 1;
        }
        all.starts = starts;
        all
    }

    /// The points.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    fn index(&self, axis: usize, value: f64) -> i64 {
        ((value - self.min[axis]) / self.size).floor() as i64
    }

    fn cell(&self, x: f64, y: f64) -> usize {
        let [i, j] = [self.index(0, x), self.index(1, y)];
        let clamped = |i: i64, axis: usize| i.clamp(0, self.cells[axis] as i64 - 1) as usize;
        clamped(j, 1) * self.cells[0] + clamped(i, 0)
    }

    /// The points within `radius` of a place that `accept` accepts, and their squared distances; unordered.
    pub fn within(&self, x: f64, y: f64, radius: f64, mut visit: impl FnMut(usize, f64)) {
        let range = |axis: usize, value: f64| {
            let last = self.cells[axis] as i64 - 1;
            let from = self.index(axis, value - radius).max(0);
            from..self.index(axis, value + radius).min(last) + 1
        };
        for j in range(1, y) {
            for i in range(0, x) {
                let cell = j as usize * self.cells[0] + i as usize;
                for at in self.starts[cell]..self.starts[cell + 1] {
                    let point = self.order[at as usize] as usize;
                    let (dx, dy) = (self.points[point].x - x, self.points[point].y - y);
                    let square = dx * dx + dy * dy;
                    if square <= radius * radius {
                        visit(point, square);
                    }
                }
            }
        }
    }

    /// The nearest `count` points and their squared distances, nearest first; `without` is left out.
    pub fn nearest(&self, x: f64, y: f64, count: usize, without: Option<usize>) -> Vec<(f64, usize)> {
        let mut radius = self.size;
        let reach = self.size * (self.cells[0] + self.cells[1] + 2) as f64
            + (x - self.min[0]).abs()
            + (y - self.min[1]).abs();
        loop {
            let mut found = Vec::new();
            self.within(x, y, radius, |i, square| {
                if Some(i) != without {
                    found.push((square, i));
                }
            });
            if found.len() >= count || radius > reach {
                found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                found.truncate(count);
                return found;
            }
            radius *= 2.0;
        }
    }
}

/// Height at a place of the plane through points near it (squared distances and numbers, nearest first), weighted by
/// (1 − (d/h)²)² with h a little beyond the farthest. Where they lie to one side or on a line, their weighted mean.
pub fn plane_at(points: &[DVec3], near: &[(f64, usize)], [x, y]: [f64; 2]) -> f64 {
    let reach = near.last().map_or(1.0, |n| n.0) * 1.2 + 1e-12;
    // Sums relative to the place and the nearest height.
    let base = near.first().map_or(0.0, |n| points[n.1].z);
    let (mut s, mut r) = ([0.0; 6], [0.0; 3]);
    for (square, i) in near {
        let weight = (1.0 - square / reach).powi(2);
        let (dx, dy, dz) = (points[*i].x - x, points[*i].y - y, points[*i].z - base);
        let products = [1.0, dx, dy, dx * dx, dx * dy, dy * dy];
        s.iter_mut().zip(products).for_each(|(sum, p)| *sum += weight * p);
        r.iter_mut().zip([dz, dx * dz, dy * dz]).for_each(|(sum, p)| *sum += weight * p);
    }
    let [n, sx, sy, sxx, sxy, syy] = s;
    if n <= 0.0 {
        return base;
    }
    let (mx, my, mz) = (sx / n, sy / n, r[0] / n);
    let (cxx, cxy, cyy) = (sxx / n - mx * mx, sxy / n - mx * my, syy / n - my * my);
    let (cxz, cyz) = (r[1] / n - mx * mz, r[2] / n - my * mz);
    let determinant = cxx * cyy - cxy * cxy;
    let is_beside = mx * mx + my * my > 1.5 * (cxx + cyy);
    if is_beside || determinant < 1e-4 * (cxx + cyy).powi(2) {
        return base + mz;
    }
    let (a, b) = ((cxz * cyy - cyz * cxy) / determinant, (cyz * cxx - cxz * cxy) / determinant);
    base + mz - a * mx - b * my
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_points_are_those_of_brute_force() {
        let points: Vec<DVec3> = (0..500u32)
            .map(|i| DVec3::new(f64::from(i * 7919 % 1000) * 0.1, f64::from(i * 104_729 % 997) * 0.03, 0.0))
            .collect();
        let all = Neighbours::of(points.clone());
        for (x, y) in [(50.0, 15.0), (-30.0, 4.0), (99.9, 29.0), (200.0, 200.0)] {
            let mut expected: Vec<(f64, usize)> =
                points.iter().enumerate().map(|(i, p)| ((p.x - x).powi(2) + (p.y - y).powi(2), i)).collect();
            expected.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            assert_eq!(all.nearest(x, y, 9, None), expected[..9], "{x} {y}");
            assert_eq!(all.nearest(x, y, 3, Some(expected[0].1)), expected[1..4]);
        }
        assert_eq!(Neighbours::of(points[..2].to_vec()).nearest(0.0, 0.0, 5, None).len(), 2);
    }
}
