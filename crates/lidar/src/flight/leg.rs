//! The legs of a flight: settings, positions, and the legs that a recorded trajectory adds.

use super::noise::leg_offset;
use crate::platform::{LegCourse, MAX_FLOWN_GAP, Span, TrajectoryTable};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::quantity::{MAX_DURATION, number};
use vlscan_geom::DVec3;
use vlscan_survey::{Interpolated, Leg, LegTrajectory, Mount, PulseTimes, ScannerSettings, Survey};

#[derive(Clone, Debug)]
pub(super) struct PlannedLeg {
    /// Number of the leg in the survey.
    pub number: u32,
    pub place: Option<Place>,
    pub settings: ScannerSettings,
    /// When the steps are taken, in place of a constant rate.
    pub times: Option<PulseTimes>,
    /// Mount of the scanner, if it is not that of the platform.
    pub mount: Option<Mount>,
    /// The pulse period is too short for the firing offsets of the channels.
    pub fires_at_once: bool,
    /// Nothing moves, so that only the maximum duration ends the leg.
    pub still: bool,
    /// Maximum duration, s; 0 = none.
    pub max_duration: f64,
    /// Steps per second of the step clock, and the period of the GPS clock, ns: the first leg's for all legs,
    /// unless [`Corrections::leg_pulse_rate`](vlscan_base::corrections::Corrections::leg_pulse_rate) is on.
    pub frequency: f64,
    pub increment_ns: f64,
    /// GPS time at which the leg starts, ns of the week, where its trajectory determines it.
    pub start_ns: Option<f64>,
    /// Interval of trajectory samples, ns; 0 = none.
    pub sample_interval_ns: f64,
    /// Steps of the optics before the first pulse.
    pub warmup: u64,
}

impl PlannedLeg {
    pub fn new(leg: &Leg, settings: ScannerSettings) -> PlannedLeg {
        PlannedLeg {
            number: leg.number,
            place: leg.place.clone(),
            mount: leg.platform.mount,
            fires_at_once: false,
            still: false,
            max_duration: settings.max_duration.filter(|d| *d > 0.0).unwrap_or(0.0),
            times: settings.pulse_times.clone(),
            frequency: settings.pulse_rate(),
            increment_ns: 0.0,
            start_ns: None,
            sample_interval_ns: settings.trajectory_interval * 1e9,
            warmup: (settings.warmup.max(0.0) * settings.pulse_rate()).round() as u64,
            settings,
        }
    }
}

impl PlannedLeg {
    /// True if the scanner fires in step `number` of its pulse times; always without them.
    #[inline]
    pub fn fires(&self, number: u64) -> bool {
        self.times.as_ref().and_then(PulseTimes::count).is_none_or(|count| number < count)
    }
}

/// Advice for legs without ground.
const NO_GROUND_HELP: &str = "ground is every surface whose material has `helios_isGround true` (`vlscan \
                              scene info` lists them); give the terrain such a material, or give the leg a \
                              height instead of on_ground";

/// Courses of the legs in the scene frame: shifted, dropped to the ground and, given a seed, displaced at
/// random. Where there is no ground that is an error if the ground is needed, and otherwise the height of the
/// scene's centre counts.
pub(super) fn courses(
    survey: &Survey,
    shift: DVec3,
    ground: &dyn Fn(f64, f64) -> Option<f64>,
    (noise_seed, needs_ground): (Option<u64>, bool),
    problems: &mut Diagnostics,
) -> Vec<LegCourse> {
    let course = |leg: &Leg| {
        let p = &leg.platform;
        let mut position = p.position - shift;
        if p.on_ground {
            position.z = ground(position.x, position.y).unwrap_or_else(|| {
                let which = format!(
                    "leg {}: no ground at x {} y {}",
                    leg.number,
                    number(p.position.x),
                    number(p.position.y)
                );
                if needs_ground {
                    problems.error(leg.place.clone(), which).help(NO_GROUND_HELP);
                } else {
                    let message = format!(
                        "{which}; the leg is put at the height of the scene's centre, z {}",
                        number(shift.z)
                    );
                    problems.warn(leg.place.clone(), message).help(NO_GROUND_HELP);
                }
                0.0
            });
        }
        if let (Some((mean, stdev)), Some(seed)) = (survey.leg_offset, noise_seed) {
            position += leg_offset(seed, leg.number, mean, stdev);
        }
        let frequency = leg.scanner.pulse_rate();
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
    };
    survey.legs.iter().map(course).collect()
}

