//! Tables of numbers in an Arrow IPC stream, or in an Arrow file read from its beginning (Arrow columnar
//! format, "IPC streaming format"). Streams are recognised by their first bytes and decoded batch by batch
//! while they arrive.
//!
//! The lengths of a message are checked here before anything is allocated for it, then `arrow-ipc` decodes
//! and validates it. Its `StreamDecoder` is not used because it withholds a schema until the bytes of the
//! next message arrive. Only columns of numbers are decoded; one batch is in memory at a time.

use ::arrow_array::cast::AsArray;
use ::arrow_array::types::{
    Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, UInt8Type, UInt16Type, UInt32Type,
    UInt64Type,
};
use ::arrow_array::{Array, ArrowPrimitiveType, RecordBatch};
use ::arrow_buffer::Buffer;
use ::arrow_ipc::convert::try_fb_to_schema;
use ::arrow_ipc::reader::read_record_batch;
use ::arrow_ipc::writer::StreamEncoder;
use ::arrow_ipc::{Endianness, MessageHeader, root_as_message};
use ::arrow_schema::{DataType, SchemaRef};
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::damage::catch_decoder_panic;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};

/// First bytes of a message of a stream.
const CONTINUATION: [u8; 4] = [0xff; 4];
/// First bytes of a file, before its messages.
const FILE_MAGIC: [u8; 8] = *b"ARROW1\0\0";
/// Maximum length of a message's metadata, bytes.
const MAX_METADATA_BYTES: usize = 1 << 24;
/// Maximum length of a message's body, bytes.
const MAX_BATCH_BYTES: usize = 1 << 30;

/// Detection of an Arrow stream by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArrowDetection {
    /// An Arrow stream or file.
    Arrow,
    /// Something else.
    Other,
    /// Undecided until more bytes arrive.
    NeedMoreBytes,
}

/// Compares the first bytes of a stream with those of Arrow streams and files.
pub fn detect_arrow(first: &[u8]) -> ArrowDetection {
    let agrees = |magic: &[u8]| {
        let common = magic.len().min(first.len());
        first[..common] == magic[..common]
    };
    match (agrees(&CONTINUATION), agrees(&FILE_MAGIC)) {
        (true, _) if first.len() >= CONTINUATION.len() => ArrowDetection::Arrow,
        (_, true) if first.len() >= FILE_MAGIC.len() => ArrowDetection::Arrow,
        (false, false) => ArrowDetection::Other,
        _ => ArrowDetection::NeedMoreBytes,
    }
}

/// Description of one column of an Arrow stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TableField {
    /// The name of the column, followed by the unit in its metadata unless the name contains one: `time[ns]`.
    pub heading: String,
    /// Description of the values, for messages.
    pub holds: &'static str,
    is_number: bool,
}

impl TableField {
    /// The description of a field.
    pub fn new(field: &::arrow_schema::Field) -> TableField {
        let name = field.name();
        let heading = match field.metadata().get("unit").map_or("", String::as_str) {
            "" => name.clone(),
            _ if name.contains(['[', '(']) => name.clone(),
            unit => format!("{name}[{unit}]"),
        };
        let kind = field.data_type();
        let is_number = kind.is_integer() || matches!(kind, DataType::Float32 | DataType::Float64);
        let holds = match kind {
            _ if is_number => "numbers",
            DataType::Float16 => "half-precision numbers",
            DataType::Dictionary(..) => "values of a dictionary",
            DataType::Null => "nothing",
            DataType::Boolean => "truth values",
            DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View => "text",
            kind if kind.is_temporal() => "calendar times or durations",
            _ => "values of another type",
        };
        TableField { heading, holds, is_number }
    }

    /// True if values of the column can be read as numbers: integers, or floats of 32 or 64 bits.
    pub fn is_number(&self) -> bool {
        self.is_number
    }
}

/// The rows of one record batch.
#[derive(Debug)]
pub struct NumberBatch {
    /// Number of the batch in the stream, from 1.
    pub number: u64,
    /// Number of rows in the batches before it.
    pub before: u64,
    /// Number of rows in this batch.
    pub rows: usize,
    /// Values by field and row; `None` for fields that are not numbers.
    columns: Vec<Option<Vec<f64>>>,
}

