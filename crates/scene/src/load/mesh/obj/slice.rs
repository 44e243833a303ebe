//! Reads one piece of an OBJ file independently of all others (spec input-formats §4.1).

use crate::builder::MAX_COORDINATE;
use crate::load::mesh::polygon::Fan;
use crate::number::{float, float_at, is_blank, skip_blanks};
use crate::text::{Line, Lines, Problems, Words, is_empty_line, operand, shown};
use std::ops::Range;
use vlscan_base::columns::comma_note;
use vlscan_geom::DVec3;

/// Vertex index for invalid references; faces with it are omitted.
pub(super) const NO_VERTEX: u32 = u32::MAX;

/// The content of a piece. Vertex indices of faces are absolute except for those listed in `relative`.
#[derive(Default)]
pub(super) struct Slice {
    /// Vertices; an unreadable one is NaN, so that the indices of later ones remain valid.
    pub vertices: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// The face of each triangle, from 0, if [`Reading::number_faces`] asks for it.
    pub face_of: Vec<u32>,
    /// Number of faces.
    pub faces: usize,
    /// Corners (3·triangle + corner) whose index counts from the first vertex of this piece, as a wrapped
    /// `i32`.
    pub relative: Vec<u32>,
    pub switches: Vec<Switch>,
    /// Faces of four and more corners, which are to be divided; none if polygons are omitted, so that the
    /// reference's division of quadrangles remains.
    pub fans: Vec<Fan>,
    /// Problems, with lines and bytes counted from the start of the piece.
    pub problems: Problems,
    /// Number of physical lines.
    pub lines: usize,
    /// Number of faces with more than four corners.
    pub polygons: usize,
    /// Number of points, lines, curves and surfaces, which rays cannot hit.
    pub elements: usize,
    /// Number of statements that the format does not define.
    pub unknown: usize,
}

/// A statement between the faces that changes their material.
pub(super) struct Switch {
    /// First triangle of the piece that it applies to.
    pub triangle: usize,
    /// Its line, from 1.
    pub line: usize,
    pub statement: Statement,
    /// The bytes of its operand within the piece.
    pub at: Range<usize>,
}

/// The statements of a [`Switch`].
pub(super) enum Statement {
    /// `usemtl` with the rest of its line.
    Use(Vec<u8>),
    /// `mtllib` with the rest of its line.
    Library(Vec<u8>),
}

/// Reading options.
#[derive(Clone, Copy)]
pub(crate) struct Reading {
    /// True if (x, y, z) is converted to (x, −z, y).
    pub y_up: bool,
    /// True if faces with more than four corners are omitted.
    pub drop_polygons: bool,
    /// True if the face of each triangle is recorded.
    pub number_faces: bool,
}

/// Reads a piece that consists of complete logical lines.
pub(super) fn read(bytes: &[u8], reading: Reading) -> Slice {
    let mut slice = Slice::default();
    let mut corners = Vec::new();
    let mut lines = Lines::new(bytes, true);
    for line in lines.by_ref() {
        slice.statement(&line, reading, &mut corners);
    }
    slice.lines = lines.passed;
    slice
}

/// The line (from 1) and the bytes of the face that became triangle `target` of a piece.
pub(super) fn locate(bytes: &[u8], reading: Reading, target: usize) -> Option<(usize, Range<usize>)> {
    let mut slice = Slice::default();
    let mut corners = Vec::new();
    Lines::new(bytes, true).find_map(|line| {
        slice.statement(&line, reading, &mut corners);
        let at = line.start..line.start + line.text.trim_ascii_end().len();
        (slice.triangles.len() > target).then_some((line.number, at))
    })
}

