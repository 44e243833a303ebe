//! How a schedule would do on a machine with more threads: measured task times, handed out in simulated time.
//!
//! The machine has as many cores as threads. Producer, workers and queues do what [`super::run()`] does; what costs time is
//! in the [`Workload`]. The collector is a thread more than there are cores: it sleeps until the next result in order is
//! there, and takes one after the other. What it works is missing on a core where somebody computes, and so it lengthens the
//! computing of the chunk that it takes; what it has to do beyond that when several threads compute is charged to who tells it.
//! Who is too far ahead of it waits, and nothing ends before it has taken everything.

use super::feed::HELD;
use super::{Dropper, Overheads, Policy, Schedule, Series, SizeChange, Workload};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Replayed {
    /// From start to end, s.
    pub seconds: f64,
    /// Part of all threads' time that went into computing, 0–1.
    pub utilisation: f64,
    /// Part of the time that the producer made or handed over chunks.
    pub producing: f64,
    /// Processor time of all threads together, s.
    pub cpu_s: f64,
    /// Times that the producer was refused.
    pub refusals: u64,
    /// Chunks handed to workers.
    pub handed_over: u64,
    /// Sizes of dynamic chunks.
    pub sizes: Series<SizeChange>,
}

/// Hands the tasks of `load` out as `settings` say.
pub fn replay(load: &Workload, settings: &Schedule) -> Replayed {
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

/// A place in the order of the results.
#[derive(Clone, Copy)]
struct Receipt {
    /// What it takes to take the result, s.
    taking: f64,
    /// When the chunk is or was done, if that is known.
    done: Option<f64>,
}

struct Site<'a> {
    load: &'a Workload,
    overheads: Overheads,
    settings: &'a Schedule,
    dropper: Option<Dropper>,
    /// The producer's clock.
    now: f64,
    /// When each worker is or was done.
    workers: BinaryHeap<Reverse<Moment>>,
    /// Chunks in the warehouse: when they came, what they cost and which they are.
    waiting: VecDeque<(f64, f64, u64)>,
    /// The chunks that the collector has not taken, from number `taken` on.
    receipts: VecDeque<Receipt>,
    taken: u64,
    /// Single tasks whose results the producer has, which the collector does not know of.
    held: u64,
    /// When the collector has or had taken what it took.
    collector: f64,
    computed: f64,
    produced: f64,
    /// Since when somebody has been idle, and the last idle time.
    idle_since: Option<f64>,
    measured: Option<u64>,
    out: Replayed,
}

