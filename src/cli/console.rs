//! Messages to the user on stderr, as text or as JSON.

use super::messages::{self, MessageFormat};
use indicatif::ProgressBar;
use std::fmt::Display;
use std::fs::{File, OpenOptions};
use std::io::{IsTerminal, Write, stderr};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use vlscan_base::Observer;
use vlscan_base::diag::{Diagnostics, Notice};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::write_stderr;
use vlscan_messages::{
    InfoMessage, InfoTopic, Message, ProblemMessage, ProgressMessage, ResultMessage, StartMessage, VERSION,
    WrittenFile,
};
use vlscan_render::Render as _;

/// Amount of messages shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Verbosity {
    /// Nothing.
    Silent,
    /// Errors.
    Errors,
    /// Errors and how long each stage took.
    Times,
    /// Errors, warnings, notes and the summary.
    #[default]
    Normal,
    /// Outcome and time of each stage, too.
    Verbose,
}

/// Destination of messages. The file is `helios_<YYYY-MM-DD_hh-mm-ss>.log` in the working folder (spec
/// outputs §10.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum LogTo {
    /// To stderr.
    #[default]
    Stderr,
    /// To stderr and the file.
    Both,
    /// To the file.
    File,
}

/// Writes messages to stderr, or to the destination set by [`Console::logging`].
#[derive(Clone, Debug)]
pub struct Console {
    verbosity: Verbosity,
    is_strict: bool,
    coloured: bool,
    stderr: bool,
    file: Option<Arc<File>>,
    step: Arc<Step>,
    /// State of messages in JSON, which then take the place of text.
    json: Option<Arc<Lines>>,
}

/// State of messages in JSON.
#[derive(Debug, Default)]
struct Lines {
    /// Name of the command.
    command: String,
    /// True after the first line. The lock keeps the lines of several threads apart.
    is_started: Mutex<bool>,
    /// Files and figures so far.
    result: Mutex<ResultMessage>,
}

/// Current computation, and its display.
#[derive(Debug, Default)]
struct Step {
    name: Mutex<&'static str>,
    shown: Mutex<Option<ProgressBar>>,
}

