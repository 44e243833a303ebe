//! A run in progress.

use super::clock::{WEEK_NS, elapsed_ns};
use super::guard::Watch;
use super::plan::{FlightPlan, PlannedLeg};
use super::pulse::{FlightSink, PoseSample, Pulse};
use crate::error::{Error, Result};
use crate::platform::{LegEntry, PlatformState, Pose, Readiness};
use crate::scanner::{DevicePlan, DeviceState};

/// What a step did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Time went on by one pulse period of the first leg.
    Went,
    /// The next leg began; no time passed.
    LegChanged,
    /// Nothing happened, because poses must arrive first, see [`FlightState::feed`].
    NeedsPoses,
    /// The last leg is over; no time passed.
    Ended,
}

/// Where a run stands: clocks, platform and devices. Cheap to clone; steps from clones are the same bit for bit.
#[derive(Clone, Debug)]
pub struct FlightState {
    leg: usize,
    ended: bool,
    /// The step clock: one tick for every step, leg changes included.
    ticks: u64,
    /// The GPS clock, ns of the week. A running sum, so it rounds as the reference's does.
    time_ns: f64,
    /// Start of the leg's greatest duration.
    timer_ns: f64,
    /// Device 0's pulses when the leg started.
    pulses_before: u64,
    /// The timer waits for the leg's first pulse.
    deferred: bool,
    /// Time of the last trajectory sample; 0 = none in this leg.
    sampled_ns: f64,
    platform: PlatformState,
    devices: Vec<DeviceState>,
    watch: Watch,
}

impl FlightState {
    /// The state before the first step of the first leg.
    pub fn start(plan: &FlightPlan) -> FlightState {
        let mut state = FlightState {
            leg: 0,
            ended: false,
            ticks: 0,
            time_ns: plan.start_ns,
            timer_ns: plan.start_ns,
            pulses_before: 0,
            deferred: false,
            sampled_ns: 0.0,
            platform: plan.platform.at_rest(),
            devices: plan.devices.iter().map(DeviceState::at_rest).collect(),
            watch: Watch::off(),
        };
        state.begin(plan);
        state
    }

    /// Begins another run with the same clock and pulse numbers (spec kinematics §1.6, repetitions). Streams of poses
    /// cannot be repeated.
    pub fn repeat(&mut self, plan: &FlightPlan) {
        self.platform.restore(&FlightState::start(plan).platform);
        self.ended = false;
        self.ticks = 0;
        self.begin(plan);
    }

    fn begin(&mut self, plan: &FlightPlan) {
        self.start_leg(plan, 0, LegEntry::Initial);
        self.deferred = false;
    }

