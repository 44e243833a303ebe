//! The points of a cloud within the box that both clouds share, and cells over that box.

use crate::cloud::{Points, in_command, too_many_cells};
use crate::kd_tree::Places;
use std::path::Path;
use vlscan_base::error::Result;
use vlscan_base::machine;
use vlscan_formats::StrayFinder;
use vlscan_geom::DVec3;

/// Most cells of a raster.
const MAX_CELLS: f64 = 1e8;

/// Memory of a cell that both clouds have measured, bytes: while the errors of registration are estimated,
/// the surfaces of both clouds, the differences, and two lists of the stable ones with their order.
const CELL_BYTES: u64 = 240;
/// Memory of a cell for each of the splits that threads measure at a time, bytes: the extremes of a half, and
/// the values of both.
const SPLIT_BYTES: u64 = 32;

/// The points of a cloud within the common box, in the order of the file.
pub(super) struct Cut<'a> {
    pub points: &'a Points,
    /// Lower corner of the box.
    corner: DVec3,
    /// Their indices in `points`; `None` if all points are in the box.
    chosen: Option<Vec<u32>>,
    /// Points of the file per point kept.
    pub weight: f64,
}

impl Places for Cut<'_> {
    fn count(&self) -> usize {
        self.len()
    }

    fn at(&self, index: u32) -> [f64; 3] {
        self.offset(index as usize)
    }

    fn release(&self) {
        self.points.release();
    }
}

impl<'a> Cut<'a> {
    /// The points of `points` in the box.
    pub fn of(points: &'a Points, low: DVec3, high: DVec3) -> Cut<'a> {
        let is_inside = |p: &DVec3| p.x >= low.x && p.y >= low.y && p.x <= high.x && p.y <= high.y;
        let are_all_inside = points.positions().all(|p| is_inside(&p));
        let chosen = (!are_all_inside).then(|| {
            let inside = (0..).zip(points.positions()).filter(|(_, p)| is_inside(p));
            inside.map(|(index, _)| index).collect()
        });
        let weight = points.total() as f64 / points.len().max(1) as f64;
        Cut { points, corner: low, chosen, weight }
    }

    /// The points of the cut that are chosen.
    pub fn part(&self, is_chosen: impl Fn(usize) -> bool) -> Cut<'a> {
        let chosen = (0..self.len()).filter(|i| is_chosen(*i)).map(|i| self.index(i) as u32).collect();
        Cut { chosen: Some(chosen), ..*self }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.chosen.as_ref().map_or(self.points.len(), Vec::len)
    }

    /// The index of a point in `points`.
    pub fn index(&self, i: usize) -> usize {
        self.chosen.as_ref().map_or(i, |chosen| chosen[i] as usize)
    }

    /// Position of a point relative to the lower corner of the box, m.
    pub fn offset(&self, i: usize) -> [f64; 3] {
        (self.points.position(self.index(i)) - self.corner).to_array()
    }

    /// Positions of all points, in their order.
    pub fn offsets(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        let all = self.chosen.is_none().then(|| self.points.positions());
        let chosen = self.chosen.iter().flatten().map(|index| self.points.position(*index as usize));
        all.into_iter().flatten().chain(chosen).map(|position| (position - self.corner).to_array())
    }

    /// A value of each point, in their order.
    pub fn map<'s, T>(&'s self, of: impl Fn(&Points, usize) -> T + 's) -> impl Iterator<Item = T> + 's {
        (0..self.len()).map(move |i| of(self.points, self.index(i)))
    }

    /// The numbers of return and returns of a point; `None` without both.
    pub fn returns(&self, i: usize) -> Option<(u8, u8)> {
        let i = self.index(i);
        let numbers = (self.points.return_number_of(i)?, self.points.number_of_returns_of(i)?);
        Some(numbers).filter(|numbers| numbers.0 > 0 && numbers.1 > 0)
    }

    /// The median of the intensities; `None` without any.
    pub fn median_intensity(&self) -> Option<f64> {
        let all = (0..self.len()).filter_map(|i| self.points.intensity_of(self.index(i)));
        let mut values: Vec<f32> = all.filter(|value| !value.is_nan()).collect();
        let middle = values.len() / 2;
        (!values.is_empty()).then(|| f64::from(*values.select_nth_unstable_by(middle, f32::total_cmp).1))
    }

    /// Class of a point; `None` if the points have none.
    pub fn class(&self, i: usize) -> Option<u8> {
        self.points.class_of(self.index(i))
    }
}

