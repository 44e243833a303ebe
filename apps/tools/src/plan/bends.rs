//! Lines with rounded bends, and lines at a distance beside them.

use std::f64::consts::{PI, TAU};

/// Largest angle between the pieces of a bend, rad.
const MAX_STEP: f64 = PI / 60.0;
/// Angle below which a line counts as straight, rad.
const MIN_BEND: f64 = 1e-4;

/// A bend that is too sharp for its line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SharpBend {
    /// The corner, m.
    pub place: [f64; 2],
    /// The largest radius that fits between the neighbouring corners, m.
    pub radius: f64,
}

/// A line whose corners are arcs.
#[derive(Clone, Debug)]
pub struct Course {
    points: Vec<[f64; 2]>,
    /// Length of the course up to each point, m.
    lengths: Vec<f64>,
    /// Largest distance of a corner from its arc, m.
    pub departure: f64,
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(b[0] - a[0], b[1] - a[1])
}

fn direction(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    let length = distance(a, b);
    [0, 1].map(|axis| (b[axis] - a[axis]) / length)
}

fn moved(from: [f64; 2], way: [f64; 2], length: f64) -> [f64; 2] {
    [0, 1].map(|axis| from[axis] + length * way[axis])
}

/// Unit vector to the left of a direction.
fn left([x, y]: [f64; 2]) -> [f64; 2] {
    [-y, x]
}

impl Course {
    /// Rounds the corners of a line of at least two different positions with `radius` m, or less where they
    /// are near each other, but at least `min_radius` m.
    pub fn new(line: &[[f64; 2]], radius: f64, min_radius: f64) -> Result<Course, SharpBend> {
        let mut points = vec![line[0]];
        let mut departure = 0.0;
        for corner in line.windows(3) {
            let [from, at, to] = [corner[0], corner[1], corner[2]];
            let (before, behind) = (direction(from, at), direction(at, to));
            let heading = libm::atan2(before[1], before[0]);
            let turn = (libm::atan2(behind[1], behind[0]) - heading + PI).rem_euclid(TAU) - PI;
            if turn.abs() < MIN_BEND {
                points.push(at);
                continue;
            }
            let slope = libm::tan(turn.abs() / 2.0);
            let room = 0.5 * distance(from, at).min(distance(at, to));
            let fitting = radius.min(room / slope);
            // Also false for NaN.
            if !(fitting >= min_radius && fitting > 0.0) {
                return Err(SharpBend { place: at, radius: room / slope });
            }
            departure = f64::max(departure, fitting * (1.0 / libm::cos(turn / 2.0) - 1.0));
            let first = moved(at, before, -fitting * slope);
            let centre = moved(first, left(before), turn.signum() * fitting);
            let steps = (turn.abs() / MAX_STEP).ceil().max(1.0);
            points.extend((0..=steps as u32).map(|k| {
                let (s, c) = libm::sincos(heading + turn * f64::from(k) / steps);
                moved(centre, left([c, s]), -turn.signum() * fitting)
            }));
        }
        points.extend(line.last());
        points.dedup_by(|a, b| distance(*a, *b) < 1e-6);
        let mut lengths = vec![0.0];
        for pair in points.windows(2) {
            lengths.push(lengths[lengths.len() - 1] + distance(pair[0], pair[1]));
        }
        Ok(Course { points, lengths, departure })
    }

    /// Length of the course, m.
    pub fn length(&self) -> f64 {
        self.lengths.last().copied().unwrap_or(0.0)
    }

