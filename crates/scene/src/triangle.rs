//! A triangle of a scene, located once for several queries.

use super::{Scene, Surface};
use vlscan_geom::DVec3;
use vlscan_trace::{PrimitiveRef, prefetch};

/// Location of a triangle of a scene.
#[derive(Clone, Copy, Debug)]
pub struct SceneTriangle<'a> {
    scene: &'a Scene,
    primitive: PrimitiveRef,
}

impl Scene {
    /// Finds triangle `i`; `None` for another primitive.
    #[inline]
    pub fn find_triangle(&self, i: u32) -> Option<SceneTriangle<'_>> {
        let primitive = self.primitive(i)?;
        let is_cube = matches!(primitive, PrimitiveRef::Cube(_) | PrimitiveRef::Grid { .. });
        (!is_cube).then_some(SceneTriangle { scene: self, primitive })
    }
}

impl SceneTriangle<'_> {
    /// The corners in the scene's frame; `None` for a missing triangle of a height field.
    #[inline]
    pub fn corners(&self) -> Option<[DVec3; 3]> {
        self.scene.corners_of(self.primitive)
    }

    /// Part and material.
    #[inline]
    pub fn surface(&self) -> Surface {
        let surface = self.scene.surface_of(self.primitive);
        surface.unwrap_or_else(|| panic!("{:?} has no surface", self.primitive))
    }

    /// Prefetches the numbers of its vertices, and the index of its surface.
    #[inline]
    pub fn prefetch(&self) {
        match (self.primitive, &self.scene.instances) {
            (PrimitiveRef::Triangle(index), _) => {
                prefetch(self.scene.geometry.triangles.as_ptr().wrapping_add(index));
                self.scene.surface_ids.prefetch(index);
            }
            (PrimitiveRef::Instance { instance, triangle }, Some(set)) => {
                let instances = &set.instances;
                let model = instances.all[instance].model as usize;
                prefetch(instances.models[model].geometry.triangles.as_ptr().wrapping_add(triangle));
                prefetch(set.materials[model].as_ptr().wrapping_add(triangle));
            }
            _ => {}
        }
    }

    /// Prefetches its vertices.
    #[inline]
    pub fn prefetch_corners(&self) {
        let (geometry, index) = match (self.primitive, &self.scene.instances) {
            (PrimitiveRef::Triangle(index), _) => (&self.scene.geometry, index),
            (PrimitiveRef::Instance { instance, triangle }, Some(set)) => {
                (&set.instances.model(&set.instances.all[instance]).geometry, triangle)
            }
            _ => return,
        };
        for vertex in geometry.triangles[index] {
            prefetch(geometry.vertices.as_ptr().wrapping_add(vertex as usize));
        }
    }
}
