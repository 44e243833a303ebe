//! Spinning sensors: the pattern of a calibration file, pulse by pulse; what is estimated from recordings.

use crate::common::{folder, missing, recording, run, succeed, text};
use std::f64::consts::TAU;
use std::fs;

const SENSOR: &str = r#"{
  "beam_intrinsics": {
    "beam_altitude_angles": [20.5, 0.25, -17.75], "beam_azimuth_angles": [4.2, -1.4, -4.2],
    "lidar_origin_to_beam_origin_mm": 27.67
  },
  "config_params": {"lidar_mode": "64x10"},
  "lidar_data_format": {"columns_per_frame": 64, "pixels_per_column": 3},
  "sensor_info": {"prod_line": "OS-0-32"}
}"#;

/// Columns of the pulses of the pipeline, by their names in the header.
fn pulses(pipeline: &str, names: &[&str]) -> Vec<Vec<f64>> {
    let dir = folder();
    fs::write(dir.path().join("sensor.json"), SENSOR).unwrap();
    let room = "v -9 -9 -9\nv 9 -9 -9\nv 9 9 -9\nv -9 9 9\nf 1 2 3 4\n";
    fs::write(dir.path().join("room.obj"), room).unwrap();
    fs::write(dir.path().join("p.toml"), pipeline).unwrap();
    let out = succeed(dir.path(), &["pulses", "p.toml", "-q"]);
    let table = text(&out.stdout);
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let at: Vec<usize> = names.iter().map(|name| header.iter().position(|h| h == name).unwrap()).collect();
    let row = |line: &str| {
        let values: Vec<&str> = line.split(',').collect();
        at.iter().map(|i| values[*i].parse().unwrap()).collect()
    };
    lines.map(row).collect()
}

const PIPELINE: &str = "scene = \"room.obj\"\n[platform]\nkind = \"static\"\n[[leg]]\nposition_m = [0, 0, 0]\n[scanner]\ncatalogue \
     = \"sensor.json\"\n";

#[test]
fn the_pulses_of_a_frame_are_those_of_the_calibration() {
    let names = ["time[ns]", "x[m]", "y[m]", "z[m]", "dx", "dy", "dz", "device", "pulse"];
    let found = pulses(PIPELINE, &names);
    assert_eq!(found.len(), 3 * 64, "one frame");
    let (altitudes, azimuths) = ([20.5f64, 0.25, -17.75], [4.2f64, -1.4, -4.2]);
    for row in &found {
        let [time, x, y, z, dx, dy, dz, device, pulse] = row[..] else { panic!("{row:?}") };
        let (beam, column) = (device as usize, pulse - 1.0);
        // The formula of the manual, in the sensor's axes: x towards column 0, y to the left of it.
        let encoder = -TAU * column / 64.0;
        let angle = encoder - azimuths[beam].to_radians();
        let up = altitudes[beam].to_radians();
        let (forward, left) = (angle.cos() * up.cos(), angle.sin() * up.cos());
        let expected = [-left, forward, up.sin(), -0.02767 * encoder.sin(), 0.02767 * encoder.cos(), 0.0];
        for (value, expected) in [dx, dy, dz, x, y, z].into_iter().zip(expected) {
            assert!((value - expected).abs() < 1e-12, "beam {beam}, column {column}: {row:?}");
        }
        assert!(
            (time - found[0][0] - column * 1e9 / 640.0).abs() < 1.0,
            "all beams of a column fire at once"
        );
    }
}

#[test]
fn settings_change_the_turn() {
    let text = format!("{PIPELINE}[settings]\nhead_stop_deg = -717\n");
    assert_eq!(pulses(&text, &["pulse"]).len(), 2 * 3 * 64);
}

