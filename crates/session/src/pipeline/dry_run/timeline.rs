//! Timeline of a flight: duration and pulses of its legs, and states at equal distances along it, from
//! which a sample is measured.
//!
//! A short flight is stepped to its end. Of a long one the durations come from the same flight with a coarse
//! clock, and the states from jumps ([`FlightState::jump`]); of a stream both come from its poses.

use super::super::chunk::wait_for_poses;
use super::super::session::Session;
use std::time::Duration;
use vlscan_base::error::{Error, Result};
use vlscan_lidar::flight::{FlightPlan, FlightState, LegClock, Step};
use vlscan_lidar::platform::{PollResult, Pose, PoseReader};
use vlscan_survey::PlatformKind;
use vlscan_warehouse::Stop;

/// Pulses of a stratum that are measured at most.
pub const MAX_STRATUM_PULSES: u64 = 2048;
/// Pulses of a stratum of a short flight.
const MIN_STRATUM_PULSES: u64 = 512;
/// Number of strata; up to twice as many in flights that are stepped.
pub const STRATA: usize = 128;
/// Maximum number of steps through a flight, about 0.2 s. A count instead of a time, so that the same flight
/// is always or never stepped through.
const MAX_STEPS: u64 = 100_000_000;
/// Number of steps at once that take as long as a single step.
const STEPS_PER_SINGLE: u64 = 16;
/// Steps between looks at a requested stop.
const STEPS_PER_LOOK: u32 = 1 << 16;
/// Maximum number of steps, over all legs, in which the share of fired pulses is counted.
const MAX_COUNTED_STEPS: u64 = 20_000_000;
/// Poses of a stream that a sample is given.
const MAX_WINDOW: usize = 4096;
/// Maximum number of poses of a stream, all of which are kept; almost 3 hours at 1000 per second.
const MAX_POSES: usize = 10_000_000;
const POLL: Duration = Duration::from_millis(100);

/// A leg of the flight.
#[derive(Clone, Copy, Debug)]
pub struct LegTime {
    pub clock: LegClock,
    pub seconds: f64,
    /// Pulses of all devices.
    pub pulses: f64,
}

impl LegTime {
    /// Number of samples of the trajectory.
    pub fn poses(&self) -> f64 {
        let is_sampled = self.clock.active && self.clock.sample_interval > 0.0;
        if is_sampled { (self.seconds / self.clock.sample_interval).ceil() } else { 0.0 }
    }
}

/// A flight that is known without having been measured.
#[derive(Debug, Default)]
pub struct Timeline {
    /// The legs of the plan, in order.
    pub legs: Vec<LegTime>,
    /// True if the pulses were counted.
    pub is_exact: bool,
    /// States from which equal numbers of pulses follow, in order.
    pub starts: Vec<FlightState>,
    /// Pulses from one of these states to the next.
    pub interval: f64,
}

impl Timeline {
    pub fn pulses(&self) -> f64 {
        self.legs.iter().map(|leg| leg.pulses).sum()
    }

    pub fn seconds(&self) -> f64 {
        self.legs.iter().map(|leg| leg.seconds).sum()
    }

    fn of_legs(flight: &FlightPlan) -> Timeline {
        let leg = |i| LegTime { clock: flight.leg(i), seconds: 0.0, pulses: 0.0 };
        Timeline { legs: (0..flight.leg_count()).map(leg).collect(), ..Timeline::default() }
    }
}

impl Session {
    /// Numbers of the legs of a flight along waypoints, each with the time from the start of the flight to
    /// that of the leg, s. Empty for recorded flights, whose poses have times, for stationary platforms in
    /// scenes without moving parts, and for flights of more than 100 million steps.
    ///
    /// # Errors
    /// As for [`Session::plan_flight`].
    pub fn leg_starts(&self, stop: &Stop) -> Result<Vec<(u32, f64)>> {
        let kind = &self.survey().platform.kind;
        let is_still = matches!(kind, PlatformKind::Static) && self.motion().is_none();
        if is_still || matches!(kind, PlatformKind::Interpolated(_) | PlatformKind::Stream(_)) {
            return Ok(Vec::new());
        }
        let (flight, _) = self.plan_flight_quietly()?;
        let Some(timeline) = step_through(&flight, stop)? else { return Ok(Vec::new()) };
        let mut next = 0.0;
        let starts = timeline.legs.iter().map(|leg| {
            let start = next;
            next += leg.seconds;
            (leg.clock.number, start)
        });
        Ok(starts.collect())
    }

