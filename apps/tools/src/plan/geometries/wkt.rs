//! Geometries of well-known text.

use super::error::GeometryError;
use super::shape::{Geometry, Line, Shape, System};

/// True if a text is well-known text rather than the name of a file.
pub fn is_well_known_text(text: &str) -> bool {
    let text = text.trim();
    let kind = text.split_once(';').filter(|(before, _)| is_srid(before)).map_or(text, |(_, rest)| rest);
    let word: String = kind.trim_start().chars().take_while(char::is_ascii_alphabetic).collect();
    let word = word.to_ascii_uppercase();
    let kinds = ["POLYGON", "LINESTRING", "MULTIPOLYGON", "MULTILINESTRING", "GEOMETRYCOLLECTION"];
    // With the letters of coordinates that have heights or measures: POLYGONZ.
    let is_kind =
        kinds.iter().any(|kind| word.strip_prefix(kind).is_some_and(|rest| DIMENSIONS.contains(&rest)));
    is_kind && text.contains('(') && text.ends_with(')')
}

/// Dimensions after the kind of a geometry.
const DIMENSIONS: [&str; 4] = ["", "Z", "M", "ZM"];

fn is_srid(text: &str) -> bool {
    text.trim().get(..5).is_some_and(|start| start.eq_ignore_ascii_case("SRID="))
}

/// OGC 06-103r4, §7, with `SRID=25832;` before a geometry as PostGIS writes it. Several geometries follow
/// each other.
pub fn read_wkt(text: &str, depth: u32, found: &mut Vec<Geometry>) -> Result<(), GeometryError> {
    let mut rest = text;
    loop {
        rest = rest.trim_start_matches([',', ';']).trim_start();
        if rest.is_empty() {
            return Ok(());
        }
        let mut system = System::Unstated;
        if let Some((srid, geometry)) = rest.split_once(';').filter(|(before, _)| is_srid(before)) {
            let code = srid.trim()[5..].trim().parse();
            let code = code.map_err(|_| GeometryError::Srid(srid.to_owned()))?;
            (system, rest) = (System::of_code(code), geometry.trim_start());
        }
        let end = rest.find(|c: char| !(c.is_ascii_alphabetic() || c.is_whitespace())).unwrap_or(rest.len());
        let mut words = rest[..end].split_whitespace();
        let kind = words.next().ok_or(GeometryError::Notation)?.to_ascii_uppercase();
        let is_empty = words.any(|word| word.eq_ignore_ascii_case("EMPTY"));
        let body;
        (body, rest) = match is_empty {
            true => ("", &rest[end..]),
            false => bracketed(&rest[end..]).ok_or(GeometryError::Notation)?,
        };
        let of = |name: &str| kind.strip_prefix(name).is_some_and(|rest| DIMENSIONS.contains(&rest));
        let mut add = |shape| found.push(Geometry { shape, system: system.clone() });
        if of("POLYGON") {
            add(Shape::Polygon(rings(body)?));
        } else if of("LINESTRING") {
            add(Shape::Line(positions(body)?));
        } else if of("MULTIPOLYGON") {
            for polygon in groups(body)? {
                add(Shape::Polygon(rings(polygon)?));
            }
        } else if of("MULTILINESTRING") {
            rings(body)?.into_iter().for_each(|line| add(Shape::Line(line)));
        } else if of("GEOMETRYCOLLECTION") {
            let depth = depth.checked_sub(1).ok_or(GeometryError::TooDeep)?;
            let first = found.len();
            read_wkt(body, depth, found)?;
            let parts = found[first..].iter_mut().filter(|part| part.system == System::Unstated);
            parts.for_each(|part| part.system = system.clone());
        } else {
            add(Shape::Other(kind));
        }
    }
}

/// Text between the first bracket and the one that closes it, and the text behind that; `None` for a text
/// that does not begin with a bracket, or does not close it.
fn bracketed(text: &str) -> Option<(&str, &str)> {
    let inner = text.strip_prefix('(')?;
    let mut depth = 1_usize;
    let end = inner.char_indices().find(|(_, c)| {
        match c {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        depth == 0
    })?;
    Some((&inner[..end.0], &inner[end.0 + 1..]))
}

/// The contents of brackets that follow each other, with commas between them.
fn groups(text: &str) -> Result<Vec<&str>, GeometryError> {
    let (mut found, mut rest) = (Vec::new(), text.trim());
    while !rest.is_empty() {
        let group;
        (group, rest) = bracketed(rest).ok_or_else(|| GeometryError::Brackets(rest.to_owned()))?;
        found.push(group);
        rest = rest.trim_start().trim_start_matches(',').trim_start();
    }
    Ok(found)
}

fn rings(text: &str) -> Result<Vec<Line>, GeometryError> {
    groups(text)?.into_iter().map(positions).collect()
}

fn positions(text: &str) -> Result<Line, GeometryError> {
    let texts = text.split(',').filter(|position| !position.trim().is_empty());
    Line::of(texts.map(|position| {
        let numbers = position.split_whitespace().map(|n| n.parse().ok()).collect::<Option<Vec<f64>>>();
        let numbers = numbers.filter(|numbers| (2..=4).contains(&numbers.len()));
        numbers.ok_or_else(|| GeometryError::Position {
            found: format!("`{}`", position.trim()),
            expected: "x and y",
        })
    }))
}
