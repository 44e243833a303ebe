//! Headings of inventories, in English and German.

use vlscan_base::columns::{Dimension, HeadingError, parse_heading};
use vlscan_base::diag::{Diagnostics, Place, nearest};

/// What to do with longitudes and latitudes.
pub(super) const PROJECT: &str =
    "project them to the terrain's system, in metres: gdaltransform -s_srs EPSG:4326 -t_srs EPSG:25832";

/// The columns of an inventory, for messages.
const KNOWN: &str = "an inventory has the columns x, y, height (Rechtswert, Hochwert, Höhe), and optionally crown, dbh, species, id, z; units follow the name: dbh_cm";

/// What a column of an inventory holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum InventoryColumn {
    Id,
    X,
    Y,
    Z,
    Height,
    Crown,
    /// Stem diameter at breast height; without a unit m, or cm as foresters write it.
    Stem,
    Species,
    /// Longitude or latitude.
    Degrees,
}

/// The columns with their names, in lower case, with blanks between them.
const NAMES: [(InventoryColumn, &str); 9] = [
    (
        InventoryColumn::Id,
        "id tree tree_id treeid tree_nr treenr tree_no treeno name label nr no number baum baumnr baum_nr \
         baum_id baumid baumnummer nummer",
    ),
    (InventoryColumn::X, "x easting east e rechtswert ostwert rw x_utm utm_x x_coord coord_x"),
    (InventoryColumn::Y, "y northing north n hochwert nordwert hw y_utm utm_y y_coord coord_y"),
    (InventoryColumn::Z, "z elevation ground geländehöhe gelaendehoehe"),
    (InventoryColumn::Height, "height h tree_height total_height höhe hoehe baumhöhe baumhoehe scheitelhöhe"),
    (
        InventoryColumn::Crown,
        "crown crown_diameter crowndiameter crown_width cd krone kronendurchmesser kronenbreite kd",
    ),
    (InventoryColumn::Stem, "dbh bhd diameter stem_diameter d13 d1.3 brusthöhendurchmesser durchmesser"),
    (InventoryColumn::Species, "species type art baumart holzart"),
    (
        InventoryColumn::Degrees,
        "lon long lng longitude lat latitude länge laenge breite längengrad breitengrad",
    ),
];

