//! Text files of a few columns of numbers, such as pulse shapes and angles over time.

use super::context::Context;
use std::path::Path;
use vlscan_base::diag::Place;
use vlscan_base::recognise::{Expected, foreign};
use vlscan_tables::{Dimension, join_units, split_suffix, split_unit};

/// Maximum size of a file, bytes.
pub(super) const MAX_FILE_BYTES: u64 = 1 << 24;
/// Maximum size of a file of a line per pulse, bytes.
pub(super) const MAX_LONG_FILE_BYTES: u64 = 1 << 31;

/// Content of the lines of a file, each with `N` numbers.
pub(super) struct RowLayout<const N: usize> {
    /// The expected numbers.
    pub columns: &'static str,
    /// An example.
    pub help: &'static str,
    /// Headings of the columns.
    pub headings: [&'static str; N],
}

/// An unexpected row of a file; the text of each error is the expectation.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(super) enum RowProblem {
    /// Other columns.
    #[error("{0}")]
    Columns(String),
    /// A heading with the name of another column or with another unit.
    #[error("`{expected}` as column {column}, found `{found}`")]
    Heading {
        /// Number of the column, from 1.
        column: usize,
        /// Heading of this column.
        expected: &'static str,
        /// Heading in the file.
        found: String,
    },
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
/// its expectation. Problems are recorded with file and line; `place` is the place of the reference.
pub(super) fn read_rows<const N: usize>(
    context: &Context,
    name: &str,
    (folder, max_bytes): (&Path, u64),
    place: &Place,
    format: &RowLayout<N>,
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
    match parse_rows(&text, format, row) {
        Ok(()) => Some(()),
        Err((number, expected)) => {
            let message = format!("expected {expected}");
            let excerpt = text.lines().nth(number - 1).unwrap_or_default();
            context.error_help(
                Place::in_line(&path, number, excerpt, 0..excerpt.len()),
                message,
                format.help,
            );
            None
        }
    }
}

/// Parses lines of `N` numbers, separated by comma, semicolon or blanks; empty lines, `#` comments and a
/// header line are skipped; the header must not name other columns or units.
///
/// # Errors
/// The expected content, with the line number from 1.
pub(super) fn parse_rows<const N: usize>(
    text: &str,
    format: &RowLayout<N>,
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
            check_headings(content, &format.headings).map_err(|expected| (i + 1, expected))?;
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
        let read =
            if count == N { row(&numbers) } else { Err(RowProblem::Columns(format.columns.to_owned())) };
        read.map_err(|expected| (i + 1, expected))?;
    }
    Ok(())
}

/// Checks the headings of a line against those of the columns.
///
/// # Errors
/// A heading that begins with the name of another column, or that has another unit.
fn check_headings<const N: usize>(line: &str, expected: &[&'static str; N]) -> Result<(), RowProblem> {
    let separator = [';', '\t', ','].into_iter().find(|separator| line.contains(*separator));
    let names: Vec<String> = match separator {
        Some(separator) => line.split(separator).map(str::to_owned).collect(),
        None => join_units(line.split_whitespace()),
    };
    if names.len() != N {
        return Ok(());
    }
    for (index, (name, heading)) in names.iter().zip(expected.iter().copied()).enumerate() {
        let name = name.trim().trim_matches(['"', '\'']).trim();
        let lower = name.to_lowercase();
        let begins_as = |heading: &str| lower.starts_with(heading.split('_').next().unwrap_or(heading));
        let is_other = !begins_as(heading) && expected.iter().copied().any(begins_as);
        let is_in_other_unit = match (unit_of(name), unit_of(heading)) {
            (Some(found), Some(unit)) => found != unit,
            _ => false,
        };
        if is_other || is_in_other_unit {
            return Err(RowProblem::Heading { column: index + 1, expected: heading, found: name.to_owned() });
        }
    }
    Ok(())
}

/// Dimension of the unit in a heading, and its factor to seconds, metres or radians. A heading may be a unit
/// alone.
fn unit_of(heading: &str) -> Option<(Dimension, f64)> {
    let (name, bracketed) = split_unit(heading);
    let at_end = || split_suffix(name, |_| true).map(|(_, unit)| unit);
    let unit = bracketed.or_else(at_end).unwrap_or(name).to_lowercase();
    let dimensions = [Dimension::Time, Dimension::Length, Dimension::Angle];
    dimensions.into_iter().find_map(|dimension| Some((dimension, dimension.factor(&unit)?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_name_the_columns_in_their_order_and_units() {
        let expected = ["time_s", "mor_m", "rain_mm_h", "snow_mm_h", "dust"];
        let check = |line: &str| check_headings(line, &expected).map_err(|problem| problem.to_string());
        for line in [
            "time_s,mor_m,rain_mm_h,snow_mm_h,dust",
            "GPS time [s]; MOR (m); Rain (mm/h); Snow; Dust [1/m]",
            "time (s) mor (m) rain snow dust",
            "time mor rain snow dust",
            "a,b,c,d,e",
            "s,m,mm/h,mm/h,1/m",
            "a heading",
        ] {
            assert_eq!(check(line), Ok(()), "{line}");
        }
        for (line, problem) in [
            ("time_s,dust,rain_mm_h,snow_mm_h,mor_m", "`mor_m` as column 2, found `dust`"),
            ("time_ms,mor_m,rain_mm_h,snow_mm_h,dust", "`time_s` as column 1, found `time_ms`"),
            ("time,mor [km],rain,snow,dust", "`mor_m` as column 2, found `mor [km]`"),
            ("ms;m;mm/h;mm/h;1/m", "`time_s` as column 1, found `ms`"),
            ("rain snow dust mor time", "`time_s` as column 1, found `rain`"),
        ] {
            assert_eq!(check(line), Err(problem.to_owned()), "{line}");
        }
        let angles = |line: &str| check_headings(line, &["time_s", "angle_deg"]).is_ok();
        assert!(angles("time_s,angle_deg") && !angles("time_s,angle_rad") && !angles("angle_deg,time_s"));
    }
}
