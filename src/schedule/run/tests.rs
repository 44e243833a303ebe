//! Order, endings and records of all schedules.

use super::super::feed::HELD;
use super::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

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

impl Outcome for u64 {}

impl Tasks for u64 {
    fn tasks(&self) -> u32 {
        1
    }
}

/// Nothing depends on the size here but how far the producer may be ahead: with large chunks, by a few.
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

/// A schedule for each number of threads, with and without barrier.
fn schedules(threads: &[usize]) -> Vec<Schedule> {
    let mut all = Vec::new();
    for &threads in threads {
        for policy in POLICIES {
            all.extend([false, true].map(|leg_barrier| Schedule { threads, policy, leg_barrier }));
        }
    }
    all
}

/// Hands out numbers as the pipeline hands out pulses: a refused one is computed here.
fn hand_out<W: FnMut(u64) -> Result<u64>>(
    feed: &mut Feed<'_, u64, u64, W>,
    numbers: std::ops::Range<u64>,
) -> Result<()> {
    for x in numbers {
        match x % 7 {
            6 => {
                feed.put(x)?;
                feed.leg_ended()?;
            }
            _ => {
                if let Some(x) = feed.offer(x)? {
                    feed.compute(x)?;
                }
            }
        }
    }
    Ok(())
}

fn squares(settings: Schedule, n: u64, fail_at: Option<u64>) -> Result<Vec<u64>> {
    let jobs = Arc::new(JobQueue::new(4));
    run(
        settings,
        &jobs,
        &Stop::new(),
        None,
        || |x: u64| Ok(x * x),
        |feed| hand_out(feed, 0..n),
        Gather { seen: Vec::new(), fail_at },
    )
}

#[test]
fn results_come_in_the_order_of_the_chunks() {
    let expected: Vec<u64> = (0..500).map(|x| x * x).collect();
    for settings in schedules(&[1, 2, 8]) {
        assert_eq!(squares(settings, 500, None).unwrap(), expected, "{settings:?}");
        assert!(squares(settings, 0, None).unwrap().is_empty());
    }
}

#[test]
fn a_collector_that_fails_ends_the_run_with_its_reason() {
    for settings in schedules(&[1, 2, 8]) {
        assert!(matches!(squares(settings, 100_000, Some(25)), Err(Error::ClosedPipe)), "{settings:?}");
    }
}

