//! Every point format as the only output: a file, standard output, a resumed run and a merge hold the
//! positions of a table that was written by itself. The readers are crates, or a few lines here, so that no
//! test depends on another program.

use crate::common::{fixture, folder, run, succeed, text};
use arrow_array::cast::AsArray;
use arrow_array::types::Float64Type;
use parquet::file::reader::SerializedFileReader;
use parquet::record::RowAccessor;
use ply_rs_bw::{parser::Parser, ply::DefaultElement, ply::Property};
use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;

/// All values of `--format`, with the extension that denotes them.
const FORMATS: [(&str, &str); 15] = [
    ("xyz", "xyz"),
    ("csv", "csv"),
    ("bin", "bin"),
    ("las", "las"),
    ("laz", "laz"),
    ("copc", "copc.laz"),
    ("ply", "ply"),
    ("ply-ascii", "ply"),
    ("raycloud", "raycloud.ply"),
    ("pcd", "pcd"),
    ("e57", "e57"),
    ("mcap", "mcap"),
    ("arrow", "arrow"),
    ("parquet", "parquet"),
    ("geoparquet", "geo.parquet"),
];

/// A head that turns once, in a room, level and facing north: the axes of the scanner are those of the world.
fn spinning() -> String {
    let scene = fixture("room/scene.xml");
    format!(
        r#"<?xml version="1.0"?><document>
<survey name="s" scene="{}#room" platform="data/platforms.xml#tripod" scanner="data/scanners_tls.xml#vlp16">
  <leg><platformSettings x="0.3" y="-0.2" z="0"/>
  <scannerSettings active="true" pulseFreq_hz="18750" headRotatePerSec_deg="7200" headRotateStart_deg="0"
    headRotateStop_deg="360"/></leg>
</survey></document>"#,
        scene.display()
    )
}

fn numbers<'a>(words: impl Iterator<Item = &'a str>) -> [f64; 3] {
    let mut words = words.map(|word| word.parse().unwrap());
    [(); 3].map(|()| words.next().unwrap())
}

fn words(bytes: &[u8], header_lines: usize, separator: char) -> Vec<[f64; 3]> {
    text(bytes).lines().skip(header_lines).map(|line| numbers(line.split(separator))).collect()
}

fn f32_at(bytes: &[u8], at: usize) -> f64 {
    f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()))
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// The points of an MCAP, <https://mcap.dev/spec>: records of an opcode and a length; messages lie in chunks
/// without compression.
fn mcap(bytes: &[u8]) -> Vec<[f64; 3]> {
    let mut points = Vec::new();
    let mut rest = bytes.strip_prefix(b"\x89MCAP0\r\n").unwrap();
    while rest.len() > 9 {
        let (opcode, length) = (rest[0], u64::from_le_bytes(rest[1..9].try_into().unwrap()) as usize);
        let body = &rest[9..9 + length];
        match opcode {
            // A chunk: start, end, length and checksum, name of the compression, length of the records.
            6 => {
                let name = u32_at(body, 28);
                assert_eq!(name, 0, "chunks are not compressed");
                points.extend(mcap(&[b"\x89MCAP0\r\n", &body[40..], &[0; 9]].concat()));
            }
            // A message: channel, sequence, times, and in the first channel a PointCloud2 in little-endian
            // CDR.
            5 if body[..2] == [1, 0] => points.extend(point_cloud2(&body[22..])),
            _ => {}
        }
        rest = &rest[9 + length..];
    }
    points
}

fn point_cloud2(cdr: &[u8]) -> Vec<[f64; 3]> {
    // Words are aligned to four bytes after the encapsulation.
    let cdr = &cdr[4..];
    let mut at = 8;
    let word = |at: &mut usize| {
        let value = u32_at(cdr, at.next_multiple_of(4));
        *at = at.next_multiple_of(4) + 4;
        value
    };
    at += word(&mut at);
    let (height, width, fields) = (word(&mut at), word(&mut at), word(&mut at));
    let mut offsets = [None; 3];
    for _ in 0..fields {
        let length = word(&mut at);
        let name = text(&cdr[at..at + length - 1]);
        at += length;
        let offset = word(&mut at);
        if let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name) {
            assert_eq!(cdr[at], 7, "32-bit floats");
            offsets[axis] = Some(offset);
        }
        at += 1;
        word(&mut at);
    }
    at += 1;
    let step = word(&mut at);
    word(&mut at);
    let length = word(&mut at);
    assert_eq!(length, height * width * step);
    let offsets = offsets.map(Option::unwrap);
    cdr[at..at + length].chunks_exact(step).map(|point| offsets.map(|offset| f32_at(point, offset))).collect()
}

