//! Pulses as lines of text: which columns a line has, and rows that were not looked into yet.

use super::columns::{COLUMNS, Column, named};
use super::read::check_complete;
use super::row::{DIRECTION, ORIGIN, Present, PulseRow};
use crate::columns::Separator;
use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use crate::geom::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Longer lines are no pulses.
const LONGEST_LINE: usize = 1 << 16;
/// About as long is the line of a pulse with all columns.
const USUAL_LINE: usize = 320;

/// Lines that have arrived.
#[derive(Debug)]
pub(super) struct Lines {
    path: PathBuf,
    /// Bytes that have arrived and are in no block yet.
    rest: Vec<u8>,
    line: usize,
    format: Option<Arc<TextFormat>>,
}

/// Whole lines as they arrived, not looked into yet.
#[derive(Clone, Debug)]
pub(super) struct TextRows {
    format: Arc<TextFormat>,
    text: Vec<u8>,
    /// Number of the first line.
    line: usize,
    rows: u64,
}

/// How lines are read.
#[derive(Debug)]
struct TextFormat {
    path: PathBuf,
    separator: Separator,
    /// Column and factor by position.
    columns: Vec<(Column, f64)>,
    present: Present,
}

impl Lines {
    /// Nothing has arrived yet; `path` is the name in messages.
    pub fn new(path: &Path) -> Lines {
        Lines { path: path.to_path_buf(), rest: Vec::new(), line: 0, format: None }
    }

    /// Takes in what has arrived.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.rest.extend_from_slice(bytes);
    }

    /// Whether so much has arrived that no more should be waited for when `most` rows are wanted.
    pub fn are_many(&self, most: usize) -> bool {
        self.rest.len() >= most.saturating_mul(USUAL_LINE)
    }

    /// Whether any line told the columns.
    pub fn have_begun(&self) -> bool {
        self.format.is_some()
    }

    /// The next rows that have arrived, at most `most`; `ended` says that nothing follows.
    pub fn next_rows(&mut self, most: usize, ended: bool) -> Result<Option<TextRows>> {
        if self.format.is_none() {
            self.read_header(ended)?;
        }
        while let Some(format) = &self.format
            && let Some((bytes, lines, rows)) = self.whole_rows(most, ended)
        {
            let text: Vec<u8> = self.rest.drain(..bytes).collect();
            let taken = TextRows { format: format.clone(), text, line: self.line + 1, rows };
            self.line += lines;
            if rows > 0 {
                return Ok(Some(taken));
            }
        }
        if self.rest.len() > LONGEST_LINE && !self.rest.contains(&b'\n') {
            let start = String::from_utf8_lossy(&self.rest[..40]).into_owned();
            let message = format!("a line of more than {LONGEST_LINE} bytes, expected a pulse");
            return Err(refused(&self.path, self.line + 1, &start, 0..0, message, ""));
        }
        Ok(None)
    }

    /// Bytes, lines and rows of the next block: whole lines up to the block's size, all that are there.
    fn whole_rows(&self, most: usize, ended: bool) -> Option<(usize, usize, u64)> {
        let (mut end, mut lines, mut rows) = (0, 0, 0);
        while rows < most as u64 {
            let rest = &self.rest[end..];
            let length = match memchr::memchr(b'\n', rest) {
                Some(at) => at + 1,
                None if ended && !rest.is_empty() => rest.len(),
                None => break,
            };
            lines += 1;
            rows += u64::from(is_row(&rest[..length]));
            end += length;
        }
        (end > 0).then_some((end, lines, rows))
    }

    /// Finds out from the first line that is no remark how the rows are made up.
    fn read_header(&mut self, ended: bool) -> Result<()> {
        loop {
            let end = match memchr::memchr(b'\n', &self.rest) {
                Some(at) => at + 1,
                None if ended && !self.rest.is_empty() => self.rest.len(),
                None => return Ok(()),
            };
            if !is_row(&self.rest[..end]) {
                self.line += 1;
                self.rest.drain(..end);
                continue;
            }
            let line = String::from_utf8_lossy(&self.rest[..end]).into_owned();
            let line = line.trim_start_matches('\u{feff}').trim_end();
            let (format, is_header) = TextFormat::of(&self.path, self.line + 1, line)?;
            if is_header {
                self.line += 1;
                self.rest.drain(..end);
            }
            self.format = Some(Arc::new(format));
            return Ok(());
        }
    }
}

/// Whether a line holds anything but blanks or a remark.
fn is_row(line: &[u8]) -> bool {
    line.iter().find(|b| !b.is_ascii_whitespace()).is_some_and(|b| *b != b'#')
}

fn refused(
    path: &Path,
    line: usize,
    text: &str,
    at: std::ops::Range<usize>,
    message: String,
    help: &str,
) -> Error {
    let mut problems = Diagnostics::default();
    let problem = problems.error(Some(Place::in_line(path, line, text, at)), message);
    if !help.is_empty() {
        problem.help(help);
    }
    Error::Input(Box::new(problems))
}

