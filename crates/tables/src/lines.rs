//! Tables of text in memory, with headings and quoted fields.

use super::schema::{WidthError, check_width};
use std::borrow::Cow;
use std::path::Path;
use vlscan_base::columns::{Separator, stated_separator, unquoted};
use vlscan_base::diag::Place;

/// A table of text. Blank lines and comments (`#`) are skipped; a first line such as `sep=;` states the
/// separator.
#[derive(Clone, Debug)]
pub struct TextTable<'t> {
    path: &'t Path,
    lines: std::iter::Zip<std::ops::RangeFrom<usize>, std::str::Lines<'t>>,
    stated: Option<Separator>,
    separator: Option<Separator>,
}

/// A line of a table.
#[derive(Clone, Debug)]
pub struct Line<'t> {
    /// Its number in the file, from 1.
    pub number: usize,
    /// Its text.
    pub text: &'t str,
    /// Its fields without quotes and the blanks around them.
    pub fields: Vec<Field<'t>>,
}

impl Line<'_> {
    /// Removes empty fields beyond the first `expected` ones, and checks that no others are left or missing;
    /// `whose` says where the number is from.
    ///
    /// # Errors
    /// Another number of fields.
    pub fn fit(&mut self, expected: usize, whose: &str, separator: Separator) -> Result<(), WidthError> {
        while self.fields.len() > expected && self.fields.last().is_some_and(|field| field.is_empty()) {
            self.fields.pop();
        }
        check_width(self.fields.len(), expected, whose, separator)
    }
}

/// A field; borrowed from the line unless the line has quotes.
pub type Field<'t> = Cow<'t, str>;

/// Maximum number of characters of a line that are marked in messages.
const MAX_MARKED: usize = 200;

impl<'t> TextTable<'t> {
    /// The table in `text`; `path` is its name in messages.
    pub fn new(path: &'t Path, text: &'t str) -> TextTable<'t> {
        let text = text.trim_start_matches('\u{feff}');
        TextTable { path, lines: (1..).zip(text.lines()), stated: None, separator: None }
    }

    /// The separator, once a line has been read.
    pub fn separator(&self) -> Separator {
        self.separator.unwrap_or(Separator::Char(','))
    }

    /// The place of `field`, if it is borrowed, or of the complete line.
    pub fn place(&self, line: &Line, field: Option<usize>) -> Place {
        let start = line.text.as_ptr() as usize;
        let at = field.and_then(|field| line.fields.get(field)).and_then(|field| match field {
            Cow::Borrowed(text) => (text.as_ptr() as usize).checked_sub(start).map(|at| at..at + text.len()),
            Cow::Owned(_) => None,
        });
        let end = line.text.char_indices().map(|(i, _)| i).chain([line.text.len()]).take(MAX_MARKED + 1);
        let whole = 0..end.last().unwrap_or(0);
        Place::in_line(
            self.path,
            line.number,
            line.text,
            at.filter(|at| at.end <= line.text.len()).unwrap_or(whole),
        )
    }

    fn fields(&self, text: &'t str) -> Vec<Field<'t>> {
        let separator = self.separator();
        if text.contains('"') {
            return unquoted(text, separator).into_iter().map(Cow::Owned).collect();
        }
        match separator {
            Separator::Char(c) => text.split(c).map(|field| Cow::Borrowed(field.trim())).collect(),
            other => other.split(text).map(|at| Cow::Borrowed(text[at].trim())).collect(),
        }
    }
}

impl<'t> Iterator for TextTable<'t> {
    type Item = Line<'t>;

    fn next(&mut self) -> Option<Line<'t>> {
        loop {
            let (number, text) = self.lines.next()?;
            let content = text.trim();
            if content.is_empty() || content.starts_with('#') {
                continue;
            }
            if self.separator.is_none() {
                if let (None, Some(stated)) = (self.stated, stated_separator(text)) {
                    self.stated = Some(Separator::named(stated));
                    continue;
                }
                self.separator = Some(self.stated.unwrap_or_else(|| Separator::guess(text)));
            }
            let fields = self.fields(text);
            return Some(Line { number, text, fields });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_numbers_fields_and_places() {
        let text = "\u{feff}sep=;\r\n# trees\r\n\r\na; b ;c\r\n\"1;5\";;3\r\n;;\r\n";
        let mut table = TextTable::new(Path::new("t.csv"), text);
        let lines: Vec<Line> = table.by_ref().collect();
        let fields = |i: usize| lines[i].fields.iter().map(AsRef::as_ref).collect::<Vec<_>>();
        assert_eq!(
            (fields(0), fields(1), fields(2)),
            (vec!["a", "b", "c"], vec!["1;5", "", "3"], vec![""; 3])
        );
        assert_eq!(lines.iter().map(|line| line.number).collect::<Vec<_>>(), [4, 5, 6]);
        let place = table.place(&lines[0], Some(1));
        assert_eq!(&place.excerpt[place.marked.clone()], "b");
        assert_eq!(table.place(&lines[1], Some(0)).marked, 0..8);
    }
}
