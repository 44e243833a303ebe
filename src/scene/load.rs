//! From a scene's description to the frozen scene (spec input-formats §3.6): load all parts, place each, settle those that
//! stand on the ground, move the whole to its centre.

use super::assembly::{Assembly, Extent, MAX_COORDINATE, PartSource};
use super::epoch::{self, SceneFrame};
use super::ground::{self, Body, PlacedPart};
use super::instances::{self, Sharing};
use super::library::{Library, Names};
use super::spectra::Spectra;
use super::text::Source;
use super::{LadTable, MaterialRules, MovingPart, Pack, Part, Scene, geotiff, obj, place, vox, xyz};
use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use crate::survey::{Loader, MaterialChoice, PartRecipe, SceneRecipe, UpAxis, VoxelMode};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Settings of [`load`].
#[derive(Clone, Debug)]
pub struct LoadOptions {
    /// Wavelength of the first device, nm; spectra are evaluated there.
    pub wavelength_nm: f64,
    /// Seed of random materials and random voxel shifts.
    pub seed: u64,
    /// Where materials and leaf angle tables are not read as the reference does.
    pub rules: MaterialRules,
    /// As the reference does, leave out OBJ faces with more than four vertices (trap 51).
    pub drop_polygons: bool,
    /// Most bytes that the scene may need, without the tree over it.
    pub max_memory: Option<u64>,
    /// Threads; 0 means all.
    pub jobs: usize,
    /// When parts share meshes.
    pub sharing: Sharing,
}

impl Default for LoadOptions {
    /// 1064 nm, seed 0, the reference's materials, all polygons, no limit, all threads.
    fn default() -> LoadOptions {
        LoadOptions {
            wavelength_nm: 1064.0,
            seed: 0,
            rules: MaterialRules::default(),
            drop_polygons: false,
            max_memory: None,
            jobs: 0,
            sharing: Sharing::Auto,
        }
    }
}

/// Loads, places, shifts and freezes a scene. The warnings come with it; all problems of all files are collected before
/// an error ends the run. The result does not depend on the number of threads. Moving parts stand where they do at first.
pub fn load(recipe: &SceneRecipe, options: &LoadOptions) -> Result<(Scene, Diagnostics)> {
    load_epoch(recipe, options, 0, None)
}

/// Like [`load`], of the given epoch, counted from 0. Later epochs share the frame of the `first`. Parts have the
/// same numbers in all epochs: a swapped part keeps its number, and its one id, also while it is absent.
pub fn load_epoch(
    recipe: &SceneRecipe,
    options: &LoadOptions,
    epoch: u32,
    first: Option<SceneFrame>,
) -> Result<(Scene, Diagnostics)> {
    if let Some(path) = &recipe.packed {
        return Ok((Pack::open(path)?.scene(options, epoch)?, Diagnostics::default()));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.jobs)
        .build()
        .map_err(|e| Error::Internal(format!("cannot start the threads that load the scene: {e}")))?;
    pool.install(|| load_state(recipe, options, epoch, first))
}

fn load_state(
    recipe: &SceneRecipe,
    options: &LoadOptions,
    epoch: u32,
    first: Option<SceneFrame>,
) -> Result<(Scene, Diagnostics)> {
    let spectra = Spectra::new(&recipe.asset_folders, options.wavelength_nm);
    let library = Library::new(spectra, options.rules, options.seed);
    let mut scene = Assembly::new(options, library);
    scene.stock.plan(recipe, epoch, options.sharing);
    let mut placed = Vec::new();
    let mut ids = Ids::default();
    for part in &recipe.parts {
        match epoch::part_in_epoch(part, epoch) {
            Some(part) => load_part(&mut scene, &part, &mut ids, &mut placed)?,
            None => scene.parts.push(Part { id: ids.one_of(part), lad: None }),
        }
    }
    if placed.is_empty() && epoch == 0 && !scene.diagnostics.is_fatal(false) {
        scene
            .diagnostics
            .error(None, format!("scene \"{}\" of {} is empty", recipe.id, recipe.path.display()));
    }
    let warnings = std::mem::take(&mut scene.diagnostics).finish(false)?;
    scene.diagnostics = warnings;
    if options.rules.reflectance_fraction {
        scene.library.doubts.report(&mut scene.diagnostics);
    }
    ground::settle(&mut scene, &placed);
    let (scene, warnings) = freeze(scene, first, epoch::keeps_frame(recipe))?;
    Ok((Scene { dyn_step: recipe.dyn_step, dyn_time_step: recipe.dyn_time_step, ..scene }, warnings))
}

/// Hands out ids: a part without one is numbered, and each of its files is a part of its own.
#[derive(Default)]
struct Ids {
    additional: u64,
}

