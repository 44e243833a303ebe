//! Writes of large pieces at their offsets in a file, which idle workers carry out where there are any.

use super::offload::Offload;
use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use vlscan_base::files::PositionedFile;

/// Maximum number of bytes that wait to be written.
const MAX_WAITING_BYTES: usize = 16 << 20;
/// Threads for each thread that writes to a file. Most file systems (ext4, XFS, tmpfs) let one write at a
/// time change a file, and the others would only wait, spinning; those that allow several are fast enough for
/// few threads.
const THREADS_PER_WRITER: usize = 8;

/// The writes to one file that may not have ended.
pub(super) struct ParallelWrites(Arc<Writes>);

struct Writes {
    file: PositionedFile,
    /// Threads that write at the same time.
    max_writers: usize,
    state: Mutex<State>,
    /// A write has ended.
    ended: Condvar,
}

#[derive(Default)]
struct State {
    /// Pieces with their offsets.
    waiting: VecDeque<(u64, Vec<u8>)>,
    /// Bytes of pieces that wait or are being written.
    bytes: usize,
    /// Threads that are writing.
    writers: usize,
    /// Jobs that have not begun.
    jobs: usize,
    /// The first failure, after which nothing is written.
    failure: Option<io::Error>,
}

impl ParallelWrites {
    pub fn new(file: PositionedFile, threads: usize) -> ParallelWrites {
        ParallelWrites(Arc::new(Writes {
            file,
            max_writers: threads.div_ceil(THREADS_PER_WRITER).max(1),
            state: Mutex::default(),
            ended: Condvar::new(),
        }))
    }

    /// Queues a write.
    ///
    /// # Errors
    /// The errors of earlier writes.
    pub fn submit(&mut self, offset: u64, bytes: Vec<u8>, offload: &dyn Offload) -> io::Result<()> {
        let writes = &self.0;
        let mut state = writes.lock();
        state.bytes += bytes.len();
        state.waiting.push_back((offset, bytes));
        let wants_writer = state.writers + state.jobs < writes.max_writers;
        state.jobs += usize::from(wants_writer);
        drop(state);
        if wants_writer {
            let job = WriteJob(writes.clone());
            if let Err(job) = offload.try_run(Box::new(move || job.run())) {
                job();
            }
        }
        writes.wait_until(|state| state.bytes <= MAX_WAITING_BYTES)
    }

    /// Waits for all writes, and carries out those that no worker has begun.
    pub fn finish(&mut self) -> io::Result<()> {
        self.0.wait_until(|state| state.bytes == 0)
    }
}

impl Writes {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes pieces, or waits for the threads that do, until the state is as it should be or a write has
    /// failed. A job that has not begun is not waited for.
    fn wait_until(&self, is_reached: impl Fn(&State) -> bool) -> io::Result<()> {
        let mut state = self.lock();
        loop {
            if let Some(failure) = state.failure.take() {
                return Err(failure);
            }
            if is_reached(&state) {
                return Ok(());
            }
            state = match self.write_next(state) {
                (state, true) => state,
                (state, false) => self.ended.wait(state).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }

    /// Writes the next piece, if one waits and another thread may write. Tells whether it did.
    fn write_next<'a>(&'a self, mut state: MutexGuard<'a, State>) -> (MutexGuard<'a, State>, bool) {
        if state.writers >= self.max_writers {
            return (state, false);
        }
        let Some((offset, bytes)) = state.waiting.pop_front() else { return (state, false) };
        state.writers += 1;
        drop(state);
        let outcome = self.file.write_all_at(&bytes, offset);
        let mut state = self.lock();
        state.writers -= 1;
        state.bytes -= bytes.len();
        if let Err(failure) = outcome {
            state.failure.get_or_insert(failure);
            state.bytes -= state.waiting.drain(..).map(|(_, bytes)| bytes.len()).sum::<usize>();
        }
        self.ended.notify_all();
        (state, true)
    }
}

/// A job that writes while pieces wait. The worker pool may drop it without running it.
struct WriteJob(Arc<Writes>);

impl WriteJob {
    fn run(self) {
        let writes = self.0.clone();
        drop(self);
        let mut state = writes.lock();
        while let (next, true) = writes.write_next(state) {
            state = next;
        }
    }
}

impl Drop for WriteJob {
    fn drop(&mut self) {
        self.0.lock().jobs -= 1;
    }
}

#[cfg(test)]
mod tests {
    use super::super::offload::{Job, NoOffload};
    use super::*;
    use vlscan_base::files::{FileWriter, Patched};

    /// Never runs a job, runs each on a separate thread, or drops them.
    enum Pool {
        Keeps,
        Runs,
        Drops,
    }

    impl Offload for Pool {
        fn try_run(&self, job: Job) -> Result<(), Job> {
            match self {
                Pool::Keeps => std::mem::forget(job),
                Pool::Runs => drop(std::thread::spawn(job)),
                Pool::Drops => drop(job),
            }
            Ok(())
        }
    }

    #[test]
    fn every_piece_is_at_its_place_for_all_pools() {
        let expected: Vec<u8> = (0..200u8).flat_map(|number| [number; 1000]).collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let pools: [&dyn Offload; 4] = [&NoOffload, &Pool::Keeps, &Pool::Runs, &Pool::Drops];
        for (threads, pool) in [1, 64].into_iter().flat_map(|threads| pools.map(|pool| (threads, pool))) {
            let mut out = FileWriter::create(&path, true, Patched::Never).unwrap();
            let mut writes = ParallelWrites::new(out.positioned().unwrap(), threads);
            // In the opposite order.
            for number in (0..200u8).rev() {
                writes.submit(u64::from(number) * 1000, vec![number; 1000], pool).unwrap();
            }
            writes.finish().unwrap();
            out.finish().unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), expected);
        }
    }

    #[test]
    fn little_waits_to_be_written() {
        let folder = tempfile::tempdir().unwrap();
        let mut out = FileWriter::create(&folder.path().join("a"), true, Patched::Never).unwrap();
        let mut writes = ParallelWrites::new(out.positioned().unwrap(), 2);
        for number in 0..10 {
            let bytes = vec![1; MAX_WAITING_BYTES / 3];
            writes.submit(number * bytes.len() as u64, bytes, &Pool::Keeps).unwrap();
            assert!(writes.0.lock().bytes <= MAX_WAITING_BYTES);
        }
        writes.finish().unwrap();
        assert_eq!(out.finish().unwrap().metadata().unwrap().len(), 10 * (MAX_WAITING_BYTES as u64 / 3));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_write_that_fails_is_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "").unwrap();
        let pools: [&dyn Offload; 4] = [&NoOffload, &Pool::Keeps, &Pool::Runs, &Pool::Drops];
        for pool in pools {
            let read_only = PositionedFile::of(std::fs::File::open(&path).unwrap());
            let mut writes = ParallelWrites::new(read_only, 16);
            let submitted = (0..3).try_for_each(|i| writes.submit(10 * i, vec![0; 10], pool));
            assert!(submitted.and_then(|()| writes.finish()).is_err());
            assert_eq!(std::fs::metadata(&path).unwrap().len(), 0);
        }
    }
}
