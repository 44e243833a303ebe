//! Received power of one reflection (spec pulse-physics §3).

use super::options::{Corrections, PhysicsOptions};
use super::subray::{rays_in_ring, ring_angle};
use crate::survey::Beam;
use libm::{pow, sin};
use std::f64::consts::PI;

/// Watts to the nanowatt-like unit of intensities.
const NANO: f64 = 1e9;

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
}

/// How much a surface sends back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Response {
    /// Reflectance factor f(θ) of a surface that fills the beam.
    Factor(f64),
    /// Cross-section of a voxel with a leaf angle table (§3.5), evaluated by the legacy law in either model.
    #[cfg_attr(not(test), allow(dead_code))]
    CrossSection(f64),
}

/// The energy models of a device.
#[derive(Clone, Debug)]
pub(super) enum Energy {
    /// Spec §3.3.
    Legacy(Legacy),
    /// Spec §3.4, with the legacy law for voxels that need it.
    Improved(Improved, Legacy),
}

impl Energy {
    /// The model that a run uses for a device.
    pub fn new(state: BeamState, multi_channel: bool, options: &PhysicsOptions) -> Energy {
        let legacy = Legacy::new(state, &options.corrections);
        if options.legacy_energy && !multi_channel {
            return Energy::Legacy(legacy);
        }
        Energy::Improved(Improved::new(state, &options.corrections), legacy)
    }
}

/// Half opening angle of the traced cone, which is also the angle of the waist formula.
pub(super) fn half_angle(divergence: f64, corrections: &Corrections) -> f64 {
    if corrections.full_angle_divergence { divergence * 0.5 } else { divergence }
}

/// Extinction by the atmosphere, per metre as the models apply it (§3.1).
fn extinction(beam: &Beam, corrections: &Corrections) -> f64 {
    let v = beam.visibility;
    let clear = if corrections.atmosphere_units { v >= 50.0 } else { v > 50.0 };
    let q = if clear {
        1.6
    } else if v > 6.0 && v < 50.0 {
        1.3
    } else {
        0.585 * pow(v, 0.33)
    };
    if corrections.atmosphere_units {
        (3.91 / v) * pow(beam.atmosphere_wavelength * 1e-3 / 0.55, -q) * 1e-3
    } else {
        (3.91 / v) * pow(beam.atmosphere_wavelength / 0.55, -q)
    }
}

/// P·D²·η in nanowatt square metres, the factor that all laws share.
fn received_scale(beam: &Beam) -> f64 {
    NANO * beam.average_power * (beam.receiver_diameter * beam.receiver_diameter) * beam.efficiency
}

/// The older law: I ∝ R⁻², each ring damped by the beam's profile.
#[derive(Clone, Debug)]
pub(super) struct Legacy {
    surface: f64,
    cross_section: f64,
    /// Exponent of the beam profile of each ring, far away.
    profile: Vec<f64>,
    range_min_squared: f64,
    double_extinction: f64,
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
        let profile = (0..rings)
            .map(|i| {
                if collimated {
                    return if i == 0 { 0.0 } else { f64::INFINITY };
                }
                let sine = sin(ring_angle(half_angle(start, corrections), rings, i));
                let spread = beam.quality * sine / half_angle(leg, corrections);
                2.0 * spread * spread
            })
            .collect();
        Legacy {
            surface: if collimated {
                scale * PI / 4.0
            } else {
                scale * (PI / 4.0) * (start * start) / divisor / (leg * leg)
            },
            cross_section: scale / (4.0 * PI * (leg * leg)),
            profile,
            range_min_squared: state.range_min * state.range_min,
            double_extinction: 2.0 * extinction(beam, corrections),
        }
    }

    /// Intensity of a reflection at `range` m in `ring`.
    pub fn intensity(&self, ring: u32, range: f64, response: Response) -> f64 {
        let square = range * range;
        let damping = exponential(
            -(self.profile[ring as usize] * (square / (square + self.range_min_squared))
                + range * self.double_extinction),
        );
        match response {
            Response::Factor(f) => self.surface * f / square * damping,
            Response::CrossSection(sigma) => self.cross_section * sigma / (square * square) * damping,
        }
    }
}

