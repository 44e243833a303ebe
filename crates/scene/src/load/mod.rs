//! Builds the finished scene from its description (spec input-formats §3.6): loads and transforms all parts,
//! drops those with `onGround` to the ground, and moves the origin to the centre of the scene.
//!
//! | file | what it does |
//! |---|---|
//! | `part`, `files` | parts with their ids, names and places; what their files hold |
//! | `mesh` | meshes in files and in memory |
//! | `raster` | terrain from GeoTIFF |
//! | `cloud` | point clouds as cubes |
//! | `voxel` | vegetation voxels |
//! | `tiles` | parts that are loaded when rays need them |
//! | `stored` | parts that are in memory although others are tiles |
//! | `voxel_store` | voxels of both as a grid or as cubes |

mod cloud;
mod files;
mod mesh;
mod part;
pub(crate) mod raster;
mod stored;
mod tiles;
mod voxel;
mod voxel_store;
#[cfg(test)]
mod voxel_store_tests;

use crate::builder::{Extent, LoadOptions, SceneBuilder};
use crate::crs::find_crs;
use crate::epoch::{SceneFrame, keeps_frame};
use crate::library::Library;
use crate::model::{Part, Scene};
use crate::pack::Pack;
use crate::spectra::Spectra;
use crate::{change, ground, instances};
use mesh::EpochPart;
pub use mesh::{GltfError, MeshError, OffError, PlyMeshError, StlError, obj_materials};
pub use raster::{GridError, RasterError, UnpackError, raster_needs};
use rayon::prelude::*;
use std::sync::Arc;
use tiles::TileIndex;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Result;
use vlscan_base::machine;
use vlscan_survey::SceneRecipe;

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
/// [`vlscan_base::Error::Input`] for files that are missing or invalid, and scenes beyond the memory limit;
/// [`vlscan_base::Error::Io`].
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
    let mut loaded = part::LoadedParts::default();
    let mut ids = part::Ids::default();
    for EpochPart { recipe: part, is_present } in &parts {
        if *is_present {
            part::load_part(&mut scene, part, &mut ids, &mut loaded)?;
        } else {
            let name = part::name_of(part, part.loader.files());
            scene.parts.push(Part { id: ids.single(part), name, lad: None });
        }
    }
    let part::LoadedParts { stored, tiles, frames, water } = loaded;
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
    water.report(&mut scene.diagnostics);
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
