//! Fog, rain, snow and dust as a medium along the beam: extinction and backscatter.
//!
//! Drops and flakes of the diameter D (of snow: of the melted flake) number N₀·e^(−Λ·D) per volume and
//! diameter (Marshall and Palmer, 1948; Gunn and Marshall, 1958). They are much larger than the wavelength
//! and extinguish twice their cross-section (van de Hulst, *Light Scattering by Small Particles*, §8): α =
//! π·N₀/Λ³. A sphere of water returns the light that its front and its rear reflect along the axis:
//! (R₀/4)·(1 + (1 − R₀)²·(n/(2 − n))²) of the square of its radius per steradian. The other particles return
//! the extinction over the lidar ratio.

use libm::{exp, log, pow};
use std::f64::consts::PI;
use vlscan_survey::{AirState, Weather};

/// Diameter from which on drops and flakes can be drawn one by one, mm.
pub(super) const MIN_DIAMETER: f64 = 0.5;
/// N₀ of rain, per m³ and mm.
const RAIN_INTERCEPT: f64 = 8000.0;
/// Refractive indices of water by wavelength, nm.
const WATER_INDICES: [(f64, f64); 3] = [(532.0, 1.3346), (905.0, 1.3282), (1550.0, 1.3179)];
/// Rate below which there is neither rain nor snow, mm/h.
const MIN_RATE: f64 = 1e-6;
/// Square millimetres to square metres.
const SQUARE_MILLI: f64 = 1e-6;

/// Drops of rain or flakes of snow by diameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Drops {
    /// N₀, per m³ and mm.
    intercept: f64,
    /// Λ, 1/mm.
    slope: f64,
    /// Light that a drop returns: differential cross-section at 180° over the square of its radius, 1/sr.
    pub backscatter: f64,
}

impl Drops {
    /// Rain at a rate, mm/h, whose drops return that light.
    fn rain(rate: f64, backscatter: f64) -> Drops {
        Drops { intercept: RAIN_INTERCEPT, slope: 4.1 * pow(rate, -0.21), backscatter }
    }

    /// Snow at a rate, mm/h of melted water, with that lidar ratio, sr.
    fn snow(rate: f64, lidar_ratio: f64) -> Drops {
        let (intercept, slope) = (7.6e3 * pow(rate, -0.87), 2.55 * pow(rate, -0.48));
        Drops { intercept, slope, backscatter: 2.0 * PI / lidar_ratio }
    }

    /// Number above a diameter, mm, per m³.
    pub fn number(&self, diameter: f64) -> f64 {
        self.intercept * exp(-self.slope * diameter) / self.slope
    }

    /// Extinction by those above a diameter, mm, in 1/m.
    pub fn extinction(&self, diameter: f64) -> f64 {
        let x = self.slope * diameter;
        let all = PI * self.intercept / (self.slope * self.slope * self.slope) * SQUARE_MILLI;
        all * exp(-x) * (0.5 * x * x + x + 1.0)
    }

    /// Light that those above a diameter, mm, scatter straight back, 1/(m·sr).
    fn scattered(&self, diameter: f64) -> f64 {
        self.extinction(diameter) * self.backscatter / (2.0 * PI)
    }

    /// Diameter (mm) of a drop above [`MIN_DIAMETER`] by a uniform number in (0, 1].
    pub fn diameter(&self, uniform: f64) -> f64 {
        MIN_DIAMETER - log(uniform) / self.slope
    }
}

/// Light that a drop of water returns at a wavelength (nm), see [`Drops::backscatter`].
fn of_water_drop(wavelength: f64) -> f64 {
    let n = water_index(wavelength);
    let front = ((n - 1.0) / (n + 1.0)) * ((n - 1.0) / (n + 1.0));
    let focus = (1.0 - front) * n / (2.0 - n);
    0.25 * front * (1.0 + focus * focus)
}

/// Refractive index of water, linear between the wavelengths of [`WATER_INDICES`].
fn water_index(wavelength: f64) -> f64 {
    let [(shortest, first), .., (longest, last)] = WATER_INDICES;
    let between = |pair: &[(f64, f64)]| {
        let [(from, low), (to, high)] = [pair[0], pair[1]];
        let share = (wavelength - from) / (to - from);
        (0.0..=1.0).contains(&share).then_some(low + (high - low) * share)
    };
    let inner = WATER_INDICES.windows(2).find_map(between);
    inner.unwrap_or(if wavelength < 0.5 * (shortest + longest) { first } else { last })
}

/// Fog, rain, snow and dust at the time of a pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Air {
    /// Extinction, 1/m.
    pub extinction: f64,
    /// Light that all particles scatter straight back, 1/(m·sr).
    pub scattered: f64,
    /// [`Air::scattered`] without the drops and flakes that can be drawn one by one.
    pub scattered_by_small: f64,
    /// Drops of rain and flakes of snow.
    pub drops: [Option<Drops>; 2],
}

