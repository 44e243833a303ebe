//! One open output: a file or stream, or a table in memory.

use super::layout::{Content, FilePlan, OutputLocation};
use super::memory::OpenTable;
use super::piece::{OpenOutput, Piece};
use super::plan::{OutputPlan, packets_path};
use super::request::{TableContent, TrajectoryFormat};
use super::summary::{FileKind, FileSummary};
use super::text::TRAJECTORY_HEADER;
use crate::shards::BlockTable;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileGroup, Patched};
use vlscan_formats::text::begin_archive;
use vlscan_formats::{
    Destination, EncodedFile, Ending, FileBody, Offload, OutputStream, PACKETS_HEADER_BYTES, PacketPlace,
    Plain, PointEncoder, Tally, packets_header,
};

/// Opens an output and writes the bytes before its first record; `runs` are the run directories.
pub(super) fn open_output(
    plan: &OutputPlan,
    file: &FilePlan,
    runs: &[PathBuf],
) -> Result<Box<dyn OpenOutput>> {
    let destination = match &file.location {
        OutputLocation::Memory(number) => {
            let request = plan.request.tables.get(*number);
            let request = request.ok_or_else(|| Error::Internal(format!("there is no table {number}")))?;
            if request.content == TableContent::Points {
                request.sink.begin(plan.table_facts());
            }
            return Ok(Box::new(OpenTable::new(request, plan.table_settings())));
        }
        OutputLocation::Fixed(destination) => destination.clone(),
        OutputLocation::Run { run, name } => Destination::Path(runs[*run].join(name)),
    };
    Ok(Box::new(OutputFile::open(plan, &destination, file)?))
}

struct OutputFile {
    /// `None` for standard output.
    path: Option<PathBuf>,
    kind: FileKind,
    file: EncodedFile,
    /// The format of points.
    encoder: Option<Arc<dyn PointEncoder>>,
    packets: Option<Packets>,
}

struct Packets {
    /// Path of the separate file; `None` when packets are collected in an unnamed file and appended to the
    /// points at the end.
    path: Option<PathBuf>,
    out: OutputStream,
}

/// Blocks of a shard, which are written unchanged, and the table that lists them.
struct ShardBody(Option<BlockTable>);

impl FileBody for ShardBody {
    fn append(&mut self, block: Vec<u8>, out: &mut OutputStream, offload: &dyn Offload) -> Result<()> {
        self.0.iter_mut().for_each(|table| table.add(&block));
        out.append_piece(block, offload)
    }

    fn finish(&mut self, _: &Ending, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        self.0.take().map_or(Ok(()), |table| out.append(&table.finish()?))
    }
}

impl OutputFile {
    fn open(plan: &OutputPlan, destination: &Destination, file: &FilePlan) -> Result<OutputFile> {
        let content = file.content;
        let encoder = match content {
            Content::Points(format) => plan.encoders.get(&format).cloned(),
            _ => None,
        };
        let patched = encoder.as_ref().map_or(Patched::Never, |encoder| encoder.patched());
        // Processes that compute the same shard write the same bytes.
        let replace = plan.request.force || content == Content::Shard;
        let out = OutputStream::open(destination, replace, patched)?
            .keeping_equal(plan.request.is_resuming)
            .writing_in_parallel(plan.keeps_files_open());
        let begin = |out: &mut OutputStream| -> Result<Box<dyn FileBody>> {
            match (content, &encoder) {
                (_, Some(encoder)) => return encoder.clone().begin(out),
                (Content::Shard, _) => {
                    out.append(&BlockTable::start())?;
                    let head = plan.request.shard.as_ref().map(|shard| shard.head.clone());
                    return Ok(Box::new(ShardBody(Some(BlockTable::new(head.unwrap_or_default())))));
                }
                (Content::Trajectory(TrajectoryFormat::Csv), _) => out.append(TRAJECTORY_HEADER)?,
                _ if file.zipped => return begin_archive(out),
                _ => {}
            }
            Ok(Box::new(Plain))
        };
        let file = EncodedFile::begin(out, begin)?;
        let path = match destination {
            Destination::Stdout => None,
            Destination::Path(path) => Some(path.clone()),
        };
        let place = encoder.as_ref().and_then(|encoder| encoder.packets());
        let packets = place.map(|place| Packets::open(plan, place, path.as_deref())).transpose()?;
        Ok(OutputFile { path, kind: content.kind(), file, encoder, packets })
    }
}

