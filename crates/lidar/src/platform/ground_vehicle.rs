//! A vehicle that steers towards its waypoints and backs up where their bearing is too large (spec kinematics
//! §2.4).

use super::course::{Course, LegCourse, LegEntry, align, facing, horizontal, horizontal_unit};
use super::physics::accelerated;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, Rotation};

/// Engine force when driving forwards, and backwards.
pub(super) const CRUISE_FORCE: f64 = 0.02;
const REVERSE_FORCE: f64 = -0.01;
const MAX_FORCE: f64 = 0.2;
const FORCE_RAMP: f64 = 1e-4;
/// Targets at a larger angle to the nose need backing up, rad, and the cosine of it.
const WIDE_ANGLE: f64 = PI / 5.0;
const COS_WIDE_ANGLE: f64 = 0.809_016_994_374_947_5;
/// Change of heading at full steering lock, rad per metre, forwards and backwards.
const FULL_LOCK: f64 = 0.1;
const REVERSE_LOCK: f64 = 0.25;
/// Length of the move before backing up, and the distance from its end at which it is complete, m.
const PULL_OUT: f64 = 1.0;
const PULL_OUT_TOLERANCE: f64 = 0.5;

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum Manoeuvre {
    Drive,
    PullOutTo(DVec3),
    BackUp,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GroundVehicle {
    pub(super) course: Course,
    pub(super) attitude: Rotation,
    force: f64,
    target_force: f64,
    manoeuvre: Manoeuvre,
}

impl Default for GroundVehicle {
    fn default() -> GroundVehicle {
        GroundVehicle {
            course: Course::default(),
            attitude: Rotation::IDENTITY,
            force: 0.0,
            target_force: 0.0,
            manoeuvre: Manoeuvre::Drive,
        }
    }
}

impl GroundVehicle {
    pub(super) fn start_leg(
        &mut self,
        legs: &[LegCourse],
        leg: usize,
        entry: LegEntry,
        kinematics: &Corrections,
    ) {
        if self.course.start_leg(legs, leg, entry) {
            self.manoeuvre = Manoeuvre::Drive;
        }
        if entry == LegEntry::Initial {
            let way = self.course.to_target();
            self.attitude = if kinematics.heading_along_leg {
                facing(way).unwrap_or(self.attitude)
            } else {
                align(self.attitude, way)
            };
        }
    }

    /// Takes one step. With `follows_heights` the vehicle climbs from waypoint to waypoint, otherwise it
    /// keeps its height.
    pub(super) fn step(&mut self, drag: f64, leg: &LegCourse, follows_heights: bool) {
        self.course.position += self.course.velocity;
        let slope = if follows_heights { self.slope() } else { Slope::LEVEL };
        if let Some(height) = slope.height {
            self.course.position.z = height;
        }
        let turn = self.steer();
        if turn != 0.0 {
            self.attitude = Rotation::about_z(turn).after(self.attitude);
        }
        self.force =
            (self.force + sign(self.target_force - self.force) * FORCE_RAMP).clamp(-MAX_FORCE, MAX_FORCE);
        let forward = horizontal_unit(self.attitude.forward()).unwrap_or(DVec3::ZERO);
        // The speed of the leg is that along the slope.
        let leg = LegCourse { step_length: leg.step_length * slope.cosine, ..*leg };
        let level = accelerated(horizontal(self.course.velocity), forward * self.force, drag, &leg);
        self.course.velocity = level + DVec3::Z * level.dot(slope.gradient);
    }

    /// The slope of the straight line from the last waypoint to the next where the vehicle is, which may be
    /// beside it.
    fn slope(&self) -> Slope {
        let Course { position, origin, target, .. } = self.course;
        let (way, climb) = (horizontal(target - origin), target.z - origin.z);
        let length_squared = way.length_squared();
        if length_squared == 0.0 {
            return Slope::LEVEL;
        }
        let share = way.dot(position - origin) / length_squared;
        let height = Some(origin.z + share.clamp(0.0, 1.0) * climb);
        if !(0.0..1.0).contains(&share) {
            return Slope { height, ..Slope::LEVEL };
        }
        let cosine = (length_squared / (length_squared + climb * climb)).sqrt();
        Slope { height, gradient: way * (climb / length_squared), cosine }
    }

    /// Continues the manoeuvre; returns the change of heading of this step, rad, counter-clockwise.
    fn steer(&mut self) -> f64 {
        let q = horizontal(self.course.to_target());
        let travel = horizontal(self.course.velocity).length();
        match self.manoeuvre {
            Manoeuvre::Drive if q.length() > 0.0 => {
                self.target_force = CRUISE_FORCE;
                let bearing = self.bearing(q);
                if bearing.wide {
                    self.manoeuvre =
                        Manoeuvre::PullOutTo(self.course.position + self.attitude.forward() * PULL_OUT);
                    return 0.0;
                }
                bearing.side * FULL_LOCK * travel
            }
            Manoeuvre::Drive => 0.0,
            Manoeuvre::PullOutTo(place) => {
                if (self.course.position - place).length() < PULL_OUT_TOLERANCE {
                    self.manoeuvre = Manoeuvre::BackUp;
                }
                0.0
            }
            Manoeuvre::BackUp => {
                let bearing = self.bearing(q);
                if !bearing.wide {
                    self.manoeuvre = Manoeuvre::Drive;
                    return 0.0;
                }
                self.target_force = REVERSE_FORCE;
                bearing.side * REVERSE_LOCK * travel
            }
        }
    }

    /// Side of the nose on which `q` lies: axis and angle of the rotation from `q` to the nose.
    fn bearing(&self, q: DVec3) -> Bearing {
        let nose = horizontal_unit(self.attitude.forward()).unwrap_or(DVec3::ZERO);
        let lengths = (q.dot(q) * nose.dot(nose)).sqrt();
        if lengths == 0.0 {
            return Bearing { side: -1.0, wide: false };
        }
        // The cosine decides, unless it is so close to the limit that rounding could matter.
        let margin = q.dot(nose) / lengths - COS_WIDE_ANGLE;
        let wide = if margin.abs() > 1e-9 {
            margin < 0.0
        } else {
            Rotation::between(q, nose).axis_angle().1 >= WIDE_ANGLE
        };
        Bearing { side: if q.x * nose.y - q.y * nose.x < 0.0 { 1.0 } else { -1.0 }, wide }
    }
}

/// The ground that a vehicle follows.
struct Slope {
    /// Height of the vehicle, m; `None` where it keeps its own.
    height: Option<f64>,
    /// Climb per horizontal metre along x and y.
    gradient: DVec3,
    /// Cosine of its angle along the way.
    cosine: f64,
}

impl Slope {
    const LEVEL: Slope = Slope { height: None, gradient: DVec3::ZERO, cosine: 1.0 };
}

struct Bearing {
    /// +1: to the left, −1: straight ahead or to the right.
    side: f64,
    /// True if the angle exceeds [`WIDE_ANGLE`].
    wide: bool,
}

fn sign(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::course::reported_angles;
    use crate::platform::testing::{course, entry};

    #[test]
    fn speed_ramps_up_and_reaches_the_cap() {
        // spec kinematics §2.8 example 3
        let legs = [course([0.0, 0.0, 0.0], 3.0), course([0.0, 1000.0, 0.0], 3.0)];
        let mut car = GroundVehicle::default();
        car.start_leg(&legs, 0, entry(0), &Corrections::NONE);
        let speeds: Vec<f64> = (0..400)
            .map(|_| {
                car.step(0.005, &legs[0], false);
                car.course.velocity.length() * 100.0
            })
            .collect();
        for (found, reference) in speeds.iter().zip([0.0001, 0.0002995, 0.0005980025, 0.0009950124875]) {
            assert!((found - reference).abs() < 1e-12, "{found} is not {reference}");
        }
        assert!(speeds[382] < 3.0 - 1e-9 && (speeds[383] - 3.0).abs() < 1e-9);
    }

    #[test]
    fn golden_run() {
        // spec kinematics §11.4
        let legs =
            [[0.0, 0.0], [20.0, 3.0], [20.0, 40.0], [0.0, 50.0]].map(|[x, y]| course([x, y, 0.0], 3.0));
        let golden: [&[(usize, f64, f64, f64)]; 2] = [
            &[
                (0, 0.0, 0.0, 278.5308),
                (100, 0.1507, 0.0226, 278.5183),
                (500, 8.8014, 1.3202, 278.4451),
                (877, 19.9863, 2.9980, 278.6170),
            ],
            &[
                (0, 20.0160, 3.0024, 278.6170),
                (50, 21.4981, 3.2330, 292.7977),
                (150, 24.2706, 3.9611, 331.7342),
                (300, 27.2370, 6.0469, 352.8187),
                (600, 28.8437, 14.4726, 19.2333),
                (1502, 20.0155, 39.9966, 26.6245),
            ],
        ];
        let mut car = GroundVehicle::default();
        for (leg, rows) in golden.iter().enumerate() {
            car.start_leg(&legs, leg, entry(leg), &Corrections::NONE);
            let last = rows.last().unwrap().0;
            for step in 0..=last {
                assert!(!car.course.is_reached(), "leg {leg} ends before step {step}");
                car.step(0.005, &legs[leg], false);
                if let Some(row) = rows.iter().find(|r| r.0 == step) {
                    let yaw = reported_angles(car.attitude, None)[2].to_degrees();
                    let p = car.course.position;
                    let off = (p.x - row.1).abs().max((p.y - row.2).abs());
                    assert!(off < 1e-4, "leg {leg} step {step}: {p}");
                    assert!((yaw - row.3).abs() < 1e-4, "leg {leg} step {step}: yaw {yaw}");
                }
            }
            assert!(car.course.is_reached(), "leg {leg} does not end after step {last}");
        }
    }

    #[test]
    fn heights_lie_on_the_line_between_the_waypoints() {
        // Up by 20 m on 50 m, then level, then down: the speed is that along the slope.
        let legs = [[0.0, 0.0, 5.0], [0.0, 50.0, 25.0], [0.0, 90.0, 25.0], [0.0, 130.0, 0.0]]
            .map(|p| course(p, 3.0));
        let mut car = GroundVehicle::default();
        for leg in 0..3 {
            car.start_leg(&legs, leg, entry(leg), &Corrections::MOTION);
            let (from, to) = (legs[leg].position, legs[leg + 1].position);
            let mut steps = 0;
            while !car.course.is_reached() {
                let before = car.course.position;
                car.step(0.005, &legs[leg], true);
                let p = car.course.position;
                let line = from.z + (p.y - from.y) / (to.y - from.y) * (to.z - from.z);
                assert!((p.z - line).abs() < 0.02 && p.x.abs() < 0.05, "leg {leg}: {p}");
                assert!((p - before).length() < 0.033, "leg {leg}: {}", (p - before).length());
                steps += 1;
                assert!(steps < 10_000, "leg {leg} does not end");
            }
            if leg > 0 {
                let expected = (to - from).length() / 0.03;
                assert!(
                    (f64::from(steps) / expected - 1.0).abs() < 0.03,
                    "leg {leg}: {steps} for {expected}"
                );
            }
        }
    }
}
