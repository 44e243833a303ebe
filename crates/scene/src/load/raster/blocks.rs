//! The strips and tiles of a TIFF image: where they are, how they are compressed, and the numbers in them
//! (TIFF 6.0; supplement 3 for floating-point predictors; GDAL and libtiff for ZSTD and LERC).

use super::error::{RasterError, UnpackError};
use super::file::{Directory, OpenFile};
use super::unpack::{inflate, unlzw, unpack_bits, unzstd};
use tiff::decoder::ChunkType;
use tiff::tags::{ByteOrder, Tag};
use vlscan_base::damage::catch_decoder_panic;
use vlscan_survey::PixelType;

/// Maximum number of pixels of a block that is larger than four times its raster.
const MAX_BLOCK_PIXELS: u64 = 1 << 22;
/// LERC's own compression: 0 none, 1 Deflate, 2 ZSTD.
const LERC_PARAMETERS_TAG: Tag = Tag::Unknown(50674);
/// Bytes that LERC may need in addition to its numbers.
const MAX_LERC_OVERHEAD: usize = 1 << 16;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Window {
    /// First column and row.
    pub left: usize,
    pub top: usize,
    /// Number of columns and rows.
    pub width: usize,
    pub height: usize,
}

impl Window {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width.saturating_mul(self.height)
    }

    /// The pixels that are in both.
    pub fn intersection(&self, other: &Window) -> Option<Window> {
        let common = |start: usize, count: usize, other: usize, others: usize| {
            let (from, to) = (start.max(other), (start + count).min(other + others));
            (from < to).then(|| (from, to - from))
        };
        let (left, width) = common(self.left, self.width, other.left, other.width)?;
        let (top, height) = common(self.top, self.height, other.top, other.height)?;
        Some(Window { left, top, width, height })
    }
}

/// How blocks are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Compression {
    None,
    Lzw,
    Deflate,
    PackBits,
    Zstd,
    /// With the compression of its own output.
    Lerc(u32),
}

impl Compression {
    fn of_code(code: u16, lerc: u32) -> Result<Compression, RasterError> {
        let unread = match code {
            1 => return Ok(Compression::None),
            5 => return Ok(Compression::Lzw),
            8 | 32_946 => return Ok(Compression::Deflate),
            32_773 => return Ok(Compression::PackBits),
            50_000 => return Ok(Compression::Zstd),
            34_887 if lerc <= 2 => return Ok(Compression::Lerc(lerc)),
            2..=4 => "CCITT fax",
            6 | 7 => "JPEG",
            34_712 => "JPEG 2000",
            34_887 => "LERC with an unknown second step",
            34_925 => "LZMA",
            50_001 => "WebP",
            50_002 | 52_546 => "JPEG XL",
            _ => return Err(RasterError::UnknownCompression(code)),
        };
        Err(RasterError::Compression(unread))
    }

    /// Maximum ratio of the numbers to the bytes of a block. A raster that states more is damaged. A code of
    /// LZW has 12 bits and stands for at most 3840 bytes.
    fn max_ratio(self) -> u64 {
        match self {
            Compression::None => 1,
            Compression::PackBits => 64,
            Compression::Lzw => 3000,
            Compression::Deflate => 1040,
            Compression::Zstd | Compression::Lerc(_) => 1 << 20,
        }
    }
}

/// Meaning of the bits of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum NumberFormat {
    Unsigned,
    Signed,
    Float,
}

/// The blocks of an image, all of a size; those at the right and lower border reach beyond it (tiles) or are
/// shorter (strips).
#[derive(Debug)]
pub(super) struct Blocks {
    /// Size of the image, pixels.
    pub columns: usize,
    pub rows: usize,
    /// Columns and rows of a block.
    pub size: (usize, usize),
    /// Number of numbers per pixel.
    pub bands: usize,
    /// Bits of a number.
    bits: usize,
    format: NumberFormat,
    is_tiled: bool,
    /// True if each band has separate blocks.
    is_planar: bool,
    compression: Compression,
    /// 1: none; 2: differences of neighbours; 3: differences of the bytes of floats.
    predictor: u16,
    is_big_endian: bool,
    has_reversed_bits: bool,
    /// Offset and number of bytes of each block; no bytes for a block that is left out.
    places: Vec<(u64, u64)>,
}

