//! Polygon mirrors (spec kinematics §4.2).

use super::plan::DevicePlan;
use serde::{Deserialize, Serialize};
use vlscan_geom::{spacing, steps_in_binade};
use vlscan_survey::ScannerSettings;

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
    /// The facet in the beam, if the mirror's facets differ.
    facet: u32,
}

/// The interval of angles in which a polygon mirror fires: the lower end, which is excluded, and the upper
/// one.
pub(crate) fn firing_window(effective_max: f64, scan_angle: f64, settings: &ScannerSettings) -> (f64, f64) {
    let usable = effective_max.min(scan_angle);
    (settings.vertical_min.unwrap_or(-usable), settings.vertical_max.unwrap_or(usable))
}

impl Polygon {
    /// The mirror at the start of a leg.
    pub fn new(
        plan: &DevicePlan,
        effective_max: f64,
        scan_angle: f64,
        settings: &ScannerSettings,
        frequency: f64,
    ) -> Polygon {
        let (lower, upper) = firing_window(effective_max, scan_angle, settings);
        let max = plan.scan_angle_max;
        let step = plan.sense() * ((settings.scan_freq * (max - (-max))) / frequency);
        let mut mirror = Polygon { angle: 0.0, exact: 0.0, step, lower, upper, facet: 0 };
        mirror.restart(plan);
        mirror
    }

    /// Moves the mirror to `turns` facets after the middle of the first line, without an error of the angle.
    pub fn place(&mut self, plan: &DevicePlan, turns: f64) {
        let lines = (turns + 0.5).floor();
        self.exact = 2.0 * plan.scan_angle_max * (turns - lines);
        self.angle = self.exact;
        let count = plan.facet_tilts().len().max(1) as f64;
        self.facet = lines.rem_euclid(count) as u32;
    }

    /// Moves the mirror to `turns` facets after the middle of the first line.
    pub fn place_with_error(&mut self, plan: &DevicePlan, turns: f64) {
        self.place(plan, turns);
        self.angle += plan.errors.deflection.as_ref().map_or(0.0, |error| error.eval(self.exact));
    }

    /// Places the mirror at the phase of its plan; with the correction `optics_on_time` a step before it, so
    /// that the first step leads to the phase.
    pub fn restart(&mut self, plan: &DevicePlan) {
        self.place(plan, plan.start_turns());
        if plan.kinematics.optics_on_time {
            self.exact -= self.step;
            self.angle = self.exact;
        }
    }

    /// Facets that pass per step, and those that have passed at the next step.
    pub fn turns(&self, plan: &DevicePlan) -> (f64, f64) {
        let line = 2.0 * plan.scan_angle_max;
        let turns = |angle: f64| if line > 0.0 { angle / line } else { 0.0 };
        (turns(self.step), turns(self.exact + self.step) + f64::from(self.facet))
    }

    #[inline]
    pub fn is_firing(&self) -> bool {
        self.lower < self.angle && self.angle <= self.upper
    }

    /// The angle by which the facet in the beam turns it out of the plane across the axis, rad.
    #[inline]
    pub fn tilt(&self, plan: &DevicePlan) -> f64 {
        plan.facet_tilts().get(self.facet as usize).copied().unwrap_or(0.0)
    }

    /// Brings the facet into the beam that comes `lines` facets later, or earlier where they are negative.
    #[inline]
    fn pass_facets(&mut self, plan: &DevicePlan, lines: f64) {
        let count = plan.facet_tilts().len() as i64;
        if count > 1 {
            self.facet = (i64::from(self.facet) + lines as i64 % count).rem_euclid(count) as u32;
        }
    }

    #[inline]
    pub fn step(&mut self, plan: &DevicePlan) {
        let max = plan.scan_angle_max;
        self.exact += self.step;
        if plan.kinematics.polygon_keeps_excess {
            // A reversed mirror ends its lines at the other end.
            if (self.exact >= max || self.step < 0.0 && self.exact < -max) && max > 0.0 {
                let lines = ((self.exact + max) / (2.0 * max)).floor();
                self.exact -= 2.0 * max * lines;
                self.pass_facets(plan, lines);
            }
            self.angle = self.exact + plan.errors.deflection.as_ref().map_or(0.0, |e| e.eval(self.exact));
            return;
        }
        if self.step < 0.0 {
            if self.exact <= -max {
                self.exact = max;
                self.pass_facets(plan, -1.0);
            }
            self.angle = self.exact + plan.errors.deflection.as_ref().map_or(0.0, |e| e.eval(self.exact));
            return;
        }
        let Some(error) = &plan.errors.deflection else {
            // The excess beyond the end of the line is lost.
            if self.exact >= max {
                self.exact = -max;
                self.pass_facets(plan, 1.0);
            }
            self.angle = self.exact;
            return;
        };
        self.angle = self.exact + error.eval(self.exact);
        if !self.angle.is_finite() {
            // Both angles are kept for the message.
            return;
        }
        if self.exact >= max {
            self.exact = -max;
            self.pass_facets(plan, 1.0);
        }
        if self.angle >= max {
            self.angle = -max;
        }
    }

    /// Multiplies the angle per step by `factor`.
    pub fn slow_down(&mut self, factor: f64) {
        self.step *= factor;
    }

    /// Takes `steps` steps of a mirror without an error, and returns in how many of them it fires.
    pub fn advance(&mut self, plan: &DevicePlan, mut steps: u32) -> u32 {
        let mut fired = 0;
        while steps > 0 {
            let equal = self.equal_steps(plan).min(f64::from(steps)) as u32;
            if equal == 0 {
                self.step(plan);
                fired += u32::from(self.is_firing());
                steps -= 1;
                continue;
            }
            // Exact: multiples of the spacing of one binade.
            self.exact += ((self.exact + self.step) - self.exact) * f64::from(equal);
            self.angle = self.exact;
            fired += if self.is_firing() { equal } else { 0 };
            steps -= equal;
        }
        fired
    }

    /// Number of steps, at least, that add the same increment and pass neither the end of the line nor of the
    /// window.
    fn equal_steps(&self, plan: &DevicePlan) -> f64 {
        let increment = (self.exact + self.step) - self.exact;
        let is_uniform =
            spacing(self.exact).is_some_and(|spacing| (self.step - increment).abs() < 0.5 * spacing);
        if !is_uniform || increment <= 0.0 || self.exact >= plan.scan_angle_max {
            return 0.0;
        }
        let borders = [self.lower, self.upper, plan.scan_angle_max].into_iter();
        let next = borders.filter(|border| *border >= self.exact).fold(f64::INFINITY, f64::min);
        let to_border = ((next - self.exact) / increment).floor() - 2.0;
        // Infinite borders and the borders below are ignored; NaN becomes 0.
        steps_in_binade(self.exact, increment).min(to_border)
    }
}
