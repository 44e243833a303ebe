//! Reflected light by range (spec pulse-physics §4.2).

use super::lanes::{Block, LANES};
use super::reflections::Reflections;
use vlscan_trace::simd::Simd;

/// The reflections of a pulse by strictly ascending range.
#[derive(Clone, Debug, Default)]
pub(super) struct ReturnProfile {
    len: usize,
    /// Padded to whole blocks with arbitrary numbers.
    range: Vec<Block>,
    intensity: Vec<f64>,
    keys: Vec<(u64, u32)>,
}

/// Maximum number of reflections that are sorted by counting.
const MAX_RANKED: usize = 32;

impl ReturnProfile {
    /// Replaces the light by that of `reflections`, sorted. Of reflections at exactly the same range only the
    /// first counts, or their sum if `sum` is set (spec pulse-physics trap 2).
    #[inline(always)]
    pub fn sort_by_range<S: Simd>(&mut self, simd: S, reflections: &Reflections, sum: bool) {
        let (ranges, intensities) = (reflections.ranges(), reflections.intensities());
        self.reserve(ranges.len());
        let is_short = S::HAS_WIDE_REGISTERS && ranges.len() <= MAX_RANKED;
        if is_short && self.sort_by_counting(simd, ranges, intensities) {
            return;
        }
        self.sort_by_keys(ranges, intensities, sum);
    }

    fn reserve(&mut self, max: usize) {
        if self.intensity.len() < max {
            self.range.resize(max.div_ceil(LANES), [1.0; LANES]);
            self.intensity.resize(self.range.len() * LANES, 0.0);
        }
    }

    /// Sorts by counting how many ranges are smaller than each, without branches on ranges. `false` if some
    /// are equal.
    #[inline(always)]
    fn sort_by_counting<S: Simd>(&mut self, simd: S, ranges: &[f64], intensities: &[f64]) -> bool {
        let n = ranges.len();
        let mut keys = [[f64::INFINITY; LANES]; MAX_RANKED / LANES];
        keys.as_flattened_mut()[..n].copy_from_slice(ranges);
        let mut ranks = [[0; LANES]; MAX_RANKED / LANES];
        if n <= 24 {
            let first = keys.first_chunk::<3>().expect("there are four blocks");
            ranks[..3].copy_from_slice(&simd.count_smaller(ranges, first));
        } else {
            ranks = simd.count_smaller(ranges, &keys);
        }
        let ranks = ranks.as_flattened();
        let mut sum = 0;
        let out = self.range.as_flattened_mut();
        for i in 0..n {
            let rank = ranks[i] as usize % MAX_RANKED;
            sum += rank;
            out[rank] = ranges[i];
            self.intensity[rank] = intensities[i];
        }
        self.len = n;
        // Equal ranges have equal ranks, so that the sum of all is smaller.
        sum * 2 == n * n.saturating_sub(1)
    }

    #[inline(never)]
    fn sort_by_keys(&mut self, ranges: &[f64], intensities: &[f64], sum: bool) {
        let ReturnProfile { len, range, intensity, keys } = self;
        keys.clear();
        // The bits of non-negative floats are ordered like the floats.
        keys.extend(ranges.iter().zip(0..).map(|(r, i)| (r.to_bits(), i)));
        keys.sort_unstable();
        let range = range.as_flattened_mut();
        *len = 0;
        let mut last = None;
        for (bits, i) in keys.iter() {
            let of_this = intensities[*i as usize];
            if last != Some(*bits) {
                (range[*len], intensity[*len]) = (f64::from_bits(*bits), of_this);
                *len += 1;
                last = Some(*bits);
            } else if sum {
                intensity[*len - 1] += of_this;
            }
        }
    }

    /// Ranges, m, strictly ascending.
    #[inline(always)]
    pub fn ranges(&self) -> &[f64] {
        &self.range.as_flattened()[..self.len]
    }

    /// Ranges in blocks, the last of which is padded.
    #[inline(always)]
    pub fn blocks(&self) -> &[Block] {
        &self.range[..self.len.div_ceil(LANES)]
    }

