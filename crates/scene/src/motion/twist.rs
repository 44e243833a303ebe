//! Velocities of rigid bodies.

use libm::{atan2, tan};
use vlscan_geom::{Affine, DVec3};

/// Angle below which the coefficient of the translation is that of its series, rad.
const SMALL_ANGLE: f64 = 1e-3;
/// Sine of the angle from which on the axis of a map is unknown: half turns in a single step.
const MIN_SINE: f64 = 1e-9;

/// Velocity of a rigid body: that of its point p is `rotation` × p + `translation`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Axis times angle, rad per unit of time.
    pub rotation: DVec3,
    /// Velocity of the origin, m per unit of time.
    pub translation: DVec3,
}

impl Twist {
    /// A body at rest.
    pub const ZERO: Twist = Twist { rotation: DVec3::ZERO, translation: DVec3::ZERO };

    /// The even motion that results in a map after a unit of time: the logarithm of the map. Reflections, and
    /// half turns in a step, are no motions.
    pub fn of(map: &Affine) -> Twist {
        let [x, y, z] = map.columns;
        if x.cross(y).dot(z) <= 0.0 {
            return Twist::ZERO;
        }
        let axis = DVec3::new(y.z - z.y, z.x - x.z, x.y - y.x) * 0.5;
        let sine = axis.length();
        let angle = atan2(sine, 0.5 * (x.x + y.y + z.z - 1.0));
        if sine < MIN_SINE && angle > 1.0 {
            return Twist::ZERO;
        }
        let rotation = if sine > 0.0 { axis * (angle / sine) } else { DVec3::ZERO };
        // V⁻¹·shift with V⁻¹ = 1 − φ×/2 + k·(φ×)².
        let k = if angle < SMALL_ANGLE {
            1.0 / 12.0 + angle * angle / 720.0
        } else {
            (1.0 - 0.5 * angle / tan(0.5 * angle)) / (angle * angle)
        };
        let turned = rotation.cross(map.shift);
        Twist { rotation, translation: map.shift - turned * 0.5 + rotation.cross(turned) * k }
    }

    /// Both motions at once.
    #[must_use]
    pub fn with(self, other: Twist) -> Twist {
        Twist { rotation: self.rotation + other.rotation, translation: self.translation + other.translation }
    }

    /// The motion `factor` times as fast.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Twist {
        Twist { rotation: self.rotation * factor, translation: self.translation * factor }
    }

    /// Velocity at a point, m per unit of time.
    pub fn at(&self, point: DVec3) -> DVec3 {
        self.rotation.cross(point) + self.translation
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::Rotation;

    #[test]
    fn the_logarithm_of_a_screw_is_its_motion() {
        for angle in [0.0, 1e-7, 5e-4, 9.99e-4, 1.01e-3, 0.3, 2.5] {
            for axis in [DVec3::X, DVec3::new(0.6, 0.0, -0.8)] {
                let centre = DVec3::new(3.0, -1.0, 2.0);
                let turn = Affine::rotation(&Rotation::about(axis, angle)).about(centre);
                let map = Affine::translation(axis * 0.25).after(&turn);
                let twist = Twist::of(&map);
                assert!((twist.rotation - axis * angle).length() < 1e-15 + 1e-13 * angle, "{angle}");
                for point in [DVec3::ZERO, centre, DVec3::new(-4.0, 5.0, 6.0)] {
                    let expected = (axis * angle).cross(point - centre) + axis * 0.25;
                    assert!((twist.at(point) - expected).length() < 2e-12, "{angle}: {:?}", twist.at(point));
                }
            }
        }
        assert_eq!(Twist::of(&Affine::reflection(DVec3::Z)), Twist::ZERO);
        assert_eq!(Twist::of(&Affine::translation(DVec3::Y)).at(DVec3::X), DVec3::Y);
    }
}
