//! Boxes of moving objects: from the run to the layouts of KITTI and nuScenes, with their points.

use crate::common::{folder, run, succeed, text};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// A vehicle at 4 m/s for half a second, with a head that turns ten times per second and beams as thin as
/// rays.
const DRIVE: &str = r#"
scene = "street.xml#street"
[platform]
catalogue = "data/platforms.xml#vehicle_linearpath"
[scanner]
catalogue = "data/scanners_tls.xml#vlp16"
accuracy_m = 0
beam_divergence_rad = 0.00001
beam_divergence_y_rad = 0.00001
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

/// Writes a cuboid around the origin as a part, with this class.
fn cuboid(dir: &Path, name: &str, class: u8, size: [f64; 3]) {
    let [x, y, z] = size.map(|edge| 0.5 * edge);
    let corners = [[-x, -y, -z], [x, -y, -z], [x, y, -z], [-x, y, -z]];
    let corners = corners.into_iter().chain(corners.map(|[x, y, _]| [x, y, z]));
    let vertices: String = corners.map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    let faces = "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    fs::write(
        dir.join(format!("{name}.obj")),
        format!("mtllib {name}.mtl\nusemtl {name}\n{vertices}{faces}"),
    )
    .unwrap();
    let material = format!("newmtl {name}\nKd 1 1 1\nhelios_reflectance 50\nhelios_classification {class}\n");
    fs::write(dir.join(format!("{name}.mtl")), material).unwrap();
}

fn part(name: &str, id: &str, offset: [f64; 3], motion: &str) -> String {
    let [x, y, z] = offset;
    let (x, y) = (500_000.0 + x, 5_400_000.0 + y);
    format!(
        "<part id=\"{id}\"><filter type=\"objloader\"><param type=\"string\" key=\"filepath\" \
         value=\"{name}.obj\"/></filter><filter type=\"translate\"><param type=\"vec3\" key=\"offset\" \
         value=\"{x};{y};{z}\"/></filter>{motion}</part>"
    )
}

/// A street with a bus that goes north at 10 m/s, and a hut that turns at 125° per second.
fn street(dir: &Path) {
    cuboid(dir, "road", 2, [60.0, 60.0, 0.2]);
    cuboid(dir, "bus", 64, [2.0, 4.0, 4.0]);
    cuboid(dir, "hut", 65, [3.0, 2.0, 4.0]);
    // 0.016 s are 300 pulses.
    let north = r#"<dmotion id="n" loop="0"><motion type="translation" vec="0;0.16;0"/></dmotion>"#;
    let turn = r#"<dmotion id="t" loop="0"><motion type="rotation" axis="0;0;1" angle="2" selfMode="true"/></dmotion>"#;
    let parts = [
        part("road", "1", [0.0, 0.0, -2.1], ""),
        part("bus", "7", [7.0, -2.0, 0.0], north),
        part("hut", "hut", [-8.0, 2.0, 0.0], turn),
    ];
    let scene =
        format!("<document><scene id=\"street\" dynTimeStep=\"0.016\">{}</scene></document>", parts.concat());
    fs::write(dir.join("street.xml"), scene).unwrap();
    fs::write(dir.join("drive.toml"), DRIVE).unwrap();
}

/// The rows of a table without quotes, by the names of the columns.
fn rows(path: &Path) -> Vec<BTreeMap<String, String>> {
    let table = fs::read_to_string(path).unwrap();
    let mut lines = table.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        assert_eq!(fields.len(), names.len(), "{line}");
        names.iter().zip(fields).map(|(name, field)| ((*name).to_owned(), field.to_owned())).collect()
    };
    lines.map(row).collect()
}

fn number(row: &BTreeMap<String, String>, name: &str) -> f64 {
    row[name].parse().unwrap()
}

