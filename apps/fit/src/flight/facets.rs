//! First guess of a polygon mirror whose facets differ by their tilt: their lines come in turn, each shifted
//! along the flight.

use super::level::{Track, mean_height, sampled_pulses};
use super::lines::{Crossing, MIN_PULSES, crossing};
use super::mirror::{Mirror, MirrorParameters};
use super::model::{MAX_FACETS, Model};
use super::parameters::Channel;
use super::phases::{PhaseSample, Recurrence, coherence, line_rate, wrapped};
use super::recording::Recording;
use libm::{atan, hypot, sqrt, tan};
use std::f64::consts::TAU;
use vlscan_geom::{LeastSquares, median};

/// Minimum number of lines of each facet.
const MIN_LINES: usize = 3;
/// Maximum residual of the positions of lines by facets, as a share of that by one facet.
const MAX_RESIDUAL: f64 = 0.3;
/// The smallest number of facets is used whose residual is at most this many times the smallest residual.
const AS_GOOD: f64 = 1.5;
/// Multiples of the rate of lines at which their phases agree to this share of the best one's are as good.
const COHERENT: f64 = 0.97;

/// A line: the time at which it points straight down, and its distance ahead of the expected position.
struct Line {
    /// s.
    time: f64,
    /// m.
    ahead: f64,
    /// Reciprocal of the cosine of the angle across the flight: lines of tilted facets are hyperbolas.
    secant: f64,
}

/// Positions of lines by a number of facets.
struct Trial {
    /// Root mean square of the residuals, m.
    residual: f64,
    /// Error of the speed, m/s.
    speed: f64,
    /// How far ahead the lines of each facet lie, m.
    ahead: Vec<f64>,
}

/// The mirror of one channel, `single`, with facets that differ; `None` if its lines do not lie where such
/// facets would draw them.
pub fn guess(recording: &Recording, single: &Model) -> Option<Model> {
    if single.mirror != Mirror::Polygon || single.has_channels() {
        return None;
    }
    let p = &single.parameters;
    let track = Track { start: p.position.truncate(), velocity: p.velocity.truncate() };
    let height = p.position.z - mean_height(recording, &sampled_pulses(recording));
    let (lines, speeds) = lines_of(recording, single, &track, height);
    let Recurrence { rate, phase } = rate_of_facets(&lines.iter().map(|line| line.time).collect::<Vec<_>>())?;
    // The angle is 0 in the middle of a line.
    let phase = wrapped(0.5 * TAU + phase);
    let mirror = MirrorParameters {
        angle: p.mirror.angle.signum() * median(speeds).unwrap_or(0.0) / rate,
        rate,
        ..p.mirror
    };
    let trials: Vec<Trial> =
        (1..=MAX_FACETS).filter_map(|count| trial(&lines, count, &mirror, phase)).collect();
    let alike = trials.first().filter(|trial| trial.ahead.len() == 1)?.residual;
    let least = trials.iter().map(|trial| trial.residual).fold(f64::INFINITY, f64::min);
    let is_good = |trial: &Trial| {
        trial.ahead.len() > 1 && trial.residual <= AS_GOOD * least && trial.residual < MAX_RESIDUAL * alike
    };
    let Trial { speed, ahead, .. } = trials.into_iter().find(is_good)?;
    // The mean of all facets is that of the platform.
    let common = ahead.iter().sum::<f64>() / ahead.len() as f64;
    let mut parameters = p.clone();
    parameters.position = (track.start + common * track.forward()).extend(p.position.z);
    parameters.velocity = (track.velocity + speed * track.forward()).extend(p.velocity.z);
    parameters.mirror = mirror;
    parameters.channels = vec![Channel { phase, ..p.channels[0] }];
    parameters.facet_tilts = ahead.iter().map(|ahead| atan((ahead - common) / height)).collect();
    Some(Model { mirror: Mirror::Polygon, parameters })
}

