//! Reads lines of text with one point each.

use crate::builder::MAX_COORDINATE;
use crate::text::{Line, Lines, Problems, Source, shown};
use std::ops::Range;
use vlscan_base::columns::{Separator, has_decimal_comma};
use vlscan_base::diag::Diagnostics;
use vlscan_base::quantity;
use vlscan_formats::text::{BadRow, LayoutFinder, RowReader, Widths, is_skipped};
use vlscan_formats::{Attribute, Columns, PointRow};
use vlscan_geom::DVec3;
use vlscan_survey::XyzLoader;

/// How the lines of a file are split, and the meaning of their columns.
pub(super) struct RowFormat {
    rows: RowReader,
}

/// Number of a line, from 1, and bytes within the file or a piece of it.
pub(super) type LinePlace = (usize, Range<usize>);

/// Maximum length of a normal in columns without names that causes no warning.
const MAX_LIKELY_NORMAL: f64 = 2.5;

/// Columns of the normal unless the scene or the file names others.
const DEFAULT_NORMAL: [usize; 3] = [3, 4, 5];

impl RowFormat {
    /// The format of a file: columns by their names if its first line has any, else by their order. The
    /// default columns of the normal are ignored if they contain colours or have names. `None` for a file
    /// without points.
    pub fn new(
        loader: &XyzLoader,
        (has_normals, has_colours): (bool, bool),
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
        let has_commas = guessed.split(&line.text).any(|at| has_decimal_comma(&shown(&line.text[at])));
        let used = if loader.separator.is_empty() { " " } else { &loader.separator };
        let is_torn = has_commas && used.contains(',') && !used.contains(&guessed.characters());
        if (words.len() < 3 || is_torn) && guessed.split(&line.text).count() >= 3 {
            let found = guessed.characters();
            diagnostics.error(
                Some(source.place(line.number, line.start..line.start + line.text.len())),
                format!("the separator of the part is {used:?}, the columns are separated by {found:?}"),
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
        let colours = match layout.is_named() {
            true => columns.colours(),
            false => loader.rgb_columns,
        };
        let columns = columns.with_colours(colours.filter(|_| has_colours));
        let rows = RowReader::new(layout, columns, &line.text);
        warn_of_unread(&rows, loader, source, &line, diagnostics);
        if loader.normal_columns.is_none() && !rows.is_named() {
            warn_of_other_values(&rows, source, &line, diagnostics);
        }
        Some(RowFormat { rows })
    }

    /// Detects a truncated last line: one without a line end and with fewer columns than the first point.
    /// Returns the number of columns of both.
    pub fn find_truncation(&self, last: &[u8]) -> Option<(usize, usize)> {
        let mut words = Vec::new();
        self.rows.split(last, &mut words);
        let (first, found) = (self.rows.width(), words.len());
        (!is_skipped(last) && found >= 3 && found < first).then_some((first, found))
    }

    /// The warnings about lines with more or fewer values than the first point.
    pub fn warnings(&self, widths: Widths<LinePlace>) -> Vec<(LinePlace, String)> {
        widths.warnings(&self.rows)
    }

    /// Calls `take` with every point of a piece of the file; returns the number of lines, and those of other
    /// lengths.
    pub fn read(
        &self,
        bytes: &[u8],
        is_first: bool,
        problems: &mut Problems,
        mut take: impl FnMut(PointRow),
    ) -> (usize, Widths<LinePlace>) {
        let mut lines = Lines::new(bytes, false);
        let (mut words, mut widths) = (Vec::new(), Widths::default());
        for line in lines.by_ref() {
            // Only the first piece has lines before the first point.
            let number = if is_first { line.number } else { usize::MAX };
            if self.rows.is_skipped(number, &line.text) {
                continue;
            }
            self.rows.split(&line.text, &mut words);
            let in_file = |at: Range<usize>| line.start + at.start..line.start + at.end;
            match self.parse(&line.text, &words) {
                Ok(point) => {
                    widths.see(&self.rows, &line.text, &words, |at| (line.number, in_file(at)));
                    self.warn_of_class(&point, &line, &words, problems);
                    take(point);
                }
                Err(BadRow { at, message, .. }) => problems.error(line.number, in_file(at), || message),
            }
        }
        (lines.passed, widths)
    }

    /// Warns of a class that is not used as written.
    fn warn_of_class(&self, point: &PointRow, line: &Line, words: &[Range<usize>], problems: &mut Problems) {
        let is_misfit = point.misfits.has(Attribute::Class);
        if let Some(at) = self.rows.word(Attribute::Class, words).filter(|_| is_misfit) {
            problems.warn(line.number, line.start + at.start..line.start + at.end, || {
                let found = shown(line.text[at].trim_ascii());
                format!("the class \"{found}\" is not a whole number from 0 to 255, {} counts", point.class)
            });
        }
    }

    /// The point of a line.
    fn parse(&self, line: &[u8], words: &[Range<usize>]) -> Result<PointRow, BadRow> {
        let point = self.rows.parse(line, words)?;
        // Also false for NaN.
        let is_usable = |axis: &usize| point.position[*axis].abs() <= MAX_COORDINATE;
        match (0..3).find(|axis| !is_usable(axis)) {
            Some(axis) => {
                let at = self.rows.word(Attribute::POSITION[axis], words).unwrap_or(line.len()..line.len());
                let (name, found) = (["x", "y", "z"][axis], shown(line[at.clone()].trim_ascii()));
                let message =
                    format!("expected the {name} of a point within ±{MAX_COORDINATE:e} m, found \"{found}\"");
                Err(BadRow { at, message, help: None })
            }
            None => Ok(point),
        }
    }
}

/// Warns of columns without names that are not coordinates, a normal or colours.
fn warn_of_unread(
    rows: &RowReader,
    loader: &XyzLoader,
    source: &Source,
    line: &Line,
    diagnostics: &mut Diagnostics,
) {
    let triples = [loader.rgb_columns.unwrap_or([6, 7, 8]), loader.normal_columns.unwrap_or(DEFAULT_NORMAL)];
    let is_there = |triple: &&[usize; 3]| triple.iter().all(|column| *column < rows.width());
    let is_known = |column: &usize| {
        let mut used = rows.columns().used().filter(|(a, _)| !Attribute::NORMAL.contains(a));
        used.any(|(_, used)| used == *column)
            || triples.iter().filter(is_there).any(|triple| triple.contains(column))
    };
    let mut unread = (0..rows.width()).filter(|column| !is_known(column));
    let is_unstated = loader.normal_columns.is_none() && loader.rgb_columns.is_none();
    if let Some(first) = unread.next().filter(|_| is_unstated && !rows.is_named()) {
        let place = source.place(line.number, line.start..line.start + line.text.len());
        let message = match unread.next_back() {
            Some(last) => format!("columns {} to {} have no names and are not read", first + 1, last + 1),
            None => format!("column {} has no name and is not read", first + 1),
        };
        diagnostics.warn(Some(place), message).help("name the columns in the first line: `x y z class`");
    }
}

/// Warns of a first point whose normal in columns without names is too long to be one: colours, or halves of
/// numbers with decimal commas.
fn warn_of_other_values(rows: &RowReader, source: &Source, line: &Line, diagnostics: &mut Diagnostics) {
    let mut words = Vec::new();
    rows.split(&line.text, &mut words);
    let normal = rows.parse(&line.text, &words).ok().and_then(|point| point.normal);
    let Some(length) = normal.map(DVec3::length).filter(|length| *length > MAX_LIKELY_NORMAL) else { return };
    let place = source.place(line.number, line.start..line.start + line.text.len());
    let length = quantity::fixed(length, 1);
    let message = format!("columns 4 to 6 have no names and are read as a normal, whose length is {length}");
    diagnostics.warn(Some(place), message).help(
        "name the columns in the first line, for example `x y z red green blue`; numbers with decimal commas \
         need columns separated by semicolons or tabs",
    );
}

/// The columns with these of the normal, if there are any.
fn with_normal(columns: Columns, normal: Option<[usize; 3]>) -> Columns {
    let normal = normal.map(|columns| Attribute::NORMAL.into_iter().zip(columns));
    normal.into_iter().flatten().fold(columns, |columns, (attribute, column)| columns.with(attribute, column))
}
