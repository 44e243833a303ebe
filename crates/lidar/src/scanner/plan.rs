//! The constants of a device.

use super::risley::PrismTrain;
use std::f64::consts::TAU;
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, Rotation, unit};
use vlscan_survey::{Deflector, Device, MechanicalErrors, Mount, ScanMotion};

/// The constant properties of one device of a scanner that determine its beam directions.
#[derive(Clone, Debug)]
pub struct DevicePlan {
    /// The mechanism that deflects the beam.
    pub deflector: Deflector,
    /// Sense, phase, tilt and wander of the deflector.
    pub motion: ScanMotion,
    /// Rotation after the deflection, where the deflector's axis is tilted.
    pub axis_tilt: Option<Rotation>,
    /// Mechanical scan angle limit (half angle), rad.
    pub scan_angle_max: f64,
    /// Hz.
    pub scan_freq_max: f64,
    /// Axis of the head, unit vector.
    pub head_axis: DVec3,
    /// rad/s.
    pub head_max_rate: f64,
    /// Position and attitude of the beam origin within the scanner frame.
    pub beam_origin: Mount,
    /// Time from the start of a firing cycle to the pulse, s; 0 without the correction `firing_offsets`.
    pub firing_offset: f64,
    /// Mechanical calibration errors: formulae for range, deflection angle and head angle.
    pub errors: MechanicalErrors,
    /// Corrections of the reference's kinematics that are enabled.
    pub kinematics: Corrections,
    /// True if the beam may have no direction at some time: by a formula of an error, or a pattern of a
    /// program's own.
    pub may_lack_deflection: bool,
    pub(super) prisms: Option<PrismTrain>,
}

impl DevicePlan {
    /// The plan of `device`, with the head axis normalised and the Risley prisms, if any, prepared.
    pub fn new(device: &Device, kinematics: Corrections) -> DevicePlan {
        let axis = device.head.axis;
        let prisms = match &device.deflector {
            Deflector::Risley { prisms, air, incident } => Some(PrismTrain::new(prisms, *air, *incident)),
            _ => None,
        };
        let motion = device.scan_motion.clone();
        let [x, z] = motion.axis_tilt;
        let is_tilted = x != 0.0 || z != 0.0;
        DevicePlan {
            deflector: device.deflector.clone(),
            axis_tilt: is_tilted.then(|| Rotation::about_z(z).after(Rotation::about_x(x))),
            motion,
            scan_angle_max: device.scan_angle_max,
            scan_freq_max: device.scan_freq.1,
            head_axis: if axis.length() > 0.1 && axis.is_finite() { unit(axis) } else { DVec3::Z },
            head_max_rate: device.head.max_rate,
            beam_origin: device.beam_origin,
            firing_offset: if kinematics.firing_offsets { device.firing_offset } else { 0.0 },
            errors: device.errors.clone(),
            kinematics,
            may_lack_deflection: device.errors.deflection.is_some()
                || matches!(device.deflector, Deflector::Custom(_)),
            prisms,
        }
    }

    /// +1, or −1 where the deflector is reversed.
    #[inline]
    pub(super) fn sense(&self) -> f64 {
        if self.motion.is_reversed { -1.0 } else { 1.0 }
    }

    /// The phase at which the deflector restarts, in turns from 0 to 1.
    #[inline]
    pub(super) fn start_turns(&self) -> f64 {
        self.motion.phase / TAU
    }

    /// Turns per second of the first prism that turns; 0 without one.
    pub(super) fn prism_freq(&self) -> f64 {
        match &self.deflector {
            Deflector::Risley { prisms, .. } => {
                prisms.iter().map(|prism| prism.rotor_freq).find(|freq| *freq != 0.0).unwrap_or(0.0)
            }
            _ => 0.0,
        }
    }

    /// Tilts of the facets of a polygon mirror, rad.
    #[inline]
    pub fn facet_tilts(&self) -> &[f64] {
        match &self.deflector {
            Deflector::Polygon { facet_tilts, .. } => facet_tilts,
            _ => &[],
        }
    }

    /// `requested` within the device's limits of the head's speed, rad/s.
    pub fn head_rate(&self, requested: f64) -> f64 {
        let limit = self.head_max_rate.abs();
        if limit.is_nan() { 0.0 } else { requested.clamp(-limit, limit) }
    }

    /// Half angle, rad, that this device uses when a leg requests `requested` (spec kinematics §4.1). The
    /// reference does not limit oscillating mirrors.
    pub fn scan_angle(&self, requested: f64) -> f64 {
        let limits = self.kinematics.oscillation_at_leg_frequency && self.scan_angle_max > 0.0;
        if matches!(self.deflector, Deflector::Oscillating { .. }) && !limits {
            return requested;
        }
        let limited = if requested < 0.0 { 0.0 } else { requested.min(self.scan_angle_max) };
        if limited == 0.0 { self.scan_angle_max } else { limited }
    }
}
