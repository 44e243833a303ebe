//! Inventories of trees: one tree per line, columns found by their headings in English and German.

use super::headings::{PROJECT, read_headings};
use std::collections::HashMap;
use std::hash::Hash;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::{self, Bounds};
use vlscan_base::recognise::{Expected, foreign};
use vlscan_survey::decode_table;
use vlscan_tables::input::read_file;
use vlscan_tables::{Headings, Line, Quantity, TableColumn, TextTable};

/// Maximum size of an inventory, bytes.
const MAX_BYTES: u64 = 256 << 20;
/// Maximum number of lines whose problems are reported.
const MAX_PROBLEMS: usize = 5;
/// Heights and crown diameters of trees, m.
const SIZE: Bounds = Bounds::new(0.01, 200.0, "metres from 0.01 to 200");
/// Crown radii, m.
const RADIUS: Bounds = Bounds::new(0.005, 100.0, "metres from 0.005 to 100");
/// Difference between a crown and twice its radius that is rounding, as a share.
const CROWN_TOLERANCE: f64 = 0.05;
/// Maximum crown diameter that causes no warning, as a multiple of the height.
const MAX_LIKELY_CROWN: f64 = 2.5;
/// Stem diameters in a column that has a unit, m.
const STEM: Bounds = Bounds::new(0.0, 15.0, "a stem diameter of at most 15 m");
/// Stem diameters in a column without a unit, m or cm.
const STEM_WITHOUT_UNIT: Bounds = Bounds::new(0.0, 1e6, "a stem diameter");
/// Largest stem diameter in a column without a unit that is metres.
const MAX_STEM_IN_METRES: f64 = 3.0;
/// Stem diameter above which millimetres are likely, m.
const MAX_LIKELY_STEM: f64 = 2.5;
/// Distance up to which two trees are taken to be at one place, m.
const SAME_PLACE: f64 = 0.01;
/// Extent of all places below which they look like longitudes and latitudes.
const MAX_EXTENT_OF_DEGREES: f64 = 1.0;

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
    /// The trees, in the order of the table.
    pub trees: Vec<Tree>,
}

impl Inventory {
    /// Reads a table of text with headings: `x`, `y` and `height` are needed; `crown`, `crown_radius`, `dbh`,
    /// `species`, `id` and `z` may be there, others are ignored, with a warning. Lengths are m unless the
    /// heading has another unit; a `dbh` without a unit whose largest value is above 3 is cm. Numbers may
    /// have decimal commas. Also returns notes for the user.
    ///
    /// # Errors
    /// [`Error::Input`] with all problems of the headings and those of up to five lines, [`Error::Io`].
    pub fn read(path: &Path) -> Result<(Inventory, Diagnostics)> {
        let bytes = read_file(path, MAX_BYTES).map_err(|e| Error::open(path, e))?;
        if let Some(found) = foreign(path, &bytes, &Expected::INVENTORY) {
            return Err(found.error(path));
        }
        let (text, guess) =
            decode_table(&bytes).map_err(|e| Error::input(format!("{}: {e}", path.display())))?;
        let mut table =
            Table { path, problems: Diagnostics::default(), trees: Vec::new(), lines: Vec::new() };
        if let Some(guess) = guess {
            table.problems.warn(Some(Place::of_file(path)), guess);
        }
        table.read(&text);
        let Table { problems, trees, .. } = table;
        let found = problems.finish(false)?;
        if trees.is_empty() {
            return Err(Error::input(format!("{}: no tree in the inventory", path.display())));
        }
        Ok((Inventory { trees }, found))
    }
}

struct Table<'p> {
    path: &'p Path,
    problems: Diagnostics,
    trees: Vec<Tree>,
    /// The line of each tree.
    lines: Vec<usize>,
}

