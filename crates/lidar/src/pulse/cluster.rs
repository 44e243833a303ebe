//! Fast path where ranges are read between bins: no waveform, only the samples around the light.
//!
//! Reflections whose pulses overlap form a cluster. Most clusters are so shallow that their sum has a single
//! peak: only the samples around it are computed, for other clusters all samples. They equal those of
//! [`super::waveform::Waveform`] bit for bit.

use super::detector_settings::{DetectorSettings, PeakRule, Return};
use super::pulse_starts::PulseStarts;
use super::return_profile::ReturnProfile;
use super::shape::PulseShape;

/// Criteria by which reflections form clusters.
#[derive(Clone, Debug)]
pub(super) struct ClusterRule {
    /// Maximum distance between the first and the last start of a pulse with which there is a single peak,
    /// bins.
    reach: i64,
    /// Minimum distance between the starts of pulses of different clusters, bins.
    gap: i64,
    threshold: f64,
    window: usize,
}

/// Maximum of [`ClusterRule::reach`], bins.
const MAX_REACH: i64 = 6;
/// Windows of this length and longer have no fast path, bins.
const MAX_WINDOW: u64 = 1 << 16;

impl ClusterRule {
    /// `None` if neighbours of peaks must reach the threshold, or if bins are too wide for the pulse to have
    /// a peak.
    pub fn new(shape: &PulseShape, rule: &PeakRule) -> Option<ClusterRule> {
        let is_simple = rule.weak_neighbours
            && rule.first_bin
            && (2..MAX_WINDOW).contains(&rule.window)
            && rule.threshold > 0.0
            && shape.peak >= 1
            && shape.peak + 2 < shape.samples.len();
        is_simple.then(|| ClusterRule {
            // The last pulse may start almost a bin later than its bin; in wide bins even two pulses in one
            // bin may part.
            reach: (shape.concave_reach() as i64 - 1).min(MAX_REACH),
            gap: shape.samples.len() as i64 + rule.window as i64,
            threshold: rule.threshold,
            window: rule.window as usize,
        })
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct ClusterDetector {
    starts: PulseStarts,
    samples: Vec<f64>,
}

/// A sample that is higher than its neighbours, with its direct neighbours.
struct SampledPeak {
    bin: i64,
    before: f64,
    top: f64,
    after: f64,
}

impl ClusterDetector {
    /// Appends the returns of `profile` whose range `is_kept` accepts, nearest first, up to the detector's
    /// maximum. Returns `false`, and appends nothing, if an intensity is not finite.
    #[inline(always)]
    pub fn detect(
        &mut self,
        rule: &ClusterRule,
        profile: &ReturnProfile,
        detector: &DetectorSettings,
        is_kept: impl Fn(f64) -> bool,
        out: &mut Vec<Return>,
    ) -> bool {
        let (shape, c) = (&detector.shape, detector.light_speed);
        let Some(nearest) = profile.ranges().first() else { return true };
        if !profile.intensities().iter().sum::<f64>().is_finite() {
            return false;
        }
        let (lead_bins, late) = shape.first_start();
        let start = nearest / c - lead_bins * shape.bin;
        self.starts.compute(profile, detector, late);
        let count = profile.ranges().len();
        let max_returns = if detector.max_returns > 0 { detector.max_returns as usize } else { usize::MAX };
        let mut report = |t: SampledPeak| {
            let maximum = shape.maximum([t.before, t.top, t.after]);
            let range = c * ((t.bin as f64 + maximum.offset) * shape.bin + start);
            if is_kept(range) && out.len() < max_returns {
                out.push(Return { range, amplitude: maximum.amplitude, width: 0.0, is_noise: false });
            }
        };
        let mut i = 0;
        while i < count {
            let (first, mut end) = (self.starts.bin(i), i + 1);
            let mut last = first;
            while end < count && self.starts.bin(end) - last < rule.gap {
                last = self.starts.bin(end);
                end += 1;
            }
            if last - first <= rule.reach {
                self.single_peak(rule, shape, profile.intensities(), i..end)
                    .into_iter()
                    .for_each(&mut report);
            } else {
                self.peaks(rule, shape, profile.intensities(), i..end, &mut report);
            }
            i = end;
        }
        true
    }

    /// The single peak of a shallow cluster.
    #[inline(always)]
    fn single_peak(
        &self,
        rule: &ClusterRule,
        shape: &PulseShape,
        intensities: &[f64],
        cluster: std::ops::Range<usize>,
    ) -> Option<SampledPeak> {
        // From the bin before the peak of the first pulse to the second one after the peak of the last.
        let mut samples = [0.0; MAX_REACH as usize + 4];
        let first = self.starts.bin(cluster.start);
        let mut i = cluster.start;
        let len = ((self.starts.bin(cluster.end - 1) - first) as usize + 4).min(samples.len());
        while i < cluster.end {
            let by = (self.starts.bin(i) - first) as usize;
            let (next, factors) = self.starts.sum_of_bin(i, cluster.end, intensities);
            for (j, sample) in samples[..len].iter_mut().enumerate() {
                // Before the start of the pulse this wraps around to an index that no sample has.
                let k = (shape.peak - 1 + j).wrapping_sub(by);
                if k < shape.samples.len() {
                    *sample += shape.late_sample(k, &factors);
                }
            }
            i = next;
        }
        let mut at = 1;
        while at + 2 < len && samples[at + 1] > samples[at] {
            at += 1;
        }
        (samples[at] >= rule.threshold).then(|| SampledPeak {
            bin: first + (shape.peak - 1 + at) as i64,
            before: samples[at - 1],
            top: samples[at],
            after: samples[at + 1],
        })
    }

    #[inline(always)]
    fn peaks(
        &mut self,
        rule: &ClusterRule,
        shape: &PulseShape,
        intensities: &[f64],
        cluster: std::ops::Range<usize>,
        report: &mut impl FnMut(SampledPeak),
    ) {
        let n = shape.samples.len();
        let first = self.starts.bin(cluster.start);
        let depth = (self.starts.bin(cluster.end - 1) - first) as usize;
        self.samples.clear();
        // One more, without light, after the last pulse.
        self.samples.resize(depth + n + 1, 0.0);
        let mut i = cluster.start;
        while i < cluster.end {
            let by = (self.starts.bin(i) - first) as usize;
            let (next, factors) = self.starts.sum_of_bin(i, cluster.end, intensities);
            shape.add_late(&factors, &mut self.samples[by..by + n]);
            i = next;
        }
        let samples = self.samples.as_slice();
        for at in 1..samples.len() - 1 {
            let (before, top, after) = (samples[at - 1], samples[at], samples[at + 1]);
            if !(top > before && top > after && top >= rule.threshold) {
                continue;
            }
            let around = at.saturating_sub(rule.window - 1)..(at + rule.window).min(samples.len());
            let is_highest = samples[around.start..at].iter().all(|s| *s < top)
                && samples[at + 1..around.end].iter().all(|s| *s < top);
            if is_highest {
                report(SampledPeak { bin: first + at as i64, before, top, after });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::peak_detection::detect;
    use crate::pulse::testkit::{received, tls_detector};
    use proptest::prelude::*;
    use vlscan_base::corrections::Corrections;
    use vlscan_trace::simd::portable::Portable;

    /// An instrument that reads between bins.
    fn detector(length: f64, threshold: f64, window: u64) -> DetectorSettings {
        let mut detector = tls_detector(length);
        detector.corrections =
            Corrections { fractional_bins: true, clip_dead_zone: true, ..detector.corrections };
        detector.rule = PeakRule { threshold, weak_neighbours: true, first_bin: true, window };
        detector
    }

    proptest! {
        #[test]
        fn clusters_have_the_peaks_of_the_waveform(
            nearest in 2.0..3000.0f64,
            near in prop::collection::vec((0.0..0.3f64, 1e-6..1.0f64), 0..20),
            behind in prop::collection::vec((0.0..30.0f64, 1e-6..1.0f64), 0..20),
            length in prop::sample::select(vec![2.0, 4.0, 5.0, 7.3]),
            threshold in prop::sample::select(vec![1e-5, 1e-3, 0.3]),
            window in 2u64..9,
            is_symmetric in any::<bool>(),
        ) {
            let mut map = vec![(nearest, 1e-4)];
            map.extend(near.iter().chain(&behind).map(|(by, i)| (nearest + by, *i)));
            map.sort_by(|a, b| a.0.total_cmp(&b.0));
            map.dedup_by(|a, b| a.0 == b.0);
            let mut detector = detector(length, threshold, window);
            if is_symmetric {
                detector.shape = PulseShape::raised_cosine(length, detector.shape.bin);
            }
            let rule = ClusterRule::new(&detector.shape, &detector.rule).expect("a fast path");
            let (mut found, mut all) = (Vec::new(), Vec::new());
            prop_assert!(ClusterDetector::default().detect(&rule, &ReturnProfile::of(&map), &detector, |_| true, &mut found));
            detect(Portable, &received(&map, &detector), (&detector, None), None, |_| true, &mut all);
            prop_assert_eq!(all, found);
        }
    }

    #[test]
    fn no_more_returns_than_the_instrument_reports() {
        let mut detector = detector(4.0, 1e-9, 4);
        detector.max_returns = 2;
        let rule = ClusterRule::new(&detector.shape, &detector.rule).expect("a fast path");
        let mut found = Vec::new();
        let profile = ReturnProfile::of(&[(100.0, 1.0), (110.0, 1.0), (120.0, 1.0)]);
        assert!(ClusterDetector::default().detect(&rule, &profile, &detector, |r| r > 105.0, &mut found));
        let ranges: Vec<f64> = found.iter().map(|r| r.range.round()).collect();
        assert_eq!(ranges, [110.0, 120.0]);
    }
}
