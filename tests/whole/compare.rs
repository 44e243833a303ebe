//! `vlscan compare` on runs of the fixtures, in several formats.

use crate::common::{fixture, folder, raster_of, recording, run, succeed, text};
use std::fs;
use std::path::Path;

#[test]
fn points_in_temporary_files_do_not_change_results() {
    let dir = folder();
    // More points than are in memory under any limit.
    let cloud = |lift: f64| -> String {
        let line = |i: u32| {
            let (x, y) = (i % 250, i / 250);
            format!("{x}.5 {y} {:.3}\n", lift + 0.01 * f64::from(x * 7 % 11))
        };
        (0..70_000).map(line).collect()
    };
    fs::write(dir.path().join("a.xyz"), cloud(0.0)).unwrap();
    fs::write(dir.path().join("b.xyz"), cloud(0.05)).unwrap();
    let compared = |more: &[&str]| {
        succeed(dir.path(), &[&["compare", "a.xyz", "b.xyz", "--json"][..], more].concat()).stdout
    };
    assert!(compared(&[]) == compared(&["--max-memory", "1K"]));
    let drawn = |name: &str, more: &[&str]| {
        succeed(dir.path(), &[&["preview", "a.xyz", "-o", name, "-q"][..], more].concat());
        fs::read(dir.path().join(name)).unwrap()
    };
    for format in ["png", "html"] {
        let whole = drawn(&format!("a.{format}"), &[]);
        assert!(whole == drawn(&format!("b.{format}"), &["--max-memory", "1K"]), "{format}");
    }
}

#[test]
fn runs_are_compared_in_every_format() {
    let dir = folder();
    let survey = fixture("forest/survey.xml");
    let survey = survey.to_str().unwrap();
    succeed(
        dir.path(),
        &["run", survey, "-o", "a.laz", "-o", "a.parquet", "-o", "a.ply", "-o", "a.xyz", "--seed", "1", "-q"],
    );
    succeed(dir.path(), &["run", survey, "-o", "b.las", "--seed", "2", "-q"]);
    let json = |first: &str, second: &str| -> serde_json::Value {
        let out = succeed(dir.path(), &["compare", first, second, "--json"]);
        serde_json::from_slice(&out.stdout).unwrap()
    };
    for other in ["a.parquet", "a.ply", "a.xyz"] {
        let same = json("a.laz", other);
        assert!(same["voxels"]["agreement"].as_f64().unwrap() > 0.99, "{other}: {same}");
        assert!(same["first_to_second"]["percentile_95_m"].as_f64().unwrap() < 0.002, "{other}: {same}");
        assert_eq!(same["first"]["points"], same["second"]["points"], "{other}");
    }
    // Other noise, the same forest.
    let out = succeed(dir.path(), &["compare", "a.laz", "b.las", "--json", "--chance"]);
    let other: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let number = |path: &str| other.pointer(path).and_then(serde_json::Value::as_f64).unwrap_or(f64::NAN);
    let distance = number("/first_to_second/median_m");
    assert!(distance > 0.001 && distance < 0.2, "{other}");
    assert!(number("/canopy/correlation") > 0.9 && number("/chance/splits") == 39.0, "{other}");
    assert!(
        (number("/second/density_per_m2") / number("/first/density_per_m2") - 1.0).abs() < 0.02,
        "{other}"
    );
    let quantities = other["quantities"].as_array().unwrap();
    let quantity =
        |name: &str| quantities.iter().find(|q| q["name"] == name).unwrap_or_else(|| panic!("{name}"));
    assert!(quantity("height")["histogram"]["overlap"].as_f64().unwrap() > 0.97);
    assert_eq!(quantity("returns per pulse")["figures"][0]["is_within_chance"], true, "{other}");
    let args = ["compare", "a.laz", "b.las", "--page", "c.html", "--chance"];
    let table = text(&succeed(dir.path(), &args).stdout);
    for name in [
        "density",
        "95 %, m",
        "canopy height",
        "intensity",
        "share of 1",
        "distance",
        "voxels",
        "fill, m³",
        "below the level of detection, m³",
        "chance:",
    ] {
        assert!(table.contains(name), "{name}: {table}");
    }
    assert!(table.lines().all(|line| line.chars().count() <= 120 || line.starts_with("missing")), "{table}");
    let page = fs::read_to_string(dir.path().join("c.html")).unwrap();
    assert!(page.contains("<title>a.laz and b.las, compared</title>"));
    assert!(page.matches("data:image/png;base64,").count() == 3 && page.contains("<svg"));
    assert!(
        !page.contains("http://") && !page.contains("https://") && !page.contains("<script"),
        "loads something"
    );
    // It begins with its results.
    let parts = ["<h2>Results</h2>", "<td>fill</td>", "data:image/png", "<h2>Contents</h2>", "<svg"];
    let places = parts.map(|part| page.find(part).unwrap_or_else(|| panic!("no {part} in {page}")));
    assert!(places.is_sorted(), "{places:?}");
    let again = run(dir.path(), &args);
    assert!(!again.status.success() && text(&again.stderr).contains("--force"));
}

