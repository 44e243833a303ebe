//! Light that mirrors, panes and flat water send straight back into the receiver.
//!
//! Behind a mirror that faces the instrument lies the image of its transmitter. The receiver, whose aperture
//! has the radius a, takes the part of the beam of this image that falls on it. A Gaussian beam has the 1/e²
//! radius w there, at the length L of the way there and back. At a distance p between the axis of the image
//! and the centre of the aperture that part is the integral of the normal distribution over a disc,
//!
//! ```text
//! S = ∫ 2/(πw²)·e^(−2|x − p|²/w²) dx,  |x| ≤ a;  S = 1 − e^(−2a²/w²) for p = 0.
//! ```
//!
//! A perfect Lambert surface at the range L/2 sends the share (2a/L)² of the light into the aperture, so that
//! the reflectance factor of the mirror is S·(L/(2a))² times the share of the light that it mirrors.

use super::footprint::Footprint;
use libm::{asin, cos, erf, exp, hypot, sincos, sqrt};
use std::f64::consts::{PI, SQRT_2};
use vlscan_geom::{DVec3, unit};
use vlscan_survey::Beam;

/// Half of the field of view of receivers that state none, rad: light that comes back by another way than
/// that of the beam is not received.
const HALF_VIEW: f64 = 0.1;
/// Steps of the integral over the aperture.
const STEPS: u32 = 48;
/// Standard deviations off the axis at which the beam ends: 2e-9 of the light lies beyond.
const CUT_OFF: f64 = 6.0;
/// Minimum radius of the beam at the receiver, m.
const MIN_RADIUS: f64 = 1e-6;

/// Beam and receiver as they meet in a mirror.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aperture {
    /// Radius of the receiver, m.
    radius: f64,
    /// Radius of the beam where it leaves the instrument, m.
    exit_radius: f64,
    /// Half angle of the beam; of an elliptical beam that of a round one of equal solid angle, rad.
    half_angle: f64,
    /// Cosine of half of the field of view of the receiver.
    view_cosine: f64,
}

/// Image of the transmitter in the mirrors on the way of light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Image {
    /// Origin of the beam, m.
    origin: DVec3,
    /// Axis of the beam, unit vector.
    axis: DVec3,
    /// The last surface that mirrored the light.
    pub mirror: Option<Mirror>,
}

/// Light at a surface that mirrors it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mirror {
    pub at: DVec3,
    /// Direction in which the light arrives.
    pub direction: DVec3,
    pub primitive: u32,
    /// Cosine of the angle of incidence.
    pub cosine: f64,
    /// Standard deviation of the slopes of its facets, rad.
    pub roughness: f64,
    pub is_water: bool,
}

impl Image {
    /// The transmitter itself.
    pub fn of_beam(origin: DVec3, axis: DVec3) -> Image {
        Image { origin, axis, mirror: None }
    }

    /// The image in a plane mirror with this unit normal.
    pub fn mirrored(self, normal: DVec3, mirror: Mirror) -> Image {
        let across = normal * (2.0 * (self.origin - mirror.at).dot(normal));
        let axis = unit(self.axis - normal * (2.0 * self.axis.dot(normal)));
        Image { origin: self.origin - across, axis, mirror: Some(mirror) }
    }

    /// The image as a pane displaces it, whose light of this direction takes the way `crossed` through it.
    pub fn displaced(self, crossed: DVec3, direction: DVec3) -> Image {
        Image { origin: self.origin + crossed - direction * crossed.dot(direction), ..self }
    }

    /// Light of the image that leaves a surface at `from` comes nearer to `place` on its further way, instead
    /// of being past it.
    pub fn leads_to(&self, from: DVec3, place: DVec3) -> bool {
        (place - from).dot(self.axis) > 0.0
    }

    /// The image behind a surface; facets of a rough mirror give none that further surfaces could show.
    pub fn beyond(self) -> Option<Image> {
        self.mirror.is_none_or(|mirror| mirror.roughness == 0.0).then_some(self)
    }
}

impl Aperture {
    /// The receiver of a beam, with its field of view as far as it is known; `None` without an aperture.
    pub fn new(beam: &Beam, footprint: &Footprint, field_of_view: Option<f64>) -> Option<Aperture> {
        let view = field_of_view.or(beam.overlap.map(|overlap| overlap.field_of_view));
        let [x, z] = footprint.half_angles;
        let aperture = Aperture {
            radius: 0.5 * beam.receiver_diameter,
            exit_radius: footprint.exit_radius,
            half_angle: sqrt(x * z),
            view_cosine: cos(view.map_or(HALF_VIEW, |view| 0.5 * view)),
        };
        (aperture.radius > 0.0 && aperture.radius.is_finite()).then_some(aperture)
    }

    /// Reflectance factor of the mirrors by which light returns to the receiver at `receiver` after the
    /// optical length `length`, m, if they lose no light. The beam leaves the instrument along `axis`.
    pub fn factor(&self, image: &Image, (receiver, axis): (DVec3, DVec3), length: f64) -> f64 {
        let Some(mirror) = image.mirror else { return 0.0 };
        let towards = receiver - image.origin;
        let depth = towards.dot(image.axis);
        // False for directions that are not finite, too.
        let is_seen = depth > 0.0 && -unit(towards).dot(axis) >= self.view_cosine;
        if !is_seen {
            return 0.0;
        }
        let widened = 4.0 * mirror.roughness * (receiver - mirror.at).length();
        let radius = hypot(hypot(self.exit_radius, self.half_angle * length), widened).max(MIN_RADIUS);
        let off = (towards - image.axis * depth).length();
        let width = 0.5 * length / self.radius;
        disc_share(off, self.radius, 0.5 * radius) * width * width
    }
}

