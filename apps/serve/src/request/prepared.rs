//! Prepared requests, and reasons to refuse one.

use crate::processes::Transmission;
use crate::queue::Use;
use crate::store::StoreError;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Why a request is refused.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// An input, and what is wrong with it.
    #[error("{key}: {message}")]
    Input {
        /// The input.
        key: String,
        /// Problem, and what to give instead.
        message: String,
    },
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
}

pub(super) fn wrong(key: &str, message: impl Into<String>) -> RequestError {
    RequestError::Input { key: key.to_owned(), message: message.into() }
}

/// Command of a job, and the files that it reads.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Prepared {
    /// Name and text of the pipeline or campaign, a file in the folder of inputs.
    pub document: Option<(String, String)>,
    /// Names and texts of areas and lines.
    pub geometries: Vec<(String, String)>,
    /// The words behind `vlscan`.
    pub words: Vec<String>,
    /// True if it works in the folder of inputs, else in that of results.
    pub within_inputs: bool,
    /// The file of results that standard output becomes.
    pub stdout: Option<String>,
    /// Command as a user would type it in the folder of the uploads.
    pub shown: String,
    /// Uploads and results that it reads.
    pub uses: BTreeSet<Use>,
    /// The outputs that a program requests; pages request none.
    pub outputs: Option<Outputs>,
}

/// Requested outputs, and the form of the results.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Outputs {
    /// The form.
    pub form: Form,
    /// Names of outputs, and how they are given; all if there are none.
    pub chosen: BTreeMap<String, Option<Transmission>>,
}

/// The form of results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Form {
    /// The outputs as they are, or links to them.
    #[default]
    Raw,
    /// A document that has or links all.
    Document,
}
