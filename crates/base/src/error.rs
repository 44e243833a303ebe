//! Errors, and the exit status of the program.

use crate::diag::{Diagnostics, Problem, ProblemKind};
use std::path::{Path, PathBuf};

/// Result type of the crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// The errors that end a run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Invalid input; each problem has its place. Exit status 2, or that of its kind.
    #[error("{}", .0.headline())]
    Input(Box<Diagnostics>),
    /// A scan frequency outside the scanner's limits, or contradictory trajectory settings. Exit status 3, as
    /// in the reference.
    #[error("{}", .0.headline())]
    Limits(Box<Diagnostics>),
    /// An operation of the system failed: a file could not be read or written, the disk is full. Exit
    /// status 1.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// The failed operation: "read", "write", "create".
        action: &'static str,
        /// The file or stream.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The reader of the output closed it (`| head`). No message, exit status 0.
    #[error("the reader of the output closed it")]
    ClosedPipe,
    /// Interrupted by the user. Exit status 130.
    #[error("interrupted")]
    Interrupted,
    /// A thread of the pipeline failed; the message is meant for a bug report. Exit status 1.
    #[error("internal failure: {0}")]
    Internal(String),
    /// An error of the program that uses the library: of a sink, a scan pattern, a closure. Exit status 1.
    #[error(transparent)]
    Other(Box<dyn std::error::Error + Send + Sync>),
}

/// The cause of an [`Error::Input`] about a file that the caller named and that does not exist.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: there is no such file", path.display())]
pub struct MissingFile {
    /// The file.
    pub path: PathBuf,
}

impl Problem for MissingFile {
    fn kind(&self) -> ProblemKind {
        ProblemKind::NotFound
    }
}

impl Error {
    /// An I/O error of the operation `action` on `path`. A broken pipe becomes [`Error::ClosedPipe`]; a file
    /// that is too large to be read is invalid input.
    pub fn io(action: &'static str, path: impl AsRef<Path>, source: std::io::Error) -> Error {
        if source.kind() == std::io::ErrorKind::BrokenPipe {
            return Error::ClosedPipe;
        }
        if source.kind() == std::io::ErrorKind::FileTooLarge && action == "read" {
            let message = format!("cannot read {}: {source}", path.as_ref().display());
            return Error::input_of(ProblemKind::TooLarge, message);
        }
        Error::Io { action, path: path.as_ref().to_path_buf(), source }
    }

    /// The error for a file that cannot be opened for reading: a file that does not exist is invalid input.
    pub fn open(path: impl AsRef<Path>, source: std::io::Error) -> Error {
        let path = path.as_ref();
        match source.kind() {
            std::io::ErrorKind::NotFound => {
                let missing = MissingFile { path: path.to_path_buf() };
                Error::caused_by(missing.to_string(), missing)
            }
            _ => Error::io("read", path, source),
        }
    }

    /// A single input problem without a place in a file (a command-line value, a combination of options).
    pub fn input(message: impl Into<String>) -> Error {
        Error::input_of(ProblemKind::Invalid, message)
    }

    /// An error of the program that uses the library, which a run returns unchanged.
    ///
    /// ```
    /// use vlscan_base::Error;
    ///
    /// let error = Error::other("full".parse::<u8>().unwrap_err());
    /// let Error::Other(own) = error else { panic!() };
    /// assert!(own.is::<std::num::ParseIntError>());
    /// ```
    pub fn other(error: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Error {
        Error::Other(error.into())
    }

    /// The error for an output that exists and is not to be replaced.
    pub fn exists(path: impl AsRef<Path>) -> Error {
        let message = format!("{} exists already; overwrite it with --force", path.as_ref().display());
        Error::input_of(ProblemKind::Exists, message)
    }

    /// [`Error::input`] with a kind that programs can match.
    pub fn input_of(kind: ProblemKind, message: impl Into<String>) -> Error {
        let mut d = Diagnostics::default();
        d.error(None, message).of_kind(kind);
        Error::Input(Box::new(d))
    }

    /// [`Error::input`] with the error that caused it, and of its kind.
    pub fn caused_by(message: impl Into<String>, cause: impl Problem) -> Error {
        let mut d = Diagnostics::default();
        d.error(None, message).because_of(cause);
        Error::Input(Box::new(d))
    }

    /// The error for a run that cannot be divided into shards, or not continued with those that exist.
    pub fn not_divisible(message: impl Into<String>, help: impl Into<String>) -> Error {
        let mut d = Diagnostics::default();
        d.error(None, message).of_kind(ProblemKind::NotDivisible).help(help);
        Error::Input(Box::new(d))
    }

    /// The error for valid input that is not supported, with a hint what to do instead.
    pub fn unsupported(message: impl Into<String>, help: impl Into<String>) -> Error {
        let mut d = Diagnostics::default();
        d.error(None, message).of_kind(ProblemKind::Unsupported).help(help);
        Error::Input(Box::new(d))
    }

    /// [`Error::input`] with a hint how to solve the problem.
    pub fn input_with_help(message: impl Into<String>, help: impl Into<String>) -> Error {
        let mut d = Diagnostics::default();
        d.error(None, message).help(help);
        Error::Input(Box::new(d))
    }

    /// The error with the name of what has it in front of its messages: one of several runs.
    pub fn named(self, name: &str) -> Error {
        match self {
            Error::Input(problems) => Error::Input(Box::new(problems.named(name))),
            Error::Limits(problems) => Error::Limits(Box::new(problems.named(name))),
            other => other,
        }
    }

    /// The exit status of the process.
    pub fn exit_status(&self) -> u8 {
        match self {
            Error::ClosedPipe => 0,
            Error::Input(problems) if problems.has(ProblemKind::NotDivisible) => 4,
            Error::Input(problems) if problems.has(ProblemKind::InUse) => 5,
            Error::Input(_) => 2,
            Error::Limits(_) => 3,
            Error::Interrupted => 130,
            Error::Io { .. } | Error::Internal(_) | Error::Other(_) => 1,
        }
    }
}
