//! Reads the trajectory files of interpolated platforms (spec input-formats §2.8).

use super::attitude::FileAxes;
use super::course::reported_angles;
use super::header::StatedColumns;
use super::interpolated::composed;
use super::layout::{ANGLES, AttitudeColumns, POSE_COLUMNS, PoseColumn, PoseLayout, SCHEMA};
use super::layout_error::PoseLayoutError;
use super::poses::decoder::read_binary;
use super::poses::fix::{Fix, FixPlace, Pose, RecordError};
use super::poses::georeference::Georeference;
use super::table::{PoseValues, TrajectoryTable, filter_slopes, unwrap_angles};
use std::borrow::Cow;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity;
use vlscan_survey::{AngleConvention, Interpolated, RotationSpec, TrajectoryFile};
use vlscan_tables::input;
use vlscan_tables::input::arrow::{ArrowDetection, detect_arrow};
use vlscan_tables::input::rows::{Row, RowDecoder};

/// Maximum size of a file, bytes.
const MAX_FILE_BYTES: u64 = 1 << 33;
/// Number of bytes that are decoded together.
const PIECE_BYTES: usize = 1 << 20;
/// Maximum number of wrong rows that are listed; further ones are only counted.
const MAX_LISTED_ROWS: usize = 20;

/// Reads all files of `settings` into one table in world coordinates and radians. All problems of a file go
/// into `problems` with line and column; `None` if any of them prevents the run.
///
/// # Errors
/// Files that cannot be read.
pub fn read_trajectories(
    settings: &Interpolated,
    problems: &mut Diagnostics,
) -> Result<Option<TrajectoryTable>> {
    let mut table = Vec::new();
    let mut usable = true;
    let mut georeference = Georeference::of_grid(settings.grid);
    for (i, file) in settings.files.iter().enumerate() {
        let bytes = match &file.content {
            Some(content) => Cow::Borrowed(&content[..]),
            None => {
                let read = input::read_file(&file.path, MAX_FILE_BYTES);
                Cow::Owned(read.map_err(|e| Error::open(&file.path, e))?)
            }
        };
        let threshold = if i == 0 { file.slope_filter } else { 0.0 };
        match read_file(file, &bytes, settings, &mut georeference, threshold, problems) {
            Some(rows) => {
                usable &= check_rows(&file.path, &rows, problems);
                table.extend(rows);
            }
            None => usable = false,
        }
    }
    if settings.files.is_empty() {
        problems.error(None, "a platform of type interpolated needs a trajectory file");
        usable = false;
    }
    let table = TrajectoryTable::new(table).filter(|_| usable);
    Ok(table.map(|table| table.in_zone(georeference.projected_zone())))
}

/// The rows of one file, thinned if `threshold` is above 0; `None` if it has problems.
fn read_file(
    file: &TrajectoryFile,
    bytes: &[u8],
    settings: &Interpolated,
    georeference: &mut Georeference,
    threshold: f64,
    problems: &mut Diagnostics,
) -> Option<Vec<(f64, PoseValues)>> {
    if let Some(read) = read_binary(&file.path, bytes, georeference) {
        let poses = match read {
            Ok(poses) => poses,
            Err(e) => return report(e, problems),
        };
        check_count(&file.path, poses.len(), problems)?;
        if file.columns.is_some() || file.separator.is_some() {
            let message = "tIndex, xIndex … and the separator have no effect: the file is not text";
            problems.warn(Some(Place::of_file(&file.path)), message);
        }
        return Some(thin(pose_rows(&poses, settings), threshold));
    }
    let spec = (!settings.position_only).then_some(settings.rotation_spec);
    let (rows, layout) = read_rows(file, bytes, spec, problems)?;
    let rows = thin(rows, threshold).into_iter().map(|(time, [roll, pitch, yaw, x, y, z])| {
        let [time, values @ ..] = layout.in_si([time, roll, pitch, yaw, x, y, z], settings.degrees);
        (time, values)
    });
    if !layout.geographic {
        return Some(rows.collect());
    }
    match rows
        .map(|(time, values)| project(time, values, settings, georeference))
        .collect::<Result<Vec<_>, _>>()
    {
        Ok(poses) => Some(pose_rows(&poses, settings)),
        Err(RecordError { message, help, .. }) => {
            problems.error(None, format!("{}: {message}", file.path.display())).help(help);
            None
        }
    }
}

/// Adds the problems of a file that cannot be decoded.
fn report<T>(error: Error, problems: &mut Diagnostics) -> Option<T> {
    match error {
        Error::Input(found) => problems.extend(*found),
        other => {
            problems.error(None, other.to_string());
        }
    }
    None
}

