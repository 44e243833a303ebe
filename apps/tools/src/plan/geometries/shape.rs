//! Geometries, and the systems of their coordinates.

use vlscan_crs as crs;

/// EPSG codes of longitude and latitude that differ from WGS 84 by less than a few metres: WGS 84, ETRS89,
/// NAD83.
const DEGREES: [u32; 5] = [4326, 4979, 4258, 4937, 4269];

/// Parts of the names of these systems, in capitals.
const NAMES_OF_DEGREES: [&str; 7] =
    ["WGS_1984", "WGS 84", "WGS84", "ETRS_1989", "ETRS89", "NORTH_AMERICAN_1983", "NAD83"];

/// Coordinate reference system that a text states.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum System {
    /// Nothing.
    Unstated,
    /// They are longitude and latitude, degrees.
    Degrees,
    /// They are in the projected system of this EPSG code.
    Epsg(u32),
    /// They are in the system of this well-known text, which has no code.
    Wkt(String),
    /// They are those of the scene: `"crs": null` and `SRID=0`.
    OfScene,
}

impl System {
    /// The system of an EPSG code, or of 0.
    pub fn of_code(code: u32) -> System {
        match code {
            0 => System::OfScene,
            code if DEGREES.contains(&code) => System::Degrees,
            code => System::Epsg(code),
        }
    }

    /// The system of a well-known text.
    pub fn of_wkt(wkt: &str) -> System {
        let code = crs::projected_epsg(wkt).or_else(|| crs::epsg(wkt).map(|(_, code)| code));
        let upper = wkt.trim_start().to_ascii_uppercase();
        // As ESRI and others name them: GEOGCS["GCS_WGS_1984", …
        let is_known = |name: &str| NAMES_OF_DEGREES.iter().any(|known| name.contains(known));
        match code {
            Some(code) => System::of_code(code.into()),
            None if upper.starts_with("GEOG") && upper.split('"').nth(1).is_some_and(is_known) => {
                System::Degrees
            }
            None => System::Wkt(wkt.trim().to_owned()),
        }
    }
}

/// Positions in their order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Line {
    pub positions: Vec<[f64; 2]>,
    /// True if a position has a height other than 0, or a measure.
    pub has_heights: bool,
}

impl Line {
    /// A line of positions of at least two numbers each.
    pub fn of<E>(positions: impl Iterator<Item = Result<Vec<f64>, E>>) -> Result<Line, E> {
        let mut line = Line::default();
        for numbers in positions {
            let numbers = numbers?;
            line.positions.push([numbers[0], numbers[1]]);
            line.has_heights |= numbers[2..].iter().any(|height| *height != 0.0);
        }
        Ok(line)
    }
}

/// Points of a geometry.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// The rings of a polygon, the outermost one first.
    Polygon(Vec<Line>),
    Line(Line),
    /// A track or a route, which may be closed.
    Track(Line),
    /// The name of another kind.
    Other(String),
}

/// A shape and what its coordinates are.
#[derive(Clone, Debug, PartialEq)]
pub struct Geometry {
    pub shape: Shape,
    pub system: System,
}
