#![doc = include_str!("../README.md")]
//!
//! ## Inside
//!
//! Every command and loader reads points through [`PointFile`] or [`read_points`], which recognise the format
//! by the first bytes and pass the points one by one to a [`PointSink`]. Positions are metres. Blocks of LAS,
//! LAZ, text and Parquet files are decoded on several threads; the sink gets the points in the order of the
//! file, on the calling thread.
//!
//! A [`PointFormat`] is a row in the table of formats that are written. Prepared for the [`CloudSettings`] of
//! a cloud it is a [`PointEncoder`], which turns [`PointRecord`]s into bytes in any number of threads, and
//! begins files, whose [`FileBody`] takes these bytes in one. [`CloudWriter`] does both in one thread.
//!
//! ```text
//! PointRecord ─► PointEncoder::encode ─► EncodedPoints ─► FileBody::append ─► OutputStream
//! ```
//!
//! | file | what it does |
//! |---|---|
//! | `las` | LAS, LAZ and COPC |
//! | `ply`, `pcd`, `e57` | PLY and ray clouds, PCD, E57 |
//! | `mcap` | MCAP with messages of ROS 2, written; its frames, read |
//! | `frames` | frames of points with the poses of their scanner |
//! | `logs` | MCAP files of several scanners as one |
//! | `leica` | PTS and PTX, read |
//! | `text` | lines of columns, with or without a line of names |
//! | `columnar`, `table` | Arrow and Parquet: written; read, as tables in memory are |
//! | `columns` | which columns of a table hold which attributes of a point, and in which units |
//! | `file`, `format` | opens files and streams that are read, and recognises their formats |
//! | `blocks` | blocks of a file decoded on several threads, in the order of the file |
//! | `point_format` | the table of the formats that are written |
//! | `record`, `settings`, `objects` | points as they are written; facts about a cloud; numbers of objects |
//! | `copy` | copies of clouds in other formats |
//! | `pulse_groups` | returns grouped into pulses |
//! | `steps` | positions as whole numbers of steps |
//! | `strays` | the few points of a cloud that lie far from all others |
//! | `encode`, `cloud_writer` | the two halves of a format; a writer for one thread |
//! | `out`, `number` | buffered streams of bytes with jobs for idle threads; numbers as text |

#![deny(unsafe_code)]

mod blocks;
mod cloud_writer;
mod columnar;
mod columns;
mod copy;
#[cfg(feature = "e57")]
mod e57;
mod encode;
mod file;
mod format;
mod frames;
mod las;
mod leica;
mod logs;
#[cfg(feature = "mcap")]
mod mcap;
pub mod number;
mod objects;
mod out;
mod pcd;
mod ply;
mod point_format;
mod pulse_groups;
mod record;
mod settings;
mod steps;
mod strays;
mod table;
pub mod text;

pub use cloud_writer::CloudWriter;
pub use columnar::{Column, ColumnListError, ColumnType, Rows, TableColumn, point_schema, schema_of};
pub use columns::{Attribute, AttributeSet, Columns, Misfits, PositionsError};
pub use copy::copy;
#[cfg(feature = "e57")]
pub use e57::{E57Error, ScanError};
pub use encode::{EncodedFile, Ending, FileBody, Plain, PointEncoder};
pub use file::{PointFile, read_points, read_points_on};
pub use format::{CloudFormat, UnreadFormat};
pub use frames::{Frame, FramePoint, FramePose, read_frames};
#[doc(hidden)]
pub use las::packets_header;
pub use las::{
    CHUNK_POINTS, ExtraDimension, ExtraDimensions, Header as LasHeader, LasError, LasFacts, LasReader,
    LasSettings, LasVersion, PACKETS_HEADER_BYTES, PacketPlace, PointsError, Selection,
};
pub use logs::{MergedLog, merge_logs};
pub use objects::{OBJECT_NAMES, ObjectIds};
pub use out::{Destination, Job, NoOffload, Offload, OutputStream};
pub use pcd::PcdError;
pub use ply::{PlyError, PlyNumbers};
#[doc(hidden)]
pub use ply::{is_ply, ply_header};
pub use point_format::{PointFormat, UnknownExtension};
pub use pulse_groups::{GroupedBy, PulseGroups, PulseGroupsError, PulseKey};
pub use record::{
    Cause, EncodedPoints, Needs, PointBatch, PointFlags, PointRecord, StoredFields, Tally, Wave,
};
pub use settings::{CloudSettings, FrameNames};
pub use steps::PositionSteps;
pub use strays::{Apart, StrayFinder, Strays};
pub use table::{MISSES_KEY, read_number_columns, read_record_batch};

