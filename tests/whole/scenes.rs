//! Scenes of every kind give the same points whether packed or loaded from their sources, with instances or
//! without, on one thread or two.

use crate::common::{fixture, folder, run, succeed, text};
use std::fs;
use std::path::Path;

fn write(folder: &Path, name: &str, content: impl AsRef<[u8]>) {
    fs::write(folder.join(name), content).unwrap();
}

/// Points of a survey as text.
fn points(folder: &Path, args: &[&str]) -> Vec<u8> {
    let args = [&["run"], args, &["-q", "-o", "points.xyz", "--force"]].concat();
    succeed(folder, &args);
    let points = fs::read(folder.join("points.xyz")).unwrap();
    assert!(points.len() > 1000, "{args:?} gives {} bytes", points.len());
    points
}

#[test]
fn a_packed_scene_gives_the_bytes_of_its_sources() {
    let dir = folder();
    for name in ["forest", "room", "moving"] {
        let survey = fixture(&format!("{name}/survey.xml"));
        let survey = survey.to_str().unwrap();
        let pack = format!("{name}.vlscene");
        succeed(dir.path(), &["scene", "pack", survey, "-o", &pack, "-q"]);
        let sources = points(dir.path(), &[survey]);
        for extra in [&["-j", "1"][..], &["-j", "2"], &["--tree", "fsah"]] {
            let args = [&[survey, "--scene", &pack], extra].concat();
            assert!(points(dir.path(), &args) == sources, "{name} {extra:?}");
        }
        succeed(dir.path(), &["scene", "info", &pack, "--verify"]);
    }
    // In a pipeline file and in a survey's attribute.
    let survey = fixture("room/survey.xml").display().to_string();
    let packed = points(dir.path(), &[&survey]);
    write(dir.path(), "p.toml", format!("survey = \"{survey}\"\nscene = \"room.vlscene\"\n"));
    assert!(points(dir.path(), &["p.toml"]) == packed);
    let folder = fixture("room");
    let changed = fs::read_to_string(folder.join("survey.xml")).unwrap();
    let start = changed.find("scene=\"").unwrap() + 7;
    let end = start + changed[start..].find('"').unwrap();
    write(dir.path(), "room.xml", format!("{}room.vlscene{}", &changed[..start], &changed[end..]));
    assert!(points(dir.path(), &["room.xml", "--assets", folder.to_str().unwrap()]) == packed);
}

