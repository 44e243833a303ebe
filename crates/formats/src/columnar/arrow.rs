//! Points as an Arrow IPC stream. Names and types of the columns follow [`Column`]; the metadata of each
//! column holds its unit and meaning, the metadata of the table holds the coordinate reference system, the
//! scanner and the names of objects.

use super::rows::{BATCH_ROWS, Rows};
use super::{Column, TableEncoder};
use crate::encode::{Ending, FileBody, PointEncoder};
use crate::objects::OBJECT_NAMES;
use crate::out::{Offload, OutputStream};
use crate::record::{EncodedPoints, PointBatch};
use crate::settings::{CloudSettings, PARTIAL, SOFTWARE};
use ::arrow_array::RecordBatch;
use ::arrow_ipc::convert::{IpcSchemaEncoder, metadata_to_fb};
use ::arrow_ipc::writer::StreamEncoder;
use ::arrow_ipc::{FieldNode, MessageBuilder, MessageHeader, MetadataVersion, RecordBatchBuilder};
use ::arrow_schema::{ArrowError, Field, Schema, SchemaRef};
use std::collections::BTreeMap;
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};

/// Metadata key of the state of the run, with [`PARTIAL`] as value.
pub(super) const STATE: &str = "state";

/// Metadata key of the coordinate reference system.
pub(super) const CRS: &str = "crs";

/// Name, kind, unit and meaning of a column.
pub type TableColumn = (&'static str, super::ColumnType, &'static str, &'static str);

/// Returns a schema: columns with units and meanings, and the metadata of the table besides the program that
/// writes it.
pub fn schema_of(
    columns: impl Iterator<Item = TableColumn>,
    metadata: BTreeMap<String, String>,
) -> SchemaRef {
    let fields = columns.map(|(name, kind, unit, meaning)| {
        let mut about = BTreeMap::from([("description".to_owned(), meaning.to_owned())]);
        if !unit.is_empty() {
            about.insert("unit".to_owned(), unit.to_owned());
        }
        Field::new(name, kind.data_type(), false).with_metadata(about)
    });
    let mut metadata = metadata;
    metadata.insert("generator".to_owned(), SOFTWARE.to_owned());
    Arc::new(Schema::new_with_metadata(fields.collect::<Vec<_>>(), metadata))
}

/// Returns the schema of points with these columns.
pub fn point_schema(columns: &[Column], settings: &CloudSettings) -> SchemaRef {
    let mut metadata = BTreeMap::from([
        ("scanner".to_owned(), settings.scanner.clone()),
        (
            "gps_time".to_owned(),
            "seconds of the GPS week; beyond 604800 adjusted standard GPS time (GPS seconds less 1e9)"
                .to_owned(),
        ),
    ]);
    if let Some(wkt) = &settings.crs {
        metadata.insert(CRS.to_owned(), wkt.trim_end_matches('\0').to_owned());
    }
    metadata.extend(settings.objects.names_as_json().map(|names| (OBJECT_NAMES.to_owned(), names)));
    schema_of(columns.iter().map(|c| (c.name(), c.kind(), c.unit(), c.meaning())), metadata)
}

/// Points as blocks of columns, for Arrow streams and tables in memory.
#[derive(Debug)]
struct ArrowEncoder {
    table: TableEncoder,
    schema: SchemaRef,
}

/// Arrow IPC streams.
pub(crate) fn arrow(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    let table = TableEncoder::new(settings.table_columns(), settings);
    let schema = point_schema(&table.columns, settings);
    Ok(Arc::new(ArrowEncoder { table, schema }))
}

impl PointEncoder for ArrowEncoder {
    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        self.table.push_block(batch.points, out);
    }

    fn begin(self: Arc<Self>, _: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        let encoder = StreamEncoder::try_new(&self.schema).map_err(failed)?;
        let kinds = self.table.columns.iter().map(|column| column.kind()).collect();
        let schema = self.schema.clone();
        Ok(Box::new(ArrowStream { rows: Rows::new(kinds, BATCH_ROWS), schema, encoder: Some(encoder) }))
    }
}

struct ArrowStream {
    rows: Rows,
    schema: SchemaRef,
    /// `None` after the end of the stream.
    encoder: Option<StreamEncoder>,
}

impl FileBody for ArrowStream {
    fn append(&mut self, blocks: Vec<u8>, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        let ArrowStream { rows, schema, encoder } = self;
        rows.append(&blocks, |rows| encode(encoder, &rows.batch(schema)?, out))
    }

    fn flush(&mut self, out: &mut OutputStream) -> Result<()> {
        if self.rows.is_empty() {
            return Ok(());
        }
        encode(&mut self.encoder, &self.rows.batch(&self.schema)?, out)
    }

    /// Writes the remaining rows and the end of the stream. A partial stream ends with [`partial_marker`].
    fn finish(&mut self, end: &Ending, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        if !self.rows.is_empty() || end.is_partial {
            encode(&mut self.encoder, &self.rows.batch(&self.schema)?, out)?;
        }
        if end.is_partial {
            out.append(&partial_marker(self.schema.fields().len()))?;
        }
        let Some(encoder) = self.encoder.take() else { return Ok(()) };
        let end = encoder.finish().map_err(failed)?;
        end.iter().try_for_each(|buffer| out.append(buffer.as_slice()))
    }
}

fn encode(encoder: &mut Option<StreamEncoder>, batch: &RecordBatch, out: &mut OutputStream) -> Result<()> {
    let Some(encoder) = encoder else { return Ok(()) };
    let buffers = encoder.encode(batch).map_err(failed)?;
    buffers.iter().try_for_each(|buffer| out.append(buffer.as_slice()))
}

fn failed(error: ArrowError) -> Error {
    Error::Internal(format!("Arrow: {error}"))
}

/// Returns an empty batch of `columns` columns whose message metadata has [`PARTIAL`] as state (Arrow
/// columnar format, "Encapsulated message format"). It is assembled here because `arrow-ipc` writes no
/// metadata with a batch, and the metadata of the schema is written before the outcome of the run is known.
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
