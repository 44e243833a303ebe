//! Request to stop a run early.

use std::sync::atomic::{AtomicBool, Ordering};

/// A request to stop early, shared by all threads of a run. It outlives the run: the failure of one run does not stop the
/// next.
#[derive(Debug, Default)]
pub struct Stop {
    requested: AtomicBool,
    /// Whether a thread of the present run has failed.
    failed: AtomicBool,
}

impl Stop {
    /// Creates a flag that is not set.
    pub const fn new() -> Stop {
        Stop { requested: AtomicBool::new(false), failed: AtomicBool::new(false) }
    }

    /// Requests the stop.
    pub fn request(&self) {
        self.requested.store(true, Ordering::Relaxed);
    }

    /// Whether the stop was requested, or the present run has failed.
    pub fn is_requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed) || self.failed.load(Ordering::Relaxed)
    }

    /// Forgets the failure of an earlier run.
    pub(super) fn begin_run(&self) {
        self.failed.store(false, Ordering::Relaxed);
    }

    /// Stops the other threads of the present run.
    pub(super) fn fail(&self) {
        self.failed.store(true, Ordering::Relaxed);
    }
}
