//! Assignment of the columns of a table to the attributes of a point, remarks about their names (`remarks`),
//! and values that do not fit (`misfits`).

mod misfits;
mod remarks;

pub use misfits::Misfits;

use super::PointRow;
use vlscan_base::diag::{Problem, ProblemKind, listed};
use vlscan_geom::{DVec3, degrees};
use vlscan_tables::{
    Dimension, ParsedHeading, Quantity, is_usually_unused, parse_heading, plain, split_suffix, split_unit,
};

macro_rules! attributes {
    ($($attribute:ident $quantity:ident, $noun:literal, $described:literal, $whole:expr;)*) => {
        /// An attribute of a point.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Attribute {
            $(#[doc = concat!("Of a point: ", $described, ".")] $attribute,)*
        }

        impl Attribute {
            pub(crate) const ALL: [Attribute; Attribute::COUNT] = [$(Attribute::$attribute),*];

            pub(crate) const COUNT: usize = [$($noun),*].len();
        }

        const ENTRIES: [Entry; Attribute::COUNT] = [$(Entry {
            quantity: Quantity::$quantity,
            noun: $noun,
            described: $described,
            whole_numbers: $whole,
        }),*];
    };
}

/// Facts about an attribute.
struct Entry {
    /// The quantity by whose names and units columns are found.
    quantity: Quantity,
    /// A value, for messages.
    noun: &'static str,
    /// A value with its unit, for messages.
    described: &'static str,
    /// The whole numbers that the attribute can have; `None` for attributes that need not be whole.
    whole_numbers: Option<(f64, f64)>,
}

const BYTE: Option<(f64, f64)> = Some((0.0, 255.0));
const SHORT: Option<(f64, f64)> = Some((0.0, 65_535.0));
const LONG: Option<(f64, f64)> = Some((i64::MIN as f64, i64::MAX as f64));

attributes! {
    X X, "x", "x, a number of metres", None;
    Y Y, "y", "y, a number of metres", None;
    Z Z, "z", "z, a number of metres", None;
    NormalX NormalX, "normal", "a component of the normal", None;
    NormalY NormalY, "normal", "a component of the normal", None;
    NormalZ NormalZ, "normal", "a component of the normal", None;
    Intensity Intensity, "intensity", "an intensity", None;
    Class Class, "class", "a point class", BYTE;
    ReturnNumber ReturnNumber, "return number", "the number of the return", BYTE;
    NumberOfReturns NumberOfReturns, "number of returns", "the number of returns of the pulse", BYTE;
    ScanAngle ScanAngle, "scan angle", "a scan angle, a number of degrees", None;
    Object Object, "object", "an object", LONG;
    Leg Source, "leg", "the number of a leg", SHORT;
    Channel Channel, "channel", "the number of a channel", SHORT;
    Time Time, "time", "a time", None;
    Path LightPath, "path of the light", "the path of the light", BYTE;
}

impl Attribute {
    /// The coordinates, in the order x, y, z.
    pub const POSITION: [Attribute; 3] = [Attribute::X, Attribute::Y, Attribute::Z];

    /// The components of the surface normal, in the order x, y, z.
    pub const NORMAL: [Attribute; 3] = [Attribute::NormalX, Attribute::NormalY, Attribute::NormalZ];

    /// True if values in text need not be numbers.
    pub fn is_optional(self) -> bool {
        use Attribute::{
            Channel, Leg, NormalX, NormalY, NormalZ, NumberOfReturns, Object, Path, ScanAngle, Time,
        };
        matches!(
            self,
            NormalX | NormalY | NormalZ | Object | Leg | Channel | Time | NumberOfReturns | ScanAngle | Path
        )
    }

    fn entry(self) -> &'static Entry {
        &ENTRIES[self as usize]
    }

    fn quantity(self) -> Quantity {
        self.entry().quantity
    }

    fn has_name(self, plain: &str) -> bool {
        self.quantity().rank(plain).is_some()
    }

    /// The quantity of the values, if units count for it.
    fn dimension(self) -> Option<Dimension> {
        let dimension = self.quantity().dimension();
        matches!(dimension, Dimension::Time | Dimension::Length | Dimension::Angle).then_some(dimension)
    }

    /// Description of values that do not fit the attribute and of their replacement, for messages.
    pub fn misfit(self) -> String {
        let kind = match self.entry().whole_numbers {
            None => return format!("{} that is not a number; it is read as 0", self.described()),
            Some((min, _)) if min < 0.0 => "whole number".to_owned(),
            Some((min, max)) => format!("whole number from {min} to {max}"),
        };
        let noun = self.entry().noun;
        format!("a {noun} that is not a {kind}; it is truncated, or read as 0 if it is not a number")
    }

    /// Description of a value of the attribute, for messages.
    pub fn described(self) -> &'static str {
        self.entry().described
    }
}

