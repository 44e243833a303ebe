//! How a schedule would do on a machine with more threads: measured task times, handed out in simulated time.
//!
//! The machine has as many cores as threads. Producer, workers and queues do what [`super::run()`] does; what costs time is
//! computing, making chunks, handing them over and waking up who sleeps. The collector works beside them: its work is
//! charged to the computing threads, which share their cores with it, and nothing ends before it has taken everything.

use super::{
    Collect, Dropper, JobQueue, Log, Policy, Recorder, Series, Settings, SizeChange, Stop, Tasks, run,
};
use crate::error::Result;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::sync::Arc;

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

/// What there is to do and what it costs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Workload {
    /// Task times in chunks of different sizes, sizes rising.
    profiles: Vec<Profile>,
    /// Tasks up to the end of each leg, rising; the last is the number of tasks.
    pub legs: Vec<u64>,
    /// Making a task, s.
    pub produce_s: f64,
    /// Taking the result of a task, s.
    pub collect_s: f64,
    /// Handing a chunk over, s.
    pub hand_over_s: f64,
    /// Waking a thread that waits, s.
    pub wake_s: f64,
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

    /// Seconds for a chunk of tasks `from..to`. Between two measured sizes it goes with the logarithm.
    fn cost(&self, from: u64, to: u64) -> f64 {
        let count = to.saturating_sub(from);
        let of = |p: &Profile| p.until(to) - p.until(from);
        let at = self.profiles.partition_point(|p| u64::from(p.size) <= count);
        let computing = match (at.checked_sub(1).and_then(|i| self.profiles.get(i)), self.profiles.get(at)) {
            (Some(a), Some(b)) => {
                let place = |n: f64| libm::log2(n.max(1.0));
                let (least, most) = (place(f64::from(a.size)), place(f64::from(b.size)));
                let share = (place(count as f64) - least) / (most - least);
                of(a) * (1.0 - share) + of(b) * share
            }
            (Some(p), None) | (None, Some(p)) => of(p),
            (None, None) => 0.0,
        };
        computing.max(0.0) + self.collect_s * count as f64
    }
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Replayed {
    /// From start to end, s.
    pub seconds: f64,
    /// Part of all threads' time that went into computing, 0–1.
    pub utilisation: f64,
    /// Part of the time that the producer made or handed over chunks.
    pub producing: f64,
    /// Times that the producer was refused.
    pub refusals: u64,
    /// Chunks handed to workers.
    pub handed_over: u64,
    /// Sizes of dynamic chunks.
    pub sizes: Series<SizeChange>,
}

/// Hands the tasks of `load` out as `settings` say.
pub fn replay(load: &Workload, settings: &Settings) -> Replayed {
    let mut site = Site::new(load, settings);
    let mut from = 0;
    for &end in &load.legs {
        site.leg(from, end);
        from = end;
    }
    site.finish()
}

/// A moment, s, ordered; no moment is NaN.
#[derive(Clone, Copy, Debug)]
struct Moment(f64);

