//! Detects legs without a maximum duration that do not get closer to their end.

use crate::platform::{PlatformPlan, PlatformState};
use serde::{Deserialize, Serialize};

/// Tracks whether the platform gets closer to a waypoint.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct ProgressGuard {
    /// The step clock's tick of the next check.
    pub next_check: u64,
    /// Ticks between two checks.
    interval: u64,
    /// Smallest distance to the waypoint before the last check, and until now, m.
    last_nearest: f64,
    nearest: f64,
}

/// A gain of less than this fraction of the distance that the platform could have travelled does not count as
/// progress.
const MIN_PROGRESS: f64 = 1e-3;
/// Length of a manoeuvre that does not bring the platform closer, m.
const MAX_DETOUR: f64 = 1000.0;
/// Bounds of the time allowed for a detour, s.
const DETOUR_TIME: (f64, f64) = (60.0, 36_000.0);

/// Steps of a straight flight beyond those that its length takes.
const MARGIN_STEPS: f64 = 1000.0;

impl ProgressGuard {
    pub fn disabled() -> ProgressGuard {
        let (nearest, last_nearest) = (f64::INFINITY, f64::INFINITY);
        ProgressGuard { next_check: u64::MAX, interval: u64::MAX, last_nearest, nearest }
    }

    pub fn of_leg(plan: &PlatformPlan, platform: &PlatformState, leg: usize, now: u64) -> ProgressGuard {
        let Some(distance) = platform.distance_left() else { return ProgressGuard::disabled() };
        let course = &plan.legs[leg];
        let ticks = if plan.is_physical() {
            detour_seconds(plan, leg) * course.frequency
        } else if course.speed <= 0.0 {
            // It stands, or flies on past its waypoint with the velocity of the leg before.
            MARGIN_STEPS
        } else {
            // Steps of straight flight, with margins for rounding and for turns.
            distance / course.step_length * 1.001 + MARGIN_STEPS
        };
        let interval = ticks as u64;
        let next_check = now.saturating_add(interval);
        ProgressGuard { next_check, interval, last_nearest: distance, nearest: distance }
    }

    /// Records the distance of a physical platform; NaN counts as no progress.
    pub fn record(&mut self, distance: f64) {
        if distance < self.nearest {
            self.nearest = distance;
        }
    }

    /// Checks progress at tick `now`, `distance` m from the waypoint, and schedules the next check; returns
    /// `false` if there is no progress. `waiting`: the leg continues only because the head still turns.
    pub fn check(&mut self, plan: &PlatformPlan, leg: usize, now: u64, distance: f64, waiting: bool) -> bool {
        if waiting {
            self.nearest = distance;
        } else {
            let reach = detour_seconds(plan, leg) * cruise_speed(plan, leg);
            let gained = self.last_nearest - self.nearest;
            let progress = if reach.is_finite() { gained > MIN_PROGRESS * reach } else { gained > 0.0 };
            if !(plan.is_physical() && progress) {
                return false;
            }
        }
        self.last_nearest = self.nearest;
        self.next_check = now.saturating_add(self.interval.max(1));
        true
    }

    pub fn nearest(&self) -> f64 {
        self.nearest
    }
}

fn cruise_speed(plan: &PlatformPlan, leg: usize) -> f64 {
    let speed = plan.legs[leg].speed;
    if speed > 0.0 { speed.min(plan.terminal_speed()) } else { plan.terminal_speed() }
}

fn detour_seconds(plan: &PlatformPlan, leg: usize) -> f64 {
    (MAX_DETOUR / cruise_speed(plan, leg)).clamp(DETOUR_TIME.0, DETOUR_TIME.1)
}

#[cfg(test)]
mod tests {
    use crate::flight::testing::*;
    use crate::flight::{FlightOptions, FlightPlan, FlightState, Step};
    use vlscan_base::corrections::Corrections;
    use vlscan_base::error::Error;
    use vlscan_survey::{Leg, Mount, PlatformKind, Survey};

    fn drive(points: &[[f64; 3]], change: impl Fn(&mut Leg)) -> Survey {
        let legs = points.iter().map(|p| leg(*p, 3.0, &change)).collect();
        survey(PlatformKind::GroundVehicle { drag: 0.005 }, Mount::IDENTITY, straight(), legs)
    }

    /// Number of steps until the end, or the error.
    fn outcome(plan: &FlightPlan) -> Result<usize, String> {
        let (mut state, mut steps) = (FlightState::start(plan), 0);
        loop {
            match state.step(plan, &mut Count::default()) {
                Ok(Step::Ended) => return Ok(steps),
                Ok(_) => steps += 1,
                Err(Error::Input(d)) => return Err(d.text()),
                Err(e) => panic!("{e}"),
            }
        }
    }

