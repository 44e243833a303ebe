//! Damaged files: a run ends with a message that names the file, or gives the same points; never with others,
//! a panic, an endless loop, or much memory.

use crate::common::{fixture, folder, run, succeed, text};
use std::path::Path;
use std::process::Output;

/// Status 2, and a short message with these words.
fn assert_refused(output: &Output, words: &[&str], what: &str) {
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{what}: {message}");
    assert!(message.lines().count() <= 20 && !message.contains("panicked"), "{what}: {message}");
    assert!(words.iter().all(|word| message.contains(word)), "{what}: {message} lacks one of {words:?}");
}

/// Packs a scene, changes every `step`-th byte of the file and scans each of these scenes.
fn assert_flips_are_told(folder: &Path, survey: &str, pack_options: &[&str], step: usize) {
    succeed(folder, &[&["scene", "pack", survey, "-o", "s.vlscene", "-q", "--force"], pack_options].concat());
    let scan = || run(folder, &["run", survey, "--scene", "s.vlscene", "-q", "--format", "xyz", "-o", "-"]);
    let sound = scan();
    assert!(sound.status.success() && !sound.stdout.is_empty(), "{}", text(&sound.stderr));
    let whole = std::fs::read(folder.join("s.vlscene")).unwrap();
    for at in (0..whole.len()).step_by(step) {
        let mut bytes = whole.clone();
        bytes[at] ^= 1 << (at % 8);
        std::fs::write(folder.join("s.vlscene"), bytes).unwrap();
        let found = scan();
        if found.status.success() {
            assert!(found.stdout == sound.stdout, "{pack_options:?}: other points with byte {at} changed");
        } else {
            assert_refused(&found, &["packed scene s.vlscene"], &format!("{pack_options:?}: byte {at}"));
        }
    }
}

#[test]
fn a_changed_byte_of_a_small_packed_scene_is_told() {
    let dir = folder();
    crate::scenes::everything(dir.path());
    for (options, step) in
        [(&["--tree", "bvh"][..], 4001), (&["--tree", "fsah"], 4003), (&["--instances", "always"], 4007)]
    {
        assert_flips_are_told(dir.path(), "survey.xml", options, step);
    }
}

#[test]
fn a_changed_byte_of_a_large_packed_scene_is_told() {
    let dir = folder();
    succeed(dir.path(), &["scene", "make", "forest", "-n", "20000", "--pulses", "20000", "-o", "f", "-q"]);
    for (options, step) in [(&["--tree", "bvh"][..], 151_007), (&["--tree", "fsah"], 251_003)] {
        assert_flips_are_told(dir.path(), "f/survey.xml", options, step);
    }
}

#[test]
fn a_packed_scene_that_changes_during_a_run_gives_the_points_of_the_one_that_was_opened() {
    use std::io::{Read, Write};
    use std::process::Stdio;
    let dir = folder();
    let survey = fixture("room/survey.xml");
    let survey = survey.to_str().unwrap();
    succeed(dir.path(), &["scene", "pack", survey, "-o", "room.vlscene", "-q"]);
    let pulses = succeed(dir.path(), &["pulses", survey, "-q"]).stdout;
    let trace =
        ["trace", "-", "-q", "--scene", "room.vlscene", "--scanner", survey, "--format", "xyz", "-o", "-"];
    let half = pulses.len() / 2 + pulses[pulses.len() / 2..].iter().position(|b| *b == b'\n').unwrap() + 1;
    let mut child = crate::common::vlscan(dir.path())
        .args(trace)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut output = child.stdout.take().unwrap();
    let (arrived, first_points) = std::sync::mpsc::channel();
    let reader = std::thread::spawn(move || {
        let mut points = vec![0; 64];
        output.read_exact(&mut points).unwrap();
        arrived.send(()).unwrap();
        output.read_to_end(&mut points).unwrap();
        points
    });
    let mut input = child.stdin.take().unwrap();
    input.write_all(&pulses[..half]).unwrap();
    input.flush().unwrap();
    // The first points are there: the scene is open.
    first_points.recv().unwrap();
    let path = dir.path().join("room.vlscene");
    let sound = std::fs::read(&path).unwrap();
    std::fs::write(&path, vec![0xff; sound.len() / 2]).unwrap();
    input.write_all(&pulses[half..]).unwrap();
    drop(input);
    let points = reader.join().unwrap();
    let ended = child.wait_with_output().unwrap();
    assert!(ended.status.success(), "{}", text(&ended.stderr));
    std::fs::write(&path, sound).unwrap();
    let expected = crate::common::feed(dir.path(), &trace, &pulses);
    assert!(expected.status.success() && points == expected.stdout, "{}", text(&expected.stderr));
}

