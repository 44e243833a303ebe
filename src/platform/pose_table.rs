//! Poses in an Arrow stream, spelled as the lines of text that the pose reader understands: poses are few, and one reader
//! that knows names, units and orders is enough.

use super::layout::PoseColumn;
use crate::error::Result;
use crate::input::arrow::{ArrowDecoder, ArrowDetection, detect_arrow, table_error};
use std::path::{Path, PathBuf};

/// What a stream of poses is made of, and the spelling of the one form as the other.
#[derive(Debug, Default)]
pub(super) enum Spelling {
    /// The first bytes have not arrived.
    #[default]
    Unknown,
    /// As it is.
    Plain,
    /// An Arrow stream.
    Table(Box<Speller>),
}

impl Spelling {
    /// Adds what has arrived to `text`, spelled; as long as the first bytes do not tell what it is, as it is. `path` is the
    /// stream's name in messages, which learns that its lines are rows.
    ///
    /// # Errors
    /// As [`Speller::spell`].
    pub fn add(&mut self, bytes: &[u8], text: &mut Vec<u8>, path: &mut PathBuf) -> Result<()> {
        match self {
            Spelling::Table(speller) => return speller.spell(bytes, text),
            Spelling::Plain => text.extend_from_slice(bytes),
            Spelling::Unknown => {
                text.extend_from_slice(bytes);
                match detect_arrow(text) {
                    ArrowDetection::NeedMoreBytes => {}
                    ArrowDetection::Other => *self = Spelling::Plain,
                    ArrowDetection::Arrow => {
                        path.as_mut_os_string().push(" (rows as text)");
                        let mut speller = Speller::new(path);
                        let first = std::mem::take(text);
                        let spelled = speller.spell(&first, text);
                        *self = Spelling::Table(Box::new(speller));
                        return spelled;
                    }
                }
            }
        }
        Ok(())
    }

    /// Whether more must arrive before anything can be read.
    pub fn is_unknown(&self) -> bool {
        matches!(self, Spelling::Unknown)
    }

    /// Looks whether the stream may end here.
    ///
    /// # Errors
    /// As [`Speller::end`].
    pub fn end(&self) -> Result<()> {
        match self {
            Spelling::Table(speller) => speller.end(),
            Spelling::Plain | Spelling::Unknown => Ok(()),
        }
    }
}

/// Turns the bytes of an Arrow stream into lines: one of names, then one for every row.
#[derive(Debug)]
pub(super) struct Speller {
    decoder: ArrowDecoder,
    path: PathBuf,
    /// Positions of the columns that hold numbers, once the names are written.
    columns: Option<Vec<usize>>,
}

impl Speller {
    /// A stream of which nothing has arrived; `path` is its name in messages.
    pub fn new(path: &Path) -> Speller {
        Speller { decoder: ArrowDecoder::new(path), path: path.to_path_buf(), columns: None }
    }

    /// Takes in what has arrived and appends the lines of what is whole by now.
    ///
    /// # Errors
    /// [`Error::Input`](crate::error::Error::Input) for what is no Arrow stream, and for columns of poses that hold no
    /// numbers.
    pub fn spell(&mut self, bytes: &[u8], lines: &mut Vec<u8>) -> Result<()> {
        self.decoder.feed(bytes);
        loop {
            let batch = self.decoder.next_batch()?;
            if self.columns.is_none() && self.decoder.fields().is_some() {
                self.columns = Some(self.spell_names(lines)?);
            }
            let (Some(batch), Some(columns)) = (batch, &self.columns) else { return Ok(()) };
            for row in 0..batch.rows {
                for column in columns {
                    lines.extend_from_slice(zmij::Buffer::new().format(batch.value(*column, row)).as_bytes());
                    lines.push(b',');
                }
                end_line(lines);
            }
        }
    }

    /// Looks whether the stream may end here.
    ///
    /// # Errors
    /// As [`ArrowDecoder::end`].
    pub fn end(&self) -> Result<()> {
        self.decoder.end()
    }

    fn spell_names(&self, lines: &mut Vec<u8>) -> Result<Vec<usize>> {
        let mut columns = Vec::new();
        for (position, field) in self.decoder.fields().into_iter().flat_map(|f| f.iter()).enumerate() {
            if field.is_number() {
                lines.extend(field.heading.bytes().map(|b| if b",;\t\n".contains(&b) { b'_' } else { b }));
                lines.push(b',');
                columns.push(position);
            } else if PoseColumn::parse(&field.heading) != Ok(None) {
                let message = format!("column `{}` holds {}, expected numbers", field.heading, field.holds);
                return Err(table_error(&self.path, message, ""));
            }
        }
        if columns.is_empty() {
            return Err(table_error(&self.path, "no column holds numbers".to_owned(), ""));
        }
        end_line(lines);
        Ok(columns)
    }
}

/// The last comma becomes the line's end.
fn end_line(lines: &mut [u8]) {
    if let Some(last) = lines.last_mut() {
        *last = b'\n';
    }
}
