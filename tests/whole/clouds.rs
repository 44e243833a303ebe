//! Point clouds as other programs write them: another library writes each variant of docs/dev/formats.md, and
//! `compare`, `preview` and the loader of scenes must read the points at their positions.

use crate::common::{self, folder, run, succeed, text};
use std::fs;
use std::path::Path;

/// Writes `truth.csv`, the variants and `variants.txt`, a line for each: file, tolerance in m, whether it has
/// the intensities.
const SCRIPT: &str = r#"
import struct
import laspy, numpy as np, pyarrow as pa, pyarrow.ipc, pyarrow.parquet, pye57
from pypcd4 import PointCloud
from laspy.vlrs.known import WktCoordinateSystemVlr

i = np.arange(400)
xyz = np.column_stack([500000.25 + i % 20, 5400000.5 + i // 20, 100 + 5 * np.sin(i)]).round(3)
intensity, cls = (i * 7 % 100 + 1).astype(float), (i % 5 + 2)
np.savetxt("truth.csv", np.column_stack([xyz, intensity, cls]), delimiter=",", header="x,y,z,intensity,class", comments="", fmt="%.4f")
variants = []
def variant(name, tolerance=0.0006, has_intensity=True):
    variants.append(f"{name} {tolerance} {int(has_intensity)}")
    return name

def las(version, point_format, name, change=None, scale=0.001, unit=(1, 1, 1)):
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.offsets, header.scales = np.floor((xyz / np.array(unit)).min(axis=0)) - 1000, [scale] * 3
    las = laspy.LasData(header)
    las.xyz = xyz / np.array(unit)
    las.intensity, las.classification = intensity, cls
    if change:
        change(las)
    las.write(variant(name))
    return name
for point_format in range(11):
    if point_format in (4, 5, 9, 10):
        continue
    version = "1.2" if point_format < 4 else "1.4"
    las(version, point_format, f"format{point_format}.las")
    las(version, point_format, f"format{point_format}.laz")
def amplitude(las):
    las.add_extra_dim(laspy.ExtraBytesParams("colour", "3u2"))
    las.add_extra_dim(laspy.ExtraBytesParams("Amplitude", "uint16", scales=[0.01], offsets=[0.0]))
    las.Amplitude = 600 / (intensity + 1)
las("1.4", 6, "amplitude.las", amplitude)
def feet(las):
    las.vlrs.append(WktCoordinateSystemVlr('PROJCS["p",GEOGCS["g",UNIT["degree",0.017]],UNIT["US survey foot",0.3048006096012192]]'))
las("1.4", 6, "feet_wkt.las", feet, unit=[1200 / 3937] * 3)
def keys(las):
    las.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", struct.pack("<16H", 1, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, 2263, 4099, 0, 1, 9001)))
las("1.2", 0, "feet_keys.las", keys, unit=(1200 / 3937, 1200 / 3937, 1))
whole = bytearray(open(las("1.4", 6, "format6_again.las"), "rb").read())
whole[179:227] = struct.pack("<6d", 9e9, -9e9, 1, 0, float("nan"), 5)
open(variant("wrong_bounds.las"), "wb").write(whole)
# LAS 1.5 has three fields more at the end of its header.
head, start = 393 - 375, struct.unpack_from("<I", whole, 96)[0]
newer = whole[:375] + bytes(head) + whole[375:]
newer[25] = 5
struct.pack_into("<H", newer, 94, 393)
struct.pack_into("<I", newer, 96, start + head)
open(variant("newer.las"), "wb").write(newer)
unfinished = bytearray(whole)
unfinished[107:111], unfinished[247:255] = bytes(4), bytes(8)
open(variant("unfinished.las"), "wb").write(unfinished)

rows = np.column_stack([xyz, intensity, cls])
cloud = PointCloud.from_points(rows, ["x", "y", "z", "intensity", "label"], [np.float64] * 3 + [np.float32, np.uint8])
from pypcd4 import Encoding
for encoding in (Encoding.ASCII, Encoding.BINARY, Encoding.BINARY_COMPRESSED):
    cloud.save(variant(f"{encoding.value}.pcd", 0.01 if encoding == Encoding.ASCII else 0.0006), encoding=encoding)

angle = 0.3
turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
place = np.array([500010.0, 5400010.0, 100.0])
local = (xyz - place) @ turn
quaternion = np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2)])
with pye57.E57(variant("scans.e57"), mode="w") as e57:
    for part in (slice(0, 150), slice(150, 400)):
        data = {"cartesianX": local[part, 0], "cartesianY": local[part, 1], "cartesianZ": local[part, 2], "intensity": intensity[part]}
        e57.write_scan_raw(data, rotation=quaternion, translation=place)

