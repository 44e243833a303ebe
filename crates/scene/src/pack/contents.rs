//! Scenes as arrays and values of a file.

use super::colours::{is_of_colours, read_colours, write_colours};
use super::tiles::{is_of_tile, write_tiles};
use super::trees::{
    read_fields, read_geometry, read_grids, read_instance_trees, read_instances, read_tree, write_fields,
    write_geometry, write_grids, write_instance_trees, write_instances, write_tree,
};
use crate::grid_voxels::{GridSurfaces, GridVoxels};
use crate::{InstanceSet, Material, MovingPart, Optics, PackedTree, Part, Scene, Sizes, Surface, SurfaceIds};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_base::store::{ArrayFile, ArrayFileWriter};
use vlscan_geom::{Aabb, DVec3};
use vlscan_trace::{Builder, Geometry, HeightField, Tree, VoxelGrid};

/// The name of the number of epochs.
const EPOCHS: &str = "epochs";
/// The name of the mirrors and panes that materials are; missing in scenes without any.
const OPTICS: &str = "optics";

/// A scene without its arrays. Values are stored in the order of the fields: increment the version of the
/// file after a change of them.
#[derive(Serialize, Deserialize)]
struct SceneValues<'a> {
    shift: DVec3,
    bounds: Aabb,
    surfaces: Cow<'a, [Surface]>,
    parts: Cow<'a, [Part]>,
    materials: Cow<'a, [Material]>,
    dyn_step: u32,
    dyn_time_step: Option<f64>,
    crs: Option<Cow<'a, str>>,
    moving_parts: Cow<'a, [MovingPart]>,
    sizes: Sizes,
    /// The part of each instance; `None` in a scene without instances.
    instance_parts: Option<Cow<'a, [u32]>>,
    field_surfaces: Cow<'a, [u32]>,
}

impl SceneValues<'_> {
    fn of(scene: &Scene) -> SceneValues<'_> {
        SceneValues {
            shift: scene.shift,
            bounds: scene.bounds,
            surfaces: Cow::Borrowed(&scene.surfaces),
            parts: Cow::Borrowed(&scene.parts),
            materials: Cow::Borrowed(&scene.materials),
            dyn_step: scene.dyn_step,
            dyn_time_step: scene.dyn_time_step,
            crs: scene.crs.as_deref().map(Cow::Borrowed),
            moving_parts: Cow::Borrowed(&scene.moving_parts),
            sizes: scene.sizes(),
            instance_parts: scene.instances.as_ref().map(|set| Cow::Borrowed(&set.parts[..])),
            field_surfaces: Cow::Borrowed(&scene.field_surfaces),
        }
    }
}

pub(super) fn write_epochs(epochs: u32, out: &mut ArrayFileWriter) -> Result<()> {
    out.value(EPOCHS, &epochs)
}

/// The number of epochs.
///
/// # Errors
/// As for [`ArrayFile::value`].
pub(super) fn read_epochs(file: &ArrayFile) -> Result<u32> {
    file.value(EPOCHS)
}

/// Prefix of the names of all arrays of an epoch.
pub(super) fn prefix(epoch: u32) -> String {
    format!("epoch {epoch} ")
}

/// True if an array is needed for an epoch, by its name, colours only if they are requested. Tiles are read
/// when they are needed.
pub(super) fn is_of_epoch(name: &str, epoch: u32, colours: bool) -> bool {
    match name.strip_prefix(&prefix(epoch)) {
        Some(what) => !is_of_tile(what) && (colours || !is_of_colours(what)),
        None => !name.starts_with("epoch "),
    }
}

/// Appends the scene of an epoch, its tree and its tiles.
pub(super) fn write(scene: &Scene, tree: &Tree, epoch: u32, out: &mut ArrayFileWriter) -> Result<()> {
    write_scene(scene, tree, &prefix(epoch), out)?;
    write_tiles(scene, &prefix(epoch), out)
}

