//! Reads points from Arrow streams and files and from Parquet: columns are found by name, in any order.

use super::points::Points;
use super::read::{attributes, not_empty, push_row};
use crate::damage::catch_decoder_panic;
use crate::error::{Error, Result};
use crate::input::arrow::{ArrowDecoder, numbers};
use crate::points::{Attribute, Columns};
use crate::store::FileBytes;
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
use std::path::Path;
use std::sync::Arc;

/// Rows of Parquet that are read at a time.
const READ_ROWS: usize = 65_536;

/// Finds the columns of the points by name; text columns have empty names.
fn find_columns(names: &[&str], path: &Path) -> Result<Columns> {
    let columns = Columns::find(names.iter().copied());
    match Attribute::POSITION.into_iter().find(|axis| !columns.has(*axis)) {
        Some(axis) => Err(Error::input(format!(
            "{}: no column {axis:?} with numbers; there are {}",
            path.display(),
            names.join(", ")
        ))),
        None => Ok(columns),
    }
}

/// Reads an Arrow stream or file; `path` is its name in messages.
pub(super) fn read_arrow(mut source: impl Read, path: &Path) -> Result<Points> {
    let mut decoder = ArrowDecoder::new(path);
    let mut read: Option<(Columns, Points)> = None;
    let mut buffer = vec![0; 1 << 18];
    loop {
        let count = match source.read(&mut buffer) {
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
            count => count.map_err(|e| Error::io("read", path, e))?,
        };
        if count == 0 {
            break;
        }
        decoder.feed(&buffer[..count]);
        while let Some(batch) = decoder.next_batch()? {
            if read.is_none() {
                let fields = decoder.fields().map(|fields| fields.to_vec()).unwrap_or_default();
                // Non-numeric columns are not considered.
                let names: Vec<&str> =
                    fields.iter().map(|f| if f.is_number() { f.heading.as_str() } else { "" }).collect();
                let columns = find_columns(&names, path)?;
                read = Some((columns, Points::new(attributes(|a| columns.has(a)))));
            }
            let Some((columns, points)) = &mut read else { continue };
            for row in 0..batch.rows {
                push_row(points, &columns.row(|column| batch.value(column, row)), None);
            }
        }
    }
    decoder.end()?;
    not_empty(read.map(|(_, points)| points).unwrap_or_default(), path)
}

/// The points of a table in memory.
///
/// # Errors
/// [`Error::Input`] for tables without the columns X, Y and Z, for columns of other numbers than integers and floats of 32 and
/// 64 bits, and for empty ones.
pub fn points_of_table(batch: &RecordBatch) -> Result<Points> {
    let path = Path::new("the table");
    let schema = batch.schema();
    let name = |field: &Arc<Field>| {
        if field.data_type().is_numeric() { field.name().clone() } else { String::new() }
    };
    let names: Vec<String> = schema.fields().iter().map(name).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let columns = find_columns(&names, path)?;
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    for (_, column) in columns.used() {
        values[column] = numbers(batch.column(column)).ok_or_else(|| {
            let kind = batch.column(column).data_type();
            Error::input(format!(
                "the table: column {} holds {kind}; expected integers or floats of 32 or 64 bits",
                names[column]
            ))
        })?;
    }
    let mut points = Points::new(attributes(|a| columns.has(a)));
    (0..batch.num_rows())
        .for_each(|row| push_row(&mut points, &columns.row(|column| values[column][row]), None));
    not_empty(points, path)
}

/// Reads a Parquet file; its library panics on some damaged pages.
pub(super) fn read_parquet(path: &Path) -> Result<Points> {
    catch_decoder_panic(|| read_row_groups(path))
        .unwrap_or_else(|| Err(Error::input(format!("{}: its pages are damaged", path.display()))))
}

