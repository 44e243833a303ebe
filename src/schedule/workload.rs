//! What there is to do and what it costs, as runs on one thread tell it.

use super::feed::HELD;
use super::record::thread_cpu_s;
use super::{Collect, JobQueue, Log, Outcome, Policy, Recorder, Schedule, Stop, Tasks, ThreadLog, run};
use crate::error::Result;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Seconds of computing up to each task, measured in chunks of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    size: u32,
    tasks: Vec<u64>,
    seconds: Vec<f64>,
}

impl Profile {
    /// A profile from tasks and seconds of computing after each chunk of `size`, both rising.
    pub fn new(size: u32, entries: &[(u64, f64)]) -> Profile {
        let (tasks, seconds) = [(0, 0.0)].iter().chain(entries).copied().unzip();
        Profile { size: size.max(1), tasks, seconds }
    }

    /// Seconds up to `task`; between two measured points and beyond the last they grow evenly.
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

/// What a chunk costs, measured for some sizes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PerSize(Vec<(u32, f64)>);

impl PerSize {
    /// From sizes and the seconds for each of their tasks.
    pub fn new(mut seconds_per_task: Vec<(u32, f64)>) -> PerSize {
        seconds_per_task.sort_by_key(|p| p.0);
        PerSize(seconds_per_task)
    }

    /// Seconds for a chunk of so many tasks. What a task costs goes between two measured sizes with the logarithm.
    pub fn of(&self, tasks: u64) -> f64 {
        between(&self.0, |p| p.0, tasks, |p| p.1) * tasks as f64
    }

    /// Seconds for a task in the largest chunks.
    pub fn least(&self) -> f64 {
        self.0.last().map_or(0.0, |p| p.1)
    }
}

/// What the measured ones of rising `size` have for so many tasks: between two of them it goes with the logarithm, beyond
/// them it is that of the next one.
fn between<T>(measured: &[T], size: impl Fn(&T) -> u32, tasks: u64, value: impl Fn(&T) -> f64) -> f64 {
    let at = measured.partition_point(|m| u64::from(size(m)) <= tasks);
    match (at.checked_sub(1).and_then(|i| measured.get(i)), measured.get(at)) {
        (Some(a), Some(b)) => {
            let place = |n: f64| libm::log2(n.max(1.0));
            let (least, most) = (place(f64::from(size(a))), place(f64::from(size(b))));
            let share = (place(tasks as f64) - least) / (most - least);
            value(a) * (1.0 - share) + value(b) * share
        }
        (Some(m), None) | (None, Some(m)) => value(m),
        (None, None) => 0.0,
    }
}

/// What there is to do and what it costs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Workload {
    /// Task times in chunks of different sizes, sizes rising.
    pub(super) profiles: Vec<Profile>,
    /// Tasks up to the end of each leg, rising; the last is the number of tasks.
    pub legs: Vec<u64>,
    /// Making a chunk.
    pub making: PerSize,
    /// Taking the result of a chunk.
    pub collecting: PerSize,
    /// Beginning and ending: threads, files, the last results, s.
    pub fixed_s: f64,
    /// What handing out chunks takes where one thread computes: the telling.
    pub alone: Overheads,
    /// What it takes where several do.
    pub overheads: Overheads,
    /// The same of single tasks that are handed out one by one, so quickly that everybody stays awake.
    pub single: Overheads,
}

/// What handing out chunks takes, whatever is in them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overheads {
    /// Telling the collector of a result, and giving the chunk to a worker, s.
    pub tell_s: f64,
    /// What a worker does to take a chunk and to hand in its result, s.
    pub take_s: f64,
    /// What the collector does to take a result, beyond what it does when one thread computes, s.
    pub collect_s: f64,
    /// Waking a thread that waits, s.
    pub wake_s: f64,
}

impl Overheads {
    /// From what chunks cost beside their work on one thread, other cores being busy, and on two.
    pub fn of(alone: &Beside, both: &Beside, wake_s: f64) -> Overheads {
        Overheads {
            // Who makes chunks of nothing only tells and gives.
            tell_s: both.producer_s,
            take_s: both.worker_s,
            collect_s: (both.collector_s - alone.collector_s).max(0.0),
            wake_s,
        }
    }
}

impl Workload {
    /// Tasks with these profiles, in legs; everything else costs nothing.
    pub fn new(mut profiles: Vec<Profile>, legs: Vec<u64>) -> Workload {
        profiles.sort_by_key(|p| p.size);
        Workload { profiles, legs, ..Workload::default() }
    }

