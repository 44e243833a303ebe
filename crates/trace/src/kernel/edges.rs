//! The rays of a pulse that pass within a triangle, where the rounded corners of a block leave that
//! undecided: computed from double precision, but evaluated in single precision wherever that suffices.
//!
//! Slopes are `d_i/d_k` and `d_j/d_k`. In coordinates sheared along the pulse's first ray, a ray that
//! deviates from it by slopes `(δ_i, δ_j)` passes the edge from corner `p` to corner `q` on the side given by
//! the sign of `E = c0 + c1·δ_i + c2·δ_j`, where `(c1, c2, c0) = p × q`. The three coefficients come from
//! double precision. They are small for small triangles near the ray, and so is the error of `E`. The error
//! is bounded; a ray within the bound of an edge is left undecided.
//!
//! For rays of merged pulses, whose origins differ from that of the first, the edges themselves contribute as
//! well: see [`super::sides`].

use super::spread::{Deviations, OriginOffsets};
use crate::simd::{F32Ops, MaskOps, QuadOps, Simd, VectorOps, each_of};
use vlscan_geom::DVec3;

/// Corners of a triangle by axis; the fourth number is not used.
type Corners = [[f64; 4]; 3];

/// Transposes the corners of a triangle to [`Corners`].
#[inline(always)]
pub(super) fn by_axis([a, b, c]: [DVec3; 3]) -> Corners {
    [[a.x, b.x, c.x, 0.0], [a.y, b.y, c.y, 0.0], [a.z, b.z, c.z, 0.0]]
}

/// Rounding of the coefficients, the deviations and the evaluation, all in single precision, generously
/// rounded up.
const SINGLE: f64 = 1.0 / (1u64 << 20) as f64;

/// Rounding of sheared coordinates and their products, in this module and in the exact test, relative to the
/// square of the corners' distance, generously rounded up.
const DOUBLE: f64 = 1.0 / (1u64 << 48) as f64;

/// The sheared coordinates of a pulse: relative to the origin of its first ray, which runs along the third
/// axis.
#[derive(Clone, Copy)]
pub(super) struct Shear {
    pub origin: [f64; 3],
    /// Slopes of the first ray on the side axes.
    pub slope: [f64; 2],
}

impl Shear {
    pub const ZERO: Shear = Shear { origin: [0.0; 3], slope: [0.0; 2] };
}

/// Spread of the rays of a pulse around its first ray.
pub(super) struct PulseExtent {
    /// Maximum deviation of a slope.
    pub width: f64,
    /// Maximum sideways distance between the origins of a merged pulse's rays and the first, tree's frame.
    pub reach: f64,
    /// Maximum distance along any axis between the origins of a merged pulse's rays and the first, over the
    /// packet, tree's frame.
    pub origin_spread: f64,
    /// Units of the tree's frame per metre.
    pub scale: f64,
}

/// The edge functions of a triangle for one pulse; lanes are the edges.
#[derive(Clone, Copy)]
pub(super) struct Edges {
    /// `c1`, `c2`, `c0`, the bound of the error and its negative.
    coefficients: [[f32; 4]; 5],
    /// The edges by axis, for origins in the tree's frame; only set for merged pulses.
    edges: [[f32; 4]; 3],
}

impl Edges {
    /// Computes the edge functions of a triangle for a pulse of this extent. `[k, i, j]` are the dominant
    /// axis and the side axes.
    #[inline(always)]
    pub fn of<S: Simd, const MERGED: bool>(
        simd: S,
        [k, i, j]: [usize; 3],
        shear: &Shear,
        extent: &PulseExtent,
        corners: &Corners,
    ) -> Edges {
        let mut edges = Edges { coefficients: [[0.0; 4]; 5], edges: [[0.0; 4]; 3] };
        let Edges { coefficients, edges: by_axis } = &mut edges;
        let PulseExtent { width, reach: start, origin_spread, scale } = *extent;
        let z = simd.load_quad(&corners[k]) - simd.splat_quad(shear.origin[k]);
        let x = simd.load_quad(&corners[i]) - simd.splat_quad(shear.origin[i]);
        let y = simd.load_quad(&corners[j]) - simd.splat_quad(shear.origin[j]);
        let x = x - simd.splat_quad(shear.slope[0]) * z;
        let y = y - simd.splat_quad(shear.slope[1]) * z;
        let (xn, yn, zn) = (x.rotate(), y.rotate(), z.rotate());
        let c1 = y * zn - z * yn;
        let c2 = z * xn - x * zn;
        let c0 = x * yn - y * xn;
        let mut reach = z.abs() + (x.abs() + y.abs());
        let tilt = (c1.abs() + c2.abs()) * simd.splat_quad(width);
        let mut most = c0.abs() + tilt;
        if MERGED {
            let edge = [xn - x, yn - y, zn - z];
            let turned = edge[2].abs() * simd.splat_quad(2.0 * width);
            let moved = edge[0].abs() + edge[1].abs() + turned;
            // Divisions by a power of two are exact.
            most = most + moved * simd.splat_quad(start / scale);
            reach = reach + simd.splat_quad(4.0 * (origin_spread / scale));
            for n in 0..3 {
                (edge[n] * simd.splat_quad(1.0 / scale)).store_f32(&mut by_axis[n]);
            }
        }
        let reach = reach + reach.rotate();
        let double = reach * reach * simd.splat_quad(DOUBLE);
        let error = most * simd.splat_quad(SINGLE) + double;
        c1.store_f32(&mut coefficients[0]);
        c2.store_f32(&mut coefficients[1]);
        c0.store_f32(&mut coefficients[2]);
        error.store_f32(&mut coefficients[3]);
        (simd.splat_quad(0.0) - error).store_f32(&mut coefficients[4]);
        edges
    }

    /// Of sixteen rays, returns those certainly inside, and those not certainly outside. `offsets` are used
    /// for merged pulses only.
    #[inline(always)]
    pub fn inside<S: Simd, const MERGED: bool>(
        &self,
        simd: S,
        deviations: &Deviations,
        offsets: Option<&OriginOffsets>,
    ) -> (u32, u32) {
        let (di, dj) = (simd.load(&deviations[0]), simd.load(&deviations[1]));
        let [a, b, c] = each_of!([0, 1, 2], n => {
            let [c1, c2, c0, error, negated] =
                each_of!([0, 1, 2, 3, 4], m => simd.splat(self.coefficients[m][n]));
            let mut e = c1 * di + c2 * dj + c0;
            if let Some(offsets) = offsets.filter(|_| MERGED) {
                let [x, y, z] = each_of!([0, 1, 2], m => simd.splat(self.edges[m][n]));
                let [ui, uj, turned] = each_of!([0, 1, 2], m => simd.load(&offsets[m]));
                e = e + ((x * uj - y * ui) + z * turned);
            }
            (error.lt(e), e.lt(negated))
        });
        let strictly = (a.0 & b.0 & c.0) | (a.1 & b.1 & c.1);
        let outside = (a.0 | b.0 | c.0) & (a.1 | b.1 | c.1);
        (strictly.bits(), !outside.bits() & 0xffff)
    }
}
