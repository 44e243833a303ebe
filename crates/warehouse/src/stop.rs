//! Request to stop a run early.

use std::sync::atomic::{AtomicBool, Ordering};

/// A request to stop early, shared by all threads of a run. It outlives the run: the failure of one run does
/// not stop the next.
#[derive(Debug, Default)]
pub struct Stop {
    requested: AtomicBool,
    /// True if a thread of the present run has failed.
    failed: AtomicBool,
    heeded: AtomicBool,
}

impl Stop {
    /// Creates a flag that is not set.
    pub const fn new() -> Stop {
        Stop {
            requested: AtomicBool::new(false),
            failed: AtomicBool::new(false),
            heeded: AtomicBool::new(false),
        }
    }

    /// Requests the stop.
    pub fn request(&self) {
        self.requested.store(true, Ordering::Relaxed);
    }

    /// True if the stop was requested, or the present run has failed.
    pub fn is_requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed) || self.failed.load(Ordering::Relaxed)
    }

    /// Records that the run has open outputs and checks for this request from now on.
    pub fn heed(&self) {
        self.heeded.store(true, Ordering::Relaxed);
    }

    /// Records that the outputs of the run are closed: what follows is not ended by this request.
    pub fn release(&self) {
        self.heeded.store(false, Ordering::Relaxed);
    }

    /// True if a request ends the run in order. Before that nothing has been measured, and behind it nothing
    /// is open: the process can just be ended.
    pub fn is_heeded(&self) -> bool {
        self.heeded.load(Ordering::Relaxed)
    }

    /// Forgets the failure of an earlier run.
    pub fn begin_run(&self) {
        self.failed.store(false, Ordering::Relaxed);
    }

    /// Stops the other threads of the present run.
    pub(super) fn fail(&self) {
        self.failed.store(true, Ordering::Relaxed);
    }
}
