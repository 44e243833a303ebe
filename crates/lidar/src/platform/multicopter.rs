//! A multicopter that pitches, yaws and accelerates towards its waypoints (spec kinematics §2.5).
//!
//! It has two attitudes: the reported one tilts; the pointing one only yaws and carries the scanner.

use super::course::{Course, LegCourse, LegEntry, heading, horizontal, horizontal_unit};
use super::physics::accelerated;
use libm::{acos, cos, log, sin};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, Rotation, unit};
use vlscan_survey::Multicopter;

const GRAVITY: f64 = 9.81;
const CLIMB_FORCE: f64 = 0.1;
const SINK_FORCE_PER_METRE: f64 = 0.005;
const INITIAL_FORCE: f64 = 1e-4;
/// The braking distance is summed down to this force.
const STANDSTILL_FORCE: f64 = 1e-3;
/// The alignment ends closer to the target yaw than this, rad.
const YAW_TOLERANCE: f64 = 1e-3;
/// Limit of terms in the sums that predict braking and turning; later ones are far below a nanometre.
const MAX_TERMS: f64 = 1e7;

/// The parameters of a multicopter and their values per step.
#[derive(Clone, Debug)]
pub struct MulticopterPlan {
    parameters: Multicopter,
    pitch_step: f64,
    roll_step: f64,
    yaw_step: f64,
    slow_factor: f64,
    speed_factor: f64,
}

/// A flying multicopter. Angles are rad, distances m.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MulticopterState {
    pub(super) course: Course,
    /// The pointing attitude when the mount was last refreshed: one step late.
    pub(super) mount_pointing: Rotation,
    pointing: Rotation,
    pointing_yaw: f64,
    /// Horizontal part of the pointing attitude's forward axis.
    nose: DVec3,
    roll: f64,
    pitch: f64,
    yaw: f64,
    force: DVec3,
    /// Sign of the last turn.
    last_turn: f64,
    turning: bool,
    aligning: bool,
    at_full_force: bool,
    turn_steps: i64,
    /// Distances from the target at which turning and braking begin.
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
            force: DVec3::ZERO,
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
    pub(super) fn new(parameters: Multicopter, frequency: f64) -> MulticopterPlan {
        MulticopterPlan {
            pitch_step: parameters.pitch_speed / frequency,
            roll_step: parameters.roll_speed / frequency,
            yaw_step: parameters.yaw_speed / frequency,
            slow_factor: 1.0 - parameters.slowdown / frequency,
            speed_factor: 1.0 + parameters.speedup / frequency,
            parameters,
        }
    }

    pub(super) fn terminal_speed(&self) -> f64 {
        self.parameters.engine_max_force / self.parameters.drag
    }

    /// Metres travelled per step at engine force `force`.
    fn travel(&self, force: f64, cap: f64) -> f64 {
        (force * self.parameters.engine_max_force * self.parameters.drag).min(cap)
    }
}

