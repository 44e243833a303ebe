//! Compression of LAS points in chunks of fixed size, on other threads where there are any to spare. The bytes depend on
//! the points only: not on batches, threads or who compressed what.

use super::las::LasFormat;
use super::medium::Medium;
use super::offload::Offload;
use crate::error::{Error, Result};
use laz::laszip::{ChunkTable, ChunkTableEntry};
use laz::record::{LayeredPointRecordCompressor, RecordCompressor, SequentialPointRecordCompressor};
use laz::{LazVlr, LazVlrBuilder};
use std::collections::VecDeque;
use std::mem;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

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
    laszip: Arc<LazVlr>,
    record: usize,
    /// Where the offset of the chunk table stands.
    start: u64,
    /// Points that make no whole chunk yet.
    points: Vec<u8>,
    /// Chunks being compressed, in order.
    pending: VecDeque<Arc<Chunk>>,
    most_pending: usize,
    /// Buffers of chunks that are written, for the next ones: megabytes that come and go would scatter the heap, and
    /// long runs would need more memory than short ones.
    spare: Vec<Buffers>,
    table: ChunkTable,
}

impl LazStream {
    /// Begins after the header of a file: leaves room for the offset of the chunk table.
    pub fn begin(laszip: LazVlr, record: u16, medium: &mut Medium) -> Result<LazStream> {
        let start = medium.len();
        medium.append(&(-1i64).to_le_bytes())?;
        // A chunk takes a few megabytes, so no more of them than threads could work on.
        let most_pending = std::thread::available_parallelism().map_or(2, |n| n.get()).clamp(2, 32);
        Ok(LazStream {
            laszip: Arc::new(laszip),
            record: usize::from(record),
            start,
            points: Vec::new(),
            pending: VecDeque::new(),
            most_pending,
            spare: Vec::new(),
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
        while let Some(chunk) = self.pending.pop_front() {
            self.write(&chunk, medium)?;
        }
        let offset = medium.len();
        let mut table = Vec::new();
        self.table.write_to(&mut table, &self.laszip).map_err(|e| Error::Internal(format!("LAZ: {e}")))?;
        medium.append(&table)?;
        medium.patch(self.start, &offset.to_le_bytes())
    }

    /// Gives the collected points away for compression.
    fn submit(&mut self, medium: &mut Medium, offload: &dyn Offload) -> Result<()> {
        while self.pending.front().is_some_and(|c| c.is_done() || self.pending.len() >= self.most_pending) {
            if let Some(chunk) = self.pending.pop_front() {
                self.write(&chunk, medium)?;
            }
        }
        let mut buffers = self.spare.pop().unwrap_or_default();
        mem::swap(&mut self.points, &mut buffers.points);
        let chunk = Arc::new(Chunk::new(buffers));
        self.pending.push_back(chunk.clone());
        let laszip = self.laszip.clone();
        if let Err(job) = offload.try_run(Box::new(move || chunk.compress(&laszip))) {
            job();
        }
        Ok(())
    }

    fn write(&mut self, chunk: &Chunk, medium: &mut Medium) -> Result<()> {
        let mut done = chunk.result(&self.laszip)?;
        let byte_count = done.compressed.len() as u64;
        self.table.push(ChunkTableEntry { point_count: CHUNK_POINTS as u64, byte_count });
        medium.append(&done.compressed)?;
        done.points.clear();
        done.compressed.clear();
        self.spare.push(done);
        Ok(())
    }
}

/// Points of a chunk, and what they are compressed to.
#[derive(Default)]
struct Buffers {
    points: Vec<u8>,
    compressed: Vec<u8>,
}

/// A chunk on its way from points to compressed bytes. Whoever comes first compresses it: a worker that finds the time,
/// or the writer when it needs the bytes. So the writer waits only for a worker that is at it, never for one that
/// waits for the writer.
struct Chunk {
    state: Mutex<State>,
    done: Condvar,
}

enum State {
    Points(Buffers),
    BeingCompressed,
    Compressed(Buffers),
    /// Compression failed, or the result was taken.
    Gone(String),
}

impl Chunk {
    fn new(buffers: Buffers) -> Chunk {
        Chunk { state: Mutex::new(State::Points(buffers)), done: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // No panic can leave the state half changed.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_done(&self) -> bool {
        matches!(*self.lock(), State::Compressed(_) | State::Gone(_))
    }

    /// Compresses the chunk, unless somebody has begun.
    fn compress(&self, laszip: &LazVlr) {
        let mut state = self.lock();
        if !matches!(*state, State::Points(_)) {
            return;
        }
        let State::Points(mut buffers) = mem::replace(&mut *state, State::BeingCompressed) else { return };
        drop(state);
        let mut promise =
            Promise { chunk: self, outcome: State::Gone("compression of a chunk panicked".to_owned()) };
        promise.outcome = match compress(&buffers.points, mem::take(&mut buffers.compressed), laszip) {
            Ok(compressed) => State::Compressed(Buffers { compressed, ..buffers }),
            Err(error) => State::Gone(format!("compression of a chunk: {error}")),
        };
    }

    /// The compressed points; compresses them here if nobody has begun.
    fn result(&self, laszip: &LazVlr) -> Result<Buffers> {
        self.compress(laszip);
        let mut state = self.lock();
        while matches!(*state, State::BeingCompressed) {
            state = self.done.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        match mem::replace(&mut *state, State::Gone("a chunk was asked for twice".to_owned())) {
            State::Compressed(buffers) => Ok(buffers),
            State::Gone(reason) => Err(Error::Internal(reason)),
            State::Points(_) | State::BeingCompressed => Err(Error::Internal("a chunk went back".to_owned())),
        }
    }
}

/// Tells the writer how compression ended, a panic included.
struct Promise<'a> {
    chunk: &'a Chunk,
    outcome: State,
}

impl Drop for Promise<'_> {
    fn drop(&mut self) {
        let outcome = mem::replace(&mut self.outcome, State::BeingCompressed);
        *self.chunk.lock() = outcome;
        self.chunk.done.notify_all();
    }
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
