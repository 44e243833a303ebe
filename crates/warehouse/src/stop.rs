//! Request to stop a run early.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// The caller's request to stop early. Any number of runs can share it: a request ends all of them, and the
/// failure of one ends no other.
#[derive(Debug, Default)]
pub struct Stop {
    requested: AtomicBool,
    /// Number of runs with open outputs.
    open: AtomicUsize,
}

impl Stop {
    /// Creates a request that is not made yet.
    pub const fn new() -> Stop {
        Stop { requested: AtomicBool::new(false), open: AtomicUsize::new(0) }
    }

    /// Requests the stop.
    pub fn request(&self) {
        self.requested.store(true, Ordering::Relaxed);
    }

    /// True if the stop was requested.
    pub fn is_requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }

    /// Outputs of a run, not open yet.
    pub fn outputs(&self) -> OpenOutputs<'_> {
        OpenOutputs { stop: self, is_open: AtomicBool::new(false) }
    }

    /// True if outputs are open, so that a requested stop has to complete them. Otherwise nothing has been
    /// measured, or everything is closed, and the process can be ended at once.
    pub fn has_open_outputs(&self) -> bool {
        self.open.load(Ordering::Relaxed) > 0
    }
}

/// Outputs of a run. [`Stop::has_open_outputs`] is true from [`OpenOutputs::open`] until the drop.
#[derive(Debug)]
pub struct OpenOutputs<'a> {
    stop: &'a Stop,
    is_open: AtomicBool,
}

impl OpenOutputs<'_> {
    /// Records that the outputs are open.
    pub fn open(&self) {
        if !self.is_open.swap(true, Ordering::Relaxed) {
            self.stop.open.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl Drop for OpenOutputs<'_> {
    fn drop(&mut self) {
        if *self.is_open.get_mut() {
            self.stop.open.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

/// State of one run, which its threads share.
#[derive(Debug)]
pub struct RunState<'a> {
    stop: &'a Stop,
    failed: AtomicBool,
}

impl<'a> RunState<'a> {
    pub(super) fn new(stop: &'a Stop) -> RunState<'a> {
        RunState { stop, failed: AtomicBool::new(false) }
    }

    /// True if the caller has requested the stop, or a thread of this run has failed.
    pub fn is_stopped(&self) -> bool {
        self.stop.is_requested() || self.failed.load(Ordering::Relaxed)
    }

    /// Stops the other threads of this run.
    pub(super) fn fail(&self) {
        self.failed.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_open_from_when_they_say_so_until_they_are_dropped() {
        let stop = Stop::new();
        let (one, other) = (stop.outputs(), stop.outputs());
        assert!(!stop.has_open_outputs());
        one.open();
        one.open();
        other.open();
        drop(one);
        assert!(stop.has_open_outputs(), "those of the other run");
        drop(other);
        assert!(!stop.has_open_outputs());
        drop(stop.outputs());
        assert!(!stop.has_open_outputs());
    }
}
