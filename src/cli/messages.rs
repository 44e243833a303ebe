//! Messages in JSON: problems, progress and files as `vlscan_messages` describes them.

use clap::error::ErrorKind;
use std::ffi::OsString;
use std::path::Path;
use vlscan_base::diag::{Diagnostic, Diagnostics, ProblemKind, Severity};
use vlscan_base::error::Error;
use vlscan_base::files::means_stdout;
use vlscan_messages::{Message, ProblemClass, ProblemMessage, ProgressMessage, ProgressUnit, WrittenFile};
use vlscan_session::Snapshot;
use vlscan_session::output::{FileKind, FileSummary, PointFormat};

/// Form of messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum MessageFormat {
    /// Text for people.
    #[default]
    Text,
    /// One JSON object per line, for programs.
    Json,
}

/// Name of the stage that emits pulses or writes points.
const STAGE: &str = "computing";

/// True if these words of a command line request messages in JSON; for command lines that cannot be parsed.
pub fn request_json(words: &[OsString]) -> bool {
    let words: Vec<&OsString> = words.iter().take_while(|word| *word != "--").collect();
    let is_pair = words.windows(2).any(|pair| pair[0] == "--message-format" && pair[1] == "json");
    is_pair || words.iter().any(|word| *word == "--message-format=json")
}

/// Returns the words of a command line without the option for the form of messages.
pub fn without_format(words: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut words = words.into_iter();
    let mut kept = Vec::new();
    while let Some(word) = words.next() {
        if word == "--message-format" {
            words.next();
        } else if !word.as_encoded_bytes().starts_with(b"--message-format=") {
            kept.push(word);
        }
    }
    kept
}

/// Returns a message as a line.
pub fn line(message: &Message) -> String {
    serde_json::to_string(message).map_or_else(|_| String::new(), |text| text + "\n")
}

/// Returns the messages on problems of the input, errors first.
pub fn of_problems(found: &Diagnostics) -> Vec<Message> {
    let mut items: Vec<&Diagnostic> = found.items().iter().collect();
    items.sort_by_key(|item| item.severity);
    let message = |item: &Diagnostic| match item.severity {
        Severity::Error => Message::Error(problem(item)),
        Severity::Warning => Message::Warning(problem(item)),
        Severity::Note => Message::Note(problem(item)),
    };
    items.into_iter().map(message).collect()
}

fn problem(found: &Diagnostic) -> ProblemMessage {
    let problem = ProblemMessage {
        problem: class(found.kind),
        message: found.message.clone(),
        help: found.help.clone(),
        repeats: found.repeats as u64,
        also_in_lines: found.also_in_lines.iter().map(|line| *line as u64).collect(),
        ..ProblemMessage::default()
    };
    let Some(place) = &found.place else { return problem };
    let problem = ProblemMessage { file: Some(place.path.display().to_string()), ..problem };
    if place.line == 0 {
        return problem;
    }
    let characters = |bytes: usize| place.excerpt.get(..bytes).map_or(0, |text| text.chars().count() as u64);
    ProblemMessage {
        line: Some(place.line as u64),
        column: Some(place.column as u64),
        excerpt: Some(place.excerpt.clone()),
        marked: Some([characters(place.marked.start), characters(place.marked.end)]),
        ..problem
    }
}

fn class(kind: ProblemKind) -> ProblemClass {
    match kind {
        ProblemKind::NotFound => ProblemClass::NotFound,
        ProblemKind::Exists => ProblemClass::Exists,
        ProblemKind::TooLarge => ProblemClass::TooLarge,
        ProblemKind::NotDivisible => ProblemClass::NotDivisible,
        ProblemKind::InUse => ProblemClass::InUse,
        _ => ProblemClass::Invalid,
    }
}

/// Returns the messages on the error that ends a command, with the warnings that became errors.
pub fn of_error(error: &Error) -> Vec<Message> {
    let (problem, file) = match error {
        Error::Input(found) => return of_problems(found),
        Error::Limits(found) => return of_problems(found).into_iter().map(of_limits).collect(),
        Error::Io { path, .. } => (ProblemClass::System, Some(path.display().to_string())),
        Error::Interrupted => (ProblemClass::Interrupted, None),
        _ => (ProblemClass::Internal, None),
    };
    let message = error.to_string();
    vec![Message::Error(ProblemMessage { problem, message, file, ..ProblemMessage::default() })]
}

