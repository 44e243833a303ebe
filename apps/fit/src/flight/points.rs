//! The points of the flight line that is fitted.
//!
//! A file is read several times: for its flight lines and strays, again without the strays if there are any,
//! and for the points of one flight line, which are the only ones in memory. Of a stream all points are kept.
//! Of more points than the memory allows, those of some windows of time are kept.

use super::flight_lines::{FlightLine, LineCounter};
use super::windows::Windows;
use crate::limit::PointLimit;
use crate::rows::{Row, Rows, Within, point_bytes};
use std::any::Any;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_formats::{
    Attribute, AttributeSet, FileFacts, LasFacts, NewPart, PointPart, PointRow, PointSink, PositionSteps,
    Selection, StrayFinder, Strays, read_points,
};
use vlscan_geom::DVec3;

/// ASPRS classes of noise, which is not on the ground.
const NOISE: [u8; 2] = [7, 18];

/// The points that are counted or kept.
#[derive(Clone, Copy)]
struct Choice {
    is_las: bool,
    /// Points that do not count.
    left_out: Option<Strays>,
    /// The flight line of the points; `None` for all.
    line: Option<FlightLine>,
    windows: Windows,
}

impl Default for Choice {
    /// All points that count.
    fn default() -> Choice {
        Choice { is_las: false, left_out: None, line: None, windows: Windows::ALL }
    }
}

impl Choice {
    /// The values of a point, if it is chosen. Those of a stream outside of windows are counted.
    fn row(&self, row: &PointRow) -> Option<Row> {
        row_of(row, self.is_las)
            .filter(|row| self.left_out.is_none_or(|strays| !strays.contains(row.position)))
            .filter(|row| self.line.is_none_or(|line| line.contains(row) && self.windows.has(row.time)))
    }
}

/// The values of a point that counts.
fn row_of(row: &PointRow, is_las: bool) -> Option<Row> {
    let is_placed = row.position.is_finite() && row.time.is_finite() && row.scan_angle.abs() < 90.0;
    let counts = is_placed && !row.is_miss && !NOISE.contains(&row.class);
    counts.then(|| Row {
        time: row.time,
        position: row.position,
        angle: row.scan_angle,
        source: row.flight_line(is_las),
        number: row.return_number,
        returns: row.number_of_returns,
        class: row.class,
        channel: row.channel,
    })
}

/// The chosen points of a block.
struct LinePart {
    choice: Choice,
    are_counted: bool,
    /// Their positions, if they are counted.
    positions: Vec<DVec3>,
    rows: Vec<Row>,
}

impl PointPart for LinePart {
    fn add(&mut self, row: &PointRow) {
        let Some(row) = self.choice.row(row) else { return };
        if self.are_counted {
            self.positions.push(row.position);
        }
        self.rows.push(row);
    }

    fn takes_names(&self) -> bool {
        true
    }

    fn clear(&mut self) {
        self.positions.clear();
        self.rows.clear();
    }
}

/// Takes the points of a cloud.
#[derive(Default)]
struct Sink {
    attributes: AttributeSet,
    wkt: Option<String>,
    steps: Option<PositionSteps>,
    choice: Choice,
    are_counted: bool,
    are_kept: bool,
    finder: StrayFinder,
    counter: LineCounter,
    /// The points that are kept, with room for this number from the beginning.
    rows: Rows,
    room: usize,
    max_memory: Option<u64>,
    /// True if the memory allows hardly any points.
    is_too_large: bool,
}

impl Sink {
    fn limit(&self) -> PointLimit {
        PointLimit::new(self.max_memory, point_bytes(self.steps.as_ref()))
    }

    fn keep(&mut self, row: &Row) {
        if self.is_too_large || !self.choice.windows.has(row.time) {
            return;
        }
        self.rows.push(row);
        let limit = self.limit();
        while limit.is_exceeded(self.rows.len()) && !self.is_too_large {
            match self.choice.windows.coarser() {
                Some(windows) => {
                    self.choice.windows = windows;
                    self.rows.retain(|row| windows.has(row.time));
                }
                None => self.is_too_large = true,
            }
        }
    }

