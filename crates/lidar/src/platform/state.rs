//! State of a platform of any kind: position, attitude and motion.

use super::course::{Course, LegEntry, horizontal, reported_angles};
use super::ground_vehicle::GroundVehicle;
use super::interpolated::InterpolatedState;
use super::linear::LinearPath;
use super::multicopter::MulticopterState;
use super::plan::{Motion, PlatformPlan};
use super::stream::{Readiness, StreamState};
use serde::{Deserialize, Serialize};
use vlscan_geom::{DVec3, Rotation, unit};

/// State of a platform; small and cheap to clone.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum PlatformState {
    /// The position of the leg.
    Static(DVec3),
    /// On a straight path.
    Linear(LinearPath),
    /// A vehicle.
    GroundVehicle(GroundVehicle),
    /// A multicopter.
    Multicopter(MulticopterState),
    /// Along a table of poses.
    Interpolated(InterpolatedState),
    /// Along a stream of poses.
    #[serde(skip)]
    Stream(StreamState),
}

impl PlatformState {
    /// The platform of `plan` before any leg.
    pub fn at_rest(plan: &PlatformPlan) -> PlatformState {
        match &plan.motion {
            Motion::Static => PlatformState::Static(DVec3::ZERO),
            Motion::Linear => PlatformState::Linear(LinearPath::default()),
            Motion::GroundVehicle { .. } => PlatformState::GroundVehicle(GroundVehicle::default()),
            Motion::Multicopter(_) => PlatformState::Multicopter(MulticopterState::default()),
            Motion::Interpolated(table) => PlatformState::Interpolated(InterpolatedState::new(table)),
            Motion::Stream(_) => PlatformState::Stream(StreamState::default()),
        }
    }

    /// Enters leg `leg` at `clock` seconds of the step clock (spec kinematics §1.4, steps 4 to 8).
    pub fn start_leg(&mut self, plan: &PlatformPlan, leg: usize, entry: LegEntry, clock: f64) {
        let (legs, kinematics) = (&plan.legs, &plan.kinematics);
        match (self, &plan.motion) {
            (PlatformState::Static(p), _) => *p = legs[leg].position,
            (PlatformState::Linear(s), _) => s.start_leg(legs, leg, entry, kinematics),
            (PlatformState::GroundVehicle(s), _) => s.start_leg(legs, leg, entry, kinematics),
            (PlatformState::Multicopter(s), Motion::Multicopter(m)) => {
                s.start_leg(&m[leg], legs, leg, entry, kinematics);
            }
            (PlatformState::Interpolated(s), Motion::Interpolated(table)) => {
                s.start_leg(table, legs[leg].span, clock);
                if kinematics.legs_on_time {
                    s.start_on_time(clock, 1e-3 / legs[leg].frequency);
                }
            }
            _ => {}
        }
    }

    /// Readiness of the next step; always ready, unless the platform follows a stream.
    #[inline]
    pub fn readiness(&self, plan: &PlatformPlan) -> Readiness {
        match (self, &plan.motion) {
            (PlatformState::Stream(s), Motion::Stream(plan)) => s.readiness(plan),
            _ => Readiness::Ready,
        }
    }

    /// The next step's time in ns of the GPS week, for platforms that follow a stream.
    #[inline]
    pub fn next_time_ns(&self, plan: &PlatformPlan) -> Option<f64> {
        match (self, &plan.motion) {
            (PlatformState::Stream(s), Motion::Stream(plan)) => Some(s.next_time_ns(plan)),
            _ => None,
        }
    }

    /// The time that times of pulses count from, s, where these are not seconds of the week; see
    /// [`adjusted_time_origin`](super::adjusted_time_origin).
    pub fn time_origin(&self, plan: &PlatformPlan) -> Option<f64> {
        match (self, &plan.motion) {
            (PlatformState::Stream(s), Motion::Stream(plan)) => s.time_origin(plan),
            _ => None,
        }
    }