    /// Number of tasks.
    pub fn tasks(&self) -> u64 {
        self.legs.last().copied().unwrap_or(0)
    }

    /// What logs of runs on one thread tell, the same run again and again in chunks of each size, when telling the
    /// collector takes `told_s` in those runs; what handing out chunks takes they do not tell.
    ///
    /// How the time goes on over the tasks is the least of each chunk. How much everything is in all is what the threads'
    /// processor clocks told, so that other programs do not count, of the run in the middle: how often the collector slept
    /// and had to be woken differs from run to run, and the least computing of one and the least making of another would be
    /// less than any run took.
    pub fn of_logs(logs: &[(u32, Vec<Log>)], told_s: f64) -> Workload {
        let mut profiles = Vec::new();
        let (mut making, mut collecting, mut largest) = (Vec::new(), Vec::new(), (0, 0.0));
        for (size, logs) in logs.iter().filter(|(_, logs)| !logs.is_empty()) {
            let mut entries = least(logs);
            let sum = entries.last().map_or(0.0, |e| e.1);
            let costs = Costs::of(logs, sum);
            if sum > 0.0 {
                entries.iter_mut().for_each(|e| e.1 *= costs.computing_s / sum);
            }
            profiles.push(Profile::new(*size, &entries));
            let tasks = costs.tasks.max(1) as f64;
            let told_of = if *size > 1 { *size as usize } else { HELD };
            let telling = told_s / told_of as f64;
            making.push((*size, (costs.making_s / tasks - telling).max(0.0)));
            collecting.push((*size, costs.collecting_s / tasks));
            if *size >= largest.0 {
                largest = (*size, costs.fixed_s);
            }
        }
        let legs = logs.iter().find_map(|(_, logs)| logs.first());
        let legs = legs.map_or_else(Vec::new, |log| log.legs.iter().map(|leg| leg.tasks).collect());
        Workload {
            making: PerSize::new(making),
            collecting: PerSize::new(collecting),
            fixed_s: largest.1,
            alone: Overheads { tell_s: told_s, ..Overheads::default() },
            ..Workload::new(profiles, legs)
        }
    }

    /// Seconds for a chunk of tasks `from..to`. Between two measured sizes it goes with the logarithm.
    pub(super) fn cost(&self, from: u64, to: u64) -> f64 {
        let count = to.saturating_sub(from);
        let of = |p: &Profile| p.until(to) - p.until(from);
        let computing = between(&self.profiles, |p| p.size, count, of);
        computing.max(0.0) + self.collecting.of(count)
    }
}

/// What a run on one thread cost, s of processor time.
#[derive(Clone, Copy, Debug, Default)]
struct Costs {
    tasks: u64,
    computing_s: f64,
    making_s: f64,
    collecting_s: f64,
    fixed_s: f64,
}

impl Costs {
    /// Of runs of which the least computing of every chunk is `computing_s` together.
    fn of(logs: &[Log], computing_s: f64) -> Costs {
        let mut by_time: Vec<&Log> = logs.iter().collect();
        by_time.sort_by(|a, b| a.cpu_s().total_cmp(&b.cpu_s()));
        let Some(log) = by_time.get(logs.len().saturating_sub(1) / 2) else { return Costs::default() };
        let p = &log.producer;
        // Others who want the core are in the way of everything alike, and waiting takes some processor time, too: each of
        // the two clocks is too slow at most.
        let awake = (p.wall_s - p.idle_s).max(f64::MIN_POSITIVE);
        let part = |seconds: f64| (p.cpu_s * (seconds / awake)).min(seconds);
        let (computing_s, jobs_s) = (part(p.busy_s).min(computing_s), part(p.jobs_s));
        let fixed = |log: &Log| (log.seconds - log.producer.wall_s).max(0.0);
        Costs {
            tasks: p.tasks,
            computing_s,
            making_s: (p.cpu_s.min(awake) - computing_s - jobs_s).max(0.0),
            // Jobs of the collector are done by whoever computes.
            collecting_s: log.collector.cpu_s + jobs_s,
            fixed_s: logs.iter().map(fixed).fold(f64::INFINITY, f64::min),
        }
    }
}