impl OpenOutput for OutputFile {
    fn append(&mut self, piece: Piece, offload: &dyn Offload) -> Result<()> {
        let mut points = piece.points;
        if let (Some(packets), Some(encoder)) = (&mut self.packets, &self.encoder) {
            encoder.place_packets(&mut points.bytes, packets.out.len());
            packets.out.append(&points.packets)?;
        }
        self.file.append(points.bytes, &points.tally, offload)
    }

    fn flush(&mut self, is_live: bool) -> Result<()> {
        if is_live {
            self.file.flush_live()?;
        }
        self.packets.iter_mut().try_for_each(|packets| packets.out.flush())?;
        self.file.out().flush()
    }

    fn is_file(&mut self) -> bool {
        self.file.out().is_file()
    }

    fn has_records(&self) -> bool {
        self.file.tally().records > 0
    }

    fn close_handle(&mut self) -> Result<()> {
        self.packets.iter_mut().try_for_each(|packets| packets.out.close_handle())?;
        self.file.close_handle()
    }

    fn finish(
        mut self: Box<Self>,
        plan: &OutputPlan,
        offload: &dyn Offload,
        partial: bool,
        group: &mut FileGroup,
    ) -> Result<Vec<FileSummary>> {
        if partial && self.kind == FileKind::Shard {
            return Ok(Vec::new());
        }
        let has_packet_file = self.packets.as_ref().is_some_and(|packets| packets.path.is_some());
        let exists = |path: &Path| path.symlink_metadata().is_ok();
        let taken = |path: &Path| exists(path) || has_packet_file && exists(&packets_path(path));
        let out = self.file.out();
        let partial_path = if partial { out.partial_path(plan.request.force, taken) } else { None };
        let earlier = partial_path.as_ref().and_then(|_| out.existing());
        let (packets, mut packet_file) = (self.packets, None);
        let (out, tally) = self.file.finish(partial, offload, |out| {
            let Some(packets) = packets else { return Ok(None) };
            let at = packets.path.is_none().then_some(out.len());
            let path = partial_path.as_deref().map(packets_path);
            packet_file = packets.finish(out, path.as_deref(), group)?;
            Ok(at)
        })?;
        let bytes = out.len();
        out.finish_in(group, partial_path.as_deref())?;
        let world = self.encoder.map_or(tally.bounds, |encoder| encoder.world(&tally.bounds));
        let path = partial_path.or(self.path);
        let points =
            FileSummary { path, partial, earlier, bytes, ..FileSummary::of(self.kind, &tally, world) };
        Ok([Some(points), packet_file].into_iter().flatten().collect())
    }
}

impl Packets {
    /// Opens the file of the packets. Offsets count from its first byte.
    fn open(plan: &OutputPlan, place: PacketPlace, las: Option<&Path>) -> Result<Packets> {
        let (path, mut out) = match (place, las) {
            (PacketPlace::Beside, Some(las)) => {
                let path = packets_path(las);
                let out = OutputStream::open(
                    &Destination::Path(path.clone()),
                    plan.request.force,
                    Patched::Always,
                )?;
                (Some(path), out.keeping_equal(plan.request.is_resuming))
            }
            _ => (None, OutputStream::unnamed()?),
        };
        out.append(&packets_header(0))?;
        Ok(Packets { path, out })
    }

    /// Completes the separate file under its own name or `partial_path`, or appends the packets to the
    /// points.
    fn finish(
        mut self,
        points: &mut OutputStream,
        partial_path: Option<&Path>,
        group: &mut FileGroup,
    ) -> Result<Option<FileSummary>> {
        let bytes = self.out.len();
        self.out.patch(0, &packets_header(bytes - PACKETS_HEADER_BYTES))?;
        let Some(path) = self.path else {
            self.out.append_to(points)?;
            return Ok(None);
        };
        let earlier = partial_path.and_then(|_| self.out.existing());
        self.out.finish_in(group, partial_path)?;
        let (path, partial) = (Some(partial_path.map_or(path, Path::to_path_buf)), partial_path.is_some());
        let none = FileSummary::of(FileKind::Packets, &Tally::EMPTY, Tally::EMPTY.bounds);
        Ok(Some(FileSummary { path, partial, earlier, bytes, ..none }))
    }
}
