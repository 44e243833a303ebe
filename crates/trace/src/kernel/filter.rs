//! Filters of boxes and blocks of triangles against the pulses of a packet, with the reasoning of
//! [`crate::frustum`].

use super::lanes::PerPulse;
use super::packet::{PacketFrustum, PlaneDepth, PlaneDepths};
use crate::block::{BLOCK_SIZE, Block};
use crate::frustum::DEPTH_MARGIN;
use crate::simd::{F32Ops, MaskOps, Simd, each_of};

/// Tests sixteen boxes against one frustum from depth 0 to `limit`. Returns a mask of the boxes that it may
/// hit, and the depths of entry.
#[inline(always)]
pub(super) fn boxes_in_frustum<S: Simd>(
    simd: S,
    planes: &[[PlaneDepth; 2]; 3],
    lower: &[[f32; BLOCK_SIZE]; 3],
    upper: &[[f32; BLOCK_SIZE]; 3],
    limit: f32,
) -> (u32, S::F32x16) {
    let (mut enter, mut leave) = (simd.splat(0.0), simd.splat(limit));
    for a in 0..3 {
        let [above, below] = &planes[a];
        let u = (simd.load(&upper[a]) - simd.splat(above.from)) * simd.splat(above.inverse);
        let o = (simd.load(&lower[a]) - simd.splat(below.from)) * simd.splat(below.inverse);
        if above.inverse > 0.0 {
            leave = u.min(leave)
        } else {
            enter = u.max(enter)
        }
        if below.inverse > 0.0 { enter = o.max(enter) } else { leave = o.min(leave) }
    }
    (enter.le(leave * simd.splat(DEPTH_MARGIN)).bits(), enter)
}

/// Tests one box against all pulses, each up to its limit. Returns a mask of the pulses that may hit it.
#[inline(always)]
pub(super) fn box_in_pulses<S: Simd>(
    frustum: &PacketFrustum<S>,
    lower: [f32; 3],
    upper: [f32; 3],
    limit: &PerPulse,
) -> u32 {
    let simd = frustum.simd;
    let (mut enter, mut leave) = (simd.splat(0.0), simd.load(&limit.0));
    for a in 0..3 {
        let [above, below] = &frustum.planes[a];
        let u = depths_at(simd, above, upper[a]);
        leave = leave.min_where(above.is_upper, u);
        enter = enter.max_where(above.is_lower, u);
        let o = depths_at(simd, below, lower[a]);
        leave = leave.min_where(below.is_upper, o);
        enter = enter.max_where(below.is_lower, o);
    }
    enter.le(leave * simd.splat(DEPTH_MARGIN)).bits()
}

/// Divides the depths `[lo, hi]` of each pulse by a plane: the depths at which it may be below the plane, and
/// above it.
#[inline(always)]
pub(super) fn cut<S: Simd>(
    frustum: &PacketFrustum<S>,
    axis: usize,
    plane: f32,
    [lo, hi]: [S::F32x16; 2],
) -> [[S::F32x16; 2]; 2] {
    each_of!([0, 1], n => {
        let side = &frustum.planes[axis][n];
        let x = depths_at(frustum.simd, side, plane);
        [lo.max_where(side.is_lower, x), hi.min_where(side.is_upper, x)]
    })
}

#[inline(always)]
fn depths_at<S: Simd>(simd: S, side: &PlaneDepths<S>, plane: f32) -> S::F32x16 {
    (simd.splat(plane) - simd.load(&side.from.0)) * simd.load(&side.inverse.0)
}

#[inline(always)]
fn least<F: F32Ops>(v: [F; 3]) -> F {
    v[0].min(v[1]).min(v[2])
}

#[inline(always)]
fn greatest<F: F32Ops>(v: [F; 3]) -> F {
    v[0].max(v[1]).max(v[2])
}

/// The depths of the corners of a block's triangles.
#[inline(always)]
fn depths<S: Simd>(frustum: &PacketFrustum<S>, block: &Block) -> [S::F32x16; 3] {
    let simd = frustum.simd;
    let k = frustum.axes[0];
    let (apex, sign) = (simd.splat(frustum.apex[k]), simd.splat(frustum.forward));
    each_of!([0, 1, 2], v => (simd.load(&block.corner[v][k]) - apex) * sign)
}

/// Minimum and maximum depths of the triangles of a block, both rounded to the safe side.
pub(super) struct DepthRange<S: Simd> {
    pub near: S::F32x16,
    pub far: S::F32x16,
}

