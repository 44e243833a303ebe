//! Records of a schedule's activity: idle times, queue depths, chunk sizes. Every thread measures its own
//! time and adds it to the log when it ends, so that recording costs two readings of the clock per chunk, and
//! two of each thread's processor clock in total.

use super::policy::Schedule;
use super::sizing::ChunkSizer;
use serde::Serialize;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A history of bounded length: when it is full, every other entry is removed, and from then on only every
/// second, fourth, … new entry is kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Series<T> {
    entries: Vec<T>,
    max: usize,
    stride: u64,
    seen: u64,
}

impl<T> Series<T> {
    /// Creates an empty history of at most `max` entries.
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

    /// The kept entries, in order.
    pub fn entries(&self) -> &[T] {
        &self.entries
    }
}

impl<T: Serialize> Serialize for Series<T> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.entries.serialize(serializer)
    }
}

/// Maximum entries of a history in the log.
pub const MAX_HISTORY: usize = 4096;

/// Maximum entries of the profile of task times.
const MAX_PROFILE: usize = 1 << 17;

/// Activity of one thread, or of several together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ThreadLog {
    /// Number of chunks computed or collected.
    pub chunks: u64,
    /// Number of tasks in these chunks.
    pub tasks: u64,
    /// Time spent computing, s.
    pub busy_s: f64,
    /// Time without work, s.
    pub idle_s: f64,
    /// Time of side jobs (compressing, writing) for the collector, s.
    pub jobs_s: f64,
    /// Processor time of the thread, s, which other programs do not lengthen; on systems without such a
    /// clock, the wall time less the idle time.
    pub cpu_s: f64,
    /// Time from start to end of the thread, s.
    pub wall_s: f64,
}

impl ThreadLog {
    /// The activity of both together.
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

/// A size of dynamic chunks, chosen after a significant idle time (the paper's figure 10).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SizeChange {
    /// Time since the start, s.
    pub at_s: f64,
    /// Tasks handed over or computed before.
    pub tasks: u64,
    /// Time from the first idle worker until all workers were busy again, ns.
    pub idle_ns: u64,
    /// The size chosen, tasks per chunk.
    pub size: u32,
    /// Step to this size, tasks.
    pub step: u32,
    /// Sign of the step: −1, 0 or +1.
    pub sign: i8,
}

/// Number of chunks that were queued (warehouse) or being computed (other schedules) at a hand-over.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Depth {
    /// Time since the start, s.
    pub at_s: f64,
    /// Number of chunks.
    pub chunks: usize,
}

/// The end of a leg.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LegEnd {
    /// Time since the start, s.
    pub at_s: f64,
    /// Tasks of this leg and all legs before it.
    pub tasks: u64,
    /// Time that the producer waited at the barrier, s; 0 without a barrier.
    pub waited_s: f64,
}

/// Log of one or more consecutive runs.
#[derive(Clone, Debug, Serialize)]
pub struct Log {
    /// Name of the scheduling policy.
    pub schedule: &'static str,
    /// Computing threads including the producer's.
    pub threads: usize,
    /// True if there was a barrier between legs.
    pub leg_barrier: bool,
    /// Time from start to end, s.
    pub seconds: f64,
    /// Of these, the time of completing the outputs after the last result: headers, and waiting for the disk.
    pub completing_s: f64,
    /// Number of tasks computed, by the producer and all workers.
    pub tasks: u64,
    /// Number of chunks that the producer handed over: to the warehouse, or to a worker.
    pub handed_over: u64,
    /// Number of chunks that the producer took back from the warehouse and computed.
    pub taken_back: u64,
    /// Number of times that the producer found all workers busy or the warehouse full.
    pub refusals: u64,
    /// The producer's thread: computing and waiting. The rest of its time was spent on making chunks.
    pub producer: ThreadLog,
    /// Wall time of the producer, s.
    pub producer_s: f64,
    /// The threads of the workers.
    pub workers: Vec<ThreadLog>,
    /// The collector's thread: taking results, and waiting for them.
    pub collector: ThreadLog,
    /// Histogram of the queue depth at hand-overs: 0, 1, 2, … chunks.
    pub depths: Vec<u64>,
    /// History of the queue depth.
    pub depth_history: Series<Depth>,
    /// History of the size of dynamic chunks.
    pub sizes: Series<SizeChange>,
    /// The ends of the legs, in order.
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
            completing_s: 0.0,
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

/// Collects the activity of all threads of one or more runs.
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
    /// Creates an empty recorder; times count from now.
    pub fn new() -> Recorder {
        Recorder { origin: Instant::now(), log: Mutex::new(Log::default()) }
    }