fn of_limits(message: Message) -> Message {
    match message {
        Message::Error(problem) => {
            Message::Error(ProblemMessage { problem: ProblemClass::Limits, ..problem })
        }
        other => other,
    }
}

/// Returns the problem of a command line, without how to use the command.
pub fn of_usage(error: &clap::Error) -> ProblemMessage {
    let problem = |message: &str, help: Option<String>| ProblemMessage {
        problem: ProblemClass::Usage,
        message: message.to_owned(),
        help,
        ..ProblemMessage::default()
    };
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return problem(
            "the command line is incomplete",
            Some("--help lists the possible subcommands and options".to_owned()),
        );
    }
    let text = error.render().to_string();
    let end = ["\n\nUsage:", "\n\nFor more information"].iter().filter_map(|end| text.find(end)).min();
    let text = text[..end.unwrap_or(text.len())].trim();
    let text = text.strip_prefix("error: ").unwrap_or(text);
    let (message, tips) = text.split_once("\n\n").unwrap_or((text, ""));
    let tips = tips.lines().map(|line| line.trim().trim_start_matches("tip: "));
    let tips: Vec<&str> = tips.filter(|tip| !tip.is_empty()).collect();
    problem(message, (!tips.is_empty()).then(|| tips.join("; ")))
}

/// Returns a warning that is not about a place in a text file.
pub fn warning(file: Option<String>, message: String) -> ProblemMessage {
    ProblemMessage { file, message, ..ProblemMessage::default() }
}

/// Returns the progress of a run with this number of legs, after `seconds`.
pub fn progress(now: &Snapshot, legs: usize, seconds: f64) -> ProgressMessage {
    let is_known = now.done.is_finite();
    let left = seconds * (1.0 - now.done).max(0.0) / now.done;
    ProgressMessage {
        stage: STAGE.to_owned(),
        done: Some(if is_known { now.done } else { now.pulses as f64 }),
        total: is_known.then_some(1.0),
        unit: Some(if is_known { ProgressUnit::Survey } else { ProgressUnit::Pulses }),
        seconds: Some(seconds),
        seconds_left: Some(left).filter(|left| left.is_finite()),
        leg: Some(u64::from(now.leg) + 1),
        legs: Some(legs as u64),
        pulses: Some(now.pulses),
        pulses_per_second: Some(now.pulses as f64 / seconds.max(1e-3)),
        points: Some(now.echoes),
        tiles_loaded: now.tiles.as_ref().map(|tiles| tiles.loaded),
    }
}

/// Returns the progress of a campaign after this number of cells.
pub fn progress_of_cells(done: u64) -> ProgressMessage {
    ProgressMessage {
        stage: "computing cells".to_owned(),
        done: Some(done as f64),
        unit: Some(ProgressUnit::Cells),
        ..ProgressMessage::default()
    }
}

/// Returns the progress at the end of a complete run or campaign.
pub fn completed(last: ProgressMessage) -> ProgressMessage {
    let total = last.total.or(last.done);
    ProgressMessage { done: total, total, seconds_left: Some(0.0), ..last }
}

/// Returns a file of the result; `content` names what it has.
pub fn written(path: &Path, content: &str) -> WrittenFile {
    let path = if means_stdout(path) { "-".to_owned() } else { path.display().to_string() };
    WrittenFile { path, content: content.to_owned(), ..WrittenFile::default() }
}

