//! Records of a trajectory: fixes in the recorder's frame, poses in the world, and errors with their
//! locations.

use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Error;
use vlscan_geom::{DVec3, Rotation};
use vlscan_tables::input::rows::{Row, RowError};

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

/// Place of a fix in its source.
#[derive(Clone, Copy, Debug)]
pub enum RecordPlace<'r> {
    /// A row of text or of an Arrow stream, and the column of its time.
    Row(&'r Row<'r>, usize),
    /// A record, numbered from 1, and its first byte.
    Record { number: u64, byte: u64 },
    /// The file as a whole.
    File,
}

/// An error in a record.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordError {
    pub message: String,
    pub help: &'static str,
    /// True if the time of the record is to be marked; otherwise all of it is.
    pub is_of_time: bool,
}

impl RecordError {
    pub fn new(message: impl Into<String>) -> RecordError {
        RecordError { message: message.into(), help: "", is_of_time: false }
    }

    pub fn help(self, help: &'static str) -> RecordError {
        RecordError { help, ..self }
    }
}

impl RecordPlace<'_> {
    /// The error at this place of `path`.
    pub fn error(&self, path: &Path, error: RecordError) -> Error {
        let help = error.help;
        self.located(path, error).with_help(help)
    }

    /// The error at this place of `path`, as a warning.
    pub fn warning(&self, path: &Path, error: RecordError) -> Diagnostics {
        let mut found = Diagnostics::default();
        let RowError { place, message } = self.located(path, error);
        found.warn(Some(place), message);
        found
    }

    fn located(&self, path: &Path, RecordError { message, is_of_time, .. }: RecordError) -> RowError {
        let place = Place::of_file(path);
        match self {
            RecordPlace::Row(row, time) => row.error(is_of_time.then_some(*time), message),
            RecordPlace::Record { number, byte } => {
                RowError { place, message: format!("record {number} (byte {byte}): {message}") }
            }
            RecordPlace::File => RowError { place, message },
        }
    }
}
