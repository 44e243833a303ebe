//! The machine fails at every operation of a run, one after the other, in every format: status 1, one
//! message, nothing incomplete under a final name, no temporary file or folder left, and an end.
//!
//! `VLSCAN_FAULT=N` fails the N-th operation (creating, writing, reading back, synchronising and renaming
//! files, creating folders, mapping memory, starting threads), `VLSCAN_FAULT=N+` all from the N-th on,
//! `VLSCAN_FAULT=N!` kills the process before the N-th; builds without debug assertions have no such
//! variable.

use crate::common::{files, folder, succeed, text, vlscan};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

/// Longer takes no run of these.
const LIMIT: Duration = Duration::from_secs(60);
/// More operations has no run of these.
const MAX_OPERATIONS: usize = 2000;

/// Small inputs of every kind, in a folder of their own.
struct Inputs {
    folder: tempfile::TempDir,
}

impl Inputs {
    fn new() -> Inputs {
        let folder = folder();
        succeed(
            folder.path(),
            &["scene", "make", "room", "-n", "1000", "--pulses", "600", "-o", "room", "-q"],
        );
        Inputs { folder }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn survey(&self) -> String {
        self.path("room/survey.xml")
    }
}

/// Runs the program with a fault; a run that does not end fails the test.
fn faulty(dir: &Path, args: &[&str], fault: &str) -> Output {
    let mut child = vlscan(dir)
        .args(args)
        .env("VLSCAN_FAULT", fault)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let started = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if started.elapsed() > LIMIT {
            child.kill().unwrap();
            panic!("vlscan {} does not end with fault {fault}", args.join(" "));
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    child.wait_with_output().unwrap()
}

/// Files by name, without their folders, which have the time in their names.
fn contents(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let read = |path: PathBuf| (path.file_name().unwrap().into(), fs::read(dir.join(path)).unwrap());
    files(dir).into_iter().map(read).collect()
}

/// Runs the program with every fault, and without any at the end. Files that exist before are `old`; of
/// several outputs, those that were complete before the fault may stay.
fn at_every_operation(args: &[&str], old: &[(&str, &[u8])]) {
    if !cfg!(debug_assertions) {
        return;
    }
    let prepared = || {
        let dir = folder();
        old.iter().for_each(|(name, bytes)| fs::write(dir.path().join(name), bytes).unwrap());
        dir
    };
    let reference = prepared();
    succeed(reference.path(), args);
    let complete = contents(reference.path());
    for number in 1..MAX_OPERATIONS {
        // A machine that goes on failing differs only in what is removed afterwards, so every fourth number
        // does.
        let lasting = (number % 4 == 1).then(|| format!("{number}+"));
        for fault in std::iter::once(number.to_string()).chain(lasting) {
            let dir = prepared();
            let out = faulty(dir.path(), args, &fault);
            let (said, what) = (text(&out.stderr), format!("vlscan {} with fault {fault}", args.join(" ")));
            if out.status.success() {
                assert!(number > 3, "{what}: too few operations fail");
                assert_eq!(contents(dir.path()).len(), complete.len(), "{what}");
                return;
            }
            assert_eq!(out.status.code(), Some(1), "{what}: {said}");
            let message = format!("injected failure of operation {number}");
            let errors = said.lines().filter(|line| line.starts_with("error")).count();
            assert!(errors == 1 && said.contains(&message) && said.lines().count() < 20, "{what}: {said}");
            assert!(!said.contains("panicked"), "{what}: {said}");
            // A file that is complete stays, though its name may be uncertain or it cannot be opened again.
            let is_named =
                ["synchronise the folder", "cannot read a.vlscene"].iter().any(|s| said.contains(s));
            for (name, bytes) in contents(dir.path()) {
                let is_old = old.iter().any(|(old, content)| Path::new(old) == name && *content == bytes);
                let is_complete = complete.get(&name).is_some_and(|complete| *complete == bytes);
                // Its times are not those of the reference.
                let is_log = name.extension().is_some_and(|e| e == "json") && is_named;
                let may_be_complete = complete.len() > old.len().max(1) || is_named;
                assert!(
                    is_old || is_log || is_complete && may_be_complete,
                    "{what} leaves {}: {said}",
                    name.display()
                );
            }
            let entries = fs::read_dir(dir.path()).unwrap().count();
            assert!(entries == 0 || !files(dir.path()).is_empty(), "{what} leaves a folder");
        }
    }
    panic!("more than {MAX_OPERATIONS} operations");
}

/// Runs a command whose files are one output with every fault, and kills it before every operation: all of
/// its files are there or none, and the same command succeeds afterwards. `inputs` are in the folder
/// beforehand.
fn all_or_nothing(args: &[&str], inputs: &[&str]) {
    if !cfg!(debug_assertions) {
        return;
    }
    let prepared = || {
        let dir = folder();
        for path in inputs.iter().map(Path::new) {
            fs::copy(path, dir.path().join(path.file_name().unwrap())).unwrap();
        }
        dir
    };
    let all = |dir: &Path| -> BTreeMap<PathBuf, Vec<u8>> {
        files(dir).into_iter().map(|path| (path.clone(), fs::read(dir.join(path)).unwrap())).collect()
    };
    let entries = |dir: &Path| fs::read_dir(dir).unwrap().count();
    let reference = prepared();
    let (before, entries_before) = (all(reference.path()), entries(reference.path()));
    succeed(reference.path(), args);
    let complete = all(reference.path());
    assert!(complete.len() > before.len() + 1, "{args:?} writes one file");
    for number in 1..MAX_OPERATIONS {
        for fault in [number.to_string(), format!("{number}+"), format!("{number}!")] {
            let dir = prepared();
            let out = faulty(dir.path(), args, &fault);
            let what = format!("vlscan {} with fault {fault}: {}", args.join(" "), text(&out.stderr));
            if out.status.success() {
                assert!(number > 3 && all(dir.path()) == complete, "{what}");
                return;
            }
            let found = all(dir.path());
            if fault.ends_with('!') {
                assert_eq!(out.status.code(), None, "{what}");
            } else {
                assert_eq!(out.status.code(), Some(1), "{what}");
                let is_named = text(&out.stderr).contains("synchronise the folder") && found == complete;
                assert!(found == before || is_named, "{what} leaves {:?}", found.keys());
            }
            // Where nothing is left, the command starts as the reference did.
            let is_as_before = found == before && entries(dir.path()) == entries_before;
            if found != complete && !is_as_before {
                succeed(dir.path(), args);
                let left = all(dir.path());
                assert!(left == complete, "{what} then {:?}", left.keys());
            }
        }
    }
    panic!("more than {MAX_OPERATIONS} operations");
}

#[test]
fn outputs_of_several_files_are_complete_or_absent() {
    let inputs = Inputs::new();
    let (survey, points, frames) = (inputs.survey(), inputs.path("a.laz"), inputs.path("a.mcap"));
    succeed(inputs.folder.path(), &["run", &survey, "-q", "-o", &points, "-o", &frames]);
    let run = ["run", &survey, "-q", "-j", "1", "-o"];
    all_or_nothing(&[&run[..], &["a.las", "--wave-packets", "beside"]].concat(), &[]);
    all_or_nothing(&[&run[..], &["tiles", "--format", "las", "--tile", "5"]].concat(), &[]);
    all_or_nothing(&["raster", "a.laz", "--dsm", "s.tif", "--density", "d.tif", "-q"], &[&points]);
    all_or_nothing(&["scene", "map", &survey, "-o", "map.png", "--side", "64", "-q"], &[]);
    for layout in ["kitti", "nuscenes"] {
        all_or_nothing(&["frames", "a.mcap", "-o", "out", "--layout", layout, "-q"], &[&frames]);
    }
}

#[test]
#[ignore = "takes long; see docs/dev/reliability.md"]
fn other_outputs_of_several_files_are_complete_or_absent() {
    let inputs = Inputs::new();
    let (survey, points) = (inputs.survey(), inputs.path("a.laz"));
    succeed(inputs.folder.path(), &["run", &survey, "-q", "-o", &points]);
    all_or_nothing(&["scene", "make", "forest", "-q", "-n", "1000", "-o", "made"], &[]);
    all_or_nothing(&["scene", "reconstruct", "a.laz", "-q", "-o", "scene"], &[&points]);
    let changed = ["--page", "a.html", "--change", "c.tif", "--changed", "c.laz", "-q"];
    all_or_nothing(&[&["compare", "a.laz", "a.laz"][..], &changed].concat(), &[&points]);
    all_or_nothing(&["run", &survey, "-q", "-j", "1", "-o", "a.laz", "-o", "a.xyz", "--pulses"], &[]);
    all_or_nothing(&["fit", "line.laz", "-o", "line.toml", "-q"], &[&recorded(&inputs)]);
}

/// A flight line that `vlscan fit` explains.
fn recorded(inputs: &Inputs) -> String {
    let folder = inputs.folder.path();
    succeed(folder, &["scene", "make", "terrain", "-n", "2k", "--pulses", "1k", "-o", "hills", "-q"]);
    let area = "POLYGON ((-30 -20, 30 -20, 30 20, -30 20))";
    let plan = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--height", "60", "--density", "20"];
    let site = ["--area", area, "--scene", "hills/scene.xml", "-o", "plan.toml", "-q"];
    succeed(folder, &[&plan[..], &site].concat());
    succeed(folder, &["run", "plan.toml", "-q", "-o", "line.laz"]);
    inputs.path("line.laz")
}

/// Tests a run of the survey with these options.
fn survey_with(options: &[&str]) {
    let inputs = Inputs::new();
    at_every_operation(&[&["run", &inputs.survey(), "-q", "-j", "2"], options].concat(), &[]);
}

#[test]
#[ignore = "takes long; see docs/dev/reliability.md"]
fn text_formats() {
    ["a.xyz", "a.csv", "a.bin"].iter().for_each(|name| survey_with(&["-o", name]));
}

#[test]
fn las_formats() {
    ["a.las", "a.laz", "a.copc.laz"].iter().for_each(|name| survey_with(&["-o", name]));
}

#[test]
#[ignore = "takes long; see docs/dev/reliability.md"]
fn other_formats() {
    ["a.ply", "a.arrow", "a.parquet"].iter().for_each(|name| survey_with(&["-o", name]));
}

#[test]
fn one_file_per_leg_and_the_layout_of_helios() {
    survey_with(&["-o", "legs", "--format", "laz"]);
    survey_with(&["--output", "out", "--format", "xyz"]);
}

#[test]
fn products_beside_the_points() {
    survey_with(&["-o", "a.xyz", "--waveforms", "--pulses", "--trajectory-out", "t.csv"]);
    survey_with(&["-o", "a.las", "--wave-packets", "beside"]);
    survey_with(&["-o", "a.las", "--wave-packets", "inside"]);
    survey_with(&["-o", "a.xyz", "--schedule-log", "log.json"]);
}

#[test]
#[ignore = "takes long; see docs/dev/reliability.md"]
fn a_spooled_stream() {
    survey_with(&["-o", "-", "--format", "las"]);
    survey_with(&["-o", "-", "--format", "copc"]);
}

#[test]
fn an_old_file_is_kept_or_replaced_by_a_complete_one() {
    let inputs = Inputs::new();
    for name in ["a.laz", "a.xyz"] {
        let args = ["run", &inputs.survey(), "-q", "-o", name, "--force"];
        at_every_operation(&args, &[(name, b"old")]);
    }
}

#[test]
fn parts_and_merges() {
    let inputs = Inputs::new();
    let (survey, shards) = (inputs.survey(), inputs.path("shards"));
    at_every_operation(&["run", &survey, "-q", "-j", "1", "--shard", "0/1", "-o", "shards"], &[]);
    succeed(inputs.folder.path(), &["run", &survey, "-q", "--shard", "0/1", "-o", &shards]);
    at_every_operation(&["merge", &shards, "-q", "-o", "a.laz"], &[]);
    at_every_operation(&["merge", &shards, "-q", "-o", "a.laz", "--segment", "0/1"], &[]);
    let out = inputs.path("b.laz");
    succeed(inputs.folder.path(), &["merge", &shards, "-q", "-o", &out, "--segment", "0/1"]);
    at_every_operation(&["merge", &shards, "-q", "-o", &out, "--join", "--force"], &[]);
}

#[test]
fn scenes() {
    let inputs = Inputs::new();
    at_every_operation(&["scene", "pack", &inputs.survey(), "-q", "-o", "a.vlscene"], &[]);
    at_every_operation(&["scene", "make", "room", "-q", "-n", "1000", "-o", "made"], &[]);
}

#[test]
fn a_packed_scene_that_is_read() {
    let inputs = Inputs::new();
    let (survey, packed) = (inputs.survey(), inputs.path("a.vlscene"));
    succeed(inputs.folder.path(), &["scene", "pack", &survey, "-q", "-o", &packed]);
    at_every_operation(&["run", &survey, "--scene", &packed, "-q", "-o", "a.ply"], &[]);
}

#[test]
fn previews_texts_and_manual_pages() {
    let inputs = Inputs::new();
    let (survey, points, zipped) = (inputs.survey(), inputs.path("a.las"), inputs.path("a.bin"));
    succeed(inputs.folder.path(), &["run", &survey, "-q", "-o", &points, "-o", &zipped]);
    let small = ["-o", "a.png", "--width", "320", "--height", "240"];
    at_every_operation(&[&["preview", &points, "-q"], &small[..]].concat(), &[]);
    at_every_operation(&["preview", &points, "-q", "-o", "a.html"], &[]);
    at_every_operation(&["unzip", &zipped, "a.xyz", "-q"], &[]);
    at_every_operation(&["man", "pages", "-q"], &[]);
}

#[test]
#[ignore = "takes long; see docs/dev/reliability.md"]
fn traced_pulses() {
    let inputs = Inputs::new();
    let (survey, pulses) = (inputs.survey(), inputs.path("pulses.csv"));
    let flown = succeed(inputs.folder.path(), &["pulses", &survey, "-q"]).stdout;
    fs::write(&pulses, &flown).unwrap();
    let args = ["trace", "--scanner", &survey, &pulses, "-q", "-o", "a.laz"];
    at_every_operation(&args, &[]);
}
