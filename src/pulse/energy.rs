//! Received power of one reflection (spec pulse-physics §3).

use super::options::{Corrections, PhysicsOptions};
use super::radiometry::{LidarEquation, NANO};
use super::subray::{rays_in_ring, ring_angle};
use crate::survey::Beam;
use crate::tree::RayGroup;
use libm::{pow, sin};
use std::array::from_fn;
use std::f64::consts::PI;

/// The beam's state that an energy model is computed for.
#[derive(Clone, Copy, Debug)]
pub(super) struct BeamState<'a> {
    /// The device's optics.
    pub beam: &'a Beam,
    /// Number of rings of subrays.
    pub rings: u32,
    /// Nearest range R0, m.
    pub range_min: f64,
    /// Divergence when the simulation started, rad.
    pub start_divergence: f64,
    /// Divergence of the current leg, rad.
    pub leg_divergence: f64,
    /// Pulse rate of the current leg, Hz.
    pub frequency: f64,
}

/// The energy model of a device.
#[derive(Clone, Debug)]
pub(super) struct Energy {
    law: Law,
    /// Voxels with a leaf angle table follow the legacy law in either model (§3.5).
    legacy: Legacy,
}

#[derive(Clone, Debug)]
enum Law {
    /// Spec §3.3.
    Legacy,
    /// Spec §3.4.
    Improved(Improved),
    /// The lidar equation in watts, subrays of equal energy.
    Lidar(LidarEquation),
}

impl Energy {
    /// The model that a run uses for a device whose beam has so many subrays.
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

    /// Gains of the subrays of one pulse, [`LANES`] at a time: the intensity that a reflectance factor of 1 would have at
    /// those ranges (m). `ranges` are by subray, filled up to whole blocks; where they are not finite, gains are not either
    /// or mean nothing.
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

    /// Intensity of all `subrays` of a pulse together that a reflectance factor of 1 has at `range` m.
    pub fn of_beam(&self, subrays: usize, range: f64) -> f64 {
        let ranges = vec![[range; LANES]; subrays.div_ceil(LANES)];
        let mut gains = vec![[0.0; LANES]; ranges.len()];
        self.gains(&ranges, &mut gains);
        gains.as_flattened()[..subrays].iter().sum()
    }

    /// Turns reflectance factors f(θ) into intensities: of a reflection in `rings[i]` at `ranges[i]` m.
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

    /// Gains of subrays of any rings.
    fn of_rings(&self, rings: &[u32], range: &Block) -> Block {
        let mut out = [0.0; LANES];
        match &self.law {
            Law::Legacy => self.legacy.gains(&Profiles::of(&self.legacy.profile, rings), range, &mut out),
            Law::Improved(law) => law.gains(&Rings::of(&law.rings, rings), range, &mut out),
            Law::Lidar(law) => law.gains(range, &mut out),
        }
        out
    }

    /// Intensity of a reflection at `range` m in `ring` from a voxel with the cross-section `sigma` (§3.5).
    pub fn of_cross_section(&self, ring: u32, range: f64, sigma: f64) -> f64 {
        let mut damping = [0.0; LANES];
        self.legacy.damping(&Profiles::of(&self.legacy.profile, &[ring]), &[range; LANES], &mut damping);
        let damping = damping[0];
        self.legacy.cross_section * sigma * damping / (range * range * range * range)
    }
}

/// Subrays that are evaluated together.
pub(super) const LANES: usize = RayGroup::LANES;
/// A number for each of them.
pub(super) type Block = [f64; LANES];

/// The rings of all subrays, ring by ring, in blocks; the last ring fills the last block.
fn rings_of_lanes(rings: u32) -> Vec<u32> {
    let mut all: Vec<u32> =
        (0..rings).flat_map(|r| std::iter::repeat_n(r, rays_in_ring(r) as usize)).collect();
    all.resize(all.len().next_multiple_of(LANES), rings.saturating_sub(1));
    all
}

/// Half opening angle of the traced cone, which is also the angle of the waist formula.
pub(super) fn half_angle(divergence: f64, corrections: &Corrections) -> f64 {
    if corrections.full_angle_divergence { divergence * 0.5 } else { divergence }
}

