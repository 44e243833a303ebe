//! Reads point clouds: text, LAS, LAZ, PLY, Arrow, Parquet.

use super::points::{Attributes, Point, Points};
use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use crate::geom::MAX_COORDINATE;
use crate::input::arrow::{ArrowDetection, detect_arrow};
use crate::points::text::{Separators, is_heading, is_skipped};
use crate::points::{Attribute, Columns, LasReader, PlyReader, PointReader, PointRow, Selection};
use crate::store::FileBytes;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::ops::Range;
use std::path::Path;

/// Reads a point cloud. The extension of the file name determines the format: `.las` and `.laz`, `.ply`, `.parquet`;
/// everything else is text or an Arrow stream, distinguished by the first bytes. `-` reads one of these two from stdin.
///
/// Text has one point per line, columns separated by blanks, tabs, commas or semicolons: `x y z` and optionally an
/// intensity in the fourth column; 11 columns are the point files of this program and of HELIOS++ (spec outputs §3). If
/// the first line consists of more than four names, X, Y and Z among them, it names the columns. Empty lines, lines
/// beginning with `#` or `//`, and a first line of other names are skipped.
///
/// Fails with [`Error::Input`] when the file does not have its stated format, with the invalid lines of text.
pub fn read_points(path: &Path) -> Result<Points> {
    if path.as_os_str() == "-" {
        return read_text_or_arrow(std::io::stdin().lock(), Path::new("<stdin>"));
    }
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match ending.as_str() {
        "las" | "laz" => read_binary(path, true),
        "ply" => read_binary(path, false),
        "parquet" => super::read_table::read_parquet(path),
        _ => {
            let file = File::open(path).map_err(|e| Error::open(path, e))?;
            read_text_or_arrow(BufReader::with_capacity(1 << 20, file), path)
        }
    }
}

fn read_text_or_arrow(mut source: impl BufRead, path: &Path) -> Result<Points> {
    // A pipe may deliver the first bytes one by one.
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

/// Reads a binary file of points.
fn read_binary(path: &Path, is_las: bool) -> Result<Points> {
    let file = FileBytes::open(path).map_err(|e| Error::open(path, e))?;
    let failed = |problem: String| Error::input(format!("{}: {problem}", path.display()));
    let mut reader: Box<dyn PointReader + '_> = match is_las {
        true => Box::new(LasReader::open(&file, Selection::All).map_err(failed)?),
        false => Box::new(PlyReader::open(&file).map_err(failed)?),
    };
    let mut points = Points::new(attributes(|attribute| reader.has(attribute)));
    if let Some(centre) = reader.stated_centre() {
        points.set_origin(centre);
    }
    let mut batch = Vec::new();
    let mut more = true;
    while more {
        batch.clear();
        more = reader.read_batch(&mut batch).map_err(failed)?;
        for row in &batch {
            push_row(&mut points, row, None);
        }
    }
    not_empty(points, path)
}

/// Adds a point; `object` replaces the number of its object.
pub(super) fn push_row(points: &mut Points, row: &PointRow, object: Option<&str>) {
    let mut number = itoa::Buffer::new();
    points.push(&Point {
        position: row.position,
        intensity: row.intensity,
        class: row.class.into(),
        return_number: row.return_number.into(),
        object: object.unwrap_or_else(|| number.format(row.object)),
        leg: row.leg,
        channel: row.channel,
        time: row.time,
    });
}

/// Returns the points, or an error if there are none.
pub(super) fn not_empty(points: Points, path: &Path) -> Result<Points> {
    match points.is_empty() {
        true if points.skipped() > 0 => Err(Error::input(format!(
            "{} holds no points with coordinates within ±{MAX_COORDINATE:e} m",
            path.display()
        ))),
        true => Err(Error::input(format!("{} holds no points", path.display()))),
        false => Ok(points),
    }
}

/// The attributes for which `has` is true.
pub(super) fn attributes(has: impl Fn(Attribute) -> bool) -> Attributes {
    Attributes {
        intensity: has(Attribute::Intensity),
        class: has(Attribute::Class),
        return_number: has(Attribute::ReturnNumber),
        object: has(Attribute::Object),
        leg: has(Attribute::Leg),
        channel: has(Attribute::Channel),
        time: has(Attribute::Time),
    }
}

/// Number of problems after which reading stops.
const MAX_PROBLEMS: usize = 10;

/// Maximum length of a line, bytes: a binary file without line ends must not fill the memory.
const MAX_LINE_BYTES: u64 = 1 << 16;