impl Slice {
    #[inline]
    fn statement(&mut self, line: &Line, reading: Reading, corners: &mut Vec<(u32, bool)>) {
        let text: &[u8] = &line.text;
        let start = skip_blanks(text, 0);
        match text.get(start..) {
            Some([b'v', b, ..]) if is_blank(*b) => self.vertex(line, start + 1, reading),
            Some([b'f', b, ..]) if is_blank(*b) => self.face(line, start + 1, reading, corners),
            None | Some([] | [b'#', ..] | [b'v', b'n' | b't' | b'p', ..]) => {}
            Some(_) => self.other(line, start),
        }
    }

    #[inline]
    fn vertex(&mut self, line: &Line, at: usize, reading: Reading) {
        let text: &[u8] = &line.text;
        let mut position = [f64::NAN; 3];
        let mut at = at;
        for coordinate in &mut position {
            at = skip_blanks(text, at);
            let (value, end) = float_at(text, at);
            match value.filter(|v| v.abs() <= MAX_COORDINATE) {
                Some(value) => *coordinate = value,
                None => {
                    self.vertices.push(DVec3::NAN);
                    return self.bad_vertex(line, at..end);
                }
            }
            at = end;
        }
        at = skip_blanks(text, at);
        if at < text.len() && text[at] != b'#' {
            self.rest_of_vertex(line, at);
        }
        let [x, y, z] = position;
        self.vertices.push(if reading.y_up { DVec3::new(x, -z, y) } else { DVec3::new(x, y, z) });
    }

    /// Warns of values after the coordinates, unless they are a weight of 1, a colour, or both.
    #[cold]
    fn rest_of_vertex(&mut self, line: &Line, at: usize) {
        let numbers: Option<Vec<f64>> = Words::new(&line.text, at).map(|(word, _)| float(word)).collect();
        let rest = at..line.text.trim_ascii_end().len();
        match numbers.as_deref() {
            Some([1.0] | [_, _, _] | [_, _, _, 1.0] | [1.0, _, _, _]) => {}
            Some([weight]) => self.problems.warn(line.number, in_file(line, rest), || {
                format!("the weight {weight} of a vertex is ignored: its coordinates are not divided by it")
            }),
            _ => self.problems.warn(line.number, in_file(line, rest.clone()), || {
                let found = shown(&line.text[rest]);
                format!(
                    "expected a colour of three numbers or nothing after three coordinates, found \
                     \"{found}\"; it is ignored"
                )
            }),
        }
    }

    #[cold]
    fn bad_vertex(&mut self, line: &Line, at: Range<usize>) {
        let found = shown(&line.text[at.clone()]);
        self.problems.error(line.number, line.start + at.start..line.start + at.end, || {
            let hint = comma_note(&found);
            let found =
                if found.is_empty() { "the end of the line".to_owned() } else { format!("\"{found}\"") };
            format!("expected a coordinate within ±{MAX_COORDINATE:e}, found {found}{hint}")
        });
    }

    #[inline]
    fn face(&mut self, line: &Line, at: usize, reading: Reading, corners: &mut Vec<(u32, bool)>) {
        let text: &[u8] = &line.text;
        corners.clear();
        let mut at = skip_blanks(text, at);
        while at < text.len() && text[at] != b'#' {
            let Some((number, end)) = vertex_number(text, at) else {
                return self.bad_corner(line, at);
            };
            corners.push(match number {
                1.. => (u32::try_from(number - 1).unwrap_or(NO_VERTEX), false),
                _ => ((self.vertices.len() as i64 + number) as i32 as u32, true),
            });
            at = skip_blanks(text, end);
        }
        if corners.len() < 3 {
            return self.problems.error(line.number, whole(line), || {
                format!("expected a face of three or more vertices, found {}", corners.len())
            });
        }
        self.faces += 1;
        if corners.len() > 4 {
            self.polygons += 1;
            if reading.drop_polygons {
                return;
            }
        }
        if corners.len() > 3 && !reading.drop_polygons {
            self.fans.push(Fan { first: self.triangles.len() as u32, triangles: corners.len() as u32 - 2 });
        }
        for i in 2..corners.len() {
            let fan = [corners[0], corners[i - 1], corners[i]];
            for (corner, (_, relative)) in fan.iter().enumerate() {
                if *relative {
                    self.relative.push((3 * self.triangles.len() + corner) as u32);
                }
            }
            self.triangles.push(fan.map(|(number, _)| number));
            if reading.number_faces {
                self.face_of.push(self.faces as u32 - 1);
            }
        }
    }