impl TextFormat {
    /// The columns that a line names; seven numbers are time, origin and direction, six lack the time. The second value
    /// tells whether the line was a header.
    fn of(path: &Path, number: usize, line: &str) -> Result<(TextFormat, bool)> {
        let separator = Separator::guess(line);
        let fields = separator.split(line);
        let is_header = fields.iter().all(|f| line[f.clone()].parse::<f64>().is_err());
        let mut format = TextFormat {
            path: path.to_path_buf(),
            separator,
            columns: Vec::new(),
            present: Present::default(),
        };
        if !is_header {
            let seconds = std::iter::once((Column::Time, 1e9)).filter(|_| fields.len() == 7);
            let metres = ORIGIN.iter().chain(&DIRECTION).map(|c| (*c, 1.0));
            if !matches!(fields.len(), 6 | 7) {
                let message = format!("{} numbers and no header that names them", fields.len());
                let help = "without a header the columns are time, x, y, z, dx, dy, dz";
                return Err(refused(path, number, line, 0..line.len(), message, help));
            }
            format.columns = seconds.chain(metres).collect();
            format.present = format.columns.iter().fold(Present::default(), |p, c| p.with(c.0));
            return Ok((format, false));
        }
        let mut problems = Diagnostics::default();
        for field in fields {
            let place = Some(Place::in_line(path, number, line, field.clone()));
            match named(&line[field.clone()]) {
                Ok((column, _)) if format.present.has(column) => {
                    problems.error(place, format!("a second column for {}", column.entry().name));
                }
                Ok((column, factor)) => {
                    format.columns.push((column, factor));
                    format.present = format.present.with(column);
                }
                Err((message, help)) => {
                    problems.error(place, message).help(help);
                }
            }
        }
        if problems.is_empty() {
            check_complete(format.present, Place::in_line(path, number, line, 0..line.len()), &mut problems);
        }
        problems.finish(false)?;
        Ok((format, true))
    }
}

impl TextRows {
    /// Number of rows.
    pub fn count(&self) -> u64 {
        self.rows
    }

    /// Number of the play of the first pulse, without looking at the others.
    pub fn first_play(&self) -> u32 {
        let Some(at) = self.format.columns.iter().position(|c| c.0 == Column::Play) else { return 0 };
        let line = self.text.split(|b| *b == b'\n').find(|l| is_row(l)).unwrap_or_default();
        self.play_in(line, at)
    }

    fn play_in(&self, line: &[u8], at: usize) -> u32 {
        let text = String::from_utf8_lossy(line);
        let fields = self.format.separator.split(&text);
        // What is no number is reported when the row is read.
        fields.get(at).and_then(|f| text[f.clone()].parse().ok()).unwrap_or(0)
    }

    /// Cuts the block where another play begins than that of its first pulse; the second value is the rest.
    pub fn split_at_play(self) -> (TextRows, Option<TextRows>) {
        let Some(at) = self.format.columns.iter().position(|c| c.0 == Column::Play) else {
            return (self, None);
        };
        let play = self.first_play();
        let (mut end, mut lines, mut rows) = (0, 0, 0);
        for line in self.text.split_inclusive(|b| *b == b'\n') {
            if is_row(line) {
                if self.play_in(line, at) != play {
                    let mut first = self;
                    let rest = TextRows {
                        format: first.format.clone(),
                        text: first.text.split_off(end),
                        line: first.line + lines,
                        rows: first.rows - rows,
                    };
                    first.rows = rows;
                    return (first, Some(rest));
                }
                rows += 1;
            }
            (end, lines) = (end + line.len(), lines + 1);
        }
        (self, None)
    }

    /// Turns the rows into pulses in the frame whose origin lies at `shift` in the world. `before` counts those of
    /// the stream before them, and `check` looks at each.
    ///
    /// # Errors
    /// [`Error::Input`] for the first row that is no pulse, with its line and column.
    pub fn pulses(
        &self,
        shift: DVec3,
        before: u64,
        into: &mut Vec<PulseRow>,
        check: impl Fn(&PulseRow) -> Result<(), (Column, String)>,
    ) -> Result<()> {
        let mut order = before;
        for (number, line) in (self.line..).zip(self.text.split(|b| *b == b'\n')) {
            if !is_row(line) {
                continue;
            }
            let line = String::from_utf8_lossy(line);
            let line = line.trim_end();
            let row = self.format.row(line, number, shift, order)?;
            if let Err((column, message)) = check(&row) {
                return Err(self.format.blame(column, line, number, message));
            }
            into.push(row);
            order += 1;
        }
        Ok(())
    }
}

impl TextFormat {
    fn row(&self, line: &str, number: usize, shift: DVec3, order: u64) -> Result<PulseRow> {
        let mut values = [0.0; COLUMNS];
        let fields = self.separator.split(line);
        if fields.len() != self.columns.len() {
            let message =
                format!("{} columns, expected {} as in the header", fields.len(), self.columns.len());
            return Err(refused(&self.path, number, line, 0..line.len(), message, ""));
        }
        for ((column, factor), field) in self.columns.iter().zip(&fields) {
            let text = &line[field.clone()];
            let Ok(value) = text.parse::<f64>() else {
                let message = format!("expected a number for {}, found `{text}`", column.entry().name);
                return Err(refused(&self.path, number, line, field.clone(), message, ""));
            };
            values[*column as usize] = value * factor;
        }
        PulseRow::of(&values, self.present, shift, order)
            .map_err(|fault| self.blame(fault.column, line, number, fault.message))
    }

    fn blame(&self, column: Column, line: &str, number: usize, message: String) -> Error {
        let at = self.columns.iter().position(|c| c.0 == column);
        let field = at.and_then(|at| self.separator.split(line).get(at).cloned());
        refused(&self.path, number, line, field.unwrap_or(0..line.len()), message, "")
    }
}
