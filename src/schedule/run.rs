//! The threads: one producer, workers, one collector; and the producer's end, which is where schedules differ.

use super::Stop;
use super::dropper::{Dropper, IdleClock};
use super::jobs::JobQueue;
use super::patience::await_briefly;
use super::policy::{Policy, Settings};
use super::record::{Account, Ledger, Recorder};
use crate::error::{Error, Result};
use crossbeam::sync::WaitGroup;
use crossbeam_channel::{Receiver, Select, Sender, TrySendError, bounded, select};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Work that is handed out: a number of tasks.
pub trait Tasks {
    /// How many.
    fn tasks(&self) -> u32;
}

/// What a chunk became.
pub trait Outcome: Sized {
    /// Takes in what the next chunk became, so that both are one result; gives it back if they cannot be.
    fn join(&mut self, next: Self) -> Option<Self> {
        Some(next)
    }
}

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

struct Crate<C, R> {
    chunk: C,
    receipt: flume::Sender<Result<R>>,
    /// Held until the chunk is done, where legs are kept apart.
    pending: Option<WaitGroup>,
}

/// So many single tasks the producer computes at most before it tells the collector, which may sleep, of them.
pub(super) const HELD: usize = 64;

/// The place of a result among all others.
enum Promise<R> {
    /// The producer has computed it itself, or some in a row.
    Kept(Vec<Result<R>>),
    /// A worker will send it.
    Given(flume::Receiver<Result<R>>),
}

/// The producer's end: takes chunks and sees to it that they are computed, here or by a worker, as the schedule has it.
///
/// Whatever the schedule, results keep the order in which chunks come in. Every method blocks while the collector is
/// behind, and fails when it has gone.
pub struct Feed<'a, C, R, W> {
    settings: Settings,
    warehouse: Sender<Crate<C, R>>,
    shelves: Receiver<Crate<C, R>>,
    /// One for each worker that has nothing to do; not used by the warehouse.
    free: Receiver<()>,
    receipts: Sender<Promise<R>>,
    jobs: &'a JobQueue,
    dropper: Option<Dropper>,
    idle: &'a IdleClock,
    measured: Option<u64>,
    pending: Option<WaitGroup>,
    /// Results that the collector has not been told of, and of how many chunks.
    held: (Vec<Result<R>>, usize),
    ledger: Ledger<'a>,
    work: W,
}