/// Numbers of points of an object in a frame of KITTI: all, and those in the box of a line of its labels.
fn contained(sequence: &Path, frame: usize, object: u32, label: &str) -> [usize; 2] {
    let points = fs::read(sequence.join(format!("velodyne/{frame:06}.bin"))).unwrap();
    let labels = fs::read(sequence.join(format!("labels/{frame:06}.label"))).unwrap();
    let values: Vec<f64> = label.split(' ').skip(8).map(|value| value.parse().unwrap()).collect();
    let [height, width, length, x, y, z, turn] = values[..] else { panic!("{label}") };
    let mut counts = [0, 0];
    for (point, label) in points.chunks_exact(16).zip(labels.chunks_exact(4)) {
        if u32::from_le_bytes(label.try_into().unwrap()) >> 16 != object {
            continue;
        }
        let at = |i: usize| f64::from(f32::from_le_bytes(point[4 * i..4 * i + 4].try_into().unwrap()));
        // Right, down and forward of the camera, from the middle of the bottom.
        let (right, down, forward) = (-at(1) - x, -at(2) - y, at(0) - z);
        let along = right * turn.cos() - forward * turn.sin();
        let across = right * turn.sin() + forward * turn.cos();
        let slack = 0.02;
        let is_inside = along.abs() < 0.5 * length + slack
            && across.abs() < 0.5 * width + slack
            && (-height - slack..slack).contains(&down);
        counts[0] += 1;
        counts[1] += usize::from(is_inside);
    }
    counts
}

#[test]
fn boxes_hold_all_points_of_their_objects() {
    let dir = folder();
    street(dir.path());
    succeed(dir.path(), &["run", "drive.toml", "-q", "-o", "a.mcap", "--objects", "objects.csv"]);
    let poses = rows(&dir.path().join("objects.csv"));
    let of = |id: &str| poses.iter().filter(|row| row["id"] == id).collect::<Vec<_>>();
    let (bus, hut) = (of("7"), of("hut"));
    // A pose before the first pulse, one after the first step, and one every 16 ms.
    assert!((30..=34).contains(&bus.len()) && bus.len() == hut.len(), "{} poses", bus.len());
    assert_eq!(
        (bus[0]["object"].as_str(), bus[0]["name"].as_str(), bus[0]["class"].as_str()),
        ("7", "bus", "64")
    );
    for (i, row) in bus.iter().enumerate() {
        let off = |name: &str, expected: f64| (number(row, name) - expected).abs();
        assert!(off("x", 500_007.0) < 1e-5 && off("y", 5_399_998.0 + 0.16 * i as f64) < 1e-5, "{row:?}");
        assert!(off("length", 4.0) < 1e-5 && off("width", 2.0) < 1e-5 && off("height", 4.0) < 1e-5);
        assert!(off("vx", 0.0) < 1e-6 && off("vy", 10.0) < 1e-6 && off("vz", 0.0) < 1e-6, "{row:?}");
    }
    let times: Vec<f64> = bus.iter().map(|row| number(row, "time")).collect();
    assert!(times[2..].windows(2).all(|pair| (pair[1] - pair[0] - 0.016).abs() < 1e-6), "{times:?}");
    for (i, row) in hut.iter().enumerate() {
        // Half the angle of the quaternion.
        assert!((number(row, "qz") - (i as f64).to_radians().sin()).abs() < 1e-9, "{row:?}");
    }

    let names = ["--category", "64=Bus", "--category", "65=Misc"];
    let objects = ["--objects", "objects.csv", "-q"];
    for layout in ["kitti", "nuscenes"] {
        let args = ["frames", "a.mcap", "-o", layout, "--layout", layout];
        succeed(dir.path(), &[&args[..], &objects, &names].concat());
    }
    let sequence = dir.path().join("kitti/sequences/00");
    let boxes = rows(&sequence.join("boxes.csv"));
    assert!(boxes.len() >= 8, "{} boxes", boxes.len());
    let frames = fs::read_dir(sequence.join("velodyne")).unwrap().count();
    let mut all = boxes.iter();
    for frame in 0..frames {
        let labels = fs::read_to_string(sequence.join(format!("label_2/{frame:06}.txt"))).unwrap();
        assert!(sequence.join(format!("calib/{frame:06}.txt")).is_file());
        for label in labels.lines() {
            let row = all.next().unwrap();
            assert_eq!(number(row, "frame") as usize, frame);
            let object: u32 = row["object"].parse().unwrap();
            let [points, inside] = contained(&sequence, frame, object, label);
            assert_eq!((points as f64, inside), (number(row, "points"), points), "{label}: {row:?}");
            assert_eq!(row["inside"], row["points"], "{row:?}");
            assert!(points > 0 && (0.0..=1.0).contains(&number(row, "visibility")));
            let kind = if object == 7 { "Bus" } else { "Misc" };
            assert!(label.starts_with(kind), "{label}");
        }
    }
    assert!(all.next().is_none());
    nuscenes(&dir.path().join("nuscenes/v1.0-vlscan"), &boxes);

    // Neither threads nor chunks change a byte.
    let more = ["-j", "1", "--chunk-size", "7", "--objects", "b.csv"];
    succeed(dir.path(), &[&["run", "drive.toml", "-q", "-o", "b.mcap"][..], &more].concat());
    for (one, other) in [("a.mcap", "b.mcap"), ("objects.csv", "b.csv")] {
        let [one, other] = [one, other].map(|name| fs::read(dir.path().join(name)).unwrap());
        assert!(one == other);
    }
}

