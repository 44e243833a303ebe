//! Universal Transverse Mercator: converts latitude and longitude on WGS 84 to easting and northing and back,
//! by Krüger's series in the third flattening to the sixth order (C. F. F. Karney, Transverse Mercator with
//! an accuracy of a few nanometers, J. Geodesy 85, 2011, doi 10.1007/s00190-011-0445-3). Within 40° of the
//! central meridian the error of the series is below a micrometre.

use libm::{asinh, atan, atan2, atanh, cos, cosh, sin, sinh, tan};
use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt;

/// Semi-major axis of WGS 84, m.
const A: f64 = 6_378_137.0;
/// Flattening of WGS 84.
const F: f64 = 1.0 / 298.257_223_563;
/// Third flattening.
const N: f64 = F / (2.0 - F);
/// Scale on the central meridian.
const SCALE: f64 = 0.9996;
const FALSE_EASTING: f64 = 500_000.0;
const FALSE_NORTHING: f64 = 10_000_000.0;
/// Maximum longitude from the central meridian, rad, far beyond the zone.
const MAX_LONGITUDE: f64 = 30.0 * (PI / 180.0);

/// Radius of the sphere whose meridians are as long as those of the ellipsoid, m (Karney, eq. 14).
const RECTIFYING: f64 = A / (1.0 + N) * (1.0 + N * N * (1.0 / 4.0 + N * N * (1.0 / 64.0 + N * N / 256.0)));

/// One of the 60 zones on one hemisphere: a rectangular grid in metres.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UtmZone {
    /// Zone number, 1 to 60.
    number: u8,
    /// True if 10 000 km are added to northings.
    south: bool,
}

/// A point on the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridPoint {
    /// Easting, m.
    pub easting: f64,
    /// Northing, m.
    pub northing: f64,
    /// Meridian convergence: the angle from true north clockwise to grid north, rad. The bearing on the grid
    /// is the true bearing minus this angle.
    pub convergence: f64,
}

/// A text that is not a UTM zone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownZone {
    /// The text.
    pub text: String,
}

impl fmt::Display for UnknownZone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "expected a UTM zone such as 32N or 55S, found {:?}", self.text)
    }
}

impl std::error::Error for UnknownZone {}

impl std::str::FromStr for UtmZone {
    type Err = UnknownZone;

    fn from_str(text: &str) -> Result<UtmZone, UnknownZone> {
        UtmZone::parse(text).ok_or_else(|| UnknownZone { text: text.to_owned() })
    }
}

impl UtmZone {
    /// Zone `number` (1 to 60); `None` for other numbers.
    pub fn new(number: u8, south: bool) -> Option<UtmZone> {
        (1..=60).contains(&number).then_some(UtmZone { number, south })
    }

    /// The zone of a latitude and longitude in radians, with the exceptions of Norway and Svalbard; `None`
    /// for an invalid latitude.
    pub fn of(latitude: f64, longitude: f64) -> Option<UtmZone> {
        if !(latitude.abs() <= FRAC_PI_2 && longitude.is_finite()) {
            return None;
        }
        let (lat, lon) = (latitude.to_degrees(), (longitude.to_degrees() + 180.0).rem_euclid(360.0) - 180.0);
        let number = match (lat, lon) {
            (56.0..64.0, 3.0..12.0) => 32,
            (72.0..84.0, 0.0..9.0) => 31,
            (72.0..84.0, 9.0..21.0) => 33,
            (72.0..84.0, 21.0..33.0) => 35,
            (72.0..84.0, 33.0..42.0) => 37,
            _ => (((lon + 180.0) / 6.0).floor() as u8 + 1).min(60),
        };
        UtmZone::new(number, lat < 0.0)
    }

