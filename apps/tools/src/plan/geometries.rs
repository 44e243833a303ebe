//! Geometries in GeoJSON, KML, GPX and well-known text, in the order of the text.

use serde_json::Value;
use vlscan_crs as crs;

/// Maximum depth of collections within collections.
const MAX_DEPTH: u32 = 64;
/// EPSG codes of longitude and latitude that differ from WGS 84 by less than a few metres: WGS 84, ETRS89,
/// NAD83.
const DEGREES: [u32; 5] = [4326, 4979, 4258, 4937, 4269];

/// Parts of the names of these systems, in capitals.
const NAMES_OF_DEGREES: [&str; 7] =
    ["WGS_1984", "WGS 84", "WGS84", "ETRS_1989", "ETRS89", "NORTH_AMERICAN_1983", "NAD83"];

/// The format of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    GeoJson,
    Kml,
    Gpx,
    Shapefile,
    GeoPackage,
    WellKnownText,
}

impl Format {
    /// Its name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Format::GeoJson => "GeoJSON",
            Format::Kml => "KML",
            Format::Gpx => "GPX",
            Format::Shapefile => "shapefile",
            Format::GeoPackage => "GeoPackage",
            Format::WellKnownText => "well-known text",
        }
    }
}

/// Coordinate reference system that a text states.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum System {
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

    /// The member `crs` of GeoJSON (the format's version of 2008, §3).
    fn of_geojson(crs: &Value) -> Result<System, GeometryError> {
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
}

/// Positions in their order.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Line {
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
pub(super) enum Shape {
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
pub(super) struct Geometry {
    pub shape: Shape,
    pub system: System,
}

/// Problem of a text of geometries.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub(super) enum GeometryError {
    /// A text that begins like GeoJSON but is not JSON.
    #[error("no GeoJSON: {0}")]
    Json(serde_json::Error),
    /// A text that begins like KML but is not XML.
    #[error("no KML or GPX: {0}")]
    Xml(roxmltree::Error),
    /// Text in an unknown notation.
    #[error(
        "expected GeoJSON, KML, GPX or well-known text, POLYGON ((x y, x y, …)) or LINESTRING (x y, x y, …)"
    )]
    Notation,
    /// A member `crs` of GeoJSON without a name.
    #[error(
        "its `crs` is {0}, expected {{\"type\": \"name\", \"properties\": {{\"name\": \"EPSG:25832\"}}}}"
    )]
    NoCrsName(String),
    /// A member `crs` of GeoJSON with the name of an unknown system.
    #[error("its `crs` is `{0}`, expected a name such as EPSG:25832")]
    CrsName(String),
    /// An object of GeoJSON without its type.
    #[error("not GeoJSON: an object without `type`")]
    NoType,
    /// Another value in place of a list of GeoJSON, which is named.
    #[error("{0}: expected a list")]
    NoList(String),
    /// A position that is not one.
    #[error("a position {found}, expected {expected}")]
    Position {
        /// The text, quoted if its notation has no quotes.
        found: String,
        /// The form of positions in the notation.
        expected: &'static str,
    },
    /// A point of a track without its place.
    #[error("a point of a track with lat {latitude:?} and lon {longitude:?}, expected degrees")]
    TrackPoint {
        /// Its attribute `lat`.
        latitude: Option<String>,
        /// Its attribute `lon`.
        longitude: Option<String>,
    },
    /// A point of a track with a height that is not a number.
    #[error("a point of a track with the height `{0}`, expected metres")]
    TrackHeight(String),
    /// A polygon of KML without its outer ring.
    #[error("a Polygon without outerBoundaryIs")]
    NoOuterRing,
    /// The number of a system that is not one.
    #[error("`{0}`, expected SRID=25832")]
    Srid(String),
    /// Well-known text that lacks brackets.
    #[error("`{0}`, expected (x y, x y, …)")]
    Brackets(String),
    /// Collections within collections, beyond the maximum depth.
    #[error("geometry collections are nested too deeply")]
    TooDeep,
}

