//! Straight parts of a flight line with turns, by the track of the platform.
//!
//! The place below the platform is that at which the scan angle is 0 on a line through the points of a
//! second, whatever part of the swath has points. Its course changes in a turn.

use libm::{atan2, tan};
use std::ops::Range;
use vlscan_geom::{DVec2, median, radians};

/// Number of points of which one counts for the track.
const ONE_OF: usize = 8;
/// Maximum scan angle of these points, degrees.
const MAX_ANGLE: f64 = 60.0;
/// Minimum variance of the tangents of their angles.
const MIN_VARIANCE: f64 = 1e-4;
/// Minimum number of points of a part whose place is known, as a share of that of the median part.
const MIN_SHARE: f64 = 0.1;
/// Parts on either side of a part that give its velocity.
const REACH: usize = 2;
/// Minimum number of these parts whose places are known.
const MIN_PLACES: usize = 3;
/// Maximum deviation of the course from the mean of a straight part, and at its ends, degrees.
const MAX_BEND: f64 = 15.0;
const MAX_END_BEND: f64 = 5.0;
/// Minimum length of a straight flight, in parts.
const MIN_PARTS: usize = 5;
/// Minimum deviation of courses from the longest straight flight that shows a turn, degrees, minimum number
/// of successive parts with it, and their minimum speed over that of the straight flight.
const MIN_TURN: f64 = 45.0;
const MIN_TURN_PARTS: usize = 3;
const MIN_TURN_SPEED: f64 = 0.3;

/// The points of a short part of a flight line.
#[derive(Clone, Debug)]
pub(super) struct Part {
    /// Times of its first and its last point, s.
    pub times: [f64; 2],
    /// Number of its points.
    pub points: usize,
    /// Position of its first point, m, to which positions are relative.
    origin: DVec2,
    /// Number of the points that count for the track.
    count: f64,
    /// Sums of the tangents of their scan angles, and of their squares.
    tangents: [f64; 2],
    /// Sums of their positions, and of their positions times tangents, m.
    positions: [DVec2; 2],
}

impl Part {
    /// A part that begins at the time and position of a point.
    pub fn at(time: f64, position: DVec2) -> Part {
        Part {
            times: [time; 2],
            points: 0,
            origin: position,
            count: 0.0,
            tangents: [0.0; 2],
            positions: [DVec2::ZERO; 2],
        }
    }

    /// Adds a point with its scan angle, degrees.
    pub fn add(&mut self, time: f64, position: DVec2, angle: f64) {
        self.times = [self.times[0].min(time), self.times[1].max(time)];
        if self.points.is_multiple_of(ONE_OF) && angle.abs() <= MAX_ANGLE {
            let (tangent, offset) = (tan(radians(angle)), position - self.origin);
            let [tangents, squares] = self.tangents;
            self.tangents = [tangents + tangent, squares + tangent * tangent];
            let [positions, products] = self.positions;
            self.positions = [positions + offset, products + tangent * offset];
            self.count += 1.0;
        }
        self.points += 1;
    }

    /// Middle of its times, s.
    fn time(&self) -> f64 {
        0.5 * (self.times[0] + self.times[1])
    }

    /// Place at the scan angle 0, m; `None` where the angles hardly change.
    fn nadir(&self) -> Option<DVec2> {
        let [tangent, square] = self.tangents.map(|sum| sum / self.count);
        let [position, product] = self.positions.map(|sum| sum / self.count);
        let variance = square - tangent * tangent;
        // False for NaN.
        (variance >= MIN_VARIANCE)
            .then(|| self.origin + position - (tangent / variance) * (product - tangent * position))
    }
}

/// The straight flights of a flight line with turns, as ranges of its parts, which are in the order of time;
/// `None` for a line without a turn.
pub(super) fn straight_flights(parts: &[Part]) -> Option<Vec<Range<usize>>> {
    let velocities = velocities(parts);
    let flights = flights(&velocities);
    let points = |flight: &&Range<usize>| -> usize {
        parts.iter().take(flight.end).skip(flight.start).map(|part| part.points).sum()
    };
    let longest = flights.iter().max_by_key(points)?;
    has_turn(&velocities, mean(&velocities, longest)).then_some(flights)
}

/// Velocities of the platform in each part, m/s; `None` where too few places are known.
fn velocities(parts: &[Part]) -> Vec<Option<DVec2>> {
    let few = MIN_SHARE * median(parts.iter().map(|part| part.count)).unwrap_or(0.0);
    let place = |part: &Part| Some((part.time(), part.nadir().filter(|_| part.count >= few)?));
    let places: Vec<Option<(f64, DVec2)>> = parts.iter().map(place).collect();
    let velocity = |k: usize| {
        let around = places.iter().take(k + REACH + 1).skip(k.saturating_sub(REACH));
        let around: Vec<(f64, DVec2)> = around.flatten().copied().collect();
        if around.len() < MIN_PLACES {
            return None;
        }
        // The median slope (Theil and Sen) ignores a single place that is wrong.
        let pairs = around.iter().enumerate().flat_map(|(k, b)| around.iter().take(k).map(move |a| (a, b)));
        let slopes: Vec<DVec2> = pairs.map(|(a, b)| (b.1 - a.1) / (b.0 - a.0)).collect();
        Some(DVec2::new(median(slopes.iter().map(|s| s.x))?, median(slopes.iter().map(|s| s.y))?))
    };
    (0..parts.len()).map(velocity).collect()
}

/// Angle between two vectors, degrees, 0 to 180.
fn angle(a: DVec2, b: DVec2) -> f64 {
    atan2(a.perp_dot(b), a.dot(b)).to_degrees().abs()
}

