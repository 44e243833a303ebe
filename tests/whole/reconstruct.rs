//! Scenes from point clouds: a scene that is known is scanned, reconstructed from its points, and compared.

use crate::common::{folder, run, succeed, text};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// Leaf area density of the crown, m²/m³, and its voxels.
const DENSITY: f64 = 0.8;
const EDGE: f64 = 0.5;

/// A meadow with a house and a crown of 12 m by 12 m by 5 m of elements of 0.3 m, and an aircraft that flies
/// over them. Returns the leaf area, m².
fn write_scene(folder: &Path) -> f64 {
    let material = |name: &str, class: u32, more: &str| {
        format!("newmtl {name}\nKd 1 1 1\nhelios_reflectance 0.3\nhelios_classification {class}\n{more}")
    };
    let materials = [
        material("meadow", 2, "helios_isGround true\n"),
        material("roof", 6, ""),
        material("leaves", 5, "helios_reflectance 0.45\nvlscan_element_size_m 0.3\n"),
    ];
    fs::write(folder.join("site.mtl"), materials.concat()).unwrap();
    // A slope of 5 %, and a flat roof 6 m above its middle.
    let mut obj = "mtllib site.mtl\nv -40 -40 -2\nv 40 -40 2\nv 40 40 2\nv -40 40 -2\n".to_owned();
    obj += "v -20 -8 6\nv -8 -8 6\nv -8 4 6\nv -20 4 6\nv -20 -8 -2\nv -8 -8 -2\nv -8 4 -2\nv -20 4 -2\n";
    obj += "usemtl meadow\nf 1 2 3 4\nusemtl roof\nf 5 6 7 8\nf 5 9 10 6\nf 6 10 11 7\nf 7 11 12 8\nf 8 12 9 5\n";
    fs::write(folder.join("site.obj"), obj).unwrap();
    let mut voxels =
        "VOXEL SPACE\n#min_corner: 6 -6 4\n#max_corner: 18 6 9\n#split: 24 24 10\n#res: 0.5 #max_pad: 1\ni j k PadBVTotal\n"
            .to_owned();
    for n in 0..24 * 24 * 10 {
        let _ = writeln!(voxels, "{} {} {} {DENSITY}", n / 240, n / 10 % 24, n % 10);
    }
    fs::write(folder.join("crown.vox"), voxels).unwrap();
    let part = |filter: &str| format!("<part>{filter}</part>");
    let param = |key: &str, value: &str| format!("<param type=\"string\" key=\"{key}\" value=\"{value}\"/>");
    let scene = [
        part(&format!("<filter type=\"objloader\">{}</filter>", param("filepath", "site.obj"))),
        part(&format!(
            "<filter type=\"detailedvoxels\">{}{}{}</filter>",
            param("filepath", "crown.vox"),
            param("matfile", "site.mtl"),
            param("matname", "leaves")
        )),
    ];
    let scene =
        format!("<document paths=\"beside\"><scene id=\"site\">{}</scene></document>", scene.concat());
    fs::write(folder.join("site.xml"), scene).unwrap();
    let flight = "scene = \"site.xml\"\n\
        [platform]\nkind = \"linear_path\"\nmount = { rotate_deg = [{ x = -90 }, { z = 90 }] }\n\
        [scanner]\nid = \"known\"\noptics = \"rotating\"\npulse_freqs_hz = [100000]\nscan_angle_max_deg = 6\nscan_freq_min_hz = 1\n\
        scan_freq_max_hz = 500\nbeam_divergence_rad = 0.0005\npulse_fwhm_ns = 3\naccuracy_m = 0.02\nmax_returns = 5\n\
        pulse_energy_uj = 10\nmax_range = { range_m = 500, reflectance = 0.03 }\n\
        [settings]\npulse_freq_hz = 100000\nscan_freq_hz = 100\n\
        [waveform]\nquality = 4\n\
        [[leg]]\nposition_m = [-40, 0, 400]\nspeed_m_per_s = 20\n[[leg]]\nposition_m = [40, 0, 400]\nactive = false\n";
    fs::write(folder.join("flight.toml"), flight).unwrap();
    24.0 * 24.0 * 10.0 * EDGE.powi(3) * DENSITY
}

