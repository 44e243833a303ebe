//! `vlscan fit`: flights that this program flew itself, and recordings where they are at hand.

use crate::common::{folder, recording, run, succeed, text};
use std::fs;
use std::path::Path;

/// Two seconds of a drone with a mirror over a rolling field.
fn pipeline(optics: &str) -> String {
    let mut survey = String::from(
        "scene = \"hills/scene.xml\"\nseed = 1\n\n[platform]\nkind = \"linear_path\"\n\
         mount = { offset_m = [0, 0, 0], rotate_deg = [{ x = -90 }, { z = -90 }] }\n\n[scanner]\nid = \"own\"\n",
    );
    survey += optics;
    survey += "pulse_freqs_hz = [100000]\naccuracy_m = 0.01\nmax_range = { range_m = 900, reflectance = 0.2 }\n\n\
         [settings]\npulse_freq_hz = 100000\nscan_freq_hz = 60\nscan_angle_deg = 25\n\n\
         [[leg]]\nposition_m = [-20, 30, 200]\nspeed_m_per_s = 20\n\n[[leg]]\nposition_m = [20, 30, 200]\nactive = false\n\n\
         [[output]]\npath = \"line.laz\"\n";
    survey
}

/// The estimated values by name.
fn figures(folder: &Path, args: &[&str]) -> serde_json::Map<String, serde_json::Value> {
    figures_of(&succeed(folder, args).stdout)
}

/// The estimated values by name in what `--json` prints.
fn figures_of(json: &[u8]) -> serde_json::Map<String, serde_json::Value> {
    let figures: Vec<serde_json::Value> = serde_json::from_slice(json).unwrap();
    figures.into_iter().map(|f| (f["name"].as_str().unwrap().to_owned(), f["value"].clone())).collect()
}

#[test]
fn a_flight_that_was_flown_here_is_found_and_flown_again() {
    let cone = "optics = \"conic\"\nscan_angle_max_deg = 20\nscan_freq_max_hz = 60\nscan_reverse = true\nscan_phase_deg = 40\n";
    let polygon =
        "optics = \"rotating\"\nscan_angle_max_deg = 30\nscan_freq_max_hz = 60\nscan_phase_deg = 70\n";
    let swinging =
        "optics = \"oscillating\"\nscan_angle_max_deg = 30\nscan_freq_max_hz = 60\nscan_phase_deg = 70\n";
    let ellipse = "optics = \"conic\"\nscan_angle_max_deg = 20\nscan_angle_along_max_deg = 14\nscan_freq_max_hz = 60\nscan_reverse = true\nscan_phase_deg = 70\n";
    let facets = "optics = \"rotating\"\nscan_angle_max_deg = 30\nscan_freq_max_hz = 60\nscan_reverse = true\nscan_phase_deg = 70\nfacet_tilts_deg = [0, 4, -3]\n";
    for (optics, name, angle, rate) in [
        (cone, "conic", ("half angle of the cone", 20.0), "revolutions"),
        (polygon, "rotating", ("angle per line", 60.0), "lines"),
        // Its turns take 6 % of each sweep.
        (swinging, "oscillating", ("half angle", 25.0), "periods"),
        (ellipse, "conic", ("half angle along the flight", 14.0), "revolutions"),
        (facets, "rotating", ("angle per line", 60.0), "lines"),
    ] {
        let dir = folder();
        succeed(
            dir.path(),
            &["scene", "make", "terrain", "-n", "20k", "--pulses", "1k", "-o", "hills", "-q"],
        );
        let mut flown = pipeline(optics);
        let mut height = 200.0;
        if optics == ellipse {
            // Arcs of an ellipse do not tell it: all of it is on the field.
            (flown, height) = (flown.replace("30, 200]", "0, 80]"), 80.0);
        }
        fs::write(dir.path().join("flown.toml"), flown).unwrap();
        succeed(dir.path(), &["run", "flown.toml", "-q"]);
        let found = figures(dir.path(), &["fit", "line.laz", "-o", "fit.toml", "--json", "-q"]);
        for (name, expected, within) in [
            ("speed", 20.0, 0.2),
            ("course", 90.0, 0.5),
            (angle.0, angle.1, 0.01 * angle.1),
            (rate, 60.0, 0.006),
            ("pulse rate", 100_000.0, 100.0),
            ("height of the platform", height, 2.0),
        ] {
            let value = found[name].as_f64().unwrap();
            assert!((value - expected).abs() < within, "{optics}: {name} is {value}");
        }
        let written = fs::read_to_string(dir.path().join("fit.toml")).unwrap();
        assert!(written.contains(&format!("optics = \"{name}\"")), "{written}");
        // Flown again over the same ground it draws the same lines: so do the times and angles of its pulses.
        succeed(dir.path(), &["run", "fit.toml", "--scene", "hills/scene.xml", "-o", "again.laz", "-q"]);
        let out = succeed(dir.path(), &["compare", "line.laz", "again.laz", "--json"]);
        let compared: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        let points = |which: &str| compared[which]["points"].as_f64().unwrap();
        assert!((points("second") / points("first") - 1.0).abs() < 0.02, "{compared}");
        let quantities = compared["quantities"].as_array().unwrap();
        let angles = quantities.iter().find(|q| q["name"] == "scan angle at the same time").unwrap();
        let figure =
            angles["figures"].as_array().unwrap().iter().find(|f| f["name"] == "robust spread").unwrap();
        let spread = figure["second"].as_f64().unwrap();
        assert!(spread < 0.02, "{optics}: {angles}");
        // What exists stays.
        let again = run(dir.path(), &["fit", "line.laz", "-o", "fit.toml"]);
        assert!(text(&again.stderr).contains("--force"), "{}", text(&again.stderr));
    }
}

