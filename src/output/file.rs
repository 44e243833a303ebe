//! One open output file of any format.

use super::archive::ArchiveStream;
use super::arrow::{ArrowStream, ParquetStream};
use super::codec::Piece;
use super::copc::{self, CopcStream};
use super::las::{PACKETS_HEADER_BYTES, packets_header, place_packets};
use super::layout::Content;
use super::layout::FilePlan;
use super::laz::{self, LazStream};
use super::offload::Offload;
use super::plan::{OutputPlan, packets_path};
use super::ply;
use super::request::{PacketPlace, PointFormat, TrajectoryFormat};
use super::stream::{Destination, OutputStream, Patched, is_special};
use super::summary::{COMPLETE, FileKind, FileSummary, PARTIAL, Tally};
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
    out: OutputStream,
    body: Body,
    tally: Tally,
    packets: Option<Packets>,
}

/// The waveform packets of a LAS file.
struct Packets {
    /// The file beside it; `None`: they are collected in an unnamed file and moved behind the points at the end.
    path: Option<PathBuf>,
    out: OutputStream,
}

/// What surrounds the records.
enum Body {
    /// Nothing that is known only at the end.
    Plain,
    /// Lines as records of a compressed archive.
    Archive(ArchiveStream),
    /// A header that counts and bounds the points.
    Las,
    /// The same where it was written at the beginning: at most so many points.
    LasStream(u64),
    Laz(LazVlr, LazStream),
    Copc(LazVlr, Box<CopcStream>),
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
    pub fn open(plan: &OutputPlan, place: &Destination, file: &FilePlan) -> Result<OutputFile> {
        let content = file.content;
        let patched = match content {
            Content::Points(PointFormat::Las) if plan.las.at_most.is_some() => Patched::IfPossible,
            Content::Points(format) if format.counts() => Patched::Always,
            _ => Patched::Never,
        };
        let mut out = OutputStream::open(place, plan.force, patched)?;
        let body = match content {
            _ if file.zipped => Body::Archive(ArchiveStream::begin(&mut out)?),
            Content::Points(PointFormat::Las) if !out.is_seekable() => {
                let at_most = plan.las.at_most.unwrap_or(0);
                out.append(&plan.las.stream_head(at_most))?;
                Body::LasStream(at_most)
            }
            Content::Points(PointFormat::Las) => {
                out.append(&vec![0; plan.las.head(None, &Tally::EMPTY, None, COMPLETE).len()])?;
                Body::Las
            }
            Content::Points(PointFormat::Laz) => {
                let laszip = laz::laszip(&plan.las)?;
                out.append(&vec![0; plan.las.head(Some(&laszip), &Tally::EMPTY, None, COMPLETE).len()])?;
                let stream = LazStream::begin(laszip.clone(), plan.las.record_length(), &mut out)?;
                Body::Laz(laszip, stream)
            }
            Content::Points(PointFormat::Copc) => {
                let laszip = copc::laszip(&plan.las)?;
                let head = plan.las.octree_head(&laszip, &Tally::EMPTY, &[0; copc::INFO], 0, COMPLETE);
                out.append(&vec![0; head.len()])?;
                let stream = CopcStream::begin(laszip.clone(), plan.las.record_length(), &mut out)?;
                Body::Copc(laszip, Box::new(stream))
            }
            Content::Points(format @ (PointFormat::PlyBinary | PointFormat::PlyAscii)) => {
                out.append(&vec![
                    b' ';
                    ply::head(format, plan.epsg, &plan.objects, plan.ply_groups(), 0, COMPLETE)
                        .len()
                ])?;
                Body::Ply(format)
            }
            Content::Points(PointFormat::Xyz) if plan.columns_chosen => {
                out.append(&table::header(&plan.columns, b' '))?;
                Body::Plain
            }
            Content::Points(PointFormat::Csv) => {
                out.append(&table::header(&plan.columns, b','))?;
                Body::Plain
            }
            Content::Points(PointFormat::Arrow) => {
                Body::Arrow(Box::new(ArrowStream::new(&plan.columns, plan.schema.clone())?))
            }
            Content::Points(PointFormat::Parquet) => {
                Body::Parquet(Box::new(ParquetStream::new(&plan.columns, plan.schema.clone())?))
            }
            Content::Trajectory(TrajectoryFormat::Csv) => {
                out.append(TRAJECTORY_HEADER)?;
                Body::Plain
            }
            _ => Body::Plain,
        };
        let path = match place {
            Destination::Stdout => None,
            Destination::Path(path) => Some(path.clone()),
        };
        let packets = match (content, plan.las.packet_place()) {
            (Content::Points(format), Some(place)) if format.is_las() => {
                Some(Packets::open(plan, place, path.as_deref())?)
            }
            _ => None,
        };
        Ok(OutputFile { path, kind: content.kind(), out, body, tally: Tally::EMPTY, packets })
    }

