//! Rows of tables of numbers, as lines of text or as record batches of an Arrow stream, decoded while they
//! arrive: [`RowDecoder`] takes bytes and returns blocks of complete rows, whose numbers any thread can read.
//! The caller interprets the columns, and finds the names in [`RowDecoder::fields`] or in the first
//! row of the text.

use super::arrow::{ArrowDecoder, ArrowDetection, NumberBatch, TableField, detect_arrow};
use crate::check_width;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::columns::{Separator, comma_note, has_decimal_comma, stated_separator};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::recognise::{Expected, FIRST_BYTES, Family, foreign};

/// Maximum length of a line, bytes.
const MAX_LINE_BYTES: usize = 1 << 16;
/// Number of characters that are shown of a line that is too long.
const SHOWN_OF_LONG_LINE: usize = 40;
/// Maximum number of lines before the first row.
const MAX_LEADING_LINES: usize = 1000;

/// Decodes a stream of rows. Blank lines and comments of text are skipped; the first bytes distinguish text
/// from Arrow.
#[derive(Debug)]
pub struct RowDecoder {
    source: Arc<Source>,
    /// Name of a row in messages.
    what: &'static str,
    format: Format,
    /// Number of rows that have been returned.
    rows: u64,
}

/// A stream and how its lines are split.
#[derive(Clone, Debug)]
struct Source {
    path: PathBuf,
    separator: Separator,
}

#[derive(Debug)]
enum Format {
    /// Too few bytes have arrived to decide.
    Unknown(Vec<u8>, Option<char>, bool),
    Text(TextDecoder),
    Arrow(Box<ArrowDecoder>, Option<RowBlock>),
}

#[derive(Debug)]
struct TextDecoder {
    /// Bytes that have arrived and have not been returned.
    pending: Vec<u8>,
    /// True once the kind of the stream has been checked.
    is_checked: bool,
    /// Number of lines that have been returned.
    line: usize,
    /// The separator that is named, by the caller or in the stream.
    named: Option<char>,
    has_begun: bool,
    /// True if lines of words may stand before the first row of numbers.
    may_have_preamble: bool,
    /// The comments and lines of words before the first row.
    leading: Vec<LeadingLine>,
}

/// A line before the first row.
#[derive(Clone, Debug, PartialEq)]
pub struct LeadingLine {
    /// The complete line.
    pub place: Place,
    /// Its text without blanks around it.
    pub text: String,
    /// True if it begins with `#`.
    pub is_comment: bool,
}

impl RowDecoder {
    /// A decoder without bytes. `path` is the name in messages, `what` describes a row; without a separator
    /// the first row determines it.
    pub fn new(path: &Path, what: &'static str, separator: Option<char>) -> RowDecoder {
        let source = Arc::new(Source { path: path.to_path_buf(), separator: Separator::Blanks });
        RowDecoder { source, what, format: Format::Unknown(Vec::new(), separator, false), rows: 0 }
    }

    /// This decoder for files in which lines of words may stand before the first row of numbers; they are
    /// among [`RowDecoder::leading`]. In a text without numbers the last line of words is the first row.
    pub fn with_preamble(mut self) -> RowDecoder {
        if let Format::Unknown(_, _, may_have_preamble) = &mut self.format {
            *may_have_preamble = true;
        }
        self
    }

    /// Adds bytes that have arrived.
    pub fn feed(&mut self, bytes: &[u8]) {
        match &mut self.format {
            Format::Text(text) => text.pending.extend_from_slice(bytes),
            Format::Arrow(decoder, _) => decoder.feed(bytes),
            Format::Unknown(first, named, may_have_preamble) => {
                first.extend_from_slice(bytes);
                match detect_arrow(first) {
                    ArrowDetection::NeedMoreBytes => {}
                    ArrowDetection::Other => {
                        let text = TextDecoder::new(std::mem::take(first), *named, *may_have_preamble);
                        self.format = Format::Text(text);
                    }
                    ArrowDetection::Arrow => {
                        let mut decoder = ArrowDecoder::new(&self.source.path);
                        decoder.feed(first);
                        self.format = Format::Arrow(Box::new(decoder), None);
                    }
                }
            }
        }
    }

