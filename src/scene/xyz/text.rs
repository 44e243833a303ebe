//! Reads lines of text with one point each.

use crate::points::text::{Separators, is_heading, is_skipped};
use crate::points::{Attribute, Columns, PointRow};
use crate::scene::builder::MAX_COORDINATE;
use crate::scene::text::{Lines, Problems, shown};
use crate::survey::XyzLoader;
use std::ops::Range;

/// How the lines of a file are split, and the meaning of their columns.
pub(super) struct RowFormat {
    separators: Vec<u8>,
    columns: Columns,
}

/// Columns of the normal unless the scene names others.
const DEFAULT_NORMAL: [usize; 3] = [3, 4, 5];

impl RowFormat {
    /// The format of a loader's files. If the default columns of the normal contain colours, the points have no
    /// normals.
    pub fn new(loader: &XyzLoader, has_normals: bool) -> RowFormat {
        let separators =
            if loader.separator.is_empty() { vec![b' '] } else { loader.separator.clone().into_bytes() };
        let colours = loader.rgb_columns.unwrap_or([6, 7, 8]);
        let default = (!DEFAULT_NORMAL.iter().any(|c| colours.contains(c))).then_some(DEFAULT_NORMAL);
        let normal = loader.normal_columns.or(default).filter(|_| has_normals);
        let position = Attribute::POSITION.into_iter().zip(0..);
        let normal = normal.map(|columns| Attribute::NORMAL.into_iter().zip(columns));
        let used = position.chain(normal.into_iter().flatten());
        let columns = used.fold(Columns::default(), |columns, (a, column)| columns.with(a, column));
        RowFormat { separators, columns }
    }

    fn split<'a>(&'a self, line: &'a [u8]) -> impl Iterator<Item = Range<usize>> + 'a {
        Separators(&self.separators).split(line)
    }

    /// Detects a truncated last line: one without a line end and with fewer columns than the first point. Returns the
    /// number of columns of both.
    pub fn find_truncation(&self, bytes: &[u8], last: &[u8]) -> Option<(usize, usize)> {
        let is_heading = |line: &[u8]| is_heading(line, &self.split(line).collect::<Vec<_>>());
        let mut lines = Lines::new(bytes, false);
        let first = lines.find(|l| !(is_skipped(&l.text) || l.number == 1 && is_heading(&l.text)))?;
        let (first, found) = (self.split(&first.text).count(), self.split(last).count());
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
        for line in lines.by_ref().filter(|line| !is_skipped(&line.text)) {
            words.clear();
            words.extend(self.split(&line.text));
            if is_first && line.number == 1 && is_heading(&line.text, &words) {
                continue;
            }
            match self.parse(&line.text, &words) {
                Ok(point) => take(point),
                Err((axis, at)) => {
                    problems.error(line.number, line.start + at.start..line.start + at.end, || {
                        let found = shown(&line.text[at]);
                        format!(
                            "expected the {} of a point within ±{MAX_COORDINATE:e} m, found \"{found}\"",
                            ["x", "y", "z"][axis]
                        )
                    });
                }
            }
        }
        lines.passed
    }

    /// The point of a line, or the axis without a usable coordinate and the position of its word.
    fn parse(&self, line: &[u8], words: &[Range<usize>]) -> Result<PointRow, (usize, Range<usize>)> {
        let point = self.columns.parse(line, words).map_err(|bad| (bad.attribute as usize, bad.at))?;
        // Also false for NaN.
        let is_usable = |axis: usize| point.position[axis].abs() <= MAX_COORDINATE;
        match (0..3).find(|axis| !is_usable(*axis)) {
            Some(axis) => Err((axis, words[axis].clone())),
            None => Ok(point),
        }
    }
}
