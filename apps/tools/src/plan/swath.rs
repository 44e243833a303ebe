//! Swath of an instrument in a straight flight over flat ground.
//!
//! The strip is sampled from the instrument's own optics (`beams`): its width W across the flight, the pulses
//! N per second that reach the ground within the instrument's ranges, and how they are spread. With the speed
//! v, f scan lines per second and the distance S between flight lines:
//!
//! ```text
//! overlap            o = 1 − S / W
//! density            D = N / (v·S)                   mean over all strips
//! along the flight   v / f                           spacing of scan lines
//! across             W·f / N                         mean spacing on a scan line
//! footprint          sqrt(d² + (h·γ)²)               beam diameter d at the instrument, divergence γ
//! ```

use super::beams::Beams;
use super::error::PlanError;
use super::reach::Reach;
use std::f64::consts::{PI, TAU};
use vlscan_geom::{degrees, radians};
use vlscan_survey::{Deflector, Device, Scanner, ScannerSettings, footprint};

/// The largest half opening angle of a flight, degrees.
const MAX_HALF_ANGLE: f64 = 75.0;
/// Half opening angle if none is requested and the instrument reaches it, degrees.
const DEFAULT_HALF_ANGLE: f64 = 30.0;
/// Turns per second of a spinning head if none are requested.
const DEFAULT_TURNS: f64 = 10.0;
/// Minimum number of turns per second of a head that spins continuously.
const MIN_SPIN: f64 = 5.0;
/// Scan lines that are sampled, at least.
const SAMPLED_LINES: f64 = 12.0;
/// Time that is sampled of patterns without lines, s.
const SAMPLED_S: f64 = 1.0;
/// Part of a turn by which the lines of a spinning head with a mirror of its own differ from turn to turn.
const LINE_SHIFT: f64 = 0.382;

/// A scanner as a plan uses it.
#[derive(Clone, Debug)]
pub struct SwathModel {
    scanner: Scanner,
    /// Reference of the scanner in pipeline files.
    pub reference: String,
    /// The pulse rate that is wanted instead of the scanner's first, Hz.
    pub wanted_rate: Option<u32>,
}

/// The scan of a survey, as its settings state it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scan {
    /// Half opening angle, rad; `None` if the instrument's field cannot be narrowed.
    pub half_angle: Option<f64>,
    /// Pulses per second as the instrument counts them, Hz.
    pub pulse_rate: u32,
    /// Scan frequency as surveys state it, Hz.
    pub scan_freq: f64,
    /// Scan lines per second; 0 for patterns without lines.
    pub line_rate: f64,
    /// Speed of the head, rad/s.
    pub head_rate: f64,
}

impl SwathModel {
    /// The instrument `scanner` at a pulse rate, Hz, or its first one; `reference` is how pipeline files
    /// refer to it.
    pub fn new(reference: String, scanner: &Scanner, wanted_rate: Option<u32>) -> SwathModel {
        SwathModel { scanner: scanner.clone(), reference, wanted_rate }
    }

    pub(crate) fn name(&self) -> &str {
        &self.scanner.name
    }

    /// The scanner.
    pub fn scanner(&self) -> &Scanner {
        &self.scanner
    }

    /// The first device. A scanner has at least one; lines, angles and ranges of all are alike.
    fn device(&self) -> &Device {
        &self.scanner.devices[0]
    }

    pub(crate) fn devices(&self) -> f64 {
        self.scanner.devices.len() as f64
    }

    /// The wanted pulse rate or the scanner's first, Hz.
    ///
    /// # Errors
    /// An instrument without one.
    pub fn pulse_rate(&self) -> Result<u32, PlanError> {
        let rate = self.wanted_rate.or(self.scanner.pulse_freqs.first().copied()).filter(|rate| *rate > 0);
        rate.ok_or(PlanError::NoPulseRate)
    }

    /// Supported pulse rates, Hz.
    pub fn pulse_rates(&self) -> &[u32] {
        &self.scanner.pulse_freqs
    }

    /// Nearest and farthest range that all devices measure, m.
    pub fn ranges(&self) -> [f64; 2] {
        let detectors = self.scanner.devices.iter().map(|device| &device.detector);
        detectors.fold([0.0, f64::INFINITY], |[near, far], d| [near.max(d.range_min), far.min(d.range_max)])
    }

