//! A multicopter that pitches, yaws and accelerates towards its waypoints (spec kinematics §2.5).
//!
//! It has two attitudes: the reported one tilts, the pointing one only yaws and is the one that carries the scanner.

use super::LegEntry;
use super::course::{Course, LegCourse, heading, horizontal, horizontal_unit};
use super::physics::accelerated;
use crate::geom::{DVec3, Rotation, unit};
use crate::survey::{Kinematics, Multicopter};
use libm::{acos, cos, log, sin};
use std::f64::consts::{PI, TAU};

const GRAVITY: f64 = 9.81;
const CLIMB_FORCE: f64 = 0.1;
const SINK_FORCE_PER_METRE: f64 = 0.005;
/// Engine force of the first push.
const FIRST_PUSH: f64 = 1e-4;
/// Braking is reckoned down to this force.
const STANDSTILL_FORCE: f64 = 1e-3;
/// Nearer to the wanted yaw the alignment ends, rad.
const ALIGNED: f64 = 1e-3;
/// Most terms of the sums that predict braking and turning; the later ones are far below a nanometre.
const MOST_TERMS: f64 = 1e7;

/// What never changes: the parameters and their values per step of the first leg.
#[derive(Clone, Debug)]
pub(super) struct MulticopterPlan {
    parameters: Multicopter,
    pitch_step: f64,
    roll_step: f64,
    yaw_step: f64,
    slow_factor: f64,
    speed_factor: f64,
}

/// A flying multicopter.
#[derive(Clone, Debug)]
pub(super) struct MulticopterState {
    pub course: Course,
    /// The pointing attitude when the mount was last refreshed: one step late.
    pub mount_pointing: Rotation,
    pointing: Rotation,
    pointing_yaw: f64,
    /// Horizontal part of the pointing attitude's forward axis.
    nose: DVec3,
    roll: f64,
    pitch: f64,
    yaw: f64,
    /// Horizontal engine force.
    drive: DVec3,
    last_turn: f64,
    turning: bool,
    aligning: bool,
    at_full_force: bool,
    turn_steps: i64,
    turn_distance: f64,
    slow_distance: f64,
}

impl Default for MulticopterState {
    fn default() -> MulticopterState {
        MulticopterState {
            course: Course::default(),
            mount_pointing: Rotation::IDENTITY,
            pointing: Rotation::IDENTITY,
            pointing_yaw: 0.0,
            nose: DVec3::Y,
            roll: 0.0,
            pitch: 0.0,
            yaw: 0.0,
            drive: DVec3::ZERO,
            last_turn: 1.0,
            turning: false,
            aligning: false,
            at_full_force: false,
            turn_steps: 0,
            turn_distance: 0.0,
            slow_distance: 0.0,
        }
    }
}

impl MulticopterPlan {
    pub fn new(parameters: Multicopter, frequency: f64) -> MulticopterPlan {
        MulticopterPlan {
            pitch_step: parameters.pitch_speed / frequency,
            roll_step: parameters.roll_speed / frequency,
            yaw_step: parameters.yaw_speed / frequency,
            slow_factor: 1.0 - parameters.slowdown / frequency,
            speed_factor: 1.0 + parameters.speedup / frequency,
            parameters,
        }
    }

    pub fn terminal_speed(&self) -> f64 {
        self.parameters.engine_max_force / self.parameters.drag
    }

    /// Metres travelled per step at engine force `force`.
    fn travel(&self, force: f64, cap: f64) -> f64 {
        (force * self.parameters.engine_max_force * self.parameters.drag).min(cap)
    }
}

