//! Where the beam of a flown scanner meets the ground.

use super::mirror::{MIRROR_PARAMETERS, Mirror};
use libm::{atan2, cos, sin};
use vlscan_geom::DVec3;

/// Parameters of the platform, which precede those of the mirror.
pub const PLATFORM_PARAMETERS: usize = 10;
/// Maximum number of parameters.
pub const MAX_PARAMETERS: usize = PLATFORM_PARAMETERS + MIRROR_PARAMETERS;

/// A flight with its scanner.
///
/// The platform moves along a parabola and has a constant attitude; deviations of single lines from it are [`Attitude`]s.
#[derive(Clone, Debug)]
pub struct Model {
    /// What moves the beam.
    pub mirror: Mirror,
    /// Place at time 0 (x, y: m), velocity (m/s), acceleration (m/s²), height at time 0 (m), climb (m/s), roll, pitch (rad), and
    /// the parameters of the mirror.
    pub parameters: [f64; MAX_PARAMETERS],
}

/// Deviation of the attitude of one line: roll, pitch, yaw, rad. A cone turns by its yaw just as by the phase of its mirror.
pub type Attitude = [f64; 3];

/// Where a beam meets the height of a point, and its scan angle.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    /// m.
    pub x: f64,
    /// m.
    pub y: f64,
    /// Across the track, positive to the right, rad.
    pub angle: f64,
}

impl Model {
    /// Number of parameters.
    pub fn count(&self) -> usize {
        PLATFORM_PARAMETERS + self.mirror.count()
    }

    /// Position of the platform at `time`, m.
    pub fn position(&self, time: f64) -> DVec3 {
        let p = &self.parameters;
        let half = 0.5 * time * time;
        DVec3::new(p[0] + p[2] * time + p[4] * half, p[1] + p[3] * time + p[5] * half, p[6] + p[7] * time)
    }

    /// Course at time 0, rad, clockwise from north (+y).
    pub fn course(&self) -> f64 {
        atan2(self.parameters[2], self.parameters[3])
    }

    /// Parameters of the mirror.
    pub fn of_mirror(&self) -> &[f64] {
        &self.parameters[PLATFORM_PARAMETERS..]
    }

    /// Direction of the beam in the axes right, forward, up of the course, unit vector.
    pub fn direction(&self, attitude: &Attitude, time: f64) -> DVec3 {
        let beam = self.mirror.direction(self.of_mirror(), time);
        let roll = self.parameters[8] + attitude[0];
        let pitch = self.parameters[9] + attitude[1];
        turned(beam, roll, pitch, attitude[2])
    }

    /// Where the beam of `time` meets `height`.
    pub fn footprint(&self, attitude: &Attitude, time: f64, height: f64) -> Footprint {
        let beam = self.direction(attitude, time);
        let place = self.position(time);
        let scale = (place.z - height) / -beam.z;
        let course = self.course();
        let (sin, cos) = (sin(course), cos(course));
        Footprint {
            x: place.x + scale * (beam.x * cos + beam.y * sin),
            y: place.y + scale * (beam.y * cos - beam.x * sin),
            angle: atan2(beam.x, -beam.z),
        }
    }
}

/// A vector of the body in the axes right, forward, up of the course: first roll (right side down), then pitch (nose up), then
/// yaw (to the right).
fn turned(v: DVec3, roll: f64, pitch: f64, yaw: f64) -> DVec3 {
    let (s, c) = (sin(roll), cos(roll));
    let v = DVec3::new(c * v.x + s * v.z, v.y, c * v.z - s * v.x);
    let (s, c) = (sin(pitch), cos(pitch));
    let v = DVec3::new(v.x, c * v.y - s * v.z, s * v.y + c * v.z);
    let (s, c) = (sin(yaw), cos(yaw));
    DVec3::new(c * v.x + s * v.y, c * v.y - s * v.x, v.z)
}