    /// The line between two places, each given by its distance along the course, which goes on straight
    /// beyond its ends, and to the left of it, m; both have the same distance to the left.
    pub fn parallel(&self, from: [f64; 2], to: [f64; 2]) -> Vec<[f64; 2]> {
        let last = self.points.len() - 1;
        if last == 0 {
            return vec![from, to];
        }
        let way = |piece: usize| direction(self.points[piece], self.points[piece + 1]);
        let end = |[along, off]: [f64; 2]| {
            let piece = self.lengths.partition_point(|length| *length <= along).clamp(1, last) - 1;
            let place = moved(self.points[piece], way(piece), along - self.lengths[piece]);
            moved(place, left(way(piece)), off)
        };
        let (low, high) = (from[0].min(to[0]), from[0].max(to[0]));
        let inner = (1..last).filter(|i| (low..high).contains(&self.lengths[*i]));
        let mut between: Vec<[f64; 2]> = inner
            .map(|i| {
                // Where pieces meet, lines beside them do so, too.
                let [a, b] = [left(way(i - 1)), left(way(i))];
                let scale = 1.0 + a[0] * b[0] + a[1] * b[1];
                moved(self.points[i], [a[0] + b[0], a[1] + b[1]], from[1] / scale)
            })
            .collect();
        if from[0] > to[0] {
            between.reverse();
        }
        let mut all = vec![end(from)];
        all.append(&mut between);
        all.push(end(to));
        all.dedup_by(|a, b| distance(*a, *b) < 1e-6);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn length(line: &[[f64; 2]]) -> f64 {
        line.windows(2).map(|pair| distance(pair[0], pair[1])).sum()
    }

    #[test]
    fn bends_are_arcs() {
        // East, then north.
        let line = [[0.0, 0.0], [1000.0, 0.0], [1000.0, 800.0]];
        let course = Course::new(&line, 200.0, 50.0).unwrap();
        // 800 m, a quarter of a circle of 200 m, and 600 m; chords are a little shorter.
        assert!((course.length() - (1400.0 + 100.0 * PI)).abs() < 0.1, "{}", course.length());
        assert!((course.departure - 200.0 * (2f64.sqrt() - 1.0)).abs() < 1e-9);
        for (off, radius) in [(50.0, 150.0), (-50.0, 250.0), (0.0, 200.0)] {
            let found = course.parallel([-100.0, off], [course.length() + 100.0, off]);
            let expected = 1600.0 + 0.5 * PI * radius;
            assert!((length(&found) - expected).abs() < 0.2, "{off}: {}", length(&found));
            assert!(distance(found[0], [-100.0, off]) < 1e-9, "{found:?}");
            assert!(distance(found[found.len() - 1], [1000.0 - off, 900.0]) < 1e-9, "{found:?}");
            // Pieces of the bend are at their radius, and turn little.
            let bend = found.iter().filter(|[x, y]| *x > 801.0 && *y < 199.0 && *y > off + 1e-3);
            assert!(bend.clone().count() > 10);
            for place in bend {
                assert!((distance(*place, [800.0, 200.0]) - radius).abs() < 0.1, "{off}: {place:?}");
            }
            let mut back = course.parallel([course.length() + 100.0, off], [-100.0, off]);
            back.reverse();
            assert_eq!(back, found);
        }
    }

    #[test]
    fn bends_without_room_are_refused() {
        let line = [[0.0, 0.0], [100.0, 0.0], [100.0, 60.0], [200.0, 60.0]];
        // 30 m on either side of the corners.
        assert!(
            (Course::new(&line, 500.0, 10.0).unwrap().departure - 30.0 * (2f64.sqrt() - 1.0)).abs() < 1e-9
        );
        let refused = Course::new(&line, 500.0, 40.0).unwrap_err();
        assert!(refused.place == [100.0, 0.0] && (refused.radius - 30.0).abs() < 1e-9, "{refused:?}");
        // A line that turns back.
        assert!(Course::new(&[[0.0, 0.0], [100.0, 0.0], [0.0, 0.0]], 50.0, 10.0).is_err());
    }

    #[test]
    fn straight_lines_stay_as_they_are() {
        let course = Course::new(&[[5.0, 5.0], [5.0, 55.0], [5.0, 105.0]], 50.0, 10.0).unwrap();
        assert_eq!((course.length(), course.departure), (100.0, 0.0));
        // To the left of a line to the north is the west.
        let found = course.parallel([-10.0, 20.0], [30.0, 20.0]);
        assert_eq!(found, [[-15.0, -5.0], [-15.0, 35.0]]);
    }
}