impl MulticopterState {
    pub fn start_leg(
        &mut self,
        plan: &MulticopterPlan,
        legs: &[LegCourse],
        leg: usize,
        entry: LegEntry,
        kinematics: &Kinematics,
    ) {
        let here = &legs[leg];
        let assigned = self.course.start_leg(legs, leg, entry);
        // The cap of the leg before is still in force; a run's first leg is reckoned when the platform is prepared.
        if assigned && entry == LegEntry::Continuing {
            self.predict(plan, here, legs[leg.saturating_sub(1)].step_length);
        }
        if here.stop_and_turn {
            if assigned {
                self.stop_and_turn(here);
            }
        } else if entry == LegEntry::Initial {
            self.face_target(plan);
        } else {
            self.aligning = true;
        }
        if entry == LegEntry::Initial {
            self.predict(plan, here, here.step_length);
            if kinematics.multicopter_tilt {
                // The reference begins with the nose as far up as it goes, where nobody sees it.
                self.pitch = 0.0;
            }
        }
    }

    /// The level attitude of the present yaw.
    pub fn level(&self) -> Rotation {
        Rotation::about_z(self.yaw)
    }

    /// The attitude with the tilt about the craft's own axes: pitch with the nose up, and roll, whose angle grows with turns
    /// to the left here, so that the craft leans into them.
    pub fn tilted(&self) -> Rotation {
        self.level().after(Rotation::about_x(self.pitch)).after(Rotation::about_y(-self.roll))
    }

    pub fn restore(&mut self, start: &MulticopterState) {
        self.course = self.course.restored(&start.course);
        self.mount_pointing = start.mount_pointing;
    }

    /// The reported attitude.
    pub fn attitude(&self) -> Rotation {
        Rotation::about_x(self.roll).after(Rotation::about_y(self.pitch)).after(Rotation::about_z(self.yaw))
    }

    pub fn reached(&mut self, leg: &LegCourse) -> bool {
        let mut there = false;
        if leg.smooth_turn && self.turning {
            self.turn_steps -= 1;
            there = self.turn_steps <= 0;
        }
        there = there || self.course.reached();
        if there {
            self.turning = false;
            self.at_full_force = false;
        }
        there
    }

    pub fn step(&mut self, plan: &MulticopterPlan, leg: &LegCourse) {
        self.course.position += self.course.velocity;
        let q = self.course.to_target();
        let lift = if q.z < 0.0 { SINK_FORCE_PER_METRE * q.z } else { CLIMB_FORCE };
        self.push(plan, leg, q);
        let base = plan.parameters.base_pitch;
        let swing = plan.parameters.pitch_offset;
        self.pitch = self.pitch.clamp(base - swing.abs(), base + swing.abs());
        if self.turning {
            self.bank(plan, leg);
        } else {
            self.roll = towards(self.roll, 0.0, plan.roll_step);
            if self.aligning {
                self.align_yaw(plan, q);
            }
        }
        self.mount_pointing = self.pointing;
        self.point(self.yaw);
        if !self.turning && horizontal(q).length() <= self.turn_distance {
            self.turning = true;
        }
        let force = DVec3::new(self.drive.x, self.drive.y, GRAVITY + lift) + DVec3::new(0.0, 0.0, -GRAVITY);
        self.course.velocity = accelerated(self.course.velocity, force, plan.parameters.drag, leg);
    }

    /// Slows down, speeds up or cruises, pitching accordingly.
    fn push(&mut self, plan: &MulticopterPlan, leg: &LegCourse, q: DVec3) {
        let along = if leg.smooth_turn { self.direction(q) } else { q };
        let along = horizontal_unit(along).unwrap_or(DVec3::ZERO);
        let last = self.drive.length();
        let near = !leg.smooth_turn && horizontal(q).length() < self.slow_distance;
        let mut force;
        if leg.slowdown && (self.turning || near) {
            force = plan.slow_factor * last;
            self.pitch += plan.pitch_step;
        } else if !self.at_full_force {
            force = plan.speed_factor * if last > 0.0 { last } else { FIRST_PUSH };
            self.pitch -= plan.pitch_step;
        } else {
            force = 1.0;
            self.pitch = towards(self.pitch, plan.parameters.base_pitch, plan.pitch_step);
        }
        if force > plan.parameters.engine_max_force {
            force = plan.parameters.engine_max_force;
            self.at_full_force = true;
        }
        self.drive = along * force;
    }

