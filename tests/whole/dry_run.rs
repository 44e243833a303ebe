//! Dry runs estimate what runs then do, and write nothing.

use crate::common::{feed, files, fixture, folder, run, succeed, text};
use std::fs;
use std::path::Path;

fn forecast(folder: &Path, args: &[&str]) -> serde_json::Value {
    let args: Vec<&str> = [&["run"][..], args, &["--dry-run", "--json", "-q"]].concat();
    serde_json::from_slice(&succeed(folder, &args).stdout).unwrap()
}

#[test]
fn points_and_files_are_those_of_the_run() {
    for name in ["forest", "moving", "room", "street", "terrain"] {
        let dir = folder();
        let survey = fixture(&format!("{name}/survey.xml"));
        let survey = survey.to_str().unwrap();
        let found = forecast(dir.path(), &[survey, "-o", "points.laz"]);
        assert!(files(dir.path()).is_empty(), "{name}: a dry run has written {:?}", files(dir.path()));
        succeed(dir.path(), &["run", survey, "-o", "points.laz", "--parts", "parts.csv", "-q"]);
        let table = fs::read_to_string(dir.path().join("parts.csv")).unwrap();
        let points: f64 =
            table.lines().skip(1).map(|row| row.rsplit(',').next().unwrap().parse::<f64>().unwrap()).sum();
        let number = |path: &str| found.pointer(path).unwrap().as_f64().unwrap();
        assert!((number("/points/value") / points - 1.0).abs() < 0.1, "{name}: {found} for {points}");
        let bytes = fs::metadata(dir.path().join("points.laz")).unwrap().len() as f64;
        assert!((number("/files/0/bytes") / bytes - 1.0).abs() < 0.15, "{name}: {found} for {bytes}");
        assert!(number("/points_per_m2") > 0.0 && number("/memory_bytes") > 1e6, "{found}");
        let leg = &found["legs"][0];
        assert!(
            leg["footprint_m"].as_f64().unwrap() > 0.0 && leg["across_m"].as_f64().unwrap() > 0.0,
            "{found}"
        );
    }
}

#[test]
fn files_that_exist_are_noted_and_stay() {
    let dir = folder();
    let survey = fixture("room/survey.xml");
    let args = ["run", survey.to_str().unwrap(), "-o", "a.laz", "-o", "a.csv", "--parts", "p.csv"];
    for name in ["a.laz", "p.csv"] {
        fs::write(dir.path().join(name), "mine").unwrap();
    }
    let out = succeed(dir.path(), &[&args[..], &["--dry-run"]].concat());
    assert!(
        text(&out.stdout).contains("a.laz") && text(&out.stdout).contains("pulses"),
        "{}",
        text(&out.stdout)
    );
    let said = text(&out.stderr);
    for name in ["a.laz", "p.csv"] {
        assert!(said.contains(&format!("{name} exists already; overwrite it with --force")), "{said}");
        assert_eq!(fs::read(dir.path().join(name)).unwrap(), b"mine");
    }
    assert!(!said.contains("a.csv") && files(dir.path()).len() == 2, "{said}");
    assert_eq!(run(dir.path(), &args).status.code(), Some(2));
}

#[test]
fn forecasts_and_previews_are_the_same_for_any_number_of_threads() {
    let dir = folder();
    // The second is a flight on which parts of the scene move, the third is not counted.
    flat(dir.path());
    let area = "POLYGON ((-300 -300, 300 -300, 300 300, -300 300))";
    let plan = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--platform", "quadcopter"];
    let size = ["--scene", "flat.obj", "--area", area, "--height", "80", "--density", "30", "-q"];
    succeed(dir.path(), &[&plan[..], &size, &["-o", "plan.toml"]].concat());
    for survey in [fixture("forest/survey.xml"), fixture("moving/survey.xml"), "plan.toml".into()] {
        let survey = survey.to_str().unwrap();
        let forecasts = ["1", "2", "2"].map(|threads| {
            let mut found =
                forecast(dir.path(), &[survey, "-o", "p.laz", "--seed", "3", "--threads", threads]);
            // What the machine needs.
            for key in ["time", "memory_bytes"] {
                assert!(found.as_object_mut().unwrap().remove(key).is_some(), "no {key} in {found}");
            }
            found
        });
        assert_eq!(forecasts[0], forecasts[1], "{survey}");
        assert_eq!(forecasts[1], forecasts[2], "{survey}");
        let pictures = ["a.png", "b.png"].map(|name| {
            let size = ["--width", "640", "--height", "480"];
            let args = [&["preview", survey, "-o", name, "--force", "-q"], &size[..]].concat();
            succeed(dir.path(), &args);
            fs::read(dir.path().join(name)).unwrap()
        });
        assert!(pictures[0] == pictures[1], "{survey}");
    }
}

