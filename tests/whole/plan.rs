//! Plans keep what they promise: they are flown, and the points are counted.

use crate::common::{fixture, folder, run, succeed, text};
use std::fs;
use std::path::Path;

/// A flat square of 2 km around the origin, at height 20.
fn flat_ground(folder: &Path) {
    let corners = ["-1000 -1000", "1000 -1000", "1000 1000", "-1000 1000"].map(|c| format!("v {c} 20\n"));
    fs::write(folder.join("flat.obj"), corners.concat() + "f 1 2 3\nf 1 3 4\n").unwrap();
}

/// The positions of the first returns of a plan that is flown.
fn fly(folder: &Path, plan: &str) -> Vec<[f64; 3]> {
    let args = ["run", plan, "-o", "-", "--format", "xyz", "-q", "--physics", "refined"];
    let out = text(&succeed(folder, &args).stdout);
    let row = |line: &str| {
        let mut numbers = line.split(' ').map(|n| n.parse::<f64>().unwrap());
        [0; 3].map(|_| numbers.next().unwrap())
    };
    out.lines().map(row).collect()
}

/// The number in the comment of a plan after `mark`.
fn promised(plan: &str, mark: &str) -> f64 {
    let rest = plan.split(mark).nth(1).unwrap_or_else(|| panic!("no {mark} in {plan}"));
    rest.split_whitespace().next().unwrap().parse().unwrap()
}

#[test]
fn flights_have_the_density_that_was_asked_for() {
    let dir = folder();
    flat_ground(dir.path());
    // Polygon and oscillating mirror, cone, several channels; odd and even numbers of lines; overlap and gaps.
    for (scanner, density, rest) in [
        ("riegl_lms-q780", 2.0, vec!["--height", "150", "--scan-angle", "20"]),
        (
            "riegl_vux-1uav",
            6.0,
            vec!["--height", "60", "--scan-angle", "35", "--overlap", "55", "--heading", "30"],
        ),
        ("leica_als50-ii", 2.4, vec!["--height", "250", "--scan-angle", "25"]),
    ] {
        let density_text = density.to_string();
        let area = "POLYGON ((-150 -100, 150 -100, 150 100, -150 100))";
        let mut args =
            vec!["plan", "airborne", "--scanner", scanner, "--area", area, "--density", &density_text];
        args.extend(["--ground", "20", "--scene", "flat.obj", "-o", "plan.toml", "--force", "-q"]);
        args.extend(rest);
        succeed(dir.path(), &args);
        let plan = fs::read_to_string(dir.path().join("plan.toml")).unwrap();
        assert!((promised(&plan, "density    ") / density - 1.0).abs() < 1e-3, "{plan}");
        let points = fly(dir.path(), "plan.toml");
        let inside = points.iter().filter(|p| p[0].abs() < 150.0 && p[1].abs() < 100.0).count() as f64;
        let flown = inside / (300.0 * 200.0);
        assert!((flown / density - 1.0).abs() < 0.03, "{scanner}: {flown} for {density}\n{plan}");
        // The edges are covered as the middle is.
        let corner =
            points.iter().filter(|p| (110.0..150.0).contains(&p[0]) && (60.0..100.0).contains(&p[1])).count();
        let there = corner as f64 / 1600.0;
        assert!((there / density - 1.0).abs() < 0.35, "{scanner}: {there} in a corner for {density}");
    }
}

#[test]
fn lines_are_shifted_where_the_mount_tilts_the_scanner() {
    let dir = folder();
    flat_ground(dir.path());
    // The copter's mount tilts the scanner by 5° back, a quarter of this area at this height.
    let plan = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--scene", "flat.obj", "--height", "60"];
    let area = "POLYGON ((-10 -10, 10 -10, 10 10, -10 10))";
    let rest = ["--density", "20", "--overlap", "40", "--area", area, "-o", "plan.toml", "-q"];
    succeed(dir.path(), &[&plan[..], &rest[..]].concat());
    let points = fly(dir.path(), "plan.toml");
    let inside = points.iter().filter(|p| p[0].abs() < 10.0 && p[1].abs() < 10.0).count() as f64;
    assert!((inside / 400.0 / 20.0 - 1.0).abs() < 0.05, "{inside} of {}", points.len());
}

#[test]
fn lines_follow_the_ground() {
    let dir = folder();
    // A slope of 20 %.
    let slope = "v -500 -500 0\nv 500 -500 200\nv 500 500 200\nv -500 500 0\nf 1 2 3\nf 1 3 4\n";
    fs::write(dir.path().join("slope.obj"), slope).unwrap();
    let common = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--scene", "slope.obj"];
    let flight = [&common[..], &["--height", "80", "--speed", "10"]].concat();
    let area = "POLYGON ((-200 -60, 200 -60, 200 60, -200 60))";
    let following = ["--follow-terrain", "--climb", "15", "--area", area];
    let plan = text(&succeed(dir.path(), &[&flight[..], &following].concat()).stdout);
    let plan: toml::Table = plan.parse().unwrap();
    let legs = plan["leg"].as_array().unwrap();
    assert!(legs.len() >= 4, "{plan}");
    for leg in legs {
        let p: Vec<f64> = leg["position_m"]
            .as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_float().or(v.as_integer().map(|i| i as f64)).unwrap())
            .collect();
        let ground = 100.0 + 0.2 * p[0];
        assert!((p[2] - ground - 80.0).abs() < 1.0, "{p:?}");
    }
    let level = succeed(dir.path(), &flight);
    assert!(text(&level.stderr).contains("--follow-terrain"), "{}", text(&level.stderr));
    // Beside the scene.
    let area = "POLYGON ((1000 0, 1400 0, 1400 120, 1000 120))";
    let beside = succeed(dir.path(), &[&flight[..], &["--area", area, "--ground", "35"]].concat());
    assert!(text(&beside.stderr).contains("no ground in the area, which is taken as 35.0 m high"));
    assert!(text(&beside.stdout).contains(", 115]"), "{}", text(&beside.stdout));
}

