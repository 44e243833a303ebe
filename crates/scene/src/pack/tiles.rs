//! Tiles of packed scenes: facts about all tiles, and for each a scene with its tree.

use super::contents::{read_scene, write_scene};
use crate::Scene;
use crate::builder::LoadOptions;
use crate::tiles::{Before, PlaceInRaster, Tile, TileFacts, TileOptions, TileReader, Tiles};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_base::machine;
use vlscan_base::store::{ArrayFile, ArrayFileWriter};
use vlscan_geom::Aabb;
use vlscan_trace::{BuildOptions, Builder, LoadError, Residency};

/// The name of the facts about all tiles, after the name of the epoch.
const NAME: &str = "tiles";

/// Prefix of the names of all arrays of a tile.
fn prefix_of(prefix: &str, tile: usize) -> String {
    format!("{prefix}tile {tile} ")
}

/// True if an array belongs to a tile, by its name without the prefix of the epoch.
pub(super) fn is_of_tile(name: &str) -> bool {
    name.starts_with("tile ")
}

/// Facts about a tile that is not in memory.
#[derive(Serialize, Deserialize)]
struct StoredTile {
    bounds: Aabb,
    part: u32,
    materials: Vec<u32>,
    triangles: u32,
    cubes: u32,
    max_cube: f64,
    checksum: u64,
    /// Memory with its tree.
    bytes: u64,
    /// Number of triangles, cubes and instances of the scene itself before it.
    before: [u32; 3],
    place: Option<StoredPlace>,
}

/// Facts about all tiles of a scene. Values are stored in the order of the fields.
#[derive(Serialize, Deserialize)]
struct StoredTiles {
    tiles: Vec<StoredTile>,
    /// Number of triangles before each row of each raster.
    rasters: Vec<Vec<u32>>,
}

/// [`PlaceInRaster`] with the number of the raster among those of the scene.
#[derive(Serialize, Deserialize)]
struct StoredPlace {
    raster: usize,
    first_row: usize,
    columns: usize,
    before: Vec<u32>,
    missing: u32,
}

/// True if the scene whose arrays begin with `prefix` has tiles.
pub(super) fn has_tiles(file: &ArrayFile, prefix: &str) -> bool {
    file.element(&format!("{prefix}{NAME}")).is_some()
}

/// Writes the tiles of a scene under names that begin with `prefix`, one after the other.
///
/// # Errors
/// As for [`ArrayFileWriter::array`], and the errors of tiles that cannot be loaded.
pub(super) fn write_tiles(scene: &Scene, prefix: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let Some(tiles) = &scene.tiles else { return Ok(()) };
    let mut reader = TileReader::new(tiles);
    let (mut stored, mut rasters) = (Vec::new(), Vec::<Arc<[u32]>>::new());
    for (i, facts) in tiles.facts().iter().enumerate() {
        let written = reader.get(i).map(|tile| {
            write_scene(&tile.scene, &tile.tree, &prefix_of(prefix, i), out).map(|()| tile.memory() as u64)
        });
        reader.release()?;
        let Some(bytes) = written.transpose()? else { continue };
        let place = facts.place.as_ref().map(|place| {
            let raster = rasters.iter().position(|rows| Arc::ptr_eq(rows, &place.rows));
            let raster = raster.unwrap_or_else(|| {
                rasters.push(place.rows.clone());
                rasters.len() - 1
            });
            let PlaceInRaster { first_row, columns, ref before, missing, .. } = *place;
            StoredPlace { raster, first_row, columns, before: before.clone(), missing }
        });
        let Before { own_triangles, own_cubes, instances, .. } = facts.before;
        stored.push(StoredTile {
            bounds: facts.bounds,
            part: facts.part,
            materials: facts.materials.clone(),
            triangles: facts.triangles,
            cubes: facts.cubes,
            max_cube: facts.max_cube,
            checksum: facts.checksum,
            bytes,
            before: [own_triangles, own_cubes, instances],
            place,
        });
    }
    let rasters = rasters.iter().map(|rows| rows.to_vec()).collect();
    out.value(format!("{prefix}{NAME}"), &StoredTiles { tiles: stored, rasters })
}

/// The tiles of a packed scene.
pub(super) struct PackedTiles {
    file: Arc<ArrayFile>,
    prefix: String,
    builder: Builder,
    facts: Vec<TileFacts>,
}

