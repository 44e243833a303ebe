//! Tables in memory: points, poses, pulses and waveforms as Arrow record batches for the caller of a run.

use super::layout::Content;
use super::piece::{OpenOutput, Piece, samples_of};
use super::plan::{OutputPlan, WorldFrame};
use super::request::{TableContent, TableRequest, TableSink};
use super::summary::{FileKind, FileSummary};
use ::arrow_array::{Array, Float64Array, LargeListArray, RecordBatch};
use ::arrow_buffer::{OffsetBuffer, ScalarBuffer};
use ::arrow_schema::{DataType, Field, Schema, SchemaRef};
use std::collections::BTreeMap;
use std::sync::Arc;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::FileGroup;
use vlscan_formats::{
    CloudSettings, Column, ColumnType, EncodedPoints, Offload, Rows, TableColumn, Tally, point_schema,
    schema_of,
};
use vlscan_geom::degrees;
use vlscan_lidar::flight::PoseSample;
use vlscan_lidar::pulse::{Batch, PulseRecord, WaveformRecord};

/// A column of records `T`: name, unit, meaning and the value of a record in the world.
struct RecordColumn<T: 'static>(&'static str, &'static str, &'static str, Value<T>);

/// The value of a record as its column stores it.
enum Value<T> {
    F64(fn(&T, WorldFrame) -> f64),
    U64(fn(&T) -> u64),
    U32(fn(&T) -> u32),
}

use Value::{F64, U32, U64};

impl<T> RecordColumn<T> {
    fn about(&self) -> TableColumn {
        let RecordColumn(name, unit, meaning, value) = self;
        let kind = match value {
            F64(_) => ColumnType::F64,
            U64(_) => ColumnType::U64,
            U32(_) => ColumnType::U32,
        };
        (name, kind, unit, meaning)
    }

    /// Appends the values of all records, little-endian.
    fn push(&self, records: &[T], frame: WorldFrame, out: &mut Vec<u8>) {
        match self.3 {
            F64(value) => records.iter().for_each(|r| out.extend(value(r, frame).to_le_bytes())),
            U64(value) => records.iter().for_each(|r| out.extend(value(r).to_le_bytes())),
            U32(value) => records.iter().for_each(|r| out.extend(value(r).to_le_bytes())),
        }
    }
}

/// Position of the platform, attitude as `--trajectory` reads it, and as HELIOS++ writes it. Adding 0 removes
/// negative zeros.
const TRAJECTORY: &[RecordColumn<PoseSample>] = &[
    RecordColumn("time", "s", SECOND, F64(|p, frame| frame.seconds(p.time_ns))),
    RecordColumn("x", "m", PLATFORM, F64(|p, frame| (p.position + frame.origin).x)),
    RecordColumn("y", "m", PLATFORM, F64(|p, frame| (p.position + frame.origin).y)),
    RecordColumn("z", "m", PLATFORM, F64(|p, frame| (p.position + frame.origin).z)),
    RecordColumn("roll", "deg", "Right side down; innermost rotation.", F64(|p, _| heading_angle(p, 0))),
    RecordColumn("pitch", "deg", "Nose up.", F64(|p, _| heading_angle(p, 1))),
    RecordColumn("yaw", "deg", "Heading, clockwise from +y.", F64(|p, _| heading_angle(p, 2))),
    RecordColumn("platform_roll", "deg", HELIOS, F64(|p, _| degrees(p.roll))),
    RecordColumn("platform_pitch", "deg", HELIOS, F64(|p, _| degrees(p.pitch))),
    RecordColumn("platform_yaw", "deg", HELIOS, F64(|p, _| degrees(p.yaw))),
];

const SECOND: &str =
    "Second of the GPS week; beyond 604800 adjusted standard GPS time (GPS seconds less 1e9).";
const PLATFORM: &str = "Position of the platform, world frame.";
const HELIOS: &str = "In the convention of the platform, as HELIOS++ writes it.";

