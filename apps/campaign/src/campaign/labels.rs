//! The table of a cell's objects: the meaning of the numbers in its points.

use std::collections::BTreeMap;
use std::path::Path;
use vlscan_base::columns::quoted;
use vlscan_base::error::{Error, Result};
use vlscan_tables::TextTable;
use vlscan_tools::campaign::Cell;

/// Labels of the parts of a scene from an inventory, as columns of text.
#[derive(Debug, Default)]
pub struct Labels {
    columns: Vec<String>,
    /// Fields by the index of the part.
    rows: BTreeMap<u32, Vec<String>>,
}

/// Columns of a stand's labels that the table of parts has already.
const KNOWN: [&str; 5] = ["part", "x", "y", "z", "height"];

/// A table with the number of its rows.
pub struct Table {
    pub text: String,
    pub rows: u64,
}

impl Labels {
    /// Reads the labels of a stand.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Internal`] for a table that is none.
    pub fn read(path: &Path) -> Result<Labels> {
        let text = vlscan_base::files::reads::read_to_string(path).map_err(|e| Error::open(path, e))?;
        Labels::parse(path, &text)
            .ok_or_else(|| Error::Internal(format!("{}: no table of labels", path.display())))
    }

    fn parse(path: &Path, text: &str) -> Option<Labels> {
        let mut lines = TextTable::new(path, text);
        let heading = lines.next()?.fields;
        let part = heading.iter().position(|name| name == "part")?;
        let own: Vec<usize> = (0..heading.len()).filter(|i| !KNOWN.contains(&&*heading[*i])).collect();
        // The table of parts has an id and a name of each part, too.
        let name = |i: &usize| if heading[*i] == "id" { "tree".to_owned() } else { heading[*i].to_string() };
        let mut labels = Labels { columns: own.iter().map(name).collect(), rows: BTreeMap::new() };
        for line in lines {
            let row = line.fields;
            let pick = |i: &usize| row.get(*i).map(ToString::to_string).unwrap_or_default();
            labels.rows.insert(row.get(part)?.parse().ok()?, own.iter().map(pick).collect());
        }
        Some(labels)
    }
}

/// The table of parts with the labels of a stand and with what the cell is for.
///
/// # Errors
/// [`Error::Internal`] for a table of parts without numbers.
pub fn objects(parts: &str, labels: &Labels, cell: &Cell) -> Result<Table> {
    let mut lines = parts.lines();
    let mut text = lines.next().unwrap_or_default().to_owned();
    for column in labels.columns.iter().map(String::as_str).chain(["group", "split"]) {
        text.push(',');
        text.push_str(column);
    }
    text.push('\n');
    let mut rows = 0;
    for line in lines {
        let number = line.split(',').nth(1).and_then(|field| field.parse::<u32>().ok());
        let number = number.ok_or_else(|| Error::Internal(format!("no part in {line}")))?;
        text.push_str(line);
        for i in 0..labels.columns.len() {
            text.push(',');
            text.push_str(&labels.rows.get(&number).map_or_else(String::new, |row| quoted(&row[i])));
        }
        text.push_str(&format!(",{},{}\n", quoted(&cell.group), cell.split));
        rows += 1;
    }
    Ok(Table { text, rows })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_stand_beside_the_parts_they_are_of() {
        let text = "part,id,species,x,crown\n1,\"a, b\",beech,3.0,\n2,c,oak,4.0,5.5\n";
        let labels = Labels::parse(Path::new("labels.csv"), text).unwrap();
        assert_eq!(labels.columns, ["tree", "species", "crown"]);
        let file: vlscan_tools::campaign::File = toml::from_str(
            "out = \"o\"\n[[scene]]\nname = \"s\"\nfile = \"x\"\n[[variant]]\nname = \"v\"\nplan = \"p\"\n",
        )
        .unwrap();
        let cell = vlscan_tools::campaign::Cells::of(&file).unwrap().0.remove(0);
        let table = objects("object,part,points\n0,0,9\n1,1,7\n", &labels, &cell).unwrap();
        assert_eq!(
            table.text,
            "object,part,points,tree,species,crown,group,split\n0,0,9,,,,s,\n1,1,7,\"a, b\",beech,,s,\n"
        );
        assert_eq!(table.rows, 2);
    }
}
