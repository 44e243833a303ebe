//! The pyramid of least and greatest heights over the cells of a field: nodes with sixteen children, four by
//! four.

use super::{HeightField, HeightGrid, Heights, LEAF_COLUMNS, LEAF_ROWS, RUN, Similarity};
use crate::frame::{Frame, above, below};
use crate::memory::vec_bytes;
use rayon::prelude::*;
use vlscan_geom::{Aabb, DVec3};

/// Children of a node along either axis.
const SIDE: usize = 4;
/// Children of a node.
pub(super) const CHILDREN: usize = SIDE * SIDE;

/// Maximum number of levels: cells are numbered with 32 bits.
const MAX_LEVELS: usize = 16;

/// Maximum number of pending visits: every level leaves up to fifteen.
pub(crate) const MAX_FIELD_STACK: usize = MAX_LEVELS * (CHILDREN - 1) + CHILDREN;

/// Rounding of the boxes of nodes to single precision in the tree's frame, generously rounded up.
const SINGLE: f64 = 1.0 / (1u64 << 22) as f64;

/// Rounding of vertices and boxes in double precision, relative to the largest number that occurs.
const DOUBLE: f64 = 1e-14;

/// The levels of the pyramid, from that of the leaves upwards; the root is above the last one.
#[derive(Clone, Debug)]
pub(super) struct Pyramid {
    levels: Vec<Level>,
}

#[derive(Clone, Debug)]
struct Level {
    columns: usize,
    rows: usize,
    /// Least and greatest height of each node before it is moved, rounded outward; inside out without
    /// triangles.
    ranges: Vec<[f32; 2]>,
}

const NOTHING: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

impl Pyramid {
    pub fn memory(&self) -> usize {
        self.levels.iter().map(|level| vec_bytes(&level.ranges)).sum()
    }

    /// The pyramid over a level of leaves.
    fn over(leaves: Level) -> Pyramid {
        let mut levels = if leaves.ranges.is_empty() { Vec::new() } else { vec![leaves] };
        while let Some(last) = levels.last()
            && last.columns.max(last.rows) > SIDE
        {
            let next = last.parent();
            levels.push(next);
        }
        Pyramid { levels }
    }
}

impl Level {
    fn parent(&self) -> Level {
        let (columns, rows) = (self.columns.div_ceil(SIDE), self.rows.div_ceil(SIDE));
        let mut ranges = vec![NOTHING; columns * rows];
        for (row, children) in self.ranges.chunks(self.columns).enumerate() {
            let parents = &mut ranges[row / SIDE * columns..][..columns];
            for (parent, children) in parents.iter_mut().zip(children.chunks(SIDE)) {
                *parent = children.iter().fold(*parent, |all, child| union(all, *child));
            }
        }
        Level { columns, rows, ranges }
    }
}

#[inline(always)]
fn union(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [if b[0] < a[0] { b[0] } else { a[0] }, if b[1] > a[1] { b[1] } else { a[1] }]
}

/// Result of reading all heights once.
pub(super) struct Built {
    pub pyramid: Pyramid,
    /// Number of missing triangles before each run of cells; empty if none is missing.
    pub missing_before: Vec<u32>,
    pub missing: usize,
    /// Box around all vertices of triangles before they are moved.
    pub bounds: Aabb,
}

