//! Flies a sample of a planned flight and compares it with the plan's figures for flat ground.

use super::area::Area;
use super::document::{PlannedSurvey, Promise, Waypoint};
use super::reach::{Reach, Seen};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::number;
use vlscan_base::rng::GOLDEN;
use vlscan_geom::DVec3;
use vlscan_lidar::flight::{FlightPlan, FlightSink, FlightState, PoseSample, Pulse, Step};

/// Pulses that are computed.
const MAX_SAMPLES: f64 = 12_000.0;
/// Minimum number of sampled steps.
const MIN_SAMPLES: f64 = 3000.0;
/// Relative departure of density and width above which the plan is rejected.
const MAX_DEPARTURE: f64 = 0.05;
/// Standard deviations of the sampled density that do not count as a departure.
const MAX_DEVIATIONS: f64 = 4.0;
/// Distances between the outermost samples of a strip and the next ones that its edge may lie farther out.
const MAX_GAPS: f64 = 4.0;

/// Figures of the sample of a flight over flat ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flown {
    /// Mean density over the area of the parallel lines, pulses/m².
    pub density: f64,
    /// Standard deviation of the density, pulses/m².
    pub deviation: f64,
    /// Width of the strips as far as the sample meets them, m.
    pub width: f64,
    /// How much wider the strips may be, m.
    pub gap: f64,
    /// Share of the pulses whose ground the instrument measures.
    pub measured: f64,
}

/// Samples the pulses of the parallel lines of a plan. `shift` is the origin of the flight's frame, world, m.
///
/// # Errors
/// The errors of the steps of a flight.
pub fn fly_sample(flight: &FlightPlan, document: &PlannedSurvey, area: &Area, shift: DVec3) -> Result<Flown> {
    let Some(Promise { height, .. }) = document.promise else {
        return Err(Error::Internal("the plan is not a flight".to_owned()));
    };
    let legs = measuring_legs(flight, document);
    let all: f64 = legs.iter().flatten().sum();
    let stride = (all / (MAX_SAMPLES / document.reaches.len().max(1) as f64).max(MIN_SAMPLES)).max(1.0);
    let mut strip = Strip::new(area, shift, &document.reaches);
    let (mut state, mut next, mut count) = (FlightState::start(flight), 0.5 * stride, 0.0);
    for (leg, steps) in legs.iter().enumerate() {
        if let Some(steps) = steps {
            strip.begin(document.waypoints[leg].position, document.waypoints[leg + 1].position);
            let (mut flown, mut at) = (state.clone(), 0.0);
            while next < *steps {
                let position = next.floor().max(at);
                flown.jump(flight, (position - at) as u64);
                strip.ground = flown.position().z - height;
                if flown.step(flight, &mut strip)? != Step::Advanced {
                    break;
                }
                strip.end_step();
                at = position + 1.0;
                count += 1.0;
                // Between half and one and a half strides, so that no phase of a mirror is met more often
                // than others.
                next += if stride > 1.0 { stride * (0.5 + (count * GOLDEN).fract()) } else { 1.0 };
            }
            next = (next - steps).max(0.0);
        }
        if !state.skip_leg(flight) {
            break;
        }
    }
    Ok(strip.result(all / count.max(1.0)))
}

/// The steps of each leg that belongs to a parallel line; `None` for other legs.
fn measuring_legs(flight: &FlightPlan, document: &PlannedSurvey) -> Vec<Option<f64>> {
    let pairs = document.waypoints.windows(2).enumerate();
    let steps = |(i, pair): (usize, &[Waypoint])| {
        let is_line = pair[0].strip.as_deref().is_some_and(|strip| strip.starts_with("line"));
        let speed = pair[0].speed.filter(|_| pair[0].active && is_line)?;
        let seconds = pair[0].position.distance(pair[1].position) / speed;
        Some((seconds * flight.leg(i).frequency).floor())
    };
    pairs.map(steps).collect()
}

