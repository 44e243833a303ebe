//! The stages of a pass over one epoch: a producer, the workers, the collector.

use super::chunk;
use super::collector::{Collector, Ended, PassEnd};
use super::pass::{Pass, RunContext};
use super::stream::{PulseSource, StreamWorker, Tracing};
use super::worker::{FlightWorker, Pieces};
use crate::output::{Offload, OutputPlan, Writer};
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_lidar::flight::{FlightPlan, FlightState};
use vlscan_lidar::platform::PoseReader;
use vlscan_warehouse::{Feed, Job, JobQueue, Schedule, Tasks};

/// Jobs of the collector that may wait for a worker: as many as can come at once when the system has let the
/// collector wait. Their memory is limited by those who submit them.
const MAX_WAITING_JOBS: usize = 256;

/// Flies the survey over one epoch: chunks → schedule → workers (replay, trace, detect, encode) → outputs in
/// chunk order. `state` is the state before the first step; `writer` holds the outputs of the previous epoch.
/// The pass ends with the epoch, or after the step that emits pulse number `limit`, counted from 1. On
/// failure the points until then are kept as partial outputs.
pub fn fly(
    pass: &Pass<'_>,
    flight: &FlightPlan,
    state: &mut FlightState,
    poses: Option<PoseReader>,
    limit: u64,
    writer: Option<Box<Writer>>,
) -> Result<Ended> {
    pass.simulate(
        writer,
        || {
            let mut worker = FlightWorker::new(pass, flight);
            move |chunk| worker.measure(chunk)
        },
        |feed| chunk::produce(flight, pass.motion, state, poses, limit, feed),
    )
}

/// Traces the pulses of one epoch: blocks of rows → schedule → workers (parse, trace, detect, encode) →
/// outputs in the order of the stream.
///
/// # Errors
/// [`vlscan_base::Error::Input`] for malformed rows, with their line; otherwise as for [`fly`].
pub(super) fn trace(
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
        |feed| {
            source.produce(epoch, feed)?;
            if pass.is_last { source.check_end(epoch, feed.state()) } else { Ok(()) }
        },
    )
}

impl Pass<'_> {
    fn simulate<C, W>(
        &self,
        writer: Option<Box<Writer>>,
        make_worker: impl Fn() -> W + Sync,
        produce: impl FnOnce(&mut Feed<'_, C, Pieces, W>) -> Result<()>,
    ) -> Result<Ended>
    where
        C: Tasks + Send,
        W: FnMut(C) -> Result<Pieces>,
    {
        let end = PassEnd {
            check: self.check.as_ref(),
            is_last: self.is_last,
            keeps_partial: true,
            open_outputs: self.open_outputs,
        };
        run_stages(self.schedule, self.control, &self.output, writer, end, make_worker, produce)
    }
}

/// Runs producer, workers and collector over one epoch; `writer` holds the outputs of the previous epoch.
pub(super) fn run_stages<C, W>(
    schedule: Schedule,
    control: RunContext<'_>,
    output: &Arc<OutputPlan>,
    writer: Option<Box<Writer>>,
    end: PassEnd<'_>,
    make_worker: impl Fn() -> W + Sync,
    produce: impl FnOnce(&mut Feed<'_, C, Pieces, W>) -> Result<()>,
) -> Result<Ended>
where
    C: Tasks + Send,
    W: FnMut(C) -> Result<Pieces>,
{
    let jobs = Arc::new(JobQueue::new(MAX_WAITING_JOBS));
    let workers = Arc::new(Workers { jobs: jobs.clone(), threads: schedule.threads });
    let writer = match writer {
        None => Box::new(output.open(workers)?),
        Some(mut writer) => {
            writer.offload_to(workers);
            writer
        }
    };
    let RunContext { stop, recorder, .. } = control;
    end.open_outputs.open();
    let collector = Collector::new(control.progress, end, writer);
    vlscan_warehouse::run(schedule, &jobs, stop, recorder, make_worker, produce, collector)
}

/// The threads of a pass as those that compress and write.
struct Workers {
    jobs: Arc<JobQueue>,
    threads: usize,
}

impl Offload for Workers {
    fn try_run(&self, job: Job) -> std::result::Result<(), Job> {
        self.jobs.try_run(job)
    }

    fn threads(&self) -> usize {
        self.threads
    }
}
