//! Chunks of work, the schedules that hand them out, and the threads that compute them; nothing of lidar.
//!
//! One producer makes chunk descriptors, workers turn each into a result, one collector takes the results in the order in
//! which the chunks were made (spec kdtree-and-scheduling §3):
//!
//! ```text
//!             ┌─ warehouse (bounded) ────────► workers ─┐ one-shot each
//! producer ───┤                                         ▼
//!   (Feed)    └─ receipts  (bounded, in order) ────► collector
//! ```
//!
//! Order comes from the queue of receipts alone: no sequence numbers, no heap. Every queue is bounded, so a slow reader of
//! the results slows the producer. A [`Policy`] decides how large chunks are, when they go to a worker and what the
//! producer does while all workers are busy; workers and collector do not know which one is in force, and the results are
//! the same. The paper's barrier between legs is a switch.
//!
//! | file | what |
//! |---|---|
//! | `policy` | the four schedules and their settings |
//! | `feed` | the producer's end: what happens to a chunk |
//! | `run` | the threads |
//! | `dropper` | the size of dynamic chunks |
//! | `record` | idle times, queue depths, chunk sizes |
//! | `workload` | what there is to do and what it costs, from records |
//! | `replay` | the same in simulated time, for machines that are not here |
//! | `jobs` | side jobs of the collector |
//! | `patience` | waiting awake for a moment |

mod dropper;
mod feed;
mod jobs;
mod patience;
mod policy;
mod record;
mod replay;
mod run;
mod workload;

pub use dropper::{Direction, Dropper};
pub use feed::{Feed, Outcome, Tasks};
pub use jobs::{Job, JobQueue};
pub use policy::{Policy, Schedule};
pub use record::{Depth, LegEnd, Log, Recorder, Series, SizeChange, ThreadLog};
pub use replay::{Replayed, replay};
pub use run::{Collect, run};
pub use workload::{Beside, Overheads, PerSize, Profile, Workload, beside_work, hand_overs};

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
