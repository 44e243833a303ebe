//! Compression of LAS points in chunks of fixed size, on other threads where there are any to spare. The bytes depend on
//! the points only: not on batches, threads or who compressed what.

use super::blocks::Blocks;
use super::las::LasFormat;
use super::medium::Medium;
use super::offload::Offload;
use crate::error::{Error, Result};
use laz::laszip::{ChunkTable, ChunkTableEntry};
use laz::record::{LayeredPointRecordCompressor, RecordCompressor, SequentialPointRecordCompressor};
use laz::{LazVlr, LazVlrBuilder};

/// Points per chunk, as LASzip has it.
const CHUNK_POINTS: usize = 50_000;

/// How the points of a run are compressed.
pub(super) fn laszip(format: &LasFormat) -> Result<LazVlr> {
    let builder = LazVlrBuilder::default().with_point_format(format.point_format(), format.extra_length());
    let builder = builder.map_err(|e| Error::Internal(format!("LAZ: {e}")))?;
    Ok(builder.with_fixed_chunk_size(CHUNK_POINTS as u32).build())
}

/// The compressed points of one file.
pub(super) struct LazStream {
    laszip: LazVlr,
    record: usize,
    /// Where the offset of the chunk table stands.
    start: u64,
    /// Points that make no whole chunk yet.
    points: Vec<u8>,
    chunks: Blocks,
    table: ChunkTable,
}

impl LazStream {
    /// Begins after the header of a file: leaves room for the offset of the chunk table.
    pub fn begin(laszip: LazVlr, record: u16, medium: &mut Medium) -> Result<LazStream> {
        let start = medium.len();
        medium.append(&(-1i64).to_le_bytes())?;
        let items = laszip.clone();
        let how = move |points: &[u8], out| compress(points, out, &items).map_err(|e| e.to_string());
        Ok(LazStream {
            laszip,
            record: usize::from(record),
            start,
            points: Vec::new(),
            chunks: Blocks::new(how),
            table: ChunkTable::default(),
        })
    }

    /// Takes packed points.
    pub fn append(&mut self, mut records: &[u8], medium: &mut Medium, offload: &dyn Offload) -> Result<()> {
        let whole = CHUNK_POINTS * self.record;
        while !records.is_empty() {
            if self.points.capacity() < whole && self.points.len() + records.len() > whole / 8 {
                self.points.reserve_exact(whole - self.points.len());
            }
            let (now, later) = records.split_at(records.len().min(whole - self.points.len()));
            self.points.extend_from_slice(now);
            records = later;
            if self.points.len() == whole {
                self.submit(medium, offload)?;
            }
        }
        Ok(())
    }

    /// Compresses what is left, writes the chunk table and the offset that points to it.
    pub fn finish(mut self, medium: &mut Medium, offload: &dyn Offload) -> Result<()> {
        if !self.points.is_empty() {
            self.submit(medium, offload)?;
        }
        let table = &mut self.table;
        self.chunks.finish(|bytes| write(bytes, table, medium))?;
        let offset = medium.len();
        let mut table = Vec::new();
        self.table.write_to(&mut table, &self.laszip).map_err(|e| Error::Internal(format!("LAZ: {e}")))?;
        medium.append(&table)?;
        medium.patch(self.start, &offset.to_le_bytes())
    }

    /// Gives the collected points away for compression.
    fn submit(&mut self, medium: &mut Medium, offload: &dyn Offload) -> Result<()> {
        let table = &mut self.table;
        self.chunks.submit(&mut self.points, offload, |bytes| write(bytes, table, medium))
    }
}

fn write(chunk: &[u8], table: &mut ChunkTable, medium: &mut Medium) -> Result<()> {
    table.push(ChunkTableEntry { point_count: CHUNK_POINTS as u64, byte_count: chunk.len() as u64 });
    medium.append(chunk)
}

/// Compresses `points` into `out`, which is empty.
fn compress(points: &[u8], mut out: Vec<u8>, laszip: &LazVlr) -> laz::Result<Vec<u8>> {
    out.reserve(points.len() / 2);
    let layered = laszip.items().first().is_some_and(|item| item.version() >= 3);
    if layered {
        compress_with(LayeredPointRecordCompressor::new(out), points, laszip)
    } else {
        compress_with(SequentialPointRecordCompressor::new(out), points, laszip)
    }
}

fn compress_with(
    mut compressor: impl RecordCompressor<Vec<u8>>,
    points: &[u8],
    laszip: &LazVlr,
) -> laz::Result<Vec<u8>> {
    compressor.set_fields_from(laszip.items())?;
    compressor.compress_many(points)?;
    compressor.done()?;
    Ok(compressor.into_inner())
}
