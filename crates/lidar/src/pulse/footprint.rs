//! Patterns of subrays of equal energy across the footprint of a beam.
//!
//! The energy within a radius r of the footprint is F(r): 1 − e^(−2r²/w²) of a Gaussian beam of 1/e² radius
//! w, (r/w)² of a top hat. N subrays represent N annuli of equal energy. Each lies at the root mean square
//! radius of its annulus and is turned against the previous one by the golden angle (Vogel 1979, "A better
//! way to construct the sunflower head") or a similar one, so that the subrays spread evenly over radii and
//! directions: the share that an edge, a wire or a plate cuts off is accurate to a fraction of a subray.
//! Finally the pattern is moved and stretched by a few per cent so that its centre is on the axis and its
//! second moments are exactly the beam's in all directions. Then the mean range of a plane and the broadening
//! of its echo are exact for any number of subrays.
//!
//! The pattern is turned from pulse to pulse, so that targets missed by one pulse are hit by its neighbours.

use libm::{cos, log, sin};
use std::f64::consts::{PI, TAU};
use vlscan_survey::BeamProfile;

/// The distribution of a beam's energy over the angle off its axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Footprint {
    pub profile: BeamProfile,
    /// Half angle (rad) at which a Gaussian beam has fallen to 1/e², or a top hat ends: along x and along z
    /// of the beam frame.
    pub half_angles: [f64; 2],
    /// Radius of the beam where it leaves the instrument, m.
    pub exit_radius: f64,
}

/// A subray relative to the beam's axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Subray {
    /// Angles off the axis, rad, along x and z of the beam frame.
    pub angles: [f64; 2],
    /// Offset from the axis where it leaves the instrument, m, along x and z of the beam frame.
    pub exit: [f64; 2],
}

/// Number of patterns of beams with few subrays.
const PATTERNS: usize = 16;
/// Maximum number of subrays for more than one pattern. Larger patterns cover any footprint, and patterns
/// need memory.
const MAX_PATTERNED_SUBRAYS: usize = 1000;

/// `count` subrays of equal energy, for each pattern. A single subray is the axis.
///
/// A subray leaves the instrument at its angle, scaled and turned by 90° about the axis. So position and
/// angle are uncorrelated, and the squares of both radii add up as for a Gaussian beam from its waist on:
/// w(R)² = w(0)² + (R·θ/2)².
pub(super) fn patterns(beam: &Footprint, count: usize) -> impl Iterator<Item = Vec<Subray>> {
    let base = match count {
        1 => vec![[0.0; 2]],
        _ => with_exact_moments(spiral(beam.profile, count)),
    };
    let turns = if (2..=MAX_PATTERNED_SUBRAYS).contains(&count) { PATTERNS } else { 1 };
    let Footprint { half_angles, exit_radius, .. } = *beam;
    (0..turns).map(move |turn| {
        // Full turns, since the pattern has no symmetry.
        let (s, c) = (sin(TAU * turn as f64 / turns as f64), cos(TAU * turn as f64 / turns as f64));
        let subray = |[x, z]: &[f64; 2]| {
            let (x, z) = (c * x - s * z, s * x + c * z);
            Subray {
                angles: [x * half_angles[0], z * half_angles[1]],
                exit: [-z * exit_radius, x * exit_radius],
            }
        };
        base.iter().map(subray).collect()
    })
}

/// Points of a sunflower, in units of the beam's radius.
fn spiral(profile: BeamProfile, count: usize) -> Vec<[f64; 2]> {
    // The golden angle is best for many points. For 16 this angle resolves edges best among 2500 that were
    // tried.
    let twist = match count {
        16 => 1.7146,
        _ => PI * (3.0 - 5f64.sqrt()),
    };
    let point = |i: usize| {
        let (radius, angle) = (annulus_radius(profile, i, count), twist * i as f64);
        [radius * cos(angle), radius * sin(angle)]
    };
    (0..count).map(point).collect()
}

/// Root mean square radius of annulus `i` of `count` of equal energy, in units of the beam's radius.
fn annulus_radius(profile: BeamProfile, i: usize, count: usize) -> f64 {
    let n = count as f64;
    match profile {
        BeamProfile::TopHat => ((i as f64 + 0.5) / n).sqrt(),
        // With u = e^(−2r²), which is uniform over the energy, r² = −ln(u)/2 and ∫ ln u du = u ln u − u.
        BeamProfile::Gaussian => {
            let integral = |u: f64| if u > 0.0 { u * log(u) - u } else { 0.0 };
            let (inner, outer) = (1.0 - i as f64 / n, 1.0 - (i as f64 + 1.0) / n);
            let radius = (-0.5 * n * (integral(inner) - integral(outer))).sqrt();
            // The outermost annulus is infinite. Its subray lies at most at the inner edge.
            radius.min((0.5 * log(n)).sqrt())
        }
    }
}

/// Standard deviation of the energy of either profile along any axis, in units of the beam's radius: ∫ r²
/// dF = 1/2, half of it along each axis.
const DEVIATION: f64 = 0.5;

