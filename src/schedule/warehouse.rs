//! The warehouse of chunks.

use super::Stop;
use super::jobs::JobQueue;
use crate::error::{Error, Result};
use crossbeam_channel::{Receiver, Sender, TrySendError, bounded, select};
use std::sync::Arc;

/// How the work is spread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Threads that compute, the producer's included; at least one.
    pub threads: usize,
    /// Capacity of the warehouse in chunks per worker.
    pub factor: usize,
}

impl Settings {
    /// Threads beside the producer's.
    fn workers(&self) -> usize {
        self.threads.max(1) - 1
    }

    /// Chunks that may wait for a worker.
    fn capacity(&self) -> usize {
        (self.factor.max(1) * self.workers()).max(1)
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
    /// The run ends early.
    fn abort(self);
}

struct Crate<C, R> {
    chunk: C,
    receipt: flume::Sender<Result<R>>,
}

/// The producer's end of the warehouse.
pub struct Feed<'a, C, R, W> {
    warehouse: Sender<Crate<C, R>>,
    receipts: Sender<flume::Receiver<Result<R>>>,
    jobs: &'a JobQueue,
    alone: bool,
    work: W,
}

impl<C, R, W: FnMut(C) -> Result<R>> Feed<'_, C, R, W> {
    /// Hands a chunk on. Blocks while the collector is behind; when the warehouse is full the chunk is worked off here.
    /// Fails when the collector has gone.
    pub fn put(&mut self, chunk: C) -> Result<()> {
        let (receipt, promise) = flume::bounded(1);
        self.announce(promise)?;
        let item = Crate { chunk, receipt };
        let refused = if self.alone {
            item
        } else {
            match self.warehouse.try_send(item) {
                Ok(()) => return Ok(()),
                Err(TrySendError::Full(item) | TrySendError::Disconnected(item)) => item,
            }
        };
        while let Ok(job) = self.jobs.exit().try_recv() {
            job();
        }
        // A collector that has gone is noticed at the next announcement.
        let _ = refused.receipt.send((self.work)(refused.chunk));
        Ok(())
    }

    fn announce(&self, mut promise: flume::Receiver<Result<R>>) -> Result<()> {
        let gone = |_| Error::Internal("the collector has ended early".to_owned());
        loop {
            // While the collector waits for a job nobody else may be there to run it.
            match self.receipts.try_send(promise) {
                Ok(()) => return Ok(()),
                Err(TrySendError::Disconnected(_)) => return Err(gone(())),
                Err(TrySendError::Full(p)) => promise = p,
            }
            let waiting = promise.clone();
            select! {
                send(self.receipts, waiting) -> sent => return sent.map_err(|_| gone(())),
                recv(self.jobs.exit()) -> job => match job {
                    Ok(job) => job(),
                    Err(_) => return self.receipts.send(promise).map_err(|_| gone(())),
                },
            }
        }
    }
}

