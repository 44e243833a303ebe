//! Spinning for a moment before a thread goes to sleep.

use std::time::{Duration, Instant};

/// Maximum spinning time: several times the wake-up time of a thread on a sleeping core of a virtual machine,
/// so that of two threads that wait for each other neither falls asleep while the other wakes up.
const MAX_SPIN: Duration = Duration::from_micros(100);

/// Polls `is_ready` until it holds, for at most [`MAX_SPIN`]. Other threads that wait for the core run first.
///
/// A receiver of events every few microseconds stays awake; a receiver of rarer events sleeps.
pub fn spin_until(mut is_ready: impl FnMut() -> bool) {
    let mut started = None;
    while !is_ready() {
        if started.get_or_insert_with(Instant::now).elapsed() >= MAX_SPIN {
            return;
        }
        std::thread::yield_now();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spinning_ends_when_there_is_something_or_after_a_while() {
        let (started, mut checks) = (Instant::now(), 0);
        spin_until(|| {
            checks += 1;
            false
        });
        assert!(checks > 1 && started.elapsed() >= MAX_SPIN);
        checks = 0;
        spin_until(|| {
            checks += 1;
            checks == 2
        });
        assert_eq!(checks, 2);
    }
}
