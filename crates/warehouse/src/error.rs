//! Failures of a run other than the errors of its producer, workers or collector.

use std::any::Any;
use std::io;
use vlscan_base::Error;
use vlscan_base::damage::panic_text;

/// Maximum number of threads of a run.
pub const MAX_THREADS: usize = 1024;
/// Maximum number of tasks of a chunk.
pub const MAX_CHUNK_SIZE: u32 = 1 << 24;
/// Maximum number of queued chunks per worker.
pub const MAX_FACTOR: usize = 1 << 16;

/// A schedule that cannot be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ScheduleError {
    /// No threads, or more than [`MAX_THREADS`].
    #[error("a schedule of {0} threads: expected 1 to {max}", max = MAX_THREADS)]
    Threads(usize),
    /// Chunks without tasks, or of more than [`MAX_CHUNK_SIZE`].
    #[error("chunks of {0} tasks: expected 1 to {max}", max = MAX_CHUNK_SIZE)]
    Size(u32),
    /// A queue without room, or for more than [`MAX_FACTOR`] chunks per worker.
    #[error("a queue of {0} chunks per worker: expected 1 to {max}", max = MAX_FACTOR)]
    Factor(usize),
}

/// Failure of a run other than the errors of its producer, workers or collector. Their error type is made
/// from it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The caller has requested the stop, and the collector keeps nothing of a run that is stopped.
    #[error("interrupted")]
    Interrupted,
    /// The schedule cannot be run.
    #[error(transparent)]
    Schedule(#[from] ScheduleError),
    /// A thread could not be started.
    #[error("cannot start the thread {name}: {source}")]
    Thread {
        /// Name of the thread.
        name: &'static str,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A thread panicked.
    #[error("{who} panicked: {message}")]
    Panicked {
        /// The producer, a worker or the collector.
        who: &'static str,
        /// The text of the panic.
        message: String,
    },
    /// A thread ended early for a reason that another error names.
    #[error("{0} has ended early")]
    Ended(&'static str),
}

impl RunError {
    /// The error for a panic of a thread, with its text.
    pub(super) fn panicked(who: &'static str, payload: &(dyn Any + Send)) -> RunError {
        RunError::Panicked { who, message: panic_text(payload).to_owned() }
    }
}

impl From<RunError> for Error {
    fn from(e: RunError) -> Error {
        match e {
            RunError::Interrupted => Error::Interrupted,
            RunError::Schedule(e) => Error::input(e.to_string()),
            RunError::Thread { name, source } => Error::io("start the thread", name, source),
            e @ (RunError::Panicked { .. } | RunError::Ended(_)) => Error::Internal(e.to_string()),
        }
    }
}
