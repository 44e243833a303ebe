//! Recorded trajectories in every layout: the same flight gives the same points, wrong files are refused with
//! the line or record, and points leave while poses still arrive.

use crate::common;
use crate::common::{feed, fixture, folder, run, succeed, text, vlscan};
use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::Stdio;
use std::sync::mpsc;
use std::time::Duration;
use vlscan::geom::{Rotation, UtmZone};

/// Origin of `fixtures/airborne` in zone 32N.
const ORIGIN: [f64; 2] = [476_000.0, 5_429_000.0];

/// time, x, y, z, roll, pitch, heading in degrees: a part of `fixtures/flight.csv`, moved to UTM coordinates.
fn rows(poses: usize) -> Vec<[f64; 7]> {
    let text = fs::read_to_string(fixture("flight.csv")).unwrap();
    let row = |line: &str| -> [f64; 7] {
        let numbers: Vec<f64> = line.split(',').map(|n| n.parse().unwrap()).collect();
        let mut row: [f64; 7] = numbers.try_into().unwrap();
        (row[1], row[2]) = (row[1] + ORIGIN[0], row[2] + ORIGIN[1]);
        row
    };
    text.lines().skip(1 + 1800).take(poses).map(row).collect()
}

fn csv(rows: &[[f64; 7]]) -> String {
    let mut out = "time,x,y,z,roll,pitch,heading\n".to_owned();
    for row in rows {
        let _ = writeln!(out, "{}", row.map(|v| v.to_string()).join(","));
    }
    out
}

fn zone() -> UtmZone {
    UtmZone::parse("32N").unwrap()
}

/// The flight as latitude, longitude (rad) and true heading (degrees) in place of x, y and heading.
fn geographic(rows: &[[f64; 7]]) -> Vec<[f64; 7]> {
    let row = |[t, x, y, z, roll, pitch, heading]: &[f64; 7]| {
        let (lat, lon) = zone().unproject(*x, *y);
        let convergence = zone().project(lat, lon).unwrap().convergence.to_degrees();
        [*t, lat, lon, *z, *roll, *pitch, heading + convergence]
    };
    rows.iter().map(row).collect()
}

fn sbet(rows: &[[f64; 7]]) -> Vec<u8> {
    let wander = -0.3;
    let record = |[t, lat, lon, z, roll, pitch, heading]: [f64; 7]| {
        let [roll, pitch, heading] = [roll, pitch, heading].map(f64::to_radians);
        [t, lat, lon, z, 9., 8., 7., roll, pitch, heading + wander, wander, 1., 2., 3., 4., 5., 6.]
    };
    geographic(rows).into_iter().flat_map(record).flat_map(f64::to_le_bytes).collect()
}

fn terrascan(rows: &[[f64; 7]]) -> Vec<u8> {
    let mut out = b"TSCANTRJ".to_vec();
    for word in [20_010_715, 1376, rows.len() as u32, 64] {
        out.extend(word.to_le_bytes());
    }
    out.resize(1376, 0);
    for [t, x, y, z, roll, pitch, heading] in rows {
        out.extend([t, x, y, z, heading, roll, pitch].iter().flat_map(|v| v.to_le_bytes()));
        out.extend([1, 1, 1, 1, 0, 0, 0, 0]);
    }
    out
}

/// The layout in which HELIOS++ writes trajectories.
fn helios(rows: &[[f64; 7]]) -> String {
    let line = |[t, x, y, z, roll, pitch, yaw]: &[f64; 7]| {
        format!("{x:.4} {y:.4} {z:.4} {t:.9} {roll:.4} {pitch:.4} {yaw:.4}\n")
    };
    rows.iter().map(line).collect()
}

/// The same attitudes with the angles that HELIOS++ composes them of: Rz(−yaw) Ry(roll) Rx(pitch).
fn of_helios(rows: &[[f64; 7]]) -> Vec<[f64; 7]> {
    let row = |[t, x, y, z, roll, pitch, heading]: &[f64; 7]| {
        let [roll, pitch, heading] = [*roll, *pitch, *heading].map(f64::to_radians);
        let angles = Rotation::of_heading(roll, pitch, heading).angles_zyx().unwrap();
        let [about_z, roll, pitch] = angles.map(f64::to_degrees);
        [*t, *x, *y, *z, roll, pitch, -about_z]
    };
    rows.iter().map(row).collect()
}

