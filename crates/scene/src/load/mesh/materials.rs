//! Tables of materials by name, for mesh formats that have no place for the properties of surfaces:
//!
//! ```text
//! name,reflectance,class,ground,leaf,spectrum
//! bark,0.42,5,false,false,
//! soil,,2,true,,loam
//! ```
//!
//! The first line names the columns, of which `name` is required, in any order. A table is named by the
//! loader, or is the file `materials.csv` next to a PLY, STL or glTF file.

use super::diffuse;
use crate::mtl::set_optics;
use crate::text::printable;
use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use vlscan_base::columns::{Separator, comma_note, unquoted};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::files::reads;
use vlscan_base::recognise::{Expected, foreign_file};
use vlscan_survey::{MaterialDefinition, MeshReading};
use vlscan_tables::input::read_file;

/// Name of the table that is searched next to a mesh file.
const FILE_NAME: &str = "materials.csv";
const COLUMNS: [&str; 20] = [
    "name",
    "reflectance",
    "class",
    "ground",
    "leaf",
    "spectrum",
    "mirror",
    "pane_index",
    "pane_thickness_m",
    "pane_absorption",
    "pane_sheets",
    "retro",
    "water_index",
    "water_group_index",
    "water_attenuation",
    "water_secchi_m",
    "water_beam_attenuation",
    "water_backscatter",
    "water_wind_m_s",
    "water_wind_deg",
];
const HELP: &str = "the columns are name, reflectance (0 to 1), class (0 to 255), ground (true or false), \
                    leaf (true or false), spectrum, and those of mirrors and panes: mirror, pane_index, \
                    pane_thickness_m, pane_absorption, pane_sheets, retro; and of water: water_index, \
                    water_group_index, water_attenuation, water_secchi_m, water_beam_attenuation, \
                    water_backscatter, water_wind_m_s, water_wind_deg";
/// Maximum size of a table, bytes.
const MAX_BYTES: u64 = 1 << 26;

/// The materials of a table.
pub(super) struct MaterialTable {
    path: PathBuf,
    rows: HashMap<String, MaterialDefinition>,
}

