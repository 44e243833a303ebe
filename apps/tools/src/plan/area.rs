//! Areas on the ground, in the scene's world coordinates.

use vlscan_base::quantity::{COORDINATE, number};
use vlscan_geom::is_inside;

/// Maximum number of corners of an outline whose sides are compared with each other.
const MAX_COMPARED: usize = 20_000;
/// Distance by which the ends of a side are on either side of another that it crosses, m: sides may touch.
const MIN_CROSSING: f64 = 1e-6;

/// A polygon without holes: its corners in order, without repeating the first one at the end. Coordinates are
/// m.
#[derive(Clone, Debug, PartialEq)]
pub struct Area {
    corners: Vec<[f64; 2]>,
}

/// Corners or positions that make no area or line.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AreaError {
    /// Fewer than three corners.
    #[error("an area of {0} corners, expected at least 3")]
    Corners(usize),
    /// Corners on one line.
    #[error("the corners of the area lie on one line")]
    NoArea,
    /// Two sides that cross each other, at x, y.
    #[error(
        "the sides of the area cross each other at x {} y {}; give its corners in the order of its outline",
        number(.0[0]),
        number(.0[1])
    )]
    Crossing([f64; 2]),
    /// A coordinate that is not a number of metres.
    #[error("coordinate {0:?}, expected {range}", range = COORDINATE.expected)]
    Coordinate(f64),
    /// A corridor whose edge would have too many points.
    #[error("--buffer {distance} is too narrow for a line of {length:.0} m")]
    Narrow {
        /// Distance of the edge from the line, m.
        distance: f64,
        /// Length of the line, m.
        length: f64,
    },
}

impl Area {
    /// # Errors
    /// Fewer than three corners, corners on one line, sides that cross each other, a coordinate out of
    /// bounds.
    pub fn new(corners: Vec<[f64; 2]>) -> Result<Area, AreaError> {
        Area::checked(corners, true)
    }

    /// An area whose outline may cross itself, as that of a corridor along a line that turns back.
    pub(super) fn of_corridor(corners: Vec<[f64; 2]>) -> Result<Area, AreaError> {
        Area::checked(corners, false)
    }

    fn checked(mut corners: Vec<[f64; 2]>, is_simple: bool) -> Result<Area, AreaError> {
        corners.dedup();
        if corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        check_coordinates(&corners)?;
        if corners.len() < 3 {
            return Err(AreaError::Corners(corners.len()));
        }
        let area = Area { corners };
        if is_simple && let Some(place) = area.crossing() {
            return Err(AreaError::Crossing(place));
        }
        if area.square_metres() < 1e-6 {
            return Err(AreaError::NoArea);
        }
        Ok(area)
    }

    /// The rectangle between two corners.
    pub fn rectangle(low: [f64; 2], high: [f64; 2]) -> Result<Area, AreaError> {
        Area::new(vec![low, [high[0], low[1]], high, [low[0], high[1]]])
    }

    /// The corners of the polygon, x and y in m, without repetition of the first one.
    pub fn corners(&self) -> &[[f64; 2]] {
        &self.corners
    }

    /// The sides, from corner to corner.
    pub fn sides(&self) -> impl Iterator<Item = [[f64; 2]; 2]> {
        let next = self.corners.iter().cycle().skip(1);
        self.corners.iter().zip(next).map(|(a, b)| [*a, *b])
    }

    /// Intersection of two sides; not searched for in outlines of very many corners.
    fn crossing(&self) -> Option<[f64; 2]> {
        if self.corners.len() > MAX_COMPARED {
            return None;
        }
        // Sorted along the larger extent, a side is compared only with those that begin before it ends.
        let (low, high) = self.bounds();
        let axis = usize::from(high[1] - low[1] > high[0] - low[0]);
        let range = |[a, b]: &[[f64; 2]; 2]| (a[axis].min(b[axis]), a[axis].max(b[axis]));
        let mut sides: Vec<[[f64; 2]; 2]> = self.sides().collect();
        sides.sort_by(|a, b| range(a).0.total_cmp(&range(b).0));
        sides.iter().enumerate().find_map(|(i, side)| {
            let near = sides[i + 1..].iter().take_while(|other| range(other).0 <= range(side).1);
            near.filter_map(|other| crossing(*side, *other)).next()
        })
    }

    /// Gauss' formula for the area of a polygon.
    pub fn square_metres(&self) -> f64 {
        // Relative to a corner, since world coordinates have many digits before the point.
        let [x0, y0] = self.corners[0];
        let cross = |[a, b]: [[f64; 2]; 2]| (a[0] - x0) * (b[1] - y0) - (b[0] - x0) * (a[1] - y0);
        0.5 * self.sides().map(cross).sum::<f64>().abs()
    }

    /// True if a point is inside.
    pub fn contains(&self, place: [f64; 2]) -> bool {
        is_inside(&self.corners, place)
    }

    /// True if a point is inside or on the outline: of a point there, `contains` is true on some sides only.
    pub(super) fn covers(&self, place: [f64; 2]) -> bool {
        self.contains(place) || self.sides().any(|side| distance(side, place) <= MIN_CROSSING)
    }

