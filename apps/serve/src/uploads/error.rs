//! Why an upload is refused.

use crate::store::StoreError;
use axum::extract::multipart::MultipartError;
use std::io;

/// Why an upload is refused.
#[derive(Debug, thiserror::Error)]
pub enum UploadError {
    /// It is not as it should be.
    #[error("{0}")]
    Wrong(String),
    /// It is larger than allowed.
    #[error("{0}")]
    TooLarge(String),
    /// The owner has an upload of that name.
    #[error("there is an upload `{0}` already; choose another name, or remove that one first")]
    Taken(String),
    /// The form is not from a page of the service.
    #[error("the form is from an older page; load the page again")]
    Forged,
    /// The connection.
    #[error("the upload ended early: {0}")]
    Form(#[from] MultipartError),
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl From<io::Error> for UploadError {
    fn from(error: io::Error) -> UploadError {
        UploadError::Store(StoreError::Files(error))
    }
}

/// The files of an owner would take more than is allowed.
pub(super) fn too_much(max_stored: u64) -> UploadError {
    UploadError::TooLarge(format!(
        "your uploads and jobs would take more than {max_stored} bytes; remove some first"
    ))
}
