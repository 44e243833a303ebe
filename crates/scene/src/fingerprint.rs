//! Checksums of scenes.

use super::heights::add_heights;
use super::model::Scene;
use super::pack::Pack;
use super::surfaces::SurfaceIds;
use std::path::Path;
use vlscan_base::error::{Error, Result};
use vlscan_base::store::Checksum;
use vlscan_survey::{Loader, MaterialChoice, SceneRecipe};
use vlscan_trace::Geometry;

/// Checksum of the scene of the first epoch, `scene`, and of the replacements of its parts. File names and
/// the tree are excluded; colours are included if they were loaded. The checksum of a packed scene is derived
/// from the checksums within it, so the scene is not read.
///
/// # Errors
/// [`Error::Io`] for files of swapped parts that cannot be read; the errors of packed scenes.
pub fn fingerprint(scene: &Scene, recipe: &SceneRecipe) -> Result<u64> {
    if let Some(path) = &recipe.packed {
        return Ok(Pack::open(path)?.fingerprint());
    }
    let mut sum = Checksum::default();
    sum.debug(&(scene.shift, scene.bounds, &scene.surfaces, &scene.parts, &scene.materials));
    sum.debug(&(&scene.moving_parts, scene.dyn_step, scene.dyn_time_step));
    add_geometry(&mut sum, &scene.geometry);
    sum.array(&scene.voxels);
    add_fields(&mut sum, scene);
    add_grids(&mut sum, scene);
    match &scene.surface_ids {
        SurfaceIds::Narrow(ids) => sum.array(ids),
        SurfaceIds::Wide(ids) => sum.array(ids),
    }
    if let Some(set) = &scene.instances {
        set.instances.models.iter().for_each(|model| add_geometry(&mut sum, &model.geometry));
        set.materials.iter().for_each(|materials| sum.array(materials));
        sum.array(&set.parts);
        sum.debug(&set.instances.all);
    }
    for tile in scene.tiles.iter().flat_map(|tiles| tiles.facts()) {
        sum.debug(&(tile.checksum, tile.first, tile.part, &tile.materials));
    }
    if let Some(colours) = &scene.colours {
        colours.add_to(&mut sum);
    }
    for swap in recipe.parts.iter().flat_map(|part| &part.swaps) {
        sum.debug(&(swap.epochs, swap.keep_crs, swap.vanish, swap.scale, swap.offset));
        if let Some(loader) = &swap.loader {
            add_loader(&mut sum, loader)?;
        }
    }
    Ok(sum.finish())
}

fn add_geometry(sum: &mut Checksum, geometry: &Geometry) {
    sum.array(&geometry.vertices);
    sum.array(&geometry.triangles);
    sum.array(&geometry.cubes);
}

/// Adds the height fields, if there are any.
fn add_fields(sum: &mut Checksum, scene: &Scene) {
    for (field, surface) in scene.geometry.fields.iter().zip(&scene.field_surfaces) {
        sum.debug(&(field.grid(), field.first(), surface));
        add_heights(sum, field.heights());
    }
}

/// Adds the grids of voxels, if there are any.
fn add_grids(sum: &mut Checksum, scene: &Scene) {
    for (grid, voxels) in scene.geometry.grids.iter().zip(&scene.grid_voxels) {
        let (values, starts, along) = grid.cells().arrays();
        sum.debug(&(grid.place(), grid.first(), values));
        sum.array(starts);
        sum.array(along);
        voxels.add_to(sum);
    }
}

/// Adds the files and the settings of a loader.
fn add_loader(sum: &mut Checksum, loader: &Loader) -> Result<()> {
    let file = |sum: &mut Checksum, path: &Path| sum.file(path).map_err(|e| Error::io("read", path, e));
    let material = |sum: &mut Checksum, material: &MaterialChoice| {
        sum.debug(&(&material.name, material.random_variants, material.random_range));
        material.file.as_deref().map_or(Ok(()), |path| file(sum, path))
    };
    match loader {
        Loader::MeshFiles { files, reading } => {
            sum.debug(&(reading.up, reading.metres_per_unit()));
            files.iter().chain(&reading.materials).try_for_each(|path| file(sum, path))
        }
        Loader::Mesh(mesh) => {
            sum.debug(&(mesh.vertices(), mesh.triangles(), mesh.materials(), mesh.material_of()));
            Ok(())
        }
        Loader::GeoTiff { files, material: choice } => {
            files.all().iter().try_for_each(|path| file(sum, path))?;
            material(sum, choice)
        }
        Loader::Xyz(xyz) => {
            sum.debug(&(&xyz.separator, xyz.voxel_size, xyz.max_color_value, xyz.default_normal));
            sum.debug(&(xyz.rgb_columns, xyz.normal_columns, xyz.snap_neighbor_normal, xyz.estimate_normals));
            xyz.files.iter().try_for_each(|path| file(sum, path))?;
            material(sum, &xyz.material)
        }
        Loader::DetailedVoxels(voxels) => {
            sum.debug(&(voxels.mode, voxels.drop_empty, voxels.random_shift));
            voxels.files.iter().chain(&voxels.lad_table).try_for_each(|path| file(sum, path))?;
            material(sum, &voxels.material)
        }
    }
}