/// Extinction by the atmosphere, per metre as the models apply it (§3.1).
pub(super) fn extinction(beam: &Beam, corrections: &Corrections) -> f64 {
    let v = beam.visibility;
    let wavelength = if corrections.channel_haze { beam.wavelength } else { beam.atmosphere_wavelength };
    let clear = if corrections.atmosphere_units { v >= 50.0 } else { v > 50.0 };
    let q = if clear {
        1.6
    } else if v > 6.0 && v < 50.0 {
        1.3
    } else {
        0.585 * pow(v, 0.33)
    };
    if corrections.atmosphere_units {
        (3.91 / v) * pow(wavelength * 1e-3 / 0.55, -q) * 1e-3
    } else {
        (3.91 / v) * pow(wavelength / 0.55, -q)
    }
}

/// P·D²·η in nanowatt square metres, the factor that all laws share.
fn received_scale(beam: &Beam) -> f64 {
    NANO * beam.average_power * (beam.receiver_diameter * beam.receiver_diameter) * beam.efficiency
}

/// The older law: I ∝ R⁻², each ring damped by the beam's profile.
#[derive(Clone, Debug)]
struct Legacy {
    surface: f64,
    cross_section: f64,
    profile: Vec<Profile>,
    /// Of all subrays.
    lanes: Vec<Profiles>,
    range_min_squared: f64,
    double_extinction: f64,
}

/// The beam's profile in a ring: exp(−k·R²/(R²+R0²)).
#[derive(Clone, Copy, Debug)]
struct Profile {
    /// k.
    exponent: f64,
    /// exp(−k), which is what remains far away.
    far: f64,
}

/// The profiles of a block of subrays.
#[derive(Clone, Copy, Debug)]
struct Profiles {
    exponent: Block,
    far: Block,
}

impl Profiles {
    /// Those of some rings, at most as many as a block holds.
    fn of(profile: &[Profile], rings: &[u32]) -> Profiles {
        let lane = |i: usize| profile[rings.get(i).map_or(0, |r| *r as usize)];
        Profiles { exponent: from_fn(|i| lane(i).exponent), far: from_fn(|i| lane(i).far) }
    }
}

impl Legacy {
    fn new(state: BeamState, corrections: &Corrections) -> Legacy {
        let BeamState { beam, rings, .. } = state;
        let (start, leg) = (state.start_divergence, state.leg_divergence);
        let divisor = if corrections.true_subray_count {
            (0..rings).map(|i| f64::from(rays_in_ring(i))).sum()
        } else {
            1.0 + 3.0 * f64::from(rings) * (f64::from(rings) - 1.0)
        };
        let scale = received_scale(beam);
        let collimated = corrections.collimated_energy && leg == 0.0;
        let profile = |i| {
            if collimated {
                return Profile { exponent: 0.0, far: if i == 0 { 1.0 } else { 0.0 } };
            }
            let sine = sin(ring_angle(half_angle(start, corrections), rings, i));
            let spread = beam.quality * sine / half_angle(leg, corrections);
            let exponent = 2.0 * spread * spread;
            Profile { exponent, far: libm::exp(-exponent) }
        };
        let profile: Vec<Profile> = (0..rings).map(profile).collect();
        let footprint = if collimated { 1.0 } else { start * start / divisor / (leg * leg) };
        Legacy {
            surface: scale * (PI / 4.0) * footprint,
            cross_section: scale / (4.0 * PI * (leg * leg)),
            lanes: rings_of_lanes(rings).chunks(LANES).map(|rings| Profiles::of(&profile, rings)).collect(),
            profile,
            range_min_squared: state.range_min * state.range_min,
            double_extinction: 2.0 * extinction(beam, corrections),
        }
    }

    /// Intensities for a reflectance factor of 1.
    #[inline(always)]
    fn gains(&self, ring: &Profiles, range: &Block, out: &mut Block) {
        self.damping(ring, range, out);
        for i in 0..LANES {
            out[i] = self.surface * out[i] / (range[i] * range[i]);
        }
    }

    /// Losses by the beam's profile and the atmosphere.
    #[inline(always)]
    fn damping(&self, ring: &Profiles, range: &Block, out: &mut Block) {
        let mut x = [0.0; LANES];
        let mut other = 0;
        for i in 0..LANES {
            let near = self.range_min_squared / (range[i] * range[i] + self.range_min_squared);
            x[i] = ring.exponent[i] * near - range[i] * self.double_extinction;
            out[i] = ring.far[i] * (1.0 + x[i] * series(x[i]));
            let small = x[i].abs() < SMALL;
            other |= u32::from(!small & range[i].is_finite());
        }
        if other != 0 {
            for i in 0..LANES {
                out[i] = ring.far[i] * exponential(x[i]);
            }
        }
    }
}

