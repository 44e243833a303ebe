//! Splits and parses lines of text with one point each.

use super::{Attribute, Columns, PointRow};
use std::ops::Range;

/// Whether `byte` separates words of a line. This includes the carriage return, which handles CRLF line ends.
pub fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r' | 0x0b | 0x0c)
}

/// Parses `word` as a number; `None` unless all of it is one.
pub fn float(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// Whether a line contains no point: it is blank, or a comment marked by `//` or `#`.
pub fn is_skipped(line: &[u8]) -> bool {
    matches!(line.trim_ascii_start(), [] | [b'/', b'/', ..] | [b'#', ..]) || line.iter().all(|&b| is_blank(b))
}

/// The characters that separate columns. Blanks may be repeated; every other separator delimits a column, possibly
/// empty.
#[derive(Clone, Copy, Debug)]
pub struct Separators<'a>(pub &'a [u8]);

impl Separators<'static> {
    pub const BLANKS: Separators<'static> = Separators(b" ");

    /// Commas or semicolons if the line has any, otherwise blanks.
    pub fn guess(line: &[u8]) -> Separators<'static> {
        match line.iter().any(|b| matches!(b, b',' | b';')) {
            true => Separators(b",;"),
            false => Separators::BLANKS,
        }
    }
}

impl<'a> Separators<'a> {
    /// The positions of the words of a line.
    pub fn split(self, line: &'a [u8]) -> impl Iterator<Item = Range<usize>> + 'a {
        let only_blanks = self.0.iter().all(|&s| is_blank(s));
        let is_separator = move |b: u8| self.0.contains(&b) || (only_blanks && is_blank(b));
        let mut at = Some(0);
        std::iter::from_fn(move || {
            let mut start = at?;
            while line.get(start).is_some_and(|&b| is_blank(b)) {
                start += 1;
            }
            if start >= line.len() {
                at = None;
                return None;
            }
            let end = line[start..].iter().position(|&b| is_separator(b)).map_or(line.len(), |n| start + n);
            at = (end < line.len()).then_some(end + 1);
            Some(start..end)
        })
    }
}

/// Whether a line is a heading: it has at least three words, each of which begins with a letter and is not a number.
pub fn is_heading(line: &[u8], words: &[Range<usize>]) -> bool {
    let is_name = |at: &Range<usize>| {
        let word = line[at.clone()].trim_ascii();
        let word = word.strip_prefix(b"\"").unwrap_or(word);
        word.first().is_some_and(u8::is_ascii_alphabetic) && float(word).is_none()
    };
    words.len() >= 3 && words.iter().all(is_name)
}

/// A column without a usable number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadColumn {
    pub attribute: Attribute,
    /// Position of its word in the line; empty, at the end, for a line that is too short.
    pub at: Range<usize>,
}

impl Columns {
    /// Parses the words of a line. Normals are optional: they are absent if the line is too short for them, and NaN if
    /// they are not numbers. Object, leg, channel and time need not be numbers.
    pub fn parse(&self, line: &[u8], words: &[Range<usize>]) -> Result<PointRow, BadColumn> {
        let number = |column: usize| words.get(column).and_then(|at| float(line[at.clone()].trim_ascii()));
        for (attribute, column) in self.used() {
            let optional = Attribute::OPTIONAL.contains(&attribute);
            if !optional && number(column).is_none() {
                let at = words.get(column).cloned().unwrap_or(line.len()..line.len());
                return Err(BadColumn { attribute, at });
            }
        }
        let mut row = self.row(|column| number(column).unwrap_or(f64::NAN));
        let has_normal = Attribute::NORMAL.iter().all(|a| self.get(*a).is_some_and(|c| c < words.len()));
        row.normal = row.normal.filter(|_| has_normal);
        Ok(row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DVec3;

    fn words(separators: Separators<'static>, line: &'static str) -> Vec<&'static str> {
        separators.split(line.as_bytes()).map(|at| line[at].trim()).collect()
    }

    #[test]
    fn blanks_may_be_repeated_and_other_separators_enclose_empty_words() {
        assert_eq!(words(Separators::BLANKS, " 1 \t2  3\r"), ["1", "2", "3"]);
        assert_eq!(words(Separators::guess(b"1,;"), "1, ;2 3"), ["1", "", "2 3"]);
        assert_eq!(words(Separators(b"\t"), "1\t 2"), ["1", "2"]);
    }

    #[test]
    fn rows_are_parsed_by_their_columns() {
        let columns = Columns::find(["x", "y", "z", "class", "nx", "ny", "nz"]);
        let parse = |line: &'static str| {
            let words: Vec<_> = Separators::BLANKS.split(line.as_bytes()).collect();
            columns.parse(line.as_bytes(), &words)
        };
        let row = parse("1 2 3 300 0 0 1").unwrap();
        assert_eq!((row.position, row.class, row.normal), (DVec3::new(1.0, 2.0, 3.0), 255, Some(DVec3::Z)));
        assert_eq!(parse("1 2 3 4 0 0").unwrap().normal, None, "the line is too short");
        assert!(parse("1 2 3 4 0 0 -").unwrap().normal.unwrap().z.is_nan());
        assert_eq!(parse("1 two 3 4"), Err(BadColumn { attribute: Attribute::Y, at: 2..5 }));
        assert_eq!(parse("1 2 3"), Err(BadColumn { attribute: Attribute::Class, at: 5..5 }));
    }
}