/// Runs `produce` on this thread, the workers and the collector on others, until all is done or one of them fails.
///
/// `make_worker` is called once per computing thread; the worker it makes owns its scratch memory. `stop` is asked when
/// anything fails, and should be looked at by `produce` between chunks. The first error in the order of the results wins.
pub fn run<C, R, W, K>(
    settings: Settings,
    jobs: &Arc<JobQueue>,
    stop: &Stop,
    make_worker: impl Fn() -> W + Sync,
    produce: impl FnOnce(&mut Feed<'_, C, R, W>) -> Result<()>,
    collector: K,
) -> Result<K::Summary>
where
    C: Send,
    R: Send,
    W: FnMut(C) -> Result<R>,
    K: Collect<R>,
{
    let (warehouse, shelves) = bounded::<Crate<C, R>>(settings.capacity());
    // Every chunk that waits or is being worked on has a receipt, and as many finished ones may wait for the collector.
    let (receipts, promises) = bounded(2 * (settings.capacity() + settings.threads));
    let make_worker = &make_worker;
    std::thread::scope(|scope| {
        let mut workers = Vec::new();
        for _ in 0..settings.workers() {
            let shelves = shelves.clone();
            workers.push(scope.spawn(move || work_off(&shelves, jobs, make_worker())));
        }
        drop(shelves);
        let collecting = scope.spawn(move || {
            let outcome = collect(&promises, stop, collector);
            if outcome.is_err() {
                stop.ask();
            }
            jobs.close();
            outcome
        });
        let mut feed =
            Feed { warehouse, receipts, jobs, alone: settings.workers() == 0, work: make_worker() };
        let produced = produce(&mut feed);
        if produced.is_err() {
            stop.ask();
        }
        drop(feed);
        while let Ok(job) = jobs.exit().recv() {
            job();
        }
        let collected = collecting.join().unwrap_or_else(|_| Err(failed("the collector")));
        for worker in workers {
            worker.join().map_err(|_| failed("a worker"))?;
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

fn work_off<C, R>(shelves: &Receiver<Crate<C, R>>, jobs: &JobQueue, mut work: impl FnMut(C) -> Result<R>) {
    loop {
        if let Ok(job) = jobs.exit().try_recv() {
            job();
            continue;
        }
        select! {
            recv(jobs.exit()) -> job => match job {
                Ok(job) => job(),
                // No job will come any more, which is the collector's last act.
                Err(_) => break,
            },
            recv(shelves) -> item => match item {
                // A collector that has gone does not take the receipt; nothing is lost by that.
                Ok(Crate { chunk, receipt }) => drop(receipt.send(work(chunk))),
                Err(_) => {
                    while let Ok(job) = jobs.exit().recv() {
                        job();
                    }
                    break;
                }
            },
        }
    }
}

fn collect<R, K: Collect<R>>(
    promises: &Receiver<flume::Receiver<Result<R>>>,
    stop: &Stop,
    mut collector: K,
) -> Result<K::Summary> {
    for promise in promises {
        let taken = promise
            .recv()
            .unwrap_or_else(|_| Err(failed("a worker")))
            .and_then(|result| collector.take(result, !promises.is_empty()));
        if let Err(e) = taken {
            collector.abort();
            return Err(e);
        }
    }
    if stop.asked() {
        collector.abort();
        return Err(Error::Interrupted);
    }
    collector.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    struct Gather {
        seen: Vec<u64>,
        fail_at: Option<u64>,
    }

    impl Collect<u64> for Gather {
        type Summary = Vec<u64>;
        fn take(&mut self, result: u64, _: bool) -> Result<()> {
            if self.fail_at == Some(result) {
                return Err(Error::ClosedPipe);
            }
            self.seen.push(result);
            Ok(())
        }
        fn finish(self) -> Result<Vec<u64>> {
            Ok(self.seen)
        }
        fn abort(self) {}
    }

    fn squares(threads: usize, factor: usize, n: u64, fail_at: Option<u64>) -> Result<Vec<u64>> {
        let jobs = Arc::new(JobQueue::new(4));
        run(
            Settings { threads, factor },
            &jobs,
            &Stop::new(),
            || |x: u64| Ok(x * x),
            |feed| (0..n).try_for_each(|x| feed.put(x)),
            Gather { seen: Vec::new(), fail_at },
        )
    }

    #[test]
    fn results_come_in_the_order_of_the_chunks() {
        let expected: Vec<u64> = (0..500).map(|x| x * x).collect();
        for (threads, factor) in [(1, 1), (2, 1), (2, 4), (8, 2)] {
            assert_eq!(squares(threads, factor, 500, None).unwrap(), expected, "{threads} threads");
        }
        assert!(squares(4, 4, 0, None).unwrap().is_empty());
    }

    #[test]
    fn a_collector_that_fails_ends_the_run_with_its_reason() {
        for threads in [1, 2, 8] {
            assert!(matches!(squares(threads, 2, 100_000, Some(25)), Err(Error::ClosedPipe)));
        }
    }

    #[test]
    fn a_worker_that_fails_ends_the_run_with_its_reason() {
        for threads in [1, 3] {
            let jobs = Arc::new(JobQueue::new(4));
            let outcome = run(
                Settings { threads, factor: 2 },
                &jobs,
                &Stop::new(),
                || |x: u64| if x == 7 { Err(Error::input("seven")) } else { Ok(x) },
                |feed| (0..100_000).try_for_each(|x| feed.put(x)),
                Gather { seen: Vec::new(), fail_at: None },
            );
            assert!(matches!(outcome, Err(Error::Input(_))));
        }
    }

    /// A collector that hands work back to the pool and waits for it, as compression does.
    struct Compressor {
        jobs: Arc<JobQueue>,
        done: Arc<AtomicUsize>,
        waiting: Vec<flume::Receiver<u64>>,
        sum: u64,
    }

    impl Collect<u64> for Compressor {
        type Summary = u64;
        fn take(&mut self, result: u64, _: bool) -> Result<()> {
            let (tx, rx) = flume::bounded(1);
            let done = self.done.clone();
            let job = Box::new(move || {
                done.fetch_add(1, Ordering::Relaxed);
                let _ = tx.send(result + 1);
            });
            if let Err(job) = self.jobs.try_run(job) {
                job();
            }
            self.waiting.push(rx);
            if self.waiting.len() > 3 {
                self.sum += self.waiting.remove(0).recv().unwrap();
            }
            Ok(())
        }
        fn finish(mut self) -> Result<u64> {
            for rx in self.waiting.drain(..) {
                self.sum += rx.recv().unwrap();
            }
            Ok(self.sum)
        }
        fn abort(self) {}
    }

    #[test]
    fn jobs_of_the_collector_are_run_whatever_the_number_of_threads() {
        for threads in [1, 2, 4] {
            let jobs = Arc::new(JobQueue::new(2));
            let done = Arc::new(AtomicUsize::new(0));
            let collector =
                Compressor { jobs: jobs.clone(), done: done.clone(), waiting: Vec::new(), sum: 0 };
            let sum = run(
                Settings { threads, factor: 2 },
                &jobs,
                &Stop::new(),
                || |x: u64| Ok(x),
                |feed| (0..1000).try_for_each(|x| feed.put(x)),
                collector,
            );
            assert_eq!(sum.unwrap(), (0..1000).map(|x| x + 1).sum::<u64>());
            assert_eq!(done.load(Ordering::Relaxed), 1000);
        }
    }

    #[test]
    fn a_stop_ends_the_run_as_interrupted() {
        let jobs = Arc::new(JobQueue::new(4));
        let stop = Stop::new();
        let outcome = run(
            Settings { threads: 2, factor: 2 },
            &jobs,
            &stop,
            || |x: u64| Ok(x),
            |feed| {
                for x in 0.. {
                    if x == 50 {
                        stop.ask();
                    }
                    if stop.asked() {
                        break;
                    }
                    feed.put(x)?;
                }
                Ok(())
            },
            Gather { seen: Vec::new(), fail_at: None },
        );
        assert!(matches!(outcome, Err(Error::Interrupted)));
    }
}
