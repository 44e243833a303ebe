//! LAS and LAZ files (ASPRS LAS 1.0 to 1.4, point formats 0 to 10).

use super::{Attribute, BATCH_POINTS, Columns, PointReader, PointRow};
use crate::damage;
use crate::geom::DVec3;
use laz::las::selective::DecompressionSelection;
use laz::{LasZipDecompressor, LazVlr};
use std::io::{Cursor, Seek};

/// Lengths of a record of point formats 0 to 10 without extra bytes, bytes.
const MIN_RECORD_BYTES: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// Maximum length of a compressed record, bytes: the decompressor takes up to 16 kB of memory per byte of it.
const MAX_COMPRESSED_RECORD_BYTES: u16 = 4096;

/// Bit of the format byte that marks compressed records; the bits of the format itself.
const COMPRESSED: u8 = 0x80;
const FORMAT: u8 = 0x3f;

/// Whether a file begins with the signature of LAS files.
pub fn is_las(bytes: &[u8]) -> bool {
    bytes.starts_with(b"LASF")
}

/// Reads the points of a file from first to last.
pub struct LasReader<'a> {
    file: Fields<'a>,
    records: Records<'a>,
    pub header: Header,
    record: Vec<u8>,
    at: u64,
    intensity: Option<ExtraDimension>,
    object: Option<ExtraDimension>,
    device: Option<ExtraDimension>,
}

enum Records<'a> {
    Plain(&'a [u8]),
    Compressed(Box<Compressed<'a>>),
}

struct Compressed<'a> {
    decompressor: LasZipDecompressor<'a, Cursor<&'a [u8]>>,
    /// Number of layers of a chunk, if chunks are layered.
    layers: Option<usize>,
    /// Number of the first point of the next chunk. The layers of that chunk are checked before they are decompressed.
    next_chunk: u64,
}

/// The properties of the records, from the header of a file.
#[derive(Clone, Debug)]
pub struct Header {
    /// Point format, 0 to 10.
    pub format: u8,
    pub count: u64,
    record_length: u16,
    scale: DVec3,
    offset: DVec3,
    centre: DVec3,
}

/// Which fields of compressed records are decompressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selection {
    /// Position and class only.
    PositionAndClass,
    /// All fields.
    All,
}

/// Little-endian numbers in the bytes of a file.
#[derive(Clone, Copy)]
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn bytes<const N: usize>(self, at: usize) -> Result<[u8; N], String> {
        let end = at.checked_add(N).filter(|end| *end <= self.0.len());
        let bytes = end.and_then(|end| self.0[at..end].try_into().ok());
        bytes.ok_or_else(|| "the file ends within its header".to_owned())
    }

    fn u16(self, at: usize) -> Result<u16, String> {
        self.bytes(at).map(u16::from_le_bytes)
    }

    fn u32(self, at: usize) -> Result<u32, String> {
        self.bytes(at).map(u32::from_le_bytes)
    }

    fn u64(self, at: usize) -> Result<u64, String> {
        self.bytes(at).map(u64::from_le_bytes)
    }

    fn f64(self, at: usize) -> Result<f64, String> {
        self.bytes(at).map(f64::from_le_bytes)
    }

    fn vector(self, at: usize) -> Result<DVec3, String> {
        Ok(DVec3::new(self.f64(at)?, self.f64(at + 8)?, self.f64(at + 16)?))
    }

    /// The data of the first variable length record, or extended one (LAS 1.4), of a user and a number. All records are
    /// read: each must end within the file.
    fn variable_record(self, user: &str, id: u16) -> Result<Option<&'a [u8]>, String> {
        let mut found = None;
        let (header_size, count) = (self.u16(94)?, self.u32(100)?);
        let normal = (usize::from(header_size), u64::from(count), 54);
        let has_extended = self.bytes::<1>(25)? >= [4] && header_size >= 375;
        let extended = match has_extended {
            true => (usize::try_from(self.u64(235)?).unwrap_or(usize::MAX), u64::from(self.u32(243)?), 60),
            false => (0, 0, 60),
        };
        for (mut at, count, header) in [normal, extended] {
            for _ in 0..count {
                let end = at.checked_add(header).filter(|end| *end <= self.0.len());
                let start = end.ok_or("the file ends within its header")?;
                let length = match header {
                    54 => u64::from(self.u16(at + 20)?),
                    _ => self.u64(at + 20)?,
                };
                let end = usize::try_from(length).ok().and_then(|length| start.checked_add(length));
                let end = end.filter(|end| *end <= self.0.len()).ok_or("the file ends within its header")?;
                let user_id = self.bytes::<16>(at + 2)?;
                let name = user_id.split(|b| *b == 0).next().unwrap_or_default();
                if found.is_none() && name == user.as_bytes() && self.u16(at + 18)? == id {
                    found = self.0.get(start..end);
                }
                at = end;
            }
        }
        Ok(found)
    }
}

