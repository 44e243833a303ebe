//! A fitted flight, and how well its height is known.

use super::model::{Attitude, Model};
use super::parameters::Parameters;
use super::recording::Recording;
use vlscan_geom::median;

/// Minimum difference in height between returns of a pulse that determine the direction of its beam, m.
pub const MIN_DEPTH: f64 = 3.0;
/// Minimum error of the positions of points, m.
const MIN_PLACE_ERROR: f64 = 0.01;

/// A fitted flight.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The model.
    pub model: Model,
    /// Standard deviations of its parameters.
    pub deviations: Parameters,
    /// Mean times of the sections, s.
    pub times: Vec<f64>,
    /// Their attitudes.
    pub attitudes: Vec<Attitude>,
    /// Robust standard deviation of the residuals on the ground, m.
    pub residual: f64,
    /// Robust standard deviation of the residuals of the scan angle, rad.
    pub angle_residual: f64,
}

impl Solution {
    /// True if any section of the recording determines the solution. A guess whose mirror turns within a few
    /// pulses has none, and no residuals.
    pub fn has_sections(&self) -> bool {
        !self.times.is_empty()
    }

    /// Unexplained part of the points, m on the ground: residuals, and changes of the attitude from section
    /// to section.
    pub fn unexplained(&self) -> f64 {
        let height = self.model.parameters.position.z.abs();
        let change = |pair: &[Attitude]| (pair[1].to_vector() - pair[0].to_vector()).length_squared();
        let changes: f64 = self.attitudes.windows(2).map(change).sum();
        self.residual + height * (changes / self.attitudes.len().max(1) as f64).sqrt()
    }

    /// Root mean square of the attitudes of all sections, rad.
    pub fn attitude_spread(&self) -> f64 {
        let squares: f64 = self.attitudes.iter().map(|attitude| attitude.to_vector().length_squared()).sum();
        (squares / self.attitudes.len().max(1) as f64).sqrt()
    }

    /// Relative standard deviation of height and mirror angle by an error that all scan angles have in common
    /// and that grows across the track. It is assumed to be as large as their residual, or as the error of
    /// angles that are rounded to degrees. For rounded angles, pulses of several returns also determine the
    /// height.
    pub fn scale_deviation(&self, recording: &Recording) -> f64 {
        if !recording.has_whole_angles() {
            return self.angle_residual / recording.angle_spread();
        }
        let rounding = recording.angle_step / 12f64.sqrt();
        let of_angles = self.angle_residual.max(rounding) / recording.angle_spread();
        1.0 / (1.0 / (of_angles * of_angles) + self.scale_by_returns(recording)).sqrt()
    }

    /// Information about the height in pulses of several returns: reciprocal of its relative variance.
    ///
    /// The way from the first to the last return has the tangent of the beam's angle, which grows across the
    /// track with the reciprocal of the height. The errors of a line are taken as one error, since its pulses
    /// share the attitude.
    fn scale_by_returns(&self, recording: &Recording) -> f64 {
        let (mut lines, mut errors) = (Vec::new(), Vec::new());
        for line in &recording.lines {
            let (mut tangents, mut depths, mut count) = (0.0, 0.0, 0.0);
            for pulse in recording.pulses.range(line.clone()) {
                let Some(last) = pulse.last.filter(|last| pulse.position.z - last.z > MIN_DEPTH) else {
                    continue;
                };
                let at = self.model.footprint(
                    &self.attitude(pulse.time),
                    usize::from(pulse.channel),
                    pulse.time,
                    last.z,
                );
                errors.extend([(at.x - last.x).abs(), (at.y - last.y).abs()]);
                tangents += libm::tan(at.angle);
                depths += pulse.position.z - last.z;
                count += 1.0;
            }
            if count > 0.0 {
                lines.push((tangents / count, depths / count));
            }
        }
        let error = (1.4826 * median(errors).unwrap_or(0.0)).max(MIN_PLACE_ERROR);
        let middle = lines.iter().map(|line| line.0).sum::<f64>() / lines.len().max(1) as f64;
        // The error of a tangent is that of both places over the depth.
        lines.iter().map(|(tangent, depth)| ((tangent - middle) * depth / error).powi(2) / 2.0).sum()
    }

    /// Attitude at `time`: linear between the sections' means, constant before the first and after the last.
    pub fn attitude(&self, time: f64) -> Attitude {
        let after = self.times.partition_point(|t| *t <= time);
        match (after.checked_sub(1), self.times.get(after)) {
            (Some(before), Some(next)) => {
                let share = (time - self.times[before]) / (next - self.times[before]);
                let (a, b) = (self.attitudes[before].to_vector(), self.attitudes[after].to_vector());
                Attitude::from_vector(a + share * (b - a))
            }
            (Some(before), None) => self.attitudes[before],
            (None, _) => self.attitudes.first().copied().unwrap_or_default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::mirror::Mirror;
    use super::*;
    use vlscan_geom::DVec3;

    /// A platform at 100 m that rolls from 0 to 0.02 rad between two sections, 2 s apart.
    fn rolling() -> Solution {
        let parameters = Parameters { position: DVec3::new(0.0, 0.0, 100.0), ..Parameters::default() };
        Solution {
            deviations: parameters.filled(0.0),
            model: Model { mirror: Mirror::Cone, parameters },
            times: vec![1.0, 3.0],
            attitudes: vec![Attitude::default(), Attitude { roll: 0.02, ..Attitude::default() }],
            residual: 0.5,
            angle_residual: 0.0,
        }
    }

    #[test]
    fn attitudes_are_linear_between_sections_and_constant_beyond() {
        let solution = rolling();
        for (time, roll) in [(0.0, 0.0), (1.0, 0.0), (1.5, 0.005), (2.0, 0.01), (3.0, 0.02), (9.0, 0.02)] {
            let found = solution.attitude(time);
            assert!((found.roll - roll).abs() < 1e-15 && found.pitch == 0.0 && found.yaw == 0.0, "{time}");
        }
        let still = Solution { times: Vec::new(), attitudes: Vec::new(), ..rolling() };
        assert_eq!(still.attitude(1.0), Attitude::default());
    }

    #[test]
    fn changes_of_the_attitude_count_as_metres_on_the_ground() {
        // Root mean square of the attitudes: 0.02 rad over √2 sections; of the changes too.
        let expected = 0.02 / f64::sqrt(2.0);
        assert!((rolling().attitude_spread() - expected).abs() < 1e-15);
        assert!((rolling().unexplained() - (0.5 + 100.0 * expected)).abs() < 1e-12);
    }
}
