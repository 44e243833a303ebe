//! The stages as commands: composed they give the points of `vlscan run`, bit for bit, and pulses of other
//! programs are traced.

use crate::common;
use crate::common::{feed, fixture, folder, run, succeed, text};
use std::path::Path;

fn survey(name: &str) -> String {
    fixture(name).to_str().unwrap().to_owned()
}

/// The points of `run` and of `pulses | trace`, as text.
fn both_ways(dir: &Path, survey: &str, flight: &[&str], trace: &[&str]) -> (Vec<u8>, Vec<u8>) {
    let direct = [&["run", survey, "-q", "-o", "-", "--format", "xyz"], flight].concat();
    let direct = succeed(dir, &direct).stdout;
    let pulses = succeed(dir, &[&["pulses", survey, "-q", "-j", "3"], flight].concat()).stdout;
    let traced = feed(dir, &[&["trace", "-q", "-j", "2"], trace].concat(), &pulses);
    assert!(traced.status.success(), "{}", text(&traced.stderr));
    (direct, traced.stdout)
}

fn assert_same(dir: &Path, survey: &str, flight: &[&str], trace: &[&str], least: usize) {
    let (direct, traced) = both_ways(dir, survey, flight, trace);
    let points = direct.iter().filter(|b| **b == b'\n').count();
    assert!(points >= least, "{survey}: only {points} points");
    assert!(direct == traced, "{survey}: run and pulses | trace {} differ", trace.join(" "));
}

#[test]
fn an_airborne_survey_is_the_same_in_two_stages() {
    let dir = folder();
    let s = survey("forest/survey.xml");
    assert_same(dir.path(), &s, &[], &["--scene", &s, "--scanner", &s], 10_000);
    let scanner = format!("{}#", survey("forest/scanners.xml"));
    let scanner = scanner.trim_end_matches('#');
    // The scanner alone: seed and legs come with the pulses or from the command line.
    let scene = survey("forest/scene.xml");
    assert_same(
        dir.path(),
        &s,
        &["--seed", "5"],
        &["--scene", &scene, "--scanner", scanner, "--seed", "5", "--physics", "helios"],
        10_000,
    );
}

#[test]
fn refined_physics_and_small_blocks_change_nothing() {
    let dir = folder();
    let s = survey("terrain/survey.xml");
    let refined = ["--physics", "refined", "--echo-width", "--seed", "9"];
    let direct =
        succeed(dir.path(), &[&["run", &s, "-q", "-o", "-", "--format", "xyz"], &refined[..]].concat());
    let pulses = succeed(dir.path(), &["pulses", &s, "-q", "--physics", "refined", "--seed", "9"]).stdout;
    for size in ["7", "100000"] {
        let args = [&["trace", "-q", "--scanner", &s, "--chunk-size", size], &refined[..]].concat();
        let traced = feed(dir.path(), &args, &pulses);
        assert!(traced.stdout == direct.stdout, "blocks of {size}: {}", text(&traced.stderr));
    }
}

#[test]
fn a_terrestrial_survey_is_the_same_in_two_stages() {
    let dir = folder();
    let s = survey("room/survey.xml");
    assert_same(dir.path(), &s, &[], &["--scanner", &s], 10_000);
}

#[test]
fn vehicles_and_many_channels_are_the_same_in_two_stages() {
    let dir = folder();
    for name in ["street/survey.xml", "street/spinning.xml"] {
        let s = survey(name);
        assert_same(dir.path(), &s, &["--seed", "3"], &["--scanner", &s, "--seed", "3"], 1000);
    }
}

#[test]
fn moving_parts_and_plays_are_the_same_in_two_stages() {
    let dir = folder();
    let s = survey("moving/survey.xml");
    assert_same(dir.path(), &s, &[], &["--scanner", &s, "--chunk-size", "50"], 1000);
}

