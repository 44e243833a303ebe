//! Parquet: the columns of numbers, row group by row group.

use super::start;
use crate::blocks::{Emit, in_order};
use crate::columnar::ARROW_SCHEMA;
use crate::point_format::build_with;
use crate::{Columns, PointRow, Reading};
use ::arrow_ipc::convert::try_schema_from_ipc_buffer;
use ::parquet::basic::{CompressionCodec, ConvertedType, LogicalType, Type as Physical};
use ::parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use ::parquet::data_type::DataType;
use ::parquet::errors::ParquetError;
use ::parquet::file::metadata::RowGroupMetaData;
use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::schema::types::ColumnDescriptor;
use base64::prelude::{BASE64_STANDARD, Engine};
use bytes::Bytes;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::damage::catch_decoder_panic;
use vlscan_base::diag::ProblemKind;
use vlscan_base::error::{Error, Result};
use vlscan_base::store::FileBytes;
use vlscan_tables::NumberTable;

/// Rows that are read at a time.
const READ_ROWS: usize = if cfg!(test) { 1 << 8 } else { 1 << 14 };

/// Rows of a file.
#[derive(Default)]
struct Block {
    rows: Vec<PointRow>,
    /// The values of the chosen columns, row by row.
    values: Vec<f64>,
    /// Offset behind the row group that ends with the rows.
    end: Option<u64>,
    /// The error behind the rows.
    failure: Option<Error>,
}

/// The row groups of a file.
struct Groups<'a> {
    path: &'a Path,
    reader: &'a SerializedFileReader<Bytes>,
    columns: Columns,
    /// Columns whose values are passed with the points.
    chosen: Vec<usize>,
}

/// Reads a Parquet file, whose row groups are decoded on several threads.
pub(crate) fn read_parquet(file: Bytes, reading: &mut Reading) -> Result<()> {
    let (path, threads) = (reading.path, reading.threads);
    let reader = without_panic(path, || SerializedFileReader::new(file).map_err(|e| unreadable(path, &e)))?;
    let leaves = reader.metadata().file_metadata().schema_descr().columns();
    let names: Vec<&str> = leaves.iter().map(|leaf| if is_number(leaf) { leaf.name() } else { "" }).collect();
    let columns = start(&names, reading)?;
    if reading.sink.takes_columns() {
        reading.pass_metadata(&metadata_of(&reader));
    }
    let groups = Groups { path, reader: &reader, columns, chosen: reading.choose(&names) };
    let make = |group: usize, block: &mut Block, emit: &mut Emit<'_, Block>| {
        block.rows.clear();
        block.values.clear();
        if let Err(failure) = without_panic(path, || groups.read(group, block, emit)) {
            block.rows.clear();
            (block.end, block.failure) = (None, Some(failure));
            let _ = emit(block);
        }
    };
    let mut failure = None;
    in_order(threads, 0..reader.num_row_groups(), make, |block: &mut Block| {
        let mut values = block.values.chunks_exact(groups.chosen.len().max(1));
        block.rows.iter().try_for_each(|row| {
            reading.pass_values(values.next().unwrap_or_default());
            reading.take(row)
        })?;
        if let Some(end) = block.end.take() {
            reading.release_before(usize::try_from(end).unwrap_or(usize::MAX));
        }
        failure = block.failure.take();
        if failure.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    failure.map_or(Ok(()), Err)
}

/// The metadata of the table: that of the file, and that of the schema in Arrow that it contains.
fn metadata_of(reader: &SerializedFileReader<Bytes>) -> BTreeMap<String, String> {
    let pairs = reader.metadata().file_metadata().key_value_metadata().into_iter().flatten();
    let pairs = pairs.filter_map(|pair| Some((pair.key.clone(), pair.value.clone()?)));
    let mut metadata: BTreeMap<String, String> = pairs.collect();
    if let Some(encoded) = metadata.remove(ARROW_SCHEMA)
        && let Ok(bytes) = BASE64_STANDARD.decode(encoded)
    {
        // The points do not need a schema, so a damaged one is left out.
        let schema = catch_decoder_panic(|| try_schema_from_ipc_buffer(&bytes).ok()).flatten();
        metadata.extend(schema.map(|schema| BTreeMap::from(schema.metadata)).unwrap_or_default());
    }
    metadata
}

/// Calls `read` and turns a panic of the library, as some damaged pages cause, into an error.
fn without_panic<T>(path: &Path, read: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_decoder_panic(read)
        .unwrap_or_else(|| Err(Error::input(format!("{}: its pages are damaged", path.display()))))
}

impl Groups<'_> {
    /// Emits the rows of a group.
    fn read(&self, group: usize, block: &mut Block, emit: &mut Emit<'_, Block>) -> Result<()> {
        let path = self.path;
        let failed = |e: ParquetError| unreadable(path, &e);
        let leaves = self.reader.metadata().file_metadata().schema_descr().columns();
        let group = self.reader.get_row_group(group).map_err(failed)?;
        let (mut open, mut end) = (Vec::new(), 0);
        let columns = self.columns.used().map(|(_, column)| column);
        let is_used = |column: &usize| self.columns.used().any(|(_, used)| used == *column);
        let chosen = self.chosen.iter().copied().filter(|column| !is_used(column));
        for column in columns.chain(self.columns.colours().into_iter().flatten()).chain(chosen) {
            check_compression(group.metadata(), column, path)?;
            let (start, length) = group.metadata().column(column).byte_range();
            end = start.saturating_add(length).max(end);
            open.push((column, group.get_column_reader(column).map_err(failed)?));
        }
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); leaves.len()];
        let mut left = row_count(group.metadata()).map_err(failed)?;
        while left > 0 {
            let rows = left.min(READ_ROWS);
            for (column, reader) in &mut open {
                values[*column] = read_numbers(reader, &leaves[*column], rows).map_err(failed)?;
            }
            let complete = open.iter().all(|(column, _)| values[*column].len() == rows);
            if !complete {
                return Err(failed(ParquetError::EOF("a column ends before the others".into())));
            }
            block.rows.extend((0..rows).map(|row| self.columns.row(|column| values[column][row])));
            let of_row = |row: usize| self.chosen.iter().map(move |column| (*column, row));
            block.values.extend((0..rows).flat_map(of_row).map(|(column, row)| values[column][row]));
            block.end = (rows == left).then_some(end);
            let flow = emit(block);
            block.rows.clear();
            block.values.clear();
            if flow.is_break() {
                return Ok(());
            }
            left -= rows;
        }
        Ok(())
    }
}

