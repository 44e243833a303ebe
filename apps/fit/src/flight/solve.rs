//! Least squares for a flight: the parameters of the model together with the attitudes of all lines.
//!
//! The attitudes are a random walk whose variances are estimated from the data (expectation maximisation), so
//! that they follow the motion of the lines and no more. Their part of the normal equations is block
//! tridiagonal and is eliminated (Schur complement): time and memory grow linearly with the number of lines.

use super::equations::{Normal, SectionEquations, min_angle, moved, normal_cost, normal_equations, spreads};
use super::mirror::MirrorParameters;
use super::model::{Attitude, Model};
use super::parameters::{Channel, Parameters};
use super::recording::Recording;
use super::sections::Section;
use super::solution::Solution;
use vlscan_geom::{DMat3, DVec3, radians};

const MAX_STEPS: usize = 60;
/// Damping of the equations for standard deviations: a larger one hides what the points do not determine.
const LEAST_DAMPING: f64 = 1e-14;
/// Maximum number of steps during which scan angles keep the resolution of their file.
const STRICT_STEPS: usize = 30;
/// Standard deviation of attitudes of single lines, rad.
pub const ATTITUDE: f64 = 0.02;

/// Standard deviations of the parameters around 0 before the fit; infinite where nothing is known.
fn priors(model: &Model) -> Parameters {
    let unknown = model.parameters.filled(f64::INFINITY);
    let of_channel = |channel: &Channel| Channel { pitch: radians(2.0), ..*channel };
    Parameters {
        velocity: DVec3::new(f64::INFINITY, f64::INFINITY, 1.0),
        acceleration: DVec3::new(0.3, 0.3, 0.05),
        roll: radians(2.0),
        pitch: radians(2.0),
        mirror: MirrorParameters { yaw: radians(10.0), turning: 1.0, ..unknown.mirror },
        channels: unknown.channels.iter().map(of_channel).collect(),
        facet_tilts: vec![radians(20.0); unknown.facet_tilts.len()],
        ..unknown
    }
}

/// Steps of the parameters for numeric derivatives. Each moves the beam by at most about a millimetre within
/// `duration`.
fn increments(model: &Model, duration: f64) -> Parameters {
    let t = duration.max(1.0);
    let others = model.parameters.filled(1e-7);
    Parameters {
        position: DVec3::splat(1e-3),
        velocity: DVec3::splat(1e-3 / t),
        acceleration: DVec3::splat(1e-3 / (t * t)),
        mirror: MirrorParameters { rate: 1e-7 / t, ..others.mirror },
        ..others
    }
}

