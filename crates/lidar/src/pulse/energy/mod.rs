//! Received power of one reflection (spec pulse-physics §3).
//!
//! | file | what it does |
//! |---|---|
//! | `beam` | optics and atmosphere, which all models share |
//! | `legacy`, `improved` | the models of the reference |
//! | `lidar` | the lidar equation of the refined physics |
//! | `series` | exponentials of small arguments |

mod beam;
mod improved;
mod legacy;
mod lidar;
mod series;

pub(super) use beam::{BeamState, NANO, half_angle};

use super::lanes::{Block, LANES};
use super::options::PhysicsOptions;
use improved::{Improved, RingBlock};
use legacy::{Legacy, ProfileBlock};
use lidar::LidarEquation;

#[derive(Clone, Debug)]
pub(super) struct Energy {
    law: Law,
    /// Voxels with a leaf angle table follow the legacy model in either model (spec pulse-physics §3.5).
    legacy: Legacy,
}

#[derive(Clone, Debug)]
enum Law {
    Legacy,
    Improved(Improved),
    Lidar(LidarEquation),
}

impl Energy {
    pub fn new(state: BeamState, subrays: usize, multi_channel: bool, options: &PhysicsOptions) -> Energy {
        let corrections = &options.corrections;
        let law = if corrections.radiometry {
            Law::Lidar(LidarEquation::new(state.beam, state.frequency, subrays, corrections))
        } else if options.legacy_energy && !multi_channel {
            Law::Legacy
        } else {
            Law::Improved(Improved::new(state, corrections))
        };
        Energy { law, legacy: Legacy::new(state, corrections) }
    }

    /// Gains of the subrays of one pulse, [`LANES`] at a time: the intensities of reflectance factors of 1 at
    /// `ranges` (m, by subray, padded to whole blocks). Gains at ranges that are not finite are meaningless.
    #[inline(always)]
    pub fn gains(&self, ranges: &[Block], out: &mut [Block]) {
        match &self.law {
            Law::Legacy => {
                for ((range, out), ring) in ranges.iter().zip(out).zip(&self.legacy.lanes) {
                    self.legacy.gains(ring, range, out);
                }
            }
            Law::Improved(law) => {
                for ((range, out), ring) in ranges.iter().zip(out).zip(&law.lanes) {
                    law.gains(ring, range, out);
                }
            }
            Law::Lidar(law) => {
                for (range, out) in ranges.iter().zip(out) {
                    law.gains(range, out);
                }
            }
        }
    }

    /// Intensity of a reflectance factor of 1 at `range` m, summed over `subrays` subrays.
    pub fn of_beam(&self, subrays: usize, range: f64) -> f64 {
        let ranges = vec![[range; LANES]; subrays.div_ceil(LANES)];
        let mut gains = vec![[0.0; LANES]; ranges.len()];
        self.gains(&ranges, &mut gains);
        gains.as_flattened()[..subrays].iter().sum()
    }

    /// Turns reflectance factors f(θ) into intensities, factor `i` of a subray in `rings[i]` at `ranges[i]`
    /// m.
    pub fn apply(&self, rings: &[u32], ranges: &[f64], factors: &mut [f64]) {
        let blocks = rings.chunks(LANES).zip(ranges.chunks(LANES)).zip(factors.chunks_mut(LANES));
        for ((rings, ranges), factors) in blocks {
            let mut range = [1.0; LANES];
            range[..ranges.len()].copy_from_slice(ranges);
            for (factor, i) in factors.iter_mut().zip(self.of_rings(rings, &range)) {
                *factor *= i;
            }
        }
    }

    fn of_rings(&self, rings: &[u32], range: &Block) -> Block {
        let mut out = [0.0; LANES];
        match &self.law {
            Law::Legacy => self.legacy.gains(&ProfileBlock::of(&self.legacy.profile, rings), range, &mut out),
            Law::Improved(law) => law.gains(&RingBlock::of(&law.rings, rings), range, &mut out),
            Law::Lidar(law) => law.gains(range, &mut out),
        }
        out
    }

