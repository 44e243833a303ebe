//! Chunks: descriptors of consecutive pulses, without the pulses themselves.

use std::time::{Duration, Instant};
use vlscan_base::error::{Error, Result};
use vlscan_lidar::flight::{FlightPlan, FlightState, Step};
use vlscan_lidar::platform::{PollResult, PoseReader};
use vlscan_scene::{MotionPlan, MotionState};
use vlscan_warehouse::{Feed, Outcome, Stop, Tasks};

/// Maximum number of steps per chunk, even if few of them emit pulses, because a requested stop is checked
/// between chunks.
const MAX_STEPS: u32 = 1 << 16;
/// Interval between checks for a requested stop while no pose arrives.
const STOP_CHECK_PERIOD: Duration = Duration::from_millis(100);

/// Consecutive steps of one leg: the state before the first step, and the number of steps. The producer only
/// counts the pulses; a worker replays the steps to obtain them.
#[derive(Clone)]
pub struct Chunk {
    /// Platform and devices before the first step.
    pub start: FlightState,
    /// Moving parts of the scene before the first step, if there are any.
    pub motion: Option<MotionState>,
    pub steps: u32,
    /// Pulses emitted in these steps.
    pub pulses: u32,
    /// Number of the leg in the survey.
    pub leg: u32,
    /// Fraction of the survey done after this chunk, 0–1; NaN when the end is unknown (a stream).
    pub done: f64,
    /// Poses to be written among the steps.
    poses: u32,
}

impl Tasks for Chunk {
    fn tasks(&self) -> u32 {
        self.pulses
    }
}

impl Chunk {
    fn begin(plan: &FlightPlan, state: &FlightState, motion: Option<&MotionState>) -> Chunk {
        Chunk {
            start: state.clone(),
            motion: motion.cloned(),
            steps: 0,
            pulses: 0,
            leg: state.leg_number(plan),
            done: f64::NAN,
            poses: 0,
        }
    }

    /// Takes up to `pulses` pulses of one leg from a flight; `None` at its end.
    pub fn take(
        plan: &FlightPlan,
        state: &mut FlightState,
        motion: Option<&MotionState>,
        pulses: u32,
    ) -> Result<Option<Chunk>> {
        loop {
            let mut chunk = Chunk::begin(plan, state, motion);
            let skipped = state.skip(plan, pulses, MAX_STEPS)?;
            (chunk.steps, chunk.pulses, chunk.poses) = (skipped.steps, skipped.pulses, skipped.poses);
            chunk.done = done(plan, state);
            if chunk.pulses > 0 {
                return Ok(Some(chunk));
            }
            if skipped.last == Step::Ended || skipped.last == Step::NeedsPoses {
                return Ok(None);
            }
        }
    }

    /// Takes up to `steps` steps of one leg from a flight, and the outcome of the last one.
    pub fn take_steps(
        plan: &FlightPlan,
        state: &mut FlightState,
        motion: Option<&MotionState>,
        steps: u32,
    ) -> Result<(Chunk, Step)> {
        let mut chunk = Chunk::begin(plan, state, motion);
        let skipped = state.skip(plan, u32::MAX, steps.min(MAX_STEPS))?;
        (chunk.steps, chunk.pulses, chunk.poses) = (skipped.steps, skipped.pulses, skipped.poses);
        chunk.done = done(plan, state);
        Ok((chunk, skipped.last))
    }

    fn has_content(&self) -> bool {
        self.pulses > 0 || self.poses > 0
    }

    /// Splits off the first pulse, with the steps up to it, as a separate chunk.
    fn split_first(&mut self, plan: &FlightPlan, motion: Option<&MotionPlan>) -> Result<Chunk> {
        let mut first = Chunk { steps: 0, pulses: 0, poses: 0, ..self.clone() };
        let skipped = self.start.skip(plan, 1, self.steps)?;
        (first.steps, first.pulses, first.poses) = (skipped.steps, skipped.pulses, skipped.poses);
        if let (Some(state), Some(plan)) = (&mut self.motion, motion) {
            (0..first.steps).for_each(|_| state.step(plan, |_, _| ()));
        }
        self.steps -= first.steps;
        self.pulses -= first.pulses;
        self.poses -= first.poses;
        Ok(first)
    }
}

