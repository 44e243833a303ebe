//! Sixteen pulses side by side, one per lane: the [`Frustum`](crate::frustum::Frustum) of every pulse, around
//! one reference point (the packet's apex), and the frustum around all of them, the packet's hull.

#![expect(clippy::needless_range_loop, reason = "lanes of several arrays are counted together")]

use super::edges::Shear;
use super::lanes::{PACKET_SIZE, PerPulse, greater, lowered, raised};
use super::spread::{Deviations, OriginOffsets, Origins, Spread};
use crate::frame::Frame;
use crate::intersect::axes_by_dominance;
use crate::rays::RayGroup;
use crate::simd::{F32Ops, Simd, each_of};
use std::ops::Range;
use vlscan_geom::DVec3;

/// Maximum difference between the first ray of a pulse and that of its packet's first pulse: in each
/// component of the direction, and of the origin in metres.
const MAX_DISTANCE: (f64, f64) = (0.1, 2.0);

/// The depths at which the pulses hit planes across one axis, `(plane − from)·inverse` by lane, and whether
/// these are upper or lower bounds of the depths on the inner side of the plane.
#[derive(Clone, Copy)]
pub(crate) struct PlaneDepths<S: Simd> {
    pub from: PerPulse,
    pub inverse: PerPulse,
    pub is_upper: S::Mask16,
    pub is_lower: S::Mask16,
}

/// The depths at which one frustum hits planes across one axis: `(plane − from)·inverse`.
#[derive(Clone, Copy)]
pub(crate) struct PlaneDepth {
    pub from: f32,
    pub inverse: f32,
}

/// The frustums of up to sixteen pulses that share the dominant axis and its sign. Arrays of two are by side
/// axis, arrays of three by axis.
#[derive(Clone, Copy)]
pub(crate) struct PacketFrustum<S: Simd> {
    pub simd: S,
    /// Dominant axis, then the side axes.
    pub axes: [usize; 3],
    /// Sign of the directions along the dominant axis.
    pub forward: f32,
    /// Reference point in the tree's frame; no pulse starts behind it.
    pub apex: [f32; 3],
    /// Sum of all errors that do not scale with depth, tree's frame.
    pub slack: f32,
    /// Units of the tree's frame per metre.
    pub scale: f64,
    /// Maximum distance between the origins of merged pulses' rays and the first of each pulse, tree's frame.
    pub origin_spread: f64,
    /// Depth up to which slopes relative to the apex are meaningless.
    pub slopes_from: f32,
    /// Slopes, `[side axis][low, high]`.
    pub slope: [[PerPulse; 2]; 2],
    /// Offsets from the apex at depth 0, `[side axis][low, high]`.
    pub offset: [[PerPulse; 2]; 2],
    /// Maximum magnitude of an offset.
    pub max_offset: f32,
    /// Depth from which [`PacketFrustum::max_offset`] is less than a quarter of the width of the narrowest
    /// pulse.
    pub small_offsets_from: f32,
    /// Depth of each origin; for merged pulses, of the foremost.
    pub start: PerPulse,
    /// Maximum depth that a ray gains per unit of t, tree's frame.
    pub depth_per_t: [f64; PACKET_SIZE],
    /// Maximum magnitude of the directions' component along the dominant axis.
    pub max_along: [f64; PACKET_SIZE],
    /// `[axis][planes above a box, planes below it]`.
    pub planes: [[PlaneDepths<S>; 2]; 3],
    /// The frustum around all pulses, `[axis][planes above a box, planes below it]`.
    pub hull: [[PlaneDepth; 2]; 3],
    /// Sheared coordinates of each pulse, in double precision.
    pub shears: [Shear; PACKET_SIZE],
    /// Sheared coordinates of each pulse, in single precision.
    pub lane_shears: LaneShears,
}

/// Sheared coordinates of the pulses in single precision, relative to the apex. Arrays of three are by
/// dominant axis and side axes.
#[derive(Clone, Copy)]
pub(crate) struct LaneShears {
    pub from: [PerPulse; 3],
    /// Slopes of the shear; of the first ray, exactly those of [`Shear`], or of the middle of the rays.
    pub slope: [PerPulse; 2],
    /// Maximum magnitude of these slopes.
    pub max_slope: PerPulse,
    /// Maximum deviation of a ray from these slopes.
    pub width: PerPulse,
    /// Maximum sideways distance between the origins of a merged pulse's rays and the first.
    pub reach: PerPulse,
}

/// Returns the number of pulses from `first` on that are near enough to be traced together, at least 1. A
/// pulse whose first ray is NaN joins no other.
pub(crate) fn count_neighbours(rays: &RayGroup, first: usize) -> usize {
    let (o, d) = (rays.origin(first), rays.direction(first, 0));
    let last = (first + PACKET_SIZE).min(rays.len());
    let is_near = |p: &usize| {
        let (dd, oo) = ((rays.direction(*p, 0) - d).abs(), (rays.origin(*p) - o).abs());
        dd.cmple(DVec3::splat(MAX_DISTANCE.0)).all() && oo.cmple(DVec3::splat(MAX_DISTANCE.1)).all()
    };
    1 + (first + 1..last).take_while(is_near).count()
}

