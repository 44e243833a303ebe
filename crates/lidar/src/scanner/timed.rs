//! The motion of a deflector as a function of time.

use super::plan::DevicePlan;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// The motion of a deflector in a leg as a function of time, for deflectors that wander: by even turns from a
/// start, and an angle that is added to them.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct TimedMotion {
    /// Turns at the start of the leg, without the wander.
    pub start: f64,
    /// Turns per second; negative where the deflector is reversed.
    pub rate: f64,
    /// Steps per second.
    pub frequency: f64,
    /// Steps since the start of the leg; −1 before the first one.
    pub steps: i64,
    /// Time since the start of the leg, s.
    pub time: f64,
}

impl TimedMotion {
    /// Before the first step of a leg, which is at `start` turns.
    pub fn new(start: f64, turns_per_step: f64, frequency: f64) -> TimedMotion {
        TimedMotion { start, rate: turns_per_step * frequency, frequency, steps: -1, time: 0.0 }
    }

    /// Turns since phase 0 at the current time.
    pub fn turns(&self, plan: &DevicePlan) -> f64 {
        self.start + self.rate * self.time + self.wander(plan)
    }

    /// The wander at the current time, turns.
    pub fn wander(&self, plan: &DevicePlan) -> f64 {
        plan.motion.wander.as_ref().map_or(0.0, |wander| wander.at(self.time) / TAU)
    }
}
