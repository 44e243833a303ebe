//! The plan of a flight: everything that is fixed before it starts.

use super::clock::WEEK_NS;
use super::leg::{PlannedLeg, TrajectoryLeg, check_spans, courses, trajectory_legs};
use super::navigation::Navigation;
use super::noise::PoseNoise;
use super::settings;
use crate::platform::{LegCourse, Motion, PlatformPlan, StreamPlan, TrajectoryTable, read_trajectories};
use crate::scanner::DevicePlan;
use vlscan_base::corrections::Corrections;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;
use vlscan_survey::{
    AngleConvention, Interpolated, Mount, NavigationErrors, PlatformKind, RotationSpec, Survey, named_as_in,
};

/// Choices in addition to the survey on which a flight depends.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightOptions {
    /// Seed of all noise.
    pub seed: u64,
    /// True if position and attitude of the platform have the noise that the survey asks for.
    pub platform_noise: bool,
    /// True if the positions of legs have the noise that the survey asks for.
    pub leg_noise: bool,
    /// Start of the GPS clock, ns of the week, unless a trajectory determines it.
    pub gps_start_ns: f64,
    /// Differences of platform, clock and optics from the reference.
    pub kinematics: Corrections,
    /// Errors of the reported pose.
    pub navigation: NavigationErrors,
    /// True if a leg on the ground where there is none is an error. The reference puts it at the height of
    /// the scene's centre (spec kinematics §2.7).
    pub needs_ground: bool,
}

impl Default for FlightOptions {
    /// The reference's kinematics, with seed 0 and GPS time 0.
    fn default() -> FlightOptions {
        FlightOptions {
            seed: 0,
            platform_noise: true,
            leg_noise: true,
            gps_start_ns: 0.0,
            kinematics: Corrections::NONE,
            navigation: NavigationErrors::NONE,
            needs_ground: false,
        }
    }
}

/// A survey ready to be flown: its legs, including those that interpolated trajectories add, and all
/// constants of platform and devices.
#[derive(Clone, Debug)]
pub struct FlightPlan {
    pub(super) platform: PlatformPlan,
    pub(super) legs: Vec<PlannedLeg>,
    /// Number of legs that are flown; see [`FlightPlan::leave_out_rest`].
    pub(super) flown: usize,
    pub(super) devices: Vec<DevicePlan>,
    pub(super) mount: Mount,
    pub(super) noise: PoseNoise,
    pub(super) navigation: Option<Navigation>,
    pub(super) kinematics: Corrections,
    pub(super) shift: DVec3,
    /// GPS time of the first step, ns of the week.
    pub(super) start_ns: f64,
    /// The step clock's period of the first leg, s.
    pub(super) clock_step: f64,
}