    /// The columns of an Arrow stream, once they have arrived.
    pub fn fields(&self) -> Option<&Arc<[TableField]>> {
        match &self.format {
            Format::Arrow(decoder, _) => decoder.fields(),
            _ => None,
        }
    }

    /// The comments before the first row of text, and lines of words if the decoder accepts a preamble.
    pub fn leading(&self) -> &[LeadingLine] {
        match &self.format {
            Format::Text(text) => &text.leading,
            _ => &[],
        }
    }

    /// True if about `bytes` bytes of text have arrived that have not been returned.
    pub fn has_pending(&self, bytes: usize) -> bool {
        !matches!(&self.format, Format::Text(text) if text.pending.len() < bytes)
    }

    /// True if a row of text or the columns of an Arrow stream have arrived.
    pub fn has_begun(&self) -> bool {
        match &self.format {
            Format::Unknown(..) => false,
            Format::Text(text) => text.has_begun,
            Format::Arrow(decoder, _) => decoder.fields().is_some(),
        }
    }

    /// The next rows that have arrived, at most `max_rows`; `ended` means that no further bytes follow. The
    /// first row of text may hold the names of the columns.
    ///
    /// # Errors
    /// [`Error::Input`] for lines that are too long, for bytes that are not text, and for damaged and cut
    /// Arrow streams. The rows before are returned first.
    pub fn next_block(&mut self, max_rows: usize, ended: bool) -> Result<Option<RowBlock>> {
        if ended && let Format::Unknown(first, named, may_have_preamble) = &mut self.format {
            // A beginning of an Arrow stream that is too short to be recognised is read as text.
            self.format = Format::Text(TextDecoder::new(std::mem::take(first), *named, *may_have_preamble));
        }
        let mut rest = None;
        let content = match &mut self.format {
            Format::Unknown(..) => None,
            Format::Text(text) => {
                let lines = text.next_lines(max_rows, ended, &mut self.source, self.what)?;
                lines.map(|lines| (0..lines.rows.len(), Content::Text(Arc::new(lines))))
            }
            Format::Arrow(decoder, kept) => {
                rest = kept.take();
                let batch = if rest.is_none() { decoder.next_batch()? } else { None };
                if ended && batch.is_none() && rest.is_none() {
                    decoder.end()?;
                }
                batch.map(|batch| (0..batch.rows, Content::Batch(Arc::new(batch))))
            }
        };
        let (source, before) = (self.source.clone(), self.rows);
        let block = content.map(|(rows, content)| RowBlock { source, content, rows, before }).or(rest);
        let (block, rest) = block.map_or((None, None), |block| {
            let (block, rest) = block.split_at(max_rows);
            (Some(block), rest)
        });
        if let Format::Arrow(_, kept) = &mut self.format {
            *kept = rest;
        }
        self.rows += block.as_ref().map_or(0, |block| block.len() as u64);
        Ok(block)
    }
}

impl TextDecoder {
    fn new(pending: Vec<u8>, named: Option<char>, may_have_preamble: bool) -> TextDecoder {
        TextDecoder {
            pending,
            is_checked: false,
            line: 0,
            named,
            has_begun: false,
            may_have_preamble,
            leading: Vec::new(),
        }
    }

    /// Refuses a stream that begins as a file of another kind does, once its first line or enough bytes have
    /// arrived.
    fn refuse_foreign(&mut self, path: &Path, ended: bool, what: &'static str) -> Result<()> {
        let has_line = memchr::memchr2(b'\n', b'\r', &self.pending).is_some();
        if self.is_checked || !(has_line || ended || self.pending.len() >= FIRST_BYTES) {
            return Ok(());
        }
        self.is_checked = true;
        let found = foreign(path, &self.pending, &Expected::ROWS.named(what));
        // Unknown bytes are errors at their line.
        match found.filter(|found| found.kind.family != Family::Binary) {
            Some(found) => Err(found.error(path)),
            None => Ok(()),
        }
    }

