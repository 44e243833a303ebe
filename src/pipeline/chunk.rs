//! Chunks: descriptors of consecutive pulses, not the pulses themselves.

use crate::error::Result;
use crate::flight::{FlightPlan, FlightSink, FlightState, PoseSample, Pulse, Step};
use crate::platform::PoseReader;
use crate::scene::{MoverState, Movers};
use crate::schedule::Stop;

/// Steps after which a chunk ends although few of them fired: the wish to stop is looked at between chunks.
const MAX_STEPS: u32 = 1 << 16;

/// Consecutive steps of one leg: the state before the first of them, and how many there are. Whoever replays them gets
/// the pulses; the producer only counted them.
#[derive(Clone)]
pub struct Chunk {
    /// Platform and devices as they were before the first step.
    pub start: FlightState,
    /// Moving parts of the scene as they were then, if there are any.
    pub movers: Option<MoverState>,
    /// Number of steps.
    pub steps: u32,
    /// Pulses among them.
    pub pulses: u32,
    /// Number of the leg in the survey.
    pub leg: u32,
    /// Done part of the survey after this chunk, 0–1; NaN when its end is not known (a stream).
    pub done: f64,
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

/// Steps from `state`, the beginning of a flight, through the whole of it and puts every chunk that yields anything. A
/// chunk ends after `size` pulses, at the end of its leg, or when the next pose has not arrived yet. Returns early when
/// `stop` is asked.
pub fn produce(
    plan: &FlightPlan,
    movers: Option<&Movers>,
    state: &mut FlightState,
    mut poses: Option<PoseReader>,
    size: u32,
    stop: &Stop,
    mut put: impl FnMut(Chunk) -> Result<()>,
) -> Result<()> {
    let mut moving = movers.map(|plan| (plan, MoverState::start(plan)));
    loop {
        let start = state.clone();
        let movers = moving.as_ref().map(|(_, state)| state.clone());
        let mut count = Count::default();
        let mut steps = 0;
        let step = loop {
            let step = state.step(plan, &mut count)?;
            if step != Step::Went {
                break step;
            }
            steps += 1;
            if let Some((plan, state)) = &mut moving {
                state.step(plan, |_, _| ());
            }
            if count.pulses >= size || steps >= MAX_STEPS {
                break step;
            }
        };
        if count.pulses > 0 || count.poses > 0 {
            let (leg, done) = (start.leg(plan), done(plan, state));
            put(Chunk { start, movers, steps, pulses: count.pulses, leg, done })?;
        }
        match step {
            Step::Ended => return Ok(()),
            _ if stop.asked() => return Ok(()),
            Step::Went | Step::LegChanged => {}
            Step::NeedsPoses => match poses.as_mut().map(PoseReader::next_block).transpose()?.flatten() {
                Some(block) => state.feed(plan, block),
                None => state.end_of_poses(),
            },
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
