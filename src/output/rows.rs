//! Rows collected column by column into groups of fixed size, so that the bytes of a file do not depend on how its rows
//! arrived.

use super::columns::{Column, slices};
use crate::error::Result;
use ::arrow_buffer::MutableBuffer;

/// Rows per batch of an Arrow stream: a few megabytes.
pub(super) const BATCH_ROWS: usize = 16_384;

/// The rows of one group, at most `full` of them.
pub(super) struct Rows {
    columns: Vec<Column>,
    values: Vec<MutableBuffer>,
    rows: usize,
    full: usize,
}

impl Rows {
    pub fn new(columns: &[Column], full: usize) -> Rows {
        let values = columns.iter().map(|_| MutableBuffer::new(0)).collect();
        Rows { columns: columns.to_vec(), values, rows: 0, full }
    }

    pub fn len(&self) -> usize {
        self.rows
    }

    /// Appends a block written by [`ColumnCodec::push`](super::column_codec::ColumnCodec::push) and calls `full` for every
    /// complete group, which it has to [`take`](Rows::take).
    pub fn append(&mut self, block: &[u8], mut full: impl FnMut(&mut Rows) -> Result<()>) -> Result<()> {
        let width: usize = self.columns.iter().map(|c| c.kind().width()).sum();
        let rows = block.len() / width.max(1);
        let mut from = 0;
        while from < rows {
            let now = (rows - from).min(self.full - self.rows);
            for ((column, values), bytes) in
                self.columns.iter().zip(&mut self.values).zip(slices(&self.columns, rows, block))
            {
                let width = column.kind().width();
                values.extend_from_slice(&bytes[from * width..(from + now) * width]);
            }
            (from, self.rows) = (from + now, self.rows + now);
            if self.rows == self.full {
                full(self)?;
            }
        }
        Ok(())
    }

    /// Takes the columns with their values in the machine's byte order, and begins a new group.
    pub fn take(&mut self) -> impl Iterator<Item = (Column, MutableBuffer)> {
        self.rows = 0;
        let values = self.values.iter_mut().map(|values| std::mem::replace(values, MutableBuffer::new(0)));
        self.columns.iter().copied().zip(values)
    }
}
