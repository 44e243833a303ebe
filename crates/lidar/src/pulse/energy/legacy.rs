//! The legacy energy model of the reference (spec pulse-physics §3.3).

use super::beam::{BeamState, extinction, half_angle, received_scale, rings_of_subrays};
use super::series::{MAX_SERIES_ARGUMENT, exponential, series};
use crate::pulse::lanes::{Block, LANES};
use crate::pulse::subray::{rays_in_ring, ring_angle};
use libm::sin;
use std::array::from_fn;
use std::f64::consts::PI;
use vlscan_base::corrections::Corrections;

/// I ∝ R⁻², each ring damped by the beam's profile.
#[derive(Clone, Debug)]
pub struct Legacy {
    surface: f64,
    pub cross_section: f64,
    pub profile: Vec<RingProfile>,
    pub lanes: Vec<ProfileBlock>,
    range_min_squared: f64,
    double_extinction: f64,
}

/// The beam's profile in a ring: exp(−k·R²/(R²+R0²)).
#[derive(Clone, Copy, Debug)]
pub struct RingProfile {
    /// k.
    exponent: f64,
    /// exp(−k), the limit at large ranges.
    far: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct ProfileBlock {
    exponent: Block,
    far: Block,
}

impl ProfileBlock {
    pub fn of(profile: &[RingProfile], rings: &[u32]) -> ProfileBlock {
        let lane = |i: usize| profile[rings.get(i).map_or(0, |r| *r as usize)];
        ProfileBlock { exponent: from_fn(|i| lane(i).exponent), far: from_fn(|i| lane(i).far) }
    }
}

impl Legacy {
    pub fn new(state: BeamState, corrections: &Corrections) -> Legacy {
        let BeamState { beam, rings, .. } = state;
        let (start, leg) = (state.start_divergence, state.leg_divergence);
        let divisor = if corrections.true_subray_count {
            (0..rings).map(|i| f64::from(rays_in_ring(i))).sum()
        } else {
            1.0 + 3.0 * f64::from(rings) * (f64::from(rings) - 1.0)
        };
        let scale = received_scale(beam);
        let collimated = leg == 0.0;
        let profile = |i| {
            if collimated {
                return RingProfile { exponent: 0.0, far: if i == 0 { 1.0 } else { 0.0 } };
            }
            let sine = sin(ring_angle(half_angle(start, corrections), rings, i));
            let spread = beam.quality * sine / half_angle(leg, corrections);
            let exponent = 2.0 * spread * spread;
            RingProfile { exponent, far: libm::exp(-exponent) }
        };
        let profile: Vec<RingProfile> = (0..rings).map(profile).collect();
        let footprint = if collimated { 1.0 } else { start * start / divisor / (leg * leg) };
        Legacy {
            surface: scale * (PI / 4.0) * footprint,
            cross_section: scale / (4.0 * PI * (leg * leg)),
            lanes: rings_of_subrays(rings)
                .chunks(LANES)
                .map(|rings| ProfileBlock::of(&profile, rings))
                .collect(),
            profile,
            range_min_squared: state.range_min * state.range_min,
            double_extinction: 2.0 * extinction(beam, corrections),
        }
    }

    /// Intensities for a reflectance factor of 1.
    #[inline(always)]
    pub fn gains(&self, ring: &ProfileBlock, range: &Block, out: &mut Block) {
        self.damping(ring, range, out);
        for i in 0..LANES {
            out[i] = self.surface * out[i] / (range[i] * range[i]);
        }
    }

    /// Losses by the beam's profile and the atmosphere.
    #[inline(always)]
    pub fn damping(&self, ring: &ProfileBlock, range: &Block, out: &mut Block) {
        let mut x = [0.0; LANES];
        let mut other = 0;
        for i in 0..LANES {
            let near = self.range_min_squared / (range[i] * range[i] + self.range_min_squared);
            x[i] = ring.exponent[i] * near - range[i] * self.double_extinction;
            out[i] = ring.far[i] * (1.0 + x[i] * series(x[i]));
            let small = x[i].abs() < MAX_SERIES_ARGUMENT;
            other |= u32::from(!small & range[i].is_finite());
        }
        if other != 0 {
            for i in 0..LANES {
                out[i] = ring.far[i] * exponential(x[i]);
            }
        }
    }
}