    /// Intensity of a reflection at `range` m in `ring` from a voxel with the cross-section `sigma` (spec
    /// pulse-physics §3.5).
    pub fn of_cross_section(&self, ring: u32, range: f64, sigma: f64) -> f64 {
        let mut damping = [0.0; LANES];
        self.legacy.damping(&ProfileBlock::of(&self.legacy.profile, &[ring]), &[range; LANES], &mut damping);
        let damping = damping[0];
        self.legacy.cross_section * sigma * damping / (range * range * range * range)
    }
}

#[cfg(test)]
mod tests {
    use super::beam::extinction;
    use super::series::{exponential, exponential_minus_one};
    use super::*;
    use crate::pulse::subray::Subrays;
    use crate::pulse::testkit::tls_beam;
    use vlscan_base::corrections::Corrections;
    use vlscan_survey::Beam;

    fn state(beam: &Beam, rings: u32, range_min: f64) -> BeamState<'_> {
        BeamState {
            beam,
            rings,
            range_min,
            start_divergence: beam.divergence,
            leg_divergence: beam.divergence,
            frequency: 1e5,
        }
    }

    struct Both(Improved, Legacy);

    impl Both {
        fn new(state: BeamState, corrections: &Corrections) -> Both {
            Both(Improved::new(state, corrections), Legacy::new(state, corrections))
        }

        /// Intensities of ρ = 0.5 by the improved and the legacy model.
        fn at(&self, ring: u32, range: f64) -> (f64, f64) {
            let (mut improved, mut legacy) = ([0.0; LANES], [0.0; LANES]);
            self.0.gains(&RingBlock::of(&self.0.rings, &[ring]), &[range; LANES], &mut improved);
            self.1.gains(&ProfileBlock::of(&self.1.profile, &[ring]), &[range; LANES], &mut legacy);
            (improved[0] * 0.5, legacy[0] * 0.5)
        }
    }

    fn both(rings: u32, range_min: f64) -> Both {
        Both::new(state(&tls_beam(), rings, range_min), &Corrections::NONE)
    }

    fn near(value: f64, expected: f64, relative: f64) {
        assert!((value / expected - 1.0).abs() < relative, "{value:e} is not {expected:e}");
    }

    #[test]
    fn intensities_of_the_worked_example() {
        // spec pulse-physics §3.6: R = 100 m, ρ = 0.5, θ = 0
        let models = both(3, 1.5);
        let expected = [
            (0, 9.829395356e-4, 183.8212242),
            (1, 1.310584388e-3, 147.1998880),
            (2, 1.310579962e-3, 75.58627778),
        ];
        for (ring, i, l) in expected {
            near(models.at(ring, 100.0).0, i, 1e-9);
            near(models.at(ring, 100.0).1, l, 1e-9);
        }
        let all = Subrays::new(3e-4, 3).ring;
        near(all.iter().map(|r| models.at(*r, 100.0).0).sum(), 2.457340540e-2, 1e-9);
        near(all.iter().map(|r| models.at(*r, 100.0).1).sum(), 1974.055885, 1e-9);
    }

    #[test]
    fn range_dependence_of_the_worked_example() {
        let models = both(1, 1.5);
        let expected = [
            (10.0, 315.1746, 3.498314e5),
            (30.0, 3.231312, 3.885604e4),
            (100.0, 2.457341e-2, 3492.603),
            (300.0, 2.970676e-4, 386.6607),
            (1000.0, 2.361525e-6, 34.36009),
        ];
        for (range, i, l) in expected {
            near(models.at(0, range).0, i, 3e-7);
            near(models.at(0, range).1, l, 3e-7);
        }
        near(models.at(0, 100.0).1, 3492.603260504615, 1e-12);
        for (range_min, i) in
            [(0.01, 1.2334e-6), (0.5, 3.0594e-3), (1.5, 2.4573e-2), (10.0, 0.15666), (100.0, 0.17463)]
        {
            near(both(1, range_min).at(0, 100.0).0, i, 4e-5);
        }
    }

    #[test]
    fn without_minimum_range_the_waist_is_at_the_exit() {
        let (beam, mut c) = (tls_beam(), Corrections::NONE);
        c.waist_at_exit = true;
        let at_exit = Both::new(state(&beam, 3, 1.5), &c).at(0, 100.0).0;
        assert_eq!(both(3, 0.0).at(0, 100.0).0, at_exit);
        assert!(at_exit > 1e-3);
    }

    #[test]
    fn without_divergence_all_energy_is_on_the_axis() {
        let (mut beam, c) = (tls_beam(), Corrections::NONE);
        beam.divergence = 0.0;
        for range_min in [1.5, 0.0] {
            let models = Both::new(state(&beam, 3, range_min), &c);
            near(models.at(0, 100.0).0, 3492.603260504615, 1e-9);
            near(models.at(0, 100.0).1, 3492.603260504615, 1e-9);
            assert_eq!(models.at(1, 100.0), (0.0, 0.0));
        }
    }

    #[test]
    fn metres_make_extended_targets_fade_with_the_square_of_range() {
        let (beam, mut c) = (tls_beam(), Corrections::NONE);
        (c.waist_at_exit, c.ring_radii_in_metres) = (true, true);
        let models = Both::new(state(&beam, 3, 1.5), &c);
        let ratio = models.at(0, 500.0).0 / models.at(0, 1000.0).0;
        assert!((ratio - 4.0).abs() < 0.05, "{ratio}");
    }

    #[test]
    fn extinctions_of_the_worked_example() {
        let mut beam = tls_beam();
        let mut c = Corrections::NONE;
        for (visibility, wavelength, a) in [
            (23.0, 1064.0, 9.076037913e-6),
            (23.0, 1550.0, 5.565308073e-6),
            (60.0, 1064.0, 3.593347394e-7),
            (50.0, 1064.0, 7.977613561e-9),
            (5.0, 905.0, 4.932359328e-4),
        ] {
            (beam.visibility, beam.atmosphere_wavelength) = (visibility, wavelength);
            near(extinction(&beam, &c), a, 1e-9);
        }
        (beam.visibility, beam.atmosphere_wavelength) = (23.0, 1064.0);
        c.atmosphere_units = true;
        near(extinction(&beam, &c), 7.2094e-5, 1e-4);
    }

    #[test]
    fn voxels_with_a_leaf_angle_table_follow_their_own_law() {
        // spec pulse-physics §3.6: σ = 0.5, Q = 1, amplitude of a 5 ns pulse
        let beam = tls_beam();
        let energy = Energy::new(state(&beam, 1, 1.5), 1, false, &PhysicsOptions::helios());
        for (range, amplitude) in [(99.0, 221051.9156), (101.0, 204048.6845)] {
            near(energy.of_cross_section(0, range, 0.5) * 0.540032849, amplitude, 3e-9);
        }
    }

    #[test]
    fn the_lane_of_a_reflection_makes_no_difference() {
        let beam = tls_beam();
        for options in
            [PhysicsOptions::helios(), PhysicsOptions { legacy_energy: true, ..PhysicsOptions::helios() }]
        {
            let energy = Energy::new(state(&beam, 3, 1.5), 19, false, &options);
            let rings = Subrays::new(3e-4, 3).ring;
            let ranges: Vec<f64> = (0..19).map(|i| 0.3 + 7.0 * f64::from(i * i)).collect();
            let mut together = vec![0.5; 19];
            energy.apply(&rings, &ranges, &mut together);
            let mut blocks = [[f64::INFINITY; LANES]; 3];
            blocks.as_flattened_mut()[..19].copy_from_slice(&ranges);
            let mut gains = [[0.0; LANES]; 3];
            energy.gains(&blocks, &mut gains);
            for i in 0..19 {
                let mut alone = [0.5];
                energy.apply(&rings[i..=i], &ranges[i..=i], &mut alone);
                assert_eq!(alone[0].to_bits(), together[i].to_bits());
                assert_eq!((0.5 * gains.as_flattened()[i]).to_bits(), together[i].to_bits());
            }
        }
    }

    #[test]
    fn the_series_is_as_exact_as_the_library() {
        for i in -6250..6250 {
            let x = f64::from(i) * 1e-5;
            near(exponential(x), libm::exp(x), 3e-16);
            if x != 0.0 {
                near(exponential_minus_one(x), libm::expm1(x), 5e-16);
            }
        }
        assert_eq!([0.0, f64::NEG_INFINITY, 1.0].map(exponential), [1.0, 0.0, libm::exp(1.0)]);
        assert!(exponential(f64::NAN).is_nan());
    }
}
