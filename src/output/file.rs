//! One open output file of any format.

use super::archive::ArchiveStream;
use super::arrow::{ArrowStream, ParquetStream};
use super::encode::Piece;
use super::las::{PACKETS_HEADER, packets_header, place_packets};
use super::layout::Content;
use super::layout::FilePlan;
use super::laz::{self, LazStream};
use super::medium::{Medium, Place};
use super::offload::Offload;
use super::plan::{OutputPlan, packets_path};
use super::ply;
use super::request::{PacketPlace, PointFormat, TrajectoryFormat};
use super::summary::{FileKind, FileSummary, Tally};
use super::table;
use super::text::TRAJECTORY_HEADER;
use crate::error::{Error, Result};
use ::laz::LazVlr;
use std::path::{Path, PathBuf};

/// A file that batches are appended to.
pub(super) struct OutputFile {
    /// `None` is standard output.
    path: Option<PathBuf>,
    kind: FileKind,
    medium: Medium,
    body: Body,
    tally: Tally,
    packets: Option<Packets>,
}

/// The waveform packets of a LAS file.
struct Packets {
    /// The file beside it; `None`: they are collected in an unnamed file and moved behind the points at the end.
    path: Option<PathBuf>,
    medium: Medium,
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
    /// Batches of rows.
    Arrow(Box<ArrowStream>),
    /// Row groups, and a footer that lists them.
    Parquet(Box<ParquetStream>),
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
                medium.append(&vec![0; plan.las.head(None, &Tally::EMPTY, None).len()])?;
                Body::Las
            }
            Content::Points(PointFormat::Laz) => {
                let laszip = laz::laszip(&plan.las)?;
                medium.append(&vec![0; plan.las.head(Some(&laszip), &Tally::EMPTY, None).len()])?;
                let stream = LazStream::begin(laszip.clone(), plan.las.record_length(), &mut medium)?;
                Body::Laz(laszip, stream)
            }
            Content::Points(format @ (PointFormat::PlyBinary | PointFormat::PlyAscii)) => {
                medium.append(&vec![
                    b' ';
                    ply::head(format, plan.epsg, &plan.objects, plan.ply_more(), 0).len()
                ])?;
                Body::Ply(format)
            }
            Content::Points(PointFormat::Xyz) if plan.columns_chosen => {
                medium.append(&table::header(&plan.columns, b' '))?;
                Body::Plain
            }
            Content::Points(PointFormat::Csv) => {
                medium.append(&table::header(&plan.columns, b','))?;
                Body::Plain
            }
            Content::Points(PointFormat::Arrow) => {
                Body::Arrow(Box::new(ArrowStream::new(&plan.columns, plan.schema.clone())?))
            }
            Content::Points(PointFormat::Parquet) => {
                Body::Parquet(Box::new(ParquetStream::new(&plan.columns, plan.schema.clone())?))
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
        let packets = match (content, plan.las.packet_place()) {
            (Content::Points(format), Some(place)) if format.is_las() => {
                Some(Packets::open(plan, place, path.as_deref())?)
            }
            _ => None,
        };
        Ok(OutputFile { path, kind: content.kind(), medium, body, tally: Tally::EMPTY, packets })
    }

    /// Appends encoded records.
    pub fn append(&mut self, plan: &OutputPlan, mut piece: Piece, offload: &dyn Offload) -> Result<()> {
        self.tally.add(&piece.tally);
        if let Some(packets) = &mut self.packets {
            place_packets(&mut piece.bytes, plan.las.record_length(), packets.medium.len());
            packets.medium.append(&piece.packets)?;
        }
        let bytes = &piece.bytes;
        match &mut self.body {
            Body::Laz(_, stream) => stream.append(bytes, &mut self.medium, offload)?,
            Body::Archive(stream) => stream.append(bytes, &mut self.medium, offload)?,
            Body::Arrow(stream) => stream.append(bytes, |bytes| self.medium.append(bytes))?,
            Body::Parquet(stream) => stream.append(bytes, |bytes| self.medium.append(bytes))?,
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
    pub fn flush(&mut self, plan: &OutputPlan) -> Result<()> {
        if let Body::Arrow(stream) = &mut self.body
            && plan.live
            && self.medium.is_stream()
        {
            stream.flush(|bytes| self.medium.append(bytes))?;
        }
        self.packets.iter_mut().try_for_each(|packets| packets.medium.flush())?;
        self.medium.flush()
    }

    /// Gives the file handle back until the next append.
    pub fn park(&mut self) -> Result<()> {
        self.packets.iter_mut().try_for_each(|packets| packets.medium.park())?;
        self.medium.park()
    }

    /// Writes what comes after the last record and what is known only now, and completes the file.
    pub fn finish(mut self, plan: &OutputPlan, offload: &dyn Offload) -> Result<Vec<FileSummary>> {
        let mut bounds = self.tally.bounds;
        let packets = self.packets.take();
        let mut beside = None;
        match self.body {
            Body::Plain => {}
            Body::Arrow(stream) => stream.finish(false, |bytes| self.medium.append(bytes))?,
            Body::Parquet(stream) => stream.finish(false, |bytes| self.medium.append(bytes))?,
            Body::Archive(stream) => stream.finish(&mut self.medium, offload)?,
            Body::Las => {
                let packets_at = self.medium.len();
                beside = packets.map(|p| p.finish(&mut self.medium)).transpose()?;
                let packets_at = plan.las.packets_inside().then_some(packets_at);
                self.medium.patch(0, &plan.las.head(None, &self.tally, packets_at))?;
                bounds = plan.las.world(&bounds);
            }
            Body::Laz(laszip, stream) => {
                stream.finish(&mut self.medium, offload)?;
                let packets_at = self.medium.len();
                beside = packets.map(|p| p.finish(&mut self.medium)).transpose()?;
                let packets_at = plan.las.packets_inside().then_some(packets_at);
                self.medium.patch(0, &plan.las.head(Some(&laszip), &self.tally, packets_at))?;
                bounds = plan.las.world(&bounds);
            }
            Body::Ply(format) => {
                self.medium.patch(
                    0,
                    &ply::head(format, plan.epsg, &plan.objects, plan.ply_more(), self.tally.records),
                )?;
            }
        }
        let bytes = self.medium.len();
        self.medium.finish()?;
        let Tally { records, left_out, by_return, .. } = self.tally;
        let points =
            FileSummary { path: self.path, kind: self.kind, records, bytes, bounds, by_return, left_out };
        Ok([Some(points), beside.flatten()].into_iter().flatten().collect())
    }
}

impl Packets {
    /// Opens the place of the packets; their offsets count from its beginning.
    fn open(plan: &OutputPlan, place: PacketPlace, las: Option<&Path>) -> Result<Packets> {
        let (path, mut medium) = match (place, las) {
            (PacketPlace::Beside, Some(las)) => {
                let path = packets_path(las);
                let medium = Medium::open(&Place::Path(path.clone()), plan.force, true)?;
                (Some(path), medium)
            }
            _ => (None, Medium::unnamed()?),
        };
        medium.append(&packets_header(0))?;
        Ok(Packets { path, medium })
    }

    /// Completes the file beside the points, or moves the packets behind them.
    fn finish(mut self, points: &mut Medium) -> Result<Option<FileSummary>> {
        let bytes = self.medium.len();
        self.medium.patch(0, &packets_header(bytes - PACKETS_HEADER))?;
        let Some(path) = self.path else {
            self.medium.pour_into(points)?;
            return Ok(None);
        };
        self.medium.finish()?;
        let (path, kind) = (Some(path), FileKind::Packets);
        let Tally { left_out, by_return, bounds, .. } = Tally::EMPTY;
        Ok(Some(FileSummary { path, kind, records: 0, bytes, bounds, by_return, left_out }))
    }
}
