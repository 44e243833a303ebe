//! Headers of PLY files in the spelling that the parser accepts: single blanks, keywords in small letters,
//! names of letters, digits and underscores, line feeds.

use super::PlyError;
use crate::text::last_of_line_ends;
use std::collections::HashSet;

/// Maximum length of a header, bytes.
const MAX_HEADER_BYTES: usize = 1 << 20;

/// The header of a PLY file.
#[derive(Debug, PartialEq, Eq)]
pub struct PlyHeader {
    /// Its lines, without comments.
    pub text: String,
    /// Offset of the elements.
    pub body: usize,
    /// Names of elements with those of their properties that occur again.
    pub repeated: Vec<(String, String)>,
}

/// True if a file begins with the signature of PLY files.
pub fn is_ply(bytes: &[u8]) -> bool {
    matches!(bytes, [b'p', b'l', b'y', b'\r' | b'\n' | b' ' | b'\t', ..])
}

/// Reads the header of a file.
///
/// # Errors
/// A header that has no end, or is not text.
pub fn ply_header(bytes: &[u8]) -> Result<PlyHeader, PlyError> {
    let start = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    let line_end = last_of_line_ends(start);
    let mut header = PlyHeader { text: String::new(), body: 0, repeated: Vec::new() };
    let (mut names, mut written, mut element) = (HashSet::new(), HashSet::new(), String::new());
    while header.body < start.len() {
        let rest = &start[header.body..];
        let length = memchr::memchr(line_end, rest).unwrap_or(rest.len());
        header.body = (header.body + length + 1).min(bytes.len());
        let line = std::str::from_utf8(&rest[..length]);
        let words: Vec<&str> = match &line {
            Ok(line) => line.split_whitespace().collect(),
            // Comments may be in any encoding.
            Err(_) if rest.trim_ascii_start().starts_with(b"comment") => Vec::new(),
            Err(_) => return Err(PlyError::HeaderNotText),
        };
        let Some(keyword) = words.first().map(|word| word.to_ascii_lowercase()) else { continue };
        match keyword.as_str() {
            "comment" | "obj_info" => continue,
            "end_header" => {
                header.text.push_str("end_header\n");
                return Ok(header);
            }
            "property" if words.len() >= 3 => {
                let (name, types) = words[1..].split_last().unwrap_or((&"", &[]));
                if !written.insert((*name).to_owned()) {
                    header.repeated.push((element.clone(), (*name).to_owned()));
                }
                let types = types.join(" ").to_ascii_lowercase();
                header.text.push_str(&format!("property {types} {}\n", unique_name(name, &mut names)));
            }
            "element" => {
                names.clear();
                written.clear();
                element = words.get(1).map_or(String::new(), |name| (*name).to_owned());
                header.text.push_str(&format!("element {}\n", words[1..].join(" ")));
            }
            _ => header.text.push_str(&format!("{}\n", words.join(" ").to_ascii_lowercase())),
        }
    }
    Err(PlyError::NoHeaderEnd)
}

/// A name in the letters of the parser that is not among `names`, to which it is added.
fn unique_name(name: &str, names: &mut HashSet<String>) -> String {
    let mut plain: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() || "_-".contains(c) { c } else { '_' }).collect();
    if plain.starts_with(|c: char| !c.is_ascii_alphabetic() && c != '_') {
        plain.insert(0, '_');
    }
    while !names.insert(plain.clone()) {
        plain.push('_');
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blanks_capitals_and_line_ends_do_not_matter() {
        let lines = "ply\nformat   ascii 1.0\ncomment\ta\n element vertex\t3 \nproperty  FLOAT x\nproperty list  uchar int i\nend_header\n";
        let expected = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty list uchar int i\nend_header\n";
        for line_end in ["\n", "\r\n", "\r"] {
            // The first byte after the header is a line feed that belongs to the elements.
            let file = lines.replace('\n', line_end) + "\n\u{1}";
            let header = ply_header(file.as_bytes()).unwrap();
            assert_eq!((header.text.as_str(), header.body), (expected, file.len() - 2), "{line_end:?}");
        }
    }

    #[test]
    fn names_are_plain_and_different() {
        let file = b"ply\ncomment caf\xe9\nelement v 1\nproperty float a.b\nproperty float a#b\nproperty int 2nd\nend_header";
        let header = ply_header(file).unwrap();
        let expected =
            "ply\nelement v 1\nproperty float a_b\nproperty float a_b_\nproperty int _2nd\nend_header\n";
        assert_eq!((header.text.as_str(), header.body), (expected, file.len()));
        assert!(header.repeated.is_empty());
        let file =
            b"ply\nelement v 1\nproperty int a\nproperty int a\nelement w 1\nproperty int a\nend_header\n";
        assert_eq!(ply_header(file).unwrap().repeated, [("v".to_owned(), "a".to_owned())]);
        for (file, message) in
            [(&b"ply\nformat ascii 1.0\n"[..], "no end"), (b"ply\n\xff\xfe\nend_header\n", "not text")]
        {
            assert!(ply_header(file).unwrap_err().to_string().contains(message));
        }
    }
}
