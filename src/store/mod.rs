//! Arrays in memory or in mapped files, and the file format of such arrays.
//!
//! | file | what it does |
//! |---|---|
//! | `array` | [`Store`]: a `Vec` or an array in a mapped file, read as a slice |
//! | `bytes` | encodes and decodes small values |
//! | `file` | the file format: named arrays, checksums of everything |
//! | `loss` | what becomes of a run whose file turns out to be damaged |
//! | `mapped` | mapped files, checked at the first access; the only `unsafe` code here |
//! | `sum` | checksums of values of any kind |

mod array;
mod bytes;
mod file;
mod loss;
mod mapped;
mod sum;

pub use array::Store;
pub use bytes::{ByteReader, ByteWriter, UnexpectedEnd};
pub use file::{ArrayFile, ArrayFileWriter};
pub use loss::{catch_loss, check_loss};
pub use mapped::FileBytes;
pub use sum::Checksum;
