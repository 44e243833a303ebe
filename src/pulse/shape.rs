//! The outgoing pulse, digitised (spec pulse-physics §4.1).

use crate::survey::WaveformSettings;
use libm::exp;

/// Samples of the pulse's power over time: a gamma-like curve `(t/τ)²·exp(−t/τ)` with τ = τp/7, cut at t = τp.
#[derive(Clone, Debug)]
pub(super) struct PulseShape {
    /// One sample per bin, from the start of the pulse.
    pub samples: Vec<f64>,
    /// Bin of the largest sample.
    pub peak: usize,
    /// Where the parabola through the peak and its neighbours has its top, in bins from `peak`.
    pub peak_offset: f64,
    /// Width of a bin, ns.
    pub bin: f64,
    /// Pulse length τp, ns.
    pub length: f64,
}

impl PulseShape {
    /// The shape of a pulse of `length` ns.
    pub fn new(length: f64, waveform: &WaveformSettings) -> PulseShape {
        let bin = waveform.bin;
        let tau = length / 7.0;
        let samples: Vec<f64> = (0..sample_count(length, bin))
            .map(|k| {
                let x = k as f64 * bin / tau;
                x * x * exp(-x)
            })
            .collect();
        let mut peak = 0;
        for (k, s) in samples.iter().enumerate() {
            if *s > samples[peak] {
                peak = k;
            }
        }
        let peak_offset = match samples.get(peak.wrapping_sub(1)..peak + 2) {
            Some(&[a, b, c]) => parabola_top(a, b, c),
            _ => 0.0,
        };
        PulseShape { samples, peak, peak_offset, bin, length }
    }
}

/// Number of samples of a pulse of `length` ns: the whole bins that fit.
pub(super) fn sample_count(length: f64, bin: f64) -> usize {
    (length / bin) as usize
}

/// Position of the extremum of the parabola through (−1, a), (0, b), (1, c); 0 when they lie on a line.
pub(super) fn parabola_top(a: f64, b: f64, c: f64) -> f64 {
    let bend = a - 2.0 * b + c;
    if bend < 0.0 { 0.5 * (a - c) / bend } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(length: f64, bin: f64) -> PulseShape {
        PulseShape::new(length, &WaveformSettings { bin, window: 1.0, quality: 1, max_range: 0.0 })
    }

    #[test]
    fn tables_of_the_worked_example() {
        // spec pulse-physics §4.12 (a)
        let table = [
            (4.0, 0.25, 16, 5, 0.536879652),
            (5.0, 0.25, 20, 6, 0.540032849),
            (5.0, 0.20, 25, 7, 0.541121710),
            (4.0, 0.50, 8, 2, 0.532182702),
            (2.0, 0.25, 8, 2, 0.532182702),
        ];
        for (length, bin, n, peak, top) in table {
            let s = shape(length, bin);
            assert_eq!((s.samples.len(), s.peak), (n, peak), "{length} ns in bins of {bin} ns");
            assert!((s.samples[peak] - top).abs() < 1e-9);
        }
        let expected = [
            0.0, 0.123581, 0.319160, 0.463647, 0.532183, 0.536880, 0.499155, 0.438657, 0.369918, 0.302278,
            0.240945, 0.188235, 0.144635, 0.109596, 0.082065, 0.060825,
        ];
        for (s, e) in shape(4.0, 0.25).samples.iter().zip(expected) {
            assert!((s - e).abs() < 5e-7, "{s} is not {e}");
        }
    }

    #[test]
    fn a_parabola_has_its_top_where_it_should() {
        let f = |x: f64| 3.0 - (x - 0.25) * (x - 0.25);
        assert!((parabola_top(f(-1.0), f(0.0), f(1.0)) - 0.25).abs() < 1e-15);
        assert_eq!(parabola_top(1.0, 2.0, 3.0), 0.0);
    }

    #[test]
    fn a_pulse_shorter_than_a_bin_has_no_samples() {
        assert!(shape(0.1, 0.25).samples.is_empty());
    }
}