/// Mean of the known velocities of a range, m/s.
fn mean(velocities: &[Option<DVec2>], range: &Range<usize>) -> DVec2 {
    let known = velocities.iter().take(range.end).skip(range.start).flatten();
    let (sum, count) = known.fold((DVec2::ZERO, 0.0), |(sum, count), v| (sum + *v, count + 1.0));
    sum / f64::max(count, 1.0)
}

/// Runs of parts whose courses are alike.
fn flights(velocities: &[Option<DVec2>]) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let (mut start, mut sum) = (0, DVec2::ZERO);
    for (k, velocity) in velocities.iter().enumerate() {
        let Some(direction) = velocity.and_then(DVec2::try_normalize) else { continue };
        if angle(direction, sum) > MAX_BEND {
            found.extend(trimmed(velocities, start..k));
            (start, sum) = (k, DVec2::ZERO);
        }
        sum += direction;
    }
    found.extend(trimmed(velocities, start..velocities.len()));
    found
}

/// A run of parts without the beginning and the end of turns; `None` if it is short.
fn trimmed(velocities: &[Option<DVec2>], run: Range<usize>) -> Option<Range<usize>> {
    let course = mean(velocities, &run);
    let is_straight =
        |k: &usize| velocities[*k].is_some_and(|velocity| angle(velocity, course) <= MAX_END_BEND);
    let (first, last) = (run.clone().find(is_straight)?, run.clone().rfind(is_straight)?);
    // A part at a turn may hold the beginning of it.
    let start = if first > 0 { first + 1 } else { 0 };
    let end = if last + 1 < velocities.len() { last } else { last + 1 };
    (end >= start + MIN_PARTS).then_some(start..end)
}

/// True if the platform flies in other directions than `along` for some time.
fn has_turn(velocities: &[Option<DVec2>], along: DVec2) -> bool {
    let mut successive = 0;
    velocities.iter().flatten().any(|velocity| {
        let is_other =
            angle(*velocity, along) > MIN_TURN && velocity.length() >= MIN_TURN_SPEED * along.length();
        successive = if is_other { successive + 1 } else { 0 };
        successive >= MIN_TURN_PARTS
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use libm::{cos, sin};
    use std::f64::consts::PI;

    /// Parts of a second of 400 points of a scanner 100 m above a platform's `track`: its place, m, and its
    /// course, rad from north. Points lie between two scan angles, degrees.
    fn flown(seconds: usize, track: impl Fn(f64) -> (DVec2, f64), within: [f64; 2]) -> Vec<Part> {
        let part = |second: usize| {
            let mut part = None;
            for k in 0..400 {
                let time = second as f64 + f64::from(k) / 400.0;
                let (place, course) = track(time);
                let angle = within[0] + (within[1] - within[0]) * f64::from(k * 37 % 400) / 400.0;
                let across = 100.0 * tan(radians(angle));
                let position = place + across * DVec2::new(cos(course), -sin(course));
                part.get_or_insert_with(|| Part::at(time, position)).add(time, position, angle);
            }
            part.unwrap()
        };
        (0..seconds).map(part).collect()
    }

    /// Lines of 20 s at 15 m/s to the north and back, with turns of 6 s between them.
    fn lawnmower(time: f64) -> (DVec2, f64) {
        const RADIUS: f64 = 90.0 / PI;
        let (line, within) = ((time / 26.0).floor(), time % 26.0);
        let (is_back, x) = (line % 2.0 == 1.0, 2.0 * RADIUS * line);
        let turned = PI * ((within - 20.0) / 6.0).max(0.0);
        let along = 15.0 * within.min(20.0) + RADIUS * sin(turned);
        let place = DVec2::new(x + RADIUS * (1.0 - cos(turned)), if is_back { 300.0 - along } else { along });
        (place, if is_back { PI - turned } else { turned })
    }

    #[test]
    fn lines_between_turns_are_straight_flights() {
        // The swath on one side has the same track.
        for within in [[-30.0, 30.0], [5.0, 50.0]] {
            let parts = flown(72, lawnmower, within);
            let found = straight_flights(&parts).unwrap();
            assert_eq!(found.len(), 3, "{found:?}");
            for (flight, begin) in found.iter().zip([0, 26, 52]) {
                assert!(flight.start >= begin && flight.end <= begin + 20, "{found:?}");
                assert!(flight.len() >= 15, "{found:?}");
            }
        }
    }

    #[test]
    fn lines_without_turns_are_whole() {
        let straight = |time: f64| (DVec2::new(3.0, 5.0 * time), 0.0);
        assert_eq!(straight_flights(&flown(40, straight, [-30.0, 30.0])), None);
        // A curve of 40 degrees.
        let curve = |time: f64| {
            let turned = radians(time);
            (900.0 * DVec2::new(1.0 - cos(turned), sin(turned)), turned)
        };
        assert_eq!(straight_flights(&flown(40, curve, [-30.0, 30.0])), None);
        // A place that is wrong, such as one of few points beside a lake.
        let mut lake = flown(40, straight, [-30.0, 30.0]);
        lake[20].positions[0] += DVec2::splat(1e5);
        assert_eq!(straight_flights(&lake), None);
        // Too short, and without places.
        assert_eq!(straight_flights(&flown(3, lawnmower, [-30.0, 30.0])), None);
        assert_eq!(straight_flights(&flown(72, lawnmower, [0.0, 0.0])), None);
        assert_eq!(straight_flights(&[]), None);
    }

    #[test]
    fn a_scanner_that_turns_on_the_spot_has_no_straight_flight() {
        let spot = |time: f64| (DVec2::new(0.1 * sin(7.0 * time), 0.1 * cos(5.0 * time)), 0.3 * time);
        assert_eq!(straight_flights(&flown(40, spot, [-30.0, 30.0])), None);
    }
}