#[test]
fn a_streamed_flight_is_the_same_in_two_stages() {
    let dir = folder();
    let pipeline = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/als.toml");
    let pipeline = pipeline.to_str().unwrap();
    // Two seconds: a quarter of a million pulses in many chunks.
    let flight = std::fs::read_to_string(fixture("flight.csv")).unwrap();
    let flight: Vec<&str> = flight.lines().take(400).collect();
    std::fs::write(dir.path().join("flight.csv"), flight.join("\n") + "\n").unwrap();
    assert_same(dir.path(), pipeline, &["--trajectory", "flight.csv"], &["--scanner", pipeline], 100_000);
}

#[test]
fn files_per_leg_waveforms_and_las_are_the_same() {
    let dir = folder();
    let s = survey("room/survey.xml");
    let wanted = ["-o", "legs", "--format", "las", "--waveforms", "--pulses"];
    succeed(dir.path(), &[&["run", &s, "-q"], &wanted[..]].concat());
    std::fs::rename(dir.path().join("legs"), dir.path().join("direct")).unwrap();
    let pulses = succeed(dir.path(), &["pulses", &s, "-q"]).stdout;
    let traced = feed(dir.path(), &[&["trace", "-q", "--scanner", &s], &wanted[..]].concat(), &pulses);
    assert!(traced.status.success(), "{}", text(&traced.stderr));
    let names = common::files(&dir.path().join("direct"));
    assert_eq!(names, common::files(&dir.path().join("legs")));
    assert!(names.len() >= 6, "{names:?}");
    for name in names {
        let bytes = |folder: &str| std::fs::read(dir.path().join(folder).join(&name)).unwrap();
        assert!(bytes("direct") == bytes("legs"), "{} differs", name.display());
    }
}

/// The scan pattern of the manual page, made by awk.
const CONE: &str = r#"BEGIN { OFS = ","; print "time,x,y,z,dx,dy,dz"
  for (i = 0; i < 3600; i++) { a = i * 0.0174533; r = i / 36000
    print i * 1e-5, 0, 0, 100, r * cos(a), r * sin(a), -1 } }"#;

#[test]
fn anybodys_pulses_can_be_traced() {
    let dir = folder();
    let pulses = std::process::Command::new("awk").arg(CONE).output().expect("awk").stdout;
    let scene = survey("terrain/scene.xml");
    let args = ["trace", "-q", "--scene", &scene, "--scanner", "riegl_vz400"];
    let traced = feed(dir.path(), &args, &pulses);
    assert!(traced.status.success(), "{}", text(&traced.stderr));
    let points = text(&traced.stdout);
    assert!(points.lines().count() > 3000, "{} points", points.lines().count());
    // All echoes lie within the cone, and the pulses are numbered by their order.
    for line in points.lines() {
        let f: Vec<f64> = line.split(' ').filter_map(|f| f.parse().ok()).collect();
        let (x, y, z) = (f[0], f[1], f[2]);
        assert!((x * x + y * y).sqrt() <= 0.11 * (100.0 - z), "{line}");
        let number: f64 = line.split(' ').nth(7).unwrap().parse().unwrap();
        let time: f64 = line.split(' ').nth(10).unwrap().parse().unwrap();
        assert!((time - (number - 1.0) * 1e-5).abs() < 1e-8, "{line}");
    }
    // Without a header, with blanks.
    let bare: String = text(&pulses).lines().skip(1).map(|l| l.replace(',', " ") + "\n").collect();
    assert!(feed(dir.path(), &args, bare.as_bytes()).stdout == traced.stdout);
}

#[test]
fn scanners_of_the_catalogue_have_the_figures_of_pipelines_in_the_refined_physics() {
    let dir = folder();
    std::fs::write(dir.path().join("wall.obj"), "v 0.5 -1 -1\nv 0.5 1 -1\nv 0.5 0 1\nf 1 2 3\n").unwrap();
    let said = |physics: &str| {
        let args = ["trace", "--scene", "wall.obj", "--scanner", "vlp16", "--physics", physics];
        let out = feed(dir.path(), &args, b"x,y,z,dx,dy,dz\n0,0,0,1,0,0\n");
        assert!(out.status.success(), "{}", text(&out.stderr));
        text(&out.stderr)
    };
    // The wall is nearer than 1 m, the minimum of the data sheet, and farther than HELIOS++'s 0.09 m.
    let (helios, refined) = (said("helios"), said("refined"));
    assert!(helios.contains("1 beam met the scene"), "{helios}");
    assert!(refined.contains("the scanner measures from 1.0 m to 100 m"), "{refined}");
}

