//! Errors of PLY files.

use crate::PositionsError;
use vlscan_base::columns::comma_note;
use vlscan_base::diag::{Problem, ProblemKind};

/// A PLY file that cannot be read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlyError {
    /// A header that is not text.
    #[error("its header is not text")]
    HeaderNotText,
    /// A header without the line `end_header`.
    #[error("its header has no end: expected the line end_header")]
    NoHeaderEnd,
    /// A file that ends where a number is expected.
    #[error("expected a number, found the end of the file; is it truncated?")]
    EndOfFile,
    /// A binary file that ends within an element.
    #[error("the file ends; is it truncated?")]
    Truncated,
    /// Another word than a number.
    #[error("expected a number, found {0:?}{note}", note = comma_note(.0))]
    NotANumber(String),
    /// A number that cannot be the length of a list.
    #[error("expected the length of a list, found {0}")]
    Length(f64),
    /// A header or an element that the parser does not accept.
    #[error("{what}")]
    Malformed {
        /// The message of the parser.
        what: String,
    },
    /// Vertices without positions.
    #[error("its vertices: {0}")]
    Positions(#[from] PositionsError),
    /// A file without vertices.
    #[error("it has no element \"vertex\"")]
    NoVertices,
    /// An element that cannot be read.
    #[error("{source} (after {at} of {count} elements \"{name}\")")]
    Element {
        /// Number of elements before.
        at: usize,
        /// Number of elements of the name.
        count: usize,
        /// The name of the element.
        name: String,
        /// The reason.
        source: Box<PlyError>,
    },
}

impl Problem for PlyError {
    fn kind(&self) -> ProblemKind {
        match self {
            PlyError::NoHeaderEnd | PlyError::EndOfFile | PlyError::Truncated => ProblemKind::Truncated,
            PlyError::Positions(error) => error.kind(),
            PlyError::Element { source, .. } => source.kind(),
            _ => ProblemKind::Invalid,
        }
    }
}
