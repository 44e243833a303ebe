//! Arrow streams and files, Parquet, and tables in memory: columns are found by name, in any order.

#[cfg(feature = "parquet")]
mod parquet;

#[cfg(feature = "parquet")]
pub use parquet::read_number_columns;
#[cfg(feature = "parquet")]
pub(crate) use parquet::read_parquet;

/// Fails, because this build does not read Parquet.
///
/// # Errors
/// [`Error::Input`], always.
#[cfg(not(feature = "parquet"))]
pub fn read_number_columns(path: &Path, _is_read: &dyn Fn(&str) -> bool) -> Result<NumberTable> {
    let message = format!("{} cannot be read: this build does not read Parquet", path.display());
    Err(Error::unsupported(message, crate::point_format::build_with("parquet")))
}

use super::{Columns, PointSink, Reading};
use ::arrow_array::RecordBatch;
use ::arrow_schema::Field;
use std::io::Read;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
#[cfg(not(feature = "parquet"))]
use vlscan_tables::NumberTable;
use vlscan_tables::input::arrow::{ArrowDecoder, TableField, numbers};

/// Key of the metadata of tables in memory in which return 0 of 0 marks a pulse without a return, whatever
/// their columns.
pub const MISSES_KEY: &str = "misses";

/// Finds the columns of the points by name, and starts the sink; columns without numbers have empty names.
fn start(names: &[&str], reading: &mut Reading) -> Result<Columns> {
    let columns = Columns::find_positions(names)
        .map_err(|problem| Error::caused_by(format!("{}: {problem}", reading.path.display()), problem))?;
    for remark in columns.remarks(names) {
        reading.warn(remark);
    }
    reading.sink.start(columns.attributes());
    if reading.sink.takes_details() {
        reading.sink.unread(columns.unread(names));
    }
    Ok(columns)
}

/// Reads an Arrow stream or file.
pub(super) fn read_arrow(mut source: impl Read, reading: &mut Reading) -> Result<()> {
    let mut decoder = ArrowDecoder::new(reading.path);
    let mut columns: Option<(Columns, Vec<usize>)> = None;
    let mut values = Vec::new();
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
            let (columns, chosen) = match &columns {
                Some(columns) => columns,
                None => {
                    let fields = decoder.fields().map(|fields| fields.to_vec()).unwrap_or_default();
                    // Non-numeric columns are not considered.
                    let names: Vec<&str> =
                        fields.iter().map(|f| if f.is_number() { f.heading.as_str() } else { "" }).collect();
                    let found = start(&names, reading)?;
                    reading.pass_metadata(&decoder.metadata());
                    columns.insert((found, reading.choose(&names)))
                }
            };
            for row in 0..batch.rows {
                values.clear();
                values.extend(chosen.iter().map(|column| batch.value(*column, row)));
                reading.pass_values(&values);
                if reading.take(&columns.row(|column| batch.value(column, row))).is_break() {
                    return Ok(());
                }
            }
        }
    }
    decoder.end()
}

/// Reads the points of a table in memory; `name` is its name in messages.
///
/// # Errors
/// [`Error::Input`] for tables without the columns X, Y and Z, and for columns of other numbers than integers
/// and floats of 32 and 64 bits. The errors of the sink.
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
    let columns = start(&names, &mut reading)?.of_own_table(schema.metadata().contains_key(MISSES_KEY));
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
    let colours = columns.colours().filter(|columns| {
        let read = columns.map(|column| numbers(batch.column(column)).map(|read| values[column] = read));
        read.iter().all(Option::is_some)
    });
    let columns = columns.with_colours(colours);
    // Nothing follows the rows, whether or not the sink has enough.
    let _ = take_rows(&columns, &values, batch.num_rows(), &mut reading);
    reading.end()
}

/// Passes rows of columns to the sink.
fn take_rows(columns: &Columns, values: &[Vec<f64>], rows: usize, reading: &mut Reading) -> ControlFlow<()> {
    (0..rows).try_for_each(|row| reading.take(&columns.row(|column| values[column][row])))
}