/// A line of the drone over the field, with a cone and this number of pulses per second.
fn recorded_line(folder: &Path, rate: u32) {
    succeed(folder, &["scene", "make", "terrain", "-n", "20k", "--pulses", "1k", "-o", "hills", "-q"]);
    let cone = "optics = \"conic\"\nscan_angle_max_deg = 20\nscan_freq_max_hz = 60\n";
    let flown = pipeline(cone).replace("100000", &rate.to_string());
    fs::write(folder.join("flown.toml"), flown).unwrap();
    succeed(folder, &["run", "flown.toml", "-q", "-o", "line.laz"]);
}

#[test]
fn a_written_flight_never_names_the_recording_or_another_file_as_its_output() {
    let dir = folder();
    recorded_line(dir.path(), 100_000);
    let recording = fs::read(dir.path().join("line.laz")).unwrap();
    let fit = ["fit", "line.laz", "-o", "line.toml", "-q"];
    succeed(dir.path(), &fit);
    let fly = ["run", "line.toml", "--scene", "hills/scene.xml", "-q"];
    succeed(dir.path(), &fly);
    assert!(fs::read(dir.path().join("line.laz")).unwrap() == recording);
    let simulated = fs::read(dir.path().join("line.simulated.laz")).unwrap();
    // The points of the first flight are the user's, too.
    succeed(dir.path(), &[&fit[..], &["--force"]].concat());
    succeed(dir.path(), &fly);
    assert!(fs::read(dir.path().join("line.simulated.laz")).unwrap() == simulated);
    assert!(dir.path().join("line.simulated-2.laz").exists());
    // The recording is not replaced even where it is asked for.
    let out = run(dir.path(), &["fit", "line.laz", "-o", "line.laz", "--force"]);
    let said = text(&out.stderr);
    assert!(out.status.code() == Some(2) && said.contains("the file is TOML, not laz"), "{said}");
    assert!(fs::read(dir.path().join("line.laz")).unwrap() == recording);
}

#[test]
fn files_of_an_earlier_fit_do_not_stay_and_few_pulses_have_a_constant_rate() {
    let dir = folder();
    recorded_line(dir.path(), 14_000);
    // As an earlier fit leaves them, which had pulse times and a mirror that wanders.
    fs::write(dir.path().join("t.pulses.txt"), "0\n1\n").unwrap();
    fs::write(dir.path().join("t.wander.txt"), "0 0\n1 0\n").unwrap();
    let fit = ["fit", "line.laz", "-o", "t.toml", "-q"];
    let out = run(dir.path(), &fit);
    let said = text(&out.stderr);
    let is_named = ["t.pulses.txt exists", "t.wander.txt exists"].iter().any(|part| said.contains(part));
    assert!(out.status.code() == Some(2) && is_named, "{said}");
    succeed(dir.path(), &[&fit[..], &["--force"]].concat());
    let written = fs::read_to_string(dir.path().join("t.toml")).unwrap();
    assert!(!dir.path().join("t.pulses.txt").exists() && !written.contains("pulse_times"));
    assert_eq!(dir.path().join("t.wander.txt").exists(), written.contains("t.wander.txt"));
    succeed(dir.path(), &["run", "t.toml", "--scene", "hills/scene.xml", "-q"]);
}