/// A flat square of 4 km around the origin.
fn flat(folder: &Path) {
    let corners = ["-2000 -2000", "2000 -2000", "2000 2000", "-2000 2000"].map(|c| format!("v {c} 0\n"));
    fs::write(folder.join("flat.obj"), corners.concat() + "f 1 2 3\nf 1 3 4\n").unwrap();
}

#[test]
fn long_flights_are_estimated_as_planned() {
    let dir = folder();
    flat(dir.path());
    // A multicopter is not stepped to the end of its flight, straight flights are.
    for (scanner, platform, half, height, density, is_counted) in [
        ("riegl_lms-q780", "sr22", 1500, "400", "8", true),
        ("riegl_vux-1uav", "quadcopter", 300, "80", "30", false),
    ] {
        let area = format!("POLYGON ((-{half} -{half}, {half} -{half}, {half} {half}, -{half} {half}))");
        let plan = ["plan", "airborne", "--scanner", scanner, "--platform", platform, "--scene", "flat.obj"];
        let size = ["--area", &area, "--height", height, "--density", density, "--overlap", "20"];
        succeed(dir.path(), &[&plan[..], &size, &["-o", "plan.toml", "--force", "-q"]].concat());
        let found = forecast(dir.path(), &["plan.toml", "-o", "points.laz"]);
        assert!(is_counted || found["pulses_are_counted"] == false, "{found}");
        let plan = fs::read_to_string(dir.path().join("plan.toml")).unwrap();
        let promised = |mark: &str| -> f64 {
            let rest = plan.split(mark).nth(1).unwrap_or_else(|| panic!("no {mark} in {plan}"));
            rest.split_whitespace().next().unwrap().parse().unwrap()
        };
        // Every pulse has one point, but for the scene's edges; swaths reach a little beyond the area.
        let density = found["pulses_per_m2"].as_f64().unwrap();
        assert!((density / promised("density    ") - 1.0).abs() < 0.1, "{density}\n{found}\n{plan}");
        let along = found["legs"][0]["along_m"].as_f64().unwrap();
        assert!((along / promised("spacing    v/f = ") - 1.0).abs() < 0.1, "{along}\n{plan}");
    }
}

#[test]
fn streams_are_read_to_their_end() {
    let dir = folder();
    let pipeline = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/als.toml");
    let poses = fs::read(fixture("flight.csv")).unwrap();
    let pipeline = pipeline.to_str().unwrap();
    let found = feed(dir.path(), &["run", pipeline, "--dry-run", "--json", "-q"], &poses);
    assert!(found.status.success(), "{}", text(&found.stderr));
    let found: serde_json::Value = serde_json::from_slice(&found.stdout).unwrap();
    let points = feed(dir.path(), &["run", pipeline, "-q"], &poses).stdout;
    let count = points.iter().filter(|byte| **byte == b'\n').count() as f64;
    let estimated = found["points"]["value"].as_f64().unwrap();
    assert!((estimated / count - 1.0).abs() < 0.1, "{estimated} for {count}");
}

#[test]
fn the_spelling_of_helios_3_is_understood_and_mistakes_are_reported_before() {
    let dir = folder();
    let survey = fixture("room/survey.xml");
    let survey = survey.to_str().unwrap();
    let found = text(&succeed(dir.path(), &[survey, "--dryrun"]).stdout);
    for name in ["legs", "pulses", "points", "density", "memory", "time", "writes", "misses"] {
        assert!(found.lines().any(|line| line.starts_with(name)), "no {name} in\n{found}");
    }
    fs::write(dir.path().join("points.las"), "").unwrap();
    let noted = succeed(dir.path(), &["run", survey, "--dry-run", "-o", "points.las"]);
    assert!(text(&noted.stderr).contains("exists already"), "{}", text(&noted.stderr));
}
