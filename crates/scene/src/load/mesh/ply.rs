//! PLY meshes, text and binary: the faces of `vertex_indices`, and strips of triangles. The material is named
//! after the file.

use super::{PlyMeshError, RawMesh, diffuse};
use crate::text::Source;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};
use vlscan_base::damage::catch_decoder_panic;
use vlscan_formats::{PlyNumbers, ply_header};
use vlscan_geom::DVec3;

/// Reads a mesh, with the colours of its vertices if `colours` is set.
pub(super) fn read(source: &Source, colours: bool) -> Result<RawMesh, PlyMeshError> {
    let name = source.path().file_stem().unwrap_or_default().to_string_lossy().into_owned();
    catch_decoder_panic(|| read_mesh(source.bytes(), name, colours)).unwrap_or(Err(PlyMeshError::Damaged))
}

fn read_mesh(bytes: &[u8], name: String, colours: bool) -> Result<RawMesh, PlyMeshError> {
    let spelled = ply_header(bytes).map_err(PlyMeshError::Header)?;
    let parser = Parser::<Element>::new();
    let header = parser
        .read_header(&mut Reader::new(spelled.text.as_bytes()))
        .map_err(|e| PlyMeshError::Malformed { what: first_line(&e) })?;
    let body = &bytes[spelled.body..];
    let mut reader = match header.encoding {
        Encoding::Ascii => ElementReader::Text(PlyNumbers::new(body)),
        encoding => ElementReader::Binary(parser, encoding, body),
    };
    let is_single = header.encoding != Encoding::Ascii && has_single_positions(&header);
    let mut mesh = RawMesh { materials: vec![diffuse(name)], is_single, ..RawMesh::default() };
    let mut has_faces = false;
    for definition in header.elements.values().filter(|e| !e.properties.is_empty()) {
        has_faces |= matches!(definition.name.as_str(), "face" | "tristrips");
        for at in 0..definition.count {
            let element = reader.read(definition).map_err(|e| {
                let (name, count) = (definition.name.clone(), definition.count);
                PlyMeshError::Element { at, count, name, source: Box::new(e) }
            })?;
            match definition.name.as_str() {
                "vertex" => {
                    mesh.vertices.push(DVec3::from(element.position));
                    if colours && element.colour.iter().all(|component| !component.is_nan()) {
                        // The conversion saturates.
                        mesh.vertex_colours.push(element.colour.map(|c| (c * 65_535.0).round() as u16));
                    }
                }
                name @ ("face" | "tristrips") if element.has_fractions => {
                    return Err(PlyMeshError::Fractions { name: name.to_owned(), at });
                }
                "face" => {
                    let corner = |&corner: &i64| {
                        u32::try_from(corner).map_err(|_| PlyMeshError::Corner { at, corner })
                    };
                    let corners: Vec<u32> = element.corners.iter().map(corner).collect::<Result<_, _>>()?;
                    mesh.add_polygon(&corners, 0);
                }
                "tristrips" => add_strips(&mut mesh, &element.corners)?,
                _ => {}
            }
        }
    }
    mesh.warnings.extend(repeated_properties(&header, &spelled.repeated, colours));
    if colours {
        mesh.warnings.extend(unread_colours(&header, &bytes[..spelled.body], &mesh));
    }
    if mesh.vertex_colours.len() != mesh.vertices.len() {
        mesh.vertex_colours.clear();
    }
    match &reader {
        ElementReader::Text(numbers) if !numbers.is_at_end() => {
            return Err(PlyMeshError::Rest);
        }
        ElementReader::Binary(_, _, rest) if !rest.is_empty() => {
            mesh.warnings.push(format!("{} bytes after the last element are not read", rest.len()));
        }
        _ => {}
    }
    if !has_faces {
        return Err(PlyMeshError::NoFaces);
    }
    Ok(mesh)
}