    /// Appends encoded records.
    pub fn append(&mut self, plan: &OutputPlan, mut piece: Piece, offload: &dyn Offload) -> Result<()> {
        self.tally.add(&piece.tally);
        if let Some(packets) = &mut self.packets {
            place_packets(&mut piece.bytes, plan.las.record_length(), packets.out.len());
            packets.out.append(&piece.packets)?;
        }
        let bytes = &piece.bytes;
        match &mut self.body {
            Body::Laz(_, stream) => stream.append(bytes, &mut self.out, offload)?,
            Body::Copc(_, stream) => stream.append(bytes)?,
            Body::Archive(stream) => stream.append(bytes, &mut self.out, offload)?,
            Body::Arrow(stream) => stream.append(bytes, |bytes| self.out.append(bytes))?,
            Body::Parquet(stream) => stream.append(bytes, |bytes| self.out.append(bytes))?,
            Body::Plain | Body::Las | Body::LasStream(_) | Body::Ply(_) => self.out.append(bytes)?,
        }
        if let Body::LasStream(at_most) = self.body
            && self.tally.records > at_most
        {
            return Err(Error::input(format!("more points than --las-at-most promises: {at_most}")));
        }
        if matches!(self.body, Body::Las | Body::Laz(..)) && self.tally.records > plan.las.max_points() {
            let max = plan.las.max_points();
            return Err(Error::input(format!("a file of LAS 1.0 holds at most {max} points; write LAS 1.4")));
        }
        Ok(())
    }

    /// Hands everything to the operating system.
    pub fn flush(&mut self, plan: &OutputPlan) -> Result<()> {
        if let Body::Arrow(stream) = &mut self.body
            && plan.live
            && self.out.is_stream()
        {
            stream.flush(|bytes| self.out.append(bytes))?;
        }
        self.packets.iter_mut().try_for_each(|packets| packets.out.flush())?;
        self.out.flush()
    }

    /// Whether it holds something that would be lost with a run that fails, and a file of an earlier run stands under its
    /// name.
    pub fn is_worth_keeping(&self) -> bool {
        self.tally.records > 0 && self.out.partial_path().is_some()
    }

    /// Gives the file handle back until the next append.
    pub fn close_handle(&mut self) -> Result<()> {
        self.packets.iter_mut().try_for_each(|packets| packets.out.close_handle())?;
        self.out.close_handle()
    }