/// Compares the tables of annotations with the table of boxes.
fn nuscenes(tables: &Path, boxes: &[BTreeMap<String, String>]) {
    let table = |name: &str| -> Vec<Value> {
        serde_json::from_slice(&fs::read(tables.join(format!("{name}.json"))).unwrap()).unwrap()
    };
    let (annotations, instances) = (table("sample_annotation"), table("instance"));
    let by_token: BTreeMap<&str, &Value> =
        annotations.iter().map(|row| (row["token"].as_str().unwrap(), row)).collect();
    assert_eq!((annotations.len(), instances.len(), table("visibility").len()), (boxes.len(), 2, 4));
    let categories = table("category");
    let mut names = Vec::new();
    for instance in &instances {
        let category = categories.iter().find(|row| row["token"] == instance["category_token"]).unwrap();
        names.push(category["name"].as_str().unwrap());
        let object = if category["index"] == 64 { "7" } else { "hut" };
        let own: Vec<_> = boxes.iter().filter(|row| row["id"] == object).collect();
        assert_eq!(instance["nbr_annotations"], own.len());
        let mut token = instance["first_annotation_token"].as_str().unwrap();
        for (i, row) in own.iter().enumerate() {
            let annotation = by_token[token];
            assert_eq!(annotation["instance_token"], instance["token"]);
            assert_eq!(annotation["num_lidar_pts"].as_f64().unwrap(), number(row, "points"));
            for (k, axis) in ["x", "y", "z"].iter().enumerate() {
                let found = annotation["translation"][k].as_f64().unwrap();
                assert!((found - number(row, axis)).abs() < 1e-5, "{annotation} {row:?}");
            }
            for (k, name) in ["width", "length", "height"].iter().enumerate() {
                assert!((annotation["size"][k].as_f64().unwrap() - number(row, name)).abs() < 1e-5);
            }
            if i + 1 == own.len() {
                assert_eq!(
                    (&annotation["token"], &annotation["next"]),
                    (&instance["last_annotation_token"], &Value::from(""))
                );
            }
            token = annotation["next"].as_str().unwrap();
        }
    }
    names.sort_unstable();
    assert_eq!(names, ["Bus", "Misc"]);
}

