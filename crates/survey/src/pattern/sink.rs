//! Readers of the rows of a table, and their problems.

use super::columns::{Column, Row};

/// Maximum number of channels.
pub(super) const MAX_CHANNELS: usize = 1024;
/// Largest number of a channel.
pub(super) const MAX_CHANNEL: f64 = 65_535.0;

/// A problem of a table of beams; the text of each error is its message.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(super) enum PatternProblem {
    /// A column without which there are no directions.
    #[error("no column `{0}`")]
    Missing(&'static str),
    /// Two columns for one quantity.
    #[error("two columns `{0}`")]
    Twice(&'static str),
    /// Two columns of which each replaces the other.
    #[error("give either `{0}` or `{1}`, not both")]
    Either(&'static str, &'static str),
    /// A column of other tables.
    #[error("the column `{0}` has no meaning in a pattern")]
    NotHere(&'static str),
    /// A value out of range.
    #[error("expected {0}")]
    Value(String),
    /// Times or numbers that go back.
    #[error("expected {0} not below that of the row before")]
    Back(&'static str),
    /// A second beam of one channel.
    #[error("a second beam of one {0}, expected a later one or another `channel`")]
    Again(&'static str),
    /// Too many rows or channels.
    #[error("more than {max} {what}")]
    TooMany {
        /// Maximum number.
        max: u64,
        /// Counted things.
        what: &'static str,
    },
    /// No rows.
    #[error("no row of numbers")]
    Empty,
    /// Columns whose quantities are not known.
    #[error("{0} columns without headings")]
    Unnamed(usize),
    /// A row of another length.
    #[error("row {row} has {found} numbers, expected {expected} as in the first one")]
    Ragged {
        /// Its number, from 0.
        row: usize,
        /// Its length.
        found: usize,
        /// Length of the first row.
        expected: usize,
    },
    /// A problem of a row without a line.
    #[error("row {row}, `{column}`: {problem}")]
    InRow {
        /// Its number, from 0.
        row: usize,
        /// Name of its column.
        column: &'static str,
        /// The problem of the column.
        problem: Box<PatternProblem>,
    },
    /// A single time.
    #[error("a single time, from which no pulse rate follows")]
    OneTime,
    /// Pulses too close to each other.
    #[error("{rate} pulses per second on average, expected at most {max}")]
    TooFast {
        /// Pulses per second.
        rate: String,
        /// Maximum.
        max: String,
    },
}

/// A problem of a row, and the column that has it.
pub(super) type RowResult = Result<(), (Column, PatternProblem)>;

/// A reader of rows.
pub(super) trait RowSink {
    /// Columns of tables without headings, by their number.
    fn unnamed(count: usize) -> Option<&'static [Column]>;

    /// Begins a table with these columns.
    ///
    /// # Errors
    /// Missing and contradictory columns.
    fn begin(&mut self, columns: &[Column]) -> Result<(), PatternProblem>;

    /// Adds a row.
    ///
    /// # Errors
    /// The column and its problem.
    fn add(&mut self, row: &Row) -> RowResult;

    /// True if a line of text is skipped whose first field is not a number; correction files have such lines.
    fn skips(_: &str) -> bool {
        false
    }
}

/// Checks columns of which no two may be for one quantity, and one of two must be there.
///
/// # Errors
/// The first problem.
pub(super) fn check_columns(columns: &[Column], required: &[Column]) -> Result<(), PatternProblem> {
    for (i, column) in columns.iter().enumerate() {
        if columns[..i].contains(column) {
            return Err(PatternProblem::Twice(column.name()));
        }
    }
    match required.iter().find(|column| !columns.contains(column)) {
        Some(column) => Err(PatternProblem::Missing(column.name())),
        None => Ok(()),
    }
}
