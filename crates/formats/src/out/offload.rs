//! Jobs that the writer offloads to idle workers.

/// A job for another thread.
pub type Job = Box<dyn FnOnce() + Send>;

/// Executor of the writer's jobs, compressing and writing: normally the worker pool.
pub trait Offload: Send + Sync {
    /// Queues the job for another thread, or returns it when the queue is full; the writer then runs it.
    /// Never blocks. A queued job may be dropped: the writer runs the jobs that no worker has begun.
    fn try_run(&self, job: Job) -> Result<(), Job>;

    /// Threads that run jobs.
    fn threads(&self) -> usize {
        1
    }
}

/// Accepts no jobs: the writer does everything itself.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoOffload;

impl Offload for NoOffload {
    fn try_run(&self, job: Job) -> Result<(), Job> {
        Err(job)
    }
}
