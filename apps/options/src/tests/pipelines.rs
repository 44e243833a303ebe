//! Pipeline files.

use super::*;
use crate::outputs::OutputContent;
use crate::values::{Bytes, Crs, MaxOrder, Seed};
use vlscan_geom::{DVec3, radians};
use vlscan_survey::*;
use vlscan_trace::Builder;

/// A pipeline with a complete instrument and every table.
pub(super) const EVERYTHING: &str = r#"
scene = "a.obj"
name = "mine"
seed = "2020-01-01 00:00:00"
crs = 'PROJCS["x"]'
gps_start = "2022-01-01 00:00:00"
strict = false
assets = ["more"]

[platform]
kind = "linear_path"
mount = { offset_m = [0, 0, 0.7], rotate_deg = [{ x = -90 }, { z = 90 }] }

[scanner]
id = "own"
optics = "rotating"
pulse_freqs_hz = [1000, 2000]
scan_angle_max_deg = 60
scan_freq_max_hz = 100
head_rate_max_deg_per_s = 30
range_error_m = "0.1*THETA"
wavelength_nm = 905

[[scanner.channel]]
beam_origin = { rotate_deg = [{ z = 5 }], local = true }

[[scanner.channel]]
id = "second"
firing_offset_us = 4
optics = "risley"
prisms = [{ rotor_freq_hz = 10, wedge_deg = 18, index = 1.5 }]

[settings]
pulse_freq_hz = 2000
scan_freq_hz = 50
scan_angle_deg = 20

[[leg]]
position_m = [0, 0, 100]
speed_m_per_s = 30
strip = "A"

[[leg]]
position_m = [100, 0, 100]
active = false
platform = "data/platforms.xml#simple_linearpath"
settings = { scan_freq_hz = 60 }

[waveform]
quality = 2
window_ns = 2.5

[detector]
accuracy_m = 0.02
distance_error = "1+t"

[physics]
legacy_energy = true
max_order = 9
platform_noise = false

[schedule]
threads = 3
tree = "sah"
max_memory = "2G"

[[output]]
path = "points.laz"
per_leg = true

[[output]]
path = "-"
format = "xyz"
content = "trajectory"
"#;

fn read(text: &str) -> Result<(Pipeline, Diagnostics)> {
    let folder = Folder::new(&[("p.toml", text), ("a.obj", ""), ("t.csv", "")]);
    folder.write(
        "survey.xml",
        &document(
            "",
            "platform='plane'",
            "<leg><platformSettings x='1' y='0' z='0'/><scannerSettings scanFreq_hz='50'/></leg>",
        ),
    );
    read_pipeline(&folder.path("p.toml"))
}

fn fine(text: &str) -> Pipeline {
    let (pipeline, warnings) = read(text).unwrap_or_else(|e| panic!("{}", report(&e)));
    assert!(warnings.is_empty(), "{}", warnings.text());
    pipeline
}