    /// Rolls and yaws towards the next waypoint.
    fn bank(&mut self, plan: &MulticopterPlan, leg: &LegCourse) {
        let after = horizontal_unit(self.course.next - self.course.target);
        let wanted = heading(after.unwrap_or_else(|| horizontal(self.course.target - self.course.origin)));
        let turn = turn_sign(heading(self.level_direction()), wanted);
        if !leg.stop_and_turn {
            if turn != self.last_turn {
                self.roll += if self.roll < 0.0 { plan.roll_step } else { -plan.roll_step };
            } else {
                self.roll += turn * plan.roll_step;
            }
            let most = plan.parameters.roll_offset.abs();
            self.roll = self.roll.clamp(-most, most);
            self.yaw += turn * plan.yaw_step;
        }
        self.last_turn = turn;
    }

    /// Yaws towards the target and stays once there, even if the bearing goes on changing.
    fn align_yaw(&mut self, plan: &MulticopterPlan, q: DVec3) {
        let wanted = -heading(horizontal(q));
        if self.yaw < 0.0 {
            self.yaw += TAU;
        } else if self.yaw >= TAU {
            self.yaw -= TAU;
        }
        let turn = -turn_sign(self.yaw, wanted);
        let turned = self.yaw + turn * plan.yaw_step;
        self.yaw = if -turn_sign(turned, wanted) != turn { wanted } else { turned };
        if (wanted - self.yaw).abs() < ALIGNED {
            self.aligning = false;
        }
    }

    fn stop_and_turn(&mut self, leg: &LegCourse) {
        self.yaw = leg.yaw_at_departure.unwrap_or_else(|| {
            match horizontal_unit(self.course.target - self.course.origin) {
                Some(h) => acos((-h.y).clamp(-1.0, 1.0)) * if h.x >= 0.0 { 1.0 } else { -1.0 } - PI,
                None => self.yaw,
            }
        });
        self.pitch = 0.0;
    }

    fn face_target(&mut self, plan: &MulticopterPlan) {
        if let Some(ahead) = horizontal_unit(self.course.to_target()) {
            self.pointing = Rotation::between(self.level_direction(), ahead).after(Rotation::IDENTITY);
            self.pointing_yaw = f64::NAN;
            self.nose = horizontal(self.pointing.forward());
        }
        self.mount_pointing = self.pointing;
        self.roll = 0.0;
        self.pitch = plan.parameters.base_pitch + plan.parameters.pitch_offset;
        let yaw = -heading(self.level_direction());
        self.yaw = if yaw < 0.0 { yaw + TAU } else { yaw };
    }

    fn point(&mut self, yaw: f64) {
        // Bit for bit the same yaw points the same way; cruising costs no trigonometry.
        if yaw.to_bits() != self.pointing_yaw.to_bits() {
            self.pointing = Rotation::about_z(yaw);
            self.pointing_yaw = yaw;
            self.nose = horizontal(self.pointing.forward());
        }
    }

    /// The current direction: the nose in plan view, the slope of the way to the target.
    fn direction(&self, q: DVec3) -> DVec3 {
        let ahead = unit(q);
        let level = horizontal(ahead).length();
        if level > 0.0 { DVec3::new(level * self.nose.x, level * self.nose.y, ahead.z) } else { self.nose }
    }

    fn level_direction(&self) -> DVec3 {
        horizontal_unit(self.direction(self.course.to_target())).unwrap_or(self.nose)
    }

