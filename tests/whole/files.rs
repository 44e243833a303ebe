//! Names of outputs: two runs with one name, links, devices, sources, what is left by runs that were killed
//! or whose input failed, and signals at any time.

use crate::common::{feed, files, fixture, folder, run, succeed, text, vlscan};
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

fn room() -> String {
    fixture("room/survey.xml").to_str().unwrap().to_owned()
}

fn names(dir: &Path) -> Vec<String> {
    files(dir).iter().map(|f| f.display().to_string()).collect()
}

/// Fails with status 2 and a message that holds `part`.
fn refused(dir: &Path, args: &[&str], part: &str) {
    let out = run(dir, args);
    let said = text(&out.stderr);
    assert!(out.status.code() == Some(2) && said.contains(part), "vlscan {}: {said}", args.join(" "));
}

#[test]
fn no_command_replaces_what_it_reads() {
    let dir = folder();
    let at = |name: &str| dir.path().join(name);
    for entry in fs::read_dir(fixture("room")).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, at(path.file_name().unwrap().to_str().unwrap())).unwrap();
    }
    // A mesh of the scene under names that outputs may have.
    let scene = fs::read_to_string(at("scene.xml")).unwrap();
    fs::copy(at("shell.obj"), at("shell.png")).unwrap();
    fs::write(at("scene.xml"), scene.replace("shell.obj", "shell.png")).unwrap();
    fs::hard_link(at("shell.png"), at("hard.laz")).unwrap();
    fs::hard_link(at("shell.png"), at("hard.vlscene")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("shell.png", at("soft.laz")).unwrap();
    succeed(dir.path(), &["run", "survey.xml", "-q", "-o", "a.las"]);
    fs::copy(at("a.las"), at("b.las")).unwrap();
    succeed(dir.path(), &["run", "survey.xml", "-q", "--shard", "0/1", "-o", "p"]);
    fs::write(at("area.wkt"), "POLYGON ((-5 -5, 5 -5, 5 5, -5 5))").unwrap();
    fs::create_dir(at("models")).unwrap();
    let pyramid = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv 0 0 10\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n";
    fs::write(at("models/beech.obj"), pyramid).unwrap();
    fs::write(at("trees.csv"), "id,x,y,height,species\na,0,0,9,beech\n").unwrap();
    fs::write(at("ground.obj"), "v -9 -9 0\nv 9 -9 0\nv 9 9 0\nf 1 2 3\n").unwrap();
    let airborne = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--height", "60", "--density", "5"];
    let terrestrial = ["plan", "terrestrial", "--scanner", "riegl_vz400", "--spacing", "5"];
    let commands: Vec<Vec<&str>> = vec![
        vec!["run", "survey.xml", "-o", "hard.laz"],
        vec!["run", "survey.xml", "-o", "soft.laz"],
        vec!["run", "survey.xml", "-o", "c.laz", "--schedule-log", "scene.xml"],
        vec!["run", "survey.xml", "-o", "c.laz", "--parts", "shell.png"],
        vec!["run", "survey.xml", "--format", "las", "-o", "scene.xml"],
        vec!["scene", "pack", "survey.xml", "-o", "hard.vlscene"],
        vec!["preview", "survey.xml", "-o", "shell.png"],
        vec!["preview", "a.las", "-o", "a.las"],
        vec!["compare", "a.las", "b.las", "--page", "a.las"],
        vec!["compare", "a.las", "b.las", "--page", "b.las"],
        vec!["merge", "p", "-o", "p/shard-000000-of-000001.vlshard", "--format", "las"],
        [&airborne[..], &["--area", "area.wkt", "-o", "area.wkt"]].concat(),
        [&terrestrial[..], &["--ground", "0", "--scene", "ground.obj", "-o", "ground.obj"]].concat(),
        vec!["scene", "stand", "trees.csv", "--trees", "models", "-o", "."],
    ];
    let contents = || {
        let all = names(dir.path()).into_iter();
        all.map(|name| (fs::read(at(&name)).unwrap(), name)).collect::<Vec<_>>()
    };
    let pulses = succeed(dir.path(), &["pulses", "survey.xml", "-q"]).stdout;
    fs::write(at("pulses.csv"), pulses).unwrap();
    let before = contents();
    #[cfg(unix)]
    {
        let trace = ["trace", "-", "--scene", "scene.xml", "--scanner", "survey.xml"];
        let mut command = vlscan(dir.path());
        command.args(trace).args(["-o", "pulses.csv", "--force"]);
        let out = command.stdin(fs::File::open(at("pulses.csv")).unwrap()).output().unwrap();
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
        assert!(contents() == before);
    }
    for command in &commands {
        let args = [&command[..], &["--force", "-q"]].concat();
        let out = run(dir.path(), &args);
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "vlscan {}: {said}", args.join(" "));
        let is_told = said.contains("is read by this command") || said.contains("is a source of the scene");
        assert!(is_told, "vlscan {}: {said}", args.join(" "));
        assert!(contents() == before, "vlscan {}", args.join(" "));
    }
}

