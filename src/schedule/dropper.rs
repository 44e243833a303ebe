//! The size of dynamic chunks (spec kdtree-and-scheduling §3.4, eqs 13–15).

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// First step of a series in one direction, Δ0, in tasks.
const FIRST_STEP: u32 = 8;

/// By how much a step outgrows the one before, Δ2, in tasks.
const INCREMENT: u32 = 1;

/// Largest chunk: descriptors stay small, but their results do not.
const LARGEST: u32 = 1 << 24;

/// Which way sizes go.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    /// Nowhere yet.
    #[default]
    Unknown,
    /// Larger chunks.
    Up,
    /// Smaller chunks.
    Down,
}

impl Direction {
    /// −1, 0 or +1: the sign s of the paper.
    pub fn sign(self) -> i8 {
        match self {
            Direction::Unknown => 0,
            Direction::Up => 1,
            Direction::Down => -1,
        }
    }

    /// The other way; from nowhere it goes up.
    fn turned(self) -> Direction {
        match self {
            Direction::Up => Direction::Down,
            Direction::Unknown | Direction::Down => Direction::Up,
        }
    }
}

/// Drops tasks in chunks whose size climbs towards shorter idle times of the workers: as long as they do not grow, each
/// step goes further in the same direction; when they grow, the direction turns and steps are small again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dropper {
    size: u32,
    step: u32,
    direction: Direction,
    last_idle_ns: u64,
    significant_ns: u64,
}

impl Dropper {
    /// Begins with chunks of `size` tasks; idle times below `significant_ns`, and changes up to that, mean nothing (τ and
    /// ε).
    pub fn new(size: u32, significant_ns: u64) -> Dropper {
        Dropper {
            size: size.clamp(1, LARGEST),
            step: FIRST_STEP,
            direction: Direction::Unknown,
            last_idle_ns: 0,
            significant_ns,
        }
    }

    /// Tasks of the chunk in the making, m.
    pub fn size(&self) -> u32 {
        self.size
    }

    /// The last step, Δ1, in tasks.
    pub fn step(&self) -> u32 {
        self.step
    }

    /// Which way the last step went.
    pub fn direction(&self) -> Direction {
        self.direction
    }

    /// A chunk was handed over. `idle_ns` is the time from the first idle worker to renewed saturation, if one was
    /// measured since the last hand-over. Returns whether the measurement meant something.
    pub fn hand_over(&mut self, idle_ns: Option<u64>) -> bool {
        let Some(idle) = idle_ns else { return false };
        let significant = idle >= self.significant_ns;
        if significant {
            let changed = idle.abs_diff(self.last_idle_ns) > self.significant_ns;
            let direction = match (changed, self.direction) {
                (true, Direction::Unknown) => Direction::Up,
                (true, direction) if idle > self.last_idle_ns => direction.turned(),
                (_, direction) => direction,
            };
            self.go(direction);
        }
        self.last_idle_ns = idle;
        significant
    }

    fn go(&mut self, direction: Direction) {
        let step = match self.direction {
            Direction::Unknown => self.step,
            same if same == direction => self.step.saturating_add(INCREMENT),
            _ => FIRST_STEP,
        };
        self.size = match direction {
            Direction::Unknown => self.size,
            Direction::Up => self.size.saturating_add(step).min(LARGEST),
            Direction::Down => self.size.saturating_sub(step).max(1),
        };
        (self.step, self.direction) = (step, direction);
    }
}

/// When the first worker became idle, for dynamic chunks; 0 while no measurement is running.
pub(super) struct IdleClock {
    origin: Instant,
    since: AtomicU64,
}

impl IdleClock {
    /// Nothing measured yet.
    pub fn new() -> IdleClock {
        IdleClock { origin: Instant::now(), since: AtomicU64::new(0) }
    }

    fn now(&self) -> u64 {
        // Zero is taken; a nanosecond does no harm.
        self.origin.elapsed().as_nanos().max(1) as u64
    }

    /// A worker has become idle.
    pub fn worker_ends(&self) {
        if self.since.load(Ordering::Relaxed) == 0 {
            let _ = self.since.compare_exchange(0, self.now(), Ordering::Relaxed, Ordering::Relaxed);
        }
    }

    /// Ends the measurement: the time since the first worker became idle, if one did.
    pub fn saturated(&self) -> Option<u64> {
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
        let mut dropper = Dropper::new(32, 100_000);
        for (idle_us, size, step, sign) in trace {
            dropper.hand_over(idle_us.map(|us: u64| us * 1000));
            let found = (dropper.size(), dropper.step(), dropper.direction().sign());
            assert_eq!(found, (size, step, sign), "after {idle_us:?}");
        }
    }

    #[test]
    fn a_first_idle_time_within_the_tolerance_changes_nothing() {
        let mut dropper = Dropper::new(32, 100_000);
        assert!(dropper.hand_over(Some(100_000)));
        assert_eq!((dropper.size(), dropper.direction()), (32, Direction::Unknown));
    }

    #[test]
    fn sizes_stay_within_their_bounds() {
        for idle in [[100, 100_000_000], [100_000_000, 100_000_000]] {
            for start in [0, 1, 32, u32::MAX] {
                let mut dropper = Dropper::new(start, 1000);
                for i in 0..10_000 {
                    dropper.hand_over(Some(idle[i % 2] * 1000 + 10_000));
                    assert!((1..=LARGEST).contains(&dropper.size()));
                }
            }
        }
    }

    proptest! {
        #[test]
        fn no_step_is_longer_than_the_series_before_it_allows(idle in prop::collection::vec(0..2_000_000u64, 1..200)) {
            let mut dropper = Dropper::new(32, 100_000);
            for ns in idle {
                let before = dropper;
                dropper.hand_over(Some(ns));
                prop_assert!(dropper.size().abs_diff(before.size()) <= before.step().max(FIRST_STEP) + INCREMENT);
                prop_assert!(dropper.size() >= 1);
            }
        }
    }
}
