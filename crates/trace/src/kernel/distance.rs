//! The distances of a pulse's rays to one primitive, eight rays at a time: the arithmetic of
//! [`intersect`](mod@crate::intersect), operation by operation, so that the bits are equal. Rays for which
//! that arithmetic takes one of its rare branches are left to the exact test.

#![expect(clippy::needless_range_loop, reason = "lanes of several arrays are counted together")]

use crate::Cube;
use crate::intersect::{self, DEPTH_SLACK, EDGE_ON, MIN_DIRECTION};
use crate::simd::{F64Ops, MaskOps, QuadOps, Simd, VectorOps, each_of};
use vlscan_geom::{Aabb, DVec3};

/// Eight rays: directions and the nearest hits so far.
pub(super) struct Rays<'a> {
    pub directions: [&'a [f64; 8]; 3],
    pub t: &'a mut [f64; 8],
    pub id: &'a mut [u32; 8],
}

impl Rays<'_> {
    fn direction(&self, ray: usize) -> DVec3 {
        DVec3::new(self.directions[0][ray], self.directions[1][ray], self.directions[2][ray])
    }

    fn keep_nearest(&mut self, ray: usize, t: f64, id: u32) {
        if t < self.t[ray] || (t == self.t[ray] && id < self.id[ray]) {
            (self.t[ray], self.id[ray]) = (t, id);
        }
    }

    /// Applies the exact test of a triangle to the rays in a mask; `origin` returns the origin of each.
    pub fn intersect_exact(
        &mut self,
        mut rest: u32,
        id: u32,
        corners: [DVec3; 3],
        origin: impl Fn(usize) -> DVec3,
    ) {
        while rest != 0 {
            let ray = rest.trailing_zeros() as usize;
            if let Some(t) = intersect::triangle(origin(ray), self.direction(ray), corners) {
                self.keep_nearest(ray, t, id);
            }
            rest &= rest - 1;
        }
    }

    /// Applies the test of a cube to all rays, operation by operation as [`intersect::cube`]; `origin`
    /// returns the origin of each.
    #[inline(always)]
    pub fn intersect_cube(&mut self, id: u32, cube: Cube, origin: impl Fn(usize) -> DVec3) {
        let Aabb { min, max } = cube.bounds();
        let mut origins = [[0.0; 8]; 3];
        for ray in 0..8 {
            let origin = origin(ray);
            for axis in 0..3 {
                origins[axis][ray] = origin[axis];
            }
        }
        let (mut enter, mut leave, mut length) = ([f64::NEG_INFINITY; 8], [f64::INFINITY; 8], [0.0; 8]);
        for axis in 0..3 {
            let (min, max) = (min[axis], max[axis]);
            for ray in 0..8 {
                let (o, d) = (origins[axis][ray], self.directions[axis][ray]);
                let (low, high) = ((min - o) / d, (max - o) / d);
                let is_down = d.is_sign_negative();
                let (near, far) = (if is_down { high } else { low }, if is_down { low } else { high });
                enter[ray] = greater(near, enter[ray]);
                leave[ray] = lesser(far, leave[ray]);
                length[ray] = greater(d.abs(), length[ray]);
            }
        }
        for ray in 0..8 {
            let t = enter[ray];
            if t <= leave[ray] && t > 0.0 && t.is_finite() && length[ray] >= MIN_DIRECTION {
                self.keep_nearest(ray, t, id);
            }
        }
    }
}

/// The dominant axis of the rays, the sign of their directions along it and the maximum magnitude of that
/// component.
#[derive(Clone, Copy)]
pub(super) struct Heading {
    pub axis: usize,
    pub forward: f64,
    pub max_along: f64,
}

#[inline(always)]
fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// Maximum of the first three numbers.
#[inline(always)]
fn longest(e: &[f64]) -> f64 {
    greater(greater(e[0], e[1]), e[2])
}

/// Values shared by the distances of all rays from one origin to a triangle.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Plane {
    e1: [f64; 4],
    e2: [f64; 4],
    /// `e2·q`.
    numerator: f64,
    /// Range of a valid hit's coordinate along the dominant axis, relative to the origin.
    low: f64,
    high: f64,
    /// Minimum `det` of a triangle that is not seen edge-on.
    min_det: f64,
    pub id: u32,
    pub vertex: [u32; 3],
    pub pulse: u32,
}

impl Plane {
    pub const ZERO: Plane = Plane {
        e1: [0.0; 4],
        e2: [0.0; 4],
        numerator: 0.0,
        low: 0.0,
        high: 0.0,
        min_det: 0.0,
        id: 0,
        vertex: [0; 3],
        pulse: 0,
    };

