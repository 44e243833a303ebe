//! Every limit that docs/dev/limits.md states is exceeded, and ends the run with the stated message.

use crate::common::{folder, run, succeed, text};
use crate::hostile::raster;
use std::collections::BTreeMap;

const MESH: &str = "v -9 -9 0\nv 9 -9 0\nv 0 9 0\nf 1 2 3\n";
const SURVEY: &str = r##"<?xml version="1.0"?>
<document>
<scene id="s"><part><filter type="objloader"><param type="string" key="filepath" value="mesh.obj"/></filter></part></scene>
<platform id="p" type="linearpath"><scannerMount><rot axis="x" angle_deg="-90"/></scannerMount></platform>
<scanner id="b" name="b" optics="oscillating" beamDivergence_rad="0.0003" pulseFreqs_Hz="1000" pulseLength_ns="4"
 accuracy_m="0" rangeMin_m="0.1" scanAngleMax_deg="60" scanFreqMin_Hz="1" scanFreqMax_Hz="100" wavelength_nm="1064">
 <beamOrigin/><headRotateAxis z="1"/></scanner>
<survey name="n" scene="#s" platform="#p" scanner="#b">
 <leg><platformSettings x="0" y="0" z="5" movePerSec_m="10"/><scannerSettings pulseFreq_hz="1000" scanAngle_deg="10" scanFreq_hz="10"/></leg>
 <leg><platformSettings x="1" y="0" z="5" movePerSec_m="10"/><scannerSettings active="false" pulseFreq_hz="1000" scanAngle_deg="10" scanFreq_hz="10"/></leg>
</survey>
</document>
"##;
const FOLLOW: &[&str] = &["run", "survey.xml", "-o", "out.xyz", "--trajectory", "way.csv"];
const TRACE: &[&str] = &["trace", "pulses.csv", "--scanner", "survey.xml", "-o", "out.xyz"];
const RUN: &[&str] = &["run", "survey.xml", "-o", "out.xyz"];

/// How a limit is exceeded: the files that replace those of the survey, and the command that reads them.
struct Case {
    files: Vec<(&'static str, Vec<u8>)>,
    /// Length to which the first file is extended by zeros.
    length: u64,
    args: Vec<&'static str>,
}

/// `content` in `file`, which the command reads.
fn case(file: &'static str, content: impl Into<Vec<u8>>, args: &[&'static str]) -> Case {
    Case { files: vec![(file, content.into())], length: 0, args: args.to_vec() }
}

/// A file of zeros.
fn sparse(file: &'static str, length: u64, args: &[&'static str]) -> Case {
    Case { length, ..case(file, "", args) }
}

/// A run with this survey.
fn run_of(survey: impl Into<Vec<u8>>) -> Case {
    case("survey.xml", survey, RUN)
}

/// The survey with the first `from` replaced.
fn changed(from: &str, to: &str) -> Case {
    assert!(SURVEY.contains(from), "{from}");
    run_of(SURVEY.replacen(from, to, 1))
}

/// The survey with another scene than its own.
fn with_scene(file: &'static str, content: impl Into<Vec<u8>>) -> Case {
    let mut changed = changed("mesh.obj", file);
    changed.files.push((file, content.into()));
    changed
}

/// A survey whose platform follows this file, with these attributes of its leg.
fn recorded(way: &str, attributes: &str) -> Case {
    let start = SURVEY.find(" <leg>").expect("a leg");
    let head = SURVEY[..start].replacen("platform=\"#p\"", "platform=\"interpolated\"", 1);
    let leg = format!(
        r#"<leg><platformSettings trajectory="way.txt" {attributes}/><scannerSettings pulseFreq_hz="1000" scanAngle_deg="10" scanFreq_hz="10"/></leg>"#
    );
    let mut case = run_of(format!("{head}{leg}</survey></document>"));
    case.files.push(("way.txt", format!("#TIME_COLUMN: 0\n{way}").into_bytes()));
    case
}

/// A pulse with these values of time, x and divergence.
fn pulse(time: &str, x: &str, divergence: &str) -> Case {
    let row = format!("time,x,y,z,dx,dy,dz,divergence\n{time},{x},0,5,0,0,-1,{divergence}\n");
    case("pulses.csv", row, TRACE)
}

fn poses(rows: &str) -> Case {
    case("way.csv", format!("time,x,y,z,roll,pitch,yaw\n{rows}"), FOLLOW)
}

