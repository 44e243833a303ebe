//! The rotating head (spec kinematics §5).

use super::plan::DevicePlan;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};
use vlscan_base::error::Result;
use vlscan_geom::{Rotation, add_repeatedly};
use vlscan_survey::ScannerSettings;

/// Angle and motion of the head.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct HeadState {
    /// Accumulated exact angle, rad; with the correction `optics_on_time` that of the next step.
    angle: f64,
    /// The deflection of which the head's error is a function, once the head has moved.
    error_at: Option<f64>,
    /// rad/s, limited by the device.
    rate: f64,
    /// rad per step.
    step: f64,
    /// The angle at which the leg ends, rad.
    stop: f64,
    /// The rotations with and without error of a head that does not turn during the leg.
    still: Option<[Rotation; 2]>,
}

impl HeadState {
    pub(super) fn start_leg(
        &mut self,
        plan: &DevicePlan,
        settings: &ScannerSettings,
        frequency: f64,
        deflection: f64,
    ) {
        self.rate = plan.head_rate(settings.head_rate);
        self.step = self.rate / frequency;
        self.stop = settings.head_stop;
        self.set(plan, settings.head_start, deflection);
        self.still = None;
        if self.rate == 0.0 {
            self.still = Some([self.rotation(plan), self.exact_rotation(plan)]);
        }
    }

    /// Speed, rad/s.
    pub fn rate(&self) -> f64 {
        self.rate
    }

    #[inline]
    pub(super) fn step(&mut self, plan: &DevicePlan, deflection: f64) {
        if self.rate != 0.0 {
            self.set(plan, self.angle + self.step, deflection);
        }
    }

    /// Turns to where it is `seconds` after the start of the leg at the angle `start`, rad.
    pub(super) fn turn_to(&mut self, plan: &DevicePlan, start: f64, seconds: f64, deflection: f64) {
        if self.rate != 0.0 {
            self.set(plan, start + self.rate * seconds + self.step, deflection);
        }
    }

    /// Seconds, at least, before the leg's turn is completed; infinite for a turn that never is.
    pub fn seconds_to_completion(&self) -> f64 {
        match self.is_completed() {
            true => 0.0,
            false if self.rate == 0.0 => f64::INFINITY,
            false => (self.stop - self.angle).abs() / self.rate.abs(),
        }
    }

    #[inline]
    fn set(&mut self, plan: &DevicePlan, angle: f64, deflection: f64) {
        if angle != self.angle {
            self.angle = angle;
            if plan.errors.head.is_some() {
                self.error_at = Some(deflection);
            }
        }
    }

    /// Number of steps, at least, before the leg's turn is completed; infinite for a turn that never is.
    pub fn steps_to_completion(&self) -> f64 {
        if self.is_completed() {
            return 0.0;
        }
        if self.step == 0.0 {
            return f64::INFINITY;
        }
        ((self.stop - self.angle).abs() / self.step.abs() * (1.0 - 1e-6)).floor() - 4.0
    }

    /// Takes `steps` steps of a head without an error.
    pub fn advance(&mut self, steps: u32) {
        if self.rate != 0.0 {
            self.angle = add_repeatedly(self.angle, self.step, steps);
        }
    }

    /// The head `part` of a step later, with the error that it has now.
    pub fn within_step(&self, part: f64) -> HeadState {
        HeadState { angle: self.angle + self.step * part, ..self.clone() }
    }

    /// Turns by `steps` steps at once, which rounds otherwise than single steps.
    pub fn jump(&mut self, steps: f64) {
        if self.rate != 0.0 {
            self.angle += self.step * steps;
        }
    }

    #[inline]
    pub fn is_completed(&self) -> bool {
        if self.rate < 0.0 { self.angle <= self.stop } else { self.angle >= self.stop }
    }

    /// The angle at the time of the last step without error, rad.
    fn exact_angle(&self, plan: &DevicePlan) -> f64 {
        if plan.kinematics.optics_on_time { self.angle - self.step } else { self.angle }
    }

    /// The angle with its error, rad.
    pub fn angle_with_error(&self, plan: &DevicePlan) -> f64 {
        let angle = self.exact_angle(plan);
        match (&plan.errors.head, self.error_at) {
            (Some((error, distance)), Some(at)) => angle + error.eval(avoid_multiples_of_pi(at, *distance)),
            _ => angle,
        }
    }

    /// The head's error, rad, or the error of a formula without a value.
    pub fn error(&self, plan: &DevicePlan) -> Result<f64> {
        match (&plan.errors.head, self.error_at) {
            (Some((error, distance)), Some(at)) => {
                error.number("head error", avoid_multiples_of_pi(at, *distance))
            }
            _ => Ok(0.0),
        }
    }

    /// The rotation `first`, then that of the head.
    #[inline]
    pub fn turned(&self, plan: &DevicePlan, first: Rotation) -> Rotation {
        match &self.still {
            Some([with_error, _]) => with_error.after(first),
            None => self.rotation(plan).after(first),
        }
    }

    pub fn rotation(&self, plan: &DevicePlan) -> Rotation {
        match &self.still {
            Some([with_error, _]) => *with_error,
            None => Rotation::about(plan.head_axis, self.angle_with_error(plan) % TAU),
        }
    }

