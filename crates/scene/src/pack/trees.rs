//! Trees, geometry and instances as arrays of a file.

use serde::{Deserialize, Serialize};
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_base::store::{ArrayFile, ArrayFileWriter};
use vlscan_geom::{Aabb, DVec3};
use vlscan_trace::{
    CellLayout, Frame, Geometry, GridPlace, HeightField, HeightGrid, Heights, Instances, Model, NodeArray,
    Placement, Statistics, Tree, TreeParts, VoxelCells, VoxelGrid,
};

/// A height field without its heights.
#[derive(Serialize, Deserialize)]
struct FieldValues {
    grid: HeightGrid,
    /// Number of the first triangle.
    first: u32,
}

/// A grid of voxels without its cells.
#[derive(Serialize, Deserialize)]
struct GridValues {
    place: GridPlace,
    /// Index of the first voxel among the cubes.
    first: u32,
    layout: CellLayout,
}

/// A tree without its nodes and blocks.
#[derive(Serialize, Deserialize)]
struct TreeValues {
    frame: Frame,
    bounds: [[f32; 3]; 2],
    statistics: Statistics,
    /// True for a hierarchy of boxes, false for a kd-tree.
    is_wide: bool,
}

/// Instances without the meshes of their models.
#[derive(Serialize, Deserialize)]
struct InstanceValues {
    shift: DVec3,
    /// Number of the first triangle of any instance.
    first: u32,
    models: Vec<ModelValues>,
    places: Vec<PlaceValues>,
}

/// A model without its mesh.
#[derive(Serialize, Deserialize)]
struct ModelValues {
    reach: f64,
    outline: Vec<Aabb>,
}

/// An instance.
#[derive(Serialize, Deserialize)]
struct PlaceValues {
    /// Index of the model.
    model: u32,
    /// Number of the scene's triangles before the model.
    before: u32,
    placement: Placement,
}

/// Names of the arrays of height field `i`, which begin with `prefix`: the heights, and their base.
fn names_of_field(prefix: &str, i: usize) -> (String, String) {
    (format!("{prefix}heights {i}"), format!("{prefix}heights {i}.least"))
}

/// Names of the arrays of grid `i`, which begin with `prefix`: the rows and the cells.
fn names_of_grid(prefix: &str, i: usize) -> (String, String) {
    (format!("{prefix}grid {i}.rows"), format!("{prefix}grid {i}.cells"))
}

/// Writes the arrays of a geometry under names that begin with `name`.
pub(super) fn write_geometry(geometry: &Geometry, name: &str, out: &mut ArrayFileWriter) -> Result<()> {
    out.array(format!("{name}.vertices"), &geometry.vertices)?;
    out.array(format!("{name}.triangles"), &geometry.triangles)?;
    out.array(format!("{name}.cubes"), &geometry.cubes)
}

/// Reads the arrays of [`write_geometry`].
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_geometry(name: &str, file: &ArrayFile) -> Result<Geometry> {
    Ok(Geometry {
        vertices: file.array(&format!("{name}.vertices"))?,
        triangles: file.array(&format!("{name}.triangles"))?,
        cubes: file.array(&format!("{name}.cubes"))?,
        ..Geometry::default()
    })
}

/// Writes the height fields under names that begin with `prefix`; their pyramids are computed when they are
/// read.
pub(super) fn write_fields(fields: &[HeightField], prefix: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let values = fields.iter().map(|field| FieldValues { grid: *field.grid(), first: field.first() });
    out.value(format!("{prefix}fields"), &values.collect::<Vec<_>>())?;
    for (i, field) in fields.iter().enumerate() {
        let (name, name_of_base) = names_of_field(prefix, i);
        match field.heights() {
            Heights::Short { base, values } => {
                out.value(name_of_base, base)?;
                out.array(name, values)?;
            }
            Heights::Single(values) => out.array(name, values)?,
            Heights::Double(values) => out.array(name, values)?,
        }
    }
    Ok(())
}

/// Reads the height fields of [`write_fields`].
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_fields(prefix: &str, file: &ArrayFile) -> Result<Vec<HeightField>> {
    let values: Vec<FieldValues> = file.value(&format!("{prefix}fields"))?;
    let field = |(i, FieldValues { grid, first }): (usize, FieldValues)| {
        let (name, name_of_base) = names_of_field(prefix, i);
        let heights = match file.element(&name) {
            Some(2) => Heights::Short { base: file.value(&name_of_base)?, values: file.array(&name)? },
            Some(4) => Heights::Single(file.array(&name)?),
            Some(8) => Heights::Double(file.array(&name)?),
            Some(bytes) => {
                let reason = format!("the array {name} has {bytes} bytes per height, expected 2, 4 or 8");
                return Err(file.refuse(&reason));
            }
            None => return Err(file.refuse(&format!("the array {name} is missing"))),
        };
        HeightField::new(grid, heights, first as usize)
            .ok_or_else(|| file.refuse("height field metadata does not match the stored arrays"))
    };
    values.into_iter().enumerate().map(field).collect()
}

/// Writes the grids of voxels under names that begin with `prefix`; the hierarchies over their cells are
/// computed when they are read.
pub(super) fn write_grids(grids: &[VoxelGrid], prefix: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let values = grids.iter().map(|grid| {
        let (layout, ..) = grid.cells().arrays();
        GridValues { place: *grid.place(), first: grid.first(), layout }
    });
    out.value(format!("{prefix}grids"), &values.collect::<Vec<_>>())?;
    for (i, grid) in grids.iter().enumerate() {
        let (_, starts, along) = grid.cells().arrays();
        let (rows, cells) = names_of_grid(prefix, i);
        out.array(rows, starts)?;
        out.array(cells, along)?;
    }
    Ok(())
}

