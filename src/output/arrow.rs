//! Points as an Arrow IPC stream and as Parquet. Names and types of the columns follow [`Column`]; the metadata of
//! each column holds its unit and meaning, the metadata of the table holds the coordinate reference system, the
//! scanner and the names of objects.
//!
//! Rows are collected into batches of fixed size, so the bytes do not depend on how the rows arrived.

use super::columns::{Column, Kind, slices};
use super::objects::ObjectIds;
use super::summary::PARTIAL;
use crate::error::{Error, Result};
use ::arrow_array::{ArrayRef, PrimitiveArray, RecordBatch, types::*};
use ::arrow_buffer::{Buffer, MutableBuffer, ScalarBuffer};
use ::arrow_ipc::convert::{IpcSchemaEncoder, metadata_to_fb};
use ::arrow_ipc::writer::StreamEncoder;
use ::arrow_ipc::{FieldNode, MessageBuilder, MessageHeader, MetadataVersion, RecordBatchBuilder};
use ::arrow_schema::{DataType, Field, Schema, SchemaRef};
use ::parquet::arrow::ArrowWriter;
use ::parquet::basic::Compression;
use ::parquet::file::metadata::KeyValue;
use ::parquet::file::properties::{EnabledStatistics, WriterProperties};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};

/// Rows per batch of an Arrow stream: a few megabytes.
pub(super) const BATCH_ROWS: usize = 16_384;
/// Rows per row group of Parquet.
const GROUP_ROWS: usize = 16 * BATCH_ROWS;
/// Metadata key of the state of the run, with [`PARTIAL`] as value.
const STATE: &str = "state";

pub(super) struct About<'a> {
    pub scanner: &'a str,
    /// Coordinate reference system as WKT.
    pub crs: Option<&'a str>,
    pub objects: &'a ObjectIds,
}

/// Returns the schema: columns with units and meanings, and the metadata of the table.
pub(super) fn schema(columns: &[Column], about: &About) -> SchemaRef {
    let fields = columns.iter().map(|column| {
        let mut metadata = BTreeMap::from([("description".to_owned(), column.meaning().to_owned())]);
        if !column.unit().is_empty() {
            metadata.insert("unit".to_owned(), column.unit().to_owned());
        }
        Field::new(column.name(), data_type(column.kind()), false).with_metadata(metadata)
    });
    let mut metadata = BTreeMap::from([
        ("generator".to_owned(), concat!("vlscan ", env!("CARGO_PKG_VERSION")).to_owned()),
        ("scanner".to_owned(), about.scanner.to_owned()),
        ("gps_time".to_owned(), "seconds of the GPS week".to_owned()),
    ]);
    if let Some(wkt) = about.crs {
        metadata.insert("crs".to_owned(), wkt.trim_end_matches('\0').to_owned());
    }
    if !about.objects.names.is_empty() {
        let names: BTreeMap<i32, &str> =
            about.objects.names.iter().map(|(number, name)| (*number, name.as_str())).collect();
        // JSON serialisation of a map from integers to strings cannot fail.
        metadata.insert("object_names".to_owned(), serde_json::to_string(&names).unwrap_or_default());
    }
    Arc::new(Schema::new_with_metadata(fields.collect::<Vec<_>>(), metadata))
}

fn data_type(kind: Kind) -> DataType {
    match kind {
        Kind::U8 => DataType::UInt8,
        Kind::U16 => DataType::UInt16,
        Kind::U32 => DataType::UInt32,
        Kind::U64 => DataType::UInt64,
        Kind::I32 => DataType::Int32,
        Kind::F32 => DataType::Float32,
        Kind::F64 => DataType::Float64,
    }
}

struct Rows {
    columns: Vec<Column>,
    schema: SchemaRef,
    values: Vec<MutableBuffer>,
    rows: usize,
}

impl Rows {
    fn new(columns: &[Column], schema: SchemaRef) -> Rows {
        let values = columns.iter().map(|_| MutableBuffer::new(0)).collect();
        Rows { columns: columns.to_vec(), schema, values, rows: 0 }
    }

