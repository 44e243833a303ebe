//! Primitives, and the hit of a ray.

use bytemuck::{Pod, Zeroable};
use vlscan_geom::{Aabb, DVec3};

/// Memory that a vector holds, bytes.
pub(crate) fn vec_bytes<T>(values: &Vec<T>) -> usize {
    values.capacity() * size_of::<T>()
}

/// An axis-aligned cube.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Cube {
    /// Centre, m.
    pub centre: DVec3,
    /// Half edge length, m.
    pub half: f64,
}

/// The primitives of a scene, numbered: triangles first, then cubes.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// Vertices in the frame of the rays, m.
    pub vertices: Vec<DVec3>,
    /// Vertex numbers of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Cubes; cube `i` is primitive number `triangles.len() + i`.
    pub cubes: Vec<Cube>,
}

impl Geometry {
    /// Number of primitives.
    pub fn len(&self) -> usize {
        self.triangles.len() + self.cubes.len()
    }

    /// Whether there are no primitives.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The corners of triangle `i`.
    #[inline]
    pub fn triangle(&self, i: usize) -> [DVec3; 3] {
        let [a, b, c] = self.triangles[i];
        [self.vertices[a as usize], self.vertices[b as usize], self.vertices[c as usize]]
    }

    /// The box around primitive `i`.
    pub fn bounds_of(&self, i: usize) -> Aabb {
        if i < self.triangles.len() {
            return Aabb::around(self.triangle(i));
        }
        let c = self.cubes[i - self.triangles.len()];
        Aabb { min: c.centre - DVec3::splat(c.half), max: c.centre + DVec3::splat(c.half) }
    }

    /// The box around all primitives.
    pub fn bounds(&self) -> Aabb {
        (0..self.len()).fold(Aabb::EMPTY, |b, i| b.union(self.bounds_of(i)))
    }
}

/// A ray's first hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the direction, which has unit length, m, > 0.
    pub t: f64,
    /// Number of the primitive; at equal distances the smaller number wins.
    pub primitive: u32,
}
