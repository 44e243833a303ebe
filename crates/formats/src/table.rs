//! Arrow streams and files, Parquet, and tables in memory: columns are found by name, in any order.

use super::{Columns, PointSink, Reading};
use ::arrow_array::RecordBatch;
use ::arrow_schema::Field;
use ::parquet::basic::{ConvertedType, LogicalType, Type as Physical};
use ::parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use ::parquet::data_type::DataType;
use ::parquet::errors::ParquetError;
use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::schema::types::ColumnDescriptor;
use bytes::Bytes;
use std::io::Read;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use vlscan_base::damage::catch_decoder_panic;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::input::arrow::{ArrowDecoder, TableField, numbers};

/// Rows of Parquet that are read at a time.
const READ_ROWS: usize = 65_536;

/// Finds the columns of the points by name, and starts the sink; columns without numbers have empty names.
fn start(names: &[&str], reading: &mut Reading) -> Result<Columns> {
    let columns = Columns::find_positions(names)
        .map_err(|problem| Error::input(format!("{}: {problem}", reading.path.display())))?;
    for remark in columns.remarks(names) {
        reading.warn(remark);
    }
    reading.sink.start(columns.attributes());
    Ok(columns)
}

/// Reads an Arrow stream or file.
pub(super) fn read_arrow(mut source: impl Read, reading: &mut Reading) -> Result<()> {
    let mut decoder = ArrowDecoder::new(reading.path);
    let mut columns: Option<Columns> = None;
    let mut buffer = vec![0; 1 << 18];
    loop {
        let count = match source.read(&mut buffer) {
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
            count => count.map_err(|e| Error::io("read", reading.path, e))?,
        };
        if count == 0 {
            break;
        }
        decoder.feed(&buffer[..count]);
        while let Some(batch) = decoder.next_batch()? {
            let columns = match &columns {
                Some(columns) => columns,
                None => {
                    let fields = decoder.fields().map(|fields| fields.to_vec()).unwrap_or_default();
                    // Non-numeric columns are not considered.
                    let names: Vec<&str> =
                        fields.iter().map(|f| if f.is_number() { f.heading.as_str() } else { "" }).collect();
                    columns.insert(start(&names, reading)?)
                }
            };
            for row in 0..batch.rows {
                if reading.take(&columns.row(|column| batch.value(column, row))).is_break() {
                    return Ok(());
                }
            }
        }
    }
    decoder.end()
}

/// Reads the points of a table in memory; `name` stands for it in messages.
///
/// # Errors
/// [`Error::Input`] for tables without the columns X, Y and Z, and for columns of other numbers than integers and floats of 32
/// and 64 bits.
pub fn read_record_batch(
    batch: &RecordBatch,
    name: &str,
    sink: &mut dyn PointSink,
    found: &mut Diagnostics,
) -> Result<()> {
    let mut reading = Reading::new(Path::new(name), super::Selection::All, sink, found);
    let schema = batch.schema();
    let field_name = |field: &Arc<Field>| {
        if field.data_type().is_numeric() { TableField::new(field).heading } else { String::new() }
    };
    let names: Vec<String> = schema.fields().iter().map(field_name).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let columns = start(&names, &mut reading)?;
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    for (_, column) in columns.used() {
        values[column] = numbers(batch.column(column)).ok_or_else(|| {
            let kind = batch.column(column).data_type();
            Error::input(format!(
                "{name}: column {} holds {kind}; expected integers or floats of 32 or 64 bits",
                names[column]
            ))
        })?;
    }
    // Nothing follows the rows, whether or not the sink has enough.
    let _ = take_rows(&columns, &values, batch.num_rows(), &mut reading);
    reading.end();
    Ok(())
}

/// Passes rows of columns to the sink.
fn take_rows(columns: &Columns, values: &[Vec<f64>], rows: usize, reading: &mut Reading) -> ControlFlow<()> {
    (0..rows).try_for_each(|row| reading.take(&columns.row(|column| values[column][row])))
}

/// Reads a Parquet file; its library panics on some damaged pages.
pub(super) fn read_parquet(file: Bytes, reading: &mut Reading) -> Result<()> {
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

/// Whether a column holds one number per row; dates, times, decimals and members of nested columns are none.
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
        _ => Err(ParquetError::General(format!("column {} holds no usual numbers", leaf.name()))),
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