    /// Appends a block written by [`ColumnCodec::push`](super::column_codec::ColumnCodec::push) and passes every
    /// complete batch to `full`.
    fn append(&mut self, block: &[u8], full: impl FnMut(RecordBatch) -> Result<()>) -> Result<()> {
        let width: usize = self.columns.iter().map(|c| c.kind().width()).sum();
        let (rows, mut full) = (block.len() / width.max(1), full);
        let mut from = 0;
        while from < rows {
            let now = (rows - from).min(BATCH_ROWS - self.rows);
            for ((column, values), bytes) in
                self.columns.iter().zip(&mut self.values).zip(slices(&self.columns, rows, block))
            {
                let width = column.kind().width();
                values.extend_from_slice(&bytes[from * width..(from + now) * width]);
            }
            (from, self.rows) = (from + now, self.rows + now);
            if self.rows == BATCH_ROWS {
                full(self.batch()?)?;
            }
        }
        Ok(())
    }

    /// Returns the collected rows as a batch, and clears them.
    fn batch(&mut self) -> Result<RecordBatch> {
        let rows = std::mem::take(&mut self.rows);
        let columns = self.columns.iter().zip(&mut self.values).map(|(column, values)| {
            array(column.kind(), std::mem::replace(values, MutableBuffer::new(0)).into(), rows)
        });
        RecordBatch::try_new(self.schema.clone(), columns.collect())
            .map_err(|e| Error::Internal(format!("Arrow: {e}")))
    }
}

fn array(kind: Kind, values: Buffer, rows: usize) -> ArrayRef {
    fn typed<T: ArrowPrimitiveType>(values: Buffer, rows: usize) -> ArrayRef {
        Arc::new(PrimitiveArray::<T>::new(ScalarBuffer::new(values, 0, rows), None))
    }
    match kind {
        Kind::U8 => typed::<UInt8Type>(values, rows),
        Kind::U16 => typed::<UInt16Type>(values, rows),
        Kind::U32 => typed::<UInt32Type>(values, rows),
        Kind::U64 => typed::<UInt64Type>(values, rows),
        Kind::I32 => typed::<Int32Type>(values, rows),
        Kind::F32 => typed::<Float32Type>(values, rows),
        Kind::F64 => typed::<Float64Type>(values, rows),
    }
}

pub(super) struct ArrowStream {
    rows: Rows,
    encoder: StreamEncoder,
}

impl ArrowStream {
    pub fn new(columns: &[Column], schema: SchemaRef) -> Result<ArrowStream> {
        let encoder = StreamEncoder::try_new(&schema).map_err(|e| Error::Internal(format!("Arrow: {e}")))?;
        Ok(ArrowStream { rows: Rows::new(columns, schema), encoder })
    }

    /// Appends a block of columns and writes every complete batch.
    pub fn append(&mut self, block: &[u8], mut out: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let ArrowStream { rows, encoder } = self;
        rows.append(block, |batch| encode(encoder, &batch, &mut out))
    }

    /// Writes the rows of an incomplete batch.
    pub fn flush(&mut self, mut out: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        if self.rows.rows == 0 {
            return Ok(());
        }
        let batch = self.rows.batch()?;
        encode(&mut self.encoder, &batch, &mut out)
    }

    /// Writes the remaining rows and the end of the stream. A partial stream ends with [`partial_marker`].
    pub fn finish(mut self, partial: bool, mut out: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        if self.rows.rows > 0 || partial {
            let batch = self.rows.batch()?;
            encode(&mut self.encoder, &batch, &mut out)?;
        }
        if partial {
            out(&partial_marker(self.rows.columns.len()))?;
        }
        let end = self.encoder.finish().map_err(|e| Error::Internal(format!("Arrow: {e}")))?;
        end.iter().try_for_each(|buffer| out(buffer.as_slice()))
    }
}

