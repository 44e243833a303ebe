//! The filter of single pulses: rays with one origin as a frustum, with intervals of slopes in single
//! precision.
//!
//! Every ray of a frustum runs forward along one dominant axis `k`. With the depth `s = ±(p_k − R_k)`
//! relative to the frustum's apex `R`, a ray is at `R_a + m_a·s` on axis `a`, where its slope
//! `m_a = d_a/|d_k|` lies in an interval (for `k` itself the slope is the sign). So "below plane p" is a
//! bound on `s`, upper or lower by the slope's sign, and no divisor crosses zero.
//!
//! Bounds are products of a difference and a reciprocal, with relative errors of a few units in the last
//! place, which [`DEPTH_MARGIN`] covers. Errors that do not scale with `s` (rounded vertices and planes, the
//! rounded apex) are collected in `slack`, by which the apex is widened. A frustum therefore accepts
//! everything that the exact test can accept.

#![expect(clippy::needless_range_loop, reason = "lanes of several arrays are counted together")]

use super::block::{BLOCK_SIZE, Block};
use super::frame::{Frame, above, below};
use super::intersect::{MIN_DIRECTION, axes_by_dominance};
use super::simd::{F32Ops, MaskOps, Simd};
use vlscan_geom::DVec3;

/// Factor that covers the relative error of both sides of a comparison of depths.
pub(crate) const DEPTH_MARGIN: f32 = 1.000_000_6;

/// Minimum magnitude of slopes; those nearer to zero are widened to it, so that reciprocals are finite.
pub(crate) const MIN_SLOPE: f32 = 1e-18;

/// Maximum distance of an origin, in scene radii, for filtering in single precision.
pub(crate) const MAX_ORIGIN: f64 = 1e12;

/// A frustum around rays with one origin. Arrays are indexed by axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frustum {
    /// Dominant axis, then the other two.
    axes: [usize; 3],
    /// Sign of the directions on the dominant axis.
    forward: f32,
    /// Rounded origin, tree's frame.
    apex: [f32; 3],
    /// Sum of all errors that do not scale with depth, tree's frame.
    slack: f32,
    slope: [[f32; 2]; 3],
    inverse: [[f32; 2]; 3],
    /// Origin minus and plus the slack.
    from: [[f32; 2]; 3],
    /// Maximum depth that a ray gains per unit of t, in the tree's frame.
    pub depth_per_t: f64,
}

impl Frustum {
    /// Returns the frustum of `directions` from `origin`; `None` when they do not share dominant axis and
    /// sign, when one of them is not a valid direction, or when the origin is out of range.
    pub fn around(
        frame: &Frame,
        origin: DVec3,
        directions: impl Iterator<Item = DVec3> + Clone,
    ) -> Option<Frustum> {
        let first = directions.clone().next()?;
        let axes = axes_by_dominance(first);
        let [k, i, j] = axes;
        let forward = if first[k] < 0.0 { -1.0 } else { 1.0 };
        let (mut range, mut depth_per_t) = ([[f64::INFINITY, f64::NEG_INFINITY]; 2], 0.0f64);
        for d in directions {
            let depth = d[k] * forward;
            let is_alike = axes_by_dominance(d) == axes && depth >= MIN_DIRECTION && depth.is_finite();
            if !is_alike {
                return None;
            }
            for (r, a) in range.iter_mut().zip([i, j]) {
                let m = d[a] / depth;
                *r = [r[0].min(m), r[1].max(m)];
            }
            depth_per_t = depth_per_t.max(depth);
        }
        let local = frame.local(origin);
        let reach = local.abs().max_element();
        if !(reach < MAX_ORIGIN && range.iter().flatten().all(|m| m.is_finite())) {
            return None;
        }
        let mut slope = [[forward as f32; 2]; 3];
        for (r, a) in range.into_iter().zip([i, j]) {
            let (lo, hi) = (below(r[0]), above(r[1]));
            slope[a] = [
                if lo.abs() < MIN_SLOPE { -MIN_SLOPE } else { lo },
                if hi.abs() < MIN_SLOPE { MIN_SLOPE } else { hi },
            ];
        }
        let apex = local.to_array().map(|x| x as f32);
        let rounding = (0..3).fold(0.0, |m: f64, a| m.max((f64::from(apex[a]) - local[a]).abs()));
        let slack = above(rounding + 2.0 * Frame::ROUNDING + 1e-14 * (1.0 + reach));
        Some(Frustum {
            axes,
            forward: forward as f32,
            apex,
            slack,
            slope,
            inverse: slope.map(|s| s.map(f32::recip)),
            from: apex.map(|r| [(r - slack).next_down(), (r + slack).next_up()]),
            depth_per_t: depth_per_t * frame.scale,
        })
    }

