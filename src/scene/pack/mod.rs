//! Packed scenes: everything that tracing needs in one file, mapped instead of read.
//!
//! A pack holds, for every epoch, the finished scene and the tree over it, as arrays that are used where they are in the
//! mapped file. It opens in milliseconds whatever its size, and processes that use the same pack share its memory. Parts,
//! materials and motions, the settings on which the scene depends (wavelength, seed, rules) and the files that it was made
//! from are stored beside the arrays. [`crate::store`] tells what opening checks and what it leaves to [`Pack::verify`].
//!
//! | file | what it does |
//! |---|---|
//! | `contents` | scenes as arrays and encoded values |
//! | `origin` | settings and files that a pack was made from, and when it is out of date |
//! | `read` | opens packs |
//! | `write` | packs scenes |

mod contents;
mod origin;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use read::Pack;
pub use write::pack;
