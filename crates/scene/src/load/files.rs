//! Loads the files of a part, and transforms what they hold.

use super::{cloud, mesh, raster, voxel};
use crate::builder::{Extent, FaceNumbers, PartSource, SceneBuilder};
use crate::change;
use crate::library::Names;
use crate::text::{Source, is_wrong_name};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::fault;
use vlscan_geom::Rotation;
use vlscan_survey::{Loader, MaterialChoice, PartRecipe, Replaced, Transform, VoxelMode};
use vlscan_trace::{Similarity, VoxelGrid};

/// Memory limit of the text of a mesh, bytes: files of more than an eighth of it are mapped.
const MESH_FILE_MEMORY: u64 = 1 << 30;

/// Loads and transforms the files of one part.
pub(super) fn load_files(
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
pub(super) fn similarity(transform: &Transform) -> Similarity {
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

/// The materials that a loader names for its part; `None` after an error.
pub(super) fn choose(
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
