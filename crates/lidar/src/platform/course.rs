//! Waypoints and headings, shared by all platforms (spec kinematics §0.1, §2.1).

use libm::{acos, asin, atan2};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};
use vlscan_geom::{DVec3, Rotation, unit};
use vlscan_survey::RotationSpec;

/// How a leg is entered (spec kinematics §1.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LegEntry {
    /// The first leg of a run: the platform is placed at it.
    Initial,
    /// A later leg: a moving platform continues from where it is.
    Continuing,
}

/// Parameters of a leg that its platform needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegCourse {
    /// Start of the leg, m, scene frame.
    pub position: DVec3,
    /// Steps per second.
    pub frequency: f64,
    /// Speed, m/s.
    pub speed: f64,
    /// Speed, m per step: `speed / frequency`.
    pub step_length: f64,
    /// Multicopter: stop at the waypoint and turn to the yaw of departure.
    pub stop_and_turn: bool,
    /// Multicopter: curve through the waypoint.
    pub smooth_turn: bool,
    /// Multicopter: brake before the waypoint.
    pub slowdown: bool,
    /// Multicopter: yaw to adopt when stopping and turning, rad.
    pub yaw_at_departure: Option<f64>,
    /// Interpolated platforms: the part of the table that is flown; `None` on added legs, which end at once.
    pub span: Option<Span>,
}

/// A part of a trajectory table, in seconds after its first row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Time at which the part begins, s.
    pub start: f64,
    /// Time at which the part ends, s.
    pub end: f64,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Course {
    /// m, scene frame.
    pub position: DVec3,
    /// m per step.
    pub velocity: DVec3,
    pub origin: DVec3,
    pub target: DVec3,
    pub next: DVec3,
}

impl Course {
    /// Sets the waypoints of leg `leg`, and the position if it is the first of a run. The last leg keeps the
    /// waypoints of the previous leg. Returns whether a target was assigned.
    pub fn start_leg(&mut self, legs: &[LegCourse], leg: usize, entry: LegEntry) -> bool {
        if entry == LegEntry::Initial {
            self.position = legs[leg].position;
        }
        let Some(target) = legs.get(leg + 1) else { return false };
        self.origin = legs[leg].position;
        self.target = target.position;
        self.next = legs.get(leg + 2).unwrap_or(target).position;
        true
    }

    #[inline]
    pub fn to_target(&self) -> DVec3 {
        self.target - self.position
    }

    /// True if the target is less than one step away: `|D − p| / |v| < 1`.
    #[inline]
    pub fn is_reached(&self) -> bool {
        let q = self.to_target();
        let v = self.velocity;
        // Decides all but the last steps without a square root, far from any rounding of the quotient below.
        if q.dot(q) > 4.0 * v.dot(v) {
            return false;
        }
        q.length() / v.length() < 1.0
    }

    /// Fraction of the next step that remains after it reaches the target; `None` if it does not reach it.
    pub fn time_left_at_target(&self) -> Option<f64> {
        let needed = self.to_target().length() / self.velocity.length();
        (needed < 1.0).then_some(1.0 - needed)
    }

    pub fn progress(&self, leg: &LegCourse) -> f64 {
        fraction((self.position - leg.position).length(), (self.target - self.origin).length())
    }

    /// `start` with the next waypoint of this course.
    pub fn restored(&self, start: &Course) -> Course {
        Course { next: self.next, ..start.clone() }
    }
}

/// `part / whole` within [0, 1]; 1 where `whole` is 0.
pub(super) fn fraction(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { (part / whole).clamp(0.0, 1.0) } else { 1.0 }
}

#[inline]
pub(super) fn horizontal(v: DVec3) -> DVec3 {
    DVec3::new(v.x, v.y, 0.0)
}

/// The horizontal unit vector along `v`, or `None` when `v` is vertical.
#[inline]
pub(super) fn horizontal_unit(v: DVec3) -> Option<DVec3> {
    let u = unit(horizontal(v));
    u.is_finite().then_some(u).filter(|u| u.x != 0.0 || u.y != 0.0)
}

/// Heading of `d` in [0, 2π), clockwise from +Y.
pub(super) fn heading(d: DVec3) -> f64 {
    let angle = atan2(d.x, d.y);
    if angle < 0.0 { angle + TAU } else { angle }
}

/// The level attitude whose nose points along the horizontal part of `way`; `None` where `way` is vertical.
pub(super) fn facing(way: DVec3) -> Option<Rotation> {
    horizontal_unit(way).map(|d| Rotation::about_z(-atan2(d.x, d.y)))
}

