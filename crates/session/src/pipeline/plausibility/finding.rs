//! An implausible property of the input.

use vlscan_base::diag::{Diagnostics, Place};

/// An implausible property of the input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Finding {
    /// Observation.
    pub(super) message: String,
    /// Likely cause and remedy.
    pub(super) help: String,
}

impl Finding {
    pub fn new(message: impl Into<String>, help: impl Into<String>) -> Finding {
        Finding { message: message.into(), help: help.into() }
    }

    /// Converts the finding to a warning at a place of the input.
    pub fn into_warning(self, place: Option<Place>) -> Diagnostics {
        let mut found = Diagnostics::default();
        found.warn(place, self.message).help(self.help);
        found
    }
}