/// Reads all heights, on all threads of the pool.
pub(super) fn build(grid: &HeightGrid, heights: &Heights) -> Built {
    let (cell_columns, cell_rows) = (grid.cell_columns(), grid.cell_rows());
    let (columns, rows) = (cell_columns.div_ceil(LEAF_COLUMNS), cell_rows.div_ceil(LEAF_ROWS));
    let runs = cell_columns.div_ceil(RUN);
    let mut ranges = vec![NOTHING; columns * rows];
    let mut missing = vec![0; runs * cell_rows];
    let bounds = ranges
        .par_chunks_mut(columns.max(1))
        .zip(missing.par_chunks_mut((LEAF_ROWS * runs).max(1)))
        .enumerate()
        .map(|(row, (ranges, missing))| build_row(grid, heights, LEAF_ROWS * row, ranges, missing))
        .reduce(|| Aabb::EMPTY, Aabb::union);
    let mut total = 0;
    for count in &mut missing {
        (*count, total) = (total, total + *count);
    }
    Built {
        pyramid: Pyramid::over(Level { columns, rows, ranges }),
        missing_before: if total == 0 { Vec::new() } else { missing },
        missing: total as usize,
        bounds,
    }
}

/// Reads the rows of cells of a row of leaves from number `first` on. Writes the ranges of the leaves and how
/// many triangles of each run are missing; returns the box around all vertices of triangles.
fn build_row(
    grid: &HeightGrid,
    heights: &Heights,
    first: usize,
    ranges: &mut [[f32; 2]],
    missing: &mut [u32],
) -> Aabb {
    let columns = grid.cell_columns();
    let runs = columns.div_ceil(RUN);
    let [mut upper, mut lower] = [0, 1].map(|_| vec![0.0; grid.columns]);
    let mut numbers = vec![[f64::INFINITY, f64::NEG_INFINITY]; ranges.len()];
    let mut bounds = Aabb::EMPTY;
    heights.read(first * grid.columns, &mut lower);
    for row in first..(first + LEAF_ROWS).min(grid.cell_rows()) {
        std::mem::swap(&mut upper, &mut lower);
        heights.read((row + 1) * grid.columns, &mut lower);
        let missing = &mut missing[(row - first) * runs..][..runs];
        // First and last column of the vertices of triangles in either row.
        let mut used = [[usize::MAX, 0]; 2];
        for column in 0..columns {
            let [a, b, c, d] = [upper[column], lower[column], lower[column + 1], upper[column + 1]];
            let [is_first, is_second] = [[a, b, d], [b, c, d]].map(|t| !t.iter().any(|z| z.is_nan()));
            let range = &mut numbers[column / LEAF_COLUMNS];
            let mut add = |z: f64| *range = [range[0].min(z), range[1].max(z)];
            if is_first {
                add(a);
            }
            if is_second {
                add(c);
            }
            if is_first || is_second {
                add(b);
                add(d);
                let [above, below] = &mut used;
                *above = [above[0].min(column + usize::from(!is_first)), column + 1];
                *below = [below[0].min(column), below[1].max(column + usize::from(is_second))];
            }
            missing[column / RUN] += u32::from(!is_first) + u32::from(!is_second);
        }
        for (row, [first, last]) in (row..).zip(used).filter(|(_, used)| used[0] <= used[1]) {
            for [x, y] in [grid.place(first, row), grid.place(last, row)] {
                bounds = bounds.with(DVec3::new(x, y, 0.0));
            }
        }
    }
    let mut heights = [f64::INFINITY, f64::NEG_INFINITY];
    for (range, numbers) in ranges.iter_mut().zip(&numbers).filter(|(_, n)| n[0] <= n[1]) {
        let ends = numbers.map(|number| number * grid.scale + grid.offset);
        let (least, greatest) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        *range = [below(least), above(greatest)];
        heights = [heights[0].min(least), heights[1].max(greatest)];
    }
    if bounds.is_empty() {
        return Aabb::EMPTY;
    }
    Aabb { min: bounds.min.with_z(heights[0]), max: bounds.max.with_z(heights[1]) }
}

/// A node of the pyramid: its level (0 for leaves), column and row in it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FieldNode {
    pub level: u32,
    pub column: u32,
    pub row: u32,
}

impl FieldNode {
    pub const NONE: FieldNode = FieldNode { level: 0, column: 0, row: 0 };

