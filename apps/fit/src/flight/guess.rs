//! First guesses of a flight and its mirror.

use super::lines;
use super::mirror::Mirror;
use super::model::{MAX_PARAMETERS, Model, PLATFORM_PARAMETERS};
use super::recording::{Pulse, Recording, median};
use super::solution::MIN_DEPTH;
use libm::{atan2, cos, hypot, sin, sqrt, tan};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;
use vlscan_geom::DVec3;

/// Pulses that are used for a guess.
const GUESS_PULSES: usize = 6000;
/// Rates are sought by the coherence of phases over at most this many seconds.
const COHERENT: f64 = 4.0;
const MIN_DEEP_PULSES: usize = 200;

/// Guesses that the pulses suggest.
pub fn guesses(recording: &Recording) -> Vec<Model> {
    let cones = [circle(recording), arcs(recording, 1.0), arcs(recording, -1.0)];
    let circles = cones.into_iter().flatten().filter_map(|circle| cone(recording, &circle));
    let mut lines = vec![(Mirror::Polygon, 1), (Mirror::Oscillating, 1)];
    if recording.channels > 1 {
        lines.push((Mirror::Polygon, recording.channels));
    }
    let lines = lines.into_iter().filter_map(|(mirror, channels)| lines::guess(recording, mirror, channels));
    circles.chain(lines).collect()
}

/// Guesses of elliptic cones, which are tried where nothing else meets the points: from circles, by the ratio
/// of their angles.
pub fn elliptic_guesses(recording: &Recording) -> Vec<Model> {
    const RATIOS: [f64; 4] = [0.6, 0.8, 1.25, 1.7];
    let cones = [circle(recording), arcs(recording, 1.0), arcs(recording, -1.0)];
    let cones = cones.into_iter().flatten().filter_map(|circle| cone(recording, &circle));
    let of_ratio = |cone: &Model, ratio: f64, is_along: bool| {
        let mut model = Model { mirror: Mirror::EllipticCone, ..cone.clone() };
        let p = &mut model.parameters[PLATFORM_PARAMETERS..];
        let other = libm::atan(tan(p[0]) * ratio);
        (p[0], p[3], p[4]) = if is_along { (p[0], 0.0, other) } else { (other, 0.0, p[0]) };
        model
    };
    cones
        .flat_map(|cone| RATIOS.map(|ratio| [true, false].map(|is_along| of_ratio(&cone, ratio, is_along))))
        .flatten()
        .collect()
}

/// A circle on the ground whose centre moves.
struct Circle {
    /// Centre at time 0, m.
    centre: (f64, f64),
    /// m/s.
    velocity: (f64, f64),
    /// m.
    radius: f64,
    /// Turns per second, clockwise as seen from above, nearly.
    rate: f64,
}

/// Some pulses, evenly chosen from lines of some length.
pub fn chosen(recording: &Recording) -> Vec<usize> {
    let all: Vec<usize> =
        recording.lines.iter().filter(|line| line.len() >= 8).flat_map(|line| line.clone()).collect();
    let step = all.len().div_ceil(GUESS_PULSES).max(1);
    all.into_iter().step_by(step).collect()
}

/// Least squares; `None` if the columns depend on each other.
pub fn least_squares(rows: &[Vec<f64>], right: &[f64]) -> Option<Vec<f64>> {
    let count = rows.first()?.len();
    let scale: Vec<f64> =
        (0..count).map(|k| sqrt(rows.iter().map(|row| row[k] * row[k]).sum::<f64>()).max(1e-300)).collect();
    let a = DMatrix::from_fn(rows.len(), count, |i, k| rows[i][k] / scale[k]);
    let b = DVector::from_column_slice(right);
    let solution = (a.transpose() * &a).cholesky()?.solve(&(a.transpose() * b));
    let values: Vec<f64> = solution.iter().zip(&scale).map(|(value, scale)| value / scale).collect();
    values.iter().all(|value| value.is_finite()).then_some(values)
}

/// The circle through all pulses: |X − c − v·t|² = R² is linear in c, v and products of them.
fn circle(recording: &Recording) -> Option<Circle> {
    let (mut rows, mut right) = (Vec::new(), Vec::new());
    for i in chosen(recording) {
        let pulse = &recording.pulses[i];
        let (x, y, t) = (pulse.position.x, pulse.position.y, pulse.time);
        rows.push(vec![2.0 * x, 2.0 * y, 2.0 * x * t, 2.0 * y * t, 1.0, t, t * t]);
        right.push(x * x + y * y);
    }
    let fit = least_squares(&rows, &right)?;
    let radius_squared = fit[4] + fit[0] * fit[0] + fit[1] * fit[1];
    if radius_squared <= 0.0 {
        return None;
    }
    let mut circle = Circle {
        centre: (fit[0], fit[1]),
        velocity: (fit[2], fit[3]),
        radius: sqrt(radius_squared),
        rate: 0.0,
    };
    let mut rates = Vec::new();
    for line in recording.lines.iter().filter(|line| line.len() >= 30) {
        let times: Vec<f64> = line.clone().map(|i| recording.pulses[i].time).collect();
        let mut phases: Vec<f64> = line.clone().map(|i| circle.phase(&recording.pulses[i])).collect();
        unwrap(&mut phases);
        rates.push(slope(&times, &phases).0 / TAU);
    }
    circle.rate = median(rates);
    (circle.rate != 0.0).then_some(circle)
}

