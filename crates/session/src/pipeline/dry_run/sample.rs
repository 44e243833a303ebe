//! The sample of a dry run: a few chunks of each stratum are measured and written as the run would do it.

use super::super::chunk::Chunk;
use super::super::collector::{Ended, PassEnd};
use super::super::fly::run_stages;
use super::super::pass::Pass;
use super::super::worker::{FlightWorker, Pieces};
use super::timeline::{MAX_STRATUM_PULSES, Timeline};
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::time::Instant;
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;
use vlscan_lidar::flight::{FlightPlan, Pulse};
use vlscan_lidar::pulse::Echo;
use vlscan_scene::MotionState;
use vlscan_warehouse::Tasks;

/// Number of rays after which no further stratum is begun. A count instead of a time, so that samples are
/// always the same.
const MAX_RAYS: u64 = 3_000_000;
/// Cost of a stratum in scenes whose tiles are loaded for it, as a number of rays.
const RAYS_PER_TILED_STRATUM: u64 = MAX_RAYS / 16;
/// Steps of a moving scene that take as long as a ray.
const MOTION_STEPS_PER_RAY: u64 = 32;
/// Cost of a pulse in fog, rain, snow or dust, as a number of rays.
const RAYS_PER_WEATHER_PULSE: u64 = 64;
/// Part of a stratum that is measured there, but at least so many pulses: weather makes pulses many times as
/// slow, and the sample of a short flight would take as long as the flight.
const SHARE_IN_WEATHER: f64 = 0.125;
const MIN_IN_WEATHER: f64 = 128.0;
const PULSES_PER_CHUNK: u32 = 1024;
/// Steps of a moving scene up to which its state is computed.
const MAX_MOTION_STEPS: u64 = 5_000_000;

/// Measurements of a stratum of the flight.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stratum {
    /// Number of the leg in the survey.
    pub leg: u32,
    pub pulses: f64,
    pub points: f64,
    /// Pulses with an echo.
    pub hits: f64,
    /// Time of the worker, s.
    pub seconds: f64,
    /// Sum of the ranges of first echoes, m.
    pub ranges: f64,
    /// Typical angle between successive beams of a device, rad.
    pub beam_angle: f64,
    /// Horizontal distance, m, and duration, s, of the platform's movement.
    pub way: f64,
    pub flown_s: f64,
    pub view: View,
}

/// The ground that a stratum sees, scene frame, m.
#[derive(Clone, Copy, Debug, Default)]
pub struct View {
    /// Origin of the first pulse.
    pub origin: DVec3,
    /// Horizontal unit vector to the right of the direction of movement; 0 if the platform is static.
    pub right: DVec3,
    /// How far to the left and to the right echoes are.
    pub across: [f64; 2],
    /// The farthest echo.
    pub farthest: DVec3,
}

/// A sample that was measured.
#[derive(Debug, Default)]
pub struct Sample {
    /// Strata with pulses, in the order of the flight.
    pub strata: Vec<Stratum>,
    /// Time before the first pulse and from then to the last byte, s.
    pub seconds: [f64; 2],
}

struct SampleChunk {
    stratum: usize,
    /// Its place among the chunks of the stratum.
    place: u32,
    chunk: Chunk,
}

impl Tasks for SampleChunk {
    fn tasks(&self) -> u32 {
        self.chunk.pulses
    }
}

/// Cost of a pulse, as a number of rays.
fn rays_per_pulse(pass: &Pass<'_>, has_weather: bool) -> u64 {
    // A false point costs about as much as a ray.
    let alarms = pass.physics.instruments().false_alarms().map_or(0.0, |alarms| alarms.per_pulse);
    let of_weather = if has_weather { RAYS_PER_WEATHER_PULSE } else { 0 };
    pass.physics.max_rays() as u64 + alarms.ceil() as u64 + of_weather
}

