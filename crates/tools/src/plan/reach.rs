//! How far a device measures ground.

use vlscan_survey::Device;

/// Reflectance that ground is taken to have, 0 to 1.
pub(super) const GROUND_REFLECTANCE: f64 = 0.5;

/// The ground that a device measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    near: f64,
    far: f64,
    /// Square of the range, m², at which ground that faces the beam is as bright as the device just detects.
    weakest: f64,
}

/// Whether a device measures a place on the ground.
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
    /// A device that measures ground at any distance.
    pub(super) const UNLIMITED: Reach = Reach { near: 0.0, far: f64::INFINITY, weakest: f64::INFINITY };

    /// The reach of a device at a pulse rate, Hz; `first` is the instrument's first one, to which figures without one refer. The
    /// energy of a pulse falls with the pulse rate.
    pub fn of(device: &Device, pulse_rate: f64, first: f64) -> Reach {
        let weakest = device.receiver.max_range.map_or(f64::INFINITY, |target| {
            let energy = target.pulse_freq.unwrap_or(first) / pulse_rate;
            target.range * target.range * energy * GROUND_REFLECTANCE / target.reflectance
        });
        Reach { near: device.detector.range_min, far: device.detector.range_max, weakest }
    }

    /// What becomes of a beam that meets ground at that range, m, and that cosine of the angle of incidence.
    pub fn of_ground(&self, range: f64, cosine: f64) -> Seen {
        match () {
            () if range < self.near => Seen::TooNear,
            () if range > self.far => Seen::TooFar,
            // The lidar equation of an extended Lambertian surface.
            () if range * range > self.weakest * cosine => Seen::TooWeak,
            () => Seen::Measured,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_survey::catalogue;

    #[test]
    fn faint_ground_is_nearer_than_the_reference_target() {
        let (known, _) = catalogue().unwrap();
        let (_, scanner) = known.scanners.iter().find(|(name, _)| name.ends_with("#riegl_vux-1uav")).unwrap();
        // 920 m at 60 % and 50 kHz.
        let reach = Reach::of(&scanner.devices[0], 50e3, 50e3);
        let limit = 920.0 * (0.5f64 / 0.6).sqrt();
        assert_eq!(reach.of_ground(limit * 0.999, 1.0), Seen::Measured);
        assert_eq!(reach.of_ground(limit * 1.001, 1.0), Seen::TooWeak);
        assert_eq!(reach.of_ground(limit * 0.8, 0.5), Seen::TooWeak);
        assert_eq!(Reach::of(&scanner.devices[0], 200e3, 50e3).of_ground(limit * 0.51, 1.0), Seen::TooWeak);
        assert_eq!(reach.of_ground(2.9, 1.0), Seen::TooNear);
    }
}
