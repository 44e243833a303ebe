//! A spinning sensor from one recorded revolution: its calibration is known, noise and detection are
//! estimated.
//!
//! Planes are found in the image of ranges, in patches of neighbouring pixels, from one half of the columns.
//! The scatter of their ranges by strength, distance and incidence gives the law of noise, pulses without an
//! echo give threshold, photon statistics and dropouts. The other half of the columns validates the law.
//!
//! | file | what it does |
//! |---|---|
//! | `image` | the recording as an image of ranges |
//! | `planes` | planes in patches of pixels |
//! | `noise` | the law of range noise |
//! | `detection` | threshold, photons, dropouts |
//! | `error` | recordings from which no sensor can be estimated |
//! | `report` | figures by class |
//! | `write` | the pipeline file, and the planes as a scene |

mod detection;
mod error;
mod image;
mod noise;
mod planes;
mod report;
#[cfg(test)]
mod tests;
mod write;

pub use error::SpinningError;
pub use image::{Pixel, RangeImage};
pub use planes::{Patch, Sample};
pub use report::{ClassFigures, SpinningFigures};
pub use write::SpinningFiles;

use detection::{Detection, detection};
use noise::{NoiseLaw, noise_law, white_strength};
use planes::planes;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_survey::{RangeNoise, ReadOptions, Scanner, find_scanner};

/// Minimum number of planes for a law.
const MIN_PLANES: usize = 25;
/// Number of planes below which a warning calls the law uncertain.
const FEW_PLANES: usize = 100;
/// Rounds of noise and detection, each with the planes and the threshold of the other.
const ROUNDS: usize = 3;
/// Reflectance of the target for which the maximum range is stated.
const TARGET_REFLECTANCE: f64 = 0.1;
/// Plausible maximum range over that of the product line: sensors of a line differ, and so do their targets.
const RANGE_RATIOS: std::ops::RangeInclusive<f64> = 0.6..=1.7;
/// Maximum plausible standard deviation of the threshold, as a share.
const MAX_THRESHOLD_DEVIATION: f64 = 0.5;

/// Maximum plausible noise of strong echoes and of those at the threshold, m, and over the depth of the
/// footprint. Sensors have 6 to 9 mm, 20 to 50 mm and 0.5 to 1.5.
const MAX_CONSTANT: f64 = 0.03;
const MAX_AT_THRESHOLD: f64 = 0.3;
const MAX_FOOTPRINT: f64 = 2.0;

/// Half of the columns that is fitted; the other half tests the fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Half {
    /// Columns 0, 2, 4 …
    #[default]
    Even,
    /// Columns 1, 3, 5 …
    Odd,
}

/// Choices of a fit.
#[derive(Clone, Debug, Default)]
pub struct SpinningRequest {
    /// Columns that are fitted.
    pub half: Half,
}

/// Estimates about a spinning sensor from a recording.
#[derive(Clone, Debug)]
pub struct SpinningFit {
    /// The calibrated sensor, with the beam and the receiver of its product line.
    pub scanner: Scanner,
    /// The recording.
    pub image: RangeImage,
    /// Planes in the recording.
    pub planes: Vec<Patch>,
    /// Noise of ranges.
    pub noise: RangeNoise,
    /// Range at which a target of a reflectance of 10 % that faces the beam is right at the threshold, m.
    pub max_range: f64,
    law: NoiseLaw,
    detection: Detection,
    /// Strength of a white target at 1 m.
    white: f64,
}

/// Estimates noise and detection of the sensor with the calibration file `calibration` from the recording of
/// one revolution, see [`RangeImage::read`].
///
/// # Errors
/// Files that cannot be read; [`Error::Input`] for recordings with too few planes.
pub fn fit_spinning(
    recording: &Path,
    calibration: &Path,
    request: &SpinningRequest,
    found: &mut Diagnostics,
) -> Result<SpinningFit> {
    let (mut scanner, warnings) = find_scanner(&calibration.to_string_lossy(), &ReadOptions::default())?;
    found.extend(warnings);
    scanner.devices.iter_mut().for_each(|device| device.beam.take_stated_width());
    let image = RangeImage::read(recording, &scanner, found)?;
    let fit = estimate(scanner, image, request.half)
        .map_err(|problem| Error::caused_by(format!("{}: {problem}", recording.display()), problem))?;
    if fit.planes.len() < FEW_PLANES {
        let message = format!(
            "{} planes are few for a noise law: it may differ between the halves of the columns",
            fit.planes.len()
        );
        found
            .warn(Some(Place::of_file(recording)), message)
            .help("compare with the result of --half odd; walls, floors and roads are planes");
    }
    if let Some(reason) = fit.range_doubt() {
        let message = format!("`max_range` and `threshold_photons` are left out: {reason}");
        found.warn(Some(Place::of_file(recording)), message).help(
            "record planes near the largest range, or set the values of the instrument; they are comments \
             in the pipeline file",
        );
    }
    if let Some(reason) = fit.noise_doubt() {
        found
            .warn(Some(Place::of_file(recording)), format!("`range_noise` is left out: {reason}"))
            .help("check that the calibration file is that of the sensor that recorded the revolution");
    }
    Ok(fit)
}

