//! The one writer of files: everything that the program writes goes through [`FileWriter`].
//!
//! * A named file is written under a temporary name, `NAME.vlscan-1A2B3C4D.part` in the same folder, which no
//!   other run and no user shares. When it is complete, it is synchronised with the disk and renamed, and
//!   then its folder is synchronised.
//! * Symbolic links stay links: their target is written, also one that does not exist yet. Pipes, terminals
//!   and devices are written directly and never replaced.
//! * No output replaces a file that the same command has read, under any name ([`reads`]).
//! * Files that are one output get their names together ([`FileGroup`]).
//! * Temporary files are removed at every end of the process that allows it: an error, a signal
//!   ([`remove_temporary`]), a panic. Those of a killed process are removed by the next one that writes into
//!   their folder while no other does: every process holds a shared lock on the folders with its temporary
//!   files.
//!
//! | file | what it does |
//! |---|---|
//! | `writer` | [`FileWriter`]: a file, stream or scratch file that is written |
//! | `group` | [`FileGroup`]: files that get their names together |
//! | `temporary` | temporary files and new folders; their removal |
//! | `undo` | the names that a killed process has given are taken back |
//! | `positioned` | files that several threads write or read, each at its own offset |
//! | `stream` | pipes, terminals and devices; how long a stopped run waits for their readers |
//! | `paths` | links, devices, names of partial files |
//! | `reads` | files that are opened for reading: what was read, and that no output replaces it |
//! | `fault` | failures of chosen operations, for tests |

pub mod fault;
mod group;
mod paths;
mod positioned;
pub mod reads;
mod stream;
mod temporary;
#[cfg(any(test, feature = "testkit"))]
pub mod testkit;
#[cfg(test)]
mod tests;
mod undo;
mod writer;

pub use group::FileGroup;
pub use paths::{free_name, identity, is_special, is_stdout, means_stdout, with_suffix};
pub use positioned::{PositionedFile, read_exact_at};
pub use reads::{FileLog, FileSet, ReadGuard, Reads, Stamp, ThreadLogs};
pub use stream::limit_waiting;
pub use temporary::{
    NewFolder, TemporaryFolder, is_taken, is_temporary_name, publish, refuse_existing, refuse_unwritable,
    remove_litter, remove_temporary,
};
pub use writer::scratch_failed;
pub use writer::{FileWriter, Patched, write_file, write_stderr, write_stdout};
