//! A flight and its scanner, estimated from a recorded cloud with GPS times and scan angles.
//!
//! The beam of a model (a platform on a parabola, a mirror that turns or swings) is intersected with the
//! height of each recorded point. Least squares match the intersection with the position of the point, and
//! the angle across the track with that of the file. The attitude of each line is estimated with the
//! parameters, as a random walk. The height of the flight follows from the scan angles.
//!
//! | file | what it does |
//! |---|---|
//! | `points`, `windows` | the points of one flight line, or those of some windows of time |
//! | `grouping`, `pulses` | points as pulses, in little memory |
//! | `search` | order statistics of values that are not kept |
//! | `recording`, `outliers` | pulses of one flight line, cut to lines of the scanner; noise |
//! | `turning` | scanners that stand and turn, which are rejected |
//! | `sweeps` | lines that no gap divides: sweeps of a mirror that swings, full turns |
//! | `phases`, `level` | rates and phases of what recurs; straight flights and their height |
//! | `guess`, `cones`, `lines`, `facets` | first guesses for each kind of mirror |
//! | `model`, `mirror`, `parameters` | intersection of the beam of a flown scanner with the ground |
//! | `solve`, `residuals`, `solution` | least squares for parameters and attitudes |
//! | `rate`, `repeat` | when pulses leave: by the place of the mirror, and patterns that repeat |
//! | `finer_times` | times by the positions of points |
//! | `clock` | the pulses of thinned clouds |
//! | `ground` | noise of ranges |
//! | `doubts` | estimates that are not plausible, which are left out |
//! | `error` | reasons why no flight is fitted |
//! | `report`, `write`, `pipeline` | figures with uncertainties; written files; text of the pipeline file |

mod clock;
mod cones;
mod doubts;
mod error;
mod facets;
mod finer_times;
mod ground;
mod grouping;
mod guess;
mod level;
mod lines;
mod mirror;
mod model;
mod outliers;
mod parameters;
mod phases;
mod pipeline;
mod points;
mod pulses;
mod rate;
mod recording;
mod repeat;
mod report;
mod residuals;
mod search;
mod solution;
mod solve;
mod sweeps;
#[cfg(test)]
mod tests;
mod turning;
mod windows;
mod write;

pub use error::{FlightError, Misfit};
pub use ground::RangeScatter;
pub use mirror::{Mirror, MirrorParameters};
pub use model::{Attitude, Footprint, Model};
pub use parameters::{Channel, Parameters};
pub use pulses::{Pulse, Pulses};
pub use rate::{MAX_LOST_SHARE, PulseRate};
pub use recording::Recording;
pub use report::{Figure, json, table};
pub use solution::Solution;
pub(crate) use turning::steady_turn;
pub use write::FlightFiles;

use crate::limit::DEFAULT_MEMORY;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_geom::degrees;

/// Sections whose attitudes are estimated when the kind of mirror is chosen.
const TRIAL_SECTIONS: usize = 150;
/// Sections by which one of many guesses of an elliptic cone is chosen.
const ELLIPSE_SECTIONS: usize = 40;
/// Sections by which a flight is checked that no guess explains.
const DOUBTFUL_SECTIONS: usize = 1000;
const MAX_SECTIONS: usize = 20_000;
/// Sections per revolution of a mirror, within which the attitude counts as constant.
const SECTIONS_PER_TURN: f64 = 8.0;
/// Residuals of a kind of mirror that are larger than the best by this factor rule it out.
const RULED_OUT: f64 = 3.0;
/// Maximum ratio of the residuals of mirrors that swing unevenly to those of the others: in the middle of a
/// swath all swings look alike.
const CLEARLY_BETTER: f64 = 0.7;
/// Maximum residual of a flight, m on the ground.
const MAX_RESIDUAL: f64 = 0.5;
/// Residual, m on the ground, and deviations of the attitude, rad, above which a trial by some sections is
/// not repeated with more of them.
const HOPELESS_RESIDUAL: f64 = 5.0;
const HOPELESS_ATTITUDE: f64 = 0.075;
/// Standard deviation of the scan angles, over the maximum residual, above which angles that are met have the
/// right sign.
const KNOWN_SIGN: f64 = 3.0;
/// Maximum deviations of the attitude, rad, and of the scan angles, in steps of the angles and rad.
const MAX_ATTITUDE: f64 = 0.05;
const MAX_ANGLE_STEPS: f64 = 0.6;
const MAX_ANGLE: f64 = 0.02;
/// Minimum angle of a mirror that scans, rad.
const MIN_MIRROR: f64 = 0.01;
/// Speeds of flights, m/s.
const MIN_SPEED: f64 = 0.2;
const MAX_SPEED: f64 = 400.0;
/// Maximum angle of climb or descent, and of a tilt of the scanner, degrees.
const MAX_CLIMB: f64 = 30.0;
const MAX_TILT: f64 = 60.0;
/// Maximum time by which a flight is extended beyond its recording, s.
const MAX_EXTENSION: f64 = 86_400.0;
/// Residual above which a flight is doubtful, m on the ground.
const DOUBTFUL_RESIDUAL: f64 = 0.15;
/// Relative deviation of the height above which a warning is issued.
const DOUBTFUL_SCALE: f64 = 0.01;
/// Relative difference of the bounds of a half angle above which a warning is issued.
const DOUBTFUL_SWEEP: f64 = 0.03;

