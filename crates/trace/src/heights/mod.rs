//! Height fields: terrain on a regular grid that is stored as its heights.
//!
//! A field has the triangles that a mesh over its vertices would have, two per cell, with exactly the corners
//! that such a mesh would store; they are computed when they are tested. Over the cells is a pyramid of least
//! and greatest heights (maximum mipmaps, Tevs, Ihrke and Seidel 2008), by which rays find the cells that
//! they may hit; like trees it only chooses the tested cells.
//!
//! | file | contents |
//! |---|---|
//! | `grid` | positions of vertices |
//! | `numbers` | heights as they are stored |
//! | `pyramid` | the pyramid, and the boxes of its nodes |
//! | `leaf` | the triangles of some cells as a block |
//! | `turned` | fields that are rotated or scaled |
//! | `boxes` | the hierarchy over the boxes of several fields |
//! | `single` | tracing of single rays |

mod boxes;
mod grid;
mod leaf;
mod numbers;
mod pyramid;
mod single;
#[cfg(test)]
mod tests;
mod turned;

pub(crate) use boxes::{BoxNode, FieldBoxes, MAX_BOX_STACK};
pub use grid::{HeightGrid, Similarity};
pub(crate) use leaf::LEAF_VERTICES;
pub use numbers::Heights;
pub(crate) use pyramid::{FieldNode, FieldView, MAX_FIELD_STACK};

use crate::memory::vec_bytes;
use pyramid::Pyramid;
use std::ops::Range;
use vlscan_geom::{Aabb, DVec3};

/// Cells per row in a leaf.
const LEAF_COLUMNS: usize = 4;
/// Rows of cells in a leaf.
const LEAF_ROWS: usize = 2;
/// Cells in a run for whose first the number of missing triangles before it is known.
const RUN: usize = 16;

/// Terrain on a regular grid: two triangles between each four vertices, of which those with a corner without
/// data are missing.
///
/// With `a` a vertex, `b` the one below it in the next row, `c` the one after `b` and `d` the one after `a`,
/// triangle `2 · (row · (columns − 1) + column)` is `[a, b, d]` and the next number is `[b, c, d]`. Missing
/// triangles have numbers, too.
#[derive(Clone, Debug)]
pub struct HeightField {
    grid: HeightGrid,
    heights: Heights,
    /// Number of the first triangle in its geometry.
    first: u32,
    pyramid: Pyramid,
    /// Number of missing triangles before each run of cells, row by row; empty if none is missing.
    missing_before: Vec<u32>,
    missing: usize,
    /// Box around the vertices of triangles as far as they are placed in the grid: neither transformed nor
    /// raised nor shifted.
    bounds: Aabb,
    /// Box around the vertices of triangles after the transform, neither raised nor shifted.
    transformed: Aabb,
}

impl HeightField {
    /// A field whose first triangle has number `first` in its geometry; `None` if there are not as many
    /// heights as vertices, or more triangles than can be numbered with 32 bits. Uses all threads of the
    /// current pool.
    pub fn new(grid: HeightGrid, heights: Heights, first: usize) -> Option<HeightField> {
        let cells = grid.cell_columns().checked_mul(grid.cell_rows())?;
        let end = cells.checked_mul(2)?.checked_add(first)?;
        if grid.columns.checked_mul(grid.rows)? != heights.len() || end >= u32::MAX as usize {
            return None;
        }
        let built = pyramid::build(&grid, &heights);
        let mut field = HeightField {
            grid,
            heights,
            first: first as u32,
            pyramid: built.pyramid,
            missing_before: built.missing_before,
            missing: built.missing,
            bounds: built.bounds,
            transformed: built.bounds,
        };
        field.transformed = field.find_transformed_bounds();
        Some(field)
    }

    /// Positions of the vertices.
    pub fn grid(&self) -> &HeightGrid {
        &self.grid
    }

    /// Heights of the vertices.
    pub fn heights(&self) -> &Heights {
        &self.heights
    }

    /// Number of the first triangle in the geometry.
    pub fn first(&self) -> u32 {
        self.first
    }

    /// Numbers of the triangles in the geometry, also of those that are missing.
    pub fn numbers(&self) -> Range<usize> {
        self.first as usize..self.first as usize + self.len()
    }

    /// How many numbers triangles have, also those that are missing.
    pub fn len(&self) -> usize {
        2 * self.grid.cell_columns() * self.grid.cell_rows()
    }

    /// True if there are no cells.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How many triangles there are.
    pub fn triangles(&self) -> usize {
        self.len() - self.missing
    }

