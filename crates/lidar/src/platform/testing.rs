//! Platforms for tests.

use super::course::{LegCourse, LegEntry};
use vlscan_geom::DVec3;
use vlscan_survey::Multicopter;

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// The multicopter of the golden sequences (spec kinematics §11.3).
pub const MULTICOPTER: Multicopter = Multicopter {
    drag: 0.01,
    engine_max_force: 0.1,
    speedup: 2.0,
    slowdown: 2.0,
    base_pitch: -5.0 * DEGREE,
    pitch_speed: 85.94 * DEGREE,
    roll_speed: 28.65 * DEGREE,
    yaw_speed: 85.94 * DEGREE,
    pitch_offset: 35.0 * DEGREE,
    roll_offset: 25.0 * DEGREE,
};

/// A leg at 100 steps per second.
pub fn course(position: [f64; 3], speed: f64) -> LegCourse {
    LegCourse {
        position: DVec3::from(position),
        frequency: 100.0,
        speed,
        step_length: speed / 100.0,
        stop_and_turn: true,
        smooth_turn: false,
        slowdown: true,
        yaw_at_departure: None,
        span: None,
    }
}

pub fn entry(leg: usize) -> LegEntry {
    if leg == 0 { LegEntry::Initial } else { LegEntry::Continuing }
}
