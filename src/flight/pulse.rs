//! What a step of the flight yields.

use crate::geom::{DVec3, Rotation};

/// One emitted pulse (spec pulse-physics §0.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulse {
    /// Where the beam leaves, m, scene frame (world minus shift); platform noise included.
    pub origin: DVec3,
    /// Beam frame to scene; the beam leaves along the image of +Y. Errors and noise included.
    pub attitude: Rotation,
    /// The same without mechanical errors (and then without attitude noise): points are reported along it.
    pub exact_attitude: Rotation,
    /// Emission time, ns of the GPS week.
    pub time_ns: f64,
    /// Number of the pulse among those of its device, from 1, going on over legs.
    pub number: u64,
    /// Index of the device.
    pub device: u32,
    /// Deflection angle of the beam without errors, rad: the scan angle of LAS.
    pub scan_angle: f64,
    /// Metres that the range error expression adds to every range of this pulse.
    pub range_error: f64,
}

/// A sample of the platform's trajectory (spec kinematics §9).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSample {
    /// ns of the GPS week.
    pub time_ns: f64,
    /// Platform position, m, scene frame.
    pub position: DVec3,
    /// rad.
    pub roll: f64,
    /// rad.
    pub pitch: f64,
    /// rad, 0 to 2π.
    pub yaw: f64,
    /// The attitude that the angles describe in the platform's own convention.
    pub attitude: Rotation,
}

impl PoseSample {
    /// Roll, pitch and yaw after ARINC 705 (`Rz(−yaw)∘Ry(roll)∘Rx(pitch)`, spec kinematics §2.6), rad, yaw clockwise from
    /// +y within [0, 2π): the convention in which `--trajectory` reads them, whatever the platform's own is. A platform
    /// that lies on its side has no pitch.
    pub fn arinc_angles(&self) -> [f64; 3] {
        let [about_z, roll, pitch] = self.attitude.angles_zyx().unwrap_or_else(|| {
            let (right, ahead) = (self.attitude.apply(DVec3::X), self.attitude.forward());
            let roll = std::f64::consts::FRAC_PI_2.copysign(-right.z);
            [libm::atan2(-ahead.x, ahead.y), roll, 0.0]
        });
        let yaw = if about_z > 0.0 { std::f64::consts::TAU - about_z } else { about_z.abs() };
        // No negative zeros.
        [roll + 0.0, pitch + 0.0, yaw]
    }
}

/// Takes what the steps of a flight yield. The values come as closures, because the producer of chunks only counts them
/// and only the workers compute them.
pub trait FlightSink {
    /// A pulse leaves.
    fn pulse(&mut self, pulse: impl FnOnce() -> Pulse);
    /// The trajectory is sampled.
    fn pose(&mut self, pose: impl FnOnce() -> PoseSample);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arinc_angles_compose_to_the_attitude() {
        let cases =
            [[0.1, -0.2, 5.0], [0.0, 0.0, 0.0], [-1.5, 0.3, 3.0], [std::f64::consts::FRAC_PI_2, 0.0, 2.0]];
        for [roll, pitch, yaw] in cases {
            let compose = |roll, pitch, yaw: f64| {
                Rotation::about_z(-yaw).after(Rotation::about_y(roll)).after(Rotation::about_x(pitch))
            };
            let attitude = compose(roll, pitch, yaw);
            let pose =
                PoseSample { time_ns: 0.0, position: DVec3::ZERO, roll: 9.0, pitch: 9.0, yaw: 9.0, attitude };
            let [r, p, y] = pose.arinc_angles();
            let again = compose(r, p, y);
            assert!((again.forward() - attitude.forward()).length() < 1e-9, "{roll} {pitch} {yaw}");
            assert!((again.apply(DVec3::X) - attitude.apply(DVec3::X)).length() < 1e-9);
            assert!((0.0..std::f64::consts::TAU).contains(&y));
        }
    }
}
