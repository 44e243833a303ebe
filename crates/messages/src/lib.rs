//! Messages of vlscan for programs, as `vlscan --message-format json` writes them to stderr: one JSON object
//! per line, whose member `kind` names the variant of [`Message`].
//!
//! ```
//! use vlscan_messages::Message;
//!
//! let line = r#"{"kind":"warning","problem":"invalid","message":"unknown <b>","file":"s.xml","line":2}"#;
//! let Message::Warning(warning) = serde_json::from_str(line)? else { panic!("not a warning") };
//! assert_eq!((warning.file.as_deref(), warning.line), (Some("s.xml"), Some(2)));
//! # Ok::<(), serde_json::Error>(())
//! ```
//!
//! Within a [`VERSION`] members and kinds are only added. Readers ignore unknown members; unknown kinds
//! become [`Message::Unknown`].
//!
//! [`nearest`] finds the name that a message suggests in place of a misspelt one.

#![deny(unsafe_code)]

mod names;

pub use names::nearest;

use serde::{Deserialize, Serialize};

/// Version of the messages, which the first line contains.
pub const VERSION: u32 = 1;

/// A line of messages.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
#[non_exhaustive]
pub enum Message {
    /// First line: version and command.
    Start(StartMessage),
    /// Progress of a stage.
    Progress(ProgressMessage),
    /// A problem that ends the command.
    Error(ProblemMessage),
    /// A suspicious input, or one that is not used as written.
    Warning(ProblemMessage),
    /// How an input was understood.
    Note(ProblemMessage),
    /// Information in one or several lines of text.
    Info(InfoMessage),
    /// Files and figures of a command, at its end.
    Result(ResultMessage),
    /// A kind of a later version.
    #[serde(other)]
    Unknown,
}

/// First line of messages.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StartMessage {
    /// Version of the messages.
    pub version: u32,
    /// Version of the program: `0.1.0`.
    pub program: String,
    /// Name of the command: `run`, `scene make`; empty if the command line is invalid.
    pub command: String,
}

/// Progress of a stage.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProgressMessage {
    /// Name of the stage: `building the tree`, `measuring`.
    pub stage: String,
    /// Amount that is done; none at the beginning of a stage of unknown length.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub done: Option<f64>,
    /// Amount at the end of the stage; none if the end is unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub total: Option<f64>,
    /// Unit of `done` and `total`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<ProgressUnit>,
    /// Time since the beginning of the stage, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Estimated time to the end of the stage, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds_left: Option<f64>,
    /// Number of the current leg, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub leg: Option<u64>,
    /// Number of legs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub legs: Option<u64>,
    /// Pulses emitted and written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulses: Option<u64>,
    /// Mean rate of pulses, 1/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulses_per_second: Option<f64>,
    /// Points written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points: Option<u64>,
    /// Tiles of the scene loaded so far.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tiles_loaded: Option<u64>,
}

impl ProgressMessage {
    /// Done part of the stage, from 0 to 1; none if the end is unknown.
    pub fn fraction(&self) -> Option<f64> {
        let (done, total) = (self.done?, self.total?);
        let fraction = done / total;
        // A stage without work is done.
        Some(if fraction.is_finite() { fraction.clamp(0.0, 1.0) } else { 1.0 })
    }
}

/// Unit of progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ProgressUnit {
    /// Parts of the survey: its end is 1.
    Survey,
    /// Pulses of a stream.
    Pulses,
    /// Cells of a campaign.
    Cells,
    /// A unit of a later version.
    #[serde(other)]
    Unknown,
}

/// A problem, with its place in a file if it has one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProblemMessage {
    /// Class of the problem.
    pub problem: ProblemClass,
    /// The problem and the expected input.
    pub message: String,
    /// The file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Line of the file, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// Column of the first marked character, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<u64>,
    /// Text of the line; of long lines the part around the mark.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub excerpt: Option<String>,
    /// Marked characters of the excerpt, from 0: the first one, and the one behind the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub marked: Option<[u64; 2]>,
    /// Hint how to solve the problem.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub help: Option<String>,
    /// Number of further occurrences in the file.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub repeats: u64,
    /// Lines of the first further occurrences.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub also_in_lines: Vec<u64>,
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// Class of a problem.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ProblemClass {
    /// A value, a file or a combination of them that is not valid.
    #[default]
    Invalid,
    /// A file that does not exist.
    NotFound,
    /// An output that exists and is not to be replaced.
    Exists,
    /// Input that needs more memory than the limit allows.
    TooLarge,
    /// A run that cannot be divided into shards, or not continued with the shards that exist.
    NotDivisible,
    /// A folder in which another process works.
    InUse,
    /// A scan frequency outside the scanner's limits, or contradictory trajectory settings.
    Limits,
    /// An invalid command line.
    Usage,
    /// A failed operation of the system: a file could not be read or written, the disk is full.
    System,
    /// Ended by the user.
    Interrupted,
    /// A fault of the program.
    Internal,
    /// A class of a later version.
    #[serde(other)]
    Unknown,
}

