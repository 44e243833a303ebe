//! The optics and the atmosphere that all energy models share (spec pulse-physics §3.1).

use crate::pulse::lanes::LANES;
use crate::pulse::subray::rays_in_ring;
use libm::pow;
use vlscan_base::corrections::Corrections;
use vlscan_survey::Beam;

/// Nanowatts per watt; amplitudes are in nanowatts.
pub const NANO: f64 = 1e9;

/// State of a beam for which an energy model is computed.
#[derive(Clone, Copy, Debug)]
pub struct BeamState<'a> {
    pub beam: &'a Beam,
    pub rings: u32,
    /// Minimum range R0, m.
    pub range_min: f64,
    /// rad, when the simulation started.
    pub start_divergence: f64,
    /// rad.
    pub leg_divergence: f64,
    /// Pulse rate of the leg, Hz.
    pub frequency: f64,
}

/// The ring of every subray, padded to whole blocks with the last ring.
pub fn rings_of_subrays(rings: u32) -> Vec<u32> {
    let mut all: Vec<u32> =
        (0..rings).flat_map(|r| std::iter::repeat_n(r, rays_in_ring(r) as usize)).collect();
    all.resize(all.len().next_multiple_of(LANES), rings.saturating_sub(1));
    all
}

/// Half opening angle of the traced cone, which is also the angle of the waist formula.
pub fn half_angle(divergence: f64, corrections: &Corrections) -> f64 {
    if corrections.full_angle_divergence { divergence * 0.5 } else { divergence }
}

/// Extinction by the atmosphere, 1/m.
pub fn extinction(beam: &Beam, corrections: &Corrections) -> f64 {
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

/// P·D²·η in nW m².
pub fn received_scale(beam: &Beam) -> f64 {
    NANO * beam.average_power * (beam.receiver_diameter * beam.receiver_diameter) * beam.efficiency
}
