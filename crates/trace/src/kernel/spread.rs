//! The spread of a packet's rays: their origins, and the differences of their directions.

#![expect(clippy::needless_range_loop, reason = "lanes of several arrays are counted together")]

use super::lanes::{PACKET_SIZE, PerPulse, raised};
use crate::frame::{Frame, above};
use crate::frustum::{MAX_ORIGIN, MIN_SLOPE};
use crate::intersect::MIN_DIRECTION;
use crate::rays::RayGroup;
use crate::simd::{F32Ops, Simd, each_of};
use std::ops::Range;
use vlscan_geom::DVec3;

/// Bound of the rounding error of slopes, which are below one.
const SLOPE_SLACK: f32 = 1e-6;

/// The origins of a packet's pulses, in the tree's frame.
pub(super) struct Origins {
    pub apex: [f32; 3],
    /// Sum of all errors that do not scale with depth.
    pub slack: f32,
    /// Depth up to which slopes relative to the apex are meaningless.
    pub slopes_from: f32,
    /// Sideways from the apex.
    pub offset: [PerPulse; 2],
    /// Forward from the apex.
    pub depth: PerPulse,
    /// Forward from the apex, for the foremost ray of a merged pulse.
    pub foremost: PerPulse,
    /// Maximum distance between the origins of a merged pulse's rays and the first.
    pub spread: f64,
}

impl Origins {
    /// Computes the origins of some pulses that run `forward` along the first of `axes`; `None` if one is out
    /// of range of single precision. `error` is the maximum error of the origins.
    #[inline(always)]
    pub fn of(
        frame: &Frame,
        rays: &RayGroup,
        pulses: Range<usize>,
        axes: [usize; 3],
        forward: f64,
        error: f64,
    ) -> Option<Origins> {
        let mut origins = OriginLanes([[0.0; PACKET_SIZE]; 3]);
        for l in 0..PACKET_SIZE {
            let pulse = if l < pulses.len() { pulses.start + l } else { pulses.start };
            origins.set(l, frame.local(rays.origin(pulse)));
        }
        let merged = rays.is_merged().then(|| MergedOrigins::of(frame, rays, pulses, axes[0], forward));
        Origins::of_lanes(&origins, merged, axes, forward, error)
    }

    /// [`Origins::of`] from the origins of all lanes in the tree's frame.
    #[inline(always)]
    pub fn of_lanes(
        OriginLanes(origins): &OriginLanes,
        merged: Option<MergedOrigins>,
        [k, i, j]: [usize; 3],
        forward: f64,
        error: f64,
    ) -> Option<Origins> {
        let mut rearmost = f64::INFINITY;
        let mut reach = 0.0;
        for l in 0..PACKET_SIZE {
            rearmost = lesser(origins[k][l] * forward, rearmost);
            for axis in origins {
                reach = larger(axis[l].abs(), reach);
            }
        }
        let merged = merged.unwrap_or(MergedOrigins::NONE);
        let (rearmost, reach) = (rearmost.min(merged.rearmost), reach.max(merged.reach));
        let mut apex = [origins[0][0] as f32, origins[1][0] as f32, origins[2][0] as f32];
        apex[k] = ((rearmost as f32).next_down() * forward as f32).clamp(f32::MIN, f32::MAX);
        let (mut offset, mut depth, mut foremost) = ([PerPulse::ZERO; 2], PerPulse::ZERO, PerPulse::ZERO);
        let mut spread = 0.0;
        let [from_k, from_i, from_j] = [k, i, j].map(|a| f64::from(apex[a]));
        for l in 0..PACKET_SIZE {
            let from = [origins[k][l] - from_k, origins[i][l] - from_i, origins[j][l] - from_j];
            depth.0[l] = (from[0] * forward) as f32;
            foremost.0[l] = raised((from[0] * forward + merged.forward[l]) as f32);
            offset[0].0[l] = from[1] as f32;
            offset[1].0[l] = from[2] as f32;
            spread = larger(larger(from[0].abs(), larger(from[1].abs(), from[2].abs())), spread);
        }
        // Rays start within the merged spread of the first, and at up to twice that sideways when
        // extrapolated to its depth.
        spread += 2.0 * merged.spread;
        let slack = above(2.0 * Frame::ROUNDING + 1e-14 * (1.0 + reach) + 5e-7 * spread + error);
        // At depths less than the offsets, an error of the depth is amplified in offset / depth.
        let slopes_from = 16.0 * slack + above(spread);
        let spread = merged.spread;
        (reach < MAX_ORIGIN).then_some(Origins { apex, slack, slopes_from, offset, depth, foremost, spread })
    }
}

