//! Reads frames of points and the poses of their scanner from MCAP: messages `sensor_msgs/msg/PointCloud2` and `tf2_msgs/msg/TFMessage`,
//! in chunks that are not compressed, or outside of chunks.

use super::cdr::CdrReader;
use crate::frames::{Frame, FramePoint, FramePose};
use std::collections::HashMap;
use std::io::{self, Read};
use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::error::{Error, Result};

const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
/// Longest record that is read, bytes.
const MAX_RECORD_BYTES: u64 = 1 << 31;

const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0F;

/// What a channel carries.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Points,
    Transforms,
}

/// What is known of a file so far.
#[derive(Default)]
struct Reader {
    schemas: HashMap<u16, Option<Kind>>,
    channels: HashMap<u16, Kind>,
    /// Poses by child frame since the last frame.
    poses: HashMap<String, Vec<FramePose>>,
}

/// Calls `take` with the frames of a file, in order.
///
/// # Errors
/// [`Error::Io`]; [`Error::Input`] for a file that is no MCAP or damaged, and those of `take`.
pub(crate) fn read_frames(
    source: &mut dyn Read,
    path: &Path,
    take: &mut dyn FnMut(Frame) -> Result<()>,
) -> Result<()> {
    let mut start = [0; 8];
    let failed = |e: io::Error| match e.kind() {
        io::ErrorKind::UnexpectedEof => wrong(path, "the file ends within its records; is it truncated?"),
        _ => Error::io("read", path, e),
    };
    source.read_exact(&mut start).map_err(failed)?;
    if start != MAGIC {
        return Err(wrong(
            path,
            "it is no MCAP; frames are read from MCAP, as vlscan run -o points.mcap writes it",
        ));
    }
    let mut reader = Reader::default();
    let mut content = Vec::new();
    loop {
        let mut head = [0; 9];
        source.read_exact(&mut head).map_err(failed)?;
        let length = u64::from_le_bytes(std::array::from_fn(|i| head[1 + i]));
        if length > MAX_RECORD_BYTES {
            return Err(wrong(path, "a record is longer than 2 GB"));
        }
        content.clear();
        let read = Read::take(&mut *source, length).read_to_end(&mut content).map_err(failed)?;
        if read as u64 != length {
            return Err(wrong(path, "the file ends within its records; is it truncated?"));
        }
        match reader.record(head[0], &content, path, take)? {
            ControlFlow::Continue(()) => {}
            ControlFlow::Break(()) => return Ok(()),
        }
    }
}

fn wrong(path: &Path, message: &str) -> Error {
    Error::input(format!("{}: {message}", path.display()))
}

impl Reader {
    fn record(
        &mut self,
        kind: u8,
        content: &[u8],
        path: &Path,
        take: &mut dyn FnMut(Frame) -> Result<()>,
    ) -> Result<ControlFlow<()>> {
        let damaged = || wrong(path, "a record is damaged");
        let mut fields = Fields(content);
        match kind {
            SCHEMA => {
                let (id, name) = fields.u16().zip(fields.string()).ok_or_else(damaged)?;
                let kind = match name {
                    "sensor_msgs/msg/PointCloud2" => Some(Kind::Points),
                    "tf2_msgs/msg/TFMessage" => Some(Kind::Transforms),
                    _ => None,
                };
                self.schemas.insert(id, kind);
            }
            CHANNEL => {
                let (id, schema) = fields.u16().zip(fields.u16()).ok_or_else(damaged)?;
                let (_, encoding) = fields.string().zip(fields.string()).ok_or_else(damaged)?;
                if let Some(Some(kind)) = self.schemas.get(&schema).filter(|_| encoding == "cdr") {
                    self.channels.insert(id, *kind);
                }
            }
            MESSAGE => {
                let id = fields.u16().ok_or_else(damaged)?;
                // Sequence and two times.
                fields.take(20).ok_or_else(damaged)?;
                match self.channels.get(&id).copied() {
                    Some(Kind::Points) => {
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
            CHUNK => {
                // Two times, size and checksum.
                fields.take(28).ok_or_else(damaged)?;
                let compression = fields.string().ok_or_else(damaged)?;
                if !compression.is_empty() {
                    let message = format!(
                        "its chunks are compressed ({compression}); write them without compression, \
                         for example with: mcap convert --compression none"
                    );
                    return Err(wrong(path, &message));
                }
                fields.take(8).ok_or_else(damaged)?;
                while !fields.0.is_empty() {
                    let kind = fields.take(1).ok_or_else(damaged)?[0];
                    let length =
                        fields.u64().and_then(|length| usize::try_from(length).ok()).ok_or_else(damaged)?;
                    let inner = fields.take(length).ok_or_else(damaged)?;
                    if kind != CHUNK {
                        let _ = self.record(kind, inner, path, take)?;
                    }
                }
            }
            DATA_END => return Ok(ControlFlow::Break(())),
            _ => {}
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Collects the transforms of a message.
    fn transforms(&mut self, message: &[u8]) -> Option<()> {
        /// Most poses of a frame that are kept.
        const MAX_POSES: usize = 1 << 16;
        let mut cdr = CdrReader::new(message)?;
        for _ in 0..cdr.word()? {
            let (time_ns, _) = cdr.header()?;
            let child = cdr.string()?.to_owned();
            let pose = FramePose { time_ns, position: cdr.vector()?, rotation: cdr.rotation()? };
            let poses = self.poses.entry(child).or_default();
            if poses.len() < MAX_POSES {
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
        });
        let points = points.collect();
        let poses = self.poses.get_mut(name).map(|poses| {
            poses.sort_by_key(|pose| pose.time_ns);
            let all = poses.clone();
            // The last pose may be the first of the next frame, too.
            poses.drain(..poses.len().saturating_sub(1));
            all
        });
        Some(Frame { time_ns, points, poses: poses.unwrap_or_default() })
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

/// A whole number of such a type; 0 for floats. The bytes are at hand.
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

/// Little-endian values of a record, from its beginning.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn u16(&mut self) -> Option<u16> {
        self.take(2)?.try_into().ok().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take(4)?.try_into().ok().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.take(8)?.try_into().ok().map(u64::from_le_bytes)
    }

    fn string(&mut self) -> Option<&'a str> {
        let length = self.u32()? as usize;
        std::str::from_utf8(self.take(length)?).ok()
    }
}
