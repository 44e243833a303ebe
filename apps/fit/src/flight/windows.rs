//! Samples of long flight lines: windows of time with whole scan lines.

use vlscan_base::quantity::amount;

/// Duration of a window, s: many scan lines, of which those at its ends are cut.
const WINDOW_S: f64 = 1.0;
/// Maximum number of windows of which one is in a sample.
const MAX_ONE_OF: u64 = 1 << 20;

/// A sample of a flight line: one of a number of windows. Which ones depends on their times alone, and a
/// coarser sample is part of each finer one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Windows {
    one_of: u64,
}

impl Windows {
    /// All windows.
    pub const ALL: Windows = Windows { one_of: 1 };

    /// One of this many windows.
    pub fn one_of(number: u64) -> Windows {
        Windows { one_of: number.max(1) }
    }

    /// Half of the sample; `None` if hardly anything is left of it.
    pub fn coarser(self) -> Option<Windows> {
        (self.one_of < MAX_ONE_OF).then(|| Windows { one_of: 2 * self.one_of })
    }

    /// True if the sample has a time, s.
    pub fn has(self, time: f64) -> bool {
        self.one_of == 1 || (window(time) as i64).rem_euclid(self.one_of as i64) == 0
    }

    /// Number of windows of the sample that a flight line of a duration, s, meets at most.
    pub fn count(self, duration: f64) -> usize {
        match self.one_of {
            1 => 1,
            one_of => (duration / (one_of as f64 * WINDOW_S)) as usize + 2,
        }
    }

    /// Time from a time to the nearer end of its window, s; infinite if all windows are in the sample.
    pub fn to_end(self, time: f64) -> f64 {
        let since = time - window(time) * WINDOW_S;
        if self == Windows::ALL { f64::INFINITY } else { since.min(WINDOW_S - since) }
    }

    /// The sample in words.
    pub fn described(self) -> String {
        format!("of every {} seconds the scan lines of one", amount(self.one_of as f64 * WINDOW_S))
    }
}

/// The number of the window of a time, s.
fn window(time: f64) -> f64 {
    (time / WINDOW_S).floor()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coarser_sample_is_part_of_a_finer_one() {
        let times: Vec<f64> = (0..40_000).map(|k| 3.2e8 - 100.0 + 0.01 * f64::from(k)).collect();
        let mut sample = Windows::one_of(3);
        let mut before: Vec<f64> = times.clone();
        for one_of in [3, 6, 12] {
            assert_eq!(sample, Windows::one_of(one_of));
            let count = before.len();
            before.retain(|time| sample.has(*time));
            let expected = times.iter().filter(|time| sample.has(**time)).count();
            assert!(before.len() == expected && expected < count);
            assert!((expected as f64 * one_of as f64 / 40_000.0 - 1.0).abs() < 0.1, "{expected}");
            let windows = before.iter().map(|time| time.floor() as i64);
            let windows: std::collections::BTreeSet<i64> = windows.collect();
            assert!(windows.len() <= sample.count(400.0), "{}", windows.len());
            sample = sample.coarser().unwrap();
        }
        assert!(times.iter().all(|time| Windows::ALL.has(*time)) && Windows::ALL.count(1e6) == 1);
        assert!(Windows::one_of(3).has(-3.5) == Windows::one_of(3).has(-3.9));
    }

    #[test]
    fn the_ends_of_windows_are_those_of_seconds() {
        let sample = Windows::one_of(2);
        for (time, expected) in [(6.25, 0.25), (6.75, 0.25), (7.0, 0.0), (-0.1, 0.1)] {
            assert!((sample.to_end(time) - expected).abs() < 1e-12, "{time}");
        }
        assert_eq!(Windows::ALL.to_end(0.5), f64::INFINITY);
    }
}
