//! Blocks of records decoded on several threads.
//!
//! Records that these threads cannot read, such as a damaged chunk, are left to the reader of all records in
//! order, whose errors have their place. Chunks count only if each begins where the one before ends: the
//! reader in order does not jump either.

use super::compressed::{Chunk, Compressed, without_panic};
use super::header::Header;
use super::rows::RowFormat;
use crate::blocks::{Emit, in_order};
use crate::{PointDetails, PointRow, Reading};
use std::ops::ControlFlow;

/// Number of records of a block.
const BLOCK_RECORDS: usize = if cfg!(test) { 1 << 6 } else { 1 << 14 };

/// The points that have been read.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Passed {
    /// Their number.
    pub points: u64,
    /// True if no more are needed.
    pub is_ended: bool,
}

/// Points of a file.
#[derive(Default)]
struct Block {
    rows: Vec<PointRow>,
    /// The details of the points, if these are read.
    details: Vec<PointDetails>,
    /// Offset of the chunk that begins with the block.
    start: Option<u64>,
    /// Offset behind the chunk, or the plain records, that ends with the block.
    end: Option<u64>,
    /// True if the record after these cannot be read.
    is_damaged: bool,
}

impl Block {
    fn clear(&mut self) {
        let Block { rows, details, start, end, is_damaged } = self;
        rows.clear();
        details.clear();
        (*start, *end, *is_damaged) = (None, None, false);
    }

    fn push(&mut self, record: &[u8], format: &RowFormat) {
        self.details.extend(format.details(record));
        self.rows.push(format.row(record));
    }
}

/// Reads records that are stored as they are, as far as they are complete.
pub(super) fn read_plain(
    records: &[u8],
    header: &Header,
    format: &RowFormat,
    reading: &mut Reading,
) -> Passed {
    let length = usize::from(header.record_length).max(1);
    let complete = (records.len() / length).min(usize::try_from(header.count).unwrap_or(usize::MAX));
    let block_bytes = BLOCK_RECORDS * length;
    let blocks = records[..complete * length].chunks(block_bytes).enumerate();
    let make = |(index, records): (usize, &[u8]), block: &mut Block, emit: &mut Emit<'_, Block>| {
        block.clear();
        block.end = Some((header.data_at + index * block_bytes + records.len()) as u64);
        records.chunks_exact(length).for_each(|record| block.push(record, format));
        let _ = emit(block);
    };
    take_blocks(blocks, make, reading)
}

/// Reads compressed records chunk by chunk, up to the first chunk that is damaged or cannot be found.
pub(super) fn read_compressed(
    compressed: &Compressed,
    header: &Header,
    format: &RowFormat,
    reading: &mut Reading,
) -> Passed {
    let Some(chunks) = compressed.chunks(header) else { return Passed::default() };
    let make = |chunk: Chunk, block: &mut Block, emit: &mut Emit<'_, Block>| {
        block.clear();
        block.start = Some(chunk.start);
        let read = without_panic(|| {
            chunks.read(chunk, |record| {
                block.push(record, format);
                if block.rows.len() < BLOCK_RECORDS {
                    return ControlFlow::Continue(());
                }
                let flow = emit(block);
                block.clear();
                flow
            })
        });
        match read {
            Ok(None) => return,
            Ok(end) => block.end = end,
            Err(_) => block.is_damaged = true,
        }
        let _ = emit(block);
    };
    take_blocks(chunks.of_points(header.count), make, reading)
}

/// Passes the points of blocks to the sink.
fn take_blocks<I: Send>(
    items: impl Iterator<Item = I>,
    make: impl Fn(I, &mut Block, &mut Emit<'_, Block>) + Sync,
    reading: &mut Reading,
) -> Passed {
    let threads = reading.threads;
    let mut passed = Passed::default();
    // Offset behind the last chunk.
    let mut position: Option<u64> = None;
    let take = |block: &mut Block| {
        if let (Some(start), Some(end)) = (block.start, position)
            && start != end
        {
            return ControlFlow::Break(());
        }
        let mut details = block.details.iter();
        for row in &block.rows {
            if let Some(details) = details.next() {
                reading.sink.details(details);
            }
            passed.points += 1;
            if reading.take(row).is_break() {
                passed.is_ended = true;
                return ControlFlow::Break(());
            }
        }
        position = block.end.or(position);
        if let Some(end) = block.end {
            reading.release_before(usize::try_from(end).unwrap_or(usize::MAX));
        }
        if block.is_damaged { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    if let Err(failure) = in_order(threads, items, make, take) {
        reading.failure = Some(failure);
        passed.is_ended = true;
    }
    passed
}