/// Checks times and positions.
fn check_rows(path: &Path, rows: &[(f64, PoseValues)], problems: &mut Diagnostics) -> bool {
    let is_valid = |(time, [_, _, _, position @ ..]): &&(f64, PoseValues)| {
        quantity::TIME.contains(*time) && position.iter().all(|p| quantity::COORDINATE.contains(*p))
    };
    let Some((time, [_, _, _, x, y, z])) = rows.iter().find(|row| !is_valid(row)) else { return true };
    let message = format!(
        "{}: a pose at time {}, x {}, y {}, z {}, expected {} and {}",
        path.display(),
        quantity::number(*time),
        quantity::number(*x),
        quantity::number(*y),
        quantity::number(*z),
        quantity::TIME.expected,
        quantity::COORDINATE.expected
    );
    problems.error(None, message);
    false
}

fn check_count(path: &Path, poses: usize, problems: &mut Diagnostics) -> Option<()> {
    if poses < 2 {
        problems.error(None, format!("{} holds {poses} poses, expected at least 2", path.display()));
    }
    (poses >= 2).then_some(())
}

/// A row whose x and y are longitude and latitude as a pose on the grid.
fn project(
    time: f64,
    [roll, pitch, yaw, longitude, latitude, height]: PoseValues,
    settings: &Interpolated,
    georeference: &mut Georeference,
) -> Result<Pose, RecordError> {
    let attitude = composed(settings.rotation_spec, roll, pitch, yaw);
    let place = FixPlace::Geographic([latitude, longitude, height]);
    georeference.pose(&Fix { time, place, attitude, unitless_angles: None })
}

/// Poses as rows of the table: angles as the survey composes them, each within half a turn of the one before.
fn pose_rows(poses: &[Pose], settings: &Interpolated) -> Vec<(f64, PoseValues)> {
    let mut rows: Vec<(f64, PoseValues)> = Vec::with_capacity(poses.len());
    for pose in poses {
        let [roll, pitch, yaw] = match settings.position_only {
            true => [0.0; 3],
            false => reported_angles(pose.attitude, Some(settings.rotation_spec)),
        };
        let p = pose.position;
        let mut values = [roll, pitch, yaw, p.x, p.y, p.z];
        if let Some((_, before)) = rows.last() {
            unwrap_angles(&mut values, before);
        }
        rows.push((pose.time, values));
    }
    rows
}

fn thin(mut rows: Vec<(f64, PoseValues)>, threshold: f64) -> Vec<(f64, PoseValues)> {
    if threshold > 0.0 {
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows = filter_slopes(&rows, threshold);
    }
    rows
}

/// The rows as they are written in the file (time; roll, pitch, yaw, x, y, z) and their layout. Quaternions
/// become angles in the composition `spec`; without it only positions are read.
fn read_rows(
    file: &TrajectoryFile,
    bytes: &[u8],
    spec: Option<RotationSpec>,
    problems: &mut Diagnostics,
) -> Option<(Vec<(f64, PoseValues)>, PoseLayout)> {
    if detect_arrow(bytes) != ArrowDetection::Arrow && bytes.contains(&0) {
        let place = Place::of_file(&file.path);
        problems.error(Some(place), "expected a trajectory as text, SBET or TerraScan, found other bytes");
        return None;
    }
    let mut decoder = RowDecoder::new(&file.path, "a pose", file.separator).with_preamble();
    let (mut layout, mut fields) = (None, Vec::new());
    let (mut rows, mut wrong): (Vec<(f64, PoseValues)>, usize) = (Vec::new(), 0);
    // As programs of robotics write quaternions.
    let axes = FileAxes::of(AngleConvention::Ros, false);
    let mut pieces = bytes.chunks(PIECE_BYTES).peekable();
    while let Some(piece) = pieces.next() {
        decoder.feed(piece);
        loop {
            let block = match decoder.next_block(usize::MAX, pieces.peek().is_none()) {
                Ok(Some(block)) => block,
                Ok(None) => break,
                Err(e) => return report(e, problems),
            };
            let mut begin = 0;
            let layout = match &layout {
                Some(layout) => layout,
                None => {
                    let first = block.row(0, &mut fields);
                    let (found, has_header) = find_layout(file, &decoder, &first, spec.is_none(), problems)?;
                    begin = usize::from(has_header);
                    layout.insert(found)
                }
            };
            for index in begin..block.len() {
                match layout.read(&block.row(index, &mut fields)) {
                    Ok(numbers) => {
                        let [time, mut values @ ..] = numbers.values;
                        if let (Some(rotation), Some(axes), Some(spec)) = (numbers.rotation, axes, spec) {
                            let angles = reported_angles(axes.attitude(rotation), Some(spec));
                            values[..3].copy_from_slice(&angles);
                            if let Some((_, before)) = rows.last() {
                                unwrap_angles(&mut values, before);
                            }
                        }
                        rows.push((time, values));
                    }
                    Err(e) => {
                        wrong += 1;
                        if wrong <= MAX_LISTED_ROWS {
                            problems.error(Some(e.place), e.message);
                        }
                    }
                }
            }
        }
    }
    if wrong > MAX_LISTED_ROWS {
        let more = wrong - MAX_LISTED_ROWS;
        problems.error(None, format!("{more} more wrong rows in {}", file.path.display()));
    }
    if wrong > 0 {
        return None;
    }
    check_count(&file.path, rows.len(), problems)?;
    Some((rows, layout?))
}