table = pa.table({"Z": xyz[:, 2], "X": xyz[:, 0], "note": ["a"] * 400, "Y": xyz[:, 1], "Intensity": intensity})
pa.parquet.write_table(table, variant("table.parquet"))
with pa.ipc.new_stream(variant("table.arrow"), table.schema) as out:
    out.write_table(table)

def lines(name, rows, head="", separator=" ", has_intensity=True, fmt="%.4f"):
    np.savetxt(variant(name, 0.0006, has_intensity), rows, delimiter=separator, header=head, comments="", fmt=fmt)
lines("plain.xyz", xyz, has_intensity=False)
lines("four.txt", rows[:, :4])
lines("class.txt", np.column_stack([xyz, cls]), "x y z class", has_intensity=False)
lines("comment.txt", rows, "//X Y Z Intensity Classification")
lines("index.csv", np.column_stack([i, rows]), ",x,y,z,intensity,class", ",")
lines("german.csv", np.column_stack([i, rows]), "Nr;Rechtswert;Hochwert;Höhe;Intensity;Class", ";")
lines("tabs.txt", np.column_stack([i, rows]), "tree id\tEasting\tNorthing\tHeight\tIntensity\tClass", "\t")
lines("feet.csv", xyz / 0.3048, "x [ft],y [ft],z [ft]", ",", False, "%.5f")
lines("cyclone.pts", np.column_stack([xyz, intensity, rows[:, 4], rows[:, 4], rows[:, 4]]), "400")
turned = (xyz - place) @ turn
matrix = np.eye(4)
matrix[:3, :3], matrix[3, :3] = turn.T, place
with open(variant("cyclone.ptx"), "w") as out:
    out.write("20\n21\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n")
    np.savetxt(out, matrix, fmt="%.12f")
    np.savetxt(out, np.column_stack([turned, intensity]), fmt="%.5f")
    out.write("0 0 0 0.5\n" * 20)
with open(variant("cloud.ply"), "w") as out:
    out.write("ply\nformat ascii 1.0\nelement vertex 400\nproperty double x\nproperty double y\nproperty double z\nproperty float scalar_Intensity\nend_header\n")
    np.savetxt(out, rows[:, :4], fmt="%.4f")
open("variants.txt", "w").write("\n".join(variants))
"#;

/// A scene of one point cloud.
fn scene(file: &str, separator: &str) -> String {
    format!(
        r#"<?xml version="1.0"?><document><scene id="s"><part><filter type="xyzloader">
        <param type="string" key="filepath" value="{file}"/><param type="string" key="separator" value="{separator}"/>
        <param type="double" key="voxelSize" value="0.5"/></filter></part></scene></document>"#
    )
}

/// The box and the number of primitives that `scene info` tells.
fn facts(folder: &Path, name: &str, separator: &str) -> serde_json::Value {
    fs::write(folder.join("scene.xml"), scene(name, separator)).unwrap();
    let out = succeed(folder, &["scene", "info", "scene.xml", "--json"]);
    serde_json::from_slice(&out.stdout).unwrap()
}

