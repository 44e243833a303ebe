//! Columns of lines of text: separators, quoted fields, decimal commas.

use std::ops::Range;

/// Separator of the columns of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Separator {
    /// One character; blanks around it are ignored.
    Char(char),
    /// Any run of blanks and tabs.
    Blanks,
    /// Any of several ASCII characters, by the bits of their codes; other blanks are ignored.
    AnyOf(u128),
}

impl Separator {
    /// The separator for a character that a survey or a user chooses.
    pub fn named(c: char) -> Separator {
        if c == ' ' { Separator::Blanks } else { Separator::Char(c) }
    }

    /// The separator for characters that each separate columns; none are blanks.
    pub fn any_of(characters: &str) -> Separator {
        let mut all = characters.chars();
        match (all.next(), all.next()) {
            (None, _) => Separator::Blanks,
            (Some(one), None) => Separator::named(one),
            _ if characters.contains(' ') && characters.bytes().all(is_blank) => Separator::Blanks,
            _ => {
                let ascii = characters.bytes().filter(u8::is_ascii);
                Separator::AnyOf(ascii.fold(0, |set, byte| set | 1 << byte))
            }
        }
    }

    /// The separator that `line` most likely uses: semicolon, comma, tab, or blanks. With semicolons, and
    /// where blanks separate at least three numbers with one comma each, commas are decimal commas.
    pub fn guess(line: impl AsRef<[u8]>) -> Separator {
        let line = line.as_ref();
        let has = |c: char| line.trim_ascii().contains(&(c as u8));
        let found = [';', ',', '\t'].into_iter().find(|&c| has(c) && (c != ',' || !has_decimal_commas(line)));
        found.map_or(Separator::Blanks, Separator::Char)
    }

    /// The columns of `line` as byte ranges without surrounding blanks and without quotes around a column,
    /// which may hold the separator. A separator at the end of the line does not start a further column.
    pub fn split(self, line: &(impl AsRef<[u8]> + ?Sized)) -> impl Iterator<Item = Range<usize>> {
        let line = line.as_ref();
        // A character beyond ASCII is found by its first byte.
        let mut encoded = [0; 4];
        let (separating, width) = match self {
            Separator::Blanks => (ByteSet::BLANKS, 1),
            Separator::AnyOf(set) => (ByteSet([set as u64, (set >> 64) as u64, 0, 0]), 1),
            Separator::Char(c) => {
                let width = c.encode_utf8(&mut encoded).len();
                (ByteSet::of(&encoded[..1]), width)
            }
        };
        let separates = move |at: usize| {
            separating.has(line[at]) && (width == 1 || line[at..].starts_with(&encoded[..width]))
        };
        let padding = match self {
            Separator::Blanks => ByteSet::BLANKS,
            _ => ByteSet::BLANKS.without(separating),
        };
        let mut next = Some(0);
        std::iter::from_fn(move || {
            let mut start = next?;
            while start < line.len() && padding.has(line[start]) {
                start += 1;
            }
            if start >= line.len() {
                next = None;
                return None;
            }
            if line[start] == b'"'
                && let Some(close) = closing_quote(line, start)
            {
                let ends = |at: &usize| separates(*at) || !padding.has(line[*at]);
                let end = (close + 1..line.len()).find(ends).unwrap_or(line.len());
                if end == line.len() || separates(end) {
                    next = (end < line.len()).then_some(end + width);
                    return Some(start + 1..close);
                }
            }
            let end = (start..line.len()).find(|&at| separates(at)).unwrap_or(line.len());
            next = (end < line.len()).then_some(end + width);
            let mut last = end;
            while last > start && padding.has(line[last - 1]) {
                last -= 1;
            }
            Some(start..last)
        })
    }

    /// Appends the columns of `line` to `words`, as [`split`](Separator::split) returns them. Lines without
    /// quotes, which most are, are split several times as fast.
    pub fn split_into(self, line: &[u8], words: &mut Vec<Range<usize>>) {
        match self {
            Separator::Blanks if memchr::memchr(b'"', line).is_none() => split_at_blanks(line, words),
            Separator::Char(c) if c.is_ascii() && memchr::memchr(b'"', line).is_none() => {
                split_at(c as u8, line, words);
            }
            _ => words.extend(self.split(line)),
        }
    }

