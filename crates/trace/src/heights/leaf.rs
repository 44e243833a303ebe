//! The cells of a leaf as a block of triangles, which is computed when a leaf is visited.

#![expect(clippy::needless_range_loop, reason = "lanes of several arrays are counted together")]

use super::{FieldNode, FieldView, HeightField, LEAF_COLUMNS, LEAF_ROWS};
use crate::Hits;
use crate::block::{BLOCK_SIZE, Block};
use vlscan_geom::DVec3;

/// Vertices per row of a leaf.
const ACROSS: usize = LEAF_COLUMNS + 1;
/// Rows of vertices of a leaf.
const DOWN: usize = LEAF_ROWS + 1;
/// Room for the vertices of a leaf.
pub(crate) const LEAF_VERTICES: usize = 16;
const _: () = assert!(ACROSS * DOWN <= LEAF_VERTICES && 2 * LEAF_COLUMNS * LEAF_ROWS == BLOCK_SIZE);

/// Vertex numbers, within the leaf, of each corner of the triangle in each lane.
const CORNERS: [[u32; BLOCK_SIZE]; 3] = corners();

const fn corners() -> [[u32; BLOCK_SIZE]; 3] {
    let mut all = [[0; BLOCK_SIZE]; 3];
    let mut lane = 0;
    while lane < BLOCK_SIZE {
        let cell = lane / 2;
        let a = (cell / LEAF_COLUMNS * ACROSS + cell % LEAF_COLUMNS) as u32;
        let (b, c, d) = (a + ACROSS as u32, a + ACROSS as u32 + 1, a + 1);
        let triangle = if lane.is_multiple_of(2) { [a, b, d] } else { [b, c, d] };
        let mut corner = 0;
        while corner < 3 {
            all[corner][lane] = triangle[corner];
            corner += 1;
        }
        lane += 1;
    }
    all
}

impl FieldView<'_> {
    /// Computes the triangles of a leaf as a block whose vertex numbers count from `base`, and their
    /// vertices. Returns false if all of them are missing; then block and vertices are unspecified.
    #[inline(always)]
    pub fn fill(&self, leaf: FieldNode, base: u32, block: &mut Block, vertices: &mut [DVec3]) -> bool {
        let Some(vertices) = vertices.first_chunk_mut() else { return false };
        let (column, row) = (leaf.column as usize * LEAF_COLUMNS, leaf.row as usize * LEAF_ROWS);
        let is_whole = self.field.vertices_of(column, row, vertices);
        let mut local = [[0.0f32; LEAF_VERTICES]; 3];
        for (v, p) in vertices.iter().enumerate() {
            let p = self.frame.local(*p).to_array();
            for axis in 0..3 {
                local[axis][v] = p[axis] as f32;
            }
        }
        if !is_whole {
            return self.fill_some((column, row), base, block, &local);
        }
        for corner in 0..3 {
            for lane in 0..BLOCK_SIZE {
                let v = CORNERS[corner][lane] as usize;
                block.vertex[corner][lane] = base + v as u32;
                for axis in 0..3 {
                    block.corner[corner][axis][lane] = local[axis][v];
                }
            }
        }
        let first = self.field.first + 2 * (row * self.field.grid.cell_columns() + column) as u32;
        let below = first + 2 * self.field.grid.cell_columns() as u32;
        for lane in 0..BLOCK_SIZE / 2 {
            block.id[lane] = first + lane as u32;
            block.id[BLOCK_SIZE / 2 + lane] = below + lane as u32;
        }
        true
    }

    /// [`FieldView::fill`] for a leaf from which triangles are missing: the others come first.
    #[cold]
    fn fill_some(
        &self,
        (column, row): (usize, usize),
        base: u32,
        block: &mut Block,
        local: &[[f32; LEAF_VERTICES]; 3],
    ) -> bool {
        *block = Block::EMPTY;
        let (columns, rows) = (self.field.grid.cell_columns(), self.field.grid.cell_rows());
        let mut filled = 0;
        for lane in 0..BLOCK_SIZE {
            let cell = lane / 2;
            let (column, row) = (column + cell % LEAF_COLUMNS, row + cell / LEAF_COLUMNS);
            let corners = [0, 1, 2].map(|corner| CORNERS[corner][lane]);
            let is_missing = corners.iter().any(|&v| local[2][v as usize].is_nan());
            if column >= columns || row >= rows || is_missing {
                continue;
            }
            block.id[filled] = self.field.first + (2 * (row * columns + column) + lane % 2) as u32;
            for (corner, v) in corners.into_iter().enumerate() {
                block.vertex[corner][filled] = base + v;
                for axis in 0..3 {
                    block.corner[corner][axis][filled] = local[axis][v as usize];
                }
            }
            filled += 1;
        }
        debug_assert!(block.id[filled..].iter().all(|id| *id == Hits::MISS));
        filled > 0
    }
}

impl HeightField {
    /// Computes the vertices of a leaf from its first column and row. Returns whether all of them are there.
    #[inline(always)]
    fn vertices_of(&self, column: usize, row: usize, vertices: &mut [DVec3; LEAF_VERTICES]) -> bool {
        let grid = &self.grid;
        let mut numbers = [[f64::NAN; ACROSS]; DOWN];
        let is_inner = column + ACROSS <= grid.columns && row + DOWN <= grid.rows;
        if is_inner {
            for (r, numbers) in numbers.iter_mut().enumerate() {
                self.heights.read((row + r) * grid.columns + column, numbers);
            }
        } else {
            let width = (grid.columns - column).min(ACROSS);
            for (r, numbers) in numbers.iter_mut().enumerate().take(grid.rows - row) {
                self.heights.read((row + r) * grid.columns + column, &mut numbers[..width]);
            }
        }
        let mut sum = 0.0;
        if grid.is_upright() && grid.transform.is_none() {
            let mut x = [0.0; ACROSS];
            for (c, x) in x.iter_mut().enumerate() {
                *x = grid.place(column + c, row)[0] - grid.shift.x;
            }
            for (r, numbers) in numbers.iter().enumerate() {
                let y = grid.place(column, row + r)[1] - grid.shift.y;
                for (c, number) in numbers.iter().enumerate() {
                    let z = number * grid.scale + grid.offset + grid.raise - grid.shift.z;
                    vertices[r * ACROSS + c] = DVec3::new(x[c], y, z);
                    sum += z;
                }
            }
        } else {
            for (r, numbers) in numbers.iter().enumerate() {
                for (c, number) in numbers.iter().enumerate() {
                    let p = grid.vertex(column + c, row + r, *number);
                    vertices[r * ACROSS + c] = p;
                    sum += p.z;
                }
            }
        }
        is_inner && !sum.is_nan()
    }
}
