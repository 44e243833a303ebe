//! Which column of a row of numbers holds what.

use super::rows::{QUANTITIES, Quantity, Separator, column_name, number};
use std::ops::Range;

/// The columns of a table of poses, each list in the order of [`QUANTITIES`].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    pub columns: [Option<usize>; 7],
    /// Factors of units that the names state.
    pub factors: [Option<f64>; 7],
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
        Layout { columns: columns.map(Some), factors: [None; 7] }
    }

    /// Columns 0, 1, 2 … in the given order.
    pub fn in_order(order: impl IntoIterator<Item = Quantity>) -> Layout {
        let mut layout = Layout { columns: [None; 7], factors: [None; 7] };
        for (column, quantity) in order.into_iter().enumerate() {
            layout.columns[quantity as usize] = Some(column);
        }
        layout
    }

    /// Columns by their names; names of other things are passed over. `fields` are byte ranges of `line`.
    pub fn named(line: &str, fields: &[Range<usize>]) -> Result<Layout, RowError> {
        let mut layout = Layout { columns: [None; 7], factors: [None; 7] };
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
                let place = &mut layout.columns[named.quantity as usize];
                if place.is_some() {
                    let message = format!("a second column for {}", named.quantity.name());
                    return Err(RowError { at, message });
                }
                *place = Some(column);
                layout.factors[named.quantity as usize] = named.factor;
            }
            column += 1;
        }
        Ok(layout)
    }

    /// The names of `wanted` quantities that no column holds.
    pub fn missing(&self, wanted: &[Quantity]) -> Vec<&'static str> {
        wanted.iter().filter(|q| self.columns[**q as usize].is_none()).map(|q| q.name()).collect()
    }

    /// The numbers of `line` in the order of [`QUANTITIES`], untouched by units; quantities without a column are 0.
    pub fn values(&self, line: &str, separator: Separator) -> Result<[f64; 7], RowError> {
        let fields = separator.split(line);
        let mut values = [0.0; 7];
        for quantity in QUANTITIES {
            let Some(column) = self.columns[quantity as usize] else { continue };
            let Some(field) = fields.get(column) else {
                let message = format!(
                    "column {} for {} is missing: {} column{} separated by {}",
                    column + 1,
                    quantity.name(),
                    fields.len(),
                    if fields.len() == 1 { "" } else { "s" },
                    separator.name()
                );
                return Err(RowError { at: 0..line.len(), message });
            };
            values[quantity as usize] = number(&line[field.clone()]).ok_or_else(|| RowError {
                at: field.clone(),
                message: format!(
                    "expected a number for {}, found `{}`",
                    quantity.name(),
                    &line[field.clone()]
                ),
            })?;
        }
        Ok(values)
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
