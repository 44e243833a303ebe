//! Rows of numbers in text: separators, header names and units, shared by trajectory files and pose streams.

use std::ops::Range;

/// How the columns of a line are told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Separator {
    /// One character; blanks around it do not count.
    Char(char),
    /// Any run of blanks and tabs.
    Blanks,
}

impl Separator {
    /// The separator that a survey or a user names.
    pub fn named(c: char) -> Separator {
        if c == ' ' { Separator::Blanks } else { Separator::Char(c) }
    }

    /// The separator that `line` most likely uses: semicolon, comma, tab, or blanks.
    pub fn guess(line: &str) -> Separator {
        [';', ',', '\t']
            .into_iter()
            .find(|&c| line.trim().contains(c))
            .map_or(Separator::Blanks, Separator::Char)
    }

    /// The columns of `line` as byte ranges without surrounding blanks.
    pub fn split(self, line: &str) -> Vec<Range<usize>> {
        let mut fields = Vec::with_capacity(8);
        match self {
            Separator::Char(c) => {
                let mut start = 0;
                for part in line.split(c) {
                    fields.push(trimmed(line, start..start + part.len()));
                    start += part.len() + c.len_utf8();
                }
                // A separator at the end of the line starts no further column.
                if fields.len() > 1 && fields.last().is_some_and(|f| f.is_empty()) {
                    fields.pop();
                }
            }
            Separator::Blanks => {
                let mut start = None;
                for (i, c) in line.char_indices() {
                    match (c.is_whitespace(), start) {
                        (false, None) => start = Some(i),
                        (true, Some(s)) => {
                            fields.push(s..i);
                            start = None;
                        }
                        _ => {}
                    }
                }
                if let Some(s) = start {
                    fields.push(s..line.len());
                }
            }
        }
        fields
    }

    /// A word for messages.
    pub fn name(self) -> String {
        match self {
            Separator::Blanks => "blanks".to_owned(),
            Separator::Char('\t') => "tabs".to_owned(),
            Separator::Char(c) => format!("`{c}`"),
        }
    }
}

fn trimmed(line: &str, at: Range<usize>) -> Range<usize> {
    let text = &line[at.clone()];
    let start = at.start + (text.len() - text.trim_start().len());
    start..start + text.trim().len()
}

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quantity {
    Time,
    Roll,
    Pitch,
    Yaw,
    X,
    Y,
    Z,
}

/// All quantities in the order of trajectory files without names.
pub(super) const QUANTITIES: [Quantity; 7] =
    [Quantity::Time, Quantity::Roll, Quantity::Pitch, Quantity::Yaw, Quantity::X, Quantity::Y, Quantity::Z];

impl Quantity {
    /// The name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Quantity::Time => "time",
            Quantity::Roll => "roll",
            Quantity::Pitch => "pitch",
            Quantity::Yaw => "yaw",
            Quantity::X => "x",
            Quantity::Y => "y",
            Quantity::Z => "z",
        }
    }

    pub fn is_angle(self) -> bool {
        matches!(self, Quantity::Roll | Quantity::Pitch | Quantity::Yaw)
    }
}

/// A column's name, taken apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ColumnName {
    pub quantity: Quantity,
    /// Factor to seconds, metres or radians when the name states a unit.
    pub factor: Option<f64>,
    /// X is a longitude, Y a latitude.
    pub geographic: bool,
}

/// Understands `roll`, `Roll[deg]`, `roll_rad`, `heading (deg)`, `gps_time`, `"t"`, `easting` and the like. `Ok(None)` for
/// names of other quantities; an error for units that do not fit.
pub(super) fn column_name(text: &str) -> Result<Option<ColumnName>, String> {
    let lower = text.trim().trim_matches(['"', '\'']).trim().to_ascii_lowercase();
    let (name, unit) = match lower.find(['[', '(']) {
        Some(i) => (lower[..i].trim_end(), Some(lower[i..].trim_matches(['[', ']', '(', ')', ' ']))),
        None => (lower.as_str(), None),
    };
    if let Some(known) = known_name(name) {
        return with_unit(text, known, unit).map(Some);
    }
    match name.rsplit_once('_') {
        Some((stem, suffix)) if unit.is_none() => match known_name(stem) {
            Some(known) => with_unit(text, known, Some(suffix)).map(Some),
            None => Ok(None),
        },
        _ => Ok(None),
    }
}