use std::any::Any;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place, Problem};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::counted;
use vlscan_base::store::FileBytes;
use vlscan_geom::{DVec3, radians};

/// Length of the parts of a file that are released together, bytes.
const RELEASED_BYTES: usize = if cfg!(test) { 1 << 12 } else { 1 << 24 };

/// A point as stored in its file. Attributes that the file lacks are 0; an intensity that it marks as missing
/// is NaN.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointRow {
    /// World position, m; not validated.
    pub position: DVec3,
    /// Surface normal of any length; not validated.
    pub normal: Option<DVec3>,
    /// Strength of the return, in the unit of the file.
    pub intensity: f32,
    /// Point class: the classification code of LAS.
    pub class: u8,
    /// Return number, from 1.
    pub return_number: u8,
    /// Number of returns of the pulse.
    pub number_of_returns: u8,
    /// True for a pulse without a return, which is not a point: a row that this program has written for
    /// `--misses`. Return 0 of 0 alone does not mark one: points that are added to a cloud or merged into it
    /// have it, too.
    pub is_miss: bool,
    /// Scan angle, degrees, as the file has it: in LAS across the track, negative to the left.
    pub scan_angle: f64,
    /// Number of the object that was hit.
    pub object: i64,
    /// Number of the leg.
    pub leg: u16,
    /// Point source id of LAS, by convention the number of the flight line; 0 in other formats.
    pub point_source: u16,
    /// Number of the scanner's device.
    pub channel: u16,
    /// Time of the pulse, s.
    pub time: f64,
    /// Way of the light, see [`Cause::path`].
    pub path: u8,
    /// Red, green and blue as the file has them: of 16 bits in LAS, mostly of 8 bits in other formats. `None`
    /// without colours, and for formats whose colours are not read.
    pub colour: Option<[u16; 3]>,
    /// Attributes whose values in the file do not fit the types here.
    pub misfits: Misfits,
}

impl PointRow {
    /// Number of the flight line: the point source id of LAS, or the leg counted from 1 in files of other
    /// formats.
    pub fn flight_line(&self, is_las: bool) -> u16 {
        if is_las { self.point_source } else { self.leg.saturating_add(1) }
    }
}

/// Attributes of a point in addition to those of its [`PointRow`], for sinks that [take
/// them](PointSink::takes_details).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointDetails {
    /// Fields of the record as LAS has them.
    pub stored: StoredFields,
    /// Amplitude of the echo, with all its digits.
    pub amplitude: Option<f64>,
    /// Width of the echo, ns.
    pub echo_width: Option<f64>,
    /// Number of the pulse, modulo 2³².
    pub pulse_number: Option<u64>,
    /// Measured range, m.
    pub range: Option<f64>,
}

impl PointDetails {
    /// True if there is an attribute that LAS has in extra bytes.
    pub fn has_extra(&self) -> bool {
        let PointDetails { stored, amplitude, echo_width, pulse_number, range } = self;
        let numbers = [*amplitude, *echo_width, *range];
        numbers.iter().any(Option::is_some) || pulse_number.is_some() || stored.incidence_deg.is_some()
    }

    /// Sets the known fields of a record.
    pub fn add_to(&self, record: &mut PointRecord) {
        record.stored = self.stored;
        record.amplitude = self.amplitude.unwrap_or(record.amplitude);
        record.echo_width = self.echo_width.unwrap_or(record.echo_width);
        record.pulse_number = self.pulse_number.unwrap_or(record.pulse_number);
        record.range = self.range.unwrap_or(record.range);
        if let Some(angle) = self.stored.incidence_deg {
            record.incidence_cosine = libm::cos(radians(f64::from(angle)));
        }
    }
}

/// Facts about a file.
#[derive(Clone, Debug, PartialEq)]
pub struct FileFacts {
    /// Its format.
    pub format: CloudFormat,
    /// Statements of the LAS header; `None` for other formats.
    pub las: Option<LasFacts>,
}

/// Sums over a block of successive points, made on the thread that decodes them. Blocks end anywhere, so the
/// sums over all blocks must not depend on where they end.
pub trait PointPart: Any + Send {
    /// Adds the next point of the block; its object has no name.
    fn add(&mut self, row: &PointRow);

    /// Adds the next point of the block, with the name of its object in files that have names.
    fn add_named(&mut self, row: &PointRow, _object: Option<&str>) {
        self.add(row);
    }

    /// True if the names of objects are used, or not needed. Otherwise points of files with names are passed
    /// one by one.
    fn takes_names(&self) -> bool {
        false
    }

    /// Begins another block.
    fn clear(&mut self);
}

