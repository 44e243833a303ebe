//! Waiting awake for a moment before going to sleep.

use std::time::{Duration, Instant};

/// How long who waits stays awake: some times what it takes to wake a thread on a sleeping core of a virtual machine, so that
/// of two who wait for each other none falls asleep while the other wakes up.
const PATIENCE: Duration = Duration::from_micros(100);

/// Looks again and again whether there is something, for a moment only; others who want the core go first.
///
/// What comes every few microseconds finds its taker awake; what comes later finds it asleep.
pub fn await_briefly(mut is_there: impl FnMut() -> bool) {
    let mut since = None;
    while !is_there() {
        let since = *since.get_or_insert_with(Instant::now);
        if since.elapsed() >= PATIENCE {
            return;
        }
        std::thread::yield_now();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patience_ends() {
        let (began, mut looks) = (Instant::now(), 0);
        await_briefly(|| {
            looks += 1;
            false
        });
        assert!(looks > 1 && began.elapsed() >= PATIENCE);
        looks = 0;
        await_briefly(|| {
            looks += 1;
            looks == 2
        });
        assert_eq!(looks, 2);
    }
}
