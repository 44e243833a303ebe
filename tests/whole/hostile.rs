//! Damaged files of a scene: the run ends with points where the file can pass for a complete one, else with
//! exit status 2 and a message that names the file and the line; never with a panic or out of memory, and in
//! finite time.
//!
//! Each format is one [`Case`]: a valid file, how it is damaged, and which cuts cannot be detected. Text
//! formats have no end mark, so a file that was cut between two statements cannot be told from a whole one,
//! nor one whose last number lost digits; such cuts must only not fail otherwise.

use crate::common;
use crate::common::text;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const TRIANGLES: &str = "v -9.5 9.25 -9.0\nv 9.5 9.25 -9.0\nv 9.5 9.25 9.0\nv -9.5 9.25 9.0\nf 1 2 3\nf 1 3 4\nf 1 2 4\nf 2 3 4\n";
const MATERIAL: &str = "newmtl grey\nKd 0.25 0.25 0.25\nKs 0.125 0.125 0.125\nNs 12.5\nhelios_reflectance 0.5\n\
    helios_spectra moss\nhelios_classification 12\nhelios_isGround true\n";
const CLOUD: &str =
    "-2.25 9.25 -1.25 0.5 0.5 0.5\n-1.25 9.25 1.25 0.5 0.5 0.5\n-1.25 9.25 1.25 0.5 0.5 0.5\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\nend_header\n\
    -2.25 9.25 -1.25\n-1.25 9.25 1.25\n-1.25 9.25 1.25\n";
const VOXELS: &str = "VOXEL SPACE\n#min_corner: -12.5 8.5 -12.5\n#max_corner: 12.5 13.5 12.5\n#split: 5 1 5\n#res: 5.0 #max_pad: 5.0\n\
    i j k PadBVTotal a b c d e f g h n transmittance m l\n\
    2 0 2 1.25 54.25 0.5 0.5 0.5 1.25 0.5 12.5 7 60 0.75 0.5 0.25\n\
    2 0 3 1.25 54.25 0.5 0.5 0.5 1.25 0.5 12.5 7 60 0.75 0.5 0.25\n";
const LEAVES: &str = "0.0,0.0,1.0,0.25\n1.0,0.0,0.0,0.75\n0.0,0.0,-1.0,0.25\n";
const PLACES: &str =
    "file,x,y,z,yaw,scale\nmesh.obj,0.25,0.25,0.25,90.5,1.25\nmesh.obj,1.25,0.25,0.25,45.5,1.25\n";
const SURVEY: &str = "<?xml version=\"1.0\"?>\n<document>\n <survey name=\"s\" scene=\"scene.xml#s\" platform=\"data/platforms.xml#tripod\" \
    scanner=\"own.xml#beam\">\n  <FWFSettings binSize_ns=\"0.25\" beamSampleQuality=\"2\"/>\n  <leg>\n   <platformSettings x=\"0.25\" \
    y=\"0.25\" z=\"0.25\"/>\n   <scannerSettings pulseFreq_hz=\"1000\" scanAngle_deg=\"20.5\" scanFreq_hz=\"50\" headRotateStart_deg=\"0\" \
    headRotateStop_deg=\"36\" headRotatePerSec_deg=\"360\"/>\n  </leg>\n </survey>\n</document>\n";
const SCANNER: &str = "<document><scanner id=\"beam\" name=\"beam\" optics=\"rotating\" accuracy_m=\"0.0\" beamDivergence_rad=\"0.0003\" \
    pulseFreqs_Hz=\"1000\" pulseLength_ns=\"4\" rangeMin_m=\"0.1\" wavelength_nm=\"1000\" scanAngleMax_deg=\"60\" \
    scanAngleEffectiveMax_deg=\"60\" scanFreqMin_Hz=\"1\" scanFreqMax_Hz=\"100\" headRotatePerSecMax_deg=\"360\">\
    <beamOrigin z=\"0.1\"/><headRotateAxis z=\"1\"/></scanner></document>";