    /// The child in a lane of the node's boxes.
    #[inline(always)]
    pub fn child(self, lane: usize) -> FieldNode {
        FieldNode {
            level: self.level - 1,
            column: self.column * SIDE as u32 + (lane % SIDE) as u32,
            row: self.row * SIDE as u32 + (lane / SIDE) as u32,
        }
    }
}

/// A field in a tree's frame.
pub(crate) struct FieldView<'a> {
    pub field: &'a HeightField,
    pub frame: &'a Frame,
    /// Coordinates of the first vertex at height 0.
    origin: [f64; 3],
    of_column: [f64; 2],
    of_row: [f64; 2],
    /// By how much boxes are widened.
    pub(super) margin: f64,
    /// In place of origin and steps.
    turned: Option<TurnedGrid>,
}

impl<'a> FieldView<'a> {
    #[inline(always)]
    pub fn new(field: &'a HeightField, frame: &'a Frame) -> FieldView<'a> {
        let (grid, scale) = (&field.grid, frame.scale);
        let [x, y] = grid.place(0, 0);
        let height = field.bounds.min.z.abs().max(field.bounds.max.z.abs());
        let magnitude = grid.magnitude(height) + frame.origin.abs().max_element();
        FieldView {
            field,
            frame,
            origin: ((DVec3::new(x, y, 0.0) + grid.movement() - frame.origin) * scale).to_array(),
            of_column: grid.of_column.map(|step| step * scale),
            of_row: grid.of_row.map(|step| step * scale),
            margin: SINGLE + DOUBLE * magnitude * scale,
            turned: grid.turned().map(|by| TurnedGrid::new(field, by, frame)),
        }
    }

    /// The root; `None` for a field without triangles.
    #[inline(always)]
    pub fn root(&self) -> Option<FieldNode> {
        let levels = self.field.pyramid.levels.len() as u32;
        (self.field.triangles() > 0).then_some(FieldNode { level: levels, column: 0, row: 0 })
    }

    /// Starts of the children of a node along both axes and the ends of the last ones, in cells.
    #[inline(always)]
    pub(super) fn cells_of_children(&self, node: FieldNode) -> [[f64; SIDE + 1]; 2] {
        let shift = 2 * (node.level as usize - 1);
        let ends = |first: u32, cells: usize, count: usize| {
            let mut ends = [0.0; SIDE + 1];
            for (n, end) in ends.iter_mut().enumerate() {
                *end = ((first as usize * SIDE + n) * (cells << shift)).min(count) as f64;
            }
            ends
        };
        let grid = &self.field.grid;
        [ends(node.column, LEAF_COLUMNS, grid.cell_columns()), ends(node.row, LEAF_ROWS, grid.cell_rows())]
    }

    /// Calls `visit` with the lane of each child of a node, and with its least and greatest height, inside
    /// out where there is nothing.
    #[inline(always)]
    pub(super) fn each_height(&self, node: FieldNode, mut visit: impl FnMut(usize, [f32; 2])) {
        let level = &self.field.pyramid.levels[node.level as usize - 1];
        let (column, row) = (node.column as usize * SIDE, node.row as usize * SIDE);
        let width = (level.columns - column).min(SIDE);
        for r in 0..(level.rows - row).min(SIDE) {
            let ranges = &level.ranges[(row + r) * level.columns + column..][..width];
            for (c, range) in ranges.iter().enumerate() {
                visit(r * SIDE + c, *range);
            }
        }
    }

    /// The boxes of a node's children, lower and upper corners by axis and lane, in the tree's frame; inside
    /// out where there is nothing.
    #[inline(always)]
    pub fn boxes(&self, node: FieldNode) -> [[[f32; CHILDREN]; 3]; 2] {
        match &self.turned {
            Some(turned) => self.turned_boxes(turned, node),
            None => self.plain_boxes(node),
        }
    }

    /// [`FieldView::boxes`] of a field that is neither rotated nor scaled.
    #[inline(always)]
    fn plain_boxes(&self, node: FieldNode) -> [[[f32; CHILDREN]; 3]; 2] {
        let [columns, rows] = self.cells_of_children(node);
        let mut boxes = [[[f32::INFINITY; CHILDREN]; 3], [[f32::NEG_INFINITY; CHILDREN]; 3]];
        let [lower, upper] = &mut boxes;
        for axis in 0..2 {
            let between = |ends: &[f64; SIDE + 1], step: f64, n: usize| {
                let (a, b) = (ends[n] * step, ends[n + 1] * step);
                if a < b { (a, b) } else { (b, a) }
            };
            let (low, high) = (self.origin[axis] - self.margin, self.origin[axis] + self.margin);
            for r in 0..SIDE {
                let of_row = between(&rows, self.of_row[axis], r);
                for c in 0..SIDE {
                    let of_column = between(&columns, self.of_column[axis], c);
                    lower[axis][r * SIDE + c] = (low + of_row.0 + of_column.0) as f32;
                    upper[axis][r * SIDE + c] = (high + of_row.1 + of_column.1) as f32;
                }
            }
        }
        let (low, high) = (self.origin[2] - self.margin, self.origin[2] + self.margin);
        self.each_height(node, |lane, range| {
            lower[2][lane] = (low + f64::from(range[0]) * self.frame.scale) as f32;
            upper[2][lane] = (high + f64::from(range[1]) * self.frame.scale) as f32;
        });
        boxes
    }
}