    /// The ground that each device measures at a pulse rate, Hz.
    pub fn reaches(&self, pulse_rate: u32) -> Vec<Reach> {
        let first = self.scanner.pulse_freqs.first().copied().unwrap_or(pulse_rate);
        let reach = |device: &Device| Reach::of(device, f64::from(pulse_rate), f64::from(first));
        self.scanner.devices.iter().map(reach).collect()
    }

    /// Diameter of the beam at that range, m; of elliptic beams the larger one and the smaller one.
    pub fn footprint(&self, range: f64) -> String {
        let beam = &self.device().beam;
        let diameter = |divergence: f64| footprint(beam.aperture, divergence, range);
        match beam.divergence_y {
            None => format!("{:.4} m", diameter(beam.divergence)),
            Some(other) => format!("{:.4} × {:.4} m", diameter(beam.divergence), diameter(other)),
        }
    }

    /// Maximum speed of the head, rad/s.
    pub fn head_rate(&self) -> f64 {
        self.device().head.max_rate
    }

    /// Limits of the scan frequency as the data sheet states them, Hz; the upper one is infinite if there is
    /// none.
    pub fn scan_frequencies(&self) -> (f64, f64) {
        let (least, most) = self.device().scan_freq;
        (least, if most > 0.0 { most } else { f64::INFINITY })
    }

    /// The mechanical half angle over which pulses are counted, rad.
    pub fn mechanical_angle(&self) -> f64 {
        self.device().scan_angle_max
    }

    /// True if it has a polygon mirror, for which settings can state resolutions.
    pub fn has_polygon(&self) -> bool {
        matches!(self.device().deflector, Deflector::Polygon { .. })
    }

    /// True if the head spins all the time, as that of multi-channel scanners does.
    pub fn spins(&self) -> bool {
        let most = self.head_rate();
        let has_mirror = self.has_mirror();
        most >= TAU * MIN_SPIN * (1.0 - 1e-9) || most > 0.0 && !has_mirror && self.devices() > 1.0
    }

    /// True if a mirror of its own turns beside a head; spinning scanners often have none.
    pub fn has_mirror(&self) -> bool {
        self.sweeps() && (self.device().scan_freq.1 > 0.0 || self.devices() == 1.0)
    }

    /// True if the instrument sweeps lines, whose spacing along the flight depends on a scan frequency.
    fn sweeps(&self) -> bool {
        !matches!(
            self.device().deflector,
            Deflector::Risley { .. } | Deflector::Fibres { .. } | Deflector::Pattern(_)
        )
    }

    /// True if settings can narrow the field.
    fn can_narrow(&self) -> bool {
        let is_fixed = matches!(self.device().deflector, Deflector::Risley { .. } | Deflector::Pattern(_));
        !self.spins() && !is_fixed
    }

    fn usable_angle(&self) -> f64 {
        match self.device().deflector {
            Deflector::Polygon { effective_max, .. } => effective_max.min(self.device().scan_angle_max),
            _ => self.device().scan_angle_max,
        }
    }

    /// The half opening angle, rad, of a request in degrees; `None` if the instrument's field cannot be
    /// narrowed.
    ///
    /// # Errors
    /// A request beyond the limits.
    pub fn half_angle(&self, wanted_deg: Option<f64>) -> Result<Option<f64>, PlanError> {
        if !self.can_narrow() {
            return self.whole_field(wanted_deg);
        }
        let limit = degrees(self.usable_angle()).min(MAX_HALF_ANGLE);
        // Some instruments name no limit.
        let most = if limit > 0.0 { limit } else { MAX_HALF_ANGLE };
        let angle = wanted_deg.unwrap_or_else(|| most.min(DEFAULT_HALF_ANGLE));
        if !(angle > 0.0 && angle <= most + 1e-9) {
            return Err(PlanError::HalfAngle { angle, max: most });
        }
        Ok(Some(radians(angle)))
    }

