//! The verdicts of all rays of a bundle on one primitive: the arithmetic of [`triangle`], several rays at a time.

use super::beam::Beam;
use super::block::Block;
use super::intersect::{DEPTH_SLACK, EDGE_ON, triangle};
use super::trace::{depth_limit, verdict};
use super::{Geometry, Hits, RayBundle};
use crate::geom::DVec3;

/// Rays at a time.
const WIDTH: usize = 8;

/// The rays of a bundle and the hits found so far.
pub(super) struct Bundle<'a> {
    geometry: &'a Geometry,
    rays: &'a RayBundle,
    hits: &'a mut Hits,
    axes: [usize; 3],
    forward: f64,
    /// Largest depth in the tree's frame per unit of t.
    steepness: f64,
}

impl<'a> Bundle<'a> {
    pub fn new(
        geometry: &'a Geometry,
        rays: &'a RayBundle,
        hits: &'a mut Hits,
        beam: &Beam,
        scale: f64,
    ) -> Self {
        let along = [&rays.x, &rays.y, &rays.z][beam.axes[0]];
        let steepness = along.iter().fold(0.0, |m: f64, d| m.max(d.abs())) * scale;
        Bundle { geometry, rays, hits, axes: beam.axes, forward: f64::from(beam.forward), steepness }
    }

    /// Asks all rays about the block's lanes in `mask`; lowers `limit` once every ray has hit something.
    #[inline(always)]
    pub fn test(&mut self, block: &Block, mut mask: u32, limit: &mut f32) {
        while mask != 0 {
            let id = block.id[mask.trailing_zeros() as usize];
            if (id as usize) < self.geometry.triangles.len() {
                self.triangle(id);
            } else {
                (0..self.rays.len()).for_each(|ray| self.single(ray, id));
            }
            mask &= mask - 1;
        }
        let farthest = self.hits.t.iter().fold(0.0, |m: f64, &t| if t > m { t } else { m });
        *limit = depth_limit(farthest * self.steepness);
    }

    fn triangle(&mut self, id: u32) {
        let corners = self.geometry.triangle(id as usize);
        let seen = Seen::from(corners, self.rays.origin, self.axes, self.forward);
        for first in (0..self.rays.len()).step_by(WIDTH) {
            let (mut inside, t, sound) = seen.by(&self.chunk(first));
            inside &= !(!0u32 << (self.rays.len() - first).min(WIDTH));
            for lane in (0..WIDTH).filter(|l| inside >> l & 1 != 0) {
                if sound >> lane & 1 != 0 {
                    self.offer(first + lane, id, t[lane]);
                } else if let Some(t) = triangle(self.rays.origin, self.rays.direction(first + lane), corners)
                {
                    self.offer(first + lane, id, t);
                }
            }
        }
    }

    fn single(&mut self, ray: usize, id: u32) {
        if let Some(t) = verdict(self.geometry, self.rays.origin, self.rays.direction(ray), id) {
            self.offer(ray, id, t);
        }
    }

    #[inline(always)]
    fn offer(&mut self, ray: usize, id: u32, t: f64) {
        let (best, other) = (self.hits.t[ray], self.hits.primitive[ray]);
        if t > 0.0 && (t < best || (t == best && id < other)) {
            self.hits.t[ray] = t;
            self.hits.primitive[ray] = id;
        }
    }

    /// Directions from ray `first` on; places beyond the last ray hold no direction.
    #[inline(always)]
    fn chunk(&self, first: usize) -> [[f64; WIDTH]; 3] {
        [&self.rays.x, &self.rays.y, &self.rays.z].map(|d| {
            let rest = &d[first..];
            rest.first_chunk().copied().unwrap_or_else(|| {
                let mut padded = [f64::NAN; WIDTH];
                padded[..rest.len()].copy_from_slice(rest);
                padded
            })
        })
    }
}

/// A triangle as seen from one origin along one dominant axis.
struct Seen {
    axes: [usize; 3],
    corners: [[f64; 3]; 3],
    e1: [f64; 3],
    e2: [f64; 3],
    /// `e2·q` of the plane's distance.
    numerator: f64,
    /// Range of depths that a sound distance has.
    depths: [f64; 2],
    /// Smallest `det` of a triangle not seen edge-on, per unit of depth.
    least: f64,
}

impl Seen {
    #[inline(always)]
    fn from([a, b, c]: [DVec3; 3], origin: DVec3, axes: [usize; 3], forward: f64) -> Seen {
        let (e1, e2) = (b - a, c - a);
        let corners = [a - origin, b - origin, c - origin];
        let s = -corners[0];
        let q = [s.y * e1.z - s.z * e1.y, s.z * e1.x - s.x * e1.z, s.x * e1.y - s.y * e1.x];
        let depths = corners.map(|p| p[axes[0]] * forward);
        Seen {
            axes,
            corners: corners.map(|p| p.to_array()),
            numerator: e2.x * q[0] + e2.y * q[1] + e2.z * q[2],
            depths: [
                depths[0].min(depths[1]).min(depths[2]) * (1.0 - DEPTH_SLACK),
                depths[0].max(depths[1]).max(depths[2]) * (1.0 + DEPTH_SLACK),
            ],
            least: EDGE_ON * e1.abs().max_element() * e2.abs().max_element(),
            e1: e1.to_array(),
            e2: e2.to_array(),
        }
    }

    /// Which of the rays may be inside, their distances, and which of these need no second look.
    #[inline(always)]
    fn by(&self, d: &[[f64; WIDTH]; 3]) -> (u32, [f64; WIDTH], u32) {
        let [k, i, j] = self.axes;
        let ([a, b, c], e1, e2) = (&self.corners, &self.e1, &self.e2);
        let (mut inside, mut sound) = (0, 0);
        let mut t = [0.0; WIDTH];
        for l in 0..WIDTH {
            let across = |p: &[f64; 3]| (p[i] * d[k][l] - p[k] * d[i][l], p[j] * d[k][l] - p[k] * d[j][l]);
            let ((xa, ya), (xb, yb), (xc, yc)) = (across(a), across(b), across(c));
            let (u0, u1) = (xb * yc, yb * xc);
            let (v0, v1) = (xc * ya, yc * xa);
            let (w0, w1) = (xa * yb, ya * xb);
            let left = (u0 > u1) & (v0 > v1) & (w0 > w1);
            let right = (u0 < u1) & (v0 < v1) & (w0 < w1);
            let outside = ((u0 > u1) | (v0 > v1) | (w0 > w1)) & ((u0 < u1) | (v0 < v1) | (w0 < w1));
            let h0 = d[1][l] * e2[2] - d[2][l] * e2[1];
            let h1 = d[2][l] * e2[0] - d[0][l] * e2[2];
            let h2 = d[0][l] * e2[1] - d[1][l] * e2[0];
            let det = h0 * e1[0] + h1 * e1[1] + h2 * e1[2];
            t[l] = self.numerator / det;
            let depth = t[l] * d[k][l].abs();
            let faces = det.abs() >= self.least * d[k][l].abs();
            let within = (depth >= self.depths[0]) & (depth <= self.depths[1]);
            inside |= u32::from(!outside) << l;
            sound |= u32::from((left | right) & faces & within) << l;
        }
        (inside, t, sound)
    }
}
