//! Errors of PCD files.

use crate::PositionsError;
use vlscan_base::columns::comma_note;
use vlscan_base::diag::{Problem, ProblemKind};

/// A PCD file that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PcdError {
    /// A header that does not end.
    #[error("its header has no line DATA")]
    NoData,
    /// A header without the number of points.
    #[error("its header has no POINTS")]
    NoPoints,
    /// A line of the header without a number.
    #[error("its {keyword} is not a number")]
    NotANumber {
        /// The first word of the line.
        keyword: &'static str,
    },
    /// An unknown encoding.
    #[error("expected DATA ascii, binary or binary_compressed, found {found:?}")]
    Encoding {
        /// The word after DATA.
        found: String,
    },
    /// A line of the header with more or fewer values than there are fields.
    #[error("its header has {fields} FIELDS, and {found} values after {keyword}")]
    FieldCount {
        /// Number of fields.
        fields: usize,
        /// Number of values of the line.
        found: usize,
        /// The first word of the line.
        keyword: &'static str,
    },
    /// A field whose size, type or count is not valid.
    #[error("expected SIZE, TYPE and COUNT of its field {name:?}")]
    Field {
        /// The name of the field.
        name: String,
    },
    /// Fields without positions.
    #[error(transparent)]
    Positions(#[from] PositionsError),
    /// A word of a text file that is not the expected value.
    #[error("point {point} (from 0): expected {expected}, found {found:?}{note}", note = comma_note(.found))]
    Value {
        /// Number of the point, from 0.
        point: usize,
        /// The expected value.
        expected: &'static str,
        /// The word.
        found: String,
    },
    /// A file that ends before its last point.
    #[error("it ends after {held} of {stated} points; is the file truncated?")]
    Truncated {
        /// Number of points in the file.
        held: usize,
        /// Number of points by the header.
        stated: usize,
    },
    /// A file that ends within its compressed points.
    #[error("it ends within its compressed points; is the file truncated?")]
    CompressedPointsEnd,
    /// Compressed points whose size differs from the header's.
    #[error("its {points} points are said to take {bytes} bytes")]
    CompressedSize {
        /// Number of points by the header.
        points: usize,
        /// Stated size of the decompressed points, bytes.
        bytes: usize,
    },
    /// Compressed points that cannot be decompressed.
    #[error("its compressed points are damaged")]
    Damaged,
}

impl Problem for PcdError {
    fn kind(&self) -> ProblemKind {
        match self {
            PcdError::NoData | PcdError::Truncated { .. } | PcdError::CompressedPointsEnd => {
                ProblemKind::Truncated
            }
            PcdError::Encoding { .. } => ProblemKind::Unsupported,
            PcdError::Positions(error) => error.kind(),
            _ => ProblemKind::Invalid,
        }
    }
}
