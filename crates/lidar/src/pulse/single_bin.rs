//! The fast path of most pulses: all their light arrives within one bin, so that the waveform is the outgoing
//! pulse, whose single peak is precomputed.

use super::detector_settings::{DetectorSettings, PeakRule, Return};
use super::return_profile::ReturnProfile;
use super::shape::PulseShape;

/// The precomputed peak of a pulse that returns from one bin.
#[derive(Clone, Debug)]
pub(super) struct SingleBinDetector {
    /// Largest sample of the pulse.
    top: f64,
    /// Smallest sample among the neighbours of the peak, if these must reach the threshold.
    min_neighbour: Option<f64>,
    threshold: f64,
}

/// Relative difference of neighbouring samples above which their products with any intensity stay in the same
/// order.
const MIN_RELATIVE_STEP: f64 = 1e-9;

/// Intensities whose products with a sample are normal numbers.
const NORMAL_INTENSITIES: std::ops::Range<f64> = 1e-200..1e200;

impl SingleBinDetector {
    /// `None` if the peak cannot be precomputed: windows of one bin or longer than the pulse, flat or ragged
    /// pulses.
    pub fn new(shape: &PulseShape, rule: &PeakRule) -> Option<SingleBinDetector> {
        let (samples, peak) = (&shape.samples, shape.peak);
        let window = usize::try_from(rule.window).ok().filter(|w| *w >= 2)?;
        let grows = |pair: &[f64]| pair[0] < pair[1] * (1.0 - MIN_RELATIVE_STEP);
        let falls = |pair: &[f64]| pair[1] < pair[0] * (1.0 - MIN_RELATIVE_STEP);
        let is_simple = peak >= 1
            && peak.checked_add(window)? <= samples.len()
            && samples[..=peak].windows(2).all(grows)
            && samples[peak..].windows(2).all(falls)
            && rule.threshold > 0.0;
        let first = (peak + 1).saturating_sub(window).max(usize::from(!rule.first_bin));
        let min_neighbour = samples.get(first..peak + window)?.iter().copied().fold(f64::INFINITY, f64::min);
        is_simple.then_some(SingleBinDetector {
            top: samples[peak],
            min_neighbour: (!rule.weak_neighbours).then_some(min_neighbour),
            threshold: rule.threshold,
        })
    }

    /// Detects the return of light within one bin; there is at most one. `None` if other bins have light.
    #[inline(always)]
    pub fn detect(&self, profile: &ReturnProfile, detector: &DetectorSettings) -> Option<Option<Return>> {
        let (shape, light_speed) = (&detector.shape, detector.light_speed);
        let (nearest, farthest) = (*profile.ranges().first()?, *profile.ranges().last()?);
        let peak = shape.peak as f64;
        let start = nearest / light_speed - peak * shape.bin;
        let position = (farthest / light_speed - start) / shape.bin;
        // Rounding may put the nearest reflection to either side of the peak; it counts as the peak.
        if position >= peak + 1.0 {
            return None;
        }
        if detector.is_in_dead_zone(start) {
            return Some(None);
        }
        let mut intensity = 0.0;
        for i in profile.intensities() {
            intensity += i;
        }
        if !NORMAL_INTENSITIES.contains(&intensity) {
            return None;
        }
        let amplitude = self.top * intensity;
        let is_detected = amplitude >= self.threshold
            && self.min_neighbour.is_none_or(|min| min * intensity >= self.threshold);
        let range = light_speed * (peak * shape.bin + start);
        Some(is_detected.then_some(Return { range, amplitude, width: 0.0, is_noise: false }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::peak_detection::detect;
    use crate::pulse::testkit::{received, tls_detector};
    use proptest::prelude::*;
    use vlscan_trace::simd::portable::Portable;

    proptest! {
        #[test]
        fn the_fast_path_detects_the_same_echo(
            nearest in 2.0..3000.0f64,
            behind in prop::collection::vec((0.0..0.12f64, 1e-6..1.0f64), 0..30),
            length in prop::sample::select(vec![2.0, 4.0, 5.0, 7.3]),
            window in 0u64..12,
            threshold in prop::sample::select(vec![1e-5, 1e-3, 0.3]),
            weak_neighbours: bool,
        ) {
            let mut map = vec![(nearest, 1e-4)];
            map.extend(behind.iter().map(|(by, i)| (nearest + by, *i)));
            map.sort_by(|a, b| a.0.total_cmp(&b.0));
            map.dedup_by(|a, b| a.0 == b.0);
            let mut detector = tls_detector(length);
            detector.rule = PeakRule { window, threshold, weak_neighbours, ..detector.rule };
            let profile = ReturnProfile::of(&map);
            let fast = SingleBinDetector::new(&detector.shape, &detector.rule);
            let short = fast.and_then(|l| l.detect(&profile, &detector));
            if let Some(short) = short {
                let mut long = Vec::new();
                detect(Portable, &received(&map, &detector), (&detector, None), None, |_| true, &mut long);
                prop_assert_eq!(long, short.into_iter().collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn common_instruments_have_the_fast_path() {
        for length in [2.0, 4.0, 5.0] {
            let detector = tls_detector(length);
            let fast = SingleBinDetector::new(&detector.shape, &detector.rule).expect("one");
            let profile = ReturnProfile::of(&[(100.0, 1.0), (100.01, 1.0)]);
            assert!(fast.detect(&profile, &detector).flatten().is_some());
            let apart = ReturnProfile::of(&[(100.0, 1.0), (100.2, 1.0)]);
            assert!(fast.detect(&apart, &detector).is_none());
        }
    }
}
