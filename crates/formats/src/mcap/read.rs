//! Reads frames of points and the poses of their scanner from MCAP: messages `sensor_msgs/msg/PointCloud2`
//! and `tf2_msgs/msg/TFMessage`, in chunks that are not compressed, or outside of chunks.

use super::cdr::CdrReader;
use super::container::{MAGIC, op};
use super::records::{Fields, HEAD_BYTES, Input, check_sum, wrong};
use crate::frames::{Frame, FramePoint, FramePose};
use crate::{Attribute, AttributeSet};
use flate2::Crc;
use std::collections::HashMap;
use std::io::Read;
use std::path::Path;
use vlscan_base::error::{Error, Result};
use vlscan_base::recognise::{Expected, FIRST_BYTES, foreign};

/// Maximum number of poses that are kept for a message of points.
const MAX_POSES: usize = 1 << 16;

/// Contents of a channel.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Points,
    Transforms,
}

/// State of reading a file.
#[derive(Default)]
struct Reader {
    /// True if this program wrote the file.
    is_own: bool,
    schemas: HashMap<u16, Option<Kind>>,
    /// Contents and topics.
    channels: HashMap<u16, (Kind, String)>,
    /// The channel of the first frame.
    points: Option<u16>,
    /// Poses by child frame since the last frame.
    poses: HashMap<String, Vec<FramePose>>,
    /// The frame in which the poses of each child frame are.
    parents: HashMap<String, String>,
}

/// Calls `take` with the frames of a file, in order.
///
/// # Errors
/// [`Error::Io`]; [`Error::Input`] for a file that is not MCAP or is damaged, by its checksums; and the
/// errors of `take`. Damage may be detected after frames were taken.
pub(crate) fn read_frames(
    source: &mut dyn Read,
    path: &Path,
    take: &mut dyn FnMut(Frame) -> Result<()>,
) -> Result<()> {
    let mut first = Vec::new();
    Read::take(&mut *source, FIRST_BYTES as u64)
        .read_to_end(&mut first)
        .map_err(|e| Error::io("read", path, e))?;
    if let Some(found) = foreign(path, &first, &Expected::LOG) {
        return Err(found.error(path));
    }
    let source: &mut dyn Read = &mut first.as_slice().chain(source);
    let mut input = Input::new(source, path);
    let mut bytes = Vec::new();
    input.read(MAGIC.len() as u64, &mut bytes)?;
    if bytes != MAGIC {
        return Err(wrong(
            path,
            "it is no MCAP; frames are read from MCAP, as vlscan run -o points.mcap writes it",
        ));
    }
    let (mut reader, mut sum) = (Reader::default(), Crc::new());
    sum.update(&bytes);
    loop {
        let at = input.at;
        let kind = input.record(&mut bytes)?;
        let content = &bytes[HEAD_BYTES..];
        if kind == op::DATA_END {
            let damaged = || wrong(path, &format!("the record at byte {at} is damaged"));
            let stated = Fields(content).u32().ok_or_else(damaged)?;
            check_sum(stated, &sum, path, || format!("the data before byte {at}"))?;
            return input.check_summary();
        }
        reader.record((kind, at), content, path, take)?;
        sum.update(&bytes);
    }
}

impl Reader {
    fn record(
        &mut self,
        (kind, at): (u8, u64),
        content: &[u8],
        path: &Path,
        take: &mut dyn FnMut(Frame) -> Result<()>,
    ) -> Result<()> {
        let damaged = || wrong(path, &format!("the record at byte {at} is damaged"));
        let mut fields = Fields(content);
        match kind {
            op::HEADER => {
                // The profile, and the program.
                let program = fields.string().and_then(|_| fields.string());
                self.is_own = program.is_some_and(|program| program.starts_with("vlscan "));
            }
            op::SCHEMA => {
                let (id, name) = fields.u16().zip(fields.string()).ok_or_else(damaged)?;
                let kind = match name {
                    "sensor_msgs/msg/PointCloud2" => Some(Kind::Points),
                    "tf2_msgs/msg/TFMessage" => Some(Kind::Transforms),
                    _ => None,
                };
                self.schemas.insert(id, kind);
            }
            op::CHANNEL => {
                let (id, schema) = fields.u16().zip(fields.u16()).ok_or_else(damaged)?;
                let (topic, encoding) = fields.string().zip(fields.string()).ok_or_else(damaged)?;
                if let Some(Some(kind)) = self.schemas.get(&schema).filter(|_| encoding == "cdr") {
                    self.channels.insert(id, (*kind, topic.to_owned()));
                }
            }
            op::MESSAGE => {
                let id = fields.u16().ok_or_else(damaged)?;
                // Sequence and two times.
                fields.take(20).ok_or_else(damaged)?;
                match self.channels.get(&id).map(|(kind, _)| *kind) {
                    Some(Kind::Points) => {
                        self.check_single(id, path)?;
                        self.check_poses(fields.0, path)?;
                        let frame = self.frame(fields.0).ok_or_else(|| {
                            wrong(
                                path,
                                "a message of points is damaged, or has no fields x, y and z of float32",
                            )
                        })?;
                        take(frame)?;
                    }
                    Some(Kind::Transforms) => {
                        self.transforms(fields.0)
                            .ok_or_else(|| wrong(path, "a message of transforms is damaged"))?;
                    }
                    None => {}
                }
            }
            op::CHUNK => self.chunk(at, fields, path, take)?,
            _ => {}
        }
        Ok(())
    }

