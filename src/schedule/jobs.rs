//! Side jobs of the collector (compression) that the workers take over.

use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use std::sync::Mutex;

/// A piece of work that carries its own way to deliver the result.
pub type Job = Box<dyn FnOnce() + Send>;

/// A bounded queue of jobs that workers empty before they take the next chunk.
#[derive(Debug)]
pub struct JobQueue {
    entrance: Mutex<Option<Sender<Job>>>,
    exit: Receiver<Job>,
}

impl JobQueue {
    /// A queue for at most `capacity` waiting jobs.
    pub fn new(capacity: usize) -> JobQueue {
        let (entrance, exit) = bounded(capacity.max(1));
        JobQueue { entrance: Mutex::new(Some(entrance)), exit }
    }

    /// No job is accepted any more; workers leave once the waiting ones are done.
    pub fn close(&self) {
        if let Ok(mut entrance) = self.entrance.lock() {
            *entrance = None;
        }
    }

    /// Where workers take jobs from; disconnected after [`JobQueue::close`].
    pub fn exit(&self) -> &Receiver<Job> {
        &self.exit
    }

    /// Takes the job, or hands it back for the caller to run itself. Never blocks.
    pub fn try_run(&self, job: Job) -> Result<(), Job> {
        match self.entrance.lock() {
            Ok(entrance) => match entrance.as_ref() {
                Some(sender) => sender.try_send(job).map_err(|e| match e {
                    TrySendError::Full(job) | TrySendError::Disconnected(job) => job,
                }),
                None => Err(job),
            },
            Err(_) => Err(job),
        }
    }
}
