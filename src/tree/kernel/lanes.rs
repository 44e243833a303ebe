//! Up to sixteen pulses as lanes: the filter of [`Beam`](crate::tree::beam::Beam) sixteen times, around one reference
//! point, and the beam around all of them.

#![expect(clippy::needless_range_loop, reason = "lanes of several arrays are counted together")]

use super::edges::Eye;
use crate::geom::DVec3;
use crate::tree::beam::FLATTEST;
use crate::tree::frame::{Frame, above};
use crate::tree::intersect::{SHORTEST, axes_by_dominance};
use crate::tree::rays::RayGroup;
use crate::tree::simd::{Simd, each_of};
use std::ops::Range;

/// Pulses in a group.
pub(crate) const GROUP: usize = 16;

/// Covers the rounding of slopes, which are below one.
const SLOPE_SLACK: f32 = 1e-6;

/// Origins farther away than this (in scene radii) are not for single precision.
const FARTHEST: f64 = 1e12;

/// How far pulses of a group may be apart: each component of the direction, and the origin in metres.
const NEIGHBOURS: (f64, f64) = (0.1, 2.0);

/// A number for each pulse.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct PerPulse(pub [f32; GROUP]);

impl PerPulse {
    /// Gives lanes from `used` on the number of the first.
    #[inline(always)]
    fn repeat_first(&mut self, used: usize) {
        for l in used..GROUP {
            self.0[l] = self.0[0];
        }
    }
}

/// A number not above `x`, by a unit in the last place or two. Unlike `next_down` this is three operations.
#[inline(always)]
fn lowered(x: f32) -> f32 {
    x - (x.abs() * f32::EPSILON + f32::MIN_POSITIVE)
}

/// A number not below `x`.
#[inline(always)]
fn raised(x: f32) -> f32 {
    x + (x.abs() * f32::EPSILON + f32::MIN_POSITIVE)
}

/// One plane family of an axis, seen by lanes: depths are `(plane − from)·inverse`, an upper bound where `upper` says so.
#[derive(Clone, Copy)]
pub(crate) struct Side<S: Simd> {
    pub from: PerPulse,
    pub inverse: PerPulse,
    pub upper: S::M,
    pub lower: S::M,
}

/// The same for one beam.
#[derive(Clone, Copy)]
pub(crate) struct BeamSide {
    pub from: f32,
    pub inverse: f32,
}

/// A group of pulses that share the axis along which they run, and its sign.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<S: Simd> {
    /// Dominant axis, then the others.
    pub axes: [usize; 3],
    pub forward: f32,
    /// Reference point in the tree's frame; no pulse starts behind it.
    pub apex: [f32; 3],
    /// Sum of all errors that do not scale with depth.
    pub slack: f32,
    /// Depth up to which slopes as seen from the apex mean nothing.
    pub near: f32,
    /// Slopes `[side axis][low, high]`.
    pub slope: [[PerPulse; 2]; 2],
    /// Offsets at depth 0 from the apex, likewise.
    pub offset: [[PerPulse; 2]; 2],
    /// The greatest of their sizes.
    pub most_offset: f32,
    /// Depth from which on that is less than a quarter of the width of the narrowest pulse.
    pub still_from: f32,
    /// Depth of each origin.
    pub start: PerPulse,
    /// Largest depth per unit of t, tree's frame, and in metres.
    pub steepness: [f64; GROUP],
    pub steepest: [f64; GROUP],
    /// `[axis][planes above the box, planes below it]`.
    pub sides: [[Side<S>; 2]; 3],
    /// The beam around all.
    pub beam: [[BeamSide; 2]; 3],
    /// What each pulse looks from.
    pub eyes: [Eye; GROUP],
    /// The same in single precision, tree's frame.
    pub view: View,
}

/// Whence the pulses look, relative to the apex; by dominant axis and side axes where there are three.
#[derive(Clone, Copy)]
pub(crate) struct View {
    pub from: [PerPulse; 3],
    /// Slopes of the first ray, exactly those of the eyes.
    pub middle: [PerPulse; 2],
    /// Their greatest size.
    pub tilt: PerPulse,
    /// Largest deviation from them.
    pub width: PerPulse,
}

