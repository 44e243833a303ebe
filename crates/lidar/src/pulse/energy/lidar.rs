//! Received power in nanowatts: the lidar equation of a beam whose subrays carry equal shares of its energy.
//!
//! A Lambert surface of reflectance ρ at range R that intercepts the whole beam sends
//!
//! ```text
//! P_r = P_t · ρ cos θ/π · (π D²/4)/R² · η · e^(−2αR) = P_t · ρ cos θ · D² · η · e^(−2αR) / (4R²)
//! ```
//!
//! into a receiver of diameter D: the radiance ρ/π of the lit surface, foreshortened by the incidence angle
//! θ, times the solid angle of the receiver (Wagner et al. 2006, "Gaussian decomposition and calibration of a
//! novel small-footprint full-waveform digitising airborne laser scanner", eq. 1 to 5; Baltsavias 1999,
//! "Airborne laser scanning: basic relations and formulas"). The divergence does not occur, because the
//! surface intercepts the whole beam at any range.

use super::beam::{NANO, extinction};
use super::series::{MAX_SERIES_ARGUMENT, exponential, series};
use crate::pulse::lanes::{Block, LANES};
use vlscan_base::corrections::Corrections;
use vlscan_survey::{Beam, Overlap};

/// Pulse rate at which `average_power` is the power of one pulse, Hz, see [`pulse_energy`].
const RATED_FREQUENCY: f64 = 100_000.0;
/// Length of the pulse of which `average_power` is the power, ns.
const RATED_LENGTH: f64 = 4.0;

/// Integral of the pulse (t/τ)²·e^(−t/τ), τ = length/7: 2τ, ns.
fn default_integral(length: f64) -> f64 {
    2.0 * length / 7.0
}

/// Energy of a pulse at a pulse rate (Hz), nJ: as stated by the instrument, otherwise from its average power.
///
/// The average power of HELIOS++ instruments is the power of a pulse in that program's radar equation, at any
/// rate and length. Here it is the power of a pulse of 4 ns at 100 kHz. The mean power is the same at all
/// rates, so that a pulse at twice the rate has half the energy, and the energy is the same at all lengths.
fn pulse_energy(beam: &Beam, frequency: f64) -> f64 {
    match beam.pulse_energy {
        Some(joules) => joules * NANO,
        None => beam.average_power * default_integral(RATED_LENGTH) * (RATED_FREQUENCY / frequency),
    }
}

/// The lidar equation of a device in a leg.
#[derive(Clone, Copy, Debug)]
pub struct LidarEquation {
    /// P_t·D²·η/4 of one subray, nW m².
    scale: f64,
    /// 2α, 1/m.
    double_extinction: f64,
    /// Overlap of transmitter and receiver, with the diameter of the latter, m.
    overlap: Option<(Overlap, f64)>,
}

impl LidarEquation {
    /// Equation for `subrays` subrays of equal energy, emitted at a pulse rate (Hz).
    pub fn new(beam: &Beam, frequency: f64, subrays: usize, corrections: &Corrections) -> LidarEquation {
        let power = pulse_energy(beam, frequency) / default_integral(beam.pulse_length);
        let aperture = beam.receiver_diameter * beam.receiver_diameter * 0.25;
        LidarEquation {
            scale: NANO * power * aperture * beam.efficiency / subrays as f64,
            double_extinction: 2.0 * extinction(beam, corrections),
            overlap: beam.overlap.map(|overlap| (overlap, beam.receiver_diameter)),
        }
    }

