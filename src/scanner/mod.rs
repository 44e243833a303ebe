//! The instrument's moving optics: heads and deflectors per step (spec kinematics §4, §5).
//!
//! A [`DeviceState`] holds angles and counters only; rotations are composed when a pulse asks for them.

mod deflector;
mod head;
mod risley;

pub use deflector::DeflectorState;
pub(crate) use deflector::window;
pub use head::HeadState;

use crate::geom::{DVec3, Rotation, unit};
use crate::survey::{Deflector, Device, Kinematics, MechanicalErrors, Mount, ScannerSettings};

/// What never changes of one device.
#[derive(Clone, Debug)]
pub struct DevicePlan {
    /// Beam deflector.
    pub deflector: Deflector,
    /// Mechanical scan angle limit (half angle), rad.
    pub scan_angle_max: f64,
    /// Highest scan frequency, Hz.
    pub scan_freq_max: f64,
    /// Axis of the head, unit vector.
    pub head_axis: DVec3,
    /// Largest speed of the head, rad/s.
    pub head_max_rate: f64,
    /// The emitter's pose on the head.
    pub beam_origin: Mount,
    /// Calibration errors.
    pub errors: MechanicalErrors,
    /// Where the optics depart from the reference's.
    pub kinematics: Kinematics,
    /// Risley prisms.
    prisms: Option<risley::Train>,
}

impl DevicePlan {
    /// The plan of `device`.
    pub fn new(device: &Device, kinematics: Kinematics) -> DevicePlan {
        let axis = device.head.axis;
        let prisms = match &device.deflector {
            Deflector::Risley { prisms, air, incident } => Some(risley::Train::new(prisms, *air, *incident)),
            _ => None,
        };
        DevicePlan {
            deflector: device.deflector.clone(),
            scan_angle_max: device.scan_angle_max,
            scan_freq_max: device.scan_freq.1,
            head_axis: if axis.length() > 0.1 && axis.is_finite() { unit(axis) } else { DVec3::Z },
            head_max_rate: device.head.max_rate,
            beam_origin: device.beam_origin,
            errors: device.errors.clone(),
            kinematics,
            prisms,
        }
    }

    /// The head's speed in rad/s that `wanted` becomes on this device.
    pub fn head_rate(&self, wanted: f64) -> f64 {
        let limit = self.head_max_rate.abs();
        if limit.is_nan() { 0.0 } else { wanted.clamp(-limit, limit) }
    }

    /// The half angle in rad that a leg's `wanted` one becomes on this device (spec kinematics §4.1). The reference does not
    /// limit oscillating mirrors; neither can a device that names no limit.
    pub fn scan_angle(&self, wanted: f64) -> f64 {
        let limits = self.kinematics.oscillation_at_leg_frequency && self.scan_angle_max > 0.0;
        if matches!(self.deflector, Deflector::Oscillating { .. }) && !limits {
            return wanted;
        }
        let limited = if wanted < 0.0 { 0.0 } else { wanted.min(self.scan_angle_max) };
        if limited == 0.0 { self.scan_angle_max } else { limited }
    }
}

/// What moves of one device.
#[derive(Clone, Debug)]
pub struct DeviceState {
    /// The head.
    pub head: HeadState,
    /// The deflector.
    pub deflector: DeflectorState,
    /// Pulses emitted so far, over all legs.
    pub pulses: u64,
    /// The leg's warm-up is done.
    pub warm: bool,
}

impl DeviceState {
    /// The device before any leg.
    pub fn at_rest(plan: &DevicePlan) -> DeviceState {
        DeviceState {
            head: HeadState::default(),
            deflector: DeflectorState::at_rest(&plan.deflector),
            pulses: 0,
            warm: false,
        }
    }

    /// Takes a leg's settings: the head's first, then the deflector's.
    pub fn start_leg(&mut self, plan: &DevicePlan, settings: &ScannerSettings) {
        self.warm = false;
        let frequency = f64::from(settings.pulse_freq);
        let seen = self.deflector.exact_angle();
        self.head.start_leg(plan, settings, frequency, seen);
        self.deflector.start_leg(plan, settings, frequency);
    }

    /// Turns the head by one step.
    #[inline]
    pub fn step_head(&mut self, plan: &DevicePlan) {
        // The head's error looks at the deflector as the step before left it.
        self.head.step(plan, self.deflector.exact_angle());
    }

    /// The emitter's attitude in the platform's mount frame: head, then emitter.
    pub fn emitter(&self, plan: &DevicePlan) -> Rotation {
        self.head.rotation(plan).after(plan.beam_origin.rotation)
    }

    /// The same without the head's error.
    pub fn exact_emitter(&self, plan: &DevicePlan) -> Rotation {
        self.head.exact_rotation(plan).after(plan.beam_origin.rotation)
    }
}

#[cfg(test)]
pub mod testing {
    //! Devices for tests.

    use super::*;
    use crate::geom::radians;
    use crate::survey::Head;
    use crate::survey::testkit;
    pub use crate::survey::testkit::scanner_settings as settings;

    /// A device with the given deflector, 120° mechanical half angle and a free head.
    pub fn device(deflector: Deflector) -> Device {
        Device {
            deflector,
            scan_angle_max: radians(120.0),
            head: Head { axis: DVec3::Z, max_rate: radians(3600.0) },
            ..testkit::device()
        }
    }
}
