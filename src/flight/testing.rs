//! Surveys built by hand, and what flying them yields.

use super::{FlightOptions, FlightPlan, FlightSink, FlightState, PoseSample, Pulse, Step};
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use crate::geom::{DVec3, Rotation, radians};
use crate::scanner::testing::{device, settings};
use crate::survey::*;

/// The GPS start of "2024-01-01 00:00:00".
pub const START_NS: f64 = 86_391e9;

/// A survey with one device and no scene to speak of.
pub fn survey(kind: PlatformKind, mount: Mount, deflector: Deflector, legs: Vec<Leg>) -> Survey {
    let mut survey = Survey { legs, ..testkit::survey(vec![device(deflector)]) };
    (survey.platform.kind, survey.platform.mount) = (kind, mount);
    survey.scanner.pulse_freqs = vec![100];
    for (i, leg) in survey.legs.iter_mut().enumerate() {
        leg.number = i as u32;
    }
    survey
}

/// An active leg at `position`, 100 Hz, changed by `change`.
pub fn leg(position: [f64; 3], speed: f64, change: impl FnOnce(&mut Leg)) -> Leg {
    let mut leg = testkit::leg(0, settings(100));
    (leg.platform.position, leg.platform.speed) = (DVec3::from(position), speed);
    change(&mut leg);
    leg
}

/// Sets the head's rate (°/s) and stop angle (°).
pub fn turn_head(leg: &mut Leg, rate: f64, stop: f64) {
    leg.scanner.head_rate = radians(rate);
    leg.scanner.head_stop = radians(stop);
}

/// A mount without rotation.
pub fn mount(offset: [f64; 3]) -> Mount {
    Mount { offset: DVec3::from(offset), rotation: Rotation::IDENTITY }
}

/// A polygon mirror with ±50° to use.
pub fn polygon() -> Deflector {
    Deflector::Polygon { effective_max: radians(50.0) }
}

/// No deflection at all: Risley prisms that are not there.
pub fn straight() -> Deflector {
    Deflector::Risley { prisms: Vec::new(), air: 1.0, incident: DVec3::Y }
}

/// The multicopter of the golden sequences.
pub const MULTICOPTER: Multicopter = Multicopter {
    drag: 0.01,
    engine_max_force: 0.1,
    speedup: 2.0,
    slowdown: 2.0,
    base_pitch: -5.0 * DEGREE,
    pitch_speed: 85.94 * DEGREE,
    roll_speed: 28.65 * DEGREE,
    yaw_speed: 85.94 * DEGREE,
    pitch_offset: 35.0 * DEGREE,
    roll_offset: 25.0 * DEGREE,
};
const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// The plan of `survey` with the start time of the examples.
pub fn plan_of(survey: &Survey) -> Result<(FlightPlan, Diagnostics)> {
    let options = FlightOptions { gps_start_ns: START_NS, ..FlightOptions::default() };
    FlightPlan::new(survey, DVec3::ZERO, &|_, _| None, &options)
}

/// The report of the errors with which `survey` is refused.
pub fn refusal(survey: &Survey) -> String {
    match plan_of(survey) {
        Err(Error::Input(d) | Error::Limits(d)) => d.render(false),
        Err(e) => e.to_string(),
        Ok(_) => panic!("the survey was accepted"),
    }
}

/// Keeps everything.
#[derive(Default)]
pub struct Keep {
    pub pulses: Vec<Pulse>,
    pub poses: Vec<PoseSample>,
}

impl FlightSink for Keep {
    fn pulse(&mut self, pulse: impl FnOnce() -> Pulse) {
        self.pulses.push(pulse());
    }
    fn pose(&mut self, pose: impl FnOnce() -> PoseSample) {
        self.poses.push(pose());
    }
}

/// Counts only.
#[derive(Default)]
pub struct Count {
    pub pulses: u64,
    pub poses: u64,
}

impl FlightSink for Count {
    fn pulse(&mut self, _: impl FnOnce() -> Pulse) {
        self.pulses += 1;
    }
    fn pose(&mut self, _: impl FnOnce() -> PoseSample) {
        self.poses += 1;
    }
}

/// One leg as it was flown.
#[derive(Default)]
pub struct FlownLeg {
    pub steps: usize,
    pub pulses: Vec<Pulse>,
    pub poses: Vec<PoseSample>,
}

/// Flies `survey` to its end.
pub fn fly(survey: &Survey) -> Vec<FlownLeg> {
    let (plan, _) = plan_of(survey).expect("the survey is accepted");
    fly_plan(&plan, &mut FlightState::start(&plan)).expect("the flight ends")
}

/// Flies on from `state` to the end.
pub fn fly_plan(plan: &FlightPlan, state: &mut FlightState) -> Result<Vec<FlownLeg>> {
    let mut legs = vec![FlownLeg::default()];
    loop {
        let mut keep = Keep::default();
        let step = state.step(plan, &mut keep)?;
        let leg = legs.last_mut().expect("there is a leg");
        leg.pulses.append(&mut keep.pulses);
        leg.poses.append(&mut keep.poses);
        match step {
            Step::Advanced => leg.steps += 1,
            Step::LegChanged => legs.push(FlownLeg::default()),
            Step::NeedsPoses => panic!("poses are missing"),
            Step::Ended => return Ok(legs),
        }
    }
}

/// Seconds after the start of the examples.
pub fn seconds(pulse: &Pulse) -> f64 {
    (pulse.time_ns - START_NS) * 1e-9
}