impl Ord for Moment {
    fn cmp(&self, other: &Moment) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl PartialOrd for Moment {
    fn partial_cmp(&self, other: &Moment) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Moment {
    fn eq(&self, other: &Moment) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Moment {}

struct Site<'a> {
    load: &'a Workload,
    settings: &'a Settings,
    dropper: Option<Dropper>,
    /// The producer's clock.
    now: f64,
    /// When each worker is or was done.
    workers: BinaryHeap<Reverse<Moment>>,
    /// Chunks in the warehouse: when they came and what they cost.
    waiting: VecDeque<(f64, f64)>,
    computed: f64,
    produced: f64,
    /// Since when somebody has been idle, and the last idle time.
    idle_since: Option<f64>,
    measured: Option<u64>,
    out: Replayed,
}

impl<'a> Site<'a> {
    fn new(load: &'a Workload, settings: &'a Settings) -> Site<'a> {
        let dropper = match settings.policy {
            Policy::Dynamic { size, significant_ns } => Some(Dropper::new(size, significant_ns)),
            _ => None,
        };
        let out = Replayed {
            seconds: 0.0,
            utilisation: 0.0,
            producing: 0.0,
            refusals: 0,
            handed_over: 0,
            sizes: Series::new(4096),
        };
        Site {
            load,
            settings,
            dropper,
            now: 0.0,
            // Below every moment: who has done nothing yet has not become idle.
            workers: (0..settings.workers()).map(|_| Reverse(Moment(-1.0))).collect(),
            waiting: VecDeque::new(),
            computed: 0.0,
            produced: 0.0,
            idle_since: None,
            measured: None,
            out,
        }
    }

    fn leg(&mut self, start: u64, end: u64) {
        let (mut from, mut made) = (start, start);
        loop {
            let size = u64::from(self.dropper.map_or(self.settings.policy.size(), |d| d.size()));
            let to = (from + size).min(end).max(made);
            self.produce((to - made) as f64 * self.load.produce_s);
            made = to;
            if to - from < size {
                break;
            }
            // A refused chunk has lost its first task, which the producer has computed.
            from = if self.offer(from, to) { to } else { from + 1 };
        }
        if end > from {
            self.put(from, end);
        }
        if self.settings.leg_barrier {
            self.drain();
            self.now = self.now.max(self.last_done());
            (self.idle_since, self.measured) = (None, None);
        }
    }

    /// Whether the chunk is gone.
    fn offer(&mut self, from: u64, to: u64) -> bool {
        if self.settings.workers() == 0 {
            self.compute(from, to);
            return true;
        }
        match self.settings.policy {
            Policy::Warehouse { .. } => self.store(from, to),
            Policy::Single => {
                let free = self.earliest();
                if free > self.now {
                    self.now = free + self.load.wake_s;
                }
                self.send(from, to);
            }
            Policy::Static { .. } | Policy::Dynamic { .. } => {
                if self.earliest() > self.now {
                    self.refused();
                    self.compute(from, from + 1);
                    return false;
                }
                self.send(from, to);
                self.resize(to);
            }
        }
        true
    }

    fn put(&mut self, from: u64, to: u64) {
        let busy = self.earliest() > self.now;
        match self.settings.policy {
            _ if self.settings.workers() == 0 || self.settings.leg_barrier => self.compute(from, to),
            Policy::Warehouse { .. } => self.store(from, to),
            Policy::Single => drop(self.offer(from, to)),
            Policy::Static { .. } | Policy::Dynamic { .. } if busy => self.compute(from, to),
            Policy::Static { .. } | Policy::Dynamic { .. } => self.send(from, to),
        }
    }

    fn store(&mut self, from: u64, to: u64) {
        self.take_from_warehouse();
        if self.waiting.len() < self.settings.capacity() {
            self.produce(self.load.hand_over_s);
            self.waiting.push_back((self.now, self.load.cost(from, to)));
            self.out.handed_over += 1;
            self.take_from_warehouse();
        } else {
            self.out.refusals += 1;
            self.compute(from, to);
        }
    }

    /// Workers take what they have taken until now.
    fn take_from_warehouse(&mut self) {
        while !self.waiting.is_empty() && self.earliest() <= self.now {
            let chunk = self.waiting.pop_front();
            let (Some((came, cost)), Some(Reverse(Moment(free)))) = (chunk, self.workers.pop()) else {
                return;
            };
            // Who was idle when it came had to wake up.
            let start = if free < came { came + self.load.wake_s } else { free };
            self.workers.push(Reverse(Moment(start + cost)));
            self.computed += cost;
        }
    }

    fn send(&mut self, from: u64, to: u64) {
        self.produce(self.load.hand_over_s);
        let cost = self.load.cost(from, to);
        if let Some(Reverse(Moment(free))) = self.workers.pop() {
            if free >= 0.0 && self.idle_since.is_none_or(|since| free < since) {
                self.idle_since = Some(free);
            }
            self.workers.push(Reverse(Moment(self.now + self.load.wake_s + cost)));
            self.computed += cost;
            self.out.handed_over += 1;
        }
    }

    fn refused(&mut self) {
        self.out.refusals += 1;
        if let Some(since) = self.idle_since.take() {
            self.measured = Some(((self.now - since) * 1e9) as u64);
        }
    }

    fn resize(&mut self, tasks: u64) {
        let measured = self.measured.take();
        if let (Some(dropper), Some(idle_ns)) = (&mut self.dropper, measured)
            && dropper.hand_over(measured)
        {
            self.out.sizes.push(SizeChange {
                at_s: self.now,
                tasks,
                idle_ns,
                size: dropper.size(),
                step: dropper.step(),
                sign: dropper.direction().sign(),
            });
        }
    }

    fn compute(&mut self, from: u64, to: u64) {
        let cost = self.load.cost(from, to);
        self.now += cost;
        self.computed += cost;
    }

    fn produce(&mut self, seconds: f64) {
        self.now += seconds;
        self.produced += seconds;
    }

    /// The producer works off what waits, beside the workers.
    fn drain(&mut self) {
        self.take_from_warehouse();
        while let Some((_, cost)) = self.waiting.pop_front() {
            self.now += cost;
            self.computed += cost;
            self.take_from_warehouse();
        }
    }

    fn earliest(&self) -> f64 {
        self.workers.peek().map_or(f64::INFINITY, |Reverse(Moment(t))| *t)
    }

    fn last_done(&self) -> f64 {
        self.workers.iter().fold(0.0, |last, Reverse(Moment(t))| last.max(*t))
    }

    fn finish(mut self) -> Replayed {
        self.drain();
        let collected = self.load.collect_s * self.load.tasks() as f64;
        let seconds = self.now.max(self.last_done()).max(collected);
        let all = (seconds * self.settings.threads.max(1) as f64).max(f64::MIN_POSITIVE);
        Replayed {
            seconds,
            utilisation: self.computed / all,
            producing: self.produced / seconds.max(f64::MIN_POSITIVE),
            ..self.out
        }
    }
}

/// Measures what it costs to hand over a chunk, and to wake a thread that waits, s: runs without any work in them.
pub fn overheads() -> Result<(f64, f64)> {
    const CHUNKS: u32 = 20_000;
    let idle_run = |policy| -> Result<Log> {
        let (recorder, jobs) = (Recorder::new(), Arc::new(JobQueue::new(1)));
        let settings = Settings { threads: 2, policy, leg_barrier: false };
        run(
            settings,
            &jobs,
            &Stop::new(),
            Some(&recorder),
            || |_: Nothing| Ok(()),
            |feed| (0..CHUNKS).try_for_each(|_| feed.put(Nothing)),
            Ignored,
        )?;
        Ok(recorder.finish())
    };
    let (mut hand_over, mut round_trip) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..3 {
        let log = idle_run(Policy::Warehouse { size: 1, factor: CHUNKS as usize })?;
        let p = &log.producer;
        hand_over = hand_over.min((log.producer_s - p.busy_s - p.idle_s).max(0.0) / f64::from(CHUNKS));
        round_trip = round_trip.min(idle_run(Policy::Single)?.seconds / f64::from(CHUNKS));
    }
    Ok((hand_over, (0.5 * (round_trip - hand_over)).max(0.0)))
}

struct Nothing;

impl Tasks for Nothing {
    fn tasks(&self) -> u32 {
        1
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
    use super::*;

    fn load(costs: &[f64], legs: &[u64]) -> Workload {
        let mut sum = 0.0;
        let entries: Vec<(u64, f64)> = (1..)
            .zip(costs)
            .map(|(i, c)| {
                sum += c;
                (i, sum)
            })
            .collect();
        Workload::new(vec![Profile::new(1, &entries)], legs.to_vec())
    }

    fn seconds(load: &Workload, threads: usize, policy: Policy, leg_barrier: bool) -> f64 {
        let replayed = replay(load, &Settings { threads, policy, leg_barrier });
        assert!(replayed.utilisation <= 1.0 + 1e-9 && replayed.utilisation > 0.0, "{replayed:?}");
        (replayed.seconds * 1e9).round() / 1e9
    }

    #[test]
    fn one_thread_computes_one_task_after_the_other() {
        let load = load(&[1.0, 2.0, 4.0], &[2, 3]);
        for policy in [Policy::Single, Policy::Static { size: 2 }, Policy::Warehouse { size: 2, factor: 4 }] {
            assert_eq!(seconds(&load, 1, policy, true), 7.0);
        }
    }

    /// Two workers, five tasks of a second: 0 and 1, 2 and 3, 4.
    #[test]
    fn a_producer_of_single_tasks_does_not_compute() {
        assert_eq!(seconds(&load(&[1.0; 5], &[5]), 3, Policy::Single, false), 3.0);
    }

    /// The worker has 0 and 1 until 2 s; the producer computes 2 and 3; the worker has 4 and 5 until 4 s.
    #[test]
    fn a_refused_static_chunk_loses_a_task_to_the_producer() {
        let load = load(&[1.0; 6], &[6]);
        assert_eq!(seconds(&load, 2, Policy::Static { size: 2 }, false), 4.0);
        // In chunks of three the worker is done with 0, 1, 2 at 3 s, when the producer has done 3, 4, 5.
        assert_eq!(seconds(&load, 2, Policy::Static { size: 3 }, false), 3.0);
    }

    /// The worker has 0 until 3 s, 1 waits, the producer computes 2, 3 and at last 1.
    #[test]
    fn a_full_warehouse_lets_the_producer_work() {
        let load = load(&[3.0, 1.0, 1.0, 1.0], &[4]);
        assert_eq!(seconds(&load, 2, Policy::Warehouse { size: 1, factor: 1 }, false), 3.0);
        // When two may wait, the producer computes 3, then one of those.
        assert_eq!(seconds(&load, 2, Policy::Warehouse { size: 1, factor: 2 }, false), 3.0);
    }

    /// Legs of a long and a short task: with the barrier each takes as long as the long one.
    #[test]
    fn a_barrier_costs_the_wait_for_the_slowest() {
        let load = load(&[4.0, 1.0, 1.0, 4.0], &[2, 4]);
        let policy = Policy::Warehouse { size: 1, factor: 1 };
        // The worker has 0; 1 waits and the producer takes it back; then the worker has 2, and the producer 3 in the end.
        assert_eq!(seconds(&load, 2, policy, true), 8.0);
        // The worker has 0 until 4 s; 1 waits; the producer has 2 and 3 until 5 s, when the worker is done with 1, too.
        assert_eq!(seconds(&load, 2, policy, false), 5.0);
    }

    #[test]
    fn making_handing_over_and_waking_cost_time() {
        let load = Workload { produce_s: 0.5, hand_over_s: 0.25, wake_s: 0.125, ..load(&[1.0; 2], &[2]) };
        // Made and handed over at 0.75 s, awake at 0.875 s, done at 1.875 s; made at 1.25 s, a worker free at 1.875 s, the
        // producer awake at 2 s, handed over at 2.25 s, awake at 2.375 s.
        assert_eq!(seconds(&load, 2, Policy::Single, false), 3.375);
    }

    #[test]
    fn nothing_ends_before_everything_is_collected() {
        let load = Workload { collect_s: 2.0, ..load(&[0.0; 10], &[10]) };
        assert_eq!(seconds(&load, 64, Policy::Warehouse { size: 1, factor: 1 }, false), 20.0);
    }

    /// Two workers in chunks of two: they are idle while the producer computes a task of its own.
    #[test]
    fn dynamic_chunks_grow_when_a_worker_was_idle() {
        let load = Workload { produce_s: 1e-4, ..load(&[1e-3; 4000], &[4000]) };
        let policy = Policy::Dynamic { size: 2, significant_ns: 100 };
        let replayed = replay(&load, &Settings { threads: 3, policy, leg_barrier: false });
        let sizes = replayed.sizes.entries();
        assert!(!sizes.is_empty() && sizes.iter().all(|s| s.size >= 1), "{sizes:?}");
        assert!(replayed.seconds < 2.0, "{} s", replayed.seconds);
    }

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

    #[test]
    fn more_threads_than_tasks_do_no_harm() {
        let load = load(&[1.0; 8], &[3, 8]);
        for policy in [
            Policy::Single,
            Policy::Static { size: 1 },
            Policy::Dynamic { size: 1, significant_ns: 1 },
            Policy::Warehouse { size: 1, factor: 4 },
        ] {
            assert_eq!(seconds(&load, 512, policy, false), 1.0, "{policy:?}");
            assert_eq!(seconds(&load, 512, policy, true), 2.0, "{policy:?}");
        }
        assert_eq!(
            replay(&Workload::default(), &Settings { threads: 4, policy: Policy::Single, leg_barrier: true })
                .seconds,
            0.0
        );
    }
}
