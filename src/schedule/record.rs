//! What a schedule did: idle times, queue depths, chunk sizes. Threads keep their own accounts and hand them in at the
//! end, so recording costs two looks at the clock per chunk, and two at each thread's processor clock in all.

use super::{Dropper, Schedule};
use serde::Serialize;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A history of bounded length: when it is full every other entry goes, and of what follows only every second, fourth, …
/// is kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Series<T> {
    entries: Vec<T>,
    most: usize,
    stride: u64,
    seen: u64,
}

impl<T> Series<T> {
    /// An empty history of at most `most` entries.
    pub fn new(most: usize) -> Series<T> {
        Series { entries: Vec::new(), most: most.max(2), stride: 1, seen: 0 }
    }

    /// Adds an entry.
    pub fn push(&mut self, entry: T) {
        if self.seen.is_multiple_of(self.stride) {
            if self.entries.len() >= self.most {
                let mut at = 0;
                self.entries.retain(|_| {
                    at += 1;
                    at % 2 == 1
                });
                self.stride *= 2;
            }
            if self.seen.is_multiple_of(self.stride) {
                self.entries.push(entry);
            }
        }
        self.seen += 1;
    }

    /// What is kept, in order.
    pub fn entries(&self) -> &[T] {
        &self.entries
    }
}

impl<T: Serialize> Serialize for Series<T> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.entries.serialize(serializer)
    }
}

/// Entries of a history that is written out.
const MOST: usize = 4096;

/// Entries of the profile of task times.
const MOST_PROFILE: usize = 1 << 17;

/// One thread's account.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ThreadLog {
    /// Chunks computed.
    pub chunks: u64,
    /// Tasks computed.
    pub tasks: u64,
    /// Time of computing, s.
    pub busy_s: f64,
    /// Time without work, s.
    pub idle_s: f64,
    /// Time of side jobs (compression) for the collector, s.
    pub jobs_s: f64,
    /// Processor time of the thread, s, which other programs do not lengthen; all but idle time where the system does not
    /// tell.
    pub cpu_s: f64,
    /// From its beginning to its end, s.
    pub wall_s: f64,
}

impl ThreadLog {
    /// Both together.
    pub fn plus(self, other: ThreadLog) -> ThreadLog {
        ThreadLog {
            chunks: self.chunks + other.chunks,
            tasks: self.tasks + other.tasks,
            busy_s: self.busy_s + other.busy_s,
            idle_s: self.idle_s + other.idle_s,
            jobs_s: self.jobs_s + other.jobs_s,
            cpu_s: self.cpu_s + other.cpu_s,
            wall_s: self.wall_s + other.wall_s,
        }
    }
}

/// A size of dynamic chunks that was chosen after a significant idle time (the paper's figure 10).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SizeChange {
    /// Since the start, s.
    pub at_s: f64,
    /// Tasks handed out or computed before.
    pub tasks: u64,
    /// The idle time, ns.
    pub idle_ns: u64,
    /// The new size, tasks.
    pub size: u32,
    /// The step to it, tasks.
    pub step: u32,
    /// −1, 0 or +1.
    pub sign: i8,
}

/// How many chunks waited (warehouse) or were being computed (other schedules) when one was handed over.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Depth {
    /// Since the start, s.
    pub at_s: f64,
    /// Chunks.
    pub chunks: usize,
}

/// The end of a leg.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LegEnd {
    /// Since the start, s.
    pub at_s: f64,
    /// Tasks of this leg and all before it.
    pub tasks: u64,
    /// What the producer waited at the barrier, s; 0 without one.
    pub waited_s: f64,
}

/// Everything recorded of one or more runs in a row.
#[derive(Clone, Debug, Serialize)]
pub struct Log {
    /// Name of the schedule.
    pub schedule: &'static str,
    /// Threads that computed, the producer's included.
    pub threads: usize,
    /// Whether legs were kept apart.
    pub leg_barrier: bool,
    /// From start to end, s.
    pub seconds: f64,
    /// Tasks in all.
    pub tasks: u64,
    /// Chunks handed to workers.
    pub handed_over: u64,
    /// Chunks that the producer took back from the warehouse at the end of a leg.
    pub taken_back: u64,
    /// Times that the producer found all workers busy or the warehouse full.
    pub refusals: u64,
    /// The producer's thread: what it computed itself and what it waited. The rest of its time went into making chunks.
    pub producer: ThreadLog,
    /// When the producer's last chunk was out, s.
    pub producer_s: f64,
    /// The workers' threads.
    pub workers: Vec<ThreadLog>,
    /// The collector's thread: results taken, and the wait for them.
    pub collector: ThreadLog,
    /// How often the queue had 0, 1, 2, … chunks at a hand-over.
    pub depths: Vec<u64>,
    /// The same in the course of time.
    pub depth_history: Series<Depth>,
    /// Chunk sizes in the course of time, of dynamic chunks.
    pub sizes: Series<SizeChange>,
    /// Leg ends.
    pub legs: Vec<LegEnd>,
    /// Tasks and seconds of computing so far after each chunk; of runs with one thread, on request.
    #[serde(skip)]
    pub profile: Series<(u64, f64)>,
}