/// A mesh of ground of 60 by 60 m in steps of 0.25 m, with a cone 3 m high and a conical pit 3 m deep of a
/// radius of 10 m.
fn mesh(is_changed: bool) -> String {
    const SIDE: usize = 241;
    let mut obj = String::from("mtllib ground.mtl\nusemtl ground\n");
    for (row, column) in (0..SIDE).flat_map(|row| (0..SIDE).map(move |column| (row, column))) {
        let (x, y) = (0.25 * column as f64 - 30.0, 0.25 * row as f64 - 30.0);
        let cone = |cx: f64, cy: f64| (3.0 - 0.3 * (x - cx).hypot(y - cy)).max(0.0);
        let z = if is_changed { cone(-12.0, -12.0) - cone(12.0, 10.0) } else { 0.0 };
        obj += &format!("v {x} {y} {z}\n");
    }
    for (row, column) in (0..SIDE - 1).flat_map(|row| (0..SIDE - 1).map(move |column| (row, column))) {
        let a = row * SIDE + column + 1;
        let (b, c, d) = (a + 1, a + SIDE, a + SIDE + 1);
        obj += &format!("f {a} {b} {d}\nf {a} {d} {c}\n");
    }
    obj
}

#[test]
fn a_dam_and_a_pit_of_two_epochs_are_told_apart() {
    let dir = folder();
    fs::write(
        dir.path().join("ground.mtl"),
        "newmtl ground\nhelios_classification 2\nhelios_isGround true\n",
    )
    .unwrap();
    let area = "POLYGON ((-30 -30, 30 -30, 30 30, -30 30))";
    for (name, is_changed) in [("before", false), ("after", true)] {
        fs::write(dir.path().join(format!("{name}.obj")), mesh(is_changed)).unwrap();
        let (scene, plan, points) = (format!("{name}.obj"), format!("{name}.toml"), format!("{name}.laz"));
        let flight = ["--scanner", "riegl_vux-1uav", "--height", "60", "--density", "10"];
        let plan_args = ["plan", "airborne", "--scene", &scene, "--area", area, "--out", &plan];
        succeed(dir.path(), &[&plan_args[..], &flight[..]].concat());
        succeed(dir.path(), &["run", &plan, "-o", &points, "-q"]);
    }
    let args =
        ["compare", "before.laz", "after.laz", "--json", "--change", "d.tif", "--changed", "c.laz", "-q"];
    let out = succeed(dir.path(), &args);
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    // π r² h / 3.
    let cone = std::f64::consts::PI * 100.0;
    for part in ["fill", "cut"] {
        let volume = found["change"][part]["volume_m3"].as_f64().unwrap();
        assert!((volume / cone - 1.0).abs() < 0.02, "{part}: {}", found["change"]);
    }
    assert!(fs::read(dir.path().join("d.tif")).unwrap().starts_with(b"II*\0"));
    let changed = succeed(dir.path(), &["compare", "c.laz", "after.laz", "--json", "-q"]);
    let changed: serde_json::Value = serde_json::from_slice(&changed.stdout).unwrap();
    assert!(changed["first"]["points"].as_u64().unwrap() > 1000, "{}", changed["first"]);
    let refused = run(dir.path(), &args);
    assert!(
        refused.status.code() == Some(2) && text(&refused.stderr).contains("d.tif"),
        "{}",
        text(&refused.stderr)
    );
    let refused = run(dir.path(), &["compare", "before.laz", "after.laz", "--changed", "c.nothing"]);
    assert!(text(&refused.stderr).contains("--changed c.nothing"), "{}", text(&refused.stderr));
    // The terrain is what was scanned: the noise of the ranges is all that remains.
    let out = succeed(
        dir.path(),
        &["compare", "before.laz", "after.laz", "--json", "--terrain", "after.obj", "-q"],
    );
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let quantities = found["quantities"].as_array().unwrap();
    let residual = quantities.iter().find(|q| q["name"] == "residual to the terrain").unwrap();
    let median = residual["figures"][1]["second"].as_f64().unwrap();
    assert!(median.abs() < 5.0, "{residual}");
    fs::write(dir.path().join("far.obj"), "v 900 900 0\nv 990 900 0\nv 900 990 0\nf 1 2 3\n").unwrap();
    let far = succeed(dir.path(), &["compare", "before.laz", "after.laz", "--terrain", "far.obj"]);
    assert!(text(&far.stderr).contains("no point lies above this --terrain"), "{}", text(&far.stderr));
    let refused = run(dir.path(), &["compare", "before.laz", "after.laz", "--terrain", "none.xyz"]);
    assert!(
        text(&refused.stderr).contains("--terrain none.xyz: expected a raster"),
        "{}",
        text(&refused.stderr)
    );
}