/// The columns of numbers of a Parquet file for whose names `is_read` is true, NaN for nulls. Other columns
/// are named in the result.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Input`] for files that are not Parquet or are
/// damaged, and for compressions that this build does not read.
pub fn read_number_columns(path: &Path, is_read: &dyn Fn(&str) -> bool) -> Result<NumberTable> {
    let file = FileBytes::open(path).map_err(|e| Error::open(path, e))?;
    let damaged = || unreadable(path, &ParquetError::General("its pages are damaged".into()));
    let table = catch_decoder_panic(|| number_columns(Bytes::from_owner(file.clone()), path, is_read))
        .unwrap_or_else(|| Err(damaged()))?;
    file.check_unchanged().map_err(|e| Error::io("read", path, e))?;
    Ok(table)
}

fn number_columns(file: Bytes, path: &Path, is_read: &dyn Fn(&str) -> bool) -> Result<NumberTable> {
    let failed = |e: ParquetError| unreadable(path, &e);
    let reader = SerializedFileReader::new(file).map_err(failed)?;
    let leaves = reader.metadata().file_metadata().schema_descr().columns();
    let mut table = NumberTable::default();
    let mut places = Vec::new();
    for (at, leaf) in leaves.iter().enumerate() {
        match is_number(leaf) && is_read(leaf.name()) {
            true => {
                places.push(at);
                table.columns.push((leaf.name().to_owned(), Vec::new()));
            }
            false => table.unread.push(leaf.path().string()),
        }
    }
    for group in 0..reader.num_row_groups() {
        let group = reader.get_row_group(group).map_err(failed)?;
        let rows = row_count(group.metadata()).map_err(failed)?;
        for (at, (_, column)) in places.iter().zip(&mut table.columns) {
            check_compression(group.metadata(), *at, path)?;
            let (mut reader, mut left) = (group.get_column_reader(*at).map_err(failed)?, rows);
            while left > 0 {
                let values = read_numbers(&mut reader, &leaves[*at], left.min(READ_ROWS)).map_err(failed)?;
                if values.is_empty() {
                    return Err(failed(ParquetError::EOF("a column ends before the others".into())));
                }
                left = left.saturating_sub(values.len());
                column.extend(values);
            }
        }
    }
    Ok(table)
}

