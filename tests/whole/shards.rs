//! Shards of a run, merged, give the bytes of the run; runs that were killed go on where they were.

use crate::common::{files, fixture, folder, missing, run, succeed, text, vlscan};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// Outputs in every format, as options of `run` and of `merge`.
const EVERY_FORMAT: &[&str] = &[
    "-o",
    "all.xyz",
    "-o",
    "all.las",
    "-o",
    "all.laz",
    "-o",
    "all.copc.laz",
    "-o",
    "all.bin",
    "-o",
    "all.ply",
    "-o",
    "all.csv",
    "-o",
    "all.arrow",
    "-o",
    "all.parquet",
    "-o",
    "legs",
    "--trajectory-out",
    "way.csv",
];

/// All files below a folder. Run directories are named after the time: `2026-11-22_23-05-01` becomes `TIME0`,
/// the next one `TIME1`.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let is_time = |name: &str| name.len() >= 19 && name.as_bytes()[10] == b'_' && name.starts_with("20");
    let mut times: Vec<String> = Vec::new();
    let mut plain = |path: &Path| -> PathBuf {
        let name = |part: &std::ffi::OsStr| {
            let name = part.to_str().unwrap().to_owned();
            if !is_time(&name) {
                return name;
            }
            let number = times.iter().position(|time| *time == name).unwrap_or_else(|| {
                times.push(name.clone());
                times.len() - 1
            });
            format!("TIME{number}")
        };
        path.iter().map(name).collect()
    };
    files(folder).iter().map(|f| (plain(f), fs::read(folder.join(f)).unwrap())).collect()
}

fn arguments<'a>(lists: &[&[&'a str]]) -> Vec<&'a str> {
    lists.concat()
}

/// The outputs of one run.
fn of_run(survey: &str, options: &[&str], outputs: &[&str]) -> BTreeMap<PathBuf, Vec<u8>> {
    let dir = folder();
    succeed(dir.path(), &arguments(&[&["run", survey, "-q"], options, outputs]));
    contents(dir.path())
}

/// Computes shards of a run into the folder `shards` of `dir`; each with options of its own, which must not
/// show.
fn compute(dir: &Path, survey: &str, options: &[&str], numbers: impl IntoIterator<Item = u32>, of: u32) {
    let ways: [&[&str]; 4] = [
        &["-j", "1"],
        &["-j", "2", "--chunk-size", "7"],
        &["-j", "3", "--schedule", "dynamic", "--tree", "fsah"],
        &["-j", "2", "--chunk-size", "5000", "--tree-jobs", "1"],
    ];
    for number in numbers {
        let shard = format!("{number}/{of}");
        let way = ways[number as usize % ways.len()];
        succeed(dir, &arguments(&[&["run", survey, "-q", "-o", "shards", "--shard", &shard], options, way]));
    }
}

fn merged(dir: &Path, outputs: &[&str]) -> BTreeMap<PathBuf, Vec<u8>> {
    let out = dir.join("out");
    fs::create_dir(&out).unwrap();
    succeed(&out, &arguments(&[&["merge", "../shards", "-q"], outputs]));
    let found = contents(&out);
    fs::remove_dir_all(&out).unwrap();
    found
}

#[track_caller]
fn assert_same(found: &BTreeMap<PathBuf, Vec<u8>>, expected: &BTreeMap<PathBuf, Vec<u8>>, what: &str) {
    let names = |of: &BTreeMap<PathBuf, Vec<u8>>| of.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(found), names(expected), "{what}");
    for (name, bytes) in expected {
        assert!(found[name] == *bytes, "{what}: {} differs", name.display());
    }
}

fn survey(name: &str) -> String {
    fixture(name).to_str().unwrap().to_owned()
}

#[test]
fn shards_of_any_number_give_the_bytes_of_one_run() {
    let recorded = ["--seed", "11", "--waveforms", "--waveform-noise", "--pulses"];
    let counts: [(&str, &[u32]); 4] = [
        ("forest/survey.xml", &[1, 2, 7]),
        ("room/survey.xml", &[2]),
        ("moving/survey.xml", &[7]),
        ("street/survey.xml", &[3]),
    ];
    for (name, counts) in counts {
        let survey = survey(name);
        let outputs = arguments(&[EVERY_FORMAT, &["--waveforms", "--pulses"]]);
        let expected = of_run(&survey, &recorded, EVERY_FORMAT);
        assert!(
            expected.len() > 12 && expected.values().all(|bytes| !bytes.is_empty()),
            "{:?}",
            expected.keys()
        );
        for &of in counts {
            let dir = folder();
            compute(dir.path(), &survey, &recorded, (0..of).rev(), of);
            assert_same(&merged(dir.path(), &outputs), &expected, &format!("{name} in {of} shards"));
        }
    }
}

/// Shards rarely begin between firings of all beams.
#[test]
fn firings_of_many_beams_are_in_one_shard_each() {
    let survey = survey("street/spinning.xml");
    let options = ["--seed", "5", "--pulses"];
    let outputs = ["-o", "all.xyz", "--pulses"];
    let expected = of_run(&survey, &options, &["-o", "all.xyz"]);
    for of in [3, 4, 5, 7, 11, 64] {
        let dir = folder();
        compute(dir.path(), &survey, &options, 0..of, of);
        assert_same(&merged(dir.path(), &outputs), &expected, &format!("{of} shards"));
    }
}

