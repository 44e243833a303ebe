//! Pulses as lines of text.

use super::columns::PulseColumn;
use super::row::{DIRECTION, ORIGIN, PulseRow, RowFault};
use super::schema::StreamSchema;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::columns::{Separator, comma_note};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;

/// Maximum length of a line, bytes.
const MAX_LINE_BYTES: usize = 1 << 16;
/// Approximate length of a line with all columns, bytes.
const TYPICAL_LINE_BYTES: usize = 320;

/// Collects bytes and splits them into blocks of complete lines.
#[derive(Debug)]
pub(super) struct LineReader {
    path: PathBuf,
    /// Bytes that have arrived and have not been returned.
    pending: Vec<u8>,
    /// Number of lines that have been returned.
    line: usize,
    format: Option<Arc<TextFormat>>,
}

/// Complete lines that have not been parsed.
#[derive(Clone, Debug)]
pub(super) struct TextRows {
    format: Arc<TextFormat>,
    text: Vec<u8>,
    /// Number of the first line, from 1.
    line: usize,
    rows: u64,
}

#[derive(Debug)]
struct TextFormat {
    separator: Separator,
    schema: StreamSchema,
}

impl LineReader {
    /// A reader without bytes; `path` is the name in messages.
    pub fn new(path: &Path) -> LineReader {
        LineReader { path: path.to_path_buf(), pending: Vec::new(), line: 0, format: None }
    }

    pub fn feed(&mut self, bytes: &[u8]) {
        self.pending.extend_from_slice(bytes);
    }

    /// Whether about `max_rows` rows have arrived, so that a block of them need not wait for more bytes.
    pub fn has_rows(&self, max_rows: usize) -> bool {
        self.pending.len() >= max_rows.saturating_mul(TYPICAL_LINE_BYTES)
    }

    pub fn has_begun(&self) -> bool {
        self.format.is_some()
    }

    /// The next rows that have arrived, at most `max_rows`; `ended` means that no further bytes follow.
    pub fn next_rows(&mut self, max_rows: usize, ended: bool) -> Result<Option<TextRows>> {
        if self.format.is_none() {
            self.read_header(ended)?;
        }
        while let Some(format) = &self.format
            && let Some((bytes, lines, rows)) = self.complete_rows(max_rows, ended)
        {
            let text: Vec<u8> = self.pending.drain(..bytes).collect();
            let taken = TextRows { format: format.clone(), text, line: self.line + 1, rows };
            self.line += lines;
            if rows > 0 {
                return Ok(Some(taken));
            }
        }
        if memchr::memchr(b'\n', &self.pending).is_none() {
            check_length(&self.pending, &self.path, self.line + 1)?;
        }
        Ok(None)
    }

    /// Numbers of bytes, lines and rows of the next block of complete lines.
    fn complete_rows(&self, max_rows: usize, ended: bool) -> Option<(usize, usize, u64)> {
        let (mut end, mut lines, mut rows) = (0, 0, 0);
        while rows < max_rows as u64
            && let Some(length) = self.line_length(end, ended)
        {
            lines += 1;
            rows += u64::from(is_row(&self.pending[end..end + length]));
            end += length;
        }
        (end > 0).then_some((end, lines, rows))
    }

    /// Length of the line at `start` with its line break; `None` while it is incomplete.
    fn line_length(&self, start: usize, ended: bool) -> Option<usize> {
        let rest = &self.pending[start..];
        match memchr::memchr(b'\n', rest) {
            Some(at) => Some(at + 1),
            None => Some(rest.len()).filter(|length| ended && *length > 0),
        }
    }

    /// Reads the columns from the first line that is not a comment.
    fn read_header(&mut self, ended: bool) -> Result<()> {
        let mut at = 0;
        while self.format.is_none()
            && let Some(length) = self.line_length(at, ended)
        {
            let line = &self.pending[at..at + length];
            let mut is_taken = true;
            if is_row(line) {
                check_length(line, &self.path, self.line + 1)?;
                let line = String::from_utf8_lossy(line);
                let line = line.trim_start_matches('\u{feff}').trim_end();
                let (format, is_header) = TextFormat::of(&self.path, self.line + 1, line)?;
                self.format = Some(Arc::new(format));
                is_taken = is_header;
            }
            if is_taken {
                self.line += 1;
                at += length;
            }
        }
        self.pending.drain(..at);
        Ok(())
    }
}

/// Refuses a line that is too long; it may be incomplete.
fn check_length(line: &[u8], path: &Path, number: usize) -> Result<()> {
    if line.len() <= MAX_LINE_BYTES {
        return Ok(());
    }
    let start = String::from_utf8_lossy(&line[..40]);
    let message = format!("a line of more than {MAX_LINE_BYTES} bytes, expected a pulse");
    Err(line_error(path, number, &start, 0..0, message, ""))
}

/// Whether a line contains more than blanks or a comment.
fn is_row(line: &[u8]) -> bool {
    line.iter().find(|b| !b.is_ascii_whitespace()).is_some_and(|b| *b != b'#')
}

