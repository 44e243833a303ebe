//! E57 (ASTM E2807): a scan for each leg, with the pose of the scanner. Points are collected in a temporary
//! file, because the sections of a scan are completed one after the other.

use super::{NAMESPACE, SCAN_NAME};
use crate::columnar::{Column, ColumnType, LightColumns};
use crate::encode::{Ending, FileBody, PointEncoder};
use crate::out::{Offload, OutputStream};
use crate::record::{EncodedPoints, PointBatch};
use crate::settings::CloudSettings;
use ::e57::{
    E57Writer, Extension, Quaternion, Record, RecordDataType, RecordName, RecordValue, Transform, Translation,
};
use std::io::{BufReader, Cursor, Read, Seek};
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, scratch_failed};
use vlscan_crs as crs;
use vlscan_geom::DVec3;

/// Bytes of a collected point: leg, position, origin, time, intensity, return number and their number,
/// colour. Labels of the way of light follow.
const RECORD_BYTES: usize = 2 + 7 * 8 + 4 + 2 + 3;

/// Address of the namespace of the labels of the way of light.
const ADDRESS: &str = env!("CARGO_PKG_HOMEPAGE");

/// Bytes of points that are kept in memory.
const MAX_MEMORY_BYTES: usize = 1 << 16;

/// Encoder of points as collected points.
#[derive(Debug)]
struct E57 {
    /// World position of the origin of points, m.
    origin: DVec3,
    /// Name of the coordinate reference system.
    crs: Option<String>,
    /// True if points have the colour of the surface.
    colours: bool,
    /// Labels of the way of light.
    light: LightColumns,
}

/// E57 files.
pub(crate) fn e57(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    let crs = settings.crs.as_deref().map(crs::short_name);
    let (colours, light) = (settings.has_colours(), LightColumns::of(settings.columns.as_deref()));
    Ok(Arc::new(E57 { origin: settings.origin, crs, colours, light }))
}

impl PointEncoder for E57 {
    fn typical_bytes(&self) -> usize {
        RECORD_BYTES
    }

    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        out.extend(batch.points, |out, point| {
            let position = point.position + self.origin;
            out.extend(point.leg.to_le_bytes());
            for v in [position, point.origin + self.origin] {
                v.to_array().into_iter().for_each(|c| out.extend(c.to_le_bytes()));
            }
            out.extend(point.seconds().to_le_bytes());
            out.extend((point.amplitude as f32).to_le_bytes());
            out.extend(point.returns());
            out.extend(point.cause.colour);
            self.light.push_bytes(out, point, self.origin);
            Some(position)
        });
    }

    fn begin(self: Arc<Self>, _: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        Ok(Box::new(E57Body { encoder: self, memory: Vec::new(), file: None, count: 0 }))
    }
}

/// A point as it was collected.
struct Point {
    leg: u16,
    position: DVec3,
    origin: DVec3,
    time: f64,
    intensity: f32,
    returns: [u8; 2],
    colour: [u8; 3],
    /// Labels of the way of light as they were collected.
    light: Vec<u8>,
}

impl Point {
    fn decode(bytes: &[u8; RECORD_BYTES]) -> Point {
        let double = |i: usize| f64::from_le_bytes(std::array::from_fn(|b| bytes[2 + 8 * i + b]));
        Point {
            leg: u16::from_le_bytes([bytes[0], bytes[1]]),
            position: DVec3::new(double(0), double(1), double(2)),
            origin: DVec3::new(double(3), double(4), double(5)),
            time: double(6),
            intensity: f32::from_le_bytes(std::array::from_fn(|b| bytes[58 + b])),
            returns: [bytes[62], bytes[63]],
            colour: [bytes[64], bytes[65], bytes[66]],
            light: Vec::new(),
        }
    }
}

/// A file that is being written.
struct E57Body {
    encoder: Arc<E57>,
    /// Points that are not in the file.
    memory: Vec<u8>,
    file: Option<FileWriter>,
    count: u64,
}

impl FileBody for E57Body {
    fn append(&mut self, points: Vec<u8>, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        self.count += (points.len() / (RECORD_BYTES + self.encoder.light.width())) as u64;
        self.memory.extend_from_slice(&points);
        if self.memory.len() <= MAX_MEMORY_BYTES {
            return Ok(());
        }
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(out.sibling_scratch()?),
        };
        file.append(&self.memory)?;
        self.memory.clear();
        Ok(())
    }

    fn close_handle(&mut self) {
        self.file.iter_mut().for_each(FileWriter::close_handle);
        self.memory.shrink_to_fit();
    }

    /// Writes the scans.
    fn finish(&mut self, _: &Ending, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        let source: Box<dyn Read> = match self.file.take() {
            Some(mut file) => {
                file.append(&self.memory)?;
                file.rewind().map_err(|e| file.failed("read", e))?;
                Box::new(BufReader::new(file))
            }
            None => Box::new(Cursor::new(std::mem::take(&mut self.memory))),
        };
        let (colours, light) = (self.encoder.colours, self.encoder.light);
        let mut points = Points { source, left: self.count, light_bytes: light.width(), next: None };
        let mut file = out.sibling_scratch()?;
        let mut writer = E57Writer::new(&mut file, &guid(u64::MAX, self.count)).map_err(e57_failed)?;
        writer.set_coordinate_metadata(self.encoder.crs.clone());
        if !light.is_empty() {
            writer.register_extension(Extension::new(NAMESPACE, ADDRESS)).map_err(e57_failed)?;
        }
        let mut scan = 0;
        while let Some(first) = points.next()? {
            let mut cloud = writer
                .add_pointcloud(&guid(scan, self.count), prototype(colours, light))
                .map_err(e57_failed)?;
            cloud.set_name(Some(format!("{SCAN_NAME}{}", first.leg)));
            let DVec3 { x, y, z } = first.origin;
            let rotation = Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 };
            cloud.set_transform(Some(Transform { rotation, translation: Translation { x, y, z } }));
            let (leg, pose) = (first.leg, first.origin);
            let mut point = first;
            loop {
                cloud.add_point(values(&point, pose, (colours, light))).map_err(e57_failed)?;
                match points.next()? {
                    Some(next) if next.leg == leg => point = next,
                    next => {
                        points.next = next;
                        break;
                    }
                }
            }
            cloud.finalize().map_err(e57_failed)?;
            scan += 1;
        }
        writer.finalize().map_err(e57_failed)?;
        drop(writer);
        file.copy_to(|bytes| out.append(bytes))
    }
}

