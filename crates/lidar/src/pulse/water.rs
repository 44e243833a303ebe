//! Refraction, reflection and attenuation of water, and the slopes of its surface.
//!
//! The surface is made of facets. Their slopes follow the wind (Cox and Munk, 1954) as a statistic, without a
//! mesh of waves. Half of the variance belongs to waves longer than the spot of a subray. Their slope is
//! drawn once per subray; it tilts the facet that refracts the subray, and the mean of those that mirror its
//! light straight back. So echoes of the surface fluctuate, and their mean is that of all slopes.

use super::pane::fresnel;
use libm::exp;
use std::f64::consts::PI;
use vlscan_geom::{DVec3, unit};
use vlscan_scene::Water;

/// Minimum cosine with which light meets a facet.
const MIN_COSINE: f64 = 1e-6;
/// Share of the variance of the slopes that belongs to waves longer than the spot of a subray.
const LONG_WAVES: f64 = 0.5;
/// Exponent of the fit by which a receiver of the field of view D (diameter on the surface) sees the
/// attenuation K + (c − K)·e^(−0.85·c·D) (Gordon, 1982).
const FIELD_OF_VIEW_FIT: f64 = 0.85;

/// Facet of the surface that a subray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Facet {
    /// Unit normal.
    pub normal: DVec3,
    /// Slopes along the two axes of the surface of the waves longer than the spot of the subray.
    long: [f64; 2],
}

/// Light that a facet lets pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Refracted {
    /// Unit vector.
    pub direction: DVec3,
    /// Cosines of the angles to the normal of the facet, in air and in water.
    pub cosines: [f64; 2],
}

/// Axes of a surface of this unit normal, along and across the wind.
fn axes(water: &Water, normal: DVec3) -> [DVec3; 2] {
    let [x, y] = water.wind;
    let wind = DVec3::new(x, y, 0.0);
    let across = normal.cross(wind);
    let across = if across.length_squared() < 1e-12 { normal.cross(DVec3::X) } else { across };
    let across = unit(across);
    [across.cross(normal), across]
}

/// True if the surface has no waves.
pub(super) fn is_flat(water: &Water) -> bool {
    water.slopes == [0.0; 2]
}

/// Facet of a surface of this unit normal by four normally distributed numbers.
pub(super) fn facet(water: &Water, normal: DVec3, mut draw: impl FnMut() -> f64) -> Facet {
    if is_flat(water) {
        return Facet { normal, long: [0.0; 2] };
    }
    let [along, across] = axes(water, normal);
    let mut of_share = |share: f64| water.slopes.map(|variance| (share * variance).sqrt() * draw());
    let (long, short) = (of_share(LONG_WAVES), of_share(1.0 - LONG_WAVES));
    let slopes = [long[0] + short[0], long[1] + short[1]];
    Facet { normal: unit(normal + along * slopes[0] + across * slopes[1]), long }
}

/// Reflectance factor by which facets of the surface mirror light straight back: f = π·R₀·p/(4·cos⁵θ) with
/// the density p of the slope that faces the light, given the long waves of `facet`. Over all long waves the
/// mean of p is the density of Cox and Munk. A flat surface has no facets: it is a mirror
/// ([`super::specular`]).
pub(super) fn glint(water: &Water, normal: DVec3, facet: &Facet, direction: DVec3) -> f64 {
    let cosine = -normal.dot(direction);
    if is_flat(water) || cosine < MIN_COSINE {
        return 0.0;
    }
    let mut density = 1.0;
    for (i, axis) in axes(water, normal).into_iter().enumerate() {
        let variance = (1.0 - LONG_WAVES) * water.slopes[i];
        let off = -axis.dot(direction) / cosine - facet.long[i];
        density *= exp(-off * off / (2.0 * variance)) / (2.0 * PI * variance).sqrt();
    }
    let front = fresnel(water.index, 1.0)[0];
    let square = cosine * cosine;
    PI * front * density / (4.0 * square * square * cosine)
}

