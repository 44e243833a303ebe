//! Texture coordinates and colours of corners of OBJ files. They are read only if colours are requested,
//! after the geometry, in a second pass over the file.

use super::slice::Reading;
use crate::number::{float_at, is_blank, skip_blanks};
use crate::text::{Line, Lines};
use std::ops::Range;
use vlscan_survey::MeshColours;

/// Texture coordinates of a corner without any.
const NO_TEXEL: [f32; 2] = [f32::NAN; 2];

/// Number of a corner that has no texture coordinates.
const NO_NUMBER: i64 = -1;

/// Number of a vertex or of texture coordinates that do not exist.
const NOWHERE: i64 = i64::MIN;

/// Triangles whose material has a texture that they cannot show.
#[derive(Debug, Default)]
pub(super) struct Untextured {
    /// Triangles with texture coordinates that do not exist or are no numbers.
    pub wrong: Occurrences,
    /// Others without texture coordinates.
    pub missing: Occurrences,
}

/// Number and place of triangles.
#[derive(Debug, Default)]
pub(super) struct Occurrences {
    /// Number of triangles.
    pub count: usize,
    /// Line of the first one, from 1, and its bytes in the file.
    pub first: (usize, Range<usize>),
}

impl Occurrences {
    fn add(&mut self, line: &Line) {
        if self.count == 0 {
            self.first = (line.number, line.start..line.start + line.text.len());
        }
        self.count += 1;
    }
}

/// Colours of the triangles of a file. `triangles` are the vertices of those that are in the scene, as their
/// numbers in the file from 0, and `face_of` the face of each, from 0 and ascending. Corners whose texture
/// coordinates do not exist or are no numbers have none; these triangles are `untextured` if their material
/// has a texture, as `is_textured` states for a triangle.
pub(super) fn read(
    bytes: &[u8],
    reading: Reading,
    (triangles, face_of): (&[[u32; 3]], &[u32]),
    is_textured: impl Fn(usize) -> bool,
    untextured: &mut Untextured,
) -> MeshColours {
    let lists = Lists::of(bytes);
    let tints = lists.tints(triangles);
    if lists.texels.is_empty() && !(0..triangles.len()).any(&is_textured) {
        return MeshColours { texels: Vec::new(), tints };
    }
    let mut texels = vec![[NO_TEXEL; 3]; triangles.len()];
    let (mut face, mut next, mut has_texels) = (0, 0, false);
    let mut counts = Counts::default();
    let mut corners = Vec::new();
    for line in Lines::new(bytes, true) {
        let text: &[u8] = &line.text;
        match Keyword::of(text) {
            Keyword::Vertex(_) => counts.vertices += 1,
            Keyword::Texel(_) => counts.texels += 1,
            Keyword::Face(at) => {
                corners.clear();
                read_corners(text, at, counts, &mut corners);
                if corners.len() > 4 && reading.drop_polygons {
                    face += 1;
                    continue;
                }
                while face_of.get(next) == Some(&face) {
                    let (mut is_wrong, mut is_missing) = (false, false);
                    for (slot, vertex) in texels[next].iter_mut().zip(triangles[next]) {
                        let corner = corners.iter().find(|(number, _)| *number == i64::from(vertex));
                        match corner.map_or(NO_NUMBER, |(_, texel)| *texel) {
                            NO_NUMBER => is_missing = true,
                            number => match lists.texel(number) {
                                Some(found) => (*slot, has_texels) = (found, true),
                                None => is_wrong = true,
                            },
                        }
                    }
                    if (is_wrong || is_missing) && is_textured(next) {
                        let kind = if is_wrong { &mut untextured.wrong } else { &mut untextured.missing };
                        kind.add(&line);
                    }
                    next += 1;
                }
                face += 1;
            }
            Keyword::Other => {}
        }
    }
    MeshColours { texels: if has_texels { texels } else { Vec::new() }, tints }
}

/// Statements with what colours need, each with the start of its values.
enum Keyword {
    Vertex(usize),
    Texel(usize),
    Face(usize),
    Other,
}

impl Keyword {
    fn of(text: &[u8]) -> Keyword {
        let start = skip_blanks(text, 0);
        match text.get(start..) {
            Some([b'v', b, ..]) if is_blank(*b) => Keyword::Vertex(start + 1),
            Some([b'v', b't', b, ..]) if is_blank(*b) => Keyword::Texel(start + 2),
            Some([b'f', b, ..]) if is_blank(*b) => Keyword::Face(start + 1),
            _ => Keyword::Other,
        }
    }
}