/// Reads the grids of [`write_grids`].
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_grids(prefix: &str, file: &ArrayFile) -> Result<Vec<VoxelGrid>> {
    let values: Vec<GridValues> = file.value(&format!("{prefix}grids"))?;
    let grid = |(i, GridValues { place, first, layout }): (usize, GridValues)| {
        let (rows, cells) = names_of_grid(prefix, i);
        VoxelCells::from_arrays(layout, file.array(&rows)?, file.array(&cells)?)
            .and_then(|cells| VoxelGrid::new(place, cells, first as usize))
            .ok_or_else(|| file.refuse("voxel grid metadata does not match the stored arrays"))
    };
    values.into_iter().enumerate().map(grid).collect()
}

/// Writes a tree without its instances under names that begin with `name`.
pub(super) fn write_tree(tree: &Tree, name: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let TreeParts { frame, bounds, statistics, nodes, blocks } = tree.parts();
    let is_wide = matches!(nodes, NodeArray::Wide(_));
    out.value(format!("{name}.values"), &TreeValues { frame, bounds, statistics, is_wide })?;
    match nodes {
        NodeArray::Kd(nodes) => out.array(format!("{name}.nodes"), &nodes)?,
        NodeArray::Wide(nodes) => out.array(format!("{name}.nodes"), &nodes)?,
    }
    out.array(format!("{name}.blocks"), &blocks)
}

/// Reads a tree of [`write_tree`], which was built over `geometry`.
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_tree(name: &str, geometry: &Geometry, file: &ArrayFile) -> Result<Tree> {
    let TreeValues { frame, bounds, statistics, is_wide } = file.value(&format!("{name}.values"))?;
    let nodes = format!("{name}.nodes");
    let nodes = match is_wide {
        true => NodeArray::Wide(file.array(&nodes)?.into()),
        false => NodeArray::Kd(file.array(&nodes)?.into()),
    };
    let blocks = file.array(&format!("{name}.blocks"))?.into();
    Ok(Tree::from_parts(TreeParts { frame, bounds, statistics, nodes, blocks }, geometry))
}

/// Writes the trees of a tree's instances under names that begin with `prefix`.
pub(super) fn write_instance_trees(tree: &Tree, prefix: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let Some((top, models)) = tree.instance_trees() else { return Ok(()) };
    write_tree(top, &format!("{prefix}top"), out)?;
    models.iter().enumerate().try_for_each(|(i, m)| write_tree(m, &format!("{prefix}model {i}"), out))
}

/// Adds the trees of [`write_instance_trees`] to `tree`.
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_instance_trees(
    tree: Tree,
    prefix: &str,
    instances: &Arc<Instances>,
    file: &ArrayFile,
) -> Result<Tree> {
    let top = read_tree(&format!("{prefix}top"), &Geometry::default(), file)?;
    let models = instances.models.iter().enumerate();
    let models = models.map(|(i, model)| read_tree(&format!("{prefix}model {i}"), &model.geometry, file));
    let models = models.collect::<Result<_>>()?;
    Ok(tree.with_instance_trees(instances, top, models))
}

/// Writes models and placements under names that begin with `prefix`.
pub(super) fn write_instances(instances: &Instances, prefix: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let models = instances.models.iter();
    let places = instances.all.iter();
    let values = InstanceValues {
        shift: instances.shift,
        first: instances.first(),
        models: models.map(|m| ModelValues { reach: m.reach(), outline: m.outline().to_vec() }).collect(),
        places: places
            .map(|i| PlaceValues { model: i.model, before: i.before, placement: i.placement })
            .collect(),
    };
    out.value(format!("{prefix}instances"), &values)?;
    let mut models = instances.models.iter().enumerate();
    models.try_for_each(|(i, m)| write_geometry(&m.geometry, &format!("{prefix}mesh {i}"), out))
}

/// Reads instances of [`write_instances`].
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_instances(prefix: &str, file: &ArrayFile) -> Result<Instances> {
    let values: InstanceValues = file.value(&format!("{prefix}instances"))?;
    let mut models = Vec::with_capacity(values.models.len());
    for (i, ModelValues { reach, outline }) in values.models.into_iter().enumerate() {
        let geometry = read_geometry(&format!("{prefix}mesh {i}"), file)?;
        models.push(Arc::new(Model::from_parts(geometry, reach, outline)));
    }
    let places = values.places.into_iter().map(|place| (place.model, place.before, place.placement));
    let instances = Instances::new(models, places, values.first as usize);
    let mut instances = instances.ok_or_else(|| file.refuse("its instances cannot be numbered"))?;
    instances.shift = values.shift;
    Ok(instances)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_of_an_unknown_size_are_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vlscene");
        let fields = Vec::from([FieldValues { grid: HeightGrid::new(2, 2), first: 0 }]);
        let found = |heights: Option<&[u8]>| {
            let mut out = ArrayFileWriter::create(&path).unwrap();
            out.value("fields", &fields).unwrap();
            if let Some(heights) = heights {
                out.array("heights 0", heights).unwrap();
            }
            out.finish().unwrap();
            read_fields("", &ArrayFile::open(&path).unwrap()).unwrap_err().to_string()
        };
        let of_bytes = found(Some(b"four"));
        assert!(of_bytes.contains("heights 0 has 1 bytes per height, expected 2, 4 or 8"), "{of_bytes}");
        let missing = found(None);
        assert!(missing.contains("the array heights 0 is missing"), "{missing}");
    }
}
