//! Angles read in the wrong unit.

use super::Slip;
use crate::geom::DVec3;
use crate::survey::AngleConvention;
use std::f64::consts::TAU;

/// Way after which headings are compared with the course, m.
const MIN_WAY: f64 = 20.0;
/// Poses after which angles are judged without a course.
const MIN_POSES: u32 = 50;
/// Roll and pitch of a flight in radians stay below this, rad: 46°.
const MAX_TILT: f64 = 0.8;
/// Angles that are all as small as this, and not all 0, are hardly degrees.
const SMALL_ANGLE: f64 = 0.2;
/// A heading this far from the course is another one, and one this near the same, degrees.
const APART: f64 = 25.0;

/// Watches angles as they are written, and the course that is flown with them.
#[derive(Debug)]
pub(super) struct AngleWatch {
    convention: AngleConvention,
    /// Whether the angles are taken as degrees.
    degrees: bool,
    /// What says so.
    option: &'static str,
    start: Option<DVec3>,
    poses: u32,
    tilt: f64,
    yaw: f64,
    judged: bool,
}

impl AngleWatch {
    /// Watches angles that are taken as degrees, or as radians, because of `option`.
    pub fn new(convention: AngleConvention, degrees: bool, option: &'static str) -> AngleWatch {
        AngleWatch { convention, degrees, option, start: None, poses: 0, tilt: 0.0, yaw: 0.0, judged: false }
    }

    /// Looks at roll, pitch and yaw as written and at the position of the next pose.
    pub fn see(&mut self, position: DVec3, angles: [f64; 3]) -> Option<Slip> {
        if self.judged || angles.iter().any(|a| !a.is_finite()) {
            return None;
        }
        let [roll, pitch, yaw] = angles;
        self.poses += 1;
        self.tilt = self.tilt.max(roll.abs()).max(pitch.abs());
        self.yaw = self.yaw.max(yaw.abs());
        if !self.degrees {
            return self.see_radians();
        }
        let start = *self.start.get_or_insert(position);
        let way = (position - start) * DVec3::new(1.0, 1.0, 0.0);
        if way.length() >= MIN_WAY {
            self.judged = true;
            let course = libm::atan2(way.x, way.y).to_degrees();
            let off = |heading: f64| (heading - course + 180.0).rem_euclid(360.0) - 180.0;
            let [as_degrees, as_radians] = [yaw, yaw.to_degrees()].map(|yaw| off(self.bearing(yaw)).abs());
            let explained = as_degrees > APART && as_radians < APART;
            if self.tilt <= MAX_TILT && self.yaw <= TAU + 0.01 && explained {
                return Some(self.radians_as_degrees(format!(
                    "; as radians the heading {yaw} is {as_radians:.0}° off the course, as degrees {as_degrees:.0}°"
                )));
            }
            return self.small();
        }
        (self.poses >= MIN_POSES).then(|| self.small()).flatten()
    }

    /// Judges a trajectory that has ended.
    pub fn end(&mut self) -> Option<Slip> {
        if self.judged || !self.degrees || self.poses < 2 {
            return None;
        }
        self.judged = true;
        self.small()
    }

    fn small(&mut self) -> Option<Slip> {
        let most = self.tilt.max(self.yaw);
        let small = most <= SMALL_ANGLE && most > 0.0;
        self.judged |= small;
        small.then(|| self.radians_as_degrees(String::new()))
    }

    fn radians_as_degrees(&self, why: String) -> Slip {
        let message = format!(
            "the angles look like radians and are read as degrees: roll and pitch stay within ±{}, yaw within ±{}{why}",
            short(self.tilt),
            short(self.yaw)
        );
        Slip::new(message, self.remedy("rad"))
    }

    fn see_radians(&mut self) -> Option<Slip> {
        if self.tilt <= 2.0 * MAX_TILT && self.yaw <= 2.0 * TAU {
            return None;
        }
        self.judged = true;
        let message = format!(
            "the angles look like degrees and are read as radians: roll and pitch reach {}, yaw {}",
            short(self.tilt),
            short(self.yaw)
        );
        Some(Slip::new(message, self.remedy("deg")))
    }

    fn remedy(&self, unit: &str) -> String {
        format!(
            "{} tells their unit; in text a column can, too: roll[{unit}],pitch[{unit}],yaw[{unit}]",
            self.option
        )
    }

    /// Clockwise from north, degrees.
    fn bearing(&self, yaw: f64) -> f64 {
        match self.convention {
            AngleConvention::Heading | AngleConvention::Helios => yaw,
            AngleConvention::Yaw | AngleConvention::Ros => 90.0 - yaw,
            AngleConvention::Canonical => -yaw,
        }
    }
}

fn short(angle: f64) -> String {
    let text = format!("{angle:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fly(degrees: bool, angles: [f64; 3], step: DVec3) -> Option<String> {
        let mut watch = AngleWatch::new(AngleConvention::Heading, degrees, "--trajectory-angles");
        let seen = (0..60).find_map(|i| watch.see(step * f64::from(i), angles));
        seen.or_else(|| watch.end()).map(|slip| slip.message)
    }

    #[test]
    fn radians_that_are_read_as_degrees_contradict_the_course() {
        let east = DVec3::X;
        assert!(fly(true, [0.02, -0.3, 1.56], east).unwrap().contains("look like radians"));
        assert!(fly(true, [0.0, 0.0, 1.56], east).unwrap().contains("look like radians"));
        assert!(
            fly(true, [0.01, 0.02, 0.0], DVec3::Y).unwrap().contains("look like radians"),
            "to the north"
        );
        assert!(fly(true, [0.0, 0.1, 0.1], DVec3::ZERO).unwrap().contains("look like radians"), "hovering");
        for angles in [[0.0, 0.0, 90.0], [0.1, 0.1, 90.0], [2.0, -3.0, 91.0], [0.5, -0.5, 0.0]] {
            assert_eq!(fly(true, angles, east), None, "{angles:?}");
        }
        assert_eq!(fly(true, [0.0; 3], DVec3::Y), None, "level and north");
    }

    #[test]
    fn degrees_that_are_read_as_radians_are_too_large() {
        assert!(fly(false, [0.0, 2.0, 0.0], DVec3::X).unwrap().contains("look like degrees"));
        assert!(fly(false, [0.0, 0.0, 90.0], DVec3::X).unwrap().contains("look like degrees"));
        assert_eq!(fly(false, [0.3, 0.1, 6.2], DVec3::X), None);
    }
}