/// Appends a scene without its tiles, and its tree, under names that begin with `prefix`.
pub(super) fn write_scene(scene: &Scene, tree: &Tree, prefix: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let name = |what: &str| format!("{prefix}{what}");
    out.value(name("values"), &SceneValues::of(scene))?;
    if scene.materials.iter().any(|material| material.optics.is_some()) {
        let optics: Vec<Option<Optics>> = scene.materials.iter().map(|material| material.optics).collect();
        out.value(name(OPTICS), &optics)?;
    }
    write_geometry(&scene.geometry, &name("own"), out)?;
    write_fields(&scene.geometry.fields, prefix, out)?;
    write_grids(&scene.geometry.grids, prefix, out)?;
    for (i, voxels) in scene.grid_voxels.iter().enumerate() {
        voxels.pack(&name(&format!("grid {i}")), out)?;
    }
    out.array(name("voxels"), &scene.voxels)?;
    scene.surface_ids.pack(name("surfaces"), out)?;
    if let Some(colours) = &scene.colours {
        write_colours(colours, prefix, out)?;
    }
    write_tree(tree, &name("tree"), out)?;
    if let Some(set) = &scene.instances {
        write_instances(&set.instances, prefix, out)?;
        for (i, materials) in set.materials.iter().enumerate() {
            out.array(name(&format!("materials {i}")), materials)?;
        }
        write_instance_trees(tree, prefix, out)?;
    }
    Ok(())
}

/// Reads a scene without its tiles, from the arrays whose names begin with `prefix`, with `colours` if they
/// are requested.
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_scene(file: &ArrayFile, prefix: &str, builder: Builder, colours: bool) -> Result<Scene> {
    let name = |what: &str| format!("{prefix}{what}");
    let values: SceneValues<'static> = file.value(&name("values"))?;
    let mut scene = Scene {
        shift: values.shift,
        bounds: values.bounds,
        surfaces: values.surfaces.into_owned(),
        parts: values.parts.into_owned(),
        materials: values.materials.into_owned(),
        dyn_step: values.dyn_step,
        dyn_time_step: values.dyn_time_step,
        crs: values.crs.map(Cow::into_owned),
        moving_parts: values.moving_parts.into_owned(),
        packed_sizes: Some(values.sizes),
        geometry: Geometry {
            fields: read_fields(prefix, file)?,
            grids: read_grids(prefix, file)?,
            ..read_geometry(&name("own"), file)?
        },
        field_surfaces: values.field_surfaces.into_owned(),
        voxels: file.array(&name("voxels"))?,
        surface_ids: SurfaceIds::unpack(&name("surfaces"), file)?,
        colours: colours.then(|| read_colours(file, prefix).map(Arc::new)).transpose()?,
        ..Scene::default()
    };
    if file.element(&name(OPTICS)).is_some() {
        let optics: Vec<Option<Optics>> = file.value(&name(OPTICS))?;
        if optics.len() != scene.materials.len() {
            return Err(file.refuse("the lengths of its arrays do not match"));
        }
        scene.materials.iter_mut().zip(optics).for_each(|(material, optics)| material.optics = optics);
    }
    let (g, cubes) = (&scene.geometry, scene.geometry.cubes.len());
    let stored = g.triangles.len() + cubes;
    let are_fields = scene.field_surfaces.len() == g.fields.len() && are_numbered(g);
    let grids = (0..g.grids.len()).map(|i| GridVoxels::unpack(&name(&format!("grid {i}")), file));
    let grid_voxels = grids.collect::<Result<Vec<_>>>()?;
    let are_grids = grid_voxels.iter().map(GridVoxels::len).eq(g.grids.iter().map(VoxelGrid::len));
    if scene.surface_ids.len() != stored || scene.voxels.len() != cubes || !are_fields || !are_grids {
        return Err(file.refuse("the lengths of its arrays do not match"));
    }
    scene.grid_voxels = grid_voxels;
    let mut tree = read_tree(&name("tree"), &scene.geometry, file)?;
    if let Some(parts) = values.instance_parts {
        let parts = parts.into_owned();
        let instances = Arc::new(read_instances(prefix, file)?);
        let materials = (0..instances.models.len()).map(|i| file.array(&name(&format!("materials {i}"))));
        let materials = materials.collect::<Result<Vec<_>>>()?;
        if parts.len() != instances.all.len() {
            return Err(file.refuse("instance metadata does not match the stored arrays"));
        }
        tree = read_instance_trees(tree, prefix, &instances, file)?;
        scene.instances = Some(InstanceSet { instances, materials, parts });
    }
    if !are_numbers_valid(&scene) {
        return Err(file.refuse("its parts refer to something that does not exist"));
    }
    scene.packed_tree = Some(PackedTree { builder, tree: Arc::new(tree) });
    Ok(scene)
}