/// The grid of a field in a tree's frame.
struct TurnedGrid {
    /// The first vertex at height 0.
    origin: DVec3,
    /// From a column, from a row and from a height to the next one.
    steps: [DVec3; 3],
    /// The box of the field.
    bounds: [DVec3; 2],
}

impl TurnedGrid {
    fn new(field: &HeightField, by: &Similarity, frame: &Frame) -> TurnedGrid {
        let grid = &field.grid;
        let [x, y] = grid.place(0, 0);
        let flat = |[x, y]: [f64; 2]| DVec3::new(x, y, 0.0);
        let steps = [flat(grid.of_column), flat(grid.of_row), DVec3::Z];
        let bounds = field.bounds();
        TurnedGrid {
            origin: frame.local(grid.moved(DVec3::new(x, y, 0.0))),
            steps: steps.map(|step| by.linear(step) * frame.scale),
            bounds: [frame.local(bounds.min), frame.local(bounds.max)],
        }
    }
}

impl FieldView<'_> {
    /// [`FieldView::boxes`] of a field that is rotated or scaled: around the images of the children's boxes.
    #[inline(never)]
    fn turned_boxes(&self, turned: &TurnedGrid, node: FieldNode) -> [[[f32; CHILDREN]; 3]; 2] {
        let [columns, rows] = self.cells_of_children(node);
        let mut boxes = [[[f32::INFINITY; CHILDREN]; 3], [[f32::NEG_INFINITY; CHILDREN]; 3]];
        self.each_height(node, |lane, [least, greatest]| {
            if least > greatest {
                return;
            }
            let (c, r) = (lane % SIDE, lane / SIDE);
            let ranges =
                [[columns[c], columns[c + 1]], [rows[r], rows[r + 1]], [least, greatest].map(f64::from)];
            let [mut low, mut high] = [turned.origin - self.margin, turned.origin + self.margin];
            for (step, [from, to]) in turned.steps.iter().zip(ranges) {
                let ends = [*step * from, *step * to];
                low += ends[0].min(ends[1]);
                high += ends[0].max(ends[1]);
            }
            // Images of boxes extend beyond the triangles.
            low = low.max(turned.bounds[0] - self.margin);
            high = high.min(turned.bounds[1] + self.margin);
            for axis in 0..3 {
                boxes[0][axis][lane] = low[axis] as f32;
                boxes[1][axis][lane] = high[axis] as f32;
            }
        });
        boxes
    }
}
