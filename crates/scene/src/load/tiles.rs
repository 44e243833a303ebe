//! Parts that become tiles: they are loaded once for their facts, and again when rays need them.

use super::files::load_files;
use super::raster::{PageFacts, PagedRaster};
use crate::Scene;
use crate::builder::{Extent, LoadOptions, SceneBuilder, memory_of};
use crate::colours::Colours;
use crate::library::{Library, Names};
use crate::material::Material;
use crate::model::Part;
use crate::surfaces::Surface;
use crate::tiles::{Before, Tile, TileFacts, TileOptions, Tiles};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::error::{Error, Result};
use vlscan_base::machine;
use vlscan_base::store::Checksum;
use vlscan_geom::{Aabb, DVec3};
use vlscan_survey::{Loader, PartRecipe, VoxelMode};
use vlscan_trace::{Geometry, LoadError, Residency, Tree};

/// Maximum number of sizes of cubes in a tile: the box around cubes is known exactly in any frame for one
/// size at a time.
const MAX_CUBE_SIZES: usize = 16;

/// The tiles found so far.
#[derive(Default)]
pub(super) struct TileIndex {
    tiles: Vec<IndexedTile>,
}

struct IndexedTile {
    source: TileSource,
    facts: TileFacts,
    vertices: usize,
    /// Bytes of its colours.
    colours: u64,
    /// Box around its vertices, and around the centres of its cubes for each half size, world frame, m.
    corners: Aabb,
    centres: Vec<(f64, Aabb)>,
}

/// Source of a tile.
enum TileSource {
    Files(TileFiles),
    Page(RasterPage),
}

/// A page of a raster.
struct RasterPage {
    raster: Arc<PagedRaster>,
    /// Index of the page.
    page: usize,
    part: Part,
    /// The material that it has the colour of.
    coloured_as: u32,
}

/// The files of a tile.
struct TileFiles {
    recipe: Arc<PartRecipe>,
    files: Vec<PathBuf>,
    part: Part,
    /// Names of materials that files of the same part have defined before, as the number of the first ones in
    /// all names.
    known_names: usize,
    names: Arc<Names>,
}

/// True if a part can be a tile: its files can be read again, with the same result.
pub(super) fn is_tile(options: &LoadOptions, part: &PartRecipe) -> bool {
    let is_readable = match &part.loader {
        Loader::MeshFiles { .. } | Loader::Xyz(_) => true,
        // Cubes of many sizes, see MAX_CUBE_SIZES.
        Loader::DetailedVoxels(voxels) => !matches!(voxels.mode, VoxelMode::Scaled(_)),
        // Rasters are divided into pages; meshes in memory are already loaded.
        Loader::GeoTiff { .. } | Loader::Mesh(_) => false,
    };
    options.tiles.is_some() && is_readable && part.motions.is_empty() && part.swaps.is_empty()
}

impl TileIndex {
    pub fn is_empty(&self) -> bool {
        self.tiles.is_empty()
    }

