//! Oscillating mirrors (spec kinematics §4.3).

use super::plan::DevicePlan;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use vlscan_geom::degrees;
use vlscan_survey::Swing;

/// An oscillating mirror. Angles are rad.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Oscillating {
    pub angle: f64,
    /// Pulses since the start of the period; in the corrected motion, of the leg.
    pub count: i64,
    /// Negative where the mirror is reversed.
    half_angle: f64,
    /// Periods per pulse.
    rate: f64,
    is_corrected: bool,
    /// Place in the period at which the corrected motion starts, 0 to 1.
    phase: f64,
    /// Fraction of a half period that each reversal of the corrected motion takes; `None` is a sine.
    turning: Option<f64>,
    /// Motion of the reference: pulses per period, and change per step between the turns.
    pub(super) period: i64,
    step: f64,
}

/// Longest period of the reference's motion, in steps, in which a phase is looked for step by step.
const MAX_PERIOD: i64 = 1 << 26;
/// Pulses of acceleration after a turn, as in the reference.
const TURNING_PULSES: f64 = 50.0;

/// The angle, from −1 to 1, after `turns` periods of a mirror: constant speed between two parabolas of
/// constant acceleration, each of which takes the fraction `turning` of a half period, at most 0.5; or a sine
/// if it is `None`.
fn oscillation(turns: f64, turning: Option<f64>) -> f64 {
    let phase = turns - turns.floor();
    let Some(r) = turning else { return -libm::cos(TAU * phase) };
    let (x, sign) = if phase < 0.5 { (2.0 * phase, 1.0) } else { (2.0 * phase - 1.0, -1.0) };
    let speed = 1.0 / (1.0 - r);
    let way = if x < r {
        speed * x * x / (2.0 * r)
    } else if x <= 1.0 - r {
        speed * (x - 0.5 * r)
    } else {
        1.0 - speed * (1.0 - x) * (1.0 - x) / (2.0 * r)
    };
    sign * (2.0 * way - 1.0)
}

impl Oscillating {
    /// Applies a leg's settings; `product` limits half angle (degrees) × frequency.
    pub fn start_leg(
        &mut self,
        plan: &DevicePlan,
        half_angle: f64,
        scan_freq: f64,
        product: f64,
        frequency: f64,
    ) {
        let scan_freq =
            if degrees(half_angle) * scan_freq > product { product / degrees(half_angle) } else { scan_freq };
        let is_first = self.period == 0;
        self.half_angle = plan.sense() * half_angle;
        self.rate = scan_freq / frequency;
        // The reference has neither sines nor turning parts.
        let swing = plan.motion.swing;
        self.is_corrected = plan.kinematics.oscillation_at_leg_frequency || swing != Swing::default();
        self.turning = match swing {
            // Half periods of less than 100 pulses are two parabolas.
            Swing::TurningPulses => Some((TURNING_PULSES * 2.0 * self.rate).min(0.5)),
            Swing::TurningPart(part) => Some(0.5 * part),
            Swing::Sine => None,
        };
        if self.is_corrected {
            (self.count, self.phase) = (0, plan.start_turns());
        }
        // A scan frequency of 0 makes an infinite period.
        self.period = (frequency / scan_freq) as i64;
        self.step = 2.0 * self.half_angle / ((self.period / 2) as f64 - 50.5);
        if is_first && !self.is_corrected {
            self.swing_to(plan.start_turns());
        }
    }

    /// Places the mirror at the phase of its plan.
    pub fn restart(&mut self, plan: &DevicePlan) {
        (self.angle, self.count) = (0.0, 0);
        if !self.is_corrected {
            self.swing_to(plan.start_turns());
        }
    }

    /// Swings the mirror of the reference from the start of a period to `turns` of it; the next step is at
    /// that place.
    fn swing_to(&mut self, turns: f64) {
        let steps = (turns * self.period.min(MAX_PERIOD) as f64).round() as i64;
        (0..steps).for_each(|_| self.step());
    }

    /// Periods per step, and those that have passed at the next step.
    pub fn turns(&self, plan: &DevicePlan) -> (f64, f64) {
        (self.rate, plan.start_turns())
    }

    /// Moves the mirror to `turns` periods after the start of one, by the corrected law.
    pub fn place(&mut self, turns: f64) {
        self.angle = self.half_angle * oscillation(turns, self.turning);
    }

    /// Moves by one step. Within 50 pulses of each turn the speed changes linearly, in between it is
    /// constant. In periods of less than 200 pulses these intervals overlap, and the first matching case
    /// applies.
    #[inline]
    pub fn step(&mut self) {
        if self.is_corrected {
            self.place(self.count as f64 * self.rate + self.phase);
            self.count += 1;
            return;
        }
        if self.count >= self.period {
            self.count = 0;
        }
        let (j, n, d) = (self.count, self.period, self.step);
        let half = n / 2;
        if j == 0 {
            self.angle = -self.half_angle;
        } else if j == half {
            self.angle = self.half_angle;
        } else if (1..50).contains(&j) {
            self.angle += d * (j - 1) as f64 / 49.0;
        } else if (50..half - 50).contains(&j) {
            self.angle += d;
        } else if (half - 50..half).contains(&j) {
            self.angle += d * (half - j) as f64 / 50.0;
        } else if (half + 1..half + 51).contains(&j) {
            self.angle -= d * (j - half - 1) as f64 / 50.0;
        } else if (half + 51..n - 49).contains(&j) {
            self.angle -= d;
        } else if j >= n - 49 {
            self.angle -= d * (n - j) as f64 / 49.0;
        }
        self.count += 1;
    }

    /// Takes `steps` steps.
    pub fn advance(&mut self, steps: u32) {
        if self.is_corrected && steps > 0 {
            // The angle is that of the last step.
            self.count += i64::from(steps - 1);
            self.step();
        } else {
            (0..steps).for_each(|_| self.step());
        }
    }
}
