//! LAZ: compression of LAS points in chunks of fixed size, by idle workers. The bytes depend on the points
//! only, not on batches or threads.
//!
//! LAS 1.4 points of one scanner channel are compressed by [`chunk`], others by the `laz` crate, which writes
//! the same bytes for both. [`chunk`] exists because it is about 1.85 times as fast for point format 6
//! (docs/dev/speed.md).
//!
//! | file | contents |
//! |---|---|
//! | `chunk` | a chunk of points: its layers and their lengths |
//! | `point`, `extra` | the layers of point data record format 6, and of extra bytes |
//! | `coder` | adaptive arithmetic coding |

mod chunk;
mod coder;
mod extra;
mod point;

use super::write::LasFormat;
use crate::out::{BlockCompressor, BlockError, Offload, OutputStream};
use ::laz::laszip::{ChunkTable, ChunkTableEntry};
use ::laz::record::{LayeredPointRecordCompressor, RecordCompressor, SequentialPointRecordCompressor};
use ::laz::{LazItemType, LazVlr, LazVlrBuilder};
use vlscan_base::error::{Error, Result};

/// Points per chunk, as in LASzip.
pub const CHUNK_POINTS: usize = 50_000;

/// Returns the LASzip record for chunks of fixed size.
pub(super) fn laszip(format: &LasFormat) -> Result<LazVlr> {
    Ok(laszip_builder(format)?.with_fixed_chunk_size(CHUNK_POINTS as u32).build())
}

/// Returns the builder of a LASzip record, without a chunk size.
pub(super) fn laszip_builder(format: &LasFormat) -> Result<LazVlrBuilder> {
    let builder = LazVlrBuilder::default().with_point_format(format.point_format(), format.extra_length());
    builder.map_err(|e| Error::Internal(format!("LAZ: {e}")))
}

pub(super) struct LazStream {
    laszip: LazVlr,
    record: usize,
    /// Position of the field that holds the offset of the chunk table.
    start: u64,
    /// Points of an incomplete chunk.
    points: Vec<u8>,
    chunks: BlockCompressor,
    table: ChunkTable,
}

impl LazStream {
    /// Begins after the header of a file, with a placeholder for the offset of the chunk table.
    pub fn begin(laszip: LazVlr, record: u16, out: &mut OutputStream) -> Result<LazStream> {
        let start = out.len();
        out.append(&(-1i64).to_le_bytes())?;
        let items = laszip.clone();
        let compress_chunk =
            move |points: &[u8], out| compress(points, out, &items).map_err(BlockError::from);
        Ok(LazStream {
            laszip,
            record: usize::from(record),
            start,
            points: Vec::new(),
            chunks: BlockCompressor::new(compress_chunk),
            table: ChunkTable::default(),
        })
    }

    pub fn append(
        &mut self,
        mut records: &[u8],
        out: &mut OutputStream,
        offload: &dyn Offload,
    ) -> Result<()> {
        let whole = CHUNK_POINTS * self.record;
        while !records.is_empty() {
            if self.points.capacity() < whole && self.points.len() + records.len() > whole / 8 {
                self.points.reserve_exact(whole - self.points.len());
            }
            let (now, later) = records.split_at(records.len().min(whole - self.points.len()));
            self.points.extend_from_slice(now);
            records = later;
            if self.points.len() == whole {
                self.submit(out, offload)?;
            }
        }
        Ok(())
    }

    /// Compresses the remaining points, writes the chunk table and patches its offset.
    pub fn finish(&mut self, out: &mut OutputStream, offload: &dyn Offload) -> Result<()> {
        if !self.points.is_empty() {
            self.submit(out, offload)?;
        }
        let table = &mut self.table;
        self.chunks.finish(|bytes| write(bytes, table, out))?;
        let offset = out.len();
        let mut table = Vec::new();
        self.table.write_to(&mut table, &self.laszip).map_err(|e| Error::Internal(format!("LAZ: {e}")))?;
        out.append(&table)?;
        out.patch(self.start, &offset.to_le_bytes())
    }

    fn submit(&mut self, out: &mut OutputStream, offload: &dyn Offload) -> Result<()> {
        let table = &mut self.table;
        self.chunks.submit(&mut self.points, offload, |bytes| write(bytes, table, out))
    }
}

fn write(chunk: &[u8], table: &mut ChunkTable, out: &mut OutputStream) -> Result<()> {
    table.push(ChunkTableEntry { point_count: CHUNK_POINTS as u64, byte_count: chunk.len() as u64 });
    out.append(chunk)
}

/// Compresses `points` into `out`, which must be empty.
pub(super) fn compress(points: &[u8], mut out: Vec<u8>, laszip: &LazVlr) -> ::laz::Result<Vec<u8>> {
    out.reserve(points.len() / 2);
    let length = laszip.items().iter().map(|item| usize::from(item.size())).sum();
    if has_known_layers(laszip) && chunk::has_one_channel(points, length) {
        chunk::compress(points, length, &mut out);
        return Ok(out);
    }
    let layered = laszip.items().first().is_some_and(|item| item.version() >= 3);
    if layered {
        compress_with(LayeredPointRecordCompressor::new(out), points, laszip)
    } else {
        compress_with(SequentialPointRecordCompressor::new(out), points, laszip)
    }
}

