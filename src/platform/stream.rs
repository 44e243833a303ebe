//! A platform that follows poses as they arrive. Only a window of them is kept.

use super::pose_reader::Pose;
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
    /// Whole seconds and steps beyond them, of the next step.
    seconds: u64,
    steps: u32,
    /// The current step's time, s after the first pose.
    elapsed: f64,
    complete: bool,
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
            seconds: 0,
            steps: 0,
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

    /// Whether the next step can be taken at `frequency` steps per second.
    #[inline]
    pub(super) fn readiness(&self, frequency: u32) -> Readiness {
        match self.window.last() {
            Some(last) if self.next_elapsed(frequency) <= last.elapsed => Readiness::Ready,
            _ if self.complete => Readiness::Ended,
            _ => Readiness::NeedsPoses,
        }
    }

    /// Time of the next step, ns of the GPS week.
    #[inline]
    pub(super) fn next_time_ns(&self, frequency: u32) -> f64 {
        let first =
            if self.first_time < WEEK * 1e-9 { self.first_time } else { self.first_time % (WEEK * 1e-9) };
        let since = self.seconds as f64 * 1e9 + f64::from(self.steps) * 1e9 / f64::from(frequency);
        let time = first * 1e9 + since;
        if time > WEEK { time % WEEK } else { time }
    }

    #[inline]
    fn next_elapsed(&self, frequency: u32) -> f64 {
        self.seconds as f64 + f64::from(self.steps) / f64::from(frequency)
    }

    #[inline]
    pub(super) fn step(&mut self, frequency: u32) {
        self.elapsed = self.next_elapsed(frequency);
        while self.segment + 1 < self.window.len() && self.window[self.segment].elapsed < self.elapsed {
            self.segment += 1;
        }
        self.steps += 1;
        if self.steps >= frequency {
            self.steps = 0;
            self.seconds += 1;
        }
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

    fn yaw(s: &StreamState) -> f64 {
        let d = s.attitude().forward();
        libm::atan2(-d.x, d.y).to_degrees()
    }

    #[test]
    fn positions_are_linear_and_attitudes_take_the_shorter_way() {
        let mut s = StreamState::default();
        assert_eq!(s.readiness(4), Readiness::NeedsPoses);
        s.feed(vec![pose(10.0, 100.0, 350.0), pose(11.0, 108.0, 10.0)], DVec3::new(100.0, 0.0, 0.0));
        let mut seen = Vec::new();
        while s.readiness(4) == Readiness::Ready {
            seen.push(s.next_time_ns(4));
            s.step(4);
            seen.extend([s.position().x, yaw(&s).round()]);
        }
        assert_eq!(
            seen,
            [10e9, 0.0, -10.0, 10.25e9, 2.0, -5.0, 10.5e9, 4.0, 0.0, 10.75e9, 6.0, 5.0, 11e9, 8.0, 10.0]
        );
        assert_eq!(s.readiness(4), Readiness::NeedsPoses);
        s.end();
        assert_eq!(s.readiness(4), Readiness::Ended);
    }

    #[test]
    fn the_cut_into_blocks_changes_no_bit() {
        let poses: Vec<Pose> =
            (0..40).map(|i| pose(f64::from(i) * 0.37, f64::from(i * i) * 0.1, f64::from(i) * 77.7)).collect();
        let fly = |cut: usize| {
            let (mut s, mut blocks, mut seen) = (StreamState::default(), poses.chunks(cut), Vec::new());
            loop {
                match s.readiness(7) {
                    Readiness::Ready => {
                        let time = s.next_time_ns(7);
                        s.step(7);
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
    fn times_beyond_a_week_are_reduced() {
        let mut s = StreamState::default();
        s.feed(vec![pose(604_800.0 * 3.0 + 5.0, 0.0, 0.0)], DVec3::ZERO);
        assert_eq!(s.next_time_ns(10), 5e9);
        let mut s = StreamState::default();
        s.feed(vec![pose(604_799.5, 0.0, 0.0)], DVec3::ZERO);
        (0..10).for_each(|_| s.step(10));
        assert_eq!(s.next_time_ns(10), 0.5e9);
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
