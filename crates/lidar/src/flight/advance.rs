//! Many steps of a leg at once, of which only the number of pulses and the last state are needed.
//!
//! The parts of a flight's state depend on each other only where a leg ends or a sample of the trajectory is
//! due. Up to the next such event, clock, platform, heads and deflectors advance separately, each in a loop
//! of its own or, where the result of the loop is known, without one. The state is that after single steps,
//! bit for bit.

use super::clock::{WEEK_NS, elapsed_ns};
use super::plan::FlightPlan;
use super::pulse::{FlightSink, PoseSample, Pulse};
use super::state::{FlightState, Step};
use crate::platform::PlatformState;
use crate::scanner::{DevicePlan, DeviceState};
use vlscan_base::error::Result;
use vlscan_geom::add_repeatedly;

/// Maximum number of steps at once of which each has a time that is needed.
const MAX_TIMED_STEPS: u32 = 1 << 14;

/// Steps that were taken without computing their pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Skipped {
    /// Number of steps.
    pub steps: u32,
    /// Of these the steps that were taken one by one, which takes longer.
    pub single_steps: u32,
    /// Number of pulses of all devices.
    pub pulses: u32,
    /// Number of samples of the trajectory.
    pub poses: u32,
    /// Outcome of the last step. If it is not [`Step::Advanced`], it does not count.
    pub last: Step,
}

impl FlightSink for Skipped {
    fn pulse(&mut self, _: impl FnOnce() -> Pulse) {
        self.pulses += 1;
    }

    fn pose(&mut self, _: impl FnOnce() -> PoseSample) {
        self.poses += 1;
    }
}

impl FlightState {
    /// Takes up to `steps` steps of the leg, the last of which is the one that emits pulse number `pulses`,
    /// counted from 1. The state is that after as many calls of [`step`](Self::step), bit for bit.
    ///
    /// # Errors
    /// As for [`step`](Self::step).
    pub fn skip(&mut self, plan: &FlightPlan, pulses: u32, steps: u32) -> Result<Skipped> {
        let mut all = Skipped { steps: 0, single_steps: 0, pulses: 0, poses: 0, last: Step::Advanced };
        let devices = plan.devices.len().max(1) as u32;
        while all.pulses < pulses && all.steps < steps {
            // Each device emits at most one pulse per step.
            let limit = (pulses - all.pulses).div_ceil(devices).min(steps - all.steps);
            let (many, emitted) = self.advance(plan, limit);
            if many > 0 {
                all.steps += many;
                all.pulses += emitted;
                continue;
            }
            all.last = self.step(plan, &mut all)?;
            if all.last != Step::Advanced {
                break;
            }
            all.steps += 1;
            all.single_steps += 1;
        }
        Ok(all)
    }

    /// Takes up to `limit` steps that neither end the leg nor sample the trajectory, and returns their number
    /// and that of their pulses. Takes none where [`step`](Self::step) has to decide what comes next, and for
    /// platforms that are stepped one by one.
    pub(super) fn advance(&mut self, plan: &FlightPlan, limit: u32) -> (u32, u32) {
        let steps = self.steps_without_event(plan, limit);
        if steps == 0 {
            return (0, 0);
        }
        let leg = &plan.legs[self.leg];
        let is_active = leg.settings.active;
        let clock = self.step_clock(plan);
        if leg.times.is_some() || self.devices.iter().any(DeviceState::is_timed) {
            return self.advance_to(plan, steps);
        }
        let streamed = self.platform.advance(&plan.platform, self.leg, steps, |i| clock.after(i));
        let devices = plan.devices.iter().zip(&mut self.devices);
        let pulses = devices.map(|(device, state)| state.advance(device, is_active, steps)).sum();
        self.advance_clock(plan, steps, streamed);
        (steps, pulses)
    }

    /// Takes `steps` steps, as counted by [`steps_without_event`](Self::steps_without_event), of a leg in
    /// which something is a function of time. Returns their number and that of their pulses.
    fn advance_to(&mut self, plan: &FlightPlan, steps: u32) -> (u32, u32) {
        let leg = &plan.legs[self.leg];
        let steps = steps.min(MAX_TIMED_STEPS);
        let clock = self.step_clock(plan);
        let number = self.step_ahead(plan, 0).0;
        let times: Vec<f64> = (0..steps).map(|i| self.step_ahead(plan, i).1).collect();
        let mut streamed = None;
        if leg.times.is_some() && matches!(self.platform, PlatformState::Linear(_)) {
            let mut last = self.time_of_last_step(plan);
            for (i, time) in times.iter().enumerate() {
                let is_first = self.leg_ticks == 0 && i == 0;
                let share = (time - last) * leg.frequency;
                self.platform.step_by(&plan.platform, self.leg, 0.0, share, is_first);
                last = *time;
            }
        } else {
            streamed = self.platform.advance(&plan.platform, self.leg, steps, |i| clock.after(i));
        }
        let (is_active, fires) = (leg.settings.active, leg.fires(number));
        let head_start = leg.times.as_ref().map(|_| leg.settings.head_start);
        let devices = plan.devices.iter().zip(&mut self.devices);
        let advance = |(device, state): (&DevicePlan, &mut DeviceState)| {
            state.advance_to(device, (is_active, fires, head_start), steps, |i| times[i as usize])
        };
        let pulses = devices.map(advance).sum();
        self.advance_clock(plan, steps, streamed);
        (steps, pulses)
    }

