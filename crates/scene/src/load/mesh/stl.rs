//! STL, binary and text. The solids of a text file are its materials; a binary file has one, named after the
//! file. Colours of binary files are not read, and are warned of if they are requested.

use super::{RawMesh, StlError, UNREAD_COLOURS, diffuse};
use crate::text::Source;
use std::collections::HashMap;
use vlscan_base::columns::comma_note;
use vlscan_geom::DVec3;

/// Bytes before the triangles of a binary file: 80 of any content, then their number.
const HEADER_BYTES: usize = 84;
/// Offset up to which the first facet of a text file is searched for.
const MAX_FACET_OFFSET: usize = 1 << 12;
/// Bytes of a triangle: normal and corners as twelve floats, and two bytes more.
const TRIANGLE_BYTES: usize = 50;

/// True if a file without the extension of STL is STL.
pub(super) fn is_stl(bytes: &[u8]) -> bool {
    is_binary(bytes)
        || (begins_as_text(bytes)
            && bytes.windows(5).take(MAX_FACET_OFFSET).any(|word| word.eq_ignore_ascii_case(b"facet")))
}

/// True if a file begins like a text file, which binary files may also do.
fn begins_as_text(bytes: &[u8]) -> bool {
    let start = bytes.trim_ascii_start();
    start.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
}

/// True if the length matches a binary file with the stated number of triangles.
fn is_binary(bytes: &[u8]) -> bool {
    stated_count(bytes).is_some_and(|n| {
        n > 0 && n.checked_mul(TRIANGLE_BYTES).is_some_and(|size| bytes.len() - HEADER_BYTES == size)
    })
}

fn stated_count(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(80..HEADER_BYTES)?;
    Some(u32::from_le_bytes([count[0], count[1], count[2], count[3]]) as usize)
}

pub(super) fn read(source: &Source, colours: bool) -> Result<RawMesh, StlError> {
    let bytes = source.bytes();
    let name = source.path().file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if is_binary(bytes) {
        let mut mesh = read_binary(&bytes[HEADER_BYTES..], name);
        if colours && has_colours(bytes) {
            mesh.warnings.push(UNREAD_COLOURS.to_owned());
        }
        return Ok(mesh);
    }
    if begins_as_text(bytes) && !bytes[..bytes.len().min(512)].contains(&0) {
        return read_text(bytes, &name);
    }
    match stated_count(bytes) {
        Some(count) => {
            let triangles = &bytes[HEADER_BYTES..];
            let held = triangles.len() / TRIANGLE_BYTES;
            if count == 0 || count > held {
                return Err(StlError::Truncated { count, held });
            }
            let (triangles, rest) = triangles.split_at(count * TRIANGLE_BYTES);
            let mut mesh = read_binary(triangles, name);
            mesh.warnings.push(format!(
                "the file states {count} triangles; the {} bytes after them are left out",
                rest.len()
            ));
            Ok(mesh)
        }
        None => Err(StlError::NoHeader),
    }
}

/// True if a binary file has colours as VisCAM and SolidView, or as Materialise Magics, write them: in the
/// last two bytes of triangles, with the highest bit set, or named in the header.
fn has_colours(bytes: &[u8]) -> bool {
    let (header, triangles) = bytes.split_at(HEADER_BYTES);
    header.windows(6).any(|word| word == b"COLOR=")
        || triangles.chunks_exact(TRIANGLE_BYTES).any(|triangle| triangle[TRIANGLE_BYTES - 1] & 0x80 != 0)
}

/// Corners that several triangles share, by the bits of their coordinates.
#[derive(Default)]
struct Corners {
    known: HashMap<[u64; 3], u32>,
}

impl Corners {
    fn number(&mut self, mesh: &mut RawMesh, corner: [f64; 3]) -> u32 {
        *self.known.entry(corner.map(f64::to_bits)).or_insert_with(|| {
            mesh.vertices.push(DVec3::from(corner));
            mesh.vertices.len() as u32 - 1
        })
    }
}

fn read_binary(triangles: &[u8], name: String) -> RawMesh {
    let mut mesh = RawMesh { materials: vec![diffuse(name)], is_single: true, ..RawMesh::default() };
    let mut corners = Corners::default();
    for triangle in triangles.chunks_exact(TRIANGLE_BYTES) {
        let float = |i: usize| f64::from(f32::from_le_bytes([0, 1, 2, 3].map(|b| triangle[12 + 4 * i + b])));
        let numbers = [0, 3, 6].map(|i| corners.number(&mut mesh, [float(i), float(i + 1), float(i + 2)]));
        mesh.add_polygon(&numbers, 0);
    }
    mesh
}

fn read_text(bytes: &[u8], file_name: &str) -> Result<RawMesh, StlError> {
    let text = String::from_utf8_lossy(bytes);
    let mut mesh = RawMesh::default();
    let mut corners = Corners::default();
    let mut solids: HashMap<&str, u32> = HashMap::new();
    let mut loop_of: Vec<u32> = Vec::new();
    let (mut open, mut current) = (false, 0);
    for (number, line) in (1..).zip(text.lines()) {
        let mut words = line.split_ascii_whitespace();
        let wrong = |expected, note| {
            let found = line.trim().chars().take(60).collect();
            StlError::Line { line: number, expected, found, note }
        };
        match words.next().map(str::to_ascii_lowercase).as_deref() {
            Some("solid") => {
                let name = line.trim_start()[5..].trim();
                let name = if name.is_empty() { file_name } else { name };
                current = *solids.entry(name).or_insert_with(|| {
                    mesh.materials.push(diffuse(name));
                    mesh.materials.len() as u32 - 1
                });
                open = true;
            }
            Some("vertex") => {
                let mut hint = "";
                let mut coordinate = || {
                    let word = words.next()?;
                    hint = if hint.is_empty() { comma_note(word) } else { hint };
                    word.parse::<f64>().ok()
                };
                let (Some(x), Some(y), Some(z)) = (coordinate(), coordinate(), coordinate()) else {
                    return Err(wrong("expected three coordinates", hint));
                };
                if words.next().is_some() {
                    return Err(wrong("expected three coordinates and no more", ""));
                }
                loop_of.push(corners.number(&mut mesh, [x, y, z]));
            }
            Some("endloop") => {
                if loop_of.len() < 3 {
                    return Err(wrong("expected three corners before the end of a loop", ""));
                }
                mesh.add_polygon(&loop_of, current);
                loop_of.clear();
            }
            Some("endsolid") => open = false,
            None | Some("facet" | "outer" | "endfacet") => {}
            Some(_) => return Err(wrong("expected a line of STL", "")),
        }
    }
    if open {
        return Err(StlError::NoEnd);
    }
    Ok(mesh)
}
