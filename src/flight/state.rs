//! A run in progress.

use super::clock::{WEEK_NS, elapsed_ns};
use super::guard::Watch;
use super::plan::{FlightPlan, PlannedLeg};
use super::pulse::{FlightSink, PoseSample, Pulse};
use crate::error::{Error, Result};
use crate::geom::{DVec3, Rotation};
use crate::platform::{LegEntry, PlatformState, Pose, Readiness};
use crate::scanner::{DevicePlan, DeviceState};
use crate::survey::Kinematics;

/// What a step did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Time went on by one pulse period of the first leg.
    Advanced,
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
    /// One tick for every step, leg changes included.
    ticks: u64,
    /// The step clock when the leg began, s, where legs have periods of their own.
    clock_base: f64,
    /// Steps of this leg.
    leg_ticks: u64,
    /// Time since the run's start when the leg began, ns.
    elapsed_base_ns: f64,
    /// The GPS clock, ns of the week. In the reference a running sum, which rounds; the exact clock multiplies.
    time_ns: f64,
    /// The GPS clock at the first step.
    begun_ns: f64,
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
            clock_base: 0.0,
            leg_ticks: 0,
            elapsed_base_ns: 0.0,
            time_ns: plan.start_ns,
            begun_ns: plan.start_ns,
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
        self.close_leg(plan);
        (self.ticks, self.clock_base) = (0, 0.0);
        self.begin(plan);
    }

    fn begin(&mut self, plan: &FlightPlan) {
        self.start_leg(plan, 0, LegEntry::Initial);
        self.deferred &= plan.kinematics.legs_on_time;
    }

    /// The step clock, s: every leg at its own period, without the ticks that changing legs takes in the reference, as far
    /// as these corrections are on.
    #[inline]
    fn clock(&self, plan: &FlightPlan) -> f64 {
        let Kinematics { leg_pulse_rate, legs_on_time, .. } = plan.kinematics;
        if leg_pulse_rate || legs_on_time {
            self.clock_base + self.leg_ticks as f64 / plan.legs[self.leg].frequency
        } else {
            self.ticks as f64 * plan.clock_step
        }
    }

    /// Seconds since the first step, of which the errors of navigation are functions. A flight lasts less than half a week.
    #[inline]
    fn since_start(&self) -> f64 {
        let elapsed = self.time_ns - self.begun_ns;
        (if elapsed < -0.5 * WEEK_NS { elapsed + WEEK_NS } else { elapsed }) * 1e-9
    }

    /// Adds the leg's time to that of the legs before it.
    fn close_leg(&mut self, plan: &FlightPlan) {
        self.clock_base = self.clock(plan);
        self.elapsed_base_ns += self.leg_ticks as f64 * 1e9 / plan.legs[self.leg].frequency;
        self.leg_ticks = 0;
    }

    /// Time goes on by one step: by a sum that rounds, or by a product that does not.
    #[inline]
    fn tick(&mut self, plan: &FlightPlan) {
        (self.ticks, self.leg_ticks) = (self.ticks + 1, self.leg_ticks + 1);
        let leg = &plan.legs[self.leg];
        self.time_ns = if plan.kinematics.exact_clock {
            plan.start_ns + (self.elapsed_base_ns + self.leg_ticks as f64 * 1e9 / leg.frequency)
        } else {
            self.time_ns + leg.increment_ns
        };
        if self.time_ns > WEEK_NS {
            self.time_ns = if plan.kinematics.exact_clock {
                self.time_ns.rem_euclid(WEEK_NS)
            } else {
                self.time_ns - WEEK_NS
            };
        }
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
        if leg.max_duration > 0.0 && self.time_is_up(leg, plan.kinematics.legs_on_time) {
            return Ok(self.change_leg(plan));
        }
        let clock = self.clock(plan);
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
        self.tick(plan);
        Ok(Step::Advanced)
    }

    #[inline]
    fn step_devices(&mut self, plan: &FlightPlan, leg: &PlannedLeg, sink: &mut impl FlightSink) {
        let since_start = self.since_start();
        let FlightState { platform, devices, time_ns, .. } = self;
        for (index, (device, state)) in plan.devices.iter().zip(devices).enumerate() {
            if leg.settings.active && !state.warm {
                warm_up(device, state, leg.warmup, !plan.kinematics.warmup_of_optics);
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
            sink.pulse(|| plan.pulse(platform, index, state, *time_ns, since_start));
        }
    }

    #[inline]
    fn sample(&mut self, plan: &FlightPlan, leg: &PlannedLeg, sink: &mut impl FlightSink) {
        let due =
            self.sampled_ns == 0.0 || elapsed_ns(self.time_ns, self.sampled_ns) >= leg.sample_interval_ns;
        if due {
            self.sampled_ns = self.time_ns;
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

    /// Whether the leg's greatest duration has passed since its first pulse (spec kinematics §1.3, items 1 and 2).
    fn time_is_up(&mut self, leg: &PlannedLeg, legs_on_time: bool) -> bool {
        let waiting = self.devices[0].pulses == self.pulses_before;
        if self.deferred {
            // The step of the first pulse is over when that pulse is seen; the reference starts its timer only then.
            if waiting || !legs_on_time {
                self.timer_ns = self.time_ns;
            }
            self.deferred = waiting;
        }
        let slack = if legs_on_time { 1e6 / leg.frequency } else { 0.0 };
        (elapsed_ns(self.time_ns, self.timer_ns) + slack) * 1e-9 >= leg.max_duration
    }

    fn change_leg(&mut self, plan: &FlightPlan) -> Step {
        let next = self.leg + 1;
        if next >= plan.legs.len() {
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
        self.close_leg(plan);
        self.leg = leg;
        let planned = &plan.legs[leg];
        if let Some(start) = planned.start_ns {
            self.elapsed_base_ns = start - plan.start_ns;
            self.time_ns = start;
        }
        for (device, state) in plan.devices.iter().zip(&mut self.devices) {
            state.start_leg(device, &planned.settings);
        }
        self.timer_ns = self.time_ns;
        self.pulses_before = self.devices[0].pulses;
        self.deferred = planned.max_duration > 0.0 && planned.settings.active;
        self.sampled_ns = 0.0;
        let clock = self.clock(plan);
        self.platform.start_leg(&plan.platform, leg, entry, clock);
        let rested = leg.checked_sub(1).is_some_and(|before| !plan.legs[before].settings.active);
        if rested && planned.settings.active {
            let devices = if plan.kinematics.channels_restart { self.devices.len() } else { 1 };
            self.devices[..devices].iter_mut().for_each(|device| device.deflector.restart());
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
        let distance = self.platform.distance_left().unwrap_or(0.0);
        if !self.watch.is_stuck(&plan.platform, self.leg, self.ticks, distance, waiting) {
            return Ok(());
        }
        let leg = &plan.legs[self.leg];
        let mut problems = crate::diag::Diagnostics::default();
        let at = self.platform.position() + plan.shift;
        let message = format!(
            "leg {} never ends: after {:.0} s of flight its platform is at x {:.2} y {:.2} z {:.2}, came within {:.2} m \
             of the next waypoint and does not get nearer",
            leg.number,
            self.clock(plan),
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
    pub fn leg_number(&self, plan: &FlightPlan) -> u32 {
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
        let clock = self.clock(plan);
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
            (self.time_ns, self.timer_ns, self.begun_ns) = (time, time, time);
        }
    }

    /// No pose will follow: the flight ends at the last one.
    pub fn end_poses(&mut self) {
        if let Some(stream) = self.platform.stream_mut() {
            stream.end();
        }
    }
}

fn warm_up(device: &DevicePlan, state: &mut DeviceState, steps: u64, with_head: bool) {
    state.warm = true;
    for _ in 0..steps {
        if with_head {
            state.step_head(device);
        }
        state.deflector.step(device);
    }
}

impl FlightPlan {
    /// The pulse that device `index` emits now (spec kinematics §3, §7.2), `since_start` seconds after the flight's start.
    fn pulse(
        &self,
        platform: &PlatformState,
        index: usize,
        state: &DeviceState,
        time_ns: f64,
        since_start: f64,
    ) -> Pulse {
        let plan = &self.devices[index];
        let (device, emitted) = (index as u32, state.pulses - 1);
        let of_platform = self.kinematics.attitude_noise_of_platform;
        let (place, steady) = (platform.position(), platform.pointing(&self.platform));
        let noisy = |attitude: Rotation| self.noise.apply_noise(attitude, device, emitted);
        let exact_deflection = state.deflector.exact_rotation(plan);
        let deflection =
            if state.deflector.has_error() { state.deflector.rotation(plan) } else { exact_deflection };
        // The beam of a platform with this attitude, and the same without mechanical errors and noise, if there are any.
        let beams = |steady: Rotation| {
            let carrier = if of_platform { noisy(steady) } else { steady }.after(self.mount.rotation);
            let clean = carrier.after(state.emitter(plan)).after(deflection);
            let attitude = if of_platform { clean } else { noisy(clean) };
            let exact = if plan.errors.any() {
                steady.after(self.mount.rotation).after(state.exact_emitter(plan)).after(exact_deflection)
            } else {
                attitude
            };
            (attitude, exact)
        };
        let origin_of = |place: DVec3, steady: Rotation| {
            let (mount, emitter) = (self.mount.offset, plan.beam_origin.offset);
            if self.kinematics.mount_offsets_turn {
                let pointing = if of_platform { noisy(steady) } else { steady };
                let head = pointing.after(self.mount.rotation).after(state.head.rotation(plan));
                place + pointing.apply(mount) + head.apply(emitter)
            } else {
                place + mount + emitter
            }
        };
        let origin = origin_of(place, steady);
        let (attitude, exact_attitude) = beams(steady);
        let (origin_error, reported_attitude) = match &self.navigation {
            Some(navigation) => {
                let (place, steady) = navigation.reported(place, steady, since_start);
                (origin_of(place, steady) - origin, beams(steady).1)
            }
            None => (DVec3::ZERO, exact_attitude),
        };
        let range_error = plan.errors.range.as_ref().map_or(0.0, |e| e.eval(state.deflector.exact_angle()));
        Pulse {
            origin: origin + self.noise.offset(device, emitted),
            attitude,
            exact_attitude,
            reported_attitude,
            origin_error,
            time_ns,
            number: state.pulses,
            device,
            scan_angle: state.deflector.scan_angle(&exact_deflection),
            range_error,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::testing::*;
    use crate::geom::radians;
    use crate::survey::{Deflector, Mount, Noise, NoiseKind, PlatformKind, PoseStream, Survey};

    fn busy_survey() -> Survey {
        let scan = |l: &mut crate::survey::Leg| {
            (l.scanner.scan_freq, l.scanner.scan_angle) = (10.0, radians(120.0));
            l.scanner.trajectory_interval = 0.03;
            l.scanner.warmup = 0.02;
            turn_head(l, 36.0, 5.0);
        };
        let legs =
            [[0.0, 0.0, 10.0], [7.0, 3.0, 10.0], [9.0, -8.0, 12.0]].map(|p| leg(p, 10.0, scan)).to_vec();
        let mut s = survey(PlatformKind::LinearPath, mount([0.0, 0.1, 0.2]), polygon(), legs);
        s.platform.noise.position[2] =
            Some(Noise { kind: NoiseKind::Normal { mean: 0.0, stdev: 0.1 }, clip: None, lifespan: 3 });
        let mut second = s.scanner.devices[0].clone();
        second.deflector = Deflector::Oscillating { scan_product: 1e6 };
        s.scanner.devices.push(second);
        s
    }

    /// Steps as the producer of chunks does, cutting every `size` pulses and at legs, and replays each chunk from its
    /// snapshot.
    fn in_chunks(plan: &FlightPlan, size: u64) -> Keep {
        let mut state = FlightState::start(plan);
        let mut all = Keep::default();
        let mut ended = false;
        while !ended {
            let snapshot = state.clone();
            let (mut count, mut steps) = (Count::default(), 0);
            loop {
                steps += 1;
                let step = state.step(plan, &mut count).unwrap();
                ended = step == Step::Ended;
                if step != Step::Advanced || count.pulses >= size {
                    break;
                }
            }
            let mut worker = snapshot;
            let mut keep = Keep::default();
            (0..steps).for_each(|_| _ = worker.step(plan, &mut keep).unwrap());
            assert_eq!((keep.pulses.len() as u64, keep.poses.len() as u64), (count.pulses, count.poses));
            all.pulses.extend(keep.pulses);
            all.poses.extend(keep.poses);
        }
        all
    }

    #[test]
    fn replayed_chunks_are_the_flight() {
        let s = busy_survey();
        let (plan, _) = plan_of(&s).unwrap();
        let whole = fly(&s);
        let pulses: Vec<Pulse> = whole.iter().flat_map(|l| l.pulses.clone()).collect();
        let poses: Vec<PoseSample> = whole.iter().flat_map(|l| l.poses.clone()).collect();
        assert!(pulses.len() > 100 && poses.len() > 50);
        for size in [1, 7, 64, 10_000] {
            let chunked = in_chunks(&plan, size);
            assert!(chunked.pulses == pulses && chunked.poses == poses, "chunks of {size}");
        }
    }

    #[test]
    fn snapshots_are_small() {
        assert!(size_of::<FlightState>() <= 512, "{}", size_of::<FlightState>());
        assert!(size_of::<DeviceState>() <= 192, "{}", size_of::<DeviceState>());
    }

    #[test]
    fn a_repetition_flies_the_same_way_later() {
        let mut s = busy_survey();
        s.platform.noise = Default::default();
        let (plan, _) = plan_of(&s).unwrap();
        let mut state = FlightState::start(&plan);
        let first = fly_plan(&plan, &mut state).unwrap();
        assert_eq!(state.step(&plan, &mut Count::default()).unwrap(), Step::Ended);
        let (time, numbers) = (state.time_ns(), first.iter().map(|l| l.pulses.len()).sum::<usize>());
        state.repeat(&plan);
        assert_eq!((state.steps(), state.leg_index()), (0, 0));
        let second = fly_plan(&plan, &mut state).unwrap();
        let polygons = |legs: &[FlownLeg]| *legs[0].pulses.iter().find(|p| p.device == 0).unwrap();
        let (a, b) = (polygons(&first), polygons(&second));
        assert_eq!(a.origin, b.origin);
        assert!((a.attitude.forward() - b.attitude.forward()).length() < 1e-6);
        assert_eq!(b.time_ns - time, a.time_ns - START_NS);
        let twice: usize = second.iter().map(|l| l.pulses.len()).sum();
        let device_0 = second.iter().flat_map(|l| &l.pulses).rfind(|p| p.device == 0).unwrap();
        assert!(device_0.number as usize > numbers / 4 && twice == numbers);
    }

    #[test]
    fn progress_grows_to_one() {
        let (plan, _) = plan_of(&busy_survey()).unwrap();
        let mut state = FlightState::start(&plan);
        let (mut last, mut number) = (0.0, 0);
        loop {
            match state.step(&plan, &mut Count::default()).unwrap() {
                Step::Ended => break,
                Step::LegChanged => {
                    assert!(last > 0.9, "leg {number} ended at {last}");
                    (last, number) = (0.0, number + 1);
                }
                _ => {
                    let now = state.progress(&plan);
                    assert!((0.0..=1.0).contains(&now));
                    last = now;
                }
            }
        }
        assert_eq!(state.progress(&plan), 1.0);
        let turn = leg([0.0; 3], 0.0, |l| turn_head(l, 36.0, 9.0));
        let (plan, _) =
            plan_of(&survey(PlatformKind::Static, Mount::IDENTITY, straight(), vec![turn])).unwrap();
        let mut state = FlightState::start(&plan);
        (0..5).for_each(|_| _ = state.step(&plan, &mut Count::default()));
        assert!((state.progress(&plan) - 0.2).abs() < 1e-9);
    }

    #[test]
    fn the_week_turns_without_disturbing_durations() {
        let legs = vec![leg([0.0; 3], 0.0, |l| {
            l.scanner.max_duration = Some(3.0);
            l.scanner.trajectory_interval = 1.0;
        })];
        let s = survey(PlatformKind::Static, Mount::IDENTITY, straight(), legs);
        let options = crate::flight::FlightOptions { gps_start_ns: WEEK_NS - 1e9, ..Default::default() };
        let (plan, _) = FlightPlan::new(&s, DVec3::ZERO, &|_, _| None, &options).unwrap();
        let flown = fly_plan(&plan, &mut FlightState::start(&plan)).unwrap();
        assert_eq!((flown[0].steps, flown[0].poses.len()), (300, 3));
        assert!(flown[0].pulses.iter().all(|p| (0.0..=WEEK_NS).contains(&p.time_ns)));
    }

    fn stream_survey(change: impl FnOnce(&mut crate::survey::Leg)) -> Survey {
        let kind = PlatformKind::Stream(PoseStream::at("-"));
        survey(kind, Mount::IDENTITY, polygon(), vec![leg([0.0; 3], 0.0, change)])
    }

    fn scanning(l: &mut crate::survey::Leg) {
        (l.scanner.scan_freq, l.scanner.scan_angle) = (10.0, radians(120.0));
        l.scanner.trajectory_interval = 0.1;
    }

    /// Flies along the poses, which arrive in blocks of `cut`.
    fn fly_stream(s: &Survey, poses: &[Pose], cut: usize) -> Keep {
        let (plan, _) = plan_of(s).unwrap();
        let (mut state, mut blocks, mut keep) =
            (FlightState::start(&plan), poses.chunks(cut), Keep::default());
        loop {
            let before = format!("{state:?}");
            match state.step(&plan, &mut keep).unwrap() {
                Step::NeedsPoses => {
                    assert_eq!(before, format!("{state:?}"), "asking for poses changes nothing");
                    match blocks.next() {
                        Some(block) => state.feed(&plan, block.to_vec()),
                        None => state.end_poses(),
                    }
                }
                Step::Ended => return keep,
                _ => {}
            }
        }
    }

    fn poses() -> Vec<Pose> {
        let pose = |i: i32| Pose {
            time: 1000.0 + f64::from(i) * 0.03,
            position: DVec3::new(f64::from(i), 2.0, 3.0),
            attitude: Rotation::about_z(f64::from(i) * 0.1),
        };
        (0..60).map(pose).collect()
    }

    #[test]
    fn a_stream_is_flown_alike_however_it_arrives() {
        let s = stream_survey(scanning);
        let whole = fly_stream(&s, &poses(), 1000);
        assert_eq!(whole.pulses[0].time_ns, 1000e9);
        // 59 stretches of 0.03 s at 100 Hz: 178 steps, 5 of the first 11 fire
        assert!(
            whole.pulses.len() > 70 && whole.poses.len() == 18,
            "{} {}",
            whole.pulses.len(),
            whole.poses.len()
        );
        let halfway = whole.poses[3];
        assert!((halfway.position.x - 10.0).abs() < 1e-9, "{}", halfway.position);
        for cut in [1, 2, 13] {
            let cut_up = fly_stream(&s, &poses(), cut);
            assert!(cut_up.pulses == whole.pulses && cut_up.poses == whole.poses, "blocks of {cut}");
        }
    }

    #[test]
    fn a_stream_may_be_empty_or_cut_short() {
        assert!(fly_stream(&stream_survey(scanning), &[], 1).pulses.is_empty());
        let short = stream_survey(|l| {
            scanning(l);
            l.scanner.max_duration = Some(0.5);
        });
        let kept = fly_stream(&short, &poses(), 7);
        assert_eq!(kept.poses.len(), 5);
    }
}