#[test]
fn objects_and_forecasts_end_with_the_last_pulse() {
    let dir = folder();
    street(dir.path());
    // Of 0.43 s to the waypoint, where the head would turn for 0.3 s more.
    let limited = "head_rate_deg_per_s = 3600\nhead_stop_deg = 3600\nmax_duration_s = 0.3";
    fs::write(dir.path().join("drive.toml"), DRIVE.replace("head_rate_deg_per_s = 3600", limited)).unwrap();
    succeed(dir.path(), &["run", "drive.toml", "-q", "-o", "a.csv", "--objects", "objects.csv"]);
    let poses = rows(&dir.path().join("objects.csv"));
    let times: Vec<f64> = poses.iter().map(|row| number(row, "time")).collect();
    let flown = times.last().unwrap() - times[0];
    assert!((0.28..0.301).contains(&flown), "{flown}");
    let json = succeed(dir.path(), &["run", "drive.toml", "-q", "-o", "b.csv", "--dry-run", "--json"]);
    let forecast: Value = serde_json::from_slice(&json.stdout).unwrap();
    let duration = forecast["duration_s"].as_f64().unwrap();
    assert!((duration - 0.3).abs() < 1e-3, "{forecast}");
    assert_eq!(forecast["legs"].as_array().unwrap().len(), 1, "{forecast}");
}

#[test]
fn points_of_moving_objects_can_be_left_where_they_were_measured() {
    let dir = folder();
    street(dir.path());
    succeed(dir.path(), &["run", "drive.toml", "-q", "-o", "a.mcap", "--objects", "objects.csv"]);
    let kitti = ["--layout", "kitti", "-q"];
    let left = ["--objects", "objects.csv", "--skewed-objects"];
    succeed(dir.path(), &[&["frames", "a.mcap", "-o", "plain"][..], &kitti].concat());
    succeed(dir.path(), &[&["frames", "a.mcap", "-o", "left"][..], &kitti, &left].concat());
    succeed(dir.path(), &[&["frames", "a.mcap", "-o", "moved"][..], &kitti, &left[..2]].concat());
    let of = |folder: &str| dir.path().join(folder).join("sequences/00");
    let points = |folder: &str| fs::read(of(folder).join("velodyne/000001.bin")).unwrap();
    assert!(points("left") == points("plain") && points("moved") != points("plain"));
    let sums = |folder: &str| {
        let boxes = rows(&of(folder).join("boxes.csv"));
        ["points", "inside"].map(|name| boxes.iter().map(|row| number(row, name)).sum::<f64>())
    };
    let ([all, inside], moved) = (sums("left"), sums("moved"));
    assert!(inside < all && moved == [all, all], "{inside} of {all}, {moved:?}");
}