#[test]
fn every_table() {
    let (survey, options) = fine(EVERYTHING);
    assert_eq!(survey.name, "mine");
    assert_eq!(options.output.crs, Some(Crs::Wkt("PROJCS[\"x\"]".to_owned())));
    assert!(matches!(survey.platform.kind, PlatformKind::LinearPath));
    assert!((survey.platform.mount.rotation.forward() + DVec3::Z).length() < 1e-12);
    let [first, second] = &survey.scanner.devices[..] else { panic!("two channels") };
    assert_eq!((first.id.as_str(), second.id.as_str(), survey.scanner.multi_channel), ("0", "second", true));
    assert!(
        matches!(first.deflector, Deflector::Polygon { effective_max, .. } if effective_max == radians(60.0))
    );
    assert!(matches!(&second.deflector, Deflector::Risley { prisms, .. } if prisms[0].index == 1.5));
    assert_eq!((first.waveform.quality, second.waveform.window, second.detector.accuracy), (2, 2.5, 0.02));
    assert_eq!((first.firing_offset, second.firing_offset), (0.0, 4e-6));
    let [one, two] = &survey.legs[..] else { panic!("two legs") };
    assert_eq!((one.scanner.pulse_freq, one.scanner.scan_freq, one.platform.speed), (2000, 50.0, 30.0));
    assert_eq!((one.platform.mount, two.platform.mount), (None, Some(Mount::IDENTITY)));
    assert_eq!((two.scanner.active, two.scanner.scan_freq, two.platform.position.x), (false, 60.0, 100.0));
    assert_eq!((options.schedule.threads, options.tree.tree), (Some(3), Some(Builder::Sah)));
    assert_eq!(options.schedule.max_memory, Some(Bytes(2 << 30)));
    assert!(options.echoes.legacy_energy.is_on() && !options.echoes.echo_width.is_on());
    assert_eq!(options.echoes.max_order, Some(MaxOrder(9)));
    assert!(options.noise.no_platform_noise.is_on() && !options.noise.no_leg_noise.is_on());
    assert_eq!(options.origin.seed, "2020-01-01 00:00:00".parse().ok());
    let outputs: Vec<_> =
        options.outputs.iter().map(|o| (o.path.to_str().unwrap(), o.content, o.per_leg)).collect();
    let expected = [("points.laz", OutputContent::Points, true), ("-", OutputContent::Trajectory, false)];
    assert_eq!(outputs, expected);
}

const FLIGHT: &str = "scene = 'a.obj'\n[trajectory]\npath = '-'\n[scanner]\ncatalogue = 'data/scanners_als.xml#riegl_vux-1uav'\n[settings]\nscan_freq_hz = 100\n";

#[test]
fn parts_of_a_scene() {
    let rest = "[scanner]\ncatalogue = 'scanners_tls.xml#riegl_vz400'\n[settings]\nscan_freq_hz = 50\n\
                [[leg]]\nposition_m = [0, 0, 0]\nsettings = { max_duration_s = 1 }\n";
    let part = "[[part]]\nfile = 'a.obj'\nid = 'tree'\nup = 'y'\nscale = 2\nrotate_deg = [{ z = 90 }]\n\
                position_m = [1, 2, 3]\non_ground = true\n[[part.material]]\nof = 'leaf'\nreflectance = 0.4\n\
                [[part.material]]\nprimitives = [3, 4]\nclassification = 6\n[[part]]\nfile = 'a.obj'\n";
    let scene = fine(&format!("{part}{rest}")).0.scene;
    let (tree, plain) = (&scene.parts[0], &scene.parts[1]);
    assert!(
        matches!(&tree.loader, Loader::MeshFiles { reading: MeshReading { up: Some(UpAxis::Y), .. }, files } if files[0].ends_with("a.obj"))
    );
    assert_eq!((tree.id.as_deref(), plain.id.as_deref(), plain.number), (Some("tree"), None, 1));
    let Transform { scale, offset, on_ground, .. } = tree.transform;
    assert_eq!(
        (scale, offset, on_ground, plain.transform),
        (2.0, DVec3::new(1., 2., 3.), 1, Transform::IDENTITY)
    );
    assert!((tree.transform.rotation.apply(DVec3::X) - DVec3::Y).length() < 1e-12);
    let [leaf, some] = &tree.changes[..] else { panic!("{:?}", tree.changes) };
    assert_eq!((&leaf.replaced, leaf.material.reflectance), (&Replaced::Named("leaf".to_owned()), Some(0.4)));
    assert_eq!((&some.replaced, some.material.classification), (&Replaced::Faces(vec![3, 4]), 6));
    assert!(leaf.material.has_line() && some.material.has_line());
    let wrong = "[[part]]\nid = 'a'\n[[part]]\nfile = 'a.e57'\n[[part]]\nfile = 'b.obj'\n[[part]]\nfile = 'a.obj'\n\
                 scale = 0\n[[part.material]]\nreflectance = 2\n";
    let report = refused(read(&format!("scene = 'a.obj'\n{rest}{wrong}")));
    contains(&report, &["either `scene` or [[part]] tables"]);
    let report = refused(read(&format!("{rest}{wrong}")));
    contains(
        &report,
        &["needs the key `file`", "ends in .obj", "cannot find the file `b.obj`", "above 0", "from 0 to 1"],
    );
}

