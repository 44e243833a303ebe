//! The machine fails at every operation of a run, one after the other, in every format: status 1, one message, nothing
//! incomplete under a final name, no temporary file or folder left, and an end.
//!
//! `VLSCAN_FAULT=N` fails the N-th operation (creating, writing, reading back, synchronising and renaming files, creating
//! folders, mapping memory, starting threads), `VLSCAN_FAULT=N+` all from the N-th on; builds without debug assertions
//! have no such variable.

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

/// Runs the program with every fault, and without any at the end. Files that exist before are `old`; of several
/// outputs, those that were complete before the fault may stay.
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
        // A machine that goes on failing differs only in what is removed afterwards, so every fourth number does.
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

/// Tests a run of the survey with these options.
fn survey_with(options: &[&str]) {
    let inputs = Inputs::new();
    at_every_operation(&[&["run", &inputs.survey(), "-q", "-j", "2"], options].concat(), &[]);
}

#[test]
#[ignore = "takes long; see docs/reliability.md"]
fn text_formats() {
    ["a.xyz", "a.csv", "a.bin"].iter().for_each(|name| survey_with(&["-o", name]));
}

#[test]
fn las_formats() {
    ["a.las", "a.laz", "a.copc.laz"].iter().for_each(|name| survey_with(&["-o", name]));
}

#[test]
#[ignore = "takes long; see docs/reliability.md"]
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
#[ignore = "takes long; see docs/reliability.md"]
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
    for picture in ["a.png", "a.html"] {
        at_every_operation(&["preview", &points, "-q", "-o", picture], &[]);
    }
    at_every_operation(&["unzip", &zipped, "a.xyz", "-q"], &[]);
    at_every_operation(&["man", "pages", "-q"], &[]);
}

#[test]
#[ignore = "takes long; see docs/reliability.md"]
fn traced_pulses() {
    let inputs = Inputs::new();
    let (survey, pulses) = (inputs.survey(), inputs.path("pulses.csv"));
    let flown = succeed(inputs.folder.path(), &["pulses", &survey, "-q"]).stdout;
    fs::write(&pulses, &flown).unwrap();
    let args = ["trace", "--scanner", &survey, &pulses, "-q", "-o", "a.laz"];
    at_every_operation(&args, &[]);
}
