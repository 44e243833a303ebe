//! Tasks and their costs, measured in runs on one thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use vlscan_base::error::{Error, Result};
use vlscan_warehouse::{
    Collect, Feed, JobQueue, Log, Outcome, Policy, Recorder, Schedule, Stop, Tasks, ThreadLog, run,
    thread_cpu_s,
};

/// Cumulative seconds of computing by task, measured in chunks of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    size: u32,
    tasks: Vec<u64>,
    seconds: Vec<f64>,
}

impl Profile {
    /// Creates a profile from the tasks and seconds of computing after each chunk of `size`, both ascending.
    pub fn new(size: u32, entries: &[(u64, f64)]) -> Profile {
        let (tasks, seconds) = [(0, 0.0)].iter().chain(entries).copied().unzip();
        Profile { size: size.max(1), tasks, seconds }
    }

    /// Seconds up to `task`, linear between two measured points and beyond the last.
    fn until(&self, task: u64) -> f64 {
        let last = self.tasks.len() - 1;
        let at = self.tasks.partition_point(|&t| t <= task).clamp(1, last.max(1));
        let (Some(&t1), Some(&s1)) = (self.tasks.get(at), self.seconds.get(at)) else { return 0.0 };
        let (t0, s0) = (self.tasks[at - 1], self.seconds[at - 1]);
        if t1 == t0 {
            return s1;
        }
        s0 + (s1 - s0) * (task as f64 - t0 as f64) / (t1 - t0) as f64
    }
}

/// Sizes of chunks, ascending, and the seconds per task in chunks of that size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PerSize(pub Vec<(u32, f64)>);

impl PerSize {
    /// Seconds for a chunk of `tasks` tasks.
    pub fn of(&self, tasks: u64) -> f64 {
        interpolate(&self.0, |p| p.0, tasks, |p| p.1) * tasks as f64
    }

    /// Seconds per task in the largest chunks.
    pub fn min(&self) -> f64 {
        self.0.last().map_or(0.0, |p| p.1)
    }
}

/// Interpolates the value for a chunk of `tasks` tasks: linear in the logarithm of the size between two
/// measurements of ascending `size`, constant outside.
fn interpolate<T>(measured: &[T], size: impl Fn(&T) -> u32, tasks: u64, value: impl Fn(&T) -> f64) -> f64 {
    let at = measured.partition_point(|m| u64::from(size(m)) <= tasks);
    match (at.checked_sub(1).and_then(|i| measured.get(i)), measured.get(at)) {
        (Some(a), Some(b)) => {
            let log = |n: f64| libm::log2(n.max(1.0));
            let (low, high) = (log(f64::from(size(a))), log(f64::from(size(b))));
            let share = (log(tasks as f64) - low) / (high - low);
            value(a) * (1.0 - share) + value(b) * share
        }
        (Some(m), None) | (None, Some(m)) => value(m),
        (None, None) => 0.0,
    }
}

/// Measured costs of a workload, from which [`replay()`](crate::replay::replay()) predicts run times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Workload {
    /// Task times in chunks of different sizes, sizes ascending.
    pub profiles: Vec<Profile>,
    /// Tasks up to the end of each leg, ascending; the last is the number of tasks.
    pub legs: Vec<u64>,
    /// Costs of making a chunk.
    pub making: PerSize,
    /// Costs of the collector: taking the result of a chunk, falling asleep and being woken.
    pub collecting: PerSize,
    /// Time that the collector takes for the result of a chunk when results come so quickly that it stays
    /// awake.
    pub taking: PerSize,
    /// Costs of what the collector has workers do (compression, writing).
    pub jobs: PerSize,
    /// Start and end: threads, the last results, s.
    pub fixed_s: f64,
    pub overheads: Overheads,
}

/// Processor time that a chunk costs in addition to its work, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChunkCosts {
    /// The producer: announcing the result, and queueing the chunk for a worker.
    pub producer_s: f64,
    /// The worker: taking the chunk and sending its result.
    pub worker_s: f64,
    /// The collector: taking the result.
    pub collector_s: f64,
    /// Waking a thread that waits.
    pub wake_s: f64,
}