impl Blocks {
    /// Reads the description of the current image of a file of `held` bytes, and checks it.
    pub fn read(directory: &mut Directory, held: u64) -> Result<Blocks, RasterError> {
        let (width, height) = directory.dimensions()?;
        let (columns, rows) = (width as usize, height as usize);
        let small = |directory: &mut Directory, tag: Tag, default: u64| -> Result<u64, RasterError> {
            Ok(directory.find_tag_unsigned::<u64>(tag)?.unwrap_or(default))
        };
        let list = |directory: &mut Directory, tag: Tag| -> Result<Vec<u64>, RasterError> {
            Ok(directory.find_tag_unsigned_vec(tag)?.unwrap_or_default())
        };
        let lerc = list(directory, LERC_PARAMETERS_TAG)?.get(1).map_or(0, |&code| code as u32);
        let compression = Compression::of_code(small(directory, Tag::Compression, 1)? as u16, lerc)?;
        let bits = list(directory, Tag::BitsPerSample)?.first().copied().unwrap_or(1);
        let format = match list(directory, Tag::SampleFormat)?.first().copied().unwrap_or(1) {
            1 | 4 => NumberFormat::Unsigned,
            2 => NumberFormat::Signed,
            3 => NumberFormat::Float,
            5 | 6 => return Err(RasterError::Complex),
            other => return Err(RasterError::NumberFormat(other)),
        };
        match (format, bits) {
            (NumberFormat::Float, 16 | 32 | 64)
            | (NumberFormat::Unsigned | NumberFormat::Signed, 1 | 2 | 4 | 8 | 16 | 32 | 64) => {}
            _ => return Err(RasterError::NumberBits(bits)),
        }
        let is_tiled = directory.get_chunk_type() == ChunkType::Tile;
        let (block_width, block_height) = directory.chunk_dimensions();
        let size = match is_tiled {
            true => (block_width as usize, block_height as usize),
            false => (columns, (block_height as usize).min(rows)),
        };
        if size.0 == 0 || size.1 == 0 {
            return Err(RasterError::EmptyBlocks);
        }
        let tags = match is_tiled {
            true => (Tag::TileOffsets, Tag::TileByteCounts),
            false => (Tag::StripOffsets, Tag::StripByteCounts),
        };
        let (offsets, counts) = (list(directory, tags.0)?, list(directory, tags.1)?);
        let is_big_endian = matches!(directory.byte_order(), ByteOrder::BigEndian);
        let blocks = Blocks {
            columns,
            rows,
            size,
            bands: (small(directory, Tag::SamplesPerPixel, 1)? as usize).max(1),
            bits: bits as usize,
            format,
            is_tiled,
            is_planar: small(directory, Tag::PlanarConfiguration, 1)? == 2,
            compression,
            predictor: small(directory, Tag::Predictor, 1)? as u16,
            is_big_endian,
            has_reversed_bits: small(directory, Tag::FillOrder, 1)? == 2,
            places: offsets.into_iter().zip(counts).collect(),
        };
        blocks.check(held)?;
        Ok(blocks)
    }