#[test]
fn two_runs_with_one_name_never_share_a_file() {
    let dir = folder();
    fs::write(dir.path().join("a.laz.part"), "mine").unwrap();
    let args = |seed| ["run", &room(), "-q", "-o", "a.laz", "--force", "--seed", seed].map(str::to_owned);
    let start = |seed| vlscan(dir.path()).args(args(seed)).spawn().unwrap();
    let mut runs: Vec<Child> = ["1", "2", "3"].map(start).into();
    assert!(runs.iter_mut().all(|run| run.wait().unwrap().success()));
    assert_eq!(names(dir.path()), ["a.laz", "a.laz.part"]);
    let last = fs::read(dir.path().join("a.laz")).unwrap();
    let alone = ["1", "2", "3"].map(|seed| {
        succeed(dir.path(), &["run", &room(), "-q", "-o", "b.laz", "--force", "--seed", seed]);
        fs::read(dir.path().join("b.laz")).unwrap()
    });
    assert!(alone.contains(&last), "the file is that of no run");
    assert_eq!(fs::read(dir.path().join("a.laz.part")).unwrap(), b"mine");
}

#[test]
fn one_file_has_one_output_and_no_source_is_replaced() {
    let dir = folder();
    let same = "two outputs would be written to";
    refused(dir.path(), &["run", &room(), "-o", "x.las", "-o", "./x.las", "--force"], same);
    refused(
        dir.path(),
        &["run", &room(), "-o", "x.las", "--schedule-log", "./x.las"],
        "the file is JSON, not las",
    );
    fs::write(dir.path().join("log.json"), "old").unwrap();
    refused(dir.path(), &["run", &room(), "-o", "x.las", "--schedule-log", "log.json"], "exists already");
    succeed(dir.path(), &["run", &room(), "-q", "-o", "x.las", "--schedule-log", "log.json", "--force"]);
    assert!(fs::read_to_string(dir.path().join("log.json")).unwrap().starts_with('{'));

    for entry in fs::read_dir(fixture("room")).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, dir.path().join(path.file_name().unwrap())).unwrap();
    }
    let survey = fs::read(dir.path().join("survey.xml")).unwrap();
    let log = ["run", "survey.xml", "-o", "y.las", "--schedule-log", "survey.xml", "--force"];
    refused(dir.path(), &log, "is read by this command");
    fs::hard_link(dir.path().join("shell.obj"), dir.path().join("shell.vlscene")).unwrap();
    let pack = ["scene", "pack", "survey.xml", "-o", "shell.vlscene", "--force"];
    refused(dir.path(), &pack, "is a source of the scene");
    assert!(fs::read(dir.path().join("survey.xml")).unwrap() == survey);
    assert!(fs::read(dir.path().join("shell.obj")).unwrap() == fs::read(fixture("room/shell.obj")).unwrap());

    assert!(!names(dir.path()).iter().any(|name| name.ends_with(".part")), "{:?}", names(dir.path()));

    let dir = folder();
    let flight = fs::read(fixture("flight.csv")).unwrap();
    fs::write(dir.path().join("flight.csv"), &flight).unwrap();
    let forest = fixture("forest/survey.xml").to_str().unwrap().to_owned();
    let onto = ["run", &forest, "--trajectory", "flight.csv", "-o", "./flight.csv", "--force"];
    refused(dir.path(), &onto, "is read by this command");
    assert!(fs::read(dir.path().join("flight.csv")).unwrap() == flight);
    assert_eq!(names(dir.path()), ["flight.csv"]);
}