/// True if [`chunk`] supports the layout of the records: points of format 6, with or without extra bytes.
fn has_known_layers(laszip: &LazVlr) -> bool {
    let items = laszip.items();
    items.first().is_some_and(|i| i.version() >= 3 && i.item_type() == LazItemType::Point14)
        && items[1..].iter().all(|i| matches!(i.item_type(), LazItemType::Byte14(_)))
}

fn compress_with(
    mut compressor: impl RecordCompressor<Vec<u8>>,
    points: &[u8],
    laszip: &LazVlr,
) -> ::laz::Result<Vec<u8>> {
    compressor.set_fields_from(laszip.items())?;
    compressor.compress_many(points)?;
    compressor.done()?;
    Ok(compressor.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vlscan_base::rng::{Purpose, Stream};

    fn both(points: &[u8], extra: u16) -> [Vec<u8>; 2] {
        let laszip = LazVlrBuilder::default().with_point_format(6, extra).unwrap().build();
        let length = 30 + usize::from(extra);
        assert!(has_known_layers(&laszip) && chunk::has_one_channel(points, length));
        let theirs = compress_with(LayeredPointRecordCompressor::new(Vec::new()), points, &laszip).unwrap();
        [compress(points, Vec::new(), &laszip).unwrap(), theirs]
    }

    /// Returns points like those of a scanner, whose last digits are noise.
    fn strip(count: u64, extra: usize) -> Vec<u8> {
        let draw = Stream::new(1, Purpose::SceneMaking);
        let mut out = Vec::new();
        for i in 0..count {
            let noise = |n: u32, below: f64| (draw.uniform(0, i, n) * below) as u32;
            let returns = 1 + noise(0, 3.0) as u64;
            for number in 1..=returns {
                let x = (i % 500) as i32 * 1000 + noise(1, 40.0) as i32;
                let y = (i / 500) as i32 * 700 + noise(2, 900.0) as i32;
                let z = noise(3, 2e5) as i32;
                [x, y, z].into_iter().for_each(|c| out.extend(c.to_le_bytes()));
                out.extend((9000 + noise(4, 3000.0) as u16).to_le_bytes());
                out.push((number | returns << 4) as u8);
                out.push(0x10);
                out.push(noise(5, 4.0) as u8 * 2);
                out.push(0);
                out.extend(((i % 500) as i16 * 13 - 3000).to_le_bytes());
                out.extend(((i / 3000) as u16).to_le_bytes());
                let gap = if i % 700 == 699 { 86_400.0 } else { (i / 500) as f64 * 1e-3 };
                out.extend((1e5 + gap + i as f64 * 1e-6).to_le_bytes());
                out.extend((0..extra).map(|b| match b % 4 {
                    0 => noise(6, 256.0) as u8,
                    1 => (i / 100) as u8,
                    2 if i > 1000 => 7,
                    _ => 0,
                }));
            }
        }
        out
    }

    #[test]
    fn chunks_are_those_of_the_library() {
        for (count, extra) in [(1, 0), (1, 5), (2, 3), (4000, 34), (20_000, 0)] {
            let points = strip(count, usize::from(extra));
            let [ours, theirs] = both(&points, extra);
            assert!(ours == theirs, "{count} points with {extra} extra bytes");
        }
    }

    #[test]
    fn points_of_several_channels_are_left_to_the_library() {
        let mut points = strip(100, 3);
        points[33 + 15] ^= 0x20;
        let laszip = LazVlrBuilder::default().with_point_format(6, 3).unwrap().build();
        assert!(!chunk::has_one_channel(&points, 33) && has_known_layers(&laszip));
        let theirs = compress_with(LayeredPointRecordCompressor::new(Vec::new()), &points, &laszip).unwrap();
        assert!(compress(&points, Vec::new(), &laszip).unwrap() == theirs);
    }

    proptest! {
        #[test]
        fn any_points_give_the_bytes_of_the_library(
            mut points in prop::collection::vec(prop::collection::vec(any::<u8>(), 33), 1..200),
            alike in prop::collection::vec(0usize..33, 0..30),
            times in prop::collection::vec(prop::sample::select(vec![0i64, 1, -1, 3, 7000, 1 << 33, -(1 << 40)]), 200),
        ) {
            let first = points[0].clone();
            let mut time = i64::from_le_bytes(first[22..30].try_into().unwrap()) & i64::MAX >> 2;
            for (point, step) in points.iter_mut().zip(times) {
                alike.iter().for_each(|&at| point[at] = first[at]);
                point[15] = point[15] & 0xCF | 0x20;
                time = time.wrapping_add(step);
                point[22..30].copy_from_slice(&time.to_le_bytes());
            }
            let [ours, theirs] = both(&points.concat(), 3);
            prop_assert!(ours == theirs);
        }
    }
}