/// Warnings of properties that mean the same, as sentences about the file; of colours if these are read.
fn repeated_properties(header: &Header, repeated: &[(String, String)], colours: bool) -> Vec<String> {
    let meaning = |name: &str| meaning_of(name).filter(|meaning| colours || !COLOUR.contains(meaning));
    let same = repeated.iter().filter(|(_, name)| meaning(name).is_some()).map(|(element, name)| {
        format!("an element {element} has several properties {name}, of which the first one is read")
    });
    let mut found: Vec<String> = same.collect();
    for element in header.elements.values() {
        let names: Vec<&str> = element.properties.values().map(|property| property.name.as_str()).collect();
        for (i, name) in names.iter().enumerate() {
            let own = meaning(name);
            let earlier = names[..i].iter().find(|other| own.is_some() && meaning(other) == own);
            if let Some(earlier) = earlier {
                let of = &element.name;
                found.push(format!(
                    "the properties {earlier} and {name} of an element {of} mean the same; {name} is read"
                ));
            }
        }
    }
    found
}

/// Warnings of colours that are not read, as sentences about the file.
fn unread_colours(header: &Header, text: &[u8], mesh: &RawMesh) -> Vec<String> {
    let has = |element: &str, is_one: fn(&str) -> bool| {
        let elements = header.elements.values().filter(|e| e.name == element);
        elements.flat_map(|e| e.properties.values()).any(|property| is_one(&property.name))
    };
    let is_colour = |name: &str| component_of(name).is_some();
    let mut found = Vec::new();
    if has("vertex", is_colour) && mesh.vertex_colours.len() != mesh.vertices.len() {
        let text = "the colours of its vertices are not read: expected red, green and blue as uchar, ushort, \
                    float or double";
        found.push(text.to_owned());
    }
    if has("face", is_colour) {
        found.push("the colours of its faces are not read, only those of vertices".to_owned());
    }
    let names_texture = text.windows(TEXTURE_COMMENT.len()).any(|w| w.eq_ignore_ascii_case(TEXTURE_COMMENT));
    if names_texture || has("face", |name| name.eq_ignore_ascii_case("texcoord")) {
        found.push("its texture is not read; OBJ and glTF files may have textures".to_owned());
    }
    found
}

/// True if a coordinate of the vertices has 32 bits.
fn has_single_positions(header: &Header) -> bool {
    let mut properties = header.elements.get("vertex").into_iter().flat_map(|e| e.properties.values());
    properties.any(|property| {
        ["x", "y", "z"].contains(&property.name.as_str())
            && matches!(property.data_type, PropertyType::Scalar(ScalarType::Float))
    })
}

/// Comment with the name of a texture, as programs write it.
const TEXTURE_COMMENT: &[u8] = b"comment texturefile";

/// Adds strips of triangles, which end with -1. Every second triangle has its corners in the other order.
fn add_strips(mesh: &mut RawMesh, corners: &[i64]) -> Result<(), PlyMeshError> {
    for strip in corners.split(|c| *c == -1) {
        let corner = |&corner: &i64| u32::try_from(corner).map_err(|_| PlyMeshError::StripCorner { corner });
        let strip: Vec<u32> = strip.iter().map(corner).collect::<Result<_, _>>()?;
        for (i, t) in strip.windows(3).enumerate() {
            let odd = i % 2;
            mesh.add_polygon(&[t[0], t[1 + odd], t[2 - odd]], 0);
        }
    }
    Ok(())
}

/// Reads elements one after the other.
enum ElementReader<'b> {
    Text(PlyNumbers<'b>),
    Binary(Parser<Element>, Encoding, &'b [u8]),
}

impl ElementReader<'_> {
    fn read(&mut self, definition: &ElementDef) -> Result<Element, PlyMeshError> {
        let read = match self {
            ElementReader::Text(numbers) => return read_text_element(numbers, definition),
            ElementReader::Binary(parser, Encoding::BinaryBigEndian, rest) => {
                parser.read_big_endian_element(rest, definition)
            }
            ElementReader::Binary(parser, _, rest) => parser.read_little_endian_element(rest, definition),
        };
        read.map_err(|e| PlyMeshError::Truncated { what: first_line(&e) })
    }
}

