//! Ray clouds, PCD, and LAS without extra bytes, read back by other programs.

use crate::common::{self, fixture, folder, python_with_laspy, succeed, text};
use std::path::Path;
use std::process::Command;

fn forest() -> String {
    fixture("forest/survey.xml").to_str().unwrap().to_owned()
}

fn judge(python: &Path, folder: &Path, script: &str) {
    let judged = Command::new(python).arg("-c").arg(script).current_dir(folder).output().unwrap();
    assert!(judged.status.success(), "{}", text(&judged.stderr));
}

#[test]
fn ray_clouds_lead_from_each_point_to_its_sensor() {
    let dir = folder();
    let survey = forest();
    let columns = "X,Y,Z,GpsTime,BeamOriginX,BeamOriginY,BeamOriginZ,NumberOfReturns";
    let sinks = ["-o", "a.raycloud.ply", "-o", "a.csv", "--columns", columns, "--misses"];
    succeed(dir.path(), &[&["run", &survey, "-q"][..], &sinks].concat());
    let bytes = std::fs::read(dir.path().join("a.raycloud.ply")).unwrap();
    let end = memchr::memmem::find(&bytes, b"end_header\n").unwrap() + 11;
    let head = text(&bytes[..end]);
    let properties: Vec<&str> = head.lines().filter_map(|l| l.strip_prefix("property ")).collect();
    assert_eq!(
        properties.join(","),
        "double x,double y,double z,double time,float nx,float ny,float nz,uchar red,uchar green,uchar blue,uchar alpha"
    );
    let csv = std::fs::read_to_string(dir.path().join("a.csv")).unwrap();
    let rows: Vec<Vec<f64>> =
        csv.lines().skip(1).map(|l| l.split(',').map(|f| f.parse().unwrap()).collect()).collect();
    let rays: Vec<&[u8]> = bytes[end..].chunks_exact(48).collect();
    assert_eq!((rays.len(), (bytes.len() - end) % 48), (rows.len(), 0));
    assert!(head.contains(&format!("element vertex {}\n", rows.len())));
    let double = |ray: &[u8], i: usize| f64::from_le_bytes(ray[8 * i..8 * i + 8].try_into().unwrap());
    let float =
        |ray: &[u8], i: usize| f64::from(f32::from_le_bytes(ray[32 + 4 * i..36 + 4 * i].try_into().unwrap()));
    let (mut hits, mut misses) = (0, 0);
    for (ray, row) in rays.iter().zip(&rows) {
        assert!((double(ray, 3) - row[3]).abs() < 1e-6);
        for axis in 0..3 {
            // The end of the ray and the vector add up to the sensor.
            assert!((double(ray, axis) + float(ray, axis) - row[4 + axis]).abs() < 1e-3, "{row:?}");
        }
        if row[7] > 0.0 {
            hits += 1;
            assert!((double(ray, 2) - row[2]).abs() < 1e-3 && ray[47] == 255);
        } else {
            misses += 1;
            let length = (0..3).map(|axis| float(ray, axis).powi(2)).sum::<f64>().sqrt();
            assert!((length - 100.0).abs() < 1e-3 && ray[47] == 0);
        }
    }
    assert!(hits > 1000 && misses > 10, "{hits} {misses}");
}

