//! Chunks: descriptors of consecutive pulses, not the pulses themselves.

use crate::error::Result;
use crate::flight::{FlightPlan, FlightSink, FlightState, PoseSample, Pulse, Step};
use crate::platform::{PoseReader, Waited};
use crate::scene::{MotionPlan, MotionState};
use crate::schedule::{Feed, Outcome, Stop, Tasks};
use std::time::{Duration, Instant};

/// Steps after which a chunk ends although few of them fired: the wish to stop is looked at between chunks.
const MAX_STEPS: u32 = 1 << 16;
/// How often the wish to stop is looked at while no pose arrives.
const LOOK: Duration = Duration::from_millis(100);

/// Consecutive steps of one leg: the state before the first of them, and how many there are. Whoever replays them gets
/// the pulses; the producer only counted them.
#[derive(Clone)]
pub struct Chunk {
    /// Platform and devices as they were before the first step.
    pub start: FlightState,
    /// Moving parts of the scene as they were then, if there are any.
    pub movers: Option<MotionState>,
    /// Number of steps.
    pub steps: u32,
    /// Pulses among them.
    pub pulses: u32,
    /// Number of the leg in the survey.
    pub leg: u32,
    /// Done part of the survey after this chunk, 0–1; NaN when its end is not known (a stream).
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
    /// No steps yet.
    fn begin(plan: &FlightPlan, state: &FlightState, movers: Option<&MotionState>) -> Chunk {
        Chunk {
            start: state.clone(),
            movers: movers.cloned(),
            steps: 0,
            pulses: 0,
            leg: state.leg(plan),
            done: f64::NAN,
            poses: 0,
        }
    }

    /// Whether anything comes of it.
    fn yields(&self) -> bool {
        self.pulses > 0 || self.poses > 0
    }

    /// Takes off its first pulse, with the steps that lead to it, as a chunk of its own.
    fn split_first(&mut self, plan: &FlightPlan, movers: Option<&MotionPlan>) -> Result<Chunk> {
        let mut first = Chunk { steps: 0, pulses: 0, poses: 0, ..self.clone() };
        let mut count = Count::default();
        while count.pulses == 0 && first.steps < self.steps {
            self.start.step(plan, &mut count)?;
            if let (Some(state), Some(plan)) = (&mut self.movers, movers) {
                state.step(plan, |_, _| ());
            }
            first.steps += 1;
        }
        (first.pulses, first.poses) = (count.pulses, count.poses);
        self.steps -= first.steps;
        self.pulses -= first.pulses;
        self.poses -= first.poses;
        Ok(first)
    }
}

/// Counts what a step would yield without computing it.
#[derive(Default)]
struct Count {
    pulses: u32,
    poses: u32,
}

impl FlightSink for Count {
    fn pulse(&mut self, _: impl FnOnce() -> Pulse) {
        self.pulses += 1;
    }

    fn pose(&mut self, _: impl FnOnce() -> PoseSample) {
        self.poses += 1;
    }
}

/// Where chunks go; see [`Feed`] for what its methods mean.
pub trait Outlet {
    /// Pulses that the chunk in the making shall hold.
    fn size(&self) -> u32;
    /// Takes a chunk of that size, or gives it back for its first pulse to be computed.
    fn offer(&mut self, chunk: Chunk) -> Result<Option<Chunk>>;
    /// Takes a chunk that ends early.
    fn put(&mut self, chunk: Chunk) -> Result<()>;
    /// Computes a chunk now.
    fn compute(&mut self, chunk: Chunk) -> Result<()>;
    /// It may be long before anything else comes.
    fn settle(&mut self) -> Result<()>;
    /// All chunks of a leg have come.
    fn leg_ended(&mut self) -> Result<()>;
}

impl<R: Outcome, W: FnMut(Chunk) -> Result<R>> Outlet for Feed<'_, Chunk, R, W> {
    fn size(&self) -> u32 {
        Feed::size(self)
    }

    fn offer(&mut self, chunk: Chunk) -> Result<Option<Chunk>> {
        Feed::offer(self, chunk)
    }

    fn put(&mut self, chunk: Chunk) -> Result<()> {
        Feed::put(self, chunk)
    }

    fn compute(&mut self, chunk: Chunk) -> Result<()> {
        Feed::compute(self, chunk)
    }

    fn settle(&mut self) -> Result<()> {
        Feed::settle(self)
    }

    fn leg_ended(&mut self) -> Result<()> {
        Feed::leg_ended(self)
    }
}

