//! The columns of one stream and their positions. Headers of text and schemas of Arrow streams are checked alike.

use super::columns::{COLUMNS, PulseColumn, parse_pulse_heading};
use super::row::{ATTITUDE, ColumnSet, DIRECTION, EXACT, LOW, ORIGIN, PulseRow, RowFault, Values};
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Result;
use vlscan_geom::DVec3;

#[derive(Debug)]
pub(super) struct StreamSchema {
    /// Name of the stream in messages.
    pub path: PathBuf,
    /// Column, factor to ns, m or rad, and position in a row.
    columns: Vec<(PulseColumn, f64, usize)>,
    present: ColumnSet,
}

impl StreamSchema {
    /// Resolves headings to columns. Each heading has its place and, where its values are not numbers, a description
    /// of them; `whole` is the place of the header.
    ///
    /// # Errors
    /// [`Error::Input`](vlscan_base::error::Error::Input) with every heading that is unknown, repeated or without numbers,
    /// and with the missing columns that a pulse requires.
    pub fn from_headings<'h>(
        path: &Path,
        headings: impl Iterator<Item = (&'h str, Place, Option<&'h str>)>,
        whole: Place,
    ) -> Result<StreamSchema> {
        let mut problems = Diagnostics::default();
        let mut schema =
            StreamSchema { path: path.to_path_buf(), columns: Vec::new(), present: ColumnSet::default() };
        for (position, (heading, place, no_numbers)) in headings.enumerate() {
            match (parse_pulse_heading(heading), no_numbers) {
                (Ok((column, _)), _) if schema.present.has(column) => {
                    problems.error(Some(place), format!("a second column for {}", column.entry().name));
                }
                (Ok(_), Some(holds)) => {
                    problems
                        .error(Some(place), format!("column `{heading}` holds {holds}, expected numbers"));
                }
                (Ok((column, factor)), None) => schema.push(column, factor, position),
                (Err((message, help)), _) => {
                    problems.error(Some(place), message).help(help);
                }
            }
        }
        if problems.is_empty() {
            check_complete(schema.present, whole, &mut problems);
        }
        problems.finish(false)?;
        Ok(schema)
    }

    /// A schema for columns without headings, with their factors.
    pub fn without_headings(path: &Path, columns: impl Iterator<Item = (PulseColumn, f64)>) -> StreamSchema {
        let mut schema =
            StreamSchema { path: path.to_path_buf(), columns: Vec::new(), present: ColumnSet::default() };
        columns.enumerate().for_each(|(position, (column, factor))| schema.push(column, factor, position));
        schema
    }

    fn push(&mut self, column: PulseColumn, factor: f64, position: usize) {
        self.columns.push((column, factor, position));
        self.present = self.present.with(column);
    }

    pub fn width(&self) -> usize {
        self.columns.len()
    }

    /// Position of a column in a row.
    pub fn position(&self, column: PulseColumn) -> Option<usize> {
        self.columns.iter().find(|c| c.0 == column).map(|c| c.2)
    }

    /// The values of a row in ns, m and rad; `number` reads a value by column and position.
    pub fn values<E>(&self, number: impl Fn(PulseColumn, usize) -> Result<f64, E>) -> Result<Values, E> {
        let mut values = [0.0; COLUMNS];
        for (column, factor, position) in &self.columns {
            values[*column as usize] = number(*column, *position)? * factor;
        }
        Ok(values)
    }

    /// Appends the pulse of a row, if `check` accepts it, in the frame whose origin is at `shift` in the world.
    /// `order` is the index of the row in the stream, from 0.
    pub fn push_pulse(
        &self,
        values: &Values,
        shift: DVec3,
        order: u64,
        into: &mut Vec<PulseRow>,
        check: &impl Fn(&PulseRow) -> Result<(), RowFault>,
    ) -> Result<(), RowFault> {
        let row = PulseRow::of(values, self.present, shift, order)?;
        check(&row)?;
        into.push(row);
        Ok(())
    }
}

/// Reports missing columns that a pulse requires, and incomplete groups of columns.
fn check_complete(present: ColumnSet, place: Place, problems: &mut Diagnostics) {
    let mut missing: Vec<&str> = Vec::new();
    let mut need = |columns: &[PulseColumn]| {
        missing.extend(columns.iter().filter(|c| !present.has(**c)).map(|c| c.entry().name));
    };
    need(&ORIGIN);
    for group in [&ATTITUDE[..], &EXACT[..], &LOW[..]] {
        if present.has_any(group) {
            need(group);
        }
    }
    if !present.has_any(&ATTITUDE) || present.has_any(&DIRECTION) {
        need(&DIRECTION);
    }
    if !missing.is_empty() {
        problems
            .error(Some(place), format!("no column for {}", missing.join(", ")))
            .help("a pulse needs x, y, z and dx, dy, dz (or qw, qx, qy, qz)");
    }
}
