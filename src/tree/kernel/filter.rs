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
    /// Reciprocals of the least and the greatest depth.
    inverse: [[f32; LANES]; 2],
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
    pub unsafe fn from(lanes: &Lanes<S>, block: &Block) -> Seen<S> {
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
            let pad = S::add(S::mul(four, inverse_near), S::splat(1e-6));
            let mut inverse = [[0.0; LANES]; 2];
            S::store(&mut inverse[0], inverse_near);
            S::store(&mut inverse[1], inverse_far);
            Seen {
                slope: [
                    [S::sub(least::<S>(x), pad), S::add(greatest::<S>(x), pad)],
                    [S::sub(least::<S>(y), pad), S::add(greatest::<S>(y), pad)],
                ],
                inverse,
                near: S::sub(S::mul(near, S::splat(2.0 - LOOSE)), four),
                far: S::add(S::mul(far, S::splat(LOOSE)), four),
                beside: S::le(near, S::splat(lanes.near)),
            }
        }
    }

    /// The triangles that a ray of pulse `p` might hit at depths within `[lo, hi]`.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn by(&self, lanes: &Lanes<S>, p: usize, [lo, hi]: [f32; 2]) -> u32 {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let mut overlap = S::le(self.near, S::splat(hi));
            overlap = S::and(overlap, S::le(S::splat(lo), self.far));
            let mut inside = overlap;
            for side in 0..2 {
                let ends = each_of!([0, 1], end => {
                    let offset = lanes.offset[side][end].0[p];
                    // Seen from the apex, a pulse that starts aside has its offset shrink with depth.
                    let at = usize::from((offset < 0.0) != (end == 0));
                    let aside = S::mul(S::splat(offset), S::load(&self.inverse[at]));
                    S::add(S::splat(lanes.slope[side][end].0[p]), aside)
                });
                inside = S::and(inside, S::le(self.slope[side][0], ends[1]));
                inside = S::and(inside, S::le(ends[0], self.slope[side][1]));
            }
            S::bits(S::or(inside, S::and(overlap, self.beside)))
        }
    }
}
