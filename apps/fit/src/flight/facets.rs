//! First guess of a polygon mirror whose facets differ by their tilt: their lines come in turn, each shifted
//! along the flight.

use super::guess::{coherence, least_squares, line_rate, mean_height, wrapped};
use super::lines::{Crossing, crossing};
use super::mirror::Mirror;
use super::model::{FIRST_OF_CHANNELS, MAX_FACETS, Model, PLATFORM_PARAMETERS};
use super::recording::Recording;
use libm::{atan, cos, hypot, sin, sqrt, tan};
use std::f64::consts::TAU;

/// Lines of each facet that are needed.
const MIN_LINES: usize = 3;
/// Facets have to leave less than this share of what one facet leaves of the places of lines.
const MAX_LEFT: f64 = 0.3;
/// A number of facets that leaves less than so many times what the best one leaves is as good; the smallest
/// is taken.
const AS_GOOD: f64 = 1.5;
/// Multiples of the rate of lines at which their phases are alike to this share of the best one's are as
/// good.
const COHERENT: f64 = 0.97;

/// A line: when it looks straight down, and how far ahead of its expected place it lies.
struct Line {
    time: f64,
    ahead: f64,
    /// Reciprocal of the cosine of the angle across the flight: lines of tilted facets are hyperbolas.
    secant: f64,
}

/// The mirror of one channel, `single`, with facets that differ; `None` if its lines do not lie where such
/// facets would draw them.
pub fn guess(recording: &Recording, single: &Model) -> Option<Model> {
    if single.mirror != Mirror::Polygon || single.senses.len() > 1 {
        return None;
    }
    let p = &single.parameters;
    let (centre, velocity) = ((p[0], p[1]), (p[2], p[3]));
    let speed = hypot(velocity.0, velocity.1);
    let (forward, right) =
        ((velocity.0 / speed, velocity.1 / speed), (velocity.1 / speed, -velocity.0 / speed));
    let yaw = single.of_mirror()[3];
    let mean = mean_height(recording, &super::guess::chosen(recording));
    let height = p[6] - mean;
    let mut lines: Vec<Line> = Vec::new();
    let mut rates = Vec::new();
    for range in recording.lines.iter().filter(|line| line.len() >= super::lines::MIN_PULSES) {
        let Some(Crossing { time, rate }) = crossing(recording, range.clone(), centre, velocity, right, p[6])
        else {
            continue;
        };
        let middle = &recording.pulses[(range.start + range.end) / 2];
        let x = middle.position.x - centre.0 - velocity.0 * middle.time;
        let y = middle.position.y - centre.1 - velocity.1 * middle.time;
        let (side, down) = (x * right.0 + y * right.1, p[6] - middle.position.z);
        // By the mean height.
        let ahead = (x * forward.0 + y * forward.1 + side * tan(yaw)) * height / down;
        lines.push(Line { time, ahead, secant: hypot(side, down) / down });
        rates.push(rate.abs());
    }
    let (frequency, phase) = rate_of_facets(&lines.iter().map(|line| line.time).collect::<Vec<_>>())?;
    // The angle is 0 in the middle of a line.
    let phase = wrapped(0.5 * TAU + phase);
    let number = |time: f64, count: usize| {
        let line = Mirror::Polygon.number(&[0.0, frequency], phase, time);
        line.rem_euclid(count as i64) as usize
    };
    let fit = |count: usize| {
        let mut of_facet = vec![0; count];
        lines.iter().for_each(|line| of_facet[number(line.time, count)] += 1);
        if of_facet.iter().any(|lines| *lines < MIN_LINES) {
            return None;
        }
        let row = |line: &Line| {
            let mut row = vec![0.0; count + 1];
            row[0] = line.time;
            row[1 + number(line.time, count)] = line.secant;
            row
        };
        let rows: Vec<Vec<f64>> = lines.iter().map(row).collect();
        let places: Vec<f64> = lines.iter().map(|line| line.ahead).collect();
        let values = least_squares(&rows, &places)?;
        let left = |(row, place): (&Vec<f64>, &f64)| {
            (place - row.iter().zip(&values).map(|(a, b)| a * b).sum::<f64>()).powi(2)
        };
        let left = sqrt(rows.iter().zip(&places).map(left).sum::<f64>() / rows.len() as f64);
        Some((count, left, values))
    };
    let trials: Vec<(usize, f64, Vec<f64>)> = (1..=MAX_FACETS).filter_map(fit).collect();
    let alike = trials.first().filter(|trial| trial.0 == 1)?.1;
    let least = trials.iter().map(|trial| trial.1).fold(f64::INFINITY, f64::min);
    let (count, _, values) = trials
        .into_iter()
        .find(|trial| trial.0 > 1 && trial.1 <= AS_GOOD * least && trial.1 < MAX_LEFT * alike)?;
    let mut model = single.clone();
    model.facets = count;
    // What the facets have in common is the place of the platform.
    let common = values[1..].iter().sum::<f64>() / count as f64;
    let p = &mut model.parameters;
    (p[0], p[1]) = (centre.0 + common * forward.0, centre.1 + common * forward.1);
    let course = libm::atan2(velocity.0, velocity.1);
    (p[2], p[3]) = (sin(course) * (speed + values[0]), cos(course) * (speed + values[0]));
    for (tilt, ahead) in p[FIRST_OF_CHANNELS..].iter_mut().zip(&values[1..]) {
        *tilt = atan((ahead - common) / height);
    }
    let of_mirror = &mut p[PLATFORM_PARAMETERS..];
    of_mirror[0] = of_mirror[0].signum() * super::recording::median(rates) / frequency;
    (of_mirror[1], of_mirror[2]) = (frequency, phase);
    Some(model)
}

/// Rate and phase of lines that look straight down at these times. A small place sees the lines of one facet
/// at a time: then the rate is a multiple of what their intervals tell.
fn rate_of_facets(times: &[f64]) -> Option<(f64, f64)> {
    let samples: Vec<(f64, f64)> = times.iter().map(|time| (*time, 0.0)).collect();
    let trials: Vec<(f64, f64, f64)> = (1..=MAX_FACETS)
        .filter_map(|multiple| {
            let (rate, phase) = line_rate(times, multiple as f64)?;
            Some((rate, phase, coherence(&samples, rate).0))
        })
        .collect();
    let best = trials.iter().map(|trial| trial.2).fold(0.0, f64::max);
    trials.into_iter().find(|trial| trial.2 >= COHERENT * best).map(|(rate, phase, _)| (rate, phase))
}