impl Header {
    fn read(file: Fields) -> Result<Header, String> {
        let [major, minor] = file.bytes(24)?;
        let (header_size, format) = (file.u16(94)?, file.bytes::<1>(104)?[0] & FORMAT);
        let count = match minor >= 4 && header_size >= 375 {
            true => file.u64(247)?,
            false => u64::from(file.u32(107)?),
        };
        // The header states the maximum and minimum of x, then of y, then of z.
        let middle = |at| Ok::<f64, String>(0.5 * (file.f64(at + 8)? + file.f64(at)?));
        let header = Header {
            format,
            record_length: file.u16(105)?,
            count,
            scale: file.vector(131)?,
            offset: file.vector(155)?,
            centre: DVec3::new(middle(179)?, middle(195)?, middle(211)?),
        };
        let shortest = MIN_RECORD_BYTES.get(usize::from(format)).filter(|_| major == 1 && minor <= 4);
        let Some(shortest) = shortest else {
            return Err(format!(
                "expected LAS 1.0 to 1.4 with points of format 0 to 10, found version {major}.{minor} and format {format}"
            ));
        };
        if header.record_length < *shortest {
            let found = header.record_length;
            return Err(format!(
                "expected at least {shortest} bytes per point of format {format}, found {found}"
            ));
        }
        if !(header.scale.is_finite() && header.offset.is_finite() && header.scale.cmpne(DVec3::ZERO).all()) {
            let (scale, offset) = (header.scale, header.offset);
            return Err(format!("expected finite scales and offsets, found {scale} and {offset}"));
        }
        Ok(header)
    }
}

impl<'a> LasReader<'a> {
    /// Reads the header of a file.
    pub fn open(bytes: &'a [u8], selection: Selection) -> Result<LasReader<'a>, String> {
        let file = Fields(bytes);
        let header = Header::read(file)?;
        let (data_at, is_compressed) = (file.u32(96)? as usize, file.bytes::<1>(104)?[0] & COMPRESSED != 0);
        if data_at > bytes.len() {
            return Err(format!("the points begin at byte {data_at}, the file ends at {}", bytes.len()));
        }
        let records = match is_compressed {
            false => Records::Plain(&bytes[data_at..]),
            true => {
                let compressed = without_panic(|| Compressed::open(file, data_at, &header, selection))?;
                Records::Compressed(Box::new(compressed))
            }
        };
        let record = vec![0; usize::from(header.record_length)];
        let mut reader =
            LasReader { file, records, header, record, at: 0, intensity: None, object: None, device: None };
        if selection == Selection::All {
            [reader.intensity, reader.object, reader.device] = reader.shown_dimensions()?;
        }
        Ok(reader)
    }

    /// The extra dimensions with the unscaled amplitude, the object and the device.
    fn shown_dimensions(&self) -> Result<[Option<ExtraDimension>; 3], String> {
        let all = self.extra_dimensions()?;
        let columns = Columns::find(all.iter().map(|(name, _)| name.as_str()));
        let dimension = |attribute| columns.get(attribute).map(|column| all[column].1);
        Ok([Attribute::Intensity, Attribute::Object, Attribute::Channel].map(dimension))
    }

    /// The data of a variable length record.
    pub fn variable_record(&self, user: &str, id: u16) -> Result<Option<&'a [u8]>, String> {
        self.file.variable_record(user, id)
    }

    /// The extra dimensions of the points with their names (LAS 1.4, extra bytes).
    pub fn extra_dimensions(&self) -> Result<Vec<(String, ExtraDimension)>, String> {
        const DESCRIPTOR_BYTES: usize = 192;
        let mut offset = usize::from(MIN_RECORD_BYTES[usize::from(self.header.format)]);
        let descriptors = self.variable_record("LASF_Spec", 4)?.unwrap_or_default();
        let dimension = |descriptor: &[u8]| {
            let (kind, options) = (descriptor[2], descriptor[3]);
            let name = descriptor[4..36].split(|&b| b == 0).next().unwrap_or_default();
            let dimension = ExtraDimension { offset, kind };
            // Type 0 is a sequence of bytes whose length is in the options field.
            offset += if kind == 0 { usize::from(options) } else { size_of_kind(kind) };
            (String::from_utf8_lossy(name).into_owned(), dimension)
        };
        Ok(descriptors.chunks_exact(DESCRIPTOR_BYTES).map(dimension).collect())
    }

