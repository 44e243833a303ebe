//! Detection of angles read in the wrong unit.

use super::finding::Finding;
use std::f64::consts::TAU;
use vlscan_geom::DVec3;
use vlscan_survey::AngleConvention;

/// Distance flown after which headings are compared with the course, m.
const MIN_DISTANCE: f64 = 20.0;
/// Poses after which angles are checked without a course.
const MIN_POSES: u32 = 50;
/// Upper bound of roll and pitch of a flight in radians, rad: 46°.
const MAX_TILT: f64 = 0.8;
/// Upper bound of angles that, unless all are 0, are hardly degrees.
const SMALL_ANGLE: f64 = 0.2;
/// Deviation of a heading from the course above which it contradicts the course, degrees.
const MAX_DEVIATION: f64 = 25.0;

/// Check of angles as written against the course flown.
#[derive(Debug)]
pub(super) struct AngleCheck {
    convention: AngleConvention,
    /// True if the angles are read as degrees.
    degrees: bool,
    /// The option that selects the unit.
    option: &'static str,
    start: Option<DVec3>,
    poses: u32,
    tilt: f64,
    yaw: f64,
    is_decided: bool,
}

impl AngleCheck {
    /// Creates a check of angles that are read as degrees, or as radians, because of `option`.
    pub fn new(convention: AngleConvention, degrees: bool, option: &'static str) -> AngleCheck {
        AngleCheck {
            convention,
            degrees,
            option,
            start: None,
            poses: 0,
            tilt: 0.0,
            yaw: 0.0,
            is_decided: false,
        }
    }

    /// Adds the position of the next pose and its roll, pitch and yaw as written.
    pub fn add(&mut self, position: DVec3, angles: [f64; 3]) -> Option<Finding> {
        if self.is_decided || angles.iter().any(|a| !a.is_finite()) {
            return None;
        }
        let [roll, pitch, yaw] = angles;
        self.poses += 1;
        self.tilt = self.tilt.max(roll.abs()).max(pitch.abs());
        self.yaw = self.yaw.max(yaw.abs());
        if !self.degrees {
            return self.check_radians();
        }
        let start = *self.start.get_or_insert(position);
        let path = (position - start) * DVec3::new(1.0, 1.0, 0.0);
        if path.length() >= MIN_DISTANCE {
            self.is_decided = true;
            let course = libm::atan2(path.x, path.y).to_degrees();
            let off = |heading: f64| (heading - course + 180.0).rem_euclid(360.0) - 180.0;
            let [as_degrees, as_radians] = [yaw, yaw.to_degrees()].map(|yaw| off(self.bearing(yaw)).abs());
            let explained = as_degrees > MAX_DEVIATION && as_radians < MAX_DEVIATION;
            if self.tilt <= MAX_TILT && self.yaw <= TAU + 0.01 && explained {
                return Some(self.radians_as_degrees(format!(
                    "; read as radians the heading {yaw} is {as_radians:.0}° off the course, as degrees \
                     {as_degrees:.0}°"
                )));
            }
            return self.check_small();
        }
        (self.poses >= MIN_POSES).then(|| self.check_small()).flatten()
    }

    /// Checks a completed trajectory.
    pub fn end(&mut self) -> Option<Finding> {
        if self.is_decided || !self.degrees || self.poses < 2 {
            return None;
        }
        self.is_decided = true;
        self.check_small()
    }

    fn check_small(&mut self) -> Option<Finding> {
        let max = self.tilt.max(self.yaw);
        let is_small = max <= SMALL_ANGLE && max > 0.0;
        self.is_decided |= is_small;
        is_small.then(|| self.radians_as_degrees(String::new()))
    }

    fn radians_as_degrees(&self, why: String) -> Finding {
        let message = format!(
            "the angles look like radians but are read as degrees: roll and pitch stay within ±{}, yaw \
             within ±{}{why}",
            short(self.tilt),
            short(self.yaw)
        );
        Finding::new(message, self.remedy("rad"))
    }

    fn check_radians(&mut self) -> Option<Finding> {
        if self.tilt <= 2.0 * MAX_TILT && self.yaw <= 2.0 * TAU {
            return None;
        }
        self.is_decided = true;
        let message = format!(
            "the angles look like degrees but are read as radians: roll and pitch reach {}, yaw {}",
            short(self.tilt),
            short(self.yaw)
        );
        Some(Finding::new(message, self.remedy("deg")))
    }

    fn remedy(&self, unit: &str) -> String {
        format!(
            "{} sets their unit; in text the heading can, too: roll[{unit}],pitch[{unit}],yaw[{unit}]",
            self.option
        )
    }

    /// Converts a yaw to a bearing, clockwise from north, degrees.
    fn bearing(&self, yaw: f64) -> f64 {
        match self.convention {
            // Cameras have no angles.
            AngleConvention::Heading | AngleConvention::Helios | AngleConvention::Camera => yaw,
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
        let mut check = AngleCheck::new(AngleConvention::Heading, degrees, "--trajectory-angles");
        let seen = (0..60).find_map(|i| check.add(step * f64::from(i), angles));
        seen.or_else(|| check.end()).map(|finding| finding.message)
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
