//! Blocks of bytes compressed each by itself, on other threads where there are any to spare, and taken back in order.

use super::offload::Offload;
use crate::error::{Error, Result};
use std::collections::VecDeque;
use std::mem;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// How a block is compressed into an empty buffer; the error is a message.
type How = dyn Fn(&[u8], Vec<u8>) -> std::result::Result<Vec<u8>, String> + Send + Sync;

/// The blocks of one file that are being compressed.
pub(super) struct Blocks {
    how: Arc<How>,
    /// In order.
    pending: VecDeque<Arc<Block>>,
    most_pending: usize,
    /// Buffers of blocks that were taken, for the next ones: megabytes that come and go would scatter the heap, and long
    /// runs would need more memory than short ones.
    spare: Vec<Buffers>,
}

/// A block and what it is compressed to.
#[derive(Default)]
struct Buffers {
    plain: Vec<u8>,
    compressed: Vec<u8>,
}

impl Blocks {
    /// No blocks yet.
    pub fn new(
        how: impl Fn(&[u8], Vec<u8>) -> std::result::Result<Vec<u8>, String> + Send + Sync + 'static,
    ) -> Blocks {
        // A block takes a few megabytes, so no more of them than threads could work on, and as many to be going on with
        // while the oldest is still being worked on.
        let most_pending = std::thread::available_parallelism().map_or(2, |n| 2 * n.get()).clamp(4, 32);
        Blocks { how: Arc::new(how), pending: VecDeque::new(), most_pending, spare: Vec::new() }
    }

    /// Gives a block away for compression, and hands those that are done to `take`. `plain` is empty afterwards.
    pub fn submit(
        &mut self,
        plain: &mut Vec<u8>,
        offload: &dyn Offload,
        mut take: impl FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        while self.pending.front().is_some_and(|b| b.is_done() || self.pending.len() >= self.most_pending) {
            self.hand_on(&mut take)?;
        }
        let mut buffers = self.spare.pop().unwrap_or_default();
        mem::swap(plain, &mut buffers.plain);
        let block = Arc::new(Block::new(buffers));
        self.pending.push_back(block.clone());
        let how = self.how.clone();
        if let Err(job) = offload.try_run(Box::new(move || block.compress(&*how))) {
            job();
        }
        Ok(())
    }

    /// Hands all blocks that are left to `take`.
    pub fn finish(&mut self, mut take: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        while !self.pending.is_empty() {
            self.hand_on(&mut take)?;
        }
        Ok(())
    }

    fn hand_on(&mut self, take: &mut impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let Some(block) = self.pending.pop_front() else { return Ok(()) };
        let mut done = block.result(&*self.how)?;
        take(&done.compressed)?;
        done.plain.clear();
        done.compressed.clear();
        self.spare.push(done);
        Ok(())
    }
}

/// A block on its way to compressed bytes. Whoever comes first compresses it: a worker that finds the time,
/// or the writer when it needs the bytes. So the writer waits only for a worker that is at it, never for one that
/// waits for the writer.
struct Block {
    state: Mutex<State>,
    done: Condvar,
}

enum State {
    Plain(Buffers),
    BeingCompressed,
    Compressed(Buffers),
    /// Compression failed, or the result was taken.
    Gone(String),
}

impl Block {
    fn new(buffers: Buffers) -> Block {
        Block { state: Mutex::new(State::Plain(buffers)), done: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // No panic can leave the state half changed.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_done(&self) -> bool {
        matches!(*self.lock(), State::Compressed(_) | State::Gone(_))
    }

    /// Compresses the block, unless somebody has begun.
    fn compress(&self, how: &How) {
        let mut state = self.lock();
        if !matches!(*state, State::Plain(_)) {
            return;
        }
        let State::Plain(mut buffers) = mem::replace(&mut *state, State::BeingCompressed) else { return };
        drop(state);
        let mut promise =
            Promise { block: self, outcome: State::Gone("compression of a block panicked".to_owned()) };
        promise.outcome = match how(&buffers.plain, mem::take(&mut buffers.compressed)) {
            Ok(compressed) => State::Compressed(Buffers { compressed, ..buffers }),
            Err(error) => State::Gone(format!("compression of a block: {error}")),
        };
    }

    /// The compressed bytes; compresses them here if nobody has begun.
    fn result(&self, how: &How) -> Result<Buffers> {
        self.compress(how);
        let mut state = self.lock();
        while matches!(*state, State::BeingCompressed) {
            state = self.done.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        match mem::replace(&mut *state, State::Gone("a block was asked for twice".to_owned())) {
            State::Compressed(buffers) => Ok(buffers),
            State::Gone(reason) => Err(Error::Internal(reason)),
            State::Plain(_) | State::BeingCompressed => Err(Error::Internal("a block went back".to_owned())),
        }
    }
}

/// Tells the writer how compression ended, a panic included.
struct Promise<'a> {
    block: &'a Block,
    outcome: State,
}

impl Drop for Promise<'_> {
    fn drop(&mut self) {
        let outcome = mem::replace(&mut self.outcome, State::BeingCompressed);
        *self.block.lock() = outcome;
        self.block.done.notify_all();
    }
}
