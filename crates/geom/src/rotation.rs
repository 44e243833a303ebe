//! Rotations as unit quaternions, with the composition and angle conventions of the survey formats.

use super::{DVec3, unit};
use libm::{acos, asin, atan2, sincos};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A right-handed rotation of vectors, stored as the quaternion `w + u`.
///
/// Products are not re-normalised: simulated motion composes rotations in a fixed order, and their last
/// digits are part of the result (spec kinematics §0.2).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rotation {
    /// Scalar part, cos(θ/2).
    pub w: f64,
    /// Vector part, sin(θ/2)·axis.
    pub u: DVec3,
}

impl Rotation {
    /// The identity.
    pub const IDENTITY: Rotation = Rotation { w: 1.0, u: DVec3::ZERO };

    /// Right-handed rotation by `angle` (rad) about `axis`, of any length.
    pub fn about(axis: DVec3, angle: f64) -> Rotation {
        let (sin, cos) = sincos(angle * 0.5);
        Rotation { w: cos, u: unit(axis) * sin }
    }

    /// Rotation by `angle` (rad) about x.
    #[inline]
    pub fn about_x(angle: f64) -> Rotation {
        let (sin, cos) = sincos(angle * 0.5);
        Rotation { w: cos, u: DVec3::new(sin, 0.0, 0.0) }
    }

    /// Rotation by `angle` (rad) about y.
    #[inline]
    pub fn about_y(angle: f64) -> Rotation {
        let (sin, cos) = sincos(angle * 0.5);
        Rotation { w: cos, u: DVec3::new(0.0, sin, 0.0) }
    }

    /// Rotation by `angle` (rad) about z.
    #[inline]
    pub fn about_z(angle: f64) -> Rotation {
        let (sin, cos) = sincos(angle * 0.5);
        Rotation { w: cos, u: DVec3::new(0.0, 0.0, sin) }
    }

    /// `self ∘ first`: the rotation that applies `first` and then `self` (Hamilton product).
    #[inline]
    pub fn after(&self, first: Rotation) -> Rotation {
        let (a, b) = (self, first);
        Rotation {
            w: a.w * b.w - (a.u.x * b.u.x + a.u.y * b.u.y + a.u.z * b.u.z),
            u: DVec3::new(
                a.u.x * b.w + a.w * b.u.x + (a.u.y * b.u.z - a.u.z * b.u.y),
                a.u.y * b.w + a.w * b.u.y + (a.u.z * b.u.x - a.u.x * b.u.z),
                a.u.z * b.w + a.w * b.u.z + (a.u.x * b.u.y - a.u.y * b.u.x),
            ),
        }
    }

    /// Rotates a vector: `2[w(w v + u×v) + (u·v)u] − v`.
    #[inline]
    pub fn apply(&self, v: DVec3) -> DVec3 {
        let (w, u) = (self.w, self.u);
        let s = u.x * v.x + u.y * v.y + u.z * v.z;
        DVec3::new(
            2.0 * (w * (v.x * w + (u.y * v.z - u.z * v.y)) + s * u.x) - v.x,
            2.0 * (w * (v.y * w + (u.z * v.x - u.x * v.z)) + s * u.y) - v.y,
            2.0 * (w * (v.z * w + (u.x * v.y - u.y * v.x)) + s * u.z) - v.z,
        )
    }

    /// The inverse rotation.
    pub fn inverse(&self) -> Rotation {
        Rotation { w: self.w, u: -self.u }
    }

    /// The image of the instrument's forward axis +Y: the direction of a beam with this attitude.
    #[inline]
    pub fn forward(&self) -> DVec3 {
        self.apply(DVec3::Y)
    }

    /// The smallest rotation from direction `a` to direction `b`, both of any length. Opposite directions are
    /// rotated by π about a fixed perpendicular axis. A zero vector yields NaN.
    pub fn between(a: DVec3, b: DVec3) -> Rotation {
        let lengths = a.length() * b.length();
        let dot = a.dot(b);
        if dot < (2e-15 - 1.0) * lengths {
            let ah = unit(a);
            return Rotation { w: 0.0, u: unit(ah.cross(DVec3::new(ah.z, ah.x, ah.y))) };
        }
        let w = ((1.0 + dot / lengths) * 0.5).sqrt();
        Rotation { w, u: a.cross(b) * (1.0 / (2.0 * w * lengths)) }
    }

