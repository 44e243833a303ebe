//! Boxes of nodes and of cells in the frame of a tree.

use super::hierarchy::{Children, ROW_CELLS};
use super::{GridNode, VoxelGrid};
use crate::Cube;
use crate::block::BLOCK_SIZE;
use crate::frame::Frame;
use std::ops::Range;

const _: () = assert!(ROW_CELLS == BLOCK_SIZE);

/// Rounding of boxes in single precision in the tree's frame, where all voxels lie between -1 and 1: of a
/// corner, of its distance from that of the first child, and of their sum, generously rounded up. Corners
/// beyond are at least a cell away from all voxels.
const SINGLE: f64 = 1.0 / (1u64 << 21) as f64;

/// Rounding of cubes and boxes in double precision, relative to the largest number that occurs.
const DOUBLE: f64 = 1e-14;

/// A grid in a tree's frame. Arrays of three are by the axes of the grid, from that along which numbers
/// advance most slowly to that of rows.
pub(crate) struct GridView<'a> {
    pub grid: &'a VoxelGrid,
    /// Axes of the scene.
    axes: [usize; 3],
    /// Lower and upper corner of the cube in cell 0, widened.
    lower: [f64; 3],
    upper: [f64; 3],
    step: f64,
    /// Number of cells across the rows.
    mid: usize,
}

/// The children of a node with their boxes: lower and upper corners by axis of the scene and lane.
pub(crate) struct BoxedChildren<'a> {
    children: Children<'a>,
    pub lower: [[f32; BLOCK_SIZE]; 3],
    pub upper: [[f32; BLOCK_SIZE]; 3],
}

impl BoxedChildren<'_> {
    /// The lanes of children that have voxels.
    #[inline(always)]
    pub fn mask(&self) -> u32 {
        self.children.mask
    }

    /// The child in a lane of the mask.
    #[inline(always)]
    pub fn child(&self, lane: usize) -> GridNode {
        self.children.child(lane)
    }
}

/// The voxels of a row within a brick with their boxes.
pub(crate) struct BoxedRow<'a> {
    along: &'a [u16],
    base: [u32; 3],
    axes: [usize; 3],
    /// Number of the first voxel among those of the grid.
    pub first: usize,
    pub lower: [[f32; BLOCK_SIZE]; 3],
    pub upper: [[f32; BLOCK_SIZE]; 3],
}

impl BoxedRow<'_> {
    /// The lanes with voxels.
    #[inline(always)]
    pub fn mask(&self) -> u32 {
        (1 << self.along.len()) - 1
    }

    /// The axis of the scene along which the row runs.
    #[inline(always)]
    pub fn axis(&self) -> usize {
        self.axes[2]
    }

    /// The cube in a lane of the mask.
    #[inline(always)]
    pub fn cube(&self, grid: &VoxelGrid, lane: usize) -> Cube {
        let mut cell = [0; 3];
        cell[self.axes[0]] = self.base[0];
        cell[self.axes[1]] = self.base[1];
        cell[self.axes[2]] = u32::from(self.along[lane]);
        grid.place.cube(cell)
    }
}

impl<'a> GridView<'a> {
    #[inline(always)]
    pub fn new(grid: &'a VoxelGrid, frame: &Frame) -> GridView<'a> {
        let (place, cells) = (&grid.place, &grid.cells);
        let magnitude = place.magnitude(cells.max_count()) + frame.origin.abs().max_element();
        let margin = SINGLE + DOUBLE * magnitude * frame.scale;
        let Cube { centre, half } = place.cube([0; 3]);
        let axes = cells.order();
        let [lower, upper] = [frame.local(centre - half) - margin, frame.local(centre + half) + margin];
        GridView {
            grid,
            axes,
            lower: axes.map(|axis| lower[axis]),
            upper: axes.map(|axis| upper[axis]),
            step: place.step() * frame.scale,
            mid: cells.dimensions()[1] as usize,
        }
    }

    #[inline(always)]
    pub fn root(&self) -> GridNode {
        self.grid.hierarchy.root()
    }

    /// The children of a node that is not a row.
    #[inline(always)]
    pub fn children(&self, node: GridNode) -> BoxedChildren<'a> {
        let children = self.grid.hierarchy.children(node);
        let (mut lower, mut upper) = ([[0.0; BLOCK_SIZE]; 3], [[0.0; BLOCK_SIZE]; 3]);
        for axis in [0, 1, 2] {
            let (log, _) = children.logs(axis);
            let (cells, base) = (f64::from(1u32 << log), f64::from(node.base[axis]));
            let low = (self.lower[axis] + base * self.step) as f32;
            let high = (self.upper[axis] + (base + (cells - 1.0)) * self.step) as f32;
            let side = (cells * self.step) as f32;
            let [lower, upper] = [&mut lower[self.axes[axis]], &mut upper[self.axes[axis]]];
            for (lane, place) in children.places(axis).iter().enumerate() {
                lower[lane] = low + place * side;
                upper[lane] = high + place * side;
            }
        }
        BoxedChildren { children, lower, upper }
    }

    /// The voxels of a row.
    #[inline(always)]
    pub fn row(&self, node: GridNode) -> BoxedRow<'a> {
        let cells = &self.grid.cells;
        let [slow, mid, along] = node.base;
        let numbers = cells.numbers_of(slow as usize * self.mid + mid as usize);
        let Range { start, end } = within_row(cells.along(numbers.clone()), along);
        let numbers = numbers.start + start..numbers.start + end;
        let along = cells.along(numbers.clone());
        let (mut lower, mut upper) = ([[0.0; BLOCK_SIZE]; 3], [[0.0; BLOCK_SIZE]; 3]);
        for (axis, at) in [slow, mid].into_iter().enumerate() {
            let by = f64::from(at) * self.step;
            lower[self.axes[axis]] = [(self.lower[axis] + by) as f32; BLOCK_SIZE];
            upper[self.axes[axis]] = [(self.upper[axis] + by) as f32; BLOCK_SIZE];
        }
        let mut at = [0.0; BLOCK_SIZE];
        for (to, along) in at.iter_mut().zip(along) {
            *to = f64::from(*along);
        }
        let [low, high] = [&mut lower[self.axes[2]], &mut upper[self.axes[2]]];
        for lane in 0..BLOCK_SIZE {
            let by = at[lane] * self.step;
            low[lane] = (self.lower[2] + by) as f32;
            high[lane] = (self.upper[2] + by) as f32;
        }
        BoxedRow { along, base: node.base, axes: self.axes, first: numbers.start, lower, upper }
    }
}

/// The voxels of a row, whose positions are these, within the sixteen cells from `first` on.
#[inline(always)]
fn within_row(along: &[u16], first: u32) -> Range<usize> {
    let end = first + ROW_CELLS as u32;
    let Some(low) = along.first().map(|low| u32::from(*low)) else { return 0..0 };
    // Where no voxel is missing, the first one is as many voxels from the row's first as cells.
    let guess = first.saturating_sub(low) as usize;
    let is_there = along.get(guess).is_some_and(|at| u32::from(*at) == first);
    let start = if is_there || low >= first {
        guess
    } else {
        // There are at most as many voxels before it as cells.
        along[..guess.min(along.len())].partition_point(|at| u32::from(*at) < first)
    };
    let rest = &along[start..along.len().min(start + ROW_CELLS)];
    let count = match rest.last() {
        Some(last) if u32::from(*last) < end => rest.len(),
        _ => rest.iter().take_while(|at| u32::from(**at) < end).count(),
    };
    start..start + count
}
