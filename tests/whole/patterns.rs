//! Scan patterns of files: their directions, times and origins in a run, and the same bytes however it is
//! computed.

use crate::common::{fixture, folder, judge, python, run, succeed, text};
use std::fs;
use std::path::Path;

const ROWS: usize = 700;

/// Azimuth and elevation of row `k`, degrees.
fn angles(k: usize) -> [f64; 2] {
    let phase = k as f64;
    [150.0 * (0.37 * phase).sin(), 40.0 * (0.11 * phase).cos()]
}

fn direction([azimuth, elevation]: [f64; 2]) -> [f64; 3] {
    let (sin, cos) = azimuth.to_radians().sin_cos();
    let (up, level) = elevation.to_radians().sin_cos();
    [level * sin, level * cos, up]
}

/// A pipeline in the room with these keys of the scanner.
fn pipeline(scanner: &str) -> String {
    let scene = fixture("room/scene.xml");
    format!(
        "scene = \"{}#room\"\nseed = 5\n[scanner]\noptics = \"pattern\"\naccuracy_m = 0.01\n{scanner}\n[settings]\n\
         max_duration_s = 1.5\n[[leg]]\nposition_m = [0.3, -0.2, 1.5]\n[[leg]]\nposition_m = [-0.6, 0.4, 1.2]\n",
        scene.display()
    )
}

/// The numbers of the columns `names` of the pulses of `p.toml`.
fn pulses(folder: &Path, names: &[&str]) -> Vec<Vec<f64>> {
    let table = text(&succeed(folder, &["pulses", "p.toml", "-q"]).stdout);
    let mut lines = table.lines();
    let headings: Vec<&str> =
        lines.next().unwrap().split(',').map(|h| h.split('[').next().unwrap()).collect();
    let at: Vec<usize> = names.iter().map(|name| headings.iter().position(|h| h == name).unwrap()).collect();
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        at.iter().map(|at| fields[*at].parse().unwrap()).collect()
    };
    lines.map(row).collect()
}

/// Checks that the pulses of each leg have the directions of the rows, in their order.
fn check_directions(folder: &Path) {
    let mut numbers = [0; 2];
    for row in pulses(folder, &["leg", "dx", "dy", "dz"]) {
        let leg = row[0] as usize;
        let expected = direction(angles(numbers[leg] % ROWS));
        let off = (0..3).map(|i| (row[i + 1] - expected[i]).abs()).fold(0.0, f64::max);
        assert!(off < 1e-12, "pulse {} of leg {leg} is off by {off}", numbers[leg]);
        numbers[leg] += 1;
    }
    assert!(numbers.iter().all(|count| (1498..=1502).contains(count)), "{numbers:?}");
}

#[test]
fn pulses_have_the_directions_of_the_file() {
    let dir = folder();
    let rows: String = (0..ROWS).map(|k| format!("{:?},{:?}\n", angles(k)[0], angles(k)[1])).collect();
    fs::write(dir.path().join("rows.csv"), format!("azimuth_deg,elevation_deg\n{rows}")).unwrap();
    fs::write(dir.path().join("p.toml"), pipeline("pattern = \"rows.csv\"\npulse_freqs_hz = [1000]"))
        .unwrap();
    check_directions(dir.path());
    // Livox: counted rows, zeniths, azimuths to the left.
    let rows: String =
        (0..ROWS).map(|k| format!("{},{:?},{:?}\n", k + 1, -angles(k)[0], 90.0 - angles(k)[1])).collect();
    fs::write(dir.path().join("livox.csv"), format!("Time/s,Azimuth/deg,Zenith/deg\n{rows}")).unwrap();
    fs::write(dir.path().join("p.toml"), pipeline("pattern = \"livox.csv\"\npulse_freqs_hz = [1000]"))
        .unwrap();
    check_directions(dir.path());
}