/// The geometries of a text, those of collections one by one.
///
/// # Errors
/// Problem of the text.
pub(super) fn read_geometries(text: &str) -> Result<(Format, Vec<Geometry>), GeometryError> {
    let mut found = Vec::new();
    let format = match text.trim_start().chars().next() {
        Some('{') => {
            let json: Value = serde_json::from_str(text).map_err(GeometryError::Json)?;
            read_geojson(&json, System::Unstated, &mut found)?;
            Format::GeoJson
        }
        Some('<') => {
            let document = roxmltree::Document::parse(text).map_err(GeometryError::Xml)?;
            if document.root_element().tag_name().name() == "gpx" {
                read_gpx(&document, &mut found)?;
                Format::Gpx
            } else {
                read_kml(&document, &mut found)?;
                Format::Kml
            }
        }
        _ => {
            read_wkt(text, MAX_DEPTH, &mut found)?;
            Format::WellKnownText
        }
    };
    Ok((format, found))
}

/// RFC 7946. `system` is that of what holds `json`.
fn read_geojson(json: &Value, system: System, found: &mut Vec<Geometry>) -> Result<(), GeometryError> {
    let system = json.get("crs").map_or(Ok(system), System::of_geojson)?;
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

/// OGC 12-007r2.
fn read_kml(document: &roxmltree::Document, found: &mut Vec<Geometry>) -> Result<(), GeometryError> {
    for node in document.descendants() {
        let boundaries = |name: &'static str| {
            node.children().filter(move |child: &roxmltree::Node| child.tag_name().name() == name)
        };
        let shape = match node.tag_name().name() {
            "Polygon" => {
                let outer = boundaries("outerBoundaryIs").next().ok_or(GeometryError::NoOuterRing)?;
                let rings = std::iter::once(outer).chain(boundaries("innerBoundaryIs"));
                Shape::Polygon(rings.map(coordinates).collect::<Result<_, _>>()?)
            }
            "LineString" => Shape::Line(coordinates(node)?),
            kind @ ("Point" | "Model" | "Track") => Shape::Other(kind.to_owned()),
            "LinearRing" if !is_boundary(node) => Shape::Other("LinearRing".to_owned()),
            _ => continue,
        };
        found.push(Geometry { shape, system: System::Degrees });
    }
    Ok(())
}

/// The segments of tracks, and routes (GPX 1.1, <https://www.topografix.com/GPX/1/1/>).
fn read_gpx(document: &roxmltree::Document, found: &mut Vec<Geometry>) -> Result<(), GeometryError> {
    for node in document.descendants() {
        let shape = match node.tag_name().name() {
            "trkseg" => Shape::Track(track(node, "trkpt")?),
            "rte" => Shape::Track(track(node, "rtept")?),
            "wpt" => Shape::Other("waypoint".to_owned()),
            _ => continue,
        };
        found.push(Geometry { shape, system: System::Degrees });
    }
    Ok(())
}

/// The positions of the points of a track or a route.
fn track(node: roxmltree::Node, name: &str) -> Result<Line, GeometryError> {
    let points = node.children().filter(|child| child.tag_name().name() == name);
    Line::of(points.map(|point| {
        let number = |name: &str| point.attribute(name).and_then(|text| text.trim().parse::<f64>().ok());
        let (longitude, latitude) =
            number("lon").zip(number("lat")).ok_or_else(|| GeometryError::TrackPoint {
                latitude: point.attribute("lat").map(str::to_owned),
                longitude: point.attribute("lon").map(str::to_owned),
            })?;
        let height = point.children().find(|child| child.tag_name().name() == "ele");
        let height = height.and_then(|ele| ele.text()).map_or("", str::trim);
        let height = match height.is_empty() {
            true => 0.0,
            false => height.parse::<f64>().map_err(|_| GeometryError::TrackHeight(height.to_owned()))?,
        };
        Ok(vec![longitude, latitude, height])
    }))
}

fn is_boundary(ring: roxmltree::Node) -> bool {
    ring.parent().is_some_and(|parent| parent.tag_name().name().ends_with("BoundaryIs"))
}

/// The positions of the first element `coordinates` within a node.
fn coordinates(node: roxmltree::Node) -> Result<Line, GeometryError> {
    let coordinates = node.descendants().find(|node| node.tag_name().name() == "coordinates");
    let texts = coordinates.into_iter().flat_map(|node| node.children()).filter(|child| child.is_text());
    let text: String = texts.filter_map(|child| child.text()).collect();
    Line::of(text.split_whitespace().map(|tuple| {
        let numbers = tuple.split(',').map(|number| number.parse().ok()).collect::<Option<Vec<f64>>>();
        let numbers = numbers.filter(|numbers| (2..=3).contains(&numbers.len()));
        numbers.ok_or_else(|| GeometryError::Position {
            found: format!("`{tuple}`"),
            expected: "longitude,latitude",
        })
    }))
}

