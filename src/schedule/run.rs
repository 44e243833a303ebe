//! The threads: one producer, workers, one collector.

use super::Stop;
use super::dropper::{Dropper, IdleClock};
use super::feed::{Crate, Feed, Outcome, Promise, Tasks, failed};
use super::jobs::JobQueue;
use super::patience::await_briefly;
use super::policy::{Policy, Schedule};
use super::record::{Account, Ledger, Recorder};
use crate::error::{Error, Result};
use crossbeam::sync::WaitGroup;
use crossbeam_channel::{Receiver, Sender, bounded, select};
use std::sync::Arc;

/// Takes results in chunk order.
pub trait Collect<R>: Send {
    /// What is known at the end.
    type Summary: Send;
    /// Takes the next result. `more_waiting` tells whether another result is already on its way, so that a live stream
    /// can be flushed when there is none.
    fn take(&mut self, result: R, more_waiting: bool) -> Result<()>;
    /// All results were taken.
    fn finish(self) -> Result<Self::Summary>;
    /// The user ends the run; what was taken until now is all that there will be, unless it turns out that the producer
    /// has failed: then the summary is dropped.
    fn cut(self) -> Result<Self::Summary>
    where
        Self: Sized,
    {
        self.abort();
        Err(Error::Interrupted)
    }
    /// The run fails.
    fn abort(self);
}

/// Runs `produce` on this thread, the workers and the collector on others, until all is done or one of them fails.
///
/// `make_worker` is called once per computing thread; the worker it makes owns its scratch memory and does not know which
/// schedule it works for. `stop` is asked when anything fails, and should be looked at by `produce` between chunks. The
/// first error in the order of the results wins. A `recorder` takes down what everybody did.
pub fn run<C, R, W, K>(
    settings: Schedule,
    jobs: &Arc<JobQueue>,
    stop: &Stop,
    recorder: Option<&Recorder>,
    make_worker: impl Fn() -> W + Sync,
    produce: impl FnOnce(&mut Feed<'_, C, R, W>) -> Result<()>,
    collector: K,
) -> Result<K::Summary>
where
    C: Tasks + Send,
    R: Outcome + Send,
    W: FnMut(C) -> Result<R>,
    K: Collect<R>,
{
    let (warehouse, shelves) = bounded::<Crate<C, R>>(settings.capacity());
    let (receipts, promises) = bounded(settings.receipts());
    let (released, free) = bounded(settings.workers().max(1));
    let idle = IdleClock::new();
    let dropper = match settings.policy {
        Policy::Dynamic { size, significant_ns } => Some(Dropper::new(size, significant_ns)),
        _ => None,
    };
    let site = Site {
        shelves,
        jobs,
        released,
        by_turns: !matches!(settings.policy, Policy::Warehouse { .. }),
        idle: dropper.map(|_| &idle),
        recorder,
    };
    for _ in 0..settings.workers() {
        // There is a place for each of them.
        let _ = site.released.send(());
    }
    let make_worker = &make_worker;
    std::thread::scope(|scope| {
        let mut workers = Vec::new();
        for _ in 0..settings.workers() {
            let site = site.clone();
            workers.push(scope.spawn(move || site.work_off(make_worker())));
        }
        let shelves = site.shelves.clone();
        // Who waits for a free worker shall learn that none is left.
        drop(site);
        let collecting = scope.spawn(move || {
            let outcome = collect(&promises, stop, recorder, collector);
            if outcome.is_err() {
                stop.ask();
            }
            jobs.close();
            outcome
        });
        let mut feed = Feed {
            settings,
            warehouse,
            shelves,
            free,
            receipts,
            jobs,
            dropper,
            idle: &idle,
            measured: None,
            pending: settings.leg_barrier.then(WaitGroup::new),
            held: (Vec::new(), 0),
            ledger: Ledger::open(recorder),
            work: make_worker(),
        };
        let produced = produce(&mut feed);
        // What came before a failure or a wish to end is a part of the results, too.
        let settled = feed.settle();
        let produced = produced.and(settled);
        match produced {
            Ok(()) => feed.drain(),
            Err(_) => stop.ask(),
        }
        feed.ledger.hand_in();
        drop(feed);
        while let Ok(job) = jobs.exit().recv() {
            job();
        }
        let collected = collecting.join().unwrap_or_else(|_| Err(failed("the collector")));
        for worker in workers {
            worker.join().map_err(|_| failed("a worker"))?;
        }
        if let Some(recorder) = recorder {
            recorder.ended(&settings);
        }
        // When the collector fails the producer fails too, for want of a taker: the collector's reason is the one to tell.
        match (collected, produced) {
            // The collector only followed the producer's wish to stop.
            (Err(Error::Interrupted), Err(reason)) => Err(reason),
            (Err(reason), _) => Err(reason),
            (Ok(_), Err(reason)) => Err(reason),
            (Ok(summary), Ok(())) => Ok(summary),
        }
    })
}

/// Where workers work.
struct Site<'a, C, R> {
    shelves: Receiver<Crate<C, R>>,
    jobs: &'a JobQueue,
    released: Sender<()>,
    /// Whether the producer waits for free workers.
    by_turns: bool,
    idle: Option<&'a IdleClock>,
    recorder: Option<&'a Recorder>,
}