/// Choices of a fit.
#[derive(Clone, Debug, Default)]
pub struct FlightRequest {
    /// Point source of the flight line; if missing, the line with the most points.
    pub flight_line: Option<u16>,
    /// Time by which the written flight is extended after the recording, s.
    pub extend: f64,
    /// Memory that the points may take, bytes; 1 GiB by default. Of a flight line with more points the scan
    /// lines of some seconds are fitted.
    pub max_memory: Option<u64>,
}

/// A flight with its scanner.
#[derive(Clone, Debug)]
pub struct FlightFit {
    /// The recorded cloud.
    pub cloud: PathBuf,
    /// The pulses.
    pub recording: Recording,
    /// Model and attitudes.
    pub solution: Solution,
    /// When pulses leave.
    pub rate: PulseRate,
    /// Standard deviation of ranges, with the roughness of the ground.
    pub noise: Option<RangeScatter>,
    /// Time by which the written flight is extended after the recording, s: straight on, with the last
    /// attitude.
    pub extend: f64,
}

/// Fits a flight and its scanner to one flight line of a cloud. Warnings are added to `found`.
///
/// # Errors
/// [`Error::Io`]; [`Error::Input`] for clouds without GPS times or scan angles, with too few pulses, or with
/// pulses that are neither on the circles of a cone nor on lines across a flight.
pub fn fit_flight(path: &Path, request: &FlightRequest, found: &mut Diagnostics) -> Result<FlightFit> {
    if !(0.0..=MAX_EXTENSION).contains(&request.extend) {
        let message = format!("--extend {}: expected seconds from 0 to {MAX_EXTENSION}", request.extend);
        return Err(Error::input(message));
    }
    let max_memory = request.max_memory.unwrap_or(DEFAULT_MEMORY);
    let mut recording = Recording::read(path, request.flight_line, max_memory, found)?;
    reject_tripod(path, &recording)?;
    if let Some(lines) = sweeps::of_undivided(&recording) {
        recording.lines = lines;
    }
    recording.leave_out_cut_lines();
    lines::find_channels(&mut recording);
    let solution = match best_solution(&recording) {
        Ok(solution) => solution,
        Err(failed) => match best_turned_solution(&mut recording, &failed) {
            Some(solution) => {
                let message = "scan angles are positive to the left of the flight, against the LAS \
                               specification; their sign is reversed";
                found.warn(Some(Place::of_file(path)), message);
                solution
            }
            None => return Err(no_flight(path, &recording, failed.reason)),
        },
    };
    let rate = PulseRate::of(&recording, &solution);
    if !rate.is_plausible() {
        let reason = format!("needs {:.0} pulses a second", rate.mean);
        let misfit = Misfit { mirror: solution.model.mirror.name().to_string(), reason };
        return Err(no_flight(path, &recording, FlightError::Unexplained(vec![misfit])));
    }
    let noise = ground::range_noise(&recording, &solution);
    let fit =
        FlightFit { cloud: path.to_path_buf(), recording, solution, rate, noise, extend: request.extend };
    fit.warn_of_fit(found);
    fit.warn_of_rate(found);
    fit.warn_of_doubts(found);
    Ok(fit)
}