#[test]
fn each_of_several_scanners_has_a_table_of_objects() {
    let dir = folder();
    street(dir.path());
    succeed(dir.path(), &["run", "drive.toml", "-q", "-o", "a.mcap", "--objects", "objects.csv"]);
    let (before, rest) = DRIVE.split_once("[scanner]\n").unwrap();
    let (scanner, after) = rest.split_once("[settings]").unwrap();
    let table = |name: &str| format!("[[scanner]]\nname = \"{name}\"\noutput = \"{name}.mcap\"\n{scanner}");
    let rig = format!("{before}{}{}[settings]{after}", table("roof"), table("rear"));
    fs::write(dir.path().join("rig.toml"), rig).unwrap();
    // The table of the single run stays.
    succeed(dir.path(), &["run", "rig.toml", "-q", "--objects", "objects.csv"]);
    let read = |name: &str| fs::read(dir.path().join(name)).unwrap();
    for name in ["objects_roof.csv", "objects_rear.csv"] {
        assert!(read(name) == read("objects.csv"), "{name}");
    }
    let objects = ["--layout", "kitti", "-q", "--objects", "objects_rear.csv"];
    succeed(dir.path(), &[&["frames", "rear.mcap", "-o", "kitti"][..], &objects].concat());
    assert!(!rows(&dir.path().join("kitti/sequences/00/boxes.csv")).is_empty());
    for name in ["roof.mcap", "rear.mcap"] {
        fs::remove_file(dir.path().join(name)).unwrap();
    }
    let refused = run(dir.path(), &["run", "rig.toml", "-q", "--objects", "objects.csv"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("objects_roof.csv exists"), "{}", text(&refused.stderr));
    assert!(!dir.path().join("roof.mcap").exists());
    let lost = ["run", "rig.toml", "-q", "--force", "--objects", "none/objects.csv"];
    for options in [&[][..], &["--resume"]] {
        let refused = run(dir.path(), &[&lost, options].concat());
        assert_eq!(refused.status.code(), Some(2));
        let said = text(&refused.stderr);
        assert!(said.contains("none is not a directory, so none/objects_roof.csv"), "{said}");
        assert!(!dir.path().join("roof.mcap").exists() && !dir.path().join("roof.mcap.shards").exists());
    }
}

#[test]
fn tables_of_objects_that_cannot_be_are_refused() {
    let dir = folder();
    street(dir.path());
    succeed(dir.path(), &["run", "drive.toml", "-q", "-o", "a.mcap"]);
    fs::write(dir.path().join("text.csv"), "time,x\n1,2\n").unwrap();
    let heading = "object,id,name,class,time,x,y,z,qw,qx,qy,qz,length,width,height,vx,vy,vz\n";
    let row = "7,7,bus,64,86418,0,0,0,1,0,0,0,4,2,4,0,10,0\n";
    fs::write(dir.path().join("wrong.csv"), format!("{heading}{row}7,7,bus,64,x\n")).unwrap();
    fs::write(dir.path().join("other.csv"), format!("{heading}{}", row.replace("7,7", "99,99"))).unwrap();
    fs::write(dir.path().join("late.csv"), format!("{heading}{}", row.replace("86418", "86500"))).unwrap();
    // The bus moves on after three poses.
    let short: String = (0..3).map(|i| row.replace("86418", &format!("86418.00{i}"))).collect();
    fs::write(dir.path().join("short.csv"), format!("{heading}{short}")).unwrap();
    let frames = ["frames", "a.mcap", "-o", "out", "--layout", "kitti"];
    for (args, expected) in [
        (&["--objects", "text.csv"][..], "no columns"),
        (&["--objects", "wrong.csv"], "wrong.csv:3"),
        (&["--objects", "none.csv"], "none.csv"),
        (&["--skewed-objects"], "--objects"),
        (&["--category", "300=Car"], "CLASS=NAME"),
        (&["--category", "64=Car", "--strict"], "KITTI names the classes of boxes only"),
        (&["--objects", "other.csv", "--strict"], "no point of a.mcap"),
        (&["--objects", "late.csv", "--strict"], "of a.mcap are older than the first poses of this table"),
        (&["--objects", "short.csv", "--strict"], "of a.mcap are newer than the last poses of this table"),
    ] {
        let out = run(dir.path(), &[&frames[..], args].concat());
        assert!(
            out.status.code() == Some(2) && text(&out.stderr).contains(expected),
            "{}",
            text(&out.stderr)
        );
        assert!(!dir.path().join("out").exists(), "{args:?}");
    }
    let mut still = fs::read_to_string(dir.path().join("street.xml")).unwrap();
    let [from, to] = ["<dmotion", "</dmotion>"];
    while let (Some(begin), Some(end)) = (still.find(from), still.find(to)) {
        still.replace_range(begin..end + to.len(), "");
    }
    fs::write(dir.path().join("still.xml"), still).unwrap();
    fs::write(dir.path().join("still.toml"), DRIVE.replace("street.xml", "still.xml")).unwrap();
    for (args, expected) in [
        (&["still.toml", "-o", "b.mcap", "--objects", "b.csv"][..], "no moving parts"),
        (&["still.toml", "--dry-run", "-o", "b.mcap", "--objects", "b.csv"], "no moving parts"),
        (&["drive.toml", "-o", "b.mcap", "--objects", "-"], "stdout is for points"),
        (&["drive.toml", "-o", "b.mcap", "--objects", "b.mcap"], "b.mcap"),
        (&["drive.toml", "-o", "shards", "--shard", "0/2", "--objects", "b.csv"], "--shard"),
    ] {
        let out = run(dir.path(), &[&["run"], args].concat());
        assert!(
            out.status.code() == Some(2) && text(&out.stderr).contains(expected),
            "{}",
            text(&out.stderr)
        );
        assert!(!dir.path().join("b.csv").exists() && !dir.path().join("b.mcap").exists());
    }
}