/// The newer law: each ring carries its share of a Gaussian beam.
#[derive(Clone, Debug)]
struct Improved {
    rings: Vec<Ring>,
    /// Of all subrays.
    lanes: Vec<Rings>,
    /// w0², m².
    waist_squared: f64,
    /// λ / (π w0²), 1/m.
    spread: f64,
    /// 1/R0, 1/m; 0 puts the waist at the exit.
    focus: f64,
    in_metres: bool,
    double_extinction: f64,
}

/// The rings of a block of subrays.
#[derive(Clone, Copy, Debug)]
struct Rings {
    scale: Block,
    inner: Block,
    width: Block,
}

impl Rings {
    /// Some rings, at most as many as a block holds.
    fn of(rings: &[Ring], some: &[u32]) -> Rings {
        let lane = |i: usize| rings[some.get(i).map_or(0, |r| *r as usize)];
        Rings {
            scale: from_fn(|i| lane(i).scale),
            inner: from_fn(|i| lane(i).inner),
            width: from_fn(|i| lane(i).width),
        }
    }
}

/// One ring of the improved model.
#[derive(Clone, Copy, Debug)]
struct Ring {
    /// Everything that does not depend on range or surface.
    scale: f64,
    /// 2ρ² of the inner radius.
    inner: f64,
    /// 2ρ² of the outer radius, minus `inner`.
    width: f64,
}

impl Improved {
    fn new(state: BeamState, corrections: &Corrections) -> Improved {
        let BeamState { beam, rings, start_divergence: divergence, .. } = state;
        let scale = received_scale(beam) * PI / 4.0;
        let collimated = corrections.collimated_energy && divergence == 0.0;
        let ring =
            |i| if collimated { Ring::on_axis(scale, i) } else { Ring::new(scale, divergence, rings, i) };
        let of_rings: Vec<Ring> = (0..rings).map(ring).collect();
        let wavelength = beam.wavelength * 1e-9;
        let waist = if collimated {
            1.0
        } else {
            beam.quality * wavelength / (PI * half_angle(divergence, corrections))
        };
        Improved {
            lanes: rings_of_lanes(rings).chunks(LANES).map(|rings| Rings::of(&of_rings, rings)).collect(),
            rings: of_rings,
            waist_squared: waist * waist,
            spread: wavelength / (PI * (waist * waist)),
            focus: if corrections.waist_at_exit || collimated { 0.0 } else { 1.0 / state.range_min },
            in_metres: corrections.ring_radii_in_metres,
            double_extinction: 2.0 * extinction(beam, corrections),
        }
    }

    /// Intensities for a reflectance factor of 1.
    #[inline(always)]
    fn gains(&self, ring: &Rings, range: &Block, out: &mut Block) {
        // The energy that a ring has lost to its outer neighbours, and what is left of the rest by then:
        // e^(−a) − e^(−b) as e^(−a)·(1 − e^(−(b−a))), which does not cancel.
        let (mut share, mut damping) = ([0.0; LANES], [0.0; LANES]);
        let mut other = 0;
        for i in 0..LANES {
            let square = range[i] * range[i];
            let (defocus, spread) = (1.0 - range[i] * self.focus, range[i] * self.spread);
            let beam_squared = self.waist_squared * (defocus * defocus + spread * spread);
            let unit = if self.in_metres { square / beam_squared } else { 1.0 / beam_squared };
            let (x, y) =
                (-(ring.width[i] * unit), -(ring.inner[i] * unit + range[i] * self.double_extinction));
            (share[i], damping[i]) = (x, y);
            out[i] = -(ring.scale[i] * (x * series(x)) * (1.0 + y * series(y))) / square;
            let small = (x.abs() < SMALL) & (y.abs() < SMALL);
            other |= u32::from(!small & range[i].is_finite());
        }
        if other != 0 {
            for i in 0..LANES {
                let lost = ring.scale[i] * exponential_minus_one(share[i]) * exponential(damping[i]);
                out[i] = -lost / (range[i] * range[i]);
            }
        }
    }
}