#[test]
fn sixty_four_shards_give_the_bytes_of_one_run() {
    let survey = survey("forest/survey.xml");
    let options = ["--seed", "3", "--physics", "refined", "--misses"];
    let outputs = arguments(&[EVERY_FORMAT, &["--misses", "--labels"]]);
    let expected = of_run(&survey, &options, &arguments(&[EVERY_FORMAT, &["--labels"]]));
    let dir = folder();
    compute(dir.path(), &survey, &options, 0..64, 64);
    assert_same(&merged(dir.path(), &outputs), &expected, "64 shards");
}

#[test]
#[ignore = "a thousand processes"]
fn a_thousand_shards_give_the_bytes_of_one_run() {
    for name in ["forest/survey.xml", "moving/survey.xml"] {
        let (survey, options) = (survey(name), ["--seed", "3", "--pulses"]);
        let expected = of_run(&survey, &options, EVERY_FORMAT);
        let dir = folder();
        compute(dir.path(), &survey, &options, 0..1000, 1000);
        assert_same(&merged(dir.path(), &arguments(&[EVERY_FORMAT, &["--pulses"]])), &expected, name);
    }
}

#[test]
fn more_shards_than_pulses_are_mostly_empty() {
    let dir = folder();
    let survey = little(dir.path(), 12);
    let outputs = ["-o", "a.xyz", "-o", "a.laz"];
    let expected = of_run(&survey, &[], &outputs);
    compute(dir.path(), &survey, &[], 0..20, 20);
    assert_same(&merged(dir.path(), &outputs), &expected, "20 shards");
}

/// A scene with a survey of about this many pulses, and its path.
fn little(dir: &Path, pulses: u32) -> String {
    let pulses = pulses.to_string();
    succeed(dir, &["scene", "make", "terrain", "-n", "500", "--pulses", &pulses, "-o", "little", "-q"]);
    dir.join("little/survey.xml").to_str().unwrap().to_owned()
}

#[test]
#[ignore = "minutes; part of `.ci/run --long`"]
fn layouts_channels_packets_and_columns_come_from_shards() {
    let survey = survey("moving/survey.xml");
    let spinning = self::survey("street/spinning.xml");
    let columns = "X,Y,Z,GpsTime,SurfaceX,NormalZ,FootprintFraction";
    for (survey, recorded, outputs) in [
        (&survey, &["--waveforms"][..], &["--output", "out", "--zip-output"][..]),
        (&survey, &[], &["--output", "out", "--las-output"]),
        (&spinning, &["--wave-packets", "inside"], &["-o", "a.laz", "--split-by-channel"]),
        (&spinning, &["--wave-packets", "beside"], &["-o", "a.las", "-o", "b.laz", "--las-scale", "0.001"]),
        (&spinning, &["--columns", columns], &["-o", "a.parquet", "-o", "a.xyz"]),
        (&spinning, &["--navigation-error", "position_m=0.1"], &["-o", "a.las", "--true-positions"]),
    ] {
        let expected = of_run(survey, recorded, outputs);
        let dir = folder();
        compute(dir.path(), survey, recorded, 0..5, 5);
        // What is recorded is an output, too, but for the flight's own errors.
        let of_merge: &[&str] = if recorded.first() == Some(&"--navigation-error") { &[] } else { recorded };
        let found = merged(dir.path(), &arguments(&[outputs, of_merge]));
        assert_same(&found, &expected, &format!("{recorded:?} {outputs:?}"));
    }
}

#[test]
fn subrays_come_from_shards() {
    let survey = survey("room/survey.xml");
    let (recorded, outputs) = (["--subrays"], ["-o", "a.csv", "--columns", "X,Y,Z,Subray,SurfaceX"]);
    let expected = of_run(&survey, &arguments(&[&recorded, &outputs[2..]]), &outputs[..2]);
    let dir = folder();
    compute(dir.path(), &survey, &arguments(&[&recorded, &outputs[2..]]), 0..3, 3);
    assert_same(&merged(dir.path(), &outputs), &expected, "subrays");
    let refused = run(dir.path(), &["merge", "shards", "-o", "b.xyz", "--subrays"]);
    assert_eq!(refused.status.code(), Some(2));
}

#[test]
fn pipelines_voxels_and_recorded_flights_have_shards() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in ["pipelines/voxels.toml", "pipelines/airborne.toml"] {
        let survey = root.join(name).to_str().unwrap().to_owned();
        let outputs = ["-o", "a.laz", "-o", "a.csv"];
        let expected = of_run(&survey, &[], &outputs);
        let dir = folder();
        compute(dir.path(), &survey, &[], 0..4, 4);
        assert_same(&merged(dir.path(), &outputs), &expected, name);
    }
}

