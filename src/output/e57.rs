//! E57 (ASTM E2807): a scan for each leg, with the pose of the scanner. Points are collected in an unnamed file, because the
//! sections of a scan are completed one after the other.

use super::codec::{LegFacts, PointCodec, byte, seconds};
use super::stream::OutputStream;
use crate::error::{Error, Result};
use crate::geom::DVec3;
use crate::pulse::Echo;
use ::e57::{E57Writer, Quaternion, Record, RecordDataType, RecordName, RecordValue, Transform, Translation};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, Write};
use std::path::Path;

/// Bytes of a collected point: leg, position, origin, time, intensity, return number and their number.
const RECORD_BYTES: usize = 2 + 7 * 8 + 4 + 2;

/// Bytes that are copied at once.
const COPIED_BYTES: usize = 1 << 16;

/// Encoder of echoes as collected points.
pub(super) struct E57Codec {
    pub shift: DVec3,
}

impl PointCodec for E57Codec {
    const TYPICAL_BYTES: usize = RECORD_BYTES;

    fn push(&self, out: &mut Vec<u8>, leg: &LegFacts, echo: &Echo) -> Option<DVec3> {
        let position = echo.position + self.shift;
        out.extend(leg.number.to_le_bytes());
        for v in [position, echo.origin + self.shift] {
            v.to_array().into_iter().for_each(|c| out.extend(c.to_le_bytes()));
        }
        out.extend(seconds(echo.time_ns).to_le_bytes());
        out.extend((echo.intensity as f32).to_le_bytes());
        out.extend([byte(echo.return_number), byte(echo.number_of_returns)]);
        Some(position)
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
        }
    }
}

/// A file that is being written.
pub(super) struct E57Stream {
    points: BufWriter<File>,
    count: u64,
}

impl E57Stream {
    pub fn new() -> Result<E57Stream> {
        let points = BufWriter::new(tempfile::tempfile().map_err(scratch_failed)?);
        Ok(E57Stream { points, count: 0 })
    }

    pub fn append(&mut self, points: &[u8]) -> Result<()> {
        self.count += (points.len() / RECORD_BYTES) as u64;
        self.points.write_all(points).map_err(scratch_failed)
    }

    /// Writes the scans. `crs` is the name of the coordinate reference system.
    pub fn finish(self, crs: Option<&str>, out: &mut OutputStream) -> Result<()> {
        let mut points = self.points.into_inner().map_err(|e| scratch_failed(e.into_error()))?;
        points.rewind().map_err(scratch_failed)?;
        let mut points = Points { file: BufReader::new(points), left: self.count, next: None };
        let mut file = tempfile::tempfile().map_err(scratch_failed)?;
        let writable = file.try_clone().map_err(scratch_failed)?;
        let mut writer = E57Writer::new(writable, &guid(u64::MAX, self.count)).map_err(e57_failed)?;
        writer.set_coordinate_metadata(crs.map(str::to_owned));
        let mut scan = 0;
        while let Some(first) = points.next()? {
            let mut cloud =
                writer.add_pointcloud(&guid(scan, self.count), prototype()).map_err(e57_failed)?;
            cloud.set_name(Some(format!("leg {}", first.leg)));
            let DVec3 { x, y, z } = first.origin;
            let rotation = Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 };
            cloud.set_transform(Some(Transform { rotation, translation: Translation { x, y, z } }));
            let (leg, pose) = (first.leg, first.origin);
            let mut point = first;
            loop {
                cloud.add_point(values(&point, pose)).map_err(e57_failed)?;
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
        file.rewind().map_err(scratch_failed)?;
        let mut bytes = vec![0; COPIED_BYTES];
        loop {
            match file.read(&mut bytes).map_err(scratch_failed)? {
                0 => return Ok(()),
                n => out.append(&bytes[..n])?,
            }
        }
    }
}

/// The collected points, in order.
struct Points {
    file: BufReader<File>,
    left: u64,
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
        self.file.read_exact(&mut bytes).map_err(scratch_failed)?;
        Ok(Some(Point::decode(&bytes)))
    }
}

/// The fields of a point, in the frame of its scan: axes as in the world, origin at the scanner.
fn prototype() -> Vec<Record> {
    let double = RecordDataType::Double { min: None, max: None };
    let single = RecordDataType::Single { min: None, max: None };
    let count = RecordDataType::Integer { min: 0, max: 255 };
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
    .map(|(name, data_type)| Record { name, data_type })
    .collect()
}

fn values(point: &Point, pose: DVec3) -> Vec<RecordValue> {
    let local = point.position - pose;
    let [number, count] = point.returns;
    vec![
        RecordValue::Double(local.x),
        RecordValue::Double(local.y),
        RecordValue::Double(local.z),
        RecordValue::Single(point.intensity),
        RecordValue::Double(point.time),
        // Counted from 0.
        RecordValue::Integer(i64::from(number.saturating_sub(1))),
        RecordValue::Integer(i64::from(count)),
    ]
}

/// An identifier that depends on the content alone, so that the same run gives the same bytes.
fn guid(scan: u64, points: u64) -> String {
    let hash = xxhash_rust::xxh3::xxh3_128(&[scan.to_le_bytes(), points.to_le_bytes()].concat());
    let hex = format!("{hash:032x}");
    format!("{{{}-{}-{}-{}-{}}}", &hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..])
}

fn scratch_failed(e: std::io::Error) -> Error {
    Error::io("write", Path::new("a temporary file"), e)
}

fn e57_failed(e: ::e57::Error) -> Error {
    match e {
        ::e57::Error::Write { .. } | ::e57::Error::Read { .. } => {
            scratch_failed(std::io::Error::other(e.to_string()))
        }
        e => Error::Internal(format!("E57: {e}")),
    }
}
