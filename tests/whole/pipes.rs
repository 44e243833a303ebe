//! Streams: points on stdout, poses from stdin, formats as other programs read them.

use crate::common::{feed, fixture, folder, forest, python_with_laspy, run, succeed, text};
use std::fs;
use std::process::Command;

#[test]
fn stdout_carries_the_same_points_as_the_file() {
    let dir = folder();
    for format in ["xyz", "las", "laz", "ply", "ply-ascii", "csv", "arrow", "parquet"] {
        let name = format!("a.{}", if format == "ply-ascii" { "ascii.ply" } else { format });
        succeed(dir.path(), &["run", &forest(), "-q", "-o", &name, "--format", format]);
        let piped = run(dir.path(), &["run", &forest(), "-q", "-o", "-", "--format", format]);
        assert!(piped.status.success(), "{}", text(&piped.stderr));
        let file = fs::read(dir.path().join(&name)).unwrap();
        assert!(file.len() > 1000);
        assert!(piped.stdout == file, "{format} differs between a pipe and a file");
        assert!(piped.stderr.is_empty(), "-q still says: {}", text(&piped.stderr));
    }
}

#[test]
#[ignore = "minutes; part of `.ci/run --long`"]
fn poses_from_stdin_become_points() {
    let dir = folder();
    let poses = fs::read(fixture("flight.csv")).unwrap();
    let pipeline = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/als.toml");
    let pipeline = pipeline.to_str().unwrap();
    let out = feed(dir.path(), &["run", pipeline, "--trajectory", "-", "-o", "-", "--format", "xyz"], &poses);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let points = text(&out.stdout);
    assert!(points.lines().count() > 1000, "only {} points", points.lines().count());
    assert!(points.lines().all(|l| l.split(' ').count() == 11), "columns are missing");

    // The same poses from a file, and with other chunks, give the same bytes.
    let file = fixture("flight.csv");
    let args = [
        "run",
        pipeline,
        "--trajectory",
        file.to_str().unwrap(),
        "-o",
        "-",
        "--format",
        "xyz",
        "--chunk-size",
        "64",
    ];
    let again = run(dir.path(), &args);
    assert!(again.stdout == out.stdout, "a file and a pipe of the same poses differ");
}

#[test]
fn las_and_laz_are_read_by_laspy() {
    let Some(python) = python_with_laspy() else { return };
    let dir = folder();
    succeed(
        dir.path(),
        &["run", &forest(), "-q", "-o", "a.las", "-o", "a.laz", "-o", "a.xyz", "--seed", "3"],
    );
    let script = r#"
import laspy, numpy as np
text = np.loadtxt("a.xyz", usecols=(0, 1, 2, 3, 5, 6, 9, 10))
for name in ("a.las", "a.laz"):
    las = laspy.read(name)
    h = las.header
    assert h.version.minor == 4 and h.point_format.id == 6, (h.version, h.point_format)
    assert len(las) == len(text) == h.point_count, (len(las), len(text), h.point_count)
    xyz = np.column_stack([las.x, las.y, las.z])
    assert np.abs(xyz - text[:, :3]).max() < 1.6e-4, np.abs(xyz - text[:, :3]).max()
    assert np.allclose(h.mins, xyz.min(axis=0)) and np.allclose(h.maxs, xyz.max(axis=0))
    assert (las.return_number == text[:, 4]).all() and (las.number_of_returns == text[:, 5]).all()
    assert (las.classification == text[:, 6]).all()
    assert np.abs(las.gps_time - text[:, 7]).max() < 1e-8
    assert np.abs(las["heliosAmplitude"] - text[:, 3]).max() < 1e-4
    counts = [int((las.return_number == i + 1).sum()) for i in range(15)]
    assert list(h.number_of_points_by_return[:15]) == counts, (list(h.number_of_points_by_return), counts)
    assert (las.point_source_id > 0).all() and np.ptp(las.scan_angle) > 0
"#;
    let judged = Command::new(python).arg("-c").arg(script).current_dir(dir.path()).output().unwrap();
    assert!(judged.status.success(), "{}", text(&judged.stderr));
}

#[test]
fn a_written_trajectory_can_be_flown_again() {
    let dir = folder();
    let survey = fixture("terrain/survey.xml");
    let survey = survey.to_str().unwrap();
    succeed(dir.path(), &["run", survey, "-q", "-o", "a.xyz", "--trajectory-out", "flown.csv"]);
    let poses = fs::read_to_string(dir.path().join("flown.csv")).unwrap();
    assert!(poses.lines().count() > 2, "no poses in\n{poses}");
    succeed(dir.path(), &["run", survey, "-q", "-o", "b.xyz", "--trajectory", "flown.csv"]);
    let echoes = |name: &str| fs::read_to_string(dir.path().join(name)).unwrap().lines().count();
    assert!(echoes("b.xyz") > 0, "the recorded flight sees nothing");
}

#[test]
fn points_are_counted_in_the_output_whose_reader_stays() {
    let dir = folder();
    let run = format!(
        "{} run {} -o - --format xyz -o also.laz --strict | head -1 >/dev/null",
        env!("CARGO_BIN_EXE_vlscan"),
        fixture("forest/survey.xml").display()
    );
    let out = Command::new("bash").args(["-c", &run]).current_dir(dir.path()).output().unwrap();
    let said = text(&out.stderr);
    assert!(said.contains("also.laz") && said.contains("41.05 k points (0.69 per pulse)"), "{said}");
}

#[test]
fn a_flight_without_poses_is_called_empty_and_not_misplaced() {
    let dir = folder();
    let pipeline = fixture("../pipelines/als.toml");
    for (poses, told) in [("", "is empty"), ("time,x,y,z,roll,pitch,yaw\n", "holds 0 poses")] {
        let out = feed(
            dir.path(),
            &["run", pipeline.to_str().unwrap(), "-o", "a.xyz", "--force"],
            poses.as_bytes(),
        );
        let said = text(&out.stderr);
        assert!(said.contains(told) && !said.contains("away from the scene"), "{said}");
    }
}