impl<S: Simd> PacketFrustum<S> {
    /// Computes the frustums of some pulses, at most sixteen; lanes without a pulse repeat the first. Writes
    /// the deviations of their rays, and the origins of merged pulses' rays. Returns `None` when the rays do
    /// not share a dominant axis, or start out of range. `error` is the maximum error of rays and primitives,
    /// in units of the tree's frame.
    #[inline(always)]
    pub fn around(
        simd: S,
        frame: &Frame,
        rays: &RayGroup,
        pulses: Range<usize>,
        (deviations, offsets): (&mut [Deviations], &mut [OriginOffsets]),
        error: f64,
    ) -> Option<PacketFrustum<S>> {
        let axes = axes_by_dominance(rays.direction(pulses.start, 0));
        let forward = if rays.direction(pulses.start, 0)[axes[0]] < 0.0 { -1.0 } else { 1.0 };
        let origins = Origins::of(frame, rays, pulses.clone(), axes, forward, error)?;
        let out = (deviations, offsets);
        let spread = Spread::of(simd, frame.scale, rays, pulses.clone(), axes, forward, out);
        let slope = spread.slopes()?;
        let mut max_along = [0.0; PACKET_SIZE];
        for l in 0..PACKET_SIZE {
            max_along[l] = f64::from(spread.along[1].0[l]) * 1.000_000_2;
        }
        let mut shears = [Shear::ZERO; PACKET_SIZE];
        for (l, pulse) in pulses.enumerate() {
            let slope = [spread.first[0][l], spread.first[1][l]];
            shears[l] = Shear { origin: rays.origin(pulse).to_array(), slope };
        }
        let lane_shears = LaneShears::of(&origins, &spread, forward as f32);
        let cones = PulseCones { origins, slope, start: spread.start, max_along, shears, lane_shears };
        Some(PacketFrustum::of(simd, frame.scale, (axes, forward as f32), &cones))
    }

    /// The frustums of pulses that run `forward` along the first of `axes`.
    #[inline(always)]
    pub fn of(
        simd: S,
        scale: f64,
        (axes, forward): ([usize; 3], f32),
        cones: &PulseCones,
    ) -> PacketFrustum<S> {
        let PulseCones { origins, slope, start, max_along, shears, lane_shears } = cones;
        let mut offset = [[PerPulse::ZERO; 2]; 2];
        for side in 0..2 {
            for end in 0..2 {
                for l in 0..PACKET_SIZE {
                    // The higher slope makes the lower offset.
                    let back = slope[side][1 - end].0[l] * origins.depth.0[l];
                    offset[side][end].0[l] = origins.offset[side].0[l] + start[side][end].0[l] - back;
                }
            }
        }
        let mut sizes = [0.0f32; PACKET_SIZE];
        for o in offset.iter().flatten() {
            for l in 0..PACKET_SIZE {
                sizes[l] = greater(o.0[l].abs(), sizes[l]);
            }
        }
        let max_offset = simd.load(&sizes).max_lane();
        let mut depth_per_t = [0.0; PACKET_SIZE];
        for l in 0..PACKET_SIZE {
            depth_per_t[l] = max_along[l] * scale;
        }
        let narrowest = -(simd.splat(0.0) - simd.load(&lane_shears.width.0)).max_lane();
        let are_small = max_offset <= 8.0 * origins.slack;
        let small_offsets_from = if are_small { f32::NEG_INFINITY } else { 4.0 * max_offset / narrowest };
        PacketFrustum {
            simd,
            axes,
            forward,
            apex: origins.apex,
            slack: origins.slack,
            scale,
            origin_spread: origins.spread,
            slopes_from: origins.slopes_from,
            slope: *slope,
            max_offset,
            small_offsets_from,
            start: origins.foremost,
            depth_per_t,
            max_along: *max_along,
            planes: planes(simd, axes, forward, origins, slope, &offset),
            hull: hull(simd, axes, forward, origins, slope, &offset),
            offset,
            shears: *shears,
            lane_shears: *lane_shears,
        }
    }
}

impl<S: Simd> PacketFrustum<S> {
    /// The planes of one pulse, like those of the hull.
    #[inline(always)]
    pub fn pulse_planes(&self, p: usize) -> [[PlaneDepth; 2]; 3] {
        let of_pulse = |s: &PlaneDepths<S>| PlaneDepth { from: s.from.0[p], inverse: s.inverse.0[p] };
        each_of!([0, 1, 2], a => each_of!([0, 1], n => of_pulse(&self.planes[a][n])))
    }
}

/// Origins and directions of the pulses of a packet, from which its frustums follow.
pub(super) struct PulseCones {
    pub origins: Origins,
    /// Slopes, `[side axis][low, high]`.
    pub slope: [[PerPulse; 2]; 2],
    /// Origins of merged pulses' rays relative to the first, `[side axis][low, high]`, in the tree's frame.
    pub start: [[PerPulse; 2]; 2],
    /// Maximum magnitude of the directions' component along the dominant axis.
    pub max_along: [f64; PACKET_SIZE],
    pub shears: [Shear; PACKET_SIZE],
    pub lane_shears: LaneShears,
}

