//! Which columns of a table hold which attributes of a point.

use super::PointRow;
use crate::geom::DVec3;

/// An attribute of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    /// First coordinate.
    X,
    /// Second coordinate.
    Y,
    /// Third coordinate.
    Z,
    /// First component of the surface normal.
    NormalX,
    /// Second component of the surface normal.
    NormalY,
    /// Third component of the surface normal.
    NormalZ,
    /// Strength of the return.
    Intensity,
    /// Point class.
    Class,
    /// Number of the return.
    ReturnNumber,
    /// The object that was hit.
    Object,
    /// The leg that was flown, from 0.
    Leg,
    /// The device of the scanner, from 0.
    Channel,
    /// Time of the pulse, s.
    Time,
}

impl Attribute {
    pub const COUNT: usize = 13;

    const ALL: [Attribute; Attribute::COUNT] = [
        Attribute::X,
        Attribute::Y,
        Attribute::Z,
        Attribute::NormalX,
        Attribute::NormalY,
        Attribute::NormalZ,
        Attribute::Intensity,
        Attribute::Class,
        Attribute::ReturnNumber,
        Attribute::Object,
        Attribute::Leg,
        Attribute::Channel,
        Attribute::Time,
    ];

    pub const POSITION: [Attribute; 3] = [Attribute::X, Attribute::Y, Attribute::Z];

    /// Attributes whose values in text need not be numbers.
    pub const OPTIONAL: [Attribute; 7] = [
        Attribute::NormalX,
        Attribute::NormalY,
        Attribute::NormalZ,
        Attribute::Object,
        Attribute::Leg,
        Attribute::Channel,
        Attribute::Time,
    ];

    pub const NORMAL: [Attribute; 3] = [Attribute::NormalX, Attribute::NormalY, Attribute::NormalZ];

    /// The names that programs use for the attribute, in lower case and without underscores. If a file has several of
    /// them, the first in this list counts.
    fn names(self) -> &'static [&'static str] {
        match self {
            Attribute::X => &["x"],
            Attribute::Y => &["y"],
            Attribute::Z => &["z"],
            Attribute::NormalX => &["nx", "normalx"],
            Attribute::NormalY => &["ny", "normaly"],
            Attribute::NormalZ => &["nz", "normalz"],
            Attribute::Intensity => &["heliosamplitude", "amplitude", "intensity"],
            Attribute::Class => &["surfaceclass", "classification", "class", "label"],
            Attribute::ReturnNumber => &["returnnumber", "return"],
            Attribute::Object => &["objectid", "hitobjectid", "object", "partid", "part"],
            Attribute::Leg => &["leg", "pointsourceid"],
            Attribute::Channel => &["device", "channel", "userdata", "scannerchannel"],
            Attribute::Time => &["gpstime", "time"],
        }
    }

    /// Description of a value of the attribute, for messages.
    pub fn described(self) -> &'static str {
        match self {
            Attribute::X => "x, a number of metres",
            Attribute::Y => "y, a number of metres",
            Attribute::Z => "z, a number of metres",
            Attribute::NormalX | Attribute::NormalY | Attribute::NormalZ => "a component of the normal",
            Attribute::Intensity => "an intensity",
            Attribute::Class => "a point class",
            Attribute::ReturnNumber => "the number of the return",
            Attribute::Object => "an object",
            Attribute::Leg => "the number of a leg",
            Attribute::Channel => "the number of a channel",
            Attribute::Time => "a time",
        }
    }
}

/// The column of each attribute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Columns([Option<usize>; Attribute::COUNT]);

impl Columns {
    /// Finds the columns by their names, which are compared ignoring case, underscores, units in brackets and the
    /// prefix of CloudCompare's scalar fields.
    pub fn find<'n>(names: impl IntoIterator<Item = &'n str>) -> Columns {
        let names: Vec<String> = names.into_iter().map(plain).collect();
        let column = |attribute: Attribute| {
            attribute.names().iter().find_map(|known| names.iter().position(|name| name == known))
        };
        Columns(Attribute::ALL.map(column))
    }

    /// Adds a column.
    pub fn with(mut self, attribute: Attribute, column: usize) -> Columns {
        self.0[attribute as usize] = Some(column);
        self
    }

    pub fn get(&self, attribute: Attribute) -> Option<usize> {
        self.0[attribute as usize]
    }

    pub fn has(&self, attribute: Attribute) -> bool {
        self.get(attribute).is_some()
    }

    /// The attributes that have a column, with the columns.
    pub fn used(&self) -> impl Iterator<Item = (Attribute, usize)> {
        Attribute::ALL.into_iter().filter_map(|a| Some((a, self.get(a)?)))
    }

    /// The point of a row, where `value(i)` is the number in column `i`. A coordinate without a column is NaN.
    pub fn row(&self, value: impl Fn(usize) -> f64) -> PointRow {
        let number = |attribute| self.get(attribute).map(&value);
        let vector = |of: [Attribute; 3]| DVec3::from(of.map(|a| number(a).unwrap_or(f64::NAN)));
        let has_normal = Attribute::NORMAL.iter().all(|a| self.has(*a));
        // A cast from float saturates; NaN becomes 0.
        PointRow {
            position: vector(Attribute::POSITION),
            normal: has_normal.then(|| vector(Attribute::NORMAL)),
            intensity: number(Attribute::Intensity).unwrap_or(0.0) as f32,
            class: number(Attribute::Class).unwrap_or(0.0) as u8,
            return_number: number(Attribute::ReturnNumber).unwrap_or(0.0) as u8,
            object: number(Attribute::Object).unwrap_or(0.0) as i64,
            leg: number(Attribute::Leg).unwrap_or(0.0) as u16,
            channel: number(Attribute::Channel).unwrap_or(0.0) as u16,
            time: number(Attribute::Time).unwrap_or(0.0),
        }
    }
}

/// Normalises a column's name to the form used in [`Attribute::names`].
fn plain(name: &str) -> String {
    let name = name.find(['[', '(']).map_or(name, |at| &name[..at]);
    let name: String = name.trim().chars().filter(|c| *c != '_').map(|c| c.to_ascii_lowercase()).collect();
    name.strip_prefix("scalar").map(str::to_owned).unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_the_usual_names_and_the_first_of_them_counts() {
        let columns =
            Columns::find(["Intensity", "scalar_Normal_X", "y [m]", "Amplitude", "X", "hitObjectId"]);
        let used: Vec<_> = columns.used().collect();
        use Attribute::{Intensity, NormalX, Object, X, Y};
        assert_eq!(used, [(X, 4), (Y, 2), (NormalX, 1), (Intensity, 3), (Object, 5)]);
        let row = columns.with(Attribute::Z, 0).row(|column| column as f64);
        assert_eq!((row.position, row.normal), (DVec3::new(4.0, 2.0, 0.0), None));
        assert_eq!((row.intensity, row.class, row.object), (3.0, 0, 5));
    }
}