#[test]
fn wrong_pulses_are_named_with_their_place() {
    let dir = folder();
    let scene = survey("terrain/scene.xml");
    let args = ["trace", "-q", "--scene", &scene, "--scanner", "riegl_vz400"];
    let head = "time,x,y,z,dx,dy,dz\n0,0,0,100,0,0,-1\n";
    let cases = [
        (String::new(), "the stream is empty"),
        ("time,x,y,z,dx,dy,dzz\n".to_owned(), "did you mean `dz`"),
        ("time,x,y,z,dx,dy\n1,2,3,4,5,6\n".to_owned(), "no column for dz"),
        ("1,2,3,4\n".to_owned(), "4 numbers and no header"),
        (format!("{head}1,0,0,100,0,0\n"), "<stdin>:3:1"),
        (format!("{head}1,0,0,nan,0,0,-1\n"), "z is NaN"),
        (format!("{head}1,0,x,100,0,0,-1\n"), "<stdin>:3:5"),
        (format!("{head}1,0,0,100,0,0,0\n"), "0 0 0 is not a direction"),
        (format!("{head}1,0,0,1e999,0,0,1\n"), "z is inf"),
        (
            format!("device,{}0,0,0,0,100,0,0,-1\n9,0,0,0,100,0,0,-1\n", &head[..20]),
            "device 9, the scanner has 1",
        ),
        ("\u{0}\u{1}\u{2}\n".repeat(3), "expected a pulse as text, found binary data"),
        ("x".repeat(100_000), "a line of more than"),
    ];
    for (input, part) in cases {
        let out = feed(dir.path(), &args, input.as_bytes());
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{part}: {said}");
        assert!(said.contains(part), "{part:?} is missing from\n{said}");
    }
}

#[test]
fn scanners_and_legs_that_are_missing_are_named() {
    let dir = folder();
    let scene = survey("terrain/scene.xml");
    let refuse = |args: &[&str], input: &str, part: &str| {
        let out = feed(dir.path(), args, input.as_bytes());
        assert_eq!(out.status.code(), Some(2), "{part}: {}", text(&out.stderr));
        assert!(text(&out.stderr).contains(part), "{part:?} is missing from\n{}", text(&out.stderr));
    };
    let pulse = "leg,x,y,z,dx,dy,dz\n5,0,0,100,0,0,-1\n";
    refuse(&["trace", "--scene", &scene, "--scanner", "riegl_vz40"], pulse, "did you mean `riegl_vz400`");
    refuse(&["trace", "--scanner", "riegl_vz400"], pulse, "--scene is required");
    refuse(
        &["trace", "--scene", &scene, "--scanner", "riegl_vz400", "-o", "legs"],
        pulse,
        "one file per leg",
    );
    let s = survey("terrain/survey.xml");
    refuse(&["trace", "--scanner", &s], pulse, "leg 5, the survey has");
    // A scanner without a survey has no legs: any leg number is accepted.
    let args = ["trace", "-q", "--scene", &scene, "--scanner", "riegl_vz400"];
    assert!(feed(dir.path(), &args, pulse.as_bytes()).status.success());
}

