//! Readers of the rows of a table, and their problems.

use super::columns::{Column, Row};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use vlscan_base::quantity::{counted, number};

/// Maximum number of channels.
pub(super) const MAX_CHANNELS: usize = 1024;
/// Largest number of a channel.
pub(super) const MAX_CHANNEL: f64 = 65_535.0;
/// Rows from which on small angles are noticed.
const MIN_ROWS: usize = 16;
/// Difference of angles from which on they look like radians and not like a narrow beam of degrees.
const MIN_SPAN: f64 = 0.2;

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
    #[error("{} without headings", columns(.0))]
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
    #[error("a single time, from which no pulse rate follows: add rows, or give `pulse_freqs_hz`")]
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

fn columns(count: &usize) -> String {
    counted(*count, "column")
}

/// A problem of a row, and the column that has it.
pub(super) type RowResult = Result<(), (Column, PatternProblem)>;

/// A reader of rows.
pub(super) trait RowSink {
    /// Columns of tables without headings, by their number.
    fn unnamed(count: usize) -> Option<&'static [Column]>;

    /// Begins a table with these columns. `has_units` is true if headings state angles that are not degrees.
    ///
    /// # Errors
    /// Missing and contradictory columns.
    fn begin(&mut self, columns: &[Column], has_units: bool) -> Result<(), PatternProblem>;

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

/// Lowest and highest angles of a table, by which radians in columns of degrees are noticed.
#[derive(Clone, Copy, Debug)]
pub(super) struct AngleRange {
    rows: usize,
    /// Azimuth, elevation and zenith, degrees.
    low: [f64; 3],
    high: [f64; 3],
    has_units: bool,
}

impl AngleRange {
    /// Help for angles that look like radians.
    pub const HELP: &str =
        "give radians the headings azimuth_rad and elevation_rad, or convert them to degrees";

    /// The range of no row, see [`RowSink::begin`].
    pub fn new(has_units: bool) -> AngleRange {
        AngleRange { rows: 0, low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3], has_units }
    }

    /// Adds the angles of a row.
    pub fn add(&mut self, row: &Row) {
        self.rows += 1;
        for (i, column) in [Column::Azimuth, Column::Elevation, Column::Zenith].into_iter().enumerate() {
            // NaN, for a missing column, changes neither.
            let angle = row[column as usize];
            (self.low[i], self.high[i]) = (self.low[i].min(angle), self.high[i].max(angle));
        }
    }

    /// A warning if all angles are possible radians and hardly degrees.
    pub fn warning(&self) -> Option<String> {
        let limits = [TAU, FRAC_PI_2, PI].map(|limit| limit + 1e-3);
        let is_within = (0..3).all(|i| self.low[i] >= -limits[i] && self.high[i] <= limits[i]);
        let is_wide = (0..3).any(|i| self.high[i] - self.low[i] >= MIN_SPAN);
        if self.has_units || self.rows < MIN_ROWS || !is_within || !is_wide {
            return None;
        }
        let of = |i: usize, name: &str| {
            let [low, high] =
                [self.low[i], self.high[i]].map(|angle| number((angle * 100.0).round() / 100.0));
            (self.low[i] <= self.high[i]).then(|| format!("{name} from {low} to {high}"))
        };
        let found = [of(0, "azimuths"), of(1, "elevations"), of(2, "zeniths")];
        let found: Vec<String> = found.into_iter().flatten().collect();
        Some(format!("angles that look like radians are read as degrees: {}", found.join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use super::super::columns::COLUMNS;
    use super::*;

    fn warning(rows: &[(f64, f64)], column: Column, has_units: bool) -> Option<String> {
        let mut range = AngleRange::new(has_units);
        for (azimuth, up) in rows {
            let mut row = [f64::NAN; COLUMNS];
            (row[Column::Azimuth as usize], row[column as usize]) = (*azimuth, *up);
            range.add(&row);
        }
        range.warning()
    }

    #[test]
    fn radians_in_columns_of_degrees_are_noticed() {
        let turn: Vec<(f64, f64)> =
            (0..100).map(|i| (0.0628 * f64::from(i), 0.0052 * f64::from(i))).collect();
        assert_eq!(
            warning(&turn, Column::Elevation, false).unwrap(),
            "angles that look like radians are read as degrees: azimuths from 0 to 6.22, elevations from 0 \
             to 0.51"
        );
        assert!(warning(&turn, Column::Zenith, false).unwrap().contains("zeniths from 0 to 0.5"));
        // Stated radians, few rows, a beam that hardly moves, and degrees.
        assert_eq!(warning(&turn, Column::Elevation, true), None);
        assert_eq!(warning(&turn[..15], Column::Elevation, false), None);
        assert_eq!(warning(&[(0.0, 0.0); 50], Column::Elevation, false), None);
        let degrees: Vec<(f64, f64)> = turn.iter().map(|(a, e)| (a * 1.1, e * 4.0)).collect();
        assert_eq!(warning(&degrees, Column::Elevation, false), None);
    }
}
