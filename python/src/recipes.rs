//! The parts of scene files and the materials of files, as values.

use crate::errors::{Notices, exception};
use crate::scene::{Scene, fields_of};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use vlscan::scene::{obj_materials, read_materials};
use vlscan::survey::{
    Loader, MaterialChoice, MeshReading, PartRecipe, RasterFiles, UpAxis, VoxelLoader, VoxelMode, XyzLoader,
};
use vlscan::{Diagnostics, MaterialDefinition};

/// The materials of a file, as dictionaries: all of an MTL file, or those that an OBJ file uses.
#[pyfunction]
pub fn materials_of_file(py: Python<'_>, path: PathBuf, is_obj: bool) -> PyResult<Vec<Bound<'_, PyDict>>> {
    let read = py.detach(|| -> vlscan::Result<(Vec<MaterialDefinition>, Diagnostics)> {
        if is_obj { obj_materials(&path) } else { read_materials(&path) }
    });
    let (found, warnings) = read.map_err(|error| exception(py, error))?;
    let notices = Notices::default();
    notices.add(vlscan::Notice::Warnings(warnings));
    notices.issue(py)?;
    found.iter().map(|material| fields_of(py, material)).collect()
}

/// Constructor of a part of the package, its arguments, and the place of the part: id, quaternion (w, x, y,
/// z), scale, offset (m), mode of `onGround`. A part that exists only in its scene has the constructor
/// `of_scene` and the reason as argument.
type Described<'py> =
    (&'static str, Bound<'py, PyTuple>, (String, (f64, f64, f64, f64), f64, (f64, f64, f64), i64));

/// The parts that the description of a scene names: one for each file, one for all instances of a table, none
/// of packed scenes.
#[pyfunction]
pub fn parts_of_scene<'py>(py: Python<'py>, scene: &Bound<'py, Scene>) -> PyResult<Vec<Described<'py>>> {
    let mut found: Vec<Described<'py>> = Vec::new();
    let mut table = None;
    for recipe in &scene.get().recipe.parts {
        let own_table = table_of(recipe);
        if own_table.is_some() && own_table == table {
            continue;
        }
        table = own_table;
        let made = match only_in_scene(recipe) {
            Some(reason) => vec![("of_scene", (reason,).into_pyobject(py)?)],
            None => constructors(py, &recipe.loader)?,
        };
        let (rotation, offset) = (recipe.transform.rotation, recipe.transform.offset);
        let quaternion = (rotation.w, rotation.u.x, rotation.u.y, rotation.u.z);
        let offset = (offset.x, offset.y, offset.z);
        for (kind, arguments) in made {
            let id = recipe.id.clone().unwrap_or_else(|| recipe.number.to_string());
            let place = (id, quaternion, recipe.transform.scale, offset, recipe.transform.on_ground);
            found.push((kind, arguments, place));
        }
    }
    Ok(found)
}

/// The table of instances that a part is from: its place is not in a document.
fn table_of(recipe: &PartRecipe) -> Option<&Path> {
    let path = recipe.place.as_ref()?.path.as_path();
    let is_document = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("xml"));
    (!is_document).then_some(path)
}

/// Reason why a part cannot be made again by a constructor.
fn only_in_scene(recipe: &PartRecipe) -> Option<&'static str> {
    let has_variants = match &recipe.loader {
        Loader::GeoTiff { material, .. } => material.random_variants > 0,
        Loader::Xyz(xyz) => xyz.material.random_variants > 0,
        Loader::DetailedVoxels(voxels) => voxels.material.random_variants > 0,
        Loader::MeshFiles { .. } | Loader::Mesh(_) => false,
    };
    if !recipe.motions.is_empty() {
        Some("a part with <dmotion> belongs to its scene")
    } else if !recipe.swaps.is_empty() {
        Some("a part with <swap> belongs to its scene")
    } else if has_variants {
        Some("random materials belong to the loader of a scene file")
    } else if table_of(recipe).is_some() {
        Some("instances belong to their table")
    } else if matches!(recipe.loader, Loader::Mesh(_)) {
        Some("a mesh without a file belongs to its scene")
    } else {
        None
    }
}