/// An error in line `line`, whose text is `text`, with the range `at` underlined.
fn line_error(path: &Path, line: usize, text: &str, at: Range<usize>, message: String, help: &str) -> Error {
    let mut problems = Diagnostics::default();
    let problem = problems.error(Some(Place::in_line(path, line, text, at)), message);
    if !help.is_empty() {
        problem.help(help);
    }
    Error::Input(Box::new(problems))
}

impl TextFormat {
    /// The format of the first line, and whether the line is a header. Without a header seven numbers are time,
    /// origin and direction, and six are origin and direction.
    fn of(path: &Path, number: usize, line: &str) -> Result<(TextFormat, bool)> {
        let separator = Separator::guess(line);
        let fields = separator.split(line);
        let is_header = fields.iter().all(|f| line[f.clone()].parse::<f64>().is_err());
        let place = |at: Range<usize>| Place::in_line(path, number, line, at);
        let schema = if is_header {
            let headings = fields.iter().map(|f| (&line[f.clone()], place(f.clone()), None));
            StreamSchema::from_headings(path, headings, place(0..line.len()))?
        } else {
            if !matches!(fields.len(), 6 | 7) {
                let message = format!("{} numbers and no header that names them", fields.len());
                let help = "without a header the columns are time, x, y, z, dx, dy, dz";
                return Err(line_error(path, number, line, 0..line.len(), message, help));
            }
            let seconds = std::iter::once((PulseColumn::Time, 1e9)).filter(|_| fields.len() == 7);
            let metres = ORIGIN.iter().chain(&DIRECTION).map(|c| (*c, 1.0));
            StreamSchema::without_headings(path, seconds.chain(metres))
        };
        Ok((TextFormat { separator, schema }, is_header))
    }

    fn push_pulse(
        &self,
        (line, number): (&str, usize),
        shift: DVec3,
        order: u64,
        into: &mut Vec<PulseRow>,
        check: &impl Fn(&PulseRow) -> Result<(), RowFault>,
    ) -> Result<()> {
        let fields = self.separator.split(line);
        let fail = |at, message| line_error(&self.schema.path, number, line, at, message, "");
        if fields.len() != self.schema.width() {
            let message =
                format!("{} columns, expected {} as in the header", fields.len(), self.schema.width());
            return Err(fail(0..line.len(), message));
        }
        let values = self.schema.values(|column, at| {
            let text = &line[fields[at].clone()];
            text.parse::<f64>().map_err(|_| {
                let name = column.entry().name;
                let message = format!("expected a number for {name}, found `{text}`{}", comma_note(text));
                fail(fields[at].clone(), message)
            })
        })?;
        self.schema.push_pulse(&values, shift, order, into, check).map_err(|(column, message)| {
            let at = self.schema.position(column).map(|at| fields[at].clone());
            fail(at.unwrap_or(0..line.len()), message)
        })
    }
}

impl TextRows {
    pub fn count(&self) -> u64 {
        self.rows
    }

    /// Epoch of the first pulse; the other rows are not parsed.
    pub fn first_epoch(&self) -> u32 {
        let Some(at) = self.format.schema.position(PulseColumn::Epoch) else { return 0 };
        let line = self.text.split(|b| *b == b'\n').find(|l| is_row(l)).unwrap_or_default();
        self.epoch_of(line, at)
    }

    fn epoch_of(&self, line: &[u8], at: usize) -> u32 {
        let text = String::from_utf8_lossy(line);
        let fields = self.format.separator.split(&text);
        // An invalid number is reported when the row is parsed.
        fields.get(at).and_then(|f| text[f.clone()].parse().ok()).unwrap_or(0)
    }

    /// Splits the rows before the first pulse of another epoch; the second value is the rest.
    pub fn split_at_epoch(mut self) -> (TextRows, Option<TextRows>) {
        let Some(at) = self.format.schema.position(PulseColumn::Epoch) else { return (self, None) };
        let epoch = self.first_epoch();
        let (mut end, mut lines, mut rows) = (0, 0, 0);
        for line in self.text.split_inclusive(|b| *b == b'\n') {
            if is_row(line) {
                if self.epoch_of(line, at) != epoch {
                    let rest = TextRows {
                        format: self.format.clone(),
                        text: self.text.split_off(end),
                        line: self.line + lines,
                        rows: self.rows - rows,
                    };
                    self.rows = rows;
                    return (self, Some(rest));
                }
                rows += 1;
            }
            (end, lines) = (end + line.len(), lines + 1);
        }
        (self, None)
    }

    /// Appends the rows as pulses in the frame whose origin is at `shift` in the world. `before` is the number of
    /// rows in the stream before this block; `check` accepts or refuses each pulse.
    ///
    /// # Errors
    /// [`Error::Input`] for the first row that is not a valid pulse, with its line and column.
    pub fn pulses(
        &self,
        shift: DVec3,
        before: u64,
        into: &mut Vec<PulseRow>,
        check: impl Fn(&PulseRow) -> Result<(), RowFault>,
    ) -> Result<()> {
        let lines = (self.line..).zip(self.text.split(|b| *b == b'\n')).filter(|(_, line)| is_row(line));
        for (order, (number, line)) in (before..).zip(lines) {
            check_length(line, &self.format.schema.path, number)?;
            let line = String::from_utf8_lossy(line);
            self.format.push_pulse((line.trim_end(), number), shift, order, into, &check)?;
        }
        Ok(())
    }
}
