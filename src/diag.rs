//! Problems of the input: what was found, where it stands, what was expected. All problems of a file are collected
//! before the run ends.

use crate::error::{Error, Result};
use std::fmt::Write as _;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// How bad a problem is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// The run cannot go on.
    Error,
    /// The run goes on with a default that the message names; an error with `--strict`.
    Warning,
}

/// A place in a text file: one line with a range of it underlined.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file.
    pub path: PathBuf,
    /// Line number, from 1.
    pub line: usize,
    /// Column of the first underlined character, from 1.
    pub column: usize,
    /// The text of the line, without its end.
    pub excerpt: String,
    /// Underlined bytes of `excerpt`.
    pub marked: Range<usize>,
}

impl Place {
    /// The place of byte range `at` of `text`. A range over several lines is cut at the end of its first line.
    pub fn in_text(path: &Path, text: &str, at: Range<usize>) -> Place {
        let mut start = at.start.min(text.len());
        while !text.is_char_boundary(start) {
            start -= 1;
        }
        let line_start = text[..start].rfind('\n').map_or(0, |i| i + 1);
        let line_end = text[start..].find('\n').map_or(text.len(), |i| start + i);
        let excerpt = text[line_start..line_end].trim_end_matches('\r');
        let mut end = (at.end.clamp(start, line_end) - line_start).min(excerpt.len());
        while !excerpt.is_char_boundary(end) {
            end += 1;
        }
        let begin = (start - line_start).min(excerpt.len());
        Place {
            path: path.to_path_buf(),
            line: text[..line_start].matches('\n').count() + 1,
            column: excerpt[..begin].chars().count() + 1,
            excerpt: excerpt.to_owned(),
            marked: begin..end.max(begin),
        }
    }

    /// The place of a line that is known by its number only; `excerpt` may be empty for binary files.
    pub fn in_line(path: &Path, line: usize, excerpt: &str, marked: Range<usize>) -> Place {
        let marked = marked.start.min(excerpt.len())..marked.end.min(excerpt.len());
        let column = excerpt.get(..marked.start).map_or(1, |t| t.chars().count() + 1);
        Place { path: path.to_path_buf(), line, column, excerpt: excerpt.to_owned(), marked }
    }
}

/// One problem.
#[derive(Clone, Debug)]
pub struct Diagnostic {
    /// How bad it is.
    pub severity: Severity,
    /// What was found and what was expected, in one sentence without a full stop.
    pub message: String,
    /// Where it stands, if it stands in a file.
    pub place: Option<Place>,
    /// What the reader can do about it.
    pub help: Option<String>,
}

/// The problems met so far.
#[derive(Clone, Debug, Default)]
pub struct Diagnostics {
    items: Vec<Diagnostic>,
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

    fn push(&mut self, severity: Severity, place: Option<Place>, message: String) -> &mut Diagnostic {
        self.items.push(Diagnostic { severity, message, place, help: None });
        self.items.last_mut().expect("an item was just pushed")
    }

    /// Takes over all problems of `other`.
    pub fn extend(&mut self, other: Diagnostics) {
        self.items.extend(other.items);
    }

    /// All problems in the order in which they were met.
    pub fn items(&self) -> &[Diagnostic] {
        &self.items
    }

    /// Whether the run must end; with `strict` every warning counts.
    pub fn is_fatal(&self, strict: bool) -> bool {
        self.items.iter().any(|d| strict || d.severity == Severity::Error)
    }

    /// `Err` when [`Diagnostics::is_fatal`], otherwise the warnings to be shown.
    pub fn finish(mut self, strict: bool) -> Result<Diagnostics> {
        if !self.is_fatal(strict) {
            return Ok(self);
        }
        if strict {
            self.items.iter_mut().for_each(|d| d.severity = Severity::Error);
        }
        Err(Error::Input(Box::new(self)))
    }

    /// The first error's message and how many more there are, in one line.
    pub fn headline(&self) -> String {
        let first = self.items.iter().find(|d| d.severity == Severity::Error).or(self.items.first());
        let mut line = first.map_or_else(|| "invalid input".to_owned(), |d| d.message.clone());
        if self.items.len() > 1 {
            let _ = write!(line, " (and {} more)", self.items.len() - 1);
        }
        line
    }

    /// The whole report with file, line, column and the underlined text of each problem.
    pub fn render(&self, coloured: bool) -> String {
        self.items.iter().map(|d| d.render(coloured)).collect::<Vec<_>>().join("\n")
    }
}

impl Diagnostic {
    /// Adds what the reader can do about the problem.
    pub fn help(&mut self, text: impl Into<String>) -> &mut Diagnostic {
        self.help = Some(text.into());
        self
    }

    /// This problem as a report of a few lines that ends in a line break.
    pub fn render(&self, coloured: bool) -> String {
        use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
        let level = match self.severity {
            Severity::Error => Level::ERROR,
            Severity::Warning => Level::WARNING,
        };
        let title = level.primary_title(self.message.as_str());
        let path = self.place.as_ref().map(|p| p.path.display().to_string());
        let mut group = match (&self.place, &path) {
            (Some(place), Some(path)) => title.element(
                Snippet::source(place.excerpt.as_str())
                    .line_start(place.line)
                    .path(path.as_str())
                    .annotation(AnnotationKind::Primary.span(place.marked.clone())),
            ),
            _ => Group::with_title(title),
        };
        if let Some(help) = &self.help {
            group = group.element(Level::HELP.message(help.as_str()));
        }
        let renderer = if coloured { Renderer::styled() } else { Renderer::plain() };
        let mut text = renderer.render(&[group]).to_string();
        text.push('\n');
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_knows_line_and_column() {
        let text = "<a>\n  <leg z='abc'/>\r\n</a>";
        let at = text.find("abc").unwrap();
        let p = Place::in_text(Path::new("s.xml"), text, at..at + 3);
        assert_eq!((p.line, p.column, p.excerpt.as_str()), (2, 11, "  <leg z='abc'/>"));
        assert_eq!(&p.excerpt[p.marked.clone()], "abc");
    }

    #[test]
    fn a_report_shows_file_line_and_caret() {
        let mut d = Diagnostics::default();
        let place = Place::in_text(Path::new("s.xml"), "<leg z='abc'/>", 8..11);
        d.error(Some(place), "expected a number of metres, found \"abc\"").help("write z=\"0\"");
        let report = d.render(false);
        for part in ["error: expected a number of metres", "s.xml:1:9", "^^^", "help: write z=\"0\""] {
            assert!(report.contains(part), "{part:?} is missing from\n{report}");
        }
    }

    #[test]
    fn strict_turns_warnings_into_errors() {
        let mut d = Diagnostics::default();
        d.warn(None, "unknown attribute");
        assert!(d.clone().finish(false).is_ok());
        assert!(matches!(d.finish(true), Err(Error::Input(_))));
    }
}
