//! Reads the trajectory files of interpolated platforms (spec input-formats §2.8).

use super::course::reported_angles;
use super::interpolated::composed;
use super::layout::{Layout, is_header};
use super::poses::{Fix, FixPlace, Frame, Pose, Problem, read_binary};
use super::rows::{QUANTITIES, Quantity, Separator};
use super::table::{PoseValues, TrajectoryTable, filter_slopes, near};
use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use crate::geom::radians;
use crate::survey::{Interpolated, TrajectoryFile};
use std::path::Path;

/// More problems than these are counted, not listed.
const MOST_PROBLEMS: usize = 20;

/// Reads all files of `settings` into one table in world coordinates and radians. Problems of the files go into `problems`
/// with line and column, all of a file at once; `None` if there were any that end the run.
///
/// # Errors
/// Files that cannot be read.
pub fn read_trajectories(
    settings: &Interpolated,
    problems: &mut Diagnostics,
) -> Result<Option<TrajectoryTable>> {
    let mut table = Vec::new();
    let mut usable = true;
    let mut frame = Frame::of_grid(settings.grid);
    for (i, file) in settings.files.iter().enumerate() {
        let bytes = std::fs::read(&file.path).map_err(|e| Error::io("read", &file.path, e))?;
        let thinned = |rows| {
            if i == 0 && file.slope_filter > 0.0 { thinned(rows, file.slope_filter) } else { rows }
        };
        if let Some(read) = read_binary(&file.path, &bytes, &mut frame) {
            match read.and_then(|poses| at_least_two(&file.path, poses)) {
                Ok(poses) => table.extend(thinned(angle_rows(&poses, settings))),
                Err(found) => {
                    problems.extend(found);
                    usable = false;
                }
            }
            continue;
        }
        let text = String::from_utf8_lossy(&bytes);
        let Some((rows, layout)) = read_rows(file, &text, settings.position_only, problems) else {
            usable = false;
            continue;
        };
        let rows = thinned(rows).into_iter().map(|(t, v)| in_radians(t, v, &layout, settings.degrees));
        if layout.geographic {
            match rows.map(|(time, values)| projected(time, values, settings, &mut frame)).collect() {
                Ok::<Vec<Pose>, Problem>(poses) => table.extend(angle_rows(&poses, settings)),
                Err(problem) => {
                    problems
                        .error(None, format!("{}: {}", file.path.display(), problem.message))
                        .help(problem.help);
                    usable = false;
                }
            }
        } else {
            table.extend(rows);
        }
    }
    if settings.files.is_empty() {
        problems.error(None, "an interpolated platform needs a trajectory file");
        usable = false;
    }
    Ok(if usable { TrajectoryTable::new(table) } else { None })
}

fn at_least_two(path: &Path, poses: Vec<Pose>) -> std::result::Result<Vec<Pose>, Diagnostics> {
    if poses.len() >= 2 {
        return Ok(poses);
    }
    let mut found = Diagnostics::default();
    found.error(None, format!("{} holds {} poses, expected at least 2", path.display(), poses.len()));
    Err(found)
}

/// A row whose x and y are longitude and latitude as a pose on the grid.
fn projected(
    time: f64,
    [roll, pitch, yaw, longitude, latitude, height]: PoseValues,
    settings: &Interpolated,
    frame: &mut Frame,
) -> std::result::Result<Pose, Problem> {
    let attitude = composed(settings.rotation_spec, roll, pitch, yaw);
    let place = FixPlace::Geographic([latitude, longitude, height]);
    frame.pose(&Fix { time, place, attitude, unitless_angles: None })
}

/// Poses as rows of the table: angles as the survey composes them, each near the one before it so that nothing turns about.
fn angle_rows(poses: &[Pose], settings: &Interpolated) -> Vec<(f64, PoseValues)> {
    let mut rows: Vec<(f64, PoseValues)> = Vec::with_capacity(poses.len());
    for pose in poses {
        let [roll, pitch, yaw] = match settings.position_only {
            true => [0.0; 3],
            false => reported_angles(pose.attitude, Some(settings.rotation_spec)),
        };
        let p = pose.position;
        let mut values = [roll, pitch, yaw, p.x, p.y, p.z];
        if let Some((_, before)) = rows.last() {
            near(&mut values, before);
        }
        rows.push((pose.time, values));
    }
    rows
}

