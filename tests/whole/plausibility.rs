//! Mistakes that are easy to make: each ends with an error, or with a warning that `--strict` makes an error,
//! whose text names the cause. Correct input runs without a message.

use crate::common::{feed, fixture, folder, raster, run, succeed, text};
use std::fs;

/// A mistake, and what the program must say about it.
struct Mistake {
    name: &'static str,
    /// Files in the folder, besides those of `fixtures/terrain`.
    files: Vec<(&'static str, Vec<u8>)>,
    line: &'static str,
    stdin: String,
    answer: &'static str,
    /// A note that does not end a run with `--strict`.
    is_note: bool,
}

/// A mistake of a command line over the files of `fixtures/terrain`.
fn typed(name: &'static str, line: &'static str, answer: &'static str) -> Mistake {
    Mistake { name, files: Vec::new(), line, stdin: String::new(), answer, is_note: false }
}

/// A mistake in a file.
fn written(
    name: &'static str,
    file: &'static str,
    content: impl AsRef<[u8]>,
    line: &'static str,
    answer: &'static str,
) -> Mistake {
    Mistake { files: vec![(file, content.as_ref().to_vec())], ..typed(name, line, answer) }
}

/// A mistake in a stream of poses over a scene.
fn flown(name: &'static str, line: &'static str, poses: String, answer: &'static str) -> Mistake {
    Mistake { stdin: poses, ..typed(name, line, answer) }
}

const HEADER: &str = "time,x,y,z,roll,pitch,yaw\n";

/// A second of flight to the east through `middle`, 60 m/s.
fn poses(middle: [f64; 3], angles: [f64; 3]) -> String {
    along(middle, [0.6, 0.0, 0.0], angles)
}

/// A hundred poses with `step` metres from one to the next.
fn along(middle: [f64; 3], step: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> String {
    let mut text = HEADER.to_owned();
    for i in 0..100 {
        let at = |axis: usize| middle[axis] + (f64::from(i) - 50.0) * step[axis];
        let time = 1000.0 + f64::from(i) * 0.01;
        text += &format!("{time},{},{},{},{roll},{pitch},{yaw}\n", at(0), at(1), at(2));
    }
    text
}

/// The scanner of the terrain with a detection threshold of 1 W.
fn scanner_with_high_threshold() -> String {
    let scanner = fs::read_to_string(fixture("terrain/scanners.xml")).unwrap();
    scanner.replace("receivedEnergyMin_W=\"1e-9\"", "receivedEnergyMin_W=\"1\"")
}

/// Poses whose times are milliseconds, without a word of it.
fn in_milliseconds(poses: &str) -> String {
    with_times(poses, 1000.0)
}

/// Poses whose times are multiplied by `factor`.
fn with_times(poses: &str, factor: f64) -> String {
    let line = |line: &str| match line.split_once(',') {
        Some((time, rest)) if line != HEADER.trim_end() => {
            format!("{:.7},{rest}\n", factor * time.parse::<f64>().unwrap())
        }
        _ => format!("{line}\n"),
    };
    poses.lines().map(line).collect()
}

/// A second of flight with a single pose a kilometre aside.
fn with_jump() -> String {
    let [x, y, z] = UTM;
    let (right, wrong) = (format!(",{},{y},", x + 6.0), format!(",{},{},", x + 6.0, y + 1000.0));
    let poses = poses([x, y, z], TO_EAST);
    assert!(poses.contains(&right), "{poses}");
    poses.replacen(&right, &wrong, 1)
}

/// A pipeline over the terrain with an airborne scanner and its mount; `rest` follows.
fn pipeline(scene: &str, rest: &str) -> String {
    format!(
        "scene = \"{scene}\"\n{rest}\n[platform]\ncatalogue = \"data/platforms.xml#sr22\"\n[scanner]\n\
         catalogue = \"data/scanners_als.xml#riegl_lms-q780\"\n[settings]\npulse_freq_hz = 100000\nscan_freq_hz = 80\n\
         scan_angle_deg = 20\nmax_duration_s = 2\n"
    )
}

fn stream(scene: &str) -> String {
    pipeline(scene, "[trajectory]\npath = \"-\"")
}

/// The terrain in UTM zone 32N, 300 m high.
fn utm_scene() -> String {
    let terrain = fs::read_to_string(fixture("terrain/scene.xml")).unwrap();
    let moved = "<filter type=\"translate\"><param type=\"vec3\" key=\"offset\" value=\"476000;5429000;300\"/></filter>";
    terrain.replace("</part>", &format!("{moved}</part>"))
}

fn survey() -> String {
    fs::read_to_string(fixture("terrain/survey.xml")).unwrap()
}

/// A tripod on the terrain whose head turns once.
fn tripod(place: &str) -> String {
    format!(
        "<document><survey name=\"t\" scene=\"scene.xml#terrain\" platform=\"data/platforms.xml#tripod\" \
         scanner=\"data/scanners_tls.xml#riegl_vz400\"><leg><platformSettings {place}/><scannerSettings active=\"true\" \
         pulseFreq_hz=\"100000\" scanAngle_deg=\"50\" scanFreq_hz=\"60\" headRotatePerSec_deg=\"60\" headRotateStart_deg=\"0\" \
         headRotateStop_deg=\"360\" trajectoryTimeInterval_s=\"1\"/></leg></survey></document>"
    )
}

/// An interpolated flight that a survey names.
fn recorded(more: &str) -> String {
    format!(
        "<document><platformSettings id=\"p\"/><survey name=\"t\" scene=\"scene.xml#terrain\" platform=\"interpolated\" \
         basePlatform=\"data/platforms.xml#sr22\" scanner=\"data/scanners_als.xml#riegl_lms-q780\"><leg>\
         <platformSettings trajectory=\"flown.csv\" tIndex=\"0\" xIndex=\"1\" yIndex=\"2\" zIndex=\"3\" rollIndex=\"4\" \
         pitchIndex=\"5\" yawIndex=\"6\" {more}/><scannerSettings active=\"true\" pulseFreq_hz=\"100000\" scanAngle_deg=\"20\" \
         scanFreq_hz=\"80\"/></leg></survey></document>"
    )
}

fn raster_scene() -> &'static str {
    "<document><scene id=\"dem\"><part><filter type=\"geotiffloader\"><param type=\"string\" key=\"filepath\" \
     value=\"dem.tif\"/></filter></part></scene></document>"
}

/// The terrain, and its houses dropped to the plane through the whole of it.
fn slope() -> String {
    let terrain = fs::read_to_string(fixture("terrain/scene.xml")).unwrap();
    let drop = "<filter type=\"translate\"><param type=\"integer\" key=\"onGround\" value=\"1\"/><param \
                type=\"vec3\" key=\"offset\" value=\"0;0;0\"/></filter>";
    let (before, after) = terrain.split_once("houses.obj\"/></filter>").unwrap();
    format!("{before}houses.obj\"/></filter>{drop}{after}")
}

/// Two rasters beside each other.
fn two_rasters() -> String {
    let part = raster_scene().split("<part>").nth(1).and_then(|rest| rest.split("</scene>").next()).unwrap();
    let second = format!("<part>{}</scene>", part.replace("dem.tif", "dem2.tif"));
    raster_scene().replace("</scene>", &second)
}

const TO_EAST: [f64; 3] = [0.0, 0.0, 90.0];
const UTM: [f64; 3] = [476_000.0, 5_429_000.0, 700.0];
const STREAM: &str = "run local.toml -o a.xyz";
const PLAN: &str =
    "plan airborne --scanner riegl_vux-1uav --height 80 --speed 8 --area plot.geojson -o plan.toml";
const STAND: &str = "scene stand trees.csv --trees sub -o stand";
const OVER_UTM: &str = "run utm.toml -o a.xyz";

fn plausible_numbers() -> Vec<Mistake> {
    let [x, y, z] = UTM;
    vec![
        flown("a UTM scene under a local flight", OVER_UTM, poses([0.0, 0.0, 700.0], TO_EAST), "local ones"),
        flown("a local scene under a UTM flight", STREAM, poses(UTM, TO_EAST), "local ones"),
        flown(
            "the zone to the west",
            OVER_UTM,
            poses([x - 433_000.0, y, z], TO_EAST),
            "neighbouring UTM zones",
        ),
        flown(
            "the zone to the east",
            OVER_UTM,
            poses([x + 433_000.0, y + 3000.0, z], TO_EAST),
            "neighbouring UTM zones",
        ),
        flown("the southern hemisphere", OVER_UTM, poses([x, y + 1e7, z], TO_EAST), "southern hemisphere"),
        flown("northing before easting", OVER_UTM, along([y, x, z], [0.0, 0.6, 0.0], TO_EAST), "swapped"),
        flown("feet", OVER_UTM, along([x / 0.3048, y / 0.3048, z], [2.0, 0.0, 0.0], TO_EAST), "as feet"),
        flown(
            "millimetres",
            OVER_UTM,
            along([x * 1e3, y * 1e3, z], [600.0, 0.0, 0.0], TO_EAST),
            "as millimetres",
        ),
        flown("a minus too many", OVER_UTM, poses([x, -y, z], TO_EAST), "sign of y reversed"),
        flown(
            "longitude and latitude without names",
            OVER_UTM,
            along([8.67, 49.01, 700.0], [1e-5, 0.0, 0.0], TO_EAST),
            "lon and lat",
        ),
        flown("all heights 0", STREAM, poses([0.0; 3], TO_EAST), "all heights of the flight are 0"),
        flown(
            "all heights 0 under a scene at 300 m",
            OVER_UTM,
            poses([x, y, 0.0], TO_EAST),
            "all heights of the flight are 0",
        ),
        flown(
            "heights above the ground, not above the sea",
            OVER_UTM,
            poses([x, y, 120.0], TO_EAST),
            "same level",
        ),
        written(
            "reflectances in two units",
            "terrain.mtl",
            fs::read_to_string(fixture("terrain/terrain.mtl")).unwrap().replacen("reflectance 0.45", "reflectance 45", 1),
            "run survey.xml -o a.xyz",
            "per cent: \"meadow\" 45 (terrain.mtl:2); and fractions:",
        ),
        written(
            "the same in the refined physics",
            "terrain.mtl",
            fs::read_to_string(fixture("terrain/terrain.mtl")).unwrap().replacen("reflectance 0.45", "reflectance 45", 1),
            "run survey.xml -o a.xyz --physics refined",
            "are in two units",
        ),
        written(
            "a threshold that no echo reaches",
            "scanners.xml",
            scanner_with_high_threshold(),
            "run survey.xml -o a.xyz",
            "beams met the scene and returned less than the detector needs: strongest",
        ),
        written(
            "the same in the refined physics, in watts",
            "scanners.xml",
            scanner_with_high_threshold(),
            "run survey.xml -o a.xyz --physics refined",
            "W, threshold 1.00e0 W",
        ),
        // The run is over after two seconds of the stream, before its pace is known.
        Mistake {
            is_note: true,
            ..flown("times in milliseconds", OVER_UTM, in_milliseconds(&poses(UTM, TO_EAST)), "m/s on average")
        },
        recording("times in minutes in a file", with_times(&poses(UTM, TO_EAST), 1.0 / 60.0), "minutes by 60"),
        recording("times in hours in a file", with_times(&poses(UTM, TO_EAST), 1.0 / 3600.0), "hours by 3600"),
        flown("times in minutes", OVER_UTM, with_times(&poses(UTM, TO_EAST), 1.0 / 60.0), "minutes by 60"),
        recording("a pose aside in a file", with_jump(), "remove the pose if its place or time is wrong"),
        flown("a pose aside", OVER_UTM, with_jump(), "remove the pose if its place or time is wrong"),
        Mistake {
            files: vec![
                ("flown.csv", with_times(&poses([0.0, 0.0, 400.0], TO_EAST), 1.0 / 60.0).into_bytes()),
                ("m.xml", recorded("toRadians=\"true\"").into_bytes()),
            ],
            ..typed("times in minutes of a survey", "run m.xml -o a.xyz", "minutes by 60")
        },
        recording("times in milliseconds in a file", in_milliseconds(&poses(UTM, TO_EAST)), "m/s on average"),
        recording(
            "heights in feet that a part of the swath survives",
            poses([x, y, 2297.0], TO_EAST),
            "if its heights are in feet, 2298 ft are 700 m",
        ),
        flown(
            "the same in a stream",
            OVER_UTM,
            poses([x, y, 2297.0], TO_EAST),
            "if its heights are in feet, 2298 ft are 700 m",
        ),
        recording(
            "heights in centimetres",
            poses([x, y, 70_000.0], TO_EAST),
            "if its heights are in centimetres, 70000 cm are 700 m",
        ),
        flown(
            "the same in a stream of them",
            OVER_UTM,
            poses([x, y, 70_000.0], TO_EAST),
            "if its heights are in centimetres, 70000 cm are 700 m",
        ),
        recording("a file of a flight below the terrain", poses([x, y, 255.0], TO_EAST), "ellipsoid"),
        recording(
            "a file of a flight upside down",
            poses([x, y, 700.0], [180.0, 0.0, 90.0]),
            "of the beams point above the horizon",
        ),
        flown(
            "heights in feet",
            OVER_UTM,
            poses([x, y, 25_000.0], TO_EAST),
            "if its heights are in feet",
        ),
        flown("the geoid's height taken off twice", OVER_UTM, poses([x, y, 255.0], TO_EAST), "ellipsoid"),
        flown("far above the scanner's range", STREAM, poses([0.0, 0.0, 9000.0], TO_EAST), "the scanner"),
        flown("a strip past the scene", STREAM, poses([0.0, 2500.0, 400.0], TO_EAST), "beside the scene"),
        flown(
            "radians without a word",
            STREAM,
            poses([0.0, 0.0, 400.0], [0.01, 0.02, 1.56]),
            "look like radians",
        ),
        flown(
            "radians to the north",
            STREAM,
            along([0.0, 0.0, 400.0], [0.0, 0.6, 0.0], [0.01, 0.02, 0.0]),
            "look like radians",
        ),
        flown(
            "degrees called radians",
            "run local.toml -o a.xyz --trajectory-angles rad",
            poses([0.0, 0.0, 400.0], TO_EAST),
            "look like degrees",
        ),
        flown(
            "upside down",
            "run local.toml -o a.xyz --boresight 180,0,0",
            poses([0.0, 0.0, 400.0], TO_EAST),
            "point upwards",
        ),
        flown(
            "no platform to carry the scanner",
            "run bare.toml -o a.xyz",
            poses([0.0, 0.0, 400.0], TO_EAST),
            "mount",
        ),
        Mistake {
            is_note: true,
            ..flown("headings across the course", STREAM, poses([0.0, 0.0, 400.0], [0.0; 3]), "heads for")
        },
        Mistake {
            is_note: true,
            ..flown(
                "ellipsoidal heights without a word",
                "run wgs.toml -o a.xyz",
                along([8.671_6, 49.012, 700.0], [8e-6, 0.0, 0.0], TO_EAST).replace("x,y", "lon,lat"),
                "--height-offset",
            )
        },
        written(
            "a raster in degrees",
            "dem.tif",
            raster([11.25, 49.01], 0.0003, None),
            "run dem.toml -o a.xyz",
            "are degrees",
        ),
        Mistake {
            files: vec![("dem.tif", raster([476_000.0, 5_429_000.0], 10.0, Some(25832)))],
            ..typed(
                "another system than that of the raster",
                "run dem.toml -o a.laz --crs EPSG:25833",
                "files of the scene are in",
            )
        },
        Mistake {
            files: vec![
                ("dem.tif", raster([476_000.0, 5_429_000.0], 10.0, Some(25832))),
                ("dem2.tif", raster([476_080.0, 5_429_000.0], 10.0, Some(25833))),
                ("dem.xml", two_rasters().into_bytes()),
            ],
            ..typed(
                "rasters in two systems",
                "run dem.toml -o a.laz",
                "convert all files of a scene to one system",
            )
        },
        Mistake {
            files: vec![("dem.tif", raster([476_000.0, 5_429_000.0], 10.0, Some(25832)))],
            ..flown(
                "another zone than that of the raster",
                "run flight.toml -o a.laz --utm-zone 33N",
                along([8.671_6, 49.012, 700.0], [8e-6, 0.0, 0.0], TO_EAST).replace("x,y", "lon,lat"),
                "leave out --utm-zone",
            )
        },
        typed(
            "a system in degrees",
            "run survey.xml -o a.laz --crs EPSG:4326",
            "its coordinates are degrees",
        ),
        typed("a system in feet", "run survey.xml -o a.laz --crs EPSG:2263", "its coordinates are feet"),
        flown(
            "a system of another part of the Earth",
            "run utm.toml -o a.laz --crs EPSG:2193",
            poses(UTM, TO_EAST),
            "from the area in which it is used",
        ),
        flown(
            "a code without its last digit",
            "run utm.toml -o a.laz --crs EPSG:2583",
            poses(UTM, TO_EAST),
            "a digit of the code missing",
        ),
        typed(
            "a system for local coordinates",
            "run survey.xml -o a.laz --crs EPSG:25832",
            "the scene has local coordinates",
        ),
        Mistake {
            is_note: true,
            ..flown(
                "a neighbouring zone that nothing contradicts",
                "run utm.toml -o a.laz --crs EPSG:25833",
                poses(UTM, TO_EAST),
                "the scene is at 49.0° N 14.7° E",
            )
        },
        flown(
            "a lever arm in centimetres",
            "run local.toml -o a.xyz --lever-arm 0,100,0",
            poses([0.0, 0.0, 400.0], TO_EAST),
            "--lever-arm is 100 m",
        ),
        flown(
            "decimal commas",
            STREAM,
            poses([0.0, 0.0, 400.0], TO_EAST).replace('.', ","),
            "decimal comma",
        ),
        Mistake {
            is_note: true,
            ..flown("LAZ without a system", "run utm.toml -o a.laz", poses(UTM, TO_EAST), "--crs EPSG:25832")
        },
        written(
            "a mesh in local coordinates beside one on the grid",
            "scene.xml",
            utm_scene().replacen("476000;5429000;300", "0;0;300", 1),
            "run survey.xml -o a.xyz",
            "local coordinates",
        ),
        written(
            "a window of less than two bins",
            "survey.xml",
            survey().replacen("<leg", "<FWFSettings binSize_ns=\"0.5\" winSize_ns=\"0.5\"/><leg", 1),
            "run survey.xml -o a.xyz --physics helios",
            "every bin of the waveform counts as an echo",
        ),
        written(
            "a window of less than two bins where two are compared anyway",
            "survey.xml",
            survey().replacen("<leg", "<FWFSettings binSize_ns=\"0.5\" winSize_ns=\"0.5\"/><leg", 1),
            "run survey.xml -o a.xyz --physics refined",
            "a window of two bins is used",
        ),
        Mistake {
            stdin: poses([0.0, 0.0, 400.0], TO_EAST),
            ..written(
                "noise of a receiver in the physics that has none",
                "m.toml",
                stream("scene.xml#terrain").replace("[settings]", "nep_w = 1e-9\n[settings]"),
                "run m.toml -o a.xyz --physics helios",
                "`nep_w` has no effect without the correction receiver",
            )
        },
        Mistake {
            stdin: poses([0.0, 0.0, 400.0], TO_EAST),
            ..written(
                "a beam quality beside a divergence",
                "m.toml",
                stream("scene.xml#terrain").replace("[settings]", "beam_quality = 1.5\n[settings]"),
                "run m.toml -o a.xyz --physics refined",
                "`beam_quality` has no effect",
            )
        },
        written("a slope under a house", "scene.xml", slope(), "run survey.xml -o a.xyz", "above the ground under it"),
        flown(
            "latitude and longitude in radians",
            "run wgs.toml -o a.xyz",
            along([0.151_35, 0.855_42, 700.0], [1e-7, 0.0, 0.0], TO_EAST).replace("x,y", "lon,lat"),
            "look like radians",
        ),
        Mistake {
            is_note: true,
            ..written(
                "all epochs into one file",
                "scene.xml",
                fs::read_to_string(fixture("terrain/scene.xml")).unwrap().replacen(
                    "</part>",
                    "<swap swapStep=\"1\"><filter type=\"scale\"><param type=\"double\" key=\"scale\" value=\"1.1\"/></filter></swap></part>",
                    1,
                ),
                "run survey.xml -o a.xyz",
                "--output DIR",
            )
        },
        Mistake {
            is_note: true,
            stdin: poses([0.0, 0.0, 400.0], TO_EAST),
            ..written(
                "pulses of a mirror that turns all around",
                "m.toml",
                stream("scene.xml#terrain")
                    .replace("riegl_lms-q780", "riegl_vux-1uav22")
                    .replace("scan_freq_hz = 80", "scan_freq_hz = 50"),
                "run m.toml -o a.xyz",
                "counts over ±180°",
            )
        },
        written(
            "a .prj file that is none",
            "houses.prj",
            "UTM 32",
            "run survey.xml -o a.laz",
            "holds no WKT",
        ),
        written(
            "a tripod below the terrain",
            "t.xml",
            tripod("x=\"0\" y=\"0\" z=\"-12\""),
            "run t.xml -o a.xyz",
            "below the terrain",
        ),
        written(
            "a tripod in another system",
            "t.xml",
            tripod("x=\"476000\" y=\"5429000\" z=\"300\""),
            "run t.xml -o a.xyz",
            "local ones",
        ),
        written(
            "a tripod beside the ground",
            "t.xml",
            tripod("x=\"900\" y=\"0\" z=\"0\" onGround=\"true\""),
            "run t.xml -o a.xyz",
            "no ground at x 900",
        ),
        written(
            "waypoints at height 0",
            "s.xml",
            survey().replace("z=\"396.9\"", "z=\"0\""),
            "run s.xml -o a.xyz",
            "all heights of the flight are 0",
        ),
        written(
            "waypoints beyond the range",
            "s.xml",
            survey().replace("z=\"396.9\"", "z=\"39690\""),
            "run s.xml -o a.xyz",
            "above the scene",
        ),
        written(
            "no leg is active",
            "s.xml",
            survey().replace("active=\"true\"", "active=\"false\""),
            "run s.xml -o a.xyz",
            "no pulse was fired",
        ),
        Mistake {
            files: vec![
                ("t.xml", recorded("").into_bytes()),
                ("flown.csv", poses([0.0, 0.0, 400.0], [0.01, 0.02, 1.56]).into_bytes()),
            ],
            ..typed("a recorded flight in radians", "run t.xml -o a.xyz", "look like radians")
        },
        Mistake {
            files: vec![
                ("t.xml", recorded("toRadians=\"false\"").into_bytes()),
                ("flown.csv", poses([0.0, 0.0, 400.0], TO_EAST).into_bytes()),
            ],
            ..typed("a recorded flight in degrees called radians", "run t.xml -o a.xyz", "look like degrees")
        },
        Mistake {
            files: vec![
                ("t.xml", recorded("").into_bytes()),
                ("flown.csv", poses(UTM, TO_EAST).into_bytes()),
            ],
            ..typed("a recorded flight elsewhere", "run t.xml -o a.xyz", "local ones")
        },
    ]
}

/// A polygon in GeoJSON, with what stands before its type.
fn polygon(before: &str, rings: &str) -> String {
    format!(r#"{{{before}"type":"Polygon","coordinates":{rings}}}"#)
}

fn areas_and_inventories() -> Vec<Mistake> {
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

fn words_and_files() -> Vec<Mistake> {
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

/// A flight in a file over the scene in UTM.
fn recording(name: &'static str, poses: String, answer: &'static str) -> Mistake {
    let run = pipeline("utm.xml#terrain", "[trajectory]\npath = \"flown.csv\"");
    Mistake {
        files: vec![("flown.csv", poses.into_bytes()), ("f.toml", run.into_bytes())],
        ..typed(name, "run f.toml -o a.xyz", answer)
    }
}

/// A straight flight over the terrain with an instrument of the user's, at 4 kHz and 20 lines per second.
fn own(scanner: &str, settings: &str, leg: &str) -> String {
    format!(
        "scene = \"scene.xml#terrain\"\n\
         platform = {{ kind = \"linear_path\", mount = {{ rotate_deg = [{{ x = -90 }}, {{ z = 90 }}] }} }}\n\
         leg = [{{ position_m = [-60, 0, 100], {leg} }}, {{ position_m = [60, 0, 100], active = false }}]\n\
         settings = {{ pulse_freq_hz = 4000, {settings} }}\n\
         scanner = {{ id = \"own\", pulse_freqs_hz = [4000], {scanner} }}\n"
    )
}

/// A flight to the terrain with an instrument of the user's, until the end of its poses.
fn approach(name: &'static str, poses: String) -> Mistake {
    let run = "scene = \"scene.xml#terrain\"\n\
               platform = { kind = \"linear_path\", mount = { rotate_deg = [{ x = -90 }, { z = 90 }] } }\n\
               trajectory = { path = \"-\" }\n\
               settings = { pulse_freq_hz = 4000, scan_freq_hz = 20, scan_angle_deg = 20 }\n\
               scanner = { id = \"own\", pulse_freqs_hz = [4000], optics = \"rotating\", scan_angle_max_deg = 45 }\n";
    Mistake { stdin: poses, ..written(name, "late.toml", run, "run late.toml -o a.xyz", "") }
}

const ROTATING: &str = "optics = \"rotating\", scan_angle_max_deg = 45";
const SWATH: &str = "scan_freq_hz = 20, scan_angle_deg = 20";
const SPEED: &str = "speed_m_per_s = 60";

/// Instruments and legs whose values contradict each other or do nothing.
fn instruments() -> Vec<Mistake> {
    let made = |name, scanner: &str, settings: &str, leg: &str, answer| {
        written(name, "m.toml", own(scanner, settings, leg), "run m.toml -o a.xyz", answer)
    };
    let of_scanner = |name, scanner: &str, answer| made(name, scanner, SWATH, SPEED, answer);
    let and = |more: &str| format!("{ROTATING}, {more}");
    vec![
        of_scanner("a cone without its angle", "optics = \"conic\"", "never deflect the beam"),
        of_scanner("fibres without their angle", "optics = \"line\", fibres = 20", "never deflect the beam"),
        of_scanner(
            "a single fibre",
            "optics = \"line\", scan_angle_max_deg = 45",
            "line optics without `fibres` have a single fibre",
        ),
        of_scanner(
            "a negative limit",
            "optics = \"conic\", scan_angle_max_deg = -20",
            "`scan_angle_max_deg` must be a number of at least 0",
        ),
        of_scanner(
            "a cone of more than half a turn",
            "optics = \"conic\", scan_angle_max_deg = 200",
            "`scan_angle_max_deg` is 200; half angles of these optics are at most 180 degrees",
        ),
        of_scanner(
            "a mirror that swings by more than half a turn",
            "optics = \"oscillating\", scan_angle_max_deg = 200",
            "half angles of these optics are at most 180 degrees",
        ),
        of_scanner(
            "no limit of the frequency above a minimum",
            &and("scan_freq_min_hz = 5, scan_freq_max_hz = 0"),
            "`scan_freq_max_hz` is 0, which means no limit",
        ),
        of_scanner(
            "a negative limit of the head",
            &and("head_rate_max_deg_per_s = -60"),
            "`head_rate_max_deg_per_s` is below 0",
        ),
        of_scanner(
            "noise ten times the threshold",
            &and("max_returns = 4, range_max_m = 250, nep_w = 1e-8, received_energy_min_w = 1e-9"),
            "false points per pulse",
        ),
        of_scanner(
            "noise a third of the threshold",
            &and("max_returns = 4, range_max_m = 250, nep_w = 1e-9, received_energy_min_w = 3.3e-9"),
            "crosses the detection threshold",
        ),
        of_scanner(
            "mA/W for A/W",
            &and("responsivity_a_per_w = 800"),
            "800 mA/W are 0.8 A/W",
        ),
        of_scanner("a range walk in millimetres", &and("range_walk_m = 50"), "50 mm are 0.05 m"),
        of_scanner("a bandwidth in MHz", &and("bandwidth_hz = 200"), "200 MHz are 200000000 Hz"),
        of_scanner(
            "channels of one id",
            &and("channel = [{ id = \"a\" }, { id = \"a\" }]"),
            "`id` of \"a\" occurs twice",
        ),
        made(
            "a mirror that swings too far in a leg",
            "optics = \"oscillating\"",
            "scan_freq_hz = 20, scan_angle_deg = 200",
            SPEED,
            "`scan_angle_deg` of 200 degrees is more than 180",
        ),
        made(
            "a scan angle of 0",
            ROTATING,
            "scan_freq_hz = 20, scan_angle_deg = 0",
            SPEED,
            "`scan_angle_deg` of 0 counts as not given; the scanner's 45 degrees are used",
        ),
        made("a mirror that stands", ROTATING, "scan_angle_deg = 20", SPEED, "the mirror stands still"),
        made("a missing speed", ROTATING, SWATH, "active = true", "`speed_m_per_s` is missing; 70 m/s are used"),
        made(
            "a negative speed",
            ROTATING,
            &format!("{SWATH}, max_duration_s = 0.3"),
            "speed_m_per_s = -20",
            "is -20 m/s, which is no speed",
        ),
        made("a speed of 0", ROTATING, &format!("{SWATH}, max_duration_s = 0.3"), "speed_m_per_s = 0", "is no speed"),
        written(
            "an energy model that the physics has not",
            "m.toml",
            own(ROTATING, SWATH, SPEED) + "physics = { legacy_energy = true }\n",
            "run m.toml -o a.xyz",
            "has no effect with the correction radiometry",
        ),
        written(
            "a mirror that swings faster in the next leg",
            "s.xml",
            survey()
                .replace("template=\"strip\" active=\"false\"", "template=\"strip\" scanFreq_hz=\"20\""),
            "run s.xml -o a.xyz",
            "takes fewer pulses than in the leg before (",
        ),
        written(
            "a part that moves at every pulse",
            "scene.xml",
            fs::read_to_string(fixture("terrain/scene.xml")).unwrap().replacen(
                "</part>",
                "<dmotion id=\"m\" loop=\"0\"><motion type=\"translation\" vec=\"0;0;0.0001\"/></dmotion></part>",
                1,
            ),
            "run survey.xml -o a.xyz",
            "moves at every pulse",
        ),
        written(
            "an element that lost its bracket",
            "scene.xml",
            fs::read_to_string(fixture("terrain/scene.xml")).unwrap().replacen(
                "</part>",
                "filter type=\"scale\"><param type=\"double\" key=\"scale\" value=\"3\"/></part>",
                1,
            ),
            "run survey.xml -o a.xyz",
            "did an element lose its `<`?",
        ),
    ]
}

#[test]
fn instruments_and_legs_that_contradict_themselves_are_reported() {
    check(&instruments());
}

#[test]
fn milliseconds_end_a_strict_run_before_anything_is_flown() {
    let mistake = recording("", in_milliseconds(&poses(UTM, TO_EAST)), "");
    let done = make(&mistake, true);
    let said = text(&done.stderr);
    assert_eq!((done.status.code(), said.matches("m/s on average").count()), (Some(2), 1), "{said}");
    assert!(!said.contains("what was measured"), "{said}");
}

/// Writes the files of a mistake and runs its command.
fn make(mistake: &Mistake, strict: bool) -> std::process::Output {
    let dir = folder();
    fs::create_dir(dir.path().join("sub")).unwrap();
    let lay = |name: &str, content: &[u8]| fs::write(dir.path().join(name), content).unwrap();
    for entry in fs::read_dir(fixture("terrain")).unwrap() {
        let path = entry.unwrap().path();
        lay(path.file_name().unwrap().to_str().unwrap(), &fs::read(&path).unwrap());
    }
    lay("utm.xml", utm_scene().as_bytes());
    lay("local.toml", stream("scene.xml#terrain").as_bytes());
    lay("utm.toml", stream("utm.xml#terrain").as_bytes());
    lay("wgs.toml", stream("utm.xml#terrain").as_bytes());
    let bare =
        stream("scene.xml#terrain").replace("[platform]\ncatalogue = \"data/platforms.xml#sr22\"\n", "");
    lay("bare.toml", bare.as_bytes());
    lay("dem.xml", raster_scene().as_bytes());
    let legs = "[[leg]]\nposition_m = [0, 0, 900]\nspeed_m_per_s = 60\n[[leg]]\nposition_m = [60, 0, 900]\nactive = false\n";
    lay("dem.toml", (pipeline("dem.xml#dem", "") + legs).as_bytes());
    lay("flight.toml", stream("dem.xml#dem").as_bytes());
    lay("taken.xyz", b"1 2 3\n");
    mistake.files.iter().for_each(|(name, content)| lay(name, content));
    let takes_strict = ["run ", "plan ", "scene "].iter().any(|command| mistake.line.starts_with(command));
    let strict = ["--strict"].into_iter().filter(|_| strict && takes_strict);
    let words: Vec<&str> = mistake.line.split(' ').chain(strict).collect();
    feed(dir.path(), &words, mistake.stdin.as_bytes())
}

fn check(mistakes: &[Mistake]) {
    let mut wrong = Vec::new();
    for mistake in mistakes {
        let done = make(mistake, false);
        let said = text(&done.stderr);
        let warned = !done.status.success() || mistake.is_note || said.contains("warning:");
        if !(warned && said.contains(mistake.answer)) {
            wrong.push(format!("{} ({}): no {:?} in\n{said}", mistake.name, done.status, mistake.answer));
        }
        let status = make(mistake, true).status.code();
        if !mistake.is_note && !matches!(status, Some(1..=3)) {
            wrong.push(format!("{}: status {status:?} with --strict", mistake.name));
        }
    }
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), mistakes.len(), wrong.join("\n"));
}

#[test]
fn numbers_that_cannot_be_meant_are_answered_with_their_cause() {
    check(&plausible_numbers());
}

#[test]
fn areas_and_inventories_that_are_not_used_as_written_are_told() {
    check(&areas_and_inventories());
}

#[test]
fn words_and_files_that_are_wrong_are_answered_with_their_cause() {
    check(&words_and_files());
    assert!(plausible_numbers().len() + words_and_files().len() >= 47);
}

#[test]
fn what_is_right_runs_without_a_word() {
    let right = [
        flown("a flight", STREAM, poses([0.0, 0.0, 400.0], TO_EAST), ""),
        flown("a flight in UTM", OVER_UTM, poses(UTM, TO_EAST), ""),
        // The first seconds are flown beside the scene, and nothing is measured in them.
        approach(
            "a flight that reaches the scene late",
            with_times(&along([-60.0, 0.0, 400.0], [8.0, 0.0, 0.0], TO_EAST), 4.0),
        ),
        approach(
            "an approach from 4 km away",
            with_times(&along([-1900.0, 0.0, 400.0], [42.0, 0.0, 0.0], TO_EAST), 20.0),
        ),
        flown("a level flight to the north", STREAM, along([0.0, 0.0, 400.0], [0.0, 0.6, 0.0], [0.0; 3]), ""),
        flown(
            "a flight in radians that says so",
            STREAM,
            poses([0.0, 0.0, 400.0], [0.01, 0.02, 1.56])
                .replace("roll,pitch,yaw", "roll_rad,pitch_rad,yaw_rad"),
            "",
        ),
        flown(
            "the same by an option",
            "run local.toml -o a.xyz --trajectory-angles rad",
            poses([0.0, 0.0, 400.0], [0.01, 0.02, 1.56]),
            "",
        ),
        written(
            "a tripod on the ground",
            "t.xml",
            tripod("x=\"0\" y=\"0\" onGround=\"true\""),
            "run t.xml -o a.xyz",
            "",
        ),
        // Its pulse is 5 ns wide at half maximum, which only the refined physics takes so.
        written(
            "bins that are wider than a short pulse, and narrower than that of the instrument",
            "t.xml",
            tripod("x=\"0\" y=\"0\" onGround=\"true\"").replacen(
                "<leg>",
                "<FWFSettings binSize_ns=\"6\" winSize_ns=\"12\"/><leg>",
                1,
            ),
            "run t.xml -o a.xyz --physics refined",
            "",
        ),
        written(
            "a raster in metres",
            "dem.tif",
            raster([0.0, 30.0], 10.0, None),
            "run dem.toml -o a.xyz --physics helios",
            "",
        ),
    ];
    for mistake in &right {
        let done = make(mistake, true);
        let said = text(&done.stderr);
        assert!(
            done.status.success() && !said.contains("warning") && !said.contains("error"),
            "{}: {said}",
            mistake.name
        );
    }
}

/// Every command that reads input of the user, with input that is warned of: an error with --strict, which
/// writes nothing.
#[test]
fn strict_is_for_all_commands() {
    let dir = folder();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    write("flat.obj", "v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nusemtl nowhere\nf 1 2 3 4\n");
    write("trees.csv", "id,x,y,height,species\na,0,0,9,beech\nb,0,0,9,beech\n");
    fs::create_dir(dir.path().join("models")).unwrap();
    fs::copy(fixture("forest/beech.obj"), dir.path().join("models/beech_1.obj")).unwrap();
    write("cloud.xyz", "0 0 0\n1 0 0\nnan nan nan\n1 1 1\n");
    let area = "POLYGON ((-9 -9, 9 -9, 9 9, -9 9))";
    let plan =
        ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--height", "60", "--speed", "8", "--area", area];
    let commands: [(&[&str], &str); 6] = [
        (&["scene", "info", "flat.obj"], ""),
        (&["scene", "info", "flat.obj", "--json"], ""),
        (&["scene", "pack", "flat.obj", "-o", "flat.vlscene"], "flat.vlscene"),
        (&["scene", "stand", "trees.csv", "--trees", "models", "-o", "stand"], "stand"),
        (&["preview", "cloud.xyz", "-o", "cloud.png"], "cloud.png"),
        (&[&plan[..], &["--scene", "flat.obj", "-o", "plan.toml"]].concat(), "plan.toml"),
    ];
    for (command, made) in commands {
        let strict = run(dir.path(), &[command, &["--strict"]].concat());
        assert_eq!(strict.status.code(), Some(2), "{command:?}: {}", text(&strict.stderr));
        assert!(strict.stdout.is_empty(), "{command:?}");
        assert!(made.is_empty() || !dir.path().join(made).exists(), "{command:?}");
        succeed(dir.path(), command);
        assert!(made.is_empty() || dir.path().join(made).exists(), "{command:?}");
    }
}