/// Minimum of both; `b` when `a` is NaN.
#[inline(always)]
fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Maximum of both; `b` when `a` is NaN.
#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The origins of sixteen pulses by axis.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct OriginLanes(pub [[f64; PACKET_SIZE]; 3]);

impl OriginLanes {
    #[inline(always)]
    pub fn get(&self, lane: usize) -> DVec3 {
        DVec3::from(self.0.map(|axis| axis[lane]))
    }

    #[inline(always)]
    pub fn set(&mut self, lane: usize, origin: DVec3) {
        for (axis, x) in self.0.iter_mut().zip(origin.to_array()) {
            axis[lane] = x;
        }
    }
}

/// The origins of merged pulses' rays relative to the first of each pulse, in the tree's frame.
pub(super) struct MergedOrigins {
    /// Minimum depth of all rays.
    rearmost: f64,
    /// Maximum coordinate of all rays.
    reach: f64,
    /// Maximum distance along any axis from the first ray of the merged pulse.
    spread: f64,
    /// Distance by which the foremost ray of each merged pulse is ahead of its first.
    forward: [f64; PACKET_SIZE],
}

impl MergedOrigins {
    const NONE: MergedOrigins =
        MergedOrigins { rearmost: f64::INFINITY, reach: 0.0, spread: 0.0, forward: [0.0; PACKET_SIZE] };

    fn of(frame: &Frame, rays: &RayGroup, pulses: Range<usize>, k: usize, forward: f64) -> MergedOrigins {
        let mut all = MergedOrigins::NONE;
        for (l, p) in pulses.enumerate() {
            let first = frame.local(rays.origin(p));
            for r in 0..rays.rays() {
                let o = frame.local(rays.origin_of(p, r));
                all.rearmost = all.rearmost.min(o[k] * forward);
                all.reach = all.reach.max(o.abs().max_element());
                all.spread = all.spread.max((o - first).abs().max_element());
                all.forward[l] = all.forward[l].max((o[k] - first[k]) * forward);
            }
        }
        all
    }
}

/// Origins of a merged pulse's rays, relative to the first and extrapolated to its depth: `u_i` and `u_j` in
/// the tree's frame, and their product `u_i·δ_j − u_j·δ_i` with the deviations; sixteen rays at a time.
pub(crate) type OriginOffsets = [[f32; 16]; 3];

/// Slopes of a pulse's rays, `d_i/d_k` and `d_j/d_k`, minus those of its first ray; sixteen rays at a time.
pub(crate) type Deviations = [[f32; 16]; 2];

/// Spread of the directions of each pulse around its first. `[low, high]` are minimum and maximum.
pub(super) struct Spread {
    /// Slopes of the first ray, not turned forward.
    pub first: [[f64; PACKET_SIZE]; 2],
    /// Deviations from it, `[side axis][low, high]`.
    pub deviation: [[PerPulse; 2]; 2],
    /// Sign of d_k.
    pub forward: f32,
    /// `|d_k|`, `[low, high]`.
    pub along: [PerPulse; 2],
    /// Origins of merged pulses' rays relative to the first, `[side axis][low, high]`, in the tree's frame.
    pub start: [[PerPulse; 2]; 2],
}