    /// The half opening angle, rad, of a request in degrees for a vehicle, which looks upwards as well.
    ///
    /// # Errors
    /// A request beyond the limits.
    pub fn mobile_half_angle(&self, wanted_deg: Option<f64>) -> Result<Option<f64>, PlanError> {
        if !self.can_narrow() {
            return self.whole_field(wanted_deg);
        }
        let most = if self.device().scan_angle_max > 0.0 { self.usable_angle() } else { PI };
        let angle = wanted_deg.map_or(most, radians);
        if !(angle > 0.0 && angle <= most + 1e-9) {
            return Err(PlanError::HalfAngle { angle: degrees(angle), max: degrees(most) });
        }
        Ok(Some(angle))
    }

    fn whole_field(&self, wanted_deg: Option<f64>) -> Result<Option<f64>, PlanError> {
        match wanted_deg {
            None => Ok(None),
            Some(angle) => Err(PlanError::FixedField { angle, instrument: self.name().to_owned() }),
        }
    }

    /// The scan with the requested scan frequency (of spinning scanners turns per second), or within the
    /// instrument's limits the one that draws about `lines` lines per second.
    ///
    /// # Errors
    /// A request beyond the limits.
    pub fn scan(
        &self,
        half_angle: Option<f64>,
        pulse_rate: u32,
        scan_freq: Option<f64>,
        lines: f64,
    ) -> Result<Scan, PlanError> {
        let still = Scan { half_angle, pulse_rate, scan_freq: 0.0, line_rate: 0.0, head_rate: 0.0 };
        if self.spins() {
            return self.spinning(still, scan_freq);
        }
        if !self.sweeps() {
            return match scan_freq {
                None => Ok(still),
                Some(frequency) => {
                    Err(PlanError::NoScanLines { frequency, instrument: self.name().to_owned() })
                }
            };
        }
        let (least, most) = self.scan_freq_limits(half_angle)?;
        let per_scan = match self.device().deflector {
            Deflector::Oscillating { .. } | Deflector::Conic | Deflector::EllipticConic { .. } => 2.0,
            _ => 1.0,
        };
        let scan_freq = match scan_freq {
            Some(freq) if freq < least || freq > most || freq <= 0.0 => {
                return Err(PlanError::ScanFrequency { frequency: freq, limits: [least, most] });
            }
            Some(freq) => freq,
            // A tenth of a hertz is exact enough.
            None => ((lines / per_scan * 10.0).round() / 10.0).max(0.1).max(least).min(most),
        };
        Ok(Scan { scan_freq, line_rate: scan_freq * per_scan, ..still })
    }

    fn spinning(&self, still: Scan, turns: Option<f64>) -> Result<Scan, PlanError> {
        let most = self.head_rate() / TAU;
        let turns = turns.unwrap_or_else(|| DEFAULT_TURNS.min(most));
        if !(turns > 0.0 && turns <= most * (1.0 + 1e-9)) {
            return Err(PlanError::Turns { turns, max: most });
        }
        let scan_freq = if self.has_mirror() { self.lines_beside_head(turns, still.pulse_rate) } else { 0.0 };
        Ok(Scan { scan_freq, line_rate: turns, head_rate: TAU * turns, ..still })
    }

    /// Scan frequency of a mirror beside a head that turns, Hz: within the mirror's limits as many lines in a
    /// turn as make a square grid, but where possible no whole number of them, which would draw the same
    /// lines in each turn.
    fn lines_beside_head(&self, turns: f64, pulse_rate: u32) -> f64 {
        let (least, most) = self.scan_frequencies();
        let height = 2.0 * self.usable_angle();
        if height <= 0.0 {
            // The head alone moves the beam.
            return least;
        }
        let nearest = ((f64::from(pulse_rate) / turns * TAU / height).sqrt() * turns).max(least).min(most);
        let whole = (nearest / turns).floor();
        let mut shifted = [whole, whole + 1.0].into_iter().map(|lines| (lines - LINE_SHIFT) * turns);
        shifted.find(|freq| *freq > 0.0 && (least..=most).contains(freq)).unwrap_or(nearest)
    }

    /// Limits of the scan frequency, Hz. An oscillating mirror is slower the farther it swings.
    ///
    /// # Errors
    /// No frequency is within the limits at that angle.
    fn scan_freq_limits(&self, half_angle: Option<f64>) -> Result<(f64, f64), PlanError> {
        let (least, most) = self.scan_frequencies();
        match (&self.device().deflector, half_angle) {
            (Deflector::Oscillating { scan_product }, Some(angle)) if *scan_product > 0.0 => {
                let angle = degrees(angle);
                let most = most.min(scan_product / angle);
                match least <= most {
                    true => Ok((least, most)),
                    false => Err(PlanError::Swing {
                        angle,
                        instrument: self.name().to_owned(),
                        max: most,
                        min: least,
                        possible: scan_product / least,
                    }),
                }
            }
            _ => Ok((least, most)),
        }
    }

