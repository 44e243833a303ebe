//! The primitives of a loaded scene as columns.

use crate::errors::exception;
use crate::scene::Scene;
use crate::table::Column;
use crate::watch::interruptible;
use arrow_array::{ArrayRef, Float64Array, Int32Array, Int64Array, UInt32Array};
use pyo3::prelude::*;
use std::sync::Arc;
use vlscan::{DVec3, SceneGeometry};

/// Vertices and triangles (three numbers each), centres of voxels (three numbers each) and their edges,
/// number and part of each triangle and voxel, of a part or of all; none if the scene is not loaded.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "unpacked by the package")]
pub fn scene_geometry(
    py: Python<'_>,
    scene: Py<Scene>,
    part: Option<u32>,
) -> PyResult<Option<(Column, Column, Column, Column, Column, Column)>> {
    let Some(loaded) = scene.get().loaded() else { return Ok(None) };
    let made = interruptible(py, move |_| loaded.geometry(part).map(columns))?;
    let made = made.map_err(|error| exception(py, error))?;
    let [vertices, triangles, centres, edges, numbers, parts] = made.map(Column::new);
    Ok(Some((vertices, triangles, centres, edges, numbers, parts)))
}

fn columns(geometry: SceneGeometry) -> [ArrayRef; 6] {
    let SceneGeometry { vertices, triangles, voxels, numbers, parts } = geometry;
    let flat = |points: Vec<DVec3>| -> ArrayRef {
        Arc::new(Float64Array::from_iter_values(points.into_iter().flat_map(|point| point.to_array())))
    };
    [
        flat(vertices),
        Arc::new(UInt32Array::from_iter_values(triangles.into_iter().flatten())),
        flat(voxels.iter().map(|voxel| voxel.centre).collect()),
        Arc::new(Float64Array::from_iter_values(voxels.iter().map(|voxel| 2.0 * voxel.half))),
        Arc::new(Int64Array::from_iter_values(numbers.into_iter().map(i64::from))),
        Arc::new(Int32Array::from_iter_values(parts.into_iter().map(|part| part as i32))),
    ]
}
