//! Request to stop a run early.

use std::sync::atomic::{AtomicBool, Ordering};

/// A request to stop early, shared by all threads of a run.
#[derive(Debug, Default)]
pub struct Stop(AtomicBool);

impl Stop {
    /// Creates a flag that is not set.
    pub const fn new() -> Stop {
        Stop(AtomicBool::new(false))
    }

    /// Requests the stop.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the stop was requested.
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
