//! Places of problems in files.

use std::ops::Range;
use std::path::{Path, PathBuf};

/// A place in a text file: one line with a range of it underlined.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file.
    pub path: PathBuf,
    /// Line number, from 1; 0 when only the file is known.
    pub line: usize,
    /// Column of the first underlined character, from 1.
    pub column: usize,
    /// The text of the line, without its end.
    pub excerpt: String,
    /// Underlined bytes of `excerpt`.
    pub marked: Range<usize>,
}

/// Maximum length of an excerpt, bytes; longer lines (files without line breaks) are cut around the mark.
const MAX_EXCERPT: usize = 400;
/// Byte of a line up to which columns count characters; columns behind it count bytes, so that many places in
/// a long line take little time.
const MAX_COUNTED_CHARACTERS: usize = 1 << 16;

impl Place {
    /// A file of which no line is known.
    pub fn of_file(path: &Path) -> Place {
        Place::in_line(path, 0, "", 0..0)
    }

    /// The place of byte range `at` of `text`. A range over several lines is cut at the end of its first
    /// line.
    pub fn in_text(path: &Path, text: &str, at: Range<usize>) -> Place {
        let mut start = at.start.min(text.len());
        while !text.is_char_boundary(start) {
            start -= 1;
        }
        let line_start = text[..start].rfind('\n').map_or(0, |i| i + 1);
        let line_end = text[start..].find('\n').map_or(text.len(), |i| start + i);
        let line = text[..line_start].matches('\n').count() + 1;
        let end = at.end.clamp(start, line_end);
        Place::in_line(path, line, &text[line_start..line_end], start - line_start..end - line_start)
    }

    /// The place of a line of which only the number is known; `text` is the line. Line 0 with an empty text
    /// means the complete file, for binary files.
    pub fn in_line(path: &Path, line: usize, text: &str, marked: Range<usize>) -> Place {
        let text = text.trim_end_matches(['\n', '\r']);
        let start = text.floor_char_boundary(marked.start);
        let end = text.ceil_char_boundary(marked.end.max(start));
        let column = match start <= MAX_COUNTED_CHARACTERS {
            true => text[..start].chars().count() + 1,
            false => start + 1,
        };
        let (from, to) = match text.len() <= MAX_EXCERPT {
            true => (0, text.len()),
            false => {
                let from = text.floor_char_boundary(start.saturating_sub(MAX_EXCERPT / 4));
                (from, text.floor_char_boundary(from + MAX_EXCERPT))
            }
        };
        let marked = start - from..end.min(to).max(start) - from;
        Place { path: path.to_path_buf(), line, column, excerpt: text[from..to].to_owned(), marked }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_knows_line_and_column() {
        let text = "<a>\n  <leg z='abc'/>\r\n</a>";
        let at = text.find("abc").unwrap();
        let p = Place::in_text(Path::new("s.xml"), text, at..at + 3);
        assert_eq!((p.line, p.column, p.excerpt.as_str()), (2, 11, "  <leg z='abc'/>"));
        assert_eq!(&p.excerpt[p.marked.clone()], "abc");
    }

    #[test]
    fn long_lines_are_cut_but_keep_their_column() {
        let text = format!("{}X{}", "é".repeat(5000), "b".repeat(5000));
        let p = Place::in_text(Path::new("s.xml"), &text, 10_000..10_001);
        assert_eq!((p.column, &p.excerpt[p.marked.clone()]), (5001, "X"));
        assert!(p.excerpt.len() <= MAX_EXCERPT);
    }
}
