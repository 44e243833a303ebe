//! Tables in memory: points, poses, pulses and waveforms as Arrow record batches for the caller of a run.

use super::arrow::{batch, data_type};
use super::columns::{Column, Kind};
use super::rows::Rows;
use super::summary::Tally;
use ::arrow_array::{Array, Float64Array, LargeListArray, RecordBatch};
use ::arrow_buffer::{OffsetBuffer, ScalarBuffer};
use ::arrow_schema::{DataType, Field, Schema, SchemaRef};
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::sync::Arc;
use vlscan_base::error::{Error, Result};
use vlscan_geom::{DVec3, degrees};
use vlscan_lidar::pulse::Batch;

/// What the rows of a table are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TableContent {
    /// Points, with the columns of [`OutputRequest::columns`](super::OutputRequest::columns).
    Points,
    /// Poses of the platform: time (s), x, y, z (m), roll, pitch, yaw (deg, of a heading as `--trajectory` reads them),
    /// and the angles in the platform's own convention.
    Trajectory,
    /// Emitted pulses: time (s), x, y, z (m), dx, dy, dz, pulse, device, scan_angle (deg).
    Pulses,
    /// Digitised waveforms: time (s), pulse, device, x, y, z (m), dx, dy, dz, one-way travel time of the first and the last
    /// sample (ns), and the list of samples.
    Waveforms,
}

/// A table that a run passes to its caller.
#[derive(Clone, Debug)]
pub struct TableRequest {
    /// What its rows are.
    pub content: TableContent,
    /// Rows per batch; the last batch has the remaining rows.
    pub batch_rows: usize,
    /// Whether a batch ends with its leg, too.
    pub batch_per_leg: bool,
    /// Of points with the column `GpsTime`: whether a batch ends at every multiple of so many seconds, too.
    pub batch_seconds: Option<f64>,
    /// What takes the batches.
    pub sink: Arc<dyn TableSink>,
}

/// Takes the batches of a table. At least one batch is passed, in the thread that collects the results of a run.
pub trait TableSink: Debug + Send + Sync {
    /// Takes the next batch; the run waits meanwhile.
    ///
    /// # Errors
    /// [`Error::ClosedPipe`] when no further batches are wanted.
    fn take(&self, batch: RecordBatch) -> Result<()>;
}

/// Name, kind, unit and meaning of a column.
type TableColumn = (&'static str, Kind, &'static str, &'static str);

const TRAJECTORY: &[TableColumn] = &[
    ("time", Kind::F64, "s", "Second of the GPS week."),
    ("x", Kind::F64, "m", "Position of the platform, world frame."),
    ("y", Kind::F64, "m", "Position of the platform, world frame."),
    ("z", Kind::F64, "m", "Position of the platform, world frame."),
    ("roll", Kind::F64, "deg", "Right side down; innermost rotation."),
    ("pitch", Kind::F64, "deg", "Nose up."),
    ("yaw", Kind::F64, "deg", "Heading, clockwise from +y."),
    ("platform_roll", Kind::F64, "deg", "In the convention of the platform, as HELIOS++ writes it."),
    ("platform_pitch", Kind::F64, "deg", "In the convention of the platform, as HELIOS++ writes it."),
    ("platform_yaw", Kind::F64, "deg", "In the convention of the platform, as HELIOS++ writes it."),
];

const PULSES: &[TableColumn] = &[
    ("time", Kind::F64, "s", "Emission, second of the GPS week."),
    ("x", Kind::F64, "m", "Origin of the beam, world frame."),
    ("y", Kind::F64, "m", "Origin of the beam, world frame."),
    ("z", Kind::F64, "m", "Origin of the beam, world frame."),
    ("dx", Kind::F64, "", "Direction of the beam, unit vector."),
    ("dy", Kind::F64, "", "Direction of the beam, unit vector."),
    ("dz", Kind::F64, "", "Direction of the beam, unit vector."),
    ("pulse", Kind::U64, "", "Number of the pulse among those of its device, from 1."),
    ("device", Kind::U32, "", "Index of the device, from 0."),
    ("scan_angle", Kind::F64, "deg", "Deflection of the beam on the scanner."),
];

const WAVEFORMS: &[TableColumn] = &[
    ("time", Kind::F64, "s", "Emission of the pulse, second of the GPS week."),
    ("pulse", Kind::U64, "", "Number of the pulse among those of its device, from 1."),
    ("device", Kind::U32, "", "Index of the device, from 0."),
    ("x", Kind::F64, "m", "Origin of the beam, world frame."),
    ("y", Kind::F64, "m", "Origin of the beam, world frame."),
    ("z", Kind::F64, "m", "Origin of the beam, world frame."),
    ("dx", Kind::F64, "", "Direction of the beam, unit vector."),
    ("dy", Kind::F64, "", "Direction of the beam, unit vector."),
    ("dz", Kind::F64, "", "Direction of the beam, unit vector."),
    ("start", Kind::F64, "ns", "One-way travel time of the first sample."),
    ("end", Kind::F64, "ns", "One-way travel time of the last sample."),
    ("count", Kind::U32, "", "Number of samples."),
];

/// Name of the list of samples of waveforms.
const SAMPLES: &str = "samples";

fn columns(content: TableContent) -> &'static [TableColumn] {
    match content {
        TableContent::Points => &[],
        TableContent::Trajectory => TRAJECTORY,
        TableContent::Pulses => PULSES,
        TableContent::Waveforms => WAVEFORMS,
    }
}

