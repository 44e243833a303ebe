//! Geometry in double precision: rotations, boxes, angles, map projection, linear equations.
//!
//! Transcendental functions are computed by [`libm`], so that results do not depend on the machine's C
//! library.
//!
//! | file | what it does |
//! |---|---|
//! | `rotation`, `affine`, `aabb` | rotations, affine maps, boxes |
//! | `height_model` | surfaces with one height at each position |
//! | `linear` | linear equations, least squares, medians |
//! | `polygon` | whether a point is inside of a polygon |
//! | `sums` | sums of many equal terms |
//! | `utm` | the map projection |

#![deny(unsafe_code)]

mod aabb;
mod affine;
mod height_model;
mod linear;
mod polygon;
mod rotation;
mod sums;
mod utm;

pub use aabb::Aabb;
pub use affine::Affine;
pub use glam::{DMat3, DVec2, DVec3};
pub use height_model::HeightModel;
pub use linear::{Cholesky, LeastSquares, ScaledCholesky, SymmetricMatrix, median, solve_by_elimination};
pub use polygon::is_inside;
pub use rotation::Rotation;
pub use sums::{add_repeatedly, spacing, steps_in_binade};
pub use utm::{UnknownZone, UtmZone};

/// Speed of light, m/ns.
pub const LIGHT_SPEED: f64 = 0.299_792_458;

/// Maximum absolute coordinate of points and primitives, m. Beyond it double precision does not resolve
/// millimetres.
pub const MAX_COORDINATE: f64 = 1e12;

/// Converts degrees to radians by one multiplication with the constant π/180, so that every angle is rounded
/// alike.
pub fn radians(degrees: f64) -> f64 {
    degrees * (std::f64::consts::PI / 180.0)
}

/// Converts radians to degrees by one multiplication with the constant 180/π.
pub fn degrees(radians: f64) -> f64 {
    radians * (180.0 / std::f64::consts::PI)
}

/// `v` itself or, where its square overflows or underflows, `v` times a power of two, which has the same
/// direction.
pub fn rescaled(v: DVec3) -> DVec3 {
    // 2⁶⁰⁰: brings every finite number but 0 between 1e-143 and 1e128.
    const UP: f64 = f64::from_bits((1023 + 600) << 52);
    match v.abs().max_element() {
        largest if largest > 1e100 => v * (1.0 / UP),
        largest if largest < 1e-100 => v * UP,
        _ => v,
    }
}

/// The unit vector in the direction of `v`, for any length; `None` for the zero vector and for one that is
/// not finite.
pub fn direction(v: DVec3) -> Option<DVec3> {
    Some(unit(rescaled(v))).filter(|unit| v.is_finite() && unit.is_finite())
}

/// `v / |v|`, computed as a multiplication by `1 / sqrt(v·v)`; NaN for the zero vector.
pub fn unit(v: DVec3) -> DVec3 {
    v * (1.0 / v.dot(v).sqrt())
}