/// Every opening compares all checksums: a campaign opens the scene once for each of its cells.
#[test]
fn every_cell_of_a_campaign_over_a_damaged_packed_scene_fails() {
    let dir = folder();
    succeed(dir.path(), &["scene", "make", "forest", "-n", "2000", "--pulses", "2000", "-o", "f", "-q"]);
    succeed(dir.path(), &["scene", "pack", "f/survey.xml", "-o", "s.vlscene", "-q"]);
    let mut bytes = std::fs::read(dir.path().join("s.vlscene")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 16;
    std::fs::write(dir.path().join("s.vlscene"), bytes).unwrap();
    let campaign = "out = \"cells\"\nseeds = 3\n[[scene]]\nname = \"s\"\nfile = \"s.vlscene\"\n\
        [[variant]]\nname = \"v\"\nsurvey = \"f/survey.xml\"\n";
    std::fs::write(dir.path().join("c.toml"), campaign).unwrap();
    let ended = run(dir.path(), &["campaign", "c.toml", "-j", "1"]);
    let message = text(&ended.stderr);
    assert!(!ended.status.success(), "{message}");
    let manifest = std::fs::read_to_string(dir.path().join("cells/manifest.jsonl")).unwrap();
    assert_eq!(manifest.lines().filter(|line| line.contains("is damaged")).count(), 3, "{manifest}");
}

#[test]
fn heights_beyond_all_limits_end_a_preview() {
    let dir = folder();
    std::fs::write(dir.path().join("high.xyz"), "0 0 1e16\n").unwrap();
    let refused = run(dir.path(), &["preview", "high.xyz", "-o", "p.png"]);
    assert_refused(&refused, &["high.xyz", "1e12"], "a height of 1e16 m");
    // One height, and a step of the legend that is too small to be added to it.
    for height in ["1e12", "999999999999.5"] {
        std::fs::write(dir.path().join("high.xyz"), format!("0 0 {height}\n1 1 {height}\n")).unwrap();
        succeed(dir.path(), &["preview", "high.xyz", "-o", "p.png", "--force"]);
    }
}

#[test]
fn sizes_in_headers_of_point_files_are_compared_with_the_file() {
    let dir = folder();
    let survey = fixture("room/survey.xml");
    succeed(dir.path(), &["run", survey.to_str().unwrap(), "-q", "-o", "a.las", "-o", "a.laz"]);
    for name in ["a.las", "a.laz"] {
        let whole = std::fs::read(dir.path().join(name)).unwrap();
        for (what, length) in [("of 2^60 bytes", 1u64 << 60), ("of 6 GB", 6_000_000_000)] {
            let mut bytes = whole.clone();
            // One more extended record at the end (LAS 1.4, table 3): its place and the number of records.
            let end = bytes.len() as u64;
            bytes[235..243].copy_from_slice(&end.to_le_bytes());
            bytes[243..247].copy_from_slice(&1u32.to_le_bytes());
            bytes.extend([0u8; 2]);
            bytes.extend(b"somebody\0\0\0\0\0\0\0\0");
            bytes.extend(7u16.to_le_bytes());
            bytes.extend(length.to_le_bytes());
            bytes.extend([0u8; 32]);
            std::fs::write(dir.path().join(name), bytes).unwrap();
            let found = run(dir.path(), &["preview", name, "-o", "p.png", "--force"]);
            assert_refused(&found, &[name, "ends within its header"], what);
        }
    }
}
