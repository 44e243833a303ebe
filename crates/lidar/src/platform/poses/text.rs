//! Trajectories in rows, of text or of an Arrow stream: a header names columns in any order, otherwise they
//! are time, x, y, z, roll, pitch, yaw, or a quaternion or a matrix that is recognised by its numbers. Of the
//! comments of text the directives `#HEADER:` and `#TIME_COLUMN:` of HELIOS++'s files count. Lines that
//! HELIOS++ wrote are detected by their numbers of decimals.

use super::decoder::TakeFix;
use super::fix::{Fix, FixPlace, RecordPlace};
use super::recognise::{CameraCheck, Numbers, is_upright_with_w_first, recognise};
use crate::platform::attitude::FileAxes;
use crate::platform::header::StatedColumns;
use crate::platform::interpolated::composed;
use crate::platform::layout::{ANGLES, AttitudeColumns, POSE_COLUMNS, PoseColumn, PoseLayout, PoseNumbers};
use crate::platform::layout_error::PoseLayoutError;
use std::f64::consts::FRAC_PI_2;
use std::path::{Path, PathBuf};
use vlscan_base::columns::{Separator, is_number};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_geom::Rotation;
use vlscan_survey::{AngleConvention, PoseFormat, PoseStream, RotationSpec};
use vlscan_tables::input::read_text;
use vlscan_tables::input::rows::{Row, RowDecoder, RowError};

/// Maximum number of rows that are decoded together.
const BLOCK_ROWS: usize = 1024;
/// Decimals of the columns of HELIOS++'s trajectory files: x, y, z, t, roll, pitch, yaw.
const HELIOS_DECIMALS: [usize; 7] = [4, 4, 4, 9, 4, 4, 4];
const CAMERA: &str = "the body moves along its z axis, as a camera does, but z is read as up";
const CAMERA_HELP: &str =
    "state the axes: --trajectory-rotation camera (right, down, forward), or ros (forward, left, up)";
/// Hint where no columns are found.
const NAME_COLUMNS: &str = "name the columns in a first line, or with --trajectory-columns: \
                            time,x,y,z,roll,pitch,yaw or time,x,y,z,qx,qy,qz,qw";
/// Hint where w is probably the first component of the quaternion.
const NAME_W_FIRST: &str = "name the columns in a first line, or with --trajectory-columns: \
                            time,x,y,z,qw,qx,qy,qz or time,x,y,z,qx,qy,qz,qw";
/// Hint where poses have no times.
const ADD_TIMES: &str = "put the times before the poses: `paste -d ' ' times.txt poses.txt > timed.txt`, or \
     at 10 Hz: `awk '{ print (NR - 1) / 10, $0 }' poses.txt > timed.txt`";
/// Hint where seven numbers are poses without times, or poses with times and angles.
const NAME_OR_ADD_TIMES: &str = "put the times before the poses: `paste -d ' ' times.txt poses.txt > \
                                 timed.txt`; if the columns are time, x, y, z, roll, pitch, yaw, name them \
                                 so in a first line";
/// Name of KITTI's file of times, next to its poses.
const TIMES_FILE: &str = "times.txt";
const MAX_TIMES_BYTES: u64 = 1 << 28;
/// Times that are too large for seconds in any scale: nanoseconds from 1973 on, up to those that a 64-bit
/// integer holds.
const MIN_NANOSECONDS: f64 = 1e17;
const MAX_NANOSECONDS: f64 = 1e19;

/// Decodes rows to fixes.
#[derive(Debug)]
pub struct PoseRows {
    /// The stream in messages.
    path: PathBuf,
    rows: RowDecoder,
    settings: PoseStream,
    layout: Option<PoseLayout>,
    /// The convention of the angles, once the layout is known.
    rotation: AngleConvention,
    /// The axes of quaternions and matrices.
    axes: Option<FileAxes>,
    helios: bool,
    /// The times of a file next to matrices without times, and the number of times used.
    times: Option<(Vec<f64>, usize)>,
    /// Looks for poses of cameras, unless the user has chosen the axes.
    camera: Option<CameraCheck>,
    /// Problems of the headings that do not end the run.
    remarks: Diagnostics,
}

impl PoseRows {
    pub fn new(path: &Path, settings: PoseStream) -> PoseRows {
        PoseRows {
            path: path.to_path_buf(),
            rows: RowDecoder::new(path, "a pose", settings.separator).with_preamble(),
            helios: settings.format == Some(PoseFormat::Helios),
            settings,
            layout: None,
            rotation: AngleConvention::Heading,
            axes: None,
            times: None,
            camera: None,
            remarks: Diagnostics::default(),
        }
    }