#[cfg(unix)]
#[test]
fn links_devices_and_any_bytes_in_names() {
    use std::os::unix::ffi::OsStrExt;
    use std::os::unix::fs::{FileTypeExt, symlink};
    let dir = folder();
    let at = |name: &str| dir.path().join(name);
    fs::create_dir(at("d")).unwrap();
    symlink("d/target.xyz", at("link.xyz")).unwrap();
    for force in [&[][..], &["--force"]] {
        succeed(dir.path(), &[&["run", &room(), "-q", "-o", "link.xyz"], force].concat());
        assert!(at("link.xyz").is_symlink() && !at("d/target.xyz").is_symlink());
        assert!(fs::metadata(at("d/target.xyz")).unwrap().len() > 1000);
    }
    refused(dir.path(), &["run", &room(), "-o", "link.xyz"], "exists already");
    let both = ["run", &room(), "-o", "link.xyz", "-o", "d/target.xyz", "--force"];
    refused(dir.path(), &both, "two outputs");

    assert!(Command::new("mkfifo").arg(at("pipe")).status().unwrap().success());
    succeed(dir.path(), &["scene", "pack", &room(), "-q", "-o", "a.vlscene"]);
    let reader = std::thread::spawn({
        let pipe = at("pipe");
        move || fs::read(pipe).unwrap()
    });
    succeed(dir.path(), &["scene", "pack", &room(), "-q", "-o", "pipe"]);
    assert_eq!(reader.join().unwrap().len() as u64, fs::metadata(at("a.vlscene")).unwrap().len());
    assert!(fs::metadata(at("pipe")).unwrap().file_type().is_fifo());
    symlink("/dev/null", at("null")).unwrap();
    succeed(dir.path(), &["scene", "pack", &room(), "-q", "-o", "null"]);
    assert!(fs::metadata(at("null")).unwrap().file_type().is_char_device());

    let name = std::ffi::OsStr::from_bytes(b"\xff.las");
    let done = vlscan(dir.path()).args(["run", &room(), "-q", "-o"]).arg(name).status().unwrap();
    assert!(done.success() && dir.path().join(name).is_file());
}

#[test]
fn what_was_measured_before_a_bad_pulse_is_kept() {
    let survey = room();
    let flown = succeed(folder().path(), &["pulses", &survey, "-q"]).stdout;
    let lines: Vec<&str> = std::str::from_utf8(&flown).unwrap().lines().take(3001).collect();
    let good = lines.join("\n") + "\n";
    for (bad, part) in [
        // The upstream was cut within a line.
        (lines[5][..lines[5].len() / 2].to_owned(), "expected"),
        (lines[5].replacen(',', ",NaN,", 1), "columns"),
        (lines[5].split(',').map(|_| "NaN").collect::<Vec<_>>().join(","), "NaN"),
    ] {
        let dir = folder();
        let trace = |input: &str, sinks: &[&str]| {
            feed(dir.path(), &[&["trace", "-q", "--scanner", &survey], sinks].concat(), input.as_bytes())
        };
        let whole = trace(&good, &["-o", "whole.xyz"]);
        assert!(whole.status.success(), "{}", text(&whole.stderr));
        let out = trace(&format!("{good}{bad}"), &["-o", "a.xyz", "-o", "b.laz"]);
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{said}");
        assert!(said.contains(part) && said.contains(":3002:"), "{said}");
        assert!(said.contains("what was measured so far is in a.partial.xyz"), "{said}");
        assert_eq!(names(dir.path()), ["a.partial.xyz", "b.partial.laz", "whole.xyz"]);
        let read = |name: &str| fs::read(dir.path().join(name)).unwrap();
        assert!(read("a.partial.xyz") == read("whole.xyz"), "the pulses before the bad one are missing");
        assert_eq!(&read("b.partial.laz")[..4], b"LASF");
    }
}

#[test]
fn outputs_without_a_folder_are_errors_before_the_work() {
    let (dir, survey) = (folder(), room());
    succeed(dir.path(), &["run", &survey, "-q", "-o", "a.laz"]);
    let shard = ["run", &survey, "-q", "-o", "shards", "--shard", "0/1", "--schedule-log"];
    let logged = [&shard[..], &["none/a.json"]].concat();
    let commands: &[&[&str]] = &[
        &["compare", "a.laz", "a.laz", "--page", "none/a.html"],
        &["raster", "a.laz", "--dsm", "none/a.tif"],
        &["preview", "a.laz", "-o", "none/a.png"],
        &["fit", "a.laz", "-o", "none/a.toml"],
        &["scene", "pack", &survey, "-o", "none/a.vlscene"],
        &["scene", "map", &survey, "-o", "none/a.png"],
        &["bench", &survey, "--json", "none/a.json"],
        &["run", &survey, "--dry-run", "--coverage", "none/a.tif"],
        &logged,
    ];
    for args in commands {
        refused(dir.path(), args, "none is not a directory, so none/a");
        assert_eq!(names(dir.path()), ["a.laz"]);
    }
    fs::write(dir.path().join("a.json"), "mine").unwrap();
    refused(dir.path(), &[&shard[..], &["a.json"]].concat(), "a.json exists already");
}