fn thinned(mut rows: Vec<(f64, PoseValues)>, threshold: f64) -> Vec<(f64, PoseValues)> {
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    filter_slopes(&rows, threshold)
}

fn in_radians(time: f64, mut values: PoseValues, layout: &Layout, degrees: bool) -> (f64, PoseValues) {
    for (i, quantity) in [Quantity::Roll, Quantity::Pitch, Quantity::Yaw].into_iter().enumerate() {
        values[i] = match layout.factors[quantity as usize] {
            Some(factor) => values[i] * factor,
            None if degrees => radians(values[i]),
            None => values[i],
        };
    }
    if layout.geographic {
        for (i, quantity) in [(3, Quantity::X), (4, Quantity::Y)] {
            values[i] = match layout.factors[quantity as usize] {
                Some(factor) => values[i] * factor,
                None if degrees => radians(values[i]),
                None => values[i],
            };
        }
    }
    (time * layout.factors[Quantity::Time as usize].unwrap_or(1.0), values)
}

/// What the comments of a file say about its columns.
#[derive(Default)]
struct Directives {
    layout: Option<Layout>,
    time_column: Option<usize>,
}

/// The rows as they stand in the file (time; roll, pitch, yaw, x, y, z) and their layout.
fn read_rows(
    file: &TrajectoryFile,
    text: &str,
    position_only: bool,
    problems: &mut Diagnostics,
) -> Option<(Vec<(f64, PoseValues)>, Layout)> {
    let path = &file.path;
    let mut directives = Directives::default();
    let mut reading: Option<(Layout, Separator)> = None;
    let mut rows = Vec::new();
    let mut wrong = 0;
    for (number, line) in text.lines().enumerate() {
        let place = |at| Some(Place::in_line(path, number + 1, line, at));
        let content = line.trim_start();
        if content.is_empty() {
            continue;
        }
        if content.starts_with('#') {
            if let Err(e) = directives.take(content) {
                problems.error(place(0..line.len()), e);
                return None;
            }
            continue;
        }
        let (layout, separator) = match &reading {
            Some(known) => known,
            None => {
                let separator = file.separator.map_or_else(|| Separator::guess(line), Separator::named);
                let header = is_header(line, separator);
                let layout =
                    choose_layout(file, &directives, header.then_some((line, separator)), position_only);
                match layout {
                    Ok(layout) => reading = Some((layout, separator)),
                    Err(message) => {
                        problems.error(place(0..line.len()), message).help(
                            "give tIndex, xIndex … in the survey or a line `#HEADER: \"t\", \"roll\", \"pitch\", \
                             \"yaw\", \"x\", \"y\", \"z\"` in the file",
                        );
                        return None;
                    }
                }
                if header {
                    continue;
                }
                reading.as_ref()?
            }
        };
        match layout.values(line, *separator) {
            Ok([t, values @ ..]) => rows.push((t, values)),
            Err(e) => {
                wrong += 1;
                if wrong <= MOST_PROBLEMS {
                    problems.error(place(e.at), e.message);
                }
            }
        }
    }
    finish(path, rows, reading, wrong, problems)
}

fn finish(
    path: &Path,
    rows: Vec<(f64, PoseValues)>,
    reading: Option<(Layout, Separator)>,
    wrong: usize,
    problems: &mut Diagnostics,
) -> Option<(Vec<(f64, PoseValues)>, Layout)> {
    if wrong > MOST_PROBLEMS {
        problems.error(None, format!("{} more wrong rows in {}", wrong - MOST_PROBLEMS, path.display()));
    }
    if wrong > 0 {
        return None;
    }
    if rows.len() < 2 {
        let message = format!("{} holds {} poses, expected at least 2", path.display(), rows.len());
        problems.error(None, message);
        return None;
    }
    Some((rows, reading?.0))
}

impl Directives {
    fn take(&mut self, comment: &str) -> Result<(), String> {
        if let Some(names) = comment.strip_prefix("#HEADER:") {
            let separator = Separator::guess(names);
            self.layout = Some(Layout::named(names, &separator.split(names)).map_err(|e| e.message)?);
        } else if let Some(column) = comment.strip_prefix("#TIME_COLUMN:") {
            let column = column.trim();
            self.time_column = Some(
                column.parse().map_err(|_| format!("expected the number of a column, found `{column}`"))?,
            );
        }
        Ok(())
    }
}

