//! Primitives as used by the builders: boxes.

use crate::Geometry;
use crate::frame::Frame;
use rayon::prelude::*;

/// A primitive's box in the tree's frame, rounded outward.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
pub(crate) struct Prim {
    pub lo: [f32; 3],
    pub id: u32,
    pub hi: [f32; 3],
}

/// Collects the stored primitives that `keep` accepts and a ray can hit, which excludes those with a NaN or
/// infinite coordinate, and for each grid of voxels its box, under the number of its first voxel.
pub(crate) fn collect(geometry: &Geometry, frame: &Frame, keep: impl Fn(u32) -> bool + Sync) -> Vec<Prim> {
    let is_kept = |i: &usize| is_solid(geometry, *i) && keep(*i as u32);
    let prim = |i: usize| {
        let (lo, hi) = frame.local_box(&geometry.outer_bounds_of(i));
        Prim { lo, id: i as u32, hi }
    };
    // A filtered sequence has no known length: it is collected in parts, which are then copied, so that all
    // primitives are in memory twice.
    match stored(geometry).all(|i| is_kept(&i)) {
        true => stored(geometry).map(prim).collect(),
        false => stored(geometry).filter(is_kept).map(prim).collect(),
    }
}

/// The numbers of all primitives that are part of neither a height field nor a grid of voxels, and of the
/// first voxel of each grid.
fn stored(geometry: &Geometry) -> impl IndexedParallelIterator<Item = usize> {
    let (triangles, cubes) = (geometry.triangles.len(), geometry.triangle_count());
    let count = triangles + geometry.cubes.len();
    (0..count + geometry.grids.len()).into_par_iter().with_min_len(4096).map(move |i| {
        match i.checked_sub(triangles) {
            None => geometry.number_of_triangle(i),
            Some(cube) if i < count => cubes + geometry.index_of_stored_cube(cube),
            Some(_) => cubes + geometry.grids[i - count].first() as usize,
        }
    })
}

fn is_solid(geometry: &Geometry, i: usize) -> bool {
    if i < geometry.triangle_count() {
        return geometry.triangle(i).iter().all(|p| p.is_finite());
    }
    let b = geometry.outer_bounds_of(i);
    b.min.is_finite() && b.max.is_finite() && !b.is_empty()
}

/// Returns the frame around all primitives that can be hit, also those of height fields and grids.
pub(crate) fn frame_of(geometry: &Geometry) -> Frame {
    let fields =
        geometry.fields.iter().fold(vlscan_geom::Aabb::EMPTY, |all, field| all.union(field.bounds()));
    let bounds = stored(geometry)
        .filter(|&i| is_solid(geometry, i))
        .map(|i| geometry.outer_bounds_of(i))
        .reduce(|| vlscan_geom::Aabb::EMPTY, |a, b| a.union(b));
    Frame::around(&bounds.union(fields))
}