impl NumberBatch {
    /// A value; NaN where the column does not contain numbers. Integers beyond 2⁵³ are rounded.
    ///
    /// # Panics
    /// If there is no such row or column.
    pub fn value(&self, column: usize, row: usize) -> f64 {
        self.columns[column].as_ref().map_or(f64::NAN, |values| values[row])
    }

    /// Number of columns, whether or not they contain numbers.
    pub fn width(&self) -> usize {
        self.columns.len()
    }

    /// Position of a row in a table in memory, for messages: from 0, as programs count rows of arrays.
    pub fn index(&self, row: usize) -> String {
        format!("index {}", self.before.saturating_add(row as u64))
    }

    /// Number of a row in the stream and in the batch, for messages.
    pub fn place(&self, row: usize) -> String {
        let of_all = self.before.saturating_add(row as u64 + 1);
        format!("row {of_all} (batch {}, its row {})", self.number, row + 1)
    }
}

/// A push decoder, which takes bytes as they arrive and returns each batch as soon as it is complete.
#[derive(Debug)]
pub struct ArrowDecoder {
    path: PathBuf,
    /// Bytes that have arrived and have not been decoded.
    pending: Vec<u8>,
    has_begun: bool,
    /// True if the next bytes may be padding after the first bytes of a file.
    may_be_padding: bool,
    has_ended: bool,
    schema: Option<Schema>,
    batches: u64,
    rows: u64,
}

#[derive(Debug)]
struct Schema {
    fields: Arc<[TableField]>,
    /// Positions of the fields that are numbers.
    numbers: Vec<usize>,
    decoded: SchemaRef,
}

impl ArrowDecoder {
    /// A decoder without bytes; `path` is the name in messages.
    pub fn new(path: &Path) -> ArrowDecoder {
        ArrowDecoder {
            path: path.to_path_buf(),
            pending: Vec::new(),
            has_begun: false,
            may_be_padding: false,
            has_ended: false,
            schema: None,
            batches: 0,
            rows: 0,
        }
    }

    /// Adds bytes that have arrived. Bytes after the end of the stream, such as the footer of a file, are
    /// ignored.
    pub fn feed(&mut self, bytes: &[u8]) {
        if !self.has_ended {
            self.pending.extend_from_slice(bytes);
        }
    }

    /// The columns, once the schema has arrived.
    pub fn fields(&self) -> Option<&Arc<[TableField]>> {
        self.schema.as_ref().map(|schema| &schema.fields)
    }

    /// The metadata of the table; empty until the schema has arrived.
    pub fn metadata(&self) -> BTreeMap<String, String> {
        let metadata = |schema: &Schema| BTreeMap::from(schema.decoded.metadata().clone());
        self.schema.as_ref().map(metadata).unwrap_or_default()
    }

    /// The next batch with rows that has arrived completely.
    ///
    /// # Errors
    /// [`Error::Input`] for bytes that are not an Arrow stream, and for unsupported features, with the number
    /// of the batch.
    pub fn next_batch(&mut self) -> Result<Option<NumberBatch>> {
        if !self.has_begun && self.pending.len() >= FILE_MAGIC.len() {
            self.has_begun = true;
            self.may_be_padding = self.pending.starts_with(&FILE_MAGIC);
            if self.may_be_padding {
                self.pending.drain(..FILE_MAGIC.len());
            }
        }
        if self.may_be_padding {
            // Some writers pad the first bytes to 64; no message begins with 0.
            let padding = self.pending.iter().take_while(|b| **b == 0).count();
            self.may_be_padding = padding == self.pending.len();
            self.pending.drain(..padding);
        }
        while let Some((metadata, body)) = self.complete_message()? {
            let batch = self.decode_message(metadata, body.clone())?;
            self.pending.drain(..body.end);
            match batch {
                Some(batch) if batch.rows > 0 => return Ok(Some(batch)),
                _ => {}
            }
        }
        Ok(None)
    }

    /// Checks that the stream may end here.
    ///
    /// # Errors
    /// [`Error::Input`] when the stream ends within a message or before its schema.
    pub fn end(&self) -> Result<()> {
        if !self.pending.is_empty() {
            let message = format!(
                "the stream ends within batch {}, after {} whole rows in {} batches",
                self.batches + 1,
                self.rows,
                self.batches
            );
            return Err(self.refused(message, "its writer was interrupted, or the file is cut off"));
        }
        if self.schema.is_none() {
            return Err(self.refused("the stream ends before its schema".to_owned(), ""));
        }
        Ok(())
    }