#[test]
fn every_variant_of_every_format_is_read_by_all_commands() {
    let Some(python) = common::python("laspy, lazrs, numpy, pyarrow, pypcd4, pye57") else { return };
    let dir = folder();
    common::judge(&python, dir.path(), SCRIPT);
    let variants = fs::read_to_string(dir.path().join("variants.txt")).unwrap();
    assert!(variants.lines().count() > 35, "{variants}");
    let expected = facts(dir.path(), "truth.csv", ",");
    for line in variants.lines() {
        let [name, tolerance, has_intensity] = line.split(' ').collect::<Vec<_>>()[..] else {
            panic!("{line}")
        };
        let out = succeed(dir.path(), &["compare", "truth.csv", name, "--json"]);
        let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        let number = |path: &str| found.pointer(path).and_then(serde_json::Value::as_f64).unwrap_or(f64::NAN);
        assert_eq!(number("/second/points"), 400.0, "{name}: {found}");
        let tolerance: f64 = tolerance.parse().unwrap();
        for corner in ["min", "max"] {
            for axis in 0..3 {
                let [a, b] = ["first", "second"].map(|cloud| number(&format!("/{cloud}/{corner}/{axis}")));
                assert!((a - b).abs() <= tolerance, "{name}: {corner} {a} {b}");
            }
        }
        assert!(number("/first_to_second/median_m") <= tolerance, "{name}: {found}");
        // Where rounding moves no point across the edge of the box, every point has its like.
        let is_whole =
            ["first", "second"].iter().all(|cloud| number(&format!("/{cloud}/points_in_box")) == 400.0);
        assert!(!is_whole || number("/second_to_first/max_m") <= tolerance, "{name}: {found}");
        match has_intensity {
            "0" => assert!(found["second"]["intensity_median"].is_null(), "{name}: {found}"),
            _ if is_whole => {
                assert_eq!(found["second"]["intensity_median"], found["first"]["intensity_median"], "{name}")
            }
            _ => assert!((number("/second/intensity_median") - 50.0).abs() < 3.0, "{name}: {found}"),
        }
        let separator = match name.rsplit_once('.').unwrap() {
            ("german", _) => ";",
            // A tab as such becomes a blank in an attribute of XML.
            ("tabs", _) => "&#9;",
            (_, "csv") => ",",
            _ => " ",
        };
        let scene = facts(dir.path(), name, separator);
        assert_eq!(scene["primitives"], expected["primitives"], "{name}: {scene}");
        succeed(
            dir.path(),
            &["preview", name, "-o", "a.png", "--width", "320", "--height", "240", "--force"],
        );
    }
}

#[test]
fn a_cloud_is_like_itself_to_its_last_point() {
    let dir = folder();
    // Coordinates that 32-bit numbers, or differences to the lower corner in them, would move across the edge
    // of the box.
    let rows: String = (0..500)
        .map(|i| {
            let (x, y) = (431_000.1 + f64::from(i % 25) / 3.0, 5_412_000.7 + f64::from(i / 25) / 7.0);
            format!("{x} {y} {}\n", f64::from(i * i % 97) * 0.123)
        })
        .collect();
    fs::write(dir.path().join("a.xyz"), rows).unwrap();
    fs::write(dir.path().join("one.xyz"), "431000.1 5412000.7 3.3\n".repeat(3)).unwrap();
    fs::write(dir.path().join("line.xyz"), "1.1 5 3\n2.2 5 3\n7.7 5 3\n").unwrap();
    for (name, count) in [("a.xyz", 500.0), ("one.xyz", 3.0), ("line.xyz", 3.0)] {
        let out = succeed(dir.path(), &["compare", name, name, "--json"]);
        let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        assert_eq!(found["first"]["points_in_box"].as_f64(), Some(count), "{name}: {found}");
        assert_eq!(found["first_to_second"]["max_m"].as_f64(), Some(0.0), "{name}: {found}");
        assert_eq!(found["voxels"]["agreement"].as_f64(), Some(1.0), "{name}: {found}");
        let table = text(&succeed(dir.path(), &["compare", name, name]).stdout);
        assert!(!table.contains("NaN"), "{table}");
    }
}

#[test]
fn what_is_not_read_is_named() {
    let dir = folder();
    for (name, content, expected) in [
        ("a.rdbx", &b"RIEGL LMS RDB 2 POINTCLOUD FILE\0\0"[..], "rdbconvert"),
        ("a.xyz.gz", b"\x1f\x8b\x08\0\0\0", "gunzip"),
        ("a.xyz", b"\xff\xfe1\x002\x003\x00", "UTF-16"),
        ("a.bin", b"\x07\0\0\0\x01\x02", "binary and in no known format"),
        ("a.obj", b"# mesh\nv 1 2 3\n", "an OBJ mesh"),
        ("SHAPE", b"SOLID box\n  FACET NORMAL 0 0 1\n", "an STL mesh"),
        ("a.csv", b"x y z\n1,5 2.5 3,5\n", "decimal comma"),
        ("b.csv", b"1,5\t2.5\t3,5\n", "decimal comma"),
        ("a.txt", b"lat lon height\n50 8 100\n", "longitude and latitude"),
        ("d.txt", b"x y z\n1 2 3 4\n", "3 columns are named, line 2 has 4"),
        ("e.txt", b"x y z note class\n1 2 3 4\n", "expected"),
        ("b.txt", b"x y depth\n1 2 3\n", "no column z"),
        ("c.txt", b"x y z class\n1 2 3\n", "expected a point class"),
    ] {
        fs::write(dir.path().join(name), content).unwrap();
        fs::write(dir.path().join("scene.xml"), scene(name, " ")).unwrap();
        for args in
            [&["compare", name, name][..], &["preview", name, "-o", "a.png"], &["scene", "info", "scene.xml"]]
        {
            let out = run(dir.path(), args);
            let said = text(&out.stderr);
            assert_eq!(out.status.code(), Some(2), "{args:?}: {said}");
            assert!(said.contains(expected), "{args:?}: {said}");
            assert!(!said.contains("damaged") && !said.contains("truncated"), "{args:?}: {said}");
            assert!(said.bytes().all(|b| b == b'\n' || b >= 0x20), "{args:?}: {said:?}");
        }
    }
}

