//! Problems of the input, each with its place and the expected input. All problems of a file are collected
//! before the run ends.
//!
//! | file | what it does |
//! |---|---|
//! | `place` | places of problems in files |
//! | `shorten` | messages of limited length |

mod place;
mod shorten;

use crate::error::{Error, Result};
pub use place::Place;
pub use shorten::listed;
use shorten::shortened;
use std::collections::HashMap;
use std::fmt::{self, Write as _};
use std::path::PathBuf;
use std::sync::Arc;
pub use vlscan_messages::nearest;

/// How grave a problem is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// The run cannot continue.
    Error,
    /// An input is suspicious, or is not used as written; the message names the value used instead. An error
    /// with `--strict`.
    Warning,
    /// How an input was understood that can be read in more than one way. Shown with the warnings; never ends
    /// a run.
    Note,
}

/// Kind of a problem, for programs that handle some kinds themselves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ProblemKind {
    /// A value, a file or a combination of them that is not valid.
    #[default]
    Invalid,
    /// A file that does not exist.
    NotFound,
    /// An output that exists and is not to be replaced.
    Exists,
    /// Input that needs more memory than the limit allows, or has more elements than can be numbered.
    TooLarge,
    /// A reference to something that the input does not have: an element with that id, a face with that
    /// number.
    MissingEntry,
    /// A file that ends before its content does.
    Truncated,
    /// Valid input with a feature that is not supported.
    Unsupported,
    /// A run that cannot be divided into shards, or not continued with the shards that exist; it can be
    /// computed as a whole.
    NotDivisible,
    /// A folder in which another process works; the same command succeeds when that one has ended.
    InUse,
}

impl From<&std::io::Error> for ProblemKind {
    /// The kind of the problem that an input cannot be opened.
    fn from(e: &std::io::Error) -> ProblemKind {
        match e.kind() {
            std::io::ErrorKind::NotFound => ProblemKind::NotFound,
            _ => ProblemKind::Invalid,
        }
    }
}

/// An error of a reader that can be the cause of a [`Diagnostic`].
pub trait Problem: std::error::Error + Send + Sync + Sized + 'static {
    /// The kind of the diagnostics that it causes.
    fn kind(&self) -> ProblemKind {
        ProblemKind::Invalid
    }

    /// The error of the run, with the error itself as its message and its cause.
    fn into_error(self) -> Error {
        Error::caused_by(self.to_string(), self)
    }
}

/// A message during a run.
#[derive(Clone, Debug)]
pub enum Notice {
    /// Input that was accepted although it is suspicious, and notes on how input was understood.
    Warnings(Diagnostics),
    /// Information for every user.
    Note(String),
    /// Details for a verbose log.
    Detail(String),
    /// Duration of a step.
    Timing(String),
    /// Beginning of a computation, for a display of progress: "building the tree".
    Step(&'static str),
}

/// Maximum number of different problems of a severity that are stored; further ones are counted.
const MAX_PROBLEMS: usize = 1000;
/// The message that stands for the problems that are not stored.
const FURTHER_PROBLEMS: &str = "there are more problems than can be listed";

/// A problem of the input.
#[derive(Clone, Debug)]
pub struct Diagnostic {
    /// How grave it is.
    pub severity: Severity,
    /// Kind of the problem.
    pub kind: ProblemKind,
    /// The problem and the expected input, in one sentence without a full stop.
    pub message: String,
    /// Its place; `None` for problems outside of files.
    pub place: Option<Place>,
    /// A hint how to solve the problem.
    pub help: Option<String>,
    /// Number of further occurrences in the same file.
    pub repeats: usize,
    /// Lines of the first further occurrences.
    pub also_in_lines: Vec<usize>,
    cause: Option<Arc<dyn std::error::Error + Send + Sync>>,
}

/// Maximum number of stored lines of further occurrences.
const MAX_LINES: usize = 5;

/// The problems found so far. A repeated message about the same file is stored once, with a count.
#[derive(Clone, Default)]
pub struct Diagnostics {
    items: Vec<Diagnostic>,
    /// Numbers of items by severity.
    stored: [usize; 3],
    /// Indices in `items` by severity, file and message.
    index: HashMap<(Severity, Option<PathBuf>, String), usize>,
}

impl Diagnostics {
    /// Records a problem that ends the run.
    pub fn error(&mut self, place: Option<Place>, message: impl Into<String>) -> &mut Diagnostic {
        self.push(Severity::Error, place, message.into())
    }

