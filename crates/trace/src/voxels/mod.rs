//! Grids of voxels: cubes on a regular grid that are stored as their cells.
//!
//! A grid has the cubes that a program which stores cubes would have, with exactly their centres and sizes;
//! they are computed when they are tested. Over the cells is a sparse hierarchy of boxes with sixteen
//! children each, by which rays find the cells that they may hit; like trees it only chooses the tested
//! cells.
//!
//! | file | contents |
//! |---|---|
//! | `place` | where the cubes are |
//! | `cells` | the occupied cells, in the order of their numbers |
//! | `hierarchy` | the hierarchy over the cells |
//! | `view` | boxes of nodes and cells in the frame of a tree |
//! | `single` | tracing of single rays |

mod cells;
mod hierarchy;
mod place;
mod single;
#[cfg(test)]
mod tests;
mod view;

pub use cells::{CellLayout, VoxelCells};
pub(crate) use hierarchy::{GridNode, MAX_GRID_STACK};
pub use place::GridPlace;
pub(crate) use view::GridView;

use crate::Cube;
use hierarchy::Hierarchy;
use std::ops::Range;
use vlscan_geom::Aabb;

/// Cubes of one size on a regular grid, numbered row by row.
#[derive(Clone, Debug)]
pub struct VoxelGrid {
    place: GridPlace,
    cells: VoxelCells,
    /// Index of the first voxel among the cubes of its geometry.
    first: u32,
    hierarchy: Hierarchy,
    /// Lowest and highest occupied cell along each axis.
    extent: [[u32; 3]; 2],
}

impl VoxelGrid {
    /// A grid with a cube in each of the cells, whose first has index `first` among the cubes of its
    /// geometry; `None` without cells, or if there are more than can be numbered with 32 bits. Uses all
    /// threads of the current pool.
    pub fn new(place: GridPlace, mut cells: VoxelCells, first: usize) -> Option<VoxelGrid> {
        let end = cells.len().checked_add(first)?;
        if cells.is_empty() || end >= u32::MAX as usize {
            return None;
        }
        cells.complete();
        let (hierarchy, extent) = (Hierarchy::over(&cells), cells.extent());
        Some(VoxelGrid { place, cells, first: first as u32, hierarchy, extent })
    }

    /// Placement of the cubes.
    pub fn place(&self) -> &GridPlace {
        &self.place
    }

    /// Changes where the cubes are.
    pub fn place_mut(&mut self) -> &mut GridPlace {
        &mut self.place
    }

    /// The occupied cells.
    pub fn cells(&self) -> &VoxelCells {
        &self.cells
    }

    /// Index of the first voxel among the cubes of the geometry.
    pub fn first(&self) -> u32 {
        self.first
    }

    /// Indices of the voxels among the cubes of the geometry.
    pub fn indices(&self) -> Range<usize> {
        self.first as usize..self.first as usize + self.len()
    }

    /// Number of voxels, at least one.
    #[expect(clippy::len_without_is_empty, reason = "a grid without voxels cannot be made")]
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// The cube of voxel `i`, counted from the grid's first.
    #[inline]
    pub fn cube(&self, i: usize) -> Cube {
        self.place.cube(self.cells.cell(i))
    }

    /// All cubes in the order of their numbers.
    pub fn cubes(&self) -> impl Iterator<Item = Cube> {
        self.cells.iter().map(|cell| self.place.cube(cell))
    }

    /// The box around all cubes, exactly that of their corners.
    pub fn bounds(&self) -> Aabb {
        // Every operation on centres keeps their order along each axis.
        let [low, high] = self.extent.map(|cell| self.place.cube(cell).bounds());
        low.union(high)
    }

    /// Memory of cells and hierarchy, bytes.
    pub fn memory(&self) -> usize {
        size_of::<VoxelGrid>() + self.cells.memory() + self.hierarchy.memory()
    }
}
