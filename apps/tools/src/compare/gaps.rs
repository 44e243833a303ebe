//! Gaps: cells without a difference of their own among cells that have one.
//!
//! A gap with points of both clouds is filled with the mean of the measured cells around it. All other gaps
//! may hide change, of which the measured cells nearby give the size.

use super::cell_surface::{CellSurface, surrounds};
use super::cut::CellGrid;
use super::registration::CellDifference;
use rayon::prelude::*;

/// Maximum distance of the measured cells that fill a gap, in cells.
const REACH: usize = 3;
/// Minimum number of measured cells that fill a gap.
const MIN_MEASURED: usize = 4;

/// The gaps between measured cells.
#[derive(Default)]
pub(super) struct Gaps {
    /// Cells with the mean difference of the measured cells around them.
    pub filled: Vec<CellDifference>,
    /// Cells left out: with points of both clouds, or surrounded by measured cells.
    pub left_out: Vec<usize>,
}

enum Gap {
    Filled(CellDifference),
    LeftOut(usize),
}

impl Gaps {
    /// The gaps in the grid, by the surfaces of both clouds and the cells where both are known.
    pub fn of(grid: &CellGrid, surfaces: &[Vec<CellSurface>; 2], measured: &MeasuredCells) -> Gaps {
        let gap = |cell: usize| {
            if measured.at(cell).is_some() {
                return None;
            }
            let has_both = surfaces.iter().all(|of_cloud| of_cloud[cell] != CellSurface::Missing);
            match (has_both, measured.mean_around(cell)) {
                (true, Some(filled)) => Some(Gap::Filled(filled)),
                (true, None) | (false, Some(_)) => Some(Gap::LeftOut(cell)),
                (false, None) => None,
            }
        };
        let all: Vec<Gap> = (0..grid.len()).into_par_iter().filter_map(gap).collect();
        let mut gaps = Gaps::default();
        for gap in all {
            match gap {
                Gap::Filled(filled) => gaps.filled.push(filled),
                Gap::LeftOut(cell) => gaps.left_out.push(cell),
            }
        }
        gaps
    }
}

/// Cells where both surfaces are known, by their place in the grid.
pub(super) struct MeasuredCells<'c> {
    grid: &'c CellGrid,
    cells: &'c [CellDifference],
    /// Index in `cells` by cell of the grid; `u32::MAX` for other cells.
    index: Vec<u32>,
}

impl<'c> MeasuredCells<'c> {
    pub fn new(grid: &'c CellGrid, cells: &'c [CellDifference]) -> MeasuredCells<'c> {
        let mut index = vec![u32::MAX; grid.len()];
        for (i, cell) in (0..).zip(cells) {
            index[cell.cell] = i;
        }
        MeasuredCells { grid, cells, index }
    }

    fn at(&self, cell: usize) -> Option<&CellDifference> {
        self.cells.get(self.index[cell] as usize)
    }

    fn around(&self, cell: usize, reach: usize) -> Vec<&CellDifference> {
        self.grid.around(cell, reach).filter_map(|other| self.at(other)).collect()
    }

    /// The mean difference of the measured cells around a cell: of at least four of the eight neighbours, or
    /// of the nearest cells that surround it; `None` if they are too few or too far. The variance is that of
    /// a measured cell, with the scatter among them, which grows with their distance.
    fn mean_around(&self, cell: usize) -> Option<CellDifference> {
        let around = (1..=REACH).find_map(|reach| {
            let around = self.around(cell, reach);
            let is_enough = around.len() >= MIN_MEASURED && (reach == 1 || self.is_surrounded(cell, &around));
            is_enough.then_some(around)
        })?;
        let difference = mean(around.iter().map(|other| other.difference));
        let square = |other: &CellDifference| other.variance + (other.difference - difference).powi(2);
        let variance = mean(around.iter().map(|other| square(other)));
        Some(CellDifference { cell, difference, variance })
    }

    /// True if the centre of a cell lies within the convex hull of the centres of others.
    fn is_surrounded(&self, cell: usize, others: &[&CellDifference]) -> bool {
        let centre = |cell: usize| {
            let [x, y] = self.grid.centre(cell);
            [x / self.grid.side, y / self.grid.side, 0.0]
        };
        let others: Vec<[f64; 3]> = others.iter().map(|other| centre(other.cell)).collect();
        let [x, y, _] = centre(cell);
        surrounds(&others, [x, y])
    }

    /// The sum of a value over cells without a difference, each with the mean of the measured cells within
    /// reach, or of all measured cells if none is.
    pub fn sum_in(&self, cells: &[usize], value: impl Fn(&CellDifference) -> f64 + Sync) -> f64 {
        if self.cells.is_empty() {
            return 0.0;
        }
        let of_all = mean(self.cells.iter().map(&value));
        let of_cell = |cell: &usize| match self.around(*cell, REACH) {
            near if near.is_empty() => of_all,
            near => mean(near.iter().map(|other| value(other))),
        };
        // Summed in the order of the cells, so that the result does not depend on the number of threads.
        cells.par_iter().map(of_cell).collect::<Vec<f64>>().into_iter().sum()
    }
}