/// A name in tables of points by this program, and in no tables by other programs.
const OWN_NAME: &str = "pulsenumber";
/// A name that its tables have if they have pulses without a return.
const NAME_OF_MISSES: &str = "beamdirectionx";
/// Names in tables and files of this program. In others a column `path` is something else, such as a file.
const NAMES_BESIDE_PATHS: [&str; 4] = ["pathorder", "surfacex", OWN_NAME, "fullwaveindex"];

/// Maximum number of names in a message.
const MAX_LISTED_NAMES: usize = 8;

/// A set of attributes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AttributeSet {
    attributes: [bool; Attribute::COUNT],
    /// True if points have colours, which are not an attribute: few readers use them.
    colours: bool,
}

impl AttributeSet {
    /// The attributes for which `has` is true, without colours.
    pub fn of(has: impl Fn(Attribute) -> bool) -> AttributeSet {
        AttributeSet { attributes: Attribute::ALL.map(has), colours: false }
    }

    /// This set with or without colours.
    #[must_use]
    pub fn with_colours(self, colours: bool) -> AttributeSet {
        AttributeSet { colours, ..self }
    }

    /// True if `attribute` is in the set.
    pub fn has(&self, attribute: Attribute) -> bool {
        self.attributes[attribute as usize]
    }

    /// True if some points may have colours.
    pub fn has_colours(&self) -> bool {
        self.colours
    }
}

/// The column of each attribute, and the units of the coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Columns {
    columns: [Option<usize>; Attribute::COUNT],
    /// The columns of red, green and blue, which are not attributes: few readers use them.
    colours: Option<[usize; 3]>,
    /// Metres in a unit of x, y and z.
    metres: DVec3,
    /// Seconds in a unit of time.
    seconds: f64,
    /// Degrees in a unit of the scan angle.
    degrees: f64,
    /// True if the table is one of this program, in which return 0 of 0 marks a pulse without a return.
    is_own: bool,
}

impl Default for Columns {
    fn default() -> Columns {
        let columns = [None; Attribute::COUNT];
        Columns { columns, colours: None, metres: DVec3::ONE, seconds: 1.0, degrees: 1.0, is_own: false }
    }
}

/// Names of columns without positions.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PositionsError {
    /// The coordinates are longitude and latitude.
    #[error(
        "its coordinates are longitude and latitude ({found}); project them, for example with PDAL's \
         filters.reprojection"
    )]
    Geographic {
        /// The names.
        found: String,
    },
    /// Some coordinates have no column.
    #[error(
        "no column {} with numbers; there are {found}{}",
        .missing.join(" and "),
        clause(.question.as_deref())
    )]
    Missing {
        /// The coordinates without a column: x, y, z.
        missing: Vec<&'static str>,
        /// The names.
        found: String,
        /// The question whether some of them are misspelt.
        question: Option<String>,
    },
}

/// A question at the end of a message.
fn clause(question: Option<&str>) -> String {
    question.map_or(String::new(), |question| format!("; {question}"))
}

impl Problem for PositionsError {
    fn kind(&self) -> ProblemKind {
        match self {
            PositionsError::Geographic { .. } => ProblemKind::Unsupported,
            PositionsError::Missing { .. } => ProblemKind::Invalid,
        }
    }
}