/// Cumulative times of the least that each chunk took in any of the repetitions, which had the same chunks.
fn least(logs: &[Log]) -> Vec<(u64, f64)> {
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

/// What a chunk costs beside its work, s of processor time: for the producer, for the worker that takes it, and for the
/// collector.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Beside {
    /// Making, telling and giving.
    pub producer_s: f64,
    /// Taking and handing in; nothing where the producer computes all.
    pub worker_s: f64,
    /// Collecting.
    pub collector_s: f64,
}

/// Measures what chunks cost beside their work when they take 20 µs each, as short chunks do: so long that whoever waits for
/// the next one has fallen asleep.
pub fn beside_work(threads: usize) -> Result<Beside> {
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
        let log = idle_run(threads, Policy::Warehouse { size: 1, factor: 4 }, CHUNKS, work)?;
        let workers = log.workers.iter().fold(ThreadLog::default(), |sum, w| sum.plus(*w));
        let all = f64::from(CHUNKS);
        let work_s = worked_ns.into_inner() as f64 * 1e-9 / all;
        let beside = |log: &ThreadLog, per: f64| (log.cpu_s - work_s * log.chunks as f64).max(0.0) / per;
        runs.push((
            log.cpu_s(),
            Beside {
                producer_s: beside(&log.producer, all),
                worker_s: beside(&workers, workers.chunks.max(1) as f64),
                collector_s: log.collector.cpu_s / all,
            },
        ));
    }
    runs.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(runs[runs.len() / 2].1)
}

/// Measures what handing out single tasks takes, in runs without any work in them.
pub fn hand_overs() -> Result<Overheads> {
    const CHUNKS: u32 = 20_000;
    let (mut told, mut take, mut round_trip) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
    for _ in 0..3 {
        let warehouse = Policy::Warehouse { size: 1, factor: CHUNKS as usize };
        let log = idle_run(2, warehouse, CHUNKS, || ())?;
        let making = (log.producer.cpu_s - log.producer.busy_s).max(0.0);
        told = told.min(making / f64::from(CHUNKS));
        let taken = log.workers.iter().fold(ThreadLog::default(), |sum, w| sum.plus(*w));
        take = take.min(taken.cpu_s / taken.chunks.max(1) as f64);
        round_trip = round_trip.min(idle_run(2, Policy::Single, CHUNKS, || ())?.seconds / f64::from(CHUNKS));
    }
    Ok(Overheads { tell_s: told, take_s: take, collect_s: 0.0, wake_s: (0.5 * (round_trip - told)).max(0.0) })
}

/// Hands out so many chunks of nothing but `work`.
fn idle_run(threads: usize, policy: Policy, chunks: u32, work: impl Fn() + Sync) -> Result<Log> {
    let (recorder, jobs) = (Recorder::new(), Arc::new(JobQueue::new(1)));
    run(
        Schedule { threads, policy, leg_barrier: false },
        &jobs,
        &Stop::new(),
        Some(&recorder),
        || {
            |_: Nothing| {
                work();
                Ok(())
            }
        },
        |feed| (0..chunks).try_for_each(|_| feed.put(Nothing)),
        Ignored,
    )?;
    Ok(recorder.finish())
}

struct Nothing;

impl Tasks for Nothing {
    fn tasks(&self) -> u32 {
        1
    }
}

impl Outcome for () {
    fn join(&mut self, (): ()) -> Option<()> {
        None
    }
}

struct Ignored;

impl Collect<()> for Ignored {
    type Summary = ();

    fn take(&mut self, (): (), _: bool) -> Result<()> {
        Ok(())
    }

    fn finish(self) -> Result<()> {
        Ok(())
    }

    fn abort(self) {}
}

#[cfg(test)]
mod tests {
    use super::super::{LegEnd, replay};
    use super::*;

    #[test]
    fn costs_go_between_measured_sizes() {
        let small = Profile::new(1, &[(100, 100.0)]);
        let large = Profile::new(16, &[(100, 20.0)]);
        let load = Workload::new(vec![large, small], vec![100]);
        assert!((load.cost(0, 1) - 1.0).abs() < 1e-12);
        assert!((load.cost(10, 14) - 4.0 * 0.6).abs() < 1e-12);
        assert!((load.cost(0, 64) - 64.0 * 0.2).abs() < 1e-12);
        assert_eq!(Workload::default().cost(0, 5), 0.0);
    }

