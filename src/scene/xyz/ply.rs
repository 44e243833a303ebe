//! Points of PLY files, text and binary: positions, normals and classes.

use super::points::{BATCH, Batches, Point};
use crate::geom::DVec3;
use crate::input::ply::number;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult};
use std::io::{BufRead, Read};

/// Longest line of a text file: a file without line ends must not fill the memory.
const LONGEST_LINE: u64 = 1 << 16;

/// Whether bytes claim to be such a file.
pub(super) fn is_ply(bytes: &[u8]) -> bool {
    matches!(bytes, [b'p', b'l', b'y', b'\r' | b'\n', ..])
}

/// The vertices of a file from first to last.
pub(super) struct Cloud<'a> {
    parser: Parser<Vertex>,
    encoding: Encoding,
    element: ElementDef,
    /// What follows the header.
    source: &'a [u8],
    has_normals: bool,
    line: String,
    at: usize,
}

impl<'a> Cloud<'a> {
    /// The points of a file's bytes. Normals are looked at if `with_normals` and the file has all three components.
    pub fn open(bytes: &'a [u8], with_normals: bool) -> Result<Cloud<'a>, String> {
        let parser = Parser::<Vertex>::new();
        let mut reader = Reader::new(bytes);
        let header = parser.read_header(&mut reader).map_err(|e| e.to_string())?;
        let Header { encoding, elements, .. } = header;
        let mut cloud = Cloud {
            parser,
            encoding,
            element: ElementDef::new("vertex".to_owned()),
            source: reader.into_inner(),
            has_normals: false,
            line: String::new(),
            at: 0,
        };
        for element in elements.into_values().filter(|e| !e.properties.is_empty()) {
            let (is_vertex, count) = (element.name == "vertex", element.count);
            cloud.element = element;
            if is_vertex {
                let has = |role| cloud.element.properties.values().any(|p| Role::of(&p.name) == Some(role));
                if let Some(axis) = (0..3).find(|&axis| !has(Role::Position(axis))) {
                    return Err(format!("its vertices have no {}", ["x", "y", "z"][axis]));
                }
                cloud.has_normals = with_normals && (0..3).all(|axis| has(Role::Normal(axis)));
                return Ok(cloud);
            }
            for _ in 0..count {
                cloud.vertex()?;
            }
        }
        Err("it has no element \"vertex\"".to_owned())
    }

    fn vertex(&mut self) -> Result<Vertex, String> {
        let read = match self.encoding {
            Encoding::Ascii => {
                self.line.clear();
                let line = self.source.by_ref().take(LONGEST_LINE).read_line(&mut self.line);
                line.map_err(|e| e.to_string())?;
                self.parser.read_ascii_element(&self.line, &self.element)
            }
            Encoding::BinaryLittleEndian => {
                self.parser.read_little_endian_element(&mut self.source, &self.element)
            }
            Encoding::BinaryBigEndian => self.parser.read_big_endian_element(&mut self.source, &self.element),
        };
        read.map_err(|e| {
            let (name, at, count) = (&self.element.name, self.at, self.element.count);
            format!("{e} after {at} of {count} elements \"{name}\"; is the file whole?")
        })
    }
}

impl Batches for Cloud<'_> {
    fn next(&mut self, room: &mut Vec<Point>) -> Result<bool, String> {
        let end = self.element.count.min(self.at + BATCH);
        while self.at < end {
            let vertex = self.vertex()?;
            room.push(Point {
                position: vertex.position,
                normal: self.has_normals.then_some(vertex.normal),
                class: vertex.class,
            });
            self.at += 1;
        }
        Ok(self.at < self.element.count)
    }
}

/// What a property of a vertex is.
#[derive(Clone, Copy, PartialEq)]
enum Role {
    Position(usize),
    Normal(usize),
    Class,
}

impl Role {
    /// The role of a property by the names that are common; CloudCompare's prefix is passed over.
    fn of(name: &str) -> Option<Role> {
        let plain = name.strip_prefix("scalar_").unwrap_or(name);
        let is = |names: &[&str]| names.iter().any(|n| plain.eq_ignore_ascii_case(n));
        let axis = ["x", "y", "z"].iter().position(|a| is(&[a])).map(Role::Position);
        let normal = [["nx", "normal_x"], ["ny", "normal_y"], ["nz", "normal_z"]].iter().position(|n| is(n));
        axis.or(normal.map(Role::Normal))
            .or_else(|| is(&["classification", "class", "label"]).then_some(Role::Class))
    }
}

/// A vertex as it is read.
struct Vertex {
    position: DVec3,
    normal: DVec3,
    class: u8,
}

impl PropertyAccess for Vertex {
    fn new() -> Vertex {
        Vertex { position: DVec3::NAN, normal: DVec3::NAN, class: 0 }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(value) = number(&property) else { return PropertyAccessResult::Ignored };
        match Role::of(name) {
            Some(Role::Position(axis)) => self.position[axis] = value,
            Some(Role::Normal(axis)) => self.normal[axis] = value,
            // A cast of a float saturates.
            Some(Role::Class) => self.class = value as u8,
            None => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}