/// Share of a normal distribution around a point, of this standard deviation along each axis, on a disc of
/// this radius whose centre is `off` from the point: the integral of e^(−(u − off)²/2σ²)·erf(h/√2σ) over the
/// chords of half length h = √(radius² − u²), with u = radius·sin t.
fn disc_share(off: f64, radius: f64, sigma: f64) -> f64 {
    let (from, to) = ((off - CUT_OFF * sigma).max(-radius), (off + CUT_OFF * sigma).min(radius));
    // The bounds are numbers even if `off` is none.
    if off.is_nan() || from >= to {
        return 0.0;
    }
    let (from, to) = (asin((from / radius).clamp(-1.0, 1.0)), asin((to / radius).clamp(-1.0, 1.0)));
    let step = (to - from) / f64::from(STEPS);
    let chord = |i: u32| {
        let (sine, cosine) = sincos(from + (f64::from(i) + 0.5) * step);
        let by = (radius * sine - off) / sigma;
        exp(-0.5 * by * by) * erf(radius * cosine / (sigma * SQRT_2)) * radius * cosine
    };
    (0..STEPS).map(chord).sum::<f64>() * step / (sigma * sqrt(2.0 * PI))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
    }

    fn aperture() -> Aperture {
        Aperture { radius: 0.025, exit_radius: 0.0, half_angle: 1.5e-4, view_cosine: cos(HALF_VIEW) }
    }

    /// The image of a beam along +y in a mirror at this distance that is turned by an angle (rad).
    fn faced(distance: f64, turned: f64, roughness: f64) -> Image {
        let (sine, cosine) = sincos(turned);
        let (at, direction) = (DVec3::Y * distance, DVec3::Y);
        let mirror = Mirror { at, direction, primitive: 0, cosine, roughness, is_water: false };
        Image::of_beam(DVec3::ZERO, DVec3::Y).mirrored(DVec3::new(sine, -cosine, 0.0), mirror)
    }

    fn factor(image: &Image) -> f64 {
        aperture().factor(image, (DVec3::ZERO, DVec3::Y), 200.0)
    }

    #[test]
    fn the_share_on_a_disc_is_that_of_the_closed_form_and_of_a_fine_sum() {
        for (radius, sigma) in [(0.025, 0.015), (1.0, 1.0), (1.0, 0.3), (0.01, 1.0), (3.0, 0.5)] {
            let closed = 1.0 - exp(-0.5 * (radius / sigma) * (radius / sigma));
            near(disc_share(0.0, radius, sigma), closed, 1e-6);
            for off in [0.2, 0.9, 1.5] {
                // Rings around the centre of the distribution, by the part of each that is on the disc.
                let n = 40_000;
                let ring = |i: i32| {
                    let r = (f64::from(i) + 0.5) * 8.0 * sigma / f64::from(n);
                    let inner = (r * r + off * off - radius * radius) / (2.0 * r * off);
                    libm::acos(inner.clamp(-1.0, 1.0)) / PI * r * exp(-0.5 * r * r / (sigma * sigma))
                };
                let sum = (0..n).map(ring).sum::<f64>() * 8.0 / f64::from(n) / sigma;
                near(disc_share(off, radius, sigma), sum, 2e-4);
            }
        }
        assert_eq!(disc_share(9.0, 1.0, 1.0), 0.0);
        assert_eq!(disc_share(f64::NAN, 1.0, 1.0), 0.0);
    }

    #[test]
    fn a_mirror_that_faces_the_beam_returns_what_falls_on_the_aperture() {
        // 1 − e^(−2·(25 mm)²/(30 mm)²) of the light at 100 m.
        let width = 200.0f64 / 0.05;
        near(factor(&faced(100.0, 0.0, 0.0)) / (width * width), 0.750648, 5e-7);
        // Turned by α, the axis returns R·sin 2α aside.
        let turned = 1.5e-4;
        let share = factor(&faced(100.0, turned, 0.0)) / (width * width);
        near(share, disc_share(100.0 * libm::sin(2.0 * turned), 0.025, 0.015), 1e-9);
        assert!((0.2..0.4).contains(&share), "{share}");
        assert_eq!(factor(&faced(100.0, 2e-3, 0.0)), 0.0);
    }

    #[test]
    fn rough_mirrors_spread_the_image_and_other_ways_are_not_seen() {
        let width = 200.0f64 / 0.05;
        let spread = 0.03f64.hypot(4.0 * 1e-3 * 100.0);
        let expected = 1.0 - exp(-2.0 * (0.025 / spread) * (0.025 / spread));
        near(factor(&faced(100.0, 0.0, 1e-3)) / (width * width) / expected, 1.0, 1e-6);
        assert!(faced(100.0, 0.0, 1e-3).beyond().is_none() && faced(100.0, 0.0, 0.0).beyond().is_some());
        let image = faced(100.0, 0.0, 0.0);
        // Back from the mirror, light passes the receiver and goes on.
        assert!(image.leads_to(DVec3::Y * 100.0, DVec3::ZERO) && image.leads_to(DVec3::Y, DVec3::ZERO));
        assert!(!image.leads_to(DVec3::Y * -2.0, DVec3::ZERO));
        assert_eq!(aperture().factor(&image, (DVec3::ZERO, DVec3::X), 200.0), 0.0);
        assert_eq!(factor(&Image::of_beam(DVec3::ZERO, DVec3::Y)), 0.0);
    }
}