/// A document of one element with this content.
fn document(content: &str) -> Case {
    run_of(format!("<document>{content}</document>"))
}

/// A case for every limit of the page.
fn cases() -> BTreeMap<&'static str, Case> {
    let scattered: String = (0..50).map(|i| format!("{} 0 0\n", 100 * i)).collect();
    let wide: String = (0..251).map(|i| format!(" a{i}=\"1\"")).collect();
    let entity = |length: usize, named: usize| {
        run_of(format!(
            "<!DOCTYPE d [<!ENTITY e \"{}\">]><document>{}</document>",
            "x".repeat(length),
            "&e;".repeat(named)
        ))
    };
    let pulse_file = |content: Vec<u8>, length: u64| {
        let mut case = changed("pulseLength_ns=\"4\"", "pulseShape=\"p.txt\"");
        case.files.insert(0, ("p.txt", content));
        Case { length, ..case }
    };
    let mut wander = changed("optics=\"oscillating\"", "optics=\"oscillating\" scanWander=\"w.txt\"");
    wander.files.insert(0, ("w.txt", Vec::new()));
    wander.length = (1 << 24) + 1;
    let pipeline =
        "survey = \"survey.xml\"\n[settings]\npulse_times = \"t.txt\"\n[[output]]\npath = \"o.xyz\"\n";
    let mut times = case("p.toml", pipeline, &["run", "p.toml"]);
    times.files.extend(changed("<document>", "<document>").files);
    times.files.insert(0, ("t.txt", Vec::new()));
    times.length = (1 << 31) + 1;
    let pattern = |rows: String, length: u64| {
        let mut case = case("rows.csv", rows, &["run", "p.toml", "-o", "out.xyz"]);
        let pipeline = "survey = \"survey.xml\"\n[scanner]\noptics = \"pattern\"\npattern = \"rows.csv\"\n";
        case.files.push(("p.toml", pipeline.into()));
        case.files.extend(changed("<document>", "<document>").files);
        Case { length, ..case }
    };
    let channels: String = (0..1025).map(|i| format!("{i},0,0\n")).collect();
    let samples: String = (0..65_537).map(|i| format!("{i} 1\n")).collect();
    let long = |length: usize| "9".repeat(length);
    let leg = "z=\"5\" movePerSec_m=\"10\"/><scannerSettings";
    let crs = [RUN, &["--crs", "c.wkt"]].concat();
    let motion =
        "</filter><dmotion id=\"m\" loop=\"0\"><motion type=\"translation\" vec=\"0;0;0.1\"/></dmotion>";
    let mut far_step = case("pulses.csv", "time,x,y,z,dx,dy,dz,step\n0,0,0,5,0,0,-1,2e10\n", TRACE);
    far_step.files.extend(changed("</filter>", motion).files);
    let from_table = [RUN, &["--scene", "t.csv"]].concat();
    let formula = "<rangeError expr=\"1/(THETA-THETA)\"/><beamOrigin/>";
    let stl = "solid a\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n";
    let mut table_of_materials = with_scene("mesh.stl", stl);
    table_of_materials.files.insert(0, ("materials.csv", b"name,reflectance\n".repeat(1 << 12)));
    table_of_materials.length = (1 << 26) + 1;
    let instances = r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"meshes":[{"primitives":[]}],
        "nodes":[{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":0}}}}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":4194305,"type":"VEC3"}],
        "bufferViews":[{"buffer":0,"byteLength":3}],"buffers":[{"byteLength":3,"uri":"data:;base64,AAAA"}]}"#;
    BTreeMap::from([
        ("size of a file of a deflector's wander", wander),
        ("size of a file of pulse times", times),
        ("size of a scan pattern", pattern(String::new(), (1 << 31) + 1)),
        ("channels of a scan pattern", pattern(format!("channel,azimuth,elevation\n{channels}"), 0)),
        ("pulses of a scan pattern", pattern("index,azimuth,elevation\n0,0,0\n40000000,0,0\n".to_owned(), 0)),
        ("document", {
            let comment = format!("<document><!-- {} -->", "x".repeat(3_000_000));
            Case { args: [RUN, &["--max-memory", "2M"]].concat(), ..changed("<document>", &comment) }
        }),
        ("scene", {
            let mesh = MESH.repeat(40_000);
            let mut case = case("mesh.obj", mesh, RUN);
            case.args.extend(["--max-memory", "1M"]);
            case
        }),
        ("packed scene", {
            let dir = folder();
            // Each triangle has a place of its own: trees leave out those that repeat another.
            let mesh = |i: u32| {
                let z = f64::from(i) * 1e-3;
                format!("v -9 -9 {z}\nv 9 -9 {z}\nv 0 9 {z}\nf -3 -2 -1\n")
            };
            std::fs::write(dir.path().join("many.obj"), (0..10_000).map(mesh).collect::<String>()).unwrap();
            succeed(
                dir.path(),
                &["scene", "pack", "many.obj", "--physics", "helios", "-o", "s.vlscene", "-q"],
            );
            let args = [RUN, &["--max-memory", "300k", "--scene", "s.vlscene"]].concat();
            case("s.vlscene", std::fs::read(dir.path().join("s.vlscene")).unwrap(), &args)
        }),
        ("rasters, with the tree over those that are stored as triangles", {
            let args = [RUN, &["--max-memory", "20M", "--scene", "r.tif"]].concat();
            case("r.tif", raster(2000), &args)
        }),
        ("tiles that one footprint meets", {
            let mut case = case("mesh.obj", MESH, RUN);
            case.args.extend(["--scene-memory", "100"]);
            case
        }),
        (
            "size of an XML document",
            Case { length: (1 << 27) + 1, ..run_of(format!("<document>{}", " ".repeat(1 << 16))) },
        ),
        ("elements, texts and comments of a document", document(&"<a/>".repeat(1 << 22))),
        ("depth of elements", document(&"<a>".repeat(200))),
        ("attributes of an element", document(&format!("<a{wide}/>"))),
        ("text of an entity", entity((1 << 14) + 1, 1)),
        ("all texts of entities together", entity(1 << 14, 65)),
        ("size of a pipeline file", sparse("p.toml", (1 << 24) + 1, &["run", "p.toml", "-o", "out.xyz"])),
        ("size of a table of instances", sparse("t.csv", (1 << 29) + 1, &from_table)),
        ("line of a table of instances", case("t.csv", long(70_000), &from_table)),
        ("step of a pulse, where parts of the scene move", far_step),
        ("size of a pulse shape", pulse_file(Vec::new(), (1 << 24) + 1)),
        ("samples of a pulse shape", pulse_file(samples.into_bytes(), 0)),
        ("size of a coordinate reference system", sparse("c.wkt", (1 << 20) + 1, &crs)),
        (
            "line of an OBJ file, a point cloud or another text of a scene",
            case("mesh.obj", format!("#{}\n{MESH}", long(1 << 20)), RUN),
        ),
        (
            "line of a stream of pulses",
            case("pulses.csv", format!("time,x,y,z,dx,dy,dz\n{}", long(70_000)), TRACE),
        ),
        ("line of a trajectory", poses(&long(70_000))),
        ("line of a trajectory of a survey", recorded(&long(70_000), "")),
        (
            "number of a column of a trajectory",
            case("way.csv", "#TIME_COLUMN: 18446744073709551615\n1,2,3,4,5,6,7\n", FOLLOW),
        ),
        (
            "brackets and functions within each other in a formula",
            changed("<beamOrigin/>", &format!("<rangeError expr=\"{}\"/><beamOrigin/>", "(".repeat(51))),
        ),
        ("size of a table of materials", table_of_materials),
        ("meshes that the nodes of a glTF file place", with_scene("mesh.gltf", instances)),
        ("coordinate of a scene", with_scene("far.obj", MESH.replace("v 9", "v 2e12"))),
        ("coordinate of a leg", changed("x=\"0\"", "x=\"2e10\"")),
        ("coordinate of a pose", poses("0,2e10,0,5,0,0,0\n")),
        ("coordinate of a pose of a survey's trajectory", recorded("0,0,0,0,0,0,5\n1,0,0,0,2e10,0,5\n", "")),
        ("coordinate of a pulse", pulse("0", "2e10", "0.001")),
        ("time of a pose, in any scale", poses("2e11,0,0,5,0,0,0\n")),
        ("time of a pulse", pulse("2e11", "0", "0.001")),
        (
            "time from the first pose to the last",
            Case {
                args: [FOLLOW, &["--max-gap", "10"]].concat(),
                ..poses("0,0,0,5,0,0,0\n1,0,0,5,0,0,0\n3e6,0,0,5,0,0,0\n")
            },
        ),
        ("interval between two poses that is flown", poses("0,0,0,5,0,0,0\n3601,0,0,5,0,0,0\n")),
        (
            "interval between two poses of a survey's trajectory",
            recorded("0,0,0,0,0,0,5\n3601,0,0,0,1,0,5\n", ""),
        ),
        (
            "duration of a leg along a survey's trajectory",
            recorded("0,0,0,0,0,0,5\n1,0,0,0,1,0,5\n", "tStart=\"0\" tEnd=\"3e6\""),
        ),
        (
            "duration of a leg",
            changed("pulseFreq_hz=\"1000\"", "pulseFreq_hz=\"1000\" maxDuration_s=\"3e6\""),
        ),
        ("time on the way to the next leg", changed("movePerSec_m=\"10\"", "movePerSec_m=\"1e-7\"")),
        ("warm-up of the optics", changed(leg, &format!("{leg} opticsWarmupPhase_s=\"1e9\""))),
        ("any number", changed("x=\"0\"", "x=\"1e13\"")),
        ("number above 0", changed("pulseLength_ns=\"4\"", "pulseLength_ns=\"1e16\"")),
        ("number of at least 0", changed("accuracy_m=\"0\"", "accuracy_m=\"1e300\"")),
        ("beam divergence", changed("beamDivergence_rad=\"0.0003\"", "beamDivergence_rad=\"1e300\"")),
        (
            "beam divergence of `vlscan trace`",
            Case { args: [TRACE, &["--divergence", "1e300"]].concat(), ..pulse("0", "0", "0.001") },
        ),
        ("beam divergence of a pulse", pulse("0", "0", "1e300")),
        ("wavelength", changed("wavelength_nm=\"1064\"", "wavelength_nm=\"1000001\"")),
        ("value of a formula", changed("<beamOrigin/>", formula)),
        (
            "rings of subrays (`beamSampleQuality`)",
            changed("<leg>", "<FWFSettings beamSampleQuality=\"513\"/><leg>"),
        ),
        (
            "cells with points of `vlscan raster`",
            case(
                "cloud.xyz",
                scattered.clone(),
                &["raster", "cloud.xyz", "--dsm", "a.tif", "--max-memory", "1K"],
            ),
        ),
        (
            "points of `vlscan fit`",
            case(
                "cloud.xyz",
                scattered,
                &["fit", "cloud.xyz", "-o", "fit.toml", "--still-at", "0,0,5", "--max-memory", "1K"],
            ),
        ),
        ("bins of a pulse", changed("pulseLength_ns=\"4\"", "pulseLength_ns=\"1e9\"")),
    ])
}