/// The newer law: each ring carries its share of a Gaussian beam.
#[derive(Clone, Debug)]
pub(super) struct Improved {
    rings: Vec<Ring>,
    /// w0², m².
    waist_squared: f64,
    /// λ / (π w0²), 1/m.
    spread: f64,
    /// R0, m; ∞ puts the waist at the exit.
    focus: f64,
    in_metres: bool,
    double_extinction: f64,
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
        let collimated = corrections.collimated_energy && divergence == 0.0;
        let scale = received_scale(beam) * PI / 4.0;
        let radius = |i: u32| {
            if i == 0 { 0.0 } else { divergence * (f64::from(i) - 0.5) / (2.0 * (f64::from(rings) - 0.5)) }
        };
        let ring = |i| {
            let (inner, outer) = (radius(i) * radius(i), radius(i + 1) * radius(i + 1));
            let area = PI * (outer - inner) / f64::from(rays_in_ring(i));
            // The subray's area cancels from the law, but without divergence it is 0/0.
            Ring {
                scale: scale / f64::from(rays_in_ring(i)) * (area / area),
                inner: 2.0 * inner,
                width: 2.0 * (outer - inner),
            }
        };
        // All on the axis: an infinitely wide first ring and empty others.
        let on_axis = |i| {
            let width = if i == 0 { f64::INFINITY } else { 0.0 };
            Ring { scale: if i == 0 { scale } else { 0.0 }, inner: 0.0, width }
        };
        let wavelength = beam.wavelength * 1e-9;
        let waist = if collimated {
            1.0
        } else {
            beam.quality * wavelength / (PI * half_angle(divergence, corrections))
        };
        Improved {
            rings: (0..rings).map(|i| if collimated { on_axis(i) } else { ring(i) }).collect(),
            waist_squared: waist * waist,
            spread: wavelength / (PI * (waist * waist)),
            focus: if corrections.waist_at_exit || collimated { f64::INFINITY } else { state.range_min },
            in_metres: corrections.ring_radii_in_metres,
            double_extinction: 2.0 * extinction(beam, corrections),
        }
    }

    /// Intensity of a reflection at `range` m in `ring` from a surface of reflectance factor `f`.
    pub fn intensity(&self, ring: u32, range: f64, f: f64) -> f64 {
        let ring = &self.rings[ring as usize];
        let (defocus, spread) = (1.0 - range / self.focus, self.spread * range);
        let beam_squared = self.waist_squared * (defocus * defocus + spread * spread);
        let unit = if self.in_metres { range * range / beam_squared } else { 1.0 / beam_squared };
        // e^(−a) − e^(−b) without cancellation.
        let share = -exponential_minus_one(-(ring.width * unit));
        let damping = exponential(-(ring.inner * unit + range * self.double_extinction));
        ring.scale * f * share * damping / (range * range)
    }
}

/// Arguments below this need only a short series.
const SMALL: f64 = 1.0 / 32.0;

/// e^x. Near 0, where most arguments of these laws lie, a series of 8 terms is exact to the last digit.
fn exponential(x: f64) -> f64 {
    if x.abs() < SMALL { 1.0 + x * series(x) } else { libm::exp(x) }
}

/// e^x − 1.
fn exponential_minus_one(x: f64) -> f64 {
    if x.abs() < SMALL { x * series(x) } else { libm::expm1(x) }
}

