//! The state of a flight.

use super::clock::{WEEK_NS, elapsed_ns};
use super::guard::ProgressGuard;
use super::leg::PlannedLeg;
use super::plan::FlightPlan;
use super::pulse::{FlightSink, PoseSample};
use super::step_clock::StepClock;
use crate::platform::{LegEntry, PlatformState, Pose, Readiness};
use crate::scanner::{DevicePlan, DeviceState};
use serde::{Deserialize, Serialize};
use vlscan_base::corrections::Corrections;
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;

/// Outcome of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Time advanced by one pulse period of the first leg.
    Advanced,
    /// The next leg began; no time passed.
    LegChanged,
    /// Nothing happened; poses must arrive first, see [`FlightState::feed`].
    NeedsPoses,
    /// The last leg is over; no time passed.
    Ended,
}

/// Clocks, platform and devices of a flight. Cheap to clone; steps from clones are the same bit for bit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FlightState {
    pub(super) leg: usize,
    pub(super) ended: bool,
    /// Number of steps, including changes of legs.
    pub(super) ticks: u64,
    /// The step clock at the start of the leg, s, where legs have separate periods.
    pub(super) clock_base: f64,
    pub(super) leg_ticks: u64,
    /// Time from the start of the run to the start of the leg, ns.
    pub(super) elapsed_base_ns: f64,
    /// The GPS clock, ns of the week: a running sum, which rounds, in the reference, and a product with the
    /// exact clock.
    pub(super) time_ns: f64,
    pub(super) start_ns: f64,
    /// The GPS clock when the leg's maximum duration began.
    pub(super) timer_start_ns: f64,
    /// Pulses of device 0 before the leg.
    pub(super) pulses_before: u64,
    /// The timer starts with the leg's first pulse.
    pub(super) timer_is_pending: bool,
    /// Time of the last trajectory sample; 0 = no sample in this leg.
    pub(super) last_sample_ns: f64,
    pub(super) platform: PlatformState,
    pub(super) devices: Vec<DeviceState>,
    pub(super) guard: ProgressGuard,
}

impl FlightState {
    /// The state before the first step of the first leg.
    pub fn start(plan: &FlightPlan) -> FlightState {
        let mut state = FlightState {
            leg: 0,
            ended: false,
            ticks: 0,
            clock_base: 0.0,
            leg_ticks: 0,
            elapsed_base_ns: 0.0,
            time_ns: plan.start_ns,
            start_ns: plan.start_ns,
            timer_start_ns: plan.start_ns,
            pulses_before: 0,
            timer_is_pending: false,
            last_sample_ns: 0.0,
            platform: PlatformState::at_rest(&plan.platform),
            devices: plan.devices.iter().map(DeviceState::at_rest).collect(),
            guard: ProgressGuard::disabled(),
        };
        state.start_first_leg(plan);
        state
    }

    /// Restarts the flight while clock and pulse numbers continue (spec kinematics §1.6, repetitions).
    /// Streams of poses cannot be repeated.
    pub fn repeat(&mut self, plan: &FlightPlan) {
        self.platform.restore(&FlightState::start(plan).platform);
        self.ended = false;
        self.add_leg_time(plan);
        (self.ticks, self.clock_base) = (0, 0.0);
        self.start_first_leg(plan);
    }

    fn start_first_leg(&mut self, plan: &FlightPlan) {
        self.start_leg(plan, 0, LegEntry::Initial);
        self.timer_is_pending &= plan.kinematics.legs_on_time;
    }

