#![doc = include_str!("../README.md")]
//!
//! ## Inside
//!
//! The threads and the queues between them (spec kdtree-and-scheduling §3):
//!
//! ```text
//!             ┌─ queue (bounded) ──────────────► workers ─┐ one channel for each result
//! producer ───┤                                           ▼
//!   (Feed)    └─ pending results (bounded, in order) ─► collector
//! ```
//!
//! The queue of pending results keeps the order, without sequence numbers or a heap. Every queue is bounded
//! ([`Schedule::queue_capacity`], [`Schedule::results_capacity`], [`JobQueue::new`]), so that a slow reader
//! of the results slows the producer down. A [`Policy`] decides how large chunks are, when they go to a
//! worker and what the producer does while all workers are busy. Workers and collector are independent of it,
//! and so are the results. The paper's barrier between legs is a switch.
//!
//! A worker sends its error, or the text of its panic, as the result of its chunk. The collector returns the
//! first error in the order of the results and stops the producer ([`RunState`]). [`run`](crate::run()) joins
//! all threads and returns the collector's error, or else the producer's.
//!
//! | file | contents |
//! |---|---|
//! | `policy` | the four schedules and their settings |
//! | `error` | limits of schedules; failures of a run |
//! | `feed` | the producer's side: distribution of chunks |
//! | `run` | the threads |
//! | `sizing` | the size of dynamic chunks |
//! | `record` | idle times, queue depths, chunk sizes |
//! | `jobs` | side jobs of the collector |
//! | `spin` | spinning for a moment before sleep |
//! | `stop` | the request to stop, and the state of a run |

#![deny(unsafe_code)]

mod error;
mod feed;
mod jobs;
mod policy;
mod record;
mod run;
mod sizing;
mod spin;
mod stop;

pub use error::{MAX_CHUNK_SIZE, MAX_FACTOR, MAX_THREADS, RunError, ScheduleError};
pub use feed::{Feed, Outcome, Tasks};
pub use jobs::{Job, JobQueue};
pub use policy::{MAX_BUFFERED_TASKS, Policy, PolicyKind, Schedule};
#[doc(hidden)]
pub use record::thread_cpu_s;
pub use record::{Depth, LegEnd, Log, MAX_HISTORY, Recorder, Series, SizeChange, ThreadLog};
pub use run::{Collect, run};
pub use sizing::ChunkSizer;
pub use stop::{OpenOutputs, RunState, Stop};
