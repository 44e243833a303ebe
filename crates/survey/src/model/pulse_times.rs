//! Times at which pulses are emitted, if the rate is not constant.

use std::sync::Arc;

/// The times at which the pulses of a leg leave, s from its start, in place of a constant rate.
#[derive(Clone, PartialEq)]
pub enum PulseTimes {
    /// Recorded times, ascending, at least two and none below 0.
    Recorded(Arc<[f64]>),
    /// Times within a cycle of intervals that repeats, the first of which is 0, and the duration of the
    /// cycle.
    Cycle {
        /// Ascending, s.
        times: Arc<[f64]>,
        /// s.
        duration: f64,
    },
}

impl PulseTimes {
    /// Pulses at the ends of intervals (s, above 0) that repeat, the first one at 0.
    pub fn of_intervals(intervals: &[f64]) -> PulseTimes {
        let mut duration = 0.0;
        let times = intervals.iter().map(|interval| {
            let time = duration;
            duration += interval;
            time
        });
        PulseTimes::Cycle { times: times.collect(), duration }
    }

    /// The time of pulse `number`, counted from 0, s. Beyond the last recorded one time continues at the mean
    /// rate.
    #[inline]
    pub fn at(&self, number: u64) -> f64 {
        match self {
            PulseTimes::Recorded(times) => match times.get(number as usize) {
                Some(time) => *time,
                None => {
                    let beyond = number - (times.len() as u64 - 1);
                    times[times.len() - 1] + beyond as f64 / self.mean_rate()
                }
            },
            PulseTimes::Cycle { times, duration } => {
                let count = times.len() as u64;
                (number / count) as f64 * duration + times[(number % count) as usize]
            }
        }
    }

    /// Number of pulses; `None` for a cycle, which never ends.
    pub fn count(&self) -> Option<u64> {
        match self {
            PulseTimes::Recorded(times) => Some(times.len() as u64),
            PulseTimes::Cycle { .. } => None,
        }
    }

    /// The number of the first pulse at `time` or later, counted from 0; beyond the last recorded time,
    /// numbers continue as in [`PulseTimes::at`].
    pub fn first_from(&self, time: f64) -> u64 {
        let near = match self {
            PulseTimes::Recorded(times) if time <= times[times.len() - 1] => {
                return times.partition_point(|t| *t < time) as u64;
            }
            PulseTimes::Recorded(times) => {
                times.len() as u64 + ((time - times[times.len() - 1]) * self.mean_rate()) as u64
            }
            PulseTimes::Cycle { times, duration } => {
                let cycle = (time / duration).floor().max(0.0);
                let within = time - cycle * duration;
                (cycle as u64) * times.len() as u64 + times.partition_point(|t| *t < within) as u64
            }
        };
        // Rounding may be off by one.
        (near.saturating_sub(2)..).find(|number| self.at(*number) >= time).unwrap_or(near)
    }

    /// Pulses per second on average.
    pub fn mean_rate(&self) -> f64 {
        match self {
            PulseTimes::Recorded(times) => (times.len() - 1) as f64 / (times[times.len() - 1] - times[0]),
            PulseTimes::Cycle { times, duration } => times.len() as f64 / duration,
        }
    }

    /// The shortest time from one pulse to the next, s.
    pub fn shortest_interval(&self) -> f64 {
        let within = |times: &[f64]| times.windows(2).map(|t| t[1] - t[0]).fold(f64::INFINITY, f64::min);
        match self {
            PulseTimes::Recorded(times) => within(times),
            PulseTimes::Cycle { times, duration } => {
                within(times).min(duration - times.last().copied().unwrap_or(0.0))
            }
        }
    }
}

/// Maximum number of times of a cycle that are written out.
const MAX_SHOWN: usize = 1 << 16;

/// FNV-1a over words of 64 bits. Checksums of surveys include it, so it never changes.
pub(super) fn fold_words(words: impl Iterator<Item = u64>) -> u64 {
    words.fold(0xcbf2_9ce4_8422_2325, |sum, word| (sum ^ word).wrapping_mul(0x0100_0000_01b3))
}

fn checksum(times: &[f64]) -> u64 {
    fold_words(times.iter().map(|time| time.to_bits()))
}

/// Count, ends and a checksum of recorded times, which distinguish different times without storing all of
/// them.
impl std::fmt::Debug for PulseTimes {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            PulseTimes::Recorded(times) => {
                let (first, last, sum) = (times[0], times[times.len() - 1], checksum(times));
                write!(f, "{} times from {first:?} s to {last:?} s, {sum:016x}", times.len())
            }
            PulseTimes::Cycle { times, duration } if times.len() <= MAX_SHOWN => {
                write!(f, "cycle of {duration:?} s: {times:?}")
            }
            PulseTimes::Cycle { times, duration } => {
                write!(f, "cycle of {duration:?} s: {} times, {:016x}", times.len(), checksum(times))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cycles_repeat() {
        let times = PulseTimes::of_intervals(&[0.5, 0.25, 1.25]);
        let found: Vec<f64> = (0..7).map(|k| times.at(k)).collect();
        assert_eq!(found, [0.0, 0.5, 0.75, 2.0, 2.5, 2.75, 4.0]);
        assert_eq!((times.mean_rate(), times.shortest_interval(), times.count()), (1.5, 0.25, None));
        for (time, number) in
            [(0.0, 0), (0.1, 1), (0.5, 1), (0.76, 3), (2.0, 3), (2.5000001, 5), (1e6 + 0.6, 1_500_002)]
        {
            assert_eq!(times.first_from(time), number, "{time}");
        }
    }

    #[test]
    fn recorded_times_go_on_at_their_mean_rate_without_pulses() {
        let times = PulseTimes::Recorded([0.25, 0.5, 1.25].into());
        assert_eq!([0, 2, 3, 5].map(|k| times.at(k)), [0.25, 1.25, 1.75, 2.75]);
        assert_eq!((times.mean_rate(), times.shortest_interval(), times.count()), (2.0, 0.25, Some(3)));
        for (time, number) in [(0.0, 0), (0.25, 0), (0.3, 1), (1.25, 2), (1.3, 3), (2.75, 5), (2.76, 6)] {
            assert_eq!(times.first_from(time), number, "{time}");
        }
        let other = PulseTimes::Recorded([0.25, 0.75, 1.25].into());
        assert_ne!(format!("{times:?}"), format!("{other:?}"));
    }
}
