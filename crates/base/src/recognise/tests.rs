//! Files of each kind are named, and what a reader wants is told from what it does not.

use super::*;

/// The name of the kind of a file.
fn name(path: &str, bytes: &[u8]) -> &'static str {
    recognise(Path::new(path), bytes).name
}

/// The message and the help for a file that is not expected.
fn refused(path: &str, bytes: &[u8], expected: &Expected) -> String {
    let found = foreign(Path::new(path), bytes, expected).unwrap_or_else(|| panic!("{path} is expected"));
    format!("{}; {}", found.message(), found.help)
}

#[test]
fn kinds_are_recognised_by_their_first_bytes() {
    let mut laz = vec![0; 400];
    laz[..4].copy_from_slice(b"LASF");
    laz[104] = 0x83;
    let mut copc = laz.clone();
    copc[377..381].copy_from_slice(b"copc");
    let mut geopackage = vec![0; 100];
    geopackage[..16].copy_from_slice(b"SQLite format 3\0");
    let mut database = geopackage.clone();
    geopackage[68..72].copy_from_slice(b"GPKG");
    database.extend(b"CREATE TABLE topics CREATE TABLE messages");
    let entry = |name: &[u8], content: &[u8]| {
        let mut bytes = b"PK\x03\x04".to_vec();
        bytes.extend([0; 22]);
        bytes.extend((name.len() as u16).to_le_bytes());
        bytes.extend([0; 2]);
        bytes.extend(name);
        bytes.extend(content);
        bytes
    };
    let record =
        [100_000.0_f64, 0.85, 0.15, 300.0, 10.0, 0.0, 0.0, 0.01, 0.02, 1.0, 0.0, 0., 0., 0., 0., 0., 0.];
    let sbet: Vec<u8> = record.iter().flat_map(|number| number.to_le_bytes()).collect();
    let mut dbf = vec![0x03, 122, 1, 31, 1, 0, 0, 0, 65, 0, 11, 0];
    dbf.resize(66, 0);
    for (bytes, expected) in [
        (&laz[..], "a LAZ point cloud"),
        (&copc, "a COPC point cloud"),
        (&laz[..90], "a LAS point cloud"),
        (b"LASF\x97\x97", "a LAS point cloud"),
        (b"%PDF-1.4\n\x97", "a PDF document"),
        (b"MM\xc8\0\0\0\x02\0\x0a\0\0\0\x03\0\0\0", "a 3D Studio mesh"),
        (&geopackage, "a GeoPackage"),
        (&database, "a ROS 2 bag"),
        (&entry(b"doc.kml", b""), "KMZ (zipped KML)"),
        (&entry(b"[Content_Types].xml", b"PK\x03\x04 xl/workbook.xml"), "an Excel workbook"),
        (
            &entry(b"mimetype", b"application/vnd.oasis.opendocument.spreadsheet"),
            "an OpenDocument spreadsheet",
        ),
        (&entry(b"a.npy", b""), "an archive of NumPy arrays"),
        (&entry(b"house.obj", b""), "a ZIP archive"),
        (&sbet, "an SBET trajectory"),
        (&dbf, "a dBASE table (of a shapefile)"),
        (b"\0\0\x27\x0a\0\0\0\0", "a shapefile"),
        (b"\x93NUMPY\x01\0", "a NumPy array"),
        (b"MM\0*\0\0\0\x08", "a TIFF raster"),
        (b"\xff\xfe1\x002\x00", "text in UTF-16"),
        (b"\xff\xfe<\x00k\x00m\x00l\x00>\x00", "KML"),
        (b"\x01\x02\x03\x04", "binary data of an unknown format"),
        (b"", "an empty file"),
    ] {
        assert_eq!(name("a", bytes), expected);
    }
}

