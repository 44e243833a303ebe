//! PCD, the format of the Point Cloud Library.

mod read;

pub(crate) use read::{is_pcd, read};
