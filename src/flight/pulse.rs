//! What a step of the flight yields.

use crate::geom::{DVec3, Rotation};

/// One emitted pulse (spec pulse-physics §0.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulse {
    /// Where the beam leaves, m, scene frame (world minus shift); platform noise included.
    pub origin: DVec3,
    /// Beam frame to scene; the beam leaves along the image of +Y. Errors and noise included.
    pub attitude: Rotation,
    /// The same without mechanical errors (and then without attitude noise), of which the instrument knows nothing.
    pub exact_attitude: Rotation,
    /// `exact_attitude` from the platform's pose as its navigation system reports it: points are reported along it.
    pub reported_attitude: Rotation,
    /// Reported minus true origin, m.
    pub origin_error: DVec3,
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
    /// Platform position as it is reported, m, scene frame.
    pub position: DVec3,
    /// rad.
    pub roll: f64,
    /// rad.
    pub pitch: f64,
    /// rad, 0 to 2π.
    pub yaw: f64,
    /// The attitude that the angles describe in the platform's own convention.
    pub attitude: Rotation,
    /// Position and attitude that were flown; those reported unless there are errors of navigation.
    pub flown: (DVec3, Rotation),
}

impl PoseSample {
    /// The sample with what was flown in place of what is reported. The angles stay.
    pub fn as_flown(&self) -> PoseSample {
        let (position, attitude) = self.flown;
        PoseSample { position, attitude, ..*self }
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
