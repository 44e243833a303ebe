//! A triangle of a scene, found once for all that is asked of it.

use super::{InstanceSet, Scene, Surface};
use vlscan_geom::DVec3;
use vlscan_trace::{HeightField, TriangleAt, prefetch};

/// Location of a triangle of a scene.
#[derive(Clone, Copy, Debug)]
pub struct SceneTriangle<'a> {
    scene: &'a Scene,
    place: Place<'a>,
}

#[derive(Clone, Copy, Debug)]
enum Place<'a> {
    /// Index among the stored triangles.
    Stored(usize),
    /// Index of its height field, the field, and the triangle's number there.
    Field(usize, &'a HeightField, usize),
    /// Index of its instance, and of the triangle in the instance's model.
    Instance(&'a InstanceSet, usize, usize),
}

impl Scene {
    /// Finds triangle `i`; `None` for another primitive.
    #[inline]
    pub fn find_triangle(&self, i: u32) -> Option<SceneTriangle<'_>> {
        let (g, number) = (&self.geometry, i as usize);
        let place = if number < g.triangle_count() {
            match g.triangle_at(number) {
                TriangleAt::Stored(index) => Place::Stored(index),
                TriangleAt::Field(n, field, i) => Place::Field(n, field, i),
            }
        } else {
            let set = self.instances.as_ref()?;
            let (instance, triangle) = set.instances.locate(i)?;
            Place::Instance(set, instance, triangle)
        };
        Some(SceneTriangle { scene: self, place })
    }
}

impl SceneTriangle<'_> {
    /// The corners in the scene's frame; `None` for a missing triangle of a height field.
    #[inline]
    pub fn corners(&self) -> Option<[DVec3; 3]> {
        match self.place {
            Place::Stored(index) => Some(self.scene.geometry.stored_triangle(index)),
            Place::Field(_, field, i) => field.triangle(i),
            Place::Instance(set, instance, triangle) => {
                Some(set.instances.corners(&set.instances.all[instance], triangle))
            }
        }
    }

    /// Part and material.
    #[inline]
    pub fn surface(&self) -> Surface {
        let Scene { surfaces, surface_ids, field_surfaces, .. } = self.scene;
        match self.place {
            Place::Stored(index) => {
                let surface =
                    surface_ids.get(index).unwrap_or_else(|| panic!("triangle {index} has no surface"));
                surfaces[surface as usize]
            }
            Place::Field(field, ..) => surfaces[field_surfaces[field] as usize],
            Place::Instance(set, instance, triangle) => set.surface(instance, triangle),
        }
    }

    /// Prefetches the numbers of its vertices, and what tells its surface.
    #[inline]
    pub fn prefetch(&self) {
        match self.place {
            Place::Stored(index) => {
                prefetch(self.scene.geometry.triangles.as_ptr().wrapping_add(index));
                self.scene.surface_ids.prefetch(index);
            }
            Place::Field(..) => {}
            Place::Instance(set, instance, triangle) => {
                let instances = &set.instances;
                let model = instances.all[instance].model as usize;
                prefetch(instances.models[model].geometry.triangles.as_ptr().wrapping_add(triangle));
                prefetch(set.materials[model].as_ptr().wrapping_add(triangle));
            }
        }
    }

    /// Prefetches its vertices.
    #[inline]
    pub fn prefetch_corners(&self) {
        let (geometry, index) = match self.place {
            Place::Stored(index) => (&self.scene.geometry, index),
            Place::Field(..) => return,
            Place::Instance(set, instance, triangle) => {
                (&set.instances.model(&set.instances.all[instance]).geometry, triangle)
            }
        };
        for vertex in geometry.triangles[index] {
            prefetch(geometry.vertices.as_ptr().wrapping_add(vertex as usize));
        }
    }
}
