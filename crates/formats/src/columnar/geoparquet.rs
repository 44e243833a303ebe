//! GeoParquet 1.1 (<https://geoparquet.org>): the columns of Parquet, then `geometry` with points as
//! well-known binary and `bbox` with their boxes, by which readers skip row groups; the coordinate reference
//! system is PROJJSON.

use super::arrow::point_schema;
use super::parquet::{
    GROUP_ROWS, Group, ParquetFile, Written, failed, field, metadata, with_column, write, write_columns,
};
use super::projjson::projjson;
use super::rows::Rows;
use super::{Column, ColumnType, TableEncoder};
use crate::encode::{Ending, FileBody, PointEncoder};
use crate::out::{Offload, OutputStream};
use crate::record::{EncodedPoints, PointBatch};
use crate::settings::CloudSettings;
use ::arrow_buffer::MutableBuffer;
use ::arrow_schema::{DataType, Field, Fields, Schema, SchemaRef};
use ::parquet::basic::{Repetition, Type as Physical};
use ::parquet::data_type::{ByteArray, ByteArrayType, FloatType};
use ::parquet::file::metadata::KeyValue;
use ::parquet::schema::types::Type;
use bytes::Bytes;
use serde_json::{Value, json};
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_crs as crs;
use vlscan_geom::Aabb;

const GEOMETRY: &str = "geometry";
const BBOX: &str = "bbox";
/// Members of a box, the lower corner first.
const CORNERS: [&str; 4] = ["xmin", "ymin", "xmax", "ymax"];
/// Columns without repeated values.
const UNIQUE: [&str; 5] = [GEOMETRY, "bbox.xmin", "bbox.ymin", "bbox.xmax", "bbox.ymax"];

/// Bytes of a point: byte order, type, coordinates.
const WKB_BYTES: usize = 1 + 4 + 3 * 8;
/// Little-endian, and the type Point Z of ISO 13249-3.
const WKB_HEAD: [u8; 5] = [1, 0xE9, 3, 0, 0];

/// Points as blocks of columns, the last three of which are the coordinates of the geometry.
#[derive(Debug)]
struct GeoParquetEncoder {
    table: TableEncoder,
    schema: SchemaRef,
    /// The coordinate reference system; null if unknown.
    crs: Value,
}

/// GeoParquet files.
pub(crate) fn geoparquet(
    settings: &CloudSettings,
    problems: &mut Diagnostics,
) -> Result<Arc<dyn PointEncoder>> {
    let mut columns = settings.table_columns();
    let crs = settings.crs.as_deref().map_or(Value::Null, |wkt| {
        projjson(wkt).unwrap_or_else(|| {
            let name = crs::name(wkt);
            let message =
                format!("GeoParquet without coordinate reference system: {name} has no PROJJSON here");
            problems.warn(None, message).help(
                "its WKT is in the metadata `crs`; --crs with the EPSG code of a projected system writes \
                 PROJJSON",
            );
            Value::Null
        })
    });
    let points = point_schema(&columns, settings);
    let corners = CORNERS.map(|name| Field::new(name, DataType::Float32, false));
    let own = [
        Field::new(GEOMETRY, DataType::Binary, false),
        Field::new(BBOX, DataType::Struct(Fields::from(corners.to_vec())), false),
    ];
    let fields: Vec<_> = points.fields().iter().cloned().chain(own.map(Arc::new)).collect();
    let schema = Arc::new(Schema::new_with_metadata(fields, points.metadata().clone()));
    columns.extend([Column::X, Column::Y, Column::Z]);
    Ok(Arc::new(GeoParquetEncoder { table: TableEncoder::new(columns, settings), schema, crs }))
}

impl PointEncoder for GeoParquetEncoder {
    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        self.table.push_block(batch.points, out);
    }

    fn begin(self: Arc<Self>, _: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        let columns = &self.table.columns;
        let rows = Rows::new(columns.iter().map(|column| column.kind()).collect(), GROUP_ROWS);
        let leaf = |name, physical| {
            let leaf = Type::primitive_type_builder(name, physical).with_repetition(Repetition::REQUIRED);
            leaf.build().map(Arc::new).map_err(failed)
        };
        let mut fields: Vec<Arc<Type>> =
            columns[..columns.len() - 3].iter().map(|column| field(*column)).collect::<Result<_>>()?;
        fields.push(leaf(GEOMETRY, Physical::BYTE_ARRAY)?);
        let corners = CORNERS.iter().map(|name| leaf(name, Physical::FLOAT)).collect::<Result<_>>()?;
        let bbox = Type::group_type_builder(BBOX).with_repetition(Repetition::REQUIRED).with_fields(corners);
        fields.push(Arc::new(bbox.build().map_err(failed)?));
        let file = ParquetFile::begin(fields, metadata(&self.schema), &UNIQUE)?;
        Ok(Box::new(GeoParquetBody { encoder: self, rows, file }))
    }
}

