//! Watches a leg that no greatest duration bounds: it must come nearer to its end.

use crate::platform::{PlatformPlan, PlatformState};

/// Watches the way to a waypoint.
#[derive(Clone, Debug)]
pub(super) struct Watch {
    /// The step clock's tick at which to look.
    pub look_at: u64,
    /// Ticks between two looks.
    interval: u64,
    /// Nearest distance to the waypoint when last looked, and since, m.
    before: f64,
    nearest: f64,
}

/// A waypoint nearer by less than this share of what the platform could have travelled is no progress.
const PROGRESS: f64 = 1e-3;
/// How far a manoeuvre may lead without bringing the platform nearer, m.
const DETOUR: f64 = 1000.0;
/// Bounds of the time that a detour may take, s.
const DETOUR_TIME: (f64, f64) = (60.0, 36_000.0);

impl Watch {
    /// Looks never.
    pub fn off() -> Watch {
        Watch { look_at: u64::MAX, interval: u64::MAX, before: f64::INFINITY, nearest: f64::INFINITY }
    }

    /// Watches leg `leg` from tick `now` on.
    pub fn of_leg(plan: &PlatformPlan, platform: &PlatformState, leg: usize, now: u64) -> Watch {
        let Some(distance) = platform.distance_left() else { return Watch::off() };
        let course = &plan.legs()[leg];
        let ticks = if plan.is_physical() {
            detour_seconds(plan, leg) * course.frequency
        } else {
            // Straight flight takes this many steps but for rounding, and some to turn about.
            distance / course.step_length * 1.001 + 1000.0
        };
        let interval = ticks as u64;
        Watch { look_at: now.saturating_add(interval), interval, before: distance, nearest: distance }
    }

    /// Notes a physical platform's distance.
    pub fn see(&mut self, distance: f64) {
        // A distance that is no number counts as no progress.
        if distance < self.nearest {
            self.nearest = distance;
        }
    }

    /// Whether the leg has come to nothing when looked at at tick `now`; sets the next look if not. `waiting`: the leg
    /// goes on because the head still turns.
    pub fn is_stuck(&mut self, plan: &PlatformPlan, leg: usize, now: u64, waiting: bool) -> bool {
        let reach = detour_seconds(plan, leg) * cruise_speed(plan, leg);
        let gained = self.before - self.nearest;
        let progress = if reach.is_finite() { gained > PROGRESS * reach } else { gained > 0.0 };
        if !waiting && !(plan.is_physical() && progress) {
            return true;
        }
        self.before = self.nearest;
        self.look_at = now.saturating_add(self.interval.max(1));
        false
    }

    /// The nearest distance so far, m.
    pub fn nearest(&self) -> f64 {
        self.nearest
    }
}

fn cruise_speed(plan: &PlatformPlan, leg: usize) -> f64 {
    let speed = plan.legs()[leg].speed;
    if speed > 0.0 { speed.min(plan.terminal_speed()) } else { plan.terminal_speed() }
}

fn detour_seconds(plan: &PlatformPlan, leg: usize) -> f64 {
    (DETOUR / cruise_speed(plan, leg)).clamp(DETOUR_TIME.0, DETOUR_TIME.1)
}
