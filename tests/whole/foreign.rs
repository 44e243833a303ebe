//! Files of every kind given to every command that reads files: the message names the kind of the file and
//! what to do with it, and never speaks of bytes that are not UTF-8, or of XML where there is none.

use crate::common::{feed, folder, run, text};
use std::path::Path;

/// A kind: name of the file, bytes, words of the message that name the kind, and commands that read it.
type Kind = (&'static str, Vec<u8>, &'static str, &'static [&'static str]);

fn zip(entry: &str) -> Vec<u8> {
    let mut bytes = b"PK\x03\x04".to_vec();
    bytes.extend([0; 22]);
    bytes.extend((entry.len() as u16).to_le_bytes());
    bytes.extend([0; 2]);
    bytes.extend(entry.as_bytes());
    bytes
}

fn padded(start: &[u8], length: usize) -> Vec<u8> {
    let mut bytes = start.to_vec();
    bytes.resize(length.max(start.len()), 0x97);
    bytes
}

fn kinds() -> Vec<Kind> {
    let las = |format: u8| {
        let mut bytes = padded(b"LASF", 400);
        bytes[104] = format;
        bytes
    };
    let record =
        [100_000.0_f64, 0.85, 0.15, 300.0, 10.0, 0.0, 0.0, 0.01, 0.02, 1.0, 0.0, 0., 0., 0., 0., 0., 0.];
    let sbet = record.iter().flat_map(|number| number.to_le_bytes()).collect();
    let kind = |name, start: &[u8], words, read_by| (name, padded(start, 200), words, read_by);
    let text = |name, text: &str, words, read_by| (name, text.as_bytes().to_vec(), words, read_by);
    const POINTS: &[&str] = &["info", "info -", "raster", "compare", "preview", "fit", "reconstruct"];
    // Pulses of LAS have waveforms.
    const LASERS: &[&str] =
        &["info", "info -", "raster", "compare", "preview", "pulse", "fit", "reconstruct"];
    const LOGS: &[&str] = &["info", "info -", "raster", "compare", "preview", "fit", "reconstruct", "frames"];
    const SCENES: &[&str] = &["scene", "scene info", "scene pack", "trace scene"];
    vec![
        ("site.laz", las(0x83), "a LAZ point cloud", LASERS),
        kind("site.e57", b"ASTM-E57", "an E57 point cloud", POINTS),
        text("site.pcd", "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\n", "a PCD point cloud", POINTS),
        text("house.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "an OBJ mesh", SCENES),
        text("house.mtl", "newmtl grey\nKd 1 1 1\n", "an MTL material library", &[]),
        text("house.dae", "<?xml version=\"1.0\"?><COLLADA/>", "a COLLADA scene", &[]),
        kind("house.fbx", b"Kaydara FBX Binary", "an FBX mesh", &[]),
        kind("house.3ds", b"MM\xc8\0\0\0\x02\0\x0a\0\0\0\x03\0\0\0", "a 3D Studio mesh", &[]),
        kind("dem.tif", b"II*\0\x08\0\0\0", "a TIFF raster", SCENES),
        kind("plot.npy", b"\x93NUMPY\x01\0v\0{'descr'", "a NumPy array", &[]),
        kind("plot.h5", b"\x89HDF\r\n\x1a\n", "an HDF5 or NetCDF 4 file", &[]),
        kind("plot.shx", b"\0\0\x27\x0a", "shapefile", &["area", "line"]),
        ("plot.xlsx", zip("[Content_Types].xml"), "an Excel workbook", &[]),
        kind("log.mcap", b"\x89MCAP0\r\n", "an MCAP log", LOGS),
        kind("log.bag", b"#ROSBAG V2.0\n", "a ROS bag", &[]),
        kind("log.pcap", b"\xd4\xc3\xb2\xa1\x02\0\x04\0", "a packet capture (pcap)", &[]),
        ("flight.out", sbet, "an SBET trajectory", &["trajectory", "trajectory -"]),
        kind("points.parquet", b"PAR1\x15\x04", "a Parquet table", POINTS),
        kind("all.gz", b"\x1f\x8b\x08", "a gzip file", &["pulse"]),
        kind("all.7z", b"7z\xbc\xaf\x27\x1c", "a 7z archive", &[]),
        kind("map.png", b"\x89PNG\r\n\x1a\n", "a PNG picture", &[]),
        kind("report.pdf", b"%PDF-1.4\n", "a PDF document", &[]),
        text("make.py", "import numpy as np\n", "a Python program", &[]),
        kind("forest.vlscene", b"VLSCENE\n", "a packed scene of vlscan", SCENES),
        text("tiles.json", "{\"asset\": {}, \"geometricError\": 1}", "the index of a tiled point cloud", &[]),
    ]
}

/// A command: its name here, and its words, in which FILE is the file.
const COMMANDS: &[(&str, &str)] = &[
    ("run", "run FILE -o out.laz"),
    ("scene", "run survey.xml --scene FILE -o out.laz"),
    ("scene info", "scene info FILE"),
    ("scene pack", "scene pack FILE -o out.vlscene"),
    ("trajectory", "run flight.toml --trajectory FILE -o out.laz"),
    ("trajectory -", "run flight.toml --trajectory - -o out.laz"),
    ("scanner", "trace pulses.csv --scene roof.obj --scanner FILE -o out.laz"),
    ("pulses", "trace FILE --scene roof.obj --scanner riegl_vux-1uav -o out.laz"),
    ("pulses -", "trace - --scene roof.obj --scanner riegl_vux-1uav -o out.laz"),
    ("trace scene", "trace pulses.csv --scene FILE --scanner riegl_vux-1uav -o out.laz"),
    ("area", "plan airborne --area FILE --scanner riegl_vux-1uav --height 60 -o out.toml"),
    ("line", "plan mobile --along FILE --scanner vlp16 -o out.toml"),
    ("stand", "scene stand FILE -o out"),
    ("info", "info FILE"),
    ("info -", "info -"),
    ("raster", "raster FILE --dtm out.tif"),
    ("compare", "compare FILE roof.xyz"),
    ("preview", "preview FILE -o out.png"),
    ("pulse", "preview FILE --pulse 1 -o out.png"),
    ("fit", "fit FILE --output out.toml"),
    ("reconstruct", "scene reconstruct FILE -o out"),
    ("frames", "frames FILE -o out --layout kitti"),
    ("merge", "merge FILE -o out.laz"),
    ("campaign", "campaign FILE"),
    ("unzip", "unzip FILE out.txt"),
];

const SURVEY: &str = "<document><scene id=\"s\"><part><filter type=\"objloader\"><param type=\"string\" \
    key=\"filepath\" value=\"roof.obj\"/></filter></part></scene>\
    <survey name=\"s\" scene=\"survey.xml#s\" platform=\"data/platforms.xml#tripod\" \
    scanner=\"data/scanners_tls.xml#riegl_vz400\"><leg><platformSettings x=\"0\" y=\"0\" z=\"9\"/>\
    <scannerSettings pulseFreq_hz=\"100000\" scanFreq_hz=\"100\" scanAngle_deg=\"50\" headRotatePerSec_deg=\"50\" \
    headRotateStart_deg=\"0\" headRotateStop_deg=\"1\"/></leg></survey></document>";

const FLIGHT: &str = "scene = \"roof.obj\"\nscanner = { catalogue = \"riegl_vux-1uav\" }\n\
    platform = { catalogue = \"data/platforms.xml#sr22\" }\n[settings]\npulse_freq_hz = 100000\nscan_freq_hz = 100\n";

/// Writes what the commands need beside the file.
fn prepare(folder: &Path) {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("a file");
    write("survey.xml", SURVEY);
    write("flight.toml", FLIGHT);
    write("roof.obj", "v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n");
    write("roof.xyz", "0 0 0\n9 0 0\n0 9 0\n");
    write("pulses.csv", "time,x,y,z,dx,dy,dz\n0,1,1,50,0,0,-1\n");
}

/// Texts that no message may contain.
const NEVER: &[&str] =
    &["is not UTF-8", "unknown token", "not well-formed", "no Polygon in the KML", "panicked", "found \"\\"];

fn check(folder: &Path, (file, bytes, words, read_by): &Kind) -> Vec<String> {
    let mut wrong = Vec::new();
    for (name, command) in COMMANDS.iter().filter(|(name, _)| !read_by.contains(name)) {
        let args: Vec<&str> =
            command.split(' ').map(|word| if word == "FILE" { *file } else { word }).collect();
        let output = match name.ends_with(" -") {
            true => feed(folder, &args, bytes),
            false => run(folder, &args),
        };
        let said = text(&output.stderr);
        let is_fixed = said.contains("help:") || said.contains("; ");
        if output.status.code() != Some(2)
            || !said.contains(words)
            || !is_fixed
            || NEVER.iter().any(|n| said.contains(n))
        {
            wrong.push(format!("$ vlscan {}\n{said}", args.join(" ")));
        }
    }
    wrong
}

#[test]
fn every_command_names_the_kind_of_a_file_that_it_does_not_read_and_what_to_do() {
    let kinds = kinds();
    let wrong: Vec<String> = std::thread::scope(|scope| {
        let checks: Vec<_> = kinds
            .chunks(kinds.len().div_ceil(4))
            .map(|some| {
                scope.spawn(move || {
                    let folder = folder();
                    prepare(folder.path());
                    let each = some.iter().flat_map(|kind| {
                        std::fs::write(folder.path().join(kind.0), &kind.1).expect("a file");
                        check(folder.path(), kind)
                    });
                    each.collect::<Vec<_>>()
                })
            })
            .collect();
        checks.into_iter().flat_map(|check| check.join().expect("the check ends")).collect()
    });
    assert!(wrong.is_empty(), "{} messages are unclear:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn files_that_others_refer_to_are_named_by_their_kind() {
    let folder = folder();
    prepare(folder.path());
    let at = |name: &str| folder.path().join(name);
    let array = padded(b"\x93NUMPY\x01\0", 200);
    std::fs::write(at("tile.stl"), "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n").unwrap();
    for (file, args) in [
        ("materials.csv", &["scene", "info", "tile.stl"][..]),
        ("trees.csv", &["scene", "info", "trees.csv"]),
        ("scene.vox", &["scene", "info", "scene.vox"]),
        ("mosaic.vrt", &["scene", "info", "mosaic.vrt"]),
        ("plan.toml", &["run", "plan.toml", "-o", "out.laz"]),
        (
            "zone.prj",
            &[
                "trace",
                "pulses.csv",
                "--scene",
                "roof.obj",
                "--scanner",
                "riegl_vux-1uav",
                "--crs",
                "zone.prj",
                "-o",
                "out.laz",
            ],
        ),
        (
            "sensor.json",
            &["trace", "pulses.csv", "--scene", "roof.obj", "--scanner", "sensor.json", "-o", "out.laz"],
        ),
        ("roof.mtl", &["scene", "info", "with.obj"]),
    ] {
        std::fs::write(at(file), &array).unwrap();
        std::fs::write(at("with.obj"), "mtllib roof.mtl\nv 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n").unwrap();
        let output = run(folder.path(), args);
        let said = text(&output.stderr);
        assert!(output.status.code() == Some(2) && said.contains("found a NumPy array"), "{args:?}: {said}");
        assert!(said.contains("numpy.savetxt") && said.contains(file), "{args:?}: {said}");
        std::fs::remove_file(at(file)).unwrap();
    }
}