/// A format and how its files are damaged.
struct Case {
    /// The file that is damaged.
    file: &'static str,
    whole: Vec<u8>,
    /// `<part>` elements around it.
    parts: &'static str,
    /// Replacements (of the first occurrence), each of which makes the file invalid.
    broken: &'static [(&'static str, &'static str)],
    /// True if a beginning of the file can pass for a complete one.
    passes: fn(&str) -> bool,
    /// True if lines can be named.
    is_text: bool,
    /// True if an empty file is detected as an error.
    lines_may_change: bool,
}

/// The last line of a text and whether anything ends it.
fn last(text: &str) -> (&str, bool) {
    (text.lines().last().unwrap_or_default(), text.ends_with('\n'))
}

fn columns(line: &str) -> usize {
    line.split([' ', ',']).filter(|w| !w.is_empty() && *w != "-").count()
}

fn cases() -> Vec<Case> {
    let case = |file, whole: &str, parts, broken, passes| Case {
        file,
        whole: whole.as_bytes().to_vec(),
        parts,
        broken,
        passes,
        is_text: true,
        lines_may_change: true,
    };
    const MESH: &str = r#"<part><filter type="objloader"><param type="string" key="filepath" value="mesh.obj"/></filter></part>"#;
    vec![
        case(
            "mesh.obj",
            TRIANGLES,
            MESH,
            &[
                ("v 9.5 9.25 -9.0", "v nan 9.25 -9.0"),
                ("v 9.5 9.25 -9.0", "v inf 9.25 -9.0"),
                ("v 9.5 9.25 -9.0", "v 1e300 9.25 -9.0"),
                ("v 9.5 9.25 -9.0", "v 9.5 9.25"),
                ("v 9.5 9.25 -9.0", "v 9.5,9.25,-9.0"),
                ("f 1 3 4", "f 1 3 5"),
                ("f 1 3 4", "f 1 3 -5"),
                ("f 1 3 4", "f 1 3 0"),
                ("f 1 3 4", "f 1 3"),
                ("f 1 3 4", "f 1 3 99999999999999999999"),
                ("f 1 3 4", "f 1 3 four"),
            ],
            // A face in which digits are missing would name another vertex; here numbers have one digit.
            |t| columns(last(t).0) == 4 && last(t).0.starts_with('f'),
        ),
        case(
            "grey.mtl",
            MATERIAL,
            MESH,
            &[
                ("Kd 0.25", "Kd nan"),
                ("Kd 0.25", "Kd inf"),
                ("Kd 0.25", "Kd 1e300"),
                ("Kd 0.25 0.25 0.25", "Kd 0.25 0.25"),
                ("Ks 0.125", "Ks -0.125"),
                ("Ns 12.5", "Ns"),
                ("helios_reflectance 0.5", "helios_reflectance much"),
                ("helios_reflectance 0.5", "helios_reflectance inf"),
                ("helios_classification 12", "helios_classification 1e300"),
                ("helios_isGround true", "helios_isGround perhaps"),
            ],
            // Unknown words are skipped, and a keyword without its end is one.
            |t| match last(t).0.split_whitespace().collect::<Vec<_>>()[..] {
                ["newmtl" | "Ns" | "helios_reflectance" | "helios_spectra" | "helios_classification"] => {
                    false
                }
                ["Kd" | "Ks" | "helios_isGround"] | ["Kd" | "Ks", _, _] => false,
                ["helios_isGround", word] => word == "true",
                [_, "." | "-"] => false,
                _ => true,
            },
        ),
        case(
            "cloud.xyz",
            CLOUD,
            r#"<part><filter type="xyzloader"><param type="string" key="filepath" value="cloud.xyz"/>
            <param type="string" key="separator" value=" "/><param type="double" key="voxelSize" value="5"/></filter></part>"#,
            &[
                ("-2.25 9.25", "nan 9.25"),
                ("-2.25 9.25", "inf 9.25"),
                ("-2.25 9.25", "1e300 9.25"),
                ("-2.25 9.25", "-2.25;9.25"),
                ("-2.25 9.25 -1.25 0.5 0.5 0.5", "2.25 9.25"),
                ("-2.25", "two"),
            ],
            // The number of columns of the first line is not known.
            |t| columns(last(t).0) == 6 || (t.lines().count() == 1 && columns(t) >= 3),
        ),
        case(
            "space.vox",
            VOXELS,
            r#"<part><filter type="detailedvoxels"><param type="string" key="filepath" value="space.vox"/></filter></part>"#,
            &[
                ("2 0 3 1.25", "2 0 3 -1.25"),
                ("2 0 3 1.25", "2 0 3 inf"),
                ("2 0 3 1.25", "nan 0 3 1.25"),
                ("2 0 3 1.25", "2 0 1e300 1.25"),
                ("2 0 3 1.25", "2 0 -3 1.25"),
                ("2 0 3 1.25", "2 0 3"),
                ("#res: 5.0", "#res: nan"),
                ("#res: 5.0", "#res: 0"),
                ("#res: 5.0", "#res: 1e300"),
                ("#split: 5 1 5", "#split: 5 1"),
                ("#min_corner: -12.5", "#min_corner: inf"),
                ("#min_corner: -12.5", "#min_corner: x"),
            ],
            |t| columns(last(t).0) == 16 && last(t).0.starts_with('2'),
        ),
        case(
            "leaves.txt",
            LEAVES,
            r#"<part><filter type="detailedvoxels"><param type="string" key="filepath" value="space.vox"/>
            <param type="string" key="ladlut" value="leaves.txt"/></filter></part>"#,
            &[
                ("0.75", "nan"),
                ("0.75", "inf"),
                ("0.75", "1e300"),
                ("0.75", "-0.75"),
                ("1.0,0.0,0.0", "1.0,0.0"),
                ("1.0,0.0,0.0", "9.0,0.0,0.0"),
                ("1.0,0.0,0.0", "1.0;0.0;0.0"),
            ],
            |t| last(t).1 || columns(last(t).0) == 4 && !t.ends_with('-'),
        ),
        Case {
            whole: spectrum(),
            ..case(
                "spectra/moss.txt",
                "",
                MESH,
                &[
                    ("0.5\t10.5", "0.5\tnan"),
                    ("0.5\t10.5", "0.5\tinf"),
                    ("0.5\t10.5", "1e300\t10.5"),
                    ("0.5\t10.5", "0.5"),
                    ("0.5\t10.5", "rubbish"),
                ],
                |t| t.lines().count() > 26 && last(t).0.split('\t').filter(|w| !w.is_empty()).count() == 2,
            )
        },
        case(
            "places.csv",
            PLACES,
            r#"<part><filter type="instances"><param type="string" key="filepath" value="places.csv"/></filter></part>"#,
            &[
                ("1.25,0.25,0.25,45.5", "nan,0.25,0.25,45.5"),
                ("1.25,0.25,0.25,45.5", "inf,0.25,0.25,45.5"),
                ("1.25,0.25,0.25,45.5", "1e300,0.25,0.25,45.5"),
                ("0.25,45.5,1.25", "0.25,45.5,0"),
                ("0.25,45.5,1.25", "0.25,45.5,1e300"),
                ("mesh.obj,1.25,0.25,0.25,45.5,1.25", "mesh.obj,1.25,0.25"),
                ("mesh.obj,1.25,0.25,0.25", "mesh.obj,1.25,0.25,0.25,0,0,0"),
                ("mesh.obj,1.25", "other.obj,1.25"),
                ("45.5", "x"),
            ],
            |t| t.lines().count() > 1 && (last(t).1 || columns(last(t).0) == 6),
        ),
        Case {
            whole: scene(MOVING).into_bytes(),
            ..case(
                "scene.xml",
                "",
                "",
                &[
                    ("vec=\"0;0.25;0\"", "vec=\"0;nan;0\""),
                    ("vec=\"0;0.25;0\"", "vec=\"0;inf;0\""),
                    ("vec=\"0;0.25;0\"", "vec=\"0;1e300;0\""),
                    ("vec=\"0;0.25;0\"", "vec=\"0;0.25\""),
                    ("angle=\"3.5\"", "angle=\"nan\""),
                    ("angle=\"3.5\"", "angle=\"1e300\""),
                    ("angle=\"3.5\"", "angle=\"much\""),
                    ("axis=\"0;0;1\"", "axis=\"0;0;0\""),
                    ("type=\"rotation\"", "type=\"rotatoin\""),
                    ("value=\"1.5\"", "value=\"nan\""),
                    ("value=\"1.5\"", "value=\"1e300\""),
                    ("mesh.obj", "nesh.obj"),
                    ("</part>", "</prat>"),
                ],
                |t| t.trim_end().ends_with("</document>"),
            )
        },
        case(
            "survey.xml",
            SURVEY,
            MESH,
            &[
                ("x=\"0.25\"", "x=\"nan\""),
                ("x=\"0.25\"", "x=\"1e300\""),
                ("binSize_ns=\"0.25\"", "binSize_ns=\"0\""),
                ("binSize_ns=\"0.25\"", "binSize_ns=\"-1\""),
                ("beamSampleQuality=\"2\"", "beamSampleQuality=\"1000000000\""),
                ("scene.xml#s", "scene.xml#t"),
                ("own.xml#beam", "own.xml#beem"),
                ("</leg>", ""),
            ],
            |t| t.trim_end().ends_with("</document>"),
        ),
        Case {
            is_text: false,
            lines_may_change: false,
            ..case(
                "cloud.ply",
                PLY,
                r#"<part><filter type="xyzloader"><param type="string" key="filepath" value="cloud.ply"/>
                <param type="double" key="voxelSize" value="5"/></filter></part>"#,
                &[
                    ("9.25", "nan"),
                    ("9.25", "inf"),
                    ("9.25", "1e300"),
                    ("9.25", "x"),
                    ("-2.25 9.25", "-2.25"),
                    ("vertex 3", "vertex 4"),
                    ("vertex 3", "vertex 18446744073709551615"),
                    ("vertex 3", "vertex -3"),
                    ("vertex 3", "face 3"),
                    ("double x", "double q"),
                    ("ascii", "cuneiform"),
                ],
                |_| false,
            )
        },
        Case {
            whole: las_cloud(),
            is_text: false,
            lines_may_change: false,
            ..case(
                "cloud.las",
                "",
                r#"<part><filter type="xyzloader"><param type="string" key="filepath" value="cloud.las"/>
                <param type="double" key="voxelSize" value="5"/></filter></part>"#,
                &[],
                |_| false,
            )
        },
        Case {
            whole: raster(3),
            is_text: false,
            lines_may_change: false,
            ..case(
                "dem.tif",
                "",
                r#"<part><filter type="geotiffloader"><param type="string" key="filepath" value="dem.tif"/></filter></part>"#,
                &[],
                |_| false,
            )
        },
    ]
}