impl FlightPlan {
    /// Plans `survey` in the scene frame (world minus `shift`). `ground` returns the height of the lowest
    /// ground surface at x and y, all in the scene frame. Also returns the warnings.
    ///
    /// # Errors
    /// [`Error::Input`] with all problems: invalid numbers, legs that cannot end, malformed trajectories;
    /// [`Error::Io`] for trajectory files that cannot be read.
    pub fn new(
        survey: &Survey,
        shift: DVec3,
        ground: &dyn Fn(f64, f64) -> Option<f64>,
        options: &FlightOptions,
    ) -> Result<(FlightPlan, Diagnostics)> {
        let mut problems = Diagnostics::default();
        if !settings::check_numbers(survey, &mut problems) {
            return Err(Error::Input(Box::new(problems)));
        }
        let kinematics = options.kinematics;
        let kind = &survey.platform.kind;
        let mut start_ns = options.gps_start_ns;
        let noise_seed = options.leg_noise.then_some(options.seed);
        let mut courses = courses(survey, shift, ground, (noise_seed, options.needs_ground), &mut problems);
        let mut legs: Vec<PlannedLeg> =
            survey.legs.iter().map(|l| PlannedLeg::new(l, l.scanner.clone())).collect();
        let motion = match kind {
            PlatformKind::Static => Motion::Static,
            PlatformKind::LinearPath => Motion::Linear,
            PlatformKind::GroundVehicle { drag } => Motion::GroundVehicle { drag: *drag },
            PlatformKind::Multicopter(parameters) => Motion::multicopter(parameters, &courses, &kinematics),
            PlatformKind::Interpolated(i) => {
                let Some(table) = load_table(i, shift, &kinematics, &mut problems)? else {
                    return Err(Error::Input(Box::new(problems)));
                };
                check_spans(survey, i, &table, &mut problems);
                let added = trajectory_legs(survey, &courses, &table);
                (legs, courses) =
                    added.into_iter().map(|TrajectoryLeg { leg, course }| (leg, course)).unzip();
                if i.sync_gps_time {
                    start_ns = synchronised_start(survey, &table);
                    if kinematics.legs_on_time {
                        set_leg_starts(&mut legs, &courses, &table);
                    }
                }
                Motion::Interpolated(table)
            }
            PlatformKind::Stream(s) => {
                let scanner = &survey.legs[0].scanner;
                let times = scanner.pulse_times.clone();
                Motion::Stream(StreamPlan {
                    frequency: scanner.pulse_freq,
                    times,
                    max_gap: s.max_gap,
                    keeps_adjusted_times: kinematics.adjusted_times,
                })
            }
        };
        let rotation_spec = match kind {
            PlatformKind::Interpolated(i) => i.rotation_spec,
            PlatformKind::Stream(s) => {
                s.rotation.map_or(RotationSpec::Arinc705, AngleConvention::rotation_spec)
            }
            _ => RotationSpec::Canonical,
        };
        let first_freq = survey.legs[0].scanner.pulse_rate();
        for leg in &mut legs {
            let own = leg.settings.pulse_rate();
            let is_own = kinematics.leg_pulse_rate || leg.times.is_some();
            leg.frequency = if is_own { own } else { first_freq };
            leg.increment_ns = 1e9 * (1.0 / leg.frequency);
        }
        let noise = if options.platform_noise { survey.platform.noise.clone() } else { Default::default() };
        let mut plan = FlightPlan {
            platform: PlatformPlan { motion, legs: courses, rotation_spec, kinematics },
            flown: legs.len(),
            legs,
            devices: survey.scanner.devices.iter().map(|d| DevicePlan::new(d, kinematics)).collect(),
            mount: survey.platform.mount,
            noise: PoseNoise::new(&noise, options.seed),
            navigation: options.navigation.any().then(|| {
                let (arm, boresight) = match kind {
                    PlatformKind::Stream(s) => (s.lever_arm, s.boresight),
                    _ => (DVec3::ZERO, [0.0; 3]),
                };
                Navigation::new(options.navigation, options.seed, arm, boresight)
            }),
            kinematics,
            shift,
            start_ns,
            clock_step: 1.0 / first_freq,
        };
        plan.validate(&mut problems);
        Ok((plan, problems.finish(false)?))
    }

    /// Marks the legs without motion and checks all legs.
    fn validate(&mut self, problems: &mut Diagnostics) {
        let is_static = matches!(self.platform.motion, Motion::Static);
        for leg in &mut self.legs {
            leg.still = is_static && self.devices[0].head_rate(leg.settings.head_rate) == 0.0;
            settings::check_firing(leg, &self.devices, problems);
        }
        for (i, leg) in self.legs.iter().enumerate() {
            settings::check_optics(leg, &self.devices, self.planned_seconds(i), problems);
            settings::check_pulse_times(leg, &self.platform, self.planned_seconds(i), problems);
            settings::check_reference(leg, &self.devices, &self.kinematics, problems);
            if let Some((reason, help)) =
                settings::why_endless(i, &self.legs, &self.platform, &self.devices[0])
            {
                let message = format!("leg {} never ends: {reason}", leg.number);
                problems.error(leg.place.clone(), message).help(named_as_in(leg.place.as_ref(), help));
            }
        }
        for pair in self.legs.windows(2) {
            settings::check_shorter_periods([&pair[0], &pair[1]], &self.devices, &self.kinematics, problems);
        }
        if self.platform.has_waypoints() {
            self.check_waypoints(problems);
        }
    }