    /// Amplitudes of a factor ρ cos θ of 1, nW relative to a pulse whose shape has the peak 1.
    #[inline(always)]
    pub fn gains(&self, range: &Block, out: &mut Block) {
        let mut x = [0.0; LANES];
        let mut other = 0;
        for i in 0..LANES {
            x[i] = -(range[i] * self.double_extinction);
            out[i] = self.scale * (1.0 + x[i] * series(x[i])) / (range[i] * range[i]);
            let small = x[i].abs() < MAX_SERIES_ARGUMENT;
            other |= u32::from(!small & range[i].is_finite());
        }
        if other != 0 {
            for i in 0..LANES {
                out[i] = self.scale * exponential(x[i]) / (range[i] * range[i]);
            }
        }
        if let Some((overlap, diameter)) = &self.overlap {
            out.iter_mut().zip(range).for_each(|(out, range)| *out *= overlap.share(*diameter, *range));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::testkit::tls_beam;

    fn gain(beam: &Beam, frequency: f64, range: f64) -> f64 {
        let mut out = [0.0; LANES];
        LidarEquation::new(beam, frequency, 1, &Corrections::REFINED).gains(&[range; LANES], &mut out);
        out[0]
    }

    fn clear(pulse_length: f64) -> Beam {
        Beam { visibility: 1e30, efficiency: 1.0, pulse_length, ..tls_beam() }
    }

    #[test]
    fn a_white_wall_at_100_m_returns_what_the_equation_says() {
        // 4 W · (0.15 m)² / (4 · (100 m)²) = 2.25 µW.
        assert!((gain(&clear(4.0), 1e5, 100.0) / 2250.0 - 1.0).abs() < 1e-12);
        assert!((gain(&clear(4.0), 1e5, 2.0) / gain(&clear(4.0), 1e5, 2000.0) / 1e6 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_mean_power_and_the_energy_of_a_pulse_are_conserved() {
        let (slow, fast) = (gain(&clear(4.0), 5e4, 100.0), gain(&clear(4.0), 1e6, 100.0));
        assert!((slow / fast - 20.0).abs() < 1e-12);
        let energy = |length: f64| gain(&clear(length), 1e5, 100.0) * default_integral(length);
        assert!((energy(8.0) / energy(2.0) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_pulse_of_a_given_energy_has_it() {
        // 1 µJ in 4 ns: 1e3 nJ / (8/7 ns) = 875 W, of which 2.25 µW / 4 W arrive at 100 m.
        let beam = Beam { pulse_energy: Some(1e-6), ..clear(4.0) };
        for frequency in [1e4, 1e6] {
            assert!((gain(&beam, frequency, 100.0) / (875.0 * 2250.0 / 4.0) - 1.0).abs() < 1e-12);
        }
    }

    /// Shares that follow from geometry alone, for a receiver of 0.1 m.
    #[test]
    fn light_of_near_targets_misses_the_detector() {
        let share = |overlap: Overlap, range: f64| {
            let beam = Beam { receiver_diameter: 0.1, ..clear(4.0) };
            gain(&Beam { overlap: Some(overlap), ..beam }, 1e5, range) / gain(&beam, 1e5, range)
        };
        let near = |found: f64, expected: f64| (found - expected).abs() < 1e-12;
        // On one axis, focused far away: (2 mrad · R/0.1 m)² up to 50 m.
        let coaxial = Overlap { field_of_view: 2e-3, baseline: 0.0, focus: 0.0 };
        for (range, expected) in [(1.0, 4e-4), (10.0, 0.04), (25.0, 0.25), (50.0, 1.0), (500.0, 1.0)] {
            assert!(near(share(coaxial, range), expected), "{range} m: {}", share(coaxial, range));
        }
        // Focused at 10 m the disc is 0.1·|1/R − 1/10| wide.
        let focused = Overlap { focus: 0.1, ..coaxial };
        assert!(near(share(focused, 10.0), 1.0) && near(share(focused, 5.0), 0.04));
        assert!(near(share(focused, 1e14), 0.04));
        // Axes 1 m apart: the disc reaches the field from (1 − 0.05)/1e-3 m on, and is within from 1050 m on.
        // At 1000 m its centre is on the edge of the field, which is 20 times as wide.
        let biaxial = Overlap { baseline: 1.0, ..coaxial };
        assert!(share(biaxial, 949.0) == 0.0 && near(share(biaxial, 1051.0), 1.0));
        let at_edge = share(biaxial, 1000.0);
        assert!((0.48..0.5).contains(&at_edge), "{at_edge}");
    }

    #[test]
    fn haze_dims_both_ways() {
        let (hazy, beam) = (Beam { visibility: 5.0, ..clear(4.0) }, clear(4.0));
        let alpha = extinction(&hazy, &Corrections::REFINED);
        for range in [1.0, 100.0, 5000.0] {
            let seen = gain(&hazy, 1e5, range) / gain(&beam, 1e5, range);
            assert!((seen / libm::exp(-2.0 * alpha * range) - 1.0).abs() < 1e-12, "{range} m");
        }
    }
}