/// The error for a scanner that turns at a fixed position, or a flight with turns.
fn reject_tripod(path: &Path, recording: &Recording) -> Result<()> {
    let Some(turn) = turning::steady_turn(recording) else { return Ok(()) };
    let message = format!(
        "{}: the scan lines turn steadily by {:.0}° in {:.0} s, as those of a scanner on a tripod or of a \
         platform that turns do: this is no flight line",
        path.display(),
        degrees(turn),
        recording.duration()
    );
    let help = "a flight and its scanner are estimated from a straight flight line: cut a flight with turns \
                into lines with point sources of their own, and choose one with --flight-line";
    Err(Error::input_with_help(message, help))
}

/// The best solution with scan angles that some files count to the left; `None` if a flight that is not
/// possible otherwise meets the angles as they are. The sign of the angles stays reversed if there is one.
fn best_turned_solution(recording: &mut Recording, failed: &NoSolution) -> Option<Solution> {
    if failed.has_angles {
        return None;
    }
    recording.pulses.reverse_angles();
    let solution = best_solution(recording).ok();
    if solution.is_none() {
        recording.pulses.reverse_angles();
    }
    solution
}

fn no_flight(path: &Path, recording: &Recording, reason: FlightError) -> Error {
    let name = path.display();
    let message = format!(
        "{name}: no flight matches these points: {reason}; the cloud has {}",
        recording.description()
    );
    let mut problems = Diagnostics::default();
    problems.error(None, message).because_of(reason).help(
        "a fit needs all pulses of a flight line, not thinned, from a cone (also an elliptic one), a polygon \
         mirror (also one whose facets differ by their tilt) or an oscillating mirror, not from prisms or a \
         sensor that spins, with scan angles in degrees that change across the track, and times in seconds",
    );
    Error::Input(Box::new(problems))
}

impl FlightFit {
    /// Warns of a flight whose position, height or angles are doubtful.
    fn warn_of_fit(&self, found: &mut Diagnostics) {
        let (recording, solution) = (&self.recording, &self.solution);
        if solution.residual > DOUBTFUL_RESIDUAL {
            let message = format!(
                "the fitted flight misses its points by {:.2} m on the ground: its estimates are unreliable",
                solution.residual
            );
            found.warn(Some(Place::of_file(&self.cloud)), message);
        }
        let share = solution.scale_deviation(recording);
        if share > DOUBTFUL_SCALE {
            let rounded = if recording.has_whole_angles() { ", rounded to degrees," } else { "" };
            let message = format!(
                "the scan angles{rounded} change so little across these points (standard deviation {:.1}°) \
                 that height and angles of the mirror are known to {:.0} % only",
                degrees(recording.angle_spread()),
                100.0 * share
            );
            found.warn(Some(Place::of_file(&self.cloud)), message).help("fit a wider part of the swath");
        }
        if let Some(message) = self.doubt_of_sweeps() {
            found.warn(Some(Place::of_file(&self.cloud)), message).help("fit a wider part of the swath");
        }
    }

    /// Bounds of the half angle of an oscillating mirror as text, if they differ.
    fn doubt_of_sweeps(&self) -> Option<String> {
        let [smallest, largest] = self.half_angles();
        (largest - smallest > DOUBTFUL_SWEEP * largest).then(|| {
            format!(
                "the reversals of the mirror are not in the cloud: its half angle is between {:.1} and \
                 {:.1}°, and the larger one is written",
                degrees(smallest),
                degrees(largest)
            )
        })
    }

    /// Warns of a pulse rate or a range noise that is doubtful.
    fn warn_of_rate(&self, found: &mut Diagnostics) {
        let rate = &self.rate;
        if let Some(step) = rate.coarse_step {
            let message = format!(
                "GPS times have steps of {:.3} µs, too coarse for the intervals of pulses: the pulse rate \
                 of {:.0} per second is doubtful",
                1e6 * step,
                rate.mean
            );
            found.warn(Some(Place::of_file(&self.cloud)), message);
        }
        if rate.lost > MAX_LOST_SHARE {
            let message = format!(
                "{:.0} % of the pulses have no point: the cloud is thinned, or its ground reflects little; \
                 no dropout_rate is written, and if neighbouring pulses are hardly ever in the cloud the \
                 pulse rate is too low",
                100.0 * rate.lost
            );
            found.warn(Some(Place::of_file(&self.cloud)), message);
        }
        if self.noise.is_none() {
            let message = "too few ground points lie close together to estimate the range noise";
            found.warn(Some(Place::of_file(&self.cloud)), message);
        }
    }
}

