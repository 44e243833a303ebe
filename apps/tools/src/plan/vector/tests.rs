//! Areas and lines in files that are not text are those of GeoJSON; damaged ones are rejected.

use super::super::geometries::{Geometry, Line, Shape as Found, System};
use super::super::{read_area, read_line};
use super::{VectorError, read_file_geometries};
use shapefile::{Point, PointZ, Polygon, PolygonRing, Polyline, PolylineZ, ShapeWriter};
use std::io::{Cursor, Write};
use std::path::Path;
use vlscan_crs as crs;
use vlscan_geom::UtmZone;
use vlscan_render::Render as _;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Made with the module `sqlite3` of Python, in pages of 512 bytes: the table `plots` of 59 points and, in
/// row 30, the polygon below with a hole; the table `roads` of a line of 150 positions, big-endian and with
/// heights, and of a row without a geometry.
const GEOPACKAGE: &[u8] = include_bytes!("plots.gpkg");

const L_SHAPE: [[f64; 2]; 7] =
    [[0.0, 0.0], [40.0, 0.0], [40.0, 10.0], [10.0, 10.0], [10.0, 30.0], [0.0, 30.0], [0.0, 0.0]];
const PLACE: [f64; 2] = [500_000.0, 5_400_000.0];

fn placed(ring: &[[f64; 2]]) -> Vec<[f64; 2]> {
    ring.iter().map(|[x, y]| [PLACE[0] + x, PLACE[1] + y]).collect()
}

fn zone() -> String {
    crs::wkt_of_zone(UtmZone::parse("32N").unwrap()).unwrap()
}

fn read(bytes: &[u8]) -> Result<Vec<Geometry>, VectorError> {
    read_file_geometries(Path::new("plot"), bytes).map(|found| found.1)
}

/// The L-shaped polygon with a hole, and a line, as shapefiles.
fn shapefiles() -> [Vec<u8>; 2] {
    let points = |ring: &[[f64; 2]]| ring.iter().map(|[x, y]| Point::new(*x, *y)).collect::<Vec<_>>();
    let hole = [[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 1.0]];
    let rings =
        vec![PolygonRing::Outer(points(&placed(&L_SHAPE))), PolygonRing::Inner(points(&placed(&hole)))];
    let mut area = Cursor::new(Vec::new());
    ShapeWriter::new(&mut area).write_shapes(&vec![Polygon::with_rings(rings)]).unwrap();
    let line = placed(&L_SHAPE[..3]).into_iter().map(|[x, y]| PointZ::new(x, y, 5.0, 0.0)).collect();
    let mut lines = Cursor::new(Vec::new());
    ShapeWriter::new(&mut lines).write_shapes(&vec![PolylineZ::new(line)]).unwrap();
    [area.into_inner(), lines.into_inner()]
}

