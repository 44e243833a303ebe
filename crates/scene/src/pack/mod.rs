//! Packed scenes: all data for tracing in one file.
//!
//! For every epoch a pack contains the finished scene and its tree, as arrays that are read into memory as
//! they are, and compared with their checksums. Parts, materials and motions, the settings on which the scene
//! depends (wavelength, seed, rules) and its source files are stored with the arrays. Tiles of a scene have
//! arrays of their own, which are read when rays need them. References in the arrays are checked only by
//! [`Pack::verify`].
//!
//! | file | what it does |
//! |---|---|
//! | `colours` | colours of surfaces |
//! | `contents` | scenes as arrays and encoded values |
//! | `origin` | settings and files that a pack was made from, and whether they have changed |
//! | `read` | opens packs |
//! | `tiles` | parts of a scene that are read when rays need them |
//! | `trees` | trees, geometry and instances as arrays |
//! | `write` | packs scenes |

mod colours;
mod contents;
mod origin;
mod read;
#[cfg(test)]
mod tests;
mod tiles;
mod trees;
mod write;

pub use read::Pack;
pub use write::pack;