#[test]
fn names_of_other_formats_are_errors_before_the_work() {
    let (dir, survey) = (folder(), room());
    succeed(dir.path(), &["run", &survey, "-q", "-o", "a.laz"]);
    let compare = ["compare", "a.laz", "a.laz"];
    let plan = ["plan", "terrestrial", "--scanner", "riegl_vz400", "--ground", "0", "--at", "0,0"];
    let commands: &[(&[&str], &[&str], &str)] = &[
        (&compare, &["--change", "b.png"], "--change b.png: expected a name that ends in .tif"),
        (&compare, &["--page", "b.pdf"], "--page b.pdf: expected a name that ends in .html"),
        (&["catalogue", "show", "vlp16"], &["--picture", "b.png"], "expected a name that ends in .svg"),
        (&["fit", "a.laz"], &["-o", "b.laz"], "-o b.laz: the file is TOML, not laz"),
        (&plan, &["-o", "b.laz"], "-o b.laz: the file is TOML, not laz"),
        (&plan, &["-o", "b.csv", "--lines", "./b.csv"], "./b.csv: two outputs have the same name"),
        (&["scene", "pack", &survey], &["-o", "b.laz"], "-o b.laz: expected a name that ends in .vlscene"),
        (&["bench", &survey], &["--json", "b.laz"], "--json b.laz: the file is JSON, not laz"),
        (&["unzip", "a.laz"], &["b.laz"], "OUT b.laz: the file is TXT, not laz"),
        (&["run", &survey], &["--output", "b.laz"], "--output b.laz: expected the name of a folder"),
        (&["run", &survey], &["--shard", "0/1", "-o", "b.laz"], "-o b.laz: expected the name of a folder"),
        (&["scene", "make", "forest"], &["-o", "b.laz"], "-o b.laz: expected the name of a folder"),
        (
            &["frames", "a.mcap"],
            &["--layout", "kitti", "-o", "b.las"],
            "-o b.las: expected the name of a folder",
        ),
    ];
    for (command, outputs, expected) in commands {
        refused(dir.path(), &[*command, *outputs].concat(), expected);
        assert_eq!(names(dir.path()), ["a.laz"]);
    }
}

