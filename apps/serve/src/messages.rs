//! Messages of a process of vlscan, which it writes as lines of JSON to its log: progress, warnings, and why
//! it failed.
//!
//! Lines of other form are taken as text: they come from the step that confines the process, and from the
//! loader of the system. A process that a hostile file has taken over may write anything, of any length.

use crate::terms::Terms;
use std::fs::File;
use std::io::{BufRead as _, BufReader, Read, Seek as _, SeekFrom};
use std::path::Path;
use vlscan_messages::{InfoTopic, Message, ProblemMessage, ProgressMessage};

/// Maximum size of the messages that are kept of a job, and read, bytes.
pub(crate) const MAX_LOG: u64 = 1 << 20;
/// Maximum size of the end of a log in which errors are looked for, and progress, bytes.
const MAX_END: u64 = 256 << 10;
const MAX_LAST: u64 = 8 << 10;
/// Longest message of a job, bytes.
const MAX_MESSAGE: usize = 8 << 10;

/// Beginning of a message in JSON.
const START: &[u8] = b"{\"kind\":";

/// Messages of a successful process.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Said {
    /// Warnings, notes and information as text.
    pub text: String,
    /// The warnings in the text.
    pub warnings: Vec<ProblemMessage>,
}

/// A line of a log.
enum Line {
    Message(Message),
    Text(String),
}

impl Line {
    fn of(bytes: &[u8]) -> Line {
        match serde_json::from_slice(bytes) {
            Ok(message) => Line::Message(message),
            // A line that was cut off: by the limit of a log, a full disk or the end of the process.
            Err(error) if error.is_eof() && bytes.starts_with(START) => Line::Message(Message::Unknown),
            Err(_) => Line::Text(String::from_utf8_lossy(bytes).into_owned()),
        }
    }
}

/// Messages in a log in these terms, which `visible` changes to what the owner of the job sees; of the first
/// [`MAX_LOG`] bytes: warnings come first, and the progress of hours may follow them.
pub(crate) fn said(log: impl Read, terms: Terms, visible: impl Fn(&str) -> String) -> Said {
    let mut log = BufReader::new(log.take(MAX_LOG));
    let mut said = Said::default();
    let mut text = Limited::default();
    for line in log.by_ref().split(b'\n').map_while(std::io::Result::ok) {
        match Line::of(&line) {
            Line::Message(Message::Warning(warning)) => {
                let warning = seen(warning, terms, &visible);
                if text.add(&text_of("warning", &warning)) {
                    said.warnings.push(warning);
                }
            }
            Line::Message(Message::Note(note)) => {
                text.add(&text_of("note", &seen(note, terms, &visible)));
            }
            // The results list the files.
            Line::Message(Message::Info(info)) if info.topic != InfoTopic::File => {
                text.add(&visible(&terms.message(&info.message)));
            }
            Line::Message(_) => {}
            Line::Text(line) => {
                text.add(&visible(&line));
            }
        }
    }
    said.text = text.finish();
    if log.get_ref().limit() == 0 {
        said.text += &format!("\n… (only the first {MAX_LOG} bytes of the messages are read)");
    }
    said
}

/// The message of vlscan on its failure in these terms, or else the text in its log; empty if there is none.
pub(crate) fn failure(log: &Path, terms: Terms, visible: impl Fn(&str) -> String) -> String {
    let (mut errors, mut others) = (Limited::default(), Limited::default());
    for line in last_lines(log, MAX_END) {
        match line {
            Line::Message(Message::Error(error)) => {
                errors.add(&text_of("error", &seen(error, terms, &visible)))
            }
            Line::Message(_) => false,
            Line::Text(line) => others.add(&visible(&line)),
        };
    }
    let errors = errors.finish();
    if errors.is_empty() { others.finish() } else { errors }
}

/// The percentage of the last progress in a log, and the progress in words.
pub(crate) fn progress_of(log: &Path) -> (u8, String) {
    let progress = last_lines(log, MAX_LAST).into_iter().rev().find_map(|line| match line {
        Line::Message(Message::Progress(progress)) => Some(progress),
        _ => None,
    });
    let Some(progress) = progress else { return (0, String::new()) };
    let percent = progress.fraction().unwrap_or(0.0) * 100.0;
    (percent.clamp(0.0, 99.0) as u8, in_words(&progress))
}