    #[inline(always)]
    pub fn intensities(&self) -> &[f64] {
        &self.intensity[..self.len]
    }

    /// Replaces the light by (range, intensity) pairs, ascending.
    pub fn set(&mut self, pairs: &[(f64, f64)]) {
        self.reserve(pairs.len());
        self.len = pairs.len();
        for (i, (range, intensity)) in pairs.iter().enumerate() {
            (self.range.as_flattened_mut()[i], self.intensity[i]) = (*range, *intensity);
        }
    }

    /// Adds light by (range, intensity) pairs, ascending.
    #[inline(never)]
    pub fn add(&mut self, others: &[(f64, f64)]) {
        let own = self.ranges().iter().copied().zip(self.intensities().iter().copied());
        let mut all: Vec<(f64, f64)> = own.chain(others.iter().copied()).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Ranges ascend strictly.
        all.dedup_by(|next, kept| {
            let is_equal = next.0 == kept.0;
            if is_equal {
                kept.1 += next.1;
            }
            is_equal
        });
        self.set(&all);
    }

    /// The profile of (range, intensity) pairs, ascending.
    #[cfg(test)]
    pub fn of(pairs: &[(f64, f64)]) -> ReturnProfile {
        let mut profile = ReturnProfile::default();
        profile.set(pairs);
        profile
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vlscan_trace::simd::portable::Portable;
    use vlscan_trace::simd::{Level, dispatch};

    fn sorted(of: &[(f64, f64)], sum: bool) -> [Vec<(f64, f64)>; 2] {
        let mut reflections = Reflections::default();
        reflections.clear(of.len());
        for (range, intensity) in of {
            reflections.push((0, 0), (*range, *range), 0, 1.0, *intensity);
        }
        let pairs =
            |l: &ReturnProfile| l.ranges().iter().copied().zip(l.intensities().iter().copied()).collect();
        let mut profile = ReturnProfile::default();
        profile.sort_by_range(Portable, &reflections, sum);
        let slow = pairs(&profile);
        dispatch!(Level::best(), simd => profile.sort_by_range(simd, &reflections, sum));
        [slow, pairs(&profile)]
    }

    #[test]
    fn added_light_is_sorted_into_the_profile() {
        let mut profile = ReturnProfile::of(&[(1.0, 7.0), (3.0, 1.0)]);
        profile.add(&[(0.5, 2.0), (3.0, 10.0), (3.0, 100.0), (4.0, 1.0)]);
        let pairs: Vec<(f64, f64)> =
            profile.ranges().iter().copied().zip(profile.intensities().iter().copied()).collect();
        assert_eq!(pairs, [(0.5, 2.0), (1.0, 7.0), (3.0, 111.0), (4.0, 1.0)]);
    }

    #[test]
    fn the_first_of_equal_ranges_counts_or_all_of_them() {
        let of = [(3.0, 1.0), (2.0, 5.0), (3.0, 10.0), (1.0, 7.0), (3.0, 100.0)];
        assert_eq!(sorted(&of, false), [[(1.0, 7.0), (2.0, 5.0), (3.0, 1.0)]; 2]);
        assert_eq!(sorted(&of, true), [[(1.0, 7.0), (2.0, 5.0), (3.0, 111.0)]; 2]);
        assert_eq!(sorted(&[], false), [[]; 2]);
    }

    proptest! {
        #[test]
        fn counting_orders_like_sorting(of in prop::collection::vec((0u32..200, 0.0..1.0f64), 0..40), sum: bool) {
            let of: Vec<(f64, f64)> = of.into_iter().map(|(r, i)| (100.0 + f64::from(r) * 0.01, i)).collect();
            let [slow, fast] = sorted(&of, sum);
            prop_assert_eq!(slow.len(), fast.len());
            for (a, b) in slow.iter().zip(&fast) {
                prop_assert_eq!((a.0.to_bits(), a.1.to_bits()), (b.0.to_bits(), b.1.to_bits()));
            }
            prop_assert!(slow.is_sorted_by(|a, b| a.0 < b.0));
        }
    }
}
