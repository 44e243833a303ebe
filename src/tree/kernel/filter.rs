//! Boxes and blocks of triangles against a group's pulses; the reasoning is that of [`crate::tree::beam`].

use super::lanes::{BeamSide, Lanes, PerPulse, Side};
use crate::tree::beam::LOOSE;
use crate::tree::block::{Block, LANES};
use crate::tree::simd::{Simd, each_of};

/// Sixteen boxes against one beam from depth 0 to `limit`: a mask of lanes and the depths of entry.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
pub(super) unsafe fn boxes_in_beam<S: Simd>(
    beam: &[[BeamSide; 2]; 3],
    lower: &[[f32; LANES]; 3],
    upper: &[[f32; LANES]; 3],
    limit: f32,
) -> (u32, S::F) {
    // SAFETY: the caller vouches for the instruction set.
    unsafe {
        let (mut enter, mut leave) = (S::splat(0.0), S::splat(limit));
        for a in 0..3 {
            let [under, over] = &beam[a];
            let u = S::mul(S::sub(S::load(&upper[a]), S::splat(under.from)), S::splat(under.inverse));
            let o = S::mul(S::sub(S::load(&lower[a]), S::splat(over.from)), S::splat(over.inverse));
            if under.inverse > 0.0 {
                leave = S::min(u, leave)
            } else {
                enter = S::max(u, enter)
            }
            if over.inverse > 0.0 { enter = S::max(o, enter) } else { leave = S::min(o, leave) }
        }
        (S::bits(S::le(enter, S::mul(leave, S::splat(LOOSE)))), enter)
    }
}

/// One box against all pulses, each to its own limit.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
pub(super) unsafe fn box_in_lanes<S: Simd>(
    lanes: &Lanes<S>,
    lower: [f32; 3],
    upper: [f32; 3],
    limit: &PerPulse,
) -> u32 {
    // SAFETY: the caller vouches for the instruction set.
    unsafe {
        let (mut enter, mut leave) = (S::splat(0.0), S::load(&limit.0));
        for a in 0..3 {
            let [under, over] = &lanes.sides[a];
            let u = depth_of(under, upper[a]);
            leave = S::min_where(under.upper, leave, u);
            enter = S::max_where(under.lower, enter, u);
            let o = depth_of(over, lower[a]);
            leave = S::min_where(over.upper, leave, o);
            enter = S::max_where(over.lower, enter, o);
        }
        S::bits(S::le(enter, S::mul(leave, S::splat(LOOSE))))
    }
}

/// The depths `[lo, hi]` of each pulse cut by a plane: those at which it may be below the plane, and above it.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
pub(super) unsafe fn cut<S: Simd>(
    lanes: &Lanes<S>,
    axis: usize,
    plane: f32,
    [lo, hi]: [S::F; 2],
) -> [[S::F; 2]; 2] {
    // SAFETY: the caller vouches for the instruction set.
    unsafe {
        each_of!([0, 1], n => {
            let side = &lanes.sides[axis][n];
            let x = depth_of(side, plane);
            [S::max_where(side.lower, lo, x), S::min_where(side.upper, hi, x)]
        })
    }
}

/// The depths at which the pulses meet a plane.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
unsafe fn depth_of<S: Simd>(side: &Side<S>, plane: f32) -> S::F {
    // SAFETY: the caller vouches for the instruction set.
    unsafe { S::mul(S::sub(S::splat(plane), S::load(&side.from.0)), S::load(&side.inverse.0)) }
}

/// # Safety
/// As for [`Simd`].
#[inline(always)]
unsafe fn least<S: Simd>(v: [S::F; 3]) -> S::F {
    // SAFETY: the caller vouches for the instruction set.
    unsafe { S::min(S::min(v[0], v[1]), v[2]) }
}

/// # Safety
/// As for [`Simd`].
#[inline(always)]
unsafe fn greatest<S: Simd>(v: [S::F; 3]) -> S::F {
    // SAFETY: the caller vouches for the instruction set.
    unsafe { S::max(S::max(v[0], v[1]), v[2]) }
}