/// The change that `vlscan compare` finds: volumes and uncertainties of fill, cut and net, and whether the
/// clocks are one.
fn change_of(dir: &Path, first: &str, second: &str) -> ([[f64; 2]; 3], bool) {
    let out = succeed(dir, &["compare", first, second, "--json", "-q"]);
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let change = &found["change"];
    let number = |value: &serde_json::Value| value.as_f64().unwrap_or_else(|| panic!("{change}"));
    let of = |part: &str| ["volume_m3", "uncertainty_m3"].map(|key| number(&change[part][key]));
    let net = ["net_m3", "net_uncertainty_m3"].map(|key| number(&change[key]));
    let quantities = found["quantities"].as_array().unwrap();
    let has_one_clock = quantities.iter().any(|q| q["name"] == "scan angle at the same time");
    ([of("fill"), of("cut"), net], has_one_clock)
}

#[test]
fn ground_that_did_not_change_has_volumes_within_their_uncertainties() {
    let dir = folder();
    let wave = |i: usize| {
        let (x, y) = ((i % 80) as f64, (i / 80) as f64);
        (200.0 + 3.0 * (x / 15.0).sin() * (y / 18.0).cos()) as f32
    };
    let heights: Vec<f32> = (0..6400).map(wave).collect();
    let dem = raster_of(80, &heights, [475_000.0, 5_429_080.0], 1.0, Some(25832));
    fs::write(dir.path().join("d.tif"), dem).unwrap();
    let fly =
        ["plan", "airborne", "--scanner", "riegl_vux-1uav22", "--scene", "d.tif", "--height", "60", "-q"];
    let rates = ["--density", "12", "--pulse-rate", "400000", "-o", "a.toml"];
    succeed(dir.path(), &[&fly[..], &rates].concat());
    let stand = ["plan", "terrestrial", "--scanner", "riegl_vz400", "--scene", "d.tif", "-q", "-o", "t.toml"];
    let places = ["--around", "475040,5429040", "--radius", "15", "-n", "2", "--resolution", "0.28"];
    succeed(dir.path(), &[&stand[..], &places].concat());
    let run_as = |plan: &str, points: &str, options: &[&str]| {
        succeed(dir.path(), &[&["run", plan, "-o", points, "-q"], options].concat());
    };
    run_as("a.toml", "a.laz", &[]);
    run_as("t.toml", "t.laz", &[]);
    let errors =
        ["--navigation-error", "position_m=0.02,0.02,0.05", "--navigation-error", "attitude_deg=0.01"];
    for seed in ["1", "2", "3"] {
        run_as("a.toml", &format!("n{seed}.laz"), &[&errors[..], &["--seed", seed]].concat());
    }
    let pairs = [("a.laz", "t.laz"), ("a.laz", "n1.laz"), ("n1.laz", "n2.laz"), ("n3.laz", "n1.laz")];
    for (first, second) in pairs {
        let (volumes, has_one_clock) = change_of(dir.path(), first, second);
        for [volume, uncertainty] in volumes {
            assert!(volume.abs() <= 2.0 * uncertainty, "{first} {second}: {volumes:?}");
        }
        // Sensors of centimetres on 6400 m².
        let most = if second == "t.laz" { 5.0 } else { 1500.0 };
        assert!(volumes.iter().all(|[_, uncertainty]| *uncertainty < most), "{first} {second}: {volumes:?}");
        // The tripods and the aircraft begin at the same default time.
        assert_eq!(has_one_clock, second != "t.laz", "{first} {second}");
    }
}

#[test]
fn a_dam_flown_with_errors_of_navigation_is_within_its_uncertainty() {
    let dir = folder();
    fs::write(
        dir.path().join("ground.mtl"),
        "newmtl ground\nhelios_classification 2\nhelios_isGround true\n",
    )
    .unwrap();
    let errors =
        ["--navigation-error", "position_m=0.02,0.02,0.05", "--navigation-error", "attitude_deg=0.01"];
    for (name, is_changed) in [("before", false), ("after", true)] {
        fs::write(dir.path().join(format!("{name}.obj")), mesh(is_changed)).unwrap();
        let (scene, plan) = (format!("{name}.obj"), format!("{name}.toml"));
        let flight = ["--scanner", "riegl_vux-1uav", "--height", "60", "--density", "10", "-q"];
        succeed(
            dir.path(),
            &[&["plan", "airborne", "--scene", &scene, "--out", &plan], &flight[..]].concat(),
        );
        for seed in ["1", "2"] {
            let points = format!("{name}{seed}.laz");
            let args = ["run", &plan, "-o", &points, "-q", "--seed", seed];
            succeed(dir.path(), &[&args[..], &errors].concat());
        }
    }
    // π r² h / 3.
    let cone = std::f64::consts::PI * 100.0;
    for (first, second) in [("before1.laz", "after2.laz"), ("before2.laz", "after1.laz")] {
        let ([fill, cut, net], _) = change_of(dir.path(), first, second);
        for ([volume, uncertainty], truth) in [(fill, cone), (cut, cone), (net, 0.0)] {
            assert!((volume - truth).abs() < 2.0 * uncertainty, "{first} {second}: {fill:?} {cut:?} {net:?}");
        }
        assert!(fill[1] < 0.5 * cone && cut[1] < 0.5 * cone, "{fill:?} {cut:?}");
    }
}