    #[cold]
    fn bad_corner(&mut self, line: &Line, at: usize) {
        let end = crate::number::word_end(&line.text, at);
        let found = shown(&line.text[at..end]);
        self.problems.error(line.number, line.start + at..line.start + end, || {
            format!("expected a vertex number, 1 or greater or negative, found \"{found}\"")
        });
    }

    fn other(&mut self, line: &Line, start: usize) {
        let mut words = Words::new(&line.text, start);
        let Some((keyword, keyword_at)) = words.next() else { return };
        let in_slice = |at: Range<usize>| line.start + at.start..line.start + at.end;
        match keyword {
            b"usemtl" | b"mtllib" => {
                let at = operand(&line.text, keyword_at.end);
                let name = line.text[at.clone()].to_vec();
                match (keyword, name.is_empty()) {
                    (b"usemtl", false) => self.switch(line, Statement::Use(name), in_slice(at)),
                    (_, false) => self.switch(line, Statement::Library(name), in_slice(at)),
                    (_, true) => self.problems.warn(line.number, whole(line), || {
                        format!("{} without a name is ignored", shown(keyword))
                    }),
                }
            }
            keyword if is_among(keyword, ELEMENTS) => self.elements += 1,
            keyword if is_among(keyword, IGNORED) => {}
            b"v" => {
                self.vertices.push(DVec3::NAN);
                self.bad_vertex(line, keyword_at.end..keyword_at.end);
            }
            b"f" => {
                self.problems
                    .error(line.number, whole(line), || "expected a face, found no vertices".to_owned());
            }
            _ => {
                self.unknown += 1;
                self.problems.warn(line.number, in_slice(keyword_at), || {
                    format!("unknown statement \"{}\" is ignored", shown(keyword))
                });
            }
        }
    }

    fn switch(&mut self, line: &Line, statement: Statement, at: Range<usize>) {
        self.switches.push(Switch { triangle: self.triangles.len(), line: line.number, statement, at });
    }
}

/// The vertex number at `at`, and the end of its word; texture and normal numbers are ignored.
#[inline]
fn vertex_number(text: &[u8], at: usize) -> Option<(i64, usize)> {
    let negative = text[at] == b'-';
    let first = at + usize::from(negative);
    let mut i = first;
    let mut value = 0i64;
    while let Some(d) = text.get(i).map(|b| b.wrapping_sub(b'0')).filter(|&d| d < 10) {
        value = value.saturating_mul(10).saturating_add(i64::from(d)).min(1 << 40);
        i += 1;
    }
    if i == first || value == 0 {
        return None;
    }
    match text.get(i) {
        Some(b'/') => i = crate::number::word_end(text, i),
        Some(b) if !is_blank(*b) => return None,
        _ => {}
    }
    // A number below −2³¹ would wrap to a positive one; no file has that many vertices.
    let value = if negative { -value } else { value };
    (value > -(1 << 31)).then_some((value, i))
}

fn in_file(line: &Line, at: Range<usize>) -> Range<usize> {
    line.start + at.start..line.start + at.end
}

fn whole(line: &Line) -> Range<usize> {
    if is_empty_line(&line.text) { line.start..line.start } else { line.start..line.start + line.text.len() }
}

/// Statements of points, lines, curves and surfaces, which use vertices but have no faces.
const ELEMENTS: &str = "l p curv curv2 surf sp bsp bzp";

/// Statements of the format that affect neither triangles nor their material.
const IGNORED: &str = "o g s mg cstype deg bmat step parm trim hole scrv end con bevel c_interp d_interp lod \
                       maplib usemap shadow_obj trace_obj ctech stech call csh";

