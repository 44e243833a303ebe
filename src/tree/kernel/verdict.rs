//! The verdicts of all rays of a pulse on one primitive, eight rays at a time: the arithmetic of
//! [`intersect`](crate::tree::intersect), operation by operation, so that the bits are the same. Rays for which that
//! arithmetic takes one of its rare turns are referred to it.

use crate::geom::DVec3;
use crate::tree::geometry::Cube;
use crate::tree::intersect::{self, DEPTH_SLACK, EDGE_ON};
use crate::tree::simd::{Simd, each_of};

/// Eight rays: directions and the nearest hits so far.
pub(super) struct Rays<'a> {
    pub x: &'a [f64; 8],
    pub y: &'a [f64; 8],
    pub z: &'a [f64; 8],
    pub t: &'a mut [f64; 8],
    pub id: &'a mut [u32; 8],
}

impl Rays<'_> {
    #[inline(always)]
    fn along(&self, axis: usize) -> &[f64; 8] {
        [self.x, self.y, self.z][axis]
    }

    fn direction(&self, ray: usize) -> DVec3 {
        DVec3::new(self.x[ray], self.y[ray], self.z[ray])
    }

    fn offer(&mut self, ray: usize, t: f64, id: u32) {
        if t < self.t[ray] || (t == self.t[ray] && id < self.id[ray]) {
            (self.t[ray], self.id[ray]) = (t, id);
        }
    }

    /// Takes over the distances of the lanes in `hit` that are the nearest so far.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn offer_all<S: Simd>(&mut self, hit: S::N, t: S::D, id: u32) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let best = S::dload(self.t);
            let (nearer, equal) = (S::dbits(S::dlt(t, best)), S::dbits(S::dle(t, best)));
            // Equal distances are rare, and so is a look at the numbers.
            let ties = (equal & !nearer) & S::greater_ids(self.id, id);
            S::put((nearer | ties) & S::dbits(hit), self.t, t, self.id, id);
        }
    }
}

/// A triangle seen from one pulse's origin.
pub(super) struct Triangle {
    id: u32,
    origin: DVec3,
    corners: [DVec3; 3],
    /// Relative to the origin.
    from: [[f64; 3]; 3],
}

impl Triangle {
    #[inline(always)]
    pub fn new(id: u32, corners: [DVec3; 3], origin: DVec3) -> Triangle {
        let from = each_of!([0, 1, 2], v => (corners[v] - origin).to_array());
        Triangle { id, origin, corners, from }
    }