/// True if water scatters light back on its way. Light that is scattered back is lost to the beam, which the
/// attenuation K counts; so water with K = 0 scatters nothing back.
pub(super) fn has_column(water: &Water) -> bool {
    water.backscatter > 0.0 && water.attenuation > 0.0
}

/// Share of unpolarised light that a facet mirrors; the rest enters the water.
pub(super) fn mirrored_share(water: &Water, cosine: f64) -> f64 {
    let [s, p] = fresnel(water.index, cosine);
    0.5 * (s + p)
}

/// Light from air behind a facet; `None` if it comes from the other side.
pub(super) fn refract(water: &Water, normal: DVec3, direction: DVec3) -> Option<Refracted> {
    let cosine = (-normal.dot(direction)).min(1.0);
    if cosine < MIN_COSINE {
        return None;
    }
    let inner = (1.0 - (1.0 - cosine * cosine) / (water.index * water.index)).sqrt();
    let along = direction + normal * cosine;
    let direction = unit(along * (1.0 / water.index) - normal * inner);
    Some(Refracted { direction, cosines: [cosine, inner] })
}

/// R_eff²: light of a point in water returns to the receiver as from that distance in air. With the ways l_a
/// in air and l_w in water and the angles θ and φ at the facet it is (n·l_a + l_w) in the plane across that
/// of incidence, times (n·l_a·cos φ/cos θ + l_w·cos θ/cos φ) in that plane.
pub(super) fn effective_range_squared(water: &Water, air: f64, way: f64, [outer, inner]: [f64; 2]) -> f64 {
    let bent = water.index * air;
    (bent + way) * (bent * inner / outer + way * outer / inner)
}

/// Attenuation that a receiver of this field of view (full angle, rad) sees at a distance from the surface:
/// K if it receives all light that water scatters forward, up to c if it receives none.
pub(super) fn attenuation(water: &Water, field_of_view: Option<f64>, air: f64) -> f64 {
    let (k, c) = (water.attenuation, water.beam_attenuation);
    match field_of_view {
        Some(angle) if c > k => k + (c - k) * exp(-FIELD_OF_VIEW_FIT * c * angle * air),
        _ => k,
    }
}

/// Plane in which light enters water, as software that corrects points for refraction knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WaterPlane {
    /// A point of the plane, m.
    pub point: DVec3,
    /// Unit normal of the mean surface, towards the instrument.
    pub normal: DVec3,
    pub water: Water,
}

impl WaterPlane {
    /// Position of an echo of this range on the beam from `origin`; `None` if it is not behind the plane.
    pub fn corrected(&self, origin: DVec3, direction: DVec3, range: f64) -> Option<DVec3> {
        let entry = self.normal.dot(self.point - origin) / self.normal.dot(direction);
        if !(entry > 0.0 && entry < range) {
            return None;
        }
        let inner = refract(&self.water, self.normal, direction)?;
        let way = (range - entry) / self.water.group_index;
        Some(origin + direction * entry + inner.direction * way)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use vlscan_base::rng::{Purpose, Stream};

    /// Flat water of the worked examples.
    pub fn water() -> Water {
        Water {
            index: 1.34,
            group_index: 1.365,
            attenuation: 0.1,
            beam_attenuation: 0.1,
            backscatter: Water::BACKSCATTER,
            slopes: [0.0; 2],
            wind: [0.0, 1.0],
        }
    }

    fn windy(slopes: [f64; 2]) -> Water {
        Water { slopes, ..water() }
    }

    /// Direction of light that comes down at this angle, its horizontal part towards this azimuth.
    fn down(degrees: f64, azimuth: f64) -> DVec3 {
        let ((s, c), (x, y)) = (libm::sincos(degrees.to_radians()), libm::sincos(azimuth.to_radians()));
        DVec3::new(s * x, s * y, -c)
    }

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
    }

