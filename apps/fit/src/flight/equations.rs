//! Normal equations of a flight: the derivatives of its residuals, summed over the pulses of all sections.
//!
//! Blocks of sections are computed on all threads. Their sums are added in the order of the sections, so that
//! results do not depend on the number of threads.

use super::model::{Attitude, Model, Posed, Prepared};
use super::recording::Recording;
use super::residuals::{RESIDUALS, beam_of, huber, residuals, scales};
use super::sections::Section;
use rayon::prelude::*;
use vlscan_geom::{DMat3, DVec3, LeastSquares, median, radians};

/// Number of sections of a block.
const BLOCK: usize = 16;
/// Change of an attitude for numeric derivatives, rad.
const ATTITUDE_STEP: f64 = 1e-7;

/// Normal equations of the parameters and of the attitudes of all sections.
pub struct Normal {
    pub sections: Vec<SectionEquations>,
    pub parameters: LeastSquares,
    pub cost: f64,
}

/// Part of the normal equations that holds the attitude of a section.
#[derive(Clone)]
pub struct SectionEquations {
    /// Block on the diagonal.
    pub matrix: DMat3,
    /// Block of attitude times parameters: a column for each parameter.
    pub mixed: Vec<DVec3>,
    pub right: DVec3,
}

impl SectionEquations {
    fn new(parameters: usize) -> SectionEquations {
        SectionEquations { matrix: DMat3::ZERO, mixed: vec![DVec3::ZERO; parameters], right: DVec3::ZERO }
    }

    /// Adds an observation: its derivatives by the attitude and by the parameters, its value and its weight.
    fn add(&mut self, of_attitude: DVec3, of_parameters: &[f64], value: f64, weight: f64) {
        let weighted = weight * of_attitude;
        self.matrix +=
            DMat3::from_cols(weighted * of_attitude.x, weighted * of_attitude.y, weighted * of_attitude.z);
        for (column, derivative) in self.mixed.iter_mut().zip(of_parameters) {
            *column += weighted * *derivative;
        }
        self.right += value * weighted;
    }
}

/// The model after a step of its estimated parameters.
pub fn moved(model: &Model, step: &[f64]) -> Model {
    let values = model.parameters.to_vector(model.mirror);
    let values: Vec<f64> = values.iter().zip(step).map(|(value, change)| value + change).collect();
    let mut parameters = model.parameters.with_vector(model.mirror, &values);
    if model.has_channels() {
        parameters.balance_channels();
    }
    Model { mirror: model.mirror, parameters }
}

/// The model after the step of each parameter alone.
fn shifted(model: &Model, steps: &[f64]) -> Vec<Model> {
    let alone = |k: usize| {
        let step: Vec<f64> = (0..steps.len()).map(|other| if other == k { steps[k] } else { 0.0 }).collect();
        moved(model, &step)
    };
    (0..steps.len()).map(alone).collect()
}

/// Robust standard deviations of the residuals on the ground and of the scan angle. Attitudes, one for each
/// section, are vectors of roll, pitch and yaw, rad.
pub fn spreads(
    recording: &Recording,
    model: &Model,
    sections: &[Section],
    attitudes: &[DVec3],
) -> (f64, f64) {
    let prepared = Prepared::of(model);
    let of_section = |(section, attitude): (&Section, &DVec3)| -> Vec<[f64; 3]> {
        let model = prepared.at(&Attitude::from_vector(*attitude));
        let of_pulse = |i: usize| {
            let pulse = recording.pulses.get(i);
            let [x, y, angle, ..] = residuals(recording, &model, beam_of(&model, &pulse), &pulse);
            [x.abs(), y.abs(), angle.abs()]
        };
        section.pulses().map(of_pulse).collect()
    };
    let sections = sections.par_iter().zip(attitudes).with_min_len(BLOCK);
    let all: Vec<Vec<[f64; 3]>> = sections.map(of_section).collect();
    let ground = median(all.iter().flatten().flat_map(|r| [r[0], r[1]]));
    let angle = median(all.iter().flatten().map(|r| r[2]));
    let spread = |median: Option<f64>| 1.4826 * median.unwrap_or(0.0);
    (spread(ground).max(0.005), spread(angle).max(min_angle(recording)))
}

/// Minimum standard deviation of scan angles: that of their step, or of residuals beyond the rounding to
/// degrees.
pub fn min_angle(recording: &Recording) -> f64 {
    radians(if recording.has_whole_angles() { 0.1 } else { 0.01 })
}

/// Cost of the residuals of a model, as that of its [`normal_equations`].
pub fn normal_cost(
    recording: &Recording,
    model: &Model,
    sections: &[Section],
    attitudes: &[DVec3],
    ground: f64,
    angle: f64,
) -> f64 {
    let prepared = Prepared::of(model);
    let of_section = |(section, attitude): (&Section, &DVec3)| {
        let model = prepared.at(&Attitude::from_vector(*attitude));
        let of_pulse = |i: usize| {
            let pulse = recording.pulses.get(i);
            let r = residuals(recording, &model, beam_of(&model, &pulse), &pulse);
            let scaled = r.iter().zip(scales(ground, angle)).map(|(r, scale)| huber(r / scale).1);
            scaled.sum::<f64>()
        };
        section.share() * section.pulses().map(of_pulse).sum::<f64>()
    };
    let sections = sections.par_iter().zip(attitudes).with_min_len(BLOCK);
    let costs: Vec<f64> = sections.map(of_section).collect();
    costs.iter().sum()
}

