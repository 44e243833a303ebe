//! Tables of numbers that arrive as an Arrow IPC stream, or as an Arrow file read from its beginning (Arrow columnar format,
//! "IPC streaming format"): recognised by their first bytes, and taken apart batch by batch while they flow.
//!
//! Metadata is verified before it is looked into and every range is checked against what has arrived, so that no stream can
//! do more than be refused; memory holds one batch.

use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use ::arrow_ipc::{Endianness, MessageHeader, Precision, Type, root_as_message};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What a message of a stream begins with.
const CONTINUATION: [u8; 4] = [0xff; 4];
/// What a file begins with; its messages follow.
const FILE: [u8; 8] = *b"ARROW1\0\0";
/// Longer metadata tells of no table of pulses or poses, bytes.
const LONGEST_METADATA: usize = 1 << 24;
/// Longer batches are not kept in memory, bytes.
const LONGEST_BATCH: usize = 1 << 30;

/// What the first bytes of a stream tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArrowDetection {
    /// An Arrow stream or file.
    Arrow,
    /// Something else.
    Other,
    /// Not yet: more must arrive.
    NeedMoreBytes,
}

/// Looks at the first bytes of a stream.
pub fn detect_arrow(first: &[u8]) -> ArrowDetection {
    let begins = |mark: &[u8]| {
        let common = mark.len().min(first.len());
        first[..common] == mark[..common]
    };
    match (begins(&CONTINUATION), begins(&FILE)) {
        (true, _) if first.len() >= CONTINUATION.len() => ArrowDetection::Arrow,
        (_, true) if first.len() >= FILE.len() => ArrowDetection::Arrow,
        (false, false) => ArrowDetection::Other,
        _ => ArrowDetection::NeedMoreBytes,
    }
}

/// A column as the schema describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name, with the unit of the metadata behind it where the name has none: `time[ns]`.
    pub heading: String,
    /// What it holds, for messages.
    pub holds: &'static str,
    form: Form,
}

impl Field {
    /// Whether it holds numbers.
    pub fn is_number(&self) -> bool {
        matches!(self.form, Form::Number(_))
    }
}

