//! MCAP, read back by the packages `mcap` and `mcap-ros2-support`: messages, times, places in the axes of the
//! scanner.

use crate::common::{self, fixture, folder, succeed, text};
use std::fs;
use std::process::Command;

const COLUMNS: &str =
    "GpsTime,ScannerX,ScannerY,ScannerZ,Device,ReturnNumber,NumberOfReturns,Classification,Amplitude";

/// Compares the points of a.mcap with those of a.csv and prints the number of messages, the shortest distance
/// of their stamps, and the greatest time within one.
const SCRIPT: &str = r#"
import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

TYPES = {2: "u1", 4: "<u2", 5: "<i4", 7: "<f4"}
with open("a.mcap", "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    statistics = reader.get_summary().statistics
    assert [m.metadata["state"] for m in reader.iter_metadata()] == ["complete"]
    rows, stamps, longest = [], [], 0
    for schema, channel, message, cloud in reader.iter_decoded_messages(topics=["/points"]):
        assert schema.name == "sensor_msgs/msg/PointCloud2" and cloud.header.frame_id == "lidar"
        assert cloud.is_dense and not cloud.is_bigendian and cloud.height == 1
        points = np.frombuffer(bytes(cloud.data), np.dtype({
            "names": [f.name for f in cloud.fields],
            "formats": [TYPES[f.datatype] for f in cloud.fields],
            "offsets": [f.offset for f in cloud.fields],
            "itemsize": cloud.point_step,
        }))
        assert len(points) == cloud.width > 0
        stamp = cloud.header.stamp.sec + cloud.header.stamp.nanosec / 1e9
        assert abs(message.log_time / 1e9 - stamp) < 1e-9
        assert points["time"].min() >= 0
        longest = max(longest, points["time"].max())
        stamps.append(stamp)
        names = ["x", "y", "z", "ring", "return_number", "number_of_returns", "label", "intensity"]
        rows.append(np.column_stack([stamp + points["time"].astype(float)] + [points[n] for n in names]))
found, wanted = np.concatenate(rows), np.loadtxt("a.csv", delimiter=",", skiprows=1)
assert statistics.channel_message_counts[1] == len(rows) and statistics.message_count == statistics.chunk_count
assert found.shape == wanted.shape, (found.shape, wanted.shape)
assert np.abs(found[:, 0] - wanted[:, 0]).max() < 1e-6
assert np.abs(found[:, 1:4] - wanted[:, 1:4]).max() < 1e-3
# `ring` is the row by elevation: the lasers of the VLP-16 in the order of firing are -15, 1, -13, 3, ... degrees.
ring = np.array([device // 2 + 8 * (device % 2) for device in range(16)])
assert (found[:, 4] == ring[wanted[:, 4].astype(int)]).all()
assert (found[:, 5:8] == wanted[:, 5:8]).all()
assert np.abs(found[:, 8] / wanted[:, 8] - 1).max() < 1e-3
print(len(stamps), min(np.diff(stamps)).round(6), longest.round(2))
"#;

/// A head that turns five times per second, for two seconds, in a room.
fn spinning() -> String {
    let scene = fixture("room/scene.xml");
    format!(
        r#"<?xml version="1.0"?><document>
<survey name="s" scene="{}#room" platform="data/platforms.xml#tripod" scanner="data/scanners_tls.xml#vlp16">
  <leg><platformSettings x="0.3" y="-0.2" z="0"/>
  <scannerSettings active="true" pulseFreq_hz="18750" headRotatePerSec_deg="1800" headRotateStart_deg="0"
    headRotateStop_deg="3600"/></leg>
</survey></document>"#,
        scene.display()
    )
}

#[test]
fn points_are_read_in_the_world() {
    let dir = folder();
    fs::write(dir.path().join("s.xml"), spinning()).unwrap();
    succeed(dir.path(), &["run", "s.xml", "-q", "-o", "a.mcap", "-o", "a.laz"]);
    let facts = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&succeed(dir.path(), &["info", name, "--json"]).stdout).unwrap()
    };
    let [log, cloud] = ["a.mcap", "a.laz"].map(facts);
    for name in ["points", "classes", "returns"] {
        assert_eq!(log[name], cloud[name], "{name}");
        assert!(!log[name].is_null(), "{name}: {log}");
    }
    let found = succeed(dir.path(), &["compare", "a.mcap", "a.laz", "--json"]);
    let found: serde_json::Value = serde_json::from_slice(&found.stdout).unwrap();
    let far = found["first_to_second"]["max_m"].as_f64().unwrap();
    assert!(far < 0.005, "{far}");
    let first = fs::read(dir.path().join("a.mcap")).unwrap();
    fs::write(dir.path().join("cut.mcap"), &first[..first.len() / 2]).unwrap();
    let cut = common::run(dir.path(), &["info", "cut.mcap"]);
    assert_eq!(cut.status.code(), Some(2));
    assert!(text(&cut.stderr).contains("is it truncated?"), "{}", text(&cut.stderr));
}

#[test]
fn a_message_is_a_revolution_or_a_span_of_time() {
    let Some(python) = common::python("mcap, mcap_ros2, numpy") else { return };
    for (more, expected) in [(&[][..], "10 0.2 0.2"), (&["--frame-s", "0.5"], "4 0.5 0.5")] {
        let dir = folder();
        fs::write(dir.path().join("s.xml"), spinning()).unwrap();
        let outputs = ["-o", "a.mcap", "-o", "a.csv", "--columns", COLUMNS];
        succeed(dir.path(), &[&["run", "s.xml", "-q"][..], &outputs, more].concat());
        let read = Command::new(&python).arg("-c").arg(SCRIPT).current_dir(dir.path()).output().unwrap();
        assert!(read.status.success(), "{}", text(&read.stderr));
        assert_eq!(text(&read.stdout).trim(), expected);
    }
}

#[test]
fn frames_without_mcap_are_refused() {
    let dir = folder();
    fs::write(dir.path().join("s.xml"), spinning()).unwrap();
    let out = common::run(dir.path(), &["run", "s.xml", "-o", "a.las", "--frame-s", "0.1"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("-o points.mcap"), "{}", text(&out.stderr));
}

/// Compares the poses of a.mcap with trajectory.csv and the points, moved by /tf, with those of a.csv.
const POSES: &str = r#"
import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

TYPES = {2: "u1", 4: "<u2", 5: "<i4", 7: "<f4"}
def matrix(q):
    x, y, z, w = q.x, q.y, q.z, q.w
    assert abs(x * x + y * y + z * z + w * w - 1) < 1e-9
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
poses, odometry, clouds = {}, [], []
with open("a.mcap", "rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    for schema, channel, message, ros in reader.iter_decoded_messages():
        if channel.topic == "/tf":
            assert schema.name == "tf2_msgs/msg/TFMessage"
            [t] = ros.transforms
            assert (t.header.frame_id, t.child_frame_id) == ("world", "velodyne")
            p = t.transform.translation
            stamp = t.header.stamp.sec * 10**9 + t.header.stamp.nanosec
            assert stamp == message.log_time
            poses[stamp] = (np.array([p.x, p.y, p.z]), matrix(t.transform.rotation))
        elif channel.topic == "/odom":
            assert schema.name == "nav_msgs/msg/Odometry"
            assert (ros.header.frame_id, ros.child_frame_id) == ("world", "velodyne")
            odometry.append((message.log_time, ros))
        else:
            assert ros.header.frame_id == "velodyne"
            dtype = np.dtype({"names": [f.name for f in ros.fields], "formats": [TYPES[f.datatype] for f in ros.fields],
                              "offsets": [f.offset for f in ros.fields], "itemsize": ros.point_step})
            clouds.append((message.log_time, np.frombuffer(bytes(ros.data), dtype)))
stamps = np.array(sorted(poses))
assert stamps.tolist() == [t for t, _ in odometry] and np.diff(stamps).max() < 12e6
for stamp, ros in odometry:
    assert (poses[stamp][0] == [ros.pose.pose.position.x, ros.pose.pose.position.y, ros.pose.pose.position.z]).all()
# The velocity in the world is that of the vehicle.
moving = [poses[t][1] @ [o.twist.twist.linear.x, o.twist.twist.linear.y, o.twist.twist.linear.z] for t, o in odometry]
speeds = np.linalg.norm(moving, axis=1)
assert np.allclose(speeds, 4, atol=1e-3), speeds
found, wanted = [], np.loadtxt("a.csv", delimiter=",", skiprows=1)
for begin, points in clouds:
    for point in points:
        time = begin + float(point["time"]) * 1e9
        k = min(max(np.searchsorted(stamps, time), 1), len(stamps) - 1)
        (p0, r0), (p1, _) = poses[stamps[k - 1]], poses[stamps[k]]
        share = (time - stamps[k - 1]) / (stamps[k] - stamps[k - 1])
        found.append(p0 + share * (p1 - p0) + r0 @ [point["x"], point["y"], point["z"]])
assert np.abs(np.array(found) - wanted[:, :3]).max() < 2e-3
assert (np.concatenate([c["instance"] for _, c in clouds]) == wanted[:, 3]).all()
print(len(clouds))
"#;

/// A vehicle at 4 m/s for half a second in a room, at coordinates of a map, with a head that turns ten times
/// per second.
const DRIVE: &str = r#"
scene = "room.xml#room"
[platform]
catalogue = "data/platforms.xml#vehicle_linearpath"
[scanner]
catalogue = "data/scanners_tls.xml#vlp16"
accuracy_m = 0
[settings]
pulse_freq_hz = 18750
head_rate_deg_per_s = 3600
[[leg]]
position_m = [500000, 5400000, 0]
speed_m_per_s = 4
[[leg]]
position_m = [500001, 5400001.7, 0]
active = false
"#;

fn drive(dir: &std::path::Path) {
    let part = |class: u8, z: f64| {
        let name = format!("plane{class}");
        fs::write(
            dir.join(format!("{name}.obj")),
            format!("mtllib {name}.mtl\nusemtl {name}\nv -30 -30 {z}\nv 30 -30 {z}\nv 30 30 {z}\nv -30 30 {z}\nf 1 2 3 4\n"),
        )
        .unwrap();
        fs::write(
            dir.join(format!("{name}.mtl")),
            format!("newmtl {name}\nKd 1 1 1\nhelios_reflectance 50\nhelios_classification {class}\n"),
        )
        .unwrap();
        format!(
            "<part><filter type=\"objloader\"><param type=\"string\" key=\"filepath\" value=\"{name}.obj\"/></filter>\
             <filter type=\"translate\"><param type=\"vec3\" key=\"offset\" value=\"500000;5400000;0\"/></filter></part>"
        )
    };
    let scene = format!("<document><scene id=\"room\">{}{}</scene></document>", part(2, -2.0), part(6, 8.0));
    fs::write(dir.join("room.xml"), scene).unwrap();
    fs::write(dir.join("drive.toml"), DRIVE).unwrap();
}

#[test]
fn poses_take_points_to_the_world() {
    let Some(python) = common::python("mcap, mcap_ros2, numpy") else { return };
    let dir = folder();
    drive(dir.path());
    let outputs = ["-o", "a.mcap", "-o", "a.csv", "--columns", "X,Y,Z,ObjectId"];
    let names = ["--world-frame", "world", "--sensor-frame", "velodyne"];
    succeed(dir.path(), &[&["run", "drive.toml", "-q"][..], &outputs, &names].concat());
    let clouds: usize = common::judge(&python, dir.path(), POSES).trim().parse().unwrap();
    assert!((5..=7).contains(&clouds), "{clouds}");
    let threads = ["run", "drive.toml", "-q", "-o", "b.mcap", "-j", "1", "--chunk-size", "7"];
    succeed(dir.path(), &[&threads[..], &names].concat());
    assert!(fs::read(dir.path().join("a.mcap")).unwrap() == fs::read(dir.path().join("b.mcap")).unwrap());
    for (args, expected) in [
        (&["-o", "c.las", "--world-frame", "w"][..], "-o points.mcap"),
        (&["-o", "c.mcap", "--world-frame", "lidar"], "are both \"lidar\""),
    ] {
        let out = common::run(dir.path(), &[&["run", "drive.toml", "-q"][..], args].concat());
        assert!(
            out.status.code() == Some(2) && text(&out.stderr).contains(expected),
            "{}",
            text(&out.stderr)
        );
    }
}

/// Reads all records of a.mcap with their checksums, and compares that of the summary.
const SUMS: &str = r#"
import struct, zlib
from mcap.stream_reader import StreamReader

with open("a.mcap", "rb") as file:
    records = list(StreamReader(file, validate_crcs=True, emit_chunks=True).records)
by = lambda name: [record for record in records if type(record).__name__ == name]
assert by("Chunk") and all(zlib.crc32(chunk.data) == chunk.uncompressed_crc for chunk in by("Chunk"))
[end], [footer] = by("DataEnd"), by("Footer")
assert end.data_section_crc != 0
bytes = open("a.mcap", "rb").read()
# The last four bytes before the magic are the checksum of those from the summary on.
assert footer.summary_crc == struct.unpack("<I", bytes[-12:-8])[0] == zlib.crc32(bytes[footer.summary_start:-12])
print(len(by("Chunk")))
"#;

#[test]
fn every_part_of_a_file_has_a_checksum_and_any_changed_bit_is_found() {
    let dir = folder();
    drive(dir.path());
    succeed(dir.path(), &["run", "drive.toml", "-q", "-o", "a.mcap"]);
    if let Some(python) = common::python("mcap") {
        common::judge(&python, dir.path(), SUMS);
    }
    let bytes = fs::read(dir.path().join("a.mcap")).unwrap();
    let layout = ["--layout", "kitti", "-q"];
    // All parts: the first and the last bytes, and steps through the rest.
    let places =
        (0..60).chain((60..bytes.len()).step_by(bytes.len() / 60)).chain(bytes.len() - 60..bytes.len());
    for (i, at) in places.enumerate() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1 << (i % 8);
        fs::write(dir.path().join("b.mcap"), &damaged).unwrap();
        let out = common::run(dir.path(), &[&["frames", "b.mcap", "-o", "b"][..], &layout].concat());
        let message = text(&out.stderr);
        assert!(out.status.code() == Some(2) && message.contains("b.mcap"), "byte {at}: {message}");
        assert!(!dir.path().join("b").exists(), "byte {at} leaves frames");
    }
    succeed(dir.path(), &[&["frames", "a.mcap", "-o", "b"][..], &layout].concat());
}

#[test]
fn frames_that_are_interrupted_leave_nothing() {
    let dir = folder();
    drive(dir.path());
    succeed(dir.path(), &["run", "drive.toml", "-q", "-o", "a.mcap"]);
    let bytes = fs::read(dir.path().join("a.mcap")).unwrap();
    for (layout, signal) in [("kitti", "TERM"), ("nuscenes", "INT")] {
        let args = ["frames", "-", "-o", "out", "--layout", layout, "-q"];
        let mut child =
            common::vlscan(dir.path()).args(args).stdin(std::process::Stdio::piped()).spawn().unwrap();
        let mut stdin = child.stdin.take().unwrap();
        std::io::Write::write_all(&mut stdin, &bytes[..bytes.len() / 2]).unwrap();
        let started = std::time::Instant::now();
        while !dir.path().join("out").exists() {
            assert!(started.elapsed().as_secs() < 60, "{layout}: no frame is written");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let id = child.id().to_string();
        assert!(Command::new("kill").args(["-s", signal, &id]).status().unwrap().success());
        assert_eq!(child.wait().unwrap().code(), Some(130));
        assert!(!dir.path().join("out").exists(), "{layout}: {:?}", common::files(dir.path()));
    }
}

/// Reads both layouts as their users do, and compares them with the points in the world.
const LAYOUTS: &str = r#"
import json
import numpy as np

wanted = np.loadtxt("a.csv", delimiter=",", skiprows=1)
base = "kitti/sequences/00/"
pose = lambda row: np.vstack([np.reshape(row, (3, 4)), [0, 0, 0, 1]])
poses = [pose(row) for row in np.loadtxt(base + "poses.txt")]
times = np.loadtxt(base + "times.txt")
calibration = dict(line.split(":") for line in open(base + "calib.txt"))
assert set(calibration) == {"P0", "P1", "P2", "P3", "Tr"} and (pose(np.fromstring(calibration["Tr"], sep=" ")) == np.eye(4)).all()
world = pose(np.loadtxt(base + "world.txt").ravel())
assert np.allclose(poses[0], np.eye(4)) and times[0] == 0 and np.allclose(np.diff(times)[1:-1], 0.1, atol=2e-3)
assert abs(np.linalg.det(world[:3, :3]) - 1) < 1e-9
# The vehicle goes forward, which is x, and its track is as long as it drives.
assert poses[-1][0, 3] > 1 and abs(poses[-1][1, 3]) < 0.01
found, classes, objects = [], [], []
for i, frame in enumerate(poses):
    points = np.fromfile(f"{base}velodyne/{i:06}.bin", dtype=np.float32).reshape(-1, 4)
    label = np.fromfile(f"{base}labels/{i:06}.label", dtype=np.uint32)
    assert len(label) == len(points)
    found.append((world @ frame @ np.column_stack([points[:, :3], np.ones(len(points))]).T.astype(float)).T[:, :3])
    classes.append(label & 0xFFFF)
    objects.append(label >> 16)
assert np.abs(np.concatenate(found) - wanted[:, :3]).max() < 2e-3
assert (np.concatenate(classes) == wanted[:, 4]).all() and (np.concatenate(objects) == wanted[:, 3]).all()

table = lambda name: json.load(open(f"nuscenes/v1.0-vlscan/{name}.json"))
by_token = lambda name: {row["token"]: row for row in table(name)}
samples, data, egos = by_token("sample"), table("sample_data"), by_token("ego_pose")
[scene] = table("scene")
[sensor] = table("sensor")
[calibrated] = table("calibrated_sensor")
assert scene["nbr_samples"] == len(samples) == len(data) == len(poses) and calibrated["sensor_token"] == sensor["token"]
names = {row["index"]: row["name"] for row in table("category")}
assert names == {2: "ground", 6: "building"}
token, chain = scene["first_sample_token"], []
while token:
    chain.append(token)
    assert samples[token]["prev"] == (chain[-2] if len(chain) > 1 else "")
    token = samples[token]["next"]
assert chain[-1] == scene["last_sample_token"] and len(chain) == len(poses)
found, classes = [], []
for token in chain:
    [row] = [row for row in data if row["sample_token"] == token]
    points = np.fromfile("nuscenes/" + row["filename"], dtype=np.float32).reshape(-1, 5)
    ego = egos[row["ego_pose_token"]]
    w, x, y, z = ego["rotation"]
    r = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                  [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                  [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    found.append(points[:, :3].astype(float) @ r.T + ego["translation"])
    classes.append(np.fromfile(f"nuscenes/lidarseg/v1.0-vlscan/{row['token']}_lidarseg.bin", dtype=np.uint8))
    assert points[:, 4].max() <= 15 and np.isclose(points[:, 3].max(), 2 * np.fromfile(f"{base}velodyne/{len(found) - 1:06}.bin", dtype=np.float32)[3::4].max())
assert np.abs(np.concatenate(found) - wanted[:, :3]).max() < 2e-3
assert (np.concatenate(classes) == wanted[:, 4]).all()
print(len(poses))
"#;

#[test]
fn frames_are_data_sets_of_driving() {
    let Some(python) = common::python("numpy") else { return };
    let dir = folder();
    drive(dir.path());
    let outputs = ["-o", "a.mcap", "-o", "a.csv", "--columns", "X,Y,Z,ObjectId,Classification"];
    succeed(dir.path(), &[&["run", "drive.toml", "-q"][..], &outputs].concat());
    succeed(dir.path(), &["frames", "a.mcap", "-o", "kitti", "--layout", "kitti", "-q"]);
    let mcap = fs::read(dir.path().join("a.mcap")).unwrap();
    let layout = ["--layout", "nuscenes", "--intensity-factor", "2", "-q"];
    common::feed(dir.path(), &[&["frames", "-", "-o", "nuscenes"][..], &layout].concat(), &mcap);
    let frames: usize = common::judge(&python, dir.path(), LAYOUTS).trim().parse().unwrap();
    assert!((5..=7).contains(&frames), "{frames}");
    fs::write(dir.path().join("cut.mcap"), &mcap[..mcap.len() / 3]).unwrap();
    for (args, expected) in [
        (&["a.mcap", "-o", "kitti"][..], "00 exists"),
        (&["a.csv", "-o", "x"], "expected an MCAP log, found a table of text"),
        (&["cut.mcap", "-o", "y"], "truncated"),
    ] {
        let out = common::run(dir.path(), &[&["frames"], args, &["--layout", "kitti"]].concat());
        assert!(
            out.status.code() == Some(2) && text(&out.stderr).contains(expected),
            "{}",
            text(&out.stderr)
        );
    }
}

#[test]
fn rings_count_the_rows_of_a_scanner_from_the_lowest_up() {
    let dir = folder();
    fs::write(dir.path().join("s.xml"), spinning()).unwrap();
    let outputs = ["-o", "a.pcd", "-o", "a.csv", "--columns", "ScannerX,ScannerY,ScannerZ"];
    succeed(dir.path(), &[&["run", "s.xml", "-q"][..], &outputs].concat());
    let pcd = fs::read(dir.path().join("a.pcd")).unwrap();
    let end = memchr::memmem::find(&pcd, b"DATA binary\n").unwrap() + 12;
    let head = text(&pcd[..end]);
    // The tripod stands at (0.3, -0.2).
    assert!(head.contains("\nVIEWPOINT 0.3 -0.2 "), "{head}");
    let table = fs::read_to_string(dir.path().join("a.csv")).unwrap();
    let rows =
        table.lines().skip(1).map(|row| row.split(',').map(|v| v.parse().unwrap()).collect::<Vec<f64>>());
    let mut count = 0;
    for (point, row) in pcd[end..].chunks_exact(32).zip(rows) {
        let ring = u16::from_le_bytes([point[24], point[25]]);
        let elevation = row[2].atan2(row[0].hypot(row[1])).to_degrees();
        assert!((elevation - (2.0 * f64::from(ring) - 15.0)).abs() < 0.6, "ring {ring}: {elevation}");
        count += 1;
    }
    assert!(count > 1000);
}
