//! Reads frames of points and the poses of their scanner from MCAP: messages `sensor_msgs/msg/PointCloud2`
//! and `tf2_msgs/msg/TFMessage`, in chunks that are not compressed, or outside of chunks.

use super::cdr::CdrReader;
use crate::frames::{Frame, FramePoint, FramePose};
use crate::{Attribute, AttributeSet};
use flate2::Crc;
use std::collections::HashMap;
use std::io::Read;
use std::path::Path;
use vlscan_base::diag::ProblemKind;
use vlscan_base::error::{Error, Result};
use vlscan_base::recognise::{Expected, FIRST_BYTES, foreign};

const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
/// Kind and length before the content of a record, bytes.
const HEAD_BYTES: usize = 9;
/// Maximum length of a record, bytes.
const MAX_RECORD_BYTES: u64 = 1 << 31;

const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0F;

/// Contents of a channel.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Points,
    Transforms,
}

/// State of reading a file.
#[derive(Default)]
struct Reader {
    schemas: HashMap<u16, Option<Kind>>,
    /// Contents and topics.
    channels: HashMap<u16, (Kind, String)>,
    /// The channel of the first frame.
    points: Option<u16>,
    /// Poses by child frame since the last frame.
    poses: HashMap<String, Vec<FramePose>>,
}

/// A message with the number of its channel.
#[derive(Debug, PartialEq)]
pub(super) struct Message {
    pub channel: u16,
    pub time_ns: u64,
    pub data: Vec<u8>,
}

/// The messages of a file that this program has written, with one message in each chunk.
pub(super) struct Messages<'a> {
    input: Input<'a>,
    bytes: Vec<u8>,
}

impl<'a> Messages<'a> {
    /// Begins to read a file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] for another file.
    pub fn begin(source: &'a mut dyn Read, path: &'a Path) -> Result<Messages<'a>> {
        let (mut input, mut bytes) = (Input { source, path, at: 0 }, Vec::new());
        input.read(MAGIC.len() as u64, &mut bytes)?;
        if bytes != MAGIC {
            return Err(wrong(path, "it is no MCAP"));
        }
        Ok(Messages { input, bytes })
    }

    /// The next message in the order of the file; `None` after the last one.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] for a file that is damaged or ends before.
    pub fn read_next(&mut self) -> Result<Option<Message>> {
        loop {
            let at = self.input.at;
            let kind = self.input.record(&mut self.bytes)?;
            if kind == DATA_END {
                return Ok(None);
            }
            if kind == CHUNK {
                let path = self.input.path;
                let message = message_of(&self.bytes[HEAD_BYTES..]);
                let damaged = || wrong(path, &format!("the record at byte {at} is damaged"));
                return message.map(Some).ok_or_else(damaged);
            }
        }
    }
}

/// The first message of the content of a chunk.
fn message_of(chunk: &[u8]) -> Option<Message> {
    let mut fields = Fields(chunk);
    // Two times, size and checksum; compression; size.
    fields.take(28)?;
    fields.string()?;
    fields.take(8)?;
    let kind = fields.take(1)?[0];
    fields.take(8)?;
    let channel = fields.u16()?;
    // Sequence and two times.
    fields.take(4)?;
    let time_ns = fields.u64()?;
    fields.take(8)?;
    (kind == MESSAGE).then(|| Message { channel, time_ns, data: fields.0.to_vec() })
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
    let mut input = Input { source, path, at: 0 };
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
        if kind == DATA_END {
            let damaged = || wrong(path, &format!("the record at byte {at} is damaged"));
            let stated = Fields(content).u32().ok_or_else(damaged)?;
            check_sum(stated, &sum, path, || format!("the data before byte {at}"))?;
            return input.check_summary();
        }
        reader.record((kind, at), content, path, take)?;
        sum.update(&bytes);
    }
}

/// Compares a checksum with the one in the file; 0 means that the file has none.
fn check_sum(stated: u32, sum: &Crc, path: &Path, what: impl Fn() -> String) -> Result<()> {
    if stated == 0 || stated == sum.sum() {
        return Ok(());
    }
    let message = format!("the checksum of {} does not match: the file is damaged", what());
    Err(wrong(path, &message))
}

