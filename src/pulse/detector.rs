//! What the detection reads of an instrument, and what it finds.

use super::options::Corrections;
use super::shape::PulseShape;

/// What makes a bin a peak.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PeakRule {
    /// Minimum amplitude.
    pub threshold: f64,
    /// Bins compared on each side, plus one.
    pub window: u64,
    /// Neighbours may lie below the threshold.
    pub weak_neighbours: bool,
    /// Bin 0 is a neighbour like any other. The reference never compares it on the left, which makes no difference as long
    /// as it holds the dark start of a pulse.
    pub first_bin: bool,
}

impl PeakRule {
    /// Whether a neighbour of amplitude `other` lets a bin of amplitude `top` be a peak. NaN, for which all comparisons
    /// are false, rules out no peak (spec pulse-physics trap 21).
    #[inline(always)]
    pub fn admits(&self, other: f64, top: f64) -> bool {
        !((!self.weak_neighbours && other < self.threshold) || other >= top)
    }
}

/// Settings of a device's detector.
#[derive(Clone, Debug)]
pub(super) struct DetectorSettings {
    /// Outgoing pulse.
    pub shape: PulseShape,
    pub rule: PeakRule,
    /// Most returns per pulse, 0 = unlimited.
    pub max_returns: u32,
    /// Nearest range R0, m.
    pub range_min: f64,
    /// Farthest range, m.
    pub range_max: f64,
    /// Longest waveform, ns; 0 = unlimited.
    pub max_duration: f64,
    /// Metres of range per nanosecond of travel time.
    pub light_speed: f64,
    /// Samples lie on a grid of bins counted from the emission.
    pub digitiser_clock: bool,
    pub corrections: Corrections,
}

impl DetectorSettings {
    /// Whether a range lies between the nearest and the farthest one.
    #[inline(always)]
    pub fn is_in_range(&self, range: f64) -> bool {
        range >= self.range_min && range <= self.range_max
    }
}

/// A peak that counts as an echo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Return {
    /// Range by the waveform, m: without errors and noise.
    pub range: f64,
    /// Amplitude of the peak.
    pub amplitude: f64,
    /// Width of the fit, ns, or 0.
    pub width: f64,
    /// Whether noise of the receiver alone caused it.
    pub is_noise: bool,
}
