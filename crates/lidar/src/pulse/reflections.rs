//! The reflections of a pulse (spec pulse-physics §2).

use super::echo::{EchoPath, PathKind};
use super::energy::Energy;
use super::lanes::{Block, LANES};
use super::water::WaterPlane;
use vlscan_geom::DVec3;
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
    /// Ends of the paths of the last reflections, unless these are [`PathKind::Direct`].
    ends: Vec<PathEnd>,
}

/// End of a path of light over mirrors, through panes, or into water or air.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PathEnd {
    /// The point that reflects the light, m.
    pub surface: DVec3,
    /// Direction in which the light arrives there.
    pub direction: DVec3,
    pub path: EchoPath,
    /// The surface of the water that the light enters.
    pub plane: Option<WaterPlane>,
}

impl Reflections {
    /// Removes all reflections and reserves memory for `max` of them in whole blocks.
    pub fn clear(&mut self, max: usize) {
        self.count = 0;
        self.is_opaque_only = false;
        self.ends.clear();
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

    /// Appends the reflection of a subray at the end of a path, after all of direct paths: `range` is the
    /// optical length of the path. May exceed the reserved memory.
    pub fn push_end(
        &mut self,
        source: (u32, u32),
        end: PathEnd,
        range: f64,
        (primitive, cosine): (u32, f64),
        intensity: f64,
    ) {
        if self.count == self.range.len() {
            self.reserve(2 * self.count + LANES);
        }
        self.push(source, (range, range), primitive, cosine, intensity);
        self.ends.push(end);
    }

    /// The end of the path of reflection `i` unless it is [`PathKind::Direct`].
    pub fn end_of(&self, i: usize) -> Option<&PathEnd> {
        self.ends.get(i.checked_sub(self.count - self.ends.len())?)
    }

    /// Length in air of the way to reflection `i`, m.
    fn air_length(&self, i: usize) -> f64 {
        let end = self.end_of(i);
        let in_water = end.and_then(|end| {
            let plane = end.plane?;
            Some(plane.water.group_index * (end.surface - plane.point).length())
        });
        self.range[i] - in_water.unwrap_or(0.0)
    }

    /// Dims all reflections by an extinction of the air, 1/m.
    pub fn dim(&mut self, extinction: f64) {
        for i in 0..self.count {
            let passed = libm::exp(-2.0 * extinction * self.air_length(i));
            self.intensity[i] *= passed;
        }
    }

    /// Number of reflections before those of the air, which come last.
    pub fn count_without_air(&self) -> usize {
        self.count - self.ends.iter().rev().take_while(|end| end.path.kind.is_air()).count()
    }

    /// The reflection to which a return at `range` is attributed: `nearest`, the nearest one, but in pulses
    /// that meet water, fog or rain the nearest one of the kind that has the most light within `depth` m.
    pub fn source_in_medium(&self, nearest: usize, range: f64, depth: f64) -> usize {
        if !self.ends.iter().any(|end| end.path.kind.is_of_medium()) {
            return nearest;
        }
        let kind_of = |i: usize| self.end_of(i).map_or(PathKind::Direct, |end| end.path.kind) as usize;
        let off = |i: usize| (self.entry[i] - range).abs();
        let mut light = [0.0; PathKind::COUNT];
        for i in (0..self.count).filter(|i| off(*i) <= depth) {
            light[kind_of(i)] += self.intensity[i];
        }
        let brightest = (0..light.len()).max_by(|a, b| light[*a].total_cmp(&light[*b])).unwrap_or(0);
        let of_kind = (0..self.count).filter(|i| off(*i) <= depth && kind_of(*i) == brightest);
        of_kind.min_by(|a, b| off(*a).total_cmp(&off(*b))).unwrap_or(nearest)
    }

    /// Fills in the fields that [`Reflections::push_triangles`] leaves out, so that others may follow.
    /// `subrays` are those of the reflections, in order.
    pub fn complete(&mut self, subrays: impl Iterator<Item = usize>, rings: &[u32]) {
        if !self.is_opaque_only {
            return;
        }
        self.is_opaque_only = false;
        for (i, subray) in (0..self.count).zip(subrays) {
            self.entry[i] = self.range[i];
            self.subray[i] = subray as u32;
            self.ring[i] = rings[subray];
        }
    }

    /// Removes the reflections without light from primitives for which `is_dark` is true.
    pub fn remove_dark(&mut self, is_dark: impl Fn(u32) -> bool) {
        let mut kept = 0;
        for i in 0..self.count {
            if self.intensity[i] == 0.0 && is_dark(self.primitive[i]) {
                continue;
            }
            for field in [&mut self.range, &mut self.entry, &mut self.intensity, &mut self.cosine] {
                field[kept] = field[i];
            }
            for field in [&mut self.primitive, &mut self.ring, &mut self.subray] {
                field[kept] = field[i];
            }
            kept += 1;
        }
        self.count = kept;
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
    fn ends_of_paths_follow_the_others_and_dark_ones_are_removed() {
        let mut all = Reflections::default();
        all.clear(8);
        let range = std::array::from_fn(|i| 1.0 + i as f64);
        let intensity = std::array::from_fn(|i| i as f64 % 2.0);
        let primitive = std::array::from_fn(|i| i as u32);
        all.push_triangles(LaneMask::of([1; 8]), &range, &intensity, &[1.0; LANES], &primitive);
        all.mark_opaque_only();
        all.complete(10..18, &[3; 18]);
        all.remove_dark(|primitive| primitive != 2);
        assert_eq!((all.primitives(), all.count()), (&[1, 2, 3, 5, 7][..], 5));
        assert_eq!(all.subrays(), Some(&[11, 12, 13, 15, 17][..]));
        assert_eq!(all.entries(), [2.0, 3.0, 4.0, 6.0, 8.0]);
        let end = PathEnd { surface: DVec3::X, direction: DVec3::Y, path: EchoPath::DIRECT, plane: None };
        for i in 0..20 {
            all.push_end((i, 0), end, 9.0, (4, 1.0), 0.5);
        }
        assert_eq!((all.count(), all.end_of(4), all.end_of(5), all.end_of(25)), (25, None, Some(&end), None));
        all.clear(8);
        all.push((0, 0), (1.0, 1.0), 0, 1.0, 1.0);
        assert_eq!(all.end_of(0), None);
    }

    #[test]
    fn returns_of_water_belong_to_the_kind_with_the_most_light() {
        let mut all = Reflections::default();
        all.clear(8);
        for (range, kind, intensity) in [
            (10.0, PathKind::WaterSurface, 0.5),
            (10.0, PathKind::WaterSurface, 0.5),
            (10.1, PathKind::WaterColumn, 0.7),
            (12.0, PathKind::WaterBottom, 0.1),
        ] {
            let path = EchoPath { kind, order: 1 };
            let end = PathEnd { surface: DVec3::X, direction: DVec3::Y, path, plane: None };
            all.push_end((0, 0), end, range, (0, 1.0), intensity);
        }
        assert_eq!(all.source_in_medium(2, 10.06, 0.2), 0);
        assert_eq!(all.source_in_medium(2, 10.2, 0.15), 2);
        assert_eq!(all.source_in_medium(3, 12.01, 0.2), 3);
        assert_eq!(all.source_in_medium(3, 20.0, 0.2), 3, "nothing is near");
    }

    #[test]
    fn the_air_dims_the_ways_through_it_and_comes_last() {
        let mut all = Reflections::default();
        all.clear(8);
        all.push((0, 0), (100.0, 100.0), 0, 1.0, 1.0);
        let water = crate::pulse::water::tests::water();
        let plane = Some(WaterPlane { point: DVec3::Y * 100.0, normal: DVec3::NEG_Y, water });
        for (kind, plane, y) in
            [(PathKind::WaterBottom, plane, 110.0), (PathKind::Air, None, 50.0), (PathKind::Drop, None, 60.0)]
        {
            let path = EchoPath { kind, order: 0 };
            let end = PathEnd { surface: DVec3::Y * y, direction: DVec3::Y, path, plane };
            let range = if plane.is_some() { 100.0 + 1.365 * 10.0 } else { y };
            all.push_end((0, 0), end, range, (0, 1.0), 1.0);
        }
        assert_eq!((all.count(), all.count_without_air()), (4, 2));
        all.dim(0.01);
        let lengths: Vec<f64> = all.intensities().iter().map(|i| -50.0 * libm::log(*i)).collect();
        for (found, expected) in lengths.iter().zip([100.0, 100.0, 50.0, 60.0]) {
            assert!((found - expected).abs() < 1e-9, "{lengths:?}");
        }
        assert_eq!(all.source_in_medium(3, 59.9, 1.0), 3);
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
