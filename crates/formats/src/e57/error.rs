//! Errors of E57 files.

use vlscan_base::diag::{Problem, ProblemKind};

/// An E57 file that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum E57Error {
    /// A file that the library cannot open.
    #[error(transparent)]
    Library(#[from] ::e57::Error),
    /// Damaged sections.
    #[error("its sections are damaged")]
    Damaged,
    /// A scan that cannot be read.
    #[error("scan {number}{}: {source}", quoted(.name))]
    Scan {
        /// Number of the scan, from 1.
        number: usize,
        /// Name of the scan.
        name: Option<String>,
        /// The reason.
        source: ScanError,
    },
}

/// The reason why a scan of an E57 file cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScanError {
    /// Points without coordinates.
    #[error("its points have neither Cartesian nor spherical coordinates")]
    NoCoordinates,
    /// Points whose number is not stored, because they are all equal.
    #[error("all its values are constant")]
    Constant,
    /// Points that the library cannot read.
    #[error(transparent)]
    Library(#[from] ::e57::Error),
}

fn quoted(name: &Option<String>) -> String {
    name.as_ref().map_or_else(String::new, |name| format!(" ({name:?})"))
}

impl Problem for E57Error {
    fn kind(&self) -> ProblemKind {
        match self {
            E57Error::Library(::e57::Error::NotImplemented { .. })
            | E57Error::Scan {
                source: ScanError::Constant | ScanError::Library(::e57::Error::NotImplemented { .. }),
                ..
            } => ProblemKind::Unsupported,
            _ => ProblemKind::Invalid,
        }
    }
}
