//! How the rays of a group spread: where they start, and by how much their directions differ.

#![expect(clippy::needless_range_loop, reason = "lanes of several arrays are counted together")]

use super::lanes::{GROUP, PerPulse, raised};
use crate::geom::DVec3;
use crate::tree::beam::FLATTEST;
use crate::tree::frame::{Frame, above};
use crate::tree::intersect::SHORTEST;
use crate::tree::rays::RayGroup;
use crate::tree::simd::{Simd, each_of};
use std::ops::Range;

/// Covers the rounding of slopes, which are below one.
const SLOPE_SLACK: f32 = 1e-6;

/// Origins farther away than this (in scene radii) are not for single precision.
const FARTHEST: f64 = 1e12;

/// Where the pulses start.
pub(super) struct Start {
    pub apex: [f32; 3],
    pub slack: f32,
    pub near: f32,
    /// Sideways from the apex.
    pub offset: [PerPulse; 2],
    /// Forward from the apex.
    pub depth: PerPulse,
    /// The same of the foremost ray of a packet.
    pub foremost: PerPulse,
    /// How far rays of packets start from the first of each.
    pub spread: f64,
}

impl Start {
    #[inline(always)]
    pub fn of(
        frame: &Frame,
        rays: &RayGroup,
        pulses: Range<usize>,
        axes: [usize; 3],
        forward: f64,
        off: f64,
    ) -> Option<Start> {
        let mut origins = [DVec3::ZERO; GROUP];
        let origins = &mut origins[..pulses.len()];
        for (o, p) in origins.iter_mut().zip(pulses.clone()) {
            *o = frame.local(rays.origin(p));
        }
        let [k, i, j] = axes;
        let rearmost = origins.iter().fold(f64::INFINITY, |m, o| m.min(o[k] * forward));
        let mut packets = Packets { rearmost, ..Packets::NONE };
        if rays.is_packed() {
            packets.survey(frame, rays, pulses, k, forward);
        }
        let mut apex = origins[0].to_array().map(|x| x as f32);
        apex[k] = ((packets.rearmost as f32).next_down() * forward as f32).clamp(f32::MIN, f32::MAX);
        let (mut offset, mut depth) = ([PerPulse([0.0; GROUP]); 2], PerPulse([0.0; GROUP]));
        let mut foremost = PerPulse([0.0; GROUP]);
        let (mut reach, mut spread) = (packets.reach, 0.0f64);
        for (l, o) in origins.iter().enumerate() {
            let from = [o[k] - f64::from(apex[k]), o[i] - f64::from(apex[i]), o[j] - f64::from(apex[j])];
            depth.0[l] = (from[0] * forward) as f32;
            foremost.0[l] = raised((from[0] * forward + packets.forward[l]) as f32);
            offset[0].0[l] = from[1] as f32;
            offset[1].0[l] = from[2] as f32;
            reach = reach.max(o.abs().max_element());
            spread = spread.max(from.iter().fold(0.0, |m, x| m.max(x.abs())));
        }
        // Rays start within that of their packet's first, and twice that aside once they are followed to its depth.
        spread += 2.0 * packets.spread;
        depth.repeat_first(origins.len());
        foremost.repeat_first(origins.len());
        offset.iter_mut().for_each(|o| o.repeat_first(origins.len()));
        let sound = reach < FARTHEST;
        let slack = above(2.0 * Frame::ROUNDING + 1e-14 * (1.0 + reach) + 5e-7 * spread + off);
        // Nearer than the offsets, an error of the depth is multiplied in offset / depth.
        let near = 16.0 * slack + above(spread);
        sound.then_some(Start { apex, slack, near, offset, depth, foremost, spread: packets.spread })
    }
}

/// How far the rays of packets start from the first of each, in the tree's frame.
struct Packets {
    /// Least depth of all.
    rearmost: f64,
    /// Greatest coordinate of all.
    reach: f64,
    /// Greatest distance from the packet's first along any axis.
    spread: f64,
    /// How far each packet's foremost is before its first.
    forward: [f64; GROUP],
}

impl Packets {
    const NONE: Packets = Packets { rearmost: f64::INFINITY, reach: 0.0, spread: 0.0, forward: [0.0; GROUP] };

    fn survey(&mut self, frame: &Frame, rays: &RayGroup, pulses: Range<usize>, k: usize, forward: f64) {
        for (l, p) in pulses.enumerate() {
            let first = frame.local(rays.origin(p));
            for r in 0..rays.rays() {
                let o = frame.local(rays.origin_of(p, r));
                self.rearmost = self.rearmost.min(o[k] * forward);
                self.reach = self.reach.max(o.abs().max_element());
                self.spread = self.spread.max((o - first).abs().max_element());
                self.forward[l] = self.forward[l].max((o[k] - first[k]) * forward);
            }
        }
    }
}