#[test]
fn stale_and_foreign_packs_are_refused_with_the_reason() {
    let dir = folder();
    write(dir.path(), "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    succeed(dir.path(), &["scene", "pack", "a.obj", "-q"]);
    let refused = |expected: &str| {
        let found = run(dir.path(), &["scene", "info", "a.vlscene"]);
        let said = text(&found.stderr);
        assert!(found.status.code() == Some(2) && said.contains(expected), "{:?}: {said}", found.status);
    };
    let whole = fs::read(dir.path().join("a.vlscene")).unwrap();
    write(dir.path(), "a.obj", "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n");
    refused("a.obj has changed");
    let again = run(dir.path(), &["scene", "pack", "a.obj", "-q"]);
    assert!(again.status.code() == Some(2) && text(&again.stderr).contains("--force"));
    write(dir.path(), "a.vlscene", &whole[..whole.len() / 2]);
    refused("is it truncated?");
    write(
        dir.path(),
        "a.vlscene",
        b"<?xml version=\"1.0\"?><document>and so on, long enough for a header</document>",
    );
    refused("expected a packed scene (.vlscene), found an XML document");
    write(dir.path(), "a.vlscene", b"");
    refused("too short");
}

const SCANNER: &str = r#"<document><scanner id="dome" name="dome" optics="rotating" accuracy_m="0.002" beamDivergence_rad="0.0005"
 pulseFreqs_Hz="5000" pulseLength_ns="4" rangeMin_m="0.1" wavelength_nm="1000" scanAngleMax_deg="60" scanAngleEffectiveMax_deg="60"
 scanFreqMin_Hz="1" scanFreqMax_Hz="100" headRotatePerSecMax_deg="360"><FWFSettings beamSampleQuality="2"/>
 <beamOrigin z="0.1"/><headRotateAxis z="1"/></scanner></document>"#;

fn survey(scene: &str) -> String {
    format!(
        r#"<document><survey name="s" scene="{scene}" platform="data/platforms.xml#tripod" scanner="own.xml#dome"><leg>
        <platformSettings x="0" y="0" z="0"/><scannerSettings pulseFreq_hz="5000" scanAngle_deg="50" scanFreq_hz="50"
        headRotateStart_deg="0" headRotateStop_deg="360" headRotatePerSec_deg="360"/></leg></survey></document>"#
    )
}

fn param(kind: &str, key: &str, value: &str) -> String {
    format!("<param type=\"{kind}\" key=\"{key}\" value=\"{value}\"/>")
}

/// A scene with all kinds of parts: a floor, boxes of one mesh of which one drives and one leaves the first
/// box, and voxels with leaf angles around the scanner.
pub fn everything(folder: &Path) {
    write(folder, "own.xml", SCANNER);
    write(folder, "survey.xml", survey("scene.xml#s"));
    write(folder, "floor.obj", "v -20 -20 -1\nv 20 -20 -1\nv 20 20 -1\nv -20 20 -1\nf 1 2 3 4\n");
    let mut solid = String::new();
    for corner in 0..8 {
        let on = |bit: i32| f64::from(corner >> bit & 1);
        solid += &format!("v {} {} {}\n", on(0), on(1), 2.0 * on(2));
    }
    solid += "f 1 2 4 3\nf 5 6 8 7\nf 1 2 6 5\nf 3 4 8 7\nf 1 3 7 5\nf 2 4 8 6\n";
    write(folder, "box.obj", solid);
    let mut voxels = String::from(
        "VOXEL SPACE\n#min_corner: -3 -3 0\n#max_corner: 3 3 3\n#split: 12 12 6\n#res: 0.5 #max_pad: 3\ni j k PadBVTotal a b c d e f g h n transmittance m l\n",
    );
    for i in 0..12 * 12 * 6 {
        let (x, y, z) = (i % 12, i / 12 % 12, i / 144);
        let pad = 0.1 * f64::from((i * 37) % 10);
        voxels += &format!("{x} {y} {z} {pad} 54 0.4 0.1 0.6 1.25 0.3 12.5 7 60 0.5 0.9 0.0\n");
    }
    write(folder, "leaves.vox", voxels);
    write(folder, "leaves.txt", "0,0,1,2.5\n1,0,0,3.5\n0,0,-1,2.5\n");
    let obj =
        |file: &str| format!("<filter type=\"objloader\">{}</filter>", param("string", "filepath", file));
    let at =
        |offset: &str| format!("<filter type=\"translate\">{}</filter>", param("vec3", "offset", offset));
    let moving = |by: &str| {
        let step = format!("<motion type=\"translation\" vec=\"{by}\"/>");
        let turn = "<motion type=\"rotation\" axis=\"0;0;1\" angle=\"2\" selfMode=\"true\"/>";
        format!("<dmotion id=\"m\" loop=\"0\">{step}{turn}</dmotion>")
    };
    let leaves = param("string", "filepath", "leaves.vox") + &param("string", "ladlut", "leaves.txt");
    let parts = [
        obj("floor.obj"),
        obj("box.obj") + &at("6;6;-1"),
        obj("box.obj") + &at("-8;5;-1"),
        obj("box.obj") + &at("-6;-9;-1") + &moving("0.02;0;0"),
        obj("box.obj")
            + &format!("<filter type=\"scale\">{}</filter>", param("double", "scale", "6"))
            + &at("14;-3;-1")
            + "<dmotion id=\"m\" loop=\"0\"><motion type=\"translation\" vec=\"0.06;0;0\"/></dmotion>",
        obj("box.obj") + &at("3;-8;-1"),
        format!("<filter type=\"detailedvoxels\">{leaves}</filter>"),
    ];
    let parts: Vec<String> = parts.iter().map(|p| format!("<part dynStep=\"10\">{p}</part>")).collect();
    write(folder, "scene.xml", format!("<document><scene id=\"s\">{}</scene></document>", parts.concat()));
}

#[test]
fn voxels_instances_and_moving_parts_together_leave_no_trace_of_threads_and_sharing() {
    let dir = folder();
    everything(dir.path());
    for physics in ["helios", "refined"] {
        let of =
            |extra: &[&str]| points(dir.path(), &[&["survey.xml", "--physics", physics], extra].concat());
        let reference = of(&["-j", "1", "--instances", "never"]);
        for extra in [
            &["-j", "2", "--instances", "never"][..],
            &["-j", "1", "--instances", "always"],
            &["-j", "2", "--instances", "always"],
            &["-j", "2", "--instances", "always", "--chunk-size", "7", "--tree", "fsah"],
        ] {
            assert!(of(extra) == reference, "{physics} {extra:?}");
        }
        let ids: std::collections::BTreeSet<&str> =
            std::str::from_utf8(&reference).unwrap().lines().map(|l| l.split(' ').nth(8).unwrap()).collect();
        // The reference does not hit the box that leaves the first bounds.
        let expected = if physics == "refined" { 7 } else { 6 };
        assert_eq!(ids.len(), expected, "{physics}: {ids:?}");
    }
}

#[test]
fn notes_are_shown_and_end_no_run() {
    let dir = folder();
    everything(dir.path());
    let command = ["run", "survey.xml", "--physics", "refined", "-o", "a.xyz", "--force"];
    let note = "note: the leaf angle table's values are taken for";
    let said = text(&succeed(dir.path(), &command).stderr);
    assert!(said.contains(note) && said.contains("leaves.txt"), "{said}");
    let info = text(&succeed(dir.path(), &["scene", "info", "scene.xml#s", "--json"]).stdout);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert!(info["notes"][0].as_str().unwrap().contains("leaf angle table"), "{info}");
    // What is no warning is no error with --strict.
    let said = text(&run(dir.path(), &[&command[..], &["--strict"]].concat()).stderr);
    assert!(!said.contains("error: the leaf angle table"), "{said}");
    assert!(succeed(dir.path(), &[&command[..], &["-q"]].concat()).stderr.is_empty());
}

#[test]
fn a_part_that_leaves_the_first_box_stays_visible_in_the_refined_physics() {
    let dir = folder();
    everything(dir.path());
    // The floor ends at 20 m, and the large box drives away from it.
    let farthest = |physics: &str| {
        let found = points(dir.path(), &["survey.xml", "--physics", physics]);
        let x = |line: &str| line.split(' ').next().unwrap().parse::<f64>().unwrap();
        std::str::from_utf8(&found).unwrap().lines().map(x).fold(f64::MIN, f64::max)
    };
    assert!(farthest("helios") < 20.1, "{}", farthest("helios"));
    assert!(farthest("refined") > 20.5, "{}", farthest("refined"));
}

#[test]
fn packed_voxels_and_instances_give_the_bytes_of_their_sources() {
    let dir = folder();
    everything(dir.path());
    let sources = points(dir.path(), &["survey.xml"]);
    succeed(dir.path(), &["scene", "pack", "survey.xml", "-o", "all.vlscene", "-q"]);
    assert!(points(dir.path(), &["survey.xml", "--scene", "all.vlscene"]) == sources);
    let dir = folder();
    let make = [
        "scene", "make", "forest", "-o", "f", "-n", "60k", "--models", "3", "--copies", "20", "--pulses",
        "5k", "-q",
    ];
    succeed(dir.path(), &make);
    let forest = points(dir.path(), &["f/survey.xml"]);
    succeed(dir.path(), &["scene", "pack", "f/survey.xml", "-o", "f.vlscene", "--instances", "always", "-q"]);
    assert!(points(dir.path(), &["f/survey.xml", "--scene", "f.vlscene"]) == forest);
}

#[test]
fn leaf_area_of_voxels_is_density_times_volume() {
    let vox = fs::read_to_string(fixture("voxels/crown.vox")).unwrap();
    let densities = vox.lines().skip(6).filter_map(|line| line.split(' ').nth(3)?.parse::<f64>().ok());
    let expected = densities.sum::<f64>() * 0.5f64.powi(3);
    let out =
        succeed(Path::new("."), &["scene", "info", fixture("voxels/scene.xml").to_str().unwrap(), "--json"]);
    let facts: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let area = |value: &serde_json::Value| value["leaf_area_m2"].as_f64();
    let parts: Vec<Option<f64>> = facts["parts"].as_array().unwrap().iter().map(area).collect();
    assert!(expected > 1.0 && parts[0].is_none(), "the terrain has no leaves: {parts:?}");
    let parts: Vec<f64> = parts[1..4].iter().map(|area| area.expect("an area")).collect();
    assert!(parts.iter().all(|found| (found / expected - 1.0).abs() < 1e-9), "{parts:?} {expected}");
    let of_material = facts["materials"].as_array().unwrap().iter().filter_map(area).sum::<f64>();
    assert!(
        (of_material / parts.iter().sum::<f64>() - 1.0).abs() < 1e-9
            && (area(&facts).unwrap() / of_material - 1.0).abs() < 1e-9
    );
}

#[test]
fn labels_have_a_table_of_what_they_mean() {
    let dir = folder();
    let make =
        ["scene", "make", "forest", "-n", "3k", "--extent", "30", "--separate-trees", "-o", "wood", "-q"];
    succeed(dir.path(), &make);
    let columns = ["--columns", "X,Y,Z,ObjectId,Part"];
    let outputs = ["-o", "a.csv", "--parts", "parts.csv", "-q"];
    succeed(dir.path(), &[&["run", "wood/survey.xml"], &outputs[..], &columns].concat());
    let table = fs::read_to_string(dir.path().join("parts.csv")).unwrap();
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("object,part,id,name,class,materials,areas,leaf_area,x,y,z,height,points"));
    let points = fs::read_to_string(dir.path().join("a.csv")).unwrap();
    let points: Vec<Vec<f64>> =
        points.lines().skip(1).map(|line| line.split(',').map(|w| w.parse().unwrap()).collect()).collect();
    let (mut trees, mut counted) = (0, 0);
    for line in lines {
        let row: Vec<&str> = line.split(',').collect();
        let number = |i: usize| row[i].parse::<f64>().unwrap();
        let own: Vec<&Vec<f64>> = points.iter().filter(|p| p[3] == number(0) && p[4] == number(1)).collect();
        assert_eq!(own.len() as f64, number(12), "{line}");
        counted += own.len();
        let (low, high) = (number(10), number(10) + number(11));
        assert!(own.iter().all(|p| (low - 0.2..high + 0.2).contains(&p[2])), "{line}");
        if ["spruce", "beech", "birch"].iter().any(|species| row[3].ends_with(species)) {
            trees += 1;
            let species = row[3].split('_').next_back().unwrap();
            assert!(row[5].contains(species) && number(11) > 3.0, "{line}");
            assert_eq!(row[5].split(' ').count(), row[6].split(' ').count(), "{line}");
            let area: f64 = row[6].split(' ').map(|area| area.parse::<f64>().unwrap()).sum();
            assert!(number(7) > 1.0 && number(7) < area, "leaves and bark: {line}");
            assert!(own.iter().all(|p| (p[0] - number(8)).hypot(p[1] - number(9)) < 10.0), "{line}");
        }
    }
    assert!(trees > 3 && counted == points.len(), "{trees} trees, {counted} of {}", points.len());
    let facts = succeed(dir.path(), &["scene", "info", "wood/scene.xml", "--json"]).stdout;
    let facts: serde_json::Value = serde_json::from_slice(&facts).unwrap();
    let parts = facts["parts"].as_array().unwrap();
    assert_eq!(parts.len(), table.lines().count() - 1);
    assert!(parts.iter().all(|part| part["height_m"].as_f64().unwrap() >= 0.0 && part["object"].is_i64()));
    // Runs that go on count all points; shards of a run do not have them.
    let resumed = ["run", "wood/survey.xml", "-o", "b.csv", "--parts", "b_parts.csv", "--resume=1k", "-q"];
    succeed(dir.path(), &resumed);
    assert_eq!(fs::read_to_string(dir.path().join("b_parts.csv")).unwrap(), table);
    let refused =
        run(dir.path(), &["run", "wood/survey.xml", "--shard", "0/2", "-o", "p", "--parts", "c.csv"]);
    assert!(!refused.status.success() && text(&refused.stderr).contains("--parts needs"));
}