impl Spread {
    /// Computes the spread. Writes the deviations of all rays to `deviations`, in a fixed number of registers
    /// per pulse, and the origins of merged pulses' rays to `offsets`.
    #[inline(always)]
    pub fn of<S: Simd>(
        simd: S,
        scale: f64,
        rays: &RayGroup,
        pulses: Range<usize>,
        axes: [usize; 3],
        forward: f64,
        (deviations, offsets): (&mut [Deviations], &mut [OriginOffsets]),
    ) -> Spread {
        let [along, i, j] = axes.map(|a| rays.lanes(a));
        let registers = rays.stride() / RayGroup::WIDTH;
        let wide = registers.div_ceil(2);
        let mut rows = [[[0.0f32; 16]; PACKET_SIZE]; 3];
        let mut first = [[0.0; PACKET_SIZE]; 2];
        let (zero, one, sign) = (simd.splat(0.0), simd.splat(1.0), simd.splat(forward as f32));
        for l in 0..pulses.len() {
            let row = (pulses.start + l) * registers;
            let reciprocal = 1.0 / along[row][0];
            // In single precision, so that both precisions use identical slopes.
            let (mi, mj) = (i[row][0] * reciprocal, j[row][0] * reciprocal);
            let (mi, mj) = (f64::from(mi as f32), f64::from(mj as f32));
            (first[0][l], first[1][l]) = (mi, mj);
            let (mi, mj) = (simd.splat_f64(mi), simd.splat_f64(mj));
            let mut least = [simd.splat(f32::INFINITY); 3];
            let mut greatest = [simd.splat(f32::NEG_INFINITY); 3];
            for r in 0..wide {
                // An odd last register is taken twice.
                let (low, high) = (row + 2 * r, row + (2 * r + 1).min(registers - 1));
                let [low, high] = each_of!([0, 1], n => {
                    let at = [low, high][n];
                    let dk = simd.load_f64(&along[at]);
                    [simd.load_f64(&i[at]) - mi * dk, simd.load_f64(&j[at]) - mj * dk, dk]
                });
                let [wi, wj, dk] = each_of!([0, 1, 2], n => simd.narrow(low[n], high[n]));
                let reciprocal = one / dk;
                let w = [wi * reciprocal, wj * reciprocal, dk * sign];
                let to = &mut deviations[l * wide + r];
                w[0].store(&mut to[0]);
                w[1].store(&mut to[1]);
                // A NaN ray is dropped here; the exact test reports a miss for it.
                least = each_of!([0, 1, 2], n => w[n].min(least[n]));
                greatest = each_of!([0, 1, 2], n => w[n].max(greatest[n]));
            }
            for n in 0..3 {
                least[n].fold_minima(zero - greatest[n]).store(&mut rows[n][l]);
            }
        }
        let mut ends = [[PerPulse::ZERO; 2]; 3];
        store_ends(simd, &rows, &mut ends);
        let mut start = [[PerPulse::ZERO; 2]; 2];
        if rays.is_merged() {
            set_offsets(simd, scale, rays, pulses.clone(), axes, (deviations, offsets), &mut start);
        }
        for end in ends.iter_mut().chain(&mut start).flatten() {
            end.repeat_first(pulses.len());
        }
        for l in pulses.len()..PACKET_SIZE {
            for m in &mut first {
                m[l] = m[0];
            }
        }
        let [wi, wj, along] = ends;
        Spread { first, deviation: [wi, wj], forward: forward as f32, along, start }
    }