/// Time, position, and the quaternion of a body with the axes forward, left, up, with w last.
fn quaternion_line([t, x, y, z, roll, pitch, heading]: &[f64; 7]) -> String {
    let [roll, pitch, heading] = [*roll, *pitch, *heading].map(f64::to_radians);
    let to_body = Rotation::about_z(std::f64::consts::FRAC_PI_2);
    let q = Rotation::of_heading(roll, pitch, heading).after(to_body);
    format!("{t} {x} {y} {z} {} {} {} {}\n", q.u.x, q.u.y, q.u.z, q.w)
}

/// A pipeline that scans the hills of `fixtures/airborne`; its trajectory is given on the command line.
fn pipeline(dir: &Path) -> String {
    let path = dir.join("p.toml");
    let scene = fixture("airborne/scene.xml");
    let text = format!(
        "scene = '{}#hills'\n[trajectory]\npath = '-'\n[scanner]\ncatalogue = 'data/scanners_als.xml#riegl_lms-q780'\n\
         accuracy_m = 0\n[platform]\ncatalogue = 'data/platforms.xml#sr22'\n[settings]\npulse_freq_hz = 20000\n\
         scan_freq_hz = 60\nscan_angle_deg = 25\n[[output]]\npath = '-'\nformat = 'xyz'\n",
        scene.display()
    );
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// The points of a run along a trajectory, on stdout.
fn points(dir: &Path, trajectory: &[u8], options: &[&str]) -> Vec<u8> {
    let file = dir.join("flown");
    fs::write(&file, trajectory).unwrap();
    let pipeline = pipeline(dir);
    let args = [&["run", &pipeline, "-q", "--trajectory", "flown"], options].concat();
    succeed(dir, &args).stdout
}

fn coordinates(points: &[u8]) -> Vec<[f64; 3]> {
    let of = |line: &str| {
        let mut numbers = line.split(' ').map(|n| n.parse().unwrap());
        [(); 3].map(|()| numbers.next().unwrap())
    };
    text(points).lines().map(of).collect()
}

/// The same pulses hit the same ground, except for a few at edges.
fn assert_near(what: &str, found: &[u8], expected: &[u8], tolerance: f64) {
    let (found, expected) = (coordinates(found), coordinates(expected));
    assert!(
        found.len().abs_diff(expected.len()) <= expected.len() / 500,
        "{what}: {} {}",
        found.len(),
        expected.len()
    );
    let near = |a: &[f64; 3], b: &[f64; 3]| (0..3).all(|i| (a[i] - b[i]).abs() <= tolerance);
    let mut away = 0;
    let mut rest = expected.as_slice();
    for point in &found {
        match rest.iter().take(20).position(|p| near(point, p)) {
            Some(at) => rest = &rest[at + 1..],
            None => away += 1,
        }
    }
    assert!(away <= expected.len() / 500, "{what}: {away} of {} points are elsewhere", found.len());
}

#[test]
fn the_same_flight_in_every_layout_gives_the_same_points() {
    let dir = folder();
    let flight = rows(60);
    let plain = points(dir.path(), csv(&flight).as_bytes(), &[]);
    assert!(coordinates(&plain).len() > 3000, "{} points", coordinates(&plain).len());

    let blanks: String = csv(&flight).lines().skip(1).map(|l| l.replace(',', "  ") + "\r\n").collect();
    assert!(points(dir.path(), blanks.as_bytes(), &[]) == plain, "blank-separated text");
    assert!(points(dir.path(), &terrascan(&flight), &[]) == plain, "TerraScan");
    assert!(points(dir.path(), &terrascan(&flight), &["--trajectory-format", "terrascan"]) == plain);
    let shuffled: String =
        flight.iter().map(|[t, x, y, z, r, p, h]| format!("{h};junk;{z};{y};{x};{p};{r};{t}\n")).collect();
    let columns = ["--trajectory-columns", "time=8,x=5,y=4,z=3,roll=7,pitch=6,heading=1"];
    assert!(points(dir.path(), shuffled.as_bytes(), &columns) == plain, "columns by number");
    let columns = ["--trajectory-columns", "heading,?,z,y,x,pitch,roll,time"];
    assert!(points(dir.path(), shuffled.as_bytes(), &columns) == plain, "columns by name");

    assert_near("SBET", &points(dir.path(), &sbet(&flight), &[]), &plain, 1e-3);
    assert_near("SBET", &points(dir.path(), &sbet(&flight), &["--utm-zone", "32N"]), &plain, 1e-3);
    let as_headings = ["--trajectory-rotation", "heading"];
    assert_near("HELIOS++", &points(dir.path(), helios(&flight).as_bytes(), &as_headings), &plain, 2e-3);
    let own = helios(&of_helios(&flight));
    assert_near("HELIOS++", &points(dir.path(), own.as_bytes(), &[]), &plain, 2e-3);
    let tum: String = flight.iter().map(quaternion_line).collect();
    assert_near("quaternions", &points(dir.path(), tum.as_bytes(), &[]), &plain, 1e-3);
    let named = format!("# timestamp tx ty tz qx qy qz qw\n{tum}");
    assert_near("named quaternions", &points(dir.path(), named.as_bytes(), &[]), &plain, 1e-3);
    let mut lat_lon = "time,lat[rad],lon[rad],height,roll,pitch,heading\n".to_owned();
    for row in geographic(&flight) {
        let _ = writeln!(lat_lon, "{}", row.map(|v| v.to_string()).join(","));
    }
    assert_near("latitude and longitude", &points(dir.path(), lat_lon.as_bytes(), &[]), &plain, 1e-3);
    let radians: String = flight
        .iter()
        .map(|[t, x, y, z, r, p, h]| {
            let [r, p, yaw] = [*r, *p, 90.0 - h].map(f64::to_radians);
            format!("{t} {x} {y} {z} {r} {p} {yaw}\n")
        })
        .collect();
    let options = ["--trajectory-angles", "rad", "--trajectory-rotation", "yaw"];
    assert_near("yaw in radians", &points(dir.path(), radians.as_bytes(), &options), &plain, 1e-3);
}

#[test]
fn the_scene_tells_the_grid() {
    let dir = folder();
    let flight = sbet(&rows(20));
    let crs = |name: &str| format!("PROJCRS[\"{name}\",BASEGEOGCRS[\"ETRS89\"]]");
    let at_home = points(dir.path(), &flight, &["--crs", &crs("ETRS89 / UTM zone 32N")]);
    assert!(!at_home.is_empty());
    // In the neighbouring zone the flight is far from the scene.
    assert!(points(dir.path(), &flight, &["--crs", &crs("ETRS89 / UTM zone 33N")]).is_empty());
    let pipeline = pipeline(dir.path());
    let foreign = crs("ETRS89 / Austria Lambert");
    let out = run(dir.path(), &["run", &pipeline, "--trajectory", "flown", "--crs", &foreign]);
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("--utm-zone"), "{}", text(&out.stderr));
}

