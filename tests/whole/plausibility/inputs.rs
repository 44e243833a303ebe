//! Inputs with and without mistakes: poses, pipelines, scenes.

use super::{Mistake, typed, written};
use crate::common::fixture;
use std::fs;

pub const HEADER: &str = "time,x,y,z,roll,pitch,yaw\n";

/// A second of flight to the east through `middle`, 60 m/s.
pub fn poses(middle: [f64; 3], angles: [f64; 3]) -> String {
    along(middle, [0.6, 0.0, 0.0], angles)
}

/// A hundred poses with `step` metres from one to the next.
pub fn along(middle: [f64; 3], step: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> String {
    let mut text = HEADER.to_owned();
    for i in 0..100 {
        let at = |axis: usize| middle[axis] + (f64::from(i) - 50.0) * step[axis];
        let time = 1000.0 + f64::from(i) * 0.01;
        text += &format!("{time},{},{},{},{roll},{pitch},{yaw}\n", at(0), at(1), at(2));
    }
    text
}

/// The scanner of the terrain with a detection threshold of 1 W.
pub fn scanner_with_high_threshold() -> String {
    let scanner = fs::read_to_string(fixture("terrain/scanners.xml")).unwrap();
    scanner.replace("receivedEnergyMin_W=\"1e-9\"", "receivedEnergyMin_W=\"1\"")
}

/// Poses whose times are milliseconds, without a word of it.
pub fn in_milliseconds(poses: &str) -> String {
    with_times(poses, 1000.0)
}

/// Poses whose times are multiplied by `factor`.
pub fn with_times(poses: &str, factor: f64) -> String {
    let line = |line: &str| match line.split_once(',') {
        Some((time, rest)) if line != HEADER.trim_end() => {
            format!("{:.7},{rest}\n", factor * time.parse::<f64>().unwrap())
        }
        _ => format!("{line}\n"),
    };
    poses.lines().map(line).collect()
}

/// A second of flight with a single pose a kilometre aside.
pub fn with_jump() -> String {
    let [x, y, z] = UTM;
    let (right, wrong) = (format!(",{},{y},", x + 6.0), format!(",{},{},", x + 6.0, y + 1000.0));
    let poses = poses([x, y, z], TO_EAST);
    assert!(poses.contains(&right), "{poses}");
    poses.replacen(&right, &wrong, 1)
}

/// A pipeline over the terrain with an airborne scanner and its mount; `rest` follows.
pub fn pipeline(scene: &str, rest: &str) -> String {
    format!(
        "scene = \"{scene}\"\n{rest}\n[platform]\ncatalogue = \"data/platforms.xml#sr22\"\n[scanner]\n\
         catalogue = \"data/scanners_als.xml#riegl_lms-q780\"\n[settings]\npulse_freq_hz = 100000\nscan_freq_hz = 80\n\
         scan_angle_deg = 20\nmax_duration_s = 2\n"
    )
}

pub fn stream(scene: &str) -> String {
    pipeline(scene, "[trajectory]\npath = \"-\"")
}

/// The terrain in UTM zone 32N, 300 m high.
pub fn utm_scene() -> String {
    let terrain = fs::read_to_string(fixture("terrain/scene.xml")).unwrap();
    let moved = "<filter type=\"translate\"><param type=\"vec3\" key=\"offset\" value=\"476000;5429000;300\"/></filter>";
    terrain.replace("</part>", &format!("{moved}</part>"))
}

pub fn survey() -> String {
    fs::read_to_string(fixture("terrain/survey.xml")).unwrap()
}

/// A tripod on the terrain whose head turns once.
pub fn tripod(place: &str) -> String {
    format!(
        "<document><survey name=\"t\" scene=\"scene.xml#terrain\" platform=\"data/platforms.xml#tripod\" \
         scanner=\"data/scanners_tls.xml#riegl_vz400\"><leg><platformSettings {place}/><scannerSettings active=\"true\" \
         pulseFreq_hz=\"100000\" scanAngle_deg=\"50\" scanFreq_hz=\"60\" headRotatePerSec_deg=\"60\" headRotateStart_deg=\"0\" \
         headRotateStop_deg=\"360\" trajectoryTimeInterval_s=\"1\"/></leg></survey></document>"
    )
}

/// An interpolated flight that a survey names.
pub fn recorded(more: &str) -> String {
    format!(
        "<document><platformSettings id=\"p\"/><survey name=\"t\" scene=\"scene.xml#terrain\" platform=\"interpolated\" \
         basePlatform=\"data/platforms.xml#sr22\" scanner=\"data/scanners_als.xml#riegl_lms-q780\"><leg>\
         <platformSettings trajectory=\"flown.csv\" tIndex=\"0\" xIndex=\"1\" yIndex=\"2\" zIndex=\"3\" rollIndex=\"4\" \
         pitchIndex=\"5\" yawIndex=\"6\" {more}/><scannerSettings active=\"true\" pulseFreq_hz=\"100000\" scanAngle_deg=\"20\" \
         scanFreq_hz=\"80\"/></leg></survey></document>"
    )
}

pub fn raster_scene() -> &'static str {
    "<document><scene id=\"dem\"><part><filter type=\"geotiffloader\"><param type=\"string\" key=\"filepath\" \
     value=\"dem.tif\"/></filter></part></scene></document>"
}