impl MulticopterState {
    pub(super) fn start_leg(
        &mut self,
        plan: &MulticopterPlan,
        legs: &[LegCourse],
        leg: usize,
        entry: LegEntry,
        kinematics: &Corrections,
    ) {
        let here = &legs[leg];
        let assigned = self.course.start_leg(legs, leg, entry);
        // The speed limit of the leg before still applies. The first leg of a run is predicted below.
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
                // The reference begins with the largest pitch, which has no effect there.
                self.pitch = 0.0;
            }
        }
    }

    /// The level attitude at the current yaw.
    pub(super) fn level(&self) -> Rotation {
        Rotation::about_z(self.yaw)
    }

    /// The attitude with its tilt about the craft's own axes: pitch with the nose up, and roll, which is
    /// positive in turns to the left here, so that the craft banks into them.
    pub(super) fn tilted(&self) -> Rotation {
        self.level().after(Rotation::about_x(self.pitch)).after(Rotation::about_y(-self.roll))
    }

    pub(super) fn restore(&mut self, start: &MulticopterState) {
        self.course = self.course.restored(&start.course);
        self.mount_pointing = start.mount_pointing;
    }

    pub(super) fn attitude(&self) -> Rotation {
        Rotation::about_x(self.roll).after(Rotation::about_y(self.pitch)).after(Rotation::about_z(self.yaw))
    }

    /// Counts down a smooth turn; returns whether the turn or the distance ends the leg.
    pub(super) fn check_arrival(&mut self, leg: &LegCourse) -> bool {
        let mut there = false;
        if leg.smooth_turn && self.turning {
            self.turn_steps -= 1;
            there = self.turn_steps <= 0;
        }
        there = there || self.course.is_reached();
        if there {
            self.turning = false;
            self.at_full_force = false;
        }
        there
    }

    pub(super) fn step(&mut self, plan: &MulticopterPlan, leg: &LegCourse) {
        self.course.position += self.course.velocity;
        let q = self.course.to_target();
        let lift = if q.z < 0.0 { SINK_FORCE_PER_METRE * q.z } else { CLIMB_FORCE };
        self.update_force(plan, leg, q);
        let base = plan.parameters.base_pitch;
        let swing = plan.parameters.pitch_offset;
        self.pitch = self.pitch.clamp(base - swing.abs(), base + swing.abs());
        if self.turning {
            self.roll_and_yaw(plan, leg);
        } else {
            self.roll = step_towards(self.roll, 0.0, plan.roll_step);
            if self.aligning {
                self.align_yaw(plan, q);
            }
        }
        self.mount_pointing = self.pointing;
        self.set_pointing(self.yaw);
        if !self.turning && horizontal(q).length() <= self.turn_distance {
            self.turning = true;
        }
        let force = DVec3::new(self.force.x, self.force.y, GRAVITY + lift) + DVec3::new(0.0, 0.0, -GRAVITY);
        self.course.velocity = accelerated(self.course.velocity, force, plan.parameters.drag, leg);
    }

    /// Slows down, speeds up or cruises, and pitches accordingly.
    fn update_force(&mut self, plan: &MulticopterPlan, leg: &LegCourse, q: DVec3) {
        let along = if leg.smooth_turn { self.direction(q) } else { q };
        let along = horizontal_unit(along).unwrap_or(DVec3::ZERO);
        let last = self.force.length();
        let near = !leg.smooth_turn && horizontal(q).length() < self.slow_distance;
        let mut force;
        if leg.slowdown && (self.turning || near) {
            force = plan.slow_factor * last;
            self.pitch += plan.pitch_step;
        } else if !self.at_full_force {
            force = plan.speed_factor * if last > 0.0 { last } else { INITIAL_FORCE };
            self.pitch -= plan.pitch_step;
        } else {
            force = 1.0;
            self.pitch = step_towards(self.pitch, plan.parameters.base_pitch, plan.pitch_step);
        }
        if force > plan.parameters.engine_max_force {
            force = plan.parameters.engine_max_force;
            self.at_full_force = true;
        }
        self.force = along * force;
    }

    fn roll_and_yaw(&mut self, plan: &MulticopterPlan, leg: &LegCourse) {
        let after = horizontal_unit(self.course.next - self.course.target);
        let desired = heading(after.unwrap_or_else(|| horizontal(self.course.target - self.course.origin)));
        let turn = turn_sign(heading(self.level_direction()), desired);
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

    /// Yaws towards the target. Once reached, the yaw stays even if the bearing changes.
    fn align_yaw(&mut self, plan: &MulticopterPlan, q: DVec3) {
        let desired = -heading(horizontal(q));
        if self.yaw < 0.0 {
            self.yaw += TAU;
        } else if self.yaw >= TAU {
            self.yaw -= TAU;
        }
        let turn = -turn_sign(self.yaw, desired);
        let turned = self.yaw + turn * plan.yaw_step;
        self.yaw = if -turn_sign(turned, desired) != turn { desired } else { turned };
        if (desired - self.yaw).abs() < YAW_TOLERANCE {
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

    fn set_pointing(&mut self, yaw: f64) {
        // An unchanged yaw costs no trigonometry.
        if yaw.to_bits() != self.pointing_yaw.to_bits() {
            self.pointing = Rotation::about_z(yaw);
            self.pointing_yaw = yaw;
            self.nose = horizontal(self.pointing.forward());
        }
    }

    /// Current direction: horizontally that of the nose, with the slope of the path to the target.
    fn direction(&self, q: DVec3) -> DVec3 {
        let ahead = unit(q);
        let level = horizontal(ahead).length();
        if level > 0.0 { DVec3::new(level * self.nose.x, level * self.nose.y, ahead.z) } else { self.nose }
    }

    fn level_direction(&self) -> DVec3 {
        horizontal_unit(self.direction(self.course.to_target())).unwrap_or(self.nose)
    }

    /// Predicts how long a smooth turn takes, and the distances that turning or braking needs (spec
    /// kinematics §2.5.3).
    fn predict(&mut self, plan: &MulticopterPlan, leg: &LegCourse, cap: f64) {
        let full = plan.parameters.engine_max_force;
        let ahead = self.level_direction();
        let after = horizontal_unit(self.course.next - self.course.target);
        let angle = after.map_or(0.0, |w| acos(ahead.dot(w).clamp(-1.0, 1.0)));
        self.turn_steps = (angle / plan.yaw_step).floor() as i64;
        if leg.smooth_turn {
            let desired =
                heading(after.unwrap_or_else(|| horizontal(self.course.target - self.course.origin)));
            let start = heading(ahead);
            let turn = turn_sign(start, desired);
            let (mut x, mut y, mut force) = (0.0, 0.0, full);
            for j in 0..self.turn_steps.clamp(0, MAX_TERMS as i64) {
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
            for _ in 0..steps.clamp(0.0, MAX_TERMS) as u64 {
                distance += plan.travel(force, cap);
                force *= plan.slow_factor;
            }
            self.slow_distance = distance;
        }
    }
}

/// The sign of the shorter change of yaw from heading `from` to heading `to`.
fn turn_sign(from: f64, to: f64) -> f64 {
    let positive = |a: f64| if a < 0.0 { a + TAU } else { a };
    let x = positive(to) - positive(from);
    if x > PI || (x > -PI && x < 0.0) { 1.0 } else { -1.0 }
}

/// `value` changed by `step` in the direction of `goal`, possibly beyond it.
fn step_towards(value: f64, goal: f64, step: f64) -> f64 {
    if value < goal {
        value + step
    } else if value > goal {
        value - step
    } else {
        value
    }
}

#[cfg(test)]
mod tests;
