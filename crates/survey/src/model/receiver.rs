//! Settings of an instrument's receiver beyond the reference's threshold on a noiseless waveform. All of them
//! apply in refined physics only (correction `receiver`).

use super::Beam;
use libm::{acos, sqrt};
use std::f64::consts::PI;
use std::fmt;
use std::sync::Arc;

/// Profile of the beam across its axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BeamProfile {
    /// Gaussian; divergences are full angles at 1/e² of the intensity on the axis.
    #[default]
    Gaussian,
    /// Uniform within the cone of the divergence, nothing outside.
    TopHat,
}

/// Settings of the receiver behind the optics. The default is ideal: no noise, no saturation, the reference's
/// detector.
#[derive(Clone, Default, PartialEq)]
pub struct Receiver {
    /// Measured power of the outgoing pulse over time; `None` = the reference's gamma-like curve.
    pub pulse_shape: Option<Arc<PulseSamples>>,
    /// Noise of detector and amplifier; `None` = none.
    pub noise: Option<AmplifierNoise>,
    /// Shot noise of signal and background light; `None` = none.
    pub shot: Option<ShotNoise>,
    /// Electrical bandwidth, Hz; `None` = matched to the pulse.
    pub bandwidth: Option<f64>,
    /// Target whose echo just reaches the threshold; overrides [`super::Detector::threshold`].
    pub max_range: Option<ReferenceTarget>,
    /// Amplitude at which the receiver saturates, W.
    pub saturation: Option<f64>,
    /// Amount by which the range of an echo right at the threshold is too long, m.
    pub range_walk: f64,
    /// True if samples lie on a grid of bins counted from the emission, instead of beginning with the first
    /// return.
    pub digitiser_clock: bool,
    /// Estimator of the range of an echo.
    pub ranging: Ranging,
    /// Noise of ranges by the strength of echoes; overrides [`super::Detector::accuracy`].
    pub range_noise: Option<RangeNoise>,
    /// Photoelectrons of an echo right at the threshold, whose number varies from pulse to pulse; `None` =
    /// strengths do not vary.
    pub threshold_photons: Option<u32>,
    /// Share of echoes that are lost at any strength.
    pub dropout_rate: f64,
    /// Time after an echo, or of [`Ranging::Photons`] after a photon, during which no other one is detected,
    /// ns.
    pub dead_time: f64,
    /// Step of the ranges that are reported, m; 0 = any range.
    pub range_step: f64,
    /// Field of view, full angle, rad; `None` = all light that water scatters forward is received.
    pub field_of_view: Option<f64>,
    /// True if points below water are corrected for its refraction and speed of light.
    pub corrects_refraction: bool,
    /// Frequency-modulated continuous wave; `None` = pulses.
    pub fmcw: Option<Fmcw>,
    /// Pixels and imperfections of [`Ranging::Photons`].
    pub pixels: PixelSettings,
}

/// A frequency-modulated continuous wave: chirps whose frequency rises, then falls evenly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fmcw {
    /// Bandwidth of a chirp, Hz.
    pub bandwidth: f64,
    /// Duration of a chirp, up or down, s.
    pub chirp: f64,
    /// Sampling rate of the beat, Hz; `None` = all frequencies are measured.
    pub sample_rate: Option<f64>,
    /// True if the receiver measures the sign of frequencies.
    pub has_quadrature: bool,
    /// Probability of a false alarm at the threshold; strengths have the statistics of a single speckle.
    /// `None` = strengths do not vary.
    pub false_alarm: Option<f64>,
}

/// Pixels of a receiver that counts photons, and events without light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelSettings {
    /// Number of pixels, which share the light evenly.
    pub count: u32,
    /// Standard deviation of the times of photons, ns.
    pub jitter: f64,
    /// Photoelectrons of a pixel without light, 1/s.
    pub dark_counts: f64,
    /// Probability that a photoelectron causes another one, and its mean delay after the dead time, ns;
    /// `None` = none.
    pub afterpulse: Option<(f64, f64)>,
}

impl Default for PixelSettings {
    /// A single pixel without imperfections.
    fn default() -> PixelSettings {
        PixelSettings { count: 1, jitter: 0.0, dark_counts: 0.0, afterpulse: None }
    }
}

