//! Which column of a row of numbers holds what.

use super::rows::{ColumnName, QUANTITIES, Quantity, Separator, column_name, number};
use std::ops::Range;

/// The columns of a table of poses, each list in the order of [`QUANTITIES`].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    pub columns: [Option<usize>; 7],
    /// Factors of units that the names state.
    pub factors: [Option<f64>; 7],
    /// X is the longitude, Y the latitude.
    pub geographic: bool,
}

/// Columns as they are named one by one.
struct Naming {
    layout: Layout,
    /// Columns and factors of longitude and latitude.
    degrees: [Option<(usize, Option<f64>)>; 2],
}

impl Naming {
    fn new() -> Naming {
        Naming { layout: Layout::in_order([]), degrees: [None; 2] }
    }

    fn add(&mut self, column: usize, name: ColumnName) -> Result<(), String> {
        let at = name.quantity as usize;
        let taken = if name.geographic {
            let place = &mut self.degrees[usize::from(name.quantity == Quantity::Y)];
            place.replace((column, name.factor)).is_some()
        } else {
            self.layout.factors[at] = name.factor;
            self.layout.columns[at].replace(column).is_some()
        };
        let what = if name.geographic { geographic_name(name.quantity) } else { name.quantity.name() };
        if taken { Err(format!("a second column for {what}")) } else { Ok(()) }
    }

    /// The layout; coordinates that are projected already come before latitude and longitude.
    fn finish(self) -> Layout {
        let mut layout = self.layout;
        let (x, y) = (Quantity::X as usize, Quantity::Y as usize);
        if let [Some(longitude), Some(latitude)] = self.degrees
            && (layout.columns[x].is_none() || layout.columns[y].is_none())
        {
            (layout.columns[x], layout.factors[x]) = (Some(longitude.0), longitude.1);
            (layout.columns[y], layout.factors[y]) = (Some(latitude.0), latitude.1);
            layout.geographic = true;
        }
        layout
    }
}

fn geographic_name(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::X => "longitude",
        Quantity::Y => "latitude",
        other => other.name(),
    }
}

/// A wrong place in a line.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RowError {
    pub at: Range<usize>,
    pub message: String,
}

impl Layout {
    /// Columns by number, in the order of [`QUANTITIES`].
    pub fn numbered(columns: [usize; 7]) -> Layout {
        Layout { columns: columns.map(Some), factors: [None; 7], geographic: false }
    }

    /// Columns 0, 1, 2 … in the given order.
    pub fn in_order(order: impl IntoIterator<Item = Quantity>) -> Layout {
        let mut layout = Layout { columns: [None; 7], factors: [None; 7], geographic: false };
        for (column, quantity) in order.into_iter().enumerate() {
            layout.columns[quantity as usize] = Some(column);
        }
        layout
    }

    /// Columns by their names; names of other things are passed over. `fields` are byte ranges of `line`.
    pub fn named(line: &str, fields: &[Range<usize>]) -> Result<Layout, RowError> {
        let mut naming = Naming::new();
        let mut column = 0;
        for (i, field) in fields.iter().enumerate() {
            let mut at = field.clone();
            // `roll (deg)` in a line that blanks separate is one name.
            if is_unit(&line[field.clone()]) && i > 0 {
                continue;
            }
            if let Some(unit) = fields.get(i + 1).filter(|u| is_unit(&line[(*u).clone()])) {
                at.end = unit.end;
            }
            let named =
                column_name(&line[at.clone()]).map_err(|message| RowError { at: at.clone(), message })?;
            if let Some(named) = named {
                naming.add(column, named).map_err(|message| RowError { at, message })?;
            }
            column += 1;
        }
        Ok(naming.finish())
    }

    /// Columns that a user chooses: names in their order, where names of other things pass over a column, or `name=number`
    /// with numbers from 1.
    pub fn chosen(columns: &[String]) -> Result<Layout, String> {
        let mut naming = Naming::new();
        let numbered = columns.iter().any(|column| column.contains('='));
        for (i, column) in columns.iter().enumerate() {
            let (name, number) = match column.rsplit_once('=') {
                Some((name, number)) => (name, number.trim().parse().unwrap_or(0)),
                None if numbered => return Err(format!("`{column}` has no number as the others have")),
                None => (column.as_str(), i + 1),
            };
            if number == 0 {
                return Err(format!("`{column}`: expected a name and a number from 1, such as time=1"));
            }
            match column_name(name)? {
                Some(named) => naming.add(number - 1, named)?,
                None if numbered => {
                    return Err(format!("`{name}` is none of time, x, y, z, roll, pitch, yaw, lat, lon"));
                }
                None => {}
            }
        }
        Ok(naming.finish())
    }

