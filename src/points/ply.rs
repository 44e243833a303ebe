//! Reads the vertices of PLY files, text and binary.

use super::{Attribute, BATCH_POINTS, Columns, PointReader, PointRow};
use crate::geom::DVec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    Addable, ElementDef, Encoding, Header, KeyMap, Property, PropertyAccess, PropertyAccessResult,
    PropertyDef,
};
use std::io::{BufRead, Read};

/// Maximum length of a line of a text file, bytes: a file without line ends must not fill the memory.
const MAX_LINE_BYTES: u64 = 1 << 16;

/// Whether a file begins with the signature of PLY files.
pub fn is_ply(bytes: &[u8]) -> bool {
    matches!(bytes, [b'p', b'l', b'y', b'\r' | b'\n', ..])
}

/// Reads the vertices of a file in order.
pub struct PlyReader<'a> {
    parser: Parser<Vertex>,
    encoding: Encoding,
    element: ElementDef,
    /// The unread bytes after the header.
    rest: &'a [u8],
    /// The attributes of the vertices; the column of each is the number of the attribute.
    columns: Columns,
    line: String,
    at: usize,
}

impl<'a> PlyReader<'a> {
    /// Reads the header of a file and skips the elements before the vertices.
    pub fn open(bytes: &'a [u8]) -> Result<PlyReader<'a>, String> {
        let parser = Parser::<Vertex>::new();
        let mut reader = Reader::new(bytes);
        let Header { encoding, elements, .. } = parser.read_header(&mut reader).map_err(|e| e.to_string())?;
        let mut file = PlyReader {
            parser,
            encoding,
            element: ElementDef::new("vertex".to_owned()),
            rest: reader.into_inner(),
            columns: Columns::default(),
            line: String::new(),
            at: 0,
        };
        for element in elements.into_values().filter(|e| !e.properties.is_empty()) {
            file.element = element;
            if file.element.name == "vertex" {
                file.columns = number_properties(&mut file.element);
                return match Attribute::POSITION.into_iter().find(|axis| !file.columns.has(*axis)) {
                    Some(axis) => Err(format!("its vertices have no {}", axis.described())),
                    None => Ok(file),
                };
            }
            for _ in 0..file.element.count {
                file.read_element()?;
            }
        }
        Err("it has no element \"vertex\"".to_owned())
    }

    fn read_element(&mut self) -> Result<Vertex, String> {
        let read = match self.encoding {
            Encoding::Ascii => {
                self.line.clear();
                let line = self.rest.by_ref().take(MAX_LINE_BYTES).read_line(&mut self.line);
                line.map_err(|e| e.to_string())?;
                self.parser.read_ascii_element(&self.line, &self.element)
            }
            Encoding::BinaryLittleEndian => {
                self.parser.read_little_endian_element(&mut self.rest, &self.element)
            }
            Encoding::BinaryBigEndian => self.parser.read_big_endian_element(&mut self.rest, &self.element),
        };
        read.map_err(|e| {
            let (name, at, count) = (&self.element.name, self.at, self.element.count);
            format!("{e} after {at} of {count} elements \"{name}\"; is the file whole?")
        })
    }
}

/// Renames the properties that hold attributes to the attributes' numbers, so that names are compared once per file
/// instead of once per vertex.
fn number_properties(element: &mut ElementDef) -> Columns {
    let found = Columns::find(element.properties.keys().map(String::as_str));
    let (mut numbered, mut columns) = (KeyMap::new(), Columns::default());
    for (column, property) in std::mem::take(&mut element.properties).into_values().enumerate() {
        let name = match found.used().find(|(_, c)| *c == column) {
            Some((attribute, _)) => {
                columns = columns.with(attribute, attribute as usize);
                (attribute as usize).to_string()
            }
            None => format!("-{}", property.name),
        };
        numbered.add(PropertyDef::new(name, property.data_type));
    }
    element.properties = numbered;
    columns
}

impl PointReader for PlyReader<'_> {
    fn has(&self, attribute: Attribute) -> bool {
        self.columns.has(attribute)
    }

    fn stated_centre(&self) -> Option<DVec3> {
        None
    }

    fn read_batch(&mut self, batch: &mut Vec<PointRow>) -> Result<bool, String> {
        let end = self.element.count.min(self.at + BATCH_POINTS);
        while self.at < end {
            let vertex = self.read_element()?;
            batch.push(self.columns.row(|column| vertex.0[column]));
            self.at += 1;
        }
        Ok(self.at < self.element.count)
    }
}

/// The values of a vertex, by attribute.
struct Vertex([f64; Attribute::COUNT]);

impl PropertyAccess for Vertex {
    fn new() -> Vertex {
        Vertex([f64::NAN; Attribute::COUNT])
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let slot = name.parse().ok().and_then(|number: usize| self.0.get_mut(number));
        match slot.zip(number(&property)) {
            Some((slot, value)) => {
                *slot = value;
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::Ignored,
        }
    }
}

/// The value of a property as a number; `None` for a list.
fn number(property: &Property) -> Option<f64> {
    Some(match *property {
        Property::Char(v) => f64::from(v),
        Property::UChar(v) => f64::from(v),
        Property::Short(v) => f64::from(v),
        Property::UShort(v) => f64::from(v),
        Property::Int(v) => f64::from(v),
        Property::UInt(v) => f64::from(v),
        Property::Float(v) => f64::from(v),
        Property::Double(v) => v,
        _ => return None,
    })
}
