//! Plans keep what they promise: they are flown, and the points are counted.

use crate::common::{self, fixture, folder, judge, run, succeed, text, vlscan};
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;

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
    // Polygon and oscillating mirror, cone, several channels; odd and even numbers of lines; overlap and
    // gaps.
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
    let small = "POLYGON ((-100 -60, 100 -60, 100 60, -100 60))";
    let level = succeed(dir.path(), &[&flight[..], &["--area", small]].concat());
    assert!(text(&level.stderr).contains("--follow-terrain"), "{}", text(&level.stderr));
    // A level flight over the whole slope would end below the ground.
    let refused = refused(dir.path(), &flight);
    assert!(refused.contains("the ground is -") && refused.contains("--follow-terrain"), "{refused}");
    // Beside the scene there is nothing to measure.
    let area = "POLYGON ((1000 0, 1400 0, 1400 120, 1000 120))";
    let beside = self::refused(dir.path(), &[&flight[..], &["--area", area, "--ground", "35"]].concat());
    let bounds = "the area, x 1000 to 1400 m, y 0 to 120 m, lies outside of the scene, x -500 to 500 m, y -500 to 500 m";
    assert!(beside.contains(bounds) && !beside.contains("longitude"), "{beside}");
    // An area may be read as metres although it is in degrees.
    let area = "POLYGON ((8 49, 9.5 49, 9.5 50, 8 50))";
    fs::write(dir.path().join("far.obj"), slope.replace("500 ", "5000 ").replace('-', "4")).unwrap();
    let far = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--scene", "far.obj", "--height", "80"];
    let beside = self::refused(dir.path(), &[&far[..], &["--speed", "10", "--area", area]].concat());
    assert!(beside.contains("outside of the scene") && beside.contains("SRID=4326"), "{beside}");
    // Of a large area the sampled pulses miss a small scene.
    fs::write(dir.path().join("plot.obj"), "v 0 0 1\nv 3 0 1\nv 3 3 1\nf 1 2 3\n").unwrap();
    let around = "POLYGON ((-3000 -3000, 3000 -3000, 3000 3000, -3000 3000))";
    let plot = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--scene", "plot.obj", "--height", "80"];
    let larger = self::refused(dir.path(), &[&plot[..], &["--speed", "10", "--area", around]].concat());
    let bounds =
        "the area, x -3000 to 3000 m, y -3000 to 3000 m, is larger than the scene, x 0 to 3 m, y 0 to 3 m";
    assert!(larger.contains(bounds) && larger.contains("draw the area within the scene"), "{larger}");
}

/// Message of a command that is refused as invalid input and writes nothing.
fn refused(folder: &Path, args: &[&str]) -> String {
    let out = run(folder, args);
    let said = text(&out.stderr);
    assert!(out.status.code() == Some(2) && out.stdout.is_empty(), "{args:?}: {said}");
    said
}