fn heading_angle(pose: &PoseSample, angle: usize) -> f64 {
    degrees(pose.attitude.heading_angles()[angle]) + 0.0
}

const PULSES: &[RecordColumn<PulseRecord>] = &[
    RecordColumn("time", "s", SECOND, F64(|p, frame| frame.seconds(p.time_ns))),
    RecordColumn("x", "m", ORIGIN, F64(|p, frame| (p.origin + frame.origin).x)),
    RecordColumn("y", "m", ORIGIN, F64(|p, frame| (p.origin + frame.origin).y)),
    RecordColumn("z", "m", ORIGIN, F64(|p, frame| (p.origin + frame.origin).z)),
    RecordColumn("dx", "", DIRECTION, F64(|p, _| p.direction.x)),
    RecordColumn("dy", "", DIRECTION, F64(|p, _| p.direction.y)),
    RecordColumn("dz", "", DIRECTION, F64(|p, _| p.direction.z)),
    RecordColumn("pulse", "", NUMBER, U64(|p| p.number)),
    RecordColumn("device", "", DEVICE, U32(|p| p.device)),
    RecordColumn(
        "scan_angle",
        "deg",
        "Angle of the beam from straight down across the track, negative to the left of the flight; with the \
         physics of HELIOS++ its deflection on the scanner.",
        F64(|p, _| degrees(p.scan_angle)),
    ),
];

const ORIGIN: &str = "Origin of the beam, world frame.";
const DIRECTION: &str = "Direction of the beam, unit vector.";
const NUMBER: &str = "Number of the pulse among those of its device, from 1.";
const DEVICE: &str = "Index of the device, from 0.";

/// The last column is the number of samples, which follow all columns.
const WAVEFORMS: &[RecordColumn<WaveformRecord>] = &[
    RecordColumn("time", "s", SECOND, F64(|w, frame| frame.seconds(w.time_ns))),
    RecordColumn("pulse", "", NUMBER, U64(|w| w.pulse_number)),
    RecordColumn("device", "", DEVICE, U32(|w| w.device)),
    RecordColumn("x", "m", ORIGIN, F64(|w, frame| (w.origin + frame.origin).x)),
    RecordColumn("y", "m", ORIGIN, F64(|w, frame| (w.origin + frame.origin).y)),
    RecordColumn("z", "m", ORIGIN, F64(|w, frame| (w.origin + frame.origin).z)),
    RecordColumn("dx", "", DIRECTION, F64(|w, _| w.direction.x)),
    RecordColumn("dy", "", DIRECTION, F64(|w, _| w.direction.y)),
    RecordColumn("dz", "", DIRECTION, F64(|w, _| w.direction.z)),
    RecordColumn("start", "ns", "One-way travel time of the first sample.", F64(|w, _| w.start_ns)),
    RecordColumn("end", "ns", "One-way travel time of the last sample.", F64(|w, _| w.end_ns)),
    RecordColumn("count", "", "Number of samples.", U32(|w| w.samples as u32)),
];

/// Name of the list of samples of waveforms.
const SAMPLES: &str = "samples";

/// The columns of tables other than points.
fn columns(content: TableContent) -> Vec<TableColumn> {
    match content {
        TableContent::Points => Vec::new(),
        TableContent::Trajectory => TRAJECTORY.iter().map(RecordColumn::about).collect(),
        TableContent::Pulses => PULSES.iter().map(RecordColumn::about).collect(),
        TableContent::Waveforms => WAVEFORMS.iter().map(RecordColumn::about).collect(),
    }
}