/// The circle whose arcs are lines that come once in a revolution: its radius follows from their speed on the
/// ground, its centre lies at right angles to them, on the right for `sense` 1 and on the left for −1.
fn arcs(recording: &Recording, sense: f64) -> Option<Circle> {
    let mut lines = Vec::new();
    for line in recording.lines.iter().filter(|line| line.len() >= 20) {
        let pulses = &recording.pulses[line.clone()];
        let times: Vec<f64> = pulses.iter().map(|pulse| pulse.time - pulses[0].time).collect();
        let (vx, x) = slope(&times, &pulses.iter().map(|pulse| pulse.position.x).collect::<Vec<_>>());
        let (vy, y) = slope(&times, &pulses.iter().map(|pulse| pulse.position.y).collect::<Vec<_>>());
        let middle = 0.5 * times[times.len() - 1];
        lines.push((pulses[0].time + middle, (x + vx * middle, y + vy * middle), (vx, vy)));
    }
    let starts: Vec<f64> = lines.iter().map(|(time, ..)| *time).collect();
    let rate = 1.0 / period(&starts)?;
    let speed = median(lines.iter().map(|(_, _, v)| hypot(v.0, v.1)).collect());
    let radius = speed / (TAU * rate);
    let (mut times, mut xs, mut ys) = (Vec::new(), Vec::new(), Vec::new());
    for (time, place, v) in lines {
        let length = hypot(v.0, v.1);
        times.push(time);
        xs.push(place.0 + sense * radius * v.1 / length);
        ys.push(place.1 - sense * radius * v.0 / length);
    }
    let ((vx, x), (vy, y)) = (slope(&times, &xs), slope(&times, &ys));
    Some(Circle { centre: (x, y), velocity: (vx, vy), radius, rate: sense * rate })
}

impl Circle {
    /// Place of a pulse on the circle, clockwise from north, rad.
    fn phase(&self, pulse: &Pulse) -> f64 {
        let x = pulse.position.x - self.centre.0 - self.velocity.0 * pulse.time;
        let y = pulse.position.y - self.centre.1 - self.velocity.1 * pulse.time;
        atan2(x, y)
    }
}

/// A cone that draws this circle.
fn cone(recording: &Recording, circle: &Circle) -> Option<Model> {
    let chosen = chosen(recording);
    let sample = |i: &usize| (recording.pulses[*i].time, circle.phase(&recording.pulses[*i]));
    let samples: Vec<(f64, f64)> = chosen.iter().map(sample).collect();
    let (rate, phase) = coherent_rate(&samples, circle.rate, 0.1);
    let course = atan2(circle.velocity.0, circle.velocity.1);
    let (height, _) = height(recording, &chosen, course, circle.centre, circle.velocity)?;
    let mut parameters = [0.0; MAX_PARAMETERS];
    (parameters[0], parameters[1]) = circle.centre;
    (parameters[2], parameters[3]) = circle.velocity;
    parameters[6] = height;
    parameters[PLATFORM_PARAMETERS] = libm::atan(circle.radius / (height - mean_height(recording, &chosen)));
    parameters[PLATFORM_PARAMETERS + 1] = rate;
    parameters[PLATFORM_PARAMETERS + 2] = wrapped(phase - course);
    Some(Model::new(Mirror::Cone, parameters))
}

/// Height of the platform, and where across the track the beam looks straight down. `None` where the angles
/// do not change across the track.
///
/// Angles that are rounded to degrees say little of a small tile: there the beams through the returns of
/// pulses that have several are taken, if they are many.
pub fn height(
    recording: &Recording,
    chosen: &[usize],
    course: f64,
    centre: (f64, f64),
    velocity: (f64, f64),
) -> Option<(f64, f64)> {
    let mean = mean_height(recording, chosen);
    let (right_x, right_y) = (cos(course), -sin(course));
    let across = |pulse: &Pulse, place: DVec3| {
        let x = place.x - centre.0 - velocity.0 * pulse.time;
        let y = place.y - centre.1 - velocity.1 * pulse.time;
        x * right_x + y * right_y
    };
    let (mut places, mut tangents) = (Vec::new(), Vec::new());
    if recording.has_whole_angles() {
        for pulse in &recording.pulses {
            let Some(last) = pulse.last else { continue };
            let down = pulse.position.z - last.z;
            if down > MIN_DEPTH {
                let (first, last) = (across(pulse, pulse.position), across(pulse, last));
                places.push(first + (last - first) * (pulse.position.z - mean) / down);
                tangents.push((last - first) / down);
            }
        }
    }
    if places.len() < MIN_DEEP_PULSES {
        (places, tangents) = chosen
            .iter()
            .map(|i| {
                (
                    across(&recording.pulses[*i], recording.pulses[*i].position),
                    tan(recording.pulses[*i].angle),
                )
            })
            .unzip();
    }
    let (gradient, at_zero) = slope(&places, &tangents);
    let height = 1.0 / gradient;
    // Also false for NaN.
    (height > 1.0 && height < 1e5).then(|| (mean + height, -at_zero * height))
}