/// An archive of files with their contents.
fn archive(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (i, (name, content)) in files.iter().enumerate() {
        let method = if i % 2 == 0 { CompressionMethod::Deflated } else { CompressionMethod::Stored };
        archive.start_file(*name, SimpleFileOptions::default().compression_method(method)).unwrap();
        archive.write_all(content).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

const KML: &str = "<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Placemark><Polygon><outerBoundaryIs><LinearRing><coordinates>\
    9,49 9.01,49 9.01,49.01 9,49</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>";

/// Reads an area and a line from a file in a folder; also returns what is told of both.
fn read_both(name: &str, bytes: &[u8], prj: Option<&str>) -> (Vec<[f64; 2]>, Vec<[f64; 2]>, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    prj.into_iter().for_each(|wkt| std::fs::write(path.with_extension("prj"), wkt).unwrap());
    let source = path.to_str().unwrap();
    let (corners, of_area) = match read_area(source, Some(&zone()), None) {
        Ok((area, found)) => (<[_; 2]>::from(area.bounds()).to_vec(), found.render(false)),
        Err(error) => (Vec::new(), error.to_string()),
    };
    let (line, of_line) = match read_line(source, Some(&zone())) {
        Ok((line, found)) => (line, found.render(false)),
        Err(error) => (Vec::new(), error.to_string()),
    };
    let told = format!("{of_area}\n{of_line}");
    (corners, line, told)
}

#[test]
fn shapefiles_have_the_system_of_the_prj_file_beside_them() {
    let esri = "PROJCS[\"ETRS_1989_UTM_Zone_33N\",GEOGCS[\"GCS_ETRS_1989\",DATUM[\"D_ETRS_1989\",SPHEROID[\"GRS_1980\",6378137.0,\
                298.257222101]],PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]],PROJECTION[\"Transverse_Mercator\"],\
                UNIT[\"Meter\",1.0]]";
    let [area, lines] = shapefiles();
    let shapes = read(&area).unwrap();
    let Found::Polygon(rings) = &shapes[0].shape else { panic!("{shapes:?}") };
    assert_eq!((rings.len(), rings[1].positions.len(), &shapes[0].system), (2, 4, &System::Unstated));
    let (corners, _, told) = read_both("plot.shp", &area, Some(&zone()));
    assert_eq!(corners, [PLACE, [500_040.0, 5_400_030.0]]);
    assert!(told.contains("the holes of the polygon (1)"), "{told}");
    let (_, line, told) = read_both("road.shp", &lines, None);
    assert_eq!(line, placed(&L_SHAPE[..3]));
    assert!(told.contains("the heights of the line are not used"), "{told}");
    // The central meridian of zone 33 is 441 km east of that of zone 32.
    let (corners, _, _) = read_both("plot.shp", &area, Some(esri));
    assert!((930e3..950e3).contains(&corners[0][0]), "{corners:?}");
    let degrees =
        "GEOGCS[\"GCS_WGS_1984\",DATUM[\"D_WGS_1984\",SPHEROID[\"WGS_1984\",6378137.0,298.257223563]]]";
    assert_eq!(System::of_wkt(degrees), System::Degrees);
    let (_, _, told) = read_both("plot.shp", &area, Some("no system"));
    assert!(told.contains("holds no WKT"), "{told}");
}

#[test]
fn geopackages_are_read_with_their_system() {
    let found = read(GEOPACKAGE).unwrap();
    assert!(found.iter().all(|geometry| geometry.system == System::Epsg(25832)));
    let polygons = found.iter().filter(|geometry| matches!(geometry.shape, Found::Polygon(_))).count();
    assert_eq!((found.len(), polygons), (61, 1));
    let (corners, line, told) = read_both("plots.gpkg", GEOPACKAGE, None);
    assert_eq!(corners, [PLACE, [500_040.0, 5_400_030.0]]);
    assert_eq!((line.len(), line[149]), (150, [500_149.0, 5_400_020.0]));
    assert!(told.contains("59 Point") && told.contains("the heights of the line are not used"), "{told}");
}

#[test]
fn archives_of_google_earth_and_tracks_are_read() {
    let kmz = archive(&[("files/icon.png", b"\x89PNG"), ("doc.kml", KML.as_bytes())]);
    let (corners, _, told) = read_both("plot.kmz", &kmz, None);
    assert!(
        (corners[0][0] - 5e5).abs() < 1e-6
            && told.contains("no LineString in the KML, which has 1 Polygon; draw the line"),
        "{corners:?} {told}"
    );
    let points = |name: &str, closed: bool| {
        let ring = [[9.0, 49.0], [9.01, 49.0], [9.01, 49.01], [9.0, 49.01], [9.0001, 49.0001]];
        let ring = if closed { &ring[..] } else { &ring[..4] };
        ring.iter()
            .map(|[x, y]| format!("<{name} lat=\"{y}\" lon=\"{x}\"><ele>120</ele></{name}>"))
            .collect::<String>()
    };
    let gpx = format!(
        "<gpx version=\"1.1\"><wpt lat=\"49\" lon=\"9\"/><trk><trkseg>{}</trkseg></trk></gpx>",
        points("trkpt", true)
    );
    let (corners, line, told) = read_both("plot.gpx", gpx.as_bytes(), None);
    assert!(line.len() == 5 && corners[1][0] > 500_700.0, "{corners:?}");
    assert!(
        told.contains("1 waypoint")
            && told.contains("note: the ends of the track are joined")
            && told.contains("the heights of the polygon are not used"),
        "{told}"
    );
    let gpx = format!("<gpx><rte>{}</rte></gpx>", points("rtept", false));
    let (corners, line, told) = read_both("road.gpx", gpx.as_bytes(), None);
    assert!(corners.is_empty() && line.len() == 4, "{told}");
    assert!(
        told.contains("no Polygon in the GPX, which has 1 ")
            && told.contains("--buffer makes an area of a line"),
        "{told}"
    );
}

#[test]
fn damaged_files_never_panic() {
    for at in (0..GEOPACKAGE.len()).filter(|at| *at <= 256 || at % 61 == 0) {
        for value in [0, 0x7f, 0xff] {
            let mut bytes = GEOPACKAGE.to_vec();
            bytes[at] = value;
            let _ = read(&bytes);
        }
    }
    for shapes in shapefiles() {
        for at in (0..shapes.len()).filter(|at| *at < 40 || *at > 96) {
            for value in [0, 0x7f, 0xff] {
                let mut bytes = shapes.clone();
                bytes[at] = value;
                let _ = read(&bytes);
                let _ = read(&shapes[..at]);
            }
        }
    }
}

/// The GeoPackage with a change of each page, which is given with its number, from 1.
fn with_pages(change: impl Fn(&mut [u8], u32)) -> Vec<u8> {
    let mut bytes = GEOPACKAGE.to_vec();
    bytes.chunks_mut(512).zip(1..).skip(1).for_each(|(page, number)| change(page, number));
    bytes
}

#[test]
fn databases_that_lead_in_circles_or_end_early_are_refused() {
    // Inner pages of tables have the kind 5, and their last child at byte 8.
    let own_child = with_pages(|page, number| {
        if page[0] == 5 {
            page[8..12].copy_from_slice(&number.to_be_bytes());
        }
    });
    assert!(own_child != GEOPACKAGE && read(&own_child).is_err());
    // Overflow pages begin with the number of the next one.
    let pages = (GEOPACKAGE.len() / 512) as u32;
    let circle = with_pages(|page, number| {
        let next = u32::from_be_bytes(page[..4].try_into().unwrap());
        if next == number + 1 && next <= pages {
            page[..4].copy_from_slice(&number.to_be_bytes());
        }
    });
    assert!(circle != GEOPACKAGE && read(&circle).is_err());
    for length in (1..GEOPACKAGE.len()).step_by(97) {
        assert!(read(&GEOPACKAGE[..length]).is_err(), "{length}");
    }
}

#[test]
fn files_that_state_too_much_are_refused() {
    let bomb = archive(&[("doc.kml", &vec![b' '; 65 << 20])]);
    assert!(
        bomb.len() < 1 << 20 && read(&bomb).unwrap_err().to_string().contains("more than 67108864 bytes")
    );
    assert!(read(&archive(&[("a.txt", b"")])).unwrap_err().to_string().contains("no KML document"));
    let line = Polyline::new(vec![Point::new(0.0, 0.0), Point::new(1.0, 1.0)]);
    let mut file = Cursor::new(Vec::new());
    ShapeWriter::new(&mut file).write_shapes(&vec![line]).unwrap();
    let found = read(&file.into_inner()).unwrap();
    let positions = vec![[0.0, 0.0], [1.0, 1.0]];
    assert_eq!(found[0].shape, Found::Line(Line { positions, has_heights: false }));
}