    /// Takes one step and hands pulses and trajectory samples to `sink`.
    ///
    /// # Errors
    /// [`Error::Input`] for a leg that turns out not to end.
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
        if leg.max_duration > 0.0 && self.time_is_up(leg) {
            return Ok(self.change_leg(plan));
        }
        let clock = self.ticks as f64 * plan.clock_step;
        if !leg.still
            && self.devices[0].head.completed()
            && self.platform.reached(&plan.platform, self.leg, clock)
        {
            return Ok(self.change_leg(plan));
        }
        if self.ticks >= self.watch.look_at {
            self.look(plan)?;
        }
        self.platform.step(&plan.platform, self.leg, clock);
        if plan.platform.is_physical()
            && let Some(distance) = self.platform.distance_left()
        {
            self.watch.see(distance);
        }
        self.step_devices(plan, leg, sink);
        if leg.settings.active && leg.sample_interval_ns != 0.0 {
            self.sample(plan, leg, sink);
        }
        self.time_ns += plan.increment_ns;
        if self.time_ns > WEEK_NS {
            self.time_ns -= WEEK_NS;
        }
        self.ticks += 1;
        Ok(Step::Went)
    }

    #[inline]
    fn step_devices(&mut self, plan: &FlightPlan, leg: &PlannedLeg, sink: &mut impl FlightSink) {
        let FlightState { platform, devices, time_ns, .. } = self;
        for (index, (device, state)) in plan.devices.iter().zip(devices).enumerate() {
            if leg.settings.active && !state.warm {
                warm_up(device, state, leg.warmup);
            }
            state.step_head(device);
            if !leg.settings.active {
                continue;
            }
            state.deflector.step(device);
            if !state.deflector.emits() {
                continue;
            }
            state.pulses += 1;
            sink.pulse(|| plan.pulse(platform, index, state, *time_ns));
        }
    }

    #[inline]
    fn sample(&mut self, plan: &FlightPlan, leg: &PlannedLeg, sink: &mut impl FlightSink) {
        let due =
            self.sampled_ns == 0.0 || elapsed_ns(self.time_ns, self.sampled_ns) >= leg.sample_interval_ns;
        if due {
            self.sampled_ns = self.time_ns;
            let (platform, time_ns) = (&self.platform, self.time_ns);
            sink.pose(|| {
                let [roll, pitch, yaw] = platform.angles(&plan.platform);
                PoseSample { time_ns, position: platform.position(), roll, pitch, yaw }
            });
        }
    }

    /// Whether the leg's greatest duration has passed since its first pulse (spec kinematics §1.3, items 1 and 2).
    fn time_is_up(&mut self, leg: &PlannedLeg) -> bool {
        if self.deferred {
            self.timer_ns = self.time_ns;
            self.deferred = self.devices[0].pulses == self.pulses_before;
        }
        elapsed_ns(self.time_ns, self.timer_ns) * 1e-9 >= leg.max_duration
    }

    fn change_leg(&mut self, plan: &FlightPlan) -> Step {
        let next = self.leg + 1;
        if next >= plan.legs.len() {
            self.ended = true;
            return Step::Ended;
        }
        self.start_leg(plan, next, LegEntry::Continuing);
        self.ticks += 1;
        Step::LegChanged
    }

    /// Starts leg `leg` (spec kinematics §1.4).
    fn start_leg(&mut self, plan: &FlightPlan, leg: usize, entry: LegEntry) {
        self.leg = leg;
        let planned = &plan.legs[leg];
        for (device, state) in plan.devices.iter().zip(&mut self.devices) {
            state.start_leg(device, &planned.settings);
        }
        self.timer_ns = self.time_ns;
        self.pulses_before = self.devices[0].pulses;
        self.deferred = planned.max_duration > 0.0 && planned.settings.active;
        self.sampled_ns = 0.0;
        let clock = self.ticks as f64 * plan.clock_step;
        self.platform.start_leg(&plan.platform, leg, entry, clock);
        let rested = leg.checked_sub(1).is_some_and(|before| !plan.legs[before].settings.active);
        if rested && planned.settings.active {
            self.devices[0].deflector.restart();
        }
        self.watch = if planned.max_duration > 0.0 {
            Watch::off()
        } else {
            Watch::of_leg(&plan.platform, &self.platform, leg, self.ticks)
        };
    }

    #[cold]
    fn look(&mut self, plan: &FlightPlan) -> Result<()> {
        let waiting = !self.devices[0].head.completed();
        if !self.watch.is_stuck(&plan.platform, self.leg, self.ticks, waiting) {
            return Ok(());
        }
        let leg = &plan.legs[self.leg];
        let mut problems = crate::diag::Diagnostics::default();
        let at = self.platform.position() + plan.shift;
        let message = format!(
            "leg {} never ends: after {:.0} s of flight its platform is at x {:.2} y {:.2} z {:.2}, came within {:.2} m \
             of the next waypoint and does not get nearer",
            leg.number,
            self.ticks as f64 * plan.clock_step,
            at.x,
            at.y,
            at.z,
            self.watch.nearest(),
        );
        problems.error(leg.place.clone(), message).help(
            "give the leg a maxDuration_s, move the waypoint, or use a platform of type linearpath, which always arrives",
        );
        Err(Error::Input(Box::new(problems)))
    }

    /// Index of the current leg among those of the plan.
    pub fn leg_index(&self) -> usize {
        self.leg
    }

    /// The survey's number of the current leg, which names output files.
    pub fn leg(&self, plan: &FlightPlan) -> u32 {
        plan.legs[self.leg].number
    }

    /// Whether the current leg emits pulses.
    pub fn active(&self, plan: &FlightPlan) -> bool {
        plan.legs[self.leg].settings.active
    }

    /// Steps with motion since the run began; scenes move with them.
    pub fn steps(&self) -> u64 {
        self.ticks - self.leg as u64
    }

    /// GPS time of the next step, ns of the week.
    pub fn time_ns(&self) -> f64 {
        self.time_ns
    }

    /// The share of the current leg that is done, from 0 to 1 (spec outputs §10.3). A stream without a greatest duration
    /// stays at 0.
    pub fn progress(&self, plan: &FlightPlan) -> f64 {
        let leg = &plan.legs[self.leg];
        if self.ended {
            return 1.0;
        }
        let clock = self.ticks as f64 * plan.clock_step;
        let by_time = if leg.max_duration > 0.0 {
            (elapsed_ns(self.time_ns, self.timer_ns) * 1e-9 / leg.max_duration).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let way = self.platform.progress(&plan.platform, self.leg, clock);
        let by_way = way.or_else(|| self.devices[0].head.progress(leg.settings.head_start));
        by_way.unwrap_or(0.0).max(by_time)
    }

    /// Takes in poses of a stream. Other platforms ignore them.
    pub fn feed(&mut self, plan: &FlightPlan, block: Vec<Pose>) {
        let Some(stream) = self.platform.stream_mut() else { return };
        let first = !stream.has_begun();
        stream.feed(block, plan.shift);
        if first && let Some(time) = self.platform.next_time_ns(&plan.platform) {
            (self.time_ns, self.timer_ns) = (time, time);
        }
    }

    /// No pose will follow: the flight ends at the last one.
    pub fn end_of_poses(&mut self) {
        if let Some(stream) = self.platform.stream_mut() {
            stream.end();
        }
    }
}