    #[test]
    fn the_effective_range_is_that_of_the_closed_form() {
        let (height, depth) = (300.0, 10.0);
        for (degrees, squared, echo, of_guenther) in [
            (0.0, None, 7.639813e-07, 1.0),
            (10.0, None, 7.178395e-07, 0.985457),
            (20.0, Some(197263.5958), 5.933099e-07, 0.942210),
            (30.0, None, 4.263529e-07, 0.871375),
        ] {
            let refracted = refract(&water(), DVec3::Z, down(degrees, 0.0)).unwrap();
            let [outer, inner] = refracted.cosines;
            let (air, way) = (height / outer, depth / inner);
            let found = effective_range_squared(&water(), air, way, refracted.cosines);
            if let Some(squared) = squared {
                near(found / squared, 1.0, 1e-9);
            }
            let passed = 1.0 - mirrored_share(&water(), outer);
            let attenuated = exp(-2.0 * attenuation(&water(), None, air) * way);
            near(passed * passed * inner / found * attenuated / echo, 1.0, 1e-6);
            // Guenther's cos²θ/(n·H + D)² has neither the cosine of the bottom nor the astigmatism.
            let guenther = (outer / (1.34 * height + depth)).powi(2);
            near(inner / found / guenther, of_guenther, 1e-6);
        }
    }

    /// The solid angle of the receiver by the map of rays, without the closed form.
    #[test]
    fn the_effective_range_follows_from_the_map_of_rays() {
        let (height, depth, index) = (300.0, 10.0, water().index);
        let reached =
            |inner: f64| depth * libm::tan(inner) + height * libm::tan(libm::asin(index * libm::sin(inner)));
        for degrees in [5.0f64, 20.0, 40.0] {
            let refracted = refract(&water(), DVec3::Z, down(degrees, 0.0)).unwrap();
            let [outer, inner] = refracted.cosines;
            let angle = libm::acos(inner);
            let slope = (reached(angle + 1e-6) - reached(angle - 1e-6)) / 2e-6;
            let solid_angle = libm::sin(angle) / (outer * reached(angle) * slope);
            let squared = effective_range_squared(&water(), height / outer, depth / inner, [outer, inner]);
            near(solid_angle * squared, 1.0, 1e-8);
        }
    }

    #[test]
    fn light_is_mirrored_passed_or_absorbed() {
        for degrees in [0.0, 20.0, 53.0, 80.0, 89.9] {
            let cosine = libm::cos(f64::to_radians(degrees));
            let mirrored = mirrored_share(&water(), cosine);
            let passed = 1.0 - mirrored;
            let kept = exp(-attenuation(&water(), None, 100.0) * 7.0);
            near(mirrored + passed * kept + passed * (1.0 - kept), 1.0, 1e-12);
            assert!((0.0..=1.0).contains(&mirrored), "{degrees}°");
        }
        near(mirrored_share(&water(), 1.0), 0.021112, 5e-7);
    }

    #[test]
    fn refracted_light_obeys_snell() {
        for (degrees, azimuth) in [(0.0, 0.0), (20.0, 0.0), (35.0, 77.0), (80.0, 200.0)] {
            let direction = down(degrees, azimuth);
            let refracted = refract(&water(), DVec3::Z, direction).unwrap();
            let horizontal = |d: DVec3| DVec3::new(d.x, d.y, 0.0);
            assert!((horizontal(refracted.direction) * 1.34 - horizontal(direction)).length() < 1e-14);
            near(refracted.direction.length(), 1.0, 1e-15);
            near(-refracted.direction.z, refracted.cosines[1], 1e-15);
        }
        assert_eq!(refract(&water(), DVec3::Z, DVec3::Z), None);
    }

    /// Mean of the factor over facets.
    fn mean_glint(water: &Water, direction: DVec3, count: u64) -> f64 {
        let stream = Stream::new(7, Purpose::FacetSlope);
        let of = |number: u64| {
            let mut drawn = 0;
            let facet = facet(water, DVec3::Z, || {
                drawn += 1;
                stream.normal(0, number, drawn)
            });
            glint(water, DVec3::Z, &facet, direction)
        };
        (0..count).map(of).sum::<f64>() / count as f64
    }