    /// The rotation that takes the axes x, y and z to `columns`: orthogonal unit vectors, right-handed.
    pub fn of_columns([x, y, z]: [DVec3; 3]) -> Rotation {
        // Four times the squares of w and u. The largest one is the divisor, so that no digits are lost.
        let squares =
            [1.0 + x.x + y.y + z.z, 1.0 + x.x - y.y - z.z, 1.0 - x.x + y.y - z.z, 1.0 - x.x - y.y + z.z];
        let largest = (1..4).fold(0, |best, i| if squares[i] > squares[best] { i } else { best });
        let root = squares[largest].max(0.0).sqrt();
        let (whole, part) = (0.5 * root, 0.5 / root);
        let differences = DVec3::new(y.z - z.y, z.x - x.z, x.y - y.x) * part;
        let [xy, xz, yz] = [(x.y + y.x) * part, (x.z + z.x) * part, (y.z + z.y) * part];
        let (w, u) = match largest {
            0 => (whole, differences),
            1 => (differences.x, DVec3::new(whole, xy, xz)),
            2 => (differences.y, DVec3::new(xy, whole, yz)),
            _ => (differences.z, DVec3::new(xz, yz, whole)),
        };
        if w < 0.0 { Rotation { w: -w, u: -u } } else { Rotation { w, u } }
    }

    /// Axis and angle, the angle within [0, π]; the axis of the identity is +X.
    pub fn axis_angle(&self) -> (DVec3, f64) {
        let length = self.u.length();
        if length == 0.0 {
            return (DVec3::X, 0.0);
        }
        let angle = if self.w.abs() > 0.1 { 2.0 * asin(length.min(1.0)) } else { 2.0 * acos(self.w.abs()) };
        (self.u * (if self.w < 0.0 { -1.0 } else { 1.0 } / length), angle)
    }

    /// The attitude of a body (axes right, forward, up) in the local horizontal frame (axes east, north, up):
    /// heading clockwise from north, then pitch with the nose up, then roll with the right side down, all in
    /// radians. This is the order of ARINC 705 and DIN 9300, `R3(ψ) R2(θ) R1(φ)` between forward-right-down
    /// and north-east-down, which becomes `Rz(−heading) ∘ Rx(pitch) ∘ Ry(roll)` in the axes used here (x and
    /// y swapped, z negated).
    pub fn of_heading(roll: f64, pitch: f64, heading: f64) -> Rotation {
        Rotation::about_z(-heading).after(Rotation::about_x(pitch)).after(Rotation::about_y(roll))
    }

    /// Roll, pitch and heading (rad, heading within [0, 2π)) from which [`Rotation::of_heading`] composes
    /// this attitude. Roll is 0 where the nose points straight up or down.
    pub fn heading_angles(&self) -> [f64; 3] {
        let (right, nose, up) = (self.apply(DVec3::X), self.forward(), self.apply(DVec3::Z));
        let level = (nose.x * nose.x + nose.y * nose.y).sqrt();
        let pitch = atan2(nose.z, level);
        let (roll, heading) = if level > 1e-9 {
            (atan2(-right.z, up.z), atan2(nose.x, nose.y))
        } else {
            (0.0, atan2(-right.y, right.x))
        };
        let heading = if heading < 0.0 { heading + TAU } else { heading };
        // The sum of a tiny negative angle and 2π rounds to 2π. Adding 0 removes negative zeros.
        [roll + 0.0, pitch + 0.0, if heading < TAU { heading + 0.0 } else { 0.0 }]
    }

    /// Angles (a, b, c), rad, with `self = Rx(a) ∘ Ry(b) ∘ Rz(c)`; `None` at gimbal lock (|sin b| >
    /// 0.9999999999).
    pub fn angles_xyz(&self) -> Option<[f64; 3]> {
        let k = self.apply(DVec3::Z);
        let m = self.inverse().apply(DVec3::X);
        (m.z.abs() <= 0.9999999999).then(|| [atan2(-k.y, k.z), asin(m.z), atan2(-m.y, m.x)])
    }