#[test]
fn pypcd4_reads_points_near_and_far() {
    let Some(python) = common::python("pypcd4, numpy") else { return };
    let dir = folder();
    let survey = forest();
    let columns = "X,Y,Z,Amplitude,GpsTime,Device,ReturnNumber,NumberOfReturns,Classification";
    succeed(dir.path(), &["run", &survey, "-q", "-o", "a.pcd", "-o", "a.csv", "--columns", columns]);
    // In UTM coordinates.
    let airborne = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/airborne.toml");
    let far = ["-o", "b.pcd", "-o", "b.csv", "--columns", columns];
    succeed(dir.path(), &[&["run", airborne.to_str().unwrap(), "-q"][..], &far].concat());
    judge(
        &python,
        dir.path(),
        r#"
import re
import numpy as np
from pypcd4 import PointCloud

for name in ("a", "b"):
    cloud = PointCloud.from_path(name + ".pcd")
    rows = np.loadtxt(name + ".csv", delimiter=",", skiprows=1)
    assert cloud.fields == ("x", "y", "z", "intensity", "time", "ring", "return_number", "number_of_returns", "label"), cloud.fields
    assert cloud.points == len(rows) > 1000
    found = cloud.numpy().astype(float)
    comment = open(name + ".pcd", "rb").read(400).decode("latin-1")
    offset = np.array(re.search(r'add (\S+) (\S+) (\S+) to x y z', comment).groups(), float)
    assert np.abs(found[:, :3] + offset - rows[:, :3]).max() < 1.1e-3
    times = cloud.pc_data["time"] if hasattr(cloud, "pc_data") else found[:, 4]
    assert np.abs(times - rows[:, 4]).max() < 1e-6
    for column in (5, 6, 7, 8):
        assert (found[:, column] == rows[:, column]).all(), column
"#,
    );
}

#[test]
fn laspy_finds_as_many_extra_bytes_as_were_asked_for() {
    let Some(python) = python_with_laspy() else { return };
    let dir = folder();
    let survey = forest();
    for which in ["all", "helios", "none"] {
        let names = [format!("{which}.las"), format!("{which}.laz")];
        succeed(dir.path(), &["run", &survey, "-q", "--las-extra", which, "-o", &names[0], "-o", &names[1]]);
    }
    judge(
        &python,
        dir.path(),
        r#"
import laspy
expected = {"all": 7, "helios": 4, "none": 0}
whole = laspy.read("all.las")
for name, count in expected.items():
    for end in (".las", ".laz"):
        las = laspy.read(name + end)
        assert len(list(las.point_format.extra_dimension_names)) == count, (name, end)
        assert las.header.point_format.id == 6 and len(las.points) == len(whole.points) > 1000
        assert (las.X == whole.X).all() and (las.gps_time == whole.gps_time).all()
        if count == 0:
            assert las.header.point_format.size == 30
"#,
    );
}

#[test]
fn pye57_finds_a_scan_with_its_pose_for_each_leg() {
    let Some(python) = common::python("pye57, numpy") else { return };
    let dir = folder();
    let room = fixture("room/survey.xml");
    let columns = "X,Y,Z,Amplitude,GpsTime,ReturnNumber,NumberOfReturns,PointSourceId,BeamOriginX,BeamOriginY,BeamOriginZ";
    let sinks = ["-o", "a.e57", "-o", "a.csv", "--columns", columns];
    succeed(dir.path(), &[&["run", room.to_str().unwrap(), "-q"][..], &sinks].concat());
    judge(
        &python,
        dir.path(),
        r#"
import numpy as np
import pye57

rows = np.loadtxt("a.csv", delimiter=",", skiprows=1)
file = pye57.E57("a.e57")
legs = [rows[rows[:, 7] == leg] for leg in np.unique(rows[:, 7])]
assert file.scan_count == len(legs) >= 1, file.scan_count
for i, leg in enumerate(legs):
    header = file.get_header(i)
    assert header.point_count == len(leg) > 100
    assert np.abs(header.translation - leg[0, 8:11]).max() < 1e-6
    assert {"timeStamp", "returnIndex", "returnCount"} <= set(header.point_fields)
    # pye57 reads no times and no return numbers.
    scan = file.read_scan_raw(i, ignore_unsupported_fields=True)
    found = np.column_stack([scan["cartesian" + axis] for axis in "XYZ"]) + header.translation
    assert np.abs(found - leg[:, :3]).max() < 1e-4
    assert np.abs(scan["intensity"] / leg[:, 3] - 1).max() < 1e-4
"#,
    );
}