const MOVING: &str = r#"<part>
 <filter type="objloader"><param type="string" key="filepath" value="mesh.obj"/></filter>
 <filter type="scale"><param type="double" key="scale" value="1.5"/></filter>
 <dmotion id="a" loop="5" next="a">
  <motion type="translation" vec="0;0.25;0"/>
  <motion type="rotation" axis="0;0;1" angle="3.5" selfMode="true"/>
 </dmotion>
</part>
"#;

fn scene(parts: &str) -> String {
    format!("<?xml version=\"1.0\"?>\n<document>\n<scene id=\"s\">\n{parts}</scene>\n</document>\n")
}

fn spectrum() -> Vec<u8> {
    let header = (1..=26).map(|n| format!("header {n}\n")).collect::<String>();
    format!("{header}0.5\t10.5\n1.0\t20.5\n1.5\t30.5\n").into_bytes()
}

/// A little-endian raster of size × size floats; its directory is behind the pixels, so that every cut is
/// detected.
pub fn raster(size: u32) -> Vec<u8> {
    let directory = 8 + 4 * size * size;
    let doubles = directory + 2 + 12 * 12 + 4;
    let entries: [(u16, u16, u32, u32); 12] = [
        (256, 4, 1, size),
        (257, 4, 1, size),
        (258, 3, 1, 32),
        (259, 3, 1, 1),
        (262, 3, 1, 1),
        (273, 4, 1, 8),
        (277, 3, 1, 1),
        (278, 4, 1, size),
        (279, 4, 1, 4 * size * size),
        (339, 3, 1, 3),
        (33550, 12, 3, doubles),
        (33922, 12, 6, doubles + 24),
    ];
    let mut out = b"II\x2a\0".to_vec();
    out.extend(directory.to_le_bytes());
    out.extend((0..size * size).flat_map(|i| (-2.0 - 0.1 * (i % 9) as f32).to_le_bytes()));
    out.extend(12u16.to_le_bytes());
    for (tag, kind, count, value) in entries {
        out.extend(tag.to_le_bytes());
        out.extend(kind.to_le_bytes());
        out.extend(count.to_le_bytes());
        out.extend(value.to_le_bytes());
    }
    out.extend([0; 4]);
    let (scale, tie) = ([30.0f64, 30.0, 0.0], [0.0f64, 0.0, 0.0, -45.0, 45.0, 0.0]);
    out.extend(scale.iter().chain(&tie).flat_map(|x| x.to_le_bytes()));
    out
}

