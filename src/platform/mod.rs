//! What carries the scanner: position and attitude per step (spec kinematics §2).
//!
//! [`PlatformPlan`] is what never changes during a run, [`PlatformState`] is what does. A step of the straight movers
//! costs a square root and no trigonometry; attitudes are composed only when a pulse asks for them.

mod course;
mod ground_vehicle;
mod interpolated;
mod layout;
mod linear;
mod multicopter;
mod physics;
mod pose_table;
mod poses;
mod stream;
mod table;
mod trajectory_file;

pub use course::{LegCourse, Span};
pub use interpolated::InterpolatedState;
pub use poses::{PollResult, Pose, PoseEvent, PoseReader};
use stream::StreamPlan;
pub use stream::{Readiness, StreamState};
pub use table::TrajectoryTable;
pub use trajectory_file::read_trajectories;

use crate::geom::{DVec3, Rotation};
use crate::survey::{Kinematics, RotationSpec};
use course::Course;
use ground_vehicle::{GroundVehicle, GroundVehiclePlan};
use linear::LinearPath;
use multicopter::{MulticopterPlan, MulticopterState};

/// A platform and where its legs lead it; immutable during a run.
#[derive(Clone, Debug)]
pub struct PlatformPlan {
    kind: KindPlan,
    legs: Vec<LegCourse>,
    rotation_spec: RotationSpec,
    kinematics: Kinematics,
}

#[derive(Clone, Debug)]
enum KindPlan {
    Static,
    Linear,
    GroundVehicle(GroundVehiclePlan),
    /// By leg.
    Multicopter(Vec<MulticopterPlan>),
    Interpolated(TrajectoryTable),
    Stream(StreamPlan),
}

/// Where a platform is and how it moves; small and cheap to clone.
#[derive(Clone, Debug)]
pub struct PlatformState(KindState);

#[derive(Clone, Debug)]
enum KindState {
    Static(DVec3),
    Linear(LinearPath),
    GroundVehicle(GroundVehicle),
    Multicopter(MulticopterState),
    Interpolated(InterpolatedState),
    Stream(StreamState),
}

/// How a leg is entered (spec kinematics §1.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LegEntry {
    /// The first leg of a run: the platform is placed at it.
    Initial,
    /// A later leg: a moving platform goes on from where it is.
    Continuing,
}

impl PlatformPlan {
    /// Stands still at each leg.
    pub fn fixed(legs: Vec<LegCourse>) -> PlatformPlan {
        PlatformPlan::new(KindPlan::Static, legs)
    }

    /// Flies straight from leg to leg.
    pub fn linear(legs: Vec<LegCourse>) -> PlatformPlan {
        PlatformPlan::new(KindPlan::Linear, legs)
    }

    /// Drives from leg to leg; `drag` per step.
    pub fn ground_vehicle(drag: f64, legs: Vec<LegCourse>) -> PlatformPlan {
        PlatformPlan::new(KindPlan::GroundVehicle(GroundVehiclePlan { drag }), legs)
    }

    /// Flies from leg to leg as a multicopter whose angular steps are fixed by the first leg's pulse frequency, or, with
    /// [`Kinematics::leg_pulse_rate`], by that of each leg.
    pub fn multicopter(
        parameters: crate::survey::Multicopter,
        legs: Vec<LegCourse>,
        kinematics: Kinematics,
    ) -> PlatformPlan {
        let first = legs.first().map_or(1.0, |l| l.frequency);
        let frequency = |leg: &LegCourse| if kinematics.leg_pulse_rate { leg.frequency } else { first };
        let plans = legs.iter().map(|leg| MulticopterPlan::new(parameters.clone(), frequency(leg)));
        PlatformPlan::new(KindPlan::Multicopter(plans.collect()), legs).with(kinematics)
    }

    /// The same platform with these departures from the reference.
    pub fn with(self, kinematics: Kinematics) -> PlatformPlan {
        PlatformPlan { kinematics, ..self }
    }

    /// Follows a table of recorded poses.
    pub fn interpolated(
        table: TrajectoryTable,
        rotation_spec: RotationSpec,
        legs: Vec<LegCourse>,
    ) -> PlatformPlan {
        PlatformPlan { rotation_spec, ..PlatformPlan::new(KindPlan::Interpolated(table), legs) }
    }

    /// Follows poses as they arrive, `frequency` steps per second; between poses that are more than `max_gap` seconds
    /// apart it takes none.
    pub fn stream(
        frequency: u32,
        max_gap: f64,
        rotation_spec: RotationSpec,
        legs: Vec<LegCourse>,
    ) -> PlatformPlan {
        let plan = StreamPlan { frequency, max_gap };
        PlatformPlan { rotation_spec, ..PlatformPlan::new(KindPlan::Stream(plan), legs) }
    }

    fn new(kind: KindPlan, legs: Vec<LegCourse>) -> PlatformPlan {
        PlatformPlan { kind, legs, rotation_spec: RotationSpec::Canonical, kinematics: Kinematics::HELIOS }
    }

