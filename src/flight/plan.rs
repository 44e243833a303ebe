//! What of a flight is fixed before it starts.

use super::clock::WEEK_NS;
use super::navigation::Navigation;
use super::noise::{PoseNoise, leg_offset};
use super::settings;
use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use crate::geom::DVec3;
use crate::platform::{LegCourse, PlatformPlan, Span, TrajectoryTable, read_trajectories};
use crate::scanner::DevicePlan;
use crate::survey::{
    AngleConvention, Interpolated, Kinematics, Leg, LegTrajectory, Mount, NavigationErrors, PlatformKind,
    RotationSpec, ScannerSettings, Survey,
};

/// What a run decides about its flight.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightOptions {
    /// Seed of all noise.
    pub seed: u64,
    /// Draw the platform's noise.
    pub platform_noise: bool,
    /// Draw the random offsets of legs that the survey asks for.
    pub leg_noise: bool,
    /// Start of the GPS clock, ns of the week; trajectories may replace it.
    pub gps_start_ns: f64,
    /// Where platform, clock and optics depart from the reference's.
    pub kinematics: Kinematics,
    /// What the navigation system gets wrong.
    pub navigation: NavigationErrors,
}

impl Default for FlightOptions {
    /// What the reference does, seed 0, GPS time 0.
    fn default() -> FlightOptions {
        FlightOptions {
            seed: 0,
            platform_noise: true,
            leg_noise: true,
            gps_start_ns: 0.0,
            kinematics: Kinematics::HELIOS,
            navigation: NavigationErrors::NONE,
        }
    }
}

/// A survey made ready to fly: its legs, those added to interpolated trajectories included, and all constants of platform
/// and devices.
#[derive(Clone, Debug)]
pub struct FlightPlan {
    pub(super) platform: PlatformPlan,
    pub(super) legs: Vec<PlannedLeg>,
    pub(super) devices: Vec<DevicePlan>,
    pub(super) mount: Mount,
    pub(super) noise: PoseNoise,
    pub(super) navigation: Option<Navigation>,
    pub(super) kinematics: Kinematics,
    pub(super) shift: DVec3,
    /// GPS time of the first step, ns of the week.
    pub(super) start_ns: f64,
    /// The step clock's period of the first leg, s.
    pub(super) clock_step: f64,
}

/// One leg of a plan.
#[derive(Clone, Debug)]
pub(super) struct PlannedLeg {
    /// The survey's leg.
    pub number: u32,
    pub place: Option<Place>,
    pub settings: ScannerSettings,
    /// Nothing moves, so only the greatest duration ends the leg.
    pub still: bool,
    /// s; 0 = none.
    pub max_duration: f64,
    /// Steps per second of both clocks, and the GPS clock's period, ns: those of the first leg throughout, unless
    /// [`Kinematics::leg_pulse_rate`] is on.
    pub frequency: f64,
    pub increment_ns: f64,
    /// GPS time at which the leg begins, ns of the week, where its trajectory says so.
    pub start_ns: Option<f64>,
    /// Spacing of trajectory samples, ns; 0 = none.
    pub sample_interval_ns: f64,
    /// Steps of the optics before the first pulse.
    pub warmup: u64,
}

