//! Origin and attitude of an emitted pulse (spec kinematics §3, §7.2).

use super::clock::WEEK_NS;
use super::leg::PlannedLeg;
use super::plan::FlightPlan;
use super::pulse::Pulse;
use crate::platform::PlatformState;
use crate::scanner::{DevicePlan, DeviceState};
use vlscan_base::error::Error;
use vlscan_geom::{DVec3, Rotation, unit};

/// Time over which the turn of a platform is taken, s.
const TURN_S: f64 = 1e-5;

/// Origin of the beam of a device from the head's axis, m.
#[inline]
fn origin_of_beam(plan: &DevicePlan, state: &DeviceState) -> DVec3 {
    match state.deflector.beam_origin(plan) {
        Some(origin) => plan.beam_origin.offset + plan.beam_origin.rotation.apply(origin),
        None => plan.beam_origin.offset,
    }
}

impl FlightPlan {
    /// The pulse that device `index` emits in a step, at `time_ns` and `since_start` seconds after the start
    /// of the flight, or later by its firing offset.
    pub(super) fn pulse(
        &self,
        platform: &PlatformState,
        leg: &PlannedLeg,
        index: usize,
        state: &DeviceState,
        time_ns: f64,
        since_start: f64,
    ) -> Pulse {
        let plan = &self.devices[index];
        let part = leg.part_of_step(plan);
        let later = (part > 0.0).then(|| state.within_step(plan, part));
        let state = later.as_ref().unwrap_or(state);
        let offset = if part > 0.0 { plan.firing_offset } else { 0.0 };
        let since_start = since_start + offset;
        let mount = leg.mount.as_ref().unwrap_or(&self.mount);
        let (device, emitted) = (index as u32, state.pulses - 1);
        let (has_noise, is_of_platform) =
            (self.noise.has_attitude(), self.kinematics.attitude_noise_of_platform);
        let with_noise = |attitude: Rotation| self.noise.apply_noise(attitude, device, emitted);
        let noisy_platform =
            |pointing| if has_noise && is_of_platform { with_noise(pointing) } else { pointing };
        let exact_deflection = state.deflector.exact_rotation(plan);
        let deflection =
            if state.deflector.has_error() { state.deflector.rotation(plan) } else { exact_deflection };
        // Beam attitudes for a platform attitude: with mechanical errors and noise, and without.
        let beam = |pointing: Rotation| {
            // A product in each branch: a rotation that is chosen first is copied through memory.
            let carrier = match has_noise && is_of_platform {
                true => with_noise(pointing).after(mount.rotation),
                false => pointing.after(mount.rotation),
            };
            let clean = carrier.after(state.emitter(plan)).after(deflection);
            let attitude = if has_noise && !is_of_platform { with_noise(clean) } else { clean };
            let exact = if plan.errors.any() {
                pointing.after(mount.rotation).after(state.exact_emitter(plan)).after(exact_deflection)
            } else {
                attitude
            };
            (attitude, exact)
        };
        let emitter = origin_of_beam(plan, state);
        let origin_at = |position: DVec3, pointing: Rotation| {
            let offset = mount.offset;
            if self.kinematics.mount_offsets_turn {
                let pointing = noisy_platform(pointing);
                let head = pointing.after(mount.rotation).after(state.head.rotation(plan));
                position + pointing.apply(offset) + head.apply(emitter)
            } else {
                position + offset + emitter
            }
        };
        let (position, pointing) = match part > 0.0 {
            true => platform.pose_within_step(&self.platform, offset, part),
            false => (platform.position(), platform.mount_attitude(&self.platform)),
        };
        let origin = origin_at(position, pointing);
        let (attitude, exact_attitude) = beam(pointing);
        let (origin_error, reported_attitude, reported_pointing) = match &self.navigation {
            Some(navigation) => {
                let (position, pointing) = navigation.reported(position, pointing, since_start);
                (origin_at(position, pointing) - origin, beam(pointing).1, pointing)
            }
            None => (DVec3::ZERO, exact_attitude, pointing),
        };
        Pulse {
            origin: origin + self.noise.position_offset(device, emitted),
            attitude,
            exact_attitude,
            reported_attitude,
            scanner_attitude: reported_pointing.after(mount.rotation),
            origin_error,
            time_ns: match platform.time_origin(&self.platform) {
                _ if part == 0.0 => time_ns,
                None => within_week(time_ns + offset * 1e9),
                Some(_) => time_ns + offset * 1e9,
            },
            number: state.pulses,
            device,
            scan_angle: match self.kinematics.las_scan_angles {
                true => {
                    angle_across(reported_attitude.forward(), platform.direction_of_travel(&self.platform))
                }
                false => state.deflector.scan_angle(&exact_deflection),
            },
            range_error: plan.errors.range.as_ref().map_or(0.0, |e| e.eval(state.deflector.exact_angle())),
            velocity: None,
        }
    }

