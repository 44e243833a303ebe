//! Determines how the lines of a text file are split and what their columns contain: by names where the first
//! line, or the last comment before the points, consists of names; else by the number of columns.

use super::lines::{is_heading, is_skipped};
use crate::{Attribute, Column, Columns};
use std::ops::Range;
use std::path::Path;
use vlscan_base::columns::{Separator, decoded, stated_separator};
use vlscan_base::diag::{Diagnostics, Place};

/// The columns of the point files of this program and of HELIOS++ (spec outputs §3).
const FULL: [Column; 11] = [
    Column::X,
    Column::Y,
    Column::Z,
    Column::Amplitude,
    Column::EchoWidth,
    Column::ReturnNumber,
    Column::NumberOfReturns,
    Column::PulseNumber,
    Column::ObjectId,
    Column::Classification,
    Column::GpsTime,
];

/// Index of the object's name among them.
const OBJECT_COLUMN: usize = 8;

/// The columns of a file.
#[derive(Clone, Debug)]
pub struct Layout {
    separator: Separator,
    /// The column of each attribute, and the units of the coordinates.
    pub columns: Columns,
    /// The names of the columns; `None` for columns without names.
    names: Option<Vec<String>>,
    /// Number of the first line with a point, from 1.
    pub first_line: usize,
}

impl Layout {
    /// The positions of the words of a line; `words` is emptied first. In files of eleven columns without
    /// names the name of the object may be empty, which is not visible between blanks: its word is inserted
    /// then.
    pub fn split(&self, line: &[u8], words: &mut Vec<Range<usize>>) {
        words.clear();
        self.separator.split_into(line, words);
        if self.is_full() && words.len() == FULL.len() - 1 && self.separator == Separator::Blanks {
            words.insert(OBJECT_COLUMN, 0..0);
        }
    }

    /// Problem with the number of words of a line that has fewer than there are names: between blanks, an
    /// empty value shifts those behind it.
    pub fn missing_values(&self, words: &[Range<usize>]) -> Option<String> {
        let named = self.names.as_ref().filter(|_| self.separator == Separator::Blanks)?.len();
        if words.len() >= named {
            return None;
        }
        Some(format!("expected {named} values, one for each named column, found {}", words.len()))
    }

    /// The separator of the columns.
    pub fn separator(&self) -> Separator {
        self.separator
    }

    /// True if this character separates columns.
    pub fn is_separated_by(&self, byte: u8) -> bool {
        self.separator.split(&[b'1', byte, b'1']).count() > 1
    }

    /// True if names determine the contents of the columns.
    pub fn is_named(&self) -> bool {
        self.names.is_some()
    }

    /// True for files of eleven columns without names.
    fn is_full(&self) -> bool {
        self.names.is_none() && self.columns.get(Attribute::Object) == Some(OBJECT_COLUMN)
    }

    /// Names of the columns: those in the file, or those of files of eleven columns without names. Empty for
    /// other files.
    pub fn names(&self) -> Vec<&str> {
        match &self.names {
            Some(names) => names.iter().map(String::as_str).collect(),
            None if self.is_full() => FULL.map(Column::name).to_vec(),
            None => Vec::new(),
        }
    }
}

/// A line that may name the columns.
struct Heading {
    number: usize,
    text: Vec<u8>,
}

/// Finds the layout of a file from its first lines.
#[derive(Default)]
pub struct LayoutFinder {
    /// The separator that a setting or the file itself states.
    separator: Option<Separator>,
    heading: Option<Heading>,
    comment: Option<Heading>,
}

impl LayoutFinder {
    /// A finder for a file whose separator is known; `None` if the lines determine it.
    pub fn new(separator: Option<Separator>) -> LayoutFinder {
        LayoutFinder { separator, ..LayoutFinder::default() }
    }

