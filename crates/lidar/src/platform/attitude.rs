//! Attitudes that a file states as quaternions and matrices, in the axes of other programs.

use std::f64::consts::FRAC_PI_2;
use vlscan_geom::{DVec3, Rotation};
use vlscan_survey::AngleConvention;

/// Largest deviation of the length of a quaternion, and of the axes of a matrix, from 1.
const MAX_DEVIATION: f64 = 0.01;
/// Message about nine numbers that are not a rotation.
pub(super) const MATRIX_HELP: &str =
    "the matrix is no rotation: its first three columns must have length 1 and be orthogonal";

/// A quaternion that is not a rotation, by its length.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the quaternion's length is {0}, expected 1")]
pub(super) struct QuaternionLength(f64);

/// The rotation of a quaternion w, x, y, z, whose length may differ from 1 by its decimals.
///
/// # Errors
/// A quaternion of another length.
pub(super) fn of_quaternion([w, x, y, z]: [f64; 4]) -> Result<Rotation, QuaternionLength> {
    let u = DVec3::new(x, y, z);
    let length = (w * w + u.dot(u)).sqrt();
    if (length - 1.0).abs() > MAX_DEVIATION || length.is_nan() {
        return Err(QuaternionLength(length));
    }
    Ok(Rotation { w: w / length, u: u / length })
}

/// The rotation of a matrix, row by row; `None` if it is none. From the largest of w, x, y, z (Shepperd,
/// 1978).
pub(super) fn of_matrix(m: [f64; 9]) -> Option<Rotation> {
    let row = |i: usize| DVec3::new(m[3 * i], m[3 * i + 1], m[3 * i + 2]);
    let (a, b, c) = (row(0), row(1), row(2));
    let is_rotation = [a, b, c].iter().all(|axis| (axis.length() - 1.0).abs() <= MAX_DEVIATION)
        && (a.cross(b) - c).length() <= 3.0 * MAX_DEVIATION;
    if !is_rotation {
        return None;
    }
    let (xx, yy, zz) = (m[0], m[4], m[8]);
    let squares = [1.0 + xx + yy + zz, 1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz];
    let largest = (0..4).max_by(|i, j| squares[*i].total_cmp(&squares[*j]))?;
    let (yz, zx, xy) = (m[7] - m[5], m[2] - m[6], m[3] - m[1]);
    let (sxy, szx, syz) = (m[1] + m[3], m[2] + m[6], m[5] + m[7]);
    let [w, x, y, z] = match largest {
        0 => [squares[0], yz, zx, xy],
        1 => [yz, squares[1], sxy, szx],
        2 => [zx, sxy, squares[2], syz],
        _ => [xy, szx, syz, squares[3]],
    };
    let length = (w * w + x * x + y * y + z * z).sqrt();
    Some(Rotation { w: w / length, u: DVec3::new(x, y, z) / length })
}

/// The axes between which a file's rotations turn.
#[derive(Clone, Copy, Debug)]
pub(super) struct FileAxes {
    /// From the platform's axes (right, forward, up) to those of the file's body.
    body: Rotation,
    /// From the axes of the file's world to east, north, up.
    world: Rotation,
    /// True if positions are in the same world axes as the rotations.
    turns_positions: bool,
}

impl FileAxes {
    /// The axes of a convention for quaternions or, if `is_matrix`, for matrices; `None` for conventions of
    /// angles.
    pub fn of(convention: AngleConvention, is_matrix: bool) -> Option<FileAxes> {
        let identity = Rotation::IDENTITY;
        let camera = Rotation::about_x(FRAC_PI_2);
        let (body, world, turns_positions) = match convention {
            AngleConvention::Ros => (Rotation::about_z(-FRAC_PI_2), identity, false),
            AngleConvention::Canonical => (identity, identity, false),
            // Forward, right, down and north, east, down.
            AngleConvention::Heading => {
                let swap = Rotation { w: 0.0, u: DVec3::new(0.5f64.sqrt(), 0.5f64.sqrt(), 0.0) };
                (swap, swap, false)
            }
            // Right, down, forward; the world of matrices is the first camera.
            AngleConvention::Camera if is_matrix => (camera, camera.inverse(), true),
            AngleConvention::Camera => (camera, identity, false),
            AngleConvention::Yaw | AngleConvention::Helios => return None,
        };
        Some(FileAxes { body, world, turns_positions })
    }

    /// The attitude of the platform for a rotation of the file.
    pub fn attitude(&self, rotation: Rotation) -> Rotation {
        self.world.after(rotation).after(self.body)
    }

    /// A position of the file, in the axes east, north, up.
    pub fn position(&self, position: [f64; 3]) -> [f64; 3] {
        if self.turns_positions { self.world.apply(DVec3::from(position)).to_array() } else { position }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vlscan_geom::radians;

    proptest! {
        #[test]
        fn matrices_and_quaternions_are_the_same_rotation(x in -1.0..1.0f64, y in -1.0..1.0f64, z in -1.0..1.0f64, angle in -3.2..3.2f64) {
            prop_assume!(x * x + y * y + z * z > 1e-3);
            let rotation = Rotation::about(DVec3::new(x, y, z), angle);
            let [a, b, c] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| rotation.apply(axis));
            let found = of_matrix([a.x, b.x, c.x, a.y, b.y, c.y, a.z, b.z, c.z]).unwrap();
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                prop_assert!((found.apply(axis) - rotation.apply(axis)).length() < 1e-12);
            }
        }
    }

    #[test]
    fn axes_of_other_programs_become_right_forward_up() {
        let attitude = |convention, is_matrix, rotation| {
            let attitude = FileAxes::of(convention, is_matrix).unwrap().attitude(rotation);
            [attitude.apply(DVec3::X), attitude.forward(), attitude.apply(DVec3::Z)]
        };
        let close = |found: [DVec3; 3], reference: [DVec3; 3]| {
            found.iter().zip(reference).all(|(a, b)| (*a - b).length() < 1e-12)
        };
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        assert!(close(attitude(AngleConvention::Ros, false, Rotation::IDENTITY), [-y, x, z]));
        assert!(close(attitude(AngleConvention::Heading, false, Rotation::IDENTITY), [x, y, z]));
        assert!(close(attitude(AngleConvention::Camera, true, Rotation::IDENTITY), [x, y, z]));
        // A camera in a world with z up that looks to the north.
        assert!(close(attitude(AngleConvention::Camera, false, Rotation::about_x(-FRAC_PI_2)), [x, y, z]));
        let nose_up = Rotation::about_y(radians(30.0));
        let expected = Rotation::of_heading(0.0, radians(30.0), 0.0);
        assert!(close(
            attitude(AngleConvention::Heading, false, nose_up),
            [expected.apply(x), expected.forward(), expected.apply(z)]
        ));
        let turned = FileAxes::of(AngleConvention::Camera, true).unwrap().position([1.0, 2.0, 3.0]);
        assert!((DVec3::from(turned) - DVec3::new(1.0, 3.0, -2.0)).length() < 1e-12);
    }

    #[test]
    fn numbers_that_are_no_rotation_are_refused() {
        assert!(of_matrix([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0]).is_none(), "a mirror");
        assert!(of_matrix([2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]).is_none());
        assert!(of_quaternion([0.0; 4]).is_err() && of_quaternion([f64::NAN, 0.0, 0.0, 1.0]).is_err());
        assert_eq!(of_quaternion([1.001, 0.0, 0.0, 0.0]).unwrap(), Rotation::IDENTITY);
        assert!(FileAxes::of(AngleConvention::Yaw, false).is_none());
    }
}
