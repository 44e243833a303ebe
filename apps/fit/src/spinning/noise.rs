//! The law of range noise from the scatter around planes.

use super::planes::{Patch, median_of_numbers};
use libm::{exp, log, sqrt};
use vlscan_geom::LeastSquares;
use vlscan_survey::RangeNoise;

/// Parts of the variance: constant, by photons, by the amplifier, by the footprint.
pub(super) const PARTS: usize = 4;
const ROUNDS: usize = 20;
/// Quantile of the scatters of planes beyond which a surface is not plane.
const NORMAL_QUANTILE: f64 = 2.326;
/// Noise of a good echo with which the search begins, m.
const FIRST_NOISE: f64 = 0.01;
/// Minimum share of patches that are planes, with which the search begins.
const FIRST_SHARE: f64 = 0.3;
/// Pivot, over its diagonal element, below which terms depend on each other.
const MIN_PIVOT: f64 = 1e-9;

/// The law of noise, and which patches are planes by it.
#[derive(Clone, Debug)]
pub(super) struct NoiseLaw {
    /// Coefficients of the variance, m² (that of the footprint without unit).
    pub parts: [f64; PARTS],
    /// Their standard deviations.
    pub deviations: [f64; PARTS],
    /// True if the scatter of each patch is that of a plane.
    pub is_plane: Vec<bool>,
}

/// Weakness of a strength (threshold over strength) and standard deviation of the depths within the footprint
/// of a beam of this divergence (rad): the terms in which the variance is linear.
fn terms(patch: &Patch, threshold: f64, divergence: f64) -> [f64; PARTS] {
    let weakness = (threshold / patch.strength).min(1.0);
    let tangent = sqrt((1.0 / (patch.cosine * patch.cosine) - 1.0).max(0.0));
    let depth = patch.range * divergence * 0.25 * tangent;
    [1.0, weakness, weakness * weakness, depth * depth]
}