    /// The number in `field`, one of the `fields` of a line. Its comma is a decimal comma unless commas
    /// separate fields or another field has a decimal point.
    #[inline]
    pub fn number<'f>(self, field: &[u8], fields: impl Iterator<Item = &'f [u8]>) -> Option<f64> {
        plain_number(field).or_else(|| {
            let text = std::str::from_utf8(field).ok()?.trim();
            text.parse().ok().or_else(|| self.number_with_comma(text, fields))
        })
    }

    #[cold]
    fn number_with_comma<'f>(self, text: &str, mut fields: impl Iterator<Item = &'f [u8]>) -> Option<f64> {
        let number = of_decimal_comma(text)?;
        let has_point = |field: &[u8]| {
            let text = std::str::from_utf8(field).ok().filter(|text| text.contains('.'));
            text.is_some_and(|text| text.trim().parse::<f64>().is_ok())
        };
        (!self.characters().contains(',') && !fields.any(has_point)).then_some(number)
    }

    /// Name of the separator in messages.
    pub fn name(self) -> String {
        match self {
            Separator::Blanks => "blanks".to_owned(),
            Separator::Char('\t') => "tabs".to_owned(),
            other => format!("`{}`", other.characters()),
        }
    }

    /// The characters that separate.
    pub fn characters(self) -> String {
        match self {
            Separator::Blanks => " ".to_owned(),
            Separator::Char(c) => c.to_string(),
            Separator::AnyOf(set) => (0..128u8).filter(|c| set & 1 << c != 0).map(char::from).collect(),
        }
    }
}

/// Appends the words between blanks of a line without quotes.
fn split_at_blanks(line: &[u8], words: &mut Vec<Range<usize>>) {
    let mut at = 0;
    while at < line.len() {
        if is_blank(line[at]) {
            at += 1;
            continue;
        }
        let end = end_of_word(line, at);
        words.push(at..end);
        at = end;
    }
}

/// The end of the word that begins at an offset of a line: eight bytes at a time, since blanks are the only
/// common bytes below `!`.
fn end_of_word(line: &[u8], start: usize) -> usize {
    const ONES: u64 = 0x0101_0101_0101_0101;
    let mut at = start;
    while let Some(bytes) = line[at..].first_chunk::<8>() {
        let bytes = u64::from_le_bytes(*bytes);
        // The lowest bit that is set is that of the first byte below `!`; bits above it may be wrong.
        let low = bytes.wrapping_sub(ONES * u64::from(b'!')) & !bytes & (ONES * 0x80);
        if low == 0 {
            at += 8;
            continue;
        }
        at += (low.trailing_zeros() / 8) as usize;
        if is_blank(line[at]) {
            return at;
        }
        at += 1;
    }
    line[at..].iter().position(|b| is_blank(*b)).map_or(line.len(), |length| at + length)
}

/// Appends the columns between ASCII separators of a line without quotes.
fn split_at(separator: u8, line: &[u8], words: &mut Vec<Range<usize>>) {
    let is_padding = |b: &u8| is_blank(*b) && *b != separator;
    let ends = memchr::memchr_iter(separator, line).chain([line.len()]);
    let mut begin = 0;
    for end in ends {
        let field = &line[begin..end];
        let start = begin + field.iter().take_while(|b| is_padding(b)).count();
        if start == line.len() {
            return;
        }
        let padding = line[start..end].iter().rev().take_while(|b| is_padding(b)).count();
        words.push(start..end - padding);
        begin = end + 1;
    }
}

/// Powers of ten that are exact in 64 bits.
const POWERS: [f64; 16] =
    [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];

/// The number that a field of at most 15 digits is, without an exponent and blanks; `None` for other fields.
/// Digits and power are exact, so that their quotient is the nearest number, which [`str::parse`] returns.
#[inline]
fn plain_number(field: &[u8]) -> Option<f64> {
    let (is_negative, digits) = match field {
        [b'-', rest @ ..] => (true, rest),
        _ => (false, field),
    };
    let (mut whole, mut count, mut point) = (0u64, 0, None);
    if digits.len() > POWERS.len() {
        return None;
    }
    for byte in digits {
        match byte {
            b'0'..=b'9' => {
                whole = whole * 10 + u64::from(byte - b'0');
                count += 1;
            }
            b'.' if point.is_none() => point = Some(count),
            _ => return None,
        }
    }
    if count == 0 || count == POWERS.len() {
        return None;
    }
    let number = whole as f64 / POWERS[count - point.unwrap_or(count)];
    Some(if is_negative { -number } else { number })
}

/// The position of the quote that closes the one at `open`; doubled quotes do not.
fn closing_quote(line: &[u8], open: usize) -> Option<usize> {
    let mut at = open + 1;
    loop {
        at += memchr::memchr(b'"', &line[at..])?;
        if line.get(at + 1) != Some(&b'"') {
            return Some(at);
        }
        at += 2;
    }
}

/// A set of bytes.
#[derive(Clone, Copy)]
struct ByteSet([u64; 4]);

impl ByteSet {
    const BLANKS: ByteSet = ByteSet::of(b" \t\r\x0b\x0c");