/// Plans a flight over flat ground 20 m high, flies it, and compares density over the area, width of a strip
/// and overlap with what the plan promises. `false` if the plan is refused, with a reason.
///
/// # Errors
/// What is not as promised, with the plan.
fn is_flown_as_promised(folder: &Path, scanner: &str, height: f64) -> Result<bool, String> {
    let mut half = 0.6 * height;
    let Some(mut plan) = planned(folder, scanner, height, half, None)? else { return Ok(false) };
    // Of an area of few points across, those at its edge are a part of the density.
    let across = if plan.contains("W·f/N = ") { promised(&plan, "W·f/N = ") } else { 0.0 };
    if 2.0 * half < 60.0 * across {
        half = 30.0 * across;
        plan = planned(folder, scanner, height, half, None)?.ok_or("refused for a larger area alone")?;
    }
    // Flights of more pulses would take minutes.
    let millions =
        if plan.contains(" M leave the instrument") { promised(&plan, "pulses     ") } else { 0.0 };
    if millions > 2.0 {
        let rate = promised(&plan, "pulse_freq_hz = ") * 2.0 / millions;
        // At another rate other pulses are sampled, whose detected share may be below its limit.
        let Some(slower) = planned(folder, scanner, height, half, Some(rate as u32))? else {
            return Ok(false);
        };
        plan = slower;
    }
    if scanner.contains("ouster") {
        // Without the chance of its photons an echo is detected up to where every other one was, which is
        // where the strip ends.
        let certain = plan.replace("\n[settings]", "threshold_photons = 1000000\n\n[settings]");
        assert_ne!(certain, plan);
        fs::write(folder.join("plan.toml"), certain).unwrap();
    }
    let scene = "v -9000 -9000 20\nv 9000 -9000 20\nv 9000 9000 20\nv -9000 9000 20\nf 1 2 3\nf 1 3 4\n";
    fs::write(folder.join("wide.obj"), scene).unwrap();
    let flight = ["run", "plan.toml", "--scene", "wide.obj", "--physics", "refined", "-q"];
    let columns = ["--format", "csv", "--columns", "X,Y,PointSourceId,ReturnNumber", "-o", "-"];
    let (mut inside, mut strip, mut ends) = (0.0, None, [f64::INFINITY, f64::NEG_INFINITY]);
    for line in text(&succeed(folder, &[&flight[..], &columns].concat()).stdout).lines().skip(1) {
        let [x, y, leg, number] =
            <[f64; 4]>::try_from(line.split(',').map(|n| n.parse().unwrap()).collect::<Vec<f64>>()).unwrap();
        if number != 1.0 {
            continue;
        }
        inside += f64::from(u8::from(x.abs() < half && y.abs() < half));
        if *strip.get_or_insert(leg) == leg {
            ends = [ends[0].min(x), ends[1].max(x)];
        }
    }
    let density = inside / (4.0 * half * half);
    let width = ends[1] - ends[0];
    let overlap = 1.0 - promised(&plan, "at heading 0.0°, ") / width;
    let is_right = (density / promised(&plan, "density    ") - 1.0).abs() < 0.05
        && (width / promised(&plan, "W = ") - 1.0).abs() < 0.05
        && (overlap - promised(&plan, "1 − S/W = ") / 100.0).abs() < 0.05;
    match is_right {
        true => Ok(true),
        false => Err(format!("{scanner} at {height} m: {density}/m², {width} m, overlap {overlap}\n{plan}")),
    }
}

/// The plan of a flight over a square, unless the instrument cannot fly it.
///
/// # Errors
/// A refusal without its reason.
fn planned(
    folder: &Path,
    scanner: &str,
    height: f64,
    half: f64,
    rate: Option<u32>,
) -> Result<Option<String>, String> {
    let area = format!("POLYGON ((-{half} -{half}, {half} -{half}, {half} {half}, -{half} {half}))");
    let (height_text, speed) = (height.to_string(), (1.5 * height).min(700.0).to_string());
    let mut args =
        vec!["plan", "airborne", "--scanner", scanner, "--height", &height_text, "--speed", &speed];
    args.extend(["--area", &area, "--ground", "20", "--heading", "0", "-o", "plan.toml", "--force", "-q"]);
    let rate = rate.map(|rate| rate.to_string());
    args.extend(rate.iter().flat_map(|rate| ["--pulse-rate", rate.as_str()]));
    let out = run(folder, &args);
    if out.status.success() {
        return Ok(Some(fs::read_to_string(folder.join("plan.toml")).unwrap()));
    }
    let said = text(&out.stderr);
    let reasons = [
        "measures from",
        "measures up to",
        "farther away",
        "detect",
        "does not reach ground",
        "the speed would be",
    ];
    let is_reasoned = out.status.code() == Some(2) && reasons.iter().any(|reason| said.contains(reason));
    if is_reasoned { Ok(None) } else { Err(format!("{scanner} at {height} m: {said}")) }
}

/// Scanners of every kind: mirrors in two channels, with facets, oscillating, a cone, wedges, a spinning
/// head, one with a mirror.
#[test]
fn kinds_of_scanners_fly_what_is_promised() {
    let dir = folder();
    for (scanner, height) in [
        ("riegl_vux-1uav", 160.0),
        ("riegl_vq-1560ii", 300.0),
        ("riegl_vux-120", 60.0),
        ("riegl_vq-840-g", 90.0),
        ("livox_mid-40", 50.0),
        ("dji-zenmuse-l2-repetitive", 60.0),
        ("vlp16", 40.0),
        ("livox_mid-360", 20.0),
    ] {
        assert_eq!(is_flown_as_promised(dir.path(), scanner, height), Ok(true), "{scanner}");
    }
}

