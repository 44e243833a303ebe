//! The ground below a flight, and heights of lines that follow it.

use super::area::Area;
use super::error::PlanError;
use super::line::Line;
use vlscan_geom::{DVec3, HeightModel};

/// Maximum number of waypoints of a line that follows the ground.
const MAX_STEPS: f64 = 100_000.0;

/// Largest distance of the ground-following line from one with all waypoints, a part of the height above the
/// ground.
const MAX_DEVIATION: f64 = 0.01;

/// The ground below a planned flight.
pub struct PlanGround<'g> {
    /// Heights, world coordinates, m.
    pub heights: &'g dyn HeightModel,
    /// Height where there is none in the whole area, m.
    pub level: f64,
}

/// Mean and range of the ground below an area, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct GroundLevel {
    pub mean: f64,
    pub low: f64,
    pub high: f64,
    /// Fraction of the positions with ground.
    pub known: f64,
}

/// The ground at positions of a grid within the area.
pub(super) fn mean_ground(area: &Area, ground: &PlanGround) -> GroundLevel {
    const STEPS: u32 = 24;
    let (low, high) = area.bounds();
    let at = |i: u32, from: f64, to: f64| from + (to - from) * (f64::from(i) + 0.5) / f64::from(STEPS);
    let places = (0..STEPS).flat_map(|i| (0..STEPS).map(move |k| (i, k)));
    let mut inside: Vec<[f64; 2]> = places
        .map(|(i, k)| [at(i, low[0], high[0]), at(k, low[1], high[1])])
        .filter(|p| area.contains(*p))
        .collect();
    if inside.is_empty() {
        // Narrower than the distance of the positions.
        inside = area.corners().to_vec();
    }
    let heights: Vec<f64> = inside.iter().filter_map(|[x, y]| ground.heights.height(*x, *y)).collect();
    if heights.is_empty() {
        return GroundLevel { mean: ground.level, low: ground.level, high: ground.level, known: 0.0 };
    }
    GroundLevel {
        mean: heights.iter().sum::<f64>() / heights.len() as f64,
        low: heights.iter().copied().fold(f64::INFINITY, f64::min),
        high: heights.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        known: heights.len() as f64 / inside.len() as f64,
    }
}

/// Heights of flight lines.
pub(super) struct Heights<'g> {
    pub ground: &'g PlanGround<'g>,
    /// Height where the ground is unknown, m.
    pub level: f64,
    /// Height above the ground, m.
    pub above: f64,
    /// Steepest climb, rad; level lines if `None`.
    pub climb: Option<f64>,
}

impl Heights<'_> {
    /// The waypoints of a line, among them its corners. A line that follows the ground is at its sampled
    /// positions, a quarter of the wanted height apart, at most [`MAX_DEVIATION`] lower above it than wanted;
    /// before waypoints are left out it climbs nowhere more steeply than allowed.
    pub fn follow(&self, path: &[[f64; 2]]) -> Result<Vec<DVec3>, PlanError> {
        let place = |[x, y]: [f64; 2], z: f64| DVec3::new(x, y, z);
        let Some(climb) = self.climb else {
            return Ok(path.iter().map(|p| place(*p, self.level + self.above)).collect());
        };
        let pieces = || path.windows(2).map(|pair| Line { from: pair[0], to: pair[1] });
        let steps = |line: &Line| (line.length() / (self.above / 4.0)).ceil().max(1.0);
        let count: f64 = pieces().map(|line| steps(&line)).sum();
        if count > MAX_STEPS {
            return Err(PlanError::LineWaypoints { count, max: MAX_STEPS });
        }
        let height = |[x, y]: [f64; 2]| {
            place([x, y], self.ground.heights.height(x, y).unwrap_or(self.level) + self.above)
        };
        let mut points: Vec<DVec3> = path.first().map(|p| height(*p)).into_iter().collect();
        let mut corners = vec![0];
        for line in pieces() {
            let steps = steps(&line);
            points.extend((1..=steps as usize).map(|i| height(line.at(i as f64 / steps))));
            corners.push(points.len() - 1);
        }
        let rise = |a: DVec3, b: DVec3| climb.tan() * libm::hypot(b.x - a.x, b.y - a.y);
        for i in 1..points.len() {
            points[i].z = points[i].z.max(points[i - 1].z - rise(points[i - 1], points[i]));
        }
        for i in (1..points.len()).rev() {
            points[i - 1].z = points[i - 1].z.max(points[i].z - rise(points[i - 1], points[i]));
        }
        let mut kept: Vec<DVec3> = points.first().copied().into_iter().collect();
        for pair in corners.windows(2) {
            kept.extend(&simplified(&points[pair[0]..=pair[1]], MAX_DEVIATION * self.above)[1..]);
        }
        Ok(kept)
    }
}

