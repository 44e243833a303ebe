//! Checks of consecutive fixes: ascending times, gaps, headings that contradict the course.

use super::fix::{Fix, Pose, RecordError};
use vlscan_base::quantity::{self, MAX_DURATION, number};
use vlscan_geom::DVec3;

/// Minimum length of a gap, s.
const MIN_GAP: f64 = 1.0;
/// Minimum length of a gap as a multiple of the interval before it.
const MIN_GAP_INTERVALS: f64 = 10.0;
const MAX_WARNINGS: usize = 20;
const TIME_UNIT: &str =
    "name the unit of times in the heading or with --trajectory-columns: time[ms], time[us] or time[ns]";
const TOO_LONG: &str = "a trajectory covers at most 31 days; if times are not seconds, name their unit in \
                        the heading or with --trajectory-columns: time[ms], time[us] or time[ns]";
/// Maximum interval between two poses in which the platform is flown straight, s.
pub const MAX_FLOWN_GAP: f64 = 3600.0;
/// Distance after which headings are compared with the course, m.
const COMPARED_DISTANCE: f64 = 20.0;
/// Minimum cosine of the angle between heading and course that causes no note: 60°.
const MIN_COURSE_COSINE: f64 = 0.5;

/// Compares each fix with those before it.
#[derive(Debug)]
pub struct SequenceChecks {
    max_gap: f64,
    last: Option<Fix>,
    /// Time of the first fix, s.
    first_time: f64,
    /// The last interval, s.
    interval: f64,
    warnings: usize,
    start: Option<DVec3>,
    heading_is_compared: bool,
}

#[derive(Debug, Default)]
pub struct Checked {
    /// The fix equals the one before and is skipped.
    pub is_repeated: bool,
    pub warning: Option<RecordError>,
}

impl SequenceChecks {
    pub fn new(max_gap: f64) -> SequenceChecks {
        SequenceChecks {
            max_gap,
            last: None,
            first_time: 0.0,
            interval: 0.0,
            warnings: 0,
            start: None,
            heading_is_compared: false,
        }
    }

    /// Compares a fix with the one before.
    ///
    /// # Errors
    /// Its time is not later, or so much later that the flight would take practically forever.
    pub fn check(&mut self, fix: &Fix) -> Result<Checked, RecordError> {
        if !quantity::TIME.contains(fix.time) {
            let message = format!("time {}, expected {}", number(fix.time), quantity::TIME.expected);
            return Err(RecordError::new(message).help(TIME_UNIT));
        }
        let Some(last) = self.last.replace(*fix) else {
            self.first_time = fix.time;
            return Ok(Checked::default());
        };
        if *fix == last {
            let warning = self.limited(|| RecordError::new("the same pose again, skipped"));
            return Ok(Checked { is_repeated: true, warning });
        }
        if fix.time <= last.time {
            let what = if fix.time == last.time { "occurs again with another pose" } else { "goes back" };
            let message =
                format!("time {} {what}; the pose before it has {}", number(fix.time), number(last.time));
            return Err(RecordError::new(message).help("the times of a trajectory must ascend"));
        }
        if fix.time - self.first_time > MAX_DURATION {
            let message = format!(
                "time {} is more than {MAX_DURATION} s after that of the first pose, {}",
                number(fix.time),
                number(self.first_time)
            );
            return Err(RecordError::new(message).help(TOO_LONG));
        }
        let interval = fix.time - last.time;
        let seconds = number(interval);
        if interval > MAX_FLOWN_GAP && interval <= self.max_gap {
            let message =
                format!("no pose for {seconds} s before this one, at most {MAX_FLOWN_GAP} s are flown");
            return Err(RecordError::new(message).help("--max-gap leaves longer gaps out"));
        }
        let before = std::mem::replace(&mut self.interval, interval);
        let is_skipped = interval > self.max_gap;
        let is_gap =
            is_skipped || interval > MIN_GAP && before > 0.0 && interval > MIN_GAP_INTERVALS * before;
        let what = if is_skipped { "nothing is fired" } else { "the platform is flown straight" };
        let warning =
            || RecordError::new(format!("no pose for {seconds} s before this one: {what} in between"));
        Ok(Checked { is_repeated: false, warning: if is_gap { self.limited(warning) } else { None } })
    }

    fn limited(&mut self, warning: impl FnOnce() -> RecordError) -> Option<RecordError> {
        self.warnings += 1;
        (self.warnings <= MAX_WARNINGS).then(warning)
    }

    /// Compares heading and course once there is a course; a note if they contradict each other.
    pub fn compare_heading(&mut self, pose: &Pose) -> Option<String> {
        if self.heading_is_compared {
            return None;
        }
        let start = *self.start.get_or_insert(pose.position);
        let way = (pose.position - start) * DVec3::new(1.0, 1.0, 0.0);
        let heading = pose.attitude.forward() * DVec3::new(1.0, 1.0, 0.0);
        if way.length() < COMPARED_DISTANCE || heading.length() < 0.1 {
            return None;
        }
        self.heading_is_compared = true;
        if way.dot(heading) >= MIN_COURSE_COSINE * way.length() * heading.length() {
            return None;
        }
        let bearing = |v: DVec3| libm::atan2(v.x, v.y).to_degrees().rem_euclid(360.0);
        Some(format!(
            "the platform moves towards {:.0}° but heads for {:.0}°, clockwise from north; if that is wrong, \
             --trajectory-rotation and --trajectory-angles state what its angles mean",
            bearing(way),
            bearing(heading)
        ))
    }
}