    /// Makes a tile of the primitives of `extent`, the last ones of the scene, and removes them. Returns
    /// `false` if they have to stay. `names` are the number of names of materials before the part's files
    /// were read.
    pub fn add(
        &mut self,
        scene: &mut SceneBuilder,
        recipe: &PartRecipe,
        (files, part, known_names): (&[PathBuf], Part, usize),
        extent: &Extent,
    ) -> bool {
        if !extent.fields.is_empty() || !extent.grids.is_empty() {
            return false;
        }
        let Some(centres) = centres_of_cubes(scene, extent) else { return false };
        let g = &scene.geometry;
        let facts = TileFacts {
            part: scene.next_part(),
            materials: materials_of(scene, extent),
            triangles: extent.triangles.len() as u32,
            cubes: extent.cubes.len() as u32,
            max_cube: centres.iter().fold(0.0, |max, (half, _)| f64::max(max, half * 2.0)),
            checksum: checksum(scene, extent),
            before: Before {
                own_triangles: g.triangle_count() as u32 - extent.triangles.len() as u32,
                own_cubes: (g.cube_count() - extent.cubes.len()) as u32,
                instances: scene.meshes.placements.len() as u32,
                ..Before::default()
            },
            ..TileFacts::default()
        };
        let corners = Aabb::around(g.vertices[extent.vertices.clone()].iter().copied());
        // Files of one part share its facts.
        let last = self.tiles.last().and_then(|tile| match &tile.source {
            TileSource::Files(files) => Some(&files.recipe),
            TileSource::Page(_) => None,
        });
        let is_same = |last: &&Arc<PartRecipe>| last.number == recipe.number && last.place == recipe.place;
        let recipe = last.filter(is_same).cloned().unwrap_or_else(|| Arc::new(recipe.clone()));
        let files = files.to_vec();
        let source = TileFiles { recipe, files, part, known_names, names: Arc::default() };
        let source = TileSource::Files(source);
        let start = Extent {
            vertices: extent.vertices.start..extent.vertices.start,
            triangles: extent.triangles.start..extent.triangles.start,
            cubes: extent.cubes.start..extent.cubes.start,
            fields: extent.fields.start..extent.fields.start,
            grids: extent.grids.start..extent.grids.start,
        };
        let (vertices, colours) = (extent.vertices.len(), scene.colours.memory_since(start.colour_mark()));
        self.tiles.push(IndexedTile { source, facts, vertices, colours, corners, centres });
        scene.truncate(&start);
        true
    }

    /// Makes a tile of every page of a raster, all of one `material` and with the colour of another.
    pub fn add_raster(
        &mut self,
        scene: &SceneBuilder,
        part: &Part,
        (material, coloured_as): (u32, u32),
        raster: PagedRaster,
        pages: Vec<PageFacts>,
    ) {
        let raster = Arc::new(raster);
        let colour = scene.library.colour_of(coloured_as).filter(|_| scene.options.colours);
        let checksum = |page: u64| match colour {
            Some((colour, _)) => {
                let mut sum = Checksum::default();
                sum.debug(&(page, colour.factor, colour.is_linear));
                sum.finish()
            }
            None => page,
        };
        let before = Before {
            own_triangles: scene.geometry.triangle_count() as u32,
            own_cubes: scene.geometry.cube_count() as u32,
            instances: scene.meshes.placements.len() as u32,
            ..Before::default()
        };
        for (page, facts) in pages.into_iter().enumerate() {
            let (raster, part) = (raster.clone(), part.clone());
            let source = TileSource::Page(RasterPage { raster, page, part, coloured_as });
            let corners = facts.bounds;
            let facts = TileFacts {
                part: scene.next_part(),
                materials: vec![material],
                triangles: facts.numbers,
                checksum: checksum(facts.checksum),
                place: Some(facts.place),
                before,
                ..TileFacts::default()
            };
            let (colours, centres) = (0, Vec::new());
            self.tiles.push(IndexedTile { source, facts, vertices: 0, colours, corners, centres });
        }
    }

    /// Gives the last `count` tiles the names of materials of their part, which are complete now.
    pub fn set_names(&mut self, count: usize, names: Names) {
        let names = Arc::new(names);
        let first = self.tiles.len() - count;
        for tile in &mut self.tiles[first..] {
            if let TileSource::Files(files) = &mut tile.source {
                files.names = names.clone();
            }
        }
    }

    /// The materials of all tiles.
    pub fn materials(&self) -> impl Iterator<Item = u32> {
        self.tiles.iter().flat_map(|tile| tile.facts.materials.iter().copied())
    }

    /// Number of tiles.
    pub fn len(&self) -> usize {
        self.tiles.len()
    }

    /// Box around all tiles, world frame, m.
    pub fn bounds(&self) -> Aabb {
        self.tiles.iter().fold(Aabb::EMPTY, |all, tile| all.union(tile.bounds(DVec3::ZERO)))
    }

    /// Box around all tiles in the frame with its origin at `shift`, m, as if their primitives were stored
    /// there.
    pub fn bounds_from(&self, shift: DVec3) -> Aabb {
        self.tiles.iter().fold(Aabb::EMPTY, |all, tile| all.union(tile.bounds(shift)))
    }