    fn check(&self, held: u64) -> Result<(), RasterError> {
        let (width, height) = (self.columns as u64, self.rows as u64);
        let pixels = width.saturating_mul(height);
        let bytes = pixels.saturating_mul(self.pixel_bytes());
        let can_hold = self.compression.max_ratio().max(Compression::Lzw.max_ratio());
        if bytes > held.saturating_mul(can_hold) {
            return Err(RasterError::Size { width, height, bytes, held });
        }
        let (block_width, block_height) = self.size;
        let block_pixels = (block_width as u64).saturating_mul(block_height as u64);
        if block_pixels > MAX_BLOCK_PIXELS.max(pixels.saturating_mul(4)) {
            return Err(RasterError::LargeBlocks { width: block_width, height: block_height });
        }
        let planes = if self.is_planar { self.bands } else { 1 };
        if self.places.len() < self.count().saturating_mul(planes) {
            return Err(RasterError::MissingBlocks);
        }
        let is_float = self.format == NumberFormat::Float;
        match self.predictor {
            1 => {}
            2 if !is_float && self.bits >= 8 => {}
            // Floats are taken as whole numbers of their bits.
            2 if is_float => {}
            3 if is_float => {}
            other => return Err(RasterError::Predictor(other)),
        }
        let ratio = self.compression.max_ratio();
        let is_short = |block: usize| {
            let bytes = self.places[block].1;
            bytes > 0 && bytes.saturating_mul(ratio) < self.stored(block % self.count()).bytes as u64
        };
        if let Some(block) = (0..self.places.len()).find(|&block| is_short(block)) {
            return Err(RasterError::ShortBlock { block, bytes: self.places[block].1 });
        }
        Ok(())
    }

    /// Bytes of a pixel with all bands.
    pub fn pixel_bytes(&self) -> u64 {
        (self.bits as u64).saturating_mul(self.bands as u64).div_ceil(8)
    }

    /// Memory for decoding a block, bytes.
    pub fn decoding_bytes(&self) -> u64 {
        let numbers = (self.size.0 as u64)
            .saturating_mul(self.size.1 as u64)
            .saturating_mul(self.bands_of_block() as u64);
        numbers.saturating_mul(self.bits.div_ceil(8) as u64 + 2 * size_of::<u64>() as u64)
    }

    /// Number of blocks of a band.
    pub fn count(&self) -> usize {
        self.columns.div_ceil(self.size.0).saturating_mul(self.rows.div_ceil(self.size.1))
    }

    /// The pixels of the image that a block covers.
    pub fn extent(&self, block: usize) -> Window {
        let across = self.columns.div_ceil(self.size.0);
        let (left, top) = (block % across * self.size.0, block / across * self.size.1);
        let (width, height) = (self.size.0.min(self.columns - left), self.size.1.min(self.rows - top));
        Window { left, top, width, height }
    }

    /// The blocks of a band that have pixels in a window, which must be within the image.
    pub fn within(&self, window: Window) -> impl Iterator<Item = usize> + use<> {
        let across = self.columns.div_ceil(self.size.0);
        let of = |start: usize, count: usize, size: usize| start / size..(start + count).div_ceil(size);
        let columns = of(window.left, window.width, self.size.0);
        of(window.top, window.height, self.size.1)
            .flat_map(move |row| columns.clone().map(move |column| row * across + column))
    }

    /// Type of the numbers.
    pub fn pixels(&self) -> PixelType {
        let bits = self.bits as u32;
        match self.format {
            NumberFormat::Unsigned => PixelType::Unsigned(bits),
            NumberFormat::Signed => PixelType::Signed(bits),
            NumberFormat::Float => PixelType::Float(bits),
        }
    }

    /// The least number of an image of whole numbers that 16 bits can hold; `None` for other images.
    pub fn least_short(&self) -> Option<i32> {
        match self.format {
            NumberFormat::Unsigned if self.bits <= 16 => Some(0),
            NumberFormat::Signed if self.bits <= 16 => Some(i16::MIN.into()),
            _ => None,
        }
    }

    /// Number of bands in a block.
    fn bands_of_block(&self) -> usize {
        if self.is_planar { 1 } else { self.bands }
    }

    fn stored(&self, block: usize) -> Stored {
        let height = if self.is_tiled { self.size.1 } else { self.extent(block).height };
        let numbers = self.size.0.saturating_mul(self.bands_of_block());
        let row_bytes = numbers.saturating_mul(self.bits).div_ceil(8);
        Stored { height, numbers, row_bytes, bytes: row_bytes.saturating_mul(height) }
    }

