//! Rows: numbers in lines of text or in record batches, and their places.

use crate::check_width;
use crate::input::arrow::NumberBatch;
use std::ops::Range;
use std::path::{Path, PathBuf};
use vlscan_base::columns::{Separator, comma_note};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Error;

/// A stream and how its lines are split.
#[derive(Clone, Debug)]
pub(super) struct Source {
    pub path: PathBuf,
    pub separator: Separator,
}

/// A row: its numbers and their places.
#[derive(Clone, Copy, Debug)]
pub struct Row<'b> {
    pub(super) source: &'b Source,
    pub(super) content: RowContent<'b>,
    pub(super) fields: &'b [Range<usize>],
}

#[derive(Clone, Copy, Debug)]
pub(super) enum RowContent<'b> {
    /// A line and its number.
    Text(usize, &'b [u8]),
    Batch(&'b NumberBatch, usize),
}

/// A wrong value and its place.
#[derive(Clone, Debug, PartialEq)]
pub struct RowError {
    /// The line and the column, or the complete stream if it is not text.
    pub place: Place,
    /// Description of the problem.
    pub message: String,
}

impl RowError {
    /// The error with a hint, which may be empty.
    pub fn with_help(self, help: &str) -> Error {
        let mut problems = Diagnostics::default();
        let problem = problems.error(Some(self.place), self.message);
        if !help.is_empty() {
            problem.help(help);
        }
        Error::Input(Box::new(problems))
    }
}

impl Row<'_> {
    /// The texts of the columns; none in batches.
    pub fn texts(&self) -> impl Iterator<Item = String> {
        let line = self.line();
        self.fields.iter().map(move |at| String::from_utf8_lossy(&line[at.clone()]).trim().to_owned())
    }

    fn line(&self) -> &[u8] {
        match self.content {
            RowContent::Text(_, line) => line,
            RowContent::Batch(..) => &[],
        }
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        match self.content {
            RowContent::Text(..) => self.fields.len(),
            RowContent::Batch(batch, _) => batch.width(),
        }
    }

    /// Checks the number of fields of a line; `whose` says where `expected` is from, such as `the heading`.
    /// Rows of batches always have the columns of their stream.
    ///
    /// # Errors
    /// Surplus and missing fields, with a hint at their likely cause.
    pub fn check_width(&self, expected: usize, whose: &str) -> std::result::Result<(), RowError> {
        if !matches!(self.content, RowContent::Text(..)) {
            return Ok(());
        }
        // A separator at the end of the line stands before an empty last field.
        let ends_empty = matches!(self.source.separator, Separator::Char(c)
            if self.width() + 1 == expected
                && self.line().trim_ascii_end().ends_with(c.encode_utf8(&mut [0; 4]).as_bytes()));
        if ends_empty {
            return Ok(());
        }
        check_width(self.width(), expected, whose, self.source.separator).map_err(|e| {
            let help = if e.help.is_empty() { String::new() } else { format!("; {}", e.help) };
            self.error((self.width() > expected).then_some(expected), format!("{}{help}", e.message))
        })
    }

    /// How the line is split.
    pub fn separator(&self) -> Separator {
        self.source.separator
    }

    /// The number in a column. `name` describes it in messages; it may be infinite or NaN.
    ///
    /// # Errors
    /// The column does not exist or is not numeric.
    pub fn number(&self, column: usize, name: &str) -> std::result::Result<f64, RowError> {
        if column >= self.width() {
            let message = format!(
                "column {} for {name} is missing: {} column{} separated by {}",
                column + 1,
                self.width(),
                if self.width() == 1 { "" } else { "s" },
                self.source.separator.name()
            );
            return Err(self.error(None, message));
        }
        let (line, at) = match self.content {
            RowContent::Batch(batch, row) => return Ok(batch.value(column, row)),
            RowContent::Text(_, line) => (line, &self.fields[column]),
        };
        let fields = self.fields.iter().map(move |at| &line[at.clone()]);
        let number = self.source.separator.number(&line[at.clone()], fields);
        number.ok_or_else(|| self.expected_number(column, name))
    }

    /// The error that a column is not numeric; `name` describes the expected number.
    pub fn expected_number(&self, column: usize, name: &str) -> RowError {
        let text = match self.content {
            RowContent::Text(_, line) => {
                let at = self.fields.get(column).cloned().unwrap_or_default();
                String::from_utf8_lossy(&line[at]).into_owned()
            }
            RowContent::Batch(batch, row) => batch.value(column, row).to_string(),
        };
        self.error(Some(column), format!("expected a number for {name}, found `{text}`{}", comma_note(&text)))
    }

    /// An error in a column or in the complete row.
    pub fn error(&self, column: Option<usize>, message: impl Into<String>) -> RowError {
        let message = message.into();
        let path = &self.source.path;
        match self.content {
            RowContent::Text(number, line) => {
                let at = column.and_then(|column| self.fields.get(column)).cloned();
                RowError { place: line_place(path, number, line, at.unwrap_or(0..line.len())), message }
            }
            RowContent::Batch(batch, row) => {
                // The path of a table in memory is `<pulses>` or alike, that of a stream `<stdin>`.
                let is_in_memory = path.to_string_lossy().starts_with('<') && path != Path::new("<stdin>");
                let row = if is_in_memory { batch.index(row) } else { batch.place(row) };
                RowError { place: Place::of_file(path), message: format!("{row}: {message}") }
            }
        }
    }
}

/// The place of the bytes `at` of a line, which need not be UTF-8.
pub fn line_place(path: &Path, number: usize, line: &[u8], at: Range<usize>) -> Place {
    let shown = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (before, marked) = (shown(&line[..at.start]), shown(line[at].trim_ascii()));
    Place::in_line(path, number, &shown(line), before.len()..before.len() + marked.len())
}
