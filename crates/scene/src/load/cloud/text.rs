//! Reads lines of text with one point each.

use crate::builder::MAX_COORDINATE;
use crate::text::{Line, Lines, Problems, Source, shown};
use std::ops::Range;
use vlscan_base::columns::{Separator, comma_note, has_decimal_comma};
use vlscan_base::diag::Diagnostics;
use vlscan_formats::text::{Layout, LayoutFinder, is_skipped};
use vlscan_formats::{Attribute, Columns, PointRow};
use vlscan_survey::XyzLoader;

/// How the lines of a file are split, and the meaning of their columns.
pub(super) struct RowFormat {
    layout: Layout,
    columns: Columns,
}

/// Columns of the normal unless the scene or the file names others.
const DEFAULT_NORMAL: [usize; 3] = [3, 4, 5];

impl RowFormat {
    /// The format of a file: columns by their names if its first line has any, else by their order. The default columns of the
    /// normal are not looked at if they contain colours or have names. `None` for a file without points.
    pub fn new(
        loader: &XyzLoader,
        has_normals: bool,
        source: &Source,
        diagnostics: &mut Diagnostics,
    ) -> Option<RowFormat> {
        let separator = Separator::any_of(&loader.separator);
        let mut finder = LayoutFinder::new(Some(separator));
        let mut lines = Lines::new(source.bytes(), false);
        let (layout, line) = lines.find_map(|line| {
            let layout = finder.next(source.path(), line.number, &line.text, diagnostics)?;
            Some((layout, line))
        })?;
        let mut words = Vec::new();
        layout.split(&line.text, &mut words);
        let guessed = Separator::guess(&line.text);
        let is_decimal = |line: &Line| {
            let mut words = guessed.split(&line.text).map(|at| shown(&line.text[at]));
            words.find(|word| has_decimal_comma(word))
        };
        let decimal = is_decimal(&line);
        let used = if loader.separator.is_empty() { " " } else { &loader.separator };
        let is_torn = decimal.is_some() && used.contains(',') && !used.contains(&guessed.characters());
        if (words.len() < 3 || is_torn) && guessed.split(&line.text).count() >= 3 {
            // The line may name the columns; the numbers are in the next one then.
            let mut next = || lines.find(|line| !is_skipped(&line.text));
            let hint = decimal.or_else(|| is_decimal(&next()?)).map_or_else(String::new, |word| {
                format!(", and \"{word}\" has a decimal comma; numbers need a decimal point")
            });
            let found = guessed.characters();
            diagnostics.error(
                Some(source.place(line.number, line.start..line.start + line.text.len())),
                format!(
                    "the separator of the part is {used:?}, the columns are separated by {found:?}{hint}"
                ),
            );
        }
        let columns = match layout.is_named() {
            true => {
                let columns = layout.columns;
                let without = if has_normals { &[][..] } else { &Attribute::NORMAL };
                let own = loader.normal_columns.filter(|_| has_normals);
                with_normal(columns.without(without), own)
            }
            false => {
                let colours = loader.rgb_columns.unwrap_or([6, 7, 8]);
                let default = (!DEFAULT_NORMAL.iter().any(|c| colours.contains(c))).then_some(DEFAULT_NORMAL);
                let normal = loader.normal_columns.or(default).filter(|_| has_normals);
                let position = Attribute::POSITION.into_iter().zip(0..);
                let columns =
                    position.fold(Columns::default(), |columns, (a, column)| columns.with(a, column));
                with_normal(columns, normal)
            }
        };
        Some(RowFormat { layout, columns })
    }

