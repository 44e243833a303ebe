//! Chunks of work, the schedules that distribute them, and the threads that compute them; nothing of lidar.
//!
//! One producer makes chunks, workers turn each into a result, one collector takes the results in the order in which the
//! chunks were made (spec kdtree-and-scheduling §3):
//!
//! ```text
//!             ┌─ queue (bounded) ──────────────► workers ─┐ one channel for each result
//! producer ───┤                                           ▼
//!   (Feed)    └─ pending results (bounded, in order) ─► collector
//! ```
//!
//! The queue of pending results alone keeps the order: no sequence numbers, no heap. Every queue is bounded, so that a slow
//! reader of the results slows the producer. A [`Policy`] decides how large chunks are, when they go to a worker and what
//! the producer does while all workers are busy; workers and collector do not know it, and the results are the same. The
//! paper's barrier between legs is a switch.
//!
//! | file | what it does |
//! |---|---|
//! | `policy` | the four schedules and their settings |
//! | `feed` | the producer's end: what happens to a chunk |
//! | `run` | the threads |
//! | `sizing` | the size of dynamic chunks |
//! | `record` | idle times, queue depths, chunk sizes |
//! | `workload` | tasks and costs, from records |
//! | `replay` | a schedule in simulated time, for machines with more cores |
//! | `jobs` | side jobs of the collector |
//! | `spin` | spinning for a moment before sleep |
//! | `stop` | the wish to end |

mod feed;
mod jobs;
mod policy;
mod record;
mod replay;
mod run;
mod sizing;
mod spin;
mod stop;
mod workload;

pub use feed::{Feed, Outcome, Tasks};
pub use jobs::{Job, JobQueue};
pub use policy::{Policy, PolicyKind, Schedule};
pub use record::{Log, Recorder, SizeChange};
pub use replay::replay;
pub use run::{Collect, run};
pub use stop::Stop;
pub use workload::{ChunkCosts, Overheads, Workload};