fn names_of(names: &'static str) -> impl Iterator<Item = &'static str> {
    names.split(' ')
}

/// A column by its name; names that differ from it by K for C are those of the column if they are of no other.
fn known(name: &str) -> Option<(InventoryColumn, Dimension)> {
    let column_of = |is_name: &dyn Fn(&str) -> bool| {
        let mut columns =
            NAMES.iter().filter(|(_, names)| names_of(names).any(is_name)).map(|(column, _)| column);
        columns.next().filter(|_| columns.next().is_none())
    };
    let with_k = |name: &str| name.replace('c', "k");
    let column =
        column_of(&|known| known == name).or_else(|| column_of(&|known| with_k(known) == with_k(name)))?;
    let dimension = match column {
        InventoryColumn::Id | InventoryColumn::Species => Dimension::Count,
        InventoryColumn::Degrees => Dimension::Angle,
        _ => Dimension::Length,
    };
    Some((*column, dimension))
}

/// A column that is read.
#[derive(Clone, Debug)]
pub(super) struct Heading {
    pub column: InventoryColumn,
    /// As written.
    pub name: String,
    /// Factor to m, if the heading has a unit.
    pub factor: Option<f64>,
}

/// The columns of a table, `None` for those that are not read.
#[derive(Clone, Debug, Default)]
pub(super) struct Headings {
    pub columns: Vec<Option<Heading>>,
    /// Names that are not known.
    unknown: Vec<String>,
    /// Names of what another column has already, and the name of that.
    repeated: Vec<(String, String)>,
    /// Units that do not suit their column.
    wrong_units: Vec<String>,
    /// Names of columns in degrees.
    degrees: Vec<String>,
}

impl Headings {
    pub fn read(names: &[String]) -> Headings {
        let mut headings = Headings::default();
        for name in names {
            let heading = headings.heading(name);
            headings.columns.push(heading);
        }
        headings
    }

    fn heading(&mut self, name: &str) -> Option<Heading> {
        let found = match parse_heading(name, known) {
            Ok(found) => found,
            Err(HeadingError::UnknownName(_)) => {
                self.unknown.extend((!name.is_empty()).then(|| name.to_owned()));
                return None;
            }
            Err(HeadingError::WrongUnit(what, expected)) => {
                self.wrong_units.push(format!("{what}, {expected}"));
                return None;
            }
        };
        if found.column == InventoryColumn::Degrees {
            self.degrees.push(name.to_owned());
            return None;
        }
        if let Some(earlier) = self.columns.iter().flatten().find(|h| h.column == found.column) {
            self.repeated.push((name.to_owned(), earlier.name.clone()));
            return None;
        }
        let factor =
            found.factor.filter(|_| !matches!(found.column, InventoryColumn::Id | InventoryColumn::Species));
        Some(Heading { column: found.column, name: name.to_owned(), factor })
    }

    pub fn has_unit(&self, column: InventoryColumn) -> bool {
        self.columns.iter().flatten().any(|h| h.column == column && h.factor.is_some())
    }

    /// Reports all that is wrong with the headings at once.
    pub fn report(&self, place: Option<&Place>, problems: &mut Diagnostics) {
        for wrong in &self.wrong_units {
            problems.error(place.cloned(), wrong.clone());
        }
        for (name, earlier) in &self.repeated {
            let message = format!("column `{name}` is not read: `{earlier}` has the same meaning");
            problems.warn(place.cloned(), message);
        }
        let has = |wanted: InventoryColumn| self.columns.iter().flatten().any(|h| h.column == wanted);
        let needed =
            [(InventoryColumn::X, "x"), (InventoryColumn::Y, "y"), (InventoryColumn::Height, "height")];
        let missing: Vec<&str> =
            needed.iter().filter(|(column, _)| !has(*column)).map(|(_, name)| *name).collect();
        let quoted = |names: &[String]| names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
        let meant: Vec<String> = self.unknown.iter().filter_map(|name| self.meant(name)).collect();
        if !missing.is_empty() {
            let among = match self.unknown.is_empty() {
                true => String::new(),
                false => format!(" among {}", quoted(&self.unknown)),
            };
            let help = match self.degrees.is_empty() {
                true if !meant.is_empty() => meant.join("; "),
                true => KNOWN.to_owned(),
                false => format!("{} are degrees; {PROJECT}", self.degrees.join(" and ")),
            };
            problems.error(place.cloned(), format!("no column {}{among}", missing.join(", "))).help(help);
            return;
        }
        let unread = [&self.unknown[..], &self.degrees].concat();
        if !unread.is_empty() {
            let help = if meant.is_empty() { KNOWN.to_owned() } else { meant.join("; ") };
            problems
                .warn(place.cloned(), format!("columns that are not read: {}", quoted(&unread)))
                .help(help);
        }
    }

    /// The question whether an unknown name means a column that the table does not have yet, if it is like the name of one.
    fn meant(&self, name: &str) -> Option<String> {
        let is_missing = |column: InventoryColumn| {
            column != InventoryColumn::Degrees && !self.columns.iter().flatten().any(|h| h.column == column)
        };
        let missing =
            NAMES.iter().filter(|(column, _)| is_missing(*column)).flat_map(|(_, names)| names_of(names));
        let lower = name.to_lowercase();
        let without_unit = lower.split(['[', '(']).next().unwrap_or_default().trim_end();
        let without_unit = match without_unit.rsplit_once('_') {
            Some((stem, unit)) if Dimension::Length.factor(unit).is_some() => stem,
            _ => without_unit,
        };
        let near = nearest(without_unit, missing)?;
        Some(format!("did you mean `{near}` by `{name}`?"))
    }
}
