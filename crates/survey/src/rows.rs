//! Text files of a few columns of numbers, such as pulse shapes and angles over time.

use super::context::Context;
use std::path::Path;
use vlscan_base::diag::Place;
use vlscan_base::recognise::{Expected, foreign};

/// Maximum size of a file, bytes.
pub(super) const MAX_FILE_BYTES: u64 = 1 << 24;
/// Maximum size of a file of a line per pulse, bytes.
pub(super) const MAX_LONG_FILE_BYTES: u64 = 1 << 31;

/// An unexpected row of a file; the text of each error is the expectation.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(super) enum RowProblem {
    /// Other columns.
    #[error("{0}")]
    Columns(String),
    /// Times that do not ascend.
    #[error("a time later than that of the line before")]
    NotLater,
    /// A time outside the duration of a leg, s.
    #[error("a time from 0 to {max} s after the start of the leg")]
    OutsideLeg {
        /// Maximum duration of a leg, s.
        max: f64,
    },
    /// A negative power.
    #[error("a power of at least 0")]
    NegativePower,
    /// An angle out of range.
    #[error("{0}")]
    Angle(&'static str),
    /// Weather out of range.
    #[error("{0}")]
    Weather(&'static str),
    /// Too many samples.
    #[error("at most {max} samples")]
    TooMany {
        /// Maximum number of samples.
        max: usize,
    },
    /// Too few samples, or none with power.
    #[error("at least {min} samples of a pulse, one of them above 0")]
    TooFew {
        /// Minimum number of samples.
        min: usize,
    },
}

/// Passes the rows of the file `name` of at most `max_bytes`, searched from `folder`, to `row`, which returns
/// its expectation. Problems are recorded with file and line; `place` is the place of the reference,
/// `columns` and `help` describe a line.
pub(super) fn read_rows<const N: usize>(
    context: &Context,
    name: &str,
    (folder, max_bytes): (&Path, u64),
    place: &Place,
    (columns, help): (&str, &str),
    row: impl FnMut(&[f64; N]) -> Result<(), RowProblem>,
) -> Option<()> {
    let path = context.file(name, folder, place.clone())?;
    let bytes = match context.read(&path, max_bytes) {
        Ok(bytes) => bytes,
        Err(e) => {
            context.unread(place.clone(), &path, &e);
            return None;
        }
    };
    if let Some(found) = foreign(&path, &bytes, &Expected::NUMBERS) {
        found.report(&path, &mut context.problems.borrow_mut());
        return None;
    }
    let text = context.text(&path, &bytes)?;
    match parse_rows(&text, columns, row) {
        Ok(()) => Some(()),
        Err((number, expected)) => {
            let message = format!("expected {expected}");
            let excerpt = text.lines().nth(number - 1).unwrap_or_default();
            context.error_help(Place::in_line(&path, number, excerpt, 0..excerpt.len()), message, help);
            None
        }
    }
}

/// Parses lines of `N` numbers, separated by comma, semicolon or blanks; empty lines, `#` comments and a
/// header line are skipped.
///
/// # Errors
/// The expected content, with the line number from 1.
pub(super) fn parse_rows<const N: usize>(
    text: &str,
    columns: &str,
    mut row: impl FnMut(&[f64; N]) -> Result<(), RowProblem>,
) -> Result<(), (usize, RowProblem)> {
    let mut header_allowed = true;
    for (i, line) in text.lines().enumerate() {
        let content = line.split('#').next().unwrap_or_default().trim();
        if content.is_empty() {
            continue;
        }
        let fields = || {
            content
                .split(|c: char| c == ',' || c == ';' || c.is_whitespace())
                .filter(|field| !field.is_empty())
        };
        let is_header = header_allowed && fields().all(|field| field.parse::<f64>().is_err());
        header_allowed = false;
        if is_header {
            continue;
        }
        let (mut numbers, mut count) = ([0.0; N], 0);
        for field in fields() {
            let number = field.parse().ok().filter(|number: &f64| number.is_finite());
            if let (Some(place), Some(number)) = (numbers.get_mut(count), number) {
                *place = number;
                count += 1;
            } else {
                count = N + 1;
                break;
            }
        }
        let read = if count == N { row(&numbers) } else { Err(RowProblem::Columns(columns.to_owned())) };
        read.map_err(|expected| (i + 1, expected))?;
    }
    Ok(())
}
