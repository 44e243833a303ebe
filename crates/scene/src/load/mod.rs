//! Builds the finished scene from its description (spec input-formats §3.6): loads and transforms all parts,
//! drops those with `onGround` to the ground, and moves the origin to the centre of the scene.
//!
//! | file | what it does |
//! |---|---|
//! | `mesh` | meshes in files and in memory |
//! | `raster` | terrain from GeoTIFF |
//! | `cloud` | point clouds as cubes |
//! | `voxel` | vegetation voxels |
//! | `tiles` | parts that are loaded when rays need them |
//! | `stored` | parts that are in memory although others are tiles |
//! | `voxel_store` | voxels of both as a grid or as cubes |

mod cloud;
mod mesh;
pub(crate) mod raster;
mod stored;
mod tiles;
mod voxel;
mod voxel_store;
#[cfg(test)]
mod voxel_store_tests;

use crate::builder::{Extent, FaceNumbers, LoadOptions, MAX_COORDINATE, PartSource, SceneBuilder};
use crate::crs::find_crs;
use crate::epoch::{SceneFrame, keeps_frame};
use crate::frames::PartFrames;
use crate::ground::{self, Body, LoadedPart};
use crate::lad::LadTable;
use crate::library::{Library, Names};
use crate::model::{MovingPart, Part, Scene};
use crate::pack::Pack;
use crate::spectra::Spectra;
use crate::text::{Source, is_wrong_name, printable};
use crate::{change, instances};
use mesh::EpochPart;
pub use mesh::{GltfError, MeshError, OffError, PlyMeshError, StlError};
pub use raster::{GridError, RasterError, UnpackError, raster_needs};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tiles::{TileIndex, is_tile};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::fault;
use vlscan_base::machine;
use vlscan_geom::{Aabb, Rotation};
use vlscan_survey::{Loader, MaterialChoice, PartRecipe, Replaced, SceneRecipe, Transform, VoxelMode};
use vlscan_trace::{Similarity, VoxelGrid};

/// Memory limit of the text of a mesh, bytes: files of more than an eighth of it are mapped.
const MESH_FILE_MEMORY: u64 = 1 << 30;

/// Loads a scene in its first epoch and returns it with its warnings. All problems of all files are collected
/// before an error is returned. The result does not depend on the number of threads. Moving parts are in
/// their initial pose.
///
/// ```
/// use vlscan_geom::DVec3;
/// use vlscan_scene::{LoadOptions, load};
/// use vlscan_survey::{Mesh, SceneRecipe};
/// use vlscan_trace::BuildOptions;
///
/// # fn main() -> vlscan_base::Result<()> {
/// // `read_scene` of vlscan-survey makes a recipe from files.
/// let corners = vec![DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(0.0, 4.0, 1.0)];
/// let mesh = Mesh::new(corners, vec![[0, 1, 2]], Vec::new(), Vec::new())?;
/// let (scene, warnings) = load(&SceneRecipe::from(mesh), &LoadOptions::default())?;
///
/// // Geometry is relative to the centre of the scene.
/// let tree = scene.tree(&BuildOptions::default());
/// let above = scene.to_local(DVec3::new(1.0, 2.0, 10.0));
/// let hit = tree.nearest_where(&scene.geometry, above, -DVec3::Z, |_| true).expect("the triangle");
/// assert_eq!(hit.t, 9.5);
/// assert_eq!(scene.material_of(hit.primitive).classification, 0);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`Error::Input`] for files that are missing or invalid, and scenes beyond the memory limit; [`Error::Io`].
pub fn load(recipe: &SceneRecipe, options: &LoadOptions) -> Result<(Scene, Diagnostics)> {
    load_epoch(recipe, options, 0, None)
}

/// Loads a scene in an epoch, counted from 0. Later epochs share the frame of the `first`. Part indices are
/// equal in all epochs: a swapped part keeps its index and its single id, also while it is absent.
pub fn load_epoch(
    recipe: &SceneRecipe,
    options: &LoadOptions,
    epoch: u32,
    first: Option<SceneFrame>,
) -> Result<(Scene, Diagnostics)> {
    if let Some(path) = &recipe.packed {
        let read = || {
            let pack = Pack::open(path)?;
            let mut warnings = Diagnostics::default();
            if options.tiles.is_some() && !pack.has_tiles(epoch) {
                let message =
                    "the scene was packed without --scene-memory, so that it is read into memory whole";
                warnings.warn(Some(Place::of_file(path)), message.to_owned());
            }
            if options.colours && epoch == 0 && !pack.has_colours(epoch) {
                let message = "the scene was packed without colours: red, green and blue of all points are 0";
                let help = "pack the scene again with --colours";
                warnings.warn(Some(Place::of_file(path)), message.to_owned()).help(help);
            }
            Ok((pack.scene(options, epoch)?, warnings))
        };
        return machine::with_pool(options.jobs, read)?;
    }
    machine::with_pool(options.jobs, || load_sources(recipe, options, epoch, first))?
}