impl Ring {
    fn new(scale: f64, divergence: f64, rings: u32, i: u32) -> Ring {
        let radius = |i: u32| {
            if i == 0 { 0.0 } else { divergence * (f64::from(i) - 0.5) / (2.0 * (f64::from(rings) - 0.5)) }
        };
        let (inner, outer) = (radius(i) * radius(i), radius(i + 1) * radius(i + 1));
        let rays = f64::from(rays_in_ring(i));
        // The area of a subray, π(outer − inner)/rays, cancels from the law; but without divergence it is 0/0.
        let cancelled = if outer > inner { 1.0 } else { f64::NAN };
        Ring { scale: scale / rays * cancelled, inner: 2.0 * inner, width: 2.0 * (outer - inner) }
    }

    /// All energy on the axis: an infinitely wide first ring and empty others.
    fn on_axis(scale: f64, i: u32) -> Ring {
        if i == 0 {
            Ring { scale, inner: 0.0, width: f64::INFINITY }
        } else {
            Ring { scale: 0.0, inner: 0.0, width: 0.0 }
        }
    }
}

/// Arguments below this need only a short series.
pub(super) const SMALL: f64 = 1.0 / 16.0;

/// e^x. Near 0, where most arguments of these laws lie, a series of 10 terms is exact to the last digit.
pub(super) fn exponential(x: f64) -> f64 {
    if x.abs() < SMALL { 1.0 + x * series(x) } else { libm::exp(x) }
}

/// e^x − 1.
fn exponential_minus_one(x: f64) -> f64 {
    if x.abs() < SMALL { x * series(x) } else { libm::expm1(x) }
}

/// (e^x − 1)/x for small x: Σ x^k/(k+1)!.
#[inline(always)]
pub(super) fn series(x: f64) -> f64 {
    const C: [f64; 10] = [
        1.0,
        1.0 / 2.0,
        1.0 / 6.0,
        1.0 / 24.0,
        1.0 / 120.0,
        1.0 / 720.0,
        1.0 / 5040.0,
        1.0 / 40320.0,
        1.0 / 362880.0,
        1.0 / 3628800.0,
    ];
    let square = x * x;
    let fourth = square * square;
    let low = (C[0] + C[1] * x) + square * (C[2] + C[3] * x);
    let middle = (C[4] + C[5] * x) + square * (C[6] + C[7] * x);
    let high = C[8] + C[9] * x;
    low + fourth * (middle + fourth * high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::subray::Subrays;
    use crate::pulse::testkit::tls_beam;

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

    /// Both models for a state of the beam.
    struct Both(Improved, Legacy);

    impl Both {
        fn new(state: BeamState, corrections: &Corrections) -> Both {
            Both(Improved::new(state, corrections), Legacy::new(state, corrections))
        }

        /// Intensities of ρ = 0.5 by the improved and the legacy model.
        fn at(&self, ring: u32, range: f64) -> (f64, f64) {
            let (mut improved, mut legacy) = ([0.0; LANES], [0.0; LANES]);
            self.0.gains(&Rings::of(&self.0.rings, &[ring]), &[range; LANES], &mut improved);
            self.1.gains(&Profiles::of(&self.1.profile, &[ring]), &[range; LANES], &mut legacy);
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
    fn without_minimum_range_the_improved_model_receives_nothing_unless_corrected() {
        assert_eq!(both(3, 0.0).at(0, 100.0).0, 0.0);
        let (beam, mut c) = (tls_beam(), Corrections::NONE);
        c.waist_at_exit = true;
        assert!(Both::new(state(&beam, 3, 0.0), &c).at(0, 100.0).0 > 1e-3);
    }

    #[test]
    fn without_divergence_there_is_no_number_unless_corrected() {
        let (mut beam, mut c) = (tls_beam(), Corrections::NONE);
        beam.divergence = 0.0;
        for ring in 0..3 {
            let (improved, legacy) = Both::new(state(&beam, 3, 1.5), &c).at(ring, 100.0);
            assert!(improved.is_nan() && legacy.is_nan());
        }
        c.collimated_energy = true;
        let models = Both::new(state(&beam, 3, 1.5), &c);
        near(models.at(0, 100.0).0, 3492.603260504615, 1e-9);
        near(models.at(0, 100.0).1, 3492.603260504615, 1e-9);
        assert_eq!(models.at(1, 100.0), (0.0, 0.0));
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
    fn reflections_are_evaluated_alike_wherever_they_stand() {
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
