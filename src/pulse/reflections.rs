//! What the subrays of a pulse reflect (spec pulse-physics §2).

use super::energy::{Block, LANES};
use super::instrument::Instrument;
use crate::tree::Hits;

/// The reflections of a pulse in the order of its subrays, field by field.
#[derive(Clone, Debug, Default)]
pub(super) struct Reflections {
    /// How many there are; the fields are longer.
    count: usize,
    /// All of them where the rays entered, so that `entry` and `ring` are not filled in.
    is_plain: bool,
    range: Vec<f64>,
    entry: Vec<f64>,
    intensity: Vec<f64>,
    cosine: Vec<f64>,
    primitive: Vec<u32>,
    ring: Vec<u32>,
    subray: Vec<u32>,
}

impl Reflections {
    /// Forgets all of them and makes room for `most` in whole blocks.
    pub fn clear(&mut self, most: usize) {
        self.count = 0;
        self.is_plain = false;
        self.make_room(most);
    }

    fn make_room(&mut self, most: usize) {
        let most = most.next_multiple_of(LANES);
        if self.range.len() < most {
            for field in [&mut self.range, &mut self.entry, &mut self.intensity, &mut self.cosine] {
                field.resize(most, 0.0);
            }
            self.primitive.resize(most, Hits::MISS);
            self.ring.resize(most, 0);
            self.subray.resize(most, 0);
        }
    }

    /// Adds one of a subray in a ring; its reflectance factor becomes an intensity later.
    pub fn add(
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

    /// Adds one whose intensity is known, after [`Reflections::illuminate`]; makes room for it.
    pub fn add_lit(&mut self, range: f64, primitive: u32, cosine: f64, intensity: f64) {
        if self.count == self.range.len() {
            self.make_room(2 * self.count + LANES);
        }
        self.add((0, 0), (range, range), primitive, cosine, intensity);
    }

    /// Adds those of a block's subrays that `which` names; their entries and rings are not filled in.
    #[inline(always)]
    pub fn add_plain(
        &mut self,
        which: Lanes,
        range: &Block,
        intensity: &Block,
        cosine: &Block,
        primitive: &[u32; LANES],
    ) {
        let first = self.count;
        self.count += which.count();
        if which.are_first() {
            // The others are overwritten by what follows, or lie behind the last.
            let row = first..first + LANES;
            self.range[row.clone()].copy_from_slice(range);
            self.intensity[row.clone()].copy_from_slice(intensity);
            self.cosine[row.clone()].copy_from_slice(cosine);
            self.primitive[row].copy_from_slice(primitive);
            return;
        }
        for (to, from) in (first..).zip(which) {
            self.range[to] = range[from];
            self.intensity[to] = intensity[from];
            self.cosine[to] = cosine[from];
            self.primitive[to] = primitive[from];
        }
    }

    /// Turns factors into intensities, and gives those in `foliage` (position, cross-section) theirs.
    pub fn illuminate(&mut self, instrument: &Instrument, foliage: &[(usize, f64)]) {
        let n = self.count;
        instrument.energy.apply(&self.ring[..n], &self.entry[..n], &mut self.intensity[..n]);
        for (i, sigma) in foliage {
            self.intensity[*i] = instrument.energy.of_cross_section(self.ring[*i], self.entry[*i], *sigma);
        }
    }

    /// All of them are reflected where the rays entered.
    #[inline(always)]
    pub fn are_plain(&mut self) {
        self.is_plain = true;
    }

    /// Whether all of them are reflected where the rays entered opaque triangles.
    pub fn is_plain(&self) -> bool {
        self.is_plain
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Whether nothing was reflected.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Ranges of what sends light back, m.
    pub fn ranges(&self) -> &[f64] {
        &self.range[..self.count]
    }

    /// Ranges at which the rays entered the primitives, m: what attribution goes by.
    pub fn entries(&self) -> &[f64] {
        if self.is_plain { self.ranges() } else { &self.entry[..self.count] }
    }

    /// Received intensities.
    pub fn intensities(&self) -> &[f64] {
        &self.intensity[..self.count]
    }

    /// Cosines of the incidence angles.
    pub fn cosines(&self) -> &[f64] {
        &self.cosine[..self.count]
    }

    /// Numbers of the subrays; `None` if every subray that meets a triangle within the range has its reflection, in order.
    pub fn subrays(&self) -> Option<&[u32]> {
        (!self.is_plain).then(|| &self.subray[..self.count])
    }

    /// Numbers of the primitives.
    pub fn primitives(&self) -> &[u32] {
        &self.primitive[..self.count]
    }
}

/// Some subrays of a block: a byte of each is 1 or 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lanes(u64);

impl Lanes {
    /// Those that are 1.
    #[inline(always)]
    pub fn of(which: [u8; LANES]) -> Lanes {
        Lanes(u64::from_le_bytes(which))
    }

    /// The first of them.
    #[inline(always)]
    pub fn first(self) -> Option<usize> {
        (self.0 != 0).then(|| self.0.trailing_zeros() as usize / 8)
    }

    /// The others among them.
    #[inline(always)]
    pub fn without(self, others: Lanes) -> Lanes {
        Lanes(self.0 & !others.0)
    }

    #[inline(always)]
    fn count(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Whether none is missing before the last of them.
    #[inline(always)]
    fn are_first(self) -> bool {
        self.0 & ((self.0 << 8) | 1) == self.0
    }
}

impl Iterator for Lanes {
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
    fn lanes_are_counted_and_told_apart() {
        let some = Lanes::of([1, 1, 0, 1, 0, 0, 0, 1]);
        assert_eq!((some.count(), some.first(), some.are_first()), (4, Some(0), false));
        assert_eq!(some.collect::<Vec<_>>(), [0, 1, 3, 7]);
        let rest = some.without(Lanes::of([1, 1, 0, 1, 1, 0, 0, 0]));
        assert_eq!((rest.count(), rest.first()), (1, Some(7)));
        for first in 0..=LANES {
            let which = Lanes::of(std::array::from_fn(|i| u8::from(i < first)));
            assert!(which.are_first() && which.count() == first, "{first}");
        }
    }

    #[test]
    fn subrays_that_see_something_close_ranks() {
        let mut all = Reflections::default();
        all.clear(24);
        let (range, ones) = (std::array::from_fn(|i| i as f64), [1.0; LANES]);
        let primitive = std::array::from_fn(|i| i as u32);
        for which in [[1, 1, 1, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 1, 0, 0], [0; 8], [1; 8]] {
            all.add_plain(Lanes::of(which), &range, &ones, &ones, &primitive);
        }
        assert_eq!(all.primitives(), [0, 1, 2, 2, 5, 0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(all.ranges()[3..6], [2.0, 5.0, 0.0]);
    }
}
