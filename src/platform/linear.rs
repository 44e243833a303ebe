//! Straight flight from waypoint to waypoint (spec kinematics §2.3).

use super::LegEntry;
use super::course::{Course, LegCourse, align};
use crate::geom::{Rotation, unit};

/// A platform on a straight path.
#[derive(Clone, Debug)]
pub(super) struct LinearPath {
    pub course: Course,
    pub attitude: Rotation,
}

impl Default for LinearPath {
    fn default() -> LinearPath {
        LinearPath { course: Course::default(), attitude: Rotation::IDENTITY }
    }
}

impl LinearPath {
    /// Aligns with the leg's target; a run's first leg aligns once more.
    pub fn start_leg(&mut self, legs: &[LegCourse], leg: usize, entry: LegEntry) {
        if self.course.start_leg(legs, leg, entry) {
            self.attitude = align(self.attitude, self.course.to_target());
        }
        if entry == LegEntry::Initial {
            self.attitude = align(self.attitude, self.course.to_target());
        }
    }

    #[inline]
    pub fn step(&mut self, leg: &LegCourse) {
        let c = &mut self.course;
        c.position += c.velocity;
        let q = c.to_target();
        if q.dot(q) > 0.0 && leg.speed > 0.0 {
            c.velocity = unit(q) * leg.step_length;
        }
    }
}