/// Writes the points of a recording in two files, whole pulses to one or the other by chance.
fn write_halves(recording: &Path, halves: [&Path; 2]) {
    let mut reader = las::Reader::from_path(recording).unwrap();
    let header = reader.header().clone();
    let mut writers = halves.map(|path| las::Writer::from_path(path, header.clone()).unwrap());
    for point in reader.read_all().unwrap().points() {
        let point = point.unwrap();
        // Points of one pulse have the same time.
        let bits = point.gps_time.unwrap().to_bits().wrapping_mul(0x9e37_79b9_7f4a_7c15);
        writers[(bits >> 63) as usize].write_point(point).unwrap();
    }
    writers.into_iter().for_each(|mut writer| writer.close().unwrap());
}

#[test]
fn halves_of_a_recording_are_within_chance_and_a_centimetre_is_not() {
    let Some(recording) = recording("airborne/flight_line.laz") else { return };
    let dir = folder();
    let halves = ["a.laz", "b.laz"].map(|name| dir.path().join(name));
    write_halves(&recording, [&halves[0], &halves[1]]);
    let compare = |first: &str, second: &str| -> serde_json::Value {
        let out = succeed(dir.path(), &["compare", first, second, "--chance", "--json", "-q"]);
        serde_json::from_slice(&out.stdout).unwrap()
    };
    let found = compare("a.laz", "b.laz");
    let beyond = |found: &serde_json::Value| -> Vec<String> {
        let mut beyond = Vec::new();
        for quantity in found["quantities"].as_array().unwrap() {
            for figure in quantity["figures"].as_array().unwrap() {
                if figure["is_within_chance"] == false {
                    beyond.push(format!("{}: {figure}", quantity["name"]));
                }
            }
        }
        beyond
    };
    // One of forty is beyond its bound by chance, and a hundred figures are not independent.
    assert!(beyond(&found).len() <= 6, "{:#?}", beyond(&found));
    let quantity = |found: &serde_json::Value, name: &str| {
        found["quantities"].as_array().unwrap().iter().find(|q| q["name"] == name).unwrap().clone()
    };
    let rate = &quantity(&found, "time between scan lines")["figures"][0];
    assert!((rate["first"].as_f64().unwrap() - 149.9986).abs() < 0.01, "{rate}");
    // The same half a centimetre higher.
    let mut reader = las::Reader::from_path(&halves[1]).unwrap();
    let mut raised = las::Writer::from_path(dir.path().join("c.laz"), reader.header().clone()).unwrap();
    for point in reader.read_all().unwrap().points() {
        let point = point.unwrap();
        raised.write_point(las::Point { z: point.z + 0.01, ..point }).unwrap();
    }
    raised.close().unwrap();
    let residual = quantity(&compare("a.laz", "c.laz"), "residual to the terrain");
    let mean = &residual["figures"][0];
    assert!((mean["difference"].as_f64().unwrap() - 10.0).abs() < 1.5, "{mean}");
    assert_eq!(mean["is_within_chance"], false, "{mean}");
}

#[test]
fn clouds_of_different_places_are_refused() {
    let dir = folder();
    fs::write(dir.path().join("a.xyz"), "0 0 0\n10 10 1\n").unwrap();
    fs::write(dir.path().join("b.xyz"), "500000 5400000 0\n500010 5400010 1\n").unwrap();
    let out = run(dir.path(), &["compare", "a.xyz", "b.xyz"]);
    assert!(
        out.status.code() == Some(2) && text(&out.stderr).contains("do not overlap"),
        "{}",
        text(&out.stderr)
    );
    fs::write(dir.path().join("c.xyz"), "5 5 0\n").unwrap();
    let out = run(dir.path(), &["compare", "c.xyz", "a.xyz"]);
    let expected = "a.xyz has no points in the box that both clouds share, x 5.000 to 5.000 m";
    assert!(text(&out.stderr).contains(expected), "{}", text(&out.stderr));
    let out = run(dir.path(), &["compare", "a.xyz", "none.xyz"]);
    assert!(!out.status.success() && text(&out.stderr).contains("none.xyz"));
}