    /// Parses `32N`, `32 n`, `33S`, and `32` for the northern hemisphere.
    pub fn parse(text: &str) -> Option<UtmZone> {
        let text = text.trim();
        let digits = text.bytes().take_while(u8::is_ascii_digit).count();
        let south = match text[digits..].trim() {
            "" | "N" | "n" => false,
            "S" | "s" => true,
            _ => return None,
        };
        UtmZone::new(text[..digits].parse().ok()?, south)
    }

    /// The zone that a coordinate reference system in WKT names: `UTM zone 32N` as EPSG writes it or
    /// `UTM_Zone_32N` as Esri does. `None` for all other systems, including zones on ellipsoids other than
    /// WGS 84 and GRS 80.
    pub fn of_wkt(wkt: &str) -> Option<UtmZone> {
        let lower = wkt.to_ascii_lowercase().replace(['_', '-'], " ");
        // The two ellipsoids differ by 0.1 mm.
        let known = ["wgs 84", "wgs84", "wgs 1984", "grs 80", "grs80", "grs 1980", "etrs89", "nad83"];
        if !known.iter().any(|name| lower.contains(name)) {
            return None;
        }
        let rest = &lower[lower.find("utm zone")? + "utm zone".len()..];
        let name = rest.trim_start();
        let end = name.find(|c: char| !(c.is_ascii_alphanumeric() || c == ' ')).unwrap_or(name.len());
        UtmZone::parse(&name[..end])
    }

    /// EPSG code of the zone on WGS 84.
    pub fn epsg(self) -> u32 {
        u32::from(self.number) + if self.south { 32_700 } else { 32_600 }
    }

    /// Longitude of the central meridian, rad.
    fn meridian(self) -> f64 {
        (f64::from(self.number) * 6.0 - 183.0) * (PI / 180.0)
    }

    /// The grid point of a latitude and longitude in radians; `None` for an invalid latitude and for
    /// longitudes more than 30° from the central meridian.
    pub fn project(self, latitude: f64, longitude: f64) -> Option<GridPoint> {
        let east = (longitude - self.meridian() + PI).rem_euclid(2.0 * PI) - PI;
        if !(latitude.abs() <= FRAC_PI_2 && east.abs() <= MAX_LONGITUDE) {
            return None;
        }
        let tau = conformal_tangent(tan(latitude));
        let (sin_east, cos_east) = (sin(east), cos(east));
        let xi = atan2(tau, cos_east);
        let eta = asinh(sin_east / (tau * tau + cos_east * cos_east).sqrt());
        let (mut x, mut y, mut p, mut q) = (eta, xi, 1.0, 0.0);
        for (j, alpha) in (1..).zip(forward_series()) {
            let k = 2.0 * f64::from(j);
            let (s, c) = (sin(k * xi), cos(k * xi));
            let (sh, ch) = (sinh(k * eta), cosh(k * eta));
            y += alpha * s * ch;
            x += alpha * c * sh;
            p += k * alpha * c * ch;
            q += k * alpha * s * sh;
        }
        let convergence = atan(tau / (1.0 + tau * tau).sqrt() * tan(east)) + atan2(q, p);
        Some(GridPoint {
            easting: FALSE_EASTING + SCALE * RECTIFYING * x,
            northing: self.false_northing() + SCALE * RECTIFYING * y,
            convergence,
        })
    }

    /// Latitude and longitude in radians of a grid point in metres.
    pub fn unproject(self, easting: f64, northing: f64) -> (f64, f64) {
        let y = (northing - self.false_northing()) / (SCALE * RECTIFYING);
        let x = (easting - FALSE_EASTING) / (SCALE * RECTIFYING);
        let (mut xi, mut eta) = (y, x);
        for (j, beta) in (1..).zip(backward_series()) {
            let k = 2.0 * f64::from(j);
            xi -= beta * sin(k * y) * cosh(k * x);
            eta -= beta * cos(k * y) * sinh(k * x);
        }
        let goal = sin(xi) / (sinh(eta) * sinh(eta) + cos(xi) * cos(xi)).sqrt();
        // Newton's method (Karney, eq. 19 to 21) converges in three steps; further steps change nothing.
        let mut tau = goal;
        for _ in 0..5 {
            let reached = conformal_tangent(tau);
            let squared = F * (2.0 - F);
            tau += (goal - reached) / (1.0 + reached * reached).sqrt() * (1.0 + (1.0 - squared) * tau * tau)
                / ((1.0 - squared) * (1.0 + tau * tau).sqrt());
        }
        (atan(tau), self.meridian() + atan2(sinh(eta), cos(xi)))
    }