/// Progress in words: `20.7 %, leg 1 of 4, 2.58 M pulses (1.29 M/s), 1.80 M points, 8 s left`.
fn in_words(progress: &ProgressMessage) -> String {
    let Some(pulses) = progress.pulses else {
        // Of a campaign the number of cells is known.
        let done = progress.done.map(|done| format!(": {done:.0}"));
        return format!("{}{}", progress.stage, done.unwrap_or_default());
    };
    let percent = progress.fraction().map(|fraction| format!("{:.1} %", fraction * 100.0));
    let leg = progress.leg.zip(progress.legs).filter(|(_, legs)| *legs > 1);
    let leg = leg.map(|(leg, legs)| format!("leg {leg} of {legs}"));
    let rate = progress.pulses_per_second.map_or(String::new(), |rate| format!(" ({}/s)", rounded(rate)));
    let pulses = Some(format!("{} pulses{rate}", rounded(pulses as f64)));
    let points = progress.points.map(|points| format!("{} points", rounded(points as f64)));
    let left = progress.seconds_left.map(|seconds| format!("{} left", time_in_words(seconds)));
    [percent, leg, pulses, points, left].into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// A time with its unit.
pub(crate) fn time_in_words(seconds: f64) -> String {
    match seconds {
        seconds if seconds < 100.0 => format!("{seconds:.0} s"),
        seconds if seconds < 6000.0 => format!("{:.0} min", seconds / 60.0),
        seconds => format!("{:.1} h", seconds / 3600.0),
    }
}

/// A number with three digits, in thousands, millions or billions.
pub(crate) fn rounded(number: f64) -> String {
    let (scaled, unit) = match number.abs() {
        size if size >= 1e9 => (number / 1e9, " G"),
        size if size >= 1e6 => (number / 1e6, " M"),
        size if size >= 1e4 => (number / 1e3, " k"),
        _ => (number, ""),
    };
    match scaled.abs() {
        size if size >= 100.0 => format!("{scaled:.0}{unit}"),
        size if size >= 10.0 => format!("{scaled:.1}{unit}"),
        _ => format!("{scaled:.2}{unit}"),
    }
}

/// A problem as the owner of the job sees it.
fn seen(problem: ProblemMessage, terms: Terms, visible: &impl Fn(&str) -> String) -> ProblemMessage {
    let text = |text: Option<String>| text.map(|text| visible(&text));
    ProblemMessage {
        message: visible(&terms.message(&problem.message)),
        file: text(problem.file),
        excerpt: text(problem.excerpt),
        help: text(problem.help.and_then(|help| terms.help(&help))),
        ..problem
    }
}

/// The place of a problem: `s.xml:2:7`; empty if there is none.
pub(crate) fn place_of(problem: &ProblemMessage) -> String {
    let Some(file) = &problem.file else { return String::new() };
    let numbers = [problem.line, problem.column].into_iter().flatten();
    numbers.fold(file.clone(), |text, number| format!("{text}:{number}"))
}

/// A problem in lines: what is wrong, its place with the marked line, what helps.
fn text_of(severity: &str, problem: &ProblemMessage) -> String {
    let mut text = format!("{severity}: {}", problem.message);
    if problem.file.is_some() {
        text += &format!("\n --> {}", place_of(problem));
    }
    if let (Some(excerpt), Some(line)) = (&problem.excerpt, problem.line) {
        let line = line.to_string();
        let margin = " ".repeat(line.len());
        let excerpt = excerpt.replace(char::is_control, " ");
        let length = excerpt.chars().count();
        let [start, end] = problem.marked.unwrap_or_default().map(|at| usize::try_from(at).unwrap_or(length));
        let start = start.min(length);
        let marks = end.min(length).saturating_sub(start).max(1);
        let mark = " ".repeat(start) + &"^".repeat(marks);
        text += &format!("\n{margin} |\n{line} | {excerpt}\n{margin} | {mark}");
    }
    match problem.also_in_lines.as_slice() {
        [] if problem.repeats > 0 => text += &format!("\nnote: {} times more", problem.repeats),
        [] => {}
        lines => {
            let lines: Vec<String> = lines.iter().map(u64::to_string).collect();
            text += &format!("\nnote: also in line {}", lines.join(", "));
        }
    }
    if let Some(help) = &problem.help {
        text += &format!("\nhelp: {help}");
    }
    text
}

/// Lines up to a limit, and the number of those behind it.
#[derive(Default)]
struct Limited {
    text: String,
    omitted: usize,
}

impl Limited {
    /// Adds lines. Returns true if they are within the limit.
    fn add(&mut self, text: &str) -> bool {
        let fits = self.omitted == 0 && self.text.len() + text.len() < MAX_MESSAGE;
        if fits {
            self.text += text;
            self.text.push('\n');
        } else {
            self.omitted += text.lines().count().max(1);
        }
        fits
    }

    fn finish(self) -> String {
        match self.omitted {
            0 => self.text.trim().to_owned(),
            omitted => format!("{}\n… and {omitted} more lines", self.text.trim()).trim().to_owned(),
        }
    }
}

/// The lines in the last `most` bytes of a log, whole ones only.
fn last_lines(log: &Path, most: u64) -> Vec<Line> {
    let read = || -> std::io::Result<Vec<u8>> {
        let mut file = File::open(log)?;
        let start = file.metadata()?.len().saturating_sub(most);
        file.seek(SeekFrom::Start(start))?;
        let mut bytes = Vec::new();
        file.take(most).read_to_end(&mut bytes)?;
        if start > 0 {
            let first = bytes.iter().position(|byte| *byte == b'\n').map_or(bytes.len(), |at| at + 1);
            bytes.drain(..first);
        }
        Ok(bytes)
    };
    let bytes = read().unwrap_or_default();
    bytes.split(|byte| *byte == b'\n').filter(|line| !line.is_empty()).map(Line::of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WARNING: &str = r#"{"kind":"warning","problem":"invalid","message":"leg 2 has no pulses","file":"../in/s.xml","line":2}"#;
    const PROGRESS: &str = r#"{"kind":"progress","stage":"computing","done":0.207,"total":1.0,"unit":"survey","leg":1,"legs":4,"pulses":2580000,"pulses_per_second":1290000.0,"points":1800000,"seconds_left":7.65}"#;

    fn plain(text: &str) -> String {
        text.replace("../in/", "")
    }

    fn log_of(text: &str) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        file
    }

    #[test]
    fn warnings_are_kept_whatever_follows_them() {
        let file = r#"{"kind":"info","topic":"file","message":"../out/a.laz  2 points, 9 bytes"}"#;
        let end = r#"{"kind":"info","topic":"timing","message":"10 pulses in 1 s"}"#;
        let progress = format!("{PROGRESS}\n").repeat(3000);
        let start = r#"{"kind":"start","version":1,"program":"0.1.0","command":"run"}"#;
        let log = format!("{start}\n{WARNING}\n{progress}{file}\n{end}\n");
        let found = said(log.as_bytes(), Terms::Options, plain);
        assert_eq!(found.text, "warning: leg 2 has no pulses\n --> s.xml:2\n10 pulses in 1 s");
        assert_eq!(found.warnings.len(), 1);
        assert_eq!((found.warnings[0].file.as_deref(), found.warnings[0].line), (Some("s.xml"), Some(2)));
        let long =
            said(format!("{WARNING}\n{}", "x\n".repeat(10_000)).as_bytes(), Terms::Options, plain).text;
        assert!(long.starts_with("warning: leg 2") && long.ends_with(" more lines"), "{long}");
        assert!(long.len() < MAX_MESSAGE + 40);
        assert_eq!(said(&b"a \xff b\nc"[..], Terms::Options, plain).text, "a \u{fffd} b\nc");
    }

    #[test]
    fn a_line_without_end_is_not_read_to_its_end() {
        let said =
            said(WARNING.as_bytes().chain(&b"\n"[..]).chain(std::io::repeat(b'x')), Terms::Options, plain)
                .text;
        assert!(said.starts_with("warning: leg 2") && said.contains("… and 1 more lines"), "{said}");
        assert!(said.ends_with("the first 1048576 bytes of the messages are read)"), "{said}");
    }

    #[test]
    fn messages_that_were_cut_off_are_not_shown_as_text() {
        let half = &PROGRESS[..PROGRESS.len() / 2];
        assert_eq!(failure(log_of(&format!("{WARNING}\n{half}")).path(), Terms::Options, plain), "");
        let progress = format!("{PROGRESS}\n").repeat(MAX_LOG as usize / PROGRESS.len() + 1);
        let found = said(format!("{WARNING}\n{progress}").as_bytes(), Terms::Options, plain).text;
        assert!(found.starts_with("warning: leg 2") && !found.contains("kind"), "{found}");
        let other =
            said(&b"{\"kind\":\"weather\",\"sun\":true}\n{\"sun\": tr\n"[..], Terms::Options, plain).text;
        assert_eq!(other, "{\"sun\": tr", "kinds of later versions are left out, other text is not");
    }

    #[test]
    fn the_last_progress_counts() {
        let log = log_of(&format!("{}{PROGRESS}\n{{\"kind\":\"progr", format!("{PROGRESS}\n").repeat(200)));
        let expected = "20.7 %, leg 1 of 4, 2.58 M pulses (1.29 M/s), 1.80 M points, 8 s left";
        assert_eq!(progress_of(log.path()), (20, expected.to_owned()));
        let begun = log_of("{\"kind\":\"progress\",\"stage\":\"building the tree\"}\n");
        assert_eq!(progress_of(begun.path()), (0, "building the tree".to_owned()));
        let cells =
            log_of("{\"kind\":\"progress\",\"stage\":\"computing cells\",\"done\":7.0,\"unit\":\"cells\"}\n");
        assert_eq!(progress_of(cells.path()), (0, "computing cells: 7".to_owned()));
        assert_eq!(progress_of(Path::new("/absent/log")), (0, String::new()));
        let absurd = r#"{"kind":"progress","stage":"s","done":1e300,"total":1e-300,"pulses":1}"#;
        assert_eq!(progress_of(log_of(absurd).path()).0, 99);
    }

    #[test]
    fn a_failure_is_told_with_its_place() {
        let error = r#"{"kind":"error","problem":"invalid","message":"unknown key","file":"../in/job.toml","line":12,"column":3,"excerpt":"a\tä = 1","marked":[2,3],"help":"write b","repeats":2,"also_in_lines":[14,15]}"#;
        let expected = "error: unknown key\n --> job.toml:12:3\n   |\n12 | a ä = 1\n   |   ^\nnote: also in line 14, 15\nhelp: write b";
        assert_eq!(failure(log_of(&format!("{WARNING}\n{error}\n")).path(), Terms::Options, plain), expected);
        let option = r#"{"kind":"error","problem":"usage","message":"'--height <M>'","help":"see --resume"}"#;
        assert_eq!(failure(log_of(option).path(), Terms::Inputs, plain), "error: `height`");
        let confined = log_of("error: this system has no Landlock\n");
        assert_eq!(failure(confined.path(), Terms::Options, plain), "error: this system has no Landlock");
        assert_eq!(failure(log_of(WARNING).path(), Terms::Options, plain), "");
    }

    #[test]
    fn absurd_marks_take_no_memory() {
        let error = r#"{"kind":"error","problem":"x","message":"m","file":"f","line":18446744073709551615,"excerpt":"ab","marked":[18446744073709551615,3]}"#;
        let text = failure(log_of(error).path(), Terms::Options, plain);
        assert!(
            text.starts_with("error: m\n --> f:18446744073709551615\n") && text.ends_with("|   ^"),
            "{text}"
        );
    }

    #[test]
    fn numbers_have_three_digits() {
        for (number, text) in [
            (0.5, "0.50"),
            (12.34, "12.3"),
            (9999.0, "9999"),
            (12_345.0, "12.3 k"),
            (3.5e6, "3.50 M"),
            (2e9, "2.00 G"),
        ] {
            assert_eq!(rounded(number), text);
        }
        assert_eq!([5.4, 500.0, 9000.0].map(time_in_words), ["5 s", "8 min", "2.5 h"]);
    }
}