#[test]
fn the_outputs_of_a_pipeline_file_come_from_shards() {
    let dir = folder();
    let survey = survey("room/survey.xml");
    let outputs = "[[output]]\npath = \"a.laz\"\n[[output]]\npath = \"b.xyz\"\n[[output]]\ncontent = \"trajectory\"\npath = \"c.csv\"\n";
    fs::write(dir.path().join("a.toml"), format!("survey = {survey:?}\nwaveforms = true\n{outputs}"))
        .unwrap();
    fs::create_dir(dir.path().join("one")).unwrap();
    succeed(&dir.path().join("one"), &["run", "../a.toml", "-q"]);
    for shard in ["0/3", "1/3", "2/3"] {
        succeed(dir.path(), &["run", "a.toml", "-q", "-o", "shards", "--shard", shard]);
    }
    fs::create_dir(dir.path().join("merged")).unwrap();
    succeed(&dir.path().join("merged"), &["merge", "../shards", "-q", "--pipeline", "../a.toml"]);
    let (expected, found) = (contents(&dir.path().join("one")), contents(&dir.path().join("merged")));
    assert!(expected.len() >= 4, "{:?}", expected.keys());
    assert_same(&found, &expected, "outputs of a pipeline file");
}

#[test]
fn tables_of_parts_are_refused_with_a_status_of_their_own() {
    let (dir, survey) = (folder(), survey("room/survey.xml"));
    let out = run(dir.path(), &["run", &survey, "--parts", "parts.csv", "--shard", "0/2", "-o", "shards"]);
    assert_eq!(out.status.code(), Some(4), "{}", text(&out.stderr));
}

#[test]
fn heights_above_ground_are_refused_with_the_status_of_what_cannot_be_divided() {
    let (dir, survey) = (folder(), survey("forest/survey.xml"));
    for options in [&["--resume", "-o", "a.laz"][..], &["--shard", "0/2", "-o", "shards"]] {
        let out = run(dir.path(), &[&["run", &survey, "--height-above-ground"], options].concat());
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(4), "{options:?}: {said}");
        assert!(said.contains("--resume") && !said.contains("vlscan merge"), "{said}");
    }
}

#[test]
fn poses_from_a_pipe_are_refused() {
    let dir = folder();
    let survey = survey("forest/survey.xml");
    let out = run(dir.path(), &["run", &survey, "--trajectory", "-", "--shard", "0/2", "-o", "shards"]);
    assert_eq!(out.status.code(), Some(4));
    assert!(text(&out.stderr).contains("read only once"), "{}", text(&out.stderr));
    let out = run(dir.path(), &["run", &survey, "--trajectory", "-", "--resume", "-o", "a.laz"]);
    assert_eq!(out.status.code(), Some(4));
    assert!(text(&out.stderr).contains("read only once"), "{}", text(&out.stderr));
}

#[test]
fn traced_streams_have_no_shards() {
    let dir = folder();
    for (options, word) in [(&["--shard", "0/2"][..], "--shard"), (&["--resume"], "--resume")] {
        let out = run(dir.path(), &arguments(&[&["trace", "p.csv", "--scanner", "x"], options]));
        let said = text(&out.stderr);
        assert!(out.status.code() == Some(2) && said.contains(word) && said.contains("stream"), "{said}");
    }
}

#[test]
fn merged_points_go_to_stdout() {
    let (dir, survey) = (folder(), survey("room/survey.xml"));
    let expected = succeed(dir.path(), &["run", &survey, "-q", "-o", "-", "--format", "laz"]).stdout;
    compute(dir.path(), &survey, &[], 0..3, 3);
    let found = succeed(dir.path(), &["merge", "shards", "-q", "-o", "-", "--format", "laz"]).stdout;
    assert!(!expected.is_empty() && found == expected);
    for threads in ["1", "5"] {
        let found =
            succeed(dir.path(), &["merge", "shards", "-q", "-o", "-", "--format", "laz", "-j", threads])
                .stdout;
        assert!(found == expected, "{threads} threads");
    }
    let many = run(dir.path(), &["merge", "shards", "-q", "-o", "-", "--format", "laz", "-j", "5000"]);
    assert_eq!((many.status.code(), &many.stdout[..]), (Some(2), &b""[..]));
    assert!(text(&many.stderr).contains("5000 threads: expected 1 to 1024"), "{}", text(&many.stderr));
}

#[test]
fn borders_found_before_give_the_same_shards() {
    let survey = survey("forest/survey.xml");
    let (planned, unplanned) = (folder(), folder());
    succeed(planned.path(), &["index-shards", &survey, "-q", "-o", "shards", "--waveforms", "--seed", "4"]);
    assert!(planned.path().join("shards/flight.vlindex").is_file());
    for dir in [&planned, &unplanned] {
        // Two of the ways of `compute`: the sizes of dynamic chunks, which are the blocks of a shard, depend
        // on time.
        compute(dir.path(), &survey, &["--seed", "4"], 0..2, 2);
    }
    assert_same(&contents(planned.path()), &contents(unplanned.path()), "shards");
    // Borders of another flight are refused, and damaged ones are made again.
    let other = ["run", &survey, "-q", "-o", "shards", "--shard", "1/4", "--seed", "5"];
    let out = run(planned.path(), &other);
    assert_eq!(out.status.code(), Some(4));
    assert!(text(&out.stderr).contains("seed (4, 5)"), "{}", text(&out.stderr));
    let plan = planned.path().join("shards/flight.vlindex");
    let sound = fs::read(&plan).unwrap();
    damage(&plan);
    let shard = ["run", &survey, "-o", "shards", "--shard", "1/2", "--seed", "4", "--resume"];
    let out = succeed(planned.path(), &shard);
    assert!(
        text(&out.stderr).contains("flight.vlindex is damaged and is computed again"),
        "{}",
        text(&out.stderr)
    );
    assert!(text(&out.stderr).contains("is complete"), "{}", text(&out.stderr));
    assert!(fs::read(&plan).unwrap() == sound);
}