#[test]
fn a_stream_of_poses() {
    let (survey, _) = fine(FLIGHT);
    let PlatformKind::Stream(stream) = &survey.platform.kind else { panic!("no stream") };
    assert_eq!((stream.path.as_path(), stream.degrees, stream.rotation), (Path::new("-"), true, None));
    assert_eq!(
        (survey.legs.len(), survey.legs[0].scanner.pulse_freq, survey.legs[0].scanner.scan_freq),
        (1, 50_000, 100.0)
    );
    assert_eq!(survey.name, "p");
    let more = "[platform]\ncatalogue = 'platforms.xml#copter_linearpath'\n";
    let text = FLIGHT.replace(
        "path = '-'",
        "path = 't.csv'\nseparator = ';'\ndegrees = false\nrotation = 'canonical'\ncolumns = ['time', 'x']",
    );
    let (survey, _) = fine(&format!("{text}{more}"));
    let PlatformKind::Stream(stream) = &survey.platform.kind else { panic!("no stream") };
    assert!(stream.path.ends_with("t.csv") && stream.path.is_file() == stream.path.exists());
    assert_eq!(
        (stream.separator, stream.degrees, stream.columns.as_ref().map(Vec::len)),
        (Some(';'), false, Some(2))
    );
    assert_eq!(survey.platform.mount.offset.z, 0.2);
}

#[test]
fn a_survey_with_changes() {
    let text =
        "survey = 'survey.xml'\nseed = 5\n[settings]\npulse_freq_hz = 300000\n[scanner]\naccuracy_m = 0.5\n";
    let (survey, options) = fine(text);
    assert_eq!(
        (survey.legs[0].scanner.pulse_freq, survey.legs[0].scanner.scan_freq, options.origin.seed),
        (300_000, 50.0, Some(Seed(5)))
    );
    assert_eq!((survey.scanner.id.as_str(), survey.scanner.devices[0].detector.accuracy), ("mirror", 0.5));
    let (survey, _) = fine("survey = 'survey.xml'\n[trajectory]\npath = '-'\n");
    assert!(matches!(survey.platform.kind, PlatformKind::Stream(_)));
    assert_eq!(survey.platform.mount.offset.z, 2.0);
}

#[test]
fn all_wrong_keys_come_at_once() {
    let text = "scene = 'a.obj'\nsed = 5\n[settings]\nscan_frq_hz = 5\nscan_angle_deg = 'wide'\n[scanner]\ncatalogue = 'data/scanners_als.xml#riegl_vux-1uav22'\n\
        [trajectory]\npath = '-'\nrotation = 'canonic'\n[[output]]\nfile = 'x'\npath='y'\nformat = 'lax'\n[schedule]\nchunk_size = -1\n";
    contains(
        &refused(read(text)),
        &[
            "unknown key `sed`",
            "did you mean `seed`?",
            "p.toml:2:1",
            "unknown key `scan_frq_hz`",
            "did you mean `scan_freq_hz`?",
            "p.toml:5:18",
            "expected a number",
            "did you mean `canonical`?",
            "unknown key `file`",
            "did you mean `las`?",
            "p.toml:16:14",
        ],
    );
}