    /// GPS time at which a flight with weather over time ends, s of the week. `None` for flights without such
    /// weather, recorded flights, flights of more than 100 million steps, and legs that cannot be flown,
    /// which a run reports and pulses of a table do not need.
    pub(in super::super) fn end_of_weather_flight(&self) -> Option<f64> {
        let survey = self.survey();
        let is_recorded =
            matches!(survey.platform.kind, PlatformKind::Interpolated(_) | PlatformKind::Stream(_));
        if is_recorded || survey.legs.iter().all(|leg| leg.scanner.weather.over_time.is_none()) {
            return None;
        }
        let (flight, _) = self.plan_flight_quietly().ok()?;
        let timeline = step_through(&flight, &Stop::new()).ok()??;
        Some(self.settings().flight.gps_start_ns / 1e9 + timeline.seconds())
    }
}

/// Steps through the flight; `None` if it has too many steps.
pub fn step_through(flight: &FlightPlan, stop: &Stop) -> Result<Option<Timeline>> {
    let mut taken = 0;
    let mut all = Timeline::of_legs(flight);
    let (mut interval, mut since) = (MIN_STRATUM_PULSES, 0);
    let mut state = FlightState::start(flight);
    all.starts.push(state.clone());
    loop {
        let leg = state.leg_index();
        let skipped = state.skip(flight, (interval - since).min(1 << 30) as u32, STEPS_PER_LOOK)?;
        all.legs[leg].seconds += f64::from(skipped.steps) / all.legs[leg].clock.frequency;
        all.legs[leg].pulses += f64::from(skipped.pulses);
        since += u64::from(skipped.pulses);
        taken += u64::from(skipped.steps) + (STEPS_PER_SINGLE - 1) * u64::from(skipped.single_steps);
        match skipped.last {
            Step::Ended => break,
            Step::NeedsPoses => wait_for_poses(flight, &mut None, &mut state, &|| stop.is_requested())?,
            Step::Advanced | Step::LegChanged => {}
        }
        if since >= interval {
            since = 0;
            all.starts.push(state.clone());
            if all.starts.len() > 2 * STRATA {
                let mut keep = false;
                all.starts.retain(|_| {
                    keep = !keep;
                    keep
                });
                interval *= 2;
            }
        }
        if taken > MAX_STEPS || stop.is_requested() {
            return Ok(None);
        }
    }
    (all.is_exact, all.interval) = (true, interval as f64);
    Ok(Some(all))
}

/// Estimates the flight; `coarse` is the same one with inactive legs and a coarse clock.
///
/// # Errors
/// [`Error::Interrupted`], and those of the flight.
pub fn estimate(flight: &FlightPlan, coarse: &FlightPlan, stop: &Stop) -> Result<Timeline> {
    let mut all = Timeline::of_legs(flight);
    let mut state = FlightState::start(coarse);
    loop {
        let leg = state.leg_index();
        check(stop)?;
        let skipped = state.skip(coarse, u32::MAX, STEPS_PER_LOOK)?;
        all.legs[leg].seconds += f64::from(skipped.steps) / coarse.leg(leg).frequency;
        if skipped.last == Step::Ended {
            break;
        }
    }
    let counted = (MAX_COUNTED_STEPS / all.legs.len().max(1) as u64).clamp(2000, 100_000) as u32;
    let mut state = FlightState::start(flight);
    let mut entries = Vec::with_capacity(all.legs.len());
    for leg in &mut all.legs {
        check(stop)?;
        entries.push(state.clone());
        let steps = (leg.seconds * leg.clock.frequency).round() as u64;
        if leg.clock.active && steps > 0 {
            let mut probe = state.clone();
            probe.jump(flight, steps / 2);
            let skipped = probe.skip(flight, u32::MAX, counted.min(steps.div_ceil(2) as u32).max(1))?;
            leg.pulses = steps as f64 * f64::from(skipped.pulses) / f64::from(skipped.steps.max(1));
        }
        state.skip_leg(flight);
    }
    all.interval = all.pulses() / STRATA as f64;
    let mut before = 0.0;
    for (leg, entry) in all.legs.iter().zip(entries) {
        let mut next = all.interval * (all.starts.len() as f64 + 0.5);
        while leg.pulses > 0.0 && next < before + leg.pulses {
            let steps = (next - before) / leg.pulses * leg.seconds * leg.clock.frequency;
            let mut start = entry.clone();
            start.jump(flight, steps as u64);
            all.starts.push(start);
            next = all.interval * (all.starts.len() as f64 + 0.5);
        }
        before += leg.pulses;
    }
    Ok(all)
}

/// [`Error::Interrupted`] if a stop is requested.
fn check(stop: &Stop) -> Result<()> {
    if stop.is_requested() { Err(Error::Interrupted) } else { Ok(()) }
}