/// The collected points, in order.
struct Points {
    source: Box<dyn Read>,
    left: u64,
    /// Bytes of the labels of a point.
    light_bytes: usize,
    /// A point that has been read ahead.
    next: Option<Point>,
}

impl Points {
    fn next(&mut self) -> Result<Option<Point>> {
        if let Some(point) = self.next.take() {
            return Ok(Some(point));
        }
        if self.left == 0 {
            return Ok(None);
        }
        self.left -= 1;
        let mut bytes = [0; RECORD_BYTES];
        self.source.read_exact(&mut bytes).map_err(scratch_failed)?;
        let mut light = vec![0; self.light_bytes];
        self.source.read_exact(&mut light).map_err(scratch_failed)?;
        Ok(Some(Point { light, ..Point::decode(&bytes) }))
    }
}

/// The fields of a point, in the frame of its scan: axes as in the world, origin at the scanner.
fn prototype(colours: bool, light: LightColumns) -> Vec<Record> {
    let double = RecordDataType::Double { min: None, max: None };
    let single = RecordDataType::Single { min: None, max: None };
    let count = RecordDataType::Integer { min: 0, max: 255 };
    let colour = [RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue]
        .map(|name| (name, count.clone()));
    [
        (RecordName::CartesianX, double.clone()),
        (RecordName::CartesianY, double.clone()),
        (RecordName::CartesianZ, double.clone()),
        (RecordName::Intensity, single),
        (RecordName::TimeStamp, double),
        (RecordName::ReturnIndex, count.clone()),
        (RecordName::ReturnCount, count),
    ]
    .into_iter()
    .chain(colour.into_iter().filter(|_| colours))
    .chain(light.iter().map(label_field))
    .map(|(name, data_type)| Record { name, data_type })
    .collect()
}

/// The field of a label of the way of light.
fn label_field(label: Column) -> (RecordName, RecordDataType) {
    let (namespace, name) = (NAMESPACE.to_owned(), LightColumns::small_name(label).to_owned());
    let data_type = match label.kind() {
        ColumnType::U8 => RecordDataType::Integer { min: 0, max: i64::from(u8::MAX) },
        ColumnType::U32 => RecordDataType::Integer { min: 0, max: i64::from(u32::MAX) },
        _ => RecordDataType::Double { min: None, max: None },
    };
    (RecordName::Unknown { namespace, name }, data_type)
}

/// The labels of the way of light of a point, whose positions are in the frame of its scan.
fn label_values(light: LightColumns, mut bytes: &[u8], pose: DVec3) -> Vec<RecordValue> {
    let value = |label: Column| {
        let (own, rest) = bytes.split_at(label.kind().width());
        bytes = rest;
        let mut all = [0; 8];
        all[..own.len()].copy_from_slice(own);
        let origin = match label {
            Column::SurfaceX => pose.x,
            Column::SurfaceY => pose.y,
            Column::SurfaceZ => pose.z,
            // Whole numbers are little-endian, so that the bytes behind them are zeros.
            _ => return RecordValue::Integer(i64::from_le_bytes(all)),
        };
        RecordValue::Double(f64::from_le_bytes(all) - origin)
    };
    light.iter().map(value).collect()
}

fn values(point: &Point, pose: DVec3, (colours, light): (bool, LightColumns)) -> Vec<RecordValue> {
    let local = point.position - pose;
    let [number, count] = point.returns;
    let mut values = vec![
        RecordValue::Double(local.x),
        RecordValue::Double(local.y),
        RecordValue::Double(local.z),
        RecordValue::Single(point.intensity),
        RecordValue::Double(point.time),
        // Counted from 0.
        RecordValue::Integer(i64::from(number.saturating_sub(1))),
        RecordValue::Integer(i64::from(count)),
    ];
    if colours {
        values.extend(point.colour.map(|component| RecordValue::Integer(component.into())));
    }
    values.extend(label_values(light, &point.light, pose));
    values
}

/// An identifier that depends on the content alone, so that the same run gives the same bytes.
fn guid(scan: u64, points: u64) -> String {
    let hash = xxhash_rust::xxh3::xxh3_128(&[scan.to_le_bytes(), points.to_le_bytes()].concat());
    let hex = format!("{hash:032x}");
    format!("{{{}-{}-{}-{}-{}}}", &hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..])
}

fn e57_failed(e: ::e57::Error) -> Error {
    match e {
        ::e57::Error::Write { .. } | ::e57::Error::Read { .. } => {
            scratch_failed(std::io::Error::other(e.to_string()))
        }
        e => Error::Internal(format!("E57: {e}")),
    }
}