/// A result of each of two clouds, computed at the same time.
pub(super) fn of_both<T: Send>(cuts: [&Cut; 2], of: impl Fn(&Cut) -> T + Sync) -> [T; 2] {
    let (first, second) = rayon::join(|| of(cuts[0]), || of(cuts[1]));
    [first, second]
}

/// The most cells for which half of a memory, bytes, suffices, to two digits, while so many splits of a cloud
/// are measured.
fn most_cells(memory: Option<u64>, splits: usize) -> f64 {
    let Some(memory) = memory else { return MAX_CELLS };
    let cells = memory as f64 / 2.0 / (CELL_BYTES + SPLIT_BYTES * splits as u64) as f64;
    let step = 10f64.powi(cells.max(100.0).log10().floor() as i32 - 1);
    ((cells / step).floor() * step).min(MAX_CELLS)
}

/// Square cells over the common box.
#[derive(Clone, Debug)]
pub(super) struct CellGrid {
    pub side: f64,
    pub columns: usize,
    pub rows: usize,
}

impl CellGrid {
    /// Cells of a side over the common box of clouds, of which one is `points` with a name for messages, for
    /// as many `splits` of a cloud at a time.
    ///
    /// # Errors
    /// [`Error::Input`](vlscan_base::error::Error::Input): too many cells, or more than half the memory of
    /// the machine can hold.
    pub fn new(
        (low, high): (DVec3, DVec3),
        side: f64,
        (name, points): (&str, &Points),
        splits: usize,
    ) -> Result<CellGrid> {
        let count = |extent: f64| (extent / side).floor() + 1.0;
        let (columns, rows) = (count(high.x - low.x), count(high.y - low.y));
        let most = most_cells(machine::memory(), splits);
        if columns * rows > most {
            let mut finder = StrayFinder::default();
            points.positions().for_each(|p| finder.add(p));
            let input = in_command(&[Path::new(name)]);
            return Err(too_many_cells((name, &input), [columns, rows], side, most, &finder));
        }
        Ok(CellGrid { side, columns: columns as usize, rows: rows as usize })
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// The cell of a position.
    pub fn cell(&self, offset: &[f64; 3]) -> usize {
        let index = |v: f64, count: usize| ((v / self.side) as usize).min(count - 1);
        index(offset[1], self.rows) * self.columns + index(offset[0], self.columns)
    }

    /// The centre of a cell, relative to the corner of the box, m.
    pub fn centre(&self, cell: usize) -> [f64; 2] {
        [cell % self.columns, cell / self.columns].map(|i| (i as f64 + 0.5) * self.side)
    }

    /// The cells within a number of columns and rows of a cell, without that cell.
    pub fn around(&self, cell: usize, reach: usize) -> impl Iterator<Item = usize> {
        let (column, row, width) = (cell % self.columns, cell / self.columns, self.columns);
        let rows = row.saturating_sub(reach)..(row + reach + 1).min(self.rows);
        let columns = column.saturating_sub(reach)..(column + reach + 1).min(self.columns);
        let cells = rows.flat_map(move |row| columns.clone().map(move |column| row * width + column));
        cells.filter(move |other| *other != cell)
    }

    /// The lowest and the highest of some points in each cell; infinite in cells without.
    pub fn extremes(&self, offsets: impl Iterator<Item = [f64; 3]>) -> Vec<[f64; 2]> {
        let mut extremes = vec![[f64::INFINITY, f64::NEG_INFINITY]; self.len()];
        offsets.for_each(|offset| {
            let [low, high] = &mut extremes[self.cell(&offset)];
            (*low, *high) = (low.min(offset[2]), high.max(offset[2]));
        });
        extremes
    }

    /// The number of some points in each cell.
    pub fn counts(&self, offsets: impl Iterator<Item = [f64; 3]>) -> Vec<f64> {
        let mut counts = vec![0.0; self.len()];
        offsets.for_each(|offset| counts[self.cell(&offset)] += 1.0);
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_take_at_most_half_the_memory() {
        // Half of 16 GiB holds 35.8 million cells of 240 bytes.
        assert_eq!(
            [None, Some(1 << 40), Some(16 << 30)].map(|memory| most_cells(memory, 0)),
            [1e8, 1e8, 3.5e7]
        );
        assert_eq!(most_cells(Some(16 << 30), 8), 1.7e7);
        assert_eq!([0, 1000, 100_000].map(|memory| most_cells(Some(memory), 0)), [0.0, 0.0, 200.0]);
    }
}
