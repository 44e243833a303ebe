//! Instances of shared meshes: if many or large parts name the same file, its mesh is stored once, as a model, and each
//! of these parts is an instance of it.

use super::builder::{
    MAX_COORDINATE, MAX_ELEMENTS, MeshFile, SceneBuilder, SharedMeshes, Sharing, bounds_of_points,
};
use super::epoch::part_in_epoch;
use super::instance_set::InstanceSet;
use crate::error::{Error, Result};
use crate::geom::{Aabb, DVec3};
use crate::store::Store;
use crate::survey::{Loader, PartRecipe, SceneRecipe, Transform, UpAxis};
use crate::tree::{Geometry, Instances, Model, Placement};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Minimum number of bytes of OBJ text whose repeated storage is avoided for [`Sharing::Auto`] to share a file.
const MIN_SHARED_BYTES: u64 = 64 << 20;

/// Selects the files whose meshes are shared in an epoch.
pub(super) fn plan_sharing(recipe: &SceneRecipe, epoch: u32, sharing: Sharing) -> SharedMeshes {
    let mut users: HashMap<MeshFile, u64> = HashMap::new();
    let parts = recipe.parts.iter().filter_map(|part| part_in_epoch(part, epoch));
    for file in parts.filter_map(|part| mesh_file(&part)) {
        *users.entry(file).or_default() += 1;
    }
    let is_shared = |(path, _): &MeshFile, users: u64| match sharing {
        Sharing::Never => false,
        Sharing::Always => true,
        Sharing::Auto => {
            let size = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
            (users - 1).saturating_mul(size) >= MIN_SHARED_BYTES
        }
    };
    let shared = users.into_iter().filter(|(file, n)| is_shared(file, *n)).map(|(file, _)| (file, None));
    SharedMeshes { files: shared.collect(), ..SharedMeshes::default() }
}

/// The file that a part can share: its only OBJ file, if the part does not move.
fn mesh_file(part: &PartRecipe) -> Option<MeshFile> {
    match &part.loader {
        Loader::Obj { files, up } if part.motions.is_empty() && files.len() == 1 => {
            Some((files[0].clone(), *up == UpAxis::Y))
        }
        _ => None,
    }
}

/// Makes the next part an instance if its file is shared; the first use loads the file with `load`. Returns `None` if
/// the part is to be stored; the instance has an index unless its mesh is empty.
pub(super) fn add_instance(
    scene: &mut SceneBuilder,
    part: &PartRecipe,
    load: impl FnOnce(&mut SceneBuilder, &PartRecipe, &[PathBuf]) -> Result<()>,
) -> Result<Option<Option<usize>>> {
    let Some(file) = mesh_file(part) else { return Ok(None) };
    let model = match scene.meshes.files.get(&file) {
        None => return Ok(None),
        Some(Some(model)) => *model,
        Some(None) => {
            let model = read_model(scene, part, &file.0, load)?;
            scene.meshes.files.insert(file, Some(model));
            model
        }
    };
    let meshes = &mut scene.meshes;
    if meshes.models[model as usize].geometry.triangles.is_empty() {
        return Ok(Some(None));
    }
    let Transform { rotation, scale, offset, .. } = part.transform;
    let placement = Placement { rotation, scale, offset, ..Placement::IDENTITY };
    meshes.placements.push((model, scene.geometry.triangles.len() as u32, placement));
    meshes.parts.push(scene.parts.len() as u32);
    Ok(Some(Some(meshes.placements.len() - 1)))
}

/// Loads a file as a stored part without transform and moves its triangles to a model.
fn read_model(
    scene: &mut SceneBuilder,
    part: &PartRecipe,
    file: &Path,
    load: impl FnOnce(&mut SceneBuilder, &PartRecipe, &[PathBuf]) -> Result<()>,
) -> Result<u32> {
    let start = scene.end();
    let untransformed = PartRecipe { transform: Transform::IDENTITY, ..part.clone() };
    load(scene, &untransformed, &[file.to_path_buf()])?;
    let first = start.vertices.start as u32;
    let mut triangles = scene.geometry.triangles.split_off(start.triangles.start);
    triangles.iter_mut().for_each(|t| *t = t.map(|v| v - first));
    let vertices = scene.geometry.vertices.split_off(start.vertices.start);
    let surfaces = scene.triangle_surfaces.split_off(start.triangles.start);
    let materials = surfaces.iter().map(|&s| scene.surfaces[s as usize].material).collect();
    let geometry = Geometry { vertices: vertices.into(), triangles: triangles.into(), ..Geometry::default() };
    scene.meshes.models.push(Arc::new(Model::new(geometry)));
    scene.meshes.materials.push(materials);
    Ok(scene.meshes.models.len() as u32 - 1)
}

/// Completes the instances, whose triangle indices continue after the `own` primitives of the scene; `None` if there
/// are none.
pub(super) fn freeze(meshes: SharedMeshes, own: usize) -> Result<Option<InstanceSet>> {
    if meshes.placements.is_empty() {
        return Ok(None);
    }
    let total = meshes.placements.iter().fold(own as u64, |sum, (model, ..)| {
        sum + meshes.models[*model as usize].geometry.triangles.len() as u64
    });
    let Some(instances) = Instances::new(meshes.models, meshes.placements, own) else {
        return Err(Error::input(format!(
            "the scene has {total} primitives with all its instances; at most {MAX_ELEMENTS} can be numbered"
        )));
    };
    Ok(Some(InstanceSet {
        instances: Arc::new(instances),
        materials: meshes.materials.into_iter().map(Store::from).collect(),
        parts: meshes.parts,
    }))
}

/// Whether an instance is certainly within [`MAX_COORDINATE`]; a conservative test.
pub(super) fn is_near(meshes: &SharedMeshes, instance: usize) -> bool {
    let (model, _, placement) = meshes.placements[instance];
    placement.magnitude(DVec3::ZERO, meshes.models[model as usize].reach()) <= MAX_COORDINATE
}

/// The exact bounding box of an instance, world frame, m.
pub(super) fn bounds(meshes: &SharedMeshes, instance: usize) -> Aabb {
    let (model, _, placement) = meshes.placements[instance];
    bounds_of_points(&meshes.models[model as usize].geometry.vertices, |v| placement.place(v, DVec3::ZERO))
}