    /// Calls `take` with the bytes and the position of each record of the next batch; returns `false` after the last
    /// one.
    pub fn read_records(&mut self, mut take: impl FnMut(&[u8], DVec3)) -> Result<bool, String> {
        let end = self.header.count.min(self.at + BATCH_POINTS as u64);
        without_panic(|| {
            while self.at < end {
                self.read_record()?;
                take(&self.record, self.header.position(&self.record));
                self.at += 1;
            }
            Ok(())
        })?;
        Ok(self.at < self.header.count)
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
}

impl Header {
    fn position(&self, record: &[u8]) -> DVec3 {
        let int = |at: usize| {
            f64::from(i32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]))
        };
        DVec3::new(int(0), int(4), int(8)) * self.scale + self.offset
    }

    fn class(&self, record: &[u8]) -> u8 {
        if self.format < 6 { record[15] & 0x1f } else { record[16] }
    }

    /// Point source id: by convention of this program the number of the leg plus one.
    fn source_id(&self, record: &[u8]) -> u16 {
        let at = if self.format < 6 { 18 } else { 20 };
        u16::from_le_bytes([record[at], record[at + 1]]).saturating_sub(1)
    }

    fn channel(&self, record: &[u8]) -> u16 {
        if self.format < 6 { 0 } else { u16::from(record[15] >> 4 & 0x03) }
    }

    fn time(&self, record: &[u8]) -> f64 {
        let at = match self.format {
            6.. => 22,
            1 | 3..=5 => 20,
            _ => return 0.0,
        };
        record.get(at..at + 8).map_or(0.0, |b| f64::from_le_bytes(b.try_into().unwrap_or_default()))
    }

    fn return_number(&self, record: &[u8]) -> u8 {
        record[14] & if self.format < 6 { 0x07 } else { 0x0f }
    }
}

impl PointReader for LasReader<'_> {
    fn has(&self, attribute: Attribute) -> bool {
        match attribute {
            Attribute::NormalX | Attribute::NormalY | Attribute::NormalZ => false,
            Attribute::Object => self.object.is_some(),
            Attribute::Channel => self.device.is_some() || self.header.format >= 6,
            Attribute::Time => self.header.format >= 6 || matches!(self.header.format, 1 | 3..=5),
            _ => true,
        }
    }

    fn stated_centre(&self) -> Option<DVec3> {
        Some(self.header.centre)
    }

    fn read_batch(&mut self, batch: &mut Vec<PointRow>) -> Result<bool, String> {
        let (header, intensity, object) = (self.header.clone(), self.intensity, self.object);
        let device = self.device;
        self.read_records(|record, position| {
            let amplitude = intensity.and_then(|dimension| dimension.value(record));
            let raw_intensity = u16::from_le_bytes([record[12], record[13]]);
            batch.push(PointRow {
                position,
                normal: None,
                intensity: amplitude.map_or(f32::from(raw_intensity), |v| v as f32),
                class: header.class(record),
                return_number: header.return_number(record),
                leg: header.source_id(record),
                channel: device
                    .and_then(|dimension| dimension.value(record))
                    .map_or(header.channel(record), |v| v as u16),
                time: header.time(record),
                object: object.and_then(|dimension| dimension.value(record)).map_or(0, |v| v as i64),
            });
        })
    }
}

/// An extra dimension of the points: its offset in a record and its data type.
#[derive(Clone, Copy, Debug)]
pub struct ExtraDimension {
    offset: usize,
    kind: u8,
}

impl ExtraDimension {
    /// Its value in a record; `None` if its type is not numeric. Scale and offset are not applied.
    pub fn value(self, record: &[u8]) -> Option<f64> {
        let bytes = record.get(self.offset..self.offset + size_of_kind(self.kind))?;
        Some(match self.kind {
            1 => f64::from(bytes[0]),
            2 => f64::from(bytes[0] as i8),
            3 => f64::from(u16::from_le_bytes(bytes.try_into().ok()?)),
            4 => f64::from(i16::from_le_bytes(bytes.try_into().ok()?)),
            5 => f64::from(u32::from_le_bytes(bytes.try_into().ok()?)),
            6 => f64::from(i32::from_le_bytes(bytes.try_into().ok()?)),
            7 => u64::from_le_bytes(bytes.try_into().ok()?) as f64,
            8 => i64::from_le_bytes(bytes.try_into().ok()?) as f64,
            9 => f64::from(f32::from_le_bytes(bytes.try_into().ok()?)),
            10 => f64::from_le_bytes(bytes.try_into().ok()?),
            _ => return None,
        })
    }
}

