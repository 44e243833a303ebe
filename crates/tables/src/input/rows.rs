//! Rows of tables of numbers, as lines of text or as record batches of an Arrow stream, decoded while they
//! arrive: [`RowDecoder`] takes bytes and returns blocks of complete rows, whose numbers any thread can read.
//! The caller interprets the columns, and finds the names in [`RowDecoder::fields`] or in the first
//! row of the text.
//!
//! | file | what it does |
//! |---|---|
//! | `text` | lines of text with rows, while they arrive |
//! | `row` | numbers of a row, and their places |

mod row;
mod text;

pub use row::{Row, RowError, line_place};
pub use text::{LeadingLine, line_length};

use super::arrow::{ArrowDecoder, ArrowDetection, NumberBatch, TableField, detect_arrow};
use row::{RowContent, Source};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use text::{Lines, TextDecoder};
use vlscan_base::columns::Separator;
use vlscan_base::error::Result;

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

#[derive(Debug)]
enum Format {
    /// Too few bytes have arrived to decide.
    Unknown(Vec<u8>, Option<char>, bool),
    Text(TextDecoder),
    Arrow(Box<ArrowDecoder>, Option<RowBlock>),
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
    /// [`vlscan_base::Error::Input`] for lines that are too long, for bytes that are not text, and for
    /// damaged and cut Arrow streams. The rows before are returned first.
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

#[cfg(test)]
mod tests {
    use super::text::MAX_LINE_BYTES;
    use super::*;
    use vlscan_base::error::Error;

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
