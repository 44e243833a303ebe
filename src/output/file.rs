//! One open output file of any format.

use super::archive::ArchiveStream;
use super::arrow::ArrowStream;
use super::codec::Piece;
use super::copc::{self, CopcStream, Octree};
use super::e57::E57Stream;
use super::las::{PACKETS_HEADER_BYTES, packets_header, place_packets};
use super::layout::{Content, FilePlan};
use super::laz::{self, LazStream};
use super::mcap::McapStream;
use super::offload::Offload;
use super::parquet::ParquetStream;
use super::plan::{OutputPlan, packets_path};
use super::request::{PacketPlace, PointFormat, TrajectoryFormat};
use super::stream::{Destination, OutputStream};
use super::summary::{COMPLETE, FileKind, FileSummary, PARTIAL, Tally};
use super::table;
use super::text::TRAJECTORY_HEADER;
use super::{pcd, ply, ray_cloud};
use crate::shards::BlockTable;
use ::laz::LazVlr;
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::Patched;

pub(super) struct OutputFile {
    /// `None` for standard output.
    path: Option<PathBuf>,
    kind: FileKind,
    out: OutputStream,
    head: Head,
    encoder: Encoder,
    tally: Tally,
    packets: Option<Packets>,
}

struct Packets {
    /// Path of the separate file; `None` when packets are collected in an unnamed file and appended to the points at
    /// the end.
    path: Option<PathBuf>,
    out: OutputStream,
}

/// Header that depends on all records of the file, and how it records the state of the run.
enum Head {
    /// No such header.
    None,
    /// LAS: bounds and counts of points, and the compression.
    Las(Option<LazVlr>),
    /// LAS stream that cannot be patched: bounds and the maximum number of points that can occur.
    LasStream(u64),
    /// COPC: bounds and counts of points, and the octree.
    Copc(LazVlr),
    /// PLY, ray clouds and PCD: the count of points.
    Counted(PointFormat),
}

/// Processing of records before they are written.
enum Encoder {
    /// Records are written unchanged.
    Plain,
    /// Lines become records of a compressed archive.
    Archive(ArchiveStream),
    /// Points are compressed in chunks.
    Laz(LazStream),
    /// Points are sorted into an octree and compressed.
    Copc(Box<CopcStream>),
    /// Rows are collected into batches.
    Arrow(Box<ArrowStream>),
    /// Rows are collected into row groups, which a footer lists.
    Parquet(Box<ParquetStream>),
    /// Points are collected, and written as scans at the end.
    E57(E57Stream),
    /// Points are collected until their frame is complete.
    Mcap(McapStream),
    /// Blocks are written unchanged, and a table lists them.
    Shard(BlockTable),
}

impl Head {
    fn new(content: Content, plan: &OutputPlan, out: &OutputStream) -> Result<Head> {
        Ok(match content {
            Content::Points(PointFormat::Las) if !out.is_seekable() => {
                Head::LasStream(plan.las.at_most.unwrap_or(0))
            }
            Content::Points(PointFormat::Las) => Head::Las(None),
            Content::Points(PointFormat::Laz) => Head::Las(Some(laz::laszip(&plan.las)?)),
            Content::Points(PointFormat::Copc) => Head::Copc(copc::laszip(&plan.las)?),
            Content::Points(format) if format.counts() => Head::Counted(format),
            _ => Head::None,
        })
    }

    /// Returns the header. Its length depends on the plan alone.
    fn bytes(
        &self,
        plan: &OutputPlan,
        tally: &Tally,
        packets_at: Option<u64>,
        octree: &Octree,
        state: &str,
    ) -> Vec<u8> {
        match self {
            Head::None => Vec::new(),
            Head::Las(laszip) => plan.las.head(laszip.as_ref(), tally, packets_at, state),
            Head::LasStream(at_most) => plan.las.stream_head(*at_most),
            Head::Copc(laszip) => {
                plan.las.octree_head(laszip, tally, &octree.info, octree.hierarchy_at, state)
            }
            Head::Counted(PointFormat::RayCloud) => ray_cloud::head(tally.records, state),
            Head::Counted(PointFormat::Pcd) => pcd::head(plan.pcd_offset, tally.records, state),
            Head::Counted(format) => ply::head(
                *format,
                plan.crs_name.as_deref(),
                &plan.objects,
                plan.ply_groups(),
                tally.records,
                state,
            ),
        }
    }

    /// Fails when the header cannot represent the number of points.
    fn check_count(&self, plan: &OutputPlan, records: u64) -> Result<()> {
        match self {
            Head::LasStream(at_most) if records > *at_most => {
                Err(Error::input(format!("more points than --las-at-most promises: {at_most}")))
            }
            Head::Las(_) if records > plan.las.max_points() => {
                let max = plan.las.max_points();
                Err(Error::input(format!("a file of LAS 1.0 holds at most {max} points; write LAS 1.4")))
            }
            _ => Ok(()),
        }
    }
}

