//! The wiring of the whole program. A [`Session`] is given resolved [`Settings`]; it loads the scene, builds the tree, and
//! flies the survey over it or traces a stream of pulses, once for every epoch of a scene with swapped parts:
//!
//! ```text
//! Settings ─► Session::open ─► run ────────────────► fly ──┐ pass over   ┌─► next epoch
//!                            ├ trace(stream of pulses) ────┴─ an epoch ──┴─► Report
//!                            └ into_emission ─► emit: poses or pulses without tracing
//! ```
//!
//! | file | what |
//! |---|---|
//! | `settings` | everything that is chosen before the start |
//! | `session` | loading, the loop over epochs, the report |
//! | `load` | scene and tree of an epoch, refused if they need too much memory |
//! | `chunk` | the producer: steps of the flight become chunks |
//! | `stream` | the other producer: rows of a stream of pulses |
//! | `worker`, `moving` | the computing stage, and the moving parts that its pulses see |
//! | `collector` | the last stage: encoded pieces to the outputs, in order |
//! | `emit` | the flight alone, written as poses or pulses |
//! | `plausibility`, `aim` | inputs that are valid but can hardly be meant |
//! | `progress` | what has been done so far |

mod aim;
mod chunk;
mod collector;
mod emit;
mod load;
mod moving;
mod plausibility;
mod progress;
mod session;
mod settings;
mod stream;
mod worker;

pub use aim::{Aim, AimLog, AimTarget};
pub use chunk::Chunk;
pub use collector::Ended;
pub use emit::{Emission, Emitted, emit};
pub use plausibility::{CheckTime, YieldCheck, target};
pub use progress::{Progress, Snapshot};
pub use session::{Control, Report, Session};
pub use settings::{DEFAULT_CHUNK_SIZE, DEFAULT_LATENCY, DEFAULT_WAREHOUSE_FACTOR, Settings};
pub use stream::{LegRule, PulseSource, Tracing};

use crate::error::Result;
use crate::flight::{FlightPlan, FlightState};
use crate::output::{Offload, OutputPlan, Writer};
use crate::platform::PoseReader;
use crate::pulse::Physics;
use crate::scene::MotionPlan;
use crate::schedule::{self, Feed, Job, JobQueue, Schedule, Tasks};
use crate::tree::BuildOptions;
use collector::Collector;
use std::sync::Arc;
use stream::StreamWorker;
use worker::{FlightWorker, Measured};

/// What a pass over one epoch's scene needs, whether its pulses come from a flight or from a stream.
pub struct Pass<'a> {
    /// Scene, tree, instruments.
    pub physics: &'a Physics<'a>,
    /// Moving parts of the scene, if there are any.
    pub motion: Option<&'a MotionPlan>,
    /// How the trees over moving parts are built.
    pub trees: &'a BuildOptions,
    /// Outputs.
    pub output: Arc<OutputPlan>,
    /// Threads, and how pulses are distributed to them.
    pub schedule: Schedule,
    /// Progress, wish to stop, records.
    pub control: Control<'a>,
    /// What beams are compared with.
    pub target: AimTarget,
    /// Looks for too few points before the outputs get their names.
    pub check: Option<YieldCheck<'a>>,
    /// No epoch follows.
    pub is_last: bool,
}

/// Flies the survey over one epoch: chunks → schedule → workers (replay, trace, detect, encode) → outputs in chunk order.
/// `state` is that before the first step of the epoch, `writer` holds the outputs of the epoch before. When this fails,
/// outputs that are not complete are gone.
pub fn fly(
    pass: &Pass<'_>,
    flight: &FlightPlan,
    state: &mut FlightState,
    poses: Option<PoseReader>,
    writer: Option<Box<Writer>>,
) -> Result<Ended> {
    pass.simulate(
        writer,
        || {
            let mut worker = FlightWorker::new(pass, flight);
            move |chunk| worker.measure(chunk)
        },
        |feed| chunk::produce(flight, pass.motion, state, poses, pass.control.stop, feed),
    )
}

/// Traces the pulses of one epoch: blocks of rows → schedule → workers (parse, trace, detect, encode) → outputs in the order
/// of the stream.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) for rows that are no pulses, with their line; otherwise as [`fly`].
fn trace(
    pass: &Pass<'_>,
    tracing: &Tracing<'_>,
    source: &mut PulseSource,
    epoch: u32,
    writer: Option<Box<Writer>>,
) -> Result<Ended> {
    pass.simulate(
        writer,
        || {
            let mut worker = StreamWorker::new(pass, tracing);
            move |block| worker.measure(&block)
        },
        |feed| source.produce(epoch, pass.control.stop, feed),
    )
}

impl Pass<'_> {
    fn simulate<C, W>(
        &self,
        writer: Option<Box<Writer>>,
        make_worker: impl Fn() -> W + Sync,
        produce: impl FnOnce(&mut Feed<'_, C, Vec<Measured>, W>) -> Result<()>,
    ) -> Result<Ended>
    where
        C: Tasks + Send,
        W: FnMut(C) -> Result<Vec<Measured>>,
    {
        let jobs = Arc::new(JobQueue::new(2 * self.schedule.threads));
        let writer = match writer {
            None => Box::new(self.output.open(jobs.clone())?),
            Some(mut writer) => {
                writer.offload_to(jobs.clone());
                writer
            }
        };
        let Control { stop, recorder, .. } = self.control;
        let collector = Collector::new(self, writer);
        schedule::run(self.schedule, &jobs, stop, recorder, make_worker, produce, collector)
    }
}

/// Compression is taken over by the workers.
impl Offload for JobQueue {
    fn try_run(&self, job: Job) -> std::result::Result<(), Job> {
        JobQueue::try_run(self, job)
    }
}
