//! Rays that leave one point together, and what they hit.

use super::Geometry;
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

/// Spatial index over a [`Geometry`].
#[derive(Clone, Debug, Default)]
pub struct Tree {}

impl Tree {
    /// First hits of all rays of a bundle; `hits` is resized and overwritten.
    pub fn trace(&self, geometry: &Geometry, rays: &RayBundle, hits: &mut Hits) {
        hits.t.clear();
        hits.t.resize(rays.len(), f64::INFINITY);
        hits.primitive.clear();
        hits.primitive.resize(rays.len(), Hits::MISS);
        for i in 0..rays.len() {
            for p in 0..geometry.triangles.len() {
                let [a, b, c] = geometry.triangle(p);
                let (e1, e2, d) = (b - a, c - a, rays.direction(i));
                let h = d.cross(e2);
                let det = h.dot(e1);
                let s = rays.origin - a;
                let q = s.cross(e1);
                let (u, w, t) = (s.dot(h) / det, d.dot(q) / det, e2.dot(q) / det);
                if u >= 0.0 && w >= 0.0 && u + w <= 1.0 && t > 0.0 && t < hits.t[i] {
                    hits.t[i] = t;
                    hits.primitive[i] = p as u32;
                }
            }
        }
    }
}
