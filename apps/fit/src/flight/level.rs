//! Straight flights, and the height of their platform by scan angles or by returns.

use super::phases::StraightLine;
use super::pulses::{Pulse, Pulses};
use super::recording::Recording;
use super::solution::MIN_DEPTH;
use libm::tan;
use std::ops::Range;
use vlscan_geom::{DVec2, DVec3};

/// Maximum number of pulses used for a guess.
const GUESS_PULSES: usize = 6000;
/// Minimum number of pulses of a line used for a guess.
const MIN_LINE_PULSES: usize = 8;
/// Minimum number of pulses with several returns whose beams replace rounded scan angles.
const MIN_DEEP_PULSES: usize = 200;
/// Heights of a platform above the points, m.
const MIN_HEIGHT: f64 = 1.0;
const MAX_HEIGHT: f64 = 1e5;

/// Straight horizontal flight with constant velocity.
#[derive(Clone, Copy, Debug)]
pub struct Track {
    /// Position at time 0, m.
    pub start: DVec2,
    /// m/s.
    pub velocity: DVec2,
}

impl Track {
    /// Unit vector in the direction of the flight.
    pub fn forward(&self) -> DVec2 {
        self.velocity.normalize_or(DVec2::Y)
    }

    /// Unit vector to the right of the flight.
    pub fn right(&self) -> DVec2 {
        right_of(self.forward())
    }

    /// Horizontal position of a point relative to the platform at `time`, m.
    pub fn offset(&self, point: DVec3, time: f64) -> DVec2 {
        point.truncate() - self.start - time * self.velocity
    }
}

/// Vector turned by a right angle to the right, as seen from above.
pub fn right_of(vector: DVec2) -> DVec2 {
    DVec2::new(vector.y, -vector.x)
}

/// Height of the platform, and the position across the track where the beam looks straight down.
#[derive(Clone, Copy, Debug)]
pub struct Level {
    /// m.
    pub height: f64,
    /// Position to the right of the track, m.
    pub across: f64,
}

/// Indices of some pulses, evenly chosen from lines of some length.
pub fn sampled_pulses(recording: &Recording) -> Vec<usize> {
    let long = || recording.lines.iter().filter(|line| line.len() >= MIN_LINE_PULSES);
    let count: usize = long().map(|line| line.len()).sum();
    long().flat_map(|line| line.clone()).step_by(count.div_ceil(GUESS_PULSES).max(1)).collect()
}

/// Straight lines of x and y, m, over the time after its first pulse, s, that a line of pulses draws on the
/// ground.
pub fn line_on_ground(pulses: &Pulses, line: &Range<usize>) -> [StraightLine; 2] {
    let first = pulses.time(line.start);
    let along = |coordinate: fn(DVec3) -> f64| {
        let point = |i: usize| (pulses.time(i) - first, coordinate(pulses.position(i)));
        StraightLine::through_points(line.clone().map(point))
    };
    [along(|position| position.x), along(|position| position.y)]
}

/// Mean height of the points of these pulses, m.
pub fn mean_height(recording: &Recording, sampled: &[usize]) -> f64 {
    sampled.iter().map(|i| recording.pulses.position(*i).z).sum::<f64>() / sampled.len().max(1) as f64
}

/// Height of a platform on `track`. `None` where the angles do not change across the track.
///
/// Angles that are rounded to degrees hardly change within a small tile. There the directions of beams follow
/// from pulses of several returns, if there are many.
pub fn level(recording: &Recording, sampled: &[usize], track: &Track) -> Option<Level> {
    let mean = mean_height(recording, sampled);
    let right = track.right();
    let across = |pulse: &Pulse, point: DVec3| track.offset(point, pulse.time).dot(right);
    let (mut places, mut tangents) = (Vec::new(), Vec::new());
    if recording.has_whole_angles() {
        for pulse in recording.pulses.iter() {
            let Some(last) = pulse.last else { continue };
            let down = pulse.position.z - last.z;
            if down > MIN_DEPTH {
                let (first, last) = (across(&pulse, pulse.position), across(&pulse, last));
                places.push(first + (last - first) * (pulse.position.z - mean) / down);
                tangents.push((last - first) / down);
            }
        }
    }
    if places.len() < MIN_DEEP_PULSES {
        let pulses = sampled.iter().map(|i| recording.pulses.get(*i));
        (places, tangents) = pulses.map(|pulse| (across(&pulse, pulse.position), tan(pulse.angle))).unzip();
    }
    let tangent = StraightLine::through(&places, &tangents);
    let height = 1.0 / tangent.slope;
    // Also false for NaN.
    (height > MIN_HEIGHT && height < MAX_HEIGHT)
        .then(|| Level { height: mean + height, across: -tangent.start * height })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_height_follows_from_angles_across_the_track() {
        let track = Track { start: DVec2::new(3.0, 4.0), velocity: DVec2::new(30.0, 40.0) };
        assert_eq!((track.forward(), track.right()), (DVec2::new(0.6, 0.8), DVec2::new(0.8, -0.6)));
        // 800 m above points at the height 5 m; the beam looks straight down 7 m to the right of the track.
        let pulse = |k: usize| {
            let time = 1e-4 * k as f64;
            let side = (k % 100) as f64 - 50.0;
            let place = track.start + time * track.velocity + side * track.right();
            Pulse {
                time,
                position: place.extend(5.0),
                angle: libm::atan((side - 7.0) / 800.0),
                returns: 1,
                class: 2,
                last: None,
                file_channel: 0,
                channel: 0,
            }
        };
        let mut recording = Recording::new((0..2000).map(pulse).collect()).unwrap();
        let sampled = sampled_pulses(&recording);
        assert_eq!(sampled.len(), 2000);
        let found = level(&recording, &sampled, &track).unwrap();
        assert!((found.height - 805.0).abs() < 1e-6 && (found.across - 7.0).abs() < 1e-6, "{found:?}");
        recording.pulses = recording.pulses.iter().map(|pulse| Pulse { angle: 0.1, ..pulse }).collect();
        assert!(level(&recording, &sampled, &track).is_none());
    }
}
