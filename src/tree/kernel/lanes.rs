//! Up to sixteen pulses as lanes: the filter of [`Beam`](crate::tree::beam::Beam) sixteen times, around one reference
//! point, and the beam around all of them.

#![expect(clippy::needless_range_loop, reason = "lanes of several arrays are counted together")]

use super::edges::Eye;
pub(super) use super::spread::{Asides, Deviations};
use super::spread::{Spread, Start};
use crate::geom::DVec3;
use crate::tree::frame::Frame;
use crate::tree::intersect::axes_by_dominance;
use crate::tree::rays::RayGroup;
use crate::tree::simd::Simd;
use std::ops::Range;

/// Pulses in a group.
pub(crate) const GROUP: usize = 16;

/// How far pulses of a group may be apart: each component of the direction, and the origin in metres.
const NEIGHBOURS: (f64, f64) = (0.1, 2.0);

/// A number for each pulse.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct PerPulse(pub [f32; GROUP]);

impl PerPulse {
    /// Gives lanes from `used` on the number of the first.
    #[inline(always)]
    pub fn repeat_first(&mut self, used: usize) {
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
pub(super) fn raised(x: f32) -> f32 {
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
    /// Units of the tree's frame per metre, and how far rays of packets start from their first in these.
    pub scale: f64,
    pub spread: f64,
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
    /// Depth of each origin; of a packet, of the foremost.
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
    /// How far sideways rays of a packet start from the first.
    pub reach: PerPulse,
}

/// How many pulses from `first` on are near enough to be traced together, at least 1; none with one that is no number.
pub(crate) fn neighbours(rays: &RayGroup, first: usize) -> usize {
    let (o, d) = (rays.origin(first), rays.direction(first, 0));
    let last = (first + GROUP).min(rays.len());
    let near = |p: &usize| {
        let (dd, oo) = ((rays.direction(*p, 0) - d).abs(), (rays.origin(*p) - o).abs());
        dd.cmple(DVec3::splat(NEIGHBOURS.0)).all() && oo.cmple(DVec3::splat(NEIGHBOURS.1)).all()
    };
    1 + (first + 1..last).take_while(near).count()
}

impl<S: Simd> Lanes<S> {
    /// The lanes of some pulses, at most sixteen; lanes without a pulse repeat the first. Where
    /// their rays start aside of each other is written to `asides` if they are packets. `None` when they do not run
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
        asides: &mut [Asides],
        off: f64,
    ) -> Option<Lanes<S>> {
        let axes = axes_by_dominance(rays.direction(pulses.start, 0));
        let forward = if rays.direction(pulses.start, 0)[axes[0]] < 0.0 { -1.0 } else { 1.0 };
        let start = Start::of(frame, rays, pulses.clone(), axes, forward, off)?;
        // SAFETY: the caller vouches for the instruction set.
        let spread = unsafe {
            Spread::of::<S>(frame.scale, rays, pulses.clone(), axes, forward, (deviations, asides))
        };
        let slope = spread.slopes()?;
        let mut offset = [[PerPulse([0.0; GROUP]); 2]; 2];
        for side in 0..2 {
            for end in 0..2 {
                for l in 0..GROUP {
                    // The higher slope makes the lower offset.
                    let back = slope[side][1 - end].0[l] * start.depth.0[l];
                    offset[side][end].0[l] = start.offset[side].0[l] + spread.start[side][end].0[l] - back;
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
                scale: frame.scale,
                spread: start.spread,
                near: start.near,
                slope,
                offset,
                most_offset,
                still_from,
                start: start.foremost,
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
            reach: PerPulse([0.0; GROUP]),
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
            let [i, j] = &spread.start;
            let ends = [i[0].0[l].abs(), i[1].0[l].abs(), j[0].0[l].abs(), j[1].0[l].abs()];
            view.reach.0[l] = raised(greatest(greatest(ends[0], ends[1]), greatest(ends[2], ends[3])));
        }
        view
    }
}

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
