//! Several scanners on one platform: the bytes of each are those of its own run.

use crate::common::{files, fixture, folder, run, succeed, text, vlscan};
use std::collections::BTreeMap;
use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A scanner, with its outputs.
struct Scanner {
    name: &'static str,
    keys: &'static str,
    mount: &'static str,
    settings: &'static str,
    outputs: &'static [&'static str],
}

static SCANNERS: [Scanner; 2] = [
    Scanner {
        name: "front",
        keys: "catalogue = \"street/scanners.xml#spinning128\"",
        mount: "{ offset_m = [0, 0, 2.3] }",
        settings: "{ pulse_freq_hz = 400, head_rate_deg_per_s = 3600, head_stop_deg = 1800 }",
        outputs: &["front.laz", "front.csv", "front.mcap"],
    },
    Scanner {
        name: "rear",
        keys: "optics = \"rotating\"\npulse_freqs_hz = [10000]\nscan_angle_max_deg = 180\n\
               scan_angle_effective_max_deg = 180\nscan_freq_max_hz = 100\nwavelength_nm = 1550\n\
               beam_divergence_rad = 0.0005\npulse_length_ns = 4\naccuracy_m = 0.01\nrange_max_m = 200",
        mount: "{ offset_m = [0, -0.4, 2.1], rotate_deg = [{ z = 90 }] }",
        settings: "{ scan_freq_hz = 50, scan_angle_deg = 180 }",
        outputs: &["rear.las", "rear.xyz"],
    },
];

const LEGS: &str = "[[leg]]\nposition_m = [1.5, -20, 0.1]\nspeed_m_per_s = 20\n\
                    [[leg]]\nposition_m = [1.5, -10, 0.1]\nactive = false\n";
const TRAJECTORY: &str = "[trajectory]\npath = \"way.csv\"\n";

/// Keys at the top of a pipeline through the street.
fn top() -> String {
    let scene = fixture("street/scene.xml").display().to_string();
    format!("name = \"drive\"\nscene = '{scene}#street'\nseed = 3\npulses = true\n")
}

fn quoted(names: &[&str]) -> String {
    names.iter().map(|name| format!("{name:?}")).collect::<Vec<_>>().join(", ")
}

/// A pipeline with all scanners; `way` is its legs or trajectory.
fn rig(way: &str) -> String {
    let tables = SCANNERS.iter().map(|scanner| {
        let Scanner { name, keys, mount, settings, outputs } = scanner;
        let own = format!("mount = {mount}\nsettings = {settings}\noutput = [{}]\n", quoted(outputs));
        format!("[[scanner]]\nname = \"{name}\"\n{keys}\n{own}")
    });
    format!("{}{}{}{way}", top(), platform(way, ""), tables.collect::<String>())
}

/// The pipeline of one scanner.
fn single(scanner: &Scanner, way: &str) -> String {
    let Scanner { name, keys, mount, settings, outputs } = scanner;
    let outputs: String = outputs.iter().map(|path| format!("[[output]]\npath = {path:?}\n")).collect();
    let platform = platform(way, &format!("mount = {mount}\n"));
    format!("{}settings = {settings}\n{platform}[scanner]\nname = \"{name}\"\n{keys}\n{way}{outputs}", top())
}

fn platform(way: &str, mount: &str) -> String {
    let kind = if way == LEGS { "kind = \"linear_path\"\n" } else { "" };
    format!("[platform]\n{kind}{mount}")
}

/// A folder with the scanner of the fixture and a trajectory, below which runs have folders.
fn site() -> tempfile::TempDir {
    let dir = folder();
    fs::create_dir(dir.path().join("street")).unwrap();
    fs::copy(fixture("street/scanners.xml"), dir.path().join("street/scanners.xml")).unwrap();
    let pose = |i: u32| {
        let seconds = f64::from(i) * 0.05;
        format!("{:.2},1.5,{:.2},0.1,0,0,0\n", 100.0 + seconds, -20.0 + 20.0 * seconds)
    };
    let poses: String = (0..=10).map(pose).collect();
    fs::write(dir.path().join("way.csv"), format!("time,x,y,z,roll,pitch,yaw\n{poses}")).unwrap();
    dir
}

