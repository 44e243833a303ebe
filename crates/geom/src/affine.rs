//! Affine maps: rotations, reflections, translations and their compositions.

use super::{DVec3, Rotation};

/// The map `p ↦ A·p + shift`. Composition rounds, so that a product depends on the order of evaluation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    /// Images of the unit vectors x, y and z, without the shift.
    pub columns: [DVec3; 3],
    /// Image of the origin, m.
    pub shift: DVec3,
}

impl Affine {
    /// The identity map: unit columns, no shift.
    pub const IDENTITY: Affine = Affine { columns: [DVec3::X, DVec3::Y, DVec3::Z], shift: DVec3::ZERO };

    /// Translation by `by`, m.
    pub fn translation(by: DVec3) -> Affine {
        Affine { shift: by, ..Affine::IDENTITY }
    }

    /// Rotation about an axis through the origin.
    pub fn rotation(r: &Rotation) -> Affine {
        Affine { columns: [DVec3::X, DVec3::Y, DVec3::Z].map(|e| r.apply(e)), shift: DVec3::ZERO }
    }

    /// Reflection at the plane through the origin with unit normal `normal`.
    pub fn reflection(normal: DVec3) -> Affine {
        let columns = [DVec3::X, DVec3::Y, DVec3::Z].map(|e| e - normal * (2.0 * normal.dot(e)));
        Affine { columns, shift: DVec3::ZERO }
    }

    /// The image of a direction or displacement `v`: the linear part only, without the shift.
    pub fn apply_to_vector(&self, v: DVec3) -> DVec3 {
        let [x, y, z] = self.columns;
        x * v.x + y * v.y + z * v.z
    }

    /// The image of the point `p`, m: linear part and shift.
    pub fn apply(&self, p: DVec3) -> DVec3 {
        self.apply_to_vector(p) + self.shift
    }

    /// `self ∘ first`: the map that applies `first` and then `self`.
    pub fn after(&self, first: &Affine) -> Affine {
        Affine { columns: first.columns.map(|c| self.apply_to_vector(c)), shift: self.apply(first.shift) }
    }

    /// This map about `centre` instead of the origin.
    pub fn about(&self, centre: DVec3) -> Affine {
        Affine { shift: (self.shift + centre) - self.apply_to_vector(centre), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        [-100.0..100.0, -100.0..100.0, -100.0..100.0f64].prop_map(DVec3::from)
    }

    proptest! {
        #[test]
        fn maps_compose_and_keep_distances(p in point(), q in point(), c in point(), a in -7.0..7.0f64, n in point()) {
            prop_assume!(n.length() > 1e-3);
            let n = n.normalize();
            let turn = Affine::rotation(&Rotation::about(n, a)).about(c);
            let mirror = Affine::reflection(n).after(&Affine::translation(q));
            let both = turn.after(&mirror);
            prop_assert!((both.apply(p) - turn.apply(mirror.apply(p))).length() < 1e-10);
            prop_assert!((turn.apply(c) - c).length() < 1e-11);
            prop_assert!(((both.apply(p) - both.apply(q)).length() - (p - q).length()).abs() < 1e-10);
            prop_assert!((turn.apply_to_vector(p) - Rotation::about(n, a).apply(p)).length() < 1e-11);
        }
    }

    #[test]
    fn translations_and_identities_are_exact() {
        let p = DVec3::new(0.1, -0.7, 3e9);
        assert_eq!(Affine::IDENTITY.apply(p), p);
        let half = Affine::translation(DVec3::Y * 0.5);
        assert_eq!(half.after(&half).apply(p), p + DVec3::Y);
        assert_eq!(Affine::reflection(DVec3::X).apply(p), DVec3::new(-0.1, -0.7, 3e9));
    }
}
