//! States far ahead in a flight without the steps between: near what stepping would give, not equal to it.
//! For forecasts, which must not take the time of the flight.

use super::guard::ProgressGuard;
use super::plan::FlightPlan;
use super::state::FlightState;

/// When a leg of a plan fires and samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegClock {
    /// Number of the leg in the survey.
    pub number: u32,
    /// True if the scanner fires.
    pub active: bool,
    /// Steps per second of the step clock.
    pub frequency: f64,
    /// Interval of trajectory samples, s; 0 = none.
    pub sample_interval: f64,
}

impl FlightPlan {
    /// The clock of leg `leg` of the plan, counted from 0 with the added ones.
    pub fn leg(&self, leg: usize) -> LegClock {
        let planned = &self.legs[leg];
        LegClock {
            number: planned.number,
            active: planned.settings.active,
            frequency: planned.frequency,
            sample_interval: planned.sample_interval_ns * 1e-9,
        }
    }
}

impl FlightState {
    /// Ends the leg where it is to end. Returns `false` if it was the last one.
    pub fn skip_leg(&mut self, plan: &FlightPlan) -> bool {
        let next = self.leg + 1;
        if next >= plan.flown {
            self.ended = true;
            return false;
        }
        self.platform.jump_to_leg(&plan.platform, next);
        self.change_leg(plan);
        true
    }

    /// Moves on by `steps` steps of the leg, which must not be over before: waypoints are approached at the
    /// leg's speed, the head turns, mirrors get some phase, tables of beams go on to their row. Platforms
    /// that follow a stream stay where they are.
    pub fn jump(&mut self, plan: &FlightPlan, steps: u64) {
        let clock = self.step_clock(plan);
        let far = u32::try_from(steps).unwrap_or(u32::MAX);
        self.platform.jump(&plan.platform, self.leg, steps as f64, clock.after(far));
        let is_active = plan.legs[self.leg].settings.active;
        for (device, state) in plan.devices.iter().zip(&mut self.devices) {
            state.head.jump(steps as f64);
            if is_active {
                state.jump_deflector(device, steps);
            }
        }
        (self.ticks, self.leg_ticks) = (self.ticks + steps, self.leg_ticks + steps);
        self.time_ns = if plan.kinematics.exact_clock || plan.legs[self.leg].times.is_some() {
            self.exact_time_ns(plan)
        } else {
            self.time_ns + plan.legs[self.leg].increment_ns * steps as f64
        };
        self.timer_is_pending = false;
        self.guard = ProgressGuard::disabled();
    }
}

#[cfg(test)]
mod tests {
    use crate::flight::testing::*;
    use crate::flight::{FlightPlan, FlightState, Step};
    use vlscan_survey::{Mount, PlatformKind};

    fn step_to(plan: &FlightPlan, leg: usize, steps: u32) -> FlightState {
        let mut state = FlightState::start(plan);
        while state.leg_index() < leg {
            state.skip(plan, u32::MAX, u32::MAX).unwrap();
        }
        assert_eq!(state.skip(plan, u32::MAX, steps).unwrap().last, Step::Advanced);
        state
    }

    #[test]
    fn jumps_end_near_where_steps_lead() {
        let points = [[0.0, 0.0, 50.0], [200.0, 0.0, 50.0], [200.0, 80.0, 50.0]];
        let flight = || points.map(|p| leg(p, 30.0, |l| turn_head(l, 0.5, 90.0))).to_vec();
        let drive = points.map(|p| leg([p[0], p[1], 0.0], 5.0, |_| {})).to_vec();
        for (kind, legs, tolerance) in [
            // The first step of a flight does not move yet.
            (PlatformKind::LinearPath, flight(), 0.4),
            (PlatformKind::GroundVehicle { drag: 0.005 }, drive, 15.0),
        ] {
            let survey = survey(kind, Mount::IDENTITY, straight(), legs);
            let (plan, _) = plan_of(&survey).unwrap();
            for (leg, steps) in [(0, 100u32), (1, 60)] {
                let stepped = step_to(&plan, leg, steps);
                let mut jumped = FlightState::start(&plan);
                (0..leg).for_each(|_| assert!(jumped.skip_leg(&plan)));
                jumped.jump(&plan, u64::from(steps));
                let off = (jumped.position() - stepped.position()).length();
                assert!(off < tolerance, "leg {leg}: {off}");
                assert_eq!(jumped.leg_number(&plan), stepped.leg_number(&plan));
            }
        }
    }
}
