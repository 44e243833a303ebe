//! MCAP (<https://mcap.dev/spec>) for robotics: points as messages `sensor_msgs/msg/PointCloud2` of ROS 2, as
//! the driver of the instrument would publish them. A message is a frame, a revolution of the instrument or a
//! span of time, with points in the axes of the scanner, relative to where their beam left it. The poses of
//! the scanner are transforms and odometry.
//!
//! | file | what it does |
//! |---|---|
//! | `container`, `records` | records of MCAP, written and read; messages that are read |
//! | `cdr`, `schemas` | messages as bytes; their definitions |
//! | `poses` | transforms and odometry |
//! | `read` | frames with their poses |
//! | `points` | points of frames in the world |
//! | `merge` | files of several scanners as one |

mod cdr;
mod container;
mod merge;
mod points;
mod poses;
mod read;
mod records;
mod schemas;

pub(crate) use merge::merge;
pub(crate) use points::read_points;
pub(crate) use read::read_frames;

use crate::columnar::{Column, ColumnType, LightColumns};
use crate::encode::{Ending, FileBody, PointEncoder};
use crate::out::{Offload, OutputStream};
use crate::record::{EncodedPoints, PointBatch};
use crate::settings::{CloudSettings, FrameNames, Rings, SOFTWARE, state};
use cdr::CdrWriter;
use container::{ChannelPlan, Container};
use poses::{POSE_BYTES, Pose, PoseTrack};
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_geom::{DVec3, Rotation};

/// Points of a message at most; a frame with more becomes several messages.
const MAX_POINTS: usize = 1 << 22;

/// Bytes before a collected point: start of its frame, time after it, ns, and pose of the scanner.
const HEAD_BYTES: usize = 16 + POSE_BYTES;

/// Bytes of a point in a message.
const POINT_BYTES: usize = 32;

/// Optional fields of points.
#[derive(Clone, Copy, Debug, Default)]
struct Optional {
    /// The colour of the surface.
    colours: bool,
    /// The radial velocity.
    velocities: bool,
    /// Labels of the way of light; positions are in the world.
    light: LightColumns,
}

/// Bytes of a point in a message, with its optional fields.
fn point_bytes(optional: Optional) -> usize {
    let of = |is_there: bool| if is_there { OPTIONAL_BYTES } else { 0 };
    POINT_BYTES + of(optional.colours) + of(optional.velocities) + optional.light.width()
}

/// Place of the time after the start of the frame in a point.
const TIME_AT: usize = 16;

/// The fields of a point: name, place, datatype of `sensor_msgs/msg/PointField`.
const FIELDS: [(&str, u32, u8); 10] = [
    ("x", 0, FLOAT32),
    ("y", 4, FLOAT32),
    ("z", 8, FLOAT32),
    ("intensity", 12, FLOAT32),
    ("time", TIME_AT as u32, FLOAT32),
    ("ring", 20, UINT16),
    ("return_number", 22, UINT8),
    ("number_of_returns", 23, UINT8),
    ("label", 24, INT32),
    ("instance", 28, INT32),
];
/// Red, green and blue in the bits of a number, blue in the lowest eight; as a float, which programs expect.
const COLOUR: &str = "rgb";
/// Radial velocity, m/s, positive away from the sensor.
const VELOCITY: &str = "doppler";
/// Bytes of an optional field.
const OPTIONAL_BYTES: usize = 4;
const UINT8: u8 = 2;
const UINT16: u8 = 4;
const INT32: u8 = 5;
const UINT32: u8 = 6;
const FLOAT32: u8 = 7;
const FLOAT64: u8 = 8;

/// Datatype of a label of the way of light.
fn datatype_of(label: Column) -> u8 {
    match label.kind() {
        ColumnType::U8 => UINT8,
        ColumnType::U32 => UINT32,
        _ => FLOAT64,
    }
}