impl LaneShears {
    /// Coordinates around these origins that are not sheared.
    #[inline(always)]
    pub fn at(origins: &Origins, forward: f32) -> LaneShears {
        let mut shears = LaneShears {
            from: [origins.depth, origins.offset[0], origins.offset[1]],
            slope: [PerPulse::ZERO; 2],
            max_slope: PerPulse::ZERO,
            width: PerPulse::ZERO,
            reach: PerPulse::ZERO,
        };
        for l in 0..PACKET_SIZE {
            shears.from[0].0[l] *= forward;
        }
        shears
    }

    #[inline(always)]
    fn of(origins: &Origins, spread: &Spread, forward: f32) -> LaneShears {
        let mut shears = LaneShears::at(origins, forward);
        let largest = |[i, j]: &[[PerPulse; 2]; 2], l: usize| {
            let ends = [i[0].0[l].abs(), i[1].0[l].abs(), j[0].0[l].abs(), j[1].0[l].abs()];
            raised(greater(greater(ends[0], ends[1]), greater(ends[2], ends[3])))
        };
        for l in 0..PACKET_SIZE {
            let [i, j] = [0, 1].map(|n| spread.first[n][l] as f32);
            (shears.slope[0].0[l], shears.slope[1].0[l]) = (i, j);
            shears.max_slope.0[l] = greater(i.abs(), j.abs());
            shears.width.0[l] = largest(&spread.deviation, l);
            shears.reach.0[l] = largest(&spread.start, l);
        }
        shears
    }
}

impl<S: Simd> PlaneDepths<S> {
    /// Creates the depths of planes above a box if `above`, else of planes below it.
    #[inline(always)]
    fn new(simd: S, from: [f32; PACKET_SIZE], slope: &[f32; PACKET_SIZE], above: bool) -> PlaneDepths<S> {
        let mut inverse = [0.0; PACKET_SIZE];
        for l in 0..PACKET_SIZE {
            inverse[l] = 1.0 / slope[l];
        }
        let (zero, v) = (simd.splat(0.0), simd.load(&inverse));
        let (up, down) = (zero.le(v), v.le(zero));
        let (is_upper, is_lower) = if above { (up, down) } else { (down, up) };
        PlaneDepths { from: PerPulse(from), inverse: PerPulse(inverse), is_upper, is_lower }
    }
}

#[inline(always)]
fn planes<S: Simd>(
    simd: S,
    [k, i, j]: [usize; 3],
    forward: f32,
    origins: &Origins,
    slope: &[[PerPulse; 2]; 2],
    offset: &[[PerPulse; 2]; 2],
) -> [[PlaneDepths<S>; 2]; 3] {
    let (r, slack) = (origins.apex, origins.slack);
    let mut planes = [[
        PlaneDepths::new(simd, [lowered(r[k] - slack); PACKET_SIZE], &[forward; PACKET_SIZE], true),
        PlaneDepths::new(simd, [raised(r[k] + slack); PACKET_SIZE], &[forward; PACKET_SIZE], false),
    ]; 3];
    for n in 0..2 {
        let a = [i, j][n];
        let (mut low, mut high) = ([0.0; PACKET_SIZE], [0.0; PACKET_SIZE]);
        for l in 0..PACKET_SIZE {
            low[l] = lowered(r[a] + (offset[n][0].0[l] - slack));
            high[l] = raised(r[a] + (offset[n][1].0[l] + slack));
        }
        planes[a] = [
            PlaneDepths::new(simd, low, &slope[n][0].0, true),
            PlaneDepths::new(simd, high, &slope[n][1].0, false),
        ];
    }
    planes
}

#[inline(always)]
fn hull<S: Simd>(
    simd: S,
    [k, i, j]: [usize; 3],
    forward: f32,
    origins: &Origins,
    slope: &[[PerPulse; 2]; 2],
    offset: &[[PerPulse; 2]; 2],
) -> [[PlaneDepth; 2]; 3] {
    let greatest = |x: &PerPulse| simd.load(&x.0).max_lane();
    let least = |x: &PerPulse| -(simd.splat(0.0) - simd.load(&x.0)).max_lane();
    let (r, slack) = (origins.apex, origins.slack);
    let mut hull = [[
        PlaneDepth { from: lowered(r[k] - slack), inverse: forward },
        PlaneDepth { from: raised(r[k] + slack), inverse: forward },
    ]; 3];
    for (n, a) in [i, j].into_iter().enumerate() {
        let low = lowered(r[a] + (least(&offset[n][0]) - slack));
        let high = raised(r[a] + (greatest(&offset[n][1]) + slack));
        hull[a] = [
            PlaneDepth { from: low, inverse: 1.0 / least(&slope[n][0]) },
            PlaneDepth { from: high, inverse: 1.0 / greatest(&slope[n][1]) },
        ];
    }
    hull
}
