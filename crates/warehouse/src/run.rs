//! The threads: one producer, the workers, one collector.

use super::error::RunError;
use super::feed::{Feed, Outcome, Pending, ProducerEnds, QueuedChunk, Tasks};
use super::jobs::{Job, JobQueue};
use super::policy::{Policy, Schedule};
use super::record::{Recorder, ThreadTimer};
use super::sizing::IdleClock;
use super::spin::spin_until;
use super::stop::{RunState, Stop};
use crossbeam_channel::{Receiver, Sender, bounded, select};
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::{Scope, ScopedJoinHandle};
use std::time::Instant;
use vlscan_base::machine;

/// Consumer of results in chunk order.
pub trait Collect<R>: Send {
    /// Result of the run.
    type Summary: Send;
    /// Error of the run: of its producer, its workers and this collector.
    type Error: From<RunError> + Send;
    /// Takes the next result. `more_waiting` is true if another result is already on its way, so that a live
    /// stream can be flushed when there is none.
    fn take(&mut self, result: R, more_waiting: bool) -> Result<(), Self::Error>;
    /// Ends a run, all results of which have been taken.
    fn finish(self) -> Result<Self::Summary, Self::Error>;
    /// Ends a run that the user has stopped; no further results follow. The summary is dropped if the
    /// producer failed before the stop.
    fn cut(self) -> Result<Self::Summary, Self::Error>
    where
        Self: Sized,
    {
        self.abort();
        Err(RunError::Interrupted.into())
    }
    /// Ends a run that has failed.
    fn abort(self);
}

/// Runs `produce` on this thread, the workers and the collector on others, until everything is done or one of
/// them fails.
///
/// `make_worker` is called once per computing thread; each worker owns its scratch memory and is independent
/// of the schedule. `produce` should check [`RunState::is_stopped`] of [`Feed::state`] between chunks: the
/// caller may have requested the stop, or a thread may have failed. The first error in the order of the
/// results is returned. An error of `produce` after the caller's stop follows from the stop, and the run ends
/// as stopped. A `recorder` records the activity of all threads.
///
/// # Errors
/// The errors of producer, workers and collector; a [`RunError`] for a schedule outside of its limits, and
/// for threads that cannot be started or panic.
pub fn run<C, R, W, K>(
    schedule: Schedule,
    jobs: &Arc<JobQueue>,
    stop: &Stop,
    recorder: Option<&Recorder>,
    make_worker: impl Fn() -> W + Sync,
    produce: impl FnOnce(&mut Feed<'_, C, R, W, K::Error>) -> Result<(), K::Error>,
    collector: K,
) -> Result<K::Summary, K::Error>
where
    C: Tasks + Send,
    R: Outcome + Send,
    W: FnMut(C) -> Result<R, K::Error>,
    K: Collect<R>,
{
    if let Err(e) = schedule.check() {
        collector.abort();
        jobs.close();
        return Err(RunError::from(e).into());
    }
    let state = &RunState::new(stop);
    let (queue, queue_end) = bounded::<QueuedChunk<C, R, K::Error>>(schedule.queue_capacity());
    let (results, results_end) = bounded(schedule.results_capacity());
    let (announce_idle, idle_workers) = bounded(schedule.workers().max(1));
    let idle = IdleClock::new();
    let is_dynamic = matches!(schedule.policy, Policy::Dynamic { .. });
    let context = WorkerContext {
        queue_end,
        jobs,
        announce_idle: (!matches!(schedule.policy, Policy::Warehouse { .. })).then_some(announce_idle),
        idle: is_dynamic.then_some(&idle),
        recorder,
    };
    let make_worker = &make_worker;
    std::thread::scope(|scope| -> Result<K::Summary, K::Error> {
        let workers = match start_workers(scope, schedule.workers(), &context, make_worker) {
            Ok(workers) => workers,
            Err(failure) => {
                collector.abort();
                jobs.close();
                return Err(failure.into());
            }
        };
        let queue_end = context.queue_end.clone();
        // A producer that waits for an idle worker must notice when none is left.
        drop(context);
        let collecting = machine::try_spawn_scoped(scope, "collector", move || {
            let outcome = collect(&results_end, state, recorder, collector);
            if outcome.is_err() {
                state.fail();
            }
            jobs.close();
            outcome
        });
        let collecting = collecting.map_err(|source| {
            jobs.close();
            RunError::Thread { name: "collector", source }
        })?;
        let ends = ProducerEnds { queue, queue_end, idle_workers, results };
        let feed = Feed::new(schedule, state, ends, jobs, &idle, recorder, make_worker());
        let (produced, is_stop_first) = produce_all(feed, stop, produce);
        let collected = collecting.join();
        let collected =
            collected.unwrap_or_else(|panic| Err(RunError::panicked("the collector", &*panic).into()));
        for worker in workers {
            worker.join().map_err(|panic| RunError::panicked("a worker", &*panic))?;
        }
        if let Some(recorder) = recorder {
            recorder.end_run(&schedule);
        }
        first_cause(collected, produced, is_stop_first)
    })
}

/// Starts the threads of the workers, all of which are idle.
fn start_workers<'scope, C, R, W, E>(
    scope: &'scope Scope<'scope, '_>,
    count: usize,
    context: &WorkerContext<'scope, C, R, E>,
    make_worker: &'scope (impl Fn() -> W + Sync),
) -> Result<Vec<ScopedJoinHandle<'scope, ()>>, RunError>
where
    C: Tasks + Send + 'scope,
    R: Send + 'scope,
    W: FnMut(C) -> Result<R, E>,
    E: From<RunError> + Send + 'scope,
{
    let start = |_| {
        context.announce_idle();
        let context = context.clone();
        machine::try_spawn_scoped(scope, "worker", move || context.run(make_worker()))
            .map_err(|source| RunError::Thread { name: "worker", source })
    };
    (0..count).map(start).collect()
}