impl PackedTiles {
    /// Reads the facts about all tiles of `scene`, which was read from the arrays whose names begin with
    /// `prefix`.
    ///
    /// # Errors
    /// As for [`ArrayFile::value`].
    pub fn read(file: &Arc<ArrayFile>, prefix: &str, scene: &Scene, builder: Builder) -> Result<PackedTiles> {
        let stored: StoredTiles = file.value(&format!("{prefix}{NAME}"))?;
        let rasters: Vec<Arc<[u32]>> = stored.rasters.into_iter().map(Arc::from).collect();
        let facts = stored.tiles.into_iter().map(|tile| tile.facts(scene, &rasters));
        let facts = facts.collect::<Option<Vec<_>>>();
        let facts = facts.ok_or_else(|| file.refuse("its tiles refer to something that does not exist"))?;
        Ok(PackedTiles { file: file.clone(), prefix: prefix.to_owned(), builder, facts })
    }

    /// Number of tiles.
    pub fn len(&self) -> usize {
        self.facts.len()
    }

    /// Memory of all tiles with their trees, bytes.
    pub fn bytes(&self) -> u64 {
        self.facts.iter().map(|tile| tile.bytes).fold(0, u64::saturating_add)
    }

    /// Reads a tile with its tree, and with `colours` if they are requested.
    ///
    /// # Errors
    /// As for [`ArrayFile::array`].
    pub fn read_tile(&self, tile: usize, colours: bool) -> Result<Scene> {
        let scene = read_scene(&self.file, &prefix_of(&self.prefix, tile), self.builder, colours)?;
        let (g, facts) = (&scene.geometry, &self.facts[tile]);
        let numbers = [g.triangle_count(), g.cube_count(), scene.materials.len(), scene.parts.len()];
        let expected = [facts.triangles as usize, facts.cubes as usize, facts.materials.len(), 1];
        match numbers == expected && scene.instances.is_none() && scene.moving_parts.is_empty() {
            true => Ok(scene),
            false => Err(self.file.refuse("tile metadata does not match the stored arrays")),
        }
    }

    /// The tiles of a scene with `own` primitives outside of tiles. Without options of tiles they stay in
    /// memory.
    ///
    /// # Errors
    /// [`vlscan_base::Error::Input`] if their primitives cannot be numbered.
    pub fn finish(self, options: &LoadOptions, own: usize) -> Result<Tiles> {
        let (jobs, colours, trees) = (options.jobs, options.colours, BuildOptions::of(self.builder));
        let kept = || TileOptions { memory: u64::MAX, trees };
        let TileOptions { memory, trees } = options.tiles.clone().unwrap_or_else(kept);
        let (facts, bytes) = (self.facts.clone(), self.facts.iter().map(|tile| tile.bytes));
        let items = Residency::new(memory).add(bytes.collect::<Vec<_>>(), move |tile| {
            let load = || {
                let mut scene = self.read_tile(tile, colours)?;
                let tree = scene.tree(&trees);
                scene.packed_tree = None;
                Ok(Tile { scene, tree: Arc::unwrap_or_clone(tree) })
            };
            let loaded = machine::with_pool(jobs, load).flatten();
            let loaded = loaded.map_err(|error| Arc::new(error) as LoadError)?;
            let bytes = loaded.memory() as u64;
            Ok((loaded, bytes))
        });
        Tiles::new(facts, items, own)
    }
}

impl StoredTile {
    /// The facts of a tile of `scene`; `None` if they are not possible.
    fn facts(self, scene: &Scene, rasters: &[Arc<[u32]>]) -> Option<TileFacts> {
        let place = match self.place {
            None => None,
            Some(place) => {
                let rows = rasters.get(place.raster)?.clone();
                let end = place.first_row.checked_add(place.before.len())?;
                let triangles = place.columns.checked_mul(2)?.checked_mul(place.before.len())?;
                let is_valid = end < rows.len() && triangles == self.triangles as usize;
                (is_valid && place.missing <= self.triangles).then_some(())?;
                let StoredPlace { first_row, columns, before, missing, .. } = place;
                Some(PlaceInRaster { rows, first_row, columns, before, missing })
            }
        };
        let are_materials = self.materials.iter().all(|m| (*m as usize) < scene.materials.len());
        let [own_triangles, own_cubes, instances] = self.before;
        let instance_count = scene.instances.as_ref().map_or(0, |set| set.instances.all.len());
        let is_valid = are_materials
            && (self.part as usize) < scene.parts.len()
            && own_triangles as usize <= scene.geometry.triangle_count()
            && own_cubes as usize <= scene.geometry.cube_count()
            && instances as usize <= instance_count;
        is_valid.then(|| TileFacts {
            bounds: self.bounds,
            part: self.part,
            materials: self.materials,
            triangles: self.triangles,
            cubes: self.cubes,
            max_cube: self.max_cube,
            checksum: self.checksum,
            bytes: self.bytes,
            place,
            before: Before { own_triangles, own_cubes, instances, ..Before::default() },
            ..TileFacts::default()
        })
    }
}