fn read_row_groups(path: &Path) -> Result<Points> {
    // Mapped: the library reads damaged headers byte by byte.
    let file = Bytes::from_owner(FileBytes::open(path).map_err(|e| Error::open(path, e))?);
    let failed = |e: ParquetError| {
        Error::input(format!("{} is not a Parquet file that can be read: {e}", path.display()))
    };
    let reader = SerializedFileReader::new(file).map_err(failed)?;
    let leaves = reader.metadata().file_metadata().schema_descr().columns();
    let names: Vec<&str> = leaves.iter().map(|leaf| if is_number(leaf) { leaf.name() } else { "" }).collect();
    let columns = find_columns(&names, path)?;
    let mut points = Points::new(attributes(|a| columns.has(a)));
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
            (0..rows).for_each(|row| push_row(&mut points, &columns.row(|column| values[column][row]), None));
            left -= rows;
        }
    }
    not_empty(points, path)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DVec3;
    use ::arrow_array::{
        ArrayRef, Float32Array, Float64Array, Int32Array, RecordBatch, StringArray, UInt8Array,
    };
    use ::parquet::data_type::{ByteArray, ByteArrayType, DoubleType, FloatType, Int32Type};
    use ::parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
    use std::fs::File;
    use std::sync::Arc;

    fn table() -> RecordBatch {
        let count = 0..500;
        let columns: [(&str, ArrayRef); 6] = [
            ("name", Arc::new(count.clone().map(|i| Some(format!("p{i}"))).collect::<StringArray>())),
            ("z", Arc::new(Float32Array::from_iter_values(count.clone().map(|i| i as f32)))),
            ("X", Arc::new(Float64Array::from_iter_values(count.clone().map(|i| f64::from(i) * 0.5)))),
            ("y [m]", Arc::new(Int32Array::from_iter_values(count.clone()))),
            ("Classification", Arc::new(UInt8Array::from_iter_values(count.clone().map(|i| (i % 7) as u8)))),
            ("ObjectId", Arc::new(Int32Array::from_iter_values(count.map(|i| i / 250)))),
        ];
        RecordBatch::try_from_iter(columns).unwrap()
    }

    fn stream() -> Vec<u8> {
        let table = table();
        let mut writer = ::arrow_ipc::writer::StreamWriter::try_new(Vec::new(), &table.schema()).unwrap();
        writer.write(&table.slice(0, 300)).unwrap();
        writer.write(&table.slice(300, 200)).unwrap();
        writer.into_inner().unwrap()
    }

    /// The same table, with X nullable, in row groups of 300 and 200.
    fn write_parquet(path: &Path) {
        let schema = "message table {
            required binary name (string); required float z; optional double X; required int32 y;
            required int32 Classification (integer(8, false)); required int32 ObjectId; }";
        let schema = ::parquet::schema::parser::parse_message_type(schema).unwrap();
        let file = File::create(path).unwrap();
        let mut writer = SerializedFileWriter::new(file, Arc::new(schema), Default::default()).unwrap();
        for rows in [0..300, 300..500] {
            let mut group = writer.next_row_group().unwrap();
            let mut column = |write: &dyn Fn(&mut SerializedColumnWriter)| {
                let mut column = group.next_column().unwrap().unwrap();
                write(&mut column);
                column.close().unwrap();
            };
            let integers = |of: &dyn Fn(i32) -> i32| rows.clone().map(of).collect::<Vec<_>>();
            column(&|c| {
                let names: Vec<ByteArray> =
                    rows.clone().map(|i| ByteArray::from(format!("p{i}").as_str())).collect();
                c.typed::<ByteArrayType>().write_batch(&names, None, None).unwrap();
            });
            column(&|c| {
                let z: Vec<f32> = rows.clone().map(|i| i as f32).collect();
                c.typed::<FloatType>().write_batch(&z, None, None).unwrap();
            });
            column(&|c| {
                let x: Vec<f64> = rows.clone().map(|i| f64::from(i) * 0.5).collect();
                c.typed::<DoubleType>().write_batch(&x, Some(&vec![1; x.len()]), None).unwrap();
            });
            for of in [&|i| i, &|i| i % 7, &|i| i / 250] as [&dyn Fn(i32) -> i32; 3] {
                column(&|c| {
                    c.typed::<Int32Type>().write_batch(&integers(of), None, None).unwrap();
                });
            }
            group.close().unwrap();
        }
        writer.close().unwrap();
    }

    fn assert_points(points: &Points) {
        assert_eq!(points.len(), 500);
        assert_eq!(points.bounds().max, DVec3::new(249.5, 499.0, 499.0));
        assert_eq!(points.class[..8], [0, 1, 2, 3, 4, 5, 6, 0]);
        assert_eq!(points.objects, ["0", "1"]);
        assert!(!points.attributes().intensity && !points.attributes().return_number);
    }

    #[test]
    fn columns_are_found_by_name_in_both_formats() {
        let folder = tempfile::tempdir().unwrap();
        assert_points(&read_arrow(&stream()[..], Path::new("t")).unwrap());
        let path = folder.path().join("t.parquet");
        write_parquet(&path);
        assert_points(&read_parquet(&path).unwrap());
        let arrow = folder.path().join("t.arrow");
        std::fs::write(&arrow, stream()).unwrap();
        assert_points(&super::super::read_points(&arrow).unwrap());
    }

    #[test]
    fn what_is_missing_or_damaged_is_said() {
        let said = |result: Result<Points>| match result {
            Err(Error::Input(problems)) => problems.render(false),
            other => panic!("{other:?}"),
        };
        let bytes = stream();
        assert!(
            said(read_arrow(&bytes[..bytes.len() - 500], Path::new("t"))).contains("ends within batch 2")
        );
        let only: ArrayRef = Arc::new(Float64Array::from(vec![1.0]));
        let table = RecordBatch::try_from_iter([("X", only.clone()), ("Y", only)]).unwrap();
        let mut writer = ::arrow_ipc::writer::StreamWriter::try_new(Vec::new(), &table.schema()).unwrap();
        writer.write(&table).unwrap();
        let said_of = said(read_arrow(&writer.into_inner().unwrap()[..], Path::new("t")));
        assert!(said_of.contains("no column Z") && said_of.contains("X, Y"), "{said_of}");
        let floats: ArrayRef = Arc::new(Float64Array::from(vec![1.0]));
        let decimals: ArrayRef = Arc::new(::arrow_array::Decimal128Array::from(vec![100i128]));
        let table =
            RecordBatch::try_from_iter([("X", floats.clone()), ("Y", decimals), ("Z", floats)]).unwrap();
        let said_of = said(points_of_table(&table));
        assert!(said_of.contains("column Y holds Decimal128"), "{said_of}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.parquet");
        std::fs::write(&path, &bytes).unwrap();
        assert!(said(read_parquet(&path)).contains("not a Parquet file"));
    }
}