impl MaterialTable {
    /// The table that the loader names, or the table next to the mesh file `path`; `None` if there is none,
    /// and after an error in it.
    pub fn of(path: &Path, reading: &MeshReading, diagnostics: &mut Diagnostics) -> Option<MaterialTable> {
        let sibling = || Some(path.with_file_name(FILE_NAME)).filter(|table| reads::is_file(table));
        let table = reading.materials.clone().or_else(sibling)?;
        if let Some(found) = foreign_file(&table, &Expected::MATERIAL_TABLE) {
            found.report(&table, diagnostics);
            return None;
        }
        let text = match read_text(&table) {
            Ok(text) => text,
            Err(e) => {
                let message = format!("cannot read the table of materials {}: {e}", table.display());
                diagnostics.error(None, message).of_kind((&e).into());
                return None;
            }
        };
        let before = diagnostics.items().len();
        let rows = read_rows(&table, &text, diagnostics);
        (diagnostics.items().len() == before).then_some(MaterialTable { path: table, rows })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives a material the properties of its row, if there is one.
    pub fn apply(&self, material: &mut MaterialDefinition) {
        let Some(row) = self.rows.get(&material.name) else { return };
        material.reflectance = row.reflectance;
        material.spectrum = row.spectrum.clone();
        material.classification = row.classification;
        material.is_ground = row.is_ground;
        material.leaf = row.leaf.or(material.leaf);
        material.optics = row.optics;
        material.place = row.place.clone();
    }

    /// The materials, by name.
    pub fn definitions(&self) -> Vec<MaterialDefinition> {
        let mut all: Vec<_> = self.rows.values().cloned().collect();
        all.sort_by(|a, b| a.name.cmp(&b.name));
        all
    }
}

fn read_rows(path: &Path, text: &str, diagnostics: &mut Diagnostics) -> HashMap<String, MaterialDefinition> {
    let mut rows = HashMap::new();
    let text = text.trim_start_matches('\u{feff}');
    let mut lines =
        (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let Some((number, heading)) = lines.next() else {
        diagnostics.error(Some(Place::of_file(path)), "the table of materials is empty").help(HELP);
        return rows;
    };
    let separator = Separator::guess(heading);
    // The keys of MTL files and of pipeline files name columns, too.
    let column = |name: String| match name.as_str() {
        "helios_reflectance" => "reflectance".to_owned(),
        "helios_classification" | "classification" => "class".to_owned(),
        "helios_isground" | "is_ground" => "ground".to_owned(),
        "helios_spectra" => "spectrum".to_owned(),
        "vlscan_leaf" | "is_leaf" => "leaf".to_owned(),
        _ => match name.strip_prefix("vlscan_") {
            Some(key) if COLUMNS[6..].contains(&key) => key.to_owned(),
            _ => name,
        },
    };
    let names = separator.split(heading).map(|at| column(heading[at].to_ascii_lowercase()));
    let names: Vec<String> = names.collect();
    let unknown = names.iter().find(|name| !COLUMNS.contains(&name.as_str()));
    if let Some((_, name)) = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
        let place = Place::in_line(path, number, heading, 0..heading.len());
        diagnostics.error(Some(place), format!("duplicate column {name}")).help(HELP);
        return rows;
    }
    if !names.iter().any(|n| n == "name") || unknown.is_some() {
        let what = unknown.map_or("no column \"name\"".to_owned(), |name| format!("the column \"{name}\""));
        let place = Place::in_line(path, number, heading, 0..heading.len());
        diagnostics.error(Some(place), format!("expected a table of materials, found {what}")).help(HELP);
        return rows;
    }
    for (number, line) in lines {
        let place = Place::in_line(path, number, line, 0..line.len());
        let mut material = MaterialDefinition { place: Some(place.clone()), ..diffuse("") };
        let fields = match fields_of(line, separator, names.len()) {
            Ok(fields) => fields,
            Err(found) => {
                let message = format!("expected {} fields, found {found}", names.len());
                diagnostics.error(Some(place), message).help(HELP);
                continue;
            }
        };
        for (name, (value, at)) in names.iter().zip(fields) {
            if let Err(expected) = set(&mut material, name, &value, separator) {
                let message = format!("expected {expected}, found \"{value}\"{}", comma_note(&value));
                diagnostics.error(Some(Place::in_line(path, number, line, at)), message).help(HELP);
            }
        }
        let name = material.name.clone();
        if rows.insert(name.clone(), material).is_some() {
            diagnostics.error(Some(place), format!("the material \"{name}\" is described twice"));
        }
    }
    rows
}

/// The fields of a row and their places, of which the last may be empty; `Err` has their number if it is not
/// `count`. Fields in quotes may hold the separator.
fn fields_of(line: &str, separator: Separator, count: usize) -> Result<Vec<(String, Range<usize>)>, usize> {
    if !line.contains('"') {
        let fields = separator.split_row(line, count)?;
        return Ok(fields.into_iter().map(|at| (line[at.clone()].to_owned(), at)).collect());
    }
    let fields = unquoted(line, separator);
    match fields.len() == count {
        true => Ok(fields.into_iter().map(|field| (field, 0..line.len())).collect()),
        false => Err(fields.len()),
    }
}

/// The text of a regular file.
fn read_text(path: &Path) -> std::io::Result<String> {
    // Opening a pipe would wait for its writer.
    if !path.metadata()?.is_file() {
        return Err(std::io::Error::other("it is not a regular file"));
    }
    String::from_utf8(read_file(path, MAX_BYTES)?).map_err(|_| std::io::Error::other("it is not UTF-8"))
}

fn set(
    material: &mut MaterialDefinition,
    column: &str,
    value: &str,
    separator: Separator,
) -> Result<(), &'static str> {
    match column {
        "name" if value.is_empty() => return Err("the name of a material"),
        "name" => material.name = printable(value),
        _ if value.is_empty() => {}
        "reflectance" => {
            let reflectance = separator.number(value.as_bytes(), std::iter::empty());
            let reflectance = reflectance.filter(|r| (0.0..=1.0).contains(r));
            material.reflectance = Some(reflectance.ok_or("a reflectance from 0 to 1")?);
        }
        "class" => material.classification = value.parse::<u8>().map_err(|_| "a class from 0 to 255")?.into(),
        "ground" => material.is_ground = boolean(value).ok_or("true or false")?,
        "leaf" => material.leaf = Some(boolean(value).ok_or("true or false")?),
        "spectrum" => material.spectrum = Some(value.to_owned()),
        key => {
            let number = separator.number(value.as_bytes(), std::iter::empty());
            return set_optics(&mut material.optics, key.as_bytes(), number).map_or(Ok(()), Err);
        }
    }
    Ok(())
}

fn boolean(value: &str) -> Option<bool> {
    match value.to_ascii_lowercase().as_str() {
        "true" | "1" | "yes" => Some(true),
        "false" | "0" | "no" => Some(false),
        _ => None,
    }
}