/// Numbers of the vertices and texture coordinates before a line, from which negative numbers count.
#[derive(Clone, Copy, Default)]
struct Counts {
    vertices: i64,
    texels: i64,
}

/// Appends the corners of a face: the numbers of vertex and texture coordinates, both from 0, [`NO_NUMBER`]
/// or [`NOWHERE`].
fn read_corners(text: &[u8], at: usize, counts: Counts, corners: &mut Vec<(i64, i64)>) {
    let index = |word: &[u8], count: i64| {
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse::<i64>().ok()).unwrap_or(0);
        let index = if number < 0 { count.saturating_add(number) } else { number - 1 };
        if index < 0 { NOWHERE } else { index }
    };
    let words = text[at..].split(|b| is_blank(*b)).filter(|word| !word.is_empty());
    for word in words.take_while(|word| word[0] != b'#') {
        let mut numbers = word.split(|b| *b == b'/');
        let vertex = numbers.next().map_or(NOWHERE, |number| index(number, counts.vertices));
        let texel = numbers.next().filter(|number| !number.is_empty());
        corners.push((vertex, texel.map_or(NO_NUMBER, |number| index(number, counts.texels))));
    }
}

/// Lists of a file that faces refer to.
struct Lists {
    texels: Vec<[f32; 2]>,
    /// Colours of vertices; fewer than vertices if the last ones have none, NaN for those before without.
    tints: Vec<[f32; 3]>,
}

impl Lists {
    fn of(bytes: &[u8]) -> Lists {
        let mut lists = Lists { texels: Vec::new(), tints: Vec::new() };
        let mut vertices = 0;
        for line in Lines::new(bytes, true) {
            let text: &[u8] = &line.text;
            match Keyword::of(text) {
                Keyword::Vertex(at) => {
                    if let Some(tint) = tint_of(&numbers::<7>(text, at)) {
                        lists.tints.resize(vertices, [f32::NAN; 3]);
                        lists.tints.push(tint);
                    }
                    vertices += 1;
                }
                Keyword::Texel(at) => {
                    let [u, v] = numbers::<2>(text, at);
                    // A texture of one dimension has no second coordinate.
                    lists.texels.push([u as f32, if v.is_nan() { 0.0 } else { v as f32 }]);
                }
                _ => {}
            }
        }
        lists
    }

    /// Texture coordinates by their number.
    fn texel(&self, number: i64) -> Option<[f32; 2]> {
        let found = self.texels.get(usize::try_from(number).ok()?)?;
        found.iter().all(|coordinate| coordinate.is_finite()).then_some(*found)
    }

    /// The colours of the corners of triangles; none if no vertex has one. Vertices without a colour are
    /// white.
    fn tints(&self, triangles: &[[u32; 3]]) -> Vec<[[u16; 3]; 3]> {
        if self.tints.is_empty() {
            return Vec::new();
        }
        let components = self.tints.iter().flatten().copied();
        // Some programs write 0 to 255.
        let scale = if components.fold(0.0, f32::max) > 1.0 { 257.0 } else { 65_535.0 };
        // The conversion saturates.
        let component = |value: f32| if value.is_nan() { u16::MAX } else { (value * scale).round() as u16 };
        let tint = |vertex: u32| self.tints.get(vertex as usize).map_or([u16::MAX; 3], |t| t.map(component));
        triangles.iter().map(|corners| corners.map(tint)).collect()
    }
}

/// The colour after the coordinates of a vertex, before or after a weight.
fn tint_of(numbers: &[f64; 7]) -> Option<[f32; 3]> {
    let count = numbers.iter().take_while(|n| !n.is_nan()).count();
    let first = match count {
        6 => 3,
        7 if numbers[6] == 1.0 || numbers[3] != 1.0 => 3,
        7 => 4,
        _ => return None,
    };
    Some([0, 1, 2].map(|i| numbers[first + i] as f32))
}

