//! Which rays of a pulse pass within a triangle, decided in single precision wherever that suffices: sixteen pairs of a
//! pulse and a triangle at a time, lanes being pairs.
//!
//! The reasoning is that of [`super::edges`]; only the corners come rounded from the block, relative to the group's apex,
//! so that the error is bounded by that rounding times the size of the triangle. What stays undecided goes to
//! [`super::edges`], which starts from double precision.
//!
//! With `(X, Y, z)` a corner in coordinates sheared along the pulse's first ray, `q` the greatest of
//! `|X| + |Y| + 2·w·|z|` over the corners (`w` the pulse's width), and `ε` the greatest error of `X`, `Y` and `z`, an edge
//! function `E = (X_p·Y_q − Y_p·X_q) + (Y_p·z_q − z_p·Y_q)·δ_i + (z_p·X_q − X_p·z_q)·δ_j` errs by no more than
//! `2·(1 + w)·ε·(q + 2ε)` through its corners and `2⁻²⁰·(q + 2ε)²` through its own arithmetic.
//!
//! A ray of a packet starts aside of the first, at `u = (u_i, u_j)`. To it the corners are at `(X − u_i, Y − u_j, z)`, which
//! adds `e_x·u_j − e_y·u_i + e_z·(u_i·δ_j − u_j·δ_i)` to the edge function, `e` being the edge, and twice the greatest `|u|`
//! to `q`; the rounding of `u` counts like that of corners.

use super::lanes::{Asides, Deviations, Lanes};
use crate::tree::block::{Block, LANES};
use crate::tree::simd::{Simd, each_of};

/// Error of the products and sums of an edge function, relative to `(q + 2ε)²`, and some more.
const PRODUCTS: f32 = 1e-6;

/// Up to five roundings by half a unit in the last place on the way to `X` and `Y`, of `|X|` and of the shear `m·|z|`.
/// Those of `z` count where it is multiplied by `w` only, and are among [`PRODUCTS`].
const ROUNDINGS: f32 = 5.05 * 0.5 * f32::EPSILON;

/// Error of where a ray of a packet starts, relative to the greatest distance of that from the first.
const START: f32 = 2.0 * f32::EPSILON;

/// The edge functions of sixteen pairs.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Sides {
    /// `c1`, `c2`, `c0` of each edge.
    coefficients: [[[f32; LANES]; 3]; 3],
    /// Bound of the error, and its negative.
    error: [[f32; LANES]; 2],
    /// The edges; of packets only.
    edges: [[[f32; LANES]; 3]; 3],
}

impl Sides {
    pub const NONE: Sides = Sides {
        coefficients: [[[0.0; LANES]; 3]; 3],
        error: [[0.0; LANES]; 2],
        edges: [[[0.0; LANES]; 3]; 3],
    };

