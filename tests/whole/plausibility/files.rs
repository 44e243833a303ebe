//! Areas, inventories, words and files that are wrong.

use super::inputs::*;
use super::{Mistake, flown, typed, written};
use crate::common::fixture;
use std::fs;

/// A polygon in GeoJSON, with what stands before its type.
pub fn polygon(before: &str, rings: &str) -> String {
    format!(r#"{{{before}"type":"Polygon","coordinates":{rings}}}"#)
}

pub fn areas_and_inventories() -> Vec<Mistake> {
    let ring = "[[0,0],[90,0],[90,60],[0,0]]";
    let beech = fs::read(fixture("forest/beech.obj")).unwrap();
    let stand = |name, table: &str, answer| Mistake {
        files: vec![("trees.csv", table.into()), ("sub/beech_1.obj", beech.clone())],
        ..typed(name, STAND, answer)
    };
    vec![
        written(
            "an area of two polygons",
            "plot.geojson",
            polygon("\"crs\":null,", &format!("[[{ring}],[{ring}]]")).replace("Polygon", "MultiPolygon"),
            PLAN,
            "of 2 polygons only the first one is used",
        ),
        written(
            "an area with a hole",
            "plot.geojson",
            polygon("\"crs\":null,", &format!("[{ring},[[50,5],[60,5],[60,9],[50,5]]]")),
            PLAN,
            "the holes of the polygon (1) are treated as part of the area",
        ),
        written(
            "metres in GeoJSON that says nothing of its system",
            "plot.geojson",
            polygon("", &format!("[{ring}]")),
            PLAN,
            "are read as metres in the scene's system",
        ),
        written(
            "a road in degrees over a scene without a system",
            "road.geojson",
            r#"{"type":"LineString","coordinates":[[8,49],[8.8,49.3]]}"#,
            "plan airborne --scanner riegl_vux-1uav --height 80 --speed 8 --area road.geojson --buffer 40 -o plan.toml",
            "its coordinates are degrees",
        ),
        Mistake {
            is_note: true,
            ..written(
                "an area in a system that nothing confirms",
                "plot.geojson",
                polygon(
                    r#""crs":{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::25833"}},"#,
                    "[[[500000,5400000],[500090,5400000],[500090,5400060],[500000,5400000]]]",
                ),
                PLAN,
                "note: its coordinates are in EPSG:25833",
            )
        },
        stand("a misspelt column", "x,y,height,dhb,note\n0,0,9,3,old\n", "did you mean `dbh` by `dhb`?"),
        stand(
            "a column that is not read",
            "x,y,height,note\n0,0,9,old\n",
            "columns that are not read: `note`",
        ),
    ]
}

pub fn words_and_files() -> Vec<Mistake> {
    let good = || poses([0.0, 0.0, 400.0], TO_EAST);
    let wrong_line = |from: &str, to: &str| good().replacen(from, to, 1);
    vec![
        flown("nothing on standard input", STREAM, String::new(), "is empty"),
        flown("a header and no poses", STREAM, HEADER.to_owned(), "0 poses"),
        flown("times that go back", STREAM, wrong_line("1000.5,", "900,"), "goes back"),
        flown("a gap in the poses", STREAM, good() + "1009,1,0,400,0,0,90\n", "no pose for"),
        flown(
            "the same pose twice",
            STREAM,
            good().replacen("1000,-30", "1000,-30,0,400,0,0,90\n1000,-30", 1),
            "the same pose again",
        ),
        flown("a word for a number", STREAM, wrong_line("1000.5,0", "1000.5,none"), "none"),
        flown("a column too few", STREAM, good().replacen(",yaw", "", 1), "no column for yaw"),
        flown("an unknown unit", STREAM, good().replacen("yaw", "yaw[gon]", 1), "gon"),
        flown(
            "columns that are none",
            "run local.toml -o a.xyz --trajectory-columns time,x,y,z",
            good(),
            "no column for",
        ),
        typed("no such survey", "run nofile.xml -o a.xyz", "nofile.xml"),
        typed("a scene for a survey", "run scene.xml -o a.xyz", "it holds a <scene>"),
        typed("a folder for a survey", "run . -o a.xyz", "folder"),
        typed("no such trajectory", "run survey.xml --trajectory none.csv -o a.xyz", "none.csv"),
        typed("an unknown format", "run survey.xml -o a.e58", "no format is called"),
        typed("a CRS that is none", "run survey.xml -o a.laz --crs 25832x", "--crs"),
        typed("an EPSG code that is none", "run survey.xml -o a.laz --crs EPSG:1", "give its WKT"),
        typed("a zone for a CRS", "run survey.xml -o a.laz --crs 32N", "is EPSG:32632"),
        typed("a geocentric CRS", "run survey.xml -o a.laz --crs EPSG:4978", "no easting"),
        typed(
            "two codes for a CRS",
            "run survey.xml -o a.laz --crs EPSG:25832+7837",
            "compound system by its own code",
        ),
        typed("an unknown correction", "run survey.xml -o a.xyz --correct foo", "no correction is called"),
        typed("a seed that is none", "run survey.xml -o a.xyz --seed tomorrow-ish", "--seed"),
        typed("too little memory", "run survey.xml -o a.xyz --max-memory 10k", "the limit is"),
        typed(
            "trajectory options without a trajectory",
            "run survey.xml -o a.xyz --height-offset -48",
            "give one with --trajectory",
        ),
        typed("a zone that is none", "run survey.xml --trajectory - --utm-zone 77X -o a.xyz", "77X"),
        typed("a file that exists", "run survey.xml -o taken.xyz", "--force"),
        typed("pulses without a scanner's scene", "trace - --scanner riegl_vz400", "--scene is required"),
        written(
            "a misspelt attribute",
            "s.xml",
            survey().replace("scanFreq_hz", "scanFreq_Hz"),
            "run s.xml -o a.xyz",
            "scanFreq_Hz",
        ),
        written(
            "a scene id that is none",
            "s.xml",
            survey().replace("#terrain", "#terain"),
            "run s.xml -o a.xyz",
            "terain",
        ),
        written(
            "a scanner that is none",
            "s.xml",
            survey().replace("#als_oscillating", "#als_osc"),
            "run s.xml -o a.xyz",
            "als_osc",
        ),
        written(
            "a comma for a point",
            "s.xml",
            survey().replace("396.9", "396,9"),
            "run s.xml -o a.xyz",
            "396,9",
        ),
        written("XML that is cut off", "s.xml", &survey()[..900], "run s.xml -o a.xyz", "s.xml:"),
        written(
            "a scan too fast for the scanner",
            "s.xml",
            survey().replace("scanFreq_hz=\"15\"", "scanFreq_hz=\"9000\""),
            "run s.xml -o a.xyz",
            "outside the scanner's limits",
        ),
        written(
            "a pulse frequency that is not listed",
            "s.xml",
            survey().replace("\"4500\"", "\"4501\""),
            "run s.xml -o a.xyz",
            "not among those of the scanner",
        ),
        written(
            "a head that does not turn",
            "t.xml",
            tripod("z=\"5\"").replace("\"60\"", "\"0\""),
            "run t.xml -o a.xyz",
            "never end",
        ),
        written(
            "a misspelt key",
            "p.toml",
            stream("scene.xml#terrain").replace("pulse_freq_hz", "puls_freq_hz"),
            "run p.toml -o a.xyz",
            "puls_freq_hz",
        ),
        written(
            "a mesh that is not there",
            "scene.xml",
            fs::read_to_string(fixture("terrain/scene.xml")).unwrap().replace("houses.obj", "house.obj"),
            "run survey.xml -o a.xyz",
            "house.obj",
        ),
        written(
            "a PLY mesh",
            "houses.obj",
            "ply\nformat ascii 1.0\n",
            "run survey.xml -o a.xyz",
            "expected a PLY file",
        ),
        written(
            "glTF for a scene",
            "h.glb",
            "glTF\x02\0\0\0",
            "run survey.xml --scene h.glb -o a.xyz",
            "is it truncated?",
        ),
        written(
            "STL for a scene",
            "h.stl",
            [0u8; 90],
            "run survey.xml --scene h.stl -o a.xyz",
            "is it truncated",
        ),
        written(
            "points for a scene",
            "p.las",
            "LASF",
            "run survey.xml --scene p.las -o a.xyz",
            "becomes voxels",
        ),
        written(
            "a misspelt scan frequency",
            "p.toml",
            stream("scene.xml#terrain").replace("scan_freq_hz", "scan_frequency_hz"),
            "run p.toml -o a.xyz",
            "scan_freq_hz",
        ),
        written(
            "a material without reflectance",
            "terrain.mtl",
            fs::read_to_string(fixture("terrain/terrain.mtl"))
                .unwrap()
                .replace("helios_reflectance 0.6\n", ""),
            "run survey.xml -o a.xyz",
            "no reflectance",
        ),
        written(
            "a reflectance in per cent",
            "terrain.mtl",
            fs::read_to_string(fixture("terrain/terrain.mtl"))
                .unwrap()
                .replace("helios_reflectance 0.", "helios_reflectance "),
            "run survey.xml -o a.xyz --physics refined",
            "above 2 and read as per cent",
        ),
        written(
            "a scanner of two catalogues",
            "m.toml",
            stream("scene.xml#terrain").replace("data/scanners_als.xml#riegl_lms-q780", "livox_mid-70"),
            "run m.toml -o a.xyz",
            "data/scanners_als.xml#livox_mid-70 or data/scanners_tls.xml#livox_mid-70",
        ),
        typed(
            "the same on the command line",
            "catalogue show livox_mid-70",
            "data/scanners_als.xml#livox_mid-70 or data/scanners_tls.xml#livox_mid-70",
        ),
        Mistake {
            files: vec![
                ("sub/survey.xml", survey().replace(" paths=\"beside\"", "").into_bytes()),
                ("sub/scene.xml", utm_scene().replace(" paths=\"beside\"", "").into_bytes()),
            ],
            ..typed(
                "a scene of the working directory",
                "run sub/survey.xml -o a.xyz",
                "of the working directory is read",
            )
        },
        written("faces without vertices", "houses.obj", "f 1 2 3\n", "run survey.xml -o a.xyz", "houses.obj"),
    ]
}
