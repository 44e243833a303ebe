//! MCAP, read back by the packages `mcap` and `mcap-ros2-support`: messages, times, places in the axes of the scanner.

use crate::common::{self, fixture, folder, succeed, text};
use std::fs;
use std::process::Command;

const COLUMNS: &str =
    "GpsTime,ScannerX,ScannerY,ScannerZ,Device,ReturnNumber,NumberOfReturns,Classification,Amplitude";

/// Compares the points of a.mcap with those of a.csv and prints the number of messages, the shortest distance of their
/// stamps, and the greatest time within one.
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
assert statistics.message_count == len(rows) == statistics.chunk_count
assert found.shape == wanted.shape, (found.shape, wanted.shape)
assert np.abs(found[:, 0] - wanted[:, 0]).max() < 1e-6
assert np.abs(found[:, 1:4] - wanted[:, 1:4]).max() < 1e-3
assert (found[:, 4:8] == wanted[:, 4:8]).all()
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
