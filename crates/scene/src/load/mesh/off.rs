//! OFF, the Object File Format of Geomview: the variants `OFF`, `COFF`, `NOFF`, `STOFF` and their
//! combinations, as text. Normals, colours and texture coordinates are not used: what a surface reflects
//! follows from its material. Colours are warned of if they are requested.

use super::{OffError, RawMesh, UNREAD_COLOURS, diffuse};
use crate::text::Source;
use vlscan_base::columns::comma_note;
use vlscan_geom::DVec3;

/// Layout of a vertex line, by the first word of the file.
struct Layout {
    /// Numbers behind the coordinates, in all forms that programs write.
    more: Vec<usize>,
    /// True if colours or texture coordinates are among them.
    has_colours: bool,
}

impl Layout {
    /// The layout of a first word in capitals; `None` for other words.
    fn of(word: &str) -> Option<Result<Layout, OffError>> {
        let flags = word.strip_suffix("OFF")?;
        let mut more = vec![0];
        let mut rest = flags;
        let mut add = |counts: &[usize]| {
            more = more.iter().flat_map(|sum| counts.iter().map(move |count| sum + count)).collect();
        };
        for (flag, counts) in [("ST", &[2][..]), ("C", &[3, 4]), ("N", &[3])] {
            if let Some(without) = rest.strip_prefix(flag) {
                add(counts);
                rest = without;
            }
        }
        Some(match rest {
            "" => Ok(Layout { more, has_colours: flags.contains(['C', 'T']) }),
            "4" | "4N" => Err(OffError::Dimensions { word: word.to_owned() }),
            _ => return None,
        })
    }
}

/// The lines of a file without comments and blank lines, with their numbers.
struct Lines<'t> {
    lines: Box<dyn Iterator<Item = (usize, &'t str)> + 't>,
    last: usize,
}