impl Ids {
    /// The id of a part that is one whatever its files are.
    fn one_of(&self, part: &PartRecipe) -> String {
        let numbered = || (u64::from(part.number) + self.additional).to_string();
        part.id.clone().filter(|id| !id.is_empty()).unwrap_or_else(numbered)
    }

    /// The ids of the parts that a recipe makes, each with its files.
    fn of<'a>(&mut self, part: &PartRecipe, files: &'a [PathBuf]) -> Vec<(String, &'a [PathBuf])> {
        if !part.swaps.is_empty() || part.id.as_ref().is_some_and(|id| !id.is_empty()) {
            return vec![(self.one_of(part), files)];
        }
        let first = u64::from(part.number) + self.additional;
        self.additional += files.len().saturating_sub(1) as u64;
        (first..).map(|n| n.to_string()).zip(files.chunks(1)).collect()
    }
}

fn load_part(
    scene: &mut Assembly,
    part: &PartRecipe,
    ids: &mut Ids,
    placed: &mut Vec<PlacedPart>,
) -> Result<()> {
    let files = files_of(&part.loader);
    if files.is_empty() {
        scene
            .diagnostics
            .warn(part.place.clone(), format!("part {} names no file and is left out", described(part)));
    }
    let lad = leaf_angles(scene, part);
    let mut names = Names::default();
    for (id, files) in ids.of(part, files) {
        let body = match instances::place(scene, part)? {
            Some(instance) => instance.map(Body::Instance),
            None => {
                let start = scene.end();
                load_files(scene, part, files, &mut names)?;
                Some(scene.since(&start)).filter(|extent| !extent.is_empty()).map(Body::Stored)
            }
        };
        let Some(body) = body else {
            let message = format!("part \"{id}\" holds no primitives and is left out");
            scene.diagnostics.warn(part.place.clone(), message);
            if !part.swaps.is_empty() {
                scene.parts.push(Part { id, lad: None });
            }
            continue;
        };
        check_coordinates(scene, &id, &body, part.place.as_ref());
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
        scene.parts.push(Part { id: id.clone(), lad: lad.clone() });
        placed.push(PlacedPart { id, body, on_ground: part.transform.on_ground, place: part.place.clone() });
    }
    Ok(())
}

fn leaf_angles(scene: &mut Assembly, part: &PartRecipe) -> Option<Arc<LadTable>> {
    let Loader::DetailedVoxels(loader) = &part.loader else { return None };
    let path = loader.lad_table.as_ref()?;
    if !part.motions.is_empty() {
        let message = format!("part {} moves, so its leaf angle table is not used", described(part));
        scene.diagnostics.warn(part.place.clone(), message);
        return None;
    }
    match Source::open(path) {
        Ok(source) => {
            scene.sources.push(path.clone());
            let rules = scene.options.rules;
            let (table, ruled) = LadTable::read(&source, rules, &mut scene.diagnostics)?;
            scene.leaf_tables = scene.leaf_tables.or(ruled);
            Some(Arc::new(table))
        }
        Err(e) => {
            let message = format!("cannot read the leaf angle table {}: {e}", path.display());
            scene.diagnostics.error(part.place.clone(), message);
            None
        }
    }
}

/// Loads and transforms the files of one part.
pub(super) fn load_files(
    scene: &mut Assembly,
    part: &PartRecipe,
    files: &[PathBuf],
    names: &mut Names,
) -> Result<()> {
    let target = PartSource { index: scene.parts.len() as u32, place: part.place.as_ref() };
    let chosen = match &part.loader {
        Loader::Obj { .. } => Some(Vec::new()),
        Loader::GeoTiff { material, .. } => choose(scene, &target, material),
        Loader::Xyz(loader) => choose(scene, &target, &loader.material),
        Loader::DetailedVoxels(loader) => choose(scene, &target, &loader.material),
    };
    let Some(materials) = chosen else { return Ok(()) };
    let start = scene.end();
    let mut densities = Vec::new();
    for file in files {
        let Some(source) = open(scene, part, file)? else { continue };
        match &part.loader {
            Loader::Obj { up, .. } => {
                let reading =
                    obj::Reading { y_up: *up == UpAxis::Y, drop_polygons: scene.options.drop_polygons };
                obj::load(scene, &target, &source, reading, names)?;
            }
            Loader::GeoTiff { .. } => geotiff::load(scene, &target, &source, materials[0])?,
            Loader::Xyz(loader) => xyz::load(scene, &target, &source, loader, &materials)?,
            Loader::DetailedVoxels(loader) => {
                densities.extend(vox::load(scene, &target, &source, loader, &materials)?);
            }
        }
    }
    let extent = scene.since(&start);
    place::transform(scene, &part.loader, &part.transform, &extent);
    if let Loader::DetailedVoxels(loader) = &part.loader
        && let VoxelMode::Scaled(exponent) = loader.mode
    {
        vox::scale_by_density(scene, &densities, exponent, loader.random_shift.then_some(target.index));
    }
    Ok(())
}