pub fn mean_height(recording: &Recording, chosen: &[usize]) -> f64 {
    chosen.iter().map(|i| recording.pulses[*i].position.z).sum::<f64>() / chosen.len().max(1) as f64
}

/// Rate and phase at time 0 of lines that pass the angle 0 at these times; near the `multiple` of the rate by
/// their intervals.
pub fn line_rate(crossings: &[f64], multiple: f64) -> Option<(f64, f64)> {
    let mut times = crossings.to_vec();
    times.sort_by(f64::total_cmp);
    let coarse = multiple / period(&times)?;
    let samples: Vec<(f64, f64)> = times.iter().map(|time| (*time, 0.0)).collect();
    Some(coherent_rate(&samples, coarse, 0.05))
}

/// Period of lines at these ascending times, of which some may be missing and some cut to parts; `None` for
/// too few.
fn period(times: &[f64]) -> Option<f64> {
    let mut gaps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_by(f64::total_cmp);
    // Parts of one line have nearly the same time.
    let large = *gaps.get(gaps.len() * 3 / 4)?;
    gaps.retain(|gap| *gap > 0.3 * large);
    // Where lines are missing, gaps are multiples of the period.
    gaps.get(gaps.len() / 10).copied().filter(|period| *period > 0.0)
}

/// The rate near `coarse` (within a share of it) at which the phases of samples (time, phase) are most alike,
/// and that phase at time 0. Samples without a phase of their own have the phase 0: then the result is the
/// phase of the rate at time 0, reversed.
pub fn coherent_rate(samples: &[(f64, f64)], coarse: f64, share: f64) -> (f64, f64) {
    let first = samples.iter().map(|(time, _)| *time).fold(f64::INFINITY, f64::min);
    let last = samples.iter().map(|(time, _)| *time).fold(f64::NEG_INFINITY, f64::max);
    let until = (last - first).clamp(0.0, COHERENT);
    let samples: Vec<(f64, f64)> =
        samples.iter().filter(|(time, _)| time - first <= until).copied().collect();
    let coherence = |rate: f64| coherence(&samples, rate);
    let step = 0.2 / until.max(0.1);
    let count = (coarse.abs() * share / step).ceil().min(20_000.0) as i64;
    let mut best = (f64::NEG_INFINITY, coarse);
    for k in -count..=count {
        let rate = coarse + k as f64 * step;
        let size = coherence(rate).0;
        if size > best.0 {
            best = (size, rate);
        }
    }
    // Finer, in thirds.
    let (mut low, mut high) = (best.1 - step, best.1 + step);
    for _ in 0..40 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if coherence(a).0 < coherence(b).0 { low = a } else { high = b }
    }
    let rate = 0.5 * (low + high);
    (rate, coherence(rate).1)
}

/// How alike the phases of samples (time, phase) are at a rate, and their mean phase at time 0.
pub fn coherence(samples: &[(f64, f64)], rate: f64) -> (f64, f64) {
    let (mut re, mut im) = (0.0, 0.0);
    for (time, phase) in samples {
        let angle = phase - TAU * rate * time;
        (re, im) = (re + cos(angle), im + sin(angle));
    }
    (hypot(re, im), atan2(im, re))
}

/// Slope and value at 0 of a straight line through values.
pub fn slope(x: &[f64], y: &[f64]) -> (f64, f64) {
    let count = x.len() as f64;
    let (mx, my) = (x.iter().sum::<f64>() / count, y.iter().sum::<f64>() / count);
    let (mut xx, mut xy) = (0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        xx += (x - mx) * (x - mx);
        xy += (x - mx) * (y - my);
    }
    let slope = xy / xx;
    (slope, my - slope * mx)
}

fn unwrap(phases: &mut [f64]) {
    for i in 1..phases.len() {
        let turns = ((phases[i] - phases[i - 1]) / TAU).round();
        phases[i] -= turns * TAU;
    }
}

/// An angle from −π to π.
pub fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}