impl Log {
    /// Processor time of all threads together, s.
    pub fn cpu_s(&self) -> f64 {
        self.workers.iter().fold(self.producer.cpu_s + self.collector.cpu_s, |sum, worker| sum + worker.cpu_s)
    }
}

impl Default for Log {
    fn default() -> Log {
        Log {
            schedule: "",
            threads: 0,
            leg_barrier: false,
            seconds: 0.0,
            tasks: 0,
            handed_over: 0,
            taken_back: 0,
            refusals: 0,
            producer: ThreadLog::default(),
            producer_s: 0.0,
            workers: Vec::new(),
            collector: ThreadLog::default(),
            depths: Vec::new(),
            depth_history: Series::new(MOST),
            sizes: Series::new(MOST),
            legs: Vec::new(),
            profile: Series::new(MOST_PROFILE),
        }
    }
}

/// Takes the accounts of all threads.
#[derive(Debug)]
pub struct Recorder {
    origin: Instant,
    log: Mutex<Log>,
}

impl Default for Recorder {
    fn default() -> Recorder {
        Recorder::new()
    }
}

impl Recorder {
    /// Nothing recorded yet; times count from now.
    pub fn new() -> Recorder {
        Recorder { origin: Instant::now(), log: Mutex::new(Log::default()) }
    }

    /// What was recorded.
    pub fn finish(self) -> Log {
        self.log.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn with(&self, change: impl FnOnce(&mut Log)) {
        change(&mut self.log.lock().unwrap_or_else(PoisonError::into_inner));
    }

    pub(super) fn ended(&self, settings: &Schedule) {
        self.with(|log| {
            log.schedule = settings.policy.name();
            log.threads = settings.threads.max(1);
            log.leg_barrier = settings.leg_barrier;
            log.seconds = self.origin.elapsed().as_secs_f64();
            log.tasks = log.workers.iter().fold(log.producer.tasks, |sum, w| sum + w.tasks);
        });
    }
}

/// A thread's time, spent on one thing after the other; without a recorder it looks at no clock.
pub(super) struct Account<'r> {
    recorder: Option<&'r Recorder>,
    log: ThreadLog,
    since: Instant,
    opened: Instant,
    /// What the thread's processor clock said then.
    cpu_s: Option<f64>,
}

/// Processor time of this thread so far, s.
pub(super) fn thread_cpu_s() -> Option<f64> {
    #[cfg(target_os = "linux")]
    {
        let spent = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Some(spent.tv_sec as f64 + spent.tv_nsec as f64 * 1e-9)
    }
    #[cfg(not(target_os = "linux"))]
    None
}

impl<'r> Account<'r> {
    pub fn open(recorder: Option<&'r Recorder>) -> Account<'r> {
        let now = Instant::now();
        let cpu_s = recorder.and_then(|_| thread_cpu_s());
        Account { recorder, log: ThreadLog::default(), since: now, opened: now, cpu_s }
    }

    /// The whole account, on the thread that it belongs to.
    fn closed(&self) -> ThreadLog {
        let wall_s = self.opened.elapsed().as_secs_f64();
        let cpu_s = match (self.cpu_s, thread_cpu_s()) {
            (Some(from), Some(to)) => to - from,
            _ => (wall_s - self.log.idle_s).max(0.0),
        };
        ThreadLog { cpu_s, wall_s, ..self.log }
    }

    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let spent = now.duration_since(self.since).as_secs_f64();
        self.since = now;
        spent
    }

    /// What follows is booked anew; what was before is booked nowhere.
    pub fn skip(&mut self) {
        if self.recorder.is_some() {
            self.lap();
        }
    }