/// The layout of a file, and whether its first row names the columns.
fn find_layout(
    file: &TrajectoryFile,
    decoder: &RowDecoder,
    first: &Row,
    position_only: bool,
    problems: &mut Diagnostics,
) -> Option<(PoseLayout, bool)> {
    let place = || Some(first.error(None, "").place);
    let stated = match StatedColumns::of(decoder, Some(first)) {
        Ok(stated) => stated,
        Err(e) => return report(e.with_help(""), problems),
    };
    match choose_layout(file, &stated, position_only) {
        Ok(mut layout) => {
            let named = match stated.header() {
                Some(header) => header.ok(),
                None => stated.directives.layout.clone(),
            };
            warn_of_other_columns(&layout, named, place(), problems);
            layout.report_unread(stated.header_place().or(place()), problems);
            if layout.width.is_none() && decoder.fields().is_none() {
                let mut found = Diagnostics::default();
                layout = layout.with_width(stated.first.len(), place(), &mut found);
                if file.columns.is_none() {
                    problems.extend(found);
                }
            }
            Some((layout, stated.has_header_row))
        }
        Err(error) => {
            let place = stated.words.clone().or(stated.header_place()).or(place());
            let help = match file.content {
                Some(_) => SCHEMA.help,
                None => {
                    "give tIndex, xIndex … in the survey or a line `#HEADER: \"t\", \"roll\", \"pitch\", \
                     \"yaw\", \"x\", \"y\", \"z\"` in the file"
                }
            };
            problems.error(place, error.to_string()).because_of(error).help(help);
            None
        }
    }
}

/// Warns of column numbers of the survey that contradict the names in the file.
fn warn_of_other_columns(
    layout: &PoseLayout,
    named: Option<PoseLayout>,
    place: Option<Place>,
    problems: &mut Diagnostics,
) {
    if let Some((name, used, named)) = named.and_then(|named| layout.difference(&named)) {
        let message = format!(
            "{name} is read from column {used} as the survey says; the file has it in column {named}, from 0"
        );
        problems.warn(place, message).help("leave out tIndex, xIndex … to read the columns by their names");
    }
}

