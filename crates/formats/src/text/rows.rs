//! Reads the lines of a text file as points, for streams and for pieces of a file alike.

use super::layout::Layout;
use super::lines::is_skipped;
use crate::{Attribute, Columns, PointRow};
use std::ops::Range;
use vlscan_base::columns::comma_note;

/// Reads lines of one point each.
#[derive(Clone, Debug)]
pub struct RowReader {
    layout: Layout,
    columns: Columns,
    /// Number of values of the first point.
    width: usize,
    /// Columns whose values are passed with the points.
    chosen: Vec<usize>,
}

/// Why a line is not a point.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadRow {
    /// The place in the line.
    pub at: Range<usize>,
    /// Expected and found values.
    pub message: String,
    /// Advice, if there is any.
    pub help: Option<&'static str>,
}

impl RowReader {
    /// A reader of the columns `columns` of a file with this layout and this line of the first point.
    pub fn new(layout: Layout, columns: Columns, first: &[u8]) -> RowReader {
        let mut words = Vec::new();
        layout.split(first, &mut words);
        RowReader { layout, columns, width: words.len(), chosen: Vec::new() }
    }

    /// A reader that reads also the values of some columns, for [`RowReader::push_values`].
    pub(super) fn with_chosen(self, chosen: Vec<usize>) -> RowReader {
        RowReader { chosen, ..self }
    }

    /// Number of columns whose values are read in addition to the points.
    pub(super) fn chosen_count(&self) -> usize {
        self.chosen.len()
    }

    /// Appends the values of the chosen columns of a line with these words, NaN where there is no number.
    pub(super) fn push_values(&self, line: &[u8], words: &[Range<usize>], values: &mut Vec<f64>) {
        let all = || words.iter().map(|at| &line[at.clone()]);
        let value = |column: &usize| {
            let word = &line[words.get(*column)?.clone()];
            self.layout.separator().number(word, all())
        };
        values.extend(self.chosen.iter().map(|column| value(column).unwrap_or(f64::NAN)));
    }

    /// The columns that are read.
    pub fn columns(&self) -> &Columns {
        &self.columns
    }

    /// Number of values of the first point.
    pub fn width(&self) -> usize {
        self.width
    }

    /// True if names determine the contents of the columns.
    pub fn is_named(&self) -> bool {
        self.layout.is_named()
    }

    /// True for a line without a point: a blank line, a comment, and those before the first point of a file
    /// whose lines are counted from 1.
    pub fn is_skipped(&self, number: usize, line: &[u8]) -> bool {
        number < self.layout.first_line || is_skipped(line)
    }

    /// The positions of the words of a line; `words` is emptied first.
    pub fn split(&self, line: &[u8], words: &mut Vec<Range<usize>>) {
        self.layout.split(line, words);
    }

    /// The point of a line with these words.
    ///
    /// # Errors
    /// Missing values, and words that are not numbers.
    pub fn parse(&self, line: &[u8], words: &[Range<usize>]) -> Result<PointRow, BadRow> {
        let row = self.columns.parse(line, words, self.layout.separator()).map_err(|bad| {
            let word = String::from_utf8_lossy(line[bad.at.clone()].trim_ascii());
            let found = match word.is_empty() {
                true if bad.at.start >= line.len() => "the end of the line".to_owned(),
                true => "nothing".to_owned(),
                false => format!("{word:?}"),
            };
            let hint = comma_note(&word);
            let tr = "`tr , .` replaces the commas if the columns are separated by something else";
            BadRow {
                at: bad.at,
                message: format!("expected {}, found {found}{hint}", bad.attribute.described()),
                help: (!hint.is_empty()).then_some(tr),
            }
        })?;
        match self.layout.missing_values(words) {
            None => Ok(row),
            Some(message) => Err(BadRow {
                at: line.len()..line.len(),
                message,
                help: Some("separate the columns by commas if values may be empty"),
            }),
        }
    }

    /// The word of an attribute in a line.
    pub fn word(&self, attribute: Attribute, words: &[Range<usize>]) -> Option<Range<usize>> {
        words.get(self.columns.get(attribute)?).cloned()
    }
}

/// Lines with more or fewer values than the first point. `T` is a place in a file.
#[derive(Clone, Debug)]
pub struct Widths<T> {
    /// Number of lines, and the first of them.
    longer: (u64, Option<T>),
    shorter: (u64, Option<T>),
}

impl<T> Default for Widths<T> {
    fn default() -> Widths<T> {
        Widths { longer: (0, None), shorter: (0, None) }
    }
}

impl<T> Widths<T> {
    /// Counts a line with these words. `place` makes the place of bytes of the line.
    #[inline]
    pub fn see(
        &mut self,
        reader: &RowReader,
        line: &[u8],
        words: &[Range<usize>],
        place: impl FnOnce(Range<usize>) -> T,
    ) {
        if words.len() == reader.width {
            return;
        }
        let end = line.trim_ascii_end().len();
        if words.len() > reader.width {
            self.longer.0 += 1;
            self.longer.1.get_or_insert_with(|| place(words[reader.width].start..end));
        } else if words.last().is_some_and(|last| line[last.end.min(end)..end].iter().all(|b| *b == b'"')) {
            // Empty values at the end, behind separators, are not among the words.
            self.shorter.0 += 1;
            self.shorter.1.get_or_insert_with(|| place(end..end));
        }
    }

    /// Adds the lines of the next piece of a file, whose places `moved` makes those of the file.
    pub fn append<U>(&mut self, later: Widths<U>, moved: impl Fn(U) -> T) {
        for (all, (count, first)) in [(&mut self.longer, later.longer), (&mut self.shorter, later.shorter)] {
            all.0 += count;
            if all.1.is_none() {
                all.1 = first.map(&moved);
            }
        }
    }

    /// A warning for lines with more, and for lines with fewer values, with the first place of each.
    pub fn warnings(self, reader: &RowReader) -> Vec<(T, String)> {
        let (width, first) = (reader.width, reader.layout.first_line);
        let lines = |count: u64| if count == 1 { "line has" } else { "lines have" };
        let commas = match reader.layout.is_separated_by(b',') {
            true => "; a decimal comma divides a number at a comma that separates columns",
            false => "",
        };
        let (longer, shorter) = (self.longer, self.shorter);
        let longer = longer.1.map(|place| {
            let (count, lines) = (longer.0, lines(longer.0));
            let message = format!(
                "{count} {lines} more values than line {first}, which has {width}; the others are not \
                 read{commas}"
            );
            (place, message)
        });
        let shorter = shorter.1.map(|place| {
            let (count, lines) = (shorter.0, lines(shorter.0));
            (place, format!("{count} {lines} fewer values than line {first}, which has {width}"))
        });
        longer.into_iter().chain(shorter).collect()
    }
}
