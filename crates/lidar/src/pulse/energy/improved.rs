//! The improved energy model of the reference (spec pulse-physics §3.4).

use super::beam::{BeamState, extinction, half_angle, received_scale, rings_of_subrays};
use super::series::{MAX_SERIES_ARGUMENT, exponential, exponential_minus_one, series};
use crate::pulse::lanes::{Block, LANES};
use crate::pulse::subray::rays_in_ring;
use std::array::from_fn;
use std::f64::consts::PI;
use vlscan_base::corrections::Corrections;

/// Each ring carries its share of a Gaussian beam.
#[derive(Clone, Debug)]
pub struct Improved {
    pub rings: Vec<Ring>,
    pub lanes: Vec<RingBlock>,
    /// w0², m².
    waist_squared: f64,
    /// λ / (π w0²), 1/m.
    spread: f64,
    /// 1/R0, 1/m; 0 puts the waist at the exit, as it must be where R0 is 0.
    focus: f64,
    in_metres: bool,
    double_extinction: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct RingBlock {
    scale: Block,
    inner: Block,
    width: Block,
}

impl RingBlock {
    pub fn of(rings: &[Ring], some: &[u32]) -> RingBlock {
        let lane = |i: usize| rings[some.get(i).map_or(0, |r| *r as usize)];
        RingBlock {
            scale: from_fn(|i| lane(i).scale),
            inner: from_fn(|i| lane(i).inner),
            width: from_fn(|i| lane(i).width),
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Ring {
    /// All factors that do not depend on range or surface.
    scale: f64,
    /// 2ρ² of the inner radius.
    inner: f64,
    /// 2ρ² of the outer radius, minus `inner`.
    width: f64,
}

impl Improved {
    pub fn new(state: BeamState, corrections: &Corrections) -> Improved {
        let BeamState { beam, rings, start_divergence: divergence, .. } = state;
        let scale = received_scale(beam) * PI / 4.0;
        let collimated = divergence == 0.0;
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
            lanes: rings_of_subrays(rings)
                .chunks(LANES)
                .map(|rings| RingBlock::of(&of_rings, rings))
                .collect(),
            rings: of_rings,
            waist_squared: waist * waist,
            spread: wavelength / (PI * (waist * waist)),
            focus: if corrections.waist_at_exit || collimated || state.range_min == 0.0 {
                0.0
            } else {
                1.0 / state.range_min
            },
            in_metres: corrections.ring_radii_in_metres,
            double_extinction: 2.0 * extinction(beam, corrections),
        }
    }

    /// Intensities for a reflectance factor of 1.
    #[inline(always)]
    pub fn gains(&self, ring: &RingBlock, range: &Block, out: &mut Block) {
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
            let small = (x.abs() < MAX_SERIES_ARGUMENT) & (y.abs() < MAX_SERIES_ARGUMENT);
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
    pub fn new(scale: f64, divergence: f64, rings: u32, i: u32) -> Ring {
        let radius = |i: u32| {
            if i == 0 { 0.0 } else { divergence * (f64::from(i) - 0.5) / (2.0 * (f64::from(rings) - 0.5)) }
        };
        let (inner, outer) = (radius(i) * radius(i), radius(i + 1) * radius(i + 1));
        let rays = f64::from(rays_in_ring(i));
        // The area of a subray, π(outer − inner)/rays, cancels from the law; but without divergence it is
        // 0/0.
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