    /// Returns the intervals of slopes, `[side axis][low, high]`; `None` unless every ray runs forward, well
    /// within the cone of its axis.
    #[inline(always)]
    pub fn slopes(&self) -> Option<[[PerPulse; 2]; 2]> {
        let mut slope = [[PerPulse::ZERO; 2]; 2];
        let mut sound = true;
        for side in 0..2 {
            for l in 0..PACKET_SIZE {
                let (w0, w1) = (self.deviation[side][0].0[l], self.deviation[side][1].0[l]);
                let first = self.first[side][l] as f32;
                let (w0, w1) = ((first + w0) * self.forward, (first + w1) * self.forward);
                let (lo, hi) = (w0.min(w1) - SLOPE_SLACK, w0.max(w1) + SLOPE_SLACK);
                sound &= lo > -1.0 + SLOPE_SLACK && hi < 1.0 - SLOPE_SLACK && lo <= hi;
                slope[side][0].0[l] = if lo.abs() < MIN_SLOPE { -MIN_SLOPE } else { lo };
                slope[side][1].0[l] = if hi.abs() < MIN_SLOPE { MIN_SLOPE } else { hi };
            }
        }
        for l in 0..PACKET_SIZE {
            sound &= self.along[0].0[l] > MIN_PACKET_DIRECTION && self.along[1].0[l] < f32::MAX;
        }
        sound.then_some(slope)
    }
}

/// Stores minimum and maximum of each pulse from the results of [`F32Ops::fold_minima`]: minima of numbers,
/// then of their negatives.
#[inline(always)]
fn store_ends<S: Simd>(simd: S, rows: &[[[f32; 16]; PACKET_SIZE]], ends: &mut [[PerPulse; 2]]) {
    for (rows, [least, greatest]) in rows.iter().zip(ends) {
        let [low, negated] = simd.row_minima(rows);
        low.store(&mut least.0);
        (simd.splat(0.0) - negated).store(&mut greatest.0);
    }
}

/// Writes the origins of merged pulses' rays to `offsets`, and their minimum and maximum to `start`.
#[inline(always)]
fn set_offsets<S: Simd>(
    simd: S,
    scale: f64,
    rays: &RayGroup,
    pulses: Range<usize>,
    axes: [usize; 3],
    (deviations, offsets): (&[Deviations], &mut [OriginOffsets]),
    start: &mut [[PerPulse; 2]; 2],
) {
    let directions = axes.map(|a| rays.lanes(a));
    let origins = axes.map(|a| rays.origin_lanes(a));
    let registers = rays.stride() / RayGroup::WIDTH;
    let wide = registers.div_ceil(2);
    let mut rows = [[[0.0f32; 16]; PACKET_SIZE]; 2];
    let scale = simd.splat_f64(scale);
    for (l, pulse) in pulses.enumerate() {
        let first = axes.map(|a| rays.origin(pulse)[a]);
        let first = each_of!([0, 1, 2], n => simd.splat_f64(first[n]));
        let mut least = [simd.splat(f32::INFINITY); 2];
        let mut greatest = [simd.splat(f32::NEG_INFINITY); 2];
        for r in 0..wide {
            let [low, high] = each_of!([0, 1], half => {
                let at = pulse * registers + (2 * r + half).min(registers - 1);
                let [vk, vi, vj] =
                    each_of!([0, 1, 2], n => (simd.load_f64(&origins[n][at]) - first[n]) * scale);
                let [dk, di, dj] = each_of!([0, 1, 2], n => simd.load_f64(&directions[n][at]));
                let back = vk / dk;
                [vi - di * back, vj - dj * back]
            });
            let u = each_of!([0, 1], n => simd.narrow(low[n], high[n]));
            let [di, dj] = each_of!([0, 1], n => simd.load(&deviations[l * wide + r][n]));
            let to = &mut offsets[l * wide + r];
            u[0].store(&mut to[0]);
            u[1].store(&mut to[1]);
            (u[0] * dj - u[1] * di).store(&mut to[2]);
            least = each_of!([0, 1], n => u[n].min(least[n]));
            greatest = each_of!([0, 1], n => u[n].max(greatest[n]));
        }
        for n in 0..2 {
            least[n].fold_minima(simd.splat(0.0) - greatest[n]).store(&mut rows[n][l]);
        }
    }
    store_ends(simd, &rows, start);
}

/// Minimum component along the dominant axis; pulses with a smaller one are traced ray by ray.
const MIN_PACKET_DIRECTION: f32 = 1e-18;
const _: () = assert!(MIN_DIRECTION < MIN_PACKET_DIRECTION as f64);