    /// Whether the platform never moves within a leg.
    pub fn is_static(&self) -> bool {
        matches!(self.kind, KindPlan::Static)
    }

    /// The recorded poses that the platform follows, if they are known before the run.
    pub fn table(&self) -> Option<&TrajectoryTable> {
        match &self.kind {
            KindPlan::Interpolated(table) => Some(table),
            _ => None,
        }
    }

    /// Whether the platform flies straight.
    pub fn is_linear(&self) -> bool {
        matches!(self.kind, KindPlan::Linear)
    }

    /// Whether the platform drives.
    pub fn is_ground_vehicle(&self) -> bool {
        matches!(self.kind, KindPlan::GroundVehicle(_))
    }

    /// Whether the platform moves from waypoint to waypoint.
    pub fn heads_for_waypoints(&self) -> bool {
        self.is_linear() || self.is_physical()
    }

    /// Whether the platform follows a stream of poses.
    pub fn is_stream(&self) -> bool {
        matches!(self.kind, KindPlan::Stream(_))
    }

    /// Whether the platform accelerates and steers, so that nobody can say beforehand when it arrives.
    pub fn is_physical(&self) -> bool {
        matches!(self.kind, KindPlan::GroundVehicle(_) | KindPlan::Multicopter(_))
    }

    /// The highest speed in m/s that the engine reaches against its drag; infinite without drag and for the others.
    pub fn terminal_speed(&self) -> f64 {
        match &self.kind {
            KindPlan::GroundVehicle(g) => ground_vehicle::CRUISE_FORCE / g.drag,
            KindPlan::Multicopter(legs) => {
                legs.first().map_or(f64::INFINITY, MulticopterPlan::terminal_speed)
            }
            _ => f64::INFINITY,
        }
    }

    /// The legs that the platform visits, the added ones of interpolated platforms included.
    pub fn legs(&self) -> &[LegCourse] {
        &self.legs
    }

    /// The platform before any leg.
    pub fn at_rest(&self) -> PlatformState {
        PlatformState(match &self.kind {
            KindPlan::Static => KindState::Static(DVec3::ZERO),
            KindPlan::Linear => KindState::Linear(LinearPath::default()),
            KindPlan::GroundVehicle(_) => KindState::GroundVehicle(GroundVehicle::default()),
            KindPlan::Multicopter(_) => KindState::Multicopter(MulticopterState::default()),
            KindPlan::Interpolated(table) => KindState::Interpolated(InterpolatedState::new(table)),
            KindPlan::Stream(_) => KindState::Stream(StreamState::default()),
        })
    }
}

impl PlatformState {
    /// Enters leg `leg` at `clock` seconds of the step clock (spec kinematics §1.4, steps 4 to 8).
    pub fn start_leg(&mut self, plan: &PlatformPlan, leg: usize, entry: LegEntry, clock: f64) {
        let course = &plan.legs[leg];
        match (&mut self.0, &plan.kind) {
            (KindState::Static(p), _) => *p = course.position,
            (KindState::Linear(s), _) => s.start_leg(&plan.legs, leg, entry, &plan.kinematics),
            (KindState::GroundVehicle(s), _) => s.start_leg(&plan.legs, leg, entry, &plan.kinematics),
            (KindState::Multicopter(s), KindPlan::Multicopter(m)) => {
                s.start_leg(&m[leg], &plan.legs, leg, entry, &plan.kinematics);
            }
            (KindState::Interpolated(s), KindPlan::Interpolated(table)) => {
                s.start_leg(table, course.span, clock);
                if plan.kinematics.legs_on_time {
                    s.begin_at(clock, 1e-3 / course.frequency);
                }
            }
            _ => {}
        }
    }

    /// Whether the next step can be taken; always, unless the platform follows a stream.
    #[inline]
    pub fn readiness(&self, plan: &PlatformPlan) -> Readiness {
        match (&self.0, &plan.kind) {
            (KindState::Stream(s), KindPlan::Stream(plan)) => s.readiness(plan),
            _ => Readiness::Ready,
        }
    }

    /// The next step's time in ns of the GPS week, where the platform's poses say it.
    #[inline]
    pub fn next_time_ns(&self, plan: &PlatformPlan) -> Option<f64> {
        match (&self.0, &plan.kind) {
            (KindState::Stream(s), KindPlan::Stream(plan)) => Some(s.next_time_ns(plan)),
            _ => None,
        }
    }

    /// Moves on by one step of leg `leg`; the step clock stands at `clock` seconds.
    #[inline]
    pub fn step(&mut self, plan: &PlatformPlan, leg: usize, clock: f64) {
        match (&mut self.0, &plan.kind) {
            (KindState::Linear(s), _) => s.step(&plan.legs[leg]),
            (KindState::GroundVehicle(s), KindPlan::GroundVehicle(g)) => s.step(g, &plan.legs[leg]),
            (KindState::Multicopter(s), KindPlan::Multicopter(m)) => s.step(&m[leg], &plan.legs[leg]),
            (KindState::Interpolated(s), KindPlan::Interpolated(table)) => s.step(table, clock),
            (KindState::Stream(s), KindPlan::Stream(plan)) => s.step(plan),
            _ => {}
        }
    }