    /// Computes the values that depend only on the corners and the origin.
    #[inline(always)]
    pub fn set<S: Simd>(&mut self, simd: S, corners: [&[f64; 3]; 3], origin: &[f64; 3], heading: Heading) {
        let Heading { axis: k, forward, max_along } = heading;
        let depths = each_of!([0, 1, 2], v => (corners[v][k] - origin[k]) * forward);
        let nearest = lesser(lesser(depths[0], depths[1]), depths[2]) * (1.0 - DEPTH_SLACK);
        let farthest = greater(greater(depths[0], depths[1]), depths[2]) * (1.0 + DEPTH_SLACK);
        // A hit that is not in front of the origin is left to the exact test.
        let nearest = greater(nearest, f64::MIN_POSITIVE);
        (self.low, self.high) = if forward < 0.0 { (-farthest, -nearest) } else { (nearest, farthest) };
        let (mut products, mut lengths) = ([0.0; 4], [[0.0; 4]; 2]);
        let [a, b, c] = each_of!([0, 1, 2], v => simd.load_triple(corners[v]));
        let (e1, e2, p) = (b - a, c - a, a - simd.load_triple(origin));
        // e1 × p equals -p × e1, bit for bit.
        let (e1t, pt) = (e1.rotate(), p.rotate());
        let q = e1t * pt.rotate() - e1t.rotate() * pt;
        (e2 * q).store(&mut products);
        e1.abs().store(&mut lengths[0]);
        e2.abs().store(&mut lengths[1]);
        e1.store(&mut self.e1);
        e2.store(&mut self.e2);
        self.min_det = EDGE_ON * longest(&lengths[0]) * longest(&lengths[1]) * max_along;
        self.numerator = products[0] + products[1] + products[2];
    }

    /// Merges the distances of eight rays, those `strictly` inside, into the hits `t` and `ids`, where the
    /// fast arithmetic is valid. Returns the rays for which it is. `along` are the directions along the
    /// dominant axis.
    #[inline(always)]
    pub fn hit<S: Simd>(
        &self,
        simd: S,
        strictly: u32,
        directions: [&[f64; 8]; 3],
        along: &[f64; 8],
        (t, ids): (&mut [f64; 8], &mut [u32; 8]),
    ) -> u32 {
        let d = each_of!([0, 1, 2], a => simd.load_f64(directions[a]));
        let e1 = each_of!([0, 1, 2], a => simd.splat_f64(self.e1[a]));
        let e2 = each_of!([0, 1, 2], a => simd.splat_f64(self.e2[a]));
        let h = each_of!([0, 1, 2], a => {
            let (u, v) = ((a + 1) % 3, (a + 2) % 3);
            d[u] * e2[v] - d[v] * e2[u]
        });
        let det = h[0] * e1[0] + h[1] * e1[1] + h[2] * e1[2];
        let distance = simd.splat_f64(self.numerator) / det;
        let at = distance * simd.load_f64(along);
        let faces = simd.splat_f64(self.min_det).le(det.abs());
        let within = simd.splat_f64(self.low).le(at) & at.le(simd.splat_f64(self.high));
        let sound = simd.mask8(strictly) & faces & within;
        simd.keep_nearest(sound, t, distance, ids, self.id);
        sound.bits()
    }
}

/// Merges the distances of eight rays of a merged pulse, each with a separate origin, those `strictly` inside
/// a triangle, into the hits `t` and `ids`, where the fast arithmetic is valid. Returns the rays for which it
/// is.
#[inline(always)]
pub(super) fn hit_merged<S: Simd>(
    simd: S,
    strictly: u32,
    corners: [&DVec3; 3],
    (directions, origins): ([&[f64; 8]; 3], [&[f64; 8]; 3]),
    heading: Heading,
    (t, ids, id): (&mut [f64; 8], &mut [u32; 8], u32),
) -> u32 {
    let Heading { axis: k, forward, max_along } = heading;
    let d = each_of!([0, 1, 2], a => simd.load_f64(directions[a]));
    let o = each_of!([0, 1, 2], a => simd.load_f64(origins[a]));
    let [s1, s2] = [*corners[1] - *corners[0], *corners[2] - *corners[0]].map(|e| e.to_array());
    let p = each_of!([0, 1, 2], a => simd.splat_f64(corners[0][a]) - o[a]);
    let e1 = each_of!([0, 1, 2], a => simd.splat_f64(s1[a]));
    let e2 = each_of!([0, 1, 2], a => simd.splat_f64(s2[a]));
    let q = each_of!([0, 1, 2], a => {
        let (u, v) = ((a + 1) % 3, (a + 2) % 3);
        // e1 × p equals -p × e1, bit for bit.
        e1[u] * p[v] - e1[v] * p[u]
    });
    let h = each_of!([0, 1, 2], a => {
        let (u, v) = ((a + 1) % 3, (a + 2) % 3);
        d[u] * e2[v] - d[v] * e2[u]
    });
    let numerator = e2[0] * q[0] + e2[1] * q[1] + e2[2] * q[2];
    let det = h[0] * e1[0] + h[1] * e1[1] + h[2] * e1[2];
    let distance = numerator / det;
    let (sign, zero) = (simd.splat_f64(forward), simd.splat_f64(0.0));
    let at = distance * d[k] * sign;
    let depths = each_of!([0, 1, 2], c => (simd.splat_f64(corners[c][k]) - o[k]) * sign);
    let negated = each_of!([0, 1, 2], c => zero - depths[c]);
    let farthest = depths[0].max(depths[1]).max(depths[2]);
    let nearest = zero - negated[0].max(negated[1]).max(negated[2]);
    // A hit that is not in front of the origin is left to the exact test.
    let nearest = (nearest * simd.splat_f64(1.0 - DEPTH_SLACK)).max(simd.splat_f64(f64::MIN_POSITIVE));
    let farthest = farthest * simd.splat_f64(1.0 + DEPTH_SLACK);
    let min_det = EDGE_ON * longest(&s1.map(f64::abs)) * longest(&s2.map(f64::abs)) * max_along;
    let faces = simd.splat_f64(min_det).le(det.abs());
    let sound = simd.mask8(strictly) & faces & (nearest.le(at) & at.le(farthest));
    simd.keep_nearest(sound, t, distance, ids, id);
    sound.bits()
}