/// Fits a model to a recording from a first guess. Attitudes of sections are estimated if `has_attitudes`.
///
/// Position and velocity are estimated in the middle of the recording, where they hardly depend on the
/// acceleration.
pub fn solve(recording: &Recording, first: &Model, sections: &[Section], has_attitudes: bool) -> Solution {
    let parameters = first.parameters.with_epoch(0.5 * recording.duration());
    let mut model = Model { mirror: first.mirror, parameters };
    let steps = increments(first, recording.duration()).to_vector(first.mirror);
    // Roll, pitch, yaw.
    let mut attitudes = vec![DVec3::ZERO; sections.len()];
    // Variance per second of the random walk.
    let mut walk = DVec3::new(1e-5, 1e-5, 1e-4);
    let (mut ground, mut angle) = spreads(recording, &model, sections, &attitudes);
    let mut deviations = model.parameters.filled(f64::INFINITY);
    let mut damping = 1e-3;
    let mut latest = f64::INFINITY;
    // A flight that does not match the angles of the file would attribute its misfit to errors of the angles:
    // the motion of the platform is taken for that of the mirror, or vice versa. The errors are assumed to be
    // small until the flight that matches the angles best is found.
    let mut is_strict = has_attitudes;
    if is_strict {
        angle = min_angle(recording);
    }
    // Equations of a step that was rejected.
    let mut kept: Option<Normal> = None;
    for number in 0..MAX_STEPS {
        let normal = kept.take().unwrap_or_else(|| {
            let mut normal = normal_equations(recording, &model, &steps, sections, &attitudes, ground, angle);
            add_priors(&mut normal, &model, &attitudes, sections, walk, has_attitudes);
            normal
        });
        let Some(step) = reduce(&normal, sections, walk, damping, has_attitudes) else { break };
        let next = moved(&model, &step.parameters);
        let next_attitudes: Vec<DVec3> = attitudes.iter().zip(&step.attitudes).map(|(a, b)| a + b).collect();
        let mut after = normal_cost(recording, &next, sections, &next_attitudes, ground, angle);
        after += prior_cost(&next, &next_attitudes, sections, walk, has_attitudes);
        if after > normal.cost * (1.0 + 1e-9) {
            damping *= 10.0;
            if damping > 1e9 {
                break;
            }
            kept = Some(normal);
            continue;
        }
        damping = (damping * 0.2).max(1e-12);
        deviations = model.parameters.filled(0.0).with_vector(model.mirror, &step.deviations);
        (model, attitudes) = (next, next_attitudes);
        let change = (latest - after).abs() / after.max(1e-12);
        latest = after;
        let before = ground;
        let of_angle;
        (ground, of_angle) = spreads(recording, &model, sections, &attitudes);
        // Without effect on fits without attitudes.
        walk = step.walk(&attitudes, sections, walk);
        let is_settled = (ground / before - 1.0).abs() <= 0.02 && change < 1e-6;
        if is_strict && (is_settled || number + 1 >= STRICT_STEPS) {
            (is_strict, latest) = (false, f64::INFINITY);
        } else if is_settled {
            break;
        }
        if (ground / before - 1.0).abs() > 0.02 {
            latest = f64::INFINITY;
        }
        if !is_strict {
            angle = of_angle;
        }
    }
    if has_attitudes {
        let mut normal = normal_equations(recording, &model, &steps, sections, &attitudes, ground, angle);
        add_priors(&mut normal, &model, &attitudes, sections, walk, has_attitudes);
        if let Some(step) = reduce(&normal, sections, walk, LEAST_DAMPING, has_attitudes) {
            deviations = model.parameters.filled(0.0).with_vector(model.mirror, &step.deviations);
        }
    }
    let (residual, angle_residual) = spreads(recording, &model, sections, &attitudes);
    let times = sections.iter().map(|section| section.time).collect();
    let attitudes = attitudes.into_iter().map(Attitude::from_vector).collect();
    Solution { model, deviations, times, attitudes, residual, angle_residual }
}

/// Precision of the change of an attitude between two sections.
fn walk_precision(before: &Section, after: &Section, walk: DVec3) -> DVec3 {
    let interval = (after.time - before.time).max(1e-6);
    1.0 / (walk * interval)
}

fn prior_cost(
    model: &Model,
    attitudes: &[DVec3],
    sections: &[Section],
    walk: DVec3,
    has_attitudes: bool,
) -> f64 {
    let values = model.parameters.to_vector(model.mirror);
    let prior = priors(model).to_vector(model.mirror);
    let mut cost: f64 = values.iter().zip(prior).map(|(value, deviation)| (value / deviation).powi(2)).sum();
    if has_attitudes {
        cost += attitudes.iter().map(|attitude| (*attitude / ATTITUDE).length_squared()).sum::<f64>();
        for (pair, sections) in attitudes.windows(2).zip(sections.windows(2)) {
            let change = pair[1] - pair[0];
            cost += walk_precision(&sections[0], &sections[1], walk).dot(change * change);
        }
    }
    cost
}

fn add_priors(
    normal: &mut Normal,
    model: &Model,
    attitudes: &[DVec3],
    sections: &[Section],
    walk: DVec3,
    has_attitudes: bool,
) {
    let values = model.parameters.to_vector(model.mirror);
    let prior = priors(model).to_vector(model.mirror);
    for (k, (value, deviation)) in values.iter().zip(prior).enumerate() {
        // 0 for an infinite deviation.
        let precision = 1.0 / (deviation * deviation);
        normal.parameters.matrix.add(k, k, precision);
        normal.parameters.right[k] -= precision * value;
    }
    if has_attitudes {
        for (k, attitude) in attitudes.iter().enumerate() {
            let neighbours = [k.checked_sub(1), Some(k + 1).filter(|next| *next < sections.len())];
            let mut precision = DVec3::splat(1.0 / (ATTITUDE * ATTITUDE));
            let mut right = -precision * *attitude;
            for other in neighbours.into_iter().flatten() {
                let (before, after) = (k.min(other), k.max(other));
                let of_walk = walk_precision(&sections[before], &sections[after], walk);
                precision += of_walk;
                right -= of_walk * (*attitude - attitudes[other]);
            }
            normal.sections[k].matrix += DMat3::from_diagonal(precision);
            normal.sections[k].right += right;
        }
    }
    normal.cost += prior_cost(model, attitudes, sections, walk, has_attitudes);
}