    /// The next complete lines with rows; `None` if there are none. The first one decides the separator.
    fn next_lines(
        &mut self,
        max_rows: usize,
        ended: bool,
        source: &mut Arc<Source>,
        what: &'static str,
    ) -> Result<Option<Lines>> {
        self.refuse_foreign(&source.path, ended, what)?;
        let named = source.clone();
        let refuse = |number, line: &[u8], message| {
            let start = String::from_utf8_lossy(&line[..line.len().min(SHOWN_OF_LONG_LINE)]);
            let place = Place::in_line(&named.path, number, &start, 0..0);
            Err(RowError { place, message }.with_help(""))
        };
        let (mut rows, mut at) = (Vec::new(), 0);
        while rows.len() < max_rows {
            let rest = &self.pending[at..];
            let length = line_length(rest, ended);
            if length.map_or(rest.len(), |(length, _)| length) > MAX_LINE_BYTES {
                if !rows.is_empty() {
                    break;
                }
                let message = format!("a line of more than {MAX_LINE_BYTES} bytes, expected {what}");
                return refuse(self.line + 1, rest, message);
            }
            let Some((length, with_end)) = length else { break };
            self.line += 1;
            let mut line = at..at + length;
            at += with_end;
            if self.line == 1 && self.pending[line.clone()].starts_with(b"\xef\xbb\xbf") {
                line.start += 3;
            }
            let text = &self.pending[line.clone()];
            if self.line == 1 && text.contains(&0) {
                return refuse(1, &[], format!("expected {what} as text, found binary data"));
            }
            match text.trim_ascii_start() {
                [] => continue,
                [b'#', ..] => {
                    if !self.has_begun {
                        self.leading.push(LeadingLine::of(&source.path, self.line, text, true));
                    }
                    continue;
                }
                _ => {}
            }
            if !self.has_begun {
                let shown = String::from_utf8_lossy(text);
                if let Some(stated) = stated_separator(&shown) {
                    self.named = self.named.or(Some(stated));
                    continue;
                }
                let separator = self.named.map_or_else(|| Separator::guess(text), Separator::named);
                let is_word = self.may_have_preamble && !is_row_of_numbers(text, separator);
                if is_word && self.leading.len() < MAX_LEADING_LINES {
                    self.leading.push(LeadingLine::of(&source.path, self.line, text, false));
                    continue;
                }
                self.has_begun = true;
                *source = Arc::new(Source { path: source.path.clone(), separator });
            }
            rows.push((self.line, line));
        }
        let bytes: Vec<u8> = self.pending.drain(..at).collect();
        if ended && !self.has_begun && self.pending.is_empty() {
            return Ok(self.last_words(source));
        }
        Ok((!rows.is_empty()).then_some(Lines { bytes, rows }))
    }

    /// The last line of words as the first row, if there is one.
    fn last_words(&mut self, source: &mut Arc<Source>) -> Option<Lines> {
        let index = self.leading.iter().rposition(|line| !line.is_comment)?;
        let line = self.leading.remove(index);
        let bytes = line.text.into_bytes();
        let separator = self.named.map_or_else(|| Separator::guess(&bytes), Separator::named);
        *source = Arc::new(Source { path: source.path.clone(), separator });
        self.has_begun = true;
        Some(Lines { rows: vec![(line.place.line, 0..bytes.len())], bytes })
    }
}

impl LeadingLine {
    fn of(path: &Path, number: usize, text: &[u8], is_comment: bool) -> LeadingLine {
        let place = line_place(path, number, text, 0..text.len());
        LeadingLine { place, text: String::from_utf8_lossy(text).trim().to_owned(), is_comment }
    }
}

/// True if a line consists of numbers, or mostly of numbers, so that it is neither a heading nor a sentence.
fn is_row_of_numbers(line: &[u8], separator: Separator) -> bool {
    let is_number = |word: &[u8]| {
        let text = std::str::from_utf8(word).ok().map(str::trim);
        text.is_some_and(|text| text.parse::<f64>().is_ok() || has_decimal_comma(text))
    };
    let (mut fields, mut numbers, mut begins) = (0, 0, false);
    for at in separator.split(line) {
        let is_number = is_number(&line[at]);
        begins |= fields == 0 && is_number;
        fields += 1;
        numbers += usize::from(is_number);
    }
    // A pose whose first column is a calendar time or the name of a frame has at least six numbers.
    begins && 2 * numbers >= fields || numbers >= 6 && 4 * numbers >= 3 * fields
}

