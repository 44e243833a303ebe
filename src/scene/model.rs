//! The frozen scene that workers share.

use super::Material;
use crate::geom::{Aabb, DVec3};
use crate::tree::Geometry;

/// A loaded scene. Its frame is the world's minus [`Scene::shift`], the centre of the box around all primitives, so that
/// world coordinates of any size lose no digits. Immutable once built.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// World position of the local origin, m.
    pub shift: DVec3,
    /// Box around all primitives, local frame.
    pub bounds: Aabb,
    /// Primitives, local frame.
    pub geometry: Geometry,
    /// For each primitive its index in `surfaces`.
    pub surface_of: Vec<u32>,
    /// Distinct (part, material) pairs.
    pub surfaces: Vec<Surface>,
    /// Parts in document order.
    pub parts: Vec<Part>,
    /// Materials of all parts.
    pub materials: Vec<Material>,
}

/// What a primitive belongs to and is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Surface {
    /// Index in [`Scene::parts`].
    pub part: u32,
    /// Index in [`Scene::materials`].
    pub material: u32,
}

/// A part of the scene: what an echo's object id names.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Reported id, normally a number as text.
    pub id: String,
}

impl Scene {
    /// The material of primitive `i`.
    pub fn material_of(&self, i: u32) -> &Material {
        &self.materials[self.surfaces[self.surface_of[i as usize] as usize].material as usize]
    }
}
