//! Rotating wedge prisms (spec kinematics §4.6).

use libm::{acos, asin, cos, sin, sincos};
use std::f64::consts::{FRAC_PI_2, TAU};
use vlscan_geom::{DVec3, unit};
use vlscan_survey::Prism;

#[derive(Clone, Debug)]
pub(super) struct PrismTrain {
    prisms: Vec<Wedge>,
    incident: DVec3,
    /// True if total reflection is possible at some time.
    pub may_reflect_totally: bool,
}

#[derive(Clone, Copy, Debug)]
struct Wedge {
    rotor_freq: f64,
    /// The beam enters through the inclined face.
    inclined_first: bool,
    sine: f64,
    cosine: f64,
    /// Ratios of the refractive indices at entry and exit.
    into: f64,
    out_of: f64,
}

impl PrismTrain {
    pub fn new(prisms: &[Prism], air: f64, incident: DVec3) -> PrismTrain {
        let wedge = |p: &Prism| Wedge {
            rotor_freq: p.rotor_freq,
            inclined_first: p.angle > 0.0,
            sine: sin(p.angle.abs()),
            cosine: cos(p.angle.abs()),
            into: air / p.index,
            out_of: p.index / air,
        };
        PrismTrain {
            prisms: prisms.iter().map(wedge).collect(),
            incident,
            may_reflect_totally: may_reflect_totally(prisms, air, incident),
        }
    }

    /// The direction of the beam behind all prisms at `time` seconds; `None` if a prism reflects it totally.
    pub fn refract(&self, time: f64) -> Option<DVec3> {
        self.prisms.iter().try_fold(self.incident, |beam, wedge| wedge.refract(beam, time))
    }
}

impl Wedge {
    fn refract(&self, beam: DVec3, time: f64) -> Option<DVec3> {
        let (s, c) = sincos(TAU * self.rotor_freq * time);
        let flat = DVec3::new(0.0, -1.0, 0.0);
        let inclined = DVec3::new(s * self.sine, -self.cosine, c * self.sine);
        let (first, second) = if self.inclined_first {
            (inclined, flat)
        } else {
            (flat, DVec3::new(-inclined.x, inclined.y, -inclined.z))
        };
        refract_at_face(beam, first, self.into).and_then(|b| refract_at_face(b, second, self.out_of))
    }
}

/// Snell's law for the unit vector `b` at a face with normal `n` towards the beam; `eta` is the ratio of the
/// indices.
fn refract_at_face(b: DVec3, n: DVec3, eta: f64) -> Option<DVec3> {
    let k = -b.dot(n);
    let r2 = eta * eta * (1.0 - k * k);
    (r2 <= 1.0).then(|| unit(b * eta + n * (eta * k - (1.0 - r2).sqrt())))
}

/// True if total reflection is possible at some time. The bound on the beam's tilt is conservative:
/// refraction at a face maps the axis to a known direction and scales distances on the sphere around it by at
/// most the largest slope of Snell's law within reach.
fn may_reflect_totally(prisms: &[Prism], air: f64, incident: DVec3) -> bool {
    let mut tilt = acos(incident.y.clamp(-1.0, 1.0));
    for prism in prisms {
        let wedge = prism.angle.abs();
        let faces = if prism.angle > 0.0 { [wedge, 0.0] } else { [0.0, wedge] };
        for (face, eta) in faces.into_iter().zip([air / prism.index, prism.index / air]) {
            match tilt_behind(tilt, face, eta) {
                Some(behind) => tilt = behind,
                None => return true,
            }
        }
    }
    false
}

/// The largest tilt from the axis behind a face whose normal is tilted by `face`, or `None` if total
/// reflection is possible.
fn tilt_behind(tilt: f64, face: f64, eta: f64) -> Option<f64> {
    let steepest = tilt + face;
    // A margin for rounding.
    if !(steepest < FRAC_PI_2 - 1e-6 && eta * sin(steepest) < 1.0 - 1e-9) {
        return None;
    }
    let axis_moves = (face - asin(eta * sin(face))).abs();
    let slope = eta * cos(steepest) / (1.0 - (eta * sin(steepest)) * (eta * sin(steepest))).sqrt();
    Some(axis_moves + tilt * slope.max(eta))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vlscan_geom::radians;

    fn prism(rotor_freq: f64, degrees: f64, index: f64) -> Prism {
        Prism { rotor_freq, angle: radians(degrees), index }
    }

    #[test]
    fn two_prisms() {
        // spec kinematics §4.6
        let prisms = [prism(-10.0, 18.0, 1.5), prism(5.0, -18.0, 1.5)];
        let expected = [
            [0.039962, 0.954635, -0.295085],
            [0.054483, 0.981528, -0.183394],
            [0.022353, 0.998748, -0.044756],
        ];
        for (i, expected) in expected.into_iter().enumerate() {
            let found = PrismTrain::new(&prisms, 1.0, DVec3::Y).refract((i + 1) as f64 * 0.01).unwrap();
            assert!((found - DVec3::from(expected)).length() < 2e-6, "{found}");
        }
        assert!(!may_reflect_totally(&prisms, 1.0, DVec3::Y));
        let steep = PrismTrain::new(&[prism(1.0, -45.0, 1.5)], 1.0, DVec3::Y);
        assert!(steep.may_reflect_totally && steep.refract(0.0).is_none());
    }

    proptest! {
        #[test]
        fn beams_without_total_reflection_always_leave(
            shapes in prop::collection::vec((-50.0..50.0f64, -60.0..60.0f64, 1.0..1.9f64), 1..4),
            time in 0.0..100.0f64,
        ) {
            let prisms: Vec<Prism> = shapes.into_iter().map(|(f, a, n)| prism(f, a, n)).collect();
            let train = PrismTrain::new(&prisms, 1.0, DVec3::Y);
            if !train.may_reflect_totally {
                let beam = train.refract(time);
                prop_assert!(beam.is_some_and(|b| (b.length() - 1.0).abs() < 1e-12));
            }
        }
    }
}