/// A file that is being written.
struct GeoParquetBody {
    encoder: Arc<GeoParquetEncoder>,
    rows: Rows,
    file: ParquetFile,
}

impl FileBody for GeoParquetBody {
    fn append(&mut self, blocks: Vec<u8>, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        let GeoParquetBody { rows, file, .. } = self;
        rows.append(&blocks, |rows| file.write_group(rows, write_group, out))
    }

    fn finish(&mut self, end: &Ending, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        if !self.rows.is_empty() {
            self.file.write_group(&mut self.rows, write_group, out)?;
        }
        let about = about(&self.encoder.crs, &end.tally.bounds).to_string();
        self.file.finish(end.is_partial, vec![KeyValue::new("geo".to_owned(), about)], out)
    }
}

/// The metadata of the geometry, by which readers recognise it.
fn about(crs: &Value, bounds: &Aabb) -> Value {
    let corner = |name: &str| json!([BBOX, name]);
    let covering: serde_json::Map<_, _> =
        CORNERS.iter().map(|name| ((*name).to_owned(), corner(name))).collect();
    let mut geometry = json!({
        "encoding": "WKB",
        "geometry_types": ["Point Z"],
        "crs": crs,
        "covering": { "bbox": covering },
    });
    if !bounds.is_empty() {
        geometry["bbox"] = json!([bounds.min.to_array(), bounds.max.to_array()].as_flattened());
    }
    json!({ "version": "1.1.0", "primary_column": GEOMETRY, "columns": { GEOMETRY: geometry } })
}