/// How many pulses from `first` on are near enough to be traced together, at least 1.
pub(crate) fn neighbours(rays: &RayGroup, first: usize) -> usize {
    let (o, d) = (rays.origin(first), rays.direction(first, 0));
    let last = (first + GROUP).min(rays.len());
    let near = |p: &usize| {
        let (dd, oo) = ((rays.direction(*p, 0) - d).abs(), (rays.origin(*p) - o).abs());
        dd.max_element() <= NEIGHBOURS.0 && oo.max_element() <= NEIGHBOURS.1
    };
    1 + (first + 1..last).take_while(near).count()
}

impl<S: Simd> Lanes<S> {
    /// The lanes of some pulses, at most sixteen; lanes without a pulse repeat the first. `None` when they do not run
    /// along one axis, or start out of reach. `off` is by how much rays and primitives may be off, in units of the frame.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    pub unsafe fn of(
        frame: &Frame,
        rays: &RayGroup,
        pulses: Range<usize>,
        deviations: &mut [Deviations],
        off: f64,
    ) -> Option<Lanes<S>> {
        let axes = axes_by_dominance(rays.direction(pulses.start, 0));
        let forward = if rays.direction(pulses.start, 0)[axes[0]] < 0.0 { -1.0 } else { 1.0 };
        let start = Start::of(frame, rays, pulses.clone(), axes, forward, off)?;
        // SAFETY: the caller vouches for the instruction set.
        let spread = unsafe { Spread::of::<S>(rays, pulses.clone(), axes, forward, deviations) };
        let slope = spread.slopes()?;
        let mut offset = [[PerPulse([0.0; GROUP]); 2]; 2];
        for side in 0..2 {
            for end in 0..2 {
                for l in 0..GROUP {
                    // The higher slope makes the lower offset.
                    let back = slope[side][1 - end].0[l] * start.depth.0[l];
                    offset[side][end].0[l] = start.offset[side].0[l] - back;
                }
            }
        }
        let mut sizes = [0.0f32; GROUP];
        for o in offset.iter().flatten() {
            for l in 0..GROUP {
                sizes[l] = if o.0[l].abs() > sizes[l] { o.0[l].abs() } else { sizes[l] };
            }
        }
        // SAFETY: the caller vouches for the instruction set.
        let most_offset = unsafe { S::greatest(S::load(&sizes)) };
        let (mut steepness, mut steepest) = ([0.0; GROUP], [0.0; GROUP]);
        for l in 0..GROUP {
            steepest[l] = f64::from(spread.depth[1].0[l]) * 1.000_000_2;
            steepness[l] = steepest[l] * frame.scale;
        }
        let mut eyes = [Eye::NOWHERE; GROUP];
        for (l, pulse) in pulses.enumerate() {
            let middle = [spread.middle[0][l], spread.middle[1][l]];
            eyes[l] = Eye { origin: rays.origin(pulse).to_array(), middle };
        }
        let view = View::of(&start, &spread, forward as f32);
        // SAFETY: as above.
        let narrowest = -unsafe { S::greatest(S::sub(S::splat(0.0), S::load(&view.width.0))) };
        let still = most_offset <= 8.0 * start.slack;
        let still_from = if still { f32::NEG_INFINITY } else { 4.0 * most_offset / narrowest };
        // SAFETY: as above.
        unsafe {
            let sides = sides::<S>(axes, forward as f32, &start, &slope, &offset);
            let beam = sides_of_all(axes, forward as f32, &start, &slope, &offset);
            Some(Lanes {
                axes,
                forward: forward as f32,
                apex: start.apex,
                slack: start.slack,
                near: start.near,
                slope,
                offset,
                most_offset,
                still_from,
                start: start.depth,
                steepness,
                steepest,
                sides,
                beam,
                eyes,
                view,
            })
        }
    }
}

