//! The distances of a pulse's rays to one primitive, eight rays at a time: the arithmetic of
//! [`intersect`](crate::tree::intersect), operation by operation, so that the bits are the same. Rays for which that
//! arithmetic takes one of its rare turns are referred to it.

use crate::geom::DVec3;
use crate::tree::geometry::Cube;
use crate::tree::intersect::{self, DEPTH_SLACK, EDGE_ON};
use crate::tree::simd::{Simd, each_of};

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

    fn offer(&mut self, ray: usize, t: f64, id: u32) {
        if t < self.t[ray] || (t == self.t[ray] && id < self.id[ray]) {
            (self.t[ray], self.id[ray]) = (t, id);
        }
    }
}

/// What the distances of all rays from one origin to a triangle share.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Plane {
    e1: [f64; 4],
    e2: [f64; 4],
    /// `e2·q`.
    numerator: f64,
    /// Range that the coordinate of a sound hit has, along the dominant axis and from the origin.
    low: f64,
    high: f64,
    /// A `det` that is not less belongs to a triangle not seen edge-on.
    least: f64,
    pub id: u32,
    /// Which corners and origin they are: numbers of the vertices and of the pulse.
    pub vertex: [u32; 3],
    pub pulse: u32,
}

impl Plane {
    pub const NONE: Plane = Plane {
        e1: [0.0; 4],
        e2: [0.0; 4],
        numerator: 0.0,
        low: 0.0,
        high: 0.0,
        least: 0.0,
        id: 0,
        vertex: [0; 3],
        pulse: 0,
    };

    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn set<S: Simd>(
        &mut self,
        corners: [&[f64; 3]; 3],
        origin: &[f64; 3],
        k: usize,
        forward: f64,
        steepest: f64,
    ) {
        let least = |a: f64, b: f64| if a < b { a } else { b };
        let greatest = |a: f64, b: f64| if a > b { a } else { b };
        let depths = each_of!([0, 1, 2], v => (corners[v][k] - origin[k]) * forward);
        let nearest = least(least(depths[0], depths[1]), depths[2]) * (1.0 - DEPTH_SLACK);
        let farthest = greatest(greatest(depths[0], depths[1]), depths[2]) * (1.0 + DEPTH_SLACK);
        // What is nearer than nothing is left to the full verdict.
        let nearest = greatest(nearest, f64::MIN_POSITIVE);
        (self.low, self.high) = if forward < 0.0 { (-farthest, -nearest) } else { (nearest, farthest) };
        let (mut products, mut lengths) = ([0.0; 4], [[0.0; 4]; 2]);
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let [a, b, c] = each_of!([0, 1, 2], v => S::qload3(corners[v]));
            let (e1, e2, p) = (S::qsub(b, a), S::qsub(c, a), S::qsub(a, S::qload3(origin)));
            // e1 × p is -p × e1, bit for bit.
            let (e1t, pt) = (S::qturn(e1), S::qturn(p));
            let q = S::qsub(S::qmul(e1t, S::qturn(pt)), S::qmul(S::qturn(e1t), pt));
            S::qkeep(&mut products, S::qmul(e2, q));
            S::qkeep(&mut lengths[0], S::qabs(e1));
            S::qkeep(&mut lengths[1], S::qabs(e2));
            S::qkeep(&mut self.e1, e1);
            S::qkeep(&mut self.e2, e2);
        }
        let longest = |e: &[f64; 4]| greatest(greatest(e[0], e[1]), e[2]);
        self.least = EDGE_ON * longest(&lengths[0]) * longest(&lengths[1]) * steepest;
        self.numerator = products[0] + products[1] + products[2];
    }

    /// Distances of eight rays that are `strictly` inside; returns those for which they count. `along` are the
    /// directions along the dominant axis.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn hit<S: Simd>(
        &self,
        strictly: u32,
        directions: [&[f64; 8]; 3],
        along: &[f64; 8],
        t: &mut [f64; 8],
        ids: &mut [u32; 8],
    ) -> u32 {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let d = each_of!([0, 1, 2], a => S::dload(directions[a]));
            let e1 = each_of!([0, 1, 2], a => S::dsplat(self.e1[a]));
            let e2 = each_of!([0, 1, 2], a => S::dsplat(self.e2[a]));
            let h = each_of!([0, 1, 2], a => {
                let (u, v) = ((a + 1) % 3, (a + 2) % 3);
                S::dsub(S::dmul(d[u], e2[v]), S::dmul(d[v], e2[u]))
            });
            let det = S::dadd(S::dadd(S::dmul(h[0], e1[0]), S::dmul(h[1], e1[1])), S::dmul(h[2], e1[2]));
            let distance = S::ddiv(S::dsplat(self.numerator), det);
            let at = S::dmul(distance, S::dload(along));
            let faces = S::dle(S::dsplat(self.least), S::dabs(det));
            let within = S::dand(S::dle(S::dsplat(self.low), at), S::dle(at, S::dsplat(self.high)));
            let sound = S::dand(S::dand(S::dmask(strictly), faces), within);
            S::offer(sound, t, distance, ids, self.id);
            S::dbits(sound)
        }
    }
}

