//! The moving parts of a device: head and deflector.

use super::deflector::DeflectorState;
use super::head::HeadState;
use super::plan::DevicePlan;
use crate::geom::Rotation;
use crate::survey::ScannerSettings;
use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DeviceState {
    pub head: HeadState,
    pub deflector: DeflectorState,
    /// Pulses emitted so far, over all legs.
    pub pulses: u64,
    pub is_warmed_up: bool,
}

impl DeviceState {
    pub fn at_rest(plan: &DevicePlan) -> DeviceState {
        DeviceState {
            head: HeadState::default(),
            deflector: DeflectorState::at_rest(&plan.deflector),
            pulses: 0,
            is_warmed_up: false,
        }
    }

    /// Applies a leg's settings to the head, then to the deflector.
    pub fn start_leg(&mut self, plan: &DevicePlan, settings: &ScannerSettings) {
        self.is_warmed_up = false;
        let frequency = f64::from(settings.pulse_freq);
        let deflection = self.deflector.exact_angle();
        self.head.start_leg(plan, settings, frequency, deflection);
        self.deflector.start_leg(plan, settings, frequency);
    }

    #[inline]
    pub fn step_head(&mut self, plan: &DevicePlan) {
        // The head's error depends on the deflection of the step before.
        self.head.step(plan, self.deflector.exact_angle());
    }

    /// The emitter's attitude in the platform's mount frame: head, then emitter.
    pub fn emitter(&self, plan: &DevicePlan) -> Rotation {
        self.head.rotation(plan).after(plan.beam_origin.rotation)
    }

    /// [`DeviceState::emitter`] without the head's error.
    pub fn exact_emitter(&self, plan: &DevicePlan) -> Rotation {
        self.head.exact_rotation(plan).after(plan.beam_origin.rotation)
    }
}