/// A survey whose paths are written with backslashes, as on Windows, and the same with slashes.
#[test]
fn paths_with_backslashes_are_read_with_a_warning() {
    let dir = folder();
    fs::create_dir_all(dir.path().join("my data/parts")).unwrap();
    let at = |name: &str| format!("my data/{name}");
    write(
        dir.path(),
        &at("parts/ground.obj"),
        "mtllib ..\\kit.mtl\nusemtl soil\nv -9 -9 0\nv 9 -9 0\nv 9 9 0\nv -9 9 0\nf 1 2 3 4\n",
    );
    write(dir.path(), &at("parts/wall_1.obj"), "v 5 -9 0\nv 5 9 0\nv 5 0 3\nf 1 2 3\n");
    write(dir.path(), &at("kit.mtl"), "newmtl soil\nhelios_reflectance 0.3\n");
    let filter =
        |key: &str, path: &str| format!("<filter type=\"objloader\">{}</filter>", param("string", key, path));
    let scene = |folder: &str| {
        let parts = filter("filepath", &format!("{folder}ground.obj"))
            + "</part><part>"
            + &filter("efilepath", &format!("{folder}wall_.*\\.obj"));
        format!("<document><scene id=\"s\"><part>{parts}</part></scene></document>")
    };
    write(dir.path(), &at("back.xml"), scene("my data\\parts\\"));
    write(dir.path(), &at("slash.xml"), scene("my data/parts/"));
    let survey = |scene: &str, platform: &str, scanner: &str| {
        format!(
            "<document><survey name=\"s\" scene=\"{scene}#s\" platform=\"{platform}\" scanner=\"{scanner}\"><leg>\
             <platformSettings x=\"0\" y=\"0\" z=\"0\"/><scannerSettings active=\"true\" pulseFreq_hz=\"100000\" \
             scanAngle_deg=\"50\" scanFreq_hz=\"50\" headRotatePerSec_deg=\"60\" headRotateStart_deg=\"0\" \
             headRotateStop_deg=\"2\"/></leg></survey></document>"
        )
    };
    let (platform, scanner) = ("data/platforms.xml#tripod", "data/scanners_tls.xml#riegl_vz400");
    write(dir.path(), "slash_survey.xml", survey("my data/slash.xml", platform, scanner));
    let back = |name: &str| name.replace('/', "\\");
    write(dir.path(), "back_survey.xml", survey("my data\\back.xml", &back(platform), &back(scanner)));
    let expected = points(dir.path(), &["slash_survey.xml"]);
    assert!(points(dir.path(), &["back_survey.xml"]) == expected);
    let args = ["run", "back_survey.xml", "-o", "points.xyz", "--force"];
    let warnings = text(&succeed(dir.path(), &args).stderr);
    for name in [
        "my data/back.xml",
        "data/platforms.xml",
        "data/scanners_tls.xml",
        "my data/parts/ground.obj",
        "my data/parts/wall_",
    ] {
        assert!(warnings.contains(&format!("`{name}")), "{name}: {warnings}");
    }
    assert!(warnings.contains("write / between folders") && warnings.contains("../kit.mtl"), "{warnings}");
    assert_eq!(run(dir.path(), &[&args[..], &["--strict"]].concat()).status.code(), Some(2));
    // In a pipeline file, in both kinds of text.
    for path in ["'my data\\parts\\ground.obj'", "\"my data\\\\parts\\\\ground.obj\""] {
        write(dir.path(), "p.toml", format!("survey = 'slash_survey.xml'\nscene = {path}\n"));
        assert!(!points(dir.path(), &["p.toml"]).is_empty());
    }
    let refused = |content: String, expected: &str| {
        write(dir.path(), "wrong.toml", content);
        let found = run(dir.path(), &["run", "wrong.toml", "-o", "points.xyz", "--force"]);
        let said = text(&found.stderr);
        assert!(found.status.code() == Some(2) && said.contains(expected), "{:?}: {said}", found.status);
    };
    let with = |scene: &str| format!("survey = 'slash_survey.xml'\nscene = {scene}\n");
    refused(with("\"my data\\parts\\ground.obj\""), "a backslash begins");
    refused(with("\"C:\\Users\\ground.obj\""), "a backslash begins");
    refused(with("\"my data\\table.obj\""), "a backslash begins");
    refused(with("'my data/Parts/Ground.obj'"), "did you mean `my data/parts/ground.obj`?");
    refused(with("' my data/parts/ground.obj'"), "did you mean `my data/parts/ground.obj`?");
    refused(with("'my data/parts/ground .obj'"), "did you mean `my data/parts/ground.obj`?");
}
