//! Arrays that live in memory or in a mapped file, and the file of such arrays.
//!
//! | file | what it does |
//! |---|---|
//! | `array` | [`Store`]: a `Vec`, or a part of a mapped file, seen as a slice |
//! | `file` | the container: named arrays behind a checked header and table |
//! | `bytes` | small values, one after the other |

mod array;
mod bytes;
mod file;

pub use array::Store;
pub use bytes::{ByteReader, ByteWriter, UnexpectedEnd};
pub use file::{ArrayFile, ArrayFileWriter};