#[test]
fn memory_changes_no_fit_that_has_room_and_more_points_are_sampled_with_a_warning() {
    let dir = folder();
    recorded_line(dir.path(), 100_000);
    let info = succeed(dir.path(), &["info", "line.laz", "--json"]);
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    let bytes = 36 * info["points"].as_u64().unwrap();
    let files = |memory: &str| {
        let fit = ["fit", "line.laz", "-o", "t.toml", "--force", "-q", "--max-memory", memory];
        succeed(dir.path(), &fit);
        ["t.toml", "t.trajectory.csv"].map(|name| fs::read(dir.path().join(name)).unwrap())
    };
    assert!(files(&bytes.to_string()) == files("8G"));
    // Half of the seconds are few for this flight; if no flight matches them, the warning is there, too.
    let less = (bytes - 1).to_string();
    let out = run(dir.path(), &["fit", "line.laz", "-o", "less.toml", "--max-memory", &less]);
    let said = text(&out.stderr);
    assert!(said.contains("of every 2 seconds the scan lines of one are fitted"), "{said}");
}

#[test]
fn the_cloud_of_a_tripod_is_no_flight() {
    let dir = folder();
    succeed(dir.path(), &["scene", "make", "forest", "-n", "3k", "--pulses", "1k", "-o", "f", "-q"]);
    let plan = ["plan", "terrestrial", "--scanner", "riegl_vz400", "--scene", "f/scene.xml"];
    let place = ["--around", "0,0", "--radius", "2", "-n", "1", "--resolution", "0.28", "-o", "p.toml", "-q"];
    succeed(dir.path(), &[&plan[..], &place].concat());
    succeed(dir.path(), &["run", "p.toml", "-o", "tripod.laz", "-q"]);
    let out = run(dir.path(), &["fit", "tripod.laz", "-o", "t.toml"]);
    let said = text(&out.stderr);
    let turn =
        said.split("turn steadily by ").nth(1).and_then(|rest| rest.split('°').next()?.parse::<f64>().ok());
    assert!(
        out.status.code() == Some(2) && turn.is_some_and(|turn| (300.0..370.0).contains(&turn)),
        "{said}"
    );
    assert!(said.contains("this is no flight") && !dir.path().join("t.toml").exists(), "{said}");
}

/// Three lines of 10 s at 20 m/s to the east, back and to the east, with half circles of 30 m between them.
fn lines_with_turns() -> String {
    const RADIUS: f64 = 30.0;
    let turn_s = std::f64::consts::PI * RADIUS / 20.0;
    let row = |k: u32| {
        let time = 0.1 * f64::from(k);
        let (line, within) = ((time / (10.0 + turn_s)).floor(), time % (10.0 + turn_s));
        let turned = std::f64::consts::PI * ((within - 10.0) / turn_s).max(0.0);
        let along = 20.0 * within.min(10.0) + RADIUS * turned.sin() - 100.0;
        let y = 2.0 * RADIUS * (line - 1.0) + RADIUS * (1.0 - turned.cos());
        let (x, heading) = if line == 1.0 {
            (-along, 270.0 + turned.to_degrees())
        } else {
            (along, 90.0 - turned.to_degrees())
        };
        format!("{time},{x},{y},200,0,0,{heading}\n")
    };
    let rows: String = (0..=394).map(row).collect();
    format!("time,x,y,z,roll,pitch,heading\n{rows}")
}