impl<S: Simd> DepthRange<S> {
    #[inline(always)]
    pub fn of(frustum: &PacketFrustum<S>, block: &Block) -> DepthRange<S> {
        DepthRange::around(frustum, depths(frustum, block))
    }

    #[inline(always)]
    fn around(frustum: &PacketFrustum<S>, depths: [S::F32x16; 3]) -> DepthRange<S> {
        let simd = frustum.simd;
        let four = simd.splat(4.0 * frustum.slack);
        DepthRange {
            near: least(depths) * simd.splat(2.0 - DEPTH_MARGIN) - four,
            far: greatest(depths) * simd.splat(DEPTH_MARGIN) + four,
        }
    }

    /// The triangles that reach into depths within `[lo, hi]`.
    #[inline(always)]
    pub fn overlaps(&self, simd: S, [lo, hi]: [f32; 2]) -> S::Mask16 {
        self.near.le(simd.splat(hi)) & simd.splat(lo).le(self.far)
    }
}

/// The triangles of a block relative to the packet's apex; a lane is a triangle.
pub(super) struct BlockSlopes<S: Simd> {
    /// Slopes `[side axis][low, high]`, widened.
    slope: [[S::F32x16; 2]; 2],
    /// The centre of the interval of reciprocals of the corners' depths.
    inverse: S::F32x16,
    pub range: DepthRange<S>,
    /// Triangles next to or behind the apex, whose slopes are meaningless.
    is_beside: S::Mask16,
    /// True if the slopes are widened by the offsets of all pulses, so that the offsets need no further test.
    cover_offsets: bool,
}

impl<S: Simd> BlockSlopes<S> {
    /// Computes the slopes of `block`; with `cover_offsets` they are widened by the offsets of all pulses
    /// from the apex.
    #[inline(always)]
    pub fn of(frustum: &PacketFrustum<S>, block: &Block, cover_offsets: bool) -> BlockSlopes<S> {
        let simd = frustum.simd;
        let [_, i, j] = frustum.axes;
        let r = [i, j].map(|a| simd.splat(frustum.apex[a]));
        let c = &block.corner;
        let (one, half) = (simd.splat(1.0), simd.splat(0.5));
        let s = depths(frustum, block);
        let inverse = each_of!([0, 1, 2], v => one / s[v]);
        let x = each_of!([0, 1, 2], v => (simd.load(&c[v][i]) - r[0]) * inverse[v]);
        let y = each_of!([0, 1, 2], v => (simd.load(&c[v][j]) - r[1]) * inverse[v]);
        let near = least(s);
        // Where slopes are used all depths are positive, and the nearest corner has the greatest reciprocal.
        let (inverse_near, inverse_far) = (greatest(inverse), least(inverse));
        // Remaining error from the pulses' offsets: all of it, or its change from the nearest corner to the
        // farthest.
        let (offset, changes) = (simd.splat(frustum.max_offset), (inverse_near - inverse_far) * half);
        let rounding = simd.splat(4.0 * frustum.slack + 1e-6 * frustum.max_offset);
        let shift = offset * if cover_offsets { inverse_near } else { changes };
        let pad = rounding * inverse_near + shift + simd.splat(1e-6);
        BlockSlopes {
            slope: [[least(x) - pad, greatest(x) + pad], [least(y) - pad, greatest(y) + pad]],
            inverse: (inverse_near + inverse_far) * half,
            range: DepthRange::around(frustum, s),
            is_beside: near.le(simd.splat(frustum.slopes_from)),
            cover_offsets,
        }
    }

    /// Returns the triangles that a ray of pulse `p` might hit at depths within `[lo, hi]`, as a mask.
    #[inline(always)]
    pub fn overlapping(&self, frustum: &PacketFrustum<S>, p: usize, [lo, hi]: [f32; 2]) -> u32 {
        let simd = frustum.simd;
        let overlap = self.range.overlaps(simd, [lo, hi]);
        let ends = each_of!([0, 1], side => each_of!([0, 1], end => {
            let slope = simd.splat(frustum.slope[side][end].0[p]);
            if self.cover_offsets {
                slope
            } else {
                slope + simd.splat(frustum.offset[side][end].0[p]) * self.inverse
            }
        }));
        let x = self.slope[0][0].le(ends[0][1]) & ends[0][0].le(self.slope[0][1]);
        let y = self.slope[1][0].le(ends[1][1]) & ends[1][0].le(self.slope[1][1]);
        (overlap & (x & y | self.is_beside)).bits()
    }
}
