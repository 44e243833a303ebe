//! Least squares for a flight: the parameters of the model together with the attitudes of all lines.
//!
//! The attitudes are a random walk whose variances are estimated from the data (expectation maximisation), so
//! that they take up what moves the lines and no more. Their part of the normal equations is block
//! tridiagonal and is eliminated (Schur complement): time and memory grow linearly with the number of lines.

use super::mirror::Mirror;
use super::model::{Attitude, FIRST_OF_CHANNELS, MAX_PARAMETERS, Model, PLATFORM_PARAMETERS};
use super::recording::{Recording, median};
use super::solution::Solution;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix3xX, Vector3};
use vlscan_geom::radians;

/// Pulses of a section that are used.
const SECTION_PULSES: usize = 40;
/// Errors of neighbouring pulses are correlated (heights of the ground, encoders): a section counts as so
/// many independent pulses.
const SECTION_WEIGHT: f64 = 20.0;
/// Residuals beyond this many standard deviations get less weight (Huber).
const HUBER: f64 = 2.5;
const MAX_STEPS: usize = 60;
/// Scan angles are held to the resolution of their file for at most so many steps of those.
const STRICT_STEPS: usize = 30;
/// Standard deviation of attitudes of single lines, rad.
const ATTITUDE: f64 = 0.02;

/// Pulses for which the attitude counts as constant.
#[derive(Clone, Debug)]
pub struct Section {
    /// Mean time, s.
    pub time: f64,
    /// Indices of pulses that are used.
    pulses: Vec<usize>,
}

/// Divides lines into sections of at most `max_duration` s. At most `max_sections` are used, evenly chosen.
pub fn sections(recording: &Recording, max_duration: f64, max_sections: usize) -> Vec<Section> {
    let mut found = Vec::new();
    for line in &recording.lines {
        let pulses = &recording.pulses[line.clone()];
        let (first, last) = (pulses[0].time, pulses[pulses.len() - 1].time);
        let count = ((last - first) / max_duration).ceil().max(1.0) as usize;
        let mut begin = line.start;
        for k in 1..=count {
            let until = first + (last - first) * k as f64 / count as f64;
            let mut end = begin;
            while end < line.end && (recording.pulses[end].time <= until || k == count) {
                end += 1;
            }
            if end - begin >= 8 {
                let step = (end - begin).div_ceil(SECTION_PULSES);
                let pulses: Vec<usize> = (begin..end).step_by(step).collect();
                let time =
                    pulses.iter().map(|i| recording.pulses[*i].time).sum::<f64>() / pulses.len() as f64;
                found.push(Section { time, pulses });
            }
            begin = end;
        }
    }
    found.sort_by(|a, b| a.time.total_cmp(&b.time));
    let step = found.len().div_ceil(max_sections.max(1)).max(1);
    found.into_iter().step_by(step).collect()
}

/// Standard deviations of what is known beforehand of the parameters, in their order; infinite for nothing.
fn priors(model: &Model) -> [f64; MAX_PARAMETERS] {
    let mut prior = [f64::INFINITY; MAX_PARAMETERS];
    // Acceleration, climb, roll, pitch.
    (prior[4], prior[5], prior[7]) = (0.3, 0.3, 1.0);
    (prior[8], prior[9]) = (radians(2.0), radians(2.0));
    if model.mirror != Mirror::Cone {
        prior[PLATFORM_PARAMETERS + 3] = radians(10.0);
    }
    if model.facets > 1 {
        prior[FIRST_OF_CHANNELS..].fill(radians(20.0));
    }
    if model.mirror != Mirror::EllipticCone {
        // Without effect.
        prior[PLATFORM_PARAMETERS + 4] = 1.0;
    }
    // Pitch of the channels.
    for k in (FIRST_OF_CHANNELS + 2..MAX_PARAMETERS).step_by(3).filter(|_| model.facets == 1) {
        prior[k] = radians(2.0);
    }
    prior
}