#[test]
fn what_is_missing_is_said() {
    contains(
        &refused(read("")),
        &["needs the key `scene`, [[part]] tables or a `survey`", "needs a [scanner] or a `survey`"],
    );
    contains(
        &refused(read("scene = 'a.obj'\n[scanner]\noptics = 'conic'\n")),
        &["needs `catalogue`, or both `optics` and `pulse_freqs_hz`"],
    );
    contains(
        &refused(read("scene = 'a.obj'\n[scanner]\ncatalogue = 'data/scanners_tls.xml#vlp16'\n")),
        &["needs [trajectory]"],
    );
    contains(
        &refused(read("scene = 'b.obj'\nsurvey = 'survey.xml'\n")),
        &["cannot find the file `b.obj`", "p.toml:1:9"],
    );
    let other = "scene = 'a.obj'\n[platform]\nkind = 'linear_path'\n[scanner]\ncatalogue = 'data/scanners_tls.xml#vlp16'\n\
        [[leg]]\nposition_m = [0, 0, 9]\n[[leg]]\nposition_m = [9, 0, 9]\nplatform = 'data/platforms.xml#tripod'\n";
    contains(
        &refused(read(other)),
        &["the platform `tripod` is of type static, that of the survey of type linearpath", "p.toml:10:"],
    );
    let cone =
        "scene = 'a.obj'\n[scanner]\noptics = 'conic'\npulse_freqs_hz = [5]\nscan_angle_along_max_deg = 14\n";
    contains(
        &refused(read(cone)),
        &["an elliptic cone (`scan_angle_along_max_deg`) needs a `scan_angle_max_deg` above 0", "p.toml:5:"],
    );
    contains(&refused(read("scene = ")), &["not well-formed TOML", "p.toml:1:"]);
    contains(
        &refused(read("survey = 'survey.xml'\n[[output]]\n")),
        &["the key `path` is missing", "p.toml:2:1"],
    );
}

#[test]
fn wrong_values_are_marked() {
    let wrong = |more: &str| refused(read(&format!("survey = 'survey.xml'\n{more}")));
    contains(&wrong("[scanner]\nrange_error_m = '1+foo(t)'"), &["unknown name `foo`", "p.toml:3:20"]);
    contains(&wrong("[scanner]\nfibres = 5"), &["`fibres` needs optics = \"line\""]);
    contains(
        &wrong("[scanner]\nscan_freq_min_hz = 200\nscan_freq_max_hz = 100"),
        &[
            "`scan_freq_max_hz` must be at least `scan_freq_min_hz`, 200, or 0 for no limit, found `100`",
            "p.toml:4:20",
        ],
    );
    contains(
        &wrong("[scanner]\nscan_freq_min_hz = 9000"),
        &["`scan_freq_min_hz` must be at most `scan_freq_max_hz`, 120, found `9000`"],
    );
    contains(
        &wrong("[scanner]\nrange_min_m = 20\nrange_max_m = 10"),
        &["`range_max_m` must be at least `range_min_m`, 20, found `10`"],
    );
    contains(
        &wrong("[detector]\nrange_min_m = 20\nrange_max_m = 10"),
        &["`range_max_m` must be at least `range_min_m`, 20, found `10`"],
    );
    contains(
        &wrong("[scanner]\nbeam_divergence_rad = 0"),
        &["`beam_divergence_rad` must be a number above 0"],
    );
    contains(
        &wrong("[platform]\nmount = { rotate_deg = [{ x = 1, y = 2 }] }"),
        &["one finite angle about one axis"],
    );
    contains(
        &wrong("[platform]\nmount = { offset_m = [1, 2] }"),
        &["`offset_m` must be three finite numbers"],
    );
    contains(
        &wrong("[settings]\nvertical_resolution_deg = 0.1"),
        &["the scanner would stand still", "give `horizontal_resolution_deg` as well"],
    );
    contains(
        &wrong("[scanner]\nseed = 5\ncrs = 25832\nthreads = 2"),
        &[
            "`seed` is a key of the file itself: write it above the first table",
            "`crs` is a key of the file itself",
            "`threads` is a key of [schedule]",
        ],
    );
    contains(&wrong("seed = [1]"), &["is not a seed"]);
    contains(&wrong("crs = 'EPSG:99'"), &["EPSG:99"]);
    contains(&wrong("[schedule]\nmax_memory = '5 bananas'"), &["expected a number of bytes"]);
    let limit = read("survey = 'survey.xml'\n[settings]\nscan_freq_hz = 500");
    assert_eq!(limit.unwrap_err().exit_status(), 3);
}

