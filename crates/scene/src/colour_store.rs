//! Colours loaded so far of a scene under construction.

use super::colours::{ColouredCubes, ColouredField, ColouredMesh, Colours, NONE, SurfaceColour};
use super::texture::Texture;
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;
use vlscan_base::store::Checksum;
use vlscan_survey::{ColourDefinition, TextureImage};

/// Numbers of triangles, height fields, cubes and grids of a scene before a part.
#[derive(Clone, Copy, Debug)]
pub(super) struct ColourMark {
    pub triangles: usize,
    pub fields: usize,
    pub cubes: usize,
    pub grids: usize,
}

/// Colours that have been loaded; none unless they are requested.
#[derive(Default)]
pub(super) struct ColourBuilder {
    pub palette: Vec<SurfaceColour>,
    /// Numbers in the palette by material.
    pub numbers: HashMap<u32, u32>,
    /// Textures that were read; `None` for those that could not be.
    pub textures: HashMap<TextureImage, Option<Arc<Texture>>>,
    /// Bytes of these textures.
    pub texture_bytes: u64,
    /// Colours of stored triangles.
    pub meshes: Vec<ColouredMesh>,
    /// Colours of the triangles of each model of instances.
    models: Vec<Vec<ColouredMesh>>,
    pub fields: Vec<ColouredField>,
    pub cubes: Vec<ColouredCubes>,
    /// Colours of the voxels of each grid, as far as any grid has some.
    grids: Vec<Vec<[u8; 3]>>,
}

impl ColourBuilder {
    /// Memory, bytes.
    pub fn memory(&self) -> u64 {
        let meshes = self.meshes.iter().chain(self.models.iter().flatten());
        let cubes = self.cubes.iter().map(|of| of.colours.len()).chain(self.grids.iter().map(Vec::len));
        self.texture_bytes
            + meshes.map(|mesh| mesh.memory() as u64).sum::<u64>()
            + cubes.map(|count| 3 * count as u64).sum::<u64>()
    }

    /// Bytes of the colours of primitives from `start` on, with their textures.
    pub fn memory_since(&self, start: ColourMark) -> u64 {
        let meshes = self.meshes.iter().filter(|mesh| mesh.triangles.start >= start.triangles);
        let cubes = self.cubes.iter().filter(|of| of.cubes.start >= start.cubes);
        self.texture_bytes_of(&used_numbers(meshes.clone()))
            + meshes.map(|mesh| mesh.memory() as u64).sum::<u64>()
            + cubes.map(|of| 3 * of.colours.len() as u64).sum::<u64>()
    }

    /// Adds the colours of primitives from `start` on to a checksum, independent of the primitives before.
    pub fn add_since(&self, start: ColourMark, sum: &mut Checksum) {
        for mesh in self.meshes.iter().filter(|mesh| mesh.triangles.start >= start.triangles) {
            sum.debug(&(mesh.triangles.start - start.triangles, mesh.triangles.len()));
            mesh.add_to(&self.palette, sum);
        }
        for of in self.cubes.iter().filter(|of| of.cubes.start >= start.cubes) {
            sum.array(&of.colours);
        }
    }

    /// Bytes of the textures of some colours.
    fn texture_bytes_of(&self, numbers: &BTreeSet<u32>) -> u64 {
        let textures = numbers.iter().filter_map(|&number| self.palette[number as usize].texture.as_ref());
        let distinct: HashMap<_, _> = textures.map(|texture| (Arc::as_ptr(texture), texture)).collect();
        distinct.values().map(|texture| texture.memory() as u64).sum()
    }

    /// Removes the colours of primitives from `start` on, and their textures from memory.
    pub fn truncate(&mut self, start: ColourMark) {
        self.meshes.retain(|mesh| mesh.triangles.start < start.triangles);
        self.fields.retain(|of| of.field < start.fields);
        self.cubes.retain(|of| of.cubes.start < start.cubes);
        self.grids.truncate(start.grids);
        let used = self.drop_unused_textures();
        self.numbers.retain(|_, number| *number == NONE || used.contains(number));
        // Unreadable ones have caused a warning.
        self.textures.retain(|_, texture| texture.is_none());
        self.texture_bytes = self.texture_bytes_of(&used);
    }

    /// Removes the textures that no triangle has from the palette. Returns the numbers of the colours that
    /// triangles have.
    fn drop_unused_textures(&mut self) -> BTreeSet<u32> {
        let mut used = used_numbers(self.meshes.iter().chain(self.models.iter().flatten()));
        used.extend(self.fields.iter().map(|of| of.number));
        for (number, colour) in (0..).zip(&mut self.palette) {
            if !used.contains(&number) {
                colour.texture = None;
            }
        }
        used
    }

    /// Makes the colours of triangles from `first` on those of the next model of instances.
    pub fn add_model(&mut self, first: usize) {
        let is_stored = |mesh: &ColouredMesh| mesh.triangles.start < first;
        let stored = self.meshes.iter().take_while(|mesh| is_stored(mesh)).count();
        let own = self.meshes.split_off(stored).into_iter().map(|mesh| ColouredMesh {
            triangles: mesh.triangles.start - first..mesh.triangles.end - first,
            ..mesh
        });
        self.models.push(own.collect());
    }

    /// Adds the colours of the voxels of grid `grid`.
    pub fn add_grid(&mut self, grid: usize, colours: Vec<[u8; 3]>) {
        self.grids.resize(grid, Vec::new());
        self.grids.push(colours);
    }

    /// Index of the colour of materials without a colour whose triangles have colours.
    pub fn white(&mut self) -> u32 {
        let palette = &mut self.palette;
        let definition = ColourDefinition::stored([1.0; 3]);
        let known = palette.iter().position(|colour| colour.definition == definition);
        let number = known.unwrap_or_else(|| {
            palette.push(SurfaceColour { definition, texture: None });
            palette.len() - 1
        });
        number as u32
    }

    /// The colours of the finished scene.
    pub fn finish(mut self) -> Colours {
        self.drop_unused_textures();
        let ColourBuilder { palette, meshes, models, fields, cubes, grids, .. } = self;
        Colours { palette, meshes, models, fields, cubes, grids }
    }
}

/// The numbers of the colours of triangles.
fn used_numbers<'m>(meshes: impl Iterator<Item = &'m ColouredMesh>) -> BTreeSet<u32> {
    meshes.flat_map(|mesh| mesh.runs.iter().map(|(_, number)| *number)).filter(|n| *n != NONE).collect()
}