impl<C: Tasks, R: Outcome, W: FnMut(C) -> Result<R>> Feed<'_, C, R, W> {
    /// Tasks that the chunk in the making shall hold.
    pub fn size(&self) -> u32 {
        self.dropper.map_or(self.settings.policy.size(), |d| d.size())
    }

    /// Takes a chunk that has reached its size. It comes back when all workers are busy and the schedule wants the
    /// producer to [`Feed::compute`] its first task meanwhile and go on filling the rest.
    pub fn offer(&mut self, chunk: C) -> Result<Option<C>> {
        if self.settings.workers() == 0 {
            return self.compute(chunk).map(|()| None);
        }
        match self.settings.policy {
            Policy::Warehouse { .. } => self.store(chunk).map(|()| None),
            Policy::Single => {
                self.ledger.account.skip();
                await_briefly(|| !self.free.is_empty());
                let free = self.free.recv();
                self.ledger.account.was_idle();
                free.map_err(|_| failed("every worker"))?;
                self.send(chunk).map(|()| None)
            }
            Policy::Static { .. } | Policy::Dynamic { .. } => {
                if self.free.try_recv().is_err() {
                    self.ledger.refused();
                    if let Some(ns) = self.dropper.and_then(|_| self.idle.saturated()) {
                        self.measured = Some(ns);
                    }
                    return Ok(Some(chunk));
                }
                self.send(chunk)?;
                if let Some(dropper) = &mut self.dropper {
                    let measured = self.measured.take();
                    if dropper.hand_over(measured) {
                        self.ledger.resized(measured, dropper);
                    }
                }
                Ok(None)
            }
        }
    }

    /// Takes a chunk that ends before it has reached its size. Where legs are kept apart it is computed here.
    pub fn put(&mut self, chunk: C) -> Result<()> {
        match self.settings.policy {
            _ if self.settings.workers() == 0 || self.pending.is_some() => self.compute(chunk)?,
            Policy::Warehouse { .. } => self.store(chunk)?,
            Policy::Single => drop(self.offer(chunk)?),
            Policy::Static { .. } | Policy::Dynamic { .. } => match self.free.try_recv() {
                Ok(()) => self.send(chunk)?,
                Err(_) => self.compute(chunk)?,
            },
        }
        self.settle()
    }

    /// Computes a chunk on this thread. If it is a single task, nobody is told yet: see [`Feed::settle`].
    pub fn compute(&mut self, chunk: C) -> Result<()> {
        if chunk.tasks() > 1 {
            return self.work_here(chunk, self.settings.workers() == 0);
        }
        self.ledger.came_in(chunk.tasks());
        let result = self.work_on(chunk);
        let is_bad = result.is_err();
        self.hold(result);
        if is_bad || self.held.1 >= HELD { self.settle() } else { Ok(()) }
    }

    fn hold(&mut self, result: Result<R>) {
        let (results, count) = &mut self.held;
        *count += 1;
        // Few large results instead of many small ones, whose memory another thread would have to give back.
        let rest = match (results.last_mut(), result) {
            (Some(Ok(last)), Ok(next)) => last.join(next).map(Ok),
            (_, result) => Some(result),
        };
        results.extend(rest);
    }

    /// Tells the collector of everything that was computed here. Whoever calls [`Feed::compute`] does this before
    /// waiting for something; all other methods do it themselves.
    pub fn settle(&mut self) -> Result<()> {
        if self.held.1 == 0 {
            return Ok(());
        }
        if self.settings.workers() == 0 {
            self.help();
        }
        let (results, _) = std::mem::take(&mut self.held);
        self.tell(Promise::Kept(results))
    }

    /// Computes a chunk and announces it afterwards: no other chunk comes between, and the collector, which may sleep, need
    /// not wake up to wait for the result.
    fn work_here(&mut self, chunk: C, may_help: bool) -> Result<()> {
        self.ledger.came_in(chunk.tasks());
        if may_help {
            self.help();
        }
        let result = self.work_on(chunk);
        self.hold(result);
        self.settle()
    }

    /// A leg has ended and all its chunks have come in. Where legs are kept apart this waits until they are done.
    pub fn leg_ended(&mut self) -> Result<()> {
        self.settle()?;
        let mut waited = Duration::ZERO;
        if self.pending.is_some() {
            self.drain();
            let began = Instant::now();
            self.ledger.account.skip();
            if let Some(group) = self.pending.replace(WaitGroup::new()) {
                group.wait();
            }
            self.ledger.account.was_idle();
            waited = began.elapsed();
            // Nobody measures while nobody works.
            (self.measured, _) = (None, self.idle.saturated());
        }
        self.ledger.leg_ended(waited);
        Ok(())
    }

    /// Works off what waits in the warehouse, beside the workers.
    fn drain(&mut self) {
        // Under other schedules a chunk that was sent is on its way to a free worker.
        while matches!(self.settings.policy, Policy::Warehouse { .. })
            && let Ok(item) = self.shelves.try_recv()
        {
            self.take_back(item);
        }
    }

    /// Stores the chunk in the warehouse, or works it off here when that is full.
    fn store(&mut self, chunk: C) -> Result<()> {
        if self.warehouse.is_full() {
            self.ledger.refused();
            return self.work_here(chunk, true);
        }
        // Nobody else puts anything in, so that the place stays.
        let result = self.give(chunk)?;
        self.ledger.handed_over(self.warehouse.len());
        self.promise(result)
    }

    /// Sends the chunk to a worker that is known to be free.
    fn send(&mut self, chunk: C) -> Result<()> {
        let result = self.give(chunk)?;
        self.ledger.handed_over(self.settings.workers().saturating_sub(self.free.len()));
        self.promise(result)
    }

    /// Gives the chunk away. Returns where its result will come, for the collector.
    fn give(&mut self, chunk: C) -> Result<flume::Receiver<Result<R>>> {
        self.ledger.came_in(chunk.tasks());
        let (receipt, result) = flume::bounded(1);
        let item = Crate { chunk, receipt, pending: self.pending.clone() };
        self.warehouse.send(item).map_err(|_| failed("every worker"))?;
        Ok(result)
    }

    /// Tells the collector of a result to come, while a worker has begun with it.
    fn promise(&mut self, result: flume::Receiver<Result<R>>) -> Result<()> {
        self.settle()?;
        self.tell(Promise::Given(result))
    }

    /// Runs what the collector wants done.
    fn help(&mut self) {
        self.ledger.account.skip();
        // Nothing comes in while this thread is at a job, and jobs can take longer than what is in store; so it leaves one for
        // every worker to be busy with.
        while self.jobs.exit().len() > self.settings.workers()
            && let Ok(job) = self.jobs.exit().try_recv()
        {
            job();
            self.ledger.account.did_job();
        }
    }

    fn work_on(&mut self, chunk: C) -> Result<R> {
        self.ledger.account.skip();
        let tasks = chunk.tasks();
        let result = (self.work)(chunk);
        self.ledger.computed(tasks, self.settings.workers() == 0);
        result
    }

    /// Works off a chunk that has waited in the warehouse.
    fn take_back(&mut self, item: Crate<C, R>) {
        self.ledger.took_back();
        let result = self.work_on(item.chunk);
        // A collector that has gone is noticed at the next announcement.
        let _ = item.receipt.send(result);
    }

    /// Tells the collector of a result. While it is behind, this thread does what there is to do: it computes what waits in
    /// the warehouse, which is older than what the collector is to be told of, and runs the collector's jobs.
    fn tell(&mut self, promise: Promise<R>) -> Result<()> {
        let gone = || Error::Internal("the collector has ended early".to_owned());
        let mut promise = match self.receipts.try_send(promise) {
            Ok(()) => return Ok(()),
            Err(TrySendError::Disconnected(_)) => return Err(gone()),
            Err(TrySendError::Full(promise)) => promise,
        };
        // Under other schedules a chunk that was sent is on its way to a free worker.
        let stores = matches!(self.settings.policy, Policy::Warehouse { .. });
        let (receipts, shelves, jobs) = (self.receipts.clone(), self.shelves.clone(), self.jobs);
        self.ledger.account.skip();
        loop {
            let mut any = Select::new();
            let sending = any.send(&receipts);
            let job = any.recv(jobs.exit());
            if stores {
                any.recv(&shelves);
            }
            let ready = any.select();
            if ready.index() == sending {
                self.ledger.account.was_idle();
                return ready.send(&receipts, promise).map_err(|_| gone());
            }
            if ready.index() == job {
                let Ok(job) = ready.recv(jobs.exit()) else {
                    return receipts.send(promise).map_err(|_| gone());
                };
                job();
                self.ledger.account.did_job();
            } else {
                match ready.recv(&shelves) {
                    Ok(item) => self.take_back(item),
                    Err(_) => return receipts.send(promise).map_err(|_| gone()),
                }
                self.ledger.account.skip();
            }
            // The collector comes first.
            promise = match receipts.try_send(promise) {
                Ok(()) => return Ok(()),
                Err(TrySendError::Disconnected(_)) => return Err(gone()),
                Err(TrySendError::Full(promise)) => promise,
            };
        }
    }
}

/// Runs `produce` on this thread, the workers and the collector on others, until all is done or one of them fails.
///
/// `make_worker` is called once per computing thread; the worker it makes owns its scratch memory and does not know which
/// schedule it works for. `stop` is asked when anything fails, and should be looked at by `produce` between chunks. The
/// first error in the order of the results wins. A `recorder` takes down what everybody did.
pub fn run<C, R, W, K>(
    settings: Settings,
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

fn failed(who: &str) -> Error {
    Error::Internal(format!("{who} stopped unexpectedly; the message above tells where"))
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
