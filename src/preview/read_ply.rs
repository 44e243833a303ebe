//! Reads PLY, text and binary.

use super::points::{Attributes, Point, Points};
use crate::error::{Error, Result};
use crate::geom::DVec3;
use crate::input::ply::number;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult};
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind};
use std::path::Path;

/// Reads the `vertex` elements; properties are found by the names that are common in point clouds.
pub(super) fn read(path: &Path) -> Result<Points> {
    let file = File::open(path).map_err(|e| Error::io("read", path, e))?;
    read_from(BufReader::with_capacity(1 << 20, file), path)
}

fn read_from(source: impl BufRead, path: &Path) -> Result<Points> {
    let failed =
        |e: ParseError| Error::input(format!("{} is not a PLY file that can be read: {e}", path.display()));
    let parser = Parser::<Vertex>::new();
    let mut reader = Reader::new(source);
    let header = parser.read_header(&mut reader).map_err(failed)?;
    let mut source = reader.into_inner();
    let mut line = String::new();
    for element in header.elements.values().filter(|e| !e.properties.is_empty()) {
        let is_vertex = element.name == "vertex";
        let mut points = Points::new(attributes(element));
        for _ in 0..element.count {
            let vertex = match header.encoding {
                Encoding::Ascii => {
                    line.clear();
                    // Lines of a point cloud are short; a file without line ends must not fill the memory.
                    let read = std::io::Read::take(&mut source, 1 << 16).read_line(&mut line);
                    read.map_err(|e| match e.kind() {
                        ErrorKind::InvalidData => failed(e.into()),
                        _ => Error::io("read", path, e),
                    })?;
                    parser.read_ascii_element(&line, element)
                }
                Encoding::BinaryLittleEndian => parser.read_little_endian_element(&mut source, element),
                Encoding::BinaryBigEndian => parser.read_big_endian_element(&mut source, element),
            };
            let vertex = vertex.map_err(failed)?;
            if is_vertex {
                points.push(&vertex.point());
            }
        }
        if is_vertex && !points.is_empty() {
            return Ok(points);
        }
    }
    Err(Error::input(format!("{} holds no points", path.display())))
}

/// What a property of a vertex is.
#[derive(Clone, Copy, PartialEq)]
enum Role {
    X,
    Y,
    Z,
    Intensity,
    Class,
    Return,
    Object,
}

/// The role of a property; names are compared without case, underscores and CloudCompare's prefix.
fn role(name: &str) -> Option<Role> {
    let plain: String = name.to_ascii_lowercase().chars().filter(|c| *c != '_').collect();
    match plain.strip_prefix("scalar").unwrap_or(&plain) {
        "x" => Some(Role::X),
        "y" => Some(Role::Y),
        "z" => Some(Role::Z),
        "intensity" | "amplitude" | "heliosamplitude" => Some(Role::Intensity),
        "classification" | "class" | "label" => Some(Role::Class),
        "returnnumber" | "return" => Some(Role::Return),
        "hitobjectid" | "objectid" | "object" | "partid" | "part" => Some(Role::Object),
        _ => None,
    }
}

fn attributes(element: &ElementDef) -> Attributes {
    let has = |wanted: Role| element.properties.values().any(|p| role(&p.name) == Some(wanted));
    Attributes {
        intensity: has(Role::Intensity),
        class: has(Role::Class),
        return_number: has(Role::Return),
        object: has(Role::Object),
    }
}

/// A vertex as it is read.
struct Vertex {
    position: DVec3,
    intensity: f64,
    class: f64,
    return_number: f64,
    object: String,
}

impl Vertex {
    fn point(&self) -> Point<'_> {
        Point {
            position: self.position,
            intensity: self.intensity as f32,
            class: self.class as i32,
            return_number: self.return_number as u32,
            object: &self.object,
        }
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Vertex {
        Vertex { position: DVec3::NAN, intensity: 0.0, class: 0.0, return_number: 0.0, object: String::new() }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(value) = number(&property) else { return PropertyAccessResult::Ignored };
        match role(name) {
            Some(Role::X) => self.position.x = value,
            Some(Role::Y) => self.position.y = value,
            Some(Role::Z) => self.position.z = value,
            Some(Role::Intensity) => self.intensity = value,
            Some(Role::Class) => self.class = value,
            Some(Role::Return) => self.return_number = value,
            Some(Role::Object) => self.object = (value as i64).to_string(),
            None => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "element camera 1\nproperty float focal\nelement vertex 2\nproperty double x\n\
                          property double y\nproperty float z\nproperty uchar Classification\n\
                          property int hit_object_id\nproperty list uchar int unused\nend_header\n";

    fn read(bytes: &[u8]) -> Result<Points> {
        read_from(bytes, Path::new("cloud.ply"))
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
        check(&read(text.as_bytes()).unwrap());
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
        check(&read(&binary).unwrap());
        // Cut anywhere, it is an input problem.
        for length in (0..binary.len()).step_by(7) {
            assert!(matches!(read(&binary[..length]), Err(Error::Input(_))), "cut at {length}");
        }
    }

    #[test]
    fn a_vast_count_does_not_ask_for_memory() {
        let text =
            "ply\nformat ascii 1.0\nelement vertex 18446744073709551615\nproperty float x\nend_header\n1\n";
        assert!(matches!(read(text.as_bytes()), Err(Error::Input(_))));
    }
}