    /// Reckons how long a smooth turn lasts and how far turning or braking reaches (spec kinematics §2.5.3).
    fn predict(&mut self, plan: &MulticopterPlan, leg: &LegCourse, cap: f64) {
        let full = plan.parameters.engine_max_force;
        let ahead = self.level_direction();
        let after = horizontal_unit(self.course.next - self.course.target);
        let angle = after.map_or(0.0, |w| acos(ahead.dot(w).clamp(-1.0, 1.0)));
        self.turn_steps = (angle / plan.yaw_step).floor() as i64;
        if leg.smooth_turn {
            let wanted =
                heading(after.unwrap_or_else(|| horizontal(self.course.target - self.course.origin)));
            let start = heading(ahead);
            let turn = turn_sign(start, wanted);
            let (mut x, mut y, mut force) = (0.0, 0.0, full);
            for j in 0..self.turn_steps.clamp(0, MOST_TERMS as i64) {
                let a = start - turn * j as f64 * plan.yaw_step;
                let travel = plan.travel(force, cap);
                x += travel * sin(a);
                y += travel * cos(a);
                if leg.slowdown {
                    force *= plan.slow_factor;
                }
            }
            self.turn_distance = DVec3::new(x * ahead.x, y * ahead.y, 0.0).length();
        } else if leg.slowdown {
            let steps = (log(STANDSTILL_FORCE / full).abs() / log(plan.slow_factor).abs()).floor();
            let (mut distance, mut force) = (0.0, full);
            for _ in 0..steps.clamp(0.0, MOST_TERMS) as u64 {
                distance += plan.travel(force, cap);
                force *= plan.slow_factor;
            }
            self.slow_distance = distance;
        }
    }
}

/// The sign of the yaw change that takes heading `from` to heading `to` the shorter way.
fn turn_sign(from: f64, to: f64) -> f64 {
    let positive = |a: f64| if a < 0.0 { a + TAU } else { a };
    let x = positive(to) - positive(from);
    if x > PI || (x > -PI && x < 0.0) { 1.0 } else { -1.0 }
}