/// Returns a file of a run's result.
pub fn written_by_run(file: &FileSummary) -> WrittenFile {
    let content = match file.kind {
        FileKind::Points => "points",
        FileKind::Trajectory => "trajectory",
        FileKind::Waveforms => "waveforms",
        FileKind::Pulses => "pulses",
        FileKind::Packets => "packets",
        FileKind::Shard => "shard",
    };
    let format = file.path.as_deref().filter(|_| file.kind == FileKind::Points);
    let format = format.and_then(|path| PointFormat::required(path).ok());
    WrittenFile {
        format: format.map(|format| format.name().to_owned()),
        records: Some(file.records),
        bytes: Some(file.bytes),
        left_out: file.left_out,
        partial: file.partial,
        ..written(file.path.as_deref().unwrap_or(Path::new("-")), content)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::diag::Place;

    #[test]
    fn problems_have_place_and_help_and_errors_come_first() {
        let text = "<a>\n <b ä='7'/>\n</a>";
        let at = text.find('7').unwrap();
        let mut found = Diagnostics::default();
        let place = Place::in_text(Path::new("s.xml"), text, at..at + 1);
        found.warn(Some(place), "a doubt").help("leave it out");
        found.error(Some(Place::of_file(Path::new("t.bin"))), "damaged").of_kind(ProblemKind::TooLarge);
        let messages = of_problems(&found);
        let [Message::Error(error), Message::Warning(warning)] = messages.as_slice() else {
            panic!("{messages:?}");
        };
        assert_eq!((error.problem, error.file.as_deref()), (ProblemClass::TooLarge, Some("t.bin")));
        assert_eq!((error.line, error.marked, &error.excerpt), (None, None, &None));
        assert_eq!((warning.line, warning.column, warning.marked), (Some(2), Some(8), Some([7, 8])));
        assert_eq!(warning.excerpt.as_deref(), Some(" <b ä='7'/>"));
        assert_eq!(warning.help.as_deref(), Some("leave it out"));
        let messages = of_error(&Error::Limits(Box::new(found)));
        let [Message::Error(limits), Message::Warning(warning)] = messages.as_slice() else {
            panic!("{messages:?}");
        };
        assert_eq!((limits.problem, warning.problem), (ProblemClass::Limits, ProblemClass::Invalid));
    }

    #[test]
    fn a_wrong_command_line_becomes_a_message_and_tips() {
        let parsed =
            crate::cli::command_line().try_get_matches_from(["vlscan", "run", "s.xml", "--sed", "1"]);
        let found = of_usage(&parsed.unwrap_err());
        assert_eq!((found.problem, found.message.lines().count()), (ProblemClass::Usage, 1), "{found:?}");
        assert!(found.message.contains("'--sed'") && !found.message.starts_with("error"), "{found:?}");
        assert!(found.help.as_ref().is_some_and(|help| help.contains("'--seed'")), "{found:?}");
        let parsed = crate::cli::command_line().try_get_matches_from(["vlscan", "scene"]);
        assert!(of_usage(&parsed.unwrap_err()).help.is_some_and(|help| help.contains("--help")));
    }

    #[test]
    fn negative_numbers_are_values_of_options() {
        let refused = |line: &str| {
            let parsed = crate::cli::command_line().try_get_matches_from(line.split(' '));
            of_usage(&parsed.unwrap_err()).message
        };
        let found = refused("vlscan frames a.mcap -o out --layout kitti --intensity-factor -1");
        assert!(found.contains("'--intensity-factor <FACTOR>'") && found.contains("found -1"), "{found}");
        let found = refused("vlscan run -5");
        assert!(found.contains("unexpected argument '-5'"), "{found}");
    }

    #[test]
    fn json_is_requested_before_the_words_of_another_command_line() {
        let is_requested =
            |line: &str| request_json(&line.split(' ').map(OsString::from).collect::<Vec<_>>());
        for line in ["vlscan run s.xml --message-format json", "vlscan --message-format=json run"] {
            assert!(is_requested(line), "{line}");
        }
        for line in
            ["vlscan run json", "vlscan bench s.xml -- --message-format json", "a --message-format xml"]
        {
            assert!(!is_requested(line), "{line}");
        }
    }

    #[test]
    fn a_command_line_is_repeated_without_the_form_of_its_messages() {
        let kept = |line: &str| {
            let words = without_format(line.split(' ').map(OsString::from));
            words.iter().map(|word| word.to_str().unwrap().to_owned()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(kept("--message-format=json plan mobile --speed 8"), "plan mobile --speed 8");
        assert_eq!(kept("plan --message-format json mobile"), "plan mobile");
        assert_eq!(kept("plan mobile"), "plan mobile");
    }

    #[test]
    fn complete_progress_ends_at_its_total() {
        let mut now = Snapshot { pulses: 500, echoes: 7, leg: 1, done: 0.25, tiles: None };
        let found = progress(&now, 3, 2.0);
        assert_eq!((found.done, found.total, found.seconds_left), (Some(0.25), Some(1.0), Some(6.0)));
        assert_eq!((found.leg, found.legs, found.pulses_per_second), (Some(2), Some(3), Some(250.0)));
        assert_eq!(completed(found).fraction(), Some(1.0));
        now.done = f64::NAN;
        let stream = progress(&now, 1, 2.0);
        assert_eq!((stream.done, stream.total, stream.seconds_left), (Some(500.0), None, None));
        assert_eq!(completed(stream).total, Some(500.0));
    }
}