/// The channels, by their index.
const CHANNELS: [ChannelPlan; 3] = [
    ChannelPlan {
        topic: "/points",
        message: "sensor_msgs/msg/PointCloud2",
        definition: schemas::POINT_CLOUD,
    },
    ChannelPlan { topic: "/tf", message: "tf2_msgs/msg/TFMessage", definition: schemas::TRANSFORMS },
    ChannelPlan { topic: "/odom", message: "nav_msgs/msg/Odometry", definition: schemas::ODOMETRY },
];
const POINTS: usize = 0;
const TRANSFORMS: usize = 1;
const ODOMETRY: usize = 2;

/// Encoder of points as collected points. `ring` is the row of the channel by elevation, `label` the class,
/// `instance` the object. Frames begin at the multiples of their duration.
#[derive(Debug)]
struct Mcap {
    /// World position of the origin of points, m.
    origin: DVec3,
    names: FrameNames,
    rings: Rings,
    optional: Optional,
}

/// MCAP files.
pub(crate) fn mcap(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    let (names, rings) = (settings.frame_names.clone(), settings.rows());
    let (colours, velocities) = (settings.has_colours(), settings.has_velocities());
    let optional = Optional { colours, velocities, light: LightColumns::of(settings.columns.as_deref()) };
    Ok(Arc::new(Mcap { origin: settings.origin, names, rings, optional }))
}

impl PointEncoder for Mcap {
    fn typical_bytes(&self) -> usize {
        HEAD_BYTES + POINT_BYTES
    }

    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        out.extend(batch.points, |out, point| {
            let begin = (libm::floor(point.time_ns / batch.frame_ns) * batch.frame_ns).max(0.0) as u64;
            // Whole seconds, which are exact.
            let origin = (point.time_origin.max(0.0) * 1e9) as u64;
            out.extend((origin + begin).to_le_bytes());
            out.extend((point.time_ns - begin as f64).to_le_bytes());
            Pose::put(point.origin + self.origin, point.scanner.unwrap_or(UNKNOWN), out);
            point.in_scanner.to_array().into_iter().for_each(|c| out.extend((c as f32).to_le_bytes()));
            out.extend((point.amplitude as f32).to_le_bytes());
            out.extend([0; 4]);
            out.extend(self.rings.of(point).to_le_bytes());
            out.extend(point.returns());
            out.extend(point.class.to_le_bytes());
            out.extend(point.object.to_le_bytes());
            if self.optional.colours {
                let [red, green, blue] = point.cause.colour;
                out.extend([blue, green, red, 0]);
            }
            if self.optional.velocities {
                out.extend((point.cause.velocity[0] as f32).to_le_bytes());
            }
            self.optional.light.push_bytes(out, point, self.origin);
            Some(point.position + self.origin)
        });
    }

    fn begin(self: Arc<Self>, out: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        let container = Container::begin(SOFTWARE, &CHANNELS, out)?;
        let (names, track, optional) = (self.names.clone(), PoseTrack::default(), self.optional);
        Ok(Box::new(McapBody { container, names, optional, track, begin: 0, points: Vec::new() }))
    }
}

/// The attitude of a scanner with an unknown attitude, which has no poses.
const UNKNOWN: Rotation = Rotation { w: 0.0, u: DVec3::ZERO };

/// A file that is being written, with the points of the frame that is not complete.
struct McapBody {
    container: Container,
    names: FrameNames,
    optional: Optional,
    track: PoseTrack,
    /// Start of the frame, ns.
    begin: u64,
    points: Vec<u8>,
}

impl FileBody for McapBody {
    /// Appends collected points, in order of emission.
    fn append(&mut self, collected: Vec<u8>, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        let length = point_bytes(self.optional);
        for record in collected.chunks_exact(HEAD_BYTES + length) {
            let (head, point) = record.split_at(HEAD_BYTES);
            let begin = u64::from_le_bytes(std::array::from_fn(|i| head[i]));
            let after = f64::from_le_bytes(std::array::from_fn(|i| head[8 + i]));
            if begin != self.begin || self.points.len() >= MAX_POINTS * length {
                self.publish(out)?;
                self.begin = begin;
            }
            let pose = Pose::get(begin + after.max(0.0).round() as u64, &head[16..]);
            if pose.rotation != UNKNOWN
                && let Some(pose) = self.track.next(pose, self.points.is_empty())
            {
                self.publish_pose(pose, out)?;
            }
            let from = self.points.len() + TIME_AT;
            self.points.extend_from_slice(point);
            let after = (after / 1e9) as f32;
            self.points[from..from + 4].copy_from_slice(&after.to_le_bytes());
        }
        Ok(())
    }

