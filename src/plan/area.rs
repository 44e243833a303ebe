//! Areas and lines on the ground, in the scene's world coordinates.

use crate::error::{Error, Result};
use crate::geom::is_inside;
use crate::input::read_text;
use serde_json::Value;
use std::path::Path;

/// Maximum size of a file of an area or a line, bytes.
const MAX_BYTES: u64 = 64 << 20;
/// Largest extent of coordinates that may be degrees; as metres such an area is too small to be scanned.
const MAX_DEGREES: f64 = 0.5;

/// A polygon without holes: its corners in order, without repeating the first one at the end. Coordinates are m.
#[derive(Clone, Debug, PartialEq)]
pub struct Area {
    corners: Vec<[f64; 2]>,
}

impl Area {
    /// # Errors
    /// A sentence that tells what is wrong: fewer than three corners, no area, a coordinate that is no metre.
    pub fn new(mut corners: Vec<[f64; 2]>) -> std::result::Result<Area, String> {
        corners.dedup();
        if corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        check_coordinates(&corners)?;
        if corners.len() < 3 {
            return Err(format!("an area of {} corners, expected at least 3", corners.len()));
        }
        let area = Area { corners };
        if area.square_metres() < 1e-6 {
            return Err("the corners of the area lie on one line".to_owned());
        }
        Ok(area)
    }

    /// The rectangle between two corners.
    pub fn rectangle(low: [f64; 2], high: [f64; 2]) -> std::result::Result<Area, String> {
        Area::new(vec![low, [high[0], low[1]], high, [low[0], high[1]]])
    }

    pub fn corners(&self) -> &[[f64; 2]] {
        &self.corners
    }

    /// The sides, from corner to corner.
    pub fn sides(&self) -> impl Iterator<Item = [[f64; 2]; 2]> {
        let next = self.corners.iter().cycle().skip(1);
        self.corners.iter().zip(next).map(|(a, b)| [*a, *b])
    }

    /// Gauss' formula for the area of a polygon.
    pub fn square_metres(&self) -> f64 {
        // Relative to a corner, since world coordinates have many digits before the point.
        let [x0, y0] = self.corners[0];
        let cross = |[a, b]: [[f64; 2]; 2]| (a[0] - x0) * (b[1] - y0) - (b[0] - x0) * (a[1] - y0);
        0.5 * self.sides().map(cross).sum::<f64>().abs()
    }

    /// Whether a point is inside.
    pub fn contains(&self, place: [f64; 2]) -> bool {
        is_inside(&self.corners, place)
    }

    /// The smallest and the largest coordinates.
    pub fn bounds(&self) -> ([f64; 2], [f64; 2]) {
        let fold = |pick: fn(f64, f64) -> f64, from: f64| {
            self.corners.iter().fold([from; 2], |best, c| [pick(best[0], c[0]), pick(best[1], c[1])])
        };
        (fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY))
    }

    /// The smallest and the largest value of `along` where `across` is from `low` to `high`, both being linear functions
    /// of the position; `None` where the area does not reach.
    pub fn extent(
        &self,
        along: impl Fn([f64; 2]) -> f64,
        across: impl Fn([f64; 2]) -> f64,
        [low, high]: [f64; 2],
    ) -> Option<[f64; 2]> {
        let mut found: Option<[f64; 2]> = None;
        let mut add = |value: f64| {
            let [least, most] = found.unwrap_or([value; 2]);
            found = Some([least.min(value), most.max(value)]);
        };
        for [a, b] in self.sides() {
            let (s, e) = (across(a), across(b));
            // The part of the side whose distance is within the limits, as fractions of the side.
            let at = |limit: f64| if s == e { 0.0 } else { (limit - s) / (e - s) };
            let (mut from, mut to) = (0.0_f64, 1.0_f64);
            if s == e {
                if s < low || s > high {
                    continue;
                }
            } else {
                from = from.max(at(low).min(at(high)));
                to = to.min(at(low).max(at(high)));
            }
            if from <= to {
                let value = |t: f64| along(a) + t * (along(b) - along(a));
                add(value(from));
                add(value(to));
            }
        }
        found
    }
}

fn check_coordinates(points: &[[f64; 2]]) -> std::result::Result<(), String> {
    match points.iter().flatten().find(|v| !crate::quantity::COORDINATE.contains(**v)) {
        Some(wrong) => {
            Err(format!("coordinate {wrong:?}, expected {}", crate::quantity::COORDINATE.expected))
        }
        None => Ok(()),
    }
}

