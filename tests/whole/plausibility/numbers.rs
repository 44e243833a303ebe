//! Numbers that cannot be meant: places, heights, times, units.

use super::inputs::*;
use super::{Mistake, flown, typed, written};
use crate::common::{fixture, raster};
use std::fs;

pub fn plausible_numbers() -> Vec<Mistake> {
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
        typed("a system in feet", "run survey.xml -o a.laz --crs EPSG:2263", "are US survey feet"),
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