/// Encodes the records of a batch other than points: a block of columns, and behind it the samples of
/// waveforms.
pub(super) fn encode(content: TableContent, batch: &Batch, frame: WorldFrame) -> EncodedPoints {
    let mut out = EncodedPoints::with_capacity(0);
    match content {
        TableContent::Points => {}
        TableContent::Trajectory => push_block(&mut out, TRAJECTORY, &batch.poses, frame),
        TableContent::Pulses => push_block(&mut out, PULSES, &batch.pulses, frame),
        TableContent::Waveforms => {
            // As many samples as there are.
            let cut =
                |wave: &WaveformRecord| WaveformRecord { samples: samples_of(batch, wave).len(), ..*wave };
            let waves: Vec<WaveformRecord> = batch.waveforms.iter().map(cut).collect();
            push_block(&mut out, WAVEFORMS, &waves, frame);
            for sample in waves.iter().flat_map(|wave| samples_of(batch, wave)) {
                out.bytes.extend(sample.to_le_bytes());
            }
        }
    }
    out
}

fn push_block<T>(out: &mut EncodedPoints, columns: &[RecordColumn<T>], records: &[T], frame: WorldFrame) {
    out.bytes.extend((records.len() as u32).to_le_bytes());
    columns.iter().for_each(|column| column.push(records, frame, &mut out.bytes));
    out.tally.records = records.len() as u64;
}

/// A table that is being collected.
pub(super) struct OpenTable {
    rows: Rows,
    schema: SchemaRef,
    /// Samples of the collected waveforms, and where each begins.
    samples: Option<Samples>,
    sink: Arc<dyn TableSink>,
    tally: Tally,
    kind: FileKind,
    has_passed: bool,
    per_leg: bool,
    intervals: Option<Intervals>,
}

/// Intervals of time at whose ends batches end.
struct Intervals {
    seconds: f64,
    /// Number of the column of the time.
    column: usize,
    /// The interval of the rows that are being collected.
    current: f64,
}

struct Samples {
    values: Vec<f64>,
    offsets: Vec<i64>,
    schema: SchemaRef,
}

impl OpenTable {
    pub fn new(request: &TableRequest, settings: &CloudSettings) -> OpenTable {
        let TableRequest { content, batch_rows, batch_per_leg, batch_seconds, sink } = request;
        let points = settings.table_columns();
        let time = points.iter().position(|column| *column == Column::GpsTime);
        let (kinds, schema) = match content {
            TableContent::Points => {
                let kinds = points.iter().map(|column| column.kind()).collect();
                (kinds, point_schema(&points, settings))
            }
            content => {
                let columns = columns(*content);
                let kinds = columns.iter().map(|column| column.1).collect();
                (kinds, schema_of(columns.into_iter(), BTreeMap::new()))
            }
        };
        let intervals = batch_seconds.zip(time).filter(|_| *content == TableContent::Points);
        let intervals =
            intervals.map(|(seconds, column)| Intervals { seconds, column, current: f64::NEG_INFINITY });
        let samples = (*content == TableContent::Waveforms).then(|| Samples {
            values: Vec::new(),
            offsets: vec![0],
            schema: with_samples(&schema),
        });
        OpenTable {
            rows: Rows::new(kinds, *batch_rows),
            schema,
            samples,
            sink: sink.clone(),
            tally: Tally::EMPTY,
            kind: Content::Table(*content).kind(),
            has_passed: false,
            per_leg: *batch_per_leg,
            intervals,
        }
    }

    /// Passes the rows collected so far if row `from` of the block is in another interval. Returns the end of
    /// its rows there.
    fn enter_interval(&mut self, block: &[&[u8]], from: usize, end: usize) -> Result<usize> {
        let Some(intervals) = &mut self.intervals else { return Ok(end) };
        let times = block[intervals.column];
        let interval = |row: usize| {
            let time = f64::from_le_bytes(std::array::from_fn(|i| times[8 * row + i]));
            libm::floor(time / intervals.seconds)
        };
        let here = interval(from);
        let to = (from..end).find(|row| interval(*row) != here).unwrap_or(end);
        if std::mem::replace(&mut intervals.current, here) != here && !self.rows.is_empty() {
            self.pass()?;
        }
        Ok(to)
    }

    /// Passes the rows collected so far.
    fn pass(&mut self) -> Result<()> {
        self.has_passed = true;
        let batch = self.rows.batch(&self.schema)?;
        self.sink.take(match &mut self.samples {
            Some(samples) => samples.join(batch)?,
            None => batch,
        })
    }
}

