//! Point clouds as lines of text.
//!
//! | file | what it does |
//! |---|---|
//! | `layout` | finds out what the columns of a file hold, from its first lines |
//! | `lines` | splits and parses lines |
//! | `rows` | reads lines as points |
//! | `read` | reads files and streams |
//! | `blocks` | blocks of lines parsed on several threads |
//! | `write`, `archive` | writes lines; compressed archives of lines, written and read |

mod archive;
mod blocks;
mod layout;
mod lines;
mod read;
mod rows;
mod write;

pub use archive::expand;
#[doc(hidden)]
pub use archive::{begin_archive, unzip};
pub use layout::{Layout, LayoutFinder};
pub use lines::{float, is_skipped};
pub(super) use lines::{is_line_end, last_of_line_ends, read_line};
pub(super) use read::read;
pub use rows::{BadRow, RowReader, Widths};
pub(crate) use write::{bin, csv, xyz};
