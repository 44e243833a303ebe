//! Turns reflections into returns: the receiver (spec pulse-physics §4).

use super::detector_settings::{DetectorSettings, Return};
use super::fit;
use super::peaks::Peaks;
use super::receiver::ReceiverModel;
use super::reflections::Reflections;
use super::waveform::Waveform;
use vlscan_trace::simd::Simd;

/// Minimum fitted width of an echo, ns; narrower echoes are dropped.
const MIN_ECHO_WIDTH: f64 = 0.1;

/// Appends the returns of `waveform` whose range `is_kept` accepts, nearest first, up to the detector's
/// maximum. Widths are fitted to `fitted`, if it is given: the waveform as the receiver puts it out.
#[inline(always)]
pub(super) fn detect<S: Simd>(
    simd: S,
    waveform: &Waveform,
    (detector, receiver): (&DetectorSettings, Option<&ReceiverModel>),
    fitted: Option<&Waveform>,
    is_kept: impl Fn(f64) -> bool,
    out: &mut Vec<Return>,
) {
    let corrections = &detector.corrections;
    let (shape, max_returns) = (&detector.shape, detector.max_returns as usize);
    for (bin, sample) in Peaks::of(simd, waveform, detector.rule) {
        let width = fitted.map_or(0.0, |fitted| {
            let width = match corrections.local_fit {
                true => fit::local_width(fitted, bin, shape.samples.len() as u64),
                false => fit::width(fitted, bin, sample),
            };
            width * shape.bin
        });
        if fitted.is_some() && width < MIN_ECHO_WIDTH && !corrections.keep_narrow_echoes {
            continue;
        }
        let (mut position, mut amplitude) = (bin as f64, sample);
        if corrections.fractional_bins {
            let before = bin.checked_sub(1).map_or(0.0, |bin| waveform.at(bin));
            let maximum = shape.maximum([before, sample, waveform.at(bin + 1)]);
            let calibrated = receiver.and_then(|r| r.offset(waveform, bin));
            position += calibrated.unwrap_or(maximum.offset);
            amplitude = maximum.amplitude;
        }
        let mut range = detector.light_speed * (position * shape.bin + waveform.start);
        if let Some(receiver) = receiver {
            range += receiver.walk(amplitude);
            amplitude = receiver.output(amplitude);
        }
        if !is_kept(range) {
            continue;
        }
        out.push(Return { range, amplitude, width, is_noise: false });
        if max_returns > 0 && out.len() >= max_returns {
            return;
        }
    }
}

