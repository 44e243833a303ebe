//! PLY, the Polygon File Format, text and binary.
//!
//! | file | contents |
//! |---|---|
//! | `read`, `header`, `numbers` | reader; its header; its numbers in text |

mod header;
mod numbers;
mod read;

pub use header::{is_ply, ply_header};
pub use numbers::PlyNumbers;
pub(crate) use read::read;