#[test]
fn poses_fly_again_as_they_were() {
    let dir = folder();
    let s = survey("terrain/survey.xml");
    let poses = succeed(dir.path(), &["trajectory", &s, "-q", "--interval", "0.01"]).stdout;
    assert!(text(&poses).starts_with("time[s],x[m],y[m],z[m],roll[deg],pitch[deg],yaw[deg]\n"));
    let again =
        feed(dir.path(), &["trajectory", &s, "-q", "--interval", "0.01", "--trajectory", "-"], &poses);
    assert!(again.status.success(), "{}", text(&again.stderr));
    let rows = |bytes: &[u8]| -> Vec<Vec<f64>> {
        let line = |l: &str| l.split(',').map(|f| f.parse().unwrap()).collect();
        text(bytes).lines().skip(1).map(line).collect()
    };
    let (first, second) = (rows(&poses), rows(&again.stdout));
    assert!(first.len() > 50);
    // Within the first leg every pose is the recorded one; later legs turn between two poses.
    let mut checked = 0;
    for pose in &second {
        let after = first.partition_point(|p| p[0] < pose[0]);
        let (Some(p), Some(q)) = (first.get(after.wrapping_sub(1)), first.get(after)) else { continue };
        if q[6] != first[0][6] {
            break;
        }
        let share = (pose[0] - p[0]) / (q[0] - p[0]);
        for column in 1..7 {
            let there = p[column] + (q[column] - p[column]) * share;
            assert!((pose[column] - there).abs() < 1e-6, "{pose:?} is not between {p:?} and {q:?}");
        }
        checked += 1;
    }
    assert!(checked > 50, "only {checked} poses");
}

#[test]
fn a_reader_that_goes_away_ends_the_flight_quietly() {
    use std::io::Read;
    use std::process::Stdio;
    let dir = folder();
    for command in ["pulses", "trajectory"] {
        let mut child = common::vlscan(dir.path())
            .args([command, &survey("forest/survey.xml")])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut some = [0; 100];
        child.stdout.take().unwrap().read_exact(&mut some).unwrap();
        let out = child.wait_with_output().unwrap();
        assert_eq!((out.status.code(), text(&out.stderr)), (Some(0), String::new()), "{command}");
    }
    let out = run(dir.path(), &["pulses", "no_such.xml"]);
    assert_eq!(out.status.code(), Some(2));
}

#[test]
fn an_arrow_stream_between_the_stages_changes_no_bit() {
    let dir = folder();
    for (name, least) in
        [("terrain/survey.xml", 1000), ("street/spinning.xml", 1000), ("moving/survey.xml", 1000)]
    {
        let s = survey(name);
        let direct = succeed(dir.path(), &["run", &s, "-q", "-o", "-", "--format", "xyz"]).stdout;
        let points = direct.iter().filter(|b| **b == b'\n').count();
        assert!(points >= least, "{name}: only {points} points");
        let pulses = succeed(dir.path(), &["pulses", &s, "-q", "--format", "arrow", "-j", "3"]).stdout;
        assert_eq!(pulses[..4], [0xff; 4], "{name}: invalid Arrow stream");
        for size in ["1000", "7"] {
            let traced = feed(dir.path(), &["trace", "-q", "--scanner", &s, "--chunk-size", size], &pulses);
            assert!(traced.stdout == direct, "{name}, blocks of {size}: {}", text(&traced.stderr));
        }
        // The stream does not depend on threads or chunks.
        let again =
            succeed(dir.path(), &["pulses", &s, "-q", "--format", "arrow", "-j", "1", "--chunk-size", "50"]);
        assert!(again.stdout == pulses, "{name}: the stream depends on threads or chunks");
    }
}

#[test]
fn poses_fly_along_an_arrow_stream_as_along_text() {
    let dir = folder();
    let s = survey("terrain/survey.xml");
    let poses = |format: &str| succeed(dir.path(), &["trajectory", &s, "-q", "--format", format]).stdout;
    let fly = |poses: &[u8]| feed(dir.path(), &["pulses", &s, "-q", "--trajectory", "-"], poses);
    let (table, lines) = (poses("arrow"), poses("csv"));
    assert_eq!(table[..4], [0xff; 4]);
    let (along_table, along_lines) = (fly(&table), fly(&lines));
    assert!(along_table.status.success(), "{}", text(&along_table.stderr));
    assert!(text(&along_table.stdout).lines().count() > 1000);
    assert!(along_table.stdout == along_lines.stdout, "Arrow and text lead elsewhere");
    // Cut off within a batch
    let cut = fly(&table[..table.len() - 200]);
    assert_eq!(cut.status.code(), Some(2), "{}", text(&cut.stderr));
    assert!(text(&cut.stderr).contains("the stream ends within batch"), "{}", text(&cut.stderr));
}

