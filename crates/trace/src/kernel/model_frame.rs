//! A packet in the frame of a model: the frustums around its pulses are transformed, not their rays.
//!
//! The directions of a pulse lie within the pyramid over its slopes, and so do their images within the image
//! of that pyramid. Its four edges give the slopes in the model's frame. The deviations of the rays
//! themselves are computed for pulses that come upon a triangle.

#![expect(clippy::needless_range_loop, reason = "lanes of several arrays are counted together")]

use super::edges::Shear;
use super::lanes::{PACKET_SIZE, PerPulse, greater};
use super::packet::{LaneShears, PacketFrustum, PulseCones};
use super::spread::{Deviations, OriginLanes, Origins};
use crate::frame::Frame;
use crate::frustum::MIN_SLOPE;
use crate::instances::WorldToInstance;
use crate::intersect::axes_by_dominance;
use crate::simd::{F32Ops, Simd, each_of};
use glam::DMat3;

/// Bound of the rounding error of the image of an edge of a pyramid in single precision, relative to the
/// largest sum of a row of the matrix.
const IMAGE_ROUNDING: f32 = 4e-7;

/// Bound of the rounding error of slopes.
const SLOPE_ROUNDING: f32 = 1e-6;

impl<S: Simd> PacketFrustum<S> {
    /// The frustums of the `pulses` of this packet, whose `origins` are those in the scene, in the frame of a
    /// model's tree. Other lanes repeat the first of `pulses`. Returns `None` when the rays do not share a
    /// dominant axis there, or start out of range.
    #[inline(always)]
    pub fn in_model(
        &self,
        frame: &Frame,
        way: &WorldToInstance,
        origins: &OriginLanes,
        pulses: u32,
    ) -> Option<PacketFrustum<S>> {
        let first = pulses.trailing_zeros() as usize % PACKET_SIZE;
        let slope = self.slope.each_ref().map(|side| side.each_ref().map(|end| end.only(pulses, first)));
        let matrix = way.matrix();
        let columns = self.axes.map(|a| matrix.col(a));
        let columns = [columns[0] * f64::from(self.forward), columns[1], columns[2]];
        let middle = slope.each_ref().map(|[low, high]| f64::from(0.5 * (low.0[first] + high.0[first])));
        let middle = columns[0] + columns[1] * middle[0] + columns[2] * middle[1];
        let axes = axes_by_dominance(middle);
        let forward = if middle[axes[0]] < 0.0 { -1.0 } else { 1.0f32 };
        let rows = axes.map(|a| columns.map(|c| c[a] as f32));
        let rows = [rows[0].map(|x| x * forward), rows[1], rows[2]];
        let image = Image::of(&rows, &slope)?;

        let (origins, error) = transform(origins, way, frame, pulses, first);
        let error = error * frame.scale;
        let origins = Origins::of_lanes(&origins, None, axes, f64::from(forward), error)?;
        let mut max_along = [0.0; PACKET_SIZE];
        for l in 0..PACKET_SIZE {
            max_along[l] = self.max_along[l] * f64::from(image.along.0[l]);
        }
        let lane_shears = image.shears(&origins, forward);
        let start = [[PerPulse::ZERO; 2]; 2];
        let shears = [Shear::ZERO; PACKET_SIZE];
        let cones = PulseCones { origins, slope: image.slope, start, max_along, shears, lane_shears };
        Some(PacketFrustum::of(self.simd, frame.scale, (axes, forward), &cones))
    }
}

impl PerPulse {
    /// The lanes of `pulses`, and lane `first` in the others.
    #[inline(always)]
    fn only(&self, pulses: u32, first: usize) -> PerPulse {
        let (mut lanes, other) = (*self, self.0[first]);
        for l in 0..PACKET_SIZE {
            lanes.0[l] = if pulses >> l & 1 == 0 { other } else { lanes.0[l] };
        }
        lanes
    }
}

/// The images of the pyramids over the slopes of pulses.
struct Image {
    /// Slopes, `[side axis][low, high]`.
    slope: [[PerPulse; 2]; 2],
    /// Maximum component along the dominant axis of the image of a direction that has the component 1 in the
    /// scene.
    along: PerPulse,
}

