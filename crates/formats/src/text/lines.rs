//! Splits and parses lines of text with one point each.

use crate::{Attribute, Columns, PointRow};
use std::io::BufRead;
use std::ops::Range;
use vlscan_base::columns::{Separator, is_blank};

/// Maximum length of a line, bytes: a binary file without line ends must not fill the memory.
const MAX_LINE_BYTES: usize = 1 << 16;

/// True if `byte` ends a line. Both bytes of CRLF do, so that an empty line follows each of its lines where
/// lines are split by this.
pub fn is_line_end(byte: u8) -> bool {
    matches!(byte, b'\n' | b'\r')
}

/// The last byte of the ends of lines by that of the first one: a carriage return, or a line feed with or
/// without one. Where binary values follow the lines, the first value may look like a line end, too.
pub fn last_of_line_ends(text: &[u8]) -> u8 {
    let end = text.iter().position(|b| is_line_end(*b)).unwrap_or(text.len());
    match &text[end..] {
        [b'\r', next, ..] if *next != b'\n' => b'\r',
        _ => b'\n',
    }
}

/// Reads the next line to `line`, without its end: a line feed, a carriage return or both. Lines that are too
/// long are cut. `false` at the end of the text.
pub fn read_line(source: &mut impl BufRead, line: &mut Vec<u8>) -> std::io::Result<bool> {
    line.clear();
    let mut has_begun = false;
    loop {
        let bytes = match source.fill_buf() {
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
            bytes => bytes?,
        };
        if bytes.is_empty() || line.len() >= MAX_LINE_BYTES {
            return Ok(has_begun);
        }
        has_begun = true;
        let bytes = &bytes[..bytes.len().min(MAX_LINE_BYTES - line.len())];
        let Some(length) = memchr::memchr2(b'\n', b'\r', bytes) else {
            line.extend_from_slice(bytes);
            let count = bytes.len();
            source.consume(count);
            continue;
        };
        line.extend_from_slice(&bytes[..length]);
        let is_return = bytes[length] == b'\r';
        source.consume(length + 1);
        if is_return && source.fill_buf()?.first() == Some(&b'\n') {
            source.consume(1);
        }
        return Ok(true);
    }
}

/// The place of the next line of a text from `at` on, without its end, as [`read_line`] reads it; `at`
/// becomes the start of the line after it. `None` at the end of the text.
pub fn next_line(text: &[u8], at: &mut usize) -> Option<Range<usize>> {
    let start = *at;
    let rest = text.get(start..).filter(|rest| !rest.is_empty())?;
    let longest = &rest[..rest.len().min(MAX_LINE_BYTES)];
    let Some(length) = memchr::memchr2(b'\n', b'\r', longest) else {
        *at = start + longest.len();
        return Some(start..*at);
    };
    let end = start + length;
    let is_both = text[end] == b'\r' && text.get(end + 1) == Some(&b'\n');
    *at = end + 1 + usize::from(is_both);
    Some(start..end)
}

/// The end of the last line that surely ends within a piece of text from the start of a line on: behind the
/// last line end that is followed by another byte, or where [`read_line`] cuts a line that is too long. 0 if
/// there is none.
pub fn end_of_lines(text: &[u8]) -> usize {
    let last = text.len().saturating_sub(1);
    match memchr::memrchr2(b'\n', b'\r', &text[..last]) {
        Some(end) => end + 1 + usize::from(text[end..].starts_with(b"\r\n")),
        None => last / MAX_LINE_BYTES * MAX_LINE_BYTES,
    }
}

/// Parses `word` as a number; `None` unless all of it is one.
pub fn float(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// True if a line contains no point: it is blank, or a comment marked by `//` or `#`.
pub fn is_skipped(line: &[u8]) -> bool {
    matches!(line.trim_ascii_start(), [] | [b'/', b'/', ..] | [b'#', ..]) || line.iter().all(|&b| is_blank(b))
}

/// True if a line is a heading: at least three words, all of them names but for empty ones, which begin with
/// a letter or `_` and are not numbers.
pub fn is_heading(line: &[u8], words: &[Range<usize>]) -> bool {
    let is_name = |word: &[u8]| {
        let word = word.strip_prefix(b"\"").unwrap_or(word);
        let begins = word.first().is_some_and(|b| b.is_ascii_alphabetic() || *b == b'_' || !b.is_ascii());
        begins && float(word).is_none()
    };
    let words = || words.iter().map(|at| line[at.clone()].trim_ascii());
    words().count() >= 3 && words().all(|word| word.is_empty() || is_name(word)) && words().any(is_name)
}

/// A column without a usable number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadColumn {
    pub attribute: Attribute,
    /// Position of its word in the line; empty, at the end, for a line that is too short.
    pub at: Range<usize>,
}

