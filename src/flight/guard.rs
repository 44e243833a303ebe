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

    /// Whether the leg has come to nothing when looked at at tick `now`, `distance` m from the waypoint; sets the next look
    /// if not. `waiting`: the leg goes on because the head still turns.
    pub fn is_stuck(
        &mut self,
        plan: &PlatformPlan,
        leg: usize,
        now: u64,
        distance: f64,
        waiting: bool,
    ) -> bool {
        if waiting {
            self.nearest = distance;
        } else {
            let reach = detour_seconds(plan, leg) * cruise_speed(plan, leg);
            let gained = self.before - self.nearest;
            let progress = if reach.is_finite() { gained > PROGRESS * reach } else { gained > 0.0 };
            if !(plan.is_physical() && progress) {
                return true;
            }
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

#[cfg(test)]
mod tests {
    use crate::error::Error;
    use crate::flight::testing::*;
    use crate::flight::{FlightPlan, FlightState, Step};
    use crate::survey::{Leg, Mount, PlatformKind, Survey};

    fn drive(points: &[[f64; 3]], change: impl Fn(&mut Leg)) -> Survey {
        let legs = points.iter().map(|p| leg(*p, 3.0, &change)).collect();
        survey(PlatformKind::GroundVehicle { drag: 0.005 }, Mount::IDENTITY, straight(), legs)
    }

    /// Flies on without looking at pulses until the end or an error.
    fn outcome(plan: &FlightPlan) -> Result<usize, String> {
        let (mut state, mut steps) = (FlightState::start(plan), 0);
        loop {
            match state.step(plan, &mut Count::default()) {
                Ok(Step::Ended) => return Ok(steps),
                Ok(_) => steps += 1,
                Err(Error::Input(d)) => return Err(d.render(false)),
                Err(e) => panic!("{e}"),
            }
        }
    }

    #[test]
    fn a_vehicle_that_circles_its_waypoint_is_stopped() {
        // spec kinematics §11.4: leg 2 does not end
        let s = drive(&[[0.0, 0.0, 0.0], [20.0, 3.0, 0.0], [20.0, 40.0, 0.0], [0.0, 50.0, 0.0]], |_| {});
        let report = outcome(&plan_of(&s).unwrap().0).unwrap_err();
        assert!(report.contains("leg 2 never ends"), "{report}");
    }

    #[test]
    fn a_greatest_duration_makes_the_guard_needless() {
        let s = drive(&[[0.0, 0.0, 0.0], [20.0, 3.0, 0.0], [20.0, 40.0, 0.0], [0.0, 50.0, 0.0]], |l| {
            l.scanner.max_duration = Some(60.0);
        });
        assert!(outcome(&plan_of(&s).unwrap().0).is_ok());
    }

    #[test]
    fn a_long_way_is_no_circle() {
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
    fn steps_too_small_to_move_are_noticed() {
        let mut s = drive(&[[1e8, 0.0, 0.0], [1e8 + 1e-6, 0.0, 0.0]], |l| l.platform.speed = 1e-7);
        s.platform.kind = PlatformKind::LinearPath;
        let report = outcome(&plan_of(&s).unwrap().0).unwrap_err();
        assert!(report.contains("leg 0 never ends"), "{report}");
    }
}
