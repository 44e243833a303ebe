//! What a schedule did: idle times, queue depths, chunk sizes. Every thread measures its own time and adds it to the log at
//! its end, so that recording costs two readings of the clock per chunk, and two of each thread's processor clock in all.

use super::policy::Schedule;
use super::sizing::ChunkSizer;
use serde::Serialize;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A history of bounded length: when it is full every other entry is removed, and of what follows only every second,
/// fourth, … is kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Series<T> {
    entries: Vec<T>,
    max: usize,
    stride: u64,
    seen: u64,
}

impl<T> Series<T> {
    /// An empty history of at most `max` entries.
    pub fn new(max: usize) -> Series<T> {
        Series { entries: Vec::new(), max: max.max(2), stride: 1, seen: 0 }
    }

    /// Adds an entry.
    pub fn push(&mut self, entry: T) {
        if self.seen.is_multiple_of(self.stride) {
            if self.entries.len() >= self.max {
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

/// Entries of a history in the log.
pub(super) const MAX_HISTORY: usize = 4096;

/// Entries of the profile of task times.
const MAX_PROFILE: usize = 1 << 17;

/// What one thread did, or several together.
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
    /// Processor time of the thread, s, which other programs do not lengthen; where the system has no such clock, all but
    /// the idle time.
    pub cpu_s: f64,
    /// From the start to the end of the thread, s.
    pub wall_s: f64,
}

impl ThreadLog {
    /// The sum of two logs.
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

/// Number of chunks that waited (warehouse) or were being computed (other schedules) when one was handed over.
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
    /// Time that the producer waited at the barrier, s; 0 without one.
    pub waited_s: f64,
}

/// Everything recorded of one or more runs in a row.
#[derive(Clone, Debug, Serialize)]
pub struct Log {
    /// Name of the schedule.
    pub schedule: &'static str,
    /// Threads that computed, the producer's included.
    pub threads: usize,
    /// Whether legs waited for one another.
    pub leg_barrier: bool,
    /// From start to end, s.
    pub seconds: f64,
    /// Tasks in all.
    pub tasks: u64,
    /// Chunks handed to workers.
    pub handed_over: u64,
    /// Chunks that the producer took back from the warehouse.
    pub taken_back: u64,
    /// Times that the producer found all workers busy or the warehouse full.
    pub refusals: u64,
    /// The producer's thread: computing and waiting. The rest of its time went into making chunks.
    pub producer: ThreadLog,
    /// Time of the producer's end, s.
    pub producer_s: f64,
    /// The workers' threads.
    pub workers: Vec<ThreadLog>,
    /// The collector's thread: results taken, and the wait for them.
    pub collector: ThreadLog,
    /// How often the queue had 0, 1, 2, … chunks at a hand-over.
    pub depths: Vec<u64>,
    /// These depths in the course of time.
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
            depth_history: Series::new(MAX_HISTORY),
            sizes: Series::new(MAX_HISTORY),
            legs: Vec::new(),
            profile: Series::new(MAX_PROFILE),
        }
    }
}

/// Gathers what all threads of one or more runs did.
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