/// Reads text; `path` is the name of the file in messages.
fn read_text(mut source: impl BufRead, path: &Path) -> Result<Points> {
    let mut problems = Diagnostics::default();
    let mut points: Option<Points> = None;
    let (mut line, mut words) = (Vec::new(), Vec::new());
    let mut named: Option<Columns> = None;
    let mut is_first = true;
    for number in 1.. {
        line.clear();
        let read = source.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut line);
        if read.map_err(|e| Error::io("read", path, e))? == 0 {
            break;
        }
        let text = line.trim_ascii_end();
        let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
        if is_skipped(text) {
            continue;
        }
        words.clear();
        words.extend(Separators::guess(text).split(text));
        let columns = named.unwrap_or_else(|| columns_by_count(text, &mut words));
        match columns.parse(text, &words) {
            Ok(row) => {
                let object = columns.get(Attribute::Object).and_then(|column| words.get(column));
                let object = object.map(|at| String::from_utf8_lossy(text[at.clone()].trim_ascii()));
                let points = points.get_or_insert_with(|| Points::new(attributes(|a| columns.has(a))));
                push_row(points, &row, object.as_deref());
            }
            Err(_) if is_first && is_heading(text, &words) => {
                let name = |at: &Range<usize>| String::from_utf8_lossy(&text[at.clone()]).trim().to_owned();
                let names: Vec<String> = words.iter().map(name).collect();
                let found = Columns::find(names.iter().map(|name| name.trim_matches('"')));
                let has_position = Attribute::POSITION.iter().all(|a| found.has(*a));
                named = Some(found).filter(|_| has_position && names.len() > 4);
            }
            Err(bad) => {
                let shown = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
                let (before, found) = (shown(&text[..bad.at.start]), shown(text[bad.at].trim_ascii()));
                let place =
                    Place::in_line(path, number, &shown(text), before.len()..before.len() + found.len());
                let found =
                    if found.is_empty() { "the end of the line".to_owned() } else { format!("{found:?}") };
                problems.error(Some(place), format!("expected {}, found {found}", bad.attribute.described()));
                if problems.items().len() == MAX_PROBLEMS {
                    break;
                }
            }
        }
        is_first = false;
    }
    problems.finish(false)?;
    not_empty(points.unwrap_or_default(), path)
}

/// Number of columns of the point files of this program and of HELIOS++ (spec outputs §3).
const FULL_COLUMNS: usize = 11;

