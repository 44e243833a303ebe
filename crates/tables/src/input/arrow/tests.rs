//! Tests of Arrow streams.

use super::*;
use ::arrow_array::{ArrayRef, Float32Array, Float64Array, Int64Array, RecordBatch, StringArray};
use ::arrow_ipc::writer::{FileWriter, StreamWriter};

fn batch(from: i64, rows: i64) -> RecordBatch {
    let numbers = from..from + rows;
    let columns: [(&str, ArrayRef); 4] = [
        ("x", Arc::new(numbers.clone().map(|i| i as f64 / 8.0).collect::<Float64Array>())),
        ("name", Arc::new(numbers.clone().map(|i| Some(i.to_string())).collect::<StringArray>())),
        ("single", Arc::new(numbers.clone().map(|i| i as f32).collect::<Float32Array>())),
        ("pulse", Arc::new(numbers.collect::<Int64Array>())),
    ];
    RecordBatch::try_from_iter(columns).unwrap()
}

fn stream(sizes: &[i64]) -> Vec<u8> {
    let mut writer = StreamWriter::try_new(Vec::new(), &batch(0, 0).schema()).unwrap();
    let mut from = 0;
    for size in sizes {
        writer.write(&batch(from, *size)).unwrap();
        from += size;
    }
    writer.into_inner().unwrap()
}

fn read(bytes: &[u8], piece: usize) -> Result<Vec<[f64; 4]>, String> {
    let mut decoder = ArrowDecoder::new(Path::new("t"));
    let mut rows = Vec::new();
    let mut take = |decoder: &mut ArrowDecoder| -> Result<()> {
        while let Some(batch) = decoder.next_batch()? {
            assert_eq!(batch.before as usize, rows.len());
            rows.extend((0..batch.rows).map(|row| [0, 1, 2, 3].map(|column| batch.value(column, row))));
        }
        Ok(())
    };
    let done = bytes.chunks(piece).try_for_each(|bytes| {
        decoder.feed(bytes);
        take(&mut decoder)
    });
    match done.and_then(|()| decoder.end()) {
        Err(Error::Input(problems)) => Err(problems.text()),
        Err(other) => panic!("{other}"),
        Ok(()) => Ok(rows),
    }
}

/// Also reads tables with other numbers of columns.
fn read_any(bytes: &[u8]) {
    let mut decoder = ArrowDecoder::new(Path::new("t"));
    for bytes in bytes.chunks(37) {
        decoder.feed(bytes);
        loop {
            match decoder.next_batch() {
                Ok(Some(batch)) => {
                    let columns = 0..batch.columns.len();
                    columns.for_each(|c| (0..batch.rows.min(100)).for_each(|r| _ = batch.value(c, r)));
                }
                Ok(None) => break,
                Err(_) => return,
            }
        }
    }
    let _ = decoder.end();
}

fn assert_counts(rows: &[[f64; 4]], count: usize) {
    assert_eq!(rows.len(), count);
    for (i, row) in rows.iter().enumerate() {
        let i = i as f64;
        assert_eq!((row[0], row[2], row[3]), (i / 8.0, i, i));
        assert!(row[1].is_nan(), "text is no number");
    }
}

#[test]
fn streams_are_read_however_they_are_cut_and_files_like_them() {
    let bytes = stream(&[5, 0, 300, 1]);
    for piece in [1, 7, 64, 1000, bytes.len()] {
        assert_counts(&read(&bytes, piece).unwrap(), 306);
    }
    assert_counts(&read(&bytes[..bytes.len() - 8], 50).unwrap(), 306);
    let mut writer = FileWriter::try_new(Vec::new(), &batch(0, 0).schema()).unwrap();
    writer.write(&batch(0, 70)).unwrap();
    assert_counts(&read(&writer.into_inner().unwrap(), 33).unwrap(), 70);
}

#[test]
fn the_first_bytes_tell() {
    assert_eq!(detect_arrow(&stream(&[])), ArrowDetection::Arrow);
    assert_eq!(detect_arrow(b"ARROW1\0\0...."), ArrowDetection::Arrow);
    assert_eq!(detect_arrow(b"ARROW1"), ArrowDetection::NeedMoreBytes);
    assert_eq!(detect_arrow(&[0xff; 3]), ArrowDetection::NeedMoreBytes);
    assert_eq!(detect_arrow(b""), ArrowDetection::NeedMoreBytes);
    assert_eq!(detect_arrow(b"time,x,y,z"), ArrowDetection::Other);
    assert_eq!(detect_arrow("\u{feff}time".as_bytes()), ArrowDetection::Other);
}

#[test]
fn units_stand_behind_names() {
    let metadata = std::collections::BTreeMap::from([("unit".to_owned(), "ns".to_owned())]);
    let field =
        ::arrow_schema::Field::new("time", ::arrow_schema::DataType::Int64, false).with_metadata(metadata);
    let schema = ::arrow_schema::Schema::new(vec![field]);
    let bytes = StreamWriter::try_new(Vec::new(), &schema).unwrap().into_inner().unwrap();
    let mut decoder = ArrowDecoder::new(Path::new("t"));
    decoder.feed(&bytes);
    assert!(decoder.next_batch().unwrap().is_none());
    assert_eq!(decoder.fields().unwrap()[0].heading, "time[ns]");
}

#[test]
fn a_stream_that_is_cut_off_says_where() {
    let bytes = stream(&[10, 20, 30]);
    let cut = read(&bytes[..bytes.len() - 100], 1000).unwrap_err();
    assert!(cut.contains("within batch 3, after 30 whole rows in 2 batches"), "{cut}");
    assert!(read(&bytes[..100], 9).unwrap_err().contains("within batch 1"));
}

#[test]
fn nulls_and_nested_columns_are_refused() {
    let with_null: ArrayRef = Arc::new(Float64Array::from(vec![Some(1.0), None]));
    let table = RecordBatch::try_from_iter([("x", with_null)]).unwrap();
    let mut writer = StreamWriter::try_new(Vec::new(), &table.schema()).unwrap();
    writer.write(&table).unwrap();
    let said = read(&writer.into_inner().unwrap(), 1000).unwrap_err();
    assert!(said.contains("1 of 2 values of column `x` are null"), "{said}");
    let item = ::arrow_schema::Field::new("item", ::arrow_schema::DataType::Float64, false);
    let list = ::arrow_schema::DataType::FixedSizeList(Arc::new(item), 3);
    let schema = ::arrow_schema::Schema::new(vec![::arrow_schema::Field::new("xyz", list, false)]);
    let bytes = StreamWriter::try_new(Vec::new(), &schema).unwrap().into_inner().unwrap();
    assert!(read(&bytes, 1000).unwrap_err().contains("column `xyz` is nested"));
}

proptest::proptest! {
    #[test]
    fn damaged_streams_are_read_or_refused(
        at in proptest::collection::vec((0usize..2000, proptest::num::u8::ANY), 1..4), cut in 0usize..2000,
    ) {
        let mut bytes = stream(&[3, 4]);
        for (at, byte) in at {
            let at = at % bytes.len();
            bytes[at] = byte;
        }
        let end = bytes.len() - cut % bytes.len();
        read_any(&bytes[..end]);
    }
}