#[test]
fn a_worker_that_fails_ends_the_run_with_its_reason() {
    for settings in schedules(&[1, 3]) {
        let jobs = Arc::new(JobQueue::new(4));
        let outcome = run(
            settings,
            &jobs,
            &Stop::new(),
            None,
            || |x: u64| if x == 7 { Err(Error::input("seven")) } else { Ok(x) },
            |feed| hand_out(feed, 0..100_000),
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
    for settings in schedules(&[1, 2, 4]) {
        let jobs = Arc::new(JobQueue::new(2));
        let done = Arc::new(AtomicUsize::new(0));
        let collector = Compressor { jobs: jobs.clone(), done: done.clone(), waiting: Vec::new(), sum: 0 };
        let sum = run(
            settings,
            &jobs,
            &Stop::new(),
            None,
            || |x: u64| Ok(x),
            |feed| hand_out(feed, 0..1000),
            collector,
        );
        assert_eq!(sum.unwrap(), (0..1000).map(|x| x + 1).sum::<u64>());
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

/// Notes what it is told of.
struct Notes<'a>(&'a std::sync::Mutex<Vec<UpToThree>>);

impl Collect<UpToThree> for Notes<'_> {
    type Summary = ();
    fn take(&mut self, result: UpToThree, _: bool) -> Result<()> {
        self.0.lock().unwrap().push(result);
        Ok(())
    }
    fn finish(self) -> Result<()> {
        Ok(())
    }
    fn abort(self) {}
}

#[test]
fn single_tasks_are_told_of_together_and_at_the_latest_before_a_wait() {
    let notes = std::sync::Mutex::new(Vec::new());
    let told = |count: usize| {
        let began = Instant::now();
        while notes.lock().unwrap().len() < count && began.elapsed() < Duration::from_secs(20) {
            std::thread::yield_now();
        }
        notes.lock().unwrap().len() == count
    };
    run(
        Schedule { threads: 1, policy: Policy::Static { size: 1 }, leg_barrier: false },
        &Arc::new(JobQueue::new(4)),
        &Stop::new(),
        None,
        || |x: u64| Ok(UpToThree(vec![x])),
        |feed| {
            (0..5).try_for_each(|x| feed.compute(x))?;
            assert!(notes.lock().unwrap().is_empty());
            feed.settle()?;
            assert!(told(2));
            feed.compute(5)?;
            feed.leg_ended()?;
            assert!(told(3));
            feed.put(6)?;
            assert!(told(4));
            (7..7 + HELD as u64).try_for_each(|x| feed.compute(x))?;
            assert!(told(4 + HELD.div_ceil(3)));
            feed.compute(100)
        },
        Notes(&notes),
    )
    .unwrap();
    let all = notes.into_inner().unwrap();
    assert_eq!(all[..4], [vec![0, 1, 2], vec![3, 4], vec![5], vec![6]].map(UpToThree));
    assert_eq!(all.last(), Some(&UpToThree(vec![100])));
    assert!(all.iter().flat_map(|r| &r.0).is_sorted());
}

/// A collector that gives away one job, at the first result, which ends when many more chunks have been computed.
struct Patience<'a> {
    jobs: Arc<JobQueue>,
    computed: Arc<AtomicUsize>,
    enough: &'a AtomicUsize,
    waiting: Option<flume::Receiver<usize>>,
}

/// More than the collector may be behind.
const MANY: usize = 60;

impl Collect<u64> for Patience<'_> {
    type Summary = ();
    fn take(&mut self, result: u64, _: bool) -> Result<()> {
        let (computed, began) = (self.computed.clone(), Instant::now());
        let (tx, rx) = flume::bounded(1);
        if result == 0 {
            let job = move || {
                while computed.load(Ordering::SeqCst) < MANY && began.elapsed() < Duration::from_millis(300) {
                    std::thread::yield_now();
                }
                let _ = tx.send(computed.load(Ordering::SeqCst));
            };
            self.waiting = self.jobs.try_run(Box::new(job)).is_ok().then_some(rx);
        }
        Ok(())
    }
    fn finish(self) -> Result<()> {
        let computed = self.waiting.map(|job| job.recv().unwrap());
        self.enough.fetch_max(computed.unwrap_or(0), Ordering::SeqCst);
        Ok(())
    }
    fn abort(self) {}
}

#[test]
fn a_producer_ahead_of_the_collector_computes_what_waits_in_the_warehouse() {
    let enough = AtomicUsize::new(0);
    // The job may fall to the producer instead of the worker, but not always.
    for _ in 0..20 {
        let (jobs, computed) = (Arc::new(JobQueue::new(4)), Arc::new(AtomicUsize::new(0)));
        let count = &computed;
        let outcome = run(
            Schedule { threads: 2, policy: Policy::Warehouse { size: 4096, factor: 2 }, leg_barrier: false },
            &jobs,
            &Stop::new(),
            None,
            || {
                |x: u64| {
                    count.fetch_add(1, Ordering::SeqCst);
                    std::thread::sleep(Duration::from_micros(20));
                    Ok(x)
                }
            },
            |feed| (0..300).try_for_each(|x| feed.put(x)),
            Patience { jobs: jobs.clone(), computed: computed.clone(), enough: &enough, waiting: None },
        );
        outcome.unwrap();
        if enough.load(Ordering::SeqCst) >= MANY {
            return;
        }
    }
    panic!("only {} chunks were computed", enough.load(Ordering::SeqCst));
}