/// Counts the pulses that meet flat ground within an area.
struct Strip<'a> {
    area: &'a Area,
    shift: DVec3,
    reaches: &'a [Reach],
    /// Height of the ground, flight's frame, m.
    ground: f64,
    /// A place on the flight line, world, m, and the horizontal unit vector to its right.
    line: (DVec3, DVec3),
    /// Pulses that leave the instrument, whose ground it measures, and of the latter those within the area.
    fired: f64,
    measured: f64,
    inside: f64,
    /// The pulses of the present step within the area, and the sum of the squares of those of earlier steps:
    /// channels that fire in one step point at one place, and are no samples of their own.
    inside_now: f64,
    inside_squares: f64,
    /// The outermost places across the flight of the present step, m, to the left and to the right.
    across_now: [f64; 2],
    /// The distances of the two outermost steps on either side, m, the outer one first.
    outermost: [[f64; 2]; 2],
}

impl<'a> Strip<'a> {
    fn new(area: &'a Area, shift: DVec3, reaches: &'a [Reach]) -> Strip<'a> {
        Strip {
            area,
            shift,
            reaches,
            ground: 0.0,
            line: (DVec3::ZERO, DVec3::ZERO),
            fired: 0.0,
            measured: 0.0,
            inside: 0.0,
            inside_now: 0.0,
            inside_squares: 0.0,
            across_now: [f64::NEG_INFINITY; 2],
            outermost: [[f64::NEG_INFINITY; 2]; 2],
        }
    }

    fn begin(&mut self, from: DVec3, to: DVec3) {
        let way = DVec3::new(to.x - from.x, to.y - from.y, 0.0).normalize_or_zero();
        self.line = (from, DVec3::new(way.y, -way.x, 0.0));
    }

    fn end_step(&mut self) {
        self.inside += self.inside_now;
        self.inside_squares += self.inside_now * self.inside_now;
        for (outermost, off) in self.outermost.iter_mut().zip(self.across_now) {
            *outermost = match off > outermost[0] {
                true => [off, outermost[0]],
                false => [outermost[0], outermost[1].max(off)],
            };
        }
        (self.inside_now, self.across_now) = (0.0, [f64::NEG_INFINITY; 2]);
    }

    /// `weight` is the number of pulses that each sampled one represents.
    fn result(&self, weight: f64) -> Flown {
        let square = self.area.square_metres();
        Flown {
            density: weight * self.inside / square,
            deviation: weight * self.inside_squares.sqrt() / square,
            width: self.outermost.iter().map(|side| side[0]).sum::<f64>().max(0.0),
            gap: self.outermost.iter().map(|side| side[0] - side[1]).sum(),
            measured: self.measured / self.fired.max(1.0),
        }
    }
}

impl FlightSink for Strip<'_> {
    fn pulse(&mut self, pulse: impl FnOnce() -> Pulse) {
        let pulse = pulse();
        let beam = pulse.attitude.forward();
        let range = (self.ground - pulse.origin.z) / beam.z;
        self.fired += 1.0;
        let Some(reach) = self.reaches.get(pulse.device as usize) else { return };
        if beam.z >= 0.0 || reach.of_ground(range, &pulse.attitude) != Seen::Measured {
            return;
        }
        self.measured += 1.0;
        let place = pulse.origin + beam * range + self.shift;
        let (from, right) = self.line;
        let off = (place - from).dot(right);
        self.across_now = [self.across_now[0].max(-off), self.across_now[1].max(off)];
        self.inside_now += f64::from(u8::from(self.area.contains([place.x, place.y])));
    }

    fn pose(&mut self, _: impl FnOnce() -> PoseSample) {}
}

impl Flown {
    /// Compares the flown sample with the plan.
    ///
    /// # Errors
    /// [`Error::Input`] with both.
    pub fn check(&self, promise: &Promise) -> Result<()> {
        let off = (self.density - promise.density).abs();
        if off > MAX_DEPARTURE * promise.density + MAX_DEVIATIONS * self.deviation {
            return Err(Error::input(format!(
                "the flight of this plan gives {} pulses/m² of flat ground in the area, but {} were planned",
                number(self.density),
                number(promise.density)
            )));
        }
        let off = self.width - promise.width;
        if off > MAX_DEPARTURE * promise.width || -off > MAX_DEPARTURE * promise.width + MAX_GAPS * self.gap {
            return Err(Error::input(format!(
                "the strips of this plan's flight are {} m wide, but {} m were planned",
                number(self.width),
                number(promise.width)
            )));
        }
        Ok(())
    }
}
