//! The producer's end of the threads, which is where schedules differ.

use super::dropper::{Dropper, IdleClock};
use super::jobs::JobQueue;
use super::patience::await_briefly;
use super::policy::{Policy, Schedule};
use super::record::Ledger;
use crate::error::{Error, Result};
use crossbeam::sync::WaitGroup;
use crossbeam_channel::{Receiver, Select, Sender, TrySendError};
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

/// A chunk on its way to a worker.
pub(super) struct Crate<C, R> {
    pub chunk: C,
    pub receipt: flume::Sender<Result<R>>,
    /// Held until the chunk is done, where legs are kept apart.
    pub pending: Option<WaitGroup>,
}

/// Single tasks that the producer computes at most before it tells the collector, which may sleep, of them.
pub(super) const HELD: usize = 64;

/// The place of a result among all others.
pub(super) enum Promise<R> {
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
    pub(super) settings: Schedule,
    pub(super) warehouse: Sender<Crate<C, R>>,
    pub(super) shelves: Receiver<Crate<C, R>>,
    /// One for each worker that has nothing to do; not used by the warehouse.
    pub(super) free: Receiver<()>,
    pub(super) receipts: Sender<Promise<R>>,
    pub(super) jobs: &'a JobQueue,
    pub(super) dropper: Option<Dropper>,
    pub(super) idle: &'a IdleClock,
    pub(super) measured: Option<u64>,
    pub(super) pending: Option<WaitGroup>,
    /// Results that the collector has not been told of, and of how many chunks.
    pub(super) held: (Vec<Result<R>>, usize),
    pub(super) ledger: Ledger<'a>,
    pub(super) work: W,
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
    pub(super) fn drain(&mut self) {
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
    /// the warehouse, of which nothing is newer than what the collector is to be told of, and runs the collector's jobs.
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

/// What to say when a thread is gone.
pub(super) fn failed(who: &str) -> Error {
    Error::Internal(format!("{who} stopped unexpectedly; the message above tells where"))
}