#[test]
fn a_coordinate_system_that_is_lost_is_told() {
    let dir = folder();
    fs::write(dir.path().join("mine.wkt"), "LOCAL_CS[\"mine\"]").unwrap();
    let args = ["run", &room(), "-o", "a.las", "--las10", "--crs", "mine.wkt"];
    refused(dir.path(), &[&args[..], &["--strict"]].concat(), "EPSG");
    assert_eq!(names(dir.path()), ["mine.wkt"]);
    let said = text(&succeed(dir.path(), &args).stderr);
    assert!(said.contains("warning") && said.contains("EPSG"), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_device_is_blamed_by_its_name() {
    let dir = folder();
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let printed: &[&[&str]] = &[&[], &["--help"], &["run", "--help"], &["--version"], &["catalogue"]];
    let survey = room();
    let written: &[&[&str]] = &[
        &["completions", "bash"],
        &["scene", "info", &survey],
        &["pulses", &survey],
        &["trajectory", &survey],
    ];
    for args in printed.iter().chain(written) {
        let out = vlscan(dir.path()).args(*args).stdout(full()).output().unwrap();
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(1), "vlscan {}: {said}", args.join(" "));
        assert!(said.contains("standard output: No space left"), "vlscan {}: {said}", args.join(" "));
    }
    // The header is known at the end, so that the points wait in the folder for temporary files.
    let spooled = vlscan(dir.path())
        .args(["run", &survey, "-q", "-o", "-", "--format", "las"])
        .env("TMPDIR", dir.path().join("missing"))
        .output()
        .unwrap();
    let said = text(&spooled.stderr);
    assert_eq!(spooled.status.code(), Some(1), "{said}");
    assert!(
        said.contains("TMPDIR") && said.contains("missing") && !said.contains("standard output"),
        "{said}"
    );
}

/// Ends `child` with a signal, which must suffice, and returns its output.
#[cfg(unix)]
fn end(mut child: Child, signal: &str) -> Output {
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    let started = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if started.elapsed() > Duration::from_secs(30) {
            child.kill().unwrap();
            panic!("one {signal} does not end the run");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    child.stdout.take();
    child.wait_with_output().unwrap()
}

#[cfg(unix)]
fn wait_until(what: &str, mut is_true: impl FnMut() -> bool) {
    let started = Instant::now();
    while !is_true() {
        assert!(started.elapsed() < Duration::from_secs(60), "{what} does not happen");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// A run that measures without end: poses from a thread, which writes until the run ends.
#[cfg(unix)]
fn endless(dir: &Path, sinks: &[&str]) -> Child {
    let survey = fixture("forest/survey.xml").to_str().unwrap().to_owned();
    let mut child = vlscan(dir)
        .args(["run", &survey, "--trajectory", "-"])
        .args(sinks)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    std::thread::spawn(move || {
        use std::io::Write;
        let pose = |i: u64| format!("{},{},0,400,0,0,90\n", 100.0 + i as f64 * 0.005, i as f64 * 0.001);
        (0..u64::MAX).try_for_each(|i| stdin.write_all(pose(i).as_bytes()))
    });
    child
}

#[cfg(unix)]
#[test]
fn one_signal_ends_a_run_whose_reader_stands_still() {
    for signal in ["-TERM", "-INT"] {
        for stream in [&["-o", "-", "--format", "csv"][..], &["-o", "pipe", "--format", "xyz"]] {
            let dir = folder();
            assert!(Command::new("mkfifo").arg(dir.path().join("pipe")).status().unwrap().success());
            let child = endless(dir.path(), &[stream, &["-o", "a.laz"]].concat());
            // Opens the pipe and reads nothing.
            let still = (stream[1] == "pipe").then(|| fs::File::open(dir.path().join("pipe")).unwrap());
            wait_until("writing", || names(dir.path()).iter().any(|name| name.ends_with(".part")));
            std::thread::sleep(Duration::from_millis(1500));
            let out = end(child, signal);
            drop(still);
            assert_eq!(out.status.code(), Some(130), "{signal}: {}", text(&out.stderr));
            // What was measured until then is in the file.
            assert_eq!(names(dir.path()), ["a.partial.laz", "pipe"], "{signal}: {}", text(&out.stderr));
        }
    }
}

#[cfg(unix)]
#[test]
fn messages_to_a_reader_that_stands_still_do_not_keep_the_run() {
    let dir = folder();
    let (_still, pipe) = std::io::pipe().unwrap();
    let child = vlscan(dir.path())
        .args(["run", &room(), "-o", "-", "--format", "xyz"])
        .stdout(pipe.try_clone().unwrap())
        .stderr(pipe)
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(4));
    assert_eq!(end(child, "-TERM").status.code(), Some(130));
}

#[cfg(unix)]
#[test]
fn one_signal_ends_a_run_that_reads_its_survey_or_waits_for_a_reader() {
    let dir = folder();
    for name in ["survey.xml", "pipe"] {
        assert!(Command::new("mkfifo").arg(dir.path().join(name)).status().unwrap().success());
    }
    let start = |args: &[&str]| {
        vlscan(dir.path()).args(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let reading = start(&["run", "survey.xml", "-o", "a.xyz"]);
    std::thread::sleep(Duration::from_millis(500));
    let waiting = start(&["run", &room(), "-o", "a.xyz", "-o", "pipe"]);
    wait_until("writing", || names(dir.path()).iter().any(|name| name.starts_with("a.xyz.vlscan-")));
    let making = start(&["scene", "make", "forest", "-n", "50M", "-o", "forest"]);
    wait_until("making", || names(dir.path()).iter().any(|name| name.starts_with("forest/")));
    for (child, signal) in [(reading, "-TERM"), (waiting, "-INT"), (making, "-TERM")] {
        let out = end(child, signal);
        let said = text(&out.stderr);
        assert!(out.status.code() == Some(130) && said.contains("interrupted"), "{said}");
    }
    assert_eq!(names(dir.path()), ["pipe", "survey.xml"]);
    assert!(!dir.path().join("forest").exists());
}

#[cfg(unix)]
#[test]
fn the_next_run_removes_what_a_killed_one_left() {
    let dir = folder();
    let mut child = endless(dir.path(), &["-o", "a.laz", "-o", "b.csv"]);
    wait_until("writing", || names(dir.path()).len() == 2);
    // A run beside it leaves its files alone.
    succeed(dir.path(), &["run", &room(), "-q", "-o", "c.xyz"]);
    assert_eq!(names(dir.path()).len(), 3, "{:?}", names(dir.path()));
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(names(dir.path()).len(), 3, "{:?}", names(dir.path()));
    succeed(dir.path(), &["run", &room(), "-q", "-o", "a.laz"]);
    assert_eq!(names(dir.path()), ["a.laz", "c.xyz"]);
}
