//! Selection of the rays of a pulse that pass within a triangle, decided in single precision wherever that
//! suffices: sixteen pairs of a pulse and a triangle at a time, lanes being pairs.
//!
//! The reasoning is that of [`super::edges`]; only the corners come rounded from the block, relative to the
//! packet's apex, so that the error is bounded by that rounding times the size of the triangle. What stays
//! undecided goes to [`super::edges`], which starts from double precision.
//!
//! With `(X, Y, z)` a corner in coordinates sheared along the pulse's first ray, `q` the greatest of
//! `|X| + |Y| + 2·w·|z|` over the corners (`w` the pulse's width), and `ε` the greatest error of `X`, `Y` and
//! `z`, an edge function `E = (X_p·Y_q − Y_p·X_q) + (Y_p·z_q − z_p·Y_q)·δ_i + (z_p·X_q − X_p·z_q)·δ_j` errs
//! by no more than `2·(1 + w)·ε·(q + 2ε)` through its corners and `2⁻²⁰·(q + 2ε)²` through its own
//! arithmetic.
//!
//! A ray of a merged pulse starts aside of the first, at `u = (u_i, u_j)`. To it the corners are at
//! `(X − u_i, Y − u_j, z)`, which adds `e_x·u_j − e_y·u_i + e_z·(u_i·δ_j − u_j·δ_i)` to the edge function,
//! `e` being the edge, and twice the greatest `|u|` to `q`; the rounding of `u` counts like that of corners.

use super::lanes::PerPulse;
use super::packet::PacketFrustum;
use super::spread::{Deviations, OriginOffsets};
use crate::block::{BLOCK_SIZE, Block};
use crate::simd::{F32Ops, MaskOps, Simd, VectorOps, each_of};

/// Error of the products and sums of an edge function, relative to `(q + 2ε)²`, generously rounded up.
const PRODUCTS: f32 = 1e-6;

/// Up to five roundings by half a unit in the last place on the way to `X` and `Y`, of `|X|` and of the shear
/// `m·|z|`. Those of `z` count where it is multiplied by `w` only, and are among [`PRODUCTS`].
const ROUNDINGS: f32 = 5.05 * 0.5 * f32::EPSILON;

/// Error of where a ray of a merged pulse starts, relative to the greatest distance of that from the first.
const START: f32 = 2.0 * f32::EPSILON;

/// The sheared coordinates of the pulses of sixteen pairs, see [`super::packet::LaneShears`].
struct PulseShear<S: Simd> {
    from: [S::F32x16; 3],
    slope: [S::F32x16; 2],
    max_slope: S::F32x16,
    width: S::F32x16,
    reach: S::F32x16,
}

/// The edge functions of sixteen pairs.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Sides {
    /// `c1`, `c2`, `c0` of each edge.
    coefficients: [[[f32; BLOCK_SIZE]; 3]; 3],
    /// Bound of the error, and its negative.
    error: [[f32; BLOCK_SIZE]; 2],
    /// The edges; only set for merged pulses.
    edges: [[[f32; BLOCK_SIZE]; 3]; 3],
}

impl Sides {
    pub const ZERO: Sides = Sides {
        coefficients: [[[0.0; BLOCK_SIZE]; 3]; 3],
        error: [[0.0; BLOCK_SIZE]; 2],
        edges: [[[0.0; BLOCK_SIZE]; 3]; 3],
    };

    /// Computes the edges of sixteen pairs of a block. Returns masks of the pairs of which any ray may be
    /// inside, and of those of which surely all rays are.
    #[inline(always)]
    pub fn set<S: Simd, const MERGED: bool>(
        &mut self,
        frustum: &PacketFrustum<S>,
        block: &Block,
        pairs: &[u32; BLOCK_SIZE],
    ) -> [u32; 2] {
        let simd = frustum.simd;
        let [triangle, pulse] = simd.indices(pairs);
        let shears = &frustum.lane_shears;
        let of = |lanes: &PerPulse| simd.look_up(&lanes.0, pulse);
        let pulses = PulseShear {
            from: each_of!([0, 1, 2], n => of(&shears.from[n])),
            slope: each_of!([0, 1], n => of(&shears.slope[n])),
            max_slope: of(&shears.max_slope),
            width: of(&shears.width),
            reach: if MERGED { of(&shears.reach) } else { simd.splat(0.0) },
        };
        let axes = frustum.axes;
        let corners = each_of!([0, 1, 2], v => {
            each_of!([0, 1, 2], n => simd.look_up(&block.corner[v][axes[n]], triangle))
        });
        self.set_lanes::<S, MERGED>(frustum, corners, pulses)
    }

    /// [`Sides::set`] for the pairs of all triangles of a block with pulse `p`, which is not merged.
    #[inline(always)]
    pub fn set_pulse<S: Simd>(&mut self, frustum: &PacketFrustum<S>, block: &Block, p: usize) -> [u32; 2] {
        let simd = frustum.simd;
        let shears = &frustum.lane_shears;
        let of = |lanes: &PerPulse| simd.splat(lanes.0[p]);
        let pulse = PulseShear {
            from: each_of!([0, 1, 2], n => of(&shears.from[n])),
            slope: each_of!([0, 1], n => of(&shears.slope[n])),
            max_slope: of(&shears.max_slope),
            width: of(&shears.width),
            reach: simd.splat(0.0),
        };
        let axes = frustum.axes;
        let corners =
            each_of!([0, 1, 2], v => each_of!([0, 1, 2], n => simd.load(&block.corner[v][axes[n]])));
        self.set_lanes::<S, false>(frustum, corners, pulse)
    }

