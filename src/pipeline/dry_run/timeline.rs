//! What a flight consists of: duration and pulses of its legs, and states at equal distances along it, from which a sample
//! is measured.
//!
//! A short flight is stepped to its end. Of a long one the durations come from the same flight with a coarse clock, and the
//! states from jumps ([`FlightState::jump`]); of a stream both come from its poses.

use super::super::chunk::wait_for_poses;
use crate::error::Result;
use crate::flight::{FlightPlan, FlightState, LegFacts, Step};
use crate::platform::{PollResult, Pose, PoseReader};
use crate::schedule::Stop;
use std::time::{Duration, Instant};

/// Pulses of a stratum that are measured at most.
pub const MAX_STRATUM_PULSES: u64 = 2048;
/// Pulses of a stratum of a short flight.
const MIN_STRATUM_PULSES: u64 = 512;
/// Number of strata; up to twice as many in flights that are stepped.
pub const STRATA: usize = 128;
/// Time for stepping through a flight.
const MAX_STEPPING: Duration = Duration::from_millis(200);
/// Steps between looks at the time.
const STEPS_PER_LOOK: u32 = 1 << 16;
/// Steps in which the share of fired pulses is counted, over all legs.
const COUNTED_STEPS: u64 = 20_000_000;
/// Poses of a stream that a sample is given.
const MAX_WINDOW: usize = 4096;
const POLL: Duration = Duration::from_millis(100);

/// A leg of the flight.
#[derive(Clone, Copy, Debug)]
pub struct LegTime {
    pub facts: LegFacts,
    pub seconds: f64,
    /// Pulses of all devices.
    pub pulses: f64,
}

/// A flight that is known without having been measured.
#[derive(Debug, Default)]
pub struct Timeline {
    /// The legs of the plan, in order.
    pub legs: Vec<LegTime>,
    /// Whether the pulses were counted.
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
        let leg = |i| LegTime { facts: flight.leg(i), seconds: 0.0, pulses: 0.0 };
        Timeline { legs: (0..flight.leg_count()).map(leg).collect(), ..Timeline::default() }
    }
}

/// Steps through the flight; `None` if that takes too long.
pub fn step_through(flight: &FlightPlan, stop: &Stop) -> Result<Option<Timeline>> {
    let until = Instant::now() + MAX_STEPPING;
    let mut all = Timeline::of_legs(flight);
    let (mut interval, mut since) = (MIN_STRATUM_PULSES, 0);
    let mut state = FlightState::start(flight);
    all.starts.push(state.clone());
    loop {
        let leg = state.leg_index();
        let skipped = state.skip(flight, (interval - since).min(1 << 30) as u32, STEPS_PER_LOOK)?;
        all.legs[leg].seconds += f64::from(skipped.steps) / all.legs[leg].facts.frequency;
        all.legs[leg].pulses += f64::from(skipped.pulses);
        since += u64::from(skipped.pulses);
        match skipped.last {
            Step::Ended => break,
            Step::NeedsPoses => wait_for_poses(flight, &mut None, &mut state, stop)?,
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
        if Instant::now() > until || stop.is_requested() {
            return Ok(None);
        }
    }
    (all.is_exact, all.interval) = (true, interval as f64);
    Ok(Some(all))
}

/// Estimates the flight; `coarse` is the same one with inactive legs and a coarse clock.
pub fn estimate(flight: &FlightPlan, coarse: &FlightPlan) -> Result<Timeline> {
    let mut all = Timeline::of_legs(flight);
    let mut state = FlightState::start(coarse);
    loop {
        let leg = state.leg_index();
        let skipped = state.skip(coarse, u32::MAX, u32::MAX)?;
        all.legs[leg].seconds += f64::from(skipped.steps) / coarse.leg(leg).frequency;
        if skipped.last == Step::Ended {
            break;
        }
    }
    let counted = (COUNTED_STEPS / all.legs.len().max(1) as u64).clamp(2000, 100_000) as u32;
    let mut state = FlightState::start(flight);
    let mut entries = Vec::with_capacity(all.legs.len());
    for leg in &mut all.legs {
        entries.push(state.clone());
        let steps = (leg.seconds * leg.facts.frequency).round() as u64;
        if leg.facts.active && steps > 0 {
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
            let steps = (next - before) / leg.pulses * leg.seconds * leg.facts.frequency;
            let mut start = entry.clone();
            start.jump(flight, steps as u64);
            all.starts.push(start);
            next = all.interval * (all.starts.len() as f64 + 0.5);
        }
        before += leg.pulses;
    }
    Ok(all)
}

/// Reads a stream to its end and estimates the flight along its poses, `max_gap` s apart at most where it is flown.
pub fn follow(flight: &FlightPlan, poses: &mut PoseReader, max_gap: f64, stop: &Stop) -> Result<Timeline> {
    let mut all = Timeline::of_legs(flight);
    let mut track: Vec<Pose> = Vec::new();
    loop {
        match poses.poll(POLL)? {
            PollResult::Poses(block) => track.extend(block),
            PollResult::End => break,
            PollResult::TimedOut if stop.is_requested() => break,
            PollResult::TimedOut => {}
        }
    }
    let flown = |pair: &[Pose]| {
        let apart = pair[1].time - pair[0].time;
        if apart > 0.0 && apart <= max_gap { apart } else { 0.0 }
    };
    let seconds: f64 = track.windows(2).map(flown).sum();
    let facts = all.legs[0].facts;
    let steps = seconds * facts.frequency;
    // The mean share of fired pulses, and steps after which a stratum is complete.
    let start_at = |index: usize, steps: f64| {
        let first = index.saturating_sub(1);
        let until = track[first].time + (steps + 2.0) / facts.frequency;
        let mut end = first;
        while end < track.len().min(first + MAX_WINDOW) && track[end].time <= until {
            end += 1;
        }
        let mut state = FlightState::start(flight);
        state.feed(flight, track[first..(end + 2).min(track.len())].to_vec());
        state.end_poses();
        state
    };
    if track.len() < 2 || steps < 1.0 || !facts.active {
        all.legs[0].seconds = seconds;
        return Ok(all);
    }
    let mut probe = start_at(1, 100_000.0);
    let skipped = probe.skip(flight, u32::MAX, 100_000)?;
    let fired = f64::from(skipped.pulses) / f64::from(skipped.steps.max(1));
    all.legs[0] = LegTime { facts, seconds, pulses: steps * fired };
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
