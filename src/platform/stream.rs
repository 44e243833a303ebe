//! A platform that follows poses as they arrive. Only a window of them is kept.

use super::poses::Pose;
use crate::geom::{DVec3, Rotation};
use std::sync::Arc;

/// Whether the next step's pose is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Readiness {
    /// It is.
    Ready,
    /// Poses must arrive first.
    NeedsPoses,
    /// The next step lies after the last pose.
    Ended,
}

/// How a stream is flown along.
#[derive(Clone, Copy, Debug)]
pub(super) struct StreamPlan {
    /// Steps per second.
    pub frequency: u32,
    /// No step is taken between poses that are more seconds apart.
    pub max_gap: f64,
}

/// Nanoseconds of a GPS week.
const WEEK: f64 = 604_800e9;

/// Where in its stream a platform is. Steps are numbered from the first pose; their times come from the number alone.
#[derive(Clone, Debug)]
pub struct StreamState {
    /// The poses about the current step, and those that have arrived after them.
    window: Arc<[Knot]>,
    /// The pose that ends the current stretch, in `window`.
    segment: usize,
    /// Time of the first pose in the stream's own scale, s.
    first_time: f64,
    /// The next step, unless it lies in a gap.
    next: StepNumber,
    /// The current step's time, s after the first pose.
    elapsed: f64,
    complete: bool,
}

/// Number of a step: whole seconds after the first pose and steps beyond them.
#[derive(Clone, Copy, Debug, Default)]
struct StepNumber {
    seconds: u64,
    steps: u32,
}

impl StepNumber {
    /// The first step at or after a time.
    fn first_from(elapsed: f64, plan: &StreamPlan) -> StepNumber {
        let seconds = elapsed.floor();
        let steps = ((elapsed - seconds) * f64::from(plan.frequency)).floor() as u32;
        let mut number = StepNumber { seconds: seconds as u64, steps: steps.min(plan.frequency - 1) };
        while number.elapsed(plan) < elapsed {
            number = number.after(plan);
        }
        number
    }

    /// Seconds after the first pose.
    #[inline]
    fn elapsed(self, plan: &StreamPlan) -> f64 {
        self.seconds as f64 + f64::from(self.steps) / f64::from(plan.frequency)
    }