impl<'a> Site<'a> {
    fn new(load: &'a Workload, settings: &'a Schedule) -> Site<'a> {
        let dropper = match settings.policy {
            Policy::Dynamic { size, significant_ns } => Some(Dropper::new(size, significant_ns)),
            _ => None,
        };
        let out = Replayed {
            seconds: 0.0,
            utilisation: 0.0,
            producing: 0.0,
            cpu_s: 0.0,
            refusals: 0,
            handed_over: 0,
            sizes: Series::new(4096),
        };
        let overheads = match settings.policy {
            _ if settings.workers() == 0 => load.alone,
            Policy::Single => load.single,
            _ => load.overheads,
        };
        Site {
            load,
            overheads,
            settings,
            dropper,
            now: 0.0,
            // Below every moment: who has done nothing yet has not become idle.
            workers: (0..settings.workers()).map(|_| Reverse(Moment(-1.0))).collect(),
            waiting: VecDeque::new(),
            receipts: VecDeque::new(),
            taken: 0,
            held: 0,
            collector: 0.0,
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
            self.produce((to - made) as f64 * self.load.making.least());
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
        self.settle();
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
                    self.now = free + self.overheads.wake_s;
                }
                self.send(from, to);
            }
            Policy::Static { .. } | Policy::Dynamic { .. } => {
                if self.earliest() > self.now {
                    self.refused();
                    // Its first task is stepped through once more to be taken off.
                    self.produce(self.load.making.least());
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
            let (came, cost, chunk) = self.give(from, to);
            self.waiting.push_back((came, cost, chunk));
            self.take_from_warehouse();
        } else {
            self.out.refusals += 1;
            self.work_here(from, to);
        }
    }

    /// Workers take what they have taken until now.
    fn take_from_warehouse(&mut self) {
        while !self.waiting.is_empty() && self.earliest() <= self.now {
            let next = self.waiting.pop_front();
            let (Some((came, cost, chunk)), Some(Reverse(Moment(free)))) = (next, self.workers.pop()) else {
                return;
            };
            // Who was idle when it came had to wake up.
            let start = if free < came { came + self.overheads.wake_s } else { free };
            self.workers.push(Reverse(Moment(start + cost)));
            self.done(chunk, start + cost);
            self.computed += cost;
        }
    }

    fn send(&mut self, from: u64, to: u64) {
        let (came, cost, chunk) = self.give(from, to);
        if let Some(Reverse(Moment(free))) = self.workers.pop() {
            if free >= 0.0 && self.idle_since.is_none_or(|since| free < since) {
                self.idle_since = Some(free);
            }
            let done = came + self.overheads.wake_s + cost;
            self.workers.push(Reverse(Moment(done)));
            self.done(chunk, done);
            self.computed += cost;
        }
    }

    /// Makes a chunk and gives it away. Returns when it can be begun, what it costs and which it is.
    fn give(&mut self, from: u64, to: u64) -> (f64, f64, u64) {
        self.made(to - from);
        self.out.handed_over += 1;
        let came = self.now;
        (came, self.load.cost(from, to) + self.overheads.take_s, self.announce(to - from))
    }

    /// What making the chunk takes beyond making its tasks.
    fn made(&mut self, tasks: u64) {
        let beyond = self.load.making.of(tasks) - self.load.making.least() * tasks as f64;
        self.produce(beyond.max(0.0));
    }

    /// Makes the next chunk known to the collector. Returns its number.
    fn announce(&mut self, tasks: u64) -> u64 {
        self.settle();
        self.tell(self.load.collecting.of(tasks))
    }

    /// Makes the single tasks that were computed here known to the collector.
    fn settle(&mut self) {
        let held = std::mem::take(&mut self.held);
        if held > 0 {
            let done = self.now;
            let number = self.tell(held as f64 * self.load.collecting.of(1));
            self.done(number, done);
        }
    }

    /// Makes a result known to the collector, once there is a place in the queue. Returns its number.
    fn tell(&mut self, taking: f64) -> u64 {
        self.produce(self.overheads.tell_s + self.overheads.collect_s);
        while let Some(first) = self.receipts.front() {
            let begin = first.done.map(|done| self.begins_to_take(done));
            // The collector holds one more in its hand.
            let is_full = self.receipts.len() > self.settings.receipts();
            match begin {
                Some(begin) if begin <= self.now => self.take_result(),
                _ if !is_full => break,
                _ if self.take_back() => {}
                Some(begin) => self.now = begin,
                None => break,
            }
        }
        self.receipts.push_back(Receipt { taking, done: None });
        self.taken + self.receipts.len() as u64 - 1
    }

    /// When the collector turns to a result that is there at this moment, or after the one before.
    fn begins_to_take(&self, done: f64) -> f64 {
        self.collector.max(done)
    }

    /// The collector takes the first result, which is or will be there.
    fn take_result(&mut self) {
        if let Some(Receipt { taking, done: Some(done) }) = self.receipts.pop_front() {
            self.collector = self.begins_to_take(done) + taking;
            self.taken += 1;
        }
    }

    /// A chunk is or was worked off at this moment. Its result is there earlier by what the collector takes of the core.
    fn done(&mut self, chunk: u64, at: f64) {
        if let Some(receipt) = self.receipts.get_mut((chunk - self.taken) as usize) {
            receipt.done = Some(at - receipt.taking);
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

    /// The producer computes a chunk. If it is a single task, nobody is told yet.
    fn compute(&mut self, from: u64, to: u64) {
        if to - from > 1 {
            return self.work_here(from, to);
        }
        self.work_on(self.load.cost(from, to));
        self.made(1);
        self.held += 1;
        if self.held >= HELD as u64 {
            self.settle();
        }
    }

    /// The producer computes a chunk, and announces it when that is done.
    fn work_here(&mut self, from: u64, to: u64) {
        self.work_on(self.load.cost(from, to));
        let done = self.now;
        self.made(to - from);
        let chunk = self.announce(to - from);
        self.done(chunk, done);
    }

    fn work_on(&mut self, cost: f64) {
        self.now += cost;
        self.computed += cost;
    }

    fn produce(&mut self, seconds: f64) {
        self.now += seconds;
        self.produced += seconds;
    }

    /// The producer works off what waits, beside the workers.
    fn drain(&mut self) {
        while self.take_back() {}
    }

    /// The producer works off the next chunk that waits in the warehouse, if one does.
    fn take_back(&mut self) -> bool {
        self.take_from_warehouse();
        let Some((_, cost, chunk)) = self.waiting.pop_front() else { return false };
        self.work_on(cost);
        self.done(chunk, self.now);
        true
    }

    fn earliest(&self) -> f64 {
        self.workers.peek().map_or(f64::INFINITY, |Reverse(Moment(t))| *t)
    }

    fn last_done(&self) -> f64 {
        self.workers.iter().fold(0.0, |last, Reverse(Moment(t))| last.max(*t))
    }

    fn finish(mut self) -> Replayed {
        self.drain();
        while !self.receipts.is_empty() {
            self.take_result();
        }
        let seconds = self.now.max(self.last_done()).max(self.collector) + self.load.fixed_s;
        let all = (seconds * self.settings.threads.max(1) as f64).max(f64::MIN_POSITIVE);
        Replayed {
            seconds,
            utilisation: self.computed / all,
            producing: self.produced / seconds.max(f64::MIN_POSITIVE),
            cpu_s: self.computed + self.produced,
            ..self.out
        }
    }
}

#[cfg(test)]
mod tests;