#[test]
fn shipped_pipelines_are_read_without_a_warning() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines");
    let mut count = 0;
    for file in
        shipped.read_dir().unwrap().flatten().filter(|f| f.path().extension().is_some_and(|e| e == "toml"))
    {
        match read_pipeline(&file.path()) {
            Ok((_, warnings)) => assert!(warnings.is_empty(), "{}", warnings.text()),
            Err(e) => panic!("{}\n{}", file.path().display(), report(&e)),
        }
        count += 1;
    }
    assert!(count >= 3);
}

#[test]
fn a_trajectory_with_everything() {
    let keys = "path = 'STDIN'\nformat = 'sbet'\nangles = 'rad'\nrotation = 'yaw'\nutm_zone = '32N'\nheight_offset_m = -48\n\
        lever_arm_m = [1, 2, 3]\nboresight_deg = [0, 0, 180]\nmax_gap_s = 2\nlatency_s = 0.5\ncolumns = ['time=1']";
    let (survey, options) = fine(&FLIGHT.replace("path = '-'", keys));
    let PlatformKind::Stream(stream) = &survey.platform.kind else { panic!("no stream") };
    let expected = PoseStream {
        format: Some(PoseFormat::Sbet),
        rotation: Some(AngleConvention::Yaw),
        degrees: false,
        columns: Some(vec!["time=1".to_owned()]),
        grid: ProjectionGrid::Utm(vlscan_geom::UtmZone::parse("32N").unwrap()),
        height_offset: -48.0,
        lever_arm: DVec3::new(1.0, 2.0, 3.0),
        boresight: [0.0, 0.0, radians(180.0)],
        max_gap: 2.0,
        ..PoseStream::at("-")
    };
    assert_eq!((stream, options.trajectory.latency), (&expected, "0.5".parse().ok()));
    let wrong = "path = '-'\nformat = 'sbt'\nangles = 'gon'\nutm_zone = '32U'\nlever_arm_m = [1, 2, nan]\nmax_gap_s = 0\n\
        latency_s = -1";
    contains(
        &refused(read(&FLIGHT.replace("path = '-'", wrong))),
        &[
            "did you mean `sbet`?",
            "deg, rad",
            "a UTM zone",
            "three finite numbers",
            "above 0",
            "from 0 to 3600",
        ],
    );
}

/// How a table that stands within another one is written with a key.
fn within(table: &str, entry: &str) -> String {
    match table {
        "poses" => format!("[platform]\nmount = {{ {entry} }}"),
        "rotations" => format!("[platform]\nmount = {{ rotate_deg = [{{ {entry} }}] }}"),
        "prisms" => format!("[scanner]\noptics = \"risley\"\nprisms = [{{ {entry} }}]"),
        "max_range" | "snr" => format!("[scanner]\n{table} = {{ {entry} }}"),
        "[[part.material]]" => format!("[[part]]\nfile = \"a.obj\"\n[[part.material]]\n{entry}"),
        _ => format!("{table}\n{entry}"),
    }
}

