//! Work on another thread, which Ctrl-C ends.

use flume::RecvTimeoutError;
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::thread::Builder;
use std::time::Duration;
use vlscan::base::damage::panic_text;
use vlscan::{Error, Settings, Stop};

/// Time between two checks of signals and reports of progress.
pub const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Work whose result can be given up.
const COMPUTING: u8 = 0;
/// Work that writes files, which are completed.
const WRITING: u8 = 1;
/// Work whose result nobody awaits.
const GIVEN_UP: u8 = 2;

/// A request to end the loading of a scene, a run or other work.
#[derive(Default)]
pub struct Interruption {
    /// Ends the run.
    pub stop: Stop,
    loading: Arc<AtomicBool>,
    stage: AtomicU8,
}

impl Interruption {
    /// For work whose end is always waited for, because it writes a file.
    pub fn of_writing() -> Interruption {
        Interruption { stage: AtomicU8::new(WRITING), ..Interruption::default() }
    }

    /// Called by work before it writes its first file: from now on its end is waited for.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if the work has been given up.
    pub fn begin_writing(&self) -> vlscan::Result<()> {
        match self.stage.compare_exchange(COMPUTING, WRITING, Ordering::SeqCst, Ordering::SeqCst) {
            Err(GIVEN_UP) => Err(Error::Interrupted),
            _ => Ok(()),
        }
    }

    /// Requests the end. Returns whether it has to be waited for, because outputs are completed; a scene that
    /// is loading, or work without files, just ends.
    pub fn request(&self) -> bool {
        self.loading.store(true, Ordering::Relaxed);
        self.stop.request();
        let stage = self.stage.compare_exchange(COMPUTING, GIVEN_UP, Ordering::SeqCst, Ordering::SeqCst);
        stage == Err(WRITING) || self.stop.has_open_outputs()
    }

    /// Lets the request end the loading of a session with these settings, too.
    pub fn watch(&self, settings: &mut Settings) {
        settings.load.stop = Some(self.loading.clone());
    }
}

/// Calls `work` on another thread. Ctrl-C ends the call at once while `work` computes, and when its files are
/// complete once it has called [`Interruption::begin_writing`].
pub fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&Interruption) -> vlscan::Result<T> + Send + 'static,
) -> PyResult<vlscan::Result<T>> {
    let interruption = Arc::new(Interruption::default());
    let own = interruption.clone();
    watched(py, &interruption, move || work(&own), || py.check_signals())
}

/// Calls `work` on another thread, and `check` from time to time until it is done. An error of `check` ends
/// the work. A panic of the work is an [`Error::Internal`] with its text.
pub fn watched<T: Send + 'static>(
    py: Python<'_>,
    interruption: &Interruption,
    work: impl FnOnce() -> vlscan::Result<T> + Send + 'static,
    mut check: impl FnMut() -> PyResult<()>,
) -> PyResult<vlscan::Result<T>> {
    let (done, result) = flume::bounded(1);
    let run = move || {
        let outcome = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
            Err(Error::Internal(format!("a thread of the run panicked: {}", panic_text(&*panic))))
        });
        // Fails if the call has been given up.
        let _ = done.send(outcome);
    };
    if let Err(source) = Builder::new().name("run".to_owned()).spawn(run) {
        return Ok(Err(Error::io("start the thread", "run", source)));
    }
    loop {
        match py.detach(|| result.recv_timeout(POLL_INTERVAL)) {
            Ok(found) => return Ok(found),
            Err(RecvTimeoutError::Disconnected) => {
                return Ok(Err(Error::Internal("a thread of the run has ended early".to_owned())));
            }
            Err(RecvTimeoutError::Timeout) => {
                if let Err(failure) = check() {
                    if interruption.request() {
                        let _ = py.detach(|| result.recv());
                    }
                    return Err(failure);
                }
            }
        }
    }
}
