//! Blocks of records decoded on several threads.
//!
//! Small chunks, as COPC has them, are decompressed together, so that threads have equal work and blocks are
//! full.
//!
//! Records that these threads cannot read, such as a damaged chunk, are left to the reader of all records in
//! order, whose errors have their place. Chunks count only if each begins where the one before ends: the
//! reader in order does not jump either.

use super::chunks::Chunk;
use super::compressed::{Compressed, without_panic};
use super::header::Header;
use super::rows::RowFormat;
use crate::blocks::{Emit, in_order};
use crate::{Attribute, NewPart, PointDetails, PointPart, PointRow, Reading};
use std::ops::ControlFlow;

/// Number of records of a block.
const BLOCK_RECORDS: usize = if cfg!(test) { 1 << 6 } else { 1 << 14 };
/// Maximum number of points of chunks that are decompressed together: that of a chunk of LASzip.
const RUN_POINTS: u64 = if cfg!(test) { 1 << 8 } else { 50_000 };

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
    /// The points, unless the sink uses parts.
    rows: Vec<PointRow>,
    /// The part of the sink, if it uses parts.
    part: Option<Box<dyn PointPart>>,
    /// Number of points.
    points: usize,
    /// Number of points of the part with a value that does not fit, by attribute.
    misfits: [u64; Attribute::COUNT],
    /// The details of the points, if these are read.
    details: Vec<PointDetails>,
    /// The values of the chosen dimensions, point by point.
    values: Vec<f64>,
    /// Offset of the first chunk of a run, if the block begins with it.
    start: Option<u64>,
    /// Offset behind the last chunk, or the plain records, that end within the block.
    end: Option<u64>,
    /// True if the record after these cannot be read.
    is_damaged: bool,
}

impl Block {
    /// Begins another block, with a part if there are any.
    fn clear(&mut self, parts: Option<&NewPart>) {
        let Block { rows, part, points, misfits, details, values, start, end, is_damaged } = self;
        rows.clear();
        match (part.as_mut(), parts) {
            (Some(part), _) => part.clear(),
            (None, Some(new)) => *part = Some(new()),
            (None, None) => {}
        }
        details.clear();
        values.clear();
        (*points, *misfits) = (0, [0; Attribute::COUNT]);
        (*start, *end, *is_damaged) = (None, None, false);
    }

    fn push(&mut self, record: &[u8], format: &RowFormat) {
        self.details.extend(format.details(record));
        format.push_values(record, &mut self.values);
        let row = format.row(record);
        self.points += 1;
        let Some(part) = &mut self.part else { return self.rows.push(row) };
        for attribute in row.misfits.attributes() {
            self.misfits[attribute as usize] += 1;
        }
        part.add(&row);
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
    let parts = reading.sink.parts();
    let blocks = records[..complete * length].chunks(block_bytes).enumerate();
    let make = |(index, records): (usize, &[u8]), block: &mut Block, emit: &mut Emit<'_, Block>| {
        block.clear(parts.as_ref());
        block.end = Some((header.data_at + index * block_bytes + records.len()) as u64);
        records.chunks_exact(length).for_each(|record| block.push(record, format));
        let _ = emit(block);
    };
    take_blocks(blocks, make, reading)
}

/// Reads compressed records chunk by chunk, up to the first chunk that is damaged or cannot be found. On one
/// thread only if fields are left out that the reader in order decompresses, so that damage to them counts
/// nowhere.
pub(super) fn read_compressed(
    compressed: &Compressed,
    header: &Header,
    format: &RowFormat,
    reading: &mut Reading,
) -> Passed {
    let chunks = compressed.chunks(header, |at| format.reads_byte(at));
    let Some(chunks) = chunks.filter(|chunks| reading.threads > 1 || chunks.excerpt.is_some()) else {
        return Passed::default();
    };
    let parts = reading.sink.parts();
    let make = |run: Vec<Chunk>, block: &mut Block, emit: &mut Emit<'_, Block>| {
        block.clear(parts.as_ref());
        block.start = run.first().map(|chunk| chunk.start);
        let mut copied = Vec::new();
        let mut next = run.iter().skip(1);
        for chunk in &run {
            let read = without_panic(|| {
                chunks.read(*chunk, &mut copied, |record| {
                    block.push(record, format);
                    if block.points < BLOCK_RECORDS {
                        return ControlFlow::Continue(());
                    }
                    let flow = emit(block);
                    block.clear(parts.as_ref());
                    flow
                })
            });
            match read {
                Ok(None) => return,
                Ok(end) => block.end = end,
                Err(_) => block.is_damaged = true,
            }
            block.is_damaged |= next.next().is_some_and(|next| block.end != Some(next.start));
            if block.is_damaged {
                break;
            }
        }
        let _ = emit(block);
    };
    take_blocks(runs(chunks.of_points(header.count)), make, reading)
}

/// Successive chunks with few points, or single ones with many.
fn runs(chunks: impl Iterator<Item = Chunk>) -> impl Iterator<Item = Vec<Chunk>> {
    let mut chunks = chunks.peekable();
    std::iter::from_fn(move || {
        let first = chunks.next()?;
        let (mut points, mut run) = (first.points, vec![first]);
        while let Some(chunk) = chunks.next_if(|chunk| points.saturating_add(chunk.points) <= RUN_POINTS) {
            points += chunk.points;
            run.push(chunk);
        }
        Some(run)
    })
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
        if let Some(part) = block.part.as_mut() {
            passed.points += block.points as u64;
            if reading.take_part(part.as_mut(), &block.misfits).is_break() {
                passed.is_ended = true;
                return ControlFlow::Break(());
            }
        }
        let mut details = block.details.iter();
        let mut values = block.values.chunks_exact((block.values.len() / block.rows.len().max(1)).max(1));
        for row in &block.rows {
            if let Some(details) = details.next() {
                reading.sink.details(details);
            }
            reading.pass_values(values.next().unwrap_or_default());
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