fn held<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Console {
    /// Creates a console of this verbosity; coloured when stderr is a terminal and `NO_COLOR` is not set.
    pub fn new(verbosity: Verbosity) -> Console {
        let coloured = stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty());
        let step = Arc::default();
        Console { verbosity, is_strict: false, coloured, stderr: true, file: None, step, json: None }
    }

    /// Writes the messages of `command` in this format from now on.
    pub fn formatted(self, format: MessageFormat, command: &str) -> Console {
        let lines = || Arc::new(Lines { command: command.to_owned(), ..Lines::default() });
        Console { json: (format == MessageFormat::Json).then(lines), ..self }
    }

    /// True if messages are in JSON.
    pub fn is_json(&self) -> bool {
        self.json.is_some()
    }

    /// Sends messages to `to`. Runs that start within the same second share a log file, line by line.
    ///
    /// # Errors
    /// [`Error::Io`] when the log file cannot be opened.
    pub fn logging(self, to: LogTo) -> Result<Console> {
        if to == LogTo::Stderr {
            return Ok(self);
        }
        let name = chrono::Local::now().format("helios_%Y-%m-%d_%H-%M-%S.log").to_string();
        let file = OpenOptions::new().append(true).create(true).open(&name);
        let file = file.map_err(|e| Error::io("write", Path::new(&name), e))?;
        Ok(Console { coloured: false, stderr: to == LogTo::Both, file: Some(Arc::new(file)), ..self })
    }

    /// Makes warnings errors if `is_strict` is set.
    pub fn strict(self, is_strict: bool) -> Console {
        Console { is_strict, ..self }
    }

    /// True if warnings are errors.
    pub fn is_strict(&self) -> bool {
        self.is_strict
    }

    /// True if a progress bar may be drawn on stderr.
    pub fn draws(&self) -> bool {
        self.stderr && self.shows(Verbosity::Normal) && !self.is_json()
    }

    /// True if messages of this level are shown.
    pub fn shows(&self, level: Verbosity) -> bool {
        self.verbosity >= level
    }

    /// Returns the observer that shows a session's notices.
    pub fn observer(&self) -> impl Fn(Notice) + Send + Sync + 'static + use<> {
        let console = self.clone();
        move |notice| match notice {
            // Notices of a session, which itself decides if they are errors.
            Notice::Warnings(found) => console.show(&found),
            Notice::Note(note) => console.say(note),
            Notice::Detail(detail) => console.detail(detail),
            Notice::Timing(text) => console.took(Verbosity::Verbose, text),
            Notice::Step(step) => console.begin(step),
        }
    }

    /// Reports the next stage of the computation.
    pub(super) fn begin(&self, step: &'static str) {
        let before = std::mem::replace(&mut *held(&self.step.name), step);
        if before != step {
            self.progress(ProgressMessage { stage: step.to_owned(), ..ProgressMessage::default() });
        }
    }

    /// Writes progress, if messages are in JSON.
    pub(super) fn progress(&self, progress: ProgressMessage) {
        self.emit(Verbosity::Normal, &[Message::Progress(progress)]);
    }

    /// Current computation.
    pub(super) fn step(&self) -> &'static str {
        *held(&self.step.name)
    }

    /// Draws messages above this display from now on, or above none.
    pub(super) fn display(&self, display: Option<ProgressBar>) {
        *held(&self.step.shown) = display;
    }

    /// The observer that shows the notices of a computation.
    pub fn listener(&self) -> Observer {
        Observer::new(self.is_strict, self.observer())
    }

    /// Shows a line of the normal level.
    pub fn say(&self, message: impl Display) {
        self.line(Verbosity::Normal, InfoTopic::General, message);
    }

    /// Shows a line on a file that was written, and adds the file to the result.
    pub fn wrote(&self, file: WrittenFile, message: impl Display) {
        self.line(Verbosity::Normal, InfoTopic::File, message);
        self.record(|result| result.files.push(file));
    }

    /// Shows a warning that as text is a line among others.
    pub fn caution(&self, line: impl Display, warning: ProblemMessage) {
        match self.is_json() {
            true => self.emit(Verbosity::Normal, &[Message::Warning(warning)]),
            false => self.say(line),
        }
    }

    /// Shows a line of the verbose level.
    pub fn detail(&self, message: impl Display) {
        self.line(Verbosity::Verbose, InfoTopic::Detail, message);
    }

    /// Shows how long something took, at this level or at [`Verbosity::Times`].
    pub fn took(&self, level: Verbosity, message: impl Display) {
        let times = self.verbosity == Verbosity::Times;
        self.line(if times { Verbosity::Times } else { level }, InfoTopic::Timing, message);
    }

    /// Shows all warnings and notes, each with its place.
    ///
    /// # Errors
    /// [`Error::Input`] with the warnings if they are errors.
    pub fn warnings(&self, found: &Diagnostics) -> Result<()> {
        match found.is_fatal(self.is_strict) {
            true => found.clone().finish(self.is_strict).map(drop),
            false => {
                self.show(found);
                Ok(())
            }
        }
    }

    fn show(&self, found: &Diagnostics) {
        match self.is_json() {
            true => self.emit(Verbosity::Normal, &messages::of_problems(found)),
            false if self.shows(Verbosity::Normal) => self.raw(&found.render(self.coloured)),
            false => {}
        }
    }

    /// Shows the error that ends the run.
    pub fn failure(&self, error: &Error) {
        if self.is_json() {
            self.emit(Verbosity::Errors, &messages::of_error(error));
        } else if self.shows(Verbosity::Errors) {
            match error {
                Error::Input(found) | Error::Limits(found) => self.raw(&found.render(self.coloured)),
                other => self.raw(&format!(
                    "{} {other}\n",
                    if self.coloured { "\x1b[1;31merror:\x1b[0m" } else { "error:" }
                )),
            }
        }
    }

    /// Writes an error, if messages are in JSON.
    pub fn problem(&self, problem: ProblemMessage) {
        self.emit(Verbosity::Errors, &[Message::Error(problem)]);
    }

    /// Changes the result with which messages in JSON end.
    pub fn record(&self, change: impl FnOnce(&mut ResultMessage)) {
        if let Some(lines) = &self.json {
            change(&mut held(&lines.result));
        }
    }

    /// Writes the first line of messages in JSON, before any work. With fewer messages the first one of them
    /// follows it.
    pub fn start(&self) {
        self.emit(Verbosity::Normal, &[]);
    }

    /// Writes the result, if messages are in JSON: of a complete command, or of files that it has written
    /// before its end.
    pub fn finish(&self, is_complete: bool) {
        let Some(lines) = &self.json else { return };
        let result = held(&lines.result).clone();
        if is_complete || !result.files.is_empty() {
            self.emit(Verbosity::Normal, &[Message::Result(result)]);
        }
    }

    fn line(&self, level: Verbosity, topic: InfoTopic, message: impl Display) {
        if !self.shows(level) {
            return;
        }
        match self.is_json() {
            true => self.emit(level, &[Message::Info(InfoMessage { topic, message: message.to_string() })]),
            false => self.raw(&format!("{message}\n")),
        }
    }

    /// Writes messages in JSON, after the first line if there was none.
    fn emit(&self, level: Verbosity, found: &[Message]) {
        let Some(lines) = self.json.as_ref().filter(|_| self.shows(level)) else { return };
        let mut is_started = held(&lines.is_started);
        let mut text = String::new();
        if !std::mem::replace(&mut *is_started, true) {
            text += &messages::line(&Message::Start(StartMessage {
                version: VERSION,
                program: env!("CARGO_PKG_VERSION").to_owned(),
                command: lines.command.clone(),
            }));
        }
        found.iter().for_each(|message| text += &messages::line(message));
        self.raw(&text);
    }

    fn raw(&self, text: &str) {
        // A closed stderr or a full disk of the log must not end the run.
        if self.stderr {
            match &*held(&self.step.shown) {
                Some(display) => display.suspend(|| write_stderr(text)),
                None => write_stderr(text),
            }
        }
        if let Some(mut file) = self.file.as_deref() {
            let _ = file.write_all(text.as_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::hint::black_box;
    use vlscan_messages::ProblemClass;

    #[test]
    fn a_panic_that_is_caught_is_an_error_in_json() {
        let log = tempfile::NamedTempFile::new().unwrap();
        let json = Console::new(Verbosity::Normal).formatted(MessageFormat::Json, "run");
        let console = Console { stderr: false, file: Some(Arc::new(log.reopen().unwrap())), ..json };
        let hook = std::panic::take_hook();
        crate::cli::report_panics(&console);
        let caught = std::panic::catch_unwind(|| assert!(black_box(false), "the cause"));
        std::panic::set_hook(hook);
        assert!(caught.is_err());
        let lines = std::fs::read_to_string(log.path()).unwrap();
        let is_cause = |message: Message| {
            matches!(message, Message::Error(error)
                if error.problem == ProblemClass::Internal && error.message.contains("the cause"))
        };
        assert!(lines.lines().any(|line| is_cause(serde_json::from_str(line).unwrap())), "{lines}");
    }
}
