//! Reads point clouds: text, LAS, LAZ, PLY, Arrow, Parquet.

use super::points::{Attributes, Point, Points};
use super::read_table::Layout;
use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use crate::geom::DVec3;
use crate::input::arrow::{ArrowDetection, detect_arrow};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Reads a point cloud; the ending of its name tells the format: `.las` and `.laz`, `.ply`, `.parquet`; everything else is
/// text or an Arrow stream, which its first bytes tell. `-` is one of these two from stdin.
///
/// Text has one point per line, columns separated by blanks, tabs, commas or semicolons: `x y z` and, if there is a
/// fourth, an intensity; 11 columns are the point files of this program and of HELIOS++ (spec outputs §3). A first line of
/// more than four names, X, Y and Z among them, tells the columns. Empty lines and lines beginning with `#` or `//` are
/// passed over, and so is a first line of other names.
///
/// Fails with [`Error::Input`] when the file is not what it says, with the lines of text that are wrong.
pub fn read_points(path: &Path) -> Result<Points> {
    if path.as_os_str() == "-" {
        return read_text_or_arrow(std::io::stdin().lock(), Path::new("<stdin>"));
    }
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match ending.as_str() {
        "las" | "laz" => super::read_las::read(path),
        "ply" => super::read_ply::read(path),
        "parquet" => super::read_table::read_parquet(path),
        _ => {
            let file = File::open(path).map_err(|e| Error::io("read", path, e))?;
            read_text_or_arrow(BufReader::with_capacity(1 << 20, file), path)
        }
    }
}

fn read_text_or_arrow(mut source: impl BufRead, path: &Path) -> Result<Points> {
    // A pipe may bring the first bytes one by one.
    let mut first = Vec::new();
    while detect_arrow(&first) == ArrowDetection::NeedMoreBytes {
        let arrived = source.fill_buf().map_err(|e| Error::io("read", path, e))?;
        if arrived.is_empty() {
            break;
        }
        let count = arrived.len().min(8 - first.len());
        first.extend_from_slice(&arrived[..count]);
        source.consume(count);
    }
    let is_arrow = detect_arrow(&first) == ArrowDetection::Arrow;
    let whole = std::io::Cursor::new(first).chain(source);
    if is_arrow { super::read_table::read_arrow(whole, path) } else { read_text(whole, path) }
}

/// Problems after which reading stops.
const ENOUGH_PROBLEMS: usize = 10;

/// Reads text; `path` is its name in messages.
pub fn read_text(mut source: impl BufRead, path: &Path) -> Result<Points> {
    let mut problems = Diagnostics::default();
    let mut points: Option<Points> = None;
    let mut line = Vec::new();
    let mut number = 0;
    let mut first = true;
    let mut named: Option<Layout> = None;
    loop {
        line.clear();
        // No line of a point cloud is this long; a binary file without line ends must not fill the memory.
        let read = Read::take(&mut source, 1 << 16)
            .read_until(b'\n', &mut line)
            .map_err(|e| Error::io("read", path, e))?;
        if read == 0 {
            break;
        }
        number += 1;
        let whole = String::from_utf8_lossy(&line);
        let text = whole.trim_matches(|c: char| c.is_ascii_whitespace() || c == '\u{feff}');
        if text.is_empty() || text.starts_with('#') || text.starts_with("//") {
            continue;
        }
        let columns = Columns::of(text);
        let outcome = match &named {
            Some(layout) => by_name(layout, text, &mut points),
            None => columns
                .point()
                .map(|point| {
                    points.get_or_insert_with(|| Points::new(columns.attributes())).push(&point);
                })
                .map_err(|(column, expected)| {
                    (columns.fields[..columns.count].get(column).copied().unwrap_or_default(), expected)
                }),
        };
        match outcome {
            Ok(()) => {}
            Err(_) if first && text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '"') => {
                let names: Vec<&str> = fields(text).map(|name| name.trim_matches('"')).collect();
                named = Layout::of(&names, path).ok().filter(|_| names.len() > 4);
            }
            Err((found, expected)) => {
                let excerpt: String = whole.trim_end().chars().take(200).collect();
                let marked = if found.is_empty() {
                    excerpt.len()..excerpt.len()
                } else {
                    let start = found.as_ptr() as usize - whole.as_ptr() as usize;
                    start..start + found.len()
                };
                let place = Place::in_line(path, number, &excerpt, marked);
                let what =
                    if found.is_empty() { "the end of the line".to_owned() } else { format!("{found:?}") };
                problems.error(Some(place), format!("expected {expected}, found {what}"));
                if problems.items().len() == ENOUGH_PROBLEMS {
                    break;
                }
            }
        }
        first = false;
    }
    problems.finish(false)?;
    match points {
        Some(points) if !points.is_empty() => Ok(points),
        _ => Err(Error::input(format!("{} holds no points", path.display()))),
    }
}

/// Adds the point of a line whose columns have names. Otherwise what was found there and what belongs there.
fn by_name<'t>(
    layout: &Layout,
    text: &'t str,
    points: &mut Option<Points>,
) -> Result<(), (&'t str, &'static str)> {
    let texts: Vec<&str> = fields(text).collect();
    let mut numbers = vec![f64::NAN; texts.len()];
    for column in layout.columns() {
        let found = texts.get(column).copied().unwrap_or_default();
        match found.parse() {
            Ok(number) => numbers[column] = number,
            Err(_) => return Err((found, "a number")),
        }
    }
    layout.push(points.get_or_insert_with(|| Points::new(layout.attributes())), |column| numbers[column]);
    Ok(())
}

