//! Which rays of a pulse pass within a triangle, decided in single precision wherever that suffices.
//!
//! In coordinates sheared along the pulse's first ray, a ray that deviates from it by slopes `(δ_i, δ_j)` passes the edge
//! from corner `p` to corner `q` on the side given by the sign of `E = c0 + c1·δ_i + c2·δ_j`, where
//! `(c1, c2, c0) = p × q`. The three coefficients come from double precision, and as they are small for small triangles
//! near the ray, so is the error of `E`. It is bounded; a ray within the bound of an edge is left undecided.

use super::lanes::{Deviations, Lanes};
use crate::tree::simd::{Simd, each_of};

/// Corners of a triangle by axis; the fourth place is idle.
pub(super) type Corners = [[f64; 4]; 3];

/// Rounding of the coefficients, the deviations and the evaluation, all in single precision, with room to spare.
const SINGLE: f64 = 1.0 / (1u64 << 20) as f64;

/// Rounding of sheared coordinates, here and in the verdict, relative to the corners' distance, with room to spare.
const DOUBLE: f64 = 1.0 / (1u64 << 46) as f64;

/// The edge functions of a triangle for one pulse; lanes are the edges.
pub(super) struct Edges {
    /// `c1`, `c2`, `c0`, and the bound of the error.
    coefficients: [[f32; 4]; 4],
}

impl Edges {
    /// The edges of a triangle as seen by pulse `p` from `origin`.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn of<S: Simd>(lanes: &Lanes<S>, scale: f64, p: usize, origin: &[f64; 3], corners: &Corners) -> Edges {
        let [k, i, j] = lanes.axes;
        let mut coefficients = [[0.0; 4]; 4];
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let forward = scale * f64::from(lanes.forward);
            let z = S::qmul(S::qsub(S::qload(&corners[k]), S::qsplat(origin[k])), S::qsplat(forward));
            let [x, y] = each_of!([0, 1], side => {
                let a = [i, j][side];
                let along = S::qmul(S::qsub(S::qload(&corners[a]), S::qsplat(origin[a])), S::qsplat(scale));
                S::qsub(along, S::qmul(S::qsplat(lanes.middle[side][p]), z))
            });
            let (xn, yn, zn) = (S::qturn(x), S::qturn(y), S::qturn(z));
            let c = [
                S::qsub(S::qmul(y, zn), S::qmul(z, yn)),
                S::qsub(S::qmul(z, xn), S::qmul(x, zn)),
                S::qsub(S::qmul(x, yn), S::qmul(y, xn)),
            ];
            let width = S::qsplat(lanes.width[p]);
            let aside = S::qadd(S::qabs(x), S::qabs(y));
            let distant = S::qabs(z);
            let across = S::qadd(aside, S::qmul(width, distant));
            let reach = S::qadd(aside, distant);
            let both = S::qmul(S::qadd(across, S::qturn(across)), S::qadd(reach, S::qturn(reach)));
            let tilt = S::qmul(S::qadd(S::qabs(c[0]), S::qabs(c[1])), width);
            let single = S::qmul(S::qadd(S::qabs(c[2]), tilt), S::qsplat(SINGLE));
            let error = S::qadd(single, S::qmul(both, S::qsplat(DOUBLE)));
            for n in 0..3 {
                S::qstore(&mut coefficients[n], c[n]);
            }
            S::qstore(&mut coefficients[3], error);
        }
        Edges { coefficients }
    }

    /// Of sixteen rays: those surely inside, and those not surely outside.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn inside<S: Simd>(&self, deviations: &Deviations) -> (u32, u32) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let (di, dj) = (S::load(&deviations[0]), S::load(&deviations[1]));
            let [a, b, c] = each_of!([0, 1, 2], n => {
                let [c1, c2, c0, error] = each_of!([0, 1, 2, 3], m => S::splat(self.coefficients[m][n]));
                let e = S::add(S::add(S::mul(c1, di), S::mul(c2, dj)), c0);
                (S::lt(error, e), S::lt(e, S::sub(S::splat(0.0), error)))
            });
            let strictly = S::or(S::and(S::and(a.0, b.0), c.0), S::and(S::and(a.1, b.1), c.1));
            let outside = S::and(S::or(S::or(a.0, b.0), c.0), S::or(S::or(a.1, b.1), c.1));
            (S::bits(strictly), !S::bits(outside) & 0xffff)
        }
    }
}