    /// Records a value that was replaced by a default, or an element that was ignored.
    pub fn warn(&mut self, place: Option<Place>, message: impl Into<String>) -> &mut Diagnostic {
        self.push(Severity::Warning, place, message.into())
    }

    /// Records how a value was interpreted.
    pub fn note(&mut self, place: Option<Place>, message: impl Into<String>) -> &mut Diagnostic {
        self.push(Severity::Note, place, message.into())
    }

    fn push(&mut self, severity: Severity, place: Option<Place>, message: String) -> &mut Diagnostic {
        let message = shortened(message);
        let mut key = (severity, place.as_ref().map(|p| p.path.clone()), message);
        let next = self.items.len();
        let stored = &mut self.stored[severity as usize];
        if *stored >= MAX_PROBLEMS && !self.index.contains_key(&key) {
            key = (severity, None, FURTHER_PROBLEMS.to_owned());
            if let Some(&at) = self.index.get(&key) {
                self.items[at].repeats += 1;
                return &mut self.items[at];
            }
        }
        let message = key.2.clone();
        let place = place.filter(|_| key.1.is_some());
        let at = *self.index.entry(key).or_insert(next);
        if at == next {
            *stored += 1;
            self.items.push(Diagnostic {
                severity,
                kind: ProblemKind::Invalid,
                message,
                place,
                help: None,
                repeats: 0,
                also_in_lines: Vec::new(),
                cause: None,
            });
        } else if self.items[at].place != place {
            let lines = place.map_or(0, |p| p.line);
            self.items[at].repeat(1, &[lines]);
        }
        &mut self.items[at]
    }

    /// Adds all problems of `other`.
    pub fn extend(&mut self, other: Diagnostics) {
        for item in other.items {
            let Diagnostic { severity, kind, message, place, help, repeats, also_in_lines, cause } = item;
            let mine = self.push(severity, place, message);
            mine.kind = kind;
            mine.repeat(repeats, &also_in_lines);
            mine.help = help.or(mine.help.take());
            mine.cause = cause.or(mine.cause.take());
        }
    }

    /// The problems, with the name of what has them in front of each message.
    pub fn named(mut self, name: &str) -> Diagnostics {
        self.items.iter_mut().for_each(|item| item.message = format!("{name}: {}", item.message));
        let mut named = Diagnostics::default();
        named.extend(self);
        named
    }

    /// The problems that `reported` does not contain. Lines and messages are compared, since files may have
    /// other names there.
    pub fn without(&self, reported: &Diagnostics) -> Diagnostics {
        let line = |d: &Diagnostic| d.place.as_ref().map(|place| place.line);
        let is_reported =
            |d: &&Diagnostic| reported.items.iter().any(|t| t.message == d.message && line(t) == line(d));
        let items = self.items.iter().filter(|d| !is_reported(d)).cloned().collect();
        let mut rest = Diagnostics::default();
        rest.extend(Diagnostics { items, ..Diagnostics::default() });
        rest
    }

    /// True if there are no problems.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// All problems in the order in which they were found.
    pub fn items(&self) -> &[Diagnostic] {
        &self.items
    }

    /// True if one of the problems is of that kind.
    ///
    /// ```
    /// use vlscan_base::Error;
    /// use vlscan_base::diag::ProblemKind;
    ///
    /// let read = std::fs::read("missing.xml").map_err(|e| Error::open("missing.xml", e));
    /// let Err(error) = read else { return };
    /// match error {
    ///     Error::Input(problems) if problems.has(ProblemKind::NotFound) => println!("nothing to read yet"),
    ///     other => panic!("{other}"),
    /// }
    /// ```
    pub fn has(&self, kind: ProblemKind) -> bool {
        self.items.iter().any(|problem| problem.kind == kind)
    }

    /// The first cause of that type among the problems.
    ///
    /// ```
    /// use vlscan_base::Error;
    /// # use vlscan_base::diag::Problem;
    /// # #[derive(Debug, PartialEq)]
    /// # struct Odd(u32);
    /// # impl std::fmt::Display for Odd {
    /// #     fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result { f.write_str("it is odd") }
    /// # }
    /// # impl std::error::Error for Odd {}
    /// # impl Problem for Odd {}
    /// let error = Error::caused_by("a.txt: it is odd", Odd(3));
    /// let Error::Input(problems) = error else { panic!() };
    /// assert_eq!(problems.cause::<Odd>(), Some(&Odd(3)));
    /// ```
    pub fn cause<E: std::error::Error + 'static>(&self) -> Option<&E> {
        self.items.iter().find_map(Diagnostic::cause)
    }