#[test]
fn what_is_not_used_as_written_is_an_error_with_strict() {
    let dir = folder();
    let row = |class: &str| format!("x,y,z,class\n1,2,3,2\n4,5,6,{class}\n");
    let mut cases: Vec<(String, Vec<u8>, &str)> = ["300", "-1", "2.7", "nan"]
        .map(|class| {
            (format!("class{class}.csv"), row(class).into_bytes(), "not a whole number from 0 to 255")
        })
        .into();
    cases.push(("unit.csv".into(), b"x [furlong],y [m],z [m]\n1,2,3\n".to_vec(), "unit \"furlong\""));
    cases.push(("two.csv".into(), b"x,y,z,class,label\n1,2,3,4,5\n".to_vec(), "both name a point class"));
    cases.push(("nan.csv".into(), b"x,y,z\n1,2,nan\n1,2,3\n".to_vec(), "left out: 1 point without"));
    cases.push((
        "long.csv".into(),
        b"x,y,z\n1,2,3\n4,5,6,7\n".to_vec(),
        "1 line has more values than line 2",
    ));
    let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let pcd = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nDATA ascii\n";
    for (name, head) in [("more.ply", ply), ("more.pcd", pcd)] {
        let content = format!("{head}1 2 3\n4 5 6\n").into_bytes();
        cases.push((name.into(), content, "the file continues after the 1 point that its header states"));
    }
    for (name, content, expected) in cases {
        fs::write(dir.path().join(&name), content).unwrap();
        let picture = ["preview", &name, "-o", "a.png", "--force", "--width", "320", "--height", "240"];
        for args in [&["compare", &name, &name][..], &picture] {
            let said = text(&succeed(dir.path(), args).stderr);
            assert!(said.contains(expected) && said.contains(&name), "{args:?}: {said}");
            let strict = run(dir.path(), &[args, &["--strict"]].concat());
            let said = text(&strict.stderr);
            assert!(strict.status.code() == Some(2) && said.contains(expected), "{args:?}: {said}");
        }
    }
    for (name, content) in [
        ("both.csv", &b"x,y,z,Amplitude,Intensity\n1,2,3,0.5,7\n4,5,6,0.5,8\n"[..]),
        ("inch.csv", b"X [in],Y [in],Z [in]\n1,2,3\n"),
        ("tab.txt", b"sep=\t\nX\tY\tZ\n1\t2\t3\n"),
        ("sep.txt", b"SEP=;\nX;Y;Z\n1;2;3\n"),
    ] {
        fs::write(dir.path().join(name), content).unwrap();
        let size = ["--width", "320", "--height", "240"];
        let args = [&["preview", name, "-o", "a.png", "--force", "--strict"], &size[..]].concat();
        succeed(dir.path(), &args);
    }
    let compared = |name: &str| -> serde_json::Value {
        let out = succeed(dir.path(), &["compare", name, name, "--json", "--strict"]);
        serde_json::from_slice(&out.stdout).unwrap()
    };
    let found = compared("both.csv");
    assert!(found["first"]["intensity_median"].as_f64().unwrap() >= 7.0, "{found}");
    let found = compared("inch.csv");
    assert!((found["first"]["max"][2].as_f64().unwrap() - 0.0762).abs() < 1e-9, "{found}");
}

