//! A scene under construction, to which the loaders append.

use super::change::AppliedChanges;
use super::colour_store::ColourBuilder;
use super::grid_voxels::{GridSurfaces, GridVoxels};
use super::library::Library;
use super::model::{MovingPart, Part};
use super::surfaces::Surface;
use super::tiles::TileOptions;
use super::voxel::Voxel;
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};
use std::mem::size_of;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use vlscan_base::corrections::Corrections;
use vlscan_base::diag::{Diagnostics, Place, ProblemKind};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity;
pub(super) use vlscan_geom::MAX_COORDINATE;
use vlscan_geom::{Aabb, DVec3};
use vlscan_survey::{Identity, MaterialChanges, Scanner, UpAxis};
use vlscan_trace::{Cube, Geometry, Model, Placement, VoxelGrid};

/// Maximum number of vertices, and of primitives, of a scene: indices have 32 bits and the largest one means
/// "none".
pub(super) const MAX_ELEMENTS: usize = u32::MAX as usize - 1;

/// Settings of [`load`](super::load()).
#[derive(Clone, Debug)]
pub struct LoadOptions {
    /// Wavelength of the first device, nm, at which spectra are evaluated.
    pub wavelength_nm: f64,
    /// Wavelengths of other devices, nm, at which spectra are also evaluated
    /// ([`Material::further_reflectances`](super::Material::further_reflectances)). All differ from each
    /// other and from the first.
    pub further_wavelengths_nm: Vec<f64>,
    /// Seed of random materials and random voxel shifts.
    pub seed: u64,
    /// Departures from the reference's reading of materials and leaf angle tables.
    pub rules: Corrections,
    /// If set, OBJ faces with more than four vertices are skipped, as by the reference (spec input-formats
    /// §10, trap 51).
    pub drop_polygons: bool,
    /// Maximum memory of the scene without its tree, bytes.
    pub max_memory: Option<u64>,
    /// Number of threads; 0 means all.
    pub jobs: usize,
    /// When parts share meshes.
    pub sharing: Sharing,
    /// True if rasters become triangles that are stored, not height fields. Changes nothing but memory and
    /// speed.
    pub triangulate_rasters: bool,
    /// Minimum number of voxels of a file that become a grid, not stored cubes. Changes nothing but memory
    /// and speed.
    pub min_grid_voxels: usize,
    /// True if surfaces have [colours](super::Colours), which take memory: the texels of textures, and the
    /// texture coordinates of triangles.
    pub colours: bool,
    /// Options for loading parts at rest when rays need them, and dropping them otherwise; `None` loads the
    /// whole scene. Does not change the points of a survey.
    pub tiles: Option<TileOptions>,
    /// Ends the loading soon after it is set, with [`Error::Interrupted`].
    pub stop: Option<Arc<AtomicBool>>,
}

impl LoadOptions {
    /// The options with the wavelengths at which a scanner needs spectra by the rules: that of its first
    /// device, and those of others with the correction `channel-spectra`.
    #[must_use]
    pub fn with_wavelengths_of(self, scanner: &Scanner) -> LoadOptions {
        let mut wavelengths = scanner.wavelengths().into_iter();
        let wavelength_nm = wavelengths.next().unwrap_or(self.wavelength_nm);
        let further_wavelengths_nm = wavelengths.filter(|_| self.rules.channel_spectra).collect();
        LoadOptions { wavelength_nm, further_wavelengths_nm, ..self }
    }

    /// # Errors
    /// [`Error::Interrupted`] after a request to stop.
    pub fn check_stop(&self) -> Result<()> {
        let is_requested = self.stop.as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed));
        if is_requested { Err(Error::Interrupted) } else { Ok(()) }
    }
}

impl Default for LoadOptions {
    /// 1064 nm, seed 0, the reference's materials, all polygons, no memory limit, all threads.
    fn default() -> LoadOptions {
        LoadOptions {
            wavelength_nm: 1064.0,
            further_wavelengths_nm: Vec::new(),
            seed: 0,
            rules: Corrections::NONE,
            drop_polygons: false,
            max_memory: None,
            jobs: 0,
            sharing: Sharing::Auto,
            triangulate_rasters: false,
            // Cubes of fewer voxels fit into the memory of any machine; rays traverse them faster.
            min_grid_voxels: 1 << 22,
            colours: false,
            tiles: None,
            stop: None,
        }
    }
}

