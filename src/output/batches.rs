//! Rows of a table in memory, collected from blocks of columns into Arrow record batches. A batch may hold all rows of a run, so
//! columns grow as vectors do.

use super::columns::Kind;
use crate::error::{Error, Result};
use ::arrow_array::{ArrayRef, PrimitiveArray, RecordBatch, types::*};
use ::arrow_schema::SchemaRef;
use std::sync::Arc;

/// Maximum number of rows for which memory is reserved before they arrive.
const MAX_RESERVED_ROWS: usize = 1 << 20;

/// Collects rows into batches of a fixed number of rows, so that the batches do not depend on how the rows arrived.
pub(super) struct Batches {
    kinds: Vec<Kind>,
    schema: SchemaRef,
    values: Vec<Values>,
    rows: usize,
    max_rows: usize,
}

impl Batches {
    /// Batches have `max_rows` rows, the last one the remaining ones.
    pub fn new(kinds: Vec<Kind>, schema: SchemaRef, max_rows: usize) -> Batches {
        let values = kinds.iter().map(|kind| Values::new(*kind)).collect();
        Batches { kinds, schema, values, rows: 0, max_rows: max_rows.max(1) }
    }

    /// Number of collected rows.
    pub fn len(&self) -> usize {
        self.rows
    }

    /// Appends a block of columns, all values of the first column first, and passes every complete batch to `full`.
    pub fn append(&mut self, block: &[u8], mut full: impl FnMut(RecordBatch) -> Result<()>) -> Result<()> {
        let width: usize = self.kinds.iter().map(|kind| kind.width()).sum();
        let rows = block.len() / width.max(1);
        let mut from = 0;
        while from < rows {
            let now = (rows - from).min(self.max_rows - self.rows);
            let mut column = 0;
            for (kind, values) in self.kinds.iter().zip(&mut self.values) {
                let bytes = &block[column..column + kind.width() * rows];
                column += bytes.len();
                if self.rows == 0 && self.max_rows <= MAX_RESERVED_ROWS {
                    values.reserve(self.max_rows);
                }
                values.extend(&bytes[from * kind.width()..(from + now) * kind.width()]);
            }
            (from, self.rows) = (from + now, self.rows + now);
            if self.rows == self.max_rows {
                full(self.batch()?)?;
            }
        }
        Ok(())
    }

    /// Returns the collected rows as a batch, and clears them.
    pub fn batch(&mut self) -> Result<RecordBatch> {
        self.rows = 0;
        let columns = self.values.iter_mut().map(Values::take).collect();
        RecordBatch::try_new(self.schema.clone(), columns).map_err(|e| Error::Internal(format!("Arrow: {e}")))
    }
}

macro_rules! kinds {
    ($($kind:ident $number:ident $arrow:ident;)*) => {
        /// Values of a column.
        enum Values {
            $($kind(Vec<$number>),)*
        }

        impl Values {
            fn new(kind: Kind) -> Values {
                match kind { $(Kind::$kind => Values::$kind(Vec::new()),)* }
            }

            fn reserve(&mut self, rows: usize) {
                match self { $(Values::$kind(values) => values.reserve_exact(rows),)* }
            }

            /// Appends little-endian values.
            fn extend(&mut self, bytes: &[u8]) {
                match self {
                    $(Values::$kind(values) => {
                        let (numbers, _) = bytes.as_chunks();
                        values.extend(numbers.iter().map(|&number| $number::from_le_bytes(number)));
                    })*
                }
            }

            /// Returns the values as an array, and clears them.
            fn take(&mut self) -> ArrayRef {
                match self {
                    $(Values::$kind(values) => {
                        Arc::new(PrimitiveArray::<$arrow>::new(std::mem::take(values).into(), None))
                    })*
                }
            }
        }
    };
}

kinds! {
    U8 u8 UInt8Type;
    U16 u16 UInt16Type;
    U32 u32 UInt32Type;
    U64 u64 UInt64Type;
    I32 i32 Int32Type;
    F32 f32 Float32Type;
    F64 f64 Float64Type;
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::arrow_array::cast::AsArray;
    use ::arrow_schema::{DataType, Field, Schema};

    fn block(from: u32, rows: u32) -> Vec<u8> {
        let mut bytes: Vec<u8> =
            (from..from + rows).flat_map(|i| (f64::from(i) / 8.0).to_le_bytes()).collect();
        bytes.extend((from..from + rows).map(|i| i as u8));
        bytes
    }

    fn collected(blocks: &[u32], max_rows: usize) -> Vec<RecordBatch> {
        let fields = vec![Field::new("x", DataType::Float64, false), Field::new("n", DataType::UInt8, false)];
        let mut rows = Batches::new(vec![Kind::F64, Kind::U8], Arc::new(Schema::new(fields)), max_rows);
        let (mut batches, mut from) = (Vec::new(), 0);
        for &count in blocks {
            rows.append(&block(from, count), |batch| {
                batches.push(batch);
                Ok(())
            })
            .unwrap();
            from += count;
        }
        batches.push(rows.batch().unwrap());
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
