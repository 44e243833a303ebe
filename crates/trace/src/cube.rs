//! Cubes.

use bytemuck::{Pod, Zeroable};
use vlscan_geom::{Aabb, DVec3};

/// An axis-aligned cube.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Cube {
    /// Centre, m.
    pub centre: DVec3,
    /// Half edge length, m.
    pub half: f64,
}

impl Cube {
    /// The box between its faces.
    pub fn bounds(&self) -> Aabb {
        Aabb { min: self.centre - DVec3::splat(self.half), max: self.centre + DVec3::splat(self.half) }
    }
}
