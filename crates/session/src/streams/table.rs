//! Writes pulses and poses as an Arrow IPC stream. Columns and values are the same as in text; the metadata
//! of each column contains its unit.

use super::columns::{ENTRIES, PulseColumn};
use super::row::{ColumnSet, PulseRow};
use ::arrow_array::{ArrayRef, Float64Array, RecordBatch, UInt64Array};
use ::arrow_ipc::writer::StreamEncoder;
use ::arrow_schema::{DataType, Field, Schema, SchemaRef};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::Arc;
use vlscan_geom::{DVec3, degrees};
use vlscan_lidar::flight::PoseSample;
use vlscan_tables::Dimension;

/// Rows of a batch, independent of the chunks so that the bytes are, too.
const BATCH_ROWS: usize = 16_384;
const VALUE_BYTES: usize = size_of::<f64>();

/// A column of an Arrow stream of poses or pulses.
#[derive(Clone, Debug)]
pub struct TableColumn {
    name: &'static str,
    unit: &'static str,
    is_count: bool,
}

/// The columns of a stream of poses, in the order of [`push_pose_row`].
pub fn pose_columns() -> Vec<TableColumn> {
    let units = [
        ("time", "s"),
        ("x", "m"),
        ("y", "m"),
        ("z", "m"),
        ("roll", "deg"),
        ("pitch", "deg"),
        ("yaw", "deg"),
    ];
    units.map(|(name, unit)| TableColumn { name, unit, is_count: false }).to_vec()
}

/// The columns of a stream of pulses, in the order of [`push_pulse_row`].
pub fn pulse_columns(present: ColumnSet) -> Vec<TableColumn> {
    let entries = ENTRIES.iter().filter(|e| present.has(e.column));
    let column = entries.map(|e| TableColumn {
        name: e.name(),
        unit: e.unit(),
        is_count: e.dimension() == Dimension::Count,
    });
    column.collect()
}

/// Time (s), position (m) and roll, pitch, heading (degrees) of a pose in the convention of
/// [`vlscan_geom::Rotation::of_heading`]. Times count from `time_origin` s.
pub fn pose_values(pose: &PoseSample, (shift, time_origin): (DVec3, f64)) -> [f64; 7] {
    let position = pose.position + shift;
    let angles = pose.attitude.heading_angles().map(degrees);
    // Adding 0 removes negative zeros.
    [time_origin + pose.time_ns / 1e9, position.x, position.y, position.z, angles[0], angles[1], angles[2]]
        .map(|v| v + 0.0)
}

/// Appends a pose as a row for [`TableWriter`].
pub fn push_pose_row(out: &mut Vec<u8>, pose: &PoseSample, frame: (DVec3, f64)) {
    pose_values(pose, frame).iter().for_each(|value| out.extend(value.to_le_bytes()));
}

/// Appends a pulse as a row for [`TableWriter`].
pub fn push_pulse_row(out: &mut Vec<u8>, row: &PulseRow, present: ColumnSet, shift: DVec3) {
    let values = row.values(shift);
    let present = ENTRIES.iter().map(|e| e.column).filter(|c: &PulseColumn| present.has(*c));
    present.for_each(|column| out.extend(values[column as usize].to_le_bytes()));
}

/// Writes rows of values (`f64`, little-endian, consecutive) as an Arrow IPC stream.
pub struct TableWriter<W> {
    out: W,
    encoder: StreamEncoder,
    schema: SchemaRef,
    columns: Vec<TableColumn>,
    /// Values of rows that do not fill a batch yet.
    pending: Vec<u8>,
    /// True if a flush writes incomplete batches.
    live: bool,
}

impl<W: Write> TableWriter<W> {
    /// Writes the schema and returns the writer.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn begin(columns: Vec<TableColumn>, live: bool, mut out: W) -> io::Result<TableWriter<W>> {
        let fields = columns.iter().map(|column| {
            let kind = if column.is_count { DataType::UInt64 } else { DataType::Float64 };
            let unit = (!column.unit.is_empty()).then(|| ("unit".to_owned(), column.unit.to_owned()));
            Field::new(column.name, kind, false).with_metadata(unit.into_iter().collect::<BTreeMap<_, _>>())
        });
        let generator = ("generator".to_owned(), concat!("vlscan ", env!("CARGO_PKG_VERSION")).to_owned());
        let schema = Schema::new_with_metadata(fields.collect::<Vec<_>>(), BTreeMap::from([generator]));
        let schema = Arc::new(schema);
        let mut encoder = StreamEncoder::try_new(&schema).map_err(io::Error::other)?;
        // An empty batch flushes the schema, so that readers see the columns at once.
        let none = RecordBatch::new_empty(schema.clone());
        write(&mut encoder, &none, &mut out)?;
        Ok(TableWriter { out, encoder, schema, columns, pending: Vec::new(), live })
    }

    /// Writes the remaining rows and the end of the stream, and returns `out`.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn finish(mut self) -> io::Result<W> {
        self.write_batch(self.pending_rows())?;
        for buffer in self.encoder.finish().map_err(io::Error::other)? {
            self.out.write_all(buffer.as_slice())?;
        }
        self.out.flush()?;
        Ok(self.out)
    }

    fn pending_rows(&self) -> usize {
        self.pending.len() / (self.columns.len() * VALUE_BYTES).max(1)
    }

    /// Writes the first `rows` pending rows.
    fn write_batch(&mut self, rows: usize) -> io::Result<()> {
        if rows == 0 {
            return Ok(());
        }
        let width = self.columns.len();
        let bytes: Vec<u8> = self.pending.drain(..rows * width * VALUE_BYTES).collect();
        let values: Vec<f64> = bytes.chunks_exact(VALUE_BYTES).map(number).collect();
        let columns = self.columns.iter().enumerate().map(|(i, column)| -> ArrayRef {
            let values = values.iter().skip(i).step_by(width).copied();
            match column.is_count {
                true => Arc::new(UInt64Array::from_iter_values(values.map(|v| v as u64))),
                false => Arc::new(Float64Array::from_iter_values(values)),
            }
        });
        let batch = RecordBatch::try_new(self.schema.clone(), columns.collect()).map_err(io::Error::other)?;
        write(&mut self.encoder, &batch, &mut self.out)
    }
}

fn number(bytes: &[u8]) -> f64 {
    let mut value = [0; VALUE_BYTES];
    value.copy_from_slice(bytes);
    f64::from_le_bytes(value)
}

fn write(encoder: &mut StreamEncoder, batch: &RecordBatch, out: &mut impl Write) -> io::Result<()> {
    let buffers = encoder.encode(batch).map_err(io::Error::other)?;
    buffers.iter().try_for_each(|buffer| out.write_all(buffer.as_slice()))
}

impl<W: Write> Write for TableWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.pending.extend_from_slice(bytes);
        while self.pending_rows() >= BATCH_ROWS {
            self.write_batch(BATCH_ROWS)?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.live {
            self.write_batch(self.pending_rows())?;
        }
        self.out.flush()
    }
}
