//! Order, endings and records of all schedules.

use super::super::policy::MAX_BUFFERED_TASKS;
use super::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use vlscan_base::error::{Error, Result};

impl Outcome for u64 {}

impl Tasks for u64 {
    fn tasks(&self) -> u32 {
        1
    }
}

/// A collector that passes every result to one closure and returns the value of the other at the end.
struct Each<T, E>(T, E);

impl<R, S: Send, T, E> Collect<R> for Each<T, E>
where
    T: FnMut(R) -> Result<()> + Send,
    E: FnOnce() -> S + Send,
{
    type Summary = S;
    type Error = Error;
    fn take(&mut self, result: R, _: bool) -> Result<()> {
        (self.0)(result)
    }
    fn finish(self) -> Result<S> {
        Ok((self.1)())
    }
    fn abort(self) {}
}

/// Runs `work` on numbers under a schedule; `fail_at` is the result at which the collector fails.
fn gather<W: FnMut(u64) -> Result<u64>>(
    schedule: Schedule,
    recorder: Option<&Recorder>,
    fail_at: Option<u64>,
    make_worker: impl Fn() -> W + Sync,
    produce: impl FnOnce(&mut Feed<'_, u64, u64, W>) -> Result<()>,
) -> Result<Vec<u64>> {
    let seen = std::sync::Mutex::new(Vec::new());
    let take = |result| match fail_at {
        Some(at) if at == result => Err(Error::ClosedPipe),
        _ => {
            seen.lock().unwrap().push(result);
            Ok(())
        }
    };
    let collector = Each(take, || std::mem::take(&mut *seen.lock().unwrap()));
    let jobs = Arc::new(JobQueue::new(4));
    run(schedule, &jobs, &Stop::new(), recorder, make_worker, produce, collector)
}

/// Results do not depend on the size, but large chunks allow the producer to be ahead only by a few.
const POLICIES: [Policy; 8] = [
    Policy::Single,
    Policy::Static { size: 1 },
    Policy::Static { size: 4 },
    Policy::Dynamic { size: 4, significant_ns: 1000 },
    Policy::Warehouse { size: 4, factor: 1 },
    Policy::Warehouse { size: 4, factor: 4 },
    Policy::Static { size: 4096 },
    Policy::Warehouse { size: 4096, factor: 1 },
];

/// Returns a schedule for each number of threads, with and without barrier.
fn schedules(threads: &[usize]) -> Vec<Schedule> {
    let mut all = Vec::new();
    for &threads in threads {
        for policy in POLICIES {
            all.extend([false, true].map(|leg_barrier| Schedule { threads, policy, leg_barrier }));
        }
    }
    all
}

/// Distributes numbers as the pipeline distributes pulses: a number that is returned is computed by this
/// thread.
fn distribute<R: Outcome, W: FnMut(u64) -> Result<R>>(
    feed: &mut Feed<'_, u64, R, W>,
    numbers: std::ops::Range<u64>,
) -> Result<()> {
    for x in numbers {
        if x % 7 == 6 {
            feed.put(x)?;
            feed.end_leg()?;
        } else if let Some(x) = feed.offer(x)? {
            feed.compute(x)?;
        }
    }
    Ok(())
}

#[test]
fn results_come_in_the_order_of_the_chunks_and_the_first_failure_ends_the_run() {
    let expected: Vec<u64> = (0..500).map(|x| x * x).collect();
    for schedule in schedules(&[1, 2, 8]) {
        let squares = |n: u64, fail_at| {
            gather(schedule, None, fail_at, || |x: u64| Ok(x * x), |feed| distribute(feed, 0..n))
        };
        assert_eq!(squares(500, None).unwrap(), expected, "{schedule:?}");
        assert!(squares(0, None).unwrap().is_empty());
        assert!(matches!(squares(100_000, Some(25)), Err(Error::ClosedPipe)), "{schedule:?}");
        let fails = || |x: u64| if x == 7 { Err(Error::input("seven")) } else { Ok(x) };
        let outcome = gather(schedule, None, None, fails, |feed| distribute(feed, 0..100_000));
        assert!(matches!(outcome, Err(Error::Input(_))), "{schedule:?}");
    }
}

#[test]
fn jobs_of_the_collector_are_run_whatever_the_number_of_threads() {
    for schedule in schedules(&[1, 2, 4]) {
        let (jobs, done) = (Arc::new(JobQueue::new(2)), Arc::new(AtomicUsize::new(0)));
        let sum = std::sync::atomic::AtomicU64::new(0);
        let add = |rx: flume::Receiver<u64>| sum.fetch_add(rx.recv().unwrap(), Ordering::Relaxed);
        let waiting = std::sync::Mutex::new(Vec::new());
        // Offloads work to the pool and waits for it, as compression does.
        let compress = |result: u64| {
            let (tx, rx) = flume::bounded(1);
            let done = done.clone();
            let job = Box::new(move || {
                done.fetch_add(1, Ordering::Relaxed);
                let _ = tx.send(result + 1);
            });
            if let Err(job) = jobs.try_run(job) {
                job();
            }
            let mut waiting = waiting.lock().unwrap();
            waiting.push(rx);
            if waiting.len() > 3 {
                add(waiting.remove(0));
            }
            Ok(())
        };
        let collector = Each(compress, || waiting.lock().unwrap().drain(..).for_each(|rx| _ = add(rx)));
        let produce = |feed: &mut Feed<'_, _, _, _>| distribute(feed, 0..1000);
        run(schedule, &jobs, &Stop::new(), None, || |x: u64| Ok(x), produce, collector).unwrap();
        assert_eq!(sum.into_inner(), (0..1000).map(|x| x + 1).sum::<u64>());
        assert_eq!(done.load(Ordering::Relaxed), 1000);
    }
}

/// Numbers of which at most three become one result.
#[derive(Debug, PartialEq)]
struct UpToThree(Vec<u64>);

impl Outcome for UpToThree {
    fn join(&mut self, next: UpToThree) -> Option<UpToThree> {
        if self.0.len() + next.0.len() > 3 {
            return Some(next);
        }
        self.0.extend(next.0);
        None
    }
}

#[test]
fn results_of_single_tasks_are_passed_on_together_and_at_the_latest_before_a_wait() {
    let taken = std::sync::Mutex::new(Vec::new());
    let has_taken = |count: usize| {
        let began = Instant::now();
        while taken.lock().unwrap().len() < count && began.elapsed() < Duration::from_secs(20) {
            std::thread::yield_now();
        }
        taken.lock().unwrap().len() == count
    };
    let take = |result: UpToThree| {
        taken.lock().unwrap().push(result);
        Ok(())
    };
    run(
        Schedule { threads: 1, policy: Policy::Static { size: 1 }, leg_barrier: false },
        &Arc::new(JobQueue::new(4)),
        &Stop::new(),
        None,
        || |x: u64| Ok(UpToThree(vec![x])),
        |feed| {
            (0..5).try_for_each(|x| feed.compute(x))?;
            assert!(taken.lock().unwrap().is_empty());
            feed.flush()?;
            assert!(has_taken(2));
            feed.compute(5)?;
            feed.end_leg()?;
            assert!(has_taken(3));
            feed.put(6)?;
            assert!(has_taken(4));
            (7..7 + MAX_BUFFERED_TASKS as u64).try_for_each(|x| feed.compute(x))?;
            assert!(has_taken(4 + MAX_BUFFERED_TASKS.div_ceil(3)));
            feed.compute(100)
        },
        Each(take, || ()),
    )
    .unwrap();
    let all = taken.into_inner().unwrap();
    assert_eq!(all[..4], [vec![0, 1, 2], vec![3, 4], vec![5], vec![6]].map(UpToThree));
    assert_eq!(all.last(), Some(&UpToThree(vec![100])));
    assert!(all.iter().flat_map(|r| &r.0).is_sorted());
}

#[test]
fn a_producer_ahead_of_the_collector_computes_what_waits_in_the_warehouse() {
    /// More chunks than the collector may be behind.
    const MANY: usize = 60;
    let schedule =
        Schedule { threads: 2, policy: Policy::Warehouse { size: 4096, factor: 2 }, leg_barrier: false };
    // The producer may run the job instead of the worker, but not always.
    let computed_meanwhile = || {
        let (jobs, computed) = (Arc::new(JobQueue::new(4)), Arc::new(AtomicUsize::new(0)));
        let (tx, rx) = flume::bounded(1);
        // The first result starts a job that ends when many more chunks have been computed.
        let take = |result: u64| {
            let (computed, began, done) = (computed.clone(), Instant::now(), tx.clone());
            let job = move || {
                while computed.load(Ordering::SeqCst) < MANY && began.elapsed() < Duration::from_millis(300) {
                    std::thread::yield_now();
                }
                let _ = done.send(computed.load(Ordering::SeqCst));
            };
            if result == 0 && jobs.try_run(Box::new(job)).is_err() {
                let _ = tx.send(0);
            }
            Ok(())
        };
        let work = || {
            |x: u64| {
                computed.fetch_add(1, Ordering::SeqCst);
                std::thread::sleep(Duration::from_micros(20));
                Ok(x)
            }
        };
        let produce = |feed: &mut Feed<'_, _, _, _>| (0..300).try_for_each(|x| feed.put(x));
        let collector = Each(take, || rx.recv().unwrap());
        run(schedule, &jobs, &Stop::new(), None, work, produce, collector).unwrap()
    };
    assert!((0..20).any(|_| computed_meanwhile() >= MANY));
}

#[test]
fn a_panic_is_an_error_that_keeps_its_text() {
    let work = || {
        |x: u64| {
            assert!(x != 7, "seven is {x}");
            Ok(x)
        }
    };
    for schedule in schedules(&[1, 2, 4]) {
        match gather(schedule, None, None, work, |feed| distribute(feed, 0..1000)) {
            Err(Error::Internal(message)) => {
                assert!(message.ends_with("panicked: seven is 7"), "{schedule:?}: {message}");
            }
            other => panic!("{schedule:?}: {other:?}"),
        }
    }
}

/// An error type that is not that of the base.
#[derive(Debug)]
enum OwnError {
    Seven,
    Run(RunError),
}

impl From<RunError> for OwnError {
    fn from(e: RunError) -> OwnError {
        OwnError::Run(e)
    }
}

/// Counts results.
struct Count(u64);

impl Collect<u64> for Count {
    type Summary = u64;
    type Error = OwnError;

    fn take(&mut self, _: u64, _: bool) -> Result<(), OwnError> {
        self.0 += 1;
        Ok(())
    }

    fn finish(self) -> Result<u64, OwnError> {
        Ok(self.0)
    }

    fn abort(self) {}
}

#[test]
fn runs_have_an_error_type_of_their_own() {
    let count = |threads, failing: u64| {
        run(
            Schedule { threads, policy: Policy::Warehouse { size: 1, factor: 2 }, leg_barrier: false },
            &Arc::new(JobQueue::new(4)),
            &Stop::new(),
            None,
            || move |x: u64| if x == failing { Err(OwnError::Seven) } else { Ok(x) },
            |feed| (0..50).try_for_each(|x| feed.put(x)),
            Count(0),
        )
    };
    assert!(matches!(count(2, 99), Ok(50)));
    assert!(matches!(count(2, 7), Err(OwnError::Seven)));
    assert!(matches!(count(0, 7), Err(OwnError::Run(RunError::Schedule(_)))));
}

#[test]
fn a_stop_ends_the_run_as_interrupted() {
    let stop = Stop::new();
    let outcome = run(
        Schedule { threads: 2, policy: Policy::Warehouse { size: 1, factor: 2 }, leg_barrier: false },
        &Arc::new(JobQueue::new(4)),
        &stop,
        None,
        || |x: u64| Ok(x),
        |feed| {
            (0..50).try_for_each(|x| feed.put(x))?;
            stop.request();
            Ok(())
        },
        Each(|_: u64| Ok(()), || ()),
    );
    assert!(matches!(outcome, Err(Error::Interrupted)));
}

#[test]
fn an_error_of_the_producer_after_a_stop_follows_from_it() {
    let outcome = |is_stopped: bool| {
        let stop = Stop::new();
        run(
            Schedule { threads: 2, policy: Policy::Warehouse { size: 1, factor: 2 }, leg_barrier: false },
            &Arc::new(JobQueue::new(4)),
            &stop,
            None,
            || |x: u64| Ok(x),
            |feed| {
                (0..50).try_for_each(|x| feed.put(x))?;
                if is_stopped {
                    stop.request();
                }
                Err(Error::input("the stream ends within a row"))
            },
            Each(|_: u64| Ok(()), || ()),
        )
    };
    assert!(matches!(outcome(true), Err(Error::Interrupted)));
    assert!(matches!(outcome(false), Err(Error::Input(_))));
}

#[test]
fn the_failure_of_a_run_does_not_stop_the_next() {
    let stop = Stop::new();
    let run_until = |failing: u64| {
        run(
            Schedule { threads: 2, policy: Policy::Warehouse { size: 1, factor: 2 }, leg_barrier: false },
            &Arc::new(JobQueue::new(4)),
            &stop,
            None,
            || move |x: u64| if x == failing { Err(Error::input("failed")) } else { Ok(x) },
            |feed| (0..50).try_for_each(|x| feed.put(x)),
            Each(|_: u64| Ok(()), || ()),
        )
    };
    assert!(run_until(20).is_err() && !stop.is_requested());
    run_until(50).unwrap();
    assert!(!stop.is_requested());
}

#[test]
fn the_failure_of_a_run_does_not_stop_another_that_shares_its_stop() {
    let stop = Stop::new();
    let schedule =
        Schedule { threads: 2, policy: Policy::Warehouse { size: 1, factor: 2 }, leg_barrier: false };
    let jobs = || Arc::new(JobQueue::new(4));
    let fail = || {
        let work = || |_: u64| -> Result<u64> { Err(Error::input("failed")) };
        let produce = |feed: &mut Feed<'_, _, _, _>| {
            let put = (0..50).try_for_each(|x| feed.put(x));
            while !feed.state().is_stopped() {
                std::thread::yield_now();
            }
            put
        };
        run(schedule, &jobs(), &stop, None, work, produce, Each(|_: u64| Ok(()), || ()))
    };
    let taken = AtomicUsize::new(0);
    let produce = |feed: &mut Feed<'_, _, _, _>| {
        for x in 0..50 {
            if x == 25 {
                assert!(fail().is_err());
            }
            assert!(!feed.state().is_stopped());
            feed.put(x)?;
        }
        Ok(())
    };
    let take = |_: u64| {
        taken.fetch_add(1, Ordering::SeqCst);
        Ok(())
    };
    run(schedule, &jobs(), &stop, None, || |x: u64| Ok(x), produce, Each(take, || ())).unwrap();
    assert_eq!(taken.into_inner(), 50);
}