impl<'t> Lines<'t> {
    fn new(text: &'t str) -> Lines<'t> {
        let content =
            |(number, line): (usize, &'t str)| (number, line.split('#').next().unwrap_or_default().trim());
        let lines = (1..).zip(text.lines()).map(content).filter(|(_, line)| !line.is_empty());
        Lines { lines: Box::new(lines), last: 1 }
    }

    fn next(&mut self, expected: &'static str) -> Result<(usize, &'t str), OffError> {
        let line = self.lines.next();
        let line = line.ok_or(OffError::Truncated { line: self.last, expected })?;
        self.last = line.0;
        Ok(line)
    }
}

/// Reads the polygons of a file; its material has the name of the file. Warns of colours if they are
/// requested.
///
/// # Errors
/// The first line that is wrong.
pub(super) fn read(source: &Source, colours: bool) -> Result<RawMesh, OffError> {
    let bytes = source.bytes();
    let text = String::from_utf8_lossy(bytes);
    let text = if text.contains('\n') { text } else { text.replace('\r', "\n").into() };
    let mut lines = Lines::new(&text);
    let (mut number, mut line) = lines.next("OFF")?;
    let mut layout = Layout { more: vec![0], has_colours: false };
    // The word may be missing, and the counts may follow it without a blank, as in ModelNet.
    let end = line.to_ascii_uppercase().find("OFF").map_or(0, |at| at + 3);
    if let Some(found) = Layout::of(&line[..end].to_ascii_uppercase()) {
        layout = found?;
        line = line[end..].trim_start();
        if line.to_ascii_uppercase().starts_with("BINARY") {
            return Err(OffError::Binary);
        }
        if line.is_empty() {
            (number, line) = lines.next("the numbers of vertices, faces and edges")?;
        }
    }
    let counts = numbers(line, number)?;
    let is_count = |count: &f64| *count >= 0.0 && count.fract() == 0.0 && *count < f64::from(u32::MAX);
    let [vertices, faces, ..] = counts.as_slice() else {
        return Err(OffError::Counts { line: number, found: shown(line) });
    };
    if counts.len() > 3 || !counts.iter().all(is_count) {
        return Err(OffError::Counts { line: number, found: shown(line) });
    }
    let name = source.path().file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut mesh = RawMesh { materials: vec![diffuse(name)], ..RawMesh::default() };
    for _ in 0..*vertices as usize {
        mesh.vertices.push(vertex(&mut lines, &layout)?);
    }
    let mut has_colours = layout.has_colours;
    for _ in 0..*faces as usize {
        has_colours |= face(&mut lines, &mut mesh)?;
    }
    if colours && has_colours {
        mesh.warnings.push(UNREAD_COLOURS.to_owned());
    }
    let left = lines.lines.by_ref().count();
    if left > 0 {
        mesh.warnings.push(format!("the {left} lines after the faces that it states are left out"));
    }
    Ok(mesh)
}

fn vertex(lines: &mut Lines, layout: &Layout) -> Result<DVec3, OffError> {
    let (number, line) = lines.next("a vertex")?;
    let values = numbers(line, number)?;
    match values.as_slice() {
        [x, y, z, more @ ..] if layout.more.contains(&more.len()) => Ok(DVec3::new(*x, *y, *z)),
        _ => {
            let counts: Vec<String> = layout.more.iter().map(|more| (3 + more).to_string()).collect();
            Err(OffError::Vertex { line: number, expected: counts.join(" or "), found: values.len() })
        }
    }
}

/// A face: the number of its corners, the corners from 0, and a colour as an index or three or four numbers.
/// Returns true if it has a colour.
fn face(lines: &mut Lines, mesh: &mut RawMesh) -> Result<bool, OffError> {
    let (number, line) = lines.next("a face")?;
    let values = numbers(line, number)?;
    let (count, rest) = values.split_first().map_or((0.0, &[][..]), |(count, rest)| (*count, rest));
    if count < 1.0 || count.fract() != 0.0 || count as usize > rest.len() {
        return Err(OffError::Corners { line: number, found: shown(line) });
    }
    let (corners, colour) = rest.split_at(count as usize);
    if !matches!(colour.len(), 0 | 1 | 3 | 4) {
        return Err(OffError::Colour { line: number, count, found: colour.len() });
    }
    let held = mesh.vertices.len();
    if let Some(&corner) =
        corners.iter().find(|corner| corner.fract() != 0.0 || !(0.0..held as f64).contains(*corner))
    {
        return Err(OffError::OutOfRange { line: number, corner, count: held });
    }
    let corners: Vec<u32> = corners.iter().map(|corner| *corner as u32).collect();
    mesh.add_polygon(&corners, 0);
    Ok(!colour.is_empty())
}

fn numbers(line: &str, number: usize) -> Result<Vec<f64>, OffError> {
    let parsed = line.split_ascii_whitespace().map(|word| {
        let value = word.parse::<f64>().ok().filter(|value| value.is_finite());
        value.ok_or_else(|| OffError::Number { line: number, found: shown(word), note: comma_note(word) })
    });
    parsed.collect()
}

fn shown(text: &str) -> String {
    text.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<RawMesh, String> {
        read(&Source::of("cube.off", text.as_bytes()), false).map_err(|e| e.to_string())
    }

    const SQUARE: &str = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";

    #[test]
    fn all_variants_have_the_same_faces() {
        let lines = |more: &str| SQUARE.lines().map(|line| format!("{line}{more}\n")).collect::<String>();
        for text in [
            format!("OFF\n4 1 0\n{SQUARE}4 0 1 2 3\n"),
            format!("off 4 1 4\n{SQUARE}4 0 1 2 3 255 0 0\n"),
            format!("OFF4 1 0\n{SQUARE}4 0 1 2 3\n"),
            format!("# made by hand\n\n4 1 0\n{SQUARE}# the face\n4 0 1 2 3 7\n"),
            format!("COFF\r\n4 1 0\r\n{}4 0 1 2 3\n", lines(" 255 0 0 255")),
            format!("COFF\n4 1 0\n{}4 0 1 2 3 0.5 0.5 0.5 1\n", lines(" 1 0 0")),
            format!("NOFF\n4 1 0\n{}4 0 1 2 3\n", lines(" 0 0 1")),
            format!("STCNOFF\n4 1 0\n{}4 0 1 2 3\n", lines(" 0 0 1 1 0 0 1 0 0")),
            format!("OFF\n4 1 0\n{SQUARE}4 0 1 2 3").replace('\n', "\r"),
        ] {
            let mesh = read_text(&text).unwrap_or_else(|e| panic!("{text}: {e}"));
            assert_eq!((mesh.vertices.len(), mesh.triangles.len(), mesh.faces), (4, 2, 1), "{text}");
            assert_eq!(
                (mesh.vertices[2], mesh.materials[0].name.as_str()),
                (DVec3::new(1.0, 1.0, 0.0), "cube")
            );
            assert!(mesh.warnings.is_empty());
        }
    }

    #[test]
    fn wrong_files_are_refused_with_their_line() {
        let square = |head: &str, rest: &str| format!("{head}\n4 1 0\n{SQUARE}{rest}");
        for (text, part) in [
            (square("OFF BINARY", ""), "binary OFF is not read"),
            (square("4OFF", ""), "other than three dimensions"),
            (square("OFF", "4 0 1 2 4\n"), "line 7: vertex 4 does not exist; there are 4, from 0"),
            (square("OFF", "4 0 1 2 -1\n"), "line 7: vertex -1"),
            (square("OFF", "4 0 1 2\n"), "line 7: expected the number of corners"),
            (square("OFF", "3 0 1 2 9 9\n"), "line 7: expected 3 corners and the numbers of a colour"),
            (square("OFF", ""), "line 6: expected a face, found the end of the file"),
            (square("NOFF", ""), "line 3: expected 6 numbers of a vertex, found 3"),
            ("OFF\n3 1 0\n0,5 0 0\n".to_owned(), "line 3: expected a number, found \"0,5\""),
            ("OFF\n4000000000 9 9\n".to_owned(), "line 2: expected a vertex, found the end"),
            ("OFF\n3 -1 0\n".to_owned(), "line 2: expected the numbers of vertices"),
            ("OFF\n3\n".to_owned(), "line 2: expected the numbers of vertices"),
        ] {
            let said = read_text(&text).unwrap_err();
            assert!(said.contains(part), "{text}: {said}");
        }
        let mesh = read_text(&square("OFF", "4 0 1 2 3\n4 0 1 2 3\n")).unwrap();
        assert!(mesh.warnings[0].contains("the 1 lines after the faces"), "{:?}", mesh.warnings);
    }

    #[test]
    fn colours_that_are_requested_are_not_read() {
        let corners = |more: &str| SQUARE.lines().map(|line| format!("{line}{more}\n")).collect::<String>();
        for (text, has_colours) in [
            (format!("OFF\n4 1 0\n{SQUARE}4 0 1 2 3\n"), false),
            (format!("NOFF\n4 1 0\n{}4 0 1 2 3\n", corners(" 0 0 1")), false),
            (format!("OFF\n4 1 0\n{SQUARE}4 0 1 2 3 255 0 0\n"), true),
            (format!("COFF\n4 1 0\n{}4 0 1 2 3\n", corners(" 255 0 0 255")), true),
            (format!("STOFF\n4 1 0\n{}4 0 1 2 3\n", corners(" 0 1")), true),
        ] {
            let mesh = read(&Source::of("cube.off", text.as_bytes()), true).unwrap();
            assert_eq!(mesh.warnings == [UNREAD_COLOURS], has_colours, "{text}: {:?}", mesh.warnings);
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "(OFF|COFF|[ST4nN]{0,3}OFF)?[ \n]?[-0-9. \n#]{0,80}") {
            let _ = read_text(&text);
        }
    }
}
