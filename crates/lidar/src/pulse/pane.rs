//! Mirroring, transmission and refraction of panes of glass.

use libm::exp;
use vlscan_geom::DVec3;
use vlscan_scene::OpticsKind;

/// Minimum cosine of the incidence angle: without light that comes in along the surface all formulas are
/// finite.
const MIN_COSINE: f64 = 1e-6;

/// A pane of parallel sheets. Multiple reflections in the sheets and between them add up without
/// interference, as sheets are much thicker than the coherence length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pane {
    /// Refractive index, at least 1.
    pub index: f64,
    /// Thickness of each sheet, m.
    pub thickness: f64,
    /// Absorption within the sheets, 1/m.
    pub absorption: f64,
    /// Number of sheets, 1 or 2.
    pub sheets: u32,
}

/// Shares of unpolarised light; the rest is absorbed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PaneShares {
    pub mirrored: f64,
    pub transmitted: f64,
}

/// Way of a ray through a pane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Crossing {
    /// From the point of entry to the point of exit, m.
    pub way: DVec3,
    /// Optical length, m.
    pub length: f64,
    /// Length of the way through the pane along the direction of the ray in air, m.
    pub unbent: f64,
}

/// Reflectances of the boundary of a medium for light polarised across and in the plane of incidence
/// (Fresnel).
pub(super) fn fresnel(index: f64, cosine: f64) -> [f64; 2] {
    let c = cosine.clamp(MIN_COSINE, 1.0);
    let b = (index * index - (1.0 - c * c)).sqrt();
    let square = index * index;
    let [s, p] = [(c - b) / (c + b), (square * c - b) / (square * c + b)];
    [s * s, p * p]
}

impl Pane {
    /// The pane that an optical surface is.
    pub fn of(kind: OpticsKind) -> Option<Pane> {
        match kind {
            OpticsKind::Mirror { .. } | OpticsKind::Water(_) => None,
            OpticsKind::Pane { index, thickness, absorption, sheets } => {
                Some(Pane { index, thickness, absorption, sheets })
            }
        }
    }

    /// Cosine of the angle between the normal and a ray in the glass.
    fn inner_cosine(&self, cosine: f64) -> f64 {
        (1.0 - (1.0 - cosine * cosine) / (self.index * self.index)).max(0.0).sqrt()
    }

    /// Shares of light that comes in with this cosine of the incidence angle: the mean over both
    /// polarisations. With r of a boundary and t within a sheet, a sheet mirrors
    /// R = r(1 + t²(1 − r)²/(1 − r²t²)) and transmits T = t(1 − r)²/(1 − r²t²) (Born and Wolf, §1.5, summed);
    /// two sheets mirror R + T²R/(1 − R²) and transmit T²/(1 − R²).
    pub fn shares(&self, cosine: f64) -> PaneShares {
        let cosine = cosine.clamp(MIN_COSINE, 1.0);
        let t = exp(-self.absorption * self.thickness / self.inner_cosine(cosine).max(MIN_COSINE));
        let of_polarisation = |r: f64| {
            let once = t * (1.0 - r) * (1.0 - r) / (1.0 - r * r * t * t);
            let mirrored = r * (1.0 + t * once);
            match self.sheets {
                0 | 1 => [mirrored, once],
                _ => {
                    let between = 1.0 - mirrored * mirrored;
                    [mirrored + once * once * mirrored / between, once * once / between]
                }
            }
        };
        let [s, p] = fresnel(self.index, cosine).map(of_polarisation);
        PaneShares { mirrored: 0.5 * (s[0] + p[0]), transmitted: 0.5 * (s[1] + p[1]) }
    }

