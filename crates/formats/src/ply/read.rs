//! Reads the vertices of PLY files, text and binary.

use crate::{Attribute, Columns, PlyError, PlyNumbers, Reading, ply_header};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    Addable, ElementDef, Encoding, Header, KeyMap, Property, PropertyAccess, PropertyAccessResult,
    PropertyDef, PropertyType,
};
use std::collections::BTreeMap;
use std::io::ErrorKind;

/// Reads the vertices of a file.
pub(crate) fn read(bytes: &[u8], reading: &mut Reading) -> Result<(), PlyError> {
    let mut file = PlyReader::open(bytes)?;
    file.remarks.iter().for_each(|remark| reading.warn(remark.as_str()));
    reading.sink.start(file.columns.attributes());
    if reading.sink.takes_columns() {
        reading.pass_object_names(object_names(file.head));
        let names: Vec<&str> = file.names.iter().map(String::as_str).collect();
        let chosen = reading.choose(&names);
        file.read_properties(&chosen);
    }
    let mut values = Vec::new();
    for at in 0..file.element.count {
        let vertex = file.read_element(at)?;
        let mut row = file.columns.row(|column| vertex.slots[column]);
        row.is_miss |= file.is_ray_cloud && vertex.slots[ALPHA] == 0.0;
        values.clear();
        values.extend(file.chosen.iter().map(|slot| vertex.value(*slot)));
        reading.pass_values(&values);
        if reading.take(&row).is_break() {
            return Ok(());
        }
        reading.release_before(bytes.len() - file.values.unread());
    }
    let is_at_end = match &file.values {
        Values::Text(numbers) => numbers.is_at_end(),
        Values::Binary(_, _, rest) => rest.is_empty(),
    };
    if file.is_last && !is_at_end {
        reading.warn_of_rest(file.element.count);
    }
    Ok(())
}

/// Reads the vertices of a file in order.
struct PlyReader<'a> {
    /// The header.
    head: &'a [u8],
    values: Values<'a>,
    element: ElementDef,
    /// True if no other elements follow the vertices.
    is_last: bool,
    /// The attributes of the vertices; the column of each is the number of the attribute.
    columns: Columns,
    /// The names of the properties of the vertices; those of lists are empty.
    names: Vec<String>,
    /// The slots of properties whose values are passed with the vertices.
    chosen: Vec<usize>,
    /// True if vertices are the ends of rays; rays of opacity 0 end in free space.
    is_ray_cloud: bool,
    remarks: Vec<String>,
}

/// The slot of a vertex after its attributes: the opacity.
const ALPHA: usize = Attribute::COUNT;
/// The slots of red, green and blue.
const COLOURS: [usize; 3] = [ALPHA + 1, ALPHA + 2, ALPHA + 3];
/// Number of slots.
const SLOTS: usize = ALPHA + 4;

/// The values behind the header that are not read yet.
enum Values<'a> {
    Text(PlyNumbers<'a>),
    Binary(Parser<Vertex>, Encoding, &'a [u8]),
}

impl Values<'_> {
    /// Number of bytes that are not read yet.
    fn unread(&self) -> usize {
        match self {
            Values::Text(numbers) => numbers.unread(),
            Values::Binary(_, _, rest) => rest.len(),
        }
    }
}

