//! Images of textures: PNG and JPEG as red, green and blue of 8 bits.

use std::io::Cursor;
use vlscan_base::damage::catch_decoder_panic;
use vlscan_base::quantity;
use vlscan_base::store::Checksum;
use vlscan_survey::TextureWrap;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Bytes of a texel.
const TEXEL: usize = 3;

/// Maximum number of columns, and of rows, of an image.
const MAX_SIDE: usize = 1 << 16;

/// An image.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct Texture {
    width: u32,
    height: u32,
    /// By rows from the top.
    texels: Vec<u8>,
    /// Checksum of the size and the texels.
    checksum: u64,
}

/// A texture that cannot be used; the text follows its name.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum TextureError {
    /// No file has the name.
    #[error("there is no such file")]
    Missing,
    /// A file that cannot be opened.
    #[error("{0}")]
    Unreadable(#[from] std::io::Error),
    /// Bytes of another format.
    #[error("expected a PNG or JPEG image")]
    Format,
    /// An image that a decoder rejects.
    #[error("the image is damaged: {0}")]
    Damaged(String),
    /// An image without texels, or with too many.
    #[error("the image has {width} by {height} texels")]
    Size {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// An image beyond the memory limit.
    #[error("the image needs {}, the memory limit leaves {}", shown(.needed), shown(.free))]
    TooLarge {
        /// Bytes that it needs.
        needed: u64,
        /// Bytes that are left.
        free: u64,
    },
}

fn shown(bytes: &u64) -> String {
    quantity::bytes(*bytes)
}

impl Texture {
    /// Decodes a file, for which `free` bytes of memory are left.
    pub fn decode(bytes: &[u8], free: u64) -> Result<Texture, TextureError> {
        let decode = || match bytes {
            [0x89, b'P', b'N', b'G', ..] => decode_png(bytes, free),
            [0xff, 0xd8, 0xff, ..] => decode_jpeg(bytes, free),
            _ => Err(TextureError::Format),
        };
        catch_decoder_panic(decode).unwrap_or_else(|| Err(damaged("its decoder gave up")))
    }

    /// The nearest texel of texture coordinates, which count from the upper edge, or from the lower one if
    /// `is_upward` is set.
    pub fn nearest(&self, [u, v]: [f64; 2], [wrap_u, wrap_v]: [TextureWrap; 2], is_upward: bool) -> [u8; 3] {
        let (column, row) = (index(u, self.width, wrap_u), index(v, self.height, wrap_v));
        let row = if is_upward { self.height as usize - 1 - row } else { row };
        let at = TEXEL * (row * self.width as usize + column);
        [self.texels[at], self.texels[at + 1], self.texels[at + 2]]
    }

    /// An image of these columns and rows; `None` if it does not have that many texels.
    pub fn of_texels([width, height]: [u32; 2], texels: Vec<u8>) -> Option<Texture> {
        check_size(width as usize, height as usize, u64::MAX).ok()?;
        finish(width, height, texels).ok()
    }

    /// Number of columns and rows.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Red, green and blue of the texels, by rows from the top.
    pub fn texels(&self) -> &[u8] {
        &self.texels
    }

    /// Checksum of the size and the texels.
    pub fn checksum(&self) -> u64 {
        self.checksum
    }

    /// Bytes in memory.
    pub fn memory(&self) -> usize {
        size_of::<Texture>() + self.texels.capacity()
    }
}

/// The texel of a coordinate along an axis of `size` texels.
fn index(coordinate: f64, size: u32, wrap: TextureWrap) -> usize {
    let count = f64::from(size);
    let texel = libm::floor(coordinate * count);
    if !texel.is_finite() {
        return 0;
    }
    let texel = match wrap {
        TextureWrap::Clamp => texel,
        TextureWrap::Repeat => texel.rem_euclid(count),
        TextureWrap::Mirror => {
            let within = texel.rem_euclid(2.0 * count);
            if within < count { within } else { 2.0 * count - 1.0 - within }
        }
    };
    texel.clamp(0.0, count - 1.0) as usize
}

fn damaged(what: impl ToString) -> TextureError {
    TextureError::Damaged(what.to_string())
}

/// Checks the size of an image before its texels are decoded.
fn check_size(width: usize, height: usize, free: u64) -> Result<(), TextureError> {
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
        return Err(TextureError::Size { width, height });
    }
    // Decoders need memory for another copy, with four channels.
    let needed = (width as u64) * (height as u64) * (TEXEL as u64 + 4);
    if needed > free { Err(TextureError::TooLarge { needed, free }) } else { Ok(()) }
}

