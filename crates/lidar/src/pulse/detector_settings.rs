//! Settings of the detection, and the returns that it finds.

use super::shape::PulseShape;
use vlscan_base::corrections::Corrections;

/// Conditions for a bin to be a peak.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PeakRule {
    pub threshold: f64,
    /// Bins compared on each side, plus one.
    pub window: u64,
    pub weak_neighbours: bool,
    /// Bin 0 is a neighbour like any other. The reference never compares it on the left, which makes no
    /// difference as long as it holds the dark start of a pulse.
    pub first_bin: bool,
}

impl PeakRule {
    /// True if a neighbour of amplitude `other` lets a bin of amplitude `top` be a peak. NaN, for which all
    /// comparisons are false, rules out no peak (spec pulse-physics trap 21).
    #[inline(always)]
    pub fn admits(&self, other: f64, top: f64) -> bool {
        !((!self.weak_neighbours && other < self.threshold) || other >= top)
    }
}

#[derive(Clone, Debug)]
pub(super) struct DetectorSettings {
    pub shape: PulseShape,
    pub rule: PeakRule,
    /// Maximum number of returns per pulse, 0 = unlimited.
    pub max_returns: u32,
    /// Minimum range R0, m.
    pub range_min: f64,
    /// Maximum range, m.
    pub range_max: f64,
    /// Maximum duration of a waveform, ns; 0 = unlimited.
    pub max_duration: f64,
    /// Metres of range per nanosecond of travel time.
    pub light_speed: f64,
    /// Samples lie on a grid of bins counted from the emission.
    pub digitiser_clock: bool,
    pub corrections: Corrections,
}

impl DetectorSettings {
    #[inline(always)]
    pub fn is_in_range(&self, range: f64) -> bool {
        range >= self.range_min && range <= self.range_max
    }

    /// Start of the waveform whose nearest light comes from `nearest` m: the travel time of bin 0, ns, and
    /// the bins from there to the start of the first pulse.
    #[inline(always)]
    pub fn waveform_start(&self, nearest: f64) -> (f64, f64) {
        let (shape, c, bin) = (&self.shape, self.light_speed, self.shape.bin);
        let begin = nearest / c - shape.lead(self.corrections.fractional_bins);
        if self.digitiser_clock {
            let start = (begin / bin).floor() * bin;
            (start, (begin - start) / bin)
        } else if self.corrections.fractional_bins {
            let (lead_bins, late) = shape.first_start();
            (nearest / c - lead_bins * bin, late)
        } else {
            (begin, 0.0)
        }
    }

    /// True if a waveform that starts at the travel time `start`, ns, is discarded: it starts within the
    /// minimum range. With the correction, detection uses the pulse from its start; only records begin at the
    /// minimum range.
    #[inline(always)]
    pub fn is_in_dead_zone(&self, start: f64) -> bool {
        self.range_min / self.light_speed > start && !self.corrections.clip_dead_zone
    }
}

/// A peak of the waveform that is accepted, before its surface is known; [`Echo`](super::Echo) is the record
/// that it becomes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Return {
    /// Range read from the waveform, m, without errors and noise.
    pub range: f64,
    pub amplitude: f64,
    /// Width of the fit, ns, or 0.
    pub width: f64,
    /// True if the return is caused by noise of the receiver alone.
    pub is_noise: bool,
}