#[test]
fn straight_parts_of_a_flight_with_turns_are_flight_lines() {
    let dir = folder();
    let make =
        ["scene", "make", "terrain", "-n", "20k", "--extent", "500", "--pulses", "1k", "-o", "hills", "-q"];
    succeed(dir.path(), &make);
    let polygon =
        "optics = \"rotating\"\nscan_angle_max_deg = 30\nscan_freq_max_hz = 60\nscan_phase_deg = 70\n";
    let line = pipeline(polygon).replace("100000", "5000").replace("scan_freq_hz = 60", "scan_freq_hz = 10");
    let (head, legs) = line.split_once("[[leg]]").unwrap();
    let output = legs.split_once("[[output]]").unwrap().1;
    let flown = format!("{head}\n[trajectory]\npath = \"way.csv\"\n\n[[output]]{output}");
    fs::write(dir.path().join("flown.toml"), flown).unwrap();
    fs::write(dir.path().join("way.csv"), lines_with_turns()).unwrap();
    succeed(dir.path(), &["run", "flown.toml", "-q"]);
    let out = succeed(dir.path(), &["fit", "line.laz", "-o", "fit.toml", "--json"]);
    let (found, messages) = (figures_of(&out.stdout), text(&out.stderr));
    for part in ["has turns", "points of the turns are ignored", "has 3 flight lines", ".3 (from GPS time"] {
        assert!(messages.contains(part), "{part}: {messages}");
    }
    for (name, expected, within) in
        [("speed", 20.0, 0.1), ("course", 90.0, 0.5), ("lines", 10.0, 0.001), ("pulse rate", 5000.0, 5.0)]
    {
        let value = found[name].as_f64().unwrap();
        assert!((value - expected).abs() < within, "{name} is {value}");
    }
    // The second line, back, by its number.
    let names = messages.split("--flight-line selects one of point source ").nth(1).unwrap();
    let source = names.split(':').next().unwrap();
    let chosen = |number: u32| {
        let name = format!("{source}.{number}");
        let out = format!("{name}.toml");
        run(dir.path(), &["fit", "line.laz", "-o", &out, "--json", "--flight-line", &name])
    };
    let out = chosen(2);
    assert!(out.status.success() && !text(&out.stderr).contains("flight line"), "{}", text(&out.stderr));
    let course = figures_of(&out.stdout)["course"].as_f64().unwrap();
    assert!((course - 270.0).abs() < 0.5, "{course}");
    let out = chosen(4);
    let message = text(&out.stderr);
    assert!(!out.status.success() && message.contains("has 3 flight lines of point source"), "{message}");
}

#[test]
fn a_level_fan_whose_height_changes_is_not_taken_for_a_cone() {
    let dir = folder();
    succeed(dir.path(), &["scene", "make", "terrain", "-n", "50k", "--pulses", "1k", "-o", "hills", "-q"]);
    // Without any roll, a cone of 90° with a tilted axis explains these points as well as a polygon mirror.
    let row = |i: i32| {
        let time = 20.0 + 0.2 * f64::from(i);
        let (y, z) = (40.0 - 8.0 * (time - 20.0), 60.0 + 0.3 * (time / 9.0).sin());
        format!("{time:.2},0,{y:.4},{z:.4},0,{:.4},180\n", 0.6 * (0.4 * time).cos())
    };
    let rows: String = (0..=50).map(row).collect();
    fs::write(dir.path().join("way.csv"), format!("time,x,y,z,roll,pitch,heading\n{rows}")).unwrap();
    let flown = "scene = \"hills/scene.xml\"\nseed = 3\n[trajectory]\npath = \"way.csv\"\n\
         [platform]\ncatalogue = \"data/platforms.xml#copter_linearpath\"\n\
         [scanner]\ncatalogue = \"data/scanners_als.xml#riegl_vux-1uav\"\n\
         [settings]\npulse_freq_hz = 10000\nscan_freq_hz = 10\nscan_angle_deg = 40\n\
         [[output]]\npath = \"line.laz\"\n";
    fs::write(dir.path().join("flown.toml"), flown).unwrap();
    succeed(dir.path(), &["run", "flown.toml", "-q"]);
    let found = figures(dir.path(), &["fit", "line.laz", "-o", "fit.toml", "--json"]);
    for (name, expected, within) in [("speed", 8.0, 0.02), ("course", 180.0, 0.1), ("lines", 10.0, 0.001)] {
        let value = found[name].as_f64().unwrap();
        assert!((value - expected).abs() < within, "{name} is {value}");
    }
}

