//! Figures of a fitted sensor: the estimates, and scatter and dropouts by class in both halves of the
//! columns.

use super::planes::{NORMAL_MEDIAN, Patch, Sample, median_of_numbers};
use super::{SpinningFit, TARGET_REFLECTANCE};
use libm::{acos, sqrt};
use serde::Serialize;
use std::fmt::Write as _;
use vlscan_base::error::{Error, Result};
use vlscan_geom::degrees;

/// Limits of the classes of distance, m.
const DISTANCES: [f64; 12] = [0.0, 1.0, 2.0, 4.0, 7.0, 12.0, 20.0, 35.0, 60.0, 100.0, 200.0, 500.0];
/// Limits of the classes of incidence, degrees.
const INCIDENCES: [f64; 5] = [0.0, 30.0, 50.0, 65.0, 90.0];
/// Limits of the classes of reflectivity, as fractions.
const REFLECTANCES: [f64; 6] = [0.0, 0.05, 0.15, 0.3, 0.6, 1.01];
/// Fewest echoes of a half in a class that is reported.
const MIN_ECHOES: usize = 100;

/// Estimates about a sensor.
#[derive(Clone, Debug, Serialize)]
pub struct SpinningFigures {
    /// Product line.
    pub product: String,
    /// Planes in the recording.
    pub planes: usize,
    /// Standard deviation of ranges of strong echoes, m, and its standard deviation.
    pub constant_m: [f64; 2],
    /// By photons, of an echo at the threshold, m.
    pub shot_m: [f64; 2],
    /// By the amplifier, of an echo at the threshold, m.
    pub amplifier_m: [f64; 2],
    /// By texture, over the standard deviation of depths in the footprint.
    pub footprint: [f64; 2],
    /// Range at which a target of 10 % is at the threshold, m.
    pub max_range_m: [f64; 2],
    /// Photoelectrons at the threshold.
    pub threshold_photons: u32,
    /// Share of lost echoes.
    pub dropout_rate: [f64; 2],
    /// Step of ranges, m.
    pub range_step_m: f64,
    /// By distance, then by incidence, then by reflectivity.
    pub classes: Vec<ClassFigures>,
}

/// Scatter and dropouts of a class of pulses at planes. Of each pair the first value is of the half that was
/// fitted, the second of the half that was not.
#[derive(Clone, Debug, Serialize)]
pub struct ClassFigures {
    /// `distance` (m), `incidence` (degrees) or `reflectance`.
    pub by: &'static str,
    /// Its limits.
    pub limits: [f64; 2],
    /// Echoes.
    pub echoes: [usize; 2],
    /// Scatter of ranges around the planes, m: 1.4826 times the median of absolute residuals.
    pub scatter_m: [f64; 2],
    /// The same of the law of noise, m.
    pub law_m: [f64; 2],
    /// Share of pulses without an echo.
    pub dropouts: [f64; 2],
    /// The same of the law of detection.
    pub law_dropouts: [f64; 2],
}

impl SpinningFit {
    /// Returns the estimates.
    pub fn figures(&self) -> SpinningFigures {
        let (noise, deviations, detection) = (&self.noise, self.law.root_deviations(), &self.detection);
        let mut classes = Vec::new();
        let incidence = |patch: &Patch| degrees(acos(patch.cosine.min(1.0)));
        classes.extend(self.classes("distance", &DISTANCES, |patch| patch.range));
        classes.extend(self.classes("incidence", &INCIDENCES, incidence));
        classes.extend(self.classes("reflectance", &REFLECTANCES, |patch| patch.reflectance));
        SpinningFigures {
            product: self.scanner.name.clone(),
            planes: self.planes.len(),
            constant_m: [noise.constant, deviations[0]],
            shot_m: [noise.shot, deviations[1]],
            amplifier_m: [noise.amplifier, deviations[2]],
            footprint: [noise.footprint, deviations[3]],
            // The range goes with the root of the threshold.
            max_range_m: [self.max_range, 0.5 * self.max_range * detection.threshold_deviation],
            threshold_photons: detection.photons,
            dropout_rate: [detection.dropout_rate, detection.dropout_deviation],
            range_step_m: self.image.range_step,
            classes,
        }
    }

    fn classes(&self, by: &'static str, limits: &[f64], value: impl Fn(&Patch) -> f64) -> Vec<ClassFigures> {
        let class = |pair: &[f64]| {
            let limits = [pair[0], pair[1]];
            let patches: Vec<&Patch> =
                self.planes.iter().filter(|p| (limits[0]..limits[1]).contains(&value(p))).collect();
            let halves = [true, false].map(|is_fitted| self.half_of_class(&patches, is_fitted));
            let is_large = halves.iter().all(|half| half.echoes >= MIN_ECHOES);
            is_large.then(|| ClassFigures {
                by,
                limits,
                echoes: halves.each_ref().map(|h| h.echoes),
                scatter_m: halves.each_ref().map(|h| h.scatter),
                law_m: halves.each_ref().map(|h| h.law),
                dropouts: halves.each_ref().map(|h| h.dropouts),
                law_dropouts: halves.each_ref().map(|h| h.law_dropouts),
            })
        };
        limits.windows(2).filter_map(class).collect()
    }