    /// Number of steps, up to `limit`, in which nothing can happen except the motion of clock, platform and
    /// devices. Estimates err on the low side by a few steps.
    fn steps_without_event(&self, plan: &FlightPlan, limit: u32) -> u32 {
        let leg = &plan.legs[self.leg];
        let has_errors =
            |device: &DevicePlan| device.errors.deflection.is_some() || device.errors.head.is_some();
        if self.ended
            || (leg.settings.active && self.devices.iter().any(|device| !device.is_warmed_up))
            || plan.devices.iter().any(has_errors)
        {
            return 0;
        }
        let steps = f64::from(limit)
            .min(self.guard.next_check.saturating_sub(self.ticks) as f64)
            .min(self.steps_before_time_event(plan))
            .min(self.steps_before_arrival(plan));
        // NaN becomes 0.
        steps as u32
    }

    /// Steps before the maximum duration, the next sample of the trajectory or the end of the GPS week.
    fn steps_before_time_event(&self, plan: &FlightPlan) -> f64 {
        let leg = &plan.legs[self.leg];
        let time = self.platform.next_time_ns(&plan.platform).unwrap_or(self.time_ns);
        let mut left = match self.platform.time_origin(&plan.platform) {
            None => WEEK_NS - time,
            Some(_) => f64::INFINITY,
        };
        if leg.max_duration > 0.0 {
            if self.timer_is_pending {
                return 0.0;
            }
            let slack = if plan.kinematics.legs_on_time { 1e6 / leg.frequency } else { 0.0 };
            left = left.min(leg.max_duration * 1e9 - slack - elapsed_ns(time, self.timer_start_ns));
        }
        if leg.settings.active && leg.sample_interval_ns != 0.0 {
            if self.last_sample_ns == 0.0 {
                return 0.0;
            }
            left = left.min(leg.sample_interval_ns - elapsed_ns(time, self.last_sample_ns));
        }
        if leg.times.is_some() {
            return self.steps_within(plan, left * 1e-9);
        }
        // The clock rounds to less than 0.1 ns in each step.
        (left / (leg.increment_ns * (1.0 + 1e-6) + 0.1)).floor() - 4.0
    }

    /// Steps of a leg with pulse times before `seconds` have passed since the next one, and before the last
    /// of its times.
    fn steps_within(&self, plan: &FlightPlan, seconds: f64) -> f64 {
        let Some(times) = &plan.legs[self.leg].times else { return 0.0 };
        let (number, next) = self.step_ahead(plan, 0);
        let end = match seconds.is_finite() {
            true => times.first_from(next + seconds * (1.0 - 1e-6)).saturating_sub(4),
            false => u64::MAX,
        };
        let last = times.count().filter(|count| number < *count).unwrap_or(u64::MAX);
        end.min(last).saturating_sub(number) as f64
    }

    /// Time of the last step of a leg with pulse times, s after its start, which is before the first one.
    fn time_of_last_step(&self, plan: &FlightPlan) -> f64 {
        let last = plan.legs[self.leg].times.as_ref().zip(self.leg_ticks.checked_sub(1));
        last.map_or(0.0, |(times, last)| times.at(last))
    }

    /// Steps of a leg with pulse times before it can be over because head and platform have arrived.
    fn timed_steps_before_arrival(&self, plan: &FlightPlan) -> f64 {
        let (leg, clock) = (&plan.legs[self.leg], self.step_clock(plan).after(0));
        match &self.platform {
            PlatformState::Static(_) if leg.still => self.steps_within(plan, f64::INFINITY),
            PlatformState::Static(_) => self.steps_within(plan, self.devices[0].seconds_to_completion()),
            PlatformState::Interpolated(state) => self.steps_within(plan, state.time_left(clock)),
            PlatformState::Stream(_) => {
                let poses = self.platform.steps_before_arrival(&plan.platform, self.leg, clock, 0.0);
                poses.min(self.steps_within(plan, f64::INFINITY))
            }
            // The first step of a leg is taken alone.
            PlatformState::Linear(_) if self.leg_ticks > 0 => {
                let speed = plan.platform.legs[self.leg].speed;
                let way = self.platform.distance_left().unwrap_or(0.0);
                let since = self.step_ahead(plan, 0).1 - self.time_of_last_step(plan);
                if speed > 0.0 { self.steps_within(plan, way / speed - since) } else { 0.0 }
            }
            _ => 0.0,
        }
    }

    /// Steps before the leg can be over because head and platform have arrived.
    fn steps_before_arrival(&self, plan: &FlightPlan) -> f64 {
        if plan.legs[self.leg].times.is_some() {
            return self.timed_steps_before_arrival(plan);
        }
        let (clock, frequency) = (self.step_clock(plan).after(0), plan.legs[self.leg].frequency);
        let platform = self.platform.steps_before_arrival(&plan.platform, self.leg, clock, frequency);
        match &self.platform {
            PlatformState::Static(_) if plan.legs[self.leg].still => f64::INFINITY,
            PlatformState::Static(_) => self.devices[0].head.steps_to_completion(),
            _ => platform,
        }
    }

    /// Advances time by `steps` steps, the last of which was at `streamed` ns if the platform follows a
    /// stream.
    fn advance_clock(&mut self, plan: &FlightPlan, steps: u32, streamed: Option<f64>) {
        self.ticks += u64::from(steps);
        self.leg_ticks += u64::from(steps);
        let increment = plan.legs[self.leg].increment_ns;
        self.time_ns = match streamed {
            _ if plan.kinematics.exact_clock || plan.legs[self.leg].times.is_some() => {
                self.exact_time_ns(plan)
            }
            Some(last) => last + increment,
            None => add_repeatedly(self.time_ns, increment, steps),
        };
    }
}