    /// Takes one step of leg `leg`; the step clock is at `clock` seconds.
    #[inline]
    pub fn step(&mut self, plan: &PlatformPlan, leg: usize, clock: f64) {
        match (self, &plan.motion) {
            (PlatformState::Linear(s), _) => s.step(&plan.legs[leg]),
            (PlatformState::GroundVehicle(s), Motion::GroundVehicle { drag }) => {
                s.step(*drag, &plan.legs[leg], plan.kinematics.vehicle_heights)
            }
            (PlatformState::Multicopter(s), Motion::Multicopter(m)) => s.step(&m[leg], &plan.legs[leg]),
            (PlatformState::Interpolated(s), Motion::Interpolated(table)) => s.step(table, clock),
            (PlatformState::Stream(s), Motion::Stream(plan)) => s.step(plan),
            _ => {}
        }
    }

    /// Takes a step of leg `leg` whose pulses have times of their own: `clock` as for [`step`](Self::step),
    /// `steps` the time since the start of the leg or the step before, in steps of the mean rate.
    pub fn step_by(&mut self, plan: &PlatformPlan, leg: usize, clock: f64, steps: f64, is_first: bool) {
        match self {
            PlatformState::Linear(s) => s.step_by(&plan.legs[leg], steps, is_first),
            _ => self.step(plan, leg, clock),
        }
    }

    /// True if a platform with waypoints reaches its next one before `steps` steps of the mean rate have
    /// passed.
    pub fn arrives_within(&self, steps: f64) -> bool {
        self.course().is_some_and(|course| {
            let (way, step) = (course.to_target().length(), course.velocity.length());
            way == 0.0 || way < step * steps
        })
    }

    /// Number and time (s after the first pose) of the step that is `ahead` after the next one, of a platform
    /// that follows a stream.
    pub fn step_ahead(&self, plan: &PlatformPlan, ahead: u32) -> Option<(u64, f64)> {
        match (self, &plan.motion) {
            (PlatformState::Stream(s), Motion::Stream(plan)) => Some(s.step_ahead(plan, ahead)),
            _ => None,
        }
    }

    /// Number of steps, at least, that [`advance`](Self::advance) can take before the end of the leg can be
    /// reached, or before poses have to arrive; 0 for platforms that are stepped one by one. The step clock
    /// is at `clock` seconds and ticks `frequency` times per second, which in the reference is not the leg's
    /// own rate.
    pub fn steps_before_arrival(&self, plan: &PlatformPlan, leg: usize, clock: f64, frequency: f64) -> f64 {
        match (self, &plan.motion) {
            (PlatformState::Linear(s), _) => s.steps_to_target(&plan.legs[leg]),
            (PlatformState::Interpolated(s), _) => {
                (s.time_left(clock) * frequency * (1.0 - 1e-6)).floor() - 4.0
            }
            (PlatformState::Stream(s), Motion::Stream(plan)) => s.steps_to_pose(plan),
            _ => 0.0,
        }
    }

    /// Takes `steps` steps, at most [`steps_before_arrival`](Self::steps_before_arrival) unless the platform
    /// is static. `clock` returns the step clock of each, s. Returns the time of the last step in ns of the
    /// GPS week for platforms that follow a stream.
    pub fn advance(
        &mut self,
        plan: &PlatformPlan,
        leg: usize,
        steps: u32,
        clock: impl Fn(u32) -> f64,
    ) -> Option<f64> {
        match (self, &plan.motion) {
            (PlatformState::Linear(s), _) => s.advance(&plan.legs[leg], steps),
            (PlatformState::Interpolated(s), Motion::Interpolated(table)) => {
                (0..steps).for_each(|i| s.step(table, clock(i)));
            }
            (PlatformState::Stream(s), Motion::Stream(plan)) => return Some(s.advance(plan, steps)),
            _ => {}
        }
        None
    }

    /// Moves on by `steps` steps of leg `leg` at once, after which the step clock is at `clock` seconds:
    /// straight towards the waypoint at the leg's speed, up to a step before it. Near what single steps give.
    pub fn jump(&mut self, plan: &PlatformPlan, leg: usize, steps: f64, clock: f64) {
        if let (PlatformState::Interpolated(s), Motion::Interpolated(table)) = (&mut *self, &plan.motion) {
            s.step(table, clock);
        }
        let Some(course) = self.course_mut() else { return };
        let (way, step) = (course.to_target(), plan.legs[leg].step_length);
        let far = (steps * step).min(way.length() - 2.0 * step);
        if far > 0.0 {
            course.position += unit(way) * far;
            course.velocity = unit(way) * step;
        }
    }

