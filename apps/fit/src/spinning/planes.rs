//! Planes in an image of ranges: patches of neighbouring pixels, fitted by one half of the columns.

use super::image::{Pixel, RangeImage};
use libm::sqrt;
use vlscan_geom::{DVec3, LeastSquares, ScaledCholesky, median};

/// Pixels of a patch: rows and columns.
pub(super) const PATCH: [usize; 2] = [4, 8];
/// Minimum number of echoes of the half that is fitted, and their minimum share.
const MIN_ECHOES: usize = 8;
const MIN_SHARE: f64 = 0.6;
/// Scatters beyond which a residual does not count (Tukey's biweight).
const CUT: f64 = 5.0;
const ITERATIONS: usize = 10;
/// Minimum share of the echoes within the cut.
const MIN_KEPT: f64 = 0.9;
/// Minimum scatter, m.
const MIN_SCATTER: f64 = 1e-4;
/// Cosine of the angle of incidence below which a plane is not fitted: 80°.
const MIN_COSINE: f64 = 0.17;
/// Scatter of normal residuals over the median of their absolute values.
pub(super) const NORMAL_MEDIAN: f64 = 1.4826;

/// A plane through a patch of pixels: the points p with normal·p = 1.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Normal over the distance of the plane from the sensor, 1/m.
    pub normal: DVec3,
    /// Its pixels.
    pub samples: Vec<Sample>,
    /// Standard deviation of the ranges around the plane, of the half that was fitted, m.
    pub scatter: f64,
    /// Degrees of freedom of the scatter.
    pub freedom: f64,
    /// Medians of range (m), cosine of the angle of incidence, strength and reflectance of the half that was
    /// fitted.
    pub range: f64,
    /// See [`Patch::range`].
    pub cosine: f64,
    /// See [`Patch::range`].
    pub strength: f64,
    /// See [`Patch::range`]; NaN for retroreflectors.
    pub reflectance: f64,
}

/// A pixel of a patch.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Range of the plane along the beam, m.
    pub expected: f64,
    /// Recorded minus expected range, m; NaN without an echo.
    pub residual: f64,
    /// Variance of the expected range over that of a range.
    pub leverage: f64,
    /// True if the sample's column is in the fitted half.
    pub is_fitted: bool,
    /// Point of the plane, m.
    pub point: DVec3,
}

/// The patches of an image that are planes in the half of the columns for which `is_fitted` is true.
pub fn planes(image: &RangeImage, is_fitted: impl Fn(u32) -> bool) -> Vec<Patch> {
    let [high, wide] = PATCH;
    let mut patches = Vec::new();
    for row in (0..image.rows).step_by(high).filter(|row| row + high <= image.rows) {
        for column in (0..image.columns).step_by(wide).filter(|column| column + wide <= image.columns) {
            let of_patch = (row..row + high).flat_map(|r| {
                let first = r * image.columns + column;
                &image.pixels[first..first + wide]
            });
            let pixels: Vec<(Pixel, bool)> = of_patch.map(|p| (*p, is_fitted(p.column))).collect();
            patches.extend(plane(&pixels));
        }
    }
    patches
}

