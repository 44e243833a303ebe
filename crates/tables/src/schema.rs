//! Schemas of tables, and the headings of a table compared with its schema.

use super::heading::{HeadingError, did_you_mean, parse_heading, split_unit};
use super::vocabulary::{Quantity, is_usually_unused, plain, similar_name};
use vlscan_base::columns::Separator;
use vlscan_base::diag::{Diagnostics, Place};

/// How a table uses a quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// Every table needs the column.
    Required,
    /// The column may be missing.
    Optional,
    /// The column is an error, with this help.
    Refused(&'static str),
    /// The column is not read, with a warning; its name has another meaning in other tables. The help, if
    /// any, is for tables without this required column.
    Unread(Option<(Quantity, &'static str)>),
}

/// The columns of a kind of table. A name that several quantities have means the first of them.
#[derive(Clone, Copy, Debug)]
pub struct Schema {
    /// The quantities with their use.
    pub columns: &'static [(Quantity, Use)],
    /// If set, a second column for a quantity is an error; otherwise the name that comes first in the
    /// vocabulary counts, with a warning.
    pub is_unique: bool,
    /// The columns of the table, as help.
    pub help: &'static str,
}

impl Schema {
    /// The quantities that the table may have.
    pub fn quantities(&self) -> impl Iterator<Item = Quantity> + Clone {
        self.columns.iter().map(|(quantity, _)| *quantity)
    }

    fn usage(&self, quantity: Quantity) -> Use {
        self.columns.iter().find(|(of, _)| *of == quantity).map_or(Use::Optional, |(_, usage)| *usage)
    }
}

/// A column that is read.
#[derive(Clone, Debug, PartialEq)]
pub struct TableColumn {
    /// The quantity of its values.
    pub quantity: Quantity,
    /// Its position in a row, from 0.
    pub index: usize,
    /// Factor to seconds, metres or radians, if the heading has a unit.
    pub factor: Option<f64>,
    /// The heading as written.
    pub name: String,
}

/// The headings of a table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Headings {
    /// The columns that are read.
    pub columns: Vec<TableColumn>,
    /// Number of headings up to the last one that is not empty.
    pub width: usize,
    /// Places of columns without a name, from 0, before the last one that has one.
    unnamed: Vec<usize>,
    /// Headings with unknown names.
    pub unknown: Vec<String>,
    /// The help of columns with [`Use::Unread`], which are among the unknown ones.
    hints: Vec<(Quantity, &'static str)>,
    /// Headings that tables often have and that are not read.
    pub unused: Vec<String>,
    /// Headings of quantities that another column has, and the heading of that column.
    pub repeated: Vec<(String, String)>,
    /// Headings of quantities that the table refuses, with the help.
    pub refused: Vec<(String, &'static str)>,
    /// Units that do not match their column, with the expected ones.
    pub wrong_units: Vec<String>,
}

impl Headings {
    /// Compares headings with a schema.
    pub fn of(names: impl IntoIterator<Item = impl AsRef<str>>, schema: &Schema) -> Headings {
        let mut found = Headings::default();
        for (index, name) in names.into_iter().enumerate() {
            let name = name.as_ref().trim();
            found.add(index, name, schema);
            // Separators at the end of a line do not make columns.
            if name.is_empty() {
                found.unnamed.push(index);
            } else {
                found.width = index + 1;
            }
        }
        let width = found.width;
        found.unnamed.retain(|index| *index < width);
        found
    }

    /// Adds a heading.
    pub fn add(&mut self, index: usize, name: &str, schema: &Schema) {
        let heading = match parse_heading(name, schema.quantities()) {
            Ok(heading) => heading,
            Err(HeadingError::WrongUnit(_, found, expected)) => {
                self.wrong_units.push(format!("{found}, {expected}"));
                return;
            }
            Err(HeadingError::UnknownName(stem)) => {
                let (stem, name) = (plain(&stem), name.to_owned());
                match stem.is_empty() || is_usually_unused(&stem) {
                    true => self.unused.extend((!name.is_empty()).then_some(name)),
                    false => self.unknown.push(name),
                }
                return;
            }
        };
        match schema.usage(heading.quantity) {
            Use::Refused(help) => return self.refused.push((name.to_owned(), help)),
            Use::Unread(help) => {
                self.hints.extend(help);
                return self.unknown.push(name.to_owned());
            }
            Use::Required | Use::Optional => {}
        }
        let column =
            TableColumn { quantity: heading.quantity, index, factor: heading.factor, name: name.to_owned() };
        let Some(earlier) = self.columns.iter_mut().find(|column| column.quantity == heading.quantity) else {
            self.columns.push(column);
            return;
        };
        let rank = |column: &TableColumn| {
            let name = plain(split_unit(&column.name).0);
            column.quantity.rank(&name).unwrap_or(usize::MAX)
        };
        let is_better = !schema.is_unique && rank(&column) < rank(earlier);
        let other = if is_better { std::mem::replace(earlier, column) } else { column };
        self.repeated.push((other.name, earlier.name.clone()));
    }

    /// The column of a quantity.
    pub fn get(&self, quantity: Quantity) -> Option<&TableColumn> {
        self.columns.iter().find(|column| column.quantity == quantity)
    }

    /// True if a column holds the quantity.
    pub fn has(&self, quantity: Quantity) -> bool {
        self.get(quantity).is_some()
    }

    /// The required quantities without a column.
    pub fn missing(&self, schema: &Schema) -> Vec<&'static str> {
        let required = schema.columns.iter().filter(|(_, usage)| *usage == Use::Required);
        required.filter(|(quantity, _)| !self.has(*quantity)).map(|(quantity, _)| quantity.name()).collect()
    }

    /// Reports everything that is wrong with the headings, and the columns that are not read.
    pub fn report(&self, schema: &Schema, place: Option<&Place>, problems: &mut Diagnostics) {
        for wrong in &self.wrong_units {
            problems.error(place.cloned(), wrong.clone());
        }
        for (name, help) in &self.refused {
            problems.error(place.cloned(), format!("column `{name}` has no effect here")).help(*help);
        }
        for (name, earlier) in &self.repeated {
            match schema.is_unique {
                true => {
                    let message = format!("columns `{earlier}` and `{name}` have the same meaning");
                    problems.error(place.cloned(), message).help("rename or remove one of them");
                }
                false => {
                    let message = format!("column `{name}` is not read: `{earlier}` has the same meaning");
                    problems.warn(place.cloned(), message);
                }
            }
        }
        if !self.unnamed.is_empty() {
            let numbers: Vec<String> = self.unnamed.iter().map(|index| (index + 1).to_string()).collect();
            let message = format!("columns without a name are not read: {}", numbers.join(", "));
            problems.note(place.cloned(), message);
        }
        let missing = self.missing(schema);
        let question = self.suggestion(schema);
        if !missing.is_empty() {
            let all: Vec<String> = [&self.unknown[..], &self.unused].concat();
            let hint = self.hints.iter().find(|(quantity, _)| !self.has(*quantity));
            let hint = hint.map(|(_, hint)| (*hint).to_owned());
            let help = hint.or(question).unwrap_or_else(|| schema.help.to_owned());
            let among = if all.is_empty() { String::new() } else { format!("; not read: {}", quoted(&all)) };
            problems.error(place.cloned(), format!("no column {}{among}", missing.join(", "))).help(help);
        } else if !self.unknown.is_empty() {
            let message = format!("columns that are not read: {}", quoted(&self.unknown));
            problems.warn(place.cloned(), message).help(question.unwrap_or_else(|| schema.help.to_owned()));
        }
    }

    /// The question whether unknown headings mean quantities that the table does not have yet.
    pub fn suggestion(&self, schema: &Schema) -> Option<String> {
        let open = schema.columns.iter().filter(|(quantity, usage)| {
            matches!(usage, Use::Required | Use::Optional) && !self.has(*quantity)
        });
        let names: Vec<&str> = open.flat_map(|(quantity, _)| quantity.names()).collect();
        did_you_mean(&self.unknown, |name| similar_name(&plain(name), names.iter().copied()))
    }
}

fn quoted(names: &[String]) -> String {
    const MAX: usize = 12;
    let shown = names.iter().take(MAX).map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    match names.len() - names.len().min(MAX) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// A row with more or fewer fields than expected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WidthError {
    /// Description of the problem.
    pub message: String,
    /// Advice; may be empty.
    pub help: &'static str,
}

/// Checks the number of fields of a row; `whose` says where `expected` is from, such as `the heading`.
///
/// # Errors
/// Another number of fields, with a hint at decimal commas where these are the likely cause.
pub fn check_width(
    found: usize,
    expected: usize,
    whose: &str,
    separator: Separator,
) -> Result<(), WidthError> {
    if found == expected {
        return Ok(());
    }
    let plural = if found == 1 { "" } else { "s" };
    let message = format!("{found} field{plural}, expected {expected} as in {whose}");
    let help = match (found > expected, separator) {
        (true, Separator::Char(',')) => {
            "numbers with decimal commas need columns separated by semicolons or tabs, or decimal points"
        }
        (false, Separator::Blanks) => "separate the columns by commas if fields may be empty",
        _ => "",
    };
    Err(WidthError { message, help })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCHEMA: Schema = Schema {
        columns: &[
            (Quantity::X, Use::Required),
            (Quantity::TreeHeight, Use::Optional),
            (Quantity::Z, Use::Required),
            (Quantity::Roll, Use::Refused("turn it")),
        ],
        is_unique: true,
        help: "the columns are x, height, z",
    };

    fn report(names: &[&str], schema: &Schema) -> String {
        let mut problems = Diagnostics::default();
        Headings::of(names, schema).report(schema, None, &mut problems);
        problems.text()
    }

    #[test]
    fn every_heading_is_used_refused_or_reported() {
        assert_eq!(report(&["tree_x", "height", "elevation", "pdop", "x_std", ""], &SCHEMA), "");
        for (names, part) in [
            (&["x", "height"][..], "no column z"),
            (&["x", "z", "easting"], "columns `x` and `easting` have the same meaning"),
            (&["x", "z", "roll_deg"], "column `roll_deg` has no effect here"),
            (&["x", "z", "hieght"], "did you mean `height` by `hieght`?"),
            (&["x", "eleation", "hieght"], "did you mean `elevation` by `eleation`, `height` by `hieght`?"),
            (&["x", "z", "colour"], "not read: `colour`"),
            (&["x", "z_s"], "column `z_s` is in `s`, expected m"),
        ] {
            assert!(report(names, &SCHEMA).contains(part), "{names:?}: {}", report(names, &SCHEMA));
        }
        assert!(report(&["x", "", "z", ""], &SCHEMA).contains("columns without a name are not read: 2"));
        let unread = Schema {
            columns: &[
                (Quantity::TreeHeight, Use::Unread(Some((Quantity::Z, "rename it to z")))),
                (Quantity::Z, Use::Required),
            ],
            ..SCHEMA
        };
        let said = report(&["height"], &unread);
        assert!(
            said.contains("no column z") && said.contains("rename it") && !said.contains("did you"),
            "{said}"
        );
        assert!(!report(&["height", "z"], &unread).contains("rename it"));
        let without_x = Schema {
            columns: &[
                (Quantity::TreeHeight, Use::Unread(Some((Quantity::Z, "rename it to z")))),
                (Quantity::Z, Use::Required),
                (Quantity::X, Use::Required),
            ],
            ..SCHEMA
        };
        let said = report(&["height", "z"], &without_x);
        assert!(said.contains("no column x") && !said.contains("rename it"), "{said}");
        let lenient = Schema { is_unique: false, ..SCHEMA };
        let found = Headings::of(["easting", "x", "z"], &lenient);
        assert_eq!(found.get(Quantity::X).unwrap().index, 1, "the first name in the vocabulary counts");
        assert!(report(&["easting", "x", "z"], &lenient).contains("`easting` is not read: `x` has"));
    }

    #[test]
    fn surplus_fields_between_commas_look_like_decimal_commas() {
        let check = |found, separator| check_width(found, 3, "the heading", separator).unwrap_err();
        assert!(check(4, Separator::Char(',')).help.contains("decimal commas"));
        assert_eq!(check(1, Separator::Blanks).message, "1 field, expected 3 as in the heading");
    }
}
