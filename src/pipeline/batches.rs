//! The points of a run as record batches, taken while the run goes on.

use super::pass::RunContext;
use super::progress::Progress;
use super::run::Report;
use super::session::Session;
use crate::output::{OutputRequest, TableContent, TableRequest, TableSink};
use ::arrow_array::RecordBatch;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use vlscan_base::error::{Error, Result};
use vlscan_warehouse::Stop;

/// Batches that wait for their reader before the run waits.
const MAX_WAITING: usize = 2;

/// The points of a run on another thread, batch by batch; see [`Session::into_batches`]. The last item is the error of a run that
/// fails. Dropping the iterator ends the run.
#[derive(Debug)]
pub struct Batches {
    batches: Option<Receiver<RecordBatch>>,
    worker: Option<JoinHandle<Result<Report>>>,
    stop: Arc<Stop>,
    report: Option<Report>,
}

/// Passes batches to another thread.
#[derive(Debug)]
struct Sender(SyncSender<RecordBatch>);

impl TableSink for Sender {
    fn take(&self, batch: RecordBatch) -> Result<()> {
        self.0.send(batch).map_err(|_| Error::ClosedPipe)
    }
}

impl Session {
    /// Runs the session on another thread and returns the points, `rows` at a time, beside what else `outputs` asks for. The run waits
    /// while its batches wait, so memory stays flat. The columns are [`OutputRequest::columns`].
    pub fn into_batches(mut self, mut outputs: OutputRequest, rows: usize) -> Batches {
        let (sender, batches) = sync_channel(MAX_WAITING);
        let sink = Arc::new(Sender(sender));
        outputs.tables.push(TableRequest {
            content: TableContent::Points,
            batch_rows: rows.max(1),
            batch_per_leg: false,
            batch_seconds: None,
            sink,
        });
        let stop = Arc::new(Stop::new());
        let own = stop.clone();
        let worker =
            std::thread::spawn(move || self.run(outputs, RunContext::new(&Progress::default(), &own)));
        Batches { batches: Some(batches), worker: Some(worker), stop, report: None }
    }
}

impl Batches {
    /// The report of the run, once the last batch has been taken.
    pub fn report(&self) -> Option<&Report> {
        self.report.as_ref()
    }
}

impl Iterator for Batches {
    type Item = Result<RecordBatch>;

    fn next(&mut self) -> Option<Result<RecordBatch>> {
        if let Some(Ok(batch)) = self.batches.as_ref().map(Receiver::recv) {
            return Some(Ok(batch));
        }
        self.batches = None;
        let failed = |_| Err(Error::Internal("a thread of the run has failed".to_owned()));
        match self.worker.take()?.join().unwrap_or_else(failed) {
            Ok(report) => {
                self.report = Some(report);
                None
            }
            Err(error) => Some(Err(error)),
        }
    }
}

impl Drop for Batches {
    fn drop(&mut self) {
        self.stop.request();
        // A run whose batches nobody takes ends.
        self.batches = None;
        if let Some(worker) = self.worker.take() {
            let _ = worker.join();
        }
    }
}
