//! Rows collected column by column into groups of fixed size, so that the bytes of a file do not depend on how its rows
//! arrived.

use super::columns::{Kind, slices};
use ::arrow_buffer::MutableBuffer;
use std::ops::Range;
use vlscan_base::error::Result;

/// Rows per batch of an Arrow stream: a few megabytes.
pub(super) const BATCH_ROWS: usize = 16_384;

/// The rows of one group, at most `full` of them. A group may hold all rows of a run, so columns grow as vectors do.
pub(super) struct Rows {
    kinds: Vec<Kind>,
    values: Vec<MutableBuffer>,
    rows: usize,
    full: usize,
}

impl Rows {
    pub fn new(kinds: Vec<Kind>, full: usize) -> Rows {
        let values = kinds.iter().map(|_| MutableBuffer::new(0)).collect();
        Rows { kinds, values, rows: 0, full: full.max(1) }
    }

    pub fn len(&self) -> usize {
        self.rows
    }

    /// Appends a block of columns, all values of the first column first, and calls `full` for every complete group, which it has to [`take`](Rows::take).
    pub fn append(&mut self, block: &[u8], mut full: impl FnMut(&mut Rows) -> Result<()>) -> Result<()> {
        let (mut from, end) = (0, self.in_block(block));
        while from < end {
            from = self.append_rows(block, from..end);
            if self.is_full() {
                full(self)?;
            }
        }
        Ok(())
    }

    /// Appends rows of a block until the group is complete. Returns the first row that was not appended.
    pub fn append_rows(&mut self, block: &[u8], rows: Range<usize>) -> usize {
        let count = rows.len().min(self.full - self.rows);
        let columns = slices(self.kinds.iter().copied(), self.in_block(block), block);
        for ((kind, values), bytes) in self.kinds.iter().zip(&mut self.values).zip(columns) {
            let width = kind.width();
            values.extend_from_slice(&bytes[rows.start * width..(rows.start + count) * width]);
        }
        self.rows += count;
        rows.start + count
    }

    /// Number of rows of a block.
    pub fn in_block(&self, block: &[u8]) -> usize {
        let width: usize = self.kinds.iter().map(|kind| kind.width()).sum();
        block.len() / width.max(1)
    }

    /// The values of a column of a block.
    pub fn column<'b>(&self, block: &'b [u8], column: usize) -> &'b [u8] {
        slices(self.kinds.iter().copied(), self.in_block(block), block).nth(column).unwrap_or_default()
    }

    /// Whether the group is complete.
    pub fn is_full(&self) -> bool {
        self.rows == self.full
    }

    /// Takes the columns with their values in the machine's byte order, and begins a new group.
    pub fn take(&mut self) -> impl Iterator<Item = (Kind, MutableBuffer)> {
        self.rows = 0;
        let values = self.values.iter_mut().map(|values| std::mem::replace(values, MutableBuffer::new(0)));
        self.kinds.iter().copied().zip(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::arrow::{batch, data_type};
    use ::arrow_array::{RecordBatch, cast::AsArray, types::*};
    use ::arrow_schema::{Field, Schema};
    use std::sync::Arc;

    fn block(from: u32, rows: u32) -> Vec<u8> {
        let mut bytes: Vec<u8> =
            (from..from + rows).flat_map(|i| (f64::from(i) / 8.0).to_le_bytes()).collect();
        bytes.extend((from..from + rows).map(|i| i as u8));
        bytes
    }

    fn collected(blocks: &[u32], max_rows: usize) -> Vec<RecordBatch> {
        let kinds = vec![Kind::F64, Kind::U8];
        let fields: Vec<Field> = kinds.iter().map(|kind| Field::new("c", data_type(*kind), false)).collect();
        let (schema, mut rows) = (Arc::new(Schema::new(fields)), Rows::new(kinds, max_rows));
        let (mut batches, mut from) = (Vec::new(), 0);
        for &count in blocks {
            rows.append(&block(from, count), |rows| {
                batches.push(batch(rows, &schema)?);
                Ok(())
            })
            .unwrap();
            from += count;
        }
        batches.push(batch(&mut rows, &schema).unwrap());
        batches
    }

    #[test]
    fn batches_do_not_depend_on_the_blocks() {
        assert_eq!(collected(&[3, 0, 7, 2], 5), collected(&[12], 5));
        let sizes: Vec<usize> = collected(&[12], 5).iter().map(RecordBatch::num_rows).collect();
        assert_eq!(sizes, [5, 5, 2]);
        let whole = collected(&[1, 2, 300], usize::MAX).remove(0);
        assert_eq!(whole.column(0).as_primitive::<Float64Type>().value(302), 302.0 / 8.0);
        assert_eq!(whole.column(1).as_primitive::<UInt8Type>().value(302), 46);
    }
}