    /// Returns the frustum with its slack increased, in units of the frame.
    pub fn widened(self, by: f64) -> Frustum {
        let slack = above(f64::from(self.slack) + by);
        Frustum { slack, from: self.apex.map(|r| [(r - slack).next_down(), (r + slack).next_up()]), ..self }
    }

    /// Returns the depth beyond which nothing can be nearer than `t`.
    #[inline(always)]
    pub fn limit(&self, t: f64) -> f32 {
        (t * self.depth_per_t * 1.000_000_2) as f32
    }

    /// Returns the depths at which the frustum may be at or below plane `p` of `axis`, and at or above it,
    /// both within `[lo, hi]`.
    #[inline(always)]
    pub fn cut(&self, axis: usize, p: f32, [lo, hi]: [f32; 2]) -> [[f32; 2]; 2] {
        let under = (p - self.from[axis][0]) * self.inverse[axis][0];
        let over = (p - self.from[axis][1]) * self.inverse[axis][1];
        let lower = if self.inverse[axis][0] > 0.0 { [lo, hi.min(under)] } else { [lo.max(under), hi] };
        let upper = if self.inverse[axis][1] > 0.0 { [lo.max(over), hi] } else { [lo, hi.min(over)] };
        [lower, upper]
    }

    /// True if the rays reach the lower side of planes across `axis` first.
    #[inline(always)]
    pub fn is_ascending(&self, axis: usize) -> bool {
        self.slope[axis][0] + self.slope[axis][1] >= 0.0
    }

    /// Returns the range of depths at which the frustum may be within a box.
    pub fn depths_within(&self, lo: &[f32; 3], hi: &[f32; 3]) -> [f32; 2] {
        (0..3).fold([0.0, f32::INFINITY], |range, a| {
            let [range, _] = self.cut(a, hi[a], range);
            self.cut(a, lo[a], range)[1]
        })
    }

    /// Returns the primitives of a block that a ray of the frustum might hit at depths within `range`, as a
    /// mask of lanes.
    #[inline(always)]
    pub fn candidates(&self, block: &Block, range: [f32; 2]) -> u32 {
        if block.holds_cubes() {
            self.boxes(&block.corner[0], &block.corner[1], range[1]).0
        } else {
            self.triangles(block, range)
        }
    }