/// Where the rays of a packet start, aside of the first and followed to its depth: `u_i` and `u_j` in the tree's frame, and
/// their product `u_i·δ_j − u_j·δ_i` with the deviations; sixteen rays at a time.
pub(crate) type Asides = [[f32; 16]; 3];

/// Slopes of a pulse's rays, `d_i/d_k` and `d_j/d_k`, less those of its first ray; sixteen rays at a time.
pub(crate) type Deviations = [[f32; 16]; 2];

/// How the directions of each pulse spread around its first.
pub(super) struct Spread {
    /// Slopes of the first ray, not turned forward.
    pub middle: [[f64; GROUP]; 2],
    /// Least and greatest deviation from it.
    pub aside: [[PerPulse; 2]; 2],
    /// Sign of d_k.
    pub forward: f32,
    /// Least and greatest `|d_k|`.
    pub depth: [PerPulse; 2],
    /// Where rays of a packet start, aside of the first: least and greatest, in the tree's frame.
    pub start: [[PerPulse; 2]; 2],
}

impl Spread {
    /// Writes the deviations of all rays to `deviations`, so many registers per pulse that all fit, and where the rays of
    /// packets start to `asides`.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn of<S: Simd>(
        scale: f64,
        rays: &RayGroup,
        pulses: Range<usize>,
        axes: [usize; 3],
        forward: f64,
        (deviations, asides): (&mut [Deviations], &mut [Asides]),
    ) -> Spread {
        let [along, i, j] = axes.map(|a| rays.lanes(a));
        let registers = rays.stride() / RayGroup::LANES;
        let wide = registers.div_ceil(2);
        let mut rows = [[[0.0f32; 16]; GROUP]; 3];
        let mut middle = [[0.0; GROUP]; 2];
        for l in 0..pulses.len() {
            let row = (pulses.start + l) * registers;
            let reciprocal = 1.0 / along[row][0];
            // In single precision, so that both precisions start from the same.
            let (mi, mj) = (i[row][0] * reciprocal, j[row][0] * reciprocal);
            let (mi, mj) = (f64::from(mi as f32), f64::from(mj as f32));
            (middle[0][l], middle[1][l]) = (mi, mj);
            // SAFETY: the caller vouches for the instruction set.
            unsafe {
                let (mi, mj) = (S::dsplat(mi), S::dsplat(mj));
                let (zero, one, sign) = (S::splat(0.0), S::splat(1.0), S::splat(forward as f32));
                let (mut least, mut greatest) =
                    ([S::splat(f32::INFINITY); 3], [S::splat(f32::NEG_INFINITY); 3]);
                for r in 0..wide {
                    // An odd last register is taken twice.
                    let (low, high) = (row + 2 * r, row + (2 * r + 1).min(registers - 1));
                    let [low, high] = each_of!([0, 1], n => {
                        let at = [low, high][n];
                        let dk = S::dload(&along[at]);
                        let wi = S::dsub(S::dload(&i[at]), S::dmul(mi, dk));
                        let wj = S::dsub(S::dload(&j[at]), S::dmul(mj, dk));
                        [wi, wj, dk]
                    });
                    let [wi, wj, dk] = each_of!([0, 1, 2], n => S::narrow(low[n], high[n]));
                    let reciprocal = S::div(one, dk);
                    let w = [S::mul(wi, reciprocal), S::mul(wj, reciprocal), S::mul(dk, sign)];
                    let to = &mut deviations[l * wide + r];
                    S::store(&mut to[0], w[0]);
                    S::store(&mut to[1], w[1]);
                    // A ray that is no number drops out here; its verdicts are misses.
                    least = each_of!([0, 1, 2], n => S::min(w[n], least[n]));
                    greatest = each_of!([0, 1, 2], n => S::max(w[n], greatest[n]));
                }
                for n in 0..3 {
                    S::store(&mut rows[n][l], S::fold_minima(least[n], S::sub(zero, greatest[n])));
                }
            }
        }
        let mut ends = [[PerPulse([0.0; GROUP]); 2]; 3];
        // SAFETY: as above.
        unsafe { ends_of_rows::<S>(&rows, &mut ends) };
        let mut start = [[PerPulse([0.0; GROUP]); 2]; 2];
        if rays.is_packed() {
            // SAFETY: as above.
            unsafe { set_aside::<S>(scale, rays, pulses.clone(), axes, (deviations, asides), &mut start) };
        }
        for end in ends.iter_mut().chain(&mut start).flatten() {
            end.repeat_first(pulses.len());
        }
        for l in pulses.len()..GROUP {
            for m in &mut middle {
                m[l] = m[0];
            }
        }
        let [wi, wj, depth] = ends;
        Spread { middle, aside: [wi, wj], forward: forward as f32, depth, start }
    }

    /// Intervals of slopes; `None` unless every ray runs forward, well within the cone of its axis.
    #[inline(always)]
    pub fn slopes(&self) -> Option<[[PerPulse; 2]; 2]> {
        let mut slope = [[PerPulse([0.0; GROUP]); 2]; 2];
        let mut sound = true;
        for side in 0..2 {
            for l in 0..GROUP {
                let (w0, w1) = (self.aside[side][0].0[l], self.aside[side][1].0[l]);
                let middle = self.middle[side][l] as f32;
                let (w0, w1) = ((middle + w0) * self.forward, (middle + w1) * self.forward);
                let (lo, hi) = (w0.min(w1) - SLOPE_SLACK, w0.max(w1) + SLOPE_SLACK);
                sound &= lo > -1.0 + SLOPE_SLACK && hi < 1.0 - SLOPE_SLACK && lo <= hi;
                slope[side][0].0[l] = if lo.abs() < FLATTEST { -FLATTEST } else { lo };
                slope[side][1].0[l] = if hi.abs() < FLATTEST { FLATTEST } else { hi };
            }
        }
        for l in 0..GROUP {
            sound &= self.depth[0].0[l] > SHORTEST_IN_LANES && self.depth[1].0[l] < f32::MAX;
        }
        sound.then_some(slope)
    }
}