    fn split<'a>(&'a self, line: &'a [u8], words: &mut Vec<Range<usize>>) {
        self.layout.split(line, words);
    }

    /// Whether a line has a point, is no line of names and no comment.
    fn is_row(&self, is_first: bool, number: usize, line: &[u8]) -> bool {
        !(is_first && number < self.layout.first_line || is_skipped(line))
    }

    /// Detects a truncated last line: one without a line end and with fewer columns than the first point. Returns the
    /// number of columns of both.
    pub fn find_truncation(&self, bytes: &[u8], last: &[u8]) -> Option<(usize, usize)> {
        let mut lines = Lines::new(bytes, false);
        let first = lines.find(|l| self.is_row(true, l.number, &l.text))?;
        let count = |line: &[u8]| {
            let mut words = Vec::new();
            self.split(line, &mut words);
            words.len()
        };
        let (first, found) = (count(&first.text), count(last));
        (!is_skipped(last) && found >= 3 && found < first).then_some((first, found))
    }

    /// Calls `take` with every point of a piece of the file; returns the number of lines.
    pub fn read(
        &self,
        bytes: &[u8],
        is_first: bool,
        problems: &mut Problems,
        mut take: impl FnMut(PointRow),
    ) -> usize {
        let mut lines = Lines::new(bytes, false);
        let mut words = Vec::new();
        for line in lines.by_ref() {
            if !self.is_row(is_first, line.number, &line.text) {
                continue;
            }
            self.split(&line.text, &mut words);
            match self.parse(&line.text, &words) {
                Ok(point) => match self.layout.missing_values(&words) {
                    None => {
                        self.warn_of_class(&point, &line, &words, problems);
                        take(point);
                    }
                    Some(message) => {
                        let end = line.start + line.text.len();
                        problems.error(line.number, end..end, || message);
                    }
                },
                Err((attribute, at)) => {
                    problems.error(line.number, line.start + at.start..line.start + at.end, || {
                        let found = shown(line.text[at].trim_ascii());
                        let hint = comma_note(&found);
                        match Attribute::POSITION.iter().position(|axis| *axis == attribute) {
                            Some(axis) => format!(
                                "expected the {} of a point within ±{MAX_COORDINATE:e} m, found \"{found}\"{hint}",
                                ["x", "y", "z"][axis]
                            ),
                            None => format!("expected {}, found \"{found}\"{hint}", attribute.described()),
                        }
                    });
                }
            }
        }
        lines.passed
    }

    /// Warns of a class that is not used as written.
    fn warn_of_class(&self, point: &PointRow, line: &Line, words: &[Range<usize>], problems: &mut Problems) {
        let column = self.columns.get(Attribute::Class).filter(|_| point.misfits.has(Attribute::Class));
        if let Some(at) = column.and_then(|column| words.get(column)).cloned() {
            problems.warn(line.number, line.start + at.start..line.start + at.end, || {
                let found = shown(line.text[at].trim_ascii());
                format!("the class \"{found}\" is not a whole number from 0 to 255, {} counts", point.class)
            });
        }
    }

    /// The point of a line, or the attribute without a usable number and the position of its word.
    fn parse(&self, line: &[u8], words: &[Range<usize>]) -> Result<PointRow, (Attribute, Range<usize>)> {
        let point = self.columns.parse(line, words).map_err(|bad| (bad.attribute, bad.at))?;
        // Also false for NaN.
        let is_usable = |axis: usize| point.position[axis].abs() <= MAX_COORDINATE;
        match (0..3).find(|axis| !is_usable(*axis)) {
            Some(axis) => {
                let attribute = Attribute::POSITION[axis];
                let at = self.columns.get(attribute).and_then(|column| words.get(column)).cloned();
                Err((attribute, at.unwrap_or(line.len()..line.len())))
            }
            None => Ok(point),
        }
    }
}

/// The columns with these of the normal, if there are any.
fn with_normal(columns: Columns, normal: Option<[usize; 3]>) -> Columns {
    let normal = normal.map(|columns| Attribute::NORMAL.into_iter().zip(columns));
    normal.into_iter().flatten().fold(columns, |columns, (attribute, column)| columns.with(attribute, column))
}
