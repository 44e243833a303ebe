//! Finds the bins of a waveform that are echoes (spec pulse-physics §4.4).

use super::detector_settings::PeakRule;
use super::lanes::LANES;
use super::waveform::Waveform;
use vlscan_trace::simd::{F64Ops, MaskOps, Simd, each_of};

/// Mask of the eight bins that may be peaks, judging by their direct neighbours: bit `i` belongs to
/// `around[i + 1]`.
#[inline(always)]
fn candidates<S: Simd>(simd: S, around: &[f64; LANES + 2], rule: &PeakRule) -> u8 {
    let [before, top, after] = each_of!([0, 1, 2], i => {
        simd.load_f64(around[i..i + LANES].as_array().expect("eight bins and their neighbours"))
    });
    let threshold = simd.splat_f64(rule.threshold);
    let higher = top.le(before) | top.le(after);
    let mut below = top.lt(threshold);
    if !rule.weak_neighbours {
        below = below | before.lt(threshold) | after.lt(threshold);
    }
    !(higher | below).bits() as u8
}

/// The peaks of a waveform in ascending time, as (bin, amplitude). Bins that are not stored are never peaks:
/// they received no light.
pub(super) struct Peaks<'a, S: Simd> {
    simd: S,
    waveform: &'a Waveform,
    rule: PeakRule,
    segment: usize,
    offset: usize,
}

impl<'a, S: Simd> Peaks<'a, S> {
    pub fn of(simd: S, waveform: &'a Waveform, rule: PeakRule) -> Peaks<'a, S> {
        Peaks { simd, waveform, rule, segment: 0, offset: 0 }
    }

    /// True if a direct neighbour of bin `i` = `bins[offset]` rules out a peak, which is the usual case.
    fn is_ruled_out(&self, bins: &[f64], offset: usize, i: u64) -> bool {
        let top = bins[offset];
        let rules_out = |other: &f64| !self.rule.admits(*other, top);
        self.rule.window >= 2
            && (bins.get(offset + 1).is_some_and(rules_out)
                || (i > self.first_neighbour() && offset >= 1 && rules_out(&bins[offset - 1])))
    }

    /// Skips bins below the threshold or ruled out by a direct neighbour, eight at a time, as far as both
    /// neighbours are stored.
    #[inline(always)]
    fn skip_ruled_out(&mut self, bins: &[f64]) {
        if self.rule.window < 2 {
            return;
        }
        while self.offset >= 2
            && let Some(around) = bins.get(self.offset - 1..self.offset + LANES + 1)
        {
            let found = candidates(self.simd, around.as_array().expect("as many as asked for"), &self.rule);
            self.offset += found.trailing_zeros().min(LANES as u32) as usize;
            if found != 0 {
                break;
            }
        }
    }

    /// True if stored bin `i` of amplitude `top` is higher than its neighbours.
    fn is_highest(&self, i: u64, top: f64) -> bool {
        let reach = self.rule.window;
        let left = (i + 1).saturating_sub(reach).max(self.first_neighbour())..i;
        let right = i + 1..i.saturating_add(reach).min(self.waveform.bins);
        self.all_admit(right, top) && self.all_admit(left, top)
    }

    /// The first bin that may be a left neighbour.
    fn first_neighbour(&self) -> u64 {
        u64::from(!self.rule.first_bin)
    }

    #[inline(always)]
    fn all_admit(&self, range: std::ops::Range<u64>, top: f64) -> bool {
        if range.start >= range.end {
            return true;
        }
        let (first, bins) = self.waveform.segment(self.segment);
        if let (Some(from), Some(to)) = (range.start.checked_sub(first), range.end.checked_sub(first))
            && let Some(part) = bins.get(from as usize..to as usize)
        {
            return part.iter().all(|other| self.rule.admits(*other, top));
        }
        self.all_admit_across(range, top)
    }

    /// [`Peaks::all_admit`] for bins in any segments and between them.
    #[inline(never)]
    fn all_admit_across(&self, range: std::ops::Range<u64>, top: f64) -> bool {
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

impl<S: Simd> Iterator for Peaks<'_, S> {
    type Item = (u64, f64);

    #[inline(always)]
    fn next(&mut self) -> Option<(u64, f64)> {
        while self.segment < self.waveform.segment_count() {
            let (first, bins) = self.waveform.segment(self.segment);
            loop {
                if S::HAS_WIDE_REGISTERS {
                    self.skip_ruled_out(bins);
                }
                let Some(&top) = bins.get(self.offset) else { break };
                let (i, offset) = (first + self.offset as u64, self.offset);
                self.offset += 1;
                let is_below = top < self.rule.threshold;
                if !is_below && !self.is_ruled_out(bins, offset, i) && self.is_highest(i, top) {
                    return Some((i, top));
                }
            }
            self.segment += 1;
            self.offset = 0;
        }
        None
    }
}
