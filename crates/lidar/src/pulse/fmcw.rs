//! Ranges and velocities by a frequency-modulated continuous wave.
//!
//! A chirp of bandwidth B and duration T beats with its echo at the frequencies f_R + f_D, while it rises,
//! and f_R − f_D, while it falls, with f_R = 2BR/(cT) and f_D = 2v/λ. A receiver takes R and v from the sum
//! and the difference of the two. One without quadratures loses the signs of the frequencies: where |f_D| >
//! f_R, range and velocity change places. Frequencies beyond half of the sampling rate fold.

use super::echo::EchoVelocity;
use libm::{floor, hypot, log, sqrt};
use std::f64::consts::LN_2;
use vlscan_geom::LIGHT_SPEED;
use vlscan_survey::Fmcw;

/// Nanoseconds per second.
const NANO: f64 = 1e9;
/// Speed of light, m/s.
const METRES_PER_SECOND: f64 = LIGHT_SPEED * NANO;

/// Chirps of a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Chirps {
    /// Beat frequency per range, Hz/m.
    per_range: f64,
    /// Doppler shift per velocity, Hz/(m/s).
    per_velocity: f64,
    sample_rate: Option<f64>,
    has_quadrature: bool,
    /// Standard deviation of the line of a resting target, m/s.
    line: f64,
}

impl Chirps {
    /// Chirps of light of this wavelength, nm.
    pub fn new(wave: &Fmcw, wavelength: f64) -> Chirps {
        let wavelength = wavelength / NANO;
        // A line of λ/(2T) at half maximum.
        let line = velocity_resolution(wave, wavelength) / sqrt(8.0 * LN_2);
        Chirps {
            per_range: 2.0 * wave.bandwidth / (METRES_PER_SECOND * wave.chirp),
            per_velocity: 2.0 / wavelength,
            sample_rate: wave.sample_rate,
            has_quadrature: wave.has_quadrature,
            line,
        }
    }

    /// Range and velocity that the receiver takes from the beat frequencies of an echo.
    pub fn measured(&self, range: f64, velocity: EchoVelocity) -> (f64, EchoVelocity) {
        let spread = hypot(velocity.spread, self.line);
        let (of_range, of_velocity) = (self.per_range * range, self.per_velocity * velocity.radial);
        let beats = [of_range + of_velocity, of_range - of_velocity];
        let [up, down] = beats.map(|beat| self.frequency(beat));
        if [up, down] == beats {
            return (range, EchoVelocity { spread, ..velocity });
        }
        let radial = (up - down) / (2.0 * self.per_velocity);
        ((up + down) / (2.0 * self.per_range), EchoVelocity { radial, spread })
    }

    /// The frequency that the receiver measures, Hz.
    fn frequency(&self, beat: f64) -> f64 {
        let amount = if self.has_quadrature { beat } else { beat.abs() };
        match self.sample_rate {
            Some(rate) if self.has_quadrature => amount - rate * floor(amount / rate + 0.5),
            Some(rate) => (amount - rate * floor(amount / rate + 0.5)).abs(),
            None => amount,
        }
    }
}

/// Full width at half maximum of the echo of a chirp, ns: that of the range resolution c/(2B).
pub(super) fn width(wave: &Fmcw) -> f64 {
    NANO / wave.bandwidth
}

/// Velocity resolution of a chirp, m/s: λ/(2T) for a wavelength in m.
fn velocity_resolution(wave: &Fmcw, wavelength: f64) -> f64 {
    wavelength / (2.0 * wave.chirp)
}

/// Logarithm of a probability of a false alarm: the threshold over the mean power of the noise.
pub(super) fn threshold_over_noise(false_alarm: f64) -> f64 {
    -log(false_alarm)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WAVE: Fmcw =
        Fmcw { bandwidth: 1e9, chirp: 1e-5, sample_rate: None, has_quadrature: false, false_alarm: None };

    fn measured(wave: Fmcw, range: f64, radial: f64) -> (f64, f64) {
        let found = Chirps::new(&wave, 1550.0).measured(range, EchoVelocity { radial, spread: 0.0 });
        (found.0, found.1.radial)
    }

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
    }

    #[test]
    fn beat_frequencies_and_resolutions_are_those_of_the_chirp() {
        let chirps = Chirps::new(&WAVE, 1550.0);
        let (of_range, of_velocity) = (chirps.per_range * 100.0, chirps.per_velocity * 12.345678);
        near(of_range / 6.671282e7, 1.0, 1e-7);
        near((of_range + of_velocity) / 8.264273e7, 1.0, 1e-7);
        near((of_range - of_velocity) / 5.078291e7, 1.0, 1e-7);
        near(velocity_resolution(&WAVE, 1550e-9), 0.0775, 1e-12);
        near(width(&WAVE) * 0.5 * LIGHT_SPEED, 0.149896, 1e-6);
        near(chirps.line * sqrt(8.0 * LN_2), 0.0775, 1e-12);
        let found = chirps.measured(100.0, EchoVelocity { radial: 12.345678, spread: 0.25 });
        assert_eq!((found.0, found.1.radial), (100.0, 12.345678));
        near(found.1.spread, hypot(0.25, chirps.line), 1e-15);
    }

    #[test]
    fn real_receivers_confuse_range_and_velocity_at_short_range() {
        // 50 m/s fold below 96.707245 m.
        let at = |range: f64, velocity: f64| measured(WAVE, range, velocity);
        assert_eq!(at(96.707246, 50.0), (96.707246, 50.0));
        assert_eq!(at(96.707246, -50.0), (96.707246, -50.0));
        let (range, velocity) = at(90.0, 50.0);
        near(range, 96.707245, 1e-6);
        near(velocity, 50.0 * 90.0 / 96.707245, 1e-6);
        let (range, velocity) = at(90.0, -50.0);
        near(range, 96.707245, 1e-6);
        near(velocity, -50.0 * 90.0 / 96.707245, 1e-6);
        near(at(0.0, 50.0).1, 0.0, 1e-12);
        let quadrature = Fmcw { has_quadrature: true, ..WAVE };
        assert_eq!(measured(quadrature, 90.0, -50.0), (90.0, -50.0));
    }

    #[test]
    fn frequencies_beyond_half_of_the_sampling_rate_fold() {
        let wave = Fmcw { has_quadrature: true, sample_rate: Some(1e9), ..WAVE };
        // λ·(f_s/2 − f_R)/2 at 100 m.
        let limit = 1550e-9 * (5e8 - 6.671281904e7) * 0.5;
        assert_eq!(measured(wave, 100.0, limit - 1e-3), (100.0, limit - 1e-3));
        let (range, velocity) = measured(wave, 100.0, limit + 1e-3);
        // One of the frequencies is short by the sampling rate.
        near(velocity, limit + 1e-3 - 1550e-9 * 1e9 / 4.0, 1e-6);
        near(range, 100.0 - 1e9 / (4.0 * 1e9 / (METRES_PER_SECOND * 1e-5)), 1e-6);
        // A real receiver mirrors the frequency.
        let (range, _) = measured(Fmcw { sample_rate: Some(1e8), ..WAVE }, 100.0, 0.0);
        near(range, (1e8 - 6.671281904e7) / 6.671281904e5, 1e-5);
    }

    #[test]
    fn false_alarms_of_an_exponential_power_give_the_threshold() {
        near(threshold_over_noise(1e-6), 13.815510557964274, 1e-12);
    }
}
