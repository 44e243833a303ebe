//! Instruments and platforms by the figures of their data sheets: what users compare, where each figure comes
//! from, and where an instrument's beams point.
//!
//! | file | what it does |
//! |---|---|
//! | `field` | the field of view |
//! | `sources` | where figures come from |
//! | `pattern` | the scan pattern as a drawing |

mod field;
mod pattern;
mod sources;

pub use field::{field_figures, field_in_words, field_of_view};
pub use pattern::Pattern;
pub use sources::{Sources, unverified_figures};

use serde::Serialize;
use vlscan_base::error::Result;
use vlscan_geom::degrees;
use vlscan_survey::{Deflector, Platform, PlatformKind, Scanner, width_of_pulse_length};

/// Properties of a scanner by which users compare scanners; the figures are those of its first device.
#[derive(Clone, Debug, Serialize)]
pub struct ScannerFigures {
    /// Reference to the scanner in surveys and pipelines.
    pub reference: String,
    /// Name of the instrument.
    pub name: String,
    /// Kind of the mechanism that deflects the beam.
    pub optics: &'static str,
    /// Number of devices.
    pub channels: usize,
    /// Along the emitter's x axis.
    pub divergence_mrad: f64,
    /// Along the emitter's z axis, of elliptic beams.
    pub divergence_y_mrad: Option<f64>,
    /// Pulse rates, Hz.
    pub pulse_rates_hz: Vec<u32>,
    /// Least range, m.
    pub range_min_m: f64,
    /// `None` is unlimited.
    pub range_max_m: Option<f64>,
    /// Full angle of the field, or of its two extents: all around, and up and down, of a head that turns;
    /// each at most 360.
    pub field_of_view_deg: Vec<f64>,
    /// Maximum rotation rate of the head; 0 without a head.
    pub head_deg_per_s: f64,
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// In the measure of HELIOS++, which surveys in XML keep without corrections.
    pub pulse_length_ns: f64,
    /// Full width at half maximum.
    pub pulse_fwhm_ns: f64,
    /// Standard deviation of ranges, m.
    pub accuracy_m: f64,
    /// 0 is unlimited.
    pub max_returns: u32,
}

/// Properties of a platform by which users compare platforms.
#[derive(Clone, Debug, Serialize)]
pub struct PlatformFigures {
    /// Reference to the platform in surveys and pipelines.
    pub reference: String,
    /// Kind of the motion.
    pub kind: &'static str,
    /// Offset of the scanner's mount in the platform's frame, m.
    pub mount_offset_m: [f64; 3],
}

impl ScannerFigures {
    /// The figures of a scanner, which surveys call `reference`.
    ///
    /// # Errors
    /// Formulas of mechanical errors without a value.
    pub fn of(reference: &str, scanner: &Scanner) -> Result<ScannerFigures> {
        // A scanner has at least one device.
        let device = &scanner.devices[0];
        let optics = match device.deflector {
            Deflector::Polygon { .. } => "rotating",
            Deflector::Oscillating { .. } => "oscillating",
            Deflector::Conic => "conic",
            Deflector::EllipticConic { .. } => "elliptic",
            Deflector::Fibres { .. } => "line",
            Deflector::Risley { .. } => "risley",
            Deflector::Custom(_) => "custom",
            Deflector::Pattern(_) => "pattern",
        };
        let beam = &device.beam;
        Ok(ScannerFigures {
            reference: reference.to_owned(),
            name: scanner.name.clone(),
            optics,
            channels: scanner.devices.len(),
            divergence_mrad: rounded(beam.divergence * 1e3),
            divergence_y_mrad: beam.divergence_y.map(|angle| rounded(angle * 1e3)),
            pulse_rates_hz: scanner.pulse_freqs.clone(),
            range_min_m: device.detector.range_min,
            range_max_m: Some(device.detector.range_max).filter(|&m| m.is_finite() && m < 1e6),
            field_of_view_deg: field_of_view(scanner)?,
            head_deg_per_s: rounded(degrees(device.head.max_rate)),
            wavelength_nm: rounded(beam.wavelength),
            pulse_length_ns: beam.pulse_length,
            pulse_fwhm_ns: rounded(width_of_pulse_length(beam.length(true))),
            accuracy_m: device.detector.accuracy,
            max_returns: device.detector.max_returns,
        })
    }
}

impl PlatformFigures {
    /// The figures of a platform, which surveys call `reference`.
    pub fn of(reference: &str, platform: &Platform) -> PlatformFigures {
        let kind = match platform.kind {
            PlatformKind::Static => "static",
            PlatformKind::LinearPath => "linear path",
            PlatformKind::GroundVehicle { .. } => "ground vehicle",
            PlatformKind::Multicopter(_) => "multicopter",
            PlatformKind::Interpolated(_) => "trajectory",
            PlatformKind::Stream(_) => "stream",
        };
        PlatformFigures {
            reference: reference.to_owned(),
            kind,
            mount_offset_m: platform.mount.offset.to_array(),
        }
    }
}

/// Rounds away the digits that come from the conversion of units.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_survey::catalogue;

    #[test]
    fn figures_of_a_scanner() {
        let (known, _) = catalogue().unwrap();
        let (reference, found) = known.scanners.iter().find(|s| s.0.ends_with("#riegl_vz400")).unwrap();
        let row = ScannerFigures::of(reference, found).unwrap();
        assert_eq!(
            (row.optics, row.channels, &row.field_of_view_deg[..]),
            ("rotating", 1, &[360.0, 100.0][..])
        );
        assert!(
            row.reference.starts_with("data/") && row.divergence_mrad > 0.0 && !row.pulse_rates_hz.is_empty()
        );
    }
}