/// The terrain, and its houses dropped to the plane through the whole of it.
pub fn slope() -> String {
    let terrain = fs::read_to_string(fixture("terrain/scene.xml")).unwrap();
    let drop = "<filter type=\"translate\"><param type=\"integer\" key=\"onGround\" value=\"1\"/><param \
                type=\"vec3\" key=\"offset\" value=\"0;0;0\"/></filter>";
    let (before, after) = terrain.split_once("houses.obj\"/></filter>").unwrap();
    format!("{before}houses.obj\"/></filter>{drop}{after}")
}

/// Two rasters beside each other.
pub fn two_rasters() -> String {
    let part = raster_scene().split("<part>").nth(1).and_then(|rest| rest.split("</scene>").next()).unwrap();
    let second = format!("<part>{}</scene>", part.replace("dem.tif", "dem2.tif"));
    raster_scene().replace("</scene>", &second)
}

pub const TO_EAST: [f64; 3] = [0.0, 0.0, 90.0];
pub const UTM: [f64; 3] = [476_000.0, 5_429_000.0, 700.0];
pub const STREAM: &str = "run local.toml -o a.xyz";
pub const PLAN: &str =
    "plan airborne --scanner riegl_vux-1uav --height 80 --speed 8 --area plot.geojson -o plan.toml";
pub const STAND: &str = "scene stand trees.csv --trees sub -o stand";
pub const OVER_UTM: &str = "run utm.toml -o a.xyz";

/// A flight in a file over the scene in UTM.
pub fn recording(name: &'static str, poses: String, answer: &'static str) -> Mistake {
    let run = pipeline("utm.xml#terrain", "[trajectory]\npath = \"flown.csv\"");
    Mistake {
        files: vec![("flown.csv", poses.into_bytes()), ("f.toml", run.into_bytes())],
        ..typed(name, "run f.toml -o a.xyz", answer)
    }
}

/// A straight flight over the terrain with an instrument of the user's, at 4 kHz and 20 lines per second.
pub fn own(scanner: &str, settings: &str, leg: &str) -> String {
    format!(
        "scene = \"scene.xml#terrain\"\n\
         platform = {{ kind = \"linear_path\", mount = {{ rotate_deg = [{{ x = -90 }}, {{ z = 90 }}] }} }}\n\
         leg = [{{ position_m = [-60, 0, 100], {leg} }}, {{ position_m = [60, 0, 100], active = false }}]\n\
         settings = {{ pulse_freq_hz = 4000, {settings} }}\n\
         scanner = {{ id = \"own\", pulse_freqs_hz = [4000], {scanner} }}\n"
    )
}

/// A flight to the terrain with an instrument of the user's, until the end of its poses.
pub fn approach(name: &'static str, poses: String) -> Mistake {
    let run = "scene = \"scene.xml#terrain\"\n\
               platform = { kind = \"linear_path\", mount = { rotate_deg = [{ x = -90 }, { z = 90 }] } }\n\
               trajectory = { path = \"-\" }\n\
               settings = { pulse_freq_hz = 4000, scan_freq_hz = 20, scan_angle_deg = 20 }\n\
               scanner = { id = \"own\", pulse_freqs_hz = [4000], optics = \"rotating\", scan_angle_max_deg = 45 }\n";
    Mistake { stdin: poses, ..written(name, "late.toml", run, "run late.toml -o a.xyz", "") }
}

pub const ROTATING: &str = "optics = \"rotating\", scan_angle_max_deg = 45";
pub const SWATH: &str = "scan_freq_hz = 20, scan_angle_deg = 20";
pub const SPEED: &str = "speed_m_per_s = 60";
