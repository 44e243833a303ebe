//! Trees, geometry and instances as arrays of a file.

use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_base::store::{ArrayFile, ArrayFileWriter};
use vlscan_geom::{Aabb, DVec3};
use vlscan_trace::{
    CellLayout, Geometry, GridPlace, HeightField, HeightGrid, Heights, Instances, Model, NodeArray,
    Placement, Tree, TreeParts, VoxelCells, VoxelGrid,
};

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

/// Writes the height fields under names that begin with `name`; their pyramids are computed when they are
/// read.
pub(super) fn write_fields(fields: &[HeightField], name: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let grids: Vec<_> = fields.iter().map(|field| (field.grid(), field.first())).collect();
    out.value(format!("{name}fields"), &grids)?;
    for (i, field) in fields.iter().enumerate() {
        let name = format!("{name}heights {i}");
        match field.heights() {
            Heights::Short { base, values } => {
                out.value(format!("{name}.least"), base)?;
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
pub(super) fn read_fields(name: &str, file: &ArrayFile) -> Result<Vec<HeightField>> {
    let grids: Vec<(HeightGrid, u32)> = file.value(&format!("{name}fields"))?;
    let field = |(i, (grid, first)): (usize, (HeightGrid, u32))| {
        let name = format!("{name}heights {i}");
        let heights = match file.element(&name) {
            Some(2) => {
                Heights::Short { base: file.value(&format!("{name}.least"))?, values: file.array(&name)? }
            }
            Some(8) => Heights::Double(file.array(&name)?),
            _ => Heights::Single(file.array(&name)?),
        };
        HeightField::new(grid, heights, first as usize)
            .ok_or_else(|| file.refuse("its height fields are not those of its arrays"))
    };
    grids.into_iter().enumerate().map(field).collect()
}

/// Writes the grids of voxels under names that begin with `name`; the hierarchies over their cells are
/// computed when they are read.
pub(super) fn write_grids(grids: &[VoxelGrid], name: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let places: Vec<_> =
        grids.iter().map(|grid| (grid.place(), grid.first(), grid.cells().arrays().0)).collect();
    out.value(format!("{name}grids"), &places)?;
    for (i, grid) in grids.iter().enumerate() {
        let (_, starts, along) = grid.cells().arrays();
        out.array(format!("{name}grid {i}.rows"), starts)?;
        out.array(format!("{name}grid {i}.cells"), along)?;
    }
    Ok(())
}

/// Reads the grids of [`write_grids`].
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_grids(name: &str, file: &ArrayFile) -> Result<Vec<VoxelGrid>> {
    let places: Vec<(GridPlace, u32, CellLayout)> = file.value(&format!("{name}grids"))?;
    let grid = |(i, (place, first, values)): (usize, (GridPlace, u32, CellLayout))| {
        let starts = file.array(&format!("{name}grid {i}.rows"))?;
        let along = file.array(&format!("{name}grid {i}.cells"))?;
        VoxelCells::from_arrays(values, starts, along)
            .and_then(|cells| VoxelGrid::new(place, cells, first as usize))
            .ok_or_else(|| file.refuse("its grids of voxels are not those of its arrays"))
    };
    places.into_iter().enumerate().map(grid).collect()
}

/// Writes a tree without its instances under names that begin with `name`.
pub(super) fn write_tree(tree: &Tree, name: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let TreeParts { frame, bounds, statistics, nodes, blocks } = tree.parts();
    let is_wide = matches!(nodes, NodeArray::Wide(_));
    out.value(format!("{name}.values"), &(frame, bounds, statistics, is_wide))?;
    match nodes {
        NodeArray::Kd(nodes) => out.array(format!("{name}.nodes"), &nodes)?,
        NodeArray::Wide(nodes) => out.array(format!("{name}.nodes"), &nodes)?,
    }
    out.array(format!("{name}.blocks"), &blocks)
}

/// Reads a tree of [`write_tree`].
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_tree(name: &str, file: &ArrayFile) -> Result<Tree> {
    let (frame, bounds, statistics, is_wide) = file.value(&format!("{name}.values"))?;
    let nodes = format!("{name}.nodes");
    let nodes = match is_wide {
        true => NodeArray::Wide(file.array(&nodes)?.into()),
        false => NodeArray::Kd(file.array(&nodes)?.into()),
    };
    let blocks = file.array(&format!("{name}.blocks"))?.into();
    Ok(Tree::from_parts(TreeParts { frame, bounds, statistics, nodes, blocks }))
}

/// Writes the trees of a tree's instances under names that begin with `name`.
pub(super) fn write_instance_trees(tree: &Tree, name: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let Some((top, models)) = tree.instance_trees() else { return Ok(()) };
    write_tree(top, &format!("{name}top"), out)?;
    models.iter().enumerate().try_for_each(|(i, m)| write_tree(m, &format!("{name}model {i}"), out))
}

/// Adds the trees of [`write_instance_trees`] to `tree`.
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_instance_trees(
    tree: Tree,
    name: &str,
    instances: &Arc<Instances>,
    file: &ArrayFile,
) -> Result<Tree> {
    let top = read_tree(&format!("{name}top"), file)?;
    let models = (0..instances.models.len()).map(|i| read_tree(&format!("{name}model {i}"), file));
    let models = models.collect::<Result<_>>()?;
    Ok(tree.with_instance_trees(instances, top, models))
}

/// Writes models and placements under names that begin with `name`.
pub(super) fn write_instances(instances: &Instances, name: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let outlines: Vec<_> = instances.models.iter().map(|m| (m.reach(), m.outline())).collect();
    let places: Vec<_> = instances.all.iter().map(|i| (i.model, i.before, i.placement)).collect();
    out.value(format!("{name}instances"), &(instances.shift, instances.first(), outlines, places))?;
    let mut models = instances.models.iter().enumerate();
    models.try_for_each(|(i, m)| write_geometry(&m.geometry, &format!("{name}mesh {i}"), out))
}

/// Reads instances of [`write_instances`].
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_instances(name: &str, file: &ArrayFile) -> Result<Instances> {
    type Outlines = Vec<(f64, Vec<Aabb>)>;
    let value: (DVec3, u32, Outlines, Vec<(u32, u32, Placement)>) =
        file.value(&format!("{name}instances"))?;
    let (shift, first, outlines, places) = value;
    let mut models = Vec::with_capacity(outlines.len());
    for (i, (reach, outline)) in outlines.into_iter().enumerate() {
        let geometry = read_geometry(&format!("{name}mesh {i}"), file)?;
        models.push(Arc::new(Model::from_parts(geometry, reach, outline)));
    }
    let instances = Instances::new(models, places, first as usize);
    let mut instances = instances.ok_or_else(|| file.refuse("its instances cannot be numbered"))?;
    instances.shift = shift;
    Ok(instances)
}
