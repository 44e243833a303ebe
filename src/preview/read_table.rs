//! Reads points from Arrow streams and files and from Parquet: columns are found by name, in any order.

use super::points::Points;
use super::read::{attributes, not_empty, push_row};
use crate::damage::catch_decoder_panic;
use crate::error::{Error, Result};
use crate::input::arrow::{ArrowDecoder, numbers};
use crate::points::{Attribute, Columns};
use crate::store::FileBytes;
use ::parquet::arrow::ProjectionMask;
use ::parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use bytes::Bytes;
use std::io::Read;
use std::path::Path;

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

/// Reads a Parquet file; its library panics on some damaged pages.
pub(super) fn read_parquet(path: &Path) -> Result<Points> {
    catch_decoder_panic(|| read_row_groups(path))
        .unwrap_or_else(|| Err(Error::input(format!("{}: its pages are damaged", path.display()))))
}

fn read_row_groups(path: &Path) -> Result<Points> {
    // Mapped: the library reads damaged headers byte by byte.
    let file = Bytes::from_owner(FileBytes::open(path).map_err(|e| Error::open(path, e))?);
    let failed = |e: &dyn std::fmt::Display| {
        Error::input(format!("{} is not a Parquet file that can be read: {e}", path.display()))
    };
    let builder = ParquetRecordBatchReaderBuilder::try_new(file).map_err(|e| failed(&e))?;
    let schema = builder.schema().clone();
    let names: Vec<&str> = schema
        .fields()
        .iter()
        .map(|field| if field.data_type().is_numeric() { field.name().as_str() } else { "" })
        .collect();
    let columns = find_columns(&names, path)?;
    let mask = ProjectionMask::roots(builder.parquet_schema(), columns.used().map(|(_, column)| column));
    let mut points = Points::new(attributes(|a| columns.has(a)));
    let batches = builder.with_projection(mask).build().map_err(|e| failed(&e))?;
    for batch in batches {
        let batch = batch.map_err(|e| failed(&e))?;
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
        for (_, column) in columns.used() {
            let name = names[column];
            values[column] =
                batch.column_by_name(name).and_then(|array| numbers(array)).ok_or_else(|| {
                    Error::input(format!("{}: column {name} holds no usual numbers", path.display()))
                })?;
        }
        (0..batch.num_rows())
            .for_each(|row| push_row(&mut points, &columns.row(|column| values[column][row]), None));
    }
    not_empty(points, path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DVec3;
    use ::arrow_array::{
        ArrayRef, Float32Array, Float64Array, Int32Array, RecordBatch, StringArray, UInt8Array,
    };
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
        let table = table();
        let file = File::create(&path).unwrap();
        let mut writer = ::parquet::arrow::ArrowWriter::try_new(file, table.schema(), None).unwrap();
        writer.write(&table).unwrap();
        writer.close().unwrap();
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
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.parquet");
        std::fs::write(&path, &bytes).unwrap();
        assert!(said(read_parquet(&path)).contains("not a Parquet file"));
    }
}