/// Measures strata in an order in which those so far are always evenly spread, until all are done or
/// [`MAX_RAYS`] are traced.
pub fn measure(pass: &Pass<'_>, flight: &FlightPlan, timeline: &Timeline) -> Result<(Ended, Sample)> {
    let started = Instant::now();
    let begun = Mutex::new(None);
    let log: Mutex<BTreeMap<(usize, u32), Option<Stratum>>> = Mutex::default();
    let poisoned = || Error::Internal("a worker has panicked".to_owned());
    let make_worker = || {
        let mut worker = FlightWorker::new(pass, flight);
        let (begun, log) = (&begun, &log);
        move |work: SampleChunk| -> Result<Pieces> {
            let now = Instant::now();
            begun.lock().map_err(|_| poisoned())?.get_or_insert(now);
            let leg = work.chunk.leg;
            let pieces = worker.measure_in_any_order(work.chunk)?;
            let seconds = now.elapsed().as_secs_f64();
            let (pulses, echoes) = worker.measured();
            let mut log = log.lock().map_err(|_| poisoned())?;
            log.insert((work.stratum, work.place), Stratum::of(leg, pulses, echoes, seconds));
            Ok(pieces)
        }
    };
    let end = PassEnd { check: None, is_last: true, keeps_partial: false, open_outputs: pass.open_outputs };
    let ended = run_stages(pass.schedule, pass.control, &pass.output, None, end, make_worker, |feed| {
        let has_weather = pass.physics.instruments().has_weather();
        let rays_per_pulse = rays_per_pulse(pass, has_weather);
        let interval = match has_weather {
            true => (SHARE_IN_WEATHER * timeline.interval).max(MIN_IN_WEATHER),
            false => timeline.interval,
        };
        let mut rays = 0;
        for stratum in spread(timeline.starts.len()) {
            if rays > 0 && (rays >= MAX_RAYS || feed.state().is_stopped()) {
                break;
            }
            rays += if pass.tiles.is_some() { RAYS_PER_TILED_STRATUM } else { 1 };
            let mut state = timeline.starts[stratum].clone();
            let steps = state.steps().min(MAX_MOTION_STEPS);
            let mut moving = pass.motion.map(|motion| MotionState::after_steps(motion, steps));
            rays += if pass.motion.is_some() { steps / MOTION_STEPS_PER_RAY } else { 0 };
            let mut place = 0;
            let mut left = interval.clamp(1.0, MAX_STRATUM_PULSES as f64) as u32;
            while left > 0 {
                let size = left.min(PULSES_PER_CHUNK);
                let taken = Chunk::take(flight, &mut state, moving.as_ref(), size)?;
                let Some(chunk) = taken.filter(|chunk| chunk.pulses > 0) else { break };
                left = left.saturating_sub(chunk.pulses);
                if let (Some(state), Some(motion)) = (&mut moving, pass.motion) {
                    (0..chunk.steps).for_each(|_| state.step(motion, |_, _| ()));
                }
                rays += u64::from(chunk.pulses) * rays_per_pulse;
                feed.put(SampleChunk { stratum, place, chunk })?;
                place += 1;
            }
        }
        feed.end_leg()
    })?;
    let first = begun.into_inner().map_err(|_| poisoned())?.unwrap_or_else(Instant::now);
    let seconds = [first.duration_since(started).as_secs_f64(), first.elapsed().as_secs_f64()];
    let log = log.into_inner().map_err(|_| poisoned())?;
    let parts = log.into_iter().filter_map(|((stratum, _), part)| Some((stratum, part?)));
    Ok((ended, Sample { strata: joined(parts), seconds }))
}

/// The strata of parts in the order of the flight, one for each leg, in sums that do not depend on the
/// threads.
fn joined(parts: impl Iterator<Item = (usize, Stratum)>) -> Vec<Stratum> {
    let mut strata: Vec<(usize, Stratum)> = Vec::new();
    for (number, part) in parts {
        match strata.last_mut().filter(|(last, all)| *last == number && all.leg == part.leg) {
            Some((_, all)) => all.join(&part),
            None => strata.push((number, part)),
        }
    }
    strata.into_iter().map(|(_, stratum)| stratum).collect()
}

