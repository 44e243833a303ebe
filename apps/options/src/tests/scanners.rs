//! Several scanners on one platform.

use super::*;
use crate::{ResolvedRun, ScannerSurvey, read_scanners};
use vlscan_geom::DVec3;
use vlscan_session::output::{PointFormat, Target};

/// Two scanners: the first with every key of its own, the second with those of the platform.
const TWO: &str = r#"
scene = "a.obj"

[platform]
kind = "linear_path"
mount = { offset_m = [0, 0, 1] }

[[scanner]]
name = "front"
optics = "rotating"
pulse_freqs_hz = [1000]
scan_angle_max_deg = 60
scan_freq_max_hz = 100
wavelength_nm = 905
mount = { offset_m = [0, 2, 1] }
output = "front.xyz"
settings = { scan_freq_hz = 60 }

[[scanner]]
name = "rear"
optics = "rotating"
pulse_freqs_hz = [2000]
scan_angle_max_deg = 60
scan_freq_max_hz = 100
wavelength_nm = 1550

[[scanner.output]]
path = "rear.las"

[[scanner.output]]
path = "legs"
format = "laz"
per_leg = true

[settings]
scan_freq_hz = 50
scan_angle_deg = 20

[[leg]]
position_m = [0, 0, 100]
speed_m_per_s = 30

[[leg]]
position_m = [100, 0, 100]
active = false
"#;

fn read_with(text: &str, words: &[&str]) -> Result<(Vec<ScannerSurvey>, Diagnostics)> {
    let folder = Folder::new(&[("p.toml", text), ("a.obj", "")]);
    let typed = Options::parse(words.iter().map(|word| (*word).to_owned())).unwrap();
    read_scanners(&folder.path("p.toml"), typed)
}

fn read(text: &str) -> Result<(Vec<ScannerSurvey>, Diagnostics)> {
    read_with(text, &[])
}

/// The pipeline with `new` in the place of `old`.
fn changed(old: &str, new: &str) -> String {
    assert_eq!(TWO.matches(old).count(), 1, "{old}");
    TWO.replacen(old, new, 1)
}

#[test]
fn each_scanner_has_its_mount_its_settings_and_its_outputs() {
    let (all, _) = read(TWO).unwrap_or_else(|e| panic!("{}", report(&e)));
    let [front, rear] = &all[..] else { panic!("{} scanners", all.len()) };
    let facts = |read: &ScannerSurvey| {
        let ScannerSurvey { scanner, survey, .. } = read;
        let leg = &survey.legs[0].scanner;
        (scanner.clone(), survey.scanner.name.clone(), leg.pulse_freq, leg.scan_freq)
    };
    assert_eq!(facts(front), (Some("front".to_owned()), "front".to_owned(), 1000, 60.0));
    assert_eq!(facts(rear), (Some("rear".to_owned()), "rear".to_owned(), 2000, 50.0));
    assert_eq!(front.survey.platform.mount.offset, DVec3::new(0.0, 2.0, 1.0));
    assert_eq!(rear.survey.platform.mount.offset, DVec3::Z);
    let sinks =
        |read: &ScannerSurvey| ResolvedRun::new(read.survey.clone(), &read.options).unwrap().output.sinks;
    assert_eq!(sinks(front), [(Target::File("front.xyz".into()), PointFormat::Xyz)]);
    let expected = [
        (Target::File("rear.las".into()), PointFormat::Las),
        (Target::Directory("legs".into()), PointFormat::Laz),
    ];
    assert_eq!(sinks(rear), expected);
}

#[test]
fn scanners_have_names_outputs_and_tables_that_can_be_used() {
    for (old, new, expected) in [
        ("name = \"rear\"\n", "", "a [[scanner]] needs the key `name`"),
        ("\"rear\"", "\"front\"", "two [[scanner]] tables have the name `front`"),
        ("\"rear\"", "\"Front\"", "two [[scanner]] tables have the name `Front`"),
        ("\"rear\"", "\"a/b\"", "invalid name of a scanner `a/b`"),
        ("\"rear\"", "\"..\"", "invalid name of a scanner `..`"),
        ("output = \"front.xyz\"\n", "", "a [[scanner]] needs the key `output`"),
        ("\"front.xyz\"", "[]", "`output` must be a path, a list of paths or [[scanner.output]] tables"),
        ("\"front.xyz\"", "7", "`output` must be a path, a list of paths or [[scanner.output]] tables"),
        ("path = \"rear.las\"", "file = \"rear.las\"", "unknown key `file`"),
        ("{ offset_m = [0, 2, 1] }", "\"roof\"", "`mount` must be"),
        ("{ offset_m = [0, 2, 1] }", "{ offset_m = [0, 2] }", "`offset_m` must be three finite numbers"),
        ("output = \"front.xyz\"\n", "outut = \"front.xyz\"\n", "did you mean `output`?"),
        ("mount = { offset_m = [0, 2, 1] }", "mont = { offset_m = [0, 2, 1] }", "did you mean `mount`?"),
        ("settings = { scan_freq_hz = 60 }", "setings = { scan_freq_hz = 60 }", "did you mean `settings`?"),
        ("{ scan_freq_hz = 60 }", "60", "`settings` must be a table, found `60`"),
        ("{ scan_freq_hz = 60 }", "{ scan_frq_hz = 60 }", "unknown key `scan_frq_hz`"),
        ("[settings]", "[[output]]\npath = \"all.xyz\"\n[settings]", "[[output]] tables have no scanner"),
        (
            "speed_m_per_s = 30",
            "speed_m_per_s = 30\nmount = { offset_m = [0, 0, 3] }",
            "the mount of a leg would replace that of every [[scanner]]",
        ),
    ] {
        contains(&refused(read(&changed(old, new))), &[expected]);
    }
}