    /// Ranges of the metadata and the body of the first message, if it has arrived completely; `None` also at
    /// the end marker.
    fn complete_message(&mut self) -> Result<Option<(Range<usize>, Range<usize>)>> {
        if self.has_ended || self.pending.len() < 8 {
            return Ok(None);
        }
        if self.pending[..4] != CONTINUATION {
            return Err(self.damaged("no message begins where one should"));
        }
        let mut length = [0; 4];
        length.copy_from_slice(&self.pending[4..8]);
        let length = u32::from_le_bytes(length) as usize;
        if length == 0 {
            self.has_ended = true;
            self.pending = Vec::new();
            return Ok(None);
        }
        if length > MAX_METADATA_BYTES {
            return Err(self.damaged("a message with too much metadata"));
        }
        let metadata = 8..8 + length;
        let Some(bytes) = self.pending.get(metadata.clone()) else { return Ok(None) };
        let message = root_as_message(bytes).map_err(|_| self.damaged("unreadable metadata"))?;
        let body = usize::try_from(message.bodyLength()).unwrap_or(usize::MAX);
        if body > MAX_BATCH_BYTES {
            let message = format!("batch {} has {} bytes", self.batches + 1, message.bodyLength());
            let help = "write smaller ones; in pyarrow: write_table(table, max_chunksize=65536)";
            return Err(self.refused(message, help));
        }
        let body = metadata.end..metadata.end + body;
        Ok((self.pending.len() >= body.end).then_some((metadata, body)))
    }

    fn decode_message(&mut self, metadata: Range<usize>, body: Range<usize>) -> Result<Option<NumberBatch>> {
        let bytes = &self.pending[metadata];
        let message = root_as_message(bytes).map_err(|_| self.damaged("unreadable metadata"))?;
        match message.header_type() {
            MessageHeader::Schema => {
                let Some(schema) = message.header_as_schema() else {
                    return Err(self.damaged("a schema without contents"));
                };
                self.schema = Some(self.decode_schema(schema)?);
                Ok(None)
            }
            MessageHeader::RecordBatch => {
                let Some(schema) = &self.schema else {
                    return Err(self.damaged("a batch before the schema"));
                };
                let Some(batch) = message.header_as_record_batch() else {
                    return Err(self.damaged("a batch without contents"));
                };
                if batch.compression().is_some() {
                    let help = "write it without compression; in pyarrow and polars that is the default";
                    return Err(self.refused(format!("batch {} is compressed", self.batches + 1), help));
                }
                let body = Buffer::from(&self.pending[body]);
                // The decoder may panic on a damaged message.
                let decoded = catch_decoder_panic(|| {
                    let (version, decoded) = (message.version(), schema.decoded.clone());
                    read_record_batch(&body, batch, decoded, &HashMap::new(), Some(&schema.numbers), &version)
                });
                let decoded = decoded.ok_or_else(|| self.damaged("a damaged batch"))?;
                let batch = self.numbers(schema, &decoded.map_err(|e| self.damaged(&e.to_string()))?)?;
                (self.batches, self.rows) = (batch.number, self.rows.saturating_add(batch.rows as u64));
                Ok(Some(batch))
            }
            // Columns of dictionaries are not decoded.
            MessageHeader::DictionaryBatch => Ok(None),
            _ => Err(self.damaged("a message that is neither schema nor batch")),
        }
    }

    fn decode_schema(&self, schema: ::arrow_ipc::Schema) -> Result<Schema> {
        if self.schema.is_some() {
            return Err(self.damaged("a second schema"));
        }
        if schema.endianness() != Endianness::Little {
            return Err(self.refused("its numbers are big-endian".to_owned(), ""));
        }
        let decoded = catch_decoder_panic(|| try_fb_to_schema(schema));
        let decoded = decoded.ok_or_else(|| self.damaged("a damaged schema"))?;
        let decoded = decoded.map_err(|e| self.damaged(&e.to_string()))?;
        if let Some(nested) = decoded.fields().iter().find(|field| field.data_type().is_nested()) {
            let message = format!("column `{}` is nested", nested.name());
            return Err(self.refused(message, "leave it out of the table"));
        }
        let fields: Arc<[TableField]> = decoded.fields().iter().map(|field| TableField::new(field)).collect();
        let numbers = (0..fields.len()).filter(|i| fields[*i].is_number).collect();
        Ok(Schema { fields, numbers, decoded: Arc::new(decoded) })
    }

