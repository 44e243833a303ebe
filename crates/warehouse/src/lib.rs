//! Chunks of work, the schedules that distribute them, and the threads that compute them, independent of LiDAR.
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
//! The queue of pending results keeps the order, without sequence numbers or a heap. Every queue is bounded, so that
//! a slow reader of the results slows the producer down. A [`Policy`] decides how large chunks are, when they go to a
//! worker and what the producer does while all workers are busy. Workers and collector are independent of it, and so
//! are the results. The paper's barrier between legs is a switch.
//!
//! | file | contents |
//! |---|---|
//! | `policy` | the four schedules and their settings |
//! | `feed` | the producer's side: distribution of chunks |
//! | `run` | the threads |
//! | `sizing` | the size of dynamic chunks |
//! | `record` | idle times, queue depths, chunk sizes |
//! | `workload` | tasks and costs, from records |
//! | `replay` | simulation of a schedule, for machines with more cores |
//! | `jobs` | side jobs of the collector |
//! | `spin` | spinning for a moment before sleep |
//! | `stop` | the request to stop |

#![deny(unsafe_code)]

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
pub use record::{Log, Recorder, SizeChange, thread_cpu_s};
pub use replay::replay;
pub use run::{Collect, run};
pub use stop::Stop;
pub use workload::{ChunkCosts, Overheads, Workload};

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