/// LAS 1.2 with the points of the other clouds, in units of 0.25 m.
fn las_cloud() -> Vec<u8> {
    let mut out = b"LASF".to_vec();
    out.resize(227, 0);
    let mut put = |at: usize, bytes: &[u8]| out[at..at + bytes.len()].copy_from_slice(bytes);
    put(24, &[1, 2]);
    put(94, &227u16.to_le_bytes());
    put(96, &227u32.to_le_bytes());
    put(105, &20u16.to_le_bytes());
    put(107, &3u32.to_le_bytes());
    (0..3).for_each(|axis| put(131 + 8 * axis, &0.25f64.to_le_bytes()));
    for point in [[-9i32, 37, -5], [-5, 37, 5], [-5, 37, 5]] {
        out.extend(point.iter().flat_map(|x| x.to_le_bytes()));
        out.extend([0; 8]);
    }
    out
}

fn write(folder: &Path, name: &str, bytes: &[u8]) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// Runs the survey with the case's file replaced by `bytes`: exit status, messages and points. 1.5 GB of
/// address space, most of it stacks and maps, and a minute are the limits.
fn outcome(case: &Case, bytes: &[u8]) -> (i32, String, Vec<u8>) {
    let dir = common::folder();
    let folder = dir.path();
    let mesh = format!("mtllib grey.mtl\nusemtl grey\n{TRIANGLES}");
    // The spectrum is used where the material has no reflectance.
    let material = MATERIAL.replace("helios_reflectance 0.5\n", "");
    for (name, content) in [
        ("mesh.obj", mesh.as_bytes()),
        ("grey.mtl", material.as_bytes()),
        ("space.vox", VOXELS.as_bytes()),
        ("own.xml", SCANNER.as_bytes()),
        ("survey.xml", SURVEY.as_bytes()),
        ("scene.xml", scene(case.parts).as_bytes()),
        ("spectra/moss.txt", &spectrum()),
        (case.file, bytes),
    ] {
        write(folder, name, content);
    }
    let mut child = Command::new("sh")
        .current_dir(folder)
        .args([
            "-c",
            "ulimit -v 1500000; exec \"$0\" run survey.xml -o out.xyz -j 1 --max-memory 20M --assets .",
        ])
        .arg(env!("CARGO_BIN_EXE_vlscan"))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(std::fs::File::create(folder.join("messages")).unwrap())
        .spawn()
        .expect("the program starts");
    let started = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status.code().unwrap_or(-1);
        }
        if started.elapsed() > Duration::from_secs(60) {
            let _ = child.kill();
            let _ = child.wait();
            break -2;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let messages = text(&std::fs::read(folder.join("messages")).unwrap());
    (status, messages, std::fs::read(folder.join("out.xyz")).unwrap_or_default())
}