    fn flow(&self) -> ControlFlow<()> {
        if self.is_too_large { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

impl PointSink for Sink {
    fn start(&mut self, attributes: AttributeSet) {
        self.attributes = attributes;
        self.rows = Rows::with_room(self.room, self.steps);
    }

    fn file(&mut self, facts: &FileFacts) {
        self.choice.is_las = facts.las.is_some();
        self.steps = facts.las.as_ref().map(LasFacts::steps);
    }

    fn crs(&mut self, wkt: &str) {
        self.wkt = Some(wkt.to_owned());
    }

    fn selection(&self) -> Selection {
        use Attribute::{Channel, Class, Leg, NumberOfReturns, ReturnNumber, ScanAngle, Time};
        Selection::Attributes(AttributeSet::of(|attribute| {
            matches!(attribute, Channel | Class | Leg | NumberOfReturns | ReturnNumber | ScanAngle | Time)
        }))
    }

    fn parts(&self) -> Option<NewPart> {
        let Sink { choice, are_counted, .. } = *self;
        Some(Box::new(move || -> Box<dyn PointPart> {
            let (positions, rows) = Default::default();
            Box::new(LinePart { choice, are_counted, positions, rows })
        }))
    }

    fn add_part(&mut self, part: &mut (dyn PointPart + 'static)) -> Result<ControlFlow<()>> {
        let part: &mut dyn Any = part;
        if let Some(part) = part.downcast_ref::<LinePart>() {
            if self.are_counted {
                self.finder.add_all(&part.positions);
                self.counter.add_all(&part.rows);
            }
            if self.are_kept {
                part.rows.iter().for_each(|row| self.keep(row));
            }
        }
        Ok(self.flow())
    }

    fn point(&mut self, row: &PointRow, _object: Option<&str>) -> Result<ControlFlow<()>> {
        let Some(row) = self.choice.row(row) else { return Ok(ControlFlow::Continue(())) };
        if self.are_counted {
            self.finder.add(row.position);
            self.counter.add(&row);
        }
        if self.are_kept {
            self.keep(&row);
        }
        Ok(self.flow())
    }
}

/// A cloud whose flight lines are known.
pub(super) struct Outline {
    pub wkt: Option<String>,
    /// In the order of source and time; the straight parts of lines with turns.
    pub lines: Vec<FlightLine>,
    /// Numbers of points in turns, which are in no line, by source.
    pub turns: BTreeMap<u16, usize>,
    strays: Strays,
    limit: PointLimit,
    /// The points of a stream, which is read once, in these windows.
    rows: Option<Rows>,
    windows: Windows,
    max_memory: Option<u64>,
}

/// The points of a flight line that are fitted.
pub(super) struct LineRows {
    /// By time and return number.
    pub rows: Rows,
    /// The windows of the points.
    pub windows: Windows,
    /// The memory that has limited them.
    pub limit: PointLimit,
}

impl Outline {
    /// Reads the flight lines of a cloud without strays, of which `found` has a warning. Points may take
    /// `max_memory`, bytes; `None` for no limit.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] for clouds without GPS times or scan angles, and for streams if the
    /// memory allows hardly any points.
    pub fn read(path: &Path, max_memory: Option<u64>, found: &mut Diagnostics) -> Result<Outline> {
        let is_stream = path.as_os_str() == "-" || !path.is_file();
        let mut sink = Sink { max_memory, are_counted: true, are_kept: is_stream, ..Sink::default() };
        found.extend(read_points(path, &mut sink)?);
        let limit = sink.limit();
        if sink.is_too_large {
            return Err(limit.error(path));
        }
        for (attribute, what) in [(Attribute::Time, "GPS times"), (Attribute::ScanAngle, "scan angles")] {
            if !sink.attributes.has(attribute) {
                return Err(Error::input_with_help(
                    format!("{} has no {what}, from which a flight is estimated", path.display()),
                    "LAS and LAZ of point formats 1 and 3 to 10 have both",
                ));
            }
        }
        let strays = sink.finder.strays();
        strays.warn(path, "left out", found);
        if strays.count > 0 && !is_stream {
            let choice = Choice { left_out: Some(strays), ..Choice::default() };
            let mut others = Sink { choice, are_counted: true, ..Sink::default() };
            read_points(path, &mut others)?;
            sink.counter = others.counter;
        } else if strays.count > 0 {
            sink.rows.retain(|row| !strays.contains(row.position));
            // Those outside of the windows have been counted with the others.
            if sink.choice.windows == Windows::ALL {
                sink.counter = LineCounter::default();
                sink.rows.iter().for_each(|row| sink.counter.add(&row));
            }
        }
        let Sink { wkt, counter, rows, choice, .. } = sink;
        let (lines, turns) = counter.lines();
        Ok(Outline {
            wkt,
            lines,
            turns,
            strays,
            limit,
            rows: is_stream.then_some(rows),
            windows: choice.windows,
            max_memory,
        })
    }

    /// The points of a flight line.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] if the memory allows hardly any points, and for a file that has
    /// changed.
    pub fn rows_of(self, line: FlightLine, path: &Path) -> Result<LineRows> {
        let Outline { limit, max_memory, strays, .. } = self;
        let (mut rows, windows) = match self.rows {
            Some(mut rows) => {
                rows.retain(|row| line.contains(row));
                (rows, self.windows)
            }
            None => {
                let (points, most) = (line.points as u64, limit.points().max(1));
                let windows = Windows::one_of(points.div_ceil(most));
                let choice = Choice { left_out: Some(strays), line: Some(line), windows, is_las: false };
                let room = usize::try_from(points.min(most)).unwrap_or(0);
                let mut sink = Sink { choice, are_kept: true, room, max_memory, ..Sink::default() };
                read_points(path, &mut sink)?;
                if sink.is_too_large {
                    return Err(limit.error(path));
                }
                (sink.rows, sink.choice.windows)
            }
        };
        if windows == Windows::ALL && rows.len() != line.points {
            return Err(Error::input(format!("{} has changed while it was read", path.display())));
        }
        if rows.is_empty() {
            return Err(limit.error(path));
        }
        rows.sort_by_time(Within::Numbers);
        Ok(LineRows { rows, windows, limit })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The points of the longest flight line of a file of this text, as time, x and return number.
    fn longest(path: &Path, found: &mut Diagnostics) -> Vec<(f64, f64, u8)> {
        let outline = Outline::read(path, None, found).unwrap();
        let line = *outline.lines.iter().max_by_key(|line| line.points).unwrap();
        let LineRows { rows, windows, .. } = outline.rows_of(line, path).unwrap();
        assert_eq!((rows.len(), windows), (line.points, Windows::ALL));
        rows.iter().map(|row| (row.time, row.position.x, row.number)).collect()
    }

    #[test]
    fn only_the_points_of_one_flight_line_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.csv");
        let mut text = String::from("x,y,z,time,scan_angle,leg,return_number,number_of_returns,class\n");
        for i in 0..40 {
            // Two flight lines, the second one longer and against the order of time, and noise.
            text += &format!("{i},{},0,{i},1,0,1,1,2\n", i % 7);
            let time = 100.0 - 0.1 * f64::from(i);
            text += &format!("{i},{},0,{time},1,1,2,2,2\n{i},0,1,{time},1,1,1,2,2\n", i % 7);
            text += &format!("{i},0,900,{time},1,1,1,1,7\n");
        }
        std::fs::write(&path, &text).unwrap();
        let mut found = Diagnostics::default();
        let points = longest(&path, &mut found);
        assert!(points.len() == 80 && !found.text().contains("far from all others"), "{}", found.text());
        assert_eq!(
            points[..3].iter().map(|point| (point.1, point.2)).collect::<Vec<_>>(),
            [(39.0, 1), (39.0, 2), (38.0, 1)]
        );
        // A stray that would join two parts of the line.
        text += "500000,0,0,120,1,1,1,1,2\n3,3,0,140,1,1,1,1,2\n";
        std::fs::write(&path, &text).unwrap();
        assert_eq!(longest(&path, &mut found), points);
        assert!(found.text().contains("far from all others"), "{}", found.text());
    }

    #[test]
    fn seconds_of_one_flight_line_are_kept_where_all_take_too_much_memory() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.csv");
        // Lines of 400, 400 and 4000 points, of which the last one takes 40 s.
        let row = |i: u32| match i {
            0..800 => format!("{i},0,0,{i},1,{},1,1,2\n", i % 2),
            _ => format!("{},0,0,{},1,7,1,1,2\n", i % 100, 0.01 * f64::from(i)),
        };
        let rows: String = (0..4800).map(row).collect();
        let head = "x,y,z,time,scan_angle,leg,return_number,number_of_returns,class\n";
        std::fs::write(&path, head.to_owned() + &rows).unwrap();
        let read = |points: u64| {
            let max_memory = Some(points * point_bytes(None));
            let outline = Outline::read(&path, max_memory, &mut Diagnostics::default()).unwrap();
            let line = outline.lines[2];
            assert_eq!((outline.lines.len(), line.source, line.points), (3, 8, 4000));
            outline.rows_of(line, &path).map(|of| {
                let times: Vec<f64> = of.rows.iter().map(|row| row.time).collect();
                (times, of.windows)
            })
        };
        let (all, windows) = read(4000).unwrap();
        assert_eq!((all.len(), windows), (4000, Windows::ALL));
        // The line begins and ends between two windows of four.
        for (points, one_of, expected) in [(3999, 2, 2000), (1000, 4, 1000), (999, 5, 800), (799, 6, 600)] {
            let (some, windows) = read(points).unwrap();
            assert_eq!((some.len(), windows), (expected, Windows::one_of(one_of)), "{points}");
            let in_windows = all.iter().copied().filter(|time| windows.has(*time));
            assert!(in_windows.eq(some), "{points}");
        }
        let Err(Error::Input(report)) = read(50) else { panic!("no problem of the input") };
        assert!(report.text().contains("--max-memory"), "{}", report.text());
    }
}