/// Steps from `state`, the beginning of a flight, through the whole of it and puts every chunk that yields anything into
/// `outlet`. A chunk ends when it has the size that the outlet wants, at the end of its leg, or when the next pose
/// keeps it waiting for longer than the stream of poses allows. Returns early when `stop` is asked.
pub fn produce(
    plan: &FlightPlan,
    movers: Option<&MotionPlan>,
    state: &mut FlightState,
    mut poses: Option<PoseReader>,
    stop: &Stop,
    outlet: &mut impl Outlet,
) -> Result<()> {
    let mut moving = movers.map(MotionState::start);
    let mut chunk = Chunk::begin(plan, state, moving.as_ref());
    loop {
        let size = outlet.size();
        let mut count = Count { pulses: chunk.pulses, poses: chunk.poses };
        let mut first = None;
        let step = loop {
            let step = state.step(plan, &mut count)?;
            if step != Step::Went {
                let waiting = count.pulses > 0 || count.poses > 0;
                if step == Step::NeedsPoses && waiting && !stop.asked() {
                    outlet.settle()?;
                    let since = *first.get_or_insert_with(Instant::now);
                    let latency = poses.as_ref().map_or(Duration::ZERO, PoseReader::latency);
                    let patience = latency.saturating_sub(since.elapsed());
                    if more_poses(plan, &mut poses, &mut [&mut *state, &mut chunk.start], patience) {
                        continue;
                    }
                }
                break step;
            }
            chunk.steps += 1;
            if let (Some(state), Some(plan)) = (&mut moving, movers) {
                state.step(plan, |_, _| ());
            }
            if count.pulses >= size || chunk.steps >= MAX_STEPS {
                break step;
            }
        };
        (chunk.pulses, chunk.poses) = (count.pulses, count.poses);
        chunk.done = done(plan, state);
        let is_full = step == Step::Went && chunk.pulses >= size;
        let rest = if is_full {
            outlet.offer(chunk)?
        } else if chunk.yields() {
            outlet.put(chunk)?;
            None
        } else {
            None
        };
        match step {
            Step::Ended => {
                outlet.leg_ended()?;
                return Ok(());
            }
            _ if stop.asked() => return Ok(()),
            Step::Went => {}
            Step::LegChanged => outlet.leg_ended()?,
            Step::NeedsPoses => {
                outlet.settle()?;
                wait_for_poses(plan, &mut poses, state, stop)?;
            }
        }
        chunk = match rest {
            Some(mut rest) => {
                outlet.compute(rest.split_first(plan, movers)?)?;
                rest
            }
            None => Chunk::begin(plan, state, moving.as_ref()),
        };
    }
}

/// Feeds poses that arrive within `patience` to both ends of a chunk, whose first steps do not see them. `false` if none
/// did: the stream's end and its failure are met again by [`wait_for_poses`].
fn more_poses(
    plan: &FlightPlan,
    poses: &mut Option<PoseReader>,
    ends: &mut [&mut FlightState],
    patience: Duration,
) -> bool {
    let Some(Ok(Waited::Poses(block))) = poses.as_mut().map(|p| p.wait(patience)) else { return false };
    ends.iter_mut().for_each(|state| state.feed(plan, block.clone()));
    true
}

fn wait_for_poses(
    plan: &FlightPlan,
    poses: &mut Option<PoseReader>,
    state: &mut FlightState,
    stop: &Stop,
) -> Result<()> {
    let Some(poses) = poses else {
        state.end_of_poses();
        return Ok(());
    };
    loop {
        match poses.wait(LOOK)? {
            Waited::Poses(block) => {
                state.feed(plan, block);
                return Ok(());
            }
            Waited::End => {
                state.end_of_poses();
                return Ok(());
            }
            Waited::Nothing if stop.asked() => return Ok(()),
            Waited::Nothing => {}
        }
    }
}

/// The done part of the whole flight.
fn done(plan: &FlightPlan, state: &FlightState) -> f64 {
    if plan.follows_stream() {
        return f64::NAN;
    }
    (state.leg_index() as f64 + state.progress(plan)) / plan.legs() as f64
}