    /// Computes the edges of sixteen pairs from the corners by dominant axis and side axes, and the pulses.
    #[inline(always)]
    fn set_lanes<S: Simd, const MERGED: bool>(
        &mut self,
        frustum: &PacketFrustum<S>,
        corners: [[S::F32x16; 3]; 3],
        pulses: PulseShear<S>,
    ) -> [u32; 2] {
        let simd = frustum.simd;
        let PulseShear { from, slope, max_slope, width, reach } = pulses;
        let apex = each_of!([0, 1, 2], n => simd.splat(frustum.apex[frustum.axes[n]]));
        let (zero, twice) = (simd.splat(0.0), width + width);
        let corner = each_of!([0, 1, 2], v => {
            let at = each_of!([0, 1, 2], n => corners[v][n] - apex[n] - from[n]);
            [at[1] - slope[0] * at[0], at[2] - slope[1] * at[0], at[0]]
        });
        let depth = each_of!([0, 1, 2], v => corner[v][2].abs());
        let size = each_of!([0, 1, 2], v => corner[v][0].abs() + corner[v][1].abs() + twice * depth[v]);
        let size = size[0].max(size[1]).max(size[2]);
        let depth = depth[0].max(depth[1]).max(depth[2]);
        let aside = size + max_slope * depth;
        let corner_error = simd.splat(frustum.slack) + simd.splat(ROUNDINGS) * aside;
        let (mut size, mut corner_error) = (size, corner_error);
        if MERGED {
            size = size + (reach + reach);
            corner_error = corner_error + simd.splat(START) * reach;
        }
        let size = size + (corner_error + corner_error);
        let through_corners = (simd.splat(2.00001) + simd.splat(2.00001) * width) * corner_error;
        let relative = through_corners + simd.splat(if MERGED { 2.0 * PRODUCTS } else { PRODUCTS }) * size;
        let error = relative * size + simd.splat(f32::MIN_POSITIVE);
        error.store(&mut self.error[0]);
        (zero - error).store(&mut self.error[1]);
        let parted = each_of!([0, 1, 2], e => {
            let (p, q) = (&corner[e], &corner[(e + 1) % 3]);
            let c1 = p[1] * q[2] - p[2] * q[1];
            let c2 = p[2] * q[0] - p[0] * q[2];
            let c0 = p[0] * q[1] - p[1] * q[0];
            let to = &mut self.coefficients[e];
            c1.store(&mut to[0]);
            c2.store(&mut to[1]);
            c0.store(&mut to[2]);
            let mut spread = (c1.abs() + c2.abs()) * width + error;
            if MERGED {
                let edge = each_of!([0, 1, 2], n => q[n] - p[n]);
                for (edge, to) in edge.iter().zip(&mut self.edges[e]) {
                    edge.store(to);
                }
                let moved = edge[0].abs() + edge[1].abs() + edge[2].abs() * twice;
                spread = spread + moved * (reach * simd.splat(1.00001));
            }
            (spread.lt(c0), c0.lt(zero - spread))
        });
        // The whole pulse is left of one edge and right of another.
        let left = parted[0].0 | parted[1].0 | parted[2].0;
        let right = parted[0].1 | parted[1].1 | parted[2].1;
        // Or it is left, or right, of all three.
        let all_left = parted[0].0 & parted[1].0 & parted[2].0;
        let all_right = parted[0].1 & parted[1].1 & parted[2].1;
        [!(left & right).bits() & 0xffff, (all_left | all_right).bits()]
    }

    /// Of sixteen rays of the pulse of pair `n`: those surely inside, and those not surely outside. `offsets`
    /// count for merged pulses only.
    #[inline(always)]
    pub fn inside<S: Simd, const MERGED: bool>(
        &self,
        simd: S,
        n: usize,
        deviations: &Deviations,
        offsets: Option<&OriginOffsets>,
    ) -> (u32, u32) {
        let (di, dj) = (simd.load(&deviations[0]), simd.load(&deviations[1]));
        let (error, negated) = (simd.splat(self.error[0][n]), simd.splat(self.error[1][n]));
        let [a, b, c] = each_of!([0, 1, 2], e => {
            let [c1, c2, c0] = each_of!([0, 1, 2], m => simd.splat(self.coefficients[e][m][n]));
            let of_first = c1 * di + c2 * dj + c0;
            match offsets {
                Some(offsets) if MERGED => {
                    let [x, y, z] = each_of!([0, 1, 2], m => simd.splat(self.edges[e][m][n]));
                    let [ui, uj, turned] = each_of!([0, 1, 2], m => simd.load(&offsets[m]));
                    of_first + ((x * uj - y * ui) + z * turned)
                }
                _ => of_first,
            }
        });
        let least = a.min(b).min(c);
        let greatest = a.max(b).max(c);
        let strictly = error.lt(least) | greatest.lt(negated);
        let outside = least.lt(negated) & error.lt(greatest);
        (strictly.bits(), !outside.bits() & 0xffff)
    }
}