    #[inline]
    fn after(self, plan: &StreamPlan) -> StepNumber {
        match self.steps + 1 {
            steps if steps >= plan.frequency => StepNumber { seconds: self.seconds + 1, steps: 0 },
            steps => StepNumber { steps, ..self },
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Knot {
    /// Seconds after the first pose.
    elapsed: f64,
    position: DVec3,
    /// On the same side of the quaternions' sphere as the pose before.
    attitude: Rotation,
    /// Angle from the quaternion before, rad.
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
    /// Takes in poses (world coordinates minus `shift`). Poses that do not ascend in time are left out.
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

    /// No pose will follow.
    pub fn end(&mut self) {
        self.complete = true;
    }

    /// Whether any pose has arrived.
    pub fn has_begun(&self) -> bool {
        !self.window.is_empty()
    }

    /// Whether the next step can be taken.
    #[inline]
    pub(super) fn readiness(&self, plan: &StreamPlan) -> Readiness {
        match self.window.last() {
            Some(last) if self.next_number(plan).elapsed(plan) <= last.elapsed => Readiness::Ready,
            _ if self.complete => Readiness::Ended,
            _ => Readiness::NeedsPoses,
        }
    }

    /// Time of the next step, ns of the GPS week.
    #[inline]
    pub(super) fn next_time_ns(&self, plan: &StreamPlan) -> f64 {
        let first =
            if self.first_time < WEEK * 1e-9 { self.first_time } else { self.first_time % (WEEK * 1e-9) };
        let next = self.next_number(plan);
        let since = next.seconds as f64 * 1e9 + f64::from(next.steps) * 1e9 / f64::from(plan.frequency);
        let time = first * 1e9 + since;
        if time > WEEK { time % WEEK } else { time }
    }

    /// The number of the next step: the one that is due, or the first one after the gap in which it would lie. A pure
    /// function of the poses about it, so that it does not matter when they arrive.
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

    /// The poses before and after the current step and the share of the way between them.
    fn stretch(&self) -> Option<(&Knot, &Knot, f64)> {
        let b = self.window.get(self.segment)?;
        let a = self.segment.checked_sub(1).map_or(b, |i| &self.window[i]);
        let span = b.elapsed - a.elapsed;
        Some((a, b, if span > 0.0 { (self.elapsed - a.elapsed) / span } else { 0.0 }))
    }

    pub(super) fn position(&self) -> DVec3 {
        self.stretch().map_or(DVec3::ZERO, |(a, b, u)| a.position + (b.position - a.position) * u)
    }

    pub(super) fn attitude(&self) -> Rotation {
        self.stretch().map_or(Rotation::IDENTITY, |(a, b, u)| between(a.attitude, b.attitude, b.turn, u))
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

/// The attitude a share `u` of the shortest way from `a` to `b`, `turn` being the angle between the quaternions (Shoemake
/// 1985, spherical linear interpolation).
fn between(a: Rotation, b: Rotation, turn: f64, u: f64) -> Rotation {
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
        StreamPlan { frequency, max_gap: f64::INFINITY }
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

    #[test]
    fn the_cut_into_blocks_changes_no_bit() {
        let poses: Vec<Pose> =
            (0..40).map(|i| pose(f64::from(i) * 0.37, f64::from(i * i) * 0.1, f64::from(i) * 77.7)).collect();
        let fly = |cut: usize| {
            let (mut s, mut blocks, mut seen) = (StreamState::default(), poses.chunks(cut), Vec::new());
            loop {
                match s.readiness(&at(7)) {
                    Readiness::Ready => {
                        let time = s.next_time_ns(&at(7));
                        s.step(&at(7));
                        assert!(s.window.len() <= cut + 2);
                        seen.push((time, s.position(), s.attitude()));
                    }
                    Readiness::NeedsPoses => match blocks.next() {
                        Some(block) => s.feed(block.to_vec(), DVec3::ONE),
                        None => s.end(),
                    },
                    Readiness::Ended => return seen,
                }
            }
        };
        let whole = fly(40);
        assert_eq!(whole.len(), 102);
        for cut in [1, 2, 3, 7, 39] {
            assert_eq!(fly(cut), whole, "blocks of {cut}");
        }
    }

    #[test]
    fn no_step_is_taken_in_gaps() {
        let poses: Vec<Pose> =
            [0.0, 0.3, 5.1, 5.5, 9.0, 9.2].map(|time| pose(10.0 + time, time * 10.0, 0.0)).to_vec();
        let plan = StreamPlan { frequency: 10, max_gap: 2.0 };
        let fly = |cut: usize| {
            let (mut s, mut blocks, mut seen) = (StreamState::default(), poses.chunks(cut), Vec::new());
            loop {
                match s.readiness(&plan) {
                    Readiness::Ready => {
                        let time = s.next_time_ns(&plan) / 1e9 - 10.0;
                        s.step(&plan);
                        assert!((s.position().x - time * 10.0).abs() < 1e-6, "{time}");
                        seen.push((time * 10.0).round() as i32);
                    }
                    Readiness::NeedsPoses => match blocks.next() {
                        Some(block) => s.feed(block.to_vec(), DVec3::ZERO),
                        None => s.end(),
                    },
                    Readiness::Ended => return seen,
                }
            }
        };
        for cut in 1..=6 {
            assert_eq!(fly(cut), [0, 1, 2, 3, 51, 52, 53, 54, 55, 90, 91, 92], "blocks of {cut}");
        }
    }

    #[test]
    fn times_beyond_a_week_are_reduced() {
        let mut s = StreamState::default();
        s.feed(vec![pose(604_800.0 * 3.0 + 5.0, 0.0, 0.0)], DVec3::ZERO);
        assert_eq!(s.next_time_ns(&at(10)), 5e9);
        let mut s = StreamState::default();
        s.feed(vec![pose(604_799.5, 0.0, 0.0)], DVec3::ZERO);
        (0..10).for_each(|_| s.step(&at(10)));
        assert_eq!(s.next_time_ns(&at(10)), 0.5e9);
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