    /// "highest" or "lowest" if a scan has that scan frequency of its field of view.
    pub(crate) fn limit_of(&self, scan: &Scan) -> Option<&'static str> {
        let (least, most) = self.scan_freq_limits(scan.half_angle).ok()?;
        match scan.scan_freq {
            frequency if frequency >= most => Some("highest"),
            frequency if frequency <= least => Some("lowest"),
            _ => None,
        }
    }

    /// A sample of the beams of a scan.
    ///
    /// # Errors
    /// As [`Beams::of`].
    pub(super) fn beams(&self, scan: &Scan) -> Result<Beams, PlanError> {
        let settings = ScannerSettings {
            active: true,
            pulse_freq: scan.pulse_rate,
            scan_freq: scan.scan_freq,
            scan_angle: scan.half_angle.unwrap_or(0.0),
            head_rate: scan.head_rate,
            head_stop: if scan.head_rate > 0.0 { TAU } else { 0.0 },
            ..self.scanner.own_settings()
        };
        let facets = match &self.device().deflector {
            Deflector::Polygon { facet_tilts, .. } => facet_tilts.len().max(1) as f64,
            _ => 1.0,
        };
        let seconds = match scan.line_rate > 0.0 {
            // Whole turns of the head, and of the mirror.
            true if self.spins() => SAMPLED_LINES / 4.0 / scan.line_rate,
            true => facets * (SAMPLED_LINES / facets).ceil() / scan.line_rate,
            false => SAMPLED_S,
        };
        let devices = self.scanner.devices.iter().cloned().zip(self.reaches(scan.pulse_rate));
        let devices: Vec<(Device, Reach)> = devices.collect();
        Beams::of(&devices, &settings, (seconds * f64::from(scan.pulse_rate)).round())
    }
}

impl Scan {
    /// Keys of `[settings]` with their values.
    pub fn settings(&self) -> Vec<(&'static str, f64)> {
        let mut keys = vec![("pulse_freq_hz", f64::from(self.pulse_rate))];
        if self.scan_freq > 0.0 {
            keys.push(("scan_freq_hz", self.scan_freq));
        }
        if self.head_rate > 0.0 {
            keys.push(("head_rate_deg_per_s", degrees(self.head_rate)));
        }
        if let Some(angle) = self.half_angle {
            keys.push(("scan_angle_deg", degrees(angle)));
        }
        keys
    }
}

#[cfg(test)]
mod tests {
    use super::Deflector;
    use crate::plan::beams::QuarterTurns;
    use crate::plan::testing::{instrument, spinning};
    use vlscan_survey::Mount;

    /// The mount of aircraft: straight down, and lines across the flight.
    fn down() -> Mount {
        Mount { rotation: QuarterTurns([-90.0, 0.0, 90.0]).rotation(), ..Mount::IDENTITY }
    }

    /// Width of the strip 100 m below, per height, and pulses per second that reach the ground.
    fn strip(id: &str, wanted_deg: Option<f64>) -> (f64, f64) {
        let instrument = instrument(id);
        let half_angle = instrument.half_angle(wanted_deg).unwrap();
        let rate = instrument.pulse_rate().unwrap();
        let scan = instrument.scan(half_angle, rate, None, 100.0).unwrap();
        let field = instrument.beams(&scan).unwrap().over_ground(&down(), 100.0);
        let fired = instrument.beams(&scan).unwrap().fired;
        (field.width() / 100.0, f64::from(rate) * fired * instrument.devices() * field.measured)
    }