/// Failures of the program, reported together at the end.
#[derive(Default)]
struct Complaints(Vec<String>);

impl Complaints {
    fn expect(&mut self, holds: bool, complaint: impl FnOnce() -> String) {
        if !holds {
            self.0.push(complaint());
        }
    }

    /// The run must end with 2 and name the file, and the line where there are lines.
    fn refused(&mut self, case: &Case, bytes: &[u8], how: &str) {
        let (status, messages, _) = outcome(case, bytes);
        let name = case.file.rsplit('/').next().unwrap();
        // A file of another kind has no line that is at fault.
        let is_other_kind = |line: &str| line.contains("expected ") && line.ends_with(&format!(": {name}"));
        let named = messages.lines().any(is_other_kind)
            || messages.lines().any(|line| {
                line.split(name).nth(1).is_some_and(|rest| {
                    let number = rest.trim_start_matches(':').bytes().take_while(u8::is_ascii_digit).count();
                    !case.is_text || (rest.starts_with(':') && number > 0)
                })
            });
        self.expect(status == 2 && named, || {
            let named = if named { "" } else { ", no line is named" };
            format!("{} {how}: status {status}{named}\n{messages}", case.file)
        });
    }

    /// The run must give points, which are returned.
    fn read(&mut self, case: &Case, bytes: &[u8], how: &str) -> Vec<u8> {
        let (status, messages, points) = outcome(case, bytes);
        self.expect(status == 0 && !points.is_empty(), || {
            format!("{} {how}: status {status}, {} bytes of points\n{messages}", case.file, points.len())
        });
        points
    }