#[test]
fn parquet_and_numpy_files_are_those_of_text() {
    let Some(python) = python("numpy, pyarrow") else { return };
    let dir = folder();
    let rows: String = (0..ROWS).map(|k| format!("{:?},{:?}\n", angles(k)[0], angles(k)[1])).collect();
    fs::write(dir.path().join("rows.csv"), format!("azimuth_deg,elevation_deg\n{rows}")).unwrap();
    let script = "import numpy as np, pyarrow as pa, pyarrow.parquet as pq\n\
                  rows = np.loadtxt('rows.csv', delimiter=',', skiprows=1)\n\
                  np.save('rows.npy', rows)\n\
                  np.save('turned.npy', np.asfortranarray(rows))\n\
                  named = np.zeros(len(rows), dtype=[('elevation_deg', '<f8'), ('azimuth_deg', '>f8')])\n\
                  named['azimuth_deg'], named['elevation_deg'] = rows.T\n\
                  np.save('named.npy', named)\n\
                  table = pa.table({'azimuth_deg': rows[:, 0], 'elevation_deg': rows[:, 1]})\n\
                  pq.write_table(table, 'rows.parquet')\n";
    judge(&python, dir.path(), script);
    for file in ["rows.npy", "turned.npy", "named.npy", "rows.parquet"] {
        let scanner = format!("pattern = \"{file}\"\npulse_freqs_hz = [1000]");
        fs::write(dir.path().join("p.toml"), pipeline(&scanner)).unwrap();
        check_directions(dir.path());
    }
}

/// A table with times, three channels of which not all fire, and origins.
fn uneven() -> String {
    let mut table = String::from("time_s,channel,azimuth_deg,elevation_deg,origin_x_m,divergence_rad\n");
    for k in 0..ROWS {
        let [azimuth, elevation] = angles(k);
        let time = k as f64 * 1e-3 + (k * k % 5) as f64 * 1e-4;
        for channel in [2, 4, 9].into_iter().filter(|channel| (k + channel) % 3 != 0) {
            let turned = elevation - channel as f64;
            table +=
                &format!("{time:?},{channel},{azimuth:?},{turned:?},{:?},0.001\n", 0.01 * channel as f64);
        }
    }
    table
}

#[test]
fn times_and_origins_are_those_of_the_table() {
    let dir = folder();
    fs::write(dir.path().join("rows.csv"), uneven()).unwrap();
    fs::write(dir.path().join("p.toml"), pipeline("pattern = \"rows.csv\"\npattern_repeat = false")).unwrap();
    let rows = pulses(dir.path(), &["leg", "time", "device", "x"]);
    let start = rows[0][1];
    let expected: Vec<[f64; 3]> = (0..ROWS)
        .flat_map(|k| {
            let time = k as f64 * 1e-3 + (k * k % 5) as f64 * 1e-4;
            let channels =
                [2, 4, 9].into_iter().enumerate().filter(move |(_, channel)| (k + channel) % 3 != 0);
            channels.map(move |(device, channel)| [time, device as f64, 0.3 + 0.01 * channel as f64])
        })
        .collect();
    let first: Vec<&Vec<f64>> = rows.iter().filter(|row| row[0] == 0.0).collect();
    assert_eq!(first.len(), expected.len());
    for (row, [time, device, x]) in first.iter().zip(&expected) {
        let off = ((row[1] - start) * 1e-9 - (time - expected[0][0])).abs();
        assert!(
            off < 1e-7 && row[2] == *device && (row[3] - x).abs() < 1e-12,
            "{row:?}: {time} {device} {x}"
        );
    }
}