    pub fn name(&self) -> &'static str {
        match (self.helios, self.rows.fields()) {
            (true, _) => "HELIOS++ text",
            (false, None) => "text",
            (false, Some(_)) => "Arrow",
        }
    }

    pub fn feed(&mut self, bytes: &[u8]) {
        self.rows.feed(bytes);
    }

    /// Problems found since the last call that do not end the run.
    pub fn take_remarks(&mut self) -> Diagnostics {
        std::mem::take(&mut self.remarks)
    }

    /// Passes the rows that have arrived to `take` until it breaks; with `ended` no others will follow.
    ///
    /// # Errors
    /// The first row without a fix, missing columns, and everything that [`RowDecoder::next_block`] rejects.
    pub fn decode(&mut self, ended: bool, take: &mut TakeFix) -> Result<()> {
        let mut fields = Vec::new();
        loop {
            let block = self.rows.next_block(BLOCK_ROWS, ended)?;
            let mut begin = 0;
            if self.layout.is_none() && (block.is_some() || self.rows.fields().is_some()) {
                let first = block.as_ref().map(|block| block.row(0, &mut fields));
                begin = usize::from(self.begin(first.as_ref())?);
            }
            let Some(block) = block else { return self.end(ended) };
            let Some(layout) = &self.layout else { return Ok(()) };
            let time = layout.columns[PoseColumn::Time as usize].unwrap_or_default();
            for index in begin..block.len() {
                let row = block.row(index, &mut fields);
                let numbers = layout.read(&row).map_err(|e| e.with_help(""))?;
                let stated = self.times.as_mut().map(|(times, used)| {
                    *used += 1;
                    times.get(*used - 1).copied()
                });
                let Some(fix) = self.fix(layout, numbers, stated) else {
                    let message = format!("there is no time for this pose in {TIMES_FILE} beside the file");
                    return Err(row.error(None, message).with_help(""));
                };
                if self.camera.as_mut().is_some_and(|camera| camera.finds(&fix)) {
                    self.camera = None;
                    let RowError { place, message } = row.error(None, CAMERA);
                    if matches!(layout.attitude, AttitudeColumns::Matrix(_)) {
                        return Err(RowError { place, message }.with_help(CAMERA_HELP));
                    }
                    self.remarks.warn(Some(place), message).help(CAMERA_HELP);
                }
                if take(self.name(), fix, RecordPlace::Row(&row, time)).is_break() {
                    return Ok(());
                }
            }
        }
    }

    fn end(&mut self, ended: bool) -> Result<()> {
        if let Some((times, used)) = &self.times
            && ended
            && *used < times.len()
        {
            let message = format!("{TIMES_FILE} beside the file has {} times for {used} poses", times.len());
            self.remarks.warn(Some(Place::of_file(&self.path)), message);
            self.times = None;
        }
        Ok(())
    }

    /// Finds the columns; returns whether the first row names them.
    fn begin(&mut self, first: Option<&Row>) -> Result<bool> {
        let stated = StatedColumns::of(&self.rows, first).map_err(|e| e.with_help(""))?;
        self.helios |= stated.has_directives && self.settings.format.is_none();
        let line = first.filter(|_| self.rows.fields().is_none());
        let line_place = line.map(|row| row.error(None, "").place);
        let place = stated.header_place().or(line_place.clone());
        let layout = self.choose_layout(&stated, first.map(Row::separator)).and_then(|layout| {
            self.choose_axes(&layout)?;
            Ok(layout)
        });
        let mut layout = layout.map_err(|NoLayout { error, help, is_of_words }| {
            let place = if is_of_words { stated.words.clone() } else { place.clone() };
            let place = place.unwrap_or_else(|| Place::of_file(&self.path));
            let mut problems = Diagnostics::default();
            problems.error(Some(place), error.to_string()).because_of(error).help(help);
            Error::Input(Box::new(problems))
        })?;
        if self.settings.columns.is_none() {
            layout.report_unread(place, &mut self.remarks);
        }
        if line.is_some() && !stated.has_header_row && layout.width.is_none() {
            let is_chosen_by_number =
                self.settings.columns.iter().flatten().any(|column| column.contains('='));
            let mut found = Diagnostics::default();
            layout = layout.with_width(stated.first.len(), line_place.clone(), &mut found);
            if !is_chosen_by_number {
                self.remarks.extend(found);
            }
        }
        self.read_nanoseconds(&mut layout, &stated, line_place);
        self.layout = Some(layout);
        let has_no_number = || !stated.first.iter().any(|text| is_number(text));
        let is_text = !stated.first.is_empty();
        Ok(stated.has_header_row || is_text && self.settings.columns.is_some() && has_no_number())
    }

    /// Chooses by precedence: the user's columns, the stream's heading, a `#HEADER` directive, the default
    /// orders.
    fn choose_layout(
        &mut self,
        stated: &StatedColumns,
        separator: Option<Separator>,
    ) -> std::result::Result<PoseLayout, NoLayout> {
        use PoseColumn::{Pitch, Roll, Time, X, Y, Yaw, Z};
        let time = stated.directives.time_column;
        let mut layout = if let Some(columns) = &self.settings.columns {
            PoseLayout::chosen(columns)?
        } else if let Some(header) = stated.header() {
            header?
        } else if stated.words.is_some() {
            let error = PoseLayoutError::NoNames;
            return Err(NoLayout { error, help: NAME_COLUMNS, is_of_words: true });
        } else if let Some(layout) = &stated.directives.layout {
            layout.clone()
        } else if time.is_some() {
            PoseLayout::in_order(&POSE_COLUMNS, time)
        } else if self.helios || self.settings.format.is_none() && is_helios_output(&stated.first, separator)
        {
            self.helios = true;
            PoseLayout::in_order(&[X, Y, Z, Time, Roll, Pitch, Yaw], None)
        } else {
            self.of_numbers(stated)?
        };
        if !stated.has_header() && self.settings.columns.is_none() {
            layout.set_time(time);
        }
        match self.times {
            Some(_) => Ok(layout),
            None => Ok(layout.complete(&POSE_COLUMNS)?),
        }
    }

    /// The layout of lines of numbers without names.
    fn of_numbers(&mut self, stated: &StatedColumns) -> std::result::Result<PoseLayout, NoLayout> {
        use PoseColumn::{Pitch, Roll, Time, X, Y, Yaw, Z};
        let (numbers, place) = (&stated.numbers, Some(Place::of_file(&self.path)));
        match recognise(numbers) {
            Numbers::Unknown => Ok(PoseLayout::in_order(&[Time, X, Y, Z, Roll, Pitch, Yaw], None)),
            Numbers::TooMany(count) => Err(PoseLayoutError::Count(count).into()),
            Numbers::QuaternionWithoutTime => Err(NoLayout {
                error: PoseLayoutError::QuaternionWithoutTime,
                help: NAME_OR_ADD_TIMES,
                is_of_words: false,
            }),
            Numbers::TimedQuaternion => {
                let message = "without names, read as time, x, y, z, qx, qy, qz, qw";
                let has_nanoseconds = numbers.first().is_some_and(|time| *time >= MIN_NANOSECONDS);
                if has_nanoseconds || is_upright_with_w_first(numbers) {
                    self.remarks.warn(place, format!("{message}; EuRoC has qw before qx")).help(NAME_W_FIRST);
                } else {
                    self.remarks.note(place, message);
                }
                Ok(PoseLayout::tum())
            }
            Numbers::Matrix => {
                self.times = Some((self.times_beside()?, 0));
                self.remarks
                    .note(place, format!("3 × 4 matrices, with the times of {TIMES_FILE} beside the file"));
                Ok(PoseLayout::matrix(0, 3))
            }
            Numbers::TimedMatrix(rows) => {
                self.remarks.note(place, format!("without names, read as time and {rows} × 4 matrices"));
                Ok(PoseLayout::matrix(1, rows))
            }
        }
    }

    /// The times of the file `times.txt` next to matrices that have none.
    fn times_beside(&self) -> std::result::Result<Vec<f64>, NoLayout> {
        let missing = |error| NoLayout { error, help: ADD_TIMES, is_of_words: false };
        let unread = |what: String| missing(PoseLayoutError::Times { what });
        let path = self.path.with_file_name(TIMES_FILE);
        let is_file = self.settings.content.is_none() && reads::is_file(&self.path) && reads::is_file(&path);
        if !is_file {
            return Err(missing(PoseLayoutError::MatrixWithoutTime));
        }
        let text = read_text(&path, MAX_TIMES_BYTES).map_err(|e| unread(e.to_string()))?;
        let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
        let times = lines.map(|line| line.parse::<f64>().map_err(|_| line));
        times.collect::<std::result::Result<_, _>>().map_err(|line| {
            unread(format!("{}: expected a time in each line, found `{line}`", path.display()))
        })
    }

    /// Chooses the meaning of the angles, or the axes of quaternions and matrices.
    fn choose_axes(&mut self, layout: &PoseLayout) -> std::result::Result<(), NoLayout> {
        let chosen = self.settings.rotation;
        let refuse = |what, help| {
            Err(NoLayout { error: PoseLayoutError::Convention { what }, help, is_of_words: false })
        };
        if layout.attitude == AttitudeColumns::Angles {
            let default = if self.helios { AngleConvention::Helios } else { AngleConvention::Heading };
            self.rotation = chosen.unwrap_or(default);
            return match self.rotation {
                AngleConvention::Camera => {
                    refuse("`camera` is a convention of quaternions and matrices, not of angles", "")
                }
                _ => Ok(()),
            };
        }
        self.rotation = chosen.unwrap_or(AngleConvention::Ros);
        let is_matrix = matches!(layout.attitude, AttitudeColumns::Matrix(_));
        self.axes = FileAxes::of(self.rotation, is_matrix);
        self.camera = chosen.is_none().then(CameraCheck::default);
        match self.axes {
            Some(_) => Ok(()),
            None => refuse(
                "the chosen --trajectory-rotation is a convention of angles, the file has quaternions or \
                 matrices",
                "choose ros, heading, canonical or camera",
            ),
        }
    }

    /// Reads times without a unit as nanoseconds if they are too large for seconds, or if they are integers
    /// below a heading of EuRoC or ROS.
    fn read_nanoseconds(&mut self, layout: &mut PoseLayout, stated: &StatedColumns, place: Option<Place>) {
        let time = PoseColumn::Time as usize;
        let text = layout.columns[time].and_then(|column| stated.first.get(column));
        let first = text.and_then(|text| text.parse::<f64>().ok()).unwrap_or_default();
        let is_large = (MIN_NANOSECONDS..MAX_NANOSECONDS).contains(&first);
        let is_integer = text.is_some_and(|text| text.bytes().all(|b| b.is_ascii_digit()));
        if layout.factors[time].is_none() && (is_large || is_integer && layout.has_ros_names) {
            layout.factors[time] = Some(1e-9);
            let reason = if is_large { "too large for seconds" } else { "integers below a heading of ROS" };
            let message = format!("times without a unit are {reason} and are read as nanoseconds");
            self.remarks.note(place, message);
        }
    }

    /// The fix of a row; `stated` is its time in a separate file, if there is one.
    fn fix(&self, layout: &PoseLayout, numbers: PoseNumbers, stated: Option<Option<f64>>) -> Option<Fix> {
        let PoseNumbers { values, rotation } = numbers;
        let [time, roll, pitch, yaw, x, y, z] = layout.in_si(values, self.settings.degrees);
        let has_unit = |angle: &PoseColumn| layout.factors[*angle as usize].is_some();
        let unitless = rotation.is_none() && !ANGLES.iter().any(has_unit);
        let (attitude, position) = match rotation.zip(self.axes) {
            Some((rotation, axes)) => (axes.attitude(rotation), axes.position([x, y, z])),
            None => (attitude(self.rotation, roll, pitch, yaw), [x, y, z]),
        };
        Some(Fix {
            unitless_angles: unitless.then(|| ANGLES.map(|angle| values[angle as usize])),
            time: stated.unwrap_or(Some(time))?,
            place: if layout.geographic {
                FixPlace::Geographic([y, x, z])
            } else {
                FixPlace::Local(position)
            },
            attitude,
        })
    }
}

