//! Points as Parquet, with the columns of the [Arrow stream](mod@super::arrow). The schema of that stream is
//! in the metadata of the file, from which readers of Arrow take types, descriptions and the metadata of the
//! table.

use super::arrow::{CRS, STATE, point_schema};
use super::rows::{BATCH_ROWS, Rows};
use super::{Column, ColumnType, TableEncoder};
use crate::encode::{Ending, FileBody, PointEncoder};
use crate::out::{Offload, OutputStream};
use crate::record::{EncodedPoints, PointBatch};
use crate::settings::{CloudSettings, PARTIAL, SOFTWARE};
use ::arrow_buffer::MutableBuffer;
use ::arrow_ipc::writer::{DictionaryTracker, IpcDataGenerator, IpcWriteOptions};
use ::arrow_schema::{Schema, SchemaRef};
use ::parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use ::parquet::data_type::{DataType, DoubleType, FloatType, Int32Type, Int64Type};
use ::parquet::errors::ParquetError;
use ::parquet::file::metadata::KeyValue;
use ::parquet::file::properties::{EnabledStatistics, WriterProperties};
use ::parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter, SerializedRowGroupWriter};
use ::parquet::schema::types::Type;
use base64::prelude::{BASE64_STANDARD, Engine};
use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};

/// Rows per row group.
pub(super) const GROUP_ROWS: usize = 16 * BATCH_ROWS;
/// Metadata key of the schema of the same table in Arrow, an encapsulated message in base 64 (Arrow C++ and
/// all readers that follow it).
pub(crate) const ARROW_SCHEMA: &str = "ARROW:schema";

/// Points as blocks of columns for Parquet.
#[derive(Debug)]
struct ParquetEncoder {
    table: TableEncoder,
    schema: SchemaRef,
}

/// Parquet files.
pub(crate) fn parquet(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    let table = TableEncoder::new(settings.table_columns(), settings);
    let schema = point_schema(&table.columns, settings);
    Ok(Arc::new(ParquetEncoder { table, schema }))
}

impl PointEncoder for ParquetEncoder {
    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        self.table.push_block(batch.points, out);
    }

    fn begin(self: Arc<Self>, _: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        let columns = &self.table.columns;
        let rows = Rows::new(columns.iter().map(|column| column.kind()).collect(), GROUP_ROWS);
        let fields = columns.iter().map(|column| field(*column)).collect::<Result<_>>()?;
        Ok(Box::new(ParquetBody { rows, file: ParquetFile::begin(fields, metadata(&self.schema), &[])? }))
    }
}

/// A file of the columns alone.
struct ParquetBody {
    rows: Rows,
    file: ParquetFile,
}

impl FileBody for ParquetBody {
    fn append(&mut self, blocks: Vec<u8>, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        let ParquetBody { rows, file } = self;
        rows.append(&blocks, |rows| file.write_group(rows, write_columns, out))
    }

    fn finish(&mut self, end: &Ending, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        if !self.rows.is_empty() {
            self.file.write_group(&mut self.rows, write_columns, out)?;
        }
        self.file.finish(end.is_partial, Vec::new(), out)
    }
}

/// A Parquet file that is being written.
pub(super) struct ParquetFile {
    /// `None` after the footer.
    writer: Option<SerializedFileWriter<SharedBuffer>>,
    buffer: SharedBuffer,
}

/// Bytes produced by the Parquet writer and not yet passed to the file.
#[derive(Clone, Default)]
pub(super) struct SharedBuffer(Arc<Mutex<Vec<u8>>>);

