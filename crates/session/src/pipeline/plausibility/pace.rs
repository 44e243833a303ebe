//! Check of a recorded flight's times: milliseconds read as seconds make it a thousand times slower, minutes
//! and hours faster than any aeroplane, as does a single pose in a wrong place.

use super::finding::Finding;
use vlscan_base::quantity::{duration, metres, number};
use vlscan_geom::DVec3;

/// Duration above which a flight is reported, s.
const MAX_DURATION: f64 = 86_400.0;
/// Speed below which a flight is reported, m/s.
const MIN_SPEED: f64 = 0.1;
/// Minimum length of a flight whose speed is checked, m: a shorter flight is a static platform with noise.
const MIN_LENGTH: f64 = 10.0;
/// Minimum distance between two poses whose speed is checked on its own, m.
const MIN_STEP: f64 = 0.5;
/// Steps of a flight from whose pace alone milliseconds are recognised while it is flown.
const EARLY_STEPS: u32 = 3;
/// Length of a step from which its speed is compared with [`MAX_SPEED`], m: shorter ones may be noise.
const MIN_LEAP: f64 = 50.0;
/// Speed above which a flight is reported, m/s: aeroplanes with the wind reach 340.
const MAX_SPEED: f64 = 350.0;
/// Height above which speeds of satellites are plausible, m.
const MIN_ORBIT: f64 = 100_000.0;
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
    /// True if a step was at most as fast as aeroplanes.
    has_flown: bool,
    /// Time and place from which the present leap is measured.
    leap_start: Option<(f64, DVec3)>,
    /// Number of steps of at least [`MIN_LEAP`], and of those above [`MAX_SPEED`].
    leaps: (u32, u32),
    /// The first step above [`MAX_SPEED`].
    first_leap: Option<Leap>,
}

/// A step of a flight.
#[derive(Clone, Copy, Debug)]
struct Leap {
    /// Time at which the step ends, s.
    time: f64,
    seconds: f64,
    length: f64,
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
                self.has_flown |= step <= MAX_SPEED * (time - start);
                let (count, seconds, length) = self.slow;
                self.slow = (count + 1, seconds + time - start, length + step);
            }
            self.add_leap((earlier, before), (time, position));
        }
    }

    /// Compares the speed from the pose before, or from the start of the present leap if that is the first
    /// far enough away.
    fn add_leap(&mut self, before: (f64, DVec3), (time, position): (f64, DVec3)) {
        let start = *self.leap_start.get_or_insert(before);
        let is_far = |(_, from): &(f64, DVec3)| from.distance(position) >= MIN_LEAP;
        let Some((earlier, from)) = [before, start].into_iter().find(is_far) else { return };
        self.leap_start = Some((time, position));
        let (seconds, length) = (time - earlier, from.distance(position));
        let is_fast = seconds > 0.0 && length > MAX_SPEED * seconds && position.z < MIN_ORBIT;
        let (all, fast) = self.leaps;
        self.leaps = (all + 1, fast + u32::from(is_fast));
        if is_fast {
            self.first_leap.get_or_insert(Leap { time, seconds, length });
        }
    }

    /// Finds what the poses so far show: all steps take too long, over more than the drift of a static
    /// platform, or all are too fast.
    pub fn find_early(&self) -> Option<Finding> {
        let (count, seconds, length) = self.slow;
        let is_slow = count >= EARLY_STEPS && length >= MIN_LENGTH && !self.has_moved;
        let (all, fast) = self.leaps;
        match () {
            () if is_slow => Some(Pace::finding(seconds, length)),
            // Later poses show whether a step was a single one.
            () if fast > 0 && fast == all && fast < EARLY_STEPS => self.find_slow(),
            () => self.find(),
        }
    }

    /// Finds a flight that hardly moves, lasts for days, or moves faster than any aeroplane.
    pub fn find(&self) -> Option<Finding> {
        self.find_slow().or_else(|| self.find_fast())
    }

    /// Finds a flight that hardly moves, or lasts for days.
    pub fn find_slow(&self) -> Option<Finding> {
        let (Some(first), Some((last, _))) = (self.first, self.last) else { return None };
        Pace::assess(last - first, self.length)
    }

    fn find_fast(&self) -> Option<Finding> {
        let (leap, (all, fast)) = (self.first_leap?, self.leaps);
        let (Some(first), Some((last, _))) = (self.first, self.last) else { return None };
        if !self.has_flown || fast >= EARLY_STEPS && 2 * fast > all {
            let (seconds, speed) = (last - first, self.length / (last - first));
            let (lasts, length) = (duration(seconds), metres(self.length));
            return Some(Finding::new(
                format!("the flight covers {length} in {lasts}, {speed:.0} m/s on average"),
                "times are in seconds: multiply minutes by 60, hours by 3600; or positions are not in metres",
            ));
        }
        let Leap { time, seconds, length } = leap;
        Some(Finding::new(
            format!(
                "the flight moves {} within {} before time {}, {:.0} m/s",
                metres(length),
                duration(seconds),
                number(time),
                length / seconds
            ),
            "remove the pose if its place or time is wrong; times are in seconds, positions in metres",
        ))
    }

    fn assess(seconds: f64, length: f64) -> Option<Finding> {
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
    fn flights_faster_than_aeroplanes_are_told() {
        for factor in [1.0 / 60.0, 1.0 / 3600.0, 1.0 / 6000.0] {
            let fast = flown(factor, 1.0).unwrap();
            assert!(fast.contains("covers 300 m in") && fast.contains("minutes by 60"), "{fast}");
        }
        assert_eq!(flown(0.1, 3.4), None, "an airliner at 340 m/s");
        let find = |poses: &[(f64, [f64; 3])]| {
            let mut pace = Pace::default();
            poses.iter().for_each(|(time, position)| pace.add(*time, DVec3::from(*position)));
            pace.find().map(|finding| finding.message)
        };
        let mut poses: Vec<(f64, [f64; 3])> =
            (0..=300).map(|i| (0.1 * f64::from(i), [0.0, f64::from(i), 80.0])).collect();
        // A drift of the positions by metres, as of noise.
        poses[80].1[0] = 10.0;
        assert_eq!(find(&poses), None);
        poses[150].1[0] = 1000.0;
        let jump = find(&poses).unwrap();
        assert!(
            jump.contains("moves 1.0 km within ") && jump.contains(" before time 15, 10000 m/s"),
            "{jump}"
        );
        let orbit: Vec<(f64, [f64; 3])> =
            (0..100).map(|i| (f64::from(i), [0.0, 7500.0 * f64::from(i), 500_000.0])).collect();
        assert_eq!(find(&orbit), None, "a satellite");
    }

    #[test]
    fn a_unit_of_times_is_found_early_and_a_single_jump_later() {
        let early = |speed: f64, jump: f64| {
            let (mut pace, mut found) = (Pace::default(), Vec::new());
            for i in 0..300 {
                let aside = if i == 0 { jump } else { 0.0 };
                pace.add(0.1 * f64::from(i), DVec3::new(aside, 0.1 * speed * f64::from(i), 80.0));
                found.extend(pace.find_early().map(|finding| (i, finding.message)));
            }
            found.into_iter().next()
        };
        assert_eq!(early(300.0, 0.0), None);
        let (at, message) = early(600.0, 0.0).unwrap();
        assert!(at == 3 && message.contains("600 m/s on average"), "{at} {message}");
        let (at, message) = early(10.0, 1000.0).unwrap();
        assert!(at == 51 && message.contains("moves 1.0 km"), "{at} {message}");
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
