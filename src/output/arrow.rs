//! Points as an Arrow IPC stream. Names and types of the columns follow [`Column`]; the metadata of each column holds its
//! unit and meaning, the metadata of the table holds the coordinate reference system, the scanner and the names of
//! objects.

use super::columns::{Column, Kind};
use super::objects::ObjectIds;
use super::rows::{BATCH_ROWS, Rows};
use super::summary::PARTIAL;
use ::arrow_array::{ArrayRef, PrimitiveArray, RecordBatch, types::*};
use ::arrow_buffer::{Buffer, ScalarBuffer};
use ::arrow_ipc::convert::{IpcSchemaEncoder, metadata_to_fb};
use ::arrow_ipc::writer::StreamEncoder;
use ::arrow_ipc::{FieldNode, MessageBuilder, MessageHeader, MetadataVersion, RecordBatchBuilder};
use ::arrow_schema::{DataType, Field, Schema, SchemaRef};
use std::collections::BTreeMap;
use std::sync::Arc;
use vlscan_base::error::{Error, Result};

/// Metadata key of the state of the run, with [`PARTIAL`] as value.
pub(super) const STATE: &str = "state";

/// Metadata key of the coordinate reference system.
pub(super) const CRS: &str = "crs";

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
        metadata.insert(CRS.to_owned(), wkt.trim_end_matches('\0').to_owned());
    }
    if !about.objects.names.is_empty() {
        let names: BTreeMap<i32, &str> =
            about.objects.names.iter().map(|(number, name)| (*number, name.as_str())).collect();
        // JSON serialisation of a map from integers to strings cannot fail.
        metadata.insert("object_names".to_owned(), serde_json::to_string(&names).unwrap_or_default());
    }
    Arc::new(Schema::new_with_metadata(fields.collect::<Vec<_>>(), metadata))
}

/// The Arrow type of a kind of values.
pub(super) fn data_type(kind: Kind) -> DataType {
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

/// Returns the collected rows as a batch.
pub(super) fn batch(rows: &mut Rows, schema: &SchemaRef) -> Result<RecordBatch> {
    let count = rows.len();
    let columns = rows.take().map(|(kind, values)| array(kind, values.into(), count));
    RecordBatch::try_new(schema.clone(), columns.collect())
        .map_err(|e| Error::Internal(format!("Arrow: {e}")))
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
    schema: SchemaRef,
    encoder: StreamEncoder,
}

impl ArrowStream {
    pub fn new(columns: &[Column], schema: SchemaRef) -> Result<ArrowStream> {
        let encoder = StreamEncoder::try_new(&schema).map_err(|e| Error::Internal(format!("Arrow: {e}")))?;
        let kinds = columns.iter().map(|column| column.kind()).collect();
        Ok(ArrowStream { rows: Rows::new(kinds, BATCH_ROWS), schema, encoder })
    }

    /// Appends a block of columns and writes every complete batch.
    pub fn append(&mut self, block: &[u8], mut out: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let ArrowStream { rows, schema, encoder } = self;
        rows.append(block, |rows| encode(encoder, &batch(rows, schema)?, &mut out))
    }

    /// Writes the rows of an incomplete batch.
    pub fn flush(&mut self, mut out: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        if self.rows.len() == 0 {
            return Ok(());
        }
        let batch = batch(&mut self.rows, &self.schema)?;
        encode(&mut self.encoder, &batch, &mut out)
    }

    /// Writes the remaining rows and the end of the stream. A partial stream ends with [`partial_marker`].
    pub fn finish(mut self, partial: bool, mut out: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        if self.rows.len() > 0 || partial {
            let batch = batch(&mut self.rows, &self.schema)?;
            encode(&mut self.encoder, &batch, &mut out)?;
        }
        if partial {
            out(&partial_marker(self.schema.fields().len()))?;
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
