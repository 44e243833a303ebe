//! Records of MCAP: schemas with a channel each, a chunk for each message, and the index at the end. Chunks,
//! the data section and the summary have checksums (CRC-32), as <https://mcap.dev/spec> defines them.

use crate::out::OutputStream;
use flate2::Crc;
use vlscan_base::error::Result;

/// First and last bytes of a file.
pub(super) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Kinds of records.
pub(super) mod op {
    pub const HEADER: u8 = 0x01;
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const MESSAGE_INDEX: u8 = 0x07;
    pub const CHUNK_INDEX: u8 = 0x08;
    pub const STATISTICS: u8 = 0x0B;
    pub const METADATA: u8 = 0x0C;
    pub const METADATA_INDEX: u8 = 0x0D;
    pub const SUMMARY_OFFSET: u8 = 0x0E;
    pub const DATA_END: u8 = 0x0F;
}

/// Bytes of a record before its content: kind and length.
const RECORD_HEAD_BYTES: u64 = 9;
/// Bytes of the content of a footer.
const FOOTER_BYTES: u64 = 20;
/// Bytes of a message before its data.
const MESSAGE_HEAD_BYTES: u64 = 22;

/// A channel with its schema, whose numbers are the same, from 1; 0 means none.
pub struct ChannelPlan<'a> {
    pub topic: &'a str,
    /// Type of the messages, and their definition in the interface language of ROS 2.
    pub message: &'a str,
    pub definition: &'a str,
}

/// A file that is being written.
pub struct Container {
    schemas: Vec<u8>,
    channels: Vec<u8>,
    /// Number of messages of each channel.
    counts: Vec<u32>,
    /// Times and places of the chunks.
    chunks: Vec<Chunk>,
    /// Checksum of all bytes before the end of the data section.
    sum: Crc,
}

/// A chunk with one message.
struct Chunk {
    /// Index of the channel.
    channel: usize,
    time_ns: u64,
    at: u64,
    bytes: u64,
    records_bytes: u64,
}

/// The number of a channel in records.
fn id(channel: usize) -> u16 {
    channel as u16 + 1
}

impl Container {
    pub fn begin(library: &str, plans: &[ChannelPlan], out: &mut OutputStream) -> Result<Container> {
        let header = Content::default().string("ros2").string(library);
        let (mut schemas, mut channels) = (Vec::new(), Vec::new());
        for (i, plan) in plans.iter().enumerate() {
            let schema = Content::default().u16(id(i)).string(plan.message).string("ros2msg");
            schemas.extend(schema.string(plan.definition).record(op::SCHEMA));
            let channel = Content::default().u16(id(i)).u16(id(i)).string(plan.topic).string("cdr").u32(0);
            channels.extend(channel.record(op::CHANNEL));
        }
        let start = [&MAGIC[..], &header.record(op::HEADER), &schemas, &channels].concat();
        let (counts, chunks, sum) = (vec![0; plans.len()], Vec::new(), Crc::new());
        let mut container = Container { schemas, channels, counts, chunks, sum };
        container.append(&start, out)?;
        Ok(container)
    }

    /// Appends bytes of the data section.
    fn append(&mut self, bytes: &[u8], out: &mut OutputStream) -> Result<()> {
        self.sum.update(bytes);
        out.append(bytes)
    }

    /// Appends a message of the channel of this index that consists of these pieces.
    pub fn message(
        &mut self,
        channel: usize,
        time_ns: u64,
        pieces: &[&[u8]],
        out: &mut OutputStream,
    ) -> Result<()> {
        let data: u64 = pieces.iter().map(|piece| piece.len() as u64).sum();
        let records_bytes = RECORD_HEAD_BYTES + MESSAGE_HEAD_BYTES + data;
        let sequence = self.counts[channel];
        self.counts[channel] += 1;
        let message = Content(record_head(op::MESSAGE, MESSAGE_HEAD_BYTES + data));
        let message = message.u16(id(channel)).u32(sequence).u64(time_ns).u64(time_ns).0;
        let mut sum = Crc::new();
        std::iter::once(&&message[..]).chain(pieces).for_each(|piece| sum.update(piece));
        // Times of the first and the last message, size and checksum, no compression.
        let head = Content::default().u64(time_ns).u64(time_ns).u64(records_bytes).u32(sum.sum()).string("");
        let head = head.u64(records_bytes).0;
        let at = out.len();
        self.append(&record_head(op::CHUNK, head.len() as u64 + records_bytes), out)?;
        self.append(&head, out)?;
        out.append(&message)?;
        pieces.iter().try_for_each(|piece| out.append(piece))?;
        self.sum.combine(&sum);
        self.chunks.push(Chunk { channel, time_ns, at, bytes: out.len() - at, records_bytes });
        // The message is at the beginning of its chunk.
        let index = Content::default().u16(id(channel)).u32(16).u64(time_ns).u64(0);
        self.append(&index.record(op::MESSAGE_INDEX), out)
    }

