//! Pulses as rows of an Arrow stream.

use super::columns::PulseColumn;
use super::row::{PulseRow, RowFault};
use super::schema::StreamSchema;
use std::convert::Infallible;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::diag::Place;
use vlscan_base::error::Result;
use vlscan_base::input::arrow::{ArrowDecoder, NumberBatch, table_error};
use vlscan_geom::DVec3;

/// Decodes a stream and splits its batches into blocks with a limited number of rows.
#[derive(Debug)]
pub(super) struct BatchReader {
    path: PathBuf,
    decoder: ArrowDecoder,
    schema: Option<Arc<StreamSchema>>,
    /// Rows of the last batch that have not been returned.
    current: Option<TableRows>,
}

#[derive(Clone, Debug)]
pub(super) struct TableRows {
    schema: Arc<StreamSchema>,
    batch: Arc<NumberBatch>,
    rows: Range<usize>,
}

impl BatchReader {
    /// A reader without bytes; `path` is the name in messages.
    pub fn new(path: &Path) -> BatchReader {
        BatchReader {
            path: path.to_path_buf(),
            decoder: ArrowDecoder::new(path),
            schema: None,
            current: None,
        }
    }

    pub fn feed(&mut self, bytes: &[u8]) {
        self.decoder.feed(bytes);
    }

    /// Checks that the stream may end here.
    pub fn end(&self) -> Result<()> {
        self.decoder.end()
    }

    /// The next rows that have arrived, at most `max_rows`.
    pub fn next_rows(&mut self, max_rows: usize) -> Result<Option<TableRows>> {
        if self.current.is_none() {
            let batch = self.decoder.next_batch()?;
            // The schema is checked as soon as it has arrived, even before the first batch.
            let schema = match (&self.schema, self.decoder.fields()) {
                (Some(schema), _) => schema.clone(),
                (None, Some(fields)) => {
                    let place = Place::in_line(&self.path, 0, "", 0..0);
                    let headings = fields.iter().map(|field| {
                        (&*field.heading, place.clone(), Some(field.holds).filter(|_| !field.is_number()))
                    });
                    let schema = Arc::new(StreamSchema::from_headings(&self.path, headings, place.clone())?);
                    self.schema.insert(schema).clone()
                }
                (None, None) => return Ok(None),
            };
            self.current =
                batch.map(|batch| TableRows { schema, rows: 0..batch.rows, batch: Arc::new(batch) });
        }
        let Some(mut taken) = self.current.take() else { return Ok(None) };
        if taken.rows.len() > max_rows {
            let rest = taken.rows.start + max_rows..taken.rows.end;
            self.current = Some(TableRows { rows: rest.clone(), ..taken.clone() });
            taken.rows.end = rest.start;
        }
        Ok(Some(taken))
    }
}

impl TableRows {
    pub fn count(&self) -> u64 {
        self.rows.len() as u64
    }

    /// Epoch of the first pulse; the other rows are not read.
    pub fn first_epoch(&self) -> u32 {
        self.schema.position(PulseColumn::Epoch).map_or(0, |at| self.epoch_of(self.rows.start, at))
    }

    fn epoch_of(&self, row: usize, at: usize) -> u32 {
        // An invalid number is reported when the row is read.
        self.batch.value(at, row) as u32
    }

    /// Splits the rows before the first pulse of another epoch; the second value is the rest.
    pub fn split_at_epoch(mut self) -> (TableRows, Option<TableRows>) {
        let Some(at) = self.schema.position(PulseColumn::Epoch) else { return (self, None) };
        let epoch = self.first_epoch();
        let Some(end) = self.rows.clone().find(|row| self.epoch_of(*row, at) != epoch) else {
            return (self, None);
        };
        let rest = TableRows { rows: end..self.rows.end, ..self.clone() };
        self.rows.end = end;
        (self, Some(rest))
    }

    /// Appends the rows as pulses in the frame whose origin is at `shift` in the world. `before` is the number of
    /// rows in the stream before this block; `check` accepts or refuses each pulse.
    ///
    /// # Errors
    /// [`Error::Input`](vlscan_base::error::Error::Input) for the first row that is not a valid pulse, with its number.
    pub fn pulses(
        &self,
        shift: DVec3,
        before: u64,
        into: &mut Vec<PulseRow>,
        check: impl Fn(&PulseRow) -> Result<(), RowFault>,
    ) -> Result<()> {
        for (order, row) in (before..).zip(self.rows.clone()) {
            let Ok(values) = self.schema.values(|_, at| Ok::<_, Infallible>(self.batch.value(at, row)));
            self.schema.push_pulse(&values, shift, order, into, &check).map_err(|(_, message)| {
                table_error(&self.schema.path, format!("{}: {message}", self.batch.place(row)), "")
            })?;
        }
        Ok(())
    }
}
