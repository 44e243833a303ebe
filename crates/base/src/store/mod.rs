//! Arrays in files, the bytes of files, and checksums.
//!
//! | file | what it does |
//! |---|---|
//! | `error` | errors of such files |
//! | `file` | the file format of named arrays and values, with checksums of everything |
//! | `file_bytes` | the bytes of a file: read, or mapped if there are very many; temporary files; the only `unsafe` code here |
//! | `sum` | checksums of values of any kind |

mod error;
mod file;
mod file_bytes;
mod sum;

pub use error::ArrayFileError;
pub use file::{ArrayFile, ArrayFileWriter};
pub use file_bytes::{FileBytes, ScratchFile};
pub use sum::Checksum;

/// Memory that a vector holds, bytes.
pub fn vec_bytes<T>(values: &Vec<T>) -> usize {
    values.capacity() * size_of::<T>()
}