/// True if the numbers of height fields are those of no other triangles, and the indices of grids those of no
/// other cubes.
fn are_numbered(g: &Geometry) -> bool {
    let are_apart = |mut ranges: Vec<Range<usize>>, end: usize| {
        ranges.push(end..end);
        ranges.windows(2).all(|w| w[0].end <= w[1].start)
    };
    are_apart(g.fields.iter().map(HeightField::numbers).collect(), g.triangle_count())
        && are_apart(g.grids.iter().map(VoxelGrid::indices).collect(), g.cube_count())
}

/// True if all indices outside the large arrays are in range.
fn are_numbers_valid(scene: &Scene) -> bool {
    let (parts, materials, g) = (scene.parts.len(), scene.materials.len(), &scene.geometry);
    let is_within = |range: &Range<usize>, len: usize| range.start <= range.end && range.end <= len;
    let is_surface = |s: &Surface| (s.part as usize) < parts && (s.material as usize) < materials;
    let is_moving = |m: &MovingPart| {
        (m.part as usize) < parts
            && is_within(&m.vertices, g.vertices.len())
            && is_within(&m.triangles, g.triangles.len())
            && is_within(&m.cubes, g.cubes.len())
            && m.motions.iter().all(|s| s.next.is_none_or(|next| next < m.motions.len()))
    };
    let are_instances = |set: &InstanceSet| {
        let models = &set.instances.models;
        set.parts.iter().all(|&part| (part as usize) < parts)
            && set.instances.all.iter().all(|i| (i.model as usize) < models.len())
            && set.materials.iter().zip(models).all(|(of, m)| of.len() == m.geometry.triangles.len())
    };
    let are_in_turn = |voxels: &GridVoxels| match &voxels.surfaces {
        GridSurfaces::InTurn(all) => all.iter().all(|&s| (s as usize) < scene.surfaces.len()),
        GridSurfaces::Each(_) => true,
    };
    scene.surfaces.iter().all(is_surface)
        && scene.grid_voxels.iter().all(are_in_turn)
        && scene.field_surfaces.iter().all(|&s| (s as usize) < scene.surfaces.len())
        && scene.moving_parts.iter().all(is_moving)
        && scene.instances.as_ref().is_none_or(are_instances)
}

/// True if the indices in the large arrays are in range. Reads all of them.
pub(super) fn are_arrays_valid(scene: &Scene) -> bool {
    let materials = scene.materials.len();
    let geometries = scene.instances.iter().flat_map(|set| &set.instances.models).map(|m| &m.geometry);
    let of_instances = scene.instances.iter().flat_map(|set| &set.materials).flatten();
    let of_grids = scene.grid_voxels.iter().map(|voxels| voxels.surfaces.counts(voxels.len()));
    std::iter::once(&scene.geometry).chain(geometries).all(Geometry::is_sound)
        && scene.surface_ids.iter().all(|id| (id as usize) < scene.surfaces.len())
        && of_grids.flatten().all(|(id, _)| (id as usize) < scene.surfaces.len())
        && of_instances.copied().all(|m| (m as usize) < materials)
        && scene.packed_tree.as_ref().is_none_or(|packed| packed.tree.is_sound(&scene.geometry))
}
