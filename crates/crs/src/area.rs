//! Places on Earth of the coordinates of a system, and the area in which its EPSG code is used.

use crate::{epsg, name, projected_epsg, unit_problem, wkt_of_epsg};
use proj4rs::proj::Proj;
use proj4rs::transform::transform;
use vlscan_base::quantity::metres;
use vlscan_geom::UtmZone;

/// Areas by code; its head describes the format.
const AREAS: &str = include_str!("areas.txt");
/// Distance from the area of use from which coordinates are taken not to be in a system, m. Zones are used
/// beyond their areas: Norway as a whole has UTM zone 33N.
const MAX_DISTANCE: f64 = 500_000.0;
/// Mean radius of the Earth, m.
const EARTH_RADIUS: f64 = 6_371_000.0;
/// Largest share by which a metre of coordinates may differ from one on the ground: that of Lambert's
/// projections of continents at their edges, which is ten times that of national systems.
const MAX_DISTORTION: f64 = 0.03;
/// Half the distance over which a distortion is measured, m.
const DISTORTION_STEP: f64 = 500.0;
/// EPSG code of Web Mercator, and its name in files of Esri, which have no codes.
const WEB_MERCATOR: u16 = 3857;
const WEB_MERCATOR_OF_ESRI: &str = "Web_Mercator_Auxiliary_Sphere";

/// A place on Earth, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Longitude, degrees; negative in the west.
    pub longitude: f64,
    /// Latitude, degrees; negative in the south.
    pub latitude: f64,
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let side = |angle: f64, sides: [char; 2]| if angle < 0.0 { sides[1] } else { sides[0] };
        let (lat, lon) = (self.latitude, self.longitude);
        write!(f, "{:.1}° {} {:.1}° {}", lat.abs(), side(lat, ['N', 'S']), lon.abs(), side(lon, ['E', 'W']))
    }
}

/// A box of longitude and latitude, degrees; `east` is below `west` where it crosses the antimeridian.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Area {
    west: f64,
    south: f64,
    east: f64,
    north: f64,
}

impl Area {
    /// The area of use of a code.
    fn of_code(code: u32) -> Option<Area> {
        let code = code.to_string();
        let lines = AREAS.lines().filter_map(|line| line.split_once(':'));
        let (bounds, _) = lines.into_iter().find(|(_, codes)| codes.split_whitespace().any(|c| c == code))?;
        let mut degrees = bounds.split_whitespace().map(|word| word.parse().ok());
        let mut next = || degrees.next().flatten();
        Some(Area { west: next()?, south: next()?, east: next()?, north: next()? })
    }

    /// The distance of a place from the area along the surface of a sphere, m; 0 within it.
    fn distance(&self, place: Place) -> f64 {
        let Place { longitude, latitude } = place;
        let width = (self.east - self.west).rem_euclid(360.0);
        let width = if width == 0.0 && self.east != self.west { 360.0 } else { width };
        let from_west = (longitude - self.west).rem_euclid(360.0);
        // Degrees to the nearer of the meridians that bound it.
        let aside = if from_west <= width { 0.0 } else { (from_west - width).min(360.0 - from_west) };
        let nearest = latitude.clamp(self.south, self.north);
        along_surface([latitude, nearest], aside)
    }

    fn describe(&self) -> String {
        let corner = |longitude, latitude| Place { longitude, latitude };
        format!("{} to {}", corner(self.west, self.south), corner(self.east, self.north))
    }
}

/// The distance of two places along the surface of a sphere, m, by their latitudes and the difference of
/// their longitudes, degrees.
fn along_surface(latitudes: [f64; 2], aside: f64) -> f64 {
    let ([lat, other], aside) = (latitudes.map(f64::to_radians), aside.to_radians());
    let half_chord =
        ((lat - other) / 2.0).sin().powi(2) + lat.cos() * other.cos() * (aside / 2.0).sin().powi(2);
    2.0 * EARTH_RADIUS * half_chord.sqrt().min(1.0).asin()
}

