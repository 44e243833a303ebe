//! The occupied cells of a grid in the order of their numbers: two bytes each, and four for each row of
//! cells.

use crate::memory::vec_bytes;
use std::collections::TryReserveError;
use std::ops::Range;

/// Voxels for which the row of the first is known.
const RUN: usize = 256;

/// Positions across rows are below this.
const MAX_POSITION: u32 = 1 << 30;

/// Rows without voxels that any grid can have.
const MIN_ROWS: usize = 1 << 20;
/// Rows per voxel that a grid can have.
const MAX_ROWS_PER_VOXEL: usize = 16;

/// The orders of axes in which numbers can advance, from the slowest axis to the fastest.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [2, 1, 0], [1, 0, 2], [0, 2, 1], [1, 2, 0], [2, 0, 1]];

/// Number of cells along x, y, z; the axes from that along which numbers advance most slowly to that of rows;
/// the number of the first row that has a voxel.
pub type CellLayout = ([u32; 3], [usize; 3], usize);

/// The occupied cells of a grid. Their numbers advance along one axis, its rows, then along a second one and
/// then along the third.
#[derive(Clone, Debug)]
pub struct VoxelCells {
    /// Number of cells along x, y, z.
    counts: [u32; 3],
    /// Axes from that along which numbers advance most slowly to that of rows.
    order: [usize; 3],
    /// Number of the first row that has a voxel.
    first_row: usize,
    /// Number of the first voxel of each row from that one on, up to the last row with a voxel.
    starts: Vec<u32>,
    /// Position along its row of each voxel.
    along: Vec<u16>,
    /// Row of each voxel whose number is a multiple of [`RUN`].
    rows: Vec<u32>,
}

impl VoxelCells {
    /// A grid of `counts` cells along x, y, z, none of which is occupied.
    pub fn new(counts: [u32; 3]) -> VoxelCells {
        VoxelCells::in_order(counts, ORDERS[0])
    }

    fn in_order(counts: [u32; 3], order: [usize; 3]) -> VoxelCells {
        VoxelCells { counts, order, first_row: 0, starts: Vec::new(), along: Vec::new(), rows: Vec::new() }
    }

    /// The cells whose rows begin at these numbers, and whose positions along the rows are these, as
    /// [`VoxelCells::arrays`] returned them; `None` if they are not in order.
    pub fn from_arrays(
        (counts, order, first_row): CellLayout,
        starts: Vec<u32>,
        along: Vec<u16>,
    ) -> Option<VoxelCells> {
        if !ORDERS.contains(&order) || starts.is_empty() != along.is_empty() {
            return None;
        }
        let cells = VoxelCells { counts, order, first_row, starts, along, rows: Vec::new() };
        let [slow, mid, fast] = cells.dimensions();
        let are_rows = cells.starts.windows(2).all(|w| w[0] <= w[1])
            && cells.starts.first().is_none_or(|first| *first == 0)
            && cells.starts.last().is_none_or(|last| (*last as usize) < cells.along.len());
        let rows = first_row.checked_add(cells.starts.len())?;
        let is_within = rows as u64 <= u64::from(slow) * u64::from(mid) && fast <= 1 << 16;
        let is_row = |row: usize| {
            let along = &cells.along[cells.numbers_of(row)];
            along.windows(2).all(|w| w[0] < w[1]) && along.last().is_none_or(|last| u32::from(*last) < fast)
        };
        (are_rows && is_within && (first_row..rows).all(is_row)).then_some(cells)
    }

    /// Parts of the cells: their counts along the axes, the order of the axes and the first row; the number
    /// of the first voxel of each row; and the position of each voxel along its row.
    pub fn arrays(&self) -> (CellLayout, &[u32], &[u16]) {
        ((self.counts, self.order, self.first_row), &self.starts, &self.along)
    }

    /// Number of occupied cells.
    pub fn len(&self) -> usize {
        self.along.len()
    }

    /// True if no cell is occupied.
    pub fn is_empty(&self) -> bool {
        self.along.is_empty()
    }

    /// Makes room for more cells.
    ///
    /// # Errors
    /// When there is not enough memory.
    pub fn reserve(&mut self, more: usize) -> Result<(), TryReserveError> {
        self.along.try_reserve(more)
    }

    /// Occupies the cell with the next number. Returns false, and changes nothing, if it lies beyond the grid
    /// or if the numbers of all cells then advance along the axes in no order, or if the grid has too few
    /// voxels for its rows.
    pub fn push(&mut self, cell: [u32; 3]) -> bool {
        self.append(cell) || self.reorder(cell)
    }

    #[inline(always)]
    fn append(&mut self, cell: [u32; 3]) -> bool {
        let [slow, mid, fast] = self.order.map(|axis| cell[axis]);
        let [slow_count, mid_count, fast_count] = self.dimensions();
        let is_within = slow < slow_count && mid < mid_count && fast < fast_count;
        if !is_within || slow.max(mid) >= MAX_POSITION || fast > u32::from(u16::MAX) {
            return false;
        }
        let Some(row) = usize::try_from(u64::from(slow) * u64::from(mid_count) + u64::from(mid)).ok() else {
            return false;
        };
        let number = self.along.len();
        if number == 0 {
            self.first_row = row;
        }
        let Some(row) = row.checked_sub(self.first_row) else { return false };
        if row + 1 == self.starts.len() {
            // The row of the last voxel.
            if self.along.last().is_some_and(|last| u32::from(*last) >= fast) {
                return false;
            }
        } else if row < self.starts.len()
            || row > MIN_ROWS.saturating_add(MAX_ROWS_PER_VOXEL * number)
            || number >= u32::MAX as usize
        {
            return false;
        } else {
            self.starts.resize(row + 1, number as u32);
        }
        self.along.push(fast as u16);
        true
    }