    fn with<T>(&self, change: impl FnOnce(&mut Log) -> T) -> T {
        change(&mut self.log.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn seconds(&self) -> f64 {
        self.origin.elapsed().as_secs_f64()
    }

    /// Ends a run, of which all threads have ended.
    pub(super) fn end_run(&self, schedule: &Schedule) {
        self.with(|log| {
            log.schedule = schedule.policy.name();
            log.threads = schedule.threads.max(1);
            log.leg_barrier = schedule.leg_barrier;
            log.seconds = self.seconds();
            log.tasks = log.workers.iter().fold(log.producer.tasks, |sum, w| sum + w.tasks);
        });
    }
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

/// Divides a thread's time into laps of one kind each. Without a recorder it reads no clock.
pub(super) struct ThreadTimer<'r> {
    recorder: Option<&'r Recorder>,
    log: ThreadLog,
    lap_start: Instant,
    started: Instant,
    /// The thread's processor time at its start.
    started_cpu_s: Option<f64>,
}

impl<'r> ThreadTimer<'r> {
    /// Starts the first lap, on the thread that is measured.
    pub fn start(recorder: Option<&'r Recorder>) -> ThreadTimer<'r> {
        let now = Instant::now();
        let started_cpu_s = recorder.and_then(|_| thread_cpu_s());
        ThreadTimer { recorder, log: ThreadLog::default(), lap_start: now, started: now, started_cpu_s }
    }

    /// Ends the lap; `add` books its seconds.
    fn end_lap(&mut self, add: impl FnOnce(&mut ThreadLog, f64)) {
        if self.recorder.is_some() {
            let now = Instant::now();
            add(&mut self.log, now.duration_since(self.lap_start).as_secs_f64());
            self.lap_start = now;
        }
    }

    /// Ends a lap that belongs to none of the kinds.
    pub fn discard_lap(&mut self) {
        self.end_lap(|_, _| ());
    }

    /// Ends a lap without work.
    pub fn add_idle(&mut self) {
        self.end_lap(|log, seconds| log.idle_s += seconds);
    }

    /// Ends a lap with a side job.
    pub fn add_job(&mut self) {
        self.end_lap(|log, seconds| log.jobs_s += seconds);
    }

    /// Ends a lap in which a chunk of `tasks` was computed.
    pub fn add_chunk(&mut self, tasks: u32) {
        self.end_lap(|log, seconds| {
            log.busy_s += seconds;
            log.chunks += 1;
            log.tasks += u64::from(tasks);
        });
    }

    /// Adds the whole time, on the thread that was measured, to the log.
    fn finish(&self, add: impl FnOnce(&mut Log, ThreadLog)) {
        let Some(recorder) = self.recorder else { return };
        let wall_s = self.started.elapsed().as_secs_f64();
        let cpu_s = match (self.started_cpu_s, thread_cpu_s()) {
            (Some(from), Some(to)) => to - from,
            _ => (wall_s - self.log.idle_s).max(0.0),
        };
        recorder.with(|log| add(log, ThreadLog { cpu_s, wall_s, ..self.log }));
    }

    /// Ends the collector's time.
    pub fn finish_collector(self) {
        self.finish(|log, time| log.collector = log.collector.plus(time));
    }

    /// Ends a worker's time.
    pub fn finish_worker(mut self) {
        self.add_idle();
        self.finish(|log, time| log.workers.push(time));
    }
}

/// What the producer records. A second run goes on where the one before ended.
pub(super) struct ProducerRecord<'r> {
    pub timer: ThreadTimer<'r>,
    /// Tasks of all chunks until now.
    tasks: u64,
}

impl<'r> ProducerRecord<'r> {
    pub fn new(recorder: Option<&'r Recorder>) -> ProducerRecord<'r> {
        let tasks = recorder.map_or(0, |recorder| recorder.with(|log| log.tasks));
        ProducerRecord { timer: ThreadTimer::start(recorder), tasks }
    }

    /// Changes the log, if there is one. `change` is given the seconds since the start, too.
    fn with(&self, change: impl FnOnce(&mut Log, f64)) {
        if let Some(recorder) = self.timer.recorder {
            let at_s = recorder.seconds();
            recorder.with(|log| change(log, at_s));
        }
    }

    /// Counts the tasks of a new chunk.
    pub fn add_tasks(&mut self, tasks: u32) {
        self.tasks += u64::from(tasks);
    }

    /// A chunk from the warehouse is computed by the producer after all.
    pub fn add_taken_back(&self) {
        self.with(|log, _| log.taken_back += 1);
    }

    /// A chunk goes to the workers, of which `depth` chunks wait or are being computed.
    pub fn add_handover(&self, depth: usize) {
        self.with(|log, at_s| {
            log.handed_over += 1;
            if log.depths.len() <= depth {
                log.depths.resize(depth + 1, 0);
            }
            log.depths[depth] += 1;
            log.depth_history.push(Depth { at_s, chunks: depth });
        });
    }

    /// All workers are busy or the warehouse is full.
    pub fn add_refusal(&self) {
        self.with(|log, _| log.refusals += 1);
    }

    /// The producer has computed a chunk. The time of every chunk is recorded where no other thread computes.
    pub fn add_chunk(&mut self, tasks: u32, is_alone: bool) {
        self.timer.add_chunk(tasks);
        if is_alone {
            let entry = |log: &Log| (self.tasks, log.producer.busy_s + self.timer.log.busy_s);
            self.with(|log, _| log.profile.push(entry(log)));
        }
    }

    /// The size of chunks has been chosen again after the workers were idle for `idle_ns`.
    pub fn add_resize(&self, idle_ns: Option<u64>, sizer: &ChunkSizer) {
        let (tasks, size, step, sign) = (self.tasks, sizer.size(), sizer.step(), sizer.sign());
        if let Some(idle_ns) = idle_ns {
            self.with(|log, at_s| log.sizes.push(SizeChange { at_s, tasks, idle_ns, size, step, sign }));
        }
    }

    /// A leg has ended.
    pub fn add_leg_end(&self, waited: Duration) {
        let (tasks, waited_s) = (self.tasks, waited.as_secs_f64());
        self.with(|log, at_s| log.legs.push(LegEnd { at_s, tasks, waited_s }));
    }

    /// Ends the producer's time.
    pub fn finish(&self) {
        self.with(|log, at_s| log.producer_s = at_s);
        self.timer.finish(|log, time| log.producer = log.producer.plus(time));
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
