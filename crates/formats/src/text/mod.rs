//! Point clouds as lines of text.
//!
//! | file | what it does |
//! |---|---|
//! | `layout` | finds out what the columns of a file hold, from its first lines |
//! | `lines` | splits and parses lines |
//! | `read` | reads files and streams |

mod layout;
mod lines;
mod read;

pub use layout::{Layout, LayoutFinder};
pub use lines::{float, is_skipped};
pub(super) use lines::{is_line_end, last_of_line_ends, read_line};
pub(super) use read::read;