    /// Writes the last messages and the index.
    fn finish(&mut self, end: &Ending, out: &mut OutputStream, _: &dyn Offload) -> Result<()> {
        self.publish(out)?;
        self.publish_odometry(None, out)?;
        self.container.finish(&[("state", state(end.is_partial))], out)
    }
}

impl McapBody {
    /// Writes the message of the frame, if it has points, after its last pose.
    fn publish(&mut self, out: &mut OutputStream) -> Result<()> {
        if self.points.is_empty() {
            return Ok(());
        }
        if let Some(pose) = self.track.end_frame() {
            self.publish_pose(pose, out)?;
        }
        let count = (self.points.len() / point_bytes(self.optional)) as u32;
        let head = cloud_head(self.begin, &self.names.sensor, count, self.optional);
        // The last byte marks all points as finite.
        self.container.message(POINTS, self.begin, &[&head, &self.points, &[1]], out)?;
        self.points.clear();
        Ok(())
    }

    fn publish_pose(&mut self, pose: Pose, out: &mut OutputStream) -> Result<()> {
        let transform = poses::transform(&pose, &self.names);
        self.container.message(TRANSFORMS, pose.time_ns, &[&transform], out)?;
        self.publish_odometry(Some(pose), out)
    }

    /// Writes the odometry of the pose before `next`.
    fn publish_odometry(&mut self, next: Option<Pose>, out: &mut OutputStream) -> Result<()> {
        let Some((pose, step)) = self.track.odometry(next) else { return Ok(()) };
        let message = poses::odometry(&pose, &step, &self.names);
        self.container.message(ODOMETRY, pose.time_ns, &[&message], out)
    }
}

/// Returns a message with this many points up to their bytes.
fn cloud_head(stamp_ns: u64, frame: &str, points: u32, optional: Optional) -> Vec<u8> {
    let more = [optional.colours.then_some(COLOUR), optional.velocities.then_some(VELOCITY)];
    let more = more.into_iter().flatten().map(|name| (name, FLOAT32, OPTIONAL_BYTES));
    let labels = optional
        .light
        .iter()
        .map(|label| (LightColumns::small_name(label), datatype_of(label), label.kind().width()));
    let mut fields: Vec<(&str, u32, u8)> = FIELDS.to_vec();
    let mut at = POINT_BYTES;
    for (name, datatype, bytes) in more.chain(labels) {
        fields.push((name, at as u32, datatype));
        at += bytes;
    }
    let mut cdr = CdrWriter::new();
    cdr.header(stamp_ns, frame);
    cdr.word(1);
    cdr.word(points);
    cdr.word(fields.len() as u32);
    for (name, at, datatype) in fields {
        cdr.string(name);
        cdr.word(at);
        cdr.byte(datatype);
        cdr.word(1);
    }
    // Not big-endian.
    cdr.byte(0);
    let length = point_bytes(optional) as u32;
    cdr.word(length);
    let bytes = points * length;
    cdr.word(bytes);
    cdr.word(bytes);
    cdr.0
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
        let head = cloud_head(3_000_000_007, "lidar", 5, Optional::default());
        let word = |at: usize| u32::from_le_bytes(head[at..at + 4].try_into().unwrap());
        assert_eq!((word(4), word(8), word(12), &head[16..22]), (3, 7, 6, &b"lidar\0"[..]));
        // Height and width follow the text, aligned.
        assert_eq!((word(24), word(28), word(32)), (1, 5, FIELDS.len() as u32));
        let end = head.len();
        assert_eq!((word(end - 12), word(end - 8), word(end - 4)), (32, 160, 160));
    }
}