impl FlightPlan {
    /// Plans `survey` in the scene frame (world minus `shift`). `ground` gives the scene-frame height of the lowest ground
    /// surface at a scene-frame x, y. Returns the warnings too.
    ///
    /// # Errors
    /// [`Error::Input`] with all problems: numbers that cannot be flown, legs that cannot end, malformed trajectories;
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
        let courses = courses(survey, shift, ground, options, &mut problems);
        let devices: Vec<DevicePlan> =
            survey.scanner.devices.iter().map(|d| DevicePlan::new(d, options.kinematics)).collect();
        let kinematics = options.kinematics;
        let mut start_ns = options.gps_start_ns;
        let mut legs: Vec<PlannedLeg> =
            survey.legs.iter().map(|l| PlannedLeg::new(l, l.scanner.clone())).collect();
        let kind = &survey.platform.kind;
        let platform = match kind {
            PlatformKind::Static => PlatformPlan::fixed(courses),
            PlatformKind::LinearPath => PlatformPlan::linear(courses),
            PlatformKind::GroundVehicle { drag } => PlatformPlan::ground_vehicle(*drag, courses),
            PlatformKind::Multicopter(parameters) => {
                PlatformPlan::multicopter(parameters.clone(), courses, kinematics)
            }
            PlatformKind::Interpolated(i) => {
                let Some(table) = read_trajectories(i, &mut problems)? else {
                    return Err(Error::Input(Box::new(problems)));
                };
                let mut table = table.shifted(shift);
                if kinematics.heading_along_leg && i.position_only {
                    table = table.heading_along(match i.rotation_spec {
                        RotationSpec::Arinc705 => 1.0,
                        RotationSpec::Canonical => -1.0,
                    });
                }
                if kinematics.shortest_turns {
                    table = table.unwrapped();
                }
                if i.sync_gps_time {
                    start_ns = synchronised_start(survey, &table);
                }
                warn_about_spans(survey, i, &table, &mut problems);
                let stages = stages(survey, &courses, &table);
                legs = stages.iter().map(|s| s.planned.clone()).collect();
                if i.sync_gps_time && kinematics.legs_on_time {
                    for (leg, stage) in legs.iter_mut().zip(&stages) {
                        leg.start_ns = stage.course.span.map(|s| week_ns(s.start + table.first_time()));
                    }
                }
                PlatformPlan::interpolated(
                    table,
                    i.rotation_spec,
                    stages.into_iter().map(|s| s.course).collect(),
                )
            }
            PlatformKind::Stream(s) => PlatformPlan::stream(
                survey.legs[0].scanner.pulse_freq,
                s.max_gap,
                s.rotation.map_or(RotationSpec::Arinc705, AngleConvention::rotation_spec),
                courses,
            ),
        };
        let noise = if options.platform_noise { survey.platform.noise.clone() } else { Default::default() };
        let first_freq = f64::from(survey.legs[0].scanner.pulse_freq);
        for leg in &mut legs {
            let own = kinematics.leg_pulse_rate;
            leg.frequency = if own { f64::from(leg.settings.pulse_freq) } else { first_freq };
            leg.increment_ns = 1e9 * (1.0 / leg.frequency);
        }
        let mut plan = FlightPlan {
            platform: platform.with(kinematics),
            legs,
            devices,
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
        plan.settle(&mut problems);
        Ok((plan, problems.finish(false)?))
    }

    /// Marks the still legs and checks all of them.
    fn settle(&mut self, problems: &mut Diagnostics) {
        for leg in &mut self.legs {
            leg.still = self.platform.is_static() && self.devices[0].head_rate(leg.settings.head_rate) == 0.0;
        }
        for (i, leg) in self.legs.iter().enumerate() {
            settings::check_optics(leg, &self.devices, problems);
            if let Some((reason, help)) =
                settings::why_endless(i, &self.legs, &self.platform, &self.devices[0])
            {
                let message = format!("leg {} never ends: {reason}", leg.number);
                problems.error(leg.place.clone(), message).help(help);
            }
        }
        self.warn_about_course(problems);
    }

