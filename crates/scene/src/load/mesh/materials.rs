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
use crate::mtl_optics::{ExpectedValue, OPTICAL_KEYS, set_optics};
use crate::text::printable;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use vlscan_base::columns::{Separator, comma_note};
use vlscan_base::diag::{Diagnostics, Place, nearest};
use vlscan_base::files::reads;
use vlscan_base::recognise::{Expected, foreign_file};
use vlscan_survey::{MaterialDefinition, MeshReading};
use vlscan_tables::input::read_file;
use vlscan_tables::{Line, TextTable, did_you_mean};

/// Name of the table that is searched next to a mesh file.
const FILE_NAME: &str = "materials.csv";
/// Columns other than those of optical properties.
const COLUMNS: [&str; 6] = ["name", "reflectance", "class", "ground", "leaf", "spectrum"];
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

    /// The names of the materials, in order.
    pub fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.rows.keys().map(String::as_str).collect();
        names.sort_unstable();
        names
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
    let mut table = TextTable::new(path, text);
    let Some(heading) = table.next() else {
        diagnostics.error(Some(Place::of_file(path)), "the table of materials is empty").help(HELP);
        return rows;
    };
    let Some(names) = read_heading(&table, &heading, diagnostics) else { return rows };
    while let Some(mut line) = table.next() {
        let place = table.place(&line, None);
        if let Err(e) = line.fit(names.len(), "the heading", table.separator()) {
            let help = if e.help.is_empty() { HELP } else { e.help };
            diagnostics.error(Some(place), e.message).help(help);
            continue;
        }
        let mut material = MaterialDefinition { place: Some(place.clone()), ..diffuse("") };
        for (column, (name, value)) in names.iter().zip(&line.fields).enumerate() {
            if let Err(expected) = set(&mut material, name, value, table.separator()) {
                let message = format!("{expected}, found \"{value}\"{}", comma_note(value));
                diagnostics.error(Some(table.place(&line, Some(column))), message).help(HELP);
            }
        }
        let name = material.name.clone();
        if rows.insert(name.clone(), material).is_some() {
            diagnostics.error(Some(place), format!("the material \"{name}\" is described twice"));
        }
    }
    rows
}

/// The columns that a heading names; `None` after an error.
fn read_heading(table: &TextTable, heading: &Line, diagnostics: &mut Diagnostics) -> Option<Vec<String>> {
    let mut names: Vec<String> = heading.fields.iter().map(|field| column(field)).collect();
    // Separators at the end of a line do not make columns.
    while names.last().is_some_and(String::is_empty) {
        names.pop();
    }
    let repeated = (0..names.len()).find(|i| names[..*i].contains(&names[*i]));
    let is_known = |name: &str| COLUMNS.contains(&name) || OPTICAL_KEYS.contains(&name);
    let unknown = names.iter().position(|name| !is_known(name));
    let open = COLUMNS.iter().chain(&OPTICAL_KEYS).filter(|known| !names.iter().any(|name| name == *known));
    let open: Vec<&str> = open.copied().collect();
    let question = |i: usize| did_you_mean([&names[i]], |name| nearest(name, open.iter().copied()));
    let (at, message, question) = match (repeated, unknown) {
        (Some(i), _) => (Some(i), format!("duplicate column {}", names[i]), None),
        (None, Some(i)) => {
            let message = format!("expected a table of materials, found the column \"{}\"", names[i]);
            (Some(i), message, question(i))
        }
        (None, None) if names.iter().any(|name| name == "name") => return Some(names),
        (None, None) => (None, "expected a table of materials, found no column \"name\"".to_owned(), None),
    };
    let help = question.unwrap_or_else(|| HELP.to_owned());
    diagnostics.error(Some(table.place(heading, at)), message).help(help);
    None
}

/// The column of a heading, which may be a key of MTL files or of pipeline files.
fn column(heading: &str) -> String {
    let name = heading.to_ascii_lowercase();
    match name.as_str() {
        "helios_reflectance" => "reflectance".to_owned(),
        "helios_classification" | "classification" => "class".to_owned(),
        "helios_isground" | "is_ground" => "ground".to_owned(),
        "helios_spectra" => "spectrum".to_owned(),
        "vlscan_leaf" | "is_leaf" => "leaf".to_owned(),
        _ => match name.strip_prefix("vlscan_") {
            Some(key) if OPTICAL_KEYS.contains(&key) => key.to_owned(),
            _ => name,
        },
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
) -> Result<(), ExpectedValue> {
    let is_true = || boolean(value).ok_or(ExpectedValue("true or false"));
    match column {
        "name" if value.is_empty() => return Err(ExpectedValue("the name of a material")),
        "name" => material.name = printable(value),
        _ if value.is_empty() => {}
        "reflectance" => {
            let reflectance = separator.number(value.as_bytes(), std::iter::empty());
            let reflectance = reflectance.filter(|r| (0.0..=1.0).contains(r));
            material.reflectance = Some(reflectance.ok_or(ExpectedValue("a reflectance from 0 to 1"))?);
        }
        "class" => {
            let class = value.parse::<u8>().map_err(|_| ExpectedValue("a class from 0 to 255"))?;
            material.classification = class.into();
        }
        "ground" => material.is_ground = is_true()?,
        "leaf" => material.leaf = Some(is_true()?),
        "spectrum" => material.spectrum = Some(value.to_owned()),
        key => {
            let number = separator.number(value.as_bytes(), std::iter::empty());
            return set_optics(&mut material.optics, key.as_bytes(), number);
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
