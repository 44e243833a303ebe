//! Check of a recorded flight's times: milliseconds read as seconds make it a thousand times slower.

use super::Finding;
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
/// Unit of times that are thousandths, for messages.
const REMEDY: &str =
    "times are in seconds; if these are milliseconds, say so in the heading: time[ms] (us and ns likewise)";

/// Length and duration of a flight.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pace {
    first: Option<f64>,
    last: Option<(f64, DVec3)>,
    length: f64,
    /// Duration and length of the first step that is too slow.
    slow_step: Option<(f64, f64)>,
}

impl Pace {
    /// Adds the next pose.
    pub fn add(&mut self, time: f64, position: DVec3) {
        self.first.get_or_insert(time);
        if let Some((earlier, before)) = self.last.replace((time, position)) {
            let step = before.distance(position);
            self.length += step;
            if step >= MIN_STEP && step < MIN_SPEED * (time - earlier) {
                self.slow_step.get_or_insert((time - earlier, step));
            }
        }
    }

    /// Finds what the poses so far tell already: a step between two of them takes too long, or all of them.
    pub fn find_early(&self) -> Option<Finding> {
        let step = self.slow_step.map(|(seconds, length)| Pace::finding(seconds, length));
        step.or_else(|| self.find())
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
}
