//! Loads parts: their files, ids, names and places.

use super::files::{choose, load_files, similarity};
use super::tiles::{TileIndex, is_tile};
use super::{mesh, raster};
use crate::builder::{MAX_COORDINATE, PartSource, SceneBuilder};
use crate::frames::PartFrames;
use crate::ground::{self, Body, LoadedPart};
use crate::lad::LadTable;
use crate::library::Names;
use crate::model::{MovingPart, Part};
use crate::text::{Source, printable};
use crate::water_levels::WaterLevels;
use crate::{change, instances};
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_base::diag::Place;
use vlscan_base::error::Result;
use vlscan_geom::Aabb;
use vlscan_survey::{Loader, PartRecipe, Transform};

/// Loaded parts of a scene.
#[derive(Default)]
pub(super) struct LoadedParts {
    /// Parts that are in memory.
    pub stored: Vec<LoadedPart>,
    /// Parts that are loaded again when rays need them.
    pub tiles: TileIndex,
    pub frames: PartFrames,
    pub water: WaterLevels,
}

/// Assigns ids: a part without one gets numbers, and each of its files becomes a separate part.
#[derive(Default)]
pub(super) struct Ids {
    additional: u64,
}

impl Ids {
    /// The id of a part that remains a single part for any number of files.
    pub fn single(&self, part: &PartRecipe) -> String {
        let numbered = || (u64::from(part.number) + self.additional).to_string();
        part.id.as_deref().filter(|id| !id.is_empty()).map_or_else(numbered, printable)
    }

    /// The ids of the parts created from a recipe, each with its files.
    fn with_files<'a>(&mut self, part: &PartRecipe, files: &'a [PathBuf]) -> Vec<(String, &'a [PathBuf])> {
        let are_tiles = matches!(part.loader, Loader::GeoTiff { .. });
        let is_one = are_tiles || files.is_empty() || !part.swaps.is_empty();
        if is_one || part.id.as_ref().is_some_and(|id| !id.is_empty()) {
            return vec![(self.single(part), files)];
        }
        let first = u64::from(part.number) + self.additional;
        self.additional += files.len().saturating_sub(1) as u64;
        (first..).map(|n| n.to_string()).zip(files.chunks(1)).collect()
    }
}

/// Loads a part, or the parts of its files.
pub(super) fn load_part(
    scene: &mut SceneBuilder,
    part: &PartRecipe,
    ids: &mut Ids,
    loaded: &mut LoadedParts,
) -> Result<()> {
    let files = part.loader.files();
    if files.is_empty() && !matches!(part.loader, Loader::Mesh(_)) {
        scene
            .diagnostics
            .warn(part.place.clone(), format!("part {} names no file and is left out", describe(part)));
        return Ok(());
    }
    if raster::is_paged(scene.options, part) && load_pages(scene, part, ids, loaded)? {
        return Ok(());
    }
    let lad = leaf_angles(scene, part);
    let mut names = Names::default();
    let first_tile = loaded.tiles.len();
    for (id, files) in ids.with_files(part, files) {
        let known_names = names.len();
        let instance = instances::add_instance(scene, part, |scene, part, files| {
            load_files(scene, part, files, &mut Names::default())
        })?;
        let body = match instance {
            Some(instance) => instance.map(Body::Instance),
            None => {
                let start = scene.end();
                load_files(scene, part, files, &mut names)?;
                Some(scene.since(&start)).filter(|extent| !extent.is_empty()).map(Body::Stored)
            }
        };
        let Some(body) = body else {
            // What could not be read is an error already.
            if !scene.diagnostics.is_fatal(false) {
                warn_of_empty(scene, part, &id);
            }
            match part.swaps.is_empty() {
                true => scene.leave_out_next_part(),
                false => scene.parts.push(Part { id, name: name_of(part, files), lad: None }),
            }
            continue;
        };
        let bounds = match &body {
            Body::Instance(i) => instances::outer_bounds(&scene.meshes, *i),
            Body::Stored(extent) => ground::bounds(&scene.geometry, extent),
        };
        check_coordinates(scene, &id, bounds, &body, part.place.as_ref());
        loaded.frames.add(&id, part.place.as_ref(), bounds);
        let extent = if let Body::Stored(extent) = &body { Some(extent) } else { None };
        loaded.water.add(scene, (&id, part.place.as_ref()), bounds, extent);
        mesh::doubts::check(scene, part, files, &body);
        if let Body::Stored(extent) = &body
            && !part.motions.is_empty()
        {
            scene.moving_parts.push(MovingPart {
                part: scene.parts.len() as u32,
                vertices: extent.vertices.clone(),
                triangles: extent.triangles.clone(),
                cubes: extent.cubes.clone(),
                motions: part.motions.clone(),
                timing: part.timing,
            });
        }
        let described = Part { id: id.clone(), name: name_of(part, files), lad: lad.clone() };
        let is_tile = match &body {
            Body::Stored(extent) if part.transform.on_ground == 0 && is_tile(scene.options, part) => {
                loaded.tiles.add(scene, part, (files, described.clone(), known_names), extent)
            }
            _ => false,
        };
        scene.parts.push(described);
        if !is_tile {
            let (on_ground, place) = (part.transform.on_ground, part.place.clone());
            loaded.stored.push(LoadedPart { id, body, on_ground, place });
        }
    }
    let tiles = loaded.tiles.len() - first_tile;
    loaded.tiles.set_names(tiles, names);
    Ok(())
}