/// Lines that look straight down, and the speeds of their angles, rad/s. `height` is that of the platform
/// above the points.
fn lines_of(recording: &Recording, single: &Model, track: &Track, height: f64) -> (Vec<Line>, Vec<f64>) {
    let (altitude, yaw) = (single.parameters.position.z, single.parameters.mirror.yaw);
    let (forward, right) = (track.forward(), track.right());
    let long = recording.lines.iter().filter(|line| line.len() >= MIN_PULSES);
    long.filter_map(|range| {
        let Crossing { time, speed } = crossing(recording, range, track, right, altitude)?;
        let middle = recording.pulses.get((range.start + range.end) / 2);
        let offset = track.offset(middle.position, middle.time);
        let (side, down) = (offset.dot(right), altitude - middle.position.z);
        // At the mean height of the points.
        let ahead = (offset.dot(forward) + side * tan(yaw)) * height / down;
        Some((Line { time, ahead, secant: hypot(side, down) / down }, speed.abs()))
    })
    .unzip()
}

/// Fit of the positions of lines by `count` facets; `None` if one of them has too few lines.
fn trial(lines: &[Line], count: usize, mirror: &MirrorParameters, phase: f64) -> Option<Trial> {
    let facet = |line: &Line| mirror.number(phase, line.time).rem_euclid(count as i64) as usize;
    let mut of_facet = vec![0; count];
    lines.iter().for_each(|line| of_facet[facet(line)] += 1);
    if of_facet.iter().any(|lines| *lines < MIN_LINES) {
        return None;
    }
    let mut sums = LeastSquares::new(count + 1);
    for line in lines {
        let mut row = vec![0.0; count + 1];
        row[0] = line.time;
        row[1 + facet(line)] = line.secant;
        sums.add(&row, line.ahead, 1.0);
    }
    let values = sums.solution()?;
    let (speed, ahead) = (values[0], values[1..].to_vec());
    let residual = |line: &Line| line.ahead - speed * line.time - line.secant * ahead[facet(line)];
    let squares: f64 = lines.iter().map(|line| residual(line).powi(2)).sum();
    Some(Trial { residual: sqrt(squares / lines.len() as f64), speed, ahead })
}

/// Rate and phase of lines that look straight down at these times. A small place sees the lines of one facet
/// at a time: then the rate is a multiple of the reciprocal of their intervals.
fn rate_of_facets(times: &[f64]) -> Option<Recurrence> {
    let samples = PhaseSample::zeros(times);
    let trials: Vec<(Recurrence, f64)> = (1..=MAX_FACETS)
        .filter_map(|multiple| {
            let lines = line_rate(times, multiple as f64)?;
            Some((lines, coherence(&samples, lines.rate).size))
        })
        .collect();
    let best = trials.iter().map(|trial| trial.1).fold(0.0, f64::max);
    trials.into_iter().find(|trial| trial.1 >= COHERENT * best).map(|trial| trial.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines at 80 a second, three facets that lie 0, 6 and −3 m ahead, for a platform that is 0.5 m/s faster
    /// than assumed. Some lines are missing.
    fn lines() -> Vec<Line> {
        let number = (0..120).filter(|k| k % 11 != 5);
        number
            .map(|k| {
                let time = (f64::from(k) + 0.5) / 80.0;
                let secant = 1.0 + 0.1 * f64::from(k % 2);
                Line { time, ahead: 0.5 * time + secant * [0.0, 6.0, -3.0][k as usize % 3], secant }
            })
            .collect()
    }

    #[test]
    fn positions_of_lines_tell_facets_and_speed() {
        let times: Vec<f64> = lines().iter().map(|line| line.time).collect();
        let found = rate_of_facets(&times).unwrap();
        assert!((found.rate - 80.0).abs() < 1e-3, "{found:?}");
        let mirror = MirrorParameters { rate: 80.0, ..MirrorParameters::default() };
        let three = trial(&lines(), 3, &mirror, 0.0).unwrap();
        assert!(three.residual < 1e-9 && (three.speed - 0.5).abs() < 1e-9, "{}", three.residual);
        for (found, expected) in three.ahead.iter().zip([0.0, 6.0, -3.0]) {
            assert!((found - expected).abs() < 1e-9, "{found} is not {expected}");
        }
        assert!(trial(&lines(), 1, &mirror, 0.0).unwrap().residual > 3.0);
        assert!(trial(&lines(), 2, &mirror, 0.0).unwrap().residual > 3.0);
        assert!(trial(&lines()[..5], 3, &mirror, 0.0).is_none());
    }
}
