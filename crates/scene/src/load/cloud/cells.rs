//! The grid of a point cloud and the sums over the points in its cells.

use crate::plane::{Moments, least_direction};
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::atomic::{AtomicUsize, Ordering};
use vlscan_formats::PointRow;
use vlscan_geom::{Aabb, DVec3, unit};
use vlscan_trace::GridPlace;

/// Number of independent sets of cells. Constant, so that results do not depend on the number of threads.
pub(super) const SHARDS: usize = 16;

/// Cell indices along x, y, z.
pub(super) type Cell = [u32; 3];

/// A grid of cubes (spec input-formats §4.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CloudGrid {
    min: DVec3,
    size: f64,
    last: Cell,
}

impl CloudGrid {
    /// The grid whose lower corner is that of `extent`; along an axis without extent its single layer is
    /// centred at the points. `None` if the cell indices would overflow.
    pub fn around(extent: Aabb, size: f64) -> Option<CloudGrid> {
        let (mut min, mut last) = (extent.min, [0; 3]);
        for axis in 0..3 {
            let length = extent.max[axis] - extent.min[axis];
            let count = (length / size).ceil().max(1.0);
            if count.is_nan() || count > f64::from(u32::MAX) {
                return None;
            }
            if length == 0.0 {
                min[axis] -= 0.5 * size;
            }
            last[axis] = count as u32 - 1;
        }
        Some(CloudGrid { min, size, last })
    }

    pub fn cell_of(&self, p: DVec3) -> Cell {
        let at = (p - self.min) / self.size;
        // A cast from float saturates; negative numbers cannot occur but would become 0.
        [0, 1, 2].map(|axis| (at[axis] as u32).min(self.last[axis]))
    }

    /// The set of cells that contains a cell.
    pub fn shard_of_cell(&self, cell: Cell) -> usize {
        let mut hasher = CellHasher::default();
        std::hash::Hash::hash(&cell, &mut hasher);
        (hasher.finish() >> 57) as usize % SHARDS
    }

    /// Centre of a cell, m.
    pub fn centre(&self, cell: Cell) -> DVec3 {
        self.min + (DVec3::from(cell.map(f64::from)) + 0.5) * self.size
    }

    /// Placement of the cubes of cells.
    pub fn place(&self) -> GridPlace {
        GridPlace::new(self.min, self.size)
    }

    /// Number of cells along x, y, z.
    pub fn counts(&self) -> [u32; 3] {
        self.last.map(|last| last.saturating_add(1))
    }

    /// Sort key of a cell: by z, then y, then x.
    pub fn order(&self, cell: Cell) -> u128 {
        u128::from(cell[2]) << 64 | u128::from(cell[1]) << 32 | u128::from(cell[0])
    }
}

/// The source of the normal of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NormalRule {
    /// Mean of the points' normals.
    Mean,
    /// Normal of the point nearest to the centre of the cell.
    Nearest,
    /// Normal of the plane fitted to the points.
    Plane,
}

/// Sums that are kept of the points of a cell.
pub(super) trait CellSums: Copy + Send + Sync {
    /// That of no points.
    const NOTHING: Self;

    /// Adds a point to the cell with this centre.
    fn add(&mut self, centre: DVec3, point: &PointRow, rule: NormalRule);

    /// Number of points.
    fn count(&self) -> u32;

    /// The class of most points.
    fn class(&self) -> u8;

    /// The cell's unit normal, if it can be derived from its points.
    fn normal(&self, rule: NormalRule) -> Option<DVec3>;
}

/// The class of more than half of the points, if there is one (Boyer and Moore's majority vote), and its
/// lead.
#[derive(Clone, Copy, Debug)]
pub(super) struct Votes {
    class: u8,
    lead: u32,
}

impl CellSums for Votes {
    const NOTHING: Votes = Votes { class: 0, lead: 0 };

    fn add(&mut self, _: DVec3, point: &PointRow, _: NormalRule) {
        match (self.lead, self.class == point.class) {
            (0, _) => (self.class, self.lead) = (point.class, 1),
            (_, true) => self.lead = self.lead.saturating_add(1),
            (_, false) => self.lead -= 1,
        }
    }

    /// Not counted: at least one.
    fn count(&self) -> u32 {
        1
    }

    fn class(&self) -> u8 {
        self.class
    }

    fn normal(&self, _: NormalRule) -> Option<DVec3> {
        None
    }
}