    /// The numbers of some bands of a block, row by row, cut to the image; `None` for a block that is left
    /// out.
    pub fn decode(
        &self,
        file: &OpenFile,
        block: usize,
        bands: &[usize],
    ) -> Result<Option<Vec<Vec<f64>>>, RasterError> {
        if self.is_planar {
            let mut planes = Vec::with_capacity(bands.len());
            for band in bands {
                match self.decode_place(file, block, band * self.count() + block, &[0])? {
                    Some(mut plane) => planes.append(&mut plane),
                    None => return Ok(None),
                }
            }
            return Ok(Some(planes));
        }
        self.decode_place(file, block, block, bands)
    }

    fn decode_place(
        &self,
        file: &OpenFile,
        block: usize,
        place: usize,
        bands: &[usize],
    ) -> Result<Option<Vec<Vec<f64>>>, RasterError> {
        let (offset, count) = self.places[place];
        if count == 0 {
            return Ok(None);
        }
        if offset.saturating_add(count) > file.length() {
            return Err(RasterError::BlockBehindEnd { block: place });
        }
        let data = file.bytes(offset, count as usize);
        let data = &*data.map_err(|source| RasterError::Block { block: place, source })?;
        let stored = self.stored(block);
        let Window { width, height, .. } = self.extent(block);
        let step = self.bands_of_block();
        let cut = |number: &dyn Fn(usize) -> f64| -> Vec<Vec<f64>> {
            let band = |&band: &usize| {
                let row =
                    |row: usize| (0..width).map(move |column| row * stored.numbers + column * step + band);
                (0..height).flat_map(row).map(number).collect()
            };
            bands.iter().map(band).collect()
        };
        if let Compression::Lerc(inner) = self.compression {
            let numbers = self.lerc(data, inner, &stored);
            let numbers = numbers.map_err(|source| RasterError::Lerc { block: place, source })?;
            return Ok(Some(cut(&|i| numbers[i])));
        }
        let raw = self.unpack(data, &stored);
        let raw = raw.map_err(|source| RasterError::Packed { block: place, source })?;
        if raw.len() < stored.bytes {
            return Err(RasterError::BlockEnds { block: place, width, height });
        }
        let bits = self.numbers(&raw, &stored);
        Ok(Some(cut(&|i| self.value(bits[i]))))
    }

    /// The bytes of a block before compression, or fewer if the block is damaged.
    fn unpack(&self, data: &[u8], stored: &Stored) -> Result<Vec<u8>, UnpackError> {
        let reversed: Vec<u8>;
        let data = match self.has_reversed_bits {
            true => {
                reversed = data.iter().map(|byte| byte.reverse_bits()).collect();
                &reversed
            }
            false => data,
        };
        match self.compression {
            Compression::None => Ok(data[..data.len().min(stored.bytes)].to_vec()),
            Compression::Deflate => inflate(data, stored.bytes),
            Compression::Zstd => unzstd(data, stored.bytes),
            Compression::Lzw => unlzw(data, stored.bytes),
            Compression::PackBits => Ok(unpack_bits(data, stored.bytes)),
            Compression::Lerc(_) => Err(UnpackError::NoBytes),
        }
    }

    fn lerc(&self, data: &[u8], inner: u32, stored: &Stored) -> Result<Vec<f64>, UnpackError> {
        let limit = stored.bytes.saturating_mul(2).saturating_add(MAX_LERC_OVERHEAD);
        let unpacked: Vec<u8>;
        let data = match inner {
            1 => {
                unpacked = inflate(data, limit)?;
                &unpacked
            }
            2 => {
                unpacked = unzstd(data, limit)?;
                &unpacked
            }
            _ => data,
        };
        let decoded = catch_decoder_panic(|| {
            let info = lerc_reader::inspect_first(data).map_err(UnpackError::of_decoder)?;
            let (width, height, depth) = (info.width as usize, info.height as usize, info.depth as usize);
            if (width, height, depth) != (self.size.0, stored.height, self.bands_of_block()) {
                return Err(UnpackError::Size { width, height, depth });
            }
            lerc_reader::decode_first_to_f64(data).map_err(UnpackError::of_decoder)
        });
        let mut decoded = decoded.unwrap_or(Err(UnpackError::Damaged))?;
        if decoded.pixels.len() < stored.numbers * stored.height {
            return Err(UnpackError::MissingNumbers);
        }
        if let Some(mask) = &decoded.mask {
            let step = self.bands_of_block();
            for (pixel, _) in mask.iter().enumerate().filter(|(_, is_valid)| **is_valid == 0) {
                decoded.pixels[pixel * step..(pixel + 1) * step].fill(f64::NAN);
            }
        }
        Ok(decoded.pixels)
    }

