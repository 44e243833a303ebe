//! Ray clouds, PCD, E57, and LAS without extra bytes: compared with tables, and read back by other programs.

use crate::common::{self, fixture, folder, forest, judge, python_with_laspy, succeed, text};
use e57::{CartesianCoordinate, E57Reader};
use std::path::Path;

/// The rows of a table of numbers below its heading.
fn rows(path: &Path) -> Vec<Vec<f64>> {
    let csv = std::fs::read_to_string(path).unwrap();
    csv.lines().skip(1).map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect()
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
    let rows = rows(&dir.path().join("a.csv"));
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
fn pcd_holds_the_points_of_the_table() {
    let dir = folder();
    let columns = "X,Y,Z,Amplitude,GpsTime,Device,ReturnNumber,NumberOfReturns,Classification";
    succeed(dir.path(), &["run", &forest(), "-q", "-o", "a.pcd", "-o", "a.csv", "--columns", columns]);
    let (bytes, rows) = (std::fs::read(dir.path().join("a.pcd")).unwrap(), rows(&dir.path().join("a.csv")));
    let end = memchr::memmem::find(&bytes, b"DATA binary\n").unwrap() + 12;
    let head = text(&bytes[..end]);
    assert!(head.contains("\nSIZE 4 4 4 4 8 2 1 1 4\n") && head.contains("# add 0 0 0 to x y z"), "{head}");
    assert!(head.contains(&format!("\nPOINTS {}\n", rows.len())) && rows.len() > 1000, "{head}");
    assert_eq!(bytes.len() - end, 32 * rows.len());
    for (point, row) in bytes[end..].chunks_exact(32).zip(&rows) {
        let float = |i: usize| f64::from(f32::from_le_bytes(point[4 * i..4 * i + 4].try_into().unwrap()));
        assert!((0..3).all(|axis| (float(axis) - row[axis]).abs() < 1e-3), "{row:?}");
        // The table has nine decimals.
        assert!((float(3) - row[3]).abs() < 1e-9 + 1e-6 * row[3], "{row:?}");
        assert!((f64::from_le_bytes(point[16..24].try_into().unwrap()) - row[4]).abs() < 1e-6, "{row:?}");
        let ring = f64::from(u16::from_le_bytes([point[24], point[25]]));
        let class = f64::from(i32::from_le_bytes(point[28..32].try_into().unwrap()));
        assert_eq!([ring, point[26].into(), point[27].into(), class], row[5..9]);
    }
}

#[test]
fn las_without_extra_bytes_holds_the_same_points() {
    let dir = folder();
    let [all, helios, none] = ["all", "helios", "none"].map(|which| {
        let name = format!("{which}.las");
        succeed(dir.path(), &["run", &forest(), "-q", "--las-extra", which, "-o", &name]);
        std::fs::read(dir.path().join(name)).unwrap()
    });
    // Point format 6 has 30 bytes.
    let points = |las: &[u8]| -> Vec<Vec<u8>> {
        let start = u32::from_le_bytes(las[96..100].try_into().unwrap()) as usize;
        let length = u16::from_le_bytes(las[105..107].try_into().unwrap()).into();
        las[start..].chunks_exact(length).map(<[u8]>::to_vec).collect()
    };
    let (all, helios, none) = (points(&all), points(&helios), points(&none));
    assert!(
        none.len() > 1000 && none[0].len() == 30 && helios[0].len() > 30 && all[0].len() > helios[0].len()
    );
    assert!(none.len() == all.len() && none.len() == helios.len());
    for ((none, helios), all) in none.iter().zip(&helios).zip(&all) {
        assert!(all[..helios.len()] == helios[..] && helios[..30] == none[..]);
    }
}

#[test]
fn e57_has_a_scan_with_its_pose_for_each_leg() {
    let dir = folder();
    let room = fixture("room/survey.xml").to_str().unwrap().to_owned();
    let columns = "X,Y,Z,PointSourceId";
    succeed(dir.path(), &["run", &room, "-q", "-o", "a.e57", "-o", "a.csv", "--columns", columns]);
    let rows = rows(&dir.path().join("a.csv"));
    let mut file = E57Reader::from_file(dir.path().join("a.e57")).unwrap();
    let scans = file.pointclouds();
    assert_eq!(scans.len(), 2);
    // Positions of the legs, and 1.45 m above them the beam.
    for (leg, (scan, position)) in scans.iter().zip([[-1.66, -1.122, 1.45], [1.802, 1.546, 1.45]]).enumerate()
    {
        let pose = scan.transform.clone().unwrap().translation;
        let off = [pose.x - position[0], pose.y - position[1], pose.z - position[2]];
        assert!(off.iter().all(|d| d.abs() < 1e-9), "{pose:?}");
        let own: Vec<&Vec<f64>> = rows.iter().filter(|row| row[3] == leg as f64 + 1.0).collect();
        assert!(own.len() as u64 == scan.records && own.len() > 1000);
        let mut points = file.pointcloud_simple(scan).unwrap();
        points.apply_pose(true);
        for (point, row) in points.zip(own) {
            let CartesianCoordinate::Valid { x, y, z } = point.unwrap().cartesian else { panic!("no point") };
            let near = [x, y, z].iter().zip(row).all(|(found, expected)| (found - expected).abs() < 1e-4);
            assert!(near, "{x} {y} {z} {row:?}");
        }
    }
}

#[cfg(target_os = "linux")]
#[test]
fn tiles_of_e57_need_few_open_files() {
    let dir = folder();
    let limited = "ulimit -n 64; exec \"$0\" run \"$1\" -q -j 1 -o tiles --format e57 --tile 2";
    let program = common::vlscan(dir.path());
    let done = std::process::Command::new("sh")
        .args(["-c", limited])
        .arg(program.get_program())
        .arg(forest())
        .current_dir(dir.path())
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(common::files(&dir.path().join("tiles")).len() > 100);
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