/// Costs of distributing chunks, independent of their content.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overheads {
    /// Costs on one thread. The collector's cost is that of the run.
    pub alone: ChunkCosts,
    /// Costs on several threads. The collector's cost is the excess over one thread.
    pub shared: ChunkCosts,
    /// Single tasks in such quick succession that all threads stay awake.
    pub single: ChunkCosts,
}

impl Overheads {
    /// Measures the costs of chunks. `alone` is [`ChunkCosts::measure`] on one thread while other cores are
    /// busy.
    ///
    /// # Errors
    /// When a thread ends unexpectedly.
    pub fn measure(alone: ChunkCosts) -> Result<Overheads> {
        let (both, single) = (ChunkCosts::measure(2)?, ChunkCosts::measure_single()?);
        Ok(Overheads::combine(alone, both, single))
    }

    fn combine(alone: ChunkCosts, both: ChunkCosts, single: ChunkCosts) -> Overheads {
        let collector_s = (both.collector_s - alone.collector_s).max(0.0);
        Overheads {
            alone: ChunkCosts { producer_s: alone.producer_s, ..ChunkCosts::default() },
            shared: ChunkCosts { collector_s, wake_s: single.wake_s, ..both },
            single,
        }
    }
}

impl Workload {
    /// Derives the costs from logs of runs on one thread, of the same survey in chunks of several sizes
    /// (ascending), several runs each. `making` is the time that it takes to make a task in chunks of each of
    /// these sizes, s: next to that of computing it is too short to be told from such a log.
    ///
    /// The cumulative time over the tasks is the minimum of each chunk. The sums are processor times, which
    /// exclude other programs, of the run of median time: how often the collector slept and had to be woken
    /// differs from run to run, and the minima of different runs together would be less than any run took.
    pub fn from_logs(logs: &[(u32, Vec<Log>)], making: Vec<(u32, f64)>, overheads: Overheads) -> Workload {
        let mut load = Workload { overheads, making: PerSize(making), ..Workload::default() };
        for (size, logs) in logs.iter().filter(|(_, logs)| !logs.is_empty()) {
            let mut entries = min_times(logs);
            let sum = entries.last().map_or(0.0, |e| e.1);
            let costs = RunCosts::of(logs, sum);
            if sum > 0.0 {
                entries.iter_mut().for_each(|e| e.1 *= costs.computing_s / sum);
            }
            load.profiles.push(Profile::new(*size, &entries));
            let tasks = costs.tasks.max(1) as f64;
            load.collecting.0.push((*size, costs.collecting_s / tasks));
            load.taking.0.push((*size, costs.taking_s / tasks));
            load.jobs.0.push((*size, costs.jobs_s / tasks));
            load.fixed_s = costs.fixed_s;
        }
        let log = logs.iter().find_map(|(_, logs)| logs.first());
        load.legs = log.map_or_else(Vec::new, |log| log.legs.iter().map(|leg| leg.tasks).collect());
        load
    }

    /// The fraction of all computing that the tasks between two fractions of their number take.
    pub fn share(&self, from: f64, to: f64) -> f64 {
        let tasks = self.legs.last().copied().unwrap_or(0) as f64;
        let Some(profile) = self.profiles.last() else { return to - from };
        let all = profile.until(tasks as u64);
        let until = |fraction: f64| profile.until((fraction * tasks) as u64);
        if all > 0.0 { (until(to) - until(from)) / all } else { to - from }
    }