fn dot(a: &[f64; PARTS], b: &[f64; PARTS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The law that fits most patches. Patches with more scatter than its noise explains are surfaces that are
/// not plane, and are ignored: least trimmed squares, with the limit by the distribution of χ².
pub(super) fn noise_law(patches: &[Patch], threshold: f64, divergence: f64) -> Option<NoiseLaw> {
    let rows: Vec<[f64; PARTS]> = patches.iter().map(|p| terms(p, threshold, divergence)).collect();
    let mut variances: Vec<f64> = rows.iter().map(|row| FIRST_NOISE * FIRST_NOISE + row[3]).collect();
    // The quietest share of the patches determines the first level.
    let mut ratios: Vec<f64> =
        patches.iter().zip(&variances).map(|(p, v)| p.scatter * p.scatter / v).collect();
    ratios.sort_by(f64::total_cmp);
    let level = *ratios.get((FIRST_SHARE * ratios.len() as f64) as usize)?;
    variances.iter_mut().for_each(|variance| *variance *= level);
    let mut law = None;
    for _ in 0..ROUNDS {
        let is_plane: Vec<bool> = patches
            .iter()
            .zip(&variances)
            .map(|(p, v)| p.scatter * p.scatter < v * chi_square_limit(p.freedom))
            .collect();
        let chosen: Vec<(&[f64; PARTS], f64, f64)> = patches
            .iter()
            .zip(&rows)
            .zip(variances.iter().zip(&is_plane))
            .filter(|(_, (_, is_plane))| **is_plane)
            .map(|((p, row), (v, _))| (row, p.scatter * p.scatter, p.freedom / (2.0 * v * v)))
            .collect();
        let (parts, deviations) = least_squares_not_negative(&chosen)?;
        variances = rows.iter().map(|row| dot(row, &parts)).collect();
        law = Some(NoiseLaw { parts, deviations, is_plane });
    }
    law
}

/// The 99 % quantile of χ² over its degrees of freedom (Wilson & Hilferty 1931).
fn chi_square_limit(freedom: f64) -> f64 {
    let part = 2.0 / (9.0 * freedom);
    let root = 1.0 - part + NORMAL_QUANTILE * sqrt(part);
    root * root * root
}

impl NoiseLaw {
    /// Standard deviation of a range on a patch, m.
    pub fn sigma(&self, patch: &Patch, threshold: f64, divergence: f64) -> f64 {
        sqrt(dot(&terms(patch, threshold, divergence), &self.parts))
    }

    /// The law as a setting of an instrument whose ranges come in steps (m). The observed noise includes
    /// their rounding, which is removed.
    pub fn range_noise(&self, range_step: f64) -> RangeNoise {
        let [constant, shot, amplifier, footprint] = self.parts;
        let constant = (constant - range_step * range_step / 12.0).max(0.0);
        RangeNoise {
            constant: sqrt(constant),
            shot: sqrt(shot),
            amplifier: sqrt(amplifier),
            footprint: sqrt(footprint),
        }
    }

    /// Standard deviations of the roots of the parts.
    pub fn root_deviations(&self) -> [f64; PARTS] {
        let root = |i: usize| match self.deviations[i] {
            0.0 => 0.0,
            deviation => deviation / (2.0 * sqrt(self.parts[i]).max(sqrt(deviation))),
        };
        std::array::from_fn(root)
    }
}

/// Weighted least squares without negative coefficients: the best of all choices of coefficients that are 0.
/// Each row has its terms, value and weight.
fn least_squares_not_negative(rows: &[(&[f64; PARTS], f64, f64)]) -> Option<([f64; PARTS], [f64; PARTS])> {
    let mut sums = LeastSquares::new(PARTS);
    for (terms, value, weight) in rows {
        sums.add(&terms[..], *value, *weight);
    }
    let mut best: Option<(f64, [f64; PARTS], [f64; PARTS])> = None;
    for choice in 1u32..1 << PARTS {
        let chosen: Vec<usize> = (0..PARTS).filter(|i| choice >> i & 1 == 1).collect();
        let Some(decomposition) = sums.matrix.principal(&chosen).scaled_cholesky(0.0, MIN_PIVOT) else {
            continue;
        };
        let right: Vec<f64> = chosen.iter().map(|i| sums.right[*i]).collect();
        let (solution, inverse) = (decomposition.solve(&right), decomposition.inverse());
        let (mut parts, mut deviations) = ([0.0; PARTS], [0.0; PARTS]);
        for (k, i) in chosen.iter().enumerate() {
            (parts[*i], deviations[*i]) = (solution[k], sqrt(inverse.at(k, k).max(0.0)));
        }
        if parts.iter().any(|part| *part < 0.0 || !part.is_finite()) {
            continue;
        }
        // Reduction of the sum of squares.
        let gain: f64 = parts.iter().zip(&sums.right).map(|(a, b)| a * b).sum();
        if best.as_ref().is_none_or(|(most, ..)| gain > *most) {
            best = Some((gain, parts, deviations));
        }
    }
    best.map(|(_, parts, deviations)| (parts, deviations))
}

/// Median of signal times squared range over reflectance: the strength of a white target at 1 m that faces
/// the beam.
pub(super) fn white_strength<'p>(patches: impl Iterator<Item = &'p Patch>) -> f64 {
    let logarithms = patches
        .filter(|p| p.reflectance > MIN_REFLECTANCE)
        .map(|p| log(p.strength * p.range * p.range / p.reflectance));
    exp(median_of_numbers(logarithms))
}

/// Reflectance below which whole per cent are too coarse.
const MIN_REFLECTANCE: f64 = 0.03;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_that_would_be_negative_are_zero() {
        // Values 2 + 3·w with weakness w, and others that fall with it.
        let rows: Vec<[f64; PARTS]> = (0..20).map(|k| [1.0, 0.05 * f64::from(k), 0.0, 0.0]).collect();
        let fitted = |value: &dyn Fn(f64) -> f64| {
            let rows: Vec<(&[f64; PARTS], f64, f64)> =
                rows.iter().map(|row| (row, value(row[1]), 4.0)).collect();
            least_squares_not_negative(&rows).unwrap()
        };
        let (parts, deviations) = fitted(&|w| 2.0 + 3.0 * w);
        assert!((parts[0] - 2.0).abs() < 1e-9 && (parts[1] - 3.0).abs() < 1e-9, "{parts:?}");
        assert!(deviations[0] > 0.0 && deviations[2..] == [0.0, 0.0], "{deviations:?}");
        let (parts, deviations) = fitted(&|w| 2.0 - w);
        assert!(parts[0] > 1.0 && parts[1..] == [0.0; 3], "{parts:?}");
        // 20 observations of weight 4.
        assert!((deviations[0] - sqrt(1.0 / 80.0)).abs() < 1e-12, "{deviations:?}");
        assert!(least_squares_not_negative(&[]).is_none());
    }
}