/// Number of rows of a group.
fn row_count(group: &RowGroupMetaData) -> ::parquet::errors::Result<usize> {
    let rows = group.num_rows();
    usize::try_from(rows).map_err(|_| ParquetError::General(format!("a row group of {rows} rows")))
}

/// The error for a file that the library cannot read.
fn unreadable(path: &Path, error: &ParquetError) -> Error {
    let kind = match error {
        ParquetError::EOF(_) => ProblemKind::Truncated,
        ParquetError::NYI(_) => ProblemKind::Unsupported,
        _ => ProblemKind::Invalid,
    };
    Error::input_of(kind, format!("{} is not a Parquet file that can be read: {error}", path.display()))
}

/// Checks that this build reads the compression of a column.
fn check_compression(group: &RowGroupMetaData, column: usize, path: &Path) -> Result<()> {
    let column = group.column(column);
    let compression = column.compression_codec();
    let rewrite = "write the file with Snappy compression (in Polars, compression=\"snappy\")";
    let help = match compression {
        CompressionCodec::UNCOMPRESSED | CompressionCodec::SNAPPY => return Ok(()),
        CompressionCodec::ZSTD if cfg!(feature = "parquet-zstd") => return Ok(()),
        CompressionCodec::ZSTD => format!("{}, or {rewrite}", build_with("parquet-zstd")),
        _ => rewrite.to_owned(),
    };
    let message = format!(
        "{}: column {} is compressed with {compression}, which this build does not read",
        path.display(),
        column.column_path().string()
    );
    Err(Error::unsupported(message, help))
}

/// True if a column holds one number per row; dates, times, decimals and members of nested columns are none.
fn is_number(leaf: &ColumnDescriptor) -> bool {
    let plain = matches!(leaf.logical_type_ref(), None | Some(LogicalType::Integer(_)));
    leaf.path().parts().len() == 1
        && leaf.max_rep_level() == 0
        && leaf.converted_type() != ConvertedType::DECIMAL
        && plain
        && matches!(
            leaf.physical_type(),
            Physical::INT32 | Physical::INT64 | Physical::FLOAT | Physical::DOUBLE
        )
}

/// Reads the next `rows` values of a column, NaN for nulls.
fn read_numbers(
    reader: &mut ColumnReader,
    leaf: &ColumnDescriptor,
    rows: usize,
) -> std::result::Result<Vec<f64>, ParquetError> {
    let unsigned = matches!(leaf.logical_type_ref(), Some(LogicalType::Integer(kind)) if !kind.is_signed);
    match reader {
        // Unsigned integers are stored as the signed ones of the same bits (Parquet, "Logical types").
        ColumnReader::Int32ColumnReader(reader) => {
            read_values(reader, leaf, rows, |v| if unsigned { f64::from(v as u32) } else { f64::from(v) })
        }
        ColumnReader::Int64ColumnReader(reader) => {
            read_values(reader, leaf, rows, |v| if unsigned { v as u64 as f64 } else { v as f64 })
        }
        ColumnReader::FloatColumnReader(reader) => read_values(reader, leaf, rows, f64::from),
        ColumnReader::DoubleColumnReader(reader) => read_values(reader, leaf, rows, |v| v),
        _ => Err(ParquetError::General(format!("column {} has an unsupported kind of numbers", leaf.name()))),
    }
}

