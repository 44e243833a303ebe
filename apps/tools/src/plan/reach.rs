//! How far a device measures ground.

use vlscan_geom::{DVec3, LIGHT_SPEED, Rotation};
use vlscan_survey::{Device, width_of_pulse_length};

/// Reflectance that ground is taken to have, 0 to 1.
pub(super) const GROUND_REFLECTANCE: f64 = 0.5;

/// The ground that a device measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    near: f64,
    far: f64,
    /// Square of the range, m², at which ground that faces the beam is as bright as the device just detects.
    weakest: f64,
    /// Standard deviations of the beam's intensity along its two axes over that of the pulse along the beam,
    /// per metre of range, 1/m.
    spread: [f64; 2],
}

/// Full width at half maximum of a normal distribution over its standard deviation.
const WIDTH_OF_NORMAL: f64 = 2.354_820_045;

/// Visibility of a place on the ground for a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Seen {
    /// It is measured.
    Measured,
    /// It is nearer than the instrument measures.
    TooNear,
    /// It is farther away than the instrument measures.
    TooFar,
    /// Its echo is too weak.
    TooWeak,
}

impl Reach {
    /// A device that measures ground up to a range, m, however weak its echo.
    pub(super) fn up_to(range: f64) -> Reach {
        Reach { near: 0.0, far: range, weakest: f64::INFINITY, spread: [0.0; 2] }
    }

    /// The reach of a device at a pulse rate, Hz; `first` is the instrument's first one, to which figures
    /// without one refer. The energy of a pulse falls with the pulse rate.
    pub fn of(device: &Device, pulse_rate: f64, first: f64) -> Reach {
        let weakest = device.receiver.max_range.map_or(f64::INFINITY, |target| {
            let energy = target.pulse_freq.unwrap_or(first) / pulse_rate;
            target.range * target.range * energy * GROUND_REFLECTANCE / target.reflectance
        });
        let beam = &device.beam;
        let pulse = beam.stated_width.unwrap_or(width_of_pulse_length(beam.pulse_length)) / WIDTH_OF_NORMAL;
        // The divergence spans four standard deviations.
        let spread = [beam.divergence, beam.divergence_y.unwrap_or(beam.divergence)]
            .map(|divergence| 0.25 * divergence / (0.5 * LIGHT_SPEED * pulse));
        Reach { near: device.detector.range_min, far: device.detector.range_max, weakest, spread }
    }

    /// Outcome of a beam of that attitude that meets level ground at that range, m.
    pub fn of_ground(&self, range: f64, attitude: &Rotation) -> Seen {
        let cosine = -attitude.forward().z;
        // Of pulse and depths within the footprint as normal distributions, whose variances add up: so much
        // lower is the maximum of the echo.
        let slopes = [DVec3::X, DVec3::Z].map(|axis| attitude.apply(axis).z / cosine);
        let depths = [0, 1].map(|i| self.spread[i] * range * slopes[i]);
        let flattened = (1.0 + depths[0] * depths[0] + depths[1] * depths[1]).sqrt();
        match () {
            () if range < self.near => Seen::TooNear,
            () if range > self.far => Seen::TooFar,
            // The lidar equation of an extended Lambertian surface.
            () if range * range * flattened > self.weakest * cosine => Seen::TooWeak,
            () => Seen::Measured,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_survey::catalogue;

    fn reach(scanner: &str, rate: f64) -> Reach {
        let (known, _) = catalogue().unwrap();
        let (_, scanner) = known.scanners.iter().find(|(name, _)| name.ends_with(scanner)).unwrap();
        Reach::of(&scanner.devices[0], rate, rate)
    }

    /// The attitude of a beam whose angle of incidence on level ground has that cosine.
    fn incident(cosine: f64) -> Rotation {
        Rotation::between(DVec3::Y, DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, -cosine))
    }

    #[test]
    fn faint_ground_is_nearer_than_the_reference_target() {
        // 920 m at 60 % and 50 kHz.
        let reached = reach("#riegl_vux-1uav", 50e3);
        let limit = 920.0 * (0.5f64 / 0.6).sqrt();
        let seen = |range: f64, cosine: f64| reached.of_ground(range, &incident(cosine));
        assert_eq!(seen(limit * 0.999, 1.0), Seen::Measured);
        assert_eq!(seen(limit * 1.001, 1.0), Seen::TooWeak);
        assert_eq!(seen(limit * 0.6, 0.5), Seen::Measured);
        assert_eq!(seen(limit * 0.8, 0.5), Seen::TooWeak);
        assert_eq!(seen(2.9, 1.0), Seen::TooNear);
        let (known, _) = catalogue().unwrap();
        let (_, scanner) = known.scanners.iter().find(|(name, _)| name.ends_with("#riegl_vux-1uav")).unwrap();
        let faster = Reach::of(&scanner.devices[0], 200e3, 50e3);
        assert_eq!(faster.of_ground(limit * 0.51, &incident(1.0)), Seen::TooWeak);
    }

    #[test]
    fn slanted_footprints_flatten_an_echo() {
        // 20 m at 10 %: 44.72 m at 50 %. At 60 degrees a footprint of 0.0104 × 28 m spans depths of a
        // standard deviation of 0.126 m, and a pulse of 5 ns has one of 0.318 m: the echo is lower by 1/√(1 +
        // 0.157).
        let reached = reach("#ouster_os0-128", 10240.0);
        let limit = 20.0 * 5f64.sqrt() * 0.5f64.sqrt();
        let seen = |range: f64| reached.of_ground(range, &incident(0.5));
        assert_eq!(seen(limit * 0.95), Seen::Measured);
        assert_eq!(seen(limit * 0.98), Seen::TooWeak);
    }
}
