//! Lines of text with rows, while they arrive.

use super::row::{RowError, Source, line_place};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use vlscan_base::columns::{Separator, has_decimal_comma, stated_separator};
use vlscan_base::diag::Place;
use vlscan_base::error::Result;
use vlscan_base::recognise::{Expected, FIRST_BYTES, Family, foreign};

/// Maximum length of a line, bytes.
pub(super) const MAX_LINE_BYTES: usize = 1 << 16;
/// Number of characters that are shown of a line that is too long.
const SHOWN_OF_LONG_LINE: usize = 40;
/// Maximum number of lines before the first row.
const MAX_LEADING_LINES: usize = 1000;

/// Decodes lines of text.
#[derive(Debug)]
pub(super) struct TextDecoder {
    /// Bytes that have arrived and have not been returned.
    pub pending: Vec<u8>,
    /// True once the kind of the stream has been checked.
    is_checked: bool,
    /// Number of lines that have been returned.
    line: usize,
    /// The separator that is named, by the caller or in the stream.
    named: Option<char>,
    pub has_begun: bool,
    /// True if lines of words may stand before the first row of numbers.
    may_have_preamble: bool,
    /// The comments and lines of words before the first row.
    pub leading: Vec<LeadingLine>,
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

impl TextDecoder {
    pub fn new(pending: Vec<u8>, named: Option<char>, may_have_preamble: bool) -> TextDecoder {
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
    pub fn next_lines(
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
pub(super) struct Lines {
    pub bytes: Vec<u8>,
    pub rows: Vec<(usize, Range<usize>)>,
}
