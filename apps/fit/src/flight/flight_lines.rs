//! The flight lines of a cloud: by source, divided by pauses and turns.

use super::straight::{Part, straight_flights};
use crate::rows::Row;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::str::FromStr;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::counted;

/// A pause of this many seconds ends a flight line; channels that look ahead and back pass a small place some
/// seconds apart.
pub(super) const FLIGHT_PAUSE: f64 = 20.0;
/// Duration of the parts of a flight line that are counted together, s. No pause is within a part.
const PART_S: f64 = 1.0;

/// Maximum number of flight lines that a message names.
const MAX_NAMED: usize = 20;

/// A flight line that is chosen: `7`, the longest one of point source 7, or `7.2`, the second one of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlightLineName {
    /// Point source.
    pub source: u16,
    /// Number among the flight lines of the source in the order of time, from 1; the one with the most points
    /// if missing.
    pub number: Option<usize>,
}

impl FromStr for FlightLineName {
    type Err = String;

    fn from_str(text: &str) -> Result<FlightLineName, String> {
        let expected =
            "expected a point source, such as 7, or one of its flight lines, counted from 1, such as 7.2";
        let (source, number) = match text.split_once('.') {
            Some((source, number)) => {
                let number = number.parse().ok().filter(|number| *number > 0);
                (source, Some(number.ok_or(expected)?))
            }
            None => (text, None),
        };
        let source = source.parse().map_err(|_| expected)?;
        Ok(FlightLineName { source, number })
    }
}

impl fmt::Display for FlightLineName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.source)?;
        self.number.map_or(Ok(()), |number| write!(f, ".{number}"))
    }
}

impl FlightLineName {
    /// The flight lines with this name, among all of a cloud in the order of source and time.
    ///
    /// # Errors
    /// [`Error::Input`] if there is none.
    pub(super) fn select(self, lines: &[FlightLine], path: &Path) -> Result<Vec<FlightLine>> {
        let of_source: Vec<FlightLine> =
            lines.iter().copied().filter(|line| line.source == self.source).collect();
        let (path, source) = (path.display(), self.source);
        if of_source.is_empty() {
            let mut sources: Vec<String> = lines.iter().map(|line| line.source.to_string()).collect();
            sources.dedup();
            let message = format!("--flight-line {self}: {path} has no points of point source {source}");
            return Err(Error::input_with_help(message, format!("it has {}", sources.join(", "))));
        }
        let Some(number) = self.number else { return Ok(of_source) };
        of_source.get(number - 1).map(|line| vec![*line]).ok_or_else(|| {
            let message = format!(
                "--flight-line {self}: {path} has {} of point source {source}",
                counted(of_source.len() as u64, "flight line")
            );
            Error::input_with_help(message, format!("choose {}", named(&of_source)))
        })
    }
}

/// Names of the flight lines of a source, with their times.
fn named(of_source: &[FlightLine]) -> String {
    let name = |(k, line): (usize, &FlightLine)| {
        format!("{}.{} (from GPS time {:.1} s)", line.source, k + 1, line.times[0])
    };
    let mut names: Vec<String> = of_source.iter().enumerate().take(MAX_NAMED).map(name).collect();
    if let Some(last) = of_source.last().filter(|_| of_source.len() > MAX_NAMED) {
        names.push(format!("…, {}.{} (from {:.1} s)", last.source, of_source.len(), last.times[0]));
    }
    names.join(", ")
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
    /// True if a point is in the line.
    pub fn contains(&self, row: &Row) -> bool {
        let [first, last] = self.times;
        self.source == row.source && first <= row.time && row.time <= last
    }
}

/// Counts the points of flight lines, by source and part of the time.
#[derive(Default)]
pub(super) struct LineCounter(BTreeMap<(u16, i64), Part>);

impl LineCounter {
    /// Adds a point.
    pub fn add(&mut self, row: &Row) {
        self.add_all(std::slice::from_ref(row));
    }

    /// Adds points in their order, as [`LineCounter::add`] does, faster.
    pub fn add_all(&mut self, rows: &[Row]) {
        let part = |row: &Row| (row.source, (row.time / PART_S).floor() as i64);
        for rows in rows.chunk_by(|a, b| part(a) == part(b)) {
            let Some(first) = rows.first() else { continue };
            let at_first = || Part::at(first.time, first.position.truncate());
            let known = self.0.entry(part(first)).or_insert_with(at_first);
            rows.iter().for_each(|row| known.add(row.time, row.position.truncate(), row.angle));
        }
    }

