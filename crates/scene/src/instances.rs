//! Instances of shared meshes: if many or large parts name the same file, its mesh is stored once, as a
//! model, and each of these parts is an instance of it.

use super::builder::{MAX_ELEMENTS, MeshFile, SceneBuilder, SharedMeshes, Sharing, bounds_of_points};
use super::instance_set::InstanceSet;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_base::diag::ProblemKind;
use vlscan_base::error::{Error, Result};
use vlscan_geom::{Aabb, DVec3};
use vlscan_survey::{Loader, PartRecipe, Transform};
use vlscan_trace::{Geometry, Instances, Model, Placement};

/// Minimum number of bytes of OBJ text whose repeated storage is avoided for [`Sharing::Auto`] to share a
/// file.
const MIN_SHARED_BYTES: u64 = 64 << 20;
/// Typical number of bytes of OBJ text per triangle.
const TRIANGLE_BYTES: u64 = 64;

/// Selects the files whose meshes are shared in an epoch.
pub(super) fn plan_sharing<'p>(
    parts: impl Iterator<Item = &'p PartRecipe>,
    sharing: Sharing,
) -> SharedMeshes {
    let mut users: HashMap<MeshFile, (u64, u64)> = HashMap::new();
    for part in parts {
        if let Some(mesh) = shared_mesh(part) {
            users.entry(mesh).or_insert_with(|| (size_of_mesh(&part.loader), 0)).1 += 1;
        }
    }
    let is_shared = |size: u64, users: u64| match sharing {
        Sharing::Never => false,
        Sharing::Always => true,
        Sharing::Auto => (users - 1).saturating_mul(size) >= MIN_SHARED_BYTES,
    };
    let shared =
        users.into_iter().filter(|(_, (size, n))| is_shared(*size, *n)).map(|(mesh, _)| (mesh, None));
    SharedMeshes { files: shared.collect(), ..SharedMeshes::default() }
}

/// The mesh that a part can share: its only mesh file, or its mesh in memory, if the part does not move.
fn shared_mesh(part: &PartRecipe) -> Option<MeshFile> {
    let changes = part.changes.identity();
    match &part.loader {
        _ if !part.motions.is_empty() => None,
        Loader::MeshFiles { files, reading: r } if files.len() == 1 => Some(MeshFile::File(
            files[0].clone(),
            r.up,
            r.unit_m.map(f64::to_bits),
            r.materials.clone(),
            changes,
        )),
        Loader::Mesh(mesh) => Some(MeshFile::Memory(mesh.identity(), changes)),
        _ => None,
    }
}

/// Size of a mesh as OBJ text, bytes.
fn size_of_mesh(loader: &Loader) -> u64 {
    match loader {
        Loader::MeshFiles { files, .. } => {
            files.first().and_then(|path| std::fs::metadata(path).ok()).map_or(0, |about| about.len())
        }
        Loader::Mesh(mesh) => mesh.triangles().len() as u64 * TRIANGLE_BYTES,
        _ => 0,
    }
}

/// Makes the next part an instance if its file is shared; the first use loads the file with `load`. Returns
/// `None` if the part is to be stored; the instance has an index unless its mesh is empty.
pub(super) fn add_instance(
    scene: &mut SceneBuilder,
    part: &PartRecipe,
    load: impl FnOnce(&mut SceneBuilder, &PartRecipe, &[PathBuf]) -> Result<()>,
) -> Result<Option<Option<usize>>> {
    let Some(file) = shared_mesh(part) else { return Ok(None) };
    let model = match scene.meshes.files.get(&file) {
        None => return Ok(None),
        Some(Some(model)) => *model,
        Some(None) => {
            let model = read_model(scene, part, &file, load)?;
            scene.meshes.files.insert(file, Some(model));
            model
        }
    };
    let meshes = &mut scene.meshes;
    if meshes.models[model as usize].geometry.triangles.is_empty() {
        return Ok(Some(None));
    }
    let Transform { rotation, widening, scale, offset, .. } = part.transform;
    let placement = Placement { rotation, widening, scale, offset, ..Placement::IDENTITY };
    meshes.placements.push((model, scene.geometry.triangle_count() as u32, placement));
    meshes.parts.push(scene.parts.len() as u32);
    Ok(Some(Some(meshes.placements.len() - 1)))
}

/// Loads a file as a stored part without transform and moves its triangles to a model.
fn read_model(
    scene: &mut SceneBuilder,
    part: &PartRecipe,
    file: &MeshFile,
    load: impl FnOnce(&mut SceneBuilder, &PartRecipe, &[PathBuf]) -> Result<()>,
) -> Result<u32> {
    let start = scene.end();
    let untransformed = PartRecipe { transform: Transform::IDENTITY, ..part.clone() };
    let files: &[PathBuf] = match file {
        MeshFile::File(path, ..) => std::slice::from_ref(path),
        MeshFile::Memory(..) => &[],
    };
    load(scene, &untransformed, files)?;
    let first = start.vertices.start as u32;
    let mut triangles = scene.geometry.triangles.split_off(start.triangles.start);
    triangles.iter_mut().for_each(|t| *t = t.map(|v| v - first));
    let vertices = scene.geometry.vertices.split_off(start.vertices.start);
    let surfaces = scene.triangle_surfaces.split_off(start.triangles.start);
    let materials = surfaces.iter().map(|&s| scene.surfaces[s as usize].material).collect();
    let geometry = Geometry { vertices, triangles, ..Geometry::default() };
    scene.meshes.models.push(Arc::new(Model::new(geometry)));
    scene.meshes.materials.push(materials);
    if scene.options.colours {
        scene.colours.add_model(start.triangles.start);
    }
    Ok(scene.meshes.models.len() as u32 - 1)
}

/// Completes the instances, whose triangle indices continue after the `own` primitives of the scene; `None`
/// if there are none.
pub(super) fn freeze(meshes: SharedMeshes, own: usize) -> Result<Option<InstanceSet>> {
    if meshes.placements.is_empty() {
        return Ok(None);
    }
    let total = meshes.placements.iter().fold(own as u64, |sum, (model, ..)| {
        sum + meshes.models[*model as usize].geometry.triangles.len() as u64
    });
    let Some(instances) = Instances::new(meshes.models, meshes.placements, own) else {
        let message = format!(
            "the scene has {total} primitives with all its instances; at most {MAX_ELEMENTS} can be numbered"
        );
        return Err(Error::input_of(ProblemKind::TooLarge, message));
    };
    Ok(Some(InstanceSet { instances: Arc::new(instances), materials: meshes.materials, parts: meshes.parts }))
}

/// A box around an instance, world frame, m, larger than the exact one by up to an eighth of its size: with
/// thousands of instances not every vertex is visited.
pub(super) fn outer_bounds(meshes: &SharedMeshes, instance: usize) -> Aabb {
    let (model, _, placement) = meshes.placements[instance];
    meshes.models[model as usize].box_at(&placement, DVec3::ZERO)
}

/// The exact bounding box of an instance, world frame, m.
pub(super) fn bounds(meshes: &SharedMeshes, instance: usize) -> Aabb {
    let (model, _, placement) = meshes.placements[instance];
    bounds_of_points(&meshes.models[model as usize].geometry.vertices, |v| placement.place(v, DVec3::ZERO))
}