impl OpenOutput for OpenTable {
    /// Appends blocks of columns and passes every complete batch.
    fn append(&mut self, piece: Piece, _: &dyn Offload) -> Result<()> {
        self.tally.add(&piece.points.tally);
        let mut bytes = &piece.points.bytes[..];
        while let Some((block, end)) = self.rows.take_block(&mut bytes) {
            if let Some(samples) = &mut self.samples {
                samples.append(&block, &mut bytes);
            }
            let mut from = 0;
            while from < end {
                let to = self.enter_interval(&block, from, end)?;
                from = self.rows.append_rows(&block, from..to);
                if self.rows.is_full() {
                    self.pass()?;
                }
            }
        }
        Ok(())
    }

    fn has_records(&self) -> bool {
        self.tally.records > 0
    }

    fn end_leg(&mut self) -> Result<()> {
        if self.per_leg && !self.rows.is_empty() { self.pass() } else { Ok(()) }
    }

    /// Passes the remaining rows.
    fn finish(
        mut self: Box<Self>,
        _: &OutputPlan,
        _: &dyn Offload,
        partial: bool,
        _: &mut FileGroup,
    ) -> Result<Vec<FileSummary>> {
        if !self.rows.is_empty() || !self.has_passed {
            self.pass()?;
        }
        Ok(vec![FileSummary { partial, ..FileSummary::of(self.kind, &self.tally, self.tally.bounds) }])
    }
}

impl Samples {
    /// Takes the samples of a block of waveforms from the beginning of `bytes`; the last of its columns has
    /// their numbers.
    fn append(&mut self, block: &[&[u8]], bytes: &mut &[u8]) {
        let (counts, _) = block.last().copied().unwrap_or_default().as_chunks();
        let first = self.offsets.last().copied().unwrap_or(0);
        let mut last = first;
        for count in counts {
            last += i64::from(u32::from_le_bytes(*count));
            self.offsets.push(last);
        }
        let (samples, rest) = bytes.split_at((8 * (last - first) as usize).min(bytes.len()));
        self.values.extend(samples.as_chunks().0.iter().map(|value| f64::from_le_bytes(*value)));
        *bytes = rest;
    }

    /// The batch with the samples of its rows, which are the first ones collected.
    fn join(&mut self, batch: RecordBatch) -> Result<RecordBatch> {
        let rows = batch.num_rows();
        let end = self.offsets[rows];
        let rest: Vec<i64> = self.offsets[rows..].iter().map(|offset| offset - end).collect();
        let mut offsets = std::mem::replace(&mut self.offsets, rest);
        offsets.truncate(rows + 1);
        let rest = self.values.split_off(end as usize);
        let values = std::mem::replace(&mut self.values, rest);
        let failed = |e| Error::Internal(format!("Arrow: {e}"));
        let list = LargeListArray::try_new(
            sample_field(),
            OffsetBuffer::new(ScalarBuffer::from(offsets)),
            Arc::new(Float64Array::from(values)),
            None,
        )
        .map_err(failed)?;
        let columns = batch.columns().iter().cloned().chain([Arc::new(list) as Arc<dyn Array>]);
        RecordBatch::try_new(self.schema.clone(), columns.collect()).map_err(failed)
    }
}

fn sample_field() -> Arc<Field> {
    Arc::new(Field::new("item", DataType::Float64, false))
}

fn with_samples(schema: &Schema) -> SchemaRef {
    let list = Field::new(SAMPLES, DataType::LargeList(sample_field()), false);
    let about = BTreeMap::from([("description".to_owned(), "Samples of the waveform.".to_owned())]);
    let fields = schema.fields().iter().cloned().chain([Arc::new(list.with_metadata(about))]);
    Arc::new(Schema::new_with_metadata(fields.collect::<Vec<_>>(), schema.metadata().clone()))
}