    /// True if the run must end; with `strict` warnings end it, too.
    pub fn is_fatal(&self, strict: bool) -> bool {
        self.items
            .iter()
            .any(|d| d.severity == Severity::Error || (strict && d.severity == Severity::Warning))
    }

    /// `Err` when [`Diagnostics::is_fatal`], otherwise the warnings and notes to be shown.
    pub fn finish(mut self, strict: bool) -> Result<Diagnostics> {
        if !self.is_fatal(strict) {
            return Ok(self);
        }
        if strict {
            let warnings = self.items.iter_mut().filter(|d| d.severity == Severity::Warning);
            warnings.for_each(|d| d.severity = Severity::Error);
        }
        Err(Error::Input(Box::new(self)))
    }

    /// The first error's message and the number of further errors, in one line.
    pub fn headline(&self) -> String {
        let first = self.items.iter().find(|d| d.severity == Severity::Error).or(self.items.first());
        let mut line = first.map_or_else(|| "invalid input".to_owned(), |d| d.message.clone());
        if self.items.len() > 1 {
            let _ = write!(line, " (and {} more)", self.items.len() - 1);
        }
        line
    }

    /// All problems, one per line, each with its place and hint. Programs show their users the reports of
    /// `vlscan-render`, which quote the lines of the files.
    pub fn text(&self) -> String {
        self.items.iter().map(Diagnostic::line).collect()
    }
}

impl fmt::Debug for Diagnostics {
    /// The report, so that `fn main() -> Result<()>` shows it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.text().trim_end())
    }
}

impl Diagnostic {
    /// Adds a hint how to solve the problem.
    pub fn help(&mut self, text: impl Into<String>) -> &mut Diagnostic {
        let text = text.into();
        if self.message != FURTHER_PROBLEMS && !text.is_empty() {
            self.help = Some(shortened(text));
        }
        self
    }

    /// Sets the subject of the problem.
    pub fn of_kind(&mut self, kind: ProblemKind) -> &mut Diagnostic {
        self.kind = kind;
        self
    }

    /// Stores the error that caused the problem, which takes its kind.
    pub fn because_of(&mut self, cause: impl Problem) -> &mut Diagnostic {
        self.kind = cause.kind();
        self.cause = Some(Arc::new(cause));
        self
    }