/// Why no columns are found.
struct NoLayout {
    error: PoseLayoutError,
    help: &'static str,
    /// True if the problem is in the last line of words before the first pose.
    is_of_words: bool,
}

impl From<PoseLayoutError> for NoLayout {
    fn from(error: PoseLayoutError) -> NoLayout {
        NoLayout { error, help: NAME_COLUMNS, is_of_words: false }
    }
}

fn attitude(convention: AngleConvention, roll: f64, pitch: f64, yaw: f64) -> Rotation {
    match convention {
        AngleConvention::Heading => Rotation::of_heading(roll, pitch, yaw),
        AngleConvention::Yaw => Rotation::of_heading(roll, pitch, FRAC_PI_2 - yaw),
        AngleConvention::Ros => Rotation::of_heading(roll, -pitch, FRAC_PI_2 - yaw),
        AngleConvention::Helios => composed(RotationSpec::Arinc705, roll, pitch, yaw),
        AngleConvention::Canonical | AngleConvention::Camera => {
            composed(RotationSpec::Canonical, roll, pitch, yaw)
        }
    }
}

fn is_helios_output(first: &[String], separator: Option<Separator>) -> bool {
    let decimals = |text: &str| text.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    separator == Some(Separator::Blanks)
        && first.len() == HELIOS_DECIMALS.len()
        && first.iter().zip(HELIOS_DECIMALS).all(|(text, expected)| decimals(text) == expected)
}

#[cfg(test)]
mod tests;