/// Leaves out points whose height differs from the line between those that are kept by at most `tolerance`
/// (Ramer 1972, Douglas and Peucker 1973).
fn simplified(points: &[DVec3], tolerance: f64) -> Vec<DVec3> {
    let mut keep = vec![false; points.len()];
    (keep[0], keep[points.len() - 1]) = (true, true);
    let mut open = vec![(0, points.len() - 1)];
    while let Some((from, to)) = open.pop() {
        let deviation = |i: usize| {
            let t = (i - from) as f64 / (to - from) as f64;
            (points[i].z - (points[from].z + t * (points[to].z - points[from].z))).abs()
        };
        let worst = (from + 1..to).max_by(|a, b| deviation(*a).total_cmp(&deviation(*b)));
        if let Some(worst) = worst.filter(|i| deviation(*i) > tolerance) {
            keep[worst] = true;
            open.extend([(from, worst), (worst, to)]);
        }
    }
    points.iter().zip(keep).filter(|(_, keep)| *keep).map(|(p, _)| *p).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn narrow_areas_have_the_ground_of_their_corners() {
        // Two thin wedges between the positions of the grid.
        let area = Area::new(vec![[0.0, 0.0], [500.0, 1.0], [1000.0, 0.0], [500.0, 1.0001]]).unwrap();
        let slope = |x: f64, _: f64| Some(x);
        let level = mean_ground(&area, &PlanGround { heights: &slope, level: -5.0 });
        assert_eq!((level.low, level.high, level.known), (0.0, 1000.0, 1.0));
    }

    #[test]
    fn paths_keep_their_corners_and_climb_as_allowed() {
        // A step of 30 m at x = 100, on the first of two pieces.
        let ground = PlanGround { heights: &|x, _| Some(if x < 100.0 { 0.0 } else { 30.0 }), level: 0.0 };
        let path = [[0.0, 0.0], [200.0, 0.0], [200.0, 50.0]];
        let level = Heights { ground: &ground, level: 10.0, above: 40.0, climb: None };
        let found = level.follow(&path).unwrap();
        assert_eq!(found, path.map(|[x, y]| DVec3::new(x, y, 50.0)));
        let follows = Heights { climb: Some(45f64.to_radians()), ..level };
        let found = follows.follow(&path).unwrap();
        for [x, y] in path {
            assert!(found.iter().any(|p| (p.x, p.y) == (x, y)), "{found:?}");
        }
        assert!(found.iter().all(|p| p.z >= 39.5 && p.z <= 70.0), "{found:?}");
        for pair in found.windows(2) {
            let way = libm::hypot(pair[1].x - pair[0].x, pair[1].y - pair[0].y);
            assert!((pair[1].z - pair[0].z).abs() <= way * 1.05, "{found:?}");
        }
    }

    #[test]
    fn areas_without_ground_have_the_level_that_is_given() {
        let area = Area::rectangle([0.0; 2], [10.0; 2]).unwrap();
        let level = mean_ground(&area, &PlanGround { heights: &|_, _| None, level: 120.0 });
        assert_eq!((level.mean, level.high - level.low, level.known), (120.0, 0.0, 0.0));
    }
}
