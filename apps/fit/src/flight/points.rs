//! The points of the flight line that is fitted.
//!
//! A file is read several times: for its flight lines and strays, again without the strays if there are any,
//! and for the points of one flight line, which are the only ones in memory. Of a stream all points are kept.

use super::straight::{Part, straight_flights};
use crate::limit::PointLimit;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_formats::{
    Attribute, AttributeSet, FileFacts, PointRow, PointSink, Selection, StrayFinder, Strays, read_points,
};
use vlscan_geom::DVec3;

/// A pause of this many seconds ends a flight line; channels that look ahead and back pass a small place some
/// seconds apart.
pub(super) const FLIGHT_PAUSE: f64 = 20.0;
/// Duration of the parts of a flight line that are counted together, s. No pause is within a part.
const PART_S: f64 = 1.0;

/// ASPRS classes of noise, which is not on the ground.
const NOISE: [u8; 2] = [7, 18];

/// Values that are read of a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub time: f64,
    pub position: DVec3,
    pub angle: f64,
    pub source: u16,
    pub number: u8,
    pub returns: u8,
    pub class: u8,
    pub channel: u16,
}

impl Row {
    /// The values of a point that counts.
    fn of(row: &PointRow, is_las: bool) -> Option<Row> {
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
}

/// A flight line of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FlightLine {
    pub source: u16,
    /// Times of its first and its last point, s.
    pub times: [f64; 2],
    /// Number of its points.
    pub points: usize,
}

impl FlightLine {
    fn contains(&self, row: &Row) -> bool {
        let [first, last] = self.times;
        self.source == row.source && first <= row.time && row.time <= last
    }
}

/// Counts the points of flight lines, by source and part of the time.
#[derive(Default)]
struct LineCounter(BTreeMap<(u16, i64), Part>);

impl LineCounter {
    fn add(&mut self, row: &Row) {
        let (place, part) = (row.position.truncate(), (row.time / PART_S).floor() as i64);
        let part = self.0.entry((row.source, part)).or_insert_with(|| Part::at(row.time, place));
        part.add(row.time, place, row.angle);
    }

    /// The flight lines in the order of source and time, without turns, and the numbers of points in the
    /// turns of each source that has some.
    fn lines(self) -> (Vec<FlightLine>, BTreeMap<u16, usize>) {
        let mut lines: Vec<(u16, Vec<Part>)> = Vec::new();
        for ((source, _), part) in self.0 {
            let is_next = |parts: &[Part]| {
                parts.last().is_some_and(|last| part.times[0] - last.times[1] <= FLIGHT_PAUSE)
            };
            match lines.last_mut().filter(|(of_line, parts)| *of_line == source && is_next(parts)) {
                Some((_, parts)) => parts.push(part),
                None => lines.push((source, vec![part])),
            }
        }
        let (mut flights, mut turns) = (Vec::new(), BTreeMap::new());
        for (source, parts) in lines {
            let points = |parts: &[Part]| parts.iter().map(|part| part.points).sum::<usize>();
            let straight = straight_flights(&parts);
            let has_turns = straight.is_some();
            let ranges = straight.unwrap_or_else(|| std::iter::once(0..parts.len()).collect());
            let in_line = ranges.iter().filter_map(|range| parts.get(range.clone())).filter_map(|parts| {
                let (first, last) = (parts.first()?, parts.last()?);
                Some(FlightLine { source, times: [first.times[0], last.times[1]], points: points(parts) })
            });
            let in_line: Vec<FlightLine> = in_line.collect();
            if has_turns {
                let kept: usize = in_line.iter().map(|flight| flight.points).sum();
                *turns.entry(source).or_default() += points(&parts) - kept;
            }
            flights.extend(in_line);
        }
        (flights, turns)
    }
}

/// Takes the points of a cloud.
#[derive(Default)]
struct Sink {
    attributes: AttributeSet,
    wkt: Option<String>,
    is_las: bool,
    /// Points that do not count.
    left_out: Option<Strays>,
    finder: StrayFinder,
    counter: LineCounter,
    /// The flight line whose points are kept; `None` if all are kept.
    line: Option<FlightLine>,
    /// The points that are kept; `None` if points are only counted.
    rows: Option<Vec<Row>>,
    limit: PointLimit,
    /// True if there are more points than the limit allows.
    is_too_large: bool,
}

impl PointSink for Sink {
    fn start(&mut self, attributes: AttributeSet) {
        self.attributes = attributes;
    }

