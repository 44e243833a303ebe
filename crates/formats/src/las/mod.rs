//! LAS and LAZ (ASPRS LAS 1.0 to 1.5).

mod read;

pub(crate) use read::read;
pub use read::{ExtraDimension, Header, LasReader, Selection};