impl Columns {
    /// Finds the columns by their names, which are those of [`Quantity`]. Units in brackets or at the end of
    /// a name count for coordinates, times and angles.
    pub fn find<'n>(names: impl IntoIterator<Item = &'n str>) -> Columns {
        let headings: Vec<&str> = names.into_iter().collect();
        let names: Vec<String> = headings.iter().copied().map(name_of).collect();
        let position = |known: &str| names.iter().position(|name| name == known);
        let mut columns = Attribute::ALL.map(|attribute| attribute.quantity().names().find_map(position));
        // The intensity of this program's own tables is the logarithm of their amplitude.
        if position(OWN_NAME).is_some() {
            let amplitude = ["heliosamplitude", "amplitude"].into_iter().find_map(position);
            columns[Attribute::Intensity as usize] = amplitude.or(columns[Attribute::Intensity as usize]);
        }
        if NAMES_BESIDE_PATHS.into_iter().find_map(position).is_none() {
            columns[Attribute::Path as usize] = None;
        }
        let unit = |attribute: Attribute| {
            let column = columns[attribute as usize];
            column.and_then(|column| factor(attribute, headings[column])).unwrap_or(1.0)
        };
        let metres = DVec3::from(Attribute::POSITION.map(unit));
        let (seconds, degrees) = (unit(Attribute::Time), unit(Attribute::ScanAngle));
        let is_own = [OWN_NAME, NAME_OF_MISSES].into_iter().any(|name| position(name).is_some());
        let colours = match ["red", "green", "blue"].map(position) {
            [Some(red), Some(green), Some(blue)] => Some([red, green, blue]),
            _ => None,
        };
        Columns { columns, colours, metres, seconds, degrees, is_own }
    }

    /// Finds the columns of positions and other attributes by their names.
    ///
    /// # Errors
    /// Names without coordinates, with only some of them, or with longitude and latitude.
    pub fn find_positions(names: &[&str]) -> Result<Columns, PositionsError> {
        let columns = Columns::find(names.iter().copied());
        let missing: Vec<&'static str> = Attribute::POSITION
            .iter()
            .zip(["x", "y", "z"])
            .filter(|(axis, _)| !columns.has(**axis))
            .map(|(_, name)| name)
            .collect();
        let are_degrees = |name: &&str| is_angle(name);
        if missing.is_empty()
            && !Attribute::POSITION.iter().any(|a| columns.get(*a).is_some_and(|c| are_degrees(&names[c])))
        {
            return Ok(columns);
        }
        let named: Vec<&str> = names.iter().filter(|name| !name.is_empty()).copied().collect();
        let found = listed(&named, MAX_LISTED_NAMES);
        if names.iter().any(are_degrees) {
            return Err(PositionsError::Geographic { found });
        }
        let question = columns.question(&named);
        Err(PositionsError::Missing { missing, found, question })
    }

    /// The names of the columns that are not read, or only counted.
    pub fn unread(&self, names: &[&str]) -> Vec<String> {
        let is_colour = |column: &usize| self.colours.iter().flatten().any(|colour| colour == column);
        let is_unread = |(column, name): &(usize, &&str)| {
            let is_used =
                |(attribute, used): (Attribute, usize)| used == *column && attribute != Attribute::Path;
            !name.is_empty() && !is_colour(column) && !self.used().any(is_used)
        };
        names.iter().enumerate().filter(is_unread).map(|(_, name)| (*name).to_owned()).collect()
    }

    /// Adds a column.
    pub fn with(mut self, attribute: Attribute, column: usize) -> Columns {
        self.columns[attribute as usize] = Some(column);
        self
    }

    /// The columns of red, green and blue, if there are all three.
    pub fn colours(&self) -> Option<[usize; 3]> {
        self.colours
    }

    /// Replaces the columns of red, green and blue.
    #[must_use]
    pub fn with_colours(self, colours: Option<[usize; 3]>) -> Columns {
        Columns { colours, ..self }
    }

    /// The columns of a table of this program if `is_own` is set, in which return 0 of 0 marks a pulse
    /// without a return.
    pub(crate) fn of_own_table(self, is_own: bool) -> Columns {
        Columns { is_own: self.is_own || is_own, ..self }
    }

    /// Removes the columns of some attributes.
    pub fn without(mut self, attributes: &[Attribute]) -> Columns {
        attributes.iter().for_each(|attribute| self.columns[*attribute as usize] = None);
        self
    }

    /// The columns of some attributes alone.
    pub(crate) fn only(self, attributes: &[Attribute]) -> Columns {
        let others: Vec<Attribute> = Attribute::ALL.into_iter().filter(|a| !attributes.contains(a)).collect();
        self.without(&others).with_colours(None)
    }

    /// Index of the column that holds `attribute`, from 0; `None` without such a column.
    pub fn get(&self, attribute: Attribute) -> Option<usize> {
        self.columns[attribute as usize]
    }

    pub(crate) fn has(&self, attribute: Attribute) -> bool {
        self.get(attribute).is_some()
    }

    /// The attributes that have a column, and colours if these have.
    pub fn attributes(&self) -> AttributeSet {
        AttributeSet::of(|attribute| self.has(attribute)).with_colours(self.colours.is_some())
    }

    /// The attributes that have a column, with the columns.
    pub fn used(&self) -> impl Iterator<Item = (Attribute, usize)> {
        Attribute::ALL.into_iter().filter_map(|a| Some((a, self.get(a)?)))
    }

    /// The point of a row, where `value(i)` is the number in column `i`. A coordinate without a column is
    /// NaN; values that do not fit are noted in the row.
    pub fn row(&self, value: impl Fn(usize) -> f64) -> PointRow {
        self.row_of(&self.columns.map(|column| column.map(&value)), value)
    }

    /// The point with these numbers, one for each attribute that has a column, and with colours by
    /// `value(i)`, as in [`row`](Columns::row).
    pub(crate) fn row_of(
        &self,
        numbers: &[Option<f64>; Attribute::COUNT],
        value: impl Fn(usize) -> f64,
    ) -> PointRow {
        let number = |attribute: Attribute| numbers[attribute as usize];
        let vector = |of: [Attribute; 3]| DVec3::from(of.map(|a| number(a).unwrap_or(f64::NAN)));
        let has_normal = Attribute::NORMAL.iter().all(|a| self.has(*a));
        let mut misfits = Misfits::default();
        let mut fitted = |attribute| number(attribute).map_or(0.0, |value| misfits.fitted(attribute, value));
        let is_zero = |attribute| number(attribute) == Some(0.0);
        PointRow {
            position: vector(Attribute::POSITION) * self.metres,
            normal: has_normal.then(|| vector(Attribute::NORMAL)),
            intensity: number(Attribute::Intensity).unwrap_or(0.0) as f32,
            class: fitted(Attribute::Class) as u8,
            return_number: fitted(Attribute::ReturnNumber) as u8,
            number_of_returns: fitted(Attribute::NumberOfReturns) as u8,
            is_miss: self.is_own && is_zero(Attribute::ReturnNumber) && is_zero(Attribute::NumberOfReturns),
            scan_angle: fitted(Attribute::ScanAngle) * self.degrees,
            object: fitted(Attribute::Object) as i64,
            leg: fitted(Attribute::Leg) as u16,
            point_source: 0,
            channel: fitted(Attribute::Channel) as u16,
            time: fitted(Attribute::Time) * self.seconds,
            path: fitted(Attribute::Path) as u8,
            // The conversion saturates, and NaN becomes 0.
            colour: self.colours.map(|columns| columns.map(|column| value(column).round() as u16)),
            misfits,
        }
    }
}