    /// The tiles of the complete scene with its origin at `shift`, which has `own` primitives outside of
    /// tiles.
    ///
    /// # Errors
    /// [`Error::Input`] if their primitives cannot be numbered.
    pub fn finish(
        self,
        options: &LoadOptions,
        library: &Library,
        shift: DVec3,
        own: usize,
    ) -> Result<Option<Arc<Tiles>>> {
        let Some(tile_options) = options.tiles.clone().filter(|_| !self.tiles.is_empty()) else {
            return Ok(None);
        };
        let (mut sources, mut facts) = (Vec::new(), Vec::new());
        for tile in self.tiles {
            let (triangles, cubes) = (tile.facts.triangles as usize, tile.facts.cubes as usize);
            let tree = Tree::estimate_build_memory((triangles + cubes) as u64, tile_options.trees.builder);
            let bytes = match &tile.source {
                TileSource::Files(_) => {
                    memory_of(tile.vertices, triangles, cubes).saturating_add(tree + tile.colours)
                }
                TileSource::Page(of) => of.raster.bytes(of.page),
            };
            let bounds = tile.bounds(shift);
            facts.push(TileFacts { bounds, bytes, ..tile.facts });
            sources.push(tile.source);
        }
        let residency = Residency::new(tile_options.memory);
        let loader = TileLoader {
            // A run that is to stop finishes the chunks that it has begun, for which it may need tiles.
            options: LoadOptions { tiles: None, stop: None, ..options.clone() },
            tile_options,
            library: library.clone(),
            shift,
            facts: facts.clone(),
            sources,
        };
        let bytes: Vec<u64> = facts.iter().map(|tile| tile.bytes).collect();
        let items = residency.add(bytes, move |tile| {
            let loaded = loader.load(tile).map_err(|error| Arc::new(error) as LoadError)?;
            let bytes = loaded.memory() as u64;
            Ok((loaded, bytes))
        });
        Tiles::new(facts, items, own).map(|tiles| Some(Arc::new(tiles)))
    }
}

impl IndexedTile {
    /// Box around its primitives in the frame with its origin at `shift`, m.
    fn bounds(&self, shift: DVec3) -> Aabb {
        let moved = |b: &Aabb| Aabb { min: b.min - shift, max: b.max - shift };
        let corners = if self.corners.is_empty() { Aabb::EMPTY } else { moved(&self.corners) };
        self.centres.iter().fold(corners, |all, (half, centres)| {
            let b = moved(centres);
            all.union(Aabb { min: b.min - DVec3::splat(*half), max: b.max + DVec3::splat(*half) })
        })
    }
}

/// Loads tiles again.
struct TileLoader {
    options: LoadOptions,
    tile_options: TileOptions,
    /// All materials of the scene.
    library: Library,
    shift: DVec3,
    facts: Vec<TileFacts>,
    sources: Vec<TileSource>,
}

impl TileLoader {
    fn load(&self, tile: usize) -> Result<Tile> {
        machine::with_pool(self.options.jobs, || {
            let scene = self.load_scene(tile)?;
            let tree = scene.tree_of_stored(&self.tile_options.trees);
            Ok(Tile { scene, tree })
        })?
    }