fn choose(scene: &mut Assembly, part: &PartSource, choice: &MaterialChoice) -> Option<Vec<u32>> {
    scene.library.chosen(choice, part.index, part.place, &mut scene.diagnostics)
}

/// Opens a file of a part; `None` after an error about its name.
fn open(scene: &mut Assembly, part: &PartRecipe, file: &Path) -> Result<Option<Source>> {
    match Source::open(file) {
        Ok(source) => {
            scene.sources.push(file.to_path_buf());
            Ok(Some(source))
        }
        Err(e) if is_about_the_name(&e) => {
            scene.diagnostics.error(part.place.clone(), format!("cannot read {}: {e}", file.display()));
            Ok(None)
        }
        Err(e) => Err(Error::io("read", file, e)),
    }
}

fn is_about_the_name(e: &std::io::Error) -> bool {
    use std::io::ErrorKind::{InvalidInput, IsADirectory, NotADirectory, NotFound, PermissionDenied};
    matches!(e.kind(), NotFound | PermissionDenied | IsADirectory | NotADirectory | InvalidInput)
}

fn files_of(loader: &Loader) -> &[PathBuf] {
    match loader {
        Loader::Obj { files, .. } => files,
        Loader::GeoTiff { file, .. } => std::slice::from_ref(file),
        Loader::Xyz(xyz) => &xyz.files,
        Loader::DetailedVoxels(voxels) => &voxels.files,
    }
}

fn described(part: &PartRecipe) -> String {
    part.id.as_ref().map_or_else(|| format!("number {}", part.number), |id| format!("\"{id}\""))
}

fn check_coordinates(scene: &mut Assembly, id: &str, body: &Body, place: Option<&Place>) {
    if matches!(body, Body::Instance(i) if instances::is_near(&scene.stock, *i)) {
        return;
    }
    let bounds = ground::bounds_of(scene, body);
    let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
    if farthest.is_nan() || farthest > MAX_COORDINATE {
        let message = format!(
            "part \"{id}\" reaches {farthest:e} m after its transforms; at most {:e} m can be computed",
            MAX_COORDINATE
        );
        scene.diagnostics.error(place.cloned(), message);
    }
}

fn freeze(scene: Assembly, first: Option<SceneFrame>, keep_frame: bool) -> Result<(Scene, Diagnostics)> {
    let Assembly {
        mut geometry,
        mut voxels,
        triangle_surfaces,
        cube_surfaces,
        surfaces,
        parts,
        moving_parts,
        library,
        stock,
        diagnostics,
        mut sources,
        leaf_tables,
        ..
    } = scene;
    let mut instance_set = instances::freeze(stock, geometry.len())?;
    let all =
        Extent { vertices: 0..geometry.vertices.len(), triangles: 0..0, cubes: 0..geometry.cubes.len() };
    let own = ground::bounds(&geometry, &all);
    let world = instance_set.as_ref().map_or(own, |p| p.instances.exact_bounds(own));
    let shift = first.map_or_else(|| world.centre(), |first| first.shift);
    geometry.vertices.par_iter_mut().for_each(|v| *v -= shift);
    geometry.cubes.par_iter_mut().for_each(|c| c.centre -= shift);
    if let Some(instances) = instance_set.as_mut().and_then(|p| Arc::get_mut(&mut p.instances)) {
        instances.shift = shift;
    }
    geometry.vertices.to_mut().shrink_to_fit();
    geometry.triangles.to_mut().shrink_to_fit();
    geometry.cubes.to_mut().shrink_to_fit();
    voxels.shrink_to_fit();
    let mut surface_ids = triangle_surfaces;
    surface_ids.extend(cube_surfaces);
    let own = ground::bounds(&geometry, &all);
    let found = instance_set.as_ref().map_or(own, |p| p.instances.exact_bounds(own));
    let bounds = first.map_or(found, |first| first.bounds(found, keep_frame));
    let ruled = library.ruled.or(leaf_tables);
    sources.extend(library.files());
    sources.sort();
    sources.dedup();
    let materials = library.materials;
    let surface_ids = surface_ids.into();
    let voxels = voxels.into();
    let scene = Scene {
        shift,
        bounds,
        geometry,
        surface_ids,
        surfaces,
        parts,
        materials,
        voxels,
        moving_parts,
        instances: instance_set,
        ruled,
        sources,
        ..Scene::default()
    };
    Ok((scene, diagnostics))
}