/// Reads at most this many poses of a stream to its end.
fn read_track(poses: &mut PoseReader, max_poses: usize, stop: &Stop) -> Result<Vec<Pose>> {
    let mut track: Vec<Pose> = Vec::new();
    loop {
        check(stop)?;
        match poses.poll(POLL)? {
            PollResult::Poses(block) => track.extend(block),
            PollResult::End => return Ok(track),
            PollResult::TimedOut => {}
        }
        if track.len() > max_poses {
            return Err(Error::input(format!(
                "the trajectory has more than {max_poses} poses, the maximum for a dry run"
            )));
        }
    }
}

/// Reads a stream to its end and estimates the flight along its poses, `max_gap` s apart at most where it is
/// flown.
///
/// # Errors
/// [`Error::Interrupted`], [`Error::Input`] for more than [`MAX_POSES`] poses, and those of stream and
/// flight.
pub fn follow(flight: &FlightPlan, poses: &mut PoseReader, max_gap: f64, stop: &Stop) -> Result<Timeline> {
    let mut all = Timeline::of_legs(flight);
    let track = read_track(poses, MAX_POSES, stop)?;
    let flown = |pair: &[Pose]| {
        let apart = pair[1].time - pair[0].time;
        if apart > 0.0 && apart <= max_gap { apart } else { 0.0 }
    };
    let seconds: f64 = track.windows(2).map(flown).sum();
    let clock = all.legs[0].clock;
    let steps = seconds * clock.frequency;
    // The mean share of fired pulses, and steps after which a stratum is complete.
    let start_at = |index: usize, steps: f64| {
        let first = index.saturating_sub(1);
        let until = track[first].time + (steps + 2.0) / clock.frequency;
        let mut end = first;
        while end < track.len().min(first + MAX_WINDOW) && track[end].time <= until {
            end += 1;
        }
        let mut state = FlightState::start(flight);
        state.feed(flight, track[first..(end + 2).min(track.len())].to_vec());
        state.end_poses();
        state
    };
    if track.len() < 2 || steps < 1.0 || !clock.active {
        all.legs[0].seconds = seconds;
        return Ok(all);
    }
    let mut probe = start_at(1, 100_000.0);
    let skipped = probe.skip(flight, u32::MAX, 100_000)?;
    let fired = f64::from(skipped.pulses) / f64::from(skipped.steps.max(1));
    all.legs[0] = LegTime { clock, seconds, pulses: steps * fired };
    let strata = ((steps * fired / MAX_STRATUM_PULSES as f64).ceil() as usize).clamp(1, STRATA);
    all.interval = steps * fired / strata as f64;
    let needed = MAX_STRATUM_PULSES as f64 / fired.max(1e-3);
    let mut before = 0.0;
    for index in 1..track.len() {
        let here = flown(&track[index - 1..=index]);
        while all.starts.len() < strata
            && before + here > seconds * (all.starts.len() as f64 + 0.5) / strata as f64
        {
            all.starts.push(start_at(index, needed));
        }
        before += here;
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use vlscan_geom::DVec3;
    use vlscan_lidar::flight::FlightOptions;
    use vlscan_survey::{PoseStream, testkit};
    use vlscan_tables::input::InputStream;

    /// Lines of poses without end.
    struct Endless(u64);

    impl Read for Endless {
        fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
            self.0 += 1;
            let line = format!("{} 0 0 100 0 0 0\n", self.0);
            to[..line.len()].copy_from_slice(line.as_bytes());
            Ok(line.len())
        }
    }

    #[test]
    fn endless_streams_are_refused_and_can_be_interrupted() {
        let mut poses = PoseReader::new(InputStream::from_reader(Endless(0)), &PoseStream::at("-"));
        match read_track(&mut poses, 1000, &Stop::new()) {
            Err(Error::Input(problems)) => assert!(problems.text().contains("more than 1000 poses")),
            other => panic!("{other:?}"),
        }
        let stop = Stop::new();
        stop.request();
        assert!(matches!(read_track(&mut poses, usize::MAX, &stop), Err(Error::Interrupted)));
    }

    #[test]
    fn estimates_can_be_interrupted() {
        let mut survey = testkit::survey(vec![testkit::device()]);
        survey.platform.kind = PlatformKind::LinearPath;
        survey.legs = (0..2).map(|i| testkit::leg(i, testkit::scanner_settings(1000))).collect();
        survey.legs[1].platform.position.x = 10.0;
        let plan = FlightPlan::new(&survey, DVec3::ZERO, &|_, _| None, &FlightOptions::default());
        let (flight, _) = plan.unwrap();
        assert!(estimate(&flight, &flight, &Stop::new()).is_ok());
        let stop = Stop::new();
        stop.request();
        assert!(matches!(estimate(&flight, &flight, &stop), Err(Error::Interrupted)));
    }
}