#[test]
fn two_channels_of_one_mirror_are_found() {
    let dir = folder();
    succeed(dir.path(), &["scene", "make", "terrain", "-n", "20k", "--pulses", "1k", "-o", "hills", "-q"]);
    let fly = |reach: u32, height: u32, speed: u32, pulses: u32, lines: u32| {
        let flown = format!(
            "scene = \"hills/scene.xml\"\nseed = 1\n\n[platform]\nkind = \"linear_path\"\n\
             mount = {{ offset_m = [0, 0, 0], rotate_deg = [{{ x = -90 }}, {{ z = -90 }}] }}\n\n\
             [scanner]\ncatalogue = \"data/scanners_als.xml#riegl_vq-1560ii\"\n\n\
             [settings]\npulse_freq_hz = {pulses}\nscan_freq_hz = {lines}\n\n\
             [[leg]]\nposition_m = [-{reach}, 0, {height}]\nspeed_m_per_s = {speed}\n\n\
             [[leg]]\nposition_m = [{reach}, 0, {height}]\nactive = false\n\n[[output]]\npath = \"line.laz\"\n"
        );
        fs::write(dir.path().join("flown.toml"), flown).unwrap();
        succeed(dir.path(), &["run", "flown.toml", "-q", "--force"]);
        let out = succeed(dir.path(), &["fit", "line.laz", "-o", "fit.toml", "--force", "--json"]);
        (figures_of(&out.stdout), text(&out.stderr))
    };
    let (found, messages) = fly(60, 100, 20, 200_000, 60);
    let value = |name: &str| found[name].as_f64().unwrap();
    let mut yaws = [value("yaw of channel 1"), value("yaw of channel 2")];
    yaws.sort_by(f64::total_cmp);
    assert!((yaws[0] + 14.0).abs() < 0.01 && (yaws[1] - 14.0).abs() < 0.01, "{yaws:?}");
    for (name, expected, within) in [
        ("speed", 20.0, 0.02),
        ("height of the platform", 100.0, 0.2),
        ("angle per line", 90.0, 0.2),
        ("lines", 60.0, 0.001),
        ("pulse rate", 200_000.0, 20.0),
    ] {
        assert!((value(name) - expected).abs() < within, "{name} is {}", value(name));
    }
    assert!(!messages.contains("change so little"), "{messages}");
    // Two degrees of scan angles do not tell the height well.
    let (_, messages) = fly(60, 2000, 60, 1_000_000, 135);
    assert!(messages.contains("change so little") && messages.contains("known to 2 % only"), "{messages}");
}

/// Bit 0 of the global encoding of a LAS file, and the first and the last GPS time of the points in a CSV
/// file.
fn times(folder: &Path, las: &str, csv: &str) -> (u8, f64, f64) {
    let points = fs::read_to_string(folder.join(csv)).unwrap();
    let mut lines = points.lines();
    let column = lines.next().unwrap().split(',').position(|name| name == "GpsTime").unwrap();
    let mut times: Vec<f64> =
        lines.map(|line| line.split(',').nth(column).unwrap().parse().unwrap()).collect();
    times.sort_by(f64::total_cmp);
    (fs::read(folder.join(las)).unwrap()[6] & 1, times[0], times[times.len() - 1])
}

#[test]
fn a_recording_keeps_the_scale_of_its_times_and_the_sense_of_its_angles() {
    let dir = folder();
    succeed(dir.path(), &["scene", "make", "terrain", "-n", "20k", "--pulses", "1k", "-o", "hills", "-q"]);
    // The mount of the catalogue's aircraft, whose mirrors count to the left.
    let line =
        pipeline("optics = \"conic\"\nscan_angle_max_deg = 20\nscan_freq_max_hz = 60\nscan_phase_deg = 40\n");
    let (head, legs) = line.split_once("[[leg]]").unwrap();
    let (head, output) = (head.replace("z = -90", "z = 90"), legs.split_once("[[output]]").unwrap().1);
    let way = "\n[trajectory]\npath = \"way.csv\"\n\n[[output]]\npath = \"line.csv\"\n\n[[output]]";
    fs::write(dir.path().join("flown.toml"), format!("{head}{way}{output}")).unwrap();
    // Adjusted standard time in 2024, across the end of a week; and seconds of the week, as SBET has them.
    for (start, bit) in [(604_800.0 * 664.0 - 1.0, 1), (302_400.0, 0)] {
        let rows = [0.0, 1.0, 2.0].map(|t| format!("{},{},30,200,0,0,90\n", start + t, 20.0 * t - 20.0));
        fs::write(dir.path().join("way.csv"), format!("time,x,y,z,roll,pitch,heading\n{}", rows.concat()))
            .unwrap();
        succeed(dir.path(), &["run", "flown.toml", "-q", "--force"]);
        let flown = times(dir.path(), "line.laz", "line.csv");
        assert!(
            flown.0 == bit && flown.1 >= start && flown.2 <= start + 2.0 && flown.2 > start + 1.8,
            "{flown:?}"
        );
        let fit = succeed(dir.path(), &["fit", "line.laz", "-o", "fit.toml", "--force"]);
        assert!(!text(&fit.stderr).contains("against the LAS specification"), "{}", text(&fit.stderr));
        let again = [
            "run",
            "fit.toml",
            "--scene",
            "hills/scene.xml",
            "-o",
            "again.laz",
            "-o",
            "again.csv",
            "-q",
            "--force",
        ];
        succeed(dir.path(), &again);
        let again = times(dir.path(), "again.laz", "again.csv");
        assert_eq!(again.0, bit);
        assert!((again.1 - flown.1).abs() < 0.02 && (again.2 - flown.2).abs() < 0.02, "{flown:?} {again:?}");
        // The reference takes whole weeks off.
        succeed(dir.path(), &["run", "flown.toml", "-q", "--force", "--correct", "no-adjusted-times"]);
        let reduced = times(dir.path(), "line.laz", "line.csv");
        assert!(reduced.0 == 0 && (0.0..=604_800.0).contains(&reduced.1), "{reduced:?}");
    }
}