    fn told(self) {
        assert!(self.0.is_empty(), "{} complaints:\n\n{}", self.0.len(), self.0.join("\n\n"));
    }
}

#[test]
fn whole_files_are_read_with_any_line_end_and_comments_in_latin_1() {
    let mut all = Complaints::default();
    for case in cases() {
        let points = all.read(&case, &case.whole, "whole");
        if !case.lines_may_change {
            continue;
        }
        let whole = text(&case.whole);
        let crlf = whole.replace('\n', "\r\n");
        let same = |all: &mut Complaints, bytes: &[u8], how: &str| {
            let found = all.read(&case, bytes, how);
            all.expect(found == points, || format!("{} {how}: other points", case.file));
        };
        same(&mut all, crlf.as_bytes(), "with CRLF");
        same(&mut all, whole.trim_end().as_bytes(), "without its last line end");
        same(&mut all, format!("\u{feff}{whole}").as_bytes(), "with a byte order mark");
        let (comment, first) = match case.file {
            "mesh.obj" | "grey.mtl" | "places.csv" => (&b"# Geb\xe4ude\n"[..], 0),
            "cloud.xyz" => (&b"// H\xe4user\n"[..], 0),
            "space.vox" => (&b"#author: M\xfcller\n"[..], whole.find('#').unwrap()),
            "scene.xml" | "survey.xml" => (&b"<!-- K\xf6ln -->\n"[..], whole.find("<document>").unwrap()),
            "spectra/moss.txt" => continue,
            _ => continue,
        };
        let latin = [&case.whole[..first], comment, &case.whole[first..]].concat();
        same(&mut all, &latin, "with a comment in Latin-1");
    }
    all.told();
}