    fn false_northing(self) -> f64 {
        if self.south { FALSE_NORTHING } else { 0.0 }
    }
}

impl fmt::Display for UtmZone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.number, if self.south { 'S' } else { 'N' })
    }
}

/// Tangent of the conformal latitude from the tangent of the latitude (Karney, eq. 7 to 9).
fn conformal_tangent(tau: f64) -> f64 {
    let e = (F * (2.0 - F)).sqrt();
    let sec = (1.0 + tau * tau).sqrt();
    let sigma = sinh(e * atanh(e * tau / sec));
    tau * (1.0 + sigma * sigma).sqrt() - sigma * sec
}

/// Coefficients of the series to the grid (Karney, eq. 35).
fn forward_series() -> [f64; 6] {
    let n = N;
    [
        n * (1. / 2.
            + n * (-2. / 3. + n * (5. / 16. + n * (41. / 180. + n * (-127. / 288. + n * (7891. / 37800.)))))),
        n * n
            * (13. / 48.
                + n * (-3. / 5. + n * (557. / 1440. + n * (281. / 630. + n * (-1983433. / 1935360.))))),
        n * n * n * (61. / 240. + n * (-103. / 140. + n * (15061. / 26880. + n * (167603. / 181440.)))),
        n * n * n * n * (49561. / 161280. + n * (-179. / 168. + n * (6601661. / 7257600.))),
        n * n * n * n * n * (34729. / 80640. + n * (-3418889. / 1995840.)),
        n * n * n * n * n * n * (212378941. / 319334400.),
    ]
}