impl Table<'_> {
    fn read(&mut self, text: &str) {
        let mut table = TextTable::new(self.path, text);
        let Some(heading) = table.next() else { return };
        let place = table.place(&heading, None);
        let headings = read_headings(&heading, &place, &mut self.problems);
        let place = Some(place);
        let (mut wrong, mut commas, mut points) = (0, None, None);
        while let Some(mut line) = table.next() {
            let mut row =
                Row { headings: &headings, has_comma: false, has_point: false, problems: Vec::new() };
            let fitted = line.fit(headings.width, "the heading", table.separator());
            let tree = match fitted {
                Ok(()) => row.tree(&line, self.trees.len() + 1),
                Err(e) => {
                    let problem = self.problems.error(Some(table.place(&line, None)), e.message);
                    if !e.help.is_empty() {
                        problem.help(e.help);
                    }
                    wrong += 1;
                    if wrong == MAX_PROBLEMS {
                        break;
                    }
                    continue;
                }
            };
            commas = commas.or(row.has_comma.then_some(line.number));
            points = points.or(row.has_point.then_some(line.number));
            if row.problems.is_empty() {
                self.trees.push(tree);
                self.lines.push(line.number);
                continue;
            }
            for problem in row.problems {
                self.problems.error(Some(table.place(&line, None)), problem);
            }
            wrong += 1;
            if wrong == MAX_PROBLEMS {
                break;
            }
        }
        if let (Some(comma), Some(point)) = (commas, points) {
            let message =
                format!("line {comma} has numbers with a decimal comma, line {point} with a decimal point");
            self.problems
                .error(place.clone(), message)
                .help("use one style for all numbers, without thousands separators");
        }
        if !self.problems.is_fatal(false) {
            let stem = headings.get(Quantity::Stem);
            self.resolve_stems(stem.is_some_and(|stem| stem.factor.is_some()), place.as_ref());
            self.check_crowns(place.as_ref());
            self.check_places(place.as_ref());
        }
    }

    /// Resolves the unit of stem diameters and asks about those that no tree has.
    fn resolve_stems(&mut self, has_unit: bool, heading: Option<&Place>) {
        let all = || self.trees.iter().zip(&self.lines).filter_map(|(tree, line)| Some((tree.stem?, *line)));
        let Some((most, line)) = all().reduce(|a, b| if b.0 > a.0 { b } else { a }) else { return };
        let is_cm = !has_unit && most > MAX_STEM_IN_METRES;
        let least = all().map(|(stem, _)| stem).fold(f64::INFINITY, f64::min);
        let metres = if is_cm { most / 100.0 } else { most };
        if metres > MAX_LIKELY_STEM {
            let message = match has_unit {
                true => format!("line {line}: a stem diameter of {metres:.2} m; is the column in mm?"),
                false => format!("line {line}: a stem diameter of {most} is {metres:.2} m; is it mm?"),
            };
            let help = "name the unit in the heading: dbh_mm, dbh_cm or dbh_m";
            match has_unit {
                true => self.problems.warn(heading.cloned(), message),
                false => self.problems.error(heading.cloned(), message),
            }
            .help(help);
        } else if is_cm && least < 0.01 * most && least < 1.0 {
            let message = format!("stem diameters from {least} to {most} without a unit are read as cm");
            self.problems
                .warn(heading.cloned(), message)
                .help("name the unit in the heading: dbh_cm or dbh_m");
        }
        if is_cm {
            self.trees.iter_mut().for_each(|tree| tree.stem = tree.stem.map(|cm| cm / 100.0));
        }
    }

    /// Warns of crowns that are much wider than their trees are high.
    fn check_crowns(&mut self, heading: Option<&Place>) {
        let is_wide = |tree: &Tree| tree.crown.is_some_and(|crown| crown > MAX_LIKELY_CROWN * tree.height);
        let mut wide = self.trees.iter().zip(&self.lines).filter(|(tree, _)| is_wide(tree));
        let Some((tree, line)) = wide.next() else { return };
        let (crown, height, count) = (tree.crown.unwrap_or_default(), tree.height, 1 + wide.count());
        let trees = if count == 1 { "tree has a crown" } else { "trees have crowns" };
        let message = format!(
            "{count} {trees} wider than {MAX_LIKELY_CROWN} times the height, line {line} the first: {crown} \
             m at a height of {height} m"
        );
        let help = "`crown` is the diameter; name the unit in the heading: crown_cm or crown_ft";
        self.problems.warn(heading.cloned(), message).help(help);
    }

    /// Warns of duplicate trees and of coordinates in degrees.
    fn check_places(&mut self, heading: Option<&Place>) {
        let cell =
            |tree: &Tree| [tree.position[0], tree.position[1]].map(|v| (v / SAME_PLACE).round() as i64);
        if let Some((count, [first, second])) = self.repeated(|tree| Some(cell(tree))) {
            let [x, y, _] = self.trees[first].position;
            let message = format!(
                "{count} trees have the position of another tree, the first of them in lines {} and {}: x \
                 {x} y {y}; all are placed",
                self.lines[first], self.lines[second]
            );
            self.problems.warn(heading.cloned(), message);
        }
        let numbered = |(i, tree): (usize, &Tree)| tree.id == (i + 1).to_string();
        let has_ids = !self.trees.iter().enumerate().all(numbered);
        if let Some((count, [first, second])) = self.repeated(|tree| has_ids.then(|| tree.id.clone())) {
            let message = format!(
                "{count} trees have the id of another tree, the first of them in lines {} and {}: `{}`",
                self.lines[first], self.lines[second], self.trees[first].id
            );
            self.problems.warn(heading.cloned(), message);
        }
        let extent = [0, 1].map(|axis| {
            let values = self.trees.iter().map(|tree| tree.position[axis]);
            (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
        });
        let [(west, east), (south, north)] = extent;
        let is_degrees = west >= -180.0 && east <= 180.0 && south >= -90.0 && north <= 90.0;
        let size = (east - west).max(north - south);
        if is_degrees && size > 0.0 && size < MAX_EXTENT_OF_DEGREES {
            let message =
                format!("all trees stand within {size:.6} m: x and y look like longitude and latitude");
            self.problems.warn(heading.cloned(), message).help(PROJECT);
        }
    }

    /// Number of trees whose key an earlier one has, and the first two trees that share one.
    fn repeated<K: Hash + Eq>(&self, key: impl Fn(&Tree) -> Option<K>) -> Option<(usize, [usize; 2])> {
        let (mut seen, mut count, mut first) = (HashMap::new(), 0, None);
        for (i, tree) in self.trees.iter().enumerate() {
            let Some(key) = key(tree) else { continue };
            if let Some(&earlier) = seen.get(&key) {
                count += 1;
                first.get_or_insert([earlier, i]);
            } else {
                seen.insert(key, i);
            }
        }
        first.map(|pair| (count, pair))
    }
}

