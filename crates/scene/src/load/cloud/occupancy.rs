//! Occupied cells of a grid, one bit each, and tables with one entry per occupied cell, in order.

use super::cells::{Cell, CloudGrid, SHARDS};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Words of bits before each of which the number of occupied cells is known.
const RUN: usize = 8;

/// One bit for each cell of a grid, by z, then y, then x.
pub(super) struct Occupancy {
    counts: [u64; 3],
    words: Vec<AtomicU64>,
    /// Number of occupied cells before each run of words; empty until [`Occupancy::count`].
    before: Vec<u32>,
}

impl Occupancy {
    /// No occupied cells; `None` if the bits of all cells take more than `limit` bytes, or more memory than
    /// there is.
    pub fn new(grid: &CloudGrid, limit: u64) -> Option<Occupancy> {
        let counts = grid.counts().map(u64::from);
        let cells = counts.iter().try_fold(1u64, |product, count| product.checked_mul(*count))?;
        let words = usize::try_from(cells.div_ceil(64)).ok().filter(|_| cells.div_ceil(8) <= limit)?;
        let mut bits = Vec::new();
        bits.try_reserve_exact(words).ok()?;
        bits.resize_with(words, AtomicU64::default);
        Some(Occupancy { counts, words: bits, before: Vec::new() })
    }

    fn bit(&self, [x, y, z]: Cell) -> (usize, u64) {
        let number = (u64::from(z) * self.counts[1] + u64::from(y)) * self.counts[0] + u64::from(x);
        ((number / 64) as usize, 1 << (number % 64))
    }

    /// Marks a cell as occupied.
    pub fn mark(&self, cell: Cell) {
        let (word, bit) = self.bit(cell);
        if self.words[word].load(Ordering::Relaxed) & bit == 0 {
            self.words[word].fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// True if a cell is marked.
    pub fn contains(&self, cell: Cell) -> bool {
        let (word, bit) = self.bit(cell);
        self.words[word].load(Ordering::Relaxed) & bit != 0
    }

    /// Counts the cells, after which none is marked.
    pub fn count(&mut self) {
        let mut all = 0;
        let count_of = |run: &[AtomicU64]| {
            let before = all;
            all += run.iter().map(|word| word.load(Ordering::Relaxed).count_ones()).sum::<u32>();
            before
        };
        self.before = self.words.chunks(RUN).map(count_of).collect();
    }

    /// Number of occupied cells before a cell.
    pub fn rank(&self, cell: Cell) -> usize {
        let (word, bit) = self.bit(cell);
        let run = word / RUN;
        let ones = |word: &AtomicU64| word.load(Ordering::Relaxed).count_ones();
        let before = self.words[run * RUN..word].iter().map(ones).sum::<u32>();
        let within = self.words[word].load(Ordering::Relaxed) & (bit - 1);
        (self.before[run] + before + within.count_ones()) as usize
    }

    /// The occupied cells from this rank on, in order.
    pub fn cells_from(&self, rank: usize) -> impl Iterator<Item = Cell> {
        let run = self.before.partition_point(|before| *before as usize <= rank).saturating_sub(1);
        let skipped = rank - self.before.get(run).map_or(0, |before| *before as usize);
        let words = self.words.iter().enumerate().skip(run * RUN);
        let numbers = words.flat_map(|(i, word)| {
            let mut left = word.load(Ordering::Relaxed);
            std::iter::from_fn(move || {
                let bit = (left != 0).then(|| u64::from(left.trailing_zeros()))?;
                left &= left - 1;
                Some(i as u64 * 64 + bit)
            })
        });
        let [columns, rows, _] = self.counts;
        let cell = move |number: u64| {
            [number % columns, number / columns % rows, number / columns / rows].map(|n| n as u32)
        };
        numbers.skip(skipped).map(cell)
    }
}

/// The sums of some occupied cells that follow each other.
pub(super) struct DenseSums<S> {
    pub sums: Vec<S>,
    /// Rank of the first one.
    pub first: usize,
}

impl<S> DenseSums<S> {
    /// Number of cells of a set.
    pub fn shard_cells(&self) -> usize {
        self.sums.len().div_ceil(SHARDS).max(1)
    }

    /// The ranks of the cells.
    pub fn ranks(&self) -> Range<usize> {
        self.first..self.first + self.sums.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::{Aabb, DVec3};

    #[test]
    fn cells_are_numbered_in_their_order() {
        let size = DVec3::new(37.0, 11.0, 9.0);
        let grid = CloudGrid::around(Aabb { min: DVec3::ZERO, max: size }, 1.0).unwrap();
        assert!(Occupancy::new(&grid, 37 * 11 * 9 / 8 - 1).is_none());
        let mut occupied = Occupancy::new(&grid, 37 * 11 * 9 / 8 + 1).unwrap();
        let all = (0..9).flat_map(|z| (0..11).flat_map(move |y| (0..37).map(move |x| [x, y, z])));
        let some: Vec<Cell> = all.filter(|[x, y, z]| (x * 7 + y * 3 + z) % 5 == 0 && *z != 4).collect();
        some.iter().rev().for_each(|cell| occupied.mark(*cell));
        occupied.count();
        for (rank, cell) in some.iter().enumerate() {
            assert_eq!(occupied.rank(*cell), rank);
            assert!(occupied.contains(*cell) && !occupied.contains([cell[0], cell[1], 4]));
            assert!(occupied.cells_from(rank).eq(some[rank..].iter().copied()), "{rank}");
        }
        assert_eq!(occupied.cells_from(some.len()).count(), 0);
    }
}
