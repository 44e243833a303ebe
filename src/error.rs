//! What can go wrong, and how the program ends when it does.

use crate::diag::Diagnostics;
use std::path::{Path, PathBuf};

/// Shorthand used throughout the crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Every error that a run can end with.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The input is wrong; each problem has its place. Exit status 2.
    #[error("{}", .0.headline())]
    Input(Box<Diagnostics>),
    /// A scan frequency outside the scanner's limits, or trajectory settings that contradict each other; the
    /// reference's exit status 3 is kept.
    #[error("{}", .0.headline())]
    Limits(Box<Diagnostics>),
    /// The machine failed: a file could not be read or written, the disk is full. Exit status 1.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// What was tried: "read", "write", "create".
        action: &'static str,
        /// The file or stream.
        path: PathBuf,
        /// The operating system's answer.
        source: std::io::Error,
    },
    /// The reader of our output went away (`| head`). A quiet end, exit status 0.
    #[error("the reader of the output closed it")]
    ClosedPipe,
    /// Interrupted by the user. Exit status 130.
    #[error("interrupted")]
    Interrupted,
    /// A thread of the pipeline failed; the message is for a bug report. Exit status 1.
    #[error("internal failure: {0}")]
    Internal(String),
}

impl Error {
    /// An I/O error with what was tried on which path. A broken pipe becomes [`Error::ClosedPipe`].
    pub fn io(action: &'static str, path: impl AsRef<Path>, source: std::io::Error) -> Error {
        if source.kind() == std::io::ErrorKind::BrokenPipe {
            return Error::ClosedPipe;
        }
        Error::Io { action, path: path.as_ref().to_path_buf(), source }
    }

    /// The error for a file that cannot be opened for reading: a file that does not exist is wrong input.
    pub fn open(path: impl AsRef<Path>, source: std::io::Error) -> Error {
        let path = path.as_ref();
        match source.kind() {
            std::io::ErrorKind::NotFound => {
                Error::input(format!("{}: there is no such file", path.display()))
            }
            _ => Error::io("read", path, source),
        }
    }

    /// One input problem without a place in a file (a command-line value, a combination of options).
    pub fn input(message: impl Into<String>) -> Error {
        let mut d = Diagnostics::default();
        d.error(None, message);
        Error::Input(Box::new(d))
    }

    /// The status the process ends with.
    pub fn exit_status(&self) -> u8 {
        match self {
            Error::ClosedPipe => 0,
            Error::Input(_) => 2,
            Error::Limits(_) => 3,
            Error::Interrupted => 130,
            Error::Io { .. } | Error::Internal(_) => 1,
        }
    }
}