/// Encodes the records of a batch other than points: columns, and behind them the samples of waveforms.
pub(super) fn encode(content: TableContent, batch: &Batch, shift: DVec3) -> (Vec<u8>, Tally) {
    let mut out = Block(Vec::new());
    let mut tally = Tally::EMPTY;
    match content {
        TableContent::Points => {}
        TableContent::Trajectory => {
            let poses = &batch.poses;
            tally.records = poses.len() as u64;
            out.f64s(poses, |pose| pose.time_ns / 1e9);
            out.vectors(poses, |pose| pose.position + shift);
            for angle in 0..3 {
                // Adding 0 removes negative zeros.
                out.f64s(poses, |pose| degrees(pose.attitude.heading_angles()[angle]) + 0.0);
            }
            out.f64s(poses, |pose| degrees(pose.roll));
            out.f64s(poses, |pose| degrees(pose.pitch));
            out.f64s(poses, |pose| degrees(pose.yaw));
        }
        TableContent::Pulses => {
            let pulses = &batch.pulses;
            tally.records = pulses.len() as u64;
            out.f64s(pulses, |pulse| pulse.time_ns / 1e9);
            out.vectors(pulses, |pulse| pulse.origin + shift);
            out.vectors(pulses, |pulse| pulse.direction);
            pulses.iter().for_each(|pulse| out.0.extend(pulse.number.to_le_bytes()));
            pulses.iter().for_each(|pulse| out.0.extend(pulse.device.to_le_bytes()));
            out.f64s(pulses, |pulse| degrees(pulse.scan_angle));
        }
        TableContent::Waveforms => {
            let waves = &batch.waveforms;
            tally.records = waves.len() as u64;
            out.f64s(waves, |wave| wave.time_ns / 1e9);
            waves.iter().for_each(|wave| out.0.extend(wave.pulse_number.to_le_bytes()));
            waves.iter().for_each(|wave| out.0.extend(wave.device.to_le_bytes()));
            out.vectors(waves, |wave| wave.origin + shift);
            out.vectors(waves, |wave| wave.direction);
            out.f64s(waves, |wave| wave.start_ns);
            out.f64s(waves, |wave| wave.end_ns);
            let samples: Vec<&[f64]> = waves
                .iter()
                .map(|wave| {
                    let from = batch.samples.get(wave.first_sample..).unwrap_or_default();
                    &from[..wave.samples.min(from.len())]
                })
                .collect();
            samples.iter().for_each(|samples| out.0.extend((samples.len() as u32).to_le_bytes()));
            samples.iter().for_each(|samples| out.f64s(samples, |sample| *sample));
        }
    }
    (out.0, tally)
}

/// A block of columns, little-endian.
struct Block(Vec<u8>);

impl Block {
    fn f64s<T>(&mut self, records: &[T], value: impl Fn(&T) -> f64) {
        records.iter().for_each(|record| self.0.extend(value(record).to_le_bytes()));
    }

    fn vectors<T>(&mut self, records: &[T], value: impl Fn(&T) -> DVec3) {
        for axis in 0..3 {
            self.f64s(records, |record| value(record)[axis]);
        }
    }
}

