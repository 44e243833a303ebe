//! Check of a recorded flight's times: milliseconds read as seconds make it a thousand times slower.

use super::finding::Finding;
use vlscan_base::quantity::{duration, metres};
use vlscan_geom::DVec3;

/// Duration above which a flight is reported, s.
const MAX_DURATION: f64 = 86_400.0;
/// Speed below which a flight is reported, m/s.
const MIN_SPEED: f64 = 0.1;
/// Length of a flight from which its speed counts, m: below it a platform stands, and what moves is noise.
const MIN_LENGTH: f64 = 10.0;
/// Distance between two poses from which their speed counts by itself, m.
const MIN_STEP: f64 = 0.5;
/// Steps of a flight from whose pace alone milliseconds are recognised while it is flown.
const EARLY_STEPS: u32 = 3;
/// Unit of times that are thousandths, for messages.
const REMEDY: &str =
    "times are in seconds; if these are milliseconds, say so in the heading: time[ms] (us and ns likewise)";

/// Length and duration of a flight.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pace {
    first: Option<f64>,
    last: Option<(f64, DVec3)>,
    length: f64,
    /// Time and place from which the present step is measured.
    step_start: Option<(f64, DVec3)>,
    /// Steps that were too slow before any that was not, and their duration and length.
    slow: (u32, f64, f64),
    /// True if a step was fast enough.
    has_moved: bool,
}

impl Pace {
    /// Adds the next pose.
    pub fn add(&mut self, time: f64, position: DVec3) {
        self.first.get_or_insert(time);
        if let Some((earlier, before)) = self.last.replace((time, position)) {
            self.length += before.distance(position);
            let (start, place) = *self.step_start.get_or_insert((earlier, before));
            let step = place.distance(position);
            if step >= MIN_STEP {
                self.step_start = Some((time, position));
                self.has_moved |= step >= MIN_SPEED * (time - start);
                let (count, seconds, length) = self.slow;
                self.slow = (count + 1, seconds + time - start, length + step);
            }
        }
    }

    /// Finds what the poses so far show: all steps take too long, over more than a platform that stands
    /// drifts.
    pub fn find_early(&self) -> Option<Finding> {
        let (count, seconds, length) = self.slow;
        let is_slow = count >= EARLY_STEPS && length >= MIN_LENGTH && !self.has_moved;
        if is_slow { Some(Pace::finding(seconds, length)) } else { self.find() }
    }

    /// Finds a flight that hardly moves, or lasts for days.
    pub fn find(&self) -> Option<Finding> {
        let (Some(first), Some((last, _))) = (self.first, self.last) else { return None };
        Pace::judge(last - first, self.length)
    }

    fn judge(seconds: f64, length: f64) -> Option<Finding> {
        let speed = length / seconds;
        let is_slow = length >= MIN_LENGTH && speed < MIN_SPEED;
        (is_slow || seconds > MAX_DURATION).then(|| Pace::finding(seconds, length))
    }

    fn finding(seconds: f64, length: f64) -> Finding {
        let (lasts, speed) = (duration(seconds), length / seconds);
        Finding::new(
            format!("the flight lasts {lasts} for {}, {speed:.3} m/s on average", metres(length)),
            REMEDY,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flight of 300 m at 10 m/s, ten poses a second, whose times are multiplied by `factor`.
    fn flown(factor: f64, step: f64) -> Option<String> {
        let mut pace = Pace::default();
        for i in 0..=300 {
            let t = f64::from(i);
            pace.add(345_600.0 * factor + 0.1 * t * factor, DVec3::Y * (step * t));
        }
        pace.find().map(|finding| format!("{}; {}", finding.message, finding.help))
    }

    #[test]
    fn milliseconds_that_are_read_as_seconds_are_told() {
        assert_eq!(flown(1.0, 1.0), None);
        assert_eq!(flown(1.0, 0.0), None, "a platform that stands");
        let slow = flown(1000.0, 1.0).unwrap();
        assert!(slow.contains("0.010 m/s") && slow.contains("time[ms]"), "{slow}");
        assert!(flown(10_000.0, 0.0).is_some(), "three and a half days");
    }

    #[test]
    fn milliseconds_are_recognised_after_a_few_steps_and_pauses_are_not() {
        let early = |steps: &[(f64, f64)]| {
            let (mut pace, mut time, mut y) = (Pace::default(), 0.0, 0.0);
            pace.add(time, DVec3::ZERO);
            let found = steps.iter().position(|(seconds, metres)| {
                (time, y) = (time + seconds, y + metres);
                pace.add(time, DVec3::Y * y);
                pace.find_early().is_some()
            });
            found.map(|i| i + 1)
        };
        assert_eq!(early(&[(100.0, 1.0); 20]), Some(10), "10 m/s, ten poses a second");
        assert_eq!(early(&[(10.0, 0.125); 100]), Some(80), "a hundred poses a second");
        assert_eq!(early(&[(0.1, 1.0); 10]), None);
        // A vehicle that drifts while it stands, and starts.
        assert_eq!(early(&[[(60.0, 0.6); 5], [(0.1, 1.0); 5]].concat()), None);
        // A tripod that is carried from place to place.
        assert_eq!(early(&[(5.0, 2.0), (600.0, 0.01), (5.0, 2.0), (600.0, 0.01), (5.0, 2.0)]), None);
    }
}