#[test]
fn lines_that_end_in_carriage_returns_are_lines() {
    let dir = folder();
    let rows: Vec<String> = (0..100).map(|i| format!("{} {} 5", i % 10, i / 10)).collect();
    for (name, head) in [
        ("a.xyz", ""),
        ("b.xyz", "x y z\r"),
        ("a.pts", "100\r"),
        (
            "a.pcd",
            "VERSION .7\rFIELDS x y z\rSIZE 4 4 4\rTYPE F F F\rCOUNT 1 1 1\rWIDTH 100\rHEIGHT 1\rDATA ascii\r",
        ),
        (
            "a.ply",
            "ply\rformat ascii 1.0\relement vertex 100\rproperty float x\rproperty float y\rproperty float z\rend_header\r",
        ),
    ] {
        fs::write(dir.path().join(name), format!("{head}{}\r", rows.join("\r"))).unwrap();
        let out = succeed(dir.path(), &["compare", name, name, "--json", "--strict"]);
        let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        assert_eq!(found["first"]["points"].as_f64(), Some(100.0), "{name}: {found}");
        assert_eq!(facts(dir.path(), name, " ")["primitives"].as_f64(), Some(100.0), "{name}");
    }
}

#[test]
fn few_points_on_both_sides_of_the_origin_are_described() {
    let dir = folder();
    for (name, cloud) in [
        ("two.xyz", "1 1 0\n-1 -1 0\n"),
        ("four.csv", "x,y,z\n5,5,0\n-5,5,0\n5,-5,0\n-5,-5,0\n"),
        ("wide.csv", "x,y,z\n1e9,1e9,0\n-1e9,-1e9,0\n"),
    ] {
        fs::write(dir.path().join(name), cloud).unwrap();
        let shown = text(&common::succeed(dir.path(), &["info", name]).stdout);
        assert!(shown.contains("points/m²"), "{shown}");
    }
}

/// The facts of a file.
fn described(folder: &Path, name: &str) -> serde_json::Value {
    serde_json::from_slice(&common::succeed(folder, &["info", name, "--json"]).stdout).unwrap()
}

#[test]
fn misses_are_recognised_by_what_is_written_for_them_and_not_by_zeros() {
    let dir = folder();
    let survey = common::forest();
    let names =
        ["a.las", "a.laz", "a.copc.laz", "a.ply", "a.csv", "a.parquet", "a.arrow", "a.xyz", "a.pcd", "a.e57"];
    let outputs: Vec<&str> = names.iter().flat_map(|name| ["-o", name]).collect();
    let run = ["run", &survey, "-q", "--misses", "-o", "a.raycloud.ply", "-o", "a.mcap"];
    common::succeed(dir.path(), &[&run[..], &outputs].concat());
    let expected = described(dir.path(), "a.las");
    let (points, misses) = (expected["points"].as_u64().unwrap(), expected["misses"].as_u64().unwrap());
    assert!(points > 1000 && misses > 10, "{expected}");
    for name in names.into_iter().chain(["a.raycloud.ply", "a.mcap"]) {
        let found = described(dir.path(), name);
        assert_eq!(
            (found["points"].as_u64(), found["misses"].as_u64()),
            (Some(points), Some(misses)),
            "{name}"
        );
    }
    // The same records as another program has them: not withheld.
    let mut las = fs::read(dir.path().join("a.las")).unwrap();
    let start = u32::from_le_bytes(las[96..100].try_into().unwrap()) as usize;
    let length = usize::from(u16::from_le_bytes(las[105..107].try_into().unwrap()));
    las[start..].chunks_exact_mut(length).for_each(|record| record[15] &= !4);
    fs::write(dir.path().join("other.las"), las).unwrap();
    let found = described(dir.path(), "other.las");
    assert_eq!((found["points"].as_u64(), found["misses"].as_u64()), (Some(points + misses), Some(0)));
    let out = common::succeed(dir.path(), &["info", "other.las"]);
    let note = format!("{misses} points have no return number (0 of 0)");
    assert!(text(&out.stderr).contains(&note), "{}", text(&out.stderr));
    let said = |args: &[&str]| text(&common::succeed(dir.path(), args).stderr);
    let amount = |name: &str| said(&["raster", name, "--density", "d.tif", "--force"]);
    assert!(amount("a.las").contains("pulses that returned nothing"), "{}", amount("a.las"));
    assert!(!amount("other.las").contains("pulses that"), "{}", amount("other.las"));
    // Tables of other programs.
    let rows = "X,Y,Z,Intensity,ReturnNumber,NumberOfReturns\n1,2,3,0,0,0\n4,5,6,7,1,1\n";
    fs::write(dir.path().join("pdal.csv"), rows).unwrap();
    let found = described(dir.path(), "pdal.csv");
    assert_eq!((found["points"].as_u64(), found["misses"].as_u64()), (Some(2), Some(0)));
}