    /// The name of a column in messages.
    fn name_of(&self, quantity: Quantity) -> &'static str {
        if self.geographic { geographic_name(quantity) } else { quantity.name() }
    }

    /// The names of `wanted` quantities that no column holds.
    pub fn missing(&self, wanted: &[Quantity]) -> Vec<&'static str> {
        wanted.iter().filter(|q| self.columns[**q as usize].is_none()).map(|q| q.name()).collect()
    }

    /// The numbers of `line` in the order of [`QUANTITIES`], untouched by units; quantities without a column are 0.
    pub fn values(&self, line: &str, separator: Separator) -> Result<[f64; 7], RowError> {
        self.row(line, separator).map(|(values, _)| values)
    }

    /// As [`Layout::values`], and where the time stands.
    pub fn row(&self, line: &str, separator: Separator) -> Result<([f64; 7], Range<usize>), RowError> {
        let fields = separator.split(line);
        let (mut values, mut time) = ([0.0; 7], 0..0);
        for quantity in QUANTITIES {
            let Some(column) = self.columns[quantity as usize] else { continue };
            let Some(field) = fields.get(column) else {
                let message = format!(
                    "column {} for {} is missing: {} column{} separated by {}",
                    column + 1,
                    self.name_of(quantity),
                    fields.len(),
                    if fields.len() == 1 { "" } else { "s" },
                    separator.name()
                );
                return Err(RowError { at: 0..line.len(), message });
            };
            if quantity == Quantity::Time {
                time = field.clone();
            }
            values[quantity as usize] = number(&line[field.clone()]).ok_or_else(|| RowError {
                at: field.clone(),
                message: format!(
                    "expected a number for {}, found `{}`",
                    self.name_of(quantity),
                    &line[field.clone()]
                ),
            })?;
        }
        Ok((values, time))
    }
}

fn is_unit(text: &str) -> bool {
    text.starts_with(['(', '[']) && text.ends_with([')', ']'])
}

/// Whether no column of `line` is a number: a line of names.
pub(super) fn is_header(line: &str, separator: Separator) -> bool {
    let fields = separator.split(line);
    !fields.is_empty()
        && fields.iter().all(|f| line[f.clone()].parse::<f64>().map_or(true, |v| !v.is_finite()))
        && fields.iter().any(|f| matches!(column_name(&line[f.clone()]), Ok(Some(_)) | Err(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(line: &str) -> Result<Layout, RowError> {
        Layout::named(line, &Separator::guess(line).split(line))
    }

    #[test]
    fn names_find_their_columns_in_any_order() {
        let l = named("x,y,z,gps_time,quality,Roll[deg],pitch,heading").unwrap();
        assert_eq!(l.columns, [Some(3), Some(5), Some(6), Some(7), Some(0), Some(1), Some(2)]);
        assert!(l.factors[1].is_some() && l.factors[2].is_none());
        assert!(l.missing(&QUANTITIES).is_empty());
    }

    #[test]
    fn units_apart_from_their_names_are_no_columns() {
        let l = named("time x y z roll (deg) pitch (deg) yaw (deg)").unwrap();
        assert_eq!(l.columns, [Some(0), Some(4), Some(5), Some(6), Some(1), Some(2), Some(3)]);
        assert!(l.factors[3].is_some());
    }

    #[test]
    fn wrong_rows_are_marked() {
        let l = Layout::in_order(QUANTITIES);
        let comma = Separator::Char(',');
        let e = l.values("1,2,3,abc,5,6,7", comma).unwrap_err();
        assert_eq!((e.at, e.message.as_str()), (6..9, "expected a number for yaw, found `abc`"));
        assert!(
            l.values("1,2,3", comma).unwrap_err().message.contains("column 4 for yaw is missing: 3 columns")
        );
        assert!(l.values("1,2,3,nan,5,6,7", comma).is_err());
        assert!(named("time,x,x").unwrap_err().message.contains("second column for x"));
    }

    #[test]
    fn headers_are_lines_of_names() {
        assert!(is_header("time,x,y", Separator::Char(',')));
        assert!(!is_header("1,x,y", Separator::Char(',')));
        assert!(!is_header("foo,bar", Separator::Char(',')));
    }
}