/// Writes a pipeline into `dir` and runs it from the folder `name` in it, whose files are returned.
fn run_in(dir: &Path, name: &str, pipeline: &str, options: &[&str]) -> BTreeMap<PathBuf, Vec<u8>> {
    let (file, work) = (format!("{name}.toml"), dir.join(name));
    fs::write(dir.join(&file), pipeline).unwrap();
    fs::create_dir_all(&work).unwrap();
    let path = format!("../{file}");
    succeed(&work, &[&["run", path.as_str(), "-q"][..], options].concat());
    contents(&work)
}

fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    files(folder).into_iter().map(|file| (file.clone(), fs::read(folder.join(file)).unwrap())).collect()
}

/// The files of the runs of each scanner alone.
fn of_single_runs(dir: &Path, way: &str) -> BTreeMap<PathBuf, Vec<u8>> {
    let runs = SCANNERS.iter().map(|scanner| run_in(dir, scanner.name, &single(scanner, way), &["-j", "1"]));
    runs.flatten().collect()
}

fn assert_same(found: &BTreeMap<PathBuf, Vec<u8>>, expected: &BTreeMap<PathBuf, Vec<u8>>, what: &str) {
    assert_eq!(found.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>(), "{what}");
    for (name, bytes) in expected {
        assert!(found[name] == *bytes, "{what}: {} differs", name.display());
    }
}

#[test]
fn two_scanners_in_one_run_give_the_bytes_of_two_runs() {
    for (way, name) in [(LEGS, "legs"), (TRAJECTORY, "trajectory")] {
        let dir = site();
        let expected = of_single_runs(dir.path(), way);
        assert_eq!(expected.len(), 7, "{name}: {:?}", expected.keys());
        for file in ["front.csv", "rear.xyz"] {
            assert!(expected[Path::new(file)].len() > 10_000, "{name}: {file} is nearly empty");
        }
        let ways: [&[&str]; 4] = [
            &["-j", "1"],
            &["-j", "2", "--chunk-size", "7"],
            &["-j", "3", "--schedule", "dynamic", "--tree", "fsah"],
            &["-j", "2", "--resume=3k"],
        ];
        for (number, options) in ways.into_iter().enumerate() {
            let found = run_in(dir.path(), &format!("rig{number}"), &rig(way), options);
            assert_same(&found, &expected, &format!("{name}, {options:?}"));
        }
    }
}

#[test]
fn shards_of_several_scanners_are_merged_one_by_one() {
    let dir = site();
    let all = of_single_runs(dir.path(), LEGS);
    let mut expected = all.clone();
    expected.retain(|name, _| name.extension().is_some_and(|e| e != "mcap" && e != "txt"));
    fs::write(dir.path().join("rig.toml"), rig(LEGS)).unwrap();
    succeed(dir.path(), &["index-shards", "rig.toml", "-q", "-o", "shards"]);
    for shard in ["0/3", "1/3", "2/3"] {
        succeed(dir.path(), &["run", "rig.toml", "-q", "-o", "shards", "--shard", shard]);
    }
    let again = run(dir.path(), &["run", "rig.toml", "-q", "-o", "shards", "--shard", "2/3"]);
    assert_eq!(again.status.code(), Some(2), "{}", text(&again.stderr));
    assert!(text(&again.stderr).contains("exists already"), "{}", text(&again.stderr));
    let merged = dir.path().join("merged");
    fs::create_dir(&merged).unwrap();
    for (scanner, outputs) in [("front", ["front.laz", "front.csv"]), ("rear", ["rear.las", "rear.xyz"])] {
        let folder = format!("../shards/{scanner}");
        succeed(&merged, &["merge", &folder, "-q", "-o", outputs[0], "-o", outputs[1]]);
    }
    assert_same(&contents(&merged), &expected, "merged");
    // The pipeline has the outputs of all scanners, and of one.
    let by_pipeline = |name: &str, folder: &str| {
        let work = dir.path().join(name);
        fs::create_dir(&work).unwrap();
        succeed(&work, &["merge", folder, "-q", "--pipeline", "../rig.toml"]);
        contents(&work)
    };
    assert_same(&by_pipeline("both", "../shards"), &all, "both scanners");
    let mut front = all.clone();
    front.retain(|name, _| name.to_string_lossy().starts_with("front"));
    assert_same(&by_pipeline("one", "../shards/front"), &front, "one scanner");
    let refused = run(dir.path(), &["merge", "merged", "--pipeline", "rig.toml"]);
    assert_eq!(refused.status.code(), Some(2));
    let said = text(&refused.stderr);
    assert!(said.contains("has the shards of no scanner of rig.toml"), "{said}");
    // Shards of another scanner than that of the pipeline.
    fs::write(dir.path().join("single.toml"), single(&SCANNERS[0], LEGS)).unwrap();
    let said_of = |name: &str, scanner: &str| {
        let work = dir.path().join(name);
        fs::create_dir(&work).unwrap();
        let folder = format!("../shards/{scanner}");
        text(&run(&work, &["merge", &folder, "--pipeline", "../single.toml"]).stderr)
    };
    let warning = "are of the scanner `rear`, not of `front`";
    let said = said_of("mixed", "rear");
    assert!(said.contains(warning), "{said}");
    let said = said_of("fitting", "front");
    assert!(!said.contains("are of the scanner"), "{said}");
}

