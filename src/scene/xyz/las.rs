//! Points of LAS and LAZ files (ASPRS LAS 1.0–1.4): positions and classes.

use super::points::{BATCH, Batches, Point};
use crate::damage;
use crate::geom::DVec3;
use laz::las::selective::DecompressionSelection;
use laz::{LasZipDecompressor, LazVlr};
use std::io::{Cursor, Seek};

/// Shortest records of formats 0 to 10, bytes.
const SHORTEST: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// The bit of the format that says that records are compressed, and those of the format itself.
const COMPRESSED: u8 = 0x80;
const FORMAT: u8 = 0x3f;

/// Whether bytes claim to be such a file.
pub(super) fn is_las(bytes: &[u8]) -> bool {
    bytes.starts_with(b"LASF")
}

/// The points of a file from first to last.
pub(super) struct Cloud<'a> {
    records: Records<'a>,
    header: Header,
    record: Vec<u8>,
    at: u64,
}

enum Records<'a> {
    Plain(&'a [u8]),
    Compressed(Box<Compressed<'a>>),
}

/// Compressed records, and where what follows them must be checked before it is decompressed.
struct Compressed<'a> {
    decompressor: LasZipDecompressor<'a, Cursor<&'a [u8]>>,
    /// In layered chunks the number of layers, and the first record of the next chunk.
    layers: Option<usize>,
    next_chunk: u64,
}

/// What the header says of the records.
struct Header {
    format: u8,
    record_length: u16,
    count: u64,
    scale: DVec3,
    offset: DVec3,
}

/// The numbers of a file, or why there are none.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn bytes<const N: usize>(&self, at: usize) -> Result<[u8; N], String> {
        let end = at.checked_add(N).filter(|end| *end <= self.0.len());
        let bytes = end.and_then(|end| self.0[at..end].try_into().ok());
        bytes.ok_or_else(|| "the file ends within its header".to_owned())
    }

    fn u16(&self, at: usize) -> Result<u16, String> {
        self.bytes(at).map(u16::from_le_bytes)
    }

    fn u32(&self, at: usize) -> Result<u32, String> {
        self.bytes(at).map(u32::from_le_bytes)
    }

    fn u64(&self, at: usize) -> Result<u64, String> {
        self.bytes(at).map(u64::from_le_bytes)
    }

    fn vector(&self, at: usize) -> Result<DVec3, String> {
        let f64 = |at| self.bytes(at).map(f64::from_le_bytes);
        Ok(DVec3::new(f64(at)?, f64(at + 8)?, f64(at + 16)?))
    }
}

impl<'a> Cloud<'a> {
    /// The points of a file's bytes.
    pub fn open(bytes: &'a [u8]) -> Result<Cloud<'a>, String> {
        let read = Reader(bytes);
        let [major, minor] = read.bytes(24)?;
        let (header_size, data_at, format) =
            (read.u16(94)?, read.u32(96)? as usize, read.bytes::<1>(104)?[0]);
        let legacy_count = u64::from(read.u32(107)?);
        let count = match (minor >= 4 && header_size >= 375, legacy_count) {
            (true, _) => read.u64(247)?,
            (false, count) => count,
        };
        let header = Header {
            format: format & FORMAT,
            record_length: read.u16(105)?,
            count,
            scale: read.vector(131)?,
            offset: read.vector(155)?,
        };
        let shortest = SHORTEST.get(usize::from(header.format)).filter(|_| major == 1 && minor <= 4);
        let Some(shortest) = shortest else {
            return Err(format!(
                "expected LAS 1.0 to 1.4 with points of format 0 to 10, found version {major}.{minor} and format {}",
                header.format
            ));
        };
        if header.record_length < *shortest {
            return Err(format!(
                "expected at least {shortest} bytes per point of format {}, found {}",
                header.format, header.record_length
            ));
        }
        if !(header.scale.is_finite() && header.offset.is_finite() && header.scale.cmpne(DVec3::ZERO).all()) {
            return Err(format!(
                "expected finite scales and offsets, found {} and {}",
                header.scale, header.offset
            ));
        }
        if data_at > bytes.len() {
            return Err(format!("the points begin at byte {data_at}, the file ends at {}", bytes.len()));
        }
        let records = if format & COMPRESSED == 0 {
            Records::Plain(&bytes[data_at..])
        } else {
            Records::Compressed(Box::new(catch_decoder_panic(|| Compressed::open(&read, data_at, &header))?))
        };
        let record = vec![0; usize::from(header.record_length)];
        Ok(Cloud { records, header, record, at: 0 })
    }

    fn read_record(&mut self) -> Result<(), String> {
        let (at, count) = (self.at, self.header.count);
        let ended = |why: &str| format!("{why} after {at} of {count} points; is the file whole?");
        match &mut self.records {
            Records::Plain(rest) => {
                let Some((record, more)) = rest.split_at_checked(self.record.len()) else {
                    return Err(ended("the file ends"));
                };
                self.record.copy_from_slice(record);
                *rest = more;
            }
            Records::Compressed(laz) => {
                laz.check_chunk(at, self.record.len()).map_err(|e| ended(&e))?;
                let read = laz.decompressor.decompress_one(&mut self.record);
                read.map_err(|e| ended(&format!("the points cannot be decompressed ({e})")))?;
            }
        }
        Ok(())
    }

    fn point(&self) -> Point {
        let record = &self.record;
        let int = |at: usize| {
            f64::from(i32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]))
        };
        let class = if self.header.format < 6 { record[15] & 0x1f } else { record[16] };
        let position = DVec3::new(int(0), int(4), int(8)) * self.header.scale + self.header.offset;
        Point { position, normal: None, class }
    }
}

