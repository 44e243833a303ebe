//! Inventories of trees: one tree per line, columns found by their headings.

use crate::columns::{Dimension, HeadingError, Separator, parse_heading, unquoted};
use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use crate::input::read_file;
use crate::quantity::{self, Bounds};
use std::path::Path;

/// Maximum size of an inventory, bytes.
const MAX_BYTES: u64 = 256 << 20;
/// Maximum number of problems that are reported.
const MAX_PROBLEMS: usize = 5;
/// Heights and diameters of trees, m.
const SIZE: Bounds = Bounds { low: 0.01, high: 200.0, expected: "metres from 0.01 to 200" };

/// A tree of an inventory.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    /// Its name in the inventory, or its number from 1.
    pub id: String,
    /// World position, m; z is that of the ground where there is a terrain.
    pub position: [f64; 3],
    /// m.
    pub height: f64,
    /// Crown diameter, m.
    pub crown: Option<f64>,
    /// Stem diameter at breast height, m.
    pub stem: Option<f64>,
    /// As written.
    pub species: Option<String>,
}

/// A table of trees.
#[derive(Clone, Debug, Default)]
pub struct Inventory {
    pub trees: Vec<Tree>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Column {
    Id,
    X,
    Y,
    Z,
    Height,
    Crown,
    /// Stem diameter in m, or in cm as foresters write it.
    Stem,
    Species,
}

fn known(name: &str) -> Option<(Column, Dimension)> {
    let column = match name {
        "id" | "tree" | "tree_id" | "treeid" | "name" | "label" => Column::Id,
        "x" | "easting" | "east" => Column::X,
        "y" | "northing" | "north" => Column::Y,
        "z" | "elevation" | "ground" => Column::Z,
        "height" | "h" | "tree_height" => Column::Height,
        "crown" | "crown_diameter" | "crowndiameter" | "cd" => Column::Crown,
        "dbh" | "bhd" | "diameter" | "stem_diameter" => Column::Stem,
        "species" | "type" | "art" => Column::Species,
        _ => return None,
    };
    let dimension =
        if matches!(column, Column::Id | Column::Species) { Dimension::Count } else { Dimension::Length };
    Some((column, dimension))
}

impl Inventory {
    /// Reads a table of text with headings: `x`, `y` and `height` are needed; `crown`, `dbh`, `species`, `id` and `z` may be
    /// there, others are ignored. Lengths are m; a `dbh` whose largest value is above 3 is cm.
    ///
    /// # Errors
    /// [`Error::Input`] with up to five places, [`Error::Io`].
    pub fn read(path: &Path) -> Result<Inventory> {
        let bytes = read_file(path, MAX_BYTES).map_err(|e| Error::open(path, e))?;
        let text = String::from_utf8_lossy(&bytes);
        let text = text.trim_start_matches('\u{feff}');
        let mut problems = Diagnostics::default();
        let trees = read_rows(text, path, &mut problems);
        let warnings = problems.finish(false)?;
        debug_assert!(!warnings.is_fatal(false));
        if trees.is_empty() {
            return Err(Error::input(format!("{}: no tree in the inventory", path.display())));
        }
        let mut inventory = Inventory { trees };
        inventory.metres_for_centimetres();
        Ok(inventory)
    }

    fn metres_for_centimetres(&mut self) {
        let most = self.trees.iter().filter_map(|t| t.stem).fold(0.0, f64::max);
        if most > 3.0 {
            self.trees.iter_mut().for_each(|tree| tree.stem = tree.stem.map(|cm| cm / 100.0));
        }
    }
}

fn read_rows(text: &str, path: &Path, problems: &mut Diagnostics) -> Vec<Tree> {
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| {
        let content = line.trim();
        !content.is_empty() && !content.starts_with('#')
    });
    let Some((number, heading)) = lines.next() else { return Vec::new() };
    let separator = Separator::guess(heading);
    let at_line =
        |number: u32, line: &str| Place::in_line(path, number as usize, line, 0..line.len().min(200));
    let mut columns = Vec::new();
    for name in unquoted(heading, separator) {
        match parse_heading(&name, known) {
            Ok(found) => columns.push(Some((found.column, found.factor.unwrap_or(1.0)))),
            Err(HeadingError::UnknownName(_)) => columns.push(None),
            Err(HeadingError::WrongUnit(what, expected)) => {
                problems.error(Some(at_line(number, heading)), format!("{what}, {expected}"));
                return Vec::new();
            }
        }
    }
    let has = |wanted: Column| columns.iter().flatten().any(|(column, _)| *column == wanted);
    if let Some(missing) = [Column::X, Column::Y, Column::Height].into_iter().find(|c| !has(*c)) {
        let name = format!("{missing:?}").to_lowercase();
        problems
            .error(Some(at_line(number, heading)), format!("no column {name}"))
            .help("an inventory has the columns x, y, height, and may have crown, dbh, species, id, z");
        return Vec::new();
    }
    let mut trees = Vec::new();
    let mut wrong = 0;
    for (number, line) in lines {
        match tree(&unquoted(line, separator), &columns, trees.len() + 1) {
            Ok(tree) => trees.push(tree),
            Err(message) => {
                problems.error(Some(at_line(number, line)), message);
                wrong += 1;
                if wrong == MAX_PROBLEMS {
                    break;
                }
            }
        }
    }
    trees
}