#[test]
fn text_is_recognised_by_its_statements() {
    for (text, expected) in [
        ("<?xml version='1.0'?>\n<!-- house -->\n<COLLADA>", "a COLLADA scene"),
        ("\u{feff}<?xml version='1.0'?><document>", "an XML document of vlscan or HELIOS++"),
        ("<gpx creator='a'><trk/></gpx>", "GPX"),
        ("<gml:FeatureCollection xmlns:gml='http://www.opengis.net/gml'>", "GML"),
        ("<core:CityModel>", "a CityGML model"),
        ("<!DOCTYPE html><html>", "an HTML page"),
        ("<a><b/></a>", "an XML file"),
        ("{ \"version\": \"2.0\", \"type\": \"CityJSON\"", "a CityJSON model"),
        ("{\"type\": \"Feature\", \"geometry\": null}", "GeoJSON"),
        ("{\"lidar_intrinsics\": 0, \"beam_altitude_angles\": []}", "the calibration of an Ouster sensor"),
        ("{\"a\": 1}", "a JSON file"),
        ("ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('IFC4'));", "an IFC model"),
        ("ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('AP214'));", "a STEP model"),
        ("# Blender\nv 1 2 3\n", "an OBJ mesh"),
        ("# Blender\ro house\rv 1 2 3\r", "an OBJ mesh"),
        ("newmtl grey\nKd 1 1 1\n", "an MTL material library"),
        ("SOLID\r\n  FACET NORMAL 0 0 1\r\n", "an STL mesh"),
        ("off\n8 6 12\n", "an OFF mesh"),
        ("STCOFF\n8 6 12\n", "an OFF mesh"),
        ("OFF490 518 0\n", "an OFF mesh"),
        ("# comment\n  OFF BINARY\n", "an OFF mesh"),
        ("NCOLS 4\nnrows 4\n", "an ESRI ASCII grid"),
        ("PROJCS[\"ETRS89 / UTM zone 32N\"", "a coordinate reference system in WKT"),
        ("POLYGON ((0 0, 1 1, 1 0))", "well-known text of a geometry"),
        ("VERSION 0.7\nFIELDS x y z\n", "a PCD point cloud"),
        ("import numpy as np\n", "a Python program"),
        ("scene = \"a.obj\"\n", "a pipeline file (TOML)"),
        ("# a flight\n[[leg]]\nx = 1\n", "a pipeline file (TOML)"),
        ("time,x,y,z\n1,2,3,4\n", "a table of text"),
        ("1 2 3\n4 5 6\n", "a table of text"),
        ("<?xml version='1.0'?><OpenDRIVE><road/></OpenDRIVE>", "an OpenDRIVE road network"),
        ("<TrainingCenterDatabase xmlns='a'><Activities/>", "a TCX track"),
        ("$GPGGA,100000.00,4900.7,N,00840.2,E,1\n", "a log of a GNSS receiver (NMEA 0183)"),
        ("AXXXABC FLIGHT:1\r\nHFDTE010321\r\nB1000004900740N", "an IGC flight log"),
        (
            "     3.04           OBSERVATION DATA    M (MIXED)           RINEX VERSION / TYPE\n",
            "raw observations of a GNSS receiver (RINEX)",
        ),
        ("AXXX height age\n1 2 3\n", "a table of text"),
        ("$time,x,y\n1,2,3\n", "a table of text"),
        ("Name;Höhe\nBuche;12,5\n", "text of an unknown format"),
        ("x;y;h\n1,5;2,5;3,5\n", "a table of text"),
        ("[time],x,y\n1,2,3\n", "a table of text"),
        ("BMI height age\n1 2 3\n", "a table of text"),
        ("# Title\n\nSome words of prose.\n", "text of an unknown format"),
    ] {
        assert_eq!(name("a", text.as_bytes()), expected, "{text}");
    }
}