impl SpinningFit {
    /// Maximum range of the product line for a target of a reflectance of 10 %, m, if it is stated.
    fn stated_range(&self) -> Option<f64> {
        let target = self.scanner.devices.first()?.receiver.max_range?;
        Some(target.range * libm::sqrt(TARGET_REFLECTANCE / target.reflectance))
    }

    /// The reason why the threshold, and the maximum range with it, cannot be that of the sensor; `None` if
    /// it may be.
    fn range_doubt(&self) -> Option<String> {
        let deviation = self.detection.threshold_deviation;
        if deviation > MAX_THRESHOLD_DEVIATION {
            return Some(format!("the threshold is uncertain by {:.0} %", 100.0 * deviation));
        }
        let stated = self.stated_range()?;
        (!RANGE_RATIOS.contains(&(self.max_range / stated))).then(|| {
            format!(
                "the planes suggest a maximum range of {:.1} m for {} %, that of {} is {stated:.1} m",
                self.max_range,
                100.0 * TARGET_REFLECTANCE,
                self.scanner.name
            )
        })
    }

    /// The reason why the noise cannot be that of the sensor; `None` if it may be. With the calibration of
    /// another sensor, walls are bent.
    fn noise_doubt(&self) -> Option<String> {
        let RangeNoise { constant, shot, amplifier, footprint } = self.noise;
        let too_large = |what: &str, noise: f64, max: f64| {
            let [noise, max] = [1e3 * noise, 1e3 * max];
            format!("the noise {what} is {noise:.0} mm, expected at most {max:.0} mm")
        };
        if constant > MAX_CONSTANT {
            return Some(too_large("of strong echoes", constant, MAX_CONSTANT));
        }
        if shot.max(amplifier) > MAX_AT_THRESHOLD {
            return Some(too_large("at the threshold", shot.max(amplifier), MAX_AT_THRESHOLD));
        }
        (footprint > MAX_FOOTPRINT).then(|| {
            format!(
                "the noise over the depth of the footprint is {footprint:.1}, expected at most \
                 {MAX_FOOTPRINT:.1}"
            )
        })
    }

    /// The noise with the threshold of the written sensor: that of the product line, if the estimate is left
    /// out. The parts that grow with the weakness of echoes refer to an echo at the threshold, whose strength
    /// falls with the square of the maximum range.
    fn written_noise(&self) -> RangeNoise {
        let noise = self.noise;
        match (self.range_doubt(), self.stated_range()) {
            (Some(_), Some(stated)) => {
                let ratio = stated / self.max_range;
                RangeNoise { shot: noise.shot * ratio, amplifier: noise.amplifier * ratio * ratio, ..noise }
            }
            _ => noise,
        }
    }
}

/// Estimates noise and detection from an image; the error names what the recording lacks.
fn estimate(scanner: Scanner, image: RangeImage, half: Half) -> Result<SpinningFit, SpinningError> {
    let parity = u32::from(half == Half::Odd);
    let all = planes(&image, |column| column % 2 == parity);
    if all.len() < MIN_PLANES {
        return Err(SpinningError::FewPlanes(all.len()));
    }
    let divergence = scanner.devices[0].beam.divergence;
    // The threshold only scales the parts of the noise until it is known.
    let mut threshold = all.iter().map(|patch| patch.strength).fold(f64::MAX, f64::min);
    let mut estimated = None;
    for _ in 0..ROUNDS {
        let law = noise_law(&all, threshold, divergence).ok_or(SpinningError::FewPlanes(0))?;
        let chosen = || all.iter().zip(&law.is_plane).filter(|(_, is_plane)| **is_plane).map(|(p, _)| p);
        if chosen().count() < MIN_PLANES {
            return Err(SpinningError::FewPlanes(chosen().count()));
        }
        let pulses: Vec<(f64, bool)> = chosen()
            .flat_map(|patch| {
                let fitted = patch.samples.iter().filter(|sample| sample.is_fitted);
                fitted.map(|sample| (patch.strength, !sample.residual.is_nan()))
            })
            .collect();
        let detection = detection(&pulses).ok_or_else(|| SpinningError::FewPlanes(chosen().count()))?;
        threshold = detection.threshold;
        estimated = Some((law, detection));
    }
    let (law, detection) = estimated.ok_or(SpinningError::FewPlanes(0))?;
    let planes: Vec<Patch> =
        all.into_iter().zip(&law.is_plane).filter(|(_, is_plane)| **is_plane).map(|(p, _)| p).collect();
    let white = match image.has_signal {
        true => white_strength(planes.iter()),
        false => 1.0,
    };
    if !white.is_finite() {
        return Err(SpinningError::NoReflectivity);
    }
    Ok(SpinningFit {
        noise: law.range_noise(image.range_step),
        max_range: libm::sqrt(white * TARGET_REFLECTANCE / detection.threshold),
        scanner,
        image,
        planes,
        law,
        detection,
        white,
    })
}