#[test]
fn times_of_different_kinds_are_noticed() {
    let dir = folder();
    common::succeed(dir.path(), &["run", &common::forest(), "-q", "-o", "a.las"]);
    let mut las = fs::read(dir.path().join("a.las")).unwrap();
    // The bit of the global encoding that states adjusted standard GPS time.
    las[6] ^= 1;
    fs::write(dir.path().join("b.las"), las).unwrap();
    let said = |args: &[&str]| text(&common::succeed(dir.path(), args).stderr);
    let both = said(&["info", "a.las", "b.las"]);
    let expected =
        "its times are adjusted standard GPS time, those of the files before seconds of the GPS week";
    assert!(both.contains(expected), "{both}");
    assert!(!said(&["info", "b.las"]).contains("its times are"));
}

/// A meadow of 60 m with plants as LAS-like text, and where one of its points is moved to; `class` is that of
/// the point.
fn meadow(moved: [f64; 3], class: u8) -> String {
    let mut rows = "x,y,z,class,gps_time,return_number,number_of_returns,scan_angle\n".to_owned();
    for i in 0..3000u32 {
        let part = |prime: u32| f64::from(i * prime % 3001) / 3001.0;
        let [mut x, mut y] = [60.0 * part(997), 60.0 * part(1511)];
        let is_plant = i % 3 == 0;
        let mut z = 0.04 * part(2011) + if is_plant { 1.0 + 9.0 * part(1223) } else { 0.0 };
        let angle = (x - 30.0) * 0.18;
        let mut of = if is_plant { 5 } else { 2 };
        if i == 7 && class > 0 {
            (x, y, z, of) = (x + moved[0], y + moved[1], z + moved[2], class);
        }
        rows += &format!("{x:.2},{y:.2},{z:.2},{of},{:.4},1,1,{angle:.2}\n", f64::from(i) * 1e-4);
    }
    rows
}