    /// The edges of sixteen pairs of a block, written to `sides`; returns the pairs of which any ray may be inside, and
    /// those of which surely all rays are.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn of<S: Simd, const PACKED: bool>(
        sides: &mut Sides,
        lanes: &Lanes<S>,
        block: &Block,
        pairs: &[u32; LANES],
    ) -> [u32; 2] {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let [triangle, pulse] = S::places(pairs);
            let [k, i, j] = lanes.axes;
            let apex = [S::splat(lanes.apex[k]), S::splat(lanes.apex[i]), S::splat(lanes.apex[j])];
            let view = &lanes.view;
            let from = each_of!([0, 1, 2], n => S::pick(&view.from[n].0, pulse));
            let middle = each_of!([0, 1], n => S::pick(&view.middle[n].0, pulse));
            let width = S::pick(&view.width.0, pulse);
            let twice = S::add(width, width);
            let corner = each_of!([0, 1, 2], v => {
                let at = each_of!([0, 1, 2], n => {
                    let picked = S::pick(&block.corner[v][[k, i, j][n]], triangle);
                    S::sub(S::sub(picked, apex[n]), from[n])
                });
                let x = S::sub(at[1], S::mul(middle[0], at[0]));
                let y = S::sub(at[2], S::mul(middle[1], at[0]));
                [x, y, at[0]]
            });
            let depth = each_of!([0, 1, 2], v => S::abs(corner[v][2]));
            let size = each_of!([0, 1, 2], v => {
                let aside = S::add(S::abs(corner[v][0]), S::abs(corner[v][1]));
                S::add(aside, S::mul(twice, depth[v]))
            });
            let size = S::max(S::max(size[0], size[1]), size[2]);
            let depth = S::max(S::max(depth[0], depth[1]), depth[2]);
            let aside = S::add(size, S::mul(S::pick(&view.tilt.0, pulse), depth));
            let corner_error = S::add(S::splat(lanes.slack), S::mul(S::splat(ROUNDINGS), aside));
            let (mut reach, mut size, mut corner_error) = (S::splat(0.0), size, corner_error);
            if PACKED {
                reach = S::pick(&view.reach.0, pulse);
                size = S::add(size, S::add(reach, reach));
                corner_error = S::add(corner_error, S::mul(S::splat(START), reach));
            }
            let size = S::add(size, S::add(corner_error, corner_error));
            let through_corners =
                S::mul(S::add(S::splat(2.00001), S::mul(S::splat(2.00001), width)), corner_error);
            let relative = S::add(
                through_corners,
                S::mul(S::splat(if PACKED { 2.0 * PRODUCTS } else { PRODUCTS }), size),
            );
            let error = S::add(S::mul(relative, size), S::splat(f32::MIN_POSITIVE));
            let negated = S::sub(S::splat(0.0), error);
            S::store(&mut sides.error[0], error);
            S::store(&mut sides.error[1], negated);
            let parted = each_of!([0, 1, 2], e => {
                let (p, q) = (&corner[e], &corner[(e + 1) % 3]);
                let c1 = S::sub(S::mul(p[1], q[2]), S::mul(p[2], q[1]));
                let c2 = S::sub(S::mul(p[2], q[0]), S::mul(p[0], q[2]));
                let c0 = S::sub(S::mul(p[0], q[1]), S::mul(p[1], q[0]));
                let to = &mut sides.coefficients[e];
                S::store(&mut to[0], c1);
                S::store(&mut to[1], c2);
                S::store(&mut to[2], c0);
                let mut spread = S::add(S::mul(S::add(S::abs(c1), S::abs(c2)), width), error);
                if PACKED {
                    let edge = each_of!([0, 1, 2], n => S::sub(q[n], p[n]));
                    for (to, edge) in sides.edges[e].iter_mut().zip(edge) {
                        S::store(to, edge);
                    }
                    let turned = S::mul(S::abs(edge[2]), twice);
                    let moved = S::add(S::add(S::abs(edge[0]), S::abs(edge[1])), turned);
                    spread = S::add(spread, S::mul(moved, S::mul(reach, S::splat(1.00001))));
                }
                (S::lt(spread, c0), S::lt(c0, S::sub(S::splat(0.0), spread)))
            });
            // The whole pulse is left of one edge and right of another.
            let left = S::or(S::or(parted[0].0, parted[1].0), parted[2].0);
            let right = S::or(S::or(parted[0].1, parted[1].1), parted[2].1);
            // Or it is left, or right, of all three.
            let all_left = S::and(S::and(parted[0].0, parted[1].0), parted[2].0);
            let all_right = S::and(S::and(parted[0].1, parted[1].1), parted[2].1);
            [!S::bits(S::and(left, right)) & 0xffff, S::bits(S::or(all_left, all_right))]
        }
    }

    /// Of sixteen rays of the pulse of pair `n`: those surely inside, and those not surely outside. `asides` count in
    /// packets only.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn inside<S: Simd, const PACKED: bool>(
        &self,
        n: usize,
        deviations: &Deviations,
        asides: Option<&Asides>,
    ) -> (u32, u32) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let (di, dj) = (S::load(&deviations[0]), S::load(&deviations[1]));
            let (error, negated) = (S::splat(self.error[0][n]), S::splat(self.error[1][n]));
            let [a, b, c] = each_of!([0, 1, 2], e => {
                let [c1, c2, c0] = each_of!([0, 1, 2], m => S::splat(self.coefficients[e][m][n]));
                let still = S::add(S::add(S::mul(c1, di), S::mul(c2, dj)), c0);
                match asides {
                    Some(asides) if PACKED => {
                        let [x, y, z] = each_of!([0, 1, 2], m => S::splat(self.edges[e][m][n]));
                        let [ui, uj, turned] = each_of!([0, 1, 2], m => S::load(&asides[m]));
                        let moved = S::sub(S::mul(x, uj), S::mul(y, ui));
                        S::add(still, S::add(moved, S::mul(z, turned)))
                    }
                    _ => still,
                }
            });
            let least = S::min(S::min(a, b), c);
            let greatest = S::max(S::max(a, b), c);
            let strictly = S::or(S::lt(error, least), S::lt(greatest, negated));
            let outside = S::and(S::lt(least, negated), S::lt(error, greatest));
            (S::bits(strictly), !S::bits(outside) & 0xffff)
        }
    }
}
