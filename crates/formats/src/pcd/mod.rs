//! PCD, the format of the Point Cloud Library.

mod read;
mod write;

pub(crate) use read::{is_pcd, read};
pub(crate) use write::pcd;