#[test]
fn empty_files_and_noise_are_refused() {
    let noise: Vec<u8> = (0..4000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let mut all = Complaints::default();
    for case in cases() {
        all.refused(&case, b"", "empty");
        all.refused(&case, &noise, "noise");
        let half = [&case.whole[..case.whole.len() / 2], &noise].concat();
        all.refused(&case, &half, "noise behind its first half");
    }
    all.told();
}

#[test]
fn cuts_at_each_tenth_are_refused_where_they_show() {
    let (mut all, mut seen, mut unseen) = (Complaints::default(), 0, 0);
    for case in cases() {
        for tenth in 1..10 {
            let cut = &case.whole[..case.whole.len() * tenth / 10];
            let how = format!("cut at {tenth}/10");
            if (case.passes)(&text(cut)) {
                // The rest is a valid file, perhaps without geometry.
                let (status, messages, _) = outcome(&case, cut);
                all.expect(status == 0, || format!("{} {how}: status {status}\n{messages}", case.file));
                unseen += 1;
            } else {
                all.refused(&case, cut, &how);
                seen += 1;
            }
        }
    }
    all.told();
    assert!(seen > 3 * unseen, "{seen} cuts show, {unseen} do not");
}

#[test]
fn impossible_numbers_and_wrong_counts_are_refused() {
    let mut all = Complaints::default();
    for case in cases() {
        let whole = text(&case.whole);
        for (old, new) in case.broken {
            assert!(whole.contains(old), "{}: {old} is not in the sound file", case.file);
            all.refused(&case, whole.replacen(old, new, 1).as_bytes(), &format!("with {new}"));
        }
    }
    all.told();
}

#[test]
fn rasters_that_contradict_themselves_are_refused() {
    let case = cases().into_iter().find(|c| c.file == "dem.tif").unwrap();
    let mut all = Complaints::default();
    // Values of directory entries, and doubles behind the directory.
    let entry = |n: usize| 44 + 2 + 12 * n + 8;
    let double = |n: usize| 44 + 2 + 12 * 12 + 4 + 8 * n;
    let long = |v: u32| v.to_le_bytes().to_vec();
    let real = |v: f64| v.to_le_bytes().to_vec();
    for (what, at, value) in [
        ("four billion columns", entry(0), long(u32::MAX)),
        ("a million rows", entry(1), long(1_000_000)),
        ("no columns", entry(0), long(0)),
        ("pixels of 8 bits more", entry(2), long(64)),
        ("a strip behind the end", entry(5), long(1 << 20)),
        ("a strip of 4 GB", entry(8), long(u32::MAX)),
        ("a strip of 1 byte", entry(8), long(1)),
        ("strips of no rows", entry(7), long(0)),
        ("an unknown compression", entry(3), long(7777)),
        ("a NaN pixel size", double(0), real(f64::NAN)),
        ("an infinite pixel size", double(0), real(f64::INFINITY)),
        ("a pixel size of 0", double(1), real(0.0)),
        ("pixels of 1e300 m", double(0), real(1e300)),
        ("a NaN tie point", double(6), real(f64::NAN)),
        ("a tie point far out", double(6), real(1e300)),
    ] {
        let mut bytes = case.whole.clone();
        bytes[at..at + value.len()].copy_from_slice(&value);
        all.refused(&case, &bytes, what);
    }
    all.told();
}

#[test]
fn scenes_above_the_limit_are_refused_before_they_are_built() {
    let case = cases().into_iter().find(|c| c.file == "mesh.obj").unwrap();
    // Small text, much geometry: ten fans of 300,000 triangles in a line each.
    let fan = format!("f{}\n", " 1 2 3".repeat(100_000));
    let fan = format!("{TRIANGLES}{}", fan.repeat(10));
    let (status, messages, _) = outcome(&case, fan.as_bytes());
    assert!(status == 2 && messages.contains("needs at least"), "{status}: {messages}");
}

#[test]
fn clouds_that_contradict_themselves_are_refused() {
    let case = cases().into_iter().find(|c| c.file == "cloud.las").unwrap();
    let mut all = Complaints::default();
    let real = |v: f64| v.to_le_bytes().to_vec();
    for (what, at, value) in [
        ("four billion points", 107, u32::MAX.to_le_bytes().to_vec()),
        ("one point more", 107, vec![4]),
        ("points behind the end", 96, u32::MAX.to_le_bytes().to_vec()),
        ("points of no bytes", 105, vec![0, 0]),
        ("points of 21 bytes", 105, vec![21]),
        ("format 11", 104, vec![11]),
        ("format 0, compressed by nobody", 104, vec![0x80]),
        ("version 2.0", 24, vec![2, 0]),
        ("a NaN scale", 131, real(f64::NAN)),
        ("a scale of 0", 131, real(0.0)),
        ("a scale of 1e300", 131, real(1e300)),
        ("an infinite offset", 155, real(f64::INFINITY)),
        ("an offset of 1e300", 163, real(1e300)),
    ] {
        let mut bytes = case.whole.clone();
        bytes[at..at + value.len()].copy_from_slice(&value);
        all.refused(&case, &bytes, what);
    }
    all.told();
}

#[test]
fn what_needs_more_memory_than_allowed_is_refused_before_it_is_built() {
    // The limit is 20M, 20 · 2^20 bytes.
    let of = |file: &str| Case { is_text: false, ..cases().into_iter().find(|c| c.file == file).unwrap() };
    let mut all = Complaints::default();
    let padding = format!("<!-- {} -->", "x".repeat(3_000_000));
    let (scene, places) = (of("scene.xml"), of("places.csv"));
    all.refused(&scene, &[&scene.whole[..], padding.as_bytes()].concat(), "of 3 MB");
    let line = "mesh.obj,1.25,0.25,0.25,45.5,1.25\n";
    all.refused(&places, &[&places.whole[..], line.repeat(100_000).as_bytes()].concat(), "of 100 000 lines");
    let (status, messages, _) = outcome(&of("dem.tif"), &raster(1200));
    all.expect(
        status == 2 && messages.contains("raster") && messages.contains("the limit is 20.97 MB"),
        || format!("a raster of 1200 x 1200: status {status}\n{messages}"),
    );
    all.told();
}

/// Compressed points with some bytes overwritten: libraries that read them assert that they make sense.
#[test]
fn a_preview_of_damaged_points_ends_with_a_message() {
    let folder = common::folder();
    let survey = common::fixture("forest/survey.xml");
    common::succeed(
        folder.path(),
        &["run", text(survey.as_os_str().as_encoded_bytes()).as_str(), "-q", "-o", "a.laz"],
    );
    let whole = std::fs::read(folder.path().join("a.laz")).unwrap();
    let mut refused = 0;
    for tenth in 1..10 {
        let mut broken = whole.clone();
        let at = whole.len() * tenth / 10;
        broken[at..at + 40].fill(0xff);
        std::fs::write(folder.path().join("broken.laz"), broken).unwrap();
        // A picture leaves layers compressed that a description reads.
        let small = ["--width", "320", "--height", "240", "-o", "a.png", "--force"];
        for args in [&[&["preview", "broken.laz"], &small[..]].concat()[..], &["info", "broken.laz"]] {
            let run = common::run(folder.path(), args);
            let said = text(&run.stderr);
            let has_ended = matches!(run.status.code(), Some(0 | 2)) && !said.contains("panicked");
            assert!(has_ended, "{tenth}, {args:?}: {said}");
            refused += usize::from(!run.status.success());
        }
    }
    assert!(refused > 0, "nothing of it was noticed");
}
