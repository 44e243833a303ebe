//! Voxels while they are loaded: by their cells as long as these are in the order of a grid, else as cubes.

use crate::builder::SceneBuilder;
use crate::grid_voxels::{GridSurfaces, GridVoxels};
use crate::voxel::Voxel;
use std::path::Path;
use vlscan_base::diag::ProblemKind;
use vlscan_base::error::{Error, Result};
use vlscan_trace::{GridPlace, VoxelCells, VoxelGrid};

/// The voxels of one file.
pub(super) struct VoxelStore {
    place: GridPlace,
    /// The voxels as long as they are on a grid.
    on_grid: Option<(VoxelCells, GridVoxels)>,
    /// Number of voxels.
    count: usize,
}

impl VoxelStore {
    /// No voxels, which will be cubes in a grid of `counts` cells along x, y, z. `keeps_grid` is whether they
    /// can be one grid.
    pub fn new(place: GridPlace, counts: [u32; 3], keeps_grid: bool) -> VoxelStore {
        let on_grid = keeps_grid.then(|| (VoxelCells::new(counts), GridVoxels::default()));
        VoxelStore { place, on_grid, count: 0 }
    }

    /// Makes room for more voxels.
    ///
    /// # Errors
    /// As for [`SceneBuilder::reserve`].
    pub fn reserve(&mut self, scene: &mut SceneBuilder, more: usize, source: &Path) -> Result<()> {
        let Some((cells, voxels)) = &mut self.on_grid else { return scene.reserve(0, 0, more, source) };
        scene.options.check_stop()?;
        scene.check_memory((cells.memory() + voxels.memory()) as u64, source)?;
        cells.reserve(more).map_err(|_| Error::io("load", source, std::io::ErrorKind::OutOfMemory.into()))
    }

    /// Appends a voxel.
    pub fn push(&mut self, scene: &mut SceneBuilder, cell: [u32; 3], voxel: &Voxel) {
        self.count += 1;
        if let Some((cells, voxels)) = &mut self.on_grid {
            if cells.push(cell) && voxels.push(voxel) {
                return;
            }
            self.store(scene, self.count - 1);
        }
        scene.geometry.cubes.push(self.place.cube(cell));
        scene.voxels.push(*voxel);
    }

    /// Stores the first `count` voxels as cubes, if they are on a grid, and all others from then on.
    fn store(&mut self, scene: &mut SceneBuilder, count: usize) {
        let Some((cells, voxels)) = self.on_grid.take() else { return };
        let place = self.place;
        scene.geometry.cubes.extend(cells.iter().take(count).map(|cell| place.cube(cell)));
        scene.voxels.extend((0..count).map(|i| voxels.get(i)));
    }

    /// Appends the voxels to the scene as a grid, or as cubes where these take less memory.
    ///
    /// # Errors
    /// [`Error::Input`] if they cannot be numbered.
    pub fn finish(mut self, scene: &mut SceneBuilder, surfaces: GridSurfaces) -> Result<()> {
        let is_worth_it =
            |cells: &VoxelCells| cells.len() >= scene.options.min_grid_voxels.max(1) && cells.are_compact();
        if !self.on_grid.as_ref().is_some_and(|(cells, _)| is_worth_it(cells)) {
            self.store(scene, self.count);
        }
        let Some((cells, mut voxels)) = self.on_grid else {
            scene.cube_surfaces.extend((0..self.count).map_while(|i| surfaces.get(i)));
            return scene.check_counts();
        };
        let first = scene.geometry.cube_count();
        let Some(grid) = VoxelGrid::new(self.place, cells, first) else {
            let message = format!("the scene has {} cubes, which cannot be numbered", first + self.count);
            return Err(Error::input_of(ProblemKind::TooLarge, message));
        };
        voxels.complete(surfaces);
        scene.geometry.grids.push(grid);
        scene.grid_voxels.push(voxels);
        scene.check_counts()
    }
}