    /// Returns the log.
    pub fn finish(self) -> Log {
        self.log.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn with<T>(&self, change: impl FnOnce(&mut Log) -> T) -> T {
        change(&mut self.log.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Adds the time since `began`, in which the collector completed the outputs.
    pub(super) fn add_completing(&self, began: Instant) {
        self.with(|log| log.completing_s += began.elapsed().as_secs_f64());
    }

    fn seconds(&self) -> f64 {
        self.origin.elapsed().as_secs_f64()
    }

    /// Ends a run, all threads of which have ended.
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

/// Processor time of this thread so far, s; `None` where the system has no such clock.
pub fn thread_cpu_s() -> Option<f64> {
    #[cfg(target_os = "linux")]
    {
        let spent = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Some(spent.tv_sec as f64 + spent.tv_nsec as f64 * 1e-9)
    }
    #[cfg(not(target_os = "linux"))]
    None
}

/// Divides a thread's time into laps of one kind each. Reads no clock without a recorder.
pub(super) struct ThreadTimer<'r> {
    recorder: Option<&'r Recorder>,
    log: ThreadLog,
    lap_start: Instant,
    started: Instant,
    /// The thread's processor time at its start, s.
    started_cpu_s: Option<f64>,
}

impl<'r> ThreadTimer<'r> {
    /// Starts the first lap, on the thread that is measured.
    pub fn start(recorder: Option<&'r Recorder>) -> ThreadTimer<'r> {
        let now = Instant::now();
        let started_cpu_s = recorder.and_then(|_| thread_cpu_s());
        ThreadTimer { recorder, log: ThreadLog::default(), lap_start: now, started: now, started_cpu_s }
    }

    /// Ends the lap and passes its seconds to `add`.
    fn end_lap(&mut self, add: impl FnOnce(&mut ThreadLog, f64)) {
        if self.recorder.is_some() {
            let now = Instant::now();
            add(&mut self.log, now.duration_since(self.lap_start).as_secs_f64());
            self.lap_start = now;
        }
    }

    /// Ends a lap without a kind.
    pub fn discard_lap(&mut self) {
        self.end_lap(|_, _| ());
    }

    pub fn add_idle(&mut self) {
        self.end_lap(|log, seconds| log.idle_s += seconds);
    }

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

    /// Adds the thread's total time to the log. Must be called on the measured thread.
    fn finish(&self, add: impl FnOnce(&mut Log, ThreadLog)) {
        let Some(recorder) = self.recorder else { return };
        let wall_s = self.started.elapsed().as_secs_f64();
        let cpu_s = match (self.started_cpu_s, thread_cpu_s()) {
            (Some(from), Some(to)) => to - from,
            _ => (wall_s - self.log.idle_s).max(0.0),
        };
        recorder.with(|log| add(log, ThreadLog { cpu_s, wall_s, ..self.log }));
    }

    pub fn finish_collector(self) {
        self.finish(|log, time| log.collector = log.collector.plus(time));
    }

    pub fn finish_worker(mut self) {
        self.add_idle();
        self.finish(|log, time| log.workers.push(time));
    }
}

/// The producer's records. A second run continues where the one before ended.
pub(super) struct ProducerRecord<'r> {
    pub timer: ThreadTimer<'r>,
    /// Tasks of all chunks so far.
    tasks: u64,
}

impl<'r> ProducerRecord<'r> {
    pub fn new(recorder: Option<&'r Recorder>) -> ProducerRecord<'r> {
        let tasks = recorder.map_or(0, |recorder| recorder.with(|log| log.tasks));
        ProducerRecord { timer: ThreadTimer::start(recorder), tasks }
    }

    /// Changes the log, if there is one. `change` also takes the seconds since the start.
    fn with(&self, change: impl FnOnce(&mut Log, f64)) {
        if let Some(recorder) = self.timer.recorder {
            let at_s = recorder.seconds();
            recorder.with(|log| change(log, at_s));
        }
    }

    pub fn add_tasks(&mut self, tasks: u32) {
        self.tasks += u64::from(tasks);
    }

    /// Records that the producer computes a chunk from the warehouse.
    pub fn add_taken_back(&self) {
        self.with(|log, _| log.taken_back += 1);
    }

    /// Records a hand-over to the workers, of which `depth` chunks are queued or being computed.
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

    /// Records that all workers are busy or the warehouse is full.
    pub fn add_refusal(&self) {
        self.with(|log, _| log.refusals += 1);
    }

    /// Records a chunk computed by the producer. With `is_alone`, no other thread computes, and the time of
    /// every chunk is recorded.
    pub fn add_chunk(&mut self, tasks: u32, is_alone: bool) {
        self.timer.add_chunk(tasks);
        if is_alone {
            let entry = |log: &Log| (self.tasks, log.producer.busy_s + self.timer.log.busy_s);
            self.with(|log, _| log.profile.push(entry(log)));
        }
    }

    /// Records a new chunk size, chosen after the workers were idle for `idle_ns`.
    pub fn add_resize(&self, idle_ns: Option<u64>, sizer: &ChunkSizer) {
        let (tasks, size, step, sign) = (self.tasks, sizer.size(), sizer.step(), sizer.sign());
        if let Some(idle_ns) = idle_ns {
            self.with(|log, at_s| log.sizes.push(SizeChange { at_s, tasks, idle_ns, size, step, sign }));
        }
    }

    pub fn add_leg_end(&self, waited: Duration) {
        let (tasks, waited_s) = (self.tasks, waited.as_secs_f64());
        self.with(|log, at_s| log.legs.push(LegEnd { at_s, tasks, waited_s }));
    }

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