impl Batches for Cloud<'_> {
    fn next(&mut self, room: &mut Vec<Point>) -> Result<bool, String> {
        let end = self.header.count.min(self.at + BATCH as u64);
        catch_decoder_panic(|| {
            while self.at < end {
                self.read_record()?;
                room.push(self.point());
                self.at += 1;
            }
            Ok(())
        })?;
        Ok(self.at < self.header.count)
    }
}

/// Does what leads through `laz`.
fn catch_decoder_panic<T>(read: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    let done = damage::catch_decoder_panic(read);
    done.unwrap_or_else(|| Err("its compressed points make no sense; is the file whole?".to_owned()))
}

impl<'a> Compressed<'a> {
    fn open(read: &Reader<'a>, data_at: usize, header: &Header) -> Result<Compressed<'a>, String> {
        let record = laszip_record(read)?;
        let (items, layers) = Compressed::items(record)?;
        if items != u32::from(header.record_length) {
            let length = header.record_length;
            return Err(format!("expected {length} bytes per point, the compression is for {items}"));
        }
        let vlr = LazVlr::from_buffer(record).map_err(|e| e.to_string())?;
        check_chunk_table(read, data_at, header.count)?;
        let mut source = Cursor::new(read.0);
        source.set_position(data_at as u64);
        let wanted = DecompressionSelection::xy_returns_channel().decompress_z().decompress_classification();
        let decompressor = LasZipDecompressor::selective(source, vlr, wanted).map_err(|e| e.to_string())?;
        Ok(Compressed { decompressor, layers, next_chunk: 0 })
    }

    /// The sum of the items' sizes, and how many layers they make if they are layered.
    fn items(record: &[u8]) -> Result<(u32, Option<usize>), String> {
        const POINT_14: u16 = 10;
        const BYTES_14: u16 = 14;
        const RGB_NIR_14: u16 = 12;
        let read = Reader(record);
        let (mut size, mut layers, mut layered) = (0, 0, false);
        for item in 0..usize::from(read.u16(32)?) {
            let (kind, bytes) = (read.u16(34 + 6 * item)?, read.u16(36 + 6 * item)?);
            size += u32::from(bytes);
            layered |= kind >= POINT_14;
            layers += match kind {
                POINT_14 => 9,
                BYTES_14 => usize::from(bytes),
                RGB_NIR_14 => 2,
                _ => 1,
            };
        }
        Ok((size, layered.then_some(layers)))
    }

    /// Whether the layers of the chunk that begins with point number `at`, if one does, are within the file: they are
    /// given room before they are read.
    fn check_chunk(&mut self, at: u64, record_length: usize) -> Result<(), String> {
        let Some(layers) = self.layers.filter(|_| at == self.next_chunk) else { return Ok(()) };
        let source = self.decompressor.get_mut();
        let start = source.stream_position().map_err(|e| e.to_string())?;
        let read = Reader(source.get_ref());
        let counts = usize::try_from(start).ok().and_then(|s| s.checked_add(record_length));
        let counts = counts.ok_or("a chunk begins beyond the file's end")?;
        let points = u64::from(read.u32(counts)?);
        let mut left = read.0.len() as u64;
        for layer in 0..layers {
            let size = u64::from(read.u32(counts + 4 + 4 * layer)?);
            left = left.checked_sub(size).ok_or("a chunk is longer than the file")?;
        }
        let vlr = self.decompressor.vlr();
        let size = if vlr.uses_variable_size_chunks() { points } else { u64::from(vlr.chunk_size()) };
        self.next_chunk = at.saturating_add(size.max(1));
        Ok(())
    }
}

/// The record that says how points are compressed.
fn laszip_record<'a>(read: &Reader<'a>) -> Result<&'a [u8], String> {
    const HEADER: usize = 54;
    let mut at = usize::from(read.u16(94)?);
    for _ in 0..read.u32(100)? {
        let user: [u8; 16] = read.bytes(at + 2)?;
        let (id, length) = (read.u16(at + 18)?, usize::from(read.u16(at + 20)?));
        let data = at + HEADER..at + HEADER + length;
        if user.starts_with(LazVlr::USER_ID.as_bytes()) && id == LazVlr::RECORD_ID {
            return read.0.get(data).ok_or_else(|| "the file ends within its header".to_owned());
        }
        at = data.end;
    }
    Err("compressed points, but nothing says how".to_owned())
}

/// Whether the table of chunks, for which room is made before it is read, is no longer than the file can hold.
fn check_chunk_table(read: &Reader, data_at: usize, points: u64) -> Result<(), String> {
    let Ok(mut at) = read.u64(data_at) else { return Err("the file ends before its points".to_owned()) };
    if at <= data_at as u64 || at >= i64::MAX as u64 {
        // Whoever could not go back to write it there has put it at the end.
        at = read.u64(read.0.len().saturating_sub(8))?;
    }
    let Ok(at) = usize::try_from(at) else { return Ok(()) };
    let chunks = at.checked_add(4).and_then(|at| read.u32(at).ok()).unwrap_or(0);
    if u64::from(chunks) > points.saturating_add(1).min(read.0.len() as u64) {
        return Err(format!("a table of {chunks} chunks for {points} points"));
    }
    Ok(())
}
