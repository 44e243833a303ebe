//! How a run ends: a file has its name only when it is complete; messages and exit statuses.

use crate::common;
use crate::common::{feed, files, fixture, folder, python_with_laspy, run, succeed, text, vlscan};
use std::fs;
use std::io::Read;
use std::process::{Output, Stdio};

fn room() -> String {
    fixture("room/survey.xml").to_str().unwrap().to_owned()
}

#[test]
fn wrong_input_is_reported_with_its_place_and_status_2() {
    let dir = folder();
    let survey = fs::read_to_string(fixture("room/survey.xml")).unwrap();
    let broken = survey.replace("<leg", "<leg>\n<oops").replacen("</survey>", "", 1);
    fs::write(dir.path().join("broken.xml"), broken).unwrap();
    let out = run(dir.path(), &["run", "broken.xml"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("broken.xml:"), "{}", text(&out.stderr));
    assert!(files(dir.path()).len() == 1, "nothing is written: {:?}", files(dir.path()));

    let out = run(dir.path(), &["run", "missing.xml"]);
    assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("missing.xml"));
}

#[test]
fn a_misspelt_attribute_warns_and_is_an_error_with_strict() {
    let dir = folder();
    for name in ["scene.xml", "scanners.xml", "platforms.xml"] {
        fs::copy(fixture("room").join(name), dir.path().join(name)).unwrap();
    }
    for entry in fs::read_dir(fixture("room")).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            fs::copy(&path, dir.path().join(path.file_name().unwrap())).unwrap();
        }
    }
    let survey = fs::read_to_string(fixture("room/survey.xml")).unwrap();
    assert!(survey.contains("pulseFreq_hz"));
    fs::write(dir.path().join("survey.xml"), survey.replacen("pulseFreq_hz", "pulseFreq_Hz", 1)).unwrap();
    let out = run(dir.path(), &["run", "survey.xml", "-o", "a.xyz"]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("pulseFreq_Hz"), "{}", text(&out.stderr));
    let out = run(dir.path(), &["run", "survey.xml", "-o", "b.xyz", "--strict"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(!dir.path().join("b.xyz").exists());
}

#[test]
fn nothing_is_overwritten_without_force() {
    let dir = folder();
    fs::write(dir.path().join("a.laz"), "mine").unwrap();
    let out = run(dir.path(), &["run", &room(), "-o", "a.laz"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("--force"), "{}", text(&out.stderr));
    assert_eq!(fs::read(dir.path().join("a.laz")).unwrap(), b"mine");
    succeed(dir.path(), &["run", &room(), "-o", "a.laz", "--force", "-q"]);
    assert_eq!(&fs::read(dir.path().join("a.laz")).unwrap()[..4], b"LASF");
    assert_eq!(files(dir.path()).len(), 1, "a .part was left: {:?}", files(dir.path()));
}

#[test]
fn a_reader_that_leaves_ends_the_run_quietly() {
    let dir = folder();
    let mut child = vlscan(dir.path())
        .args(["run", &room(), "-o", "-", "--format", "xyz"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut some = [0u8; 100];
    child.stdout.take().unwrap().read_exact(&mut some).unwrap();
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    assert!(!text(&out.stderr).contains("error"), "{}", text(&out.stderr));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_a_clear_error_and_status_1() {
    let dir = folder();
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    for format in ["xyz", "las", "laz", "ply"] {
        let out = vlscan(dir.path())
            .args(["run", &room(), "-o", "-", "--format", format])
            .stdout(full.try_clone().unwrap())
            .output()
            .unwrap();
        assert_eq!(out.status.code(), Some(1), "{format}: {}", text(&out.stderr));
        assert!(text(&out.stderr).contains("No space left"), "{format}: {}", text(&out.stderr));
    }
}

/// A run over poses that never end, interrupted by `signal` as soon as the temporary file of `watched` has
/// grown to `bytes`.
#[cfg(unix)]
fn interrupted(folder: &std::path::Path, sinks: &[&str], watched: &str, bytes: u64, signal: &str) -> Output {
    let mut child = vlscan(folder)
        .args(["run", &fixture("forest/survey.xml").to_string_lossy(), "--trajectory", "-"])
        .args(sinks)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let stdin = child.stdin.take().unwrap();
    let feeder = std::thread::spawn(move || {
        use std::io::Write;
        let mut stdin = stdin;
        for i in 0..u64::MAX {
            let line = format!("{},{},0,400,0,0,90\n", 100.0 + i as f64 * 0.005, i as f64 * 0.001);
            if stdin.write_all(line.as_bytes()).is_err() {
                break;
            }
        }
    });
    let started = std::time::Instant::now();
    let length = || {
        let part = files(folder).into_iter().find(|f| {
            let name = f.to_string_lossy();
            name.starts_with(&format!("{watched}.vlscan-")) && name.ends_with(".part")
        });
        part.and_then(|part| fs::metadata(folder.join(part)).ok()).map_or(0, |m| m.len())
    };
    while length() < bytes {
        assert!(started.elapsed().as_secs() < 60, "the run does not write");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    let out = child.wait_with_output().unwrap();
    feeder.join().unwrap();
    out
}

#[cfg(unix)]
#[test]
fn an_interrupt_leaves_valid_files_that_say_they_are_partial() {
    for signal in ["-INT", "-TERM"] {
        let dir = folder();
        let names = ["a.csv", "a.las", "a.laz", "a.ply", "a.xyz", "a.arrow", "a.parquet", "a.bin"];
        let sinks: Vec<&str> = names.iter().flat_map(|name| ["-o", name]).collect();
        let out = interrupted(dir.path(), &sinks, "a.csv", 300_000, signal);
        assert_eq!(out.status.code(), Some(130), "{}", text(&out.stderr));
        assert!(text(&out.stderr).contains("partial"), "{}", text(&out.stderr));
        let expected =
            ["arrow", "bin", "csv", "las", "laz", "parquet", "ply", "xyz"].map(|e| format!("a.partial.{e}"));
        let found: Vec<String> = files(dir.path()).iter().map(|f| f.display().to_string()).collect();
        assert_eq!(found, expected);
        let points = fs::read_to_string(dir.path().join("a.partial.csv")).unwrap().lines().count() - 1;
        assert!(points > 1000, "{points} points");
        let xyz = fs::read_to_string(dir.path().join("a.partial.xyz")).unwrap();
        assert!(xyz.ends_with('\n') && xyz.lines().count() == points);
        let ply = fs::read(dir.path().join("a.partial.ply")).unwrap();
        let ply = text(&ply[..2000]);
        assert!(
            ply.contains("comment state partial") && ply.contains(&format!("element vertex {points}\n")),
            "{ply}"
        );
        let Some(python) = common::python("laspy, lazrs, pyarrow") else { continue };
        let script = format!(
            r#"
import laspy, pyarrow as pa, pyarrow.parquet as pq
for name in ("a.partial.las", "a.partial.laz"):
    las = laspy.read(name)
    assert len(las) == {points}, (len(las), {points})
    state = [v.record_data_bytes() for v in las.header.vlrs if (v.user_id, v.record_id) == ("vlscan", 2)]
    assert state[0].startswith(b"partial"), state
reader = pa.ipc.open_stream("a.partial.arrow")
rows, state = 0, {{}}
while True:
    try:
        batch, metadata = reader.read_next_batch_with_custom_metadata()
    except StopIteration:
        break
    rows, state = rows + batch.num_rows, dict(metadata or {{}})
assert rows == {points} and state[b"state"].startswith(b"partial"), (rows, state)
assert pa.ipc.open_stream("a.partial.arrow").read_all().num_rows == {points}
parquet = pq.ParquetFile("a.partial.parquet")
assert parquet.metadata.num_rows == {points}
assert parquet.metadata.metadata[b"state"].startswith(b"partial")
"#
        );
        let judged =
            std::process::Command::new(python).arg("-c").arg(script).current_dir(dir.path()).output();
        let judged = judged.unwrap();
        assert!(judged.status.success(), "{}", text(&judged.stderr));
    }
}

/// A run with `--force` over a complete file that does not come to its end leaves that file, and its own
/// points beside it.
#[cfg(unix)]
#[test]
fn an_interrupted_run_replaces_no_complete_file() {
    let dir = folder();
    let names = ["a.laz", "b.las", "a.csv"];
    let sinks: Vec<&str> =
        names.iter().flat_map(|name| ["-o", name]).chain(["--wave-packets", "beside"]).collect();
    for name in names {
        succeed(dir.path(), &["run", &room(), "-q", "-o", name, "--seed", "3"]);
    }
    let old = names.map(|name| fs::read(dir.path().join(name)).unwrap());
    let forced = [&sinks[..], &["-o", "new.csv", "--force"]].concat();
    let out = interrupted(dir.path(), &forced, "a.csv", 300_000, "-INT");
    assert_eq!(out.status.code(), Some(130), "{}", text(&out.stderr));
    let said = text(&out.stderr);
    assert!(said.contains("a.laz is unchanged; what was measured so far is in a.partial.laz"), "{said}");
    for (name, old) in names.iter().zip(&old) {
        assert!(fs::read(dir.path().join(name)).unwrap() == *old, "{name} was replaced");
    }
    let points = fs::read_to_string(dir.path().join("a.partial.csv")).unwrap().lines().count() - 1;
    assert!(points > 1000, "{points}");
    let mut expected: Vec<String> = ["new.partial.csv"].map(str::to_owned).to_vec();
    expected.extend(names.map(str::to_owned));
    expected.extend(["a.partial.laz", "b.partial.las", "a.partial.csv"].map(str::to_owned));
    expected.extend(["a.partial.wdp", "b.partial.wdp"].map(str::to_owned));
    expected.sort();
    let found: Vec<String> = files(dir.path()).iter().map(|f| f.display().to_string()).collect();
    assert_eq!(found, expected);
    let Some(python) = python_with_laspy() else { return };
    let script = format!(
        "import laspy\nfor name in ('b.partial.las', 'a.partial.laz'):\n  assert len(laspy.read(name)) == {points}, name"
    );
    let judged =
        std::process::Command::new(python).args(["-c", &script]).current_dir(dir.path()).output().unwrap();
    assert!(judged.status.success(), "{}", text(&judged.stderr));
}

#[test]
fn an_error_in_the_middle_replaces_no_complete_file() {
    let dir = folder();
    let mut poses = String::from("time,x,y,z,roll,pitch,yaw\n");
    for i in 0..40 {
        poses += &format!("{},{},0,400,0,0,90\n", f64::from(i) * 0.1, f64::from(i) - 20.0);
    }
    poses += "0.5,0,0,400,0,0,90\n";
    let survey = fixture("forest/survey.xml");
    let fly = |extra: &[&str]| {
        let args = [&["run", survey.to_str().unwrap(), "--trajectory", "-", "-o", "a.laz"], extra].concat();
        feed(dir.path(), &args, poses.as_bytes())
    };
    // What was measured before the error is kept, and never replaced without --force.
    for (extra, name) in
        [(&[][..], "a.partial.laz"), (&[], "a.partial-2.laz"), (&["--force"], "a.partial.laz")]
    {
        let out = fly(extra);
        assert_eq!(out.status.code(), Some(2));
        let said = text(&out.stderr);
        assert!(said.contains(&format!("what was measured so far is in {name}")), "{said}");
        assert_eq!(&fs::read(dir.path().join(name)).unwrap()[..4], b"LASF");
        assert!(!dir.path().join("a.laz").exists());
    }
    files(dir.path()).iter().for_each(|name| fs::remove_file(dir.path().join(name)).unwrap());
    succeed(dir.path(), &["run", &room(), "-q", "-o", "a.laz"]);
    let old = fs::read(dir.path().join("a.laz")).unwrap();
    let out = fly(&["--force"]);
    let said = text(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(said.contains("goes back") && said.contains("is in a.partial.laz"), "{said}");
    assert!(fs::read(dir.path().join("a.laz")).unwrap() == old);
    assert_eq!(&fs::read(dir.path().join("a.partial.laz")).unwrap()[..4], b"LASF");
    assert_eq!(files(dir.path()).len(), 2, "{:?}", files(dir.path()));
}

#[cfg(unix)]
#[test]
fn an_interrupted_stream_is_complete() {
    let dir = folder();
    // What is written into a file tells when to interrupt; the stream is not read until then.
    let sinks = ["-o", "a.csv", "-o", "-", "--format", "csv", "-q"];
    let out = interrupted(dir.path(), &sinks, "a.csv", 1, "-INT");
    assert_eq!(out.status.code(), Some(130), "{}", text(&out.stderr));
    assert!(out.stdout == fs::read(dir.path().join("a.partial.csv")).unwrap(), "the stream was cut");
}

#[test]
fn a_reader_that_leaves_does_not_end_the_other_outputs() {
    let dir = folder();
    let args = ["run", &room(), "-q", "-o", "-", "-o", "a.xyz"];
    let mut child =
        vlscan(dir.path()).args(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut some = [0u8; 100];
    child.stdout.take().unwrap().read_exact(&mut some).unwrap();
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    succeed(dir.path(), &["run", &room(), "-q", "-o", "whole.xyz"]);
    let read = |name: &str| fs::read(dir.path().join(name)).unwrap();
    assert!(read("a.xyz") == read("whole.xyz"), "the file lost points to the reader's end");
}

/// Runs a line of bash with `$VLSCAN` and `$SURVEY`; `None` where a program of `needs` is missing.
#[cfg(unix)]
fn shell(folder: &std::path::Path, needs: &[&str], line: &str) -> Option<Output> {
    for program in std::iter::once(&"bash").chain(needs) {
        if std::process::Command::new(program).arg("--version").stdin(Stdio::null()).output().is_err() {
            common::missing(program, &format!("apt install {program}"));
            return None;
        }
    }
    let mut bash = std::process::Command::new("bash");
    bash.args(["-o", "pipefail", "-c", line]).current_dir(folder).stdin(Stdio::null());
    bash.env("VLSCAN", env!("CARGO_BIN_EXE_vlscan")).env("SURVEY", room());
    Some(bash.output().unwrap())
}

#[cfg(unix)]
#[test]
fn every_name_of_stdout_and_a_named_pipe_take_the_same_points() {
    let dir = folder();
    succeed(dir.path(), &["run", &room(), "-q", "-o", "a.las"]);
    let whole = fs::read(dir.path().join("a.las")).unwrap();
    for name in ["-", "STDOUT", "/dev/stdout", "/proc/self/fd/1"] {
        let out = run(dir.path(), &["run", &room(), "-q", "-o", name, "--format", "las"]);
        assert!(out.status.success(), "{name}: {}", text(&out.stderr));
        assert!(out.stdout == whole, "{name}");
    }
    let line = r#"mkfifo p.las q.arrow
        cat p.las > from_pipe.las & cat q.arrow > from_pipe.arrow &
        "$VLSCAN" run "$SURVEY" -q -o p.las -o q.arrow -o b.arrow && wait"#;
    let Some(out) = shell(dir.path(), &[], line) else { return };
    assert!(out.status.success(), "{}", text(&out.stderr));
    let read = |name: &str| fs::read(dir.path().join(name)).unwrap();
    assert!(read("from_pipe.las") == whole);
    assert!(read("from_pipe.arrow") == read("b.arrow"));
}

#[cfg(unix)]
#[test]
fn tee_and_head_take_what_they_want() {
    let dir = folder();
    let line = r#""$VLSCAN" run "$SURVEY" -q -o - --format csv | tee -p >(gzip > a.csv.gz) >(head -3 > head.csv) |
        awk -F, 'NR == 1 { for (i = 1; i <= NF; i++) at[$i] = i; next } { n[$at["ReturnNumber"]]++ } END { print n[1] }'"#;
    let Some(out) = shell(dir.path(), &["gzip", "awk"], line) else { return };
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(text(&out.stdout).trim().parse::<u64>().unwrap() > 1000, "{}", text(&out.stdout));
    let quiet =
        shell(dir.path(), &[], r#""$VLSCAN" run "$SURVEY" -q -o - --format arrow | head -c 1000 | wc -c"#)
            .unwrap();
    assert!(quiet.status.success() && quiet.stderr.is_empty(), "{}", text(&quiet.stderr));
    assert_eq!(text(&quiet.stdout).trim(), "1000");
}

#[cfg(unix)]
#[test]
fn pv_passes_binary_points_on() {
    let dir = folder();
    succeed(dir.path(), &["run", &room(), "-q", "-o", "a.laz"]);
    let line = r#""$VLSCAN" run "$SURVEY" -q -o - --format laz | pv -q > piped.laz"#;
    let Some(out) = shell(dir.path(), &["pv"], line) else { return };
    assert!(out.status.success(), "{}", text(&out.stderr));
    let read = |name: &str| fs::read(dir.path().join(name)).unwrap();
    assert!(read("piped.laz") == read("a.laz"));
}

/// CloudCompare's command line reads PLY wherever it is installed; LAS only in builds with a plugin for it.
#[cfg(unix)]
#[test]
fn cloudcompare_reads_ply() {
    let dir = folder();
    succeed(dir.path(), &["run", &room(), "-q", "-o", "a.ply", "-o", "a.xyz"]);
    if std::process::Command::new("sh")
        .args(["-c", "command -v CloudCompare"])
        .output()
        .unwrap()
        .stdout
        .is_empty()
    {
        common::missing("CloudCompare", "apt install cloudcompare");
        return;
    }
    let line = "QT_QPA_PLATFORM=offscreen HOME=$PWD timeout 120 CloudCompare -SILENT -O a.ply -C_EXPORT_FMT ASC -PREC 6 \
                -SAVE_CLOUDS && mv a_*.asc a.asc";
    let out = shell(dir.path(), &[], line).unwrap();
    assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
    let rows = |name: &str| -> Vec<Vec<f64>> {
        let table = fs::read_to_string(dir.path().join(name)).unwrap();
        table.lines().map(|l| l.split(' ').map_while(|f| f.parse().ok()).take(3).collect()).collect()
    };
    let (theirs, ours) = (rows("a.asc"), rows("a.xyz"));
    assert_eq!(theirs.len(), ours.len());
    for (t, o) in theirs.iter().zip(&ours) {
        assert!(t.iter().zip(o).all(|(t, o)| (t - o).abs() < 1e-3), "{t:?} for {o:?}");
    }
}

#[cfg(unix)]
#[test]
fn gnu_parallel_makes_the_same_clouds() {
    let dir = folder();
    let line = r#"parallel --version 2>/dev/null | grep -q GNU || exit 99
        parallel --will-cite -j 2 '"$VLSCAN" run "$SURVEY" -q --seed {} -o {}.laz' ::: 1 2 3"#;
    let out = shell(dir.path(), &[], line).unwrap();
    if out.status.code() == Some(99) {
        common::missing("parallel", "apt install parallel");
        return;
    }
    assert!(out.status.success(), "{}", text(&out.stderr));
    succeed(dir.path(), &["run", &room(), "-q", "--seed", "2", "-o", "alone.laz"]);
    let read = |name: &str| fs::read(dir.path().join(name)).unwrap();
    assert!(read("2.laz") == read("alone.laz"));
    assert!(read("1.laz") != read("2.laz"), "the seed changes nothing");
}

#[cfg(target_os = "linux")]
#[test]
fn a_terminal_gets_no_binary_points_without_force() {
    let dir = folder();
    // `script` gives the program a terminal.
    let on_a_terminal = |extra: &str| {
        let line = format!(r#"script -qec "$VLSCAN run $SURVEY -q -o - {extra}" /dev/null | tail -c 3000"#);
        shell(dir.path(), &["script"], &line)
    };
    for format in ["las", "laz", "ply", "arrow", "parquet", "bin"] {
        let Some(out) = on_a_terminal(&format!("--format {format}")) else { return };
        assert_eq!(out.status.code(), Some(2), "{format}: {}", text(&out.stdout));
        assert!(text(&out.stdout).contains("--force"), "{format}: {}", text(&out.stdout));
    }
    let forced = on_a_terminal("--format arrow --force").unwrap();
    assert!(forced.status.success());
    let words = on_a_terminal("--format csv").unwrap();
    assert!(words.status.success(), "{}", text(&words.stdout));
    let line = r#"script -qec "$VLSCAN pulses $SURVEY -q --format arrow" /dev/null | tail -c 3000"#;
    let pulses = shell(dir.path(), &["script"], line).unwrap();
    assert_eq!(pulses.status.code(), Some(2), "{}", text(&pulses.stdout));
    assert!(text(&pulses.stdout).contains("--force"), "{}", text(&pulses.stdout));
}

#[cfg(target_os = "linux")]
#[test]
fn a_terminal_shows_what_takes_long() {
    let dir = folder();
    let of_a_silent_stream = |options: &str| {
        let line = format!(
            r#"script -qec "sleep 2.5 | $VLSCAN frames - -o frames --layout kitti {options}" /dev/null"#
        );
        shell(dir.path(), &["script"], &line)
    };
    let Some(shown) = of_a_silent_stream("") else { return };
    let words = text(&shown.stdout);
    assert!(words.contains("writing frames ("), "{words}");
    // The line is empty again before the message.
    let message = words.rsplit("\u{1b}[2K").next().unwrap();
    assert!(message.contains("error") && !message.contains("writing frames"), "{words:?}");
    let quiet = of_a_silent_stream("-q").unwrap();
    assert!(!text(&quiet.stdout).contains("writing"), "{}", text(&quiet.stdout));
}

#[test]
fn a_bad_pose_is_reported_with_its_line() {
    let dir = folder();
    let poses = "time,x,y,z,roll,pitch,yaw\n1.0,0,0,400,0,0,0\n1.1,zero,0,400,0,0,0\n";
    let survey = fixture("forest/survey.xml");
    let args = ["run", survey.to_str().unwrap(), "--trajectory", "-", "-o", "a.xyz"];
    let out = feed(dir.path(), &args, poses.as_bytes());
    assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains(":3:"), "{}", text(&out.stderr));
    // The pulse at the first pose was measured.
    assert_eq!(files(dir.path()), [std::path::Path::new("a.partial.xyz")]);
    // Nothing is left where nothing was measured.
    fs::remove_file(dir.path().join("a.partial.xyz")).unwrap();
    let out = feed(dir.path(), &args, b"time,x,y,z,roll,pitch,yaw\n1.1,zero,0,400,0,0,0\n");
    assert!(out.status.code() == Some(2) && files(dir.path()).is_empty(), "{:?}", files(dir.path()));
}

/// Starts a command that reads the named pipe `pipe`, waits until it does, and sends it SIGINT.
#[cfg(unix)]
fn interrupted_reader(folder: &std::path::Path, args: &[&str], pipe: &str) -> Output {
    use std::os::unix::fs::OpenOptionsExt;
    const NON_BLOCKING: i32 = 0o4000;
    let child = vlscan(folder)
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut options = fs::OpenOptions::new();
    options.write(true).custom_flags(NON_BLOCKING);
    let started = std::time::Instant::now();
    // Fails as long as nobody reads.
    let _writer = loop {
        match options.open(folder.join(pipe)) {
            Ok(file) => break file,
            Err(_) => assert!(started.elapsed().as_secs() < 60, "{args:?} does not read"),
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    };
    std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    child.wait_with_output().unwrap()
}

#[cfg(target_os = "linux")]
#[test]
fn every_command_that_waits_for_its_input_ends_at_an_interrupt() {
    for args in [
        &["info", "in"][..],
        &["raster", "in", "--dtm", "d.tif"],
        &["compare", "in", "b.csv"],
        &["preview", "in", "-o", "a.png"],
        &["preview", "in", "-o", "a.copc.laz"],
        &["fit", "in", "-o", "a.toml"],
        &["scene", "reconstruct", "in", "-o", "found"],
        &["frames", "in", "-o", "frames", "--layout", "kitti"],
    ] {
        let dir = folder();
        fs::write(dir.path().join("b.csv"), "x,y,z\n1,2,3\n").unwrap();
        let made = std::process::Command::new("mkfifo").arg(dir.path().join("in")).status().unwrap();
        assert!(made.success());
        let out = interrupted_reader(dir.path(), args, "in");
        assert_eq!(out.status.code(), Some(130), "{args:?}: {}", text(&out.stderr));
        let mut left = files(dir.path());
        left.retain(|f| !matches!(f.to_str(), Some("in" | "b.csv")));
        assert!(left.is_empty(), "{args:?}: {left:?}");
    }
}