impl View {
    #[inline(always)]
    fn of(start: &Start, spread: &Spread, forward: f32) -> View {
        let mut view = View {
            from: [start.depth, start.offset[0], start.offset[1]],
            middle: [PerPulse([0.0; GROUP]); 2],
            tilt: PerPulse([0.0; GROUP]),
            width: PerPulse([0.0; GROUP]),
        };
        for l in 0..GROUP {
            view.from[0].0[l] *= forward;
            let [i, j] = [0, 1].map(|n| spread.middle[n][l] as f32);
            (view.middle[0].0[l], view.middle[1].0[l]) = (i, j);
            let greatest = |a: f32, b: f32| if a > b { a } else { b };
            view.tilt.0[l] = greatest(i.abs(), j.abs());
            let [i, j] = &spread.aside;
            let ends = [i[0].0[l].abs(), i[1].0[l].abs(), j[0].0[l].abs(), j[1].0[l].abs()];
            view.width.0[l] = raised(greatest(greatest(ends[0], ends[1]), greatest(ends[2], ends[3])));
        }
        view
    }
}

/// Where the pulses start.
struct Start {
    apex: [f32; 3],
    slack: f32,
    near: f32,
    /// Sideways from the apex.
    offset: [PerPulse; 2],
    /// Forward from the apex.
    depth: PerPulse,
}

impl Start {
    #[inline(always)]
    fn of(
        frame: &Frame,
        rays: &RayGroup,
        pulses: Range<usize>,
        axes: [usize; 3],
        forward: f64,
        off: f64,
    ) -> Option<Start> {
        let mut origins = [DVec3::ZERO; GROUP];
        let origins = &mut origins[..pulses.len()];
        for (o, p) in origins.iter_mut().zip(pulses) {
            *o = frame.local(rays.origin(p));
        }
        let [k, i, j] = axes;
        let rearmost = origins.iter().fold(f64::INFINITY, |m, o| m.min(o[k] * forward));
        let mut apex = origins[0].to_array().map(|x| x as f32);
        apex[k] = ((rearmost as f32).next_down() * forward as f32).clamp(f32::MIN, f32::MAX);
        let (mut offset, mut depth) = ([PerPulse([0.0; GROUP]); 2], PerPulse([0.0; GROUP]));
        let (mut reach, mut spread) = (0.0f64, 0.0f64);
        for (l, o) in origins.iter().enumerate() {
            let from = [o[k] - f64::from(apex[k]), o[i] - f64::from(apex[i]), o[j] - f64::from(apex[j])];
            depth.0[l] = (from[0] * forward) as f32;
            offset[0].0[l] = from[1] as f32;
            offset[1].0[l] = from[2] as f32;
            reach = reach.max(o.abs().max_element());
            spread = spread.max(from.iter().fold(0.0, |m, x| m.max(x.abs())));
        }
        depth.repeat_first(origins.len());
        offset.iter_mut().for_each(|o| o.repeat_first(origins.len()));
        let sound = reach < FARTHEST;
        let slack = above(2.0 * Frame::ROUNDING + 1e-14 * (1.0 + reach) + 5e-7 * spread + off);
        // Nearer than the offsets, an error of the depth is multiplied in offset / depth.
        let near = 16.0 * slack + above(spread);
        sound.then_some(Start { apex, slack, near, offset, depth })
    }
}

/// Slopes of a pulse's rays, `d_i/d_k` and `d_j/d_k`, less those of its first ray; sixteen rays at a time.
pub(crate) type Deviations = [[f32; 16]; 2];

/// How the directions of each pulse spread around its first.
struct Spread {
    /// Slopes of the first ray, not turned forward.
    middle: [[f64; GROUP]; 2],
    /// Least and greatest deviation from it.
    aside: [[PerPulse; 2]; 2],
    /// Sign of d_k.
    forward: f32,
    /// Least and greatest `|d_k|`.
    depth: [PerPulse; 2],
}