    fn warn_about_course(&self, problems: &mut Diagnostics) {
        if !self.platform.heads_for_waypoints() {
            return;
        }
        let courses = self.platform.legs();
        if let [leg] = self.legs.as_slice() {
            problems
                .warn(
                    leg.place.clone(),
                    "a moving platform with a single leg heads for the centre of the scene",
                )
                .help("add a leg where the platform shall go to");
        }
        for (pair, leg) in courses.windows(2).zip(&self.legs) {
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

    /// Number of legs to be flown, added ones included.
    pub fn leg_count(&self) -> usize {
        self.legs.len()
    }

    /// The survey's number of leg `leg`.
    pub fn leg_number(&self, leg: usize) -> Option<u32> {
        self.legs.get(leg).map(|l| l.number)
    }

    /// Number of devices.
    pub fn devices(&self) -> usize {
        self.devices.len()
    }

    /// GPS time of the first step, ns of the week.
    pub fn start_ns(&self) -> f64 {
        self.start_ns
    }

    /// Whether the platform follows a stream of poses.
    pub fn follows_stream(&self) -> bool {
        self.platform.is_stream()
    }
}

impl PlannedLeg {
    fn new(leg: &Leg, settings: ScannerSettings) -> PlannedLeg {
        PlannedLeg {
            number: leg.number,
            place: leg.place.clone(),
            still: false,
            max_duration: settings.max_duration.filter(|d| *d > 0.0).unwrap_or(0.0),
            frequency: f64::from(settings.pulse_freq),
            increment_ns: 0.0,
            start_ns: None,
            sample_interval_ns: settings.trajectory_interval * 1e9,
            // Half away from zero, as `round` does.
            warmup: (settings.warmup.max(0.0) * f64::from(settings.pulse_freq)).round() as u64,
            settings,
        }
    }
}

/// Where the legs are in the scene frame: shifted, put on the ground, displaced at random, in this order.
fn courses(
    survey: &Survey,
    shift: DVec3,
    ground: &dyn Fn(f64, f64) -> Option<f64>,
    options: &FlightOptions,
    problems: &mut Diagnostics,
) -> Vec<LegCourse> {
    let place = |leg: &Leg| {
        let mut position = leg.platform.position - shift;
        if leg.platform.on_ground {
            position.z = ground(position.x, position.y).unwrap_or_else(|| {
                let p = leg.platform.position;
                let message = format!(
                    "leg {}: no ground at x {} y {}; the leg is put at the height of the scene's centre, z {}",
                    leg.number, p.x, p.y, shift.z
                );
                problems.warn(leg.place.clone(), message);
                0.0
            });
        }
        if let Some((mean, stdev)) = survey.leg_offset.filter(|_| options.leg_noise) {
            position += leg_offset(options.seed, leg.number, mean, stdev);
        }
        course(leg, position)
    };
    survey.legs.iter().map(place).collect()
}

fn course(leg: &Leg, position: DVec3) -> LegCourse {
    let p = &leg.platform;
    let frequency = f64::from(leg.scanner.pulse_freq);
    LegCourse {
        position,
        frequency,
        speed: p.speed,
        step_length: p.speed / frequency,
        stop_and_turn: p.stop_and_turn && !p.smooth_turn,
        smooth_turn: p.smooth_turn,
        slowdown: p.slowdown,
        yaw_at_departure: p.yaw_at_departure,
        span: None,
    }
}

/// One leg of an interpolated platform.
struct Stage {
    planned: PlannedLeg,
    course: LegCourse,
}

/// Each leg of the survey and the inactive ones that teleports and stops add (spec kinematics §2.6).
fn stages(survey: &Survey, courses: &[LegCourse], table: &TrajectoryTable) -> Vec<Stage> {
    let mut stages = Vec::with_capacity(survey.legs.len() * 2);
    for (leg, course) in survey.legs.iter().zip(courses) {
        let span = span(leg.platform.trajectory.as_ref(), table);
        let resting = ScannerSettings {
            active: false,
            head_rate: 0.0,
            head_start: 0.0,
            head_stop: 0.0,
            max_duration: None,
            warmup: 0.0,
            ..leg.scanner.clone()
        };
        let mut add = |settings: ScannerSettings, time: f64, span: Option<Span>| {
            let course = LegCourse { position: table.position_at(time), span, ..*course };
            stages.push(Stage { planned: PlannedLeg::new(leg, settings), course });
        };
        if leg.platform.trajectory.as_ref().is_some_and(|t| t.teleport) {
            add(resting.clone(), span.start, None);
        }
        add(leg.scanner.clone(), span.start, Some(span));
        add(resting, span.end, None);
    }
    stages
}

/// The flown stretch in seconds after the table's first row; what the leg leaves open is the table's first or last time.
fn span(trajectory: Option<&LegTrajectory>, table: &TrajectoryTable) -> Span {
    let first = table.first_time();
    Span {
        start: trajectory.and_then(|t| t.start).map_or(0.0, |t| t - first),
        end: trajectory.and_then(|t| t.end).map_or(table.duration(), |t| t - first),
    }
}

/// GPS time of a trajectory's start, ns of the week (spec kinematics §2.6). Times beyond a week lose their whole weeks.
fn synchronised_start(survey: &Survey, table: &TrajectoryTable) -> f64 {
    let start = survey.legs[0].platform.trajectory.as_ref().and_then(|t| t.start);
    week_ns(start.map_or(table.first_time(), |t| (t - table.first_time()) + table.first_time()))
}

/// Nanoseconds of the week; seconds beyond a week lose their whole weeks.
fn week_ns(seconds: f64) -> f64 {
    let ns = seconds * 1e9;
    if (0.0..=WEEK_NS).contains(&ns) { ns } else { seconds.rem_euclid(WEEK_NS * 1e-9) * 1e9 }
}

fn warn_about_spans(
    survey: &Survey,
    settings: &Interpolated,
    table: &TrajectoryTable,
    problems: &mut Diagnostics,
) {
    for leg in &survey.legs {
        let span = span(leg.platform.trajectory.as_ref(), table);
        let world = |t: f64| t + table.first_time();
        let (start, end) = (world(span.start), world(span.end));
        if !(span.start.is_finite() && span.end.is_finite()) {
            let message = format!("leg {}: from {start} s to {end} s is no stretch of time", leg.number);
            problems.error(leg.place.clone(), message);
        } else if span.end <= span.start {
            let message = format!("leg {}: ends at {end} s, not after its start at {start} s", leg.number);
            problems.warn(leg.place.clone(), message);
        } else if span.start < 0.0 || span.end > table.duration() {
            let message = format!(
                "leg {}: {start} s to {end} s leaves the trajectory ({} s to {} s); its ends are prolonged",
                leg.number,
                world(0.0),
                world(table.duration())
            );
            problems.warn(leg.place.clone(), message);
        }
        let open = leg.platform.trajectory.as_ref().is_none_or(|t| t.start.is_none() || t.end.is_none());
        if settings.files.len() > 1 && open {
            let message = format!(
                "leg {}: without tStart and tEnd it flies from {start} s to {end} s of all {} files together",
                leg.number,
                settings.files.len()
            );
            problems.warn(leg.place.clone(), message);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::testing::*;
    use crate::geom::unit;

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
        let at = |p: &FlightPlan, i: usize| p.platform.legs()[i].position;
        assert_eq!(at(&quiet, 0), DVec3::new(10.0, 0.0, 1.0));
        assert_eq!(at(&quiet, 2), DVec3::new(899.0, 0.0, 0.0));
        assert!(warnings.render(false).contains("leg 2: no ground at x 999"));
        let (noisy, _) = plan(true, 1);
        assert_ne!(at(&noisy, 0), at(&quiet, 0));
        assert_eq!(at(&noisy, 1), at(&plan(true, 1).0, 1));
        assert_ne!(at(&noisy, 1), at(&plan(true, 2).0, 1));
    }

    #[test]
    fn a_waypoint_straight_above_keeps_the_heading_with_a_warning() {
        let s = flight(&[[0.0, 0.0, 0.0], [10.0, 10.0, 0.0], [10.0, 10.0, 50.0], [20.0, 10.0, 50.0]]);
        let (_, warnings) = plan_of(&s).unwrap();
        assert!(warnings.render(false).contains("leg 1: the next waypoint is straight above"));
        let stacked = flight(&[[0.0, 0.0, 0.0], [0.0, 0.0, 50.0], [20.0, 10.0, 50.0]]);
        for pulse in fly(&stacked).iter().flat_map(|l| &l.pulses) {
            assert!(pulse.attitude.forward().is_finite() && pulse.origin.is_finite());
        }
    }

    #[test]
    fn a_single_moving_leg_heads_for_the_centre_with_a_warning() {
        let s = flight(&[[30.0, 0.0, 0.0]]);
        let (_, warnings) = plan_of(&s).unwrap();
        assert!(warnings.render(false).contains("single leg"));
        let flown = fly(&s);
        let last = flown[0].pulses.last().unwrap();
        assert!(last.origin.length() < 1.0 && (last.attitude.forward() - unit(-DVec3::X)).length() < 1e-6);
    }

    #[test]
    fn conic_deflectors_turn_as_asked() {
        let mut s = flight(&[[0.0; 3], [100.0, 0.0, 0.0]]);
        s.scanner.devices[0].deflector = crate::survey::Deflector::Conic;
        s.scanner.devices[0].scan_freq = (0.0, 25.0);
        s.legs.iter_mut().for_each(|l| l.scanner.scan_freq = 5.0);
        for (as_asked, period) in [(false, 4), (true, 20)] {
            let kinematics = Kinematics { conic_at_leg_frequency: as_asked, ..Kinematics::HELIOS };
            let options = FlightOptions { kinematics, ..Default::default() };
            let (plan, _) = FlightPlan::new(&s, DVec3::ZERO, &|_, _| None, &options).unwrap();
            let pulses =
                fly_plan(&plan, &mut crate::flight::FlightState::start(&plan)).unwrap().remove(0).pulses;
            let beam = |i: usize| pulses[i].attitude.forward();
            assert!((beam(0) - beam(period)).length() < 1e-9 && (beam(0) - beam(period / 2)).length() > 0.1);
        }
    }
}
