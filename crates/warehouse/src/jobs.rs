//! Side jobs of the collector (compressing, writing) that workers execute.

use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use std::sync::{Mutex, PoisonError};

/// A job that delivers its result itself.
pub type Job = Box<dyn FnOnce() + Send>;

/// A bounded queue of jobs, which workers execute before they take the next chunk.
#[derive(Debug)]
pub struct JobQueue {
    /// `None` once the queue is closed.
    sender: Mutex<Option<Sender<Job>>>,
    queue_end: Receiver<Job>,
}

impl JobQueue {
    /// An open queue for at most `capacity` waiting jobs, at least one.
    pub fn new(capacity: usize) -> JobQueue {
        let (sender, queue_end) = bounded(capacity.max(1));
        JobQueue { sender: Mutex::new(Some(sender)), queue_end }
    }

    /// Closes the queue to new jobs; workers end once the queued ones are done.
    pub(super) fn close(&self) {
        *self.sender.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// Receiver of the jobs for workers; disconnected after [`JobQueue::close`].
    pub(super) fn queue_end(&self) -> &Receiver<Job> {
        &self.queue_end
    }

    /// Queues the job, or returns it for the caller to run. Never blocks.
    pub fn try_run(&self, job: Job) -> Result<(), Job> {
        match self.sender.lock().unwrap_or_else(PoisonError::into_inner).as_ref() {
            Some(sender) => sender.try_send(job).map_err(TrySendError::into_inner),
            None => Err(job),
        }
    }
}