    fn numbers(&self, schema: &Schema, decoded: &RecordBatch) -> Result<NumberBatch> {
        let (number, rows) = (self.batches + 1, decoded.num_rows());
        let mut columns: Vec<Option<Vec<f64>>> = vec![None; schema.fields.len()];
        for (&field, array) in schema.numbers.iter().zip(decoded.columns()) {
            let nulls = array.null_count();
            if nulls != 0 {
                let heading = &schema.fields[field].heading;
                let message =
                    format!("batch {number}: {nulls} of {rows} values of column `{heading}` are null");
                return Err(self.refused(message, "fill them, or leave such rows out"));
            }
            columns[field] = numbers(array);
        }
        Ok(NumberBatch { number, before: self.rows, rows, columns })
    }

    fn damaged(&self, what: &str) -> Error {
        let message =
            format!("invalid Arrow stream after {} rows in {} batches: {what}", self.rows, self.batches);
        self.refused(message, "")
    }

    fn refused(&self, message: String, help: &str) -> Error {
        table_error(&self.path, message, help)
    }
}

/// Maximum number of rows of a batch of [`encode_stream`].
const STREAM_ROWS: usize = 1 << 16;

/// The Arrow IPC stream of record batches of one schema.
///
/// # Errors
/// [`Error::Input`] for batches that Arrow cannot encode.
pub fn encode_stream(schema: &SchemaRef, batches: &[RecordBatch]) -> Result<Vec<u8>> {
    let failed = |e: ::arrow_schema::ArrowError| Error::input(format!("Arrow: {e}"));
    let mut encoder = StreamEncoder::try_new(schema).map_err(failed)?;
    let mut bytes = Vec::new();
    let mut push = |buffers: Vec<Buffer>| buffers.iter().for_each(|b| bytes.extend_from_slice(b.as_slice()));
    // An empty batch writes the schema.
    push(encoder.encode(&RecordBatch::new_empty(schema.clone())).map_err(failed)?);
    for batch in batches {
        for from in (0..batch.num_rows()).step_by(STREAM_ROWS) {
            let rows = STREAM_ROWS.min(batch.num_rows() - from);
            push(encoder.encode(&batch.slice(from, rows)).map_err(failed)?);
        }
    }
    push(encoder.finish().map_err(failed)?);
    Ok(bytes)
}

/// The numbers of an array, NaN for nulls; `None` if it contains other values.
pub fn numbers(array: &dyn Array) -> Option<Vec<f64>> {
    fn of<T: ArrowPrimitiveType>(array: &dyn Array, number: impl Fn(T::Native) -> f64) -> Option<Vec<f64>> {
        Some(array.as_primitive_opt::<T>()?.iter().map(|v| v.map_or(f64::NAN, &number)).collect())
    }
    of::<Float64Type>(array, |v| v)
        .or_else(|| of::<Float32Type>(array, f64::from))
        .or_else(|| of::<UInt8Type>(array, f64::from))
        .or_else(|| of::<UInt16Type>(array, f64::from))
        .or_else(|| of::<UInt32Type>(array, f64::from))
        .or_else(|| of::<UInt64Type>(array, |v| v as f64))
        .or_else(|| of::<Int8Type>(array, f64::from))
        .or_else(|| of::<Int16Type>(array, f64::from))
        .or_else(|| of::<Int32Type>(array, f64::from))
        .or_else(|| of::<Int64Type>(array, |v| v as f64))
}

/// An error about a table or about a row that the message names; `help` may be empty.
pub fn table_error(path: &Path, message: String, help: &str) -> Error {
    let mut problems = Diagnostics::default();
    let problem = problems.error(Some(Place::in_line(path, 0, "", 0..0)), message);
    if !help.is_empty() {
        problem.help(help);
    }
    Error::Input(Box::new(problems))
}

#[cfg(test)]
mod tests;
