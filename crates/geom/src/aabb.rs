//! Axis-aligned boxes.

use super::DVec3;
use serde::{Deserialize, Serialize};

/// An axis-aligned box in metres. Empty when `min` exceeds `max` on any axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// Lowest coordinates.
    pub min: DVec3,
    /// Highest coordinates.
    pub max: DVec3,
}

impl Default for Aabb {
    fn default() -> Aabb {
        Aabb::EMPTY
    }
}

impl Aabb {
    /// The empty box, the neutral element of [`Aabb::union`].
    pub const EMPTY: Aabb = Aabb { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The smallest box around points.
    pub fn around(points: impl IntoIterator<Item = DVec3>) -> Aabb {
        points.into_iter().fold(Aabb::EMPTY, Aabb::with)
    }

    /// This box grown to contain `p`.
    pub fn with(self, p: DVec3) -> Aabb {
        Aabb { min: self.min.min(p), max: self.max.max(p) }
    }

    /// The smallest box around both.
    pub fn union(self, other: Aabb) -> Aabb {
        Aabb { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The middle of the box.
    pub fn centre(&self) -> DVec3 {
        (self.min + self.max) * 0.5
    }

    /// Edge lengths, m.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// True if the box holds no point.
    pub fn is_empty(&self) -> bool {
        self.min.x > self.max.x || self.min.y > self.max.y || self.min.z > self.max.z
    }

    /// The box moved by `offset`.
    pub fn translated(&self, offset: DVec3) -> Aabb {
        Aabb { min: self.min + offset, max: self.max + offset }
    }

    /// The interval `[t_in, t_out]` in which the line `origin + t·direction` is within the box, in units of
    /// `direction`; `None` if the line misses the box. Either end may be negative.
    #[inline]
    pub fn slabs(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let (mut t_in, mut t_out) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            // Decided by the sign bit, because division by -0.0 swaps the infinities.
            let (near, far) = if direction[axis].is_sign_negative() {
                (self.max[axis], self.min[axis])
            } else {
                (self.min[axis], self.max[axis])
            };
            let a = (near - origin[axis]) / direction[axis];
            let b = (far - origin[axis]) / direction[axis];
            // 0/0, for a line within the plane of a face, is NaN and leaves the interval unchanged.
            if a > t_in {
                t_in = a;
            }
            if b < t_out {
                t_out = b;
            }
        }
        (t_in <= t_out).then_some((t_in, t_out))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::unit;

    #[test]
    fn slab_interval_of_the_worked_example() {
        // spec pulse-physics §2.8 (a)
        let b = Aabb { min: DVec3::new(-1.0, 9.0, -1.0), max: DVec3::new(3.0, 11.0, 4.0) };
        let (t_in, t_out) = b.slabs(DVec3::ZERO, unit(DVec3::new(0.1, 0.8, 0.2))).unwrap();
        assert!((t_in - 9.344951845782834).abs() < 1e-12);
        assert!((t_out - 11.421607811512352).abs() < 1e-12);
    }

    #[test]
    fn lines_parallel_to_faces_hit_or_miss_whatever_the_sign_of_zero() {
        let b = Aabb { min: DVec3::ZERO, max: DVec3::ONE };
        for zero in [0.0, -0.0] {
            let direction = DVec3::new(zero, 1.0, zero);
            assert_eq!(b.slabs(DVec3::new(0.5, -1.0, 0.5), direction), Some((1.0, 2.0)));
            assert_eq!(b.slabs(DVec3::new(2.0, -1.0, 0.5), direction), None);
            assert_eq!(b.slabs(DVec3::new(-2.0, -1.0, 0.5), direction), None);
        }
        assert!(Aabb::EMPTY.is_empty() && !b.is_empty());
    }
}