    /// Puts a platform with waypoints to the start of leg `leg`, for a leg that is about to begin.
    pub fn jump_to_leg(&mut self, plan: &PlatformPlan, leg: usize) {
        if let Some(course) = self.course_mut() {
            course.position = plan.legs[leg].position;
        }
    }

    /// Checks whether the end of the leg is reached (spec kinematics §1.5). Each check counts down a
    /// multicopter's smooth turn.
    #[inline]
    pub fn check_arrival(&mut self, plan: &PlatformPlan, leg: usize, clock: f64) -> bool {
        match self {
            PlatformState::Static(_) => true,
            PlatformState::Linear(s) => {
                // For a platform that stands there the reference divides 0 by 0 and never ends.
                s.course.is_reached()
                    || (plan.kinematics.sharp_corners && s.course.to_target() == DVec3::ZERO)
            }
            PlatformState::GroundVehicle(s) => s.course.is_reached(),
            PlatformState::Multicopter(s) => s.check_arrival(&plan.legs[leg]),
            PlatformState::Interpolated(s) => s.is_over(clock),
            PlatformState::Stream(_) => false,
        }
    }

    /// Position, m, scene frame.
    #[inline]
    pub fn position(&self) -> DVec3 {
        match self {
            PlatformState::Static(p) => *p,
            PlatformState::Linear(s) => s.course.position,
            PlatformState::GroundVehicle(s) => s.course.position,
            PlatformState::Multicopter(s) => s.course.position,
            PlatformState::Interpolated(s) => s.position(),
            PlatformState::Stream(s) => s.position(),
        }
    }

    /// Direction in which the platform moves over the ground, horizontal and of any length: that of its path,
    /// or of its nose where it stands. Ground vehicles, which may back up, have the direction of the nose.
    /// `None` for static platforms, and where the direction is vertical.
    pub fn direction_of_travel(&self, plan: &PlatformPlan) -> Option<DVec3> {
        let way = match (self, &plan.motion) {
            (PlatformState::Static(_), _) => return None,
            (PlatformState::GroundVehicle(_), _) => DVec3::ZERO,
            (PlatformState::Interpolated(s), Motion::Interpolated(table)) => {
                unless_standing(s.velocity(table))
            }
            (PlatformState::Stream(s), _) => unless_standing(s.velocity()),
            _ => self.course().map_or(DVec3::ZERO, |course| course.velocity),
        };
        let is_direction = |way: &DVec3| way.x != 0.0 || way.y != 0.0;
        let nose = || self.mount_attitude(plan).forward();
        Some(horizontal(way)).filter(is_direction).or_else(|| Some(horizontal(nose())).filter(is_direction))
    }

    /// Velocity, m/s, with `frequency` steps per second.
    pub fn velocity(&self, plan: &PlatformPlan, frequency: f64) -> DVec3 {
        match (self, &plan.motion) {
            (PlatformState::Interpolated(s), Motion::Interpolated(table)) => s.velocity(table),
            (PlatformState::Stream(s), _) => s.velocity(),
            _ => self.course().map_or(DVec3::ZERO, |course| course.velocity * frequency),
        }
    }

    /// Position, m, scene frame, and attitude that carries the mount, `seconds` after the last step, which
    /// are `part` of a step. Vehicles and multicopters keep the attitude of the step.
    pub fn pose_within_step(&self, plan: &PlatformPlan, seconds: f64, part: f64) -> (DVec3, Rotation) {
        match (self, &plan.motion) {
            (PlatformState::Interpolated(s), Motion::Interpolated(table)) => {
                let later = s.after(table, seconds);
                (later.position(), later.attitude(plan.rotation_spec))
            }
            (PlatformState::Stream(s), _) => s.pose_after(seconds),
            _ => {
                let way = self.course().map_or(DVec3::ZERO, |course| course.velocity * part);
                (self.position() + way, self.mount_attitude(plan))
            }
        }
    }

