//! Flight lines, and the turns between them.

use std::f64::consts::{PI, TAU};

/// Largest angle between the waypoints of a turn, rad.
const MAX_TURN_STEP: f64 = PI / 12.0;

/// A line from one position to another, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line {
    pub from: [f64; 2],
    pub to: [f64; 2],
}

impl Line {
    pub fn length(&self) -> f64 {
        libm::hypot(self.to[0] - self.from[0], self.to[1] - self.from[1])
    }

    pub fn at(&self, fraction: f64) -> [f64; 2] {
        [0, 1].map(|i| self.from[i] + fraction * (self.to[i] - self.from[i]))
    }

    pub fn direction(&self) -> [f64; 2] {
        let length = self.length();
        [0, 1].map(|i| (self.to[i] - self.from[i]) / length)
    }

    /// Moves the line ahead, m.
    pub fn shift(&mut self, distance: f64) {
        let ahead = self.direction().map(|d| d * distance);
        let moved = |p: [f64; 2]| [0, 1].map(|i| p[i] + ahead[i]);
        (self.from, self.to) = (moved(self.from), moved(self.to));
    }
}

/// Waypoints of a turn from the end of one line to the beginning of the next, at most [`MAX_TURN_STEP`]
/// apart: the shortest path of arcs of one radius and straight pieces between two positions with directions
/// (Dubins 1957).
pub(super) fn turn(line: &Line, next: &Line, radius: f64) -> Vec<[f64; 2]> {
    let heading = |d: [f64; 2]| libm::atan2(d[1], d[0]);
    let (from, to) = (heading(line.direction()), heading(next.direction()));
    let (dx, dy) = (next.from[0] - line.to[0], next.from[1] - line.to[1]);
    let distance = libm::hypot(dx, dy) / radius;
    let bearing = libm::atan2(dy, dx);
    let Some(path) =
        shortest_turn(distance, (from - bearing).rem_euclid(TAU), (to - bearing).rem_euclid(TAU))
    else {
        return Vec::new();
    };
    let (mut at, mut angle, mut points) = (line.to, from, Vec::new());
    // Two half turns may have no way between them.
    for (sense, amount) in path.into_iter().filter(|(_, amount)| *amount > 1e-9) {
        let steps = if sense == 0.0 { 1.0 } else { (amount / MAX_TURN_STEP).ceil() };
        let step = amount / steps.max(1.0);
        for _ in 0..steps as usize {
            let chord = match sense == 0.0 {
                true => step,
                false => 2.0 * libm::sin(step / 2.0),
            };
            let way = angle + sense * step / 2.0;
            at = [at[0] + radius * chord * libm::cos(way), at[1] + radius * chord * libm::sin(way)];
            angle += sense * step;
            points.push(at);
        }
    }
    // The last one is the beginning of the next line.
    points.pop();
    points
}

/// The shortest of the six Dubins paths for unit radius: three pieces, each with its sense (1 left, −1 right,
/// 0 straight) and its length. `a` and `b` are the headings at beginning and end relative to the way of
/// length `d` between them, rad.
fn shortest_turn(d: f64, a: f64, b: f64) -> Option<[(f64, f64); 3]> {
    use libm::{acos, atan2, cos, sin, sqrt};
    let (sa, ca, sb, cb, cab) = (sin(a), cos(a), sin(b), cos(b), cos(a - b));
    let turns = |v: f64| v.rem_euclid(TAU);
    let mut paths: Vec<[(f64, f64); 3]> = Vec::with_capacity(6);
    let p = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb);
    if p >= 0.0 {
        let t = atan2(cb - ca, d + sa - sb);
        paths.push([(1.0, turns(t - a)), (0.0, sqrt(p)), (1.0, turns(b - t))]);
    }
    let p = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sb - sa);
    if p >= 0.0 {
        let t = atan2(ca - cb, d - sa + sb);
        paths.push([(-1.0, turns(a - t)), (0.0, sqrt(p)), (-1.0, turns(t - b))]);
    }
    let p = -2.0 + d * d + 2.0 * cab + 2.0 * d * (sa + sb);
    if p >= 0.0 {
        let p = sqrt(p);
        let t = atan2(-ca - cb, d + sa + sb) - atan2(-2.0, p);
        paths.push([(1.0, turns(t - a)), (0.0, p), (-1.0, turns(t - b))]);
    }
    let p = -2.0 + d * d + 2.0 * cab - 2.0 * d * (sa + sb);
    if p >= 0.0 {
        let p = sqrt(p);
        let t = atan2(ca + cb, d - sa - sb) - atan2(2.0, p);
        paths.push([(-1.0, turns(a - t)), (0.0, p), (1.0, turns(b - t))]);
    }
    let c = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sa - sb)) / 8.0;
    if c.abs() <= 1.0 {
        let p = turns(TAU - acos(c));
        let t = turns(a - atan2(ca - cb, d - sa + sb) + p / 2.0);
        paths.push([(-1.0, t), (1.0, p), (-1.0, turns(a - b - t + p))]);
    }
    let c = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sb - sa)) / 8.0;
    if c.abs() <= 1.0 {
        let p = turns(TAU - acos(c));
        let t = turns(-a + atan2(-ca + cb, d + sa - sb) + p / 2.0);
        paths.push([(1.0, t), (-1.0, p), (1.0, turns(turns(b) - a - t + p))]);
    }
    let length = |path: &[(f64, f64); 3]| path.iter().map(|(_, l)| l).sum::<f64>();
    paths.into_iter().min_by(|a, b| length(a).total_cmp(&length(b)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_arcs_that_end_where_the_next_line_begins() {
        let line = Line { from: [0.0, 0.0], to: [1000.0, 0.0] };
        for spacing in [50.0, 200.0, 399.0, 400.0, 900.0] {
            let next = Line { from: [1000.0, spacing], to: [0.0, spacing] };
            let points = turn(&line, &next, 200.0);
            let mut way = vec![line.to];
            way.extend(&points);
            way.push(next.from);
            // A half circle, or a longer turn where the lines are closer together than its diameter.
            let length: f64 = way.windows(2).map(|p| libm::hypot(p[1][0] - p[0][0], p[1][1] - p[0][1])).sum();
            let least = if spacing >= 400.0 { PI * 200.0 + spacing - 400.0 } else { PI * 200.0 };
            assert!(length > 0.98 * least && length < 1700.0, "{spacing}: {length}");
            // No corner is sharper than the step.
            for corner in way.windows(3) {
                let heading = |a: [f64; 2], b: [f64; 2]| libm::atan2(b[1] - a[1], b[0] - a[0]);
                let change =
                    (heading(corner[1], corner[2]) - heading(corner[0], corner[1]) + PI).rem_euclid(TAU) - PI;
                assert!(change.abs() < MAX_TURN_STEP * 1.1, "{spacing}: {change} at {corner:?}");
            }
        }
    }
}