    /// The bits of all numbers of a block.
    fn numbers(&self, raw: &[u8], stored: &Stored) -> Vec<u64> {
        let mut all = Vec::with_capacity(stored.numbers * stored.height);
        let step = self.bands_of_block();
        for row in raw.chunks_exact(stored.row_bytes).take(stored.height) {
            let start = all.len();
            match (self.predictor, self.bits) {
                (3, bits) => self.undo_float_predictor(row, bits / 8, stored.numbers, &mut all),
                (_, 8) => all.extend(row.iter().map(|&b| u64::from(b))),
                (_, bits @ (16 | 32 | 64)) => all.extend(row.chunks_exact(bits / 8).map(|b| self.whole(b))),
                (_, bits) => {
                    let number = |i: usize| {
                        let at = i * bits;
                        u64::from(row[at / 8] >> (8 - bits - at % 8)) & ((1 << bits) - 1)
                    };
                    all.extend((0..stored.numbers).map(number));
                }
            }
            if self.predictor == 2 {
                let mask = u64::MAX >> (64 - self.bits);
                for i in start + step..all.len() {
                    all[i] = all[i].wrapping_add(all[i - step]) & mask;
                }
            }
        }
        all
    }

    /// A whole number of up to eight bytes.
    fn whole(&self, bytes: &[u8]) -> u64 {
        let push = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        if self.is_big_endian { bytes.iter().fold(0, push) } else { bytes.iter().rev().fold(0, push) }
    }

    /// The floats of a row whose bytes are differences: first the most significant bytes of all floats, and
    /// so on.
    fn undo_float_predictor(&self, row: &[u8], size: usize, numbers: usize, all: &mut Vec<u64>) {
        let step = self.bands_of_block();
        let mut bytes = row.to_vec();
        for i in step..bytes.len() {
            bytes[i] = bytes[i].wrapping_add(bytes[i - step]);
        }
        let number =
            |i: usize| (0..size).fold(0, |number, byte| number << 8 | u64::from(bytes[byte * numbers + i]));
        all.extend((0..numbers).map(number));
    }

    fn value(&self, bits: u64) -> f64 {
        match (self.format, self.bits) {
            (NumberFormat::Float, 16) => half(bits as u16),
            (NumberFormat::Float, 32) => f64::from(f32::from_bits(bits as u32)),
            (NumberFormat::Float, _) => f64::from_bits(bits),
            (NumberFormat::Unsigned, _) => bits as f64,
            (NumberFormat::Signed, size) => {
                let unused = 64 - size;
                ((bits << unused) as i64 >> unused) as f64
            }
        }
    }
}

/// A block as it is stored.
struct Stored {
    /// Number of rows.
    height: usize,
    /// Numbers and bytes of a row.
    numbers: usize,
    row_bytes: usize,
    bytes: usize,
}

/// A float of 16 bits (IEEE 754).
fn half(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff));
    let size = match exponent {
        0 => fraction * libm::exp2(-24.0),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * libm::exp2(f64::from(exponent - 15)),
    };
    if bits >> 15 == 1 { -size } else { size }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_have_their_values() {
        for (bits, value) in
            [(0x3c00, 1.0), (0xc000, -2.0), (0x3555, 0.333251953125), (0x7bff, 65504.0), (1, 2f64.powi(-24))]
        {
            assert_eq!(half(bits), value);
        }
        assert!(half(0x7c00).is_infinite() && half(0x7e00).is_nan());
    }
}