/// Makes an empty part of a sink.
pub type NewPart = Box<dyn Fn() -> Box<dyn PointPart> + Send + Sync>;

/// Takes the points of a file.
pub trait PointSink {
    /// Called once, before the first point, with the attributes that the points have. Single points may lack
    /// them: of several scans in a file, some may be without colours.
    fn start(&mut self, attributes: AttributeSet);

    /// Called once, before the first point, with the kind of the file.
    fn file(&mut self, _facts: &FileFacts) {}

    /// Called at most once, before the first point, with the system of the coordinates as WKT in files that
    /// name one.
    fn crs(&mut self, _wkt: &str) {}

    /// The attributes that the sink uses. Of LAS the others are 0, since leaving them compressed saves time;
    /// other formats pass on all of them.
    fn selection(&self) -> Selection {
        Selection::All
    }

    /// True if [`PointSink::unread`] and [`PointSink::details`] are called, which takes time.
    fn takes_details(&self) -> bool {
        false
    }

    /// Called at most once, before the first point, with the names of attributes of the points that are not
    /// read: of LAS, Arrow and Parquet.
    fn unread(&mut self, _attributes: Vec<String>) {}

    /// Takes the details of the next point, before the point itself: of LAS.
    fn details(&mut self, _details: &PointDetails) {}

    /// True if [`PointSink::choose`], [`PointSink::values`] and [`PointSink::metadata`] are called.
    fn takes_columns(&self) -> bool {
        false
    }

    /// Chooses columns whose values are passed with each point. Called at most once, after
    /// [`PointSink::start`], with the names of all columns, fields or dimensions of a file: of LAS (extra
    /// bytes), PLY, PCD, text with names, Arrow and Parquet. Those without numbers have an empty name.
    /// Returns indices of `names`. [`PointSink::parts`] do not get these values.
    fn choose(&mut self, _names: &[&str]) -> Vec<usize> {
        Vec::new()
    }

    /// Takes the values of the chosen columns for the next point, in the order in which they were chosen,
    /// before the point itself; NaN where there is no number. Not called if none is chosen.
    fn values(&mut self, _values: &[f64]) {}

    /// Takes metadata of the file before the first point: `crs` (WKT) and others of Arrow and Parquet; of
    /// these, LAS and PLY `object_names`, a JSON object of names by the numbers of objects.
    fn metadata(&mut self, _key: &str, _text: &str) {}

    /// Makes empty parts for blocks of points, if the sink uses these instead of single points where it can:
    /// of LAS and text. Called after [`PointSink::start`]. The details of such points are not passed.
    fn parts(&self) -> Option<NewPart> {
        None
    }

    /// Takes the part of the next block of points in the order of the file. `Break` ends reading.
    ///
    /// # Errors
    /// The errors of the sink, as for [`PointSink::point`].
    fn add_part(&mut self, _part: &mut (dyn PointPart + 'static)) -> Result<ControlFlow<()>> {
        Ok(ControlFlow::Continue(()))
    }

    /// Takes the next point in the order of the file; `object` is the name of its object in files that have
    /// names. `Break` ends reading.
    ///
    /// # Errors
    /// The errors of the sink: they end reading, and are returned by the reader.
    fn point(&mut self, row: &PointRow, object: Option<&str>) -> Result<ControlFlow<()>>;
}

/// A file that is being read: where its points go and where its problems are recorded.
struct Reading<'a> {
    path: &'a Path,
    selection: Selection,
    sink: &'a mut dyn PointSink,
    found: &'a mut Diagnostics,
    /// Number of threads that decode.
    threads: usize,
    /// The file, if parts that have been read are released.
    file: Option<FileBytes>,
    /// Offset in the file up to which it is released.
    released: usize,
    /// Number of points with a value that does not fit, by attribute, and the place of the first one.
    misfits: [(u64, Option<Place>); Attribute::COUNT],
    /// The error of the sink, which has ended reading.
    failure: Option<Error>,
}

