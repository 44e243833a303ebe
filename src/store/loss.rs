//! Losses: parts of mapped files that turn out to be damaged or missing when they are accessed.

use super::mapped::{has_loss, take_loss};
use crate::error::{Error, Result};
use std::panic::{self, AssertUnwindSafe};

/// Fails if a part of a mapped file was lost. What was computed from mapped files before this call is then unusable.
///
/// # Errors
/// [`Error::Internal`], which [`catch_loss`] replaces by the error that describes the loss.
pub fn check_loss() -> Result<()> {
    if has_loss() { Err(Error::Internal("a part of a mapped file was lost".to_owned())) } else { Ok(()) }
}

/// Calls `run`, which reads mapped files. If a part of one is lost meanwhile, its result is replaced by an error that
/// describes the loss, even if it panicked. Before `run` commits what it computed, it must call [`check_loss`].
///
/// # Errors
/// Those of `run`; [`Error::Input`] for a damaged file, [`Error::Io`] for one that was shortened or cannot be read.
pub fn catch_loss<T>(run: impl FnOnce() -> Result<T>) -> Result<T> {
    let outcome = panic::catch_unwind(AssertUnwindSafe(run));
    match (take_loss(), outcome) {
        (Some(loss), _) => Err(loss.cause.error(&loss.path, &loss.bytes)),
        (None, Ok(result)) => result,
        (None, Err(reason)) => panic::resume_unwind(reason),
    }
}