    pub fn was_idle(&mut self) {
        if self.recorder.is_some() {
            self.log.idle_s += self.lap();
        }
    }

    pub fn did_job(&mut self) {
        if self.recorder.is_some() {
            self.log.jobs_s += self.lap();
        }
    }

    pub fn computed(&mut self, tasks: u32) {
        if self.recorder.is_some() {
            self.log.busy_s += self.lap();
            self.log.chunks += 1;
            self.log.tasks += u64::from(tasks);
        }
    }

    /// The collector's account.
    pub fn hand_in_as_collector(self) {
        if let Some(recorder) = self.recorder {
            let closed = self.closed();
            recorder.with(|log| log.collector = log.collector.plus(closed));
        }
    }

    /// A worker's account.
    pub fn hand_in(mut self) {
        self.was_idle();
        if let Some(recorder) = self.recorder {
            let closed = self.closed();
            recorder.with(|log| log.workers.push(closed));
        }
    }
}

/// The producer's records.
pub(super) struct Ledger<'r> {
    pub account: Account<'r>,
    page: Option<Box<Log>>,
    passed: u64,
}

impl<'r> Ledger<'r> {
    pub fn open(recorder: Option<&'r Recorder>) -> Ledger<'r> {
        // A second run goes on where the one before ended.
        let page = recorder.map(|r| {
            let mut page = Log::default();
            r.with(|log| page = std::mem::take(log));
            Box::new(page)
        });
        let passed = page.as_deref().map_or(0, |log: &Log| log.tasks);
        Ledger { account: Account::open(recorder), page, passed }
    }

    fn now(&self) -> f64 {
        self.account.recorder.map_or(0.0, |r| r.origin.elapsed().as_secs_f64())
    }

    /// A chunk comes in.
    pub fn came_in(&mut self, tasks: u32) {
        self.passed += u64::from(tasks);
    }

    /// A chunk from the warehouse is computed by the producer after all.
    pub fn took_back(&mut self) {
        if let Some(log) = &mut self.page {
            log.taken_back += 1;
        }
    }

    pub fn handed_over(&mut self, depth: usize) {
        let at_s = self.now();
        if let Some(log) = &mut self.page {
            log.handed_over += 1;
            if log.depths.len() <= depth {
                log.depths.resize(depth + 1, 0);
            }
            log.depths[depth] += 1;
            log.depth_history.push(Depth { at_s, chunks: depth });
        }
    }

    pub fn refused(&mut self) {
        if let Some(log) = &mut self.page {
            log.refusals += 1;
        }
    }

    pub fn computed(&mut self, tasks: u32, alone: bool) {
        self.account.computed(tasks);
        if let Some(log) = &mut self.page
            && alone
        {
            log.profile.push((self.passed, log.producer.busy_s + self.account.log.busy_s));
        }
    }

    pub fn resized(&mut self, idle: Option<u64>, dropper: &Dropper) {
        let (at_s, tasks) = (self.now(), self.passed);
        if let (Some(log), Some(idle_ns)) = (&mut self.page, idle) {
            let sign = dropper.direction().sign();
            log.sizes.push(SizeChange {
                at_s,
                tasks,
                idle_ns,
                size: dropper.size(),
                step: dropper.step(),
                sign,
            });
        }
    }

    pub fn leg_ended(&mut self, waited: Duration) {
        let (at_s, tasks) = (self.now(), self.passed);
        if let Some(log) = &mut self.page {
            log.legs.push(LegEnd { at_s, tasks, waited_s: waited.as_secs_f64() });
        }
    }

    pub fn hand_in(&mut self) {
        let now = self.now();
        if let (Some(recorder), Some(mut page)) = (self.account.recorder, self.page.take()) {
            page.producer = page.producer.plus(self.account.closed());
            page.producer_s = now;
            recorder.with(|log| {
                // Workers may have handed in theirs already.
                page.workers.append(&mut log.workers);
                page.collector = page.collector.plus(log.collector);
                *log = *page;
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_history_keeps_its_length_and_its_spacing() {
        let mut series = Series::new(8);
        for i in 0..1000 {
            series.push(i);
            assert!(series.entries().len() <= 8);
        }
        let kept = series.entries();
        assert!(kept.len() >= 4 && kept[0] == 0, "{kept:?}");
        let step = kept[1];
        assert!(kept.windows(2).all(|w| w[1] - w[0] == step), "{kept:?}");
    }
}