/// Reads an area: a file of GeoJSON or well-known text, or well-known text itself. Its first polygon counts, without its
/// holes. Coordinates must be those of the scene; those that look like degrees are refused.
///
/// # Errors
/// [`Error::Input`], [`Error::Io`].
pub fn read_area(source: &str) -> Result<Area> {
    let failed = |what: String| Error::input(format!("{source}: {what}"));
    Area::new(read_positions(source, "Polygon")?).map_err(failed)
}

/// Reads a line, at least two positions, from the same sources as [`read_area`].
///
/// # Errors
/// As [`read_area`].
pub fn read_line(source: &str) -> Result<Vec<[f64; 2]>> {
    let failed = |what: String| Error::input(format!("{source}: {what}"));
    let mut line = read_positions(source, "LineString")?;
    line.dedup();
    check_coordinates(&line).map_err(failed)?;
    match line.len() {
        0 | 1 => Err(failed("a line of one position, expected at least 2".to_owned())),
        _ => Ok(line),
    }
}

fn read_positions(source: &str, wanted: &'static str) -> Result<Vec<[f64; 2]>> {
    let inline = source.trim_start().to_ascii_uppercase().starts_with(&wanted.to_ascii_uppercase());
    let text = if inline { source.to_owned() } else { read_text(Path::new(source), MAX_BYTES)? };
    let failed = |what: String| Error::input(format!("{source}: {what}"));
    let found = match text.trim_start().starts_with('{') {
        true => {
            let json: Value = serde_json::from_str(&text).map_err(|e| failed(format!("no GeoJSON: {e}")))?;
            if let Some(crs) = geographic(&json) {
                return Err(failed(crs));
            }
            in_geojson(&json, wanted)
        }
        false => in_wkt(&text, wanted),
    };
    let found = found.map_err(failed)?;
    let in_range = found.iter().all(|p| p[0].abs() <= 180.0 && p[1].abs() <= 90.0);
    if in_range && spread(&found) < MAX_DEGREES {
        return Err(failed(
            "its coordinates look like degrees, expected metres in the scene's coordinates (reproject it, for example with \
             ogr2ogr -t_srs EPSG:25832)"
                .to_owned(),
        ));
    }
    Ok(found)
}

/// The larger extent of the positions.
fn spread(points: &[[f64; 2]]) -> f64 {
    let extent = |i: usize| {
        let (low, high) = points
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p[i]), high.max(p[i])));
        high - low
    };
    extent(0).max(extent(1))
}

/// The complaint about a GeoJSON whose member `crs` names geographic coordinates.
fn geographic(json: &Value) -> Option<String> {
    let name = json.get("crs")?.get("properties")?.get("name")?.as_str()?;
    let is_geographic = name.contains("CRS84") || name.ends_with("4326");
    is_geographic
        .then(|| format!("its coordinates are degrees ({name}), expected metres in the scene's coordinates"))
}

/// The positions of the first geometry of the type `wanted` (RFC 7946), in the outermost ring of a polygon.
fn in_geojson(json: &Value, wanted: &str) -> std::result::Result<Vec<[f64; 2]>, String> {
    fn find<'v>(json: &'v Value, wanted: &str, depth: usize) -> Option<&'v Value> {
        let coordinates = || json.get("coordinates");
        match json.get("type")?.as_str()? {
            kind if kind == wanted => match wanted {
                "Polygon" => coordinates()?.get(0),
                _ => coordinates(),
            },
            "MultiPolygon" if wanted == "Polygon" => coordinates()?.get(0)?.get(0),
            "MultiLineString" if wanted == "LineString" => coordinates()?.get(0),
            _ if depth > 8 => None,
            "Feature" => find(json.get("geometry")?, wanted, depth + 1),
            "FeatureCollection" => {
                json.get("features")?.as_array()?.iter().find_map(|f| find(f, wanted, depth + 1))
            }
            "GeometryCollection" => {
                json.get("geometries")?.as_array()?.iter().find_map(|g| find(g, wanted, depth + 1))
            }
            _ => None,
        }
    }
    let ring =
        find(json, wanted, 0).and_then(Value::as_array).ok_or(format!("no {wanted} in the GeoJSON"))?;
    let position = |p: &Value| Some([p.get(0)?.as_f64()?, p.get(1)?.as_f64()?]);
    ring.iter().map(|p| position(p).ok_or(format!("a position {p}, expected [x, y]"))).collect()
}

