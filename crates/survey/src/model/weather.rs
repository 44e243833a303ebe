//! Fog, rain, snow and dust between the instrument and the surfaces.

use super::ScannerSettings;
use std::fmt;
use std::sync::Arc;

/// Fog, rain, snow and dust at some time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AirState {
    /// Extinction by fog, 1/m.
    pub fog: f64,
    /// Rainfall, mm/h.
    pub rain: f64,
    /// Snowfall, mm/h of melted water.
    pub snow: f64,
    /// Extinction by dust, 1/m.
    pub dust: f64,
}

/// Contrast at the meteorological optical range (WMO, *Guide to Instruments and Methods of Observation*).
const CONTRAST: f64 = 0.05;

impl AirState {
    /// Extinction (1/m) of fog of this meteorological optical range (m): ln 20 over the range.
    pub fn fog_of_range(range: f64) -> f64 {
        -libm::log(CONTRAST) / range
    }

    /// This state with the `share`, 0 to 1, of the way to another one.
    fn towards(&self, other: &AirState, share: f64) -> AirState {
        let mix = |from: f64, to: f64| from + (to - from) * share;
        AirState {
            fog: mix(self.fog, other.fog),
            rain: mix(self.rain, other.rain),
            snow: mix(self.snow, other.snow),
            dust: mix(self.dust, other.dust),
        }
    }
}

/// Weather of a leg. The default is clear: the haze of the scanner's visibility alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Weather {
    /// Visibility in haze, km, instead of that of the scanner.
    pub visibility: Option<f64>,
    /// Fog, rain, snow and dust, constant over time.
    pub air: AirState,
    /// States by ascending GPS time of week, s, instead of `air`: linear between two times and constant
    /// before the first and after the last one. Not empty.
    pub over_time: Option<Arc<[(f64, AirState)]>>,
    /// Extinction over backscatter of fog, snow and dust, sr.
    pub lidar_ratio: f64,
    /// Factor on the light that raindrops return.
    pub drop_factor: f64,
}

impl Weather {
    /// Haze alone.
    pub const CLEAR: Weather = Weather {
        visibility: None,
        air: AirState { fog: 0.0, rain: 0.0, snow: 0.0, dust: 0.0 },
        over_time: None,
        lidar_ratio: Weather::LIDAR_RATIO,
        drop_factor: 1.0,
    };

    /// Default of [`Weather::lidar_ratio`]: that of advection fog at 905 nm, by Mie's theory for the
    /// distributions of droplets of Rasshofer et al. (2011), "Influences of weather phenomena on automotive
    /// laser radar systems".
    pub const LIDAR_RATIO: f64 = 18.5;

    /// True if nothing but haze is in the air, at any time.
    pub fn is_clear(&self) -> bool {
        self.air == AirState::default()
            && self.over_time.iter().flat_map(|rows| rows.iter()).all(|row| row.1 == AirState::default())
    }

    /// Visibility in haze (km), which is unlimited where fog takes its place; `of_scanner` is that of the
    /// scanner.
    pub fn haze_visibility(&self, of_scanner: f64) -> f64 {
        let mut over_time = self.over_time.iter().flat_map(|rows| rows.iter());
        if self.air.fog > 0.0 || over_time.any(|row| row.1.fog > 0.0) {
            return f64::INFINITY;
        }
        self.visibility.unwrap_or(of_scanner)
    }

    /// Fog, rain, snow and dust at a GPS time of week, s.
    pub fn at(&self, time: f64) -> AirState {
        let Some(rows) = &self.over_time else { return self.air };
        let next = rows.partition_point(|row| row.0 <= time);
        match (next.checked_sub(1).and_then(|before| rows.get(before)), rows.get(next)) {
            (Some((from, before)), Some((to, after))) => before.towards(after, (time - from) / (to - from)),
            (Some((_, row)), None) | (None, Some((_, row))) => *row,
            (None, None) => self.air,
        }
    }
}

impl Default for Weather {
    fn default() -> Weather {
        Weather::CLEAR
    }
}

impl fmt::Debug for ScannerSettings {
    /// Checksums of surveys include this text, so legs in clear air have no weather in it.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        // Checksums would miss a field that is not named.
        let ScannerSettings {
            active,
            pulse_freq,
            pulse_times,
            scan_freq,
            scan_angle,
            vertical_min,
            vertical_max,
            head_rate,
            head_start,
            head_stop,
            beam_divergence,
            written_divergence,
            trajectory_interval,
            max_duration,
            warmup,
            weather,
        } = self;
        let mut fields = f.debug_struct("ScannerSettings");
        fields
            .field("active", active)
            .field("pulse_freq", pulse_freq)
            .field("pulse_times", pulse_times)
            .field("scan_freq", scan_freq)
            .field("scan_angle", scan_angle)
            .field("vertical_min", vertical_min)
            .field("vertical_max", vertical_max)
            .field("head_rate", head_rate)
            .field("head_start", head_start)
            .field("head_stop", head_stop)
            .field("beam_divergence", beam_divergence)
            .field("written_divergence", written_divergence)
            .field("trajectory_interval", trajectory_interval)
            .field("max_duration", max_duration)
            .field("warmup", warmup);
        if *weather != Weather::CLEAR {
            fields.field("weather", weather);
        }
        fields.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fog_of_a_meteorological_optical_range_has_the_contrast_of_five_per_cent_there() {
        let fog = AirState::fog_of_range(100.0);
        assert!((libm::exp(-fog * 100.0) - 0.05).abs() < 1e-15);
        // Kruse's visibility has 2 per cent, and 31 % more extinction for the same number.
        assert!((3.912 / (100.0 * fog) - 1.305858).abs() < 1e-6);
    }

    #[test]
    fn weather_over_time_is_linear_between_its_rows() {
        let wet = AirState { rain: 10.0, ..AirState::default() };
        let foggy = AirState { fog: 0.02, rain: 2.0, ..AirState::default() };
        let weather = Weather { over_time: Some([(5.0, wet), (7.0, foggy)].into()), ..Weather::CLEAR };
        assert_eq!((weather.at(0.0), weather.at(5.0), weather.at(9.0)), (wet, wet, foggy));
        assert_eq!(weather.at(6.0), AirState { fog: 0.01, rain: 6.0, ..AirState::default() });
        assert_eq!(
            (weather.haze_visibility(23.0), Weather::CLEAR.haze_visibility(23.0)),
            (f64::INFINITY, 23.0)
        );
        assert!(!weather.is_clear() && Weather::CLEAR.is_clear());
    }

    #[test]
    fn clear_air_leaves_no_trace_in_checksums() {
        let clear = crate::testkit::scanner_settings(1000);
        assert!(!format!("{clear:?}").contains("weather"));
        let air = AirState { dust: 0.1, ..AirState::default() };
        let dusty = ScannerSettings { weather: Weather { air, ..Weather::CLEAR }, ..clear };
        assert!(format!("{dusty:?}").contains("dust: 0.1"));
    }
}