impl Image {
    /// The images under a matrix with these `rows`, for the dominant axis and the side axes. Returns `None`
    /// unless all rays run forward, well within the cone of the dominant axis.
    #[inline(always)]
    fn of(rows: &[[f32; 3]; 3], slope: &[[PerPulse; 2]; 2]) -> Option<Image> {
        let (mut least, mut greatest) =
            ([[f32::INFINITY; PACKET_SIZE]; 3], [[f32::NEG_INFINITY; PACKET_SIZE]; 3]);
        for i in 0..2 {
            for j in 0..2 {
                for l in 0..PACKET_SIZE {
                    let (x, y) = (slope[0][i].0[l], slope[1][j].0[l]);
                    let [along, u, v] =
                        each_of!([0, 1, 2], n => rows[n][0] + rows[n][1] * x + rows[n][2] * y);
                    let inverse = 1.0 / along;
                    let edge = [along, u * inverse, v * inverse];
                    for n in 0..3 {
                        least[n][l] = if edge[n] < least[n][l] { edge[n] } else { least[n][l] };
                        greatest[n][l] = greater(edge[n], greatest[n][l]);
                    }
                }
            }
        }
        let reach = rows.iter().fold(0.0f32, |m, row| m.max(row[0].abs() + row[1].abs() + row[2].abs()));
        let (mut slope, mut sound) = ([[PerPulse::ZERO; 2]; 2], true);
        let mut along = PerPulse::ZERO;
        for l in 0..PACKET_SIZE {
            let error = IMAGE_ROUNDING * reach;
            along.0[l] = greatest[0][l] * 1.000_001 + error;
            // Both the components across and the one along the axis err, and slopes are less than one.
            let pad = SLOPE_ROUNDING + 2.0 * error / (least[0][l] - error);
            sound &= least[0][l] > 2.0 * error && along.0[l] < f32::MAX;
            for side in 0..2 {
                let (lo, hi) = (least[1 + side][l] - pad, greatest[1 + side][l] + pad);
                sound &= lo > -1.0 && hi < 1.0;
                slope[side][0].0[l] = if lo.abs() < MIN_SLOPE { -MIN_SLOPE } else { lo };
                slope[side][1].0[l] = if hi.abs() < MIN_SLOPE { MIN_SLOPE } else { hi };
            }
        }
        sound.then_some(Image { slope, along })
    }

    /// Sheared coordinates along the middle of each pyramid.
    #[inline(always)]
    fn shears(&self, origins: &Origins, forward: f32) -> LaneShears {
        let mut shears = LaneShears::at(origins, forward);
        for l in 0..PACKET_SIZE {
            let mut width = 0.0;
            for side in 0..2 {
                let [lo, hi] = [self.slope[side][0].0[l], self.slope[side][1].0[l]];
                let middle = 0.5 * (lo + hi) * forward;
                shears.slope[side].0[l] = middle;
                shears.max_slope.0[l] = greater(middle.abs(), shears.max_slope.0[l]);
                width = greater(0.5 * (hi - lo), width);
            }
            shears.width.0[l] = width * 1.000_001 + SLOPE_ROUNDING;
        }
        shears
    }
}

/// Transforms the origins of `pulses` into the frame of a model's tree; other lanes repeat lane `first`. Also
/// returns the bound of their error in the model's frame.
#[inline(always)]
fn transform(
    OriginLanes(origins): &OriginLanes,
    way: &WorldToInstance,
    frame: &Frame,
    pulses: u32,
    first: usize,
) -> (OriginLanes, f64) {
    let matrix = way.matrix();
    let [a, b, c] = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|c| c.to_array());
    let (anchor, centre) = (way.anchor().to_array(), frame.origin.to_array());
    let mut from = *origins;
    let mut farthest = 0.0;
    for (axis, anchor) in from.iter_mut().zip(anchor) {
        for x in axis {
            farthest = if x.abs() > farthest { x.abs() } else { farthest };
            *x -= anchor;
        }
    }
    let [x, y, z] = &from;
    let mut to = [[0.0; PACKET_SIZE]; 3];
    for n in 0..3 {
        for l in 0..PACKET_SIZE {
            to[n][l] = (a[n] * x[l] + b[n] * y[l] + c[n] * z[l] - centre[n]) * frame.scale;
        }
        let other = to[n][first];
        for l in 0..PACKET_SIZE {
            to[n][l] = if pulses >> l & 1 == 0 { other } else { to[n][l] };
        }
    }
    (OriginLanes(to), way.error_at(farthest))
}

/// Writes the deviations of a pulse's rays from its shear to `deviations`, sixteen rays at a time. `rows` are
/// those of the matrix into the model's frame for the axes of the shear, `slope` is that of the shear.
#[inline(always)]
pub(super) fn set_deviations<S: Simd>(
    simd: S,
    directions: [&[[f64; 8]]; 3],
    matrix: &DMat3,
    axes: [usize; 3],
    slope: [f32; 2],
    deviations: &mut [Deviations],
) {
    let rows = axes.map(|a| matrix.row(a).to_array());
    let slope = each_of!([0, 1], n => simd.splat_f64(f64::from(slope[n])));
    let one = simd.splat(1.0);
    let registers = directions[0].len();
    for (r, to) in deviations.iter_mut().enumerate() {
        // An odd last register is taken twice.
        let halves = each_of!([0, 1], n => {
            let at = (2 * r + n).min(registers - 1);
            let d = each_of!([0, 1, 2], a => simd.load_f64(&directions[a][at]));
            let [k, i, j] = each_of!([0, 1, 2], m => {
                let row = each_of!([0, 1, 2], a => simd.splat_f64(rows[m][a]));
                row[0] * d[0] + row[1] * d[1] + row[2] * d[2]
            });
            [i - slope[0] * k, j - slope[1] * k, k]
        });
        let [low, high] = halves;
        let [i, j, k] = each_of!([0, 1, 2], n => simd.narrow(low[n], high[n]));
        let inverse = one / k;
        (i * inverse).store(&mut to[0]);
        (j * inverse).store(&mut to[1]);
    }
}