    /// Takes the records of the chunk at a byte of the file.
    fn chunk(
        &mut self,
        at: u64,
        mut fields: Fields,
        path: &Path,
        take: &mut dyn FnMut(Frame) -> Result<()>,
    ) -> Result<()> {
        let damaged = || wrong(path, &format!("the record at byte {at} is damaged"));
        // Two times and the size.
        fields.take(24).ok_or_else(damaged)?;
        let stated = fields.u32().ok_or_else(damaged)?;
        let compression = fields.string().ok_or_else(damaged)?;
        if !compression.is_empty() {
            let message = format!(
                "its chunks are compressed ({compression}); write them without compression, \
                 for example with: mcap convert --compression none"
            );
            return Err(wrong(path, &message));
        }
        fields.take(8).ok_or_else(damaged)?;
        if stated != 0 {
            let mut sum = Crc::new();
            sum.update(fields.0);
            check_sum(stated, &sum, path, || format!("the chunk at byte {at}"))?;
        }
        while !fields.0.is_empty() {
            let kind = fields.take(1).ok_or_else(damaged)?[0];
            let length = fields.u64().and_then(|length| usize::try_from(length).ok()).ok_or_else(damaged)?;
            let inner = fields.take(length).ok_or_else(damaged)?;
            if kind != op::CHUNK {
                self.record((kind, at), inner, path, take)?;
            }
        }
        Ok(())
    }

    /// Checks that points are of one channel, as those of a single scanner are.
    fn check_single(&mut self, channel: u16, path: &Path) -> Result<()> {
        let first = *self.points.get_or_insert(channel);
        if first == channel {
            return Ok(());
        }
        let topic = |id: u16| self.channels.get(&id).map_or("", |(_, topic)| topic.as_str());
        Err(Error::input_with_help(
            format!(
                "{}: it has the points of several scanners, on {} and {}",
                path.display(),
                topic(first),
                topic(channel)
            ),
            "give each [[scanner]] an MCAP file of its own",
        ))
    }

    /// Checks the poses of the points of a message: none was dropped, and they are not relative to a frame
    /// that has poses itself, since transforms are not combined.
    fn check_poses(&self, message: &[u8], path: &Path) -> Result<()> {
        let header = CdrReader::new(message).and_then(|mut cdr| cdr.header());
        let Some((_, name)) = header else { return Ok(()) };
        if self.poses.get(name).is_some_and(|poses| poses.len() > MAX_POSES) {
            return Err(Error::input_with_help(
                format!(
                    "{}: a message of points follows more than {MAX_POSES} poses of {name}",
                    path.display()
                ),
                "write shorter frames (--frame-s), or begin the recording with the points",
            ));
        }
        let Some(parent) = self.parents.get(name).filter(|parent| self.poses.contains_key(*parent)) else {
            return Ok(());
        };
        Err(Error::input_with_help(
            format!(
                "{}: the poses of {name} are relative to {parent}, which has poses itself",
                path.display()
            ),
            "write the poses of the scanner in the world to /tf: transforms are not combined",
        ))
    }

    /// Collects the transforms of a message.
    fn transforms(&mut self, message: &[u8]) -> Option<()> {
        let mut cdr = CdrReader::new(message)?;
        for _ in 0..cdr.word()? {
            let (time_ns, parent) = cdr.header()?;
            let child = cdr.string()?;
            let pose = FramePose { time_ns, position: cdr.vector()?, rotation: cdr.rotation()? };
            if self.parents.get(child).is_none_or(|known| known != parent) {
                self.parents.insert(child.to_owned(), parent.to_owned());
            }
            let poses = self.poses.entry(child.to_owned()).or_default();
            let place = |pose: &FramePose| (pose.position, pose.rotation);
            let is_other = poses.last().is_none_or(|last| place(last) != place(&pose));
            // One more than the maximum shows that others are missing.
            if poses.len() < MAX_POSES || (poses.len() == MAX_POSES && is_other) {
                poses.push(pose);
            }
        }
        Some(())
    }

