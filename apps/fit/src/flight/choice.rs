//! The kind of mirror that explains a recording.
//!
//! Guesses are solved by some sections. The guess that leaves the least unexplained is solved by all of them.
//! Single sections far apart do not exclude a circle where the mirror draws an ellipse: the attitude takes up
//! the difference. Successive sections do, and are tried first, because all sections take long.

use super::error::{FlightError, Misfit};
use super::mirror::{Mirror, MirrorParameters};
use super::model::Model;
use super::recording::Recording;
use super::sections::{Section, sections};
use super::solution::Solution;
use super::solve::solve;
use super::{cones, guess};
use rayon::prelude::*;
use vlscan_geom::degrees;

/// Sections whose attitudes are estimated when the kind of mirror is chosen.
const TRIAL_SECTIONS: usize = 150;
/// Sections by which one of many guesses of an elliptic cone is chosen.
const ELLIPSE_SECTIONS: usize = 40;
/// Sections by which a flight is checked that no guess explains.
const DOUBTFUL_SECTIONS: usize = 1000;
/// Successive sections in the middle of a recording by which a guess is checked before all sections are
/// solved, and the minimum number of all sections for this check.
const SUCCESSIVE_SECTIONS: usize = 1000;
const MIN_CHECKED_SECTIONS: usize = 2000;
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
/// Minimum ratio of the half angles of an elliptic cone: flatter ones are lines, of which the cone explains
/// the points between its ends only.
const MIN_ELLIPSE: f64 = 0.1;
/// Speeds of flights, m/s.
const MIN_SPEED: f64 = 0.2;
const MAX_SPEED: f64 = 400.0;
/// Maximum angle of climb or descent, and of a tilt of the scanner, degrees.
const MAX_CLIMB: f64 = 30.0;
const MAX_TILT: f64 = 60.0;

/// A guess that does not explain the points.
#[derive(Clone, Debug)]
pub struct Failure {
    misfit: Misfit,
    /// m on the ground.
    residual: f64,
}

impl Failure {
    fn of(trial: &Solution, recording: &Recording) -> Option<Failure> {
        let reason = misfit(trial, recording)?;
        let misfit = Misfit { mirror: kind(&trial.model), reason };
        Some(Failure { misfit, residual: trial.residual })
    }
}

/// Kind of the mirror of a model, with channels and facets.
fn kind(model: &Model) -> String {
    let details = match (model.parameters.channels.len(), model.facets()) {
        (1, 1) => String::new(),
        (1, facets) => format!(" with {facets} facets of different tilt"),
        (channels, _) => format!(" with {channels} channels"),
    };
    format!("{}{details}", model.mirror.name())
}

/// No kind of mirror explains a recording.
#[derive(Debug)]
pub struct NoSolution {
    /// The reasons against each kind.
    pub reason: FlightError,
    /// True if a solution meets the points with their scan angles, but is no flight.
    pub has_angles: bool,
}