fn ply(path: &Path) -> Vec<[f64; 3]> {
    let file =
        Parser::<DefaultElement>::new().read_ply(&mut BufReader::new(File::open(path).unwrap())).unwrap();
    let value = |point: &DefaultElement, axis: &str| match point[axis] {
        Property::Double(value) => value,
        Property::Float(value) => value.into(),
        _ => panic!("{axis} is no number"),
    };
    file.payload["vertex"].iter().map(|point| ["x", "y", "z"].map(|axis| value(point, axis))).collect()
}

fn las(path: &Path) -> Vec<[f64; 3]> {
    let points = las::Reader::from_path(path).unwrap().read_all().unwrap();
    points.x().zip(points.y()).zip(points.z()).map(|((x, y), z)| [x, y, z]).collect()
}

fn e57(path: &Path) -> Vec<[f64; 3]> {
    let mut file = e57::E57Reader::from_file(path).unwrap();
    let mut points = Vec::new();
    for scan in file.pointclouds() {
        let mut scan = file.pointcloud_simple(&scan).unwrap();
        scan.apply_pose(true);
        points.extend(scan.map(|point| match point.unwrap().cartesian {
            e57::CartesianCoordinate::Valid { x, y, z } => [x, y, z],
            other => panic!("{other:?}"),
        }));
    }
    points
}

fn pcd(bytes: &[u8]) -> Vec<[f64; 3]> {
    let end = memchr::memmem::find(bytes, b"DATA binary\n").unwrap() + 12;
    let head = text(&bytes[..end]);
    let added = head.lines().find_map(|line| line.strip_prefix("# add ")).unwrap();
    let added = numbers(added.split(' ').take(3));
    bytes[end..]
        .chunks_exact(32)
        .map(|point| [0, 1, 2].map(|axis| f32_at(point, 4 * axis) + added[axis]))
        .collect()
}

fn arrow(path: &Path) -> Vec<[f64; 3]> {
    let reader = arrow_ipc::reader::StreamReader::try_new(File::open(path).unwrap(), None).unwrap();
    let mut points = Vec::new();
    for batch in reader {
        let batch = batch.unwrap();
        let columns =
            ["X", "Y", "Z"].map(|name| batch.column_by_name(name).unwrap().as_primitive::<Float64Type>());
        points.extend((0..batch.num_rows()).map(|row| columns.map(|column| column.value(row))));
    }
    points
}

fn parquet(path: &Path) -> Vec<[f64; 3]> {
    let file = SerializedFileReader::new(File::open(path).unwrap()).unwrap();
    let rows = file.into_iter().map(|row| row.unwrap());
    rows.map(|row| [0, 1, 2].map(|axis| row.get_double(axis).unwrap())).collect()
}

/// The positions of a file of this format, in its own axes.
fn read(format: &str, path: &Path) -> Vec<[f64; 3]> {
    let bytes = fs::read(path).unwrap();
    match format {
        "xyz" => words(&bytes, 0, ' '),
        "csv" => words(&bytes, 1, ','),
        "bin" => {
            let dir = path.parent().unwrap();
            words(&succeed(dir, &["unzip", path.to_str().unwrap(), "-"]).stdout, 0, ' ')
        }
        "las" | "laz" | "copc" => las(path),
        "ply" | "ply-ascii" => ply(path),
        "raycloud" => bytes[memchr::memmem::find(&bytes, b"end_header\n").unwrap() + 11..]
            .chunks_exact(48)
            .map(|ray| [0, 8, 16].map(|at| f64_at(ray, at)))
            .collect(),
        "pcd" => pcd(&bytes),
        "e57" => e57(path),
        "mcap" => mcap(&bytes),
        "arrow" => arrow(path),
        "parquet" | "geoparquet" => parquet(path),
        other => panic!("no reader of {other}"),
    }
}

