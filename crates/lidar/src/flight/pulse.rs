//! Output of a step of the flight: pulses and trajectory samples.

use vlscan_base::quantity;
use vlscan_geom::{DVec3, Rotation};

/// One emitted pulse (spec pulse-physics §0.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulse {
    /// Origin of the beam, m, scene frame (world minus shift), with platform noise.
    pub origin: DVec3,
    /// Rotation from the beam frame to the scene, with errors and noise; the beam leaves along the image of
    /// +Y.
    pub attitude: Rotation,
    /// Attitude known to the instrument: if there are mechanical errors, `attitude` without them and without
    /// attitude noise; otherwise `attitude`.
    pub exact_attitude: Rotation,
    /// `exact_attitude` relative to the platform attitude that the navigation system reports; determines the
    /// reported direction of points.
    pub reported_attitude: Rotation,
    /// Reported attitude of the scanner: rotation from the axes of its mount, within which head and deflector
    /// turn, to the scene. The identity for pulses that are read from a stream.
    pub scanner_attitude: Rotation,
    /// Reported minus true origin, m.
    pub origin_error: DVec3,
    /// Emission time, ns of the GPS week.
    pub time_ns: f64,
    /// Pulse number of its device, from 1, over all legs.
    pub number: u64,
    /// Index of the device.
    pub device: u32,
    /// The scan angle of LAS, rad: that of the reported beam from straight down across the direction of
    /// flight, positive to the right; without the correction `las_scan_angles` the deflection on the scanner
    /// without errors.
    pub scan_angle: f64,
    /// Error that is added to every range of this pulse, m.
    pub range_error: f64,
    /// Velocity of the origin by the motions of platform and head, m/s; `None` unless it is recorded
    /// ([`FlightSink::records_velocities`]).
    pub velocity: Option<DVec3>,
}

impl Pulse {
    /// True if attitude and range error are numbers; formulas can give others.
    pub(super) fn is_valid(&self) -> bool {
        self.attitude.w.is_finite()
            && self.attitude.u.is_finite()
            && quantity::NUMBER.contains(self.range_error)
    }
}

/// A sample of the platform's trajectory (spec kinematics §9).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSample {
    /// ns of the GPS week.
    pub time_ns: f64,
    /// Reported position of the platform, m, scene frame.
    pub position: DVec3,
    /// rad.
    pub roll: f64,
    /// rad.
    pub pitch: f64,
    /// rad, 0 to 2π.
    pub yaw: f64,
    /// The attitude that the angles describe in the platform's own convention.
    pub attitude: Rotation,
    /// True position and attitude; equal to the reported ones if there are no navigation errors.
    pub flown: (DVec3, Rotation),
}

impl PoseSample {
    /// This sample with true instead of reported position and attitude. The angles stay.
    pub fn as_flown(&self) -> PoseSample {
        let (position, attitude) = self.flown;
        PoseSample { position, attitude, ..*self }
    }
}

/// Receives the output of steps. Values are passed as closures, because the producer of chunks only counts
/// them while workers compute them.
pub trait FlightSink {
    /// A pulse is emitted.
    fn pulse(&mut self, pulse: impl FnOnce() -> Pulse);
    /// True if pulses need the velocity of their origin.
    fn records_velocities(&self) -> bool {
        false
    }

    /// The trajectory is sampled.
    fn pose(&mut self, pose: impl FnOnce() -> PoseSample);
}