/// A table that is being collected.
pub(super) struct OpenTable {
    rows: Rows,
    schema: SchemaRef,
    /// Samples of the collected waveforms, and where each begins.
    samples: Option<Samples>,
    sink: Arc<dyn TableSink>,
    tally: Tally,
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
    /// `points` has the columns and the schema of points.
    pub fn new(request: &TableRequest, points: (&[Column], SchemaRef)) -> OpenTable {
        let TableRequest { content, batch_rows, batch_per_leg, batch_seconds, sink } = request;
        let time = points.0.iter().position(|column| *column == Column::GpsTime);
        let (kinds, schema) = match content {
            TableContent::Points => (points.0.iter().map(|column| column.kind()).collect(), points.1),
            content => (columns(*content).iter().map(|column| column.1).collect(), schema(*content)),
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
            has_passed: false,
            per_leg: *batch_per_leg,
            intervals,
        }
    }

    /// Counts of the rows appended so far.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// Appends a block of columns and passes every complete batch.
    pub fn append(&mut self, bytes: &[u8], tally: &Tally) -> Result<()> {
        self.tally.add(tally);
        let mut block = bytes;
        if let Some(samples) = &mut self.samples {
            let width: usize = WAVEFORMS.iter().map(|column| column.1.width()).sum();
            let (columns, values) = bytes.split_at((tally.records as usize * width).min(bytes.len()));
            block = columns;
            samples.append(columns, values, tally.records as usize);
        }
        let (mut from, end) = (0, self.rows.in_block(block));
        while from < end {
            let to = self.enter_interval(block, from)?;
            from = self.rows.append_rows(block, from..to);
            if self.rows.is_full() {
                self.pass()?;
            }
        }
        Ok(())
    }

    /// Passes the rows collected so far if row `from` of the block is in another interval. Returns the end of its rows there.
    fn enter_interval(&mut self, block: &[u8], from: usize) -> Result<usize> {
        let end = self.rows.in_block(block);
        let Some(intervals) = &mut self.intervals else { return Ok(end) };
        let times = self.rows.column(block, intervals.column);
        let interval = |row: usize| {
            let time = f64::from_le_bytes(std::array::from_fn(|i| times[8 * row + i]));
            libm::floor(time / intervals.seconds)
        };
        let here = interval(from);
        let to = (from..end).find(|row| interval(*row) != here).unwrap_or(end);
        if std::mem::replace(&mut intervals.current, here) != here && self.rows.len() > 0 {
            self.pass()?;
        }
        Ok(to)
    }

    /// Passes the rows of a leg that has ended, if batches end with legs.
    pub fn end_leg(&mut self) -> Result<()> {
        if self.per_leg && self.rows.len() > 0 { self.pass() } else { Ok(()) }
    }

    /// Passes the rows collected so far.
    fn pass(&mut self) -> Result<()> {
        self.has_passed = true;
        let batch = batch(&mut self.rows, &self.schema)?;
        self.sink.take(match &mut self.samples {
            Some(samples) => samples.join(batch)?,
            None => batch,
        })
    }

    /// Passes the remaining rows.
    pub fn finish(mut self) -> Result<Tally> {
        if self.rows.len() > 0 || !self.has_passed {
            self.pass()?;
        }
        Ok(self.tally)
    }
}

impl Samples {
    /// Appends the samples of `rows` waveforms; the last of their `columns` has the numbers of samples.
    fn append(&mut self, columns: &[u8], values: &[u8], rows: usize) {
        let (values, _) = values.as_chunks();
        self.values.extend(values.iter().map(|value| f64::from_le_bytes(*value)));
        let (counts, _) = columns[columns.len().saturating_sub(4 * rows)..].as_chunks();
        for count in counts {
            let last = self.offsets.last().copied().unwrap_or(0);
            self.offsets.push(last + i64::from(u32::from_le_bytes(*count)));
        }
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

fn schema(content: TableContent) -> SchemaRef {
    let fields = columns(content).iter().map(|(name, kind, unit, meaning)| {
        let mut about = BTreeMap::from([("description".to_owned(), (*meaning).to_owned())]);
        if !unit.is_empty() {
            about.insert("unit".to_owned(), (*unit).to_owned());
        }
        Field::new(*name, data_type(*kind), false).with_metadata(about)
    });
    let generator = ("generator".to_owned(), concat!("vlscan ", env!("CARGO_PKG_VERSION")).to_owned());
    let metadata = BTreeMap::from([generator]);
    Arc::new(Schema::new_with_metadata(fields.collect::<Vec<_>>(), metadata))
}
