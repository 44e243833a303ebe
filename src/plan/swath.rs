//! What an instrument does in a straight flight over flat ground.
//!
//! With the height h above the ground, half opening angle θ, speed v, N pulses per second that leave the instrument, f scan
//! lines per second and the distance S between flight lines:
//!
//! ```text
//! swath              W = 2·h·tan θ
//! overlap            o = 1 − S / W
//! density            D = N / (v·S)                   mean over all strips
//! along the flight   v / f                           spacing of scan lines
//! across             W·f / N                         mean spacing on a scan line
//! nadir, edge        N / (2·θ·h·v),  cos²θ of that   one strip, of mirrors that turn at constant speed
//! footprint          sqrt(d² + (h·γ)²)               beam diameter d at the instrument, divergence γ
//! ```

use crate::geom::{Rotation, degrees, radians};
use crate::survey::{Deflector, Scanner, footprint};
use std::f64::consts::{PI, TAU};

/// The largest half opening angle of a flight, degrees.
const MAX_HALF_ANGLE: f64 = 75.0;
/// Half opening angle if none is requested and the instrument reaches it, degrees.
const DEFAULT_HALF_ANGLE: f64 = 30.0;

/// Largest angle by which a scanner that looks down may look ahead or behind, rad.
const MAX_LOOK_BACK: f64 = PI / 4.0;

/// A scanner as a plan uses it. The figures are those of its first device; all devices fire at the same time.
#[derive(Clone, Debug)]
pub struct Instrument {
    deflector: Deflector,
    devices: f64,
    scan_angle_max: f64,
    scan_freq: (f64, f64),
    /// Reference of the scanner in pipeline files.
    pub reference: String,
    pub name: String,
    /// Supported pulse rates, Hz.
    pub pulse_rates: Vec<u32>,
    /// Nearest and farthest range, m.
    pub range_min: f64,
    pub range_max: f64,
    /// Full divergence, rad.
    pub divergence: f64,
    /// Beam diameter at the exit, m.
    pub aperture: f64,
    /// Maximum speed of the head, rad/s.
    pub head_rate: f64,
    /// Rotation of the emitter on the head.
    beam_rotation: Rotation,
}

/// The scan of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Swath {
    /// Half opening angle, rad.
    pub half_angle: f64,
    /// Pulses per second as the instrument counts them, Hz.
    pub pulse_rate: u32,
    /// Pulses per second that leave the instrument within the opening angle, all devices.
    pub fired_rate: f64,
    /// Scan frequency as surveys state it, Hz.
    pub scan_freq: f64,
    /// Scan lines per second; 0 for patterns without lines.
    pub line_rate: f64,
    /// Speed of the head, rad/s.
    pub head_rate: f64,
}

impl Instrument {
    pub fn new(reference: String, scanner: &Scanner) -> Instrument {
        // A scanner has at least one device.
        let device = &scanner.devices[0];
        Instrument {
            deflector: device.deflector.clone(),
            devices: scanner.devices.len() as f64,
            scan_angle_max: device.scan_angle_max,
            scan_freq: device.scan_freq,
            reference,
            name: scanner.name.clone(),
            pulse_rates: scanner.pulse_freqs.clone(),
            range_min: device.detector.range_min,
            range_max: device.detector.range_max,
            divergence: device.beam.divergence,
            aperture: device.beam.aperture,
            head_rate: device.head.max_rate,
            beam_rotation: device.beam_origin.rotation,
        }
    }

    /// Diameter of the beam at that range, m.
    pub fn footprint(&self, range: f64) -> f64 {
        footprint(self.aperture, self.divergence, range)
    }

    /// Whether the instrument sweeps a line, whose spacing along the flight depends on a scan frequency.
    fn sweeps(&self) -> bool {
        self.is_cone() || matches!(self.deflector, Deflector::Polygon { .. } | Deflector::Oscillating { .. })
    }

    fn is_cone(&self) -> bool {
        matches!(self.deflector, Deflector::Conic | Deflector::EllipticConic { .. })
    }

    /// Angle between the vertical and the middle of the scan, rad, positive if a scanner in that mount looks behind the
    /// platform; 0 if it does not look down.
    pub fn look_back(&self, mount: Rotation) -> f64 {
        // Platforms have y ahead and z up.
        let middle = mount.after(self.beam_rotation).forward();
        let angle = libm::atan2(-middle.y, -middle.z);
        if angle.abs() < MAX_LOOK_BACK { angle } else { 0.0 }
    }

    /// Whether points lie ahead of and behind the platform, so that a flight must begin before the area.
    pub fn looks_ahead(&self) -> bool {
        self.is_cone() || matches!(self.deflector, Deflector::Risley { .. })
    }