    /// The flight lines in the order of source and time, without turns, and the numbers of points in the
    /// turns of each source that has some.
    pub fn lines(self) -> (Vec<FlightLine>, BTreeMap<u16, usize>) {
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
    let of_source: Vec<FlightLine> =
        lines.iter().copied().filter(|line| line.source == fitted.source).collect();
    let mut help = Vec::new();
    if of_source.len() < lines.len() {
        help.push("--flight-line N selects another one by its point source".to_owned());
    }
    if of_source.len() > 1 {
        help.push(format!(
            "--flight-line selects one of point source {}: {}",
            fitted.source,
            named(&of_source)
        ));
    }
    found.warn(Some(Place::of_file(path)), message).help(help.join("; "));
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::DVec3;

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
        let rows = [(7, 30.0), (3, 5.0), (7, 1.0), (3, 5.0), (7, 9.0), (3, 25.0), (7, -19.5)]
            .map(|(source, time)| Row { source, time, ..ROW });
        let line = |source, first, last, points| FlightLine { source, times: [first, last], points };
        let expected =
            [line(3, 5.0, 25.0, 3), line(7, -19.5, -19.5, 1), line(7, 1.0, 9.0, 2), line(7, 30.0, 30.0, 1)];
        for block in [1, 3, 7] {
            let mut counter = LineCounter::default();
            rows.chunks(block).for_each(|rows| counter.add_all(rows));
            let (lines, turns) = counter.lines();
            assert!(lines == expected && turns.is_empty(), "{block}: {lines:?}");
        }
        assert!(LineCounter::default().lines().0.is_empty());
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
    fn other_flight_lines_are_chosen_by_source_or_number() {
        let line = |source, start| FlightLine { source, times: [start, start + 9.0], points: 10 };
        let said = |lines: &[FlightLine]| {
            let mut found = Diagnostics::default();
            warn_of_others(Path::new("a.laz"), lines, lines[0], &mut found);
            found.text()
        };
        let of_source = said(&[line(3, 0.5), line(3, 20.0)]);
        assert!(of_source.contains("3.1 (from GPS time 0.5 s), 3.2 (from GPS time 20.0 s)"), "{of_source}");
        assert!(of_source.contains("10 points of the others") && !of_source.contains("--flight-line N"));
        let others = said(&[line(3, 0.5), line(4, 20.0)]);
        assert!(others.contains("--flight-line N") && !others.contains("3.1"), "{others}");
        let both = said(&[line(3, 0.5), line(3, 20.0), line(4, 40.0)]);
        assert!(both.contains("--flight-line N") && both.contains("3.2"), "{both}");
    }

    #[test]
    fn names_of_flight_lines_are_a_source_and_a_number() {
        let name = |source, number| Ok(FlightLineName { source, number });
        for (text, expected) in
            [("7", name(7, None)), ("7.2", name(7, Some(2))), ("65535.10", name(65_535, Some(10)))]
        {
            assert_eq!(text.parse(), expected);
            assert_eq!(text.parse::<FlightLineName>().unwrap().to_string(), text);
        }
        for text in ["", ".", "7.", "7.0", ".2", "7.2.1", "7.-1", "-7", "65536", "a", "7,2"] {
            assert!(text.parse::<FlightLineName>().unwrap_err().contains("7.2"), "{text}");
        }
    }

    #[test]
    fn flight_lines_of_a_source_count_in_the_order_of_time() {
        let line = |source, start| FlightLine { source, times: [start, start + 9.0], points: 10 };
        let lines: Vec<FlightLine> =
            (0..30).map(|k| line(3, 0.5 + 20.0 * f64::from(k))).chain([line(8, 5.0)]).collect();
        let select = |name: &str| name.parse::<FlightLineName>().unwrap().select(&lines, Path::new("a.laz"));
        assert_eq!(select("3").unwrap(), lines[..30]);
        assert_eq!(select("3.2").unwrap(), [lines[1]]);
        assert_eq!(select("8.1").unwrap(), [lines[30]]);
        for (name, expected) in [
            ("4.1", &["--flight-line 4.1", "no points of point source 4", "it has 3, 8"][..]),
            ("8.2", &["--flight-line 8.2", "1 flight line of point source 8", "8.1 (from GPS time 5.0 s)"]),
            ("3.31", &["has 30 flight lines", "3.20 (from GPS time 380.5 s), …, 3.30 (from 580.5 s)"]),
        ] {
            let Error::Input(problems) = select(name).unwrap_err() else { panic!("{name}") };
            let message = problems.text();
            assert!(expected.iter().all(|part| message.contains(part)), "{name}: {message}");
        }
    }
}