impl<C, R> Clone for Site<'_, C, R> {
    fn clone(&self) -> Self {
        Site { shelves: self.shelves.clone(), released: self.released.clone(), ..*self }
    }
}

impl<C: Tasks, R> Site<'_, C, R> {
    /// Takes jobs and chunks until there will be no more of either.
    fn work_off(self, mut work: impl FnMut(C) -> Result<R>) {
        let mut account = Account::open(self.recorder);
        let run_job = |account: &mut Account, job: super::Job| {
            account.was_idle();
            job();
            account.did_job();
        };
        loop {
            if let Ok(job) = self.jobs.exit().try_recv() {
                run_job(&mut account, job);
                continue;
            }
            if self.by_turns {
                await_briefly(|| !self.shelves.is_empty() || !self.jobs.exit().is_empty());
            }
            select! {
                recv(self.jobs.exit()) -> job => match job {
                    Ok(job) => run_job(&mut account, job),
                    // No job will come any more, which is the collector's last act. Nobody takes results now, but a
                    // producer that has not noticed yet may wait for what it sent.
                    Err(_) => {
                        self.shelves.iter().for_each(|item| self.discard(item));
                        break;
                    }
                },
                recv(self.shelves) -> item => match item {
                    Ok(item) => self.compute(item, &mut account, &mut work),
                    Err(_) => {
                        while let Ok(job) = self.jobs.exit().recv() {
                            run_job(&mut account, job);
                        }
                        break;
                    }
                },
            }
        }
        account.hand_in();
    }

    fn compute(&self, item: Crate<C, R>, account: &mut Account, work: &mut impl FnMut(C) -> Result<R>) {
        account.was_idle();
        let Crate { chunk, receipt, pending } = item;
        let tasks = chunk.tasks();
        // A collector that has gone does not take the receipt; nothing is lost by that.
        let _ = receipt.send(work(chunk));
        account.computed(tasks);
        drop(pending);
        if let Some(idle) = self.idle {
            idle.worker_ends();
        }
        self.release();
    }

    /// Lets a chunk go whose result nobody would take.
    fn discard(&self, item: Crate<C, R>) {
        drop(item);
        self.release();
    }

    fn release(&self) {
        if self.by_turns {
            // There is a place for every worker, and a producer that has gone needs none.
            let _ = self.released.try_send(());
        }
    }
}

fn collect<R, K: Collect<R>>(
    promises: &Receiver<Promise<R>>,
    stop: &Stop,
    recorder: Option<&Recorder>,
    mut collector: K,
) -> Result<K::Summary> {
    let mut account = Account::open(recorder);
    for promise in promises {
        let mut results = match promise {
            Promise::Kept(results) => results,
            Promise::Given(promise) => vec![promise.recv().unwrap_or_else(|_| Err(failed("a worker")))],
        }
        .into_iter();
        account.was_idle();
        while let Some(result) = results.next() {
            let more_waiting = results.len() > 0 || !promises.is_empty();
            let taken = result.and_then(|result| collector.take(result, more_waiting));
            account.computed(0);
            if let Err(e) = taken {
                collector.abort();
                return Err(e);
            }
        }
    }
    if stop.asked() {
        return collector.cut();
    }
    account.hand_in_as_collector();
    collector.finish()
}

#[cfg(test)]
mod tests;