    /// The error that caused the problem, if one of that type did.
    pub fn cause<E: std::error::Error + 'static>(&self) -> Option<&E> {
        self.cause.as_ref().and_then(|cause| cause.downcast_ref())
    }

    /// The problem with its hint in one line that ends with a line break.
    pub fn line(&self) -> String {
        let severity = match self.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
            Severity::Note => "note",
        };
        let place = self.place.as_ref().map(|p| match p.line {
            0 => format!("{}: ", p.path.display()),
            line => format!("{}:{line}:{}: ", p.path.display(), p.column),
        });
        let help = self.help.as_ref().map(|help| format!("; {help}")).unwrap_or_default();
        let text = format!("{}{}{help}", place.unwrap_or_default(), self.message);
        let text = text.replace(char::is_control, " ");
        format!("{severity}: {text}\n")
    }

    /// The known lines of the problem: the line of its place and those of further occurrences.
    pub fn lines(&self) -> impl Iterator<Item = usize> {
        let own = self.place.as_ref().map(|p| p.line);
        own.into_iter().chain(self.also_in_lines.iter().copied())
    }

    fn repeat(&mut self, times: usize, lines: &[usize]) {
        self.repeats += times;
        let free = MAX_LINES.saturating_sub(self.also_in_lines.len());
        self.also_in_lines.extend(lines.iter().filter(|&&l| l > 0).take(free));
    }

    /// The text "also in line 4, 5", if there are further occurrences.
    pub fn repeated(&self) -> Option<String> {
        if self.repeats == 0 {
            return None;
        }
        let lines: Vec<String> = self.also_in_lines.iter().map(usize::to_string).collect();
        let more = self.repeats - lines.len().min(self.repeats);
        Some(match (lines.len(), more) {
            (0, n) => format!("found {n} more times"),
            (_, 0) => format!("also in line {}", lines.join(", ")),
            (_, n) => format!("also in line {} and {n} more", lines.join(", ")),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::shorten::{MAX_MESSAGE_BYTES, MAX_MESSAGE_LINES};
    use super::*;
    use std::path::Path;

    #[test]
    fn the_error_of_main_is_its_text() {
        let mut d = Diagnostics::default();
        d.error(Some(Place::of_file(Path::new("s.xml"))), "expected a number").help("write 0");
        let shown = format!("{:?}", Error::Input(Box::new(d)));
        assert!(shown.contains("error: s.xml: expected a number; write 0"), "{shown}");
        assert!(!shown.contains("items"), "{shown}");
    }

    #[test]
    fn strict_turns_warnings_into_errors() {
        let mut d = Diagnostics::default();
        d.note(None, "taken for G");
        assert!(!d.is_fatal(true), "a note never ends a run");
        d.warn(None, "unknown attribute");
        assert!(d.clone().finish(false).is_ok());
        assert!(matches!(d.finish(true), Err(Error::Input(_))));
    }

    #[test]
    fn the_same_problem_is_kept_once() {
        let text = "<a f='1'/>\n<a f='1'/>\n<a f='1'/>";
        let mut d = Diagnostics::default();
        for at in [3, 14, 25, 3] {
            d.warn(Some(Place::in_text(Path::new("s.xml"), text, at..at + 1)), "unknown attribute `f`");
        }
        d.warn(Some(Place::in_text(Path::new("t.xml"), text, 3..4)), "unknown attribute `f`");
        assert_eq!(d.items().len(), 2);
        assert_eq!((d.items()[0].repeats, d.items()[0].also_in_lines.as_slice()), (2, &[2, 3][..]));
        assert_eq!(d.items()[0].repeated().as_deref(), Some("also in line 2, 3"));
    }

    #[test]
    fn problems_in_one_line_have_no_control_characters() {
        let mut d = Diagnostics::default();
        d.error(None, "material \"\u{1b}[31m\nred\"");
        assert_eq!(d.items()[0].line(), "error: material \" [31m red\"\n");
    }

    #[test]
    fn long_messages_are_cut_and_many_problems_are_counted() {
        let mut d = Diagnostics::default();
        d.error(None, format!("found `{}`, expected a number", "é".repeat(10_000_000)));
        d.error(None, format!("lines: {} end", "one\n".repeat(100)));
        for d in d.items() {
            assert!(
                d.message.len() <= MAX_MESSAGE_BYTES + 8 && d.message.lines().count() <= MAX_MESSAGE_LINES
            );
        }
        assert!(d.items()[0].message.ends_with("`, expected a number"));
        for i in 0..MAX_PROBLEMS * 3 {
            d.warn(None, format!("problem {i}")).help("help");
        }
        let last = d.items().last().unwrap();
        assert_eq!((d.items().len(), last.repeats), (2 + MAX_PROBLEMS + 1, MAX_PROBLEMS * 2 - 1));
        assert_eq!((last.message.as_str(), &last.help), (FURTHER_PROBLEMS, &None));
        d.error(None, "an error after many warnings");
        assert!(d.text().contains("an error after many warnings"));
    }

    #[test]
    fn causes_give_problems_their_kind_and_stay_with_them() {
        #[derive(Debug, PartialEq, thiserror::Error)]
        #[error("it ends early")]
        struct Cut;
        impl Problem for Cut {
            fn kind(&self) -> ProblemKind {
                ProblemKind::Truncated
            }
        }
        let (mut found, mut all) = (Diagnostics::default(), Diagnostics::default());
        found.error(None, "a.las: it ends early").because_of(Cut);
        all.error(None, "b.las: it is empty");
        all.extend(found);
        assert!(all.has(ProblemKind::Truncated) && all.items()[0].cause::<Cut>().is_none());
        assert_eq!(all.cause::<Cut>(), Some(&Cut));
        assert_eq!(Cut.into_error().to_string(), "it ends early");
    }

    #[test]
    fn what_has_been_told_is_left_out() {
        let text = "<a>\n<b/>\n</a>";
        let place = |path: &str, at: usize| Some(Place::in_text(Path::new(path), text, at..at + 1));
        let (mut reported, mut found) = (Diagnostics::default(), Diagnostics::default());
        reported.warn(place("s.xml", 4), "unknown element <b>");
        found.warn(place("./s.xml", 4), "unknown element <b>");
        found.warn(place("s.xml", 0), "unknown element <b>").help("write <c>");
        found.warn(None, "a slow flight");
        let rest = found.without(&reported);
        let messages: Vec<&str> = rest.items().iter().map(|d| d.message.as_str()).collect();
        assert_eq!(messages, ["unknown element <b>", "a slow flight"]);
        assert_eq!(rest.items()[0].help.as_deref(), Some("write <c>"));
        assert!(found.without(&found).is_empty());
    }
}
