//! PLY meshes, text and binary: the faces of `vertex_indices`. The material is named after the file.

use super::{RawMesh, diffuse};
use crate::damage::catch_decoder_panic;
use crate::geom::DVec3;
use crate::scene::text::Source;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult};
use std::io::{BufRead, Read};

/// Maximum length of a line of a text file, bytes.
const MAX_LINE_BYTES: u64 = 1 << 20;

pub(super) fn read(source: &Source) -> Result<RawMesh, String> {
    let name = source.path().file_stem().unwrap_or_default().to_string_lossy().into_owned();
    catch_decoder_panic(|| read_mesh(source.bytes(), name))
        .unwrap_or_else(|| Err("the file is damaged".to_owned()))
}

fn read_mesh(bytes: &[u8], name: String) -> Result<RawMesh, String> {
    if bytes.starts_with(b"ply\r") && !bytes.starts_with(b"ply\r\n") {
        return Err(
            "the lines of the PLY file end in a carriage return alone, expected line feeds".to_owned()
        );
    }
    let parser = Parser::<Element>::new();
    let mut reader = Reader::new(bytes);
    let header =
        parser.read_header(&mut reader).map_err(|e| format!("expected a PLY file: {}", first_line(&e)))?;
    let mut rest = reader.into_inner();
    let mut mesh = RawMesh { materials: vec![diffuse(name)], ..RawMesh::default() };
    let mut has_faces = false;
    for definition in header.elements.values().filter(|e| !e.properties.is_empty()) {
        has_faces |= definition.name == "face";
        for at in 0..definition.count {
            let element = read_element(&parser, header.encoding, &mut rest, definition).map_err(|e| {
                let (name, count) = (&definition.name, definition.count);
                format!("{e} after {at} of {count} elements \"{name}\"; is the file whole?")
            })?;
            match definition.name.as_str() {
                "vertex" => mesh.vertices.push(DVec3::from(element.position)),
                "face" if element.has_fractions => {
                    return Err(format!(
                        "face {at}: expected whole numbers as corners, found a list of floats"
                    ));
                }
                "face" => {
                    let corner =
                        |c: &i64| u32::try_from(*c).map_err(|_| format!("face {at} has the corner {c}"));
                    let corners: Vec<u32> = element.corners.iter().map(corner).collect::<Result<_, _>>()?;
                    mesh.add_polygon(&corners, 0);
                }
                _ => {}
            }
        }
    }
    if !has_faces {
        return Err(
            "the PLY file holds points and no faces; <filter type=\"xyzloader\"> makes voxels of points"
                .to_owned(),
        );
    }
    Ok(mesh)
}

fn read_element(
    parser: &Parser<Element>,
    encoding: Encoding,
    rest: &mut &[u8],
    definition: &ElementDef,
) -> Result<Element, String> {
    let read = match encoding {
        Encoding::Ascii => {
            let mut line = String::new();
            rest.by_ref().take(MAX_LINE_BYTES).read_line(&mut line).map_err(|e| e.to_string())?;
            parser.read_ascii_element(&line, definition)
        }
        Encoding::BinaryLittleEndian => parser.read_little_endian_element(rest, definition),
        Encoding::BinaryBigEndian => parser.read_big_endian_element(rest, definition),
    };
    read.map_err(|e| first_line(&e))
}

/// What the decoder says, without its quotation of the file and the full stop.
fn first_line(e: &impl ToString) -> String {
    e.to_string().lines().next().unwrap_or_default().trim_end_matches(['.', ' ']).to_owned()
}

/// A vertex or a face.
struct Element {
    position: [f64; 3],
    corners: Vec<i64>,
    /// Whether the corners are floats, which are no indices.
    has_fractions: bool,
}

impl PropertyAccess for Element {
    fn new() -> Element {
        Element { position: [f64::NAN; 3], corners: Vec::new(), has_fractions: false }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let slot = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            "vertex_indices" | "vertex_index" => {
                return match integers(&property) {
                    Some(corners) => {
                        self.corners = corners;
                        PropertyAccessResult::Set
                    }
                    None => {
                        self.has_fractions =
                            matches!(property, Property::ListFloat(_) | Property::ListDouble(_));
                        PropertyAccessResult::Ignored
                    }
                };
            }
            _ => return PropertyAccessResult::Ignored,
        };
        self.position[slot] = match property {
            Property::Float(v) => f64::from(v),
            Property::Double(v) => v,
            Property::Int(v) => f64::from(v),
            Property::UInt(v) => f64::from(v),
            Property::Short(v) => f64::from(v),
            Property::UShort(v) => f64::from(v),
            Property::Char(v) => f64::from(v),
            Property::UChar(v) => f64::from(v),
            _ => f64::NAN,
        };
        PropertyAccessResult::Set
    }
}

fn integers(property: &Property) -> Option<Vec<i64>> {
    Some(match property {
        Property::ListInt(list) => list.iter().map(|&v| v.into()).collect(),
        Property::ListUInt(list) => list.iter().map(|&v| v.into()).collect(),
        Property::ListShort(list) => list.iter().map(|&v| v.into()).collect(),
        Property::ListUShort(list) => list.iter().map(|&v| v.into()).collect(),
        Property::ListChar(list) => list.iter().map(|&v| v.into()).collect(),
        Property::ListUChar(list) => list.iter().map(|&v| v.into()).collect(),
        _ => return None,
    })
}
