//! Polygon mirrors (spec kinematics §4.2).

use super::plan::DevicePlan;
use crate::survey::ScannerSettings;
use serde::{Deserialize, Serialize};

/// A polygon mirror. Angles are rad.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Polygon {
    /// The angle with its error.
    pub angle: f64,
    /// The angle without error.
    pub exact: f64,
    step: f64,
    /// The mirror fires at `lower < angle ≤ upper`.
    lower: f64,
    upper: f64,
}

/// The interval of angles in which a polygon mirror fires: the lower end, which is excluded, and the upper one.
pub(crate) fn firing_window(effective_max: f64, scan_angle: f64, settings: &ScannerSettings) -> (f64, f64) {
    let usable = effective_max.min(scan_angle);
    (settings.vertical_min.unwrap_or(-usable), settings.vertical_max.unwrap_or(usable))
}

impl Polygon {
    pub fn new(
        effective_max: f64,
        scan_angle_max: f64,
        scan_angle: f64,
        settings: &ScannerSettings,
        frequency: f64,
    ) -> Polygon {
        let (lower, upper) = firing_window(effective_max, scan_angle, settings);
        let step = (settings.scan_freq * (scan_angle_max - (-scan_angle_max))) / frequency;
        Polygon { angle: 0.0, exact: 0.0, step, lower, upper }
    }

    #[inline]
    pub fn is_firing(&self) -> bool {
        self.lower < self.angle && self.angle <= self.upper
    }

    #[inline]
    pub fn step(&mut self, plan: &DevicePlan) {
        let max = plan.scan_angle_max;
        self.exact += self.step;
        if plan.kinematics.polygon_keeps_excess {
            if self.exact >= max && max > 0.0 {
                self.exact -= 2.0 * max * ((self.exact + max) / (2.0 * max)).floor();
            }
            self.angle = self.exact + plan.errors.deflection.as_ref().map_or(0.0, |e| e.eval(self.exact));
            return;
        }
        let Some(error) = &plan.errors.deflection else {
            // The excess beyond the end of the line is lost.
            if self.exact >= max {
                self.exact = -max;
            }
            self.angle = self.exact;
            return;
        };
        self.angle = self.exact + error.eval(self.exact);
        if !self.angle.is_finite() {
            // Both angles stay as they are for the message.
            return;
        }
        if self.exact >= max {
            self.exact = -max;
        }
        if self.angle >= max {
            self.angle = -max;
        }
    }
}