/// Assigns columns by the number of words of a line. The name of the hit object may be empty, which is not visible
/// between blanks: its word is inserted then.
fn columns_by_count(line: &[u8], words: &mut Vec<Range<usize>>) -> Columns {
    const OBJECT: usize = 8;
    words.truncate(FULL_COLUMNS);
    if words.len() == FULL_COLUMNS - 1 && !line.iter().any(|b| matches!(b, b',' | b';')) {
        words.insert(OBJECT, 0..0);
    }
    let columns = Attribute::POSITION.into_iter().zip(0..);
    let columns = columns.fold(Columns::default(), |columns, (a, column)| columns.with(a, column));
    match words.len() {
        FULL_COLUMNS => columns
            .with(Attribute::Intensity, 3)
            .with(Attribute::ReturnNumber, 5)
            .with(Attribute::Object, OBJECT)
            .with(Attribute::Class, 9)
            .with(Attribute::Time, 10),
        4.. => columns.with(Attribute::Intensity, 3),
        _ => columns,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DVec3;

    fn read(text: &str) -> Result<Points> {
        read_text(text.as_bytes(), Path::new("cloud.xyz"))
    }

    #[test]
    fn point_files_of_eleven_columns_have_everything() {
        // The example of spec outputs §3, and a line whose object has no name.
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
        // Infinite coordinates are numbers; the point is skipped.
        assert!(matches!(read("inf 0 0\n"), Err(Error::Input(_))));
        assert_eq!(read("inf 0 0\n1 2 3\n").unwrap().skipped(), 1);
    }

    fn written(name: &str, compressed: bool) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        let mut builder = las::Builder::from((1, 4));
        builder.point_format = las::point::Format::new(6).unwrap();
        builder.point_format.is_compressed = compressed;
        builder.point_format.extra_bytes = 12;
        let mut descriptors = vec![0u8; 2 * 192];
        for (i, (kind, label)) in
            [(10u8, &b"heliosAmplitude"[..]), (6, b"hitObjectId")].into_iter().enumerate()
        {
            descriptors[192 * i + 2] = kind;
            descriptors[192 * i + 4..192 * i + 4 + label.len()].copy_from_slice(label);
        }
        builder.vlrs.push(las::Vlr {
            user_id: "LASF_Spec".into(),
            record_id: 4,
            description: String::new(),
            data: descriptors,
        });
        let mut writer = las::Writer::from_path(&path, builder.into_header().unwrap()).unwrap();
        for i in 0..1000u32 {
            let mut extra = f64::from(i).to_le_bytes().to_vec();
            extra.extend_from_slice(&(i as i32 / 500).to_le_bytes());
            let point = las::Point {
                x: f64::from(i) * 0.1,
                y: 2.0,
                z: 3.0,
                return_number: 1 + (i % 3) as u8,
                number_of_returns: 3,
                classification: las::point::Classification::new(5).unwrap(),
                extra_bytes: extra,
                gps_time: Some(0.0),
                ..las::Point::default()
            };
            writer.write_point(point).unwrap();
        }
        writer.close().unwrap();
        (folder, path)
    }

    #[test]
    fn las_and_laz_give_position_class_return_amplitude_and_object() {
        for (name, compressed) in [("a.las", false), ("b.laz", true)] {
            let (_folder, path) = written(name, compressed);
            let points = read_points(&path).unwrap();
            assert_eq!(points.len(), 1000, "{name}");
            assert!((points.bounds().max.x - 99.9).abs() < 1e-9);
            assert_eq!(points.class[7], 5);
            assert_eq!(points.return_number[..4], [1, 2, 3, 1]);
            assert_eq!(points.intensity[321], 321.0);
            assert_eq!(points.objects, ["0", "1"]);
        }
    }

    #[test]
    fn damaged_files_are_input_problems() {
        let (folder, path) = written("a.las", false);
        let whole = std::fs::read(path).unwrap();
        for length in [0, 3, 100, 300, whole.len() - 5000] {
            let cut = folder.path().join("cut.las");
            std::fs::write(&cut, &whole[..length]).unwrap();
            assert!(matches!(read_points(&cut), Err(Error::Input(_))), "cut at {length}");
        }
        assert!(matches!(read_points(&folder.path().join("none.las")), Err(Error::Input(_))));
    }

    const HEADER: &str = "element camera 1\nproperty float focal\nelement vertex 2\nproperty double x\n\
                          property double y\nproperty float z\nproperty uchar Classification\n\
                          property int hit_object_id\nproperty list uchar int unused\nend_header\n";

    fn read_ply(bytes: &[u8]) -> Result<Points> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.ply");
        std::fs::write(&path, bytes).unwrap();
        read_points(&path)
    }

    fn check(points: &Points) {
        assert_eq!(points.len(), 2);
        assert_eq!(points.bounds().min, DVec3::new(1.25, 2.0, 3.0));
        assert_eq!(points.bounds().max.x, 5_474_500.125);
        assert_eq!(points.class, [2, 5]);
        assert_eq!(points.objects, ["7", "-1"]);
        assert!(!points.attributes().intensity);
    }

    #[test]
    fn text_and_binary_files_are_alike() {
        let text =
            format!("ply\nformat ascii 1.0\n{HEADER}35.0\n1.25 2 3 2 7 0\n5474500.125 5 6 5 -1 2 8 9\n");
        check(&read_ply(text.as_bytes()).unwrap());
        let mut binary = format!("ply\nformat binary_little_endian 1.0\n{HEADER}").into_bytes();
        binary.extend_from_slice(&35f32.to_le_bytes());
        for (x, y, z, class, object, list) in
            [(1.25, 2.0, 3f32, 2u8, 7i32, &[][..]), (5_474_500.125, 5.0, 6.0, 5, -1, &[8i32, 9][..])]
        {
            binary.extend_from_slice(&f64::to_le_bytes(x));
            binary.extend_from_slice(&f64::to_le_bytes(y));
            binary.extend_from_slice(&z.to_le_bytes());
            binary.push(class);
            binary.extend_from_slice(&object.to_le_bytes());
            binary.push(list.len() as u8);
            list.iter().for_each(|v| binary.extend_from_slice(&v.to_le_bytes()));
        }
        check(&read_ply(&binary).unwrap());
        // Truncated at any length, it is an input error.
        for length in (0..binary.len()).step_by(7) {
            assert!(matches!(read_ply(&binary[..length]), Err(Error::Input(_))), "cut at {length}");
        }
    }

    #[test]
    fn a_vast_count_does_not_ask_for_memory() {
        let text =
            "ply\nformat ascii 1.0\nelement vertex 18446744073709551615\nproperty float x\nend_header\n1\n";
        assert!(matches!(read_ply(text.as_bytes()), Err(Error::Input(_))));
    }
}