    /// The half opening angle, rad, of a request in degrees.
    ///
    /// # Errors
    /// A sentence with the limits.
    pub fn half_angle(&self, wanted_deg: Option<f64>) -> Result<f64, String> {
        let limit = degrees(self.usable_angle()).min(MAX_HALF_ANGLE);
        let angle = match wanted_deg {
            Some(angle) => angle,
            None if limit > 0.0 => limit.min(DEFAULT_HALF_ANGLE),
            None => DEFAULT_HALF_ANGLE,
        };
        // Some instruments name no limit.
        let most = if limit > 0.0 { limit } else { MAX_HALF_ANGLE };
        if !(angle > 0.0 && angle <= most + 1e-9) {
            return Err(format!("half opening angle {angle}°, expected above 0 and at most {most:.3}°"));
        }
        Ok(radians(angle))
    }

    /// The fraction of the instrument's pulses that leave it within the half opening angle. A polygon mirror counts
    /// pulses over its whole mechanical angle (spec kinematics §4.2).
    pub fn fired_fraction(&self, half_angle: f64) -> f64 {
        match self.deflector {
            Deflector::Polygon { effective_max, .. } if self.scan_angle_max > 0.0 => {
                (half_angle.min(effective_max) / self.scan_angle_max).min(1.0)
            }
            _ => 1.0,
        }
    }

    /// The half opening angle, rad, of a request in degrees for a vehicle, which looks upwards as well.
    ///
    /// # Errors
    /// A sentence with the limits.
    pub fn mobile_half_angle(&self, wanted_deg: Option<f64>) -> Result<f64, String> {
        let most = if self.scan_angle_max > 0.0 { self.usable_angle() } else { PI };
        let angle = wanted_deg.map_or(most, radians);
        if !(angle > 0.0 && angle <= most + 1e-9) {
            return Err(format!(
                "half opening angle {:.3}°, expected above 0 and at most {:.3}°",
                degrees(angle),
                degrees(most)
            ));
        }
        Ok(angle)
    }

    /// The mechanical half angle over which pulses are counted, rad.
    pub fn mechanical_angle(&self) -> f64 {
        self.scan_angle_max
    }

    fn usable_angle(&self) -> f64 {
        match self.deflector {
            Deflector::Polygon { effective_max, .. } => effective_max.min(self.scan_angle_max),
            _ => self.scan_angle_max,
        }
    }

    /// The fraction of the pulses that leave the instrument at its full opening angle.
    pub fn usable_fraction(&self) -> f64 {
        self.fired_fraction(self.usable_angle())
    }

    /// Whether lines come from the turning head, as with spinning multi-channel scanners.
    pub fn spins(&self) -> bool {
        self.head_rate > 0.0 && self.scan_freq.1 == 0.0 && self.devices > 1.0
    }

    /// Fraction of the fired pulses per metre across, at the distance `x` from the flight line: those of a cone lie on its
    /// ring, all others are evenly distributed in angle.
    pub fn profile(&self, x: f64, height: f64, half_angle: f64) -> f64 {
        let edge = height * half_angle.tan();
        match self.deflector {
            _ if x.abs() >= edge => 0.0,
            Deflector::Conic | Deflector::EllipticConic { .. } => 1.0 / (PI * (edge * edge - x * x).sqrt()),
            _ => height / (height * height + x * x) / (2.0 * half_angle),
        }
    }

    /// Limits of the scan frequency as the data sheet states them, Hz; no upper one if 0.
    pub fn scan_frequencies(&self) -> (f64, f64) {
        self.scan_freq
    }

    /// Channels that draw a line each while the head turns; 1 for all others.
    pub fn channels_in_turn(&self) -> f64 {
        if self.spins() { self.devices } else { 1.0 }
    }

