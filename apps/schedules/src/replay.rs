//! Simulation of a schedule on a machine with more cores: measured task times, distributed in simulated time.
//!
//! The machine has as many cores as threads. Producer, workers and queues behave as in
//! [`vlscan_warehouse::run()`]; the costs are those of the [`Workload`]. The collector is one thread more
//! than there are cores: it sleeps until the next result in order is ready, and takes the results one after
//! the other. Its work takes time from a core on which another thread computes, and so lengthens the
//! computing of the chunk that it takes, as do the jobs that it has workers do; its additional work when
//! several threads compute is charged to the thread that announces the result. A thread that is too far ahead
//! of the collector waits, and the run ends when the collector has taken everything.

use crate::workload::{ChunkCosts, PerSize, Workload};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use vlscan_warehouse::{ChunkSizer, MAX_BUFFERED_TASKS, MAX_HISTORY, Policy, Schedule, Series, SizeChange};

/// The result of a simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct Replayed {
    /// Time from start to end, s.
    pub seconds: f64,
    /// Fraction of all threads' time spent computing, 0–1.
    pub utilisation: f64,
    /// Fraction of the time in which the producer made or handed over chunks.
    pub producing: f64,
    /// Processor time of all threads together, s.
    pub cpu_s: f64,
    pub sizes: Series<SizeChange>,
}

/// Simulates the tasks of `load` under `schedule`.
pub fn replay(load: &Workload, schedule: &Schedule) -> Replayed {
    let mut simulation = Simulation::new(load, schedule);
    let mut from = 0;
    for &end in &load.legs {
        simulation.run_leg(from, end);
        from = end;
    }
    simulation.finish()
}

/// A result that the collector has not taken.
#[derive(Clone, Copy)]
struct PendingResult {
    /// Time that the collector takes for it, s.
    take_s: f64,
    /// Time that this takes from the core of another thread, s.
    core_s: f64,
    /// When the chunk is done, if that is known, s.
    ready_at: Option<f64>,
}

struct WaitingChunk {
    queued_at: f64,
    cost: f64,
    number: u64,
}

struct Simulation<'a> {
    load: &'a Workload,
    costs: ChunkCosts,
    schedule: &'a Schedule,
    sizer: Option<ChunkSizer>,
    /// The producer's clock, s.
    now: f64,
    /// When each worker is done, as [`to_key`].
    workers: BinaryHeap<Reverse<i64>>,
    warehouse: VecDeque<WaitingChunk>,
    /// The results that the collector has not taken, from number `taken` on.
    pending: VecDeque<PendingResult>,
    taken: u64,
    /// Number of single tasks whose results the producer has not passed on.
    buffered: u64,
    /// When the collector has finished the results taken so far, s.
    collector: f64,
    computed: f64,
    produced: f64,
    /// Start of the current idle time of the workers, and the last idle time, s.
    idle_since: Option<f64>,
    measured_idle_ns: Option<u64>,
    sizes: Series<SizeChange>,
}

/// Converts a time to an integer of the same order: at least 0, or [`NEVER`].
fn to_key(time: f64) -> i64 {
    time.to_bits() as i64
}

fn from_key(key: i64) -> f64 {
    f64::from_bits(key as u64)
}

/// End time of a worker that has not yet worked.
const NEVER: f64 = -1.0;

