//! The tree's own frame: single precision around the scene's centre.

use vlscan_geom::{Aabb, DVec3};

/// Maps scene coordinates to the tree's frame: subtracts `origin`, then multiplies by the power of two
/// `scale` that brings every primitive within [-1, 1]. Rounding a local coordinate to `f32` therefore changes
/// it by at most [`Frame::ROUNDING`], for any size and position of the scene.
#[derive(Clone, Copy, Debug, serde::Serialize, serde::Deserialize)]
pub struct Frame {
    /// Scene coordinates of the centre of the scene's bounds, m.
    pub origin: DVec3,
    /// Power of two from metres to local units.
    pub scale: f64,
}

impl Frame {
    /// Maximum error of a local coordinate rounded to the nearest `f32`.
    pub const ROUNDING: f64 = 1.0 / (1u64 << 25) as f64;

    /// Returns the frame of a scene with these bounds; for an empty scene any frame is valid.
    pub fn around(bounds: &Aabb) -> Frame {
        if bounds.is_empty() {
            return Frame { origin: DVec3::ZERO, scale: 1.0 };
        }
        let origin = bounds.min * 0.5 + bounds.max * 0.5;
        let radius = (bounds.max * 0.5 - bounds.min * 0.5).max_element();
        let exponent = if radius > 0.0 { libm::ilogb(radius) + 1 } else { 0 };
        // At exponents near the ends of the range the scale itself must remain a normal number.
        Frame { origin, scale: libm::ldexp(1.0, -exponent.clamp(-1000, 1000)) }
    }

    pub(crate) fn local(&self, p: DVec3) -> DVec3 {
        (p - self.origin) * self.scale
    }

    /// Returns the smallest box of `f32` around a scene box.
    pub fn local_box(&self, b: &Aabb) -> ([f32; 3], [f32; 3]) {
        (self.local(b.min).to_array().map(below), self.local(b.max).to_array().map(above))
    }
}

/// The largest `f32` not above `x`.
pub(crate) fn below(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) > x { y.next_down() } else { y }
}

/// The smallest `f32` not below `x`.
pub(crate) fn above(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) < x { y.next_up() } else { y }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_scene_fills_the_unit_cube() {
        for (centre, radius) in [(0.0, 1.0), (5.4e6, 300.0), (-1e300, 1e290), (0.0, 1e-300), (3.0, 0.0)] {
            let b = Aabb { min: DVec3::splat(centre - radius), max: DVec3::splat(centre + radius) };
            let f = Frame::around(&b);
            let (lo, hi) = f.local_box(&b);
            for a in 0..3 {
                assert!(
                    (-1.0..=0.0).contains(&lo[a]) && (0.0..=1.0).contains(&hi[a]),
                    "{centre} {radius} {lo:?}"
                );
            }
            if radius > 0.0 {
                assert!(hi[0] - lo[0] >= 0.99, "{centre} {radius}: {lo:?} {hi:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn rounding_is_outward_and_tight(x in -1.0..1.0f64) {
            let (lo, hi) = (f64::from(below(x)), f64::from(above(x)));
            prop_assert!(lo <= x && x <= hi && hi - lo <= 2.0 * Frame::ROUNDING);
            prop_assert!((f64::from(x as f32) - x).abs() <= Frame::ROUNDING);
        }
    }
}