/// The numbers from 0 to `count` - 1 with reversed bits.
fn spread(count: usize) -> impl Iterator<Item = usize> {
    let bits = usize::BITS - count.saturating_sub(1).leading_zeros();
    (0..1usize << bits)
        .map(move |i| if bits == 0 { 0 } else { i.reverse_bits() >> (usize::BITS - bits) })
        .filter(move |i| *i < count)
}

impl Stratum {
    /// Measurements of consecutive pulses of a leg; `None` without pulses.
    fn of(leg: u32, pulses: &[Pulse], echoes: &[Echo], seconds: f64) -> Option<Stratum> {
        let (first, last) = (pulses.first()?, pulses.last()?);
        let way = last.origin - first.origin;
        let along = DVec3::new(way.x, way.y, 0.0).normalize_or_zero();
        let mut found = Stratum {
            leg,
            pulses: pulses.len() as f64,
            points: echoes.len() as f64,
            seconds,
            beam_angle: beam_angle(pulses),
            way: way.x.hypot(way.y),
            flown_s: ((last.time_ns - first.time_ns) * 1e-9).max(0.0),
            view: View { origin: first.origin, right: DVec3::new(along.y, -along.x, 0.0), ..View::default() },
            ..Stratum::default()
        };
        for echo in echoes.iter().filter(|echo| echo.return_number == 1) {
            found.hits += 1.0;
            found.ranges += echo.range;
            found.view.see(echo.position);
        }
        Some(found)
    }

    /// Adds the next pulses of the leg.
    fn join(&mut self, next: &Stratum) {
        self.pulses += next.pulses;
        self.points += next.points;
        self.hits += next.hits;
        self.seconds += next.seconds;
        self.ranges += next.ranges;
        if self.beam_angle == 0.0 {
            self.beam_angle = next.beam_angle;
        }
        self.way += next.way;
        self.flown_s += next.flown_s;
        self.view.join(&next.view);
    }
}

impl View {
    /// Widens the view to an echo.
    fn see(&mut self, echo: DVec3) {
        let off = (echo - self.origin).dot(self.right);
        self.across = [self.across[0].min(off), self.across[1].max(off)];
        if self.farthest == DVec3::ZERO || self.distance(echo) > self.distance(self.farthest) {
            self.farthest = echo;
        }
    }

    fn join(&mut self, next: &View) {
        let [left, right] = next.across;
        self.across = [self.across[0].min(left), self.across[1].max(right)];
        if self.right == DVec3::ZERO {
            (self.origin, self.right) = (next.origin, next.right);
        }
        if next.farthest != DVec3::ZERO
            && (self.farthest == DVec3::ZERO || self.distance(next.farthest) > self.distance(self.farthest))
        {
            self.farthest = next.farthest;
        }
    }

    /// Horizontal distance, m.
    fn distance(&self, to: DVec3) -> f64 {
        (to.x - self.origin.x).hypot(to.y - self.origin.y)
    }
}

/// The median angle between successive beams of the first device, rad.
fn beam_angle(pulses: &[Pulse]) -> f64 {
    let beams: Vec<DVec3> = pulses.iter().filter(|p| p.device == 0).map(|p| p.attitude.forward()).collect();
    let mut angles: Vec<f64> = beams.windows(2).map(|b| b[0].cross(b[1]).length().min(1.0).asin()).collect();
    angles.sort_by(f64::total_cmp);
    angles.get(angles.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::spread;

    #[test]
    fn strata_are_all_measured_and_evenly_spread() {
        for count in [0, 1, 2, 5, 128, 200] {
            let mut order: Vec<usize> = spread(count).collect();
            if count == 128 {
                let mut few = order[..8].to_vec();
                few.sort_unstable();
                assert_eq!(few, [0, 16, 32, 48, 64, 80, 96, 112]);
            }
            order.sort_unstable();
            assert_eq!(order, (0..count).collect::<Vec<_>>());
        }
    }
}
