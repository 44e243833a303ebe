//! PTS and PTX, the texts of Leica Cyclone. PTS: a line with the number of points, then as many lines `x y
//! z`, optionally with an intensity (-2048 to 2047) and `r g b`; further scans follow likewise. PTX: for each
//! scan two lines with the columns and rows of its raster, four with the scanner's pose, four with the matrix
//! that its points are multiplied by (as rows of four numbers, from the left), then a line `x y z intensity`,
//! optionally with `r g b`, for every place of the raster; 0 0 0 is not a point.

use super::text::{float, is_line_end, is_skipped, read_line};
use super::{Attribute, AttributeSet, PointRow, Reading};
use std::io::BufRead;
use std::ops::ControlFlow;
use vlscan_base::columns::{Separator, comma_note};
use vlscan_base::diag::Place;
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;

/// Lines before the points of a scan of PTX, without the first one.
const PTX_HEAD_LINES: usize = 9;

/// Maximum number of columns.
const MAX_COLUMNS: usize = 7;

/// True if a file with this beginning is PTX, false if it is PTS; `None` if it is neither.
pub(super) fn detect(first: &[u8]) -> Option<bool> {
    let mut lines = first.split(|b| is_line_end(*b)).filter(|line| !is_skipped(line.trim_ascii()));
    let mut next = || numbers(lines.next()?.trim_ascii());
    let is_count = |line: &[f64]| line.len() == 1 && line[0] >= 0.0 && line[0].fract() == 0.0;
    next().filter(|line| is_count(line))?;
    let second = next()?;
    match is_count(&second) {
        true => next().is_some_and(|line| line.len() == 3).then_some(true),
        false => matches!(second.len(), 3 | 4 | 6 | 7).then_some(false),
    }
}

/// The numbers of a line between blanks; `None` if there are other words or too many.
fn numbers(line: &[u8]) -> Option<Vec<f64>> {
    let words = || Separator::Blanks.split(line).map(move |at| &line[at]);
    let numbers = words().map(|word| Separator::Blanks.number(word, words()));
    let numbers: Vec<f64> = numbers.collect::<Option<_>>()?;
    (1..=MAX_COLUMNS).contains(&numbers.len()).then_some(numbers)
}

/// Lines with numbers, with their numbers.
struct Lines<R> {
    source: R,
    line: Vec<u8>,
    number: usize,
}

impl<R: BufRead> Lines<R> {
    /// The numbers of the next line that is neither empty nor a comment; `None` at the end and after an
    /// error.
    fn next(&mut self, reading: &mut Reading) -> Result<Option<Vec<f64>>> {
        loop {
            let read = read_line(&mut self.source, &mut self.line);
            if !read.map_err(|e| Error::io("read", reading.path, e))? {
                return Ok(None);
            }
            self.number += 1;
            let text = self.line.trim_ascii();
            if is_skipped(text) {
                continue;
            }
            match numbers(text) {
                Some(values) => return Ok(Some(values)),
                None => {
                    let words = Separator::Blanks.split(text).map(|at| &text[at]);
                    let wrong =
                        words.filter(|word| float(word).is_none()).map(String::from_utf8_lossy).next();
                    let found =
                        wrong.map_or_else(String::new, |w| format!(", found {w:?}{}", comma_note(&w)));
                    self.fail(&format!("expected 1 to 7 numbers between blanks{found}"), reading);
                    return Ok(None);
                }
            }
        }
    }

    fn fail(&self, message: &str, reading: &mut Reading) {
        let text = String::from_utf8_lossy(&self.line).into_owned();
        let text = text.trim_end();
        reading.found.error(Some(Place::in_line(reading.path, self.number, text, 0..text.len())), message);
    }
}

/// The scan whose points are read.
struct Scan {
    /// Number of the scan in the file, from 0.
    number: u16,
    /// Its points, and those that were read.
    count: u64,
    read: u64,
    /// Images of the axes and of the origin.
    axes: [DVec3; 3],
    origin: DVec3,
}

