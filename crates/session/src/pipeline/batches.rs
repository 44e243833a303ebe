//! The points of a run as record batches, taken while it is running.

use super::pass::RunContext;
use super::progress::Progress;
use super::run::Report;
use super::session::Session;
use crate::output::{CloudFacts, OutputRequest, TableContent, TableRequest, TableSink};
use ::arrow_array::RecordBatch;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use std::time::Duration;
use vlscan_base::damage::panic_text;
use vlscan_base::error::{Error, Result};
use vlscan_warehouse::Stop;

/// Batches that wait for their reader before the run waits.
const MAX_WAITING: usize = 2;

/// The points of a run on another thread, batch by batch; see [`Session::into_batches`]. The last item is the
/// error of a run that fails. Dropping the iterator ends the run.
pub struct Batches {
    batches: Option<Receiver<RecordBatch>>,
    worker: Option<JoinHandle<Result<Report>>>,
    end: Box<dyn Fn() -> bool + Send + Sync>,
    progress: Arc<Progress>,
    report: Option<Report>,
    facts: Arc<OnceLock<CloudFacts>>,
}

/// Passes batches to another thread.
#[derive(Debug)]
struct Sender {
    batches: SyncSender<RecordBatch>,
    facts: Arc<OnceLock<CloudFacts>>,
}

impl TableSink for Sender {
    fn begin(&self, facts: CloudFacts) {
        // A run of several epochs begins its table once.
        let _ = self.facts.set(facts);
    }

    fn take(&self, batch: RecordBatch) -> Result<()> {
        self.batches.send(batch).map_err(|_| Error::ClosedPipe)
    }
}

impl Session {
    /// Runs the session on another thread and returns the points, `rows` at a time, in addition to the other
    /// `outputs`. The run waits while its batches wait, so memory stays flat. The columns are
    /// [`CloudSettings::columns`](crate::output::CloudSettings::columns).
    pub fn into_batches(mut self, mut outputs: OutputRequest, rows: usize) -> Batches {
        let (stop, progress) = (Arc::new(Stop::new()), Arc::new(Progress::default()));
        let (requested, counters) = (stop.clone(), progress.clone());
        let end = move || {
            requested.request();
            true
        };
        let mut batches = Batches::spawn(MAX_WAITING, end, move |sink| {
            let table = TableRequest::new(TableContent::Points, sink);
            outputs.tables.push(TableRequest { batch_rows: rows, ..table });
            self.run(outputs, RunContext::new(&counters, &stop))
        });
        batches.progress = progress;
        batches
    }
}

impl Batches {
    /// The batches that `run` passes to a sink on another thread; it waits while `waiting` of them wait.
    /// `end` requests the end of the run and returns true if the caller must wait for it.
    pub fn spawn(
        waiting: usize,
        end: impl Fn() -> bool + Send + Sync + 'static,
        run: impl FnOnce(Arc<dyn TableSink>) -> Result<Report> + Send + 'static,
    ) -> Batches {
        let (sender, batches) = sync_channel(waiting.max(1));
        let facts = Arc::<OnceLock<CloudFacts>>::default();
        let sink = Sender { batches: sender, facts: facts.clone() };
        let worker = std::thread::spawn(move || run(Arc::new(sink)));
        Batches {
            batches: Some(batches),
            worker: Some(worker),
            end: Box::new(end),
            progress: Arc::default(),
            report: None,
            facts,
        }
    }

    /// Counters of the work done so far, for a display of progress. Those of [`Batches::spawn`] belong to its
    /// `run`, and these stay 0.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Requests the end of the run. What has been measured by then still arrives, and the
    /// [report](Batches::report) says that the run was interrupted.
    pub fn stop(&self) {
        (self.end)();
    }

    /// Facts about the points in addition to their columns, from the first batch on.
    pub fn facts(&self) -> Option<&CloudFacts> {
        self.facts.get()
    }

    /// The report of the run, once the last batch has been taken.
    pub fn report(&self) -> Option<&Report> {
        self.report.as_ref()
    }

    /// The next item if it comes within `timeout`; else `None`.
    pub fn next_within(&mut self, timeout: Duration) -> Option<Option<Result<RecordBatch>>> {
        match self.batches.as_ref().map(|batches| batches.recv_timeout(timeout)) {
            Some(Ok(batch)) => Some(Some(Ok(batch))),
            Some(Err(RecvTimeoutError::Timeout)) => None,
            Some(Err(RecvTimeoutError::Disconnected)) | None => Some(self.finish().err().map(Err)),
        }
    }

    /// The outcome of the run, whose batches have all been taken.
    fn finish(&mut self) -> Result<()> {
        self.batches = None;
        let Some(worker) = self.worker.take() else { return Ok(()) };
        let ended = worker.join().unwrap_or_else(|panic| {
            Err(Error::Internal(format!("the thread of the run panicked: {}", panic_text(&*panic))))
        });
        self.report = Some(ended?);
        Ok(())
    }
}

impl Iterator for Batches {
    type Item = Result<RecordBatch>;

    fn next(&mut self) -> Option<Result<RecordBatch>> {
        match self.batches.as_ref().map(Receiver::recv) {
            Some(Ok(batch)) => Some(Ok(batch)),
            _ => self.finish().err().map(Err),
        }
    }
}

impl Drop for Batches {
    fn drop(&mut self) {
        let is_awaited = (self.end)();
        // A run ends if nothing receives its batches.
        self.batches = None;
        if let Some(worker) = self.worker.take().filter(|_| is_awaited) {
            let _ = worker.join();
        }
    }
}