    fn load_scene(&self, tile: usize) -> Result<Scene> {
        let facts = &self.facts[tile];
        let source = match &self.sources[tile] {
            TileSource::Files(files) => files,
            TileSource::Page(RasterPage { raster, page, part, coloured_as }) => {
                let field = raster.load(&self.options, *page, self.shift)?;
                let material = self.library.materials[facts.materials[0] as usize].clone();
                let colours = self.options.colours.then(|| match self.library.colour_of(*coloured_as) {
                    Some((colour, _)) => Arc::new(Colours::of_page(colour.clone(), field.grid())),
                    None => Arc::default(),
                });
                return Ok(Scene {
                    shift: self.shift,
                    bounds: facts.bounds,
                    geometry: Geometry { fields: vec![field], ..Geometry::default() },
                    field_surfaces: vec![0],
                    surfaces: vec![Surface { part: 0, material: 0 }],
                    parts: vec![part.clone()],
                    materials: vec![material],
                    colours,
                    ..Scene::default()
                });
            }
        };
        let mut scene = SceneBuilder::new(&self.options, self.library.clone());
        scene.first_part = facts.part;
        let start = scene.end();
        load_files(&mut scene, &source.recipe, &source.files, &mut source.names.first(source.known_names))?;
        // Warnings were reported when the scene was loaded.
        std::mem::take(&mut scene.diagnostics).finish(false)?;
        let extent = scene.since(&start);
        let changed = || {
            let path = source.files.first().map_or(Path::new("a tile"), PathBuf::as_path);
            let message = format!("{}: the file has changed since the scene was loaded", path.display());
            Error::input_with_help(message, "leave the files of a scene as they are while it is scanned")
        };
        if checksum(&scene, &extent) != facts.checksum {
            return Err(changed());
        }
        let materials = materials_of(&scene, &extent);
        if materials.len() != facts.materials.len() {
            return Err(changed());
        }
        let local: HashMap<u32, u32> = materials.into_iter().zip(0..).collect();
        let local_id = |surface: &u32| local[&scene.surfaces[*surface as usize].material];
        let ids = scene.triangle_surfaces.iter().chain(&scene.cube_surfaces).map(local_id).collect();
        let materials: Vec<Material> =
            facts.materials.iter().map(|m| self.library.materials[*m as usize].clone()).collect();
        let (mut geometry, mut voxels) = (scene.geometry, scene.voxels);
        geometry.vertices.iter_mut().for_each(|v| *v -= self.shift);
        geometry.cubes.iter_mut().for_each(|cube| cube.centre -= self.shift);
        geometry.vertices.shrink_to_fit();
        geometry.triangles.shrink_to_fit();
        geometry.cubes.shrink_to_fit();
        voxels.shrink_to_fit();
        Ok(Scene {
            shift: self.shift,
            bounds: facts.bounds,
            geometry,
            surface_ids: ids,
            surfaces: (0..materials.len() as u32).map(|material| Surface { part: 0, material }).collect(),
            parts: vec![source.part.clone()],
            materials,
            voxels,
            colours: self.options.colours.then(|| Arc::new(scene.colours.finish())),
            ..Scene::default()
        })
    }
}

/// The materials of primitives in the order in which they occur first.
fn materials_of(scene: &SceneBuilder, extent: &Extent) -> Vec<u32> {
    let mut found = Vec::new();
    let mut is_known = vec![false; scene.library.materials.len()];
    let triangles = &scene.triangle_surfaces[extent.triangles.clone()];
    let cubes = &scene.cube_surfaces[extent.cubes.clone()];
    for surface in triangles.iter().chain(cubes) {
        let material = scene.surfaces[*surface as usize].material;
        if !std::mem::replace(&mut is_known[material as usize], true) {
            found.push(material);
        }
    }
    found
}

/// The half sizes of cubes, and the box around the centres of those of each size; `None` for more sizes than
/// tiles may have.
fn centres_of_cubes(scene: &SceneBuilder, extent: &Extent) -> Option<Vec<(f64, Aabb)>> {
    let mut found: Vec<(f64, Aabb)> = Vec::new();
    for cube in &scene.geometry.cubes[extent.cubes.clone()] {
        let count = found.len();
        match found.iter_mut().find(|(half, _)| *half == cube.half) {
            Some((_, centres)) => *centres = centres.with(cube.centre),
            None if count == MAX_CUBE_SIZES => return None,
            None => found.push((cube.half, Aabb::around([cube.centre]))),
        }
    }
    Some(found)
}

/// Checksum of the primitives of an extent and their colours, independent of the primitives before them in
/// the scene.
fn checksum(scene: &SceneBuilder, extent: &Extent) -> u64 {
    let (g, first) = (&scene.geometry, extent.vertices.start as u32);
    let mut sum = Checksum::default();
    sum.array(&g.vertices[extent.vertices.clone()]);
    let mut triangles = Vec::with_capacity(1 << 12);
    for some in g.triangles[extent.triangles.clone()].chunks(1 << 12) {
        triangles.clear();
        triangles.extend(some.iter().map(|t| t.map(|v| v - first)));
        sum.array(&triangles);
    }
    sum.array(&g.cubes[extent.cubes.clone()]);
    sum.array(&scene.voxels[extent.cubes.clone()]);
    if scene.options.colours {
        scene.colours.add_since(extent.colour_mark(), &mut sum);
    }
    sum.finish()
}