    /// The step clock. Depending on the corrections, every leg has its own period, and the steps that leg
    /// changes take in the reference do not count.
    #[inline]
    pub(super) fn step_clock<'p>(&self, plan: &'p FlightPlan) -> StepClock<'p> {
        if let Some(times) = &plan.legs[self.leg].times {
            return StepClock::Times { base: self.clock_base, ticks: self.leg_ticks, times };
        }
        let Corrections { leg_pulse_rate, legs_on_time, .. } = plan.kinematics;
        if leg_pulse_rate || legs_on_time {
            let (base, frequency) = (self.clock_base, plan.legs[self.leg].frequency);
            StepClock::Leg { base, ticks: self.leg_ticks, frequency }
        } else {
            StepClock::Run { ticks: self.ticks, period: plan.clock_step }
        }
    }

    /// The step clock's time, s.
    #[inline]
    fn clock(&self, plan: &FlightPlan) -> f64 {
        self.step_clock(plan).after(0)
    }

    /// Seconds since the first step; navigation errors are functions of it. A flight takes less than half a
    /// week.
    #[inline]
    fn since_start(&self) -> f64 {
        let elapsed = self.time_ns - self.start_ns;
        (if elapsed < -0.5 * WEEK_NS { elapsed + WEEK_NS } else { elapsed }) * 1e-9
    }

    fn add_leg_time(&mut self, plan: &FlightPlan) {
        let leg = &plan.legs[self.leg];
        match &leg.times {
            None => {
                self.clock_base = self.clock(plan);
                self.elapsed_base_ns += self.leg_ticks as f64 * 1e9 / leg.frequency;
            }
            // The next leg begins a mean period after the last step, as with a constant rate.
            Some(times) => {
                let last = self.leg_ticks.checked_sub(1);
                let seconds = last.map_or(0.0, |last| times.at(last) + 1.0 / leg.frequency);
                self.clock_base += seconds;
                self.elapsed_base_ns += seconds * 1e9;
            }
        }
        self.leg_ticks = 0;
    }

    /// The step that is `ahead` after the next one, before which nothing but steps happens: its number,
    /// counted from 0, with pulse times that of its time; and its time, s after the start of the leg.
    pub(super) fn step_ahead(&self, plan: &FlightPlan, ahead: u32) -> (u64, f64) {
        let leg = &plan.legs[self.leg];
        let tick = self.leg_ticks + u64::from(ahead);
        match (self.platform.step_ahead(&plan.platform, ahead), &leg.times) {
            (Some(step), _) => step,
            (None, Some(times)) => (tick, times.at(tick)),
            (None, None) => (tick, tick as f64 / leg.frequency),
        }
    }

    /// Advances time by one step: a running sum, or a product with the exact clock.
    #[inline]
    fn tick(&mut self, plan: &FlightPlan) {
        (self.ticks, self.leg_ticks) = (self.ticks + 1, self.leg_ticks + 1);
        let leg = &plan.legs[self.leg];
        let is_exact = plan.kinematics.exact_clock || leg.times.is_some();
        self.time_ns = if is_exact { self.exact_time_ns(plan) } else { self.time_ns + leg.increment_ns };
        if self.time_ns > WEEK_NS {
            self.time_ns = if is_exact { self.time_ns.rem_euclid(WEEK_NS) } else { self.time_ns - WEEK_NS };
        }
    }

    /// The GPS clock as a product with the number of steps of the leg, ns; not reduced to a week.
    #[inline]
    pub(super) fn exact_time_ns(&self, plan: &FlightPlan) -> f64 {
        let leg = &plan.legs[self.leg];
        let elapsed = match &leg.times {
            None => self.leg_ticks as f64 * 1e9 / leg.frequency,
            Some(times) => times.at(self.leg_ticks) * 1e9,
        };
        plan.start_ns + (self.elapsed_base_ns + elapsed)
    }

    /// Takes one step and passes its pulses and trajectory sample to `sink`.
    ///
    /// # Errors
    /// [`Error::Input`] for a leg that does not end, and for a formula of an error that has no value.
    #[inline]
    pub fn step(&mut self, plan: &FlightPlan, sink: &mut impl FlightSink) -> Result<Step> {
        if self.ended {
            return Ok(Step::Ended);
        }
        let leg = &plan.legs[self.leg];
        match self.platform.readiness(&plan.platform) {
            Readiness::Ready => {}
            Readiness::NeedsPoses => return Ok(Step::NeedsPoses),
            Readiness::Ended => return Ok(self.change_leg(plan)),
        }
        if let Some(time) = self.platform.next_time_ns(&plan.platform) {
            self.time_ns = time;
        }
        if leg.max_duration > 0.0 && self.check_duration(leg, plan.kinematics.legs_on_time) {
            return Ok(self.change_leg(plan));
        }
        let clock = self.clock(plan);
        if !leg.still && self.devices[0].head.is_completed() && self.is_arrived(plan, leg, clock) {
            return Ok(self.change_leg(plan));
        }
        if self.ticks >= self.guard.next_check {
            self.check_progress(plan)?;
        }
        let next = self.step_ahead(plan, 0);
        match leg.times {
            None => self.platform.step(&plan.platform, self.leg, clock),
            Some(_) => {
                let steps = self.steps_since_last(plan);
                self.platform.step_by(&plan.platform, self.leg, clock, steps, self.leg_ticks == 0);
            }
        }
        if plan.platform.is_physical()
            && let Some(distance) = self.platform.distance_left()
        {
            self.guard.record(distance);
        }
        self.step_devices(plan, leg, next, sink)?;
        if leg.settings.active && leg.sample_interval_ns != 0.0 {
            self.sample(plan, leg, sink);
        }
        self.tick(plan);
        Ok(Step::Advanced)
    }

    #[inline]
    fn step_devices(
        &mut self,
        plan: &FlightPlan,
        leg: &PlannedLeg,
        (number, seconds): (u64, f64),
        sink: &mut impl FlightSink,
    ) -> Result<()> {
        let since_start = self.since_start();
        let fires = leg.fires(number);
        let FlightState { platform, devices, time_ns, .. } = self;
        for (index, (device, state)) in plan.devices.iter().zip(devices).enumerate() {
            if leg.settings.active && !state.is_warmed_up {
                warm_up(device, state, leg.warmup, !plan.kinematics.warmup_of_optics);
            }
            match leg.times {
                None => state.step_head(device),
                Some(_) => state.turn_head_to(device, leg.settings.head_start, seconds),
            }
            if !leg.settings.active {
                continue;
            }
            state.step_deflector_to(device, seconds);
            if device.may_lack_deflection && !state.has_deflection() {
                return Err(state.formula_error(device));
            }
            if !fires || !state.deflector.is_firing() {
                continue;
            }
            state.pulses += 1;
            let mut is_valid = true;
            let has_velocity = sink.records_velocities();
            sink.pulse(|| {
                let mut pulse = plan.pulse(platform, leg, index, state, *time_ns, since_start);
                if has_velocity {
                    pulse.velocity = Some(plan.velocity(platform, leg, index, state));
                }
                is_valid = !device.errors.any() || pulse.is_valid();
                pulse
            });
            if !is_valid {
                return Err(plan.formula_error(leg, index, state));
            }
        }
        Ok(())
    }

    #[inline]
    fn sample(&mut self, plan: &FlightPlan, leg: &PlannedLeg, sink: &mut impl FlightSink) {
        let is_due = self.last_sample_ns == 0.0
            || elapsed_ns(self.time_ns, self.last_sample_ns) >= leg.sample_interval_ns;
        if is_due {
            self.last_sample_ns = self.time_ns;
            let (platform, time_ns) = (&self.platform, self.time_ns);
            let since_start = self.since_start();
            sink.pose(|| {
                let flown = (platform.position(), platform.reported_attitude(&plan.platform));
                let (position, attitude) = match &plan.navigation {
                    Some(navigation) => navigation.reported(flown.0, flown.1, since_start),
                    None => flown,
                };
                let [roll, pitch, yaw] = platform.angles(&plan.platform, attitude);
                PoseSample { time_ns, position, roll, pitch, yaw, attitude, flown }
            });
        }
    }

    /// True if the platform has reached the end of the leg, before the next step if pulses have times of
    /// their own.
    fn is_arrived(&mut self, plan: &FlightPlan, leg: &PlannedLeg, clock: f64) -> bool {
        match &self.platform {
            PlatformState::Linear(_) if leg.times.is_some() => {
                self.platform.arrives_within(self.steps_since_last(plan))
            }
            _ => self.platform.check_arrival(&plan.platform, self.leg, clock),
        }
    }

    /// Time from the step before, or the start of the leg, to the next step of a leg with pulse times, in
    /// steps of its mean rate.
    fn steps_since_last(&self, plan: &FlightPlan) -> f64 {
        let leg = &plan.legs[self.leg];
        let Some(times) = &leg.times else { return 1.0 };
        let before = self.leg_ticks.checked_sub(1).map_or(0.0, |last| times.at(last));
        (times.at(self.leg_ticks) - before) * leg.frequency
    }

    /// Starts the timer if it is pending. Returns whether the leg's maximum duration is over (spec kinematics
    /// §1.3, items 1 and 2).
    fn check_duration(&mut self, leg: &PlannedLeg, legs_on_time: bool) -> bool {
        let waiting = self.devices[0].pulses == self.pulses_before;
        if self.timer_is_pending {
            // The reference starts its timer after the step of the first pulse instead of before it.
            if waiting || !legs_on_time {
                self.timer_start_ns = self.time_ns;
            }
            self.timer_is_pending = waiting;
        }
        let slack = if legs_on_time { 1e6 / leg.frequency } else { 0.0 };
        (elapsed_ns(self.time_ns, self.timer_start_ns) + slack) * 1e-9 >= leg.max_duration
    }

    pub(super) fn change_leg(&mut self, plan: &FlightPlan) -> Step {
        let next = self.leg + 1;
        if next >= plan.flown {
            self.ended = true;
            return Step::Ended;
        }
        self.start_leg(plan, next, LegEntry::Continuing);
        self.ticks += 1;
        if !plan.kinematics.legs_on_time {
            self.clock_base += 1.0 / plan.legs[next].frequency;
        }
        Step::LegChanged
    }

    /// Starts leg `leg` (spec kinematics §1.4).
    fn start_leg(&mut self, plan: &FlightPlan, leg: usize, entry: LegEntry) {
        self.add_leg_time(plan);
        self.leg = leg;
        let planned = &plan.legs[leg];
        if let Some(start) = planned.start_ns {
            self.elapsed_base_ns = start - plan.start_ns;
            self.time_ns = start;
        }
        for (device, state) in plan.devices.iter().zip(&mut self.devices) {
            state.start_leg(device, &planned.settings);
        }
        let is_after_times = leg.checked_sub(1).is_some_and(|before| plan.legs[before].times.is_some());
        if planned.times.is_some() || is_after_times {
            // The clock is at the next step, which a leg with pulse times may take later.
            self.timer_start_ns = (plan.start_ns + self.elapsed_base_ns).rem_euclid(WEEK_NS);
            self.time_ns = self.exact_time_ns(plan).rem_euclid(WEEK_NS);
        } else {
            self.timer_start_ns = self.time_ns;
        }
        self.pulses_before = self.devices[0].pulses;
        // Times count from the start of the leg, a duration in other legs from their first pulse.
        self.timer_is_pending =
            planned.max_duration > 0.0 && planned.settings.active && planned.times.is_none();
        self.last_sample_ns = 0.0;
        let clock = if planned.times.is_some() { self.clock_base } else { self.clock(plan) };
        self.platform.start_leg(&plan.platform, leg, entry, clock);
        let rested = leg.checked_sub(1).is_some_and(|before| !plan.legs[before].settings.active);
        if rested && planned.settings.active {
            let devices = if plan.kinematics.channels_restart { self.devices.len() } else { 1 };
            self.devices[..devices]
                .iter_mut()
                .zip(&plan.devices)
                .for_each(|(state, device)| state.restart(device));
        }
        // Pulse times never end, at any rate.
        self.guard = if planned.max_duration > 0.0 || planned.times.is_some() {
            ProgressGuard::disabled()
        } else {
            ProgressGuard::of_leg(&plan.platform, &self.platform, leg, self.ticks)
        };
    }

    #[cold]
    fn check_progress(&mut self, plan: &FlightPlan) -> Result<()> {
        let waiting = !self.devices[0].head.is_completed();
        let distance = self.platform.distance_left().unwrap_or(0.0);
        if self.guard.check(&plan.platform, self.leg, self.ticks, distance, waiting) {
            return Ok(());
        }
        let leg = &plan.legs[self.leg];
        let mut problems = vlscan_base::diag::Diagnostics::default();
        let at = self.platform.position() + plan.shift;
        let message = format!(
            "leg {} never ends: after {:.0} s of flight its platform is at x {:.2} y {:.2} z {:.2}, came \
             within {:.2} m of the next waypoint and does not get nearer",
            leg.number,
            self.clock(plan),
            at.x,
            at.y,
            at.z,
            self.guard.nearest(),
        );
        let help = if plan.platform.is_physical() {
            "give the leg a maxDuration_s, move the waypoint, or use a platform of type linearpath, which \
             always arrives"
        } else {
            "give the leg a maxDuration_s, or a movePerSec_m above 0"
        };
        let help = vlscan_survey::named_as_in(leg.place.as_ref(), help);
        problems.error(leg.place.clone(), message).help(help);
        Err(Error::Input(Box::new(problems)))
    }

    /// Index of the current leg in the plan.
    pub fn leg_index(&self) -> usize {
        self.leg
    }

    /// Number of the current leg in the survey; it is part of the names of output files.
    pub fn leg_number(&self, plan: &FlightPlan) -> u32 {
        plan.legs[self.leg].number
    }

    /// Steps since the start of the run without changes of legs; scenes move with them.
    pub fn steps(&self) -> u64 {
        self.ticks - self.leg as u64
    }

    /// Number of pulses that each device has emitted so far, over all legs.
    pub fn emitted(&self) -> impl Iterator<Item = u64> + '_ {
        self.devices.iter().map(|device| device.pulses)
    }

    /// Position of the platform, m, scene frame.
    pub fn position(&self) -> DVec3 {
        self.platform.position()
    }

    /// The time that times of pulses and poses count from, s, along a trajectory in adjusted standard GPS
    /// time; 0 where they are seconds of the week.
    pub fn time_origin(&self, plan: &FlightPlan) -> f64 {
        self.platform.time_origin(&plan.platform).unwrap_or(0.0)
    }

    /// GPS time of the next step, ns of the week.
    pub fn time_ns(&self) -> f64 {
        self.time_ns
    }

    /// The completed fraction of the current leg (spec outputs §10.3); 0 for a stream without a maximum
    /// duration.
    pub fn progress(&self, plan: &FlightPlan) -> f64 {
        let leg = &plan.legs[self.leg];
        if self.ended {
            return 1.0;
        }
        let clock = self.clock(plan);
        let by_time = if leg.max_duration > 0.0 {
            (elapsed_ns(self.time_ns, self.timer_start_ns) * 1e-9 / leg.max_duration).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let way = self.platform.progress(&plan.platform, self.leg, clock);
        let by_way = way.or_else(|| self.devices[0].head.progress(leg.settings.head_start));
        by_way.unwrap_or(0.0).max(by_time)
    }

    /// Appends poses of a stream; other platforms ignore them.
    pub fn feed(&mut self, plan: &FlightPlan, block: Vec<Pose>) {
        let Some(stream) = self.platform.stream_mut() else { return };
        let first = !stream.has_begun();
        stream.feed(block, plan.shift);
        if first && let Some(time) = self.platform.next_time_ns(&plan.platform) {
            (self.time_ns, self.timer_start_ns, self.start_ns) = (time, time, time);
        }
    }

    /// Marks the stream of poses as complete: the flight ends at the last one.
    pub fn end_poses(&mut self) {
        if let Some(stream) = self.platform.stream_mut() {
            stream.end();
        }
    }
}

fn warm_up(device: &DevicePlan, state: &mut DeviceState, steps: u64, with_head: bool) {
    state.is_warmed_up = true;
    if with_head {
        // The head has the error of the deflection next to it.
        for _ in 0..steps {
            state.step_head(device);
            state.warm_up_deflector(device, 1);
        }
    } else {
        state.warm_up_deflector(device, steps);
    }
}