    /// The attitude that carries the mount (spec kinematics §2.1: `P` at the last refresh of the mount).
    pub fn mount_attitude(&self, plan: &PlatformPlan) -> Rotation {
        match self {
            PlatformState::Static(_) => Rotation::IDENTITY,
            PlatformState::Linear(s) => s.attitude,
            PlatformState::GroundVehicle(s) => s.attitude,
            PlatformState::Multicopter(s) if plan.kinematics.multicopter_tilt => s.tilted(),
            PlatformState::Multicopter(s) if plan.kinematics.heading_along_leg => s.level(),
            PlatformState::Multicopter(s) => s.mount_pointing,
            PlatformState::Interpolated(s) => s.attitude(plan.rotation_spec),
            PlatformState::Stream(s) => s.attitude(),
        }
    }

    /// The attitude that trajectories report: the mount's, except for the reference's multicopter, whose tilt
    /// is reported but never reaches the beam.
    pub fn reported_attitude(&self, plan: &PlatformPlan) -> Rotation {
        match self {
            PlatformState::Multicopter(s) if !plan.kinematics.multicopter_tilt => s.attitude(),
            _ => self.mount_attitude(plan),
        }
    }

    /// `attitude` as roll, pitch and yaw in rad in the convention of the platform's trajectories, yaw within
    /// [0, 2π] (spec kinematics §9).
    pub fn angles(&self, plan: &PlatformPlan, attitude: Rotation) -> [f64; 3] {
        let recorded = matches!(self, PlatformState::Interpolated(_) | PlatformState::Stream(_));
        reported_angles(attitude, recorded.then_some(plan.rotation_spec))
    }

    /// The completed fraction of leg `leg` (spec outputs §10.3); `None` for static platforms and for streams,
    /// whose length is unknown.
    pub fn progress(&self, plan: &PlatformPlan, leg: usize, clock: f64) -> Option<f64> {
        match self {
            PlatformState::Interpolated(s) => Some(s.progress(clock)),
            _ => self.course().map(|course| course.progress(&plan.legs[leg])),
        }
    }

    /// The distance to the next waypoint, m, for platforms that have waypoints.
    pub fn distance_left(&self) -> Option<f64> {
        self.course().map(|c| c.to_target().length())
    }

    pub(crate) fn stream_mut(&mut self) -> Option<&mut StreamState> {
        match self {
            PlatformState::Stream(s) => Some(s),
            _ => None,
        }
    }

    /// Restores position, attitude, origin, target and velocity from `start`, the state at the beginning of
    /// the run. A multicopter's turn and the waypoint after the target stay (spec kinematics §1.6,
    /// repetitions).
    pub fn restore(&mut self, start: &PlatformState) {
        match (self, start) {
            (PlatformState::Multicopter(s), PlatformState::Multicopter(start)) => s.restore(start),
            (PlatformState::Linear(s), PlatformState::Linear(start)) => {
                *s = LinearPath { course: s.course.restored(&start.course), ..start.clone() };
            }
            (PlatformState::GroundVehicle(s), PlatformState::GroundVehicle(start)) => {
                s.course = s.course.restored(&start.course);
                s.attitude = start.attitude;
            }
            (s, start) => *s = start.clone(),
        }
    }

    fn course_mut(&mut self) -> Option<&mut Course> {
        match self {
            PlatformState::Linear(s) => Some(&mut s.course),
            PlatformState::GroundVehicle(s) => Some(&mut s.course),
            PlatformState::Multicopter(s) => Some(&mut s.course),
            _ => None,
        }
    }

    fn course(&self) -> Option<&Course> {
        match self {
            PlatformState::Linear(s) => Some(&s.course),
            PlatformState::GroundVehicle(s) => Some(&s.course),
            PlatformState::Multicopter(s) => Some(&s.course),
            _ => None,
        }
    }
}

/// Speed over the ground below which the direction of recorded positions is that of their noise, m/s.
const MIN_SPEED: f64 = 0.5;

/// A velocity (m/s), or 0 where it is so slow that its direction is doubtful.
fn unless_standing(velocity: DVec3) -> DVec3 {
    if horizontal(velocity).length() < MIN_SPEED { DVec3::ZERO } else { velocity }
}
