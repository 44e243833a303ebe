//! Checks the cells of a voxel file as a whole: missing cells and densities that no plant has.

use crate::text::Problems;
use std::ops::Range;

/// Plant area density above which a value is probably a mistake, 1/m: dense hedges have about 20.
const MAX_USUAL_DENSITY: f64 = 1000.0;

/// Columns and limits that all rows of a file share.
#[derive(Debug, Default)]
pub(super) struct CellCheck {
    /// Number of rows.
    rows: u64,
    /// Rows without plants: files that list these list all cells.
    empty: u64,
    /// Rows with more or fewer values than the first one.
    other_widths: u64,
    /// Rows without a density.
    unknown: u64,
    /// Rows with an unusual density, and the highest one.
    dense: (u64, f64),
    /// Highest number of a cell if the last, and if the first index changes fastest.
    highest: [u64; 2],
    /// Sums of the first of these numbers and of their squares, modulo 2^64.
    sums: [u64; 2],
    /// True if a cell is outside of the grid.
    has_outside: bool,
    /// Rows with the cell of the row before.
    repeated: u64,
    last: Option<[u32; 3]>,
}

impl CellCheck {
    /// Adds a row: its cell and density, if it could be read.
    pub fn add(&mut self, split: [f64; 3], row: Option<([u32; 3], f64)>) {
        self.rows += 1;
        let Some((index, density)) = row else { return };
        self.empty += u64::from(density == 0.0);
        self.unknown += u64::from(density.is_nan());
        if density > MAX_USUAL_DENSITY {
            self.dense = (self.dense.0 + 1, self.dense.1.max(density));
        }
        let ([i, j, k], [x, y, z]) = (index.map(u64::from), split.map(|count| count as u64));
        let number = |a: u64, (b, of_b): (u64, u64), (c, of_c): (u64, u64)| {
            a.saturating_mul(of_b).saturating_add(b).saturating_mul(of_c).saturating_add(c)
        };
        let numbers = [number(i, (j, y), (k, z)), number(k, (j, y), (i, x))];
        self.highest = [0, 1].map(|order| self.highest[order].max(numbers[order]));
        let [sum, squares] = self.sums;
        let square = numbers[0].wrapping_mul(numbers[0]);
        self.sums = [sum.wrapping_add(numbers[0]), squares.wrapping_add(square)];
        self.has_outside |= i >= x || j >= y || k >= z;
        self.repeated += u64::from(self.last.replace(index) == Some(index));
    }

    /// Counts a row with more or fewer values than the first one.
    pub fn add_other_width(&mut self) {
        self.other_widths += 1;
    }

    /// Adds the rows of the next piece of the file.
    pub fn append(&mut self, later: CellCheck) {
        self.rows += later.rows;
        self.empty += later.empty;
        self.other_widths += later.other_widths;
        self.unknown += later.unknown;
        self.dense = (self.dense.0 + later.dense.0, self.dense.1.max(later.dense.1));
        self.highest = [0, 1].map(|order| self.highest[order].max(later.highest[order]));
        self.sums = [0, 1].map(|power| self.sums[power].wrapping_add(later.sums[power]));
        self.has_outside |= later.has_outside;
        self.repeated += later.repeated;
    }

    /// True if the rows, as many as there are cells, do not contain each cell once, by their sums.
    fn is_incomplete(&self, cells: u64) -> bool {
        let count = u128::from(self.rows);
        let expected = [count * count.saturating_sub(1) / 2, squares_below(count)];
        self.rows == cells && !self.has_outside && expected.map(|sum| sum as u64) != self.sums
    }

    /// A note about cells without a density, which voxels of measurements have where no beam was.
    pub fn note(&self) -> Option<String> {
        let cells = if self.unknown == 1 { "cell has" } else { "cells have" };
        (self.unknown > 0).then(|| format!("{} {cells} no density (NaN)", self.unknown))
    }

    /// Warns of doubtful values, at the end of the file.
    pub fn report(&self, split: [f64; 3], line: usize, at: Range<usize>, problems: &mut Problems) {
        if self.rows == 0 {
            return problems.warn(line, at, || "the file has no voxels".to_owned());
        }
        let cells = split.iter().map(|count| *count as u64).fold(1, u64::saturating_mul);
        // Files may list cells with plants only. Those that list empty cells, or cells without a gap, are
        // meant to be complete.
        let [x, y, z] = split.map(|count| count as u64);
        let are_without_gap =
            |order: usize, run: u64| self.rows > run && self.highest[order] == self.rows - 1;
        let lists_all = self.empty > 0 || are_without_gap(0, z) || are_without_gap(1, x.saturating_mul(y));
        if self.rows > cells || self.rows < cells && lists_all {
            problems.warn(line, at.clone(), || {
                let rest =
                    if self.rows < cells { "; the others are empty. Is the file truncated?" } else { "" };
                format!("the file has {} of the {cells} cells of #split{rest}", self.rows)
            });
        }
        if self.repeated > 0 || self.is_incomplete(cells) {
            problems.warn(line, at.clone(), || match self.repeated {
                0 => "some cells occur twice, and others are missing".to_owned(),
                1 => "1 row has the cell of the row before".to_owned(),
                count => format!("{count} rows have the cell of the row before"),
            });
        }
        if self.other_widths > 0 {
            problems.warn(line, at.clone(), || {
                let rows = if self.other_widths == 1 { "row has" } else { "rows have" };
                format!("{} {rows} more or fewer values than the first row", self.other_widths)
            });
        }
        if self.dense.0 > 0 {
            problems.warn(line, at, || {
                let (count, highest) = self.dense;
                let cells = if count == 1 { "cell has a density" } else { "cells have densities" };
                format!(
                    "{count} {cells} above {MAX_USUAL_DENSITY} m²/m³, up to {highest:e}; expected plant area \
                     density"
                )
            });
        }
    }
}

/// Sum of the squares of the numbers below `count`.
fn squares_below(count: u128) -> u128 {
    // As many rows as a file can have do not overflow.
    count.saturating_mul(count.saturating_sub(1)).saturating_mul((2 * count).saturating_sub(1)) / 6
}