#[test]
fn shards_of_other_runs_are_refused_and_what_is_missing_is_named() {
    let (dir, survey) = (folder(), survey("room/survey.xml"));
    let refused = |args: &[&str], words: &[&str]| {
        let out = run(dir.path(), args);
        assert_eq!(out.status.code(), Some(2), "{args:?}: {}", text(&out.stderr));
        let message = text(&out.stderr);
        assert!(words.iter().all(|word| message.contains(word)), "{args:?}: {message}");
    };
    let merge = ["merge", "shards", "-o", "a.laz"];
    refused(&merge, &["shards"]);
    compute(dir.path(), &survey, &["--seed", "1"], [0, 1, 4, 6], 8);
    refused(&merge, &["4 of 8 shards are missing", "--array=2-3,5,7"]);
    compute(dir.path(), &survey, &["--seed", "1"], [2, 3, 5, 7], 8);
    refused(
        &["run", &survey, "-o", "shards", "--shard", "3/8", "--seed", "1"],
        &["exists already", "--force", "--resume"],
    );
    let resumed = ["run", &survey, "-o", "shards", "--shard", "3/8", "--seed", "1", "--resume"];
    assert!(text(&succeed(dir.path(), &resumed).stderr).contains("is complete"));
    refused(&["merge", "shards", "-o", "a.laz", "--waveforms"], &["do not contain waveforms", "--waveforms"]);
    refused(&["run", &survey, "-o", "shards", "--shard", "8/8"], &["0 to N-1"]);
    refused(&["run", &survey, "--shard", "1/8"], &["-o DIR"]);
    succeed(dir.path(), &["merge", "shards", "--check"]);
    // Physics of another kind in two shards.
    let other = ["--seed", "1", "--physics", "refined", "--force"];
    fs::remove_file(dir.path().join("shards/flight.vlindex")).unwrap();
    compute(dir.path(), &survey, &other, [3, 4], 8);
    refused(&merge, &["shards 3-4 in shards belong to another run", "kinematics"]);
    fs::remove_file(dir.path().join("shards/flight.vlindex")).unwrap();
    compute(dir.path(), &survey, &["--seed", "1", "--force"], [3, 4], 8);
    // Damage within a block is found while merging; all damaged shards are named, and no output remains.
    for number in [2, 5] {
        damage(&dir.path().join(format!("shards/shard-{number:06}-of-000008.vlshard")));
    }
    refused(&merge, &["shard-000002-of-000008.vlshard", "shard-000005-of-000008.vlshard", "--array=2,5"]);
    refused(&["merge", "shards", "--check"], &["--array=2,5"]);
    assert!(!dir.path().join("a.laz").exists());
    // What the message says to be done: a damaged shard is not taken for a complete one.
    refused(&merge, &["-o shards --shard 2/8 --resume"]);
    for number in ["2/8", "5/8"] {
        let again = ["run", &survey, "-o", "shards", "--shard", number, "--seed", "1", "--resume"];
        let said = text(&succeed(dir.path(), &again).stderr);
        assert!(said.contains("is damaged") && said.contains("computed again"), "{said}");
        assert!(text(&succeed(dir.path(), &again).stderr).contains("is complete"));
    }
    succeed(dir.path(), &merge);
    let expected = of_run(&survey, &["--seed", "1"], &["-o", "a.laz"]);
    assert!(fs::read(dir.path().join("a.laz")).unwrap() == expected[Path::new("a.laz")]);
}

#[test]
fn a_run_in_shards_at_once_gives_the_same_bytes_and_leaves_nothing() {
    let survey = survey("moving/survey.xml");
    let expected = of_run(&survey, &["--pulses"], EVERY_FORMAT);
    let found = of_run(&survey, &["--pulses", "--resume=3000"], EVERY_FORMAT);
    assert_same(&found, &expected, "--resume");
    let dir = folder();
    let out = run(dir.path(), &["run", &survey, "-o", "-", "--format", "xyz", "--resume"]);
    assert_eq!(out.status.code(), Some(4), "{}", text(&out.stderr));
}

