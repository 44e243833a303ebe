//! Rays without an instrument: their numbers as bytes, their hits as columns.

use arrow_array::{ArrayRef, Float64Array, Int32Array, Int64Array};
use rayon::prelude::*;
use std::sync::Arc;
use vlscan::{DVec3, LoadedScene, Notice, RayCaster, RayHit};

/// A vector as bytes of three doubles.
type Bytes = [[u8; 8]; 3];

/// The vectors of three doubles each.
fn vectors_of(bytes: &[u8]) -> &[Bytes] {
    bytes.as_chunks::<8>().0.as_chunks::<3>().0
}

fn vector(bytes: &Bytes) -> DVec3 {
    DVec3::from(bytes.map(f64::from_le_bytes))
}

/// Vectors of three doubles each.
pub fn vectors(bytes: &[u8]) -> Vec<DVec3> {
    vectors_of(bytes).iter().map(vector).collect()
}

/// First hits of rays, whose origins and directions are bytes of three doubles each: distances, parts,
/// primitives and normals, the normals as three numbers each; NaN and -1 for rays without a hit. The columns
/// are read and written piece by piece on all threads: tracing is hardly slower than copying.
///
/// # Errors
/// As for [`LoadedScene::cast`].
pub fn cast(
    scene: &LoadedScene,
    (origins, directions): (&[u8], &[u8]),
    notify: &dyn Fn(Notice),
) -> vlscan::Result<[ArrayRef; 4]> {
    const PIECE: usize = RayCaster::PIECE;
    let caster = scene.caster(notify)?;
    let (origins, directions) = (vectors_of(origins), vectors_of(directions));
    let count = origins.len().min(directions.len());
    let (mut distances, mut parts) = (vec![0.0; count], vec![0; count]);
    let (mut primitives, mut normals) = (vec![0; count], vec![0.0; 3 * count]);
    let rays = origins.par_chunks(PIECE).zip(directions.par_chunks(PIECE));
    let surfaces = parts.par_chunks_mut(PIECE).zip(primitives.par_chunks_mut(PIECE));
    let shape = distances.par_chunks_mut(PIECE).zip(normals.par_chunks_mut(3 * PIECE));
    rays.zip(surfaces).zip(shape).for_each_init(
        || caster.clone(),
        |caster, (((origins, directions), (parts, primitives)), (distances, normals))| {
            let hits = caster.hits(origins.iter().map(vector).zip(directions.iter().map(vector)));
            let places = distances.iter_mut().zip(normals.as_chunks_mut::<3>().0);
            for ((hit, (distance, normal)), (part, primitive)) in
                hits.zip(places).zip(parts.iter_mut().zip(primitives))
            {
                (*distance, *normal, *part, *primitive) = values(hit);
            }
        },
    );
    Ok([
        Arc::new(Float64Array::from(distances)),
        Arc::new(Int32Array::from(parts)),
        Arc::new(Int64Array::from(primitives)),
        Arc::new(Float64Array::from(normals)),
    ])
}

/// Distance, normal, part and primitive of a hit.
fn values(hit: Option<RayHit>) -> (f64, [f64; 3], i32, i64) {
    match hit {
        Some(hit) => (hit.distance, hit.normal.to_array(), hit.part as i32, i64::from(hit.primitive)),
        None => (f64::NAN, [f64::NAN; 3], -1, -1),
    }
}
