//! Writes of large pieces at their offsets in a file, which idle workers carry out where there are any.

use super::offload::Offload;
use crate::files::PositionedFile;
use std::collections::VecDeque;
use std::io;
use std::mem;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

/// Most bytes that wait to be written.
const MAX_WAITING_BYTES: usize = 16 << 20;

/// The writes to one file that may not have ended.
pub(super) struct ParallelWrites {
    file: Arc<PositionedFile>,
    /// Writes in order of submission, with the lengths of their pieces.
    pending: VecDeque<(Arc<PendingWrite>, usize)>,
    waiting_bytes: usize,
}

impl ParallelWrites {
    pub fn new(file: PositionedFile) -> ParallelWrites {
        ParallelWrites { file: Arc::new(file), pending: VecDeque::new(), waiting_bytes: 0 }
    }

    /// Queues a write.
    ///
    /// # Errors
    /// Those of earlier writes.
    pub fn submit(&mut self, offset: u64, bytes: Vec<u8>, offload: &dyn Offload) -> io::Result<()> {
        while let Some((first, _)) = self.pending.front()
            && (self.waiting_bytes > MAX_WAITING_BYTES || first.is_over())
        {
            self.finish_oldest()?;
        }
        let length = bytes.len();
        let file = self.file.clone();
        let write = Arc::new(PendingWrite(Mutex::new(State::Waiting(offset, bytes))));
        self.pending.push_back((write.clone(), length));
        self.waiting_bytes += length;
        if let Err(job) = offload.try_run(Box::new(move || write.run(&file))) {
            job();
        }
        Ok(())
    }

    /// Waits for all writes, and carries out those that no worker has begun.
    pub fn finish(&mut self) -> io::Result<()> {
        while !self.pending.is_empty() {
            self.finish_oldest()?;
        }
        Ok(())
    }

    fn finish_oldest(&mut self) -> io::Result<()> {
        let Some((write, length)) = self.pending.pop_front() else { return Ok(()) };
        self.waiting_bytes -= length;
        write.run(&self.file);
        write.outcome()
    }
}

/// A write, carried out by the first thread that locks it. The writer therefore waits only for a worker that is writing.
struct PendingWrite(Mutex<State>);

enum State {
    Waiting(u64, Vec<u8>),
    Over(io::Result<()>),
}

impl PendingWrite {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_over(&self) -> bool {
        match self.0.try_lock() {
            Ok(state) => matches!(*state, State::Over(_)),
            Err(TryLockError::WouldBlock) => false,
            Err(TryLockError::Poisoned(_)) => true,
        }
    }

    fn run(&self, file: &PositionedFile) {
        let mut state = self.lock();
        if let State::Waiting(offset, bytes) = &*state {
            *state = State::Over(file.write_all_at(bytes, *offset));
        }
    }

    fn outcome(&self) -> io::Result<()> {
        match mem::replace(&mut *self.lock(), State::Over(Ok(()))) {
            State::Over(outcome) => outcome,
            State::Waiting(..) => Err(io::Error::other("a write was not carried out")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::offload::{Job, NoOffload};
    use super::*;
    use crate::files::{FileWriter, Patched};

    /// Keeps all jobs, and runs them in the opposite order when it is told to.
    #[derive(Default)]
    struct Keep(Mutex<Vec<Job>>);

    impl Offload for Keep {
        fn try_run(&self, job: Job) -> Result<(), Job> {
            self.0.lock().unwrap().push(job);
            Ok(())
        }
    }

    fn written(offload: &dyn Offload, before_the_end: impl FnOnce()) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut out = FileWriter::create(&path, false, Patched::Never).unwrap();
        let mut writes = ParallelWrites::new(out.positioned().unwrap());
        for number in 0..100u8 {
            writes.submit(u64::from(number) * 1000, vec![number; 1000], offload).unwrap();
        }
        before_the_end();
        writes.finish().unwrap();
        out.finish().unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn every_piece_is_at_its_place_whoever_writes_it() {
        let expected: Vec<u8> = (0..100u8).flat_map(|number| [number; 1000]).collect();
        assert_eq!(written(&NoOffload, || ()), expected);
        // No worker begins a write, or all of them the last ones first.
        assert_eq!(written(&Keep::default(), || ()), expected);
        let keep = Keep::default();
        let reverse = || keep.0.lock().unwrap().drain(..).rev().for_each(|job| job());
        assert_eq!(written(&keep, reverse), expected);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_write_that_fails_is_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "").unwrap();
        let read_only = PositionedFile::of(std::fs::File::open(&path).unwrap());
        let mut writes = ParallelWrites::new(read_only);
        writes.submit(0, vec![0; 10], &NoOffload).unwrap();
        assert!(writes.submit(10, vec![0; 10], &NoOffload).is_err());
        assert!(writes.finish().is_ok());
    }
}
