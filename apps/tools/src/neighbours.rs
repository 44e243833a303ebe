//! The points that are nearest to a place, seen from above, and the plane through them.

use crate::kd_tree::{KdTree, Places};
use vlscan_geom::DVec3;

/// Points in the plane.
pub struct Neighbours {
    points: Vec<DVec3>,
    tree: KdTree,
}

/// Points at the height 0.
struct Flat<'p>(&'p [DVec3]);

impl Places for Flat<'_> {
    fn count(&self) -> usize {
        self.0.len()
    }

    fn at(&self, index: u32) -> [f64; 3] {
        let p = self.0[index as usize];
        [p.x, p.y, 0.0]
    }
}

impl Neighbours {
    /// Prepares points for searches.
    pub fn of(points: Vec<DVec3>) -> Neighbours {
        let tree = KdTree::new(&Flat(&points));
        Neighbours { points, tree }
    }

    /// The points.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// True if a point lies within `radius` of a place.
    pub fn is_near(&self, x: f64, y: f64, radius: f64) -> bool {
        self.tree.is_near(&Flat(&self.points), &[x, y, 0.0], radius)
    }

    /// The nearest `count` points and their squared distances, nearest first, of equal distances in the order
    /// of points; `without` is left out. The time does not depend on where points lie.
    pub fn nearest(&self, x: f64, y: f64, count: usize, without: Option<usize>) -> Vec<(f64, usize)> {
        let is_other = |i: u32| Some(i as usize) != without;
        let found = self.tree.nearest_few(&Flat(&self.points), &[x, y, 0.0], count, is_other);
        found.into_iter().map(|(square, i)| (square, i as usize)).collect()
    }

    /// As [`nearest`](Neighbours::nearest), of the points within `radius` of the place.
    pub fn nearest_within(&self, x: f64, y: f64, count: usize, radius: f64) -> Vec<(f64, usize)> {
        let (points, place) = (Flat(&self.points), [x, y, 0.0]);
        let found = self.tree.nearest_within(&points, &place, count, radius * radius, |_| true);
        found.into_iter().map(|(square, i)| (square, i as usize)).collect()
    }
}

/// Height at a place of the plane through points near it (squared distances and numbers, nearest first),
/// weighted by (1 − (d/h)²)² with h a little beyond the farthest. Where they lie to one side or on a line,
/// their weighted mean.
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
    // Points at one place, where both sides are 0, and points along a line have no slope.
    if is_beside || determinant <= 1e-4 * (cxx + cyy).powi(2) {
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
            let radius = 1.001 * expected[4].0.sqrt();
            let within = expected.iter().filter(|(square, _)| *square <= radius * radius).count();
            assert_eq!(all.nearest_within(x, y, 9, radius), expected[..within.min(9)]);
        }
        assert_eq!(Neighbours::of(points[..2].to_vec()).nearest(0.0, 0.0, 5, None).len(), 2);
        assert!(all.nearest(f64::NAN, 0.0, 5, None).is_empty());
        let distance = all.nearest(-30.0, 4.0, 1, None)[0].0.sqrt();
        assert!(all.is_near(-30.0, 4.0, distance * 1.001) && !all.is_near(-30.0, 4.0, distance * 0.999));
    }

    #[test]
    fn points_at_one_place_give_their_mean_height() {
        for heights in [[3.0; 12], std::array::from_fn(|i| i as f64)] {
            let all = Neighbours::of(heights.iter().map(|z| DVec3::new(1.0, 2.0, *z)).collect());
            let mean = heights.iter().sum::<f64>() / 12.0;
            for place in [[1.0, 2.0], [4.0, 2.0]] {
                let near = all.nearest(place[0], place[1], 12, None);
                let height = plane_at(all.points(), &near, place);
                assert!((height - mean).abs() < 1e-9, "{place:?}: {height} is not {mean}");
            }
        }
    }

    #[test]
    fn equally_near_points_are_in_the_order_of_points() {
        let points: Vec<DVec3> =
            (0..400).map(|i| DVec3::new(f64::from(i % 20), f64::from(i / 20), 0.0)).collect();
        let all = Neighbours::of(points.clone());
        for (x, y) in [(9.5, 9.5), (3.0, 7.0), (0.5, 19.0)] {
            let mut expected: Vec<(f64, usize)> =
                points.iter().enumerate().map(|(i, p)| ((p.x - x).powi(2) + (p.y - y).powi(2), i)).collect();
            expected.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            assert_eq!(all.nearest(x, y, 7, None), expected[..7], "{x} {y}");
        }
    }
}
