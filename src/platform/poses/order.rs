//! What must hold from one pose to the next.

use super::Pose;
use super::fix::{Fix, Problem};
use crate::geom::DVec3;

/// A gap is longer than this, s, …
const GAP: f64 = 1.0;
/// … and than so many of the intervals before it.
const GAP_INTERVALS: f64 = 10.0;
/// More warnings than these say nothing new.
const MOST_WARNINGS: usize = 20;
/// Way after which headings are compared with the course, m.
const WAY: f64 = 20.0;
/// Cosine of the angle between heading and course that is worth a note: 60°.
const ACROSS: f64 = 0.5;

/// Watches over times and headings.
#[derive(Debug)]
pub struct Order {
    max_gap: f64,
    last: Option<Fix>,
    interval: f64,
    warnings: usize,
    /// Where the course began; `None` once it has been judged.
    start: Option<DVec3>,
    judged: bool,
}

/// What becomes of a fix.
#[derive(Debug, Default)]
pub struct Admitted {
    pub passed_over: bool,
    pub warning: Option<Problem>,
}

impl Order {
    pub fn new(max_gap: f64) -> Order {
        Order { max_gap, last: None, interval: 0.0, warnings: 0, start: None, judged: false }
    }

    /// Compares a fix with the one before.
    ///
    /// # Errors
    /// Its time goes back, or is that of another pose.
    pub fn admit(&mut self, fix: &Fix) -> Result<Admitted, Problem> {
        let Some(last) = self.last.replace(*fix) else { return Ok(Admitted::default()) };
        if *fix == last {
            let warning = self.warning(|| Problem::new("the same pose again, passed over"));
            return Ok(Admitted { passed_over: true, warning });
        }
        if fix.time <= last.time {
            let what = if fix.time == last.time { "repeats with another pose" } else { "goes back" };
            let message = format!("time {} {what}; the pose before it has {}", fix.time, last.time);
            return Err(Problem::new(message).help("the times of a trajectory must ascend"));
        }
        let interval = fix.time - last.time;
        let before = std::mem::replace(&mut self.interval, interval);
        let gap =
            interval > self.max_gap || interval > GAP && before > 0.0 && interval > GAP_INTERVALS * before;
        let what =
            if interval > self.max_gap { "nothing is fired" } else { "the platform is flown straight" };
        let told = || Problem::new(format!("no pose for {interval} s before this one: {what} in between"));
        Ok(Admitted { passed_over: false, warning: if gap { self.warning(told) } else { None } })
    }

    fn warning(&mut self, problem: impl FnOnce() -> Problem) -> Option<Problem> {
        self.warnings += 1;
        (self.warnings <= MOST_WARNINGS).then(problem)
    }

    /// A note, once, if the platform heads elsewhere than it moves.
    pub fn course(&mut self, pose: &Pose) -> Option<String> {
        if self.judged {
            return None;
        }
        let start = *self.start.get_or_insert(pose.position);
        let way = (pose.position - start) * DVec3::new(1.0, 1.0, 0.0);
        let heading = pose.attitude.forward() * DVec3::new(1.0, 1.0, 0.0);
        if way.length() < WAY || heading.length() < 0.1 {
            return None;
        }
        self.judged = true;
        if way.dot(heading) >= ACROSS * way.length() * heading.length() {
            return None;
        }
        let bearing = |v: DVec3| libm::atan2(v.x, v.y).to_degrees().rem_euclid(360.0);
        Some(format!(
            "the platform moves towards {:.0}° but heads for {:.0}°, clockwise from north; if that is not meant, \
             --trajectory-rotation and --trajectory-angles tell what its angles are",
            bearing(way),
            bearing(heading)
        ))
    }
}
