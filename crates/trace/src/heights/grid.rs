//! Positions of the vertices of a height field.

use vlscan_geom::{DVec3, Rotation};

/// Placement of the vertices of a height field: numbered by column and row, each with a number for its
/// height.
///
/// A vertex is computed as a program that stores vertices would compute it, operation by operation: its place
/// in the grid and `number · scale + offset`, the transform of the part, its raise, less the scene's shift.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct HeightGrid {
    /// Vertices per row.
    pub columns: usize,
    /// Number of rows.
    pub rows: usize,
    /// Column and row of the first vertex in the grid that this one is a part of; `origin` is that of the
    /// complete grid.
    pub first: [usize; 2],
    /// x and y of the first vertex of the complete grid, m.
    pub origin: [f64; 2],
    /// x and y from a vertex to the next one of its row, m.
    pub of_column: [f64; 2],
    /// x and y from a row to the next one, m.
    pub of_row: [f64; 2],
    /// Height per unit of the numbers, m.
    pub scale: f64,
    /// Height of the number 0, m.
    pub offset: f64,
    /// Applied to every vertex.
    pub transform: Option<Similarity>,
    /// Added to z after the transform, m; −0 leaves every z unchanged, which +0 would not.
    pub raise: f64,
    /// Subtracted last, m.
    pub shift: DVec3,
}

impl HeightGrid {
    /// A grid with this many columns and rows of vertices of 1 m, whose numbers are heights.
    pub fn new(columns: usize, rows: usize) -> HeightGrid {
        HeightGrid {
            columns,
            rows,
            first: [0; 2],
            origin: [0.0; 2],
            of_column: [1.0, 0.0],
            of_row: [0.0, 1.0],
            scale: 1.0,
            offset: 0.0,
            transform: None,
            raise: -0.0,
            shift: DVec3::ZERO,
        }
    }

    /// x and y of a vertex before it is transformed, m.
    #[inline(always)]
    pub fn place(&self, column: usize, row: usize) -> [f64; 2] {
        let (column, row) = ((self.first[0] + column) as f64, (self.first[1] + row) as f64);
        let at = |axis: usize| {
            let (origin, of_column, of_row) = (self.origin[axis], self.of_column[axis], self.of_row[axis]);
            match of_row == 0.0 {
                true => origin + column * of_column,
                false if of_column == 0.0 => origin + row * of_row,
                false => origin + column * of_column + row * of_row,
            }
        };
        [at(0), at(1)]
    }

    /// A vertex whose height has this number.
    #[inline(always)]
    pub fn vertex(&self, column: usize, row: usize, number: f64) -> DVec3 {
        let [x, y] = self.place(column, row);
        self.moved(DVec3::new(x, y, number * self.scale + self.offset))
    }

    #[inline(always)]
    pub(super) fn moved(&self, mut p: DVec3) -> DVec3 {
        if let Some(transform) = self.transform {
            // One without rotation and scale may change the sign of a zero, too.
            p = transform.apply(p);
        }
        DVec3::new(p.x, p.y, p.z + self.raise) - self.shift
    }

    /// True if x depends on the column only and y on the row only.
    #[inline(always)]
    pub(super) fn is_upright(&self) -> bool {
        self.of_row[0] == 0.0 && self.of_column[1] == 0.0
    }

    /// Number of cells per row.
    pub(super) fn cell_columns(&self) -> usize {
        self.columns.saturating_sub(1)
    }

    /// Number of rows of cells.
    pub(super) fn cell_rows(&self) -> usize {
        self.rows.saturating_sub(1)
    }

    /// The transform, if it does more than to translate.
    #[inline(always)]
    pub(super) fn turned(&self) -> Option<&Similarity> {
        self.transform.as_ref().filter(|by| by.rotation != Rotation::IDENTITY || by.scale != 1.0)
    }

    /// Translation, raise and shift together, approximately, m.
    pub(super) fn movement(&self) -> DVec3 {
        self.transform.map_or(DVec3::ZERO, |by| by.offset) + DVec3::Z * self.raise - self.shift
    }

    /// Bound of the numbers that occur when a vertex is computed whose height is at most `height` before it
    /// is moved.
    pub(super) fn magnitude(&self, height: f64) -> f64 {
        let (columns, rows) = ((self.first[0] + self.columns) as f64, (self.first[1] + self.rows) as f64);
        let side =
            |a: usize| self.origin[a].abs() + columns * self.of_column[a].abs() + rows * self.of_row[a].abs();
        let largest = |v: DVec3| v.abs().max_element();
        let reach = side(0).max(side(1)).max(height + self.offset.abs());
        let transformed = self.transform.map_or(0.0, |by| 4.0 * by.scale.abs() * reach + largest(by.offset));
        reach + transformed + self.raise.abs() + largest(self.shift)
    }
}

/// A rotation, scaling and translation: `scale · R · p + offset`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Similarity {
    /// Applied first.
    pub rotation: Rotation,
    /// Factor of all coordinates after the rotation.
    pub scale: f64,
    /// Added last, m.
    pub offset: DVec3,
}

impl Similarity {
    /// A translation, m.
    pub fn translation(offset: DVec3) -> Similarity {
        Similarity { rotation: Rotation::IDENTITY, scale: 1.0, offset }
    }

    /// The image of a point, m.
    #[inline(always)]
    pub fn apply(&self, p: DVec3) -> DVec3 {
        self.linear(p) + self.offset
    }

    /// The image of a vector, which is not translated.
    #[inline(always)]
    pub(super) fn linear(&self, v: DVec3) -> DVec3 {
        self.rotation.apply(v) * self.scale
    }
}