    /// Way of a ray of this direction through the sheets, one behind the other; `normal` is the unit normal
    /// of the side that it enters.
    pub fn crossing(&self, normal: DVec3, direction: DVec3) -> Crossing {
        let cosine = (-normal.dot(direction)).clamp(MIN_COSINE, 1.0);
        let inner_cosine = self.inner_cosine(cosine).max(MIN_COSINE);
        let depth = self.thickness * f64::from(self.sheets.max(1));
        let along = direction + normal * cosine;
        let inner = along * (1.0 / self.index) - normal * inner_cosine;
        let inner_length = depth / inner_cosine;
        Crossing { way: inner * inner_length, length: self.index * inner_length, unbent: depth / cosine }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pane(sheets: u32, absorption: f64) -> Pane {
        Pane { index: 1.5, thickness: 0.004, absorption, sheets }
    }

    fn cosine(degrees: f64) -> f64 {
        libm::cos(degrees.to_radians())
    }

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
    }

    #[test]
    fn boundaries_of_glass_mirror_by_the_formulas_of_fresnel() {
        for (degrees, expected) in [
            (0.0, 0.040000),
            (30.0, 0.041523),
            (45.0, 0.050240),
            (60.0, 0.089187),
            (70.0, 0.171043),
            (80.0, 0.387704),
        ] {
            let [s, p] = fresnel(1.5, cosine(degrees));
            near(0.5 * (s + p), expected, 5e-7);
        }
        near(fresnel(1.5, 1.0)[0], 0.04, 1e-15);
        // No light comes back in the plane of incidence at the angle of Brewster.
        near(fresnel(1.5, libm::cos(libm::atan(1.5)))[1], 0.0, 1e-30);
    }

    #[test]
    fn panes_transmit_the_shares_of_the_table() {
        for (degrees, one, two) in [
            (0.0, 0.923077, 0.857143),
            (45.0, 0.907344, 0.839269),
            (60.0, 0.848128, 0.765560),
            (80.0, 0.458473, 0.311293),
        ] {
            near(pane(1, 0.0).shares(cosine(degrees)).transmitted, one, 5e-7);
            near(pane(2, 0.0).shares(cosine(degrees)).transmitted, two, 5e-7);
        }
        for (degrees, transmitted, mirrored) in [
            (0.0, 0.886773, 0.074080),
            (45.0, 0.866813, 0.088952),
            (60.0, 0.806582, 0.145853),
            (80.0, 0.427438, 0.522789),
        ] {
            let shares = pane(1, 10.0).shares(cosine(degrees));
            near(shares.transmitted, transmitted, 5e-7);
            near(shares.mirrored, mirrored, 5e-7);
        }
    }

    #[test]
    fn lossless_panes_obey_the_closed_form_and_lose_nothing() {
        for sheets in [1, 2] {
            for step in 0..90 {
                let c = cosine(f64::from(step));
                let shares = pane(sheets, 0.0).shares(c);
                let m = f64::from(sheets);
                let closed = fresnel(1.5, c).map(|r| (1.0 - r) / (1.0 + (2.0 * m - 1.0) * r));
                near(shares.transmitted, 0.5 * (closed[0] + closed[1]), 1e-12);
                near(shares.transmitted + shares.mirrored, 1.0, 1e-12);
            }
        }
        for (degrees, expected) in [(0.0, 0.852071), (45.0, 0.823274), (60.0, 0.719322), (80.0, 0.210197)] {
            let transmitted = pane(1, 0.0).shares(cosine(degrees)).transmitted;
            near(transmitted * transmitted, expected, 5e-7);
        }
    }

    /// Follows the light from boundary to boundary and from sheet to sheet, by the formulas of Fresnel for
    /// the angles in air and glass.
    #[test]
    fn shares_are_the_sums_over_all_ways_of_the_light() {
        // Light between two mirrors, which leaves it at either side in turn: shares mirrored and transmitted.
        let between = |first: f64, mut inside: f64, leaving: f64, kept: f64| {
            let mut shares = [first, 0.0];
            for way in 0..400 {
                shares[(way + 1) % 2] += inside * leaving;
                inside *= kept;
            }
            shares
        };
        for (index, absorption) in [(1.5, 0.0), (1.5, 10.0), (1.52, 0.5), (2.0, 500.0)] {
            for step in 1..86 {
                let outer = f64::from(step).to_radians();
                let inner = libm::asin(libm::sin(outer) / index);
                let t = exp(-absorption * 0.004 / libm::cos(inner));
                let s = libm::sin(outer - inner) / libm::sin(outer + inner);
                let p = libm::tan(outer - inner) / libm::tan(outer + inner);
                let one = [s * s, p * p].map(|r| between(r, (1.0 - r) * t, 1.0 - r, r * t));
                let two = one.map(|[mirrored, once]| between(mirrored, once, once, mirrored));
                for (sheets, [s, p]) in [(1, one), (2, two)] {
                    let shares = Pane { index, ..pane(sheets, absorption) }.shares(libm::cos(outer));
                    near(shares.mirrored, 0.5 * (s[0] + p[0]), 1e-12);
                    near(shares.transmitted, 0.5 * (s[1] + p[1]), 1e-12);
                }
            }
        }
    }

