//! Corridors: areas within some distance of a line.

use super::area::{Area, AreaError};
use std::f64::consts::{PI, TAU};

/// Angle between the points of a round corner, rad.
const CORNER_STEP: f64 = PI / 12.0;
/// Maximum number of points of a corridor's edge.
const MAX_POINTS: f64 = 100_000.0;

/// The area no farther than `distance` m from a line of at least two different positions: its edges run
/// beside the line, round where it ends and on the outside of its corners.
///
/// # Errors
/// A line that is too long for its distance.
pub fn corridor(line: &[[f64; 2]], distance: f64) -> Result<Area, AreaError> {
    let length: f64 =
        line.windows(2).map(|pair| libm::hypot(pair[1][0] - pair[0][0], pair[1][1] - pair[0][1])).sum();
    // Points that are close enough together that those on the inside of a corner can be left out: it is cut
    // by a part of a step.
    let step = distance / 10.0;
    if !(distance > 0.0 && 2.0 * length / step <= MAX_POINTS) {
        return Err(AreaError::Narrow { distance, length });
    }
    let mut edge = Vec::new();
    side(line, distance, step, &mut edge);
    let back: Vec<[f64; 2]> = line.iter().rev().copied().collect();
    side(&back, distance, step, &mut edge);
    // Inside of a corner the edges of both of its legs are too near to one of them.
    edge.retain(|point| distance_to(line, *point) > distance * (1.0 - 1e-9));
    Area::of_corridor(without_straight_points(edge, distance * 1e-6))
}

/// The edge to the left of a line, from its first position on, and round its end.
fn side(line: &[[f64; 2]], distance: f64, step: f64, edge: &mut Vec<[f64; 2]>) {
    let heading = |pair: &[[f64; 2]]| libm::atan2(pair[1][1] - pair[0][1], pair[1][0] - pair[0][0]);
    let beside =
        |[x, y]: [f64; 2], angle: f64| [x + distance * libm::cos(angle), y + distance * libm::sin(angle)];
    for (i, pair) in line.windows(2).enumerate() {
        let along = heading(pair);
        let left = along + PI / 2.0;
        let length = libm::hypot(pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]);
        let steps = (length / step).ceil().max(1.0);
        edge.extend((0..=steps as usize).map(|k| {
            let t = k as f64 / steps;
            beside([0, 1].map(|axis| pair[0][axis] + t * (pair[1][axis] - pair[0][axis])), left)
        }));
        // A turn to the right is round on the left; the end is half a circle.
        let turn = match line.get(i + 1..i + 3) {
            Some(next) => (along - heading(next) + PI).rem_euclid(TAU) - PI,
            None => PI,
        };
        let steps = (turn / CORNER_STEP).ceil().max(1.0);
        edge.extend((1..steps as usize).map(|k| beside(pair[1], left - turn * k as f64 / steps)));
    }
}

/// The distance of a point from a line.
fn distance_to(line: &[[f64; 2]], [x, y]: [f64; 2]) -> f64 {
    let of_leg = |pair: &[[f64; 2]]| {
        let way = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
        let off = [x - pair[0][0], y - pair[0][1]];
        let t = ((off[0] * way[0] + off[1] * way[1]) / (way[0] * way[0] + way[1] * way[1])).clamp(0.0, 1.0);
        libm::hypot(off[0] - t * way[0], off[1] - t * way[1])
    };
    line.windows(2).map(of_leg).fold(f64::INFINITY, f64::min)
}

/// Leaves out points that are no farther than `tolerance` from the straight line between their neighbours.
fn without_straight_points(points: Vec<[f64; 2]>, tolerance: f64) -> Vec<[f64; 2]> {
    let mut kept: Vec<[f64; 2]> = Vec::with_capacity(points.len());
    for (i, point) in points.iter().enumerate() {
        match (kept.last(), points.get(i + 1)) {
            (Some(last), Some(next)) if last != next && distance_to(&[*last, *next], *point) <= tolerance => {
            }
            _ => kept.push(*point),
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corridors_hold_what_is_near_their_line() {
        for line in [
            vec![[0.0, 0.0], [500.0, 0.0]],
            vec![[0.0, 0.0], [300.0, 0.0], [300.0, 200.0]],
            vec![
                [5e5, 5.4e6],
                [5e5 + 200.0, 5.4e6 + 10.0],
                [5e5 + 350.0, 5.4e6 - 120.0],
                [5e5 + 600.0, 5.4e6],
            ],
        ] {
            let area = corridor(&line, 40.0).unwrap();
            let (low, high) = area.bounds();
            let (mut inside, mut all) = (0, 0);
            for i in 0..200 {
                for k in 0..200 {
                    let at = |t: i32, from: f64, to: f64| {
                        from - 20.0 + (to - from + 40.0) * (f64::from(t) + 0.5) / 200.0
                    };
                    let place = [at(i, low[0], high[0]), at(k, low[1], high[1])];
                    let off = distance_to(&line, place);
                    all += 1;
                    // Round corners are polygons, and corners inside are cut a little.
                    if !(38.0..=42.0).contains(&off) {
                        assert_eq!(area.contains(place), off < 40.0, "{place:?}: {off}");
                    }
                    inside += usize::from(area.contains(place));
                }
            }
            assert!(inside > all / 20);
        }
        let straight = corridor(&[[0.0, 0.0], [500.0, 0.0]], 40.0).unwrap();
        assert!((straight.square_metres() / (500.0 * 80.0 + PI * 1600.0) - 1.0).abs() < 0.01);
        assert!(straight.corners().len() < 40);
        assert!(corridor(&[[0.0, 0.0], [1e6, 0.0]], 0.1).unwrap_err().to_string().contains("too narrow"));
    }
}
