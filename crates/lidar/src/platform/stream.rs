//! A platform that follows poses as they arrive and keeps a window of them.

use super::poses::fix::Pose;
use std::sync::Arc;
use vlscan_geom::{DVec3, Rotation};
use vlscan_survey::PulseTimes;

/// Availability of the pose of the next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Readiness {
    /// The step can be taken.
    Ready,
    /// Poses must arrive first.
    NeedsPoses,
    /// The next step is after the last pose.
    Ended,
}

/// Parameters of following a stream of poses.
#[derive(Clone, Debug)]
pub struct StreamPlan {
    /// Steps per second.
    pub frequency: u32,
    /// Times of the steps, s after the first pose, in place of equal ones.
    pub times: Option<PulseTimes>,
    /// Longest interval between two poses in which steps are taken, s.
    pub max_gap: f64,
    /// True if times in adjusted standard GPS time are kept.
    pub keeps_adjusted_times: bool,
}

/// The time (s) that the times of pulses count from along a trajectory that begins at `first` seconds in
/// adjusted standard GPS time (GPS seconds less 10⁹): that less the seconds since the last multiple of a
/// week, so that times of pulses are small and exact. `None` for other scales: seconds of the week lie
/// between 0 and 604800, and times beyond ±10⁹ are POSIX or GPS seconds.
pub fn adjusted_time_origin(first: f64) -> Option<f64> {
    let week = WEEK_NS * 1e-9;
    let is_adjusted = (-1e9..1e9).contains(&first) && !(-week..=week).contains(&first);
    is_adjusted.then(|| (first / week).floor() * week)
}

const WEEK_NS: f64 = 604_800e9;

/// Position in a stream of poses. Steps are numbered from the first pose, and the time of a step is a
/// function of its number alone.
#[derive(Clone, Debug)]
pub struct StreamState {
    /// The poses around the current step and all later ones that have arrived.
    window: Arc<[Knot]>,
    /// Index in `window` of the pose that ends the current segment.
    segment: usize,
    /// Time of the first pose in the stream's own scale, s.
    first_time: f64,
    /// The next step, unless it falls in a gap.
    next: StepNumber,
    /// The current step's time, s after the first pose.
    elapsed: f64,
    complete: bool,
}

/// Number of a step: whole seconds after the first pose, and steps within the second; with times of their own
/// the number of all steps before, in place of the seconds.
#[derive(Clone, Copy, Debug, Default)]
struct StepNumber {
    seconds: u64,
    steps: u32,
}

impl StepNumber {
    fn first_from(elapsed: f64, plan: &StreamPlan) -> StepNumber {
        if let Some(times) = &plan.times {
            return StepNumber { seconds: times.first_from(elapsed), steps: 0 };
        }
        let seconds = elapsed.floor();
        let steps = ((elapsed - seconds) * f64::from(plan.frequency)).floor() as u32;
        let mut number = StepNumber { seconds: seconds as u64, steps: steps.min(plan.frequency - 1) };
        while number.elapsed(plan) < elapsed {
            number = number.after(plan);
        }
        number
    }

    #[inline]
    fn elapsed(self, plan: &StreamPlan) -> f64 {
        match &plan.times {
            None => self.seconds as f64 + f64::from(self.steps) / f64::from(plan.frequency),
            Some(times) => times.at(self.seconds),
        }
    }

    #[inline]
    fn after(self, plan: &StreamPlan) -> StepNumber {
        match self.steps + 1 {
            steps if steps >= plan.frequency || plan.times.is_some() => {
                StepNumber { seconds: self.seconds + 1, steps: 0 }
            }
            steps => StepNumber { steps, ..self },
        }
    }
}

impl StepNumber {
    /// The number `steps` steps later.
    fn ahead(self, plan: &StreamPlan, steps: u32) -> StepNumber {
        if plan.times.is_some() {
            return StepNumber { seconds: self.seconds + u64::from(steps), ..self };
        }
        let number = u64::from(self.steps) + u64::from(steps);
        let frequency = u64::from(plan.frequency);
        StepNumber { seconds: self.seconds + number / frequency, steps: (number % frequency) as u32 }
    }
}

#[derive(Clone, Copy, Debug)]
struct Knot {
    /// Seconds after the first pose.
    elapsed: f64,
    position: DVec3,
    /// Quaternion with the sign that is nearer to the previous one.
    attitude: Rotation,
    /// Angle from the previous quaternion, rad.
    turn: f64,
}

impl Default for StreamState {
    fn default() -> StreamState {
        StreamState {
            window: Arc::new([]),
            segment: 0,
            first_time: 0.0,
            next: StepNumber::default(),
            elapsed: 0.0,
            complete: false,
        }
    }
}