    pub fn exact_rotation(&self, plan: &DevicePlan) -> Rotation {
        match &self.still {
            Some([_, exact]) => *exact,
            None => Rotation::about(plan.head_axis, self.exact_angle(plan) % TAU),
        }
    }

    /// The completed fraction of the leg's turn; `None` when the head does not turn.
    pub fn progress(&self, start: f64) -> Option<f64> {
        let total = self.stop - start;
        (self.rate != 0.0 && total != 0.0).then(|| ((self.angle - start) / total).clamp(0.0, 1.0))
    }
}

/// `angle` moved out of the intervals of half width `distance` around 0, ±π and ±2π, to the nearer end.
fn avoid_multiples_of_pi(angle: f64, distance: f64) -> f64 {
    for (centre, side_at_centre) in [(0.0, 1.0), (-PI, 1.0), (PI, 1.0), (-TAU, 1.0), (TAU, -1.0)] {
        let off = angle - centre;
        if off.abs() < distance {
            let side = if off == 0.0 { side_at_centre } else { off.signum() };
            return centre + side * distance;
        }
    }
    angle
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scanner::testing::{device, settings};
    use vlscan_base::corrections::Corrections;
    use vlscan_geom::{DVec3, degrees, radians};
    use vlscan_survey::{Deflector, Device};

    fn head(device: &Device, frequency: u32, rate: f64, start: f64, stop: f64) -> (DevicePlan, HeadState) {
        let plan = DevicePlan::new(device, Corrections::NONE);
        let mut s = settings(frequency);
        (s.head_rate, s.head_start, s.head_stop) = (radians(rate), radians(start), radians(stop));
        let mut head = HeadState::default();
        head.start_leg(&plan, &s, f64::from(frequency), 0.0);
        (plan, head)
    }

    fn steps_to_completion(frequency: u32, rate: f64, start: f64, stop: f64) -> (usize, f64) {
        let (plan, mut head) = head(&device(Deflector::Conic), frequency, rate, start, stop);
        let mut steps = 0;
        while !head.is_completed() {
            head.step(&plan, 0.0);
            steps += 1;
        }
        (steps, degrees(head.angle))
    }

    #[test]
    fn completion_takes_the_accumulated_angle() {
        // spec kinematics §5.1
        let (steps, last) = steps_to_completion(5, 7.0, 10.0, 20.0);
        assert_eq!(steps, 8);
        assert!((last - 21.2).abs() < 1e-9);
        assert_eq!(steps_to_completion(100, 36.0, 0.0, 9.0).0, 26);
        assert_eq!(steps_to_completion(100, -36.0, 1.0, 0.0).0, 3);
        assert_eq!(steps_to_completion(100, 0.0, 0.0, 0.0).0, 0);
    }

    #[test]
    fn on_time_the_first_pulse_leaves_at_the_start_angle() {
        let mut d = device(Deflector::Conic);
        d.head.axis = DVec3::Z;
        let plan = DevicePlan::new(&d, Corrections::MOTION);
        let mut s = settings(5);
        (s.head_rate, s.head_start, s.head_stop) = (radians(7.0), radians(10.0), radians(20.0));
        let mut head = HeadState::default();
        head.start_leg(&plan, &s, 5.0, 0.0);
        // As many steps as in the reference, of which none is beyond the stop.
        for k in 0..8 {
            assert!(!head.is_completed());
            head.step(&plan, 0.0);
            assert!((degrees(head.angle_with_error(&plan)) - 10.0 - 1.4 * f64::from(k)).abs() < 1e-9, "{k}");
        }
        assert!(head.is_completed());
    }

    #[test]
    fn the_device_limits_the_rate() {
        let mut d = device(Deflector::Conic);
        d.head.max_rate = radians(10.0);
        let (_, h) = head(&d, 10, -50.0, 0.0, -90.0);
        assert!((h.rate + radians(10.0)).abs() < 1e-15);
        d.head.max_rate = 0.0;
        assert_eq!(head(&d, 10, 50.0, 0.0, 90.0).1.rate, 0.0);
    }

    #[test]
    fn errors_avoid_multiples_of_pi() {
        let z = 0.1;
        for (angle, expected) in [
            (0.0, z),
            (-0.05, -z),
            (0.5, 0.5),
            (PI, PI + z),
            (-PI, -PI + z),
            (PI - 0.05, PI - z),
            (TAU, TAU - z),
            (-TAU, -TAU + z),
        ] {
            assert!((avoid_multiples_of_pi(angle, z) - expected).abs() < 1e-15, "{angle}");
        }
    }

    #[test]
    fn the_first_error_is_that_of_the_threshold() {
        // spec kinematics §5.1: error 0.1·THETA, threshold 1°, deflection 0: 0.1°
        let mut d = device(Deflector::Polygon { effective_max: 1.0, facet_tilts: Vec::new() });
        d.errors.head = Some((vlscan_survey::Formula::parse("0.1*THETA").unwrap(), radians(1.0)));
        let (plan, mut h) = head(&d, 100, 36.0, 0.0, 90.0);
        assert_eq!(h.angle_with_error(&plan), 0.0, "setting the present angle does nothing");
        h.step(&plan, 0.0);
        assert!((degrees(h.angle_with_error(&plan) - h.angle) - 0.1).abs() < 1e-12);
        let turned = h.exact_rotation(&plan).apply(DVec3::Y);
        assert!((libm::atan2(-turned.x, turned.y) - h.angle).abs() < 1e-12);
    }
}
