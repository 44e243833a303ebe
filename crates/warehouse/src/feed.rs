//! The producer's side of the queues, where the schedules differ.

use super::error::RunError;
use super::jobs::JobQueue;
use super::policy::{MAX_BUFFERED_TASKS, Policy, Schedule};
use super::record::{ProducerRecord, Recorder};
use super::sizing::{ChunkSizer, IdleClock};
use super::spin::spin_until;
use super::stop::RunState;
use crossbeam_channel::{Receiver, Select, Sender, TrySendError, bounded};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::time::{Duration, Instant};
use vlscan_base::Error;

/// Work that is distributed: a number of tasks.
pub trait Tasks {
    /// Number of tasks, the unit in which chunk sizes are counted.
    fn tasks(&self) -> u32;
}

/// Result of a chunk.
pub trait Outcome: Sized {
    /// Appends the result of the next chunk, so that both are one result, or returns it if they cannot be
    /// joined.
    fn join(&mut self, next: Self) -> Option<Self> {
        Some(next)
    }
}

pub(super) struct QueuedChunk<C, R, E> {
    pub chunk: C,
    /// Channel of the result.
    pub result: flume::Sender<Result<R, E>>,
    /// Clone of the leg barrier's sender, dropped when the chunk is done.
    pub barrier: Option<Sender<()>>,
}

/// The next results in order.
pub(super) enum Pending<R, E> {
    /// Computed by the producer.
    Ready(Vec<Result<R, E>>),
    /// A worker will send the result.
    InFlight(flume::Receiver<Result<R, E>>),
}

/// The producer's ends of the channels of a run.
pub(super) struct ProducerEnds<C, R, E> {
    pub queue: Sender<QueuedChunk<C, R, E>>,
    /// The workers' end of `queue`, from which the producer takes chunks back.
    pub queue_end: Receiver<QueuedChunk<C, R, E>>,
    /// One message per idle worker; not used by the warehouse.
    pub idle_workers: Receiver<()>,
    pub results: Sender<Pending<R, E>>,
}

/// Barrier at the end of a leg: waits until all chunks of the leg are done, each of which holds a clone of
/// the sender.
struct LegBarrier {
    guard: Sender<()>,
    done: Receiver<()>,
}

impl LegBarrier {
    fn new() -> LegBarrier {
        let (guard, done) = bounded(0);
        LegBarrier { guard, done }
    }

    fn wait(self) {
        drop(self.guard);
        // No message is ever sent: the receiver returns when the last sender is dropped.
        let _ = self.done.recv();
    }
}

/// The producer's side of the queues: takes chunks and has them computed, by this thread or a worker, as the
/// schedule decides.
///
/// Results keep the order of the chunks under every schedule. Every method blocks while the collector is too
/// far behind, and fails when the collector has ended. `E` is the error type of the run.
pub struct Feed<'a, C, R, W, E = Error> {
    schedule: Schedule,
    state: &'a RunState<'a>,
    ends: ProducerEnds<C, R, E>,
    jobs: &'a JobQueue,
    sizer: Option<ChunkSizer>,
    idle: &'a IdleClock,
    measured_idle_ns: Option<u64>,
    barrier: Option<LegBarrier>,
    /// Results not yet in the queue, and the number of chunks that they come from.
    buffered: (Vec<Result<R, E>>, usize),
    record: ProducerRecord<'a>,
    work: W,
}

impl<'a, C, R, W, E> Feed<'a, C, R, W, E> {
    /// The producer's side of a run, before its first chunk. `work` computes chunks on the producer's thread.
    pub(super) fn new(
        schedule: Schedule,
        state: &'a RunState<'a>,
        ends: ProducerEnds<C, R, E>,
        jobs: &'a JobQueue,
        idle: &'a IdleClock,
        recorder: Option<&'a Recorder>,
        work: W,
    ) -> Feed<'a, C, R, W, E> {
        let sizer = match schedule.policy {
            Policy::Dynamic { size, significant_ns } => Some(ChunkSizer::new(size, significant_ns)),
            _ => None,
        };
        Feed {
            schedule,
            state,
            ends,
            jobs,
            sizer,
            idle,
            measured_idle_ns: None,
            barrier: schedule.leg_barrier.then(LegBarrier::new),
            buffered: (Vec::new(), 0),
            record: ProducerRecord::new(recorder),
            work,
        }
    }

    /// Ends the producer: workers and collector learn that no chunk follows. Returns the jobs of the
    /// collector.
    pub(super) fn finish(self) -> &'a JobQueue {
        self.record.finish();
        self.jobs
    }

    /// The state of the run, which the producer checks between chunks and while it waits for input.
    pub fn state(&self) -> &'a RunState<'a> {
        self.state
    }
}