    fn file(&mut self, facts: &FileFacts) {
        self.is_las = facts.las.is_some();
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

    fn point(&mut self, row: &PointRow, _object: Option<&str>) -> Result<ControlFlow<()>> {
        let row = Row::of(row, self.is_las);
        let is_left_out = |row: &Row| self.left_out.is_some_and(|strays| strays.contains(row.position));
        let Some(row) = row.filter(|row| !is_left_out(row)) else { return Ok(ControlFlow::Continue(())) };
        match &mut self.rows {
            None => {
                self.finder.add(row.position);
                self.counter.add(&row);
            }
            Some(rows) if self.line.is_none_or(|line| line.contains(&row)) => {
                rows.push(row);
                self.is_too_large = self.limit.is_exceeded(rows.len());
            }
            Some(_) => {}
        }
        Ok(if self.is_too_large { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
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
    /// All points of a stream, which is read once.
    rows: Option<Vec<Row>>,
}

impl Outline {
    /// Reads the flight lines of a cloud without strays, of which `found` has a warning.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] for clouds without GPS times or scan angles, and for streams with more
    /// points than `limit` allows.
    pub fn read(path: &Path, limit: PointLimit, found: &mut Diagnostics) -> Result<Outline> {
        let is_stream = path.as_os_str() == "-" || !path.is_file();
        let mut sink = Sink { limit, rows: is_stream.then(Vec::new), ..Sink::default() };
        found.extend(read_points(path, &mut sink)?);
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
        sink.rows.iter().flatten().for_each(|row| sink.finder.add(row.position));
        let strays = sink.finder.strays();
        strays.warn(path, "left out", found);
        if let Some(rows) = &mut sink.rows {
            rows.retain(|row| !strays.contains(row.position));
            rows.iter().for_each(|row| sink.counter.add(row));
        } else if strays.count > 0 {
            let mut others = Sink { left_out: Some(strays), ..Sink::default() };
            read_points(path, &mut others)?;
            sink.counter = others.counter;
        }
        let Sink { wkt, counter, rows, .. } = sink;
        let (lines, turns) = counter.lines();
        Ok(Outline { wkt, lines, turns, strays, limit, rows })
    }

    /// The points of a flight line, by time and return number.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] for more points than the limit allows, and for a file that has
    /// changed.
    pub fn rows_of(self, line: FlightLine, path: &Path) -> Result<Vec<Row>> {
        if self.limit.is_exceeded(line.points) {
            return Err(self.limit.error(path));
        }
        let mut rows = match self.rows {
            Some(mut rows) => {
                rows.retain(|row| line.contains(row));
                rows
            }
            None => {
                let rows = Some(Vec::with_capacity(line.points));
                let (left_out, line) = (Some(self.strays), Some(line));
                let mut sink = Sink { left_out, line, rows, limit: self.limit, ..Sink::default() };
                read_points(path, &mut sink)?;
                sink.rows.unwrap_or_default()
            }
        };
        if rows.len() != line.points {
            return Err(Error::input(format!("{} has changed while it was read", path.display())));
        }
        let order = |a: &Row, b: &Row| a.time.total_cmp(&b.time).then(a.number.cmp(&b.number));
        // Most recordings are in order, and sorting takes half as much memory again.
        if !rows.is_sorted_by(|a, b| order(a, b).is_le()) {
            rows.sort_by(order);
        }
        Ok(rows)
    }
}

/// Warns of flight lines that are not fitted.
pub(super) fn warn_of_others(path: &Path, lines: &[FlightLine], fitted: FlightLine, found: &mut Diagnostics) {
    let left_out = lines.iter().map(|line| line.points).sum::<usize>() - fitted.points;
    let message = format!(
        "{} has {} flight lines: the one with the most points is fitted (point source {}, GPS time {:.1} s); \
         {left_out} points of the others are ignored",
        path.display(),
        lines.len(),
        fitted.source,
        fitted.times[0]
    );
    let of_source: Vec<String> = lines
        .iter()
        .filter(|line| line.source == fitted.source)
        .map(|line| format!("{:.1}", line.times[0]))
        .collect();
    let mut help = Vec::new();
    if of_source.len() < lines.len() {
        help.push("--flight-line N selects another one by its point source".to_owned());
    }
    if of_source.len() > 1 {
        help.push(format!(
            "lines of point source {} begin at the GPS times {} s: cut the cloud by time to fit another one",
            fitted.source,
            of_source.join(", ")
        ));
    }
    found.warn(Some(Place::of_file(path)), message).help(help.join("; "));
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROW: Row = Row {
        time: 0.0,
        position: DVec3::ZERO,
        angle: 0.0,
        source: 1,
        number: 1,
        returns: 2,
        class: 1,
        channel: 0,
    };

    #[test]
    fn flight_lines_are_divided_by_source_and_pauses() {
        let mut counter = LineCounter::default();
        for (source, time) in [(7, 30.0), (3, 5.0), (7, 1.0), (3, 5.0), (7, 9.0), (3, 25.0), (7, -19.5)] {
            counter.add(&Row { source, time, ..ROW });
        }
        let line = |source, first, last, points| FlightLine { source, times: [first, last], points };
        let expected = [line(3, 5.0, 25.0, 3), line(7, -19.5, -19.5, 1), line(7, 1.0, 9.0, 2)];
        let (lines, turns) = counter.lines();
        assert_eq!(lines, [&expected[..], &[line(7, 30.0, 30.0, 1)]].concat());
        assert!(turns.is_empty() && LineCounter::default().lines().0.is_empty());
    }

    #[test]
    fn turns_divide_a_flight_line_and_are_in_none() {
        let mut counter = LineCounter::default();
        for k in 0..2600 {
            // 10 s to the east at 30 m/s, 6 s of a turn to the south, 10 s to the west.
            let time = 0.01 * f64::from(k);
            let turned = (0.5 * (time - 10.0)).clamp(0.0, 3.0) * std::f64::consts::PI / 3.0;
            let (along, radius) =
                (30.0 * (time.min(10.0) - (time - 16.0).max(0.0)), 180.0 / std::f64::consts::PI);
            let place = DVec3::new(along + radius * libm::sin(turned), radius * libm::cos(turned), 0.0);
            let angle = f64::from(k % 61) - 30.0;
            let right = DVec3::new(-libm::sin(turned), -libm::cos(turned), 0.0);
            let position = place + 80.0 * libm::tan(angle.to_radians()) * right;
            counter.add(&Row { source: 4, time, position, angle, ..ROW });
        }
        let (lines, turns) = counter.lines();
        assert_eq!(lines.len(), 2, "{lines:?}");
        assert!(lines[0].times[0] == 0.0 && lines[0].times[1] <= 10.0, "{lines:?}");
        assert!(lines[1].times[0] >= 16.0 && lines[1].times[1] > 25.98, "{lines:?}");
        assert_eq!(lines[0].points + lines[1].points + turns[&4], 2600);
    }

    #[test]
    fn other_flight_lines_are_chosen_by_source_or_time() {
        let line = |source, start| FlightLine { source, times: [start, start + 9.0], points: 10 };
        let said = |lines: &[FlightLine]| {
            let mut found = Diagnostics::default();
            warn_of_others(Path::new("a.laz"), lines, lines[0], &mut found);
            found.text()
        };
        let of_source = said(&[line(3, 0.5), line(3, 20.0)]);
        assert!(of_source.contains("begin at the GPS times 0.5, 20.0 s"), "{of_source}");
        assert!(of_source.contains("10 points of the others") && !of_source.contains("--flight-line"));
        let others = said(&[line(3, 0.5), line(4, 20.0)]);
        assert!(others.contains("--flight-line") && !others.contains("begin at"), "{others}");
        let both = said(&[line(3, 0.5), line(3, 20.0), line(4, 40.0)]);
        assert!(both.contains("--flight-line") && both.contains("begin at"), "{both}");
    }

    /// The points of the longest flight line of a file of this text, as time, x and return number.
    fn longest(path: &Path, found: &mut Diagnostics) -> Vec<(f64, f64, u8)> {
        let outline = Outline::read(path, PointLimit::default(), found).unwrap();
        let line = *outline.lines.iter().max_by_key(|line| line.points).unwrap();
        let rows = outline.rows_of(line, path).unwrap();
        assert_eq!(rows.len(), line.points);
        rows.iter().map(|row| (row.time, row.position.x, row.number)).collect()
    }

    #[test]
    fn only_the_points_of_one_flight_line_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.csv");
        let mut text = String::from("x,y,z,time,scan_angle,leg,return_number,number_of_returns,class\n");
        for i in 0..40 {
            // Two flight lines, the second one longer and against the order of time, and noise.
            text += &format!("{i},{},0,{},1,0,1,1,2\n", i % 7, 0.1 * f64::from(i));
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
    fn the_limit_holds_for_the_points_of_one_flight_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.csv");
        let row = |i: u32| format!("{i},0,0,{},1,{},1,1,2\n", i % 100, i % 4);
        let rows: String = (0..400).map(row).collect();
        let head = "x,y,z,time,scan_angle,leg,return_number,number_of_returns,class\n";
        std::fs::write(&path, head.to_owned() + &rows).unwrap();
        for (max_memory, is_enough) in [(100 * 160, true), (100 * 160 - 1, false)] {
            let limit = PointLimit::new(Some(max_memory));
            let outline = Outline::read(&path, limit, &mut Diagnostics::default()).unwrap();
            let line = outline.lines[2];
            assert_eq!((outline.lines.len(), line.source, line.points), (4, 3, 100));
            assert_eq!(outline.rows_of(line, &path).is_ok(), is_enough, "{max_memory}");
        }
    }
}