/// Reads a file.
pub(super) fn read(source: impl BufRead, is_ptx: bool, reading: &mut Reading) -> Result<()> {
    let mut lines = Lines { source, line: Vec::new(), number: 0 };
    let mut scan: Option<Scan> = None;
    let mut columns = None;
    while let Some(values) = lines.next(reading)? {
        if values.len() == 1 {
            if let Some(scan) = &scan
                && !is_complete(scan, reading)
            {
                return Ok(());
            }
            let number = scan.as_ref().map_or(0, |scan| scan.number.saturating_add(1));
            scan = match is_ptx {
                true => ptx_scan(values[0], number, &mut lines, reading)?,
                false => Some(Scan {
                    number,
                    count: values[0] as u64,
                    read: 0,
                    axes: [DVec3::X, DVec3::Y, DVec3::Z],
                    origin: DVec3::ZERO,
                }),
            };
            if scan.is_none() {
                return Ok(());
            }
            continue;
        }
        let Some(scan) = &mut scan else {
            lines.fail("expected the number of points", reading);
            return Ok(());
        };
        let expected = *columns.get_or_insert_with(|| {
            let has_intensity = matches!(values.len(), 4 | 7);
            let has = |a| matches!(a, Attribute::Leg) || (has_intensity && a == Attribute::Intensity);
            reading.sink.start(AttributeSet::of(|a| Attribute::POSITION.contains(&a) || has(a)));
            values.len()
        });
        if values.len() != expected || !matches!(expected, 3 | 4 | 6 | 7) {
            lines.fail(
                "expected `x y z`, then an intensity, `r g b`, both or neither, as in the first line",
                reading,
            );
            return Ok(());
        }
        scan.read += 1;
        if is_ptx && values[..3] == [0.0; 3] {
            continue;
        }
        let [x, y, z] = scan.axes;
        let row = PointRow {
            position: x * values[0] + y * values[1] + z * values[2] + scan.origin,
            intensity: if matches!(expected, 4 | 7) { values[3] as f32 } else { 0.0 },
            leg: scan.number,
            ..PointRow::default()
        };
        if let ControlFlow::Break(()) = reading.take(&row) {
            return Ok(());
        }
    }
    if let Some(scan) = &scan {
        is_complete(scan, reading);
    }
    Ok(())
}

/// Reads the lines of a scan of PTX before its points; `None` after a problem.
fn ptx_scan<R: BufRead>(
    columns: f64,
    number: u16,
    lines: &mut Lines<R>,
    reading: &mut Reading,
) -> Result<Option<Scan>> {
    let mut head = Vec::new();
    while head.len() < PTX_HEAD_LINES {
        let Some(values) = lines.next(reading)? else {
            if !reading.found.is_fatal(false) {
                reading.found.error(Some(reading.place()), "the file ends before the points of a scan");
            }
            return Ok(None);
        };
        let expected = [1, 3, 3, 3, 3, 4, 4, 4, 4][head.len()];
        if values.len() != expected {
            lines.fail(&format!("expected {expected} numbers of the head of a scan"), reading);
            return Ok(None);
        }
        head.push(values);
    }
    let row = |i: usize| DVec3::new(head[i][0], head[i][1], head[i][2]);
    Ok(Some(Scan {
        number,
        count: (columns * head[0][0]) as u64,
        read: 0,
        axes: [row(5), row(6), row(7)],
        origin: row(8),
    }))
}

/// True if a scan has the points that its head states; too few are an error, more a warning.
fn is_complete(scan: &Scan, reading: &mut Reading) -> bool {
    let Scan { count, read, .. } = scan;
    if read > count {
        reading.warn(format!(
            "scan {} has {read} points, its head states {count}; all are read",
            scan.number + 1
        ));
    } else if read < count {
        let message =
            format!("scan {} ends after {read} of {count} points; is the file truncated?", scan.number + 1);
        reading.found.error(Some(reading.place()), message);
    }
    read >= count
}
