//! MCAP (<https://mcap.dev/spec>) for robotics: points as messages `sensor_msgs/msg/PointCloud2` of ROS 2, as the driver of the
//! instrument would publish them. A message is a frame, a revolution of the instrument or a span of time, with points in the
//! axes of the scanner, relative to where their beam left it.

mod container;

use crate::encode::{Ending, FileBody, PointEncoder};
use crate::out::{Offload, OutputStream};
use crate::record::{EncodedPoints, PointBatch};
use crate::settings::{CloudSettings, SOFTWARE, state};
use container::{Container, Text};
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_geom::DVec3;

/// Points of a message at most; a frame with more becomes several messages.
const MAX_POINTS: usize = 1 << 22;

/// Bytes before a collected point: start of its frame, and time after it, ns.
const TIMES_BYTES: usize = 16;

/// Bytes of a point in a message.
const POINT_BYTES: usize = 28;

/// Place of the time after the start of the frame in a point.
const TIME_AT: usize = 16;

/// The fields of a point: name, place, datatype of `sensor_msgs/msg/PointField`.
const FIELDS: [(&str, u32, u8); 9] = [
    ("x", 0, FLOAT32),
    ("y", 4, FLOAT32),
    ("z", 8, FLOAT32),
    ("intensity", 12, FLOAT32),
    ("time", TIME_AT as u32, FLOAT32),
    ("ring", 20, UINT16),
    ("return_number", 22, UINT8),
    ("number_of_returns", 23, UINT8),
    ("label", 24, INT32),
];
const UINT8: u8 = 2;
const UINT16: u8 = 4;
const INT32: u8 = 5;
const FLOAT32: u8 = 7;

/// The coordinate frame of the points.
const FRAME_ID: &str = "lidar";
const TOPIC: &str = "/points";

/// The message and the messages inside it, in the interface language of ROS 2.
const SCHEMA: &str = "\
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
================================================================================
MSG: sensor_msgs/PointField
string name
uint32 offset
uint8 datatype
uint32 count
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// Encoder of points as collected points. `ring` is the channel of the scanner, `label` the class. Frames begin at the multiples
/// of their duration.
#[derive(Debug)]
struct Mcap {
    /// World position of the origin of points, m.
    origin: DVec3,
}

/// MCAP files.
pub(crate) fn mcap(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    Ok(Arc::new(Mcap { origin: settings.origin }))
}

impl PointEncoder for Mcap {
    fn typical_bytes(&self) -> usize {
        TIMES_BYTES + POINT_BYTES
    }

    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        out.extend(batch.points, |out, point| {
            let begin = (libm::floor(point.time_ns / batch.frame_ns) * batch.frame_ns).max(0.0) as u64;
            // Whole seconds, which are exact.
            let origin = (point.time_origin.max(0.0) * 1e9) as u64;
            out.extend((origin + begin).to_le_bytes());
            out.extend((point.time_ns - begin as f64).to_le_bytes());
            point.in_scanner.to_array().into_iter().for_each(|c| out.extend((c as f32).to_le_bytes()));
            out.extend((point.amplitude as f32).to_le_bytes());
            out.extend([0; 4]);
            out.extend(point.device_u16().to_le_bytes());
            out.extend(point.returns());
            out.extend(point.class.to_le_bytes());
            Some(point.position + self.origin)
        });
    }

    fn begin(self: Arc<Self>, out: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        let schema = Text { name: "sensor_msgs/msg/PointCloud2", encoding: "ros2msg", text: SCHEMA };
        let container = Container::begin(SOFTWARE, &schema, TOPIC, out)?;
        Ok(Box::new(McapBody { container, begin: 0, points: Vec::new() }))
    }
}

/// A file that is being written, with the points of the frame that is not complete.
struct McapBody {
    container: Container,
    /// Start of the frame, ns.
    begin: u64,
    points: Vec<u8>,
}

impl FileBody for McapBody {
    /// Appends collected points, in order of emission.
    fn append(&mut self, collected: Vec<u8>, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        for record in collected.chunks_exact(TIMES_BYTES + POINT_BYTES) {
            let (times, point) = record.split_at(TIMES_BYTES);
            let begin = u64::from_le_bytes(std::array::from_fn(|i| times[i]));
            let after = f64::from_le_bytes(std::array::from_fn(|i| times[8 + i]));
            if begin != self.begin || self.points.len() >= MAX_POINTS * POINT_BYTES {
                self.publish(out)?;
                self.begin = begin;
            }
            let from = self.points.len() + TIME_AT;
            self.points.extend_from_slice(point);
            let after = (after / 1e9) as f32;
            self.points[from..from + 4].copy_from_slice(&after.to_le_bytes());
        }
        Ok(())
    }

    /// Writes the last message and the index.
    fn finish(&mut self, end: &Ending, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        self.publish(out)?;
        self.container.finish(&[("state", state(end.is_partial))], out)
    }
}

impl McapBody {
    /// Writes the message of the frame, if it has points.
    fn publish(&mut self, out: &mut OutputStream) -> Result<()> {
        if self.points.is_empty() {
            return Ok(());
        }
        let head = cloud_head(self.begin, (self.points.len() / POINT_BYTES) as u32);
        // The last byte says that all points are numbers.
        self.container.message(self.begin, &[&head, &self.points, &[1]], out)?;
        self.points.clear();
        Ok(())
    }
}

/// Returns a message with this many points up to their bytes, as CDR: little-endian, aligned to the size of each value.
fn cloud_head(stamp_ns: u64, points: u32) -> Vec<u8> {
    let mut cdr = Cdr(vec![0, 1, 0, 0]);
    cdr.word((stamp_ns / 1_000_000_000) as u32);
    cdr.word((stamp_ns % 1_000_000_000) as u32);
    cdr.string(FRAME_ID);
    cdr.word(1);
    cdr.word(points);
    cdr.word(FIELDS.len() as u32);
    for (name, at, datatype) in FIELDS {
        cdr.string(name);
        cdr.word(at);
        cdr.0.push(datatype);
        cdr.word(1);
    }
    // Not big-endian.
    cdr.0.push(0);
    cdr.word(POINT_BYTES as u32);
    let bytes = points * POINT_BYTES as u32;
    cdr.word(bytes);
    cdr.word(bytes);
    cdr.0
}

/// Bytes of a message, after the four of its encapsulation.
struct Cdr(Vec<u8>);

impl Cdr {
    fn word(&mut self, value: u32) {
        self.0.resize(self.0.len().next_multiple_of(4), 0);
        self.0.extend(value.to_le_bytes());
    }

    fn string(&mut self, text: &str) {
        self.word(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_lie_beside_each_other() {
        let mut at = 0;
        for (name, place, datatype) in FIELDS {
            assert_eq!(place, at, "{name}");
            at += match datatype {
                UINT8 => 1,
                UINT16 => 2,
                _ => 4,
            };
        }
        assert_eq!(at as usize, POINT_BYTES);
    }

    #[test]
    fn values_of_messages_are_aligned() {
        let head = cloud_head(3_000_000_007, 5);
        let word = |at: usize| u32::from_le_bytes(head[at..at + 4].try_into().unwrap());
        assert_eq!((word(4), word(8), word(12), &head[16..22]), (3, 7, 6, &b"lidar\0"[..]));
        // Height and width follow the text, aligned.
        assert_eq!((word(24), word(28), word(32)), (1, 5, FIELDS.len() as u32));
        let end = head.len();
        assert_eq!((word(end - 12), word(end - 8), word(end - 4)), (28, 140, 140));
    }
}