#[test]
fn pulses_and_poses_come_from_the_same_reader() {
    let dir = folder();
    let flight = rows(40);
    fs::write(dir.path().join("f.out"), sbet(&flight)).unwrap();
    fs::write(dir.path().join("f.csv"), csv(&flight)).unwrap();
    let pipeline = pipeline(dir.path());
    let of = |command: &str, file: &str, options: &[&str]| -> Vec<Vec<f64>> {
        let args = [&[command, &pipeline, "-q", "--trajectory", file], options].concat();
        let numbers = |line: &str| line.split(',').map(|n| n.parse().unwrap()).collect();
        text(&succeed(dir.path(), &args).stdout).lines().skip(1).map(numbers).collect()
    };
    for command in ["pulses", "trajectory"] {
        let (found, expected) = (of(command, "f.out", &[]), of(command, "f.csv", &[]));
        assert!(found.len() == expected.len() && found.len() > 3, "{command}");
        for (f, e) in found.iter().zip(&expected) {
            assert!((0..7).all(|i| (f[i] - e[i]).abs() < 1e-4), "{command}: {f:?} {e:?}");
        }
    }
    // The first pose, moved along its own right axis: lever arm and boresight turn with the platform.
    let plain = of("trajectory", "f.csv", &[]);
    let moved = of(
        "trajectory",
        "f.csv",
        &["--lever-arm", "2,0,0", "--boresight", "0,0,-3", "--height-offset", "-48"],
    );
    let right = flight[0][6].to_radians();
    assert!((moved[0][1] - plain[0][1] - 2.0 * right.cos()).abs() < 0.05, "{:?} {:?}", moved[0], plain[0]);
    assert!((moved[0][2] - plain[0][2] + 2.0 * right.sin()).abs() < 0.05);
    assert!((moved[0][6] - plain[0][6] + 3.0).abs() < 0.5 && (moved[0][3] - plain[0][3] + 48.0).abs() < 0.2);
}