/// Noise by the recordings, and what a sensor with that noise records again.
#[test]
fn real_revolutions_are_fitted() {
    // The recordings are Parquet files compressed with Zstandard.
    if !cfg!(feature = "parquet-zstd") {
        return missing("parquet-zstd", "cargo test --features parquet-zstd");
    }
    for (name, beams, classes) in [("os0_128", 128, 5), ("os1_32", 32, 1), ("os2_128", 128, 3)] {
        let [found, calibration] =
            ["parquet", "json"].map(|ending| recording(&format!("spinning/{name}.{ending}")));
        let (Some(found), Some(calibration)) = (found, calibration) else { return };
        let [found, calibration] = [found, calibration].map(|path| path.display().to_string());
        let dir = folder();
        let fit = [
            "fit",
            &found,
            "--calibration",
            &calibration,
            "-o",
            "s.toml",
            "--planes",
            "p.obj",
            "--json",
            "-q",
        ];
        let out = succeed(dir.path(), &fit);
        let figures: serde_json::Value = serde_json::from_str(&text(&out.stdout)).unwrap();
        let value = |key: &str| figures[key][0].as_f64().unwrap();
        assert!((0.003..0.015).contains(&value("constant_m")), "{name}: {figures}");
        assert!((0.4..1.0).contains(&value("footprint")), "{name}: {figures}");
        // The columns that were not fitted scatter as the law says.
        let is_met = |class: &&serde_json::Value| {
            let [law, scatter] = ["law_m", "scatter_m"].map(|key| class[key][1].as_f64().unwrap());
            class["by"] == "distance" && (law / scatter - 1.0).abs() < 0.2
        };
        let met = figures["classes"].as_array().unwrap().iter().filter(is_met).count();
        assert!(met >= classes, "{name}: {met} classes of distance within 20 %: {figures}");
        // The pipeline runs over the planes.
        let points = succeed(dir.path(), &["run", "s.toml", "-o", "-", "--format", "xyz", "-q"]);
        let points = text(&points.stdout).lines().count();
        assert!(points > 10 * beams, "{name}: {points} points");
        let again = run(dir.path(), &fit);
        assert!(text(&again.stderr).contains("--force"), "{}", text(&again.stderr));
    }
}

/// With the calibration of another sensor, walls are bent: nothing is written, or no noise, with a warning.
#[test]
fn a_calibration_of_another_sensor_is_noticed() {
    if !cfg!(feature = "parquet-zstd") {
        return missing("parquet-zstd", "cargo test --features parquet-zstd");
    }
    for (name, calibration, status, said) in [
        ("os1_32", "os0_128", Some(2), "has rows of 32 beams, the sensor of the calibration 128"),
        ("os0_128", "os1_32", Some(2), "calibration file of the sensor that recorded them"),
        ("os2_128", "os0_128", Some(0), "`range_noise` is left out: the noise of strong echoes is 5"),
    ] {
        let found = recording(&format!("spinning/{name}.parquet"));
        let (Some(found), Some(json)) = (found, recording(&format!("spinning/{calibration}.json"))) else {
            return;
        };
        let [found, json] = [found, json].map(|path| path.display().to_string());
        let dir = folder();
        let out = run(dir.path(), &["fit", &found, "--calibration", &json, "-o", "s.toml"]);
        assert_eq!(out.status.code(), status, "{name}: {}", text(&out.stderr));
        assert!(text(&out.stderr).contains(said), "{name}: {}", text(&out.stderr));
    }
}

#[test]
fn recordings_that_are_none_are_refused() {
    let dir = folder();
    fs::write(dir.path().join("sensor.json"), SENSOR).unwrap();
    fs::write(dir.path().join("text.parquet"), "no Parquet").unwrap();
    for (args, said) in [
        (&["fit", "text.parquet", "--calibration", "sensor.json", "-o", "s.toml"][..], "text.parquet"),
        (&["fit", "none.parquet", "--calibration", "sensor.json", "-o", "s.toml"], "none.parquet"),
        (&["fit", "text.parquet", "--calibration", "none.json", "-o", "s.toml"], "none.json"),
        (&["fit", "text.parquet", "--planes", "p.obj", "-o", "s.toml"], "--calibration"),
    ] {
        let out = run(dir.path(), args);
        assert!(!out.status.success() && text(&out.stderr).contains(said), "{said}: {}", text(&out.stderr));
        assert!(!dir.path().join("s.toml").exists());
    }
}

#[test]
fn names_of_all_files_are_checked_before_a_recording_is_read() {
    let dir = folder();
    fs::write(dir.path().join("sensor.json"), SENSOR).unwrap();
    fs::write(dir.path().join("text.parquet"), "no Parquet").unwrap();
    fs::write(dir.path().join("p.mtl"), "precious").unwrap();
    let fit = ["fit", "text.parquet", "--calibration", "sensor.json", "-o"];
    for (args, said) in [
        (&["s.toml", "--planes", "p.obj"][..], "p.mtl exists already"),
        (&["sensor.json", "--force"], "sensor.json is read"),
        (&["s.toml", "--planes", "text.parquet", "--force"], "the file is OBJ, not parquet"),
    ] {
        let out = run(dir.path(), &[&fit[..], args].concat());
        assert!(text(&out.stderr).contains(said), "{said}: {}", text(&out.stderr));
    }
}