#[test]
fn a_stop_ends_the_run_as_interrupted() {
    let jobs = Arc::new(JobQueue::new(4));
    let stop = Stop::new();
    let outcome = run(
        Schedule { threads: 2, policy: Policy::Warehouse { size: 1, factor: 2 }, leg_barrier: false },
        &jobs,
        &stop,
        None,
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

#[test]
fn a_leg_begins_when_the_one_before_is_done() {
    for settings in schedules(&[2, 4]).into_iter().filter(|s| s.leg_barrier) {
        let jobs = Arc::new(JobQueue::new(4));
        let (done, legs_seen) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let outcome = run(
            settings,
            &jobs,
            &Stop::new(),
            None,
            || {
                |x: u64| {
                    std::thread::sleep(Duration::from_micros(50));
                    done.fetch_add(1, Ordering::SeqCst);
                    Ok(x)
                }
            },
            |feed| {
                for leg in 0..20 {
                    hand_out(feed, 7 * leg..7 * (leg + 1))?;
                    if done.load(Ordering::SeqCst) == 7 * (leg as usize + 1) {
                        legs_seen.fetch_add(1, Ordering::SeqCst);
                    }
                }
                Ok(())
            },
            Gather { seen: Vec::new(), fail_at: None },
        );
        assert_eq!(outcome.unwrap().len(), 140);
        assert_eq!(legs_seen.load(Ordering::SeqCst), 20, "{settings:?}");
    }
}

#[test]
fn records_account_for_every_task_and_every_leg() {
    for settings in schedules(&[1, 2, 4]) {
        let (jobs, recorder) = (Arc::new(JobQueue::new(4)), Recorder::new());
        let outcome = run(
            settings,
            &jobs,
            &Stop::new(),
            Some(&recorder),
            || |x: u64| Ok(x),
            |feed| hand_out(feed, 0..700),
            Gather { seen: Vec::new(), fail_at: None },
        );
        assert_eq!(outcome.unwrap().len(), 700);
        let log = recorder.finish();
        assert_eq!((log.tasks, log.legs.len(), log.workers.len()), (700, 100, settings.workers()), "{log:?}");
        assert_eq!(
            log.legs.iter().map(|leg| leg.tasks).collect::<Vec<_>>(),
            (1..=100).map(|i| 7 * i).collect::<Vec<_>>()
        );
        assert_eq!(log.handed_over, log.depths.iter().sum::<u64>());
        let by_workers = log.handed_over - log.taken_back;
        assert_eq!(by_workers + log.producer.chunks, 700, "{settings:?}");
        assert_eq!(by_workers, log.workers.iter().map(|w| w.chunks).sum::<u64>());
        for thread in log.workers.iter().chain([&log.producer]) {
            let sum = thread.busy_s + thread.idle_s + thread.jobs_s;
            assert!(sum > 0.0 && sum <= log.seconds + 1e-6, "{thread:?} of {}", log.seconds);
        }
        if settings.threads == 1 {
            let profile = log.profile.entries();
            assert_eq!((profile.len(), profile[699].0), (700, 700));
            assert!(profile.windows(2).all(|w| w[0].1 <= w[1].1));
        }
    }
}

#[test]
fn the_single_schedule_lets_the_producer_compute_nothing() {
    let (jobs, recorder) = (Arc::new(JobQueue::new(4)), Recorder::new());
    let settings = Schedule { threads: 3, policy: Policy::Single, leg_barrier: false };
    run(
        settings,
        &jobs,
        &Stop::new(),
        Some(&recorder),
        || |x: u64| Ok(x),
        |feed| hand_out(feed, 0..700),
        Gather { seen: Vec::new(), fail_at: None },
    )
    .unwrap();
    let log = recorder.finish();
    assert_eq!((log.producer.tasks, log.handed_over), (0, 700));
}