#[test]
fn damaged_shards_of_a_run_that_goes_on_are_computed_again() {
    let survey = survey("forest/survey.xml");
    // Its points need what `run --shard` always records.
    let out = "a.mcap";
    let expected = &of_run(&survey, &["--seed", "2"], &["-o", out])[Path::new(out)];
    let dir = folder();
    let shards = format!("{out}.shards");
    for number in ["0/4", "1/4", "2/4"] {
        let run = ["run", &survey, "-q", "-o", &shards, "--shard", number, "--seed", "2"];
        succeed(dir.path(), &run);
    }
    // As those that a run with --resume has made.
    let mark = "{\"program\":\"vlscan run --resume\",\"state\":\"shards\"}";
    fs::write(dir.path().join(&shards).join("vlscan-resume.json"), mark).unwrap();
    for name in ["shard-000000-of-000004.vlshard", "shard-000002-of-000004.vlshard", "flight.vlindex"] {
        damage(&dir.path().join(&shards).join(name));
    }
    let said = text(&succeed(dir.path(), &["run", &survey, "-o", out, "--resume", "--seed", "2"]).stderr);
    assert_eq!(said.matches("the shard is computed again").count(), 2, "{said}");
    assert!(said.contains("shard-000000-of-000004.vlshard is damaged"), "{said}");
    assert!(said.contains("flight.vlindex is damaged and is computed again"), "{said}");
    assert!(fs::read(dir.path().join(out)).unwrap() == *expected, "{out}");
    assert_eq!(files(dir.path()), [Path::new(out)]);
}

/// Changes a bit in the middle of a file.
fn damage(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(path, bytes).unwrap();
}

#[test]
fn a_folder_of_the_user_is_no_folder_of_shards() {
    let survey = survey("moving/survey.xml");
    let dir = folder();
    let chapter = dir.path().join("a.laz.shards/thesis/chapter1.txt");
    fs::create_dir_all(chapter.parent().unwrap()).unwrap();
    fs::write(&chapter, "precious").unwrap();
    for options in [&["--resume"][..], &["--resume", "--force"]] {
        let command = [&["run", &survey, "-o", "a.laz"], options].concat();
        let out = run(dir.path(), &command);
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
        assert!(
            text(&out.stderr).contains("a.laz.shards exists and was not made by"),
            "{}",
            text(&out.stderr)
        );
        assert_eq!(fs::read(&chapter).unwrap(), b"precious");
    }
    fs::rename(dir.path().join("a.laz.shards"), dir.path().join("a.laz.shards.done")).unwrap();
    succeed(dir.path(), &["run", &survey, "-q", "-o", "a.laz", "--resume"]);
    assert_eq!(fs::read(dir.path().join("a.laz.shards.done/thesis/chapter1.txt")).unwrap(), b"precious");
    assert!(dir.path().join("a.laz").exists() && !dir.path().join("a.laz.shards").exists());
}

#[test]
fn files_of_the_user_with_the_names_of_a_run_in_shards_are_kept() {
    let survey = survey("moving/survey.xml");
    for name in ["lock", "flight.vlindex", "a.laz.vlscan-0123abcd.part", "shard-000000-of-000001.vlshard"] {
        let dir = folder();
        let theirs = dir.path().join("a.laz.shards").join(name);
        fs::create_dir(theirs.parent().unwrap()).unwrap();
        fs::write(&theirs, "precious").unwrap();
        for options in [&["--resume"][..], &["--resume", "--force"]] {
            let out = run(dir.path(), &arguments(&[&["run", &survey, "-o", "a.laz"], options]));
            let said = text(&out.stderr);
            assert_eq!(out.status.code(), Some(2), "{name}: {said}");
            assert!(said.contains("a.laz.shards exists and was not made by"), "{name}: {said}");
            assert_eq!(fs::read(&theirs).unwrap(), b"precious", "{name}");
        }
    }
    // A damaged shard is replaced, and a file that is no shard is not.
    let dir = folder();
    let shard = dir.path().join("shards/shard-000000-of-000002.vlshard");
    fs::create_dir(shard.parent().unwrap()).unwrap();
    fs::write(&shard, "precious").unwrap();
    let command = ["run", &survey, "-o", "shards", "--shard", "0/2", "--resume"];
    let out = run(dir.path(), &command);
    assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("so it is not replaced"), "{}", text(&out.stderr));
    assert_eq!(fs::read(&shard).unwrap(), b"precious");
    fs::write(&shard, "VLSHARD\n, and cut short").unwrap();
    succeed(dir.path(), &command);
    assert!(fs::read(&shard).unwrap().len() > 1000);
}

#[test]
fn an_output_that_appears_while_a_run_is_ended_is_kept() {
    let dir = folder();
    let survey = survey("forest/survey.xml");
    let command = ["run", &survey, "-q", "-o", "a.laz", "--resume=1000"];
    let mut child = begin(dir.path(), &command, "a.laz.shards");
    child.kill().unwrap();
    child.wait().unwrap();
    fs::write(dir.path().join("a.laz"), "precious").unwrap();
    fs::write(dir.path().join("a.laz.shards/notes.txt"), "precious").unwrap();
    let out = run(dir.path(), &command);
    assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("a.laz exists already"), "{}", text(&out.stderr));
    assert_eq!(fs::read(dir.path().join("a.laz")).unwrap(), b"precious");
    fs::remove_file(dir.path().join("a.laz")).unwrap();
    succeed(dir.path(), &command);
    assert_eq!(files(dir.path()), [Path::new("a.laz"), Path::new("a.laz.shards/notes.txt")]);
}