/// Triangles of a block as seen from the group's apex.
pub(super) struct Seen<S: Simd> {
    /// Slopes `[side axis][low, high]`, widened.
    slope: [[S::F; 2]; 2],
    /// The middle of the reciprocals of their depths.
    inverse: S::F,
    /// Least depth, widened.
    near: S::F,
    /// Greatest depth, widened.
    far: S::F,
    /// Triangles beside or behind the apex, whose slopes mean nothing.
    beside: S::M,
}

impl<S: Simd> Seen<S> {
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn from(lanes: &Lanes<S>, block: &Block, still: bool) -> Seen<S> {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let [k, i, j] = lanes.axes;
            let r = [S::splat(lanes.apex[k]), S::splat(lanes.apex[i]), S::splat(lanes.apex[j])];
            let c = &block.corner;
            let (sign, one) = (S::splat(lanes.forward), S::splat(1.0));
            let s = each_of!([0, 1, 2], v => S::mul(S::sub(S::load(&c[v][k]), r[0]), sign));
            let inv = each_of!([0, 1, 2], v => S::div(one, s[v]));
            let x = each_of!([0, 1, 2], v => S::mul(S::sub(S::load(&c[v][i]), r[1]), inv[v]));
            let y = each_of!([0, 1, 2], v => S::mul(S::sub(S::load(&c[v][j]), r[2]), inv[v]));
            let (near, far, four) = (least::<S>(s), greatest::<S>(s), S::splat(4.0 * lanes.slack));
            // Wherever slopes count all depths are positive, and the nearest corner has the greatest reciprocal.
            let (inverse_near, inverse_far) = (greatest::<S>(inv), least::<S>(inv));
            // What is left of the pulses' offsets: all, or how much it changes from the nearest corner to the farthest.
            let half = S::splat(0.5);
            let (offset, changes) =
                (S::splat(lanes.most_offset), S::mul(S::sub(inverse_near, inverse_far), half));
            let rounding = S::splat(4.0 * lanes.slack + 1e-6 * lanes.most_offset);
            let shift = S::mul(offset, if still { inverse_near } else { changes });
            let pad = S::add(S::add(S::mul(rounding, inverse_near), shift), S::splat(1e-6));
            Seen {
                slope: [
                    [S::sub(least::<S>(x), pad), S::add(greatest::<S>(x), pad)],
                    [S::sub(least::<S>(y), pad), S::add(greatest::<S>(y), pad)],
                ],
                inverse: S::mul(S::add(inverse_near, inverse_far), half),
                near: S::sub(S::mul(near, S::splat(2.0 - LOOSE)), four),
                far: S::add(S::mul(far, S::splat(LOOSE)), four),
                beside: S::le(near, S::splat(lanes.near)),
            }
        }
    }

    /// The least and the greatest depths of the triangles, both on the safe side.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn depths(&self, near: &mut [f32; LANES], far: &mut [f32; LANES]) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            S::store(near, self.near);
            S::store(far, self.far);
        }
    }

    /// The triangles that a ray of pulse `p` might hit at depths within `[lo, hi]`. If `still`, the pulses' offsets are
    /// in the slopes already.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn by(&self, lanes: &Lanes<S>, p: usize, [lo, hi]: [f32; 2], still: bool) -> u32 {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let overlap = S::and(S::le(self.near, S::splat(hi)), S::le(S::splat(lo), self.far));
            let ends = each_of!([0, 1], side => each_of!([0, 1], end => {
                let slope = S::splat(lanes.slope[side][end].0[p]);
                if still {
                    slope
                } else {
                    S::add(slope, S::mul(S::splat(lanes.offset[side][end].0[p]), self.inverse))
                }
            }));
            let x = S::and(S::le(self.slope[0][0], ends[0][1]), S::le(ends[0][0], self.slope[0][1]));
            let y = S::and(S::le(self.slope[1][0], ends[1][1]), S::le(ends[1][0], self.slope[1][1]));
            S::bits(S::and(overlap, S::or(S::and(x, y), self.beside)))
        }
    }
}