#[test]
fn endings_decide_where_contents_do_not() {
    assert_eq!(name("a.FBX", &[0; 84]), "an FBX mesh");
    assert_eq!(name("a.3ds", &[b'M', b'M', 9, 0, 0, 0]), "a 3D Studio mesh");
    assert_eq!(name("a.xyz", b"1 2 3\n4 5 6\n"), "a point cloud of text");
    assert_eq!(name("a.las", b"1 2 3\n4 5 6\n"), "a table of text");
    assert_eq!(name("a.obj", b"OFF\n8 6 0\n"), "an OFF mesh");
    assert_eq!(name("dem.tif", b"ncols 4\nnrows 4\n"), "an ESRI ASCII grid");
    let mut database = b"SQLite format 3\0".to_vec();
    database.resize(100, 0);
    assert_eq!(name("a.mbtiles", &database), "an SQLite database");
    assert_eq!(name("a.obj", b"PK\x03\x04\0"), "a ZIP archive");
    assert_eq!(name("a.las", &[7; 8]), "binary data of an unknown format");
    assert_eq!(name("a.skp", b"anything\n"), "a model of SketchUp, SolidWorks or 3ds Max");
    assert_eq!(name("a.db3", &database), "a ROS 2 bag");
}

#[test]
fn readers_refuse_what_they_do_not_read_with_what_to_do() {
    for (path, bytes, expected, parts) in [
        (
            "site.laz",
            &b"LASF\0\0"[..],
            &Expected::SURVEY,
            ["found a LAS point cloud", "vlscan info site.laz"],
        ),
        ("my house.obj", b"v 0 0 0\nv 1 0 0\n", &Expected::SURVEY, ["an OBJ mesh", "--scene 'my house.obj'"]),
        ("plot.npy", b"\x93NUMPY\x01", &Expected::INVENTORY, ["a NumPy array", "numpy.savetxt"]),
        ("-", b"\x93NUMPY\x01", &Expected::ROWS, ["a NumPy array", "numpy.load('FILE')"]),
        ("a.fbx", b"Kaydara FBX", &Expected::POINTS, ["an FBX mesh", "--scene FILE"]),
        ("a.las", b"LASF\0\0", &Expected::MESH, ["a LAS point cloud", "xyzloader"]),
        ("a.csv", b"x,y,z\n1,2,3\n", &Expected::SURVEY, ["a table of text", "--trajectory a.csv"]),
        ("a.parquet", b"PAR1\x15", &Expected::POSES, ["a Parquet table", "as CSV"]),
        ("a.xodr", b"<OpenDRIVE/>", &Expected::DOCUMENT, ["an OpenDRIVE road network", "as OBJ or glTF"]),
        (
            "a.tcx",
            b"<TrainingCenterDatabase/>",
            &Expected::AREA,
            ["a TCX track", "gpsbabel -i gtrnctr -f a.tcx"],
        ),
        ("a.txt", b"$GNRMC,1,A,4900.7,N", &Expected::POSES, ["NMEA 0183", "time,x,y,z,roll,pitch,yaw"]),
        ("a.igc", b"AXXX\nHFDTE010321\n", &Expected::POSES, ["an IGC flight log", "gpsbabel -i igc"]),
        ("a.21o", b"3.04  RINEX VERSION / TYPE\n", &Expected::MESH, ["RINEX", "RTKLIB"]),
        ("a.gz", b"\x1f\x8b\x08", &Expected::MESH, ["a gzip file", "gunzip a.gz"]),
    ] {
        let said = refused(path, bytes, expected);
        assert!(said.starts_with(&format!("expected {}", expected.what)), "{said}");
        parts.iter().for_each(|part| assert!(said.contains(part), "{part}: {said}"));
    }
}