    /// Velocity of the origin of a pulse of device `index`, m/s, without noise: that of the platform, and of
    /// mount and emitter as platform and head turn.
    #[inline(never)]
    pub(super) fn velocity(
        &self,
        platform: &PlatformState,
        leg: &PlannedLeg,
        index: usize,
        state: &DeviceState,
    ) -> DVec3 {
        let plan = &self.devices[index];
        let part = leg.part_of_step(plan);
        let later = (part > 0.0).then(|| state.within_step(plan, part));
        let state = later.as_ref().unwrap_or(state);
        let mount = leg.mount.as_ref().unwrap_or(&self.mount);
        let velocity = platform.velocity(&self.platform, leg.frequency);
        if !self.kinematics.mount_offsets_turn {
            return velocity;
        }
        let offset = if part > 0.0 { plan.firing_offset } else { 0.0 };
        let pose_after = |seconds: f64| {
            let steps = seconds * leg.frequency;
            platform.pose_within_step(&self.platform, offset + seconds, part + steps).1
        };
        let (pointing, soon) = (pose_after(0.0), pose_after(TURN_S));
        let base = pointing.after(mount.rotation);
        let emitter = base.after(state.head.rotation(plan)).apply(origin_of_beam(plan, state));
        // The vector part of a small rotation is half of its angle.
        let turn = soon.after(pointing.inverse());
        let turn_rate = turn.u * (2.0 * turn.w.signum() / TURN_S);
        let head_rate = base.apply(unit(plan.head_axis)) * state.head.rate();
        velocity + turn_rate.cross(pointing.apply(mount.offset) + emitter) + head_rate.cross(emitter)
    }

    /// The error of a formula that has no value at a pulse of device `index`.
    #[cold]
    pub(super) fn formula_error(&self, leg: &PlannedLeg, index: usize, state: &DeviceState) -> Error {
        let plan = &self.devices[index];
        let part = leg.part_of_step(plan);
        if part > 0.0 { state.within_step(plan, part).formula_error(plan) } else { state.formula_error(plan) }
    }
}

impl PlannedLeg {
    /// The part of a step, from 0 to 1, by which the pulse of `device` is later than the start of the step.
    #[inline]
    pub(super) fn part_of_step(&self, device: &DevicePlan) -> f64 {
        if self.fires_at_once { 0.0 } else { device.firing_offset * self.frequency }
    }
}

/// The scan angle of LAS (ASPRS LAS 1.4, point formats 6 to 10; the rank of formats 0 to 5 has the same
/// sense), rad: that of the beam from straight down about the direction of flight `way`, positive to the
/// right; ±π is straight up. A tripod has no direction of flight: the angle is that from straight down.
fn angle_across(beam: DVec3, way: Option<DVec3>) -> f64 {
    // Adding 0 removes negative zeros, whose angles are half turns.
    let down = 0.0 - beam.z;
    match way {
        Some(way) => {
            let to_right = beam.x * way.y - beam.y * way.x + 0.0;
            libm::atan2(to_right, down * (way.x * way.x + way.y * way.y).sqrt())
        }
        None => libm::atan2((beam.x * beam.x + beam.y * beam.y).sqrt(), down),
    }
}

fn within_week(time_ns: f64) -> f64 {
    if time_ns > WEEK_NS { time_ns - WEEK_NS } else { time_ns }
}
