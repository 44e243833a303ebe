//! Parquet: the columns of numbers, row group by row group.

use super::{start, take_rows};
use crate::Reading;
use ::parquet::basic::{ConvertedType, LogicalType, Type as Physical};
use ::parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use ::parquet::data_type::DataType;
use ::parquet::errors::ParquetError;
use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::schema::types::ColumnDescriptor;
use bytes::Bytes;
use std::path::Path;
use vlscan_base::damage::catch_decoder_panic;
use vlscan_base::error::{Error, Result};
use vlscan_base::store::FileBytes;

/// Rows that are read at a time.
const READ_ROWS: usize = 65_536;

/// Reads a Parquet file; its library panics on some damaged pages.
pub(crate) fn read_parquet(file: Bytes, reading: &mut Reading) -> Result<()> {
    let path = reading.path;
    catch_decoder_panic(|| read_row_groups(file, reading))
        .unwrap_or_else(|| Err(Error::input(format!("{}: its pages are damaged", path.display()))))
}

fn read_row_groups(file: Bytes, reading: &mut Reading) -> Result<()> {
    let path = reading.path;
    let failed = |e: ParquetError| {
        Error::input(format!("{} is not a Parquet file that can be read: {e}", path.display()))
    };
    let reader = SerializedFileReader::new(file).map_err(failed)?;
    let leaves = reader.metadata().file_metadata().schema_descr().columns();
    let names: Vec<&str> = leaves.iter().map(|leaf| if is_number(leaf) { leaf.name() } else { "" }).collect();
    let columns = start(&names, reading)?;
    for group in 0..reader.num_row_groups() {
        let group = reader.get_row_group(group).map_err(failed)?;
        let mut open = Vec::new();
        for (_, column) in columns.used() {
            open.push((column, group.get_column_reader(column).map_err(failed)?));
        }
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); leaves.len()];
        let mut left = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
        while left > 0 {
            let rows = left.min(READ_ROWS);
            for (column, reader) in &mut open {
                values[*column] = read_numbers(reader, &leaves[*column], rows).map_err(failed)?;
            }
            let complete = open.iter().all(|(column, _)| values[*column].len() == rows);
            if !complete {
                return Err(failed(ParquetError::EOF("a column ends before the others".into())));
            }
            if take_rows(&columns, &values, rows, reading).is_break() {
                return Ok(());
            }
            left -= rows;
        }
    }
    Ok(())
}

/// The columns of numbers with these names of a Parquet file, NaN for nulls; `None` for names that it does
/// not have.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Input`] for files that are not Parquet or are
/// damaged.
pub fn read_number_columns(path: &Path, names: &[&str]) -> Result<Vec<Option<Vec<f64>>>> {
    let file = FileBytes::open(path).map_err(|e| Error::open(path, e))?;
    let read = || number_columns(Bytes::from_owner(file.clone()), names);
    let failed = |e: ParquetError| {
        Error::input(format!("{} is not a Parquet file that can be read: {e}", path.display()))
    };
    let columns = catch_decoder_panic(read)
        .unwrap_or_else(|| Err(ParquetError::General("its pages are damaged".into())))
        .map_err(failed)?;
    file.check_unchanged().map_err(|e| Error::io("read", path, e))?;
    Ok(columns)
}

fn number_columns(file: Bytes, names: &[&str]) -> std::result::Result<Vec<Option<Vec<f64>>>, ParquetError> {
    let reader = SerializedFileReader::new(file)?;
    let leaves = reader.metadata().file_metadata().schema_descr().columns();
    let found = |name: &&str| leaves.iter().position(|leaf| is_number(leaf) && leaf.name() == *name);
    let at: Vec<Option<usize>> = names.iter().map(found).collect();
    let mut columns: Vec<Option<Vec<f64>>> = at.iter().map(|at| at.map(|_| Vec::new())).collect();
    for group in 0..reader.num_row_groups() {
        let group = reader.get_row_group(group)?;
        let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
        for (at, column) in at.iter().zip(&mut columns) {
            let (Some(at), Some(column)) = (at, column) else { continue };
            let (mut reader, mut left) = (group.get_column_reader(*at)?, rows);
            while left > 0 {
                let values = read_numbers(&mut reader, &leaves[*at], left.min(READ_ROWS))?;
                if values.is_empty() {
                    return Err(ParquetError::EOF("a column ends before the others".into()));
                }
                left = left.saturating_sub(values.len());
                column.extend(values);
            }
        }
    }
    Ok(columns)
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