/// Index of the reflection to which a return at `range` is attributed: the nearest by entry point, the first
/// of equally near ones (spec pulse-physics §4.7). NaN is attributed to the first.
#[inline(always)]
pub(super) fn attribute(reflections: &Reflections, range: f64) -> usize {
    // The bits of floats that are not negative are ordered like the floats.
    let off = |entry: &f64| (entry - range).abs().to_bits();
    let entries = reflections.entries();
    let mut min = u64::MAX;
    for entry in entries {
        min = min.min(off(entry));
    }
    entries.iter().position(|entry| off(entry) == min).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::testkit::{received, tls_detector};
    use proptest::prelude::*;
    use vlscan_survey::WaveformSettings;
    use vlscan_trace::simd::portable::Portable;
    use vlscan_trace::simd::{Level, dispatch};

    fn returns(of: &[(f64, f64)], detector: &DetectorSettings) -> Vec<Return> {
        let mut out = Vec::new();
        detect(Portable, &received(of, detector), (detector, None), None, |_| true, &mut out);
        out
    }

    fn reflections(of: &[(f64, f64)]) -> Reflections {
        let mut all = Reflections::default();
        all.clear(of.len());
        for (range, intensity) in of {
            all.push((0, 0), (*range, *range), 0, 1.0, *intensity);
        }
        all
    }

    #[test]
    fn two_reflections_merge_or_part_as_in_the_worked_example() {
        // spec pulse-physics §4.12 (d): (distance between them, bins, echoes as (bin, range, amplitude))
        type Echoes = &'static [(u64, f64, f64)];
        let table: [(f64, u64, Echoes); 7] = [
            (0.1, 18, &[(5, 100.0, 1.069062)]),
            (0.3, 21, &[(7, 100.149896, 0.902304)]),
            (0.5, 23, &[(10, 100.374741, 0.773128)]),
            (0.6, 25, &[(5, 100.0, 0.536880), (12, 100.524637, 0.676817)]),
            (0.8, 27, &[(5, 100.0, 0.536880), (14, 100.674533, 0.614248)]),
            (1.0, 30, &[(5, 100.0, 0.536880), (18, 100.974325, 0.536880)]),
            (2.0, 43, &[(5, 100.0, 0.536880), (31, 101.948651, 0.536880)]),
        ];
        let detector = tls_detector(4.0);
        for (s, bins, expected) in table {
            let waveform = received(&[(100.0, 1.0), (100.0 + s, 1.0)], &detector);
            assert_eq!(waveform.bins, bins, "s = {s}");
            let found: Vec<_> = Peaks::of(Portable, &waveform, detector.rule).map(|p| p.0).collect();
            assert_eq!(found, expected.iter().map(|e| e.0).collect::<Vec<_>>(), "s = {s}");
            for (r, e) in returns(&[(100.0, 1.0), (100.0 + s, 1.0)], &detector).iter().zip(expected) {
                assert!(
                    (r.range - e.1).abs() < 1e-6 && (r.amplitude - e.2).abs() < 1e-6,
                    "s = {s}: {r:?} is not {e:?}"
                );
            }
        }
    }

    #[test]
    fn a_merged_echo_belongs_to_the_surface_nearest_to_its_peak() {
        let both = reflections(&[(100.0, 1.0), (100.5, 1.0)]);
        assert_eq!(attribute(&both, 100.374741), 1);
        assert_eq!(attribute(&both, 100.25), 0);
        assert_eq!(attribute(&both, f64::NAN), 0);
    }

    #[test]
    fn a_map_of_three_reflections() {
        // spec pulse-physics §4.12 (e)
        let detector = tls_detector(4.0);
        let map = [(50.0, 2.0), (50.1, 1.0), (53.0, 0.5)];
        let waveform = received(&map, &detector);
        assert_eq!(waveform.bins, 57);
        assert!((waveform.start - 165.532047599).abs() < 1e-9);
        let found = returns(&map, &detector);
        assert_eq!(found.len(), 2);
        assert!((found[0].range - 50.0).abs() < 1e-9 && (found[0].amplitude - 1.605942006).abs() < 1e-9);
        assert!(
            (found[1].range - 52.997924580).abs() < 1e-9 && (found[1].amplitude - 0.268439826).abs() < 1e-9
        );
    }

    #[test]
    fn the_weakest_bin_of_the_window_must_reach_the_threshold() {
        // spec pulse-physics §4.12 (g)
        for (length, weakest) in [(5.0, 4.10970e-4), (4.0, 3.13322e-4)] {
            let mut detector = tls_detector(length);
            assert_eq!(returns(&[(100.0, weakest * 0.9999)], &detector).len(), 0);
            assert_eq!(returns(&[(100.0, weakest * 1.0001)], &detector).len(), 1);
            detector.rule.weak_neighbours = true;
            assert_eq!(returns(&[(100.0, weakest * 0.9)], &detector).len(), 1, "with the correction");
        }
    }

    #[test]
    fn a_window_of_one_bin_makes_every_bin_an_echo() {
        // spec pulse-physics §4.12 (j)
        let mut detector = tls_detector(4.0);
        let settings = WaveformSettings { bin: 1.0, window: 1.0, quality: 1, max_range: 0.0 };
        detector.shape = crate::pulse::shape::PulseShape::new(4.0, false, &settings);
        detector.rule.window = 1;
        let found = returns(&[(50.0, 1.0)], &detector);
        let expected = [(50.0, 0.5322), (50.2998, 0.3699), (50.5996, 0.1446)];
        assert_eq!(found.len(), expected.len());
        for (r, e) in found.iter().zip(expected) {
            assert!((r.range - e.0).abs() < 5e-5 && (r.amplitude - e.1).abs() < 5e-5, "{r:?} is not {e:?}");
        }
    }

    #[test]
    fn ranges_between_bins_are_exact_when_asked_for() {
        let mut detector = tls_detector(4.0);
        detector.corrections.fractional_bins = true;
        for i in 0..200 {
            let second = 103.0 + f64::from(i) * 1.7e-3;
            let found = returns(&[(100.0, 1.0), (second, 1.0)], &detector);
            assert_eq!(found.len(), 2);
            assert!((found[0].range - 100.0).abs() < 1e-9, "{}", found[0].range);
            assert!((found[1].range - second).abs() < 1e-3, "{} is not {second}", found[1].range);
        }
    }

    /// The procedure of the spec, transcribed literally, on an array of all bins.
    fn plain(map: &[(f64, f64)], detector: &DetectorSettings) -> (Vec<f64>, Vec<usize>) {
        let (shape, c, bin) = (&detector.shape, detector.light_speed, detector.shape.bin);
        let lead = shape.peak as f64 * bin;
        let (t0, t1) = (map[0].0 / c - lead, map[map.len() - 1].0 / c + shape.length - lead + bin);
        let n = ((t1 / bin).ceil() - (t0 / bin).ceil()) as usize;
        let mut f = vec![0.0; n];
        let mut i = 0;
        while i < map.len() {
            let start = |d: f64| (((d / c - t0) / bin) as i64 - shape.peak as i64).max(0) as usize;
            let (b, mut sum) = (start(map[i].0), 0.0);
            while i < map.len() && start(map[i].0) == b {
                sum += map[i].1;
                i += 1;
            }
            for (k, w) in shape.samples.iter().enumerate() {
                if b + k < n {
                    f[b + k] += w * sum;
                }
            }
        }
        let (w, least) = (detector.rule.window as i64, detector.rule.threshold);
        let peaks = (0..n as i64).filter(|&i| {
            let top = f[i as usize];
            let good = |j: i64| f[j as usize] >= least && f[j as usize] < top;
            top >= least && ((i - w).max(0) + 1..i).all(good) && (i + 1..(i + w).min(n as i64)).all(good)
        });
        let peaks = peaks.map(|i| i as usize).collect();
        (f, peaks)
    }

    proptest! {
        #[test]
        fn sparse_waveforms_are_the_plain_ones_bit_for_bit(
            mut map in prop::collection::vec((2.0..60.0f64, 1e-4..2.0f64), 1..24),
            far in prop::collection::vec((60.0..900.0f64, 1e-4..2.0f64), 0..4),
            window in 0u64..400,
            threshold in prop::sample::select(vec![1e-4, 1e-3, 1e-2]),
        ) {
            map.extend(far);
            map.sort_by(|a, b| a.0.total_cmp(&b.0));
            map.dedup_by(|a, b| a.0 == b.0);
            let mut detector = tls_detector(4.0);
            (detector.rule.window, detector.rule.threshold) = (window, threshold);
            let waveform = received(&map, &detector);
            let (f, peaks) = plain(&map, &detector);
            let mut all = Vec::new();
            waveform.append_to(&mut all, 0);
            prop_assert_eq!(all.len(), f.len());
            for (a, b) in all.iter().zip(&f) {
                prop_assert_eq!(a.to_bits(), b.to_bits());
            }
            for level in Level::available() {
                let found: Vec<usize> = dispatch!(level, simd => {
                    Peaks::of(simd, &waveform, detector.rule).map(|p| p.0 as usize).collect()
                });
                prop_assert_eq!(&found, &peaks);
            }
        }
    }

    #[test]
    fn gaps_between_reflections_need_no_memory() {
        let detector = tls_detector(4.0);
        let map = [(5.0, 1.0), (5e9, 1.0)];
        let waveform = received(&map, &detector);
        assert!(waveform.bins > 60_000_000_000);
        let stored: usize = waveform.segments().map(|s| s.1.len()).sum();
        assert!(stored < 100, "{stored} bins are stored");
        let found = returns(&map, &detector);
        assert_eq!(found.len(), 2);
        assert!((found[0].range - 5.0).abs() < 1e-9 && (found[1].range - 5e9).abs() < 0.1);
    }
}
