//! First guesses of cones, by the circles that they draw on the ground.

use super::level::{Track, level, mean_height, right_of, sampled_pulses};
use super::mirror::{Mirror, MirrorParameters};
use super::model::Model;
use super::parameters::{Channel, Parameters};
use super::phases::{PhaseSample, StraightLine, coherent_rate, period, unwrap, wrapped};
use super::recording::{Pulse, Recording};
use libm::{atan, atan2, sqrt, tan};
use std::f64::consts::TAU;
use vlscan_geom::{DVec2, LeastSquares, median};

/// Minimum number of pulses of a line whose phases give a rate.
const MIN_PHASES: usize = 30;
/// Minimum number of pulses of a line that counts as an arc.
const MIN_ARC_PULSES: usize = 20;
/// Ratios of the tangents of the angles of elliptic cones that are tried.
const RATIOS: [f64; 4] = [0.6, 0.8, 1.25, 1.7];

/// Guesses of cones.
pub fn guesses(recording: &Recording) -> Vec<Model> {
    let circles = [circle(recording), arcs(recording, 1.0), arcs(recording, -1.0)];
    circles.into_iter().flatten().filter_map(|circle| cone(recording, &circle)).collect()
}

/// Guesses of elliptic cones: cones with other angles along or across the flight.
pub fn elliptic_guesses(recording: &Recording) -> Vec<Model> {
    let of_ratio = |cone: &Model, ratio: f64, is_along: bool| {
        let mut model = Model { mirror: Mirror::EllipticCone, parameters: cone.parameters.clone() };
        let angle = cone.parameters.mirror.angle;
        let other = atan(tan(angle) * ratio);
        let (angle, angle_along) = if is_along { (angle, other) } else { (other, angle) };
        model.parameters.mirror = MirrorParameters { angle, angle_along, ..cone.parameters.mirror };
        model
    };
    guesses(recording)
        .iter()
        .flat_map(|cone| RATIOS.map(|ratio| [true, false].map(|is_along| of_ratio(cone, ratio, is_along))))
        .flatten()
        .collect()
}

/// A circle on the ground whose centre moves.
struct Circle {
    /// Motion of the centre.
    track: Track,
    /// m.
    radius: f64,
    /// Approximate turns per second, clockwise as seen from above.
    rate: f64,
}

impl Circle {
    /// Place of a pulse on the circle, clockwise from north, rad.
    fn phase(&self, pulse: &Pulse) -> f64 {
        let offset = self.track.offset(pulse.position, pulse.time);
        atan2(offset.x, offset.y)
    }
}

/// The circle through all pulses: |X − c − v·t|² = R² is linear in c, v and products of them.
fn circle(recording: &Recording) -> Option<Circle> {
    let mut sums = LeastSquares::new(7);
    for i in sampled_pulses(recording) {
        let pulse = &recording.pulses[i];
        let (x, y, t) = (pulse.position.x, pulse.position.y, pulse.time);
        sums.add(&[2.0 * x, 2.0 * y, 2.0 * x * t, 2.0 * y * t, 1.0, t, t * t], x * x + y * y, 1.0);
    }
    let fit = sums.solution()?;
    let (start, velocity) = (DVec2::new(fit[0], fit[1]), DVec2::new(fit[2], fit[3]));
    let radius_squared = fit[4] + start.length_squared();
    if radius_squared <= 0.0 {
        return None;
    }
    let mut circle = Circle { track: Track { start, velocity }, radius: sqrt(radius_squared), rate: 0.0 };
    let rates = recording.lines.iter().filter(|line| line.len() >= MIN_PHASES).map(|line| {
        let pulses = &recording.pulses[line.clone()];
        let times: Vec<f64> = pulses.iter().map(|pulse| pulse.time).collect();
        let mut phases: Vec<f64> = pulses.iter().map(|pulse| circle.phase(pulse)).collect();
        unwrap(&mut phases);
        StraightLine::through(&times, &phases).slope / TAU
    });
    circle.rate = median(rates)?;
    (circle.rate != 0.0).then_some(circle)
}

/// Part of a circle that one line draws.
struct Arc {
    /// Time of its middle, s.
    time: f64,
    /// Position of its middle, m.
    middle: DVec2,
    /// Velocity of the beam on the ground, m/s.
    velocity: DVec2,
}

impl Arc {
    fn of(pulses: &[Pulse]) -> Arc {
        let times: Vec<f64> = pulses.iter().map(|pulse| pulse.time - pulses[0].time).collect();
        let line = |values: Vec<f64>| StraightLine::through(&times, &values);
        let x = line(pulses.iter().map(|pulse| pulse.position.x).collect());
        let y = line(pulses.iter().map(|pulse| pulse.position.y).collect());
        let middle = 0.5 * times[times.len() - 1];
        Arc {
            time: pulses[0].time + middle,
            middle: DVec2::new(x.at(middle), y.at(middle)),
            velocity: DVec2::new(x.slope, y.slope),
        }
    }
}

/// The circle whose arcs are lines that come once in a revolution: its radius follows from their speed on the
/// ground, its centre lies at right angles to them, on the right for `sense` 1 and on the left for −1.
fn arcs(recording: &Recording, sense: f64) -> Option<Circle> {
    let long = recording.lines.iter().filter(|line| line.len() >= MIN_ARC_PULSES);
    let arcs: Vec<Arc> = long.map(|line| Arc::of(&recording.pulses[line.clone()])).collect();
    let times: Vec<f64> = arcs.iter().map(|arc| arc.time).collect();
    let rate = 1.0 / period(&times)?;
    let speed = median(arcs.iter().map(|arc| arc.velocity.length()))?;
    let radius = speed / (TAU * rate);
    let centre = |arc: &Arc| arc.middle + sense * radius * right_of(arc.velocity.normalize());
    let centres: Vec<DVec2> = arcs.iter().map(centre).collect();
    let x = StraightLine::through(&times, &centres.iter().map(|centre| centre.x).collect::<Vec<_>>());
    let y = StraightLine::through(&times, &centres.iter().map(|centre| centre.y).collect::<Vec<_>>());
    let track = Track { start: DVec2::new(x.start, y.start), velocity: DVec2::new(x.slope, y.slope) };
    Some(Circle { track, radius, rate: sense * rate })
}

/// A cone that draws this circle.
fn cone(recording: &Recording, circle: &Circle) -> Option<Model> {
    let sampled = sampled_pulses(recording);
    let pulses = sampled.iter().map(|i| &recording.pulses[*i]);
    let samples: Vec<PhaseSample> =
        pulses.map(|pulse| PhaseSample { time: pulse.time, phase: circle.phase(pulse) }).collect();
    let turn = coherent_rate(&samples, circle.rate, 0.1);
    let Track { start, velocity } = circle.track;
    let height = level(recording, &sampled, &circle.track)?.height;
    let angle = atan(circle.radius / (height - mean_height(recording, &sampled)));
    let mirror = MirrorParameters { angle, rate: turn.rate, ..MirrorParameters::default() };
    let course = atan2(velocity.x, velocity.y);
    let channel = Channel { phase: wrapped(turn.phase - course), ..Channel::default() };
    let parameters = Parameters {
        position: start.extend(height),
        velocity: velocity.extend(0.0),
        mirror,
        channels: vec![channel],
        ..Parameters::default()
    };
    Some(Model { mirror: Mirror::Cone, parameters })
}