    fn check_waypoints(&self, problems: &mut Diagnostics) {
        if let [leg] = self.legs.as_slice() {
            let message = "a moving platform with a single leg flies towards the centre of the scene";
            problems.warn(leg.place.clone(), message).help("add a leg at the platform's destination");
        }
        for (pair, leg) in self.platform.legs.windows(2).zip(&self.legs) {
            let way = pair[1].position - pair[0].position;
            if way.x == 0.0 && way.y == 0.0 && way.z != 0.0 {
                let message = format!(
                    "leg {}: the next waypoint is straight above or below; the platform keeps its heading",
                    leg.number
                );
                problems.warn(leg.place.clone(), message);
            }
        }
    }

    /// Duration of leg `leg` of the plan, s, as far as its settings determine it: by its duration, its part
    /// of a trajectory, the straight way to its end or the turn of the head. `None` for streams of poses.
    pub(super) fn planned_seconds(&self, leg: usize) -> Option<f64> {
        let (planned, course) = (&self.legs[leg], &self.platform.legs[leg]);
        let settings = &planned.settings;
        let longest = (planned.max_duration > 0.0).then_some(planned.max_duration);
        let rate = self.devices[0].head_rate(settings.head_rate);
        let turn = (rate != 0.0).then(|| ((settings.head_stop - settings.head_start) / rate).max(0.0));
        let way = match (&self.platform.motion, course.span) {
            (Motion::Stream(_), _) => None,
            (_, Some(span)) => Some(span.end - span.start),
            (Motion::Static, _) => turn,
            _ => {
                let next = self.platform.legs.get(leg + 1);
                let way = next.map_or(0.0, |next| (next.position - course.position).length());
                (course.speed > 0.0).then(|| (way / course.speed).max(turn.unwrap_or(0.0)))
            }
        };
        [longest, way].into_iter().flatten().reduce(f64::min)
    }

    /// Ends the flight with the last leg that has a pulse or a way: inactive legs at its end in which the
    /// platform stands are not flown, whatever their maximum duration and the turn of their head. The clocks
    /// of a flight that is [repeated](super::FlightState::repeat) count these legs, which must stay there.
    pub fn leave_out_rest(&mut self) {
        let courses = &self.platform.legs;
        let stands = |leg: usize| match self.platform.motion {
            Motion::Static => true,
            // Without sharp corners it flies on with the velocity of the leg before, as in the reference.
            Motion::Linear if self.kinematics.sharp_corners && courses[leg].speed <= 0.0 => true,
            // Equal waypoints have equal bits after the shift and the ground. Other legs are flown, however
            // short, and so are those that the noise of legs displaces.
            _ if self.platform.has_waypoints() => {
                courses.get(leg + 1).is_none_or(|next| next.position == courses[leg].position)
            }
            _ => false,
        };
        let is_rest = |(index, leg): &(usize, &PlannedLeg)| !leg.settings.active && stands(*index);
        let rest = self.legs.iter().enumerate().rev().take_while(is_rest).count();
        self.flown = (self.legs.len() - rest).max(1);
    }

    /// Ends the flight with the same leg as another plan of it.
    pub fn end_as(&mut self, other: &FlightPlan) {
        self.flown = other.flown.min(self.legs.len());
    }

    /// Number of legs to be flown, including added ones.
    pub fn leg_count(&self) -> usize {
        self.flown
    }

    /// The recorded poses of an interpolated platform.
    pub fn trajectory_table(&self) -> Option<&TrajectoryTable> {
        self.platform.table()
    }

    /// True if the platform follows a stream of poses.
    pub fn is_stream(&self) -> bool {
        self.platform.is_stream()
    }
}