    fn half_of_class(&self, patches: &[&Patch], is_fitted: bool) -> HalfFigures {
        let divergence = self.scanner.devices[0].beam.divergence;
        let (mut residuals, mut sigmas, mut pulses, mut lost) = (Vec::new(), Vec::new(), 0, 0.0);
        for patch in patches {
            let sigma = self.law.sigma(patch, self.detection.threshold, divergence);
            let chance = self.detection.chance(patch.strength);
            for sample in patch.samples.iter().filter(|sample| sample.is_fitted == is_fitted) {
                pulses += 1;
                lost += 1.0 - chance;
                if !sample.residual.is_nan() {
                    residuals.push((sample.residual / inflation(sample)).abs());
                    sigmas.push(sigma);
                }
            }
        }
        HalfFigures {
            echoes: residuals.len(),
            scatter: NORMAL_MEDIAN * median_of_numbers(residuals.iter().copied()),
            law: NORMAL_MEDIAN * median_of_mixture(&sigmas),
            dropouts: (pulses - residuals.len()) as f64 / f64::from(pulses.max(1) as u32),
            law_dropouts: lost / f64::from(pulses.max(1) as u32),
        }
    }
}

struct HalfFigures {
    echoes: usize,
    scatter: f64,
    law: f64,
    dropouts: f64,
    law_dropouts: f64,
}

/// Standard deviation of a residual over that of a range: a plane is nearer to the ranges that it was fitted
/// to, and farther from others.
fn inflation(sample: &Sample) -> f64 {
    let sign = if sample.is_fitted { -1.0 } else { 1.0 };
    sqrt((1.0 + sign * sample.leverage).max(0.05))
}

/// Median of the absolute values of normal variables of these standard deviations.
fn median_of_mixture(sigmas: &[f64]) -> f64 {
    let (mut low, mut high) = (0.0, sigmas.iter().copied().fold(0.0, f64::max));
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        let within: f64 = sigmas.iter().map(|s| libm::erf(middle / (s * std::f64::consts::SQRT_2))).sum();
        if within < 0.5 * sigmas.len() as f64 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

impl SpinningFigures {
    /// The figures as JSON.
    ///
    /// # Errors
    /// [`Error::Input`] for values that JSON cannot hold.
    pub fn json(&self) -> Result<String> {
        serde_json::to_string_pretty(self).map_err(|e| Error::input(e.to_string()))
    }

    /// The figures as text.
    pub fn table(&self) -> String {
        let mut text = String::new();
        let mm = |pair: [f64; 2]| format!("{:.1} ± {:.1} mm", 1e3 * pair[0], 1e3 * pair[1]);
        let rows = [
            ("planes", self.planes.to_string()),
            ("range noise: constant", mm(self.constant_m)),
            ("  by photons, at the threshold", mm(self.shot_m)),
            ("  by the amplifier, at the threshold", mm(self.amplifier_m)),
            (
                "  over the depth of the footprint",
                format!("{:.2} ± {:.2}", self.footprint[0], self.footprint[1]),
            ),
            ("photoelectrons at the threshold", self.threshold_photons.to_string()),
            (
                "maximum range",
                format!(
                    "{:.1} ± {:.1} m for {} %",
                    self.max_range_m[0],
                    self.max_range_m[1],
                    100.0 * TARGET_REFLECTANCE
                ),
            ),
            (
                "dropouts of any strength",
                format!("{:.2} ± {:.2} %", 100.0 * self.dropout_rate[0], 100.0 * self.dropout_rate[1]),
            ),
            ("step of ranges", format!("{} mm", 1e3 * self.range_step_m)),
        ];
        // Writing to a string does not fail.
        for (name, value) in rows {
            let _ = writeln!(text, "{name:<38} {value}");
        }
        let _ = writeln!(
            text,
            "\n{:<24} {:>14} {:>20} {:>20} {:>20}",
            "fitted, other half", "echoes", "scatter, mm", "of the law, mm", "dropouts, %"
        );
        for class in &self.classes {
            let name = format!("{} {} to {}", class.by, class.limits[0], class.limits[1]);
            let pair = |values: [f64; 2], factor: f64| {
                format!("{:.1} {:.1}", factor * values[0], factor * values[1])
            };
            let _ = writeln!(
                text,
                "{name:<24} {:>14} {:>20} {:>20} {:>20}",
                format!("{} {}", class.echoes[0], class.echoes[1]),
                pair(class.scatter_m, 1e3),
                pair(class.law_m, 1e3),
                pair(class.dropouts, 100.0)
            );
        }
        text
    }
}