vlscan_choice::choices! {
    /// When parts share the mesh of a file that several of them name. Does not change the points of a survey.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Sharing: default Sharing::Auto {
        /// If it saves much memory; rays traverse stored triangles faster than instances.
        Auto = "auto",
        /// Whenever a mesh can be shared, even by a single part.
        Always = "always",
        /// Never: every part is stored.
        Never = "never",
    }
}

/// A mesh that several parts can share.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum MeshFile {
    /// Path of a mesh file, its up axis, the bits of its unit, its table of materials, and the changes of its
    /// materials.
    File(PathBuf, Option<UpAxis>, Option<u64>, Option<PathBuf>, Option<Identity>),
    /// A mesh in memory, and the changes of its materials.
    Memory(Identity, Option<Identity>),
}

/// Meshes that several parts share, those loaded so far.
#[derive(Default)]
pub(super) struct SharedMeshes {
    /// Shared files, with the index of the model once it is loaded.
    pub files: HashMap<MeshFile, Option<u32>>,
    /// Meshes in their own frames.
    pub models: Vec<Arc<Model>>,
    /// Material of each triangle of each model.
    pub materials: Vec<Vec<u32>>,
    /// Model, number of triangles stored before it, and placement of each instance.
    pub placements: Vec<(u32, u32, Placement)>,
    /// The part of each instance.
    pub parts: Vec<u32>,
}

impl SharedMeshes {
    fn memory(&self) -> u64 {
        self.models.iter().map(|m| m.memory() as u64).sum::<u64>()
            + self.materials.iter().map(|m| 4 * m.len() as u64).sum::<u64>()
            + (self.placements.len() * size_of::<(u32, u32, Placement)>()) as u64
    }

    /// The corners of all triangles of an instance, in order, world frame.
    pub fn corners(&self, instance: usize) -> impl Iterator<Item = DVec3> {
        let (model, _, placement) = self.placements[instance];
        let geometry = &self.models[model as usize].geometry;
        (0..geometry.triangles.len())
            .flat_map(move |i| geometry.triangle(i).map(|p| placement.place(p, DVec3::ZERO)))
    }
}

/// Geometry and materials loaded so far.
pub(super) struct SceneBuilder<'a> {
    pub options: &'a LoadOptions,
    /// Primitives, world frame.
    pub geometry: Geometry,
    /// Attributes of the stored cubes, parallel to `geometry.cubes`.
    pub voxels: Vec<Voxel>,
    /// Attributes and surfaces of the voxels of grids, parallel to `geometry.grids`.
    pub grid_voxels: Vec<GridVoxels>,
    /// Index in `surfaces` of each stored triangle.
    pub triangle_surfaces: Vec<u32>,
    /// Index in `surfaces` of each height field.
    pub field_surfaces: Vec<u32>,
    /// Index in `surfaces` of each stored cube.
    pub cube_surfaces: Vec<u32>,
    pub surfaces: Vec<Surface>,
    /// Index in the scene of the first of `parts`.
    pub first_part: u32,
    /// Parts with at least one primitive.
    pub parts: Vec<Part>,
    pub moving_parts: Vec<MovingPart>,
    pub library: Library,
    pub meshes: SharedMeshes,
    /// Colours, if they are requested.
    pub colours: ColourBuilder,
    /// Materials of parts that have been replaced.
    pub changes: AppliedChanges,
    /// Changes of the materials of the part that is being loaded.
    pub part_changes: MaterialChanges,
    /// Geometry files and tables that were opened.
    pub sources: Vec<PathBuf>,
    /// Rules that change some leaf angle table.
    pub leaf_table_rules: Corrections,
    pub diagnostics: Diagnostics,
    /// Numbers of the faces of the part being loaded.
    pub faces: FaceNumbers,
    /// Mesh files whose unit and axes have been checked.
    pub doubted: HashSet<PathBuf>,
    surface_numbers: HashMap<Surface, u32>,
}