/// A guess that does not explain the points.
struct Failure {
    misfit: Misfit,
    /// m on the ground.
    residual: f64,
}

impl Failure {
    fn of(trial: &Solution, recording: &Recording) -> Option<Failure> {
        let reason = misfit(trial, recording)?;
        let details = match (trial.model.parameters.channels.len(), trial.model.facets()) {
            (1, 1) => String::new(),
            (1, facets) => format!(" with {facets} facets of different tilt"),
            (channels, _) => format!(" with {channels} channels"),
        };
        let mirror = format!("{}{details}", trial.model.mirror.name());
        Some(Failure { misfit: Misfit { mirror, reason }, residual: trial.residual })
    }
}

/// No kind of mirror explains a recording.
#[derive(Debug)]
struct NoSolution {
    reason: FlightError,
    /// True if a solution meets the points with their scan angles, but is no flight.
    has_angles: bool,
}

/// The solution with the smallest unexplained part, over all kinds of mirrors; the error lists the reasons
/// against each kind.
fn best_solution(recording: &Recording) -> Result<Solution, NoSolution> {
    let mut trials = all_trials(recording, &guess::guesses(recording));
    let others = trials.iter().filter(|trial| trial.has_sections()).map(Solution::unexplained);
    let others = others.fold(f64::INFINITY, f64::min);
    let swings = all_trials(recording, &guess::swings(recording)).into_iter();
    trials.extend(swings.filter(|swing| swing.unexplained() < CLEARLY_BETTER * others));
    let needs_ellipse = trials.iter().all(|trial| misfit(trial, recording).is_some());
    if needs_ellipse {
        trials.extend(ellipse(recording));
    }
    match best_of(recording, trials) {
        // The circle of a cone may explain some sections of an ellipse, but not all.
        Err(failed) if !needs_ellipse => {
            best_of(recording, ellipse(recording).into_iter().collect()).map_err(|_| failed)
        }
        result => result,
    }
}

/// The best trial of an elliptic cone.
fn ellipse(recording: &Recording) -> Option<Solution> {
    let ellipses: Vec<Solution> = cones::elliptic_guesses(recording)
        .par_iter()
        .map(|first| solve_without_attitudes(recording, first, ELLIPSE_SECTIONS))
        .collect();
    let ellipses = ellipses.iter().filter(|ellipse| ellipse.has_sections());
    let best = ellipses.min_by(|a, b| a.residual.total_cmp(&b.residual))?;
    Some(trial(recording, &best.model))
}

/// The solution by all sections of the trial with the smallest unexplained part.
fn best_of(recording: &Recording, mut trials: Vec<Solution>) -> Result<Solution, NoSolution> {
    let mut failures: Vec<Failure> =
        trials.iter().filter_map(|trial| Failure::of(trial, recording)).collect();
    let is_doubtful = failures.len() == trials.len();
    let has_angles = trials.iter().any(|trial| has_angles_of(trial, recording));
    let failed = |reason| Err(NoSolution { reason, has_angles });
    trials.retain(Solution::has_sections);
    let smallest = trials.iter().map(|trial| trial.residual).fold(f64::INFINITY, f64::min);
    trials.retain(|trial| trial.residual <= RULED_OUT * smallest);
    let best = trials.into_iter().min_by(|a, b| a.unexplained().total_cmp(&b.unexplained()));
    let Some(best) = best else { return failed(reasons(failures)) };
    let solved = |max| solve::solve(recording, &best.model, &sections_of(recording, &best.model, max), true);
    // All sections take long: where no guess explains the points, some sections are tried before, unless the
    // best guess is far off.
    if is_doubtful && (is_hopeless(&best) || misfit(&solved(DOUBTFUL_SECTIONS), recording).is_some()) {
        return failed(reasons(failures));
    }
    let best = solved(MAX_SECTIONS);
    match Failure::of(&best, recording) {
        None => Ok(best),
        Some(failure) => {
            failures.push(failure);
            failed(reasons(failures))
        }
    }
}

/// At most `max` sections within which the attitude counts as constant.
fn sections_of(recording: &Recording, model: &Model, max: usize) -> Vec<solve::Section> {
    let turns = model.parameters.mirror.rate.abs();
    solve::sections(recording, 1.0 / (SECTIONS_PER_TURN * turns), max)
}