/// The positions of `POLYGON ((x y, …))` or `LINESTRING (x y, …)` (OGC 06-103r4, §7); z and m are ignored.
fn in_wkt(text: &str, wanted: &str) -> std::result::Result<Vec<[f64; 2]>, String> {
    let expected = || format!("expected GeoJSON or {} (x y, x y, …)", wanted.to_ascii_uppercase());
    let at = text.to_ascii_uppercase().find(&wanted.to_ascii_uppercase()).ok_or_else(expected)?;
    let inner = text[at..].split(['(', ')']).find(|part| part.contains(',')).ok_or_else(expected)?;
    let position = |text: &str| {
        let mut numbers = text.split_whitespace().map(str::parse::<f64>);
        match (numbers.next(), numbers.next()) {
            (Some(Ok(x)), Some(Ok(y))) => Ok([x, y]),
            _ => Err(format!("a position `{}`, expected x and y", text.trim())),
        }
    };
    inner.split(',').filter(|text| !text.trim().is_empty()).map(position).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn l_shape() -> Area {
        Area::new(vec![[0.0, 0.0], [40.0, 0.0], [40.0, 10.0], [10.0, 10.0], [10.0, 30.0], [0.0, 30.0]])
            .unwrap()
    }

    #[test]
    fn an_area_knows_size_inside_and_extent() {
        let area = l_shape();
        assert_eq!(area.square_metres(), 600.0);
        assert!(area.contains([35.0, 5.0]) && !area.contains([35.0, 15.0]) && area.contains([5.0, 25.0]));
        assert_eq!(area.bounds(), ([0.0, 0.0], [40.0, 30.0]));
        let along_x = |limits| area.extent(|p| p[0], |p| p[1], limits);
        assert_eq!(along_x([2.0, 8.0]), Some([0.0, 40.0]));
        assert_eq!(along_x([12.0, 20.0]), Some([0.0, 10.0]));
        assert_eq!(along_x([31.0, 40.0]), None);
        // Far from the origin as well.
        let far = Area::rectangle([5e5, 5.4e6], [5e5 + 100.0, 5.4e6 + 50.0]).unwrap();
        assert!((far.square_metres() - 5000.0).abs() < 1e-6);
    }

    #[test]
    fn polygons_are_read_in_both_notations() {
        let wkt = "POLYGON ((0 0, 40 0, 40 10, 10 10, 10 30, 0 30, 0 0), (1 1, 2 1, 2 2, 1 1))";
        assert_eq!(read_area(wkt).unwrap(), l_shape());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plot.geojson");
        let json = r#"{"type":"FeatureCollection","features":[{"type":"Feature","properties":{},"geometry":
            {"type":"Polygon","coordinates":[[[0,0],[40,0],[40,10],[10,10],[10,30],[0,30],[0,0]]]}}]}"#;
        std::fs::write(&path, json).unwrap();
        assert_eq!(read_area(path.to_str().unwrap()).unwrap(), l_shape());
        assert_eq!(read_line("linestring(0 0 5, 30.5 40 5)").unwrap(), [[0.0, 0.0], [30.5, 40.0]]);
    }

    #[test]
    fn wrong_areas_are_refused_with_what_is_wrong() {
        let said = |source: &str| match read_area(source) {
            Err(Error::Input(problems)) => problems.render(false),
            other => panic!("{other:?}"),
        };
        assert!(said("POLYGON ((0 0, 1 1))").contains("at least 3"));
        assert!(said("POLYGON ((0 0, 1 1, 2 2))").contains("one line"));
        assert!(said("POLYGON ((0 0, 1 b, 2 2))").contains("1 b"));
        assert!(said("POLYGON ((8.67 49.41, 8.68 49.41, 8.68 49.42))").contains("degrees"));
        assert!(read_area("POLYGON ((-1.5 -1.5, 1.5 -1.5, 1.5 1.5, -1.5 1.5))").is_ok(), "a plot of 3 m");
        assert!(said("POLYGON ((0 0, 1e300 0, 2 2))").contains("coordinate"));
        assert!(read_line("LINESTRING (1 1)").is_err());
    }
}