/// Interrupted while poses still arrive, a stream of pulses ends with complete rows, and as Arrow with its
/// end mark.
#[cfg(unix)]
#[test]
fn an_interrupted_stream_of_pulses_is_whole() {
    use std::io::{Read, Write};
    use std::process::Stdio;
    let dir = folder();
    let s = survey("terrain/survey.xml");
    for format in ["arrow", "csv"] {
        let mut child = common::vlscan(dir.path())
            .args(["pulses", &s, "-q", "--trajectory", "-", "--format", format])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stdin = child.stdin.take().unwrap();
        for i in 0..400 {
            writeln!(stdin, "{},{},0,400,0,0,90", 100.0 + f64::from(i) * 0.01, f64::from(i) * 0.1).unwrap();
        }
        stdin.flush().unwrap();
        let mut stdout = child.stdout.take().unwrap();
        let mut pulses = vec![0; 20_000];
        stdout.read_exact(&mut pulses).unwrap();
        let killed = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
        assert!(killed.unwrap().success());
        stdout.read_to_end(&mut pulses).unwrap();
        let out = child.wait_with_output().unwrap();
        assert_eq!(out.status.code(), Some(130), "{format}: {}", text(&out.stderr));
        drop(stdin);
        match format {
            "arrow" => {
                assert!(pulses.ends_with(&[0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]), "no end of the stream")
            }
            _ => assert!(pulses.ends_with(b"\n"), "a row is cut"),
        }
        let traced = feed(dir.path(), &["trace", "-q", "--scanner", &s], &pulses);
        assert!(traced.status.success() && traced.stdout.len() > 1000, "{format}: {}", text(&traced.stderr));
    }
}

#[test]
fn wrong_arrow_streams_are_named_with_their_place() {
    let dir = folder();
    let s = survey("terrain/survey.xml");
    let pulses = succeed(dir.path(), &["pulses", &s, "-q", "--format", "arrow"]).stdout;
    let trace = |bytes: &[u8]| {
        let out = feed(dir.path(), &["trace", "-q", "--scanner", &s], bytes);
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
        text(&out.stderr)
    };
    let cut = trace(&pulses[..pulses.len() / 2]);
    assert!(cut.contains("the stream ends within batch") && cut.contains("whole rows"), "{cut}");
    assert!(trace(&pulses[..3]).contains("unknown column") || trace(&pulses[..3]).contains("number"));
    let mut damaged = pulses.clone();
    let half = damaged.len() / 2;
    damaged[half..].fill(0x77);
    assert!(trace(&damaged).contains("error"));
    assert!(
        trace(&[[0xff; 4].as_slice(), &[0x40, 0, 0, 0], &[7; 64]].concat()).contains("unreadable metadata")
    );
}

/// An Arrow stream of a cone of pulses, written by pyarrow in batches of 1000 rows after a change of the
/// table.
const CONE_IN_PYTHON: &str = r#"
import sys, math, pyarrow as pa
n = 3600
a = [i * 0.0174533 for i in range(n)]
r = [i / 36000 for i in range(n)]
columns = {"time": [i * 1e-5 for i in range(n)], "x": pa.array([0] * n, pa.int32()), "y": pa.array([0.0] * n, pa.float32()),
    "z": [100] * n, "dx": [q * math.cos(p) for p, q in zip(a, r)], "dy": [q * math.sin(p) for p, q in zip(a, r)],
    "dz": pa.array([-1] * n, pa.int8())}
CHANGE
table = pa.table(columns)
sink = pa.ipc.new_file if "file" in sys.argv else pa.ipc.new_stream
with sink(pa.output_stream(sys.stdout.buffer), table.schema) as out:
    out.write_table(table, max_chunksize=1000)
"#;