impl OutputFile {
    /// Opens a file and writes the bytes before the first record. A header that is not yet known is left blank, so
    /// that an incomplete file is not mistaken for a complete one.
    pub fn open(plan: &OutputPlan, destination: &Destination, file: &FilePlan) -> Result<OutputFile> {
        let content = file.content;
        let patched = match content {
            Content::Points(PointFormat::Las) if plan.las.at_most.is_some() => Patched::IfPossible,
            Content::Points(format) if format.counts() => Patched::Always,
            _ => Patched::Never,
        };
        // Processes that compute the same shard write the same bytes.
        let replace = plan.force || content == Content::Shard;
        let mut out = OutputStream::open(destination, replace, patched)?.keeping_equal(plan.goes_on);
        let head = Head::new(content, plan, &out)?;
        let mut bytes = head.bytes(plan, &Tally::EMPTY, None, &Octree::EMPTY, COMPLETE);
        match head {
            Head::LasStream(_) => {}
            Head::Counted(_) => bytes.fill(b' '),
            _ => bytes.fill(0),
        }
        match content {
            Content::Points(PointFormat::Xyz) if plan.columns_chosen => {
                bytes = table::header(&plan.columns, b' ');
            }
            Content::Points(PointFormat::Csv) => bytes = table::header(&plan.columns, b','),
            Content::Trajectory(TrajectoryFormat::Csv) => bytes = TRAJECTORY_HEADER.to_vec(),
            Content::Shard => bytes = BlockTable::start(),
            _ => {}
        }
        out.append(&bytes)?;
        let record = plan.las.record_length();
        let encoder = match (content, &head) {
            _ if file.zipped => Encoder::Archive(ArchiveStream::begin(&mut out)?),
            (_, Head::Las(Some(laszip))) => Encoder::Laz(LazStream::begin(laszip.clone(), record, &mut out)?),
            (_, Head::Copc(laszip)) => {
                Encoder::Copc(Box::new(CopcStream::begin(laszip.clone(), record, &mut out)?))
            }
            (Content::Points(PointFormat::Arrow), _) => {
                Encoder::Arrow(Box::new(ArrowStream::new(&plan.columns, plan.schema.clone())?))
            }
            (Content::Points(PointFormat::Parquet), _) => {
                Encoder::Parquet(Box::new(ParquetStream::new(&plan.columns, &plan.schema)?))
            }
            (Content::Points(PointFormat::E57), _) => Encoder::E57(E57Stream::new()),
            (Content::Points(PointFormat::Mcap), _) => Encoder::Mcap(McapStream::begin(&mut out)?),
            (Content::Shard, _) => Encoder::Shard(BlockTable::new(plan.shard_head.clone())),
            _ => Encoder::Plain,
        };
        let path = match destination {
            Destination::Stdout => None,
            Destination::Path(path) => Some(path.clone()),
        };
        let packets = match (content, plan.las.packet_place()) {
            (Content::Points(format), Some(place)) if format.is_las() => {
                Some(Packets::open(plan, place, path.as_deref())?)
            }
            _ => None,
        };
        Ok(OutputFile { path, kind: content.kind(), out, head, encoder, tally: Tally::EMPTY, packets })
    }

    pub fn append(&mut self, plan: &OutputPlan, mut piece: Piece, offload: &dyn Offload) -> Result<()> {
        self.tally.add(&piece.tally);
        if let Some(packets) = &mut self.packets {
            place_packets(&mut piece.bytes, plan.las.record_length(), packets.out.len());
            packets.out.append(&piece.packets)?;
        }
        let bytes = &piece.bytes;
        match &mut self.encoder {
            Encoder::Plain if plan.keeps_files_open() => self.out.append_piece(piece.bytes, offload)?,
            Encoder::Plain => self.out.append(bytes)?,
            Encoder::Archive(archive) => archive.append(bytes, &mut self.out, offload)?,
            Encoder::Laz(laz) => laz.append(bytes, &mut self.out, offload)?,
            Encoder::Copc(copc) => copc.append(bytes)?,
            Encoder::E57(points) => points.append(bytes, &self.out)?,
            Encoder::Mcap(frames) => frames.append(bytes, &mut self.out)?,
            Encoder::Arrow(arrow) => arrow.append(bytes, |bytes| self.out.append(bytes))?,
            Encoder::Parquet(parquet) => parquet.append(bytes, |bytes| self.out.append(bytes))?,
            Encoder::Shard(table) => {
                table.add(bytes);
                self.out.append_piece(piece.bytes, offload)?;
            }
        }
        self.head.check_count(plan, self.tally.records)
    }

    /// Passes all bytes to the operating system.
    pub fn flush(&mut self, plan: &OutputPlan) -> Result<()> {
        if let Encoder::Arrow(arrow) = &mut self.encoder
            && plan.live
            && self.out.is_stream()
        {
            arrow.flush(|bytes| self.out.append(bytes))?;
        }
        self.packets.iter_mut().try_for_each(|packets| packets.out.flush())?;
        self.out.flush()
    }