fn solve_without_attitudes(recording: &Recording, first: &Model, max_sections: usize) -> Solution {
    solve::solve(recording, first, &sections_of(recording, first, max_sections), false)
}

/// Solution by some sections.
fn trial(recording: &Recording, first: &Model) -> Solution {
    let start = solve_without_attitudes(recording, first, TRIAL_SECTIONS);
    solve::solve(recording, &start.model, &sections_of(recording, first, TRIAL_SECTIONS), true)
}

/// Solutions by some sections, in the order of the guesses.
fn all_trials(recording: &Recording, guesses: &[Model]) -> Vec<Solution> {
    guesses.par_iter().map(|first| trial(recording, first)).collect()
}

/// True if a solution that does not explain the points is so far off that more sections cannot change that.
fn is_hopeless(trial: &Solution) -> bool {
    trial.residual > HOPELESS_RESIDUAL || trial.attitude_spread() > HOPELESS_ATTITUDE
}

/// True if the beams of a solution meet the points with the scan angles of the file, which change so much
/// that their sign is known.
fn has_angles_of(solution: &Solution, recording: &Recording) -> bool {
    let max_angle = max_angle_residual(recording);
    solution.has_sections()
        && solution.residual <= MAX_RESIDUAL
        && solution.angle_residual <= max_angle
        && recording.angle_spread() > KNOWN_SIGN * max_angle
}

/// Maximum residual of the scan angles of a flight, rad.
fn max_angle_residual(recording: &Recording) -> f64 {
    (MAX_ANGLE_STEPS * recording.angle_step).max(MAX_ANGLE)
}

/// The reasons against several guesses: of each kind of mirror that of the guess with the smallest residual,
/// the first of several.
fn reasons(failures: Vec<Failure>) -> FlightError {
    if failures.is_empty() {
        return FlightError::NoPattern;
    }
    let mut best: Vec<Failure> = Vec::new();
    for failure in failures {
        match best.iter_mut().find(|known| known.misfit.mirror == failure.misfit.mirror) {
            Some(known) if failure.residual < known.residual => *known = failure,
            Some(_) => {}
            None => best.push(failure),
        }
    }
    FlightError::Unexplained(best.into_iter().map(|failure| failure.misfit).collect())
}

/// Reason why a solution does not explain its points by a possible flight; `None` if it does.
fn misfit(solution: &Solution, recording: &Recording) -> Option<String> {
    let max_angle = max_angle_residual(recording);
    let speed = solution.model.speed();
    // False for NaN.
    let is_within = |value: f64, low: f64, high: f64| (low..=high).contains(&value);
    if !is_within(solution.residual, 0.0, MAX_RESIDUAL) {
        return Some(format!("misses them by {:.2} m on the ground", solution.residual));
    }
    if !is_within(solution.angle_residual, 0.0, max_angle) {
        return Some(format!("misses their scan angles by {:.1}°", degrees(solution.angle_residual)));
    }
    if !is_within(solution.attitude_spread(), 0.0, MAX_ATTITUDE) {
        return Some(format!(
            "needs a platform that rolls and turns by {:.1}°",
            degrees(solution.attitude_spread())
        ));
    }
    if !is_within(solution.model.parameters.mirror.angle.abs(), MIN_MIRROR, f64::MAX) {
        return Some("needs a mirror that hardly moves".to_owned());
    }
    if !is_within(speed, MIN_SPEED, MAX_SPEED) {
        return Some(format!("needs a platform that flies at {speed:.1} m/s"));
    }
    let p = &solution.model.parameters;
    let climb = degrees(libm::atan2(p.velocity.z, speed));
    if !is_within(climb, -MAX_CLIMB, MAX_CLIMB) {
        let verb = if climb < 0.0 { "descends" } else { "climbs" };
        return Some(format!("needs a platform that {verb} at {:.0}°", climb.abs()));
    }
    let tilt = degrees(p.roll.abs().max(p.pitch.abs()));
    if !is_within(tilt, 0.0, MAX_TILT) {
        return Some(format!("needs a scanner that is tilted by {tilt:.0}°"));
    }
    (!solution.has_sections()).then(|| "needs a mirror that turns within a few pulses".to_owned())
}