#[test]
fn a_dry_run_forecasts_each_scanner() {
    let dir = site();
    fs::write(dir.path().join("rig.toml"), rig(LEGS)).unwrap();
    fs::write(dir.path().join("front.laz"), "mine").unwrap();
    let json = succeed(dir.path(), &["run", "rig.toml", "--dry-run", "--json", "-q"]);
    let found: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    for (number, name) in ["front", "rear"].into_iter().enumerate() {
        let scanner = &found["scanners"][number];
        assert_eq!(scanner["name"], name);
        assert!(scanner["forecast"]["pulses"].as_f64().unwrap() > 1000.0, "{found}");
    }
    let shown = text(&succeed(dir.path(), &["run", "rig.toml", "--dry-run", "-q"]).stdout);
    assert!(
        shown.starts_with("scanner     front\nlegs") && shown.contains("\nscanner     rear\nlegs"),
        "{shown}"
    );
    assert_eq!(fs::read(dir.path().join("front.laz")).unwrap(), b"mine");
    let refused = run(dir.path(), &["run", "rig.toml", "--dry-run", "--objects", "c.csv"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("no moving parts"), "{}", text(&refused.stderr));
    // All scanners are checked before the first forecast.
    let tried = |pipeline: String| {
        fs::write(dir.path().join("rig.toml"), pipeline).unwrap();
        let out = run(dir.path(), &["run", "rig.toml", "--dry-run", "--message-format", "json"]);
        (out.status.code(), text(&out.stderr))
    };
    let (code, said) = tried(rig(LEGS));
    assert!(code == Some(0) && said.contains("trying the survey"), "{said}");
    let (code, said) = tried(rig(LEGS).replace("\"rear.las\"", "\"front.csv\""));
    assert!(code == Some(2) && said.contains("would both write to"), "{said}");
    assert!(!said.contains("trying the survey"), "{said}");
}

#[test]
fn scanners_have_their_coverage_alone_and_together() {
    let dir = site();
    fs::write(dir.path().join("rig.toml"), rig(LEGS)).unwrap();
    let dry = ["--dry-run", "-q", "--coverage-cell", "1"];
    succeed(dir.path(), &[&["run", "rig.toml", "--coverage", "c.tif"][..], &dry].concat());
    let read = |name: &str| fs::read(dir.path().join(name)).unwrap();
    for scanner in &SCANNERS {
        let name = scanner.name;
        fs::write(dir.path().join("one.toml"), single(scanner, LEGS)).unwrap();
        let file = format!("{name}.tif");
        succeed(dir.path(), &[&["run", "one.toml", "--coverage", file.as_str()][..], &dry].concat());
        assert!(read(&format!("c_{name}.tif")) == read(&file), "{name}");
        assert!(read("c.tif") != read(&file), "{name}");
    }
    let before = files(dir.path()).len();
    for (coverage, expected) in [
        (&["--coverage", "c_rear.tif"][..], "c_rear.tif exists"),
        (&["--coverage", "d.tif", "--coverage", "d_rear.tif"], "d_rear.tif is the file of the scanner"),
    ] {
        let refused = run(dir.path(), &[&["run", "rig.toml"][..], coverage, &dry].concat());
        assert_eq!(refused.status.code(), Some(2));
        assert!(text(&refused.stderr).contains(expected), "{}", text(&refused.stderr));
        assert_eq!(files(dir.path()).len(), before);
    }
}

#[test]
fn legs_that_begin_at_different_times_cause_a_warning() {
    let dir = site();
    let way = "position_m = [1.5, -10, 0.1]";
    let bent = format!("position_m = [1.5, -15, 0.1]\nspeed_m_per_s = 20\n[[leg]]\n{way}");
    let pipeline = rig(LEGS).replace(way, &bent).replace("pulse_freq_hz = 400", "pulse_freq_hz = 2000");
    // The way to the second leg takes 0.25 s, in which the head turns by 900 degrees.
    for (stop, is_told) in [("1800", true), ("600", false)] {
        let pipeline = pipeline.replace("head_stop_deg = 1800", &format!("head_stop_deg = {stop}"));
        fs::write(dir.path().join("rig.toml"), pipeline).unwrap();
        let said = text(&succeed(dir.path(), &["run", "rig.toml", "--dry-run"]).stderr);
        let is_found = said.contains("leg 1 begins after 0.5") && said.contains("`rear`, which are at");
        assert_eq!(is_found, is_told, "{stop}: {said}");
    }
}

#[test]
fn outputs_of_all_scanners_are_checked_before_the_first_pulse() {
    let dir = site();
    let before = files(dir.path()).len();
    let refused = |pipeline: &str, args: &[&str]| {
        fs::write(dir.path().join("rig.toml"), pipeline).unwrap();
        let out = run(dir.path(), args);
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
        text(&out.stderr)
    };
    let same = refused(&rig(LEGS).replace("rear.xyz", "front.csv"), &["run", "rig.toml", "-q"]);
    assert!(same.contains("the scanners `front` and `rear` would both write to"), "{same}");
    let pulses = refused(&rig(LEGS).replace("rear.las", "front.las"), &["run", "rig.toml", "-q"]);
    assert!(pulses.contains("would both write to") && pulses.contains("front_pulse.txt"), "{pulses}");
    for command in ["pulses", "trajectory"] {
        let single = refused(&rig(LEGS), &[command, "rig.toml"]);
        assert!(single.contains("takes a single scanner") && single.contains("--scanner NAME"), "{single}");
        let out = succeed(dir.path(), &[command, "rig.toml", "--scanner", "front", "-q"]);
        assert!(text(&out.stdout).lines().count() > 2, "{command}");
    }
    let nowhere = refused(&rig(LEGS).replace("rear.las", "none/rear.las"), &["run", "rig.toml", "-q"]);
    assert!(nowhere.contains("scanner `rear`: none is not a directory"), "{nowhere}");
    // So are flight and instrument, if warnings are errors.
    let low = refused(&rig(LEGS).replace("-0.4, 2.1]", "-0.4, -1.1]"), &["run", "rig.toml", "--strict"]);
    assert!(low.contains("scanner `rear`: the flight is below the terrain"), "{low}");
    let piped = refused(&rig(TRAJECTORY).replace("way.csv", "-"), &["run", "rig.toml", "-q"]);
    assert!(piped.contains("can be read only once"), "{piped}");
    assert_eq!(files(dir.path()).len(), before + 1);
    fs::write(dir.path().join("rear.las"), "mine").unwrap();
    let exists = refused(&rig(LEGS), &["run", "rig.toml", "-q"]);
    assert!(exists.contains("rear.las exists already"), "{exists}");
    assert_eq!(files(dir.path()).len(), before + 2);
}

#[test]
fn a_resumed_run_continues_with_the_scanner_that_was_interrupted() {
    let dir = site();
    let long = rig(LEGS).replace("speed_m_per_s = 20", "speed_m_per_s = 4");
    let options = ["-j", "2", "--resume=1k"];
    let expected = run_in(dir.path(), "whole", &long, &options[..2]);
    let work = dir.path().join("killed");
    fs::create_dir(&work).unwrap();
    let command = [&["run", "../whole.toml"][..], &options].concat();
    // An output of a later scanner is refused before the first pulse.
    fs::write(work.join("rear.xyz"), "mine").unwrap();
    let refused = run(&work, &command);
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused.stderr));
    assert!(text(&refused.stderr).contains("rear.xyz exists already"), "{}", text(&refused.stderr));
    assert_eq!(files(&work), [Path::new("rear.xyz")]);
    fs::remove_file(work.join("rear.xyz")).unwrap();
    let mut child = vlscan(&work).args(&command).stderr(Stdio::null()).spawn().unwrap();
    // The lock, the mark, the borders, and at least one shard beside the one that is being written.
    while fs::read_dir(work.join("rear.las.shards")).map_or(0, Iterator::count) < 5 {
        assert!(child.try_wait().unwrap().is_none(), "the run has ended");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let written = fs::metadata(work.join("front.laz")).unwrap().modified().unwrap();
    let resumed = succeed(&work, &command);
    assert!(text(&resumed.stderr).contains("already complete"), "{}", text(&resumed.stderr));
    assert_eq!(fs::metadata(work.join("front.laz")).unwrap().modified().unwrap(), written);
    assert_same(&contents(&work), &expected, "resumed");
}