/// The fields of a line: between commas or semicolons if there are any, else between blanks.
fn fields(text: &str) -> Box<dyn Iterator<Item = &str> + '_> {
    if text.bytes().any(|b| matches!(b, b',' | b';')) {
        return Box::new(text.split([',', ';']).map(str::trim));
    }
    Box::new(text.split_ascii_whitespace())
}

/// Columns of the point files of this program.
const FULL: usize = 11;

/// The fields of a line.
struct Columns<'a> {
    fields: [&'a str; FULL],
    count: usize,
}

impl<'a> Columns<'a> {
    fn of(text: &'a str) -> Columns<'a> {
        let separated = text.bytes().any(|b| matches!(b, b',' | b';'));
        let mut columns = Columns { fields: [&text[..0]; FULL], count: 0 };
        if separated {
            text.split([',', ';']).map(str::trim).take(FULL).for_each(|f| columns.add(f));
        } else {
            text.split_ascii_whitespace().take(FULL).for_each(|f| columns.add(f));
        }
        // The name of the hit object may be empty, which blanks do not show.
        if !separated && columns.count == FULL - 1 {
            columns.fields.copy_within(8..10, 9);
            columns.fields[8] = &text[..0];
            columns.count = FULL;
        }
        columns
    }

    fn add(&mut self, field: &'a str) {
        self.fields[self.count] = field;
        self.count += 1;
    }

    fn attributes(&self) -> Attributes {
        let full = self.count == FULL;
        Attributes { intensity: self.count >= 4, class: full, return_number: full, object: full }
    }

    /// The point, or the column that is wrong and what belongs there.
    fn point(&self) -> Result<Point<'a>, (usize, &'static str)> {
        let number = |column: usize, what: &'static str| match self.fields[column].parse::<f64>() {
            Ok(value) if column < self.count => Ok(value),
            _ => Err((column, what)),
        };
        let position = DVec3::new(
            number(0, "x, a number of metres")?,
            number(1, "y, a number of metres")?,
            number(2, "z, a number of metres")?,
        );
        let mut point = Point { position, ..Point::default() };
        if self.count >= 4 {
            point.intensity = number(3, "an intensity")? as f32;
        }
        if self.count == FULL {
            point.return_number = number(5, "the number of the return")? as u32;
            point.object = self.fields[8];
            point.class = number(9, "a point class")? as i32;
        }
        Ok(point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Points> {
        read_text(text.as_bytes(), Path::new("cloud.xyz"))
    }

    #[test]
    fn point_files_of_eleven_columns_have_everything() {
        // The example of spec outputs §3, and one whose object has no name.
        let points = read(
            "-2.8380 -25.5432 -0.0065 5.6037 0.0000 1 2 1 17 5 86391.000000000\n\
             1 2 3 4.5 0.0000 2 2 1  6 86391.000000000\n",
        )
        .unwrap();
        assert_eq!(points.len(), 2);
        assert_eq!(points.bounds().min, DVec3::new(-2.838, -25.5432, -0.0065));
        assert_eq!(points.class, [5, 6]);
        assert_eq!(points.return_number, [1, 2]);
        assert_eq!(points.objects, ["17", ""]);
        assert_eq!(points.intensity, [5.6037, 4.5]);
    }

    #[test]
    fn plain_coordinates_in_any_dress() {
        for text in [
            "1 2 3\n4 5 6",
            "# a note\nx y z\n1\t2\t3\r\n\r\n4   5 6\r\n",
            "X,Y,Z\n1,2,3\n4,5,6\n",
            "1; 2; 3\n// note\n4; 5; 6\n",
        ] {
            let points = read(text).unwrap();
            assert_eq!((points.len(), points.attributes()), (2, Attributes::default()), "{text:?}");
            assert_eq!(points.bounds().max, DVec3::new(4.0, 5.0, 6.0), "{text:?}");
        }
        assert!(read("1 2 3 0.5\n").unwrap().attributes().intensity);
    }

    #[test]
    fn a_line_of_names_tells_the_columns() {
        let points =
            read("GpsTime,Z,X,Y,Note,ReturnNumber,Amplitude\n9,3,1,2,oak,1,0.5\n9,6,4,5,ash,2,0.25\n")
                .unwrap();
        assert_eq!(points.bounds().max, DVec3::new(4.0, 5.0, 6.0));
        assert_eq!((&points.return_number[..], &points.intensity[..]), (&[1, 2][..], &[0.5, 0.25][..]));
        let Err(Error::Input(report)) = read("Z,X,Y,T,ReturnNumber\n1,2,3,4,5\n1,2,three,4,5\n") else {
            panic!("read")
        };
        let report = report.render(false);
        assert!(report.contains("cloud.xyz:3:5") && report.contains("\"three\""), "{report}");
    }

    #[test]
    fn wrong_lines_are_reported_together_with_their_places() {
        let Err(Error::Input(report)) = read("1 2 3\n  1 two 3\n4 5\n7 8 9\n") else { panic!("accepted") };
        assert_eq!(report.items().len(), 2);
        let report = report.render(false);
        assert!(
            report.contains("cloud.xyz:2:5") && report.contains("expected y") && report.contains("\"two\"")
        );
        assert!(report.contains("cloud.xyz:3") && report.contains("expected z"), "{report}");
    }

    #[test]
    fn rubbish_ends_in_a_report() {
        for bytes in [&b""[..], b"\n\n", b"#only a comment\n", b"\xff\xfe\x00\x01\x02", &[0u8; 300_000]] {
            assert!(matches!(read_text(bytes, Path::new("rubbish")), Err(Error::Input(_))));
        }
        // Infinite coordinates are numbers; the point is left out.
        assert!(matches!(read("inf 0 0\n"), Err(Error::Input(_))));
        assert_eq!(read("inf 0 0\n1 2 3\n").unwrap().skipped(), 1);
    }
}