/// Table of an interpolated platform in the scene frame, corrected by `kinematics`; `None` if its files have
/// problems.
fn load_table(
    settings: &Interpolated,
    shift: DVec3,
    kinematics: &Corrections,
    problems: &mut Diagnostics,
) -> Result<Option<TrajectoryTable>> {
    let Some(table) = read_trajectories(settings, problems)? else { return Ok(None) };
    let mut table = table.shifted(shift);
    if kinematics.heading_along_leg && settings.position_only {
        table = table.heading_along(match settings.rotation_spec {
            RotationSpec::Arinc705 => 1.0,
            RotationSpec::Canonical => -1.0,
        });
    }
    if kinematics.shortest_turns {
        table = table.unwrapped();
    }
    Ok(Some(table))
}

/// GPS time of a trajectory's start, ns of the week (spec kinematics §2.6).
fn synchronised_start(survey: &Survey, table: &TrajectoryTable) -> f64 {
    let start = survey.legs[0].platform.trajectory.as_ref().and_then(|t| t.start);
    week_ns(start.map_or(table.first_time(), |t| (t - table.first_time()) + table.first_time()))
}

fn set_leg_starts(legs: &mut [PlannedLeg], courses: &[LegCourse], table: &TrajectoryTable) {
    for (leg, course) in legs.iter_mut().zip(courses) {
        leg.start_ns = course.span.map(|span| week_ns(span.start + table.first_time()));
    }
}

