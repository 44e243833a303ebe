//! A heading as a name and a unit.

use super::dimension::Dimension;
use super::vocabulary::{Quantity, plain};

/// Units that no column here has and that are recognised at the end of a name.
const OTHER_UNITS: [&str; 11] =
    ["gon", "kg", "hz", "khz", "kn", "kmh", "mps", "db", "volt", "percent", "celsius"];

/// A heading whose name is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParsedHeading {
    /// The quantity that the name stands for.
    pub quantity: Quantity,
    /// Factor to seconds, metres or radians; `None` if the heading has no unit.
    pub factor: Option<f64>,
}

/// Reasons why a heading cannot be parsed.
#[derive(Clone, Debug, PartialEq)]
pub enum HeadingError {
    /// The name, without its unit, is not among the known ones.
    UnknownName(String),
    /// The unit does not match the quantity of the column: the quantity, the unit, and the expected ones.
    WrongUnit(Quantity, String, String),
}

/// Splits a heading into its name and the unit in brackets behind it (`Roll[deg]`, `heading (deg)`); an empty
/// unit is none.
pub fn split_unit(heading: &str) -> (&str, Option<&str>) {
    let Some(open) = heading.find(['[', '(', '{']) else { return (heading, None) };
    let unit = heading[open + 1..].split([']', ')', '}']).next().unwrap_or_default();
    let unit = unit.trim().trim_end_matches('.');
    (heading[..open].trim_end(), Some(unit).filter(|unit| !unit.is_empty()))
}

/// Appends units in brackets that stand alone, as in `roll (deg) pitch (deg)` between blanks, to the names
/// before them.
pub fn join_units(names: impl IntoIterator<Item = impl AsRef<str>>) -> Vec<String> {
    let mut joined: Vec<String> = Vec::new();
    for name in names {
        let name = name.as_ref();
        let is_unit = |name: &str| name.starts_with(['(', '[']) && name.ends_with([')', ']']);
        match joined.last_mut() {
            Some(last) if is_unit(name) && !last.ends_with([')', ']']) => last.push_str(name),
            _ => joined.push(name.to_owned()),
        }
    }
    joined
}

/// Parses a heading: a name, quoted or not, with a unit in brackets or at its end (`time_ns`, `Height.cm`, `z
/// ft`). `quantities` are those that the table may have; the first one that has the name counts.
///
/// # Errors
/// An unknown name, or a unit of another dimension.
pub fn parse_heading(
    text: &str,
    quantities: impl IntoIterator<Item = Quantity> + Clone,
) -> Result<ParsedHeading, HeadingError> {
    let (name, bracketed) = split_unit(text.trim().trim_matches(['"', '\'']).trim());
    let known = |name: &str| {
        let name = plain(name);
        Quantity::of_name(&name, quantities.clone())
    };
    let found = known(name).map(|quantity| (quantity, bracketed.map(str::to_lowercase)));
    let found = found.or_else(|| {
        let suffix = split_suffix(name, |stem| known(stem).is_some()).filter(|_| bracketed.is_none());
        suffix.and_then(|(stem, unit)| Some((known(stem)?, Some(unit.to_lowercase()))))
    });
    let Some((quantity, unit)) = found else { return Err(HeadingError::UnknownName(name.to_owned())) };
    let Some(unit) = unit.filter(|_| quantity.dimension() != Dimension::Text) else {
        return Ok(ParsedHeading { quantity, factor: None });
    };
    let factor = quantity.dimension().factor(&unit).ok_or_else(|| {
        let found = format!("column `{}` is in `{unit}`", text.trim());
        HeadingError::WrongUnit(quantity, found, format!("expected {}", quantity.dimension().units()))
    })?;
    Ok(ParsedHeading { quantity, factor: Some(factor) })
}

/// Splits a unit off the end of a name (`x_us-ft`, `Height.cm`, `z ft`), the longest that leaves a known
/// name.
pub fn split_suffix(name: &str, is_known: impl Fn(&str) -> bool) -> Option<(&str, &str)> {
    let separators = name.char_indices().filter(|(_, c)| matches!(c, '_' | '.' | ' ' | '-'));
    let mut parts = separators.map(|(at, _)| (&name[..at], &name[at + 1..]));
    parts.find(|(stem, unit)| {
        let unit = unit.to_lowercase();
        // Degrees by one letter are a unit in brackets only: `crown_d` is a diameter.
        is_unit(&unit) && unit != "d" && is_known(stem)
    })
}

/// The question whether headings with unknown names, and perhaps units, mean the names that `similar` finds
/// for them; `None` if it finds none.
pub fn did_you_mean<'n>(
    headings: impl IntoIterator<Item = impl AsRef<str>>,
    similar: impl Fn(&str) -> Option<&'n str>,
) -> Option<String> {
    let near = |heading: &str| {
        let (name, _) = split_unit(heading.trim().trim_matches(['"', '\'']));
        let stem = || split_suffix(name, |stem| similar(stem).is_some()).map(|(stem, _)| stem);
        similar(name).or_else(|| similar(stem()?))
    };
    let pairs = headings.into_iter().filter_map(|heading| {
        let heading = heading.as_ref().trim();
        Some(format!("`{}` by `{heading}`", near(heading)?))
    });
    let pairs: Vec<String> = pairs.collect();
    (!pairs.is_empty()).then(|| format!("did you mean {}?", pairs.join(", ")))
}

/// True if a text in lower case is a unit of any dimension.
fn is_unit(text: &str) -> bool {
    OTHER_UNITS.contains(&text)
        || Dimension::MEASURED.iter().any(|dimension| dimension.factor(text).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSE: [Quantity; 4] = [Quantity::Time, Quantity::X, Quantity::Z, Quantity::Roll];

    #[test]
    fn headings_have_units_in_brackets_or_at_their_end() {
        let parse = |text: &str| parse_heading(text, POSE).map(|found| (found.quantity, found.factor));
        for (text, quantity, factor) in [
            ("time", Quantity::Time, None),
            ("#timestamp [ns]", Quantity::Time, Some(1e-9)),
            ("GPSTime(sec)", Quantity::Time, Some(1.0)),
            ("x[]", Quantity::X, None),
            ("tree_x", Quantity::X, None),
            ("x_ft", Quantity::X, Some(0.3048)),
            ("x_us-ft", Quantity::X, Some(1200.0 / 3937.0)),
            ("Height.cm", Quantity::Z, Some(0.01)),
            ("\"ELLIPSOID HEIGHT\"", Quantity::Z, None),
            ("Roll(d)", Quantity::Roll, Some(std::f64::consts::PI / 180.0)),
            ("roll rad", Quantity::Roll, Some(1.0)),
            ("roll_dd", Quantity::Roll, Some(std::f64::consts::PI / 180.0)),
        ] {
            assert_eq!(parse(text), Ok((quantity, factor)), "{text}");
        }
        for text in ["roll_sd", "x_low", "time_offset", "height above ground", "tree", "roll_d"] {
            assert!(matches!(parse(text), Err(HeadingError::UnknownName(_))), "{text}: {:?}", parse(text));
        }
        for text in ["roll[m]", "time_deg", "x[furlong]", "z_kg"] {
            assert!(matches!(parse(text), Err(HeadingError::WrongUnit(..))), "{text}: {:?}", parse(text));
        }
    }

    #[test]
    fn units_that_stand_alone_belong_to_the_name_before() {
        assert_eq!(join_units(["Lat", "(deg)", "h", "[m]", "[x]"]), ["Lat(deg)", "h[m]", "[x]"]);
    }
}