/// The rows of the page's tables: limit and message.
fn rows(page: &str) -> Vec<(&str, &str)> {
    page.lines()
        .filter_map(|line| {
            let cells: Vec<&str> = line.strip_prefix("| ")?.strip_suffix(" |")?.split(" | ").collect();
            let message = cells.get(2)?.strip_prefix('`')?.strip_suffix('`')?;
            Some((cells[0], message))
        })
        .collect()
}

/// Runs the command of a case in a folder of its own; the exit status and the messages.
fn outcome(case: &Case) -> (Option<i32>, String) {
    let dir = folder();
    let put = |name: &str, content: &[u8]| std::fs::write(dir.path().join(name), content).expect("a file");
    put("survey.xml", SURVEY.as_bytes());
    put("mesh.obj", MESH.as_bytes());
    for (i, (name, content)) in case.files.iter().enumerate() {
        put(name, content);
        if i == 0 && case.length > 0 {
            let file = std::fs::File::options().write(true).open(dir.path().join(name)).expect("a file");
            file.set_len(case.length).expect("a long file");
        }
    }
    let output = run(dir.path(), &case.args);
    (output.status.code(), text(&output.stderr))
}

#[test]
fn every_stated_limit_ends_a_run_with_its_message() {
    let (mut cases, mut complaints) = (cases(), Vec::new());
    for (limit, message) in rows(include_str!("../../docs/dev/limits.md")) {
        let Some(case) = cases.remove(limit) else {
            complaints.push(format!("{limit}: a row of docs/dev/limits.md without a case here"));
            continue;
        };
        let (status, messages) = outcome(&case);
        if status != Some(2) || !messages.contains(message) || messages.lines().count() > 20 {
            complaints
                .push(format!("{limit}: status {status:?}, expected 2 and {message:?}, found\n{messages}"));
        }
    }
    complaints
        .extend(cases.keys().map(|limit| format!("{limit}: a case without a row in docs/dev/limits.md")));
    assert!(complaints.is_empty(), "{}", complaints.join("\n\n"));
}