/// Runs `produce` until it has passed all chunks or failed, then the jobs of the collector that are left.
/// Returns its outcome, and true if the caller had requested the stop when it failed.
fn produce_all<C, R, W, E>(
    mut feed: Feed<'_, C, R, W, E>,
    stop: &Stop,
    produce: impl FnOnce(&mut Feed<'_, C, R, W, E>) -> Result<(), E>,
) -> (Result<(), E>, bool)
where
    C: Tasks,
    R: Outcome,
    W: FnMut(C) -> Result<R, E>,
    E: From<RunError>,
{
    // The producer computes chunks, too. If that panics, the collector must not take what it has for
    // everything.
    let mut is_stop_first = false;
    let produced = catch_unwind(AssertUnwindSafe(|| {
        let produced = produce(&mut feed);
        is_stop_first = produced.is_err() && stop.is_requested();
        // Results before a failure or a stop are part of the output, too.
        let flushed = feed.flush();
        produced.and(flushed).map(|()| feed.drain())
    }));
    let produced = produced.unwrap_or_else(|panic| Err(RunError::panicked("the producer", &*panic).into()));
    if produced.is_err() {
        feed.state().fail();
    }
    let jobs = feed.finish();
    while let Ok(job) = jobs.queue_end().recv() {
        job();
    }
    (produced, is_stop_first)
}

/// Channels of a worker thread.
struct WorkerContext<'a, C, R, E> {
    queue_end: Receiver<QueuedChunk<C, R, E>>,
    jobs: &'a JobQueue,
    /// Channel on which the producer waits for idle workers; `None` with a warehouse.
    announce_idle: Option<Sender<()>>,
    idle: Option<&'a IdleClock>,
    recorder: Option<&'a Recorder>,
}

impl<C, R, E> Clone for WorkerContext<'_, C, R, E> {
    fn clone(&self) -> Self {
        WorkerContext {
            queue_end: self.queue_end.clone(),
            announce_idle: self.announce_idle.clone(),
            ..*self
        }
    }
}

impl<C, R, E> WorkerContext<'_, C, R, E> {
    fn announce_idle(&self) {
        if let Some(sender) = &self.announce_idle {
            // There is a slot for every worker, and a producer that has ended needs no message.
            let _ = sender.try_send(());
        }
    }
}