    /// Returns the triangles of a block that a ray of the frustum might hit at depths within `[lo, hi]`, as a
    /// mask of lanes.
    #[inline(always)]
    fn triangles(&self, block: &Block, [lo, hi]: [f32; 2]) -> u32 {
        let [k, i, j] = self.axes;
        let c = &block.corner;
        let (r, sg, slack) = (self.apex, self.forward, self.slack);
        let [[i0, i1], [j0, j1]] = [self.slope[i], self.slope[j]];
        let (hi, lo) = (hi * DEPTH_MARGIN + 4.0 * slack, lo * (2.0 - DEPTH_MARGIN) - 4.0 * slack);
        let mut mask = 0;
        for l in 0..BLOCK_SIZE {
            let s = [0, 1, 2].map(|v| (c[v][k][l] - r[k]) * sg);
            let near = min3(s);
            let far = max3(s);
            let inverse = s.map(|s| 1.0 / s);
            let x = [0, 1, 2].map(|v| (c[v][i][l] - r[i]) * inverse[v]);
            let y = [0, 1, 2].map(|v| (c[v][j][l] - r[j]) * inverse[v]);
            // The error of corners is up to the slack sideways and in depth; slopes beyond ±2 are outside the
            // frustum in any case.
            let pad = 4.0 * slack / near + 1e-6;
            let overlaps =
                (min3(x) - pad <= i1) & (max3(x) + pad >= i0) & (min3(y) - pad <= j1) & (max3(y) + pad >= j0);
            // Slopes of corners are meaningless next to or behind the apex.
            let is_near = near < 16.0 * slack;
            mask |= u32::from((overlaps | is_near) & (near <= hi) & (far >= lo)) << l;
        }
        mask
    }

    /// Returns the boxes that a ray of the frustum might hit at depths up to `hi`: a mask of lanes and the
    /// depths of entry.
    #[inline(always)]
    pub fn boxes(
        &self,
        lower: &[[f32; BLOCK_SIZE]; 3],
        upper: &[[f32; BLOCK_SIZE]; 3],
        hi: f32,
    ) -> (u32, [f32; BLOCK_SIZE]) {
        let (mut enter, mut leave) = ([0.0f32; BLOCK_SIZE], [hi; BLOCK_SIZE]);
        for a in 0..3 {
            let ([f0, f1], [v0, v1]) = (self.from[a], self.inverse[a]);
            for l in 0..BLOCK_SIZE {
                let (under, over) = ((upper[a][l] - f0) * v0, (lower[a][l] - f1) * v1);
                if v0 > 0.0 {
                    leave[l] = leave[l].min(under)
                } else {
                    enter[l] = enter[l].max(under)
                }
                if v1 > 0.0 { enter[l] = enter[l].max(over) } else { leave[l] = leave[l].min(over) }
            }
        }
        let mask = (0..BLOCK_SIZE).fold(0, |m, l| m | u32::from(enter[l] <= leave[l] * DEPTH_MARGIN) << l);
        (mask, enter)
    }
}

impl Frustum {
    /// [`Frustum::boxes`] on an instruction set.
    #[inline(always)]
    pub fn boxes_on<S: Simd>(
        &self,
        simd: S,
        lower: &[[f32; BLOCK_SIZE]; 3],
        upper: &[[f32; BLOCK_SIZE]; 3],
        hi: f32,
    ) -> (u32, [f32; BLOCK_SIZE]) {
        let (mut enter, mut leave) = (simd.splat(0.0), simd.splat(hi));
        for a in 0..3 {
            let ([f0, f1], [v0, v1]) = (self.from[a], self.inverse[a]);
            let under = (simd.load(&upper[a]) - simd.splat(f0)) * simd.splat(v0);
            let over = (simd.load(&lower[a]) - simd.splat(f1)) * simd.splat(v1);
            if v0 > 0.0 {
                leave = under.min(leave)
            } else {
                enter = under.max(enter)
            }
            if v1 > 0.0 { enter = over.max(enter) } else { leave = over.min(leave) }
        }
        let mut depths = [0.0; BLOCK_SIZE];
        enter.store(&mut depths);
        (enter.le(leave * simd.splat(DEPTH_MARGIN)).bits(), depths)
    }
}

#[inline(always)]
fn min3([a, b, c]: [f32; 3]) -> f32 {
    let ab = if a < b { a } else { b };
    if ab < c { ab } else { c }
}

#[inline(always)]
fn max3([a, b, c]: [f32; 3]) -> f32 {
    let ab = if a > b { a } else { b };
    if ab > c { ab } else { c }
}