/// Why coordinates of a system cannot be converted to WGS 84.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Wgs84Error {
    /// It has no EPSG code and is not a UTM zone.
    #[error(
        "{0} has no EPSG code and is no UTM zone on WGS 84 or GRS 80, so its longitudes and latitudes are \
         unknown"
    )]
    NoCode(String),
    /// Its projection is not known here.
    #[error("the projection of {0} is not built in, so its longitudes and latitudes are unknown")]
    NoProjection(String),
}

/// Converts easting and northing of a system to longitude and latitude of WGS 84.
pub struct Wgs84(Conversion);

enum Conversion {
    Projections(Box<[Proj; 2]>),
    Utm(UtmZone),
}

impl Wgs84 {
    /// The conversion from a system in WKT 1 or 2.
    ///
    /// # Errors
    /// Without an EPSG code with a known projection, and without a UTM zone in its name.
    pub fn of(wkt: &str) -> Result<Wgs84, Wgs84Error> {
        let of_esri = || wkt.contains(WEB_MERCATOR_OF_ESRI).then_some(WEB_MERCATOR);
        let code = projected_epsg(wkt).or_else(|| epsg(wkt).map(|(_, code)| code)).or_else(of_esri);
        match (code.and_then(|code| Wgs84::of_code(u32::from(code))), UtmZone::of_wkt(wkt)) {
            (Some(found), _) => Ok(found),
            (None, Some(zone)) => Ok(Wgs84(Conversion::Utm(zone))),
            (None, None) if code.is_some() => Err(Wgs84Error::NoProjection(name(wkt))),
            (None, None) => Err(Wgs84Error::NoCode(name(wkt))),
        }
    }

    fn of_code(code: u32) -> Option<Wgs84> {
        let definition = u16::try_from(code).ok().and_then(crs_definitions::from_code)?;
        let from = Proj::from_proj_string(definition.proj4).ok()?;
        let to = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs").ok()?;
        Some(Wgs84(Conversion::Projections(Box::new([from, to]))))
    }

    /// Place of a point on the Earth; `None` outside of the projection.
    pub fn place(&self, x: f64, y: f64) -> Option<Place> {
        let found = match &self.0 {
            Conversion::Projections(both) => {
                let [from, to] = &**both;
                let mut point = (x, y, 0.0);
                transform(from, to, &mut point).ok()?;
                Place { longitude: point.0.to_degrees(), latitude: point.1.to_degrees() }
            }
            Conversion::Utm(zone) => {
                let (latitude, longitude) = zone.unproject(x, y);
                Place { longitude: longitude.to_degrees(), latitude: latitude.to_degrees() }
            }
        };
        (found.longitude.is_finite() && found.latitude.abs() <= 90.0).then_some(found)
    }
}

/// Easting and northing of a system as a place on Earth. `Ok(None)`: its projection is not known here.
///
/// # Errors
/// Coordinates outside of the projection.
fn place(code: u32, x: f64, y: f64) -> Result<Option<Place>, ()> {
    Wgs84::of_code(code).map(|conversion| conversion.place(x, y).ok_or(())).transpose()
}

/// Place on the Earth of coordinates in a system with an EPSG code.
pub fn place_of(wkt: &str, x: f64, y: f64) -> Option<Place> {
    place(u32::from(epsg(wkt)?.1), x, y).ok().flatten()
}