    /// A message of points with the poses of its frame.
    fn frame(&mut self, message: &[u8]) -> Option<Frame> {
        const FLOAT32: u8 = 7;
        let mut cdr = CdrReader::new(message)?;
        let (time_ns, name) = cdr.header()?;
        let (height, width) = (cdr.word()?, cdr.word()?);
        let mut places: HashMap<&str, (usize, u8)> = HashMap::new();
        for _ in 0..cdr.word()? {
            let name = cdr.string()?;
            let (at, kind) = (cdr.word()? as usize, cdr.byte()?);
            cdr.word()?;
            places.insert(name, (at, kind));
        }
        let is_big_endian = cdr.byte()? != 0;
        let step = cdr.word()? as usize;
        cdr.word()?;
        let length = cdr.word()? as usize;
        let data = cdr.take(length)?;
        let float_at = |name: &str| places.get(name).filter(|(_, kind)| *kind == FLOAT32).map(|(at, _)| *at);
        let at = [float_at("x")?, float_at("y")?, float_at("z")?];
        let count = (height as usize).checked_mul(width as usize)?;
        let has_room = places.values().all(|(at, kind)| at.saturating_add(size_of_kind(*kind)) <= step);
        if is_big_endian || step == 0 || !has_room || count.checked_mul(step)? > data.len() {
            return None;
        }
        let (intensity, time) = (float_at("intensity"), float_at("time"));
        let number = |record: &[u8], name: &str| -> i64 {
            places.get(name).map_or(0, |(at, kind)| whole(&record[*at..], *kind))
        };
        let float = |record: &[u8], at: usize| f32::from_le_bytes(std::array::from_fn(|i| record[at + i]));
        let points = data.chunks_exact(step).take(count).map(|record| FramePoint {
            position: at.map(|at| float(record, at)),
            intensity: intensity.map_or(0.0, |at| float(record, at)),
            time_s: time.map_or(0.0, |at| float(record, at)),
            ring: number(record, "ring"),
            class: number(record, "label"),
            instance: number(record, "instance"),
            return_number: number(record, "return_number"),
            number_of_returns: number(record, "number_of_returns"),
            path: number(record, "path"),
        });
        let points = points.collect();
        let attributes = AttributeSet::of(|attribute| match attribute {
            Attribute::X | Attribute::Y | Attribute::Z | Attribute::Time => true,
            Attribute::Intensity => intensity.is_some(),
            Attribute::Class => places.contains_key("label"),
            Attribute::Object => places.contains_key("instance"),
            Attribute::ReturnNumber => places.contains_key("return_number"),
            Attribute::NumberOfReturns => places.contains_key("number_of_returns"),
            Attribute::Path => places.contains_key("path"),
            _ => false,
        });
        let has_misses = self.is_own;
        let poses = self.poses.get_mut(name).map(|poses| {
            poses.sort_by_key(|pose| pose.time_ns);
            let all = poses.clone();
            // The last pose may be the first of the next frame, too.
            poses.drain(..poses.len().saturating_sub(1));
            all
        });
        Some(Frame { time_ns, attributes, has_misses, points, poses: poses.unwrap_or_default() })
    }
}

/// Bytes of a datatype of `sensor_msgs/msg/PointField`.
fn size_of_kind(kind: u8) -> usize {
    match kind {
        1 | 2 => 1,
        3 | 4 => 2,
        5..=7 => 4,
        _ => 8,
    }
}

/// A whole number of such a type; 0 for floats. The bytes are available.
fn whole(bytes: &[u8], kind: u8) -> i64 {
    let four = || std::array::from_fn::<u8, 4, _>(|i| bytes[i]);
    match kind {
        1 => i64::from(bytes[0] as i8),
        2 => i64::from(bytes[0]),
        3 => i64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
        4 => i64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        5 => i64::from(i32::from_le_bytes(four())),
        6 => i64::from(u32::from_le_bytes(four())),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mcap::cdr::CdrWriter;
    use vlscan_geom::{DVec3, Rotation};

    /// A message with the pose of a child frame.
    fn transform(parent: &str, child: &str, position: DVec3) -> Vec<u8> {
        let mut out = CdrWriter::new();
        out.word(1);
        out.header(0, parent);
        out.string(child);
        out.vector(position);
        out.rotation(Rotation::IDENTITY);
        out.0
    }

    #[test]
    fn poses_relative_to_a_frame_with_poses_are_an_error() {
        let mut points = CdrWriter::new();
        points.header(0, "lidar");
        let mut reader = Reader::default();
        for (parent, child, is_in_world) in
            [("world", "lidar", true), ("base", "lidar", true), ("world", "base", false)]
        {
            reader.transforms(&transform(parent, child, DVec3::ZERO)).unwrap();
            match reader.check_poses(&points.0, Path::new("a.mcap")) {
                Err(Error::Input(problems)) => {
                    let text = problems.text();
                    assert!(!is_in_world && text.contains("lidar are relative to base"), "{text}");
                }
                other => assert!(is_in_world && other.is_ok(), "{parent} {child}"),
            }
        }
    }

    #[test]
    fn poses_that_are_dropped_are_an_error_unless_the_scanner_stands() {
        let mut points = CdrWriter::new();
        points.header(0, "lidar");
        let pose = FramePose { time_ns: 0, position: DVec3::ZERO, rotation: Rotation::IDENTITY };
        let poses = HashMap::from([("lidar".to_owned(), vec![pose; MAX_POSES])]);
        let mut reader = Reader { poses, ..Reader::default() };
        for (position, is_enough) in [(DVec3::ZERO, true), (DVec3::X, false), (DVec3::ZERO, false)] {
            reader.transforms(&transform("world", "lidar", position)).unwrap();
            let checked = reader.check_poses(&points.0, Path::new("a.mcap"));
            assert_eq!((checked.is_ok(), reader.poses["lidar"].len() > MAX_POSES), (is_enough, !is_enough));
        }
    }
}