fn read_values<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    leaf: &ColumnDescriptor,
    rows: usize,
    number: impl Fn(T::T) -> f64,
) -> std::result::Result<Vec<f64>, ParquetError> {
    let (mut present, mut values) = (Vec::new(), Vec::new());
    let (records, ..) = reader.read_records(rows, Some(&mut present), None, &mut values)?;
    let mut values = values.into_iter().map(number);
    let nullable = leaf.max_def_level() > 0;
    let is_present =
        |row: usize| !nullable || present.get(row).is_some_and(|&level| level == leaf.max_def_level());
    Ok((0..records)
        .map(|row| if is_present(row) { values.next().unwrap_or(f64::NAN) } else { f64::NAN })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GZIP: &[u8] = include_bytes!("gzip.parquet");
    const ZSTD: &[u8] = include_bytes!("zstd.parquet");

    /// Columns X and Z of a file, or the message.
    fn columns(bytes: &[u8]) -> std::result::Result<NumberTable, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.parquet");
        std::fs::write(&path, bytes).unwrap();
        read_number_columns(&path, &|name| ["X", "Z"].contains(&name)).map_err(|e| match e {
            Error::Input(problems) => problems.text(),
            other => other.to_string(),
        })
    }

    #[test]
    fn zstd_pages_are_read_or_the_message_names_the_feature() {
        let read = columns(ZSTD);
        if cfg!(feature = "parquet-zstd") {
            let table = read.unwrap();
            let expected = [("X", [1.0, 2.0, 3.0]), ("Z", [7.0, 8.0, 9.0])];
            assert_eq!(table.columns, expected.map(|(name, values)| (name.to_owned(), values.to_vec())));
            assert_eq!(table.unread, ["Y"]);
        } else {
            let said = read.unwrap_err();
            assert!(said.contains("column X is compressed with ZSTD"), "{said}");
            assert!(said.contains("feature parquet-zstd"), "{said}");
        }
    }

    #[test]
    fn other_compressions_are_named_with_one_that_is_read() {
        let said = columns(GZIP).unwrap_err();
        assert!(said.contains("t.parquet: column X is compressed with GZIP"), "{said}");
        assert!(said.contains("Snappy") && !said.contains("feature"), "{said}");
    }

    /// A file of row groups with these numbers of points.
    fn grouped(counts: &[usize]) -> Vec<u8> {
        use ::parquet::basic::Repetition;
        use ::parquet::data_type::DoubleType;
        use ::parquet::file::properties::WriterProperties;
        use ::parquet::file::writer::SerializedFileWriter;
        use ::parquet::schema::types::Type;
        use std::sync::Arc;
        let field = |name: &str| {
            let field = Type::primitive_type_builder(name, Physical::DOUBLE);
            Arc::new(field.with_repetition(Repetition::REQUIRED).build().unwrap())
        };
        let fields = ["X", "Y", "Z"].map(field).to_vec();
        let root = Arc::new(Type::group_type_builder("points").with_fields(fields).build().unwrap());
        let properties = Arc::new(WriterProperties::builder().build());
        let mut file = SerializedFileWriter::new(Vec::new(), root, properties).unwrap();
        for count in counts {
            let values: Vec<f64> = (0..*count).map(|i| 0.7 * i as f64 + *count as f64).collect();
            let mut group = file.next_row_group().unwrap();
            while let Some(mut column) = group.next_column().unwrap() {
                column.typed::<DoubleType>().write_batch(&values, None, None).unwrap();
                column.close().unwrap();
            }
            group.close().unwrap();
        }
        file.into_inner().unwrap()
    }

    /// The x of the points of a file read on some threads, and the message of the error, if any.
    fn read_on(bytes: &[u8], threads: usize) -> (Vec<u64>, String) {
        struct X(Vec<u64>);
        impl crate::PointSink for X {
            fn start(&mut self, _: crate::AttributeSet) {}
            fn point(&mut self, row: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
                self.0.push(row.position.x.to_bits());
                Ok(ControlFlow::Continue(()))
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.parquet");
        std::fs::write(&path, bytes).unwrap();
        let mut sink = X(Vec::new());
        let read = crate::read_points_on(&path, threads, &mut sink);
        let name = path.display().to_string();
        (sink.0, read.map_or_else(|e| e.to_string().replace(&name, "t.parquet"), |_| String::new()))
    }

    #[test]
    fn points_and_errors_do_not_depend_on_the_number_of_threads() {
        let counts = [1000, 1, 700, 300, 500];
        let whole = grouped(&counts);
        let (points, said) = read_on(&whole, 1);
        assert_eq!((points.len(), said.as_str()), (counts.iter().sum::<usize>(), ""));
        let mut errors = 0;
        for at in std::iter::once(None).chain((4..whole.len()).step_by(whole.len() / 30).map(Some)) {
            let mut bytes = whole.clone();
            if let Some(at) = at {
                bytes[at..].iter_mut().take(64).for_each(|byte| *byte ^= 0x55);
            }
            let expected = read_on(&bytes, 1);
            errors += usize::from(!expected.1.is_empty());
            for threads in [2, 5] {
                assert!(read_on(&bytes, threads) == expected, "{threads} threads, damage at {at:?}");
            }
        }
        assert!(errors > 0);
    }
}