#[test]
fn clouds_that_say_nothing_of_a_flight_are_refused() {
    let dir = folder();
    fs::write(dir.path().join("plain.xyz"), "0 0 0\n1 1 1\n").unwrap();
    let rows: String =
        (0..2000).map(|k| format!("{k} {} 5 {} 0\n", k * 7 % 13, f64::from(k) * 1e-4)).collect();
    fs::write(dir.path().join("nadir.txt"), format!("x y z time scan_angle\n{rows}")).unwrap();
    let column = |row: &dyn Fn(u32) -> String| {
        format!("x y z time scan_angle\n{}", (0..2000).map(row).collect::<String>())
    };
    fs::write(dir.path().join("frozen.txt"), column(&|k| format!("{k} {} 5 77 3\n", k % 13))).unwrap();
    fs::write(dir.path().join("place.txt"), column(&|k| format!("1 2 5 {} 3\n", f64::from(k) * 1e-4)))
        .unwrap();
    let double = |k: u32| format!("{k} {} 5 {} 3\n", k % 13, f64::from(k / 2) * 1e-4);
    fs::write(dir.path().join("double.txt"), column(&double)).unwrap();
    fs::write(dir.path().join("few.txt"), "x y z time scan_angle\n1 2 3 4 5\n").unwrap();
    for (cloud, expected) in [
        ("plain.xyz", "GPS times"),
        ("nadir.txt", "all scan angles are 0°"),
        ("few.txt", "too few"),
        ("frozen.txt", "have the GPS time 77"),
        ("place.txt", "lie within 0.000 m"),
        ("double.txt", "1000 points have the time of another pulse"),
        ("none.laz", "none.laz"),
    ] {
        let out = run(dir.path(), &["fit", cloud, "-o", "fit.toml"]);
        let message = text(&out.stderr);
        assert!(!out.status.success() && message.contains(expected), "{cloud}: {message}");
        assert!(!dir.path().join("fit.toml").exists(), "{cloud}");
    }
    fs::write(dir.path().join("line.txt"), format!("x y z time scan_angle\n{rows}")).unwrap();
    let out = run(dir.path(), &["fit", "line.txt", "-o", "fit.toml", "--flight-line", "9"]);
    assert!(text(&out.stderr).contains("--flight-line 9"), "{}", text(&out.stderr));
}

#[test]
fn real_flight_lines_are_fitted() {
    let dir = folder();
    let lines = [
        ("airborne/flight_line.laz", "revolutions", 149.9986, 1.64e6, 58.9),
        ("airborne/hills.laz", "lines", 77.5455, 3.58e5, 70.0),
        // Two channels whose lines cross, one after the other in a tile of 50 m.
        ("airborne/town_b.laz", "lines", 196.938, 1.248e6, 71.4),
        ("airborne/town_c.laz", "lines", 196.938, 1.248e6, 71.4),
    ];
    for (name, of_mirror, frequency, pulse_rate, speed) in lines {
        let Some(path) = recording(name) else { return };
        let found = figures(
            dir.path(),
            &["fit", path.to_str().unwrap(), "-o", "fit.toml", "--json", "--force", "-q"],
        );
        let value = |name: &str| found[name].as_f64().unwrap();
        assert!((value(of_mirror) - frequency).abs() < 0.01, "{name}: {found:?}");
        assert!((value("pulse rate") / pulse_rate - 1.0).abs() < 0.01, "{name}: {found:?}");
        assert!((value("speed") - speed).abs() < 1.0, "{name}: {found:?}");
        assert!(value("residual on the ground") < 0.05, "{name}: {found:?}");
        let yaw = found.get("yaw of channel 1").and_then(|yaw| yaw.as_f64());
        let has_two = name.contains("town");
        assert!(has_two == yaw.is_some_and(|yaw| (yaw.abs() - 14.05).abs() < 0.05), "{name}: {found:?}");
    }
}