/// Compares positions; the order is that of the format where it has one of its own.
fn assert_same(format: &str, how: &str, mut found: Vec<[f64; 3]>, mut wanted: Vec<[f64; 3]>) {
    assert_eq!(found.len(), wanted.len(), "{format} {how}");
    if format == "copc" {
        for points in [&mut found, &mut wanted] {
            points.sort_by(|a, b| {
                a.map(|x| (x * 1e4).round()).partial_cmp(&b.map(|x| (x * 1e4).round())).unwrap()
            });
        }
    }
    for (found, wanted) in found.iter().zip(&wanted) {
        let is_near = found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(is_near, "{format} {how}: {found:?}, expected {wanted:?}");
    }
}

#[test]
fn the_list_of_formats_is_complete() {
    let refused = run(folder().path(), &["run", "s.xml", "--format", "none-of-them"]);
    let message = text(&refused.stderr);
    let known = message.split_once("[possible values:").and_then(|(_, rest)| rest.split_once(']'));
    let (known, _) = known.unwrap_or_else(|| panic!("no list of formats in\n{message}"));
    let known: Vec<&str> = known.split(',').map(str::trim).collect();
    assert_eq!(known, FORMATS.map(|(format, _)| format));
}

fn assert_alone(options: &[&str]) {
    let dir = folder();
    let dir = dir.path();
    fs::write(dir.join("s.xml"), spinning()).unwrap();
    let survey = |more: &[&str]| [&["run", "s.xml", "-q"][..], options, more].concat().join(" ");
    let vlscan = |line: String| succeed(dir, &line.split(' ').collect::<Vec<_>>()).stdout;
    vlscan(survey(&["-o", "world.csv", "--columns", "X,Y,Z"]));
    let world = words(&fs::read(dir.join("world.csv")).unwrap(), 1, ',');
    vlscan(survey(&["-o", "local.csv", "--columns", "ScannerX,ScannerY,ScannerZ"]));
    let local = words(&fs::read(dir.join("local.csv")).unwrap(), 1, ',');
    vlscan(survey(&["-o", "origins.csv", "--columns", "BeamOriginX,BeamOriginY,BeamOriginZ"]));
    let origins = words(&fs::read(dir.join("origins.csv")).unwrap(), 1, ',');
    let placed = local.iter().zip(&origins).map(|(p, o)| [p[0] + o[0], p[1] + o[1], p[2] + o[2]]).collect();
    assert_same("csv", "in the axes of the scanner", placed, world.clone());
    assert!(world.len() > 1000 && local.iter().any(|p| p[0] > 1.0) && local.iter().any(|p| p[0] < -1.0));

    vlscan(survey(&["--shard", "0/2", "-o", "shards"]));
    vlscan(survey(&["--shard", "1/2", "-o", "shards"]));
    for (format, extension) in FORMATS {
        let wanted = || if format == "mcap" { local.clone() } else { world.clone() };
        let file = |how: &str| format!("{format}_{how}.{extension}");
        let output = |how: &str| format!("-o {} --format {format}", file(how));
        vlscan(survey(&[&output("alone")]));
        let stdout = vlscan(survey(&["-o", "-", "--format", format]));
        fs::write(dir.join(file("stdout")), stdout).unwrap();
        vlscan(survey(&["--resume", &output("resumed")]));
        vlscan(format!("merge shards -q {} {}", output("merged"), options.join(" ")).trim().to_owned());
        for how in ["alone", "stdout", "resumed", "merged"] {
            assert_same(format, how, read(format, &dir.join(file(how))), wanted());
        }
    }
}

#[test]
fn every_format_holds_the_positions_by_itself() {
    assert_alone(&[]);
}

#[test]
fn every_format_holds_missed_pulses_by_itself() {
    assert_alone(&["--misses"]);
}

#[test]
fn columns_of_the_scanner_come_from_any_shards_and_true_causes_only_from_shards_that_hold_them() {
    let dir = folder();
    fs::write(dir.path().join("s.xml"), spinning()).unwrap();
    succeed(dir.path(), &["run", "s.xml", "-q", "--shard", "0/1", "-o", "shards"]);
    succeed(dir.path(), &["merge", "shards", "-q", "-o", "a.csv", "--columns", "ScannerX,ScannerY,ScannerZ"]);
    let merged = words(&fs::read(dir.path().join("a.csv")).unwrap(), 1, ',');
    assert!(merged.iter().all(|p| p.iter().any(|x| *x != 0.0)));
    let refused = run(dir.path(), &["merge", "shards", "-q", "-o", "b.csv", "--columns", "SurfaceX"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("true causes of echoes"), "{}", text(&refused.stderr));
}
