//! Messages in JSON: every line of stderr is an object, with places, progress and results.

use crate::common::{feed, fixture, folder, run, succeed, text};
use std::fs;
use std::path::Path;
use std::process::Output;
use vlscan_messages::{Message, ProblemClass, ProblemMessage, ProgressMessage, ResultMessage, VERSION};

const JSON: &str = "--message-format=json";

fn room() -> String {
    fixture("room/survey.xml").to_str().unwrap().to_owned()
}

/// The messages of a command, which begin with their version.
fn messages(output: &Output) -> Vec<Message> {
    let said = text(&output.stderr);
    let parsed =
        said.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}")));
    let all: Vec<Message> = parsed.collect();
    assert!(!all.contains(&Message::Unknown), "{said}");
    let starts: Vec<usize> = (0..all.len()).filter(|i| matches!(all[*i], Message::Start(_))).collect();
    assert!(all.is_empty() || starts == [0], "{said}");
    if let Some(Message::Start(start)) = all.first() {
        assert_eq!((start.version, start.program.as_str()), (VERSION, env!("CARGO_PKG_VERSION")));
    }
    all
}

/// The result, which is the last message.
fn result(messages: &[Message]) -> &ResultMessage {
    let Some(Message::Result(result)) = messages.last() else { panic!("no result: {messages:?}") };
    result
}

fn errors(messages: &[Message]) -> Vec<&ProblemMessage> {
    let all = messages.iter().filter_map(|message| match message {
        Message::Error(error) => Some(error),
        _ => None,
    });
    all.collect()
}

fn progress(messages: &[Message]) -> Vec<&ProgressMessage> {
    let all = messages.iter().filter_map(|message| match message {
        Message::Progress(progress) => Some(progress),
        _ => None,
    });
    all.collect()
}

/// The room with a misspelt attribute, in `survey.xml`.
fn misspelt(folder: &Path) {
    for entry in fs::read_dir(fixture("room")).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, folder.join(path.file_name().unwrap())).unwrap();
    }
    let survey = fs::read_to_string(fixture("room/survey.xml")).unwrap();
    fs::write(folder.join("survey.xml"), survey.replacen("pulseFreq_hz", "pulseFreq_Hz", 1)).unwrap();
}

#[test]
fn a_run_tells_its_stages_its_progress_and_its_files() {
    let dir = folder();
    let out = succeed(dir.path(), &["run", &room(), "-o", "a.laz", "--message-format", "json"]);
    assert!(out.stdout.is_empty());
    let messages = messages(&out);
    let Some(Message::Start(start)) = messages.first() else { panic!("{messages:?}") };
    assert_eq!(start.command, "run");
    let progress = progress(&messages);
    assert!(progress.iter().any(|progress| progress.stage == "building the tree"), "{progress:?}");
    let last = progress.last().unwrap();
    assert_eq!((last.done, last.total, last.fraction()), (Some(1.0), Some(1.0), Some(1.0)));
    let result = result(&messages);
    assert_eq!((result.legs, last.legs, last.pulses), (Some(2), Some(2), result.pulses));
    assert!(result.pulses.is_some_and(|pulses| pulses > 30_000), "{result:?}");
    let [file] = result.files.as_slice() else { panic!("{result:?}") };
    let bytes = fs::read(dir.path().join("a.laz")).unwrap();
    assert_eq!(
        (file.path.as_str(), file.content.as_str(), file.format.as_deref()),
        ("a.laz", "points", Some("laz"))
    );
    assert_eq!((file.bytes, file.records, file.partial), (Some(bytes.len() as u64), result.points, false));
    // Only the messages differ.
    succeed(dir.path(), &["run", &room(), "-o", "b.laz", "-q"]);
    assert!(fs::read(dir.path().join("b.laz")).unwrap() == bytes);
}

#[test]
fn stdout_is_that_of_a_run_with_text() {
    let dir = folder();
    let room = room();
    let rest = ["run", room.as_str(), "-o", "-", "--format", "xyz"];
    let as_json = succeed(dir.path(), &[&[JSON][..], &rest].concat());
    assert!(as_json.stdout == succeed(dir.path(), &rest).stdout && as_json.stdout.len() > 10_000);
    let messages = messages(&as_json);
    assert_eq!(result(&messages).files[0].path, "-");
    // A plan begins with its command.
    let scene = fixture("terrain/scene.xml").to_str().unwrap().to_owned();
    let area = "POLYGON ((-20 -20, 20 -20, 20 20, -20 20))";
    let plan = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--height", "60", "--density", "4"];
    let plan = [&plan[..], &["--scene", &scene, "--area", area]].concat();
    let as_json = succeed(dir.path(), &[&[JSON][..], &plan].concat()).stdout;
    assert!(as_json == succeed(dir.path(), &plan).stdout && as_json.starts_with(b"# vlscan plan airborne "));
}