/// Constructors of the class `Part` with their arguments but for the place, one for each file.
fn constructors<'py>(py: Python<'py>, loader: &Loader) -> PyResult<Vec<(&'static str, Bound<'py, PyTuple>)>> {
    match loader {
        Loader::MeshFiles { files, reading } => {
            let (up, unit, materials) = reading_of(reading);
            let of = |file: &PathBuf| {
                Ok(("of_mesh_file", (text(file), up, unit.clone(), materials.clone()).into_pyobject(py)?))
            };
            files.iter().map(of).collect()
        }
        Loader::GeoTiff { files, material } => {
            let paths: Vec<OsString> = match files {
                RasterFiles::Tiles(files) => files.iter().map(|file| text(file)).collect(),
                RasterFiles::Virtual(raster) => raster.files.iter().take(1).map(|file| text(file)).collect(),
            };
            Ok(vec![("of_raster", (paths, choice(py, material)?).into_pyobject(py)?)])
        }
        Loader::Xyz(xyz) => {
            let of = |file: &PathBuf| {
                let arguments = (text(file), cloud_settings(py, xyz)?, choice(py, &xyz.material)?);
                Ok(("of_points", arguments.into_pyobject(py)?))
            };
            xyz.files.iter().map(of).collect()
        }
        Loader::DetailedVoxels(voxels) => {
            let of = |file: &PathBuf| {
                let arguments = (text(file), voxel_settings(py, voxels)?, choice(py, &voxels.material)?);
                Ok(("of_voxels", arguments.into_pyobject(py)?))
            };
            voxels.files.iter().map(of).collect()
        }
        Loader::Mesh(_) => Ok(Vec::new()),
    }
}

fn text(path: &Path) -> OsString {
    path.as_os_str().to_owned()
}

/// Axis that points up, unit and table of materials of a mesh file.
fn reading_of(reading: &MeshReading) -> (Option<&'static str>, Option<String>, Option<OsString>) {
    let up = reading.up.map(|up| match up {
        UpAxis::Y => "y",
        UpAxis::Z => "z",
    });
    (up, reading.unit_m.map(|unit| unit.to_string()), reading.materials.as_deref().map(text))
}

fn choice<'py>(py: Python<'py>, material: &MaterialChoice) -> PyResult<Bound<'py, PyDict>> {
    let fields = PyDict::new(py);
    fields.set_item("file", material.file.as_deref().map(text))?;
    fields.set_item("name", material.name.as_deref())?;
    Ok(fields)
}

fn cloud_settings<'py>(py: Python<'py>, xyz: &XyzLoader) -> PyResult<Bound<'py, PyDict>> {
    // Tuples, as users give them: equal parts have equal settings.
    let columns = |columns: Option<[usize; 3]>| columns.map(|[a, b, c]| (a, b, c));
    let normal = xyz.default_normal.map(|normal| (normal.x, normal.y, normal.z));
    let fields = PyDict::new(py);
    fields.set_item("voxel_size", xyz.voxel_size)?;
    fields.set_item("separator", &xyz.separator)?;
    fields.set_item("normal_columns", columns(xyz.normal_columns))?;
    fields.set_item("rgb_columns", columns(xyz.rgb_columns))?;
    fields.set_item("max_color_value", xyz.max_color_value)?;
    fields.set_item("default_normal", normal)?;
    fields.set_item("estimate_normals", xyz.estimate_normals)?;
    fields.set_item("snap_neighbor_normal", xyz.snap_neighbor_normal)?;
    Ok(fields)
}

fn voxel_settings<'py>(py: Python<'py>, voxels: &VoxelLoader) -> PyResult<Bound<'py, PyDict>> {
    let (mode, exponent) = match voxels.mode {
        VoxelMode::Transmittive => ("transmittive", 0.5),
        VoxelMode::Fixed => ("fixed", 0.5),
        VoxelMode::Scaled(exponent) => ("scaled", exponent),
    };
    let fields = PyDict::new(py);
    fields.set_item("mode", mode)?;
    fields.set_item("exponent", exponent)?;
    fields.set_item("drop_empty", voxels.drop_empty)?;
    fields.set_item("random_shift", voxels.random_shift)?;
    fields.set_item("lad_table", voxels.lad_table.as_deref().map(text))?;
    Ok(fields)
}