/// Why coordinates can hardly be in a system with an EPSG code, and a hint.
pub fn misfit(wkt: &str, x: f64, y: f64) -> Option<(String, String)> {
    let code = u32::from(epsg(wkt)?.1);
    if unit_problem(wkt).is_some() {
        return None;
    }
    let area = Area::of_code(code)?;
    let at = format!("x {x:.0}, y {y:.0}");
    let place = match place(code, x, y) {
        Ok(place) => place?,
        Err(()) => {
            let message = format!("{} does not fit: {at} are outside of its projection", name(wkt));
            return Some((message, hint(code, x, y)));
        }
    };
    let distance = area.distance(place);
    if distance > MAX_DISTANCE {
        let message = format!(
            "{} does not fit: {at} are at {place} in it, {} from the area in which it is used, {}",
            name(wkt),
            metres(distance),
            area.describe()
        );
        return Some((message, hint(code, x, y)));
    }
    let longer = with_a_digit_more(code, x, y);
    (!longer.is_empty()).then(|| {
        let message =
            format!("{} puts x {x:.0}, y {y:.0} at {place}; is a digit of the code missing?", name(wkt));
        (message, format!("{}; the WKT of a system, instead of its code, is taken as it is", named(&longer)))
    })
}

/// Why lengths around coordinates in metres are not those on the ground, as in Web Mercator, and a hint.
/// `None` for systems whose projection is not known here.
pub fn distortion(wkt: &str, x: f64, y: f64) -> Option<(String, String)> {
    if unit_problem(wkt).is_some() {
        return None;
    }
    let conversion = Wgs84::of(wkt).ok()?;
    // Metres on the ground for a metre along a line through the place.
    let on_ground = |east: f64, north: f64| {
        let from = conversion.place(x - east, y - north)?;
        let to = conversion.place(x + east, y + north)?;
        let latitudes = [from.latitude, to.latitude];
        Some(along_surface(latitudes, to.longitude - from.longitude) / (2.0 * DISTORTION_STEP))
    };
    let (east, north) = (on_ground(DISTORTION_STEP, 0.0)?, on_ground(0.0, DISTORTION_STEP)?);
    let worst = if (east - 1.0).abs() > (north - 1.0).abs() { east } else { north };
    if (worst - 1.0).abs() <= MAX_DISTORTION {
        return None;
    }
    let place = conversion.place(x, y)?;
    let message = format!(
        "1 m in {} is {worst:.2} m on the ground at {place}, so that ranges and densities are wrong",
        name(wkt)
    );
    let zone = UtmZone::of(place.latitude.to_radians(), place.longitude.to_radians());
    let system = zone.map_or_else(String::new, |zone| format!(", such as EPSG:{}", zone.epsg()));
    Some((message, format!("project the data to a system of the country or the UTM zone{system}")))
}

fn hint(code: u32, x: f64, y: f64) -> String {
    let longer = with_a_digit_more(code, x, y);
    if !longer.is_empty() {
        return format!("a digit may be missing: {}", named(&longer));
    }
    if x.abs() < 100_000.0 && y.abs() < 100_000.0 {
        return "the scene has local coordinates, which belong to no system: leave out the code, or move the \
                scene to its true position"
            .to_owned();
    }
    "--crs does not reproject: name the system that the scene's coordinates are in".to_owned()
}

/// Codes of UTM zones that are `code` with another digit behind it, and in whose areas the coordinates lie.
fn with_a_digit_more(code: u32, x: f64, y: f64) -> Vec<u32> {
    let fits = |code: &u32| {
        wkt_of_epsg(*code).is_ok_and(|wkt| name(&wkt).contains("UTM zone"))
            && Area::of_code(*code)
                .zip(place(*code, x, y).ok().flatten())
                .is_some_and(|(area, place)| area.distance(place) == 0.0)
    };
    (0..10).map(|digit| code * 10 + digit).filter(fits).collect()
}

fn named(codes: &[u32]) -> String {
    let names = codes.iter().filter_map(|code| Some(format!("EPSG:{code} is {}", system_name(*code)?)));
    names.take(3).collect::<Vec<_>>().join(", ")
}

