//! Oscillating mirrors (spec kinematics §4.3).

use serde::{Deserialize, Serialize};
use vlscan_geom::degrees;

/// An oscillating mirror. Angles are rad.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Oscillating {
    pub angle: f64,
    /// Pulses since the start of the period; in the corrected motion, of the leg.
    pub count: i64,
    half_angle: f64,
    /// Corrected motion: periods per pulse.
    rate: Option<f64>,
    /// Motion of the reference: pulses per period, and change per step between the turns.
    pub(super) period: i64,
    step: f64,
}

/// Pulses of acceleration after a turn, as in the reference.
const TURNING_PULSES: f64 = 50.0;

/// The angle, from −1 to 1, at pulse `count` of a mirror that oscillates `rate` times per pulse: constant speed between
/// two parabolas of constant acceleration. Half periods of less than 100 pulses are two parabolas.
fn oscillation(count: i64, rate: f64) -> f64 {
    let phase = (count as f64 * rate).fract();
    let (x, sign) = if phase < 0.5 { (2.0 * phase, 1.0) } else { (2.0 * phase - 1.0, -1.0) };
    // The fraction of a half period that each of the two accelerations takes.
    let r = (TURNING_PULSES * 2.0 * rate).min(0.5);
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
        half_angle: f64,
        scan_freq: f64,
        product: f64,
        frequency: f64,
        corrected: bool,
    ) {
        let scan_freq =
            if degrees(half_angle) * scan_freq > product { product / degrees(half_angle) } else { scan_freq };
        self.half_angle = half_angle;
        if corrected {
            (self.rate, self.count) = (Some(scan_freq / frequency), 0);
        }
        // A scan frequency of 0 makes an infinite period.
        self.period = (frequency / scan_freq) as i64;
        self.step = 2.0 * half_angle / ((self.period / 2) as f64 - 50.5);
    }

    /// Moves by one step. Within 50 pulses of each turn the speed changes linearly, in between it is constant. In
    /// periods of less than 200 pulses these intervals overlap, and the first matching case applies.
    #[inline]
    pub fn step(&mut self) {
        if let Some(rate) = self.rate {
            self.angle = self.half_angle * oscillation(self.count, rate);
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
        match self.rate {
            // The angle is that of the last step.
            Some(_) if steps > 0 => {
                self.count += i64::from(steps - 1);
                self.step();
            }
            _ => (0..steps).for_each(|_| self.step()),
        }
    }
}
