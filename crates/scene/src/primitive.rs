//! References to the primitives of a scene.

use super::{Scene, Surface, Voxel};
use vlscan_geom::DVec3;
use vlscan_trace::{Cube, PrimitiveRef};

impl Scene {
    /// Storage of primitive `i`; `None` for a primitive of a tile and for a number that is out of range.
    #[inline]
    pub fn primitive(&self, i: u32) -> Option<PrimitiveRef> {
        let own = self.geometry.primitive(i as usize);
        own.or_else(|| self.instances.as_ref()?.instances.primitive(i))
    }

    /// Number of a primitive; `None` for a triangle of an instance in a scene without instances.
    pub fn number_of(&self, primitive: PrimitiveRef) -> Option<u32> {
        let own = self.geometry.number_of(primitive);
        let number = own.or_else(|| self.instances.as_ref()?.instances.number_of(primitive))?;
        u32::try_from(number).ok()
    }

    /// Part and material of a primitive; `None` for a reference to none.
    #[inline]
    pub fn surface_of(&self, primitive: PrimitiveRef) -> Option<Surface> {
        let surface = match primitive {
            PrimitiveRef::Triangle(index) => self.surface_ids.get(index)?,
            PrimitiveRef::Field { field, .. } => *self.field_surfaces.get(field)?,
            PrimitiveRef::Cube(index) => self.surface_ids.get(self.geometry.triangles.len() + index)?,
            PrimitiveRef::Grid { grid, voxel } => self.grid_voxels.get(grid)?.surfaces.get(voxel)?,
            PrimitiveRef::Instance { instance, triangle } => {
                return Some(self.instances.as_ref()?.surface(instance, triangle));
            }
        };
        Some(self.surfaces[surface as usize])
    }

    /// The corners of a triangle in the scene's frame, m; `None` for a missing triangle of a height field and
    /// for a cube.
    #[inline]
    pub fn corners_of(&self, primitive: PrimitiveRef) -> Option<[DVec3; 3]> {
        match primitive {
            PrimitiveRef::Triangle(index) => Some(self.geometry.stored_triangle(index)),
            PrimitiveRef::Field { field, triangle } => self.geometry.fields[field].triangle(triangle),
            PrimitiveRef::Instance { instance, triangle } => {
                let set = &self.instances.as_ref()?.instances;
                Some(set.corners(&set.all[instance], triangle))
            }
            PrimitiveRef::Cube(_) | PrimitiveRef::Grid { .. } => None,
        }
    }

    /// The attributes of a cube, and the cube; `None` for a triangle.
    #[inline]
    pub fn voxel_of(&self, primitive: PrimitiveRef) -> Option<(Voxel, Cube)> {
        match primitive {
            PrimitiveRef::Cube(index) => Some((*self.voxels.get(index)?, *self.geometry.cubes.get(index)?)),
            PrimitiveRef::Grid { grid, voxel } => {
                Some((self.grid_voxels[grid].get(voxel), self.geometry.grids[grid].cube(voxel)))
            }
            _ => None,
        }
    }
}
