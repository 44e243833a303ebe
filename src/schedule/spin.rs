//! Spinning for a moment before a thread goes to sleep.

use std::time::{Duration, Instant};

/// How long a waiting thread spins: some times what it takes to wake a thread on a sleeping core of a virtual machine, so
/// that of two threads that wait for each other neither falls asleep while the other wakes up.
const MAX_SPIN: Duration = Duration::from_micros(100);

/// Checks `is_ready` again and again until it holds, at most for [`MAX_SPIN`]. Other threads that want the core go first.
///
/// What arrives every few microseconds finds its taker awake; what arrives later finds it asleep.
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