impl Columns {
    /// Parses the words of a line. Normals are optional: they are absent if the line is too short for them,
    /// and NaN if they are not numbers. Object, leg, channel and time need not be numbers.
    pub fn parse(
        &self,
        line: &[u8],
        words: &[Range<usize>],
        separator: Separator,
    ) -> Result<PointRow, BadColumn> {
        let all = || words.iter().map(move |at| &line[at.clone()]);
        let number = |column: usize| separator.number(&line[words.get(column)?.clone()], all());
        // Most of the time of reading is spent on numbers: each is parsed once.
        let mut numbers = [None; Attribute::COUNT];
        for (attribute, column) in self.used() {
            let found = number(column);
            if found.is_none() && !attribute.is_optional() {
                let at = words.get(column).cloned().unwrap_or(line.len()..line.len());
                return Err(BadColumn { attribute, at });
            }
            numbers[attribute as usize] = Some(found.unwrap_or(f64::NAN));
        }
        let mut row = self.row_of(&numbers, |column| number(column).unwrap_or(f64::NAN));
        // Names of objects are passed with the row.
        row.misfits = row.misfits.without(Attribute::Object);
        let has_normal = Attribute::NORMAL.iter().all(|a| self.get(*a).is_some_and(|c| c < words.len()));
        row.normal = row.normal.filter(|_| has_normal);
        Ok(row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::DVec3;

    #[test]
    fn lines_end_in_any_way() {
        for text in ["a b\n\nc\nd", "a b\r\n\r\nc\r\nd\r\n", "a b\r\rc\rd\r", "a b\r\n\rc\nd"] {
            // One byte at a time, so that a line end is divided between two reads.
            let mut source = std::io::BufReader::with_capacity(1, text.as_bytes());
            let (mut line, mut lines) = (Vec::new(), Vec::new());
            while read_line(&mut source, &mut line).unwrap() {
                lines.push(String::from_utf8(line.clone()).unwrap());
            }
            assert_eq!(lines, ["a b", "", "c", "d"], "{text:?}");
        }
        let (mut line, long) = (Vec::new(), vec![b'1'; MAX_LINE_BYTES + 5]);
        let mut source = &long[..];
        assert!(read_line(&mut source, &mut line).unwrap() && line.len() == MAX_LINE_BYTES);
        assert!(read_line(&mut source, &mut line).unwrap() && line.len() == 5);
        assert_eq!([&b"a\r\n"[..], b"a\rb\n", b"a\n\r", b"a"].map(last_of_line_ends), *b"\n\r\n\n");
    }

    #[test]
    fn pieces_of_any_length_have_the_lines_of_the_text() {
        let short = b"a b\r\n\r\nc\rd\r\r\n\ne\n".repeat(5);
        let ones = [b'1'; 2 * MAX_LINE_BYTES];
        let long = [&short[..], &ones, b"\r\nf\r", &ones[..MAX_LINE_BYTES - 1], b"\r\n\ng"].concat();
        let lines_of = |piece: &[u8]| {
            let (mut at, mut lines) = (0, Vec::new());
            while let Some(line) = next_line(piece, &mut at) {
                lines.push(piece[line].to_vec());
            }
            lines
        };
        for (text, length) in
            [(&short, 2), (&short, 3), (&short, 7), (&long, 4000), (&long, 70_000), (&long, 1 << 20)]
        {
            let (mut source, mut line, mut expected) = (&text[..], Vec::new(), Vec::new());
            while read_line(&mut source, &mut line).unwrap() {
                expected.push(line.clone());
            }
            assert!(lines_of(text) == expected);
            let (mut rest, mut lines) = (&text[..], Vec::new());
            let mut piece = length;
            while !rest.is_empty() {
                let end = if piece >= rest.len() { rest.len() } else { end_of_lines(&rest[..piece]) };
                // A piece without an end of a line is extended.
                piece = if end == 0 { piece + length } else { length };
                lines.extend(lines_of(&rest[..end]));
                rest = &rest[end..];
            }
            assert!(lines == expected, "{length}");
        }
    }

    #[test]
    fn headings_consist_of_names() {
        let is = |line: &'static str| {
            let words: Vec<_> = Separator::guess(line).split(line).collect();
            is_heading(line.as_bytes(), &words)
        };
        assert!(["x y z", "\"id\",X,Y", ",x,y,z", "_id Höhe y", "x,,z"].map(is).iter().all(|is| *is));
        assert!(!["x y", "1 2 3", "x y 3", ",,", "nan x y"].map(is).iter().any(|is| *is));
    }

    #[test]
    fn rows_are_parsed_by_their_columns() {
        let columns = Columns::find(["x", "y", "z", "class", "nx", "ny", "nz"]);
        let parse = |line: &'static str| {
            let words: Vec<_> = Separator::Blanks.split(line).collect();
            columns.parse(line.as_bytes(), &words, Separator::Blanks)
        };
        let row = parse("1 2 3 300 0 0 1").unwrap();
        assert_eq!((row.position, row.class, row.normal), (DVec3::new(1.0, 2.0, 3.0), 255, Some(DVec3::Z)));
        for (class, expected, fits) in
            [("300", 255, false), ("-1", 0, false), ("2.7", 2, false), ("nan", 0, false), ("2.0", 2, true)]
        {
            let line = format!("1 2 3 {class}").leak();
            let row = parse(line).unwrap();
            assert_eq!((row.class, !row.misfits.has(Attribute::Class)), (expected, fits), "{class}");
        }
        assert_eq!(parse("1 2 3 4 0 0").unwrap().normal, None, "the line is too short");
        assert!(parse("1 2 3 4 0 0 -").unwrap().normal.unwrap().z.is_nan());
        assert_eq!(parse("1 two 3 4"), Err(BadColumn { attribute: Attribute::Y, at: 2..5 }));
        assert_eq!(parse("1 2 3"), Err(BadColumn { attribute: Attribute::Class, at: 5..5 }));
    }
}