/// Seconds as nanoseconds of the week; only times outside of a week are reduced, so that others do not round.
fn week_ns(seconds: f64) -> f64 {
    let ns = seconds * 1e9;
    if (0.0..=WEEK_NS).contains(&ns) { ns } else { seconds.rem_euclid(WEEK_NS * 1e-9) * 1e9 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::testing::*;
    use vlscan_geom::unit;

    fn flight(points: &[[f64; 3]]) -> Survey {
        let legs = points.iter().map(|p| leg(*p, 30.0, |_| {})).collect();
        survey(PlatformKind::LinearPath, Mount::IDENTITY, straight(), legs)
    }

    #[test]
    fn positions_are_shifted_then_grounded_then_displaced() {
        let mut s = flight(&[[110.0, 20.0, 7.0], [120.0, 20.0, 7.0], [999.0, 20.0, 7.0]]);
        s.legs.iter_mut().for_each(|l| l.platform.on_ground = true);
        s.leg_offset = Some((0.0, 0.5));
        let shift = DVec3::new(100.0, 20.0, 5.0);
        let ground = |x: f64, _: f64| (x < 500.0).then_some(x * 0.1);
        let plan = |noise: bool, seed: u64| {
            let options = FlightOptions { leg_noise: noise, seed, ..Default::default() };
            FlightPlan::new(&s, shift, &ground, &options).unwrap()
        };
        let (quiet, warnings) = plan(false, 1);
        let at = |p: &FlightPlan, i: usize| p.platform.legs[i].position;
        assert_eq!(at(&quiet, 0), DVec3::new(10.0, 0.0, 1.0));
        assert_eq!(at(&quiet, 2), DVec3::new(899.0, 0.0, 0.0));
        assert!(warnings.text().contains("leg 2: no ground at x 999"));
        let (noisy, _) = plan(true, 1);
        assert_ne!(at(&noisy, 0), at(&quiet, 0));
        assert_eq!(at(&noisy, 1), at(&plan(true, 1).0, 1));
        assert_ne!(at(&noisy, 1), at(&plan(true, 2).0, 1));
    }

    #[test]
    fn a_waypoint_straight_above_keeps_the_heading_with_a_warning() {
        let s = flight(&[[0.0, 0.0, 0.0], [10.0, 10.0, 0.0], [10.0, 10.0, 50.0], [20.0, 10.0, 50.0]]);
        let (_, warnings) = plan_of(&s).unwrap();
        assert!(warnings.text().contains("leg 1: the next waypoint is straight above"));
        let stacked = flight(&[[0.0, 0.0, 0.0], [0.0, 0.0, 50.0], [20.0, 10.0, 50.0]]);
        for pulse in fly(&stacked).iter().flat_map(|l| &l.pulses) {
            assert!(pulse.attitude.forward().is_finite() && pulse.origin.is_finite());
        }
    }

    #[test]
    fn a_single_moving_leg_heads_for_the_centre_with_a_warning() {
        let s = flight(&[[30.0, 0.0, 0.0]]);
        let (_, warnings) = plan_of(&s).unwrap();
        assert!(warnings.text().contains("single leg"));
        let flown = fly(&s);
        let last = flown[0].pulses.last().unwrap();
        assert!(last.origin.length() < 1.0 && (last.attitude.forward() - unit(-DVec3::X)).length() < 1e-6);
    }

    #[test]
    fn inactive_legs_without_a_way_are_left_out_at_the_end_of_a_flight() {
        let steps = |plan: &FlightPlan| fly_plan(plan).iter().map(|leg| leg.steps).collect::<Vec<_>>();
        // 9 m at 30 m/s, then half a second at the waypoint, where the head would turn for 10 s.
        let mut s = flight(&[[0.0, 0.0, 50.0], [9.0, 0.0, 50.0]]);
        turn_head(&mut s.legs[1], 36.0, 360.0);
        (s.legs[1].scanner.active, s.legs[1].scanner.max_duration) = (false, Some(0.5));
        let (whole, _) = plan_of(&s).unwrap();
        let mut short = whole.clone();
        short.leave_out_rest();
        let [both, first] = [&whole, &short].map(steps);
        assert_eq!((both.len(), both[1], first), (2, 50, both[..1].to_vec()));
        assert_eq!((whole.leg_count(), short.leg_count()), (2, 1));
        let mut again = whole.clone();
        again.end_as(&short);
        assert_eq!(again.leg_count(), 1);
        // An inactive leg with a way is flown, and so is one between others.
        let mut home = flight(&[[0.0, 0.0, 50.0], [9.0, 0.0, 50.0], [9.0, 0.0, 50.0], [0.0, 0.0, 50.0]]);
        home.legs[1..].iter_mut().for_each(|leg| leg.scanner.active = false);
        let (mut plan, _) = plan_of(&home).unwrap();
        plan.leave_out_rest();
        assert_eq!((plan.leg_count(), steps(&plan).len()), (3, 3));
        // A platform without speed stands, unless it flies on as in the reference.
        home.legs.remove(1);
        (home.legs[1].platform.speed, home.legs[1].scanner.max_duration) = (0.0, Some(0.5));
        for (sharp_corners, expected) in [(false, 2), (true, 1)] {
            let kinematics = Corrections { sharp_corners, ..Corrections::NONE };
            let mut plan = plan_with(&home, FlightOptions { kinematics, ..options() });
            plan.leave_out_rest();
            assert_eq!(plan.leg_count(), expected);
        }
        // A tripod stands in all legs; the first leg is always flown.
        home.legs.insert(1, home.legs[1].clone());
        home.platform.kind = PlatformKind::Static;
        home.legs.iter_mut().for_each(|leg| leg.scanner.max_duration = Some(0.5));
        for (active, expected) in [([true, false, false, false], 1), ([false; 4], 1), ([true; 4], 4)] {
            home.legs.iter_mut().zip(active).for_each(|(leg, active)| leg.scanner.active = active);
            let (mut plan, _) = plan_of(&home).unwrap();
            plan.leave_out_rest();
            assert_eq!(plan.leg_count(), expected);
        }
    }

    #[test]
    fn conic_deflectors_turn_as_asked() {
        let mut s = flight(&[[0.0; 3], [100.0, 0.0, 0.0]]);
        s.scanner.devices[0].deflector = vlscan_survey::Deflector::Conic;
        s.scanner.devices[0].scan_freq = (0.0, 25.0);
        s.legs.iter_mut().for_each(|l| l.scanner.scan_freq = 5.0);
        for (as_asked, period) in [(false, 4), (true, 20)] {
            let kinematics = Corrections { conic_at_leg_frequency: as_asked, ..Corrections::NONE };
            let plan = plan_with(&s, FlightOptions { kinematics, ..Default::default() });
            let pulses = fly_plan(&plan).remove(0).pulses;
            let beam = |i: usize| pulses[i].attitude.forward();
            assert!((beam(0) - beam(period)).length() < 1e-9 && (beam(0) - beam(period / 2)).length() > 0.1);
        }
    }
}