/// Distances of eight rays of a packet, each with its own origin, that are `strictly` inside a triangle; returns those for
/// which they count. `towards` are the dominant axis, its sign and the largest `|d_k|`.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
pub(super) unsafe fn hit_apart<S: Simd>(
    strictly: u32,
    corners: [&DVec3; 3],
    (directions, origins): ([&[f64; 8]; 3], [&[f64; 8]; 3]),
    (k, forward, steepest): (usize, f64, f64),
    (t, ids, id): (&mut [f64; 8], &mut [u32; 8], u32),
) -> u32 {
    // SAFETY: the caller vouches for the instruction set.
    unsafe {
        let d = each_of!([0, 1, 2], a => S::dload(directions[a]));
        let o = each_of!([0, 1, 2], a => S::dload(origins[a]));
        let e1 = *corners[1] - *corners[0];
        let e2 = *corners[2] - *corners[0];
        let p = each_of!([0, 1, 2], a => S::dsub(S::dsplat(corners[0][a]), o[a]));
        let [s1, s2] = [e1, e2].map(|e| e.to_array());
        let e1 = each_of!([0, 1, 2], a => S::dsplat(s1[a]));
        let e2 = each_of!([0, 1, 2], a => S::dsplat(s2[a]));
        let q = each_of!([0, 1, 2], a => {
            let (u, v) = ((a + 1) % 3, (a + 2) % 3);
            // e1 × p is -p × e1, bit for bit.
            S::dsub(S::dmul(e1[u], p[v]), S::dmul(e1[v], p[u]))
        });
        let h = each_of!([0, 1, 2], a => {
            let (u, v) = ((a + 1) % 3, (a + 2) % 3);
            S::dsub(S::dmul(d[u], e2[v]), S::dmul(d[v], e2[u]))
        });
        let numerator = S::dadd(S::dadd(S::dmul(e2[0], q[0]), S::dmul(e2[1], q[1])), S::dmul(e2[2], q[2]));
        let det = S::dadd(S::dadd(S::dmul(h[0], e1[0]), S::dmul(h[1], e1[1])), S::dmul(h[2], e1[2]));
        let distance = S::ddiv(numerator, det);
        let sign = S::dsplat(forward);
        let at = S::dmul(S::dmul(distance, d[k]), sign);
        let depths = each_of!([0, 1, 2], c => S::dmul(S::dsub(S::dsplat(corners[c][k]), o[k]), sign));
        let zero = S::dsplat(0.0);
        let negated = each_of!([0, 1, 2], c => S::dsub(zero, depths[c]));
        let farthest = S::dmax(S::dmax(depths[0], depths[1]), depths[2]);
        let nearest = S::dsub(zero, S::dmax(S::dmax(negated[0], negated[1]), negated[2]));
        // What is nearer than nothing is left to the full verdict.
        let nearest = S::dmax(S::dmul(nearest, S::dsplat(1.0 - DEPTH_SLACK)), S::dsplat(f64::MIN_POSITIVE));
        let farthest = S::dmul(farthest, S::dsplat(1.0 + DEPTH_SLACK));
        let longest = |e: &[f64; 3]| {
            let greatest = |a: f64, b: f64| if a > b { a } else { b };
            greatest(greatest(e[0].abs(), e[1].abs()), e[2].abs())
        };
        let least = EDGE_ON * longest(&s1) * longest(&s2) * steepest;
        let faces = S::dle(S::dsplat(least), S::dabs(det));
        let within = S::dand(S::dle(nearest, at), S::dle(at, farthest));
        let sound = S::dand(S::dand(S::dmask(strictly), faces), within);
        S::offer(sound, t, distance, ids, id);
        S::dbits(sound)
    }
}

/// The full verdict on some of eight rays; `origin` tells whence each comes.
pub(super) fn ask(
    mut rest: u32,
    id: u32,
    rays: &mut Rays,
    corners: [DVec3; 3],
    origin: impl Fn(usize) -> DVec3,
) {
    while rest != 0 {
        let ray = rest.trailing_zeros() as usize;
        if let Some(t) = intersect::triangle(origin(ray), rays.direction(ray), corners) {
            rays.offer(ray, t, id);
        }
        rest &= rest - 1;
    }
}

/// Asks eight rays about a cube.
pub(super) fn hit_cube(id: u32, cube: Cube, origin: impl Fn(usize) -> DVec3, rays: &mut Rays) {
    for ray in 0..8 {
        if let Some(t) = intersect::cube(origin(ray), rays.direction(ray), cube) {
            rays.offer(ray, t, id);
        }
    }
}