impl fmt::Debug for Receiver {
    /// Checksums of surveys include this text, so receivers without settings for water, chirps and pixels
    /// have none of them in it.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        // Checksums would miss a field that is not named.
        let Receiver {
            pulse_shape,
            noise,
            shot,
            bandwidth,
            max_range,
            saturation,
            range_walk,
            digitiser_clock,
            ranging,
            range_noise,
            threshold_photons,
            dropout_rate,
            dead_time,
            range_step,
            field_of_view,
            corrects_refraction,
            fmcw,
            pixels,
        } = self;
        let mut fields = f.debug_struct("Receiver");
        fields
            .field("pulse_shape", pulse_shape)
            .field("noise", noise)
            .field("shot", shot)
            .field("bandwidth", bandwidth)
            .field("max_range", max_range)
            .field("saturation", saturation)
            .field("range_walk", range_walk)
            .field("digitiser_clock", digitiser_clock)
            .field("ranging", ranging)
            .field("range_noise", range_noise)
            .field("threshold_photons", threshold_photons)
            .field("dropout_rate", dropout_rate)
            .field("dead_time", dead_time)
            .field("range_step", range_step);
        if field_of_view.is_some() {
            fields.field("field_of_view", field_of_view);
        }
        if *corrects_refraction {
            fields.field("corrects_refraction", corrects_refraction);
        }
        if fmcw.is_some() {
            fields.field("fmcw", fmcw);
        }
        if *pixels != PixelSettings::default() {
            fields.field("pixels", pixels);
        }
        fields.finish()
    }
}

/// Noise of a range as a function of the strength of its echo and of the depth of its footprint: independent
/// parts. The variance for an echo of amplitude A over the threshold T is constant² + shot²·T/A +
/// amplifier²·(T/A)² + (footprint·depth)²: the part that does not depend on the light (timer, jitter), the
/// shot noise of the light, which falls with the root of the number of photons, the noise of the amplifier,
/// which falls with the signal (Cramér–Rao bounds of a pulse's time in photon noise and in white noise), and
/// the texture and speckle of the surface, which move the centre of the light within the footprint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RangeNoise {
    /// Of echoes of any strength.
    pub constant: f64,
    /// By photon noise, of an echo right at the threshold.
    pub shot: f64,
    /// By noise of the amplifier, of an echo right at the threshold.
    pub amplifier: f64,
    /// By texture within the footprint, over the standard deviation of the depths in it.
    pub footprint: f64,
}

impl RangeNoise {
    /// Standard deviation for an echo of that amplitude, m; at the threshold for weaker ones. `depth` is the
    /// standard deviation of the depths within the footprint, m.
    pub fn sigma(&self, amplitude: f64, threshold: f64, depth: f64) -> f64 {
        let weakness = if amplitude > threshold { threshold / amplitude } else { 1.0 };
        let (shot, amplifier) = (self.shot * self.shot, self.amplifier * self.amplifier);
        let texture = self.footprint * depth;
        libm::sqrt(
            self.constant * self.constant + (shot + amplifier * weakness) * weakness + texture * texture,
        )
    }
}

impl fmt::Debug for Beam {
    /// Checksums of surveys include this text, so beams without an overlap have no such field in it.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        // Checksums would miss a field that is not named.
        let Beam {
            divergence,
            divergence_y,
            profile,
            aperture,
            pulse_length,
            stated_width,
            wavelength,
            atmosphere_wavelength,
            average_power,
            pulse_energy,
            quality,
            efficiency,
            receiver_diameter,
            overlap,
            visibility,
        } = self;
        let mut fields = f.debug_struct("Beam");
        fields
            .field("divergence", divergence)
            .field("divergence_y", divergence_y)
            .field("profile", profile)
            .field("aperture", aperture)
            .field("pulse_length", pulse_length)
            .field("stated_width", stated_width)
            .field("wavelength", wavelength)
            .field("atmosphere_wavelength", atmosphere_wavelength)
            .field("average_power", average_power)
            .field("pulse_energy", pulse_energy)
            .field("quality", quality)
            .field("efficiency", efficiency)
            .field("receiver_diameter", receiver_diameter);
        if let Some(overlap) = overlap {
            fields.field("overlap", overlap);
        }
        fields.field("visibility", visibility).finish()
    }
}

/// Overlap of transmitter and receiver: the share of the light of a near target that reaches the detector.
///
/// A receiver of diameter D that is focused at F images a point at the range R as a disc of the angular
/// diameter D·|1/R − 1/F| (defocus), shifted by B·|1/R − 1/F| if the axes of transmitter and receiver are B
/// apart and meet at F (parallax). The share is that of the disc within the round field of view, for a beam
/// that is narrower than the field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Full field of view of the receiver, rad.
    pub field_of_view: f64,
    /// Distance between the axes of transmitter and receiver, m.
    pub baseline: f64,
    /// Reciprocal of the range at which the receiver is focused, 1/m; 0 far away.
    pub focus: f64,
}

impl Overlap {
    /// Share of the light of a target at `range` (m) that reaches the detector of a receiver of this diameter
    /// (m), 0 to 1.
    pub fn share(&self, diameter: f64, range: f64) -> f64 {
        let defocus = (1.0 / range - self.focus).abs();
        let (disc, field) = (0.5 * diameter * defocus, 0.5 * self.field_of_view);
        let shift = if self.baseline > 0.0 { self.baseline * defocus } else { 0.0 };
        if shift <= field - disc {
            1.0
        } else if shift <= disc - field {
            (field / disc) * (field / disc)
        } else if shift < disc + field {
            common_area(disc, field, shift) / (PI * disc * disc)
        } else {
            0.0
        }
    }
}