/// Least and greatest of what [`Simd::fold_minima`] has left of each pulse.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
unsafe fn ends_of_rows<S: Simd>(rows: &[[[f32; 16]; GROUP]], ends: &mut [[PerPulse; 2]]) {
    for (rows, [least, greatest]) in rows.iter().zip(ends) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let [low, negated] = S::row_minima(rows);
            S::store(&mut least.0, low);
            S::store(&mut greatest.0, S::sub(S::splat(0.0), negated));
        }
    }
}

/// Writes where the rays of packets start, and the least and the greatest of that.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
unsafe fn set_aside<S: Simd>(
    scale: f64,
    rays: &RayGroup,
    pulses: Range<usize>,
    axes: [usize; 3],
    (deviations, asides): (&[Deviations], &mut [Asides]),
    start: &mut [[PerPulse; 2]; 2],
) {
    let directions = axes.map(|a| rays.lanes(a));
    let origins = axes.map(|a| rays.origin_lanes(a));
    let registers = rays.stride() / RayGroup::LANES;
    let wide = registers.div_ceil(2);
    let mut rows = [[[0.0f32; 16]; GROUP]; 2];
    for (l, pulse) in pulses.enumerate() {
        let first = axes.map(|a| rays.origin(pulse)[a]);
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let (first, scale) = (each_of!([0, 1, 2], n => S::dsplat(first[n])), S::dsplat(scale));
            let (mut least, mut greatest) = ([S::splat(f32::INFINITY); 2], [S::splat(f32::NEG_INFINITY); 2]);
            for r in 0..wide {
                let [low, high] = each_of!([0, 1], half => {
                    let at = pulse * registers + (2 * r + half).min(registers - 1);
                    let [vk, vi, vj] = each_of!([0, 1, 2], n => {
                        S::dmul(S::dsub(S::dload(&origins[n][at]), first[n]), scale)
                    });
                    let [dk, di, dj] = each_of!([0, 1, 2], n => S::dload(&directions[n][at]));
                    let back = S::ddiv(vk, dk);
                    [S::dsub(vi, S::dmul(di, back)), S::dsub(vj, S::dmul(dj, back))]
                });
                let u = each_of!([0, 1], n => S::narrow(low[n], high[n]));
                let [di, dj] = each_of!([0, 1], n => S::load(&deviations[l * wide + r][n]));
                let to = &mut asides[l * wide + r];
                S::store(&mut to[0], u[0]);
                S::store(&mut to[1], u[1]);
                S::store(&mut to[2], S::sub(S::mul(u[0], dj), S::mul(u[1], di)));
                least = each_of!([0, 1], n => S::min(u[n], least[n]));
                greatest = each_of!([0, 1], n => S::max(u[n], greatest[n]));
            }
            for n in 0..2 {
                S::store(&mut rows[n][l], S::fold_minima(least[n], S::sub(S::splat(0.0), greatest[n])));
            }
        }
    }
    // SAFETY: as above.
    unsafe { ends_of_rows::<S>(&rows, start) };
}

/// Shorter directions are traced one by one.
const SHORTEST_IN_LANES: f32 = 1e-18;
const _: () = assert!(SHORTEST < SHORTEST_IN_LANES as f64);
