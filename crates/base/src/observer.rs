//! The receiver of the notices of a running computation.

use crate::diag::{Diagnostics, Notice};
use crate::error::Result;
use std::sync::Arc;

/// Receives the notices of a computation, and decides if warnings end it.
#[derive(Clone)]
pub struct Observer {
    is_strict: bool,
    notify: Arc<dyn Fn(Notice) + Send + Sync>,
}

impl Observer {
    /// An observer that passes notices to `notify`; if it `is_strict`, warnings are errors.
    pub fn new(is_strict: bool, notify: impl Fn(Notice) + Send + Sync + 'static) -> Observer {
        Observer { is_strict, notify: Arc::new(notify) }
    }

    /// True if warnings are errors.
    pub fn is_strict(&self) -> bool {
        self.is_strict
    }

    /// Passes a notice on.
    pub fn notify(&self, notice: Notice) {
        (self.notify)(notice);
    }

    /// Passes information for every user on.
    pub fn note(&self, text: impl Into<String>) {
        self.notify(Notice::Note(text.into()));
    }

    /// Reports the next stage of the computation.
    pub fn step(&self, text: &'static str) {
        self.notify(Notice::Step(text));
    }

    /// Passes warnings and notes on.
    ///
    /// # Errors
    /// [`crate::Error::Input`] with the warnings if they are errors.
    pub fn warnings(&self, found: Diagnostics) -> Result<()> {
        self.notify(Notice::Warnings(found.finish(self.is_strict)?));
        Ok(())
    }

    /// The function that passes notices on.
    pub fn callback(&self) -> impl Fn(Notice) + Send + Sync + 'static + use<> {
        let notify = self.notify.clone();
        move |notice| notify(notice)
    }
}

impl Default for Observer {
    /// An observer that drops all notices and does not treat warnings as errors.
    fn default() -> Observer {
        Observer::new(false, |_| ())
    }
}

impl std::fmt::Debug for Observer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Observer").field("is_strict", &self.is_strict).finish_non_exhaustive()
    }
}
