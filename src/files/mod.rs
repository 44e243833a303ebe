//! The one writer of files: everything that the program writes goes through [`FileWriter`].
//!
//! * A named file is written under a temporary name of its own, `NAME.vlscan-1A2B3C4D.part` beside it, which no other
//!   run and no user shares. When it is complete, it is synchronised with the disk and renamed, and then its folder is
//!   synchronised.
//! * Symbolic links stay links: their target is written, also one that does not exist yet. Pipes, terminals and devices
//!   are written directly and never replaced.
//! * Temporary files are removed at every end of the process that allows it: an error, a signal ([`remove_temporary`]),
//!   a panic. Those of a killed process are removed by the next one that writes into their folder while no other does:
//!   every process holds a shared lock on the folders with its temporary files.
//!
//! | file | what it does |
//! |---|---|
//! | `writer` | [`FileWriter`]: a file, stream or scratch file that is written |
//! | `temporary` | temporary files and new folders; their removal |
//! | `positioned` | a file that several threads write, each at its own offset |
//! | `stream` | pipes, terminals and devices; how long a stopped run waits for their readers |
//! | `paths` | links, devices, names of partial files |
//! | `fault` | failures of chosen operations, for tests |

pub mod fault;
mod paths;
mod positioned;
mod stream;
mod temporary;
#[cfg(test)]
mod tests;
mod writer;

pub use paths::{free_name, identity, is_special, is_stdout, with_suffix};
pub use positioned::PositionedFile;
pub use stream::limit_waiting;
pub use temporary::{NewFolder, publish, remove_litter, remove_temporary};
pub(crate) use writer::scratch_failed;
pub use writer::{FileWriter, Patched, write_stderr, write_stdout};