/// Information in text.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InfoMessage {
    /// Topic of the information.
    pub topic: InfoTopic,
    /// The text.
    pub message: String,
}

/// Topic of information.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum InfoTopic {
    /// For every user.
    #[default]
    General,
    /// Details, with `--verbose`.
    Detail,
    /// Duration of a step.
    Timing,
    /// A file was written, which the result lists, too.
    File,
    /// A topic of a later version.
    #[serde(other)]
    Unknown,
}

/// Files and figures of a command. Members that the command does not have are left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ResultMessage {
    /// The files that were written.
    pub files: Vec<WrittenFile>,
    /// Number of legs of the survey.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub legs: Option<u64>,
    /// Pulses emitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulses: Option<u64>,
    /// Points measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points: Option<u64>,
    /// Time of the measurement, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Time of the command with loading, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub total_seconds: Option<f64>,
}

/// A file or folder that was written.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WrittenFile {
    /// Its path; `-` for stdout.
    pub path: String,
    /// Its content: `points`, `trajectory`, `raster`, `plan`.
    pub content: String,
    /// Format of points, as `--format` names it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// Number of points, poses, waveforms, pulses or lines.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub records: Option<u64>,
    /// Size, bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Points left out, which the format cannot represent.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub left_out: u64,
    /// True if the command ended before the file was complete.
    #[serde(default, skip_serializing_if = "is_false")]
    pub partial: bool,
}

fn is_false(flag: &bool) -> bool {
    !*flag
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(message: &Message) -> String {
        serde_json::to_string(message).unwrap()
    }

    #[test]
    fn every_message_is_read_as_it_was_written() {
        let problem = ProblemMessage {
            problem: ProblemClass::NotFound,
            message: "m\nn".to_owned(),
            file: Some("s.xml".to_owned()),
            line: Some(2),
            column: Some(3),
            excerpt: Some("<a b='ä'>".to_owned()),
            marked: Some([6, 7]),
            help: Some("h".to_owned()),
            repeats: 2,
            also_in_lines: vec![4, 5],
        };
        let file = WrittenFile {
            path: "-".to_owned(),
            content: "points".to_owned(),
            partial: true,
            ..WrittenFile::default()
        };
        let progress = ProgressMessage {
            stage: "measuring".to_owned(),
            done: Some(0.25),
            total: Some(1.0),
            unit: Some(ProgressUnit::Survey),
            ..ProgressMessage::default()
        };
        for message in [
            Message::Start(StartMessage { version: VERSION, ..StartMessage::default() }),
            Message::Progress(progress),
            Message::Error(problem.clone()),
            Message::Warning(problem.clone()),
            Message::Note(problem),
            Message::Info(InfoMessage { topic: InfoTopic::Timing, message: "t".to_owned() }),
            Message::Result(ResultMessage { files: vec![file], pulses: Some(7), ..ResultMessage::default() }),
        ] {
            let line = line(&message);
            assert!(!line.contains('\n'), "{line}");
            assert_eq!(serde_json::from_str::<Message>(&line).unwrap(), message);
        }
    }

    #[test]
    fn members_without_a_value_are_left_out() {
        let problem = ProblemMessage { message: "m".to_owned(), ..ProblemMessage::default() };
        let expected = r#"{"kind":"error","problem":"invalid","message":"m"}"#;
        assert_eq!(line(&Message::Error(problem)), expected);
        assert_eq!(line(&Message::Result(ResultMessage::default())), r#"{"kind":"result","files":[]}"#);
    }

    #[test]
    fn additions_of_later_versions_do_not_stop_a_reader() {
        let read = |text: &str| serde_json::from_str::<Message>(text).unwrap();
        assert_eq!(read(r#"{"kind":"weather","sun":true}"#), Message::Unknown);
        let Message::Error(error) = read(r#"{"kind":"error","problem":"flood","message":"m","new":1}"#)
        else {
            panic!("not an error");
        };
        assert_eq!((error.problem, error.message.as_str()), (ProblemClass::Unknown, "m"));
    }

    #[test]
    fn a_stage_without_work_is_done() {
        let of = |done, total| ProgressMessage { done, total, ..ProgressMessage::default() }.fraction();
        assert_eq!(of(Some(1.0), Some(4.0)), Some(0.25));
        assert_eq!(of(Some(0.0), Some(0.0)), Some(1.0));
        assert_eq!([of(Some(3.0), None), of(None, None)], [None, None]);
    }
}
