//! First guesses of cones, by the circles that they draw on the ground.

use super::level::{Track, level, line_on_ground, mean_height, right_of, sampled_pulses};
use super::mirror::{Mirror, MirrorParameters};
use super::model::Model;
use super::parameters::{Channel, Parameters};
use super::phases::{PhaseSample, StraightLine, coherent_rate, period, unwrap, wrapped};
use super::pulses::Pulse;
use super::recording::Recording;
use libm::{atan, atan2, sqrt, tan};
use std::f64::consts::TAU;
use std::ops::Range;
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
        let pulse = recording.pulses.get(i);
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
        let times: Vec<f64> = line.clone().map(|i| recording.pulses.time(i)).collect();
        let pulses = recording.pulses.range(line.clone());
        let mut phases: Vec<f64> = pulses.map(|pulse| circle.phase(&pulse)).collect();
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
    /// The arc of a line of pulses.
    fn of(recording: &Recording, line: &Range<usize>) -> Arc {
        let pulses = &recording.pulses;
        let first = pulses.time(line.start);
        let [x, y] = line_on_ground(pulses, line);
        let middle = 0.5 * (pulses.time(line.end - 1) - first);
        Arc {
            time: first + middle,
            middle: DVec2::new(x.at(middle), y.at(middle)),
            velocity: DVec2::new(x.slope, y.slope),
        }
    }
}

/// The circle whose arcs are lines that occur once per revolution: its radius follows from their speed on the
/// ground, its centre lies at right angles to them, on the right for `sense` 1 and on the left for −1.
fn arcs(recording: &Recording, sense: f64) -> Option<Circle> {
    let long = recording.lines.iter().filter(|line| line.len() >= MIN_ARC_PULSES);
    let arcs: Vec<Arc> = long.map(|line| Arc::of(recording, line)).collect();
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
    let pulses = sampled.iter().map(|i| recording.pulses.get(*i));
    let samples: Vec<PhaseSample> =
        pulses.map(|pulse| PhaseSample { time: pulse.time, phase: circle.phase(&pulse) }).collect();
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

#[cfg(test)]
mod tests {
    use super::super::model::Attitude;
    use super::*;
    use vlscan_geom::{DVec3, radians};

    /// Half a second of a cone of 20 degrees from 1000 m over flat ground.
    fn recorded(rate: f64) -> Recording {
        let parameters = Parameters {
            position: DVec3::new(5.0, -3.0, 1000.0),
            velocity: DVec3::new(30.0, 40.0, 0.0),
            mirror: MirrorParameters { angle: radians(20.0), rate, ..MirrorParameters::default() },
            channels: vec![Channel { phase: 1.0, ..Channel::default() }],
            ..Parameters::default()
        };
        let model = Model { mirror: Mirror::Cone, parameters };
        let pulse = |k: u32| {
            let time = 2e-5 * f64::from(k);
            let at = model.footprint(&Attitude::default(), 0, time, 0.0);
            Pulse::on_ground(time, DVec3::new(at.x, at.y, 0.0), at.angle)
        };
        Recording::new((0..25_000).map(pulse).collect()).unwrap()
    }

    #[test]
    fn a_circle_gives_platform_and_cone() {
        for rate in [-80.0, 80.0] {
            let found = guesses(&recorded(rate));
            assert_eq!(found.len(), 1, "{found:?}");
            let p = &found[0].parameters;
            assert!((p.position - DVec3::new(5.0, -3.0, 1000.0)).length() < 1.0, "{p:?}");
            assert!((p.velocity - DVec3::new(30.0, 40.0, 0.0)).length() < 0.1, "{p:?}");
            assert!((p.mirror.angle - radians(20.0)).abs() < 1e-3, "{p:?}");
            assert!((p.mirror.rate - rate).abs() < 0.01, "{p:?}");
            assert!((p.channels[0].phase - 1.0).abs() < 0.02, "{p:?}");
        }
    }

    #[test]
    fn elliptic_cones_are_wider_along_or_across_the_flight() {
        let found = elliptic_guesses(&recorded(80.0));
        assert_eq!(found.len(), 2 * RATIOS.len());
        let ratio = |model: &Model| {
            let mirror = &model.parameters.mirror;
            tan(mirror.angle_along) / tan(mirror.angle)
        };
        for (pair, expected) in found.chunks(2).zip(RATIOS) {
            assert!((ratio(&pair[0]) - expected).abs() < 1e-9, "{pair:?}");
            assert!((ratio(&pair[1]) - 1.0 / expected).abs() < 1e-9, "{pair:?}");
            assert!(pair.iter().all(|model| model.mirror == Mirror::EllipticCone));
        }
    }
}