/// (e^x − 1)/x for small x: Σ x^k/(k+1)!.
fn series(x: f64) -> f64 {
    const C: [f64; 8] =
        [1.0, 1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0, 1.0 / 5040.0, 1.0 / 40320.0];
    let square = x * x;
    let low = (C[0] + C[1] * x) + square * (C[2] + C[3] * x);
    let high = (C[4] + C[5] * x) + square * (C[6] + C[7] * x);
    low + square * square * high
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
        }
    }

    fn both(rings: u32, range_min: f64) -> (Improved, Legacy) {
        let (beam, none) = (tls_beam(), Corrections::NONE);
        (
            Improved::new(state(&beam, rings, range_min), &none),
            Legacy::new(state(&beam, rings, range_min), &none),
        )
    }

    fn near(value: f64, expected: f64, relative: f64) {
        assert!((value / expected - 1.0).abs() < relative, "{value:e} is not {expected:e}");
    }

    #[test]
    fn intensities_of_the_worked_example() {
        // spec pulse-physics §3.6: R = 100 m, ρ = 0.5, θ = 0
        let (improved, legacy) = both(3, 1.5);
        let expected = [
            (0, 9.829395356e-4, 183.8212242),
            (1, 1.310584388e-3, 147.1998880),
            (2, 1.310579962e-3, 75.58627778),
        ];
        for (ring, i, l) in expected {
            near(improved.intensity(ring, 100.0, 0.5), i, 1e-9);
            near(legacy.intensity(ring, 100.0, Response::Factor(0.5)), l, 1e-9);
        }
        let all = Subrays::new(3e-4, 3).ring;
        near(all.iter().map(|r| improved.intensity(*r, 100.0, 0.5)).sum(), 2.457340540e-2, 1e-9);
        near(all.iter().map(|r| legacy.intensity(*r, 100.0, Response::Factor(0.5))).sum(), 1974.055885, 1e-9);
    }

    #[test]
    fn range_dependence_of_the_worked_example() {
        let (improved, legacy) = both(1, 1.5);
        let expected = [
            (10.0, 315.1746, 3.498314e5),
            (30.0, 3.231312, 3.885604e4),
            (100.0, 2.457341e-2, 3492.603),
            (300.0, 2.970676e-4, 386.6607),
            (1000.0, 2.361525e-6, 34.36009),
        ];
        for (range, i, l) in expected {
            near(improved.intensity(0, range, 0.5), i, 3e-7);
            near(legacy.intensity(0, range, Response::Factor(0.5)), l, 3e-7);
        }
        near(legacy.intensity(0, 100.0, Response::Factor(0.5)), 3492.603260504615, 1e-12);
        for (range_min, i) in
            [(0.01, 1.2334e-6), (0.5, 3.0594e-3), (1.5, 2.4573e-2), (10.0, 0.15666), (100.0, 0.17463)]
        {
            near(both(1, range_min).0.intensity(0, 100.0, 0.5), i, 4e-5);
        }
    }

    #[test]
    fn without_minimum_range_the_improved_model_receives_nothing_unless_corrected() {
        assert_eq!(both(3, 0.0).0.intensity(0, 100.0, 0.5), 0.0);
        let (beam, mut c) = (tls_beam(), Corrections::NONE);
        c.waist_at_exit = true;
        assert!(Improved::new(state(&beam, 3, 0.0), &c).intensity(0, 100.0, 0.5) > 1e-3);
    }

    #[test]
    fn without_divergence_there_is_no_number_unless_corrected() {
        let (mut beam, mut c) = (tls_beam(), Corrections::NONE);
        beam.divergence = 0.0;
        for ring in 0..3 {
            assert!(Improved::new(state(&beam, 3, 1.5), &c).intensity(ring, 100.0, 0.5).is_nan());
            assert!(
                Legacy::new(state(&beam, 3, 1.5), &c).intensity(ring, 100.0, Response::Factor(0.5)).is_nan()
            );
        }
        c.collimated_energy = true;
        let improved = Improved::new(state(&beam, 3, 1.5), &c);
        let legacy = Legacy::new(state(&beam, 3, 1.5), &c);
        near(improved.intensity(0, 100.0, 0.5), 3492.603260504615, 1e-9);
        near(legacy.intensity(0, 100.0, Response::Factor(0.5)), 3492.603260504615, 1e-9);
        assert_eq!(improved.intensity(1, 100.0, 0.5), 0.0);
        assert_eq!(legacy.intensity(1, 100.0, Response::Factor(0.5)), 0.0);
    }

    #[test]
    fn metres_make_extended_targets_fade_with_the_square_of_range() {
        let (beam, mut c) = (tls_beam(), Corrections::NONE);
        (c.waist_at_exit, c.ring_radii_in_metres) = (true, true);
        let improved = Improved::new(state(&beam, 3, 1.5), &c);
        let ratio = improved.intensity(0, 500.0, 0.5) / improved.intensity(0, 1000.0, 0.5);
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
        let legacy = both(1, 1.5).1;
        for (range, amplitude) in [(99.0, 221051.9156), (101.0, 204048.6845)] {
            near(legacy.intensity(0, range, Response::CrossSection(0.5)) * 0.540032849, amplitude, 3e-9);
        }
    }

    #[test]
    fn the_series_is_as_exact_as_the_library() {
        for i in -3200..3200 {
            let x = f64::from(i) * 1e-5;
            near(exponential(x), libm::exp(x), 3e-16);
            if x != 0.0 {
                near(exponential_minus_one(x), libm::expm1(x), 5e-16);
            }
        }
        assert_eq!(exponential(f64::NEG_INFINITY), 0.0);
        assert!(exponential(f64::NAN).is_nan());
    }
}