fn plane(pixels: &[(Pixel, bool)]) -> Option<Patch> {
    let fitted = || pixels.iter().filter(|(_, is_fitted)| *is_fitted).map(|(pixel, _)| pixel);
    let seen: Vec<&Pixel> = fitted().filter(|pixel| pixel.is_seen()).collect();
    if seen.len() < MIN_ECHOES || (seen.len() as f64) < MIN_SHARE * fitted().count() as f64 {
        return None;
    }
    let Plane { normal, kept, squares, decomposition } = Plane::through(&seen)?;
    if kept < MIN_ECHOES || (kept as f64) < MIN_KEPT * seen.len() as f64 {
        return None;
    }
    // Variance of a value with this derivative, over that of an observation.
    let variance = |by: DVec3| by.dot(DVec3::from_slice(&decomposition.solve(&by.to_array())));
    let samples: Vec<Sample> = pixels
        .iter()
        .map(|(pixel, is_fitted)| {
            let expected = expected(pixel, normal);
            Sample {
                expected,
                residual: pixel.range - expected,
                leverage: variance(slope(pixel, normal)),
                is_fitted: *is_fitted,
                point: pixel.origin + pixel.direction * expected,
            }
        })
        .collect();
    let cosine = |pixel: &Pixel| (pixel.direction.dot(normal) / normal.length()).abs();
    if samples.iter().any(|s| s.expected.is_nan() || s.expected <= 0.0 || !s.leverage.is_finite())
        || pixels.iter().any(|(pixel, _)| cosine(pixel) < MIN_COSINE)
    {
        return None;
    }
    let freedom = kept as f64 - 3.0;
    Some(Patch {
        normal,
        scatter: sqrt(squares / freedom).max(MIN_SCATTER),
        freedom,
        range: median_of_numbers(seen.iter().map(|p| p.range)),
        cosine: median_of_numbers(seen.iter().map(|p| cosine(p))),
        strength: median_of_numbers(seen.iter().map(|p| p.strength)),
        reflectance: median_of_numbers(seen.iter().map(|p| p.reflectance)),
        samples,
    })
}

/// Plane n·p = 1 through the points of pixels.
struct Plane {
    normal: DVec3,
    /// Number of echoes within the cut.
    kept: usize,
    /// Sum of their squared residuals, m².
    squares: f64,
    decomposition: ScaledCholesky,
}

impl Plane {
    /// Robust least squares of the ranges. `None` if the points do not determine a plane.
    fn through(seen: &[&Pixel]) -> Option<Plane> {
        let middle = median_of_numbers(seen.iter().map(|p| p.range));
        // By distances from the origin first, then by ranges, where residuals beyond the cut have no weight.
        let mut sums = LeastSquares::new(3);
        for pixel in seen {
            let point = (pixel.origin + pixel.direction * pixel.range) / middle;
            sums.add(&point.to_array(), 1.0, 1.0);
        }
        let mut normal = DVec3::from_slice(&sums.solution()?) / middle;
        let (mut kept, mut squares) = (0, 0.0);
        for _ in 0..ITERATIONS {
            let residuals: Vec<f64> = seen.iter().map(|p| p.range - expected(p, normal)).collect();
            let scatter = NORMAL_MEDIAN * median_of_numbers(residuals.iter().map(|r| r.abs()));
            let cut = CUT * scatter.max(MIN_SCATTER);
            (sums, kept, squares) = (LeastSquares::new(3), 0, 0.0);
            for (pixel, residual) in seen.iter().zip(residuals) {
                let off = residual / cut;
                if off.is_nan() || off.abs() >= 1.0 {
                    continue;
                }
                let weight = (1.0 - off * off) * (1.0 - off * off);
                sums.add(&slope(pixel, normal).to_array(), residual, weight);
                (kept, squares) = (kept + 1, squares + residual * residual);
            }
            normal += DVec3::from_slice(&sums.solution()?);
            if !normal.is_finite() {
                return None;
            }
        }
        Some(Plane { normal, kept, squares, decomposition: sums.matrix.scaled_cholesky(0.0, 0.0)? })
    }
}

/// Range at which a beam meets the plane, m.
fn expected(pixel: &Pixel, normal: DVec3) -> f64 {
    (1.0 - pixel.origin.dot(normal)) / pixel.direction.dot(normal)
}

/// Change of that range with the normal.
fn slope(pixel: &Pixel, normal: DVec3) -> DVec3 {
    (pixel.origin + pixel.direction * expected(pixel, normal)) * (-1.0 / pixel.direction.dot(normal))
}

/// Median of the values that are numbers; NaN for none.
pub(super) fn median_of_numbers(values: impl Iterator<Item = f64>) -> f64 {
    median(values.filter(|value| !value.is_nan())).unwrap_or(f64::NAN)
}