/// Moves and stretches points so that their mean is 0, their covariance 0 and their standard deviation along
/// each axis
/// [`DEVIATION`]: by the inverse root of their covariance matrix, which does not rotate them.
fn with_exact_moments(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let n = points.len() as f64;
    let mean = [0, 1].map(|axis: usize| points.iter().map(|p| p[axis]).sum::<f64>() / n);
    points.iter_mut().for_each(|p| *p = [p[0] - mean[0], p[1] - mean[1]]);
    let moment = |a: usize, b: usize| points.iter().map(|p| p[a] * p[b]).sum::<f64>() / n;
    let (xx, xz, zz) = (moment(0, 0), moment(0, 1), moment(1, 1));
    // Root of a symmetric 2 × 2 matrix C: (C + √det·1)/√(trace + 2√det).
    let root_det = (xx * zz - xz * xz).sqrt();
    let scale = 1.0 / (xx + zz + 2.0 * root_det).sqrt();
    let (a, b, d) = ((xx + root_det) * scale, xz * scale, (zz + root_det) * scale);
    let factor = DEVIATION / (a * d - b * b);
    points.iter().map(|[x, z]| [factor * (d * x - b * z), factor * (a * z - b * x)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::subray::equal_subrays;
    use libm::exp;

    const UNIT: Footprint =
        Footprint { profile: BeamProfile::Gaussian, half_angles: [1.0, 1.0], exit_radius: 0.0 };

    fn angles(beam: &Footprint, count: usize) -> impl Iterator<Item = Vec<[f64; 2]>> {
        patterns(beam, count).map(|subrays| subrays.iter().map(|s| s.angles).collect())
    }

    fn counts() -> impl Iterator<Item = usize> {
        (2..9).map(equal_subrays)
    }

    fn normal_cdf(x: f64) -> f64 {
        0.5 * libm::erfc(-x / 2f64.sqrt())
    }

    #[test]
    fn a_single_subray_is_the_axis() {
        assert_eq!(angles(&UNIT, 1).collect::<Vec<_>>(), [vec![[0.0; 2]]]);
    }

    #[test]
    fn moments_are_those_of_the_beam_in_every_direction_and_pattern() {
        for (profile, half_angles) in [
            (BeamProfile::Gaussian, [1.0, 1.0]),
            (BeamProfile::TopHat, [1.0, 1.0]),
            (BeamProfile::Gaussian, [2.0, 0.5]),
        ] {
            for count in counts() {
                for points in angles(&Footprint { profile, half_angles, ..UNIT }, count) {
                    let n = points.len() as f64;
                    for (axis, half_angle) in half_angles.into_iter().enumerate() {
                        let mean = points.iter().map(|p| p[axis]).sum::<f64>() / n;
                        let square = points.iter().map(|p| p[axis] * p[axis]).sum::<f64>() / n;
                        assert!(mean.abs() < 1e-12);
                        assert!(
                            (square / (0.25 * half_angle * half_angle) - 1.0).abs() < 1e-12,
                            "{count}: {square}"
                        );
                    }
                    assert!(points.iter().map(|p| p[0] * p[1]).sum::<f64>().abs() < 1e-12 * n);
                }
            }
        }
    }

    /// Largest difference between the share of the subrays below and the beam's energy below, over some cuts.
    fn discrepancy(mut at: Vec<f64>, energy: impl Fn(f64) -> f64) -> f64 {
        at.sort_by(f64::total_cmp);
        let n = at.len() as f64;
        let off = |(i, x): (usize, &f64)| {
            (energy(*x) - i as f64 / n).abs().max((energy(*x) - (i as f64 + 1.0) / n).abs())
        };
        at.iter().enumerate().map(off).fold(0.0, f64::max)
    }

    #[test]
    fn edges_and_discs_cut_off_what_they_cut_off_of_a_gaussian() {
        // Bounds: the reference's rings are off by 0.243, 0.161, 0.121, 0.096, 0.079 across edges.
        let edges = [0.23, 0.13, 0.08, 0.06, 0.05];
        for (count, bound) in counts().zip(edges) {
            for points in angles(&UNIT, count) {
                let worst = (0..36).map(|k| {
                    let (s, c) = (sin(PI * f64::from(k) / 36.0), cos(PI * f64::from(k) / 36.0));
                    // Standard deviation 1/2.
                    discrepancy(points.iter().map(|p| c * p[0] + s * p[1]).collect(), |x| normal_cdf(2.0 * x))
                });
                let worst = worst.fold(0.0, f64::max);
                assert!(worst < bound, "{count} subrays: {worst}");
                let disc = discrepancy(points.iter().map(|p| libm::hypot(p[0], p[1])).collect(), |r| {
                    1.0 - exp(-2.0 * r * r)
                });
                assert!(disc < bound, "{count} subrays within a disc: {disc}");
            }
        }
    }

    #[test]
    fn a_top_hat_ends_at_its_radius() {
        let beam = Footprint { profile: BeamProfile::TopHat, ..UNIT };
        for points in angles(&beam, 93) {
            assert!(points.iter().all(|p| libm::hypot(p[0], p[1]) < 1.05));
            let disc =
                discrepancy(points.iter().map(|p| libm::hypot(p[0], p[1])).collect(), |r| (r * r).min(1.0));
            assert!(disc < 0.04, "{disc}");
        }
    }

    #[test]
    fn squared_radii_of_exit_and_divergence_add_up() {
        let beam = Footprint { half_angles: [1e-3, 2e-3], exit_radius: 0.01, ..UNIT };
        for subrays in patterns(&beam, 19) {
            for range in [0.0, 5.0, 100.0] {
                for axis in 0..2 {
                    let at = |s: &Subray| s.exit[axis] + range * s.angles[axis];
                    let square = subrays.iter().map(|s| at(s) * at(s)).sum::<f64>() / 19.0;
                    let radius = range * beam.half_angles[axis];
                    assert!((square / (0.25 * (1e-4 + radius * radius)) - 1.0).abs() < 1e-9, "{range} m");
                }
            }
        }
    }
}