#[test]
fn the_survey_of_the_limits_is_within_them() {
    for case in [
        run_of(SURVEY),
        recorded("0,0,0,0,0,0,5\n1,0,0,0,1,0,5\n", ""),
        pulse("0", "0", "0.001"),
        poses("0,0,0,5,0,0,0\n1,1,0,5,0,0,0\n"),
    ] {
        let (status, messages) = outcome(&case);
        assert_eq!(status, Some(0), "{messages}");
    }
}

#[test]
fn formulas_without_a_value_end_the_run() {
    let scanner = SURVEY
        .replacen(
            "optics=\"oscillating\"",
            "optics=\"rotating\" scanAngleEffectiveMax_deg=\"60\" headRotatePerSecMax_deg=\"90\"",
            1,
        )
        .replacen(
            "scanFreq_hz=\"10\"",
            "scanFreq_hz=\"10\" headRotatePerSec_deg=\"90\" headRotateStop_deg=\"90\"",
            1,
        );
    for (element, named) in [
        ("<rangeError expr=\"1e300*1e300\"/>", "the range error, `1e300*1e300`, is inf at"),
        ("<rangeError expr=\"0*ln(-1)\"/>", "the range error, `0*ln(-1)`, is NaN at"),
        ("<deflectionError expr=\"sqrt(THETA)\"/>", "the deflection error, `sqrt(THETA)`, is NaN at -"),
        ("<deflectionError expr=\"1/(THETA-THETA)\"/>", "the deflection error, `1/(THETA-THETA)`, is inf at"),
        ("<headError expr=\"acos(2+THETA)\"/>", "the head error, `acos(2+THETA)`, is NaN at"),
    ] {
        let (status, messages) =
            outcome(&run_of(scanner.replacen("<beamOrigin/>", &format!("{element}<beamOrigin/>"), 1)));
        assert!(status == Some(2) && messages.contains(named), "{element}: status {status:?}, {messages}");
    }
    let noise = "<detectorSettings accuracy_m=\"0.01\" distanceMeasurementError=\"ln(0-t)\"/><leg>";
    let (status, messages) = outcome(&changed("<leg>", noise));
    let named = "the distance measurement error, `ln(0-t)`, is NaN at";
    assert!(status == Some(2) && messages.contains(named), "status {status:?}, {messages}");
}