/// Size of an extra-bytes data type, bytes (LAS 1.4 table 24).
fn size_of_kind(kind: u8) -> usize {
    match kind {
        1 | 2 => 1,
        3 | 4 => 2,
        5 | 6 | 9 => 4,
        7 | 8 | 10 => 8,
        _ => 0,
    }
}

/// Calls `read` and turns a panic of `laz` on damaged data into an error.
fn without_panic<T>(read: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    let done = damage::catch_decoder_panic(read);
    done.unwrap_or_else(|| Err("its compressed points are damaged; is the file whole?".to_owned()))
}

impl<'a> Compressed<'a> {
    fn open(
        file: Fields<'a>,
        data_at: usize,
        header: &Header,
        selection: Selection,
    ) -> Result<Compressed<'a>, String> {
        let record = file.variable_record(LazVlr::USER_ID, LazVlr::RECORD_ID)?;
        let record = record.ok_or("compressed points without the record that describes the compression")?;
        let (items, layers) = Compressed::items(record)?;
        if header.record_length > MAX_COMPRESSED_RECORD_BYTES {
            let length = header.record_length;
            return Err(format!(
                "its compressed points have {length} bytes; at most {MAX_COMPRESSED_RECORD_BYTES} can be read"
            ));
        }
        if items != u32::from(header.record_length) {
            let length = header.record_length;
            return Err(format!("expected {length} bytes per point, the compression is for {items}"));
        }
        let vlr = LazVlr::from_buffer(record).map_err(|e| e.to_string())?;
        check_chunk_table(file, data_at, header.count)?;
        let mut source = Cursor::new(file.0);
        source.set_position(data_at as u64);
        let wanted = match selection {
            Selection::PositionAndClass => {
                DecompressionSelection::xy_returns_channel().decompress_z().decompress_classification()
            }
            Selection::All => DecompressionSelection::all(),
        };
        let decompressor = LasZipDecompressor::selective(source, vlr, wanted).map_err(|e| e.to_string())?;
        Ok(Compressed { decompressor, layers, next_chunk: 0 })
    }

    /// The sum of the item sizes, bytes, and the number of layers of a chunk if the items are layered.
    fn items(record: &[u8]) -> Result<(u32, Option<usize>), String> {
        const POINT_14: u16 = 10;
        const BYTES_14: u16 = 14;
        const RGB_NIR_14: u16 = 12;
        let fields = Fields(record);
        let (mut size, mut layers, mut layered) = (0, 0, false);
        for item in 0..usize::from(fields.u16(32)?) {
            let (kind, bytes) = (fields.u16(34 + 6 * item)?, fields.u16(36 + 6 * item)?);
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

    /// Checks that the layers of the chunk starting at point number `at`, if one does, lie within the file. The
    /// decompressor allocates memory for them before it reads them.
    fn check_chunk(&mut self, at: u64, record_length: usize) -> Result<(), String> {
        let Some(layers) = self.layers.filter(|_| at == self.next_chunk) else { return Ok(()) };
        let source = self.decompressor.get_mut();
        let start = source.stream_position().map_err(|e| e.to_string())?;
        let file = Fields(source.get_ref());
        let counts = usize::try_from(start).ok().and_then(|s| s.checked_add(record_length));
        let counts = counts.ok_or("a chunk begins beyond the file's end")?;
        let points = u64::from(file.u32(counts)?);
        let mut left = file.0.len() as u64;
        for layer in 0..layers {
            let size = u64::from(file.u32(counts + 4 + 4 * layer)?);
            left = left.checked_sub(size).ok_or("a chunk is longer than the file")?;
        }
        let vlr = self.decompressor.vlr();
        let size = if vlr.uses_variable_size_chunks() { points } else { u64::from(vlr.chunk_size()) };
        self.next_chunk = at.saturating_add(size.max(1));
        Ok(())
    }
}

/// Checks that the chunk table is no longer than the file: the decompressor allocates memory for it before it reads it.
fn check_chunk_table(file: Fields, data_at: usize, points: u64) -> Result<(), String> {
    let Ok(mut at) = file.u64(data_at) else { return Err("the file ends before its points".to_owned()) };
    if at <= data_at as u64 || at >= i64::MAX as u64 {
        // Writers that cannot seek store the offset of the table at the end of the file.
        at = file.u64(file.0.len().saturating_sub(8))?;
    }
    let Ok(at) = usize::try_from(at) else { return Ok(()) };
    let chunks = at.checked_add(4).and_then(|at| file.u32(at).ok()).unwrap_or(0);
    if u64::from(chunks) > points.saturating_add(1).min(file.0.len() as u64) {
        return Err(format!("a table of {chunks} chunks for {points} points"));
    }
    Ok(())
}