    /// Whether the output is a file, which is left out if a run ends before it has records.
    pub fn is_file(&self) -> bool {
        self.out.is_file()
    }

    pub fn has_records(&self) -> bool {
        self.tally.records > 0
    }

    /// Closes the file handle until the next append.
    pub fn close_handle(&mut self) -> Result<()> {
        self.packets.iter_mut().try_for_each(|packets| packets.out.close_handle())?;
        if let Encoder::E57(points) = &mut self.encoder {
            points.close_handle();
        }
        self.out.close_handle()
    }

    /// Writes the trailer, patches the header and completes the file. A `partial` file says so in its metadata, if
    /// its format has any, and in its name: it never has the name of a complete one. A shard of a run is complete or absent.
    pub fn finish(
        mut self,
        plan: &OutputPlan,
        offload: &dyn Offload,
        partial: bool,
    ) -> Result<Vec<FileSummary>> {
        if partial && matches!(self.encoder, Encoder::Shard(_)) {
            return Ok(Vec::new());
        }
        let state = if partial { PARTIAL } else { COMPLETE };
        let has_packet_file = self.packets.as_ref().is_some_and(|packets| packets.path.is_some());
        let exists = |path: &Path| path.symlink_metadata().is_ok();
        let taken = |path: &Path| exists(path) || has_packet_file && exists(&packets_path(path));
        let partial_path = if partial { self.out.partial_path(plan.force, taken) } else { None };
        let beside = partial_path.as_ref().and_then(|_| self.out.existing());
        let mut octree = Octree::EMPTY;
        match self.encoder {
            Encoder::Plain => {}
            Encoder::Archive(archive) => archive.finish(&mut self.out, offload)?,
            Encoder::Laz(laz) => laz.finish(&mut self.out, offload)?,
            Encoder::Copc(copc) => octree = copc.finish(&plan.las, &self.tally, &mut self.out, offload)?,
            Encoder::Arrow(arrow) => arrow.finish(partial, |bytes| self.out.append(bytes))?,
            Encoder::Parquet(parquet) => parquet.finish(partial, |bytes| self.out.append(bytes))?,
            Encoder::E57(points) => points.finish(plan.crs_name.as_deref(), &mut self.out)?,
            Encoder::Mcap(frames) => frames.finish(state, &mut self.out)?,
            Encoder::Shard(table) => self.out.append(&table.finish()?)?,
        }
        let packets_at = plan.las.packets_inside().then_some(self.out.len());
        let packet_file = match self.packets {
            Some(packets) => {
                packets.finish(&mut self.out, partial_path.as_deref().map(packets_path).as_deref())?
            }
            None => None,
        };
        if !matches!(self.head, Head::None | Head::LasStream(_)) {
            self.out.patch(0, &self.head.bytes(plan, &self.tally, packets_at, &octree, state))?;
        }
        let mut bounds = self.tally.bounds;
        if matches!(self.head, Head::Las(_) | Head::LasStream(_) | Head::Copc(_)) {
            bounds = plan.las.world(&bounds);
        }
        let bytes = self.out.len();
        self.out.finish(partial_path.as_deref())?;
        let path = partial_path.or(self.path);
        let Tally { records, left_out, by_return, .. } = self.tally;
        let points = FileSummary {
            path,
            partial,
            beside,
            kind: self.kind,
            records,
            bytes,
            bounds,
            by_return,
            left_out,
        };
        Ok([Some(points), packet_file].into_iter().flatten().collect())
    }
}

impl Packets {
    /// Opens the file of the packets. Offsets count from its first byte.
    fn open(plan: &OutputPlan, place: PacketPlace, las: Option<&Path>) -> Result<Packets> {
        let (path, mut out) = match (place, las) {
            (PacketPlace::Beside, Some(las)) => {
                let path = packets_path(las);
                let out = OutputStream::open(&Destination::Path(path.clone()), plan.force, Patched::Always)?;
                (Some(path), out.keeping_equal(plan.goes_on))
            }
            _ => (None, OutputStream::unnamed()?),
        };
        out.append(&packets_header(0))?;
        Ok(Packets { path, out })
    }

    /// Completes the separate file under its own name or `partial_path`, or appends the packets to the points.
    fn finish(
        mut self,
        points: &mut OutputStream,
        partial_path: Option<&Path>,
    ) -> Result<Option<FileSummary>> {
        let bytes = self.out.len();
        self.out.patch(0, &packets_header(bytes - PACKETS_HEADER_BYTES))?;
        let Some(path) = self.path else {
            self.out.append_to(points)?;
            return Ok(None);
        };
        let beside = partial_path.and_then(|_| self.out.existing());
        self.out.finish(partial_path)?;
        let (path, partial) = (Some(partial_path.map_or(path, Path::to_path_buf)), partial_path.is_some());
        let Tally { left_out, by_return, bounds, .. } = Tally::EMPTY;
        let kind = FileKind::Packets;
        Ok(Some(FileSummary { path, partial, beside, kind, records: 0, bytes, bounds, by_return, left_out }))
    }
}