/// Length of the first line of a text, without and with its end: a line feed, a carriage return or both.
/// `None` while it is incomplete; `ended` means that no further bytes follow.
pub fn line_length(text: &[u8], ended: bool) -> Option<(usize, usize)> {
    let Some(at) = memchr::memchr2(b'\n', b'\r', text) else {
        return (ended && !text.is_empty()).then_some((text.len(), text.len()));
    };
    match (text[at], text.get(at + 1)) {
        (b'\r', Some(b'\n')) => Some((at, at + 2)),
        (b'\r', None) if !ended => None,
        _ => Some((at, at + 1)),
    }
}

/// Complete lines with rows, each with its number, from 1.
#[derive(Debug, Default)]
struct Lines {
    bytes: Vec<u8>,
    rows: Vec<(usize, Range<usize>)>,
}

/// Rows whose numbers have not been read.
#[derive(Clone, Debug)]
pub struct RowBlock {
    source: Arc<Source>,
    content: Content,
    rows: Range<usize>,
    /// Number of rows in the stream before the first one of `content`.
    before: u64,
}

#[derive(Clone, Debug)]
enum Content {
    Text(Arc<Lines>),
    Batch(Arc<NumberBatch>),
}

impl RowBlock {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// True if there are no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Number of rows in the stream before this block.
    pub fn before(&self) -> u64 {
        self.before + self.rows.start as u64
    }

    /// The first `count` rows and the others, if there are others.
    pub fn split_at(mut self, count: usize) -> (RowBlock, Option<RowBlock>) {
        let end = self.rows.end;
        let middle = end.min(self.rows.start.saturating_add(count));
        let others = (middle < end).then(|| RowBlock { rows: middle..end, ..self.clone() });
        self.rows.end = middle;
        (self, others)
    }

    /// The row at `index`; the positions of its columns are stored in `fields`.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row<'b>(&'b self, index: usize, fields: &'b mut Vec<Range<usize>>) -> Row<'b> {
        let index = self.rows.start + index;
        fields.clear();
        let content = match &self.content {
            Content::Batch(batch) => RowContent::Batch(batch, index),
            Content::Text(lines) => {
                let (number, at) = &lines.rows[index];
                let line = &lines.bytes[at.clone()];
                fields.extend(self.source.separator.split(line));
                RowContent::Text(*number, line)
            }
        };
        Row { source: &self.source, content, fields }
    }
}

/// A row: its numbers and their places.
#[derive(Clone, Copy, Debug)]
pub struct Row<'b> {
    source: &'b Source,
    content: RowContent<'b>,
    fields: &'b [Range<usize>],
}

