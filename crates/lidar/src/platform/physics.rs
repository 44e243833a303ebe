//! Acceleration against drag, shared by ground vehicle and multicopter (spec kinematics §2.4 step 5).

use super::course::LegCourse;
use vlscan_geom::{DVec3, unit};

/// Velocity (m per step) after one step under `force`, gravity included, and the drag `drag` per step.
pub(super) fn accelerated(velocity: DVec3, force: DVec3, drag: f64, leg: &LegCourse) -> DVec3 {
    let f = leg.frequency;
    let acceleration = force - velocity * (drag * f);
    let v = velocity + acceleration / f;
    let speed = v.length();
    if speed == 0.0 {
        return v;
    }
    unit(v) * if leg.step_length > 0.0 { speed.min(leg.step_length) } else { speed }
}