/// The reference's alignment (spec kinematics §2.3): turns `attitude` about z until its forward axis points
/// along the horizontal part of `q`. Its turns are unsigned, so small clockwise errors grow. A vertical `q`
/// changes nothing.
pub(super) fn align(attitude: Rotation, q: DVec3) -> Rotation {
    const MAX_ERROR: f64 = 0.025;
    const MAX_TURNS: usize = 10_000;
    let Some(goal) = horizontal_unit(q) else { return attitude };
    let error =
        |a: Rotation| horizontal_unit(a.forward()).map_or(0.0, |d| acos(goal.dot(d).clamp(-1.0, 1.0)));
    let first = error(attitude);
    let mut aligned = attitude.after(Rotation::about_z(first));
    if first < MAX_ERROR {
        return aligned;
    }
    let (mut left, mut turned) = (error(aligned), 0.0);
    for _ in 0..MAX_TURNS {
        if left <= MAX_ERROR {
            break;
        }
        turned += left;
        aligned = Rotation::about_z(turned);
        left = error(aligned);
    }
    aligned
}

/// Roll, pitch and yaw of `attitude`: the XYZ triple, or the ZYX triple with clockwise yaw for ARINC
/// trajectories. At gimbal lock the angle about the first axis is 0.
pub(super) fn reported_angles(attitude: Rotation, recorded: Option<RotationSpec>) -> [f64; 3] {
    if recorded == Some(RotationSpec::Arinc705) {
        let [y, roll, pitch] = attitude.angles_zyx().unwrap_or_else(|| locked_zyx(attitude));
        let yaw = if y < PI { -y } else { TAU - y };
        return [roll, pitch, if yaw < 0.0 { yaw + TAU } else { yaw }];
    }
    let [roll, pitch, yaw] = attitude.angles_xyz().unwrap_or_else(|| locked_xyz(attitude));
    [roll, pitch, if yaw < 0.0 { yaw + TAU } else { yaw }]
}

/// Angles of `Ry(b)∘Rz(c)` nearest to an attitude at gimbal lock, b ≈ ±90°.
fn locked_xyz(attitude: Rotation) -> [f64; 3] {
    let b = asin(attitude.inverse().apply(DVec3::X).z.clamp(-1.0, 1.0));
    let rest = Rotation::about_y(-b).after(attitude);
    [0.0, b, 2.0 * atan2(rest.u.z, rest.w)]
}

/// Angles of `Ry(b)∘Rx(c)` nearest to an attitude at gimbal lock, b ≈ ±90°.
fn locked_zyx(attitude: Rotation) -> [f64; 3] {
    let b = -asin(attitude.inverse().apply(DVec3::Z).x.clamp(-1.0, 1.0));
    let rest = Rotation::about_y(-b).after(attitude);
    [0.0, b, 2.0 * atan2(rest.u.x, rest.w)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::{degrees, radians};

    fn yaw_after(times: usize, bearing: f64) -> f64 {
        let q = DVec3::new(libm::sin(radians(bearing)), libm::cos(radians(bearing)), 0.3) * 100.0;
        let a = (0..times).fold(Rotation::IDENTITY, |a, _| align(a, q));
        degrees(reported_angles(a, None)[2])
    }

    #[test]
    fn alignment_hits_counter_clockwise_targets_and_doubles_small_clockwise_errors() {
        for (times, bearing, expected) in [(1, -40.0, 40.0), (1, 90.0, 270.0), (1, 0.3, 0.3), (2, 0.3, 0.9)] {
            assert!((yaw_after(times, bearing) - expected).abs() < 1e-6, "{times} to {bearing}°");
        }
        // 0.0125 rad ≤ error < 0.025 rad: the second call corrects it
        let second = yaw_after(2, 1.0);
        assert!((second - 359.0).abs() < 1.5, "{second}");
    }

    #[test]
    fn a_target_straight_above_keeps_the_heading() {
        let a = Rotation::about_z(1.0);
        assert_eq!(align(a, DVec3::new(0.0, 0.0, 5.0)), a);
    }

    #[test]
    fn targets_less_than_a_step_away_are_reached() {
        for (velocity, target, reached) in
            [(0.3, 0.29, true), (0.3, 0.3, false), (0.0, 0.3, false), (0.0, 0.0, false)]
        {
            let (velocity, target) = (DVec3::X * velocity, DVec3::X * target);
            let course = Course { velocity, target, ..Course::default() };
            assert_eq!(course.is_reached(), reached, "{target} at {velocity} per step");
        }
    }

    #[test]
    fn angles_at_gimbal_lock_compose_to_the_attitude() {
        let a = Rotation::about_x(0.4).after(Rotation::about_y(PI / 2.0)).after(Rotation::about_z(0.3));
        let [x, y, z] = reported_angles(a, None);
        let back = Rotation::about_x(x).after(Rotation::about_y(y)).after(Rotation::about_z(z));
        assert!((back.forward() - a.forward()).length() < 1e-6);
        let [roll, pitch, yaw] = reported_angles(a, Some(RotationSpec::Arinc705));
        let back = Rotation::about_z(-yaw).after(Rotation::about_y(roll)).after(Rotation::about_x(pitch));
        assert!((back.forward() - a.forward()).length() < 1e-6);
    }
}
