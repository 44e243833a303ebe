//! Decodes the bytes of text files.

use std::borrow::Cow;

/// Bytes that are not text in a known encoding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NotText {
    /// Offset of the first invalid byte.
    pub at: usize,
    /// The problem, in one sentence.
    pub message: String,
    /// The text, decoded in the most likely encoding.
    pub guess: Option<String>,
}

impl std::fmt::Display for NotText {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for NotText {}

/// Decodes UTF-8, UTF-16 with a byte order mark, or the single-byte encoding that an XML declaration names.
pub(super) fn decode(bytes: &[u8]) -> Result<String, NotText> {
    if let Some(rest) = bytes.strip_prefix(b"\xef\xbb\xbf") {
        return utf8(rest, 3);
    }
    match bytes {
        [0xff, 0xfe, rest @ ..] => return utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => return utf16(rest, u16::from_be_bytes),
        _ => {}
    }
    let encoding = declared_encoding(bytes);
    match encoding.as_deref().map(str::to_ascii_lowercase).as_deref() {
        Some(
            "iso-8859-1" | "iso_8859-1" | "latin1" | "latin-1" | "l1" | "us-ascii" | "ascii" | "windows-1252"
            | "cp1252",
        ) => Ok(bytes.iter().map(|&b| western(b)).collect()),
        None | Some("utf-8" | "utf8") => utf8(bytes, 0),
        // ASCII is identical in nearly every encoding
        Some(_) if bytes.is_ascii() => utf8(bytes, 0),
        Some(other) => Err(NotText {
            at: bytes.iter().position(|b| !b.is_ascii()).unwrap_or(0),
            message: format!("cannot read the encoding {other:?}; save the file as UTF-8"),
            guess: None,
        }),
    }
}

/// The text of a table as spreadsheets write it: UTF-8, UTF-16 or Western European single bytes. The second
/// value describes an encoding that was guessed.
///
/// # Errors
/// [`NotText`].
pub fn decode_table(bytes: &[u8]) -> Result<(String, Option<String>), NotText> {
    match decode(bytes) {
        Ok(text) => Ok((text, None)),
        Err(NotText { guess: Some(text), .. }) if !bytes.contains(&0) => {
            let message =
                "it is not UTF-8 and read as Windows-1252 (Latin-1); save it as UTF-8 if letters are wrong";
            Ok((text, Some(message.to_owned())))
        }
        Err(error) => Err(error),
    }
}

fn utf8(bytes: &[u8], skipped: usize) -> Result<String, NotText> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Ok(text.to_owned()),
        Err(e) => {
            let at = e.valid_up_to();
            let byte = bytes.get(at).copied().unwrap_or_default();
            let message =
                format!("byte 0x{byte:02x} is not UTF-8; save the file as UTF-8 or declare its encoding");
            let guess = (skipped == 0).then(|| bytes.iter().map(|&b| western(b)).collect());
            Err(NotText { at: at + skipped, message, guess })
        }
    }
}

fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Result<String, NotText> {
    let units = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
    let text: Result<String, _> = char::decode_utf16(units).collect();
    let message = "invalid UTF-16; save the file as UTF-8";
    text.map_err(|_| NotText { at: 0, message: message.to_owned(), guess: None })
}

fn declared_encoding(bytes: &[u8]) -> Option<String> {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(200)]);
    let declaration = head.trim_start().strip_prefix("<?xml")?;
    let declaration = &declaration[..declaration.find("?>")?];
    let value = declaration[declaration.find("encoding")? + "encoding".len()..]
        .trim_start()
        .strip_prefix('=')?
        .trim_start();
    let quote = value.chars().next().filter(|c| "'\"".contains(*c))?;
    Some(value[1..].split(quote).next()?.to_owned())
}

/// Decodes a byte of Windows-1252, which extends Latin-1 by letters in place of some control characters.
fn western(byte: u8) -> char {
    const UPPER: [char; 32] = [
        '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8d}', 'Ž', '\u{8f}',
        '\u{90}', '‘', '’', '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9d}', 'ž', 'Ÿ',
    ];
    match byte {
        0x80..=0x9f => UPPER[usize::from(byte - 0x80)],
        _ => char::from(byte),
    }
}

/// The line number (from 1) and the text of the line around byte `at` of undecodable bytes.
pub(super) fn line_of_bytes(bytes: &[u8], at: usize) -> (usize, Cow<'_, str>) {
    let at = at.min(bytes.len());
    let start = bytes[..at].iter().rposition(|&b| b == b'\n').map_or(0, |i| i + 1);
    let end = bytes[at..].iter().position(|&b| b == b'\n').map_or(bytes.len(), |i| at + i);
    let line = bytes[..start].iter().filter(|&&b| b == b'\n').count() + 1;
    (line, String::from_utf8_lossy(&bytes[start..end.min(start + 300)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings() {
        assert_eq!(decode("\u{feff}é".as_bytes()).unwrap(), "é");
        assert_eq!(decode(b"\xff\xfe<\0a\0").unwrap(), "<a");
        assert_eq!(decode(b"\xfe\xff\0<\0a").unwrap(), "<a");
        assert!(decode(b"<?xml version='1.0' encoding='ISO-8859-1'?><a b='\xe9'/>").unwrap().contains('é'));
        assert_eq!(
            decode(b"<?xml version=\"1.0\" encoding=\"windows-1252\"?>\x80").unwrap().chars().last(),
            Some('€')
        );
        assert!(decode(b"<?xml version='1.0' encoding='KOI8-R'?><a/>").is_ok());
        assert!(
            decode(b"<?xml version='1.0' encoding='KOI8-R'?><a b='\xe9'/>")
                .unwrap_err()
                .message
                .contains("koi8-r")
        );
    }

    #[test]
    fn undeclared_bytes_are_located() {
        let e = decode(b"<a>\n<b c='\xe9'/>").unwrap_err();
        assert_eq!((e.at, e.guess.as_deref()), (10, Some("<a>\n<b c='é'/>")));
        assert_eq!(line_of_bytes(b"<a>\n<b c='\xe9'/>", e.at).0, 2);
    }
}