/// The survey's column numbers win over the file's `#HEADER`, that over a first line of names, and that over the order
/// roll, pitch, yaw, x, y, z around a `#TIME_COLUMN`.
fn choose_layout(
    file: &TrajectoryFile,
    directives: &Directives,
    header: Option<(&str, Separator)>,
    position_only: bool,
) -> Result<Layout, String> {
    let all: &[Quantity] = &QUANTITIES;
    let wanted = if position_only { &[Quantity::Time, Quantity::X, Quantity::Y, Quantity::Z] } else { all };
    let mut layout = if let Some(columns) = file.columns {
        Layout::numbered(columns)
    } else if let Some(layout) = &directives.layout {
        let mut layout = layout.clone();
        if let Some(time) = directives.time_column {
            layout.columns[Quantity::Time as usize] = Some(time);
        }
        layout
    } else if let Some((line, separator)) = header {
        Layout::named(line, &separator.split(line)).map_err(|e| e.message)?
    } else if let Some(time) = directives.time_column {
        around_time(time, wanted)
    } else {
        return Err("nothing says which column holds the time".to_owned());
    };
    if position_only {
        for angle in [Quantity::Roll, Quantity::Pitch, Quantity::Yaw] {
            layout.columns[angle as usize] = None;
        }
    }
    let missing = layout.missing(wanted);
    if missing.is_empty() { Ok(layout) } else { Err(format!("no column for {}", missing.join(", "))) }
}

/// The wanted quantities in order in the columns that time leaves.
fn around_time(time: usize, wanted: &[Quantity]) -> Layout {
    let mut layout = Layout::in_order([]);
    layout.columns[Quantity::Time as usize] = Some(time);
    let others = wanted.iter().filter(|q| **q != Quantity::Time);
    for (quantity, column) in others.zip((0..).filter(|c| *c != time)) {
        layout.columns[*quantity as usize] = Some(column);
    }
    layout
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn file() -> TrajectoryFile {
        TrajectoryFile { path: PathBuf::from("f.txt"), columns: None, separator: None, slope_filter: 0.0 }
    }

    fn rows(file: &TrajectoryFile, text: &str) -> Result<Vec<(f64, PoseValues)>, String> {
        let mut d = Diagnostics::default();
        let found = read_rows(file, text, false, &mut d);
        if d.is_fatal(false) { Err(d.render(false)) } else { Ok(found.unwrap().0) }
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
        assert!(report.contains("f.txt:3:1") && report.contains("column 4"), "{report}");
    }

    #[test]
    fn files_without_a_time_column_or_poses_are_refused() {
        assert!(rows(&file(), "1,2,3,4,5,6,7\n").unwrap_err().contains("which column holds the time"));
        assert!(rows(&file(), "#TIME_COLUMN: 0\n1,2,3,4,5,6,7\n").unwrap_err().contains("holds 1 poses"));
        assert!(rows(&file(), "#HEADER: \"t\", \"x\"\n1,2\n").unwrap_err().contains("no column for roll"));
        assert!(rows(&file(), "#TIME_COLUMN: x\n1,2\n").unwrap_err().contains("number of a column"));
    }

    #[test]
    fn angles_are_degrees_unless_told_otherwise() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        std::fs::write(&path, "#TIME_COLUMN: 0\n0,90,0,0,1,2,3\n1,90,0,0,1,2,3\n").unwrap();
        for (degrees, wanted) in [(true, std::f64::consts::FRAC_PI_2), (false, 90.0)] {
            let settings = Interpolated {
                rotation_spec: crate::survey::RotationSpec::Canonical,
                position_only: false,
                degrees,
                sync_gps_time: false,
                files: vec![TrajectoryFile { path: path.clone(), ..file() }],
                grid: crate::survey::Grid::FirstFix,
            };
            let table = read_trajectories(&settings, &mut Diagnostics::default()).unwrap().unwrap();
            assert!((table.rows()[0].values[0] - wanted).abs() < 1e-12);
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "[#HTIME:_0-9a-z,; \t\n.\"-]{0,200}") {
            let _ = rows(&file(), &text);
        }
    }
}