/// True if a run has left shards.
fn has_shards(dir: &Path) -> bool {
    let names = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name());
    names.into_iter().any(|name| name.to_string_lossy().ends_with(".shards"))
}

/// Kills runs of a survey after growing times until one is complete; returns how many were killed.
fn kill_until_complete(dir: &Path, command: &[&str], first: Duration, step: Duration) -> usize {
    let mut after = first;
    for killed in 0.. {
        let mut child = vlscan(dir).args(command).stderr(Stdio::piped()).spawn().unwrap();
        let deadline = std::time::Instant::now() + after;
        let status = loop {
            match child.try_wait().unwrap() {
                Some(status) => break Some(status),
                None if std::time::Instant::now() > deadline => break None,
                None => std::thread::sleep(Duration::from_millis(2)),
            }
        };
        if let Some(status) = status {
            let mut message = String::new();
            std::io::Read::read_to_string(&mut child.stderr.take().unwrap(), &mut message).unwrap();
            // Killed after its last step, which removes the shards, the run before this one had written all
            // outputs.
            let was_complete = message.contains("exists already") && !has_shards(dir);
            assert!(status.success() || was_complete, "after {killed} kills: {message}");
            return killed;
        }
        // SIGKILL.
        child.kill().unwrap();
        child.wait().unwrap();
        after += step;
    }
    unreachable!()
}

#[test]
fn killed_runs_go_on_where_they_were() {
    let survey = survey("forest/survey.xml");
    let outputs = ["-o", "a.laz", "-o", "legs", "--format", "las"];
    let expected = of_run(&survey, &["--seed", "2"], &outputs);
    let dir = folder();
    let command = arguments(&[&["run", &survey, "-q", "--seed", "2", "--resume=4000", "-j", "2"], &outputs]);
    let killed =
        kill_until_complete(dir.path(), &command, Duration::from_millis(30), Duration::from_millis(40));
    assert!(killed >= 2, "the run was killed {killed} times only");
    assert_same(&contents(dir.path()), &expected, "killed");
}

#[test]
fn killed_runs_with_pulse_times_go_on_where_they_were() {
    let inputs = folder();
    let times: String =
        (0..90_000).map(|k| format!("{}\n", f64::from(k) * 8e-6 + f64::from(k * 5 % 7) * 1e-6)).collect();
    fs::write(inputs.path().join("times.txt"), times).unwrap();
    for when in ["pulse_times = \"times.txt\"", "pulse_intervals_us = [5, 11, 7.5]"] {
        let survey = survey("forest/survey.xml");
        let pipeline = inputs.path().join("times.toml");
        fs::write(&pipeline, format!("survey = {survey:?}\nseed = 2\n[settings]\n{when}\n")).unwrap();
        let pipeline = pipeline.to_str().unwrap();
        let expected = of_run(pipeline, &[], &["-o", "a.laz"]);
        let dir = folder();
        let command = ["run", pipeline, "-q", "--resume=2000", "-j", "2", "-o", "a.laz"];
        let killed =
            kill_until_complete(dir.path(), &command, Duration::from_millis(30), Duration::from_millis(40));
        assert!(killed >= 2, "the run was killed {killed} times only");
        assert_same(&contents(dir.path()), &expected, when);
    }
}

#[test]
#[ignore = "kills a hundred runs"]
fn a_hundred_killed_runs_go_on_where_they_were() {
    let survey = survey("forest/survey.xml");
    let outputs = ["-o", "a.laz", "-o", "a.copc.laz"];
    let expected = of_run(&survey, &[], &outputs);
    let command = arguments(&[&["run", &survey, "-q", "--resume=2000"], &outputs]);
    let mut killed = 0;
    for round in 0.. {
        if killed >= 100 {
            break;
        }
        let dir = folder();
        let first = Duration::from_millis(20 + 7 * round);
        killed += kill_until_complete(dir.path(), &command, first, Duration::from_millis(11));
        assert_same(&contents(dir.path()), &expected, "killed");
    }
}

/// Begins a run that can be resumed, and waits until `shards` holds some.
fn begin(folder: &Path, command: &[&str], shards: &str) -> std::process::Child {
    let mut child = vlscan(folder).args(command).spawn().unwrap();
    // The lock, the mark, the borders, and at least one shard beside the one that is being written.
    while fs::read_dir(folder.join(shards)).map_or(0, Iterator::count) < 5 {
        assert!(child.try_wait().unwrap().is_none(), "the run has ended");
        std::thread::sleep(Duration::from_millis(2));
    }
    child
}