impl StreamState {
    /// Appends poses, taken to the scene frame by `shift`. Poses that are not later than the last one are
    /// dropped.
    pub fn feed(&mut self, poses: Vec<Pose>, shift: DVec3) {
        let keep = self.segment.saturating_sub(1);
        let mut window = Vec::with_capacity(self.window.len() - keep + poses.len());
        window.extend_from_slice(&self.window[keep..]);
        self.segment -= keep;
        for pose in poses {
            if window.is_empty() {
                self.first_time = pose.time;
            }
            let knot = Knot::after(window.last(), pose, pose.time - self.first_time, shift);
            if window.last().is_none_or(|before| knot.elapsed > before.elapsed) {
                window.push(knot);
            }
        }
        self.window = window.into();
    }

    pub fn end(&mut self) {
        self.complete = true;
    }

    pub fn has_begun(&self) -> bool {
        !self.window.is_empty()
    }

    #[inline]
    pub(super) fn readiness(&self, plan: &StreamPlan) -> Readiness {
        match self.window.last() {
            Some(last) if self.next_number(plan).elapsed(plan) <= last.elapsed => Readiness::Ready,
            _ if self.complete => Readiness::Ended,
            _ => Readiness::NeedsPoses,
        }
    }

    #[inline]
    pub(super) fn next_time_ns(&self, plan: &StreamPlan) -> f64 {
        let week = WEEK_NS * 1e-9;
        let origin = self.time_origin(plan);
        let first = match origin {
            Some(origin) => self.first_time - origin,
            None if self.first_time < week => self.first_time,
            None => self.first_time % week,
        };
        let next = self.next_number(plan);
        let since = match &plan.times {
            None => next.seconds as f64 * 1e9 + f64::from(next.steps) * 1e9 / f64::from(plan.frequency),
            Some(times) => times.at(next.seconds) * 1e9,
        };
        let time = first * 1e9 + since;
        if time > WEEK_NS && origin.is_none() { time % WEEK_NS } else { time }
    }

    /// The time that [`next_time_ns`](Self::next_time_ns) counts from, s, where it is not that of the week.
    pub(super) fn time_origin(&self, plan: &StreamPlan) -> Option<f64> {
        adjusted_time_origin(self.first_time).filter(|_| plan.keeps_adjusted_times)
    }

    /// Number of the next step: the due one, or the first one after the gap that contains it. It is a
    /// function of the surrounding poses alone, independent of when they arrive.
    #[inline]
    fn next_number(&self, plan: &StreamPlan) -> StepNumber {
        if plan.max_gap == f64::INFINITY { self.next } else { self.next_beyond_gaps(plan) }
    }

    fn next_beyond_gaps(&self, plan: &StreamPlan) -> StepNumber {
        let mut next = self.next;
        for pair in self.window[self.segment.saturating_sub(1)..].windows(2) {
            let due = next.elapsed(plan);
            if due <= pair[0].elapsed {
                break;
            }
            if due < pair[1].elapsed && pair[1].elapsed - pair[0].elapsed > plan.max_gap {
                next = StepNumber::first_from(pair[1].elapsed, plan);
            }
        }
        next
    }

    #[inline]
    pub(super) fn step(&mut self, plan: &StreamPlan) {
        self.next = self.next_number(plan);
        self.elapsed = self.next.elapsed(plan);
        while self.segment + 1 < self.window.len() && self.window[self.segment].elapsed < self.elapsed {
            self.segment += 1;
        }
        self.next = self.next.after(plan);
    }

    /// Number of steps, at least, until a pose is passed. In them neither a gap nor the end of the window is
    /// met.
    pub(super) fn steps_to_pose(&self, plan: &StreamPlan) -> f64 {
        let Some(before) = self.segment.checked_sub(1) else { return 0.0 };
        let (Some(a), Some(b)) = (self.window.get(before), self.window.get(self.segment)) else { return 0.0 };
        let (due, span) = (self.next.elapsed(plan), b.elapsed - a.elapsed);
        if due < a.elapsed || span > plan.max_gap {
            return 0.0;
        }
        match &plan.times {
            None => ((b.elapsed - due) * f64::from(plan.frequency) * (1.0 - 1e-9)).floor() - 1.0,
            Some(times) => times.first_from(b.elapsed).saturating_sub(self.next.seconds) as f64 - 1.0,
        }
    }

    /// Number, with times of their own, and time (s after the first pose) of the step that is `ahead` after
    /// the next one, before which there is no gap.
    pub(super) fn step_ahead(&self, plan: &StreamPlan, ahead: u32) -> (u64, f64) {
        let step = self.next_number(plan).ahead(plan, ahead);
        (step.seconds, step.elapsed(plan))
    }

