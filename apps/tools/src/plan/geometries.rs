//! Geometries in GeoJSON, KML, GPX and well-known text, in the order of the text.
//!
//! | file | what it does |
//! |---|---|
//! | `shape` | geometries, and the systems of their coordinates |
//! | `geojson`, `markup`, `wkt` | the notations: GeoJSON; KML and GPX; well-known text |
//! | `error` | problems of texts |

mod error;
mod geojson;
mod markup;
mod shape;
mod wkt;

pub(super) use error::GeometryError;
pub(super) use shape::{Geometry, Line, Shape, System};
pub(super) use wkt::is_well_known_text;

use geojson::read_geojson;
use markup::{read_gpx, read_kml};
use serde_json::Value;
use wkt::read_wkt;

/// Maximum depth of collections within collections.
const MAX_DEPTH: u32 = 64;

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