    /// How many of the first `count` triangles are missing.
    pub fn missing_before(&self, count: usize) -> usize {
        if self.missing == 0 {
            return 0;
        }
        if count >= self.len() {
            return self.missing;
        }
        let (cell, columns) = (count / 2, self.grid.cell_columns());
        let (row, column) = (cell / columns, cell % columns);
        let run = column / RUN;
        let known = self.missing_before[row * columns.div_ceil(RUN) + run] as usize;
        let from = 2 * (row * columns + run * RUN);
        known + (from..count).filter(|&i| self.is_missing(i)).count()
    }

    /// True if triangle `i`, counted from the field's first, has a corner without data.
    fn is_missing(&self, i: usize) -> bool {
        let columns = self.grid.cell_columns();
        let a = i / 2 / columns * self.grid.columns + i / 2 % columns;
        let b = a + self.grid.columns;
        let other = if i.is_multiple_of(2) { a } else { b + 1 };
        [b, a + 1, other].iter().any(|&v| self.heights.get(v).is_nan())
    }

    /// The corners of triangle `i`, counted from the field's first; `None` if it is missing.
    #[inline]
    pub fn triangle(&self, i: usize) -> Option<[DVec3; 3]> {
        let (cell, columns) = (i / 2, self.grid.cell_columns());
        let (row, column) = (cell / columns, cell % columns);
        let vertex = |below: usize, right: usize| {
            let (column, row) = (column + right, row + below);
            let number = self.heights.get(row * self.grid.columns + column);
            (!number.is_nan()).then(|| self.grid.vertex(column, row, number))
        };
        let (b, d) = (vertex(1, 0)?, vertex(0, 1)?);
        match i.is_multiple_of(2) {
            true => Some([vertex(0, 0)?, b, d]),
            false => Some([b, vertex(1, 1)?, d]),
        }
    }

    /// The box around all triangles, exactly that of their corners.
    pub fn bounds(&self) -> Aabb {
        if self.transformed.is_empty() {
            return Aabb::EMPTY;
        }
        // Raise and shift keep the order of vertices along every axis.
        let moved = HeightGrid { transform: None, ..self.grid };
        Aabb { min: moved.moved(self.transformed.min), max: moved.moved(self.transformed.max) }
    }

    /// The numbers, counted from the field's first, of all triangles above or below a place, and of some
    /// beside it.
    pub fn triangles_near(&self, x: f64, y: f64) -> impl Iterator<Item = usize> {
        let turned = self.grid.turned().map(|_| self.turned_triangles_near(x, y));
        let plain = turned.is_none().then(|| self.plain_triangles_near(x, y));
        plain.into_iter().flatten().chain(turned.into_iter().flatten())
    }

    /// [`HeightField::triangles_near`] of a field that is neither rotated nor scaled.
    fn plain_triangles_near(&self, x: f64, y: f64) -> impl Iterator<Item = usize> + use<> {
        let (columns, rows) = (self.grid.cell_columns(), self.grid.cell_rows());
        let (origin, HeightGrid { of_column: [a, c], of_row: [b, d], .. }) =
            (self.grid.place(0, 0), self.grid);
        let moved = self.grid.movement();
        let (x, y) = (x - moved.x - origin[0], y - moved.y - origin[1]);
        let determinant = a * d - b * c;
        let (column, row) = ((x * d - y * b) / determinant, (y * a - x * c) / determinant);
        // Casts of NaN and of numbers out of range end at the border of the grid.
        let near = |at: f64, count: usize| {
            let at = at.clamp(-4.0, count as f64 + 4.0) as i64;
            (at - 2).max(0) as usize..((at + 3).max(0) as usize).min(count)
        };
        let (near_columns, near_rows) = (near(column, columns), near(row, rows));
        near_rows.flat_map(move |row| {
            near_columns.clone().flat_map(move |column| [0, 1].map(|k| 2 * (row * columns + column) + k))
        })
    }

    /// Transforms all vertices, which must not have been transformed, raised or shifted before.
    pub fn transform(&mut self, by: Similarity) {
        self.grid.transform = Some(by);
        self.transformed = self.find_transformed_bounds();
    }

    /// Moves all vertices up, m, after their transform.
    pub fn raise(&mut self, by: f64) {
        self.grid.raise = by;
    }

    /// Subtracts `shift`, m, from all vertices, last.
    pub fn shift(&mut self, shift: DVec3) {
        self.grid.shift = shift;
    }

    /// Sets the number of the first triangle in the geometry.
    pub fn number_from(&mut self, first: u32) {
        self.first = first;
    }

    /// Memory of heights and pyramid, bytes.
    pub fn memory(&self) -> usize {
        size_of::<HeightField>()
            + self.heights.memory()
            + self.pyramid.memory()
            + vec_bytes(&self.missing_before)
    }
}
