//! Recognises quaternions and matrices in numbers without names, and cameras by their way.

use super::fix::{Fix, FixPlace};
use crate::platform::attitude::of_matrix;
use vlscan_geom::DVec3;

/// Distance after which the way of a body is compared with its axes, m.
const COMPARED_DISTANCE: f64 = 20.0;
/// The same for a body whose z axis is that of the file: a camera in its own frame, or a drone that climbs
/// before it flies away, m.
const COMPARED_AFTER_CLIMB: f64 = 150.0;
/// Minimum cosine of the angle between the way and the z axis of a body that is probably a camera: 26°.
const MIN_CAMERA_COSINE: f64 = 0.9;

/// Possible layouts of rows of numbers without names.
#[derive(Debug, PartialEq)]
pub(super) enum Numbers {
    /// At most seven numbers.
    Unknown,
    TooMany(usize),
    QuaternionWithoutTime,
    TimedQuaternion,
    /// Three rows of four numbers.
    Matrix,
    /// Time and this many rows of four numbers.
    TimedMatrix(usize),
}

/// Recognises quaternions and matrices in the first line.
pub(super) fn recognise(numbers: &[f64]) -> Numbers {
    let is_unit = |quaternion: &[f64], tolerance: f64| {
        let squares: f64 = quaternion.iter().map(|part| part * part).sum();
        (squares.sqrt() - 1.0).abs() < tolerance
    };
    let is_matrix = |m: &[f64]| {
        let rotation = [0, 1, 2, 4, 5, 6, 8, 9, 10].map(|place| m[place]);
        of_matrix(rotation).is_some() && (m.len() == 12 || m[12..] == [0.0, 0.0, 0.0, 1.0])
    };
    match numbers.len() {
        // A level robot at z = 1 m has four such numbers, too, but small angles.
        7 if is_unit(&numbers[3..], 1e-4) && numbers[4..].iter().any(|part| part.abs() > 0.05) => {
            Numbers::QuaternionWithoutTime
        }
        0..=7 => Numbers::Unknown,
        8 if is_unit(&numbers[4..], 0.01) => Numbers::TimedQuaternion,
        12 if is_matrix(numbers) => Numbers::Matrix,
        13 if is_matrix(&numbers[1..]) => Numbers::TimedMatrix(3),
        17 if is_matrix(&numbers[1..]) => Numbers::TimedMatrix(4),
        count => Numbers::TooMany(count),
    }
}

/// True if the body of a time, a position and a quaternion is upright with w first, as EuRoC writes
/// quaternions, and upside down with w last.
pub(super) fn is_upright_with_w_first(numbers: &[f64]) -> bool {
    let &[_, _, _, _, a, b, c, _] = numbers else { return false };
    // The vertical component of the body's z axis, by x and y of the quaternion.
    let up = |x: f64, y: f64| 1.0 - 2.0 * (x * x + y * y);
    up(a, b) < -0.5 && up(b, c) > 0.5
}

/// Compares the way of a body with its axes.
#[derive(Debug, Default)]
pub(super) struct CameraCheck {
    start: Option<DVec3>,
    is_over: bool,
}

impl CameraCheck {
    /// True if the body has now moved along its z axis far enough to be a camera, which looks along z.
    pub fn finds(&mut self, fix: &Fix) -> bool {
        let FixPlace::Local(position) = fix.place else { return false };
        let position = DVec3::from(position);
        let way = position - *self.start.get_or_insert(position);
        if self.is_over || way.length() < COMPARED_DISTANCE {
            return false;
        }
        let axis = fix.attitude.apply(DVec3::Z);
        // A body whose z axis points up may climb along it, which its further way shows.
        let may_climb = axis.z.abs() > MIN_CAMERA_COSINE;
        if may_climb && way.length() < COMPARED_AFTER_CLIMB {
            return false;
        }
        self.is_over = true;
        way.dot(axis) > MIN_CAMERA_COSINE * way.length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn upright_bodies_tell_the_place_of_w() {
        let is = |[a, b, c, d]: [f64; 4]| is_upright_with_w_first(&[9.0, 1.0, 2.0, 3.0, a, b, c, d]);
        assert!(is([1.0, 0.0, 0.0, 0.0]) && is([0.995, 0.05, -0.05, 0.07]));
        // The camera of a handheld recording that looks down.
        assert!(!is([0.0, 0.0, 0.0, 1.0]) && !is([0.6574, 0.6126, -0.2949, -0.3248]));
    }

    #[test]
    fn numbers_are_recognised_by_their_count_and_length() {
        let of =
            |text: &str| recognise(&text.split(' ').map(|word| word.parse().unwrap()).collect::<Vec<_>>());
        for (line, expected) in [
            ("1 2 3 4 5 6 7", Numbers::Unknown),
            ("100 0 0 1 0 0 0", Numbers::Unknown),
            ("100 5 5 1 0.003 -0.002 0.01", Numbers::Unknown),
            ("1 2 3 0.3826834 0 0 0.9238795", Numbers::QuaternionWithoutTime),
            ("1 2 3 4 0.3826834 0 0 0.9238795", Numbers::TimedQuaternion),
            ("1 2 3 4 0 0 0 1", Numbers::TimedQuaternion),
            ("1 2 3 4 5 6 7 8", Numbers::TooMany(8)),
            ("1 0 0 5 0 1 0 6 0 0 1 7", Numbers::Matrix),
            ("9 0 -1 0 5 1 0 0 6 0 0 1 7", Numbers::TimedMatrix(3)),
            ("9 0 -1 0 5 1 0 0 6 0 0 1 7 0 0 0 1", Numbers::TimedMatrix(4)),
            ("9 0 -1 0 5 1 0 0 6 0 0 1 7 0 0 0 2", Numbers::TooMany(17)),
            ("9 0 -1 0 5 1 0 0 6 0 0 2 7", Numbers::TooMany(13)),
        ] {
            assert_eq!(of(line), expected, "{line}");
        }
    }
}