pub(super) struct TrajectoryLeg {
    pub leg: PlannedLeg,
    pub course: LegCourse,
}

/// The legs of the survey, and the inactive ones that teleports and stops add (spec kinematics §2.6).
pub(super) fn trajectory_legs(
    survey: &Survey,
    courses: &[LegCourse],
    table: &TrajectoryTable,
) -> Vec<TrajectoryLeg> {
    let mut legs = Vec::with_capacity(survey.legs.len() * 3);
    for (leg, course) in survey.legs.iter().zip(courses) {
        let trajectory = leg.platform.trajectory.as_ref();
        let span = span(trajectory, table);
        let inactive = ScannerSettings {
            active: false,
            head_rate: 0.0,
            head_start: 0.0,
            head_stop: 0.0,
            max_duration: None,
            warmup: 0.0,
            pulse_times: None,
            ..leg.scanner.clone()
        };
        let mut add = |settings: ScannerSettings, time: f64, span: Option<Span>| {
            let course = LegCourse { position: table.position_at(time), span, ..*course };
            legs.push(TrajectoryLeg { leg: PlannedLeg::new(leg, settings), course });
        };
        if trajectory.is_some_and(|t| t.teleport) {
            add(inactive.clone(), span.start, None);
        }
        add(leg.scanner.clone(), span.start, Some(span));
        add(inactive, span.end, None);
    }
    legs
}

/// The flown part of the table; a missing start or end is the first or last row.
fn span(trajectory: Option<&LegTrajectory>, table: &TrajectoryTable) -> Span {
    let first = table.first_time();
    Span {
        start: trajectory.and_then(|t| t.start).map_or(0.0, |t| t - first),
        end: trajectory.and_then(|t| t.end).map_or(table.duration(), |t| t - first),
    }
}

pub(super) fn check_spans(
    survey: &Survey,
    settings: &Interpolated,
    table: &TrajectoryTable,
    problems: &mut Diagnostics,
) {
    for leg in &survey.legs {
        let span = span(leg.platform.trajectory.as_ref(), table);
        let world = |t: f64| t + table.first_time();
        let (start, end) = (number(world(span.start)), number(world(span.end)));
        if !(span.start.is_finite() && span.end.is_finite()) {
            let message =
                format!("leg {}: from {} s to {} s is not a valid interval", leg.number, start, end);
            problems.error(leg.place.clone(), message);
        } else if span.end - span.start > MAX_DURATION {
            let message = format!(
                "leg {}: {start} s to {end} s is more than {MAX_DURATION} s, expected at most 31 days",
                leg.number
            );
            problems.error(leg.place.clone(), message);
        } else if let Some((from, gap)) =
            table.longest_gap(span.start, span.end).filter(|(_, gap)| *gap > MAX_FLOWN_GAP)
        {
            let message = format!(
                "leg {}: no pose for {} s after {} s, at most {MAX_FLOWN_GAP} s are flown",
                leg.number,
                number(gap),
                number(world(from))
            );
            problems
                .error(leg.place.clone(), message)
                .help("tStart and tEnd choose a stretch without the gap");
        } else if span.end <= span.start {
            let message = format!("leg {}: ends at {end} s, not after its start at {start} s", leg.number);
            problems.warn(leg.place.clone(), message);
        } else if span.start < 0.0 || span.end > table.duration() {
            let message = format!(
                "leg {}: {start} s to {end} s leaves the trajectory ({} s to {} s); the first and last poses \
                 are extrapolated",
                leg.number,
                number(world(0.0)),
                number(world(table.duration()))
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