    /// Continues in another order that all cells and this one are in.
    #[cold]
    fn reorder(&mut self, cell: [u32; 3]) -> bool {
        if cell.iter().zip(&self.counts).any(|(cell, count)| cell >= count) {
            return false;
        }
        let is_other = |order: &&[usize; 3]| **order != self.order;
        let found = ORDERS.iter().filter(is_other).find_map(|order| {
            let mut cells = VoxelCells::in_order(self.counts, *order);
            cells.along.try_reserve_exact(self.len() + 1).ok()?;
            (self.iter().all(|own| cells.append(own)) && cells.append(cell)).then_some(cells)
        });
        found.map(|cells| *self = cells).is_some()
    }

    /// Finds the row of some voxels, by which [`VoxelCells::cell`] finds those of the others.
    pub(super) fn complete(&mut self) {
        self.starts.shrink_to_fit();
        self.along.shrink_to_fit();
        self.rows.clear();
        for (row, start) in self.starts.iter().enumerate() {
            let end = self.starts.get(row + 1).map_or(self.along.len(), |n| *n as usize);
            let first = (*start as usize).div_ceil(RUN);
            self.rows.resize(self.rows.len() + end.div_ceil(RUN).saturating_sub(first), row as u32);
        }
        self.rows.push(self.starts.len().saturating_sub(1) as u32);
    }

    /// The cell of voxel `i`, along x, y, z.
    #[inline]
    pub fn cell(&self, i: usize) -> [u32; 3] {
        let (low, high) = (self.rows[i / RUN] as usize, self.rows[i / RUN + 1] as usize);
        let row = low + self.starts[low + 1..=high].partition_point(|start| *start as usize <= i);
        self.cell_in_row(row + self.first_row, self.along[i])
    }

    fn cell_in_row(&self, row: usize, along: u16) -> [u32; 3] {
        let mid = self.counts[self.order[1]] as usize;
        let at = [(row / mid) as u32, (row % mid) as u32, u32::from(along)];
        let mut cell = [0; 3];
        for (axis, at) in self.order.into_iter().zip(at) {
            cell[axis] = at;
        }
        cell
    }

    /// The cells in the order of their numbers.
    pub fn iter(&self) -> impl Iterator<Item = [u32; 3]> {
        let rows = self.first_row..self.first_row + self.starts.len();
        rows.flat_map(move |row| {
            self.along[self.numbers_of(row)].iter().map(move |a| self.cell_in_row(row, *a))
        })
    }

    /// True if the cells take less memory than the cubes and the tree over them would.
    pub fn are_compact(&self) -> bool {
        4 * self.starts.len() <= 64 * self.along.len()
    }

    /// Axes from that along which numbers advance most slowly to that of rows.
    pub(super) fn order(&self) -> [usize; 3] {
        self.order
    }

    /// Numbers of cells along these axes.
    pub(super) fn dimensions(&self) -> [u32; 3] {
        self.order.map(|axis| self.counts[axis])
    }

    /// Number of cells along the longest axis.
    pub(super) fn max_count(&self) -> u32 {
        self.counts.into_iter().fold(0, u32::max)
    }

    /// The first position along the slowest axis with a voxel, and that after the last.
    pub(super) fn slow_range(&self) -> Range<usize> {
        let mid = self.counts[self.order[1]].max(1) as usize;
        self.first_row / mid..(self.first_row + self.starts.len()).div_ceil(mid)
    }

    /// Numbers of the voxels of a row.
    #[inline(always)]
    pub(super) fn numbers_of(&self, row: usize) -> Range<usize> {
        let Some(row) = row.checked_sub(self.first_row).filter(|row| *row < self.starts.len()) else {
            return 0..0;
        };
        let end = self.starts.get(row + 1).map_or(self.along.len(), |n| *n as usize);
        self.starts[row] as usize..end
    }

    /// Positions along a row of some of its voxels.
    #[inline(always)]
    pub(super) fn along(&self, numbers: Range<usize>) -> &[u16] {
        &self.along[numbers]
    }

    /// Lowest and highest occupied cell along each axis.
    pub(super) fn extent(&self) -> [[u32; 3]; 2] {
        let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
        for row in self.first_row..self.first_row + self.starts.len() {
            let along = &self.along[self.numbers_of(row)];
            let (Some(first), Some(last)) = (along.first(), along.last()) else { continue };
            let (first, last) = (self.cell_in_row(row, *first), self.cell_in_row(row, *last));
            for axis in 0..3 {
                low[axis] = low[axis].min(first[axis]);
                high[axis] = high[axis].max(last[axis]);
            }
        }
        [low, high]
    }

    /// Memory, bytes.
    pub fn memory(&self) -> usize {
        vec_bytes(&self.starts) + vec_bytes(&self.along) + vec_bytes(&self.rows)
    }
}
