//! The wiring of the river, short enough to read in a minute: [`fly`] joins the flight's chunks, the workers and the
//! sinks.

mod batch;
mod chunk;
mod collector;
mod progress;
mod worker;

pub use batch::Batch;
pub use chunk::{Chunk, produce};
pub use progress::{Progress, Snapshot};

use crate::error::Result;
use crate::flight::FlightPlan;
use crate::output::{Offload, OutputPlan, Summary};
use crate::platform::PoseReader;
use crate::pulse::Physics;
use crate::schedule::{self, Job, JobQueue, Stop};
use collector::Collector;
use std::sync::Arc;
use worker::Worker;

/// Everything that a run needs, resolved: nothing below reads the command line, the environment or the clock.
pub struct Run<'a> {
    /// Clock, legs, platform, optics.
    pub flight: &'a FlightPlan,
    /// Scene, tree, instruments.
    pub physics: &'a Physics<'a>,
    /// Sinks.
    pub output: Arc<OutputPlan>,
    /// Poses of a streamed platform as they arrive.
    pub poses: Option<PoseReader>,
    /// Threads and the warehouse's size.
    pub schedule: schedule::Settings,
    /// Pulses per chunk.
    pub chunk_size: u32,
    /// The user's wish to end.
    pub stop: &'a Stop,
    /// What has been done so far, for whoever watches.
    pub progress: &'a Progress,
}

/// Flies the survey: chunks → warehouse → workers (replay, trace, detect, encode) → sinks in chunk order. The outputs are
/// complete and under their names when this returns `Ok`, and gone otherwise.
pub fn fly(run: Run<'_>) -> Result<Summary> {
    let jobs = Arc::new(JobQueue::new(2 * run.schedule.threads));
    let collector = Collector { writer: run.output.open(jobs.clone())?, progress: run.progress };
    let output = &run.output;
    schedule::run(
        run.schedule,
        &jobs,
        run.stop,
        || {
            let mut worker = Worker::new(run.flight, run.physics, output);
            move |chunk| worker.measure(chunk)
        },
        |feed| produce(run.flight, run.poses, run.chunk_size, run.stop, |chunk| feed.put(chunk)),
        collector,
    )
}

/// Compression is taken over by the workers.
impl Offload for JobQueue {
    fn try_run(&self, job: Job) -> std::result::Result<(), Job> {
        JobQueue::try_run(self, job)
    }
}
