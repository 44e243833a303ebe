//! The wiring of the river, short enough to read in a minute: [`fly`] joins the flight's chunks, the workers and the
//! sinks. [`emit`] and [`trace`] are its two halves with a stream of pulses between them.

mod aim;
mod chunk;
mod collector;
mod emit;
mod progress;
mod trace;
mod worker;

pub use aim::{Aim, AimLog, AimTarget};
pub use chunk::{Chunk, Outlet, produce};
pub use emit::{Emission, Emitted, emit};
pub use progress::{Progress, Snapshot};
pub use trace::{LegRule, PulseSource, Sinks, TraceEnded, Tracing, trace};

use crate::error::Result;
use crate::flight::{FlightPlan, FlightState};
use crate::output::{Offload, OutputPlan, Summary, Writer};
use crate::platform::PoseReader;
use crate::pulse::Physics;
use crate::scene::MotionPlan;
use crate::schedule::{self, Job, JobQueue, Recorder, Stop};
use crate::tree::BuildOptions;
use collector::{Closed, Collector};
use std::sync::Arc;
use worker::Worker;

/// Everything that a run needs, resolved: nothing below reads the command line, the environment or the clock.
pub struct Run<'a> {
    /// Clock, legs, platform, optics.
    pub flight: &'a FlightPlan,
    /// Scene, tree, instruments.
    pub physics: &'a Physics<'a>,
    /// Parts of the scene that move, if any do, and how their trees are built.
    pub movers: Option<(&'a MotionPlan, &'a BuildOptions)>,
    /// Sinks.
    pub output: Arc<OutputPlan>,
    /// Poses of a streamed platform as they arrive.
    pub poses: Option<PoseReader>,
    /// Threads, and how pulses are handed out to them.
    pub schedule: schedule::Settings,
    /// Takes down what the schedule does.
    pub recorder: Option<&'a Recorder>,
    /// The user's wish to end.
    pub stop: &'a Stop,
    /// What has been done so far, for whoever watches.
    pub progress: &'a Progress,
    /// What beams are compared with.
    pub target: AimTarget,
    /// Looks at what was measured before the outputs get their names.
    pub judge: Option<Judge<'a>>,
}

/// Looks at a run for results that cannot be meant; an error ends it before its outputs are complete.
pub type Judge<'a> = &'a (dyn Fn(&Progress, Moment) -> Result<()> + Sync);

/// When a run is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// After the first ten thousands of pulses.
    Early,
    /// When everything is measured.
    End,
}

/// What goes on from one play of a survey with swapped parts to the next.
pub struct Interval {
    writer: Writer,
    state: FlightState,
}

/// How a play ended.
pub enum Ended {
    /// It was the last: the outputs are complete and have their names.
    Whole(Summary),
    /// Another one follows; its outputs are open.
    Play(Box<Interval>),
    /// The user ended the run: the outputs hold what was measured until then, and say so.
    Cut(Summary),
}

/// Flies the survey once: chunks → schedule → workers (replay, trace, detect, encode) → sinks in chunk order. When this
/// fails, outputs that are not complete are gone.
///
/// The first play begins `after` nothing, every other one after the play before: its legs begin anew, while the clock
/// and the numbers of pulses go on. `is_last` says that none follows.
pub fn fly(run: Run<'_>, after: Option<Box<Interval>>, is_last: bool) -> Result<Ended> {
    let jobs = Arc::new(JobQueue::new(2 * run.schedule.threads));
    let (writer, mut state) = match after {
        None => (run.output.open(jobs.clone())?, FlightState::start(run.flight)),
        Some(before) => {
            let Interval { mut writer, mut state } = *before;
            state.repeat(run.flight);
            writer.offload_to(jobs.clone());
            (writer, state)
        }
    };
    let Run { flight, physics, movers, output, poses, target, .. } = run;
    let closed = schedule::run(
        run.schedule,
        &jobs,
        run.stop,
        run.recorder,
        || {
            let mut worker = Worker::new(flight, physics, movers, &output, target);
            move |chunk| worker.measure(chunk)
        },
        |feed| produce(flight, movers.map(|(plan, _)| plan), &mut state, poses, run.stop, feed),
        Collector::new(writer, run.progress, is_last, run.judge),
    )?;
    Ok(match closed {
        Closed::Whole(summary) => Ended::Whole(summary),
        Closed::Cut(writer) => Ended::Cut(writer.finish_partial()?),
        Closed::Play(writer) => Ended::Play(Box::new(Interval { writer: *writer, state })),
    })
}

/// Compression is taken over by the workers.
impl Offload for JobQueue {
    fn try_run(&self, job: Job) -> std::result::Result<(), Job> {
        JobQueue::try_run(self, job)
    }
}
