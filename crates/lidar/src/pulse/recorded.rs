//! Echoes of recorded waveforms.

use super::detector_settings::PeakRule;
use super::fit;
use super::peaks::Peaks;
use super::waveform::Waveform;
use vlscan_trace::simd::portable::Portable;

/// An echo in recorded samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordedEcho {
    /// Index of the sample with its peak.
    pub sample: usize,
    /// Amplitude there.
    pub amplitude: f64,
    /// Half width at 1/e of the fitted Gaussian (spec pulse-physics §4.5), samples. NaN or meaningless, as
    /// are `centre`, `height` and `pedestal`, where the samples do not resemble a Gaussian.
    pub width: f64,
    /// Centre of the fitted Gaussian, samples.
    pub centre: f64,
    /// Height of the Gaussian above its pedestal.
    pub height: f64,
    /// Constant offset of the fitted Gaussian, in the unit of the amplitude.
    pub pedestal: f64,
}

/// Neighbours on either side below an echo, plus one: one nanosecond in bins of 0.25 ns.
const WINDOW: u64 = 5;
/// Smallest amplitude of an echo, as a share of the highest.
const MIN_SHARE: f64 = 0.01;

/// The echoes of `samples` in their order. If there is one echo, all samples are fitted;
/// each of several echoes is fitted up to the nearer valley on either side.
pub fn recorded_echoes(samples: &[f64]) -> Vec<RecordedEcho> {
    let highest = samples.iter().copied().fold(0.0, f64::max);
    if highest <= 0.0 || !highest.is_finite() {
        return Vec::new();
    }
    let waveform = Waveform::of_samples(samples);
    let rule =
        PeakRule { threshold: MIN_SHARE * highest, window: WINDOW, weak_neighbours: true, first_bin: true };
    let peaks: Vec<(u64, f64)> = Peaks::of(Portable, &waveform, rule).collect();
    let echo = |&(bin, amplitude): &(u64, f64)| {
        let sample = bin as usize;
        let reach = if peaks.len() > 1 { valley(samples, sample) } else { u64::MAX };
        let [pedestal, height, centre, width] = fit::fit_gaussian(&waveform, bin, reach);
        RecordedEcho { sample, amplitude, width, centre, height, pedestal }
    };
    peaks.iter().map(echo).collect()
}

/// Distance from a peak to the nearer of its two valleys, at least 3.
fn valley(samples: &[f64], peak: usize) -> u64 {
    let falls = |run: &mut dyn Iterator<Item = &f64>| {
        let mut last = samples[peak];
        run.take_while(|s| **s < std::mem::replace(&mut last, **s)).count()
    };
    let after = falls(&mut samples[peak + 1..].iter());
    let before = falls(&mut samples[..peak].iter().rev());
    (before.min(after) as u64).max(3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use libm::exp;

    fn gaussians(of: &[(f64, f64, f64)], count: usize) -> Vec<f64> {
        let at = |t: f64| {
            of.iter().map(|(top, centre, w)| top * exp(-((t - centre) / w) * ((t - centre) / w))).sum()
        };
        (0..count).map(|i| at(i as f64)).collect()
    }

    #[test]
    fn gaussians_are_found_at_their_centres_with_their_widths() {
        let echoes = recorded_echoes(&gaussians(&[(2.0, 20.0, 4.0)], 60));
        assert_eq!(echoes.len(), 1);
        assert_eq!((echoes[0].sample, echoes[0].amplitude), (20, 2.0));
        assert!((echoes[0].width - 4.0).abs() < 1e-3, "{}", echoes[0].width);
        let echoes = recorded_echoes(&gaussians(&[(2.0, 20.0, 4.0), (0.5, 50.0, 3.0)], 80));
        assert_eq!(echoes.iter().map(|e| e.sample).collect::<Vec<_>>(), [20, 50]);
        assert!((echoes[0].width - 4.0).abs() < 0.1 && (echoes[1].width - 3.0).abs() < 0.1, "{echoes:?}");
    }

    #[test]
    fn odd_samples_are_accepted() {
        for samples in
            [&[][..], &[0.0; 9], &[1.0], &[f64::NAN; 5], &[f64::INFINITY, 1.0], &[-1.0, -2.0], &[3.0, 3.0]]
        {
            recorded_echoes(samples);
        }
    }
}