#[test]
fn tripods_stand_where_planned_and_see() {
    let dir = folder();
    let scene = format!("{}#room", fixture("room/scene.xml").display());
    let args = [
        "plan",
        "terrestrial",
        "--scanner",
        "riegl_vz400",
        "--scene",
        &scene,
        "--around",
        "0,0",
        "--radius",
        "1",
    ];
    let rest = ["-n", "2", "--resolution", "0.5", "--pulse-rate", "50000", "-o", "stand.toml", "-q"];
    succeed(dir.path(), &[&args[..], &rest[..]].concat());
    let plan = fs::read_to_string(dir.path().join("stand.toml")).unwrap();
    let points = fly(dir.path(), "stand.toml").len() as f64;
    // 720 lines of 200 pulses (100° of the mirror) per position.
    assert!((points / 288_000.0 - 1.0).abs() < 0.08, "{points}\n{plan}");
    assert!(plan.contains("288.00 k in all"), "{plan}");
}

#[test]
fn drives_follow_their_line() {
    let dir = folder();
    let scene = format!("{}#street", fixture("street/scene.xml").display());
    for (scanner, mark) in [("riegl_vux-1ha22", "from line to line"), ("vlp16", "from turn to turn")] {
        let out = succeed(
            dir.path(),
            &[
                "plan",
                "mobile",
                "--scanner",
                scanner,
                "--along",
                "LINESTRING (1.5 -18, 1.5 8)",
                "--scene",
                &scene,
                "--speed",
                "13",
                "-o",
                "drive.toml",
                "--force",
            ],
        );
        assert!(text(&out.stderr).contains(mark), "{}", text(&out.stderr));
        let points = fly(dir.path(), "drive.toml");
        let (low, high) = points.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[1]), h.max(p[1])));
        assert!(
            points.len() > 20_000 && low < -15.0 && high > 5.0,
            "{scanner}: {} {low} {high}",
            points.len()
        );
    }
}

#[test]
fn mistakes_are_answered() {
    let dir = folder();
    let common = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--height", "80"];
    for (rest, expected) in [
        (vec!["--speed", "8"], "which area?"),
        (vec!["--area", "POLYGON ((0 0, 9 0, 9 9))"], "how fast?"),
        (vec!["--area", "nowhere.geojson", "--speed", "8"], "nowhere.geojson"),
        (vec!["--area", "POLYGON ((8.6 49.4, 8.7 49.4, 8.7 49.5))", "--speed", "8"], "degrees"),
        (vec!["--area", "POLYGON ((0 0, 9 0, 9 9))", "--speed", "8", "--platform", "glider"], "sr22"),
        (
            vec!["--area", "POLYGON ((0 0, 9 0, 9 9))", "--speed", "8", "--density", "5", "--overlap", "9"],
            "leave one out",
        ),
        (vec!["--area", "POLYGON ((0 0, 9e7 0, 9e7 9e7))", "--speed", "8"], "flight lines"),
        (vec!["--speed", "8", "--heading", "1e9"], "degrees from -360 to 360"),
        (vec!["--speed", "8", "--heading", "nan"], "degrees from -360 to 360"),
        (vec!["--speed", "8", "--ground", "1e300"], "expected metres"),
        (vec!["--speed", "8", "--scene", "s.obj", "--follow-terrain", "--climb", "90"], "from 0.01 to 89"),
    ] {
        let out = run(dir.path(), &[&common[..], &rest[..]].concat());
        let said = text(&out.stderr);
        assert!(
            said.contains(expected) && !out.status.success() && out.stdout.is_empty(),
            "{rest:?}: {said}"
        );
    }
    let tripods = ["plan", "terrestrial", "--scanner", "riegl_vz400", "--spacing", "5", "-n", "3"];
    let refused = run(dir.path(), &[&tripods[..], &["--area", "POLYGON ((0 0, 9 0, 9 9))"]].concat());
    assert!(text(&refused.stderr).contains("cannot be used with") && !refused.status.success());
    let far = ["plan", "airborne", "--scanner", "vlp16", "--height", "5000", "--speed", "50"];
    let far = [&far[..], &["--area", "POLYGON ((0 0, 9 0, 9 9))"]].concat();
    assert!(text(&succeed(dir.path(), &far).stderr).contains("farther than"));
}