/// Loads the facts about the pages of a raster that are needed while the pages are not in memory. Returns
/// `false` for a raster that must stay in memory as a whole: each page would hold the texture of the raster.
fn load_pages(
    scene: &mut SceneBuilder,
    part: &PartRecipe,
    ids: &mut Ids,
    loaded: &mut LoadedParts,
) -> Result<bool> {
    let Loader::GeoTiff { files, material } = &part.loader else { return Ok(false) };
    let id = ids.single(part);
    let target = PartSource { index: scene.next_part(), place: part.place.as_ref() };
    let Some(materials) = choose(scene, &target, part, material) else { return Ok(true) };
    if scene.has_texture(materials[0]) {
        return Ok(false);
    }
    let transform = (part.transform != Transform::IDENTITY).then(|| similarity(&part.transform));
    let indexed = raster::PagedRaster::index(scene, &target, files, transform)?;
    let Some((raster, pages)) = indexed.filter(|(_, pages)| !pages.is_empty()) else {
        // What could not be read is an error already.
        if !scene.diagnostics.is_fatal(false) {
            warn_of_empty(scene, part, &id);
        }
        scene.leave_out_next_part();
        return Ok(true);
    };
    let material = change::material_of(scene, &target, &part.changes, materials[0]);
    let bounds = pages.iter().fold(Aabb::EMPTY, |all, page| all.union(page.bounds));
    refuse_far(scene, &id, reach(bounds), part.place.as_ref());
    loaded.frames.add(&id, part.place.as_ref(), bounds);
    loaded.water.add(scene, (&id, part.place.as_ref()), bounds, None);
    let described = Part { id, name: name_of(part, files.all()), lad: None };
    loaded.tiles.add_raster(scene, &described, (material, materials[0]), raster, pages);
    scene.parts.push(described);
    Ok(true)
}

/// The name of a mesh in memory, or of the first of a part's files, without its extension.
pub(super) fn name_of(part: &PartRecipe, files: &[PathBuf]) -> String {
    if let Some(name) = &part.name {
        return printable(name);
    }
    if let Loader::Mesh(mesh) = &part.loader {
        return printable(mesh.name());
    }
    printable(&files.first().and_then(|file| file.file_stem()).unwrap_or_default().to_string_lossy())
}

fn leaf_angles(scene: &mut SceneBuilder, part: &PartRecipe) -> Option<Arc<LadTable>> {
    let Loader::DetailedVoxels(loader) = &part.loader else { return None };
    let path = loader.lad_table.as_ref()?;
    if !part.motions.is_empty() {
        let message = format!("part {} moves, so its leaf angle table is not used", describe(part));
        scene.diagnostics.warn(part.place.clone(), message);
        return None;
    }
    match Source::open(path) {
        Ok(source) => {
            scene.sources.push(path.clone());
            let rules = scene.options.rules;
            let (table, relevant) = LadTable::read(&source, rules, &mut scene.diagnostics)?;
            scene.leaf_table_rules = scene.leaf_table_rules.or(relevant);
            Some(Arc::new(table))
        }
        Err(e) => {
            let message = format!("cannot read the leaf angle table {}: {e}", path.display());
            scene.diagnostics.error(part.place.clone(), message).of_kind((&e).into());
            None
        }
    }
}

/// Warns of a part that no ray can hit.
fn warn_of_empty(scene: &mut SceneBuilder, part: &PartRecipe, id: &str) {
    let message = format!("part \"{id}\" holds no primitives and is left out");
    let problem = scene.diagnostics.warn(part.place.clone(), message);
    if matches!(part.loader, Loader::GeoTiff { .. }) {
        problem.help("a raster needs at least 2 by 2 pixels with heights");
    }
}

fn describe(part: &PartRecipe) -> String {
    part.id.as_ref().map_or_else(|| format!("number {}", part.number), |id| format!("\"{id}\""))
}

fn check_coordinates(scene: &mut SceneBuilder, id: &str, bounds: Aabb, body: &Body, place: Option<&Place>) {
    if is_far(reach(bounds)) {
        let reach = reach(ground::bounds_of(scene, body));
        refuse_far(scene, id, reach, place);
    }
}

/// Largest absolute coordinate of a box.
fn reach(bounds: Aabb) -> f64 {
    bounds.min.abs().max(bounds.max.abs()).max_element()
}

fn is_far(reach: f64) -> bool {
    reach.is_nan() || reach > MAX_COORDINATE
}

/// Reports a part that reaches beyond what can be computed.
fn refuse_far(scene: &mut SceneBuilder, id: &str, reach: f64, place: Option<&Place>) {
    if is_far(reach) {
        let message = format!(
            "part \"{id}\" reaches {reach:e} m after its transforms; at most {MAX_COORDINATE:e} m can be \
             computed"
        );
        scene.diagnostics.error(place.cloned(), message);
    }
}