#[test]
fn messages_about_wrong_types_name_no_types_of_the_program() {
    let words = [
        "struct ",
        "enum ",
        "f64",
        "f32",
        "u8",
        "u16",
        "u32",
        "u64",
        "usize",
        "i32",
        "i64",
        "Keys",
        "variant",
        "tuple",
        "newtype",
        "Option<",
        "Spanned",
        "sequence",
        "deseriali",
        "Rust",
        "::",
    ];
    let values =
        ["0.001", "3", "-1", "1e300", "\"x\"", "true", "[1, \"x\"]", "{ a = 1 }", "[]", "1979-05-27"];
    let folder = Folder::new(&[("a.obj", "")]);
    let (mut wrong, mut reports) = (Vec::new(), 0);
    for table in crate::pipeline_keys() {
        for key in table.keys.iter().map(|key| &key.name) {
            for value in values {
                folder.write("p.toml", &within(&table.name, &format!("{key} = {value}")));
                let Err(error) = read_pipeline(&folder.path("p.toml")) else { continue };
                let Error::Input(problems) = &error else { continue };
                reports += 1;
                for item in problems.items() {
                    let text = format!("{} {}", item.message, item.help.as_deref().unwrap_or_default());
                    if let Some(word) = words.iter().find(|word| text.contains(*word)) {
                        wrong.push(format!("{}.{key} = {value}: {word:?} in {text}", table.name));
                    }
                }
            }
        }
    }
    assert!(reports > 500, "{reports} reports");
    assert!(wrong.is_empty(), "{} of {reports}:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn data_sheet_figures_and_paths_of_windows_have_hints() {
    let folder = Folder::new(&[]);
    let report_of = |text: &str| {
        folder.write("p.toml", text);
        report(&read_pipeline(&folder.path("p.toml")).unwrap_err())
    };
    let snr = report_of("scene = \"a.obj\"\n[scanner]\nsnr = 0.001\n");
    contains(&snr, &["`snr` must be a table such as { range_m = …", "found `0.001`", "p.toml:3:7"]);
    contains(
        &report_of("scene = \"C:\\Users\\me\\a.obj\"\n"),
        &["not well-formed TOML", "single quotes", "C:/Users/me"],
    );
    contains(&report_of("scene = \"C:\\temp\\new.obj\"\n"), &["single quotes"]);
    contains(&report_of("[trajectory]\nheight_offset_m = 47,5\n"), &["a decimal point"]);
}

#[test]
fn unusual_values_of_pipelines_are_warned_of() {
    let folder = Folder::new(&[("a.obj", "")]);
    let warnings_of = |scanner: &str, rest: &str| {
        let text = format!(
            "scene = \"a.obj\"\n[scanner]\noptics = \"rotating\"\npulse_freqs_hz = [1000]\nscan_angle_max_deg = 60\n{scanner}\n\
             [settings]\nscan_freq_hz = 5\nmax_duration_s = 1\n{rest}\n[[leg]]\nposition_m = [0, 0, 9]\n"
        );
        folder.write("p.toml", &text);
        let (_, warnings) =
            read_pipeline(&folder.path("p.toml")).unwrap_or_else(|e| panic!("{}", report(&e)));
        warnings.text()
    };
    for (scanner, settings, text) in [
        ("beam_divergence_rad = 0.5", "", "0.5 mrad are 0.0005 rad"),
        ("accuracy_m = 5", "", "5 mm are 0.005 m"),
        ("wavelength_nm = 1", "", "typical values are 200 to 20000 nm"),
        (
            "",
            "scan_angle_deg = 0.785",
            "`scan_angle_deg` is 0.785 degrees; 0.785 rad would be 44.9772 degrees",
        ),
        ("", "scan_angle_deg = 70", "`scan_angle_deg` of 70 degrees is beyond the scanner's 60"),
        (
            "",
            "head_rate_deg_per_s = 5",
            "`head_rate_deg_per_s` has no effect: the scanner's head does not turn",
        ),
    ] {
        let report = warnings_of(scanner, settings);
        contains(&report, &[text, "p.toml:"]);
    }
    assert_eq!(warnings_of("", ""), "");
    let risley = "scene = \"a.obj\"\n[scanner]\noptics = \"risley\"\npulse_freqs_hz = [1000]\n[[leg]]\nposition_m = [0, 0, 9]\n\
                  settings = { max_duration_s = 1 }\n";
    folder.write("p.toml", risley);
    contains(&read_pipeline(&folder.path("p.toml")).unwrap().1.text(), &["risley optics without `prisms`"]);
}
