//! The beam as subrays: the reference's rings (spec pulse-physics §1), or a pattern of equal energies
//! ([`super::footprint`]).

use super::footprint::{self, Footprint, Subray};
use super::lanes::{Block, LANES};
use std::array::from_fn;
use std::f64::consts::TAU;
use vlscan_geom::{DVec3, Rotation};

/// The subrays of a device relative to its beam axis, from the axis outwards.
#[derive(Clone, Debug, Default)]
pub(super) struct Subrays {
    /// Quaternions of each pattern by component; the last block is padded with the last quaternion.
    patterns: Vec<Vec<[Block; 4]>>,
    /// Exits of the subrays of each pattern from the instrument, m, beam frame; empty if all leave its
    /// origin.
    exits: Vec<Vec<DVec3>>,
    /// Ring of each subray; 0 where all have the same energy.
    pub ring: Vec<u32>,
}

/// Number of subrays in ring `i`: 1, 6, 12, 18, 25, 31 …
pub(super) fn rays_in_ring(i: u32) -> u32 {
    ((TAU * f64::from(i)) as u32).max(1)
}

/// Number of subrays of equal energy for a beam sample quality, about as many as in the reference's rings, in
/// multiples of a block: 1, 8, 16, 40, 64, 96 …
pub(super) fn equal_subrays(rings: u32) -> usize {
    let of_rings = (0..rings).map(rays_in_ring).sum::<u32>() as usize;
    if of_rings <= 1 { of_rings } else { ((of_rings + LANES / 2) / LANES * LANES).max(LANES) }
}

/// Angle of ring `i` of `rings` off the axis, rad.
pub(super) fn ring_angle(half_angle: f64, rings: u32, i: u32) -> f64 {
    f64::from(i) * (half_angle / f64::from(rings))
}

impl Subrays {
    /// `rings` rings within a cone of that half angle (rad).
    pub fn new(half_angle: f64, rings: u32) -> Subrays {
        let (mut ring, mut turns) = (Vec::new(), Vec::new());
        for i in 0..rings {
            let tilt = Rotation::about_x(ring_angle(half_angle, rings, i));
            let n = rays_in_ring(i);
            for k in 0..n {
                turns.push(Rotation::about_y((TAU / f64::from(n)) * f64::from(k)).after(tilt));
                ring.push(i);
            }
        }
        Subrays { patterns: vec![in_blocks(&turns)], exits: Vec::new(), ring }
    }

    /// Subrays of equal energy for the beam sample quality `rings`, see [`footprint::patterns`].
    pub fn of_equal_energy(beam: &Footprint, rings: u32) -> Subrays {
        let count = equal_subrays(rings);
        let turn = |subray: &Subray| {
            let [x, z] = subray.angles;
            Rotation::about_y(libm::atan2(x, z)).after(Rotation::about_x(libm::hypot(x, z)))
        };
        let exit = |subray: &Subray| DVec3::new(subray.exit[0], 0.0, subray.exit[1]);
        let mut subrays = Subrays { ring: vec![0; count], ..Subrays::default() };
        for pattern in footprint::patterns(beam, count) {
            subrays.patterns.push(in_blocks(&pattern.iter().map(turn).collect::<Vec<_>>()));
            if beam.exit_radius > 0.0 {
                subrays.exits.push(pattern.iter().map(exit).collect());
            }
        }
        subrays
    }

    /// Exits of the subrays of a pattern from the instrument, m, beam frame; `None` if all leave its origin.
    #[inline(always)]
    pub fn exits(&self, pattern: usize) -> Option<&[DVec3]> {
        self.exits.get(pattern).map(Vec::as_slice)
    }

    pub fn len(&self) -> usize {
        self.ring.len()
    }

    /// Number of patterns that pulses draw from: a power of two.
    #[inline(always)]
    pub fn patterns(&self) -> usize {
        self.patterns.len()
    }

    /// Writes x, y and z of the directions of all subrays of a pattern under `attitude`, padded like the
    /// quaternions.
    ///
    /// The direction is the image of +Y under the product of the quaternions, rounded in the order of
    /// [`Rotation::after`] and [`Rotation::apply`]: which subrays of a symmetric surface tie in range depends
    /// on the last digits (spec pulse-physics §4.2). A zero component is always +0, because slab tests read
    /// the sign of zeros.
    #[inline(always)]
    pub fn expand(&self, pattern: usize, attitude: &Rotation, [dx, dy, dz]: [&mut [Block]; 3]) {
        let (aw, a) = (attitude.w, attitude.u);
        for (((turns, dx), dy), dz) in self.patterns[pattern].iter().zip(dx).zip(dy).zip(dz) {
            // Local copies, which stores cannot alias.
            let ([w, x, y, z], mut d) = (*turns, [[0.0; LANES]; 3]);
            for i in 0..LANES {
                let qw = aw * w[i] - (a.x * x[i] + a.y * y[i] + a.z * z[i]);
                let qx = a.x * w[i] + aw * x[i] + (a.y * z[i] - a.z * y[i]);
                let qy = a.y * w[i] + aw * y[i] + (a.z * x[i] - a.x * z[i]);
                let qz = a.z * w[i] + aw * z[i] + (a.x * y[i] - a.y * x[i]);
                d[0][i] = 2.0 * (qy * qx - qw * qz) + 0.0;
                d[1][i] = 2.0 * (qw * qw + qy * qy) - 1.0;
                d[2][i] = 2.0 * (qw * qx + qy * qz) + 0.0;
            }
            [*dx, *dy, *dz] = d;
        }
    }
}