    /// The smallest and the largest coordinates.
    pub fn bounds(&self) -> ([f64; 2], [f64; 2]) {
        let fold = |pick: fn(f64, f64) -> f64, from: f64| {
            self.corners.iter().fold([from; 2], |best, c| [pick(best[0], c[0]), pick(best[1], c[1])])
        };
        (fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY))
    }

    /// The smallest and the largest value of `along` where `across` is from `low` to `high`, both being
    /// linear functions of the position; `None` where the area does not reach.
    pub fn extent(
        &self,
        along: impl Fn([f64; 2]) -> f64,
        across: impl Fn([f64; 2]) -> f64,
        [low, high]: [f64; 2],
    ) -> Option<[f64; 2]> {
        let mut found: Option<[f64; 2]> = None;
        let mut add = |value: f64| {
            let [least, most] = found.unwrap_or([value; 2]);
            found = Some([least.min(value), most.max(value)]);
        };
        for [a, b] in self.sides() {
            let (s, e) = (across(a), across(b));
            // The part of the side whose distance is within the limits, as fractions of the side.
            let at = |limit: f64| if s == e { 0.0 } else { (limit - s) / (e - s) };
            let (mut from, mut to) = (0.0_f64, 1.0_f64);
            if s == e {
                if s < low || s > high {
                    continue;
                }
            } else {
                from = from.max(at(low).min(at(high)));
                to = to.min(at(low).max(at(high)));
            }
            if from <= to {
                let value = |t: f64| along(a) + t * (along(b) - along(a));
                add(value(from));
                add(value(to));
            }
        }
        found
    }
}

/// Intersection of the inner parts of two sides.
fn crossing(one: [[f64; 2]; 2], other: [[f64; 2]; 2]) -> Option<[f64; 2]> {
    // Distances of the ends of a side from the line through another.
    let distances = |[a, b]: [[f64; 2]; 2], ends: [[f64; 2]; 2]| {
        let way = [b[0] - a[0], b[1] - a[1]];
        let length = libm::hypot(way[0], way[1]);
        ends.map(|p| (way[0] * (p[1] - a[1]) - way[1] * (p[0] - a[0])) / length)
    };
    let is_crossed = |[p, q]: [f64; 2]| p.min(q) < -MIN_CROSSING && p.max(q) > MIN_CROSSING;
    let [from, to] = distances(other, one);
    let t = from / (from - to);
    let place = [0, 1].map(|axis| one[0][axis] + t * (one[1][axis] - one[0][axis]));
    (is_crossed([from, to]) && is_crossed(distances(one, other))).then_some(place)
}

/// # Errors
/// A sentence that names the coordinate that is not in metres.
pub(super) fn check_coordinates(points: &[[f64; 2]]) -> Result<(), AreaError> {
    match points.iter().flatten().find(|v| !COORDINATE.contains(**v)) {
        Some(wrong) => Err(AreaError::Coordinate(*wrong)),
        None => Ok(()),
    }
}

/// Distance of a point from a side, m.
fn distance([a, b]: [[f64; 2]; 2], p: [f64; 2]) -> f64 {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let square = along[0] * along[0] + along[1] * along[1];
    let share = match square > 0.0 {
        true => ((along[0] * to[0] + along[1] * to[1]) / square).clamp(0.0, 1.0),
        false => 0.0,
    };
    libm::hypot(to[0] - share * along[0], to[1] - share * along[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn l_shape() -> Area {
        Area::new(vec![[0.0, 0.0], [40.0, 0.0], [40.0, 10.0], [10.0, 10.0], [10.0, 30.0], [0.0, 30.0]])
            .unwrap()
    }

    #[test]
    fn an_area_knows_size_inside_and_extent() {
        let area = l_shape();
        assert_eq!(area.square_metres(), 600.0);
        assert!(area.contains([35.0, 5.0]) && !area.contains([35.0, 15.0]) && area.contains([5.0, 25.0]));
        assert_eq!(area.bounds(), ([0.0, 0.0], [40.0, 30.0]));
        let along_x = |limits| area.extent(|p| p[0], |p| p[1], limits);
        assert_eq!(along_x([2.0, 8.0]), Some([0.0, 40.0]));
        assert_eq!(along_x([12.0, 20.0]), Some([0.0, 10.0]));
        assert_eq!(along_x([31.0, 40.0]), None);
        // Sides may touch, but not cross.
        for (corners, place) in [
            (vec![[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]], Some([5.0, 5.0])),
            (vec![[0.0, 0.0], [20.0, 0.0], [10.0, 30.0], [10.0, -5.0]], Some([10.0, 0.0])),
            (vec![[0.0, 0.0], [20.0, 0.0], [20.0, 20.0], [10.0, 0.0], [0.0, 20.0]], None),
        ] {
            let offset = |v: [f64; 2]| [v[0] + 5e5, v[1] + 5.4e6];
            let found = Area::new(corners.into_iter().map(offset).collect());
            assert_eq!(found.err(), place.map(|place| AreaError::Crossing(offset(place))));
        }
        // Far from the origin as well.
        let far = Area::rectangle([5e5, 5.4e6], [5e5 + 100.0, 5.4e6 + 50.0]).unwrap();
        assert!((far.square_metres() - 5000.0).abs() < 1e-6);
    }
}