/// The solution with the smallest unexplained part, over all kinds of mirrors; the error lists the reasons
/// against each kind.
pub fn best_solution(recording: &Recording) -> Result<Solution, NoSolution> {
    let mut trials = all_trials(recording, &guess::guesses(recording));
    let others = trials.iter().filter(|trial| trial.has_sections()).map(Solution::unexplained);
    let others = others.fold(f64::INFINITY, f64::min);
    let swings = all_trials(recording, &guess::swings(recording)).into_iter();
    trials.extend(swings.filter(|swing| swing.unexplained() < CLEARLY_BETTER * others));
    let needs_ellipse = trials.iter().all(|trial| misfit(trial, recording).is_some());
    if needs_ellipse {
        trials.extend(ellipse(recording));
    }
    let choice = Choice::of(recording, trials);
    let (best, first) = (choice.candidates.first(), choice.first(recording));
    if needs_ellipse {
        return choice.solved(recording, first.or(best));
    }
    let solved_ellipse = || {
        let choice = Choice::of(recording, ellipse(recording).into_iter().collect());
        choice.solved(recording, choice.candidates.first())
    };
    match first {
        // The circle of a cone may explain some sections of an ellipse, but not all. A circle of 90° looks
        // like the fan of a mirror, but its scanner would be tilted by 90°.
        Some(candidate) => choice
            .solved(recording, first)
            .or_else(|failed| solved_ellipse().map_err(|_| failed))
            .or_else(|failed| choice.solved_otherwise(recording, &candidate.model).ok_or(failed)),
        None => solved_ellipse().or_else(|_| choice.solved(recording, best)),
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

/// Trials among which one is chosen.
pub struct Choice {
    /// Trials that are not ruled out by their residuals, those that leave the least unexplained first.
    pub candidates: Vec<Solution>,
    /// The reasons against trials that do not explain the points.
    pub failures: Vec<Failure>,
    /// True if no trial explains the points.
    pub is_doubtful: bool,
    /// True if a trial meets the points with their scan angles.
    pub has_angles: bool,
}

impl Choice {
    fn of(recording: &Recording, mut trials: Vec<Solution>) -> Choice {
        let failures: Vec<Failure> =
            trials.iter().filter_map(|trial| Failure::of(trial, recording)).collect();
        let is_doubtful = failures.len() == trials.len();
        let has_angles = trials.iter().any(|trial| has_angles_of(trial, recording));
        trials.retain(Solution::has_sections);
        let smallest = trials.iter().map(|trial| trial.residual).fold(f64::INFINITY, f64::min);
        trials.retain(|trial| trial.residual <= RULED_OUT * smallest);
        trials.sort_by(|a, b| a.unexplained().total_cmp(&b.unexplained()));
        Choice { candidates: trials, failures, is_doubtful, has_angles }
    }

    /// The candidate that is solved first: the best one that meets successive sections; `None` if all miss
    /// them. Only the best one of each kind of mirror is checked, since a check takes long. Where no trial
    /// explains the points, the best one.
    pub fn first(&self, recording: &Recording) -> Option<&Solution> {
        if self.is_doubtful {
            return self.candidates.first();
        }
        let mut missed: Vec<String> = Vec::new();
        self.candidates.iter().find(|candidate| {
            let kind = kind(&candidate.model);
            let is_first =
                !missed.contains(&kind) && !misses_successive_sections(recording, &candidate.model);
            if !is_first {
                missed.push(kind);
            }
            is_first
        })
    }

    /// The solution by all sections of the best candidate with another kind of mirror than `failed` that
    /// explains some sections.
    fn solved_otherwise(&self, recording: &Recording, failed: &Model) -> Option<Solution> {
        let mut candidates = self.candidates.iter();
        let other = candidates.find(|other| {
            kind(&other.model) != kind(failed)
                && misfit(other, recording).is_none()
                && !misses_successive_sections(recording, &other.model)
        });
        self.solved(recording, Some(other?)).ok()
    }

    /// The solution of a candidate by all sections.
    fn solved(&self, recording: &Recording, candidate: Option<&Solution>) -> Result<Solution, NoSolution> {
        let mut failures = self.failures.clone();
        let failed = |failures| Err(NoSolution { reason: reasons(failures), has_angles: self.has_angles });
        let Some(Solution { model, .. }) = candidate else { return failed(failures) };
        let solved = |max| solve(recording, model, &sections_of(recording, model, max), true);
        // All sections take long: where no guess explains the points, some sections are tried before, unless
        // the best guess is far off.
        let is_rejected =
            |trial: &Solution| is_hopeless(trial) || misfit(&solved(DOUBTFUL_SECTIONS), recording).is_some();
        if self.is_doubtful && candidate.is_some_and(is_rejected) {
            return failed(failures);
        }
        let solution = solved(MAX_SECTIONS);
        match Failure::of(&solution, recording) {
            None => Ok(solution),
            Some(failure) => {
                failures.push(failure);
                failed(failures)
            }
        }
    }
}

/// True if a model does not explain successive sections in the middle of a recording. False for recordings of
/// few sections, of which all are solved quickly.
fn misses_successive_sections(recording: &Recording, model: &Model) -> bool {
    let all = sections_of(recording, model, usize::MAX);
    if all.len() < MIN_CHECKED_SECTIONS {
        return false;
    }
    let start = (all.len() - SUCCESSIVE_SECTIONS) / 2;
    let successive: Vec<Section> = all.into_iter().skip(start).take(SUCCESSIVE_SECTIONS).collect();
    misfit(&solve(recording, model, &successive, true), recording).is_some()
}

/// At most `max` sections within which the attitude counts as constant.
fn sections_of(recording: &Recording, model: &Model, max: usize) -> Vec<Section> {
    let turns = model.parameters.mirror.rate.abs();
    sections(recording, 1.0 / (SECTIONS_PER_TURN * turns), max)
}

fn solve_without_attitudes(recording: &Recording, first: &Model, max_sections: usize) -> Solution {
    solve(recording, first, &sections_of(recording, first, max_sections), false)
}

/// Solution by some sections.
pub fn trial(recording: &Recording, first: &Model) -> Solution {
    let start = solve_without_attitudes(recording, first, TRIAL_SECTIONS);
    solve(recording, &start.model, &sections_of(recording, first, TRIAL_SECTIONS), true)
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
pub fn misfit(solution: &Solution, recording: &Recording) -> Option<String> {
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
    if solution.model.mirror == Mirror::EllipticCone {
        let MirrorParameters { angle, angle_along, .. } = solution.model.parameters.mirror;
        if !is_within((angle_along / angle).abs(), MIN_ELLIPSE, 1.0 / MIN_ELLIPSE) {
            let [across, along] = [angle, angle_along].map(|angle| degrees(angle.abs()));
            return Some(format!("needs a cone of {across:.3}° by {along:.3}°, which is nearly a line"));
        }
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
