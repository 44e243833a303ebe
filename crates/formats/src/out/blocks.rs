//! Independent compression of blocks, by idle worker threads where there are any; the results keep the order
//! of submission.

use super::offload::Offload;
use std::collections::VecDeque;
use std::mem;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use vlscan_base::error::{Error, Result};

/// A block that cannot be compressed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BlockError {
    /// Bytes that cannot be deflated.
    #[error(transparent)]
    Deflate(#[from] flate2::CompressError),
    /// A stream that ended before its bytes.
    #[error("deflate ended early")]
    DeflateEnded,
    /// Points that cannot be compressed.
    #[error(transparent)]
    Laz(#[from] laz::LasZipError),
}

/// Compresses a block into an empty buffer.
type CompressFn = dyn Fn(&[u8], Vec<u8>) -> Result<Vec<u8>, BlockError> + Send + Sync;

/// The blocks of one file that are being compressed.
pub struct BlockCompressor {
    compress: Arc<CompressFn>,
    /// Blocks in order of submission.
    pending: VecDeque<Arc<Block>>,
    max_pending: usize,
    /// Buffers of finished blocks, reused for the next ones. Repeated allocation of megabytes would fragment
    /// the heap, and long runs would need more memory than short ones.
    spare: Vec<Buffers>,
}

#[derive(Default)]
struct Buffers {
    plain: Vec<u8>,
    compressed: Vec<u8>,
}

impl BlockCompressor {
    pub fn new(
        compress: impl Fn(&[u8], Vec<u8>) -> Result<Vec<u8>, BlockError> + Send + Sync + 'static,
    ) -> BlockCompressor {
        // A block takes a few megabytes. The limit is one block per thread, and as many again in reserve
        // while the oldest one is compressed.
        let max_pending = std::thread::available_parallelism().map_or(2, |n| 2 * n.get()).clamp(4, 32);
        let (pending, spare) = (VecDeque::new(), Vec::new());
        BlockCompressor { compress: Arc::new(compress), pending, max_pending, spare }
    }

    /// Queues a block for compression and passes finished blocks to `write`. Leaves `plain` empty.
    pub fn submit(
        &mut self,
        plain: &mut Vec<u8>,
        offload: &dyn Offload,
        mut write: impl FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        while self.pending.front().is_some_and(|b| b.is_done() || self.pending.len() >= self.max_pending) {
            self.write_oldest(&mut write)?;
        }
        let mut buffers = self.spare.pop().unwrap_or_default();
        mem::swap(plain, &mut buffers.plain);
        let block = Arc::new(Block(Mutex::new(State::Plain(buffers))));
        self.pending.push_back(block.clone());
        let compress = self.compress.clone();
        if let Err(job) = offload.try_run(Box::new(move || block.compress(&*compress))) {
            job();
        }
        Ok(())
    }

    pub fn finish(&mut self, mut write: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        while !self.pending.is_empty() {
            self.write_oldest(&mut write)?;
        }
        Ok(())
    }

    fn write_oldest(&mut self, write: &mut impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let Some(block) = self.pending.pop_front() else { return Ok(()) };
        let mut buffers = block.result(&*self.compress)?;
        write(&buffers.compressed)?;
        buffers.plain.clear();
        buffers.compressed.clear();
        self.spare.push(buffers);
        Ok(())
    }
}

/// A block, compressed by the first thread that locks it: an idle worker, or the writer when it needs the
/// bytes. The writer therefore waits only for a worker that is compressing, never for one that waits for the
/// writer.
struct Block(Mutex<State>);

enum State {
    Plain(Buffers),
    Compressed(Buffers),
    /// Compression failed, or the result has been taken.
    Gone(String),
}

impl Block {
    /// Locks the state; waits while another thread compresses. A panic during compression leaves
    /// [`State::Gone`] behind.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_done(&self) -> bool {
        match self.0.try_lock() {
            Ok(state) => !matches!(*state, State::Plain(_)),
            Err(TryLockError::WouldBlock) => false,
            Err(TryLockError::Poisoned(_)) => true,
        }
    }

    /// Compresses the block unless that has been done.
    fn compress(&self, compress: &CompressFn) {
        let mut state = self.lock();
        if let State::Plain(buffers) = &mut *state {
            let Buffers { plain, compressed } = mem::take(buffers);
            *state = State::Gone("compression of a block panicked".to_owned());
            *state = match compress(&plain, compressed) {
                Ok(compressed) => State::Compressed(Buffers { plain, compressed }),
                Err(error) => State::Gone(format!("compression of a block: {error}")),
            };
        }
    }

    /// Takes the compressed bytes; compresses the block first if that has not been done.
    fn result(&self, compress: &CompressFn) -> Result<Buffers> {
        self.compress(compress);
        match mem::replace(&mut *self.lock(), State::Gone("a block was taken twice".to_owned())) {
            State::Compressed(buffers) => Ok(buffers),
            State::Gone(reason) => Err(Error::Internal(reason)),
            State::Plain(_) => Err(Error::Internal("a block was not compressed".to_owned())),
        }
    }
}