/// Sums over the points of a cell of a cloud with normals; 136 bytes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sums {
    count: u32,
    /// Sum of the points relative to the centre (plane) or of the normals.
    first: DVec3,
    /// Sum of products of coordinates relative to the centre (plane); squared distance of the nearest point.
    second: Moments,
    /// Box around the points relative to the centre (plane).
    extent: Aabb,
    votes: Votes,
}

impl CellSums for Sums {
    const NOTHING: Sums =
        Sums { count: 0, first: DVec3::ZERO, second: [0.0; 6], extent: Aabb::EMPTY, votes: Votes::NOTHING };

    fn add(&mut self, centre: DVec3, point: &PointRow, rule: NormalRule) {
        let d = point.position - centre;
        match (rule, point.normal) {
            (NormalRule::Plane, _) => {
                self.first += d;
                self.extent = self.extent.with(d);
                let products = [d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z];
                self.second.iter_mut().zip(products).for_each(|(sum, p)| *sum += p);
            }
            (NormalRule::Mean, Some(n)) => self.first += n,
            (NormalRule::Nearest, Some(n)) => {
                let squared = d.length_squared();
                if self.first == DVec3::ZERO || squared < self.second[0] {
                    (self.first, self.second[0]) = (n, squared);
                }
            }
            (_, None) => {}
        }
        self.votes.add(centre, point, rule);
        self.count = self.count.saturating_add(1);
    }

    fn count(&self) -> u32 {
        self.count
    }

    fn class(&self) -> u8 {
        self.votes.class
    }

    fn normal(&self, rule: NormalRule) -> Option<DVec3> {
        let normal = match rule {
            NormalRule::Mean | NormalRule::Nearest => unit(self.first),
            NormalRule::Plane => least_direction(self.moments_about(self.extent.centre())),
        };
        normal.is_finite().then_some(normal)
    }
}

impl Sums {
    /// Σ(d−m)(d−m)ᵀ from Σd and Σddᵀ.
    fn moments_about(&self, m: DVec3) -> Moments {
        let (n, s) = (f64::from(self.count), self.first);
        let mut moments = self.second;
        for (moment, (i, j)) in moments.iter_mut().zip([(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]) {
            *moment -= s[i] * m[j] + m[i] * s[j] - n * m[i] * m[j];
        }
        moments
    }
}

/// The memory that the tables of all sets can have together.
pub(super) struct Budget {
    limit: usize,
    taken: AtomicUsize,
}

impl Budget {
    pub fn new(limit: usize) -> Budget {
        Budget { limit, taken: AtomicUsize::new(0) }
    }

    /// Counts bytes as taken, also those beyond the limit; `false` if they are.
    fn take(&self, bytes: usize) -> bool {
        self.taken.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes) <= self.limit
    }

    fn give_back(&self, bytes: usize) {
        self.taken.fetch_sub(bytes, Ordering::Relaxed);
    }

    /// Bytes that may be taken.
    pub fn limit(&self) -> usize {
        self.limit
    }

    /// Bytes that were taken, including the bytes of a rejected request.
    pub fn taken(&self) -> usize {
        self.taken.load(Ordering::Relaxed)
    }
}

/// One set of occupied cells.
pub(super) struct Cells<S>(HashMap<Cell, S, BuildHasherDefault<CellHasher>>);

impl<S> Default for Cells<S> {
    fn default() -> Cells<S> {
        Cells(HashMap::default())
    }
}

impl<S: CellSums> Cells<S> {
    /// Bytes of a cell in its table.
    const CELL_BYTES: usize = size_of::<(Cell, S)>() + 1;