#[test]
fn a_leg_begins_when_the_one_before_is_done() {
    for schedule in schedules(&[2, 4]).into_iter().filter(|s| s.leg_barrier) {
        let done = AtomicUsize::new(0);
        let work = || {
            |x: u64| {
                std::thread::sleep(Duration::from_micros(50));
                done.fetch_add(1, Ordering::SeqCst);
                Ok(x)
            }
        };
        let outcome = gather(schedule, None, None, work, |feed| {
            (0..20).try_for_each(|leg| {
                distribute(feed, 7 * leg..7 * (leg + 1))?;
                assert_eq!(done.load(Ordering::SeqCst), 7 * (leg as usize + 1), "{schedule:?}");
                Ok(())
            })
        });
        assert_eq!(outcome.unwrap().len(), 140);
    }
}

#[test]
fn records_account_for_every_task_and_every_leg() {
    for schedule in schedules(&[1, 2, 4]) {
        let recorder = Recorder::new();
        let outcome =
            gather(schedule, Some(&recorder), None, || |x: u64| Ok(x), |feed| distribute(feed, 0..700));
        assert_eq!(outcome.unwrap().len(), 700);
        let log = recorder.finish();
        assert_eq!((log.tasks, log.legs.len(), log.workers.len()), (700, 100, schedule.workers()), "{log:?}");
        assert!(log.legs.iter().map(|leg| leg.tasks).eq((1..=100).map(|i| 7 * i)));
        assert_eq!(log.handed_over, log.depths.iter().sum::<u64>());
        let by_workers = log.handed_over - log.taken_back;
        assert_eq!(by_workers + log.producer.chunks, 700, "{schedule:?}");
        assert_eq!(by_workers, log.workers.iter().map(|w| w.chunks).sum::<u64>());
        for thread in log.workers.iter().chain([&log.producer]) {
            let sum = thread.busy_s + thread.idle_s + thread.jobs_s;
            assert!(sum > 0.0 && sum <= log.seconds + 1e-6, "{thread:?} of {}", log.seconds);
        }
        if schedule.threads == 1 {
            let profile = log.profile.entries();
            assert_eq!((profile.len(), profile[699].0), (700, 700));
            assert!(profile.windows(2).all(|w| w[0].1 <= w[1].1));
        } else if schedule.policy == Policy::Single && !schedule.leg_barrier {
            assert_eq!((log.producer.tasks, log.handed_over), (0, 700), "the producer computes nothing");
        }
    }
}