#[test]
fn blank_lines_and_comments_before_pulses_are_skipped() {
    let mut blank = "\n".repeat(1 << 20).into_bytes();
    blank.extend(b"# pulses\n\ntime,x,y,z,dx,dy,dz\n\n0,0,0,5,0,0,-1\n0,0,0,5,0,0,none\n");
    let (status, messages) = outcome(&case("pulses.csv", blank, TRACE));
    assert!(status == Some(2) && messages.contains("pulses.csv:1048582:"), "status {status:?}, {messages}");
}

/// Facts about a scene need the scene and its tree; a raster that moves is stored as triangles.
#[cfg(target_os = "linux")]
#[test]
fn the_contents_of_a_raster_that_does_not_fit_are_refused() {
    let dir = folder();
    std::fs::write(dir.path().join("r.tif"), raster(4000)).expect("a raster");
    // It moves, so that it is stored as triangles.
    let part = "<part id=\"0\"><filter type=\"geotiffloader\"><param type=\"string\" key=\"filepath\" value=\"r.tif\"/></filter>\
        <dmotion id=\"go\" loop=\"0\"><motion type=\"translation\" vec=\"0.1;0;0\"/></dmotion></part>";
    let scene = format!("<document><scene id=\"s\">{part}</scene></document>");
    std::fs::write(dir.path().join("scene.xml"), scene).expect("a scene");
    let limited = "ulimit -v 1500000; exec \"$0\" scene info scene.xml#s";
    let started = std::time::Instant::now();
    let mut bash = std::process::Command::new("bash");
    let output = bash.current_dir(dir.path()).args(["-c", limited, env!("CARGO_BIN_EXE_vlscan")]).output();
    let output = output.expect("bash");
    let messages = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{messages}");
    assert!(messages.contains("the rasters of the scene need about 3.29 GB"), "{messages}");
    assert!(started.elapsed().as_secs() < 5, "{:?}", started.elapsed());
}