#[derive(Clone, Copy, Debug)]
enum RowContent<'b> {
    /// A line and its number.
    Text(usize, &'b [u8]),
    Batch(&'b NumberBatch, usize),
}

/// A wrong value and its place.
#[derive(Clone, Debug, PartialEq)]
pub struct RowError {
    /// The line and the column, or the complete stream if it is not text.
    pub place: Place,
    /// Description of the problem.
    pub message: String,
}

impl RowError {
    /// The error with a hint, which may be empty.
    pub fn with_help(self, help: &str) -> Error {
        let mut problems = Diagnostics::default();
        let problem = problems.error(Some(self.place), self.message);
        if !help.is_empty() {
            problem.help(help);
        }
        Error::Input(Box::new(problems))
    }
}

impl Row<'_> {
    /// The texts of the columns; none in batches.
    pub fn texts(&self) -> impl Iterator<Item = String> {
        let line = self.line();
        self.fields.iter().map(move |at| String::from_utf8_lossy(&line[at.clone()]).trim().to_owned())
    }

    fn line(&self) -> &[u8] {
        match self.content {
            RowContent::Text(_, line) => line,
            RowContent::Batch(..) => &[],
        }
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        match self.content {
            RowContent::Text(..) => self.fields.len(),
            RowContent::Batch(batch, _) => batch.width(),
        }
    }

    /// Checks the number of fields of a line; `whose` says where `expected` is from, such as `the heading`.
    /// Rows of batches always have the columns of their stream.
    ///
    /// # Errors
    /// Surplus and missing fields, with a hint at their likely cause.
    pub fn check_width(&self, expected: usize, whose: &str) -> std::result::Result<(), RowError> {
        if !matches!(self.content, RowContent::Text(..)) {
            return Ok(());
        }
        // A separator at the end of the line stands before an empty last field.
        let ends_empty = matches!(self.source.separator, Separator::Char(c)
            if self.width() + 1 == expected
                && self.line().trim_ascii_end().ends_with(c.encode_utf8(&mut [0; 4]).as_bytes()));
        if ends_empty {
            return Ok(());
        }
        check_width(self.width(), expected, whose, self.source.separator).map_err(|e| {
            let help = if e.help.is_empty() { String::new() } else { format!("; {}", e.help) };
            self.error((self.width() > expected).then_some(expected), format!("{}{help}", e.message))
        })
    }

    /// How the line is split.
    pub fn separator(&self) -> Separator {
        self.source.separator
    }

    /// The number in a column. `name` describes it in messages; it may be infinite or NaN.
    ///
    /// # Errors
    /// The column does not exist or is not numeric.
    pub fn number(&self, column: usize, name: &str) -> std::result::Result<f64, RowError> {
        if column >= self.width() {
            let message = format!(
                "column {} for {name} is missing: {} column{} separated by {}",
                column + 1,
                self.width(),
                if self.width() == 1 { "" } else { "s" },
                self.source.separator.name()
            );
            return Err(self.error(None, message));
        }
        let (line, at) = match self.content {
            RowContent::Batch(batch, row) => return Ok(batch.value(column, row)),
            RowContent::Text(_, line) => (line, &self.fields[column]),
        };
        let fields = self.fields.iter().map(move |at| &line[at.clone()]);
        let number = self.source.separator.number(&line[at.clone()], fields);
        number.ok_or_else(|| self.expected_number(column, name))
    }

    /// The error that a column is not numeric; `name` describes the expected number.
    pub fn expected_number(&self, column: usize, name: &str) -> RowError {
        let text = match self.content {
            RowContent::Text(_, line) => {
                let at = self.fields.get(column).cloned().unwrap_or_default();
                String::from_utf8_lossy(&line[at]).into_owned()
            }
            RowContent::Batch(batch, row) => batch.value(column, row).to_string(),
        };
        self.error(Some(column), format!("expected a number for {name}, found `{text}`{}", comma_note(&text)))
    }

    /// An error in a column or in the complete row.
    pub fn error(&self, column: Option<usize>, message: impl Into<String>) -> RowError {
        let message = message.into();
        let path = &self.source.path;
        match self.content {
            RowContent::Text(number, line) => {
                let at = column.and_then(|column| self.fields.get(column)).cloned();
                RowError { place: line_place(path, number, line, at.unwrap_or(0..line.len())), message }
            }
            RowContent::Batch(batch, row) => {
                // The path of a table in memory is `<pulses>` or alike.
                let is_in_memory = path.to_string_lossy().starts_with('<') && path != Path::new("<stdin>");
                let row = if is_in_memory { batch.index(row) } else { batch.place(row) };
                RowError { place: Place::of_file(path), message: format!("{row}: {message}") }
            }
        }
    }
}