    #[test]
    fn a_vehicle_that_circles_its_waypoint_is_stopped_unless_the_leg_has_a_maximum_duration() {
        // spec kinematics §11.4: leg 2 does not end
        let mut s = drive(&[[0.0, 0.0, 0.0], [20.0, 3.0, 0.0], [20.0, 40.0, 0.0], [0.0, 50.0, 0.0]], |_| {});
        let report = outcome(&plan_of(&s).unwrap().0).unwrap_err();
        assert!(report.contains("leg 2 never ends"), "{report}");
        s.legs.iter_mut().for_each(|l| l.scanner.max_duration = Some(60.0));
        assert!(outcome(&plan_of(&s).unwrap().0).is_ok());
    }

    #[test]
    fn long_legs_are_flown_to_their_end() {
        let s = drive(&[[0.0, 0.0, 0.0], [0.0, 3000.0, 0.0], [0.0, 3001.0, 0.0]], |_| {});
        assert!(outcome(&plan_of(&s).unwrap().0).unwrap() > 100_000);
        let mut slow = drive(&[[0.0, 0.0, 0.0], [0.0, 100.0, 0.0]], |l| l.platform.speed = 0.1);
        slow.platform.kind = PlatformKind::LinearPath;
        assert!(outcome(&plan_of(&slow).unwrap().0).unwrap() > 100_000);
    }

    #[test]
    fn a_platform_may_wait_at_its_waypoint_while_the_head_turns() {
        let mut s =
            drive(&[[0.0, 0.0, 0.0], [20.0, 3.0, 0.0], [40.0, 3.0, 0.0]], |l| turn_head(l, 0.5, 360.0));
        s.platform.kind = PlatformKind::LinearPath;
        assert!(outcome(&plan_of(&s).unwrap().0).unwrap() >= 3 * 72_000);
    }

    #[test]
    fn a_multicopter_that_misses_its_waypoint_is_stopped() {
        // spec kinematics §11.3: with smooth turns leg 1 does not end
        let legs = [([0.0, 0.0, 50.0], 8.0), ([40.0, 10.0, 52.0], 8.0), ([20.0, 50.0, 48.0], 5.0)];
        let legs = legs.map(|(p, speed)| leg(p, speed, |l| l.platform.smooth_turn = true)).to_vec();
        let s = survey(PlatformKind::Multicopter(MULTICOPTER), Mount::IDENTITY, straight(), legs);
        let report = outcome(&plan_of(&s).unwrap().0).unwrap_err();
        assert!(report.contains("leg 1 never ends"), "{report}");
    }

    #[test]
    fn a_linear_path_that_passes_its_last_waypoint_is_stopped() {
        // spec kinematics §2.3: without a speed the velocity stays that of the leg before
        let mut s = drive(&[[0.0, 0.0, 0.0], [20.0, 3.0, 0.0]], |_| {});
        s.platform.kind = PlatformKind::LinearPath;
        turn_head(&mut s.legs[1], 360.0, 36.0);
        s.legs[1].platform.speed = 0.0;
        let report = outcome(&plan_of(&s).unwrap().0).unwrap_err();
        assert!(report.contains("leg 1 never ends") && report.contains("movePerSec_m"), "{report}");
        s.legs[1].platform.speed = 3.0;
        assert!(outcome(&plan_of(&s).unwrap().0).is_ok());
        s.legs[1].platform.speed = 0.0;
        s.legs[1].scanner.max_duration = Some(60.0);
        assert!(outcome(&plan_of(&s).unwrap().0).is_ok());
    }

    #[test]
    fn without_a_speed_a_linear_path_stands_where_its_leg_begins() {
        let mut s = drive(&[[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [20.0, 0.0, 0.0]], |_| {});
        s.platform.kind = PlatformKind::LinearPath;
        s.legs[1..].iter_mut().for_each(|l| l.platform.speed = 0.0);
        turn_head(&mut s.legs[1], 360.0, 36.0);
        turn_head(&mut s.legs[2], 360.0, 72.0);
        let corrected = FlightOptions { kinematics: Corrections::MOTION, ..options() };
        let legs = fly_plan(&plan_with(&s, corrected.clone()));
        for (leg, steps) in legs[1..].iter().zip([10, 20]) {
            assert!(leg.steps.abs_diff(steps) <= 1, "{} steps", leg.steps);
            assert!(leg.pulses.iter().all(|p| p.origin.x == 20.0), "{:?}", leg.pulses.last());
        }
        // A greatest duration ends the first leg after 9 m.
        s.legs[0].scanner.max_duration = Some(3.0);
        s.legs[1..].iter_mut().for_each(|l| l.scanner.max_duration = Some(1.0));
        let legs = fly_plan(&plan_with(&s, corrected));
        let stands = legs[1].pulses[0].origin;
        assert!((stands.x - 9.0).abs() < 0.1, "{stands:?}");
        assert!(legs[1].steps >= 99 && legs[1].pulses.iter().all(|p| p.origin == stands));
    }

    #[test]
    fn steps_too_small_to_move_are_detected() {
        let mut s = drive(&[[1e8, 0.0, 0.0], [1e8 + 1e-6, 0.0, 0.0]], |l| l.platform.speed = 1e-7);
        s.platform.kind = PlatformKind::LinearPath;
        let report = outcome(&plan_of(&s).unwrap().0).unwrap_err();
        assert!(report.contains("leg 0 never ends"), "{report}");
    }
}
