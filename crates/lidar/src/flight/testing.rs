//! Surveys for tests, and flights along them.

use super::{FlightOptions, FlightPlan, FlightSink, FlightState, PoseSample, Pulse, Step};
pub use crate::platform::testing::MULTICOPTER;
use crate::scanner::testing::{device, settings};
use std::path::PathBuf;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_geom::{DVec3, Rotation, radians};
use vlscan_survey::*;

/// The GPS start of "2024-01-01 00:00:00".
pub const START_NS: f64 = 86_391e9;

pub fn survey(kind: PlatformKind, mount: Mount, deflector: Deflector, legs: Vec<Leg>) -> Survey {
    let mut survey = Survey { legs, ..testkit::survey(vec![device(deflector)]) };
    (survey.platform.kind, survey.platform.mount) = (kind, mount);
    survey.scanner.pulse_freqs = vec![100];
    for (i, leg) in survey.legs.iter_mut().enumerate() {
        leg.number = i as u32;
    }
    survey
}

/// An active leg at `position`, 100 Hz, modified by `change`.
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

pub fn mount(offset: [f64; 3]) -> Mount {
    Mount { offset: DVec3::from(offset), rotation: Rotation::IDENTITY }
}

/// A polygon mirror with ±50° of usable angle.
pub fn polygon() -> Deflector {
    Deflector::Polygon { effective_max: radians(50.0), facet_tilts: Vec::new() }
}

/// No deflection: a Risley device without prisms.
pub fn straight() -> Deflector {
    Deflector::Risley { prisms: Vec::new(), air: 1.0, incident: DVec3::Y }
}

/// A platform that follows the poses of a file.
pub fn following(path: PathBuf, sync_gps_time: bool) -> PlatformKind {
    PlatformKind::Interpolated(Interpolated {
        rotation_spec: RotationSpec::Arinc705,
        position_only: false,
        degrees: true,
        sync_gps_time,
        grid: ProjectionGrid::FirstFix,
        files: vec![TrajectoryFile {
            path,
            content: None,
            columns: None,
            separator: None,
            slope_filter: 0.0,
        }],
    })
}

/// A platform that follows recorded poses at 100, 101, 102 and 104 s: 10 m to the east per second, yaws 0,
/// 10, 30 and 350 degrees, the first one changed to `first_yaw`.
pub fn recorded(first_yaw: f64, sync_gps_time: bool, legs: Vec<Leg>) -> (Survey, tempfile::TempDir) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("flight.txt");
    let rows = [(100, 0, first_yaw), (101, 10, 10.0), (102, 20, 30.0), (104, 40, 350.0)];
    let rows = rows.map(|(t, x, yaw)| format!("{t}, 0, 0, {yaw}, {x}, 0, 0\n")).concat();
    std::fs::write(&path, format!("#TIME_COLUMN: 0\n{rows}")).unwrap();
    (survey(following(path, sync_gps_time), Mount::IDENTITY, Deflector::Fibres { count: 1 }, legs), dir)
}

pub fn recorded_leg(start: f64, end: f64, teleport: bool) -> Leg {
    leg([0.0; 3], 70.0, |l| {
        l.scanner.pulse_freq = 10;
        l.scanner.trajectory_interval = 0.01;
        l.platform.trajectory = Some(LegTrajectory { file: 0, start: Some(start), end: Some(end), teleport });
    })
}

/// Options of the worked examples: the reference's, starting at [`START_NS`].
pub fn options() -> FlightOptions {
    FlightOptions { gps_start_ns: START_NS, ..FlightOptions::default() }
}

/// The plan of `survey` with the start time of the examples, and its warnings.
pub fn plan_of(survey: &Survey) -> Result<(FlightPlan, Diagnostics)> {
    FlightPlan::new(survey, DVec3::ZERO, &|_, _| None, &options())
}

pub fn plan_with(survey: &Survey, options: FlightOptions) -> FlightPlan {
    FlightPlan::new(survey, DVec3::ZERO, &|_, _| None, &options).expect("the survey is accepted").0
}

pub fn refusal(survey: &Survey) -> String {
    match plan_of(survey) {
        Err(Error::Input(d) | Error::Limits(d)) => d.text(),
        Err(e) => e.to_string(),
        Ok(_) => panic!("the survey was accepted"),
    }
}

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

#[derive(Default)]
pub struct FlownLeg {
    pub steps: usize,
    pub pulses: Vec<Pulse>,
    pub poses: Vec<PoseSample>,
}

pub fn fly(survey: &Survey) -> Vec<FlownLeg> {
    fly_plan(&plan_with(survey, options()))
}

pub fn fly_plan(plan: &FlightPlan) -> Vec<FlownLeg> {
    fly_on(plan, &mut FlightState::start(plan))
}

pub fn fly_on(plan: &FlightPlan, state: &mut FlightState) -> Vec<FlownLeg> {
    let mut legs = vec![FlownLeg::default()];
    loop {
        let mut keep = Keep::default();
        let step = state.step(plan, &mut keep).expect("the flight ends");
        let leg = legs.last_mut().expect("there is a leg");
        leg.pulses.append(&mut keep.pulses);
        leg.poses.append(&mut keep.poses);
        match step {
            Step::Advanced => leg.steps += 1,
            Step::LegChanged => legs.push(FlownLeg::default()),
            Step::NeedsPoses => panic!("poses are missing"),
            Step::Ended => return legs,
        }
    }
}

/// Seconds after the start of the examples.
pub fn seconds(pulse: &Pulse) -> f64 {
    (pulse.time_ns - START_NS) * 1e-9
}
