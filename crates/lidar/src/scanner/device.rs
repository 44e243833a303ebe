//! The moving parts of a device: head and deflector.

use super::deflector::DeflectorState;
use super::head::HeadState;
use super::plan::DevicePlan;
use super::timed::TimedMotion;
use serde::{Deserialize, Serialize};
use vlscan_base::error::Error;
use vlscan_geom::Rotation;
use vlscan_survey::{Deflector, ScannerSettings};

/// Steps after which the phase of a deflector is as good as any other.
const MAX_DEFLECTOR_STEPS: u64 = 8191;

/// State of one device of a scanner between two simulation steps: head, deflector and pulse counter.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DeviceState {
    /// Rotation of the scanner head.
    pub head: HeadState,
    /// Deflection of the beam.
    pub deflector: DeflectorState,
    /// The motion of the deflector, where it is a function of time instead of equal steps.
    timed: Option<TimedMotion>,
    /// Pulses emitted so far, over all legs.
    pub pulses: u64,
    /// True if the warm-up steps of the current leg have been taken.
    pub is_warmed_up: bool,
}

impl DeviceState {
    /// The state before the first leg: head and deflector at rest, no pulse emitted.
    pub fn at_rest(plan: &DevicePlan) -> DeviceState {
        DeviceState {
            head: HeadState::default(),
            deflector: DeflectorState::at_rest(plan),
            timed: None,
            pulses: 0,
            is_warmed_up: false,
        }
    }

    /// Applies a leg's settings to the head, then to the deflector.
    pub fn start_leg(&mut self, plan: &DevicePlan, settings: &ScannerSettings) {
        self.is_warmed_up = false;
        let frequency = settings.pulse_rate();
        let deflection = self.deflector.exact_angle();
        self.head.start_leg(plan, settings, frequency, deflection);
        let wander = self.timed.map_or(0.0, |timed| timed.wander(plan));
        self.deflector.start_leg(plan, settings, frequency);
        let is_timed = plan.motion.wander.is_some() || settings.pulse_times.is_some();
        self.timed = is_timed
            .then(|| self.deflector.turns(plan))
            .flatten()
            .map(|(per_step, next)| TimedMotion::new(next - wander, per_step, frequency));
    }

    /// True if the deflector moves as a function of time.
    pub fn is_timed(&self) -> bool {
        self.timed.is_some()
    }

    /// Resets the deflector phase (spec kinematics §4.1).
    pub fn restart(&mut self, plan: &DevicePlan) {
        self.deflector.restart(plan);
        if let (Some(timed), Some((_, next))) = (&mut self.timed, self.deflector.turns(plan)) {
            timed.start = next;
        }
    }

    /// Moves the deflector by one simulation step of equal ones.
    #[inline]
    pub fn step_deflector(&mut self, plan: &DevicePlan) {
        match &mut self.timed {
            None => self.deflector.step(plan),
            Some(timed) => {
                timed.steps += 1;
                let time = timed.steps as f64 / timed.frequency;
                self.step_deflector_to(plan, time);
            }
        }
    }

    /// Moves the deflector by one simulation step, `seconds` after the start of the leg.
    pub fn step_deflector_to(&mut self, plan: &DevicePlan, seconds: f64) {
        match &mut self.timed {
            None => self.deflector.step(plan),
            Some(timed) => {
                timed.time = seconds;
                self.deflector.place(plan, timed.turns(plan), seconds);
            }
        }
    }

    /// Turns the head to where it is `seconds` after the start of a leg, at which it is at `start`, rad.
    pub fn turn_head_to(&mut self, plan: &DevicePlan, start: f64, seconds: f64) {
        self.head.turn_to(plan, start, seconds, self.deflector.exact_angle());
    }

    /// Seconds, at least, before the turn of the head is completed.
    pub fn seconds_to_completion(&self) -> f64 {
        self.head.seconds_to_completion()
    }

    /// Takes `steps` steps at the times `time_of`, s after the start of the leg, of a device whose head and
    /// deflector have no errors. Returns the number of pulses emitted, none unless it `fires`.
    pub fn advance_to(
        &mut self,
        plan: &DevicePlan,
        (is_active, fires, start): (bool, bool, Option<f64>),
        steps: u32,
        time_of: impl Fn(u32) -> f64,
    ) -> u32 {
        let last = time_of(steps - 1);
        match start {
            Some(start) => self.turn_head_to(plan, start, last),
            None => self.head.advance(steps),
        }
        if !is_active {
            return 0;
        }
        let mut fired = steps;
        if self.timed.is_none() {
            fired = self.deflector.advance(plan, steps);
        } else if self.deflector.depends_on_steps(plan) {
            fired = 0;
            for i in 0..steps {
                self.step_deflector_to(plan, time_of(i));
                fired += u32::from(self.deflector.is_firing());
            }
        } else {
            self.step_deflector_to(plan, last);
        }
        let pulses = if fires { fired } else { 0 };
        self.pulses += u64::from(pulses);
        pulses
    }

