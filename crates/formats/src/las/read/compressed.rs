//! Compressed records, by the `laz` crate.

use super::chunks::Chunks;
use super::error::{LasError, MAX_COMPRESSED_RECORD_BYTES, PointsError};
use super::excerpt::Excerpt;
use super::header::{Fields, Header};
use crate::{Attribute, AttributeSet};
use laz::las::selective::DecompressionSelection;
use laz::laszip::{ChunkTable, ChunkTableEntry};
use laz::{LasZipDecompressor, LazItemType, LazVlr};
use std::io::{Cursor, Seek};
use vlscan_base::damage;

/// The compressor that stores points uncompressed, and the one that writes one chunk without a table of
/// chunks.
const UNCOMPRESSED: u16 = 0;
const POINT_WISE: u16 = 1;

/// Offset of the number of points of a chunk in the record of the compression, and a number beyond that of
/// any file.
const CHUNK_SIZE_AT: usize = 12;
const MAX_CHUNK_POINTS: u32 = u32::MAX - 1;

/// Selection of the fields of LAS records that are read; other formats read all fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selection {
    /// Position and class only.
    PositionAndClass,
    /// Position and these attributes; the others are 0.
    Attributes(AttributeSet),
    /// All fields.
    All,
}

impl Selection {
    /// The attributes whose values are read.
    pub(super) fn attributes(self) -> AttributeSet {
        match self {
            Selection::PositionAndClass => AttributeSet::of(|attribute| attribute == Attribute::Class),
            Selection::Attributes(attributes) => attributes,
            Selection::All => AttributeSet::of(|_| true),
        }
    }

    /// The layers of compressed records that hold the selected fields. Flags and intensity mark pulses
    /// without a return.
    fn layers(self) -> DecompressionSelection {
        let always = DecompressionSelection::xy_returns_channel()
            .decompress_z()
            .decompress_classification()
            .decompress_flags()
            .decompress_intensity();
        let Selection::Attributes(attributes) = self else {
            return if self == Selection::All { DecompressionSelection::all() } else { always };
        };
        let mut layers = always;
        if attributes.has(Attribute::ScanAngle) {
            layers = layers.decompress_scan_angle();
        }
        if attributes.has(Attribute::Leg) {
            layers = layers.decompress_point_source_id();
        }
        if attributes.has(Attribute::Time) {
            layers = layers.decompress_gps_time();
        }
        // Amplitudes, objects, devices and paths of this program.
        let in_extra_bytes = [Attribute::Intensity, Attribute::Object, Attribute::Channel, Attribute::Path];
        if in_extra_bytes.into_iter().any(|attribute| attributes.has(attribute)) {
            layers = layers.decompress_extra_bytes();
        }
        layers
    }
}

pub(super) struct Compressed<'a> {
    pub decompressor: LasZipDecompressor<'a, Cursor<&'a [u8]>>,
    /// The fields that are decompressed.
    selection: DecompressionSelection,
    /// True if the points are one chunk, of any size.
    is_one_chunk: bool,
    /// Number of layers of a chunk, if chunks are layered.
    layers: Option<usize>,
    /// Number of the first point of the next chunk. The layers of that chunk are checked before they are
    /// decompressed.
    next_chunk: u64,
}

