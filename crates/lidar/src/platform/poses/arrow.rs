//! Poses in an Arrow stream, converted to text. There are few poses, so one parser of names, units and orders suffices.

use crate::platform::layout::PoseColumn;
use std::path::{Path, PathBuf};
use vlscan_base::error::Result;
use vlscan_base::input::arrow::{ArrowDecoder, ArrowDetection, detect_arrow, table_error};

/// The bytes of a stream of poses, with Arrow converted to text.
#[derive(Debug, Default)]
pub enum TextInput {
    /// The first bytes have not arrived.
    #[default]
    Unknown,
    /// Anything but Arrow.
    Verbatim,
    /// An Arrow stream.
    Arrow(Box<ArrowToText>),
}

impl TextInput {
    /// Appends the next bytes to `text`, converted once the first bytes have shown that they are Arrow. `path`, the
    /// stream's name in messages, then says that lines are rows.
    ///
    /// # Errors
    /// As [`ArrowToText::convert`].
    pub fn push(&mut self, bytes: &[u8], text: &mut Vec<u8>, path: &mut PathBuf) -> Result<()> {
        match self {
            TextInput::Arrow(converter) => return converter.convert(bytes, text),
            TextInput::Verbatim => text.extend_from_slice(bytes),
            TextInput::Unknown => {
                text.extend_from_slice(bytes);
                match detect_arrow(text) {
                    ArrowDetection::NeedMoreBytes => {}
                    ArrowDetection::Other => *self = TextInput::Verbatim,
                    ArrowDetection::Arrow => {
                        path.as_mut_os_string().push(" (rows as text)");
                        let mut converter = ArrowToText::new(path);
                        let first = std::mem::take(text);
                        let converted = converter.convert(&first, text);
                        *self = TextInput::Arrow(Box::new(converter));
                        return converted;
                    }
                }
            }
        }
        Ok(())
    }

    pub fn is_unknown(&self) -> bool {
        matches!(self, TextInput::Unknown)
    }

    /// Checks that the stream may end here.
    ///
    /// # Errors
    /// An incomplete Arrow stream, see [`ArrowDecoder::end`].
    pub fn check_end(&self) -> Result<()> {
        match self {
            TextInput::Arrow(converter) => converter.decoder.end(),
            TextInput::Verbatim | TextInput::Unknown => Ok(()),
        }
    }
}

/// Converts the bytes of an Arrow stream to lines: one of headings, then one for every row.
#[derive(Debug)]
pub struct ArrowToText {
    decoder: ArrowDecoder,
    path: PathBuf,
    /// Indices of the numeric columns, once the headings are written.
    columns: Option<Vec<usize>>,
}

impl ArrowToText {
    fn new(path: &Path) -> ArrowToText {
        ArrowToText { decoder: ArrowDecoder::new(path), path: path.to_path_buf(), columns: None }
    }

    /// Appends the lines of all rows that are complete with `bytes`.
    ///
    /// # Errors
    /// [`Error::Input`](vlscan_base::error::Error::Input) for anything but an Arrow stream, and for pose columns without
    /// numbers.
    fn convert(&mut self, bytes: &[u8], lines: &mut Vec<u8>) -> Result<()> {
        self.decoder.feed(bytes);
        loop {
            let batch = self.decoder.next_batch()?;
            if self.columns.is_none() && self.decoder.fields().is_some() {
                self.columns = Some(self.write_headings(lines)?);
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

    fn write_headings(&self, lines: &mut Vec<u8>) -> Result<Vec<usize>> {
        let mut columns = Vec::new();
        for (index, field) in self.decoder.fields().into_iter().flat_map(|f| f.iter()).enumerate() {
            if field.is_number() {
                lines.extend(field.heading.bytes().map(|b| if b",;\t\n".contains(&b) { b'_' } else { b }));
                lines.push(b',');
                columns.push(index);
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

/// Replaces the last comma by the end of the line.
fn end_line(lines: &mut [u8]) {
    if let Some(last) = lines.last_mut() {
        *last = b'\n';
    }
}
