//! Pulses as rows of an Arrow stream, in batches as they arrived.

use super::columns::{COLUMNS, Column, named};
use super::read::check_complete;
use super::row::{Present, PulseRow};
use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use crate::geom::DVec3;
use crate::input::arrow::{ArrowDecoder, Batch, Field, table_error};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Batches that have arrived.
#[derive(Debug)]
pub(super) struct Tables {
    path: PathBuf,
    decoder: ArrowDecoder,
    format: Option<Arc<TableFormat>>,
    /// Rows of a batch that are in no block yet.
    current: Option<TableRows>,
}

/// What the columns are.
#[derive(Debug)]
struct TableFormat {
    path: PathBuf,
    /// Column, factor and position.
    columns: Vec<(Column, f64, usize)>,
    present: Present,
}

/// Rows of one batch.
#[derive(Clone, Debug)]
pub(super) struct TableRows {
    format: Arc<TableFormat>,
    batch: Arc<Batch>,
    rows: Range<usize>,
}

impl Tables {
    /// Nothing has arrived yet; `path` is the name in messages.
    pub fn new(path: &Path) -> Tables {
        Tables { path: path.to_path_buf(), decoder: ArrowDecoder::new(path), format: None, current: None }
    }

    /// Takes in what has arrived.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.decoder.feed(bytes);
    }

    /// Looks whether the stream may end here.
    pub fn end(&self) -> Result<()> {
        self.decoder.end()
    }

    /// The next rows that have arrived, at most `most`.
    pub fn next_rows(&mut self, most: usize) -> Result<Option<TableRows>> {
        if self.current.is_none() {
            let batch = self.decoder.next_batch()?;
            // The schema is looked at as soon as it is there: a wrong one should not wait for pulses.
            let format = match (&self.format, self.decoder.fields()) {
                (Some(format), _) => format.clone(),
                (None, Some(fields)) => {
                    let format = Arc::new(TableFormat::of(&self.path, fields)?);
                    self.format = Some(format.clone());
                    format
                }
                (None, None) => return Ok(None),
            };
            self.current =
                batch.map(|batch| TableRows { format, rows: 0..batch.rows, batch: Arc::new(batch) });
        }
        let Some(mut taken) = self.current.take() else { return Ok(None) };
        if taken.rows.len() > most {
            let rest = taken.rows.start + most..taken.rows.end;
            self.current = Some(TableRows { rows: rest.clone(), ..taken.clone() });
            taken.rows.end = rest.start;
        }
        Ok(Some(taken))
    }
}

impl TableFormat {
    fn of(path: &Path, fields: &[Field]) -> Result<TableFormat> {
        let mut problems = Diagnostics::default();
        let place = Place::in_line(path, 0, "", 0..0);
        let mut format =
            TableFormat { path: path.to_path_buf(), columns: Vec::new(), present: Present::default() };
        for (position, field) in fields.iter().enumerate() {
            match named(&field.heading) {
                Ok((column, _)) if format.present.has(column) => {
                    problems
                        .error(Some(place.clone()), format!("a second column for {}", column.entry().name));
                }
                Ok(_) if !field.is_number() => {
                    let message =
                        format!("column `{}` holds {}, expected numbers", field.heading, field.holds);
                    problems.error(Some(place.clone()), message);
                }
                Ok((column, factor)) => {
                    format.columns.push((column, factor, position));
                    format.present = format.present.with(column);
                }
                Err((message, help)) => {
                    problems.error(Some(place.clone()), message).help(help);
                }
            }
        }
        if problems.is_empty() {
            check_complete(format.present, place, &mut problems);
        }
        problems.finish(false)?;
        Ok(format)
    }

    fn position(&self, column: Column) -> Option<usize> {
        self.columns.iter().find(|c| c.0 == column).map(|c| c.2)
    }
}

impl TableRows {
    /// Number of rows.
    pub fn count(&self) -> u64 {
        self.rows.len() as u64
    }

    /// Number of the play of the first pulse, without looking at the others.
    pub fn first_play(&self) -> u32 {
        self.format.position(Column::Play).map_or(0, |at| self.play_in(self.rows.start, at))
    }

    fn play_in(&self, row: usize, at: usize) -> u32 {
        // What is no such number is reported when the row is read.
        self.batch.value(at, row) as u32
    }

    /// Cuts the rows where another play begins than that of the first pulse; the second value is the rest.
    pub fn split_at_play(mut self) -> (TableRows, Option<TableRows>) {
        let Some(at) = self.format.position(Column::Play) else { return (self, None) };
        let play = self.first_play();
        let Some(end) = self.rows.clone().find(|row| self.play_in(*row, at) != play) else {
            return (self, None);
        };
        let rest = TableRows { rows: end..self.rows.end, ..self.clone() };
        self.rows.end = end;
        (self, Some(rest))
    }

    /// Turns the rows into pulses in the frame whose origin lies at `shift` in the world. `before` counts those of the
    /// stream before them, and `check` looks at each.
    ///
    /// # Errors
    /// [`Error::Input`] for the first row that is no pulse, with its number.
    pub fn pulses(
        &self,
        shift: DVec3,
        before: u64,
        into: &mut Vec<PulseRow>,
        check: impl Fn(&PulseRow) -> Result<(), (Column, String)>,
    ) -> Result<()> {
        for (order, row) in (before..).zip(self.rows.clone()) {
            let mut values = [0.0; COLUMNS];
            for (column, factor, position) in &self.format.columns {
                values[*column as usize] = self.batch.value(*position, row) * factor;
            }
            let pulse = PulseRow::of(&values, self.format.present, shift, order)
                .map_err(|fault| self.blame(row, &fault.message))?;
            check(&pulse).map_err(|(_, message)| self.blame(row, &message))?;
            into.push(pulse);
        }
        Ok(())
    }

    fn blame(&self, row: usize, message: &str) -> Error {
        table_error(&self.format.path, format!("{}: {message}", self.batch.place(row)), "")
    }
}