#[test]
fn warnings_have_their_place_and_help() {
    let dir = folder();
    misspelt(dir.path());
    let found = messages(&succeed(dir.path(), &["run", "survey.xml", "-o", "a.xyz", JSON]));
    let of = |message: &Message| match message {
        Message::Warning(warning) if warning.message.contains("`pulseFreq_Hz`") => Some(warning.clone()),
        _ => None,
    };
    let warning = found.iter().find_map(of).unwrap_or_else(|| panic!("{found:?}"));
    assert!(warning.file.as_ref().is_some_and(|file| file.ends_with("survey.xml")), "{warning:?}");
    assert!(warning.line == Some(4) && warning.help.is_some_and(|help| help.contains("pulseFreq_hz")));
    let (excerpt, [start, end]) = (warning.excerpt.unwrap(), warning.marked.unwrap());
    let marked: String = excerpt.chars().skip(start as usize).take((end - start) as usize).collect();
    assert_eq!((marked.as_str(), warning.column), ("pulseFreq_Hz", Some(start + 1)));
    // With --strict it is the error that ends the run, without a result.
    let out = run(dir.path(), &["run", "survey.xml", "-o", "b.xyz", "--strict", JSON]);
    let found = messages(&out);
    assert_eq!(out.status.code(), Some(2));
    assert!(errors(&found).iter().any(|error| error.message == warning.message && error.line == Some(4)));
    assert!(!found.iter().any(|message| matches!(message, Message::Result(_))), "{found:?}");
}

#[test]
fn a_damaged_survey_is_an_error_with_its_place() {
    let dir = folder();
    let survey = fs::read_to_string(fixture("room/survey.xml")).unwrap();
    let broken = survey.replace("<leg", "<leg>\n<oops").replacen("</survey>", "", 1);
    fs::write(dir.path().join("broken.xml"), broken).unwrap();
    let out = run(dir.path(), &["run", "broken.xml", JSON]);
    assert_eq!(out.status.code(), Some(2));
    let found = messages(&out);
    let error = errors(&found)[0];
    assert!(error.file.as_ref().is_some_and(|file| file.ends_with("broken.xml")), "{error:?}");
    assert!(error.line.is_some_and(|line| line > 1) && error.column.is_some(), "{error:?}");
}

#[test]
fn problems_have_their_class() {
    let dir = folder();
    fs::write(dir.path().join("a.png"), "mine").unwrap();
    for (args, class) in [
        (&["unzip", "missing.bin", "a.xyz"][..], ProblemClass::NotFound),
        (&["preview", "missing.laz", "-o", "a.png"], ProblemClass::Exists),
        (&["run", "--sed", "1"], ProblemClass::Usage),
        (&["runn"], ProblemClass::Usage),
        (&["scene"], ProblemClass::Usage),
    ] {
        let out = run(dir.path(), &[&[JSON][..], args].concat());
        assert_eq!(out.status.code(), Some(2), "{args:?}");
        let found = messages(&out);
        let errors = errors(&found);
        let [error] = errors.as_slice() else { panic!("{args:?}: {found:?}") };
        assert_eq!(error.problem, class, "{args:?}: {error:?}");
        assert!(!error.message.contains("Usage:") && !error.message.starts_with("error"), "{error:?}");
    }
    let wrong = run(dir.path(), &["run", "--message-format", "xml"]);
    assert!(text(&wrong.stderr).contains("possible values"), "{}", text(&wrong.stderr));
}

#[test]
fn quiet_commands_write_errors_only() {
    let dir = folder();
    misspelt(dir.path());
    let out = succeed(dir.path(), &["run", "survey.xml", "-o", "a.xyz", "-q", JSON]);
    assert!(out.stderr.is_empty(), "{}", text(&out.stderr));
    let found = messages(&run(dir.path(), &["run", "survey.xml", "-o", "a.xyz", "-q", JSON]));
    assert!(matches!(&found[..], [Message::Start(_), Message::Error(_)]), "{found:?}");
    let silent = run(dir.path(), &["run", "survey.xml", "-o", "a.xyz", "--silent", JSON]);
    assert!(silent.status.code() == Some(2) && silent.stderr.is_empty(), "{silent:?}");
}

#[test]
fn every_command_ends_with_its_files() {
    let dir = folder();
    for (args, files) in [
        (&["scene", "make", "forest", "-n", "2k", "-o", "forest"][..], &["forest", "forest/survey.xml"][..]),
        (&["scene", "info", "forest/survey.xml"], &[]),
        (&["scene", "pack", "forest/survey.xml", "-o", "f.vlscene"], &["f.vlscene"]),
        (&["run", "forest/survey.xml", "--dry-run"], &[]),
        (&["run", "forest/survey.xml", "-o", "f.laz", "-v"], &["f.laz"]),
        (&["trajectory", "forest/survey.xml"], &["-"]),
        (&["pulses", "forest/survey.xml"], &["-"]),
        (&["info", "f.laz"], &[]),
        (&["preview", "f.laz", "-o", "f.html"], &["f.html"]),
        (&["catalogue"], &[]),
    ] {
        let found = messages(&succeed(dir.path(), &[args, &[JSON]].concat()));
        let written: Vec<String> =
            result(&found).files.iter().map(|file| file.path.replace('\\', "/")).collect();
        assert_eq!(written, files, "{args:?}");
    }
}

#[test]
fn progress_of_a_stream_ends_at_the_number_of_its_pulses() {
    let dir = folder();
    let pulses = succeed(dir.path(), &["pulses", &room(), "-q"]).stdout;
    let out = feed(dir.path(), &["trace", "--scanner", &room(), "-o", "a.laz", JSON], &pulses);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let messages = messages(&out);
    let last = *progress(&messages).last().unwrap();
    assert_eq!((last.fraction(), last.pulses), (Some(1.0), result(&messages).pulses));
}
