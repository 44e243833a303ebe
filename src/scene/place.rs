//! A part's transforms on its primitives (spec input-formats §3.3).

use super::assembly::{Assembly, Extent};
use crate::survey::{Loader, Transform};
use rayon::prelude::*;

/// Applies `transform` to a part without its grounding. Triangles and clouds take all of it; cubes stay upright, and those
/// of vegetation are scaled in place.
pub(super) fn transform(scene: &mut Assembly, loader: &Loader, transform: &Transform, extent: &Extent) {
    if (Transform { on_ground: 0, ..*transform }) == Transform::IDENTITY {
        return;
    }
    scene.geometry.vertices[extent.vertices.clone()].par_iter_mut().for_each(|v| *v = transform.apply(*v));
    let of_centres = match loader {
        Loader::DetailedVoxels(_) => Transform { scale: 1.0, ..*transform },
        Loader::Obj { .. } | Loader::GeoTiff { .. } | Loader::Xyz(_) => *transform,
    };
    scene.geometry.cubes[extent.cubes.clone()].par_iter_mut().for_each(|cube| {
        cube.centre = of_centres.apply(cube.centre);
        cube.half *= transform.scale.abs();
    });
    scene.voxels[extent.cubes.clone()].par_iter_mut().for_each(|v| v.rotate(&transform.rotation));
}