/// Writes the columns of a row group, the last three as geometry and box.
fn write_group(group: &mut Group, columns: &[(ColumnType, MutableBuffer)]) -> Written {
    let (columns, position) = columns.split_at(columns.len() - 3);
    write_columns(group, columns)?;
    let [x, y, z] = [0, 1, 2].map(|axis| position[axis].1.typed_data::<f64>());
    let mut wkb = Vec::with_capacity(x.len() * WKB_BYTES);
    for ((x, y), z) in x.iter().zip(y).zip(z) {
        wkb.extend_from_slice(&WKB_HEAD);
        [x, y, z].into_iter().for_each(|c| wkb.extend_from_slice(&c.to_le_bytes()));
    }
    let wkb = Bytes::from(wkb);
    let point = |at: usize| ByteArray::from(wkb.slice(at * WKB_BYTES..(at + 1) * WKB_BYTES));
    let points: Vec<ByteArray> = (0..x.len()).map(point).collect();
    with_column(group, |out| write::<ByteArrayType>(out, &points))?;
    // The nearest 32-bit numbers around each coordinate.
    let below = |c: &f64| if f64::from(*c as f32) > *c { (*c as f32).next_down() } else { *c as f32 };
    let above = |c: &f64| if f64::from(*c as f32) < *c { (*c as f32).next_up() } else { *c as f32 };
    let corners: [Vec<f32>; 4] = [
        x.iter().map(below).collect(),
        y.iter().map(below).collect(),
        x.iter().map(above).collect(),
        y.iter().map(above).collect(),
    ];
    corners.iter().try_for_each(|corner| with_column(group, |out| write::<FloatType>(out, corner)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CloudWriter, PointFile, PointFormat, PointRecord, PointRow, PointSink, Selection};
    use ::parquet::file::reader::{FileReader, SerializedFileReader};
    use std::ops::ControlFlow;
    use vlscan_geom::DVec3;

    struct Rows(Vec<PointRow>);

    impl PointSink for Rows {
        fn start(&mut self, _: crate::AttributeSet) {}

        fn point(&mut self, row: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
            self.0.push(*row);
            Ok(ControlFlow::Continue(()))
        }
    }

    fn written(settings: &CloudSettings, points: &[PointRecord]) -> (Bytes, Vec<PointRow>, Diagnostics) {
        let dir = tempfile::tempdir().unwrap();
        let (path, mut found) = (dir.path().join("a.geo.parquet"), Diagnostics::default());
        let format = PointFormat::of_file(&path).unwrap().unwrap();
        assert_eq!(format, PointFormat::GeoParquet);
        let mut writer = CloudWriter::create(&path, false, format, settings, &mut found).unwrap();
        points.chunks(7).for_each(|points| writer.write(points).unwrap());
        assert_eq!(writer.finish().unwrap().records, points.len() as u64);
        let bytes = std::fs::read(&path).unwrap();
        let (mut rows, mut unread) = (Rows(Vec::new()), Diagnostics::default());
        let file = PointFile::new(&path, &bytes, &mut unread).unwrap();
        file.read(Selection::All, &mut rows, &mut unread).unwrap();
        (bytes.into(), rows.0, found)
    }

    fn about(file: &Bytes) -> Value {
        let reader = SerializedFileReader::new(file.clone()).unwrap();
        let pairs = reader.metadata().file_metadata().key_value_metadata().unwrap().clone();
        let geo = pairs.into_iter().find(|pair| pair.key == "geo").unwrap().value.unwrap();
        serde_json::from_str(&geo).unwrap()
    }

    #[test]
    fn geometry_box_and_system_are_those_of_the_points() {
        let origin = DVec3::new(476_000.0, 5_429_400.0, 100.0);
        let crs = Some(crs::wkt_of_epsg(25832).unwrap());
        let settings = CloudSettings { origin, crs, ..CloudSettings::default() };
        let point = |i: u32| PointRecord {
            position: DVec3::new(f64::from(i) * 0.1, -f64::from(i), 2.0),
            class: i as i32,
            ..PointRecord::default()
        };
        let points: Vec<PointRecord> = (0..100).map(point).collect();
        let (file, rows, found) = written(&settings, &points);
        assert!(found.is_empty());
        let is_same = |(row, point): (&PointRow, &PointRecord)| {
            row.position == point.position + origin && i32::from(row.class) == point.class
        };
        assert!(rows.len() == 100 && rows.iter().zip(&points).all(is_same));

        let about = about(&file);
        let column = &about["columns"]["geometry"];
        assert_eq!((&about["version"], &column["crs"]["id"]["code"]), (&json!("1.1.0"), &json!(25832)));
        assert_eq!(column["bbox"][1], json!(5_429_301.0));
        let reader = SerializedFileReader::new(file).unwrap();
        for (row, point) in reader.get_row_iter(None).unwrap().zip(&points) {
            let row = row.unwrap();
            let fields: Vec<_> = row.get_column_iter().collect();
            let [.., (_, geometry), (_, bbox)] = &fields[..] else { unreachable!() };
            let ::parquet::record::Field::Bytes(wkb) = geometry else { unreachable!() };
            let (head, coordinates) = wkb.data().split_at(5);
            let c = |at: usize| f64::from_le_bytes(coordinates[8 * at..8 * at + 8].try_into().unwrap());
            assert_eq!((head, DVec3::new(c(0), c(1), c(2))), (&WKB_HEAD[..], point.position + origin));
            let ::parquet::record::Field::Group(bbox) = bbox else { unreachable!() };
            let corner: Vec<f64> = bbox
                .get_column_iter()
                .map(
                    |(_, field)| {
                        if let ::parquet::record::Field::Float(v) = field { (*v).into() } else { f64::NAN }
                    },
                )
                .collect();
            assert!(corner[0] <= c(0) && corner[1] <= c(1) && c(0) <= corner[2] && c(1) <= corner[3]);
        }
    }

    #[test]
    fn without_a_system_it_is_null_and_a_loss_is_told() {
        let (file, rows, found) = written(&CloudSettings::default(), &[]);
        let about = super::tests::about(&file);
        assert!(rows.is_empty() && found.is_empty() && about["columns"]["geometry"].get("bbox").is_none());
        assert_eq!(about["columns"]["geometry"].get("crs"), Some(&Value::Null));
        let columns = Some(vec![Column::Z, Column::X, Column::Y]);
        let crs = Some(r#"PROJCRS["mine",ID["EPSG",1]]"#.to_owned());
        let settings = CloudSettings { columns, crs, ..CloudSettings::default() };
        let (_, rows, found) = written(&settings, &[PointRecord::default()]);
        assert_eq!((rows.len(), found.items().len()), (1, 1));
    }
}