    /// Takes `steps` steps, at most [`steps_to_pose`](Self::steps_to_pose) and at least 1. Returns the time
    /// of the last one, ns of the GPS week.
    pub(super) fn advance(&mut self, plan: &StreamPlan, steps: u32) -> f64 {
        self.next = self.next.ahead(plan, steps - 1);
        let time = self.next_time_ns(plan);
        self.step(plan);
        time
    }

    /// The poses before and after the current step, and the fraction of the time between them that has passed
    /// `seconds` after the step.
    fn bracket(&self, seconds: f64) -> Option<(&Knot, &Knot, f64)> {
        let b = self.window.get(self.segment)?;
        let a = self.segment.checked_sub(1).map_or(b, |i| &self.window[i]);
        let span = b.elapsed - a.elapsed;
        Some((a, b, if span > 0.0 { (self.elapsed - a.elapsed + seconds) / span } else { 0.0 }))
    }

    /// Position and attitude `seconds` after the current step. Beyond the next pose the motion before it goes
    /// on, because the following pose may not have arrived.
    pub(super) fn pose_after(&self, seconds: f64) -> (DVec3, Rotation) {
        let pose = |(a, b, u): (&Knot, &Knot, f64)| {
            (a.position + (b.position - a.position) * u, slerp(a.attitude, b.attitude, b.turn, u))
        };
        self.bracket(seconds).map_or((DVec3::ZERO, Rotation::IDENTITY), pose)
    }

    pub(super) fn position(&self) -> DVec3 {
        self.bracket(0.0).map_or(DVec3::ZERO, |(a, b, u)| a.position + (b.position - a.position) * u)
    }

    /// Velocity between the poses around the current step, m/s; 0 at the first pose, whose next one may not
    /// have arrived.
    pub(super) fn velocity(&self) -> DVec3 {
        let between = |(a, b, _): (&Knot, &Knot, f64)| match b.elapsed - a.elapsed {
            span if span > 0.0 => (b.position - a.position) / span,
            _ => DVec3::ZERO,
        };
        self.bracket(0.0).map_or(DVec3::ZERO, between)
    }

    pub(super) fn attitude(&self) -> Rotation {
        self.bracket(0.0).map_or(Rotation::IDENTITY, |(a, b, u)| slerp(a.attitude, b.attitude, b.turn, u))
    }
}

impl Knot {
    fn after(before: Option<&Knot>, pose: Pose, elapsed: f64, shift: DVec3) -> Knot {
        let mut attitude = pose.attitude;
        let mut turn = 0.0;
        if let Some(before) = before {
            let a = before.attitude;
            if a.w * attitude.w + a.u.dot(attitude.u) < 0.0 {
                attitude = Rotation { w: -attitude.w, u: -attitude.u };
            }
            let (dw, du) = (attitude.w - a.w, attitude.u - a.u);
            turn = 2.0 * libm::asin(((dw * dw + du.dot(du)).sqrt() * 0.5).min(1.0));
        }
        Knot { elapsed, position: pose.position - shift, attitude, turn }
    }
}