    /// Moves the deflector by `steps` steps before the first pulse of a leg.
    pub fn warm_up_deflector(&mut self, plan: &DevicePlan, steps: u64) {
        match &mut self.timed {
            None => (0..steps).for_each(|_| self.deflector.step(plan)),
            Some(timed) => timed.start += timed.rate * steps as f64 / timed.frequency,
        }
    }

    /// Takes `steps` steps of a deflector without an error, and returns in how many of them it fires.
    pub fn advance_deflector(&mut self, plan: &DevicePlan, steps: u32) -> u32 {
        let Some(timed) = &mut self.timed else { return self.deflector.advance(plan, steps) };
        if self.deflector.depends_on_steps(plan) {
            let fires = |state: &mut DeviceState| {
                state.step_deflector(plan);
                u32::from(state.deflector.is_firing())
            };
            return (0..steps).map(|_| fires(self)).sum();
        }
        if steps > 0 {
            timed.steps += i64::from(steps - 1);
            self.step_deflector(plan);
        }
        steps
    }

    /// Moves the deflector to a phase it may have after `steps` steps; a table of beams to its exact step.
    pub fn jump_deflector(&mut self, plan: &DevicePlan, steps: u64) {
        let steps = match self.deflector {
            DeflectorState::Pattern { .. } => steps.min(u64::from(u32::MAX)),
            _ => steps % MAX_DEFLECTOR_STEPS,
        };
        self.advance_deflector(plan, steps as u32);
    }

    /// Turns the head by one simulation step.
    #[inline]
    pub fn step_head(&mut self, plan: &DevicePlan) {
        // The head's error depends on the deflection of the step before.
        self.head.step(plan, self.deflector.exact_angle());
    }

    /// Takes `steps` steps, with the deflector if `is_active`, of a device whose head and deflector have no
    /// errors. Returns the number of pulses emitted.
    pub fn advance(&mut self, plan: &DevicePlan, is_active: bool, steps: u32) -> u32 {
        self.head.advance(steps);
        if !is_active {
            return 0;
        }
        let pulses = self.advance_deflector(plan, steps);
        self.pulses += u64::from(pulses);
        pulses
    }

    /// This state `part` of a step later, where another channel of the same cycle fires.
    pub fn within_step(&self, plan: &DevicePlan, part: f64) -> DeviceState {
        let deflector = match self.timed {
            None => self.deflector.within_step(plan, part),
            Some(now) => {
                let later = TimedMotion { time: now.time + part / now.frequency, ..now };
                let mut deflector = self.deflector.clone();
                deflector.place(plan, later.turns(plan), later.time);
                deflector
            }
        };
        DeviceState { head: self.head.within_step(part), deflector, ..*self }
    }

    /// True if the formula of the deflection error had a value, and a user-defined pattern a direction;
    /// [`DeviceState::formula_error`] names the one without it.
    #[inline]
    pub fn has_deflection(&self) -> bool {
        match &self.deflector {
            DeflectorState::Polygon(mirror) => mirror.angle.is_finite(),
            DeflectorState::Custom { beam, is_firing, .. } => !is_firing || beam.is_finite(),
            _ => true,
        }
    }

    /// The error of the first formula of an error that has no value at the current angles.
    #[cold]
    pub fn formula_error(&self, plan: &DevicePlan) -> Error {
        if let (DeflectorState::Custom { steps, step, .. }, Deflector::Custom(pattern)) =
            (&self.deflector, &plan.deflector)
        {
            let time = steps * step;
            if let Some(error) = pattern.error(time) {
                return Error::Other(error);
            }
            let found = pattern.direction(time);
            return Error::input(format!(
                "the scan pattern points to {found} at {time} s, expected a direction whose length is above \
                 0: {pattern:?}"
            ));
        }
        let at = self.deflector.exact_angle();
        let errors = &plan.errors;
        let deflection = errors.deflection.as_ref().map(|formula| formula.number("deflection error", at));
        let head = self.head.error(plan);
        let range = errors.range.as_ref().map(|formula| formula.number("range error", at));
        let found = [deflection, Some(head), range].into_iter().flatten().find_map(Result::err);
        found.unwrap_or_else(|| Error::Internal("a pulse without a direction".to_owned()))
    }

    /// The emitter's attitude in the platform's mount frame: head, then emitter.
    #[inline]
    pub fn emitter(&self, plan: &DevicePlan) -> Rotation {
        self.head.turned(plan, plan.beam_origin.rotation)
    }

    /// [`DeviceState::emitter`] without the head's error.
    pub fn exact_emitter(&self, plan: &DevicePlan) -> Rotation {
        self.head.exact_rotation(plan).after(plan.beam_origin.rotation)
    }
}

#[cfg(test)]
mod tests;