impl<C: Tasks, R: Outcome, E: From<RunError>, W: FnMut(C) -> Result<R, E>> Feed<'_, C, R, W, E> {
    /// Number of tasks that the chunk under construction should hold.
    pub fn size(&self) -> u32 {
        self.sizer.map_or(self.schedule.policy.size(), |sizer| sizer.size())
    }

    /// Takes a chunk that has reached its size. Returns it when all workers are busy and the schedule wants
    /// the producer to [`Feed::compute`] its first task and continue filling the rest.
    pub fn offer(&mut self, chunk: C) -> Result<Option<C>, E> {
        if self.schedule.workers() == 0 {
            return self.compute(chunk).map(|()| None);
        }
        match self.schedule.policy {
            Policy::Warehouse { .. } => self.store(chunk).map(|()| None),
            Policy::Single => {
                self.record.timer.discard_lap();
                spin_until(|| !self.ends.idle_workers.is_empty());
                let idle = self.ends.idle_workers.recv();
                self.record.timer.add_idle();
                idle.map_err(|_| RunError::Ended("every worker"))?;
                self.send(chunk).map(|()| None)
            }
            Policy::Static { .. } | Policy::Dynamic { .. } => {
                if self.ends.idle_workers.try_recv().is_err() {
                    self.record.add_refusal();
                    if let Some(ns) = self.sizer.and_then(|_| self.idle.stop()) {
                        self.measured_idle_ns = Some(ns);
                    }
                    return Ok(Some(chunk));
                }
                self.send(chunk)?;
                if let Some(sizer) = &mut self.sizer {
                    let measured = self.measured_idle_ns.take();
                    if sizer.resize(measured) {
                        self.record.add_resize(measured, sizer);
                    }
                }
                Ok(None)
            }
        }
    }

    /// Takes a chunk that ends before it has reached its size. With a leg barrier it is computed by this
    /// thread.
    pub fn put(&mut self, chunk: C) -> Result<(), E> {
        match self.schedule.policy {
            _ if self.schedule.workers() == 0 || self.barrier.is_some() => self.compute(chunk)?,
            Policy::Warehouse { .. } => self.store(chunk)?,
            Policy::Single => drop(self.offer(chunk)?),
            Policy::Static { .. } | Policy::Dynamic { .. } => match self.ends.idle_workers.try_recv() {
                Ok(()) => self.send(chunk)?,
                Err(_) => self.compute(chunk)?,
            },
        }
        self.flush()
    }

    /// Computes a chunk on this thread. The result of a single task is buffered until [`Feed::flush`] or
    /// until there are [`MAX_BUFFERED_TASKS`] of them.
    pub fn compute(&mut self, chunk: C) -> Result<(), E> {
        if chunk.tasks() > 1 {
            return self.compute_and_flush(chunk, self.schedule.workers() == 0);
        }
        self.record.add_tasks(chunk.tasks());
        let result = self.work_on(chunk);
        let is_error = result.is_err();
        self.buffer(result);
        if is_error || self.buffered.1 >= MAX_BUFFERED_TASKS { self.flush() } else { Ok(()) }
    }

    fn buffer(&mut self, result: Result<R, E>) {
        let (results, count) = &mut self.buffered;
        *count += 1;
        // A few large results instead of many small ones, whose memory another thread would have to free.
        let rest = match (results.last_mut(), result) {
            (Some(Ok(last)), Ok(next)) => last.join(next).map(Ok),
            (_, result) => Some(result),
        };
        results.extend(rest);
    }

    /// Passes buffered results to the collector. Callers of [`Feed::compute`] must do this before they wait
    /// for something; all other methods do it themselves.
    pub fn flush(&mut self) -> Result<(), E> {
        if self.buffered.1 == 0 {
            return Ok(());
        }
        if self.schedule.workers() == 0 {
            self.run_side_jobs();
        }
        let (results, _) = std::mem::take(&mut self.buffered);
        self.enqueue(Pending::Ready(results))
    }

    /// Computes a chunk and then enqueues its result: no other chunk comes in between, and a sleeping
    /// collector is not woken only to wait for the result.
    fn compute_and_flush(&mut self, chunk: C, runs_side_jobs: bool) -> Result<(), E> {
        self.record.add_tasks(chunk.tasks());
        if runs_side_jobs {
            self.run_side_jobs();
        }
        let result = self.work_on(chunk);
        self.buffer(result);
        self.flush()
    }

    /// Ends a leg, all chunks of which have been passed. With a leg barrier this waits until they are done.
    pub fn end_leg(&mut self) -> Result<(), E> {
        self.flush()?;
        let mut waited = Duration::ZERO;
        if self.barrier.is_some() {
            self.drain();
            let began = Instant::now();
            self.record.timer.discard_lap();
            if let Some(barrier) = self.barrier.replace(LegBarrier::new()) {
                barrier.wait();
            }
            self.record.timer.add_idle();
            waited = began.elapsed();
            // Idle times at the barrier carry no information about the size of chunks.
            (self.measured_idle_ns, _) = (None, self.idle.stop());
        }
        self.record.add_leg_end(waited);
        Ok(())
    }

    /// Computes the chunks in the warehouse on this thread, in parallel with the workers.
    pub(super) fn drain(&mut self) {
        while self.has_warehouse()
            && let Ok(item) = self.ends.queue_end.try_recv()
        {
            self.take_back(item);
        }
    }

    /// True if chunks wait in the queue; under other schedules an idle worker is about to take them.
    fn has_warehouse(&self) -> bool {
        matches!(self.schedule.policy, Policy::Warehouse { .. })
    }

    /// Stores the chunk in the warehouse, or computes it on this thread when the warehouse is full.
    fn store(&mut self, chunk: C) -> Result<(), E> {
        if self.ends.queue.is_full() {
            self.record.add_refusal();
            return self.compute_and_flush(chunk, true);
        }
        // Only this thread fills the queue, so there is still a free slot.
        let result = self.queue_chunk(chunk)?;
        self.record.add_handover(self.ends.queue.len());
        self.enqueue_in_flight(result)
    }

    /// Sends the chunk to a worker that is known to be idle.
    fn send(&mut self, chunk: C) -> Result<(), E> {
        let result = self.queue_chunk(chunk)?;
        self.record.add_handover(self.schedule.workers().saturating_sub(self.ends.idle_workers.len()));
        self.enqueue_in_flight(result)
    }

    /// Queues the chunk for the workers. Returns the receiver of its result.
    fn queue_chunk(&mut self, chunk: C) -> Result<flume::Receiver<Result<R, E>>, E> {
        self.record.add_tasks(chunk.tasks());
        let (sender, result) = flume::bounded(1);
        let barrier = self.barrier.as_ref().map(|barrier| barrier.guard.clone());
        let item = QueuedChunk { chunk, result: sender, barrier };
        self.ends.queue.send(item).map_err(|_| RunError::Ended("every worker"))?;
        Ok(result)
    }

    /// Enqueues a result that a worker is computing.
    fn enqueue_in_flight(&mut self, result: flume::Receiver<Result<R, E>>) -> Result<(), E> {
        self.flush()?;
        self.enqueue(Pending::InFlight(result))
    }

    /// Runs side jobs of the collector. They can take longer than the queued chunks last, and no chunk is
    /// made meanwhile, so one job per worker is left in the queue.
    fn run_side_jobs(&mut self) {
        self.record.timer.discard_lap();
        while self.jobs.queue_end().len() > self.schedule.workers()
            && let Ok(job) = self.jobs.queue_end().try_recv()
        {
            job();
            self.record.timer.add_job();
        }
    }

    fn work_on(&mut self, chunk: C) -> Result<R, E> {
        self.record.timer.discard_lap();
        let tasks = chunk.tasks();
        let result = (self.work)(chunk);
        self.record.add_chunk(tasks, self.schedule.workers() == 0);
        result
    }

    /// Computes a chunk taken back from the warehouse.
    fn take_back(&mut self, item: QueuedChunk<C, R, E>) {
        self.record.add_taken_back();
        let computed = catch_unwind(AssertUnwindSafe(|| self.work_on(item.chunk)));
        // A collector that has ended is detected when the next result is enqueued.
        match computed {
            Ok(result) => {
                let _ = item.result.send(result);
            }
            Err(panic) => {
                // Else the collector might report a lost result before the cause.
                let _ = item.result.send(Err(RunError::panicked("the producer", &*panic).into()));
                resume_unwind(panic);
            }
        }
    }

    /// Passes results to the collector. While the collector is too far behind, this thread computes chunks
    /// from the warehouse, all of which are older than the results, and runs the collector's side jobs.
    fn enqueue(&mut self, mut pending: Pending<R, E>) -> Result<(), E> {
        let gone = || E::from(RunError::Ended("the collector"));
        let (results, queue_end, jobs) = (self.ends.results.clone(), self.ends.queue_end.clone(), self.jobs);
        loop {
            pending = match results.try_send(pending) {
                Ok(()) => return Ok(()),
                Err(TrySendError::Disconnected(_)) => return Err(gone()),
                Err(TrySendError::Full(pending)) => pending,
            };
            self.record.timer.discard_lap();
            let mut any = Select::new();
            let sending = any.send(&results);
            let job = any.recv(jobs.queue_end());
            if self.has_warehouse() {
                any.recv(&queue_end);
            }
            let ready = any.select();
            if ready.index() == sending {
                self.record.timer.add_idle();
                return ready.send(&results, pending).map_err(|_| gone());
            }
            if ready.index() == job {
                if let Ok(job) = ready.recv(jobs.queue_end()) {
                    job();
                    self.record.timer.add_job();
                }
            } else if let Ok(item) = ready.recv(&queue_end) {
                self.take_back(item);
            }
        }
    }
}