/// Origin and direction of the first pulse along `trajectory` (text), of a scanner that looks forwards from a
/// mount and an emitter away from the platform's origin.
fn first_pulse(dir: &Path, trajectory: &str, options: &[&str]) -> [f64; 6] {
    let scene = fixture("airborne/scene.xml");
    let pipeline = format!(
        "scene = '{}#hills'\n[trajectory]\npath = '-'\n[platform]\nmount = {{ offset_m = [0.5, 2, -1] }}\n[scanner]\nid = 's'\n\
         optics = 'conic'\nscan_angle_max_deg = 1e-9\npulse_freqs_hz = [10]\nbeam_origin = {{ offset_m = [0, 1, 0] }}\n",
        scene.display()
    );
    fs::write(dir.join("first.toml"), pipeline).unwrap();
    fs::write(dir.join("first.txt"), trajectory).unwrap();
    let args = [&["pulses", "first.toml", "-q", "--trajectory", "first.txt"], options].concat();
    let out = succeed(dir, &args).stdout;
    let line = text(&out).lines().nth(1).unwrap().to_owned();
    let numbers: Vec<f64> = line.split(',').skip(1).take(6).map(|n| n.parse().unwrap()).collect();
    numbers.try_into().unwrap()
}

#[test]
fn attitudes_are_those_of_aeronautics_and_offsets_turn_with_them() {
    let dir = folder();
    let row = |t: f64| format!("{t:.1},476000,5429000,500,30,30,90\n");
    let plain = format!("time,x,y,z,roll,pitch,heading\n{}{}", row(1.0), row(2.0));
    // Roll innermost: the nose points to the east and 30° up; right, forward and up as in
    // docs/dev/details.md.
    let (r, f, u) = ([0.25, -0.8660254, -0.4330127], [0.8660254, 0.0, 0.5], [-0.4330127, -0.5, 0.75]);
    let found = first_pulse(dir.path(), &plain, &[]);
    for i in 0..3 {
        let place = [476_000.0, 5_429_000.0, 500.0][i] + 0.5 * r[i] + 3.0 * f[i] - u[i];
        assert!((found[i] - place).abs() < 1e-6 && (found[3 + i] - f[i]).abs() < 1e-6, "{found:?}");
    }
    // The reference adds offsets along the axes of the world.
    let still = first_pulse(dir.path(), &plain, &["--correct", "no-mount-offsets-turn"]);
    assert!((still[0] - 476_000.5).abs() < 1e-6 && (still[1] - 5_429_003.0).abs() < 1e-6, "{still:?}");
    // A file of HELIOS++ has pitch innermost.
    let helios = format!(
        "#TIME_COLUMN: 0\n#HEADER: \"t\",\"x\",\"y\",\"z\",\"roll\",\"pitch\",\"yaw\"\n{}{}",
        row(1.0),
        row(2.0)
    );
    let found = first_pulse(dir.path(), &helios, &[]);
    // Rz(−90°) Ry(30°) Rx(30°) y = Rz(−90°) Ry(30°) (0, √3/2, 1/2) = Rz(−90°) (1/4, √3/2, √3/4)
    for (found, wanted) in found[3..].iter().zip([0.8660254, -0.25, 0.4330127]) {
        assert!((found - wanted).abs() < 1e-6, "{found} is not {wanted}");
    }
}