    /// Which rays are surely inside, and which may be; axes by dominance.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn inside<S: Simd>(&self, [k, i, j]: [usize; 3], rays: &Rays) -> (S::N, u32) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let (dk, di, dj) = (S::dload(rays.along(k)), S::dload(rays.along(i)), S::dload(rays.along(j)));
            let [(xa, ya), (xb, yb), (xc, yc)] = each_of!([0, 1, 2], v => {
                let p = &self.from[v];
                let (pk, pi, pj) = (S::dsplat(p[k]), S::dsplat(p[i]), S::dsplat(p[j]));
                (S::dsub(S::dmul(pi, dk), S::dmul(pk, di)), S::dsub(S::dmul(pj, dk), S::dmul(pk, dj)))
            });
            let (u0, u1) = (S::dmul(xb, yc), S::dmul(yb, xc));
            let (v0, v1) = (S::dmul(xc, ya), S::dmul(yc, xa));
            let (w0, w1) = (S::dmul(xa, yb), S::dmul(ya, xb));
            let (lu, lv, lw) = (S::dlt(u1, u0), S::dlt(v1, v0), S::dlt(w1, w0));
            let (ru, rv, rw) = (S::dlt(u0, u1), S::dlt(v0, v1), S::dlt(w0, w1));
            let strictly = S::dor(S::dand(S::dand(lu, lv), lw), S::dand(S::dand(ru, rv), rw));
            let outside = S::dand(S::dor(S::dor(lu, lv), lw), S::dor(S::dor(ru, rv), rw));
            (strictly, !S::dbits(outside) & 255)
        }
    }

    /// The constants of the distance.
    #[inline(always)]
    pub fn plane(&self, k: usize, forward: f64) -> Plane {
        let [a, b, c] = self.corners;
        let (e1, e2) = (b - a, c - a);
        let s = [-self.from[0][0], -self.from[0][1], -self.from[0][2]];
        let q = [s[1] * e1.z - s[2] * e1.y, s[2] * e1.x - s[0] * e1.z, s[0] * e1.y - s[1] * e1.x];
        let depths = each_of!([0, 1, 2], v => self.from[v][k] * forward);
        let nearest = depths[0].min(depths[1]).min(depths[2]);
        let farthest = depths[0].max(depths[1]).max(depths[2]);
        Plane {
            e1: e1.to_array(),
            e2: e2.to_array(),
            numerator: e2.x * q[0] + e2.y * q[1] + e2.z * q[2],
            nearest: nearest * (1.0 - DEPTH_SLACK),
            farthest: farthest * (1.0 + DEPTH_SLACK),
            least: EDGE_ON * e1.abs().max_element() * e2.abs().max_element(),
        }
    }

    /// Distances of the rays inside; `strictly` and `maybe` are what [`Triangle::inside`] said.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn hit<S: Simd>(&self, plane: &Plane, k: usize, strictly: S::N, maybe: u32, rays: &mut Rays) {
        // SAFETY: the caller vouches for the instruction set.
        let mut rest = unsafe {
            let d = each_of!([0, 1, 2], a => S::dload(rays.along(a)));
            let e1 = each_of!([0, 1, 2], a => S::dsplat(plane.e1[a]));
            let e2 = each_of!([0, 1, 2], a => S::dsplat(plane.e2[a]));
            let h = each_of!([0, 1, 2], a => {
                let (u, v) = ((a + 1) % 3, (a + 2) % 3);
                S::dsub(S::dmul(d[u], e2[v]), S::dmul(d[v], e2[u]))
            });
            let det = S::dadd(S::dadd(S::dmul(h[0], e1[0]), S::dmul(h[1], e1[1])), S::dmul(h[2], e1[2]));
            let t = S::ddiv(S::dsplat(plane.numerator), det);
            let along = S::dabs(S::dload(rays.along(k)));
            let depth = S::dmul(t, along);
            let faces = S::dle(S::dmul(S::dsplat(plane.least), along), S::dabs(det));
            let within =
                S::dand(S::dle(S::dsplat(plane.nearest), depth), S::dle(depth, S::dsplat(plane.farthest)));
            let sound = S::dand(strictly, S::dand(faces, within));
            rays.offer_all::<S>(S::dand(sound, S::dlt(S::dsplat(0.0), t)), t, self.id);
            maybe & !S::dbits(sound)
        };
        while rest != 0 {
            let ray = rest.trailing_zeros() as usize;
            if let Some(t) = intersect::triangle(self.origin, rays.direction(ray), self.corners) {
                rays.offer(ray, t, self.id);
            }
            rest &= rest - 1;
        }
    }
}

/// What the distances of all rays from one origin to a triangle share.
pub(super) struct Plane {
    e1: [f64; 3],
    e2: [f64; 3],
    /// `e2·q`.
    numerator: f64,
    /// Range of depths that a sound distance has.
    nearest: f64,
    farthest: f64,
    /// Smallest `det` of a triangle not seen edge-on, per unit of depth.
    least: f64,
}

/// Asks eight rays about a cube.
pub(super) fn hit_cube(id: u32, cube: Cube, origin: DVec3, rays: &mut Rays) {
    for ray in 0..8 {
        if let Some(t) = intersect::cube(origin, rays.direction(ray), cube) {
            rays.offer(ray, t, id);
        }
    }
}
