//! Destinations of encoded points: buffered streams of bytes to files and pipes, with jobs for idle threads.
//!
//! | file | contents |
//! |---|---|
//! | `stream` | one output: a file, a pipe or standard output |
//! | `offload` | jobs for idle threads |
//! | `writes` | writes of large pieces by such jobs |
//! | `blocks` | compression of blocks by such jobs |

mod blocks;
mod offload;
mod stream;
mod writes;

pub(crate) use blocks::{BlockCompressor, BlockError};
pub use offload::{Job, NoOffload, Offload};
pub use stream::{Destination, OutputStream};