    /// The log of a run on one thread that other programs make `slower`: a leg of 64 tasks of 1 s, one of 64 of 2 s; making
    /// takes 0.25 s per task and 0.5 s per chunk, collecting 0.125 s and 1 s, begin and end 3 s.
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
        log.seconds = log.producer.wall_s + 3.0;
        log.tasks = 128;
        log.legs = [64, 128].map(|tasks| LegEnd { at_s: 0.0, tasks, waited_s: 0.0 }).to_vec();
        log
    }

    #[test]
    fn logs_tell_what_everything_costs() {
        // Other programs had half of the core in every run, or none in one of them.
        for slower in [1.0, 2.0] {
            let logs =
                [1, 4, 16].map(|size| (size, vec![log(u64::from(size), slower), log(u64::from(size), 3.0)]));
            let load = Workload::of_logs(&logs, 0.0);
            let costs = [1, 4, 16].map(|size| [load.making.of(size), load.collecting.of(size)]);
            for (found, known) in costs.iter().flatten().zip([0.75, 1.125, 1.5, 1.5, 4.5, 3.0]) {
                assert!((found - known).abs() < 1e-9, "{costs:?}");
            }
            assert_eq!((load.making.least(), load.fixed_s), (4.5 / 16.0, 3.0));
            // Every chunk was told of by itself, single tasks together.
            let told = Workload::of_logs(&logs, 0.125);
            let found = [1, 4, 16].map(|size| told.making.of(size));
            for (found, known) in found.iter().zip([0.75 - 0.125 / HELD as f64, 1.375, 4.375]) {
                assert!((found - known).abs() < 1e-9, "{found}");
            }
            assert_eq!(load.legs, [64, 128]);
            assert!((load.cost(0, 16) - 16.0 - 1.0 - 2.0).abs() < 1e-9);
            assert!((load.cost(64, 68) - 8.0 - 1.0 - 0.5).abs() < 1e-9);
            // One thread does it all, and what it computes it need not hand over.
            let policy = Policy::Static { size: 16 };
            let alone = replay(&load, &Schedule { threads: 1, policy, leg_barrier: false });
            let known = 192.0 + 0.25 * 128.0 + 0.5 * 8.0 + 0.125 * 128.0 + 8.0 + 3.0;
            assert!((alone.seconds - known).abs() < 1e-9, "{} for {known}", alone.seconds);
            // Two threads, and a warehouse for one chunk of 16, which takes 4.5 s to make and 19 s in the first leg, 35 s in
            // the second. The worker has 0 from 4.5 s and 1 until 42.5 s; the producer refuses 2 at 13.5 s, stores 3 at
            // 37 s and takes it back until 56 s. So it goes in the second leg: 4 from 60.5 s, 5 until 130.5 s; 6 refused
            // at 69.5 s, 7 stored at 109 s and taken back until 144 s. Begin and end are 3 s.
            let policy = Policy::Warehouse { size: 16, factor: 1 };
            let both = replay(&load, &Schedule { threads: 2, policy, leg_barrier: true });
            assert!((both.seconds - 147.0).abs() < 1e-9, "{}", both.seconds);
        }
        assert_eq!(Workload::of_logs(&[], 0.0), Workload::default());
        assert_eq!(Workload::of_logs(&[(4, Vec::new())], 0.0).tasks(), 0);
    }

    #[test]
    fn what_chunks_cost_beside_their_work_is_charged_to_who_does_it() {
        let beside = |producer_s, worker_s, collector_s| Beside { producer_s, worker_s, collector_s };
        let found = Overheads::of(&beside(8.0, 0.0, 2.0), &beside(4.0, 16.0, 3.0), 32.0);
        assert_eq!(found, Overheads { tell_s: 4.0, take_s: 16.0, collect_s: 1.0, wake_s: 32.0 });
        // A collector that has less to do than beside one thread gives nothing back.
        let found = Overheads::of(&beside(8.0, 0.0, 2.0), &beside(4.0, 16.0, 1.0), 32.0);
        assert_eq!(found.collect_s, 0.0);
    }

    #[test]
    fn whoever_takes_chunks_spends_time_beside_their_work() {
        let [alone, both] = [1, 2].map(|threads| beside_work(threads).unwrap());
        assert_eq!(alone.worker_s, 0.0);
        assert!(both.worker_s > 0.0 && both.collector_s > 0.0, "{both:?}");
        assert!(hand_overs().unwrap().take_s > 0.0);
    }
}