impl Air {
    /// The air in a state of the weather at a wavelength, nm.
    pub fn new(weather: &Weather, state: &AirState, wavelength: f64) -> Air {
        let of_drop = weather.drop_factor * of_water_drop(wavelength);
        let rain = (state.rain > MIN_RATE).then(|| Drops::rain(state.rain, of_drop));
        let snow = (state.snow > MIN_RATE).then(|| Drops::snow(state.snow, weather.lidar_ratio));
        let drops = [rain, snow];
        let of_drops = |value: fn(&Drops) -> f64| drops.iter().flatten().map(value).sum::<f64>();
        let fine = state.fog + state.dust;
        let scattered = fine / weather.lidar_ratio + of_drops(|drops| drops.scattered(0.0));
        Air {
            extinction: fine + of_drops(|drops| drops.extinction(0.0)),
            scattered,
            scattered_by_small: (scattered - of_drops(|drops| drops.scattered(MIN_DIAMETER))).max(0.0),
            drops,
        }
    }

    /// Number of drops and flakes per m³ that can be drawn one by one.
    pub fn large_drops(&self) -> f64 {
        self.drops.iter().flatten().map(|drops| drops.number(MIN_DIAMETER)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::weather_drops::tests::near;

    fn air(state: AirState, lidar_ratio: f64) -> Air {
        Air::new(&Weather { lidar_ratio, ..Weather::CLEAR }, &state, 905.0)
    }

    #[test]
    fn rain_has_the_drops_and_the_extinction_of_marshall_and_palmer() {
        for (rate, extinction) in
            [(1.0, 3.646601e-4), (5.0, 1.005170e-3), (10.0, 1.555565e-3), (25.0, 2.770706e-3)]
        {
            near(Drops::rain(rate, 0.02).extinction(0.0), extinction, 1e-6);
        }
        let rain = Drops::rain(10.0, 0.02);
        near(rain.number(0.5), 894.0243, 1e-7);
        near(rain.extinction(0.5), 1.346056e-3, 1e-6);
        // Drops by their diameters: mean of D² above 0.5 mm.
        let count = 100_000;
        let squares = (0..count).map(|i| rain.diameter((f64::from(i) + 0.5) / f64::from(count)).powi(2));
        let mean = squares.sum::<f64>() / f64::from(count);
        near(0.5 * PI * rain.number(0.5) * mean * SQUARE_MILLI, rain.extinction(0.5), 1e-3);
    }

    #[test]
    fn snow_has_the_extinction_of_gunn_and_marshall() {
        near(Drops::snow(1.0, 18.5).extinction(0.0), 1.439935e-3, 1e-6);
        // All of it scatters by the lidar ratio.
        let snow = air(AirState { snow: 1.0, ..AirState::default() }, 20.0);
        near(snow.scattered, snow.extinction / 20.0, 1e-12);
    }

    #[test]
    fn drops_return_the_light_of_their_front_and_rear() {
        for (wavelength, expected) in [(532.0, 2.495405e-2), (905.0, 2.362269e-2), (1550.0, 2.160331e-2)] {
            near(of_water_drop(wavelength), expected, 1e-6);
        }
        assert_eq!(water_index(300.0), 1.3346);
        assert_eq!(water_index(2000.0), 1.3179);
        assert!((water_index(718.5) - 1.3314).abs() < 1e-12);
        // The lidar ratio of rain follows: 266 sr.
        let rain = air(AirState { rain: 10.0, ..AirState::default() }, 18.5);
        near(rain.extinction / rain.scattered, 2.0 * PI / 2.362269e-2, 1e-6);
        let twice = Weather { drop_factor: 2.0, ..Weather::CLEAR };
        let bright = Air::new(&twice, &AirState { rain: 10.0, ..AirState::default() }, 905.0);
        near(bright.scattered, 2.0 * rain.scattered, 1e-12);
    }

    #[test]
    fn extinctions_add_up_and_large_drops_are_a_part() {
        let state = AirState { fog: 0.03, rain: 10.0, snow: 1.0, dust: 0.01 };
        let all = air(state, 18.5);
        near(all.extinction, 0.04 + 1.555565e-3 + 1.439935e-3, 1e-6);
        assert!(all.scattered_by_small < all.scattered && all.scattered_by_small > 0.04 / 18.5);
        let fog = air(AirState { fog: 0.03, ..AirState::default() }, 18.5);
        assert_eq!((fog.large_drops(), fog.scattered_by_small), (0.0, 0.03 / 18.5));
    }
}
