//! Rays that leave one point together, and what they hit.

use crate::geom::DVec3;

/// The rays of one pulse: one origin, unit directions as structure of arrays.
#[derive(Clone, Debug, Default)]
pub struct RayBundle {
    /// Common origin, m, frame of the geometry.
    pub origin: DVec3,
    /// x of each direction.
    pub x: Vec<f64>,
    /// y of each direction.
    pub y: Vec<f64>,
    /// z of each direction.
    pub z: Vec<f64>,
}

impl RayBundle {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there is no ray.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Direction of ray `i`.
    pub fn direction(&self, i: usize) -> DVec3 {
        DVec3::new(self.x[i], self.y[i], self.z[i])
    }
}

/// First hits of a bundle, by ray. A miss has `t = ∞` and primitive [`Hits::MISS`].
#[derive(Clone, Debug, Default)]
pub struct Hits {
    /// Distance along each ray, m.
    pub t: Vec<f64>,
    /// Number of the primitive hit.
    pub primitive: Vec<u32>,
}

impl Hits {
    /// The primitive number of a miss.
    pub const MISS: u32 = u32::MAX;
}

impl Hits {
    /// Makes room for `rays` misses.
    pub(crate) fn reset(&mut self, rays: usize) {
        self.t.clear();
        self.t.resize(rays, f64::INFINITY);
        self.primitive.clear();
        self.primitive.resize(rays, Hits::MISS);
    }
}