impl<'a> Compressed<'a> {
    /// Begins to decompress the points of a file; `None` if they are stored uncompressed.
    pub fn open(
        file: Fields<'a>,
        header: &Header,
        selection: Selection,
    ) -> Result<Option<Compressed<'a>>, LasError> {
        let record = header.variable_record(file, LazVlr::USER_ID, LazVlr::RECORD_ID)?;
        let record = record.ok_or(LasError::NoCompression)?;
        let cut = |_| LasError::CompressionEnds;
        let compressor = Fields(record).u16(0).map_err(cut)?;
        if compressor == UNCOMPRESSED {
            return Ok(None);
        }
        let coder = Fields(record).u16(2).map_err(cut)?;
        if coder != 0 {
            return Err(LasError::Coder(coder));
        }
        let (items, layers) = Compressed::items(record).map_err(cut)?;
        if header.record_length > MAX_COMPRESSED_RECORD_BYTES {
            return Err(LasError::RecordTooLong { length: header.record_length });
        }
        if items != u32::from(header.record_length) {
            return Err(LasError::RecordLength { length: header.record_length, items });
        }
        let is_one_chunk = compressor == POINT_WISE;
        let mut record = record.to_vec();
        if is_one_chunk {
            // Its size is 0, which the library takes for chunks of various sizes.
            record[CHUNK_SIZE_AT..CHUNK_SIZE_AT + 4].copy_from_slice(&MAX_CHUNK_POINTS.to_le_bytes());
        }
        let vlr = LazVlr::from_buffer(record).map_err(LasError::of_library)?;
        // The library looks at the versions after it has read from the points.
        for item in vlr.items() {
            use LazItemType::{Byte, GpsTime, Point10, RGB12, WavePacket13};
            let versions = match item.item_type() {
                Byte(_) | GpsTime | Point10 | RGB12 | WavePacket13 => 1..=2,
                _ => 3..=4,
            };
            if !versions.contains(&item.version()) {
                return Err(LasError::ItemVersion(item.version()));
            }
        }
        if !is_one_chunk {
            check_chunk_table(file, header.data_at, header.count)?;
        }
        let mut source = Cursor::new(file.0);
        source.set_position(header.data_at as u64);
        let selected_fields = selection.layers();
        let decompressor =
            LasZipDecompressor::selective(source, vlr, selected_fields).map_err(LasError::of_library)?;
        Ok(Some(Compressed { decompressor, selection: selected_fields, is_one_chunk, layers, next_chunk: 0 }))
    }

    /// The sum of the item sizes, bytes, and the number of layers of a chunk if the items are layered.
    fn items(record: &[u8]) -> Result<(u32, Option<usize>), LasError> {
        const POINT_14: u16 = 10;
        const BYTES_14: u16 = 14;
        const RGB_NIR_14: u16 = 12;
        let fields = Fields(record);
        let (mut size, mut layers, mut layered) = (0, 0, false);
        for item in 0..usize::from(fields.u16(32)?) {
            let (kind, bytes) = (fields.u16(34 + 6 * item)?, fields.u16(36 + 6 * item)?);
            // The version, which the library reads.
            fields.u16(38 + 6 * item)?;
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

    /// Checks that the layers of the chunk starting at point number `at`, if one does, lie within the file.
    /// The decompressor allocates memory for them before it reads them.
    pub fn check_chunk(&mut self, at: u64, record_length: usize) -> Result<(), PointsError> {
        let Some(layers) = self.layers.filter(|_| at == self.next_chunk) else { return Ok(()) };
        let source = self.decompressor.get_mut();
        let start = source.stream_position()?;
        let file = Fields(source.get_ref());
        let counts = usize::try_from(start).ok().and_then(|s| s.checked_add(record_length));
        let counts = counts.ok_or(PointsError::ChunkBehindEnd)?;
        let size_at = |at: usize| file.u32(at).map(u64::from).map_err(|_| PointsError::ChunkHeaderEnds);
        let points = size_at(counts)?;
        let mut left = file.0.len() as u64;
        for layer in 0..layers {
            let size = size_at(counts + 4 + 4 * layer)?;
            left = left.checked_sub(size).ok_or(PointsError::ChunkTooLong)?;
        }
        let vlr = self.decompressor.vlr();
        let size = if vlr.uses_variable_size_chunks() { points } else { u64::from(vlr.chunk_size()) };
        self.next_chunk = at.saturating_add(size.max(1));
        Ok(())
    }
}

impl<'a> Compressed<'a> {
    /// The chunks, if each can be found without decompressing those before it. No point may have been read.
    /// Of the extra bytes, those at the offsets in records for which `is_read` is true are decompressed.
    pub fn chunks(&self, header: &Header, is_read: impl Fn(usize) -> bool) -> Option<Chunks<'a>> {
        if self.is_one_chunk {
            return None;
        }
        let source = self.decompressor.get();
        let (file, start): (&'a [u8], u64) = (*source.get_ref(), source.position());
        let vlr = self.decompressor.vlr().clone();
        let mut table = Vec::new();
        if self.layers.is_none() || vlr.uses_variable_size_chunks() {
            let mut source = Cursor::new(file);
            source.set_position(header.data_at as u64);
            let read = damage::catch_decoder_panic(|| ChunkTable::read_from(&mut source, &vlr));
            let entries = read?.ok()?;
            let entries: &[ChunkTableEntry] = entries.as_ref();
            table = entries.to_vec();
        }
        let record_length = usize::from(header.record_length);
        let excerpt = Excerpt::of(&vlr, self.selection, is_read);
        Some(Chunks {
            file: Fields(file),
            vlr,
            selection: self.selection,
            record_length,
            layers: self.layers,
            excerpt,
            table,
            start,
        })
    }
}

/// Checks that the chunk table is no longer than the file: the decompressor allocates memory for it before it
/// reads it.
fn check_chunk_table(file: Fields, data_at: usize, points: u64) -> Result<(), LasError> {
    let Ok(mut at) = file.u64(data_at) else { return Err(LasError::PointsMissing) };
    if at <= data_at as u64 || at >= i64::MAX as u64 {
        // Writers that cannot seek store the offset of the table at the end of the file.
        at = file.u64(file.0.len().saturating_sub(8))?;
    }
    let Ok(at) = usize::try_from(at) else { return Ok(()) };
    let chunks = at.checked_add(4).and_then(|at| file.u32(at).ok()).unwrap_or(0);
    if u64::from(chunks) > points.saturating_add(1).min(file.0.len() as u64) {
        return Err(LasError::ChunkTable { chunks, points });
    }
    Ok(())
}

/// Calls `read` and turns a panic of `laz` on damaged data into an error.
pub(super) fn without_panic<T>(read: impl FnOnce() -> Result<T, LasError>) -> Result<T, LasError> {
    let done = damage::catch_decoder_panic(read);
    done.unwrap_or(Err(LasError::Damaged))
}