/// The quantity of that name, and whether it is a latitude or longitude.
fn known_name(name: &str) -> Option<(Quantity, bool)> {
    let quantity = match name {
        "lat" | "latitude" => return Some((Quantity::Y, true)),
        "lon" | "long" | "lng" | "longitude" => return Some((Quantity::X, true)),
        "t" | "time" | "gpstime" | "gps_time" | "timestamp" | "sow" => Quantity::Time,
        "x" | "easting" | "east" | "e" => Quantity::X,
        "y" | "northing" | "north" | "n" => Quantity::Y,
        "z" | "h" | "height" | "altitude" | "alt" | "elevation" | "up" => Quantity::Z,
        "roll" => Quantity::Roll,
        "pitch" => Quantity::Pitch,
        "yaw" | "heading" | "hdg" => Quantity::Yaw,
        _ => return None,
    };
    Some((quantity, false))
}

fn with_unit(
    text: &str,
    (quantity, geographic): (Quantity, bool),
    unit: Option<&str>,
) -> Result<ColumnName, String> {
    let is_angle = |q: Quantity| q.is_angle() || geographic;
    let factor = match (unit, quantity) {
        (None | Some(""), _) => None,
        (Some("s" | "sec" | "seconds"), Quantity::Time) => Some(1.0),
        (Some("ms"), Quantity::Time) => Some(1e-3),
        (Some("us" | "µs"), Quantity::Time) => Some(1e-6),
        (Some("ns"), Quantity::Time) => Some(1e-9),
        (Some("deg" | "degrees" | "°"), q) if is_angle(q) => Some(std::f64::consts::PI / 180.0),
        (Some("rad" | "radians"), q) if is_angle(q) => Some(1.0),
        (Some("m" | "metres" | "meters"), Quantity::X | Quantity::Y | Quantity::Z) if !geographic => {
            Some(1.0)
        }
        (Some(unit), q) => {
            let known = match q {
                Quantity::Time => "s, ms, us or ns",
                Quantity::X | Quantity::Y | Quantity::Z if !geographic => "m",
                _ => "deg or rad",
            };
            return Err(format!("column `{}` is in `{unit}`, expected {known}", text.trim()));
        }
    };
    Ok(ColumnName { quantity, factor, geographic })
}

/// A number as data files write it; NaN and infinity are no numbers.
pub(super) fn number(text: &str) -> Option<f64> {
    text.parse::<f64>().ok().filter(|v| v.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(separator: Separator, line: &str) -> Vec<&str> {
        separator.split(line).into_iter().map(|r| &line[r]).collect()
    }

    #[test]
    fn separators_are_guessed_and_split_without_blanks() {
        assert_eq!(texts(Separator::guess("1, 2,3"), "1, 2,3"), ["1", "2", "3"]);
        assert_eq!(texts(Separator::guess("1;2 ;3;"), "1;2 ;3;"), ["1", "2", "3"]);
        assert_eq!(texts(Separator::guess("  1\t2\t"), "  1\t2\t"), ["1", "2"]);
        assert_eq!(texts(Separator::guess(" 1  2\r"), " 1  2\r"), ["1", "2"]);
        assert_eq!(texts(Separator::Char(','), "1,,3"), ["1", "", "3"]);
    }

    #[test]
    fn names_state_quantity_and_unit() {
        let of = |t: &str| column_name(t).unwrap().map(|c| (c.quantity, c.factor));
        let deg = std::f64::consts::PI / 180.0;
        assert_eq!(of("\"t\""), Some((Quantity::Time, None)));
        assert_eq!(of("GPS_time"), Some((Quantity::Time, None)));
        assert_eq!(of("Heading (deg)"), Some((Quantity::Yaw, Some(deg))));
        assert_eq!(of("roll[rad]"), Some((Quantity::Roll, Some(1.0))));
        assert_eq!(of("pitch_deg"), Some((Quantity::Pitch, Some(deg))));
        assert_eq!(of("time_ns"), Some((Quantity::Time, Some(1e-9))));
        assert_eq!(of("Easting"), Some((Quantity::X, None)));
        assert_eq!(of("velocity_x"), None);
        assert_eq!(of("lat[rad]"), Some((Quantity::Y, Some(1.0))));
        assert!(column_name("longitude").unwrap().unwrap().geographic);
        assert!(column_name("lat[m]").unwrap_err().contains("deg or rad"));
        assert!(column_name("roll[gon]").unwrap_err().contains("gon"));
    }
}