    /// Seconds of a computing thread for a chunk of the tasks `from..to`.
    pub fn cost(&self, from: u64, to: u64) -> f64 {
        let count = to.saturating_sub(from);
        let of = |p: &Profile| p.until(to) - p.until(from);
        let computing = interpolate(&self.profiles, |p| p.size, count, of);
        computing.max(0.0) + self.collecting.of(count) + self.jobs.of(count)
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct RunCosts {
    tasks: u64,
    computing_s: f64,
    collecting_s: f64,
    taking_s: f64,
    jobs_s: f64,
    fixed_s: f64,
}

impl RunCosts {
    /// Returns the costs of the run of median time. `computing_s` is the sum of the minimum computing times
    /// of every chunk.
    fn of(logs: &[Log], computing_s: f64) -> RunCosts {
        let mut by_time: Vec<&Log> = logs.iter().collect();
        by_time.sort_by(|a, b| a.cpu_s().total_cmp(&b.cpu_s()));
        let Some(log) = by_time.get(logs.len().saturating_sub(1) / 2) else { return RunCosts::default() };
        let p = &log.producer;
        // Other programs lengthen everything alike, and waiting takes some processor time: both clocks are
        // upper bounds.
        let awake = (p.wall_s - p.idle_s).max(f64::MIN_POSITIVE);
        let part = |seconds: f64| (p.cpu_s * (seconds / awake)).min(seconds);
        let (computing_s, jobs_s) = (part(p.busy_s).min(computing_s), part(p.jobs_s));
        let fixed = |log: &Log| (log.seconds - log.producer.wall_s - log.completing_s).max(0.0);
        let least = |of: &dyn Fn(&Log) -> f64| logs.iter().map(of).fold(f64::INFINITY, f64::min);
        RunCosts {
            tasks: p.tasks,
            computing_s,
            collecting_s: log.collector.cpu_s,
            // Other programs lengthen it, and what it does beside it takes time, too: both clocks are upper
            // bounds.
            taking_s: least(&|log| log.collector.busy_s.min(log.collector.cpu_s)),
            jobs_s,
            fixed_s: least(&fixed),
        }
    }
}

/// Cumulative times, with the minimum that each chunk took in any of the runs, which had the same chunks.
fn min_times(logs: &[Log]) -> Vec<(u64, f64)> {
    let Some(first) = logs.first() else { return Vec::new() };
    let mut sum = 0.0;
    (0..first.profile.entries().len())
        .map(|i| {
            let times = logs.iter().filter_map(|log| {
                let entries = log.profile.entries();
                let before = if i > 0 { entries.get(i - 1)?.1 } else { 0.0 };
                Some(entries.get(i)?.1 - before)
            });
            sum += times.fold(f64::INFINITY, f64::min);
            (first.profile.entries()[i].0, sum)
        })
        .collect()
}

impl ChunkCosts {
    /// Measures chunks whose work takes 20 µs each, like short chunks: long enough that a thread waiting for
    /// the next one falls asleep.
    ///
    /// # Errors
    /// When a thread ends unexpectedly.
    pub fn measure(threads: usize) -> Result<ChunkCosts> {
        const WORK_S: f64 = 20e-6;
        const CHUNKS: u32 = 2000;
        let mut runs = Vec::new();
        for _ in 0..5 {
            let worked_ns = AtomicU64::new(0);
            let work = || {
                let began = Instant::now();
                let now = || thread_cpu_s().unwrap_or_else(|| began.elapsed().as_secs_f64());
                let from = now();
                let mut spent = 0.0;
                while spent < WORK_S {
                    spent = now() - from;
                }
                worked_ns.fetch_add((spent * 1e9) as u64, Ordering::Relaxed);
            };
            let log = run_chunks(threads, Policy::Warehouse { size: 1, factor: 4 }, CHUNKS, work)?;
            let workers = sum(&log.workers);
            let work_s = worked_ns.into_inner() as f64 * 1e-9 / f64::from(CHUNKS);
            let beside = |log: &ThreadLog, per: f64| (log.cpu_s - work_s * log.chunks as f64).max(0.0) / per;
            let costs = ChunkCosts {
                producer_s: beside(&log.producer, f64::from(CHUNKS)),
                worker_s: beside(&workers, workers.chunks.max(1) as f64),
                collector_s: log.collector.cpu_s / f64::from(CHUNKS),
                wake_s: 0.0,
            };
            runs.push((log.cpu_s(), costs));
        }
        runs.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(runs[runs.len() / 2].1)
    }

    fn measure_single() -> Result<ChunkCosts> {
        const CHUNKS: u32 = 20_000;
        let all = f64::from(CHUNKS);
        let (mut producer_s, mut worker_s, mut round_trip) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
        for _ in 0..3 {
            let log = run_chunks(2, Policy::Warehouse { size: 1, factor: CHUNKS as usize }, CHUNKS, || ())?;
            producer_s = producer_s.min((log.producer.cpu_s - log.producer.busy_s).max(0.0) / all);
            let workers = sum(&log.workers);
            worker_s = worker_s.min(workers.cpu_s / workers.chunks.max(1) as f64);
            round_trip = round_trip.min(run_chunks(2, Policy::Single, CHUNKS, || ())?.seconds / all);
        }
        let wake_s = (0.5 * (round_trip - producer_s)).max(0.0);
        Ok(ChunkCosts { producer_s, worker_s, collector_s: 0.0, wake_s })
    }
}

fn sum(threads: &[ThreadLog]) -> ThreadLog {
    threads.iter().fold(ThreadLog::default(), |sum, thread| sum.plus(*thread))
}

/// Distributes chunks that consist of `work` alone.
fn run_chunks(threads: usize, policy: Policy, chunks: u32, work: impl Fn() + Sync) -> Result<Log> {
    struct OneTask;

    impl Tasks for OneTask {
        fn tasks(&self) -> u32 {
            1
        }
    }

    struct Discard;

    impl Collect<Nothing> for Discard {
        type Summary = ();
        type Error = Error;

        fn take(&mut self, _: Nothing, _: bool) -> Result<()> {
            Ok(())
        }

        fn finish(self) -> Result<()> {
            Ok(())
        }

        fn abort(self) {}
    }

    let (recorder, jobs) = (Recorder::new(), Arc::new(JobQueue::new(1)));
    let worker = || {
        |_: OneTask| {
            work();
            Ok(Nothing)
        }
    };
    let produce = |feed: &mut Feed<'_, _, _, _>| (0..chunks).try_for_each(|_| feed.put(OneTask));
    let schedule = Schedule { threads, policy, leg_barrier: false };
    run(schedule, &jobs, &Stop::new(), Some(&recorder), worker, produce, Discard)?;
    Ok(recorder.finish())
}

/// The result of work whose results do not matter.
struct Nothing;

impl Outcome for Nothing {
    fn join(&mut self, _: Nothing) -> Option<Nothing> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::replay;
    use vlscan_warehouse::LegEnd;

    #[test]
    fn costs_go_between_measured_sizes() {
        let small = Profile::new(1, &[(100, 100.0)]);
        let large = Profile::new(16, &[(100, 20.0)]);
        let load = Workload { profiles: vec![small, large], legs: vec![100], ..Workload::default() };
        assert!((load.cost(0, 1) - 1.0).abs() < 1e-12);
        assert!((load.cost(10, 14) - 4.0 * 0.6).abs() < 1e-12);
        assert!((load.cost(0, 64) - 64.0 * 0.2).abs() < 1e-12);
        assert_eq!(Workload::default().cost(0, 5), 0.0);
    }

    /// Log of a run on one thread that other programs make `slower`: a leg of 64 tasks of 1 s, one of 64
    /// tasks of 2 s; making takes 0.25 s per task and 0.5 s per chunk, collecting 0.125 s and 1 s, start and
    /// end 3 s, completing the outputs 2 s.
    fn log(size: u64, slower: f64) -> Log {
        let mut log = Log::default();
        let chunks = 128 / size;
        for i in 1..=chunks {
            let tasks = i * size;
            let seconds = tasks as f64 + tasks.saturating_sub(64) as f64;
            log.profile.push((tasks, slower * seconds));
        }
        let cpu_s = 192.0 + 0.25 * 128.0 + 0.5 * chunks as f64;
        log.producer = ThreadLog {
            chunks,
            tasks: 128,
            busy_s: slower * 192.0,
            idle_s: 7.0,
            jobs_s: 0.0,
            cpu_s,
            wall_s: slower * cpu_s + 7.0,
        };
        log.collector.cpu_s = 0.125 * 128.0 + chunks as f64;
        log.collector.busy_s = chunks as f64;
        log.completing_s = 2.0;
        log.seconds = log.producer.wall_s + 3.0 + log.completing_s;
        log.tasks = 128;
        log.legs = [64, 128].map(|tasks| LegEnd { at_s: 0.0, tasks, waited_s: 0.0 }).to_vec();
        log
    }

    #[test]
    fn logs_tell_what_everything_costs() {
        // Other programs had half of the core in every run, or in all runs but one.
        for slower in [1.0, 2.0] {
            let logs =
                [1, 4, 16].map(|size| (size, vec![log(u64::from(size), slower), log(u64::from(size), 3.0)]));
            let making = vec![(1, 0.75), (4, 0.375), (16, 0.28125)];
            let load = Workload::from_logs(&logs, making, Overheads::default());
            let costs = [1, 4, 16].map(|size| [load.making.of(size), load.collecting.of(size)]);
            for (found, known) in costs.iter().flatten().zip([0.75, 1.125, 1.5, 1.5, 4.5, 3.0]) {
                assert!((found - known).abs() < 1e-9, "{costs:?}");
            }
            assert_eq!([1, 4, 16].map(|size| load.taking.of(size)), [1.0; 3]);
            assert_eq!((load.making.min(), load.fixed_s), (4.5 / 16.0, 3.0));
            assert_eq!(load.legs, [64, 128]);
            assert!((load.cost(0, 16) - 16.0 - 1.0 - 2.0).abs() < 1e-9);
            assert!((load.cost(64, 68) - 8.0 - 1.0 - 0.5).abs() < 1e-9);
            // One thread does everything, and chunks that it computes itself cost no hand-over.
            let policy = Policy::Static { size: 16 };
            let alone = replay(&load, &Schedule { threads: 1, policy, leg_barrier: false });
            let known = 192.0 + 0.25 * 128.0 + 0.5 * 8.0 + 0.125 * 128.0 + 8.0 + 3.0;
            assert!((alone.seconds - known).abs() < 1e-9, "{} for {known}", alone.seconds);
            // Two threads, and a warehouse for one chunk of 16, which takes 4.5 s to make and 19 s in the
            // first leg, 35 s in the second. The worker computes 0 from 4.5 s and 1 until 42.5 s; the
            // producer refuses 2 at 13.5 s, stores 3 at 37 s and takes it back until 56 s. Second leg: 4 from
            // 60.5 s, 5 until 130.5 s; 6 refused at 69.5 s, 7 stored at 109 s and taken back until 144 s.
            // Start and end take 3 s.
            let policy = Policy::Warehouse { size: 16, factor: 1 };
            let both = replay(&load, &Schedule { threads: 2, policy, leg_barrier: true });
            assert!((both.seconds - 147.0).abs() < 1e-9, "{}", both.seconds);
        }
        assert_eq!(Workload::from_logs(&[], Vec::new(), Overheads::default()), Workload::default());
    }

    #[test]
    fn costs_beside_the_work_are_charged_to_the_thread_that_has_them() {
        let costs = |producer_s, worker_s, collector_s, wake_s| ChunkCosts {
            producer_s,
            worker_s,
            collector_s,
            wake_s,
        };
        let single = costs(1.0, 1.0, 0.0, 32.0);
        // A collector with less work than on one thread returns no time.
        for (with_two, extra) in [(3.0, 1.0), (1.0, 0.0)] {
            let found =
                Overheads::combine(costs(8.0, 0.0, 2.0, 0.0), costs(4.0, 16.0, with_two, 0.0), single);
            let known = [costs(8.0, 0.0, 0.0, 0.0), costs(4.0, 16.0, extra, 32.0), single];
            assert_eq!([found.alone, found.shared, found.single], known);
        }
    }

    #[test]
    fn workers_spend_time_beside_the_work_of_their_chunks() {
        let [alone, both] = [1, 2].map(|threads| ChunkCosts::measure(threads).unwrap());
        assert_eq!(alone.worker_s, 0.0);
        assert!(both.worker_s > 0.0 && both.collector_s > 0.0, "{both:?}");
        assert!(ChunkCosts::measure_single().unwrap().worker_s > 0.0);
    }
}