fn number(report: &serde_json::Value, path: &str) -> f64 {
    report
        .pointer(path)
        .and_then(serde_json::Value::as_f64)
        .unwrap_or_else(|| panic!("no {path} in {report}"))
}

/// Leaf area of the voxels of a file whose centres lie above a height, m².
fn leaf_area_above(path: &Path, height: f64) -> f64 {
    let file = fs::read_to_string(path).unwrap();
    let numbers =
        |line: &str| line.split_whitespace().filter_map(|w| w.parse::<f64>().ok()).collect::<Vec<f64>>();
    let header = |name: &str| numbers(file.lines().find(|l| l.starts_with(name)).unwrap());
    let (bottom, size) = (header("#min_corner")[2], header("#res")[0]);
    let voxels = file.lines().filter(|l| l.starts_with(|c: char| c.is_ascii_digit())).map(numbers);
    let above = voxels.filter(|v| bottom + (v[2] + 0.5) * size > height);
    above.map(|v| v[3]).sum::<f64>() * size.powi(3)
}

#[test]
fn a_known_scene_is_found_again() {
    let dir = folder();
    let dir = dir.path();
    let leaf_area = write_scene(dir);
    succeed(dir, &["run", "flight.toml", "-q", "-o", "first.laz", "--seed", "1"]);
    let said = succeed(dir, &["scene", "reconstruct", "first.laz", "-o", "found"]);
    assert!(text(&said.stderr).contains("pulses of several returns"), "{}", text(&said.stderr));
    let report: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(dir.join("found/report.json")).unwrap()).unwrap();
    let found = number(&report, "/foliage/leaf_area_m2");
    // Low parts of a dense crown come out too thin: returns count as equal shares of the beam, and several
    // elements that are met close to each other are one return.
    assert!((0.65..1.15).contains(&(found / leaf_area)), "{found} m² of leaves, not {leaf_area}");
    let upper = leaf_area_above(&dir.join("found/foliage_5.vox"), 6.5);
    assert!(
        (upper / (0.5 * leaf_area) - 1.0).abs() < 0.15,
        "{upper} m² of leaves in the upper half of {leaf_area}"
    );
    let roof = number(&report, "/roofs/area_m2");
    assert!((roof / 144.0 - 1.0).abs() < 0.12, "{roof} m² of roofs, not 144");
    let spread = number(&report, "/terrain/spread_m");
    assert!((spread / 0.02 - 1.0).abs() < 0.2, "{spread} m of range noise, not 0.02");
    // Lines are named as in the cloud.
    let lines: Vec<&serde_json::Value> =
        report["lines"].as_array().unwrap().iter().map(|line| &line["line"]).collect();
    assert_eq!(lines[0], 1, "{lines:?}");
    assert!(text(&said.stderr).contains("line 1: instrument found by"), "{}", text(&said.stderr));
    for line in report["lines"].as_array().unwrap() {
        let height = number(line, "/position_m/2");
        assert!((height - 400.0).abs() < 10.0, "the instrument was 400 m high: {line}");
    }
    // Pulses of the same flight through the scene that was found have the same returns, nearly.
    // Every third pulse: the lines have 1000, so that those of all angles are among them.
    let pulses = text(&succeed(dir, &["pulses", "flight.toml", "-q"]).stdout);
    let (head, rows) = pulses.split_once('\n').unwrap();
    let rows: String = rows.lines().step_by(3).map(|row| format!("{row}\n")).collect();
    fs::write(dir.join("pulses.csv"), format!("{head}\n{rows}")).unwrap();
    let shares = |args: &[&str]| {
        succeed(dir, args);
        let rows = fs::read_to_string(dir.join(args[args.len() - 1])).unwrap();
        let rows: Vec<Vec<f64>> =
            rows.lines().skip(1).map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect();
        let firsts: Vec<&Vec<f64>> = rows.iter().filter(|r| r[2] == 1.0).collect();
        let single = firsts.iter().filter(|r| r[3] == 1.0).count() as f64 / firsts.len() as f64;
        let leaves = rows.iter().filter(|r| r[1] == 5.0).count() as f64 / rows.len() as f64;
        let ground = rows.iter().filter(|r| r[1] == 2.0).count() as f64 / rows.len() as f64;
        [single, leaves, ground]
    };
    let columns = ["--columns", "Z,Classification,ReturnNumber,NumberOfReturns", "-q", "-o"];
    let known = shares(
        &[&["trace", "--scanner", "flight.toml", "pulses.csv"], &columns[..], &["known.csv"]].concat(),
    );
    let again = shares(
        &[&["trace", "--scanner", "found/scene.toml", "pulses.csv"], &columns[..], &["again.csv"]].concat(),
    );
    for (known, again) in known.iter().zip(again) {
        assert!(
            (known - again).abs() < 0.01,
            "shares of single returns, leaves, ground: {known} and {again}"
        );
    }
    // Nothing is replaced without --force, and the same cloud gives the same bytes.
    let refused = run(dir, &["scene", "reconstruct", "first.laz", "-o", "found"]);
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused.stderr));
    let before = fs::read(dir.join("found/foliage_5.vox")).unwrap();
    // Files of an earlier scene do not stay.
    fs::write(dir.join("found/foliage_99.vox"), "old").unwrap();
    let said = succeed(dir, &["scene", "reconstruct", "first.laz", "-o", "found", "--force", "-v"]);
    assert!(!dir.join("found/foliage_99.vox").exists());
    let said = text(&said.stderr);
    for stage in [
        "pulses in 1 flight line in ",
        "paths of 1 flight line in",
        "terrain of",
        "densities of foliage",
        "receiver from",
    ] {
        assert!(said.contains(stage), "{stage}: {said}");
    }
    assert!(fs::read(dir.join("found/foliage_5.vox")).unwrap() == before);
}