fn load_sources(
    recipe: &SceneRecipe,
    options: &LoadOptions,
    epoch: u32,
    first: Option<SceneFrame>,
) -> Result<(Scene, Diagnostics)> {
    let wavelengths = std::iter::once(&options.wavelength_nm).chain(&options.further_wavelengths_nm);
    let spectra = Spectra::new(&recipe.asset_folders, wavelengths.copied());
    let library = Library::new(spectra, options.rules, options.seed);
    let mut scene = SceneBuilder::new(options, library);
    let parts = mesh::parts_in_epoch(&mut scene, recipe, epoch)?;
    let present = parts.iter().filter(|part| part.is_present).map(|part| part.recipe.as_ref());
    scene.meshes = instances::plan_sharing(present, options.sharing);
    let mut loaded = LoadedParts::default();
    let mut ids = Ids::default();
    for EpochPart { recipe: part, is_present } in &parts {
        if *is_present {
            load_part(&mut scene, part, &mut ids, &mut loaded)?;
        } else {
            let name = name_of(part, part.loader.files());
            scene.parts.push(Part { id: ids.single(part), name, lad: None });
        }
    }
    let LoadedParts { stored, tiles, frames } = loaded;
    if stored.is_empty() && tiles.is_empty() && epoch == 0 && !scene.diagnostics.is_fatal(false) {
        scene
            .diagnostics
            .error(None, format!("scene \"{}\" of {} is empty", recipe.id, recipe.path.display()));
    }
    if epoch == 0 {
        change::report_unused(&mut scene);
    }
    if !tiles.is_empty() {
        stored::refuse_on_ground(&mut scene, &stored);
    }
    if let Some(tiles) = &options.tiles {
        stored::warn_of_memory(&mut scene, &stored, tiles.memory);
    }
    let warnings = std::mem::take(&mut scene.diagnostics).finish(false)?;
    scene.diagnostics = warnings;
    frames.report(&mut scene);
    scene.library.issues.report(options.rules, &mut scene.diagnostics);
    let mut reported = std::mem::take(&mut scene.diagnostics);
    let used = || scene.used_materials(tiles.materials());
    scene.library.units.report(options.rules.reflectance_fraction, used, &mut reported);
    scene.diagnostics = reported;
    ground::drop_to_ground(&mut scene, &stored);
    let crs = match epoch {
        0 => find_crs(recipe, &mut scene.diagnostics),
        _ => None,
    };
    let (scene, warnings) = freeze(scene, tiles, first, keeps_frame(recipe))?;
    Ok((Scene { crs, dyn_step: recipe.dyn_step, dyn_time_step: recipe.dyn_time_step, ..scene }, warnings))
}

/// Loaded parts of a scene.
#[derive(Default)]
struct LoadedParts {
    /// Parts that are in memory.
    stored: Vec<LoadedPart>,
    /// Parts that are loaded again when rays need them.
    tiles: TileIndex,
    frames: PartFrames,
}

/// Assigns ids: a part without one gets numbers, and each of its files becomes a separate part.
#[derive(Default)]
struct Ids {
    additional: u64,
}

impl Ids {
    /// The id of a part that remains a single part for any number of files.
    fn single(&self, part: &PartRecipe) -> String {
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

fn load_part(
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
                let message = format!("part \"{id}\" holds no primitives and is left out");
                scene.diagnostics.warn(part.place.clone(), message);
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
            let message = format!("part \"{id}\" holds no primitives and is left out");
            scene.diagnostics.warn(part.place.clone(), message);
        }
        scene.leave_out_next_part();
        return Ok(true);
    };
    let material = change::material_of(scene, &target, &part.changes, materials[0]);
    let bounds = pages.iter().fold(Aabb::EMPTY, |all, page| all.union(page.bounds));
    refuse_far(scene, &id, reach(bounds), part.place.as_ref());
    loaded.frames.add(&id, part.place.as_ref(), bounds);
    let described = Part { id, name: name_of(part, files.all()), lad: None };
    loaded.tiles.add_raster(scene, &described, (material, materials[0]), raster, pages);
    scene.parts.push(described);
    Ok(true)
}

