//! Rows of a table as text.

use vlscan_base::aligned::{Side, aligned};

/// A column: its heading, and the text of a row in it.
type Column<T> = (&'static str, fn(&T) -> String);

/// Formats rows in aligned columns, two spaces apart: the first column left-aligned, all others
/// right-aligned.
pub fn table<T>(rows: &[T], columns: &[Column<T>]) -> String {
    let head = columns.iter().map(|(head, _)| (*head).to_owned()).collect();
    let body = rows.iter().map(|row| columns.iter().map(|(_, text)| text(row)).collect());
    let lines: Vec<Vec<String>> = std::iter::once(head).chain(body).collect();
    aligned(&lines, Side::Right)
}