/// A step of the parameters and attitudes, with their covariances.
struct Step {
    /// Changes of the estimated parameters.
    parameters: Vec<f64>,
    /// Standard deviations of the parameters.
    deviations: Vec<f64>,
    attitudes: Vec<DVec3>,
    /// Variances of the attitudes' changes from section to section.
    change_variances: Vec<DVec3>,
}

impl Step {
    /// Variances per second of the random walk that these attitudes and their uncertainties suggest.
    fn walk(&self, attitudes: &[DVec3], sections: &[Section], before: DVec3) -> DVec3 {
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for (k, pair) in sections.windows(2).enumerate() {
            let interval = (pair[1].time - pair[0].time).max(1e-6);
            let change = attitudes[k + 1] - attitudes[k];
            sum += (change * change + self.change_variances[k]) / interval;
            count += 1.0;
        }
        if count > 0.0 {
            DVec3::from((sum / count).to_array().map(|variance| variance.clamp(1e-12, 1.0)))
        } else {
            before
        }
    }
}

/// Sections after forward elimination.
struct Eliminated {
    inverse: DMat3,
    /// Block of attitude times parameters.
    mixed: Vec<DVec3>,
    right: DVec3,
    /// Negative precision of the random walk from the section before, which is the block that links them; 0
    /// for the first section.
    link: DVec3,
}

/// Forward elimination of the attitudes: D_k = A_k − E D⁻¹ E, with E = −precision of the walk; likewise for
/// the right sides. `None` if a block is singular.
fn eliminate(normal: &Normal, sections: &[Section], walk: DVec3) -> Option<Vec<Eliminated>> {
    let mut done: Vec<Eliminated> = Vec::with_capacity(sections.len());
    for (k, SectionEquations { matrix, mixed, right }) in normal.sections.iter().enumerate() {
        let (mut matrix, mut mixed, mut right, mut link) = (*matrix, mixed.clone(), *right, DVec3::ZERO);
        if let Some(before) = done.last() {
            link = -walk_precision(&sections[k - 1], &sections[k], walk);
            let gain = DMat3::from_diagonal(link) * before.inverse;
            matrix -= gain * DMat3::from_diagonal(link);
            for (column, before) in mixed.iter_mut().zip(&before.mixed) {
                *column -= gain * *before;
            }
            right -= gain * before.right;
        }
        done.push(Eliminated { inverse: matrix.try_inverse()?, mixed, right, link });
    }
    Some(done)
}

/// Eliminates the attitudes and solves for the parameters; `None` for equations without a solution.
fn reduce(
    normal: &Normal,
    sections: &[Section],
    walk: DVec3,
    damping: f64,
    has_attitudes: bool,
) -> Option<Step> {
    let mut reduced = normal.parameters.clone();
    let count = reduced.right.len();
    let eliminated = if has_attitudes { eliminate(normal, sections, walk)? } else { Vec::new() };
    for Eliminated { inverse, mixed, right, .. } in &eliminated {
        for (i, column) in mixed.iter().enumerate() {
            let weighted = *inverse * *column;
            for (j, other) in mixed.iter().enumerate().take(i + 1) {
                reduced.matrix.add(i, j, -weighted.dot(*other));
            }
            reduced.right[i] -= weighted.dot(*right);
        }
    }
    let decomposition = reduced.matrix.scaled_cholesky(damping, 0.0)?;
    let parameters = decomposition.solve(&reduced.right);
    let covariance = decomposition.inverse();
    let deviations = (0..count).map(|k| covariance.at(k, k).max(0.0).sqrt()).collect();
    let mut attitudes = vec![DVec3::ZERO; sections.len()];
    let mut change_variances = vec![DVec3::ZERO; sections.len().saturating_sub(1)];
    // Backward substitution.
    let mut covariance = DMat3::ZERO;
    for (k, Eliminated { inverse, mixed, right, .. }) in eliminated.iter().enumerate().rev() {
        let shift: DVec3 = mixed.iter().zip(&parameters).map(|(column, change)| *column * *change).sum();
        let mut side = *right - shift;
        covariance = match eliminated.get(k + 1) {
            Some(Eliminated { link, .. }) => {
                side -= *link * attitudes[k + 1];
                let gain = -(*inverse * DMat3::from_diagonal(*link));
                let cross = gain * covariance;
                let here = *inverse + cross * gain.transpose();
                change_variances[k] = (here + covariance - cross - cross.transpose()).diagonal();
                here
            }
            None => *inverse,
        };
        attitudes[k] = *inverse * side;
    }
    Some(Step { parameters, deviations, attitudes, change_variances })
}