/// The part that is being loaded.
pub(super) struct PartSource<'a> {
    /// Index among the scene's parts.
    pub index: u32,
    /// Position in the scene's file.
    pub place: Option<&'a Place>,
}

/// Faces from which the triangles of a part come. A face of its files can become several triangles, or none.
#[derive(Default)]
pub(super) struct FaceNumbers {
    /// True if they are recorded: a material is for faces by their numbers.
    pub are_requested: bool,
    /// The face of each triangle of the part, in the order of its files.
    pub of_triangles: Vec<u32>,
    /// Number of faces.
    pub count: usize,
}

/// The primitives of one part, as index ranges.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Extent {
    pub vertices: Range<usize>,
    pub triangles: Range<usize>,
    pub cubes: Range<usize>,
    pub fields: Range<usize>,
    pub grids: Range<usize>,
}

impl Extent {
    /// All primitives of a geometry.
    pub fn of(geometry: &Geometry) -> Extent {
        Extent {
            vertices: 0..geometry.vertices.len(),
            triangles: 0..geometry.triangles.len(),
            cubes: 0..geometry.cubes.len(),
            fields: 0..geometry.fields.len(),
            grids: 0..geometry.grids.len(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty() && self.cubes.is_empty() && self.fields.is_empty() && self.grids.is_empty()
    }
}

impl<'a> SceneBuilder<'a> {
    pub fn new(options: &'a LoadOptions, library: Library) -> SceneBuilder<'a> {
        SceneBuilder {
            options,
            geometry: Geometry::default(),
            voxels: Vec::new(),
            grid_voxels: Vec::new(),
            triangle_surfaces: Vec::new(),
            field_surfaces: Vec::new(),
            cube_surfaces: Vec::new(),
            surfaces: Vec::new(),
            first_part: 0,
            parts: Vec::new(),
            moving_parts: Vec::new(),
            library,
            meshes: SharedMeshes::default(),
            colours: ColourBuilder::default(),
            changes: AppliedChanges::default(),
            part_changes: MaterialChanges::default(),
            sources: Vec::new(),
            leaf_table_rules: Corrections::NONE,
            diagnostics: Diagnostics::default(),
            faces: FaceNumbers::default(),
            doubted: HashSet::new(),
            surface_numbers: HashMap::new(),
        }
    }

    /// The index of the surface of a (part, material) pair, which is added if it is new.
    pub fn surface(&mut self, part: u32, material: u32) -> u32 {
        let surface = Surface { part, material };
        *self.surface_numbers.entry(surface).or_insert_with(|| {
            self.surfaces.push(surface);
            self.surfaces.len() as u32 - 1
        })
    }

    /// Forgets the surfaces of a part without primitives, which the next part does not take over.
    pub fn leave_out_next_part(&mut self) {
        let part = self.next_part();
        while let Some(last) = self.surfaces.pop_if(|last| last.part == part) {
            self.surface_numbers.remove(&last);
        }
    }

    /// Index in the scene of the next part.
    pub fn next_part(&self) -> u32 {
        self.first_part + self.parts.len() as u32
    }

    /// True if primitives have each material, those of instances included, and of tiles, whose materials are
    /// `of_tiles`.
    pub fn used_materials(&self, of_tiles: impl Iterator<Item = u32>) -> Vec<bool> {
        let mut is_used = vec![false; self.surfaces.len()];
        let stored = self.triangle_surfaces.iter().chain(&self.field_surfaces).chain(&self.cube_surfaces);
        stored.for_each(|surface| is_used[*surface as usize] = true);
        for (voxels, grid) in self.grid_voxels.iter().zip(&self.geometry.grids) {
            voxels
                .surfaces
                .counts(grid.len())
                .iter()
                .for_each(|(surface, _)| is_used[*surface as usize] = true);
        }
        let of_surfaces =
            self.surfaces.iter().zip(is_used).filter(|(_, used)| *used).map(|(s, _)| s.material);
        let of_models = self.meshes.materials.iter().flatten().copied();
        let mut used = vec![false; self.library.materials.len()];
        of_surfaces.chain(of_models).chain(of_tiles).for_each(|material| used[material as usize] = true);
        self.library.with_bases(used)
    }

    /// Removes the primitives appended since `start` was the end.
    pub fn truncate(&mut self, start: &Extent) {
        let Geometry { vertices, triangles, cubes, fields, grids } = &mut self.geometry;
        vertices.truncate(start.vertices.start);
        triangles.truncate(start.triangles.start);
        cubes.truncate(start.cubes.start);
        fields.truncate(start.fields.start);
        grids.truncate(start.grids.start);
        self.grid_voxels.truncate(start.grids.start);
        self.voxels.truncate(start.cubes.start);
        self.triangle_surfaces.truncate(start.triangles.start);
        self.cube_surfaces.truncate(start.cubes.start);
        self.field_surfaces.truncate(start.fields.start);
        if self.options.colours {
            self.colours.truncate(start.colour_mark());
        }
    }

    /// The empty extent after all primitives loaded so far, for [`SceneBuilder::since`].
    pub fn end(&self) -> Extent {
        let Extent { vertices, triangles, cubes, fields, grids } = Extent::of(&self.geometry);
        let (v, t, c, f, g) = (vertices.end, triangles.end, cubes.end, fields.end, grids.end);
        Extent { vertices: v..v, triangles: t..t, cubes: c..c, fields: f..f, grids: g..g }
    }

    /// The primitives appended since `start` was the end.
    pub fn since(&self, start: &Extent) -> Extent {
        let end = self.end();
        Extent {
            vertices: start.vertices.start..end.vertices.end,
            triangles: start.triangles.start..end.triangles.end,
            cubes: start.cubes.start..end.cubes.end,
            fields: start.fields.start..end.fields.end,
            grids: start.grids.start..end.grids.end,
        }
    }

    /// The surfaces of a part whose voxels have the materials in turn.
    pub fn surfaces_in_turn(&mut self, part: u32, materials: &[u32]) -> GridSurfaces {
        GridSurfaces::InTurn(materials.iter().map(|&m| self.surface(part, m)).collect())
    }

    /// Removes the cubes from index `first` on for which `keep` is false.
    pub fn retain_cubes(&mut self, first: usize, keep: impl Fn(&Cube) -> bool) {
        let mut kept = first;
        for i in first..self.geometry.cubes.len() {
            if keep(&self.geometry.cubes[i]) {
                self.geometry.cubes[kept] = self.geometry.cubes[i];
                self.voxels[kept] = self.voxels[i];
                self.cube_surfaces[kept] = self.cube_surfaces[i];
                kept += 1;
            }
        }
        self.geometry.cubes.truncate(kept);
        self.voxels.truncate(kept);
        self.cube_surfaces.truncate(kept);
    }

    /// Completes triangles appended after `start`, whose vertex indices count from there: removes unused
    /// vertices and converts the indices to indices in the scene.
    pub fn finish_mesh(&mut self, start: &Extent) -> Result<()> {
        let (first, vertices) = (start.vertices.start, &mut self.geometry.vertices);
        let triangles = &mut self.geometry.triangles[start.triangles.start..];
        let mut used = vec![false; vertices.len() - first];
        triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
        if used.iter().all(|&u| u) {
            self.check_counts()?;
            self.geometry.triangles[start.triangles.start..]
                .par_iter_mut()
                .for_each(|t| *t = t.map(|v| v + first as u32));
            return Ok(());
        }
        let mut number = Vec::with_capacity(used.len());
        let mut kept = first;
        for (i, used) in used.into_iter().enumerate() {
            number.push(kept as u32);
            if used {
                vertices[kept] = vertices[first + i];
                kept += 1;
            }
        }
        vertices.truncate(kept);
        triangles.par_iter_mut().for_each(|t| *t = t.map(|v| number[v as usize]));
        self.check_counts()
    }

    /// Fails if there are more vertices or primitives than indices.
    pub fn check_counts(&self) -> Result<()> {
        let (vertices, primitives) = (self.geometry.vertices.len(), self.geometry.len());
        if vertices.max(primitives) > MAX_ELEMENTS {
            let message = format!(
                "the scene has {vertices} vertices and {primitives} primitives; the maximum is \
                 {MAX_ELEMENTS} of each"
            );
            return Err(Error::input_of(ProblemKind::TooLarge, message));
        }
        Ok(())
    }

    /// Memory that the limit leaves, bytes.
    pub fn free_memory(&self) -> u64 {
        self.options.max_memory.map_or(u64::MAX, |limit| limit.saturating_sub(self.memory()))
    }

    /// Memory of everything that is loaded, bytes.
    pub fn memory(&self) -> u64 {
        self.memory_within(&Extent::of(&self.geometry))
            .saturating_add(self.meshes.memory() + self.colours.memory())
    }

    /// Memory of the primitives of an extent, bytes.
    pub fn memory_within(&self, extent: &Extent) -> u64 {
        let Geometry { fields, grids, .. } = &self.geometry;
        let of_grids = grids[extent.grids.clone()].iter().map(VoxelGrid::memory);
        let of_voxels = self.grid_voxels[extent.grids.clone()].iter().map(GridVoxels::memory);
        let fields = fields[extent.fields.clone()].iter().map(|field| field.memory() as u64).sum::<u64>();
        memory_of(extent.vertices.len(), extent.triangles.len(), extent.cubes.len())
            .saturating_add(fields)
            .saturating_add(of_grids.chain(of_voxels).sum::<usize>() as u64)
    }

    /// Makes room for more primitives of `source`.
    ///
    /// # Errors
    /// [`Error::Input`] if the scene then exceeds the memory limit, [`Error::Io`] if the system has no more
    /// memory, [`Error::Interrupted`] after a request to stop.
    pub fn reserve(&mut self, vertices: usize, triangles: usize, cubes: usize, source: &Path) -> Result<()> {
        self.options.check_stop()?;
        self.check_memory(memory_of(vertices, triangles, cubes), source)?;
        let Geometry { vertices: all_vertices, triangles: all_triangles, cubes: all_cubes, .. } =
            &mut self.geometry;
        let reserved = all_vertices
            .try_reserve(vertices)
            .and_then(|()| all_triangles.try_reserve(triangles))
            .and_then(|()| all_cubes.try_reserve(cubes))
            .and_then(|()| self.voxels.try_reserve(cubes));
        reserved.map_err(|_| Error::io("load", source, std::io::ErrorKind::OutOfMemory.into()))
    }

    /// Fails if the loaded data and `more` bytes for `file` exceed the memory limit.
    pub fn check_memory(&self, more: u64, file: &Path) -> Result<()> {
        let Some(limit) = self.options.max_memory else { return Ok(()) };
        let need = self.memory().saturating_add(more);
        if need <= limit {
            return Ok(());
        }
        let message = format!(
            "the scene needs at least {} with {}, without the tree over it; the limit is {}",
            quantity::bytes(need),
            file.display(),
            quantity::bytes(limit)
        );
        Err(Error::input_of(ProblemKind::TooLarge, message))
    }
}

/// Memory of a frozen scene, bytes: 24 per vertex, 16 per triangle, 60 per cube.
pub(super) fn memory_of(vertices: usize, triangles: usize, cubes: usize) -> u64 {
    let per_triangle = size_of::<[u32; 3]>() + size_of::<u32>();
    let per_cube = size_of::<Cube>() + size_of::<Voxel>() + size_of::<u32>();
    let bytes = |count: usize, each: usize| (count as u64).saturating_mul(each as u64);
    bytes(vertices, size_of::<DVec3>())
        .saturating_add(bytes(triangles, per_triangle))
        .saturating_add(bytes(cubes, per_cube))
}

/// The bounding box of the points mapped by `image`.
pub(super) fn bounds_of_points(points: &[DVec3], image: impl Fn(DVec3) -> DVec3 + Sync) -> Aabb {
    points.par_iter().fold(|| Aabb::EMPTY, |b, &v| b.with(image(v))).reduce(|| Aabb::EMPTY, Aabb::union)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_stated_per_primitive() {
        assert_eq!([memory_of(1, 0, 0), memory_of(0, 1, 0), memory_of(0, 0, 1)], [24, 16, 60]);
    }
}