/// Quaternions by component, in whole blocks.
fn in_blocks(turns: &[Rotation]) -> Vec<[Block; 4]> {
    let block = |some: &[Rotation]| {
        let lane = |i: usize| some[i.min(some.len() - 1)];
        let (w, u) = (from_fn(|i| lane(i).w), |axis: usize| from_fn(|i| lane(i).u[axis]));
        [w, u(0), u(1), u(2)]
    };
    turns.chunks(LANES).map(block).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fan(divergence: f64, rings: u32, attitude: Rotation) -> Vec<DVec3> {
        let subrays = Subrays::new(divergence, rings);
        let n = subrays.len();
        let mut rows = [(); 3].map(|()| vec![[0.0; LANES]; n.div_ceil(LANES)]);
        subrays.expand(0, &attitude, rows.each_mut().map(Vec::as_mut_slice));
        let [x, y, z] = rows.each_ref().map(|row| row.as_flattened());
        (0..n).map(|i| DVec3::new(x[i], y[i], z[i])).collect()
    }

    #[test]
    fn counts_of_the_worked_example() {
        // spec pulse-physics §1.4
        for (rings, count) in [(1, 1), (2, 7), (3, 19), (4, 37), (5, 62), (6, 93), (8, 173), (10, 279)] {
            assert_eq!(Subrays::new(3e-4, rings).len(), count, "{rings} rings");
        }
        let per_ring: Vec<u32> = (0..10).map(rays_in_ring).collect();
        assert_eq!(per_ring, [1, 6, 12, 18, 25, 31, 37, 43, 50, 56]);
    }

    #[test]
    fn subrays_of_equal_energy_fill_blocks() {
        assert_eq!([0, 1, 2, 3, 4, 5, 6].map(equal_subrays), [0, 1, 8, 16, 40, 64, 96]);
    }

    #[test]
    fn directions_of_the_worked_example() {
        let rays = fan(3e-4, 3, Rotation::IDENTITY);
        let expected = [
            (0, [0.0, 1.0, 0.0]),
            (1, [0.0, 0.999999995, 9.99999998333e-5]),
            (2, [8.66025402341e-5, 0.999999995, 4.99999999167e-5]),
            (7, [0.0, 0.99999998, 1.99999998667e-4]),
            (8, [9.99999993333e-5, 0.99999998, 1.73205079602e-4]),
            (10, [1.99999998667e-4, 0.99999998, 4.1e-20]),
        ];
        for (i, d) in expected {
            let difference = (rays[i] - DVec3::from(d)).length();
            assert!(difference < 1e-14, "subray {i}: {} is not {d:?}", rays[i]);
        }
        // Rounding of the quaternions leaves this trace, which decides ties between ranges.
        assert!((rays[10].z - 4.1e-20).abs() < 5e-22, "{:e}", rays[10].z);
    }

    #[test]
    fn no_component_is_a_negative_zero() {
        for attitude in [Rotation::about_x(-1.0), Rotation::about_z(-2.0), Rotation::about_y(-0.5)] {
            for ray in fan(3e-4, 3, attitude) {
                assert!(ray.to_array().iter().all(|c| c.to_bits() != (-0.0f64).to_bits()));
            }
        }
    }

    proptest! {
        #[test]
        fn directions_are_those_of_the_composed_rotation(a in -4.0..4.0f64, b in -4.0..4.0f64, c in -4.0..4.0f64) {
            let attitude = Rotation::about_z(a).after(Rotation::about_y(b)).after(Rotation::about_x(c));
            let (rings, divergence) = (3, 2e-3);
            let rays = fan(divergence, rings, attitude);
            let mut i = 0;
            for ring in 0..rings {
                for k in 0..rays_in_ring(ring) {
                    let phi = (TAU / f64::from(rays_in_ring(ring))) * f64::from(k);
                    let s = Rotation::about_y(phi).after(Rotation::about_x(ring_angle(divergence, rings, ring)));
                    prop_assert_eq!(rays[i], attitude.after(s).forward());
                    i += 1;
                }
            }
        }
    }
}