#[test]
fn readers_take_what_they_read() {
    for (path, bytes, expected) in [
        ("a.xml", &b"<document/>"[..], &Expected::SURVEY),
        ("a.xml", b"<survey/>", &Expected::SURVEY),
        ("a.obj", b"# solid block\n\n", &Expected::MESH),
        ("a.gltf", b"{\"a\": 1}", &Expected::MESH),
        ("a.toml", b"survey = ", &Expected::PIPELINE),
        ("flight.pts", b"0 1 2 3\n1 2 3 4\n", &Expected::POSES),
        ("flight.las", b"time,x,y,z,roll,pitch,yaw\n0,1,2,3,4,5,6\n", &Expected::POSES),
        ("a.csv", b"\xff\xfex\0;\0", &Expected::INVENTORY),
        ("a.tif", b"II*\0", &Expected::RASTER),
        // What looks like another kind.
        ("a.stl", b"Exported from Blender\0\0\0\0\0", &Expected::SURFACE),
        ("a.obj", b"# a comment\n# and another\n", &Expected::SURFACE),
        ("a.obj", b"v 1 2 3 # note\nv 1 2 4 # note\n", &Expected::SURFACE),
        ("a.mtl", b"Kd 0.5 0.5 0.5\nKs 0 0 0\n", &Expected::MATERIALS),
        ("a.csv", b"Point,X (m),Y (m),Z (m)\n1,2,3,4\n", &Expected::POINTS),
        ("a.csv", b"Point,X (m),Y (m),Z (m)\n1,2,3,4\n", &Expected::INVENTORY),
        ("a.txt", b"class\tx\ty\tz\n2\t1\t2\t3\n", &Expected::POINTS),
        ("a.txt", b"def x y z\n1 2 3 4\n", &Expected::POINTS),
        ("a.txt", b"import x y z\n1 2 3 4\n", &Expected::POINTS),
        ("a.txt", b"off x y z\n1 2 3 4\n", &Expected::POINTS),
        ("a.txt", b"Week = 2100\ntime,x,y,z,roll,pitch,yaw\n0,1,2,3,4,5,6\n", &Expected::POSES),
    ] {
        assert_eq!(foreign(Path::new(path), bytes, expected), None, "{path}");
    }
}

#[test]
fn a_trajectory_may_begin_with_the_bytes_of_compressed_data() {
    let mut record =
        [400_000.5f64, 0.8, 0.15, 300.0].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>();
    record.resize(2 * super::contents::SBET_BYTES, 0);
    record[..2].copy_from_slice(b"\x78\x9c");
    assert_eq!(foreign(Path::new("a.out"), &record, &Expected::POSES), None);
}

#[test]
fn beginnings_of_four_bytes_are_no_numbers_of_a_trajectory() {
    for (start, expected) in
        [(b"MM\0*\0\0\x10\x40", "a TIFF raster"), (b"PAR1\x15\x04\x15\x40", "a Parquet table")]
    {
        let mut bytes = start.to_vec();
        bytes.resize(super::contents::SBET_BYTES, 0);
        assert!(is_sbet(&bytes), "choose other bytes for {expected}");
        assert_eq!(name("a", &bytes), expected);
    }
}

#[test]
fn geometries_as_text_have_brackets_behind_their_name() {
    for text in [
        "POLYGON ((0 0, 1 0, 1 1))",
        "SRID=25832;POINT Z(1 2 3)",
        "linestring m (1 2 3, 4 5 6)",
        "POINT EMPTY",
    ] {
        assert_eq!(foreign(Path::new("a.txt"), text.as_bytes(), &Expected::AREA), None, "{text}");
    }
}

proptest::proptest! {
    #[test]
    fn any_bytes_are_of_a_kind(
        bytes in proptest::collection::vec(proptest::num::u8::ANY, 0..400),
        text in "[<{\\[#PK!?a-z0-9 =.,;\n\"\\]}>-]{0,80}",
        ending in "(\\.[a-z0-9]{1,4})?",
    ) {
        let path = format!("a{ending}");
        for start in [&b""[..], b"PK\x03\x04", b"LASF", b"SQLite format 3\0", b"<?xml ", b"<!"] {
            for rest in [&bytes[..], text.as_bytes()] {
                let all = [start, rest].concat();
                foreign(Path::new(&path), &all, &Expected::MESH);
                foreign(Path::new(&path), &all, &Expected::POINTS);
            }
        }
    }
}