/// Coefficients of the series from the grid (Karney, eq. 36).
fn backward_series() -> [f64; 6] {
    let n = N;
    [
        n * (1. / 2.
            + n * (-2. / 3.
                + n * (37. / 96. + n * (-1. / 360. + n * (-81. / 512. + n * (96199. / 604800.)))))),
        n * n
            * (1. / 48.
                + n * (1. / 15. + n * (-437. / 1440. + n * (46. / 105. + n * (-1118711. / 3870720.))))),
        n * n * n * (17. / 480. + n * (-37. / 840. + n * (-209. / 4480. + n * (5569. / 90720.)))),
        n * n * n * n * (4397. / 161280. + n * (-11. / 504. + n * (-830251. / 7257600.))),
        n * n * n * n * n * (4583. / 161280. + n * (-108847. / 3991680.)),
        n * n * n * n * n * n * (20648693. / 638668800.),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(zone: &str, lat: f64, lon: f64) -> GridPoint {
        UtmZone::parse(zone).unwrap().project(lat.to_radians(), lon.to_radians()).unwrap()
    }

    #[test]
    fn known_points_are_projected() {
        // The edge of a zone on the equator, a standard value of UTM tables.
        assert!((at("31N", 0.0, 0.0).easting - 166_021.443_1).abs() < 1e-4);
        assert!((at("31N", 0.0, 6.0).easting - 833_978.556_9).abs() < 1e-4);
        assert_eq!(at("31S", 0.0, 3.0).northing, 10_000_000.0);
        // The quadrant of the meridian is 10 001 965.729 m long on WGS 84, the half up to 45° 4 984 944.378
        // m.
        assert!((at("31N", 90.0, 3.0).northing - SCALE * 10_001_965.729_3).abs() < 1e-3);
        assert!((at("31N", 45.0, 3.0).northing - SCALE * 4_984_944.378_0).abs() < 1e-3);
        // The CN Tower, Toronto: 630084 m east, 4833438 m north.
        let tower = at("17N", 43.642_567, -79.387_139);
        assert!((tower.easting - 630_084.0).abs() < 0.6 && (tower.northing - 4_833_438.0).abs() < 0.6);
    }

    #[test]
    fn zones_are_found_and_named() {
        let of = |lat: f64, lon: f64| UtmZone::of(lat.to_radians(), lon.to_radians()).unwrap().to_string();
        assert_eq!(
            [of(49.0, 8.5), of(-33.9, 18.4), of(0.0, -180.0), of(0.0, 180.0)],
            ["32N", "34S", "1N", "1N"]
        );
        assert_eq!([of(60.4, 5.3), of(78.2, 15.6), of(55.9, 5.0)], ["32N", "33N", "31N"]);
        assert!(UtmZone::of(2.0, 0.0).is_none() && UtmZone::of(f64::NAN, 0.0).is_none());
        assert_eq!(UtmZone::parse(" 33 s").unwrap().to_string(), "33S");
        for wrong in ["", "0N", "61N", "32U", "N", "-3"] {
            assert!(UtmZone::parse(wrong).is_none(), "{wrong}");
        }
        let wkt = |text: &str| UtmZone::of_wkt(text).map(|zone| zone.to_string());
        assert_eq!(wkt("PROJCRS[\"ETRS89 / UTM zone 32N\",BASEGEOGCRS["), Some("32N".into()));
        assert_eq!(wkt("PROJCS[\"WGS_1984_UTM_Zone_33S\",GEOGCS["), Some("33S".into()));
        assert_eq!(wkt("PROJCRS[\"ED50 / UTM zone 32N\",ELLIPSOID[\"International 1924\""), None);
        assert_eq!(wkt("PROJCRS[\"ETRS89 / Austria Lambert\""), None);
    }

    proptest! {
        #[test]
        fn unprojection_inverts_projection(lat in -84.0f64..84.0, east in -6.0f64..6.0, number in 1u8..=60, south: bool) {
            let zone = UtmZone::new(number, south).unwrap();
            let (lat, lon) = (lat.to_radians(), zone.meridian() + east.to_radians());
            let p = zone.project(lat, lon).unwrap();
            let (again, lon_again) = zone.unproject(p.easting, p.northing);
            prop_assert!((again - lat).abs() * A < 1e-6 && (lon_again - lon).abs() * A * cos(lat) < 1e-6);
        }

        /// True north is `convergence` to the left of grid north; the scales to the north and to the east are
        /// equal.
        #[test]
        fn the_projection_is_conformal(lat in -80.0f64..80.0, east in -5.0f64..5.0) {
            let zone = UtmZone::new(32, false).unwrap();
            let (lat, lon) = (lat.to_radians(), zone.meridian() + east.to_radians());
            let at = |north: f64, east: f64| {
                let squared = F * (2.0 - F);
                let w = 1.0 - squared * sin(lat) * sin(lat);
                let (meridian, parallel) = (A * (1.0 - squared) / w.powf(1.5), A / w.sqrt() * cos(lat));
                let p = zone.project(lat + north / meridian, lon + east / parallel).unwrap();
                (p.easting, p.northing)
            };
            let ((e0, n0), (e1, n1)) = (at(-5.0, 0.0), at(5.0, 0.0));
            let bearing = atan2(e1 - e0, n1 - n0);
            let here = zone.project(lat, lon).unwrap();
            prop_assert!((bearing + here.convergence).abs() < 1e-7, "{} {}", bearing, here.convergence);
            let ((e2, n2), (e3, n3)) = (at(0.0, -5.0), at(0.0, 5.0));
            let (north, east) = ((e1 - e0).hypot(n1 - n0), (e3 - e2).hypot(n3 - n2));
            prop_assert!((north - east).abs() < 1e-6 && (north / 10.0 - 1.0).abs() < 5e-3);
        }
    }
}
