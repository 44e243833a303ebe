//! The reflections of a pulse (spec pulse-physics §2).

use super::energy::Energy;
use super::lanes::{Block, LANES};
use vlscan_trace::Hits;

/// The reflections of a pulse in the order of its subrays, field by field.
#[derive(Clone, Debug, Default)]
pub(super) struct Reflections {
    /// Number of reflections; the fields are longer.
    count: usize,
    /// All reflections are at the entries of opaque triangles; `entry`, `ring` and `subray` are not filled
    /// in.
    is_opaque_only: bool,
    range: Vec<f64>,
    entry: Vec<f64>,
    intensity: Vec<f64>,
    cosine: Vec<f64>,
    primitive: Vec<u32>,
    ring: Vec<u32>,
    subray: Vec<u32>,
}

impl Reflections {
    /// Removes all reflections and reserves memory for `max` of them in whole blocks.
    pub fn clear(&mut self, max: usize) {
        self.count = 0;
        self.is_opaque_only = false;
        self.reserve(max);
    }

    fn reserve(&mut self, max: usize) {
        let max = max.next_multiple_of(LANES);
        if self.range.len() < max {
            for field in [&mut self.range, &mut self.entry, &mut self.intensity, &mut self.cosine] {
                field.resize(max, 0.0);
            }
            self.primitive.resize(max, Hits::MISS);
            self.ring.resize(max, 0);
            self.subray.resize(max, 0);
        }
    }

    /// Appends the reflection of a subray in a ring; [`Reflections::apply_energy`] turns its factor into an
    /// intensity.
    pub fn push(
        &mut self,
        (subray, ring): (u32, u32),
        (range, entry): (f64, f64),
        primitive: u32,
        cosine: f64,
        factor: f64,
    ) {
        let i = self.count;
        self.range[i] = range;
        self.entry[i] = entry;
        self.intensity[i] = factor;
        self.cosine[i] = cosine;
        self.primitive[i] = primitive;
        self.ring[i] = ring;
        self.subray[i] = subray;
        self.count += 1;
    }

    /// Appends a reflection of known intensity, after [`Reflections::apply_energy`]; may exceed the reserved
    /// memory.
    pub fn push_lit(&mut self, range: f64, primitive: u32, cosine: f64, intensity: f64) {
        if self.count == self.range.len() {
            self.reserve(2 * self.count + LANES);
        }
        self.push((0, 0), (range, range), primitive, cosine, intensity);
    }

    /// These reflections and others with known intensities, both in the order of their subrays.
    pub fn merged(&self, others: &Reflections) -> Reflections {
        let mut all = Reflections::default();
        all.clear(self.count + others.count);
        let (mut i, mut j) = (0, 0);
        while i < self.count || j < others.count {
            let is_own = j == others.count || (i < self.count && self.subray[i] <= others.subray[j]);
            let (from, at) = if is_own { (self, &mut i) } else { (others, &mut j) };
            let (range, source) = ((from.range[*at], from.entry[*at]), (from.subray[*at], from.ring[*at]));
            all.push(source, range, from.primitive[*at], from.cosine[*at], from.intensity[*at]);
            *at += 1;
        }
        all
    }

    /// Appends the reflections of the subrays of a block that are in `mask`; see
    /// [`Reflections::mark_opaque_only`].
    #[inline(always)]
    pub fn push_triangles(
        &mut self,
        mask: LaneMask,
        range: &Block,
        intensity: &Block,
        cosine: &Block,
        primitive: &[u32; LANES],
    ) {
        let first = self.count;
        self.count += mask.count();
        if mask.is_prefix() {
            // Lanes after the prefix are overwritten by the next reflections, or lie after the last.
            let row = first..first + LANES;
            self.range[row.clone()].copy_from_slice(range);
            self.intensity[row.clone()].copy_from_slice(intensity);
            self.cosine[row.clone()].copy_from_slice(cosine);
            self.primitive[row].copy_from_slice(primitive);
            return;
        }
        for (to, from) in (first..).zip(mask) {
            self.range[to] = range[from];
            self.intensity[to] = intensity[from];
            self.cosine[to] = cosine[from];
            self.primitive[to] = primitive[from];
        }
    }