#[test]
fn a_resumed_run_of_other_options_is_refused_unless_it_may_replace() {
    let dir = folder();
    let survey = survey("forest/survey.xml");
    let command = |seed: &'static str| ["run", &survey, "-q", "-o", "a.laz", "--resume=1000", "--seed", seed];
    let mut child = begin(dir.path(), &command("2"), "a.laz.shards");
    let refused = run(dir.path(), &command("2"));
    assert_eq!(refused.status.code(), Some(5), "another run is using it: {}", text(&refused.stderr));
    child.kill().unwrap();
    child.wait().unwrap();
    let refused = run(dir.path(), &command("3"));
    assert_eq!(refused.status.code(), Some(4));
    assert!(text(&refused.stderr).contains("seed (2, 3)"), "{}", text(&refused.stderr));
    succeed(dir.path(), &arguments(&[&command("3"), &["--force"]]));
    let expected = of_run(&survey, &["--seed", "3"], &["-o", "a.laz"]);
    assert_same(&contents(dir.path()), &expected, "another seed");
}

/// Runs a script of `pipelines/cluster/` in `folder`, with the program and `programs` on the search path.
fn script(folder: &Path, programs: &Path, command: &str) {
    let program = Path::new(env!("CARGO_BIN_EXE_vlscan")).parent().unwrap();
    let path = std::env::var("PATH").unwrap_or_default();
    let done = Command::new("bash")
        .args(["-c", &format!("{}/pipelines/cluster/{command}", env!("CARGO_MANIFEST_DIR"))])
        .env("PATH", format!("{}:{}:{path}", programs.display(), program.display()))
        .env("VLSCAN_THREADS", "1")
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(done.status.success(), "{command}: {}{}", text(&done.stdout), text(&done.stderr));
}

#[test]
fn gnu_parallel_computes_shards() {
    if Command::new("parallel").arg("--version").output().is_err() {
        return missing("parallel", "apt install parallel");
    }
    let (dir, survey) = (folder(), survey("forest/survey.xml"));
    let expected = of_run(&survey, &[], &["-o", "a.laz"]);
    script(dir.path(), dir.path(), &format!("parallel.sh {survey} a.laz 5"));
    assert!(fs::read(dir.path().join("a.laz")).unwrap() == expected[Path::new("a.laz")]);
}