/// `value` moved by `step` towards `goal`; it may overshoot.
fn towards(value: f64, goal: f64, step: f64) -> f64 {
    if value < goal {
        value + step
    } else if value > goal {
        value - step
    } else {
        value
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geom::radians;
    use crate::platform::course::reported_angles;

    /// A waypoint at 100 steps per second.
    pub fn course(position: [f64; 3], speed: f64) -> LegCourse {
        LegCourse {
            position: DVec3::from(position),
            frequency: 100.0,
            speed,
            step_length: speed / 100.0,
            stop_and_turn: true,
            smooth_turn: false,
            slowdown: true,
            yaw_at_departure: None,
            span: None,
        }
    }

    fn parameters() -> Multicopter {
        Multicopter {
            drag: 0.01,
            engine_max_force: 0.1,
            speedup: 2.0,
            slowdown: 2.0,
            base_pitch: radians(-5.0),
            pitch_speed: radians(85.94),
            roll_speed: radians(28.65),
            yaw_speed: radians(85.94),
            pitch_offset: radians(35.0),
            roll_offset: radians(25.0),
        }
    }

    fn golden_legs(change: impl Fn(&mut LegCourse)) -> [LegCourse; 4] {
        let legs = [
            ([0.0, 0.0, 50.0], 8.0),
            ([40.0, 10.0, 52.0], 8.0),
            ([20.0, 50.0, 48.0], 5.0),
            ([20.0, 90.0, 48.0], 8.0),
        ];
        legs.map(|(p, speed)| {
            let mut leg = course(p, speed);
            change(&mut leg);
            leg
        })
    }

    /// Flies the legs until they end or `limit` steps have passed: per leg and step position, pitch and yaw in degrees.
    fn fly(legs: &[LegCourse], limit: usize) -> Vec<Vec<(DVec3, f64, f64)>> {
        let plan = MulticopterPlan::new(parameters(), legs[0].frequency);
        let mut copter = MulticopterState::default();
        let mut flown = Vec::new();
        for leg in 0..legs.len() {
            let entry = if leg == 0 { LegEntry::Initial } else { LegEntry::Continuing };
            copter.start_leg(&plan, legs, leg, entry, &Kinematics::HELIOS);
            let mut rows = Vec::new();
            while rows.len() < limit && !copter.reached(&legs[leg]) {
                copter.step(&plan, &legs[leg]);
                let [_, pitch, yaw] = reported_angles(copter.attitude(), None);
                rows.push((copter.course.position, pitch.to_degrees(), yaw.to_degrees()));
            }
            flown.push(rows);
        }
        flown
    }

    #[test]
    fn golden_run() {
        // spec kinematics §11.3: leg, step, position, pitch and yaw of stop-and-turn, of the variant without
        type Row = (usize, usize, [f64; 3], [f64; 2], [f64; 2]);
        let golden: [Row; 10] = [
            (0, 0, [0.0, 0.0, 50.0], [-0.8594, 284.0362], [29.1406, 284.0362]),
            (0, 1, [0.0, 0.0, 50.0010], [-1.7188, 284.0362], [28.2812, 284.0362]),
            (0, 100, [0.0084, 0.0021, 53.3168], [-40.0, 284.0362], [-40.0, 284.0362]),
            (0, 348, [1.6499, 0.4125, 54.4945], [-40.0, 284.0362], [-40.0, 284.0362]),
            (0, 500, [11.2820, 2.8205, 53.0010], [-5.6240, 284.0362], [-5.6240, 284.0362]),
            (0, 870, [39.9721, 9.9930, 52.0043], [-5.6240, 284.0362], [-5.6240, 284.0362]),
            (1, 0, [40.0497, 10.0124, 52.0048], [-0.8594, 26.5651], [-6.4834, 284.8956]),
            (1, 99, [43.0971, 14.4112, 51.3331], [-5.1564, 26.5651], [-5.6240, 9.9762]),
            (1, 299, [36.7156, 28.0841, 49.1173], [-5.1564, 26.5651], [-5.6240, 34.0191]),
            (1, 644, [20.0165, 50.0131, 48.0359], [-4.2970, 26.5651], [-4.7646, 34.0191]),
        ];
        let stopping = fly(&golden_legs(|_| {}), 5000);
        let going = fly(&golden_legs(|l| l.stop_and_turn = false), 5000);
        for (variant, flown) in [&stopping, &going].into_iter().enumerate() {
            let steps: Vec<usize> = flown.iter().map(Vec::len).collect();
            assert_eq!(steps, [871, 645, 806, 0], "variant {variant}");
            for (leg, step, position, stop, go) in golden {
                let (p, pitch, yaw) = flown[leg][step];
                let wanted = if variant == 0 { stop } else { go };
                let off = (p - DVec3::from(position)).abs().max_element();
                assert!(off < 1e-4, "variant {variant} leg {leg} step {step}: {p}");
                assert!((pitch - wanted[0]).abs() < 1e-4, "variant {variant} leg {leg} step {step}: {pitch}");
                assert!((yaw - wanted[1]).abs() < 1e-4, "variant {variant} leg {leg} step {step}: {yaw}");
            }
        }
        let smooth = fly(&golden_legs(|l| (l.stop_and_turn, l.smooth_turn) = (false, true)), 20_000);
        assert_eq!(smooth[0].len(), 871);
        assert!((smooth[0][500].0 - going[0][500].0).length() < 1e-9 && smooth[0][500].1 == going[0][500].1);
        assert_eq!(smooth[1].len(), 20_000, "a smooth turn that misses the waypoint does not end");
    }

    #[test]
    fn braking_distance_depends_on_the_pulse_frequency() {
        // spec kinematics §2.5.5
        for (frequency, wanted) in [(100.0, 0.004949), (1000.0, 0.0495), (100_000.0, 4.8426)] {
            let legs = golden_legs(|l| (l.frequency, l.step_length) = (frequency, 8.0 / frequency));
            let plan = MulticopterPlan::new(parameters(), frequency);
            let mut copter = MulticopterState::default();
            copter.start_leg(&plan, &legs, 0, LegEntry::Initial, &Kinematics::HELIOS);
            let found = copter.slow_distance;
            assert!((found / wanted - 1.0).abs() < 1e-3, "{frequency} Hz: {found}");
        }
    }

    #[test]
    fn the_beam_lags_one_step_behind_the_yaw() {
        // spec kinematics §2.8 example 4
        let legs = golden_legs(|_| {});
        let plan = MulticopterPlan::new(parameters(), 100.0);
        let mut copter = MulticopterState::default();
        copter.start_leg(&plan, &legs, 0, LegEntry::Initial, &Kinematics::HELIOS);
        assert!((copter.yaw.to_degrees() + 75.963757).abs() < 1e-6);
        copter.step(&plan, &legs[0]);
        assert_eq!(copter.mount_pointing.forward(), DVec3::Y);
        let wanted = DVec3::new(9.89545e-7, 2.47386e-7, 0.001);
        assert!((copter.course.velocity - wanted).abs().max_element() < 1e-12);
        assert!((copter.drive.length() - 0.000102).abs() < 1e-15);
        copter.step(&plan, &legs[0]);
        assert!((copter.mount_pointing.forward() - DVec3::new(0.970143, 0.242536, 0.0)).length() < 1e-6);
        assert!((copter.drive.length() - 0.00010404).abs() < 1e-15);
    }

    #[test]
    fn smooth_turns() {
        // A survey of three legs at 2 kHz, flown by the reference: leg, step, position, roll, pitch, yaw.
        let mut legs = [[-22.0, -11.0], [18.0, -13.0], [21.0, 16.0], [3.0, 21.0]].map(|[x, y]| LegCourse {
            frequency: 2000.0,
            step_length: 6.0 / 2000.0,
            stop_and_turn: false,
            smooth_turn: true,
            ..course([x, y, 45.0], 6.0)
        });
        for leg in &mut legs[2..] {
            (leg.smooth_turn, leg.slowdown) = (false, false);
        }
        let golden = [
            (0, 0, [-22.0, -11.0, 45.0], [0.0, 29.9570, 267.1376]),
            (0, 4000, [-21.7571, -11.0121, 45.0019], [0.0, -40.0, 267.1376]),
            (0, 8000, [-14.4948, -11.3753, 45.0008], [0.0, -4.9794, 267.1376]),
            (0, 18500, [16.9659, -12.9483, 45.0002], [0.0, -4.9794, 267.1376]),
            (1, 0, [18.0026, -13.0001, 45.0001], [0.3152, -4.0341, 268.1689]),
            (1, 4000, [22.0389, -3.6076, 45.0001], [0.0, -4.9794, 3.0094]),
            (1, 12000, [19.4953, 18.9944, 45.0], [21.1437, 30.0, 66.4760]),
            (1, 14000, [18.4555, 19.3265, 45.0], [0.0, 30.0, 74.4685]),
            (2, 0, [18.4017, 19.3415, 45.0], [0.0, 29.9570, 74.5544]),
            (2, 4000, [13.8893, 19.8287, 45.0], [0.0, -34.5428, 83.8599]),
            (2, 7500, [3.4495, 20.9516, 45.0], [0.0, -4.9794, 83.8599]),
        ];
        let plan = MulticopterPlan::new(parameters(), 2000.0);
        let mut copter = MulticopterState::default();
        let mut steps = [0; 3];
        for leg in 0..3 {
            let entry = if leg == 0 { LegEntry::Initial } else { LegEntry::Continuing };
            copter.start_leg(&plan, &legs, leg, entry, &Kinematics::HELIOS);
            while !copter.reached(&legs[leg]) && steps[leg] < 100_000 {
                copter.step(&plan, &legs[leg]);
                for (_, step, position, angles) in golden.iter().filter(|g| (g.0, g.1) == (leg, steps[leg])) {
                    let off = (copter.course.position - DVec3::from(*position)).abs().max_element();
                    assert!(off < 2e-4, "leg {leg} step {step}: {}", copter.course.position);
                    let found = reported_angles(copter.attitude(), None).map(f64::to_degrees);
                    for (f, w) in found.iter().zip(angles) {
                        assert!((f - w).abs() < 2e-4, "leg {leg} step {step}: {found:?}");
                    }
                }
                steps[leg] += 1;
            }
        }
        assert_eq!(steps[..2], [18_846, 14_394]);
    }
}