fn warm_up(device: &DevicePlan, state: &mut DeviceState, steps: u64) {
    state.warm = true;
    for _ in 0..steps {
        state.step_head(device);
        state.deflector.step(device);
    }
}

impl FlightPlan {
    /// The pulse that device `index` emits now (spec kinematics §3, §7.2).
    fn pulse(&self, platform: &PlatformState, index: usize, state: &DeviceState, time_ns: f64) -> Pulse {
        let plan = &self.devices[index];
        let (device, emitted) = (index as u32, state.pulses - 1);
        let pointing = platform.pointing(&self.platform);
        let carrier = pointing.after(self.mount.rotation);
        let (mount, emitter) = (self.mount.offset, plan.beam_origin.offset);
        let origin = if self.rotate_mount_offsets {
            let head = carrier.after(state.head.rotation(plan));
            platform.position() + pointing.apply(mount) + head.apply(emitter)
        } else {
            platform.position() + mount + emitter
        };
        let clean = carrier.after(state.emitter(plan)).after(state.deflector.rotation(plan));
        let attitude = self.noise.disturb(clean, device, emitted);
        let exact_attitude = if plan.errors.any() {
            carrier.after(state.exact_emitter(plan)).after(state.deflector.exact_rotation(plan))
        } else {
            attitude
        };
        let range_error = plan.errors.range.as_ref().map_or(0.0, |e| e.eval(state.deflector.exact_angle()));
        Pulse {
            origin: origin + self.noise.offset(device, emitted),
            attitude,
            exact_attitude,
            time_ns,
            number: state.pulses,
            device,
            scan_angle: state.deflector.scan_angle(plan),
            range_error,
        }
    }
}