    /// Angles (a, b, c), rad, with `self = Rz(a) ∘ Ry(b) ∘ Rx(c)`; `None` at gimbal lock (|sin b| >
    /// 0.9999999999).
    pub fn angles_zyx(&self) -> Option<[f64; 3]> {
        let i = self.apply(DVec3::X);
        let n = self.inverse().apply(DVec3::Z);
        (n.x.abs() <= 0.9999999999).then(|| [atan2(i.y, i.x), -asin(n.x), atan2(n.y, n.z)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radians;

    fn close(a: DVec3, b: [f64; 3]) {
        assert!((a - DVec3::from(b)).length() < 1e-6, "{a} is not {b:?}");
    }

    #[test]
    fn mount_example() {
        // spec kinematics §0.4: rot x −90 then rot z 90, fixed axes
        let m = Rotation::about_z(radians(90.0)).after(Rotation::about_x(radians(-90.0)));
        close(m.forward(), [0.0, 0.0, -1.0]);
        close(m.apply(DVec3::X), [0.0, 1.0, 0.0]);
        let (z, y) = (Rotation::about_z(radians(90.0)), Rotation::about_y(radians(-30.0)));
        close(y.after(z).forward(), [-0.866025, 0.0, -0.5]);
        close(z.after(y).forward(), [-1.0, 0.0, 0.0]);
    }

    #[test]
    fn mounting_chain_example() {
        // spec kinematics §3.1: an eastbound platform, mirror at 20°
        let m = Rotation::about_z(radians(90.0)).after(Rotation::about_x(radians(-90.0)));
        let p = Rotation::about_z(radians(-90.0));
        let g = p.after(m).after(Rotation::about_x(radians(20.0)));
        close(g.forward(), [0.0, 0.342020, -0.939693]);
        let b = Rotation::about_z(radians(30.0)).after(Rotation::about_y(radians(10.0)));
        close(
            p.after(m).after(b).after(Rotation::about_x(radians(20.0))).forward(),
            [-0.418412, 0.336824, -0.843493],
        );
    }

    #[test]
    fn columns_are_the_images_of_the_axes() {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let slanted = DVec3::new(-0.3, 0.7, 0.2);
        for axis in axes.into_iter().chain([slanted]) {
            for angle in [0.0, 1e-9, 0.4, 1.6, 3.0, std::f64::consts::PI] {
                let turn = Rotation::about(axis, angle);
                let found = Rotation::of_columns(axes.map(|e| turn.apply(e)));
                assert!((found.w * found.w + found.u.length_squared() - 1.0).abs() < 1e-12);
                assert!(found.w >= 0.0);
                for e in axes.into_iter().chain([slanted]) {
                    let off = (found.apply(e) - turn.apply(e)).length();
                    assert!(off < 1e-12, "{axis} {angle}: {off}");
                }
            }
        }
    }

    #[test]
    fn angle_triples_invert_their_compositions() {
        let (x, y, z) = (Rotation::about_x(0.3), Rotation::about_y(-0.7), Rotation::about_z(2.1));
        let a = x.after(y).after(z).angles_xyz().unwrap();
        assert!((a[0] - 0.3).abs() < 1e-12 && (a[1] + 0.7).abs() < 1e-12 && (a[2] - 2.1).abs() < 1e-12);
        let b = z.after(y).after(x).angles_zyx().unwrap();
        assert!((b[0] - 2.1).abs() < 1e-12 && (b[1] + 0.7).abs() < 1e-12 && (b[2] - 0.3).abs() < 1e-12);
        assert!(Rotation::about_y(std::f64::consts::FRAC_PI_2).angles_xyz().is_none());
    }

    #[test]
    fn headings_compose_with_roll_innermost() {
        // Columns of the direction cosine matrix (Titterton & Weston 2004, eq. 3.63, body to north-east-down
        // navigation frame) at round angles: roll 30°, pitch 45°, heading 90°.
        let a = Rotation::of_heading(radians(30.0), radians(45.0), radians(90.0));
        let (h, q) = (0.5f64.sqrt(), 3f64.sqrt() / 2.0);
        // forward in NED: (cos θ cos ψ, cos θ sin ψ, −sin θ) = (0, √½, −√½); east-north-up swaps x and y and
        // negates z.
        close(a.forward(), [h, 0.0, h]);
        // right in NED: (sin φ sin θ cos ψ − cos φ sin ψ, sin φ sin θ sin ψ + cos φ cos ψ, sin φ cos θ).
        close(a.apply(DVec3::X), [0.5 * h, -q, -0.5 * h]);
        // down in NED: (cos φ sin θ cos ψ + sin φ sin ψ, cos φ sin θ sin ψ − sin φ cos ψ, cos φ cos θ).
        close(a.apply(-DVec3::Z), [q * h, 0.5, -q * h]);
    }

    #[test]
    fn heading_angles_invert_their_composition() {
        let cases =
            [[0.1, -0.2, 5.0], [0.0, 0.0, 0.0], [-1.5, 0.3, 3.0], [2.8, 1.2, 0.5], [0.0, -1e-3, TAU - 1e-17]];
        for [roll, pitch, heading] in cases {
            let attitude = Rotation::of_heading(roll, pitch, heading);
            let found = attitude.heading_angles();
            assert!(
                found.iter().zip([roll, pitch, heading]).all(|(f, w)| {
                    let off = (f - w).rem_euclid(TAU);
                    off.min(TAU - off) < 1e-12
                }),
                "{found:?} is not {roll} {pitch} {heading}"
            );
            assert!((0.0..TAU).contains(&found[2]));
        }
        let straight_up = Rotation::of_heading(0.4, TAU / 4.0, 1.0);
        let [roll, pitch, heading] = straight_up.heading_angles();
        assert_eq!(roll, 0.0);
        close(Rotation::of_heading(roll, pitch, heading).apply(DVec3::X), straight_up.apply(DVec3::X).into());
    }

    #[test]
    fn between_takes_one_direction_to_the_other() {
        let (a, b) = (DVec3::new(0.3, -2.0, 1.0), DVec3::new(-1.0, 0.2, 0.4));
        close(Rotation::between(a, b).apply(unit(a)), unit(b).into());
        close(Rotation::between(DVec3::Y, -DVec3::Y).apply(DVec3::Y), [0.0, -1.0, 0.0]);
    }
}