    #[test]
    fn strips_are_those_of_the_optics() {
        let width = |degrees: f64| 2.0 * degrees.to_radians().tan();
        let (found, pulses) = strip("riegl_lms-q780", Some(25.0));
        assert!((found / width(25.0) - 1.0).abs() < 5e-3, "{found}");
        assert!((pulses / (100_000.0 * 25.0 / 45.0) - 1.0).abs() < 5e-3, "{pulses}");
        // Two channels turned by 14 degrees about the look: the strip is narrower by the cosine, the pulses
        // are of both.
        let (found, pulses) = strip("riegl_vq-1560ii", Some(29.0));
        assert!((found / (width(29.0) * 14f64.to_radians().cos()) - 1.0).abs() < 5e-3, "{found}");
        assert!((pulses / (2.0 * 270_000.0 * 29.0 / 45.0) - 1.0).abs() < 5e-3, "{pulses}");
        // Wedges: 35.2 degrees to either side.
        let (found, _) = strip("scanners_tls.xml#livox_mid-70", None);
        assert!((found / width(35.2) - 1.0).abs() < 0.02, "{}", (found / 2.0).atan().to_degrees());
    }

    #[test]
    fn lines_are_as_many_as_asked_for_within_the_limits() {
        let scanner = instrument("riegl_lms-q780");
        let angle = scanner.half_angle(None).unwrap();
        let rate = |lines: f64| scanner.scan(angle, 200_000, None, lines).unwrap().line_rate;
        assert_eq!([rate(80.03), rate(1e6), rate(0.1)], [80.0, 200.0, 10.0]);
        // A cone crosses the flight line twice in a turn.
        let cone = instrument("riegl_vq-840-g");
        let scan = cone.scan(cone.half_angle(None).unwrap(), 50_000, None, 50.0).unwrap();
        assert_eq!((scan.scan_freq, scan.line_rate), (25.0, 50.0));
    }

    #[test]
    fn mirrors_beside_a_head_draw_lines_whatever_limits_are_stated() {
        // A square grid has 303 lines in a turn: 10,200 pulses over 360° by 40°.
        for (attributes, expected) in [
            ("", 3016.18),
            ("scanFreqMin_Hz='100'", 3016.18),
            ("scanFreqMin_Hz='5000'", 5006.18),
            ("scanFreqMax_Hz='1000'", 996.18),
            ("scanFreqMin_Hz='7' scanFreqMax_Hz='8'", 8.0),
        ] {
            let scanner = spinning(attributes);
            let scan = scanner.scan(None, 102_000, None, 1.0).unwrap();
            assert!((scan.scan_freq - expected).abs() < 1e-9, "{attributes}: {}", scan.scan_freq);
            let (least, most) = scanner.scan_frequencies();
            assert!((least..=most).contains(&scan.scan_freq));
        }
    }

    #[test]
    fn mirrors_that_cannot_swing_as_far_and_as_often_as_asked_for_are_refused() {
        let mut scanner = instrument("leica_als50");
        for device in &mut scanner.scanner.devices {
            device.deflector = Deflector::Oscillating { scan_product: 300.0 };
        }
        let refused = scanner.scan(Some(0.5), 83_000, None, 40.0).unwrap_err().to_string();
        assert!(
            refused.contains("at most 10.472 times a second") && refused.contains("12 degrees"),
            "{refused}"
        );
        let narrow = scanner.scan(Some(10f64.to_radians()), 83_000, None, 1e6).unwrap();
        assert!((narrow.scan_freq - 30.0).abs() < 1e-9, "{}", narrow.scan_freq);
        let of = |lines: f64| scanner.scan(narrow.half_angle, 83_000, None, lines).unwrap();
        let limits = [narrow, of(1.0), of(54.0)].map(|scan| scanner.limit_of(&scan));
        assert_eq!(limits, [Some("highest"), Some("lowest"), None]);
    }

    #[test]
    fn limits_are_those_of_the_instrument() {
        let scanner = instrument("riegl_lms-q780");
        assert!(scanner.half_angle(Some(80.0)).unwrap_err().to_string().contains("at most 30°"));
        let refused = scanner.scan(Some(0.5), 200_000, Some(1e5), 1.0).unwrap_err().to_string();
        assert!(refused.contains("scan frequency 100000 Hz, expected 10 to 200 Hz"), "{refused}");
        let head = instrument("vlp16");
        assert!(head.half_angle(Some(20.0)).unwrap_err().to_string().contains("cannot be narrowed"));
        assert!(head.scan(None, 18_750, Some(21.0), 1.0).unwrap_err().to_string().contains("at most 20"));
    }
}