#[test]
fn pulses_that_pyarrow_makes_can_be_traced() {
    let Some(python) = common::python("pyarrow") else { return };
    let dir = folder();
    let make = |change: &str, kind: &str| {
        let script = CONE_IN_PYTHON.replace("CHANGE", change);
        let out = std::process::Command::new(&python).args(["-c", &script, kind]).output().unwrap();
        assert!(out.status.success(), "{}", text(&out.stderr));
        out.stdout
    };
    let scene = survey("terrain/scene.xml");
    let args = ["trace", "-q", "--scene", &scene, "--scanner", "riegl_vz400"];
    let trace = |pulses: &[u8]| feed(dir.path(), &args, pulses);
    let traced = trace(&make("", "stream"));
    assert!(traced.status.success(), "{}", text(&traced.stderr));
    assert!(text(&traced.stdout).lines().count() > 3000);
    let from_text = trace(&std::process::Command::new("awk").arg(CONE).output().expect("awk").stdout);
    let count = |out: &std::process::Output| text(&out.stdout).lines().count();
    assert_eq!(count(&traced), count(&from_text));
    let from_file = trace(&make("", "file"));
    assert!(from_file.stdout == traced.stdout, "{}", text(&from_file.stderr));
    // The fourth batch, its third row
    for (change, part) in [
        ("columns['dz'] = ['down'] * n", "column `dz` holds text, expected numbers"),
        ("del columns['dy']", "no column for dy"),
        ("columns['dxx'] = columns.pop('dx')", "did you mean"),
        (
            "columns['z'] = [None if i == 3002 else 100 for i in range(n)]",
            "batch 4: 1 of 600 values of column `z` are null",
        ),
        (
            "columns['z'] = [math.nan if i == 3002 else 100.0 for i in range(n)]",
            "row 3003 (batch 4, its row 3): z is NaN",
        ),
        ("columns['leg'] = [-1] * n", "row 1 (batch 1, its row 1): leg is -1"),
    ] {
        let out = trace(&make(change, "stream"));
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{change}: {said}");
        assert!(said.contains(part), "{part:?} is missing from\n{said}");
    }
    // Units in the metadata, and a nested column beside the numbers
    let change = "columns['time'] = pa.array([i * 10 for i in range(n)], pa.int64())\n\
                  columns = {('time[us]' if k == 'time' else k): v for k, v in columns.items()}";
    let in_us = trace(&make(change, "stream"));
    assert!(in_us.status.success(), "{}", text(&in_us.stderr));
    assert_eq!(count(&in_us), count(&traced));
}

#[test]
fn the_schedule_of_a_stream_is_recorded() {
    let dir = folder();
    let s = survey("room/survey.xml");
    let pulses = succeed(dir.path(), &["pulses", &s, "-q"]).stdout;
    let args = ["trace", "-q", "--scene", &s, "--scanner", &s, "-o", "a.las", "--schedule-log", "log.json"];
    let traced = feed(dir.path(), &args, &pulses);
    assert!(traced.status.success(), "{}", text(&traced.stderr));
    let log = std::fs::read_to_string(dir.path().join("log.json")).unwrap();
    let log: serde_json::Value = serde_json::from_str(&log).unwrap();
    assert_eq!(log["tasks"].as_u64().unwrap() as usize, text(&pulses).lines().count() - 1);
}

#[test]
fn legs_and_ranges_that_points_cannot_have_are_refused() {
    let dir = folder();
    let scene = survey("terrain/scene.xml");
    let usual = ["trace", "-q", "--scene", &scene, "--scanner", "riegl_vz400"];
    let refused = |pulses: &str, more: &[&str]| {
        let out = feed(dir.path(), &[&usual[..], more].concat(), pulses.as_bytes());
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
        text(&out.stderr)
    };
    let head = "x,y,z,dx,dy,dz,leg\n0,0,100,0,0,-1,";
    let said = refused(&format!("{head}65535\n"), &[]);
    assert!(said.contains("leg 65535, expected at most 65534"), "{said}");
    let said = refused("x,y,z,azimuth_deg,elevation\n0,0,100,0,-90\n", &[]);
    assert!(said.contains("a second column for z") && said.contains("elevation_deg"), "{said}");
    let said = refused(&format!("{head}0\n"), &["--range-min", "20", "--range-max", "10"]);
    assert!(said.contains("the nearest range, 20 m, is beyond the farthest, 10 m"), "{said}");
}