    /// Looks at the next line of the file `path`, whose number counts from 1. Returns the layout when it is
    /// the first one with a point; earlier lines are to be skipped. Problems of names go to `found`.
    pub fn next(
        &mut self,
        path: &Path,
        number: usize,
        line: &[u8],
        found: &mut Diagnostics,
    ) -> Option<Layout> {
        let line = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line);
        // A line of spreadsheets; its separator may be a tab.
        let stated = std::str::from_utf8(line).ok().and_then(stated_separator);
        if let Some(separator) = stated {
            self.separator.get_or_insert(Separator::named(separator));
            return None;
        }
        let line = line.trim_ascii_end();
        if is_skipped(line) {
            let start = line.iter().position(|b| !(matches!(b, b'#' | b'/') || b.is_ascii_whitespace()));
            let text = line[start.unwrap_or(line.len())..].to_vec();
            self.comment =
                Some(Heading { number, text }).filter(|c| !c.text.is_empty()).or(self.comment.take());
            return None;
        }
        let separator = self.separator_of(line);
        let words: Vec<_> = separator.split(line).collect();
        if self.heading.is_none() && is_heading(line, &words) {
            self.heading = Some(Heading { number, text: line.to_vec() });
            return None;
        }
        Some(self.layout(path, number, separator, line, &words, found))
    }

    /// The separator of a line; single tabs where the file has names between tabs, since names may have
    /// blanks in them.
    fn separator_of(&self, line: &[u8]) -> Separator {
        let has_tabs = |heading: &Heading| heading.text.contains(&b'\t');
        let heading = self.heading.as_ref().or(self.comment.as_ref());
        match (self.separator, Separator::guess(line)) {
            (Some(separator), _) => separator,
            (None, Separator::Char('\t')) if !heading.is_some_and(has_tabs) => Separator::Blanks,
            (None, guessed) => guessed,
        }
    }

    fn layout(
        &mut self,
        path: &Path,
        first_line: usize,
        separator: Separator,
        line: &[u8],
        words: &[Range<usize>],
        found: &mut Diagnostics,
    ) -> Layout {
        let count = words.len();
        let by_count =
            || Layout { separator, columns: columns_by_count(line, words), names: None, first_line };
        let names_of = |heading: &Heading| -> Vec<String> {
            let words = separator.split(&heading.text);
            let name = |at: Range<usize>| decoded(&heading.text[at]).trim().trim_matches('"').to_owned();
            words.map(name).collect()
        };
        if let Some(heading) = self.heading.take() {
            let owned = names_of(&heading);
            let names: Vec<&str> = owned.iter().map(String::as_str).collect();
            let shown = String::from_utf8_lossy(&heading.text).into_owned();
            let place = Place::in_line(path, heading.number, &shown, 0..shown.len());
            if names.len() < count {
                found.error(
                    Some(place.clone()),
                    format!("{} columns are named, line {first_line} has {count}", names.len()),
                );
            }
            let is_known = Columns::find(names.iter().copied()).used().next().is_some();
            match Columns::find_positions(&names) {
                Ok(columns) => {
                    for remark in columns.remarks(&names) {
                        found.warn(Some(place.clone()), remark);
                    }
                    return Layout { separator, columns, names: Some(owned), first_line };
                }
                Err(problem) if is_known => {
                    found.error(Some(place), problem.to_string());
                }
                Err(_) => {
                    found.warn(
                        Some(place),
                        "none of these names is known; the first three columns are read as x, y and z",
                    );
                    return Layout { columns: columns_by_count(line, &words[..count.min(3)]), ..by_count() };
                }
            }
            return by_count();
        }
        // Comments are often sentences: names only if there is one for every column.
        if let Some(comment) = self.comment.take() {
            let owned = names_of(&comment);
            let names: Vec<&str> = owned.iter().map(String::as_str).collect();
            if names.len() == count
                && let Ok(columns) = Columns::find_positions(&names)
            {
                let shown = String::from_utf8_lossy(&comment.text).into_owned();
                for remark in columns.remarks(&names) {
                    found.warn(Some(Place::in_line(path, comment.number, &shown, 0..shown.len())), remark);
                }
                return Layout { separator, columns, names: Some(owned), first_line };
            }
        }
        by_count()
    }
}

impl Layout {
    /// Warns of columns without names that are not read.
    pub fn warn_of_unread(&self, path: &Path, line: &[u8], words: &[Range<usize>], found: &mut Diagnostics) {
        if self.names.is_some() || words.len() < 5 || self.columns.has(Attribute::Object) {
            return;
        }
        let shown = String::from_utf8_lossy(line).into_owned();
        let place = Place::in_line(path, self.first_line, &shown, words[3].start..shown.len());
        found
            .warn(Some(place), format!("columns 4 to {} have no names and are not read", words.len()))
            .help("name the columns in the first line, for example `x y z intensity red green blue`");
    }
}

/// The columns of lines like this one without names: those of point files of this program and of HELIOS++, or
/// a position and, where there is just one more column, an intensity.
fn columns_by_count(line: &[u8], words: &[Range<usize>]) -> Columns {
    if is_full_row(line, words) {
        return Columns::find(FULL.map(Column::name)).of_own_table(true);
    }
    let columns = Attribute::POSITION.into_iter().zip(0..);
    let columns = columns.fold(Columns::default(), |columns, (a, column)| columns.with(a, column));
    if words.len() == 4 { columns.with(Attribute::Intensity, 3) } else { columns }
}