    /// Turns reflectance factors into intensities; those at the positions in `cross_sections` follow from
    /// their cross-section.
    pub fn apply_energy(&mut self, energy: &Energy, cross_sections: &[(usize, f64)]) {
        let n = self.count;
        energy.apply(&self.ring[..n], &self.entry[..n], &mut self.intensity[..n]);
        for (i, sigma) in cross_sections {
            self.intensity[*i] = energy.of_cross_section(self.ring[*i], self.entry[*i], *sigma);
        }
    }

    /// Declares that all reflections come from [`Reflections::push_triangles`]: from the entries of opaque
    /// triangles.
    #[inline(always)]
    pub fn mark_opaque_only(&mut self) {
        self.is_opaque_only = true;
    }

    pub fn is_opaque_only(&self) -> bool {
        self.is_opaque_only
    }

    pub fn count(&self) -> usize {
        self.count
    }

    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Ranges of the reflecting points, m.
    pub fn ranges(&self) -> &[f64] {
        &self.range[..self.count]
    }

    /// Ranges at which the rays enter the primitives, m: echoes are attributed by these.
    pub fn entries(&self) -> &[f64] {
        if self.is_opaque_only { self.ranges() } else { &self.entry[..self.count] }
    }

    pub fn intensities(&self) -> &[f64] {
        &self.intensity[..self.count]
    }

    pub fn cosines(&self) -> &[f64] {
        &self.cosine[..self.count]
    }

    /// Indices of the subrays; `None` if every subray with a hit in range has its reflection, in order.
    pub fn subrays(&self) -> Option<&[u32]> {
        (!self.is_opaque_only).then(|| &self.subray[..self.count])
    }

    pub fn primitives(&self) -> &[u32] {
        &self.primitive[..self.count]
    }
}

/// A subset of the subrays of a block: a byte for each, 1 or 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct LaneMask(u64);

impl LaneMask {
    /// The subrays whose byte is 1.
    #[inline(always)]
    pub fn of(bytes: [u8; LANES]) -> LaneMask {
        LaneMask(u64::from_le_bytes(bytes))
    }

    #[inline(always)]
    pub fn first(self) -> Option<usize> {
        (self.0 != 0).then(|| self.0.trailing_zeros() as usize / 8)
    }

    /// The subrays of this mask that are not in `others`.
    #[inline(always)]
    pub fn without(self, others: LaneMask) -> LaneMask {
        LaneMask(self.0 & !others.0)
    }

    #[inline(always)]
    fn count(self) -> usize {
        self.0.count_ones() as usize
    }

    /// True if no subray before the last one is missing.
    #[inline(always)]
    fn is_prefix(self) -> bool {
        self.0 & ((self.0 << 8) | 1) == self.0
    }
}

impl Iterator for LaneMask {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let first = self.first()?;
        self.0 &= self.0 - 1;
        Some(first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_count_iterate_and_subtract() {
        let some = LaneMask::of([1, 1, 0, 1, 0, 0, 0, 1]);
        assert_eq!((some.count(), some.first(), some.is_prefix()), (4, Some(0), false));
        assert_eq!(some.collect::<Vec<_>>(), [0, 1, 3, 7]);
        let rest = some.without(LaneMask::of([1, 1, 0, 1, 1, 0, 0, 0]));
        assert_eq!((rest.count(), rest.first()), (1, Some(7)));
        for first in 0..=LANES {
            let which = LaneMask::of(std::array::from_fn(|i| u8::from(i < first)));
            assert!(which.is_prefix() && which.count() == first, "{first}");
        }
    }

    #[test]
    fn reflections_of_a_block_are_compacted() {
        let mut all = Reflections::default();
        all.clear(24);
        let (range, ones) = (std::array::from_fn(|i| i as f64), [1.0; LANES]);
        let primitive = std::array::from_fn(|i| i as u32);
        for which in [[1, 1, 1, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 1, 0, 0], [0; 8], [1; 8]] {
            all.push_triangles(LaneMask::of(which), &range, &ones, &ones, &primitive);
        }
        assert_eq!(all.primitives(), [0, 1, 2, 2, 5, 0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(all.ranges()[3..6], [2.0, 5.0, 0.0]);
    }
}