fn encode(
    encoder: &mut StreamEncoder,
    batch: &RecordBatch,
    out: &mut impl FnMut(&[u8]) -> Result<()>,
) -> Result<()> {
    let buffers = encoder.encode(batch).map_err(|e| Error::Internal(format!("Arrow: {e}")))?;
    buffers.iter().try_for_each(|buffer| out(buffer.as_slice()))
}

/// Returns an empty batch of `columns` columns whose message metadata has [`PARTIAL`] as state (Arrow columnar
/// format, "Encapsulated message format"). It is assembled here because `arrow-ipc` writes no metadata with a batch,
/// and the metadata of the schema is written before the outcome of the run is known.
fn partial_marker(columns: usize) -> Vec<u8> {
    let mut builder = IpcSchemaEncoder::new().schema_to_fb(&Schema::empty());
    builder.reset();
    let state = BTreeMap::from([(STATE.to_owned(), PARTIAL.to_owned())]).into();
    let metadata = metadata_to_fb(&mut builder, &state);
    let nodes = builder.create_vector(&vec![FieldNode::new(0, 0); columns]);
    // Validity and values of each column, all empty.
    let buffers = builder.create_vector(&vec![::arrow_ipc::Buffer::new(0, 0); 2 * columns]);
    let mut batch = RecordBatchBuilder::new(&mut builder);
    batch.add_length(0);
    batch.add_nodes(nodes);
    batch.add_buffers(buffers);
    let batch = batch.finish().as_union_value();
    let mut message = MessageBuilder::new(&mut builder);
    message.add_version(MetadataVersion::V5);
    message.add_header_type(MessageHeader::RecordBatch);
    message.add_header(batch);
    message.add_bodyLength(0);
    message.add_custom_metadata(metadata);
    let message = message.finish();
    builder.finish(message, None);
    let message = builder.finished_data();
    let padded = message.len().next_multiple_of(8);
    let mut out = vec![0xff; 4];
    out.extend((padded as u32).to_le_bytes());
    out.extend_from_slice(message);
    out.resize(8 + padded, 0);
    out
}

pub(super) struct ParquetStream {
    rows: Rows,
    writer: ArrowWriter<SharedBuffer>,
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
    pub fn new(columns: &[Column], schema: SchemaRef) -> Result<ParquetStream> {
        let mut properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_created_by(concat!("vlscan ", env!("CARGO_PKG_VERSION")).to_owned())
            .set_max_row_group_row_count(Some(GROUP_ROWS))
            .set_statistics_enabled(EnabledStatistics::Chunk);
        // Dictionary encoding pays only where values repeat.
        for column in columns.iter().filter(|c| matches!(c.kind(), Kind::F32 | Kind::F64 | Kind::U64)) {
            properties = properties.set_column_dictionary_enabled(column.name().into(), false);
        }
        let buffer = SharedBuffer::default();
        let writer = ArrowWriter::try_new(buffer.clone(), schema.clone(), Some(properties.build()));
        let writer = writer.map_err(|e| Error::Internal(format!("Parquet: {e}")))?;
        Ok(ParquetStream { rows: Rows::new(columns, schema), writer, buffer })
    }

    /// Appends a block of columns and writes every complete row group.
    pub fn append(&mut self, block: &[u8], mut out: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let ParquetStream { rows, writer, buffer } = self;
        rows.append(block, |batch| {
            writer.write(&batch).map_err(|e| Error::Internal(format!("Parquet: {e}")))?;
            out(&buffer.take())
        })
    }

    /// Writes the remaining rows and the footer, whose metadata records whether the file is partial.
    pub fn finish(mut self, partial: bool, mut out: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let last = self.rows.batch()?;
        if last.num_rows() > 0 {
            self.writer.write(&last).map_err(|e| Error::Internal(format!("Parquet: {e}")))?;
        }
        if partial {
            self.writer.append_key_value_metadata(KeyValue::new(STATE.to_owned(), PARTIAL.to_owned()));
        }
        self.writer.close().map_err(|e| Error::Internal(format!("Parquet: {e}")))?;
        out(&self.buffer.take())
    }
}
