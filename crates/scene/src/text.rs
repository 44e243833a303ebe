//! Scene files as bytes: read, split into lines, and quoted in messages.

use super::number::{is_blank, skip_blanks, word_end};
use memchr::{memchr, memrchr};
use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::recognise::{Expected, Family, foreign};
use vlscan_base::store::FileBytes;

/// Maximum number of problems of one file that are reported one by one.
pub(super) const MAX_SHOWN_PROBLEMS: usize = 20;

/// Maximum length of a line, bytes.
const MAX_LINE_BYTES: usize = 1 << 20;

/// Number of bytes of a mapped file that are read before their memory is released.
const RELEASED_BYTES: usize = 1 << 26;

/// Maximum length of the excerpt of a line in a message, bytes.
const MAX_SHOWN_BYTES: usize = 160;

/// A file of a scene.
pub(super) struct Source {
    path: PathBuf,
    data: FileBytes,
    /// Start of the content, after a byte order mark.
    begin: usize,
}

/// UTF-8 byte order mark.
const MARK: &[u8] = b"\xef\xbb\xbf";

impl Source {
    /// Reads `path`, or maps it if it is large, see [`FileBytes`].
    pub fn open(path: &Path) -> std::io::Result<Source> {
        Source::open_within(path, None)
    }

    /// As [`Source::open`], with a limit of the memory, bytes.
    pub fn open_within(path: &Path, max_memory: Option<u64>) -> std::io::Result<Source> {
        FileBytes::open_within(path, max_memory).map(|data| Source::new(path, data))
    }

