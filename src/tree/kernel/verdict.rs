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

/// Several registers of rays.
pub(super) struct Rows<'a> {
    pub directions: [&'a [[f64; 8]]; 3],
    pub t: &'a mut [[f64; 8]],
    pub id: &'a mut [[u32; 8]],
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

    /// Takes over the distances of the lanes in `hit` that are the nearest so far.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn offer_all<S: Simd>(&mut self, hit: u32, t: S::D, id: u32) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let best = S::dload(self.t);
            let (nearer, not_farther) = (S::dbits(S::dlt(t, best)), S::dbits(S::dle(t, best)));
            let ties = (not_farther & !nearer) & S::greater_ids(self.id, id);
            S::put((nearer | ties) & hit, self.t, t, self.id, id);
        }
    }
}

/// What the distances of all rays from one origin to a triangle share.
pub(super) struct Plane {
    id: u32,
    e1: [f64; 4],
    e2: [f64; 4],
    /// `e2·q`.
    numerator: f64,
    /// Range of depths that a sound distance has.
    nearest: f64,
    farthest: f64,
    /// Smallest `det` of a triangle not seen edge-on, per unit of depth.
    least: f64,
}

impl Plane {
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn of<S: Simd>(
        id: u32,
        corners: [&[f64; 3]; 3],
        origin: &[f64; 3],
        k: usize,
        forward: f64,
    ) -> Plane {
        let mut plane =
            Plane { id, e1: [0.0; 4], e2: [0.0; 4], numerator: 0.0, nearest: 0.0, farthest: 0.0, least: 0.0 };
        let depths = each_of!([0, 1, 2], v => (corners[v][k] - origin[k]) * forward);
        plane.nearest = depths[0].min(depths[1]).min(depths[2]) * (1.0 - DEPTH_SLACK);
        plane.farthest = depths[0].max(depths[1]).max(depths[2]) * (1.0 + DEPTH_SLACK);
        let mut products = [0.0; 4];
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let [a, b, c] = each_of!([0, 1, 2], v => S::qload3(corners[v]));
            let (e1, e2, p) = (S::qsub(b, a), S::qsub(c, a), S::qsub(a, S::qload3(origin)));
            // e1 × p is -p × e1, bit for bit.
            let (e1t, pt) = (S::qturn(e1), S::qturn(p));
            let q = S::qsub(S::qmul(e1t, S::qturn(pt)), S::qmul(S::qturn(e1t), pt));
            S::qkeep(&mut products, S::qmul(e2, q));
            S::qkeep(&mut plane.e1, e1);
            S::qkeep(&mut plane.e2, e2);
        }
        let longest = |e: &[f64; 4]| e[0].abs().max(e[1].abs()).max(e[2].abs());
        plane.least = EDGE_ON * longest(&plane.e1) * longest(&plane.e2);
        plane.numerator = products[0] + products[1] + products[2];
        plane
    }

    /// Distances of the rays that are `strictly` inside, and the verdicts on those that are not but `maybe`.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn hit<S: Simd>(
        &self,
        k: usize,
        mut strictly: u32,
        mut maybe: u32,
        rays: Rows,
        corners: [&[f64; 3]; 3],
        origin: &[f64; 3],
    ) {
        let [x, y, z] = rays.directions;
        for ((((x, y), z), t), id) in x.iter().zip(y).zip(z).zip(rays.t).zip(rays.id) {
            let mut rays = Rays { directions: [x, y, z], t, id };
            // SAFETY: the caller vouches for the instruction set.
            let sound = unsafe { self.distances::<S>(k, strictly & 255, &mut rays) };
            let rest = maybe & 255 & !sound;
            if rest != 0 {
                self.ask(rest, &mut rays, corners, origin);
            }
            (strictly, maybe) = (strictly >> 8, maybe >> 8);
        }
    }

    /// Distances of eight rays that are `strictly` inside; returns those for which they count.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn distances<S: Simd>(&self, k: usize, strictly: u32, rays: &mut Rays) -> u32 {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let d = each_of!([0, 1, 2], a => S::dload(rays.directions[a]));
            let e1 = each_of!([0, 1, 2], a => S::dsplat(self.e1[a]));
            let e2 = each_of!([0, 1, 2], a => S::dsplat(self.e2[a]));
            let h = each_of!([0, 1, 2], a => {
                let (u, v) = ((a + 1) % 3, (a + 2) % 3);
                S::dsub(S::dmul(d[u], e2[v]), S::dmul(d[v], e2[u]))
            });
            let det = S::dadd(S::dadd(S::dmul(h[0], e1[0]), S::dmul(h[1], e1[1])), S::dmul(h[2], e1[2]));
            let t = S::ddiv(S::dsplat(self.numerator), det);
            let along = S::dabs(S::dload(rays.directions[k]));
            let depth = S::dmul(t, along);
            let faces = S::dle(S::dmul(S::dsplat(self.least), along), S::dabs(det));
            let within =
                S::dand(S::dle(S::dsplat(self.nearest), depth), S::dle(depth, S::dsplat(self.farthest)));
            let sound = strictly & S::dbits(S::dand(faces, within));
            rays.offer_all::<S>(sound & S::dbits(S::dlt(S::dsplat(0.0), t)), t, self.id);
            sound
        }
    }

    /// The full verdict, ray by ray.
    #[cold]
    fn ask(&self, mut rest: u32, rays: &mut Rays, corners: [&[f64; 3]; 3], origin: &[f64; 3]) {
        let corners = corners.map(|c| DVec3::from(*c));
        while rest != 0 {
            let ray = rest.trailing_zeros() as usize;
            if let Some(t) = intersect::triangle(DVec3::from(*origin), rays.direction(ray), corners) {
                rays.offer(ray, t, self.id);
            }
            rest &= rest - 1;
        }
    }
}

/// Asks eight rays about a cube.
pub(super) fn hit_cube(id: u32, cube: Cube, origin: DVec3, rays: &mut Rays) {
    for ray in 0..8 {
        if let Some(t) = intersect::cube(origin, rays.direction(ray), cube) {
            rays.offer(ray, t, id);
        }
    }
}