    #[test]
    fn the_mean_glint_is_that_of_cox_and_munk() {
        let isotropic = windy([0.5 * (0.003 + 0.00512 * 5.0); 2]);
        for (degrees, expected) in
            [(0.0, 0.184544), (5.0, 0.143929), (10.0, 0.067177), (15.0, 0.017829), (20.0, 0.002452)]
        {
            // Far from nadir few facets have most of the light.
            let count = if degrees < 18.0 { 200_000 } else { 1_200_000 };
            let mean = mean_glint(&isotropic, down(degrees, 30.0), count);
            near(mean / expected, 1.0, 0.02);
        }
        // The wind blows along y.
        let directed = windy([0.00316 * 5.0, 0.003 + 0.00192 * 5.0]);
        near(mean_glint(&directed, down(10.0, 0.0), 200_000) / 0.075485, 1.0, 0.02);
        near(mean_glint(&directed, down(10.0, 90.0), 200_000) / 0.058795, 1.0, 0.02);
        assert_eq!(mean_glint(&water(), down(0.0, 0.0), 1), 0.0);
    }

    #[test]
    fn slopes_have_the_variances_of_the_waves() {
        let water = windy([0.0158, 0.0126]);
        let stream = Stream::new(3, Purpose::FacetSlope);
        let (mut along, mut across) = (0.0, 0.0);
        let count = 100_000;
        for number in 0..count {
            let mut drawn = 0;
            let Facet { normal, .. } = facet(&water, DVec3::Z, || {
                drawn += 1;
                stream.normal(0, number, drawn)
            });
            along += (normal.y / normal.z).powi(2);
            across += (normal.x / normal.z).powi(2);
        }
        near(along / count as f64 / 0.0158, 1.0, 0.02);
        near(across / count as f64 / 0.0126, 1.0, 0.02);
    }

    #[test]
    fn narrow_receivers_see_the_attenuation_of_the_beam() {
        let turbid = Water { beam_attenuation: 1.0, ..water() };
        assert_eq!(attenuation(&turbid, None, 75.0), 0.1);
        near(attenuation(&turbid, Some(0.0), 75.0), 1.0, 1e-15);
        near(attenuation(&turbid, Some(0.006), 75.0), 0.1 + 0.9 * exp(-0.85 * 0.45), 1e-12);
        assert!(attenuation(&turbid, Some(1.0), 75.0) < 0.1 + 1e-9);
        assert_eq!(attenuation(&water(), Some(0.0), 75.0), 0.1);
    }

    #[test]
    fn corrected_points_are_where_the_light_was() {
        let plane = WaterPlane { point: DVec3::ZERO, normal: DVec3::Z, water: water() };
        let (origin, direction) = (DVec3::Z * 300.0, down(20.0, 90.0));
        let refracted = refract(&water(), DVec3::Z, direction).unwrap();
        let [outer, inner] = refracted.cosines;
        let range = 300.0 / outer + 1.365 * 10.0 / inner;
        let uncorrected = origin + direction * range;
        assert!((uncorrected - DVec3::new(114.019575, 0.0, -13.266207)).length() < 1e-6, "{uncorrected}");
        let (sine, cosine) = libm::sincos(20f64.to_radians());
        let unbent = DVec3::new(range * sine, 0.0, 300.0 - range * cosine);
        assert!((uncorrected - unbent).length() < 1e-9, "{uncorrected}");
        let corrected = plane.corrected(origin, direction, range).unwrap();
        assert!((corrected - DVec3::new(111.830896, 0.0, -10.0)).length() < 1e-6, "{corrected}");
        let exact = 300.0 * libm::tan(20f64.to_radians()) + 10.0 * libm::tan(libm::acos(inner));
        assert!((corrected - DVec3::new(exact, 0.0, -10.0)).length() < 1e-9, "{corrected}");
        assert_eq!(plane.corrected(origin, direction, 300.0), None);
        assert_eq!(plane.corrected(origin, -direction, range), None);
    }
}