#[test]
fn options_of_a_format_apply_to_the_scanners_that_write_it() {
    let dir = site();
    let top = "frame_s = 0.05\n";
    let found = run_in(dir.path(), "rig", &format!("{top}{}", rig(LEGS)), &["-j", "2"]);
    let mut expected = run_in(dir.path(), "front", &format!("{top}{}", single(&SCANNERS[0], LEGS)), &[]);
    expected.extend(run_in(dir.path(), "rear", &single(&SCANNERS[1], LEGS), &[]));
    assert_same(&found, &expected, "frames of the front scanner");
    let without = format!("{top}{}", rig(LEGS).replace(", \"front.mcap\"", ""));
    fs::write(dir.path().join("without.toml"), without).unwrap();
    let refused = run(dir.path(), &["run", "without.toml", "-q"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("--frame-s applies to MCAP"), "{}", text(&refused.stderr));
}

/// The pipeline of all scanners with one MCAP file for both.
fn sharing() -> String {
    rig(LEGS).replace("\"front.mcap\"", "\"drive.mcap\"").replace("\"rear.xyz\"", "\"drive.mcap\"")
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_keeps_what_was_measured_for_a_shared_mcap() {
    let dir = site();
    let slow = sharing().replace("speed_m_per_s = 20", "speed_m_per_s = 0.02");
    fs::write(dir.path().join("slow.toml"), slow).unwrap();
    let work = dir.path().join("work");
    fs::create_dir(&work).unwrap();
    let mut child = vlscan(&work).args(["run", "../slow.toml"]).stderr(Stdio::piped()).spawn().unwrap();
    let started = Instant::now();
    let bytes = || {
        let in_folder = |file: &&PathBuf| file.to_string_lossy().contains("front.mcap.vlscan-");
        let part = files(&work).iter().find(in_folder).map(|part| work.join(part));
        part.and_then(|part| fs::metadata(part).ok()).map_or(0, |about| about.len())
    };
    while bytes() < 1_000_000 {
        assert!(started.elapsed() < Duration::from_secs(60), "the run does not write");
        std::thread::sleep(Duration::from_millis(10));
    }
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{said}");
    assert!(said.contains("what was measured so far is in drive.partial.mcap"), "{said}");
    let found: Vec<String> =
        fs::read_dir(&work).unwrap().map(|e| text(e.unwrap().file_name().as_encoded_bytes())).collect();
    assert!(found.iter().all(|name| name.contains(".partial.") || name.contains("_pulse")), "{found:?}");
    let log = fs::read(work.join("drive.partial.mcap")).unwrap();
    assert!(text(&log).contains("partial"));
    let all = messages(&log);
    assert!(all["/front/points"].len() > 1, "{:?}", all.keys());
    assert!(!all.contains_key("/rear/points"), "{:?}", all.keys());
}

/// Times and bytes of the messages of an MCAP file, by topic.
type Messages = BTreeMap<String, Vec<(u64, Vec<u8>)>>;

/// The messages of a file with one message in each chunk.
fn messages(log: &[u8]) -> Messages {
    let number = |bytes: &[u8]| bytes.iter().rev().fold(0u64, |sum, byte| (sum << 8) | u64::from(*byte));
    let mut topics: BTreeMap<u64, String> = BTreeMap::new();
    let mut found = Messages::new();
    // Between the magic bytes there are records of a kind and a length.
    let mut rest = &log[8..];
    while rest.len() > 8 {
        let (kind, end) = (rest[0], 9 + number(&rest[1..9]) as usize);
        let content = &rest[9..end];
        rest = &rest[end..];
        match kind {
            // A channel: its number, that of its schema, its topic.
            4 => {
                let topic = &content[8..8 + number(&content[4..8]) as usize];
                topics.insert(number(&content[..2]), text(topic));
            }
            // A chunk: the message follows 40 bytes, its channel and time are in its head of 31 bytes.
            6 => {
                let topic = topics[&number(&content[49..51])].clone();
                found.entry(topic).or_default().push((number(&content[55..63]), content[71..].to_vec()));
            }
            _ => {}
        }
    }
    found
}

#[test]
fn scanners_that_name_one_mcap_have_a_topic_each_in_it() {
    let dir = site();
    let found = run_in(dir.path(), "shared", &sharing(), &["-j", "2"]);
    let names: Vec<&str> = found.keys().map(|name| name.to_str().unwrap()).collect();
    let expected = ["drive.mcap", "front.csv", "front.laz", "front_pulse.txt", "rear.las", "rear_pulse.txt"];
    assert_eq!(names, expected);
    assert_eq!(fs::read_dir(dir.path().join("shared")).unwrap().count(), expected.len());
    let all = messages(&found[Path::new("drive.mcap")]);
    assert_eq!(all.len(), 5, "{:?}", all.keys());
    let mut transforms = Vec::new();
    for scanner in &SCANNERS {
        let name = scanner.name;
        let pipeline = format!("sensor_frame = {name:?}\n{}", single(scanner, LEGS));
        let alone = run_in(dir.path(), name, &pipeline, &["-o", "a.mcap"]);
        let mut alone = messages(&alone[Path::new("a.mcap")]);
        for topic in ["points", "odom"] {
            let expected = &alone[&format!("/{topic}")];
            assert!(expected.len() > 2, "{name}: {} messages of {topic}", expected.len());
            assert!(all[&format!("/{name}/{topic}")] == *expected, "{topic} of {name} differ");
        }
        transforms.append(alone.get_mut("/tf").unwrap());
    }
    let mut found = all["/tf"].clone();
    found.sort();
    transforms.sort();
    assert!(found == transforms, "{} transforms, expected {}", found.len(), transforms.len());
    let work = dir.path().join("shared");
    let frames = run(&work, &["frames", "drive.mcap", "--layout", "kitti", "-o", "kitti"]);
    assert_eq!(frames.status.code(), Some(2));
    assert!(text(&frames.stderr).contains("points of several scanners, on /"), "{}", text(&frames.stderr));
    assert!(!work.join("kitti").exists());
    succeed(&work, &["run", "../shared.toml", "--dry-run", "-q"]);
    let again = run(&work, &["run", "../shared.toml", "-q"]);
    assert!(text(&again.stderr).contains("drive.mcap exists already"), "{}", text(&again.stderr));
    let resumed = run(&work, &["run", "../shared.toml", "-q", "--force", "--resume"]);
    assert_eq!(resumed.status.code(), Some(2));
    assert!(text(&resumed.stderr).contains("shares an MCAP file"), "{}", text(&resumed.stderr));
}