/// True if a line is a row of this program or of HELIOS++, whose object may have no name: its sixth to eighth
/// columns are the number of the return, the number of returns and the number of the pulse.
fn is_full_row(line: &[u8], words: &[Range<usize>]) -> bool {
    let whole = |column: usize| {
        std::str::from_utf8(line[words[column].clone()].trim_ascii()).ok()?.parse::<u64>().ok()
    };
    (FULL.len() - 1..=FULL.len()).contains(&words.len())
        && matches!((whole(5), whole(6), whole(7)), (Some(number), Some(count), Some(_)) if number <= count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The attributes and columns that are found in a file, the number of its first line with a point and the
    /// messages.
    fn layout(text: &str) -> (Vec<(Attribute, usize)>, usize, Vec<String>) {
        let (mut finder, mut found) = (LayoutFinder::default(), Diagnostics::default());
        let mut lines = (1..).zip(text.lines());
        let layout = lines
            .find_map(|(number, line)| finder.next(Path::new("a.txt"), number, line.as_bytes(), &mut found))
            .unwrap();
        let messages = found.items().iter().map(|d| d.message.clone()).collect();
        (layout.columns.used().collect(), layout.first_line, messages)
    }

    use Attribute::{Class, Intensity, Object, X, Y, Z};

    #[test]
    fn names_tell_the_columns_in_any_number_and_order() {
        for (text, expected) in [
            ("x y z class\n1 2 3 4\n", vec![(X, 0), (Y, 1), (Z, 2), (Class, 3)]),
            ("id,x,y,z\n7,1,2,3\n", vec![(X, 1), (Y, 2), (Z, 3)]),
            ("z;y;x\n1;2;3\n", vec![(X, 2), (Y, 1), (Z, 0)]),
            (",X,Y,Z,Intensity\n0,1,2,3,4\n", vec![(X, 1), (Y, 2), (Z, 3), (Intensity, 4)]),
            ("//X Y Z Intensity\n1 2 3 4\n", vec![(X, 0), (Y, 1), (Z, 2), (Intensity, 3)]),
            (
                "# made today\n# X\tGps Time\tY\tZ\n1\t2\t3\t4\n",
                vec![(X, 0), (Y, 2), (Z, 3), (Attribute::Time, 1)],
            ),
            (
                "\u{feff}\"tree id\"\t\"E\"\t\"N\"\t\"H\"\n1\t2\t3\t4\n",
                vec![(X, 1), (Y, 2), (Z, 3), (Object, 0)],
            ),
            ("\"x\",\"y\",\"z\"\n\"1\",\"2\",\"3\"\n", vec![(X, 0), (Y, 1), (Z, 2)]),
            ("sep=;\nE;N;H\n1;2;3\n", vec![(X, 0), (Y, 1), (Z, 2)]),
            ("SEP=;\nE;N;H\n1;2;3\n", vec![(X, 0), (Y, 1), (Z, 2)]),
            ("\u{feff}sep=\t\ntree id\tE\tN\tH\n1\t2\t3\t4\n", vec![(X, 1), (Y, 2), (Z, 3), (Object, 0)]),
        ] {
            let (columns, line, messages) = layout(text);
            assert_eq!(columns, expected, "{text:?}: {messages:?}");
            assert!(messages.is_empty() && line == text.lines().count(), "{text:?}: {messages:?}");
        }
    }

    #[test]
    fn without_names_the_number_of_columns_counts() {
        let positions = [(X, 0), (Y, 1), (Z, 2)];
        for text in
            ["1 2 3\n", "# x, y and z in metres\n1 2 3\n", "1 2 3 4 5 6\n", "1 2 3 4 5 6.5 7 8 9 10 11\n"]
        {
            assert_eq!(layout(text).0, positions, "{text:?}");
        }
        assert_eq!(layout("1 2 3 4\n").0.last(), Some(&(Intensity, 3)));
        let mut full = vec![(X, 0), (Y, 1), (Z, 2), (Intensity, 3), (Attribute::Time, 10), (Class, 9)];
        full.extend([(Attribute::ReturnNumber, 5), (Attribute::NumberOfReturns, 6), (Object, OBJECT_COLUMN)]);
        full.sort_by_key(|(_, column)| *column);
        for text in ["1 2 3 4.5 0 1 2 9 oak 4 5.5\n", "1 2 3 4.5 0 1 2 9  4 5.5\n"] {
            let mut found = layout(text).0;
            found.sort_by_key(|(_, column)| *column);
            assert_eq!(found, full, "{text:?}");
        }
    }

    #[test]
    fn names_that_do_not_fit_are_told() {
        let remarks_of = |text: &str| layout(text).2.join("; ");
        assert!(remarks_of("a b c\n1 2 3\n").contains("none of these names is known"));
        assert!(remarks_of("x y depth\n1 2 3\n").contains("no column z"));
        assert!(remarks_of("lon lat z\n1 2 3\n").contains("longitude and latitude"));
        assert!(remarks_of("x y z\n\"1\" 1 2 3\n").contains("3 columns are named, line 2 has 4"));
        assert!(remarks_of("x y z verticality\n1 2 3 4\n").contains("not read: verticality"));
        let unit = remarks_of("x[in],y[yd],z[furlong]\n1,2,3\n");
        assert!(unit.contains("\"furlong\" of column 3") && !unit.contains("yd]"), "{unit}");
    }
}