/// A file that is being read.
struct Input<'a> {
    source: &'a mut dyn Read,
    path: &'a Path,
    /// Number of bytes that have been read.
    at: u64,
}

impl Input<'_> {
    /// Appends this many bytes of the file to `bytes`.
    fn read(&mut self, length: u64, bytes: &mut Vec<u8>) -> Result<()> {
        let read = Read::take(&mut *self.source, length).read_to_end(bytes);
        let read = read.map_err(|e| Error::io("read", self.path, e))? as u64;
        self.at += read;
        if read != length {
            let message = format!(
                "{}: the file ends within its records, after byte {}; is it truncated?",
                self.path.display(),
                self.at
            );
            return Err(Error::input_of(ProblemKind::Truncated, message));
        }
        Ok(())
    }

    /// Reads the next record with its head and returns its kind.
    fn record(&mut self, bytes: &mut Vec<u8>) -> Result<u8> {
        let at = self.at;
        bytes.clear();
        self.read(HEAD_BYTES as u64, bytes)?;
        let length = u64::from_le_bytes(std::array::from_fn(|i| bytes[1 + i]));
        if length > MAX_RECORD_BYTES {
            return Err(wrong(self.path, &format!("the record at byte {at} is longer than 2 GB")));
        }
        self.read(length, bytes)?;
        Ok(bytes[0])
    }

    /// Verifies the checksum of the summary, which is not used, and the end of the file.
    fn check_summary(mut self) -> Result<()> {
        let (mut sum, mut bytes) = (Crc::new(), Vec::new());
        loop {
            let at = self.at;
            if self.record(&mut bytes)? != FOOTER {
                sum.update(&bytes);
                continue;
            }
            // The checksum is the last field of the footer and includes the fields before it.
            let stated = bytes.len().checked_sub(4).filter(|at| *at >= HEAD_BYTES);
            let damaged = || wrong(self.path, &format!("the footer at byte {at} is damaged"));
            let (before, stated) = bytes.split_at(stated.ok_or_else(damaged)?);
            sum.update(before);
            let stated = Fields(stated).u32().ok_or_else(damaged)?;
            check_sum(stated, &sum, self.path, || format!("the summary before byte {at}"))?;
            bytes.clear();
            self.read(MAGIC.len() as u64, &mut bytes)?;
            return match bytes == MAGIC {
                true => Ok(()),
                false => Err(wrong(self.path, "it does not end as an MCAP does: the file is damaged")),
            };
        }
    }
}

fn wrong(path: &Path, message: &str) -> Error {
    Error::input(format!("{}: {message}", path.display()))
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
                let (topic, encoding) = fields.string().zip(fields.string()).ok_or_else(damaged)?;
                if let Some(Some(kind)) = self.schemas.get(&schema).filter(|_| encoding == "cdr") {
                    self.channels.insert(id, (*kind, topic.to_owned()));
                }
            }
            MESSAGE => {
                let id = fields.u16().ok_or_else(damaged)?;
                // Sequence and two times.
                fields.take(20).ok_or_else(damaged)?;
                match self.channels.get(&id).map(|(kind, _)| *kind) {
                    Some(Kind::Points) => {
                        self.check_single(id, path)?;
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
                    let length =
                        fields.u64().and_then(|length| usize::try_from(length).ok()).ok_or_else(damaged)?;
                    let inner = fields.take(length).ok_or_else(damaged)?;
                    if kind != CHUNK {
                        self.record((kind, at), inner, path, take)?;
                    }
                }
            }
            _ => {}
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

    /// Collects the transforms of a message.
    fn transforms(&mut self, message: &[u8]) -> Option<()> {
        /// Maximum number of poses that are kept per frame.
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
        let poses = self.poses.get_mut(name).map(|poses| {
            poses.sort_by_key(|pose| pose.time_ns);
            let all = poses.clone();
            // The last pose may be the first of the next frame, too.
            poses.drain(..poses.len().saturating_sub(1));
            all
        });
        Some(Frame { time_ns, attributes, points, poses: poses.unwrap_or_default() })
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