#[test]
fn clouds_without_ground_are_refused_with_what_to_do() {
    let dir = folder();
    let dir = dir.path();
    fs::write(dir.join("plain.csv"), "x,y,z,class\n0,0,0,1\n1,0,0,1\n0,1,0,1\n").unwrap();
    let found = run(dir, &["scene", "reconstruct", "plain.csv", "-o", "found"]);
    assert_eq!(found.status.code(), Some(2));
    assert!(text(&found.stderr).contains("class 2 (ground)") && text(&found.stderr).contains("smrf"));
    // Three points of ground and nothing else are a scene, with warnings about what is missing.
    // Of the ground, a point far from all others does not count.
    let plants: String = (0..60).map(|i| format!("{},{},3,5\n", i % 8, i / 8)).collect();
    let ground = "0,0,0,2\n7,0,0,2\n4,4,-900,2\n";
    fs::write(dir.join("stray.csv"), format!("x,y,z,class\n{plants}{ground}")).unwrap();
    let found = run(dir, &["scene", "reconstruct", "stray.csv", "-o", "found"]);
    assert!(text(&found.stderr).contains("has 2 points of class 2"), "{}", text(&found.stderr));
    fs::write(dir.join("bare.csv"), "x,y,z,class\n0,0,0,2\n10,0,0,2\n0,10,0,2\n").unwrap();
    let found = succeed(dir, &["scene", "reconstruct", "bare.csv", "-o", "bare"]);
    assert!(text(&found.stderr).contains("no times of pulses"), "{}", text(&found.stderr));
    succeed(dir, &["scene", "info", "bare/scene.xml"]);
    let strict = run(dir, &["--strict", "scene", "reconstruct", "bare.csv", "-o", "strict"]);
    assert_eq!(strict.status.code(), Some(2));
}
