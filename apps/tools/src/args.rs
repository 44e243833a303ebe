//! Values of options: their bounds, which programs may break, and their texts on command lines.

use vlscan_base::error::Error;
use vlscan_base::quantity::{Bounds, COORDINATE, NumberError, POSITIVE, number, parse_count};

/// Directions, degrees.
pub const HEADING: Bounds = Bounds::new(-360.0, 360.0, "degrees from -360 to 360");
/// Angles of a climb, degrees.
pub const CLIMB: Bounds = Bounds::new(0.01, 89.0, "degrees from 0.01 to 89");
/// Overlaps of strips, percent.
pub const OVERLAP: Bounds =
    Bounds::new(-1000.0, 99.0, "percent of the swath, at most 99; below 0 leaves gaps");
/// Growth, percent.
pub const GROWTH: Bounds = Bounds::new(-90.0, 900.0, "percent from -90 to 900");
/// Standard deviations, m.
pub const DEVIATION: Bounds = Bounds::new(0.0, 1e6, "metres from 0 to 1e6");
/// Shares, percent.
pub const SHARE: Bounds = Bounds::new(0.0, 100.0, "percent from 0 to 100");

/// A value that a program gave for an option, beyond its bounds.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("--{option} {value}: expected {expected}", value = number(*.value))]
pub struct OptionError {
    /// Name of the option, without dashes.
    pub option: &'static str,
    /// The value.
    pub value: f64,
    /// The numbers that are accepted.
    pub expected: &'static str,
}

impl From<OptionError> for Error {
    fn from(error: OptionError) -> Error {
        Error::input(error.to_string())
    }
}

/// A text that is not a value of an option.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OptionTextError {
    /// A text that is not a count, or a count of 0 where one is needed.
    #[error("expected a number such as 250000 or 250k, found {0:?}")]
    Count(String),
    /// A text that is not a number within the bounds, which are described.
    #[error("expected {0}")]
    Number(&'static str),
    /// A fraction in place of a percentage.
    #[error(
        "it is in percent: {percent} for that part of the swath, or \"{0}%\" if less than one percent is \
         meant",
        percent = number(*.0 * 100.0)
    )]
    Fraction(f64),
    /// A text that is not a position.
    #[error("expected x,y in metres, such as 120.5,-30")]
    Position,
}

/// Checks values that are given, by the names of their options.
///
/// # Errors
/// The first one that is beyond its bounds.
pub fn check<const N: usize>(values: [(&'static str, Option<f64>, Bounds); N]) -> Result<(), OptionError> {
    for (option, value, bounds) in values {
        if let Some(value) = value.filter(|value| !bounds.contains(*value)) {
            return Err(OptionError { option, value, expected: bounds.expected });
        }
    }
    Ok(())
}

/// A finite number above 0.
pub fn positive(text: &str) -> Result<f64, NumberError> {
    POSITIVE.parse(text)
}

/// The seed of random draws.
pub fn seed(text: &str) -> Result<u64, OptionTextError> {
    text.parse().map_err(|_| OptionTextError::Number("a whole number, 0 or greater"))
}

/// A whole number with an optional unit prefix: 250k.
pub fn count(text: &str) -> Result<u64, OptionTextError> {
    parse_count(text).ok_or_else(|| OptionTextError::Count(text.to_owned()))
}

/// [`count`] of at least 1.
pub fn number_of_points(text: &str) -> Result<usize, OptionTextError> {
    match count(text)? {
        0 => Err(OptionTextError::Count(text.to_owned())),
        count => Ok(usize::try_from(count).unwrap_or(usize::MAX)),
    }
}

/// Growth, percent.
pub fn growth(text: &str) -> Result<f64, NumberError> {
    GROWTH.parse(text.trim_end_matches('%'))
}

/// A share, percent.
pub fn share(text: &str) -> Result<f64, NumberError> {
    SHARE.parse(text.trim_end_matches('%'))
}

/// A standard deviation, m.
pub fn deviation(text: &str) -> Result<f64, NumberError> {
    DEVIATION.parse(text)
}

/// A coordinate, m.
pub fn coordinate(text: &str) -> Result<f64, OptionTextError> {
    bounded(text, COORDINATE)
}

/// A direction, degrees.
pub fn heading(text: &str) -> Result<f64, OptionTextError> {
    bounded(text, HEADING)
}

/// The angle of a climb, degrees.
pub fn climb(text: &str) -> Result<f64, OptionTextError> {
    bounded(text, CLIMB)
}

fn bounded(text: &str, bounds: Bounds) -> Result<f64, OptionTextError> {
    bounds.parse(text).map_err(|_| OptionTextError::Number(bounds.expected))
}

/// The overlap of strips, percent.
pub fn overlap(text: &str) -> Result<f64, OptionTextError> {
    let is_marked = text.trim_end().ends_with('%');
    match text.trim_end_matches('%').trim().parse::<f64>() {
        Ok(part) if !is_marked && part != 0.0 && part.abs() < 1.0 => Err(OptionTextError::Fraction(part)),
        Ok(percent) if OVERLAP.contains(percent) => Ok(percent),
        _ => Err(OptionTextError::Number(OVERLAP.expected)),
    }
}

/// A position: `x,y`, m.
pub fn position(text: &str) -> Result<[f64; 2], OptionTextError> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.map(<[f64; 2]>::try_from) {
        Some(Ok(position)) if position.iter().all(|v| COORDINATE.contains(*v)) => Ok(position),
        _ => Err(OptionTextError::Position),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_the_option_and_the_numbers_that_are_accepted() {
        let checked = check([("height", Some(5.0), POSITIVE), ("overlap", Some(120.0), OVERLAP)]);
        let error = checked.unwrap_err();
        assert_eq!((error.option, error.value), ("overlap", 120.0));
        let text = "--overlap 120: expected percent of the swath, at most 99; below 0 leaves gaps";
        assert_eq!(error.to_string(), text);
        assert_eq!(check([("height", None, POSITIVE)]), Ok(()));
    }

    #[test]
    fn overlaps_below_one_are_taken_for_fractions_unless_marked() {
        assert_eq!([overlap("30"), overlap("0.5%"), overlap("0")], [Ok(30.0), Ok(0.5), Ok(0.0)]);
        let error = overlap("0.25").unwrap_err();
        assert_eq!(error, OptionTextError::Fraction(0.25));
        let text = "it is in percent: 25 for that part of the swath, or \"0.25%\" if less than one percent \
                    is meant";
        assert_eq!(error.to_string(), text);
    }
}