    /// Fails if the file has changed since it was opened.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn check_unchanged(&self) -> Result<()> {
        self.data.check_unchanged().map_err(|e| Error::io("read", &self.path, e))
    }

    fn new(path: &Path, data: FileBytes) -> Source {
        let begin = if data.starts_with(MARK) { MARK.len() } else { 0 };
        Source { path: path.to_path_buf(), data, begin }
    }

    /// A source without a file, for tests.
    #[cfg(test)]
    pub fn of(path: &str, text: &[u8]) -> Source {
        Source::new(Path::new(path), FileBytes::from(text.to_vec()))
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The text with line feeds in place of lone carriage returns, which keeps all positions; `None` if there
    /// are none.
    pub fn with_line_feeds(&self) -> Option<Source> {
        let is_alone = |at: &usize| self.data.get(at + 1) != Some(&b'\n');
        memchr::memchr_iter(b'\r', &self.data).find(is_alone)?;
        let mut data = self.data.to_vec();
        let alone: Vec<usize> = memchr::memchr_iter(b'\r', &self.data).filter(is_alone).collect();
        alone.into_iter().for_each(|at| data[at] = b'\n');
        Some(Source { path: self.path.clone(), data: FileBytes::from(data), begin: self.begin })
    }

    /// The same text with line feeds if all its lines end in carriage returns, which formats take for blanks
    /// otherwise.
    pub fn with_other_line_ends(&self) -> Option<Source> {
        memchr(b'\n', &self.data).is_none().then(|| self.with_line_feeds()).flatten()
    }

    /// The content without a byte order mark.
    pub fn bytes(&self) -> &[u8] {
        &self.data[self.begin..]
    }

    /// Releases the memory of a part of a mapped file, whose bytes are read again when they are used again.
    pub fn release(&self, part: Range<usize>) {
        self.data.release(self.begin + part.start..self.begin + part.end);
    }

    /// True if the file is text and possibly in the expected format; otherwise reports its kind, or an error
    /// at the first line that is not text.
    pub fn is_text(&self, sought: &Expected, diagnostics: &mut Diagnostics) -> bool {
        let (bytes, what) = (self.bytes(), sought.what);
        if let Some(found) =
            foreign(&self.path, bytes, sought).filter(|found| found.kind.family != Family::Binary)
        {
            found.report(&self.path, diagnostics);
            return false;
        }
        if bytes.is_empty() {
            diagnostics.error(Some(self.place(1, 0..0)), format!("expected {what}, found an empty file"));
            return false;
        }
        // Long lines first: they show without a look at the complete file.
        let start = &bytes[..bytes.len().min(MAX_LINE_BYTES)];
        if memchr(0, start).is_none() && !self.has_short_lines(what, diagnostics) {
            return false;
        }
        let Some(at) = self.find_zero() else { return true };
        let line = memchr::memchr_iter(b'\n', &bytes[..at]).count() + 1;
        let found = if matches!(bytes, [0xff, 0xfe, ..] | [0xfe, 0xff, ..]) {
            "UTF-16; save it as UTF-8"
        } else {
            "bytes that are not text"
        };
        diagnostics.error(Some(self.place(line, at..at + 1)), format!("expected {what}, found {found}"));
        false
    }

    /// The first byte that is zero.
    fn find_zero(&self) -> Option<usize> {
        let bytes = self.bytes();
        (0..bytes.len()).step_by(RELEASED_BYTES).find_map(|start| {
            let part = start..bytes.len().min(start + RELEASED_BYTES);
            let found = memchr(0, &bytes[part.clone()]);
            self.release(part);
            found.map(|at| start + at)
        })
    }

    /// True if no line is too long; otherwise reports an error at the first one.
    fn has_short_lines(&self, what: &str, diagnostics: &mut Diagnostics) -> bool {
        let bytes = self.bytes();
        let mut start = 0;
        while bytes.len() - start > MAX_LINE_BYTES {
            let Some(end) = memrchr(b'\n', &bytes[start..start + MAX_LINE_BYTES + 1]) else {
                let line = memchr::memchr_iter(b'\n', &bytes[..start]).count() + 1;
                let message = format!("a line of more than {MAX_LINE_BYTES} bytes, expected {what}");
                diagnostics.error(Some(self.place(line, start..start)), message);
                return false;
            };
            start += end + 1;
            if start / RELEASED_BYTES != (start - end - 1) / RELEASED_BYTES {
                self.release(start.saturating_sub(2 * RELEASED_BYTES)..start);
            }
        }
        true
    }

    /// The last line if it lacks a line end: its number, start and text.
    pub fn unended_line(&self) -> Option<(usize, usize, &[u8])> {
        let bytes = self.bytes();
        if bytes.last().is_none_or(|b| *b == b'\n') {
            return None;
        }
        let start = memrchr(b'\n', bytes).map_or(0, |n| n + 1);
        Some((memchr::memchr_iter(b'\n', bytes).count() + 1, start, &bytes[start..]))
    }

    /// The place of the bytes `at` in line `number` (from 1). Bytes that are not text are shown as `�`.
    pub fn place(&self, number: usize, at: Range<usize>) -> Place {
        let bytes = self.bytes();
        let start = memrchr(b'\n', &bytes[..at.start.min(bytes.len())]).map_or(0, |i| i + 1);
        let last = bytes.len().min(at.end.max(at.start) + MAX_SHOWN_BYTES);
        let end = memchr(b'\n', &bytes[start..last]).map_or(last, |n| start + n);
        let from = if at.start - start > MAX_SHOWN_BYTES { at.start - MAX_SHOWN_BYTES / 2 } else { start };
        let to = end.min(from + MAX_SHOWN_BYTES);
        let before = shown(&bytes[from..at.start.clamp(from, to)]);
        let marked = shown(&bytes[at.start.clamp(from, to)..at.end.clamp(at.start.min(to), to)]);
        let after = shown(&bytes[at.end.clamp(from, to)..to]);
        let range = before.len()..before.len() + marked.len();
        Place::in_line(&self.path, number, format!("{before}{marked}{after}").trim_end(), range)
    }
}

/// True if an error is due to the file's name and thus a mistake in the scene's description.
pub(super) fn is_wrong_name(e: &std::io::Error) -> bool {
    use std::io::ErrorKind::{InvalidInput, IsADirectory, NotADirectory, NotFound, PermissionDenied};
    matches!(e.kind(), NotFound | PermissionDenied | IsADirectory | NotADirectory | InvalidInput)
}