/// True if a text is well-known text rather than the name of a file.
pub(super) fn is_well_known_text(text: &str) -> bool {
    let text = text.trim();
    let kind = text.split_once(';').filter(|(before, _)| is_srid(before)).map_or(text, |(_, rest)| rest);
    let word: String = kind.trim_start().chars().take_while(char::is_ascii_alphabetic).collect();
    let word = word.to_ascii_uppercase();
    let kinds = ["POLYGON", "LINESTRING", "MULTIPOLYGON", "MULTILINESTRING", "GEOMETRYCOLLECTION"];
    // With the letters of coordinates that have heights or measures: POLYGONZ.
    let is_kind =
        kinds.iter().any(|kind| word.strip_prefix(kind).is_some_and(|rest| DIMENSIONS.contains(&rest)));
    is_kind && text.contains('(') && text.ends_with(')')
}

/// Dimensions after the kind of a geometry.
const DIMENSIONS: [&str; 4] = ["", "Z", "M", "ZM"];

fn is_srid(text: &str) -> bool {
    text.trim().get(..5).is_some_and(|start| start.eq_ignore_ascii_case("SRID="))
}

/// OGC 06-103r4, §7, with `SRID=25832;` before a geometry as PostGIS writes it. Several geometries follow
/// each other.
fn read_wkt(text: &str, depth: u32, found: &mut Vec<Geometry>) -> Result<(), GeometryError> {
    let mut rest = text;
    loop {
        rest = rest.trim_start_matches([',', ';']).trim_start();
        if rest.is_empty() {
            return Ok(());
        }
        let mut system = System::Unstated;
        if let Some((srid, geometry)) = rest.split_once(';').filter(|(before, _)| is_srid(before)) {
            let code = srid.trim()[5..].trim().parse();
            let code = code.map_err(|_| GeometryError::Srid(srid.to_owned()))?;
            (system, rest) = (System::of_code(code), geometry.trim_start());
        }
        let end = rest.find(|c: char| !(c.is_ascii_alphabetic() || c.is_whitespace())).unwrap_or(rest.len());
        let mut words = rest[..end].split_whitespace();
        let kind = words.next().ok_or(GeometryError::Notation)?.to_ascii_uppercase();
        let is_empty = words.any(|word| word.eq_ignore_ascii_case("EMPTY"));
        let body;
        (body, rest) = match is_empty {
            true => ("", &rest[end..]),
            false => bracketed(&rest[end..]).ok_or(GeometryError::Notation)?,
        };
        let of = |name: &str| kind.strip_prefix(name).is_some_and(|rest| DIMENSIONS.contains(&rest));
        let mut add = |shape| found.push(Geometry { shape, system: system.clone() });
        if of("POLYGON") {
            add(Shape::Polygon(rings(body)?));
        } else if of("LINESTRING") {
            add(Shape::Line(positions(body)?));
        } else if of("MULTIPOLYGON") {
            for polygon in groups(body)? {
                add(Shape::Polygon(rings(polygon)?));
            }
        } else if of("MULTILINESTRING") {
            rings(body)?.into_iter().for_each(|line| add(Shape::Line(line)));
        } else if of("GEOMETRYCOLLECTION") {
            let depth = depth.checked_sub(1).ok_or(GeometryError::TooDeep)?;
            let first = found.len();
            read_wkt(body, depth, found)?;
            let parts = found[first..].iter_mut().filter(|part| part.system == System::Unstated);
            parts.for_each(|part| part.system = system.clone());
        } else {
            add(Shape::Other(kind));
        }
    }
}