/// An `sbatch` that runs what it is given at once, element by element.
const SBATCH: &str = r#"#!/bin/bash
set -eu
array=
while [[ $1 == --* ]]; do
  [[ $1 == --array=* ]] && array=${1#--array=}
  shift
done
export SLURM_CPUS_PER_TASK=2
if [ -z "$array" ]; then
  bash "$@" >&2
else
  export SLURM_ARRAY_TASK_COUNT=$((${array#*-} - ${array%-*} + 1))
  for SLURM_ARRAY_TASK_ID in $(seq "${array%-*}" "${array#*-}"); do
    export SLURM_ARRAY_TASK_ID
    bash "$@" >&2
  done
fi
echo 17
"#;

#[test]
fn the_scripts_for_slurm_compute_shards_and_merge_them() {
    let (dir, programs, survey) = (folder(), folder(), survey("forest/survey.xml"));
    let sbatch = programs.path().join("sbatch");
    fs::write(&sbatch, SBATCH).unwrap();
    fs::set_permissions(&sbatch, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let expected = of_run(&survey, &["--seed", "5"], &["-o", "a.laz"]);
    script(dir.path(), programs.path(), &format!("submit.sh {survey} a.laz 3 --seed 5"));
    assert!(fs::read(dir.path().join("a.laz")).unwrap() == expected[Path::new("a.laz")]);
    assert!(dir.path().join("logs").is_dir());
}

/// The scripts of the containers of a Kubernetes manifest: the lines of its block scalars.
fn container_scripts(manifest: &str) -> Vec<String> {
    let lines: Vec<&str> = manifest.lines().collect();
    let begins = (0..lines.len()).filter(|&i| lines[i].trim_start() == "- |");
    let indent = |line: &str| line.len() - line.trim_start().len();
    let script = |at: usize| {
        let inside = lines[at + 1..].iter().take_while(|line| indent(line) > indent(lines[at]));
        inside.map(|line| format!("{}\n", line.trim_start())).collect()
    };
    begins.map(script).collect()
}

#[test]
fn the_pods_of_kubernetes_compute_shards_and_merge_them() {
    let (dir, survey) = (folder(), survey("forest/survey.xml"));
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/cluster/kubernetes.yaml");
    let scripts = container_scripts(&fs::read_to_string(manifest).unwrap());
    let [shard, merge] = scripts.as_slice() else { panic!("{scripts:?}") };
    let expected = of_run(&survey, &[], &["-o", "a.laz"]);
    let program = Path::new(env!("CARGO_BIN_EXE_vlscan")).parent().unwrap();
    let pod = |script: &str, index: u32| {
        let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap_or_default());
        let mut command = Command::new("sh");
        command.args(["-c", script]).current_dir(dir.path()).env("PATH", path).env("COUNT", "3");
        command.env("SURVEY", &survey).env("SHARDS", "a.shards").env("OUTPUT", "a.laz");
        let done = command.env("JOB_COMPLETION_INDEX", index.to_string()).output().unwrap();
        assert!(done.status.success(), "{script}: {}", text(&done.stderr));
    };
    (0..3).for_each(|index| pod(shard, index));
    pod(shard, 1);
    pod(merge, 0);
    assert!(fs::read(dir.path().join("a.laz")).unwrap() == expected[Path::new("a.laz")]);
}

#[test]
fn shards_of_other_instruction_sets_and_of_packed_scenes_give_the_same_bytes() {
    let (dir, survey) = (folder(), survey("forest/survey.xml"));
    let outputs = ["-o", "a.laz", "-o", "a.csv"];
    let expected = of_run(&survey, &[], &outputs);
    succeed(dir.path(), &["scene", "pack", &survey, "-q", "-o", "s.vlscene"]);
    // A packed scene has a fingerprint of its own: all shards are computed with it, or none.
    for scene in [&[][..], &["--scene", "s.vlscene"]] {
        for (number, set) in ["portable", "avx2", "avx512"].into_iter().enumerate() {
            let shard = format!("{number}/3");
            let run = arguments(&[&["run", &survey, "-q", "-o", "shards", "--shard", &shard], scene]);
            let done = vlscan(dir.path()).args(run).env("VLSCAN_SIMD", set).output().unwrap();
            assert!(done.status.success(), "{set}: {}", text(&done.stderr));
        }
        assert_same(&merged(dir.path(), &outputs), &expected, &format!("{scene:?}"));
        fs::remove_dir_all(dir.path().join("shards")).unwrap();
    }
}

#[test]
fn merges_in_segments_are_joined_to_the_same_bytes() {
    let dir = folder();
    succeed(dir.path(), &["scene", "make", "forest", "-n", "3k", "--pulses", "200k", "-o", "f", "-q"]);
    let survey = dir.path().join("f/survey.xml").to_str().unwrap().to_owned();
    compute(dir.path(), &survey, &[], 0..3, 3);
    for out in ["a.las", "a.laz"] {
        let expected = &of_run(&survey, &[], &["-o", out, "--labels"])[Path::new(out)];
        let merge = ["merge", "shards", "-q", "-o", out, "--labels"];
        let refused = |options: &[&str], word: &str| {
            let done = run(dir.path(), &arguments(&[&merge, options]));
            assert!(
                done.status.code() == Some(2) && text(&done.stderr).contains(word),
                "{}",
                text(&done.stderr)
            );
        };
        for of in [5, 2, 40] {
            for number in (1..of).rev() {
                succeed(dir.path(), &arguments(&[&merge, &["--segment", &format!("{number}/{of}")]]));
            }
            refused(&["--join"], "--array=0");
            succeed(dir.path(), &arguments(&[&merge, &["--segment", &format!("0/{of}")]]));
            // Segments of other options are not its segments.
            let other = run(dir.path(), &["merge", "shards", "-q", "-o", out, "--join"]);
            assert!(text(&other.stderr).contains("no segments of these shards"), "{}", text(&other.stderr));
            succeed(dir.path(), &arguments(&[&merge, &["--join"]]));
            assert!(fs::read(dir.path().join(out)).unwrap() == *expected, "{out} in {of} segments");
            refused(&["--join"], "--force");
            fs::remove_file(dir.path().join(out)).unwrap();
            // Damaged segments are found, and what the message says to be done mends them.
            let segments = fs::read_dir(dir.path().join(format!("{out}.segments"))).unwrap();
            let mut segments: Vec<PathBuf> = segments.map(|entry| entry.unwrap().path()).collect();
            segments.sort();
            damage(&segments[1]);
            refused(&["--join"], &segments[1].file_name().unwrap().to_string_lossy());
            refused(&["--join"], &format!("--segment 1/{of} instead of --join"));
            fs::write(&segments[1], &fs::read(&segments[1]).unwrap()[..400]).unwrap();
            refused(&["--join"], "does not match its checksum");
            succeed(dir.path(), &arguments(&[&merge, &["--segment", &format!("1/{of}")]]));
            succeed(dir.path(), &arguments(&[&merge, &["--join"]]));
            assert!(fs::read(dir.path().join(out)).unwrap() == *expected, "{out} in {of} segments, mended");
            fs::remove_file(dir.path().join(out)).unwrap();
            fs::remove_dir_all(dir.path().join(format!("{out}.segments"))).unwrap();
        }
        refused(&["--segment", "0/2", "-o", "b.xyz"], "alone");
        refused(&["--segment", "0/2", "--waveforms"], "waveforms");
    }
}

#[test]
fn earlier_names_of_options_and_commands_work_the_same() {
    let (dir, survey) = (folder(), survey("forest/survey.xml"));
    succeed(dir.path(), &["plan-parts", &survey, "-q", "-o", "shards"]);
    let run = ["run", &survey, "-o", "shards", "--part", "0/1", "--part-points", "las"];
    let said = text(&succeed(dir.path(), &run).stderr);
    assert!(said.contains("--part-points no longer has an effect"), "{said}");
    succeed(dir.path(), &["merge", "shards", "-q", "-o", "a.las", "--part", "0/1"]);
    succeed(dir.path(), &["merge", "shards", "-q", "-o", "a.las", "--join"]);
    let expected = of_run(&survey, &[], &["-o", "a.las"]);
    assert!(fs::read(dir.path().join("a.las")).unwrap() == expected[Path::new("a.las")]);
}