#[test]
fn patterns_leave_no_trace_of_threads_chunks_and_shards() {
    let dir = folder();
    fs::write(dir.path().join("rows.csv"), uneven()).unwrap();
    for repeat in [true, false] {
        let scanner = format!("pattern = \"rows.csv\"\npattern_repeat = {repeat}");
        fs::write(dir.path().join("p.toml"), pipeline(&scanner)).unwrap();
        let points = |name: &str, extra: &[&str]| {
            succeed(dir.path(), &[&["run", "p.toml", "-q", "--force", "-o", name], extra].concat());
            fs::read(dir.path().join(name)).unwrap()
        };
        let reference = points("one.csv", &["-j", "1"]);
        let count = reference.iter().filter(|byte| **byte == b'\n').count();
        assert!(count > 2000, "{count} points");
        for extra in [&["-j", "3", "--chunk-size", "7"], &["-j", "8", "--chunk-size", "4096"]] {
            assert!(points("other.csv", extra) == reference, "{repeat} {extra:?}");
        }
        for shard in ["0/3", "1/3", "2/3"] {
            succeed(dir.path(), &["run", "p.toml", "-q", "-o", "shards", "--shard", shard]);
        }
        succeed(dir.path(), &["merge", "shards", "-q", "-o", "merged.csv"]);
        assert!(fs::read(dir.path().join("merged.csv")).unwrap() == reference, "{repeat}: merged shards");
        // Traced, the pulses give the same points.
        let table = succeed(dir.path(), &["pulses", "p.toml", "-q"]).stdout;
        fs::write(dir.path().join("pulses.csv"), table).unwrap();
        succeed(
            dir.path(),
            &["trace", "pulses.csv", "--scanner", "p.toml", "-q", "--force", "-o", "traced.csv"],
        );
        assert!(fs::read(dir.path().join("traced.csv")).unwrap() == reference, "{repeat}: traced");
        fs::remove_dir_all(dir.path().join("shards")).unwrap();
        fs::remove_file(dir.path().join("merged.csv")).unwrap();
    }
}

#[test]
fn the_pattern_of_a_sensor_that_stood_still_comes_from_its_points() {
    let dir = folder();
    let rows: String = (0..ROWS).map(|k| format!("{:?},{:?}\n", angles(k)[0], angles(k)[1])).collect();
    fs::write(dir.path().join("rows.csv"), format!("azimuth_deg,elevation_deg\n{rows}")).unwrap();
    let one_leg = pipeline("pattern = \"rows.csv\"\npulse_freqs_hz = [1000]\nmax_returns = 1");
    let one_leg = one_leg.split("[[leg]]\nposition_m = [-0.6").next().unwrap().replace("= 1.5\n", "= 0.7\n");
    fs::write(dir.path().join("still.toml"), &one_leg).unwrap();
    succeed(dir.path(), &["run", "still.toml", "-q", "-o", "still.csv"]);
    let fit = ["fit", "still.csv", "--still-at", "0.3,-0.2,1.5", "-o", "p.toml"];
    let out = succeed(dir.path(), &[&fit[..], &["--json"]].concat());
    let figures: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let seen = figures["pulses"].as_u64().unwrap() as usize;
    assert!(seen.abs_diff(ROWS) < 5, "{figures}");
    let table = fs::read_to_string(dir.path().join("p.pattern.csv")).unwrap();
    for line in table.lines().skip(1) {
        let fields: Vec<f64> = line.split(',').map(|field| field.parse().unwrap()).collect();
        let number = (fields[0] * 1e3).round();
        let (found, expected) = (direction([fields[1], fields[2]]), direction(angles(number as usize)));
        let off = (0..3).map(|i| (found[i] - expected[i]).abs()).fold(0.0, f64::max);
        // Coordinates have a tenth of a millimetre.
        assert!(off < 5e-4 && (fields[0] - number * 1e-3).abs() < 1e-6, "{line}: off by {off}");
    }
    let scene = format!("{}#room", fixture("room/scene.xml").display());
    succeed(dir.path(), &["run", "p.toml", "--scene", &scene, "-q", "-o", "again.csv"]);
    let points = |name: &str| fs::read_to_string(dir.path().join(name)).unwrap().lines().count();
    assert!(points("again.csv").abs_diff(points("still.csv")) < 10);
    let again = run(dir.path(), &fit);
    assert!(!again.status.success() && text(&again.stderr).contains("exists"), "{}", text(&again.stderr));
}