#[test]
fn surveys_of_interpolated_platforms_take_binary_files_too() {
    let dir = folder();
    let flight = rows(40);
    fs::write(dir.path().join("f.out"), sbet(&flight)).unwrap();
    fs::write(dir.path().join("f.trj"), terrascan(&flight)).unwrap();
    let lines: String = csv(&of_helios(&flight)).lines().skip(1).map(|l| format!("{l}\n")).collect();
    let header = "#HEADER: \"t\", \"x\", \"y\", \"z\", \"roll\", \"pitch\", \"yaw\"\n#TIME_COLUMN: 0\n";
    fs::write(dir.path().join("f.txt"), format!("{header}{lines}")).unwrap();
    let scan = |file: &str| {
        let survey = format!(
            "<document><survey name='s' platform='interpolated' basePlatform='data/platforms.xml#sr22' \
             scanner='data/scanners_als.xml#riegl_lms-q780' scene='{}#hills'><leg><platformSettings trajectory='{file}'/>\
             <scannerSettings pulseFreq_hz='20000' scanFreq_hz='60' scanAngle_deg='25'/></leg></survey></document>",
            fixture("airborne/scene.xml").display()
        );
        fs::write(dir.path().join("s.xml"), survey).unwrap();
        succeed(dir.path(), &["run", "s.xml", "-q", "-o", "-", "--format", "xyz"]).stdout
    };
    let expected = scan("f.txt");
    assert!(coordinates(&expected).len() > 1000);
    assert_near("TerraScan", &scan("f.trj"), &expected, 1e-3);
    assert_near("SBET", &scan("f.out"), &expected, 1e-3);
}