/// Reads an element of a text file. Lines do not matter.
fn read_text_element(numbers: &mut PlyNumbers, definition: &ElementDef) -> Result<Element, PlyMeshError> {
    let mut element = Element::new();
    for property in definition.properties.values() {
        let name = property.name.as_str();
        match &property.data_type {
            PropertyType::Scalar(kind) => {
                let value = numbers.number()?;
                // Colours are shares of the greatest number of their type.
                let value = match (component_of(name), kind) {
                    (Some(_), ScalarType::Char | ScalarType::UChar) => value / 255.0,
                    (Some(_), ScalarType::Float | ScalarType::Double) => value,
                    (Some(_), _) => value / 65_535.0,
                    (None, _) => value,
                };
                element.set_property(name, Property::Double(value));
            }
            PropertyType::List(_, number) => {
                let are_floats = matches!(number, ScalarType::Float | ScalarType::Double);
                let count = numbers.length()?;
                let list: Vec<f64> = (0..count).map(|_| numbers.number()).collect::<Result<_, _>>()?;
                let is_whole = |v: &f64| v.fract() == 0.0 && v.abs() <= f64::from(u32::MAX);
                if is_corners(name) && !are_floats && list.iter().all(is_whole) {
                    element.corners = list.iter().map(|&v| v as i64).collect();
                } else if is_corners(name) {
                    element.has_fractions = true;
                }
            }
        }
    }
    Ok(element)
}

/// Index of the component of colours that a property is.
fn component_of(name: &str) -> Option<usize> {
    let name = name.strip_prefix("diffuse_").unwrap_or(name);
    ["red", "green", "blue"].iter().position(|component| name.eq_ignore_ascii_case(component))
}

/// The meanings of the components of colours, see [`meaning_of`].
const COLOUR: std::ops::Range<usize> = 3..6;

/// A number that properties of one meaning share: coordinates, components of colours, corners of faces.
fn meaning_of(name: &str) -> Option<usize> {
    let coordinate = ["x", "y", "z"].iter().position(|axis| name.eq_ignore_ascii_case(axis));
    let colour = || component_of(name).map(|component| COLOUR.start + component);
    coordinate.or_else(colour).or_else(|| is_corners(name).then_some(COLOUR.end))
}

/// True if a list has the name of the corners of faces.
fn is_corners(name: &str) -> bool {
    ["vertex_indices", "vertex_index"].iter().any(|known| name.eq_ignore_ascii_case(known))
}

/// Message of the decoder, without its quotation of the file and the full stop.
fn first_line(e: &impl ToString) -> String {
    e.to_string().lines().next().unwrap_or_default().trim_end_matches(['.', ' ']).to_owned()
}

/// A vertex or a face.
struct Element {
    position: [f64; 3],
    /// Red, green and blue, 0 to 1; NaN if they are missing.
    colour: [f64; 3],
    corners: Vec<i64>,
    /// True if the corners are floats instead of indices.
    has_fractions: bool,
}

impl PropertyAccess for Element {
    fn new() -> Element {
        Element { position: [f64::NAN; 3], colour: [f64::NAN; 3], corners: Vec::new(), has_fractions: false }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let slot = match name {
            "x" | "X" => 0,
            "y" | "Y" => 1,
            "z" | "Z" => 2,
            name if is_corners(name) => {
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
            name => {
                let Some(component) = component_of(name) else { return PropertyAccessResult::Ignored };
                self.colour[component] = match property {
                    Property::UChar(v) => f64::from(v) / 255.0,
                    Property::UShort(v) => f64::from(v) / 65_535.0,
                    Property::Float(v) => f64::from(v),
                    Property::Double(v) => v,
                    _ => f64::NAN,
                };
                return PropertyAccessResult::Set;
            }
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