#[test]
#[ignore = "minutes; part of `.ci/run --long`"]
fn all_scanners_of_the_catalogue_fly_what_is_promised() {
    let dir = folder();
    let listed: serde_json::Value =
        serde_json::from_slice(&succeed(dir.path(), &["catalogue", "--json"]).stdout).unwrap();
    let (mut flown, mut wrong) = (Vec::new(), Vec::new());
    for scanner in listed["scanners"].as_array().unwrap() {
        let reference = scanner["reference"].as_str().unwrap();
        for height in [25.0, 120.0, 450.0] {
            match is_flown_as_promised(dir.path(), reference, height) {
                Ok(true) => flown.push(reference.to_owned()),
                Ok(false) => {}
                Err(what) => wrong.push(what),
            }
        }
    }
    assert!(wrong.is_empty(), "{} of them:\n{}", wrong.len(), wrong.join("\n"));
    flown.dedup();
    assert!(flown.len() > 40, "{flown:?}");
}

#[test]
fn an_id_of_both_files_of_the_catalogue_is_that_for_the_kind_of_plan() {
    let dir = folder();
    let flight = ["--area", "POLYGON ((-40 -40, 40 -40, 40 40, -40 40))", "--height", "50", "--speed", "10"];
    let drive = ["--along", "LINESTRING (0 0, 100 0)", "--speed", "20"];
    for (kind, rest, file) in
        [("airborne", &flight[..], "scanners_als"), ("mobile", &drive[..], "scanners_tls")]
    {
        let plan = ["plan", kind, "--scanner", "livox_mid-70", "-o", "p.toml", "--force", "-q"];
        succeed(dir.path(), &[&plan[..], rest].concat());
        let plan = fs::read_to_string(dir.path().join("p.toml")).unwrap();
        assert!(plan.contains(&format!("data/{file}.xml#livox_mid-70")), "{kind}: {plan}");
    }
    let several = refused(dir.path(), &["catalogue", "show", "livox_mid-70"]);
    assert!(several.contains("2 scanners of the catalogue have the id"), "{several}");
}

#[test]
fn what_an_instrument_cannot_do_is_refused() {
    let dir = folder();
    flat_ground(dir.path());
    let area = "POLYGON ((-40 -40, 40 -40, 40 40, -40 40))";
    let plan = |scanner: &str, rest: &[&str]| {
        let common = ["plan", "airborne", "--scanner", scanner, "--area", area, "--speed", "20"];
        refused(dir.path(), &[&common[..], rest].concat())
    };
    assert!(plan("riegl_vux-1uav", &["--height", "3000"]).contains("does not detect ground"));
    assert!(plan("riegl_vq_780i", &["--height", "100"]).contains("measures from 100 m"));
    assert!(plan("vlp16", &["--height", "101"]).contains("measures up to 100 m"));
    assert!(
        plan("ouster_os1-128", &["--height", "120"]).contains("does not detect ground that reflects 50 %")
    );
    assert!(plan("vlp16", &["--height", "30", "--scan-angle", "20"]).contains("cannot be narrowed"));
    let aside = plan("riegl_vux-1uav", &["--height", "80", "--platform", "sr22"]);
    assert!(aside.contains("leave out --platform"), "{aside}");
    assert!(plan("VUX-1UAV", &["--height", "80"]).contains("did you mean `riegl_vux-1uav`?"));
    let part =
        run(dir.path(), &["plan", "airborne", "--scanner", "vlp16", "--height", "30", "--overlap", "0.3"]);
    assert!(text(&part.stderr).contains("it is in percent: 30 for that part"), "{}", text(&part.stderr));
    let coarse = ["plan", "terrestrial", "--scanner", "riegl_vz400", "--around", "0,0", "--radius", "10"];
    let coarse = refused(dir.path(), &[&coarse[..], &["--resolution", "0.3"]].concat());
    assert!(coarse.contains("would draw 125 lines a second") && coarse.contains("to 0.288°"), "{coarse}");
    let missing = refused(dir.path(), &["catalogue", "nosuch"]);
    assert!(missing.contains("no entry of the catalogue has `nosuch`"), "{missing}");
}