    /// Adds a point to a cell with this centre; `false` if the budget does not allow a larger table.
    pub fn add(
        &mut self,
        cell: Cell,
        centre: DVec3,
        point: &PointRow,
        rule: NormalRule,
        budget: &Budget,
    ) -> bool {
        if self.0.len() == self.0.capacity() && !self.0.contains_key(&cell) {
            let before = self.0.capacity();
            // The table is copied into one of twice its size.
            if !budget.take(Self::CELL_BYTES * (2 * before).max(4)) || self.0.try_reserve(1).is_err() {
                return false;
            }
            budget.give_back(Self::CELL_BYTES * before);
        }
        self.0.entry(cell).or_insert(S::NOTHING).add(centre, point, rule);
        true
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Bytes of the table with up to this many more cells.
    pub fn bytes_with(&self, more: usize) -> usize {
        Self::bytes_of((self.0.len() + more).max(self.0.capacity().saturating_sub(1)))
    }

    /// Bytes of a table of this many cells: a power of two of slots, seven eighths of which may be filled.
    pub fn bytes_of(cells: usize) -> usize {
        Self::CELL_BYTES * (cells * 8 / 7 + 1).next_power_of_two()
    }

    /// The cells in arbitrary order.
    pub fn iter(&self) -> impl Iterator<Item = Cell> {
        self.0.keys().copied()
    }

    pub fn get(&self, cell: Cell) -> Option<&S> {
        self.0.get(&cell)
    }

    /// Removes the other cells; the table keeps its size.
    pub fn retain(&mut self, is_kept: impl Fn(Cell) -> bool) {
        // Places of single cells that are removed would stay taken, and the table would grow for others.
        let kept = self.0.iter().filter(|(cell, _)| is_kept(**cell)).map(|(cell, sums)| (*cell, *sums));
        let kept: Vec<(Cell, S)> = kept.collect();
        self.0.clear();
        self.0.extend(kept);
    }

    /// Removes all cells; the table keeps its size.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}

/// A multiplicative hash; crafted collisions need not be prevented.
#[derive(Default)]
pub(super) struct CellHasher(u64);

impl Hasher for CellHasher {
    fn finish(&self) -> u64 {
        (self.0 ^ (self.0 >> 32)).wrapping_mul(0x9E37_79B9_7F4A_7C15)
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&b| self.write_u32(u32::from(b)));
    }

    fn write_u32(&mut self, value: u32) {
        self.0 = (self.0 ^ u64::from(value)).wrapping_mul(0xD6E8_FEB8_6659_FD93).rotate_left(29);
    }

    fn write_usize(&mut self, _: usize) {
        // The length prefix of the array, which is always three.
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn extent(size: [f64; 3]) -> Aabb {
        Aabb { min: DVec3::ZERO, max: DVec3::from(size) }
    }

    #[test]
    fn cells_begin_at_the_minimum_and_the_last_holds_the_maximum() {
        let grid = CloudGrid::around(extent([1.0, 1.1, 0.3]), 0.5).unwrap();
        assert_eq!(grid.last, [1, 2, 0]);
        assert_eq!(grid.cell_of(DVec3::new(1.0, 1.1, 0.3)), [1, 2, 0]);
        assert_eq!(grid.centre([0, 2, 0]), DVec3::new(0.25, 1.25, 0.25));
        let flat =
            CloudGrid::around(Aabb { min: DVec3::splat(7.0), max: DVec3::new(9.0, 9.0, 7.0) }, 0.5).unwrap();
        assert_eq!(flat.centre([0, 0, 0]).z, 7.0);
        assert!(CloudGrid::around(extent([1e12, 1.0, 1.0]), 1e-3).is_none());
    }

    proptest! {
        #[test]
        fn every_point_lies_in_its_cell(p in prop::array::uniform3(0.0..1.0f64), size in 0.001..2.0f64) {
            let grid = CloudGrid::around(extent([1.0; 3]), size).unwrap();
            let off = (DVec3::from(p) - grid.centre(grid.cell_of(DVec3::from(p)))).abs().max_element();
            prop_assert!(off <= 0.5 * size * (1.0 + 1e-9));
        }

        #[test]
        fn planes_from_sums_equal_planes_from_points(points in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 3..40), tilt in -0.5..0.5f64) {
            let points: Vec<DVec3> = points.into_iter().map(|[x, y, z]| DVec3::new(x, y, tilt * x + 0.01 * z) + 1000.0).collect();
            let mut sums = Sums::NOTHING;
            for &position in &points {
                sums.add(DVec3::splat(1000.5), &PointRow { position, ..PointRow::default() }, NormalRule::Plane);
            }
            let plane = crate::plane::fit(|| points.iter().copied()).unwrap();
            let spread = points.iter().map(|p| (*p - plane.centre).length()).fold(0.0, f64::max);
            prop_assume!(spread > 0.3);
            let ours = sums.normal(NormalRule::Plane).unwrap();
            let error = |n: DVec3| points.iter().map(|p| (*p - plane.centre).dot(n).powi(2)).sum::<f64>();
            prop_assert!(error(ours) <= error(plane.normal) + 1e-9);
        }
    }
}
