//! Tests of points in Arrow, Parquet and tables in memory.

use super::{Points, points_of_table, read_points};
use ::arrow_array::{ArrayRef, Float32Array, Float64Array, Int32Array, RecordBatch, StringArray, UInt8Array};
use ::parquet::data_type::{ByteArray, ByteArrayType, DoubleType, FloatType, Int32Type};
use ::parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use vlscan_base::error::{Error, Result};
use vlscan_formats::Attribute;
use vlscan_geom::DVec3;

fn read_bytes(bytes: &[u8]) -> Result<Points> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t");
    std::fs::write(&path, bytes).unwrap();
    read_points(&path).map(|(points, _)| points)
}

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
    assert_eq!(points.class.to_vec()[..8], [0, 1, 2, 3, 4, 5, 6, 0]);
    assert_eq!(points.objects, ["0", "1"]);
    assert!(!points.has(Attribute::Intensity) && !points.has(Attribute::ReturnNumber));
}

#[test]
fn columns_are_found_by_name_in_both_formats() {
    let folder = tempfile::tempdir().unwrap();
    assert_points(&read_bytes(&stream()).unwrap());
    let path = folder.path().join("t.parquet");
    write_parquet(&path);
    assert_points(&read_points(&path).unwrap().0);
}

#[test]
fn what_is_not_used_as_it_stands_in_a_table_is_said() {
    let floats = |values: [f64; 3]| -> ArrayRef { Arc::new(Float64Array::from(values.to_vec())) };
    let columns = [
        ("X", floats([1.0, 2.0, f64::NAN])),
        ("Y", floats([0.0; 3])),
        ("z", floats([0.0; 3])),
        ("Z", floats([0.0; 3])),
        ("class", floats([300.0, 2.0, 2.0])),
        ("leg", floats([0.0, 300.0, 0.0])),
        ("omnivariance", floats([0.0; 3])),
    ];
    let table = RecordBatch::try_from_iter(columns).unwrap();
    let (points, found) = points_of_table(&table).unwrap();
    let said = found.text();
    for part in [
        "the table",
        "columns 3 (\"z\") and 4 (\"Z\")",
        "not read: omnivariance",
        "1 point has a class",
        "1 point without coordinates",
    ] {
        assert!(said.contains(part), "{part} is missing from {said}");
    }
    assert_eq!((points.len(), points.beyond_bytes(), found.is_fatal(true)), (2, (1, 0), true));
}

#[test]
fn units_in_the_metadata_of_a_field_count() {
    let field = |name: &str, unit: &str| {
        let metadata = std::collections::HashMap::from([("unit".to_owned(), unit.to_owned())]);
        ::arrow_schema::Field::new(name, ::arrow_schema::DataType::Float64, false).with_metadata(metadata)
    };
    let schema = ::arrow_schema::Schema::new(vec![field("X", "ft"), field("Y", "yd"), field("Z", "furlong")]);
    let column = || -> ArrayRef { Arc::new(Float64Array::from(vec![100.0])) };
    let table = RecordBatch::try_new(Arc::new(schema), vec![column(), column(), column()]).unwrap();
    let (points, found) = points_of_table(&table).unwrap();
    assert!((points.position(0) - DVec3::new(30.48, 91.44, 100.0)).length() < 1e-9);
    let said = found.text();
    assert!(said.contains("unit \"furlong\" of column 3") && said.contains("metres are assumed"), "{said}");
}

#[test]
fn what_is_missing_or_damaged_is_said() {
    let said = |result: Result<Points>| match result {
        Err(Error::Input(problems)) => problems.text(),
        other => panic!("{other:?}"),
    };
    let bytes = stream();
    assert!(said(read_bytes(&bytes[..bytes.len() - 500])).contains("ends within batch 2"));
    let only: ArrayRef = Arc::new(Float64Array::from(vec![1.0]));
    let table = RecordBatch::try_from_iter([("X", only.clone()), ("Y", only)]).unwrap();
    let mut writer = ::arrow_ipc::writer::StreamWriter::try_new(Vec::new(), &table.schema()).unwrap();
    writer.write(&table).unwrap();
    let said_of = said(read_bytes(&writer.into_inner().unwrap()));
    assert!(said_of.contains("no column z") && said_of.contains("X, Y"), "{said_of}");
    let floats: ArrayRef = Arc::new(Float64Array::from(vec![1.0]));
    let decimals: ArrayRef = Arc::new(::arrow_array::Decimal128Array::from(vec![100i128]));
    let table = RecordBatch::try_from_iter([("X", floats.clone()), ("Y", decimals), ("Z", floats)]).unwrap();
    let said_of = said(points_of_table(&table).map(|(points, _)| points));
    assert!(said_of.contains("column Y holds Decimal128"), "{said_of}");
    assert!(said(read_bytes(b"PAR1 and no more")).contains("not a Parquet file"));
}