/// Chooses by precedence: the survey's column numbers, the file's `#HEADER`, a first line of headings, the
/// order roll, pitch, yaw, x, y, z around a `#TIME_COLUMN`.
fn choose_layout(
    file: &TrajectoryFile,
    stated: &StatedColumns,
    position_only: bool,
) -> Result<PoseLayout, PoseLayoutError> {
    use PoseColumn::{Time, X, Y, Z};
    let required: &[PoseColumn] = if position_only { &[Time, X, Y, Z] } else { &POSE_COLUMNS };
    let time = stated.directives.time_column;
    let mut layout = if let Some(columns) = file.columns {
        PoseLayout::numbered(columns)
    } else if let Some(layout) = stated.directives.layout.clone().filter(|_| stated.words.is_none()) {
        let mut layout = layout;
        layout.set_time(time);
        layout
    } else if let Some(header) = stated.header() {
        header?
    } else if stated.words.is_some() {
        return Err(PoseLayoutError::NoNames);
    } else if time.is_some() {
        PoseLayout::in_order(required, time)
    } else {
        return Err(PoseLayoutError::NoTime);
    };
    if position_only {
        ANGLES.iter().for_each(|&angle| layout.columns[angle as usize] = None);
        layout.attitude = AttitudeColumns::Angles;
    }
    if layout.attitude != AttitudeColumns::Angles {
        // Quaternions become angles in radians.
        ANGLES.iter().for_each(|&angle| layout.factors[angle as usize] = Some(1.0));
    }
    layout.complete(required)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn file() -> TrajectoryFile {
        TrajectoryFile {
            path: PathBuf::from("f.txt"),
            content: None,
            columns: None,
            separator: None,
            slope_filter: 0.0,
        }
    }

    fn rows(file: &TrajectoryFile, text: &str) -> Result<Vec<(f64, PoseValues)>, String> {
        let mut d = Diagnostics::default();
        let found = read_rows(file, text.as_bytes(), Some(RotationSpec::Arinc705), &mut d);
        if d.is_fatal(false) { Err(d.text()) } else { Ok(found.unwrap().0) }
    }

    const POSE: PoseValues = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];

    #[test]
    fn columns_come_from_the_survey_the_header_or_the_time_column() {
        let indexed = TrajectoryFile { columns: Some([6, 0, 1, 2, 3, 4, 5]), ..file() };
        assert_eq!(rows(&indexed, "1,2,3,4,5,6,10\n1,2,3,4,5,6,11\n").unwrap()[1], (11.0, POSE));
        let named = "#HEADER: \"x\", \"y\", \"z\", \"t\", \"roll\", \"pitch\", \"yaw\"\n4,5,6,10,1,2,3\n4,5,6,11,1,2,3";
        assert_eq!(rows(&file(), named).unwrap()[0], (10.0, POSE));
        let plain = "time x y z roll pitch yaw\n10 4 5 6 1 2 3\n\n11\t4 5 6 1 2 3\n";
        assert_eq!(rows(&file(), plain).unwrap()[1], (11.0, POSE));
        let ordered = "#TIME_COLUMN: 2\n# a remark\n1;2;10;3;4;5;6\n1;2;11;3;4;5;6\n";
        assert_eq!(rows(&file(), ordered).unwrap()[0], (10.0, POSE));
    }

    #[test]
    fn all_wrong_rows_are_listed_with_their_places() {
        let report = rows(&file(), "#TIME_COLUMN: 0\n1,2,3,x,5,6,7\n1,2,3\n1,2,3,4,5,6,7\n").unwrap_err();
        assert!(report.contains("f.txt:2:7") && report.contains("found `x`"), "{report}");
        assert!(report.contains("f.txt:3:1") && report.contains("3 fields, expected 7"), "{report}");
    }

    #[test]
    fn files_without_a_time_column_or_poses_are_refused() {
        assert!(rows(&file(), "1,2,3,4,5,6,7\n").unwrap_err().contains("no column is named as the time"));
        assert!(rows(&file(), "#TIME_COLUMN: 0\n1,2,3,4,5,6,7\n").unwrap_err().contains("holds 1 poses"));
        assert!(rows(&file(), "#HEADER: \"t\", \"x\"\n1,2\n").unwrap_err().contains("no column for roll"));
        assert!(rows(&file(), "#TIME_COLUMN: x\n1,2\n").unwrap_err().contains("number of a column"));
    }

    #[test]
    fn angles_are_degrees_unless_told_otherwise() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        std::fs::write(&path, "#TIME_COLUMN: 0\n0,90,0,0,1,2,3\n1,90,0,0,1,2,3\n").unwrap();
        for (degrees, expected) in [(true, std::f64::consts::FRAC_PI_2), (false, 90.0)] {
            let settings = Interpolated {
                rotation_spec: vlscan_survey::RotationSpec::Canonical,
                position_only: false,
                degrees,
                sync_gps_time: false,
                files: vec![TrajectoryFile { path: path.clone(), ..file() }],
                grid: vlscan_survey::ProjectionGrid::FirstFix,
            };
            let table = read_trajectories(&settings, &mut Diagnostics::default()).unwrap().unwrap();
            assert!((table.rows()[0].values[0] - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn a_trajectory_in_memory_is_read_like_a_file() {
        let text = "time,x,y,z,roll,pitch,yaw\n0,1,2,3,0.5,0,0\n1,4,5,6,0.5,0,0\n";
        let path = PathBuf::from("<poses>");
        let settings = |content: &str| Interpolated {
            rotation_spec: RotationSpec::Canonical,
            position_only: false,
            degrees: false,
            sync_gps_time: false,
            files: vec![TrajectoryFile {
                path: path.clone(),
                content: Some(content.as_bytes().into()),
                ..file()
            }],
            grid: vlscan_survey::ProjectionGrid::FirstFix,
        };
        let table = read_trajectories(&settings(text), &mut Diagnostics::default()).unwrap().unwrap();
        assert_eq!(table.rows()[1].values, [0.5, 0.0, 0.0, 4.0, 5.0, 6.0]);
        let mut problems = Diagnostics::default();
        let wrong = text.replace(",roll", ",rol");
        assert!(read_trajectories(&settings(&wrong), &mut problems).unwrap().is_none());
        let report = problems.text();
        assert!(report.contains("<poses>") && !report.contains("tIndex"), "{report}");
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "[#HTIME:_0-9a-z,; \t\n.\"-]{0,200}") {
            let _ = rows(&file(), &text);
        }
    }
}
