//! Straight flight from waypoint to waypoint (spec kinematics §2.3).

use super::course::{Course, LegCourse, LegEntry, align, facing};
use crate::geom::{DVec3, Rotation, unit};
use crate::survey::Kinematics;
use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LinearPath {
    pub(super) course: Course,
    pub(super) attitude: Rotation,
}

impl Default for LinearPath {
    fn default() -> LinearPath {
        LinearPath { course: Course::default(), attitude: Rotation::IDENTITY }
    }
}

impl LinearPath {
    /// Aligns with the leg's target; the reference aligns twice in the first leg of a run.
    pub(super) fn start_leg(
        &mut self,
        legs: &[LegCourse],
        leg: usize,
        entry: LegEntry,
        kinematics: &Kinematics,
    ) {
        let corner = self.course.target;
        let left = self.course.time_left_at_target().filter(|_| entry == LegEntry::Continuing);
        let assigned = self.course.start_leg(legs, leg, entry);
        let mut way = self.course.to_target();
        if kinematics.sharp_corners
            && assigned
            && let (Some(left), Some(before)) = (left, leg.checked_sub(1))
        {
            // Flies the rest of the step along the new leg, at most to its end.
            way = self.course.target - corner;
            let beyond = (left * legs[leg].speed / legs[before].frequency).min(way.length());
            let ahead = if beyond > 0.0 { unit(way) * beyond } else { DVec3::ZERO };
            self.course.velocity = corner - self.course.position + ahead;
        }
        if kinematics.heading_along_leg {
            if assigned {
                self.attitude = facing(way).unwrap_or(self.attitude);
            }
            return;
        }
        if assigned {
            self.attitude = align(self.attitude, self.course.to_target());
        }
        if entry == LegEntry::Initial {
            self.attitude = align(self.attitude, self.course.to_target());
        }
    }

    #[inline]
    pub(super) fn step(&mut self, leg: &LegCourse) {
        let c = &mut self.course;
        c.position += c.velocity;
        let q = c.to_target();
        if q.dot(q) > 0.0 && leg.speed > 0.0 {
            c.velocity = unit(q) * leg.step_length;
        }
    }
}