/// Spherical linear interpolation from `a` to `b` at `u` (Shoemake 1985); `turn` is the angle between the
/// quaternions.
fn slerp(a: Rotation, b: Rotation, turn: f64, u: f64) -> Rotation {
    let (p, q) = if turn < 1e-6 {
        (1.0 - u, u)
    } else {
        let s = libm::sin(turn);
        (libm::sin((1.0 - u) * turn) / s, libm::sin(u * turn) / s)
    };
    Rotation { w: a.w * p + b.w * q, u: a.u * p + b.u * q }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(time: f64, x: f64, yaw: f64) -> Pose {
        Pose { time, position: DVec3::new(x, 0.0, 0.0), attitude: Rotation::about_z(yaw.to_radians()) }
    }

    fn at(frequency: u32) -> StreamPlan {
        StreamPlan { frequency, times: None, max_gap: f64::INFINITY, keeps_adjusted_times: true }
    }

    fn yaw(s: &StreamState) -> f64 {
        let d = s.attitude().forward();
        libm::atan2(-d.x, d.y).to_degrees()
    }

    #[test]
    fn positions_are_linear_and_attitudes_take_the_shorter_way() {
        let mut s = StreamState::default();
        assert_eq!(s.readiness(&at(4)), Readiness::NeedsPoses);
        s.feed(vec![pose(10.0, 100.0, 350.0), pose(11.0, 108.0, 10.0)], DVec3::new(100.0, 0.0, 0.0));
        let mut seen = Vec::new();
        while s.readiness(&at(4)) == Readiness::Ready {
            seen.push(s.next_time_ns(&at(4)));
            s.step(&at(4));
            seen.extend([s.position().x, yaw(&s).round()]);
        }
        assert_eq!(
            seen,
            [10e9, 0.0, -10.0, 10.25e9, 2.0, -5.0, 10.5e9, 4.0, 0.0, 10.75e9, 6.0, 5.0, 11e9, 8.0, 10.0]
        );
        assert_eq!(s.readiness(&at(4)), Readiness::NeedsPoses);
        s.end();
        assert_eq!(s.readiness(&at(4)), Readiness::Ended);
    }

    /// Times (ns), positions and attitudes of all steps when the poses arrive in blocks of `cut`.
    fn fly(poses: &[Pose], plan: &StreamPlan, cut: usize) -> Vec<(f64, DVec3, Rotation)> {
        let (mut s, mut blocks, mut steps) = (StreamState::default(), poses.chunks(cut), Vec::new());
        loop {
            match s.readiness(plan) {
                Readiness::Ready => {
                    let time = s.next_time_ns(plan);
                    s.step(plan);
                    assert!(s.window.len() <= cut + 2);
                    steps.push((time, s.position(), s.attitude()));
                }
                Readiness::NeedsPoses => match blocks.next() {
                    Some(block) => s.feed(block.to_vec(), DVec3::ZERO),
                    None => s.end(),
                },
                Readiness::Ended => return steps,
            }
        }
    }

    #[test]
    fn steps_do_not_depend_on_the_blocks_in_which_poses_arrive() {
        let poses: Vec<Pose> =
            (0..40).map(|i| pose(f64::from(i) * 0.37, f64::from(i * i) * 0.1, f64::from(i) * 77.7)).collect();
        let all = fly(&poses, &at(7), 40);
        assert_eq!(all.len(), 102);
        for cut in [1, 2, 3, 7, 39] {
            assert_eq!(fly(&poses, &at(7), cut), all, "blocks of {cut}");
        }
    }

    #[test]
    fn no_step_is_taken_in_gaps() {
        let poses = [0.0, 0.3, 5.1, 5.5, 9.0, 9.2].map(|time| pose(10.0 + time, time * 10.0, 0.0));
        let plan = StreamPlan { max_gap: 2.0, ..at(10) };
        for cut in 1..=6 {
            let steps = fly(&poses, &plan, cut).into_iter().map(|(time, position, _)| {
                let tenths = (time / 1e9 - 10.0) * 10.0;
                assert!((position.x - tenths).abs() < 1e-6, "{tenths}");
                tenths.round() as i32
            });
            assert!(steps.eq([0, 1, 2, 3, 51, 52, 53, 54, 55, 90, 91, 92]), "blocks of {cut}");
        }
    }

    #[test]
    fn times_beyond_a_week_are_reduced() {
        let mut s = StreamState::default();
        s.feed(vec![pose(604_800.0 * 3000.0 + 5.0, 0.0, 0.0)], DVec3::ZERO);
        assert_eq!(s.next_time_ns(&at(10)), 5e9);
        let mut s = StreamState::default();
        s.feed(vec![pose(604_799.5, 0.0, 0.0)], DVec3::ZERO);
        (0..10).for_each(|_| s.step(&at(10)));
        assert_eq!(s.next_time_ns(&at(10)), 0.5e9);
    }

    #[test]
    fn adjusted_standard_times_go_on_beyond_their_week() {
        // 2024: 645 weeks and 604799.5 s after the adjusted epoch.
        for weeks in [645.0, -100.0] {
            let (mut s, plan) = (StreamState::default(), at(10));
            s.feed(vec![pose(604_800.0 * weeks + 604_799.5, 0.0, 0.0)], DVec3::ZERO);
            assert_eq!(s.time_origin(&plan), Some(604_800.0 * weeks));
            assert_eq!(s.next_time_ns(&plan), 604_799.5e9);
            (0..10).for_each(|_| s.step(&plan));
            assert_eq!(s.next_time_ns(&plan), 604_800.5e9);
            let reference = StreamPlan { keeps_adjusted_times: false, ..plan };
            assert_eq!(s.time_origin(&reference), None);
        }
        for first in [0.0, 604_800.0, -5.0, 1.4e9, 1.7e9] {
            assert_eq!(adjusted_time_origin(first), None, "{first}");
        }
    }

    #[test]
    fn poses_out_of_order_are_left_out() {
        let mut s = StreamState::default();
        s.feed(
            vec![pose(1.0, 0.0, 0.0), pose(0.5, 9.0, 0.0), pose(1.0, 9.0, 0.0), pose(2.0, 1.0, 0.0)],
            DVec3::ZERO,
        );
        assert_eq!(s.window.len(), 2);
    }
}
