//! PCD, the format of the Point Cloud Library.

mod error;
mod read;
mod write;

pub use error::PcdError;
pub(crate) use read::{is_pcd, read};
pub(crate) use write::pcd;