/// The place of the bytes `at` of a line, which need not be UTF-8.
pub fn line_place(path: &Path, number: usize, line: &[u8], at: Range<usize>) -> Place {
    let shown = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (before, marked) = (shown(&line[..at.start]), shown(line[at].trim_ascii()));
    Place::in_line(path, number, &shown(line), before.len()..before.len() + marked.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers of the first two columns of all rows, in blocks of at most `max_rows`.
    fn read(text: &[u8], piece: usize, max_rows: usize) -> Result<Vec<Vec<[f64; 2]>>> {
        let mut decoder = RowDecoder::new(Path::new("a.txt"), "a row", None);
        let (mut blocks, mut fields) = (Vec::new(), Vec::new());
        let mut take = |decoder: &mut RowDecoder, ended| -> Result<()> {
            while let Some(block) = decoder.next_block(max_rows, ended)? {
                let mut rows = Vec::new();
                for i in 0..block.len() {
                    let row = block.row(i, &mut fields);
                    let number = |column| row.number(column, "x").map_err(|e| e.with_help(""));
                    rows.push([number(0)?, number(1)?]);
                }
                blocks.push(rows);
            }
            Ok(())
        };
        for bytes in text.chunks(piece) {
            decoder.feed(bytes);
            take(&mut decoder, false)?;
        }
        take(&mut decoder, true)?;
        Ok(blocks)
    }

    #[test]
    fn lines_end_in_any_way_and_arrive_in_any_pieces() {
        for end in ["\n", "\r\n", "\r"] {
            let text = ["\u{feff}sep=;", "# a remark", "", "1;2", " 3 ; 4;", "5;6"].join(end);
            for piece in [1, 3, 100] {
                let rows = read(text.as_bytes(), piece, 100).unwrap().concat();
                assert_eq!(rows, [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], "{end:?}");
            }
            assert_eq!(read(text.as_bytes(), 100, 2).unwrap().len(), 2);
        }
        assert_eq!(line_length(b"1\r", false), None, "a line feed may follow");
    }

    #[test]
    fn numbers_may_be_quoted_and_have_decimal_commas() {
        for text in ["\"1.5\",\"2\"\n3,\"-4.5\"\n", "1,5;2\n\"3\";\"-4,5\"\n", "1,5\t2,0\n3\t-4,5\n"] {
            assert_eq!(
                read(text.as_bytes(), 100, 100).unwrap().concat(),
                [[1.5, 2.0], [3.0, -4.5]],
                "{text}"
            );
        }
    }

    #[test]
    fn lines_of_words_may_stand_before_the_numbers() {
        let rows = |text: &str| {
            let mut decoder = RowDecoder::new(Path::new("a.txt"), "a pose", None).with_preamble();
            decoder.feed(text.as_bytes());
            let block = decoder.next_block(10, true).unwrap();
            let first =
                block.map(|block| block.row(0, &mut Vec::new()).texts().collect::<Vec<_>>().join("|"));
            (first, decoder.leading().iter().map(|line| line.text.clone()).collect::<Vec<_>>())
        };
        let text =
            "Project: test 7\n\nDate 2020 10 11\n# a\n Time, X Pos, Y\n  (s)  (m) (m)\n 1.5 2 3\n4 5 6\n";
        let (first, leading) = rows(text);
        assert_eq!(first.as_deref(), Some("1.5|2|3"));
        assert_eq!(leading, ["Project: test 7", "Date 2020 10 11", "# a", "Time, X Pos, Y", "(s)  (m) (m)"]);
        assert_eq!(rows("time,x\n").0.as_deref(), Some("time|x"));
        assert_eq!(rows("1,5;2,5\n").0.as_deref(), Some("1,5|2,5"));
        assert_eq!(rows("t\na.png 1 2 3 4 5 6\n").0.as_deref(), Some("a.png|1|2|3|4|5|6"));
    }

    #[test]
    fn errors_are_placed() {
        let said = |text: &[u8]| match read(text, 100_000, 10) {
            Err(Error::Input(problems)) => problems.text(),
            other => panic!("{other:?}"),
        };
        assert!(said(b"1,2\n\n3,a\n").contains("a.txt:3:3"));
        assert!(said(b"1 2\n3,5 1.5 1\n").contains("decimal comma"));
        assert!(said(b"\"1,5\",2\n").contains("decimal comma"));
        assert!(said(b"1 2\n3\n").contains("column 2 for x is missing: 1 column separated by blanks"));
        assert!(said(b"1\0\n").contains("expected a row as text, found binary data"));
        let long = [b"1 2\n", &[b'x'; MAX_LINE_BYTES + 1][..]].concat();
        assert!(said(&long).contains("a line of more than 65536 bytes, expected a row"));
    }
}