    /// The light that is absorbed in a sheet, summed over its ways: (1 − r)(1 − t)/(1 − r·t) of each
    /// polarisation. Two sheets absorb it of the light that comes in and of all that runs between them.
    #[test]
    fn mirrored_transmitted_and_absorbed_light_is_all_light() {
        for absorption in [0.0, 0.5, 10.0, 500.0] {
            for step in 0..90 {
                let c = cosine(f64::from(step));
                let [one, two] = [pane(1, absorption), pane(2, absorption)];
                let t = exp(-absorption * 0.004 / one.inner_cosine(c));
                let of_polarisation = |r: f64| {
                    let once = t * (1.0 - r) * (1.0 - r) / (1.0 - r * r * t * t);
                    let absorbed = (1.0 - r) * (1.0 - t) / (1.0 - r * t);
                    let mirrored = 1.0 - once - absorbed;
                    [absorbed, absorbed * (1.0 + once / (1.0 - mirrored))]
                };
                let [s, p] = fresnel(1.5, c).map(of_polarisation);
                for (pane, absorbed) in [(one, 0.5 * (s[0] + p[0])), (two, 0.5 * (s[1] + p[1]))] {
                    let PaneShares { mirrored, transmitted } = pane.shares(c);
                    near(mirrored + transmitted + absorbed, 1.0, 1e-12);
                }
            }
        }
    }

    #[test]
    fn absorption_is_what_is_missing_and_never_negative() {
        for sheets in [1, 2] {
            for absorption in [0.0, 0.5, 10.0, 1e6] {
                for step in 0..=900 {
                    let shares = pane(sheets, absorption).shares(cosine(0.1 * f64::from(step)));
                    let sum = shares.mirrored + shares.transmitted;
                    assert!(sum > 0.0 && sum <= 1.0 + 1e-12, "{shares:?}");
                }
            }
        }
        let air = Pane { index: 1.0, ..pane(2, 0.0) };
        for c in [0.0, 1e-9, 0.5, 1.0] {
            near(air.shares(c).transmitted, 1.0, 1e-9);
        }
    }

    #[test]
    fn rays_leave_a_pane_beside_their_line_and_later() {
        for (degrees, square, parallel, shift) in [
            (0.0, 2.000000, 2.000000, 0.0),
            (45.0, 2.463075, 1.146506, 1.316569),
            (60.0, 2.898979, -0.651531, 2.049888),
            (80.0, 3.831162, -15.080608, 3.334655),
        ] {
            let (sine, c) = (libm::sin(f64::to_radians(degrees)), cosine(degrees));
            let (normal, direction) = (DVec3::NEG_Y, DVec3::new(sine, c, 0.0));
            let crossing = pane(1, 0.0).crossing(normal, direction);
            let along = crossing.way.dot(direction);
            near(crossing.way.y, 0.004, 1e-15);
            near(crossing.unbent * c, 0.004, 1e-15);
            near(crossing.length - along, square * 1e-3, 1e-9);
            near(crossing.length - 0.004 / c, parallel * 1e-3, 1e-9);
            near((crossing.way - direction * along).length(), shift * 1e-3, 1e-9);
            let two = pane(2, 0.0).crossing(normal, direction);
            near((two.way - crossing.way * 2.0).length(), 0.0, 1e-15);
        }
    }
}
