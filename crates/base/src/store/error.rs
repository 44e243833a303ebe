//! Errors of files of arrays.

use crate::diag::{Problem, ProblemKind};

/// A file of arrays that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ArrayFileError {
    /// A pipe, a folder or a device.
    #[error("it is a pipe, a folder or a device, expected a regular file")]
    NotRegular,
    /// A file without a header.
    #[error("the file is too short to be a packed scene")]
    TooShort,
    /// A file of another format.
    #[error("it is not a packed scene")]
    Foreign,
    /// A file of a machine of the other byte order.
    #[error("it was made on a machine of the other byte order; pack the scene again")]
    ByteOrder,
    /// A file of another version.
    #[error("it has version {found}, this program reads {expected}; pack the scene again")]
    Version {
        /// Version of the file.
        found: u32,
        /// Version that is read.
        expected: u32,
    },
    /// A file whose length differs from its header's.
    #[error("it has {length} bytes instead of {stated}; is it truncated?")]
    Length {
        /// Length of the file, bytes.
        length: u64,
        /// Length by the header, bytes.
        stated: u64,
    },
    /// Bytes that do not match their checksum.
    #[error("it is damaged: {what} do not match their checksum; pack the scene again")]
    Damaged {
        /// The bytes.
        what: String,
    },
    /// A missing array.
    #[error("the array {name} is missing")]
    Missing {
        /// Name of the array.
        name: String,
    },
    /// An array or a value of another type.
    #[error("the {kind} {name} has another layout")]
    Layout {
        /// Array or value.
        kind: &'static str,
        /// Its name.
        name: String,
    },
    /// An array that is larger than the memory.
    #[error("it does not fit into the memory")]
    TooLarge,
}

impl Problem for ArrayFileError {
    fn kind(&self) -> ProblemKind {
        match self {
            ArrayFileError::TooShort | ArrayFileError::Length { .. } => ProblemKind::Truncated,
            ArrayFileError::ByteOrder | ArrayFileError::Version { .. } => ProblemKind::Unsupported,
            ArrayFileError::TooLarge => ProblemKind::TooLarge,
            _ => ProblemKind::Invalid,
        }
    }
}