/// The mean of at least one value.
fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: CellSurface = CellSurface::Known { height: 0.0, variance: 1e-4 };

    /// The gaps of a row of surfaces, of 9 equal rows, where known cells have a difference of their column.
    fn gaps_of(row: &[CellSurface]) -> (Gaps, f64) {
        let grid = CellGrid { side: 0.1, columns: row.len(), rows: 9 };
        let surface = |cell: usize| row[cell % grid.columns];
        let surfaces: Vec<CellSurface> = (0..grid.len()).map(surface).collect();
        let cells: Vec<CellDifference> = (0..grid.len())
            .filter(|cell| surface(*cell) == KNOWN)
            .map(|cell| CellDifference { cell, difference: (cell % grid.columns) as f64, variance: 1e-4 })
            .collect();
        let measured = MeasuredCells::new(&grid, &cells);
        let gaps = Gaps::of(&grid, &[surfaces.clone(), surfaces], &measured);
        let hidden = measured.sum_in(&gaps.left_out, |cell| cell.difference);
        (gaps, hidden)
    }

    #[test]
    fn gaps_within_reach_of_both_sides_are_filled_and_others_are_left_out() {
        let extrapolated = [CellSurface::Extrapolated; 6];
        // From four columns on, the outer ones are too far from the other side.
        for (width, columns_filled) in (1..).zip([1, 2, 3, 2, 1, 0]) {
            let row = [&[KNOWN; 4][..], &extrapolated[..width], &[KNOWN; 4][..]].concat();
            let (gaps, hidden) = gaps_of(&row);
            assert_eq!(gaps.filled.len(), 9 * columns_filled, "{width}");
            assert_eq!(gaps.left_out.len(), 9 * (width - columns_filled), "{width}");
            assert_eq!(hidden > 0.0, width > columns_filled, "{width}");
            let middle = 4 * row.len() + 4 + width / 2;
            let filled = gaps.filled.iter().find(|filled| filled.cell == middle);
            if let Some(filled) = filled.filter(|_| !width.is_multiple_of(2)) {
                // The differences are those of the columns at both sides.
                let reach = (width as f64 + 1.0) / 2.0;
                assert!((filled.difference - (3.0 + reach)).abs() < 1e-12, "{width}: {filled:?}");
                assert!((filled.variance - reach * reach - 1e-4).abs() < 1e-9, "{width}: {filled:?}");
            }
        }
    }

    #[test]
    fn cells_without_points_of_both_are_left_out_within_measured_cells_alone() {
        let gap = [CellSurface::Missing; 2];
        let inside = gaps_of(&[&[KNOWN; 4][..], &gap[..], &[KNOWN; 4][..]].concat());
        assert_eq!((inside.0.filled.len(), inside.0.left_out.len()), (0, 18));
        // 3 to 6 by column, evenly on both sides.
        assert!((inside.1 / 18.0 - 4.5).abs() < 0.2, "{}", inside.1);
        let outside = gaps_of(&[&[KNOWN; 4][..], &gap[..]].concat());
        assert_eq!((outside.0.filled.len(), outside.0.left_out.len()), (0, 0));
        let nothing = gaps_of(&[CellSurface::Extrapolated; 3]);
        assert_eq!((nothing.0.filled.len(), nothing.0.left_out.len(), nothing.1), (0, 27, 0.0));
    }
}