fn system_name(code: u32) -> Option<String> {
    let wkt = wkt_of_epsg(code).ok()?;
    wkt.split('"').nth(1).map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wkt(code: u32) -> String {
        wkt_of_epsg(code).unwrap()
    }

    #[test]
    fn coordinates_far_from_the_area_of_a_code_do_not_fit() {
        let (x, y) = (475_960.0, 5_428_960.0);
        for fits in [25832, 25833, 32632, 31467, 5555] {
            let x = if fits == 31467 { x + 3_000_000.0 } else { x };
            assert_eq!(misfit(&wkt(fits), x, y), None, "{fits}");
        }
        for code in [2193, 27700, 2180, 3035] {
            let (message, _) = misfit(&wkt(code), x, y).unwrap_or_else(|| panic!("{code} fits"));
            assert!(message.contains(&format!("EPSG:{code}")), "{message}");
        }
        let (message, hint) = misfit(&wkt(2583), x, y).unwrap();
        assert!(message.contains("49.0° N 23.7° E"), "{message}");
        assert!(hint.contains("EPSG:25832 is ETRS89 / UTM zone 32N"), "{hint}");
        let (message, hint) = misfit(&wkt(25832), 10.0, 20.0).unwrap();
        assert!(
            message.contains("km from the area") && hint.contains("local coordinates"),
            "{message}; {hint}"
        );
        assert_eq!(misfit(&wkt(4326), x, y), None, "degrees have a message of their own");
    }

    #[test]
    fn lengths_that_differ_from_those_on_the_ground_are_named() {
        let of = |code| distortion(&wkt(code), 900_000.0, 6_280_000.0);
        let (message, hint) = of(3857).unwrap();
        assert!(message.contains("is 0.65 m on the ground at 49.0° N 8.1° E"), "{message}");
        assert!(hint.contains("EPSG:32632"), "{hint}");
        assert!(of(3395).is_some(), "Mercator on an ellipsoid");
        let esri =
            r#"PROJCS["WGS_1984_Web_Mercator_Auxiliary_Sphere",GEOGCS["GCS_WGS_1984"],UNIT["Meter",1.0]]"#;
        assert!(distortion(esri, 900_000.0, 6_280_000.0).is_some());
        assert_eq!(distortion(&wkt(3857), 10.0, 20.0), None, "at the equator lengths are true");
        let (x, y) = (475_960.0, 5_428_960.0);
        for (code, x, y) in [
            (25832, x, y),
            (25833, x, y),
            (5555, x, y),
            (31467, x + 3_000_000.0, y),
            (3035, 4_321_000.0, 3_210_000.0),
            (3035, 2_700_000.0, 1_900_000.0),
            (2154, 700_000.0, 6_600_000.0),
        ] {
            assert_eq!(distortion(&wkt(code), x, y), None, "{code}");
        }
        for wkt in [wkt(4326), wkt(2263), r#"PROJCS["mine",UNIT["metre",1]]"#.to_owned()] {
            assert_eq!(distortion(&wkt, x, y), None, "{wkt}");
        }
    }

    #[test]
    fn distances_are_along_the_surface() {
        let area = Area { west: 170.0, south: -10.0, east: -170.0, north: 10.0 };
        let at = |longitude, latitude| area.distance(Place { longitude, latitude });
        assert_eq!((at(180.0, 0.0), at(-175.0, 5.0)), (0.0, 0.0));
        assert!((at(169.0, 0.0) - 111_195.0).abs() < 10.0 && (at(-169.0, 0.0) - 111_195.0).abs() < 10.0);
        assert!((at(180.0, 11.0) - 111_195.0).abs() < 10.0);
        let world = Area { west: -180.0, south: -90.0, east: 180.0, north: 90.0 };
        assert_eq!(world.distance(Place { longitude: 12.0, latitude: 50.0 }), 0.0);
    }

    #[test]
    fn every_area_is_a_box_on_earth() {
        let lines = AREAS.lines().filter(|line| !line.starts_with('#'));
        for line in lines {
            let (_, codes) = line.split_once(" : ").unwrap();
            let code = codes.split(' ').next().unwrap().parse().unwrap();
            let area = Area::of_code(code).unwrap();
            assert!(area.south < area.north && area.south >= -90.0 && area.north <= 90.0, "{line}");
            assert!(area.west >= -180.0 && area.east <= 180.0, "{line}");
        }
    }
}
