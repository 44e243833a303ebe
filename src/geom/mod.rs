//! Geometry in double precision: rotations, boxes, angles, map projection.
//!
//! Transcendental functions come from [`libm`], so that results do not depend on the machine's C library.

mod aabb;
mod affine;
mod rotation;
mod utm;

pub use aabb::Aabb;
pub use affine::Affine;
pub use glam::DVec3;
pub use rotation::Rotation;
pub use utm::UtmZone;

/// Speed of light in metres per nanosecond.
pub const LIGHT_SPEED: f64 = 0.299_792_458;

/// Degrees to radians: one multiplication by the constant π/180, so that every angle rounds alike.
pub fn radians(degrees: f64) -> f64 {
    degrees * (std::f64::consts::PI / 180.0)
}

/// Radians to degrees: one multiplication by the constant 180/π.
pub fn degrees(radians: f64) -> f64 {
    radians * (180.0 / std::f64::consts::PI)
}

/// `v / |v|` as a multiplication by `1 / sqrt(v·v)`; the zero vector gives NaN.
pub fn unit(v: DVec3) -> DVec3 {
    v * (1.0 / v.dot(v).sqrt())
}
