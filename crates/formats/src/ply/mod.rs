//! PLY, the Polygon File Format, text and binary.
//!
//! | file | contents |
//! |---|---|
//! | `read`, `header`, `numbers`, `error` | reader; its header; its numbers in text; its errors |
//! | `write`, `ray_cloud` | writer; ray clouds |

mod error;
mod header;
mod numbers;
mod ray_cloud;
mod read;
mod write;

pub use error::PlyError;
pub use header::{is_ply, ply_header};
pub use numbers::PlyNumbers;
pub(crate) use ray_cloud::ray_cloud;
pub(crate) use read::read;
pub(crate) use write::{ascii, binary};
