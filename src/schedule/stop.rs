//! The wish to end early.

use std::sync::atomic::{AtomicBool, Ordering};

/// A wish to end early, shared by everything that runs.
#[derive(Debug, Default)]
pub struct Stop(AtomicBool);

impl Stop {
    /// Not requested yet.
    pub const fn new() -> Stop {
        Stop(AtomicBool::new(false))
    }

    /// Requests that everything ends.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the end was requested.
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