/// How the values of a column are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    Number(Number),
    /// So many buffers that are passed over, and as many more as the batch says.
    Other {
        buffers: usize,
        variadic: bool,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Number {
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
    F32,
    F64,
}

impl Number {
    fn width(self) -> usize {
        match self {
            Number::I8 | Number::U8 => 1,
            Number::I16 | Number::U16 => 2,
            Number::I32 | Number::U32 | Number::F32 => 4,
            Number::I64 | Number::U64 | Number::F64 => 8,
        }
    }
}

/// Rows that arrived together.
#[derive(Debug)]
pub struct Batch {
    /// Its number in the stream, from 1.
    pub number: u64,
    /// Rows of the batches before it.
    pub before: u64,
    /// Its rows.
    pub rows: usize,
    body: Vec<u8>,
    /// By field: how its values are stored and where in the body, if they are numbers.
    columns: Vec<Option<(Number, usize)>>,
}

impl Batch {
    /// A value; NaN where the column holds no numbers.
    ///
    /// Whole numbers beyond 2⁵³ are rounded.
    ///
    /// # Panics
    /// When there is no such row or column.
    pub fn value(&self, column: usize, row: usize) -> f64 {
        let Some((number, start)) = self.columns[column] else { return f64::NAN };
        assert!(row < self.rows, "row {row} of {}", self.rows);
        let at = start + row * number.width();
        macro_rules! read {
            ($of:ty) => {{
                let mut bytes = [0; size_of::<$of>()];
                bytes.copy_from_slice(&self.body[at..at + size_of::<$of>()]);
                <$of>::from_le_bytes(bytes)
            }};
        }
        match number {
            Number::I8 => f64::from(read!(i8)),
            Number::I16 => f64::from(read!(i16)),
            Number::I32 => f64::from(read!(i32)),
            Number::I64 => read!(i64) as f64,
            Number::U8 => f64::from(read!(u8)),
            Number::U16 => f64::from(read!(u16)),
            Number::U32 => f64::from(read!(u32)),
            Number::U64 => read!(u64) as f64,
            Number::F32 => f64::from(read!(f32)),
            Number::F64 => read!(f64),
        }
    }

    /// Where a row stands, for messages.
    pub fn place(&self, row: usize) -> String {
        let of_all = self.before.saturating_add(row as u64 + 1);
        format!("row {of_all} (batch {}, its row {})", self.number, row + 1)
    }
}

/// Takes bytes as they arrive and gives batches as soon as they are whole.
#[derive(Debug)]
pub struct ArrowDecoder {
    path: PathBuf,
    /// Bytes that have arrived and belong to no batch yet.
    rest: Vec<u8>,
    begun: bool,
    /// Whether what arrives may be padding behind the first bytes of a file.
    padded: bool,
    ended: bool,
    fields: Option<Arc<[Field]>>,
    batches: u64,
    rows: u64,
}

impl ArrowDecoder {
    /// A stream of which nothing has arrived; `path` is its name in messages.
    pub fn new(path: &Path) -> ArrowDecoder {
        ArrowDecoder {
            path: path.to_path_buf(),
            rest: Vec::new(),
            begun: false,
            padded: false,
            ended: false,
            fields: None,
            batches: 0,
            rows: 0,
        }
    }

    /// Takes in what has arrived.
    pub fn feed(&mut self, bytes: &[u8]) {
        // What follows the end, such as the footer of a file, says nothing new.
        if !self.ended {
            self.rest.extend_from_slice(bytes);
        }
    }

    /// The columns, once the schema has arrived.
    pub fn fields(&self) -> Option<&Arc<[Field]>> {
        self.fields.as_ref()
    }

    /// The next batch that has arrived whole.
    ///
    /// # Errors
    /// [`Error::Input`] for what is no Arrow stream, or one of a kind that is not read, with the number of the batch.
    pub fn next_batch(&mut self) -> Result<Option<Batch>> {
        if !self.begun && self.rest.len() >= FILE.len() {
            self.begun = true;
            self.padded = self.rest.starts_with(&FILE);
            if self.padded {
                self.rest.drain(..FILE.len());
            }
        }
        if self.padded {
            // Some writers fill up to 64 bytes; every message begins with other bytes.
            let padding = self.rest.iter().take_while(|b| **b == 0).count();
            self.padded = padding == self.rest.len();
            self.rest.drain(..padding);
        }
        while let Some((metadata, body)) = self.whole_message()? {
            let batch = self.take_message(metadata, body.clone())?;
            self.rest.drain(..body.end);
            match batch {
                Some(batch) if batch.rows > 0 => return Ok(Some(batch)),
                _ => {}
            }
        }
        Ok(None)
    }

    /// Looks whether the stream may end here.
    ///
    /// # Errors
    /// [`Error::Input`] when it ends within a message or before its schema.
    pub fn end(&self) -> Result<()> {
        if !self.rest.is_empty() {
            let message = format!(
                "the stream ends within batch {}, after {} whole rows in {} batches",
                self.batches + 1,
                self.rows,
                self.batches
            );
            return Err(self.refused(message, "whatever writes it was interrupted, or the file is cut off"));
        }
        if self.fields.is_none() {
            return Err(self.refused("the stream ends before its schema".to_owned(), ""));
        }
        Ok(())
    }

    /// Metadata and body of the first message, if it has arrived; nothing at the mark that ends the stream.
    fn whole_message(&mut self) -> Result<Option<(Range<usize>, Range<usize>)>> {
        if self.ended || self.rest.len() < 8 {
            return Ok(None);
        }
        if self.rest[..4] != CONTINUATION {
            return Err(self.damaged("no message begins where one should"));
        }
        let mut length = [0; 4];
        length.copy_from_slice(&self.rest[4..8]);
        let length = u32::from_le_bytes(length) as usize;
        if length == 0 {
            self.ended = true;
            self.rest = Vec::new();
            return Ok(None);
        }
        if length > LONGEST_METADATA {
            return Err(self.damaged("a message with too much metadata"));
        }
        let metadata = 8..8 + length;
        let Some(bytes) = self.rest.get(metadata.clone()) else { return Ok(None) };
        let message = root_as_message(bytes).map_err(|_| self.damaged("unreadable metadata"))?;
        let body = usize::try_from(message.bodyLength()).unwrap_or(usize::MAX);
        if body > LONGEST_BATCH {
            let message = format!("batch {} has {} bytes", self.batches + 1, message.bodyLength());
            let help = "cut it into smaller ones; in pyarrow: write_table(table, max_chunksize=65536)";
            return Err(self.refused(message, help));
        }
        let body = metadata.end..metadata.end + body;
        Ok((self.rest.len() >= body.end).then_some((metadata, body)))
    }

    fn take_message(&mut self, metadata: Range<usize>, body: Range<usize>) -> Result<Option<Batch>> {
        // Verified a moment ago, when its length was looked up.
        let message =
            root_as_message(&self.rest[metadata]).map_err(|_| self.damaged("unreadable metadata"))?;
        match message.header_type() {
            MessageHeader::Schema => {
                let Some(schema) = message.header_as_schema() else {
                    return Err(self.damaged("a schema that is none"));
                };
                if self.fields.is_some() {
                    return Err(self.damaged("a second schema"));
                }
                if schema.endianness() != Endianness::Little {
                    return Err(self.refused("its numbers are big-endian".to_owned(), ""));
                }
                let fields = schema.fields().into_iter().flatten().map(|f| self.field(&f));
                let fields = fields.collect::<Result<Vec<Field>>>()?;
                self.fields = Some(fields.into());
                Ok(None)
            }
            MessageHeader::RecordBatch => {
                let Some(batch) = message.header_as_record_batch() else {
                    return Err(self.damaged("a batch that is none"));
                };
                let batch = self.batch(&batch, &self.rest[body])?;
                (self.batches, self.rows) = (batch.number, self.rows.saturating_add(batch.rows as u64));
                Ok(Some(batch))
            }
            // Dictionaries belong to columns that are passed over.
            MessageHeader::DictionaryBatch => Ok(None),
            _ => Err(self.damaged("a message that is neither schema nor batch")),
        }
    }

    fn field(&self, field: &::arrow_ipc::Field) -> Result<Field> {
        let other = |holds, buffers| (holds, Form::Other { buffers, variadic: false });
        let number = |number| ("numbers", Form::Number(number));
        let (holds, form) = if field.dictionary().is_some() {
            other("numbers of a dictionary", 2)
        } else {
            match field.type_type() {
                Type::Int => match field.type_as_int().map(|i| (i.bitWidth(), i.is_signed())) {
                    Some((8, true)) => number(Number::I8),
                    Some((16, true)) => number(Number::I16),
                    Some((32, true)) => number(Number::I32),
                    Some((64, true)) => number(Number::I64),
                    Some((8, false)) => number(Number::U8),
                    Some((16, false)) => number(Number::U16),
                    Some((32, false)) => number(Number::U32),
                    Some((64, false)) => number(Number::U64),
                    _ => other("integers of an unknown size", 2),
                },
                Type::FloatingPoint => match field.type_as_floating_point().map(|f| f.precision()) {
                    Some(Precision::DOUBLE) => number(Number::F64),
                    Some(Precision::SINGLE) => number(Number::F32),
                    _ => other("half-precision numbers", 2),
                },
                Type::Null => other("nothing", 0),
                Type::Bool => other("truth values", 2),
                Type::Decimal => other("decimals", 2),
                Type::Date | Type::Time | Type::Timestamp => other("calendar times", 2),
                Type::Duration | Type::Interval => other("durations", 2),
                Type::FixedSizeBinary => other("bytes", 2),
                Type::Utf8 | Type::LargeUtf8 => other("text", 3),
                Type::Binary | Type::LargeBinary => other("bytes", 3),
                Type::Utf8View => ("text", Form::Other { buffers: 2, variadic: true }),
                Type::BinaryView => ("bytes", Form::Other { buffers: 2, variadic: true }),
                _ => {
                    let message = format!("column `{}` is nested", field.name().unwrap_or_default());
                    return Err(self.refused(message, "leave it out of the table"));
                }
            }
        };
        let unit = field.custom_metadata().into_iter().flatten().find(|told| told.key() == Some("unit"));
        let unit = unit.and_then(|told| told.value()).unwrap_or_default();
        let name = field.name().unwrap_or_default();
        let heading = match unit {
            "" => name.to_owned(),
            _ if name.contains(['[', '(']) => name.to_owned(),
            unit => format!("{name}[{unit}]"),
        };
        Ok(Field { heading, holds, form })
    }

    fn batch(&self, batch: &::arrow_ipc::RecordBatch, body: &[u8]) -> Result<Batch> {
        let Some(fields) = &self.fields else { return Err(self.damaged("a batch before the schema")) };
        if batch.compression().is_some() {
            let help = "write it without compression; in pyarrow and polars that is the default";
            return Err(self.refused(format!("batch {} is compressed", self.batches + 1), help));
        }
        let (Ok(rows), Some(nodes), Some(buffers)) =
            (usize::try_from(batch.length()), batch.nodes(), batch.buffers())
        else {
            return Err(self.damaged("a batch without columns"));
        };
        let mut variadic = batch.variadicBufferCounts().into_iter().flatten();
        let (mut columns, mut next) = (Vec::with_capacity(fields.len()), 0);
        for (i, field) in fields.iter().enumerate() {
            if i >= nodes.len() {
                return Err(self.damaged("a batch with too few columns"));
            }
            match field.form {
                Form::Other { buffers, variadic: more } => {
                    let more = if more { variadic.next().unwrap_or(0) } else { 0 };
                    next += buffers + usize::try_from(more).unwrap_or(0);
                    columns.push(None);
                }
                Form::Number(number) => {
                    if next + 2 > buffers.len() {
                        return Err(self.damaged("a batch with too few buffers"));
                    }
                    let nulls = nodes.get(i).null_count();
                    if nulls != 0 {
                        let message = format!(
                            "batch {}: {nulls} of {rows} values of column `{}` are null",
                            self.batches + 1,
                            field.heading
                        );
                        return Err(self.refused(message, "fill them, or leave such rows out"));
                    }
                    let values = buffers.get(next + 1);
                    let start = usize::try_from(values.offset()).ok();
                    let needed = rows.checked_mul(number.width());
                    let Some(start) = start.filter(|start| {
                        let end = needed.and_then(|needed| start.checked_add(needed));
                        end.is_some_and(|end| end <= body.len())
                    }) else {
                        return Err(self.damaged("a column that reaches beyond its batch"));
                    };
                    columns.push(Some((number, start)));
                    next += 2;
                }
            }
        }
        Ok(Batch { number: self.batches + 1, before: self.rows, rows, body: body.to_vec(), columns })
    }

    fn damaged(&self, what: &str) -> Error {
        let message = format!("no Arrow stream after {} rows in {} batches: {what}", self.rows, self.batches);
        self.refused(message, "")
    }

    fn refused(&self, message: String, help: &str) -> Error {
        refused(&self.path, message, help)
    }
}

/// A problem of a table as a whole, or of a row that the message names.
pub fn refused(path: &Path, message: String, help: &str) -> Error {
    let mut problems = Diagnostics::default();
    let problem = problems.error(Some(Place::in_line(path, 0, "", 0..0)), message);
    if !help.is_empty() {
        problem.help(help);
    }
    Error::Input(Box::new(problems))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::arrow_array::{ArrayRef, Float32Array, Float64Array, Int64Array, RecordBatch, StringArray};
    use ::arrow_ipc::writer::{FileWriter, StreamWriter};

    fn batch(from: i64, rows: i64) -> RecordBatch {
        let numbers = from..from + rows;
        let columns: [(&str, ArrayRef); 4] = [
            ("x", Arc::new(numbers.clone().map(|i| i as f64 / 8.0).collect::<Float64Array>())),
            ("name", Arc::new(numbers.clone().map(|i| Some(i.to_string())).collect::<StringArray>())),
            ("single", Arc::new(numbers.clone().map(|i| i as f32).collect::<Float32Array>())),
            ("pulse", Arc::new(numbers.collect::<Int64Array>())),
        ];
        RecordBatch::try_from_iter(columns).unwrap()
    }

    fn stream(sizes: &[i64]) -> Vec<u8> {
        let mut writer = StreamWriter::try_new(Vec::new(), &batch(0, 0).schema()).unwrap();
        let mut from = 0;
        for size in sizes {
            writer.write(&batch(from, *size)).unwrap();
            from += size;
        }
        writer.into_inner().unwrap()
    }

    fn read(bytes: &[u8], piece: usize) -> Result<Vec<[f64; 4]>, String> {
        let mut decoder = ArrowDecoder::new(Path::new("t"));
        let mut rows = Vec::new();
        let mut take = |decoder: &mut ArrowDecoder| -> Result<()> {
            while let Some(batch) = decoder.next_batch()? {
                assert_eq!(batch.before as usize, rows.len());
                rows.extend((0..batch.rows).map(|row| [0, 1, 2, 3].map(|column| batch.value(column, row))));
            }
            Ok(())
        };
        let done = bytes.chunks(piece).try_for_each(|bytes| {
            decoder.feed(bytes);
            take(&mut decoder)
        });
        match done.and_then(|()| decoder.end()) {
            Err(Error::Input(problems)) => Err(problems.render(false)),
            Err(other) => panic!("{other}"),
            Ok(()) => Ok(rows),
        }
    }

    /// Reads what has another number of columns, too.
    fn read_any(bytes: &[u8]) {
        let mut decoder = ArrowDecoder::new(Path::new("t"));
        for bytes in bytes.chunks(37) {
            decoder.feed(bytes);
            loop {
                match decoder.next_batch() {
                    Ok(Some(batch)) => {
                        let columns = 0..batch.columns.len();
                        columns.for_each(|c| (0..batch.rows.min(100)).for_each(|r| _ = batch.value(c, r)));
                    }
                    Ok(None) => break,
                    Err(_) => return,
                }
            }
        }
        let _ = decoder.end();
    }

    fn assert_counts(rows: &[[f64; 4]], count: usize) {
        assert_eq!(rows.len(), count);
        for (i, row) in rows.iter().enumerate() {
            let i = i as f64;
            assert_eq!((row[0], row[2], row[3]), (i / 8.0, i, i));
            assert!(row[1].is_nan(), "text is no number");
        }
    }

    #[test]
    fn streams_are_read_however_they_are_cut_and_files_like_them() {
        let bytes = stream(&[5, 0, 300, 1]);
        for piece in [1, 7, 64, 1000, bytes.len()] {
            assert_counts(&read(&bytes, piece).unwrap(), 306);
        }
        assert_counts(&read(&bytes[..bytes.len() - 8], 50).unwrap(), 306);
        let mut writer = FileWriter::try_new(Vec::new(), &batch(0, 0).schema()).unwrap();
        writer.write(&batch(0, 70)).unwrap();
        assert_counts(&read(&writer.into_inner().unwrap(), 33).unwrap(), 70);
    }

    #[test]
    fn the_first_bytes_tell() {
        assert_eq!(detect_arrow(&stream(&[])), ArrowDetection::Arrow);
        assert_eq!(detect_arrow(b"ARROW1\0\0...."), ArrowDetection::Arrow);
        assert_eq!(detect_arrow(b"ARROW1"), ArrowDetection::NeedMoreBytes);
        assert_eq!(detect_arrow(&[0xff; 3]), ArrowDetection::NeedMoreBytes);
        assert_eq!(detect_arrow(b""), ArrowDetection::NeedMoreBytes);
        assert_eq!(detect_arrow(b"time,x,y,z"), ArrowDetection::Other);
        assert_eq!(detect_arrow("\u{feff}time".as_bytes()), ArrowDetection::Other);
    }

    #[test]
    fn units_stand_behind_names() {
        let told = std::collections::BTreeMap::from([("unit".to_owned(), "ns".to_owned())]);
        let field =
            ::arrow_schema::Field::new("time", ::arrow_schema::DataType::Int64, false).with_metadata(told);
        let schema = ::arrow_schema::Schema::new(vec![field]);
        let bytes = StreamWriter::try_new(Vec::new(), &schema).unwrap().into_inner().unwrap();
        let mut decoder = ArrowDecoder::new(Path::new("t"));
        decoder.feed(&bytes);
        assert!(decoder.next_batch().unwrap().is_none());
        assert_eq!(decoder.fields().unwrap()[0].heading, "time[ns]");
    }

    #[test]
    fn a_stream_that_is_cut_off_says_where() {
        let bytes = stream(&[10, 20, 30]);
        let cut = read(&bytes[..bytes.len() - 100], 1000).unwrap_err();
        assert!(cut.contains("within batch 3, after 30 whole rows in 2 batches"), "{cut}");
        assert!(read(&bytes[..100], 9).unwrap_err().contains("within batch 1"));
    }

    #[test]
    fn nulls_and_nested_columns_are_refused() {
        let with_null: ArrayRef = Arc::new(Float64Array::from(vec![Some(1.0), None]));
        let table = RecordBatch::try_from_iter([("x", with_null)]).unwrap();
        let mut writer = StreamWriter::try_new(Vec::new(), &table.schema()).unwrap();
        writer.write(&table).unwrap();
        let said = read(&writer.into_inner().unwrap(), 1000).unwrap_err();
        assert!(said.contains("1 of 2 values of column `x` are null"), "{said}");
        let item = ::arrow_schema::Field::new("item", ::arrow_schema::DataType::Float64, false);
        let list = ::arrow_schema::DataType::FixedSizeList(Arc::new(item), 3);
        let schema = ::arrow_schema::Schema::new(vec![::arrow_schema::Field::new("xyz", list, false)]);
        let bytes = StreamWriter::try_new(Vec::new(), &schema).unwrap().into_inner().unwrap();
        assert!(read(&bytes, 1000).unwrap_err().contains("column `xyz` is nested"));
    }

    proptest::proptest! {
        #[test]
        fn damaged_streams_are_read_or_refused(
            at in proptest::collection::vec((0usize..2000, proptest::num::u8::ANY), 1..4), cut in 0usize..2000,
        ) {
            let mut bytes = stream(&[3, 4]);
            for (at, byte) in at {
                let at = at % bytes.len();
                bytes[at] = byte;
            }
            let end = bytes.len() - cut % bytes.len();
            read_any(&bytes[..end]);
        }
    }
}
