//! Runs whose points are taken while they are measured.

use crate::errors::{Notices, exception};
use crate::run::{CollectedTables, Outcome};
use crate::table::Table;
use crate::watch::POLL_INTERVAL;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::{Mutex, MutexGuard, PoisonError};
use vlscan::Batches;

/// The batches of points of a run. The run ends when the iterator is closed or forgotten.
#[pyclass(frozen, module = "vlscan")]
pub struct BatchIterator {
    batches: Mutex<Option<Batches>>,
    notices: Notices,
    tables: CollectedTables,
    outcome: Mutex<Option<Py<Outcome>>>,
}

impl BatchIterator {
    /// The iterator over the batches of a run, which leaves `tables`.
    pub fn new(batches: Batches, notices: Notices, tables: CollectedTables) -> BatchIterator {
        BatchIterator { batches: Mutex::new(Some(batches)), notices, tables, outcome: Mutex::default() }
    }

    fn batches(&self) -> MutexGuard<'_, Option<Batches>> {
        self.batches.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends the run. The interpreter is free meanwhile: the run may wait for it.
    fn end(&self, py: Python<'_>) {
        py.detach(|| drop(self.batches().take()));
    }
}

#[pymethods]
impl BatchIterator {
    fn __iter__(own: Bound<'_, Self>) -> Bound<'_, Self> {
        own
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Table>> {
        loop {
            let next =
                py.detach(|| self.batches().as_mut().map(|batches| batches.next_within(POLL_INTERVAL)));
            match next {
                None => return Ok(None),
                Some(Some(Some(Ok(batch)))) => {
                    let facts = self.batches().as_ref().and_then(|batches| batches.facts().cloned());
                    return Table::of_points(batch, facts).map(Some);
                }
                Some(None) => {
                    if let Err(signal) = py.check_signals() {
                        self.end(py);
                        return Err(signal);
                    }
                }
                Some(Some(ended)) => {
                    let batches = self.batches().take();
                    let issued = self.notices.issue(py)?.unbind();
                    return match (ended, batches.as_ref().and_then(Batches::report)) {
                        (Some(Err(error)), _) => Err(exception(py, error)),
                        (_, Some(report)) if report.interrupted => {
                            Err(PyRuntimeError::new_err("the run was stopped"))
                        }
                        (None, Some(report)) => {
                            let outcome = Outcome::new(py, report.clone(), issued, &self.tables)?;
                            let outcome = Py::new(py, outcome)?;
                            *self.outcome.lock().unwrap_or_else(PoisonError::into_inner) = Some(outcome);
                            Ok(None)
                        }
                        _ => Ok(None),
                    };
                }
            }
        }
    }

    /// The result of the run, once the last batch has been taken.
    fn outcome(&self, py: Python<'_>) -> Option<Py<Outcome>> {
        let outcome = self.outcome.lock().unwrap_or_else(PoisonError::into_inner);
        outcome.as_ref().map(|outcome| outcome.clone_ref(py))
    }

    /// Ends the run.
    fn close(&self, py: Python<'_>) {
        self.end(py);
    }
}

impl Drop for BatchIterator {
    fn drop(&mut self) {
        Python::attach(|py| self.end(py));
    }
}