/// Makes bytes printable in a terminal.
pub(super) fn shown(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes)
        .chars()
        .map(|c| if c.is_control() && c != '\t' { '\u{fffd}' } else { c })
        .collect()
}

/// A name without control characters, which would reach terminals and tables.
pub(super) fn printable(name: &str) -> String {
    name.chars().map(|c| if c.is_control() { '_' } else { c }).collect()
}

/// A logical line: physical lines that end with a `\` are joined with the next one.
pub(super) struct Line<'a> {
    /// Number of its first physical line, from 1.
    pub number: usize,
    /// Offset of its first byte.
    pub start: usize,
    /// Text without the line end.
    pub text: Cow<'a, [u8]>,
}

/// Iterates over the lines of a text.
pub(super) struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Number of physical lines read so far.
    pub passed: usize,
    continued: bool,
}

impl<'a> Lines<'a> {
    /// Iterates over the lines of `bytes`; `continued` joins a line that ends with `\` with the next one.
    pub fn new(bytes: &'a [u8], continued: bool) -> Lines<'a> {
        Lines { bytes, at: 0, passed: 0, continued }
    }

    fn physical(&mut self) -> Option<&'a [u8]> {
        if self.at >= self.bytes.len() {
            return None;
        }
        let rest = &self.bytes[self.at..];
        let length = memchr(b'\n', rest);
        self.at += length.map_or(rest.len(), |n| n + 1);
        self.passed += 1;
        Some(&rest[..length.unwrap_or(rest.len())])
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Line<'a>;

    #[inline]
    fn next(&mut self) -> Option<Line<'a>> {
        let start = self.at;
        let text = self.physical()?;
        let number = self.passed;
        if !(self.continued && is_continued(text)) {
            return Some(Line { number, start, text: Cow::Borrowed(text) });
        }
        // The `\` and the line end become blanks, so that offsets within the joined text remain offsets in
        // the file.
        let mut joined = text.to_vec();
        while is_continued(&joined) {
            blank_continuation(&mut joined);
            let Some(next) = self.physical() else { break };
            joined.push(b' ');
            joined.extend_from_slice(next);
        }
        Some(Line { number, start, text: Cow::Owned(joined) })
    }
}

/// True if a line without its end continues in the next one.
pub(super) fn is_continued(line: &[u8]) -> bool {
    matches!(line, [.., b'\\'] | [.., b'\\', b'\r'])
}

fn blank_continuation(line: &mut [u8]) {
    let n = line.len();
    for b in &mut line[n.saturating_sub(2)..] {
        if matches!(b, b'\\' | b'\r') {
            *b = b' ';
        }
    }
}

/// Iterates over the words of a line with their positions; a word that begins with `#` starts a comment.
pub(super) struct Words<'a> {
    line: &'a [u8],
    at: usize,
}

impl<'a> Words<'a> {
    /// Starts at byte `at` of `line`.
    pub fn new(line: &'a [u8], at: usize) -> Words<'a> {
        Words { line, at }
    }
}

impl<'a> Iterator for Words<'a> {
    type Item = (&'a [u8], Range<usize>);

    fn next(&mut self) -> Option<Self::Item> {
        let start = skip_blanks(self.line, self.at);
        if start >= self.line.len() || self.line[start] == b'#' {
            return None;
        }
        self.at = word_end(self.line, start);
        Some((&self.line[start..self.at], start..self.at))
    }
}

/// The rest of a line from byte `at` on, without the blanks around it and without a comment: a word `#`. What
/// begins with `#` otherwise belongs to the operand, as in the name `Material #25`.
pub(super) fn operand(line: &[u8], at: usize) -> Range<usize> {
    let start = skip_blanks(line, at);
    let is_end = |i: usize| line.get(i).is_none_or(|&b| is_blank(b));
    let is_comment =
        |i: &usize| line[*i] == b'#' && (*i == start || is_blank(line[*i - 1])) && is_end(*i + 1);
    let end = (start..line.len()).find(is_comment).unwrap_or(line.len());
    start..start + line[start..end].trim_ascii_end().len()
}

/// Problems of one file, collected in any order and reported in the order of the file: errors, where the file
/// is provably broken, and warnings.
#[derive(Default)]
pub(super) struct Problems {
    errors: List,
    warnings: List,
}

#[derive(Default)]
struct List {
    shown: Vec<Problem>,
    count: usize,
}

struct Problem {
    line: usize,
    at: Range<usize>,
    message: String,
}

impl List {
    fn push(&mut self, line: usize, at: Range<usize>, message: impl FnOnce() -> String) {
        self.count += 1;
        if self.shown.len() < MAX_SHOWN_PROBLEMS {
            self.shown.push(Problem { line, at, message: message() });
        }
    }

