//! Which rays of a pulse pass within a triangle, where the rounded corners of a block leave that open: from double
//! precision, but evaluated in single wherever that suffices.
//!
//! Slopes are `d_i/d_k` and `d_j/d_k`. In coordinates sheared along the pulse's first ray, a ray that deviates from it by
//! slopes `(δ_i, δ_j)` passes the edge
//! from corner `p` to corner `q` on the side given by the sign of `E = c0 + c1·δ_i + c2·δ_j`, where
//! `(c1, c2, c0) = p × q`. The three coefficients come from double precision, and as they are small for small triangles
//! near the ray, so is the error of `E`. It is bounded; a ray within the bound of an edge is left undecided.
//!
//! To rays of packets, which start aside of the first, the edges themselves count as well: see [`super::sides`].

use super::lanes::{Asides, Deviations};
use crate::geom::DVec3;
use crate::tree::simd::{Simd, each_of};

/// Corners of a triangle by axis; the fourth place is idle.
type Corners = [[f64; 4]; 3];

/// Brings the corners of a triangle into order.
#[inline(always)]
pub(super) fn by_axis([a, b, c]: [DVec3; 3]) -> Corners {
    [[a.x, b.x, c.x, 0.0], [a.y, b.y, c.y, 0.0], [a.z, b.z, c.z, 0.0]]
}

/// Rounding of the coefficients, the deviations and the evaluation, all in single precision, with room to spare.
const SINGLE: f64 = 1.0 / (1u64 << 20) as f64;

/// Rounding of sheared coordinates and their products, here and in the verdict, relative to the square of the corners'
/// distance, with room to spare.
const DOUBLE: f64 = 1.0 / (1u64 << 48) as f64;

/// Whence a pulse looks.
#[derive(Clone, Copy)]
pub(super) struct Eye {
    pub origin: [f64; 3],
    /// Slopes of the first ray on the side axes.
    pub middle: [f64; 2],
}

impl Eye {
    pub const NOWHERE: Eye = Eye { origin: [0.0; 3], middle: [0.0; 2] };
}

/// The edge functions of a triangle for one pulse; lanes are the edges.
#[derive(Clone, Copy)]
pub(super) struct Edges {
    /// `c1`, `c2`, `c0`, the bound of the error and its negative.
    coefficients: [[f32; 4]; 5],
    /// The edges by axis, for starts in the tree's frame.
    edges: [[f32; 4]; 3],
}

impl Edges {
    const NONE: Edges = Edges { coefficients: [[0.0; 4]; 5], edges: [[0.0; 4]; 3] };

    /// The edges of a triangle as a pulse sees them whose rays deviate from its first by no more than `width`. In a packet
    /// they start no farther aside of it than `start`, and from it than `spread`, in the tree's frame of this `scale`.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn of<S: Simd, const PACKED: bool>(
        [k, i, j]: [usize; 3],
        eye: &Eye,
        width: f64,
        (start, spread, scale): (f64, f64, f64),
        corners: &Corners,
    ) -> Edges {
        let mut edges = Edges::NONE;
        let Edges { coefficients, edges: by_axis } = &mut edges;
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let z = S::qsub(S::qload(&corners[k]), S::qsplat(eye.origin[k]));
            let x = S::qsub(S::qload(&corners[i]), S::qsplat(eye.origin[i]));
            let y = S::qsub(S::qload(&corners[j]), S::qsplat(eye.origin[j]));
            let x = S::qsub(x, S::qmul(S::qsplat(eye.middle[0]), z));
            let y = S::qsub(y, S::qmul(S::qsplat(eye.middle[1]), z));
            let (xn, yn, zn) = (S::qturn(x), S::qturn(y), S::qturn(z));
            let c1 = S::qsub(S::qmul(y, zn), S::qmul(z, yn));
            let c2 = S::qsub(S::qmul(z, xn), S::qmul(x, zn));
            let c0 = S::qsub(S::qmul(x, yn), S::qmul(y, xn));
            let mut reach = S::qadd(S::qabs(z), S::qadd(S::qabs(x), S::qabs(y)));
            let tilt = S::qmul(S::qadd(S::qabs(c1), S::qabs(c2)), S::qsplat(width));
            let mut most = S::qadd(S::qabs(c0), tilt);
            if PACKED {
                let edge = [S::qsub(xn, x), S::qsub(yn, y), S::qsub(zn, z)];
                let turned = S::qmul(S::qabs(edge[2]), S::qsplat(2.0 * width));
                let moved = S::qadd(S::qadd(S::qabs(edge[0]), S::qabs(edge[1])), turned);
                // Divisions by a power of two are exact.
                most = S::qadd(most, S::qmul(moved, S::qsplat(start / scale)));
                reach = S::qadd(reach, S::qsplat(4.0 * (spread / scale)));
                for (to, edge) in by_axis.iter_mut().zip(edge) {
                    S::qstore(to, S::qmul(edge, S::qsplat(1.0 / scale)));
                }
            }
            let reach = S::qadd(reach, S::qturn(reach));
            let double = S::qmul(S::qmul(reach, reach), S::qsplat(DOUBLE));
            let error = S::qadd(S::qmul(most, S::qsplat(SINGLE)), double);
            let zero = S::qsplat(0.0);
            S::qstore(&mut coefficients[0], c1);
            S::qstore(&mut coefficients[1], c2);
            S::qstore(&mut coefficients[2], c0);
            S::qstore(&mut coefficients[3], error);
            S::qstore(&mut coefficients[4], S::qsub(zero, error));
        }
        edges
    }

    /// Of sixteen rays: those surely inside, and those not surely outside. `asides` count in packets only.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn inside<S: Simd, const PACKED: bool>(
        &self,
        deviations: &Deviations,
        asides: Option<&Asides>,
    ) -> (u32, u32) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let (di, dj) = (S::load(&deviations[0]), S::load(&deviations[1]));
            let [a, b, c] = each_of!([0, 1, 2], n => {
                let [c1, c2, c0, error, negated] =
                    each_of!([0, 1, 2, 3, 4], m => S::splat(self.coefficients[m][n]));
                let mut e = S::add(S::add(S::mul(c1, di), S::mul(c2, dj)), c0);
                if let Some(asides) = asides.filter(|_| PACKED) {
                    let [x, y, z] = each_of!([0, 1, 2], m => S::splat(self.edges[m][n]));
                    let [ui, uj, turned] = each_of!([0, 1, 2], m => S::load(&asides[m]));
                    e = S::add(e, S::add(S::sub(S::mul(x, uj), S::mul(y, ui)), S::mul(z, turned)));
                }
                (S::lt(error, e), S::lt(e, negated))
            });
            let strictly = S::or(S::and(S::and(a.0, b.0), c.0), S::and(S::and(a.1, b.1), c.1));
            let outside = S::and(S::or(S::or(a.0, b.0), c.0), S::or(S::or(a.1, b.1), c.1));
            (S::bits(strictly), !S::bits(outside) & 0xffff)
        }
    }
}