    /// The scan of a platform that moves at `speed` (m/s) and whose scan lines are `width` (m) long: the scan frequency (of
    /// spinning scanners the turns per second) is the requested one or, within the instrument's limits, that for which
    /// points are as far apart along the way as on a line.
    ///
    /// # Errors
    /// A sentence with the limits.
    pub fn swath(
        &self,
        half_angle: f64,
        pulse_rate: u32,
        scan_freq: Option<f64>,
        [speed, width]: [f64; 2],
    ) -> Result<Swath, String> {
        let fired_rate = f64::from(pulse_rate) * self.fired_fraction(half_angle) * self.devices;
        let swath = |scan_freq: f64, line_rate: f64, head_rate: f64| Swath {
            half_angle,
            pulse_rate,
            fired_rate,
            scan_freq,
            line_rate,
            head_rate,
        };
        if self.spins() {
            let turns = scan_freq.unwrap_or(10.0);
            return match turns > 0.0 && TAU * turns <= self.head_rate {
                true => Ok(swath(0.0, turns, TAU * turns)),
                false => Err(format!(
                    "{turns} turns per second, expected above 0, at most {:.3}",
                    self.head_rate / TAU
                )),
            };
        }
        if !self.sweeps() {
            return Ok(swath(0.0, 0.0, 0.0));
        }
        let (least, most) = self.scan_freq_limits(half_angle);
        let per_scan = match self.deflector {
            Deflector::Oscillating { .. } | Deflector::Conic | Deflector::EllipticConic { .. } => 2.0,
            _ => 1.0,
        };
        let scan_freq = match scan_freq {
            Some(freq) if freq < least || freq > most || freq <= 0.0 => {
                return Err(format!("scan frequency {freq} Hz, expected {least} to {most:.4} Hz"));
            }
            Some(freq) => freq,
            None => {
                // v / f = W·f / N with f lines per second; a tenth of a hertz is exact enough.
                let wanted = (speed * fired_rate / width).sqrt() / per_scan;
                ((wanted * 10.0).round() / 10.0).max(0.1).clamp(least, most.max(least))
            }
        };
        Ok(swath(scan_freq, scan_freq * per_scan, 0.0))
    }

    /// Limits of the scan frequency, Hz. An oscillating mirror is slower the farther it swings.
    fn scan_freq_limits(&self, half_angle: f64) -> (f64, f64) {
        let (least, most) = self.scan_freq;
        let most = if most > 0.0 { most } else { f64::INFINITY };
        match self.deflector {
            Deflector::Oscillating { scan_product } if scan_product > 0.0 => {
                (least, most.min(scan_product / degrees(half_angle)))
            }
            _ => (least, most),
        }
    }
}

impl Swath {
    /// Width on flat ground, m.
    pub fn width(&self, height: f64) -> f64 {
        2.0 * height * self.half_angle.tan()
    }

    /// Mean number of pulses per m² of lines `spacing` (m) apart, flown at `speed` (m/s).
    pub fn density(&self, speed: f64, spacing: f64) -> f64 {
        self.fired_rate / (speed * spacing)
    }

    /// Pulses per m² of one strip below the platform and at its edge.
    pub fn density_in_strip(&self, speed: f64, height: f64) -> [f64; 2] {
        let nadir = self.fired_rate / (2.0 * self.half_angle * height * speed);
        [nadir, nadir * self.half_angle.cos().powi(2)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::survey::catalogue;

    fn instrument(id: &str) -> Instrument {
        let (known, _) = catalogue().unwrap();
        let (reference, scanner) =
            known.scanners.iter().find(|(reference, _)| reference.ends_with(&format!("#{id}"))).unwrap();
        Instrument::new(reference.clone(), scanner)
    }

    #[test]
    fn a_strip_has_its_mean_density() {
        // The density across a strip of a mirror at constant speed is ∝ cos²; its mean over the width is N / (v·W).
        let scanner = instrument("riegl_lms-q780");
        let angle = scanner.half_angle(Some(25.0)).unwrap();
        let (speed, height) = (60.0, 500.0);
        let swath = scanner.swath(angle, 200_000, None, [speed, 2.0 * height * angle.tan()]).unwrap();
        let width = swath.width(height);
        let [nadir, edge] = swath.density_in_strip(speed, height);
        let steps = 10_000;
        let mean = (0..steps)
            .map(|i| {
                let x = width * ((f64::from(i) + 0.5) / f64::from(steps) - 0.5);
                nadir / (1.0 + (x / height).powi(2))
            })
            .sum::<f64>()
            / f64::from(steps);
        assert!((mean / swath.density(speed, width) - 1.0).abs() < 1e-6);
        assert!((edge / nadir - angle.cos().powi(2)).abs() < 1e-12);
    }

    #[test]
    fn points_are_as_far_apart_along_as_across() {
        let scanner = instrument("riegl_lms-q780");
        let angle = scanner.half_angle(None).unwrap();
        let swath = scanner.swath(angle, 200_000, None, [60.0, 1000.0 * angle.tan()]).unwrap();
        let along = 60.0 / swath.line_rate;
        let across = swath.width(500.0) * swath.line_rate / swath.fired_rate;
        assert!((along / across - 1.0).abs() < 0.01, "{along} {across}");
    }

    #[test]
    fn limits_are_those_of_the_instrument() {
        let scanner = instrument("riegl_lms-q780");
        assert!(scanner.half_angle(Some(80.0)).unwrap_err().contains("30"));
        assert!(
            scanner.swath(0.5, 200_000, Some(1e5), [60.0, 500.0]).unwrap_err().contains("scan frequency")
        );
    }
}