#[test]
fn wrong_trajectories_are_refused_with_the_place() {
    let dir = folder();
    let pipeline = pipeline(dir.path());
    let flight = rows(6);
    let good = sbet(&flight);
    let with = |record: usize, field: usize, value: f64| {
        let mut bytes = good.clone();
        bytes[record * 136 + field * 8..][..8].copy_from_slice(&value.to_le_bytes());
        bytes
    };
    let trj = terrascan(&flight);
    let noise: Vec<u8> = (0..5000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let mut backwards = flight.clone();
    backwards[4][0] = backwards[2][0];
    let mut twice = flight.clone();
    twice[3][0] = twice[2][0];
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("empty", Vec::new(), &["empty"]),
        ("noise", noise, &["neither text nor SBET", "--trajectory-format"]),
        ("cut SBET", good[..136 * 3 + 50].to_vec(), &["record 4 (byte 408)", "50 bytes, expected 136"]),
        ("NaN in SBET", with(2, 8, f64::NAN), &["record 3 (byte 272)", "pitch is NaN"]),
        ("infinite latitude", with(1, 1, f64::INFINITY), &["record 2", "latitude is inf"]),
        ("not a valid latitude", with(1, 1, 1.7), &["record 2", "latitude"]),
        ("backward SBET", sbet(&backwards), &["record 5", "goes back"]),
        ("repeated time", terrascan(&twice), &["record 4", "occurs again"]),
        ("cut TerraScan", trj[..1376 + 64 * 4].to_vec(), &["record 5", "6 records"]),
        ("cut header", trj[..700].to_vec(), &["header is truncated"]),
        ("backward text", csv(&backwards).into_bytes(), &["flown:6:1", "goes back"]),
        (
            "NaN in text",
            csv(&flight).replacen("1009.005,", "1009.005,nan ,", 1).into_bytes(),
            &["flown:3:", "nan"],
        ),
        ("words", b"some words that are\nno trajectory at all\n".to_vec(), &["flown:1:"]),
    ];
    for (what, bytes, parts) in cases {
        fs::write(dir.path().join("flown"), bytes).unwrap();
        let out = run(dir.path(), &["run", &pipeline, "--trajectory", "flown", "-o", "a.xyz"]);
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{what}: {said}");
        assert!(parts.iter().all(|part| said.contains(part)), "{what}: {said}");
        assert!(!dir.path().join("a.xyz").exists(), "{what}");
    }
    // A header alone is a flight without poses.
    fs::write(dir.path().join("flown"), "time,x,y,z,roll,pitch,yaw\n").unwrap();
    let args = ["run", &pipeline, "--trajectory", "flown", "-o", "a.xyz"];
    let out = succeed(dir.path(), &args);
    assert!(text(&out.stderr).contains("0 poses"), "{}", text(&out.stderr));
    assert_eq!(run(dir.path(), &[&args[..], &["--force", "--strict"]].concat()).status.code(), Some(2));
    // Options for a trajectory need one.
    let survey = fixture("terrain/survey.xml");
    let out = run(dir.path(), &["run", survey.to_str().unwrap(), "--lever-arm", "0,0,1", "-o", "b.xyz"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("--trajectory"), "{}", text(&out.stderr));
}

#[test]
fn nothing_is_fired_in_gaps() {
    let dir = folder();
    let pipeline = pipeline(dir.path());
    let flight: Vec<[f64; 7]> = rows(400)
        .into_iter()
        .enumerate()
        .filter(|(i, _)| !(20..380).contains(i))
        .map(|(_, row)| row)
        .collect();
    let poses = csv(&flight);
    let times = |options: &[&str]| -> Vec<f64> {
        let args = [&["run", &pipeline, "--trajectory", "STDIN", "-o", "-"], options].concat();
        let out = feed(dir.path(), &args, poses.as_bytes());
        assert!(out.status.success(), "{}", text(&out.stderr));
        assert!(text(&out.stderr).contains("<stdin>:22:1"), "the gap is not told: {}", text(&out.stderr));
        text(&out.stdout).lines().map(|l| l.rsplit(' ').next().unwrap().parse().unwrap()).collect()
    };
    let (gap, end) = (flight[19][0], flight[20][0]);
    let inside = |times: &[f64]| times.iter().filter(|t| (gap + 1e-3..end - 1e-3).contains(*t)).count();
    assert!(inside(&times(&[])) > 1000, "the platform flies through gaps");
    let apart = times(&["--max-gap", "0.5"]);
    assert!(inside(&apart) == 0 && apart.iter().any(|t| *t < gap) && apart.iter().any(|t| *t > end));
}

/// Poses through a named pipe whose writer then pauses: the points of all of them arrive while the pipe is
/// still open.
#[cfg(unix)]
#[test]
fn points_do_not_wait_for_a_silent_writer() {
    let dir = folder();
    let pipe = dir.path().join("poses");
    if !std::process::Command::new("mkfifo").arg(&pipe).status().is_ok_and(|s| s.success()) {
        common::missing("mkfifo", "apt install coreutils");
        return;
    }
    let flight = rows(100);
    // The last points of the whole flight, and of one that ends a pose earlier.
    let times = |points: Vec<u8>| -> Vec<f64> {
        text(&points).lines().map(|l| l.rsplit(' ').next().unwrap().parse().unwrap()).collect()
    };
    let all = times(points(dir.path(), csv(&flight).as_bytes(), &[]));
    let but_one = times(points(dir.path(), csv(&flight[..99]).as_bytes(), &[]));
    let (end, end_but_one) = (*all.last().unwrap(), *but_one.last().unwrap());
    for (layout, bytes, end_of_bytes) in [
        ("text", csv(&flight).into_bytes(), end),
        ("SBET", sbet(&flight), end),
        // An incomplete record does not count.
        ("half a record", sbet(&flight)[..136 * 99 + 77].to_vec(), end_but_one),
    ] {
        let mut child = vlscan(dir.path())
            .args(["run", &pipeline(dir.path()), "-q", "--trajectory", pipe.to_str().unwrap(), "-o", "-"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut writer = fs::OpenOptions::new().write(true).open(&pipe).unwrap();
        writer.write_all(&bytes).unwrap();
        let (sender, arrivals) = mpsc::channel();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        let reader = std::thread::spawn(move || {
            for line in stdout.lines() {
                let time: f64 = line.unwrap().rsplit(' ').next().unwrap().parse().unwrap();
                if sender.send(time).is_err() {
                    break;
                }
            }
        });
        // The limit only ends the test in case of a failure.
        let mut last = 0.0;
        while last < end_of_bytes - 1e-6 {
            let time = arrivals.recv_timeout(Duration::from_secs(120));
            last = time
                .unwrap_or_else(|e| panic!("{layout}: {e}; {last}, not {end_of_bytes}, is the last point"));
        }
        if layout == "half a record" {
            writer.write_all(&sbet(&flight)[136 * 99 + 77..]).unwrap();
            while last < end - 1e-6 {
                last =
                    arrivals.recv_timeout(Duration::from_secs(120)).expect("the rest of the record counts");
            }
        }
        drop(writer);
        let out = child.wait_with_output().unwrap();
        reader.join().unwrap();
        assert!(out.status.success(), "{layout}: {}", text(&out.stderr));
    }
}