    /// Whether the leg's end is reached (spec kinematics §1.5). Asking counts down a multicopter's smooth turn.
    #[inline]
    pub fn reached(&mut self, plan: &PlatformPlan, leg: usize, clock: f64) -> bool {
        match &mut self.0 {
            KindState::Static(_) => true,
            KindState::Linear(s) => s.course.reached(),
            KindState::GroundVehicle(s) => s.course.reached(),
            KindState::Multicopter(s) => s.reached(&plan.legs[leg]),
            KindState::Interpolated(s) => s.reached(clock),
            KindState::Stream(_) => false,
        }
    }

    /// Position, m, scene frame.
    #[inline]
    pub fn position(&self) -> DVec3 {
        match &self.0 {
            KindState::Static(p) => *p,
            KindState::Linear(s) => s.course.position,
            KindState::GroundVehicle(s) => s.course.position,
            KindState::Multicopter(s) => s.course.position,
            KindState::Interpolated(s) => s.position(),
            KindState::Stream(s) => s.position(),
        }
    }

    /// The attitude that carries the mount (spec kinematics §2.1: `P` at the last refresh of the mount).
    pub fn pointing(&self, plan: &PlatformPlan) -> Rotation {
        match &self.0 {
            KindState::Static(_) => Rotation::IDENTITY,
            KindState::Linear(s) => s.attitude,
            KindState::GroundVehicle(s) => s.attitude,
            KindState::Multicopter(s) if plan.kinematics.multicopter_tilt => s.tilted(),
            KindState::Multicopter(s) if plan.kinematics.heading_along_leg => s.level(),
            KindState::Multicopter(s) => s.mount_pointing,
            KindState::Interpolated(s) => s.attitude(plan.rotation_spec),
            KindState::Stream(s) => s.attitude(),
        }
    }

    /// An attitude of the platform as (roll, pitch, yaw) in radians in the convention of the platform's trajectories, yaw
    /// within [0, 2π] (spec kinematics §9).
    pub fn angles(&self, plan: &PlatformPlan, attitude: Rotation) -> [f64; 3] {
        let recorded = matches!(self.0, KindState::Interpolated(_) | KindState::Stream(_));
        course::reported_angles(attitude, recorded.then_some(plan.rotation_spec))
    }

    /// The attitude that trajectories report: that of the beam's carrier, but in the reference with a multicopter's tilt,
    /// which never reaches the beam.
    pub fn reported_attitude(&self, plan: &PlatformPlan) -> Rotation {
        match &self.0 {
            KindState::Multicopter(s) if !plan.kinematics.multicopter_tilt => s.attitude(),
            _ => self.pointing(plan),
        }
    }

    /// The share of leg `leg` that is done, from 0 to 1 (spec outputs §10.3); `None` for platforms that stand still or
    /// whose way nobody knows.
    pub fn progress(&self, plan: &PlatformPlan, leg: usize, clock: f64) -> Option<f64> {
        match &self.0 {
            KindState::Static(_) | KindState::Stream(_) => None,
            KindState::Linear(s) => Some(s.course.progress(&plan.legs[leg])),
            KindState::GroundVehicle(s) => Some(s.course.progress(&plan.legs[leg])),
            KindState::Multicopter(s) => Some(s.course.progress(&plan.legs[leg])),
            KindState::Interpolated(s) => Some(s.progress(clock)),
        }
    }

    /// The distance to the waypoint in metres for platforms that head for one.
    pub fn distance_left(&self) -> Option<f64> {
        self.course().map(|c| c.to_target().length())
    }

    /// The stream of poses, if the platform follows one.
    pub fn stream_mut(&mut self) -> Option<&mut StreamState> {
        match &mut self.0 {
            KindState::Stream(s) => Some(s),
            _ => None,
        }
    }

    /// Puts position, attitude, origin, target and velocity back to those of `at_run_start`; what a multicopter turned
    /// and the waypoint after the target stay (spec kinematics §1.6, repetitions).
    pub fn restore(&mut self, at_run_start: &PlatformState) {
        match (&mut self.0, &at_run_start.0) {
            (KindState::Multicopter(s), KindState::Multicopter(start)) => s.restore(start),
            (KindState::Linear(s), KindState::Linear(start)) => {
                *s = LinearPath { course: s.course.restored(&start.course), ..start.clone() };
            }
            (KindState::GroundVehicle(s), KindState::GroundVehicle(start)) => {
                s.course = s.course.restored(&start.course);
                s.attitude = start.attitude;
            }
            (s, start) => *s = start.clone(),
        }
    }

    fn course(&self) -> Option<&Course> {
        match &self.0 {
            KindState::Linear(s) => Some(&s.course),
            KindState::GroundVehicle(s) => Some(&s.course),
            KindState::Multicopter(s) => Some(&s.course),
            _ => None,
        }
    }
}