impl<C: Tasks, R, E: From<RunError>> WorkerContext<'_, C, R, E> {
    /// Executes jobs and chunks until both queues are closed, or `work` panics.
    fn run(self, mut work: impl FnMut(C) -> Result<R, E>) {
        let mut timer = ThreadTimer::start(self.recorder);
        let run_job = |timer: &mut ThreadTimer, job: Job| {
            timer.add_idle();
            job();
            timer.add_job();
        };
        loop {
            if let Ok(job) = self.jobs.queue_end().try_recv() {
                run_job(&mut timer, job);
                continue;
            }
            if self.announce_idle.is_some() {
                spin_until(|| !self.queue_end.is_empty() || !self.jobs.queue_end().is_empty());
            }
            select! {
                recv(self.jobs.queue_end()) -> job => match job {
                    Ok(job) => run_job(&mut timer, job),
                    // The collector has ended: it closes the job queue last. The results are lost, but a
                    // producer that has not noticed yet may wait for the chunks that it sent.
                    Err(_) => {
                        self.queue_end.iter().for_each(|_| self.announce_idle());
                        break;
                    }
                },
                recv(self.queue_end) -> item => match item {
                    Ok(item) => {
                        if self.compute(item, &mut timer, &mut work).is_break() {
                            break;
                        }
                    }
                    Err(_) => {
                        while let Ok(job) = self.jobs.queue_end().recv() {
                            run_job(&mut timer, job);
                        }
                        break;
                    }
                },
            }
        }
        timer.finish_worker();
    }

    /// Computes a chunk. A panic is its result, and the state that it leaves is not used again.
    fn compute(
        &self,
        item: QueuedChunk<C, R, E>,
        timer: &mut ThreadTimer,
        work: &mut impl FnMut(C) -> Result<R, E>,
    ) -> ControlFlow<()> {
        timer.add_idle();
        let QueuedChunk { chunk, result, barrier } = item;
        let tasks = chunk.tasks();
        let computed = match catch_unwind(AssertUnwindSafe(|| work(chunk))) {
            Ok(computed) => computed,
            Err(panic) => {
                let _ = result.send(Err(RunError::panicked("a worker", &*panic).into()));
                return ControlFlow::Break(());
            }
        };
        // Fails when the collector has ended; the result is then not needed.
        let _ = result.send(computed);
        timer.add_chunk(tasks);
        drop(barrier);
        if let Some(idle) = self.idle {
            idle.start();
        }
        self.announce_idle();
        ControlFlow::Continue(())
    }
}

/// Outcome of a collector without an error.
enum Collected<S, E> {
    /// All results were taken.
    Finished(S),
    /// The run was stopped.
    Cut(Result<S, E>),
}

/// The result of a run, or the first cause of its end. `is_stop_first` is true if the caller had requested
/// the stop when the producer failed.
fn first_cause<S, E>(
    collected: Result<Collected<S, E>, E>,
    produced: Result<(), E>,
    is_stop_first: bool,
) -> Result<S, E> {
    match (collected, produced) {
        // What stops the run also stops the programs that it reads from: their streams end early.
        (Ok(Collected::Cut(summary)), Err(_)) if is_stop_first => summary,
        // The collector only followed the producer's stop.
        (Ok(Collected::Cut(_)), Err(reason)) => Err(reason),
        (Ok(Collected::Cut(summary)), Ok(())) => summary,
        // When the collector fails, the producer fails too because it cannot pass results on.
        (Err(reason), _) => Err(reason),
        (Ok(_), Err(reason)) => Err(reason),
        (Ok(Collected::Finished(summary)), Ok(())) => Ok(summary),
    }
}

fn collect<R, K: Collect<R>>(
    pending: &Receiver<Pending<R, K::Error>>,
    state: &RunState<'_>,
    recorder: Option<&Recorder>,
    mut collector: K,
) -> Result<Collected<K::Summary, K::Error>, K::Error> {
    let mut timer = ThreadTimer::start(recorder);
    for next in pending {
        let results = match next {
            Pending::Ready(results) => results,
            Pending::InFlight(result) => {
                vec![result.recv().unwrap_or_else(|_| Err(RunError::Ended("a worker").into()))]
            }
        };
        let mut results = results.into_iter();
        timer.add_idle();
        while let Some(result) = results.next() {
            let more_waiting = results.len() > 0 || !pending.is_empty();
            let taken = result.and_then(|result| collector.take(result, more_waiting));
            timer.add_chunk(0);
            if let Err(e) = taken {
                collector.abort();
                return Err(e);
            }
        }
    }
    if state.is_stopped() {
        return Ok(Collected::Cut(collector.cut()));
    }
    timer.finish_collector();
    let began = Instant::now();
    let finished = collector.finish();
    if let Some(recorder) = recorder {
        recorder.add_completing(began);
    }
    finished.map(Collected::Finished)
}

#[cfg(test)]
mod tests;