/// Steps of numeric derivatives.
fn increments(duration: f64) -> [f64; MAX_PARAMETERS] {
    let t = duration.max(1.0);
    let rate = 1e-7 / t;
    let mut step = [1e-7; MAX_PARAMETERS];
    (step[0], step[1], step[6]) = (1e-3, 1e-3, 1e-3);
    (step[2], step[3], step[7]) = (1e-3 / t, 1e-3 / t, 1e-3 / t);
    (step[4], step[5]) = (1e-3 / (t * t), 1e-3 / (t * t));
    step[PLATFORM_PARAMETERS + 1] = rate;
    step
}

/// Number of residuals of a pulse.
const RESIDUALS: usize = 5;

/// Residuals of a pulse: on the ground (m), of the scan angle (rad), and at the height of its last return
/// (m), if it has several.
///
/// An angle that is rounded to degrees has no residual within the rounding: what is beyond it counts.
fn residuals(recording: &Recording, model: &Model, attitude: &Attitude, i: usize) -> [f64; RESIDUALS] {
    let pulse = &recording.pulses[i];
    let channel = usize::from(pulse.channel);
    let at = model.footprint(attitude, channel, pulse.time, pulse.position.z);
    let mut angle = at.angle - pulse.angle;
    if recording.has_whole_angles() {
        angle -= angle.clamp(-0.5 * recording.angle_step, 0.5 * recording.angle_step);
    }
    let (x, y) = pulse.last.map_or((0.0, 0.0), |last| {
        let at = model.footprint(attitude, channel, pulse.time, last.z);
        (at.x - last.x, at.y - last.y)
    });
    [at.x - pulse.position.x, at.y - pulse.position.y, angle, x, y]
}

/// The normal equations, reduced to what is needed of them.
struct Normal {
    /// Blocks of the attitudes on the diagonal.
    diagonal: Vec<Matrix3<f64>>,
    /// Attitudes times parameters.
    mixed: Vec<Matrix3xX<f64>>,
    /// Right sides of the attitudes.
    right: Vec<Vector3<f64>>,
    parameters: DMatrix<f64>,
    right_parameters: DVector<f64>,
    cost: f64,
}