/// Steps from `state`, the beginning of a flight, to its end and passes every chunk that is not empty to
/// `feed`. A chunk ends when it reaches the size set by the schedule, at the end of its leg, or when the next
/// pose takes longer than the stream's maximum latency. Returns early when the run is stopped, and after the
/// step that emits pulse number `limit`, counted from 1.
pub fn produce<R: Outcome, W: FnMut(Chunk) -> Result<R>>(
    plan: &FlightPlan,
    motion: Option<&MotionPlan>,
    state: &mut FlightState,
    mut poses: Option<PoseReader>,
    limit: u64,
    feed: &mut Feed<'_, Chunk, R, W>,
) -> Result<()> {
    let run = feed.state();
    let mut moving = motion.map(|motion| MotionState::after_steps(motion, state.steps()));
    let mut left = limit;
    if left == 0 {
        return Ok(());
    }
    let mut chunk = Chunk::begin(plan, state, moving.as_ref());
    loop {
        let size = feed.size();
        let mut first = None;
        let step = loop {
            let missing = u64::from(size.saturating_sub(chunk.pulses)).max(1).min(left);
            let skipped =
                state.skip(plan, missing.min(u64::from(u32::MAX)) as u32, MAX_STEPS - chunk.steps)?;
            chunk.steps += skipped.steps;
            chunk.pulses += skipped.pulses;
            chunk.poses += skipped.poses;
            left = left.saturating_sub(u64::from(skipped.pulses));
            if let (Some(state), Some(plan)) = (&mut moving, motion) {
                (0..skipped.steps).for_each(|_| state.step(plan, |_, _| ()));
            }
            if skipped.last == Step::NeedsPoses && chunk.has_content() && !run.is_stopped() {
                feed.flush()?;
                let since = *first.get_or_insert_with(Instant::now);
                let latency = poses.as_ref().map_or(Duration::ZERO, PoseReader::max_latency);
                let timeout = latency.saturating_sub(since.elapsed());
                if feed_poses_within(timeout, plan, &mut poses, &mut [&mut *state, &mut chunk.start]) {
                    continue;
                }
            }
            break skipped.last;
        };
        chunk.done = done(plan, state);
        let is_full = step == Step::Advanced && chunk.pulses >= size && left > 0;
        let rest = if is_full {
            feed.offer(chunk)?
        } else if chunk.has_content() {
            feed.put(chunk)?;
            None
        } else {
            None
        };
        match step {
            Step::Ended => {
                feed.end_leg()?;
                return Ok(());
            }
            _ if left == 0 => {
                feed.end_leg()?;
                return Ok(());
            }
            _ if run.is_stopped() => return Ok(()),
            Step::Advanced => {}
            Step::LegChanged => feed.end_leg()?,
            Step::NeedsPoses => {
                feed.flush()?;
                wait_for_poses(plan, &mut poses, state, &|| run.is_stopped())?;
            }
        }
        chunk = match rest {
            Some(mut rest) => {
                feed.compute(rest.split_first(plan, motion)?)?;
                rest
            }
            None => Chunk::begin(plan, state, moving.as_ref()),
        };
    }
}

/// Steps up to and including the step that emits pulse number `pulses`, counted from 1, or to the end of the
/// flight. Returns the number of pulses emitted.
///
/// # Errors
/// [`Error::Interrupted`] when a stop is requested; the errors of the flight.
pub fn skip(
    plan: &FlightPlan,
    state: &mut FlightState,
    poses: &mut Option<PoseReader>,
    pulses: u64,
    stop: &Stop,
) -> Result<u64> {
    let mut total = 0;
    while total < pulses {
        let missing = (pulses - total).min(u64::from(u32::MAX)) as u32;
        let skipped = state.skip(plan, missing, MAX_STEPS)?;
        total += u64::from(skipped.pulses);
        match skipped.last {
            Step::Advanced | Step::LegChanged => {}
            Step::NeedsPoses => wait_for_poses(plan, poses, state, &|| stop.is_requested())?,
            Step::Ended => break,
        }
        if stop.is_requested() {
            return Err(Error::Interrupted);
        }
    }
    Ok(total)
}

/// Waits for poses up to `timeout` and appends them to both ends of a chunk. Returns `false` if none arrived;
/// the end of the stream or its failure is then reported by [`wait_for_poses`].
fn feed_poses_within(
    timeout: Duration,
    plan: &FlightPlan,
    poses: &mut Option<PoseReader>,
    ends: &mut [&mut FlightState],
) -> bool {
    let Some(Ok(PollResult::Poses(block))) = poses.as_mut().map(|p| p.poll(timeout)) else { return false };
    ends.iter_mut().for_each(|state| state.feed(plan, block.clone()));
    true
}

/// Waits for poses and appends them, or ends the flight if no more will come. Returns early when `is_stopped`
/// returns true.
pub(super) fn wait_for_poses(
    plan: &FlightPlan,
    poses: &mut Option<PoseReader>,
    state: &mut FlightState,
    is_stopped: &dyn Fn() -> bool,
) -> Result<()> {
    let Some(poses) = poses else {
        state.end_poses();
        return Ok(());
    };
    loop {
        match poses.poll(STOP_CHECK_PERIOD)? {
            PollResult::Poses(block) => {
                state.feed(plan, block);
                return Ok(());
            }
            PollResult::End => {
                state.end_poses();
                return Ok(());
            }
            PollResult::TimedOut if is_stopped() => return Ok(()),
            PollResult::TimedOut => {}
        }
    }
}

/// Fraction of the flight that is done.
fn done(plan: &FlightPlan, state: &FlightState) -> f64 {
    if plan.is_stream() {
        return f64::NAN;
    }
    (state.leg_index() as f64 + state.progress(plan)) / plan.leg_count() as f64
}