/// The name of a heading without its unit, in the form of [`plain`].
fn name_of(heading: &str) -> String {
    let (name, bracketed) = split_unit(heading);
    let whole = plain(name);
    let is_known = |name: &str| Attribute::ALL.iter().any(|attribute| attribute.has_name(name));
    if bracketed.is_some() || is_known(&whole) || is_usually_unused(&whole) {
        return whole;
    }
    let quantities = Attribute::ALL.into_iter().map(Attribute::quantity);
    match parse_heading(name, quantities) {
        Ok(ParsedHeading { factor: Some(_), .. }) => {
            split_suffix(name, |stem| is_known(&plain(stem))).map_or(whole, |(stem, _)| plain(stem))
        }
        _ => whole,
    }
}

/// The unit in brackets or at the end of a heading.
fn unit_of(heading: &str) -> Option<&str> {
    let (name, bracketed) = split_unit(heading);
    let has_suffix = || name_of(heading) != plain(name);
    let is_known = |stem: &str| Attribute::ALL.iter().any(|attribute| attribute.has_name(&plain(stem)));
    bracketed.or_else(|| split_suffix(name, is_known).filter(|_| has_suffix()).map(|(_, unit)| unit))
}

/// Metres, seconds or degrees in the unit of a column; `None` without a unit that is known.
fn factor(attribute: Attribute, heading: &str) -> Option<f64> {
    let dimension = attribute.dimension()?;
    let factor = dimension.factor(&unit_of(heading)?.to_lowercase())?;
    Some(if dimension == Dimension::Angle { degrees(factor) } else { factor })
}

/// True if a name is that of a geographic coordinate, or has a unit of angles and is one of a horizontal
/// coordinate.
fn is_angle(heading: &str) -> bool {
    let name = name_of(heading);
    let is_horizontal = [Attribute::X, Attribute::Y].iter().any(|axis| axis.has_name(&name));
    let is_unit = unit_of(heading).is_some_and(|unit| {
        let unit = unit.trim_end_matches('.').to_lowercase();
        unit == "degree" || unit == "radian" || Dimension::Angle.factor(&unit).is_some()
    });
    let is_geographic =
        [Quantity::Longitude, Quantity::Latitude].iter().any(|axis| axis.rank(&name).is_some());
    is_geographic || is_horizontal && is_unit
}

#[cfg(test)]
mod tests;