impl Spread {
    /// Writes the deviations of all rays to `deviations`, so many registers per pulse that all fit.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn of<S: Simd>(
        rays: &RayGroup,
        pulses: Range<usize>,
        axes: [usize; 3],
        forward: f64,
        deviations: &mut [Deviations],
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
        for n in 0..3 {
            // SAFETY: as above.
            unsafe {
                let [least, negated] = S::row_minima(&rows[n]);
                S::store(&mut ends[n][0].0, least);
                S::store(&mut ends[n][1].0, S::sub(S::splat(0.0), negated));
            }
        }
        for end in ends.iter_mut().flatten() {
            end.repeat_first(pulses.len());
        }
        for l in pulses.len()..GROUP {
            for m in &mut middle {
                m[l] = m[0];
            }
        }
        let [wi, wj, depth] = ends;
        Spread { middle, aside: [wi, wj], forward: forward as f32, depth }
    }

    /// Intervals of slopes; `None` unless every ray runs forward, well within the cone of its axis.
    #[inline(always)]
    fn slopes(&self) -> Option<[[PerPulse; 2]; 2]> {
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

/// Shorter directions are traced one by one.
const SHORTEST_IN_LANES: f32 = 1e-18;
const _: () = assert!(SHORTEST < SHORTEST_IN_LANES as f64);

impl<S: Simd> Side<S> {
    /// Planes above a box where `above`, else planes below it.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn new(from: [f32; GROUP], slope: &[f32; GROUP], above: bool) -> Side<S> {
        let mut side = [0.0; GROUP];
        for l in 0..GROUP {
            side[l] = 1.0 / slope[l];
        }
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let (zero, v) = (S::splat(0.0), S::load(&side));
            let (up, down) = (S::le(zero, v), S::le(v, zero));
            let (upper, lower) = if above { (up, down) } else { (down, up) };
            Side { from: PerPulse(from), inverse: PerPulse(side), upper, lower }
        }
    }
}

/// # Safety
/// As for [`Simd`].
#[inline(always)]
unsafe fn sides<S: Simd>(
    [k, i, j]: [usize; 3],
    forward: f32,
    start: &Start,
    slope: &[[PerPulse; 2]; 2],
    offset: &[[PerPulse; 2]; 2],
) -> [[Side<S>; 2]; 3] {
    let r = start.apex[k];
    // SAFETY: the caller vouches for the instruction set.
    unsafe {
        let mut sides = [[
            Side::new([lowered(r - start.slack); GROUP], &[forward; GROUP], true),
            Side::new([raised(r + start.slack); GROUP], &[forward; GROUP], false),
        ]; 3];
        for n in 0..2 {
            let a = [i, j][n];
            let (mut under, mut over) = ([0.0; GROUP], [0.0; GROUP]);
            for l in 0..GROUP {
                under[l] = lowered(start.apex[a] + (offset[n][0].0[l] - start.slack));
                over[l] = raised(start.apex[a] + (offset[n][1].0[l] + start.slack));
            }
            sides[a] = [Side::new(under, &slope[n][0].0, true), Side::new(over, &slope[n][1].0, false)];
        }
        sides
    }
}

/// The beam around all lanes.
#[inline(always)]
fn sides_of_all(
    [k, i, j]: [usize; 3],
    forward: f32,
    start: &Start,
    slope: &[[PerPulse; 2]; 2],
    offset: &[[PerPulse; 2]; 2],
) -> [[BeamSide; 2]; 3] {
    let least = |x: &PerPulse| x.0.iter().fold(f32::INFINITY, |m, &x| if x < m { x } else { m });
    let greatest = |x: &PerPulse| x.0.iter().fold(f32::NEG_INFINITY, |m, &x| if x > m { x } else { m });
    let (r, slack) = (start.apex, start.slack);
    let mut beam = [[
        BeamSide { from: lowered(r[k] - slack), inverse: forward },
        BeamSide { from: raised(r[k] + slack), inverse: forward },
    ]; 3];
    for (n, a) in [i, j].into_iter().enumerate() {
        beam[a] = [
            BeamSide {
                from: lowered(r[a] + (least(&offset[n][0]) - slack)),
                inverse: 1.0 / least(&slope[n][0]),
            },
            BeamSide {
                from: raised(r[a] + (greatest(&offset[n][1]) + slack)),
                inverse: 1.0 / greatest(&slope[n][1]),
            },
        ];
    }
    beam
}