/// The normal equations of a model. `steps` are those of the parameters for numeric derivatives.
pub fn normal_equations(
    recording: &Recording,
    model: &Model,
    steps: &[f64],
    sections: &[Section],
    attitudes: &[DVec3],
    ground: f64,
    angle: f64,
) -> Normal {
    let prepared = Prepared::of(model);
    let shifted: Vec<Model> = shifted(model, steps);
    let shifted: Vec<Prepared> = shifted.iter().map(Prepared::of).collect();
    let derivatives = Derivatives {
        recording,
        // Most steps leave the beams of the scanner as they are.
        keep_beams: shifted.iter().map(|model| model.has_beams_of(&prepared)).collect(),
        prepared,
        shifted,
        steps,
        scale: scales(ground, angle),
    };
    let blocks = sections.par_chunks(BLOCK).zip(attitudes.par_chunks(BLOCK));
    let blocks: Vec<Normal> =
        blocks.map(|(sections, attitudes)| derivatives.equations(sections, attitudes)).collect();
    let mut normal = Normal::new(steps.len());
    blocks.into_iter().for_each(|block| normal.append(block));
    normal
}

impl Normal {
    /// Equations of so many parameters, without sections.
    fn new(parameters: usize) -> Normal {
        Normal { sections: Vec::new(), parameters: LeastSquares::new(parameters), cost: 0.0 }
    }

    /// Adds the equations of the sections that follow.
    fn append(&mut self, block: Normal) {
        self.sections.extend(block.sections);
        self.parameters.add_sums(&block.parameters);
        self.cost += block.cost;
    }
}

/// A model, and the models by which its derivatives are computed.
struct Derivatives<'m> {
    recording: &'m Recording,
    prepared: Prepared<'m>,
    /// The model after the step of each parameter alone.
    shifted: Vec<Prepared<'m>>,
    /// True for steps that leave the beams of the scanner as they are.
    keep_beams: Vec<bool>,
    steps: &'m [f64],
    /// Standard deviations of the residuals.
    scale: [f64; RESIDUALS],
}

impl Derivatives<'_> {
    /// The equations of a block of sections.
    fn equations(&self, sections: &[Section], attitudes: &[DVec3]) -> Normal {
        let mut normal = Normal::new(self.steps.len());
        for (section, attitude) in sections.iter().zip(attitudes) {
            let equations = self.add_section(section, *attitude, &mut normal);
            normal.sections.push(equations);
        }
        normal
    }

    /// Adds the pulses of a section to the parameters and the cost; returns the equations of its attitude.
    fn add_section(&self, section: &Section, attitude: DVec3, normal: &mut Normal) -> SectionEquations {
        let (recording, scale, share) = (self.recording, self.scale, section.share());
        let mut equations = SectionEquations::new(self.steps.len());
        let mut of_parameters = vec![0.0; self.steps.len()];
        let mut by_parameter: Vec<[f64; RESIDUALS]> = Vec::with_capacity(self.steps.len());
        let at = |attitude: DVec3| self.prepared.at(&Attitude::from_vector(attitude));
        let here = at(attitude);
        let turned = DVec3::AXES.map(|axis| at(attitude + ATTITUDE_STEP * axis));
        let of_section = Attitude::from_vector(attitude);
        let shifted: Vec<Posed> = self.shifted.iter().map(|model| model.at(&of_section)).collect();
        for pulse in section.pulses().map(|i| recording.pulses.get(i)) {
            let beam = beam_of(&here, &pulse);
            let base = residuals(recording, &here, beam, &pulse);
            by_parameter.clear();
            by_parameter.extend(shifted.iter().zip(&self.keep_beams).map(|(model, keeps_beam)| {
                let beam = if *keeps_beam { beam } else { beam_of(model, &pulse) };
                residuals(recording, model, beam, &pulse)
            }));
            let by_attitude = turned.map(|model| residuals(recording, &model, beam, &pulse));
            let count_of = if pulse.last.is_some() { RESIDUALS } else { 3 };
            for j in 0..count_of {
                let ratio = base[j] / scale[j];
                let (weight, cost) = huber(ratio);
                let weight = weight * share;
                normal.cost += share * cost;
                for ((derivative, shifted), step) in
                    of_parameters.iter_mut().zip(&by_parameter).zip(self.steps)
                {
                    *derivative = (shifted[j] - base[j]) / (step * scale[j]);
                }
                let of_attitude = DVec3::from(
                    by_attitude.map(|shifted| (shifted[j] - base[j]) / (ATTITUDE_STEP * scale[j])),
                );
                normal.parameters.add(&of_parameters, -ratio, weight);
                equations.add(of_attitude, &of_parameters, -ratio, weight);
            }
        }
        equations
    }
}
