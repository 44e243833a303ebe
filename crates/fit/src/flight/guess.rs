//! First guesses of a flight and its mirror.

use super::mirror::Mirror;
use super::model::{MAX_PARAMETERS, Model, PLATFORM_PARAMETERS};
use super::recording::{Pulse, Recording, median};
use libm::{atan2, cos, hypot, sin, sqrt, tan};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// Pulses that are used for a guess.
const GUESS_PULSES: usize = 6000;
/// Rates are sought by the coherence of phases over at most this many seconds.
const COHERENT: f64 = 4.0;

/// A pulse as seen from the flight's course.
struct Seen {
    time: f64,
    /// Positive to the right, rad.
    angle: f64,
}

/// Guesses that the pulses suggest.
pub fn guesses(recording: &Recording) -> Vec<Model> {
    let cones = [circle(recording), arcs(recording, 1.0), arcs(recording, -1.0)];
    let circles = cones.into_iter().flatten().filter_map(|circle| cone(recording, &circle));
    let lines =
        [Mirror::Polygon, Mirror::Oscillating].into_iter().filter_map(|mirror| lines(recording, mirror));
    circles.chain(lines).collect()
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
fn chosen(recording: &Recording) -> Vec<usize> {
    let all: Vec<usize> =
        recording.lines.iter().filter(|line| line.len() >= 8).flat_map(|line| line.clone()).collect();
    let step = all.len().div_ceil(GUESS_PULSES).max(1);
    all.into_iter().step_by(step).collect()
}

/// Least squares; `None` if the columns depend on each other.
fn least_squares(rows: &[Vec<f64>], right: &[f64]) -> Option<Vec<f64>> {
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

/// The circle whose arcs are lines that come once in a revolution: its radius follows from their speed on the ground, its centre
/// lies at right angles to them, on the right for `sense` 1 and on the left for −1.
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
    Some(Model { mirror: Mirror::Cone, parameters })
}

/// Parallel lines across the flight.
fn lines(recording: &Recording, mirror: Mirror) -> Option<Model> {
    let chosen = chosen(recording);
    // The lines' direction: the main axis of the pulses about the centres of their lines.
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for line in recording.lines.iter().filter(|line| line.len() >= 8) {
        let count = line.len() as f64;
        let pulses = &recording.pulses[line.clone()];
        let (mut mx, mut my) = (0.0, 0.0);
        pulses
            .iter()
            .for_each(|pulse| (mx, my) = (mx + pulse.position.x / count, my + pulse.position.y / count));
        for pulse in pulses {
            let (x, y) = (pulse.position.x - mx, pulse.position.y - my);
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        }
    }
    let axis = 0.5 * atan2(2.0 * xy, xx - yy);
    // Forward is at right angles to the lines, in the sense in which they advance.
    let mut forward = (-sin(axis), cos(axis));
    let along = |i: usize, forward: (f64, f64)| {
        recording.pulses[i].position.x * forward.0 + recording.pulses[i].position.y * forward.1
    };
    let times: Vec<f64> = chosen.iter().map(|i| recording.pulses[*i].time).collect();
    let places: Vec<f64> = chosen.iter().map(|i| along(*i, forward)).collect();
    let (mut speed, mut start) = slope(&times, &places);
    if speed < 0.0 {
        (forward, speed, start) = ((-forward.0, -forward.1), -speed, -start);
    }
    let course = atan2(forward.0, forward.1);
    let velocity = (speed * forward.0, speed * forward.1);
    let centre = (start * forward.0, start * forward.1);
    let (height, across) = height(recording, &chosen, course, centre, velocity)?;
    // `across` is where the scan angle is 0, to the right of the centre.
    let right = (forward.1, -forward.0);
    let centre = (centre.0 + across * right.0, centre.1 + across * right.1);
    let seen = |i: usize| {
        let pulse = &recording.pulses[i];
        let (x, y) = (
            pulse.position.x - centre.0 - velocity.0 * pulse.time,
            pulse.position.y - centre.1 - velocity.1 * pulse.time,
        );
        Seen { time: pulse.time, angle: atan2(x * right.0 + y * right.1, height - pulse.position.z) }
    };
    let (mut rising, mut falling, mut rates) = (Vec::new(), Vec::new(), Vec::new());
    for line in recording.lines.iter().filter(|line| line.len() >= 12) {
        let seen: Vec<Seen> = line.clone().map(seen).collect();
        let times: Vec<f64> = seen.iter().map(|s| s.time - seen[0].time).collect();
        let angles: Vec<f64> = seen.iter().map(|s| s.angle).collect();
        let (rate, first) = slope(&times, &angles);
        if rate == 0.0 || !rate.is_finite() {
            continue;
        }
        // When the line passes the angle 0.
        let crossing = seen[0].time - first / rate;
        if rate > 0.0 {
            rising.push(crossing)
        } else {
            falling.push(crossing)
        }
        rates.push(rate);
    }
    let is_both = rising.len().min(falling.len()) * 5 > rising.len().max(falling.len());
    let speed_of_angle = median(rates.iter().map(|rate| rate.abs()).collect());
    let mut parameters = [0.0; MAX_PARAMETERS];
    (parameters[0], parameters[1]) = centre;
    (parameters[2], parameters[3]) = velocity;
    parameters[6] = height;
    let of_mirror = &mut parameters[PLATFORM_PARAMETERS..];
    match mirror {
        Mirror::Polygon if !is_both => {
            let is_rising = rising.len() > falling.len();
            let (frequency, offset) = line_rate(if is_rising { &rising } else { &falling })?;
            of_mirror[0] = speed_of_angle / frequency * if is_rising { 1.0 } else { -1.0 };
            of_mirror[1] = frequency;
            // The angle is 0 in the middle of a line.
            of_mirror[2] = wrapped(0.5 * TAU + offset);
        }
        Mirror::Oscillating if is_both => {
            let (frequency, offset) = line_rate(&rising)?;
            of_mirror[0] = speed_of_angle / (4.0 * frequency);
            of_mirror[1] = frequency;
            of_mirror[2] = wrapped(0.25 * TAU + offset);
        }
        _ => return None,
    }
    Some(Model { mirror, parameters })
}

/// Height of the platform, and where across the track the scan angle is 0, by the angles in the file. `None` where they do not
/// change across the track.
fn height(
    recording: &Recording,
    chosen: &[usize],
    course: f64,
    centre: (f64, f64),
    velocity: (f64, f64),
) -> Option<(f64, f64)> {
    let mean = mean_height(recording, chosen);
    let (right_x, right_y) = (cos(course), -sin(course));
    let (mut across, mut tangents) = (Vec::new(), Vec::new());
    for i in chosen {
        let pulse = &recording.pulses[*i];
        let x = pulse.position.x - centre.0 - velocity.0 * pulse.time;
        let y = pulse.position.y - centre.1 - velocity.1 * pulse.time;
        across.push(x * right_x + y * right_y);
        tangents.push(tan(pulse.angle));
    }
    let (gradient, at_zero) = slope(&across, &tangents);
    let height = 1.0 / gradient;
    // Also false for NaN.
    (height > 1.0 && height < 1e5).then(|| (mean + height, -at_zero * height))
}

fn mean_height(recording: &Recording, chosen: &[usize]) -> f64 {
    chosen.iter().map(|i| recording.pulses[*i].position.z).sum::<f64>() / chosen.len().max(1) as f64
}

/// Rate and phase at time 0 of lines that pass the angle 0 at these times.
fn line_rate(crossings: &[f64]) -> Option<(f64, f64)> {
    let mut times = crossings.to_vec();
    times.sort_by(f64::total_cmp);
    let coarse = 1.0 / period(&times)?;
    let samples: Vec<(f64, f64)> = times.iter().map(|time| (*time, 0.0)).collect();
    Some(coherent_rate(&samples, coarse, 0.05))
}

/// Period of lines at these ascending times, of which some may be missing and some cut to parts; `None` for too few.
fn period(times: &[f64]) -> Option<f64> {
    let mut gaps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_by(f64::total_cmp);
    // Parts of one line have nearly the same time.
    let large = *gaps.get(gaps.len() * 3 / 4)?;
    gaps.retain(|gap| *gap > 0.3 * large);
    // Where lines are missing, gaps are multiples of the period.
    gaps.get(gaps.len() / 10).copied().filter(|period| *period > 0.0)
}

/// The rate near `coarse` (within a share of it) at which the phases of samples (time, phase) are most alike, and that phase at
/// time 0. Samples without a phase of their own have the phase 0: then the result is the phase of the rate at time 0, reversed.
fn coherent_rate(samples: &[(f64, f64)], coarse: f64, share: f64) -> (f64, f64) {
    let coherence = |rate: f64, until: f64| {
        let (mut re, mut im) = (0.0, 0.0);
        for (time, phase) in samples.iter().filter(|(time, _)| *time <= until) {
            let angle = phase - TAU * rate * time;
            (re, im) = (re + cos(angle), im + sin(angle));
        }
        (hypot(re, im), atan2(im, re))
    };
    let last = samples.iter().map(|(time, _)| *time).fold(0.0, f64::max);
    let until = last.min(COHERENT);
    let step = 0.2 / until.max(0.1);
    let count = (coarse.abs() * share / step).ceil().min(20_000.0) as i64;
    let mut best = (f64::NEG_INFINITY, coarse);
    for k in -count..=count {
        let rate = coarse + k as f64 * step;
        let size = coherence(rate, until).0;
        if size > best.0 {
            best = (size, rate);
        }
    }
    // Finer, in thirds.
    let (mut low, mut high) = (best.1 - step, best.1 + step);
    for _ in 0..40 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if coherence(a, until).0 < coherence(b, until).0 { low = a } else { high = b }
    }
    let rate = 0.5 * (low + high);
    (rate, coherence(rate, until).1)
}

/// Slope and value at 0 of a straight line through values.
fn slope(x: &[f64], y: &[f64]) -> (f64, f64) {
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
fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}