/// A line as it is read.
struct Row<'h> {
    headings: &'h Headings,
    has_comma: bool,
    has_point: bool,
    problems: Vec<String>,
}

impl Row<'_> {
    fn tree(&mut self, line: &Line, number: usize) -> Tree {
        let mut tree = Tree {
            id: number.to_string(),
            position: [f64::NAN, f64::NAN, 0.0],
            height: f64::NAN,
            crown: None,
            stem: None,
            species: None,
        };
        let (headings, mut radius) = (self.headings, None);
        for TableColumn { quantity, index, factor, name } in &headings.columns {
            let field = line.fields[*index].as_ref();
            let is_missing =
                field.is_empty() || field.eq_ignore_ascii_case("na") || field.eq_ignore_ascii_case("nan");
            let mut value = |bounds: Bounds| self.number(field, name, *factor, bounds);
            match quantity {
                Quantity::TreeId if !is_missing => tree.id = field.to_owned(),
                Quantity::Species if !is_missing => tree.species = Some(field.to_owned()),
                Quantity::X => tree.position[0] = value(quantity::COORDINATE).unwrap_or(f64::NAN),
                Quantity::Y => tree.position[1] = value(quantity::COORDINATE).unwrap_or(f64::NAN),
                Quantity::Z | Quantity::Ground if !is_missing => {
                    tree.position[2] = value(quantity::COORDINATE).unwrap_or(f64::NAN)
                }
                Quantity::TreeHeight => tree.height = value(SIZE).unwrap_or(f64::NAN),
                Quantity::Crown if !is_missing => tree.crown = value(SIZE),
                Quantity::CrownRadius if !is_missing => radius = value(RADIUS),
                Quantity::Stem if !is_missing => {
                    let bounds = if factor.is_some() { STEM } else { STEM_WITHOUT_UNIT };
                    // 0 means trees that were not measured.
                    tree.stem = value(bounds).filter(|stem| *stem > 0.0);
                }
                _ => {}
            }
        }
        let of_radius = radius.map(|radius| 2.0 * radius);
        if let (Some(crown), Some(other)) = (tree.crown, of_radius)
            && (crown - other).abs() > CROWN_TOLERANCE * crown.max(other)
        {
            self.problems
                .push(format!("the crown of {crown} m and the crown radius of {} m differ", 0.5 * other));
        }
        tree.crown = tree.crown.or(of_radius);
        tree
    }

    /// A number with a decimal point or a decimal comma; `None` after a problem.
    fn number(&mut self, field: &str, heading: &str, factor: Option<f64>, bounds: Bounds) -> Option<f64> {
        if field.is_empty() {
            self.problems.push(format!("{heading} is empty, expected {}", bounds.expected));
            return None;
        }
        let commas = field.matches(',').count();
        if commas > 1 || commas == 1 && field.contains('.') {
            self.problems.push(format!(
                "`{field}` for {heading} has thousands separators, expected {} without them",
                bounds.expected
            ));
            return None;
        }
        let number = field.replace(',', ".").parse::<f64>().ok().map(|value| value * factor.unwrap_or(1.0));
        self.has_comma |= commas == 1;
        self.has_point |= number.is_some() && commas == 0 && field.contains('.');
        let found = number.filter(|value| bounds.contains(*value));
        if found.is_none() {
            self.problems.push(format!("`{field}` for {heading}, expected {}", bounds.expected));
        }
        found
    }
}

#[cfg(test)]
mod tests;
