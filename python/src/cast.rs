//! Rays without an instrument: their numbers as bytes, their hits as columns.

use arrow_array::{ArrayRef, Float64Array, Int32Array, Int64Array};
use std::sync::Arc;
use vlscan::{DVec3, RayHit};

/// Vectors of three doubles each.
pub fn vectors(bytes: &[u8]) -> Vec<DVec3> {
    let vectors = bytes.as_chunks::<8>().0.as_chunks::<3>().0.iter();
    vectors.map(|v| DVec3::from(v.map(f64::from_le_bytes))).collect()
}

/// Distances, parts, primitives and normals of rays, the normals as three numbers each; NaN and -1 for rays
/// without a hit.
pub fn columns_of_hits(hits: &[Option<RayHit>]) -> [ArrayRef; 4] {
    let distance = hits.iter().map(|hit| hit.map_or(f64::NAN, |hit| hit.distance));
    let part = hits.iter().map(|hit| hit.map_or(-1, |hit| hit.part as i32));
    let primitive = hits.iter().map(|hit| hit.map_or(-1, |hit| i64::from(hit.primitive)));
    let normal = hits.iter().flat_map(|hit| hit.map_or([f64::NAN; 3], |hit| hit.normal.to_array()));
    [
        Arc::new(Float64Array::from_iter_values(distance)),
        Arc::new(Int32Array::from_iter_values(part)),
        Arc::new(Int64Array::from_iter_values(primitive)),
        Arc::new(Float64Array::from_iter_values(normal)),
    ]
}
