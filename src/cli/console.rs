//! What the user reads on stderr.

use crate::diag::{Diagnostics, Severity};
use crate::error::Error;
use std::fmt::Display;
use std::io::{IsTerminal, Write, stderr};

/// How much the user wants to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Verbosity {
    /// Nothing.
    Silent,
    /// Errors.
    Errors,
    /// Errors, warnings and the summary.
    #[default]
    Normal,
    /// What each stage did and how long it took, too.
    Verbose,
}

/// Writes messages to stderr.
#[derive(Clone, Copy, Debug)]
pub struct Console {
    verbosity: Verbosity,
    coloured: bool,
}

impl Console {
    /// A console of that verbosity; coloured when stderr is a terminal and `NO_COLOR` is not set.
    pub fn new(verbosity: Verbosity) -> Console {
        let coloured = stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty());
        Console { verbosity, coloured }
    }

    /// Whether messages of that level are shown.
    pub fn shows(&self, level: Verbosity) -> bool {
        self.verbosity >= level
    }

    /// One line of the normal level.
    pub fn say(&self, message: impl Display) {
        self.line(Verbosity::Normal, message);
    }

    /// One line for those who want to know more.
    pub fn detail(&self, message: impl Display) {
        self.line(Verbosity::Verbose, message);
    }

    /// All warnings, each with its place.
    pub fn warnings(&self, found: &Diagnostics) {
        if self.shows(Verbosity::Normal) {
            for d in found.items().iter().filter(|d| d.severity == Severity::Warning) {
                self.raw(&d.render(self.coloured));
            }
        }
    }

    /// The reason why the run ends.
    pub fn failure(&self, error: &Error) {
        if self.shows(Verbosity::Errors) {
            match error {
                Error::Input(found) | Error::Limits(found) => self.raw(&found.render(self.coloured)),
                other => self.raw(&format!(
                    "{} {other}\n",
                    if self.coloured { "\x1b[1;31merror:\x1b[0m" } else { "error:" }
                )),
            }
        }
    }

    fn line(&self, level: Verbosity, message: impl Display) {
        if self.shows(level) {
            self.raw(&format!("{message}\n"));
        }
    }

    fn raw(&self, text: &str) {
        // Nobody is left to be told when stderr is closed.
        let _ = stderr().lock().write_all(text.as_bytes());
    }
}
