//! Cross-section and volume of a beam by range.
//!
//! The radii of an elliptical beam from an exit of the radius d are √(d² + x²·r²) and √(d² + z²·r²) at the
//! range r. If the half angles x and z are equal, or d is 0, its volume is π·r·(d² + x·z·r²/3). Otherwise the
//! volume is an elliptic integral, which is computed once up to a series of ranges, and from there by Gauss's
//! quadrature. Each range is twice the one before it, so that the integrand is nearly a polynomial between
//! them.

use super::footprint::Footprint;
use libm::{cbrt, sqrt};
use std::f64::consts::PI;

/// Radius of an exit below which it does not widen the beam, m.
const MIN_EXIT: f64 = 1e-9;
/// Maximum number of steps of Newton's method.
const MAX_NEWTON_STEPS: usize = 64;
/// Range up to which volumes are computed in advance, m.
const MAX_KNOT: f64 = 1e6;
/// Maximum number of ranges with such volumes.
const MAX_KNOTS: usize = 64;
/// Nodes on both sides of the middle and weights of Gauss's quadrature with eight points.
const NODES: [(f64, f64); 4] = [
    (0.18343464249564978, 0.36268378337836166),
    (0.525532409916329, 0.3137066458778869),
    (0.7966664774136267, 0.22238103445337443),
    (0.9602898564975362, 0.10122853629037706),
];

/// A range with the volume up to it.
#[derive(Clone, Copy, Debug)]
struct Knot {
    /// m.
    range: f64,
    /// m³.
    volume: f64,
}

/// Cross-section and volume of a beam.
#[derive(Clone, Debug)]
pub(super) struct BeamVolume {
    /// Half angles along the two axes, rad.
    half_angles: [f64; 2],
    /// Radius at the exit, m.
    exit_radius: f64,
    /// Volumes of an elliptical beam with an exit, by ascending range; none of others.
    knots: Vec<Knot>,
}

impl BeamVolume {
    /// The volume of a beam.
    pub fn new(beam: &Footprint) -> BeamVolume {
        let Footprint { half_angles: [x, z], exit_radius, .. } = *beam;
        let mut made = BeamVolume { half_angles: [x, z], exit_radius, knots: Vec::new() };
        if x == z || exit_radius < MIN_EXIT {
            return made;
        }
        let mut last = Knot { range: 0.0, volume: 0.0 };
        let mut next = exit_radius / x.max(z);
        made.knots.push(last);
        while last.range < MAX_KNOT && made.knots.len() < MAX_KNOTS {
            last = Knot { range: next, volume: last.volume + made.between(last.range, next) };
            made.knots.push(last);
            next *= 2.0;
        }
        made
    }

    /// Product of the radii along the two axes at a range, m².
    pub fn square(&self, range: f64) -> f64 {
        let BeamVolume { half_angles: [x, z], exit_radius, .. } = *self;
        let exit = exit_radius * exit_radius;
        if self.knots.is_empty() {
            return exit + x * z * range * range;
        }
        sqrt((exit + x * x * range * range) * (exit + z * z * range * range))
    }

    /// Volume up to a range, m³.
    pub fn up_to(&self, range: f64) -> f64 {
        match self.knots.iter().rev().find(|knot| knot.range <= range) {
            Some(knot) => knot.volume + self.between(knot.range, range),
            None => {
                let BeamVolume { half_angles: [x, z], exit_radius, .. } = *self;
                PI * range * (exit_radius * exit_radius + x * z * range * range / 3.0)
            }
        }
    }

    /// Range up to which the beam has a volume, m; infinite for a beam without width.
    pub fn range(&self, volume: f64) -> f64 {
        let mut range = match self.knots.iter().rev().find(|knot| knot.volume <= volume) {
            // A tangent of a convex function meets a value beyond the function.
            Some(knot) => knot.range + (volume - knot.volume) / (PI * self.square(knot.range)),
            None => {
                let BeamVolume { half_angles: [x, z], exit_radius, .. } = *self;
                let cylinder = volume / (PI * exit_radius * exit_radius);
                cylinder.min(cbrt(3.0 * volume / (PI * x * z)))
            }
        };
        if !range.is_finite() {
            return f64::INFINITY;
        }
        // From above towards the root of a convex function.
        for _ in 0..MAX_NEWTON_STEPS {
            let next = range - (self.up_to(range) - volume) / (PI * self.square(range));
            if !(next < range && next > 0.0) {
                break;
            }
            range = next;
        }
        range
    }