fn tree(
    fields: &[String],
    columns: &[Option<(Column, f64)>],
    number: usize,
) -> std::result::Result<Tree, String> {
    let mut tree = Tree {
        id: number.to_string(),
        position: [f64::NAN, f64::NAN, 0.0],
        height: f64::NAN,
        crown: None,
        stem: None,
        species: None,
    };
    if fields.len() < columns.len() && columns[fields.len()..].iter().any(Option::is_some) {
        return Err(format!("{} columns, expected {}", fields.len(), columns.len()));
    }
    for (field, column) in fields.iter().zip(columns) {
        let Some((column, factor)) = column else { continue };
        let field = field.trim();
        let is_missing =
            field.is_empty() || field.eq_ignore_ascii_case("na") || field.eq_ignore_ascii_case("nan");
        let value = |bounds: Bounds| match field.parse::<f64>().map(|v| v * factor) {
            Ok(value) if bounds.contains(value) => Ok(value),
            _ => Err(format!("`{field}`, expected {}", bounds.expected)),
        };
        match column {
            Column::Id if !is_missing => tree.id = field.to_owned(),
            Column::Species if !is_missing => tree.species = Some(field.to_owned()),
            Column::X => tree.position[0] = value(quantity::COORDINATE)?,
            Column::Y => tree.position[1] = value(quantity::COORDINATE)?,
            Column::Z if !is_missing => tree.position[2] = value(quantity::COORDINATE)?,
            Column::Height => tree.height = value(SIZE)?,
            Column::Crown if !is_missing => tree.crown = Some(value(SIZE)?),
            // May be cm.
            Column::Stem if !is_missing => {
                tree.stem = Some(value(Bounds { high: 2000.0, expected: "a stem diameter", ..SIZE })?);
            }
            _ => {}
        }
    }
    Ok(tree)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Inventory> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trees.csv");
        std::fs::write(&path, text).unwrap();
        Inventory::read(&path)
    }

    #[test]
    fn columns_are_found_by_their_headings() {
        let table = "plot;Tree;Easting;Northing;H[m];DBH;Species;Crown_m\nA;b7;431000.5;5412000;22.5;38;beech;7\nA;;1;2;10;;;NA\n";
        let trees = read(table).unwrap().trees;
        assert_eq!(trees.len(), 2);
        let expected = Tree {
            id: "b7".into(),
            position: [431_000.5, 5_412_000.0, 0.0],
            height: 22.5,
            crown: Some(7.0),
            stem: Some(0.38),
            species: Some("beech".into()),
        };
        assert_eq!(trees[0], expected);
        assert_eq!(
            (trees[1].id.as_str(), trees[1].crown, trees[1].stem, &trees[1].species),
            ("2", None, None, &None)
        );
    }

    #[test]
    fn fields_may_be_quoted_or_empty() {
        let table = "\"id\",\"x\",\"y\",\"height\",\"species\",\"crown\"\n\"a, b\",1,2,\"10\",\"spruce, \"\"old\"\"\",4\nc,3,4,12,beech,\n";
        let trees = read(table).unwrap().trees;
        assert_eq!((trees[0].id.as_str(), trees[0].height, trees[0].crown), ("a, b", 10.0, Some(4.0)));
        assert_eq!(trees[0].species.as_deref(), Some("spruce, \"old\""));
        assert_eq!((trees[1].species.as_deref(), trees[1].crown), (Some("beech"), None));
    }

    #[test]
    fn mistakes_are_told_with_their_lines() {
        let said = |text: &str| match read(text) {
            Err(Error::Input(problems)) => problems.render(false),
            other => panic!("{other:?}"),
        };
        assert!(said("x,y\n1,2\n").contains("no column height"));
        assert!(said("x,y,height\n1,2,tall\n").contains("trees.csv:2"));
        assert!(said("x,y,height\n1,2,-4\n1,2\n").contains("expected metres"));
        assert!(said("x,y,height_ns\n").contains("ns"));
        assert!(said("").contains("no tree"));
    }
}
