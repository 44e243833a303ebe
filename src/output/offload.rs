//! Work that the writer gives away.

/// A job that the writer gives away.
pub type Job = Box<dyn FnOnce() + Send>;

/// Takes compression jobs off the writer: the worker pool, normally.
pub trait Offload: Send + Sync {
    /// Runs the job some time on another thread, or hands it back when there is no room for it now; then the writer runs
    /// it. Never waits. A job that was taken may also be dropped: the writer does what nobody has begun.
    fn try_run(&self, job: Job) -> Result<(), Job>;
}

/// Takes no job: the writer does everything itself.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoOffload;

impl Offload for NoOffload {
    fn try_run(&self, job: Job) -> Result<(), Job> {
        Err(job)
    }
}