    /// Volume between two ranges by quadrature, m³.
    fn between(&self, from: f64, to: f64) -> f64 {
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let of_pair = |(node, weight): (f64, f64)| {
            weight * (self.square(middle - half * node) + self.square(middle + half * node))
        };
        PI * half * NODES.into_iter().map(of_pair).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use libm::asinh;
    use vlscan_survey::BeamProfile;

    fn volume(half_angles: [f64; 2], exit_radius: f64) -> BeamVolume {
        BeamVolume::new(&Footprint { profile: BeamProfile::Gaussian, half_angles, exit_radius })
    }

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found / expected - 1.0).abs() <= tolerance, "{found:e} is not {expected:e}");
    }

    #[test]
    fn a_beam_that_diverges_along_one_axis_has_the_volume_of_its_closed_form() {
        // ∫ d·√(d² + x²·r²) dr = d/2·(r·√(d² + x²·r²) + d²/x·asinh(x·r/d)).
        let (x, d) = (1.5e-3, 0.01);
        for range in [1e-3, 0.5, 5.0, 20.0, 300.0, 5000.0] {
            let root = sqrt(d * d + x * x * range * range);
            let expected = PI * d * 0.5 * (range * root + d * d / x * asinh(x * range / d));
            for half_angles in [[x, 0.0], [0.0, x]] {
                let beam = volume(half_angles, d);
                near(beam.up_to(range), expected, 1e-12);
                near(beam.range(expected), range, 1e-11);
                near(beam.square(range), d * root, 1e-14);
            }
        }
        near(volume([x, 0.0], d).up_to(50.0), 0.06226664140840, 1e-12);
    }

    #[test]
    fn both_axes_of_a_beam_widen_from_its_exit() {
        // Far away the radii are x·r and z·r, near the exit both are that of the exit.
        let beam = volume([1.5e-3, 0.3e-3], 0.01);
        near(beam.square(1e-3), 1e-4, 1e-7);
        near(beam.square(1e5), 1.5e-3 * 0.3e-3 * 1e10, 1e-6);
        // By numerical integration.
        near(beam.up_to(50.0), 0.08864303741937977, 1e-12);
        for angles in [[1.5e-3, 0.3e-3], [1e-3, 5e-2], [1e-5, 1e-6]] {
            let beam = volume(angles, 0.002);
            for range in [1e-3, 0.5, 20.0, 3000.0, 1e6] {
                near(beam.range(beam.up_to(range)), range, 1e-9);
            }
        }
    }

    #[test]
    fn axes_that_are_nearly_equal_have_the_volume_of_a_cone() {
        let (round, nearly) = (volume([1e-3; 2], 0.01), volume([1e-3, 1e-3 * (1.0 + 1e-12)], 0.01));
        assert!(round.knots.is_empty() && !nearly.knots.is_empty());
        for range in [0.1, 7.0, 60.0, 900.0] {
            near(nearly.up_to(range), round.up_to(range), 1e-11);
            near(nearly.square(range), round.square(range), 1e-11);
        }
        // Without a width at the exit, ellipses have the volume of a cone with the product of their radii.
        let cone = volume([2e-3, 1e-3], 0.0);
        near(cone.up_to(30.0), PI * 2e-6 * 9000.0, 1e-14);
        assert_eq!(volume([2e-3, 0.0], 0.0).range(1.0), f64::INFINITY);
    }

    #[test]
    fn extreme_beams_have_volumes() {
        for (angles, exit) in [([1e-300, 2e-300], 1.0), ([1.5, 0.1], 1e-300), ([0.0, 1e-9], 10.0)] {
            let beam = volume(angles, exit);
            let range = beam.range(1e-3);
            assert!(beam.up_to(100.0) > 0.0 && range > 0.0 && range.is_finite(), "{angles:?}: {range}");
        }
    }
}
