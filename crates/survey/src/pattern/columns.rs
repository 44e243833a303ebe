//! Names and units of the columns of scan patterns and correction files.

use vlscan_base::diag::nearest;
use vlscan_geom::degrees;
use vlscan_tables::{Dimension, did_you_mean, split_unit};

/// Quantities of columns, in the order of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Column {
    /// s.
    Time,
    /// Number of the pulse.
    Index,
    /// Degrees.
    Azimuth,
    /// Degrees above the horizontal plane.
    Elevation,
    /// Degrees from straight up.
    Zenith,
    /// A whole number.
    Channel,
    /// m.
    OriginX,
    /// m.
    OriginY,
    /// m.
    OriginZ,
    /// rad.
    Divergence,
    /// µs.
    FiringTime,
}

/// Number of quantities.
pub(super) const COLUMNS: usize = 11;

/// Minimum number of letters of a name that a misspelt one may stand for.
const MIN_SIMILAR: usize = 3;

/// A row: a number for each quantity, NaN for those without a column.
pub(super) type Row = [f64; COLUMNS];

/// Names of quantities in messages, and those in headings: lower case, without blanks and punctuation.
const NAMES: [(Column, &str, &[&str]); COLUMNS] = [
    (Column::Time, "time", &["time", "timestamp", "t"]),
    (Column::Index, "index", &["index", "row", "step", "pulse", "number"]),
    (Column::Azimuth, "azimuth", &["azimuth", "az", "azimuthangle"]),
    (Column::Elevation, "elevation", &["elevation", "el", "elevationangle", "altitude"]),
    (Column::Zenith, "zenith", &["zenith", "zenithangle"]),
    (Column::Channel, "channel", &["channel", "laserid", "laser", "ring", "line", "beam", "id"]),
    (Column::OriginX, "origin_x", &["originx", "x"]),
    (Column::OriginY, "origin_y", &["originy", "y"]),
    (Column::OriginZ, "origin_z", &["originz", "z"]),
    (Column::Divergence, "divergence", &["divergence", "beamdivergence"]),
    (Column::FiringTime, "firing_time", &["firingtime", "firetime", "firingoffset"]),
];

impl Column {
    /// Its name in messages.
    pub fn name(self) -> &'static str {
        NAMES[self as usize].1
    }

    /// Factor of a unit in lower case to the unit of the quantity.
    fn factor(self, unit: &str) -> Option<f64> {
        match self {
            Column::Time => Dimension::Time.factor(unit),
            // Divided, so that a microsecond is exactly 1.
            Column::FiringTime => Dimension::Time.factor(unit).map(|factor| factor / 1e-6),
            Column::Azimuth | Column::Elevation | Column::Zenith => {
                Dimension::Angle.factor(unit).map(degrees)
            }
            Column::Divergence => Dimension::Angle.factor(unit),
            Column::OriginX | Column::OriginY | Column::OriginZ => Dimension::Length.factor(unit),
            Column::Index | Column::Channel => None,
        }
    }

    /// The quantity of a heading and the factor of its unit, such as `Azimuth/deg`, `time_us`, `origin x
    /// [mm]`.
    pub fn of_heading(heading: &str) -> Option<(Column, f64)> {
        let (name, bracketed) = split_unit(heading.trim().trim_matches(['"', '\'']));
        let is_part = |c: char| c.is_alphanumeric() || c == '°';
        let words: Vec<String> = name
            .split(|c: char| !is_part(c))
            .filter(|word| !word.is_empty())
            .map(str::to_lowercase)
            .collect();
        let named = |words: &[String]| {
            let joined = words.concat();
            NAMES.iter().find(|(.., names)| names.contains(&joined.as_str())).map(|(column, ..)| *column)
        };
        if let Some(column) = named(&words) {
            return match bracketed {
                Some(unit) => Some((column, column.factor(&unit.to_lowercase())?)),
                None => Some((column, 1.0)),
            };
        }
        let (unit, name) = words.split_last()?;
        let column = named(name).filter(|_| bracketed.is_none())?;
        Some((column, column.factor(unit)?))
    }

    /// The question whether headings that are not read mean quantities other than those of `found`.
    pub fn question(unread: &[impl AsRef<str>], found: &[Column]) -> Option<String> {
        let open = NAMES.iter().filter(|(column, ..)| !found.contains(column));
        let names = open.flat_map(|(_, name, others)| std::iter::once(name).chain(*others));
        let names: Vec<&str> = names.copied().filter(|name| name.len() >= MIN_SIMILAR).collect();
        did_you_mean(unread, |name| nearest(name, names.iter().copied()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_have_names_and_units() {
        for (heading, column, factor) in [
            ("Time/s", Column::Time, 1.0),
            ("time_us", Column::Time, 1e-6),
            ("Azimuth/deg", Column::Azimuth, 1.0),
            ("azimuth [rad]", Column::Azimuth, 180.0 / std::f64::consts::PI),
            ("Zenith/deg", Column::Zenith, 1.0),
            ("Laser id", Column::Channel, 1.0),
            ("fire time(us)", Column::FiringTime, 1.0),
            ("Origin X", Column::OriginX, 1.0),
            ("origin_z_mm", Column::OriginZ, 1e-3),
            ("divergence_mrad", Column::Divergence, 1e-3),
            ("\"elevation\"", Column::Elevation, 1.0),
        ] {
            assert_eq!(Column::of_heading(heading), Some((column, factor)), "{heading}");
        }
        for heading in ["", "azimuth_m", "time [deg]", "intensity", "channel_s", "deg"] {
            assert_eq!(Column::of_heading(heading), None, "{heading}");
        }
    }

    #[test]
    fn misspelt_headings_stand_for_columns_that_are_missing() {
        let ask = |heading: &str| Column::question(&[heading], &[Column::Time]);
        for (heading, name) in [
            ("azimut", "azimuth"),
            ("azimut_deg", "azimuth"),
            ("elev", "elevation"),
            ("Elevaton [deg]", "elevation"),
            ("origin_x_deg", "origin_x"),
            ("chanel", "channel"),
            ("firing_tme_us", "firing_time"),
        ] {
            assert_eq!(ask(heading), Some(format!("did you mean `{name}` by `{heading}`?")), "{heading}");
        }
        for heading in ["intensity", "roll", "note", "i"] {
            assert_eq!(ask(heading), None, "{heading}");
        }
        let both = Column::question(&["azimut", "zenit"], &[]).unwrap();
        assert_eq!(both, "did you mean `azimuth` by `azimut`, `zenith` by `zenit`?");
    }

    #[test]
    fn rows_and_names_have_one_order() {
        assert!(NAMES.iter().enumerate().all(|(i, (column, ..))| *column as usize == i));
    }
}
