//! Which bins of a waveform are echoes (spec pulse-physics §4.4).

use super::waveform::Waveform;

/// What makes a bin a peak.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PeakRule {
    /// Least amplitude.
    pub threshold: f64,
    /// Bins compared on each side, plus one.
    pub window: u64,
    /// Neighbours may lie below the threshold.
    pub weak_neighbours: bool,
    /// Bin 0 is a neighbour like any other. For the reference it is nobody's left neighbour, which does no harm as long
    /// as it holds the dark start of a pulse.
    pub first_bin: bool,
}

impl PeakRule {
    /// Whether a neighbour of amplitude `other` lets a bin of amplitude `top` be a peak. Written so that NaN, which
    /// compares with nothing, stands in no peak's way (trap 21).
    fn admits(&self, other: f64, top: f64) -> bool {
        !((!self.weak_neighbours && other < self.threshold) || other >= top)
    }
}

/// The peaks of a waveform in ascending time, as (bin, amplitude). Bins that are not stored are never peaks: they got no
/// light.
pub(super) struct Peaks<'a> {
    waveform: &'a Waveform,
    rule: PeakRule,
    segment: usize,
    offset: usize,
}

impl<'a> Peaks<'a> {
    /// The peaks of `waveform` under `rule`.
    pub fn of(waveform: &'a Waveform, rule: PeakRule) -> Peaks<'a> {
        Peaks { waveform, rule, segment: 0, offset: 0 }
    }

    /// Whether the very next neighbours of bin `i` = `bins[offset]` forbid a peak, as they mostly do.
    fn is_on_a_slope(&self, bins: &[f64], offset: usize, i: u64) -> bool {
        let top = bins[offset];
        let forbids = |other: &f64| !self.rule.admits(*other, top);
        self.rule.window >= 2
            && (bins.get(offset + 1).is_some_and(forbids)
                || (i > self.first_neighbour() && offset >= 1 && forbids(&bins[offset - 1])))
    }

    /// Whether stored bin `i` of amplitude `top` is higher than its neighbours.
    fn stands_out(&self, i: u64, top: f64) -> bool {
        let reach = self.rule.window;
        let left = (i + 1).saturating_sub(reach).max(self.first_neighbour())..i;
        let right = i + 1..i.saturating_add(reach).min(self.waveform.bins);
        self.all_admit(right, top) && self.all_admit(left, top)
    }

    /// The first bin that may be a left neighbour.
    fn first_neighbour(&self) -> u64 {
        u64::from(!self.rule.first_bin)
    }

    fn all_admit(&self, range: std::ops::Range<u64>, top: f64) -> bool {
        if range.start >= range.end {
            return true;
        }
        let mut seen = 0;
        for (first, bins) in self.waveform.segments() {
            let from = range.start.clamp(first, first + bins.len() as u64);
            let to = range.end.clamp(from, first + bins.len() as u64);
            seen += to - from;
            let part = &bins[(from - first) as usize..(to - first) as usize];
            if !part.iter().all(|other| self.rule.admits(*other, top)) {
                return false;
            }
        }
        seen == range.end - range.start || self.rule.admits(0.0, top)
    }
}

impl Iterator for Peaks<'_> {
    type Item = (u64, f64);

    fn next(&mut self) -> Option<(u64, f64)> {
        while self.segment < self.waveform.segment_count() {
            let (first, bins) = self.waveform.segment(self.segment);
            while let Some(&top) = bins.get(self.offset) {
                let (i, offset) = (first + self.offset as u64, self.offset);
                self.offset += 1;
                let dark = top < self.rule.threshold;
                if !dark && !self.is_on_a_slope(bins, offset, i) && self.stands_out(i, top) {
                    return Some((i, top));
                }
            }
            self.segment += 1;
            self.offset = 0;
        }
        None
    }
}
