//! Points as Parquet, with the columns of the [Arrow stream](super::arrow). The schema of that stream is in the metadata of
//! the file, from which readers of Arrow take types, descriptions and the metadata of the table.

use super::arrow::{CRS, STATE};
use super::columns::{Column, Kind};
use super::rows::{BATCH_ROWS, Rows};
use super::summary::PARTIAL;
use ::arrow_buffer::MutableBuffer;
use ::arrow_ipc::writer::{DictionaryTracker, IpcDataGenerator, IpcWriteOptions};
use ::arrow_schema::{Schema, SchemaRef};
use ::parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use ::parquet::data_type::{DataType, DoubleType, FloatType, Int32Type, Int64Type};
use ::parquet::errors::ParquetError;
use ::parquet::file::metadata::KeyValue;
use ::parquet::file::properties::{EnabledStatistics, WriterProperties};
use ::parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use ::parquet::schema::types::Type;
use base64::prelude::{BASE64_STANDARD, Engine};
use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};
use vlscan_base::error::{Error, Result};

/// Rows per row group.
const GROUP_ROWS: usize = 16 * BATCH_ROWS;
/// Metadata key of the schema of the same table in Arrow, an encapsulated message in base 64 (Arrow C++ and all readers
/// that follow it).
const ARROW_SCHEMA: &str = "ARROW:schema";

pub(super) struct ParquetStream {
    rows: Rows,
    writer: SerializedFileWriter<SharedBuffer>,
    buffer: SharedBuffer,
}

/// Bytes produced by the Parquet writer and not yet passed to the file.
#[derive(Clone, Default)]
struct SharedBuffer(Arc<Mutex<Vec<u8>>>);

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

impl ParquetStream {
    pub fn new(columns: &[Column], schema: &SchemaRef) -> Result<ParquetStream> {
        let mut metadata = vec![KeyValue::new(ARROW_SCHEMA.to_owned(), encoded_schema(schema))];
        // Readers without Arrow do not decode the schema.
        let crs = schema.metadata().get(CRS);
        metadata.extend(crs.map(|wkt| KeyValue::new(CRS.to_owned(), wkt.clone())));
        let mut properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_created_by(concat!("vlscan ", env!("CARGO_PKG_VERSION")).to_owned())
            .set_key_value_metadata(Some(metadata))
            .set_statistics_enabled(EnabledStatistics::Chunk);
        // Dictionary encoding pays only where values repeat.
        for column in columns.iter().filter(|c| matches!(c.kind(), Kind::F32 | Kind::F64 | Kind::U64)) {
            properties = properties.set_column_dictionary_enabled(column.name().into(), false);
        }
        let buffer = SharedBuffer::default();
        let fields = columns.iter().map(|column| Ok(Arc::new(field(*column)?))).collect::<Result<_>>()?;
        let root = Type::group_type_builder("arrow_schema").with_fields(fields).build().map_err(failed)?;
        let writer = SerializedFileWriter::new(buffer.clone(), Arc::new(root), Arc::new(properties.build()));
        Ok(ParquetStream {
            rows: Rows::new(columns.iter().map(|column| column.kind()).collect(), GROUP_ROWS),
            writer: writer.map_err(failed)?,
            buffer,
        })
    }

    /// Appends a block of columns and writes every complete row group.
    pub fn append(&mut self, block: &[u8], mut out: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let ParquetStream { rows, writer, buffer } = self;
        rows.append(block, |rows| {
            write_group(writer, rows).map_err(failed)?;
            out(&buffer.take())
        })
    }

    /// Writes the remaining rows and the footer, whose metadata records whether the file is partial.
    pub fn finish(mut self, partial: bool, mut out: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        if self.rows.len() > 0 {
            write_group(&mut self.writer, &mut self.rows).map_err(failed)?;
        }
        if partial {
            self.writer.append_key_value_metadata(KeyValue::new(STATE.to_owned(), PARTIAL.to_owned()));
        }
        self.writer.close().map_err(failed)?;
        out(&self.buffer.take())
    }
}

fn failed(error: ParquetError) -> Error {
    Error::Internal(format!("Parquet: {error}"))
}

/// The schema as readers of Arrow expect it: continuation marker, length, message (Arrow columnar format, "Encapsulated
/// message format"), without padding as Arrow C++ has it.
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
fn field(column: Column) -> Result<Type> {
    let (physical, bits) = match column.kind() {
        Kind::U8 => (Physical::INT32, Some(8)),
        Kind::U16 => (Physical::INT32, Some(16)),
        Kind::U32 => (Physical::INT32, Some(32)),
        Kind::U64 => (Physical::INT64, Some(64)),
        Kind::I32 => (Physical::INT32, None),
        Kind::F32 => (Physical::FLOAT, None),
        Kind::F64 => (Physical::DOUBLE, None),
    };
    Type::primitive_type_builder(column.name(), physical)
        .with_repetition(Repetition::REQUIRED)
        .with_logical_type(bits.map(|bits| LogicalType::integer(bits, false)))
        .build()
        .map_err(failed)
}

fn write_group(
    writer: &mut SerializedFileWriter<SharedBuffer>,
    rows: &mut Rows,
) -> std::result::Result<(), ParquetError> {
    let mut group = writer.next_row_group()?;
    for (kind, values) in rows.take() {
        let mut out =
            group.next_column()?.ok_or_else(|| ParquetError::General("a column too many".into()))?;
        write_column(&mut out, kind, &values)?;
        out.close()?;
    }
    group.close().map(|_| ())
}

fn write_column(
    out: &mut SerializedColumnWriter,
    kind: Kind,
    values: &MutableBuffer,
) -> std::result::Result<(), ParquetError> {
    fn write<T: DataType>(
        out: &mut SerializedColumnWriter,
        values: &[T::T],
    ) -> std::result::Result<(), ParquetError> {
        out.typed::<T>().write_batch(values, None, None).map(|_| ())
    }
    let widened = |values: Vec<i32>, out: &mut SerializedColumnWriter| write::<Int32Type>(out, &values);
    match kind {
        Kind::U8 => widened(values.typed_data::<u8>().iter().map(|&v| v.into()).collect(), out),
        Kind::U16 => widened(values.typed_data::<u16>().iter().map(|&v| v.into()).collect(), out),
        // Unsigned integers of 32 and 64 bits are stored as the signed ones of the same bits.
        Kind::U32 | Kind::I32 => write::<Int32Type>(out, values.typed_data()),
        Kind::U64 => write::<Int64Type>(out, values.typed_data()),
        Kind::F32 => write::<FloatType>(out, values.typed_data()),
        Kind::F64 => write::<DoubleType>(out, values.typed_data()),
    }
}