fn decode_png(bytes: &[u8], free: u64) -> Result<Texture, TextureError> {
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: 1 << 30 });
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(damaged)?;
    let (width, height) = reader.info().size();
    check_size(width as usize, height as usize, free)?;
    let size = reader.output_buffer_size().ok_or_else(|| damaged("too many texels"))?;
    let mut buffer = vec![0; size];
    let frame = reader.next_frame(&mut buffer).map_err(damaged)?;
    buffer.truncate(frame.buffer_size());
    let texels = match frame.color_type {
        png::ColorType::Rgb => buffer,
        png::ColorType::Rgba => buffer.chunks_exact(4).flat_map(|t| [t[0], t[1], t[2]]).collect(),
        png::ColorType::Grayscale => buffer.iter().flat_map(|&grey| [grey; 3]).collect(),
        png::ColorType::GrayscaleAlpha => buffer.chunks_exact(2).flat_map(|t| [t[0]; 3]).collect(),
        png::ColorType::Indexed => return Err(damaged("its palette is missing")),
    };
    finish(width, height, texels)
}

/// Decodes without instructions that only some machines have, so that all decode the same texels.
fn decode_jpeg(bytes: &[u8], free: u64) -> Result<Texture, TextureError> {
    let options = DecoderOptions::default()
        .set_max_width(MAX_SIDE)
        .set_max_height(MAX_SIDE)
        .set_use_unsafe(false)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(Cursor::new(bytes), options);
    decoder.decode_headers().map_err(|e| damaged(format!("{e:?}")))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| damaged("it has no size"))?;
    check_size(width, height, free)?;
    let texels = decoder.decode().map_err(|e| damaged(format!("{e:?}")))?;
    finish(width as u32, height as u32, texels)
}

fn finish(width: u32, height: u32, mut texels: Vec<u8>) -> Result<Texture, TextureError> {
    if texels.len() != TEXEL * width as usize * height as usize {
        return Err(damaged("texels are missing"));
    }
    texels.shrink_to_fit();
    let mut sum = Checksum::default();
    sum.debug(&(width, height));
    sum.array(&texels);
    Ok(Texture { width, height, texels, checksum: sum.finish() })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A PNG image of RGB texels.
    pub fn png_of(width: u32, height: u32, texels: &[u8]) -> Vec<u8> {
        encoded(width, height, png::ColorType::Rgb, png::BitDepth::Eight, texels)
    }

    fn encoded(width: u32, height: u32, kind: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(kind);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        bytes
    }

    const REPEAT: [TextureWrap; 2] = [TextureWrap::Repeat; 2];

    #[test]
    fn texels_are_those_of_the_file() {
        let texels: Vec<u8> = (0..18).map(|i| 10 * i).collect();
        let image = Texture::decode(&png_of(3, 2, &texels), 1 << 20).unwrap();
        let texel = |column: f64, row: f64| image.nearest([column / 3.0, row / 2.0], REPEAT, false);
        assert_eq!([texel(0.5, 0.5), texel(2.5, 1.5)], [[0, 10, 20], [150, 160, 170]]);
        // From the lower edge.
        assert_eq!(image.nearest([0.5 / 3.0, 0.25], REPEAT, true), [90, 100, 110]);
        let grey = encoded(2, 1, png::ColorType::Grayscale, png::BitDepth::Eight, &[7, 200]);
        assert_eq!(Texture::decode(&grey, 1 << 20).unwrap().texels, [7, 7, 7, 200, 200, 200]);
        let alpha = encoded(1, 1, png::ColorType::Rgba, png::BitDepth::Eight, &[1, 2, 3, 0]);
        assert_eq!(Texture::decode(&alpha, 1 << 20).unwrap().texels, [1, 2, 3]);
        let deep = encoded(1, 1, png::ColorType::Rgb, png::BitDepth::Sixteen, &[9, 255, 8, 0, 7, 1]);
        assert_eq!(Texture::decode(&deep, 1 << 20).unwrap().texels, [9, 8, 7]);
    }

    #[test]
    fn coordinates_beyond_the_image_follow_the_rule() {
        let of = |coordinate, wrap| index(coordinate, 4, wrap);
        for (coordinate, repeat, mirror, clamp) in [
            (0.0, 0, 0, 0),
            (0.99, 3, 3, 3),
            (1.0, 0, 3, 3),
            (1.3, 1, 2, 3),
            (-0.1, 3, 0, 0),
            (2.6, 2, 2, 3),
            (f64::NAN, 0, 0, 0),
            (1e300, 0, 0, 3),
        ] {
            let found = [TextureWrap::Repeat, TextureWrap::Mirror, TextureWrap::Clamp]
                .map(|wrap| of(coordinate, wrap));
            assert!(found.iter().all(|&i| i < 4), "{coordinate}: {found:?}");
            if coordinate < 1e300 {
                assert_eq!(found, [repeat, mirror, clamp], "{coordinate}");
            }
        }
    }

    #[test]
    fn images_that_cannot_be_used_are_errors() {
        let image = png_of(3, 2, &[5; 18]);
        let error = |bytes: &[u8], free| Texture::decode(bytes, free).err().unwrap().to_string();
        assert!(error(b"GIF89a", 1 << 20).contains("expected a PNG or JPEG image"));
        assert!(error(&image, 10).contains("the memory limit leaves"));
        assert!(error(&image[..40], 1 << 20).contains("damaged"));
        assert!(error(&[0xff, 0xd8, 0xff, 0xe0, 1, 2, 3], 1 << 20).contains("damaged"));
    }
}