/// Area that two discs of these radii have in common whose centres are `distance` apart: less than the sum
/// and more than the difference of the radii.
fn common_area(a: f64, b: f64, distance: f64) -> f64 {
    let half_angle = |own: f64, other: f64| {
        acos(((distance * distance + own * own - other * other) / (2.0 * distance * own)).clamp(-1.0, 1.0))
    };
    let kite = (-distance + a + b) * (distance + a - b) * (distance - a + b) * (distance + a + b);
    a * a * half_angle(a, b) + b * b * half_angle(b, a) - 0.5 * sqrt(kite.max(0.0))
}

/// Samples of a pulse's power over time, normalised.
#[derive(Clone, Debug, PartialEq)]
pub struct PulseSamples {
    /// Times, ns, ascending; the first is 0.
    pub times: Vec<f64>,
    /// Power at those times relative to the peak, 0 to 1.
    pub powers: Vec<f64>,
}

/// Noise of detector and amplifier: normal, independent of the signal, white within the bandwidth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AmplifierNoise {
    /// Noise equivalent power: standard deviation of a sample, W.
    Power(f64),
    /// The power at which the peak of that target's echo is `value` times the standard deviation.
    Ratio {
        /// Target to whose echo the ratio refers.
        target: ReferenceTarget,
        /// Peak amplitude over standard deviation.
        value: f64,
    },
}

/// An extended Lambertian target that faces the instrument, to which a figure of a data sheet refers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceTarget {
    /// Range, m.
    pub range: f64,
    /// Reflectance, 0 to 1.
    pub reflectance: f64,
    /// Pulse rate to which the figure applies, Hz; `None` = the scanner's first.
    pub pulse_freq: Option<f64>,
}

/// Shot noise of the photocurrent: variance 2qB·(P_signal + P_background)/responsivity in W², B the
/// bandwidth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShotNoise {
    /// Mean power of background light on the detector, W.
    pub background: f64,
    /// Photocurrent per power, A/W.
    pub responsivity: f64,
}

/// Estimators of the range of an echo from the waveform.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ranging {
    /// The largest sample and its neighbours.
    #[default]
    Peak,
    /// The centroid of the samples around the peak.
    Centroid,
    /// The maximum of a Gaussian fitted to the samples around the peak.
    Gaussian,
    /// None: every photoelectron is a separate return.
    Photons,
}

/// Full width at half maximum of x²e^(−x), whose half-power points are −2W₀(−1/(√2·e)) and −2W₋₁(−1/(√2·e)).
const GAMMA_WIDTH: f64 = 3.394_680_670_846_504;

/// Length (ns) of the reference's pulse (t/τ)²·e^(−t/τ), τ = length/7, which is `fwhm` ns wide at half
/// maximum.
pub fn pulse_length_of_width(fwhm: f64) -> f64 {
    7.0 * fwhm / GAMMA_WIDTH
}

/// Full width at half maximum (ns) of the reference's pulse of `length` ns.
pub fn width_of_pulse_length(length: f64) -> f64 {
    length * GAMMA_WIDTH / 7.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn range_noise_falls_with_the_strength() {
        let noise = RangeNoise { constant: 0.006, shot: 0.02, amplifier: 0.03, footprint: 0.5 };
        let variance = |weakness: f64| 3.6e-5 + 4e-4 * weakness + 9e-4 * weakness * weakness + 1e-4;
        for (amplitude, weakness) in [(0.5, 1.0), (2.0, 1.0), (8.0, 0.25), (f64::INFINITY, 0.0)] {
            assert!(
                (noise.sigma(amplitude, 2.0, 0.02) - f64::sqrt(variance(weakness))).abs() < 1e-15,
                "{amplitude}"
            );
        }
    }

    #[test]
    fn the_width_of_the_gamma_pulse_is_that_of_its_half_power_points() {
        let half = |x: f64| x * x * (-x).exp() - 2.0 * (-2.0f64).exp();
        let root = |mut low: f64, mut high: f64| {
            for _ in 0..200 {
                let middle = 0.5 * (low + high);
                if half(low) * half(middle) <= 0.0 { high = middle } else { low = middle }
            }
            0.5 * (low + high)
        };
        let width = root(2.0, 9.0) - root(0.0, 2.0);
        assert!((width - GAMMA_WIDTH).abs() < 1e-13, "{width:.16}");
        let length = pulse_length_of_width(3.0);
        assert!((length * width / 7.0 - 3.0).abs() < 1e-12);
        assert!((width_of_pulse_length(length) - 3.0).abs() < 1e-12);
    }
}
