//! The size of dynamic chunks (spec kdtree-and-scheduling §3.4, eqs 13–15).

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// First step of a series in one direction, Δ0, in tasks.
const FIRST_STEP: u32 = 8;

/// Increment from one step to the next, Δ2, in tasks.
const INCREMENT: u32 = 1;

/// Maximum size of a chunk, in tasks: descriptors are always small, but results are not.
const MAX_SIZE: u32 = 1 << 24;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Direction {
    /// No size has been changed yet.
    Unknown,
    /// Larger chunks.
    Up,
    /// Smaller chunks.
    Down,
}

/// Adapts the size of chunks so that the idle times of the workers become shorter: as long as they do not
/// grow, each step is larger than the last in the same direction; when they grow, the direction is reversed
/// and steps are small again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChunkSizer {
    size: u32,
    step: u32,
    direction: Direction,
    last_idle_ns: u64,
    significant_ns: u64,
}

impl ChunkSizer {
    /// Begins with chunks of `size` tasks. Idle times below `significant_ns`, and changes up to that, are
    /// ignored (τ and ε).
    pub fn new(size: u32, significant_ns: u64) -> ChunkSizer {
        ChunkSizer {
            size: size.clamp(1, MAX_SIZE),
            step: FIRST_STEP,
            direction: Direction::Unknown,
            last_idle_ns: 0,
            significant_ns,
        }
    }

    /// Size of the chunk under construction, m, in tasks.
    pub fn size(&self) -> u32 {
        self.size
    }

    /// The last step, Δ, in tasks.
    pub fn step(&self) -> u32 {
        self.step
    }

    /// The direction of the last step: −1, 0 or +1, the sign s of the paper.
    pub fn sign(&self) -> i8 {
        match self.direction {
            Direction::Unknown => 0,
            Direction::Up => 1,
            Direction::Down => -1,
        }
    }

    /// Chooses the next size after a chunk was handed over. `idle_ns` is the time from the first idle worker
    /// to renewed saturation, if measured since the last hand-over. Returns whether it was significant.
    pub fn resize(&mut self, idle_ns: Option<u64>) -> bool {
        let Some(idle) = idle_ns else { return false };
        let significant = idle >= self.significant_ns;
        if significant {
            let changed = idle.abs_diff(self.last_idle_ns) > self.significant_ns;
            let direction = match (changed, self.direction) {
                (true, Direction::Unknown) => Direction::Up,
                (true, Direction::Up) if idle > self.last_idle_ns => Direction::Down,
                (true, Direction::Down) if idle > self.last_idle_ns => Direction::Up,
                (_, direction) => direction,
            };
            self.step_towards(direction);
        }
        self.last_idle_ns = idle;
        significant
    }

    fn step_towards(&mut self, direction: Direction) {
        let step = match self.direction {
            Direction::Unknown => self.step,
            same if same == direction => self.step.saturating_add(INCREMENT),
            _ => FIRST_STEP,
        };
        self.size = match direction {
            Direction::Unknown => self.size,
            Direction::Up => self.size.saturating_add(step).min(MAX_SIZE),
            Direction::Down => self.size.saturating_sub(step).max(1),
        };
        (self.step, self.direction) = (step, direction);
    }
}

/// Measures the time since the first worker became idle, for dynamic chunks.
pub(super) struct IdleClock {
    origin: Instant,
    /// Start of the measurement, ns since `origin`; 0 while no measurement is running.
    since: AtomicU64,
}

impl IdleClock {
    pub fn new() -> IdleClock {
        IdleClock { origin: Instant::now(), since: AtomicU64::new(0) }
    }

    fn now(&self) -> u64 {
        // 0 means that no measurement is running.
        self.origin.elapsed().as_nanos().max(1) as u64
    }

    /// Starts a measurement, unless one is running, when a worker has become idle.
    pub fn start(&self) {
        if self.since.load(Ordering::Relaxed) == 0 {
            let _ = self.since.compare_exchange(0, self.now(), Ordering::Relaxed, Ordering::Relaxed);
        }
    }

    /// Ends the measurement. Returns its duration in ns, if one was running.
    pub fn stop(&self) -> Option<u64> {
        match self.since.swap(0, Ordering::Relaxed) {
            0 => None,
            since => Some(self.now().saturating_sub(since)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The worked trace of spec §3.4: idle time in µs, then size, step and sign after the hand-over.
    #[test]
    fn sizes_follow_the_worked_trace() {
        let trace = [
            (None, 32, 8, 0),
            (Some(50), 32, 8, 0),
            (Some(300), 40, 8, 1),
            (Some(350), 49, 9, 1),
            (Some(600), 41, 8, -1),
            (Some(200), 32, 9, -1),
            (Some(150), 22, 10, -1),
            (Some(900), 30, 8, 1),
            (Some(900), 39, 9, 1),
            (Some(80), 39, 9, 1),
        ];
        let mut sizer = ChunkSizer::new(32, 100_000);
        for (idle_us, size, step, sign) in trace {
            sizer.resize(idle_us.map(|us: u64| us * 1000));
            let found = (sizer.size(), sizer.step(), sizer.sign());
            assert_eq!(found, (size, step, sign), "after {idle_us:?}");
        }
    }

    #[test]
    fn a_first_idle_time_within_the_tolerance_changes_nothing() {
        let mut sizer = ChunkSizer::new(32, 100_000);
        assert!(sizer.resize(Some(100_000)));
        assert_eq!((sizer.size(), sizer.sign()), (32, 0));
    }

    #[test]
    fn sizes_stay_within_their_bounds() {
        for idle in [[100, 100_000_000], [100_000_000, 100_000_000]] {
            for start in [0, 1, 32, u32::MAX] {
                let mut sizer = ChunkSizer::new(start, 1000);
                for i in 0..10_000 {
                    sizer.resize(Some(idle[i % 2] * 1000 + 10_000));
                    assert!((1..=MAX_SIZE).contains(&sizer.size()));
                }
            }
        }
    }

    proptest! {
        #[test]
        fn no_step_is_longer_than_the_series_before_it_allows(idle in prop::collection::vec(0..2_000_000u64, 1..200)) {
            let mut sizer = ChunkSizer::new(32, 100_000);
            for ns in idle {
                let before = sizer;
                sizer.resize(Some(ns));
                prop_assert!(sizer.size().abs_diff(before.size()) <= before.step().max(FIRST_STEP) + INCREMENT);
                prop_assert!(sizer.size() >= 1);
            }
        }
    }
}