/// Text between the first bracket and the one that closes it, and the text behind that; `None` for a text
/// that does not begin with a bracket, or does not close it.
fn bracketed(text: &str) -> Option<(&str, &str)> {
    let inner = text.strip_prefix('(')?;
    let mut depth = 1_usize;
    let end = inner.char_indices().find(|(_, c)| {
        match c {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        depth == 0
    })?;
    Some((&inner[..end.0], &inner[end.0 + 1..]))
}

/// The contents of brackets that follow each other, with commas between them.
fn groups(text: &str) -> Result<Vec<&str>, GeometryError> {
    let (mut found, mut rest) = (Vec::new(), text.trim());
    while !rest.is_empty() {
        let group;
        (group, rest) = bracketed(rest).ok_or_else(|| GeometryError::Brackets(rest.to_owned()))?;
        found.push(group);
        rest = rest.trim_start().trim_start_matches(',').trim_start();
    }
    Ok(found)
}

fn rings(text: &str) -> Result<Vec<Line>, GeometryError> {
    groups(text)?.into_iter().map(positions).collect()
}

fn positions(text: &str) -> Result<Line, GeometryError> {
    let texts = text.split(',').filter(|position| !position.trim().is_empty());
    Line::of(texts.map(|position| {
        let numbers = position.split_whitespace().map(|n| n.parse().ok()).collect::<Option<Vec<f64>>>();
        let numbers = numbers.filter(|numbers| (2..=4).contains(&numbers.len()));
        numbers.ok_or_else(|| GeometryError::Position {
            found: format!("`{}`", position.trim()),
            expected: "x and y",
        })
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<Geometry> {
        read_geometries(text).unwrap().1
    }

    fn refused(text: &str) -> String {
        read_geometries(text).unwrap_err().to_string()
    }

    fn polygon(rings: &[&[[f64; 2]]]) -> Shape {
        let ring = |positions: &&[[f64; 2]]| Line { positions: positions.to_vec(), has_heights: false };
        Shape::Polygon(rings.iter().map(ring).collect())
    }

    const RING: [[f64; 2]; 4] = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.5], [0.0, 0.0]];
    const HOLE: [[f64; 2]; 4] = [[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 1.0]];

    #[test]
    fn all_notations_give_the_same_geometries() {
        let ring = "[[0,0],[4,0],[4,4.5,0],[0,0]]";
        let hole = "[[1,1],[2,1],[2,2],[1,1]]";
        let geojson = format!(
            r#"{{"type":"FeatureCollection","crs":{{"type":"name","properties":{{"name":"urn:ogc:def:crs:OGC:1.3:CRS84"}}}},"features":[
            {{"type":"Feature","geometry":null}},
            {{"type":"Feature","geometry":{{"type":"MultiPolygon","coordinates":[[{ring},{hole}],[{ring}]]}}}},
            {{"type":"Feature","geometry":{{"type":"GeometryCollection","geometries":[{{"type":"Point","coordinates":[1,2]}},
            {{"type":"LineString","coordinates":{ring}}}]}}}}]}}"#
        );
        let boundary = |name: &str, text: &str| {
            format!("<{name}><LinearRing><coordinates>{text}</coordinates></LinearRing></{name}>")
        };
        let (ring, hole) = ("0,0 4,0\n4,4.5,0 0,0", "1,1 2,1 <!-- a corner -->2,2 1,1");
        let kml = format!(
            "<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document><Polygon>{}{}</Polygon><Polygon>{}</Polygon><Point/>\
             <LineString><coordinates>{ring}</coordinates></LineString></Document></kml>",
            // The order of boundaries is free.
            boundary("innerBoundaryIs", hole),
            boundary("outerBoundaryIs", ring),
            boundary("outerBoundaryIs", ring)
        );
        let ring = "(0 0, 4 0, 4 4.5 0, 0 0)";
        let wkt = format!(
            "SRID=4326;MULTIPOLYGON ((({}), (1 1,2 1,2 2,1 1)), ({ring}))\n\
             srid=4326;GeometryCollection(POINT (1 2), LINESTRING Z {ring})",
            &ring[1..ring.len() - 1]
        );
        let line = Shape::Line(Line { positions: RING.to_vec(), has_heights: false });
        for text in [geojson, kml, wkt] {
            let mut found = read(&text);
            assert!(found.iter().all(|geometry| geometry.system == System::Degrees), "{text}");
            assert!(
                matches!(&found.remove(2).shape, Shape::Other(kind) if kind.eq_ignore_ascii_case("point"))
            );
            let shapes: Vec<Shape> = found.into_iter().map(|geometry| geometry.shape).collect();
            assert_eq!(shapes, [polygon(&[&RING, &HOLE]), polygon(&[&RING]), line.clone()], "{text}");
        }
    }

    #[test]
    fn heights_are_noticed_and_systems_read() {
        let has_heights = |text: &str| match &read(text)[0].shape {
            Shape::Line(line) => line.has_heights,
            other => panic!("{other:?}"),
        };
        assert!(has_heights("LINESTRINGZ(0 0 5, 1 1 0)") && !has_heights("LINESTRING(0 0, 1 1)"));
        let of_crs = |crs: &str| {
            let text = format!(r#"{{"type":"LineString","crs":{crs},"coordinates":[[0,0],[9,9]]}}"#);
            read_geometries(&text).map(|found| found.1[0].system.clone())
        };
        let named = |name: &str| of_crs(&format!(r#"{{"type":"name","properties":{{"name":"{name}"}}}}"#));
        for (name, system) in [
            ("EPSG:25833", System::Epsg(25833)),
            ("urn:ogc:def:crs:EPSG::25833", System::Epsg(25833)),
            ("http://www.opengis.net/def/crs/EPSG/0/25833", System::Epsg(25833)),
            ("urn:ogc:def:crs:EPSG:6.9:4258", System::Degrees),
            ("OGC:CRS84", System::Degrees),
        ] {
            assert_eq!(named(name).unwrap(), system);
        }
        assert_eq!(of_crs("null").unwrap(), System::OfScene);
        let refused = |found: Result<System, GeometryError>| found.unwrap_err().to_string();
        assert!(refused(named("my town's grid")).contains("my town's grid"));
        let link = of_crs(r#"{"type":"link","properties":{"href":"x"}}"#);
        assert!(refused(link).contains("EPSG:25832"));
        assert_eq!(read("LINESTRING (0 0, 1 1)")[0].system, System::Unstated);
        assert_eq!(read("SRID=25832;LINESTRING (0 0, 1 1)")[0].system, System::Epsg(25832));
        assert_eq!(read("SRID=0;LINESTRING (0 0, 1 1)")[0].system, System::OfScene);
    }

    #[test]
    fn wrong_texts_are_refused_with_what_is_wrong() {
        for (text, part) in [
            ("{\"type\":\"Polygon\"}", "`coordinates` of a Polygon"),
            ("{\"a\":1}", "without `type`"),
            ("{", "no GeoJSON"),
            (r#"{"type":"LineString","coordinates":[[1],[2,3]]}"#, "[1], expected [x, y]"),
            ("<kml><Polygon/></kml>", "outerBoundaryIs"),
            ("<kml><LineString><coordinates>1, 2</coordinates></LineString></kml>", "`1,`"),
            ("<kml>", "no KML or GPX"),
            ("<gpx><trk><trkseg><trkpt lat=\"49\"/></trkseg></trk></gpx>", "lon None"),
            (
                "<gpx><trk><trkseg><trkpt lat=\"49\" lon=\"8\"><ele>1,5</ele></trkpt></trkseg></trk></gpx>",
                "with the height `1,5`, expected metres",
            ),
            ("id,wkt\n1,POLYGON ((0 0, 1 1))", "expected GeoJSON"),
            ("POLYGON ((0 0, 1 1)", "expected GeoJSON"),
            ("POLYGON (0 0, 1 1)", "expected (x y"),
            ("LINESTRING (0 0, 1 b)", "`1 b`"),
            ("SRID=utm;LINESTRING (0 0, 1 1)", "SRID=25832"),
        ] {
            assert!(refused(text).contains(part), "{text}: {}", refused(text));
        }
        let deep = "GEOMETRYCOLLECTION (".repeat(9999) + &")".repeat(9999);
        assert!(refused(&deep).contains("nested too deeply"));
        assert_eq!(read("POLYGON EMPTY")[0].shape, Shape::Polygon(Vec::new()));
    }

    #[test]
    fn names_of_files_are_no_well_known_text() {
        for (text, is_text) in [
            ("POLYGON ((0 0, 1 1))", true),
            (" linestring z(0 0 1, 1 1 1)", true),
            ("SRID=25832;MULTIPOLYGON(((0 0, 1 1)))", true),
            ("polygon.geojson", false),
            ("polygon (1).geojson", false),
            ("plot.wkt", false),
        ] {
            assert_eq!(is_well_known_text(text), is_text, "{text}");
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "(SRID=0;)?(POLYGON|LINESTRING|<Polygon>|\\{\"type\":)?[-A-Za-z0-9(){}<>\\[\\]\",;:/.= \né]{0,60}") {
            let _ = read_geometries(&text);
            is_well_known_text(&text);
        }
    }
}