fn is_among(keyword: &[u8], statements: &str) -> bool {
    statements.split(' ').any(|statement| statement.as_bytes() == keyword)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Reading = Reading { y_up: false, drop_polygons: false, number_faces: false };

    #[test]
    fn every_form_of_a_face() {
        let s = read(
            b"f 1 2 3\nf 1/1 2/2 3/3\nf 1//4 2//4 3//4\n  f\t1/1/1 2/2/2 3/3/3 4/4/4 # quad\nf 1 2 3 4 5\r\n",
            PLAIN,
        );
        let fan = [[0, 1, 2], [0, 2, 3], [0, 3, 4]];
        assert_eq!(s.triangles[..3], [[0, 1, 2]; 3]);
        assert_eq!(s.triangles[3..5], fan[..2]);
        assert_eq!(s.triangles[5..], fan);
        assert_eq!((s.polygons, s.lines), (1, 5));
        let dropped = read(b"f 1 2 3 4 5\n", Reading { drop_polygons: true, ..PLAIN });
        assert!(dropped.triangles.is_empty() && dropped.polygons == 1);
        let faces = b"f 1 2 3\nf 1 2 3 4\nf 1 2 3 4 5\nf 1 2 3\n";
        let numbered = Reading { drop_polygons: true, number_faces: true, ..PLAIN };
        assert_eq!(read(faces, numbered).face_of, [0, 1, 1, 3]);
    }

    #[test]
    fn every_form_of_a_vertex() {
        let s = read(
            b"v 1 2 3\nv -1.5e1 2.25 +3 0.5 0.5 0.5\n v 1 2 3 1.0 # w\nv 4321000.125 5 6\\\n.5\n",
            PLAIN,
        );
        assert_eq!(s.vertices[1], DVec3::new(-15.0, 2.25, 3.0));
        assert_eq!(s.vertices.len(), 4);
        let up = read(b"v 1 2 3\n", Reading { y_up: true, ..PLAIN });
        assert_eq!(up.vertices, [DVec3::new(1.0, -3.0, 2.0)]);
    }

    #[test]
    fn negative_numbers_count_back_from_the_face() {
        let s = read(b"v 0 0 0\nv 1 0 0\nf -1 -2 5\nv 1 1 0\nf -1 -3 -4\n", PLAIN);
        assert_eq!(s.triangles, [[1, 0, 4], [2, 0, u32::MAX]]);
        assert_eq!(s.relative, [0, 1, 3, 4, 5]);
    }

    #[test]
    fn bad_lines_are_named_all_at_once() {
        let s = read(
            b"v 1 2\nv a 0 0\nv nan 0 0\nv 1e300 0 0\nv\nf 1 0 2\nf 1 2\nf 1 x 2\nf 1.5 2 3\nf\nusemtl\nmtllib\nbinary?\nf 1 2 3\n",
            PLAIN,
        );
        assert_eq!((s.vertices.len(), s.triangles.len()), (5, 1));
        assert!(s.vertices.iter().all(|v| v.is_nan()));
        let source = crate::text::Source::of("x.obj", b"");
        let mut d = vlscan_base::diag::Diagnostics::default();
        s.problems.report(&source, &mut d);
        let mut lines: Vec<usize> = d.items().iter().flat_map(|i| i.lines()).collect();
        lines.sort_unstable();
        assert_eq!(lines, (1..=13).collect::<Vec<_>>());
    }

    #[test]
    fn a_triangle_is_found_again() {
        let text = b"v 0 0 0\n\nf 1 2 \\\n3\nf 4 5 6 7\nf 8 9 10\n";
        let at = |n| locate(text, PLAIN, n).map(|(line, at)| (line, &text[at]));
        assert_eq!(at(0).unwrap().0, 3);
        assert_eq!(at(2), Some((5, &b"f 4 5 6 7"[..])));
        assert_eq!(at(3), Some((6, &b"f 8 9 10"[..])));
        assert_eq!(at(4), None);
    }
}