impl<'a> Simulation<'a> {
    fn new(load: &'a Workload, schedule: &'a Schedule) -> Simulation<'a> {
        let sizer = match schedule.policy {
            Policy::Dynamic { size, significant_ns } => Some(ChunkSizer::new(size, significant_ns)),
            _ => None,
        };
        let costs = match schedule.policy {
            _ if schedule.workers() == 0 => load.overheads.alone,
            Policy::Single => load.overheads.single,
            _ => load.overheads.shared,
        };
        Simulation {
            load,
            costs,
            schedule,
            sizer,
            now: 0.0,
            workers: (0..schedule.workers()).map(|_| Reverse(to_key(NEVER))).collect(),
            warehouse: VecDeque::new(),
            pending: VecDeque::new(),
            taken: 0,
            buffered: 0,
            collector: 0.0,
            computed: 0.0,
            produced: 0.0,
            idle_since: None,
            measured_idle_ns: None,
            sizes: Series::new(MAX_HISTORY),
        }
    }

    fn run_leg(&mut self, start: u64, end: u64) {
        let (mut from, mut made) = (start, start);
        loop {
            let size = u64::from(self.sizer.map_or(self.schedule.policy.size(), |sizer| sizer.size()));
            let to = (from + size).min(end).max(made);
            self.produce((to - made) as f64 * self.load.making.min());
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
        self.flush();
        if self.schedule.leg_barrier {
            self.drain();
            self.now = self.now.max(self.last_done());
            (self.idle_since, self.measured_idle_ns) = (None, None);
        }
    }

    /// Hands a full chunk over. Returns `false` if the producer has computed its first task instead.
    fn offer(&mut self, from: u64, to: u64) -> bool {
        if self.schedule.workers() == 0 {
            self.compute(from, to);
            return true;
        }
        match self.schedule.policy {
            Policy::Warehouse { .. } => self.store(from, to),
            Policy::Single => {
                let idle = self.first_idle();
                if idle > self.now {
                    self.now = idle + self.costs.wake_s;
                }
                self.send(from, to);
            }
            Policy::Static { .. } | Policy::Dynamic { .. } => {
                if self.first_idle() > self.now {
                    self.end_idle_measurement();
                    // Taking the first task off requires stepping through it a second time.
                    self.produce(self.load.making.min());
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
        let busy = self.first_idle() > self.now;
        match self.schedule.policy {
            _ if self.schedule.workers() == 0 || self.schedule.leg_barrier => self.compute(from, to),
            Policy::Warehouse { .. } => self.store(from, to),
            Policy::Single => drop(self.offer(from, to)),
            Policy::Static { .. } | Policy::Dynamic { .. } if busy => self.compute(from, to),
            Policy::Static { .. } | Policy::Dynamic { .. } => self.send(from, to),
        }
    }

    fn store(&mut self, from: u64, to: u64) {
        self.take_from_warehouse();
        if self.warehouse.len() < self.schedule.queue_capacity() {
            let chunk = self.queue_chunk(from, to);
            self.warehouse.push_back(chunk);
            self.take_from_warehouse();
        } else {
            self.compute_and_flush(from, to);
        }
    }

    /// Lets workers take the chunks that they have taken by the present simulated time.
    fn take_from_warehouse(&mut self) {
        while self.first_idle() <= self.now
            && let Some(WaitingChunk { queued_at, cost, number }) = self.warehouse.pop_front()
            && let Some(Reverse(key)) = self.workers.pop()
        {
            // A worker that was idle when the chunk arrived had to be woken.
            let idle = from_key(key);
            let start = if idle < queued_at { queued_at + self.costs.wake_s } else { idle };
            self.end_chunk_at(start + cost, cost, number);
        }
    }

    fn send(&mut self, from: u64, to: u64) {
        let WaitingChunk { queued_at, cost, number } = self.queue_chunk(from, to);
        if let Some(Reverse(key)) = self.workers.pop() {
            let idle = from_key(key);
            if idle >= 0.0 && self.idle_since.is_none_or(|since| idle < since) {
                self.idle_since = Some(idle);
            }
            self.end_chunk_at(queued_at + self.costs.wake_s + cost, cost, number);
        }
    }

    /// Assigns a chunk, computed until `done`, to a worker that has been taken from the heap.
    fn end_chunk_at(&mut self, done: f64, cost: f64, number: u64) {
        self.workers.push(Reverse(to_key(done)));
        self.set_done(number, done);
        self.computed += cost;
    }

    fn queue_chunk(&mut self, from: u64, to: u64) -> WaitingChunk {
        self.make(to - from);
        let (queued_at, cost) = (self.now, self.load.cost(from, to) + self.costs.worker_s);
        WaitingChunk { queued_at, cost, number: self.announce(to - from) }
    }

    /// Adds the time of making a chunk, beyond the time of making its tasks.
    fn make(&mut self, tasks: u64) {
        let beyond = self.load.making.of(tasks) - self.load.making.min() * tasks as f64;
        self.produce(beyond.max(0.0));
    }

    /// Announces the result of the next chunk to the collector. Returns its number.
    fn announce(&mut self, tasks: u64) -> u64 {
        self.flush();
        self.enqueue(self.load.taking.of(tasks), self.load.collecting.of(tasks))
    }

    /// Passes the results of buffered single tasks to the collector.
    fn flush(&mut self) {
        let buffered = std::mem::take(&mut self.buffered);
        if buffered > 0 {
            let done = self.now;
            let of = |costs: &PerSize| buffered as f64 * costs.of(1);
            let number = self.enqueue(of(&self.load.taking), of(&self.load.collecting));
            self.set_done(number, done);
        }
    }

    /// Enqueues a result for the collector, once there is a free slot in the queue. Returns its number.
    fn enqueue(&mut self, take_s: f64, core_s: f64) -> u64 {
        self.produce(self.costs.producer_s + self.costs.collector_s);
        while let Some(first) = self.pending.front() {
            let begin = first.ready_at.map(|ready| self.collects_from(ready));
            // The collector has removed one more result from the queue.
            let is_full = self.pending.len() > self.schedule.results_capacity();
            match begin {
                Some(begin) if begin <= self.now => self.take_result(),
                _ if !is_full => break,
                _ if self.take_back() => {}
                Some(begin) => self.now = begin,
                None => break,
            }
        }
        self.pending.push_back(PendingResult { take_s, core_s, ready_at: None });
        self.taken + self.pending.len() as u64 - 1
    }

    /// Returns when the collector begins to take a result that is ready at this time, s.
    fn collects_from(&self, ready: f64) -> f64 {
        self.collector.max(ready)
    }

    /// Lets the collector take the first result, which is ready or whose time is known.
    fn take_result(&mut self) {
        if let Some(PendingResult { take_s, ready_at: Some(ready), .. }) = self.pending.pop_front() {
            self.collector = self.collects_from(ready) + take_s;
            self.taken += 1;
        }
    }

    /// Records when a chunk is done. Its result is ready earlier by the time that the collector takes from
    /// the core.
    fn set_done(&mut self, number: u64, at: f64) {
        if let Some(result) = self.pending.get_mut((number - self.taken) as usize) {
            result.ready_at = Some(at - result.core_s);
        }
    }

    fn end_idle_measurement(&mut self) {
        if let Some(since) = self.idle_since.take() {
            self.measured_idle_ns = Some(((self.now - since) * 1e9) as u64);
        }
    }

    fn resize(&mut self, tasks: u64) {
        let measured = self.measured_idle_ns.take();
        if let (Some(sizer), Some(idle_ns)) = (&mut self.sizer, measured)
            && sizer.resize(measured)
        {
            self.sizes.push(SizeChange {
                at_s: self.now,
                tasks,
                idle_ns,
                size: sizer.size(),
                step: sizer.step(),
                sign: sizer.sign(),
            });
        }
    }

    /// Computes a chunk on the producer. The result of a single task is buffered.
    fn compute(&mut self, from: u64, to: u64) {
        if to - from > 1 {
            return self.compute_and_flush(from, to);
        }
        self.work_on(self.load.cost(from, to));
        self.make(1);
        self.buffered += 1;
        if self.buffered >= MAX_BUFFERED_TASKS as u64 {
            self.flush();
        }
    }

    /// Computes a chunk on the producer, and then announces it.
    fn compute_and_flush(&mut self, from: u64, to: u64) {
        self.work_on(self.load.cost(from, to));
        let done = self.now;
        self.make(to - from);
        let chunk = self.announce(to - from);
        self.set_done(chunk, done);
    }

    fn work_on(&mut self, cost: f64) {
        self.now += cost;
        self.computed += cost;
    }

    fn produce(&mut self, seconds: f64) {
        self.now += seconds;
        self.produced += seconds;
    }

    /// Computes the chunks in the warehouse on the producer, in parallel with the workers.
    fn drain(&mut self) {
        while self.take_back() {}
    }

    /// Computes the next chunk of the warehouse on the producer. Returns `false` if there is none.
    fn take_back(&mut self) -> bool {
        self.take_from_warehouse();
        let Some(WaitingChunk { cost, number, .. }) = self.warehouse.pop_front() else { return false };
        self.work_on(cost);
        self.set_done(number, self.now);
        true
    }

    fn first_idle(&self) -> f64 {
        self.workers.peek().map_or(f64::INFINITY, |Reverse(key)| from_key(*key))
    }

    fn last_done(&self) -> f64 {
        self.workers.iter().fold(0.0, |last, Reverse(key)| last.max(from_key(*key)))
    }

    fn finish(mut self) -> Replayed {
        self.drain();
        while !self.pending.is_empty() {
            self.take_result();
        }
        let seconds = self.now.max(self.last_done()).max(self.collector) + self.load.fixed_s;
        let all = (seconds * self.schedule.threads.max(1) as f64).max(f64::MIN_POSITIVE);
        Replayed {
            seconds,
            utilisation: self.computed / all,
            producing: self.produced / seconds.max(f64::MIN_POSITIVE),
            cpu_s: self.computed + self.produced,
            sizes: self.sizes,
        }
    }
}

#[cfg(test)]
mod tests;