/// Up to `N` numbers of a line; NaN for those that are missing.
fn numbers<const N: usize>(text: &[u8], at: usize) -> [f64; N] {
    let mut at = at;
    let mut found = [f64::NAN; N];
    for number in &mut found {
        at = skip_blanks(text, at);
        let (value, end) = float_at(text, at);
        let Some(value) = value else { break };
        *number = value;
        at = end;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const READING: Reading = Reading { y_up: false, drop_polygons: false, number_faces: true };

    fn read(bytes: &[u8], triangles: &[[u32; 3]], face_of: &[u32]) -> MeshColours {
        super::read(bytes, READING, (triangles, face_of), |_| true, &mut Untextured::default())
    }

    #[test]
    fn corners_have_the_coordinates_of_their_face() {
        let text =
            b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3 4/-3\nvt .5 .25\n\
                     f -4/-1 2/1/9 3 # c\nf 1//1 2//1 3//1\n";
        // The quadrangle is divided along its other diagonal; the second face has no texel at a corner.
        let triangles = [[0, 1, 3], [3, 1, 2], [0, 1, 2], [0, 1, 2]];
        let found = read(text, &triangles, &[0, 0, 1, 2]).texels;
        assert_eq!(found[0], [[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]);
        assert_eq!(found[1], [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]);
        assert_eq!(found[2][..2], [[0.5, 0.25], [0.0, 0.0]]);
        assert!(found[2][2][0].is_nan() && found[3].iter().flatten().all(|t| t.is_nan()));
        // The first of two triangles was left out.
        let found = read(text, &triangles[1..], &[0, 1, 2]).texels;
        assert_eq!(found[0][2], [1.0, 1.0]);
        assert!(read(b"v 0 0 0\nvt 1 1\nf 1 1 1\n", &[[0; 3]], &[0]).texels.is_empty());
    }

    #[test]
    fn textures_without_coordinates_are_counted() {
        let of = |lines: &str, face: &str| {
            let text = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{lines}f {face}\nf 1 2 3\n");
            let (mut untextured, triangles) = (Untextured::default(), [[0, 1, 2]; 2]);
            let faces = (&triangles[..], &[0, 1][..]);
            let found = super::read(text.as_bytes(), READING, faces, |_| true, &mut untextured);
            let Untextured { wrong, missing } = untextured;
            let has_none = found.texels.iter().flatten().flatten().all(|t| t.is_nan());
            ((wrong.count, wrong.first.0), (missing.count, missing.first.0), has_none)
        };
        let (usual, two) = ("1/1 2/1 3/2", "vt 0 0\nvt 1 1\n");
        assert_eq!(of(two, usual), ((0, 0), (1, 7), false));
        assert_eq!(of("vt 0 0\n", usual), ((1, 5), (1, 6), false));
        for wrong in ["abc 0", "nan 0", "", "1e39 0"] {
            let lines = format!("vt {wrong}\nvt 1e39 1\n");
            assert_eq!(of(&lines, usual), ((1, 6), (1, 7), true), "{wrong}");
        }
        assert_eq!(of("", "1 2 3"), ((0, 0), (2, 4), true));
        assert_eq!(of("", usual), ((1, 4), (1, 5), true));
        // Numbers count back from the face.
        assert_eq!(of(two, "-3/-2 -2/-2 -1/-1"), ((0, 0), (1, 7), false));
        for wrong in ["-3", "0", "x", "1.5", "-9223372036854775808", "99999999999999999999"] {
            assert_eq!(of(two, &format!("1/1 2/1 3/{wrong}")), ((1, 6), (1, 7), false), "{wrong}");
        }
    }

    #[test]
    fn nothing_is_missing_without_a_texture() {
        let (mut untextured, triangles) = (Untextured::default(), [[0, 1, 2]]);
        let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/7 2 3\n";
        super::read(text, READING, (&triangles, &[0]), |_| false, &mut untextured);
        assert_eq!((untextured.wrong.count, untextured.missing.count), (0, 0));
    }

    #[test]
    fn vertices_have_colours_with_and_without_a_weight() {
        let of = |lines: &str| read(lines.as_bytes(), &[[0, 1, 2]], &[0]).tints;
        assert!(of("v 0 0 0\nv 1 0 0\nv 0 1 0\n").is_empty());
        let mixed = of("v 0 0 0\nv 1 0 0 0.5 0 1\nv 0 1 0 1 0.2 0.4 0.6\n");
        assert_eq!(mixed[0], [[65_535; 3], [32_768, 0, 65_535], [13_107, 26_214, 39_321]]);
        let bytes = of("v 0 0 0 255 0 10\nv 1 0 0 0 0 0\nv 0 1 0 1 1 1\n");
        assert_eq!(bytes[0], [[65_535, 0, 2570], [0; 3], [257; 3]]);
    }
}
