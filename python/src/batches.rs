//! Runs whose points are taken while they are measured: the run waits when too many batches wait.

use crate::errors::{Notices, exception};
use crate::table::Table;
use crate::watch::{Interruption, POLL_INTERVAL};
use arrow_array::RecordBatch;
use flume::{Receiver, RecvTimeoutError, Sender};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use vlscan::{Error, Report, TableSink};

/// Passes the batches of a run to another thread.
#[derive(Debug)]
pub struct Channel(Sender<RecordBatch>);

impl Channel {
    /// A channel in which `waiting` batches can wait.
    pub fn new(waiting: usize) -> (Channel, Receiver<RecordBatch>) {
        let (sender, receiver) = flume::bounded(waiting.max(1));
        (Channel(sender), receiver)
    }
}

impl TableSink for Channel {
    fn take(&self, batch: RecordBatch) -> vlscan::Result<()> {
        self.0.send(batch).map_err(|_| Error::ClosedPipe)
    }
}

/// The batches of points of a run. The run ends when the iterator is closed or forgotten.
#[pyclass(frozen, module = "vlscan")]
pub struct BatchIterator {
    state: Mutex<State>,
    interruption: Arc<Interruption>,
    notices: Notices,
}

#[derive(Default)]
struct State {
    batches: Option<Receiver<RecordBatch>>,
    worker: Option<JoinHandle<vlscan::Result<Report>>>,
}

impl BatchIterator {
    /// The iterator over the batches of `worker`.
    pub fn new(
        batches: Receiver<RecordBatch>,
        worker: JoinHandle<vlscan::Result<Report>>,
        interruption: Arc<Interruption>,
        notices: Notices,
    ) -> BatchIterator {
        let state = State { batches: Some(batches), worker: Some(worker) };
        BatchIterator { state: Mutex::new(state), interruption, notices }
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends the run, and waits for the end of one that measures.
    fn end(&self) {
        self.interruption.request();
        let (batches, worker) = {
            let mut state = self.state();
            (state.batches.take(), state.worker.take())
        };
        drop(batches);
        if let Some(worker) = worker.filter(|_| self.interruption.is_awaited()) {
            let _ = worker.join();
        }
    }
}

fn joined(worker: JoinHandle<vlscan::Result<Report>>) -> vlscan::Result<Report> {
    worker.join().unwrap_or_else(|_| Err(Error::Internal("a thread of the run has failed".to_owned())))
}

#[pymethods]
impl BatchIterator {
    fn __iter__(own: Bound<'_, Self>) -> Bound<'_, Self> {
        own
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Table>> {
        let Some(batches) = self.state().batches.clone() else { return Ok(None) };
        loop {
            match py.detach(|| batches.recv_timeout(POLL_INTERVAL)) {
                Ok(batch) => return Ok(Some(Table(batch))),
                Err(RecvTimeoutError::Timeout) => {
                    if let Err(signal) = py.check_signals() {
                        drop(batches);
                        py.detach(|| self.end());
                        return Err(signal);
                    }
                }
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        let worker = {
            let mut state = self.state();
            state.batches = None;
            state.worker.take()
        };
        let done = py.detach(|| worker.map(joined));
        self.notices.issue(py)?;
        match done {
            Some(Err(error)) => Err(exception(py, error)),
            Some(Ok(report)) if report.interrupted => Err(PyRuntimeError::new_err("the run was stopped")),
            _ => Ok(None),
        }
    }

    /// Ends the run.
    fn close(&self, py: Python<'_>) {
        py.detach(|| self.end());
    }
}

impl Drop for BatchIterator {
    fn drop(&mut self) {
        // The interpreter must be free while the run ends, which may wait for it.
        Python::attach(|py| py.detach(|| self.end()));
    }
}
