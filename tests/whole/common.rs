//! Helpers of the whole-run tests: the program, fixtures, temporary folders, readers of other makers.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// The program under test, started in `folder`.
pub fn vlscan(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vlscan"));
    command.current_dir(folder);
    command
}

/// A file or folder of `fixtures/`.
pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

/// An empty folder that is removed when the value is dropped.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Runs the program with these arguments in `folder` and returns its output.
pub fn run(folder: &Path, args: &[&str]) -> Output {
    vlscan(folder).args(args).stdin(Stdio::null()).output().expect("the program starts")
}

/// Like [`run`], and the program must succeed.
pub fn succeed(folder: &Path, args: &[&str]) -> Output {
    let output = run(folder, args);
    assert!(output.status.success(), "vlscan {} failed:\n{}", args.join(" "), text(&output.stderr));
    output
}

/// Runs the program with `input` on its stdin.
pub fn feed(folder: &Path, args: &[&str], input: &[u8]) -> Output {
    let mut child = vlscan(folder)
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut stdin = child.stdin.take().expect("a pipe");
    let input = input.to_vec();
    let writer = std::thread::spawn(move || {
        // The program may stop reading early.
        let _ = stdin.write_all(&input);
    });
    let output = child.wait_with_output().expect("the program ends");
    writer.join().expect("the writer ends");
    output
}

/// A GeoTIFF of 8 x 8 heights, 32-bit floats, whose first pixel is at `origin` and whose pixels are `step`
/// wide; `epsg` is the code of its projected system.
pub fn raster(origin: [f64; 2], step: f64, epsg: Option<u16>) -> Vec<u8> {
    let heights: Vec<f32> = (0..64).map(|i| 300.0 + i as f32).collect();
    raster_of(8, &heights, origin, step, epsg)
}

/// As [`raster`], with these heights in so many columns.
pub fn raster_of(columns: usize, heights: &[f32], origin: [f64; 2], step: f64, epsg: Option<u16>) -> Vec<u8> {
    let entries = if epsg.is_some() { 13u16 } else { 12 };
    let scale_at = 8 + 2 + 12 * u32::from(entries) + 4;
    let tie_at = scale_at + 24;
    let keys_at = tie_at + 48;
    let data = keys_at + 24;
    let (columns, rows) = (columns as u32, (heights.len() / columns) as u32);
    let mut tiff = b"II*\0\x08\0\0\0".to_vec();
    tiff.extend(entries.to_le_bytes());
    let mut entry = |tag: u16, kind: u16, count: u32, value: u32| {
        tiff.extend(tag.to_le_bytes());
        tiff.extend(kind.to_le_bytes());
        tiff.extend(count.to_le_bytes());
        tiff.extend(value.to_le_bytes());
    };
    for (tag, kind, value) in [
        (256, 4, columns),
        (257, 4, rows),
        (258, 3, 32),
        (259, 3, 1),
        (262, 3, 1),
        (273, 4, data),
        (277, 3, 1),
        (278, 4, rows),
        (279, 4, 4 * columns * rows),
        (339, 3, 3),
    ] {
        entry(tag, kind, 1, value);
    }
    entry(33550, 12, 3, scale_at);
    entry(33922, 12, 6, tie_at);
    if epsg.is_some() {
        entry(34735, 3, 12, keys_at);
    }
    tiff.extend(0u32.to_le_bytes());
    [step, step, 0.0, 0.0, 0.0, 0.0, origin[0], origin[1], 0.0]
        .iter()
        .for_each(|v| tiff.extend(v.to_le_bytes()));
    // Version 1.1.0 with two keys: projected coordinates, their system.
    let keys = [1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, epsg.unwrap_or(0)];
    keys.iter().for_each(|key| tiff.extend(key.to_le_bytes()));
    heights.iter().for_each(|height| tiff.extend(height.to_le_bytes()));
    tiff
}

/// Bytes as text for messages.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// All files below `folder` with their paths relative to it, sorted.
pub fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut todo = vec![folder.to_path_buf()];
    while let Some(dir) = todo.pop() {
        for entry in std::fs::read_dir(&dir).expect("a readable folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                todo.push(path);
            } else {
                found.push(path.strip_prefix(folder).expect("a path below").to_path_buf());
            }
        }
    }
    found.sort();
    found
}

/// The survey of a forest.
pub fn forest() -> String {
    fixture("forest/survey.xml").to_str().unwrap().to_owned()
}

/// Runs a Python script in `folder`, and returns what it prints; an exception fails the test.
pub fn judge(python: &Path, folder: &Path, script: &str) -> String {
    let judged = Command::new(python).args(["-c", script]).current_dir(folder).output().unwrap();
    assert!(judged.status.success(), "{}", text(&judged.stderr));
    text(&judged.stdout)
}

/// A Python that can import these modules, or `None` where there is none, see [`missing`].
pub fn python(modules: &str) -> Option<PathBuf> {
    let candidates = [std::env::var("VLSCAN_PYTHON").ok(), Some("python3".to_owned())];
    for python in candidates.into_iter().flatten() {
        let works = Command::new(&python)
            .args(["-c", &format!("import {modules}")])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|s| s.success());
        if works {
            return Some(python.into());
        }
    }
    let pip = modules.replace(',', "");
    for module in modules.split(", ") {
        missing(module, &format!("pip install {pip}"));
    }
    None
}

/// Says that a test, or a part of it, is skipped because `what` is not on this machine, and how to get it.
/// Fails in the continuous integration, which sets `VLSCAN_TEST_MAY_LACK` to what may be missing there, with
/// commas.
pub fn missing(what: &str, how: &str) {
    if let Ok(may_lack) = std::env::var("VLSCAN_TEST_MAY_LACK") {
        assert!(may_lack.split(',').any(|name| name == what), "{what} should be here and is not ({how})");
    }
    println!("skipped: no {what} ({how})");
}

/// A recording of a real instrument, which lies beside the repository where it may be used; says that it is
/// missing otherwise.
pub fn recording(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/real").join(name);
    if path.is_file() {
        return Some(path);
    }
    missing("recordings", &format!("no {}", path.display()));
    None
}

/// A Python that has laspy and lazrs.
pub fn python_with_laspy() -> Option<PathBuf> {
    python("laspy, lazrs")
}
