//! One open output file of any format.

use super::archive::ArchiveStream;
use super::layout::Content;
use super::layout::FilePlan;
use super::laz::{self, LazStream};
use super::medium::{Medium, Place};
use super::offload::Offload;
use super::plan::OutputPlan;
use super::ply;
use super::request::{PointFormat, TrajectoryFormat};
use super::summary::{FileKind, FileSummary, Tally};
use super::text::TRAJECTORY_HEADER;
use crate::error::{Error, Result};
use ::laz::LazVlr;
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
    /// Nothing that is known only at the end.
    Plain,
    /// Lines as records of a compressed archive.
    Archive(ArchiveStream),
    /// A header that counts and bounds the points.
    Las,
    Laz(LazVlr, LazStream),
    /// A header that counts the points.
    Ply(PointFormat),
}

impl OutputFile {
    /// Opens a file and writes what comes before the first record. A header that is not known yet is left blank, so that
    /// the beginnings of a file do not pass for the whole.
    pub fn open(plan: &OutputPlan, place: &Place, file: &FilePlan) -> Result<OutputFile> {
        let content = file.content;
        let counts = matches!(content, Content::Points(format) if format.counts());
        let mut medium = Medium::open(place, plan.force, counts)?;
        let body = match content {
            _ if file.zipped => Body::Archive(ArchiveStream::begin(&mut medium)?),
            Content::Points(PointFormat::Las) => {
                medium.append(&vec![0; plan.las.head(None, &Tally::EMPTY).len()])?;
                Body::Las
            }
            Content::Points(PointFormat::Laz) => {
                let laszip = laz::laszip(&plan.las)?;
                medium.append(&vec![0; plan.las.head(Some(&laszip), &Tally::EMPTY).len()])?;
                let stream = LazStream::begin(laszip.clone(), plan.las.record_length(), &mut medium)?;
                Body::Laz(laszip, stream)
            }
            Content::Points(format @ (PointFormat::PlyBinary | PointFormat::PlyAscii)) => {
                medium.append(&vec![b' '; ply::head(format, plan.epsg, &plan.objects, 0).len()])?;
                Body::Ply(format)
            }
            Content::Trajectory(TrajectoryFormat::Csv) => {
                medium.append(TRAJECTORY_HEADER)?;
                Body::Plain
            }
            _ => Body::Plain,
        };
        let path = match place {
            Place::Stdout => None,
            Place::Path(path) => Some(path.clone()),
        };
        Ok(OutputFile { path, kind: content.kind(), medium, body, tally: Tally::EMPTY })
    }

    /// Appends encoded records.
    pub fn append(
        &mut self,
        plan: &OutputPlan,
        bytes: &[u8],
        tally: &Tally,
        offload: &dyn Offload,
    ) -> Result<()> {
        self.tally.add(tally);
        match &mut self.body {
            Body::Laz(_, stream) => stream.append(bytes, &mut self.medium, offload)?,
            Body::Archive(stream) => stream.append(bytes, &mut self.medium, offload)?,
            Body::Plain | Body::Las | Body::Ply(_) => self.medium.append(bytes)?,
        }
        if matches!(self.body, Body::Las | Body::Laz(..)) && self.tally.records > plan.las.most_points() {
            let most = plan.las.most_points();
            return Err(Error::input(format!(
                "a file of LAS 1.0 holds at most {most} points; write LAS 1.4"
            )));
        }
        Ok(())
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
    pub fn finish(mut self, plan: &OutputPlan, offload: &dyn Offload) -> Result<FileSummary> {
        let mut bounds = self.tally.bounds;
        match self.body {
            Body::Plain => {}
            Body::Archive(stream) => stream.finish(&mut self.medium, offload)?,
            Body::Las => {
                self.medium.patch(0, &plan.las.head(None, &self.tally))?;
                bounds = plan.las.world(&bounds);
            }
            Body::Laz(laszip, stream) => {
                stream.finish(&mut self.medium, offload)?;
                self.medium.patch(0, &plan.las.head(Some(&laszip), &self.tally))?;
                bounds = plan.las.world(&bounds);
            }
            Body::Ply(format) => {
                self.medium.patch(0, &ply::head(format, plan.epsg, &plan.objects, self.tally.records))?;
            }
        }
        let bytes = self.medium.len();
        self.medium.finish()?;
        let Tally { records, left_out, by_return, .. } = self.tally;
        Ok(FileSummary { path: self.path, kind: self.kind, records, bytes, bounds, by_return, left_out })
    }
}