    /// Writes the facts about the file, and the index.
    pub fn finish(&mut self, about: &[(&str, &str)], out: &mut OutputStream) -> Result<()> {
        let metadata = Content::default().string("vlscan").map(about).record(op::METADATA);
        let metadata_at = out.len();
        self.append(&metadata, out)?;
        out.append(&Content::default().u32(self.sum.sum()).record(op::DATA_END))?;
        let summary_at = out.len();
        let metadata_index = Content::default().u64(metadata_at).u64(metadata.len() as u64).string("vlscan");
        let groups = [
            (op::SCHEMA, self.schemas.clone()),
            (op::CHANNEL, self.channels.clone()),
            (op::STATISTICS, self.statistics()),
            (op::CHUNK_INDEX, self.chunks.iter().flat_map(Chunk::index).collect()),
            (op::METADATA_INDEX, metadata_index.record(op::METADATA_INDEX)),
        ];
        let (mut offsets, mut sum) = (Vec::new(), Crc::new());
        for (kind, records) in groups.iter().filter(|(_, records)| !records.is_empty()) {
            let offset = Content::default().u8(*kind).u64(out.len()).u64(records.len() as u64);
            offsets.extend(offset.record(op::SUMMARY_OFFSET));
            sum.update(records);
            out.append(records)?;
        }
        let offsets_at = out.len();
        // The checksum of the summary includes that of the footer up to the checksum itself.
        let footer = Content(record_head(op::FOOTER, FOOTER_BYTES)).u64(summary_at).u64(offsets_at);
        [&offsets, &footer.0].into_iter().for_each(|bytes| sum.update(bytes));
        out.append(&offsets)?;
        out.append(&footer.u32(sum.sum()).0)?;
        out.append(&MAGIC)
    }

    fn statistics(&self) -> Vec<u8> {
        let times = || self.chunks.iter().map(|chunk| chunk.time_ns);
        let messages = self.chunks.len() as u64;
        let channels = self.counts.len();
        let counts =
            self.counts.iter().enumerate().fold(Content::default(), |list, (channel, count)| {
                list.u16(id(channel)).u64(u64::from(*count))
            });
        let mut content = Content::default()
            .u64(messages)
            .u16(channels as u16)
            .u32(channels as u32)
            // Attachments, metadata, chunks.
            .u32(0)
            .u32(1)
            .u32(messages as u32)
            .u64(times().min().unwrap_or(0))
            .u64(times().max().unwrap_or(0))
            .u32(counts.0.len() as u32);
        // Messages by channel.
        content.0.extend(counts.0);
        content.record(op::STATISTICS)
    }
}

impl Chunk {
    /// The record of the summary with the position of the chunk.
    fn index(&self) -> Vec<u8> {
        // The index of the message follows the chunk.
        let index_bytes = RECORD_HEAD_BYTES + 2 + 4 + 16;
        let content = Content::default().u64(self.time_ns).u64(self.time_ns).u64(self.at).u64(self.bytes);
        let content =
            content.u32(10).u16(id(self.channel)).u64(self.at + self.bytes).u64(index_bytes).string("");
        content.u64(self.records_bytes).u64(self.records_bytes).record(op::CHUNK_INDEX)
    }
}

/// Kind and length of a record.
fn record_head(kind: u8, bytes: u64) -> Vec<u8> {
    Content::default().u8(kind).u64(bytes).0
}

/// The content of a record: little-endian values, texts and lists with their length in bytes before them.
#[derive(Default)]
struct Content(Vec<u8>);

impl Content {
    fn u8(mut self, value: u8) -> Content {
        self.0.push(value);
        self
    }

    fn u16(mut self, value: u16) -> Content {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u32(mut self, value: u32) -> Content {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u64(mut self, value: u64) -> Content {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn string(self, text: &str) -> Content {
        let mut content = self.u32(text.len() as u32);
        content.0.extend(text.as_bytes());
        content
    }

    fn map(self, pairs: &[(&str, &str)]) -> Content {
        let list = pairs.iter().fold(Content::default(), |list, (key, value)| list.string(key).string(value));
        let mut content = self.u32(list.0.len() as u32);
        content.0.extend(list.0);
        content
    }

    fn record(self, kind: u8) -> Vec<u8> {
        [record_head(kind, self.0.len() as u64), self.0].concat()
    }
}