impl<'a> Reading<'a> {
    fn new(
        path: &'a Path,
        selection: Selection,
        sink: &'a mut dyn PointSink,
        found: &'a mut Diagnostics,
    ) -> Reading<'a> {
        Reading {
            path,
            selection,
            sink,
            found,
            threads: 1,
            file: None,
            released: 0,
            misfits: Default::default(),
            failure: None,
        }
    }

    /// Decodes on this number of threads where the format has blocks; by default on one.
    fn on(self, threads: usize) -> Reading<'a> {
        Reading { threads, ..self }
    }

    /// Releases parts of a file that have been read.
    fn release_from(&mut self, file: &FileBytes) {
        self.file = Some(file.clone());
    }

    /// Releases the memory of the file before an offset, up to which it has been read. Small parts are
    /// released together.
    fn release_before(&mut self, end: usize) {
        if let Some(file) = &self.file
            && end >= self.released.saturating_add(RELEASED_BYTES)
        {
            file.release(self.released..end);
            self.released = end;
        }
    }

    /// Passes the format of the file to the sink, unless its reader passes more.
    fn tell(&mut self, format: CloudFormat) {
        if format != CloudFormat::Las {
            self.sink.file(&FileFacts { format, las: None });
        }
    }

    /// Records a warning about the whole file.
    fn warn(&mut self, message: impl Into<String>) {
        self.found.warn(Some(self.place()), message);
    }

    /// Warns of data after the points that the header of the file counts.
    fn warn_of_rest(&mut self, points: usize) {
        let points = counted(points, "point");
        self.warn(format!(
            "the file continues after the {points} that its header states; the rest is not read"
        ));
    }

    /// Records why the file cannot be read.
    fn fail(&mut self, message: String, problem: impl Problem) {
        self.found.error(None, message).because_of(problem);
    }

    /// Records why the file cannot be read, if it cannot.
    fn fail_unless_ok(&mut self, read: Result<(), impl Problem>) {
        if let Err(problem) = read {
            self.fail(format!("{}: {problem}", self.path.display()), problem);
        }
    }

    /// Records how the whole file was interpreted.
    fn note(&mut self, message: impl Into<String>) {
        self.found.note(Some(self.place()), message);
    }

    fn place(&self) -> Place {
        Place::of_file(self.path)
    }

    /// The columns that the sink chooses among those with these names.
    fn choose(&mut self, names: &[&str]) -> Vec<usize> {
        if self.sink.takes_columns() { self.sink.choose(names) } else { Vec::new() }
    }

    /// Passes the values of the chosen columns for the next point.
    fn pass_values(&mut self, values: &[f64]) {
        if !values.is_empty() {
            self.sink.values(values);
        }
    }

    /// Passes the names of objects by their numbers as metadata, if there are any.
    fn pass_object_names(&mut self, names: BTreeMap<i32, String>) {
        if let Some(text) = ObjectIds::of_names(names).names_as_json() {
            self.sink.metadata(OBJECT_NAMES, &text);
        }
    }

    /// Passes the metadata of a table.
    fn pass_metadata(&mut self, metadata: &BTreeMap<String, String>) {
        if self.sink.takes_columns() {
            metadata.iter().for_each(|(key, text)| self.sink.metadata(key, text));
        }
    }

    /// Passes a point to the sink.
    fn take(&mut self, row: &PointRow) -> ControlFlow<()> {
        let path = self.path;
        self.take_from(row, None, |_| Place::of_file(path))
    }

    /// Passes a point to the sink, with the name of its object; `place` is the place of an attribute's value.
    fn take_from(
        &mut self,
        row: &PointRow,
        object: Option<&str>,
        place: impl Fn(Attribute) -> Place,
    ) -> ControlFlow<()> {
        for attribute in row.misfits.attributes() {
            let (count, first) = &mut self.misfits[attribute as usize];
            *count += 1;
            first.get_or_insert_with(|| place(attribute));
        }
        match self.sink.point(row, object) {
            Ok(flow) => flow,
            Err(failure) => {
                self.failure = Some(failure);
                ControlFlow::Break(())
            }
        }
    }

    /// Passes the part of a block to the sink, with the numbers of its values that do not fit.
    fn take_part(
        &mut self,
        part: &mut (dyn PointPart + 'static),
        misfits: &[u64; Attribute::COUNT],
    ) -> ControlFlow<()> {
        let path = self.path;
        for ((count, first), more) in self.misfits.iter_mut().zip(misfits).filter(|(_, more)| **more > 0) {
            *count += more;
            first.get_or_insert_with(|| Place::of_file(path));
        }
        match self.sink.add_part(part) {
            Ok(flow) => flow,
            Err(failure) => {
                self.failure = Some(failure);
                ControlFlow::Break(())
            }
        }
    }

    /// Warns of selected values of all points that do not fit.
    ///
    /// # Errors
    /// That of the sink.
    fn end(self) -> Result<()> {
        let is_selected =
            |attribute| self.selection != Selection::PositionAndClass || attribute == Attribute::Class;
        for (attribute, (count, place)) in Attribute::ALL.into_iter().zip(self.misfits) {
            if count > 0 && is_selected(attribute) {
                let points = if count == 1 { "point has" } else { "points have" };
                self.found.warn(place, format!("{count} {points} {}", attribute.misfit()));
            }
        }
        self.failure.map_or(Ok(()), Err)
    }
}