    fn append(&mut self, later: List, lines: usize, bytes: usize) {
        self.count += later.count;
        let room = MAX_SHOWN_PROBLEMS - self.shown.len();
        self.shown.extend(later.shown.into_iter().take(room).map(|p| Problem {
            line: p.line + lines,
            at: p.at.start + bytes..p.at.end + bytes,
            message: p.message,
        }));
    }
}

impl Problems {
    /// Records an error at the bytes `at` of line `line` (from 1).
    pub fn error(&mut self, line: usize, at: Range<usize>, message: impl FnOnce() -> String) {
        self.errors.push(line, at, message);
    }

    /// Records a warning about something that is replaced or omitted.
    pub fn warn(&mut self, line: usize, at: Range<usize>, message: impl FnOnce() -> String) {
        self.warnings.push(line, at, message);
    }

    /// True if further errors are only counted.
    pub fn is_full(&self) -> bool {
        self.errors.shown.len() >= MAX_SHOWN_PROBLEMS
    }

    /// Appends the problems of a later piece of the file, which begins `lines` lines and `bytes` bytes into
    /// it.
    pub fn append(&mut self, later: Problems, lines: usize, bytes: usize) {
        self.errors.append(later.errors, lines, bytes);
        self.warnings.append(later.warnings, lines, bytes);
    }

    /// True if there is no error.
    pub fn is_valid(&self) -> bool {
        self.errors.count == 0
    }

    /// Adds all problems to `diagnostics` in the order of the file; `false` if there was an error.
    pub fn report(self, source: &Source, diagnostics: &mut Diagnostics) -> bool {
        let is_valid = self.is_valid();
        let mut all = Vec::new();
        for (list, is_error) in [(self.errors, true), (self.warnings, false)] {
            let more = list.count - list.shown.len();
            all.extend(list.shown.into_iter().map(|p| (p.line, Some(p.at), p.message, is_error)));
            if more > 0 {
                all.push((usize::MAX, None, format!("{more} more problems in this file"), is_error));
            }
        }
        all.sort_by_key(|p| p.0);
        for (line, at, message, is_error) in all {
            let place = at.map_or_else(|| Place::of_file(source.path()), |at| source.place(line, at));
            if is_error {
                diagnostics.error(Some(place), message);
            } else {
                diagnostics.warn(Some(place), message);
            }
        }
        is_valid
    }
}

/// Divides `bytes` into pieces of about `length` bytes that end with a complete logical line.
pub(super) fn cut_into_pieces(bytes: &[u8], length: usize) -> Vec<Range<usize>> {
    let mut pieces = Vec::new();
    let mut start = 0;
    while start < bytes.len() {
        let mut end = (start + length).min(bytes.len());
        while end < bytes.len() {
            end = memchr(b'\n', &bytes[end..]).map_or(bytes.len(), |n| end + n + 1);
            if !is_continued(&bytes[start..end - 1]) {
                break;
            }
        }
        pieces.push(start..end);
        start = end;
    }
    pieces
}

/// True if a line consists of blanks only.
pub(super) fn is_empty_line(line: &[u8]) -> bool {
    line.iter().all(|&b| is_blank(b))
}

#[cfg(test)]
mod tests;
