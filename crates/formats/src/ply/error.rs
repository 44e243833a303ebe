//! Errors of PLY files.

use vlscan_base::columns::comma_note;

/// A PLY file that cannot be read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
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
    /// Another word than a number.
    #[error("expected a number, found {0:?}{note}", note = comma_note(.0))]
    NotANumber(String),
    /// A number that cannot be the length of a list.
    #[error("expected the length of a list, found {0}")]
    Length(f64),
}

impl From<PlyError> for String {
    fn from(error: PlyError) -> String {
        error.to_string()
    }
}
