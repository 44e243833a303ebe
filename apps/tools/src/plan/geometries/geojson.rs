//! Geometries of GeoJSON.

use super::error::GeometryError;
use super::shape::{Geometry, Line, Shape, System};
use serde_json::Value;
use vlscan_crs as crs;

/// RFC 7946. `system` is that of what holds `json`.
pub fn read_geojson(json: &Value, system: System, found: &mut Vec<Geometry>) -> Result<(), GeometryError> {
    let system = json.get("crs").map_or(Ok(system), system_of)?;
    let kind = json.get("type").and_then(Value::as_str).ok_or(GeometryError::NoType)?;
    let member = |name: &str| list(json.get(name), || format!("the `{name}` of a {kind}"));
    let mut add = |shape| found.push(Geometry { shape, system: system.clone() });
    match kind {
        "FeatureCollection" => {
            return member("features")?
                .iter()
                .try_for_each(|feature| read_geojson(feature, system.clone(), found));
        }
        "GeometryCollection" => {
            return member("geometries")?
                .iter()
                .try_for_each(|part| read_geojson(part, system.clone(), found));
        }
        "Feature" => match json.get("geometry") {
            None | Some(Value::Null) => {}
            Some(geometry) => return read_geojson(geometry, system, found),
        },
        "Polygon" => add(Shape::Polygon(lines(member("coordinates")?)?)),
        "MultiPolygon" => {
            for polygon in member("coordinates")? {
                add(Shape::Polygon(lines(list(Some(polygon), || "a polygon".to_owned())?)?));
            }
        }
        "LineString" => add(Shape::Line(line(member("coordinates")?)?)),
        "MultiLineString" => {
            lines(member("coordinates")?)?.into_iter().for_each(|line| add(Shape::Line(line)))
        }
        other => add(Shape::Other(other.to_owned())),
    }
    Ok(())
}

fn list(value: Option<&Value>, what: impl Fn() -> String) -> Result<&[Value], GeometryError> {
    let list = value.and_then(Value::as_array).map(Vec::as_slice);
    list.ok_or_else(|| GeometryError::NoList(what()))
}

fn lines(lists: &[Value]) -> Result<Vec<Line>, GeometryError> {
    lists.iter().map(|positions| line(list(Some(positions), || "positions".to_owned())?)).collect()
}

fn line(positions: &[Value]) -> Result<Line, GeometryError> {
    Line::of(positions.iter().map(|position| {
        let numbers =
            position.as_array().and_then(|p| p.iter().map(Value::as_f64).collect::<Option<Vec<_>>>());
        let found = || GeometryError::Position { found: position.to_string(), expected: "[x, y]" };
        numbers.filter(|n| n.len() >= 2).ok_or_else(found)
    }))
}

/// The member `crs` of GeoJSON (the format's version of 2008, §3).
fn system_of(crs: &Value) -> Result<System, GeometryError> {
    if crs.is_null() {
        return Ok(System::OfScene);
    }
    let name = || crs.get("properties")?.get("name")?.as_str();
    let name = name().ok_or_else(|| GeometryError::NoCrsName(crs.to_string()))?;
    // EPSG:25832, urn:ogc:def:crs:EPSG::25832, http://www.opengis.net/def/crs/EPSG/0/25832
    let upper = name.to_ascii_uppercase();
    let last = upper.rsplit([':', '/']).next().unwrap_or_default();
    let code = if upper.contains("EPSG") { crs::parse_epsg(last) } else { None };
    match code {
        _ if last.starts_with("CRS84") => Ok(System::Degrees),
        Some(code) => Ok(System::of_code(code)),
        None => Err(GeometryError::CrsName(name.to_owned())),
    }
}