/// A tripod in the middle of a closed box, with scanners whose lines come from a mirror and from channels.
#[test]
fn resolutions_are_those_of_the_points() {
    let dir = folder();
    let scene = "v -60 -60 -1.5\nv 60 -60 -1.5\nv 60 60 -1.5\nv -60 60 -1.5\nv -60 -60 60\nv 60 -60 60\nv 60 60 60\nv -60 60 60\n\
                 f 1 2 3 4\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\nf 5 6 7 8\n";
    fs::write(dir.path().join("box.obj"), scene).unwrap();
    for (scanner, resolution) in [("riegl_vz2000i", "0.6"), ("vlp16", "0.384"), ("hovermap", "0.3")] {
        let place = [
            "--around", "0,0", "--radius", "0.001", "-n", "1", "--ground", "-1.5", "-o", "t.toml", "--force",
            "-q",
        ];
        let plan = ["plan", "terrestrial", "--scanner", scanner, "--resolution", resolution];
        succeed(dir.path(), &[&plan[..], &place].concat());
        let plan = fs::read_to_string(dir.path().join("t.toml")).unwrap();
        let columns = ["--columns", "X,Y,Z,ReturnNumber,Device", "--format", "csv", "-o", "-", "-q"];
        let mut run = vlscan(dir.path())
            .args(["run", "t.toml", "--scene", "box.obj"])
            .args(columns)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        // Some turn their heads for minutes: the first points have the spacing of all.
        let lines = BufReader::new(run.stdout.take().unwrap()).lines().skip(1).take(100_000);
        let rows =
            lines.map(|line| line.unwrap().split(',').map(|n| n.parse().unwrap()).collect::<Vec<f64>>());
        let beams: Vec<[f64; 3]> = rows
            .filter(|row| row[3] == 1.0 && row[4] == 0.0)
            .map(|row| {
                let length = (row[0] * row[0] + row[1] * row[1] + row[2] * row[2]).sqrt();
                [row[0] / length, row[1] / length, row[2] / length]
            })
            .collect();
        assert!(run.wait().unwrap().success(), "{scanner}");
        let mut steps: Vec<f64> = beams
            .windows(2)
            .map(|b| (b[0][0] * b[1][0] + b[0][1] * b[1][1] + b[0][2] * b[1][2]).min(1.0).acos().to_degrees())
            .collect();
        steps.sort_by(f64::total_cmp);
        let asked: f64 = resolution.parse().unwrap();
        let found = steps[steps.len() / 2];
        assert!((found / asked - 1.0).abs() < 0.05, "{scanner}: {found} for {asked}\n{plan}");
    }
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
    assert!((promised(&plan, "k per position, ") / 288.0 - 1.0).abs() < 2e-3, "{plan}");
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
        (vec!["--speed", "8"], "give --area"),
        (vec!["--area", "POLYGON ((0 0, 9 0, 9 9))"], "give --speed"),
        (vec!["--area", "nowhere.geojson", "--speed", "8"], "nowhere.geojson"),
        (vec!["--area", "POLYGON ((8.6 49.4, 8.7 49.4, 8.7 49.5))", "--speed", "8"], "degrees"),
        (vec!["--area", "POLYGON ((0 0, 9 0, 9 9))", "--speed", "8", "--platform", "glider"], "sr22"),
        // A given pulse rate leaves nothing to choose.
        (
            "--area|POLYGON ((0 0, 9 0, 9 9))|--speed|8|--density|5|--overlap|9|--pulse-rate|100000"
                .split('|')
                .collect(),
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
}

#[test]
fn a_tripod_stands_at_the_places_that_are_given() {
    let dir = folder();
    let at = ["plan", "terrestrial", "--scanner", "riegl_vz400", "--at", "1,2", "--at=-3,4.5"];
    let plan = text(&succeed(dir.path(), &at).stdout);
    for place in ["position_m = [1, 2, 0]", "position_m = [-3, 4.5, 0]"] {
        assert_eq!(plan.matches(place).count(), 1, "{place}: {plan}");
    }
    for other in [["--spacing", "5"], ["--around", "0,0"], ["--area", "POLYGON ((0 0, 9 0, 9 9))"]] {
        let refused = run(dir.path(), &[&at[..], &other[..]].concat());
        assert!(text(&refused.stderr).contains("cannot be used with"), "{other:?}");
    }
}

/// A file `own.xml` with the scanner `own`: one beam of a mirror of 20° to either side, on a head of up to
/// ten turns a second, and `attributes`.
fn own_scanner(folder: &Path, attributes: &str) {
    let text = format!(
        "<document><scanner id=\"own\" name=\"Own\" optics=\"rotating\" pulseFreqs_Hz=\"100000\" scanAngleMax_deg=\"20\" \
         scanAngleEffectiveMax_deg=\"20\" headRotatePerSecMax_deg=\"3600\" {attributes}/></document>"
    );
    fs::write(folder.join("own.xml"), text).unwrap();
}

#[test]
fn scanners_without_limits_are_planned_and_contradictory_ones_refused() {
    let dir = folder();
    let square = "POLYGON ((-30 -30, 30 -30, 30 30, -30 30))";
    let flight = ["plan", "airborne", "--height", "50", "--speed", "5", "--area", square];
    let drive = ["plan", "mobile", "--along", "LINESTRING (0 0, 50 0)"];
    let positions = ["plan", "terrestrial", "--around", "0,0", "--radius", "5", "--resolution", "0.5"];
    for limits in ["", "scanFreqMin_Hz=\"100\"", "scanFreqMin_Hz=\"100\" scanFreqMax_Hz=\"3000\""] {
        own_scanner(dir.path(), &format!("rangeMax_m=\"200\" {limits}"));
        for plan in [&flight[..], &drive[..], &positions[..]] {
            let out = succeed(dir.path(), &[plan, &["--scanner", "own.xml#own"]].concat());
            let plan: toml::Table = text(&out.stdout).parse().unwrap();
            let value = &plan["settings"]["scan_freq_hz"];
            let lines = value.as_float().or(value.as_integer().map(|lines| lines as f64)).unwrap();
            assert!((100.0..=3100.0).contains(&lines), "{limits}: {plan}");
        }
    }
    own_scanner(dir.path(), "scanFreqMin_Hz=\"100\" scanFreqMax_Hz=\"10\"");
    for plan in [&flight[..], &drive[..], &positions[..]] {
        let said = refused(dir.path(), &[plan, &["--scanner", "own.xml#own"]].concat());
        assert!(said.contains("at least `scanFreqMin_Hz`, 100, or 0 for no limit"), "{said}");
    }
    // Without a range its swath has no end.
    own_scanner(dir.path(), "");
    let said = refused(dir.path(), &[&flight[..], &["--scanner", "own.xml#own"]].concat());
    assert!(said.contains("rangeMax_m"), "{said}");
}

#[test]
fn drives_and_positions_nearer_than_the_scanner_measures_are_refused() {
    let dir = folder();
    flat_ground(dir.path());
    own_scanner(dir.path(), "rangeMin_m=\"100\"");
    let drive = ["plan", "mobile", "--along", "LINESTRING (0 0, 100 0)", "--scanner"];
    let positions =
        ["plan", "terrestrial", "--around", "0,0", "--radius", "5", "--resolution", "0.5", "--scanner"];
    let over_scene = ["--scene", "flat.obj", "--ground", "20"];
    for (plan, scanner) in [(&drive[..], "riegl_vq_780i"), (&positions[..], "own.xml#own")] {
        for (rest, met) in [(&[][..], "flat ground"), (&over_scene[..], "the scene")] {
            let said = refused(dir.path(), &[plan, &[scanner], rest].concat());
            assert!(said.contains("measures from 100 m") && said.contains(met), "{scanner} {rest:?}: {said}");
        }
    }
    // Others measure what is around them.
    let finer =
        ["plan", "terrestrial", "--around", "0,0", "--radius", "5", "--resolution", "0.2", "--scanner"];
    for (plan, scanner) in
        [(&drive[..], "vlp16"), (&drive[..], "riegl_vux-1ha22"), (&finer[..], "riegl_vz400")]
    {
        let out = succeed(dir.path(), &[plan, &[scanner, "--strict"]].concat());
        assert_eq!(text(&out.stderr), "", "{scanner}");
    }
}

#[test]
fn files_are_read_and_warned_of_once() {
    let dir = folder();
    flat_ground(dir.path());
    own_scanner(dir.path(), "rangeMax_m=\"200\" colour=\"red\"");
    let square = "POLYGON ((-30 -30, 30 -30, 30 30, -30 30))";
    for plan in [
        &["plan", "airborne", "--height", "50", "--speed", "5", "--area", square][..],
        &["plan", "mobile", "--along", "LINESTRING (0 0, 50 0)", "--ground", "20"],
        &["plan", "terrestrial", "--around", "0,0", "--radius", "5", "--resolution", "0.5", "--ground", "20"],
    ] {
        let rest = ["--scanner", "own.xml#own", "--scene", "flat.obj", "-v"];
        let said = text(&succeed(dir.path(), &[plan, &rest].concat()).stderr);
        for once in ["unknown attribute `colour`", "has no reflectance", "\nscene: ", "\ntree: "] {
            assert_eq!(said.matches(once).count(), 1, "{once:?}: {said}");
        }
    }
}

#[test]
fn a_dash_is_stdout_for_a_file_and_refused_for_several() {
    let dir = folder();
    flat_ground(dir.path());
    let plan =
        ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--height", "50", "--speed", "5", "--area"];
    let rest = ["POLYGON ((-30 -30, 30 -30, 30 30, -30 30))", "--scene", "flat.obj", "-o", "-"];
    let out = succeed(dir.path(), &[&plan[..], &rest].concat());
    assert!(text(&out.stdout).contains("[[leg]]"), "{out:?}");
    fs::write(dir.path().join("cloud.xyz"), "0 0 0\n1 1 1\n").unwrap();
    let several = "stdout cannot hold";
    for (command, reason) in [
        (&["scene", "make", "room", "-o", "-"][..], several),
        (&["scene", "stand", "trees.csv", "--trees", ".", "-o", "-"], several),
        (&["scene", "reconstruct", "cloud.xyz", "-o", "-"], several),
        (&["scene", "map", "flat.obj", "-o", "-"], several),
        (&["frames", "points.mcap", "--layout", "kitti", "-o", "-"], several),
        (&["fit", "cloud.xyz", "-o", "-"], several),
        (&["compare", "cloud.xyz", "cloud.xyz", "--change", "-"], "stdout holds the report"),
        (&["compare", "cloud.xyz", "cloud.xyz", "--page", "/dev/stdout"], "stdout holds the report"),
        (&["catalogue", "show", "riegl_vux-1uav", "--picture", "-"], "stdout holds the report"),
        (&["scene", "pack", "flat.obj", "-o", "-"], "name a file"),
        (&["run", &common::forest(), "-o", "a.xyz", "--schedule-log", "-"], "name a file"),
    ] {
        let said = refused(dir.path(), command);
        assert!(said.contains(reason), "{command:?}: {said}");
    }
    assert!(!dir.path().join("-").exists());
}

/// Compares lines.geojson, lines.kml and lines.csv with the plan, by pyproj.
const LINES: &str = r#"
import csv, json, tomllib
import xml.etree.ElementTree as ET
import numpy as np
from pyproj import Transformer

plan = tomllib.load(open("plan.toml", "rb"))
assert plan["crs"] == "EPSG:25832"
legs = plan["leg"]
strips = {}
for leg, following in zip(legs, legs[1:]):
    if leg.get("active", True):
        strips.setdefault(leg["strip"], [leg["position_m"]]).append(following["position_m"])
to_wgs84 = Transformer.from_crs(25832, 4326, always_xy=True)
features = json.load(open("lines.geojson"))["features"]
assert [f["properties"]["name"] for f in features] == list(strips)
kml = {"k": "http://www.opengis.net/kml/2.2"}
placemarks = ET.parse("lines.kml").findall(".//k:Placemark", kml)
assert [p.find("k:name", kml).text for p in placemarks] == list(strips)
rows = list(csv.DictReader(open("lines.csv")))
at = 0
for feature, placemark, (name, vertices) in zip(features, placemarks, strips.items()):
    expected = np.array([to_wgs84.transform(x, y) + (z,) for x, y, z in vertices])
    found = np.array(feature["geometry"]["coordinates"])
    assert feature["geometry"]["type"] == "LineString" and feature["properties"]["speed_m_per_s"] > 0
    # A hundred millionth of a degree is a millimetre.
    assert np.allclose(found, expected, rtol=0, atol=[2e-8, 2e-8, 1e-3]), (found, expected)
    text = placemark.find("k:LineString/k:coordinates", kml).text
    assert np.allclose(np.array([c.split(",") for c in text.split()], float), found, rtol=0, atol=1e-8)
    for vertex in vertices:
        row = rows[at]
        assert row["line"] == name and row["crs"] == "EPSG:25832"
        assert np.allclose([float(row[k]) for k in "xyz"], vertex, atol=1e-3)
        at += 1
assert at == len(rows)
print(len(features))
"#;

#[test]
fn lines_are_written_for_maps() {
    let Some(python) = common::python("pyproj, numpy") else { return };
    let dir = folder();
    let area = "POLYGON ((477000 5429000, 478000 5429000, 478000 5430000, 477000 5430000))";
    let flight = [
        "plan",
        "airborne",
        "--scanner",
        "riegl_lms-q780",
        "--height",
        "500",
        "--density",
        "8",
        "--area",
        area,
    ];
    let files = ["--lines", "lines.geojson", "--lines", "lines.kml", "--lines", "lines.csv"];
    let crs = ["--crs", "EPSG:25832"];
    succeed(dir.path(), &[&flight[..], &["-o", "plan.toml", "--cross-lines", "1"], &crs, &files].concat());
    let count: usize = judge(&python, dir.path(), LINES).trim().parse().unwrap();
    assert!(count >= 4, "{count}");
    // Without a system there are no longitudes and latitudes, but a table.
    let said = refused(dir.path(), &[&flight[..], &["--lines", "a.kml"]].concat());
    assert!(said.contains("--crs EPSG:25832") && said.contains(".csv"), "{said}");
    let said = refused(dir.path(), &[&flight[..], &["--lines", "a.shp"]].concat());
    assert!(said.contains(".geojson, .kml or .csv"), "{said}");
    let said = refused(dir.path(), &[&flight[..], &crs, &["--lines", "lines.kml"]].concat());
    assert!(said.contains("--force"), "{said}");
    // The lines can be planned along again.
    let drive = ["plan", "mobile", "--scanner", "vlp16", "--along", "line.geojson", "--crs", "EPSG:25832"];
    let one =
        ["plan", "mobile", "--scanner", "vlp16", "--along", "LINESTRING (477000 5429000, 477100 5429050)"];
    succeed(
        dir.path(),
        &[&one[..], &crs, &["--lines", "line.geojson", "--lines", "line.csv", "-o", "one.toml"]].concat(),
    );
    succeed(dir.path(), &[&drive[..], &["--lines", "again.csv", "-o", "again.toml"]].concat());
    let [first, again] =
        ["line.csv", "again.csv"].map(|name| std::fs::read_to_string(dir.path().join(name)).unwrap());
    let ends = |text: &str| -> Vec<f64> {
        let row = text.lines().last().unwrap_or_default().split(',').skip(2).take(2);
        row.map(|v| v.parse().unwrap()).collect()
    };
    let apart: f64 = ends(&first).iter().zip(ends(&again)).map(|(a, b)| (a - b).abs()).sum();
    assert!(apart < 0.005, "{first}{again}");
    // Positions of a tripod are points.
    let tripod =
        ["plan", "terrestrial", "--scanner", "riegl_vz400", "--around", "477000,5429000", "--radius", "12"];
    succeed(
        dir.path(),
        &[&tripod[..], &crs, &["--resolution", "0.2", "--lines", "t.geojson", "-o", "t.toml"]].concat(),
    );
    let text = std::fs::read_to_string(dir.path().join("t.geojson")).unwrap();
    assert!(text.contains("\"Point\"") && !text.contains("LineString"), "{text}");
}