impl SharedBuffer {
    fn take(&self) -> Vec<u8> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for SharedBuffer {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A row group that is being written.
pub(super) type Group<'a> = SerializedRowGroupWriter<'a, SharedBuffer>;
pub(super) type Written = std::result::Result<(), ParquetError>;

impl ParquetFile {
    /// Begins a file with these columns and metadata; values of the columns `unique` do not repeat.
    pub fn begin(fields: Vec<Arc<Type>>, metadata: Vec<KeyValue>, unique: &[&str]) -> Result<ParquetFile> {
        let mut properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_created_by(SOFTWARE.to_owned())
            .set_key_value_metadata(Some(metadata))
            .set_statistics_enabled(EnabledStatistics::Chunk);
        // Dictionary encoding pays only where values repeat.
        let are_unique =
            |column: &&Column| matches!(column.kind(), ColumnType::F32 | ColumnType::F64 | ColumnType::U64);
        let plain = Column::ALL.iter().filter(are_unique).map(|column| column.name());
        for name in plain.chain(unique.iter().copied()) {
            let path: Vec<String> = name.split('.').map(str::to_owned).collect();
            properties = properties.set_column_dictionary_enabled(path.into(), false);
        }
        let buffer = SharedBuffer::default();
        let root = Type::group_type_builder("arrow_schema").with_fields(fields).build().map_err(failed)?;
        let writer = SerializedFileWriter::new(buffer.clone(), Arc::new(root), Arc::new(properties.build()));
        Ok(ParquetFile { writer: Some(writer.map_err(failed)?), buffer })
    }

    /// Writes the collected rows, whose columns `write` gets, as a row group.
    pub fn write_group(
        &mut self,
        rows: &mut Rows,
        write: impl FnOnce(&mut Group, &[(ColumnType, MutableBuffer)]) -> Written,
        out: &mut OutputStream,
    ) -> Result<()> {
        let columns: Vec<(ColumnType, MutableBuffer)> = rows.take().collect();
        if let Some(writer) = &mut self.writer {
            let mut group = writer.next_row_group().map_err(failed)?;
            write(&mut group, &columns).and_then(|()| group.close().map(drop)).map_err(failed)?;
        }
        out.append(&self.buffer.take())
    }

    /// Writes the footer with `metadata`, which also records whether the file is partial.
    pub fn finish(
        &mut self,
        is_partial: bool,
        metadata: Vec<KeyValue>,
        out: &mut OutputStream,
    ) -> Result<()> {
        let Some(mut writer) = self.writer.take() else { return Ok(()) };
        metadata.into_iter().for_each(|pair| writer.append_key_value_metadata(pair));
        if is_partial {
            writer.append_key_value_metadata(KeyValue::new(STATE.to_owned(), PARTIAL.to_owned()));
        }
        writer.close().map_err(failed)?;
        out.append(&self.buffer.take())
    }
}

pub(super) fn failed(error: ParquetError) -> Error {
    Error::Internal(format!("Parquet: {error}"))
}

/// The metadata of a file with this schema.
pub(super) fn metadata(schema: &Schema) -> Vec<KeyValue> {
    let mut metadata = vec![KeyValue::new(ARROW_SCHEMA.to_owned(), encoded_schema(schema))];
    // Readers without Arrow do not decode the schema.
    let crs = schema.metadata().get(CRS);
    metadata.extend(crs.map(|wkt| KeyValue::new(CRS.to_owned(), wkt.clone())));
    metadata
}

/// The schema as readers of Arrow expect it: continuation marker, length, message (Arrow columnar format,
/// "Encapsulated message format"), without padding as Arrow C++ has it.
fn encoded_schema(schema: &Schema) -> String {
    let mut dictionaries = DictionaryTracker::new(true);
    let message = IpcDataGenerator::default()
        .schema_to_bytes_with_dictionary_tracker(schema, &mut dictionaries, &IpcWriteOptions::default())
        .ipc_message;
    let mut bytes = vec![0xff; 4];
    bytes.extend((message.len() as u32).to_le_bytes());
    bytes.extend(message);
    BASE64_STANDARD.encode(&bytes)
}

/// The description of a column. Integers of fewer than 32 bits are stored in 32 (Parquet, "Logical types").
pub(super) fn field(column: Column) -> Result<Arc<Type>> {
    let (physical, bits) = match column.kind() {
        ColumnType::U8 => (Physical::INT32, Some(8)),
        ColumnType::U16 => (Physical::INT32, Some(16)),
        ColumnType::U32 => (Physical::INT32, Some(32)),
        ColumnType::U64 => (Physical::INT64, Some(64)),
        ColumnType::I32 => (Physical::INT32, None),
        ColumnType::F32 => (Physical::FLOAT, None),
        ColumnType::F64 => (Physical::DOUBLE, None),
    };
    Type::primitive_type_builder(column.name(), physical)
        .with_repetition(Repetition::REQUIRED)
        .with_logical_type(bits.map(|bits| LogicalType::integer(bits, false)))
        .build()
        .map(Arc::new)
        .map_err(failed)
}

/// Writes the next columns of a row group.
pub(super) fn write_columns(group: &mut Group, columns: &[(ColumnType, MutableBuffer)]) -> Written {
    for (kind, values) in columns {
        with_column(group, |out| write_column(out, *kind, values))?;
    }
    Ok(())
}

/// Writes the next column of a row group.
pub(super) fn with_column(
    group: &mut Group,
    write: impl FnOnce(&mut SerializedColumnWriter) -> Written,
) -> Written {
    let mut column = group.next_column()?.ok_or_else(|| ParquetError::General("a column too many".into()))?;
    write(&mut column)?;
    column.close()
}

fn write_column(out: &mut SerializedColumnWriter, kind: ColumnType, values: &MutableBuffer) -> Written {
    let widened = |values: Vec<i32>, out: &mut SerializedColumnWriter| write::<Int32Type>(out, &values);
    match kind {
        ColumnType::U8 => widened(values.typed_data::<u8>().iter().map(|&v| v.into()).collect(), out),
        ColumnType::U16 => widened(values.typed_data::<u16>().iter().map(|&v| v.into()).collect(), out),
        // Unsigned integers of 32 and 64 bits are stored as the signed ones of the same bits.
        ColumnType::U32 | ColumnType::I32 => write::<Int32Type>(out, values.typed_data()),
        ColumnType::U64 => write::<Int64Type>(out, values.typed_data()),
        ColumnType::F32 => write::<FloatType>(out, values.typed_data()),
        ColumnType::F64 => write::<DoubleType>(out, values.typed_data()),
    }
}

/// Writes values of one physical type.
pub(super) fn write<T: DataType>(out: &mut SerializedColumnWriter, values: &[T::T]) -> Written {
    out.typed::<T>().write_batch(values, None, None).map(|_| ())
}
