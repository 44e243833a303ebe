//! Tests of areas and lines from files.

use super::*;
use vlscan_render::Render as _;

fn l_shape() -> Area {
    Area::new(vec![[0.0, 0.0], [40.0, 0.0], [40.0, 10.0], [10.0, 10.0], [10.0, 30.0], [0.0, 30.0]]).unwrap()
}

fn zone(text: &str) -> String {
    crs::wkt_of_zone(UtmZone::parse(text).unwrap()).unwrap()
}

/// Reads an area from a file with this text; also returns what is told.
fn read(name: &str, text: &str, scene: Option<&str>, buffer: Option<f64>) -> Result<(Area, String)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    let found = read_area(path.to_str().unwrap(), scene, buffer);
    found.map(|(area, found)| (area, found.render(false)))
}

fn refused<T: std::fmt::Debug>(found: Result<T>) -> String {
    match found {
        Err(Error::Input(problems)) => problems.render(false),
        other => panic!("{other:?}"),
    }
}

fn geojson(crs: &str, geometry: &str) -> String {
    let features = format!(r#"[{{"type":"Feature","properties":{{}},"geometry":{geometry}}}]"#);
    format!(r#"{{{crs}"type":"FeatureCollection","features":{features}}}"#)
}

const RING: &str = "[[0,0],[40,0],[40,10],[10,10],[10,30],[0,30],[0,0]]";

#[test]
fn polygons_are_read_in_all_notations() {
    let told = |found: (Area, Diagnostics)| (found.0, found.1.render(false));
    let wkt = "POLYGON ((0 0, 40 0, 40 10, 10 10, 10 30, 0 30, 0 0))";
    assert_eq!(told(read_area(wkt, None, None).unwrap()), (l_shape(), String::new()));
    let polygon = format!(r#"{{"type":"Polygon","coordinates":[{RING}]}}"#);
    let found = read("plot.geojson", &geojson("\"crs\":null,", &polygon), None, None).unwrap();
    assert_eq!(found, (l_shape(), String::new()));
    let (line, _) = read_line("linestring(0 0, 30.5 40)", None).unwrap();
    assert_eq!(line, [[0.0, 0.0], [30.5, 40.0]]);
}

#[test]
fn what_is_not_used_is_told() {
    let polygons =
        format!(r#"{{"type":"MultiPolygon","coordinates":[[{RING},[[1,1],[2,1],[2,2],[1,1]]],[{RING}]]}}"#);
    let (area, told) = read("plot.geojson", &geojson("\"crs\":null,", &polygons), None, None).unwrap();
    assert_eq!(area, l_shape());
    for part in
        ["warning: of 2 polygons only the first one is used", "plot.geojson", "the holes of the polygon (1)"]
    {
        assert!(told.contains(part), "{part}: {told}");
    }
    let text = "LINESTRING (0 0 5, 100 0 6)\nPOINT (1 1)\nPOINT (2 2)\nLINESTRING (0 0, 1 1)";
    let (_, told) = read("road.wkt", text, None, Some(10.0)).unwrap();
    for part in ["of 2 lines only", "only the first line is: 2 POINT", "the heights of the line are not used"]
    {
        assert!(told.contains(part), "{part}: {told}");
    }
    // Text of the command line has no file.
    let hole = "POLYGON ((0 0, 40 0, 40 40, 0 0), (1 1, 2 1, 2 2, 1 1))";
    let (_, found) = read_area(hole, None, None).unwrap();
    assert!(
        found.render(false).contains("POLYGON ((0 0, 40 0, 40 40, 0 0), (1 1"),
        "{}",
        found.render(false)
    );
}

#[test]
fn geojson_without_a_system_has_degrees() {
    let line = r#"{"type":"LineString","coordinates":[[8,49],[8.8,49.3]]}"#;
    let said = refused(read("road.geojson", line, None, Some(40.0)));
    assert!(said.contains("degrees") && said.contains("\"crs\": null"), "{said}");
    let utm = zone("32N");
    let (area, told) = read("road.geojson", line, Some(&utm), Some(40.0)).unwrap();
    let (low, high) = area.bounds();
    // 58 km to the east.
    assert!(
        told.is_empty() && (55e3..62e3).contains(&(high[0] - low[0])) && low[0] > 4e5,
        "{told} {low:?} {high:?}"
    );
    // A plot of 40 m over a scene that names no system, or one that does.
    let polygon = format!(r#"{{"type":"Polygon","coordinates":[{RING}]}}"#);
    let (area, told) = read("plot.geojson", &polygon, None, None).unwrap();
    assert!(area == l_shape() && told.contains("warning: its coordinates are read as metres"), "{told}");
    let (_, told) = read("plot.geojson", &polygon.replace("40", "14"), Some(&utm), None).unwrap();
    assert!(told.contains("extend over 30, are read as degrees"), "{told}");
    let far = polygon.replace("40", "60");
    assert!(
        refused(read("plot.geojson", &far, Some(&utm), None))
            .contains("too far from the scene's UTM zone 32N")
    );
    // Coordinates that cannot be degrees.
    let grid = r#"{"type":"Polygon","coordinates":[[[500000,5400000],[500100,5400000],[500100,5400100],[500000,5400000]]]}"#;
    assert_eq!(read("plot.geojson", grid, Some(&utm), None).unwrap().1, "");
}

#[test]
fn the_system_of_a_file_counts() {
    let utm = zone("32N");
    let read = |code: &str, ring: &str, scene: Option<&str>| {
        let crs = format!(r#""crs":{{"type":"name","properties":{{"name":"{code}"}}}},"#);
        let polygon = format!(r#"{{"type":"Polygon","coordinates":[{ring}]}}"#);
        read("plot.geojson", &geojson(&crs, &polygon), scene, None)
    };
    let grid = "[[500000,5400000],[500100,5400000],[500100,5400100],[500000,5400000]]";
    let plain = read("EPSG:25832", grid, Some(&utm)).unwrap();
    assert_eq!((plain.0.bounds().0, plain.1.as_str()), ([5e5, 5.4e6], ""));
    // The central meridian of zone 33 is 441 km east of that of zone 32.
    let (area, told) = read("urn:ogc:def:crs:EPSG::25833", grid, Some(&utm)).unwrap();
    let (low, _) = area.bounds();
    assert!(told.is_empty() && (930e3..950e3).contains(&low[0]), "{low:?} {told}");
    let (area, told) = read("EPSG:25833", grid, None).unwrap();
    assert!(
        area.bounds().0 == [5e5, 5.4e6] && told.contains("note: its coordinates are in EPSG:25833"),
        "{told}"
    );
    assert!(
        refused(read("EPSG:31467", grid, Some(&utm))).contains("in EPSG:31467, those of the scene in WGS 84")
    );
    assert!(refused(read("EPSG:2222", grid, None)).contains("feet"));
    assert!(refused(read("EPSG:4267", grid, None)).contains("degrees"));
    let degrees = "[[8.67,49.41],[8.68,49.41],[8.68,49.42],[8.67,49.41]]";
    assert!(read("EPSG:4326", degrees, Some(&utm)).unwrap().0.bounds().0[0] > 4e5);
    assert!(refused(read("EPSG:4326", degrees, None)).contains("UTM zone"));
    let lambert = crs::wkt_of_epsg(2154).unwrap();
    assert!(refused(read("EPSG:4326", degrees, Some(&lambert))).contains("is not a UTM zone"));
    assert!(read("EPSG:2154", grid, Some(&lambert)).unwrap().1.is_empty());
}

#[test]
fn wrong_areas_are_refused_with_what_is_wrong() {
    let said = |source: &str| refused(read_area(source, None, None));
    assert!(said("POLYGON ((0 0, 1 1))").contains("at least 3"));
    assert!(said("POLYGON ((0 0, 1 1, 2 2))").contains("one line"));
    assert!(said("POLYGON ((0 0, 1 b, 2 2))").contains("1 b"));
    assert!(said("POLYGON EMPTY (())").contains("expected"));
    assert!(said("POLYGON ((8.67 49.41, 8.68 49.41, 8.68 49.42))").contains("degrees"));
    assert!(
        read_area("POLYGON ((-1.5 -1.5, 1.5 -1.5, 1.5 1.5, -1.5 1.5))", None, None).is_ok(),
        "a plot of 3 m"
    );
    assert!(read_area("SRID=0;POLYGON ((0 0, 0.5 0, 0.5 0.5))", None, None).is_ok(), "of half a metre");
    assert!(said("POLYGON ((0 0, 1e300 0, 2 2))").contains("coordinate"));
    assert!(read_line("LINESTRING (1 1)", None).is_err());
    assert!(said("LINESTRING (0 0, 100 0)").contains("--buffer"));
    assert!(
        said("POLYGON ((0 0, 9 9, 9 0, 0 9))").contains("sides of the area cross each other at x 4.5 y 4.5")
    );
    for text in ["hello", "POLYGON ((0 0, 9.5 0, 9.5 9", "POLYGON 0 0, 9 0, 9 9"] {
        let found = said(text);
        assert!(found.contains("neither a file nor") && found.contains("\"POLYGON ((0 0, 100 0"), "{found}");
    }
    assert!(refused(read_line("road", None)).contains("\"LINESTRING (0 0"));
    for name in ["plot.geojson", "areas/plot"] {
        assert!(said(name).contains("there is no such file"), "{name}");
    }
}

#[test]
fn lines_become_areas_and_degrees_are_projected() {
    let (corridor, _) = read_area("LINESTRING (0 0, 100 0)", None, Some(10.0)).unwrap();
    assert!(corridor.contains([50.0, 9.0]) && !corridor.contains([50.0, 11.0]));
    let (line, same, _) = read_corridor("LINESTRING (0 0, 100 0)", None, 10.0).unwrap();
    assert_eq!((line, same), (vec![[0.0, 0.0], [100.0, 0.0]], corridor));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("road.kml");
    let kml = "<?xml version=\"1.0\"?><kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document><Placemark><LineString>\
                   <coordinates>9.0,49.0,0 9.01,49.0,0\n 9.01,49.005,0</coordinates></LineString></Placemark></Document></kml>";
    std::fs::write(&path, kml).unwrap();
    let source = path.to_str().unwrap();
    let (line, found) = read_line(source, Some(&zone("32N"))).unwrap();
    // The central meridian of zone 32 is 9 degrees east.
    assert!((line[0][0] - 5e5).abs() < 1e-6 && (line[1][0] - 500_731.0).abs() < 2.0, "{line:?}");
    assert!((line[2][1] - line[1][1] - 556.0).abs() < 1.0 && found.is_empty(), "{line:?}");
    assert!(refused(read_line(source, None)).contains("UTM zone"));
    let wkt = "LINESTRING (9 49, 9.01 49)";
    let (line, found) = read_line(wkt, Some(&zone("32N"))).unwrap();
    assert!((line[0][0] - 5e5).abs() < 1e-6);
    assert!(
        found
            .render(false)
            .contains("note: LINESTRING (9 49, 9.01 49): its coordinates are read as longitude")
    );
}