impl<'a> PlyReader<'a> {
    /// Reads the header of a file and skips the elements before the vertices.
    fn open(bytes: &'a [u8]) -> Result<PlyReader<'a>, PlyError> {
        let parser = Parser::<Vertex>::new();
        let header = ply_header(bytes)?;
        let mut reader = Reader::new(header.text.as_bytes());
        let parsed = parser.read_header(&mut reader);
        let Header { encoding, elements, .. } =
            parsed.map_err(|e| PlyError::Malformed { what: e.to_string() })?;
        let body = &bytes[header.body..];
        let mut file = PlyReader {
            values: match encoding {
                Encoding::Ascii => Values::Text(PlyNumbers::new(body)),
                encoding => Values::Binary(parser, encoding, body),
            },
            element: ElementDef::new("vertex".to_owned()),
            is_last: false,
            columns: Columns::default(),
            head: &bytes[..header.body],
            names: Vec::new(),
            chosen: Vec::new(),
            is_ray_cloud: is_ray_cloud(&bytes[..header.body]),
            remarks: Vec::new(),
        };
        let mut elements = elements.into_values().filter(|e| !e.properties.is_empty()).peekable();
        while let Some(element) = elements.next() {
            file.is_last = elements.peek().is_none();
            file.element = element;
            if file.element.name == "vertex" {
                let names: Vec<String> = file.element.properties.keys().cloned().collect();
                let names: Vec<&str> = names.iter().map(String::as_str).collect();
                let found = Columns::find_positions(&names)?;
                file.remarks = found.remarks(&names);
                file.is_ray_cloud &= ["time", "nx", "alpha"].iter().all(|name| names.contains(name));
                let properties = file.element.properties.values();
                let names = properties.map(|property| match &property.data_type {
                    PropertyType::Scalar(_) => property.name.clone(),
                    PropertyType::List(..) => String::new(),
                });
                file.names = names.collect();
                file.columns = number_properties(&mut file.element, &found);
                return Ok(file);
            }
            for at in 0..file.element.count {
                file.read_element(at)?;
            }
        }
        Err(PlyError::NoVertices)
    }

    /// Gives slots to the chosen properties, those that have none behind the others.
    fn read_properties(&mut self, chosen: &[usize]) {
        if chosen.is_empty() {
            return;
        }
        self.chosen = vec![ALPHA; chosen.len()];
        let mut properties = KeyMap::new();
        for (column, property) in std::mem::take(&mut self.element.properties).into_values().enumerate() {
            let mut name = property.name;
            if let Some(place) = chosen.iter().position(|chosen| *chosen == column) {
                let slot = name.parse().unwrap_or(SLOTS + place);
                name = slot.to_string();
                self.chosen[place] = slot;
            }
            properties.add(PropertyDef::new(name, property.data_type));
        }
        self.element.properties = properties;
    }

    /// Reads element number `at`, from 0.
    fn read_element(&mut self, at: usize) -> Result<Vertex, PlyError> {
        let read = match &mut self.values {
            Values::Text(numbers) => read_text_element(numbers, &self.element),
            Values::Binary(parser, encoding, rest) => {
                let read = match encoding {
                    Encoding::BinaryBigEndian => parser.read_big_endian_element(rest, &self.element),
                    _ => parser.read_little_endian_element(rest, &self.element),
                };
                read.map_err(|e| match e.kind() {
                    ErrorKind::UnexpectedEof => PlyError::Truncated,
                    _ => {
                        let what = e.to_string().lines().next().unwrap_or_default().to_owned();
                        PlyError::Malformed { what }
                    }
                })
            }
        };
        read.map_err(|e| {
            let (name, count) = (self.element.name.clone(), self.element.count);
            PlyError::Element { at, count, name, source: Box::new(e) }
        })
    }
}

/// Reads an element of a text file. Lines do not matter.
fn read_text_element(numbers: &mut PlyNumbers, element: &ElementDef) -> Result<Vertex, PlyError> {
    let mut vertex = Vertex::new();
    for property in element.properties.values() {
        match &property.data_type {
            PropertyType::Scalar(_) => {
                vertex.set_property(&property.name, Property::Double(numbers.number()?));
            }
            PropertyType::List(..) => {
                for _ in 0..numbers.length()? {
                    numbers.number()?;
                }
            }
        }
    }
    Ok(vertex)
}

/// Renames the properties that hold attributes to the attributes' numbers, so that names are compared once
/// per file instead of once per vertex.
fn number_properties(element: &mut ElementDef, found: &Columns) -> Columns {
    let (mut numbered, mut columns) = (KeyMap::new(), found.with_colours(found.colours().and(Some(COLOURS))));
    let colours = found.colours().unwrap_or([usize::MAX; 3]);
    for (column, property) in std::mem::take(&mut element.properties).into_values().enumerate() {
        let name = match found.used().find(|(_, c)| *c == column) {
            Some((attribute, _)) => {
                columns = columns.with(attribute, attribute as usize);
                (attribute as usize).to_string()
            }
            None if property.name == "alpha" => ALPHA.to_string(),
            None if colours.contains(&column) => {
                let component = colours.iter().position(|colour| *colour == column).unwrap_or(0);
                COLOURS[component].to_string()
            }
            None => format!("-{}", property.name),
        };
        numbered.add(PropertyDef::new(name, property.data_type));
    }
    element.properties = numbered;
    columns
}

/// The values of a vertex.
struct Vertex {
    /// By attribute, with opacity and colour.
    slots: [f64; SLOTS],
    /// Values of the further slots of chosen properties.
    others: Vec<f64>,
}

impl Vertex {
    /// The value of a slot; NaN if there is none.
    fn value(&self, slot: usize) -> f64 {
        let other = || slot.checked_sub(SLOTS).and_then(|at| self.others.get(at));
        self.slots.get(slot).or_else(other).copied().unwrap_or(f64::NAN)
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Vertex {
        Vertex { slots: [f64::NAN; SLOTS], others: Vec::new() }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some((slot, value)) = name.parse::<usize>().ok().zip(number(&property)) else {
            return PropertyAccessResult::Ignored;
        };
        match slot.checked_sub(SLOTS) {
            None => self.slots[slot] = value,
            Some(at) => {
                self.others.resize(self.others.len().max(at + 1), f64::NAN);
                self.others[at] = value;
            }
        }
        PropertyAccessResult::Set
    }
}

/// The names of objects by their numbers, in comments of files of this program.
fn object_names(header: &[u8]) -> BTreeMap<i32, String> {
    let text = String::from_utf8_lossy(header);
    let name = |line: &str| {
        let (number, name) = line.trim_end().strip_prefix("comment object ")?.split_once(' ')?;
        Some((number.parse::<i32>().ok()?, name.to_owned()))
    };
    text.lines().filter_map(name).collect()
}

/// True if a header is one of this program or of raycloudtools.
fn is_ray_cloud(header: &[u8]) -> bool {
    let text = String::from_utf8_lossy(header);
    let mut comments = text.lines().filter_map(|line| line.trim().strip_prefix("comment"));
    comments.any(|comment| comment.contains("vlscan") || comment.contains("raycloudtools"))
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