    /// Writes what comes after the last record and what is known only now, and completes the file.
    /// With `partial`, the file tells that the run was interrupted: in its own metadata, or beside it where it has none;
    /// where it would replace a file, it stands beside that under a name that says so.
    pub fn finish(
        mut self,
        plan: &OutputPlan,
        offload: &dyn Offload,
        partial: bool,
    ) -> Result<Vec<FileSummary>> {
        let mut bounds = self.tally.bounds;
        let packets = self.packets.take();
        let mut packet_file = None;
        let state = if partial { PARTIAL } else { COMPLETE };
        let place = self.out.partial_path().filter(|_| partial);
        let packets_place = place.as_deref().map(packets_path);
        let has_metadata = !matches!(self.body, Body::Plain | Body::Archive(_));
        match self.body {
            Body::Plain => {}
            Body::LasStream(_) => {
                packet_file =
                    packets.map(|p| p.finish(&mut self.out, packets_place.as_deref())).transpose()?;
                bounds = plan.las.world(&bounds);
            }
            Body::Arrow(stream) => stream.finish(partial, |bytes| self.out.append(bytes))?,
            Body::Parquet(stream) => stream.finish(partial, |bytes| self.out.append(bytes))?,
            Body::Archive(stream) => stream.finish(&mut self.out, offload)?,
            Body::Las => {
                let packets_at = self.out.len();
                packet_file =
                    packets.map(|p| p.finish(&mut self.out, packets_place.as_deref())).transpose()?;
                let packets_at = plan.las.packets_inside().then_some(packets_at);
                self.out.patch(0, &plan.las.head(None, &self.tally, packets_at, state))?;
                bounds = plan.las.world(&bounds);
            }
            Body::Laz(laszip, stream) => {
                stream.finish(&mut self.out, offload)?;
                let packets_at = self.out.len();
                packet_file =
                    packets.map(|p| p.finish(&mut self.out, packets_place.as_deref())).transpose()?;
                let packets_at = plan.las.packets_inside().then_some(packets_at);
                self.out.patch(0, &plan.las.head(Some(&laszip), &self.tally, packets_at, state))?;
                bounds = plan.las.world(&bounds);
            }
            Body::Copc(laszip, stream) => {
                let octree = stream.finish(&plan.las, &self.tally, &mut self.out, offload)?;
                let at = octree.hierarchy_at;
                let head = plan.las.octree_head(&laszip, &self.tally, &octree.info, at, state);
                self.out.patch(0, &head)?;
                bounds = plan.las.world(&bounds);
            }
            Body::Ply(format) => {
                self.out.patch(
                    0,
                    &ply::head(
                        format,
                        plan.epsg,
                        &plan.objects,
                        plan.ply_groups(),
                        self.tally.records,
                        state,
                    ),
                )?;
            }
        }
        let bytes = self.out.len();
        self.out.finish(place.as_deref())?;
        let noted = self.path.as_deref().filter(|path| place.is_none() && !has_metadata && !is_special(path));
        if let Some(path) = noted {
            note(path, partial)?;
        }
        let (path, beside) = match place {
            Some(place) => (Some(place), self.path),
            None => (self.path, None),
        };
        let Tally { records, left_out, by_return, .. } = self.tally;
        let points =
            FileSummary { path, beside, kind: self.kind, records, bytes, bounds, by_return, left_out };
        Ok([Some(points), packet_file.flatten()].into_iter().flatten().collect())
    }
}

/// Tells beside a text file whether it is partial. A note that is no longer true goes away.
fn note(path: &Path, partial: bool) -> Result<()> {
    let mut name = path.as_os_str().to_os_string();
    name.push(".partial");
    let note = PathBuf::from(name);
    if partial {
        let text = format!("{} is {PARTIAL}.\n", path.display());
        return std::fs::write(&note, text).map_err(|e| Error::io("write", note, e));
    }
    match std::fs::remove_file(&note) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io("remove", note, e)),
        _ => Ok(()),
    }
}

impl Packets {
    /// Opens the place of the packets; their offsets count from its beginning.
    fn open(plan: &OutputPlan, place: PacketPlace, las: Option<&Path>) -> Result<Packets> {
        let (path, mut out) = match (place, las) {
            (PacketPlace::Beside, Some(las)) => {
                let path = packets_path(las);
                let out = OutputStream::open(&Destination::Path(path.clone()), plan.force, Patched::Always)?;
                (Some(path), out)
            }
            _ => (None, OutputStream::unnamed()?),
        };
        out.append(&packets_header(0))?;
        Ok(Packets { path, out })
    }

    /// Completes the file beside the points, under its own name or that of `place`, or moves the packets behind them.
    fn finish(mut self, points: &mut OutputStream, place: Option<&Path>) -> Result<Option<FileSummary>> {
        let bytes = self.out.len();
        self.out.patch(0, &packets_header(bytes - PACKETS_HEADER_BYTES))?;
        let Some(path) = self.path else {
            self.out.pour_into(points)?;
            return Ok(None);
        };
        self.out.finish(place)?;
        let (path, beside) = match place {
            Some(place) => (Some(place.to_path_buf()), Some(path)),
            None => (Some(path), None),
        };
        let Tally { left_out, by_return, bounds, .. } = Tally::EMPTY;
        let kind = FileKind::Packets;
        Ok(Some(FileSummary { path, beside, kind, records: 0, bytes, bounds, by_return, left_out }))
    }
}
