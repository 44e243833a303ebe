//! Work on another thread, which Ctrl-C ends.

use flume::RecvTimeoutError;
use pyo3::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use vlscan::{Error, Settings, Stop};

/// Time between two checks of signals and reports of progress.
pub const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// A request to end the loading of a scene or a run.
#[derive(Default)]
pub struct Interruption {
    /// Ends the run.
    pub stop: Stop,
    loading: Arc<AtomicBool>,
    writes: bool,
}

impl Interruption {
    /// For work whose end is always waited for, because it writes a file.
    pub fn of_writing() -> Interruption {
        Interruption { writes: true, ..Interruption::default() }
    }

    /// Requests the end.
    pub fn request(&self) {
        self.loading.store(true, Ordering::Relaxed);
        self.stop.request();
    }

    /// Lets the request end the loading of a session with these settings, too.
    pub fn watch(&self, settings: &mut Settings) {
        settings.load.stop = Some(self.loading.clone());
    }

    /// Whether the end has to be waited for, because outputs are completed; a scene that is loading just ends.
    pub fn is_awaited(&self) -> bool {
        self.writes || self.stop.is_heeded()
    }
}

/// Calls `work` on another thread, and `check` from time to time until it is done. An error of `check` ends the work.
pub fn watched<T: Send + 'static>(
    py: Python<'_>,
    interruption: &Interruption,
    work: impl FnOnce() -> vlscan::Result<T> + Send + 'static,
    mut check: impl FnMut() -> PyResult<()>,
) -> PyResult<vlscan::Result<T>> {
    let (done, result) = flume::bounded(1);
    std::thread::spawn(move || done.send(work()));
    loop {
        match py.detach(|| result.recv_timeout(POLL_INTERVAL)) {
            Ok(found) => return Ok(found),
            Err(RecvTimeoutError::Disconnected) => {
                return Ok(Err(Error::Internal("a thread of the run has failed".to_owned())));
            }
            Err(RecvTimeoutError::Timeout) => {
                if let Err(failure) = check() {
                    interruption.request();
                    if interruption.is_awaited() {
                        let _ = py.detach(|| result.recv());
                    }
                    return Err(failure);
                }
            }
        }
    }
}
