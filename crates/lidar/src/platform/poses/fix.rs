//! Records of a trajectory: fixes in the recorder's frame, poses in the world, and errors with their locations.

use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_geom::{DVec3, Rotation};

/// Position and attitude at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Seconds in the trajectory's own scale.
    pub time: f64,
    /// World coordinates, m.
    pub position: DVec3,
    /// Rotation from the platform's axes (x right, y forward, z up) to the world's.
    pub attitude: Rotation,
}

/// A record with its units resolved, in the recorder's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Seconds in the trajectory's own scale.
    pub time: f64,
    pub place: FixPlace,
    /// Attitude over the local horizon; on [`FixPlace::Geographic`] headings count from true north.
    pub attitude: Rotation,
    /// Roll, pitch and yaw as written, in text that states no unit for them.
    pub unitless_angles: Option<[f64; 3]>,
}

/// Position of a fix, in local or geographic coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FixPlace {
    /// x, y, z, m.
    Local([f64; 3]),
    /// Latitude and longitude, rad, and height, m.
    Geographic([f64; 3]),
}

/// Result of decoding the next bytes of a trajectory. Counts are bytes.
#[derive(Debug)]
pub enum Decoded<'t> {
    /// The beginning of a record; more bytes are needed.
    Incomplete,
    /// Bytes without a fix.
    Skipped(usize),
    /// A fix.
    Fix(usize, Fix, RecordPlace<'t>),
    /// An invalid record.
    Invalid(RecordPlace<'t>, RecordError),
}

#[derive(Clone, Debug)]
pub enum RecordPlace<'t> {
    /// A line, numbered from 1, and where its time is.
    Line { number: usize, text: Cow<'t, str>, time: Range<usize> },
    /// A record, numbered from 1, and its first byte.
    Record { number: u64, byte: u64 },
}

/// An error in a record.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordError {
    pub message: String,
    /// Bytes of the line to be marked; `None` marks the whole line.
    pub at: Option<Range<usize>>,
    pub help: &'static str,
}

impl RecordError {
    pub fn new(message: impl Into<String>) -> RecordError {
        RecordError { message: message.into(), at: None, help: "" }
    }

    pub fn help(self, help: &'static str) -> RecordError {
        RecordError { help, ..self }
    }
}

impl RecordPlace<'_> {
    pub fn time(&self) -> Option<Range<usize>> {
        match self {
            RecordPlace::Line { time, .. } => Some(time.clone()),
            RecordPlace::Record { .. } => None,
        }
    }

    pub fn error(&self, path: &Path, error: RecordError) -> Diagnostics {
        let mut found = Diagnostics::default();
        let reported = found.error(Some(self.place(path, error.at)), self.message(error.message));
        if !error.help.is_empty() {
            reported.help(error.help);
        }
        found
    }

    /// The error at this place of `path`, as a warning.
    pub fn warning(&self, path: &Path, error: RecordError) -> Diagnostics {
        let mut found = Diagnostics::default();
        found.warn(Some(self.place(path, error.at)), self.message(error.message));
        found
    }

    fn place(&self, path: &Path, at: Option<Range<usize>>) -> Place {
        match self {
            RecordPlace::Line { number, text, .. } => {
                Place::in_line(path, *number, text, at.unwrap_or(0..text.len()))
            }
            RecordPlace::Record { .. } => Place::in_line(path, 0, "", 0..0),
        }
    }

    fn message(&self, message: String) -> String {
        match self {
            RecordPlace::Line { .. } => message,
            RecordPlace::Record { number, byte } => format!("record {number} (byte {byte}): {message}"),
        }
    }
}
