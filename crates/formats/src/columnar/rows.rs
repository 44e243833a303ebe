//! Rows collected column by column into groups of fixed size, so that the bytes of a file do not depend on
//! how its rows arrived.

use super::ColumnType;
use ::arrow_array::{ArrayRef, PrimitiveArray, RecordBatch, types::*};
use ::arrow_buffer::{Buffer, MutableBuffer, ScalarBuffer};
use ::arrow_schema::SchemaRef;
use std::ops::Range;
use std::sync::Arc;
use vlscan_base::error::{Error, Result};

/// Rows per batch of an Arrow stream: a few megabytes.
pub(super) const BATCH_ROWS: usize = 16_384;

/// The rows of one group, at most `full` of them. A group may hold all rows of a run, so columns grow as
/// vectors do.
pub struct Rows {
    kinds: Vec<ColumnType>,
    values: Vec<MutableBuffer>,
    rows: usize,
    full: usize,
}

/// Takes the number of rows of the block at the beginning of `bytes`.
pub fn block_rows(bytes: &mut &[u8]) -> Option<usize> {
    let (rows, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(u32::from_le_bytes(*rows) as usize)
}

/// Takes the columns of a block with this many rows from the beginning of `bytes`.
pub fn slices<'b>(
    kinds: impl Iterator<Item = ColumnType>,
    rows: usize,
    bytes: &mut &'b [u8],
) -> Vec<&'b [u8]> {
    kinds
        .map(|kind| {
            let (column, rest) = bytes.split_at((kind.width() * rows).min(bytes.len()));
            *bytes = rest;
            column
        })
        .collect()
}

impl Rows {
    /// No rows yet, of columns of these kinds; `full` is the number of rows of a complete group.
    pub fn new(kinds: Vec<ColumnType>, full: usize) -> Rows {
        let values = kinds.iter().map(|_| MutableBuffer::new(0)).collect();
        Rows { kinds, values, rows: 0, full: full.max(1) }
    }

    /// Number of rows collected.
    pub fn len(&self) -> usize {
        self.rows
    }

    /// True if no rows are collected.
    pub fn is_empty(&self) -> bool {
        self.rows == 0
    }

    /// Takes a block from the beginning of `bytes`: its columns and the number of its rows.
    pub fn take_block<'b>(&self, bytes: &mut &'b [u8]) -> Option<(Vec<&'b [u8]>, usize)> {
        let rows = block_rows(bytes)?;
        Some((slices(self.kinds.iter().copied(), rows, bytes), rows))
    }

    /// Appends all blocks of `bytes` and calls `full` for every complete group, which it has to take.
    pub(super) fn append(
        &mut self,
        mut bytes: &[u8],
        mut full: impl FnMut(&mut Rows) -> Result<()>,
    ) -> Result<()> {
        while let Some((columns, end)) = self.take_block(&mut bytes) {
            let mut from = 0;
            while from < end {
                from = self.append_rows(&columns, from..end);
                if self.is_full() {
                    full(self)?;
                }
            }
        }
        Ok(())
    }

    /// Appends rows of a block until the group is complete. Returns the first row that was not appended.
    pub fn append_rows(&mut self, columns: &[&[u8]], rows: Range<usize>) -> usize {
        let count = rows.len().min(self.full - self.rows);
        for ((kind, values), bytes) in self.kinds.iter().zip(&mut self.values).zip(columns) {
            let width = kind.width();
            values.extend_from_slice(&bytes[rows.start * width..(rows.start + count) * width]);
        }
        self.rows += count;
        rows.start + count
    }

    /// True if the group is complete.
    pub fn is_full(&self) -> bool {
        self.rows == self.full
    }

    /// Takes the columns with their values in the machine's byte order, and begins a new group.
    pub(super) fn take(&mut self) -> impl Iterator<Item = (ColumnType, MutableBuffer)> {
        self.rows = 0;
        let values = self.values.iter_mut().map(|values| std::mem::replace(values, MutableBuffer::new(0)));
        self.kinds.iter().copied().zip(values)
    }

    /// Takes the collected rows as a batch.
    ///
    /// # Errors
    /// [`Error::Internal`] for a schema of other columns.
    pub fn batch(&mut self, schema: &SchemaRef) -> Result<RecordBatch> {
        let count = self.rows;
        let columns = self.take().map(|(kind, values)| array(kind, values.into(), count));
        RecordBatch::try_new(schema.clone(), columns.collect())
            .map_err(|e| Error::Internal(format!("Arrow: {e}")))
    }
}

fn array(kind: ColumnType, values: Buffer, rows: usize) -> ArrayRef {
    fn typed<T: ArrowPrimitiveType>(values: Buffer, rows: usize) -> ArrayRef {
        Arc::new(PrimitiveArray::<T>::new(ScalarBuffer::new(values, 0, rows), None))
    }
    match kind {
        ColumnType::U8 => typed::<UInt8Type>(values, rows),
        ColumnType::U16 => typed::<UInt16Type>(values, rows),
        ColumnType::U32 => typed::<UInt32Type>(values, rows),
        ColumnType::U64 => typed::<UInt64Type>(values, rows),
        ColumnType::I32 => typed::<Int32Type>(values, rows),
        ColumnType::F32 => typed::<Float32Type>(values, rows),
        ColumnType::F64 => typed::<Float64Type>(values, rows),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::arrow_array::cast::AsArray;
    use ::arrow_schema::{Field, Schema};
    use std::sync::Arc;

    fn block(from: u32, rows: u32) -> Vec<u8> {
        let mut bytes = rows.to_le_bytes().to_vec();
        bytes.extend((from..from + rows).flat_map(|i| (f64::from(i) / 8.0).to_le_bytes()));
        bytes.extend((from..from + rows).map(|i| i as u8));
        bytes
    }

    fn collected(blocks: &[u32], max_rows: usize) -> Vec<RecordBatch> {
        let kinds = vec![ColumnType::F64, ColumnType::U8];
        let fields: Vec<Field> = kinds.iter().map(|kind| Field::new("c", kind.data_type(), false)).collect();
        let (schema, mut rows) = (Arc::new(Schema::new(fields)), Rows::new(kinds, max_rows));
        let (mut batches, mut from) = (Vec::new(), 0);
        for &count in blocks {
            rows.append(&block(from, count), |rows| {
                batches.push(rows.batch(&schema)?);
                Ok(())
            })
            .unwrap();
            from += count;
        }
        batches.push(rows.batch(&schema).unwrap());
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
