//! One record of a trajectory as it stands there.

use crate::diag::{Diagnostics, Place};
use crate::geom::Rotation;
use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;

/// A record, with units resolved but in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Seconds in the trajectory's own scale.
    pub time: f64,
    pub place: FixPlace,
    /// Attitude over the local horizon; on [`FixPlace::Geographic`] headings count from true north.
    pub attitude: Rotation,
    /// Roll, pitch and yaw as they stand in text that names no unit for them.
    pub unitless_angles: Option<[f64; 3]>,
}

/// Where a fix is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FixPlace {
    /// x, y, z, m.
    Local([f64; 3]),
    /// Latitude and longitude, rad, and height, m.
    Geographic([f64; 3]),
}

/// Where a fix stands in its trajectory.
#[derive(Clone, Debug)]
pub enum Mark<'t> {
    Line { number: usize, text: Cow<'t, str>, time: Range<usize> },
    Record { number: u64, byte: u64 },
}

/// What is wrong with a fix.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    pub message: String,
    /// Bytes of the line to be marked; all of them where nothing is said.
    pub at: Option<Range<usize>>,
    pub help: &'static str,
}

impl Problem {
    pub fn new(message: impl Into<String>) -> Problem {
        Problem { message: message.into(), at: None, help: "" }
    }

    pub fn help(self, help: &'static str) -> Problem {
        Problem { help, ..self }
    }
}

impl Mark<'_> {
    /// Where the time stands, if that is known.
    pub fn time(&self) -> Option<Range<usize>> {
        match self {
            Mark::Line { time, .. } => Some(time.clone()),
            Mark::Record { .. } => None,
        }
    }

    /// The problem at this place of `path` as an error.
    pub fn error(&self, path: &Path, problem: Problem) -> Diagnostics {
        let mut found = Diagnostics::default();
        let error = found.error(Some(self.place(path, problem.at.clone())), self.told(problem.message));
        if !problem.help.is_empty() {
            error.help(problem.help);
        }
        found
    }

    /// The problem at this place of `path` as a warning.
    pub fn warn(&self, path: &Path, problem: Problem, warnings: &mut Diagnostics) {
        warnings.warn(Some(self.place(path, problem.at)), self.told(problem.message));
    }

    fn place(&self, path: &Path, at: Option<Range<usize>>) -> Place {
        match self {
            Mark::Line { number, text, .. } => {
                Place::in_line(path, *number, text, at.unwrap_or(0..text.len()))
            }
            Mark::Record { .. } => Place::in_line(path, 0, "", 0..0),
        }
    }

    fn told(&self, message: String) -> String {
        match self {
            Mark::Line { .. } => message,
            Mark::Record { number, byte } => format!("record {number} (byte {byte}): {message}"),
        }
    }
}
