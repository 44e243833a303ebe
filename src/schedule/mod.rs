//! Chunks of work, the warehouse that holds them, and the threads that empty it; nothing of lidar.
//!
//! One producer makes chunk descriptors, workers turn each into a result, one collector takes the results in the order in
//! which the chunks were made (spec kdtree-and-scheduling §3.5, with the paper's leg barrier removed):
//!
//! ```text
//!             ┌─ warehouse (bounded: factor × workers) ─► workers ─┐ one-shot each
//! producer ───┤                                                    ▼
//!             └─ receipts  (bounded, in order) ───────────────► collector
//! ```
//!
//! Order comes from the queue of receipts alone: no sequence numbers, no heap. Every queue is bounded, so a slow reader of
//! the results slows the producer. A producer that finds the warehouse full works off its chunk itself.

mod jobs;
mod warehouse;

pub use jobs::{Job, JobQueue};
pub use warehouse::{Collect, Feed, Settings, run};

use std::sync::atomic::{AtomicBool, Ordering};

/// A wish to end early, shared by everything that runs.
#[derive(Debug, Default)]
pub struct Stop(AtomicBool);

impl Stop {
    /// Not wished yet.
    pub const fn new() -> Stop {
        Stop(AtomicBool::new(false))
    }

    /// Asks everything to end.
    pub fn ask(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the end was asked for.
    pub fn asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