#[test]
fn problems_of_all_scanners_come_at_once_and_those_of_the_file_only_once() {
    let text = TWO.replacen("\"rotating\"", "\"polygon\"", 1).replacen("\"rotating\"", "\"fibres\"", 1);
    let text = text.replace("scene =", "sed = 1\nscene =");
    let report = refused(read(&text));
    assert_eq!(report.matches("unknown key `sed`").count(), 1, "{report}");
    assert!(report.contains("p.toml:11:") && report.contains("p.toml:22:"), "{report}");
}

#[test]
fn what_only_one_scanner_can_have_is_refused_for_several() {
    for words in
        [&["-o", "a.las"][..], &["--output", "a"], &["--trajectory-out", "a.csv"], &["--parts", "a.csv"]]
    {
        let expected = format!("{} names a single output", words[0]);
        contains(&refused(read_with(TWO, words)), &[&expected]);
    }
    let legs = TWO.find("[[leg]]").unwrap();
    let stream =
        format!("{}[trajectory]\npath = \"-\"\n", &TWO[..legs]).replace("kind = \"linear_path\"\n", "");
    contains(&refused(read(&stream)), &["can be read only once, but each [[scanner]] reads them"]);
    let folder = Folder::new(&[("p.toml", TWO), ("a.obj", "")]);
    let single = ResolvedRun::resolve(&folder.path("p.toml"), &Options::default());
    contains(
        &refused(single),
        &["the file has 2 [[scanner]] tables, but this command takes a single scanner", "--scanner NAME"],
    );
}

#[test]
fn a_scanner_is_chosen_by_its_name() {
    let keys = ["name = \"front\"\n", "mount = { offset_m = [0, 2, 1] }\noutput = \"front.xyz\"\n"];
    let end = TWO.find("[[scanner]]\nname = \"rear\"").unwrap();
    let one = TWO[..end].replace("[[scanner]]", "[scanner]").replace(keys[0], "").replace(keys[1], "");
    let one = one.replace("settings = { scan_freq_hz = 60 }\n", "");
    let one = format!("{one}{}", &TWO[TWO.find("[settings]").unwrap()..]);
    let folder = Folder::new(&[("p.toml", TWO), ("one.toml", &one), ("a.obj", "")]);
    let chosen =
        |file: &str, name: &str| ResolvedRun::resolve_scanner(&folder.path(file), name, &Options::default());
    let (rear, _) = chosen("p.toml", "rear").unwrap_or_else(|e| panic!("{}", report(&e)));
    assert_eq!(rear.scanner.as_deref(), Some("rear"));
    assert_eq!(rear.settings.survey.legs[0].scanner.pulse_freq, 2000);
    contains(&refused(chosen("p.toml", "raer")), &["has no scanner of this name", "did you mean `rear`?"]);
    contains(&refused(chosen("p.toml", "top")), &["its scanners are front, rear"]);
    contains(&refused(chosen("one.toml", "front")), &["has no [[scanner]] tables", "leave out --scanner"]);
}

#[test]
fn a_single_table_in_a_list_is_a_scanner_like_any_other() {
    let start = TWO.find("[[scanner]]\nname = \"rear\"").unwrap();
    let end = TWO.find("[settings]").unwrap();
    let one = format!("{}{}", &TWO[..start], &TWO[end..]);
    let folder = Folder::new(&[("p.toml", &one), ("a.obj", "")]);
    let resolve = |words: &[&str]| {
        let typed = Options::parse(words.iter().map(|word| (*word).to_owned())).unwrap();
        ResolvedRun::resolve(&folder.path("p.toml"), &typed).unwrap().0.output.sinks
    };
    assert_eq!(resolve(&[]), [(Target::File("front.xyz".into()), PointFormat::Xyz)]);
    assert_eq!(resolve(&["-o", "a.las"]), [(Target::File("a.las".into()), PointFormat::Las)]);
}

#[test]
fn scanners_of_a_platform_share_the_start_of_their_clock() {
    let text = changed("scene =", "gps_start = \"now\"\nscene =");
    let folder = Folder::new(&[("p.toml", &text), ("a.obj", "")]);
    let (runs, _) = ResolvedRun::resolve_all(&folder.path("p.toml"), &Options::default()).unwrap();
    let facts = runs.iter().map(|run| (run.scanner.as_deref(), run.settings.flight.gps_start_ns));
    let facts: Vec<_> = facts.collect();
    assert_eq!(facts, [(Some("front"), facts[0].1), (Some("rear"), facts[0].1)]);
}
