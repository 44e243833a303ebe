//! Tables of rows by columns.

use crate::cli::aligned::{Side, aligned};

/// The heading of a column and its text in every row.
pub type Column<T> = (&'static str, fn(&T) -> String);

/// Formats rows in aligned columns, two spaces apart: the first column left-aligned, all others right-aligned.
pub fn table<T>(rows: &[T], columns: &[Column<T>]) -> String {
    let head = columns.iter().map(|(head, _)| (*head).to_owned()).collect();
    let body = rows.iter().map(|row| columns.iter().map(|(_, text)| text(row)).collect());
    let lines: Vec<Vec<String>> = std::iter::once(head).chain(body).collect();
    aligned(&lines, Side::Right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned() {
        let rows = [("a", "10.5"), ("median", "2")];
        let text = table(&rows, &[("tree", |r| r.0.to_owned()), ("s", |r| r.1.to_owned())]);
        assert_eq!(text, "tree       s\na       10.5\nmedian     2\n");
    }
}