/// Fits a model to a recording from a first guess. Attitudes of sections are estimated if `has_attitudes`.
pub fn solve(recording: &Recording, first: &Model, sections: &[Section], has_attitudes: bool) -> Solution {
    let mut model = first.clone();
    let mut attitudes = vec![[0.0; 3]; sections.len()];
    // Variance per second of the random walk: roll, pitch, yaw.
    let mut walk = [1e-5, 1e-5, 1e-4];
    let (mut ground, mut angle) = spreads(recording, &model, sections, &attitudes);
    let mut deviations = [f64::INFINITY; MAX_PARAMETERS];
    let mut damping = 1e-3;
    let mut latest = f64::INFINITY;
    // A flight that does not meet the angles of the file would explain itself by their errors: its motion is
    // taken for that of the mirror, or the other way round. Their errors are taken as small until the flight
    // that meets them best is found.
    let mut is_strict = has_attitudes;
    if is_strict {
        angle = min_angle(recording);
    }
    for number in 0..MAX_STEPS {
        let mut normal = normal_equations(recording, &model, sections, &attitudes, ground, angle);
        add_priors(&mut normal, &model, &attitudes, sections, &walk, has_attitudes);
        let Some(step) = reduce(&normal, sections, &walk, damping, has_attitudes) else { break };
        let mut next = model.clone();
        for (value, change) in next.parameters.iter_mut().zip(step.parameters.iter()) {
            *value += change;
        }
        let mut next_attitudes = attitudes.clone();
        if has_attitudes {
            for (attitude, change) in next_attitudes.iter_mut().zip(&step.attitudes) {
                (0..3).for_each(|k| attitude[k] += change[k]);
            }
        }
        let mut after = normal_cost(recording, &next, sections, &next_attitudes, ground, angle);
        after += prior_cost(&next, &next_attitudes, sections, &walk, has_attitudes);
        if after > normal.cost * (1.0 + 1e-9) {
            damping *= 10.0;
            if damping > 1e9 {
                break;
            }
            continue;
        }
        damping = (damping * 0.2).max(1e-12);
        (model, attitudes, deviations) = (next, next_attitudes, step.deviations);
        let change = (latest - after).abs() / after.max(1e-12);
        latest = after;
        let before = ground;
        let of_angle;
        (ground, of_angle) = spreads(recording, &model, sections, &attitudes);
        if has_attitudes {
            walk = step.walk(&attitudes, sections, &walk);
        }
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
    let (residual, angle_residual) = spreads(recording, &model, sections, &attitudes);
    let times = sections.iter().map(|section| section.time).collect();
    Solution { model, deviations, times, attitudes, residual, angle_residual }
}

/// Robust standard deviations of the residuals on the ground and of the scan angle.
fn spreads(recording: &Recording, model: &Model, sections: &[Section], attitudes: &[Attitude]) -> (f64, f64) {
    let (mut ground, mut angle) = (Vec::new(), Vec::new());
    for (section, attitude) in sections.iter().zip(attitudes) {
        for i in &section.pulses {
            let r = residuals(recording, model, attitude, *i);
            ground.push(r[0].abs());
            ground.push(r[1].abs());
            angle.push(r[2].abs());
        }
    }
    ((1.4826 * median(ground)).max(0.005), (1.4826 * median(angle)).max(min_angle(recording)))
}

/// Least standard deviation of scan angles: that of their step, or of what lies beyond the rounding to
/// degrees.
fn min_angle(recording: &Recording) -> f64 {
    radians(if recording.has_whole_angles() { 0.1 } else { 0.01 })
}

/// Weight of a residual of `ratio` standard deviations, and its share of the cost.
fn huber(ratio: f64) -> (f64, f64) {
    let size = ratio.abs();
    if size <= HUBER { (1.0, ratio * ratio) } else { (HUBER / size, HUBER * (2.0 * size - HUBER)) }
}

/// Standard deviations of the residuals of a pulse.
fn scales(ground: f64, angle: f64) -> [f64; RESIDUALS] {
    [ground, ground, angle, ground, ground]
}

fn normal_cost(
    recording: &Recording,
    model: &Model,
    sections: &[Section],
    attitudes: &[Attitude],
    ground: f64,
    angle: f64,
) -> f64 {
    let mut cost = 0.0;
    for (section, attitude) in sections.iter().zip(attitudes) {
        let share = (SECTION_WEIGHT / section.pulses.len() as f64).min(1.0);
        for i in &section.pulses {
            let r = residuals(recording, model, attitude, *i);
            let scaled = r.iter().zip(scales(ground, angle)).map(|(r, scale)| huber(r / scale).1);
            cost += share * scaled.sum::<f64>();
        }
    }
    cost
}

fn normal_equations(
    recording: &Recording,
    model: &Model,
    sections: &[Section],
    attitudes: &[Attitude],
    ground: f64,
    angle: f64,
) -> Normal {
    let count = model.count();
    let step = increments(recording.duration());
    let shifted: Vec<Model> = (0..count)
        .map(|k| {
            let mut shifted = model.clone();
            shifted.parameters[k] += step[k];
            shifted
        })
        .collect();
    let mut normal = Normal {
        diagonal: vec![Matrix3::zeros(); sections.len()],
        mixed: vec![Matrix3xX::zeros(count); sections.len()],
        right: vec![Vector3::zeros(); sections.len()],
        parameters: DMatrix::zeros(count, count),
        right_parameters: DVector::zeros(count),
        cost: 0.0,
    };
    let scale = scales(ground, angle);
    for (k, (section, attitude)) in sections.iter().zip(attitudes).enumerate() {
        let share = (SECTION_WEIGHT / section.pulses.len() as f64).min(1.0);
        for i in &section.pulses {
            let base = residuals(recording, model, attitude, *i);
            let by_parameter: Vec<[f64; RESIDUALS]> =
                shifted.iter().map(|model| residuals(recording, model, attitude, *i)).collect();
            let by_attitude: [[f64; RESIDUALS]; 3] = std::array::from_fn(|axis| {
                let mut shifted = *attitude;
                shifted[axis] += 1e-7;
                residuals(recording, model, &shifted, *i)
            });
            let count_of = if recording.pulses[*i].last.is_some() { RESIDUALS } else { 3 };
            for j in 0..count_of {
                let ratio = base[j] / scale[j];
                let (weight, cost) = huber(ratio);
                let weight = weight * share;
                normal.cost += share * cost;
                let of_parameters =
                    DVector::from_fn(count, |c, _| (by_parameter[c][j] - base[j]) / (step[c] * scale[j]));
                let of_attitude =
                    Vector3::from_fn(|axis, _| (by_attitude[axis][j] - base[j]) / (1e-7 * scale[j]));
                normal.parameters.syger(weight, &of_parameters, &of_parameters, 1.0);
                normal.right_parameters.axpy(-weight * ratio, &of_parameters, 1.0);
                normal.diagonal[k] += weight * of_attitude * of_attitude.transpose();
                normal.mixed[k] += weight * of_attitude * of_parameters.transpose();
                normal.right[k] -= weight * ratio * of_attitude;
            }
        }
    }
    normal.parameters.fill_upper_triangle_with_lower_triangle();
    normal
}

/// Precisions of the random walk between two sections.
fn walk_precision(before: &Section, after: &Section, walk: &[f64; 3]) -> [f64; 3] {
    let interval = (after.time - before.time).max(1e-6);
    walk.map(|variance| 1.0 / (variance * interval))
}

fn prior_cost(
    model: &Model,
    attitudes: &[Attitude],
    sections: &[Section],
    walk: &[f64; 3],
    has_attitudes: bool,
) -> f64 {
    let prior = priors(model);
    let known = model.parameters.iter().zip(prior).take(model.count());
    let mut cost: f64 = known.map(|(value, deviation)| (value / deviation).powi(2)).sum();
    if has_attitudes {
        cost += attitudes.iter().flatten().map(|angle| (angle / ATTITUDE).powi(2)).sum::<f64>();
        for k in 1..sections.len() {
            let precision = walk_precision(&sections[k - 1], &sections[k], walk);
            for axis in 0..3 {
                cost += precision[axis] * (attitudes[k][axis] - attitudes[k - 1][axis]).powi(2);
            }
        }
    }
    cost
}

fn add_priors(
    normal: &mut Normal,
    model: &Model,
    attitudes: &[Attitude],
    sections: &[Section],
    walk: &[f64; 3],
    has_attitudes: bool,
) {
    let prior = priors(model);
    for (k, deviation) in prior.into_iter().enumerate().take(model.count()).filter(|(_, d)| d.is_finite()) {
        let precision = 1.0 / (deviation * deviation);
        normal.parameters[(k, k)] += precision;
        normal.right_parameters[k] -= precision * model.parameters[k];
    }
    if has_attitudes {
        for (k, attitude) in attitudes.iter().enumerate() {
            let neighbours = [k.checked_sub(1), Some(k + 1).filter(|next| *next < sections.len())];
            for axis in 0..3 {
                let mut precision = 1.0 / (ATTITUDE * ATTITUDE);
                let mut right = -precision * attitude[axis];
                for other in neighbours.into_iter().flatten() {
                    let (before, after) = (k.min(other), k.max(other));
                    let of_walk = walk_precision(&sections[before], &sections[after], walk)[axis];
                    precision += of_walk;
                    right -= of_walk * (attitude[axis] - attitudes[other][axis]);
                }
                normal.diagonal[k][(axis, axis)] += precision;
                normal.right[k][axis] += right;
            }
        }
    }
    normal.cost += prior_cost(model, attitudes, sections, walk, has_attitudes);
}

/// A step of the parameters and attitudes, with their covariances.
struct Step {
    parameters: DVector<f64>,
    attitudes: Vec<Vector3<f64>>,
    deviations: [f64; MAX_PARAMETERS],
    /// Variances of the attitudes' changes from section to section.
    change_variances: Vec<Vector3<f64>>,
}

impl Step {
    /// Variances per second of the random walk that these attitudes and their uncertainties suggest.
    fn walk(&self, attitudes: &[Attitude], sections: &[Section], before: &[f64; 3]) -> [f64; 3] {
        let mut walk = *before;
        for axis in 0..3 {
            let (mut sum, mut count) = (0.0, 0.0);
            for k in 1..sections.len() {
                let interval = (sections[k].time - sections[k - 1].time).max(1e-6);
                let change = attitudes[k][axis] - attitudes[k - 1][axis];
                sum += (change * change + self.change_variances[k - 1][axis]) / interval;
                count += 1.0;
            }
            if count > 0.0 {
                walk[axis] = (sum / count).clamp(1e-12, 1.0);
            }
        }
        walk
    }
}

/// Eliminates the attitudes and solves for the parameters; `None` for equations without a solution.
fn reduce(
    normal: &Normal,
    sections: &[Section],
    walk: &[f64; 3],
    damping: f64,
    has_attitudes: bool,
) -> Option<Step> {
    let count = normal.right_parameters.len();
    let mut reduced = normal.parameters.clone();
    let mut right = normal.right_parameters.clone();
    // Forward: D_k = A_k − E D⁻¹ E, with E = −precision of the walk; likewise for the right sides.
    let (mut inverses, mut sides, mut links) = (Vec::new(), Vec::new(), Vec::new());
    if has_attitudes {
        for k in 0..sections.len() {
            let mut block = normal.diagonal[k];
            let mut side = Matrix3xX::zeros(count + 1);
            side.columns_mut(0, count).copy_from(&normal.mixed[k]);
            side.column_mut(count).copy_from(&normal.right[k]);
            if k > 0 {
                let precision = Vector3::from(walk_precision(&sections[k - 1], &sections[k], walk));
                let link = Matrix3::from_diagonal(&-precision);
                let inverse: &Matrix3<f64> = &inverses[k - 1];
                let before: &Matrix3xX<f64> = &sides[k - 1];
                block -= link * inverse * link;
                side -= link * inverse * before;
                links.push(link);
            }
            inverses.push(block.try_inverse()?);
            sides.push(side);
        }
        for k in 0..sections.len() {
            let of_parameters = sides[k].columns(0, count).into_owned();
            let weighted = inverses[k] * &sides[k];
            let product = of_parameters.transpose() * weighted;
            reduced -= product.columns(0, count);
            right -= product.column(count);
        }
    }
    // Parameters have different units: scale by the diagonal.
    let scale = DVector::from_fn(count, |k, _| 1.0 / reduced[(k, k)].max(1e-300).sqrt());
    let mut scaled = DMatrix::from_fn(count, count, |i, j| reduced[(i, j)] * scale[i] * scale[j]);
    (0..count).for_each(|k| scaled[(k, k)] += damping);
    let cholesky = scaled.cholesky()?;
    let parameters = cholesky.solve(&right.component_mul(&scale)).component_mul(&scale);
    let covariance = cholesky.inverse();
    let mut deviations = [0.0; MAX_PARAMETERS];
    for k in 0..count {
        deviations[k] = covariance[(k, k)].max(0.0).sqrt() * scale[k];
    }
    let mut attitudes = vec![Vector3::zeros(); sections.len()];
    let mut change_variances = vec![Vector3::zeros(); sections.len().saturating_sub(1)];
    if has_attitudes {
        let mut covariance = Matrix3::zeros();
        for k in (0..sections.len()).rev() {
            let mut side = sides[k].column(count) - sides[k].columns(0, count) * &parameters;
            let own = inverses[k];
            if k + 1 < sections.len() {
                side -= links[k] * attitudes[k + 1];
                let gain = -own * links[k];
                let cross = gain * covariance;
                let here = own + gain * covariance * gain.transpose();
                change_variances[k] = (here + covariance - cross - cross.transpose()).diagonal();
                covariance = here;
            } else {
                covariance = own;
            }
            attitudes[k] = own * side;
        }
    }
    Some(Step { parameters, attitudes, deviations, change_variances })
}