/// The name of a mesh in memory, or of the first of a part's files, without its extension.
fn name_of(part: &PartRecipe, files: &[PathBuf]) -> String {
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

/// Loads and transforms the files of one part.
fn load_files(
    scene: &mut SceneBuilder,
    part: &PartRecipe,
    files: &[PathBuf],
    names: &mut Names,
) -> Result<()> {
    let target = PartSource { index: scene.next_part(), place: part.place.as_ref() };
    let chosen = match &part.loader {
        Loader::MeshFiles { .. } | Loader::Mesh(_) => Some(Vec::new()),
        Loader::GeoTiff { material, .. } => choose(scene, &target, part, material),
        Loader::Xyz(loader) => choose(scene, &target, part, &loader.material),
        Loader::DetailedVoxels(loader) => choose(scene, &target, part, &loader.material),
    };
    let Some(materials) = chosen else { return Ok(()) };
    let start = scene.end();
    let names_faces = part.changes.iter().any(|change| matches!(change.replaced, Replaced::Faces(_)));
    // Corners of OBJ files find their texture coordinates by the numbers of their faces.
    let are_requested = names_faces || scene.options.colours;
    scene.faces = FaceNumbers { are_requested, ..FaceNumbers::default() };
    scene.part_changes = part.changes.clone();
    let mut densities = Vec::new();
    match &part.loader {
        Loader::Mesh(triangles) => mesh::memory::load(scene, &target, triangles)?,
        Loader::GeoTiff { files, .. } => {
            let keeps_grid = raster::keeps_grid(part) && !scene.options.triangulate_rasters;
            raster::load(scene, &target, files, materials[0], keeps_grid)?;
        }
        _ => {}
    }
    let files = if matches!(part.loader, Loader::GeoTiff { .. }) { &[] } else { files };
    for file in files {
        let Some(source) = open(scene, part, file)? else { continue };
        match &part.loader {
            Loader::MeshFiles { reading, .. } => mesh::load(scene, &target, &source, reading, names)?,
            Loader::Mesh(_) | Loader::GeoTiff { .. } => {}
            Loader::Xyz(loader) => {
                cloud::load(scene, &target, &source, loader, (&materials, keeps_voxel_grids(part)))?;
            }
            Loader::DetailedVoxels(loader) => {
                let materials = (&materials[..], keeps_voxel_grids(part));
                densities.extend(voxel::load(scene, &target, &source, loader, materials)?);
            }
        }
        source.check_unchanged()?;
    }
    let extent = scene.since(&start);
    change::apply(scene, &target, &part.changes, &extent);
    apply_transform(scene, &part.loader, &part.transform, &extent);
    if let Loader::DetailedVoxels(loader) = &part.loader
        && let VoxelMode::Scaled(exponent) = loader.mode
    {
        voxel::scale_by_density(scene, &densities, exponent, loader.random_shift.then_some(target.index));
    }
    Ok(())
}

/// Applies a part's transform (spec input-formats §3.3), except dropping it to the ground. Triangles and
/// point clouds are fully transformed; cubes remain axis-aligned, and vegetation cubes are scaled in place.
fn apply_transform(scene: &mut SceneBuilder, loader: &Loader, transform: &Transform, extent: &Extent) {
    if (Transform { on_ground: 0, ..*transform }) == Transform::IDENTITY {
        return;
    }
    scene.geometry.vertices[extent.vertices.clone()].par_iter_mut().for_each(|v| *v = transform.apply(*v));
    let of_centres = match loader {
        Loader::DetailedVoxels(_) => Transform { scale: 1.0, ..*transform },
        Loader::MeshFiles { .. } | Loader::GeoTiff { .. } | Loader::Xyz(_) | Loader::Mesh(_) => *transform,
    };
    scene.geometry.fields[extent.fields.clone()]
        .iter_mut()
        .for_each(|field| field.transform(similarity(transform)));
    for place in scene.geometry.grids[extent.grids.clone()].iter_mut().map(VoxelGrid::place_mut) {
        place.transform = Some((of_centres.scale, of_centres.offset));
        place.half *= transform.scale.abs();
    }
    scene.geometry.cubes[extent.cubes.clone()].par_iter_mut().for_each(|cube| {
        cube.centre = of_centres.apply(cube.centre);
        cube.half *= transform.scale.abs();
    });
    scene.voxels[extent.cubes.clone()].par_iter_mut().for_each(|v| v.rotate(&transform.rotation));
}

/// A part's transform, except dropping it to the ground.
fn similarity(transform: &Transform) -> Similarity {
    let Transform { rotation, scale, offset, .. } = *transform;
    Similarity { rotation, scale, offset }
}

/// True if the voxels of a part that are on a grid when they are loaded are on one when they are placed, and
/// are alike.
fn keeps_voxel_grids(part: &PartRecipe) -> bool {
    let Transform { rotation, scale, .. } = part.transform;
    let is_scaled = |loader: &Loader| match loader {
        Loader::DetailedVoxels(voxels) => matches!(voxels.mode, VoxelMode::Scaled(_)),
        _ => false,
    };
    rotation == Rotation::IDENTITY
        && scale > 0.0
        && scale.is_finite()
        && part.motions.is_empty()
        && !part.changes.iter().any(|change| matches!(change.replaced, Replaced::Faces(_)))
        && !is_scaled(&part.loader)
}

fn choose(
    scene: &mut SceneBuilder,
    target: &PartSource,
    part: &PartRecipe,
    choice: &MaterialChoice,
) -> Option<Vec<u32>> {
    // Nothing is missing where another material replaces that of the whole part.
    let is_replaced = part.changes.iter().any(|change| change.replaced == Replaced::All);
    let place = target.place.filter(|_| choice.file.is_some() || !is_replaced);
    scene.library.chosen(choice, target.index, place, &mut scene.diagnostics)
}

/// Opens a file of a part; `None` after an error in its name.
fn open(scene: &mut SceneBuilder, part: &PartRecipe, file: &Path) -> Result<Option<Source>> {
    // Voxels take less memory than their files, and triangles hardly more, so large files are mapped and
    // released while they are read.
    let memory = match &part.loader {
        Loader::DetailedVoxels(_) | Loader::Xyz(_) => Some(0),
        Loader::MeshFiles { .. } => {
            Some(scene.options.max_memory.map_or(MESH_FILE_MEMORY, |limit| limit.min(MESH_FILE_MEMORY)))
        }
        _ => scene.options.max_memory,
    };
    match fault::point().and_then(|()| Source::open_within(file, memory)) {
        Ok(source) => {
            scene.sources.push(file.to_path_buf());
            Ok(Some(source))
        }
        Err(e) if is_wrong_name(&e) => {
            let message = format!("cannot read {}: {e}", file.display());
            scene.diagnostics.error(part.place.clone(), message).of_kind((&e).into());
            Ok(None)
        }
        Err(e) => Err(Error::io("read", file, e)),
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

/// Moves the origin to the centre of the scene, or to that of the first epoch, and builds the final scene.
fn freeze(
    scene: SceneBuilder,
    tiles: TileIndex,
    first: Option<SceneFrame>,
    keep_frame: bool,
) -> Result<(Scene, Diagnostics)> {
    let SceneBuilder { mut geometry, mut voxels, library, mut sources, .. } = scene;
    let mut instances = instances::freeze(scene.meshes, geometry.len())?;
    let all = Extent { triangles: 0..0, ..Extent::of(&geometry) };
    let own = ground::bounds(&geometry, &all);
    let own = own.union(tiles.bounds());
    let world = instances.as_ref().map_or(own, |set| set.instances.exact_bounds(own));
    let shift = first.map_or_else(|| world.centre(), |first| first.shift);
    geometry.vertices.par_iter_mut().for_each(|v| *v -= shift);
    geometry.cubes.par_iter_mut().for_each(|c| c.centre -= shift);
    geometry.fields.iter_mut().for_each(|field| field.shift(shift));
    geometry.grids.iter_mut().for_each(|grid| grid.place_mut().shift = shift);
    if let Some(instances) = instances.as_mut().and_then(|set| Arc::get_mut(&mut set.instances)) {
        instances.shift = shift;
    }
    geometry.vertices.shrink_to_fit();
    geometry.triangles.shrink_to_fit();
    geometry.cubes.shrink_to_fit();
    voxels.shrink_to_fit();
    let mut surface_ids = scene.triangle_surfaces;
    surface_ids.extend(scene.cube_surfaces);
    let own = ground::bounds(&geometry, &all);
    let own = own.union(tiles.bounds_from(shift));
    let found = instances.as_ref().map_or(own, |set| set.instances.exact_bounds(own));
    let numbers = geometry.len() + instances.as_ref().map_or(0, |set| set.instances.triangles() as usize);
    let tiles = tiles.finish(scene.options, &library, shift, numbers)?;
    let colours = scene.options.colours.then(|| Arc::new(scene.colours.finish()));
    sources.extend(library.files());
    sources.sort();
    sources.dedup();
    let frozen = Scene {
        shift,
        bounds: first.map_or(found, |first| first.bounds(found, keep_frame)),
        geometry,
        surface_ids: surface_ids.into(),
        field_surfaces: scene.field_surfaces,
        surfaces: scene.surfaces,
        parts: scene.parts,
        relevant_rules: library.relevant_rules.or(scene.leaf_table_rules),
        materials: library.materials,
        voxels,
        grid_voxels: scene.grid_voxels,
        moving_parts: scene.moving_parts,
        instances,
        tiles,
        colours,
        sources,
        ..Scene::default()
    };
    Ok((frozen, scene.diagnostics))
}