    const fn of(bytes: &[u8]) -> ByteSet {
        let (mut set, mut i) = ([0; 4], 0);
        while i < bytes.len() {
            set[bytes[i] as usize / 64] |= 1 << (bytes[i] % 64);
            i += 1;
        }
        ByteSet(set)
    }

    fn without(self, ByteSet(other): ByteSet) -> ByteSet {
        ByteSet(std::array::from_fn(|i| self.0[i] & !other[i]))
    }

    fn has(&self, byte: u8) -> bool {
        self.0[usize::from(byte / 64)] >> (byte % 64) & 1 != 0
    }
}

/// True if `byte` is a blank within a line. This includes the carriage return before a line feed.
pub fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r' | 0x0b | 0x0c)
}

/// True if the commas of a line are those of at least three numbers and other words between blanks, or of two
/// between tabs.
fn has_decimal_commas(line: &[u8]) -> bool {
    let words = || Separator::Blanks.split(line).map(|at| &line[at]);
    let fits = |word: &[u8]| !word.contains(&b',') || std::str::from_utf8(word).is_ok_and(has_decimal_comma);
    let least = if line.trim_ascii().contains(&b'\t') { 2 } else { 3 };
    words().count() >= least && words().all(fits)
}

/// Text in UTF-8, or else in Latin-1, as spreadsheets write it.
pub fn decoded(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    }
}

/// A field of a comma-separated table, quoted where that is necessary (RFC 4180).
pub fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// The fields of a line without their quotes (RFC 4180) and without the blanks around fields. Line breaks
/// within fields are not supported.
pub fn unquoted(line: &str, separator: Separator) -> Vec<String> {
    let mut fields = Vec::with_capacity(8);
    let (mut field, mut is_quoted, mut was_quoted) = (String::new(), false, false);
    let end = |field: &mut String, was_quoted: &mut bool| {
        let text = std::mem::take(field);
        if std::mem::take(was_quoted) { text } else { text.trim().to_owned() }
    };
    let mut rest = line.chars().peekable();
    while let Some(c) = rest.next() {
        let separates = match separator {
            Separator::Char(separator) => c == separator,
            Separator::Blanks => c.is_whitespace(),
            Separator::AnyOf(set) => c.is_ascii() && set & 1 << c as u8 != 0,
        };
        match (c, is_quoted) {
            ('"', true) if rest.peek() == Some(&'"') => field.extend(rest.next()),
            ('"', true) => is_quoted = false,
            ('"', false) if !was_quoted && field.trim().is_empty() => {
                field.clear();
                (is_quoted, was_quoted) = (true, true);
            }
            (_, false) if separates => {
                let is_empty = !was_quoted && field.is_empty();
                if !(separator == Separator::Blanks && is_empty) {
                    fields.push(end(&mut field, &mut was_quoted));
                }
            }
            // Blanks after a quoted field.
            (c, false) if was_quoted && c.is_whitespace() => {}
            (c, _) => field.push(c),
        }
    }
    if separator != Separator::Blanks || was_quoted || !field.is_empty() {
        fields.push(end(&mut field, &mut was_quoted));
    }
    fields
}

/// The separator that spreadsheets state in a first line such as `sep=;`.
pub fn stated_separator(line: &str) -> Option<char> {
    let line = line.trim_start_matches('\u{feff}').trim_end_matches(['\r', '\n']);
    let mut rest =
        line.get(..4).filter(|word| word.eq_ignore_ascii_case("sep=")).map(|_| line[4..].chars())?;
    let separator = rest.next()?;
    rest.next().is_none().then_some(separator)
}

/// True if a text is a number with a comma in place of the decimal point, such as `-1234,5` and `1,5e3`.
pub fn has_decimal_comma(text: &str) -> bool {
    of_decimal_comma(text).is_some()
}

/// True if a text is a number with a decimal point or a decimal comma.
pub fn is_number(text: &str) -> bool {
    text.trim().parse::<f64>().is_ok() || has_decimal_comma(text)
}

/// The number with a decimal comma that a text is.
fn of_decimal_comma(text: &str) -> Option<f64> {
    let text = text.trim();
    let is_digit = |digit: Option<u8>| digit.is_some_and(|digit| digit.is_ascii_digit());
    let (whole, part) = text.split_once(',')?;
    let is_between_digits = is_digit(whole.bytes().last()) && is_digit(part.bytes().next());
    text.replacen(',', ".", 1).parse().ok().filter(|_| is_between_digits)
}

/// Addition to a message about an invalid number with a decimal comma; an empty text for others.
pub fn comma_note(text: &str) -> &'static str {
    if has_decimal_comma(text) { ", which has a decimal comma; numbers need a decimal point" } else { "" }
}

#[cfg(test)]
mod tests;