#[test]
fn one_point_far_away_is_left_out_with_a_warning_by_all_commands() {
    let dir = folder();
    let write = |name: &str, rows: String| fs::write(dir.path().join(name), rows).unwrap();
    // Noise is left out, too: the rest is what there is without the point.
    write("rest.csv", meadow([0.0; 3], 7));
    let reconstructed = |name: &str| {
        let said = common::succeed(dir.path(), &["scene", "reconstruct", name, "-o", "found", "--force"]);
        let report = fs::read_to_string(dir.path().join("found/report.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        let number = |path: &str| report.pointer(path).and_then(serde_json::Value::as_f64).unwrap();
        ([number("/foliage/leaf_area_m2"), number("/receiver/element_size_m")], text(&said.stderr))
    };
    let (rest, _) = reconstructed("rest.csv");
    common::succeed(dir.path(), &["raster", "rest.csv", "--dtm", "rest.tif", "-q"]);
    for moved in [[0.0, 0.0, 3000.0], [3000.0, 0.0, 0.0], [0.0, 30_000.0, 0.0], [1e6, 1e6, 0.0]] {
        write("far.csv", meadow(moved, 1));
        let far = reconstructed("far.csv");
        assert_eq!(far.0, rest, "{moved:?}");
        assert!(far.1.contains("1 point lies far from all others"), "{}", far.1);
        let raster = ["raster", "far.csv", "--dtm", "far.tif", "--force"];
        let said = text(&common::succeed(dir.path(), &raster).stderr);
        assert!(said.contains("1 point lies far") && said.contains("left out"), "{said}");
        let [one, two] = ["rest.tif", "far.tif"].map(|name| fs::read(dir.path().join(name)).unwrap());
        assert!(one == two, "{moved:?}");
        let strict = run(dir.path(), &[&raster[..], &["--strict"]].concat());
        assert_eq!(strict.status.code(), Some(2));
        for args in [
            &["info", "far.csv"][..],
            &["preview", "far.csv", "-o", "far.png", "--force", "--width", "320", "--height", "240"],
            &["compare", "far.csv", "rest.csv"],
        ] {
            let said = text(&common::succeed(dir.path(), args).stderr);
            assert!(said.contains("1 point lies far from all others"), "{args:?}: {said}");
        }
    }
    // Two places are no stray points: the message about cells names where they lie.
    let two = meadow([0.0; 3], 0)
        + &meadow([0.0; 3], 0).replace(",", "e5,").lines().skip(1).collect::<Vec<_>>().join("\n");
    write("two.csv", two);
    let refused = run(dir.path(), &["raster", "two.csv", "--dsm", "two.tif", "--cell", "0.1"]);
    let said = text(&refused.stderr);
    assert!(refused.status.code() == Some(2) && said.contains("the points lie from x"), "{said}");
}

#[test]
fn points_at_random_take_memory_by_their_number() {
    let dir = folder();
    let mut rows = "x,y,z,class,gps_time,leg\n".to_owned();
    let mut state = 1u64;
    let mut draw = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1u32 << 31) - 0.5
    };
    for i in 0..900 {
        let class = [1, 2, 5, 6][i % 4];
        let [x, y, z] = [draw(), draw(), draw()].map(|v| 4e9 * v);
        rows += &format!("{x:.2},{y:.2},{z:.2},{class},{},{}\n", 1e6 * draw(), i % 400);
    }
    fs::write(dir.path().join("random.csv"), rows).unwrap();
    let limited = |args: &[&str]| {
        let limit = format!("ulimit -v 3000000; exec {} {}", env!("CARGO_BIN_EXE_vlscan"), args.join(" "));
        std::process::Command::new("sh").arg("-c").arg(limit).current_dir(dir.path()).output().unwrap()
    };
    let out = limited(&["scene", "reconstruct", "random.csv", "-o", "found"]);
    assert!(matches!(out.status.code(), Some(0 | 2)), "{:?} {}", out.status, text(&out.stderr));
    let lines = text(&out.stderr).lines().filter(|line| line.contains("where the instrument was")).count();
    assert!(lines <= 1, "{}", text(&out.stderr));
    let out = limited(&["raster", "random.csv", "--dtm", "a.tif"]);
    assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("cells of 1 m"), "{}", text(&out.stderr));
}

#[test]
fn seconds_that_no_week_has_and_classes_of_old_formats_are_described_as_such() {
    let dir = folder();
    let survey = common::forest();
    common::succeed(dir.path(), &["run", &survey, "-q", "-o", "a.las", "--las10"]);
    let mut las = fs::read(dir.path().join("a.las")).unwrap();
    let start = u32::from_le_bytes(las[96..100].try_into().unwrap()) as usize;
    let length = usize::from(u16::from_le_bytes(las[105..107].try_into().unwrap()));
    for record in las[start..].chunks_exact_mut(length) {
        record[15] = 15;
        record[20..28].copy_from_slice(&306_234_561.96f64.to_le_bytes());
    }
    fs::write(dir.path().join("b.las"), &las).unwrap();
    fs::write(dir.path().join("d.las"), &las).unwrap();
    for record in las[start..].chunks_exact_mut(length) {
        record[20..28].copy_from_slice(&604_850f64.to_le_bytes());
    }
    fs::write(dir.path().join("c.las"), las).unwrap();
    let out = common::succeed(dir.path(), &["info", "c.las"]);
    let (shown, said) = (text(&out.stdout), text(&out.stderr));
    assert!(shown.contains("continuing past its end") && !said.contains("GPS week"), "{shown}{said}");
    let out = common::succeed(dir.path(), &["info", "b.las"]);
    let (shown, said) = (text(&out.stdout), text(&out.stderr));
    assert!(shown.contains("not of the GPS week") && shown.contains("2021-05-"), "{shown}");
    assert!(said.contains("which are 0 to 604800"), "{said}");
    assert!(shown.contains("15 ") && shown.contains("reserved") && !shown.contains("tower"), "{shown}");
    assert!(described(dir.path(), "b.las")["time_kind"].is_null());
    // Once for each file with such times.
    let said = text(&common::succeed(dir.path(), &["info", "a.las", "b.las", "d.las"]).stderr);
    assert_eq!(said.matches("which are 0 to 604800").count(), 2, "{said}");
}
