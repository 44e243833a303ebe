//! One open output file of any format.

use super::Offload;
use super::layout::Content;
use super::medium::{Medium, Place};
use super::plan::OutputPlan;
use super::request::TrajectoryFormat;
use super::summary::{FileKind, FileSummary, Tally};
use super::text::TRAJECTORY_HEADER;
use crate::error::Result;
use std::path::PathBuf;

/// A file that batches are appended to.
pub(super) struct OutputFile {
    /// `None` is standard output.
    path: Option<PathBuf>,
    kind: FileKind,
    medium: Medium,
    body: Body,
    tally: Tally,
}

/// What surrounds the records.
enum Body {
    /// Nothing.
    Plain,
}

impl OutputFile {
    /// Opens a file and writes what comes before the first record.
    pub fn open(plan: &OutputPlan, place: &Place, content: Content) -> Result<OutputFile> {
        let body = Body::Plain;
        let mut medium = Medium::open(place, plan.force, false)?;
        if content == Content::Trajectory(TrajectoryFormat::Csv) {
            medium.append(TRAJECTORY_HEADER)?;
        }
        let path = match place {
            Place::Stdout => None,
            Place::Path(path) => Some(path.clone()),
        };
        Ok(OutputFile { path, kind: content.kind(), medium, body, tally: Tally::EMPTY })
    }

    /// Appends encoded records.
    pub fn append(&mut self, bytes: &[u8], tally: &Tally, _: &dyn Offload) -> Result<()> {
        self.tally.add(tally);
        match &mut self.body {
            Body::Plain => self.medium.append(bytes),
        }
    }

    /// Hands everything to the operating system.
    pub fn flush(&mut self) -> Result<()> {
        self.medium.flush()
    }

    /// Gives the file handle back until the next append.
    pub fn park(&mut self) -> Result<()> {
        self.medium.park()
    }

    /// Writes what comes after the last record and what is known only now, and completes the file.
    pub fn finish(self, _: &OutputPlan, _: &dyn Offload) -> Result<FileSummary> {
        let bytes = self.medium.len();
        self.medium.finish()?;
        Ok(FileSummary {
            path: self.path,
            kind: self.kind,
            records: self.tally.records,
            bytes,
            bounds: self.tally.bounds,
            by_return: self.tally.by_return,
            left_out: self.tally.left_out,
        })
    }
}
